"""Indexes of chunks: taken where they agree with the records, otherwise counted and passed over."""

from __future__ import annotations

import random
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from ariac_score.checks.contracts import Wanted
from ariac_score.errors import LogError
from ariac_score.logs.containers.items import Batch, Connection
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.ros1 import Ros1Scan
from ariac_score.logs.rosbag import RosbagReader
from ariac_score.testing.bags import Recorded, write_bag
from ariac_score.trial.channels import Channel, FieldMap, LogMap
from ariac_score.trial.model import Trial

pytestmark = pytest.mark.slow  # files cut and changed at every place

STRING, VECTOR = "std_msgs/msg/String", "geometry_msgs/msg/Vector3"
CHANNEL = Channel("/speed", VECTOR, signals=(FieldMap("speed/human", "m/s", ("x",)),))
WANTED = Wanted(LogMap("test", (CHANNEL,)), frozenset({"speed"}))
MESSAGES = [
    Recorded("/speed", VECTOR, 10**18 + i * 10**8, {"x": i / 8})
    if i % 3
    else Recorded("/word", STRING, 10**18 + i * 10**8, {"data": "x" * i})
    for i in range(30)
]
FORMATS = [
    ("mcap", "t.mcap", ""),
    ("mcap", "t.mcap", "zstd"),
    ("ros1", "t.bag", ""),
    ("ros1", "t.bag", "lz4"),
]
every_format = pytest.mark.parametrize(("storage", "name", "compression"), FORMATS)
Change = Callable[[bytearray, int, int], None]


def index_records(storage: str, content: bytes) -> Iterator[tuple[int, int]]:
    """Where the entries of each index record are, in a file that is whole."""
    at = 8 if storage == "mcap" else 13
    while at < len(content) - 8:
        if storage == "mcap":
            op, length = struct.unpack_from("<BQ", content, at)
            if op == 7:
                yield at + 15, at + 9 + length
            at += 9 + length
        else:
            (size,) = struct.unpack_from("<I", content, at)
            head = content[at + 4 : at + 4 + size]
            (length,) = struct.unpack_from("<I", content, at + 4 + size)
            start = at + 8 + size
            if b"op=\x04" in head:
                yield start, start + length
            at = start + length


def an_offset_is_wrong(content: bytearray, start: int, end: int) -> None:
    content[end - 8] ^= 1  # of the last entry; in a ROS 1 bag these are the nanoseconds


def a_time_is_wrong(content: bytearray, start: int, end: int) -> None:
    content[start] ^= 1


def it_is_all_ones(content: bytearray, start: int, end: int) -> None:
    content[start:end] = b"\xff" * (end - start)


def an_entry_stands_twice(content: bytearray, start: int, end: int) -> None:
    size = 16 if (end - start) % 16 == 0 else 12
    content[start : start + size] = content[start + size : start + 2 * size]


CHANGES = [an_offset_is_wrong, a_time_is_wrong, it_is_all_ones, an_entry_stands_twice]


def read(path: Path) -> Trial:
    return RosbagReader().read(path, WANTED)


def figures(trial: Trial) -> Any:
    return {n: (s.t.tolist(), s.values.tolist()) for n, s in trial.signals.items()}, trial.recorded


@every_format
def test_a_sound_index_is_taken_and_says_nothing(
    tmp_path: Path, storage: Any, name: str, compression: str
) -> None:
    path = write_bag(tmp_path / name, MESSAGES, storage=storage, compression=compression)
    scan = McapScan(path) if storage == "mcap" else Ros1Scan(path)
    items = list(scan)

    assert [len(i) if isinstance(i, Batch) else 1 for i in items if not isinstance(i, Connection)] != [1] * 30
    assert sum(len(i) for i in items if isinstance(i, Batch)) == 30
    assert scan.index_contradictions == 0
    assert read(path).log_defects == ()


@every_format
@pytest.mark.parametrize(
    "change", [an_offset_is_wrong, a_time_is_wrong, it_is_all_ones, an_entry_stands_twice]
)
def test_an_index_that_contradicts_the_records_is_passed_over_and_counted(
    tmp_path: Path, storage: Any, name: str, compression: str, change: Change
) -> None:
    path = write_bag(tmp_path / name, MESSAGES, storage=storage, compression=compression)
    expected = figures(read(path))
    content = bytearray(path.read_bytes())
    start, end = next(index_records(storage, bytes(content)))
    change(content, start, end)
    path.write_bytes(content)

    trial = read(path)

    assert figures(trial) == expected
    (defect,) = trial.log_defects
    assert (defect.kind, defect.count) == ("contradicting_index", 1)
    assert defect in RosbagReader().describe(path).defects


@every_format
def test_cut_at_every_byte_it_is_refused_and_never_half_read(
    tmp_path: Path, storage: Any, name: str, compression: str
) -> None:
    path = write_bag(tmp_path / name, MESSAGES[:2], storage=storage, compression=compression)
    whole = path.read_bytes()
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(LogError):
            read(path)


