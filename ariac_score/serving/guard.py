"""Who may ask a server of ours: nobody's web page, and beyond this machine only who has the token.

A server makes one guard when it starts and asks it once for each request, before it answers:

    token = read_token(file)                      # or "", for this machine only
    socket = listening(host, port, token)         # refuses to be reached from elsewhere without a token
    guard = Guard(token, names_beyond(socket))
    refusal = guard.refusal(target, headers)      # the request's path with its query; pairs of header fields
    if refusal is not None:                       # answer refusal.status, refusal.reason, and close

A page that a browser shows may open WebSockets and send requests to every address its user can reach. What
gives it away is `Origin`, which it cannot leave out or forge. A page may also have its own name lead to this
machine (DNS rebinding); what gives that away is `Host`, in which the browser still writes the page's name. An
address of digits cannot be led elsewhere, so any is accepted.

Programs give the token as `Authorization: Bearer TOKEN`. A page's address may hold it as `?token=TOKEN`; the
server then answers with `Set-Cookie: ` and `guard.cookie(port)`, and what the page asks for brings that.
"""

from __future__ import annotations

import hmac
import ipaddress
import os
import re
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from ariac_score.documents.plain_file import open_plain
from ariac_score.errors import UsageError

__all__ = ["Guard", "Refusal", "is_loopback", "listening", "names_beyond", "read_token"]

_TOKEN = re.compile(r"[A-Za-z0-9._~-]{16,512}")
"""Characters that need no quoting in a header, an address or a cookie; short ones could be guessed."""
_MADE_BY = 'python -c "import secrets; print(secrets.token_urlsafe(32))" > token && chmod 600 token'
_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[^\[\]:/?#@\s]+)(?::(?P<port>[0-9]{1,5}))?")
_LAST_PORT = 65_535
_DEFAULT_PORTS = {"http": "80", "https": "443"}
_OF_THIS_MACHINE = frozenset({"localhost"})


@dataclass(frozen=True)
class Refusal:
    """Why a request is not answered.

    Attributes:
        status: Of the HTTP response: 400, 401 or 403.
        reason: In words, for its text and for a report.
    """

    status: int
    reason: str


@dataclass(frozen=True)
class Guard:
    """Judges requests by their header.

    Attributes:
        token: That every request has to bring; empty: none.
        names: By which the server may be called, besides `localhost` and addresses of digits; in lower case.
    """

    token: str = ""
    names: frozenset[str] = frozenset()

    def refusal(self, target: str, headers: Iterable[tuple[str, str]]) -> Refusal | None:
        """Why a request is refused; `None` where it may be answered.

        Args:
            target: What it asks for: a path, with its query.
            headers: Its fields, names in any case; all of them, also repeated ones.
        """
        fields = [(name.lower(), value.strip()) for name, value in headers]
        hosts = [value for name, value in fields if name == "host"]
        origins = [value for name, value in fields if name == "origin"]
        host = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
        if host is None or len(origins) > 1:
            return Refusal(400, "a request has one Host, and no more than one Origin")
        if not self._is_ours(host["name"]):
            return Refusal(403, f"Host {hosts[0]!r} is no name of this server")
        if origins and not _same_origin(origins[0], host):
            return Refusal(403, f"pages of Origin {origins[0]!r} may not ask this server")
        if self.token and not any(self._is_token(one) for one in _tokens(target, fields)):
            return Refusal(401, "the token is missing, or another one")
        return None

    def cookie(self, port: int) -> str:
        """The value of `Set-Cookie` after which a page need not repeat the token in its requests.

        Args:
            port: Of the server; cookies of one machine are shared by all its ports.
        """
        return f"ariac_score_{port}={self.token}; Path=/; HttpOnly; SameSite=Strict"

    def _is_ours(self, name: str) -> bool:
        plain = name.lower().removesuffix(".")
        return _address(plain.strip("[]")) is not None or plain in _OF_THIS_MACHINE | self.names

    def _is_token(self, given: str) -> bool:
        # In constant time: how long a comparison takes tells how far a guess is right.
        return hmac.compare_digest(given.encode("utf-8", "surrogateescape"), self.token.encode("ascii"))


def _same_origin(origin: str, host: re.Match[str]) -> bool:
    """Whether a page came from the server that it asks."""
    scheme, colon, rest = origin.lower().partition("://")
    of = _HOST.fullmatch(rest)
    if not colon or scheme not in _DEFAULT_PORTS or of is None:
        return False  # also `null`, of files and of pages in sandboxes
    default = _DEFAULT_PORTS[scheme]
    return (of["name"], of["port"] or default) == (host["name"].lower(), host["port"] or default)


def _tokens(target: str, fields: Iterable[tuple[str, str]]) -> Iterable[str]:
    """Whatever a request brings in the place of a token."""
    try:
        query = urlsplit(target).query
        yield from (value for name, value in parse_qsl(query, max_num_fields=20) if name == "token")
    except ValueError:
        pass  # no query, or one of too many fields
    for name, value in fields:
        if name == "authorization":
            scheme, _, given = value.partition(" ")
            if scheme.lower() == "bearer":
                yield given.strip()
        elif name == "cookie":
            for pair in value.split(";"):
                key, _, given = pair.strip().partition("=")
                if key.startswith("ariac_score_"):
                    yield given


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def is_loopback(address: str) -> bool:
    """Whether an address of digits can be reached from its own machine only."""
    found = _address(address.partition("%")[0])  # what follows is an interface
    mapped = getattr(found, "ipv4_mapped", None)
    return found is not None and (mapped or found).is_loopback


def listening(host: str, port: int, token: str = "", *, hint: str = "--token-file FILE") -> socket.socket:
    """A socket that listens; beyond this machine only with a token.

    Args:
        host: Name or address to listen on.
        port: 0 takes any free one.
        token: That requests have to bring; empty: none.
        hint: How a token is given, for the message.

    Raises:
        UsageError: The address is not free, or can be reached from other machines and there is no token.
    """
    try:
        if not 0 <= port <= _LAST_PORT:  # some systems would take another port
            raise ValueError("ports are 0 to 65535")
        (family, *_, address), *_ = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM)
        if not token and not (host and is_loopback(str(address[0]))):
            raise UsageError(
                f"{host or 'every address'} can be reached from other machines, and there is no token",
                hint=f"give one with {hint}, made by: {_MADE_BY}",
            )
        return socket.create_server(
            (host if not host else address[0], address[1]), family=family, backlog=512
        )
    except (OSError, OverflowError, ValueError) as cause:
        reason = getattr(cause, "strerror", None) or str(cause)
        raise UsageError(
            f"cannot listen on {host}:{port}: {reason}", hint="choose another --port, or stop what uses it"
        ) from cause


