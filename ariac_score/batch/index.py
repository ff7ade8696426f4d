"""The tables of a batch: `runs.jsonl` to read, `index.sqlite` to query.

Both can be made again from the stored documents. They hold no clock and no path of a machine, so that
the same runs give the same bytes. (The header of a SQLite file names the version of SQLite that wrote it.)
"""

from __future__ import annotations

import hashlib
import json
import re
import sqlite3
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from msgspec import Struct

from ariac_score.batch.outcomes import CheckCounts, Summary, summary_of
from ariac_score.batch.store import Store, read_document
from ariac_score.batch.tasks import TaskKey
from ariac_score.documents.plain_file import open_plain
from ariac_score.errors import BatchError
from ariac_score.results.codec import encodable, plain
from ariac_score.results.result import Pinned
from ariac_score.results.result_file import RESULT

__all__ = [
    "AGAIN",
    "INDEX",
    "RUNS",
    "Row",
    "Rows",
    "Written",
    "check_index",
    "checked_rows",
    "is_object",
    "read_rows",
    "recorded_document",
    "refuse_other_rules",
    "tables_sha256",
    "write_tables",
]

RUNS = "runs.jsonl"
INDEX = "index.sqlite"
AGAIN = "call 'batch' again with this folder: it makes again what is missing or wrong"
"""What to do about a damaged batch, for a hint."""

_TABLES = """
CREATE TABLE runs (team TEXT NOT NULL, trial TEXT NOT NULL, run INTEGER NOT NULL, outcome TEXT NOT NULL,
  reason TEXT NOT NULL, score REAL, task REAL, object TEXT NOT NULL, sha256 TEXT NOT NULL,
  score_least REAL, score_most REAL,
  PRIMARY KEY (team, trial, run)) WITHOUT ROWID;
CREATE TABLE checks (team TEXT NOT NULL, trial TEXT NOT NULL, run INTEGER NOT NULL, name TEXT NOT NULL,
  satisfied INTEGER NOT NULL, violated INTEGER NOT NULL, inconclusive INTEGER NOT NULL,
  not_applicable INTEGER NOT NULL, worst_robustness REAL,
  PRIMARY KEY (team, trial, run, name)) WITHOUT ROWID;
"""
_LITTLE_MEMORY = "PRAGMA cache_size = -256"
"""KiB of a file that SQLite caches; the operating system caches it anyway."""
_AT_A_TIME = 256
"""Rows that are written in one call of SQLite."""
_LARGEST_RUN = (1 << 63) - 1
"""Larger integers have no place in a table of SQLite."""
_LONGEST_LINE = 16 << 20
"""A row has a few thousand bytes; a file without line ends need not fit into memory."""
_BLOCK = 1 << 16
_CURRENT = f'"schema": "{RESULT.tag}"'.encode()


