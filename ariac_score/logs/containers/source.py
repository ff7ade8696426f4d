"""Reading the bytes of a recording from front to back, which the scans of all containers share.

Containers are scanned, not read by their index: so stamps keep their recorded order,
every checksum is verified, nothing inflates beyond its announced size, and it is known
how far a damaged file is readable. rosbags parses the message definitions
(`ariac_score.logs.columnar.types`).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

from ariac_score.errors import CutOffError, LogError
from ariac_score.installed.system import read_at
from ariac_score.logs.containers.items import RE_RECORD
from ariac_score.logs.containers.ranged import open_log, ranged

__all__ = ["BLOCK_BYTES", "MAX_PEEK_BYTES", "Source"]


BLOCK_BYTES = 1 << 20


_BUFFER_BYTES = 1 << 14


_KEPT_BYTES = 1 << 20
"""Bytes looked up elsewhere are kept up to this size, for they are mostly read next."""


MAX_PEEK_BYTES = 64 * 2**20
"""The most that is read of a chunk that the file ends in, bytes."""


class Source:
    """A file read from front to back, never beyond its end.

    Attributes:
        path: The file.
        size: Its size, bytes.
        offset: Where the next read starts, bytes.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.hint = RE_RECORD
        self._file: BinaryIO = open_log(path, 0)
        self._parts = ranged(path)
        self.size = path.stat().st_size
        self.offset = 0
        # The bytes read last and their offset. Small reads are served from them, because every system
        # call releases the interpreter lock, and the threads that inflate would take it first.
        self._seen, self._seen_at = b"", 0

    def __enter__(self) -> Source:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @property
    def left(self) -> int:
        """Bytes not read yet."""
        return self.size - self.offset

    def cut_off(self, cause: str, *, what: str = "", at: int | None = None) -> CutOffError:
        """The error for a file that ends before its end; arguments as of `damaged`."""
        error = self.damaged(cause, what=what, at=at)
        return CutOffError(error.cause, file=error.file, place=error.place, hint=error.hint)

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
            raise self.cut_off("the file ends early", what=what)
        self.offset += count
        return taken

    def take_into(self, room: memoryview, what: str) -> None:
        """The next bytes, read into a buffer.

        Raises:
            LogError: The file ends before.
        """
        self._reserve(len(room), what)
        if self._read_into(self.offset, room) != len(room):
            raise self.cut_off("the file ends early", what=what)
        self.offset += len(room)

    def later(self, count: int, what: str) -> Callable[[memoryview], None]:
        """Move on over the next bytes, which are read later.

        Args:
            count: Their number.
            what: What they are, for the error.

        Returns:
            A function that reads them into a buffer of that size, on any thread; it raises
            ValueError when the file ends early.

        Raises:
            LogError: The file ends before.
        """
        if not hasattr(os, "preadv"):  # such as on Windows: another thread may not move the file's position
            taken = self.take(count, what)

            def put(room: memoryview) -> None:
                room[:] = taken

            return put
        self._reserve(count, what)
        file, offset = self._file, self.offset
        if self._parts:
            self._parts.have([(offset, offset + count)])
        self.skip(count)

        def read(room: memoryview) -> None:
            done = 0
            while done < len(room):
                read = read_at(file, room[done:], offset + done)
                if not read:
                    raise ValueError("the file ends early")
                done += read

        return read

    def read_at(self, offset: int, room: memoryview, what: str) -> None:
        """Bytes from elsewhere, read into a buffer without moving on.

        Raises:
            LogError: They are not there.
        """
        if self._read_into(offset, room) != len(room):
            raise self.cut_off("the file ends early", what=what, at=offset)

    def skip(self, count: int) -> None:
        """Move on over bytes that are there."""
        self.offset += count

    def peek(self, count: int) -> bytes:
        """The next bytes, at most so many, without moving on."""
        return self._read(self.offset, min(count, MAX_PEEK_BYTES))

    def at(self, offset: int, count: int) -> bytes:
        """Bytes from elsewhere, fewer where the file ends, without moving on."""
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
        # A read may return less than there is, and a file with holes must be filled first.
        room = bytearray(max(0, min(count, self.size - offset)))
        return bytes(room[: self._read_into(offset, memoryview(room))])

    def _read_into(self, offset: int, room: memoryview) -> int:
        """Read bytes from anywhere into a buffer; returns how many there were."""
        done = 0
        self._file.seek(offset)
        while done < len(room):
            count = self._file.readinto(room[done:])  # type: ignore[attr-defined]  # every file has it
            if not count:
                break
            done += count
        return done

    def blocks(self, count: int, what: str) -> Iterator[bytes]:
        """The next bytes in blocks, for records that are skipped but count for a checksum."""
        self._reserve(count, what)
        while count:
            block = self.take(min(count, BLOCK_BYTES), what)
            count -= len(block)
            yield block

    def _reserve(self, count: int, what: str) -> None:
        # Before reading: a length word of a hostile file must not make us allocate that much memory.
        if count > self.left:
            raise self.cut_off(
                f"the file is cut off: {what} needs {count} bytes, {max(self.left, 0)} are there", what=what
            )
