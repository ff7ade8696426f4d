"""Chunks side by side in reused buffers: one buffer is filled while the messages of another are read."""

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
"""Bytes of records in one buffer; a larger chunk gets a buffer of its own."""

_LARGEST_INDEX_BYTES = 64 << 20
_RECORD_BYTES = 1 << 8
"""Counted for each index record besides its body: millions of empty ones would take memory, too."""
_MOST_JOBS = 16
_TOGETHER_BYTES = 4 << 20
"""Chunks are handed to another thread in groups of about this size, because waking a thread takes time."""

_Fill = Callable[[memoryview], Callable[[], None]]


@dataclass
class Chunk:
    """A queued chunk.

    Attributes:
        start: Where it starts in the file, bytes.
        end: Where it ends in the file, its index included.
        first: Where its records start in the buffer of its slab.
        last: Where they end.
        finish: Waits until they are inflated; raises ValueError when they cannot be.
        index: The bodies of its index records.
        complete: Reads the payloads that were left out; `None` when none was.
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
        """Whether an index record of this length is still kept."""
        return self._index_bytes + length <= _LARGEST_INDEX_BYTES

    def add_index(self, body: bytes) -> None:
        """Keep the body of an index record."""
        self.index.append(body)
        self._index_bytes += len(body) + _RECORD_BYTES


class _Group:
    """Jobs that run in order: on another thread if they were given to one, else when waited for."""

    def __init__(self) -> None:
        self.size = 0
        self._jobs: list[Callable[[], None]] = []
        self._failure: tuple[int, Exception] | None = None
        self._wait: Callable[[], None] = self._run

    def add(self, job: Callable[[], None], size: int) -> Callable[[], None]:
        """Take a job for a number of bytes; returns a function that waits for it and raises its error."""
        self._jobs.append(job)
        self.size += size
        return partial(self._finish, len(self._jobs) - 1)

    def give(self, pool: ThreadPoolExecutor) -> None:
        """Run them on another thread."""
        self._wait = pool.submit(self._run).result

    def _run(self) -> None:
        jobs, self._jobs = self._jobs, []
        for number, job in enumerate(jobs):
            try:
                job()
            except Exception as error:  # noqa: BLE001  # raised again in `_finish`
                self._failure = number, error
                return  # nothing behind a damaged chunk counts

    def _finish(self, number: int) -> None:
        self._wait()
        if self._failure is not None and self._failure[0] <= number:
            raise self._failure[1]


class Slab:
    """A buffer of chunks.

    Attributes:
        buffer: Their records one after the other, then unused room.
        chunks: In recorded order.
    """

    def __init__(self, size: int) -> None:
        self.buffer: Bytes = np.empty(size, dtype=np.uint8)
        self.chunks: list[Chunk] = []
        self._used = self._packed = 0

    def has_room_for(self, size: int, packed: int) -> bool:
        """Whether a chunk of this size, and of this packed size in the file, fits in.

        Packed bytes are limited as well: the jobs hold them in memory until they run.
        """
        return self._used + size <= len(self.buffer) and (
            not self.chunks or self._packed + packed <= 2 * SLAB_BYTES
        )

    def reserve(self, size: int, packed: int) -> tuple[int, memoryview]:
        """The start of the room for the records of the next chunk, and that room."""
        start, self._used = self._used, self._used + size
        self._packed += packed
        return start, self.buffer.data[start : self._used]

    def empty(self) -> None:
        """Forget the chunks, so that the buffer can be reused."""
        self.chunks, self._used, self._packed = [], 0, 0

    def finished(self) -> tuple[Sequence[Chunk], ValueError | None]:
        """The chunks before the first that cannot be inflated, and why it cannot."""
        for number, chunk in enumerate(self.chunks):
            try:
                chunk.finish()
            except ValueError as error:
                return self.chunks[:number], error
        return self.chunks, None


class Slabs:
    """Two slabs: one is filled while the messages of the other are read.

    Args:
        jobs: Threads, including the one that reads; the others inflate, or it does if there are none.
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
        """The chunk that was added last, while its slab is still being filled."""
        return self._filling.chunks[-1] if self._filling.chunks else None

    def turn(self, size: int, packed: int) -> Iterator[Slab]:
        """Make room for a chunk; first yields a slab that must be read before."""
        if self._filling.has_room_for(size, packed):
            return
        self._give()
        if self._waiting is not None:
            yield self._waiting
            self._waiting.empty()
        # The slab just read becomes the next one to fill, and the filled one the next to read.
        spare, self._waiting = self._waiting, self._filling if self._filling.chunks else None
        # A large chunk gets a slab of its own, and is alone in memory: both buffers are given up for it.
        if size > SLAB_BYTES:
            if self._waiting is not None:
                yield self._waiting
            self._filling, self._waiting = Slab(size), None
        else:
            fits = spare is not None and len(spare.buffer) == SLAB_BYTES
            self._filling = spare if spare is not None and fits else Slab(SLAB_BYTES)

    def room_of(self, chunk: Chunk) -> memoryview:
        """The room of the chunk that was added last."""
        return self._filling.buffer.data[chunk.first : chunk.last]

    def rest(self) -> Iterator[Slab]:
        """All slabs that were not read."""
        self._group = _Group()  # jobs that were not given to a thread run when their chunk is read
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
            packed: Its bytes in the file.
            start: Where it starts there.
            fill: Given the room for its records, returns the job that puts them there and
                verifies them. It is called at once, the job perhaps on another thread.
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
        """Let another thread begin with the chunks added last."""
        if self._pool is not None and self._group.size:
            self._group.give(self._pool)
            self._group = _Group()


def nothing_to_do() -> None:
    """The job of a chunk that needs no inflating."""


@contextmanager
def scratch(size: int) -> Iterator[memoryview]:
    """A buffer of the calling thread, valid until its next call, which reuses it."""
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
    # Not `cpu_count` where there is better: a container may be given fewer processors than there are.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
