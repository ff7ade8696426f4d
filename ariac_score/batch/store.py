"""The folder of a batch: results under content addresses, each complete or absent."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import UsageError
from ariac_score.installed.system import lock as lock_file

__all__ = ["JOURNAL", "Store", "read_document"]

_OBJECTS = "objects"
_WORK = ".work-"
_LOCK = ".lock"
JOURNAL = ".rows.jsonl"
_PART = ".part-"
LARGEST_DOCUMENT_BYTES = 1 << 30


class Store:
    """Where a batch keeps results and tables.

    ```
    OUT/objects/ab/<address of what was measured>/<rules>.json   a result, or why there is none
    OUT/rules.yaml  batch.json  runs.jsonl  index.sqlite         see `ariac_score.batch.index`
    ```

    One folder for each measurement, one file in it for each rule set it was priced by.

    Args:
        root: The folder; made when it is not there.

    Raises:
        UsageError: It cannot be made.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        try:
            (root / _OBJECTS).mkdir(parents=True, exist_ok=True)
        except OSError as cause:
            raise UsageError(
                f"cannot be made: {cause.strerror}", file=root, hint="name a folder you may write in with -o"
            ) from cause

    @property
    def journal(self) -> Path:
        """The rows of a call that has not ended, one line each: what remains of a killed batch."""
        return self.root / JOURNAL

    def place(self, address: str, rules_sha256: str) -> Path:
        """The file for the result of a measurement under a rule set."""
        return self.root / self.name_of(address, rules_sha256)

    def name_of(self, address: str, rules_sha256: str) -> str:
        """The name of that file within the folder, as tables have it."""
        # Part of the hash is enough: the folder of a measurement holds a handful of rule sets.
        return f"{_OBJECTS}/{address[:2]}/{address}/{rules_sha256[:16]}.json"

    def read(self, name: str) -> bytes:
        """A document by its name; a season has thousands.

        Raises:
            OSError: It is not there, or cannot be read.
        """
        return read_document(f"{self.root}/{name}")

    def measured(self, address: str) -> Path:
        """The folder of a measurement."""
        return self.root / _OBJECTS / address[:2] / address

    def put(self, place: Path, document: bytes) -> None:
        """Write a file that is either complete or absent.

        Raises:
            OSError: The disk is full, or the folder cannot be written.
        """
        try:  # in the same folder, for a file can be renamed within one file system only
            handle, name = tempfile.mkstemp(dir=place.parent, prefix=_PART)
        except FileNotFoundError:
            place.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=place.parent, prefix=_PART)
        part = Path(name)
        try:
            with os.fdopen(handle, "wb") as out:
                out.write(document)
            part.chmod(0o644)  # `mkstemp` lets nobody else read it
            part.replace(place)
        except BaseException:
            part.unlink(missing_ok=True)
            raise

    @contextmanager
    def working(self) -> Iterator[Path]:
        """A folder for unfinished work, under a lock: two batches never write into one folder.

        What an interrupted batch left behind is removed, half-written files included.

        Raises:
            UsageError: Another batch is writing here, or this user may not.
        """
        try:
            lock = (self.root / _LOCK).open("w")
        except OSError as cause:
            raise UsageError(
                f"cannot be written: {cause.strerror}",
                file=self.root,
                hint="name a folder you may write in with -o",
            ) from cause
        try:
            if not lock_file(lock):
                raise UsageError(
                    "another batch is writing here",
                    file=self.root,
                    hint="wait until it has finished, or give this one a folder of its own",
                )
            self._clear()
            folder = Path(tempfile.mkdtemp(dir=self.root, prefix=_WORK))
            try:
                yield folder
            finally:
                shutil.rmtree(folder, ignore_errors=True)
                (self.root / _LOCK).unlink(missing_ok=True)
        finally:
            lock.close()

    def _clear(self) -> None:
        for folder in self.root.glob(f"{_WORK}*"):
            shutil.rmtree(folder, ignore_errors=True)
        _clear_parts(str(self.root))


def read_document(place: str | Path) -> bytes:
    """The bytes of a document of a batch, which a stranger may have made.

    Raises:
        OSError: It is not there, cannot be read, is a pipe or device, or is larger than any document.
    """
    return read_plain(place, LARGEST_DOCUMENT_BYTES)


def _clear_parts(folder: str) -> None:
    """Remove half-written files; plain strings instead of `Path`, for there is a folder for each run."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir(follow_symlinks=False):
                _clear_parts(entry.path)
            elif entry.name.startswith(_PART):
                Path(entry.path).unlink(missing_ok=True)
