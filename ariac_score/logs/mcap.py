"""Scanning MCAP files: every record in order, every checksum verified.

Source: MCAP format specification, version 0 (mcap.dev/spec).
"""

from __future__ import annotations

import os
import struct
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from zlib import crc32

import numpy as np

from ariac_score.errors import LogError
from ariac_score.logs.columnar.columns import Bytes, IntArray, Payloads
from ariac_score.logs.salvage import (
    Batch,
    Connection,
    FileScan,
    Message,
    Source,
    checked_stamp,
    inflate,
    normalised_type,
)
from ariac_score.logs.tiling import gaps_between, words_at

__all__ = ["MAGIC", "McapScan"]

MAGIC = b"\x89MCAP0\r\n"

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
_MESSAGE_INDEX, _STATISTICS, _DATA_END = 0x07, 0x0B, 0x0F
_READ = frozenset({_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END})

_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_FOOTER_BODY = struct.Struct("<QQI")

_Item = Connection | Message | Batch
_Body = bytes | memoryview

_AHEAD = min(4, os.cpu_count() or 1)
"""Chunks that are inflated while others are looked at; what is read does not depend on it."""

_LARGE_BYTES = 16 << 20
"""Larger chunks are not read ahead."""

_LARGEST_INDEX_BYTES = 64 << 20


@dataclass
class _Held:
    """A chunk on its way: its records, and what its index says of them."""

    start: int
    records: Future[_Body]
    large: bool
    index: list[bytes] = field(default_factory=list)

    def has_room_for(self, length: int) -> bool:
        """Whether so many bytes of index are still looked at."""
        return sum(map(len, self.index)) + length <= _LARGEST_INDEX_BYTES


def _goes_with(held: Sequence[_Held], length: int, source: Source) -> bool:
    """Whether a chunk may be read while others are on their way."""
    few = len(held) <= _AHEAD and not any(chunk.large for chunk in held)
    return few and length <= min(_LARGE_BYTES, source.left)


def _is_large(chunk: bytes) -> bool:
    """Whether it announces more than may be inflated beside others."""
    return int.from_bytes(chunk[16:24], "little") > _LARGE_BYTES


@dataclass(frozen=True, eq=False)
class _Places:
    """The messages of a chunk, and in `runs` what lies between them (see `gaps_between`)."""

    buffer: Bytes
    channels: IntArray
    stamps_ns: IntArray
    starts: IntArray
    ends: IntArray
    runs: Sequence[tuple[int, int, int, int]]

    @classmethod
    def of(cls, records: _Body, offsets: IntArray) -> _Places:
        """Read where the messages at some offsets lie.

        Raises:
            ValueError: There are other things than whole messages, or messages besides them.
        """
        buffer = np.frombuffer(records, dtype=np.uint8)
        sizes = words_at(buffer, offsets + 1, "u8")
        starts = offsets + _RECORD.size
        ends = starts + sizes
        if (buffer[offsets] != _MESSAGE).any() or (sizes < _MESSAGE_HEAD.size).any():
            raise ValueError("there is no message where one should be")
        runs = tuple(gaps_between(offsets, ends, len(buffer)))
        raw = memoryview(records)
        if any(op == _MESSAGE for gap, behind, _, _ in runs for op, _ in _ops(raw[gap:behind])):
            raise ValueError("there are other messages")
        channels, stamps_ns = words_at(buffer, starts, "u2"), words_at(buffer, starts + 6, "u8")
        return cls(buffer, channels, stamps_ns, starts + _MESSAGE_HEAD.size, ends, runs)


