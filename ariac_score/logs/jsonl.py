"""Our own trial log: JSON Lines, one record on each line, for any simulator and for tests.

The format is published as `schemas/trial_log.schema.json`. Samples, of which there
are many, are checked by hand here; every other record is held against the schema.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score.checks.contracts import LogDescription, ReaderFacts, RecordKind, TopicDescription, Wanted
from ariac_score.checks.registry import Registry
from ariac_score.documents.json_pairs import without_repeats
from ariac_score.documents.schema import schema_errors, value_errors
from ariac_score.errors import CutOffError, LogError, NothingToScoreError, did_you_mean
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.clock import Clock
from ariac_score.trial.cut import cut_at
from ariac_score.trial.events import Event, EventNumber
from ariac_score.trial.model import Body, TeamSetup, Trial
from ariac_score.trial.spans import Span
from ariac_score.trial.vocabulary import (
    ENVIRONMENT,
    OUR_QUANTITIES,
    QUANTITIES,
    Quantity,
    contradiction,
    quantity_of,
    subject_of,
    subject_shape,
)
from ariac_score.trial.work import Item, Submission

__all__ = ["FORMAT", "JsonLinesReader"]

_ANY_FORMAT = "ariac-score-trial-log/"
FORMAT = f"{_ANY_FORMAT}1"
MAX_DEPTH = 64
"""How deep a record may be nested."""
MAX_LINE_BYTES = 10_000_000
MAX_TIME_S = 1e11
"""Stamps further from 0 than this are not times of a trial."""
_LARGEST_INTEGER = 2**53
"""Larger integers are not exact in float64, nor in most JSON readers."""
_UNNAMED_CLOCK = Clock("as written in the log")

Record = dict[str, Any]

_KINDS = ("trial", "body", "item", "handed_in", "event", "sample", "end")
_GROUP = "ariac_score.record_kinds"


@dataclass
class _Columns:
    """Samples of each signal in recorded order."""

    t: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    values: dict[str, list[Any]] = field(default_factory=lambda: defaultdict(list))


class JsonLinesReader:
    """Reads `.jsonl` trial logs in the format of `schemas/trial_log.schema.json`.

    Reads:
        One record on each line: bodies, work, what was handed in, events, samples of any signal with
        its time in s of trial time, and the kinds of records that installed competitions bring.
    Refuses:
        A line that is no record, a value of a wrong kind, or a file that breaks off: its
        last record says how many there are. A repeated or disordered stamp is counted.
    Source:
        `schemas/trial_log.schema.json`, our own format.
    """

    facts = ReaderFacts(formats="JSON Lines trial logs")

    def can_read(self, path: Path) -> bool:
        """Whether the first line is the head of a trial log, or the file is an empty `.jsonl`."""
        if not path.is_file():
            return False
        try:
            with path.open("rb") as stream:
                head = stream.read(4096)
        except OSError:
            return False
        return _ANY_FORMAT.encode() in head or (not head and path.suffix == ".jsonl")

    def describe(self, path: Path) -> LogDescription:
        """Records and signals with counts, rates and gaps; of a damaged log those before the damage."""
        times: dict[str, list[float]] = defaultdict(list)
        clock = damage = ""
        try:
            for record in _records(path, _Kinds()):
                clock = record.get("clock", clock) if record["record"] == "trial" else clock
                for name in record["values"] if record["record"] == "sample" else [f"({record['record']})"]:
                    times[name].append(record.get("t_s") or 0.0)
        except LogError as error:
            damage = str(error)
        stamps = [t for name, column in times.items() if not name.startswith("(") for t in column]
        return LogDescription(
            format="JSON Lines trial log",
            topics=tuple(_topic(name, times[name]) for name in sorted(times)),
            clock=clock or str(_UNNAMED_CLOCK),
            damage=damage,
            duration_s=max(stamps) - min(stamps) if stamps else 0.0,
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The whole trial; unwanted signals are checked but not kept.

        Raises:
            LogError: Not JSON, breaks the schema, or cut off, with the line.
            NothingToScoreError: The file is empty.
        """
        builder = TrialBuilder(path.stem, file=path, clock=_UNNAMED_CLOCK)
        columns = _Columns()
        units: dict[str, str] = {}
        as_consumed: set[str] = set()
        size = max(path.stat().st_size, 1)
        low, high = math.inf, -math.inf
        kinds = _Kinds()
        back_s = 0.0
        cut: list[CutOffError] = []
        for done, record in enumerate(_records(path, kinds, cut if wanted.partial else None)):
            t_s = record.get("t_s")
            if t_s is not None and math.isfinite(t_s):
                low, high, back_s = min(low, t_s), max(high, t_s), max(back_s, high - t_s)
            if record["record"] == "sample":
                for name, value in record["values"].items():
                    if quantity_of(name) in wanted.quantities:
                        columns.t[name].append(record["t_s"])
                        columns.values[name].append(value)
            else:
                as_consumed |= set(record.get("as_consumed", ()))
                units |= {name: q["unit"] for name, q in record.get("quantities", {}).items()}
                try:
                    _take(builder, record, kinds, f"{path.name}, record {done + 1}")
                except ValueError as cause:  # JSON as Python reads it has numbers that are not finite
                    raise _fault(path, done + 1, str(cause), "give numbers that are finite") from None
            if done % 20_000 == 0:
                wanted.progress(min(0.95, done * 80 / size))  # a record has about 80 bytes
        for name in sorted(columns.t):
            _check_bodies(path, name, builder.bodies)
            unit = units.get(quantity_of(name)) or QUANTITIES[quantity_of(name)].unit
            add = builder.add_series if name in as_consumed else builder.add_signal
            add(name, unit, np.array(columns.t[name]), np.array(columns.values[name]))
        if low <= high:
            builder.recorded = Span(low, high)
        for error in cut:
            end_s = high if low <= high else None
            builder.cut = cut_at(error, path.name, end_s, largest_step_back_s=back_s)
        return replace(builder.build(), read_with=kinds.read)


