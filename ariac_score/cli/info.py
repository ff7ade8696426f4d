"""`ariac-score info LOG`: the contents of a log, and which checks of a rule set it could decide."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import counted, is_quiet
from ariac_score.cli.partial import add_partial
from ariac_score.engine.measure import decidable
from ariac_score.engine.prepared import prepare, words_of
from ariac_score.engine.read import competition_of, find_trial, no_work_found, read_trial
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.logs.logmap import load_log_map
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.terminal.output import progress_bar
from ariac_score.terminal.style import plain, style_for
from ariac_score.trial.cut_off import with_cut
from ariac_score.trial.vocabulary import QUANTITIES
from ariac_score.trial.words import HANDED_IN, Words
from ariac_score.trial.work import Fact, WorkItem, announced_s

EXIT_DAMAGED = 6


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "info",
        description="Show the topics, types, counts, rates, gaps, clocks, work and entities of a log or "
        "bundle.",
    )
    parser.add_argument(
        "path", type=Path, metavar="LOG", help="log, bag folder, bundle folder or bundle.yaml"
    )
    parser.add_argument(
        "--rules", default="", metavar="NAME", help="show which checks of this rule set could be decided"
    )
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    add_partial(parser, "show the trial of a log that is cut off, as far as it goes")
    add_local_plugins(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Describe every part, then the trial as a whole."""
    style = style_for(sys.stdout)
    registry = registry_of(arguments)
    bundle, readers = find_trial(arguments.path, registry)
    damaged = False
    for part in bundle.parts:
        description = readers[part.reader].describe(part.path)
        print(style(plain(part.path.name), "bold") + f"  {description.format}, {part.role}")
        for line in _described(description):
            print(line)
        if description.damage:
            damaged = True
            print(style(f"  DAMAGED: {plain(description.damage)}", "red"))
    for name in bundle.ignored:
        print(style(f"not read: {plain(name)}", "dim"))
    if damaged and not arguments.partial:
        return EXIT_DAMAGED
    for line in _trial_lines(arguments, bundle, readers, registry):
        print(line)
    return EXIT_DAMAGED if damaged else 0


def _described(description: Any) -> list[str]:
    lines = [f"  {description.duration_s:.3f} s, {plain(description.clock)}"] if description.clock else []
    lines += [f"  {name}: {plain(str(value))}" for name, value in description.facts.items()]
    if description.topics:
        lines.append(f"  {'topic':<42} {'type':<36} {'count':>7} {'rate':>9} {'longest gap':>12}")
    for topic in description.topics:
        rate = f"{topic.rate_hz:.1f} Hz" if topic.rate_hz else "-"
        gap = f"{topic.largest_gap_s:.3f} s" if topic.largest_gap_s is not None else "-"
        lines.append(
            f"  {plain(topic.name):<42} {plain(topic.type):<36} {topic.count:>7} {rate:>9} {gap:>12}"
        )
    lines += [f"  defect: {plain(d.where)}: {plain(d.message)} ({d.count})" for d in description.defects]
    return lines


def _trial_lines(arguments: argparse.Namespace, bundle: Any, readers: Any, registry: Any) -> list[str]:
    """Work, entities, signals; with a rule set also which checks could be decided."""
    rule_set = load_rule_set(arguments.rules) if arguments.rules else None
    name = arguments.log_map or (rule_set.log_map if rule_set else "")
    if not name:
        return [
            "",
            "Give --rules (or --log-map) to see work, entities and which checks could be decided;",
            "'ariac-score map LOG' drafts a log map.",
        ]
    prepared = prepare(rule_set, log_map=arguments.log_map, registry=registry) if rule_set else None
    mapping = prepared.log_map if prepared else load_log_map(name)
    try:
        with progress_bar(arguments.path, quiet=is_quiet(arguments)) as progress:
            trial = read_trial(
                bundle,
                readers,
                mapping,
                registry,
                quantities=[*QUANTITIES, *mapping.quantities],
                progress=progress,
                partial=bool(arguments.partial),
                work=False,  # what moves is worth knowing of a log without work too
            )
    except NothingToScoreError as error:
        return ["", f"As a trial: {error.cause} — {error.hint}"]
    except LogError as error:
        return ["", f"As a trial: {error} — {error.hint}"]
    lines = ["", f"Under log map {mapping.id}"]
    if trial.cut is not None:
        lines.append(f"  unofficial: {plain(trial.cut.words)}")
    words = prepared.words if prepared else words_of(competition_of(mapping, registry))
    lines += [_item_line(item, words) for item in trial.work]
    if words.hands_in or trial.submissions:
        lines.append(f"  {plain(words.many(HANDED_IN))}: {len(trial.submissions)}")
    for body in trial.bodies:
        links = f", {counted(len(body.links), 'link')}" if body.links else ""
        lines.append(f"  {body.kind} {plain(body.id)}{links}")
    window = trial.window
    if window:
        lines.append(f"  {plain(words.period)} from {window.start_s:.3f} s to {window.end_s:.3f} s")
    lines.append(f"  signals: {', '.join(map(plain, trial.signals)) or 'none'}")
    if trial.as_consumed:
        lines.append(f"  as consumed: {', '.join(map(plain, trial.as_consumed))}")
    lines.append(f"  would record if they happened: {', '.join(sorted(trial.witnessed)) or 'nothing'}")
    lines += [f"  not recorded: {plain(item)}" for item in trial.unrecorded]
    slow = [defect for defect in trial.log_defects if defect.kind == "decoded_one_by_one"]
    lines += [f"  note: {plain(defect.where)}: {plain(defect.message)}" for defect in slow]
    if prepared and prepared.rule_set.about_work and not trial.work:
        found = no_work_found(bundle, trial, words, mapping)
        return [*lines, "", f"Under rule set {prepared.rule_set.id}: {found.cause}", f"  {plain(found.hint)}"]
    if prepared:
        trial = with_cut(trial, about_work=prepared.rule_set.about_work)
        lines += ["", f"Under rule set {prepared.rule_set.id}"]
        lines += [f"  {check:<20} {plain(answer)}" for check, answer in decidable(trial, prepared)]
    return lines


def _said(value: Fact) -> str:
    return "absent" if value is None else plain(value) if isinstance(value, str) else f"{value:g}"


def _item_line(item: WorkItem, words: Words) -> str:
    """An outermost item: its facts, when it was announced, what is inside."""
    t_s = announced_s(item)
    parts = [f"{plain(name)} {_said(value)}" for name, value in sorted(item.facts.items())]
    if t_s is not None:
        parts.append(f"announced {t_s:.3f} s")
    elif words.hands_in:
        parts.append("announced at an unknown time")
    inside = ", ".join(_inside(inner, words) for inner in item.items)
    if not inside and len(words.of_work) != 1:
        inside = "nothing inside"
    facts = "".join(f", {part}" for part in parts)
    return f"  {plain(words.one(item.level))} {plain(item.id)}{facts}{': ' if inside else ''}{inside}"


def _inside(item: WorkItem, words: Words) -> str:
    """An item inside another, in words."""
    more = [own] if (own := getattr(item, "words", "")) else []
    if item.items:
        level, count = item.items[0].level, len(item.items)
        more.append(f"{count} {words.one(level) if count == 1 else words.many(level)}")
    return plain(item.id) + (f" ({plain(', '.join(more))})" if more else "")
