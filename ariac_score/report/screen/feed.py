"""From the process that watches a cell to the one that shows it."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable

from ariac_score.live.running import Running
from ariac_score.report.screen.state import Showing

__all__ = ["Feed"]

_PERIOD_S = 0.1
_ALIVE_EVERY = 10
"""So many periods without news are followed by a word without content: else nobody finds out who is gone."""
_END_S = 2.0


class Feed:
    """Sends what is shown of a cell, at most ten times a second, and never makes whoever watches wait.

    Args:
        name: Of the cell.
        source: Its address.
        send: Takes each state as JSON, and nothing now and then; it may block. Called on a thread of its own.

    Attributes:
        gone: Called once when nobody takes them any more.
    """

    def __init__(self, name: str, source: str, send: Callable[[bytes], None]) -> None:
        self._showing, self._send = Showing(name, source), send
        self.gone: Callable[[], None] = lambda: None
        self._latest: Running | None = None
        self._lock, self._over = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None

    def show(self, running: Running) -> None:
        """Take a state."""
        with self._lock:
            self._showing.note(running)
            self._latest = running
        if self._thread is None:  # not before the first one: copies of a process have no threads
            self._thread = threading.Thread(target=self._run, name="feed", daemon=True)
            self._thread.start()

    def end(self) -> None:
        """Send the last state, within two seconds."""
        self._over.set()
        if self._thread is not None:
            self._thread.join(_END_S)

    def _run(self) -> None:
        quiet = 0
        try:
            while not self._over.wait(_PERIOD_S):
                quiet = 0 if self._send_latest() else quiet + 1
                if quiet == _ALIVE_EVERY:
                    quiet = 0
                    self._send(b"")
            self._send_latest()
        except OSError:
            self.gone()

    def _send_latest(self) -> bool:
        """Send what is new; whether anything is."""
        with self._lock:
            latest, self._latest = self._latest, None
            state = self._showing.of(latest) if latest is not None else None
        if state is not None:
            self._send(json.dumps(state, separators=(",", ":"), allow_nan=False).encode())
        return state is not None
