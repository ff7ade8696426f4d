"""The events of one connection as a file, within limits: a full one is set aside, and the oldest given up."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

__all__ = ["EventLog"]


class EventLog:
    """Writes events, one a line, each to the file before it returns.

    A full file `NAME.jsonl` becomes `NAME.part0001.jsonl`, and a new one is begun. What a file of this name
    holds already, such as from before a crash, is kept, but for a last line that is not whole.

    Args:
        file: `NAME.jsonl`.
        largest_bytes: Of one file.
        most_parts: That are kept besides it; the oldest is deleted for a new one.

    Attributes:
        parts: The files that are set aside, the oldest first.
        dropped: How many parts were deleted.

    Raises:
        OSError: The file cannot be written.
    """

    def __init__(self, file: Path, *, largest_bytes: int = 1_000_000_000, most_parts: int = 9) -> None:
        self.file, self._largest, self._most = file, largest_bytes, most_parts
        self.dropped = 0
        found = file.parent.glob(f"{file.stem}.part[0-9]*.jsonl") if file.exists() else ()
        self.parts: list[Path] = sorted(found, key=_number)
        self._size = _whole_lines(file)
        self._out = file.open("ab", buffering=0)

    def lines(self) -> Iterator[bytes]:
        """What was written, line by line, as far as it is kept."""
        for file in (*self.parts, self.file):
            with file.open("rb") as stream:
                yield from stream

    def write(self, line: bytes) -> None:
        """Add a line, which holds no line end.

        Raises:
            OSError: It cannot be written.
            ValueError: The log is closed.
        """
        if self._size and self._size + len(line) + 1 > self._largest:
            self._set_aside()
        self._out.write(line + b"\n")
        self._size += len(line) + 1

    def close(self) -> None:
        """Write nothing more."""
        self._out.close()

    def _set_aside(self) -> None:
        number = _number(self.parts[-1]) + 1 if self.parts else 1
        self._out.close()
        self.parts.append(self.file.rename(self.file.with_name(f"{self.file.stem}.part{number:04}.jsonl")))
        while len(self.parts) > self._most:
            self.parts.pop(0).unlink()
            self.dropped += 1
        self._out = self.file.open("ab", buffering=0)
        self._size = 0


def _number(part: Path) -> int:
    return int(part.name.removesuffix(".jsonl").rpartition("part")[2])


def _whole_lines(file: Path) -> int:
    """The size of a file, cut after its last whole line: a process that was killed may leave half of one."""
    if not file.exists():
        return 0
    with file.open("r+b") as stream:
        size = end = stream.seek(0, 2)
        while end:
            start = max(0, end - (1 << 16))
            stream.seek(start)
            found = stream.read(end - start).rfind(b"\n")
            if found >= 0:
                end = start + found + 1
                break
            end = start
        if end < size:
            stream.truncate(end)
    return end
