"""`ariac-score rules list|show|validate|diff|check|prove`: rule sets, their differences, their laws."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ariac_score.checks.registry import Registry
from ariac_score.cli.actions import add_action
from ariac_score.cli.changed_scores import changed_by_logs, changed_by_results
from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import counted
from ariac_score.cli.prove import add_prove
from ariac_score.engine.prepared import prepare
from ariac_score.engine.read import plugins_of_log_map
from ariac_score.errors import ScoreError, UsageError
from ariac_score.ranking.evaluation import evaluation_program
from ariac_score.ranking.spec import ranking_spec
from ariac_score.report.html.rulebook import rulebook_page
from ariac_score.report.rulebook import rulebook_markdown, rulebook_text
from ariac_score.review.proofs.proving import DEFAULT_CASES, REFUTED, prove
from ariac_score.review.proofs.solver import find_solver
from ariac_score.review.proofs.subject import subject_of
from ariac_score.review.proofs.words import judged_lines
from ariac_score.review.rulebook.book import rulebook
from ariac_score.scoring.extending import GROUP as RULE_SETS
from ariac_score.scoring.extending import path_of_rule_set
from ariac_score.scoring.penalties import penalty_names
from ariac_score.scoring.ruleset import differences, expanded_yaml, load_rule_set, rule_set_names
from ariac_score.terminal.output import refuse_inputs, write
from ariac_score.terminal.style import plain, style_for


def register(commands: Any) -> None:
    """Add the command and its actions."""
    parser = commands.add_parser("rules", description="List, show, validate, compare and test rule sets.")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = add_action(actions, "list", "list the installed rule sets")
    listing.set_defaults(run=run_list)
    show = add_action(actions, "show", "show the text of a rule set")
    show.add_argument("name", metavar="NAME")
    form = show.add_mutually_exclusive_group()
    form.add_argument("--expanded", action="store_true", help="merge in everything it extends")
    form.add_argument(
        "--as", choices=["rulebook"], dest="form", help="a rulebook for referees, made from the rule set"
    )
    show.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="OUT",
        help="where a rulebook goes: a page (.html) or Markdown (.md)",
    )
    add_local_plugins(show)
    show.set_defaults(run=run_show)
    diff = add_action(actions, "diff", "show the differences between two rule sets")
    diff.add_argument("first", metavar="A", help="rule set: a name or a .yaml file")
    diff.add_argument("second", metavar="B", help="likewise")
    whose = diff.add_mutually_exclusive_group()
    whose.add_argument(
        "--results",
        type=Path,
        metavar="RESULT|DIR",
        help="a stored result, or a folder of them: show whose score and rank would change",
    )
    whose.add_argument(
        "--logs",
        type=Path,
        metavar="PATH",
        help="a log, a folder of logs or a competition: show the same, scored under both",
    )
    diff.set_defaults(run=run_diff)
    validate = add_action(actions, "validate", "check a rule set and the plugins it names")
    validate.add_argument("names", metavar="NAME", nargs="+", help="names or .yaml files")
    add_local_plugins(validate)
    validate.set_defaults(run=run_validate)
    check = actions.add_parser(
        "check",
        help="prove or try laws, such as that violations never help, of many rule sets",
        description="Prove fourteen laws; try what is not proven on random findings, and print the smallest "
        "counter-example found. Exit code 1 when one does not hold that the rule set does not declare itself "
        "under 'breaks', with --strict also one that it declares; else 0.",
    )
    check.add_argument(
        "names",
        metavar="NAME",
        nargs="*",
        help="rule sets, .yaml files, or penalties; default: all that are installed",
    )
    check.add_argument(
        "--cases", type=_count, default=None, metavar="N", help="random cases for each law (default: 400)"
    )
    check.add_argument("--seed", type=int, default=0, metavar="S", help="the same seed tries the same cases")
    check.add_argument("--strict", action="store_true", help="what does not hold counts though declared")
    add_local_plugins(check)
    check.set_defaults(run=run_check)
    add_prove(actions)


def _count(text: str) -> int:
    """A number of cases."""
    count = int(text)
    if not 1 <= count <= 1_000_000:
        raise argparse.ArgumentTypeError("give a number from 1 to 1000000")
    return count


def run_list(_arguments: argparse.Namespace) -> int:
    """Print name and title of each installed rule set, and who brings it where that is not us."""
    registry = Registry()
    for file in registry.files(RULE_SETS):
        plugin = file.plugin
        whose = "" if plugin.distribution == "ariac-score" else f" ({plugin.distribution} {plugin.version})"
        try:
            about = load_rule_set(file.name, registry).title
        except ScoreError as error:
            about = f"CANNOT BE USED: {error.cause}"
        print(plain(f"{file.name:<30} {about}{whose}"))
    return 0


def run_show(arguments: argparse.Namespace) -> int:
    """Print the text of the rule set, comments included; or merged with what it extends."""
    if arguments.form == "rulebook":
        return _show_rulebook(arguments)
    if arguments.output is not None:
        raise UsageError("-o is for rulebooks", hint="add --as rulebook, or redirect what is printed")
    rule_set = load_rule_set(arguments.name)
    text = expanded_yaml(rule_set) if arguments.expanded else Path(rule_set.file).read_text(encoding="utf-8")
    sys.stdout.write(text)
    return 0


def _show_rulebook(arguments: argparse.Namespace) -> int:
    """Print the rulebook, or write it as a page or as Markdown."""
    forms = {".html": rulebook_page, ".htm": rulebook_page, ".md": rulebook_markdown}
    output: Path | None = arguments.output
    registry = registry_of(arguments)
    if output is None or str(output) == "-":
        write(rulebook_text(rulebook(arguments.name, registry), style_for(sys.stdout)), output)
        return 0
    if output.suffix not in forms:
        raise UsageError("a rulebook is a page or Markdown", file=output, hint="name a file .html or .md")
    refuse_inputs(output, path_of_rule_set(arguments.name, Path(), registry))
    write(forms[output.suffix](rulebook(arguments.name, registry)), output)
    return 0


def run_diff(arguments: argparse.Namespace) -> int:
    """Print each place that differs, with what only one of the two has; nothing when they are equal."""
    first, second = load_rule_set(arguments.first), load_rule_set(arguments.second)
    for place, before, after in differences(first.expanded, second.expanded):
        print(place)
        for sign, value, other in (("-", before, after), ("+", after, before)):
            for line in _only_here(value, other):
                print(f"  {sign} {line}")
    changed: Iterator[str] = iter(())
    if arguments.results is not None:
        changed = changed_by_results(arguments.results, (first, second))
    if arguments.logs is not None:
        changed = changed_by_logs(arguments.logs, (first, second))
    for line in changed:
        print(line)
    return 0


def _only_here(value: Any, other: Any) -> Iterator[str]:
    """What a value has and the other has not, as YAML: of two lists the items."""
    if isinstance(value, list) and isinstance(other, list):
        here = [item for item in value if item not in other]
        alike = not here and all(item in value for item in other)  # except for their order or number
        yield from map(_in_yaml, [value] if alike else here)
    elif value is not None:
        yield _in_yaml(value)


def _in_yaml(value: Any) -> str:
    """A value in one line, text without quotes."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def run_validate(arguments: argparse.Namespace) -> int:
    """Load each rule set with everything that it names: checks, log map, how it ranks."""
    registry = registry_of(arguments)
    for name in arguments.names:
        prepared = prepare(name, registry=registry)
        prepared.refuse_unknown_quantities()
        plugins_of_log_map(prepared.log_map, registry)
        ranking = ranking_spec(prepared.rule_set, {}, file=prepared.rule_set.file)
        if ranking.strict:
            evaluation_program(ranking.strict, registry)
        rule_set = prepared.rule_set
        unpriced = sorted(set(rule_set.checks) - rule_set.sheet.priced)
        remark = f"; not priced: {', '.join(unpriced)}" if unpriced else ""
        print(f"{rule_set.id}: sound, {counted(len(rule_set.checks), 'check')}{remark}")
    return 0


def run_check(arguments: argparse.Namespace) -> int:
    """Prove the laws of each rule set, or try them where they are not proven."""
    registry, broken, solver = registry_of(arguments), False, find_solver()
    for name in arguments.names or [*rule_set_names(registry), *penalty_names()]:
        subject = subject_of(name, registry)
        judged = prove(subject, cases=arguments.cases or DEFAULT_CASES, seed=arguments.seed, solver=solver)
        rule_set = subject.rule_set
        print(f"{name} on a made competition" if subject.is_penalty else rule_set.id)
        for one in judged:
            for line in judged_lines(one, rule_set.sheet.levels):
                print(f"  {line}")
        sys.stdout.flush()
        refuted = [one for one in judged if one.verdict == REFUTED]
        broken |= any(arguments.strict or not one.declared for one in refuted)
        surprises = [one.law.says for one in refuted if not one.declared]
        if surprises and not subject.is_penalty:
            print(f"  its file does not say under 'breaks' that it breaks: {'; '.join(surprises)}")
    return 1 if broken else 0
