"""Signals from signals: speeds from positions, separation and approach from pairs of bodies.

The definitions are those of the monitor catalogue, section 1.1. What a log records
itself is never replaced by something derived.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ariac_score.trial.model import Body, LogDefect, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import BoolArray, FloatArray, distinct
from ariac_score.trial.vocabulary import QUANTITIES
from ariac_score.trial.windows import Computed, Kept, TimeBase, cuts_of, same_times

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "SOURCES",
    "TELEPORT_SPEED_M_S",
    "Derivation",
    "centred_velocity",
    "derive_signals",
    "nearest_distances",
    "source_quantities",
]

TELEPORT_SPEED_M_S = 5.0
"""A step faster than this is a jump of the simulation, not a movement (catalogue, M19)."""

HALF_WINDOW_SAMPLES = 2
"""Samples on each side of a centred difference at 100 Hz (catalogue, 1.1)."""

_BLOCK_SAMPLES = 4096

TOOL_LINKS = ("tcp", "tool0")
"""Names of the link that is a robot's tool centre point; `tool0` is that of ROS-Industrial."""

SOURCES: Mapping[str, tuple[str, ...]] = {
    "speed": ("velocity", "position"),
    "velocity": ("position",),
    "centre_distance": ("position",),
    "centre_distance_2d": ("position",),
    "separation": ("position",),
    "approach_speed_robot": ("position", "velocity"),
    "approach_speed_human": ("position", "velocity"),
    "relative_speed": ("position", "velocity"),
    "body_separation": ("position",),
    "tcp_speed": ("velocity", "position"),
}
"""Which quantities each one can be derived from."""


def source_quantities(wanted: Iterable[str]) -> frozenset[str]:
    """The quantities a reader should decode so that the wanted ones can be had."""
    closure = set(wanted)
    for quantity in tuple(closure):
        closure.update(SOURCES.get(quantity, ()))
    return frozenset(closure)


