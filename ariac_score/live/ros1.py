"""A cell of ROS 1, directly: `ros1://MASTER:PORT`. No ROS is needed on the referee's machine.

The referee is no node: it listens on no port and registers nothing. It asks the master ten times a second who
publishes what, and opens a TCPROS connection to each publisher.

Source: wiki.ros.org, Master API, Slave API and TCPROS.
"""

from __future__ import annotations

import http.client
import secrets
import socket
import struct
import threading
import time
import xmlrpc.client  # the master speaks nothing else; expat bounds what entities grow to
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from ariac_score.errors import LiveError
from ariac_score.live.dialled import LARGEST_BYTES, DialledSource, GoneError, host_and_port
from ariac_score.live.source import Lost
from ariac_score.logs.containers.items import Connection

__all__ = ["Ros1Source"]

_PORT = 11311
_NAME = "/ariac_score_watch_"
"""What a referee is called begins so. A publisher hangs up on whom it knows by a name when one more of that
name comes: each has one of its own, which nobody guesses."""
_POLL_S = 0.1
_AGAIN_S = 0.5
_ANSWER_S = 3.0
_PATIENCE = 20
"""So many questions in a row the master leaves without an answer before it counts as gone."""
_LONGEST_HEADER = 1 << 24
_LENGTH = struct.Struct("<I")
_USAGE = "give ros1://HOST:PORT of the master (11311 by default), as in ROS_MASTER_URI"


class _Transport(xmlrpc.client.Transport):
    """XML-RPC that waits for an answer no longer than it should."""

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = _ANSWER_S
        return connection


@dataclass
class _Graph:
    """What is known of the cell while its master is there."""

    links: dict[tuple[str, str], _Link] = field(default_factory=dict)
    """By topic and node."""


class Ros1Source(DialledSource):
    """Hears every publisher of ROS 1, as `rosbag record` does.

    TCP loses nothing on the way. What a publisher's own queue drops shows where its messages have a header,
    whose numbers then leave some out. A connection that breaks is a loss of its topic, and said; a publisher
    that leaves in order is none.
    """

    sees_losses = True

    def __init__(self, address: str) -> None:
        super().__init__(address)
        self._host, self._port = host_and_port(address, _PORT, _USAGE)
        self.name = _NAME + secrets.token_hex(8)
        self._lock = threading.Lock()

    def dial(self) -> _Graph:
        """Ask the master who it is."""
        try:
            self.server = str(self._ask("getParam", "/run_id"))
        except GoneError as error:
            raise LiveError(
                f"{self._host}:{self._port}: {error}", hint="is a ROS 1 master (roscore) running there?"
            ) from None
        return _Graph()

    def listen(self, session: _Graph) -> None:
        """Follow publishers as they come and go; over when the master and all of them are gone."""
        missed = 0
        while not self.closing.wait(_POLL_S):
            try:
                published = self._ask("getSystemState")[0]
            except GoneError as error:
                missed += 1
                if not any(link.is_up for link in session.links.values()) or missed > _PATIENCE:
                    raise GoneError(f"the master: {error}") from None
                continue
            except (LookupError, TypeError) as error:
                raise GoneError(f"the master says what makes no sense: {error!r}") from None
            missed = 0
            here = {(topic, node) for topic, nodes in published if self.wants(topic) for node in nodes}
            self._follow(session, here)

    def hang_up(self, session: _Graph) -> None:
        """Close every connection."""
        for link in list(session.links.values()):
            link.end()

    def _follow(self, session: _Graph, here: set[tuple[str, str]]) -> None:
        for key in list(session.links):
            link = session.links[key]
            # Its connection ends by itself, with the last message. One that is back at once, as a node that
            # is started again, is heard again: by the link that still tries, or by a new one.
            link.leaves = key not in here
            if not link.is_alive:
                del session.links[key]
        for key in sorted(here - set(session.links)):
            session.links[key] = link = _Link(self, *key)
            link.start()

    def ask_of(self, uri: str, method: str, *arguments: object) -> Any:
        """The value that a master or a node answers.

        Raises:
            GoneError: It does not answer, or refuses.
        """
        with xmlrpc.client.ServerProxy(uri, transport=_Transport()) as server:
            try:
                code, text, value = getattr(server, method)(self.name, *arguments)
            except OSError as error:
                raise GoneError(_why(error)) from None
            except (xmlrpc.client.Error, http.client.HTTPException, ValueError, TypeError) as error:
                raise GoneError(f"it does not speak as ROS 1 does: {type(error).__name__}") from None
            except Exception as error:  # noqa: BLE001  # expat has errors of its own, which are no ValueError
                raise GoneError(f"it does not speak as ROS 1 does: {error}") from None
        if code != 1:
            raise GoneError(str(text))
        return value

    def _ask(self, method: str, *arguments: object) -> Any:
        name = f"[{self._host}]" if ":" in self._host else self._host
        return self.ask_of(f"http://{name}:{self._port}/", method, *arguments)

    def uri_of(self, node: str) -> str:
        """Where a node answers."""
        return str(self._ask("lookupNode", node))

    def announce(self, topic: str, node: str, header: dict[str, str]) -> Connection:
        """The connection of a publisher, which is the one of before where it has come back."""
        with self._lock:
            self.channels.forget()  # there is one of each topic and node
            return self.channels.announce(
                topic,
                header.get("type", ""),
                "ros1",
                header.get("message_definition", ""),
                "ros1msg",
                publisher=header.get("callerid", node),
                latched=header.get("latching") == "1",
            )


