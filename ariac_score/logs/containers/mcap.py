"""Scanning MCAP files: every record in order, every checksum verified.

Source: MCAP format specification, version 0 (mcap.dev/spec).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np

from ariac_score.logs.containers.chunk_buffers import Slabs, scratch
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
from ariac_score.logs.containers.source import MAX_PEEK_BYTES, Source

__all__ = ["MAGIC", "UNSEEN_LOSSES", "McapScan"]

MAGIC = b"\x89MCAP0\r\n"
UNSEEN_LOSSES = b"\x06\0\0\0losses\x06\0\0\0unseen"
"""In the metadata of a channel: the entry that says that its messages may be lost without a trace."""

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
_MESSAGE_INDEX, _CHUNK_INDEX, _STATISTICS, _DATA_END = 0x07, 0x08, 0x0B, 0x0F
_READ = frozenset({_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END})

_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_FOOTER_BODY = struct.Struct("<QQI")

_Body = bytes | memoryview

_MESSAGE_WORDS = np.dtype(
    {
        "names": ["op", "size", "channel", "sequence", "stamp_ns"],
        "formats": ["u1", "<u8", "<u2", "<u4", "<u8"],
        "offsets": [0, 1, 9, 11, 15],
        "itemsize": _RECORD.size + _MESSAGE_HEAD.size,
    }
)
_LONGEST_COMPRESSION = 64
_LATEST_NS = 1 << 63


class McapScan(ChunkedScan):
    """One MCAP file; see `ariac_score.logs.containers.items.Scan`."""

    format = "ROS 2 bag (MCAP)"
    sender_kind, sender_bytes = "channel", 2
    message_head_bytes = _MESSAGE_WORDS.itemsize
    # Examining a small chunk on its own takes longer than inflating it with its neighbours.
    smallest_left_out_bytes = 1 << 17

    def __init__(self, path: Path, **options: Any) -> None:
        super().__init__(path, **options)
        self._summary: _Summary | None = None
        self._all_declared = False
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._schema_of: dict[int, int] = {}
        self._announced: int | None = None
        # The specification leaves open whether the data section starts at the magic or behind the header,
        # so either checksum is accepted.
        self._crc_of_file = self._crc_behind_header = self._crc_of_summary = 0
        self._data_crc_wanted, self._in_summary = True, False

    def _open(self, source: Source) -> None:
        magic = source.take(min(len(MAGIC), source.size), "magic")
        if magic != MAGIC:
            raise source.damaged("the file does not start as an MCAP file does (wrong magic)", at=0)
        self._data_crc_wanted = _announces_data_crc(source)
        if self._topics is not None:
            self._summary = _summary_of(source)
        self._crc_of_file = crc32(magic)

    def _close(self, source: Source) -> None:
        if source.take(len(MAGIC), "closing magic") != MAGIC:
            raise source.damaged("the file does not end as an MCAP file does (wrong magic)")
        if source.left:
            raise source.damaged(f"{source.left} bytes follow the end of the MCAP file")
        found = self._found.total()
        if self._announced is not None and self._announced != found:
            raise source.damaged(
                f"the statistics announce {self._announced} messages, the file holds {found}"
            )
        self._reached(source.offset)

    def _records(self, source: Source, slabs: Slabs) -> Iterator[Item]:
        expected: int | None = _HEADER
        while True:
            start = source.offset
            head = source.take(_RECORD.size, "record")
            op, length = _RECORD.unpack(head)
            # By the specification opcode 0 is invalid, and unknown opcodes are to be skipped.
            if op == 0 or (expected is not None and op != expected):
                raise source.damaged(f"record type 0x{op:02x} cannot stand here", at=start)
            if self._in_summary and op in (_CHUNK, _MESSAGE):
                raise source.damaged(f"{_WHAT[op]} behind the end of the data", at=start)
            expected = None
            held = slabs.last
            if op == _CHUNK and length <= source.left:
                self._add_to_crcs(op, head)
                read_head = partial(self._chunk_head, source, length)
                yield from self._enqueue_chunk(source, slabs, read_head, length, start)
                continue
            what = f"record 0x{op:02x}"
            # Indexes that could not be read together with their chunk, as with a checksum of all data.
            if op == _MESSAGE_INDEX and held is not None and held.has_room_for(length):
                body = source.take(length, what)
                self._add_to_crcs(op, head, body)
                held.add_index(body)
                held.end = source.offset
                continue
            yield from self._drained(source, slabs.rest())
            if op == _CHUNK:  # longer than the rest of the file
                yield from self._cut_chunk(source, start)
            body = source.take(length, what) if op in _READ else b""
            if op == _DATA_END:
                self._check_data_end(source, body, start)
            self._add_to_crcs(op, head, body)
            if op not in _READ:
                for block in source.blocks(length, what):
                    self._add_to_crcs(op, block)
            if op == _FOOTER:
                self._check_footer(source, head + body, start)
                return
            yield from self._outside_chunks(source, op, body, start)

    def _chunk_head(self, source: Source, length: int) -> ChunkHead:
        """Read the head of a chunk of this length.

        Raises:
            ValueError: It contradicts itself.
        """
        what = f"record 0x{_CHUNK:02x}"
        raw = source.take(min(_CHUNK_HEAD.size + 4, length), what)
        if len(raw) < _CHUNK_HEAD.size + 4:
            raise ValueError(f"its head has {len(raw)} bytes")
        earliest_ns, latest_ns, size, crc = _CHUNK_HEAD.unpack_from(raw)
        named = int.from_bytes(raw[_CHUNK_HEAD.size :], "little")
        # Before reading it: the length of the name comes from the file.
        if named > min(_LONGEST_COMPRESSION, length - len(raw)):
            raise ValueError(f"a text of {named} bytes is longer than its record")
        raw += source.take(min(named + 8, length - len(raw)), what)
        compression, at = _text(raw, _CHUNK_HEAD.size)
        if len(raw) < at + 8:
            raise ValueError("its head is longer than its record")
        (packed,) = struct.unpack_from("<Q", raw, at)
        if packed != length - len(raw):
            raise ValueError(f"it announces {packed} bytes of records and has {length - len(raw)}")
        head = ChunkHead(size, packed, compression, (earliest_ns, latest_ns), crc)
        if head.plain and packed != size:
            raise ValueError(
                f"CRC cannot be checked: it holds {packed} bytes instead of the announced {size}"
            )
        check_announced(size, packed)
        self._add_to_crcs(_CHUNK, raw)
        return head

    def _fill(self, source: Source, head: ChunkHead, room: memoryview) -> Callable[[], None]:
        if not self._data_crc_wanted:
            return partial(_read_and_inflate, head, room, source.later(head.packed, "chunk"))
        # The checksum of the data section needs the bytes in their order, so they are read here.
        if head.plain:
            source.take_into(room, "chunk")
            self._add_to_crcs(_CHUNK, room)
            return partial(head.verify, room)
        packed = source.take(head.packed, "chunk")
        self._add_to_crcs(_CHUNK, packed)
        return partial(_inflate, head, room, packed)

    def _index_records(self, ahead: Lookahead) -> Iterator[tuple[bytes, int]]:
        if self._data_crc_wanted:
            raise ValueError("the checksum of the whole file needs every record in its order")
        at = 0
        while True:
            first = at + _RECORD.size
            if not ahead.reaches(first):
                raise ValueError("the file is cut off, or the index is too long")
            op, length = _RECORD.unpack_from(ahead.bytes, at)
            if op != _MESSAGE_INDEX:
                return
            at = first + length
            if not ahead.reaches(at):
                raise ValueError("the file is cut off, or the index is too long")
            yield ahead.bytes[first:at], at

    def outline(self, source: Source) -> Outline | None:
        """The contents by the summary; `None` where there is none, or everything is read anyway."""
        self._open(source)
        if self._summary is None or self._data_crc_wanted or not self._summary.chunks:
            return None
        for _ in self._declare_all():
            pass
        topics = {channel: connection.topic for channel, connection in self._connections.items()}
        return Outline(topics, self._summary.chunks, declares_all=True)

    def chunk_at(self, source: Source, start: int) -> ChunkHead:
        """Read the head of a chunk, and move on to its records."""
        source.skip(start - source.offset)
        op, length = _RECORD.unpack(source.take(_RECORD.size, "chunk"))
        if op != _CHUNK or length > source.left:
            raise ValueError("there is no chunk where one should be")
        return self._chunk_head(source, length)

    def _is_announced(self, start: int, entries: IndexEntries) -> bool:
        # Schemas and channels that the chunk may declare are repeated in the summary.
        channels = frozenset(entries.senders.tolist())
        return self._summary is not None and self._summary.chunks.get(start) == channels

    def _declare_all(self) -> Iterator[Connection]:
        """Declare what the summary repeats, for a chunk that is left out may have declared it."""
        if self._summary is not None and not self._all_declared:
            self._all_declared = True
            for op, body in self._summary.declarations:
                if op == _SCHEMA:
                    self._declare_schema(body)
                else:
                    yield from self._declare_channel(body)

    @staticmethod
    def _entries(indexes: Sequence[Sequence[bytes]]) -> IndexEntries:
        heads, counts, entries, owners = entries_of(indexes, head=6, words=4)
        named = [struct.unpack("<HI", head) for head in heads]
        if any(length != 16 * count for (_, length), count in zip(named, counts.tolist(), strict=True)):
            raise ValueError("the index is no list of times and offsets")
        pairs = entries.reshape(-1).view("<u8").reshape(-1, 2)
        if pairs.max(initial=0) >= _LATEST_NS:
            raise ValueError("a number is beyond 63 bits")
        stamps_ns, offsets = pairs.astype(np.int64).T
        channels = np.array([channel for channel, _ in named], dtype=np.int64)
        return IndexEntries(np.repeat(channels, counts), stamps_ns, offsets, owners)

    @staticmethod
    def _message_offsets(records: memoryview) -> IntArray:
        return np.array([at for op, at in _ops(records) if op == _MESSAGE], dtype=np.int64)

    @staticmethod
    def _message_heads(buffer: Bytes, offsets: IntArray) -> MessageHeads:
        words = records_at(buffer, offsets, _MESSAGE_WORDS)
        if (words["op"] != _MESSAGE).any() or (words["stamp_ns"] >= _LATEST_NS).any():
            raise ValueError("there is no message where one should be")
        sizes = words["size"]
        if (sizes < _MESSAGE_HEAD.size).any() or (sizes > len(buffer)).any():
            raise ValueError("a message has a length that it cannot have")
        starts = offsets + _MESSAGE_WORDS.itemsize
        ends = starts + (sizes.astype(np.int64) - _MESSAGE_HEAD.size)
        senders, sequences, stamps_ns = (
            words[name].astype(np.int64) for name in ("channel", "sequence", "stamp_ns")
        )
        return MessageHeads(senders, stamps_ns, starts, ends, sequences)

    def _outside_chunks(self, source: Source, op: int, body: _Body, start: int) -> Iterator[Item]:
        try:
            yield from self._items(op, body, start)
        except (struct.error, ValueError) as error:
            what = _WHAT.get(op, f"record 0x{op:02x}")
            raise source.damaged(str(error), what=what, at=start) from error
        self._reached(source.offset)

    def _add_to_crcs(self, op: int, *parts: _Body) -> None:
        if op == _DATA_END:
            self._crc_of_summary, self._in_summary = 0, True
        for part in parts:
            if self._data_crc_wanted:
                self._crc_of_file = crc32(part, self._crc_of_file)
                if op != _HEADER:
                    self._crc_behind_header = crc32(part, self._crc_behind_header)
            if self._in_summary and op not in (_FOOTER, _DATA_END):
                self._crc_of_summary = crc32(part, self._crc_of_summary)

    def _check_data_end(self, source: Source, body: bytes, start: int) -> None:
        if len(body) < 4:
            raise source.damaged("the record is too short", what="data end", at=start)
        announced = int.from_bytes(body[:4], "little")
        if announced and not self._data_crc_wanted:
            raise source.damaged(
                "the end of the data is not where the footer says", what="data end", at=start
            )
        if announced not in (0, self._crc_of_file, self._crc_behind_header):
            raise source.damaged(
                f"the CRC of the data section is {self._crc_of_file:08x}, the file says {announced:08x}",
                what="data end",
                at=start,
            )

    def _check_footer(self, source: Source, record: bytes, start: int) -> None:
        if len(record) != _RECORD.size + _FOOTER_BODY.size:
            raise source.damaged("the record has a wrong length", what="footer", at=start)
        if not self._in_summary:
            raise source.damaged("no record says that the data end", what="footer", at=start)
        announced = int.from_bytes(record[-4:], "little")
        # The checksum covers the summary section and the footer up to the checksum itself.
        found = crc32(record[:-4], self._crc_of_summary)
        if announced not in (0, found):
            raise source.damaged(
                f"the CRC of the summary is {found:08x}, the file says {announced:08x}",
                what="footer",
                at=start,
            )

    def _items(self, op: int, body: _Body, start: int) -> Iterator[Item]:
        if op == _MESSAGE:
            channel, sequence, stamp_ns, _ = _MESSAGE_HEAD.unpack_from(body)
            payload = memoryview(body)[_MESSAGE_HEAD.size :]
            yield self._message(channel, stamp_ns, payload, start, sequence)
        elif op == _SCHEMA:
            self._declare_schema(body)
        elif op == _CHANNEL:
            yield from self._declare_channel(body)
        elif op == _STATISTICS:
            (self._announced,) = struct.unpack_from("<Q", body)

    def _declare_schema(self, body: _Body) -> None:
        (key,) = struct.unpack_from("<H", body)
        name, at = _text(body, 2)
        encoding, at = _text(body, at)
        definition, _ = _text(body, at)
        declared = (normalised_type(name), encoding, definition)
        # The summary repeats all schemas. Of two that differ, readers take the first or the last.
        if self._schemas.setdefault(key, declared) != declared:
            raise ValueError(f"schema {key} is declared twice, differently")

    def _declare_channel(self, body: _Body) -> Iterator[Connection]:
        key, schema = struct.unpack_from("<HH", body)
        topic, at = _text(body, 4)
        encoding, at = _text(body, at)
        _text(body, at)  # its metadata: other readers would take the next record for the rest of them
        if key in self._connections:
            if (self._schema_of[key], self._connections[key].topic) != (schema, topic):
                raise ValueError(f"channel {key} is declared twice, differently")
            return
        # Schema 0 means none, by the specification.
        if schema and schema not in self._schemas:
            raise ValueError(f"channel {key} needs schema {schema}, which is not declared before it")
        type_, format_, definition = self._schemas.get(schema, ("", "", ""))
        self._schema_of[key] = schema
        # A recorder opens a channel for each topic, or for each publisher of it.
        sees_losses = UNSEEN_LOSSES not in bytes(body[at:])
        declared = Connection(topic, type_, encoding, definition, format_, f"channel {key}", sees_losses)
        yield self._declared(key, declared)

    def _cut_chunk(self, source: Source, start: int) -> Iterator[Item]:
        """The whole records of a chunk that the file ends in."""
        head = source.peek(source.left)
        try:
            compression, at = _text(head, _CHUNK_HEAD.size)
            records = inflate_start(memoryview(head)[at + 8 :], compression)
            yield from self._items_in_chunk(memoryview(records), start)
        except (struct.error, ValueError):
            return  # it ends in the middle of a record, which `take` reports
        finally:
            self._readable = f"byte {source.size}"

    def _items_in_chunk(self, records: memoryview, start: int) -> Iterator[Item]:
        at = 0
        while at < len(records):
            op, length = _RECORD.unpack_from(records, at)
            at += _RECORD.size
            if op in (0, _CHUNK) or length > len(records) - at:
                raise ValueError(f"its record 0x{op:02x} of {length} bytes, {at} bytes in, cannot be there")
            yield from self._items(op, records[at : at + length], start)
            at += length


_WHAT = {
    _CHUNK: "chunk",
    _MESSAGE: "message",
    _SCHEMA: "schema",
    _CHANNEL: "channel",
    _STATISTICS: "statistics",
}


def _announces_data_crc(source: Source) -> bool:
    """Whether the data section has a checksum, looked up from the end of the file.

    Most recorders write none, and computing it takes longer than reading. The answer is compared
    with the end of the data once that is reached.
    """
    tail = source.at(source.size - len(MAGIC) - _FOOTER_BODY.size - _RECORD.size, _RECORD.size + 8)
    if len(tail) != _RECORD.size + 8 or tail[0] != _FOOTER:
        return True
    summary = int.from_bytes(tail[_RECORD.size :], "little")
    behind = summary or source.size - len(MAGIC) - _FOOTER_BODY.size - _RECORD.size
    end = source.at(behind - _RECORD.size - 4, _RECORD.size + 4)
    return end[:1] != bytes((_DATA_END,)) or end[-4:] != b"\0\0\0\0"


@dataclass(frozen=True)
class _Summary:
    """The contents of a file by its summary section.

    Attributes:
        declarations: All schemas, then all channels.
        chunks: The channels with messages in each chunk, by its start.
    """

    declarations: Sequence[tuple[int, bytes]]
    chunks: Mapping[int, frozenset[int]]


def _summary_of(source: Source) -> _Summary | None:
    """The summary; `None` where it cannot be relied on."""
    tail = source.at(source.size - len(MAGIC) - _FOOTER_BODY.size, 8)
    start = int.from_bytes(tail, "little")
    end = source.size - len(MAGIC) - _FOOTER_BODY.size - _RECORD.size
    if not 0 < start < end or end - start > MAX_PEEK_BYTES:
        return None
    summary, found = source.at(start, end - start), []
    schemas, needed = {0}, set[int]()
    chunks = dict[int, frozenset[int]]()
    try:
        for op, at in _ops(memoryview(summary)):
            first = at + _RECORD.size
            body = summary[first : first + _RECORD.unpack_from(summary, at)[1]]
            if op in (_SCHEMA, _CHANNEL):
                found.append((op, body))
                (schemas if op == _SCHEMA else needed).add(
                    struct.unpack_from("<H", body, 2 * (op == _CHANNEL))[0]
                )
            elif op == _CHUNK_INDEX:
                chunk, channels = _indexed_chunk(body)
                chunks[chunk] = channels
    except struct.error:
        return None
    return _Summary(sorted(found), chunks) if needed and needed <= schemas else None


def _indexed_chunk(body: bytes) -> tuple[int, frozenset[int]]:
    """Where a chunk starts, and the channels that have an index behind it."""
    _, _, start, _, length = struct.unpack_from("<QQQQI", body)
    entries = body[_CHUNK_INDEX_HEAD_BYTES : _CHUNK_INDEX_HEAD_BYTES + length]
    return start, frozenset(channel for channel, _ in struct.iter_unpack("<HQ", entries))


_CHUNK_INDEX_HEAD_BYTES = 36


def _read_and_inflate(head: ChunkHead, room: memoryview, read: Callable[[memoryview], None]) -> None:
    """Read the records of a chunk to where there is room for them, inflated, and verify them.

    Raises:
        ValueError: They are damaged.
    """
    if head.plain:
        read(room)
        head.verify(room)
        return
    with scratch(head.packed) as packed:
        read(packed)
        _inflate(head, room, packed)


def _inflate(head: ChunkHead, room: memoryview, packed: bytes | memoryview) -> None:
    """Inflate the records of a chunk to where there is room for them, and verify them.

    Raises:
        ValueError: They are damaged.
    """
    try:
        inflate_into(room, packed, head.compression)
    except ValueError as error:
        raise ValueError(f"CRC cannot be checked: {error}") from error
    head.verify(room)


def _ops(records: memoryview) -> Iterator[tuple[int, int]]:
    """Type and offset of each record."""
    at, size, unpack = 0, len(records), _RECORD.unpack_from
    while at < size:
        op, length = unpack(records, at)
        yield op, at
        at += _RECORD.size + length


def _text(body: _Body, at: int) -> tuple[str, int]:
    """A string with its length before it, and where the next field starts."""
    (length,) = struct.unpack_from("<I", body, at)
    end = at + 4 + length
    if end > len(body):
        raise ValueError(f"a text of {length} bytes is longer than its record")
    return bytes(body[at + 4 : end]).decode("utf-8", errors="replace"), end
