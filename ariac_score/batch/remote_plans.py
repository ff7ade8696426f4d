"""Planning a batch of remote runs: a folder named by a URI, or a list of URIs.

A remote folder is planned like a local one: its names are laid out as empty files in a folder of this
machine, with `competition.yaml` and what that names, and the rules for local folders find the runs.
"""

from __future__ import annotations

import errno
import re
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

from ariac_score.batch.fetched import mode_of
from ariac_score.batch.remote import (
    LISTING_S,
    Storage,
    Stored,
    check_inside,
    is_uri,
    name_of,
    shown,
    signature_of_stored,
)
from ariac_score.batch.tasks import BatchPlan, RunTask, of_shard, plan_batch
from ariac_score.documents.plain_file import read_plain
from ariac_score.documents.yaml import load_yaml
from ariac_score.errors import DataFileError, NothingToScoreError, ScoreError, UsageError
from ariac_score.ranking.competition import FILE

__all__ = ["LIST_ENDING", "plan_elsewhere", "plan_list"]

LIST_ENDING = ".txt"
"""Suffix of a file that lists runs."""
_LARGEST_TEXT_BYTES = 4 << 20
_LARGEST_DATABASE_BYTES = 1 << 30
_MOST_LINES = 100_000
_AT_A_TIME = 16
"""Requests to storages at a time."""


def plan_elsewhere(
    uri: str, rules: str, work: Path, *, ranges: bool = False, part: tuple[int, int] = (1, 1)
) -> BatchPlan:
    """Find the runs below a URI, as `plan_batch` does in a local folder.

    Args:
        uri: Of a folder, a `competition.yaml`, or a list of runs.
        rules: Rule set to use instead of the one a competition names.
        work: An empty folder; the plan may name rules in it, so it has to stay until they are loaded.
        ranges: Whether only parts of recordings are to be fetched.
        part: Number and count of the shards; for a list, only the runs of this shard are looked up.

    Raises:
        ScoreError: As `plan_batch`; or the storage does not answer, or wants other credentials.
    """
    if name_of(uri).endswith(LIST_ENDING):
        file = work / name_of(uri)
        _fetch_small(Storage(uri), Storage(uri).file(), file, _LARGEST_TEXT_BYTES)
        return plan_list(file, rules, ranges=ranges, part=part, base=_folder_of(uri))
    if name_of(uri) == FILE:
        uri = uri[: uri.rindex(FILE)]
    storage = Storage(uri)
    files = _listed(storage)
    here = work / (name_of(uri) or "runs")
    _lay_out(storage, files, here)
    plan = plan_batch(here, rules)
    return replace(plan, tasks=_remote_tasks(plan.tasks, files, storage, here, ranges=ranges))


def _folder_of(uri: str) -> str:
    """The folder of a file, without a query: that is a signature for the address of the file alone."""
    web = uri.startswith(("http://", "https://"))
    return (re.split(r"[?#]", uri, maxsplit=1)[0] if web else uri).rpartition("/")[0]


def _listed(storage: Storage) -> list[Stored]:
    files = [file for file in storage.files() if not _hidden(file.name)]
    if not files:
        raise NothingToScoreError(
            "there is no file below it", file=shown(storage.uri), hint="every entry of a folder is one trial"
        )
    return files


def _hidden(name: str) -> bool:
    """Whether it is hidden at the top of the folder, where runs are found."""
    return name.startswith(".")


# A storage of objects may have the names `a` and `a/b` at once, which a file system cannot.
_NAME_ERRORS = (errno.EEXIST, errno.ENOTDIR, errno.EISDIR, errno.ENAMETOOLONG, errno.EILSEQ)


def _lay_out(storage: Storage, files: Sequence[Stored], here: Path) -> None:
    """Make a folder with the names of the remote one."""
    here.mkdir()
    for file in files:
        place = here / file.name
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            place.touch()
        except OSError as cause:
            if cause.errno not in _NAME_ERRORS:
                raise
            raise UsageError(
                f"{file.name[:80]!r} cannot be a file here: {cause.strerror}",
                file=shown(storage.uri),
                hint="a name may not be that of a file and of a folder at once; rename one of them",
            ) from cause
    known = {file.name: file for file in files}
    if FILE in known:
        _fetch_small(storage, known[FILE], here / FILE, _LARGEST_TEXT_BYTES)
        for name, largest in _needed(here / FILE, known).items():
            _fetch_small(storage, known[name], here / name, largest)


def _needed(file: Path, known: Mapping[str, Stored]) -> dict[str, int]:
    """Files without which a competition cannot be planned, with the largest size of each.

    Those are its databases and its own rules, with the YAML files in the same folder, which these may extend.
    """
    try:
        competition = load_yaml(file).data
    except ScoreError:
        return {}  # `plan_batch` loads it again, and reports what is wrong
    if not isinstance(competition, dict):
        return {}
    needed: dict[str, int] = {}
    rules, runs = competition.get("rules"), competition.get("runs")
    if isinstance(rules, str) and rules in known:
        folder = PurePosixPath(rules).parent
        for name in known:
            if PurePosixPath(name).parent == folder and name.endswith((".yaml", ".yml")) and name != FILE:
                needed[name] = _LARGEST_TEXT_BYTES
    databases: Any = runs.get("databases") if isinstance(runs, dict) else None
    for name in databases if isinstance(databases, list) else ():
        if isinstance(name, str) and name in known:
            needed[name] = _LARGEST_DATABASE_BYTES
    return needed


