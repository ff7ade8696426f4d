"""Decoding the messages of one connection into columns.

Three ways, the fastest first: copying from known layouts, walking many messages together, and rosbags,
message by message. The last one also decides on every message that the others reject, so that a message
is refused for the cause that rosbags gives, and never because of a fault of the fast ways.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from keyword import iskeyword
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError

from ariac_score.logs.columnar.columns import UNDECODABLE, Column, Columns, Defect, ranges
from ariac_score.logs.columnar.plan import DecodePlan, Definitions, Field, Stream, compile_plan
from ariac_score.logs.columnar.walk_many import Interned, walk
from ariac_score.logs.columnar.walk_one import Layout, MisfitError, lay_out
from ariac_score.logs.containers.items import Bytes, IntArray, Payloads

__all__ = ["ColumnDecoder", "Room"]

_BLOCK_BYTES = 1 << 20
"""Messages are copied in blocks that stay in the processor's cache."""

_WIDTHS = (8, 4, 2, 1)
"""Sizes of the words that are compared, bytes."""

_MOST_LAYOUTS = 64
"""Layouts that are kept for later calls."""

_NEW_LAYOUTS = 8
"""Layouts that one call may learn, and one more for every 256 messages: on a topic whose messages all differ,
learning would never pay. The remaining messages are walked together."""

_FEW = 12
"""Fewer messages than this are cheaper to walk one by one than together."""

_FAILURES: tuple[type[Exception], ...] = (SerdeError, *UNDECODABLE)
_Deserialise = Callable[[bytes], object]

Room = Callable[[str, np.dtype[Any], int], NDArray[Any]]
"""Given the path of a field, the type of its next values and their number, returns room for them."""


@dataclass
class _Part:
    """The values of some of the messages: for each stream their number in each message, and the values."""

    rows: IntArray
    counts: dict[int, IntArray | int]
    values: dict[int, NDArray[Any]]


class _Pattern:
    """The bytes that decide a layout and their offsets in a message.

    Each stretch is covered by words as long as possible, of which the last may overlap the one
    before: comparing words of 8 bytes is about as fast as comparing single bytes.
    """

    def __init__(self, deciding: Sequence[tuple[int, int]], message: bytes) -> None:
        self._size = len(message)
        places: dict[int, list[int]] = {}
        for start, end in deciding:
            width = next(w for w in _WIDTHS if w <= end - start)
            places.setdefault(width, []).extend([*range(start, end - width, width), end - width])
        self._words: list[tuple[int, IntArray, NDArray[Any]]] = []
        for width, starts in places.items():
            held = b"".join(message[start : start + width] for start in starts)
            expected = np.frombuffer(held, dtype=f"u{width}")[:, np.newaxis]
            self._words.append((width, np.array(starts, dtype=np.int64), expected))

    def found_in(self, block: Bytes) -> NDArray[np.bool_] | None:
        """Which messages of a block, shape (n, size), agree; `None` when all do."""
        agree: NDArray[np.bool_] | None = None
        for width, starts, expected in self._words:
            shape, strides = (self._size - width + 1, len(block)), (1, self._size)
            windows: NDArray[Any] = np.ndarray(shape, f"V{width}", block.data, strides=strides)
            same = windows[starts].view(f"u{width}") == expected
            if not same.all():
                agree = same.all(axis=0) if agree is None else agree & same.all(axis=0)
        return agree


