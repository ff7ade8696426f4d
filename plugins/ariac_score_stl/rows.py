"""The time base of a formula: samples, and the holes between them of which nothing is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ariac_score import Span
from ariac_score_stl.sliding import FloatArray, IntArray, lowest_between, lowest_sliding

__all__ = ["TOLERANCE_S", "BoolArray", "Extent", "Rows", "Window"]

BoolArray = NDArray[np.bool_]

TOLERANCE_S = 1e-9
"""Stamps are ns; sums of them in float64 differ from the decimal figure by far less than this."""


@dataclass(frozen=True)
class Extent:
    """Which rows a window covers.

    Either `nearest` and `farthest` say so for all rows alike, in rows, or `first`
    and `last` for each.

    Attributes:
        before: Rows whose window begins before the trial.
        after: Rows whose window ends after the trial.
        empty: Rows within the trial whose window holds no sample.
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

    def rows_of(self, row: int, n: int) -> tuple[int, int]:
        """First and last row of the window of one row, within the trial."""
        if self.first is None or self.last is None:
            first, last = row + self.nearest, row + self.farthest
        else:
            first, last = int(self.first[row]), int(self.last[row])
        return max(first, 0), min(last, n - 1)


@dataclass(frozen=True)
class Window:
    """A stretch of time relative to each row, as rows.

    Attributes:
        widest: All rows that some moment of the row can see.
        surest: The rows that every moment of it sees; where there are no holes, the same.
    """

    widest: Extent
    surest: Extent


@dataclass(frozen=True, eq=False)
class Rows:
    """Samples and holes in order of time.

    A sample is a moment, a hole stands for every moment in it. What lies before
    `span` and after it is no row.

    Attributes:
        begin: Start of each row, shape (n,), s.
        end: End of each row, shape (n,), s; the same for a sample.
        hole: Which rows are holes, shape (n,); `None`: none is.
        span: The trial.
        step_s: Time between neighbours where it is always the same; else 0.
    """

    begin: FloatArray
    end: FloatArray
    hole: BoolArray | None
    span: Span
    step_s: float
    _windows: dict[tuple[float, float], Window] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, t: FloatArray, span: Span, holes: Sequence[Span] = ()) -> Rows:
        """The rows of sample times and the stretches between them that are not known."""
        if not holes:
            return cls(t, t, None, span, _step(t))
        starts = np.array([hole.start_s for hole in holes]) + 2 * TOLERANCE_S
        ends = np.array([hole.end_s for hole in holes]) - 2 * TOLERANCE_S
        at = np.searchsorted(t, starts, side="left")
        is_hole = np.insert(np.zeros(len(t), dtype=bool), at, True)
        return cls(np.insert(t, at, starts), np.insert(t, at, ends), is_hole, span, 0.0)

    def __len__(self) -> int:
        return len(self.begin)

    def spread(self, values: FloatArray, in_holes: float) -> FloatArray:
        """Values of the samples, as values of the rows."""
        if self.hole is None:
            return values
        rows = np.full(len(self), in_holes)
        rows[~self.hole] = values
        return rows

    def window(self, start_s: float, end_s: float) -> Window:
        """The window from `start_s` to `end_s` away; negative is back in time."""
        key = start_s, end_s
        if key not in self._windows:
            self._windows[key] = self._window(start_s, end_s)
        return self._windows[key]

    def _window(self, start_s: float, end_s: float) -> Window:
        alike = self._alike(start_s, end_s)
        if alike is not None:
            return Window(alike, alike)
        widest = self._each(self.begin + start_s, self.end + end_s)
        if self.hole is None:
            return Window(widest, widest)
        return Window(widest, self._each(self.end + start_s, self.begin + end_s))

    def _reaching(self, start: FloatArray, end: FloatArray) -> tuple[slice, slice]:
        before = int(np.searchsorted(start, self.span.start_s - TOLERANCE_S, side="left"))
        after = int(np.searchsorted(end, self.span.end_s + TOLERANCE_S, side="right"))
        return slice(0, before), slice(after, len(self))

    def _alike(self, start_s: float, end_s: float) -> Extent | None:
        """The window in rows, where samples come at equal steps and no rounding can matter."""
        if not self.step_s:
            return None
        first, last = _steps_in(start_s, end_s, self.step_s)
        if first is None or last is None:
            return None
        if first > last:
            return None
        before, after = self._reaching(self.begin + start_s, self.begin + end_s)
        n = len(self)
        # Beyond the last sample there may be trial left, shorter than what counts as a hole.
        if first > 0 or last < 0:
            (inside,) = np.nonzero(self._misses(first, last, before, after))
            if len(inside):
                return None
        return Extent(before, after, None, max(first, -n), min(last, n))

    def _misses(self, first: int, last: int, before: slice, after: slice) -> BoolArray:
        """Rows whose window lies in the trial but beyond all samples."""
        rows = np.arange(len(self))
        misses: BoolArray = (rows + first > len(self) - 1) | (rows + last < 0)
        misses[before] = misses[after] = False
        return misses

    def _each(self, start: FloatArray, end: FloatArray) -> Extent:
        first = np.searchsorted(self.end, start - TOLERANCE_S, side="left")
        last = np.searchsorted(self.begin, end + TOLERANCE_S, side="right") - 1
        before, after = self._reaching(start, end)
        empty: BoolArray = first > last
        empty[before] = empty[after] = False
        return Extent(before, after, empty if empty.any() else None, first=first, last=last)


def _step(t: FloatArray) -> float:
    """The time between neighbours, where all lie on one grid far within the tolerance; else 0."""
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
