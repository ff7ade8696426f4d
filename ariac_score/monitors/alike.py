"""Two sources of one quantity: whether they say the same, and how far the one can stand for the other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ariac_score.monitors.cells import Cells, Stream
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vectors import lengths
from ariac_score.trial.vocabulary import DISTANCES, SPEEDS, quantity_of

__all__ = ["ALIKE", "by_intervals", "never_moved", "say_the_same"]

ALIKE: Mapping[str, float] = MappingProxyType(
    {**dict.fromkeys(DISTANCES, 0.01), **dict.fromkeys(SPEEDS, 0.02)}
)
"""Two sources that say the same differ by no more, m or m/s: late stamps, and speeds over several samples. A
distance of surfaces differs by far more from one of centres. Our choice."""

_PLACE_M = ALIKE["centre_distance"]
_FEWEST = 20
"""So many samples at least must say the same."""
_MOVED = 10.0
"""What moved, or changed, by less than so many times that says nothing: at rest any two sources agree."""
_SMOOTHED = 2.0
"""A speed over several intervals shows a change by so many of them before and after."""
_GAP = 2.0
"""Between samples further apart than so many usual intervals nothing is compared."""


def say_the_same(recorded: Signal, twin: Signal, late_s: float) -> bool:
    """Whether a recorded signal and the same as it follows from others agree at each sample of both.

    Both must have been seen in motion. One sample that contradicts is enough: then they are two quantities.

    Args:
        recorded: Of a distance or a speed.
        twin: As it follows from places.
        late_s: By how much stamps of either may be wrong, s.
    """
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            values = twin.values
    except ValueError:  # positions so far away that their distances are no numbers
        return False
    if recorded.values.ndim > 1 or values.ndim > 1 or len(twin) < _FEWEST:
        return False
    quantity, usual_s = quantity_of(recorded.name), float(np.median(np.diff(twin.t)))
    within_s = late_s + (_SMOOTHED * usual_s if quantity in SPEEDS else 0.0)
    t = recorded.t[(recorded.t >= twin.t[0] + within_s) & (recorded.t <= twin.t[-1] - within_s)]
    first, behind = (twin.t.searchsorted(t + edge_s, side="right") for edge_s in (-within_s, within_s))
    # Up to the next one on either side; between two far apart nothing is known.
    wide = np.concatenate(([0], np.cumsum(np.diff(twin.t) > _GAP * usual_s)))
    known = (behind < len(twin)) & (first > 0)
    t, first, behind = t[known], first[known], behind[known]
    together = wide[behind] == wide[first - 1]
    t, first, behind = t[together], first[together], behind[together]
    if len(t) < _FEWEST:
        return False
    said = recorded.values[recorded.t.searchsorted(t)]
    if not _moved(quantity, said):
        return False
    ends = [np.interp(t + edge_s, twin.t, values) for edge_s in (-within_s, within_s)]
    low, high = (_extreme(of, values, first, behind) for of in (np.minimum, np.maximum))
    low, high = np.minimum(low, np.minimum(*ends)), np.maximum(high, np.maximum(*ends))
    return bool(((said >= low - ALIKE[quantity]) & (said <= high + ALIKE[quantity])).all())


def never_moved(recorded: Iterable[Signal]) -> bool:
    """Whether places, or velocities, show nobody in motion, so that what moves may be another point."""
    for one in recorded:
        if quantity_of(one.name) != "position":
            column = lengths(one.values) if one.values.ndim > 1 else one.values
            if _moved("speed", column):
                return False
        elif len(one) and float(np.hypot.reduce(np.ptp(one.values, axis=0))) >= _MOVED * _PLACE_M:
            return False
    return True


def _moved(quantity: str, values: FloatArray) -> bool:
    if not len(values):
        return False
    change = np.ptp(values) if quantity in DISTANCES else np.abs(values).max()
    return bool(change >= _MOVED * ALIKE[quantity])


def _extreme(
    of: np.ufunc, values: FloatArray, first: NDArray[np.intp], behind: NDArray[np.intp]
) -> FloatArray:
    """The least or the greatest of values from one place to before another; of no value the one before."""
    first = np.minimum(first, behind - 1)
    pairs = np.stack((first, behind), axis=1).reshape(-1)
    return np.asarray(of.reduceat(np.append(values, values[-1]), pairs)[::2], dtype=np.float64)


def by_intervals(stream: Stream, cells: Cells) -> tuple[FloatArray, FloatArray]:
    """The least and the most mean speed in the interval around each cell and its neighbours, m/s.

    A speed over several intervals smooths away what is shorter. NaN of what is no position.
    """
    t, values = stream.t, stream.signal.values
    if quantity_of(stream.signal.name) != "position" or len(t) < 2:
        nothing = np.full(len(cells.t), np.nan)
        return nothing, nothing
    mean_m_s = lengths(np.diff(values, axis=0)) / np.diff(t)
    near = np.concatenate((mean_m_s[:1], mean_m_s, mean_m_s[-1:]))
    slowest = np.minimum(np.minimum(near[:-2], near[1:-1]), near[2:])
    fastest = np.maximum(np.maximum(near[:-2], near[1:-1]), near[2:])
    row = np.clip(t.searchsorted(cells.t, side="right") - 1, 0, len(mean_m_s) - 1)
    return slowest[row], fastest[row]
