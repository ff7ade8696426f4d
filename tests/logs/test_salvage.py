"""Damaged and hostile recordings: refused with a place, never half read, never an accident."""

from __future__ import annotations

import gc
import hashlib
import importlib
import os
import random
import re
import sqlite3
import struct
import sys
import threading
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import lz4.frame
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis.strategies import binary, integers

from ariac_score.checks.contracts import Wanted
from ariac_score.errors import CutOffError, LogError, NothingToScoreError
from ariac_score.logs.containers import inflating
from ariac_score.logs.containers import sqlite as sqlite_bag
from ariac_score.logs.containers.inflating import LARGEST_INFLATED_BYTES, inflate, inflate_into
from ariac_score.logs.containers.items import Batch, normalised_type
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.source import Source
from ariac_score.logs.containers.sqlite import SqliteScan
from ariac_score.logs.rosbag import RosbagReader
from ariac_score.testing.bags import Recorded, write_bag
from ariac_score.trial.channels import Channel, FieldMap, LogMap

pytestmark = pytest.mark.slow  # files cut and changed at every place

READER = RosbagReader()
SNAPSHOT = "nist_gear/msg/Snapshot"
SPEED = FieldMap("speed/human", "m/s", ("human_operator_speed",))
WANTED = Wanted(LogMap("test", (Channel("/snapshot", SNAPSHOT, signals=(SPEED,)),)), frozenset({"speed"}))
MESSAGES = [
    Recorded("/snapshot", SNAPSHOT, 10**18 + i * 10**8, {"human_operator_speed": i / 10}) for i in range(60)
]
FORMATS = [("ros1", "t.bag", ""), ("ros1", "t.bag", "lz4"), ("ros1", "t.bag", "bz2")]
FORMATS += [("sqlite3", "t.db3", ""), ("mcap", "t.mcap", ""), ("mcap", "t.mcap", "zstd")]

every_format = pytest.mark.parametrize(("storage", "name", "compression"), FORMATS)


def refusal(path: Path) -> LogError:
    with pytest.raises(LogError) as error:
        READER.read(path, WANTED)
    assert type(error.value) in (LogError, CutOffError)
    assert error.value.hint
    assert READER.describe(path).damage
    return error.value


@every_format
def test_a_file_cut_off_anywhere_is_refused(
    tmp_path: Path, storage: Any, name: str, compression: str
) -> None:
    path = write_bag(tmp_path / name, MESSAGES, storage=storage, compression=compression)
    whole = path.read_bytes()
    assert len(READER.read(path, WANTED).signals["speed/human"]) == 60

    for size in [*range(0, len(whole), 97), *range(len(whole) - 12, len(whole))]:
        path.write_bytes(whole[:size])
        with pytest.raises(LogError):
            READER.read(path, WANTED)
        if size:
            assert READER.describe(path).damage


@every_format
def test_flipped_bytes_are_never_an_accident(
    tmp_path: Path, storage: Any, name: str, compression: str
) -> None:
    path = write_bag(tmp_path / name, MESSAGES[:5], storage=storage, compression=compression)
    whole = path.read_bytes()
    chance = random.Random(7)  # noqa: S311  # seeded, so that a failure comes again

    for _ in range(150):
        flipped = bytearray(whole)
        for _ in range(chance.choice((1, 1, 8))):
            flipped[chance.randrange(len(flipped))] = chance.choice((0, 255, chance.randrange(256)))
        path.write_bytes(flipped)
        for use in (READER.describe, lambda p: READER.read(p, WANTED)):
            _only_log_errors(use, path)


def _only_log_errors(use: Callable[[Path], object], path: Path) -> None:
    try:
        use(path)
    except LogError as error:
        assert str(error)  # noqa: PT017  # it may also succeed: not every byte is covered by a checksum


