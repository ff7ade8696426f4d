"""`ariac-score map LOG`: draft a log map from a recording, check it, and show what comes of it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ariac_score.checks.registry import Registry
from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import is_quiet
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.read import MOTION_RULES, find_trial, read_trial
from ariac_score.errors import LogError, UsageError
from ariac_score.logs.logmap import load_log_map
from ariac_score.review.log_maps.draft import NONE, Draft, Given, Question, draft_log_map, open_words
from ariac_score.review.log_maps.shown import bodies_shown
from ariac_score.terminal.output import write
from ariac_score.terminal.style import plain, style_for
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import Trial
from ariac_score.trial.vocabulary import QUANTITIES

EXIT_UNDECIDED = 6


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "map",
        description="Draft a log map: who is the robot, who the human, what says the orders. On a terminal "
        "it asks; elsewhere it takes what something speaks for, and leaves open what is equal: exit code 6.",
    )
    parser.add_argument(
        "path", type=Path, metavar="LOG", help="log, bag folder, bundle folder or bundle.yaml"
    )
    parser.add_argument("--rules", default="", metavar="NAME", help="rule set whose log map it extends")
    for role in ("human", "robot"):
        parser.add_argument(
            f"--{role}",
            action="append",
            default=[],
            metavar="NAME",
            help=f"frame, model or topic of a {role}; repeatable; '{NONE}': there is none",
        )
    parser.add_argument(
        "--extends", default="", metavar="NAME", help=f"installed log map to extend; '{NONE}': none"
    )
    parser.add_argument(
        "--root-frame", default="", metavar="FRAME", help="frame that positions are wanted in"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write to FILE instead of stdout")
    add_local_plugins(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Draft, write, read the recording by the draft, and show what comes of it."""
    output: Path | None = arguments.output
    if output is not None and output.exists():
        raise UsageError("there is such a file already", file=output, hint="name another one with -o FILE")
    registry = registry_of(arguments)
    rules = prepare(arguments.rules, registry=registry) if arguments.rules else None
    bundle, readers = find_trial(arguments.path, registry)
    for part in bundle.parts:
        if damage := readers[part.reader].describe(part.path).damage:
            raise LogError(damage, hint="a log map is drafted from a recording that is whole")
    given = Given(
        tuple(arguments.human), tuple(arguments.robot), arguments.extends, arguments.root_frame, rules
    )
    folder = output.parent if output is not None else Path()
    ask = _asked if _on_terminal(arguments) else _nobody
    draft = draft_log_map(bundle, readers, registry, given, ask=ask, folder=folder)
    log_map = _loaded(draft, registry)
    write(draft.text, output)
    quantities = [*QUANTITIES, *log_map.quantities]
    trial = read_trial(bundle, readers, log_map, registry, quantities=quantities, work=False)
    if not is_quiet(arguments):
        out = sys.stdout if output is not None else sys.stderr
        for line in _lines(arguments, draft, log_map, trial, registry, rules):
            print(line, file=out)
    style = style_for(sys.stderr)
    for line in open_words(draft.open):
        print(f"{style('open:', 'bold', 'yellow')} {plain(line)}", file=sys.stderr)
    return EXIT_UNDECIDED if draft.open else 0


def _loaded(draft: Draft, registry: Registry) -> LogMap:
    """The log map of a draft, checked as every log map is."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "draft.yaml"
        file.write_text(draft.anywhere, encoding="utf-8")
        return load_log_map(file, registry=registry)


def _lines(
    arguments: argparse.Namespace,
    draft: Draft,
    log_map: LogMap,
    trial: Trial,
    registry: Registry,
    rules: Prepared | None,
) -> Iterator[str]:
    style = style_for(sys.stdout)
    for line in draft.decided:
        yield f"{style('decided', 'bold')} {plain(line)}"
    yield ""
    yield style(f"What it makes of {plain(arguments.path.name)}", "bold")
    for line in bodies_shown(trial, log_map, registry):
        yield f"  {plain(line)}"
    if draft.open:
        return
    name = rules.rule_set.id if rules is not None else "NAME"
    if not trial.work and (rules is None or rules.rule_set.about_work):
        name = MOTION_RULES
        yield f"  nothing was to be done in it: --rules {MOTION_RULES} judges what moves alone"
    file = arguments.output or "FILE"
    yield ""
    yield f"next: ariac-score check {plain(str(arguments.path))} --rules {name} --log-map {plain(str(file))}"


def _on_terminal(arguments: argparse.Namespace) -> bool:
    return not is_quiet(arguments) and sys.stdin.isatty() and sys.stderr.isatty()


def _nobody(_question: Question) -> tuple[str, ...] | None:
    """The answer where nobody can be asked."""
    return None


def _asked(question: Question) -> tuple[str, ...] | None:
    """Ask on the terminal until the answer is one that can be."""
    names = [*question.choices]
    print(f"\n{question.words}", file=sys.stderr)
    for number, (name, words) in enumerate(question.choices.items(), start=1):
        mark = "*" if name in question.likely else " "
        print(f" {mark}{number:>3}  {plain(words if name in words else f'{name}: {words}')}", file=sys.stderr)
    several = ", several with commas" if question.several else ""
    default = f", Enter for {', '.join(question.likely)}" if question.likely else ", Enter leaves it open"
    while True:
        print(plain(f"number{several}, 0 for none{default}: "), end="", file=sys.stderr, flush=True)
        answer = sys.stdin.readline()
        if not answer.strip():
            return None
        picked = _picked(answer, names, several=question.several)
        if picked is not None:
            return picked
        print(f"a number from 0 to {len(names)} is wanted", file=sys.stderr)


def _picked(answer: str, names: list[str], *, several: bool) -> tuple[str, ...] | None:
    """The names that an answer means; `None` where it means none.

    >>> _picked("2, 1", ["a", "b"], several=True), _picked("0", ["a"], several=False)
    (('b', 'a'), ('none',))
    >>> _picked("3", ["a"], several=False)
    """
    parts = [part.strip() for part in answer.split(",")]
    if parts == ["0"]:
        return (NONE,)
    if not all(part.isascii() and part.isdigit() and 0 < int(part) <= len(names) for part in parts):
        return None
    return tuple(names[int(part) - 1] for part in parts) if several or len(parts) == 1 else None
