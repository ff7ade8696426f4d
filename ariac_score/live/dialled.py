"""What sources share that dial one server: a thread that listens, dials again, and says what it missed."""

from __future__ import annotations

import re
import threading
import time
from abc import ABC, abstractmethod
from collections import Counter
from contextlib import suppress
from typing import Any, Literal
from urllib.parse import urlsplit, urlunsplit

from ariac_score.errors import LiveError, UsageError
from ariac_score.live.inbox import Inbox
from ariac_score.live.source import Announced, Disconnected, Ended, LiveItem, Lost, Received, Reconnected
from ariac_score.logs.containers.items import Connection, Message, normalised_type

__all__ = [
    "LARGEST_BYTES",
    "OPEN_S",
    "Channels",
    "DialledSource",
    "GoneError",
    "host_and_port",
    "shown_address",
]

OPEN_S = 5.0
"""How long a server may take to answer, s."""
LARGEST_BYTES = 1 << 28
"""A message may be so large; what announces more is taken for an attack, or for a mistake."""
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.1, 2.0


class GoneError(Exception):
    """The connection is over; says why."""


def shown_address(address: str) -> str:
    """An address without what is secret in it.

    >>> shown_address("ws://me:secret@cell:8765/?token=secret")
    'ws://cell:8765/'
    """
    parts = urlsplit(address)
    return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path, "", ""))


class Channels:
    """The channels of a source: one that comes back as it was is the same, and is announced once.

    So its messages go on being numbered where they were, and what was missed in between shows.
    """

    def __init__(self, inbox: Inbox, *, sees_losses: bool) -> None:
        self._inbox, self._sees_losses = inbox, sees_losses
        self._known: dict[tuple[object, ...], Connection] = {}
        self._here: Counter[tuple[object, ...]] = Counter()

    def forget(self) -> None:
        """A new connection begins: every channel may come again."""
        self._here.clear()

    def announce(
        self,
        topic: str,
        type_: str,
        encoding: str,
        definition: str,
        format_: str,
        *,
        publisher: str = "",
        latched: bool = False,
        sees_losses: bool | None = None,
    ) -> Connection:
        """The connection of a channel that the source names."""
        shows = self._sees_losses if sees_losses is None else sees_losses
        format_ = format_ if definition else ""
        facts = f"/{topic.lstrip('/')}", normalised_type(type_), encoding, definition, format_, publisher
        # Two that look the same at one time are two, or their numbers would run through each other.
        self._here[facts] += 1
        key = *facts, self._here[facts]
        found = self._known.get(key)
        if found is None:
            found = self._known[key] = Connection(*facts, sees_losses=shows)
            self._inbox.put(Announced(found, latched))
        return found


