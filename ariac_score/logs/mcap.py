"""Scanning MCAP files: every record in order, every checksum verified.

Source: MCAP format specification, version 0 (mcap.dev/spec).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from zlib import crc32

from ariac_score.logs.salvage import (
    Connection,
    FileScan,
    Message,
    Source,
    checked_stamp,
    inflate,
    normalised_type,
)

__all__ = ["MAGIC", "McapScan"]

MAGIC = b"\x89MCAP0\r\n"

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
_STATISTICS, _DATA_END = 0x0B, 0x0F
_READ = frozenset({_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END})

_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_FOOTER_BODY = struct.Struct("<QQI")

_Item = Connection | Message
_Body = bytes | memoryview


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
        expected: int | None = _HEADER
        while True:
            start = source.offset
            head = source.take(_RECORD.size, "record")
            op, length = _RECORD.unpack(head)
            if op == 0 or (expected is not None and op != expected):
                raise source.damaged(f"record type 0x{op:02x} cannot stand here", at=start)
            expected = None
            what = f"record 0x{op:02x}"
            if op == _CHUNK and length > source.left:
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
            try:
                yield from self._items(op, body, start)
            except (struct.error, ValueError) as error:
                raise source.damaged(str(error), what=_WHAT.get(op, what), at=start) from error
            self._readable = f"byte {source.offset}"

    def _add_to_crcs(self, op: int, *parts: bytes) -> None:
        for part in parts:
            self._crc_of_file = crc32(part, self._crc_of_file)
            if op != _HEADER:
                self._crc_behind_header = crc32(part, self._crc_behind_header)
            if op not in (_FOOTER, _DATA_END):
                self._crc_of_summary = crc32(part, self._crc_of_summary)
        if op == _DATA_END:
            self._crc_of_summary = 0

    def _check_data_end(self, source: Source, body: bytes, start: int) -> None:
        if len(body) < 4:
            raise source.damaged("the record is too short", what="data end", at=start)
        announced = int.from_bytes(body[:4], "little")
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
        elif op == _CHUNK:
            yield from self._chunk(body, start)
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

    def _chunk(self, body: _Body, start: int) -> Iterator[_Item]:
        _, _, size, announced = _CHUNK_HEAD.unpack_from(body)
        compression, at = _text(body, _CHUNK_HEAD.size)
        (packed_size,) = struct.unpack_from("<Q", body, at)
        packed = memoryview(body)[at + 8 :]
        if packed_size != len(packed):
            raise ValueError(f"it announces {packed_size} bytes of records and has {len(packed)}")
        try:
            records = inflate(packed, compression, size=size)
        except ValueError as error:
            raise ValueError(f"CRC cannot be checked: {error}") from error
        found = crc32(records)
        if announced not in (0, found):
            raise ValueError(f"its CRC is {found:08x}, the file says {announced:08x}")
        yield from self._records_in_chunk(memoryview(records), start)

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


def _text(body: _Body, at: int) -> tuple[str, int]:
    """A string with its length before it, and where the next field starts."""
    (length,) = struct.unpack_from("<I", body, at)
    end = at + 4 + length
    if end > len(body):
        raise ValueError(f"a text of {length} bytes is longer than its record")
    return bytes(body[at + 4 : end]).decode("utf-8", errors="replace"), end
