"""Remote files of which only some bytes are here; the others are fetched when they are read.

The file has its full length on this machine, with holes, which `open_log` fills when they are read.
So bytes that a scan skips are never fetched.
"""

from __future__ import annotations

import hashlib
import io
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import BinaryIO

__all__ = ["RangedFile", "open_log", "ranged", "reading"]

Range = tuple[int, int]
"""From a byte to before another."""

Fetch = Callable[[Sequence[Range]], Sequence[bytes]]
"""Returns the bytes of some ranges, all of them, or raises `OSError`."""

_GAP_BYTES = 1 << 15
"""Ranges with no more than this between them are fetched as one: a request takes as long as some 100 kB."""
_TOGETHER_BYTES = 1 << 25
"""Fetched at a time, for it is held in memory until it is written."""
_ALONE_BYTES = 1 << 16
"""An unforeseen read is rounded out to blocks of this size."""
_WORTH_IT = 0.75
"""From this share of a file on it is faster to fetch all of it in one go."""


class RangedFile:
    """A file with holes.

    Args:
        path: Its place on this machine; created in its full length when it is not there.
        size: Its length, bytes.
        fetch: Returns missing bytes.
        identity: Stands for its content, which cannot be hashed while part of it is missing.

    Attributes:
        failure: Why bytes could not be fetched when they were read; `None` while all could.
    """

    def __init__(self, path: Path, size: int, fetch: Fetch, identity: str = "") -> None:
        self.path, self.size, self.identity = path, size, identity
        self.failure: Exception | None = None
        self._fetch = fetch
        self._there: list[Range] = []
        with path.open("ab") as file:
            file.truncate(size)

    @property
    def read_bytes(self) -> int:
        """How many of its bytes are here."""
        total = 0
        for start, end in self._there:
            total += end - start
        return total

    @property
    def whole(self) -> bool:
        """Whether nothing is missing."""
        return self.read_bytes == self.size

    def missing(self, ranges: Iterable[Range]) -> list[Range]:
        """The missing parts of some ranges, sorted; parts that are close together are joined."""
        found: list[Range] = []
        for first, last in sorted(ranges):
            start, end = max(0, first), min(last, self.size)
            for hole in self._holes(start, end):
                if found and hole[0] - found[-1][1] <= _GAP_BYTES:
                    found[-1] = found[-1][0], max(found[-1][1], hole[1])
                else:
                    found.append(hole)
        return found

    def _holes(self, start: int, end: int) -> Iterator[Range]:
        place = bisect_left(self._there, start, key=lambda there: there[1])
        for first, last in self._there[place:]:
            if first >= end:
                break
            if first > start:
                yield start, first
            start = max(start, last)
        if start < end:
            yield start, end

    def have(self, ranges: Iterable[Range]) -> None:
        """Fetch some ranges unless they are here.

        Raises:
            OSError: They cannot be fetched, or written.
        """
        try:
            for several in _in_turn(self.missing(ranges)):
                self._fill(several)
        except Exception as failure:
            self.failure = failure  # a reader may turn it into an error of its own
            raise

    def pays(self, ranges: Iterable[Range]) -> bool:
        """Whether with some more ranges it would still be much less than the whole file."""
        missing = 0
        for start, end in self.missing(ranges):
            missing += end - start
        return self.read_bytes + missing < _WORTH_IT * self.size

    def _fill(self, ranges: Sequence[Range]) -> None:
        with self.path.open("r+b", buffering=0) as file:
            for (start, end), part in zip(ranges, self._fetch(ranges), strict=True):
                if len(part) != end - start:
                    raise OSError(f"{len(part)} bytes came instead of {end - start}")
                file.seek(start)
                file.write(part)
                self._add(start, end)

    def _add(self, start: int, end: int) -> None:
        """Record bytes that are here; ranges that touch become one."""
        first = bisect_left(self._there, start, key=lambda there: there[1])
        last = first
        while last < len(self._there) and self._there[last][0] <= end:
            last += 1
        touched = self._there[first:last]
        if touched:
            start, end = min(start, touched[0][0]), max(end, touched[-1][1])
        self._there[first:last] = [(start, end)]

    def sha256(self) -> str:
        """Hash of the whole content or, of a file with holes, of each stretch after its place and length."""
        digest = hashlib.sha256()
        with self.path.open("rb") as file:
            for start, end in self._there:
                if not self.whole:
                    digest.update(start.to_bytes(8, "little") + (end - start).to_bytes(8, "little"))
                file.seek(start)
                for at in range(start, end, 1 << 20):
                    digest.update(file.read(min(1 << 20, end - at)))
        return digest.hexdigest()


def _in_turn(ranges: Sequence[Range]) -> Iterator[list[Range]]:
    """The ranges in groups whose bytes fit into memory."""
    several: list[Range] = []
    count = 0
    parts = (
        (at, min(end, at + _TOGETHER_BYTES))
        for start, end in ranges
        for at in range(start, end, _TOGETHER_BYTES)
    )
    for start, end in parts:
        if several and count + end - start > _TOGETHER_BYTES:
            yield several
            several, count = [], 0
        several.append((start, end))
        count += end - start
    if several:
        yield several


_READING: ContextVar[dict[Path, RangedFile] | None] = ContextVar("_READING", default=None)


@contextmanager
def reading(files: Iterable[RangedFile]) -> Iterator[None]:
    """Within this context `open_log` fills the holes of these files."""
    # A context variable and no argument: readers of plugins open files by their paths.
    token = _READING.set({file.path.resolve(): file for file in files})
    try:
        yield
    finally:
        _READING.reset(token)


def ranged(path: Path) -> RangedFile | None:
    """The file with holes at a path; `None` where everything is here."""
    files = _READING.get()
    return files.get(path.resolve()) if files else None


def open_log(path: Path, buffering: int) -> BinaryIO:
    """A file to be read, whose holes are filled when they are read.

    Raises:
        OSError: It cannot be opened.
    """
    file = ranged(path)
    return path.open("rb", buffering=buffering) if file is None else _Filled(file)  # type: ignore[return-value]


class _Filled(io.RawIOBase):
    """A file with holes, as a file object whose reads fill them."""

    def __init__(self, file: RangedFile) -> None:
        self._ranged, self._file, self._at = file, file.path.open("rb", buffering=0), 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def fileno(self) -> int:
        return self._file.fileno()  # readers by descriptor call `RangedFile.have` before

    def tell(self) -> int:
        return self._at

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        base = {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._ranged.size}[whence]
        self._at = max(0, base + offset)
        return self._at

    def readinto(self, room: memoryview, /) -> int:  # type: ignore[override]  # scanners give memory views
        end = min(self._at + len(room), self._ranged.size)
        if end <= self._at:
            return 0
        if self._ranged.missing([(self._at, end)]):
            # Unforeseen: fetch some more, for the following bytes will be read next.
            first = self._at - self._at % _ALONE_BYTES
            self._ranged.have([(first, end + -end % _ALONE_BYTES)])
        self._file.seek(self._at)
        count = self._file.readinto(room)
        self._at += count
        return count

    def close(self) -> None:
        self._file.close()
        super().close()
