"""Streams of samples, the intervals of them that are open, and the cells that these are cut into."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ariac_score.trial.bounds import USUAL_INTERVALS, BetweenSamples
from ariac_score.trial.clock import Clock
from ariac_score.trial.computed import Computed
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import BoolArray, FloatArray, Span, distinct, within_spans

__all__ = [
    "INSTANT_S",
    "TOLERANCE_S",
    "USUAL_INTERVALS",
    "Cells",
    "Stream",
    "cells_of",
    "longest_held_s",
    "shown_within_s",
    "standing",
    "usual_interval_s",
]

TOLERANCE_S = 1e-9
INSTANT_S = 1e-9
"""A sample stands for itself alone where the time after it is bounded."""

CELL_M = 0.005
"""A cell is so short that nothing moves further in it, within the least and the most number of them."""
LEAST_CELLS, MOST_CELLS = 2, 1024

_ROUND_NS = 1024 * 10**9
"""A multiple of the length of each cell that is shorter, ns."""


# Streams and their open intervals --------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Stream:
    """Samples that were recorded together, and which intervals between them are open.

    Interval k is the one after sample k - 1: the first is before all samples, the last after them.

    Attributes:
        signal: One of the recorded signals.
        open: Which intervals are open, shape (n + 1,).
        published_s: How far apart its samples would be as an organiser states it, s, where they are much
            further apart in this recording; 0 otherwise.
        stands_for: The topic that would show the same and is not recorded; empty: it stands for itself.
        held_s: The longest interval that is not open, s: so long a sample stands.
    """

    signal: Signal
    open: BoolArray
    published_s: float = 0.0
    stands_for: str = ""
    held_s: float = 0.0

    @property
    def t(self) -> FloatArray:
        """The sample times, shape (n,), s."""
        return self.signal.t

    @classmethod
    def of(
        cls,
        signal: Signal,
        window: Span,
        max_gap_s: float,
        assumed: BetweenSamples,
        *,
        started: bool = True,
        ended: bool = False,
    ) -> Stream:
        """The stream of a recorded signal.

        Args:
            signal: As recorded.
            window: The competition.
            max_gap_s: Longest stretch without a sample that a monitor accepts, s.
            assumed: Whether every interval is open.
            started: Whether the log states the start, and the recording does not just begin then.
            ended: Whether the log states the end, so that the last sample is not that of the recording.
        """
        t = signal.t
        if signal.constant:
            return cls.never_open(signal)
        edges = np.concatenate(([-np.inf], t, [np.inf]))
        start = np.maximum(edges[:-1], window.start_s)
        lasts = np.minimum(edges[1:], window.end_s) - start
        inside = (t >= window.start_s) & (t <= window.end_s)
        steps = np.diff(t[inside])
        usual = float(np.median(steps)) if len(steps) else math.inf
        stated = 1.0 / signal.stated_rate_hz if signal.stated_rate_hz else math.inf
        # All messages that its recorder received and the log lacks may have been samples of this one.
        received = usual * len(t) / max(1, len(t) + assumed.lacking.get(signal.source, 0))
        thinned = usual > USUAL_INTERVALS * stated
        longest = 0.0 if assumed.every else longest_held_s(min(received, stated), max_gap_s)
        whole = np.diff(edges)  # an interval that the window cuts is as long as it is
        whole[[0, -1]] = lasts[[0, -1]]
        missing = np.zeros(len(whole), dtype=bool)  # of what the log itself leaves out no length is usual
        # No sample stands for what was before the first, where one is missing: there was a start before, or
        # one more would have come since the recording began.
        missing[0] = bool(len(t)) and (started or whole[0] >= min(received, stated) - TOLERANCE_S)
        missing[-1] = ended and bool(len(t))  # nor is there one that ends what the last one says
        missing[1:-1] = within_spans((t[1:] + t[:-1]) / 2, signal.holes)
        unseen = (missing | (whole > longest + TOLERANCE_S)) & (lasts > TOLERANCE_S)
        return cls(signal, unseen, stated if thinned else 0.0, held_s=longest)

    @classmethod
    def never_open(cls, signal: Signal) -> Stream:
        """The stream of a signal of which nothing is open."""
        return cls(signal, np.zeros(len(signal.t) + 1, dtype=bool))

    def edges(self, window: Span, beside: int = 0) -> FloatArray:
        """Beginnings and ends of the open intervals, as far as they lie in a window, shape (2, k), s.

        Args:
            window: A competition.
            beside: With so many intervals before and behind each.
        """
        edges = np.clip(np.concatenate(([-np.inf], self.t, [np.inf])), window.start_s, window.end_s)
        there = self._open_or_beside(beside)
        return np.stack([edges[:-1][there], edges[1:][there]])

    def _open_or_beside(self, intervals: int) -> BoolArray:
        found = self.open.copy()
        for apart in range(1, min(intervals, len(found) - 1) + 1):
            found[apart:] |= self.open[:-apart]
            found[:-apart] |= self.open[apart:]
        return found

    def is_open(self, cells: Cells, beside: int = 0) -> BoolArray:
        """Whether each cell lies in an open interval, shape (n,).

        Args:
            cells: Of a competition.
            beside: Or within so many intervals of one.
        """
        return np.asarray(self._open_or_beside(beside)[np.searchsorted(self.t, cells.t, side="right")])

    def may_lack(self, cells: Cells) -> BoolArray:
        """Whether a sample may be missing in each cell, shape (n,): it is open and no instant of a sample."""
        return self.is_open(cells) & ~(cells.instants & np.isin(cells.t, self.t))

    def spans(self, window: Span, beside: int = 0) -> list[Span]:
        """The open intervals, and so many beside each, as far as they lie in a window."""
        return [Span(float(start), float(end)) for start, end in self.edges(window, beside).T]


def longest_held_s(usual_s: float, max_gap_s: float) -> float:
    """How long a sample stands at most, s.

    Args:
        usual_s: The usual interval of its stream, s.
        max_gap_s: Longest stretch without a sample that a monitor accepts, s.

    >>> longest_held_s(0.02, 0.05), longest_held_s(0.1, 0.05)
    (0.03, 0.05)
    """
    return min(max_gap_s, USUAL_INTERVALS * usual_s)


def shown_within_s(signal: Signal, max_gap_s: float) -> float:
    """How far apart two samples of a signal are at most where none between them is missing, s.

    Args:
        signal: Any; of one that follows from others these decide.
        max_gap_s: Longest stretch without a sample that is accepted, s.

    >>> force = Signal("contact_force/arm/ann", "N", np.array([0.0, 0.02, 0.04]), np.zeros(3))
    >>> shown_within_s(force, 0.05), shown_within_s(force, 0.02)
    (0.03, 0.02)
    """
    if isinstance(signal, Computed) or len(signal) < 2:
        return max_gap_s
    return longest_held_s(usual_interval_s(signal), max_gap_s)


def usual_interval_s(signal: Signal) -> float:
    """The usual interval of the samples of a signal, s: as stated, or as they came where that is shorter."""
    stated_s = 1.0 / signal.stated_rate_hz if signal.stated_rate_hz else math.inf
    return min(float(np.median(np.diff(signal.t))), stated_s) if len(signal) > 1 else stated_s


# Cells -----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Cells:
    """The time of a competition, cut so that in each cell every stream is measured or open.

    Attributes:
        t: When each begins, shape (n,), s.
        end: When each ends, shape (n,), s; the last one has no length.
    """

    t: FloatArray
    end: FloatArray

    @property
    def instants(self) -> BoolArray:
        """Which are no longer than the instant of a sample, shape (n,)."""
        return np.asarray(self.end - self.t <= 2 * INSTANT_S)


def standing(
    least: FloatArray,
    most: FloatArray,
    cells: Cells,
    is_open: BoolArray,
    stands_s: float,
    ahead_s: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Bounds of what a sample that is missing would have said, where each stands until the next one.

    That is the least and the most of the time it may have stood for, so that whoever leaves out samples
    leaves out nothing of what they said.

    Args:
        least: Of the quantity itself in each cell, shape (n,).
        most: Likewise.
        cells: Of a competition.
        is_open: Where samples may be missing, shape (n,).
        stands_s: How long after the time it is of a sample stands at most, s.
        ahead_s: How long before that time it may stand already, where stamps are wrong, s.
    """
    if stands_s + ahead_s <= 0.0 or not is_open.any():
        return least, most
    rows = np.arange(len(cells.t))
    # The first cell of each open stretch, or the instant of the sample before it, which stands as well.
    begins = np.maximum.accumulate(np.where(is_open, 0, np.where(cells.instants, rows, rows + 1)))
    ends = np.minimum.accumulate(np.where(is_open, len(rows), rows)[::-1])[::-1]
    first = np.maximum(np.searchsorted(cells.end, cells.t - stands_s, side="right"), begins)
    behind = np.minimum(np.searchsorted(cells.t, cells.end + ahead_s, side="left"), ends)
    pairs = np.stack((np.minimum(first, rows), np.maximum(behind, rows + 1)), axis=1).reshape(-1)
    low, high = (
        of.reduceat(np.append(values, values[-1]), pairs)[::2]
        for of, values in ((np.minimum, least), (np.maximum, most))
    )
    return np.where(is_open, low, least), np.where(is_open, high, most)


