"""A web server with the files of a folder: ranges, ETags, listings, and the faults of real ones."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from html import escape
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Event, Lock, Thread
from typing import Any
from urllib.parse import quote, unquote, urlsplit


@dataclass
class Web:
    """What the server does, and what it was asked.

    Attributes:
        root: Folder it shows.
        ranges: Whether it gives parts.
        etags: Whether it says what changes with the content.
        status: For paths that end so, the status of its answer.
        cut: Paths that end so are sent only in part, with their whole length announced.
        changed: Paths that end so have another ETag with every answer.
        silent: Paths that end so are never answered, as long as the server is there.
        endless: Every folder that is asked for has another one in it.
        busy: So many requests are answered with 503 first.
        sent: Bytes of content it sent, by path.
        requests: Method and path of each request.
    """

    root: Path
    ranges: bool = True
    etags: bool = True
    status: dict[str, int] = field(default_factory=dict)
    cut: str = ""
    changed: str = ""
    silent: str = ""
    endless: bool = False
    busy: int = 0
    url: str = ""
    sent: dict[str, int] = field(default_factory=dict)
    requests: list[tuple[str, str]] = field(default_factory=list)
    lock: Any = field(default_factory=Lock)
    ended: Event = field(default_factory=Event)

    @property
    def sent_bytes(self) -> int:
        return sum(self.sent.values())


@contextmanager
def serving(root: Path, **options: Any) -> Iterator[Web]:
    """A server on this machine, for as long as it is needed."""
    web = Web(root, **options)

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_HEAD(self) -> None:
            self._answer(body=False)

        def do_GET(self) -> None:
            self._answer(body=True)

        def log_message(self, *_: Any) -> None:
            """Say nothing."""

        def _answer(self, *, body: bool) -> None:
            name = unquote(urlsplit(self.path).path)
            with web.lock:
                web.requests.append((self.command, name))
                count, busy = len(web.requests), web.busy > 0
                web.busy -= busy
            if web.silent and name.endswith(web.silent):
                web.ended.wait()
            if web.endless and name.endswith("/"):
                links = "".join(f'<a href="{number}/">{number}/</a>\n' for number in range(10))
                self._send(200, links.encode(), {"Content-Type": "text/html"}, body=body)
                return
            status = next((s for end, s in web.status.items() if name.endswith(end)), 503 if busy else 0)
            place = web.root / name.lstrip("/")
            if status or not place.exists():
                self._send(status or 404, b"", {}, body=body)
            elif place.is_dir():
                links = [f"{quote(p.name)}{'/' if p.is_dir() else ''}" for p in sorted(place.iterdir())]
                page = "".join(f'<a href="{escape(link)}">{escape(link)}</a>\n' for link in ["../", *links])
                self._send(200, page.encode(), {"Content-Type": "text/html"}, body=body)
            else:
                self._file(name, place.read_bytes(), count, body=body)

        def _file(self, name: str, content: bytes, count: int, *, body: bool) -> None:
            headers = {"Content-Type": "application/octet-stream"}
            if web.etags:
                odd = str(count) if web.changed and name.endswith(web.changed) else ""
                headers["ETag"] = f'"{hashlib.md5(content).hexdigest()}{odd}"'  # noqa: S324  # as servers do
            headers["Accept-Ranges"] = "bytes" if web.ranges else "none"
            asked = re.fullmatch(r"bytes=(\d+)-(\d+)", self.headers.get("Range", ""))
            part, status = content, 200
            if asked and web.ranges:
                start, end = int(asked[1]), min(int(asked[2]) + 1, len(content))
                part, status = content[start:end], 206
                headers["Content-Range"] = f"bytes {start}-{end - 1}/{len(content)}"
            if body:
                with web.lock:
                    web.sent[name] = web.sent.get(name, 0) + len(part)
            self._send(status, part, headers, body=body, cut=bool(web.cut) and name.endswith(web.cut))

        def _send(
            self, status: int, content: bytes, headers: dict[str, str], *, body: bool, cut: bool = False
        ) -> None:
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            if body:
                with suppress(ConnectionError):  # whoever asked may have heard enough
                    self.wfile.write(content[: len(content) // 2] if cut else content)
            if cut:
                self.close_connection = True

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        web.url = f"http://127.0.0.1:{server.server_port}"
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        thread.start()
        try:
            yield web
        finally:
            web.ended.set()
            server.shutdown()
            thread.join()
