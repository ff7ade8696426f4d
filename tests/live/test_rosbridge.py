"""A cell behind rosbridge: a stand-in, written from its protocol, for no server can be had without ROS."""

from __future__ import annotations

import json
import socket
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import ServerConnection, serve

from ariac_score import Verdict, as_json, score_trial
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LiveError
from ariac_score.live.source import Disconnected, Received, Reconnected, source_at
from ariac_score.live.watch import Settings, Watch
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.testing import source_checks

sys.path.insert(0, str(Path(__file__).parent))
from live_servers import Until, announced, heard, is_message, payloads, recorded, sending, until

cbor2 = pytest.importorskip("cbor2", reason="cbor2 is not installed")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]


class StandIn:
    """Answers `topics_and_raw_types`, and sends what is subscribed as `cbor-raw`."""

    def __init__(self, connections: list[Connection], port: int = 0, *, rosapi: bool = True) -> None:
        self.offered = {one.topic: one for one in connections}
        self._rosapi = rosapi
        self._subscribed: dict[str, set[ServerConnection]] = {}
        self._clients: set[ServerConnection] = set()
        self.server = serve(self._talk, "127.0.0.1", port, compression=None, max_size=None)
        self.port: int = self.server.socket.getsockname()[1]
        self._thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self._thread.start()

    def _talk(self, client: ServerConnection) -> None:
        self._clients.add(client)
        try:
            for raw in client:
                self._answer(client, json.loads(raw))
        finally:
            self._clients.discard(client)
            for those in self._subscribed.values():
                those.discard(client)

    def _answer(self, client: ServerConnection, said: dict[str, Any]) -> None:
        op, topic = said["op"], str(said.get("topic"))
        if op == "call_service":
            values: Any = "service does not exist"
            if self._rosapi:
                each = list(self.offered.values())
                values = {
                    "topics": [one.topic for one in each],
                    "types": [one.type for one in each],
                    "typedefs_full_text": [one.definition for one in each],
                }
            answer = {"op": "service_response", "id": said["id"], "values": values, "result": self._rosapi}
            client.send(json.dumps({**answer, "service": said["service"]}))
        elif op == "subscribe":
            assert said["compression"] == "cbor-raw"
            if self.offered[topic].type == said["type"]:  # else it fails, and says nothing
                self._subscribed.setdefault(topic, set()).add(client)
        elif op == "unsubscribe":
            self._subscribed.get(topic, set()).discard(client)

    def offer(self, connection: Connection) -> None:
        """Offer a topic; a subscription of another type gets nothing any more."""
        self._subscribed.pop(connection.topic, None)
        self.offered = {connection.topic: connection}

    def subscribed(self) -> bool:
        """Whether everything that is offered has a subscriber."""
        return all(self._subscribed.get(topic) for topic in self.offered)

    def send(self, message: Message) -> None:
        """Publish a message."""
        secs, nsecs = divmod(message.stamp_ns, 10**9)
        told = {"secs": secs, "nsecs": nsecs, "bytes": bytes(message.payload)}
        topic = message.connection.topic
        raw = cbor2.dumps({"op": "publish", "topic": topic, "msg": told})
        for client in list(self._subscribed.get(topic, ())):
            with suppress(ConnectionClosed):
                client.send(raw)

    def stop(self) -> None:
        """End, as a server that is killed."""
        self.server.shutdown()
        for client in list(self._clients):
            client.close()
        self._thread.join(5)

    @property
    def address(self) -> str:
        """For `watch`."""
        return f"rosbridge://127.0.0.1:{self.port}"


@contextmanager
def stand_in(port: int = 0, *, rosapi: bool = True) -> Iterator[StandIn]:
    connections = {message.connection.topic: message.connection for message in recorded()}
    one = StandIn(list(connections.values()), port, rosapi=rosapi)
    try:
        yield one
    finally:
        one.stop()