@dataclass(frozen=True)
class Derivation:
    """What is to be derived, and across what.

    Attributes:
        quantity: Such as `centre_distance`.
        max_gap_s: Nothing is derived across gaps longer than this, s.
    """

    quantity: str
    max_gap_s: float


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
    crosses the split, so a jump is never a speed, and the samples beside it have none.

    Args:
        t: Sample times, shape (n,), s, strictly increasing.
        positions_m: Positions, shape (n, 3), m.
        half_window_samples: Samples on each side.
        half_window_s: Where positive, the half window in s instead of samples.
        teleport_speed_m_s: Speed above which a step is a jump, m/s.
        max_gap_s: Longest step that belongs to one track, s.

    Returns:
        Times, shape (m,), s; velocities, shape (m, 3), m/s; number of jumps. Samples
        beside a jump or alone in their track have no velocity and are left out.

    Source:
        Monitor catalogue, section 1.1; mistake 6 of section 5 (stamps without seconds).

    >>> positions_m = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    >>> t, v, jumps = centred_velocity(np.array([0.0, 1.0, 2.0]), positions_m)
    >>> v[:, 0].tolist(), jumps
    ([1.0, 1.0, 1.0], 0)
    """
    reach = _Reach(t, half_window_samples, half_window_s, max_gap_s)
    velocity = _Velocity(reach, positions_m, teleport_speed_m_s)
    return (*velocity.rows(0, len(t)), velocity.jumps)


class _Reach:
    """Over which rows the difference at each sample runs, for all points sampled at the same times."""

    def __init__(
        self, t: FloatArray, half_window_samples: int, half_window_s: float, max_gap_s: float
    ) -> None:
        self.t, self.samples, self.seconds, self.max_gap_s = t, half_window_samples, half_window_s, max_gap_s
        self._last: tuple[int, int, Any] = -1, -1, None
        self.gaps = [
            first + 1 + np.flatnonzero(np.diff(part) > max_gap_s + 1e-9) for first, part in _steps(t)
        ]

    def rows(self, first: int, last: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """The first and the last row of each difference, were there no tracks."""
        if self._last[:2] != (first, last):
            self._last = first, last, self._rows(first, last)
        found: tuple[NDArray[np.intp], NDArray[np.intp]] = self._last[2]
        return found

    def _rows(self, first: int, last: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        index = np.arange(first, last)
        if not self.seconds > 0:
            return index - self.samples, index + self.samples
        t = self.t[first:last]
        low = np.searchsorted(self.t, t - self.seconds - 1e-9, side="left")
        high = np.searchsorted(self.t, t + self.seconds + 1e-9, side="right") - 1
        return np.minimum(low, index - 1), np.maximum(high, index + 1)


def _steps(t: FloatArray) -> Iterator[tuple[int, FloatArray]]:
    """Times in parts that share one with the next, each with its first row."""
    for first in range(0, len(t) - 1, _BLOCK_SAMPLES):
        yield first, t[first : first + _BLOCK_SAMPLES + 1]


class _Velocity:
    """The velocity of one point, computed where it is asked for."""

    def __init__(self, reach: _Reach, positions_m: FloatArray, teleport_speed_m_s: float) -> None:
        self.reach, self.positions_m = reach, positions_m
        t, jumped = reach.t, [np.zeros(0, dtype=np.intp)]
        for first, part in _steps(t):
            way = _norm(np.diff(positions_m[first : first + len(part)], axis=0))
            jumped.append(first + np.flatnonzero(way > teleport_speed_m_s * np.diff(part)))
        jumps = np.concatenate(jumped)
        self.jumps = len(jumps)
        self.begins = distinct(np.concatenate([[0], jumps + 1, *reach.gaps]).astype(np.intp))
        """The first row of each track: at a jump, and after a gap, one ends."""
        self.ends = np.append(self.begins[1:], len(t))
        alone = self.begins[self.ends - self.begins == 1]
        # Beside a jump nothing is known: a pose updated in leaps would otherwise stand still between them.
        self.without = distinct(np.concatenate([alone, jumps, jumps + 1])) if len(t) else jumps
        """The rows that have no velocity."""

    def known(self, first: int, last: int) -> int:
        """How many of some rows have a velocity."""
        return last - first - int(np.diff(self.without.searchsorted([first, last]))[0])

    def rows(self, first: int, last: int) -> tuple[FloatArray, FloatArray]:
        """Times and velocities of some rows, less those that have none."""
        t = self.reach.t
        low, high = self.reach.rows(first, last)
        index = np.arange(first, last)
        if len(self.without):
            out = self.without[slice(*self.without.searchsorted([first, last]))] - first
            low, high, index = np.delete(low, out), np.delete(high, out), np.delete(index, out)
        if len(self.begins) > 1:
            track = self.begins.searchsorted(index, side="right") - 1
            low, high = np.maximum(low, self.begins[track]), np.minimum(high, self.ends[track] - 1)
        else:
            low, high = np.maximum(low, 0), np.minimum(high, len(t) - 1)
        times = t[first:last] if len(index) == last - first else t[index]
        way = np.take(self.positions_m, high, axis=0) - np.take(self.positions_m, low, axis=0)
        return times, way / (t[high] - t[low])[:, None]


def nearest_distances(
    of_one: Sequence[FloatArray], of_others: Sequence[Sequence[FloatArray]], components: slice = slice(None)
) -> FloatArray:
    """The smallest distance between a point of one body and a point of each other one.

    Block by block and component by component, so that what is computed stays in the
    processor's cache. The root is taken of the smallest square, which is the smallest root
    to the bit: roots are rounded correctly, so none overtakes another.

    Args:
        of_one: Tracks of points, each of shape (n, k), m; at least one.
        of_others: Of each other body its tracks, likewise.
        components: Which of the k count.

    Returns:
        For each other body, shape (len(of_others), n), m; infinite for one without points.

    >>> robot, human = np.array([[0.0, 0.0], [3.0, 4.0]]), np.zeros((2, 2))
    >>> nearest_distances([robot], [[human]]).tolist()
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


def derive_signals(trial: Trial, wanted: Iterable[Derivation], *, speed_window_s: float = 0.0) -> Trial:
    """The trial with every wanted signal that can be derived from what it records.

    Args:
        trial: As read.
        wanted: What monitors need; a quantity wanted twice takes the shorter gap.
        speed_window_s: Half width of the centred difference, s; 0 means two samples.

    Returns:
        A new trial. What cannot be derived is simply absent, for the monitor to find
        out; jumps that split a track are counted in its `log_defects`.
    """
    gaps: dict[str, float] = {}
    for item in wanted:
        gaps[item.quantity] = min(item.max_gap_s, gaps.get(item.quantity, np.inf))
    shortest: dict[str, float] = {}
    for quantity, gap_s in gaps.items():
        for source in source_quantities([quantity]):
            shortest[source] = min(gap_s, shortest.get(source, np.inf))
    deriver = _Deriver(trial, speed_window_s, shortest)
    for quantity in sorted(gaps):
        for subject in _subjects(trial, quantity):
            deriver.get(f"{quantity}/{subject}", gaps[quantity])
    defects = tuple(sorted({*trial.log_defects, *deriver.defects}))
    return replace(
        trial, signals={k: deriver.signals[k] for k in sorted(deriver.signals)}, log_defects=defects
    )


