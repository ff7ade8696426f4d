"""Scanning ROS 1 bags: every record in order.

Source: ROS wiki, "Bags/Format/2.0".
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

from ariac_score.logs.salvage import (
    Connection,
    FileScan,
    Message,
    Source,
    checked_stamp,
    inflate,
    normalised_type,
)

__all__ = ["MAGIC", "Ros1Scan"]

MAGIC = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 5, 6, 7
_READ = frozenset({_MESSAGE, _CHUNK, _CHUNK_INFO, _CONNECTION})
_WHAT = {
    _MESSAGE: "message",
    _BAG: "bag header",
    4: "index",
    _CHUNK: "chunk",
    _CHUNK_INFO: "chunk info",
    _CONNECTION: "connection",
}

_U32 = struct.Struct("<I")
_TIME = struct.Struct("<II")
_Header = Mapping[bytes, bytes]
_Item = Connection | Message


class Ros1Scan(FileScan):
    """One ROS 1 bag; see `ariac_score.logs.salvage.Scan`."""

    format = "ROS 1 bag"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
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
            while source.left:
                yield from self._record(source)
                self._readable = f"byte {source.offset}"
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
            connections, chunks = (_number(header, name) for name in (b"conn_count", b"chunk_count"))
        except ValueError as error:
            raise source.damaged(str(error), what="bag header", at=start) from error
        for _ in source.blocks(_u32(source, "bag header"), "bag header"):
            pass
        return connections, chunks

    def _record(self, source: Source) -> Iterator[_Item]:
        start = source.offset
        try:
            header = _header(source.take(_u32(source, "record"), "record"))
            op = _byte(header, b"op")
        except ValueError as error:
            raise source.damaged(str(error), what="record", at=start) from error
        what = _WHAT.get(op, f"record of type {op}")
        length = _u32(source, what)
        if op not in _READ:
            for _ in source.blocks(length, what):
                pass
            return
        if op == _CHUNK and length > source.left:
            yield from self._cut_chunk(source, header, start)
        try:
            yield from self._items(op, header, memoryview(source.take(length, what)), start)
        except (struct.error, ValueError) as error:
            raise source.damaged(str(error), what=what, at=start) from error

    def _items(self, op: int, header: _Header, body: memoryview, start: int) -> Iterator[_Item]:
        if op == _MESSAGE:
            yield self._message(header, body, start)
        elif op == _CONNECTION:
            yield from self._declare(header, body)
        elif op == _CHUNK:
            self._chunks += 1
            records = inflate(body, _text(header, b"compression"), size=_number(header, b"size"))
            yield from self._records_in_chunk(memoryview(records), start)
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
