"""Stretches of time, and the episodes a condition forms over sampled time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "BoolArray",
    "Episodes",
    "FloatArray",
    "Span",
    "Stretch",
    "distinct",
    "episodes_where",
    "gaps_between",
    "longest_silence_s",
    "sample_durations",
    "uncovered_spans",
]

FloatArray: TypeAlias = "NDArray[np.float64]"
BoolArray: TypeAlias = "NDArray[np.bool_]"

_TIME_TOLERANCE_S = 1e-9
"""Stamps are ns; sums of them in float64 differ from the decimal figure by far less than this."""

_PART_SAMPLES = 4096


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
    durations = np.zeros_like(t)
    if len(t) > 1:
        durations[:-1] = np.minimum(np.diff(t), longest_s)
    return durations


def _runs(t: FloatArray, holds: BoolArray, longest_s: float) -> Iterator[tuple[int, int]]:
    """First and last index of each run of true samples; a hole in the samples ends a run."""
    (true,) = np.nonzero(holds)
    if not len(true):
        return
    apart = (np.diff(true) > 1) | (np.diff(t[true]) > longest_s + _TIME_TOLERANCE_S)
    (cuts,) = np.nonzero(apart)
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
        Monitor catalogue, section 1.2 (our choice of definition, after CARLA and VRX).

    >>> t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    >>> episodes_where(t, np.array([True, True, False, True, False]))
    [Span(start_s=0.0, end_s=2.0), Span(start_s=3.0, end_s=4.0)]
    >>> episodes_where(t, np.array([True, True, False, True, False]), t_off_s=1.5)
    [Span(start_s=0.0, end_s=4.0)]
    """
    found = Episodes(t_on_s=t_on_s, t_off_s=t_off_s, longest_s=longest_s)
    found.take(t, holds)
    return [episode.span for episode in found.end()]


@dataclass(frozen=True)
class Stretch:
    """An episode, how many samples it has at which the condition holds, and the time of the last of them."""

    span: Span
    samples: int
    last_s: float


class Episodes:
    """What `episodes_where` finds, of samples that come in parts."""

    def __init__(self, *, t_on_s: float = 0.0, t_off_s: float = 0.0, longest_s: float = math.inf) -> None:
        self._t_on_s, self._t_off_s, self._longest_s = t_on_s, t_off_s, longest_s
        self._found: list[Stretch] = []
        self._open: tuple[float, float, int] | None = None
        """Start, last sample and number of samples of a run that may go on."""

    def take(self, t: FloatArray, holds: BoolArray) -> None:
        """Take samples, later than those before.

        Args:
            t: Sample times, shape (n,), s, strictly increasing.
            holds: Whether the condition holds at each sample, shape (n,).
        """
        if not len(t):
            return
        going, self._open = self._open, None
        if going is not None and not (holds[0] and t[0] - going[1] <= self._longest_s + _TIME_TOLERANCE_S):
            self._add(*going, float(t[0]))
            going = None
        for first, last in _runs(t, holds, self._longest_s):
            start, until, samples = float(t[first]), float(t[last]), last - first + 1
            if going is not None:
                start, samples, going = going[0], going[2] + samples, None
            if last + 1 < len(t):
                self._add(start, until, samples, float(t[last + 1]))
            else:
                self._open = start, until, samples

    def _add(self, start: float, until: float, samples: int, following: float | None) -> None:
        end = until + (0.0 if following is None else min(following - until, self._longest_s))
        if self._found and start - self._found[-1].span.end_s < self._t_off_s - _TIME_TOLERANCE_S:
            before = self._found[-1]
            self._found[-1] = Stretch(Span(before.span.start_s, end), before.samples + samples, until)
        elif end - start >= self._t_on_s - _TIME_TOLERANCE_S:
            self._found.append(Stretch(Span(start, end), samples, until))

    def end(self) -> list[Stretch]:
        """The episodes in time order, once all samples have come."""
        if self._open is not None:
            self._add(*self._open, None)
            self._open = None
        return self._found


def uncovered_spans(t: FloatArray, window: Span, *, max_gap_s: float) -> list[Span]:
    """Where samples say nothing about a window of time.

    Args:
        t: Sample times, shape (n,), s, strictly increasing; may be empty.
        window: The stretch that should be covered.
        max_gap_s: Neighbouring samples at most this far apart, in s, cover the time between them.

    Returns:
        The uncovered stretches in time order.

    >>> uncovered_spans(np.array([0.0, 1.0, 4.0]), Span(0.0, 5.0), max_gap_s=1.0)
    [Span(start_s=1.0, end_s=4.0)]
    """
    inside = t[t.searchsorted(window.start_s) : t.searchsorted(window.end_s, side="right")]
    gaps = [Span(a, b) for a, b in _long_steps(_parts(inside), window, max_gap_s + _TIME_TOLERANCE_S)]
    if len(inside) or gaps:
        return gaps
    after = int(np.searchsorted(t, window.end_s))
    bridged = 0 < after < len(t) and t[after] - t[after - 1] <= max_gap_s + _TIME_TOLERANCE_S
    return [] if bridged else [window]


def _parts(t: FloatArray) -> Iterator[FloatArray]:
    """Times, some thousand at a time."""
    return (t[first : first + _PART_SAMPLES] for first in range(0, len(t), _PART_SAMPLES))


def _long_steps(parts: Iterable[FloatArray], window: Span, longest_s: float) -> Iterator[tuple[float, float]]:
    """The steps longer than some time, from the start of a window over the times in it to its end."""
    before = window.start_s
    for part in parts:
        if not len(part):
            continue
        if float(part[0]) - before > longest_s:
            yield before, float(part[0])
        steps_s = np.diff(part)
        if steps_s.max(initial=0.0) > longest_s:
            long = np.flatnonzero(steps_s > longest_s)
            yield from zip(part[long].tolist(), part[long + 1].tolist(), strict=True)
        before = float(part[-1])
    if window.end_s - before > longest_s:
        yield before, window.end_s


def gaps_between(parts: Iterable[FloatArray], window: Span, *, max_gap_s: float) -> list[Span]:
    """The stretches of a window that no sample covers; all of it where there is no sample.

    Args:
        parts: Sample times within the window, in parts, s, strictly increasing.
        window: The stretch that should be covered.
        max_gap_s: As of `uncovered_spans`.
    """
    seen = False

    def counted() -> Iterator[FloatArray]:
        nonlocal seen
        for part in parts:
            seen = seen or len(part) > 0
            yield part

    gaps = [Span(a, b) for a, b in _long_steps(counted(), window, max_gap_s + _TIME_TOLERANCE_S)]
    return gaps if gaps or seen else [window]


def distinct(values: NDArray[Any]) -> NDArray[Any]:
    """The different ones of some numbers, increasing: `numpy.unique`, which loads much else.

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
    inside = t[t.searchsorted(window.start_s) : t.searchsorted(window.end_s, side="right")]
    longest_s, before = 0.0, window.start_s
    for part in _parts(inside):
        longest_s = max(longest_s, float(part[0]) - before, float(np.diff(part).max(initial=0.0)))
        before = float(part[-1])
    longest_s = max(longest_s, window.end_s - before)
    return longest_s if longest_s > _TIME_TOLERANCE_S else 0.0
