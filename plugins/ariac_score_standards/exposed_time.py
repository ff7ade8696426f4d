"""For how long somebody was, or may have been, exposed: of many samples some thousand at a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ariac_score import Signal, Span, TimeBase, Total, Trial
from ariac_score_standards.severity import APART, SPEED, STANDSTILL_SPEED_M_S
from ariac_score_standards.watching import BoolArray, FloatArray, Subject

__all__ = ["ExposedTime", "holds_over"]


@dataclass(frozen=True)
class _Now:
    """The samples of all pairs in one window of time.

    Attributes:
        low_s: The window begins here.
        high_s: And ends before this.
        t: The times of all samples, shape (n,), s.
        seen: Of each pair its times with one more on each side, and whether it is seen to be safe there.
        blind: Whether there is a pair of which nothing is known.
        longest_s: A sample never stands for longer than this, s.
    """

    low_s: float
    high_s: float
    t: FloatArray
    seen: Sequence[tuple[FloatArray, BoolArray]]
    blind: bool
    longest_s: float

    def exposed(self, begins: FloatArray) -> BoolArray:
        """Whether somebody may be exposed over the stretch from each mark on."""
        exposed = np.full(len(begins), self.blind)
        for t, safe in self.seen:
            exposed |= ~holds_over(t, safe, begins, self.longest_s)
        return exposed


class ExposedTime:
    """When a human may be near a moving robot: all the time in which no sample shows otherwise.

    Args:
        trial: With the signals.
        pairs: Robots and humans.
        within_m: Within this of the moving robot a human is exposed, m.
        max_gap_s: A sample stands for no longer than this, s.
    """

    def __init__(self, trial: Trial, pairs: Sequence[Subject], *, within_m: float, max_gap_s: float) -> None:
        self._max_gap_s = max_gap_s
        signals = [_signals(trial, pair) for pair in pairs]
        known = [both for both in signals if both]
        self._blind = len(known) < len(pairs)
        every = [signal for both in known for signal in both]
        self._cuts = TimeBase(every, max_gap_s=max_gap_s).cuts if every else np.zeros(0)
        self._pairs = [
            _Pair(TimeBase(both, max_gap_s=max_gap_s, cuts=self._cuts), within_m) for both in known
        ]

    def of(self, asked: Sequence[tuple[Span, Sequence[Span]]]) -> list[tuple[float, float]]:
        """How long somebody was exposed in each of some windows, and how much of that lies in gaps, s.

        Args:
            asked: Each window with its gaps in order of time.
        """
        same = [(window, tuple(gaps)) for window, gaps in asked]
        different = list(dict.fromkeys(same))  # most signals have no gap at all
        counts = [(0, 0) for _ in different]
        for number, *lasts in self._lasting(different):
            before = counts[number]
            counts[number] = before[0] + len(lasts[0]), before[1] + len(lasts[1])
        totals = [(Total(whole), Total(missing)) for whole, missing in counts]
        for number, *lasts in self._lasting(different):
            for total, some in zip(totals[number], lasts, strict=True):
                total.take(some)
        found = {one: (t[0].value, t[1].value) for one, t in zip(different, totals, strict=True)}
        return [found[one] for one in same]

    def _lasting(
        self, asked: Sequence[tuple[Span, Sequence[Span]]]
    ) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Of each that is asked about: how long stretches of exposure last, and those of them in gaps."""
        marks = [_Marks(window, gaps) for window, gaps in asked]
        for now in self._windows():
            for number, own in enumerate(marks):
                yield number, *own.take(now)

    def _windows(self) -> Iterator[_Now]:
        lows, highs = [-np.inf, *self._cuts.tolist()], [*self._cuts.tolist(), np.inf]
        of_pairs = [pair.windows() for pair in self._pairs]
        for low_s, high_s in zip(lows, highs, strict=True):
            parts = [next(windows) for windows in of_pairs]
            t = np.unique(np.concatenate([np.zeros(0), *(own for own, _ in parts)]))
            yield _Now(low_s, high_s, t, [seen for _, seen in parts], self._blind, self._max_gap_s)


def _signals(trial: Trial, pair: Subject) -> list[Signal]:
    """Distance and speed of a pair; nothing where one is missing."""
    names = [pair.fill(APART), pair.fill(SPEED)]
    return [trial.signals[name] for name in names] if trial.signals.keys() >= set(names) else []


class _Pair:
    """When a pair is seen to be apart or the robot at rest."""

    def __init__(self, base: TimeBase, within_m: float) -> None:
        self._base, self._within_m = base, within_m
        times = (base.times(k) for k in range(len(base)))
        firsts = np.array([t[0] if len(t) else np.inf for t in times])
        self._following_s = [*np.minimum.accumulate(firsts[:0:-1])[::-1].tolist(), np.inf]
        """The first sample after each window."""

    def windows(self) -> Iterator[tuple[FloatArray, tuple[FloatArray, BoolArray]]]:
        """The times of each window; with one more on each side, and whether it is so there."""
        before = np.zeros(0), np.zeros(0, dtype=bool)
        for k, following_s in enumerate(self._following_s):
            t, distance, speed = self._base.times(k), self._base.values(0, k), self._base.values(1, k)
            safe = (distance > self._within_m) | (speed <= STANDSTILL_SPEED_M_S)
            after = np.array([following_s] if following_s < np.inf else [])
            around = np.concatenate([before[0], t, after])
            yield t, (around, np.concatenate([before[1], safe, np.zeros(len(after), dtype=bool)]))
            if len(t):
                before = t[-1:], safe[-1:]


class _Marks:
    """Where something may begin or end: at samples of pairs, at gaps, at both ends of a window of time."""

    def __init__(self, window: Span, gaps: Sequence[Span]) -> None:
        self._window = window
        self._starts, self._stops = (
            np.array([getattr(gap, end) for gap in gaps]) for end in ("start_s", "end_s")
        )
        ends = [window.start_s, window.end_s, *self._starts.tolist(), *self._stops.tolist()]
        self._ends = np.unique(ends)
        self._last: tuple[FloatArray, BoolArray] = np.zeros(0), np.zeros(0, dtype=bool)

    def take(self, now: _Now) -> tuple[FloatArray, FloatArray]:
        """Go on to the end of a window of samples: how long each exposure lasts, and each in a gap, s."""
        ends = self._ends[self._ends.searchsorted(now.low_s) : self._ends.searchsorted(now.high_s)]
        marks = np.unique(np.concatenate([ends, now.t])) if len(ends) else now.t
        marks = marks[(marks >= self._window.start_s) & (marks <= self._window.end_s)]
        if not len(marks):
            return np.zeros(0), np.zeros(0)
        begins = np.concatenate([self._last[0], marks])
        exposed = np.concatenate([self._last[1], now.exposed(marks)])
        self._last = begins[-1:], exposed[-1:]
        lasts, begins, exposed = np.diff(begins), begins[:-1], exposed[:-1]
        hidden = self._starts.searchsorted(begins, "right") > self._stops.searchsorted(begins, "right")
        return lasts[exposed], lasts[exposed & hidden]


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
        result = known & holds[row] & (t[row + 1] - t[row] <= longest_s + 1e-9)
    return result