class Row(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One run in the tables.

    Attributes:
        team: Of the run.
        trial: Of the run.
        run: Its number.
        outcome: One of `OUTCOMES`.
        reason: Why, where it is not simply scored.
        score: Final score; `None` when there is none.
        task: Task score; `None` when there is none.
        checks: What each check found.
        object: Name of its document within the folder of the batch; empty when nothing is kept.
        sha256: Hash of that document; empty likewise.
        score_least: The least score that its log allows, where it leaves any open.
        score_most: The most, likewise.
    """

    team: str
    trial: str
    run: int
    outcome: str
    reason: str
    score: float | None
    task: float | None
    checks: tuple[CheckCounts, ...]
    object: str
    sha256: str
    score_least: float | None = None
    score_most: float | None = None

    @classmethod
    def of(cls, key: TaskKey, summary: Summary, name: str = "", sha256: str = "") -> Row:
        """The row of a run."""
        s = summary
        return cls(*key, s.outcome, s.reason, s.score, s.task, s.checks, name, sha256, s.least, s.most)

    @classmethod
    def kept(cls, key: TaskKey, document: bytes, name: str) -> Row:
        """The row of a document that is stored under a name.

        Raises:
            ValueError: It is damaged.
        """
        return cls.of(key, summary_of(document), name, hashlib.sha256(document).hexdigest())

    @property
    def key(self) -> TaskKey:
        """Team, trial, number."""
        return self.team, self.trial, self.run

    @property
    def summary(self) -> Summary:
        """The part of it that is not about the document."""
        return Summary(
            self.outcome,
            self.reason,
            self.score,
            self.task,
            self.checks,
            self.score_least,
            self.score_most,
        )

    def as_line(self) -> str:
        """The row as a line of JSON."""
        return json.dumps(plain(self), ensure_ascii=True) + "\n"

    @classmethod
    def from_line(cls, line: str) -> Row:
        """A row as it was written.

        Raises:
            ValueError: It is not one.
        """
        # Not decoded by msgspec at once: it refuses half a surrogate pair, which a line may hold.
        try:
            row = msgspec.convert(json.loads(line), cls)
        except (msgspec.ValidationError, RecursionError) as cause:
            raise ValueError(f"no row: {cause}") from None
        if abs(row.run) > _LARGEST_RUN or not all(
            map(_in_utf_8, (row.team, row.trial, row.object, row.sha256))
        ):
            raise ValueError("no row: its names or its number have no place in a table")
        return row


def _in_utf_8(name: str) -> bool:
    return name.isascii() or encodable(name) == name


class Written(NamedTuple):
    """A row as tables hold it, for those who do not need its checks.

    A call on a finished season looks at every row, and should not build all their checks.

    Attributes:
        outcome: Of the run.
        reason: Why.
        object: Name of its document; empty when nothing is kept.
        sha256: Hash of that; empty likewise.
        line: The row as a line of JSON.
    """

    outcome: str
    reason: str
    object: str
    sha256: str
    line: str

    @classmethod
    def of(cls, row: Row) -> Written:
        """A row, written."""
        return cls(row.outcome, row.reason, row.object, row.sha256, row.as_line())

    @classmethod
    def from_line(cls, line: str) -> Written:
        """A row from a line that `Row.from_line` has accepted."""
        fields = json.loads(line)
        return cls(fields["outcome"], fields["reason"], fields["object"], fields["sha256"], line)


class Rows:
    """Rows that come in any order and are read back sorted, kept on disk, for a batch may have any number."""

    def __init__(self, work: Path) -> None:
        self._looked_up: tuple[TaskKey, Written | None] | None = None
        self._added: list[tuple[str, str, int, str]] = []
        self._connection = sqlite3.connect(work / "rows.sqlite")
        # Neither journal nor sync: the file is for this call alone.
        self._connection.execute("PRAGMA journal_mode = OFF")
        self._connection.execute("PRAGMA synchronous = OFF")
        self._connection.execute(_LITTLE_MEMORY)
        for table in ("lines", "earlier"):
            self._connection.execute(
                f"CREATE TABLE {table} (team TEXT, trial TEXT, run INTEGER, line TEXT,"
                " PRIMARY KEY (team, trial, run)) WITHOUT ROWID"
            )

    def add(self, key: TaskKey, line: str) -> None:
        """Take the line of a run; a later one replaces it."""
        self._added.append((*key, line))
        if len(self._added) >= _AT_A_TIME:
            self._flush()

    def _flush(self) -> None:
        added, self._added = self._added, []
        self._connection.executemany("INSERT OR REPLACE INTO lines VALUES (?, ?, ?, ?)", added)

    def remember(self, rows: Iterable[tuple[Row, str]]) -> None:
        """Take the rows of an earlier call with their lines, for `earlier`."""
        self._connection.executemany(
            "INSERT OR REPLACE INTO earlier VALUES (?, ?, ?, ?)", ((*row.key, line) for row, line in rows)
        )

    def earlier(self, key: TaskKey) -> Written | None:
        """The row that a run had in an earlier call, if any; the same object when called again."""
        if self._looked_up is None or self._looked_up[0] != key:
            line = self._line("earlier", key)
            self._looked_up = key, Written.from_line(line) if line else None
        return self._looked_up[1]

    def lines(self) -> Iterator[str]:
        """The rows as lines, by team, trial and number."""
        self._flush()
        for (line,) in self._connection.execute("SELECT line FROM lines ORDER BY team, trial, run"):
            yield line

    def get(self, key: TaskKey) -> Row | None:
        """The row of a run, if there is one."""
        self._flush()
        line = self._line("lines", key)
        return Row.from_line(line) if line else None

    def _line(self, table: str, key: TaskKey) -> str:
        found = self._connection.execute(
            f"SELECT line FROM {table} WHERE team = ? AND trial = ? AND run = ?",  # noqa: S608  # a name of ours
            key,
        ).fetchone()
        return found[0] if found else ""

    def close(self) -> None:
        """Close the file."""
        self._connection.close()


def read_rows(file: Path) -> Iterator[tuple[Row, str]]:
    """The rows in a file with their lines; a damaged one is passed over, and its run looked at again."""
    if not file.is_file():  # a pipe would be waited for
        return
    try:
        with file.open(encoding="ascii", errors="replace") as lines:
            while line := lines.readline(_LONGEST_LINE):
                if len(line) == _LONGEST_LINE:
                    return  # whatever this is, we have not written it
                try:
                    yield Row.from_line(line), line
                except ValueError:
                    continue
    except OSError:
        return


def checked_rows(root: Path, name: str = RUNS) -> Iterator[tuple[Row, bytes]]:
    """The rows of a finished batch with their documents, each row compared with its document.

    Args:
        root: Folder of the batch.
        name: Of the table.

    Raises:
        BatchError: A line is no row, or a document is missing, damaged, or contradicts its row.
    """
    file = root / name
    if not file.is_file():
        raise BatchError("it is no plain file, or not there", file=file, hint=AGAIN)
    with file.open(encoding="ascii", errors="replace") as lines:
        for number, line in enumerate(iter(lambda: lines.readline(_LONGEST_LINE), ""), start=1):
            try:
                row = Row.from_line(line)
            except ValueError as cause:
                raise BatchError("no row of a run", file=file, place=f"line {number}", hint=AGAIN) from cause
            document = recorded_document(row, root) if row.object else b""
            if newer := _newer(document):
                raise BatchError(newer, file=root / row.object, hint="update ariac-score")
            if row.object and not _agrees(row, document):
                raise BatchError(
                    f"the row of run {'/'.join(map(str, row.key)).lstrip('/')} contradicts its document",
                    file=file,
                    place=f"line {number}",
                    hint=AGAIN,
                )
            yield row, document


def recorded_document(row: Row, root: Path) -> bytes:
    """The document of a row, which must be the one that was written then.

    Raises:
        BatchError: It is missing, or another.
    """
    if not is_object(row.object):
        raise BatchError(f"{row.object!r} is no place of a result", file=root / RUNS, hint=AGAIN)
    source = root / row.object
    try:
        document = read_document(source)
    except OSError as cause:
        raise BatchError(f"cannot be read: {cause.strerror}", file=source, hint=AGAIN) from cause
    if hashlib.sha256(document).hexdigest() != row.sha256:
        raise BatchError("was changed since it was written: its hash is another one", file=source, hint=AGAIN)
    return document


def refuse_other_rules(row: Row, rules: Pinned, root: Path) -> None:
    """Refuse a row whose result was priced by other rules than those of its batch.

    Raises:
        BatchError: It was.
    """
    if row.object and not row.object.endswith(f"/{rules.sha256[:16]}.json"):
        name = "/".join(map(str, row.key)).lstrip("/")
        raise BatchError(
            f"the result of run {name} was made by other rules than {rules.id}",
            file=root / row.object,
            hint=AGAIN,
        )


def _newer(document: bytes) -> str:
    """The error message for a document that a newer version wrote; empty for any other."""
    if _CURRENT in document or not document:
        return ""
    try:
        return RESULT.newer(json.loads(document))
    except (ValueError, RecursionError):
        return ""


def is_object(name: str) -> bool:
    """Whether a name, which comes out of a file, leads to a result and nowhere else."""
    return _OBJECT.fullmatch(name) is not None


_OBJECT = re.compile(r"objects/[0-9a-f]{2}/[0-9a-f]{1,64}/[0-9a-f]{1,64}\.json", re.ASCII)


def _agrees(row: Row, document: bytes) -> bool:
    try:
        return Row.kept(row.key, document, row.object).as_line() == row.as_line()
    except (ValueError, KeyError, TypeError, AttributeError):
        return False


def check_index(root: Path, rows: Iterable[Row]) -> None:
    """Compare the index of a batch with its rows, which come by team, trial and number.

    Raises:
        BatchError: They differ.
    """
    file = root / INDEX
    if not file.is_file():  # a pipe would be waited for
        raise BatchError("it is no plain file, or not there", file=file, hint=AGAIN)
    try:
        connection = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)
        try:
            tables = (
                connection.execute("SELECT * FROM runs ORDER BY team, trial, run"),
                connection.execute("SELECT * FROM checks ORDER BY team, trial, run, name"),
            )
            expected = (_index_rows(row) for row in rows)
            runs, checks = tables
            alike = all(
                runs.fetchone() == run and [checks.fetchone() for _ in found] == sorted(found)
                for run, found in expected
            )
            alike = alike and not any(table.fetchone() for table in tables)
        finally:
            connection.close()
    except sqlite3.Error as cause:
        raise BatchError(f"cannot be read: {cause}", file=file, hint=AGAIN) from cause
    if not alike:
        raise BatchError(f"it contradicts {RUNS}", file=file, hint=AGAIN)


def tables_sha256(root: Path) -> str:
    """One hash over both tables; empty when one is missing."""
    digest = hashlib.sha256()
    try:
        for name in (RUNS, INDEX):
            with open_plain(root / name) as table:
                while block := table.read(1 << 20):
                    digest.update(block)
    except OSError:
        return ""
    return digest.hexdigest()


def write_tables(store: Store, rows: Rows, work: Path, *, trusted: bool = False) -> bool:
    """Write both tables, whole, and only where they changed.

    Args:
        store: The folder of the batch.
        rows: All rows.
        work: Folder for unfinished work.
        trusted: The stored index is known to follow from the stored rows.

    Returns:
        Whether the stored index contradicted the stored rows.

    Raises:
        OSError: The disk is full.
    """
    lines = work / RUNS
    with lines.open("w", encoding="ascii", newline="\n") as out:
        out.writelines(rows.lines())
    as_before = _same(lines, store.root / RUNS)
    if as_before and trusted:
        return False
    index = work / INDEX
    _write_index(index, rows.lines())
    if as_before and _same(index, store.root / INDEX):
        return False
    contradicted = as_before and (store.root / INDEX).is_file()
    (store.root / RUNS).unlink(missing_ok=True)  # a batch without it is unfinished, so the two never differ
    index.replace(store.root / INDEX)
    lines.replace(store.root / RUNS)
    return contradicted


def _same(first: Path, second: Path) -> bool:
    try:
        with open_plain(first) as one, open_plain(second) as other:
            while block := one.read(_BLOCK):
                if other.read(_BLOCK) != block:
                    return False
            return not other.read(1)
    except OSError:
        return False


def _write_index(file: Path, lines: Iterator[str]) -> None:
    connection = sqlite3.connect(file)
    try:
        # Neither journal nor sync: an index that is not finished is thrown away with its folder.
        connection.execute("PRAGMA journal_mode = OFF")
        connection.execute("PRAGMA synchronous = OFF")
        connection.execute(_LITTLE_MEMORY)
        connection.executescript(_TABLES)
        connection.execute("BEGIN")
        for line in lines:
            run, checks = _index_rows(Row.from_line(line))
            connection.execute("INSERT INTO runs VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", run)
            connection.executemany("INSERT INTO checks VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)", checks)
        connection.commit()
    finally:
        connection.close()


def _index_rows(row: Row) -> tuple[tuple[Any, ...], list[tuple[Any, ...]]]:
    """The row of a run in the table `runs`, and those in `checks`."""
    checks = [
        (*row.key, c.name, c.satisfied, c.violated, c.inconclusive, c.not_applicable, c.worst_robustness)
        for c in row.checks
    ]
    run = (*row.key, row.outcome, row.reason, row.score, row.task, row.object, row.sha256)
    return (*run, row.score_least, row.score_most), checks
