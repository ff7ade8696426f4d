"""Velocities from positions: centred differences on full time stamps, split where a body jumps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ariac_score.trial.spans import FloatArray, Span, distinct, within_spans
from ariac_score.trial.vectors import lengths

__all__ = ["HALF_WINDOW_SAMPLES", "TELEPORT_SPEED_M_S", "Velocity", "centred_velocity"]

TELEPORT_SPEED_M_S = 5.0
"""A step faster than this is a jump of the simulation, not a movement (catalogue, M19)."""

HALF_WINDOW_SAMPLES = 2
"""Samples on each side of a centred difference at 100 Hz (catalogue, 1.1)."""


def centred_velocity(
    t: FloatArray,
    positions_m: FloatArray,
    *,
    half_window_samples: int = HALF_WINDOW_SAMPLES,
    half_window_s: float = 0.0,
    teleport_speed_m_s: float = TELEPORT_SPEED_M_S,
    max_gap_s: float = np.inf,
) -> tuple[FloatArray, FloatArray, int]:
    """Velocity by centred differences on full time stamps.

    At each sample the difference runs over the samples up to the half window away
    on both sides, fewer at the ends. Where a body jumps (a step faster than
    `teleport_speed_m_s`) or a gap is too long, the track is split: no difference
    crosses the split, so a jump is never a speed. The two samples of a jump have no velocity.

    Args:
        t: Sample times, shape (n,), s, strictly increasing.
        positions_m: Positions, shape (n, 3), m.
        half_window_samples: Samples on each side.
        half_window_s: Where positive, the half window in s instead of samples.
        teleport_speed_m_s: Speed above which a step is a jump, m/s.
        max_gap_s: Longest step that belongs to one track, s.

    Returns:
        Times, shape (m,), s; velocities, shape (m, 3), m/s; number of jumps. The samples
        of a jump and those alone in their track have no velocity and are left out.

    Source:
        Monitor catalogue, section 1.1; mistake 6 of section 5 (stamps without seconds).

    >>> positions_m = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    >>> t, v, jumps = centred_velocity(np.array([0.0, 1.0, 2.0]), positions_m)
    >>> v[:, 0].tolist(), jumps
    ([1.0, 1.0, 1.0], 0)
    """
    velocity = Velocity(t, positions_m, half_window_samples, half_window_s, teleport_speed_m_s, max_gap_s)
    return velocity.t, velocity.values(), velocity.jumps


class Velocity:
    """The velocity of one point, computed on demand.

    With stamps that may be wrong by `time_error_s` a point is no faster than `fastest_m_s`, m/s, unless even
    then its steps show that it was.

    Attributes:
        t: The times at which there is one, shape (m,), s.
        jumps: How often the point jumped.
    """

    def __init__(
        self,
        t: FloatArray,
        positions_m: FloatArray,
        half_window_samples: int,
        half_window_s: float,
        teleport_speed_m_s: float,
        max_gap_s: float,
        holes: Sequence[Span] = (),
        *,
        fastest_m_s: float = np.inf,
        time_error_s: float = 0.0,
    ) -> None:
        self._all_t, self._positions_m = t, positions_m
        self._half_samples, self._half_s = half_window_samples, half_window_s
        self._fastest_m_s, self._error_s = fastest_m_s, time_error_s
        steps_s = np.diff(t)
        # No jump where stamps that are wrong explain the step.
        lasts_s = steps_s + 2.0 * time_error_s
        jumps = np.flatnonzero(lengths(np.diff(positions_m, axis=0)) > teleport_speed_m_s * lasts_s)
        # 1 ns for rounding, as in `covered`; a step that lies in a hole is one across a gap, however short.
        gaps = np.flatnonzero((steps_s > max_gap_s + 1e-9) | within_spans((t[1:] + t[:-1]) / 2, holes))
        self.jumps = len(jumps)
        # The first row of each track: at a jump, and after a gap, one ends.
        self._begins = distinct(np.concatenate([[0], jumps + 1, gaps + 1]).astype(np.intp))
        self._ends = np.append(self._begins[1:], len(t))
        alone = self._begins[self._ends - self._begins == 1]
        # Both samples of a jump: a pose that is updated in leaps would otherwise stand still between them.
        self._without = distinct(np.concatenate([alone, jumps, jumps + 1])) if len(t) else jumps
        self.t = np.delete(t, self._without) if len(self._without) else t

    def values(self) -> FloatArray:
        """The velocities, shape (m, 3), m/s."""
        t, index = self._all_t, np.arange(len(self._all_t))
        if len(self._without):
            index = np.delete(index, self._without)
        low, high = index - self._half_samples, index + self._half_samples
        if self._half_s > 0:
            low = np.searchsorted(t, self.t - self._half_s - 1e-9, side="left")
            high = np.searchsorted(t, self.t + self._half_s + 1e-9, side="right") - 1
            # At least one sample on each side, however slow the log: a difference needs two samples.
            low, high = np.minimum(low, index - 1), np.maximum(high, index + 1)
        track = self._begins.searchsorted(index, side="right") - 1 if len(self._begins) > 1 else 0
        low, high = np.maximum(low, self._begins[track]), np.minimum(high, self._ends[track] - 1)
        way = np.take(self._positions_m, high, axis=0) - np.take(self._positions_m, low, axis=0)
        lasts_s = t[high] - t[low]
        velocities: FloatArray = way / lasts_s[:, None]
        if self._error_s > 0.0 and np.isfinite(self._fastest_m_s):
            return self._believable(velocities, lasts_s)
        return velocities

    def _believable(self, velocities: FloatArray, lasts_s: FloatArray) -> FloatArray:
        """The velocities, none above the bound of the body but for what wrong stamps cannot explain.

        Two messages that come late and close together make a body faster than it was, and so a violation
        that never was.
        """
        speeds = lengths(velocities)
        surely = speeds * lasts_s / (lasts_s + 2.0 * self._error_s)
        most = np.maximum(self._fastest_m_s, surely)
        share = np.divide(most, speeds, out=np.ones_like(speeds), where=speeds > most)
        return np.asarray(velocities * share[:, None], dtype=np.float64)
