"""Scanning ROS 1 bags: every record in order.

Source: ROS wiki, "Bags/Format/2.0".
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Container, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score.errors import LogError
from ariac_score.logs.containers.chunk_buffers import Chunk, Slab, Slabs, entries_of, nothing_to_do
from ariac_score.logs.containers.inflating import check_announced, inflate_into
from ariac_score.logs.containers.items import (
    Batch,
    Bytes,
    Connection,
    IntArray,
    Message,
    Payloads,
    checked_stamp,
    normalised_type,
)
from ariac_score.logs.containers.record_index import check_not_crossed, gaps_between, records_at
from ariac_score.logs.containers.source import FileScan, Source

__all__ = ["MAGIC", "Ros1Scan"]

MAGIC = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_READ = frozenset({_MESSAGE, _CHUNK, _CHUNK_INFO, _CONNECTION})
_PART_ONLY = "'ariac-score info' shows what is left, but a score may not rest on part of a log"
_NOT_CLOSED = (
    "the bag has no index, so its recorder was killed before it closed the file: record again, and stop the "
    f"recorder with SIGINT (Ctrl-C); {_PART_ONLY}"
)
_CUT_OFF = (
    "the bag had an index, at byte {index}, and lost it: the disk was full or a copy did not finish; take "
    f"another copy, or record again; {_PART_ONLY}"
)

_WHAT = {
    _MESSAGE: "message",
    _BAG: "bag header",
    _INDEX: "index",
    _CHUNK: "chunk",
    _CHUNK_INFO: "chunk info",
    _CONNECTION: "connection",
}

_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")
_Header = Mapping[bytes, bytes]
_Item = Connection | Message | Batch

_LARGEST_INDEX_HEADER = 4096
_LARGEST_INDEX_BYTES = 64 << 20
_USUAL_INDEX_BYTES = 1 << 15
_RECORD_BYTES = 1 << 8
"""What an index record takes besides what it holds."""
_LARGE_MESSAGE_BYTES = 1 << 16
_HEAD_BYTES = 128
"""So much is read of a message whose payload is left out; recorders write heads of some 50 bytes."""


@dataclass(frozen=True, eq=False)
class _Places:
    """The messages of a chunk, and in `runs` what lies between them (see `gaps_between`)."""

    buffer: Bytes
    connections: IntArray
    stamps_ns: IntArray
    starts: IntArray
    ends: IntArray
    runs: Sequence[tuple[int, int, int, int]]

    @classmethod
    def of(cls, buffer: Bytes, offsets: IntArray) -> _Places:
        """Read where the messages at some offsets lie, whose headers must all be built alike.

        Raises:
            ValueError: There are other things than whole messages, or messages besides them.
        """
        nothing = np.zeros(0, dtype=np.int64)
        connections = stamps_ns = starts = ends = nothing
        if len(offsets):
            head, _ = _sized(buffer.data, int(offsets[0]))
            form, fixed = _form_of(bytes(head))
            words = records_at(buffer, offsets, form)
            for start, end in fixed:
                expected = bytes(buffer[offsets[0] + start : offsets[0] + end])
                if words[f"fixed{start}"].tobytes() != expected * len(words):
                    raise ValueError("the headers of its messages differ")
            connections = words["connection"].astype(np.int64)
            stamps_ns = words["sec"].astype(np.int64) * 10**9 + words["nanosec"]
            starts = offsets + form.itemsize
            ends = starts + words["length"]
        runs = tuple(gaps_between(offsets, ends, len(buffer)))
        for gap, behind, _, _ in runs:
            if len(_walked(buffer.data[gap:behind])):
                raise ValueError("there are other messages")
        return cls(buffer, connections, stamps_ns, starts, ends, runs)


def _form_of(head: bytes) -> tuple[np.dtype[Any], list[tuple[int, int]]]:
    """The form of messages with such a header, and the stretches of it that are the same in all."""
    connection_at, time_at = (4 + at for at in _built(head))
    words = {"connection": ("<u4", connection_at), "sec": ("<u4", time_at), "nanosec": ("<u4", time_at + 4)}
    words["length"] = ("<u4", 4 + len(head))
    free = sorted([(connection_at, connection_at + 4), (time_at, time_at + 8)])
    bounds = [0, free[0][0], free[0][1], free[1][0], free[1][1], 4 + len(head)]
    fixed = [(a, b) for a, b in zip(bounds[::2], bounds[1::2], strict=True) if b > a]
    words |= {f"fixed{a}": (f"V{b - a}", a) for a, b in fixed}
    formats, offsets = zip(*words.values(), strict=True)
    form = np.dtype({"names": list(words), "formats": formats, "offsets": offsets, "itemsize": 8 + len(head)})
    return form, fixed


def _built(head: bytes) -> tuple[int, int]:
    """Where connection and time stand in the header of a message, which has nothing besides."""
    header = _header(head)
    if _byte(header, b"op") != _MESSAGE or set(header) != {b"op", b"conn", b"time"}:
        raise ValueError("there is no plain message where one should be")
    _field(header, b"conn", 4)
    _field(header, b"time", 8)
    at, found = 0, dict[bytes, int]()
    while at < len(head):
        length = int.from_bytes(head[at : at + 4], "little")
        name = head[at + 4 : at + 4 + length].partition(b"=")[0]
        if name in found:
            raise ValueError("a field stands twice in the header of a message")
        found[name] = at + 4 + len(name) + 1
        at += 4 + length
    return found[b"conn"], found[b"time"]


def _walked(records: memoryview) -> IntArray:
    """Where the messages of a chunk are, by walking it."""
    at, found = 0, []
    while at < len(records):
        head, behind = _sized(records, at)
        if _byte(_header(head), b"op") == _MESSAGE:
            found.append(at)
        _, at = _sized(records, behind)
    return np.array(found, dtype=np.int64)


def _indexed(buffer: Bytes, chunks: Sequence[Chunk]) -> _Places:
    """Where the messages of chunks that lie side by side are, by their indexes.

    Raises:
        ValueError: An index contradicts its chunk.
    """
    named, counts, entries, owners = entries_of(chunks, head=4, words=3)
    seconds, nanoseconds, offsets = entries.astype(np.int64).T
    connections = np.repeat(_numbers(named), counts)
    firsts, lasts = (np.array([getattr(c, end) for c in chunks], dtype=np.int64) for end in ("first", "last"))
    if (offsets >= (lasts - firsts)[owners]).any():
        raise ValueError("the index leads out of its chunk")
    offsets = offsets + firsts[owners]
    order = np.argsort(offsets, kind="stable")
    places = _Places.of(buffer[: chunks[-1].last], offsets[order])
    stamps_ns = seconds * 10**9 + nanoseconds
    if (places.stamps_ns != stamps_ns[order]).any() or (places.connections != connections[order]).any():
        raise ValueError("the index tells other times or connections")
    if any(chunk.complete for chunk in chunks) and (places.starts - offsets[order] > _HEAD_BYTES).any():
        raise ValueError("the heads of its messages are longer than what was read of them")
    check_not_crossed(offsets[order], places.ends, lasts)
    return places


def _numbers(named: Sequence[bytes]) -> IntArray:
    """The connections that index records are about."""
    return np.frombuffer(b"".join(named), dtype="<u4").astype(np.int64)


class Ros1Scan(FileScan):
    """One ROS 1 bag; see `ariac_score.logs.containers.items.Scan`."""

    format = "ROS 1 bag"

    def __init__(self, path: Path, *, jobs: int = 0, topics: Container[str] | None = None) -> None:
        super().__init__(path)
        self._jobs, self._topics = jobs, topics
        self._deaf: set[int] = set()
        self._contents: _Contents | None = None
        self._connections: dict[int, Connection] = {}
        self._found: Counter[int] = Counter()
        self._announced: Counter[int] = Counter()
        self._chunks = self._chunk_infos = 0
        self._index_at = 0

    def __iter__(self) -> Iterator[_Item]:
        """Every declared connection and message, in recorded order.

        Raises:
            LogError: The file is not whole; see `readable`.
        """
        with Source(self.path) as source:
            self._source = source
            if source.take(min(len(MAGIC), source.size), "magic") != MAGIC:
                raise source.damaged("the file does not start as a ROS 1 bag of version 2.0 does", at=0)
            announced = self._bag_header(source)
            if self._topics is not None and self._index_at:
                self._contents = _contents_at(source, self._index_at)
            with Slabs(self._jobs) as slabs:
                try:
                    while source.left:
                        yield from self._record(source, slabs)
                    yield from self._settled(source, slabs.rest())
                except LogError:
                    if not self._is_settling:
                        # What is before the damage counts, and damage in it is told instead.
                        yield from self._settled(source, slabs.rest())
                    raise
            self._reached(source.offset)
            self._check_whole(source, *announced)

    def _bag_header(self, source: Source) -> tuple[int, int]:
        """What the header announces: connections and chunks."""
        start = source.offset
        try:
            header = _header(source.take(_u32(source, "bag header"), "bag header"))
            if _byte(header, b"op") != _BAG:
                raise ValueError("the first record is not the bag header")
            if header.get(b"encryptor"):
                raise ValueError("the bag is encrypted")
            self._index_at = int.from_bytes(_field(header, b"index_pos", 8), "little")
            if not self._index_at:
                source.hint = _NOT_CLOSED
            elif self._index_at >= source.size:
                source.hint = _CUT_OFF.format(index=self._index_at)
            connections, chunks = (_number(header, name) for name in (b"conn_count", b"chunk_count"))
        except ValueError as error:
            raise source.damaged(str(error), what="bag header", at=start) from error
        for _ in source.blocks(_u32(source, "bag header"), "bag header"):
            pass
        return connections, chunks

    def _record(self, source: Source, slabs: Slabs) -> Iterator[_Item]:
        """Read one record; chunks are held together with their index, and inflated meanwhile."""
        start = source.offset
        try:
            header = _header(source.take(_u32(source, "record"), "record"))
            op = _byte(header, b"op")
        except ValueError as error:
            yield from self._settled(source, slabs.rest())
            raise source.damaged(str(error), what="record", at=start) from error
        what = _WHAT.get(op, f"record of type {op}")
        length = _u32(source, what)
        if op == _CHUNK and length <= source.left:
            yield from self._hold(source, slabs, header, length, start)
            return
        if op == _INDEX:
            for _ in source.blocks(length, what):
                pass
            return
        yield from self._settled(source, slabs.rest())
        if op == _CHUNK:
            yield from self._cut_chunk(source, header, start)
        if op not in _READ:
            for _ in source.blocks(length, what):
                pass
            return
        try:
            yield from self._items(op, header, memoryview(source.take(length, what)), start)
        except (struct.error, ValueError) as error:
            raise source.damaged(str(error), what=what, at=start) from error
        self._reached(source.offset)

    def _hold(
        self, source: Source, slabs: Slabs, header: _Header, length: int, start: int
    ) -> Iterator[_Item]:
        """Read a chunk and its index; its records are inflated on the way."""
        try:
            compression, size = _text(header, b"compression"), _number(header, b"size")
            check_announced(size, length)
            plain = compression == "none"
            if plain and size != length:
                raise ValueError(f"it holds {length} bytes instead of the announced {size}")
            index, behind = _index_at(source, source.offset + length)
            unread = yield from self._passed_over(source, slabs, index, size, start)
            if not unread:
                packed = 0 if plain else length
                yield from self._settled(source, slabs.turn(size, packed))
        except ValueError as error:
            yield from self._settled(source, slabs.rest())
            raise source.damaged(str(error), what="chunk", at=start) from error
        if unread:
            source.skip(behind - source.offset)
            self._reached(source.offset)
            return

        def filled(room: memoryview) -> Callable[[], None]:
            if plain:
                source.take_into(room, "chunk")
                return nothing_to_do
            return partial(inflate_into, room, source.take(length, "chunk"), compression)

        left_out = self._left_out(index, size) if plain else []
        if left_out:
            chunk = self._hold_parts(source, slabs, size, left_out, start)
        else:
            chunk = slabs.add(size, packed, start, filled)
        chunk.index, chunk.end = index, behind
        source.skip(behind - source.offset)

    def _passed_over(
        self, source: Source, slabs: Slabs, index: Sequence[bytes], size: int, start: int
    ) -> Generator[_Item, None, bool]:
        """Whether a chunk holds no wanted message, and can declare nothing either: then it is not read.

        Its messages come without their bytes, as the index tells of them.
        """
        if self._topics is None or not index or self._contents is None:
            return False
        named = {int.from_bytes(body[:4], "little") for body in index}
        if not named <= self._connections.keys():
            # They are declared in what was read and not looked at yet, or here.
            yield from self._settled(source, slabs.rest())
        if not named <= self._deaf or not self._contents.connections <= self._connections.keys():
            return False
        unread = self._unread(index, size, self._contents.chunks.get(start))
        if unread is None:
            return False
        yield from self._settled(source, slabs.rest())
        yield unread
        self._chunks += 1
        return True

    def _unread(self, index: Sequence[bytes], size: int, announced: _Announced | None) -> Batch | None:
        """What the index says of a chunk that is not read: senders and times, in recorded order.

        `None` where it cannot be right: then the records are to tell.
        """
        try:
            connections, stamps_ns, offsets = _told(index)
        except ValueError:
            return None
        if int(offsets.max()) >= size or len(np.unique(offsets)) != len(offsets):
            return None
        span_ns = int(stamps_ns.min()), int(stamps_ns.max())
        if announced is None or (span_ns, Counter(connections.tolist())) != announced:
            return None
        order = np.argsort(offsets, kind="stable")
        nowhere = np.zeros(len(order), dtype=np.int64)
        nothing = np.zeros(0, dtype=np.uint8)
        places = _Places(nothing, connections[order], stamps_ns[order], nowhere, nowhere, ())
        return self._batch_of(places, slice(0, len(order)), np.unique(connections))

    def _left_out(self, index: Sequence[bytes], size: int) -> list[tuple[int, int]]:
        """Where large messages lie that nobody wants, if the index is right: their heads will tell."""
        if not index or not self._deaf:
            return []
        try:
            connections, _, offsets = _told(index)
        except ValueError:
            return []
        order = np.argsort(offsets, kind="stable")
        first = offsets[order] + _HEAD_BYTES
        ends = np.append(offsets[order][1:], size)
        deaf = np.isin(connections[order], list(self._deaf))
        chosen = deaf & (ends - first >= _LARGE_MESSAGE_BYTES) & (ends <= size)
        return list(zip(first[chosen].tolist(), ends[chosen].tolist(), strict=True))

    def _hold_parts(
        self, source: Source, slabs: Slabs, size: int, left_out: Sequence[tuple[int, int]], start: int
    ) -> Chunk:
        """Read a chunk but for large messages that nobody wants."""
        records = source.offset

        def filled(room: memoryview) -> Callable[[], None]:
            at = 0
            for first, last in [*left_out, (size, size)]:
                source.take_into(room[at:first], "chunk")
                source.skip(last - first)
                at = last
            return nothing_to_do

        chunk = slabs.add(size, 0, start, filled)
        room = slabs.room_of(chunk)
        chunk.complete = lambda: source.read_at(records, room, "chunk")
        return chunk

    def _settled(self, source: Source, slabs: Iterable[Slab]) -> Iterator[_Item]:
        """The records of the chunks that are held."""
        self._is_settling = True  # and stays so where one is damaged: what is behind it does not count
        for slab in slabs:
            chunks, failure = slab.finished()
            self._chunks += len(chunks)
            batch = self._together(slab, chunks)
            if batch is not None:
                self._hands_over(chunks[-1].end)
                yield batch
            else:
                yield from self._one_by_one(source, slab, chunks)
            if chunks:
                self._reached(chunks[-1].end)
            if failure is not None:
                at = slab.chunks[len(chunks)].start
                slab.empty()
                raise source.damaged(str(failure), what="chunk", at=at) from failure
        self._is_settling = False

    def _together(self, slab: Slab, chunks: Sequence[Chunk]) -> Batch | None:
        """All messages of some chunks; `None` where they hold more, or their index is not as it should be."""
        if not chunks or not all(chunk.index for chunk in chunks):
            return None
        try:
            places = _indexed(slab.buffer, chunks)
        except (struct.error, ValueError):
            return None
        known = np.unique(places.connections)
        if len(places.runs) != 1 or not all(key in self._connections for key in known.tolist()):
            return None
        return self._batch_of(places, slice(0, len(places.connections)), known)

    def _one_by_one(self, source: Source, slab: Slab, chunks: Sequence[Chunk]) -> Iterator[_Item]:
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

    def _chunk(self, slab: Slab, chunk: Chunk) -> Iterator[_Item]:
        """The records of a chunk: by its index, else by walking them, else one by one."""
        records = slab.buffer[chunk.first : chunk.last]
        places = None
        if chunk.index:
            try:
                places = _indexed(records, [replace(chunk, first=0, last=len(records))])
            except (struct.error, ValueError):
                self._contradictions += 1
        if places is None:
            try:
                places = _Places.of(records, _walked(records.data))
            except (struct.error, ValueError):
                yield from self._records_in_chunk(records.data, chunk.start)
                return
        for gap, behind, first, last in places.runs:
            yield from self._records_in_chunk(records.data[gap:behind], chunk.start)
            yield from self._batch(places, first, last)

    def _batch_of(self, places: _Places, rows: slice, known: IntArray) -> Batch:
        sources = np.searchsorted(known, places.connections[rows])
        counts = np.bincount(sources, minlength=len(known)).tolist()
        self._found.update(dict(zip(known.tolist(), counts, strict=True)))
        starts, ends = places.starts[rows], places.ends[rows]
        if self._deaf:
            # They may not have been read.
            ends = np.where(np.isin(places.connections[rows], list(self._deaf)), starts, ends)
        payloads = Payloads(places.buffer, starts, ends)
        senders = tuple(self._connections[key] for key in known.tolist())
        return Batch(senders, sources, places.stamps_ns[rows], payloads)

    def _batch(self, places: _Places, first: int, last: int) -> Iterator[_Item]:
        """Messages that follow each other, up to the first whose connection is not declared."""
        numbers = places.connections[first:last]
        known = np.unique(numbers)
        missing = [key for key in known.tolist() if key not in self._connections]
        if missing:
            last = first + int(np.argmax(np.isin(numbers, missing)))
            numbers = places.connections[first:last]
            known = np.unique(numbers)
        if last > first:
            yield self._batch_of(places, slice(first, last), known)
        if missing:
            raise ValueError(
                f"a message belongs to connection {int(places.connections[last])}, "
                "which is not declared before it"
            )

    def _items(self, op: int, header: _Header, body: memoryview, start: int) -> Iterator[_Item]:
        if op == _MESSAGE:
            yield self._message(header, body, start)
        elif op == _CONNECTION:
            yield from self._declare(header, body)
        elif op == _CHUNK_INFO:
            self._chunk_infos += 1
            for at in range(0, 8 * _number(header, b"count"), 8):
                connection, count = _TIME.unpack_from(body, at)
                self._announced[connection] += count

    def _cut_chunk(self, source: Source, header: _Header, start: int) -> Iterator[_Item]:
        """The whole records of a chunk that the file ends in, where it is not compressed."""
        try:
            if _text(header, b"compression") == "none":
                yield from self._records_in_chunk(memoryview(source.peek(source.left)), start)
        except (struct.error, ValueError):
            return  # it ends in the middle of a record: `take` says so
        finally:
            self._readable = f"byte {source.size}"

    def _records_in_chunk(self, records: memoryview, start: int) -> Iterator[_Item]:
        at = 0
        while at < len(records):
            head, at = _sized(records, at)
            body, at = _sized(records, at)
            header = _header(head)
            op = _byte(header, b"op")
            if op not in (_MESSAGE, _CONNECTION):
                raise ValueError(f"it holds a record of type {op}, which cannot be there")
            yield from self._items(op, header, body, start)

    def _message(self, header: _Header, body: memoryview, start: int) -> Message:
        number = _number(header, b"conn")
        if number not in self._connections:
            raise ValueError(f"a message belongs to connection {number}, which is not declared before it")
        seconds, nanoseconds = _TIME.unpack(_field(header, b"time", 8))
        stamp_ns = checked_stamp(
            seconds * 10**9 + nanoseconds, file=self.path, place=f"message at byte {start}"
        )
        self._found[number] += 1
        return Message(self._connections[number], stamp_ns, body)

    def _declare(self, header: _Header, body: memoryview) -> Iterator[Connection]:
        number, topic = _number(header, b"conn"), _text(header, b"topic")
        facts = _header(body)
        type_ = normalised_type(_text(facts, b"type"))
        if number in self._connections:
            known = self._connections[number]
            if (known.topic, known.type) != (topic, type_):
                raise ValueError(f"connection {number} is declared twice, differently")
            return
        definition = _text(facts, b"message_definition")
        connection = Connection(topic, type_, "ros1", definition, "ros1msg" if definition else "")
        self._connections[number] = connection
        if self._topics is not None and topic not in self._topics:
            self._deaf.add(number)
        yield connection

    def _check_whole(self, source: Source, connections: int, chunks: int) -> None:
        if not self._index_at:
            raise source.damaged(
                "the bag was never closed: it has no index, and its end may be missing; "
                "`rosbag reindex` makes a copy with what is there"
            )
        found = (len(self._connections), self._chunks, self._chunk_infos)
        if found != (connections, chunks, chunks):
            raise source.damaged(
                f"the bag header announces {connections} connections and {chunks} chunks, "
                f"the file holds {found[0]} and {found[1]}, with {found[2]} in its index"
            )
        if chunks and +self._announced != +self._found:
            raise source.damaged(
                f"the index announces {self._announced.total()} messages, the chunks hold "
                f"{self._found.total()}, or they belong to other connections"
            )


def _index_at(source: Source, start: int) -> tuple[list[bytes], int]:
    """The index records from some byte on, up to the first that is cut off or wrong, and where they end.

    Of each comes its connection and its entries.
    """
    found: list[bytes] = []
    at, window, room = 0, source.at(start, _USUAL_INDEX_BYTES), _LARGEST_INDEX_BYTES

    def seen(behind: int) -> bool:
        nonlocal window
        if behind > len(window):
            more = max(behind - len(window) + _USUAL_INDEX_BYTES, len(window))
            window += source.at(start + len(window), more)
        return behind <= len(window)

    while seen(at + 4):
        size = int.from_bytes(window[at : at + 4], "little")
        body = at + 8 + size
        if size > _LARGEST_INDEX_HEADER or not seen(body):
            break
        length = int.from_bytes(window[body - 4 : body], "little")
        room -= length + _RECORD_BYTES
        try:
            header = _header(window[at + 4 : at + 4 + size])
            if _byte(header, b"op") != _INDEX:
                break
            connection = _field(header, b"conn", 4)
        except ValueError:
            break
        if not length or room < 0 or not seen(body + length):
            break
        found.append(connection + window[body : body + length])
        at = body + length
    return found, start + at


def _told(index: Sequence[bytes]) -> tuple[IntArray, IntArray, IntArray]:
    """What the index of a chunk tells of each message: connection, time and place.

    Raises:
        ValueError: It is no list of entries.
    """
    named, counts, entries, _ = entries_of([Chunk(0, 0, 0, 0, nothing_to_do, list(index))], head=4, words=3)
    seconds, nanoseconds, offsets = entries.astype(np.int64).T
    return np.repeat(_numbers(named), counts), seconds * 10**9 + nanoseconds, offsets


_Announced = tuple[tuple[int, int], Counter[int]]
"""Of a chunk the earliest and the latest log time, ns, and the messages of each connection."""


@dataclass(frozen=True)
class _Contents:
    """What the end of a bag says is in it.

    Attributes:
        connections: All that are declared there.
        chunks: What is announced of each chunk, by its start.
    """

    connections: frozenset[int]
    chunks: Mapping[int, _Announced]


def _stamp_ns(header: _Header, name: bytes) -> int:
    seconds, nanoseconds = _TIME.unpack(_field(header, name, 8))
    return int(seconds) * 10**9 + int(nanoseconds)


def _contents_at(source: Source, at: int) -> _Contents | None:
    """What stands at the end of a bag; `None` when it is not understood."""
    records, connections, here = memoryview(source.at(at, source.size)), set[int](), 0
    if at + len(records) < source.size:
        return None  # so large that it is not worth it
    chunks: dict[int, _Announced] = {}
    try:
        while here < len(records):
            head, behind = _sized(records, here)
            body, here = _sized(records, behind)
            header = _header(head)
            if _byte(header, b"op") == _CONNECTION:
                connections.add(_number(header, b"conn"))
            elif _byte(header, b"op") == _CHUNK_INFO:
                start = int.from_bytes(_field(header, b"chunk_pos", 8), "little")
                first_ns, last_ns = (_stamp_ns(header, name) for name in (b"start_time", b"end_time"))
                told = Counter[int]()
                for entry in range(0, 8 * _number(header, b"count"), 8):
                    connection, count = _TIME.unpack_from(body, entry)
                    told[connection] += count
                chunks[start] = (first_ns, last_ns), told
    except (struct.error, ValueError):
        return None
    return _Contents(frozenset(connections), chunks)


def _u32(source: Source, what: str) -> int:
    number: int = _U32.unpack(source.take(4, what))[0]
    return number


def _sized(records: memoryview, at: int) -> tuple[memoryview, int]:
    """Bytes with their length before them, and where the next ones start."""
    (length,) = _U32.unpack_from(records, at)
    end = at + 4 + length
    if end > len(records):
        raise ValueError(f"a record of {length} bytes, {at} bytes in, is longer than its chunk")
    return records[at + 4 : end], end


def _header(raw: bytes | memoryview) -> _Header:
    """The fields of a record header by name."""
    packed, at = bytes(raw), 0
    fields: dict[bytes, bytes] = {}
    while at < len(packed):
        start, end = at + 4, at + 4 + int.from_bytes(packed[at : at + 4], "little")
        name, sign, value = packed[start:end].partition(b"=")
        if not sign or end > len(packed):
            raise ValueError(f"a field of a record header, {at} bytes in, has no name or is longer than it")
        fields[name] = value
        at = end
    return fields


def _field(header: _Header, name: bytes, length: int | None = None) -> bytes:
    value = header.get(name)
    if value is None or length not in (None, len(value)):
        raise ValueError(f"a record header lacks a proper field {name.decode()!r}")
    return value


def _number(header: _Header, name: bytes) -> int:
    return int.from_bytes(_field(header, name, 4), "little")


def _byte(header: _Header, name: bytes) -> int:
    return _field(header, name, 1)[0]


def _text(header: _Header, name: bytes) -> str:
    return _field(header, name).decode("utf-8", errors="replace")
