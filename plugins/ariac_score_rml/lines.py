"""Traces whose lines are alike, as columns: what differs between them is read for all of them at once.

A line is one event. Lines that differ in nothing but numbers have one layout, and most
traces have a few. Whatever is not as plain as that is left to the reader that takes value
after value, and to the interpreter.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from ariac_score_rml.automaton import Watch, watch_columns
from ariac_score_rml.columns import Columns, NotColumnarError, Stream, Topic
from ariac_score_rml.digits import PADDING, Numbers, Text
from ariac_score_rml.machine import Letter, Machine
from ariac_score_rml.running import Run

__all__ = ["run_lines"]

_BLOCK_BYTES = 1 << 21
"""Intermediate results of a block stay in the cache."""

_LONGEST_LINE_BYTES = 10_000_000
_MAX_LAYOUTS = 16
_MAX_WHOLE = 2**53
"""Whole numbers beyond are not all floats."""

_NUMBER = re.compile(rb"-?(?:0|[1-9]\d*)(\.\d+)?([eE][+-]?\d+)?")
_STRING_OR_NUMBER = re.compile(rb'"(?:[^"\\]|\\.)*(?:"|\\?\Z)|(' + _NUMBER.pattern + rb")", re.DOTALL)

_Places = NDArray[np.intp]


class _NotAlikeError(Exception):
    """These lines have to be read one by one."""


@dataclass(frozen=True)
class _Number:
    """Stands in an event for the number that differs from line to line."""

    index: int


@dataclass(frozen=True)
class _Layout:
    """Lines that differ in nothing but numbers.

    Attributes:
        texts: What stands before, between and after the numbers.
        whole: Which numbers have neither point nor exponent.
        event: The event, with `_Number` for each number.
    """

    texts: tuple[bytes, ...]
    whole: tuple[bool, ...]
    event: Mapping[str, Any]

    @classmethod
    def of(cls, line: bytes) -> _Layout:
        """The layout of one line.

        Raises:
            _NotAlikeError: It is not exactly one object of strict JSON.
        """
        texts, whole, last = [], [], 0
        for found in _STRING_OR_NUMBER.finditer(line):
            if found.group(1) is not None:
                texts.append(line[last : found.start()])
                whole.append(found.group(2) is None and found.group(3) is None)
                last = found.end()
        count = iter(range(len(whole)))

        def number(_: str) -> _Number:
            return _Number(next(count))

        decoder = json.JSONDecoder(
            object_pairs_hook=_record, parse_float=number, parse_int=number, parse_constant=_refused
        )
        try:
            event = decoder.decode(line.decode("utf-8"))
        except (ValueError, RecursionError, StopIteration):
            raise _NotAlikeError from None
        if not isinstance(event, dict) or next(count, None) is not None:
            raise _NotAlikeError
        return cls((*texts, line[last:]), tuple(whole), event)

    def read(self, text: Text, starts: _Places, ends: _Places) -> tuple[_Places, list[NDArray[np.float64]]]:
        """Which of some lines have this layout, and the numbers in them."""
        lines, at, values = np.arange(len(starts)), starts, list[NDArray[np.float64]]()
        for before, whole in zip(self.texts[:-1], self.whole, strict=True):
            alike = text.has(at, before)
            lines, at, values = _only(alike, lines, at, values)
            numbers = _read(text, at + len(before))
            values.append(numbers.values)
            alike = (numbers.whole == whole) & ~numbers.odd
            lines, at, values = _only(alike, lines, numbers.end, values)
        alike = text.has(at, self.texts[-1]) & (at + len(self.texts[-1]) == ends[lines])
        lines, at, values = _only(alike, lines, at, values)
        return lines, values


def _only(
    alike: NDArray[np.bool_], lines: _Places, at: _Places, values: list[NDArray[np.float64]]
) -> tuple[_Places, _Places, list[NDArray[np.float64]]]:
    if alike.all():
        return lines, at, values
    return lines[alike], at[alike], [column[alike] for column in values]


def _read(text: Text, begin: _Places) -> Numbers:
    """The numbers at some places, what is odd about them settled; what is no number stays odd."""
    numbers = Numbers.at(text, begin)
    for i in np.flatnonzero(numbers.odd).tolist():
        found = _NUMBER.match(text.padded, int(begin[i]))
        if found is None:
            continue
        whole = found.group(1) is None and found.group(2) is None
        value = float(found.group())
        if abs(value) >= (_MAX_WHOLE if whole else np.inf):
            raise _NotAlikeError
        numbers.values[i] = value + 0.0 if whole else value  # the whole number -0 is 0
        numbers.whole[i], numbers.end[i], numbers.odd[i] = whole, found.end(), False
    return numbers


def _record(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    record = dict(pairs)
    if len(record) < len(pairs):
        raise ValueError
    return record


def _refused(_: str) -> Any:
    raise ValueError


@dataclass(frozen=True)
class _Lines(Topic):
    """Events of one layout; `t` is which line of the trace each is.

    Attributes:
        event: The fields every event of it has, numbers in columns.
    """

    event: Mapping[str, Any]

    def record(self) -> dict[str, Any]:
        return dict(self.event)


def _texts(file: BinaryIO) -> Iterator[Text]:
    """Whole lines, about as many bytes at a time as a block may have."""
    size = _BLOCK_BYTES
    buffer = bytearray(_room(size))
    begun = 0  # bytes of a line that the block before left
    while True:
        with memoryview(buffer) as room:
            read = file.readinto(room[begun:size])  # type: ignore[attr-defined]  # every file of bytes has it
        filled = begun + read
        cut = filled if not read else buffer.rfind(b"\n", 0, filled) + 1
        if cut:
            buffer[filled : filled + PADDING] = bytes(PADDING)
            yield Text(buffer, cut)
        if not read:
            return
        begun = filled - cut
        rest = bytes(buffer[cut:filled])
        if begun == size:
            size *= 2
        if size > _LONGEST_LINE_BYTES:
            raise _NotAlikeError
        buffer = bytearray(_room(size)) if len(buffer) < _room(size) else buffer
        buffer[:begun] = rest


def _room(size: int) -> int:
    return size + PADDING + -size % 8


def _topics(file: BinaryIO) -> list[_Lines]:
    """The lines of a trace by their layouts.

    Raises:
        _NotAlikeError: A line is no object of strict JSON, or there are too many layouts.
    """
    layouts: list[_Layout] = []
    found: list[list[tuple[_Places, list[NDArray[np.float64]]]]] = []
    count = 0
    for text in _texts(file):
        breaks = np.flatnonzero(text.bytes[: text.length] == ord("\n"))
        starts, ends = np.append(0, breaks + 1), np.append(breaks, text.length)
        filled = ends > starts
        starts, ends = starts[filled], ends[filled]
        rest = np.arange(len(starts))
        for layout, taken in zip(layouts, found, strict=True):
            rest = _take(layout, taken, text, (starts, ends), rest, count)
        while len(rest):
            if len(layouts) == _MAX_LAYOUTS:
                raise _NotAlikeError
            layouts.append(_Layout.of(bytes(text.padded[starts[rest[0]] : ends[rest[0]]])))
            found.append([])
            left = _take(layouts[-1], found[-1], text, (starts, ends), rest, count)
            if len(left) == len(rest):
                raise _NotAlikeError  # not even the line it was made from
            rest = left
        count += len(starts)
    return [_joined(layout, taken) for layout, taken in zip(layouts, found, strict=True)]


def _take(
    layout: _Layout,
    taken: list[tuple[_Places, list[NDArray[np.float64]]]],
    text: Text,
    bounds: tuple[_Places, _Places],
    rest: _Places,
    first: int,
) -> _Places:
    """Keep what has a layout; returns which lines have not."""
    if not len(rest):
        return rest
    lines, values = layout.read(text, bounds[0][rest], bounds[1][rest])
    taken.append((rest[lines] + first, values))
    left = np.ones(len(rest), dtype=bool)
    left[lines] = False
    return rest[left]


def _joined(layout: _Layout, taken: list[tuple[_Places, list[NDArray[np.float64]]]]) -> _Lines:
    t = np.concatenate([lines for lines, _ in taken]).astype(np.float64)
    columns = [
        np.concatenate([values[i] for _, values in taken]).astype(np.int64 if whole else np.float64)
        for i, whole in enumerate(layout.whole)
    ]

    def filled(value: Any) -> Any:
        if isinstance(value, _Number):
            return columns[value.index]
        if isinstance(value, dict):
            return {key: filled(inner) for key, inner in value.items()}
        return [filled(inner) for inner in value] if isinstance(value, list) else value

    return _Lines("", t, {}, filled(layout.event))


def run_lines(machine: Machine, file: BinaryIO) -> Run | None:
    """Run a specification over a trace of which each line is an event.

    Args:
        machine: The specification.
        file: The trace, from its beginning.

    Returns:
        What `run_trace` finds in it; `None` when that has to be done event by event.
    """
    try:
        stream = Stream(_topics(file))
        columns = Columns(machine.matcher, stream)
        watch = watch_columns(machine, stream, "once", columns)
    except (_NotAlikeError, NotColumnarError):
        return None
    if watch.error is not None or columns.close:
        return None  # the interpreter names the event, and counts
    return Run(watch.initial, _letters(machine, watch))


def _letters(machine: Machine, watch: Watch) -> str:
    """The letter after each event: that of the state before the next one."""
    letters: list[Letter] = [machine.letter(state) for state in watch.states]
    judged = int(np.count_nonzero(watch.before >= 0))  # all of them up to a rejection
    before = watch.before[:judged]
    if not judged:
        return ""
    table = np.frombuffer("".join(letters).encode(), dtype=np.uint8)
    return table[before[1:]].tobytes().decode() + watch.end
