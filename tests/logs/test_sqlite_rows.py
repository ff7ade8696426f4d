"""Rows of SQLite files, compared with a plain `SELECT`: of many forms, changed and damaged."""

from __future__ import annotations

import random
import sqlite3
from collections.abc import Container, Iterable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ariac_score.errors import LogError
from ariac_score.logs.containers.items import Batch, Message
from ariac_score.logs.containers.sqlite import SqliteScan

Row = tuple[int | None, int, Any, Any]
"""Number, topic, time, payload."""

TOPICS = {1: "/x", 2: "/picture", 300: "/y"}
COLUMNS = "id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, data BLOB NOT NULL"


def bag(path: Path, rows: Iterable[Row], *statements: str, page: int = 512, columns: str = COLUMNS) -> Path:
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path, isolation_level=None)) as db:
        db.execute(f"PRAGMA page_size={page}")
        for statement in statements:
            if statement.startswith("PRAGMA"):
                db.execute(statement)
        db.execute("BEGIN")
        db.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT)")
        db.execute(f"CREATE TABLE messages({columns})")
        db.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        db.executemany("INSERT INTO topics VALUES (?, ?, 'a/msg/B')", TOPICS.items())
        db.executemany("INSERT INTO messages(id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", rows)
        for statement in statements:
            if not statement.startswith(("PRAGMA", "VACUUM")):
                db.execute(statement)
        db.execute("COMMIT")
        if "VACUUM" in statements:
            db.execute("VACUUM")
    return path


Found = list[tuple[str, int, bytes]]


def found_in(path: Path, topics: Container[str] | None = None) -> tuple[Found, SqliteScan]:
    """All messages of a bag by topic, time and payload, and the scan that read them."""
    scan = SqliteScan(path, topics=topics)
    found: Found = []
    for item in scan:
        messages: Iterable[Message] = item.messages() if isinstance(item, Batch) else ()
        if isinstance(item, Message):
            messages = [item]
        found += [(m.connection.topic, m.stamp_ns, bytes(m.payload)) for m in messages]
    return found, scan


def selected(path: Path) -> Found | None:
    """What SQLite reads without checking more than it needs."""
    query = "SELECT topic_id, timestamp, data FROM messages ORDER BY rowid"
    try:
        with closing(sqlite3.connect(f"{path.as_uri()}?mode=ro&immutable=1", uri=True)) as db:
            db.execute("PRAGMA writable_schema=ON")  # as the scan, which thereby reads more
            topics = dict(db.execute("SELECT id, name FROM topics"))
            return [(topics[topic], stamp, data) for topic, stamp, data in db.execute(query)]
    except sqlite3.Error:
        return None


def some_rows(seed: int, count: int, page: int) -> list[Row]:
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets
    most, least = page - 35, (page - 12) * 32 // 255 - 23
    # Around what fits on a page, and around what a chain of pages holds.
    sizes = [0, 1, 50, 61, 62, *range(most - 16, most), least, page, 3 * (page - 4) + least, 20 * page]
    number, rows = dice.choice([0, 0, 1000, 2**31]), list[Row]()
    for _ in range(count):
        number += dice.choice([1, 1, 1, 1, 2, 300])
        stamp = dice.choice([0, 1, 127, 128, 2**15, 2**23, 2**31, 2**47, 2**62, 10**18 + number])
        size = dice.choice(sizes) if dice.random() < 0.4 else dice.randint(0, 90)
        rows.append((number, dice.choice([1, 1, 2, 300]), stamp, dice.randbytes(size)))
    return rows


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.integers(0, 2**32), st.integers(1, 150), st.sampled_from([512, 1024, 4096]))
def test_random_bags_are_read_as_they_were_written(tmp_path: Path, seed: int, count: int, page: int) -> None:
    rows = some_rows(seed, count, page)
    path = bag(tmp_path / "t.db3", rows, page=page)
    everything, scan = found_in(path)
    some, _ = found_in(path, ["/x"])

    assert everything == [(TOPICS[topic], stamp, data) for _, topic, stamp, data in rows]
    assert some == [(t, s, p if t == "/x" else b"") for t, s, p in everything]
    assert scan.readable == f"row {rows[-1][0]}"


