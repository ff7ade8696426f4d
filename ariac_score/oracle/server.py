"""The WebSocket side of the oracle: connections, limits, and an end in which nothing is lost.

The protocol comes from the library `websockets`, without its input and output: one thread for
each connection waits for the client, judges, and replies, and no other thread uses its socket.
So no event has to pass from thread to thread, and events that arrive together are answered together.
"""

from __future__ import annotations

import re
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ariac_score.errors import UsageError
from ariac_score.logs.rosmonitoring import MAX_LINE_BYTES
from ariac_score.oracle.conversation import Conversation
from ariac_score.oracle.judges import Bench
from ariac_score.serving.crowd import Crowd, Guest, neighbourhood
from ariac_score.serving.guard import Guard, Refusal, listening, names_beyond

if TYPE_CHECKING:
    from websockets.server import ServerProtocol

__all__ = ["Limits", "Oracle"]

_TOO_BIG, _GOING_AWAY = 1009, 1001  # close codes of RFC 6455, section 7.4.1
_OPENING_S = 5.0
"""How long a client may take for the handshake, s."""
_STRANGERS = 256
"""How many clients may be in the handshake; beyond them the one that takes longest has to go."""
_LOOK_EVERY_S = 0.2
"""How often a thread that waits checks whether the oracle stops, s. Hundreds of them wait at a time."""
_CHUNK_BYTES = 1 << 16
_NAME = re.compile(r"/(?!connection_[0-9]+$)(?!.*\.part[0-9]*$)[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}")
"""Of a connection, as the path of its address; it becomes the name of a file."""


