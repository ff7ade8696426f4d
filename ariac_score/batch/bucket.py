"""The folder of a batch in an object storage, such as a bucket of S3.

Documents lie there under the same content addresses, tables beside them. A call works in a copy on this
machine, from which it goes on after it was killed, and brings to the storage what is new when it ends:
documents first, the table that names them last. So whoever reads the table finds every document that it
names, with the SHA-256 that it names.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from ariac_score.batch.description import DESCRIPTION, RULES
from ariac_score.batch.index import INDEX, RUNS, is_object, read_rows
from ariac_score.batch.remote import Storage, Stored, UnreachableError, is_uri, shown
from ariac_score.batch.state import STORAGE_UNREACHABLE
from ariac_score.batch.store import JOURNAL, read_document
from ariac_score.errors import BatchError, UsageError

__all__ = ["Bucket", "brought", "fetched_batch", "fetched_batches", "mirror_of"]

_SEEN = ".stored.jsonl"
"""The table of the storage as this machine saw it last, in the copy."""
_SIGNATURE = f"{RUNS}.minisig"
_BESIDE = (RULES, DESCRIPTION, INDEX, _SIGNATURE)
"""What lies beside the table."""


def mirror_of(uri: str) -> Path:
    """The folder of this machine in which the batch of a URI is worked on.

    Raises:
        UsageError: Batches cannot be written to such a URI.
    """
    _refuse_web_server(uri)
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    name = hashlib.sha256(uri.rstrip("/").encode("utf-8", "surrogateescape")).hexdigest()[:32]
    return Path(base).expanduser() / "ariac-score" / "stores" / name


class Bucket:
    """A batch in an object storage, and a copy of it.

    Args:
        uri: Of its folder there.
        folder: The copy.

    Raises:
        UsageError: A library is missing, or none knows such URIs.
    """

    def __init__(self, uri: str, folder: Path) -> None:
        self.uri, self.folder = uri.rstrip("/"), folder
        self._storage = Storage(self.uri)
        self._table: Stored | None = None

    def pull(self, work: Path) -> bool:
        """Bring the copy to what the storage has; what the copy alone has stays, to go on from.

        Args:
            work: Folder for unfinished work, beside the copy.

        Returns:
            Whether a finished batch lies there.

        Raises:
            BatchError: The storage does not answer.
            UsageError: It wants other credentials.
            OSError: The copy cannot be written.
        """
        seen, own = self.folder / _SEEN, self.folder / RUNS
        self._table = self._storage.named(RUNS)
        if self._table is None:
            seen.unlink(missing_ok=True)
            return False
        table = work / "stored.jsonl"
        self._storage.get({RUNS: table})
        if _same(table, seen) and own.is_file():
            return True
        if own.is_file() and not _same(own, seen):
            # It ended here and never came to the storage: to go on from, as from a call that was killed.
            with own.open("rb") as rows, (self.folder / JOURNAL).open("ab") as journal:
                shutil.copyfileobj(rows, journal)
        damaged = self._get_documents(table)
        for name in _BESIDE:
            (self.folder / name).unlink(missing_ok=True)
        self._storage.get({name: self.folder / name for name in _BESIDE if self._storage.named(name)})
        with seen.open("w", encoding="ascii", newline="\n") as sound:
            sound.writelines(line for row, line in read_rows(table) if row.object not in damaged)
        table.replace(own)
        return True

    def _get_documents(self, table: Path) -> set[str]:
        """Fetch what the copy lacks of a table; the names of documents that are not what their rows say."""
        wanted = {
            row.object: row.sha256
            for row, _ in read_rows(table)
            if is_object(row.object) and _sha256(self.folder / row.object) != row.sha256
        }
        self._storage.get({name: self.folder / name for name in wanted})
        return {name for name, sha256 in wanted.items() if _sha256(self.folder / name) != sha256}

    def push(self) -> int:
        """Bring to the storage what it lacks.

        Returns:
            How many documents it lacked.

        Raises:
            BatchError: The storage does not answer, or somebody else has written there since `pull`.
            UsageError: It wants other credentials.
        """
        known = {row.object: row.sha256 for row, _ in read_rows(self.folder / _SEEN)}
        new = {
            row.object: self.folder / row.object
            for row, _ in read_rows(self.folder / RUNS)
            if row.object and known.get(row.object) != row.sha256
        }
        self._storage.put(new)
        now = self._storage.named(RUNS)
        if now != self._table:
            raise self._taken()
        self._storage.put({name: self.folder / name for name in _BESIDE if (self.folder / name).is_file()})
        if not (self.folder / _SIGNATURE).is_file():
            self._storage.remove(_SIGNATURE)
        if not self._storage.put_unless_changed(RUNS, self.folder / RUNS, self._table):
            raise self._taken()
        self._table = self._storage.named(RUNS)
        shutil.copyfile(self.folder / RUNS, self.folder / _SEEN)
        return len(new)

    def _taken(self) -> BatchError:
        return BatchError(
            "another batch has written there meanwhile",
            file=shown(self.uri),
            hint="call again: what was scored is kept here, and joined with what is there now",
        )


@contextmanager
def brought(bucket: Bucket | None, work: Path) -> Iterator[None]:
    """The copy as the storage has it; at the end, if nothing failed, the storage as the copy is then.

    Raises:
        BatchError: The storage does not answer, or somebody else has written there meanwhile.
        UsageError: It wants other credentials.
    """
    if bucket is None:
        yield
        return
    try:
        bucket.pull(work)
        yield
        bucket.push()
    except UnreachableError as error:
        raise error.named(STORAGE_UNREACHABLE) from error.__cause__


@contextmanager
def fetched_batch(given: str | Path, *, bring_back: bool = False) -> Iterator[Path]:
    """The folder of a batch, fetched for the moment where a URI names it.

    Args:
        given: A folder of this machine, or a URI.
        bring_back: Whether what was added to it, such as a signature, is brought to the storage.

    Raises:
        BatchError: The storage does not answer, or somebody else has written there meanwhile.
        UsageError: It wants other credentials, or there is no batch.
    """
    if not is_uri(str(given)):
        yield Path(given)
        return
    if bring_back:
        _refuse_web_server(str(given))
    with TemporaryDirectory(prefix="ariac-score-") as name:
        folder, work = Path(name) / "batch", Path(name) / "work"
        folder.mkdir()
        work.mkdir()
        bucket = Bucket(str(given), folder)
        if not bucket.pull(work):
            raise UsageError(
                f"no finished batch lies there: {RUNS} is missing",
                file=shown(str(given)),
                hint="check the address, or call 'batch' with it first",
            )
        yield folder
        if bring_back:
            bucket.push()


@contextmanager
def fetched_batches(given: Sequence[str | Path]) -> Iterator[list[Path]]:
    """The folders of several batches, in order; see `fetched_batch`."""
    with ExitStack() as stack:
        yield [stack.enter_context(fetched_batch(one)) for one in given]


def _refuse_web_server(uri: str) -> None:
    if uri.startswith(("http://", "https://")):
        raise UsageError(
            "a web server takes no results",
            file=shown(uri),
            hint="name a folder of this machine, or of an object storage, such as s3://BUCKET/FOLDER",
        )


def _same(one: Path, other: Path) -> bool:
    return bool(found := _sha256(one)) and found == _sha256(other)


def _sha256(place: Path) -> str:
    """Hash of a file; empty where there is none that could be read."""
    try:
        return hashlib.sha256(read_document(place)).hexdigest()
    except OSError:
        return ""
