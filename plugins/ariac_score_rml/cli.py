"""`ariac-score rml check|format|run`: check, format and run RML specifications."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ariac_score import LogError, UsageError, plain, write_output
from ariac_score_rml import running
from ariac_score_rml.formatter import format_rml
from ariac_score_rml.guards import TOLERANCE
from ariac_score_rml.machine import MAX_STATE, Machine
from ariac_score_rml.parser import parse
from ariac_score_rml.running import Program, Run, compile_rml
from ariac_score_rml.traces import read_events

EXIT_REJECTED = 1
EXIT_UNDECIDED = 6

_SUFFIXES = {".bag": "bag", ".db3": "bag", ".mcap": "mcap"}


def register(commands: Any) -> None:
    """Add the command and its actions."""
    parser = commands.add_parser("rml", description="Check, format and run RML specifications.")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="parse a specification and report what is wrong with it")
    check.add_argument("specs", type=Path, metavar="SPEC", nargs="+")
    check.set_defaults(run=run_check)
    layout = actions.add_parser("format", help="print a specification in its one form")
    layout.add_argument("spec", type=Path, metavar="SPEC")
    layout.add_argument(
        "--check", action="store_true", help="print nothing; exit code 1 when it would change"
    )
    layout.add_argument("-o", "--output", type=Path, metavar="FILE", help="write to FILE, which may be SPEC")
    layout.set_defaults(run=run_format)
    run = actions.add_parser(
        "run",
        help="run a specification over a trace",
        description="Letters: T everything may follow, t the trace may end here, f it may not, F rejected, "
        "E cannot be judged. Exit codes: 0 accepted, 1 rejected, 6 cannot be judged.",
    )
    run.add_argument("spec", type=Path, metavar="SPEC")
    run.add_argument("trace", type=Path, metavar="TRACE")
    run.add_argument(
        "--events",
        choices=("jsonl", "bag", "mcap"),
        help="what TRACE is; default: by its suffix. Of a recording every message is an event: its "
        "fields, `topic` without leading slash, and `time` since the first message in s",
    )
    run.add_argument("--exact", action="store_true", help="compare numbers in guards without tolerance")
    run.add_argument(
        "--max-state", type=_positive, metavar="N", help="how many parts a state may have; default: 100000"
    )
    run.add_argument("--output-format", choices=("text", "json"), default="text", help="default: text")
    run.set_defaults(run=run_trace)
    for action in (check, layout, run):
        action.add_argument(
            "--dialect",
            choices=("2024", "rosmonitoring"),
            default="2024",
            help="rosmonitoring: patterns as arguments and names min, max, as its own specifications have",
        )


def _positive(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) <= 10**9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 to 10^9")
    return int(text)


_LARGEST_BYTES = 1 << 28


def _text(path: Path, kind: str) -> str:
    error = UsageError if kind == "specification" else LogError
    try:
        if path.exists() and not path.is_file():  # a pipe would be waited for, a device may have no end
            raise error(f"the {kind} is no plain file", file=path, hint="check the path")
        if path.is_file() and path.stat().st_size > _LARGEST_BYTES:
            words = f"the {kind} has more than {_LARGEST_BYTES:,} bytes"
            raise error(words, file=path, hint="is it the right file?")
        return path.read_text(encoding="utf-8")
    except OSError as cause:
        reason = cause.strerror or type(cause).__name__
        raise error(f"the {kind} cannot be read: {reason}", file=path, hint="check the path") from cause
    except UnicodeDecodeError as cause:
        raise error(
            f"the {kind} is not UTF-8 text", file=path, place=f"byte {cause.start}", hint="save it as UTF-8"
        ) from cause


def _compiled(path: Path, dialect: Any) -> Program:
    program = compile_rml(_text(path, "specification"), dialect=dialect, file=path)
    for warning in program.warnings:
        print(f"warning: {plain(f'{path}: {warning}')}", file=sys.stderr)
    return program


def run_check(arguments: argparse.Namespace) -> int:
    """Check each specification; the first that is refused ends it."""
    for path in arguments.specs:
        program = _compiled(path, arguments.dialect)
        types = len({d.type.name for d in program.spec.declarations})
        remark = f", {len(program.warnings)} warnings" if program.warnings else ""
        print(f"{path}: sound, {types} event types, {len(program.spec.equations)} equations{remark}")
    return 0


def run_format(arguments: argparse.Namespace) -> int:
    """Print the specification as the formatter writes it, or compare."""
    before = _text(arguments.spec, "specification")
    after = format_rml(parse(before, dialect=arguments.dialect, file=arguments.spec))
    if arguments.check:
        if before != after:
            print(f"{arguments.spec} would change", file=sys.stderr)
        return EXIT_REJECTED if before != after else 0
    write_output(after, arguments.output)
    return 0


def run_trace(arguments: argparse.Namespace) -> int:
    """Print the letters of a trace and its verdict."""
    program = _compiled(arguments.spec, arguments.dialect)
    kind = arguments.events or _SUFFIXES.get(
        arguments.trace.suffix, "bag" if arguments.trace.is_dir() else "jsonl"
    )
    tolerance = 0.0 if arguments.exact else TOLERANCE
    machine = program.machine(tolerance=tolerance, max_state=arguments.max_state or MAX_STATE)
    if kind == "jsonl":
        run = _over_text(machine, arguments.trace)
    else:
        run = running.run_trace(machine, _recorded(arguments.trace, kind))
    _show(run, arguments.output_format)
    if run.accepted is None:
        return EXIT_UNDECIDED
    return 0 if run.accepted else EXIT_REJECTED


def _over_text(machine: Machine, path: Path) -> Run:
    """Run over a trace of JSON: over columns where its lines allow that."""
    from ariac_score_rml.trace_columns import run_lines  # noqa: PLC0415  # loads numpy; check and format do without

    try:
        with path.open("rb") as file:
            run = run_lines(machine, file)
    except OSError:
        run = None  # reading it as text reports why
    return run or running.run_trace(machine, read_events(_text(path, "trace"), file=path))


def _show(run: Run, output_format: str) -> None:
    at = len(run.letters)
    if output_format == "json":
        facts: dict[str, Any] = {"initial": run.initial, "letters": run.letters, "accepted": run.accepted}
        if run.end == "F":
            facts["rejected_at"] = at
        if run.error is not None:
            facts["error"] = {"at": at, "kind": run.error.kind, "cause": run.error.cause}
        print(json.dumps(facts, ensure_ascii=False))
    else:
        print(f"initial  {run.initial}\nletters  {run.letters}\nverdict  {_verdict(run, at)}")
    if run.error is not None:
        place = f"event {at}" if at else "before any event"
        print(f"error: {plain(f'{place}: {run.error}')}", file=sys.stderr)
        print(f"hint: {plain(run.error.hint or 'the verdict is unknown')}", file=sys.stderr)
    if run.close:
        print(
            f"note: {run.close} comparisons hang on the tolerance of 1e-10; --exact compares without it",
            file=sys.stderr,
        )


def _verdict(run: Run, at: int) -> str:
    if run.end == "E":
        return "cannot be judged"
    if run.end == "F":
        return f"rejected at event {at}"
    return "accepted" if run.accepted else "rejected: the trace ends too early"


def _recorded(path: Path, kind: str) -> Iterator[dict[str, Any]]:
    """Every message of a recording as an event, in recorded order."""
    from ariac_score import read_messages  # noqa: PLC0415  # loads all that reads recordings

    first_ns = None
    for message in read_messages(path, kind="mcap" if kind == "mcap" else "bag"):
        first_ns = message.stamp_ns if first_ns is None else first_ns
        time_s = (message.stamp_ns - first_ns) / 1e9
        yield {**message.fields, "topic": message.topic.lstrip("/"), "time": time_s}
