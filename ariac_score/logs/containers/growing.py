"""Items of a recording that is still being written, as far as it goes."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

from ariac_score.errors import LogError
from ariac_score.logs.containers import mcap, ros1
from ariac_score.logs.containers.inflating import inflate
from ariac_score.logs.containers.items import Item

__all__ = ["growing_items"]

_LARGEST_RECORD_BYTES = 1 << 32


class _Tail:
    """The bytes of a growing file from one place on."""

    def __init__(self, path: Path) -> None:
        self.path, self._file = path, path.open("rb")
        self.offset = 0

    def at(self, count: int, ahead: int = 0) -> bytes | None:
        """So many bytes from so far ahead; `None` while they are not all there."""
        if count > _LARGEST_RECORD_BYTES:
            raise self.damaged(f"a record of {count} bytes is longer than any")
        self._file.seek(self.offset + ahead)
        found = self._file.read(count)
        return found if len(found) == count else None

    def damaged(self, cause: str) -> LogError:
        """The error for something unreadable at the next byte."""
        return LogError(cause, file=self.path, place=f"byte {self.offset}", hint="score what was recorded")

    def close(self) -> None:
        """Read no more."""
        self._file.close()


def growing_items(path: Path) -> Iterator[Item | None]:
    """The items of an MCAP file or a ROS 1 bag that is being written; `None` where the rest is not there yet.

    It ends where the recorder has closed the file. A chunk is read when it is whole, a plain chunk of a ROS 1
    bag message by message.

    Raises:
        LogError: It is neither, or damaged.
        OSError: It cannot be read.
    """
    tail = _Tail(path)
    try:
        while (magic := tail.at(len(mcap.MAGIC))) is None:
            yield None
        if magic == mcap.MAGIC:
            tail.offset = len(magic)
            yield from _Mcap(path).items(tail)
            return
        while (magic := tail.at(len(ros1.MAGIC))) is None:
            yield None
        if magic != ros1.MAGIC:
            raise tail.damaged("it is no MCAP file and no ROS 1 bag")
        tail.offset = len(magic)
        yield from _Bag(path).items(tail)
    finally:
        tail.close()


class _Mcap(mcap.McapScan):
    def items(self, tail: _Tail) -> Iterator[Item | None]:
        while True:
            head = tail.at(9)
            length = 0 if head is None else struct.unpack_from("<Q", head, 1)[0]
            body = None if head is None else tail.at(length, 9)
            if head is None or body is None:
                yield None
                continue
            if head[0] in (mcap._DATA_END, mcap._FOOTER):
                return
            try:
                if head[0] == 0:
                    raise ValueError("there is no record where one should be")
                if head[0] == mcap._CHUNK:
                    yield from self._items_in_chunk(_records_of(body), tail.offset)
                else:
                    yield from self._items(head[0], body, tail.offset)
            except (struct.error, ValueError) as error:
                raise tail.damaged(str(error)) from error
            tail.offset += 9 + length


def _records_of(chunk: bytes) -> memoryview:
    """The records of an MCAP chunk."""
    size = struct.unpack_from("<Q", chunk, 16)[0]
    named = struct.unpack_from("<I", chunk, 28)[0]
    compression = chunk[32 : 32 + named].decode("utf-8", errors="replace")
    return memoryview(inflate(memoryview(chunk)[40 + named :], compression, size=size))


class _Bag(ros1.Ros1Scan):
    def items(self, tail: _Tail) -> Iterator[Item | None]:
        while True:
            record = _bag_record(tail)
            if record is None:
                if 0 < _index_at(tail) <= tail.offset:
                    return  # the recorder has written where the index starts, and so closed the bag
                yield None
                continue
            header, body, behind = record
            try:
                op = ros1._byte(header, b"op")
                if op == ros1._CHUNK:
                    records = inflate(body, ros1._text(header, b"compression"))
                    yield from self._items_in_chunk(memoryview(records), tail.offset)
                elif op in (ros1._MESSAGE, ros1._CONNECTION):
                    yield from self._items(op, header, memoryview(body), tail.offset)
            except (struct.error, ValueError) as error:
                raise tail.damaged(str(error)) from error
            tail.offset = behind


def _bag_record(tail: _Tail) -> tuple[Mapping[bytes, bytes], bytes, int] | None:
    """Header and body of the next record and what lies behind it; `None` while it is not all there.

    Of a plain chunk without a length the body is empty: what lies behind its head are its records. A recorder
    writes the length when it is done with the chunk.
    """
    head = _sized(tail, 0)
    length = None if head is None else tail.at(4, 4 + len(head))
    if head is None or length is None:
        return None
    try:
        header = ros1._header(head)
        packed = ros1._byte(header, b"op") == ros1._CHUNK and header.get(b"compression") != b"none"
    except ValueError as error:
        raise tail.damaged(str(error)) from error
    body = tail.at(int.from_bytes(length, "little"), 8 + len(head))
    if body is None or (packed and not body and not _index_at(tail)):
        return None
    return header, body, tail.offset + 8 + len(head) + len(body)


def _sized(tail: _Tail, ahead: int) -> bytes | None:
    length = tail.at(4, ahead)
    return None if length is None else tail.at(int.from_bytes(length, "little"), ahead + 4)


def _index_at(tail: _Tail) -> int:
    """Where the index of a bag starts; 0 while it is not closed."""
    # In the file that is open: who closes a bag gives it another name, such as without `.active`.
    at, tail.offset = tail.offset, len(ros1.MAGIC)
    try:
        head = _sized(tail, 0)
        return 0 if head is None else int.from_bytes(ros1._header(head).get(b"index_pos", b""), "little")
    except ValueError:
        return 0
    finally:
        tail.offset = at