class _LayoutMatcher:
    """A layout prepared for being compared with many messages and for copying their values."""

    def __init__(self, layout: Layout, message: bytes, plan: DecodePlan, interned: Interned) -> None:
        self.size, self.big = len(message), layout.big
        self._pattern: _Pattern | None = None
        self._deciding, self._message = layout.deciding, message
        self._streams = [s for s in plan.streams if s.kind not in ("string", "length")]
        self._texts = {s.number: s.path for s in plan.streams if s.kind == "string"}
        self._runs = {n: list(_even_runs(places)) for n, places in layout.offsets.items()}
        self._per_message = {n: len(places) for n, places in layout.offsets.items()}
        self._constant = dict(layout.counts)
        for number, texts in layout.texts.items():
            self._constant[number] = np.array([interned[t.encode()] for t in texts], dtype=np.int32)

    def fits(self, block: Bytes) -> NDArray[np.bool_] | None:
        """Which messages of a block, shape (n, size), have this layout; `None` when all have."""
        if self._pattern is None:
            self._pattern = _Pattern(self._deciding, self._message)
        return self._pattern.found_in(block)

    def empty(self, count: int, room: Room | None = None) -> dict[int, NDArray[Any]]:
        """Arrays for the numbers of some messages."""
        found = {}
        for stream in self._streams:
            each = self._per_message[stream.number]
            if room is None:
                found[stream.number] = np.empty((count, each), stream.dtype)
            else:
                found[stream.number] = room(stream.path, stream.dtype, count * each).reshape(count, each)
        return found

    def copy(self, block: Bytes, into: dict[int, NDArray[Any]], first: int) -> None:
        """Copy the numbers of a block of messages, shape (n, size)."""
        for stream in self._streams:
            # Any byte but 0 is true, as in rosbags.
            raw = (
                np.dtype(np.uint8)
                if stream.kind == "bool"
                else stream.dtype.newbyteorder(">" if self.big else "<")
            )
            out = into[stream.number][first : first + len(block)]
            for column, start, step, count in self._runs[stream.number]:
                view: NDArray[Any] = np.ndarray(
                    (len(block), count), raw, block.data, offset=start, strides=(self.size, step)
                )
                out[:, column : column + count] = view != 0 if stream.kind == "bool" else view

    def part(self, rows: IntArray, numbers: dict[int, NDArray[Any]], room: Room | None = None) -> _Part:
        """The values of messages with this layout, given their numbers."""
        counts: dict[int, IntArray | int] = dict(self._per_message)
        values: dict[int, NDArray[Any]] = {n: found.reshape(-1) for n, found in numbers.items()}
        for number, constant in self._constant.items():
            counts[number] = len(constant)
            if room is None or number not in self._texts:
                values[number] = np.tile(constant, len(rows))
            else:
                values[number] = room(self._texts[number], constant.dtype, len(rows) * len(constant))
                values[number].reshape(len(rows), len(constant))[:] = constant
        return _Part(rows, counts, values)


def _even_runs(places: IntArray) -> Iterator[tuple[int, int, int, int]]:
    """Places split into runs of even steps: index of the first, its place, step, length.

    The values of a sequence of poses, for example, are one strided view of the whole block.
    """
    steps, first = np.diff(places).tolist(), 0
    while first < len(places):
        step = steps[first] if first < len(steps) else 0
        last = first
        while last < len(steps) and steps[last] == step:
            last += 1
        yield first, int(places[first]), step, last - first + 1
        first = last + 1


