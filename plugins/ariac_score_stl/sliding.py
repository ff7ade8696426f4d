"""Extrema over sliding windows, and the recursion of `until`, in time linear in the trace.

Everything is written for the minimum; the maximum is the minimum of the negated values.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["FloatArray", "IntArray", "chained", "lowest_between", "lowest_sliding"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


def lowest_sliding(values: FloatArray, first: int, last: int) -> FloatArray:
    """The least of the values from `first` to `last` rows away, for every row.

    Rows before the first and after the last value are left out; where none remains
    the answer is +inf. The windows are cut into blocks as long as a window, each of
    which then is the end of one block and the start of the next.

    Source:
        van Herk 1992; Gil and Werman 1993.

    >>> lowest_sliding(np.array([3.0, 1.0, 2.0]), 0, 1).tolist()
    [1.0, 1.0, 2.0]
    """
    n = len(values)
    first, last = max(first, -n), min(last, n)
    width = last - first + 1
    if width <= 0:
        return np.full(n, np.inf)
    long = width > LONGEST_DOUBLED
    padded = np.full(-(-(n + width - 1) // width) * width if long else n + width - 1, np.inf)
    source = values[max(first, 0) : n]
    start = max(-first, 0)
    room = len(padded) - start
    padded[start : start + min(len(source), room)] = source[:room]
    if not long:
        return _doubled(padded, n, width)
    square = padded.reshape(-1, width)
    before = np.minimum.accumulate(square, axis=1).ravel()
    after = np.minimum.accumulate(square[:, ::-1], axis=1)[:, ::-1].ravel()
    return np.minimum(after[:n], before[width - 1 : width - 1 + n])


LONGEST_DOUBLED = 64
"""Up to here six passes over whole columns are quicker than two that restart at every block."""


def _doubled(padded: FloatArray, n: int, width: int) -> FloatArray:
    """The same by windows of 1, 2, 4, … rows, two of which make any width between."""
    lowest, size = padded, 1
    while 2 * size <= width:
        lowest = np.minimum(lowest[:-size], lowest[size:])
        size *= 2
    return np.minimum(lowest[:n], lowest[width - size : width - size + n])


def lowest_between(values: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """The least of `values[first[i]]` to `values[last[i]]`, for every i.

    Neither `first` nor `last` may ever go back. A window that ends before it starts
    is empty: +inf. The values are cut where a window starts after the cut before, so
    that every window is the end of one piece and the start of the next, at most.

    >>> lowest_between(np.array([3.0, 1.0, 2.0]), np.array([0, 1, 2]), np.array([0, 2, 1])).tolist()
    [3.0, 1.0, inf]
    """
    n = len(values)
    lowest = np.full(len(first), np.inf)
    (some,) = np.nonzero((first <= last) & (last >= 0) & (first < n))
    if not len(some):
        return lowest
    start, end = np.maximum(first[some], 0), np.minimum(last[some], n - 1)
    if int((end - start).max()) < LONGEST_DOUBLED:
        lowest[some] = _doubled_between(values, start, end)
        return lowest
    cuts = _cuts(start, end, n)
    before, after = _within(values, cuts)
    piece = np.repeat(np.arange(len(cuts)), np.diff(cuts, prepend=-1))
    # Within one piece a window reaches to its end, for that is where it was cut.
    least = after[start]
    (on,) = np.nonzero(piece[start] != piece[end])
    least[on] = np.minimum(least[on], before[end[on]])
    lowest[some] = least
    return lowest


def _doubled_between(values: FloatArray, start: IntArray, end: IntArray) -> FloatArray:
    """Short windows, each from two of 1, 2, 4, … rows."""
    width = end - start + 1
    level = np.frexp(width)[1] - 1
    table = np.full((int(level.max()) + 1, len(values)), np.inf)
    table[0] = values
    for k in range(1, len(table)):
        half = 1 << (k - 1)
        table[k, : len(values) - half] = np.minimum(table[k - 1, :-half], table[k - 1, half:])
    at = level * len(values)
    flat = table.ravel()
    least: FloatArray = np.minimum(flat[at + start], flat[at + end + 1 - (1 << level)])
    return least


def _cuts(start: IntArray, end: IntArray, n: int) -> IntArray:
    """The last row of each piece: where the first window ends that starts behind the cut before."""
    later = np.cumsum(np.bincount(start, minlength=n))  # how many windows start at or before each row
    ends = np.append(end, n - 1)
    following = ends[later].tolist()
    cuts = []
    cut = int(start[0]) - 1
    if cut >= 0:
        cuts.append(cut)
    cut = int(end[0])
    while cut < n - 1:
        cuts.append(cut)
        # A window may start far behind the cut; what lies between belongs to no window.
        cut = max(following[cut], cut + 1)
    cuts.append(n - 1)
    return np.array(cuts, dtype=np.intp)


def _within(values: FloatArray, cuts: IntArray) -> tuple[FloatArray, FloatArray]:
    """The running minimum of each piece from its start, and from its end.

    Long pieces are handled one by one, short ones of like length together, padded to the
    longest of them, which at most doubles the work.
    """
    starts = np.concatenate(([0], cuts[:-1] + 1))
    lengths = cuts + 1 - starts
    before, after = np.empty_like(values), np.empty_like(values)
    for first, length in zip(starts.tolist(), lengths.tolist(), strict=True):
        if length >= LONGEST_DOUBLED:
            piece = values[first : first + length]
            np.minimum.accumulate(piece, out=before[first : first + length])
            np.minimum.accumulate(piece[::-1], out=after[first : first + length][::-1])
    size = np.where(lengths < LONGEST_DOUBLED, np.frexp(lengths)[1], 0)
    for one in np.unique(size[size > 0]):
        rows = np.flatnonzero(size == one)
        columns = np.arange(int(lengths[rows].max()))
        index = starts[rows, None] + columns
        real = columns < lengths[rows, None]
        square = np.where(real, values[np.minimum(index, len(values) - 1)], np.inf)
        before[index[real]] = np.minimum.accumulate(square, axis=1)[real]
        after[index[real]] = np.minimum.accumulate(square[:, ::-1], axis=1)[:, ::-1][real]
    return before, after


def chained(caps: FloatArray, floors: FloatArray, start: float) -> FloatArray:
    """The recursion x[k] = max(floors[k], min(caps[k], x[k-1])), from x[-1] = start.

    Each step cuts a number off at both sides, and so does any run of them: the values
    are laid out in about as many runs as each is long, all runs are followed at once,
    and only then joined.

    >>> chained(np.array([5.0, 1.0]), np.array([2.0, 0.0]), -np.inf).tolist()
    [2.0, 1.0]
    """
    n = len(caps)
    if not n:
        return np.empty(0)
    length = max(int(n**0.5), 1)
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