@pytest.mark.parametrize("storage", ["mcap", "ros1"])
def test_any_changed_byte_gives_the_same_numbers_or_an_error_or_a_defect(
    tmp_path: Path, storage: Any
) -> None:
    """Where nothing is compressed and no checksum covers it, a number itself may be another."""
    path = write_bag(tmp_path / f"t.{'mcap' if storage == 'mcap' else 'bag'}", MESSAGES[:6], storage=storage)
    whole = path.read_bytes()
    for at in range(0, len(whole), 5):
        changed = bytearray(whole)
        changed[at] ^= 0xFF
        path.write_bytes(changed)
        try:
            trial = read(path)
        except LogError:
            continue
        assert all(len(signal) <= 6 for signal in trial.signals.values())


LARGE = [
    Recorded("/speed", VECTOR, 10**18 + i * 10**8, {"x": i / 8})
    if i % 3
    else Recorded("/picture", STRING, 10**18 + i * 10**8, {"data": "x" * 150_000})
    for i in range(90)
]


def marked(path: Path) -> bytearray:
    """The content of a file, a byte of its last picture changed."""
    content = bytearray(path.read_bytes())
    content[content.rindex(b"x" * 64)] ^= 1
    return content


def test_pictures_that_nobody_wants_are_not_looked_at(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.mcap", LARGE, storage="mcap")
    expected = figures(read(path))
    path.write_bytes(marked(path))

    assert figures(read(path)) == expected
    with pytest.raises(LogError, match="CRC"):
        list(McapScan(path))
    assert "CRC" in RosbagReader().describe(path).damage


def test_messages_that_were_left_out_are_empty_and_counted(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.mcap", LARGE, storage="mcap")
    items = [item for item in McapScan(path, topics={"/speed"}) if isinstance(item, Batch)]
    sizes = [len(m.payload) for item in items for m in item.messages() if m.connection.topic == "/picture"]

    assert sizes[-3:] == [0, 0, 0]
    assert sum(map(len, items)) == len(LARGE)


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("which", [-1, -2])
def test_what_was_left_out_is_read_where_the_index_is_wrong(
    tmp_path: Path, change: Change, which: int
) -> None:
    path = write_bag(tmp_path / "t.mcap", LARGE, storage="mcap")
    expected = figures(read(path))
    content = bytearray(path.read_bytes())
    change(content, *list(index_records("mcap", bytes(content)))[which])
    path.write_bytes(content)

    trial = read(path)

    assert figures(trial) == expected
    assert [(d.kind, d.count) for d in trial.log_defects] == [("contradicting_index", 1)]


def test_what_is_read_after_all_is_verified(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.mcap", LARGE, storage="mcap")
    content = marked(path)
    an_offset_is_wrong(content, *list(index_records("mcap", bytes(content)))[-1])
    path.write_bytes(content)

    with pytest.raises(LogError, match="CRC"):
        read(path)


def test_a_chunk_without_a_wanted_message_is_not_inflated(tmp_path: Path) -> None:
    dice = random.Random(5)  # noqa: S311  # of pictures
    pictures = [
        Recorded("/picture", STRING, 10**18 + 10**14 + i, {"data": dice.randbytes(400_000).hex()})
        for i in range(6)
    ]
    path = write_bag(tmp_path / "t.mcap", [*LARGE, *pictures], storage="mcap", compression="zstd")
    expected, content = figures(read(path)), path.read_bytes()
    # The last chunk holds pictures alone.
    chunks = [at for op, at in records_of(content) if op == 6]
    path.write_bytes(content[: chunks[-1] + 200] + b"\0" * 64 + content[chunks[-1] + 264 :])

    assert len(chunks) > 2
    assert figures(read(path)) == expected
    with pytest.raises(LogError):
        list(McapScan(path))


def chunks_apart(count: int) -> list[Recorded]:
    """A chunk of both topics, chunks of pictures, chunks of as many speeds."""
    dice = random.Random(5)  # noqa: S311  # of pictures
    pictures = [
        Recorded("/picture", STRING, 10**18 + 10**14 + i, {"data": dice.randbytes(400_000).hex()})
        for i in range(4)
    ]
    speeds = [
        Recorded("/speed", VECTOR, 10**18 + 2 * 10**14 + i * 10**6, {"x": float(i)}) for i in range(count)
    ]
    return [*LARGE[:6], *pictures, *speeds]


def it_names_the_other_channel(content: bytearray, start: int, end: int) -> None:
    content[start - 6] ^= 3


def a_time_is_earlier_than_all(content: bytearray, start: int, end: int) -> None:
    content[start : start + 8] = bytes(8)


def a_time_is_later_than_all(content: bytearray, start: int, end: int) -> None:
    content[end - 9] = 0x7F


@pytest.mark.parametrize(
    "change",
    [*CHANGES, it_names_the_other_channel, a_time_is_earlier_than_all, a_time_is_later_than_all],
)
@pytest.mark.parametrize("compression", ["", "zstd"])
def test_no_damage_of_one_index_hides_a_chunk_or_moves_the_start(
    tmp_path: Path, compression: Any, change: Change
) -> None:
    path = write_bag(tmp_path / "t.mcap", chunks_apart(16_000), storage="mcap", compression=compression)
    expected, whole = figures(read(path)), path.read_bytes()
    places = list(index_records("mcap", whole))
    channels = {whole[start - 6] for start, _ in places}
    assert len(places) > 4
    assert channels == {1, 2}

    for start, end in places:
        content = bytearray(whole)
        change(content, start, end)
        if content == whole:
            continue  # an index of one entry
        path.write_bytes(content)
        trial = read(path)

        assert figures(trial) == expected
        # Of a chunk that is not read, the places of messages do not matter.
        assert [(d.kind, d.count) for d in trial.log_defects] in ([], [("contradicting_index", 1)])


def heads_and_ends(content: bytes) -> list[int]:
    """Places in the heads and ends of all records of a file."""
    starts = [at for _, at in records_of(content)]
    places = {p for a, b in pairwise([0, *starts, len(content)]) for p in range(a, min(b, a + 80))}
    return sorted(places | {p for end in starts for p in range(end - 40, end)})


def test_no_changed_byte_hides_anything_where_chunks_are_left_out(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.mcap", chunks_apart(13_000), storage="mcap", compression="zstd")
    expected, whole = figures(read(path)), path.read_bytes()
    dice = random.Random(11)  # noqa: S311  # of places and bits
    found = Counter[str]()
    for at in dice.sample(heads_and_ends(whole), 60):
        content = bytearray(whole)
        content[at] ^= 1 << dice.randrange(8)
        path.write_bytes(content)
        try:
            trial = read(path)
        except LogError:
            found["refused"] += 1
            continue
        assert figures(trial) == expected
        found["read"] += 1

    assert min(found["refused"], found["read"]) > 5


def records_of(content: bytes) -> Iterator[tuple[int, int]]:
    at = 8
    while at < len(content) - 8:
        op, length = struct.unpack_from("<BQ", content, at)
        yield op, at
        at += 9 + length


@every_format
def test_the_number_of_threads_changes_nothing(
    tmp_path: Path, storage: Any, name: str, compression: str
) -> None:
    path = write_bag(tmp_path / name, MESSAGES, storage=storage, compression=compression)
    scans = [(McapScan if storage == "mcap" else Ros1Scan)(path, jobs=jobs) for jobs in (1, 2, 7)]
    found = [
        [
            (m.connection.topic, m.stamp_ns, bytes(m.payload))
            for item in scan
            if isinstance(item, Batch)
            for m in item.messages()
        ]
        for scan in scans
    ]

    assert len(found[0]) == 30
    assert found[0] == found[1] == found[2]


def record(op: int, body: bytes) -> bytes:
    return struct.pack("<BQ", op, len(body)) + body


def text(words: str) -> bytes:
    return struct.pack("<I", len(words)) + words.encode()


def channel(number: int, topic: str) -> bytes:
    return record(4, struct.pack("<HH", number, 0) + text(topic) + text("cdr") + text(""))


def indexed_chunk(declared: bytes, messages: list[tuple[int, int]]) -> bytes:
    """A chunk of empty messages, by channel and time, with its indexes."""
    records, index = declared, dict[int, bytes]()
    for number, stamp_ns in messages:
        index[number] = index.get(number, b"") + struct.pack("<QQ", stamp_ns, len(records))
        records += record(5, struct.pack("<HIQQ", number, 0, stamp_ns, stamp_ns))
    times = [stamp_ns for _, stamp_ns in messages]
    head = struct.pack("<QQQI", min(times), max(times), len(records), 0) + text("")
    entries = [struct.pack("<HI", number, len(body)) + body for number, body in index.items()]
    packed = struct.pack("<Q", len(records)) + records
    return record(6, head + packed) + b"".join(record(7, body) for body in entries)


def test_a_channel_may_be_declared_long_before_its_first_message(tmp_path: Path) -> None:
    """At the start of a chunk of others' messages, which are then no batch for themselves."""
    metadata = record(12, text("") + text(""))  # what does not lie in a chunk ends a batch
    chunks = [
        indexed_chunk(channel(1, "/a"), [(1, 1)]),
        indexed_chunk(channel(2, "/b"), [(1, 2), (1, 3)]),
        indexed_chunk(b"", [(2, 4), (1, 5)]),
    ]
    start, end = record(1, text("") + text("")), record(15, bytes(4)) + record(2, bytes(20))
    magic = b"\x89MCAP0\r\n"
    path = tmp_path / "t.mcap"
    path.write_bytes(magic + start + metadata.join(chunks) + end + magic)
    found = [m for item in McapScan(path) if isinstance(item, Batch) for m in item.messages()]

    assert [(m.connection.topic, m.stamp_ns) for m in found] == [
        ("/a", 1),
        ("/a", 2),
        ("/a", 3),
        ("/b", 4),
        ("/a", 5),
    ]
