"""What may have been between two samples: the mathematics, of numbers alone.

Between two samples a body is where its greatest speed lets it be. For one distance with a speed bound the
two extremes are paths that may have been (McShane 1934), so whatever is monotone in the distance has its
exact ends there. Positions and accelerations give bounds that are tight at each instant, though no one
path need follow them: integrals over them are outer bounds.

Where a function takes a time since and a time until, both may be those of a whole cell: the longest since
its beginning sample and the longest until its ending one. What comes out then holds everywhere in the cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vectors import dot, lengths

__all__ = [
    "Ends",
    "acceleration_band",
    "between",
    "distance_to_lens",
    "excursion",
    "highest_speed",
    "lowest_speed",
    "most_episodes",
    "places_apart",
    "reach",
    "rest_excursion",
    "violation",
]


@dataclass(frozen=True)
class Ends:
    """The least and the most of a number.

    Attributes:
        least: No world has less.
        most: No world has more.
    """

    least: float
    most: float


def reach(rate: float, lasts_s: FloatArray | float) -> FloatArray:
    """How much something changes in some time at most; in endless time anything, even at a rate of 0."""
    lasts = np.asarray(lasts_s, dtype=np.float64)
    endless = np.isinf(lasts)
    return np.where(endless, np.inf, rate * np.where(endless, 0.0, lasts))


# One distance, speed bound ---------------------------------------------------------------------


def between(
    before: FloatArray | float,
    after: FloatArray | float,
    since_s: FloatArray | float,
    until_s: FloatArray | float,
    rate: float,
    *,
    at_least: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """The least and the most of a number that changes no faster than a rate.

    Args:
        before: At the sample before; NaN where there is none.
        after: At the sample after, likewise.
        since_s: Since the sample before, s.
        until_s: Until the sample after, s.
        rate: The fastest change, per s.
        at_least: It is never below this.

    >>> [float(end) for end in between(2.0, 2.0, 0.5, 0.5, 1.6)]
    [1.2, 2.8]
    """
    grown_since, grown_until = reach(rate, since_s), reach(rate, until_s)
    # `fmax` and `fmin` leave out the side that has no sample.
    least = np.fmax(np.fmax(before - grown_since, after - grown_until), at_least)
    most = np.fmin(before + grown_since, after + grown_until)
    return least, np.where(np.isnan(most), np.inf, most)


def violation(
    before_m: float, after_m: float, gap_s: float, rate_m_s: float, limit_m: float
) -> dict[str, Ends]:
    """Time, depth and integral of being nearer than a limit in one gap: exact, attained by two paths.

    Args:
        before_m: Distance at the beginning of the gap, m.
        after_m: At its end, m.
        gap_s: Its length, s.
        rate_m_s: Closing speed of both bodies together, m/s.
        limit_m: Nearer than this is a violation, m.

    Raises:
        ValueError: The two samples are further apart than the speed allows.

    >>> violation(0.5, 0.5, 3.0, 1.0, 1.0)["time_s"]
    Ends(least=1.0, most=3.0)
    """
    least = _over_gap(before_m, after_m, gap_s, rate_m_s, limit_m, sign=1.0)
    most = _over_gap(before_m, after_m, gap_s, rate_m_s, limit_m, sign=-1.0)
    return {name: Ends(least[name], most[name]) for name in least}


def _over_gap(
    before_m: float, after_m: float, gap_s: float, rate_m_s: float, limit_m: float, *, sign: float
) -> dict[str, float]:
    """The same on one of the two extreme paths: away as fast as can be (+1), or towards each other (-1)."""
    needed = abs(after_m - before_m) / gap_s
    if needed > rate_m_s * (1.0 + 1e-12):
        raise ValueError(f"the samples need {needed:g} m/s, and {rate_m_s:g} m/s is the bound")
    turn_s = (gap_s + sign * (after_m - before_m) / rate_m_s) / 2.0
    turn_m = before_m + sign * rate_m_s * turn_s
    corners = [(0.0, before_m), (turn_s, turn_m), (gap_s, after_m)]
    time_s = integral = depth = 0.0
    for (t1, d1), (t2, d2) in pairwise(corners):
        time_s += _time_below(t2 - t1, d1, d2, limit_m)
        # Distances have a floor: what the line is below 0 is no depth.
        integral += _integral_below(t2 - t1, d1, d2, limit_m) - _integral_below(t2 - t1, d1, d2, 0.0)
        depth = max(depth, limit_m - max(min(d1, d2), 0.0))
    return {"time_s": time_s, "depth_m": max(depth, 0.0), "integral_m_s": integral}


def _time_below(lasts_s: float, first: float, last: float, limit: float) -> float:
    """How long a straight line is below a limit."""
    if lasts_s <= 0.0:
        return 0.0
    low, high = min(first, last), max(first, last)
    if high <= limit:
        return lasts_s if low < limit else 0.0
    return 0.0 if low >= limit else lasts_s * (limit - low) / (high - low)


def _integral_below(lasts_s: float, first: float, last: float, limit: float) -> float:
    """The area between a limit and the part of a straight line below it."""
    if lasts_s <= 0.0:
        return 0.0
    low, high = min(first, last), max(first, last)
    if high <= limit:
        return lasts_s * (limit - (low + high) / 2.0)
    return 0.0 if low >= limit else lasts_s * (limit - low) ** 2 / (2.0 * (high - low))


# Acceleration ----------------------------------------------------------------------------------


def acceleration_band(
    before: float, after: float, since_s: FloatArray | float, gap_s: float, acceleration: float
) -> tuple[FloatArray, FloatArray]:
    """The least and the most of a number between two samples whose second derivative is bounded.

    Tight at each instant; the envelope is not one path, so that integrals over it are outer bounds.

    >>> [float(end) for end in acceleration_band(2.0, 2.0, 0.5, 1.0, 2.0)]
    [1.75, 2.25]
    """
    since = np.asarray(since_s, dtype=np.float64)
    chord = before + (after - before) * since / gap_s
    bow = acceleration * since * (gap_s - since) / 2.0
    return chord - bow, chord + bow


def excursion(gap_s: float, speed: float, acceleration: float) -> float:
    """How far something gets from two equal samples, with speed and acceleration bounded.

    >>> excursion(2.0, 0.5, 1.0)
    0.375
    """
    half_s = gap_s / 2.0
    if half_s <= speed / acceleration:
        return acceleration * half_s * half_s / 2.0
    return speed * half_s - speed * speed / (2.0 * acceleration)


def rest_excursion(gap_s: float, speed: float, acceleration: float) -> float:
    """The same where it rests at both samples.

    >>> rest_excursion(1.0, math.inf, 2.0), rest_excursion(2.0, 0.5, 4.0)
    (0.125, 0.4375)
    """
    if acceleration * gap_s / 4.0 <= speed:
        return acceleration * gap_s * gap_s / 16.0
    return speed * gap_s / 2.0 - speed * speed / acceleration


def highest_speed(
    before: FloatArray | float,
    after: FloatArray | float,
    since_s: FloatArray | float,
    until_s: FloatArray | float,
    *,
    speed: float,
    acceleration: float = math.inf,
) -> FloatArray:
    """The most that a speed can be between two samples of it; NaN where there is no sample on a side.

    >>> float(highest_speed(0.25, 0.25, 0.25, 0.25, speed=1.0, acceleration=2.0))
    0.75
    """
    shape = np.broadcast(np.asarray(since_s), np.asarray(before)).shape
    if math.isinf(acceleration):
        return np.full(shape, speed)
    reached = np.fmin(before + acceleration * np.asarray(since_s), after + acceleration * np.asarray(until_s))
    return np.fmin(speed, reached)


def lowest_speed(
    before: FloatArray | float,
    after: FloatArray | float,
    since_s: FloatArray | float,
    until_s: FloatArray | float,
    *,
    acceleration: float = math.inf,
) -> FloatArray:
    """The least that a speed can be between two samples of it."""
    shape = np.broadcast(np.asarray(since_s), np.asarray(before)).shape
    if math.isinf(acceleration):
        return np.zeros(shape)
    reached = np.fmax(before - acceleration * np.asarray(since_s), after - acceleration * np.asarray(until_s))
    return np.fmax(0.0, reached)


# Positions -------------------------------------------------------------------------------------


def distance_to_lens(
    point: FloatArray, first: FloatArray, first_m: FloatArray, second: FloatArray, second_m: FloatArray
) -> FloatArray:
    """The distance of points to where two balls overlap: where a body can be between two samples.

    Args:
        point: Shape (n, k), m.
        first: Centre of the one ball, shape (n, k), m.
        first_m: Its radius, shape (n,), m.
        second: Centre of the other, shape (n, k), m.
        second_m: Its radius, shape (n,), m.

    Returns:
        Shape (n,), m; 0 inside. Of balls that only just fail to meet, that to where they come nearest.

    >>> robot, before, after = np.array([[2.0, 3.0]]), np.array([[0.0, 0.0]]), np.array([[4.0, 0.0]])
    >>> distance_to_lens(robot, before, np.array([2.5]), after, np.array([2.5])).tolist()
    [1.5]
    """
    to_first, to_second, along = point - first, point - second, second - first
    d1, d2, apart = lengths(to_first), lengths(to_second), lengths(along)
    outside_first, outside_second = d1 - first_m, d2 - second_m
    simple = np.maximum(np.maximum(outside_first, outside_second), 0.0)
    # The nearest point of a ball counts if the other ball has it too; else the nearest is on both rims.
    on_first = first + to_first * _ratio(first_m, d1)[..., None]
    on_second = second + to_second * _ratio(second_m, d2)[..., None]
    in_second = lengths(on_first - second) <= second_m
    in_first = lengths(on_second - first) <= first_m
    direct = ((outside_first > 0) & in_second) | ((outside_second > 0) & in_first)
    inside = (outside_first <= 0) & (outside_second <= 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = (apart * apart + first_m * first_m - second_m * second_m) / (2.0 * apart)
        ahead = dot(to_first, along) / apart
    rim = np.sqrt(np.maximum(first_m * first_m - middle * middle, 0.0))
    aside = np.sqrt(np.maximum(dot(to_first, to_first) - ahead * ahead, 0.0))
    to_rim = np.sqrt((ahead - middle) ** 2 + (aside - rim) ** 2)
    found = np.where(direct | inside | ~np.isfinite(to_rim), simple, np.maximum(to_rim, simple))
    return np.asarray(found, dtype=np.float64)


def _ratio(radius: FloatArray, distance: FloatArray) -> FloatArray:
    return np.divide(radius, distance, out=np.zeros_like(distance), where=distance > 0)


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a point can be: within a ball about the sample before, and one about the sample after.

    Attributes:
        before: Centre, shape (n, k), m.
        after: Centre, shape (n, k), m.
        since_m: How far it can have come since the sample before, shape (n,), m; infinite without one.
        until_m: How far it can still be from the sample after, likewise.
    """

    before: FloatArray
    after: FloatArray
    since_m: FloatArray
    until_m: FloatArray

    @cached_property
    def balls(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Centre and radius of each, and of the ball around where both overlap, as far as it is smaller."""
        return (self.before, self.since_m), (self.after, self.until_m), self._overlap

    @property
    def _overlap(self) -> tuple[FloatArray, FloatArray]:
        along = self.after - self.before
        apart = lengths(along)
        both = np.isfinite(self.since_m) & np.isfinite(self.until_m) & (apart > 0)
        since, until, apart = (np.where(both, one, 1.0) for one in (self.since_m, self.until_m, apart))
        middle = (apart * apart + since * since - until * until) / (2.0 * apart)
        # Its rim is the widest part of the overlap only where it lies between the two centres.
        widest = both & (middle >= 0) & (middle <= apart)
        rim = np.sqrt(np.maximum(since * since - middle * middle, 0.0))
        centre = self.before + along * np.where(widest, middle / apart, 0.0)[..., None]
        return centre, np.where(widest, rim, np.inf)

    def distance_from(self, point: FloatArray) -> FloatArray:
        """The least distance of a point from anywhere it can be."""
        both = np.isfinite(self.since_m) & np.isfinite(self.until_m)
        since, until = (np.where(both, one, 0.0) for one in (self.since_m, self.until_m))
        of_lens = distance_to_lens(point, self.before, since, self.after, until)
        sides = (self.before, self.since_m), (self.after, self.until_m)
        of_balls = [np.maximum(lengths(point - centre) - radius, 0.0) for centre, radius in sides]
        return np.where(both, of_lens, np.maximum(*of_balls))


def places_apart(
    one: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    other: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """The least and the most distance of two points between their samples.

    Args:
        one: Where it was before, shape (n, k), and after; how far it can have come since, shape (n,), and
            how far it can still have to go, m. A point whose place is known has radii of 0.
        other: The same of the other point.

    Returns:
        Shape (n,) each, m. The most is an outer bound where both move.
    """
    first, second = _Place(*one), _Place(*other)
    least = np.zeros(len(first.before))
    most = np.full(len(first.before), np.inf)
    for centre, radius in second.balls:
        least = np.maximum(least, first.distance_from(centre) - radius)
    for centre, radius in first.balls:
        least = np.maximum(least, second.distance_from(centre) - radius)
    for here, here_m in first.balls:
        for there, there_m in second.balls:
            most = np.minimum(most, lengths(here - there) + here_m + there_m)
    return least, most


# Episodes --------------------------------------------------------------------------------------


def most_episodes(
    before_m: float,
    after_m: float,
    gap_s: float,
    rate_m_s: float,
    limit_m: float,
    *,
    hysteresis_m: float = 0.0,
    t_off_s: float = 0.0,
) -> float:
    """How many violations can begin and end between two safe samples; infinite: nothing bounds it.

    Args:
        before_m: Distance at the beginning of the gap, m.
        after_m: At its end, m.
        gap_s: Its length, s.
        rate_m_s: Closing speed of both bodies together, m/s.
        limit_m: Nearer than this is a violation, m.
        hysteresis_m: A violation ends at so much beyond the limit, m.
        t_off_s: And once it has been over for so long, s.

    >>> most_episodes(1.1, 1.1, 2.0, 1.0, 1.0, hysteresis_m=0.2)
    5.0
    """
    first_s, last_s = (before_m - limit_m) / rate_m_s, gap_s - (after_m - limit_m) / rate_m_s
    if first_s > last_s:
        return 0.0
    period_s = max(2.0 * hysteresis_m / rate_m_s, t_off_s)
    if period_s == 0.0:
        return math.inf
    # 1 in 10^9 more: 1.8 s by 0.4 s of each is 4.5, but 2 s by 0.4 s must not be 4.999.
    return 1.0 + math.floor((last_s - first_s) / period_s + 1e-9)