class ColumnDecoder:
    """Decodes the messages of one type and one way of packing, slab by slab.

    Every value equals, to the bit, what `rosbags` deserialises. Most messages of a topic
    are laid out alike: one is walked, and all that agree with it in the bytes that decide
    the layout are copied from at its offsets. Messages that agree with none are walked
    together, each with its own cursor. What a plan cannot express is deserialised message
    by message.

    Args:
        store: Knows the type; `longest_sequence` of it is respected.
        type_: `package/msg/Name`.
        cdr: Whether messages are CDR; otherwise as ROS 1 packs them.
        wanted: Dotted paths of fields, or of messages of which everything is wanted;
            `None`: everything.
    """

    def __init__(
        self, store: Definitions, type_: str, *, cdr: bool, wanted: Iterable[str] | None = None
    ) -> None:
        self._store, self._type, self._cdr = store, type_, cdr
        self._interned = Interned()  # shared by all layouts, so that codes of texts agree
        self._layouts: dict[int, list[_LayoutMatcher]] = {}
        self._remembered = 0
        self.fallback = ""
        paths = None if wanted is None else tuple(wanted)
        self._plan = compile_plan(store, type_, cdr=cdr, wanted=paths)

    @property
    def paths(self) -> tuple[str, ...]:
        """The fields it gives, in the order of the definition."""
        return tuple(s.path for s in self._plan.streams if s.kind != "length")

    def shape(self, path: str) -> tuple[str, tuple[str, ...]] | None:
        """The base type of a field and the arrays and sequences around it; `None` when there is none."""
        streams = self._plan.streams
        for stream in streams:
            if stream.path == path and stream.kind != "length":
                return stream.kind, tuple(streams[level].path for level in stream.levels)
        return None

    def decode(self, payloads: Payloads, room: Room | None = None) -> Columns:
        """The wanted fields of some messages; messages that do not fit are named.

        Args:
            payloads: At most so many that their columns fit into memory.
            room: Gives room for the values of a field, which then need no copying; called at most once for
                each field, and not for fields whose values are put together from parts.
        """
        parts, suspects = self._parts(payloads, room)
        defects, cause = self._named(payloads, suspects)
        if cause:
            return self._one_by_one(payloads, cause)
        return self._columns(parts, len(payloads), defects)

    def _parts(self, payloads: Payloads, room: Room | None) -> tuple[list[_Part], list[int]]:
        """The decoded parts, and the messages that do not fit the plan."""
        suspects: list[int] = []
        parts: list[_Part] = []
        left: list[IntArray] = []
        sizes = payloads.ends - payloads.starts
        budget = _NEW_LAYOUTS + len(sizes) // 256
        for size, of_size in _by_size(sizes):
            rows = of_size
            for layout in self._layouts.get(size, ()):
                # Only where all messages may share one layout: several parts are merged, which copies them.
                part, rows = self._copied(layout, payloads, rows, room if len(rows) == len(sizes) else None)
                room = None
                parts += [part] if part else []
            while len(rows) >= _FEW and budget > 0:
                budget -= 1
                found = self._learnt(payloads, rows)
                if found is None:
                    suspects.append(int(rows[0]))
                    rows = rows[1:]
                    continue
                part, rows = self._copied(found, payloads, rows)
                assert part is not None
                parts.append(part)
                if len(part.rows) >= _FEW:  # a layout of one message would only cost comparisons later
                    self._remember(found)
            left.append(rows)
        rest = np.sort(np.concatenate(left)) if left else np.zeros(0, dtype=np.int64)
        if len(rest):
            walked, misfits = self._walked(payloads, rest)
            parts += walked
            suspects += misfits
        return parts, sorted(suspects)

    def _learnt(self, payloads: Payloads, rows: IntArray) -> _LayoutMatcher | None:
        """The layout of the first of some messages; `None` when it does not fit."""
        message = payloads.one(int(rows[0]))
        try:
            return _LayoutMatcher(lay_out(self._plan, message), message, self._plan, self._interned)
        except MisfitError:
            return None

    def _remember(self, layout: _LayoutMatcher) -> None:
        if self._remembered >= _MOST_LAYOUTS:
            self._layouts.clear()
            self._remembered = 0
        self._layouts.setdefault(layout.size, []).append(layout)
        self._remembered += 1

    def _copied(
        self, layout: _LayoutMatcher, payloads: Payloads, rows: IntArray, room: Room | None = None
    ) -> tuple[_Part | None, IntArray]:
        """The values of the messages that have a layout, and the indices of the others."""
        size = layout.size
        if not size or not len(rows):
            return (layout.part(rows, layout.empty(len(rows))) if len(rows) else None), rows[:0]
        step = max(1, _BLOCK_BYTES // size)
        numbers = layout.empty(len(rows), room)
        # A window of the message's size at every byte of the buffer: one indexing gathers a whole block.
        windows = np.ndarray((len(payloads.buffer) - size + 1,), f"V{size}", payloads.buffer, strides=(1,))
        taken: list[IntArray] = []
        others: list[IntArray] = []
        done = 0
        for first in range(0, len(rows), step):
            some = rows[first : first + step]
            block = windows[payloads.starts[some]].view(np.uint8).reshape(len(some), size)
            fits = layout.fits(block)
            if fits is not None:
                others.append(some[~fits])
                some, block = some[fits], block[fits]
            if len(some):
                layout.copy(block, numbers, done)
                done += len(some)
                taken.append(some)
        rest = np.concatenate(others) if others else rows[:0]
        if not done:
            return None, rest
        if done < len(rows):
            numbers = {number: found[:done] for number, found in numbers.items()}
        return layout.part(np.concatenate(taken), numbers, room if done == len(rows) else None), rest

    def _walked(self, payloads: Payloads, rows: IntArray) -> tuple[list[_Part], list[int]]:
        """Messages without a common layout: a few one by one, many together."""
        if len(rows) < _FEW:
            return self._alone(payloads, rows)
        parts: list[_Part] = []
        suspects: list[int] = []
        for big, some in self._by_order(payloads, rows, suspects):
            chosen = Payloads(payloads.buffer, payloads.starts[some], payloads.ends[some])
            walked = walk(self._plan, chosen, self._interned, big=big)
            sound = walked.sound
            counts: dict[int, IntArray | int] = {n: c[sound] for n, c in walked.counts.items()}
            parts.append(_Part(some[sound], counts, walked.values))
            alone, misfits = self._alone(payloads, some[walked.lonely])
            parts += alone
            suspects += [*misfits, *some[~sound & ~walked.lonely].tolist()]
        return parts, suspects

    def _by_order(
        self, payloads: Payloads, rows: IntArray, suspects: list[int]
    ) -> Iterator[tuple[bool, IntArray]]:
        """The messages of each byte order; messages without a valid encapsulation are suspects."""
        if not self._plan.cdr:
            yield False, rows
            return
        long = payloads.ends[rows] - payloads.starts[rows] >= 4
        suspects += rows[~long].tolist()
        rows = rows[long]
        first, second = (payloads.buffer[payloads.starts[rows] + i] for i in (0, 1))
        # 0 0: CDR big-endian, 0 1: little-endian; others are parameter lists or XCDR2.
        plain = (first == 0) & (second <= 1)
        suspects += rows[~plain].tolist()
        for big in (False, True):
            some = rows[plain & (second == (0 if big else 1))]
            if len(some):
                yield big, some

    def _alone(self, payloads: Payloads, rows: IntArray) -> tuple[list[_Part], list[int]]:
        parts: list[_Part] = []
        suspects: list[int] = []
        for row in rows.tolist():
            message = payloads.one(row)
            try:
                layout = lay_out(self._plan, message)
            except MisfitError:
                suspects.append(row)
                continue
            known = _LayoutMatcher(layout, message, self._plan, self._interned)
            numbers = known.empty(1)
            known.copy(np.frombuffer(message, dtype=np.uint8).reshape(1, -1), numbers, 0)
            parts.append(known.part(np.array([row], dtype=np.int64), numbers))
        return parts, suspects

    def _deserialise(self) -> _Deserialise:
        store, type_ = self._store, self._type
        if self._cdr:
            return lambda message: store.deserialize_cdr(message, type_)
        return lambda message: store.deserialize_ros1(message, type_)

    def _named(self, payloads: Payloads, suspects: list[int]) -> tuple[tuple[Defect, ...], str]:
        """The defects of messages that do not fit, in the words of rosbags.

        Where rosbags accepts one, the second value says so: rosbags then decodes all of them.
        """
        defects: list[Defect] = []
        deserialise = self._deserialise()
        for index in suspects:
            try:
                deserialise(payloads.one(index))
            except _FAILURES as error:
                defects.append(Defect(index, str(error) or type(error).__name__))
            else:
                # The plan is wrong about one message, so it is not trusted with any.
                return (), f"message {index} does not fit the plan, and rosbags reads it"
        return tuple(defects), ""

    def _columns(self, parts: list[_Part], count: int, defects: tuple[Defect, ...]) -> Columns:
        bad = np.zeros(count, dtype=bool)
        bad[[defect.index for defect in defects]] = True
        rows = np.flatnonzero(~bad).astype(np.int64)
        merged = {s.number: _merged(s, parts, count) for s in self._plan.streams}
        return Columns(rows, dict(self._finished(merged)), defects)

    def _finished(self, merged: dict[int, NDArray[Any]]) -> Iterator[tuple[str, Column]]:
        texts = tuple(self._interned.texts)
        offsets: dict[int, IntArray] = {}
        for stream in self._plan.streams:
            if stream.kind == "length":
                offsets[stream.number] = np.concatenate(([0], np.cumsum(merged[stream.number])))
        for stream in self._plan.streams:
            if stream.kind != "length":
                yield (
                    stream.path,
                    Column(
                        stream.path,
                        merged[stream.number],
                        tuple(offsets[level] for level in stream.levels),
                        texts if stream.kind == "string" else None,
                        tuple(self._plan.streams[level].path for level in stream.levels),
                    ),
                )

    def _one_by_one(self, payloads: Payloads, cause: str) -> Columns:
        """All messages as rosbags deserialises them."""
        self.fallback = cause
        deserialise = self._deserialise()
        defects: list[Defect] = []
        rows: list[int] = []
        found: dict[int, list[Any]] = {s.number: [] for s in self._plan.streams}
        for index in range(len(payloads)):
            try:
                message = deserialise(payloads.one(index))
            except _FAILURES as error:
                defects.append(Defect(index, str(error) or type(error).__name__))
                continue
            rows.append(index)
            for field in self._plan.fields:
                self._read(message, field, found)
        merged = {
            s.number: np.array(
                [self._interned[t.encode()] for t in found[s.number]]
                if s.kind == "string"
                else found[s.number],
                dtype=s.dtype,
            )
            for s in self._plan.streams
        }
        columns = dict(self._finished(merged))
        return Columns(np.array(rows, dtype=np.int64), columns, tuple(defects), cause)

    def _read(self, message: object, field: Field, found: dict[int, list[Any]]) -> None:
        name = f"{field.name}_" if iskeyword(field.name) else field.name
        value: Any = attrgetter(name)(message)
        items = value if field.repeated else (value,)
        if field.lengths is not None:
            found[field.lengths].append(len(items))
        if field.values is not None:
            found[field.values].extend(items)
        for item in items if field.inner else ():
            for inner in field.inner:
                self._read(item, inner, found)


def _by_size(sizes: IntArray) -> Iterator[tuple[int, IntArray]]:
    """The messages of each size, in their order."""
    if not len(sizes):
        return
    if (sizes == sizes[0]).all():  # most topics, which then need no sorting
        yield int(sizes[0]), np.arange(len(sizes), dtype=np.int64)
        return
    order = np.argsort(sizes, kind="stable")
    bounds = np.flatnonzero(np.diff(sizes[order])) + 1
    for rows in np.split(order, bounds):
        yield int(sizes[rows[0]]), rows


def _merged(stream: Stream, parts: list[_Part], count: int) -> NDArray[Any]:
    """The values of a stream from all parts, in the order of the messages."""
    number = stream.number
    if not parts:
        return np.zeros(0, dtype=stream.dtype)
    if len(parts) == 1:
        return parts[0].values[number].astype(stream.dtype, copy=False)
    totals = np.zeros(count, dtype=np.int64)
    for part in parts:
        totals[part.rows] = part.counts[number]
    starts = np.cumsum(totals) - totals
    out = np.empty(int(totals.sum()), dtype=stream.dtype)
    for part in parts:
        counts = part.counts[number]
        if isinstance(counts, int):
            counts = np.full(len(part.rows), counts, dtype=np.int64)
        out[ranges(starts[part.rows], counts)] = part.values[number]
    return out
