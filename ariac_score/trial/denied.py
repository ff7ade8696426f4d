"""Motion that is denied: a body that says it is slower than its own positions show it to be.

Between two times a body gets no further than its speed takes it. So where positions and speeds of one body
are both recorded, a stated speed of 0 beside a position that moves on contradicts itself, and nobody knows
how fast the body was.
"""

from __future__ import annotations

import numpy as np

from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import BoolArray
from ariac_score.trial.vocabulary import quantity_of

__all__ = ["denied"]

WINDOW_S = 1.0
"""Over so long a time ways are compared: a shorter one is lost in the noise of positions."""

_NOISE_M = 0.1
"""So much may a position be off, both ends together."""

_AT_LEAST = 2 / 3
"""A stated speed may be so much too low: numbers of a slow filter, positions of another link."""


_GAP = 3.0
"""Of the usual interval: in a longer one a body may have been as fast as it likes."""


def denied(stated: Signal, position: Signal | None) -> BoolArray:
    """Which samples of a speed or velocity the positions of the same body contradict, shape (n,).

    Args:
        stated: The signal; of other quantities nothing is denied.
        position: The position of the same body; `None` where it is not recorded.
    """
    nothing = np.zeros(len(stated), dtype=bool)
    if position is None or quantity_of(stated.name) not in ("speed", "velocity"):
        return nothing
    if min(len(stated), len(position)) < 2 or position.constant or stated.constant:
        return nothing
    t, steps = stated.t, np.diff(stated.t)
    speed = np.sqrt(np.square(stated.values.reshape(len(t), -1)).sum(axis=1))
    ways_m = np.where(steps <= _GAP * np.median(steps), steps * (speed[1:] + speed[:-1]) / 2, np.inf)
    # Ways are summed up to each sample; what lies before the first and behind the last is not known either.
    far = np.cumsum(np.concatenate(([0.0], np.where(np.isfinite(ways_m), ways_m, 0.0))))
    gaps = np.cumsum(np.concatenate(([0], ~np.isfinite(ways_m))))
    first = np.arange(len(position))
    last = np.searchsorted(position.t, position.t + WINDOW_S)
    inside = (last < len(position)) & (position.t >= t[0])
    first, last = first[inside], last[inside]
    inside = position.t[last] <= t[-1]
    first, last = first[inside], last[inside]
    begin_s, end_s = position.t[first], position.t[last]
    moved_m = np.sqrt(np.square(position.values[last] - position.values[first]).sum(axis=1))
    way_m = np.interp(end_s, t, far) - np.interp(begin_s, t, far)
    begin, end = np.searchsorted(t, begin_s, side="right") - 1, np.searchsorted(t, end_s)
    seen = gaps[end] == gaps[begin]
    contradicted = seen & ((moved_m - _NOISE_M) * _AT_LEAST > way_m)
    for one, other in zip(begin[contradicted].tolist(), end[contradicted].tolist(), strict=True):
        nothing[one : other + 1] = True
    return nothing
