"""One WebSocket to a server, with bounded waits and errors in words."""

from __future__ import annotations

import socket
import ssl
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from ariac_score.errors import LiveError, UsageError
from ariac_score.live.dialled import LARGEST_BYTES, OPEN_S, GoneError

if TYPE_CHECKING:
    from websockets.sync.client import ClientConnection
    from websockets.typing import Subprotocol

__all__ = ["WebSocket"]

_PING_S, _SILENT_S = 1.0, 5.0
"""A server that does not answer a ping is gone: a cable that was pulled says nothing."""
_EXTRA = "pip install 'ariac-score[foxglove,rosbridge]'"


class WebSocket:
    """A connection that is open; use `WebSocket.to`."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection

    @classmethod
    def to(
        cls, host: str, port: int, *, secure: bool, subprotocols: Sequence[str] = (), what: str
    ) -> WebSocket:
        """Connect.

        Raises:
            UsageError: The library is not installed.
            LiveError: Nothing answers, or it is something else.
        """
        try:
            from websockets.exceptions import WebSocketException  # noqa: PLC0415  # not everybody has it
            from websockets.sync.client import connect  # noqa: PLC0415
        except ImportError as missing:
            raise UsageError("the library 'websockets' is not installed", hint=_EXTRA) from missing
        name = f"[{host}]" if ":" in host else host
        where = f"{host}:{port}"
        offered: list[Subprotocol] = list(subprotocols)  # type: ignore[arg-type]  # a name for `str`
        try:
            connection = connect(
                f"{'wss' if secure else 'ws'}://{name}:{port}",
                subprotocols=offered or None,
                compression=None,
                max_size=LARGEST_BYTES,
                open_timeout=OPEN_S,
                ping_interval=_PING_S,
                ping_timeout=_SILENT_S,
                close_timeout=0.5,
                proxy=None,
            ).__enter__()  # it is left by `end`, which waits for nobody
        except ssl.SSLError as error:
            raise LiveError(f"{where}: {error.reason or error}", hint="wss:// needs a certificate") from None
        except OSError as error:
            why = "it does not answer in time" if isinstance(error, TimeoutError) else error.strerror or error
            raise LiveError(f"{where}: {why}", hint=f"is {what} running there, and reachable?") from None
        except WebSocketException as error:
            raise LiveError(f"{where} is not {what}: {error}", hint="another port?") from None
        return cls(connection)

    def take(self) -> str | bytes:
        """The next frame; a server that says nothing is asked whether it is there.

        Raises:
            GoneError: There is none any more.
        """
        raw = self.try_take(None)
        assert raw is not None
        return raw

    def try_take(self, timeout_s: float | None) -> str | bytes | None:
        """The next frame; `None` where none came in so many seconds.

        Raises:
            GoneError: There is none any more.
        """
        from websockets.exceptions import ConnectionClosed  # noqa: PLC0415

        try:
            return self._connection.recv(timeout_s)
        except TimeoutError:
            return None
        except ConnectionClosed as closed:
            raise GoneError(_why(closed)) from None
        except OSError as error:
            raise GoneError(str(error)) from None

    def greeting(self) -> str | bytes:
        """One of the first frames, which must come in time.

        Raises:
            GoneError: It does not.
        """
        raw = self.try_take(OPEN_S)
        if raw is None:
            raise GoneError(f"it says nothing for {OPEN_S:g} s")
        return raw

    def say(self, text: str) -> None:
        """Send a text.

        Raises:
            GoneError: Nobody is there.
        """
        from websockets.exceptions import ConnectionClosed  # noqa: PLC0415

        try:
            self._connection.send(text)
        except (ConnectionClosed, OSError) as error:
            raise GoneError(str(error)) from None

    def end(self) -> None:
        """Close without waiting for the other side."""
        with suppress(OSError):
            self._connection.socket.shutdown(socket.SHUT_RDWR)
        with suppress(Exception):
            self._connection.close_socket()


def _why(closed: Exception) -> str:
    code = getattr(getattr(closed, "sent", None), "code", None)
    if code == 1009:
        return f"a message has more than {LARGEST_BYTES >> 20} MiB"
    return str(closed)