class DialledSource(ABC):
    """A source that one server feeds, over one connection at a time.

    Args:
        address: As given.
        inbox: Where items wait.

    Attributes:
        server: What tells the server from one that was started again; `None` where it does not say.
    """

    sees_losses: bool = False
    stamps: Literal["arrival", "recorder"] = "arrival"
    end_s: float = 1.5
    """How long a thread that still dials may take to end, s."""

    def __init__(self, address: str, *, inbox: Inbox | None = None) -> None:
        self._given, self.address = address, shown_address(address)
        self._inbox = inbox or Inbox()
        self.channels = Channels(self._inbox, sees_losses=self.sees_losses)
        self.topics: frozenset[str] | None = None
        self.closing = threading.Event()
        self._heard_ns = self._lost_ns = 0
        self.server: str | None = None
        self._session: Any = None
        self._same: bool | None = None
        self._thread: threading.Thread | None = None
        self._ended: Ended | None = None

    # What each source does in its own way

    @abstractmethod
    def dial(self) -> Any:
        """A new session: connected, greeted, and asked for its topics.

        Raises:
            LiveError: Nothing answers, or something else does.
        """

    @abstractmethod
    def listen(self, session: Any) -> None:
        """Hear a session until it is over; everything is given by `received` and `channels`.

        Raises:
            GoneError: It is over.
        """

    @abstractmethod
    def hang_up(self, session: Any) -> None:
        """End a session; it may be called from any thread, and must not wait for the other side."""

    # What is the same for all

    def wants(self, topic: str) -> bool:
        """Whether a topic was asked for."""
        return self.topics is None or topic in self.topics or f"/{topic.lstrip('/')}" in self.topics

    def heard(self) -> int:
        """The time at which bytes have just come, ns."""
        self._heard_ns = time.time_ns()
        return self._heard_ns

    def received(
        self,
        connection: Connection,
        payload: bytes,
        stamp_ns: int,
        sent_ns: int | None,
        sequence: int = 0,
    ) -> None:
        """Give a message."""
        self._inbox.put(Received(Message(connection, stamp_ns, payload, sequence), sent_ns))

    def lost_any(self, cause: str) -> None:
        """Give that the server has dropped messages, of topics that it does not name."""
        since_ns, self._lost_ns = self._lost_ns or self._heard_ns, self._heard_ns
        self.put(Lost("", since_ns, self._heard_ns, cause))

    def put(self, item: LiveItem) -> None:
        """Give any other item."""
        self._inbox.put(item)

    def open(self, topics: frozenset[str] | None) -> None:
        """Connect, and listen from now on."""
        self.topics = topics
        session = self.dial()
        self.heard()
        self._session = session
        self._thread = threading.Thread(target=self._stay, args=(session,), name=self.address, daemon=True)
        self._thread.start()

    def next(self, timeout_s: float) -> LiveItem | None:
        """The next item."""
        item = self._inbox.get(timeout_s) if self._ended is None else self._ended
        if isinstance(item, Ended):
            self._ended = item
        return item

    def close(self) -> None:
        """Hang up."""
        self.closing.set()
        if self._thread is not None:
            with suppress(Exception):
                self.hang_up(self._session)
            self._thread.join(self.end_s)
            self._thread = None
        self._ended = self._ended or Ended("it was closed")

    def _stay(self, session: Any) -> None:
        """Listen; where the connection ends, dial until it is back or closed."""
        while not self.closing.is_set():
            try:
                self.listen(session)
                cause = "the connection ended"
            except (GoneError, LiveError) as gone:
                cause = str(gone)
            except Exception as error:  # noqa: BLE001  # a server that says nonsense, however it fails
                cause = f"it says what makes no sense: {type(error).__name__}: {error}"[:300]
            with suppress(Exception):
                self.hang_up(session)
            if self.closing.is_set():
                return
            since_ns = self._heard_ns
            self.put(Disconnected(since_ns, cause))
            again = self._dial_again()
            if again is None:
                return
            self._session = session = again
            self.put(Reconnected(since_ns, self.heard(), self._same))

    def _dial_again(self) -> Any:
        pause_s, before = _FIRST_PAUSE_S, self.server
        while not self.closing.wait(pause_s):
            pause_s = min(2 * pause_s, _LONGEST_PAUSE_S)
            self.channels.forget()
            before, self.server = self.server or before, None
            try:
                session = self.dial()
            except Exception:  # noqa: BLE001, S112  # as above; the next try may find it well
                continue
            self._same = None if before is None or self.server is None else before == self.server
            return session
        return None


_HOST = re.compile(r"[\w.:\[\]-]+", re.ASCII)


def host_and_port(address: str, default_port: int, usage: str) -> tuple[str, int]:
    """The host and port of an address.

    Raises:
        UsageError: It has none.

    >>> host_and_port("ros1://cell", 11311, "")
    ('cell', 11311)
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname or "", parts.port or default_port
    except ValueError as error:
        raise UsageError(f"{shown_address(address)!r} is no address: {error}", hint=usage) from error
    if not _HOST.fullmatch(host):
        raise UsageError(f"{shown_address(address)!r} names no host", hint=usage)
    return host, port
