"""Content addresses: the hash of everything a measurement follows from."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ariac_score.batch.tasks import RunTask
from ariac_score.engine.prepared import Prepared
from ariac_score.engine.provenance import code_of
from ariac_score.errors import ScoreError
from ariac_score.logs.bundle import name_from
from ariac_score.logs.containers.ranged import ranged

__all__ = [
    "RunTooLargeError",
    "basis_of",
    "contents_of",
    "files_of",
    "measuring_address",
    "refuse_excess",
    "signature_of",
    "too_large",
]

_SCHEMA = "ariac-score/batch/1"
_BLOCK = 1 << 20
MOST_ENTRIES = 100_000
"""The most files and folders that one run may have."""


def basis_of(prepared: Prepared, *, partial: bool = False) -> str:
    """Hash of everything but the run that a measurement depends on: checks, log map, competition, code.

    Prices are not in it: when only they change, measurements stay valid.

    Args:
        prepared: The rule set.
        partial: Whether logs that are cut off are measured as far as they go.
    """
    rule_set = prepared.rule_set
    named = [rule_set.competition] if rule_set.competition else []
    competition, checks = (
        [[check.name, check.use, dict(check.parameters)] for check in checks]
        for checks in (named, rule_set.checks.values())
    )
    # Left out where it does not hold, so that older addresses stay what they were.
    asked = ["partial"] if partial else []
    return _hash([_SCHEMA, competition, prepared.log_map.sha256, checks, code_of(prepared), *asked])


def measuring_address(task: RunTask, contents: str, basis: str) -> str:
    """Address of the measurement of a run."""
    # Left out where it does not hold, so that older addresses stay what they were.
    by = [f"work by {task.work_by}"] if task.work_by else []
    return _hash([contents, task.team, task.trial, basis, *by])


class RunTooLargeError(ScoreError):
    """The files of a run are too many, or too large to be read in the time of one run."""


def files_of(task: RunTask) -> Iterator[tuple[str, Path]]:
    """Every file of a run with its name in results, sorted; folders that are links are not entered.

    Raises:
        RunTooLargeError: There are more than `MOST_ENTRIES`.
    """
    path, _, run = task.path.partition("#run=")
    where = Path(path)
    root = Path(task.root) if task.root else where.parent
    below = sorted(Path(name) for name, entry, _ in _walk(path) if entry) if where.is_dir() else [where]
    for file in below:
        yield f"{name_from(root, file)}{'#run=' + run if run else ''}", file
    for name in task.also:
        yield name_from(root, Path(name)), Path(name)


def refuse_excess(task: RunTask, most_bytes: int) -> None:
    """Refuse a run whose files cannot be read in its time, by the sizes that the file system states.

    A sparse file of any size takes no room on a disk, and a day to read.

    Raises:
        RunTooLargeError: They are too large together, or too many.
    """
    sizes = [(size, name) for name, file in files_of(task) if (size := _size(file))]
    total = sum(size for size, _ in sizes)
    if total > most_bytes:
        largest, name = max(sizes)
        raise too_large(name, largest, total, most_bytes)


def too_large(name: str, size: int, total: int, most_bytes: int) -> RunTooLargeError:
    """The error that names the largest file of a run whose files are too large together."""
    others = f", with the other files of the run {total}" if total > size else ""
    return RunTooLargeError(
        f"{name} has {size} bytes{others}; all files of a run may have {most_bytes}",
        hint="remove what is no part of the trial, or raise --input-gb",
    )


def _size(file: Path) -> int:
    """The bytes that have to be read of a file; 0 of a pipe, a device, or what is fetched in parts."""
    try:
        status = file.stat()
    except OSError:
        return 0
    return status.st_size if stat.S_ISREG(status.st_mode) and ranged(file) is None else 0


def signature_of(task: RunTask) -> str:
    """Hash of the sizes, times and inodes of the files of a run; it changes whenever one of them does.

    Of a remote run it is the hash of what its storage stated. Empty where that is nothing, and for a run
    with more than `MOST_ENTRIES` files.
    """
    if task.remote:
        return task.signature
    path = task.path.partition("#run=")[0]
    if not path.startswith("/"):
        path = f"{os.getcwd()}/{path}"  # noqa: PTH109  # a season has thousands
    try:
        statuses = [status for name in (path, *task.also) for status in sorted(_statuses(name))]
    except RunTooLargeError:
        return ""
    return _hash([task.path, *statuses])


_Status = tuple[str, int, int, int, int]


def _statuses(path: str) -> list[_Status]:
    """Size, inode and times of a file, or of all below a folder; folders that are links are not entered.

    Plain strings and `os` instead of `Path`: for a season that is finished, this is most of the work.
    """
    try:
        status = os.stat(path)  # noqa: PTH116
    except OSError as error:
        return [(path, -1, error.errno or 0, 0, 0)]
    return _below(path) if stat.S_ISDIR(status.st_mode) else [_status(path, status)]


def _below(folder: str) -> list[_Status]:
    statuses = []
    for path, entry, number in _walk(folder):
        if entry is None:
            statuses.append((path, -2, number, 0, 0))
        elif entry.is_symlink() and os.path.isdir(path):  # noqa: PTH112
            statuses.append((path, -3, 0, 0, 0))
        else:
            try:
                statuses.append(_status(path, entry.stat()))
            except OSError as error:
                statuses.append((path, -1, error.errno or 0, 0, 0))
    return statuses


def _walk(folder: str) -> Iterator[tuple[str, os.DirEntry[str] | None, int]]:
    """Every file below a folder, in any order; a folder that cannot be listed, with its error number.

    Not recursive, as `Path.rglob` is: a stranger's folders may be nested deeper than Python's stack.

    Raises:
        RunTooLargeError: There are more than `MOST_ENTRIES` files and folders.
    """
    waiting, seen = [folder], 0
    while waiting:
        here = waiting.pop()
        try:
            with os.scandir(here) as entries:
                for entry in entries:
                    seen += 1
                    if seen > MOST_ENTRIES:
                        raise RunTooLargeError(
                            f"more than {MOST_ENTRIES} files and folders lie in {Path(folder).name}",
                            hint="name the folder of one run, or remove what is no part of the trial",
                        )
                    if entry.is_dir(follow_symlinks=False):
                        waiting.append(entry.path)
                    else:
                        yield entry.path, entry, 0
        except OSError as error:
            yield here, None, error.errno or 0


def _status(path: str, status: os.stat_result) -> _Status:
    # The inode and the time of change too: a copy may keep the time of modification, but not these.
    return path, status.st_size, status.st_ino, status.st_mtime_ns, status.st_ctime_ns


def contents_of(task: RunTask) -> str:
    """Hash of the names and contents of the files of a run; one that cannot be read counts as such.

    It takes as long as the files take to read: only a process with a time limit may call it.
    """
    return _hash([[name, *_content(file)] for name, file in files_of(task)])


def _content(file: Path) -> tuple[int, str]:
    digest, size = hashlib.sha256(), 0
    parts = ranged(file)
    if parts is not None:
        return parts.size, f"parts of {parts.identity}"
    try:
        if not file.is_file():
            return -1, "no file"
        with file.open("rb") as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
                size += len(block)
    except OSError as error:
        return -1, f"unreadable: {error.strerror}"
    return size, digest.hexdigest()


def _hash(value: Any) -> str:
    text = json.dumps(value, sort_keys=True, ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()
