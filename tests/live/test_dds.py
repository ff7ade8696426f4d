"""A cell over DDS: publishers of Cyclone DDS in a process of their own, as ROS 2 names topics and types.

No node of ROS 2 was at hand: names, types and the hash are those that its code gives.
"""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from ariac_score.errors import LiveError, UsageError
from ariac_score.live import dds
from ariac_score.live.source import Disconnected, LiveSource, Lost, Received, Reconnected, source_at
from ariac_score.logs.columnar.types import bundled_typestore, decoder_for
from ariac_score.logs.containers.items import Message
from ariac_score.testing import source_checks

sys.path.insert(0, str(Path(__file__).parent))
from live_servers import announced, heard, is_message, payloads, recorded, sending, until

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
"""The published hash of std_msgs/msg/String."""
DOMAIN = 100 + os.getpid() % 100
"""Of its own, so that tests side by side do not hear each other."""
STRING, FRAMES = "std_msgs/msg/String", "tf2_msgs/msg/TFMessage"


@pytest.fixture
def sources() -> Iterator[ExitStack]:
    """Closes what a test opened: one process takes part in a domain once."""
    with ExitStack() as stack:
        yield stack


def _opened(address: str, topics: frozenset[str] | None, sources: ExitStack) -> LiveSource:
    source = source_at(address)
    sources.callback(source.close)
    source.open(topics)
    return source


class Cell:
    """A process that publishes what it is told to."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process, self._lock, self._offered = process, threading.Lock(), set[str]()
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"
        self.address = f"dds://127.0.0.1?domain={DOMAIN}"

    def do(self, do: str, **about: Any) -> dict[str, int]:
        """Tell it something; how many hear each topic then."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        with self._lock:
            self.process.stdin.write(json.dumps({"do": do, **about}) + "\n")
            self.process.stdin.flush()
            answer: dict[str, int] = json.loads(self.process.stdout.readline())
        return answer

    def offer(self, topic: str, type_: str = STRING, **about: Any) -> None:
        """Publish a topic; reliable, volatile and ten deep as by default in ROS 2."""
        offered = {"reliable": True, "latched": False, "keeps": 10, "hash": "", **about}
        self.do("offer", topic=topic, type=type_, **offered)

    def offer_all(self, messages: list[Message]) -> None:
        """Publish the topics of a recording whose definitions are those of today."""
        store = bundled_typestore(2)
        for one in {message.connection for message in messages}:
            if store.generate_msgdef(one.type, ros_version=2)[0].strip() == one.definition.strip():
                self.offer(one.topic, one.type, keeps=1000, hash=store.hash_rihs01(one.type))
                self._offered.add(one.topic)

    def send(self, message: Message) -> None:
        """Publish a message of a recording, if its topic is offered."""
        if message.connection.topic not in self._offered:
            return
        raw = base64.b64encode(bytes(message.payload)).decode()
        assert self.process.stdin is not None
        with self._lock:
            said = {"do": "bytes", "topic": message.connection.topic, "raw": raw}
            self.process.stdin.write(json.dumps(said) + "\n")
            self.process.stdin.flush()

    def subscribed(self) -> bool:
        """Whether somebody hears the example's motion."""
        return bool(self.do("look")["/snapshot"])

    def until_heard(self, *topics: str) -> None:
        """Wait until somebody hears topics."""
        until(lambda: all(self.do("look")[topic] for topic in topics), f"somebody hears {topics}")


