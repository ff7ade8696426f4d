"""Scanning ROS 1 bags: every record in order.

Source: ROS wiki, "Bags/Format/2.0".
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score.logs.containers.chunk_buffers import Slabs, nothing_to_do
from ariac_score.logs.containers.chunked import ChunkedScan, ChunkHead, Lookahead, MessageHeads, Outline
from ariac_score.logs.containers.inflating import check_announced, inflate_into, inflate_start
from ariac_score.logs.containers.items import (
    Bytes,
    Connection,
    IntArray,
    Item,
    normalised_type,
)
from ariac_score.logs.containers.record_index import IndexEntries, entries_of, records_at
from ariac_score.logs.containers.source import Source

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

_LARGEST_INDEX_HEADER = 4096


def _form_of(head: bytes) -> tuple[np.dtype[Any], list[tuple[int, int]]]:
    """The layout of records with such a header, and the stretches of it that all of them share."""
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
    """The places of connection and time in the header of a message, which has no other fields but `op`."""
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


class Ros1Scan(ChunkedScan):
    """One ROS 1 bag; see `ariac_score.logs.containers.items.Scan`."""

    format = "ROS 1 bag"
    sender_kind, sender_bytes = "connection", 4
    # Headers are lists of fields of any length and order; recorders write some 50 bytes.
    message_head_bytes = 128

    def __init__(self, path: Path, **options: Any) -> None:
        super().__init__(path, **options)
        self._contents: _Contents | None = None
        self._announced: Counter[int] = Counter()
        self._announced_connections = self._announced_chunks = self._chunk_infos = 0
        self._index_at = 0

    def _open(self, source: Source) -> None:
        if source.take(min(len(MAGIC), source.size), "magic") != MAGIC:
            raise source.damaged("the file does not start as a ROS 1 bag of version 2.0 does", at=0)
        self._announced_connections, self._announced_chunks = self._bag_header(source)
        if self._topics is not None and self._index_at:
            self._contents = _contents_at(source, self._index_at)

    def _bag_header(self, source: Source) -> tuple[int, int]:
        """The numbers of connections and chunks that the bag header announces."""
        start = source.offset
        try:
            header = _header(source.take(_u32(source, "bag header"), "bag header"))
            if _byte(header, b"op") != _BAG:
                raise ValueError("the first record is not the bag header")
            if header.get(b"encryptor"):
                raise ValueError("the bag is encrypted")
            # A recorder writes 0 at first and the place of the index when it closes the bag.
            self._index_at = int.from_bytes(_field(header, b"index_pos", 8), "little")
            if not self._index_at:
                source.hint = _NOT_CLOSED
            elif self._index_at >= source.size:
                source.hint = _CUT_OFF.format(index=self._index_at)
            connections, chunks = (_number(header, name) for name in (b"conn_count", b"chunk_count"))
        except ValueError as error:
            raise source.damaged(str(error), what="bag header", at=start) from error
        for _ in source.blocks(_u32(source, "bag header"), "bag header"):
            pass  # padding, so that the header can be rewritten in place
        return connections, chunks

    def _records(self, source: Source, slabs: Slabs) -> Iterator[Item]:
        while source.left:
            yield from self._record(source, slabs)

    def _record(self, source: Source, slabs: Slabs) -> Iterator[Item]:
        start = source.offset
        try:
            header = _header(source.take(_u32(source, "record"), "record"))
            op = _byte(header, b"op")
        except ValueError as error:
            yield from self._drained(source, slabs.rest())
            raise source.damaged(str(error), what="record", at=start) from error
        what = _WHAT.get(op, f"record of type {op}")
        length = _u32(source, what)
        if op == _CHUNK and not length and source.left and _is_packed(header):
            # A recorder writes the length of a chunk when it is done with it.
            yield from self._drained(source, slabs.rest())
            yield from self._cut_chunk(source, header, start)
            raise source.cut_off("its recorder was killed while it wrote this chunk", what=what, at=start)
        if op == _CHUNK and length <= source.left:
            read_head = partial(_chunk_head, header, length)
            yield from self._enqueue_chunk(source, slabs, read_head, length, start)
            return
        if op == _INDEX:  # not read together with its chunk: damaged, or behind something else
            for _ in source.blocks(length, what):
                pass
            return
        yield from self._drained(source, slabs.rest())
        if op == _CHUNK:  # longer than the rest of the file
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

    def _fill(self, source: Source, head: ChunkHead, room: memoryview) -> Callable[[], None]:
        if head.plain:
            source.take_into(room, "chunk")
            return nothing_to_do
        return partial(inflate_into, room, source.take(head.packed, "chunk"), head.compression)

    def _index_records(self, ahead: Lookahead) -> Iterator[tuple[bytes, int]]:
        """Each index record up to the first that is cut off or wrong: its connection and its entries."""
        at = 0
        while ahead.reaches(at + 4):
            size = int.from_bytes(ahead.bytes[at : at + 4], "little")
            first = at + 8 + size
            if size > _LARGEST_INDEX_HEADER or not ahead.reaches(first):
                return
            length = int.from_bytes(ahead.bytes[first - 4 : first], "little")
            try:
                header = _header(ahead.bytes[at + 4 : at + 4 + size])
                if _byte(header, b"op") != _INDEX:
                    return
                connection = _field(header, b"conn", 4)
            except ValueError:
                return
            at = first + length
            if not length or not ahead.reaches(at):
                return
            yield connection + ahead.bytes[first:at], at

    def outline(self, source: Source) -> Outline | None:
        """The contents by the end of the bag; `None` where it has none."""
        self._open(source)
        if self._contents is None or not self._contents.chunks:
            return None
        senders = {start: counts.keys() for start, (_, counts) in self._contents.chunks.items()}
        return Outline(self._contents.topics, senders, declares_all=False)

    def chunk_at(self, source: Source, start: int) -> ChunkHead:
        """Read the head of a chunk, and move on to its records."""
        source.skip(start - source.offset)
        header = _header(source.take(_u32(source, "chunk"), "chunk"))
        length = _u32(source, "chunk")
        if _byte(header, b"op") != _CHUNK or length > source.left:
            raise ValueError("there is no chunk where one should be")
        return _chunk_head(header, length)

    def _is_announced(self, start: int, entries: IndexEntries) -> bool:
        if self._contents is None or not self._contents.topics.keys() <= self._connections.keys():
            return False  # the chunk may be the one that declares a connection
        span_ns = int(entries.stamps_ns.min()), int(entries.stamps_ns.max())
        return (span_ns, Counter(entries.senders.tolist())) == self._contents.chunks.get(start)

    @staticmethod
    def _entries(indexes: Sequence[Sequence[bytes]]) -> IndexEntries:
        named, counts, entries, owners = entries_of(indexes, head=4, words=3)
        seconds, nanoseconds, offsets = entries.astype(np.int64).T
        connections = np.frombuffer(b"".join(named), dtype="<u4").astype(np.int64)
        return IndexEntries(np.repeat(connections, counts), seconds * 10**9 + nanoseconds, offsets, owners)

    @staticmethod
    def _message_offsets(records: memoryview) -> IntArray:
        at, found = 0, []
        while at < len(records):
            head, behind = _sized(records, at)
            if _byte(_header(head), b"op") == _MESSAGE:
                found.append(at)
            _, at = _sized(records, behind)
        return np.array(found, dtype=np.int64)

    @staticmethod
    def _message_heads(buffer: Bytes, offsets: IntArray) -> MessageHeads:
        """The headers of messages, which must all be built like the first one."""
        if not len(offsets):
            return MessageHeads(offsets, offsets, offsets, offsets)
        # One recorder writes all headers alike, field by field; only connection and time differ.
        head, _ = _sized(buffer.data, int(offsets[0]))
        form, fixed = _form_of(bytes(head))
        words = records_at(buffer, offsets, form)
        for start, end in fixed:
            expected = bytes(buffer[offsets[0] + start : offsets[0] + end])
            if words[f"fixed{start}"].tobytes() != expected * len(words):
                raise ValueError("the headers of its messages differ")
        stamps_ns = words["sec"].astype(np.int64) * 10**9 + words["nanosec"]
        starts = offsets + form.itemsize
        return MessageHeads(words["connection"].astype(np.int64), stamps_ns, starts, starts + words["length"])

    def _items(self, op: int, header: _Header, body: memoryview, start: int) -> Iterator[Item]:
        if op == _MESSAGE:
            sender, stamp_ns = _number(header, b"conn"), _stamp_ns(header, b"time")
            yield self._message(sender, stamp_ns, body, start)
        elif op == _CONNECTION:
            yield from self._declare(header, body)
        elif op == _CHUNK_INFO:
            self._chunk_infos += 1
            for at in range(0, 8 * _number(header, b"count"), 8):
                connection, count = _TIME.unpack_from(body, at)
                self._announced[connection] += count

    def _cut_chunk(self, source: Source, header: _Header, start: int) -> Iterator[Item]:
        """The whole records of a chunk that the file ends in."""
        try:
            records = inflate_start(source.peek(source.left), _text(header, b"compression"))
            yield from self._items_in_chunk(memoryview(records), start)
        except (struct.error, ValueError):
            return  # it ends in the middle of a record, which `take` reports
        finally:
            self._readable = f"byte {source.size}"

    def _items_in_chunk(self, records: memoryview, start: int) -> Iterator[Item]:
        at = 0
        while at < len(records):
            head, at = _sized(records, at)
            body, at = _sized(records, at)
            header = _header(head)
            op = _byte(header, b"op")
            if op not in (_MESSAGE, _CONNECTION):
                raise ValueError(f"it holds a record of type {op}, which cannot be there")
            yield from self._items(op, header, body, start)

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
        form = "ros1msg" if definition else ""
        publisher = facts.get(b"callerid", b"").decode("utf-8", errors="replace")
        yield self._declared(number, Connection(topic, type_, "ros1", definition, form, publisher))

    def _close(self, source: Source) -> None:
        self._reached(source.offset)
        connections, chunks = self._announced_connections, self._announced_chunks
        if not self._index_at:
            raise source.cut_off(
                "the bag was never closed: it has no index, and its end may be missing; "
                "`rosbag reindex` makes a copy with what is there"
            )
        # ROS 1 bags have no checksums, so these counts are the only evidence that nothing is missing.
        found = (len(self._connections), self._chunks, self._chunk_infos)
        if found != (connections, chunks, chunks):
            # All that is lost may be the end: of the index, or of the file before it.
            lost_end = found[2] < chunks and (
                found[:2] == (connections, chunks) or self._index_at >= source.size
            )
            raise (source.cut_off if lost_end else source.damaged)(
                f"the bag header announces {connections} connections and {chunks} chunks, "
                f"the file holds {found[0]} and {found[1]}, with {found[2]} in its index"
            )
        # `+` drops connections without messages, which need not be announced.
        if chunks and +self._announced != +self._found:
            raise source.damaged(
                f"the index announces {self._announced.total()} messages, the chunks hold "
                f"{self._found.total()}, or they belong to other connections"
            )


def _is_packed(header: _Header) -> bool:
    return header.get(b"compression", b"none") != b"none"


def _chunk_head(header: _Header, length: int) -> ChunkHead:
    """The head of a chunk, from its header and the bytes that follow it.

    Raises:
        ValueError: It contradicts itself.
    """
    head = ChunkHead(_number(header, b"size"), length, _text(header, b"compression"))
    check_announced(head.size, length)
    if head.plain and head.size != length:
        raise ValueError(f"it holds {length} bytes instead of the announced {head.size}")
    return head


_Announced = tuple[tuple[int, int], Counter[int]]
"""The earliest and the latest log time of a chunk, ns, and its number of messages by connection."""


@dataclass(frozen=True)
class _Contents:
    """The contents of a bag by its index section.

    Attributes:
        topics: Of all connections that are declared there.
        chunks: What is announced of each chunk, by its start.
    """

    topics: Mapping[int, str]
    chunks: Mapping[int, _Announced]


def _stamp_ns(header: _Header, name: bytes) -> int:
    seconds, nanoseconds = _TIME.unpack(_field(header, name, 8))
    return int(seconds) * 10**9 + int(nanoseconds)


def _contents_at(source: Source, at: int) -> _Contents | None:
    """The index section of a bag; `None` when it is not understood."""
    records, topics, here = memoryview(source.at(at, source.size)), dict[int, str](), 0
    if at + len(records) < source.size:
        return None  # larger than `MAX_PEEK_BYTES`
    chunks: dict[int, _Announced] = {}
    try:
        while here < len(records):
            head, behind = _sized(records, here)
            body, here = _sized(records, behind)
            header = _header(head)
            if _byte(header, b"op") == _CONNECTION:
                topics[_number(header, b"conn")] = _text(header, b"topic")
            elif _byte(header, b"op") == _CHUNK_INFO:
                start = int.from_bytes(_field(header, b"chunk_pos", 8), "little")
                first_ns, last_ns = (_stamp_ns(header, name) for name in (b"start_time", b"end_time"))
                counts = Counter[int]()
                for entry in range(0, 8 * _number(header, b"count"), 8):
                    connection, count = _TIME.unpack_from(body, entry)
                    counts[connection] += count
                chunks[start] = (first_ns, last_ns), counts
    except (struct.error, ValueError):
        return None
    return _Contents(topics, chunks)


def _u32(source: Source, what: str) -> int:
    number: int = _U32.unpack(source.take(4, what))[0]
    return number


def _sized(records: memoryview, at: int) -> tuple[memoryview, int]:
    """Bytes that follow their length, and where the next ones start."""
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
