"""The nearest points of two bodies: how far apart they are, and how they move."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ariac_score.trial.signals import Signal, common_times, sealed
from ariac_score.trial.spans import BoolArray, FloatArray, distinct
from ariac_score.trial.vectors import dot, lengths

__all__ = ["Closest", "Made", "Nearest", "Points", "nearest_distances", "nearest_points"]

_BLOCK_SAMPLES = 4096

Made: TypeAlias = "tuple[FloatArray, Callable[[], FloatArray]]"
"""The times of a signal, and a function that computes its values."""


def nearest_distances(
    of_one: Sequence[FloatArray], of_others: Sequence[Sequence[FloatArray]], components: slice = slice(None)
) -> FloatArray:
    """The smallest distance between a point of one body and a point of each other one.

    Block by block and component by component, so that intermediate results stay in the
    processor's cache. The root of the smallest square is the smallest root to the bit:
    roots are rounded correctly, so their order is that of the squares.

    Args:
        of_one: Tracks of points, each of shape (n, k), m; at least one.
        of_others: Of each other body its tracks, likewise.
        components: Which of the k count.

    Returns:
        For each other body, shape (len(of_others), n), m; infinite for one without points.

    >>> one, other = np.array([[0.0, 0.0], [3.0, 4.0]]), np.zeros((2, 2))
    >>> nearest_distances([one], [[other]]).tolist()
    [[0.0, 5.0]]
    """
    count = len(of_one[0])
    nearest: FloatArray = np.full((len(of_others), count), np.inf)
    size = len(range(*components.indices(of_one[0].shape[1])))
    room = np.empty((size + 2, len(of_one), min(count, _BLOCK_SAMPLES)))
    for first in range(0, count, _BLOCK_SAMPLES):
        part = slice(first, first + _BLOCK_SAMPLES)
        smallest = nearest[:, part]
        *here, total, square = room[:, :, : smallest.shape[1]]
        for link, track in enumerate(of_one):
            for component, values in enumerate(track[part, components].T):
                here[component][link] = values
        for other, tracks in enumerate(of_others):
            for track in tracks:
                for component, there in enumerate(track[part, components].T):
                    into = square if component else total
                    np.subtract(there, here[component], out=into)
                    np.multiply(into, into, out=into)
                    if component:
                        np.add(total, square, out=total)
                np.minimum(smallest[other], total.min(axis=0), out=smallest[other])
    return np.sqrt(nearest)


@dataclass(frozen=True, eq=False)
class Points:
    """A quantity of every point of two bodies, on one time base.

    Attributes:
        first: One signal for each point of the first.
        second: One for each point of the second.
        t: The common times, shape (n,), s.
        together: Whether every signal is sampled at exactly these times.
    """

    first: Sequence[Signal]
    second: Sequence[Signal]
    t: FloatArray
    together: bool

    @classmethod
    def of(cls, first: Sequence[Signal], second: Sequence[Signal], max_gap_s: float) -> Points:
        """The points of a pair, given as their signals."""
        signals = [*first, *second]
        t = sealed(common_times(signals, max_gap_s=max_gap_s))
        return cls(first, second, t, all(s.t is t or np.array_equal(s.t, t) for s in signals))

    def at(self, signal: Signal, t: FloatArray, rows: Any) -> FloatArray:
        """The values of one of them at some rows of these times."""
        return signal.values[rows] if self.together and t is self.t else signal.at(t[rows])


def _blocks(count: int) -> Iterator[slice]:
    """Some thousand rows at a time: interpolated tracks of thirty links are never whole in memory."""
    return (slice(first, first + _BLOCK_SAMPLES) for first in range(0, count, _BLOCK_SAMPLES))


class Nearest:
    """The smallest distances between a body and each of some others."""

    def __init__(self, points: Points, others: Sequence[Sequence[Signal]], components: slice) -> None:
        self.points, self._others, self._components = points, others, components

    def distance_m(self, number: int) -> FloatArray:
        """Of one of the others, shape (n,)."""
        found: FloatArray = self._distances_m[number]
        return found

    @cached_property
    def _distances_m(self) -> FloatArray:
        """Of all, shape (number of others, n): the positions of the one body are read once for all."""
        points, t = self.points, self.points.t
        found = np.empty((len(self._others), len(t)))
        for rows in _blocks(len(t)):
            here = [points.at(one, t, rows) for one in points.first]
            there = [[points.at(one, t, rows) for one in other] for other in self._others]
            found[:, rows] = nearest_distances(here, there, self._components)
        return found


@dataclass(frozen=True, eq=False)
class Moves:
    """How the two nearest points move at each time.

    Speeds towards each other are still multiplied by the distance of the points: where that is 0
    there is no direction to divide by.
    """

    first_towards: FloatArray
    second_towards: FloatArray
    relative: FloatArray


class Closest:
    """The two nearest points of two bodies, and how they move.

    Attributes:
        t: The times at which positions and velocities are known, shape (n,), s.
        distance_m: The distance of the two points, shape (n,).
    """

    def __init__(self, positions: Points, velocities: Points) -> None:
        self._positions, self._velocities = positions, velocities
        self.t = velocities.t
        if not np.array_equal(positions.t, velocities.t):
            # Velocities lack samples at jumps, so the common base is that of the velocities.
            self.t = sealed(velocities.t[np.isin(velocities.t, positions.t)])
        elif positions.together:
            self.t = positions.t
        self.distance_m = np.empty(len(self.t))
        self._pair = np.empty(len(self.t), dtype=np.intp)
        for rows in _blocks(len(self.t)):
            first, second = (
                [positions.at(one, self.t, rows) for one in of] for of in (positions.first, positions.second)
            )
            self.distance_m[rows], self._pair[rows] = nearest_points(first, second)

    def towards(self, whose: str) -> Made:
        """The speed of one of them towards the other; left out where they coincide."""
        separate: BoolArray = self.distance_m > 0
        if separate.all():
            return self.t, lambda: getattr(self.moves, whose) / self.distance_m
        t = sealed(self.t[separate])
        return t, lambda: getattr(self.moves, whose)[separate] / self.distance_m[separate]

    @cached_property
    def moves(self) -> Moves:
        """How the two points move."""
        t, positions, velocities = self.t, self._positions, self._velocities
        found = Moves(*(np.zeros(len(t)) for _ in range(3)))
        # Values of a `Computed` vector are forgotten when nobody holds them; the second's serve every link.
        held = [one.values for one in velocities.second]
        for one in distinct(self._pair).tolist():
            i, j = divmod(one, len(positions.second))
            rows = np.flatnonzero(self._pair == one)
            v_first = velocities.at(velocities.first[i], t, rows)
            v_second = velocities.at(velocities.second[j], t, rows)
            between = positions.at(positions.second[j], t, rows) - positions.at(positions.first[i], t, rows)
            found.first_towards[rows] = dot(v_first, between)
            found.second_towards[rows] = dot(-v_second, between)
            found.relative[rows] = lengths(v_first - v_second)
        del held
        return found


_SQUARES = 1 << 17
"""Distances computed at a time, so that they stay in the processor's cache."""