def cells_of(
    window: Span,
    measured: Sequence[FloatArray],
    streams: Sequence[Stream],
    rate_m_s: float,
    clocks: Sequence[Clock] = (),
) -> Cells:
    """The cells between samples.

    Args:
        window: The competition.
        measured: Times of samples, each shape (k,), s.
        streams: Their open intervals are cut finely.
        rate_m_s: How fast anything changes, m/s: the faster, the finer.
        clocks: Of the log. Cells are cut at multiples of their length on its clock, so that where a recording
            begins, such as with a message that nobody reads, moves no bound.
    """
    zero_s = ((clocks[0].origin_ns or 0) % _ROUND_NS) / 1e9 if clocks else 0.0
    found = [np.array([window.start_s, window.end_s]), *measured]
    for stream in streams:
        starts, ends = stream.edges(window)
        steps_s = _steps_s(ends - starts, rate_m_s)
        for step_s in distinct(steps_s):  # all intervals that are cut alike at once
            own = steps_s == step_s
            found.append(_multiples(step_s, starts[own] + zero_s, ends[own] + zero_s) - zero_s)
        found += [np.minimum(starts + INSTANT_S, ends), ends]
        found.append(stream.t[stream.open[1:] | stream.open[:-1]])
    t = distinct(np.concatenate(found))
    t = t[(t >= window.start_s) & (t <= window.end_s)]
    return Cells(t, np.append(t[1:], t[-1:]))


def _steps_s(lasts_s: FloatArray, rate_m_s: float) -> FloatArray:
    """How long the cells of open intervals are: powers of two, and the longer, the longer an interval is.

    So the cells of an interval are those of the shorter ones within it, or several of them joined, and who
    leaves out a sample in between never makes a bound narrower by cutting elsewhere.
    """
    shortest = np.maximum(lasts_s, TOLERANCE_S) / MOST_CELLS
    wanted = np.maximum(np.minimum(CELL_M / max(rate_m_s, TOLERANCE_S), lasts_s / LEAST_CELLS), shortest)
    return np.asarray(np.exp2(np.round(np.log2(wanted))), dtype=np.float64)


def _multiples(step_s: float, starts: FloatArray, ends: FloatArray) -> FloatArray:
    """All multiples of a step in some intervals."""
    first = np.ceil(starts / step_s)
    count = np.maximum(np.floor(ends / step_s) - first + 1, 0).astype(np.intp)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return np.asarray((np.repeat(first, count) + within) * step_s, dtype=np.float64)
