"""A bucket of Google Cloud Storage: what its JSON API answers to those who list, look and read.

Source: Cloud Storage JSON API v1 (cloud.google.com/storage/docs/json_api): objects list, get, and media.
"""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit


@dataclass
class Bucket:
    """What the storage has, and what it was asked.

    Attributes:
        name: Of the one bucket there is.
        objects: Contents by name.
        token: What a request has to bring; empty when anybody may read.
        forbidden: Whether those who bring it may not read all the same.
        page: So many names a page has at most.
        changing: Names that end so have another generation with every look.
        sent: Bytes of content it sent, by name.
        requests: Path and query of each request.
    """

    name: str
    objects: dict[str, bytes]
    token: str = ""
    forbidden: bool = False
    page: int = 1000
    changing: str = ""
    url: str = ""
    sent: dict[str, int] = field(default_factory=dict)
    requests: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, name: str, below: str, folder: Path) -> Bucket:
        """The files of a folder, below a name; each folder has an object, as those that the console makes."""
        objects = {f"{below}/": b""}
        for path in sorted(folder.rglob("*")):
            key = f"{below}/{path.relative_to(folder).as_posix()}"
            objects |= {f"{key}/": b""} if path.is_dir() else {key: path.read_bytes()}
        return cls(name, objects)

    @property
    def sent_bytes(self) -> int:
        """All content it sent."""
        return sum(self.sent.values())


@contextmanager
def emulating(bucket: Bucket) -> Iterator[Bucket]:
    """A server on this machine, for as long as it is needed."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            bucket.requests.append(self.path)
            parts = urlsplit(self.path)
            asked = {name: values[0] for name, values in parse_qs(parts.query).items()}
            refused = _refused(bucket, self.headers.get("Authorization", ""))
            if refused:
                return self._say(*refused)
            place = re.fullmatch(r"(/download)?/storage/v1/b/([^/]+)(?:/o(?:/([^/]+))?)?/?", parts.path)
            if place is None or place[2] != bucket.name:
                return self._say(404, "The specified bucket does not exist.")
            name = unquote(place[3] or "")
            if not name:
                return self._json(200, _listed(bucket, asked))
            if name not in bucket.objects:
                return self._say(404, f"No such object: {bucket.name}/{name}")
            if place[1] and asked.get("alt") == "media":
                return self._media(name)
            return self._json(200, _about(bucket, name))

        def log_message(self, *_: Any) -> None:
            """Say nothing."""

        def _media(self, name: str) -> None:
            content, status = bucket.objects[name], 200
            headers = {"Content-Type": "application/octet-stream"}
            asked = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
            if asked:
                start, end = int(asked[1]), min(int(asked[2] or len(content)) + 1, len(content))
                if start >= len(content):
                    return self._say(416, "Request range not satisfiable")
                headers["Content-Range"] = f"bytes {start}-{end - 1}/{len(content)}"
                content, status = content[start:end], 206
            bucket.sent[name] = bucket.sent.get(name, 0) + len(content)
            return self._send(status, content, headers)

        def _say(self, status: int, message: str) -> None:
            reason = {401: "required", 403: "forbidden"}.get(status, "notFound")
            error = {"code": status, "message": message, "errors": [{"message": message, "reason": reason}]}
            self._json(status, {"error": error})

        def _json(self, status: int, answer: object) -> None:
            self._send(status, json.dumps(answer).encode(), {"Content-Type": "application/json"})

        def _send(self, status: int, content: bytes, headers: dict[str, str]) -> None:
            self.send_response(status)
            for name, value in headers.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        bucket.url = f"http://127.0.0.1:{server.server_port}"
        thread = Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        thread.start()
        try:
            yield bucket
        finally:
            server.shutdown()
            thread.join()


def _refused(bucket: Bucket, authorization: str) -> tuple[int, str] | None:
    what = "storage.objects.get access to the Google Cloud Storage object (or it may not exist)."
    if bucket.token and not authorization:
        return 401, f"Anonymous caller does not have {what}"
    if bucket.token and authorization != f"Bearer {bucket.token}":
        return 401, "Request had invalid authentication credentials."
    if bucket.forbidden:
        return 403, f"scorer@example.iam.gserviceaccount.com does not have {what}"
    return None


def _listed(bucket: Bucket, asked: dict[str, str]) -> dict[str, object]:
    """A page of names, with those below the delimiter put together."""
    prefix, delimiter = asked.get("prefix", ""), asked.get("delimiter", "")
    found: dict[str, bool] = {}
    for name in sorted(bucket.objects):
        if name.startswith(prefix):
            rest = name[len(prefix) :]
            cut = rest.find(delimiter) if delimiter else -1
            found[prefix + rest[: cut + 1] if cut >= 0 else name] = cut < 0
    most = min(int(asked.get("maxResults", bucket.page)), bucket.page)
    names = [name for name in found if name > asked.get("pageToken", "")]
    page = names[:most]
    answer: dict[str, object] = {"kind": "storage#objects"}
    answer["items"] = [_about(bucket, name) for name in page if found[name]]
    answer["prefixes"] = [name for name in page if not found[name]]
    if len(names) > most:
        answer["nextPageToken"] = page[-1]
    return {key: value for key, value in answer.items() if value}


def _about(bucket: Bucket, name: str) -> dict[str, str]:
    """A new generation comes with new content; the ETag names it."""
    content = bucket.objects[name]
    hashed = hashlib.md5(content).digest()  # noqa: S324  # as the storage does
    looks = len(bucket.requests) if bucket.changing and name.endswith(bucket.changing) else 0
    generation = 1_700_000_000_000_000 + int.from_bytes(hashed[:5], "big") + looks
    return {
        "kind": "storage#object",
        "name": name,
        "bucket": bucket.name,
        "generation": str(generation),
        "metageneration": "1",
        "size": str(len(content)),
        "md5Hash": base64.b64encode(hashed).decode(),
        "etag": base64.b64encode(generation.to_bytes(8, "big")).decode(),
        "storageClass": "STANDARD",
        "timeCreated": "2026-01-01T00:00:00.000Z",
        "updated": "2026-01-01T00:00:00.000Z",
    }
