"""A limit on the processor time of somebody else's code."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from ariac_score.installed.running import EndedError

__all__ = ["OutOfTime", "Stopwatch"]


class OutOfTime(EndedError):  # noqa: N818  # a limit, no error
    """The code ran longer than it may."""


@dataclass
class Stopwatch:
    """Measures processor time, so that a busy machine is no excuse and no accusation.

    Attributes:
        limit_s: What is allowed, s.
        taken_s: What was taken, s.
    """

    limit_s: float
    taken_s: float = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        """Measure a block, and end it at its limit where the system allows it.

        Raises:
            OutOfTime: It took longer.
        """
        begin_s = time.process_time()
        try:
            with _alarm(self.limit_s):
                yield
        finally:
            self.taken_s = time.process_time() - begin_s
        if self.taken_s > self.limit_s:
            raise OutOfTime


@contextmanager
def _alarm(after_s: float) -> Iterator[None]:
    """Interrupt the block after some processor time, where that is possible: POSIX, main thread."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield
        return

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise OutOfTime

    # SIGPROF counts processor time of user and system, as `process_time` does; SIGALRM counts waiting, too.
    before = signal.signal(signal.SIGPROF, ring)
    signal.setitimer(signal.ITIMER_PROF, after_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
