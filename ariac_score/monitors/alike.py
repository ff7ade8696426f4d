"""Two sources of one quantity: whether they say the same, and how far the one can stand for the other."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from ariac_score.monitors.cells import Cells, Stream
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vectors import lengths
from ariac_score.trial.vocabulary import quantity_of

__all__ = ["ALIKE", "DISTANCES", "SPEEDS", "by_intervals", "say_the_same"]

DISTANCES = ("centre_distance", "centre_distance_2d", "separation", "body_separation")
SPEEDS = ("speed", "tcp_speed")

ALIKE: Mapping[str, float] = MappingProxyType(
    {**dict.fromkeys(DISTANCES, 0.01), **dict.fromkeys(SPEEDS, 0.02)}
)
"""Two sources that say the same differ by no more, m or m/s: late stamps, and speeds over several samples. A
distance of surfaces differs by far more from one of centres. Our choice."""
_FEWEST_ALIKE, _SHARE_ALIKE = 20, 0.95


def say_the_same(recorded: Signal, twin: Signal) -> bool:
    """Whether a recorded signal and the same as it follows from others agree where both were sampled."""
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            values = twin.values
    except ValueError:  # positions so far away that their distances are no numbers
        return False
    if recorded.values.ndim > 1 or values.ndim > 1 or not len(twin):
        return False
    both = (recorded.t >= twin.t[0]) & (recorded.t <= twin.t[-1])
    if np.count_nonzero(both) < _FEWEST_ALIKE:
        return False
    apart = np.abs(recorded.values[both] - np.interp(recorded.t[both], twin.t, values))
    return bool(np.quantile(apart, _SHARE_ALIKE) <= ALIKE[quantity_of(recorded.name)])


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
