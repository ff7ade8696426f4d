"""Scanning the SQLite files of ROS 2 bags, in the order of their rows.

Source: rosbag2_storage_sqlite3, schema versions 1 to 4.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Container, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score.errors import LogError
from ariac_score.logs.containers.items import (
    Batch,
    Connection,
    Message,
    Payloads,
    checked_stamp,
    normalised_type,
)
from ariac_score.logs.containers.sqlite_pages import Pages, UnusualError

__all__ = ["MAGIC", "SqliteScan"]

MAGIC = b"SQLite format 3\0"

_HINT = "take another copy of the file, or record the trial again; a score may not rest on part of a log"
_TABLES = {"topics": {"id", "name", "type"}, "messages": {"id", "topic_id", "timestamp", "data"}}
_PLAIN_COLUMNS = [("id", 1, 0), ("topic_id", 0, 0), ("timestamp", 0, 0), ("data", 0, 0)]
"""Of the table of messages: name, place in the primary key, whether it is hidden."""
_Item = Connection | Message | Batch

MAX_STEPS = 20_000_000
STEPS_PER_BYTE = 20
"""Reading and checking a message takes some tens of steps of SQLite's machine, and a message some tens of
bytes; a schema may make them as many as it likes, in checks and indexes of its own."""
_STEPS_AT_ONCE = 100_000
_SMALLEST_LENGTH = 1_000_000

_BATCH_BYTES = 4 << 20
_BATCH_ROWS = 8192
_FEW_ROWS = 64
"""Rows that are fetched before it is looked at how large they are."""


class SqliteScan:
    """One `.db3` file; see `ariac_score.logs.containers.items.Scan`."""

    format = "ROS 2 bag (SQLite3)"

    def __init__(self, path: Path, *, topics: Container[str] | None = None) -> None:
        self.path = path
        self._topics_wanted = topics
        self._readable = "row 0"
        self._rows = self._row = 0
        self._last: int | None = None
        self._accounted = False
        self._topics: dict[int, Connection] = {}

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

    def __iter__(self) -> Iterator[_Item]:
        """Every declared connection and message, in recorded order.

        Raises:
            LogError: The file is not whole; see `readable`.
        """
        damage = _damage(self.path)
        try:
            # Immutable: a log is evidence; no journal is rolled back into it and no lock file left beside it.
            with closing(
                sqlite3.connect(f"{self.path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
            ) as bag:
                bag.execute("PRAGMA trusted_schema=OFF")
                # Without it SQLite will not even open a file that lost its end; `_damage` reports that.
                bag.execute("PRAGMA writable_schema=ON")
                bag.execute("PRAGMA ignore_check_constraints=ON")  # they would be computed for each row
                bag.set_progress_handler(_patience(self.path.stat().st_size), _STEPS_AT_ONCE)
                if hasattr(bag, "setlimit"):  # from Python 3.11 on
                    bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, max(self.path.stat().st_size, _SMALLEST_LENGTH))
                self._check_tables(bag)
                yield from self._declared(bag)
                yield from self._messages(bag, intact=not damage)
                if not damage and (self._topics_wanted is None or not self._accounted):
                    # Rows are read in their own order, so whether the index agrees does not matter. Where
                    # each page is accounted for, nothing more is found; but who wants all is told all.
                    ((verdict,),) = bag.execute("PRAGMA quick_check(1)")
                    damage = "" if verdict == "ok" else f"SQLite finds it damaged: {verdict}"
        except (sqlite3.Error, sqlite3.Warning, ValueError, OverflowError) as error:
            raise self._error(
                damage or f"SQLite cannot read on: {error}", f"after {self._readable}"
            ) from error
        if damage:
            raise self._error(damage)

    def _error(self, cause: str, place: str = "") -> LogError:
        return LogError(cause, file=self.path, place=place, hint=_HINT)

    def _check_tables(self, bag: sqlite3.Connection) -> None:
        """Make sure that the two tables are plain ones: a view could run for ever."""
        for table, columns in _TABLES.items():
            kinds = bag.execute("SELECT type, sql FROM sqlite_master WHERE name = ?", (table,)).fetchall()
            if len(kinds) != 1 or kinds[0][0] != "table" or "VIRTUAL" in str(kinds[0][1]).upper():
                raise self._error(f"it has no table {table!r}, so it is not a ROS 2 bag")
            found = {row[1] for row in bag.execute(f"PRAGMA table_xinfo({table})") if not row[6]}
            if not columns <= found:
                raise self._error(f"table {table!r} lacks {', '.join(sorted(columns - found))}")
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

    def _messages(self, bag: sqlite3.Connection, *, intact: bool) -> Iterator[_Item]:
        """All rows: from the pages of the file as long as these are as usual, the others by SQLite."""
        ((self._rows,),) = bag.execute("SELECT max(rowid) FROM messages").fetchall() or ((0,),)
        if intact:
            try:
                with closing(Pages(self.path)) as pages:
                    yield from self._from_pages(bag, pages)
                return
            except UnusualError:
                pass
        yield from self._by_sql(bag)

    def _from_pages(self, bag: sqlite3.Connection, pages: Pages) -> Iterator[Batch]:
        """The rows that are as recorders write them.

        Raises:
            UnusualError: Those that come next are not.
        """
        columns = [(row[1], row[5], row[6]) for row in bag.execute("PRAGMA table_xinfo(messages)")]
        # Names are not fetched: one that is damaged does no harm.
        where = "SELECT rootpage FROM sqlite_master WHERE rootpage > 0 AND name"
        ((root,),) = bag.execute(f"{where} = 'messages'").fetchall() or ((None,),)
        others = [page for (page,) in bag.execute(f"{where} <> 'messages'")]
        numbers = all(isinstance(number, int) for number in (*others, *self._topics))
        if columns != _PLAIN_COLUMNS or not numbers or not isinstance(root, int):
            raise UnusualError("its tables have another form")
        unwanted = [key for key, connection in self._topics.items() if not self._is_wanted(connection)]
        for rows in pages.rows(root, unwanted):
            known = np.unique(rows.topics)
            if int(rows.stamps_ns.min()) < 0 or not self._topics.keys() >= set(known.tolist()):
                raise UnusualError("a row is no message")
            senders = tuple(self._topics[key] for key in known.tolist())
            yield Batch(senders, np.searchsorted(known, rows.topics), rows.stamps_ns, rows.payloads)
            self._reached(int(rows.numbers[-1]))
        self._accounted = pages.all_accounted([1, *others])

    def _reached(self, row: int) -> None:
        self._row, self._readable, self._last = row, f"row {row}", row

    def _by_sql(self, bag: sqlite3.Connection) -> Iterator[_Item]:
        """The rows behind those that were given already."""
        wanted = ", ".join(str(key) for key, c in self._topics.items() if self._is_wanted(c))
        payload = (
            "data"
            if self._topics_wanted is None
            else f"CASE WHEN topic_id IN ({wanted}) THEN data ELSE x'' END"
        )
        behind = "" if self._last is None else f"WHERE rowid > {self._last}"
        cursor = bag.execute(
            f"SELECT rowid, topic_id, timestamp, {payload} FROM messages {behind} ORDER BY rowid"  # noqa: S608  # numbers
        )
        for rows in _fetched(cursor):
            batch = self._batch(rows)
            if batch is None:
                yield from self._one_by_one(rows)
            else:
                yield batch
            self._reached(rows.numbers[-1])

    def _is_wanted(self, connection: Connection) -> bool:
        return self._topics_wanted is None or connection.topic in self._topics_wanted

    def _batch(self, rows: _Rows) -> Batch | None:
        """Rows as a batch; `None` when something is wrong with one of them."""
        stamps_ns = rows.stamps_ns
        if set(map(type, rows.payloads)) != {bytes} or set(map(type, stamps_ns)) != {int}:
            return None
        known = {topic: place for place, topic in enumerate(dict.fromkeys(rows.topics))}
        if min(stamps_ns) < 0 or any(topic not in self._topics for topic in known):
            return None
        sources = np.fromiter(map(known.__getitem__, rows.topics), np.int64, len(rows.topics))
        senders = tuple(self._topics[topic] for topic in known)
        return Batch(senders, sources, np.array(stamps_ns, dtype=np.int64), Payloads.joined(rows.payloads))

    def _one_by_one(self, rows: _Rows) -> Iterator[Message]:
        for row, topic, stamp_ns, payload in rows.each():
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
    """What SQLite asks now and then: whether to stop, because no honest file of this size takes as long."""
    left = count(1 + (MAX_STEPS + STEPS_PER_BYTE * size) // _STEPS_AT_ONCE, -1)
    return lambda: next(left) <= 0


@dataclass
class _Rows:
    """Some rows of the table of messages, by column; what is in them has not been looked at."""

    numbers: list[int] = field(default_factory=list)
    topics: list[Any] = field(default_factory=list)
    stamps_ns: list[Any] = field(default_factory=list)
    payloads: list[Any] = field(default_factory=list)

    def add(self, rows: Sequence[tuple[int, Any, Any, Any]]) -> int:
        """Take some more; returns how large their payloads are."""
        numbers, topics, stamps_ns, payloads = zip(*rows, strict=True)
        self.numbers += numbers
        self.topics += topics
        self.stamps_ns += stamps_ns
        self.payloads += payloads
        try:
            return sum(map(len, payloads))
        except TypeError:
            return 0  # something that is no bytes, which is told later

    def each(self) -> Iterator[tuple[int, Any, Any, Any]]:
        """Row by row."""
        return zip(self.numbers, self.topics, self.stamps_ns, self.payloads, strict=True)


def _fetched(cursor: sqlite3.Cursor) -> Iterator[_Rows]:
    """The rows in portions of some MB; those before a damaged one come before the error."""
    rows, size, failure = _Rows(), 0, None
    some: list[tuple[int, Any, Any, Any]] = []
    try:
        while True:
            some = []
            some.extend(islice(cursor, _FEW_ROWS))
            if not some:
                break
            size += rows.add(some)
            if size > _BATCH_BYTES or len(rows.numbers) >= _BATCH_ROWS:
                yield rows
                rows, size = _Rows(), 0
    except (sqlite3.Error, OverflowError) as error:
        failure = error
        if some:
            rows.add(some)
    if rows.numbers:
        yield rows
    if failure is not None:
        raise failure


def _definitions(bag: sqlite3.Connection) -> dict[str, tuple[str, str]]:
    """Format and text of the embedded definitions by type; none before schema version 4."""
    found = bag.execute("SELECT type, sql FROM sqlite_master WHERE name = 'message_definitions'").fetchall()
    if [kind for kind, _ in found] != ["table"] or "VIRTUAL" in str(found[0][1]).upper():
        return {}
    rows = bag.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
    return {str(name): (str(encoding), str(text)) for name, encoding, text in rows if text}


def _damage(path: Path) -> str:
    """What the file's own header and its neighbours say against it; empty when nothing."""
    for suffix in ("-wal", "-journal"):
        beside = path.with_name(path.name + suffix)
        if beside.is_file() and beside.stat().st_size:
            return f"the recording was not closed: {beside.name} beside it holds changes that are not in it"
    size = path.stat().st_size
    with path.open("rb") as file:
        header = file.read(100)
    if len(header) < 100 or not header.startswith(MAGIC):
        return f"the file is not a whole SQLite file: {size} bytes, and its header is cut off or wrong"
    page = int.from_bytes(header[16:18], "big")
    page = 65536 if page == 1 else page
    # The page count is valid only when the two change counters agree.
    pages = int.from_bytes(header[28:32], "big") if header[24:28] == header[92:96] else 0
    if page and (size % page or size < pages * page):
        return (
            f"the file is cut off: {size} bytes are there, its header speaks of {pages} pages of {page} bytes"
        )
    return ""
