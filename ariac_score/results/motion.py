"""Positions over time, reduced so that what is drawn between those that are kept stays near the truth."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ariac_score.trial.spans import FloatArray, distinct

__all__ = ["places_kept"]


def places_kept(
    t: FloatArray, *places: FloatArray, fixed: Iterable[int], most: int, near_m: float
) -> NDArray[np.intp]:
    """The rows that a replay needs: a body that moves straight and steadily between them is where it was.

    The row that is furthest from where the replay would show it is added, again and again, until all
    are near enough or there are as many as may be. So the bound holds where the rows suffice, and the
    worst departures are the first to be kept where they do not.

    Args:
        t: Sample times, shape (n,), s, increasing.
        places: Along each axis that is drawn, shape (n,), m.
        fixed: Rows that are kept in any case, beside the first and the last one.
        most: As many rows are kept at most, unless more are fixed.
        near_m: Near enough, m.

    Returns:
        Their indices, increasing.

    >>> still_then_away = np.array([0.0, 0.0, 0.0, 1.0, 2.0])
    >>> places_kept(np.arange(5.0), still_then_away, np.zeros(5), fixed=(), most=9, near_m=0.01).tolist()
    [0, 2, 4]
    """
    if not len(t):
        return np.zeros(0, dtype=np.intp)
    given = np.array([0, len(t) - 1, *fixed], dtype=np.intp)
    kept = [int(row) for row in distinct(given[(given >= 0) & (given < len(t))])]
    # Of equal departures the earlier stretch comes first, so that every machine keeps the same rows.
    waiting = [_furthest(t, places, a, b) for a, b in pairwise(kept)]
    heapq.heapify(waiting)
    while waiting and len(kept) < most:
        departure, first, last, row = heapq.heappop(waiting)
        if -departure <= near_m * near_m:
            break
        kept.append(row)
        heapq.heappush(waiting, _furthest(t, places, first, row))
        heapq.heappush(waiting, _furthest(t, places, row, last))
    return np.array(sorted(kept), dtype=np.intp)


def _furthest(t: FloatArray, places: Sequence[FloatArray], a: int, b: int) -> tuple[float, int, int, int]:
    """Of the rows between two the one furthest from the line: minus its squared departure, its place."""
    if b - a < 2:
        return 0.0, a, b, a
    share = (t[a + 1 : b] - t[a]) / (t[b] - t[a])
    departure = np.zeros(b - a - 1)
    for along in places:
        off = along[a + 1 : b] - (along[a] + share * (along[b] - along[a]))
        departure += off * off
    row = int(np.argmax(departure))
    return -float(departure[row]), a, b, a + 1 + row