class _Link:
    """The connection to one publisher of one topic, on a thread of its own."""

    def __init__(self, source: Ros1Source, topic: str, node: str) -> None:
        self._source, self._topic, self._node = source, topic, node
        self._socket: socket.socket | None = None
        self._thread = threading.Thread(target=self._run, name=f"{topic} of {node}", daemon=True)
        self._over = threading.Event()
        self._since_ns = time.time_ns()
        self._said = ""
        self.is_up = self.leaves = False

    @property
    def is_alive(self) -> bool:
        """Whether it still hears, or tries to."""
        return self._thread.is_alive()

    def start(self) -> None:
        """Connect, and hear."""
        self._thread.start()

    def end(self) -> None:
        """Hang up."""
        self._over.set()
        if (one := self._socket) is not None:
            with suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)

    def _run(self) -> None:
        cause = ""
        while not self._over.is_set():
            try:
                self._hear()
            except (OSError, GoneError) as error:
                cause = _why(error) if isinstance(error, OSError) else str(error)
            except Exception as error:  # noqa: BLE001  # whatever a strange node says
                cause = f"it does not speak as ROS 1 does: {error!r}"
            finally:
                self.is_up, self._socket = False, None
            # Who leaves in order tells the master, and then closes; the master tells us within one question.
            if self._over.wait(3 * _POLL_S) or self.leaves:
                return
            self._lose(cause)
            if self._over.wait(_AGAIN_S) or self.leaves:
                return

    def _lose(self, cause: str) -> None:
        """Say that nothing is heard of it; once until it is heard again."""
        if cause == self._said:
            return
        self._said = cause
        words = f"no connection to {self._node}: {cause}"
        self._source.put(Lost(self._topic, self._since_ns, time.time_ns(), words))

    def _hear(self) -> None:
        source = self._source
        answer = source.ask_of(source.uri_of(self._node), "requestTopic", self._topic, [["TCPROS"]])
        if not isinstance(answer, list) or len(answer) != 3 or answer[0] != "TCPROS":
            raise GoneError("it offers no TCPROS")
        with socket.create_connection((str(answer[1]), int(answer[2])), _ANSWER_S) as one:
            self._socket = one
            _keep_alive(one)
            asked = {"callerid": source.name, "topic": self._topic, "md5sum": "*", "type": "*"}
            one.sendall(_header(**asked, tcp_nodelay="1"))
            with one.makefile("rb", buffering=1 << 16) as stream:
                header = _fields(_read(stream, _LONGEST_HEADER))
                if "error" in header:
                    raise GoneError(header["error"])
                connection = source.announce(self._topic, self._node, header)
                one.settimeout(None)
                self.is_up, self._said = True, ""
                while True:
                    payload = _read(stream, LARGEST_BYTES)
                    self._since_ns = source.heard()
                    source.received(connection, payload, self._since_ns, None)


def _read(stream: Any, longest: int) -> bytes:
    """What a length announces.

    Raises:
        GoneError: The connection ended, or it announces more than it may.
    """
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise GoneError("it closed the connection")
    (length,) = _LENGTH.unpack(head)
    if length > longest:
        raise GoneError(f"it announces a message of {length} bytes, more than {longest >> 20} MiB")
    body = stream.read(length)
    if len(body) < length:
        raise GoneError("it closed the connection within a message")
    return bytes(body)


def _header(**fields: str) -> bytes:
    parts = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(_LENGTH.pack(len(part)) + part for part in parts)
    return _LENGTH.pack(len(body)) + body


def _fields(body: bytes) -> dict[str, str]:
    """The fields of a header.

    >>> _fields(_header(topic="/tf", latching="1")[4:])
    {'topic': '/tf', 'latching': '1'}
    """
    found, at = dict[str, str](), 0
    while at + _LENGTH.size <= len(body):
        (length,) = _LENGTH.unpack_from(body, at)
        at += _LENGTH.size
        name, _, value = body[at : at + length].decode("utf-8", errors="replace").partition("=")
        found[name] = value
        at += length
    return found


def _keep_alive(one: socket.socket) -> None:
    """Have the system find out within seconds that nobody is there: silence does not show it."""
    one.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in (("TCP_KEEPIDLE", 2), ("TCP_KEEPINTVL", 1), ("TCP_KEEPCNT", 3)):
        if (option := getattr(socket, name, None)) is not None:  # not every system has them
            one.setsockopt(socket.IPPROTO_TCP, option, value)


def _why(error: OSError) -> str:
    if isinstance(error, socket.gaierror):
        return f"its host name is not known here ({error.strerror}); set ROS_IP where it runs"
    return "it does not answer in time" if isinstance(error, TimeoutError) else error.strerror or str(error)
