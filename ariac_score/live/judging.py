"""Judging the trial so far in a process of its own, so that neither messages nor margins wait for it."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection as Pipe
from queue import SimpleQueue
from typing import Protocol

from ariac_score.errors import NeedsCohortError, ScoreError
from ariac_score.live.so_far import SoFar
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.results.result import Result

__all__ = ["Apart", "Here", "Judged", "Judging", "judging_of"]

_END_S = 1.0
_TOGETHER = 64
"""So many messages are sent together at most."""


@dataclass(frozen=True)
class Judged:
    """What judging the trial so far came to.

    Attributes:
        result: `None` where it cannot be scored yet.
        so_far: The same as if nothing more came.
        open: Why not, in words.
        cost_s: The processor time it took, s.
    """

    result: Result | None
    so_far: Result | None
    open: str
    cost_s: float


class Judging(Protocol):
    """Takes what comes, and judges it when asked."""

    def take(self, item: Connection | Message) -> None:
        """Take one item."""

    def ask(self) -> None:
        """Ask for the trial so far to be judged."""

    def answer(self) -> Judged | None:
        """What was asked for; `None` while it is not there."""

    def close(self) -> None:
        """End."""


def judging_of(so_far: SoFar, *, apart: bool) -> Judging:
    """Judge in a process of its own, if wanted, and if this system can copy a process."""
    return Apart(so_far) if apart and "fork" in get_all_start_methods() else Here(so_far)


class Here:
    """Judges on the thread that asks."""

    def __init__(self, so_far: SoFar) -> None:
        self._so_far, self._judged = so_far, list[Judged]()

    def take(self, item: Connection | Message) -> None:
        """Take one item."""
        self._so_far.take(item)

    def ask(self) -> None:
        """Judge."""
        self._judged = [_judge(self._so_far)]

    def answer(self) -> Judged | None:
        """What was asked for."""
        return self._judged.pop() if self._judged else None

    def close(self) -> None:
        """Nothing is open."""


class Apart:
    """Judges in a copy of this process, which is made at once: before any thread is started."""

    def __init__(self, so_far: SoFar) -> None:
        context = get_context("fork")
        theirs, self._items = context.Pipe(duplex=False)
        self._answers, answers = context.Pipe(duplex=False)
        self._numbers: dict[Connection, int] = {}
        self._waiting: list[object] = []
        ours = self._items, self._answers
        self._process = context.Process(
            target=_serve, args=(so_far, theirs, answers, ours), name="judging", daemon=True
        )
        self._process.start()
        theirs.close()
        answers.close()

    def take(self, item: Connection | Message) -> None:
        """Take one item."""
        if isinstance(item, Connection):
            self._numbers[item] = len(self._numbers)
            self._waiting.append(item)
        else:
            number = self._numbers[item.connection]
            self._waiting.append((number, item.stamp_ns, bytes(item.payload), item.sequence))
            if len(self._waiting) >= _TOGETHER:
                self._send(self._waiting)

    def ask(self) -> None:
        """Ask for the trial so far to be judged."""
        self._waiting.append(None)
        self._send(self._waiting)

    def answer(self) -> Judged | None:
        """What was asked for; `None` while it is not there."""
        try:
            if not self._answers.poll():
                return None
            judged: Judged = self._answers.recv()
        except (EOFError, OSError):
            return Judged(None, None, "the process that judges is gone", 0.0)
        return judged

    def close(self) -> None:
        """End it, whatever it is doing."""
        self._items.close()
        self._process.terminate()
        self._process.join(_END_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join(_END_S)
        self._answers.close()

    def _send(self, items: list[object]) -> None:
        with suppress(OSError):  # where it is gone, the next answer says so
            self._items.send(items)
        self._waiting = []


def _serve(so_far: SoFar, items: Pipe, answers: Pipe, ours: Sequence[Pipe]) -> None:
    """Take items and judge when asked, until nobody is there any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for whoever watches
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    for end in ours:
        end.close()
    asked: SimpleQueue[bool] = SimpleQueue()
    # Read on a thread of its own: whoever sends waits for nothing that is judged.
    threading.Thread(target=_take, args=(so_far, items, asked), daemon=True).start()
    try:
        while asked.get():
            answers.send(_judge(so_far))
    except OSError:  # whoever asked is gone
        pass
    os._exit(0)


def _take(so_far: SoFar, items: Pipe, asked: SimpleQueue[bool]) -> None:
    connections: list[Connection] = []
    try:
        while True:
            for item in items.recv():
                if item is None:
                    asked.put(True)
                elif isinstance(item, Connection):
                    connections.append(item)
                    so_far.take(item)
                else:
                    number, stamp_ns, payload, sequence = item
                    so_far.take(Message(connections[number], stamp_ns, payload, sequence))
    except (EOFError, OSError):
        asked.put(False)


def _judge(so_far: SoFar) -> Judged:
    began_s = time.process_time()
    result, settled, why = None, None, ""
    try:
        result = so_far.judge()
        settled = so_far.settled(result)
    except NeedsCohortError as error:
        why = str(error)
    except ScoreError as error:
        why = str(error.cause)
    return Judged(result, settled, why, time.process_time() - began_s)