@dataclass(frozen=True)
class Limits:
    """What one oracle accepts.

    Attributes:
        frame_bytes: A longer frame ends its connection.
        connections: Further ones are refused at the handshake, as if there were no oracle, unless another one
            gives way; a monitor would take a later refusal for a verdict.
        of_one_address: Likewise, from one address of another machine.
        events_per_s: A connection that sends more is read more slowly, not cut off; 0: any rate.
        closing_s: How long a client may take to close the connection when the oracle stops, s.
        silent_s: A connection that has never sent a message gives way when quiet for so long, s.
        idle_s: So does any other, s.
        log_bytes: Of one event log; a full one is set aside.
        log_parts: How many of those are kept for a connection.
    """

    frame_bytes: int = 1_000_000
    connections: int = 64
    events_per_s: float = 50_000.0
    closing_s: float = 0.3
    of_one_address: int = 32
    silent_s: float = 2.0
    idle_s: float = 600.0
    log_bytes: int = 1_000_000_000
    log_parts: int = 9

    def __post_init__(self) -> None:
        if not 0 < self.frame_bytes <= MAX_LINE_BYTES:
            raise ValueError(f"a frame may have 1 to {MAX_LINE_BYTES:,} bytes, which a log can hold")
        if self.connections < 1 or not self.events_per_s >= 0 or not self.closing_s > 0:
            raise ValueError("at least one connection, a rate of 0 or more, and time to close are needed")
        if self.of_one_address < 1 or not self.silent_s >= 0 or not self.idle_s >= self.silent_s:
            raise ValueError("at least one connection of an address is needed, and no times below 0 s")
        if self.log_bytes < 1 or self.log_parts < 0:
            raise ValueError("an event log has 1 byte or more, and 0 or more parts are kept")


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
        host: Address to listen on; one that other machines reach needs a token.
        port: Port; 0 takes any free one.
        limits: What it accepts.
        token: That clients have to bring; empty: none.
        names: By which it may be called, besides those of this machine.
        resume: Go on with the conversations whose logs are in the folder.

    Attributes:
        conversations: In the order in which they began.
        refusals: How many connections were refused or had to go, by reason.

    Raises:
        UsageError: The address is not free or needs a token, the folder cannot be written or is not empty, or
            the library for the protocol is not installed.
    """

    def __init__(
        self,
        bench: Bench,
        folder: Path,
        *,
        host: str = "127.0.0.1",
        port: int = 0,
        limits: Limits | None = None,
        token: str = "",
        names: frozenset[str] = frozenset(),
        resume: bool = False,
    ) -> None:
        self.conversations: list[Conversation] = []
        self.refusals: Counter[str] = Counter()
        self._bench, self._limits = bench, limits or Limits()
        self._protocol = _library()
        self._folder = _folder(folder, resume=resume)
        self._open: dict[Conversation, Guest] = {}
        self._named: dict[str, Conversation] = {}
        self._clients: dict[threading.Thread, socket.socket] = {}
        own = self._limits
        self._strangers = Crowd(_STRANGERS, _STRANGERS // 2, silent_s=0.0, idle_s=0.0)
        self._guests = Crowd(own.connections, own.of_one_address, silent_s=own.silent_s, idle_s=own.idle_s)
        self._changed = threading.Condition()
        self._stopping = threading.Event()
        self.stopped_at_s = float("inf")
        self._resume()
        self._socket = listening(host, port, token)
        self._guard = Guard(token, names | names_beyond(self._socket))
        self._socket.settimeout(_LOOK_EVERY_S)

    @property
    def refused(self) -> int:
        """How many connections were refused or had to go."""
        return self.refusals.total()

    @property
    def url(self) -> str:
        """Its address."""
        host, port = self._socket.getsockname()[:2]
        return f"ws://{f'[{host}]' if ':' in host else host}:{port}"

    def serve(self) -> None:
        """Answer until `stop` is called from another thread, or an interrupt comes."""
        while not self._stopping.is_set():
            try:
                client, address = self._socket.accept()
            except TimeoutError:
                continue
            except OSError:  # closed by `stop`; or out of file handles, until a connection ends
                self._stopping.wait(_LOOK_EVERY_S)
                continue
            stranger = Guest(neighbourhood(str(address[0])), partial(_shut, client))
            # A daemon: a client that never closes may not keep the process alive.
            thread = threading.Thread(target=self._attend, args=(client, stranger), daemon=True)
            with self._changed:
                before = self._strangers.gave_way
                self._strangers.admit(stranger)  # there is always one that may go
                self.refusals["it took too long for the handshake"] += self._strangers.gave_way - before
                self._clients[thread] = client
                try:
                    thread.start()
                except RuntimeError:  # the system gives no more threads
                    self._strangers.gone(stranger)
                    del self._clients[thread]
                    self.refusals["the system gives no more threads"] += 1
                    client.close()

    def stop(self) -> None:
        """Take no more connections, end those that are open, and complete their logs, within a moment."""
        self.stopped_at_s = min(self.stopped_at_s, time.monotonic())
        self._stopping.set()
        self._socket.close()
        with self._changed:
            self._changed.wait_for(lambda: not self._clients, self._limits.closing_s + _LOOK_EVERY_S)
            for client in self._clients.values():
                _shut(client)  # whoever has not closed by now is not waited for
            self._changed.wait_for(lambda: not self._clients, _LOOK_EVERY_S)
            for conversation in [*self._open]:
                self._over(conversation, "stopped by the oracle")

    def _late(self) -> bool:
        """Whether clients have had all their time to close."""
        return time.monotonic() > self.stopped_at_s + self._limits.closing_s

    def _resume(self) -> None:
        """Take up the conversations of an earlier oracle, in the order of their names."""
        for log in sorted(self._folder.glob("*.jsonl")):
            name = "/" + log.stem
            if re.fullmatch(r"/connection_[0-9]+", name) or _NAME.fullmatch(name):
                try:
                    conversation = self._conversation(log)
                    conversation.close("stopped with an earlier oracle")
                except OSError as cause:
                    raise UsageError(
                        f"cannot be written: {cause.strerror}", file=log, hint="name another folder"
                    ) from cause
                self.conversations.append(conversation)
                self._named[name] = conversation

    def _conversation(self, log: Path) -> Conversation:
        own = self._limits
        return Conversation(
            self._bench.judge(), log, largest_log_bytes=own.log_bytes, log_parts=own.log_parts
        )

    # One connection, in a thread of its own ----------------------------------------------

    def _attend(self, client: socket.socket, stranger: Guest) -> None:
        try:
            with client:
                wire = _Wire(client, self._protocol(max_size=self._limits.frame_bytes), self._late)
                guest = Guest(stranger.address, wire.leave)
                conversation = self._greeted(wire, stranger, guest)
                if conversation is not None:
                    self._converse(wire, conversation, guest)
                wire.close(self._limits.closing_s)
        except OSError:
            pass  # the client has gone
        finally:
            with self._changed:
                self._strangers.gone(stranger)
                self._clients.pop(threading.current_thread(), None)
                self._changed.notify_all()

    def _greeted(self, wire: _Wire, stranger: Guest, guest: Guest) -> Conversation | None:
        """The conversation after the handshake; `None` where the client made none, or was refused."""
        until_s = time.monotonic() + _OPENING_S
        while not self._stopping.is_set() and time.monotonic() < until_s and not wire.ended:
            wire.receive()
            for request in wire.protocol.events_received():
                conversation = self._answered_request(wire.protocol, request, stranger, guest)
                try:
                    wire.flush()
                except OSError:
                    if conversation is not None:
                        self._over(conversation, "lost", guest)
                    raise
                return conversation
            wire.flush()
        return None

    def _answered_request(
        self, protocol: ServerProtocol, request: Any, stranger: Guest, guest: Guest
    ) -> Conversation | None:
        """Answer the request of a handshake; the conversation, where it is accepted."""
        refusal = self._guard.refusal(request.path, request.headers.raw_items())
        path = request.path.partition("?")[0]
        if refusal is None and path != "/" and not _NAME.fullmatch(path):
            refusal = Refusal(404, "the path is no name of a connection")
        if refusal is not None:
            with self._changed:
                self.refusals[_SHORT.get(refusal.status, "a bad request")] += 1
            protocol.send_response(protocol.reject(refusal.status, refusal.reason + "\n"))
            return None
        response = protocol.accept(request)
        conversation = None
        if response.status_code == _SWITCHING:
            conversation = self._begun("" if path == "/" else path, stranger, guest)
            if conversation is None:
                response = protocol.reject(503, "the oracle has as many connections as it accepts\n")
        protocol.send_response(response)
        return conversation

    def _begun(self, name: str, stranger: Guest, guest: Guest) -> Conversation | None:
        with self._changed:
            self._strangers.gone(stranger)
            if self._stopping.is_set():
                return None
            known = self._named.get(name) if name else None
            if known in self._open:  # whoever comes again has lost the connection before us
                former = self._open[known]
                former.leave()
                self._over(known, "its name connected again", former)
            before = self._guests.gave_way
            if not self._guests.admit(guest):
                self.refusals["there were as many connections as are accepted"] += 1
                return None
            self.refusals["it was silent, and others needed its place"] += self._guests.gave_way - before
            number = len(self.conversations) + 1
            try:
                if known is not None:
                    known.reopen()
                    conversation = known
                else:
                    file = f"{name.lstrip('/')}.jsonl" if name else f"connection_{number:03}.jsonl"
                    conversation = self._conversation(self._folder / file)
            except OSError:  # its log cannot be written
                self._guests.gone(guest)
                self.refusals["its log cannot be written"] += 1
                return None
            if known is None:
                self.conversations.append(conversation)
            if name:
                self._named[name] = conversation
            self._open[conversation] = guest
        return conversation

    def _over(self, conversation: Conversation, ended: str, guest: Guest | None = None) -> None:
        """End a conversation, unless its place has been taken by another connection."""
        with self._changed:
            present = self._open.get(conversation)
            if present is None or guest not in (None, present):
                return
            del self._open[conversation]
            self._guests.gone(present)
            with conversation.lock:
                conversation.close(ended)
            self._changed.notify_all()

    def _converse(self, wire: _Wire, conversation: Conversation, guest: Guest) -> None:
        ended = "the oracle failed"
        try:
            self._answer_all(wire, conversation, guest)
            ended = self._how(wire.protocol)
            if wire.leaving:
                ended = "it was silent, and another one needed its place"
        except (ConnectionError, _EndedError):
            ended = "stopped by the oracle" if self._stopping.is_set() else "lost"
        except OSError as cause:
            ended = f"its log cannot be written: {cause.strerror}"
        finally:
            self._over(conversation, ended, guest)

    def _answer_all(self, wire: _Wire, conversation: Conversation, guest: Guest) -> None:
        def wait(seconds: float) -> None:
            wire.flush()  # earlier replies do not wait with this one
            self._stopping.wait(seconds)

        pace, message = Pace(self._limits.events_per_s, wait), _Message()
        while not wire.ended and not wire.leaving and not self._stopping.is_set():
            for frame in wire.protocol.events_received():
                pace.step()  # also for what carries no event: pings and pieces without end
                whole = message.take(frame)
                if whole is None:
                    continue
                if self._stopping.is_set() or wire.leaving:
                    break
                wire.protocol.send_text(self._reply(conversation, guest, whole))
            wire.flush()
            if wire.closing:
                return
            wire.receive()

    def _reply(self, conversation: Conversation, guest: Guest, frame: bytes) -> bytes:
        """The reply to a frame.

        Raises:
            OSError: The log cannot be written.
            _EndedError: The conversation goes on elsewhere, or is over.
        """
        with conversation.lock:  # the next connection of its name may be taking it over
            if self._open.get(conversation) is not guest:
                raise _EndedError
            before = conversation.unjudged + conversation.bad_frames
            reply = conversation.answer(frame).encode("utf-8")
            if conversation.unjudged + conversation.bad_frames == before:
                self._guests.heard(guest)  # what is no event keeps nobody's place
            return reply

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
_SHORT = {
    400: "a bad request",
    401: "the token was missing, or another one",
    403: "a page or a name of somebody else",
    404: "a path that is no name",
}


class _EndedError(Exception):
    """A conversation that is over is given a frame."""


def _shut(client: socket.socket) -> None:
    """End a connection from another thread, so that whoever waits for it goes on."""
    with suppress(OSError):  # it has ended
        client.shutdown(socket.SHUT_RDWR)


class _Wire:
    """The bytes of one connection, in both directions.

    Args:
        client: Its socket.
        protocol: What they mean.
        late: Whether the oracle stops, and has waited long enough.

    Attributes:
        ended: Whether the client sends no more.
        leaving: Whether it has to give way.
    """

    def __init__(self, client: socket.socket, protocol: ServerProtocol, late: Callable[[], bool]) -> None:
        self.protocol, self.ended, self.leaving = protocol, False, False
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

    def leave(self) -> None:
        """End it soon; from another thread."""
        self.leaving = True

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
                if self._late() or self.leaving:
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
            why = "others need this place" if self.leaving else "the oracle stops"
            self.protocol.send_close(_GOING_AWAY, why)
        self.flush()
        until_s = time.monotonic() + within_s
        while not self.ended and time.monotonic() < until_s and not self._late():
            self.receive()
            self.flush()


class _Message:
    """Puts a message together from its frames; control frames may come between them."""

    def __init__(self) -> None:
        from websockets.frames import DATA_OPCODES  # noqa: PLC0415  # only those who serve need it

        self._parts = bytearray()  # one piece of memory, however many frames without content there are
        self._begun = False
        self._opcodes = DATA_OPCODES

    def take(self, frame: Any) -> bytes | None:
        """The message that a frame completes; `None` where none is complete."""
        if frame.opcode not in self._opcodes:
            return None
        if frame.fin and not self._begun:
            return bytes(frame.data)
        self._begun = not frame.fin
        self._parts += frame.data
        if self._begun:
            return None
        whole = bytes(self._parts)
        self._parts.clear()
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


def _folder(folder: Path, *, resume: bool) -> Path:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = next(folder.iterdir(), None)
    except OSError as cause:
        raise UsageError(
            f"cannot be used: {cause.strerror}", file=folder, hint="name another folder"
        ) from cause
    if taken is not None and not resume:
        raise UsageError(
            f"it is not empty: {taken.name} is in it",
            file=folder,
            hint="name a new folder with -o: results are not overwritten; or go on with it by --resume",
        )
    return folder