def _fetch_small(storage: Storage, file: Stored, into: Path, largest_bytes: int) -> None:
    if file.size > largest_bytes:
        raise DataFileError(
            f"it has {file.size} bytes, more than the {largest_bytes} allowed",
            file=shown(file.path),
            hint="is it what its name says?",
        )
    storage.fetch(file, into, most_bytes=largest_bytes, within_s=LISTING_S)


def _remote_tasks(
    tasks: Sequence[RunTask], files: Sequence[Stored], storage: Storage, here: Path, *, ranges: bool
) -> tuple[RunTask, ...]:
    """The tasks of a folder that was laid out, with the URIs of the remote files."""
    below: dict[str, list[Stored]] = defaultdict(list)
    for file in files:
        for name in (file.name, *(above.as_posix() for above in PurePosixPath(file.name).parents)):
            below[name].append(file)

    def uri(path: str) -> tuple[str, list[Stored]]:
        plain, hash_sign, run = path.partition("#run=")
        name = Path(plain).relative_to(here).as_posix()
        folder = Path(plain).is_dir()
        return storage.child(name, folder=folder) + hash_sign + run, below[name]

    found = []
    for task in tasks:
        if task.refused:
            found.append(task)
            continue
        path, stored = uri(task.path)
        also = [uri(name) for name in task.also]
        all_stored = [*stored, *(file for _, configs in also for file in configs)]
        found.append(
            replace(
                task,
                path=path,
                root=storage.uri.rstrip("/") if task.root else "",
                also=tuple(name for name, _ in also),
                signature=signature_of_stored(all_stored, mode_of(ranges)),
            )
        )
    return tuple(found)


def plan_list(
    file: Path, rules: str, *, ranges: bool = False, part: tuple[int, int] = (1, 1), base: str = ""
) -> BatchPlan:
    """The runs that a text file lists, one on each line: a URI, or a path relative to the list.

    A name may stand before a URI; otherwise the run has the name of its file. Empty lines and lines that
    start with `#` are skipped.

    Args:
        file: The list.
        rules: Rule set.
        ranges: Whether only parts of recordings are to be fetched.
        part: Number and count of the shards; only the runs of this shard are looked up.
        base: The URI of the folder of the list, where it was fetched from one.

    Raises:
        DataFileError: Two runs have one name, or a line is no address.
        NothingToScoreError: It lists nothing.
        UsageError: No rule set is given.
    """
    if not rules:
        raise UsageError(
            "no rule set is given",
            file=file,
            hint="name a rule set with --rules; 'ariac-score rules list' shows those that are installed",
        )
    lines = _lines(file)
    tasks: dict[str, RunTask] = {}
    places: dict[str, int] = {}
    for number, line in lines:
        name, path = _entry(file, number, line, base)
        if name in tasks:
            raise DataFileError(
                f"two runs are named {name!r}: here and in line {places[name]}",
                file=file,
                place=f"line {number}",
                hint="write a name before the address: NAME URI",
            )
        tasks[name], places[name] = RunTask("", name, 1, path), number
    if not tasks:
        raise NothingToScoreError("it lists no run", file=file, hint="write one URI or path on each line")
    ordered = sorted(tasks.values(), key=lambda task: task.key)
    mine, until = list(of_shard(ordered, *part)), time.monotonic() + LISTING_S
    with ThreadPoolExecutor(_AT_A_TIME) as pool:
        found = pool.map(lambda task: _signed(task, until, ranges=ranges), mine)
        signed = dict(zip(mine, found, strict=True))
    return BatchPlan(file.stem, rules, tuple(signed.get(task, task) for task in ordered))


def _lines(file: Path) -> list[tuple[int, str]]:
    try:
        if file.stat().st_size > _LARGEST_TEXT_BYTES:
            raise DataFileError(
                f"it is longer than the {_LARGEST_TEXT_BYTES} bytes that a list may have",
                file=file,
                hint="split it into several lists",
            )
        text = read_plain(file, _LARGEST_TEXT_BYTES).decode("utf-8")
    except (OSError, UnicodeDecodeError) as cause:
        raise DataFileError(f"cannot be read: {cause}", file=file, hint="a list is a text file") from cause
    lines = [(i, line.strip()) for i, line in enumerate(text.splitlines(), start=1)]
    found = [(i, line) for i, line in lines if line and not line.startswith("#")]
    if len(found) > _MOST_LINES:
        raise DataFileError(
            f"it lists {len(found)} runs, more than the {_MOST_LINES} that a list may have",
            file=file,
            hint="split it into several lists",
        )
    return found


def _entry(file: Path, number: int, line: str, base: str) -> tuple[str, str]:
    """Name and address of a line."""
    words = line.split()
    if not is_uri(line) and len(words) == 2 and is_uri(words[1]):
        return words[0], words[1]
    if is_uri(line):
        if len(words) != 1 or not name_of(line):
            raise DataFileError(
                f"{shown(line)[:80]!r} is no address of a run",
                file=file,
                place=f"line {number}",
                hint="write %20 for a space, and a name before the address",
            )
        return name_of(line), line
    if base:
        check_inside(line.rstrip("/"), f"{base}/{file.name}")
        uri = Storage(base).child(line.rstrip("/"), folder=line.endswith("/"))
        return name_of(uri), uri
    path = file.parent / line
    return path.name, str(path)


def _signed(task: RunTask, until: float, *, ranges: bool) -> RunTask:
    """The task with the signature of its files; what a storage refuses is reported when the run is scored."""
    if not task.remote or time.monotonic() > until:
        return task
    try:
        storage = Storage(task.path.partition("#run=")[0])
        files = storage.files() if storage.is_folder() else [storage.file()]
    except ScoreError:
        return task
    return replace(task, signature=signature_of_stored(files, mode_of(ranges)))
