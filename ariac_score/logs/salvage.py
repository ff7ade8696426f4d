"""Reading a recording from its first byte on: what every container has in common.

The containers are read by scanning, not by their index: so stamps keep their
recorded order, every checksum is verified, nothing inflates beyond its announced
size, and of a damaged file we know how far it can be read. rosbags does the
message definitions and the messages (`ariac_score.logs.types`).
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, Protocol

from ariac_score.errors import LogError
from ariac_score.logs.columnar.columns import IntArray, Payloads
from ariac_score.logs.ranged import open_log, ranged
from ariac_score.records import dataclass

__all__ = [
    "LARGEST_FILE_BYTES",
    "LARGEST_INFLATED_BYTES",
    "MAX_PEEK_BYTES",
    "MOST_INFLATION",
    "Batch",
    "Connection",
    "FileScan",
    "Message",
    "Scan",
    "Source",
    "check_announced",
    "checked_stamp",
    "inflate",
    "inflate_file",
    "inflate_into",
    "normalised_type",
]


def _limit(name: str, default: int) -> int:
    """A limit that the environment may set."""
    text = os.environ.get(name, "")
    if text and not (text.isascii() and text.isdigit()):
        raise LogError(f"the environment variable {name} is {text!r}", hint="give a whole number")
    return int(text) if text else default


LARGEST_INFLATED_BYTES = _limit("ARIAC_SCORE_LARGEST_CHUNK_BYTES", 1 << 30)
"""A chunk or message that announces more is refused: recorders write some MB."""

LARGEST_FILE_BYTES = _limit("ARIAC_SCORE_LARGEST_FILE_BYTES", 1 << 37)
"""A compressed file that inflates to more is refused."""

MOST_INFLATION = _limit("ARIAC_SCORE_MOST_INFLATION", 1000)
"""So many times its size anything may inflate to, once it is large."""

_ALWAYS_ALLOWED_BYTES = 1 << 26
_BLOCK_BYTES = 1 << 20
_BUFFER_BYTES = 1 << 14
_KEPT_BYTES = 1 << 20
_LATEST_NS = 2**63
_TWO_PART_TYPE = re.compile(r"([A-Za-z]\w*)/([A-Za-z]\w*)", re.ASCII)
_RE_RECORD = "record the trial again, or take another copy of the file; a score may not rest on part of a log"


@dataclass(frozen=True, eq=False)
class Connection:
    """One publisher's (or channel's) declaration in a recording; compared by identity.

    Attributes:
        topic: With leading slash.
        type: `package/msg/Name`; empty when the container does not say.
        encoding: `cdr`, `ros1`, or whatever the container names.
        definition: Text of the message definition; empty when the recording has none.
        definition_format: `ros1msg`, `ros2msg` or `ros2idl`; empty without definition.
    """

    topic: str
    type: str
    encoding: str
    definition: str = ""
    definition_format: str = ""


class Message(NamedTuple):
    """One recorded message: who sent it, its log time in ns, and its bytes."""

    connection: Connection
    stamp_ns: int
    payload: bytes | memoryview


@dataclass(frozen=True, eq=False)
class Batch:
    """Many recorded messages, in recorded order.

    Attributes:
        connections: Who sent some of them.
        sources: Of each message its sender's place among these, shape (n,).
        stamps_ns: Their log times in ns, each checked to be one, shape (n,).
        payloads: Their bytes.
    """

    connections: tuple[Connection, ...]
    sources: IntArray
    stamps_ns: IntArray
    payloads: Payloads

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def messages(self) -> Iterator[Message]:
        """One by one."""
        raw = memoryview(self.payloads.buffer)  # type: ignore[arg-type]  # an array is a buffer
        places = zip(self.payloads.starts.tolist(), self.payloads.ends.tolist(), strict=True)
        for source, stamp_ns, (start, end) in zip(
            self.sources.tolist(), self.stamps_ns.tolist(), places, strict=True
        ):
            yield Message(self.connections[source], stamp_ns, raw[start:end])


class Scan(Protocol):
    """One recording, read once from start to end.

    Iterating yields every declared connection before its first message, and the
    messages in recorded order, singly or in batches. Their bytes hold until the next item
    is asked for: the memory they lie in is used again. It raises `LogError` where the recording stops
    being readable, and at the end when it turns out not to be whole.

    Attributes:
        format: In words.
    """

    format: str

    @property
    def readable(self) -> str:
        """How far reading got, such as `byte 10344`."""
        ...

    @property
    def share(self) -> float:
        """The share read, 0 to 1."""
        ...

    @property
    def index_contradictions(self) -> int:
        """How often its index said something else than its records, which then counted."""
        ...

    def __iter__(self) -> Iterator[Connection | Message | Batch]:
        """Every declared connection and message."""
        ...


def normalised_type(name: str) -> str:
    """The one spelling of a message type.

    >>> normalised_type("nist_gear/Order")
    'nist_gear/msg/Order'
    """
    parts = _TWO_PART_TYPE.fullmatch(name)
    return f"{parts[1]}/msg/{parts[2]}" if parts else name


def checked_stamp(stamp_ns: object, *, file: Path, place: str) -> int:
    """A log time that can be one.

    Raises:
        LogError: It is negative, beyond the year 2262, or no whole number.
    """
    if not isinstance(stamp_ns, int) or not 0 <= stamp_ns < _LATEST_NS:
        raise LogError(f"{stamp_ns!r} is no log time", file=file, place=place, hint=_RE_RECORD)
    return stamp_ns


MAX_PEEK_BYTES = 64 * 2**20
"""What is looked at of a chunk that the file ends in, bytes."""


class Source:
    """A file read from front to back, never beyond its end.

    Attributes:
        path: The file.
        size: Its size, bytes.
        offset: Where the next read starts, bytes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.hint = _RE_RECORD
        self._file: BinaryIO = open_log(path, 0)
        self._parts = ranged(path)
        self.size = path.stat().st_size
        self.offset = 0
        # What was looked at last, and where it starts: little things are taken from it without
        # asking the system, which would let other threads go first.
        self._seen, self._seen_at = b"", 0

    def __enter__(self) -> Source:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @property
    def left(self) -> int:
        """Bytes not read yet."""
        return self.size - self.offset

    def damaged(self, cause: str, *, what: str = "", at: int | None = None) -> LogError:
        """The error for something unreadable at a byte offset (default: the next one)."""
        place = f"byte {self.offset if at is None else at}"
        return LogError(cause, file=self.path, place=f"{what} at {place}" if what else place, hint=self.hint)

    def take(self, count: int, what: str) -> bytes:
        """The next bytes.

        Raises:
            LogError: The file ends before.
        """
        self._reserve(count, what)
        first = self.offset - self._seen_at
        if first < 0 or first + count > len(self._seen):
            if count > _BUFFER_BYTES:
                taken = self._read(self.offset, count)
            else:
                self._seen, self._seen_at, first = self._read(self.offset, _BUFFER_BYTES), self.offset, 0
                taken = self._seen[:count]
        else:
            taken = self._seen[first : first + count]
        if len(taken) != count:
            raise self.damaged("the file ends early", what=what)
        self.offset += count
        return taken

    def take_into(self, room: memoryview, what: str) -> None:
        """The next bytes, put where there is room for them.

        Raises:
            LogError: The file ends before.
        """
        self._reserve(len(room), what)
        if self._read_into(self.offset, room) != len(room):
            raise self.damaged("the file ends early", what=what)
        self.offset += len(room)

    def later(self, count: int, what: str) -> Callable[[memoryview], None]:
        """Move on over the next bytes, which are read later.

        Args:
            count: How many.
            what: They are, for the error.

        Returns:
            Puts them into room of that size, on whatever thread; it raises ValueError when the
            file ends early.

        Raises:
            LogError: The file ends before.
        """
        if not hasattr(os, "preadv"):
            taken = self.take(count, what)

            def put(room: memoryview) -> None:
                room[:] = taken

            return put
        self._reserve(count, what)
        file, offset = self._file.fileno(), self.offset
        if self._parts:
            self._parts.have([(offset, offset + count)])
        self.skip(count)

        def read(room: memoryview) -> None:
            done = 0
            while done < len(room):
                read = os.preadv(file, [room[done:]], offset + done)
                if not read:
                    raise ValueError("the file ends early")
                done += read

        return read

    def read_at(self, offset: int, room: memoryview, what: str) -> None:
        """Bytes from elsewhere, put where there is room for them, without moving on.

        Raises:
            LogError: They are not there.
        """
        if self._read_into(offset, room) != len(room):
            raise self.damaged("the file ends early", what=what, at=offset)

    def skip(self, count: int) -> None:
        """Move on over bytes that are there."""
        self.offset += count

    def peek(self, count: int) -> bytes:
        """The next bytes, at most so many, without moving on."""
        return self._read(self.offset, min(count, MAX_PEEK_BYTES))

    def at(self, offset: int, count: int) -> bytes:
        """Bytes from elsewhere, as far as they are there, without moving on."""
        if not 0 <= offset < self.size:
            return b""
        count = min(count, MAX_PEEK_BYTES)
        if self._parts:
            self._parts.have([(offset, offset + count)])
        found = self._read(offset, count)
        if len(found) <= _KEPT_BYTES:
            self._seen, self._seen_at = found, offset
        return found

    def _read(self, offset: int, count: int) -> bytes:
        """Bytes from anywhere, fewer where the file ends."""
        if hasattr(os, "pread") and not self._parts:
            found = os.pread(self._file.fileno(), count, offset)
            if len(found) == count or offset + len(found) >= self.size:
                return found
        # The system gave less than there is, or the file has holes.
        room = bytearray(max(0, min(count, self.size - offset)))
        return bytes(room[: self._read_into(offset, memoryview(room))])

    def _read_into(self, offset: int, room: memoryview) -> int:
        """Put bytes from anywhere where there is room for them; returns how many there were."""
        done = 0
        self._file.seek(offset)
        while done < len(room):
            count = self._file.readinto(room[done:])  # type: ignore[attr-defined]  # every file has it
            if not count:
                break
            done += count
        return done

    def blocks(self, count: int, what: str) -> Iterator[bytes]:
        """The next bytes, in blocks, for what is passed over."""
        self._reserve(count, what)
        while count:
            block = self.take(min(count, _BLOCK_BYTES), what)
            count -= len(block)
            yield block

    def _reserve(self, count: int, what: str) -> None:
        # Before reading: a length word from a hostile file must not make us ask for that much memory.
        if count > self.left:
            raise self.damaged(
                f"the file is cut off: {what} needs {count} bytes, {max(self.left, 0)} are there", what=what
            )


