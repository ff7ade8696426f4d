"""Fetching the files of a remote run to the machine that scores it."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote

from ariac_score.batch.address import contents_of, too_large
from ariac_score.batch.remote import Storage, Stored, name_of, shown, signature_of_stored
from ariac_score.batch.tasks import RunTask
from ariac_score.errors import ScoreError
from ariac_score.logs.containers.chunk_ranges import INDEXED, foresee
from ariac_score.logs.containers.inflating import LARGEST_FILE_BYTES
from ariac_score.logs.containers.ranged import RangedFile, reading

__all__ = ["Fetched", "fetch_run", "is_unchanged", "mode_of", "name_below"]

_WORTH_PARTS_BYTES = 1 << 20
"""Smaller recordings are always fetched whole."""


@dataclass(frozen=True)
class Fetched:
    """A remote run whose files are on this machine.

    Attributes:
        task: The same run with paths of this machine; results of it are those of a local run.
        signature: Hash of what the storage stated about the files before they were fetched; may be empty.
        contents: Hash of their names and contents.
        parts: The files of which only parts were fetched.
    """

    task: RunTask
    signature: str
    contents: str
    parts: tuple[RangedFile, ...]


def mode_of(ranges: bool) -> str:
    """How files are read, as a part of their signature: what was read in parts has another hash."""
    return "parts" if ranges else "whole"


def fetch_run(
    task: RunTask, folder: Path, topics: Container[str] | None = None, *, most_bytes: int = LARGEST_FILE_BYTES
) -> Fetched:
    """Fetch the files of a run into a folder, under the names that they have in their storage.

    Args:
        task: Named by a URI.
        folder: Where they are put.
        topics: Whose messages are wanted; then only parts of an indexed recording are fetched, where
            its storage serves parts. `None`: everything is fetched.
        most_bytes: Of all files that are fetched whole, together.

    Raises:
        RunTooLargeError: They have more bytes.
        ScoreError: They cannot be fetched; the message says why.
        OSError: They cannot be written here.
    """
    path, hash_sign, run = task.path.partition("#run=")
    root = folder / "log"
    parts: list[RangedFile] = []
    stored: list[Stored] = []
    places = []
    whole_bytes = 0
    for uri in (path, *task.also):
        storage = Storage(uri)
        place = root / name_below(task.root, uri)
        places.append(place)
        if storage.is_folder():
            place.mkdir(parents=True, exist_ok=True)
            files = [(file, place / file.name) for file in storage.files()]
        else:
            files = [(storage.file(), place)]
        for file, into in files:
            stored.append(file)
            if not _in_parts(storage, file, into, topics, parts):
                left = most_bytes - whole_bytes
                if file.size > left:
                    raise too_large(file.name, file.size, whole_bytes + file.size, most_bytes)
                whole_bytes += storage.fetch(file, into, most_bytes=left)
    here = replace(
        task,
        path=f"{places[0]}{hash_sign}{run}",
        root=str(root) if task.root else "",
        also=tuple(str(place) for place in places[1:]),
        signature="",
    )
    with reading(parts):
        contents = contents_of(here)
    signature = signature_of_stored(stored, mode_of(topics is not None))
    return Fetched(here, signature, contents, tuple(parts))


def is_unchanged(task: RunTask, fetched: Fetched, *, ranges: bool) -> bool:
    """Whether the storage still states the same about the files as before they were fetched.

    Raises:
        ScoreError: It does not answer.
    """
    stored: list[Stored] = []
    for uri in (task.path.partition("#run=")[0], *task.also):
        storage = Storage(uri)
        stored += storage.files() if storage.is_folder() else [storage.file()]
    return signature_of_stored(stored, mode_of(ranges)) == fetched.signature


def _in_parts(
    storage: Storage, file: Stored, into: Path, topics: Container[str] | None, parts: list[RangedFile]
) -> bool:
    """Fetch one file in parts, if that is wanted, possible and worth it; whether it was."""
    if topics is not None and into.suffix in INDEXED and file.size >= _WORTH_PARTS_BYTES:
        try:
            found = storage.ranges(file, into)
            if found is not None and foresee(found, topics):
                parts.append(found)
                return True
        except ScoreError:
            pass  # fetching it whole succeeds, or reports what is wrong
    return False


def name_below(root: str, uri: str) -> str:
    """The name of a file relative to a root, or its last part where there is none."""
    base = root.rstrip("/") + "/"
    if not root or not uri.startswith(base):
        return name_of(uri)
    name = shown(uri.removeprefix(base)).rstrip("/")
    return unquote(name) if root.startswith("http") else name