def test_every_byte_arrives_with_the_stamp_of_the_server() -> None:
    sent = recorded()[:500]
    with stand_in() as server:
        source = source_at(server.address)
        source.open(None)
        until(server.subscribed, "subscribed")
        for message in sent:
            server.send(message)
        items = heard(source, is_message, len(sent))
        source.close()

    got = [item for item in items if isinstance(item, Received)]
    assert [(g.message.connection.topic, g.message.payload, g.sent_ns) for g in got] == [
        (m.connection.topic, bytes(m.payload), m.stamp_ns) for m in sent
    ]
    offered = {m.connection.topic: m.connection for m in recorded()}
    assert {(c.topic, c.type, c.encoding, c.definition) for c in announced(items)} == {
        (c.topic, c.type, "cdr", c.definition) for c in offered.values()
    }


def test_it_keeps_the_contract(subtests: pytest.Subtests) -> None:
    with stand_in() as server, sending(server.subscribed, server.send):
        for check in source_checks(lambda: source_at(server.address)):
            with subtests.test(check.name):
                check()


def test_what_rests_on_silence_is_open(tmp_path: Path) -> None:
    with stand_in() as server, sending(server.subscribed, server.send):
        settings = Settings(period_s=1e9, tail_period_s=1e9, apart=False)
        source = Until(source_at(server.address), len(recorded()))
        result = Watch(source, prepare("paper2020"), tmp_path / "seen.mcap", settings=settings).run()

    assert "unseen_losses" in {d.kind for d in result.measured.log_defects}
    (found,) = (f for f in result.measured.findings.values() if f.check == "no_arm_collision")
    assert found.verdict is Verdict.INCONCLUSIVE
    assert as_json(result) == as_json(score_trial(tmp_path / "seen.mcap", "paper2020"))


def test_a_server_that_is_gone_and_back_is_said_and_goes_on_with_its_channels() -> None:
    first = recorded()[0]
    with stand_in() as server:
        port = server.port
        source = source_at(server.address)
        source.open(None)
        until(server.subscribed, "subscribed")
        server.send(first)
        before = heard(source, is_message)
    gone_s = time.monotonic()
    heard(source, lambda item: isinstance(item, Disconnected))
    assert time.monotonic() - gone_s < 2
    with stand_in(port) as server:
        until(server.subscribed, "subscribed again")
        server.send(first)
        after = heard(source, is_message)
        source.close()
    assert announced(before)
    assert announced(after) == []
    assert any(isinstance(item, Reconnected) for item in after)


def test_a_topic_that_comes_late_and_one_that_changes_its_type() -> None:
    words = Connection("/words", "std_msgs/msg/String", "cdr", "string data\n", "ros2msg")
    number = replace(words, type="std_msgs/msg/Int32", definition="int32 data\n")
    with stand_in() as server:
        source = source_at(server.address)
        source.open(frozenset({"/words"}))
        items = []
        for one, payload in ((words, b"\0\1\0\0\2\0\0\0a\0"), (number, b"\0\1\0\0\1\0\0\0")):
            server.offer(one)
            end_s = time.monotonic() + 10
            while payloads(items, "/words")[-1:] != [payload]:
                assert time.monotonic() < end_s
                server.send(Message(one, 1, payload))
                if (item := source.next(0.05)) is not None:
                    items.append(item)
        source.close()
    assert [one.type for one in announced(items)] == ["std_msgs/msg/String", "std_msgs/msg/Int32"]


def test_a_message_of_100_mb_arrives() -> None:
    with stand_in() as server:
        source = source_at(server.address)
        source.open(None)
        until(server.subscribed, "subscribed")
        server.send(recorded()[0]._replace(payload=bytes(100_000_000)))
        (message,) = (i.message for i in heard(source, is_message) if isinstance(i, Received))
        source.close()
    assert len(message.payload) == 100_000_000


def test_what_is_no_rosbridge_with_rosapi_is_refused_in_words() -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        port = server.getsockname()[1]
        with pytest.raises(LiveError, match="refused"):
            source_at(f"rosbridge://127.0.0.1:{port}").open(None)
    with stand_in(rosapi=False) as one, pytest.raises(LiveError, match="does the node rosapi run"):
        source_at(one.address).open(None)
