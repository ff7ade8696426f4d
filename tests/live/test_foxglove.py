"""A cell behind a bridge of either subprotocol: servers of the protocol's makers, on loopback."""

from __future__ import annotations

import asyncio
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
from websockets.sync.server import serve

from ariac_score import Result, Verdict, as_json, score_trial
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LiveError, UsageError
from ariac_score.live.source import Disconnected, LiveSource, Lost, Received, source_at
from ariac_score.live.watch import Settings, Watch
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.testing import source_checks

sys.path.insert(0, str(Path(__file__).parent))
from live_servers import EXAMPLE, Until, announced, heard, is_message, payloads, recorded, sending, until

foxglove = pytest.importorskip("foxglove", reason="the server of the Foxglove SDK is not installed")
pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

TEXT = Connection("/words", "std_msgs/msg/String", "cdr", "string data\n", "ros2msg")
GO, END = (b"\0\1\0\0" + (len(w) + 1).to_bytes(4, "little") + w + b"\0" for w in (b"go", b"end"))


class Bridge:
    """A server of the Foxglove SDK that offers topics as foxglove_bridge does."""

    def __init__(self, port: int = 0, session: str = "one", **options: int) -> None:
        self.context = foxglove.Context()
        self.server = foxglove.start_server(
            host="127.0.0.1", port=port, session_id=session, context=self.context, **options
        )
        self._channels: dict[object, foxglove.Channel] = {}

    @property
    def address(self) -> str:
        """For `watch`."""
        return f"foxglove://127.0.0.1:{self.server.port}"

    def offer(self, connection: Connection) -> foxglove.Channel:
        """Advertise a channel."""
        if connection not in self._channels:
            schema = foxglove.Schema(
                name=connection.type,
                encoding=connection.definition_format or "ros2msg",
                data=connection.definition.encode(),
            )
            self._channels[connection] = foxglove.Channel(
                connection.topic,
                message_encoding=connection.encoding,
                schema=schema if connection.definition else None,
                context=self.context,
            )
        return self._channels[connection]

    def send(self, message: Message) -> None:
        """Publish a message."""
        self.offer(message.connection).log(bytes(message.payload), log_time=message.stamp_ns)

    def subscribed(self) -> bool:
        """Whether everything that is offered has a subscriber."""
        return all(channel.has_sinks() for channel in self._channels.values())


@contextmanager
def bridge(port: int = 0, session: str = "one", **options: int) -> Iterator[Bridge]:
    """A running bridge."""
    one = Bridge(port, session, **options)
    try:
        yield one
    finally:
        one.server.stop()


