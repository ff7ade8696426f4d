"""When a position that is composed of several transforms was really seen."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np

from ariac_score.trial.spans import FloatArray, Span, distinct

__all__ = ["seen_by_all", "throughout"]

_STEP_S = 0.01
"""How far apart the times of something constant are at most, s: less than any gap that a monitor accepts."""


def seen_by_all(bases: Sequence[FloatArray]) -> FloatArray:
    """Times between which each transform of a chain was sampled at least once: those of the slowest.

    A frame at 100 Hz says nothing of when the frame above it, at 2 Hz, was where it is interpolated to be.
    So a chain is seen when its slowest transform is, which may be another one at another time.

    Args:
        bases: The sample times of each transform, strictly increasing, s; at least one.

    >>> seen_by_all([np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.5, 2.5])]).tolist()
    [0.5, 2.5]
    """
    different = [bases[0]]
    for t in bases[1:]:
        if not any(t is known or np.array_equal(t, known) for known in different):
            different.append(t)
    different.sort(key=len)
    slowest = different[0]
    if len(different) == 1 or not len(slowest):
        return slowest
    if all(_sampled_between(slowest, t) for t in different[1:]):
        return slowest
    return _one_after_the_other([t.tolist() for t in different])


def _sampled_between(slowest: FloatArray, t: FloatArray) -> bool:
    """Whether some times are sampled before or at the first of others, and between each two of them."""
    before = t.searchsorted(slowest, side="right")
    return bool(before[0] > 0 and (np.diff(before) > 0).all())


def _one_after_the_other(bases: Sequence[list[float]]) -> FloatArray:
    found: list[float] = []
    now = max(t[0] for t in bases)
    while True:
        found.append(now)
        places = [bisect_right(t, now) for t in bases]
        if any(place == len(t) for place, t in zip(places, bases, strict=True)):
            return np.array(found)
        now = max(t[place] for place, t in zip(places, bases, strict=True))


def throughout(t: FloatArray, recorded: Span | None) -> FloatArray:
    """Times that leave nothing of a recording out, for what never moves.

    Args:
        t: Times at which anything was seen, s, increasing.
        recorded: From the first to the last message; `None`: not known.

    >>> throughout(np.array([0.5]), Span(0.0, 0.52)).tolist()[-3:]
    [0.5, 0.51, 0.52]
    """
    if recorded is None:
        return t
    steps = np.arange(np.ceil(recorded.start_s / _STEP_S), np.floor(recorded.end_s / _STEP_S) + 1)
    grid = steps / round(1 / _STEP_S)  # a division rounds once, so that 0.51 is 0.51
    found: FloatArray = distinct(np.concatenate((t, grid, [recorded.start_s, recorded.end_s])))
    return found
