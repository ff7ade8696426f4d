"""The time base of a formula: samples, and the holes between them in which nothing is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score import Span
from ariac_score_stl.sliding import FloatArray, IntArray, lowest_between, lowest_sliding

__all__ = ["CLOSEST_S", "TOLERANCE_S", "BoolArray", "Column", "Extent", "Rows", "Window"]

BoolArray = NDArray[np.bool_]

TOLERANCE_S = 1e-9
"""Stamps are ns; sums of them in float64 differ from the decimal figure by far less than this."""

CLOSEST_S = 2 * TOLERANCE_S
"""A hole keeps so far from its samples, so that no window that ends at a sample sees into it."""

_REACHED_S = TOLERANCE_S / 2  # a row this near the end of a window is the last that can be in it


class Column:
    """A column of numbers that grows at its end and forgets from its start."""

    def __init__(self, values: NDArray[Any]) -> None:
        self._room, self._first, self._last = values, 0, len(values)

    def __len__(self) -> int:
        return self._last - self._first

    @property
    def values(self) -> NDArray[Any]:
        """All that are kept."""
        return self._room[self._first : self._last]

    def add(self, values: NDArray[Any]) -> None:
        """Add new ones at the end; the first are not copied, for they may be a whole trial."""
        if not self._last:
            self._room, self._last = values, len(values)
            return
        kept, last = len(self), self._last + len(values)
        if last > len(self._room):
            room = np.empty(2 * (kept + len(values)), dtype=self._room.dtype)
            room[:kept] = self.values
            self._room, self._first, self._last, last = room, 0, kept, kept + len(values)
        self._room[self._last : last] = values
        self._last = last

    def forget(self, count: int) -> None:
        """Drop the first ones."""
        self._first += count


@dataclass(frozen=True)
class Extent:
    """Which rows the windows of some rows cover.

    Either `nearest` and `farthest` do for all rows, counted in rows, or `first` and
    `last` for each row.

    Attributes:
        before: Rows whose window begins before the trial.
        after: Rows whose window ends after the trial.
        empty: Rows whose window holds no sample, though some of it lies in the trial.
    """

    before: slice
    after: slice
    empty: BoolArray | None
    nearest: int = 0
    farthest: int = 0
    first: IntArray | None = None
    last: IntArray | None = None

    def lowest(self, values: FloatArray) -> FloatArray:
        """The least value in the window of each row; +inf where it holds none."""
        if self.first is None or self.last is None:
            return lowest_sliding(values, self.nearest, self.farthest)
        return lowest_between(values, self.first, self.last)


@dataclass(frozen=True)
class Window:
    """A stretch of time relative to each of some rows, as rows.

    Attributes:
        widest: The rows that some moment of the row sees.
        surest: The rows that every moment of it sees; the same for a sample, which is one moment.
    """

    widest: Extent
    surest: Extent


class Rows:
    """Samples and holes in order of time: all of a trial, or those so far of one that goes on.

    A sample is a moment, a hole stands for every moment in it. What lies before the
    trial and after it is no row.

    Args:
        start_s: Where the trial begins.
        end_s: Where it ends; infinite while it goes on.

    Attributes:
        step_s: Time between neighbours where all samples are here and it is always the same; else 0.
    """

    def __init__(self, start_s: float, end_s: float = inf) -> None:
        self.start_s, self.end_s, self.step_s = start_s, end_s, 0.0
        self._begin, self._end, self._hole = (Column(np.empty(0)) for _ in range(3))
        self._latest_s, self._any_hole = start_s, False
        self._windows: dict[tuple[float, float, int, int], Window] = {}

    @classmethod
    def of(cls, t: FloatArray, span: Span, holes: Sequence[Span] = ()) -> Rows:
        """The rows of all sample times of a trial and the stretches between them that are not known."""
        rows = cls(span.start_s, span.end_s)
        if not holes:
            rows.step_s = _step(t)
            rows._add(t, t, np.zeros(0, dtype=bool))
            return rows
        # A hole is a row of its own, between the two samples around it.
        starts = np.array([hole.start_s for hole in holes]) + CLOSEST_S
        ends = np.array([hole.end_s for hole in holes]) - CLOSEST_S
        at = np.searchsorted(t, starts, side="left")
        rows._any_hole = True
        is_hole = np.insert(np.zeros(len(t), dtype=bool), at, True)
        rows._add(np.insert(t, at, starts), np.insert(t, at, ends), is_hole)
        return rows

    def take(self, t_s: float, longest_s: float) -> int:
        """Add one more sample, and the hole before it where no sample came for longer than `longest_s`.

        Returns:
            How many rows that makes.
        """
        begin, end = [t_s], [t_s]
        if t_s - self._latest_s > longest_s + TOLERANCE_S:
            begin, end = [self._latest_s + CLOSEST_S, t_s], [t_s - CLOSEST_S, t_s]
            if not self._any_hole:
                self._any_hole, self._hole = True, Column(np.zeros(len(self), dtype=bool))
        self._latest_s = t_s
        hole = [True, False][-len(begin) :] if self._any_hole else []
        self._add(np.array(begin), np.array(end), np.array(hole, dtype=bool))
        return len(begin)

    def _add(self, begin: FloatArray, end: FloatArray, hole: BoolArray) -> None:
        self._begin.add(begin)
        self._end.add(end)
        if self._any_hole:
            self._hole.add(hole)
        self._windows.clear()

    def forget(self, count: int) -> None:
        """Drop the first rows."""
        self._begin.forget(count)
        self._end.forget(count)
        if self._any_hole:
            self._hole.forget(count)
        self._windows.clear()

    def __len__(self) -> int:
        return len(self._begin)

    @property
    def over(self) -> bool:
        """Whether no row will come any more."""
        return self.end_s < inf

    @property
    def begin(self) -> FloatArray:
        """Start of each row, shape (n,), s."""
        return self._begin.values

    @property
    def end(self) -> FloatArray:
        """End of each row, shape (n,), s; the same for a sample."""
        return self._end.values

    @property
    def hole(self) -> BoolArray | None:
        """Which rows are holes, shape (n,); `None`: none is."""
        return self._hole.values if self._any_hole else None

    def spread(self, values: FloatArray, in_holes: float, rows: slice) -> FloatArray:
        """Values at the samples of some rows, with `in_holes` at the holes between them."""
        if self.hole is None:
            return values
        sampled = ~self.hole[rows]
        spread = np.full(len(sampled), in_holes)
        spread[sampled] = values
        return spread

    # Windows -----------------------------------------------------------------------------

    def complete(self, end_s: float, known: int) -> int:
        """At how many rows, from the first on, the window up to `end_s` away is known as a whole.

        Args:
            end_s: How far the window reaches; negative is back in time.
            known: At how many rows what the window looks at is known.
        """
        if self.over:
            return known
        to_s = self.end + end_s
        come = int(to_s.searchsorted(self.begin[-1] + _REACHED_S, side="right")) if len(self) else 0
        lasts = self.begin.searchsorted(to_s[:come] + TOLERANCE_S, side="right")
        return min(known, int(lasts.searchsorted(known, side="right")))

    def window(self, start_s: float, end_s: float, rows: slice) -> Window:
        """The window of some rows from `start_s` to `end_s` away; negative is back in time."""
        key = start_s, end_s, rows.start, rows.stop
        if key not in self._windows:
            self._windows[key] = self._window(start_s, end_s, rows)
        return self._windows[key]

    def _window(self, start_s: float, end_s: float, rows: slice) -> Window:
        uniform = self._uniform(start_s, end_s)
        if uniform is not None:
            return Window(uniform, uniform)
        begin, end = self.begin[rows], self.end[rows]
        widest = self._each(begin + start_s, end + end_s)
        if self.hole is None:
            return Window(widest, widest)
        return Window(widest, self._each(end + start_s, begin + end_s))

    def _reaching(self, start: FloatArray, end: FloatArray) -> tuple[slice, slice]:
        before = int(np.searchsorted(start, self.start_s - TOLERANCE_S, side="left"))
        after = int(np.searchsorted(end, self.end_s + TOLERANCE_S, side="right"))
        return slice(0, before), slice(after, len(start))

    def _uniform(self, start_s: float, end_s: float) -> Extent | None:
        """The same window in rows for all, where samples come at equal steps and rounding cannot matter."""
        if not self.step_s:
            return None
        first, last = _steps_in(start_s, end_s, self.step_s)
        if first is None or last is None:
            return None
        if first > last:
            return None
        start, end = self.begin + start_s, self.begin + end_s
        before, after = self._reaching(start, end)
        n = len(self)
        # Beyond the last sample there may be trial left, shorter than what counts as a hole.
        if first > 0 or last < 0:
            rows = np.arange(n)
            holds_none = (rows + first > n - 1) | (rows + last < 0)
            if (holds_none & self._in_trial(start, end)).any():
                return None
        return Extent(before, after, None, max(first, -n), min(last, n))

    def _in_trial(self, start: FloatArray, end: FloatArray) -> BoolArray:
        """Which windows lie in the trial, at least in part."""
        inside: BoolArray = (end >= self.start_s - TOLERANCE_S) & (start <= self.end_s + TOLERANCE_S)
        return inside

    def _each(self, start: FloatArray, end: FloatArray) -> Extent:
        first = self.end.searchsorted(start - TOLERANCE_S, side="left")
        last = self.begin.searchsorted(end + TOLERANCE_S, side="right") - 1
        before, after = self._reaching(start, end)
        empty = first > last
        if empty.any():
            empty &= self._in_trial(start, end)
        return Extent(before, after, empty if empty.any() else None, first=first, last=last)


def _step(t: FloatArray) -> float:
    """The time between neighbours, where all lie on one grid well within the tolerance; else 0."""
    n = len(t)
    if n < 3:
        return 0.0
    step_s = float(t[-1] - t[0]) / (n - 1)
    grid = np.arange(n) * step_s
    grid += t[0]
    grid -= t
    return step_s if max(-float(grid.min()), float(grid.max())) < TOLERANCE_S / 8 else 0.0


def _steps_in(start_s: float, end_s: float, step_s: float) -> tuple[int | None, int | None]:
    """The whole steps from `start_s` to `end_s`; `None` where the tolerance would have to decide."""
    first = int(np.ceil((start_s - TOLERANCE_S) / step_s))
    last = int(np.floor((end_s + TOLERANCE_S) / step_s))
    for bound_s, steps in ((start_s, (first - 1, first)), (end_s, (last, last + 1))):
        for step in steps:
            if abs(abs(step * step_s - bound_s) - TOLERANCE_S) < TOLERANCE_S / 2:
                return None, None
    return first, last