class Way:
    """A port that leads to a bridge, or to none: a bridge's own port is not free again at once."""

    def __init__(self) -> None:
        self.leads_to: int | None = None
        self._door = socket.create_server(("127.0.0.1", 0))
        self.address = f"foxglove://127.0.0.1:{self._door.getsockname()[1]}"
        threading.Thread(target=self._open, daemon=True).start()

    def _open(self) -> None:
        while True:
            try:
                comes, _ = self._door.accept()
            except OSError:
                return  # it was closed
            if self.leads_to is None:
                comes.close()
                continue
            goes = socket.create_connection(("127.0.0.1", self.leads_to))
            for one, other in ((comes, goes), (goes, comes)):
                threading.Thread(target=self._carry, args=(one, other), daemon=True).start()

    @staticmethod
    def _carry(one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(1 << 16):
                other.sendall(data)
        for each in (one, other):
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def close(self) -> None:
        """Nobody comes any more."""
        with suppress(OSError):
            self._door.shutdown(socket.SHUT_RDWR)
        self._door.close()


@contextmanager
def older_bridge() -> Iterator[str]:
    """The server before the SDK; it sends two messages of `/words` to whoever subscribes."""
    older = pytest.importorskip("foxglove_websocket.server", reason="the older server is not installed")

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    over, ready = threading.Event(), threading.Event()

    class Listener(older.FoxgloveServerListener):  # type: ignore[misc]
        async def on_subscribe(self, server: Any, channel_id: int) -> None:
            for number, words in enumerate((GO, END)):
                await server.send_message(channel_id, 5 + number, words)

        async def on_unsubscribe(self, server: Any, channel_id: int) -> None:
            pass

    async def serve() -> None:
        async with older.FoxgloveServer("127.0.0.1", port, "older") as server:
            server.set_listener(Listener())
            await server.add_channel(
                {
                    "topic": TEXT.topic,
                    "encoding": "ros1",
                    "schemaName": "std_msgs/String",
                    "schema": TEXT.definition,
                    "schemaEncoding": None,
                }
            )
            ready.set()
            while not over.is_set():
                await asyncio.sleep(0.02)

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    thread.start()
    try:
        assert ready.wait(10)
        yield f"ws://127.0.0.1:{port}"
    finally:
        over.set()
        thread.join(10)


def _opened(address: str, topics: frozenset[str] | None = None) -> LiveSource:
    source = source_at(address)
    end_s = time.monotonic() + 10
    while True:  # the older server listens a moment after it says so
        try:
            source.open(topics)
        except LiveError:
            assert time.monotonic() < end_s
            time.sleep(0.05)
        else:
            return source


def _watch(source: LiveSource, record: Path, *, patience_s: float = 1.0) -> tuple[Result, Watch]:
    settings = Settings(period_s=1e9, tail_period_s=1e9, patience_s=patience_s, apart=False)
    watch = Watch(source, prepare("paper2020"), record, settings=settings)
    return watch.run(), watch


def test_every_byte_of_a_bridge_of_today_arrives() -> None:
    sent = recorded()[:500]
    with bridge() as server:
        for message in sent:
            server.offer(message.connection)
        before_ns = time.time_ns()
        source = _opened(server.address)
        until(server.subscribed, "subscribed")
        for message in sent:
            server.send(message)
        items = heard(source, is_message, len(sent))
        source.close()

    got = [item for item in items if isinstance(item, Received)]
    assert [(g.message.connection.topic, g.message.payload, g.sent_ns) for g in got] == [
        (m.connection.topic, bytes(m.payload), m.stamp_ns) for m in sent
    ]
    assert all(before_ns <= g.message.stamp_ns <= time.time_ns() for g in got)
    offered = {m.connection.topic: m.connection for m in sent}
    for one in announced(items):
        known = offered[one.topic]
        assert (one.type, one.encoding, one.definition) == (known.type, known.encoding, known.definition)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_bridge_of_ros_1_before_the_sdk_is_understood() -> None:
    with older_bridge() as address:
        source = _opened(address)
        items = heard(source, is_message, 2)
        source.close()

    (connection,) = announced(items)
    assert (connection.type, connection.encoding, connection.definition_format) == (
        "std_msgs/msg/String",
        "ros1",
        "ros1msg",
    )
    assert payloads(items, "/words") == [GO, END]
    assert [item.sent_ns for item in items if isinstance(item, Received)] == [5, 6]


def test_it_keeps_the_contract(subtests: pytest.Subtests) -> None:
    with bridge() as server:
        for message in recorded():
            server.offer(message.connection)
        with sending(server.subscribed, server.send):
            for check in source_checks(lambda: source_at(server.address)):
                with subtests.test(check.name):
                    check()


def test_silence_of_a_topic_shows_nothing_for_a_bridge_drops_in_silence(tmp_path: Path) -> None:
    with bridge() as server:
        for message in recorded():
            server.offer(message.connection)
        with sending(server.subscribed, server.send):
            result, _ = _watch(Until(source_at(server.address), 4008), tmp_path / "seen.mcap")

    (said,) = (d for d in result.measured.log_defects if d.kind == "unseen_losses")
    assert "says nothing of it" in said.message
    assert result.measured.witnessed == ()
    # Nobody can say that no arm collided; a bag of the same messages says so.
    own = score_trial(EXAMPLE, "paper2020")
    (check,) = (k for k in own.measured.findings if k.startswith("no_arm_collision"))
    assert own.measured.findings[check].verdict is Verdict.SATISFIED
    assert result.measured.findings[check].verdict is Verdict.INCONCLUSIVE
    assert as_json(result) == as_json(score_trial(tmp_path / "seen.mcap", "paper2020"))


def test_a_bridge_that_is_gone_for_ten_seconds_leaves_a_gap(tmp_path: Path) -> None:
    messages = recorded()
    half = len(messages) // 2
    notes: list[tuple[float, str]] = []
    way = Way()
    with bridge() as server:
        way.leads_to = server.server.port
        for message in messages:
            server.offer(message.connection)
        source = source_at(way.address)
        record = tmp_path / "seen.mcap"

        def say(state: object) -> None:
            new = getattr(state, "notes", ())[len(notes) :]
            notes.extend((time.monotonic(), note.text) for note in new)

        watch = Watch(source, prepare("paper2020"), record, settings=Settings(patience_s=120.0), told=say)
        results: list[Result] = []
        thread = threading.Thread(target=lambda: results.append(watch.run()), daemon=True)
        thread.start()
        until(server.subscribed, "subscribed")
        for message in messages[:half]:
            # Nothing is known since the last of these, however long it takes to read it.
            last_s = time.monotonic()
            server.send(message)
            time.sleep(0.001)
        until(lambda: watch.state.messages >= half, "half")
        stopped_s = time.monotonic()
        way.leads_to = None
        server.server.stop()
        until(lambda: len(notes) > 0, "the gap is said when it begins", 2.0)
        time.sleep(10)
    with bridge(session="two") as server:
        for message in messages:
            server.offer(message.connection)
        way.leads_to = server.server.port
        until(server.subscribed, "subscribed again")
        for message in messages[half:]:
            server.send(message)
            time.sleep(0.001)
        until(lambda: watch.state.messages >= len(messages), "the rest")
        watch.stop()
        thread.join(30)
    way.close()

    assert "the source is gone" in notes[0][1]
    assert notes[0][0] - stopped_s < 2.0
    back_s, gap = next(note for note in notes if "the source is back" in note[1])
    assert 9.9 < float(gap.split()[-2]) < back_s - last_s + 0.1
    (missing,) = (d for d in results[0].measured.log_defects if d.kind == "missing_messages")
    assert missing.where == "/snapshot"
    assert as_json(results[0]) == as_json(score_trial(record, "paper2020"))


@pytest.mark.parametrize("what", ["unknown", "retyped", "huge", "two", "back"])
def test_bad_input_is_said_and_counts_as_in_a_recording(what: str, tmp_path: Path) -> None:
    messages = recorded()
    orders = next(m for m in messages if m.connection.topic == "/ariac/orders")
    snapshot = next(m.connection for m in messages if m.connection.topic == "/snapshot")
    extra: list[Message] = []
    if what == "unknown":
        extra = [orders._replace(connection=replace(orders.connection, definition="ours/Unknown[] x\n"))]
    elif what == "retyped":
        extra = [Message(replace(TEXT, topic="/ariac/orders"), 1, GO)]
    elif what == "huge":
        extra = [Message(orders.connection, 1, b"\0\1\0\0" + b"\xff" * 100_000_000)]
    elif what == "two":
        twin = replace(snapshot, definition=f"{snapshot.definition}\n# of another\n")
        extra = [m._replace(connection=twin) for m in messages if m.connection is snapshot][-50:]
    sent = [*messages, *extra]
    if what == "two":
        sent = [*messages[:-50], *(m for pair in zip(messages[-50:], extra, strict=True) for m in pair)]
    if what == "back":
        sent = [m._replace(stamp_ns=10**18 - i) for i, m in enumerate(messages)]  # the bridge's clock
    with bridge() as server:
        for message in sent:
            server.offer(message.connection)
        source = Until(source_at(server.address), len(sent))
        with sending(server.subscribed, server.send, sent):
            result, watch = _watch(source, tmp_path / "seen.mcap")

    said = {d.kind: d.message for d in result.measured.log_defects}
    notes = " ".join(note.text for note in watch.state.notes)
    if what == "unknown":
        assert any("Unknown" in one or "/ariac/orders" in one for one in result.measured.unrecorded)
    elif what == "retyped":
        # Which of both a bridge announces first is its own affair.
        assert "topic /ariac/orders is now" in notes
        assert "std_msgs/msg/String" in notes
    elif what == "huge":
        assert "undecodable_messages" in said
    elif what == "two":
        assert "two publishers" in said["two_publishers"]
    else:  # judged by the referee's own clock, which ran on
        assert "back" not in notes
    assert as_json(result) == as_json(score_trial(tmp_path / "seen.mcap", "paper2020"))


def test_what_is_no_bridge_is_refused_in_words() -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        port = server.getsockname()[1]  # bound, and nobody listens
        with pytest.raises(LiveError, match="refused"):
            source_at(f"foxglove://127.0.0.1:{port}").open(None)
    with pytest.raises(UsageError, match="names no host"):
        source_at("foxglove://:8765")
    shown = source_at("ws://me:secret@cell:8765/?token=x").address
    assert shown == "ws://cell:8765/"


def test_a_server_of_something_else_is_refused() -> None:
    def answer(connection: object) -> None:
        connection.send(json.dumps({"op": "hello"}))  # type: ignore[attr-defined]
        connection.close()  # type: ignore[attr-defined]

    with serve(answer, "127.0.0.1", 0, subprotocols=["foxglove.sdk.v1"]) as server:  # type: ignore[list-item]
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = server.socket.getsockname()[1]
        with pytest.raises(LiveError, match="is no foxglove_bridge"):
            source_at(f"foxglove://127.0.0.1:{port}").open(None)
        server.shutdown()


@contextmanager
def _refusing(times: int) -> Iterator[str]:
    """A server that offers `/words`, and refuses so many subscriptions of it before it sends two messages.

    What the SDK's server was seen to answer: it names a channel that it does not know yet.
    """

    def answer(connection: Any) -> None:
        connection.send(json.dumps({"op": "serverInfo", "name": "one", "capabilities": [], "sessionId": "1"}))
        channel = {
            "id": 7,
            "topic": TEXT.topic,
            "encoding": "cdr",
            "schemaName": TEXT.type,
            "schema": TEXT.definition,
        }
        connection.send(json.dumps({"op": "advertise", "channels": [channel]}))
        for _ in range(times):
            assert json.loads(connection.recv(10))["subscriptions"] == [{"id": 7, "channelId": 7}]
            connection.send(json.dumps({"op": "status", "level": 2, "message": "Unknown channel ID: 7"}))
        with suppress(TimeoutError):
            connection.recv(1 if times > 8 else 10)
            for number, words in enumerate((GO, END)):
                connection.send(
                    b"\1" + (7).to_bytes(4, "little") + (5 + number).to_bytes(8, "little") + words
                )
        with suppress(Exception):  # until the client hangs up
            connection.recv(10)

    with serve(answer, "127.0.0.1", 0, subprotocols=["foxglove.sdk.v1"]) as server:  # type: ignore[list-item]
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"foxglove://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()


@pytest.mark.parametrize("times", [1, 8])
def test_a_subscription_that_was_refused_is_asked_for_again(times: int) -> None:
    with _refusing(times) as address:
        source = _opened(address)
        items = heard(source, is_message, 2)
        source.close()
    assert payloads(items, "/words") == [GO, END]
    assert not [item for item in items if isinstance(item, Lost)]


def test_a_topic_that_goes_on_being_refused_is_told_as_lost_and_the_rest_goes_on() -> None:
    with _refusing(9) as address:
        source = _opened(address)
        items = heard(source, lambda item: isinstance(item, Lost))
        source.close()
    (lost,) = [item for item in items if isinstance(item, Lost)]
    assert (lost.topic, lost.cause) == ("/words", "the bridge offers it and refuses to send it")
    assert not [item for item in items if isinstance(item, Disconnected)]
