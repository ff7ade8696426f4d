"""Walking many messages together: each has a cursor, and all advance step by step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score.logs.columnar.columns import ranges
from ariac_score.logs.columnar.plan import Block, DecodePlan, Repeat, Step, Text
from ariac_score.logs.containers.items import Bytes, IntArray, Payloads

__all__ = ["Interned", "Walked", "gathered", "typed", "walk"]

_LONGEST_LOOP = 2048
"""A message with more elements of variable size is walked on its own: here every element costs a pass over
all messages that have so many."""


@dataclass
class Walked:
    """The outcome of a walk.

    Attributes:
        sound: Whether each message fits its definition, shape (n,).
        lonely: Whether it must be walked on its own, shape (n,); such a message is not sound.
        counts: For each stream, how many values each message has, shape (n,).
        values: For each stream its values, message after message; texts as codes.
    """

    sound: NDArray[np.bool_]
    lonely: NDArray[np.bool_]
    counts: dict[int, IntArray]
    values: dict[int, NDArray[Any]]


class Interned(dict[bytes, int]):
    """Codes of texts by their bytes; bytes that are not UTF-8 have code -1."""

    def __init__(self) -> None:
        super().__init__()
        self.texts: list[str] = []

    def __missing__(self, raw: bytes) -> int:
        try:
            text = raw.decode()
        except UnicodeDecodeError:
            code = -1
        else:
            code = len(self.texts)
            self.texts.append(text)
        self[raw] = code
        return code


def gathered(buffer: Bytes, places: IntArray, dtype: np.dtype[Any], *, big: bool) -> NDArray[Any]:
    """The numbers at some places of a buffer, aligned or not."""
    size = dtype.itemsize
    if not len(places):
        return np.zeros(0, dtype=dtype)
    if size == 1:
        found: NDArray[Any] = buffer[places]
    else:
        # Overlapping windows of raw bytes, one at every place of the buffer, gathered by one indexing.
        windows = np.ndarray((len(buffer) - size + 1,), f"V{size}", buffer.data, strides=(1,))
        found = windows[places]
    return typed(found, dtype, big=big)


def typed(raw: NDArray[Any], dtype: np.dtype[Any], *, big: bool) -> NDArray[Any]:
    """Contiguous bytes as numbers of this machine."""
    if dtype == np.bool_:
        truths: NDArray[Any] = raw.view(np.uint8) != 0
        return truths
    stored = dtype.newbyteorder(">" if big else "<")
    return raw.view(stored).astype(dtype.newbyteorder("="), copy=False)


def walk(plan: DecodePlan, payloads: Payloads, interned: Interned, *, big: bool) -> Walked:
    """Walk messages of one byte order.

    Args:
        plan: Of their type.
        payloads: The messages; that of CDR have a valid encapsulation.
        interned: The codes of texts; new texts are added.
        big: Whether their numbers are big-endian.
    """
    walker = _Walker(plan, payloads, interned, big=big)
    everything = np.arange(len(payloads), dtype=np.int64)
    walker.run(plan.steps, everything)
    return walker.finished()


class _Walker:
    def __init__(self, plan: DecodePlan, payloads: Payloads, interned: Interned, *, big: bool) -> None:
        head = 4 if plan.cdr else 0
        self._plan, self._interned, self._big = plan, interned, big
        self._passing = Interned()  # for unwanted texts, which must be valid all the same
        self._buffer = payloads.buffer
        self._base = payloads.starts + head
        self._size = payloads.ends - self._base
        self._at = np.zeros(len(payloads), dtype=np.int64)
        self._sound = self._size >= 0
        self._lonely = np.zeros(len(payloads), dtype=bool)
        # For each stream the messages, and the places in the buffer (or the lengths or codes).
        self._found: dict[int, list[tuple[IntArray, IntArray]]] = {s.number: [] for s in plan.streams}

    def run(self, steps: Sequence[Step], rows: IntArray) -> IntArray:
        """Walk some messages through some steps; returns those still sound afterwards."""
        for step in steps:
            rows = rows[self._sound[rows]]
            if not len(rows):
                return rows
            if isinstance(step, Block):
                rows = self._block(step, rows)
            elif isinstance(step, Text):
                rows = self._text(step, rows)
            else:
                rows = self._repeat(step, rows)
        return rows

    def finished(self) -> Walked:
        left = self._size - self._at
        self._sound &= (left >= 0) & (left <= (3 if self._plan.cdr else 0))
        counts: dict[int, IntArray] = {}
        values: dict[int, NDArray[Any]] = {}
        for stream in self._plan.streams:
            found = self._found[stream.number]
            rows = np.concatenate([r for r, _ in found]) if found else np.zeros(0, dtype=np.int64)
            what = np.concatenate([w for _, w in found]) if found else np.zeros(0, dtype=np.int64)
            kept = self._sound[rows]
            rows, what = rows[kept], what[kept]
            if len(found) > 1:
                # The values of one message are in order already, so a stable sort by message suffices.
                order = np.argsort(rows, kind="stable")
                rows, what = rows[order], what[order]
            counts[stream.number] = np.bincount(rows, minlength=len(self._sound)).astype(np.int64)
            if stream.kind in ("string", "length"):
                values[stream.number] = what
            else:
                values[stream.number] = gathered(self._buffer, what, stream.dtype, big=self._big)
        return Walked(self._sound, self._lonely, counts, values)

    def _lose(self, rows: IntArray, fits: NDArray[np.bool_]) -> IntArray:
        """Drop the messages that do not fit."""
        if fits.all():  # mostly, and indexing by a mask copies
            return rows
        self._sound[rows[~fits]] = False
        return rows[fits]

    def _keep(self, stream: int, rows: IntArray, what: IntArray) -> None:
        self._found[stream].append((rows, what))

    def _block(self, block: Block, rows: IntArray) -> IntArray:
        at = self._at[rows]
        end = at + block.lengths[at & 7]
        fits = end <= self._size[rows]
        rows = self._lose(rows, fits)
        at, end = at[fits], end[fits]
        base = self._base[rows] + at
        for stream, table in block.kept:
            places = base[:, None] + table[at & 7]
            self._keep(stream, np.repeat(rows, places.shape[1]), places.reshape(-1))
        for stream, counts in block.counts:
            self._keep(stream, np.repeat(rows, len(counts)), np.tile(counts, len(rows)))
        self._at[rows] = end
        return rows

    def _words(self, rows: IntArray) -> tuple[IntArray, IntArray]:
        """The messages that have a length word at their cursor, and the words; cursors move behind them."""
        at = self._at[rows]
        if self._plan.cdr:
            at = (at + 3) & -4  # rounded up to a multiple of 4
        fits = at + 4 <= self._size[rows]
        rows = self._lose(rows, fits)
        at = at[fits]
        words = gathered(self._buffer, self._base[rows] + at, np.dtype("u4"), big=self._big)
        self._at[rows] = at + 4
        return rows, words.astype(np.int64)

    def _text(self, text: Text, rows: IntArray) -> IntArray:
        rows, lengths = self._words(rows)
        ends = self._at[rows] + lengths
        least = 1 if self._plan.cdr else 0
        fits = (ends <= self._size[rows]) & (lengths >= least)
        rows, lengths, ends = self._lose(rows, fits), lengths[fits], ends[fits]
        if self._plan.cdr:
            closed = self._buffer[self._base[rows] + ends - 1] == 0
            rows, lengths, ends = self._lose(rows, closed), lengths[closed], ends[closed]
        starts = self._base[rows] + ends - lengths
        interned = self._passing if text.stream is None else self._interned
        codes = self._codes(starts, starts + lengths - least, interned)
        valid = codes >= 0
        rows, codes, ends = self._lose(rows, valid), codes[valid], ends[valid]
        if text.stream is not None:
            self._keep(text.stream, rows, codes)
        self._at[rows] = ends
        return rows

    def _codes(self, starts: IntArray, ends: IntArray, interned: Interned) -> IntArray:
        raw = self._buffer.data
        found = [interned[bytes(raw[a:b])] for a, b in zip(starts.tolist(), ends.tolist(), strict=True)]
        return np.array(found, dtype=np.int64)

    def _repeat(self, repeat: Repeat, rows: IntArray) -> IntArray:
        if repeat.count is None:
            rows, counts = self._words(rows)
            fits = counts <= self._plan.longest_sequence
            # Divided, not multiplied: a count and a size can be too large together for 64 bits.
            if repeat.least:
                fits &= counts <= (self._size[rows] - self._at[rows]) // repeat.least
            rows, counts = self._lose(rows, fits), counts[fits]
        else:
            fits = (self._size[rows] - self._at[rows]) >= repeat.count * repeat.least
            rows = self._lose(rows, fits)
            counts = np.full(len(rows), repeat.count, dtype=np.int64)
        if repeat.lengths is not None:
            self._keep(repeat.lengths, rows, counts)
        if all(isinstance(step, Block) for step in repeat.body):
            return self._blocks(repeat.body, rows, counts)
        many = counts > _LONGEST_LOOP
        self._lonely[rows[many]] = True
        rows, counts = self._lose(rows, ~many), counts[~many]
        for done in range(int(counts.max(initial=0))):
            self.run(repeat.body, rows[counts > done])
        return rows[self._sound[rows]]

    def _blocks(self, body: Sequence[Step], rows: IntArray, counts: IntArray) -> IntArray:
        """Elements of fixed size. Only the first may start at another alignment than all others."""
        if not body or not isinstance(body[0], Block):
            return rows
        block, at = body[0], self._at[rows]
        second = at + block.lengths[at & 7]
        stride = block.lengths[second & 7]
        end = np.where(counts > 0, second + (counts - 1) * stride, at)
        fits = end <= self._size[rows]
        rows = self._lose(rows, fits)
        at, second, stride, counts, end = (a[fits] for a in (at, second, stride, counts, end))
        self._at[rows] = end
        if block.kept or block.counts:
            element = ranges(np.zeros(len(rows), dtype=np.int64), counts)
            owners = np.repeat(np.arange(len(rows)), counts)
            start = np.where(element, second[owners] + (element - 1) * stride[owners], at[owners])
            base = self._base[rows][owners] + start
            for stream, table in block.kept:
                places = base[:, None] + table[start & 7]
                self._keep(stream, np.repeat(rows[owners], places.shape[1]), places.reshape(-1))
            for stream, lengths in block.counts:
                self._keep(stream, np.repeat(rows[owners], len(lengths)), np.tile(lengths, len(owners)))
        return rows
