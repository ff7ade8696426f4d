"""A cell over Zenoh: router and publishers of its makers' library, keys and attachments of rmw_zenoh.

No node of ROS 2 was at hand: layouts are those that its code writes.
"""

from __future__ import annotations

import json
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from ariac_score import as_json, score_trial
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LiveError, UsageError
from ariac_score.live.source import Disconnected, Lost, Received, Reconnected, source_at
from ariac_score.live.watch import Settings, Watch
from ariac_score.live.zenoh import attachment_of, key_of
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.logs.containers.items import Message
from ariac_score.testing import source_checks

sys.path.insert(0, str(Path(__file__).parent))
from live_servers import Until, announced, heard, is_message, payloads, recorded, sending, until

zenoh = pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
"""The published hash of std_msgs/msg/String."""
STRING = f"std_msgs::msg::dds_::String_/{HASH}"
WORD = b"\0\1\0\0\2\0\0\0a\0"
GID = bytes(range(16))


def _port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


def _session(mode: str, role: str, port: int) -> Any:
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        f"{role}/endpoints": [f"tcp/127.0.0.1:{port}"],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,  # as rmw_zenoh has it
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@dataclass
class Cell:
    """A router, and one node that publishes."""

    port: int
    router: Any
    node: Any
    publishers: dict[str, Any] = field(default_factory=dict)
    numbers: dict[str, int] = field(default_factory=dict)

    @property
    def address(self) -> str:
        return f"zenoh://127.0.0.1:{self.port}"

    def offer(self, key: str, *, keeps: int = 0) -> None:
        """Declare a publisher; `keeps`: it is transient local."""
        if key not in self.publishers:
            block = {"congestion_control": zenoh.CongestionControl.BLOCK}
            if keeps:
                cache = zenoh.ext.CacheConfig(keeps)
                self.publishers[key] = zenoh.ext.declare_advanced_publisher(
                    self.node, key, cache=cache, publisher_detection=True, **block
                )
            else:
                self.publishers[key] = self.node.declare_publisher(key, **block)

    def say(self, key: str, payload: bytes, *, skip: int = 0) -> None:
        """Publish a message; `skip`: so many before it are lost."""
        self.offer(key)
        number = self.numbers[key] = self.numbers.get(key, 0) + 1 + skip
        gid = struct.pack("<Q", hash(key) & (1 << 62) - 1) + bytes(8)
        attached = struct.pack("<qqB16s", number, 5, 16, gid)
        self.publishers[key].put(payload, attachment=attached)

    def send(self, message: Message) -> None:
        """Publish a message of a recording."""
        self.say(_key(message), bytes(message.payload))

    def subscribed(self) -> bool:
        """Whether somebody hears the example's topics."""
        return bool(self.publishers) and all(_matches(p) for p in self.publishers.values())


def _matches(publisher: Any) -> bool:
    return bool(publisher.matching_status.matching)


def _key(message: Message) -> str:
    connection = message.connection
    package, _, name = connection.type.split("/")
    hashed = bundled_typestore(2).hash_rihs01(connection.type)
    return f"0/{connection.topic.strip('/')}/{package}::msg::dds_::{name}_/{hashed}"


@contextmanager
def cell(port: int = 0) -> Iterator[Cell]:
    port = port or _port()
    router = _session("router", "listen", port)
    node = _session("client", "connect", port)
    try:
        yield Cell(port, router, node)
    finally:
        node.close()
        router.close()


def test_numbers_that_are_missing_are_a_loss_with_its_count() -> None:
    with cell() as one:
        source = source_at(one.address)
        source.open(frozenset({"/words"}))
        key = f"0/words/{STRING}"
        one.offer(key)
        until(one.subscribed, "subscribed")
        for skip in (0, 0, 3, 0):
            one.say(key, WORD, skip=skip)
        items = heard(source, is_message, 4)
        source.close()

    (connection,) = announced(items)
    assert (connection.topic, connection.encoding) == ("/words", "cdr")
    assert connection.type == "std_msgs/msg/String"
    assert connection.definition.startswith("string data")
    got = [item for item in items if isinstance(item, Received)]
    assert [(g.message.payload, g.message.sequence, g.sent_ns) for g in got] == [
        (WORD, number, 5) for number in (1, 2, 6, 7)
    ]
    (lost,) = (item for item in items if isinstance(item, Lost))
    assert (lost.topic, lost.count, "3 to 5" in lost.cause) == ("/words", 3, True)