def _check_bodies(path: Path, signal: str, bodies: Mapping[str, Body]) -> None:
    """Refuse a signal of a body that no record declares: no monitor would look at it."""
    for subject in subject_of(signal).split("/") if subject_of(signal) != ENVIRONMENT else ():
        body, _, link = subject.partition("::")
        if body not in bodies or (link and link not in bodies[body].links):
            raise LogError(
                f"signal {signal!r} speaks of {subject!r}, which no 'body' record declares",
                file=path,
                hint=did_you_mean(body, bodies, what="declared bodies"),
            )


def _topic(name: str, times: list[float]) -> TopicDescription:
    kind = name.strip("()") + " record" if name.startswith("(") else "samples"
    ordered = sorted(times)
    gap = max((b - a for a, b in pairwise(ordered)), default=None)
    return TopicDescription(name, kind, len(times), ordered[0], ordered[-1], gap)


def _records(path: Path, kinds: _Kinds, cut: list[CutOffError] | None = None) -> Iterator[Record]:
    """Every record, checked, in order.

    Args:
        path: The log.
        kinds: Of records that competitions bring.
        cut: Takes why the log ends before its end, where it does; `None`: that is an error.

    Raises:
        CutOffError: It ends before its end.
        LogError: With the line, for the first that is wrong, or when the end is missing.
    """
    number, last = 0, ""
    known = dict(OUR_QUANTITIES)
    try:
        with path.open("rb") as stream:
            # One byte beyond the limit shows that a line is too long, without reading all of it.
            while line := stream.readline(MAX_LINE_BYTES + 1):
                number += 1
                if not line.strip():
                    continue
                try:
                    record = _parsed(path, number, line, known, kinds)
                except CutOffError as error:
                    if cut is None or not last:
                        raise
                    cut.append(error)
                    return
                kind = record["record"]
                # Two logs written into one file would otherwise pass for one trial.
                if (kind == "trial") != (last == "") or last == "end":
                    raise _fault(
                        path,
                        number,
                        f"a {kind!r} record cannot stand here",
                        "first 'trial', last 'end'; one trial a file",
                    )
                if kind == "end" and record["records"] != number:
                    raise _fault(
                        path, number, f"the end says {record['records']} lines, there are {number}", _CUT
                    )
                last = kind
                known |= _declared(path, number, record.get("quantities", {}))
                yield record
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=path, hint="check the permissions"
        ) from cause
    if not number:
        raise NothingToScoreError("the file is empty", file=path, hint="was the recording started?")
    # A file that breaks off between two lines looks whole but for its last record.
    if last != "end":
        words = "the log is cut off: there is no 'end' record"
        no_end = CutOffError(words, file=path, place=f"line {number}", hint=_CUT)
        if cut is None:
            raise no_end
        cut.append(no_end)