def nearest_points(
    of_first: Sequence[FloatArray], of_second: Sequence[FloatArray]
) -> tuple[FloatArray, NDArray[np.intp]]:
    """The distance of the nearest points of two bodies, and which points these are.

    Of several equally near pairs the first counts.

    Args:
        of_first: Tracks of the points of one, each of shape (n, 3), m.
        of_second: Those of the other.

    Returns:
        Distances, shape (n,), m; number of the point of the one times the number of points
        of the other, plus the number of the point of the other.
    """
    n = len(of_first[0])
    nearest, pair = np.full(n, np.inf), np.zeros(n, dtype=np.intp)
    rows = max(_SQUARES // len(of_first), 1)
    for first in range(0, n, rows):
        part = slice(first, min(first + rows, n))
        here = [np.stack([track[part, axis] for track in of_first]) for axis in range(3)]
        for j, track in enumerate(of_second):
            total = np.square(track[part, 0] - here[0])
            total += np.square(track[part, 1] - here[1])
            total += np.square(track[part, 2] - here[2])
            np.sqrt(total, out=total)
            for i, distance in enumerate(total):
                known, which, number = nearest[part], pair[part], i * len(of_second) + j
                # Among equals the first one's point counts, and of it the first of the other.
                closer = (distance < known) | ((distance == known) & (number < which))
                np.copyto(known, distance, where=closer)
                which[closer] = number
    return nearest, pair
