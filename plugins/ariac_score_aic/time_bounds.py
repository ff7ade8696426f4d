"""Between which times a task began and ended, where no file states them: by the engine's log, else the bag.

Source: `aic_engine.cpp` of intrinsic-dev/aic, lines 1302 to 1420: what is waited for before the goal is sent
and after the result, and what is logged around both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ariac_score_aic.messages import SCORING_TF, TF, AicMessages, IntArray
from ariac_score_aic.task_times import TaskTimes

__all__ = ["Between", "TimeBounds", "bounds_of", "span_ns", "times_of_log"]

Between = tuple[int, int]
"""The first and the last moment at which something can have been, ns of header stamps."""

_SENT, _BEGUN = b"Sending InsertCable goal", b"TrialState: TasksExecuting"
_DONE, _ALL_DONE = b"] succeeded.", b"All tasks have been processed"
_UNDONE = (b"] timed out after", b"] failed:", b"was rejected.")
_LOG = "/rosout"
_WAY_NS = 100_000_000
"""Messages of several senders reach a recorder in another order than they were sent; our choice."""
_AFTER_END_NS = 500_000_000
"""By so much a recording of the engine outlasts the task at most: two rounds of 100 ms, and more."""
_SOON_NS = 2_000_000_000
"""A topic that begins within this begins with the recording: the slowest has a message a second."""


@dataclass(frozen=True)
class TimeBounds:
    """Between which times a task began and ended.

    Attributes:
        start_ns: Of its start; `None` where it had none, or nothing bounds it.
        end_ns: Of its end, likewise.
    """

    start_ns: Between | None = None
    end_ns: Between | None = None

    @property
    def duration_s(self) -> tuple[float, float] | None:
        """The least and the most that it can have taken; `None` without both bounds."""
        if self.start_ns is None or self.end_ns is None:
            return None
        least_ns = max(self.end_ns[0] - self.start_ns[1], 0)
        return least_ns / 1e9, max(self.end_ns[1] - self.start_ns[0], 0) / 1e9


def times_of_log(messages: AicMessages) -> TaskTimes | None:
    """Whether the task was completed, by what the engine logs; `None` where the log says nothing of it."""
    texts = [text for text in messages.log.texts if b"Task [" in text or b"InsertCable goal" in text]
    if any(_DONE in text for text in texts):
        return TaskTimes(completed=True, source=_LOG)
    if any(end in text for text in texts for end in _UNDONE):
        return TaskTimes(end_known=True, completed=False, source=_LOG)
    return None


def bounds_of(messages: AicMessages, times: TaskTimes, *, by_engine: bool) -> TimeBounds:
    """Between which times the task of a recording began and ended.

    Args:
        messages: The recording.
        times: What is stated of the times.
        by_engine: Whether the engine made the recording, so that its end follows on that of the task.
    """
    clock = _Clock(messages)
    first_ns, last_ns = clock.span
    if last_ns < first_ns:
        return TimeBounds()
    begun = _logged(messages, clock, _SENT, _BEGUN) or (clock.both_ns, _first_command_ns(messages, clock))
    ended = _logged(messages, clock, _DONE, _ALL_DONE)
    if ended is None:
        ended = (max(last_ns - _AFTER_END_NS, first_ns) if by_engine else begun[0], last_ns)
    start = None if times.start_known and times.start_ns is None else begun
    if times.start_ns is not None:
        start = (times.start_ns, times.start_ns)
    end = None if times.not_completed else ended
    if times.end_ns is not None:
        end = (times.end_ns, times.end_ns)
    return _by_duration(TimeBounds(start, end), times)


def _by_duration(bounds: TimeBounds, times: TaskTimes) -> TimeBounds:
    """The same where the duration is known: what bounds one end bounds the other."""
    if times.duration_s is None or bounds.start_ns is None or bounds.end_ns is None:
        return bounds
    within_ns = 0 if times.exact else 5_100_000
    lasts_ns = round(times.duration_s * 1e9)
    start = _meeting(bounds.start_ns, tuple(e - lasts_ns for e in bounds.end_ns), within_ns)
    end = _meeting(bounds.end_ns, tuple(s + lasts_ns for s in bounds.start_ns), within_ns)
    if start is None or end is None:  # what is stated counts, and what the bag suggests does not
        return bounds
    return replace(bounds, start_ns=start, end_ns=end)


def _meeting(a: Between, b: tuple[int, ...], within_ns: int) -> Between | None:
    least, most = max(a[0], b[0] - within_ns), min(a[1], b[1] + within_ns)
    return (least, most) if least <= most else None


def _logged(messages: AicMessages, clock: _Clock, before: bytes, after: bytes) -> Between | None:
    """Between two texts of the log: the last of the first kind, and the first of the other one after it."""
    orders, texts = messages.log.order.tolist(), messages.log.texts
    first = max((o for o, text in zip(orders, texts, strict=True) if before in text), default=None)
    if first is None:
        return None
    last = min(
        (o for o, text in zip(orders, texts, strict=True) if after in text and o > first), default=None
    )
    first_ns, last_ns = clock.span
    least_ns = max(clock.before(first) - _WAY_NS, first_ns)
    return least_ns, min(clock.after(first if last is None else last) + _WAY_NS, last_ns)


def span_ns(messages: AicMessages) -> Between:
    """The first and the last header stamp of what is sent all the time; the last first without any."""
    return _Clock(messages).span


def _first_command_ns(messages: AicMessages, clock: _Clock) -> int:
    """The first command, before which the task began; the end of the recording where nothing shows it."""
    first_ns, last_ns = clock.span
    found = [int(times[0]) for times in messages.commands_ns.values() if len(times)]
    # Commands have the recorder's times alone, which say something where they are on the clock of headers.
    same_clock = messages.recorded_ns and first_ns - _WAY_NS <= messages.recorded_ns[0] <= last_ns
    earliest_ns = min(found, default=last_ns) + _WAY_NS
    return min(max(earliest_ns, clock.both_ns), last_ns) if same_clock else last_ns


class _Clock:
    """Header stamps while the recording goes on, of what is stamped and sent all the time."""

    def __init__(self, messages: AicMessages) -> None:
        moving, states = messages.transforms, messages.controller
        number = {name: i for i, name in enumerate(moving.topics)}
        rows = [moving.topic == number.get(topic, -1) for topic in (TF, SCORING_TF)]
        self._firsts = [int(moving.stamp_ns[r][0]) for r in rows if r.any()]
        either = (rows[0] | rows[1]) if len(moving) else np.zeros(0, dtype=bool)
        forces = messages.wrenches.values()
        order = np.concatenate([moving.order[either], states.order, *(one.order for one in forces)])
        stamps = np.concatenate([moving.stamp_ns[either], states.stamp_ns, *(one.stamp_ns for one in forces)])
        kept = stamps > 0
        by_order = np.argsort(order[kept], kind="stable")
        self._order: IntArray = order[kept][by_order]
        # A stamp may lag behind: what was reached once is not undone.
        self._stamps: IntArray = np.maximum.accumulate(stamps[kept][by_order]) if kept.any() else stamps[:0]

    @property
    def span(self) -> Between:
        """The first and the last stamp; the last before the first without any."""
        return (int(self._stamps[0]), int(self._stamps[-1])) if len(self._stamps) else (0, -1)

    @property
    def both_ns(self) -> int:
        """When both moving topics had been heard, for which the engine waits before it sends the goal.

        Where one begins much later than the recording, its beginning may be missing.
        """
        both_ns = max(self._firsts, default=self.span[0])
        return both_ns if both_ns - self.span[0] <= _SOON_NS else self.span[0]

    def before(self, order: int) -> int:
        """The latest stamp until a message."""
        at = int(np.searchsorted(self._order, order)) - 1
        return int(self._stamps[max(at, 0)])

    def after(self, order: int) -> int:
        """The first stamp after a message."""
        at = int(np.searchsorted(self._order, order))
        return int(self._stamps[min(at, len(self._stamps) - 1)])
