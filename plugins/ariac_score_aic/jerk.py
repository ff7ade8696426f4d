"""Jerk of the tool, as the scorer takes it from velocities or, until February 24, from poses."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ariac_score import FloatArray

__all__ = ["MeanJerk", "jerk_of_poses", "jerk_of_velocities"]

_LEAST_WEIGHT_S = 1e-6
"""Below this sum of weights the scorer gives no jerk. Source: `ScoringTier2.cc`, line 633."""


_CLEAR = 1e-4
"""Squares of times that differ from straight lines by a larger share lose no digits that count."""


@dataclass(frozen=True)
class MeanJerk:
    """A weighted mean of magnitudes of jerk.

    Attributes:
        value_m_s3: The mean; `None` where nothing can be said.
        samples: How many samples there were.
        counted: At how many of them the tool moved fast enough to count.
        why_not: Why there is none, in words.
        at_s: When the tool moved fast enough, s.
        jerk_m_s3: The magnitude of jerk then.
    """

    value_m_s3: float | None
    samples: int
    counted: int
    why_not: str = ""
    at_s: FloatArray = field(default_factory=lambda: np.empty(0), compare=False)
    jerk_m_s3: FloatArray = field(default_factory=lambda: np.empty(0), compare=False)


def jerk_of_velocities(
    t_s: FloatArray, velocity_m_s: FloatArray, *, window: int = 15, gate_m_s: float = 0.01
) -> MeanJerk:
    """The mean over samples that move of the second derivative of a quadratic fitted around each.

    Stamps are taken as they are: they may repeat, and run back. The first and last half windows are no
    centres.

    Args:
        t_s: Stamps in order of consumption, shape (n,), s.
        velocity_m_s: The tool's velocities, shape (n, 3), m/s.
        window: How many samples a fit takes, odd.
        gate_m_s: Samples at this speed or below are no centres.

    Source:
        `ScoringTier2.cc` of intrinsic-dev/aic at db40abcf, lines 547 to 640.
    """
    count, half = len(t_s), window // 2
    if count < window:
        return MeanJerk(None, count, 0, f"{count} velocities, and {window} are needed")
    speeds = np.sqrt((velocity_m_s**2).sum(axis=1))
    centres = np.arange(half, count - half)
    centres = centres[speeds[half : count - half] > gate_m_s]
    magnitudes, weights = _fitted(t_s, velocity_m_s, centres, window)
    return replace(_mean(magnitudes, weights, count), at_s=t_s[centres], jerk_m_s3=magnitudes)


def _mean(magnitudes: FloatArray, weights: FloatArray, samples: int) -> MeanJerk:
    total_s = float(np.cumsum(weights)[-1]) if len(weights) else 0.0
    if abs(total_s) < _LEAST_WEIGHT_S:
        return MeanJerk(
            None, samples, len(weights), "the tool never moved fast enough, or stamps stand still"
        )
    value = float(np.cumsum(magnitudes * weights)[-1]) / total_s
    return MeanJerk(value, samples, len(weights))


def _fitted(
    t_s: FloatArray, velocity_m_s: FloatArray, centres: NDArray[np.intp], window: int
) -> tuple[FloatArray, FloatArray]:
    """The magnitude of jerk and the weight of each centre."""
    half = window // 2
    at = centres[:, np.newaxis] + np.arange(-half, half + 1)
    offsets = t_s[at] - t_s[centres][:, np.newaxis]
    weights = (t_s[centres + half] - t_s[centres - half]) / window
    scale = np.abs(offsets).max(axis=1, initial=0.0)
    scale = np.where(scale > 0, scale, 1.0)
    distinct = (np.diff(np.sort(offsets, axis=1), axis=1) > 0).sum(axis=1) + 1
    jerk = np.zeros((len(centres), 3))
    # What is left of t² beside 1 and t gives its coefficient; where next to nothing is, a factorisation does.
    u = offsets / scale[:, np.newaxis]
    square = u * u
    straight = u - u.mean(axis=1, keepdims=True)
    left = square - square.mean(axis=1, keepdims=True)
    norm = (straight * straight).sum(axis=1)
    share = (straight * left).sum(axis=1) / np.where(norm > 0, norm, 1.0)
    left -= straight * share[:, np.newaxis]
    size = (left * left).sum(axis=1)
    clear = (distinct >= 3) & (size > _CLEAR * (square * square).sum(axis=1))
    sums = np.einsum("nj,njk->nk", left[clear], velocity_m_s[at[clear]])
    jerk[clear] = 2.0 * sums / size[clear][:, np.newaxis] / scale[clear][:, np.newaxis] ** 2
    full = np.flatnonzero((distinct >= 3) & ~clear)
    if len(full):
        u = offsets[full] / scale[full][:, np.newaxis]
        basis = np.stack([np.ones_like(u), u, u * u], axis=2)
        q, r = np.linalg.qr(basis)
        sides = np.einsum("nij,nik->njk", q, velocity_m_s[at[full]])
        jerk[full] = 2.0 * sides[:, 2] / r[:, 2, 2][:, np.newaxis] / scale[full][:, np.newaxis] ** 2
    for row in np.flatnonzero(distinct < 3).tolist():
        jerk[row] = 2.0 * _pivoted(offsets[row], velocity_m_s[at[row]])[2]
    return np.sqrt((jerk**2).sum(axis=1)), weights


def _pivoted(offsets: FloatArray, values: FloatArray) -> FloatArray:
    """The coefficients of 1, t, t² that a column-pivoted QR gives where fewer stamps than these are distinct.

    What the stamps cannot tell apart gets the coefficient 0, column by column in order of their norms.

    Source: Eigen, `ColPivHouseholderQR`.
    """
    matrix = np.stack([np.ones_like(offsets), offsets, offsets * offsets], axis=1)
    left, chosen = matrix.copy(), list[int]()
    largest = np.sqrt((matrix**2).sum(axis=0)).max()
    while len(chosen) < 3:
        norms = np.sqrt((left**2).sum(axis=0))
        norms[chosen] = -1.0
        column = int(norms.argmax())
        if norms[column] <= largest * np.finfo(float).eps * 3:
            break
        chosen.append(column)
        direction = left[:, column] / norms[column]
        left = left - np.outer(direction, direction @ left)
    found = np.zeros((3, values.shape[1]))
    if chosen:
        found[chosen] = np.linalg.lstsq(matrix[:, chosen], values, rcond=None)[0]
    return found


def jerk_of_poses(
    t_s: FloatArray,
    position_m: FloatArray,
    *,
    average: Literal["vectors", "magnitudes"],
    gate_m_s: float = 0.0,
) -> MeanJerk:
    """Third differences over four neighbouring poses, averaged over time.

    Args:
        t_s: Stamps, shape (n,), s.
        position_m: Positions of the tool, shape (n, 3), m.
        average: `vectors`: the magnitude of the mean vector, each weighted with the middle step;
            `magnitudes`: the mean of magnitudes, each weighted with a third of all three steps.
        gate_m_s: With `magnitudes`, differences at this speed of the middle step or below do not count.

    Source:
        `ScoringTier2.cc` of intrinsic-dev/aic at 15839f2e1 (vectors) and e0a428b3a (magnitudes).
    """
    count = len(t_s)
    if count < 4:
        return MeanJerk(None, count, 0, f"{count} poses, and 4 are needed")
    steps = np.diff(t_s)
    usable = (steps[:-2] > 0) & (steps[1:-1] > 0) & (steps[2:] > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        velocity = np.diff(position_m, axis=0) / steps[:, np.newaxis]
        middles = (t_s[1:] + t_s[:-1]) / 2
        acceleration = np.diff(velocity, axis=0) / np.diff(middles)[:, np.newaxis]
        centres = (middles[1:] + middles[:-1]) / 2
        jerk = np.diff(acceleration, axis=0) / np.diff(centres)[:, np.newaxis]
    if average == "vectors":
        weights = np.where(usable, steps[1:-1], 0.0)
        total_s = float(np.cumsum(weights)[-1])
        if abs(total_s) < _LEAST_WEIGHT_S:
            return MeanJerk(None, count, 0, "all poses have one stamp")
        vector = (
            np.cumsum(np.where(usable[:, np.newaxis], jerk, 0.0) * weights[:, np.newaxis], axis=0)[-1]
            / total_s
        )
        return MeanJerk(float(np.sqrt((vector**2).sum())), count, int(usable.sum()))
    fast = np.sqrt((velocity[1:-1] ** 2).sum(axis=1)) > gate_m_s
    counted = usable & fast
    weights = ((t_s[3:] - t_s[:-3]) / 3)[counted]
    return _mean(np.sqrt((jerk[counted] ** 2).sum(axis=1)), weights, count)
