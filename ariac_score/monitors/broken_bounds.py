"""Samples that break a bound of motion that an organiser states: the bound, or the recording, is wrong."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ariac_score.monitors.unseen import Unseen
from ariac_score.trial.bounds import BetweenSamples, MotionBound
from ariac_score.trial.computed import Computed
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.vectors import lengths
from ariac_score.trial.vocabulary import DISTANCES, SPEEDS, quantity_of

__all__ = ["Broken", "broken_bounds"]

ROUNDED_M = 1e-6
"""Places are written as 32-bit numbers, or with six digits."""


@dataclass(frozen=True)
class Broken:
    """A bound that the log breaks.

    Attributes:
        bodies: Of whom, such as `ann` or `arm and ann`.
        signal: Which shows it.
        t_s: When, s of trial time.
        needed: The speed or acceleration that the samples need.
        bound: The most that there can be.
        unit: Of both.
        stated: `rule_set` or `log_map`.
    """

    bodies: str
    signal: str
    t_s: float
    needed: float
    bound: float
    unit: str
    stated: str


def broken_bounds(trial: Trial, assumed: BetweenSamples) -> Broken | None:
    """The first stated bound that the samples of a trial break during the competition; `None`: they keep all.

    Args:
        trial: With its recorded signals; those that follow from others are not asked.
        assumed: With what an organiser states.
    """
    window = trial.window
    if window is None:
        return None
    unseen = Unseen(trial, assumed, window, math.inf)
    for name, signal in sorted(trial.signals.items()):
        motion = [] if isinstance(signal, Computed) else unseen.motion(name) or []
        if motion and all(one.stated for one in motion):
            # Stamps of arrival are as wrong as they are late; bounds in gaps are as much wider.
            known = replace(assumed, time_error_s=unseen.error_s(signal))
            found = _jumped(signal, window, motion, known)
            inside = (signal.t >= window.start_s) & (signal.t <= window.end_s)
            found = found or _broken(signal, signal.t[inside], signal.values[inside], motion, known)
            if found is not None:
                bodies = " and ".join(body.id for body in unseen.bodies(name))
                return Broken(bodies, name, *found, motion[0].stated)
    return None


def _jumped(
    signal: Signal, window: Span, motion: Sequence[MotionBound], assumed: BetweenSamples
) -> tuple[float, float, float, str] | None:
    """The same of samples that were left out."""
    if quantity_of(signal.name) != "position" and quantity_of(signal.name) not in DISTANCES:
        return None
    top = sum(one.max_speed_m_s for one in motion)
    for one in signal.disbelieved:
        if window.start_s <= one.at_s <= window.end_s:
            step_m = one.needed * (one.at_s - one.span.start_s)
            steps_s = one.at_s - one.span.start_s + 2.0 * assumed.time_error_s
            needed = max(step_m - 2.0 * assumed.distance_error_m, 0.0) / steps_s
            if needed > top:
                return one.at_s, needed, top, "m/s"
    return None


def _broken(
    signal: Signal, t: FloatArray, values: FloatArray, motion: Sequence[MotionBound], assumed: BetweenSamples
) -> tuple[float, float, float, str] | None:
    """When, the needed and the greatest speed or acceleration, and its unit."""
    quantity, top = quantity_of(signal.name), sum(one.max_speed_m_s for one in motion)
    steps_s = np.diff(t) + 2.0 * assumed.time_error_s
    if quantity in (*SPEEDS, "velocity"):
        column = lengths(values) if values.ndim > 1 else values
        change = np.abs(np.diff(values, axis=0))
        change = lengths(change) if change.ndim > 1 else change
        return _first_above(t, column, top, "m/s") or _first_above(
            t[1:], change / steps_s, motion[0].max_acceleration_m_s2, "m/s2"
        )
    if quantity == "position" or quantity in DISTANCES:
        change = np.diff(values, axis=0)
        way = lengths(change) if change.ndim > 1 else np.abs(change)
        needed = np.maximum(way - 2.0 * assumed.distance_error_m, 0.0) / steps_s
        found = _first_above(t[1:], needed, top, "m/s")
        if found is not None or quantity != "position" or math.isinf(motion[0].max_acceleration_m_s2):
            return found
        off_m = assumed.distance_error_m + top * assumed.time_error_s
        return _first_above(t[2:], _turned(t, values, off_m), motion[0].max_acceleration_m_s2, "m/s2")
    return None


def _turned(t: FloatArray, places_m: FloatArray, off_m: float) -> FloatArray:
    """The acceleration that each place and the two before it need at least, shape (n - 2,), m/s2.

    From the middle of one interval to that of the next a velocity changes from the mean one of the former to
    that of the latter: with less, no motion passes through all three. Places are wrong by `off_m` at most.
    """
    if len(t) < 3:
        return np.zeros(0)
    lasts_s, off_m = np.diff(t), off_m + ROUNDED_M
    mean = np.diff(places_m, axis=0) / lasts_s[:, None]
    surely = lengths(np.diff(mean, axis=0)) - 2.0 * off_m * (1.0 / lasts_s[1:] + 1.0 / lasts_s[:-1])
    return np.asarray(2.0 * np.maximum(surely, 0.0) / (lasts_s[1:] + lasts_s[:-1]), dtype=np.float64)


def _first_above(
    t: FloatArray, needed: FloatArray, bound: float, unit: str
) -> tuple[float, float, float, str] | None:
    # A millionth more: positions and stamps are rounded where they are recorded.
    rows = np.flatnonzero(needed > bound * (1.0 + 1e-6) + 1e-6)
    return (float(t[rows[0]]), float(needed[rows[0]]), bound, unit) if len(rows) else None
