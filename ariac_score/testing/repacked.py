"""Rewriting an MCAP file in another form: other compression, without chunks, without indexes."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from zlib import crc32

import cramjam

from ariac_score.logs.containers.inflating import inflate
from ariac_score.logs.containers.mcap import MAGIC

__all__ = ["McapForm", "records", "repacked"]

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
_MESSAGE_INDEX, _CHUNK_INDEX, _STATISTICS, _DATA_END = 0x07, 0x08, 0x0B, 0x0F
_COPIED = (_HEADER, _SCHEMA, _CHANNEL, _MESSAGE)

_Record = tuple[int, bytes]


@dataclass(frozen=True)
class McapForm:
    """How an MCAP file is written.

    Attributes:
        compression: Of its chunks: `lz4`, `zstd`, or empty for none.
        chunk_bytes: A chunk is closed once its records have so many bytes; 0: there are no chunks.
        indexed: Whether chunks have an index, and the file a summary.
        chunk_checksums: Whether each chunk has one.
        data_checksum: Whether the data as a whole have one: then all of them are read.
        sequences: The numbers that publishers gave the messages, in their order; empty: as they are.
    """

    compression: str = ""
    chunk_bytes: int = 1 << 14
    indexed: bool = True
    chunk_checksums: bool = True
    data_checksum: bool = False
    sequences: Sequence[int] = ()


def repacked(mcap: bytes, form: McapForm) -> bytes:
    """The same messages, in the same order, in a file of another form.

    Args:
        mcap: A whole file.
        form: How to write it.

    Raises:
        ValueError: No such compression is known.
    """
    writer = _Writer(form)
    for op, body in records(mcap):
        writer.take(op, body)
    return writer.finished()


def records(mcap: bytes) -> Iterator[_Record]:
    """Header, declarations and messages of a whole file, in their order, whatever chunks they are in."""
    return _opened(mcap[len(MAGIC) :])


def _opened(raw: bytes) -> Iterator[_Record]:
    at = 0
    while at < len(raw):
        op, length = struct.unpack_from("<BQ", raw, at)
        body = raw[at + 9 : at + 9 + length]
        at += 9 + length
        if op in (_DATA_END, _FOOTER):
            return  # after it stands the summary, which repeats schemas and channels
        if op == _CHUNK:
            size, _, named = struct.unpack_from("<QII", body, 16)
            # Start, end, size, checksum, name of the compression, length of the records: 8+8+8+4+4+named+8.
            packed, how = body[40 + named :], body[32 : 32 + named].decode()
            yield from _opened(bytes(inflate(packed, how, size=size)) if how else packed)
        elif op in _COPIED:
            yield op, body


@dataclass
class _Writer:
    form: McapForm
    out: bytearray = field(default_factory=lambda: bytearray(MAGIC))
    records: bytearray = field(default_factory=bytearray)
    entries: dict[int, list[tuple[int, int]]] = field(default_factory=dict)
    declared: dict[_Record, None] = field(default_factory=dict)
    chunks: list[bytes] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    stamps_ns: list[int] = field(default_factory=list)

    def take(self, op: int, body: bytes) -> None:
        if op == _HEADER:
            self.out += _record(op, body)
            return
        if op == _MESSAGE:
            channel, sequence, stamp_ns = struct.unpack_from("<HIQ", body)
            if self.form.sequences:
                sequence = self.form.sequences[len(self.stamps_ns)]
            body = struct.pack("<HI", channel, sequence) + body[6:]
            self.entries.setdefault(channel, []).append((stamp_ns, len(self.records)))
            self.counts[channel] = self.counts.get(channel, 0) + 1
            self.stamps_ns.append(stamp_ns)
        elif (op, body) in self.declared:
            return  # every chunk of some writers repeats its schemas and channels
        else:
            self.declared[op, body] = None
        self.records += _record(op, body)
        if len(self.records) >= self.form.chunk_bytes:
            self._close_chunk()

    def finished(self) -> bytes:
        self._close_chunk()
        # 0 says that there is no checksum.
        checksum = crc32(self.out) if self.form.data_checksum else 0
        self.out += _record(_DATA_END, struct.pack("<I", checksum))
        start = len(self.out)
        summary = b"".join(_record(op, body) for op, body in self.declared)
        summary += self._statistics() + b"".join(_record(_CHUNK_INDEX, body) for body in self.chunks)
        if not self.form.indexed:
            return bytes(self.out + _record(_FOOTER, bytes(20)) + MAGIC)
        footer = struct.pack("<BQQQ", _FOOTER, 20, start, 0)
        checksum = crc32(summary + footer) if self.form.chunk_checksums else 0
        return bytes(self.out + summary + footer + struct.pack("<I", checksum) + MAGIC)

    def _close_chunk(self) -> None:
        """Write the records since the last chunk: as a chunk with its index, or plain."""
        records, entries = bytes(self.records), self.entries
        self.records, self.entries = bytearray(), {}
        if not records:
            return
        if not self.form.chunk_bytes:
            self.out += records
            return
        packed, start = _packed(records, self.form.compression), len(self.out)
        times = [stamp_ns for pairs in entries.values() for stamp_ns, _ in pairs] or [0]
        checksum = crc32(records) if self.form.chunk_checksums else 0
        head = struct.pack("<QQQI", min(times), max(times), len(records), checksum)
        name = _text(self.form.compression)
        self.out += _record(_CHUNK, head + name + struct.pack("<Q", len(packed)) + packed)
        if not self.form.indexed:
            return
        behind, places = len(self.out), b""
        for channel, pairs in entries.items():
            places += struct.pack("<HQ", channel, len(self.out))
            listed = b"".join(struct.pack("<QQ", *pair) for pair in pairs)
            self.out += _record(_MESSAGE_INDEX, struct.pack("<HI", channel, len(listed)) + listed)
        index = struct.pack("<QQQQI", min(times), max(times), start, behind - start, len(places)) + places
        index += struct.pack("<Q", len(self.out) - behind) + name
        self.chunks.append(index + struct.pack("<QQ", len(packed), len(records)))

    def _statistics(self) -> bytes:
        schemas = sum(op == _SCHEMA for op, _ in self.declared)
        channels = len(self.declared) - schemas
        body = struct.pack("<QHIIII", len(self.stamps_ns), schemas, channels, 0, 0, len(self.chunks))
        body += struct.pack("<QQ", min(self.stamps_ns, default=0), max(self.stamps_ns, default=0))
        counts = b"".join(struct.pack("<HQ", *pair) for pair in self.counts.items())
        return _record(_STATISTICS, body + struct.pack("<I", len(counts)) + counts)


def _record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _packed(records: bytes, compression: str) -> bytes:
    if not compression:
        return records
    if compression not in ("lz4", "zstd"):
        raise ValueError(f"no compression {compression!r} is known")
    return bytes(getattr(cramjam, compression).compress(records))
