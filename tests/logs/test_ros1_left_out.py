"""What nobody wants of a ROS 1 bag is not read, and all else is as if it had been."""

from __future__ import annotations

import random
import struct
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ariac_score.errors import LogError
from ariac_score.logs.containers.chunk_ranges import foresee
from ariac_score.logs.containers.items import Batch, Message
from ariac_score.logs.containers.ranged import RangedFile, reading
from ariac_score.logs.containers.ros1 import Ros1Scan
from ariac_score.logs.containers.source import Source
from ariac_score.logs.gather.wanted_fields import read_tables
from ariac_score.testing.bags import Recorded, write_bag

STRING, VECTOR = "std_msgs/msg/String", "geometry_msgs/msg/Vector3"
LARGE_BYTES = 1 << 16
"""A message is left out from this size on, beyond the first 128 bytes of its record."""
CHUNK_INFO = 6

MESSAGES = [
    Recorded("/speed", VECTOR, 10**18 + i * 10**8, {"x": i / 8})
    if i % 3
    else Recorded("/picture", STRING, 10**18 + i * 10**8, {"data": "x" * 150_000})
    for i in range(90)
]
Messages = list[tuple[str, int, bytes]]


def scanned(path: Path, topics: set[str] | None = None) -> tuple[Messages, Ros1Scan]:
    scan, found = Ros1Scan(path, topics=topics), Messages()
    for item in scan:
        messages = item.messages() if isinstance(item, Batch) else [item] if isinstance(item, Message) else []
        found += [(m.connection.topic, m.stamp_ns, bytes(m.payload)) for m in messages]
    return found, scan


def without(everything: Messages, topics: set[str]) -> Messages:
    """All messages, those of other topics without their bytes."""
    return [(t, s, p if t in topics else b"") for t, s, p in everything]