def test_what_is_readable_of_a_cut_file_is_told(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.db3", MESSAGES, storage="sqlite3")
    # rosbag2 writes one page after the other; without the last one the index is gone, the messages are there.
    path.write_bytes(path.read_bytes()[:-4096])

    error = refusal(path)

    assert re.search(r"readable up to row 60: 1 topics, 60 messages, 0\.00 s to 5\.90 s", error.cause)
    description = READER.describe(path)
    assert [(t.name, t.count, t.last_s, t.largest_gap_s) for t in description.topics] == [
        ("/snapshot", 60, 5.9, 0.1)
    ]


def test_a_recorder_that_was_killed_leaves_whole_chunks_that_are_told(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.mcap", MESSAGES, storage="mcap")
    (start, end), *_ = _mcap_records(path.read_bytes(), 0x06)
    path.write_bytes(path.read_bytes()[:end])

    error = refusal(path)

    assert start < end
    assert error.place.endswith(f"byte {end}")
    assert f"readable up to byte {end}: 1 topics, 60 messages, 0.00 s to 5.90 s" in error.cause


# MCAP.


def _mcap_records(content: bytes, wanted: int) -> Iterator[tuple[int, int]]:
    at = 8
    while at < len(content) - 8:
        op, length = struct.unpack_from("<BQ", content, at)
        if op == wanted:
            yield at, at + 9 + length
        at += 9 + length


@pytest.mark.parametrize("compression", ["", "zstd"])
def test_a_flipped_byte_in_a_chunk_fails_its_checksum(tmp_path: Path, compression: str) -> None:
    path = write_bag(tmp_path / "t.mcap", MESSAGES, storage="mcap", compression=compression)
    content = bytearray(path.read_bytes())
    ((start, end),) = _mcap_records(bytes(content), 0x06)
    content[end - 20] ^= 1
    path.write_bytes(content)

    error = refusal(path)

    assert "CRC" in error.cause
    assert error.place == f"chunk at byte {start}"


def unpackable(count: int) -> list[Recorded]:
    """Messages of a megabyte that can hardly be compressed."""
    dice = random.Random(5)  # noqa: S311  # of texts
    texts = [dice.randbytes(600_000).hex() for _ in range(count)]
    return [Recorded("/word", "std_msgs/msg/String", i, {"data": text}) for i, text in enumerate(texts)]


def mcap_record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def mcap_text(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def mcap_chunk(packed: bytes, size: int, compression: bytes = b"") -> bytes:
    """A chunk without a checksum."""
    head = struct.pack("<QQQI", 0, 0, size, 0) + mcap_text(compression)
    return mcap_record(6, head + struct.pack("<Q", len(packed)) + packed)


ONE_MESSAGE = (
    mcap_record(3, struct.pack("<H", 1) + mcap_text(b"std_msgs/msg/Empty") + mcap_text(b"ros2msg") + bytes(4))
    + mcap_record(4, struct.pack("<HH", 1, 1) + mcap_text(b"/a") + mcap_text(b"cdr") + bytes(4))
    + mcap_record(5, struct.pack("<HIQQ", 1, 0, 7, 7) + bytes(5))
)
MCAP_START = b"\x89MCAP0\r\n" + mcap_record(1, mcap_text(b"ros2") + bytes(4))
MCAP_END = mcap_record(15, bytes(4)) + mcap_record(2, bytes(20)) + b"\x89MCAP0\r\n"


def messages_of(path: Path, content: bytes, **how: Any) -> int:
    """How many messages are between start and end of an MCAP file."""
    path.write_bytes(MCAP_START + content + MCAP_END)
    return sum(len(item) for item in McapScan(path, **how) if isinstance(item, Batch))


@pytest.mark.parametrize("topics", [None, {"/a"}, {"/b"}])
@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_empty_chunks_are_chunks(tmp_path: Path, jobs: int, topics: Any) -> None:
    empty = mcap_chunk(lz4.frame.compress(b""), 0, b"lz4")
    first = mcap_chunk(ONE_MESSAGE, len(ONE_MESSAGE))
    path = tmp_path / "t.mcap"

    assert messages_of(path, empty + empty, jobs=jobs, topics=topics) == 0
    assert messages_of(path, mcap_chunk(b"", 0) + first + empty, jobs=jobs, topics=topics) == 1


@pytest.mark.parametrize("compression", [b"lz4", b"zstd"])
@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_nothing_is_no_frame(tmp_path: Path, jobs: int, compression: bytes) -> None:
    for size in (0, 1):
        with pytest.raises(LogError, match="ends early"):
            messages_of(tmp_path / "t.mcap", mcap_chunk(b"", size, compression), jobs=jobs)


@pytest.mark.parametrize("body", [b"", b"\1\0" + bytes(4)])
@pytest.mark.parametrize("topics", [None, {"/b"}])
def test_index_records_without_number_are_no_burden(tmp_path: Path, body: bytes, topics: Any) -> None:
    """Each was once added to all before: so many would have taken hours."""
    large = mcap_record(5, struct.pack("<HIQQ", 1, 0, 8, 8) + bytes(200_000))
    chunk = mcap_chunk(ONE_MESSAGE + large, len(ONE_MESSAGE) + len(large))

    assert messages_of(tmp_path / "t.mcap", chunk + mcap_record(7, body) * 400_000, topics=topics) == 2


@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_a_file_that_shrinks_while_it_is_read_is_refused(tmp_path: Path, jobs: int) -> None:
    path = write_bag(tmp_path / "t.mcap", unpackable(60), storage="mcap", compression="zstd")
    items = iter(McapScan(path, jobs=jobs))
    assert any(isinstance(item, Batch) for item in items)
    with path.open("r+b") as file:
        file.truncate(path.stat().st_size // 4)

    with pytest.raises(LogError, match=r"ends early|cut off"):
        deque(items, maxlen=0)


@pytest.mark.parametrize("name", ["preadv", "pread"])
def test_without_reading_at_a_place_it_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """As on Windows."""
    path = write_bag(tmp_path / "t.mcap", MESSAGES, storage="mcap", compression="zstd")
    expected = messages_in(path)
    monkeypatch.delattr(os, name, raising=False)

    assert messages_in(path) == expected
    assert len(expected) == len(MESSAGES)


needs_preadv = pytest.mark.skipif(not hasattr(os, "preadv"), reason="there is no reading at a place")


def messages_in(path: Path) -> list[tuple[int, bytes]]:
    batches = [item for item in McapScan(path, topics={"/snapshot"}) if isinstance(item, Batch)]
    return [(m.stamp_ns, bytes(m.payload)) for batch in batches for m in batch.messages()]


@needs_preadv
@pytest.mark.parametrize("failure", [OSError(5, "Input/output error"), MemoryError()])
@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_what_the_system_refuses_on_another_thread_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jobs: int, failure: Exception
) -> None:
    path = write_bag(tmp_path / "t.mcap", MESSAGES, storage="mcap", compression="zstd")

    def refused(*_: object) -> int:
        raise failure

    monkeypatch.setattr(os, "preadv", refused)
    with pytest.raises(LogError, match="it cannot be read"):
        READER.read(path, replace(WANTED, jobs=jobs))


@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_who_stops_early_leaves_no_thread_and_no_file_behind(tmp_path: Path, jobs: int) -> None:
    path = write_bag(tmp_path / "t.mcap", unpackable(60), storage="mcap", compression="zstd")
    threads, items = threading.active_count(), iter(McapScan(path, jobs=jobs))
    assert any(isinstance(item, Batch) for item in items)
    items.close()  # type: ignore[attr-defined]  # it is a generator

    assert threading.active_count() == threads
    assert not [file for file in gc.get_objects() if isinstance(file, Source) and not file._file.closed]


@needs_preadv
def test_a_read_may_come_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of more than two gigabytes, or from some file systems."""
    path = write_bag(tmp_path / "t.mcap", MESSAGES, storage="mcap", compression="zstd")
    expected, preadv = messages_in(path), os.preadv
    monkeypatch.setattr(os, "preadv", lambda file, rooms, at: preadv(file, [rooms[0][:7]], at))

    assert messages_in(path) == expected


@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_nothing_behind_a_damaged_chunk_is_given(tmp_path: Path, jobs: int) -> None:
    """Also where so much follows that other chunks are on their way already."""
    path = write_bag(tmp_path / "t.mcap", unpackable(24), storage="mcap", compression="zstd")
    content = bytearray(path.read_bytes())
    content[len(content) // 20] ^= 0xFF  # in the second chunk
    path.write_bytes(content)
    scan, stamps_ns = McapScan(path, jobs=jobs), list[int]()
    with pytest.raises(LogError, match="chunk at byte"):
        stamps_ns.extend(ns for item in scan if isinstance(item, Batch) for ns in item.stamps_ns.tolist())

    assert stamps_ns == [0]
    assert int(scan.readable.removeprefix("byte ")) < len(content) // 20


def test_a_flipped_byte_outside_chunks_fails_the_checksum_of_the_data_section(tmp_path: Path) -> None:
    header = _record(0x01, _text("ros2") + _text("test"))
    metadata = _record(0x0C, _text("weather") + struct.pack("<I", 0))
    data = b"\x89MCAP0\r\n" + header + metadata
    path = tmp_path / "t.mcap"

    for flip in (b"weather", b"leather"):
        content = data + _record(0x0F, struct.pack("<I", zlib.crc32(data))) + _record(0x02, bytes(20))
        path.write_bytes(content.replace(b"weather", flip) + b"\x89MCAP0\r\n")
        damage = READER.describe(path).damage
        assert ("CRC of the data section" in damage) is (flip == b"leather")


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()


def _record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def _mcap(*records: bytes) -> bytes:
    start = b"\x89MCAP0\r\n" + _record(0x01, _text("ros2") + _text("test"))
    end = _record(0x0F, bytes(4)) + _record(0x02, bytes(20)) + b"\x89MCAP0\r\n"
    return start + b"".join(records) + end


def _chunk(records: bytes, *, size: int | None = None, crc: int = 0, compression: str = "") -> bytes:
    head = struct.pack("<QQQI", 0, 0, len(records) if size is None else size, crc)
    return _record(0x06, head + _text(compression) + struct.pack("<Q", len(records)) + records)


CHANNEL = _record(0x04, struct.pack("<HH", 1, 0) + _text("/x") + _text("cdr") + struct.pack("<I", 0))
SCHEMA = _record(0x03, struct.pack("<H", 1) + _text("a/msg/A") + _text("ros2msg") + _text("int8 a"))
MESSAGE = _record(0x05, struct.pack("<HIQQ", 1, 0, 5, 5))


@pytest.mark.parametrize(
    ("records", "cause"),
    [
        ([MESSAGE], "channel 1, which is not declared"),
        ([CHANNEL, _record(0x05, bytes(5))], "22 bytes"),
        ([CHANNEL, _record(0x05, struct.pack("<HIQQ", 1, 0, 2**64 - 1, 5))], "is no log time"),
        ([CHANNEL.replace(b"/x", b"/y"), CHANNEL], "declared twice, differently"),
        (
            [CHANNEL.replace(struct.pack("<HH", 1, 0), struct.pack("<HH", 1, 9))],
            "schema 9, which is not declared",
        ),
        ([SCHEMA, SCHEMA.replace(b"int8 a", b"int8 b")], "schema 1 is declared twice, differently"),
        ([_record(0x00, b"")], "record type 0x00 cannot stand here"),
        ([_chunk(_chunk(b""))], "record 0x06"),
        ([_record(0x06, bytes(31))], "its head has 31 bytes"),
        ([_chunk(CHANNEL[:-1])], "cannot be there"),
        ([_record(0x06, bytes(28) + _text("lz4") + bytes(7))], "head is longer than its record"),
        ([_chunk(b"", size=10)], "holds 0 bytes instead of the announced 10"),
        ([_chunk(b"abc", compression="snappy")], "compression 'snappy' is not one of"),
        ([_chunk(b"abc", compression="lz4", size=2**60)], "more than the 1073741824 allowed"),
        ([_record(0x03, struct.pack("<HI", 1, 2**32 - 1))], "longer than its record"),
        ([CHANNEL, MESSAGE, _record(0x0B, struct.pack("<Q", 2))], "announce 2 messages, the file holds 1"),
    ],
)
def test_an_mcap_file_that_contradicts_itself_is_refused(
    tmp_path: Path, records: list[bytes], cause: str
) -> None:
    path = tmp_path / "t.mcap"
    path.write_bytes(_mcap(*records))

    assert cause in refusal(path).cause


def test_a_channel_whose_metadata_are_longer_than_its_record_is_refused(tmp_path: Path) -> None:
    """The library of the format reads on into the next record, and loses every message behind it."""
    path, whole = tmp_path / "t.mcap", _mcap(CHANNEL, MESSAGE)
    assert whole.count(CHANNEL) == 1
    assert CHANNEL.endswith(bytes(4)), "it has no metadata"

    path.write_bytes(whole.replace(CHANNEL, CHANNEL[:-4] + struct.pack("<I", 1)))

    assert "a text of 1 bytes is longer than its record" in refusal(path).cause


def test_data_whose_end_is_not_named_are_refused(tmp_path: Path) -> None:
    """With the record goes the checksum in it, which then nothing would be held against."""
    path, whole = tmp_path / "t.mcap", _mcap(CHANNEL, MESSAGE)
    end = _record(0x0F, bytes(4))

    for content in (whole.replace(end, b""), whole.replace(end, b"\x80" + end[1:])):
        path.write_bytes(content)
        with pytest.raises(LogError, match="no record says that the data end"):
            for _ in McapScan(path):
                pass


def test_a_length_word_beyond_the_end_of_the_file_is_refused_without_reading(tmp_path: Path) -> None:
    path = tmp_path / "t.mcap"
    path.write_bytes(_mcap(CHANNEL, struct.pack("<BQ", 0x09, 2**63)))

    assert "record 0x09 needs 9223372036854775808 bytes" in refusal(path).cause


def test_a_file_of_another_kind_called_mcap_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.mcap"
    path.write_bytes(b"\x89MCAP1\r\n" + bytes(100))

    assert "wrong magic" in refusal(path).cause
    assert refusal(path).place == "byte 0"


def test_bytes_after_the_end_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.mcap"
    path.write_bytes(_mcap() + b"more")

    assert "4 bytes follow" in refusal(path).cause


# ROS 1.


def test_a_bag_that_was_never_closed_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", MESSAGES, storage="ros1")
    content = path.read_bytes()
    field = content.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(content[:field] + bytes(8) + content[field + 8 :])

    error = refusal(path)

    assert "never closed" in error.cause
    assert "rosbag reindex" in error.cause
    assert "60 messages, 0.00 s to 5.90 s" in error.cause


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        (b"compression=none", b"compression=lzma", "compression 'lzma' is not one of"),
        (b"chunk_count=\x01", b"chunk_count=\x02", "2 chunks, the file holds 1 and 1"),
        (b"conn_count=\x01", b"conn_count=\x03", "announces 3 connections"),
        (b"#ROSBAG V2.0", b"#ROSBAG V1.2", "version 2.0"),
        (b"op=\x05", b"op=\x02", "field 'conn'"),
        (b"\x10\x00\x00\x00compression", b"\xff\xff\xff\xffcompression", "longer than it"),
    ],
)
def test_a_bag_that_contradicts_itself_is_refused(tmp_path: Path, old: bytes, new: bytes, cause: str) -> None:
    path = write_bag(tmp_path / "t.bag", MESSAGES, storage="ros1")
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new, 1))

    assert cause in refusal(path).cause


def test_an_encrypted_bag_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", MESSAGES, storage="ros1")
    content = path.read_bytes()
    (length,) = struct.unpack_from("<I", content, 13)
    field = b"encryptor=aes"
    header = content[17 : 17 + length] + struct.pack("<I", len(field)) + field
    path.write_bytes(content[:13] + struct.pack("<I", len(header)) + header + content[17 + length :])

    assert "encrypted" in refusal(path).cause


# SQLite.


def _changed(path: Path, *statements: str) -> Path:
    with closing(sqlite3.connect(path)) as bag:
        for statement in statements:
            bag.execute(statement)
        bag.commit()
    return path


@pytest.mark.parametrize(
    ("statement", "cause"),
    [
        ("DROP TABLE messages", "no table 'messages'"),
        ("ALTER TABLE topics RENAME COLUMN type TO kind", "table 'topics' lacks type"),
        (
            "UPDATE messages SET topic_id = 9 WHERE id = 31",
            "topic 9, which is not declared; readable up to row 30",
        ),
        ("UPDATE messages SET timestamp = -1 WHERE id = 31", "-1 is no log time"),
        ("UPDATE messages SET timestamp = 'noon' WHERE id = 31", "'noon' is no log time"),
        ("UPDATE messages SET data = 'text' WHERE id = 31", "a message holds no bytes"),
    ],
)
def test_a_database_that_is_no_whole_recording_is_refused(tmp_path: Path, statement: str, cause: str) -> None:
    path = _changed(write_bag(tmp_path / "t.db3", MESSAGES, storage="sqlite3"), statement)

    assert cause in refusal(path).cause


def test_a_view_in_place_of_the_messages_is_never_run(tmp_path: Path) -> None:
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, 1 AS topic_id,"
    path = write_bag(tmp_path / "t.db3", MESSAGES, storage="sqlite3")
    _changed(
        path, "DROP TABLE messages", f"CREATE VIEW messages AS {endless} i AS timestamp, x'' AS data FROM n"
    )

    assert "no table 'messages'" in refusal(path).cause


@pytest.mark.parametrize("suffix", ["-wal", "-journal"])
def test_a_journal_left_beside_a_database_is_refused(tmp_path: Path, suffix: str) -> None:
    path = write_bag(tmp_path / "t.db3", MESSAGES, storage="sqlite3")
    (tmp_path / f"t.db3{suffix}").write_bytes(b"changes")

    assert "was not closed" in refusal(path).cause


def test_a_page_of_zeros_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.db3", MESSAGES, storage="sqlite3")
    content = path.read_bytes()
    pages = range(4096, len(content), 4096)

    for page in pages:
        path.write_bytes(content[:page] + bytes(4096) + content[page + 4096 :])
        assert refusal(path).cause


def test_reading_leaves_nothing_beside_a_database(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.db3", MESSAGES, storage="sqlite3").rename(tmp_path / "t #1?%20.db3")

    READER.read(path, WANTED)

    assert list(tmp_path.iterdir()) == [path]


# Inflating.


def test_a_bomb_is_defused_at_the_announced_size() -> None:
    import bz2  # noqa: PLC0415  # only this test packs

    bomb = bz2.compress(bytes(50_000_000))

    assert len(bomb) < 1000
    with pytest.raises(ValueError, match="inflates to more than 1000 bytes"):
        inflate(bomb, "bz2", size=1000)
    with pytest.raises(ValueError, match="more than the"):
        inflate(bomb, "bz2", size=LARGEST_INFLATED_BYTES + 1)


@pytest.mark.parametrize("compression", ["bz2", "lz4", "zstd"])
@pytest.mark.parametrize("packed", [b"", b"no such thing at all", b"\0" * 40])
def test_what_is_no_compressed_data_is_refused(compression: str, packed: bytes) -> None:
    with pytest.raises(ValueError, match=compression):
        inflate(packed, compression, size=10)


@pytest.fixture(params=["cramjam", "without it"])
def engine(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """With what frames are inflated in place, and without."""
    if request.param == "cramjam":
        pytest.importorskip("cramjam")
    else:
        monkeypatch.setattr(inflating, "_cramjam", lambda: None)
    return str(request.param)


def _packers() -> dict[str, Callable[[bytes], bytes]]:
    zstd: Any = importlib.import_module(
        "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    )
    parameter = zstd.CompressionParameter
    return {
        "lz4": lz4.frame.compress,
        "lz4 with checksums": lambda b: lz4.frame.compress(b, content_checksum=True, block_checksum=True),
        "lz4 of small blocks": lambda b: lz4.frame.compress(b, block_size=4, block_linked=False),
        "lz4 without size": lambda b: lz4.frame.compress(b, store_size=False),
        "zstd": zstd.compress,
        "zstd with checksum": lambda b: zstd.compress(b, options={parameter.checksum_flag: 1}),
        "zstd without size": lambda b: zstd.compress(b, options={parameter.content_size_flag: 0}),
        "zstd at its best": lambda b: zstd.compress(b, level=19),
    }


_DATA = {
    "nothing": b"",
    "one byte": b"x",
    "as long as its size fits a byte": bytes(range(256)) + b"?" * 255,
    "repeats": b"ab" * 400_000,
    "one byte again and again": bytes(900_000),
    "noise": hashlib.shake_256(b"noise").digest(300_000),
}


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("data", _DATA.values(), ids=_DATA)
@pytest.mark.parametrize("packer", _packers())
def test_a_frame_inflates_into_room_of_its_size(packer: str, data: bytes) -> None:
    packed, room = _packers()[packer](data), bytearray(len(data))

    inflate_into(memoryview(room), packed, packer.split(maxsplit=1)[0])

    assert room == data


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("wrong", [-1, 1])
@pytest.mark.parametrize("packer", _packers())
def test_a_frame_of_another_size_than_announced_is_refused(packer: str, wrong: int) -> None:
    packed = _packers()[packer](_DATA["noise"])

    with pytest.raises(ValueError, match=r"instead of the announced|inflates to more than"):
        inflate_into(memoryview(bytearray(300_000 + wrong)), packed, packer.split(maxsplit=1)[0])


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("damage", ["cut by one byte", "cut in the middle", "one byte more", "two frames"])
@pytest.mark.parametrize("packer", _packers())
def test_what_is_not_one_whole_frame_is_refused(packer: str, damage: str) -> None:
    packed = _packers()[packer](_DATA["repeats"])
    damaged = {
        "cut by one byte": packed[:-1],
        "cut in the middle": packed[: len(packed) // 2],
        "one byte more": packed + b"?",
        "two frames": packed + packed,
    }[damage]

    with pytest.raises(ValueError, match=r"broken|ends early|bytes follow|instead of"):
        inflate_into(memoryview(bytearray(800_000)), damaged, packer.split(maxsplit=1)[0])


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("compression", ["lz4", "zstd"])
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])  # it says what there is, no more
@given(noise=binary(max_size=64), at=integers(0, 300))
def test_no_byte_of_a_frame_can_be_changed_into_a_crash(compression: str, noise: bytes, at: int) -> None:
    packed = bytearray(_packers()[compression](_DATA["repeats"][:2000]))
    packed[at % len(packed) : at % len(packed) + len(noise)] = noise
    room = bytearray(2000)

    with suppress(ValueError):
        inflate_into(memoryview(room), bytes(packed), compression)


def test_what_is_not_compressed_is_passed_on() -> None:
    assert inflate(b"abc", "", size=3) == inflate(b"abc", "none") == b"abc"


@pytest.mark.parametrize("name", ["a/msg/B", "a/srv/B_Event", "", "B"])
def test_only_two_part_types_are_respelt(name: str) -> None:
    assert normalised_type(name) == name


def test_an_empty_file_in_a_folder_is_damage_not_nothing(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t", MESSAGES, storage="mcap")
    (path / "t.mcap").write_bytes(b"")

    with pytest.raises(LogError, match=r"t\.mcap") as error:
        READER.read(path, WANTED)
    assert not isinstance(error.value, NothingToScoreError)


# SQLite bags with a program in their schema ----------------------------------------------


def _sqlite_bag(folder: Path, *statements: str, rows: int = 2000) -> Path:
    """A bag of one topic whose messages are empty, changed by a stranger."""
    path = folder / "log.db3"
    bag = sqlite3.connect(path)
    bag.execute(
        "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
    )
    bag.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
    )
    bag.execute("INSERT INTO topics VALUES (1, '/a', 'std_msgs/msg/String', 'cdr')")
    bag.executemany("INSERT INTO messages VALUES (?, 1, ?, x'00')", ((i, i) for i in range(1, rows)))
    for statement in statements:
        bag.execute(statement)
    bag.commit()
    bag.close()
    return path


_FOR_SQLITE = "ALTER TABLE messages ADD COLUMN more TEXT"
"""What makes a table so unusual that SQLite reads and checks it."""


def _messages_in(path: Path) -> int:
    return sum(len(item) if isinstance(item, Batch) else 1 for item in SqliteScan(path)) - 1


def test_a_plain_sqlite_bag_with_a_plain_index_is_read(tmp_path: Path) -> None:
    path = _sqlite_bag(tmp_path, "CREATE INDEX timestamp_idx ON messages (timestamp ASC)")

    assert _messages_in(path) == 1999


def test_an_index_of_computed_values_is_refused(tmp_path: Path) -> None:
    path = _sqlite_bag(tmp_path, "CREATE INDEX i ON messages (hex(zeroblob(1000)))")

    with pytest.raises(LogError, match="an index of computed values"):
        _messages_in(path)


def test_checks_of_its_own_are_not_computed(tmp_path: Path) -> None:
    path = _sqlite_bag(
        tmp_path,
        "CREATE TABLE more(a INTEGER CHECK (length(hex(zeroblob(1 + a * 200000000))) > 0))",
        "INSERT INTO more VALUES (0)",
        "PRAGMA ignore_check_constraints = ON",
        "INSERT INTO more VALUES (4)",
        _FOR_SQLITE,
    )

    assert _messages_in(path) == 1999


@pytest.mark.parametrize("name", ["messages", "topics", "message_definitions"])
def test_a_view_or_a_trigger_of_that_name_runs_nothing(tmp_path: Path, name: str) -> None:
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i FROM n"
    changes = [f"ALTER TABLE {name} RENAME TO kept"] if name != "message_definitions" else []
    path = _sqlite_bag(tmp_path, *changes, f"CREATE VIEW {name} AS {endless}")

    if changes:
        with pytest.raises(LogError, match="is not a ROS 2 bag"):
            _messages_in(path)
    else:
        assert _messages_in(path) == 1999


def test_more_steps_than_any_honest_file_needs_end_the_reading(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = _sqlite_bag(tmp_path, _FOR_SQLITE, rows=20_000)
    assert _messages_in(path) == 19_999

    monkeypatch.setattr(sqlite_bag, "MAX_STEPS", 0)
    assert _messages_in(path) == 19_999  # a file may take the more steps the larger it is
    monkeypatch.setattr(sqlite_bag, "STEPS_PER_BYTE", 0)
    with pytest.raises(LogError, match="interrupted"):
        _messages_in(path)


def test_a_sqlite_bag_of_more_than_two_gigabytes_is_read(tmp_path: Path) -> None:
    """SQLite takes no larger limit; the bytes behind the pages that its header counts are a hole."""
    path = write_bag(tmp_path / "t.db3", MESSAGES, storage="sqlite3")
    with path.open("r+b") as file:
        file.truncate((1 << 31) + 4096)

    found = READER.describe(path)

    assert [(topic.name, topic.count) for topic in found.topics] == [("/snapshot", 60)]
    assert not found.damage
