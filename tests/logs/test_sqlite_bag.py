"""SQLite files of ROS 2 bags: cut anywhere, of rare forms, and read without leaving a trace."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from ariac_score.errors import LogError
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.logs.containers import sqlite as module
from ariac_score.logs.containers.items import Batch
from ariac_score.logs.containers.sqlite import SqliteScan
from ariac_score.logs.gather.wanted_fields import read_tables

TYPE = "std_msgs/msg/Float64"


def bag(path: Path, values: list[float], *, page: int = 512, picture: bytes = b"") -> Path:
    """As rosbag2 of Foxy wrote them: no definitions, an index on the time alone."""
    store = bundled_typestore(2)
    with closing(sqlite3.connect(path)) as db:
        db.execute(f"PRAGMA page_size={page}")
        db.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
        )
        db.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        db.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
        db.execute("INSERT INTO topics VALUES (1, '/x', ?, 'cdr'), (2, '/picture', ?, 'cdr')", (TYPE, TYPE))
        for i, value in enumerate(values):
            payload = bytes(store.serialize_cdr(store.types[TYPE](value), TYPE))
            db.execute(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (10**18 + i, payload)
            )
            if picture:
                db.execute(
                    "INSERT INTO messages(topic_id, timestamp, data) VALUES (2, ?, ?)", (10**18 + i, picture)
                )
        db.commit()
    return path


def values(path: Path) -> list[float]:
    (table,) = read_tables(path, {"/x": None})
    found: list[float] = table.columns["data"].values.tolist()
    return found


@pytest.mark.slow
def test_cut_anywhere_it_is_refused_and_never_half_read(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", [1.5, 2.5, -4.0])
    whole = path.read_bytes()
    assert (len(list(SqliteScan(path))), len(whole)) == (3, 2048)
    for size in range(1, len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(LogError):
            list(SqliteScan(path))


@pytest.mark.parametrize("bytes_more", [-512, 1])
def test_pages_that_are_missing_or_not_whole_are_told(tmp_path: Path, bytes_more: int) -> None:
    # SQLite itself does not mind bytes behind the last page.
    path = bag(tmp_path / "t.db3", [1.5, 2.5])
    whole = path.read_bytes()
    pages = len(whole) // 512
    path.write_bytes((whole + b"\0")[: len(whole) + bytes_more])

    with pytest.raises(LogError, match=f"the file is cut off: .* speaks of {pages} pages of 512 bytes"):
        list(SqliteScan(path))


def test_any_changed_byte_gives_numbers_of_this_length_or_an_error(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", [1.5, 2.5, -4.0])
    whole = path.read_bytes()
    for at in range(0, len(whole), 17):
        changed = bytearray(whole)
        changed[at] ^= 0xFF
        path.write_bytes(changed)
        try:
            tables = read_tables(path, {"/x": None})
        except LogError:
            continue
        assert sum(len(t.stamps_ns) + t.defects for t in tables) <= 3


def test_reading_leaves_nothing_beside_the_file(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", [1.0])
    before = path.read_bytes()
    values(path)

    assert [p.name for p in tmp_path.iterdir()] == ["t.db3"]
    assert path.read_bytes() == before


def test_pictures_that_nobody_wants_are_empty_and_counted(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", [1.0, 2.0], picture=b"\0" * 100_000)
    batches = [item for item in SqliteScan(path, topics={"/x"}) if isinstance(item, Batch)]
    sizes = [
        len(m.payload) for batch in batches for m in batch.messages() if m.connection.topic == "/picture"
    ]

    assert sizes == [0, 0]
    assert sum(map(len, batches)) == 4
    assert values(path) == [1.0, 2.0]


def test_many_rows_come_in_portions_and_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = np.arange(9000) / 4
    path = bag(tmp_path / "t.db3", numbers.tolist(), page=4096)

    assert values(path) == numbers.tolist()
    assert portions(path) == [8192, 808]
    monkeypatch.setattr(module, "_BATCH_BYTES", 120)  # ten messages of 12 bytes reach it, and one exceeds it
    assert portions(path) == [11] * 818 + [2]


def portions(path: Path) -> list[int]:
    return [len(item) for item in SqliteScan(path) if isinstance(item, Batch)]


def test_a_larger_file_may_take_more_steps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = np.arange(2000) / 4
    path = bag(tmp_path / "t.db3", numbers.tolist(), page=4096)
    with closing(sqlite3.connect(path)) as db:
        db.execute("ALTER TABLE messages ADD COLUMN more TEXT")  # so unusual that SQLite reads the rows
        db.commit()
    monkeypatch.setattr(module, "_STEPS_AT_ONCE", 1000)
    monkeypatch.setattr(module, "MAX_STEPS", 0)

    assert values(path) == numbers.tolist()
    monkeypatch.setattr(module, "STEPS_PER_BYTE", 0)
    with pytest.raises(LogError, match="interrupted"):
        values(path)


@pytest.mark.skipif(not hasattr(sqlite3.Connection, "setlimit"), reason="from Python 3.11 on")
def test_a_row_that_is_said_to_be_longer_than_its_file_is_refused_before_it_is_read(tmp_path: Path) -> None:
    size, said = 2_200_000, 134_000_000
    path = bag(tmp_path / "t.db3", [], page=4096, picture=b"")
    with closing(sqlite3.connect(path)) as db:
        db.execute(
            "INSERT INTO messages(topic_id, timestamp, data) VALUES (1, 1000000000, ?)", (bytes(size),)
        )
        db.commit()
    content = path.read_bytes()
    # A record has its length and, in its header, the type of each column: 12 + 2 n for n bytes.
    header = content.index(_varint(12 + 2 * size))
    (rest,) = [n for n in range(100) if _varint(size + n) in content[header - 20 : header]]
    changed = content.replace(_varint(12 + 2 * size), _varint(12 + 2 * said))
    path.write_bytes(changed.replace(_varint(size + rest), _varint(said + rest)))

    with pytest.raises(LogError, match="too big"):
        list(SqliteScan(path))


def _varint(number: int) -> bytes:
    """A number of 22 to 28 bits as SQLite stores it: 7 bits in each byte, the highest first."""
    return bytes([number >> shift & 127 | (128 if shift else 0) for shift in (21, 14, 7, 0)])


def test_few_messages_among_pictures_are_copied_whatever_their_order_in_the_file(tmp_path: Path) -> None:
    numbers = [float(i) for i in range(100)]
    path = bag(tmp_path / "t.db3", numbers, page=65536, picture=b"\0" * 20_000)

    assert values(path) == numbers
    path = bag(tmp_path / "u.db3", numbers, page=32768, picture=b"\0" * 9_000)
    assert values(path) == numbers


def test_a_row_that_is_no_message_is_refused_behind_those_before_it(tmp_path: Path) -> None:
    path = bag(tmp_path / "t.db3", [1.0, 2.0])
    with closing(sqlite3.connect(path)) as db:
        db.execute("UPDATE messages SET data = 7 WHERE id = 2")
        db.commit()

    with pytest.raises(LogError, match="holds no bytes"):
        values(path)
    scan = SqliteScan(path)
    with pytest.raises(LogError):
        list(scan)
    assert scan.readable == "row 1"