@pytest.fixture
def bytes_read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many bytes of chunks were read, each time."""
    read: list[int] = []
    plainly = Source.take_into

    def counted(self: Source, room: memoryview, what: str) -> None:
        read.append(len(room))
        plainly(self, room, what)

    monkeypatch.setattr(Source, "take_into", counted)
    return read


def records_of(content: bytes) -> Iterator[tuple[int, int, int]]:
    """Type of each record outside of chunks, and where its data start and end."""
    at = 13
    while at < len(content):
        (size,) = struct.unpack_from("<I", content, at)
        head = content[at + 4 : at + 4 + size]
        (length,) = struct.unpack_from("<I", content, at + 4 + size)
        start = at + 8 + size
        yield head[head.index(b"op=") + 3], start, start + length
        at = start + length


def test_pictures_that_nobody_wants_are_not_read(tmp_path: Path, bytes_read: list[int]) -> None:
    path = write_bag(tmp_path / "t.bag", MESSAGES, storage="ros1")
    everything, _ = scanned(path)
    whole = sum(bytes_read)
    bytes_read.clear()
    some, scan = scanned(path, {"/speed"})

    # The chunk in which the pictures are declared is read, for nothing is known of them yet.
    assert sum(bytes_read) < whole / 4
    first = next(i for i, (topic, _, data) in enumerate(some) if topic == "/picture" and not data)
    assert some[first:] == without(everything, {"/speed"})[first:]
    assert [(t, s) for t, s, _ in some] == [(t, s) for t, s, _ in everything]
    assert scan.index_contradictions == 0


def test_all_that_is_wanted_is_read(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", MESSAGES, storage="ros1")

    assert scanned(path, {"/speed", "/picture"})[0] == scanned(path)[0]


def test_connections_may_have_any_number_of_32_bits(tmp_path: Path) -> None:
    messages = [Recorded(f"/{i % 2}", VECTOR, 10**18 + i, {"x": i / 8}) for i in range(20)]
    path = write_bag(tmp_path / "t.bag", messages, storage="ros1")
    expected, _ = scanned(path)
    content = bytearray(path.read_bytes())
    for kind, start, end in records_of(content):
        if kind == CHUNK_INFO:
            (at,) = (at for at in range(start, end, 8) if content[at : at + 4] == b"\x01\0\0\0")
            content[at + 3] = 0xFF
    path.write_bytes(content.replace(b"conn=\x01\0\0\0", b"conn=\x01\0\0\xff"))

    found, scan = scanned(path)
    assert found == expected
    assert (len(found), scan.index_contradictions) == (len(messages), 0)


def an_offset_is_wrong(content: bytearray, start: int, end: int) -> None:
    content[end - 4] ^= 1


def a_time_is_wrong(content: bytearray, start: int, end: int) -> None:
    content[start] ^= 1


def it_is_all_ones(content: bytearray, start: int, end: int) -> None:
    content[start:end] = b"\xff" * (end - start)


def an_entry_stands_twice(content: bytearray, start: int, end: int) -> None:
    content[start : start + 12] = content[start + 12 : start + 24]


def it_names_another_connection(content: bytearray, start: int, end: int) -> None:
    at = content.rindex(b"conn=", 0, start) + 5
    content[at] ^= 1


CHANGES = [
    an_offset_is_wrong,
    a_time_is_wrong,
    it_is_all_ones,
    an_entry_stands_twice,
    it_names_another_connection,
]


@pytest.mark.parametrize("which", [-1, -2])
@pytest.mark.parametrize("change", CHANGES)
def test_what_was_left_out_is_read_where_the_index_is_wrong(
    tmp_path: Path, change: Callable[[bytearray, int, int], None], which: int
) -> None:
    path = write_bag(tmp_path / "t.bag", MESSAGES, storage="ros1")
    everything, _ = scanned(path)
    content = bytearray(path.read_bytes())
    _, start, end = [found for found in records_of(bytes(content)) if found[0] == 4][which]
    change(content, start, end)
    path.write_bytes(content)

    some, scan = scanned(path, {"/speed"})

    assert without(some, {"/speed"}) == without(everything, {"/speed"})
    assert scan.index_contradictions == 1


def picture_alone(count: int) -> list[Recorded]:
    dice = random.Random(5)  # noqa: S311  # of pictures
    return [
        Recorded("/picture", STRING, 2 * 10**18 + i, {"data": dice.randbytes(400_000).hex()})
        for i in range(count)
    ]


@pytest.mark.parametrize("compression", ["", "lz4", "bz2"])
def test_a_chunk_without_a_wanted_message_is_passed_over(
    tmp_path: Path, compression: Any, bytes_read: list[int]
) -> None:
    path = write_bag(
        tmp_path / "t.bag", [*MESSAGES[:30], *picture_alone(5)], storage="ros1", compression=compression
    )
    everything, _ = scanned(path)
    content = bytearray(path.read_bytes())
    _, start, _ = [found for found in records_of(bytes(content)) if found[0] == 5][-1]
    content[start + 30 : start + 100] = bytes(70)  # records of the last chunk, or what they are packed in
    path.write_bytes(content)

    some, _ = scanned(path, {"/speed"})

    assert without(some, {"/speed"}) == without(everything, {"/speed"})
    with pytest.raises(LogError):
        scanned(path)


def test_a_chunk_of_what_nobody_wants_is_read_where_it_may_declare_something(tmp_path: Path) -> None:
    late = [Recorded("/speed", VECTOR, 3 * 10**18 + i, {"x": 1.0}) for i in range(3)]
    path = write_bag(tmp_path / "t.bag", [*picture_alone(4), *late], storage="ros1")

    some, _ = scanned(path, {"/speed"})

    assert [t for t, _, _ in some] == ["/picture"] * 4 + ["/speed"] * 3
    assert all(data for topic, _, data in some if topic == "/speed")


def test_a_chunk_is_read_where_the_end_of_the_bag_says_something_else(
    tmp_path: Path, bytes_read: list[int]
) -> None:
    path = write_bag(tmp_path / "t.bag", [*MESSAGES[:30], *picture_alone(5)], storage="ros1")
    scanned(path, {"/speed"})
    pieces = len(bytes_read)
    content = bytearray(path.read_bytes())
    _, _, end = [found for found in records_of(bytes(content)) if found[0] == 6][-1]
    content[end - 4] += 1  # the number of messages of the last chunk's connection
    path.write_bytes(content)
    bytes_read.clear()

    with pytest.raises(LogError, match="announces"):
        scanned(path, {"/speed"})
    assert len(bytes_read) > pieces


@pytest.mark.parametrize("seconds", [0, 2**32 - 1])
def test_a_chunk_is_read_where_its_index_moves_the_start_or_the_end(tmp_path: Path, seconds: int) -> None:
    path = write_bag(tmp_path / "t.bag", [*MESSAGES[:30], *picture_alone(5)], storage="ros1")
    everything, _ = scanned(path)
    content = bytearray(path.read_bytes())
    _, start, _ = [found for found in records_of(bytes(content)) if found[0] == 4][-1]
    content[start : start + 4] = seconds.to_bytes(4, "little")
    path.write_bytes(content)

    some, scan = scanned(path, {"/speed"})

    assert without(some, {"/speed"}) == without(everything, {"/speed"})
    assert scan.index_contradictions == 1


@pytest.mark.parametrize("wrong", ["beyond the chunk", "twice"])
def test_a_chunk_is_read_where_its_index_cannot_be_right(tmp_path: Path, wrong: str) -> None:
    path = write_bag(tmp_path / "t.bag", [*MESSAGES[:30], *picture_alone(5)], storage="ros1")
    content = bytearray(path.read_bytes())
    _, start, end = [found for found in records_of(bytes(content)) if found[0] == 4][-1]
    if wrong == "twice":
        content[start : start + 12] = content[end - 12 : end]
    else:
        content[end - 4 : end] = b"\xff\xff\xff\x7f"
    path.write_bytes(content)
    some, scan = scanned(path, {"/speed"})

    assert scan.index_contradictions == (1 if end - start > 12 or wrong != "twice" else 0)
    assert Counter(t for t, _, _ in some) == Counter({"/picture": 15, "/speed": 20})


@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(["", "lz4"]))
def test_whatever_is_wanted_the_numbers_are_those_of_the_whole_bag(
    tmp_path: Path, seed: int, compression: Any
) -> None:
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets
    sizes = [0, 10, LARGE_BYTES - 4, LARGE_BYTES + 74, LARGE_BYTES + 75, LARGE_BYTES + 76, 3 * LARGE_BYTES]
    topics = [f"/t{n}" for n in range(dice.randint(1, 4))]
    messages = [
        Recorded(dice.choice(topics), STRING, 10**18 + i, {"data": "y" * dice.choice(sizes)})
        for i in range(dice.randint(1, 60))
    ]
    path = write_bag(tmp_path / "r.bag", messages, storage="ros1", compression=compression)
    wanted = {topic for topic in topics if dice.random() < 0.5}

    everything, _ = scanned(path)
    some, scan = scanned(path, wanted)

    assert without(some, wanted) == without(everything, wanted)
    assert scan.index_contradictions == 0
    path.unlink()


# Fetched in parts ------------------------------------------------------------------------


def in_parts(path: Path, into: Path, topics: set[str]) -> tuple[RangedFile, bool]:
    """A bag of which only what was foreseen is here."""
    content = path.read_bytes()
    into.unlink(missing_ok=True)
    file = RangedFile(into, len(content), lambda ranges: [content[a:b] for a, b in ranges])
    return file, foresee(file, topics)


def outcome_of(path: Path, topics: set[str]) -> tuple[Messages, str]:
    """What a scan gives before it ends, and why it ends where it does."""
    found = Messages()
    try:
        for item in Ros1Scan(path, topics=topics):
            many = item.messages() if isinstance(item, Batch) else [item] if isinstance(item, Message) else []
            found += [(m.connection.topic, m.stamp_ns, bytes(m.payload)) for m in many]
    except LogError as error:
        return found, f"{error.cause} {error.place}"
    return found, ""


@pytest.mark.parametrize("compression", ["", "lz4", "bz2"])
def test_what_a_scan_reads_is_foreseen(tmp_path: Path, compression: Any) -> None:
    messages = [*MESSAGES[:2], Recorded("/late", STRING, 10**18 + 10**8, {"data": ""}), *picture_alone(9)]
    path = write_bag(tmp_path / "t.bag", messages, storage="ros1", compression=compression)

    file, pays = in_parts(path, tmp_path / "holes.bag", {"/speed"})
    fetched = file.read_bytes
    with reading([file]):
        found = outcome_of(file.path, {"/speed"})

    assert pays
    assert file.read_bytes == fetched < path.stat().st_size / 2
    assert found == outcome_of(path, {"/speed"})


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(["", "lz4"]), st.integers(0, 3))
def test_a_bag_with_holes_reads_as_the_whole_whatever_is_wrong_with_it(
    tmp_path: Path, seed: int, compression: Any, faults: int
) -> None:
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets
    messages = [*MESSAGES[:30], *picture_alone(dice.randint(0, 3))]
    path = write_bag(tmp_path / "r.bag", messages, storage="ros1", compression=compression)
    content = bytearray(path.read_bytes())
    (index_pos,) = struct.unpack_from("<Q", content, content.index(b"index_pos=") + 10)
    for _ in range(faults):
        first = dice.choice([0, index_pos, max(0, index_pos - 200)])
        content[dice.randrange(first, min(len(content), first + 400))] = dice.choice([0, 1, 127, 128, 255])
    if dice.random() < 0.1:
        del content[-dice.randrange(1, len(content)) :]
    path.write_bytes(content)

    file, _ = in_parts(path, tmp_path / "holes.bag", {"/speed"})
    with reading([file]):
        found = outcome_of(file.path, {"/speed"})

    assert found == outcome_of(path, {"/speed"})
    assert file.failure is None
    path.unlink()


def test_columns_are_the_same(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", MESSAGES, storage="ros1")
    (table,) = read_tables(path, {"/speed": ["x"]})

    assert table.columns["x"].values.tolist() == [i / 8 for i in range(90) if i % 3]


def test_cut_at_any_of_many_bytes_it_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", [*MESSAGES[:4], *picture_alone(1)], storage="ros1")
    whole = path.read_bytes()
    for size in range(0, len(whole), 4001):
        path.write_bytes(whole[:size])
        with pytest.raises(LogError):
            scanned(path, {"/speed"})
