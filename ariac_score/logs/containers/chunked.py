"""Scanning recordings that consist of chunks with indexes: MCAP files and ROS 1 bags.

A chunk is queued together with the index behind it and inflated, perhaps on another thread, while
the next ones are read. Once a buffer is full, or a record outside chunks follows, the queue is
drained: all messages as one batch where the indexes agree with the head of every message, otherwise
record by record, for the records are what counts. Unwanted payloads and whole chunks are left out
where the index gives their place.

Why not simply follow the index, as other readers do? An index may be wrong or missing where the
records are sound, and a file that is read from front to back shows how far it is sound.
"""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar
from zlib import crc32

import numpy as np

from ariac_score.errors import LogError
from ariac_score.logs.containers.chunk_buffers import Chunk, Slab, Slabs, nothing_to_do
from ariac_score.logs.containers.items import (
    Batch,
    Bytes,
    Connection,
    IntArray,
    Item,
    Message,
    Payloads,
    checked_stamp,
)
from ariac_score.logs.containers.record_index import IndexEntries, check_not_crossed, gaps_between
from ariac_score.logs.containers.source import MAX_PEEK_BYTES, Source

__all__ = [
    "LARGE_MESSAGE_BYTES",
    "USUAL_INDEX_BYTES",
    "ChunkHead",
    "ChunkedScan",
    "Lookahead",
    "MessageHeads",
    "Outline",
]

LARGE_MESSAGE_BYTES = 1 << 16
"""Unwanted payloads from this size on are not read; skipping smaller ones saves nothing."""

USUAL_INDEX_BYTES = 1 << 12
"""How far to look behind a chunk for its index, until the first one shows how long they are."""
_FEW_NUMBERS = 1 << 16


@dataclass(frozen=True)
class ChunkHead:
    """The head of a chunk: the fields before its records.

    Attributes:
        size: Bytes of its records, inflated.
        packed: Bytes of its records in the file.
        compression: Its name; empty or `none` without one.
        span_ns: The earliest and the latest log time in it, ns; `None` where heads do not contain them.
        crc: Checksum of its records; 0 without one.
    """

    size: int
    packed: int
    compression: str
    span_ns: tuple[int, int] | None = None
    crc: int = 0

    @property
    def plain(self) -> bool:
        """Whether its records are not compressed."""
        return self.compression in ("", "none")

    def verify(self, records: memoryview) -> None:
        """Compare the checksum of the records with the announced one.

        Raises:
            ValueError: They differ.
        """
        if self.crc and (found := crc32(records)) != self.crc:
            raise ValueError(f"its CRC is {found:08x}, the file says {self.crc:08x}")


@dataclass(frozen=True, eq=False)
class MessageHeads:
    """The heads of messages in a buffer.

    Attributes:
        senders: Number of the channel or connection of each message, shape (n,).
        stamps_ns: Their log times, ns, shape (n,).
        starts: Where each payload starts in the buffer, shape (n,).
        ends: Where it ends, shape (n,).
        sequences: The number of each, shape (n,); `None` where messages have none.
    """

    senders: IntArray
    stamps_ns: IntArray
    starts: IntArray
    ends: IntArray
    sequences: IntArray | None = None


@dataclass(frozen=True)
class Outline:
    """The contents of a file as its end announces them.

    Attributes:
        topics: By the number of each channel or connection.
        chunks: The channels or connections with messages in each chunk, by its start.
        declares_all: Whether the end declares them as fully as the chunks do.
    """

    topics: Mapping[int, str]
    chunks: Mapping[int, Collection[int]]
    declares_all: bool


class Lookahead:
    """Bytes from a place of a file on, read on demand.

    Attributes:
        bytes: The bytes read so far.
    """

    def __init__(self, source: Source, start: int, count: int) -> None:
        self.bytes = source.at(start, count)
        self._source, self._start = source, start

    def reaches(self, end: int) -> bool:
        """Whether the file reaches up to here, and no further than an index may reach."""
        missing = end - len(self.bytes)
        if missing > 0 and end <= MAX_PEEK_BYTES:
            more = max(missing + USUAL_INDEX_BYTES, len(self.bytes))
            self.bytes += self._source.at(self._start + len(self.bytes), more)
        return end <= len(self.bytes)


@dataclass(frozen=True, eq=False)
class _Places:
    """The messages of some chunks, and in `runs` the gaps between them (see `gaps_between`)."""

    buffer: Bytes
    heads: MessageHeads
    runs: Sequence[tuple[int, int, int, int]] = ()