class McapScan(FileScan):
    """One MCAP file; see `ariac_score.logs.salvage.Scan`."""

    format = "ROS 2 bag (MCAP)"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, tuple[tuple[int, str], Connection]] = {}
        self._messages = 0
        self._announced: int | None = None
        # The specification leaves open whether the data section starts at the magic or behind the header.
        self._crc_of_file = self._crc_behind_header = self._crc_of_summary = 0
        self._data_crc_wanted, self._in_summary = True, False
        self._behind = 0

    def __iter__(self) -> Iterator[_Item]:
        """Every declared connection and message, in recorded order.

        Raises:
            LogError: The file is not whole; see `readable`.
        """
        with Source(self.path) as source:
            self._source = source
            magic = source.take(min(len(MAGIC), source.size), "magic")
            if magic != MAGIC:
                raise source.damaged("the file does not start as an MCAP file does (wrong magic)", at=0)
            self._data_crc_wanted = _announces_data_crc(source)
            self._crc_of_file = crc32(magic)
            yield from self._records(source)
            if source.take(len(MAGIC), "closing magic") != MAGIC:
                raise source.damaged("the file does not end as an MCAP file does (wrong magic)")
            if source.left:
                raise source.damaged(f"{source.left} bytes follow the end of the MCAP file")
            if self._announced is not None and self._announced != self._messages:
                raise source.damaged(
                    f"the statistics announce {self._announced} messages, the file holds {self._messages}"
                )
            self._readable = f"byte {source.offset}"

    def _records(self, source: Source) -> Iterator[_Item]:
        held: deque[_Held] = deque()
        with ThreadPoolExecutor(_AHEAD) as pool:
            try:
                yield from self._passed(source, held, pool)
            except LogError:
                # What is before the damage counts, and damage in it is told instead.
                yield from self._settled(source, held)
                raise

    def _passed(self, source: Source, held: deque[_Held], pool: ThreadPoolExecutor) -> Iterator[_Item]:
        """Read record by record; chunks are held until their index was read, and inflated meanwhile."""
        expected: int | None = _HEADER
        while True:
            start = source.offset
            head = source.take(_RECORD.size, "record")
            op, length = _RECORD.unpack(head)
            if op == 0 or (expected is not None and op != expected):
                raise source.damaged(f"record type 0x{op:02x} cannot stand here", at=start)
            expected = None
            what = f"record 0x{op:02x}"
            index_of_held = op == _MESSAGE_INDEX and bool(held) and held[-1].has_room_for(length)
            if not index_of_held and not (op == _CHUNK and _goes_with(held, length, source)):
                yield from self._settled(source, held)
            if op == _CHUNK and length > source.left:
                yield from self._cut_chunk(source, start)
            body = source.take(length, what) if op in _READ or index_of_held else b""
            if op == _DATA_END:
                self._check_data_end(source, body, start)
            self._add_to_crcs(op, head, body)
            if op not in _READ and not index_of_held:
                for block in source.blocks(length, what):
                    self._add_to_crcs(op, block)
            if op == _FOOTER:
                self._check_footer(source, head + body, start)
                return
            if index_of_held:
                held[-1].index.append(body)
            elif op == _CHUNK:
                if _is_large(body):
                    yield from self._settled(source, held)
                held.append(_Held(start, pool.submit(_inflated, body), _is_large(body)))
            else:
                yield from self._outside_chunks(source, op, body, start)
            self._behind = source.offset

    def _outside_chunks(self, source: Source, op: int, body: _Body, start: int) -> Iterator[_Item]:
        try:
            yield from self._items(op, body, start)
        except (struct.error, ValueError) as error:
            what = _WHAT.get(op, f"record 0x{op:02x}")
            raise source.damaged(str(error), what=what, at=start) from error
        self._readable = f"byte {source.offset}"

    def _settled(self, source: Source, held: deque[_Held]) -> Iterator[_Item]:
        """The records of the chunks that are held."""
        if not held:
            return
        while held:
            chunk = held.popleft()
            try:
                records = chunk.records.result()
                yield from self._chunk(records, chunk.index, chunk.start)
            except (struct.error, ValueError) as error:
                held.clear()
                raise source.damaged(str(error), what="chunk", at=chunk.start) from error
            self._readable = f"byte {held[0].start if held else self._behind}"

    def _add_to_crcs(self, op: int, *parts: bytes) -> None:
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
        announced = int.from_bytes(record[-4:], "little")
        found = crc32(record[:-4], self._crc_of_summary)
        if announced not in (0, found):
            raise source.damaged(
                f"the CRC of the summary is {found:08x}, the file says {announced:08x}",
                what="footer",
                at=start,
            )

    def _items(self, op: int, body: _Body, start: int) -> Iterator[_Item]:
        if op == _MESSAGE:
            yield self._message(body, start)
        elif op == _SCHEMA:
            self._declare_schema(body)
        elif op == _CHANNEL:
            yield from self._declare_channel(body)
        elif op == _STATISTICS:
            (self._announced,) = struct.unpack_from("<Q", body)

    def _message(self, body: _Body, start: int) -> Message:
        channel, _, stamp_ns, _ = _MESSAGE_HEAD.unpack_from(body)
        if channel not in self._channels:
            raise ValueError(f"a message belongs to channel {channel}, which is not declared before it")
        checked_stamp(stamp_ns, file=self.path, place=f"message at byte {start}")
        self._messages += 1
        return Message(self._channels[channel][1], stamp_ns, memoryview(body)[_MESSAGE_HEAD.size :])

    def _declare_schema(self, body: _Body) -> None:
        (key,) = struct.unpack_from("<H", body)
        name, at = _text(body, 2)
        encoding, at = _text(body, at)
        definition, _ = _text(body, at)
        self._schemas.setdefault(key, (normalised_type(name), encoding, definition))

    def _declare_channel(self, body: _Body) -> Iterator[Connection]:
        key, schema = struct.unpack_from("<HH", body)
        topic, at = _text(body, 4)
        encoding, _ = _text(body, at)
        if key in self._channels:
            if self._channels[key][0] != (schema, topic):
                raise ValueError(f"channel {key} is declared twice, differently")
            return
        if schema and schema not in self._schemas:
            raise ValueError(f"channel {key} needs schema {schema}, which is not declared before it")
        type_, format_, definition = self._schemas.get(schema, ("", "", ""))
        connection = Connection(topic, type_, encoding, definition, format_)
        self._channels[key] = (schema, topic), connection
        yield connection

    def _chunk(self, records: _Body, index: Sequence[bytes], start: int) -> Iterator[_Item]:
        """The records of a chunk: by its index, else by walking them, else one by one."""
        places = None
        if index:
            try:
                places = _indexed(records, index)
            except (struct.error, ValueError):
                self._contradictions += 1
        if places is None:
            try:
                places = _Places.of(records, _walked(records))
            except (struct.error, ValueError):
                yield from self._records_in_chunk(memoryview(records), start)
                return
        raw = memoryview(records)
        for gap, behind, first, last in places.runs:
            yield from self._records_in_chunk(raw[gap:behind], start)
            yield from self._batch(places, first, last)

    def _batch(self, places: _Places, first: int, last: int) -> Iterator[_Item]:
        """Messages that follow each other, up to the first whose channel is not declared."""
        channels = places.channels[first:last]
        known = np.unique(channels)
        missing = [key for key in known.tolist() if key not in self._channels]
        if missing:
            last = first + int(np.argmax(np.isin(channels, missing)))
            channels = places.channels[first:last]
            known = np.unique(channels)
        if last > first:
            self._messages += last - first
            payloads = Payloads(places.buffer, places.starts[first:last], places.ends[first:last])
            senders = tuple(self._channels[key][1] for key in known.tolist())
            sources = np.searchsorted(known, channels).astype(np.int64)
            yield Batch(senders, sources, places.stamps_ns[first:last], payloads)
        if missing:
            raise ValueError(
                f"a message belongs to channel {int(places.channels[last])}, which is not declared before it"
            )

    def _cut_chunk(self, source: Source, start: int) -> Iterator[_Item]:
        """The whole records of a chunk that the file ends in, where it is not compressed."""
        head = source.peek(source.left)
        try:
            compression, at = _text(head, _CHUNK_HEAD.size)
            if not compression:
                yield from self._records_in_chunk(memoryview(head)[at + 8 :], start)
        except (struct.error, ValueError):
            return  # it ends in the middle of a record: `take` says so
        finally:
            self._readable = f"byte {source.size}"

    def _records_in_chunk(self, records: memoryview, start: int) -> Iterator[_Item]:
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
    """Whether the end of the data has a checksum, looked up from the end of the file.

    Recorders leave it out, and computing it takes longer than reading. What is found here is
    held against the end of the data once it is reached.
    """
    tail = source.at(source.size - len(MAGIC) - _FOOTER_BODY.size - _RECORD.size, _RECORD.size + 8)
    if len(tail) != _RECORD.size + 8 or tail[0] != _FOOTER:
        return True
    summary = int.from_bytes(tail[_RECORD.size :], "little")
    behind = summary or source.size - len(MAGIC) - _FOOTER_BODY.size - _RECORD.size
    end = source.at(behind - _RECORD.size - 4, _RECORD.size + 4)
    return end[:1] != bytes((_DATA_END,)) or end[-4:] != b"\0\0\0\0"