class FileScan:
    """What scans of one file share: where they are in it, and how far it was readable.

    Attributes:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._readable = "byte 0"
        self._source: Source | None = None
        self._contradictions = self._done = self._handed_over = 0
        self._is_settling = False

    def _reached(self, offset: int) -> None:
        """Take note that everything before this byte was readable."""
        self._done, self._readable = offset, f"byte {offset}"

    def _hands_over(self, offset: int) -> None:
        """Take note that what comes now is everything up to this byte."""
        self._handed_over = offset

    @property
    def index_contradictions(self) -> int:
        """How often the index said something else than the records."""
        return self._contradictions

    @property
    def readable(self) -> str:
        """How far reading got."""
        return self._readable

    @property
    def share(self) -> float:
        """The share read, 0 to 1, what was handed over last included."""
        source = self._source
        return max(self._done, self._handed_over) / source.size if source and source.size else 0.0


_INFLATERS = {
    "bz2": ("bz2", "BZ2Decompressor"),
    "lz4": ("lz4.frame", "LZ4FrameDecompressor"),
    "zstd": ("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd", "ZstdDecompressor"),
}


def inflate(packed: bytes | memoryview, compression: str, *, size: int | None = None) -> bytes | memoryview:
    """Undo a compression without ever producing more than announced.

    Args:
        packed: One compressed frame.
        compression: `bz2`, `lz4`, `zstd`, or empty or `none`.
        size: The announced size, bytes; `None` when nothing announces it.

    Raises:
        ValueError: It cannot be inflated to that size; the message says why.
    """
    if size is not None:
        check_announced(size, len(packed))
    if compression in ("", "none"):
        inflated: bytes | memoryview = packed
    elif compression in _INFLATERS:
        inflated = _inflate(packed, compression, LARGEST_INFLATED_BYTES if size is None else size)
    else:
        raise ValueError(f"compression {compression!r} is not one of {', '.join(sorted(_INFLATERS))}")
    if size is not None and len(inflated) != size:
        raise ValueError(f"it holds {len(inflated)} bytes instead of the announced {size}")
    return inflated


def check_announced(size: int, packed: int | None = None) -> None:
    """Make sure that so many bytes may be inflated at all, from so many packed ones.

    Raises:
        ValueError: They are too many.
    """
    if size > LARGEST_INFLATED_BYTES:
        raise ValueError(f"it announces {size} bytes, more than the {LARGEST_INFLATED_BYTES} allowed")
    if packed is not None and size > max(_ALWAYS_ALLOWED_BYTES, packed * MOST_INFLATION):
        raise ValueError(
            f"it announces {size} bytes in {packed}, more than {MOST_INFLATION} times as many are not allowed"
        )


def inflate_file(packed: Path, into: Path) -> None:
    """Undo the zstd compression of a whole file, piece by piece.

    Raises:
        ValueError: It cannot be inflated, or inflates to more than is allowed.
    """
    module = import_module(_INFLATERS["zstd"][0])
    engine, total = module.ZstdDecompressor(), 0
    most = min(LARGEST_FILE_BYTES, max(_ALWAYS_ALLOWED_BYTES, packed.stat().st_size * MOST_INFLATION))
    with packed.open("rb") as source, into.open("wb") as target:
        while not engine.eof:
            feed = source.read(_BLOCK_BYTES) if engine.needs_input else b""
            if engine.needs_input and not feed:
                raise ValueError("its zstd data ends early")
            try:
                part = engine.decompress(feed, max_length=_BLOCK_BYTES)
            except module.ZstdError as error:
                raise ValueError(f"its zstd data is broken: {error}") from error
            total += len(part)
            if total > most:
                raise ValueError(f"its zstd data inflates to more than {most} bytes")
            target.write(part)
        if engine.unused_data or source.read(1):
            raise ValueError("bytes follow its zstd data")


def inflate_into(room: memoryview, packed: bytes | memoryview, compression: str) -> None:
    """Undo a compression whose announced size is the size of a buffer, into that buffer.

    Raises:
        ValueError: It cannot be inflated to that size; the message says why.
    """
    if compression in _ENDS and _inflate_fast(room, packed, compression):
        return
    room[:] = inflate(packed, compression, size=len(room))


def _inflate_fast(room: memoryview, packed: bytes | memoryview, compression: str) -> bool:
    """Inflate one whole frame where cramjam is installed, which writes in place.

    Whatever is odd is left undone, for the slower way to tell.
    """
    cramjam = _cramjam()
    if cramjam is None or not room or _ENDS[compression](packed) != len(packed):
        return False
    try:
        count: int = getattr(cramjam, compression).decompress_into(packed, room)
    except cramjam.DecompressionError:
        return False
    return count == len(room)


@cache
def _cramjam() -> Any:
    try:
        return import_module("cramjam")
    except ImportError:
        return None


def _end_of_lz4(packed: bytes | memoryview) -> int:
    """Where a frame of lz4 ends, by the lengths of its blocks; -1 when it is none.

    Source: LZ4 frame format description, version 1.6.
    """
    if len(packed) < 7 or packed[:4] != b"\x04\x22\x4d\x18":
        return -1
    flags = packed[4]
    if flags >> 6 != 1 or flags & 0b11:
        return -1  # of another version, or with a dictionary
    at = 7 + (8 if flags & 0b1000 else 0)
    behind_block, behind_frame = (4 if flags & bit else 0 for bit in (0b10000, 0b100))
    while at + 4 <= len(packed):
        length = int.from_bytes(packed[at : at + 4], "little") & 0x7FFFFFFF
        at += 4
        if not length:
            return at + behind_frame
        at += length + behind_block
    return -1


def _end_of_zstd(packed: bytes | memoryview) -> int:
    """Where the frame that starts some bytes ends; -1 when they are none, or it is not whole.

    Source: RFC 8878, 3.1.1.
    """
    if len(packed) < 6 or bytes(packed[:4]) != b"\x28\xb5\x2f\xfd":
        return -1
    flags = packed[4]
    alone, size_flag = flags >> 5 & 1, flags >> 6
    size_bytes = (alone, 2, 4, 8)[size_flag]
    at = 5 + (1 - alone) + (0, 1, 2, 4)[flags & 3] + size_bytes
    while at + 3 <= len(packed):
        head = int.from_bytes(packed[at : at + 3], "little")
        at += 3 + (1 if head >> 1 & 3 == _ZSTD_REPEATED else head >> 3)
        if head & 1:
            return at + 4 * (flags >> 2 & 1)
    return -1


_ZSTD_REPEATED = 1

_ENDS = {"lz4": _end_of_lz4, "zstd": _end_of_zstd}


def _inflate(packed: bytes | memoryview, compression: str, most: int) -> bytes:
    module_name, name = _INFLATERS[compression]
    try:
        module = import_module(module_name)
    except ImportError as error:
        raise ValueError(f"its {compression} data needs the Python module {module_name!r}") from error
    engine = getattr(module, name)()
    failures = (OSError, EOFError, RuntimeError, ValueError, getattr(module, "ZstdError", OSError))
    parts: list[bytes] = []
    room = most + 1
    try:
        while room > 0 and not engine.eof:
            part: bytes = engine.decompress(b"" if parts else bytes(packed), max_length=room)
            parts.append(part)
            room -= len(part)
            if not part and engine.needs_input:
                break
    except failures as error:
        raise ValueError(f"its {compression} data is broken: {error}") from error
    if room <= 0:
        raise ValueError(f"its {compression} data inflates to more than {most} bytes")
    if not engine.eof:
        raise ValueError(f"its {compression} data ends early")
    if engine.unused_data:
        raise ValueError(f"{len(engine.unused_data)} bytes follow its {compression} data")
    return b"".join(parts)