PLAIN = [(i, 1 + i % 2, 10**18 + i, b"%06d" % i * (i % 30)) for i in range(1, 60)]
UNUSUAL: dict[str, tuple[str, ...]] = {
    "rows taken out": ("DELETE FROM messages WHERE id % 7 = 0",),
    "a page freed": ("DELETE FROM messages WHERE id > 20",),
    "a row made longer": ("UPDATE messages SET data = zeroblob(3000) WHERE id = 30",),
    "rows put between": (
        "DELETE FROM messages WHERE id = 30",
        "INSERT INTO messages VALUES (30, 1, 7, x'00')",
    ),
    "a negative row": ("INSERT INTO messages VALUES (-5, 1, 7, x'00')",),
    "the largest row": ("INSERT INTO messages VALUES (9223372036854775807, 1, 7, x'00')",),
    "a table beside": ("CREATE TABLE t(x)", "INSERT INTO t VALUES (zeroblob(5000))"),
    "an index on the bytes": ("CREATE INDEX i ON messages (data)",),
    "a column more": ("ALTER TABLE messages ADD COLUMN more TEXT",),
    "cleaned up": ("DELETE FROM messages WHERE id % 7 = 0", "VACUUM"),
    "cleaned up by itself": ("PRAGMA auto_vacuum=FULL",),
    "with a log": ("PRAGMA journal_mode=WAL",),
    "empty": ("DELETE FROM messages",),
    "wide characters": ("PRAGMA encoding='UTF-16'",),
}


