"""Stretches of time, and the episodes a condition forms over sampled time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BoolArray",
    "FloatArray",
    "Span",
    "distinct",
    "episodes_where",
    "longest_silence_s",
    "merged",
    "sample_durations",
    "uncovered_spans",
    "with_holes",
    "within_spans",
]

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]

_TIME_TOLERANCE_S = 1e-9
"""Stamps are ns; sums of them in float64 differ from the decimal figure by far less than this."""


@dataclass(frozen=True, order=True)
class Span:
    """A closed stretch of trial time.

    Attributes:
        start_s: Start, s of trial time.
        end_s: End, s of trial time, never before the start.
    """

    start_s: float
    end_s: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.start_s) and math.isfinite(self.end_s)):
            raise ValueError(f"a span from {self.start_s} to {self.end_s} has no end")
        if not self.start_s <= self.end_s:
            raise ValueError(f"a span cannot end ({self.end_s}) before it starts ({self.start_s})")

    @property
    def duration_s(self) -> float:
        """Length in s."""
        return self.end_s - self.start_s

    def overlaps(self, other: Span) -> bool:
        """Whether the two share at least one instant."""
        return self.start_s <= other.end_s and other.start_s <= self.end_s


def _refuse_disordered(t: FloatArray) -> None:
    """Refuse times that do not increase, as those of a series as consumed need not.

    Raises:
        ValueError: With the first that does not.
    """
    back = t[1:] <= t[:-1]
    if back.any():
        at = float(t[1:][back][0])
        raise ValueError(f"times must increase, and do not at {at:g} s; a series as consumed goes by index")


def sample_durations(t: FloatArray, *, longest_s: float = math.inf) -> FloatArray:
    """How long each sample stands for.

    Sample k stands for [t_k, t_k+1); the last one for no time at all. Sums of
    these, never sample counts, are durations, so that the log rate does not
    change a score.

    Args:
        t: Sample times, shape (n,), s, strictly increasing.
        longest_s: A sample never stands for longer than this, in s.

    Returns:
        Durations, shape (n,), s.

    >>> sample_durations(np.array([0.0, 1.0, 4.0]), longest_s=2.0).tolist()
    [1.0, 2.0, 0.0]
    """
    _refuse_disordered(t)
    durations = np.zeros_like(t)
    if len(t) > 1:
        durations[:-1] = np.minimum(np.diff(t), longest_s)
    return durations


def _runs(t: FloatArray, holds: BoolArray, longest_s: float) -> Iterator[tuple[int, int]]:
    """First and last index of each run of true samples; a hole in the samples ends a run."""
    (true,) = np.nonzero(holds)
    if not len(true):
        return
    separate = (np.diff(true) > 1) | (np.diff(t[true]) > longest_s + _TIME_TOLERANCE_S)
    (cuts,) = np.nonzero(separate)
    firsts = np.concatenate((true[:1], true[cuts + 1]))
    lasts = np.concatenate((true[cuts], true[-1:]))
    yield from zip(firsts.tolist(), lasts.tolist(), strict=True)


def episodes_where(
    t: FloatArray, holds: BoolArray, *, t_on_s: float = 0.0, t_off_s: float = 0.0, longest_s: float = math.inf
) -> list[Span]:
    """Group the samples at which a condition holds into episodes.

    An episode opens at the first true sample once the condition has held for
    `t_on_s`, and closes at the end of the last true sample once it has been
    false for `t_off_s`; shorter pauses are bridged, so that a distance that
    flickers around its limit is one violation and not forty. A hole in the samples
    is a pause too: nothing is known to have held in it.

    Args:
        t: Sample times, shape (n,), s, strictly increasing.
        holds: Whether the condition holds at each sample, shape (n,).
        t_on_s: How long the condition must hold before an episode opens, s.
        t_off_s: How long it must be false before the episode closes, s.
        longest_s: A sample never stands for longer than this, s.

    Returns:
        The episodes in time order. One supported by the last sample alone has no length.

    Source:
        Monitor catalogue, section 1.2 (our choice of definition).

    >>> t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    >>> episodes_where(t, np.array([True, True, False, True, False]))
    [Span(start_s=0.0, end_s=2.0), Span(start_s=3.0, end_s=4.0)]
    >>> episodes_where(t, np.array([True, True, False, True, False]), t_off_s=1.5)
    [Span(start_s=0.0, end_s=4.0)]
    """
    _refuse_disordered(t)
    found: list[Span] = []
    for first, last in _runs(t, holds, longest_s):
        start, until = float(t[first]), float(t[last])
        # A sample stands for the time up to the next one, as in `sample_durations`.
        end = until + (0.0 if last + 1 == len(t) else min(float(t[last + 1]) - until, longest_s))
        if found and start - found[-1].end_s < t_off_s - _TIME_TOLERANCE_S:
            found[-1] = Span(found[-1].start_s, end)
        # A run too short to open an episode may still prolong the one before: pauses are bridged first.
        elif end - start >= t_on_s - _TIME_TOLERANCE_S:
            found.append(Span(start, end))
    return found


def uncovered_spans(
    t: FloatArray, window: Span, *, max_gap_s: float, holes: Iterable[Span] = ()
) -> list[Span]:
    """Where samples say nothing about a window of time.

    Args:
        t: Sample times, shape (n,), s, strictly increasing; may be empty.
        window: The stretch that should be covered.
        max_gap_s: Neighbouring samples at most this far apart, in s, cover the time between them.
        holes: Stretches that they do not cover however near they are, as a `Signal` has them.

    Returns:
        The uncovered stretches in time order.

    >>> uncovered_spans(np.array([0.0, 1.0, 4.0]), Span(0.0, 5.0), max_gap_s=1.0)
    [Span(start_s=1.0, end_s=4.0)]
    """
    _refuse_disordered(t)
    inside, edges = _edges(t, window)
    # The edges count as samples, so that a log that begins late has a gap at the start of the window.
    (long,) = np.nonzero(np.diff(edges) > max_gap_s + _TIME_TOLERANCE_S)
    gaps = [Span(float(edges[row]), float(edges[row + 1])) for row in long]
    if len(inside) or gaps:
        return with_holes(gaps, holes, window)
    # A window between two samples has none inside, and is covered if the two are near each other.
    after = int(np.searchsorted(t, window.end_s))
    bridged = 0 < after < len(t) and t[after] - t[after - 1] <= max_gap_s + _TIME_TOLERANCE_S
    return with_holes([] if bridged else [window], holes, window)


def with_holes(gaps: Iterable[Span], holes: Iterable[Span], window: Span) -> list[Span]:
    """Gaps, and the parts of holes that lie in a window: one stretch where they touch, in time order.

    >>> with_holes([Span(1.0, 2.0)], [Span(1.5, 3.0), Span(8.0, 9.0)], Span(0.0, 5.0))
    [Span(start_s=1.0, end_s=3.0)]
    """
    inside = [
        Span(max(hole.start_s, window.start_s), min(hole.end_s, window.end_s))
        for hole in holes
        if hole.start_s < window.end_s and hole.end_s > window.start_s
    ]
    if not inside:
        return list(gaps)
    return merged([*gaps, *inside])


def merged(spans: Iterable[Span], *, within_s: float = 0.0) -> list[Span]:
    """Spans in time order, those that touch, or are so near to each other, as one.

    >>> merged([Span(2.0, 3.0), Span(0.0, 1.0), Span(1.0, 1.5)])
    [Span(start_s=0.0, end_s=1.5), Span(start_s=2.0, end_s=3.0)]
    """
    found: list[Span] = []
    for span in sorted(spans):
        if found and span.start_s <= found[-1].end_s + within_s:
            found[-1] = Span(found[-1].start_s, max(found[-1].end_s, span.end_s))
        else:
            found.append(span)
    return found


def within_spans(t: FloatArray, spans: Sequence[Span]) -> BoolArray:
    """Whether each time lies inside one of some stretches, not at its ends.

    >>> within_spans(np.array([1.0, 1.5, 2.0]), [Span(1.0, 2.0)]).tolist()
    [False, True, False]
    """
    inside = np.zeros(len(t), dtype=bool)
    for span in spans:
        inside |= (t > span.start_s) & (t < span.end_s)
    return inside


def _edges(t: FloatArray, window: Span) -> tuple[FloatArray, FloatArray]:
    """The times in a window, and the same with its start and its end."""
    inside = t[t.searchsorted(window.start_s) : t.searchsorted(window.end_s, side="right")]
    return inside, np.concatenate(([window.start_s], inside, [window.end_s]))


def distinct(values: NDArray[Any]) -> NDArray[Any]:
    """The different ones of some numbers, increasing.

    Why not `numpy.unique`: its first call imports `numpy.ma`, which every process of a batch would pay for.

    >>> distinct(np.array([2, 1, 2])).tolist()
    [1, 2]
    """
    found = np.sort(values)
    return found[np.append(True, found[1:] != found[:-1])] if len(found) else found


def longest_silence_s(t: FloatArray, window: Span) -> float:
    """The longest stretch of a window without a sample, s.

    Args:
        t: Sample times, shape (n,), s, strictly increasing; may be empty.
        window: The stretch looked at.

    >>> longest_silence_s(np.array([0.0, 1.0, 4.0]), Span(0.0, 5.0))
    3.0
    """
    _refuse_disordered(t)
    _, edges = _edges(t, window)
    longest_s = float(np.diff(edges).max())
    return longest_s if longest_s > _TIME_TOLERANCE_S else 0.0
