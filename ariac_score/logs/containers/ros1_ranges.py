"""Which bytes of a ROS 1 bag a scan for some topics reads, so that they are fetched together.

As in `mcap_ranges`, nothing depends on what is foreseen here but the number of requests.

Source: ROS wiki, "Bags/Format/2.0".
"""

from __future__ import annotations

import struct
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ariac_score.logs.containers.items import IntArray
from ariac_score.logs.containers.ranged import Range, RangedFile

__all__ = ["foresee"]

_MAGIC = b"#ROSBAG V2.0\n"
_BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = (bytes([op]) for op in (3, 4, 5, 6, 7))
_U32, _U64, _TWO = struct.Struct("<I"), struct.Struct("<Q"), struct.Struct("<II")
_FIRST_BYTES = 1 << 16
_CHUNK_HEAD_BYTES = 256
_LARGEST_INDEX_BYTES = 1 << 26
_USUAL_INDEX_BYTES = 1 << 15
"""So much the scan looks at behind a chunk."""
_INDEX_HEAD_BYTES, _ENTRY_BYTES = 55, 12
"""What recorders write of an index record before its entries, and of each entry."""
_MESSAGE_HEAD_BYTES = 128
_LARGE_MESSAGE_BYTES = 1 << 16


@dataclass(frozen=True)
class _Chunk:
    """A chunk as the end of the bag names it: where its record starts, how many messages of whom it holds."""

    start: int
    counts: Mapping[int, int]

    @property
    def index_bytes(self) -> int:
        """How long the index behind it is, as recorders write it."""
        entries = 0
        for count in self.counts.values():
            entries += count
        return len(self.counts) * _INDEX_HEAD_BYTES + entries * _ENTRY_BYTES


@dataclass(frozen=True)
class _Body:
    """The records of a chunk: where they are, and whether they are not compressed."""

    start: int
    end: int
    plain: bool


