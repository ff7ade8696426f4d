"""Writing an MCAP file as messages come: readable up to its last chunk, indexed when it is closed.

Source: MCAP format specification, version 0 (mcap.dev/spec).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from ariac_score.errors import LiveError
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.logs.containers.mcap import MAGIC, UNSEEN_LOSSES

__all__ = ["McapWriter"]

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
_MESSAGE_INDEX, _CHUNK_INDEX, _STATISTICS, _DATA_END = 0x07, 0x08, 0x0B, 0x0F
_CHUNK_BYTES = 1 << 20
_CHUNK_NS = 10**9
"""A chunk is written when it is so large, or when its messages are of so long: all that a crash can cost."""
_MOST_CHANNELS = (1 << 16) - 1


class McapWriter:
    """Writes one MCAP file.

    Args:
        path: A file that is not there yet.

    Raises:
        LiveError: It cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file: BinaryIO = path.open("xb")
        except FileExistsError:
            raise LiveError("is there already", file=path, hint="give --record a new name") from None
        except OSError as cause:
            raise _cannot_be_written(path, cause) from cause
        self._at = 0
        self._schemas: dict[tuple[str, str, str], int] = {}
        self._declared: list[bytes] = []
        self._channels: dict[Connection, int] = {}
        self._records, self._offsets = bytearray(), dict[int, list[tuple[int, int]]]()
        self._chunk_ns: list[int] = []
        self._chunks: list[bytes] = []
        self._counts: dict[int, int] = {}
        self._first_ns, self._last_ns, self._closed = 1 << 63, 0, False
        self._put(MAGIC + _record(_HEADER, _text("") + _text("ariac-score")))
        self._flush()

    def declare(self, connection: Connection, *, latched: bool = False) -> Connection:
        """Declare a channel; the connection as who reads the file sees it.

        Raises:
            LiveError: There are too many, or the file cannot be written.
        """
        number = len(self._channels) + 1
        if number > _MOST_CHANNELS:
            raise LiveError(f"more than {_MOST_CHANNELS} channels were announced", file=self.path)
        format_ = connection.definition_format if connection.definition else ""
        key = connection.type, format_, connection.definition
        if key not in self._schemas:
            self._schemas[key] = len(self._schemas) + 1
            body = _text(connection.type) + _text(format_) + _text(connection.definition)
            self._declare(_record(_SCHEMA, struct.pack("<H", self._schemas[key]) + body))
        facts = {"publisher": connection.publisher, "latched": "1" if latched else ""}
        metadata = b"".join(_text(name) + _text(value) for name, value in facts.items() if value)
        if not connection.sees_losses:
            metadata += UNSEEN_LOSSES
        head = struct.pack("<HH", number, self._schemas[key])
        body = _text(connection.topic) + _text(connection.encoding) + struct.pack("<I", len(metadata))
        self._declare(_record(_CHANNEL, head + body + metadata))
        # As the scan of MCAP files names it.
        read = Connection(
            connection.topic,
            connection.type,
            connection.encoding,
            connection.definition,
            format_,
            f"channel {number}",
            connection.sees_losses,
        )
        self._channels[read] = number
        return read

    def write(self, message: Message, sent_ns: int | None) -> None:
        """Write a message of a declared connection.

        Raises:
            LiveError: The file cannot be written.
        """
        channel, stamp_ns = self._channels[message.connection], message.stamp_ns
        self._offsets.setdefault(channel, []).append((stamp_ns, len(self._records)))
        self._counts[channel] = self._counts.get(channel, 0) + 1
        published_ns = stamp_ns if sent_ns is None or not 0 <= sent_ns < 1 << 63 else sent_ns
        length = 22 + len(message.payload)
        self._records += struct.pack(
            "<BQHIQQ", _MESSAGE, length, channel, message.sequence & 0xFFFFFFFF, stamp_ns, published_ns
        )
        self._records += message.payload
        self._chunk_ns.append(stamp_ns)
        if len(self._records) >= _CHUNK_BYTES or stamp_ns - self._chunk_ns[0] >= _CHUNK_NS:
            self._end_chunk()

    def close(self) -> None:
        """Write what is left, and the index."""
        if self._closed:
            return
        self._closed = True
        self._end_chunk()
        self._put(_record(_DATA_END, struct.pack("<I", 0)))
        summary = self._at
        for declaration in sorted(self._declared, key=lambda record: record[0]):
            self._put(declaration)
        counts = b"".join(struct.pack("<HQ", *one) for one in sorted(self._counts.items()))
        numbers = len(self._schemas), len(self._channels), 0, 0, len(self._chunks)
        first_ns = 0 if not self._counts else self._first_ns
        head = struct.pack("<QHIIIIQQ", sum(self._counts.values()), *numbers, first_ns, self._last_ns)
        self._put(_record(_STATISTICS, head + struct.pack("<I", len(counts)) + counts))
        for chunk in self._chunks:
            self._put(chunk)
        self._put(_record(_FOOTER, struct.pack("<QQI", summary, 0, 0)) + MAGIC)
        self._flush()
        self._file.close()

    def _declare(self, record: bytes) -> None:
        self._end_chunk()  # outside of chunks, so that no chunk must be read to know what there is
        self._declared.append(record)
        self._put(record)

    def _end_chunk(self) -> None:
        if not self._chunk_ns:
            return
        start, records = self._at, bytes(self._records)
        earliest_ns, latest_ns = min(self._chunk_ns), max(self._chunk_ns)
        head = struct.pack("<QQQI", earliest_ns, latest_ns, len(records), crc32(records)) + _text("")
        self._put(_record(_CHUNK, head + struct.pack("<Q", len(records)) + records))
        size, places = self._at - start, b""
        index_at = self._at
        for channel, entries in sorted(self._offsets.items()):
            places += struct.pack("<HQ", channel, self._at)
            packed = b"".join(struct.pack("<QQ", *entry) for entry in entries)
            self._put(_record(_MESSAGE_INDEX, struct.pack("<HI", channel, len(packed)) + packed))
        body = struct.pack("<QQQQI", earliest_ns, latest_ns, start, size, len(places)) + places
        body += struct.pack("<Q", self._at - index_at) + _text("")
        self._chunks.append(_record(_CHUNK_INDEX, body + struct.pack("<QQ", len(records), len(records))))
        self._first_ns, self._last_ns = min(self._first_ns, earliest_ns), max(self._last_ns, latest_ns)
        self._records.clear()
        self._offsets.clear()
        self._chunk_ns.clear()
        self._flush()

    def _put(self, raw: bytes) -> None:
        try:
            self._file.write(raw)
        except OSError as cause:
            raise _cannot_be_written(self.path, cause) from cause
        self._at += len(raw)

    def _flush(self) -> None:
        try:
            self._file.flush()
        except OSError as cause:
            raise _cannot_be_written(self.path, cause) from cause


def _record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def _text(text: str) -> bytes:
    raw = text.encode("utf-8", errors="replace")
    return struct.pack("<I", len(raw)) + raw


def _cannot_be_written(path: Path, cause: OSError) -> LiveError:
    return LiveError(
        f"cannot be written: {cause.strerror}", file=path, hint="check folder, disk and permissions"
    )