def _is_deep(record: Record) -> bool:
    """Whether a record is nested deeper than anything that reads it could follow."""
    inside: list[Any] = [record]
    for _ in range(MAX_DEPTH):
        parts = (one.values() if isinstance(one, dict) else one for one in inside)
        inside = [each for part in parts for each in part if isinstance(each, dict | list)]
    return bool(inside)


def _declared(path: Path, number: int, quantities: Mapping[str, Any]) -> dict[str, Quantity]:
    """The quantities a log declares; those of the vocabulary cannot be changed."""
    declared = {
        name: Quantity(q["unit"], q.get("components", 1), q["of"], q.get("meaning", ""))
        for name, q in quantities.items()
    }
    for name, quantity in declared.items():
        if words := contradiction(name, quantity):
            raise _fault(path, number, words, "choose another name")
    return declared


_CUT = "record the trial again, or complete the log; a score must not rest on part of it"


def _fault(path: Path, number: int, cause: str, hint: str) -> LogError:
    return LogError(cause, file=path, place=f"line {number}", hint=hint)


def _parsed(path: Path, number: int, line: bytes, known: Mapping[str, Quantity], kinds: _Kinds) -> Record:
    if len(line) > MAX_LINE_BYTES:
        raise _fault(
            path, number, f"the line is longer than {MAX_LINE_BYTES:,} bytes", "one record on each line"
        )
    try:
        record = json.loads(line, object_pairs_hook=without_repeats)
    except (ValueError, RecursionError) as cause:
        # The message of `json` counts lines within this one.
        at = f"{cause.msg} at column {cause.colno}" if isinstance(cause, json.JSONDecodeError) else cause
        if not line.endswith(b"\n"):
            words = f"the log is cut off: not a JSON record: {at}"
            raise CutOffError(words, file=path, place=f"line {number}", hint=_CUT) from None
        raise _fault(path, number, f"not a JSON record: {at}", "one JSON object on each line") from None
    if not isinstance(record, dict):
        raise _fault(path, number, "not a JSON object", "one JSON object on each line")
    kind = record.get("record")
    # Not by the schema: samples are nearly all records, and a hand-written check is much faster.
    if kind == "sample":
        _check_sample(path, number, record, known)
        return record
    own = kind in _KINDS
    if not own and not (isinstance(kind, str) and kind in kinds):
        hint = did_you_mean(str(kind), [*_KINDS, *kinds], what="records")
        raise _fault(path, number, f"record {kind!r} is unknown", hint)
    written = record.get("format")
    if kind == "trial" and str(written).startswith(_ANY_FORMAT) and written != FORMAT:
        words = f"the log is in the format {written!r}; this version reads {FORMAT!r}"
        raise _fault(path, number, words, "install a version that reads it, or write the log anew")
    if _is_deep(record):
        words = f"it is nested more than {MAX_DEPTH} deep"
        raise _fault(path, number, words, "work has a few levels, one inside the other; see the schema")
    if _has_huge_integer(record):
        raise _fault(path, number, "a number is too large", "numbers are SI units of a trial; see the schema")
    faults = (
        schema_errors(record, "trial_log", f"{kind}_record")
        if own
        else value_errors(record, kinds[str(kind)].schema)
    )
    if faults:
        where, fault, hint = faults[0]
        place = f"line {number}" + (f", {'.'.join(map(str, where))}" if where else "")
        raise LogError(fault, file=path, place=place, hint=hint)
    if record.get("t_s") is not None and not abs(record["t_s"]) <= MAX_TIME_S:  # not `>`: NaN must be refused
        raise _fault(path, number, f"t_s is {record['t_s']!r}", "times are numbers, s of trial time")
    if (record.get("t_s") or 0) < 0:
        raise _fault(
            path,
            number,
            f"t_s is {record['t_s']!r}, before the trial",
            "trial time begins at 0; shift all times",
        )
    return record


def _has_huge_integer(value: object) -> bool:
    """Whether an integer somewhere in a record is beyond what float64 and JSON can carry."""
    if isinstance(value, dict):
        return any(map(_has_huge_integer, value.values()))
    if isinstance(value, list):
        return any(map(_has_huge_integer, value))
    return isinstance(value, int) and not -_LARGEST_INTEGER <= value <= _LARGEST_INTEGER


