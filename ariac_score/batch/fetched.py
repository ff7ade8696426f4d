"""The files of a run that lies elsewhere, brought to the machine that scores it."""

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

__all__ = ["Near", "bring", "mode_of", "name_below", "still_the_same"]

_WORTH_PARTS_BYTES = 1 << 20


@dataclass(frozen=True)
class Near:
    """A run whose files are here.

    Attributes:
        task: The same run with paths of this machine; results of it are those of a local run.
        signature: What the storage said of the files before they were fetched; it may be empty.
        contents: Hash of their names and contents.
        parts: Those of which not everything is here.
    """

    task: RunTask
    signature: str
    contents: str
    parts: tuple[RangedFile, ...]


def mode_of(ranges: bool) -> str:
    """How files are read, in a word: what was read in parts is not known as a whole."""
    return "parts" if ranges else "whole"


def bring(
    task: RunTask, folder: Path, topics: Container[str] | None = None, *, most_bytes: int = LARGEST_FILE_BYTES
) -> Near:
    """Fetch the files of a run into a folder, laid out as they lie elsewhere.

    Args:
        task: Named by a URI.
        folder: Where they are put.
        topics: Whose messages are wanted; then only parts of an indexed recording are fetched, where
            its storage gives parts. `None`: everything is.
        most_bytes: Of all files that are fetched whole, together.

    Raises:
        RunTooLargeError: They have more bytes.
        ScoreError: They cannot be had; the message says why.
        OSError: They cannot be kept here.
    """
    path, hash_sign, run = task.path.partition("#run=")
    root = folder / "log"
    parts: list[RangedFile] = []
    stored: list[Stored] = []
    near = []
    whole_bytes = 0
    for uri in (path, *task.also):
        storage = Storage(uri)
        place = root / name_below(task.root, uri)
        near.append(place)
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
        path=f"{near[0]}{hash_sign}{run}",
        root=str(root) if task.root else "",
        also=tuple(str(place) for place in near[1:]),
        signature="",
    )
    with reading(parts):
        contents = contents_of(here)
    signature = signature_of_stored(stored, mode_of(topics is not None))
    return Near(here, signature, contents, tuple(parts))


def still_the_same(task: RunTask, near: Near, *, ranges: bool) -> bool:
    """Whether the storage still says of the files what it said before they were fetched.

    Raises:
        ScoreError: It does not say anything.
    """
    stored: list[Stored] = []
    for uri in (task.path.partition("#run=")[0], *task.also):
        storage = Storage(uri)
        stored += storage.files() if storage.is_folder() else [storage.file()]
    return signature_of_stored(stored, mode_of(ranges)) == near.signature


def _in_parts(
    storage: Storage, file: Stored, into: Path, topics: Container[str] | None, parts: list[RangedFile]
) -> bool:
    """Fetch one file in parts, where that is wanted, can be done, and pays; whether it was."""
    if topics is not None and into.suffix in INDEXED and file.size >= _WORTH_PARTS_BYTES:
        try:
            found = storage.ranges(file, into)
            if found is not None and foresee(found, topics):
                parts.append(found)
                return True
        except ScoreError:
            pass  # it may be had whole, or that will say what is wrong
    return False


def name_below(root: str, uri: str) -> str:
    """The name of a file below a root, or its own where there is none."""
    base = root.rstrip("/") + "/"
    if not root or not uri.startswith(base):
        return name_of(uri)
    name = shown(uri.removeprefix(base)).rstrip("/")
    return unquote(name) if root.startswith("http") else name