def _subjects(trial: Trial, quantity: str) -> Iterator[str]:
    known = QUANTITIES.get(quantity)
    if known is None:
        return
    if known.any_bodies:
        yield from (f"{a.id}/{b.id}" for a, b in trial.body_pairs())
    elif known.of == "pair":
        yield from (f"{robot.id}/{human.id}" for robot, human in trial.pairs())
    else:
        yield from sorted(body.id for body in trial.bodies)


class _Deriver:
    """Finds or derives one signal after the other; what is derived is computed where it is looked at."""

    def __init__(self, trial: Trial, speed_window_s: float, shortest_gaps_s: Mapping[str, float]) -> None:
        self.bodies = {body.id: body for body in trial.bodies}
        self.signals: dict[str, Signal] = dict(trial.signals)
        self.speed_window_s = speed_window_s
        self.shortest_gaps_s = shortest_gaps_s
        self.defects: set[LogDefect] = set()
        self.cuts = cuts_of(trial.signals.values())
        self.kept = Kept()
        self._reaches: dict[tuple[int, float], _Reach] = {}
        self._nearest_of: dict[tuple[str, float, int], tuple[_Nearest, int]] = {}
        self._closest_of: dict[tuple[str, float], _Closest | None] = {}
        self._humans_of: dict[str, list[str]] = {}
        for robot, human in trial.pairs():
            self._humans_of.setdefault(robot.id, []).append(human.id)

    def get(self, name: str, max_gap_s: float) -> Signal | None:
        """The recorded or derived signal; `None` when it cannot be had."""
        if name in self.signals:
            return self.signals[name]
        quantity, _, subject = name.partition("/")
        max_gap_s = min(max_gap_s, self.shortest_gaps_s.get(quantity, max_gap_s))
        derive = {
            "velocity": self._velocity,
            "speed": self._speed,
            "centre_distance": self._centre_distance,
            "centre_distance_2d": self._centre_distance_2d,
            "separation": self._separation,
            "approach_speed_robot": self._approach_of_robot,
            "approach_speed_human": self._approach_of_human,
            "relative_speed": self._relative_speed,
            "body_separation": self._separation,
            "tcp_speed": self._tcp_speed,
        }.get(quantity)
        made = derive(subject, max_gap_s) if derive else None
        if made is None or not sum(made.counts):
            return None
        self.signals[name] = Computed.made(
            name, QUANTITIES[quantity].unit, made.base, self.cuts, made.counts, made.window, self.kept
        )
        return self.signals[name]

    def _common(self, signals: Sequence[Signal], max_gap_s: float) -> TimeBase:
        return TimeBase(signals, max_gap_s=max_gap_s, cuts=self.cuts)

    def _velocity(self, point: str, max_gap_s: float) -> _Made | None:
        position = self.signals.get(f"position/{point}")
        if position is None:
            return None
        key = id(position.t), max_gap_s
        if key not in self._reaches:
            self._reaches[key] = _Reach(position.t, HALF_WINDOW_SAMPLES, self.speed_window_s, max_gap_s)
        velocity = _Velocity(self._reaches[key], position.values, TELEPORT_SPEED_M_S)
        if velocity.jumps:
            message = f"{point} jumped faster than {TELEPORT_SPEED_M_S:g} m/s; its track was split there"
            self.defects.add(LogDefect("teleport", position.name, velocity.jumps, message))
        base = self._common([position], max_gap_s)
        counts = [velocity.known(*base.rows(k)) for k in range(len(base))]
        whole = base if sum(counts) == len(position) else None
        return _Made(whole, counts, lambda k: velocity.rows(*base.rows(k)))

    def _speed(self, subject: str, max_gap_s: float) -> _Made | None:
        """Speed of the origin; where links are followed, of the fastest of them and it."""
        body = self.bodies.get(subject)
        points = [subject, *(f"{subject}::{link}" for link in body.links)] if body else [subject]
        velocities = [self.get(f"velocity/{point}", max_gap_s) for point in points]
        present = [signal for signal in velocities if signal is not None]
        if len(present) < len(points) - (f"position/{subject}" not in self.signals) or not present:
            return None
        base = self._common(present, max_gap_s)

        def fastest(k: int) -> FloatArray:
            speed = np.zeros(len(base.times(k)))
            for number in range(len(present)):
                np.maximum(speed, _norm(base.values(number, k)), out=speed)
            return speed

        return _Made.on(base, fastest)

    def _tcp_speed(self, subject: str, max_gap_s: float) -> _Made | None:
        """Speed of the link that is the tool centre point, where one is followed."""
        links = self.bodies[subject].links if subject in self.bodies else ()
        tool = next((link for link in TOOL_LINKS if link in links), None)
        velocity = self.get(f"velocity/{subject}::{tool}", max_gap_s) if tool else None
        if velocity is None:
            return None
        base = self._common([velocity], max_gap_s)
        return _Made.on(base, lambda k: _norm(base.values(0, k)))

    def _points_of(self, subject: str, max_gap_s: float, quantity: str) -> tuple[TimeBase, int] | None:
        """A quantity of every point of a pair, on one time base; how many of them are the robot's."""
        robot, _, human = subject.partition("/")
        if not {robot, human} <= self.bodies.keys():
            return None
        names = [[f"{quantity}/{point}" for point in _points(self.bodies[b])] for b in (robot, human)]
        found = [self.get(name, max_gap_s) for name in (*names[0], *names[1])]
        present = [signal for signal in found if signal is not None]
        if len(present) < len(found):
            return None  # one that is missing may be the nearest
        return self._common(present, max_gap_s), len(names[0])

    def _nearest(self, subject: str, max_gap_s: float, components: int) -> tuple[_Nearest, int] | None:
        """The smallest distances of the robot to each human; which of them is that of the pair."""
        key = subject, max_gap_s, components
        if key not in self._nearest_of:
            points = self._points_of(subject, max_gap_s, "position")
            if points is None:
                return None
            base, of_robot = points
            others = {subject: base.signals[of_robot:]} | self._seen_together(subject.partition("/")[0], base)
            nearest = _Nearest(base, of_robot, list(others.values()), slice(components), self.kept)
            for number, other in enumerate(others):
                self._nearest_of[other, max_gap_s, components] = nearest, number
        return self._nearest_of[key]

    def _seen_together(self, robot: str, base: TimeBase) -> dict[str, tuple[Signal, ...]]:
        """The tracks of all humans that are sampled with a robot, by pair: they are measured at once."""
        leader = base.leader
        if leader is None:
            return {}
        found = {}
        for human in self._humans_of.get(robot, ()):
            names = [f"position/{point}" for point in _points(self.bodies[human])]
            signals = tuple(self.signals[name] for name in names if name in self.signals)
            if len(signals) == len(names) and all(same_times(leader, signal) for signal in signals):
                found[f"{robot}/{human}"] = signals
        return found

    def _distance(self, subject: str, max_gap_s: float, components: int) -> _Made | None:
        nearest = self._nearest(subject, max_gap_s, components)
        if nearest is None:
            return None
        of_pair, number = nearest
        return _Made.on(of_pair.base, lambda k: of_pair.distances(number, k))

    def _centre_distance(self, subject: str, max_gap_s: float) -> _Made | None:
        return self._distance(subject, max_gap_s, 3)

    def _centre_distance_2d(self, subject: str, max_gap_s: float) -> _Made | None:
        return self._distance(subject, max_gap_s, 2)

    def _separation(self, subject: str, max_gap_s: float) -> _Made | None:
        nearest = self._nearest(subject, max_gap_s, 3)
        if nearest is None:
            return None
        robot, _, human = subject.partition("/")
        of_pair, number = nearest
        radii_m = self.bodies[robot].radius_m, self.bodies[human].radius_m

        def separation(k: int) -> FloatArray:
            return np.maximum(of_pair.distances(number, k) - radii_m[0] - radii_m[1], 0.0)

        return _Made.on(of_pair.base, separation)

    def _closest(self, subject: str, max_gap_s: float) -> _Closest | None:
        """How the nearest two points of a pair move."""
        key = subject, max_gap_s
        if key not in self._closest_of:
            positions = self._points_of(subject, max_gap_s, "position")
            velocities = self._points_of(subject, max_gap_s, "velocity")
            both = positions is not None and velocities is not None
            self._closest_of[key] = (
                _Closest(positions[0], velocities[0], positions[1], self.kept)
                if both and positions and velocities
                else None
            )
        return self._closest_of[key]

    def _approach_of_robot(self, subject: str, max_gap_s: float) -> _Made | None:
        """v . u for the robot, u the unit vector between the closest points."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else closest.towards(_ROBOT)

    def _approach_of_human(self, subject: str, max_gap_s: float) -> _Made | None:
        """-(v . u) for the human."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else closest.towards(_HUMAN)

    def _relative_speed(self, subject: str, max_gap_s: float) -> _Made | None:
        """|v_r - v_h| of the closest points."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else closest.apart()


@dataclass(frozen=True)
class _Made:
    """How a signal is made.

    Attributes:
        base: Whose times it has, all of them; `None`: some are left out.
        counts: Samples in each window.
        window: Times and values of one window.
    """

    base: TimeBase | None
    counts: Sequence[int]
    window: Callable[[int], tuple[FloatArray, FloatArray]]

    @classmethod
    def on(cls, base: TimeBase, values: Callable[[int], FloatArray]) -> _Made:
        """A signal that has a value at every time of a base."""
        counts = [len(base.times(k)) for k in range(len(base))]
        return cls(base, counts, lambda k: (base.times(k), values(k)))


class _Nearest:
    """The smallest distances between a robot and each of some humans, a window at a time."""

    def __init__(
        self,
        base: TimeBase,
        of_robot: int,
        of_others: Sequence[Sequence[Signal]],
        components: slice,
        kept: Kept,
    ) -> None:
        self.base, self._robot, self._others, self._components = base, of_robot, of_others, components
        self._kept, self._numbers = kept, [kept.number() for _ in of_others]

    def distances(self, number: int, k: int) -> FloatArray:
        """Those of one human in window k, m."""
        found = self._kept.get((self._numbers[number], k), 1)
        return self._measured(k)[number] if found is None else found[1]

    def _measured(self, k: int) -> FloatArray:
        base = self.base
        of_robot = [base.values(i, k) for i in range(self._robot)]
        of_pair = [base.values(i, k) for i in range(self._robot, len(base.signals))]
        # Others are measured with the first one only where all of them are sampled together.
        together = [[s.stretch(*base.rows(k))[1] for s in other] for other in self._others[1:]]
        distances = nearest_distances(of_robot, [of_pair, *together], self._components)
        for name, distance_m in zip(self._numbers, distances, strict=True):
            self._kept.put((name, k), (base.times(k), distance_m))
        return distances


_ROBOT, _HUMAN, _BETWEEN = 0, 1, 2
_SQUARES = 1 << 17
"""So many distances are looked at together."""


class _Closest:
    """Of a robot and a human the two points nearest to each other, and how they move, a window at a time."""

    def __init__(self, positions: TimeBase, velocities: TimeBase, of_robot: int, kept: Kept) -> None:
        self.positions, self.velocities, self.of_robot = positions, velocities, of_robot
        self.kept, self.numbers = kept, [kept.number() for _ in range(4)]
        self._counts: list[tuple[int, int]] | None = None

    def towards(self, whose: int) -> _Made:
        """The speed of one of them towards the other; in one point there is no direction."""

        def window(k: int) -> tuple[FloatArray, FloatArray]:
            t, (nearest, *measured) = self._window(k)
            somewhere: BoolArray = nearest > 0
            if somewhere.all():
                return t[:], measured[whose] / nearest
            return t[somewhere], measured[whose][somewhere] / nearest[somewhere]

        return _Made(self._base(1), [some for _, some in self._counted()], window)

    def apart(self) -> _Made:
        """The speed of one against the other."""

        def window(k: int) -> tuple[FloatArray, FloatArray]:
            t, (_, *measured) = self._window(k)
            return t[:], measured[_BETWEEN]

        return _Made(self._base(0), [every for every, _ in self._counted()], window)

    def _counted(self) -> list[tuple[int, int]]:
        """How many samples there are in each window, and in how many of them there is a direction."""
        if self._counts is None:
            windows = (self._window(k) for k in range(len(self.velocities)))
            self._counts = [(len(t), int((found[0] > 0).sum())) for t, found in windows]
        return self._counts

    def _base(self, which: int) -> TimeBase | None:
        """The time base, where no sample of it is left out."""
        base = self.velocities
        whole = base.leader is not None and sum(c[which] for c in self._counted()) == len(base.leader)
        return base if whole else None

    def _window(self, k: int) -> tuple[FloatArray, list[FloatArray]]:
        """Times, distance of the nearest two points, and three speeds of these two."""
        known = [one for number in self.numbers if (one := self.kept.get((number, k), 1)) is not None]
        if len(known) == len(self.numbers):
            return known[0][0], [values for _, values in known]
        t, at = self._times(k)
        found = self._measured(k, t, at)
        for place, (number, values) in enumerate(zip(self.numbers, found, strict=True)):
            self.kept.put((number, k), (t[:] if place else t, values))  # the times are there once
        return t, found

    def _times(self, k: int) -> tuple[FloatArray, tuple[Any, Any]]:
        """The times, and where they are among those of positions and of velocities."""
        of_positions, t = self.positions.times(k), self.velocities.times(k)
        if len(t) == len(of_positions) and np.array_equal(t, of_positions):
            return t, (slice(None), slice(None))
        # Velocities lack samples at jumps, so the common base is that of the velocities.
        common = t[np.isin(t, of_positions)]
        return common, (np.searchsorted(of_positions, common), np.searchsorted(t, common))

    def _measured(self, k: int, t: FloatArray, at: tuple[Any, Any]) -> list[FloatArray]:
        places = [self.positions.values(i, k)[at[0]] for i in range(len(self.positions.signals))]
        robot, human = places[: self.of_robot], places[self.of_robot :]
        nearest, pair = nearest_points(robot, human)
        towards_human, towards_robot, between = np.zeros(len(t)), np.zeros(len(t)), np.zeros(len(t))
        for one in distinct(pair).tolist():
            i, j = divmod(one, len(human))
            rows = pair == one
            v_robot = self.velocities.values(i, k)[at[1]][rows]
            v_human = self.velocities.values(self.of_robot + j, k)[at[1]][rows]
            apart = human[j][rows] - robot[i][rows]
            towards_human[rows], towards_robot[rows] = _dot(v_robot, apart), _dot(-v_human, apart)
            between[rows] = _norm(v_robot - v_human)
        return [nearest, towards_human, towards_robot, between]


def nearest_points(
    robot: Sequence[FloatArray], human: Sequence[FloatArray]
) -> tuple[FloatArray, NDArray[np.intp]]:
    """How far the nearest points of two bodies are apart, and which these are: the first of several.

    Args:
        robot: Tracks of the points of one, each of shape (n, 3), m.
        human: Those of the other.

    Returns:
        Distances, shape (n,), m; number of the point of the one times the number of points
        of the other, plus the number of the point of the other.
    """
    n = len(robot[0])
    nearest, pair = np.full(n, np.inf), np.zeros(n, dtype=np.intp)
    rows = max(_SQUARES // len(robot), 1)
    for first in range(0, n, rows):
        part = slice(first, min(first + rows, n))
        here = [np.stack([track[part, axis] for track in robot]) for axis in range(3)]
        for j, track in enumerate(human):
            total = np.square(track[part, 0] - here[0])
            total += np.square(track[part, 1] - here[1])
            total += np.square(track[part, 2] - here[2])
            np.sqrt(total, out=total)
            for i, distance in enumerate(total):
                known, which, number = nearest[part], pair[part], i * len(human) + j
                # Among equals the first robot's point counts, and of it the first human's.
                closer = (distance < known) | ((distance == known) & (number < which))
                np.copyto(known, distance, where=closer)
                which[closer] = number
    return nearest, pair


def _points(body: Body) -> list[str]:
    """The tracks that stand for a body: its links, or its origin where it has none."""
    return [f"{body.id}::{link}" for link in body.links] or [body.id]


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Product of each row with its partner, by plain operations: the same bits on every machine."""
    total: FloatArray = a[:, 0] * b[:, 0]
    for column in range(1, a.shape[1]):
        total = total + a[:, column] * b[:, column]
    return total


def _norm(vectors: FloatArray) -> FloatArray:
    """Length of each row."""
    return np.sqrt(_dot(vectors, vectors))
