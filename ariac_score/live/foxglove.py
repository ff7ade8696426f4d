"""A cell with a foxglove_bridge: `foxglove://HOST:PORT`, `ws://…` or `wss://…`.

Source: the Foxglove WebSocket protocol, `foxglove.websocket.v1` and `foxglove.sdk.v1`.
"""

from __future__ import annotations

import json
import re
import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ariac_score.errors import LiveError
from ariac_score.live.dialled import DialledSource, GoneError, host_and_port
from ariac_score.live.source import Lost
from ariac_score.live.websocket import WebSocket
from ariac_score.logs.containers.items import Connection

__all__ = ["FoxgloveSource"]

_PORT = 8765
_SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""A server accepts only its own, so both are offered."""
_MESSAGE = struct.Struct("<BIQ")
_OP_MESSAGE = 1
_ROS = {"cdr": "ros2msg", "ros1": "ros1msg"}
"""The encodings that can be judged, and the format of definitions where the server does not name it."""
_OWN = ("/foxglove_bridge/",)
"""What the bridge says of itself."""
_REFUSED = re.compile(r"unknown channel\D*(\d{1,20})", re.IGNORECASE)
"""A server of the SDK may offer a channel a moment before it takes subscriptions of it."""
_ASKED_AGAIN, _FIRST_PAUSE_S = 8, 0.001
"""Each pause is twice the one before: a quarter of a second in all, for messages wait meanwhile."""
_USAGE = "give foxglove://HOST:PORT (8765 by default), ws://HOST:PORT or wss://HOST:PORT"


@dataclass
class _Session:
    """One connection to a bridge, and what it has offered."""

    socket: WebSocket
    subscribed: dict[int, Connection] = field(default_factory=dict)
    """By subscription, which has the number of its channel."""
    asked_again: Counter[int] = field(default_factory=Counter)
    """How often, by channel."""
    waiting: list[Mapping[str, Any]] = field(default_factory=list)
    """What came before the server had named itself."""


class FoxgloveSource(DialledSource):
    """Subscribes at a foxglove_bridge, of ROS 1 or ROS 2.

    The bridge drops messages for a client that is slow, and bursts before it sees them, numbers nothing and
    says nothing: losses are not seen. Its own time of a message is recorded as the time of sending.
    """

    sees_losses = False

    def __init__(self, address: str) -> None:
        super().__init__(address)
        scheme = address.partition(":")[0].lower()
        self._host, self._port = host_and_port(address, _PORT, _USAGE)
        self._secure = scheme == "wss"

    def dial(self) -> _Session:
        """Connect, and wait for the server to name itself."""
        socket = WebSocket.to(
            self._host, self._port, secure=self._secure, subprotocols=_SUBPROTOCOLS, what="a foxglove_bridge"
        )
        session = _Session(socket)
        try:
            while (said := _json(socket.greeting())).get("op") != "serverInfo":
                session.waiting.append(said)
        except GoneError as error:
            socket.end()
            raise LiveError(
                f"{self.address} answers, and is no foxglove_bridge: {error}", hint=_USAGE
            ) from None
        self._named(said)
        return session

    def listen(self, session: _Session) -> None:
        """Take channels and messages until the connection ends."""
        for said in session.waiting:
            self._take(session, said)
        while True:
            raw = session.socket.take()
            stamp_ns = self.heard()
            if isinstance(raw, str):
                self._take(session, _json(raw))
            elif len(raw) >= _MESSAGE.size and raw[0] == _OP_MESSAGE:
                _, subscription, sent_ns = _MESSAGE.unpack_from(raw)
                connection = session.subscribed.get(subscription)
                if connection is not None:
                    self.received(connection, raw[_MESSAGE.size :], stamp_ns, sent_ns or None)

    def hang_up(self, session: _Session) -> None:
        """Close the socket."""
        session.socket.end()

    def _named(self, said: Mapping[str, Any]) -> None:
        identity = said.get("sessionId")
        self.server = None if identity is None else str(identity)

    def _take(self, session: _Session, said: Mapping[str, Any]) -> None:
        op = said.get("op")
        if op == "advertise":
            self._subscribe(session, said.get("channels") or [])
        elif op == "unadvertise":
            for channel in said.get("channelIds") or []:
                session.subscribed.pop(channel, None)
        elif op == "serverInfo":
            before = self.server
            self._named(said)
            if self.server != before:
                raise GoneError("the bridge began a new session")
        elif op == "status" and said.get("level") != 0:
            message = str(said.get("message"))
            if "buffer limit" in message:
                self.lost_any(message)
            elif refused := _REFUSED.search(message):
                self._ask_again(session, int(refused[1]))

    def _subscribe(self, session: _Session, channels: list[Mapping[str, Any]]) -> None:
        asked = []
        for one in channels:
            number, topic = one.get("id"), one.get("topic")
            if not isinstance(number, int) or not isinstance(topic, str) or number in session.subscribed:
                continue
            if not self.wants(topic) or topic.startswith(_OWN):
                continue
            encoding = str(one.get("encoding") or "")
            definition = str(one.get("schema") or "") if encoding in _ROS else ""
            session.subscribed[number] = self.channels.announce(
                topic,
                str(one.get("schemaName") or ""),
                encoding,
                definition,
                str(one.get("schemaEncoding") or _ROS.get(encoding, "")),
            )
            asked.append(number)
        if asked:
            session.socket.say(_subscriptions(asked))

    def _ask_again(self, session: _Session, number: int) -> None:
        """Subscribe once more to a channel that is still offered; one that goes on being refused is lost."""
        connection, before = session.subscribed.get(number), session.asked_again[number]
        session.asked_again[number] += 1
        if connection is None or before > _ASKED_AGAIN:
            return
        if before == _ASKED_AGAIN:
            words = "the bridge offers it and refuses to send it"
            self.put(Lost(connection.topic, self._heard_ns, self._heard_ns, words))
            return
        self.closing.wait(_FIRST_PAUSE_S * 2**before)
        session.socket.say(_subscriptions([number]))


def _subscriptions(numbers: list[int]) -> str:
    asked = [{"id": number, "channelId": number} for number in numbers]
    return json.dumps({"op": "subscribe", "subscriptions": asked})


def _json(raw: str | bytes) -> Mapping[str, Any]:
    """What a text frame says; nothing where it is no object."""
    if isinstance(raw, bytes):
        return {}
    try:
        said = json.loads(raw)
    except ValueError:
        return {}
    return said if isinstance(said, dict) else {}
