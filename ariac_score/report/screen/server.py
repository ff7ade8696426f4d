"""Serves the screen: one page, its states as server-sent events, `/metrics`; by the standard library."""

from __future__ import annotations

import asyncio
import json
import socket
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from typing import Any
from urllib.parse import urlsplit

from ariac_score.report.html.page import page
from ariac_score.report.screen.metrics import metrics_of
from ariac_score.serving.guard import Guard

__all__ = ["MOST_VIEWERS", "Screen"]

MOST_VIEWERS = 256
_MOST_FROM_ONE = 128
"""Viewers from one address: one machine may stand for many, behind a proxy, and may not take all places."""
_HEADER_S = 5.0
_READ_S = 10.0
"""A viewer that takes nothing for so long is dropped."""
_ALIVE_S = 5.0
_BUFFER_BYTES = 256 * 1024
_MOST_HEADER_BYTES = 16 * 1024

_TEXT = "text/plain; charset=utf-8"
_NEVER_KEPT = (
    "Cache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n"
    "Content-Security-Policy: frame-ancestors 'none'\r\n"
)


class Screen:
    """What viewers see of some cells; to be used from the loop that serves it.

    Args:
        names: Of the cells, in the order of the wall.
        guard: Who may ask.
        port: That it is served on, for the cookie of a token.
        note: Takes what an operator should know, such as a viewer that was dropped.
    """

    def __init__(
        self, names: Sequence[str], guard: Guard, port: int, *, note: Callable[[str], None] = lambda _: None
    ) -> None:
        self._names, self._guard, self._port, self._note = tuple(names), guard, port, note
        self._states: dict[str, tuple[int, bytes]] = {}
        self._changed = asyncio.Event()
        self._viewers: Counter[str] = Counter()
        self._tasks: set[asyncio.Task[None]] = set()
        self.dropped: list[str] = []

    def show(self, state: bytes) -> None:
        """Show the state of a cell, as its feed gives it."""
        name = json.loads(state)["name"]
        number = self._states[name][0] + 1 if name in self._states else 1
        self._states[name] = number, state
        changed, self._changed = self._changed, asyncio.Event()
        changed.set()

    @property
    def states(self) -> list[dict[str, Any]]:
        """What is shown of each cell."""
        return [json.loads(self._states[name][1]) for name in self._names if name in self._states]

    async def serve(self, listener: socket.socket) -> asyncio.Server:
        """Begin to answer."""
        listener.setblocking(False)
        return await asyncio.start_server(self._answer, sock=listener, limit=_MOST_HEADER_BYTES)

    def close(self) -> None:
        """Let all viewers go; none is waited for."""
        for task in list(self._tasks):
            task.cancel()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        peer = writer.get_extra_info("peername") or ("?", 0)
        self._viewers[peer[0]] += 1
        try:
            if self._viewers[peer[0]] > _MOST_FROM_ONE or self._viewers.total() > MOST_VIEWERS:
                await _respond(writer, 503, "too many viewers")
                return
            await self._ask(reader, writer, f"{peer[0]}:{peer[1]}")
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, TimeoutError):
            pass  # it is gone, or said nothing that could be understood
        except asyncio.CancelledError:
            pass  # the end
        finally:
            self._tasks.discard(task)
            self._viewers[peer[0]] -= 1
            writer.close()

    async def _ask(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, peer: str) -> None:
        head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _HEADER_S)
        first, *rest = head.decode("latin-1").split("\r\n")
        method, _, target = first.rpartition(" ")[0].partition(" ")
        headers = [(name, value) for name, colon, value in (line.partition(":") for line in rest) if colon]
        refusal = self._guard.refusal(target, headers)
        if refusal is not None:
            await _respond(writer, refusal.status, refusal.reason)
            return
        path = urlsplit(target).path
        if method not in ("GET", "HEAD"):
            await _respond(writer, 405, "GET only")
        elif path == "/":
            extra = f"Set-Cookie: {self._guard.cookie(self._port)}\r\n" if self._guard.token else ""
            await _respond(writer, 200, screen_page(self._names), "text/html; charset=utf-8", extra)
        elif path == "/events":
            await self._events(writer, peer)
        elif path == "/metrics":
            await _respond(writer, 200, metrics_of(self.states), "text/plain; version=0.0.4; charset=utf-8")
        else:
            await _respond(writer, 404, "nothing is here")

    async def _events(self, writer: asyncio.StreamWriter, peer: str) -> None:
        """The latest state of each cell whenever it changes; states that a slow viewer misses are skipped."""
        writer.transport.set_write_buffer_limits(high=_BUFFER_BYTES)
        writer.write(_head(200, "text/event-stream", "Connection: close\r\n") + b"retry: 1000\n\n")
        shown: dict[str, int] = {}
        while True:
            changed = self._changed
            new = [(n, s) for n, s in self._states.items() if shown.get(n) != s[0]]
            for name, (number, state) in new:
                shown[name] = number
                writer.write(b"data: " + state + b"\n\n")
            if not new:
                writer.write(b": still here\n\n")
            try:
                await asyncio.wait_for(writer.drain(), _READ_S)
            except TimeoutError:
                self.dropped.append(peer)
                self._note(f"viewer {peer} stopped reading, and was dropped")
                writer.transport.abort()
                return
            with suppress(TimeoutError):
                await asyncio.wait_for(changed.wait(), _ALIVE_S)


def _head(status: int, kind: str, extra: str = "") -> bytes:
    reason = {200: "OK", 400: "Bad Request", 401: "Unauthorized", 403: "Forbidden", 404: "Not Found"}
    first = f"HTTP/1.1 {status} {reason.get(status, 'Refused')}\r\nContent-Type: {kind}\r\n"
    return f"{first}{_NEVER_KEPT}{extra}\r\n".encode("latin-1")


async def _respond(
    writer: asyncio.StreamWriter, status: int, text: str, kind: str = _TEXT, extra: str = ""
) -> None:
    body = text.encode()
    length = f"Content-Length: {len(body)}\r\nConnection: close\r\n{extra}"
    writer.write(_head(status, kind, length) + body)
    await asyncio.wait_for(writer.drain(), _READ_S)


@cache
def screen_page(names: tuple[str, ...]) -> str:
    """The page of some cells; it holds nothing of them but their names."""
    return page("screen.html.j2", names=names)
