"""A cell with a rosbridge server: `rosbridge://HOST:PORT`.

Source: the rosbridge v2 protocol, with `cbor-raw`, the one encoding that keeps the bytes of a message.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ariac_score.errors import LiveError, UsageError
from ariac_score.live.dialled import OPEN_S, DialledSource, GoneError, host_and_port
from ariac_score.live.websocket import WebSocket
from ariac_score.logs.containers.items import Connection, normalised_type

__all__ = ["RosbridgeSource"]

_PORT = 9090
_LOOK_AGAIN_S = 0.5
_GRAPH = "/rosapi/topics_and_raw_types"
_USAGE = "give rosbridge://HOST:PORT (9090 by default); the node rosapi must run beside it"


@dataclass
class _Session:
    """One connection to a server, and what was asked of it."""

    socket: WebSocket
    loads: Callable[[bytes], Any]
    subscribed: dict[str, Connection] = field(default_factory=dict)
    asked_s: float = 0.0
    """When it was last asked which topics there are."""
    waits: bool = False


class RosbridgeSource(DialledSource):
    """Subscribes at a rosbridge server, of ROS 1 or ROS 2.

    The server's own subscription keeps ten messages of a topic, nothing is numbered and nothing is said:
    losses are not seen. A topic that the server does not let through is as silent as one that nobody sends.
    """

    sees_losses = False

    def __init__(self, address: str) -> None:
        super().__init__(address)
        self._host, self._port = host_and_port(address, _PORT, _USAGE)

    def dial(self) -> _Session:
        """Connect, and ask which topics there are."""
        loads = _decoder()
        socket = WebSocket.to(self._host, self._port, secure=False, what="a rosbridge server")
        session = _Session(socket, loads)
        try:
            self._ask(session)
            end_s = time.monotonic() + OPEN_S
            while session.waits:
                self._take(session, session.socket.greeting())
                if time.monotonic() > end_s:
                    raise GoneError("it does not say which topics there are")
        except GoneError as error:
            session.socket.end()
            raise LiveError(f"{self.address}: {error}", hint=_USAGE) from None
        return session

    def listen(self, session: _Session) -> None:
        """Take messages, and ask for new topics now and then."""
        while not self.closing.is_set():
            if not session.waits and time.monotonic() - session.asked_s > _LOOK_AGAIN_S:
                self._ask(session)
            if session.waits and time.monotonic() - session.asked_s > 2 * OPEN_S:
                session.waits = False  # it may come later; a silent server is found out by its pings
            raw = session.socket.try_take(_LOOK_AGAIN_S)
            if raw is not None:
                self._take(session, raw)

    def hang_up(self, session: _Session) -> None:
        """Close the socket."""
        session.socket.end()

    def _ask(self, session: _Session) -> None:
        session.waits, session.asked_s = True, time.monotonic()
        session.socket.say(json.dumps({"op": "call_service", "id": _GRAPH, "service": _GRAPH, "args": {}}))

    def _take(self, session: _Session, raw: str | bytes) -> None:
        stamp_ns = self.heard()
        if isinstance(raw, bytes):
            self._message(session, raw, stamp_ns)
            return
        said = json.loads(raw)
        if not isinstance(said, dict) or said.get("id") != _GRAPH:
            return
        session.waits = False
        values = said.get("values")
        if said.get("result") is False or not isinstance(values, dict):
            raise GoneError(f"it does not answer {_GRAPH}: {values!r}; does the node rosapi run?")
        lists = (values.get("topics"), values.get("types"), values.get("typedefs_full_text"))
        for topic, type_, definition in zip(*(each or () for each in lists), strict=False):
            known = session.subscribed.get(topic)
            if known is not None and known.type != normalised_type(type_):
                session.socket.say(json.dumps({"op": "unsubscribe", "topic": topic}))
                known = None
            if self.wants(topic) and known is None:
                self._subscribe(session, str(topic), str(type_), str(definition))

    def _subscribe(self, session: _Session, topic: str, type_: str, definition: str) -> None:
        # Types of ROS 2 have three parts.
        encoding, format_ = ("cdr", "ros2msg") if type_.count("/") == 2 else ("ros1", "ros1msg")
        session.subscribed[topic] = self.channels.announce(topic, type_, encoding, definition, format_)
        asked = {"op": "subscribe", "id": topic, "topic": topic, "type": type_, "compression": "cbor-raw"}
        session.socket.say(json.dumps(asked))

    def _message(self, session: _Session, raw: bytes, stamp_ns: int) -> None:
        said = session.loads(raw)
        if not isinstance(said, dict):
            return
        connection, message = session.subscribed.get(str(said.get("topic"))), said.get("msg")
        if said.get("op") != "publish" or connection is None or not isinstance(message, Mapping):
            return
        payload, secs, nsecs = (message.get(name) for name in ("bytes", "secs", "nsecs"))
        if isinstance(payload, bytes):
            sent_ns = secs * 10**9 + nsecs if isinstance(secs, int) and isinstance(nsecs, int) else None
            self.received(connection, payload, stamp_ns, sent_ns)


def _decoder() -> Callable[[bytes], Any]:
    """Of binary frames.

    Raises:
        UsageError: The library is not installed.
    """
    try:
        from cbor2 import loads  # noqa: PLC0415  # not everybody has it
    except ImportError as missing:
        hint = "pip install 'ariac-score[rosbridge]'"
        raise UsageError("the library 'cbor2' is not installed", hint=hint) from missing
    return loads
