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

import numpy as np

from ariac_score.trial.spans import BoolArray, FloatArray
from ariac_score.trial.vectors import dot, lengths

__all__ = [
    "Drive",
    "Place",
    "between",
    "distance_to_lens",
    "highest_speed",
    "lowest_speed",
    "off_the_chord",
    "places_apart",
    "reach",
]


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


# Speeds ----------------------------------------------------------------------------------------


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


def off_the_chord(
    since_s: FloatArray | float, until_s: FloatArray | float, acceleration_m_s2: float
) -> FloatArray:
    """How far a point can be from the straight way between its samples, if its velocity changes no faster, m.

    Tight at each instant, but no one path is as far at all of them.

    >>> float(off_the_chord(0.5, 0.5, 2.0))
    0.25
    """
    return np.asarray(acceleration_m_s2 * np.asarray(since_s) * np.asarray(until_s) / 2.0, dtype=np.float64)


_HALVINGS = 32
"""A velocity is then found to a billionth of the greatest."""


@dataclass(frozen=True, eq=False)
class Drive:
    """How a point can move from one sample to the next: no faster, and its velocity changing no faster.

    Attributes:
        since_s: Since the sample before, shape (n,), s.
        until_s: Until the one after, shape (n,), s.
        top_m_s: Its greatest speed, m/s.
        acceleration_m_s2: Its greatest acceleration, m/s2.
        before_m_s: How fast it was at the sample before at most, shape (n,), m/s.
        after_m_s: And at the one after.
    """

    since_s: FloatArray
    until_s: FloatArray
    top_m_s: float
    acceleration_m_s2: float
    before_m_s: FloatArray
    after_m_s: FloatArray

    def least(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """The least of one coordinate between two samples of it, shape (n,), m.

        Tight at each instant. Whatever its velocity is there, it bounds how far the point has come and how
        far it can get; the one for which both say the same leaves the most.
        """
        fastest = self._fastest()
        low, high = -fastest, fastest
        for _ in range(_HALVINGS):
            velocity = (low + high) / 2.0
            from_before, from_after = self._by_both(before, after, velocity)
            slower = from_before < from_after
            low, high = np.where(slower, velocity, low), np.where(slower, high, velocity)
        return np.maximum(self._by_both(before, after, low)[0], self._by_both(before, after, high)[1])

    def _by_both(
        self, before: FloatArray, after: FloatArray, velocity: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        return before - self._way(self.since_s, -velocity, self.before_m_s), after - self._way(
            self.until_s, velocity, self.after_m_s
        )

    def off_the_chord(self) -> FloatArray:
        """How far it can be from the straight way between both samples, wherever they are, shape (n,), m.

        What is sought is the greatest `x - share * (x at the sample after)` of a point that starts at 0. It
        is concave in the velocity `x` has there.
        """
        share = self.since_s / (self.since_s + self.until_s)
        fastest = self._fastest()
        low, high = -fastest, fastest
        for _ in range(_HALVINGS):
            velocity = (low + high) / 2.0
            grows = (1.0 - share) * self._gain(self.since_s, velocity, self.before_m_s) > share * self._gain(
                self.until_s, -velocity, self.after_m_s
            )
            low, high = np.where(grows, velocity, low), np.where(grows, high, velocity)
        velocity = (low + high) / 2.0
        return np.asarray(
            (1.0 - share) * self._way(self.since_s, velocity, self.before_m_s)
            + share * self._way(self.until_s, -velocity, self.after_m_s),
            dtype=np.float64,
        )

    def _fastest(self) -> FloatArray:
        """How fast it can be between both samples at most, shape (n,), m/s."""
        by_both = np.minimum(
            self.before_m_s + self.acceleration_m_s2 * self.since_s,
            self.after_m_s + self.acceleration_m_s2 * self.until_s,
        )
        return np.minimum(self.top_m_s, by_both)

    def _peak(self, lasts_s: FloatArray, velocity: FloatArray, end_m_s: FloatArray) -> FloatArray:
        """How fast it gets on its longest way."""
        change = self.acceleration_m_s2
        braking = (change * lasts_s + velocity + end_m_s) / 2.0
        return np.minimum(np.minimum(self.top_m_s, velocity + change * lasts_s), braking)

    def _way(self, lasts_s: FloatArray, velocity: FloatArray, end_m_s: FloatArray) -> FloatArray:
        """The longest way in a time that begins with a velocity and ends no faster than `end_m_s`, m."""
        change, peak = self.acceleration_m_s2, self._peak(lasts_s, velocity, end_m_s)
        ends = np.minimum(end_m_s, peak)
        cruising_s = lasts_s - (2.0 * peak - velocity - ends) / change
        return np.asarray((2.0 * peak**2 - velocity**2 - ends**2) / (2.0 * change) + peak * cruising_s)

    def _gain(self, lasts_s: FloatArray, velocity: FloatArray, end_m_s: FloatArray) -> FloatArray:
        """By how much that way grows with the velocity it begins with, m per m/s."""
        return (self._peak(lasts_s, velocity, end_m_s) - velocity) / self.acceleration_m_s2


@dataclass(frozen=True, eq=False)
class Place:
    """Where a point can be: near the sample before, near the sample after, and near the way between both.

    Attributes:
        before: Centre, shape (n, k), m.
        after: Centre, shape (n, k), m.
        since_m: How far it can have come since the sample before, shape (n,), m; infinite without one. A
            point whose place is known has radii of 0.
        until_m: How far it can still be from the sample after, likewise.
        chord: Where it would be on the straight way between both, shape (n, k), m; `None`: nothing bounds
            how far it can be from there.
        chord_m: How far it can be from there, shape (n,), m; infinite where nothing bounds it.
        drive: How it can move from the sample before to the one after; `None`: as its speed allows.
        driven: Where that is known, shape (n,).
        off_m: How far it moves in half a cell at most, shape (n,), m: `drive` is of the middle.
    """

    before: FloatArray
    after: FloatArray
    since_m: FloatArray
    until_m: FloatArray
    chord: FloatArray | None = None
    chord_m: FloatArray | None = None
    drive: Drive | None = None
    driven: BoolArray | None = None
    off_m: FloatArray | None = None

    @cached_property
    def balls(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Centre and radius of each, and of the ball around where two overlap, as far as it is smaller."""
        return (self.before, self.since_m), (self.after, self.until_m), self._overlap, *self._near_chord

    def least_along(self, direction: FloatArray) -> FloatArray:
        """The least of its coordinate in a direction, of unit vectors of shape (n, k), m."""
        before, after = dot(self.before, direction), dot(self.after, direction)
        least = np.maximum(before - self.since_m, after - self.until_m)
        if self.drive is None or self.driven is None or self.off_m is None:
            return least
        return np.where(self.driven, np.maximum(least, self.drive.least(before, after) - self.off_m), least)

    @property
    def middle(self) -> FloatArray:
        """Where it may be best looked for, shape (n, k), m."""
        return (self.before + self.after) / 2.0 if self.chord is None else self.chord

    @property
    def _near_chord(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        return () if self.chord is None or self.chord_m is None else ((self.chord, self.chord_m),)

    @property
    def driven_ball(self) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """The ball around the straight way that `drive` leaves it in.

        For the most alone: unlike the others it may be wider between nearer samples, and whoever leaves out
        one must not make the least greater.
        """
        if self.drive is None or self.driven is None or self.off_m is None or self.chord is None:
            return ()
        return ((self.chord, np.where(self.driven, self.drive.off_the_chord() + 2.0 * self.off_m, np.inf)),)

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
        found = np.where(both, of_lens, np.maximum(*of_balls))
        for centre, radius in self._near_chord:
            found = np.maximum(found, lengths(point - centre) - radius)
        return found


def places_apart(first: Place, second: Place) -> tuple[FloatArray, FloatArray]:
    """The least and the most distance of two points between their samples.

    Returns:
        Shape (n,) each, m. The most is an outer bound where both move.
    """
    least = np.zeros(len(first.before))
    most = np.full(len(first.before), np.inf)
    for centre, radius in second.balls:
        least = np.maximum(least, first.distance_from(centre) - radius)
    for centre, radius in first.balls:
        least = np.maximum(least, second.distance_from(centre) - radius)
    for here, here_m in (*first.balls, *first.driven_ball):
        for there, there_m in (*second.balls, *second.driven_ball):
            most = np.minimum(most, lengths(here - there) + here_m + there_m)
    if first.drive is not None or second.drive is not None:
        way = first.middle - second.middle
        direction = way / np.maximum(lengths(way), 1e-12)[:, None]
        least = np.maximum(least, first.least_along(direction) + second.least_along(-direction))
    return least, most
