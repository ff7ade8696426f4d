"""Chunks side by side in one buffer, which is used again, inflated while others are looked at."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType

import numpy as np

from ariac_score.logs.containers.items import Bytes

__all__ = ["SLAB_BYTES", "Chunk", "Slab", "Slabs", "nothing_to_do", "scratch"]

SLAB_BYTES = 16 << 20
"""So many bytes of records lie side by side, in two buffers; a larger chunk has one of its own."""

_LARGEST_INDEX_BYTES = 64 << 20
_RECORD_BYTES = 1 << 8
"""What an index record takes besides what it holds, so that there are not too many that hold nothing."""
_MOST_JOBS = 16
_TOGETHER_BYTES = 4 << 20
"""Chunks of so many bytes in all are given to another thread at once: to wake one takes time."""

_Fill = Callable[[memoryview], Callable[[], None]]


@dataclass
class Chunk:
    """A chunk on its way.

    Attributes:
        start: Where it starts in the file, bytes.
        end: Where what belongs to it ends in the file, its index included.
        first: Where its records start in the buffer of its slab.
        last: Where they end.
        finish: Waits until they are there; raises ValueError when they cannot be had.
        index: What its index records hold.
        complete: Reads what was left out of it; `None` when nothing was.
    """

    start: int
    end: int
    first: int
    last: int
    finish: Callable[[], None]
    index: list[bytes] = field(default_factory=list)
    complete: Callable[[], None] | None = None
    _index_bytes: int = 0

    def has_room_for(self, length: int) -> bool:
        """Whether an index record of so many bytes is still looked at."""
        return self._index_bytes + length <= _LARGEST_INDEX_BYTES

    def add_index(self, body: bytes) -> None:
        """Take what an index record holds."""
        self.index.append(body)
        self._index_bytes += len(body) + _RECORD_BYTES


class _Group:
    """Jobs that are done one after the other: on another thread once they are given to one."""

    def __init__(self) -> None:
        self.size = 0
        self._jobs: list[Callable[[], None]] = []
        self._failure: tuple[int, Exception] | None = None
        self._wait: Callable[[], None] = self._run

    def add(self, job: Callable[[], None], size: int) -> Callable[[], None]:
        """Take a job for so many bytes; returns what waits for it and raises what it raised."""
        self._jobs.append(job)
        self.size += size
        return partial(self._finish, len(self._jobs) - 1)

    def give(self, pool: ThreadPoolExecutor) -> None:
        """Let another thread do them."""
        self._wait = pool.submit(self._run).result

    def _run(self) -> None:
        jobs, self._jobs = self._jobs, []
        for number, job in enumerate(jobs):
            try:
                job()
            except Exception as error:  # noqa: BLE001  # whoever waits for it gets it
                self._failure = number, error
                return  # nobody looks at what is behind it

    def _finish(self, number: int) -> None:
        self._wait()
        if self._failure is not None and self._failure[0] <= number:
            raise self._failure[1]


class Slab:
    """Chunks side by side.

    Attributes:
        buffer: Their records one after the other, and room behind them.
        chunks: In recorded order.
    """

    def __init__(self, size: int) -> None:
        self.buffer: Bytes = np.empty(size, dtype=np.uint8)
        self.chunks: list[Chunk] = []
        self._used = self._packed = 0

    def has_room_for(self, size: int, packed: int) -> bool:
        """Whether a chunk of this size, of so many bytes in the file, fits in."""
        return self._used + size <= len(self.buffer) and (
            not self.chunks or self._packed + packed <= 2 * SLAB_BYTES
        )

    def reserve(self, size: int, packed: int) -> tuple[int, memoryview]:
        """Where the records of the next chunk start, and the room they get."""
        start, self._used = self._used, self._used + size
        self._packed += packed
        return start, self.buffer.data[start : self._used]

    def empty(self) -> None:
        """Forget the chunks, so that the buffer can be used again."""
        self.chunks, self._used, self._packed = [], 0, 0

    def finished(self) -> tuple[Sequence[Chunk], ValueError | None]:
        """The chunks before the first that cannot be had, and why it cannot."""
        for number, chunk in enumerate(self.chunks):
            try:
                chunk.finish()
            except ValueError as error:
                return self.chunks[:number], error
        return self.chunks, None


class Slabs:
    """Two slabs: one is filled while the other one is looked at.

    Args:
        jobs: Threads, the one that reads included; all others inflate, and if there are none, it does.
            0: as many as there are processors.
    """

    def __init__(self, jobs: int = 0) -> None:
        jobs = min(jobs or _processors(), _MOST_JOBS)
        self._pool = ThreadPoolExecutor(jobs - 1) if jobs > 1 else None
        self._filling, self._group = Slab(0), _Group()
        self._waiting: Slab | None = None

    def __enter__(self) -> Slabs:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool:
            self._pool.shutdown(cancel_futures=True)

    @property
    def last(self) -> Chunk | None:
        """The chunk that was added last, while its slab is not looked at."""
        return self._filling.chunks[-1] if self._filling.chunks else None

    def turn(self, size: int, packed: int) -> Iterator[Slab]:
        """Make room for a chunk; a slab that must be looked at before comes first."""
        if self._filling.has_room_for(size, packed):
            return
        self._give()
        if self._waiting is not None:
            yield self._waiting
            self._waiting.empty()
        spare, self._waiting = self._waiting, self._filling if self._filling.chunks else None
        if size > SLAB_BYTES:
            if self._waiting is not None:
                yield self._waiting
            self._filling, self._waiting = Slab(size), None
        else:
            fits = spare is not None and len(spare.buffer) == SLAB_BYTES
            self._filling = spare if spare is not None and fits else Slab(SLAB_BYTES)

    def room_of(self, chunk: Chunk) -> memoryview:
        """Where the records of the chunk lie that was added last."""
        return self._filling.buffer.data[chunk.first : chunk.last]

    def rest(self) -> Iterator[Slab]:
        """All slabs that were not looked at."""
        self._group = _Group()  # what was not given is done by whoever looks
        if self._waiting is not None:
            yield self._waiting
            self._waiting.empty()
            self._waiting = None
        if self._filling.chunks:
            yield self._filling
            self._filling.empty()

    def add(
        self, size: int, packed: int, start: int, fill: Callable[[memoryview], Callable[[], None]]
    ) -> Chunk:
        """Add a chunk for which `turn` made room.

        Args:
            size: Bytes of its records.
            packed: Bytes of it in the file.
            start: Where it starts there.
            fill: Given the room for its records it returns the job that puts them there
                and verifies them; called at once, the job perhaps on another thread.
        """
        first, room = self._filling.reserve(size, packed)
        job = fill(room)
        if self._pool is not None and job is not nothing_to_do:
            job = self._group.add(job, size)
            if self._group.size >= _TOGETHER_BYTES:
                self._give()
        chunk = Chunk(start, start, first, first + size, job)
        self._filling.chunks.append(chunk)
        return chunk

    def _give(self) -> None:
        """Let another thread begin with what was added last."""
        if self._pool is not None and self._group.size:
            self._group.give(self._pool)
            self._group = _Group()


def nothing_to_do() -> None:
    """The job of a chunk that lies ready."""


@contextmanager
def scratch(size: int) -> Iterator[memoryview]:
    """Some bytes that hold until the thread asks again; those of before are used again."""
    if size > SLAB_BYTES:
        yield memoryview(bytearray(size))
        return
    own: bytearray = getattr(_OWN, "bytes", bytearray())
    if len(own) < max(size, _SMALLEST_SCRATCH_BYTES):
        own = _OWN.bytes = bytearray(max(size, _SMALLEST_SCRATCH_BYTES))
    yield memoryview(own)[:size]


_SMALLEST_SCRATCH_BYTES = 1 << 20
_OWN = threading.local()


def _processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
