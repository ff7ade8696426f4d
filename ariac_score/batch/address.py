"""Content addresses: the hash of everything a measurement follows from."""

from __future__ import annotations

import hashlib
import json
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ariac_score.batch.tasks import Task
from ariac_score.engine import code_of
from ariac_score.logmap import load_log_map
from ariac_score.logs.bundle import name_from
from ariac_score.logs.ranged import ranged
from ariac_score.registry import Registry
from ariac_score.ruleset import RuleSet

__all__ = ["basis_of", "contents_of", "files_of", "measuring_address", "signature_of"]

_SCHEMA = "ariac-score/batch/1"
_BLOCK = 1 << 20


def basis_of(rule_set: RuleSet, registry: Registry) -> str:
    """Hash of what measures, whatever is measured: the checks, the log map, the edition, the code.

    Prices are not in it: when only they change, what was measured stays good.
    """
    log_map = load_log_map(rule_set.log_map, beside=Path(rule_set.file).parent)
    checks = [[check.name, check.use, dict(check.parameters)] for check in rule_set.checks.values()]
    return _hash([_SCHEMA, rule_set.edition, log_map.sha256, checks, code_of(rule_set, registry)])


def measuring_address(task: Task, contents: str, basis: str) -> str:
    """Address of what is measured of a run."""
    binding = ["binding"] if task.binding else []
    return _hash([contents, task.team, task.trial, basis, *binding])


def files_of(task: Task) -> Iterator[tuple[str, Path]]:
    """Every file of a run with the name it is known by, sorted; folders that are links are not entered."""
    path, _, run = task.path.partition("#run=")
    where = Path(path)
    root = Path(task.root) if task.root else where.parent
    below = sorted(where.rglob("*")) if where.is_dir() else [where]
    for file in below:
        if file.is_symlink() or not file.is_dir():
            yield f"{name_from(root, file)}{'#run=' + run if run else ''}", file
    for name in task.also:
        yield name_from(root, Path(name)), Path(name)


def signature_of(task: Task) -> str:
    """Hash of what the file system says about the files of a run; it changes whenever one of them does.

    Of a run that lies elsewhere it is what its storage said; empty where that is nothing.
    """
    if task.remote:
        return task.signature
    path = task.path.partition("#run=")[0]
    if not path.startswith("/"):
        path = f"{os.getcwd()}/{path}"  # noqa: PTH109  # as in `_statuses`
    told = [status for name in (path, *task.also) for status in sorted(_statuses(name))]
    return _hash([task.path, *told])


_Status = tuple[str, int, int, int, int]


def _statuses(path: str) -> list[_Status]:
    """Size, number and times of a file, or of all below a folder; folders that are links are not entered.

    Plain strings throughout: of a season that is done this is most of what a call does.
    """
    try:
        status = os.stat(path)  # noqa: PTH116
    except OSError as error:
        return [(path, -1, error.errno or 0, 0, 0)]
    return _below(path) if stat.S_ISDIR(status.st_mode) else [_status(path, status)]


def _below(folder: str) -> list[_Status]:
    try:
        with os.scandir(folder) as entries:
            found = list(entries)
    except OSError as error:
        return [(folder, -2, error.errno or 0, 0, 0)]
    told = []
    for entry in found:
        if entry.is_symlink() and os.path.isdir(entry.path):  # noqa: PTH112
            told.append((entry.path, -3, 0, 0, 0))
        elif entry.is_dir(follow_symlinks=False):
            told += _below(entry.path)
        else:
            try:
                told.append(_status(entry.path, entry.stat()))
            except OSError as error:
                told.append((entry.path, -1, error.errno or 0, 0, 0))
    return told


def _status(path: str, status: os.stat_result) -> _Status:
    return path, status.st_size, status.st_ino, status.st_mtime_ns, status.st_ctime_ns


def contents_of(task: Task) -> str:
    """Hash of the names and contents of the files of a run; one that cannot be read counts as such."""
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