def _inflated(chunk: bytes) -> _Body:
    """The records of a chunk, its sizes and its checksum verified."""
    _, _, size, announced = _CHUNK_HEAD.unpack_from(chunk)
    compression, at = _text(chunk, _CHUNK_HEAD.size)
    (packed_size,) = struct.unpack_from("<Q", chunk, at)
    packed = memoryview(chunk)[at + 8 :]
    if packed_size != len(packed):
        raise ValueError(f"it announces {packed_size} bytes of records and has {len(packed)}")
    try:
        records = inflate(packed, compression, size=size)
    except ValueError as error:
        raise ValueError(f"CRC cannot be checked: {error}") from error
    if announced and (found := crc32(records)) != announced:
        raise ValueError(f"its CRC is {found:08x}, the file says {announced:08x}")
    return records


def _ops(records: memoryview) -> Iterator[tuple[int, int]]:
    """Type and offset of each record."""
    at, size, unpack = 0, len(records), _RECORD.unpack_from
    while at < size:
        op, length = unpack(records, at)
        yield op, at
        at += _RECORD.size + length


def _walked(records: _Body) -> IntArray:
    """Where the messages of a chunk are, by walking it."""
    return np.array([at for op, at in _ops(memoryview(records)) if op == _MESSAGE], dtype=np.int64)


