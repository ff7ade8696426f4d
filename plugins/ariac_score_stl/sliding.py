"""Extrema over sliding windows, and the recursion of `until`, in a few passes over whole columns.

Everything is written for the minimum; the maximum is the minimum of the negated values.

Any window is two windows of 1, 2, 4, … rows, one from its start and one to its end, which may
overlap. That takes as many passes as its length has binary digits, where van Herk (1992) takes
three whatever the length. But these are the plainest there are, and his restart at every block:
over 60 s at 500 Hz both take as long, and shorter windows are quicker so.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

__all__ = ["FloatArray", "IntArray", "chained", "lowest_between", "lowest_sliding"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


def _doubled(values: FloatArray, longest: int) -> Iterator[tuple[int, FloatArray]]:
    """Widths 1, 2, 4, … up to the longest, and the least of so many values from each one on."""
    width = 1
    while True:
        yield width, values
        if 2 * width > longest:
            return
        values = np.minimum(values[:-width], values[width:])
        width *= 2


def lowest_sliding(values: FloatArray, first: int, last: int) -> FloatArray:
    """The least of the values from `first` to `last` rows away, for every row.

    Rows before the first and after the last value are left out; where none remains
    the answer is +inf.

    >>> lowest_sliding(np.array([3.0, 1.0, 2.0]), 0, 1).tolist()
    [1.0, 1.0, 2.0]
    """
    n = len(values)
    first, last = max(first, -n), min(last, n)
    width = last - first + 1
    if width <= 0:
        return np.full(n, np.inf)
    padded = np.full(n + width - 1, np.inf)
    source, start = values[max(first, 0) : n], max(-first, 0)
    padded[start : start + len(source)] = source[: len(padded) - start]
    ((power, lowest),) = deque(_doubled(padded, width), maxlen=1)  # the last one; a list would hold all
    return np.minimum(lowest[:n], lowest[width - power : width - power + n])


def lowest_between(values: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """The least of `values[first[i]]` to `values[last[i]]`, for every i.

    A window that ends before it starts is empty: +inf.

    >>> lowest_between(np.array([3.0, 1.0, 2.0]), np.array([0, 1, 2]), np.array([0, 2, 1])).tolist()
    [3.0, 1.0, inf]
    """
    start, end = np.maximum(first, 0), np.minimum(last, len(values) - 1)
    if len(start) == 1:  # of a trial that goes on row by row: its window as it is
        return np.minimum.reduce(
            values[int(start[0]) : max(int(end[0]) + 1, 0)], keepdims=True, initial=np.inf
        )
    level = np.frexp(np.maximum(end - start + 1, 0))[1]  # 0 where empty, else that of the widest power + 1
    lowest = np.full(len(start), np.inf)
    for number, (width, found) in enumerate(_doubled(values, 1 << max(int(level.max(initial=0)) - 1, 0))):
        rows = np.flatnonzero(level == number + 1)
        if len(rows):
            lowest[rows] = np.minimum(found.take(start[rows]), found.take(end[rows] - width + 1))
    return lowest


def chained(caps: FloatArray, floors: FloatArray, start: float) -> FloatArray:
    """The recursion x[k] = max(floors[k], min(caps[k], x[k-1])), from x[-1] = start.

    Each step cuts a number off at both sides, and so does any run of them: the values
    are laid out in runs, all runs are followed at once, and only then joined.

    >>> chained(np.array([5.0, 1.0]), np.array([2.0, 0.0]), -np.inf).tolist()
    [2.0, 1.0]
    """
    n = len(caps)
    if n < 2:  # a row of a trial that goes on
        return np.maximum(floors, np.minimum(caps, start))
    # A step of all runs is some passes of numpy, joining a run a few operations on numbers: more runs.
    length = max(int(n**0.5) // 4, 1)
    runs = -(-n // length)
    cap, floor = np.full(runs * length, np.inf), np.full(runs * length, -np.inf)
    cap[:n], floor[:n] = caps, floors
    # One row for each step, so that a step of all runs lies side by side in memory.
    cap, floor = (np.ascontiguousarray(c.reshape(runs, length).T) for c in (cap, floor))
    low, high = np.empty_like(cap), np.empty_like(cap)
    below, above = np.full(runs, -np.inf), np.full(runs, np.inf)
    for k in range(length):
        below = np.maximum(floor[k], np.minimum(cap[k], below))
        above = np.maximum(floor[k], np.minimum(cap[k], above))
        low[k], high[k] = below, above
    entering = []
    for run_low, run_high in zip(below.tolist(), above.tolist(), strict=True):
        entering.append(start)
        start = max(run_low, min(run_high, start))
    values: FloatArray = np.maximum(low, np.minimum(high, np.array(entering))).T.ravel()[:n]
    return values
