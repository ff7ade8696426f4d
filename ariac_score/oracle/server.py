"""The WebSocket side of the oracle: connections, limits, and an end in which nothing is lost.

The protocol comes from the library `websockets`, without its input and output: one thread for
each connection waits for the client, judges, and replies, and no other thread uses its socket.
So no event has to pass from thread to thread, and events that arrive together are answered together.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ariac_score.errors import UsageError
from ariac_score.logs.rosmonitoring import MAX_LINE_BYTES
from ariac_score.oracle.conversation import Conversation
from ariac_score.oracle.judges import Bench

if TYPE_CHECKING:
    from websockets.server import ServerProtocol

__all__ = ["Limits", "Oracle"]

_TOO_BIG, _GOING_AWAY = 1009, 1001  # close codes of RFC 6455, section 7.4.1
_LAST_PORT = 65_535
_OPENING_S = 5.0
"""How long a client may take for the handshake, s."""
_STRANGERS = 16
"""How many clients may be in the handshake, beyond the connections that are accepted."""
_LOOK_EVERY_S = 0.05
"""How often a thread that waits checks whether the oracle stops, s."""
_CHUNK_BYTES = 1 << 16


@dataclass(frozen=True)
class Limits:
    """What one oracle accepts.

    Attributes:
        frame_bytes: A longer frame ends its connection.
        connections: Further ones are refused at the handshake, as if there were no oracle; a monitor
            would take a later refusal for a verdict.
        events_per_s: A connection that sends more is read more slowly, not cut off; 0: any rate.
        closing_s: How long a client may take to close the connection when the oracle stops, s.
    """

    frame_bytes: int = 1_000_000
    connections: int = 16
    events_per_s: float = 50_000.0
    closing_s: float = 2.0

    def __post_init__(self) -> None:
        if not 0 < self.frame_bytes <= MAX_LINE_BYTES:
            raise ValueError(f"a frame may have 1 to {MAX_LINE_BYTES:,} bytes, which a log can hold")
        if self.connections < 1 or not self.events_per_s >= 0 or not self.closing_s > 0:
            raise ValueError("at least one connection, a rate of 0 or more, and time to close are needed")


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
        """Take one event, after the time that the rate requires."""
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
        folder: For the event log of each connection; made where missing.
        host: Address to listen on.
        port: Port; 0 takes any free one.
        limits: What it accepts.

    Raises:
        UsageError: The address is not free, the folder cannot be written or is not empty, or the library
            for the protocol is not installed.
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
        self._protocol = _library()
        self._folder = _empty_folder(folder)
        self._open: set[Conversation] = set()
        self._threads: set[threading.Thread] = set()
        self._changed = threading.Condition()
        self._stopping = threading.Event()
        self._stopped_at_s = float("inf")
        self._socket = _bound(host, port)
        self._socket.settimeout(_LOOK_EVERY_S)

    @property
    def url(self) -> str:
        """Its address."""
        host, port = self._socket.getsockname()[:2]
        return f"ws://{f'[{host}]' if ':' in host else host}:{port}"

    def serve(self) -> None:
        """Answer until `stop` is called from another thread, or an interrupt comes."""
        while not self._stopping.is_set():
            try:
                client, _ = self._socket.accept()
            except TimeoutError:
                continue
            except OSError:  # closed by `stop`; or out of file handles, until a connection ends
                self._stopping.wait(_LOOK_EVERY_S)
                continue
            with self._changed:
                crowded = len(self._threads) >= self._limits.connections + _STRANGERS
                if crowded:
                    self.refused += 1
                    client.close()
                    continue
                # A daemon: a client that never closes may not keep the process alive.
                thread = threading.Thread(target=self._attend, args=(client,), daemon=True)
                self._threads.add(thread)
                thread.start()

    def stop(self) -> None:
        """Take no more connections, end those that are open, and complete their logs."""
        self._stopped_at_s = time.monotonic()
        self._stopping.set()
        self._socket.close()
        patience_s = 2 * self._limits.closing_s + 4 * _LOOK_EVERY_S
        with self._changed:
            self._changed.wait_for(lambda: not self._open, timeout=patience_s)
            threads = list(self._threads)
        for thread in threads:
            thread.join(max(0.0, self._stopped_at_s + patience_s - time.monotonic()))

    def _late(self) -> bool:
        """Whether clients have had all their time to close."""
        return time.monotonic() > self._stopped_at_s + self._limits.closing_s

    # One connection, in a thread of its own ----------------------------------------------

    def _attend(self, client: socket.socket) -> None:
        try:
            with client:
                wire = _Wire(client, self._protocol(max_size=self._limits.frame_bytes), self._late)
                conversation = self._greeted(wire)
                if conversation is not None:
                    self._converse(wire, conversation)
                wire.close(self._limits.closing_s)
        except OSError:
            pass  # the client has gone
        finally:
            with self._changed:
                self._threads.discard(threading.current_thread())

    def _greeted(self, wire: _Wire) -> Conversation | None:
        """The conversation after the handshake; `None` where the client made none, or was refused."""
        until_s = time.monotonic() + _OPENING_S
        while not self._stopping.is_set() and time.monotonic() < until_s and not wire.ended:
            wire.receive()
            for request in wire.protocol.events_received():
                response = wire.protocol.accept(request)  # type: ignore[arg-type]  # the first event is the request
                conversation = self._begun() if response.status_code == _SWITCHING else None
                if response.status_code == _SWITCHING and conversation is None:
                    response = wire.protocol.reject(503, "the oracle has as many connections as it accepts\n")
                wire.protocol.send_response(response)
                try:
                    wire.flush()
                except OSError:
                    if conversation is not None:
                        self._over(conversation, "lost")
                    raise
                return conversation
            wire.flush()
        return None

    def _begun(self) -> Conversation | None:
        with self._changed:
            if len(self._open) >= self._limits.connections or self._stopping.is_set():
                self.refused += 1
                return None
            number = len(self.conversations) + 1
            log = self._folder / f"connection_{number:03}.jsonl"
            try:
                conversation = Conversation(self._bench.judge(), log)
            except OSError:  # its log cannot be written
                self.refused += 1
                return None
            self.conversations.append(conversation)
            self._open.add(conversation)
        return conversation

    def _over(self, conversation: Conversation, ended: str) -> None:
        with self._changed:
            conversation.close(ended)
            self._open.discard(conversation)
            self._changed.notify_all()

    def _converse(self, wire: _Wire, conversation: Conversation) -> None:
        ended = "the oracle failed"
        try:
            self._answer_all(wire, conversation)
            ended = self._how(wire.protocol)
        except ConnectionError:
            ended = "stopped by the oracle" if self._stopping.is_set() else "lost"
        except OSError as cause:
            ended = f"its log cannot be written: {cause.strerror}"
        finally:
            self._over(conversation, ended)

    def _answer_all(self, wire: _Wire, conversation: Conversation) -> None:
        def wait(seconds: float) -> None:
            wire.flush()  # earlier replies do not wait with this one
            self._stopping.wait(seconds)

        pace, message = Pace(self._limits.events_per_s, wait), _Message()
        while not wire.ended and not self._stopping.is_set():
            for frame in wire.protocol.events_received():
                whole = message.take(frame)
                if whole is None:
                    continue
                pace.step()
                if self._stopping.is_set():
                    break
                wire.protocol.send_text(conversation.answer(whole).encode("utf-8"))
            wire.flush()
            if wire.closing:
                return
            wire.receive()

    def _how(self, protocol: ServerProtocol) -> str:
        """How a connection ended, for the report."""
        sent = protocol.close_sent
        if protocol.close_rcvd_then_sent:
            return "closed by the client"
        if sent is not None and sent.code == _TOO_BIG:
            return f"a frame was longer than {self._limits.frame_bytes:,} bytes"
        if sent is not None:
            return f"the client broke the protocol: {sent.reason or sent.code}"
        return "stopped by the oracle" if self._stopping.is_set() else "lost"


_SWITCHING = 101


class _Wire:
    """The bytes of one connection, in both directions.

    Args:
        client: Its socket.
        protocol: What they mean.
        late: Whether the oracle stops, and has waited long enough.

    Attributes:
        ended: Whether the client sends no more.
    """

    def __init__(self, client: socket.socket, protocol: ServerProtocol, late: Callable[[], bool]) -> None:
        self.protocol, self.ended = protocol, False
        self._socket, self._late = client, late
        client.settimeout(_LOOK_EVERY_S)
        # A reply is smaller than a packet and would be held back, and the monitor waits for it.
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # A machine that was switched off sends no end; without this its connection would stay for ever.
        client.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)

    @property
    def closing(self) -> bool:
        """Whether either side has closed the connection."""
        return self.protocol.close_rcvd is not None or self.protocol.close_sent is not None

    def receive(self) -> None:
        """Wait a short time for bytes."""
        try:
            received = self._socket.recv(_CHUNK_BYTES)
        except TimeoutError:
            return
        if received:
            self.protocol.receive_data(received)
        else:
            self.ended = True
            self.protocol.receive_eof()

    def flush(self) -> None:
        """Send what the protocol has to send, waiting for a client that does not read.

        Raises:
            ConnectionError: The client has gone; or it does not read, and the oracle stops.
        """
        parts = self.protocol.data_to_send()
        if not parts:
            return
        left = memoryview(b"".join(parts))
        while left:
            try:
                left = left[self._socket.send(left) :]
            except TimeoutError:
                if self._late():
                    raise ConnectionAbortedError("the client does not read") from None
            except ConnectionError:
                raise
            except OSError as cause:
                raise ConnectionResetError(cause.strerror) from cause
        if parts[-1] == b"":  # so `websockets` marks the end of the stream
            self._socket.shutdown(socket.SHUT_WR)

    def close(self, within_s: float) -> None:
        """Close the connection, if neither side has, and let the client finish.

        What it still sends is read: a socket that is closed with unread bytes is reset, and the client
        would lose replies that it has not read yet.
        """
        if self.protocol.state.name == "OPEN":
            self.protocol.send_close(_GOING_AWAY, "the oracle stops")
        self.flush()
        until_s = time.monotonic() + within_s
        while not self.ended and time.monotonic() < until_s and not self._late():
            self.receive()
            self.flush()


class _Message:
    """Puts a message together from its frames; control frames may come between them."""

    def __init__(self) -> None:
        from websockets.frames import DATA_OPCODES  # noqa: PLC0415  # only those who serve need it

        self._parts: list[bytes] = []
        self._opcodes = DATA_OPCODES

    def take(self, frame: Any) -> bytes | None:
        """The message that a frame completes; `None` where none is complete."""
        if frame.opcode not in self._opcodes:
            return None
        data = bytes(frame.data)
        if frame.fin and not self._parts:
            return data
        self._parts.append(data)
        if not frame.fin:
            return None
        whole = b"".join(self._parts)
        self._parts = []
        return whole


def _library() -> type[ServerProtocol]:
    """The protocol, from its library.

    Raises:
        UsageError: It is not installed.
    """
    try:
        from websockets.server import ServerProtocol  # noqa: PLC0415  # only those who serve need it
    except ImportError as cause:
        raise UsageError(
            "the library `websockets` is not installed", hint="pip install 'ariac-score[live]'"
        ) from cause
    return ServerProtocol


def _bound(host: str, port: int) -> socket.socket:
    """A socket that listens.

    Raises:
        UsageError: The address is not free.
    """
    try:
        if not 0 <= port <= _LAST_PORT:  # some systems would take another port
            raise ValueError("ports are 0 to 65535")
        (family, *_, address), *_ = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        return socket.create_server(address[:2], family=family)
    except (OSError, OverflowError, ValueError) as cause:
        reason = getattr(cause, "strerror", None) or str(cause)
        raise UsageError(
            f"cannot listen on {host}:{port}: {reason}", hint="choose another --port, or stop what uses it"
        ) from cause


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
            f"it is not empty: {taken.name} is in it",
            file=folder,
            hint="name a new folder with -o: results are not overwritten",
        )
    return folder
