"""The WebSocket side of the oracle: connections, limits, and an end in which nothing is lost."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ariac_score.errors import UsageError
from ariac_score.logs.rosmonitoring import MAX_LINE_BYTES
from ariac_score.oracle.conversation import Conversation
from ariac_score.oracle.judges import Bench

if TYPE_CHECKING:
    from websockets.http11 import Request, Response
    from websockets.sync.server import Server, ServerConnection

__all__ = ["Limits", "Oracle"]

_TOO_BIG, _GOING_AWAY = 1009, 1001
_LAST_PORT = 65_535
_OPENING_S = 5.0
"""How long one who has connected may take to say that it speaks the protocol, s."""


@dataclass(frozen=True)
class Limits:
    """What one oracle takes on.

    Attributes:
        frame_bytes: A longer frame ends its connection.
        connections: Further ones are refused at the handshake, which a monitor takes for an
            absent oracle; refused later it would take the end for a verdict.
        events_per_s: A connection that sends more is read more slowly, not cut off; 0: any rate.
        closing_s: How long a client may take to say goodbye when the oracle stops, s.
    """

    frame_bytes: int = 1_000_000
    connections: int = 16
    events_per_s: float = 50_000.0
    closing_s: float = 2.0

    def __post_init__(self) -> None:
        if not 0 < self.frame_bytes <= MAX_LINE_BYTES:
            raise ValueError(f"a frame may have 1 to {MAX_LINE_BYTES:,} bytes, which a log can hold")
        if self.connections < 1 or not self.events_per_s >= 0 or not self.closing_s > 0:
            raise ValueError("at least one connection, a rate from 0, and time to close are needed")


class Pace:
    """Keeps a connection to a rate by making its thread wait; bursts of one second pass.

    Args:
        events_per_s: The rate; 0: any.
        wait: Waits so many seconds.
        now: The time, s.
    """

    def __init__(
        self, events_per_s: float, wait: Callable[[float], object], now: Callable[[], float] = time.monotonic
    ) -> None:
        self._rate, self._wait, self._now = events_per_s, wait, now
        self._left, self._at = events_per_s, now() if events_per_s else 0.0

    def step(self) -> None:
        """Take one event, waiting first where the rate asks for it."""
        if not self._rate:
            return
        if self._left < 1.0:
            now = self._now()
            self._left = min(self._rate, self._left + (now - self._at) * self._rate)
            self._at = now
        if self._left < 1.0:
            self._wait((1.0 - self._left) / self._rate)
            self._left = 1.0
            self._at = self._now()
        self._left -= 1.0


class Oracle:
    """Serves one state per connection.

    Args:
        bench: Makes the judges.
        folder: Where the event log of each connection goes; made where missing.
        host: Address to listen on.
        port: Port; 0 takes any free one.
        limits: What it takes on.

    Raises:
        UsageError: The address cannot be had, the folder cannot be written or holds
            something already, or the library for the protocol is not installed.
    """

    def __init__(
        self,
        bench: Bench,
        folder: Path,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        limits: Limits | None = None,
    ) -> None:
        self.conversations: list[Conversation] = []
        self.refused = 0
        self._bench, self._limits = bench, limits or Limits()
        self._folder = _empty_folder(folder)
        self._open: dict[ServerConnection, Conversation] = {}
        self._forced: set[ServerConnection] = set()
        self._changed = threading.Condition()
        self._stopping = threading.Event()
        self._server = self._listening(host, port)

    @property
    def url(self) -> str:
        """Where it is reached."""
        host, port = self._server.socket.getsockname()[:2]
        return f"ws://{f'[{host}]' if ':' in host else host}:{port}"

    def serve(self) -> None:
        """Answer until `stop` is called from another thread, or an interrupt comes."""
        self._server.serve_forever()

    def stop(self) -> None:
        """Take no more connections, end those that are open, and complete their logs."""
        self._stopping.set()
        # Where it waits for those who are connected, and some versions do, nobody else has to.
        closing = [threading.Thread(target=self._server.shutdown, daemon=True)]
        with self._changed:
            still_open = list(self._open)
        closing += [threading.Thread(target=_say_goodbye, args=(ws,), daemon=True) for ws in still_open]
        for thread in closing:
            thread.start()
        with self._changed:
            self._changed.wait_for(lambda: not self._open, timeout=self._limits.closing_s)
            self._forced |= self._open.keys()
        for ws in self._forced:  # a client that does not read keeps the goodbye from being sent
            with contextlib.suppress(OSError):
                ws.socket.shutdown(socket.SHUT_RDWR)
        with self._changed:
            self._changed.wait_for(lambda: not self._open, timeout=self._limits.closing_s)
        for thread in closing:
            thread.join(self._limits.closing_s)

    def _listening(self, host: str, port: int) -> Server:
        try:
            from websockets.sync.server import serve  # noqa: PLC0415  # only those who serve need it
        except ImportError as cause:
            raise UsageError(
                "the library `websockets` is not installed", hint="pip install 'ariac-score[live]'"
            ) from cause
        return serve(
            self._converse,
            sock=_bound(host, port),
            compression=None,
            max_size=self._limits.frame_bytes,
            process_request=self._admit,
            server_header=None,
            # A monitor reads only while it waits for a reply: it would answer no ping in between.
            ping_interval=None,
            open_timeout=_OPENING_S,
            close_timeout=self._limits.closing_s,
        )

    def _admit(self, ws: ServerConnection, _request: Request) -> Response | None:
        with self._changed:
            full = len(self._open) >= self._limits.connections or self._stopping.is_set()
            self.refused += full
        return ws.respond(503, "the oracle has all the connections it takes\n") if full else None

    def _converse(self, ws: ServerConnection) -> None:
        conversation = self._begin(ws)
        ended = "the oracle failed"
        try:
            ended = self._answer_all(ws, conversation)
        except OSError as cause:
            ended = f"its log cannot be written: {cause.strerror}"
        finally:
            with self._changed:
                conversation.close(ended)
                del self._open[ws]
                self._changed.notify_all()

    def _begin(self, ws: ServerConnection) -> Conversation:
        ws.socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        with self._changed:
            number = len(self.conversations) + 1
            log = self._folder / f"connection_{number:03}.jsonl"
            conversation = Conversation(self._bench.judge(), log)
            self.conversations.append(conversation)
            self._open[ws] = conversation
        return conversation

    def _answer_all(self, ws: ServerConnection, conversation: Conversation) -> str:
        from websockets.exceptions import ConnectionClosed  # noqa: PLC0415  # as above

        pace = Pace(self._limits.events_per_s, self._stopping.wait)
        try:
            while True:
                # Bytes, so that text that is no UTF-8 is answered like any other bad frame.
                frame = ws.recv(decode=False)
                pace.step()
                ws.send(conversation.answer(frame))
        except ConnectionClosed as closed:
            if closed.rcvd_then_sent:
                return "closed by the client"
            if closed.sent is not None and closed.sent.code == _TOO_BIG:
                return f"a frame was longer than {self._limits.frame_bytes:,} bytes"
            return "stopped by the oracle" if closed.sent is not None or ws in self._forced else "lost"


def _bound(host: str, port: int) -> socket.socket:
    """A socket that listens.

    Raises:
        UsageError: The address cannot be had.
    """
    try:
        if not 0 <= port <= _LAST_PORT:  # some systems would take another one
            raise ValueError("ports are 0 to 65535")
        (family, *_, address), *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        return socket.create_server(address[:2], family=family)
    except (OSError, OverflowError, ValueError) as cause:
        reason = getattr(cause, "strerror", None) or str(cause)
        raise UsageError(
            f"cannot listen on {host}:{port}: {reason}", hint="choose another --port, or stop what uses it"
        ) from cause


def _say_goodbye(ws: ServerConnection) -> None:
    with contextlib.suppress(Exception):
        ws.close(_GOING_AWAY, "the oracle stops")


def _empty_folder(folder: Path) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = next(folder.iterdir(), None)
    except OSError as cause:
        raise UsageError(
            f"cannot be used: {cause.strerror}", file=folder, hint="name another folder"
        ) from cause
    if taken is not None:
        raise UsageError(
            f"holds something already ({taken.name})",
            file=folder,
            hint="name a new folder with -o: results are not overwritten",
        )
    return folder
