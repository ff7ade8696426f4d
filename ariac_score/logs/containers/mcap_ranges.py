"""Which bytes of an indexed MCAP file a scan for some topics reads, so that they are fetched together.

Nothing depends on what is foreseen here but the number of requests: whatever else the scan reads is
fetched when it reads it (`ariac_score.logs.containers.ranged`).

Source: MCAP format specification, version 0 (mcap.dev/spec).
"""

from __future__ import annotations

import struct
from collections.abc import Container, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ariac_score.logs.containers.items import IntArray
from ariac_score.logs.containers.ranged import Range, RangedFile

__all__ = ["MAGIC", "foresee"]

MAGIC = b"\x89MCAP0\r\n"
_CHANNEL, _MESSAGE_INDEX, _CHUNK_INDEX = 0x04, 0x07, 0x08
_RECORD, _FOOTER = struct.Struct("<BQ"), struct.Struct("<BQQQI")
_CHUNK = struct.Struct("<QQQQ")
_FIRST_BYTES = 1 << 16
_CHUNK_HEAD_BYTES = 256
_USUAL_INDEX_BYTES = 1 << 13
_MESSAGE_HEAD_BYTES = 31
_SMALL_CHUNK_BYTES = 1 << 17
_LARGE_MESSAGE_BYTES = 1 << 16


@dataclass(frozen=True)
class _Chunk:
    """A chunk as the summary names it: where it is, and whose messages it holds."""

    start: int
    end: int
    channels: frozenset[int]
    plain: bool
    size: int


def foresee(file: RangedFile, topics: Container[str]) -> bool:
    """Fetch what a scan of an MCAP file will read of it.

    Args:
        file: Of which nothing is here.
        topics: Whose messages are wanted.

    Returns:
        Whether that is less than nearly all: it has an index, and large parts that nobody wants.

    Raises:
        OSError: It cannot be fetched.
    """
    file.have([(0, _FIRST_BYTES), (file.size - _FIRST_BYTES, file.size)])
    try:
        found = _summary(file)
        if found is None:
            return False
        names, chunks = found
        deaf = {key for key, topic in names.items() if topic not in topics}
        ranges = list(_outside(chunks, file.size))
        bodies, mixed = _bodies(chunks, set(names), deaf)
        if not file.pays(ranges + bodies):
            return False
        file.have(ranges)
        for chunk in mixed:
            bodies += _but_large(file, chunk, deaf)
    except (struct.error, ValueError, IndexError):
        return False  # the scan says what is wrong with it
    if not file.pays(bodies):
        return False
    file.have(bodies)
    return True


def _summary(file: RangedFile) -> tuple[dict[int, str], list[_Chunk]] | None:
    """Topics by channel, and the chunks; `None` without a summary, or where everything must be read."""
    end = file.size - len(MAGIC) - _FOOTER.size
    _, _, start, _, _ = _FOOTER.unpack(file.bytes_at(end, end + _FOOTER.size))
    if not 0 < start < end:
        return None
    summary = file.bytes_at(start - 4, end)
    if summary[:4] != bytes(4):
        return None  # the data have a checksum, for which all are read
    names, chunks = {}, []
    for op, body in _records(memoryview(summary)[4:]):
        if op == _CHANNEL:
            key, _, length = struct.unpack_from("<HHI", body)
            names[key] = bytes(body[8 : 8 + length]).decode("utf-8", errors="replace")
        elif op == _CHUNK_INDEX:
            chunks.append(_chunk(body, file.size))
    if not chunks or not names:
        return None
    return names, sorted(chunks, key=lambda chunk: chunk.start)


def _chunk(body: memoryview, size: int) -> _Chunk:
    _, _, start, length = _CHUNK.unpack_from(body)
    (offsets,) = struct.unpack_from("<I", body, 32)
    channels = frozenset(struct.unpack_from("<H", body, at)[0] for at in range(36, 36 + offsets, 10))
    at = 36 + offsets + 8
    (named,) = struct.unpack_from("<I", body, at)
    _, inflated = struct.unpack_from("<QQ", body, at + 4 + named)
    if not 0 < start < start + length <= size:
        raise ValueError("a chunk lies outside the file")
    return _Chunk(start, start + length, channels, not named, inflated)


def _outside(chunks: Sequence[_Chunk], size: int) -> Iterator[Range]:
    """What lies before, between and behind the chunks, their heads, and as far as indexes are looked for."""
    at = 0
    for chunk in chunks:
        yield at, min(chunk.start + _CHUNK_HEAD_BYTES, chunk.end)
        yield chunk.end, min(chunk.end + _USUAL_INDEX_BYTES, size)
        at = chunk.end
    yield at, size


def _bodies(
    chunks: Sequence[_Chunk], all_of_them: set[int], deaf: set[int]
) -> tuple[list[Range], list[_Chunk]]:
    """Chunks that are read whole; and those of which large messages are passed over."""
    whole, mixed, declared = list[Range](), list[_Chunk](), set[int]()
    for chunk in chunks:
        # The scan learns whom it need not hear from the chunks; of the first it leaves out, from the summary.
        unwanted = chunk.channels <= declared & deaf
        declared |= all_of_them if unwanted else chunk.channels
        if chunk.size < _SMALL_CHUNK_BYTES or not (unwanted or chunk.plain):
            whole.append((chunk.start, chunk.end))
        elif not unwanted:
            mixed.append(chunk)
    return whole, mixed


def _but_large(file: RangedFile, chunk: _Chunk, deaf: set[int]) -> Iterator[Range]:
    """A chunk that is not compressed, without large messages that nobody wants."""
    records = chunk.end - chunk.size
    found = []
    for key, pairs in _indexes(file, chunk.end):
        found.append((pairs[:, 1], np.full(len(pairs), key in deaf)))
    if not found:
        yield chunk.start, chunk.end
        return
    offsets, unwanted = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(offsets, kind="stable")
    firsts = offsets[order] + _MESSAGE_HEAD_BYTES
    ends = np.append(offsets[order][1:], chunk.size)
    large = unwanted[order] & (ends - firsts >= _LARGE_MESSAGE_BYTES) & (ends <= chunk.size)
    at = chunk.start
    for first, end in zip(firsts[large].tolist(), ends[large].tolist(), strict=True):
        yield at, records + first
        at = records + end
    yield at, chunk.end


def _indexes(file: RangedFile, at: int) -> Iterator[tuple[int, IntArray]]:
    """The message indexes behind a chunk: channel, and the times and offsets of its messages."""
    while at + _RECORD.size <= file.size:
        op, length = _RECORD.unpack(file.bytes_at(at, at + _RECORD.size))
        if op != _MESSAGE_INDEX:
            return
        body = file.bytes_at(at + _RECORD.size, at + _RECORD.size + length)
        (key,) = struct.unpack_from("<H", body)
        yield key, np.frombuffer(body, dtype="<u8", offset=6).reshape(-1, 2).astype(np.int64)
        at += _RECORD.size + length


def _records(view: memoryview) -> Iterator[tuple[int, memoryview]]:
    at = 0
    while at < len(view):
        op, length = _RECORD.unpack_from(view, at)
        at += _RECORD.size
        yield op, view[at : at + length]
        at += length
