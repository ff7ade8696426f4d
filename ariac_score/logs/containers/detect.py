"""Which scan a recording needs."""

from __future__ import annotations

from collections.abc import Container
from contextlib import suppress
from pathlib import Path

import numpy as np

from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.logs.containers.folder import FolderScan, packed_storage, split_files
from ariac_score.logs.containers.items import METADATA, METADATA_KEY, Scan
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.ros1 import Ros1Scan
from ariac_score.logs.containers.sqlite import SqliteScan

__all__ = ["SUFFIXES", "cannot_be_read", "looks_like_recording", "open_scan"]


SUFFIXES = (".bag", ".db3", ".mcap")
"""The suffixes of recordings that are files."""


_LARGE_BLOCK_BYTES = 31 << 20  # from 32 MiB on glibc no longer adapts its threshold


_MCAP, _ROS1, _SQLITE = b"\x89MCAP0\r\n", b"#ROSBAG ", b"SQLite format 3\0"


def looks_like_recording(path: Path) -> bool:
    """Whether this looks like a ROS recording, whole or not.

    Raises:
        OSError: It cannot be read.
    """
    if path.is_dir():
        metadata = path / METADATA
        if not metadata.is_file():
            return bool(split_files(path))  # its recorder was killed
        with metadata.open("rb") as file:
            # Or: a folder with torn metadata is a recording all the same, whose damage is then reported.
            return METADATA_KEY.encode() in file.read(1 << 16) or any(
                child.suffix in SUFFIXES for child in path.iterdir()
            )
    if not path.is_file():
        return False
    if packed_storage(path):
        return True
    with path.open("rb") as file:
        start = file.read(16)
    if not start:
        return path.suffix in SUFFIXES
    if start.startswith(_SQLITE):
        return path.suffix == ".db3"
    return start.startswith((_MCAP, _ROS1))


def open_scan(
    path: Path, *, jobs: int = 0, topics: Container[str] | None = None, partial: bool = False
) -> Scan:
    """The scan for the recording at a path, chosen by its first bytes, else by its suffix.

    Args:
        path: A recording.
        jobs: Threads, of which all but one inflate its chunks; 0: as many as there are processors.
        topics: Messages of other topics may come without their bytes; `None`: all come with them.
        partial: Whether what a recorder left that was killed is wanted, as far as it can be recovered.

    Raises:
        NothingToScoreError: It is empty, or no recording.
        LogError: It cannot be read, or its metadata cannot be understood.
    """
    _let_freed_memory_stay()
    try:
        if path.is_dir():
            return FolderScan(path, jobs=jobs, topics=topics, partial=partial)
        with path.open("rb") as file:
            start = file.read(16)
    except OSError as error:
        raise cannot_be_read(error, path) from error
    if not start:
        raise NothingToScoreError(
            "the file is empty", file=path, hint="the recorder wrote nothing; record again"
        )
    if packed_storage(path):
        return FolderScan(path, jobs=jobs, topics=topics, partial=partial)
    if start.startswith(_MCAP) or (path.suffix == ".mcap"):
        return McapScan(path, jobs=jobs, topics=topics)
    if start.startswith(_SQLITE) or (path.suffix == ".db3"):
        return SqliteScan(path, topics=topics, partial=partial)
    if start.startswith(_ROS1) or (path.suffix == ".bag"):
        return Ros1Scan(path, jobs=jobs, topics=topics)
    raise NothingToScoreError(
        "it is not a ROS recording",
        file=path,
        hint="recordings are .bag, .db3 or .mcap files (the last two also as .zstd), or rosbag2 folders",
    )


def _let_freed_memory_stay() -> None:
    """Make glibc reuse memory that is freed while reading, instead of returning it to the system.

    Getting it back takes longer than all that is done with it. glibc returns blocks above a threshold
    that grows with the largest block freed so far, so one large block is allocated and freed, untouched.

    Source: mallopt(3), M_MMAP_THRESHOLD and its dynamic adjustment.
    """
    with suppress(MemoryError):
        np.empty(_LARGE_BLOCK_BYTES, dtype=np.uint8)


def cannot_be_read(error: OSError | MemoryError, path: Path) -> LogError:
    """The error for a file that the operating system refuses to read."""
    cause = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return LogError(f"it cannot be read: {cause}", file=path, hint="check that it is there and may be read")
