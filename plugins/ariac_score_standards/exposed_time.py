"""How long somebody was, or may have been, exposed to a robot."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ariac_score import FloatArray, Span, Trial, align, exact_sum
from ariac_score.monitors import APART, SPEED, STANDSTILL_SPEED_M_S, TOLERANCE_S, BoolArray, Subject

__all__ = ["ExposedTime", "holds_over"]


class ExposedTime:
    """When a human may be near a moving robot: all the time in which no sample shows otherwise.

    Args:
        trial: With the signals.
        pairs: Robots and humans.
        within_m: Within this of the moving robot a human is exposed, m.
        max_gap_s: A sample stands for no longer than this, s.

    Raises:
        MissingSignalError: What would show it is there only as consumed, so that it cannot be used over time.
    """

    def __init__(self, trial: Trial, pairs: Sequence[Subject], *, within_m: float, max_gap_s: float) -> None:
        self._max_gap_s = max_gap_s
        self._pairs = [_safe_over(trial, pair, within_m, max_gap_s) for pair in pairs]
        self._t = np.unique(np.concatenate([np.zeros(0), *(t for t, _ in self._pairs)]))
        self._known: dict[tuple[Span, tuple[Span, ...]], tuple[float, float]] = {}

    def of(self, window: Span, gaps: Sequence[Span]) -> tuple[float, float]:
        """How long somebody was exposed in a window of time, and how much of that lies in gaps, s.

        Args:
            window: From when to when.
            gaps: In order of time.
        """
        key = window, tuple(gaps)
        if key not in self._known:  # most signals have no gap at all, and share one answer
            self._known[key] = self._measured(*key)
        return self._known[key]

    def _measured(self, window: Span, gaps: Sequence[Span]) -> tuple[float, float]:
        starts, stops = (np.array([getattr(gap, end) for gap in gaps]) for end in ("start_s", "end_s"))
        marks = np.unique(np.concatenate([[window.start_s, window.end_s], starts, stops, self._t]))
        marks = marks[(marks >= window.start_s) & (marks <= window.end_s)]
        lasts, begins = np.diff(marks), marks[:-1]
        exposed = np.zeros(len(begins), dtype=bool)
        for t, safe in self._pairs:
            exposed |= ~holds_over(t, safe, begins, self._max_gap_s)
        hidden = starts.searchsorted(begins, "right") > stops.searchsorted(begins, "right")
        return exact_sum(lasts[exposed]), exact_sum(lasts[exposed & hidden])


def _safe_over(
    trial: Trial, pair: Subject, within_m: float, max_gap_s: float
) -> tuple[FloatArray, BoolArray]:
    """The times of the samples of a pair, and whether they show it to be far apart or the robot at rest."""
    apart, moving = (trial.find_signal(pair.fill(template)) for template in (APART, SPEED))
    if apart is None or moving is None:
        return np.zeros(0), np.zeros(0, dtype=bool)
    t, (distance, speed) = align([apart, moving], max_gap_s=max_gap_s)
    return t, (distance > within_m) | (speed <= STANDSTILL_SPEED_M_S)


def holds_over(t: FloatArray, holds: BoolArray, begins: FloatArray, longest_s: float) -> BoolArray:
    """Whether something holds over the stretch from each mark on; a sample counts until the next.

    >>> t, holds = np.array([0.0, 1.0, 5.0]), np.array([True, True, True])
    >>> holds_over(t, holds, np.array([0.5, 1.0, 6.0]), 1.0).tolist()
    [True, False, False]
    """
    at = np.searchsorted(t, begins, side="right") - 1
    known = (at >= 0) & (at < len(t) - 1)
    row = np.clip(at, 0, max(len(t) - 2, 0))
    result = np.zeros(len(begins), dtype=bool)
    if len(t) > 1:
        result = known & holds[row] & (t[row + 1] - t[row] <= longest_s + TOLERANCE_S)
    return result