class ChunkedScan(ABC):
    """One file of chunks; see `ariac_score.logs.containers.items.Scan`.

    A subclass knows the records of its format; everything else is here.

    Args:
        path: The file.
        jobs: Threads, of which all but one inflate chunks; 0: as many as there are processors.
        topics: Messages of other topics may come without their bytes; `None`: all come with them.

    Attributes:
        path: The file.
        sender_kind: What a message belongs to, in the words of the format.
        sender_bytes: Bytes of its number at the start of an index record.
        message_head_bytes: How much is read of a message whose payload is left out.
        smallest_left_out_bytes: Nothing is left out of smaller chunks.
    """

    sender_kind: ClassVar[str]
    sender_bytes: ClassVar[int]
    message_head_bytes: ClassVar[int]
    smallest_left_out_bytes: ClassVar[int] = 0

    def __init__(self, path: Path, *, jobs: int = 0, topics: Container[str] | None = None) -> None:
        self.path = path
        self._jobs, self._topics = jobs, topics
        self._connections: dict[int, Connection] = {}
        self._unwanted: set[int] = set()
        self._found: Counter[int] = Counter()
        self._chunks = 0
        self._usual_index_bytes = USUAL_INDEX_BYTES
        self._source: Source | None = None
        self._readable = "byte 0"
        self._contradictions = self._done = self._handed_over = 0
        self._is_draining = False

    # What a format defines ----------------------------------------------------------------------

    @abstractmethod
    def _open(self, source: Source) -> None:
        """Read what precedes the first record, and the contents that the end of the file announces.

        Raises:
            LogError: It is damaged.
        """

    @abstractmethod
    def _records(self, source: Source, slabs: Slabs) -> Iterator[Item]:
        """Read record by record, queueing chunks and draining the queue before anything else.

        Raises:
            LogError: A record is damaged.
        """

    @abstractmethod
    def _close(self, source: Source) -> None:
        """Compare what was read with what the file announces.

        Raises:
            LogError: It is not the same.
        """

    @abstractmethod
    def _fill(self, source: Source, head: ChunkHead, room: memoryview) -> Callable[[], None]:
        """Read the records of a chunk; returns the job that completes and verifies them."""

    @abstractmethod
    def _index_records(self, ahead: Lookahead) -> Iterator[tuple[bytes, int]]:
        """Each index record behind a chunk: what it holds, its sender first, and where it ends.

        Raises:
            ValueError: They must be read one by one.
        """

    @abstractmethod
    def outline(self, source: Source) -> Outline | None:
        """The announced contents, for foreseeing which bytes a scan reads; `None`: all of them.

        Raises:
            LogError: The file is damaged.
            ValueError: Likewise.
        """

    @abstractmethod
    def chunk_at(self, source: Source, start: int) -> ChunkHead:
        """Read the head of a chunk, and move on to its records.

        Raises:
            LogError: The file ends before.
            ValueError: There is no chunk.
        """

    @abstractmethod
    def _is_announced(self, start: int, entries: IndexEntries) -> bool:
        """Whether the end of the file agrees with the index of a chunk, which declares nothing new."""

    @abstractmethod
    def _items_in_chunk(self, records: memoryview, start: int) -> Iterator[Item]:
        """The records of a chunk one by one.

        Raises:
            ValueError: One of them is damaged.
            struct.error: Likewise.
        """

    @staticmethod
    @abstractmethod
    def _entries(indexes: Sequence[Sequence[bytes]]) -> IndexEntries:
        """The entries of the index records of some chunks.

        Raises:
            ValueError: They are no index.
            struct.error: Likewise.
        """

    @staticmethod
    @abstractmethod
    def _message_offsets(records: memoryview) -> IntArray:
        """Where the records of messages start, by walking all records.

        Raises:
            ValueError: One of them is damaged.
            struct.error: Likewise.
        """

    @staticmethod
    @abstractmethod
    def _message_heads(buffer: Bytes, offsets: IntArray) -> MessageHeads:
        """The heads of the messages at some places.

        Raises:
            ValueError: There is another record, or a head that is built differently.
            struct.error: Likewise.
        """

    def _declare_all(self) -> Iterator[Connection]:
        """Declare everything that a chunk which is not read might have declared."""
        yield from ()

    # Progress ---------------------------------------------------------------------------------

    def _reached(self, offset: int) -> None:
        """Record that everything before this byte was readable."""
        self._done, self._readable = offset, f"byte {offset}"

    @property
    def index_contradictions(self) -> int:
        """How often the index contradicted the records."""
        return self._contradictions

    @property
    def readable(self) -> str:
        """How far reading got."""
        return self._readable

    @property
    def share(self) -> float:
        """The share read, 0 to 1, including what was handed over last."""
        source = self._source
        return max(self._done, self._handed_over) / source.size if source and source.size else 0.0

    # The scan ---------------------------------------------------------------------------------

    def __iter__(self) -> Iterator[Item]:
        """Every declared connection and message, in recorded order.

        Raises:
            LogError: The file is not whole; see `readable`.
        """
        with Source(self.path) as source:
            self._source = source
            self._open(source)
            with Slabs(self._jobs) as slabs:
                try:
                    yield from self._records(source, slabs)
                    yield from self._drained(source, slabs.rest())
                except LogError:
                    if not self._is_draining:
                        # What was queued lies before the damage: it is readable, or damaged first.
                        yield from self._drained(source, slabs.rest())
                    raise
            self._close(source)

    def _enqueue_chunk(
        self, source: Source, slabs: Slabs, read_head: Callable[[], ChunkHead], length: int, start: int
    ) -> Iterator[Item]:
        """Queue a chunk, or skip it where none of its messages is wanted.

        Args:
            source: Behind the head of the record.
            slabs: The queue.
            read_head: Reads the head of the chunk, or raises ValueError.
            length: Bytes of the record without its own head.
            start: Where the record starts.
        """
        end = source.offset + length
        try:
            head = read_head()
            index, behind = self._index_behind(source, end)
            named = {int.from_bytes(body[: self.sender_bytes], "little") for body in index}
            if self._topics is not None and not named <= self._connections.keys():
                # They are declared in a queued chunk or in this one. Whether they are wanted is needed now.
                yield from self._drained(source, slabs.rest())
            unread = self._unread(index, named, head, start)
            if unread is not None:
                yield from self._drained(source, slabs.rest())
                yield from self._declare_all()
                self._chunks += 1
                yield unread
                source.skip(behind - source.offset)
                self._reached(source.offset)
                return
            yield from self._drained(source, slabs.turn(head.size, 0 if head.plain else head.packed))
            left_out = self._left_out(index, head)
            if left_out:
                chunk = self._enqueue_parts(source, slabs, head, left_out, start)
            else:
                chunk = slabs.add(head.size, head.packed, start, lambda room: self._fill(source, head, room))
            chunk.index, chunk.end = index, behind
            source.skip(behind - source.offset)
        except (struct.error, ValueError) as error:
            yield from self._drained(source, slabs.rest())
            raise source.damaged(str(error), what="chunk", at=start) from error

    def _index_behind(self, source: Source, end: int) -> tuple[list[bytes], int]:
        """The index records behind a chunk, and where they end."""
        ahead = Lookahead(source, end, self._usual_index_bytes)
        found: list[bytes] = []
        last = 0
        try:
            for body, last in self._index_records(ahead):  # noqa: B007  # the last one counts
                found.append(body)
        except ValueError:
            return [], end  # without an index the records are walked
        # The next index is about as long, and the record behind it must be seen to know that it ends.
        self._usual_index_bytes = last + last // 8 + USUAL_INDEX_BYTES
        return found, end + last

    def _unread(self, index: Sequence[bytes], named: set[int], head: ChunkHead, start: int) -> Batch | None:
        """The messages of a chunk that is not read, without their bytes, in recorded order.

        The index alone is not trusted: the end of the file must agree with it, or a damaged
        index could hide messages. `None` where one of them is wanted, or in any doubt.
        """
        if not index or head.size < self.smallest_left_out_bytes or not named <= self._unwanted:
            return None
        try:
            entries = self._entries([index])
        except (struct.error, ValueError):
            return None
        offsets = entries.offsets
        # Two entries for one offset would count a message twice.
        if not len(offsets) or int(offsets.max()) >= head.size or len(np.unique(offsets)) != len(offsets):
            return None
        span_ns = int(entries.stamps_ns.min()), int(entries.stamps_ns.max())
        if head.span_ns not in (None, span_ns) or not self._is_announced(start, entries):
            return None
        order = np.argsort(offsets, kind="stable")
        nowhere, nothing = np.zeros(len(order), dtype=np.int64), np.zeros(0, dtype=np.uint8)
        heads = MessageHeads(entries.senders[order], entries.stamps_ns[order], nowhere, nowhere)
        return self._batch_of(_Places(nothing, heads), slice(0, len(order)))

    def _left_out(self, index: Sequence[bytes], head: ChunkHead) -> list[tuple[int, int]]:
        """The places of large unwanted payloads, if the index is right, which the heads will show."""
        small = head.size < max(self.smallest_left_out_bytes, LARGE_MESSAGE_BYTES)
        # A compressed chunk is inflated whole anyway.
        if not index or not self._unwanted or not head.plain or small:
            return []
        try:
            entries = self._entries([index])
        except (struct.error, ValueError):
            return []
        order = np.argsort(entries.offsets, kind="stable")
        offsets = entries.offsets[order]
        firsts, ends = offsets + self.message_head_bytes, np.append(offsets[1:], head.size)
        large = np.flatnonzero((ends - firsts >= LARGE_MESSAGE_BYTES) & (ends <= head.size))
        chosen = large[np.isin(entries.senders[order[large]], list(self._unwanted))]
        return list(zip(firsts[chosen].tolist(), ends[chosen].tolist(), strict=True))

    def left_out_of(
        self, source: Source, head: ChunkHead, end: int, unwanted: set[int]
    ) -> list[tuple[int, int]]:
        """The stretches of a chunk that are not read once its senders are known."""
        self._unwanted = unwanted
        return self._left_out(self._index_behind(source, end)[0], head)

    def _enqueue_parts(
        self, source: Source, slabs: Slabs, head: ChunkHead, left_out: Sequence[tuple[int, int]], start: int
    ) -> Chunk:
        """Queue a chunk without its large unwanted payloads.

        The room for them stays as it is, for the offsets of the index count from the start of the chunk.
        """
        records = source.offset

        def fill(room: memoryview) -> Callable[[], None]:
            at = 0
            for first, last in [*left_out, (head.size, head.size)]:
                source.take_into(room[at:first], "chunk")
                source.skip(last - first)
                at = last
            return nothing_to_do

        chunk = slabs.add(head.size, 0, start, fill)
        room = slabs.room_of(chunk)

        # Only called if the heads contradict the index; then the checksum, too, can be verified.
        def complete() -> None:
            source.read_at(records, room, "chunk")
            head.verify(room)

        chunk.complete = complete
        return chunk

    def _drained(self, source: Source, slabs: Iterable[Slab]) -> Iterator[Item]:
        """The records of queued chunks."""
        self._is_draining = True  # stays set if a chunk is damaged, for nothing behind it counts then
        for slab in slabs:
            chunks, failure = slab.finished()
            self._chunks += len(chunks)
            batch = self._batch_by_index(slab, chunks)
            if batch is not None:
                self._handed_over = chunks[-1].end
                yield batch
            else:
                yield from self._one_by_one(source, slab, chunks)
            if chunks:
                self._reached(chunks[-1].end)
            # Only now: the messages before the damage are handed over first.
            if failure is not None:
                at = slab.chunks[len(chunks)].start
                slab.empty()
                raise source.damaged(str(failure), what="chunk", at=at) from failure
        self._is_draining = False

    def _batch_by_index(self, slab: Slab, chunks: Sequence[Chunk]) -> Batch | None:
        """All messages of some chunks; `None` where chunks hold other records, or an index is wrong."""
        if not chunks or not all(chunk.index for chunk in chunks):
            return None
        try:
            places = self._indexed(slab.buffer, chunks)
        except (struct.error, ValueError):
            return None
        if [run[:2] for run in places.runs] != [(0, 0)]:
            return None  # there are records before, between or behind the messages
        if not all(number in self._connections for number in _distinct(places.heads.senders).tolist()):
            return None
        return self._batch_of(places, slice(0, len(places.heads.senders)))

    def _one_by_one(self, source: Source, slab: Slab, chunks: Sequence[Chunk]) -> Iterator[Item]:
        for chunk in chunks:
            try:
                if chunk.complete:
                    chunk.complete()
                    chunk.complete = None
                yield from self._chunk(slab, chunk)
            except (struct.error, ValueError) as error:
                slab.empty()
                raise source.damaged(str(error), what="chunk", at=chunk.start) from error
            self._reached(chunk.end)

    def _chunk(self, slab: Slab, chunk: Chunk) -> Iterator[Item]:
        """The records of a chunk: by its index, else by walking them, else one by one."""
        records = slab.buffer[chunk.first : chunk.last]
        places = None
        if chunk.index:
            try:
                places = self._indexed(records, [replace(chunk, first=0, last=len(records))])
            except (struct.error, ValueError):
                self._contradictions += 1
        if places is None:
            try:
                places = self._places(records, self._message_offsets(records.data))
            except (struct.error, ValueError):
                yield from self._items_in_chunk(records.data, chunk.start)
                return
        for gap, behind, first, last in places.runs:
            yield from self._items_in_chunk(records.data[gap:behind], chunk.start)
            yield from self._batch(places, first, last)

    def _places(self, buffer: Bytes, offsets: IntArray) -> _Places:
        """The messages whose records start at some places, increasing.

        Raises:
            ValueError: There is something else at a place, or another message in a gap.
            struct.error: Likewise.
        """
        heads = self._message_heads(buffer, offsets)
        # Gaps may hold declarations, but a message in one means that the index is incomplete.
        runs = tuple(gaps_between(offsets, heads.ends, len(buffer)))
        if any(len(self._message_offsets(buffer.data[gap:behind])) for gap, behind, _, _ in runs):
            raise ValueError("there are other messages")
        return _Places(buffer, heads, runs)

    def _indexed(self, buffer: Bytes, chunks: Sequence[Chunk]) -> _Places:
        """The messages of chunks that lie side by side in a buffer, by their indexes.

        Raises:
            ValueError: An index contradicts its chunk.
            struct.error: Likewise.
        """
        senders, stamps_ns, offsets, owners = self._entries([chunk.index for chunk in chunks])
        firsts = np.array([chunk.first for chunk in chunks], dtype=np.int64)
        lasts = np.array([chunk.last for chunk in chunks], dtype=np.int64)
        # Checked chunk by chunk: in the common buffer such an offset would point into the next one.
        if (offsets >= (lasts - firsts)[owners]).any():
            raise ValueError("the index leads out of its chunk")
        offsets = offsets + firsts[owners]
        order = np.argsort(offsets, kind="stable")
        offsets = offsets[order]
        places = self._places(buffer[: chunks[-1].last], offsets)
        heads = places.heads
        if (heads.senders != senders[order]).any() or (heads.stamps_ns != stamps_ns[order]).any():
            raise ValueError(f"the index names other times or {self.sender_kind}s")
        read = self.message_head_bytes
        if any(chunk.complete for chunk in chunks) and (heads.starts - offsets > read).any():
            raise ValueError("the heads of its messages are longer than what was read of them")
        check_not_crossed(offsets, heads.ends, lasts)
        return places

    def _batch(self, places: _Places, first: int, last: int) -> Iterator[Batch]:
        """Consecutive messages, up to the first whose sender is not declared."""
        senders = places.heads.senders[first:last]
        missing = [number for number in _distinct(senders).tolist() if number not in self._connections]
        if missing:
            last = first + int(np.argmax(np.isin(senders, missing)))
        if last > first:
            yield self._batch_of(places, slice(first, last))
        if missing:
            raise self._undeclared(int(places.heads.senders[last]))

    def _batch_of(self, places: _Places, rows: slice) -> Batch:
        heads = places.heads
        senders, starts, ends = heads.senders[rows], heads.starts[rows], heads.ends[rows]
        known = _distinct(senders)
        sources = np.searchsorted(known, senders)
        numbers = known.tolist()
        counts = np.bincount(sources, minlength=len(known)).tolist()
        self._found.update(dict(zip(numbers, counts, strict=True)))
        if self._unwanted:
            # Their payloads may not have been read.
            is_unwanted = np.array([number in self._unwanted for number in numbers], dtype=bool)
            ends = np.where(is_unwanted[sources], starts, ends)
        connections = tuple(self._connections[number] for number in numbers)
        numbered = None if heads.sequences is None else heads.sequences[rows]
        payloads = Payloads(places.buffer, starts, ends)
        return Batch(connections, sources, heads.stamps_ns[rows], payloads, numbered)

    def _message(
        self, sender: int, stamp_ns: int, payload: memoryview, start: int, sequence: int = 0
    ) -> Message:
        """A single message.

        Raises:
            ValueError: Its sender is not declared.
            LogError: Its log time is invalid.
        """
        if sender not in self._connections:
            raise self._undeclared(sender)
        checked_stamp(stamp_ns, file=self.path, place=f"message at byte {start}")
        self._found[sender] += 1
        return Message(self._connections[sender], stamp_ns, payload, sequence)

    def _undeclared(self, sender: int) -> ValueError:
        return ValueError(
            f"a message belongs to {self.sender_kind} {sender}, which is not declared before it"
        )

    def _declared(self, sender: int, connection: Connection) -> Connection:
        """Record a sender that was not declared before."""
        self._connections[sender] = connection
        if self._topics is not None and connection.topic not in self._topics:
            self._unwanted.add(sender)
        return connection


def _distinct(numbers: IntArray) -> IntArray:
    """The distinct ones of some non-negative numbers, increasing."""
    if int(numbers.max(initial=0)) >= _FEW_NUMBERS:
        return np.unique(numbers)
    # Recorders number from 0 or 1 on, and counting is several times as fast as sorting.
    return np.flatnonzero(np.bincount(numbers)).astype(np.int64)
