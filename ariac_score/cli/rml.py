"""`ariac-score rml check|format|run`: specifications in RML, the Runtime Monitoring Language."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ariac_score.logs.containers.items import Message, Scan
    from ariac_score_rml.machine import Machine
    from ariac_score_rml.running import Program, Run

EXIT_REJECTED = 1
EXIT_UNDECIDED = 6

_SUFFIXES = {".bag": "bag", ".db3": "bag", ".mcap": "mcap"}


def register(commands: Any) -> None:
    """Add the command and its actions."""
    parser = commands.add_parser("rml", help="check, format and run RML specifications")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="parse a specification and say what is wrong with it")
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
        help="what TRACE is; by default its suffix tells. Of a recording every message is an event: its "
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


def _text(path: Path, kind: str) -> str:
    from ariac_score.errors import LogError, UsageError  # noqa: PLC0415  # keeps --help quick

    error = UsageError if kind == "specification" else LogError
    try:
        return path.read_text(encoding="utf-8")
    except OSError as cause:
        reason = cause.strerror or type(cause).__name__
        raise error(f"the {kind} cannot be read: {reason}", file=path, hint="check the path") from cause
    except UnicodeDecodeError as cause:
        raise error(
            f"the {kind} is not UTF-8 text", file=path, place=f"byte {cause.start}", hint="save it as UTF-8"
        ) from cause


def _compiled(path: Path, dialect: Any) -> Program:
    from ariac_score.terminal.style import plain  # noqa: PLC0415  # keeps --help quick
    from ariac_score_rml.running import compile_rml  # noqa: PLC0415

    program = compile_rml(_text(path, "specification"), dialect=dialect, file=path)
    for warning in program.warnings:
        print(f"warning: {plain(f'{path}: {warning}')}", file=sys.stderr)
    return program


def run_check(arguments: argparse.Namespace) -> int:
    """Say of each specification that it is sound; the first that is not ends it."""
    for path in arguments.specs:
        program = _compiled(path, arguments.dialect)
        types = len({d.type.name for d in program.spec.declarations})
        remark = f", {len(program.warnings)} warnings" if program.warnings else ""
        print(f"{path}: sound, {types} event types, {len(program.spec.equations)} equations{remark}")
    return 0


def run_format(arguments: argparse.Namespace) -> int:
    """Print the specification as the formatter writes it, or compare."""
    from ariac_score.terminal.output import write  # noqa: PLC0415  # keeps --help quick
    from ariac_score_rml.formatter import format_rml  # noqa: PLC0415
    from ariac_score_rml.parser import parse  # noqa: PLC0415

    before = _text(arguments.spec, "specification")
    after = format_rml(parse(before, dialect=arguments.dialect, file=arguments.spec))
    if arguments.check:
        if before != after:
            print(f"{arguments.spec} would change", file=sys.stderr)
        return EXIT_REJECTED if before != after else 0
    write(after, arguments.output)
    return 0


def run_trace(arguments: argparse.Namespace) -> int:
    """Print the letters of a trace and how it came out."""
    from ariac_score_rml import running  # noqa: PLC0415  # keeps --help quick
    from ariac_score_rml.guards import TOLERANCE  # noqa: PLC0415
    from ariac_score_rml.machine import MAX_STATE  # noqa: PLC0415

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
    from ariac_score_rml.lines import run_lines  # noqa: PLC0415  # keeps --help quick
    from ariac_score_rml.running import run_trace  # noqa: PLC0415
    from ariac_score_rml.traces import read_events  # noqa: PLC0415

    try:
        with path.open("rb") as file:
            run = run_lines(machine, file)
    except OSError:
        run = None  # the other way says why
    return run or run_trace(machine, read_events(_text(path, "trace"), file=path))


def _show(run: Run, output_format: str) -> None:
    from ariac_score.terminal.style import plain  # noqa: PLC0415  # keeps --help quick

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


# Recordings ------------------------------------------------------------------------------


def _recorded(path: Path, kind: str) -> Iterator[dict[str, Any]]:
    """Every message of a recording as an event, in recorded order.

    Raises:
        LogError: The recording is damaged, or a message cannot be decoded.
    """
    from ariac_score.errors import LogError  # noqa: PLC0415  # keeps --help quick
    from ariac_score.logs.columnar.types import UnknownTypeError, decoder_for  # noqa: PLC0415

    decoders: dict[str, Any] = {}
    first_ns = None
    try:
        for item in _messages(_scan(path, kind)):
            connection = item.connection
            if connection.topic not in decoders:
                decoders[connection.topic] = decoder_for(connection)
            first_ns = item.stamp_ns if first_ns is None else first_ns
            message = decoders[connection.topic](item.payload)
            time_s = (item.stamp_ns - first_ns) / 1e9
            yield {**_plain(message), "topic": connection.topic.lstrip("/"), "time": time_s}
    except UnknownTypeError as error:
        raise LogError(
            f"a message on {connection.topic!r} cannot be decoded: {error}",
            file=path,
            hint="record it with its message definitions",
        ) from error
    except OSError as error:
        raise LogError(f"it cannot be read: {error.strerror}", file=path, hint="check the path") from error


def _messages(scan: Scan) -> Iterator[Message]:
    """The messages of a scan one by one, however many of them it gives at a time."""
    from ariac_score.logs.containers.items import Batch, Message  # noqa: PLC0415  # keeps --help quick

    for item in scan:
        if isinstance(item, Message):
            yield item
        elif isinstance(item, Batch):
            yield from item.messages()


def _scan(path: Path, kind: str) -> Scan:
    from ariac_score.logs.containers.folder import FolderScan  # noqa: PLC0415  # keeps --help quick
    from ariac_score.logs.containers.mcap import McapScan  # noqa: PLC0415
    from ariac_score.logs.containers.ros1 import Ros1Scan  # noqa: PLC0415
    from ariac_score.logs.containers.sqlite import SqliteScan  # noqa: PLC0415

    if path.is_dir():
        return FolderScan(path)
    if kind == "mcap":
        return McapScan(path)
    return SqliteScan(path) if path.suffix == ".db3" else Ros1Scan(path)


def _plain(message: Any) -> Any:
    """A decoded message as JSON values; constants of the type are left out."""
    fields = getattr(message, "__dataclass_fields__", None)
    if fields is not None:
        return {name: _plain(getattr(message, name)) for name in fields if name != "__msgtype__"}
    if hasattr(message, "tolist"):
        return message.tolist()
    if isinstance(message, list | tuple):
        return [_plain(item) for item in message]
    return message