@pytest.mark.parametrize("unusual", UNUSUAL)
def test_what_recorders_do_not_write_is_read_as_sqlite_reads_it(unusual: str, tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", PLAIN, *UNUSUAL[unusual])
    expected = selected(path)

    assert expected is not None
    assert found_in(path)[0] == expected
    assert found_in(path, ["/picture"])[0] == [(t, s, p if t == "/picture" else b"") for t, s, p in expected]


@pytest.mark.parametrize(
    "columns",
    [
        "id INTEGER PRIMARY KEY, timestamp INTEGER, topic_id INTEGER, data BLOB",
        "id INT PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB",
        "id INTEGER PRIMARY KEY DESC, topic_id INTEGER, timestamp INTEGER, data BLOB",
        "id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB",
        "id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB, more INTEGER DEFAULT 3",
        "id INTEGER PRIMARY KEY, topic_id, timestamp, data",
        "id INTEGER PRIMARY KEY AUTOINCREMENT, topic_id INTEGER, timestamp INTEGER, data BLOB",
    ],
)
def test_tables_of_other_forms_are_read_as_sqlite_reads_them(columns: str, tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", PLAIN, columns=columns)

    assert found_in(path)[0] == [(TOPICS[topic], stamp, data) for _, topic, stamp, data in PLAIN]


@pytest.mark.parametrize(
    "change",
    [
        "topic_id = 77",
        "topic_id = NULL",
        "topic_id = 'x'",
        "timestamp = -1",
        "timestamp = 1.5",
        "timestamp = x'00'",
        "data = NULL",
        "data = 7",
        "data = 'text'",
    ],
)
def test_a_row_that_is_no_message_is_refused_behind_those_before_it(change: str, tmp_path: Path) -> None:
    columns = "id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB"
    changed = f"UPDATE messages SET {change} WHERE id = 40"  # noqa: S608  # ours
    path = bag(tmp_path / "t.db3", PLAIN, changed, columns=columns)
    scan = SqliteScan(path)
    with pytest.raises(LogError) as error:
        list(scan)

    assert "row 40" in str(error.value.place)
    assert scan.readable == "row 39"


def test_a_without_rowid_table_is_left_to_sqlite(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", [])
    with closing(sqlite3.connect(path)) as db:
        db.execute("DROP TABLE messages")
        db.execute(f"CREATE TABLE messages({COLUMNS}) WITHOUT ROWID")
        db.commit()

    with pytest.raises(LogError, match="rowid"):
        found_in(path)


@pytest.mark.slow
@pytest.mark.parametrize("flip", [0x01, 0x80, 0xFF])
def test_whatever_byte_is_changed_nothing_is_made_up(flip: int, tmp_path: Path) -> None:
    """A byte of a payload may be another one, in both; no row may be lost, moved or made up in silence."""
    rows = [(i, 1 + i % 2, 10**18 + i, b"%03d" % i * (i % 8)) for i in range(1, 40)]
    rows.append((40, 1, 10**18, b"z" * 1200))
    path = bag(tmp_path / "t.db3", rows)
    whole = path.read_bytes()
    taken = 0
    for at in range(flip % 13, len(whole), 13):
        changed = bytearray(whole)
        changed[at] ^= flip
        path.write_bytes(changed)
        try:
            found, _ = found_in(path)
        except LogError:
            continue
        taken += 1
        assert found == selected(path), at
    assert taken > len(whole) // 130


def test_two_pages_that_swapped_places_are_not_read_as_if_nothing_was(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", PLAIN)
    whole = path.read_bytes()
    leaves = [at for at in range(512, len(whole), 512) if whole[at] == 13]
    first, second = leaves[-3], leaves[-2]
    changed = bytearray(whole)
    changed[first : first + 512], changed[second : second + 512] = (
        whole[second : second + 512],
        whole[first : first + 512],
    )
    path.write_bytes(changed)

    with pytest.raises(LogError):
        found_in(path)


def test_a_chain_of_pages_that_bites_its_tail_ends(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", [(1, 1, 5, b"z" * 5000)])
    whole = bytearray(path.read_bytes())
    links = [at for at in range(0, len(whole), 512) if whole[at + 4 : at + 8] == b"zzzz"]
    whole[links[3] : links[3] + 4] = whole[links[1] : links[1] + 4]
    path.write_bytes(whole)

    with pytest.raises(LogError):
        found_in(path)


def test_a_page_that_belongs_to_nothing_is_damage(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", PLAIN)
    whole = bytearray(path.read_bytes())
    whole[28:32] = (int.from_bytes(whole[28:32], "big") + 1).to_bytes(4, "big")
    path.write_bytes(whole + bytes(512))

    with pytest.raises(LogError, match="never used"):
        found_in(path)


@pytest.mark.parametrize("topics", [None, ["/x"]])
def test_damage_of_an_index_is_refused_whoever_reads(topics: list[str] | None, tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", PLAIN)
    whole = bytearray(path.read_bytes())
    leaf = next(at for at in range(512, len(whole), 512) if whole[at] == 10)  # of the index of times
    whole[leaf + 5 : leaf + 7] = b"\xff\xff"  # where its entries start
    path.write_bytes(whole)

    with pytest.raises(LogError, match="damaged"):
        found_in(path, topics)


def test_the_number_of_a_topic_is_never_taken_for_sql(tmp_path: Path) -> None:
    key = "1) THEN data ELSE (SELECT name FROM topics) END FROM messages --"
    path = bag(tmp_path / "t.db3", PLAIN[:1])
    with closing(sqlite3.connect(path)) as db:
        db.execute("DROP TABLE topics")
        db.execute("CREATE TABLE topics(id TEXT, name TEXT, type TEXT)")
        db.execute("INSERT INTO topics VALUES (?, '/x', 'a/msg/B')", (key,))
        db.commit()

    with pytest.raises(LogError, match="topic 2, which is not declared"):
        found_in(path, ["/x"])


def test_a_column_that_hides_the_order_of_the_rows_is_refused(tmp_path: Path) -> None:
    columns = "id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB, RowID TEXT"
    path = bag(tmp_path / "t.db3", PLAIN, "UPDATE messages SET RowID = 'x'", columns=columns)

    with pytest.raises(LogError, match="hides the order of its rows"):
        found_in(path)