def _indexed(records: _Body, index: Sequence[bytes]) -> _Places:
    """Where the messages of a chunk are, by its index.

    Raises:
        ValueError: The index contradicts the chunk.
    """
    parts = [np.zeros((3, 0), dtype=np.int64)]
    for body in index:
        channel, length = struct.unpack_from("<HI", body)
        if length + 6 != len(body) or length % 16:
            raise ValueError("the index is no list of times and offsets")
        pairs = np.frombuffer(body, dtype="<u8", offset=6).reshape(-1, 2)
        if pairs.max(initial=0) >= 1 << 63:
            raise ValueError("a number is beyond 63 bits")
        times, offsets = pairs.astype(np.int64).T
        parts.append(np.stack((np.full(len(times), channel), times, offsets)))
    channels, times, offsets = np.concatenate(parts, axis=1)
    order = np.argsort(offsets, kind="stable")
    places = _Places.of(records, offsets[order])
    if (places.channels != channels[order]).any() or (places.stamps_ns != times[order]).any():
        raise ValueError("the index tells other channels or times")
    return places


def _text(body: _Body, at: int) -> tuple[str, int]:
    """A string with its length before it, and where the next field starts."""
    (length,) = struct.unpack_from("<I", body, at)
    end = at + 4 + length
    if end > len(body):
        raise ValueError(f"a text of {length} bytes is longer than its record")
    return bytes(body[at + 4 : end]).decode("utf-8", errors="replace"), end