def foresee(file: RangedFile, topics: Container[str]) -> bool:
    """Fetch what a scan of a ROS 1 bag will read of it.

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
        at = _index_pos(file)
        if not at:
            return False
        names, chunks = _contents(file.bytes_at(at, file.size))
        heads = list(_between(chunks, at))
        if not chunks or not file.pays(heads):
            return False
        file.have(heads)
        bodies = [_body(file, chunk, at) for chunk in chunks]
        ranges = [(body.end, min(body.end + _USUAL_INDEX_BYTES, at)) for body in bodies]
        whole, mixed = _wanted(chunks, bodies, names, topics)
        if not file.pays(ranges + whole):
            return False
        file.have(ranges)
        for body, deaf in mixed:
            whole += _but_large(file, body, deaf)
    except (struct.error, ValueError, KeyError):
        return False  # the scan says what is wrong with it
    if not file.pays(whole):
        return False
    file.have(whole)
    return True


def _index_pos(file: RangedFile) -> int:
    """Where the end of the bag starts, which names what is in it; 0 without one."""
    if file.bytes_at(0, len(_MAGIC)) != _MAGIC:
        return 0
    head, _, _ = _record(memoryview(file.bytes_at(0, _FIRST_BYTES)), len(_MAGIC))
    if head[b"op"] != _BAG:
        return 0
    (at,) = _U64.unpack(head[b"index_pos"])
    return int(at) if len(_MAGIC) < at < file.size and file.size - at <= _LARGEST_INDEX_BYTES else 0


def _contents(records: bytes) -> tuple[dict[int, str], list[_Chunk]]:
    """Topics by connection, and the chunks."""
    view, at = memoryview(records), 0
    names, chunks = dict[int, str](), list[_Chunk]()
    while at < len(view):
        head, body, at = _record(view, at)
        if head[b"op"] == _CONNECTION:
            names[_U32.unpack(head[b"conn"])[0]] = head[b"topic"].decode("utf-8", errors="replace")
        elif head[b"op"] == _CHUNK_INFO:
            (start,) = _U64.unpack(head[b"chunk_pos"])
            chunks.append(_Chunk(start, dict(_TWO.iter_unpack(body))))
    return names, sorted(chunks, key=lambda chunk: chunk.start)


def _between(chunks: Sequence[_Chunk], behind: int) -> Iterator[Range]:
    """The heads of the chunks, each with the index of the chunk before it."""
    index_bytes = 0
    for chunk in chunks:
        yield chunk.start - index_bytes, chunk.start + _CHUNK_HEAD_BYTES
        index_bytes = chunk.index_bytes
    yield behind - index_bytes, behind


def _body(file: RangedFile, chunk: _Chunk, behind: int) -> _Body:
    view = memoryview(file.bytes_at(chunk.start, min(chunk.start + _CHUNK_HEAD_BYTES, file.size)))
    (size,) = _U32.unpack_from(view)
    head = _fields(view[4 : 4 + size])
    (length,) = _U32.unpack_from(view, 4 + size)
    start = chunk.start + 8 + size
    if head[b"op"] != _CHUNK or start + length > behind:
        raise ValueError("there is no chunk where one should be")
    return _Body(start, start + length, head[b"compression"] == b"none")


def _wanted(
    chunks: Sequence[_Chunk], bodies: Sequence[_Body], names: Mapping[int, str], topics: Container[str]
) -> tuple[list[Range], list[tuple[_Body, set[int]]]]:
    """Chunks that are read whole; and those of which large messages of some connections are passed over.

    A connection is declared where its first message is, and until all are the scan passes over no chunk.
    """
    whole, mixed, declared = list[Range](), list[tuple[_Body, set[int]]](), set[int]()
    deaf = {key for key, topic in names.items() if topic not in topics}
    for chunk, body in zip(chunks, bodies, strict=True):
        if chunk.counts.keys() <= deaf and names.keys() <= declared:
            continue
        known = declared & deaf
        if body.plain and chunk.counts.keys() & known:
            mixed.append((body, known))
        else:
            whole.append((body.start, body.end))
        declared |= chunk.counts.keys()
    return whole, mixed


def _but_large(file: RangedFile, body: _Body, deaf: set[int]) -> Iterator[Range]:
    """A chunk that is not compressed, without large messages that nobody wants."""
    found = [(offsets, np.full(len(offsets), key in deaf)) for key, offsets in _indexes(file, body.end)]
    if not found:
        yield body.start, body.end
        return
    offsets, unwanted = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.argsort(offsets, kind="stable")
    size = body.end - body.start
    firsts, ends = offsets[order] + _MESSAGE_HEAD_BYTES, np.append(offsets[order][1:], size)
    large = unwanted[order] & (ends - firsts >= _LARGE_MESSAGE_BYTES) & (ends <= size)
    at = 0
    for first, end in zip(firsts[large].tolist(), ends[large].tolist(), strict=True):
        yield body.start + at, body.start + first
        at = end
    yield body.start + at, body.end


def _indexes(file: RangedFile, at: int) -> Iterator[tuple[int, IntArray]]:
    """The index records behind a chunk: connection, and the places of its messages."""
    view = memoryview(file.bytes_at(at, min(at + _USUAL_INDEX_BYTES, file.size)))
    here = 0
    while here < len(view):
        try:
            head, body, here = _record(view, here)
        except (struct.error, ValueError):
            return  # it goes on behind what is usual; what it tells there is not foreseen
        if head[b"op"] != _INDEX:
            return
        entries = np.frombuffer(body, dtype="<u4").reshape(-1, 3)
        yield _U32.unpack(head[b"conn"])[0], entries[:, 2].astype(np.int64)


def _record(view: memoryview, at: int) -> tuple[Mapping[bytes, bytes], memoryview, int]:
    """The header of a record by name, its data, and where the next one starts."""
    head, at = _sized(view, at)
    body, at = _sized(view, at)
    return _fields(head), body, at


def _sized(view: memoryview, at: int) -> tuple[memoryview, int]:
    (length,) = _U32.unpack_from(view, at)
    end = at + 4 + length
    if end > len(view):
        raise ValueError("a record ends behind the last byte")
    return view[at + 4 : end], end


def _fields(head: memoryview) -> dict[bytes, bytes]:
    found, at = dict[bytes, bytes](), 0
    while at < len(head):
        field, at = _sized(head, at)
        name, _, value = bytes(field).partition(b"=")
        found[name] = value
    return found