def test_who_comes_late_is_told_what_is_latched_once() -> None:
    with cell() as one:
        key = f"0/words/{STRING}"
        one.offer(key, keeps=1)
        one.say(key, WORD)
        time.sleep(0.5)
        source = source_at(one.address)
        source.open(frozenset({"/words"}))
        items = heard(source, is_message)
        one.say(key, WORD)
        items += heard(source, is_message)
        assert source.next(0.5) is None
        source.close()
    assert payloads(items, "/words") == [WORD, WORD]


def test_messages_of_another_definition_are_not_decoded() -> None:
    with cell() as one:
        source = source_at(one.address)
        source.open(None)
        key = "0/words/std_msgs::msg::dds_::String_/RIHS01_" + 64 * "0"
        one.offer(key)
        until(one.subscribed, "subscribed")
        one.say(key, WORD)
        (connection,) = announced(heard(source, is_message))
        source.close()
    assert "another definition" in connection.encoding
    assert connection.definition == ""


def test_it_keeps_the_contract(subtests: pytest.Subtests) -> None:
    with cell() as one:
        for message in recorded():
            one.offer(_key(message))
        with sending(one.subscribed, one.send):
            for check in source_checks(lambda: source_at(one.address)):
                with subtests.test(check.name):
                    check()


def test_silence_counts_for_losses_show(tmp_path: Path) -> None:
    with cell() as one:
        for message in recorded():
            one.offer(_key(message))
        with sending(one.subscribed, one.send):
            settings = Settings(period_s=1e9, tail_period_s=1e9, apart=False)
            source = Until(source_at(one.address), len(recorded()))
            result = Watch(source, prepare("paper2020"), tmp_path / "seen.mcap", settings=settings).run()
    assert not {"unseen_losses", "missing_messages"} & {d.kind for d in result.measured.log_defects}
    # The submissions of the example are of an older definition, which this network does not bring along.
    assert {"arm_collision"} <= {*result.measured.witnessed}
    assert as_json(result) == as_json(score_trial(tmp_path / "seen.mcap", "paper2020"))


def test_a_router_that_is_gone_and_back() -> None:
    key = f"0/words/{STRING}"
    with cell() as one:
        port = one.port
        source = source_at(one.address)
        source.open(frozenset({"/words"}))
        one.offer(key)
        until(one.subscribed, "subscribed")
        one.say(key, WORD)
        heard(source, is_message)
    heard(source, lambda item: isinstance(item, Disconnected))
    with cell(port) as one:
        one.offer(key)
        heard(source, lambda item: isinstance(item, Reconnected))
        until(one.subscribed, "subscribed again")
        one.numbers[key] = 9
        one.say(key, WORD)
        items = heard(source, is_message)
        source.close()
    (lost,) = (item for item in items if isinstance(item, Lost))
    assert lost.count == 8


def test_an_attempt_to_connect_has_ended_when_the_source_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    """A thread that is still in the library when Python ends aborts the program."""
    with cell() as one:
        source = source_at(one.address)
        source.open(None)
    dials, really = threading.Event(), zenoh.open

    def attempt(config: Any) -> Any:
        dials.set()
        return really(config)

    monkeypatch.setattr(zenoh, "open", attempt)
    assert dials.wait(30), "it does not dial again"
    source.close()
    assert source.address not in {thread.name for thread in threading.enumerate()}


def test_what_is_no_router_is_refused_in_words() -> None:
    start_s = time.monotonic()
    with pytest.raises(LiveError, match="no Zenoh router"):
        source_at(f"zenoh://me:secret@127.0.0.1:{_port()}").open(None)
    assert time.monotonic() - start_s < 10
    with pytest.raises(UsageError, match="no domain"):
        source_at("zenoh://cell?domain=x")
    assert "secret" not in source_at("zenoh://me:secret@cell").address


def test_both_layouts_of_attachments_are_read() -> None:
    today = struct.pack("<qqB16s", 7, 9, 16, GID)
    before = b"\x0fsequence_number" + struct.pack("<q", 7) + b"\x10source_timestamp" + struct.pack("<q", 9)
    before += b"\x0asource_gid\x10" + GID
    assert (len(today), len(before)) == (33, 77)
    assert attachment_of(today) == attachment_of(before) == (7, 9, GID.hex())
    assert attachment_of(before[:-1]) is None
    assert attachment_of(b"") is None
    assert key_of("@ros2_lv/0/x") is None
    assert key_of("0/chatter/whatever/x") is None
