"""Recordings as live sources: played again, and read while they grow."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.errors import UsageError
from ariac_score.live.growing import GrowingSource
from ariac_score.live.replay import ReplaySource
from ariac_score.live.source import Announced, Ended, LiveItem, Received, source_at
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Batch, Message
from ariac_score.testing import write_bag
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"

Told = tuple[str, int, bytes, int]


class Clock:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.s = 0.0

    def now_s(self) -> float:
        return self.s

    def sleep(self, seconds: float) -> None:
        self.s += seconds


def _recorded(path: Path) -> list[Told]:
    found: list[Told] = []
    for item in open_scan(path, jobs=1):
        if isinstance(item, Batch):
            numbers = [0] * len(item) if item.sequences is None else item.sequences.tolist()
            found += [
                (m.connection.topic, m.stamp_ns, bytes(m.payload), n)
                for m, n in zip(item.messages(), numbers, strict=True)
            ]
        elif isinstance(item, Message):
            found.append((item.connection.topic, item.stamp_ns, bytes(item.payload), item.sequence))
    return found


def _told(items: list[LiveItem]) -> list[Told]:
    return [
        (m.connection.topic, m.stamp_ns, bytes(m.payload), m.sequence)
        for m in (item.message for item in items if isinstance(item, Received))
    ]


def test_a_replay_gives_every_message_when_its_time_has_come() -> None:
    clock = Clock()
    source = ReplaySource(f"replay:{EXAMPLE}?speed=4", now_s=clock.now_s, sleep=clock.sleep)
    source.open(None)
    items: list[LiveItem] = []
    late: list[float] = []
    while not isinstance(item := source.next(0.5), Ended):
        if item is None:
            continue
        items.append(item)
        if isinstance(item, Received):
            first_ns = next(i for i in items if isinstance(i, Received)).message.stamp_ns
            late.append(clock.s - (item.message.stamp_ns - first_ns) / 4e9)

    assert _told(items) == _recorded(EXAMPLE)
    assert max(map(abs, late)) < 1e-6
    declared = {id(i.connection) for i in items if isinstance(i, Announced)}
    assert {id(i.message.connection) for i in items if isinstance(i, Received)} <= declared


@pytest.mark.parametrize("step", [977, 1 << 20])
def test_a_file_that_grows_gives_what_it_holds_when_it_is_closed(tmp_path: Path, step: int) -> None:
    whole, grown = EXAMPLE.read_bytes(), tmp_path / "trial.mcap"
    clock, items, at = Clock(), [], 0
    source = GrowingSource(str(grown), now_s=clock.now_s, sleep=clock.sleep)
    source.open(None)

    assert source.next(0.1) is None  # not there yet
    while not isinstance(item := source.next(0.0), Ended):
        if item is not None:
            items.append(item)
            continue
        assert at < len(whole), "it does not see that the recorder has closed the file"
        with grown.open("ab") as file:
            file.write(whole[at : at + step])
        at += step

    assert _told(items) == _recorded(EXAMPLE)
    assert "closed" in item.cause


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("nowhere://cell", "there is no source 'nowhere'"),
        ("replay:absent.mcap", "no ROS recording"),
        (f"replay:{EXAMPLE}?speed=fast", "no speed"),
        (f"replay:{EXAMPLE}?speed=-1", "no speed"),
        ("notes.txt", "no recording that could be read as it grows"),
    ],
)
def test_an_address_that_makes_no_sense_is_refused(address: str, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        source_at(address)


def test_a_bag_whose_chunk_is_still_open_gives_the_messages_it_holds(tmp_path: Path) -> None:
    """A recorder writes the head of a chunk with a length of 0, and the length when it is done with it."""
    closed = write_bag(tmp_path / "closed.bag", recorded_messages(kitting_trial()), storage="ros1")
    raw, grown = closed.read_bytes(), tmp_path / "grown.bag"
    header = len(b"#ROSBAG V2.0\n")
    head_at = header + 4096  # of the chunk, behind the bag header and what fills it up
    head_bytes = int.from_bytes(raw[head_at : head_at + 4], "little")
    length_at = head_at + 4 + head_bytes
    behind = length_at + 4 + int.from_bytes(raw[length_at : length_at + 4], "little")
    index_at = raw.index(b"index_pos=") + len(b"index_pos=")
    open_ = bytearray(raw[:behind])
    open_[index_at : index_at + 8] = bytes(8)
    open_[length_at : length_at + 4] = bytes(4)
    clock, items = Clock(), list[LiveItem]()
    source = GrowingSource(str(grown), now_s=clock.now_s, sleep=clock.sleep)
    source.open(None)

    grown.write_bytes(open_)
    while (item := source.next(0.0)) is not None:
        items.append(item)
    chunk = len(_told(items))
    assert chunk > 100

    with grown.open("r+b") as file:
        file.write(raw)
    grown.rename(tmp_path / "renamed.bag")  # as `rosbag record` does when it closes a bag
    while not isinstance(item := source.next(0.0), Ended):
        assert item is not None
        items.append(item)
    assert _told(items) == _recorded(closed)