def _check_sample(path: Path, number: int, record: Record, known: Mapping[str, Quantity]) -> None:
    values = record.get("values")
    if set(record) != {"record", "t_s", "values"} or not isinstance(values, dict) or not values:
        raise _fault(
            path, number, "a sample has exactly 't_s' and 'values'", "see schemas/trial_log.schema.json"
        )
    if not _is_number(record["t_s"]) or abs(record["t_s"]) > MAX_TIME_S:
        raise _fault(path, number, f"t_s is {record['t_s']!r}", "times are numbers, s of trial time")
    for name, value in values.items():
        quantity = known.get(quantity_of(name)) or QUANTITIES.get(quantity_of(name))
        if quantity is None:
            hint = did_you_mean(quantity_of(name), [*known, *QUANTITIES], what="quantities")
            raise _fault(path, number, f"signal {name!r} measures nothing known", hint)
        subjects = subject_of(name).split("/")
        of_environment = quantity.of == ENVIRONMENT
        if (
            len(subjects) != (2 if quantity.of == "pair" else 1)
            or "" in subjects
            or of_environment != (subjects == [ENVIRONMENT])
        ):
            shape = f"quantity/{subject_shape(quantity)}"
            raise _fault(path, number, f"signal {name!r} is not named {shape}", "name the bodies it is about")
        components = value if isinstance(value, list) else [value]
        if len(components) != quantity.components or not all(map(_is_number, components)):
            raise _fault(path, number, f"{name!r} is {value!r}", f"give {quantity.components} number(s)")


def _is_number(value: object) -> bool:
    """Whether a value is a number that float64 can hold; NaN and infinities are, and become gaps."""
    if isinstance(value, int) and not isinstance(value, bool):
        return abs(value) <= _LARGEST_INTEGER
    return isinstance(value, float)


def _take(builder: TrialBuilder, record: Record, kinds: _Kinds, where: str) -> None:
    kind = record["record"]
    if kind == "trial":
        builder.trial_id = record["id"]
        if "clock" in record:
            builder.clock = Clock.parse(record["clock"]) if record["clock"] else None
        builder.witnessed |= set(record.get("witnessed", []))
        builder.facts |= record.get("facts", {})
        if record.get("team"):
            builder.team = TeamSetup(record["team"])
    elif kind == "body":
        links = tuple(record.get("links", []))
        radius_m = record.get("radius_m")
        radius_m = None if radius_m is None else float(radius_m)
        builder.add_body(Body(record["id"], record["kind"], radius_m, links))
    elif kind == "item":
        t_s = record.get("t_s")
        builder.add(replace(_item(record), announced_s=None if t_s is None else float(t_s)))
    elif kind == "handed_in":
        builder.add(Submission(record["item_id"], float(record["t_s"])))
    elif kind == "event":
        numbers = tuple(
            EventNumber(name, float(given["value"]), given["unit"])
            for name, given in record.get("numbers", {}).items()
        )
        subject, detail = record.get("subject", ""), record.get("detail", "")
        builder.add(Event(record["t_s"], record["kind"], subject, detail, numbers))
    elif kind in kinds:
        builder.add(kinds[kind].read(record, partial(_left_out, builder, where)))


def _left_out(builder: TrialBuilder, where: str, cause: str) -> None:
    builder.defect("unusable_pose", where, 1, f"a pose is left out: {cause}")


def _item(data: Record) -> Item:
    return Item(data["id"], data["level"], data.get("facts", {}), tuple(map(_item, data.get("items", []))))


class _Kinds(Mapping[str, RecordKind]):
    """The kinds of records that installed competitions bring, each looked up when a log has one."""

    def __init__(self) -> None:
        self._registry: Registry | None = None
        self._built: dict[str, RecordKind] = {}

    @property
    def read(self) -> frozenset[tuple[str, str]]:
        """Those that the log has, as group and name."""
        return frozenset((_GROUP, kind) for kind in self._built)

    @property
    def _names(self) -> tuple[str, ...]:
        # Only now: a log without such records needs no look at what is installed.
        self._registry = self._registry or Registry()
        return tuple(self._registry.names(_GROUP))

    def __getitem__(self, kind: str) -> RecordKind:
        if kind not in self._built:
            if kind not in self._names or self._registry is None:
                raise KeyError(kind)
            self._built[kind] = self._registry.find(_GROUP, kind).build({})
        return self._built[kind]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)
