"""Messages that wait to be decoded together, in one buffer for all topics."""

from __future__ import annotations

from array import array
from collections.abc import Container, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ariac_score.logs.columnar import Payloads
from ariac_score.logs.containers.items import Batch, Bytes, Connection, IntArray, Message

__all__ = ["SLAB_BYTES", "Pending", "Waiting"]

SLAB_BYTES = 16 << 20
"""The most that waits, not counting the last message: it bounds the memory that reading needs."""

_SMALLEST_BYTES = 1 << 16
_SLAB_MESSAGES = 1 << 17
_CLOSE_BYTES = 256
"""Wanted messages with no more than this between them are copied in one piece: so much costs less than a
copy of its own for each."""


@dataclass(frozen=True, eq=False)
class Waiting:
    """The waiting messages of one connection.

    Attributes:
        numbers: The numbers of the messages in the recording, increasing, shape (n,).
        stamps_ns: Their log times, shape (n,).
        payloads: Their bytes.
    """

    numbers: IntArray
    stamps_ns: IntArray
    payloads: Payloads


class Pending:
    """Collects messages until they are worth decoding together.

    The buffer is reused, because touching fresh memory costs more than all that is done with
    it. So the views that `empty` returns are valid until the next message is added.
    """

    def __init__(self) -> None:
        self._buffer: Bytes = np.empty(0, dtype=np.uint8)
        self._used = 0
        self._rows: dict[Connection, array[int]] = {}
        self._count = 0

    @property
    def full(self) -> bool:
        """Whether it should be emptied."""
        return self._used >= SLAB_BYTES or self._count >= _SLAB_MESSAGES

    def add(self, message: Message, number: int) -> None:
        """Take a copy of a message, so that the chunk it lies in can be freed."""
        start = self._reserve(len(message.payload))
        self._buffer.data[start : self._used] = message.payload
        self._of(message.connection).extend((number, message.stamp_ns, start, self._used))
        self._count += 1

    def _reserve(self, count: int) -> int:
        """The place of the next bytes."""
        start, self._used = self._used, self._used + count
        if self._used > len(self._buffer):
            larger = np.empty(max(self._used, 2 * len(self._buffer), _SMALLEST_BYTES), dtype=np.uint8)
            larger[:start] = self._buffer[:start]
            self._buffer = larger
        return start

    def take(
        self, batch: Batch, wanted: Container[Connection], first: int
    ) -> Iterator[dict[Connection, Waiting]]:
        """Take the wanted messages of a batch; yields messages that are to be decoded at once.

        Large portions are not copied, so what is yielded is valid until the next batch is read.

        Args:
            batch: Some messages.
            wanted: The connections whose messages are wanted.
            first: The number of the first message in the recording.
        """
        good = np.array([connection in wanted for connection in batch.connections], dtype=bool)
        kept = np.arange(len(batch)) if good.all() else np.flatnonzero(good[batch.sources])
        for some in _portions(batch, kept):
            rows = kept[some]
            if _size(batch, rows) >= SLAB_BYTES // 8:
                if self._count:
                    yield self.empty()  # first, for these were recorded before
                yield _in_place(batch, rows, first)
                continue
            self.add_many(batch, rows, rows + first)
            if self.full:
                yield self.empty()

    def add_many(self, batch: Batch, kept: IntArray, numbers: IntArray) -> None:
        """Take copies of some messages of a batch."""
        starts, ends = batch.payloads.starts[kept], batch.payloads.ends[kept]
        first, last = int(starts.min()), int(ends.max())
        buffer, wanted = batch.payloads.buffer, int((ends - starts).sum())
        if last - first <= 2 * wanted:
            start = self._reserve(last - first)
            self._buffer[start : self._used] = buffer[first:last]
            new_starts, new_ends = starts + (start - first), ends + (start - first)
        else:
            # Most of the stretch is something else, such as unwanted images: copy the wanted runs only.
            order = np.argsort(starts, kind="stable")
            placed, behind = starts[order], np.maximum.accumulate(ends[order])
            breaks = np.flatnonzero(placed[1:] - behind[:-1] > _CLOSE_BYTES) + 1
            bounds = np.concatenate(([0], breaks, [len(starts)]))
            run_starts, run_ends = placed[bounds[:-1]], behind[bounds[1:] - 1]
            start = self._reserve(int((run_ends - run_starts).sum()))
            moved = start + np.cumsum(run_ends - run_starts) - (run_ends - run_starts) - run_starts
            for old, old_end, by in zip(run_starts.tolist(), run_ends.tolist(), moved.tolist(), strict=True):
                self._buffer[old + by : old_end + by] = buffer[old:old_end]
            by = np.empty(len(starts), dtype=np.int64)
            by[order] = np.repeat(moved, np.diff(bounds))
            new_starts, new_ends = starts + by, ends + by
        table = np.stack((numbers, batch.stamps_ns[kept], new_starts, new_ends), axis=1)
        sources = batch.sources[kept]
        for place in np.flatnonzero(np.bincount(sources)).tolist():
            self._of(batch.connections[place]).frombytes(table[sources == place].tobytes())
        self._count += len(kept)

    def _of(self, connection: Connection) -> array[int]:
        """Number, stamp, start and end of each message of a connection."""
        if connection not in self._rows:
            self._rows[connection] = array("q")
        return self._rows[connection]

    def empty(self) -> dict[Connection, Waiting]:
        """All waiting messages; nothing waits afterwards."""
        buffer = self._buffer[: self._used]
        waiting = {}
        for connection, rows in self._rows.items():
            table = np.frombuffer(rows, dtype=np.int64).reshape(-1, 4)
            numbers, stamps_ns, starts, ends = np.ascontiguousarray(table.T)
            waiting[connection] = Waiting(numbers, stamps_ns, Payloads(buffer, starts, ends))
        self._used, self._rows, self._count = 0, {}, 0
        return waiting


def _size(batch: Batch, rows: IntArray) -> int:
    return int((batch.payloads.ends[rows] - batch.payloads.starts[rows]).sum())


def _portions(batch: Batch, kept: IntArray) -> Iterator[slice]:
    """The wanted messages of a batch, in portions of about the size of the buffer."""
    sizes = batch.payloads.ends[kept] - batch.payloads.starts[kept]
    total = np.cumsum(sizes) // SLAB_BYTES
    bounds = [0, *(np.flatnonzero(np.diff(total)) + 1).tolist(), len(kept)]
    for first, last in pairwise(bounds):
        if last > first:
            yield slice(first, last)


def _in_place(batch: Batch, rows: IntArray, first: int) -> dict[Connection, Waiting]:
    """Messages of a batch by connection, without copying them."""
    sources, payloads = batch.sources[rows], batch.payloads
    # numpy sorts 8-bit and 16-bit integers by radix sort, in one or two passes.
    few = len(batch.connections) <= 1 << 8
    rows = rows[np.argsort(sources.astype(np.uint8) if few else sources, kind="stable")]
    numbers, stamps_ns = rows + first, batch.stamps_ns[rows]
    starts, ends = payloads.starts[rows], payloads.ends[rows]
    bounds = np.cumsum(np.bincount(sources, minlength=len(batch.connections))).tolist()
    waiting = {}
    for connection, start, end in zip(batch.connections, [0, *bounds], bounds, strict=False):
        if end > start:
            own = slice(start, end)
            found = Payloads(payloads.buffer, starts[own], ends[own])
            waiting[connection] = Waiting(numbers[own], stamps_ns[own], found)
    return waiting