def names_beyond(listener: socket.socket) -> frozenset[str]:
    """Under which names other machines know this one; none for a socket that only this machine reaches."""
    if is_loopback(str(listener.getsockname()[0])):
        return frozenset()
    own = socket.gethostname().lower()
    return frozenset({own, own.partition(".")[0], own.partition(".")[0] + ".local"})


def read_token(file: Path) -> str:
    """The token in a file, which nobody else on this machine may read.

    Raises:
        UsageError: It cannot be read, others may read it, or it holds no token.
    """
    remedy = f"make one: {_MADE_BY}"
    try:
        with open_plain(file) as stream:
            mode = os.fstat(stream.fileno()).st_mode & 0o777
            text = stream.read(4096).decode("ascii").strip()
    except OSError as cause:
        raise UsageError(f"cannot be read: {cause.strerror}", file=file, hint=remedy) from cause
    except ValueError as cause:
        raise UsageError("it is no token", file=file, hint=remedy) from cause
    if os.name == "posix" and mode & 0o077:
        raise UsageError(
            f"others may read this token: its rights are {mode:04o}", file=file, hint="chmod 600"
        )
    if not _TOKEN.fullmatch(text):
        raise UsageError(
            "a token has 16 to 512 letters, digits and any of . _ ~ -, and nothing else",
            file=file,
            hint=remedy,
        )
    return text