@contextmanager
def cell(*, lost_per_mille: int = 0) -> Iterator[Cell]:
    script = Path(__file__).with_name("dds_cell.py")
    program = [sys.executable, str(script), str(DOMAIN), str(lost_per_mille)]
    pipe = subprocess.PIPE
    with subprocess.Popen(program, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            yield Cell(process)
        finally:
            process.kill()


def _text(payload: bytes) -> str:
    length = int.from_bytes(payload[4:8], "little")
    return payload[8 : 7 + length].decode()


def test_messages_come_as_the_bytes_they_are_with_both_times(sources: ExitStack) -> None:
    with cell() as one:
        one.offer("/words", hash=HASH)
        one.offer("/tf", FRAMES)
        source = _opened(one.address, None, sources)
        one.until_heard("/words", "/tf")
        one.do("say", topic="/words", word="hello")
        one.do("say", topic="/tf", frames=1.5)
        items = heard(source, is_message, 2)
        source.close()

    # CDR of 'hello': little endian, length with the closing zero, the text, filled up to four bytes.
    assert payloads(items, "/words") == [b"\0\1\0\0\6\0\0\0hello\0\0\0"]
    (moved,) = payloads(items, "/tf")
    connections = {found.topic: found for found in announced(items)}
    frame = decoder_for(connections["/tf"])(moved).transforms[0]  # type: ignore[attr-defined]
    assert (frame.header.frame_id, frame.child_frame_id) == ("world", "tool")
    assert (frame.header.stamp.sec, frame.transform.translation.x) == (5, 1.5)
    words = connections["/words"]
    assert (words.type, words.encoding, words.sees_losses) == (STRING, "cdr", False)
    for item in items:
        if isinstance(item, Received):  # one machine, one clock
            assert item.sent_ns is not None
            assert 0 <= item.message.stamp_ns - item.sent_ns < 10**10


def test_who_comes_late_is_told_what_is_latched(sources: ExitStack) -> None:
    with cell() as one:
        one.offer("/state", latched=True, keeps=1)
        for word in ("old", "latest"):
            one.do("say", topic="/state", word=word)
        source = _opened(one.address, frozenset({"/state"}), sources)
        items = heard(source, is_message)
        source.close()

    assert [_text(raw) for raw in payloads(items, "/state")] == ["latest"]


def test_a_publisher_that_is_not_reliable_is_heard_beside_one_that_is_and_each_once(
    sources: ExitStack,
) -> None:
    with cell() as one, cell() as other:
        one.offer("/words", reliable=True, latched=True, keeps=100)
        other.offer("/words", reliable=False)
        source = _opened(one.address, frozenset({"/words"}), sources)
        one.until_heard("/words")
        other.until_heard("/words")
        for number in range(3):
            one.do("say", topic="/words", word=f"sure {number}")
            other.do("say", topic="/words", word=f"maybe {number}")
        items = heard(source, is_message, 6)
        assert source.next(0.3) is None
        source.close()

    said = sorted(_text(raw) for raw in payloads(items, "/words"))
    assert said == ["maybe 0", "maybe 1", "maybe 2", "sure 0", "sure 1", "sure 2"]
    assert len(announced(items)) == 2


@pytest.mark.parametrize(
    ("type_", "stated", "why"),
    [
        ("ours/msg/Odd", "", "nobody here knows the definition of ours::msg::dds_::Odd_"),
        (STRING, f"RIHS01_{'0' * 64}", "(RIHS01_000000000000…) is not the one known here"),
    ],
)
def test_a_type_of_which_nobody_knows_the_bytes_is_said_not_guessed(
    type_: str, stated: str, why: str, sources: ExitStack
) -> None:
    with cell() as one:
        one.offer("/odd", type_, hash=stated)
        source = _opened(one.address, None, sources)
        (lost,) = heard(source, lambda item: isinstance(item, Lost))
        source.close()

    assert isinstance(lost, Lost)
    assert lost.topic == "/odd"
    assert why in lost.cause


def test_a_network_that_loses_every_third_packet_loses_no_message_of_a_reliable_publisher(
    sources: ExitStack,
) -> None:
    words = [f"{number}" for number in range(40)]
    with cell(lost_per_mille=300) as one:
        one.offer("/sure", keeps=len(words))
        source = _opened(one.address, None, sources)
        one.until_heard("/sure")
        for word in words:
            one.do("say", topic="/sure", word=word)
        items = heard(source, is_message, len(words))

    assert [_text(raw) for raw in payloads(items, "/sure")] == words


def test_a_topic_that_nobody_asked_for_is_not_subscribed(sources: ExitStack) -> None:
    with cell() as one:
        one.offer("/words")
        one.offer("/others")
        source = _opened(one.address, frozenset({"/words"}), sources)
        one.until_heard("/words")
        assert one.do("look")["/others"] == 0
        source.close()
        until(lambda: one.do("look")["/words"] == 0, "the referee has left")


def test_a_cell_that_dies_is_gone_and_is_heard_again_on_the_same_channel(sources: ExitStack) -> None:
    with cell() as one:
        one.offer("/words")
        source = _opened(one.address, frozenset({"/words"}), sources)
        one.until_heard("/words")
        one.do("say", topic="/words", word="before")
        before = heard(source, is_message)
    gone = heard(source, lambda item: isinstance(item, Disconnected), limit_s=40)  # after the lease of 10 s
    with cell() as one:
        one.offer("/words")
        back = heard(source, lambda item: isinstance(item, Reconnected))
        one.until_heard("/words")
        one.do("say", topic="/words", word="after")
        after = heard(source, is_message)
        source.close()

    assert isinstance(gone[-1], Disconnected)
    assert "every publisher is gone" in gone[-1].cause
    first, last = before[-1], after[-1]
    assert isinstance(first, Received)
    assert isinstance(last, Received)
    assert last.message.connection is first.message.connection  # so that what is missing shows
    (again,) = (item for item in (*back, *after) if isinstance(item, Reconnected))
    assert again.since_ns == first.message.stamp_ns


def test_nobody_in_the_domain_is_said_within_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dds, "_FOUND_S", 1.0)
    source = source_at(f"dds://127.0.0.1?domain={DOMAIN}")
    with pytest.raises(LiveError, match=f"nobody publishes a topic of ROS 2 in domain {DOMAIN}"):
        source.open(None)
    source.close()


@pytest.mark.parametrize(
    "address", ["dds://", "dds://cell?domain=233", "dds://cell?domain=x", "dds://cell:7400", "dds://cell?a=1"]
)
def test_an_address_that_makes_no_sense_is_refused_before_anything_is_sent(address: str) -> None:
    with pytest.raises(UsageError):
        source_at(address)


def test_it_keeps_the_contract_of_sources() -> None:
    with cell() as one:
        one.offer_all(recorded())
        with sending(one.subscribed, one.send, recorded()[:600]):
            for check in source_checks(lambda: source_at(one.address)):
                check.run()
