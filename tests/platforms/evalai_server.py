"""A server that does what the notes on EvalAI say its code does."""

from __future__ import annotations

import json
import math
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from ariac_score.platforms.neutral import COLUMNS

__all__ = ["LABELS", "Platform"]

LABELS = [column.key for column in COLUMNS]


class Platform(ThreadingHTTPServer):
    """The platform's side: one queue, its checks, and the faults it is told to have."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.queue: list[dict[str, Any]] = []
        self.files: dict[str, bytes] = {}
        self.status = "submitted"
        self.requests: list[tuple[str, str]] = []
        self.taken: list[dict[str, Any]] = []
        self.acknowledged: list[str] = []
        self.faults: list[int] = []
        self.cut = False
        self.codename = "finals"
        self.schemes = ("Bearer",)
        self.refused: list[str] = []

    def accepts(self, body: dict[str, Any]) -> tuple[int, str]:
        """The checks on the body that ends an evaluation."""
        if body["submission_status"] != "FINISHED":
            return 200, ""
        if not isinstance(body["result"], str):
            return 400, "result is not a string"
        for row in json.loads(body["result"]):
            if row.get("split") != "finals":
                return 400, "Challenge Phase Split does not exist"
            for label, value in row["accuracies"].items():
                if label not in LABELS:
                    return 400, f"unknown label {label}"
                if not isinstance(value, (int, float)):
                    return 400, f"{label} is no number"
                if not math.isfinite(value):
                    return 500, "the database rejects it"
        return 200, ""


class _Handler(BaseHTTPRequestHandler):
    server: Platform

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def _reply(self, status: int, body: Any, *, raw: bytes | None = None) -> None:
        text = raw if raw is not None else json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(text) + (5 if raw is not None and self.server.cut else 0)))
        self.end_headers()
        self.wfile.write(text)

    def _serve(self, method: str) -> None:
        server = self.server
        server.requests.append((method, self.path))
        length = int(self.headers.get("Content-Length") or 0)
        body = json.loads(self.rfile.read(length)) if length else {}
        if self.path.startswith("/media/") and self.path not in server.files:
            self._reply(404, {})
        elif self.path.startswith("/media/"):
            self._reply(200, None, raw=server.files[self.path])
        elif self.headers.get("Authorization") not in [f"{scheme} secret" for scheme in server.schemes]:
            server.refused.append(self.headers.get("Authorization", "").partition(" ")[0])
            self._reply(401, {"detail": "Invalid token."})
        elif method == "GET" and "/queues/" in self.path:
            self._reply(200, server.queue[0] if server.queue else {})
        elif method == "GET" and "/challenge_phase/" in self.path:
            self._reply(200, {"codename": server.codename, "test_annotation": None})
        elif method == "GET":
            self._reply(200, {"status": server.status, "input_file": next(iter(server.files), "")})
        elif method == "POST":
            server.acknowledged.append(body["receipt_handle"])
            server.queue.pop(0)
            self._reply(200, {})
        elif method == "PATCH":
            self._reply(200, {})
        elif server.faults:
            self._reply(server.faults.pop(0), {"error": "fault"})
        else:
            status, words = server.accepts(body)
            if status == 200:
                server.taken.append(body)
            self._reply(status, {"error": words})

    def do_GET(self) -> None:  # the name the library calls
        self._serve("GET")

    def do_POST(self) -> None:
        self._serve("POST")

    def do_PUT(self) -> None:
        self._serve("PUT")

    def do_PATCH(self) -> None:
        self._serve("PATCH")
