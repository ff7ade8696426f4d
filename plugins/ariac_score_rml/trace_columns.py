"""Traces of which each line is an event, as columns: a specification then runs over arrays of numbers.

Lines that differ only in numbers have one layout, and most traces have few layouts. Anything
less regular is left to the interpreter and to `read_events`, which also reports where a trace
is broken.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import repeat
from typing import Any, BinaryIO

import msgspec
import numpy as np

from ariac_score_rml.automaton import Watch, watch_columns
from ariac_score_rml.columns import Columns, FloatArray, NotColumnarError, Stream, Topic
from ariac_score_rml.machine import Letter, Machine
from ariac_score_rml.running import Run

__all__ = ["run_lines"]

_BLOCK_BYTES = 1 << 20
"""How much of a trace is held as text and as events at a time."""

_MAX_LAYOUTS = 16
"""Event types are evaluated for each layout; with very many of them the interpreter is as quick."""

_MAX_INT = 2**53
"""Integers beyond are not all floats, and columns are computed with floats."""


class _NotAlikeError(Exception):
    """These lines have to be read one by one."""


@dataclass(frozen=True)
class _Lines(Topic):
    """Events of one layout; `t` is which line of the trace each is.

    Attributes:
        event: The fields of every event, numbers in columns.
    """

    event: Mapping[str, Any]

    def record(self) -> dict[str, Any]:
        return dict(self.event)


@dataclass(frozen=True)
class _Group:
    """The events of one layout.

    Attributes:
        lines: Which events of the trace they are, for each block of the trace.
        parts: Their fields as columns, likewise.
    """

    lines: list[FloatArray] = field(default_factory=list)
    parts: list[dict[str, Any]] = field(default_factory=list)

    def topic(self) -> _Lines:
        """The events as columns."""
        return _Lines("", np.concatenate(self.lines), {}, _joined(self.parts))


def run_lines(machine: Machine, file: BinaryIO) -> Run | None:
    """Run a specification over a trace of which each line is an event.

    Args:
        machine: The specification.
        file: The trace, from its beginning.

    Returns:
        What `run_trace` finds in it; `None` when that has to be done event by event.
    """
    try:
        stream = Stream([group.topic() for group in _groups(file)])
        columns = Columns(machine.matcher, stream)
        watch = watch_columns(machine, stream, "once", columns)
    except (_NotAlikeError, NotColumnarError):
        return None
    if watch.error is not None or columns.close:
        return None  # the interpreter names the event, and counts
    return Run(watch.initial, _letters(machine, watch))


def _groups(file: BinaryIO) -> Iterable[_Group]:
    """The events of a trace by their layouts.

    Raises:
        _NotAlikeError: Not every line is certain to be read as `read_events` reads it, or there
            are too many layouts.
    """
    groups: dict[Hashable, _Group] = {}
    decoder, count = msgspec.json.Decoder(), 0
    while text := file.read(_BLOCK_BYTES) + file.readline():  # to the end of a line
        try:
            events = decoder.decode_lines(text)
        except (msgspec.MsgspecError, ValueError, RecursionError):
            raise _NotAlikeError from None
        if not set(map(type, events)) <= {dict}:
            raise _NotAlikeError
        colons, found = 0, _places(_layouts(events))
        if len(groups.keys() | found.keys()) > _MAX_LAYOUTS:
            raise _NotAlikeError
        for layout, places in found.items():
            records = [events[i] for i in places]
            group = groups.setdefault(layout, _Group())
            group.lines.append(np.array(places, dtype=np.float64) + count)
            group.parts.append(_columns(records))
            colons += len(records) * _colons(records[0])
        # Of a repeated key the decoder silently keeps the last; `read_events` refuses it. The number of
        # colons shows it, unless one is written as \\u003a.
        if colons != text.count(b":") or b"\\u003" in text:
            raise _NotAlikeError
        count += len(events)
    return groups.values()


def _layouts(records: Sequence[Mapping[str, Any]]) -> list[Hashable]:
    """The layout of each record: its keys and values, of numbers and lists the type alone.

    Field by field, not record by record, which would take as long as reading the trace.
    """
    found: list[Hashable] = list(map(tuple, records))
    for keys, places in _places(found).items():
        labels = [_labels([records[i][key] for i in places]) for key in keys]  # type: ignore[attr-defined]
        for place, layout in zip(places, zip(repeat(keys), *labels, strict=False), strict=False):
            found[place] = layout
    return found


def _labels(values: Sequence[Any]) -> Sequence[Hashable]:
    """The part of the layout that each value of one field makes."""
    kinds = set(map(type, values))
    if kinds <= _NUMBERS_AND_LISTS:
        return list(map(type, values))
    if kinds == {dict}:
        return _layouts(values)
    return [_labels([value])[0] if type(value) in _OPEN else value for value in values]


_NUMBERS_AND_LISTS = {float, int, list}
_OPEN = _NUMBERS_AND_LISTS | {dict}


def _places(labels: Sequence[Hashable]) -> Mapping[Hashable, Sequence[int]]:
    """The positions of each label."""
    if len(set(labels)) == 1:
        return {labels[0]: range(len(labels))}
    found: dict[Hashable, list[int]] = {}
    for place, label in enumerate(labels):
        found.setdefault(label, []).append(place)
    return found


def _columns(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The fields of records of one layout, those that are numbers as columns.

    Raises:
        _NotAlikeError: An integer is too large for a column.
    """
    found: dict[str, Any] = {}
    for key, example in records[0].items():
        values = [record[key] for record in records] if type(example) in _DIFFER else []
        if type(example) is dict:
            found[key] = _columns(values)
        elif type(example) is int and max(map(abs, values)) >= _MAX_INT:
            raise _NotAlikeError
        else:
            found[key] = np.array(values) if values else example
    return found


_DIFFER = (float, int, dict)
"""Types of values that differ between events of one layout, themselves or in their parts."""


def _colons(record: Mapping[str, Any]) -> int:
    """How many colons the text of a record has."""
    count = 0
    for key, value in record.items():
        count += 1 + key.count(":")
        if isinstance(value, str | dict):
            count += value.count(":") if isinstance(value, str) else _colons(value)
    return count


def _joined(parts: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The columns of blocks one after the other."""
    found: dict[str, Any] = {}
    for key, value in parts[0].items():
        here = [part[key] for part in parts] if isinstance(value, dict | np.ndarray) else []
        found[key] = _joined(here) if isinstance(value, dict) else np.concatenate(here) if here else value
    return found


def _letters(machine: Machine, watch: Watch) -> str:
    """The letter after each event: that of the state before the next one."""
    letters: list[Letter] = [machine.letter(state) for state in watch.states]
    judged = int(np.count_nonzero(watch.before >= 0))  # all of them up to a rejection
    before = watch.before[:judged]
    if not judged:
        return ""
    table = np.frombuffer("".join(letters).encode(), dtype=np.uint8)
    return table[before[1:]].tobytes().decode() + watch.end
