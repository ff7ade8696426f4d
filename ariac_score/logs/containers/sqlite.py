"""Scanning the SQLite files of ROS 2 bags, in the order of their rows.

Why not simply `SELECT` the wanted topics? No recorder makes an index by topic, so SQLite would read
all rows anyway; and a file that is damaged behind the wanted rows would pass for a whole one.

Source: rosbag2_storage_sqlite3, schema versions 1 to 4.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from itertools import count
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from ariac_score.errors import CutOffError, LogError
from ariac_score.logs.containers.items import (
    Batch,
    Connection,
    Item,
    Message,
    Payloads,
    checked_stamp,
    normalised_type,
)

__all__ = ["MAGIC", "SqliteScan"]

MAGIC = b"SQLite format 3\0"

_HINT = "take another copy of the file, or record the trial again; a score may not rest on part of a log"
_TABLES = {"topics": {"id", "name", "type"}, "messages": {"id", "topic_id", "timestamp", "data"}}
_Row = tuple[int, Any, Any, Any]
"""Row number, topic, time and payload of a message, as stored."""

MAX_STEPS = 20_000_000
STEPS_PER_BYTE = 20
"""Reading and checking a message takes some tens of steps of SQLite's virtual machine, and a message has some
tens of bytes. A hostile schema can make it any number, in checks and indexes of its own."""
_STEPS_AT_ONCE = 100_000
_SMALLEST_LENGTH = 1_000_000
_LARGEST_LENGTH = (1 << 31) - 1
"""What SQLite takes for a limit; a recording may be larger."""

_BATCH_BYTES = 4 << 20
_BATCH_ROWS = 8192


class SqliteScan:
    """One `.db3` file; see `ariac_score.logs.containers.items.Scan`."""

    format = "ROS 2 bag (SQLite3)"

    def __init__(self, path: Path, *, topics: Container[str] | None = None, partial: bool = False) -> None:
        self.path = path
        self._topics_wanted, self._partial = topics, partial
        self._readable = "row 0"
        self._rows = self._row = 0
        self._topics: dict[Any, Connection] = {}

    @property
    def readable(self) -> str:
        """How far reading got."""
        return self._readable

    @property
    def index_contradictions(self) -> int:
        """None: the order of rows needs no index."""
        return 0

    @property
    def share(self) -> float:
        """The share read, 0 to 1."""
        return min(max(self._row / self._rows, 0.0), 1.0) if self._rows else 0.0

    def __iter__(self) -> Iterator[Item]:
        """Every declared connection and message, in recorded order.

        Raises:
            LogError: The file is not whole; see `readable`.
        """
        damage = _damage(self.path)
        fault = damage.words
        try:
            with self._opened(damage) as bag:
                self._check_tables(bag)
                yield from self._declared(bag)
                yield from self._messages(bag)
                if not fault:
                    # Whether the indexes agree with the rows does not matter, so the quick check is enough:
                    # it finds pages that are lost, used twice, out of order, or not what their lengths say.
                    ((verdict,),) = bag.execute("PRAGMA quick_check(1)")
                    words = "; ".join(str(verdict).splitlines())
                    fault = "" if verdict == "ok" else f"SQLite finds it damaged: {words}"
        except (sqlite3.Error, sqlite3.Warning, ValueError, OverflowError) as error:
            cause, place = fault or f"SQLite cannot read on: {error}", f"after {self._readable}"
            raise self._error(cause, place, cut=damage.is_cut) from error
        if fault:
            raise self._error(fault, cut=damage.is_cut)

    @contextmanager
    def _opened(self, damage: _Damage) -> Iterator[sqlite3.Connection]:
        """The database, to be read only."""
        with TemporaryDirectory(prefix="ariac-score-") as folder:
            # Immutable: a log is evidence, so no journal is rolled back into it and no lock file created.
            uri = f"{self.path.resolve().as_uri()}?mode=ro&immutable=1"
            if damage.journals and self._partial:
                # Its recorder was killed while it wrote: SQLite settles that by itself, in a copy.
                copies = [copyfile(file, Path(folder, file.name)) for file in (self.path, *damage.journals)]
                uri = copies[0].as_uri()
            elif damage.whole_bytes is not None and self._partial:
                # SQLite takes what is missing of a page for zeros, and those of a long message for its end.
                whole = copyfile(self.path, Path(folder, self.path.name))
                os.truncate(whole, damage.whole_bytes)
                uri = f"{whole.as_uri()}?mode=ro&immutable=1"
            with closing(sqlite3.connect(uri, uri=True)) as bag:
                bag.execute("PRAGMA trusted_schema=OFF")
                # Without it SQLite does not even open a file that lost its end, although the rows before
                # are readable; `_damage` reports the loss.
                bag.execute("PRAGMA writable_schema=ON")
                bag.execute("PRAGMA ignore_check_constraints=ON")  # they would be computed for each row
                bag.set_progress_handler(_patience(self.path.stat().st_size), _STEPS_AT_ONCE)
                if hasattr(bag, "setlimit"):  # from Python 3.11 on
                    longest = min(max(self.path.stat().st_size, _SMALLEST_LENGTH), _LARGEST_LENGTH)
                    bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, longest)
                yield bag

    def _error(self, cause: str, place: str = "", *, cut: bool = False) -> LogError:
        return (CutOffError if cut else LogError)(cause, file=self.path, place=place, hint=_HINT)

    def _check_tables(self, bag: sqlite3.Connection) -> None:
        """Make sure that the two tables are plain ones: a view or a virtual table could run for ever."""
        for table, columns in _TABLES.items():
            kinds = bag.execute("SELECT type, sql FROM sqlite_master WHERE name = ?", (table,)).fetchall()
            if len(kinds) != 1 or kinds[0][0] != "table" or "VIRTUAL" in str(kinds[0][1]).upper():
                raise self._error(f"it has no table {table!r}, so it is not a ROS 2 bag")
            found = {row[1] for row in bag.execute(f"PRAGMA table_xinfo({table})") if not row[6]}
            if not columns <= found:
                raise self._error(f"table {table!r} lacks {', '.join(sorted(columns - found))}")
            if "rowid" in {str(name).lower() for name in found}:
                raise self._error(f"table {table!r} has a column 'rowid', which hides the order of its rows")
        for (sql,) in bag.execute("SELECT sql FROM sqlite_master WHERE type = 'index' LIMIT 1000"):
            if str(sql or "").count("(") > 1:  # the check of the file would compute it for each row
                raise self._error("it has an index of computed values, so it is not read")

    def _declared(self, bag: sqlite3.Connection) -> Iterator[Connection]:
        definitions = _definitions(bag)
        columns = {row[1] for row in bag.execute("PRAGMA table_xinfo(topics)")}
        encoding = "serialization_format" if "serialization_format" in columns else "'cdr'"
        for key, topic, name, encoded in bag.execute(
            f"SELECT id, name, type, {encoding} FROM topics ORDER BY id"  # noqa: S608  # one of two constants
        ):
            format_, definition = definitions.get(str(name), ("", ""))
            connection = Connection(str(topic), normalised_type(str(name)), str(encoded), definition, format_)
            self._topics[key] = connection
            yield connection

    def _messages(self, bag: sqlite3.Connection) -> Iterator[Item]:
        # The order of rows is the order of recording; an index by time would hide stamps that run backwards.
        with suppress(sqlite3.DatabaseError):  # the last row is the first thing that a cut takes
            ((last,),) = bag.execute("SELECT max(rowid) FROM messages").fetchall() or ((0,),)
            self._rows = last or 0
        payload, wanted = "data", list[Any]()
        if self._topics_wanted is not None:
            # Unwanted payloads are not read: SQLite keeps long ones on overflow pages, which it then skips.
            wanted = [key for key, c in self._topics.items() if c.topic in self._topics_wanted]
            payload = f"CASE WHEN topic_id IN ({', '.join('?' * len(wanted))}) THEN data ELSE x'' END"
        query = f"SELECT rowid, topic_id, timestamp, {payload} FROM messages ORDER BY rowid"  # noqa: S608  # constants
        for rows in _portions(bag.execute(query, wanted)):
            batch = self._batch(rows)
            if batch is None:
                yield from self._one_by_one(rows)
            else:
                yield batch
            self._reached(rows[-1][0])

    def _reached(self, row: int) -> None:
        self._row, self._readable = row, f"row {row}"

    def _batch(self, rows: Sequence[_Row]) -> Batch | None:
        """Rows as a batch; `None` when something is wrong with one of them."""
        _, topics, stamps_ns, payloads = zip(*rows, strict=True)
        if set(map(type, payloads)) != {bytes} or set(map(type, stamps_ns)) != {int}:
            return None
        known = {topic: place for place, topic in enumerate(dict.fromkeys(topics))}
        if min(stamps_ns) < 0 or any(topic not in self._topics for topic in known):
            return None
        sources = np.fromiter(map(known.__getitem__, topics), np.int64, len(topics))
        senders = tuple(self._topics[topic] for topic in known)
        return Batch(senders, sources, np.array(stamps_ns, dtype=np.int64), Payloads.joined(payloads))

    def _one_by_one(self, rows: Sequence[_Row]) -> Iterator[Message]:
        for row, topic, stamp_ns, payload in rows:
            if topic not in self._topics:
                raise self._error(
                    f"a message belongs to topic {topic!r}, which is not declared", f"row {row}"
                )
            if not isinstance(payload, bytes):
                raise self._error("a message holds no bytes", f"row {row}")
            checked_stamp(stamp_ns, file=self.path, place=f"row {row}")
            self._reached(row)
            yield Message(self._topics[topic], stamp_ns, payload)


def _patience(size: int) -> Callable[[], bool]:
    """A progress handler that stops SQLite once no honest file of this size would take as long."""
    left = count(1 + (MAX_STEPS + STEPS_PER_BYTE * size) // _STEPS_AT_ONCE, -1)
    return lambda: next(left) <= 0


def _portions(cursor: sqlite3.Cursor) -> Iterator[list[_Row]]:
    """The rows in portions of some MB; rows before a damaged one are yielded before the error is raised.

    Why not `fetchmany`: where it fails, it loses the rows that it had fetched.
    """
    rows, size = list[_Row](), 0
    try:
        for row in cursor:
            rows.append(row)
            size += len(row[3]) if isinstance(row[3], bytes) else 0
            if size > _BATCH_BYTES or len(rows) >= _BATCH_ROWS:
                yield rows
                rows, size = [], 0
    except (sqlite3.Error, OverflowError):
        if rows:
            yield rows
        raise
    if rows:
        yield rows


def _definitions(bag: sqlite3.Connection) -> dict[str, tuple[str, str]]:
    """Format and text of the embedded definitions by type; none before schema version 4."""
    found = bag.execute("SELECT type, sql FROM sqlite_master WHERE name = 'message_definitions'").fetchall()
    if [kind for kind, _ in found] != ["table"] or "VIRTUAL" in str(found[0][1]).upper():
        return {}
    rows = bag.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
    known = {str(name): (str(encoding), str(text)) for name, encoding, text in rows if text}
    # Events of a service have the definition of the service, under its own name.
    events = {f"{name}_Event": text for name, text in known.items() if "/srv/" in name}
    return {**events, **known}


class _Damage(NamedTuple):
    """Damage that shows before a row is read.

    Attributes:
        words: In words; empty without any.
        is_cut: Whether its end alone is missing.
        journals: Files beside it that hold changes which are not in it.
        whole_bytes: Its bytes up to the last whole page, where it ends within one.
    """

    words: str = ""
    is_cut: bool = False
    journals: tuple[Path, ...] = ()
    whole_bytes: int | None = None


def _damage(path: Path) -> _Damage:
    """Damage that shows in the file's header or in journals next to it."""
    beside = [path.with_name(path.name + suffix) for suffix in ("-wal", "-journal")]
    journals = tuple(file for file in beside if file.is_file() and file.stat().st_size)
    if journals:
        words = f"the recording was not closed: {journals[0].name} holds changes that are not in it"
        return _Damage(words, True, journals)
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(100)
    if len(header) < 100 or not header.startswith(MAGIC):
        words = f"the file is not a whole SQLite file: {size} bytes, and its header is cut off or wrong"
        return _Damage(words)
    page = int.from_bytes(header[16:18], "big")
    page = 65536 if page == 1 else page  # 65536 does not fit into the field's 16 bits
    # The page count is valid only when the two change counters agree.
    pages = int.from_bytes(header[28:32], "big") if header[24:28] == header[92:96] else 0
    if page and (size % page or size < pages * page):
        there = f"the file is cut off: {size} bytes are there"
        words = f"{there}, its header speaks of {pages} pages of {page} bytes"
        return _Damage(words, True, whole_bytes=size - size % page if size % page else None)
    return _Damage()
