"""Signals from signals: speeds from positions, separation and approach from pairs of bodies.

The definitions are those of the monitor catalogue, section 1.1. What a log records
itself is never replaced by something derived.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ariac_score.trial.model import Body, LogDefect, Trial
from ariac_score.trial.signals import Signal, align
from ariac_score.trial.spans import BoolArray, FloatArray
from ariac_score.trial.vocabulary import QUANTITIES

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
    if len(t) < 2:
        return t[:0], positions_m[:0], 0
    dt = np.diff(t)
    jump = np.linalg.norm(np.diff(positions_m, axis=0), axis=1) > teleport_speed_m_s * dt
    track = np.concatenate(([0], np.cumsum(jump | (dt > max_gap_s + 1e-9))))
    index = np.arange(len(t))
    first = np.searchsorted(track, track, side="left")
    last = np.searchsorted(track, track, side="right") - 1
    if half_window_s > 0:
        low = np.searchsorted(t, t - half_window_s - 1e-9, side="left")
        high = np.searchsorted(t, t + half_window_s + 1e-9, side="right") - 1
        low, high = np.minimum(low, index - 1), np.maximum(high, index + 1)
    else:
        low, high = index - half_window_samples, index + half_window_samples
    low, high = np.maximum(low, first), np.minimum(high, last)
    # Beside a jump nothing is known: a pose updated in leaps would otherwise stand still between them.
    beside = np.zeros(len(t), dtype=bool)
    beside[:-1] |= jump
    beside[1:] |= jump
    moving = (high > low) & ~beside
    low, high = low[moving], high[moving]
    velocity = (positions_m[high] - positions_m[low]) / (t[high] - t[low])[:, None]
    return t[moving], velocity, int(jump.sum())


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
    """Finds or derives one signal after the other, keeping what it found."""

    def __init__(self, trial: Trial, speed_window_s: float, shortest_gaps_s: Mapping[str, float]) -> None:
        self.bodies = {body.id: body for body in trial.bodies}
        self.signals: dict[str, Signal] = dict(trial.signals)
        self.speed_window_s = speed_window_s
        self.shortest_gaps_s = shortest_gaps_s
        self.defects: set[LogDefect] = set()
        self._nearest_of: dict[tuple[str, float, int], tuple[FloatArray, FloatArray]] = {}
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
        derived = derive(subject, max_gap_s) if derive else None
        if derived is None or not len(derived[0]):
            return None
        self.signals[name] = Signal(name, QUANTITIES[quantity].unit, *derived, source="derived")
        return self.signals[name]

    def _velocity(self, point: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        position = self.signals.get(f"position/{point}")
        if position is None:
            return None
        t, velocity, jumps = centred_velocity(
            position.t, position.values, half_window_s=self.speed_window_s, max_gap_s=max_gap_s
        )
        if jumps:
            message = f"{point} jumped faster than {TELEPORT_SPEED_M_S:g} m/s; its track was split there"
            self.defects.add(LogDefect("teleport", position.name, jumps, message))
        return t, velocity

    def _speed(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        """Speed of the origin; where links are followed, of the fastest of them and it."""
        body = self.bodies.get(subject)
        points = [subject, *(f"{subject}::{link}" for link in body.links)] if body else [subject]
        velocities = [self.get(f"velocity/{point}", max_gap_s) for point in points]
        present = [signal for signal in velocities if signal is not None]
        if len(present) < len(points) - (f"position/{subject}" not in self.signals) or not present:
            return None
        t, values = align(present, max_gap_s=max_gap_s)
        fastest = np.zeros(len(t))
        for velocity in values:
            np.maximum(fastest, _norm(velocity), out=fastest)
        return t, fastest

    def _tcp_speed(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        """Speed of the link that is the tool centre point, where one is followed."""
        links = self.bodies[subject].links if subject in self.bodies else ()
        tool = next((link for link in TOOL_LINKS if link in links), None)
        velocity = self.get(f"velocity/{subject}::{tool}", max_gap_s) if tool else None
        return None if velocity is None else (velocity.t, _norm(velocity.values))

    def _points_of(self, subject: str, max_gap_s: float, quantity: str) -> tuple[FloatArray, _Tracks] | None:
        """A quantity of every point of the robot and of the human of a pair, on one time base."""
        robot, _, human = subject.partition("/")
        if not {robot, human} <= self.bodies.keys():
            return None
        names = [[f"{quantity}/{point}" for point in _points(self.bodies[b])] for b in (robot, human)]
        found = [self.get(name, max_gap_s) for name in (*names[0], *names[1])]
        present = [signal for signal in found if signal is not None]
        if len(present) < len(found):
            return None  # one that is missing may be the nearest
        t, values = align(present, max_gap_s=max_gap_s)
        return t, (values[: len(names[0])], values[len(names[0]) :])

    def _nearest(
        self, subject: str, max_gap_s: float, components: int
    ) -> tuple[FloatArray, FloatArray] | None:
        """The smallest distance between a point of the robot and one of the human."""
        key = subject, max_gap_s, components
        if key not in self._nearest_of:
            points = self._points_of(subject, max_gap_s, "position")
            if points is None:
                return None
            t, (of_robot, of_human) = points
            found = {subject: of_human} | self._seen_together(subject.partition("/")[0], t, of_robot)
            distances = nearest_distances(of_robot, list(found.values()), slice(components))
            for other, distance_m in zip(found, distances, strict=True):
                self._nearest_of[other, max_gap_s, components] = t, distance_m
        return self._nearest_of[key]

    def _seen_together(
        self, robot: str, t: FloatArray, of_robot: Sequence[FloatArray]
    ) -> dict[str, list[FloatArray]]:
        """The tracks of all humans that are sampled with a robot, by pair: they are measured at once."""
        if not all(
            self.signals[f"position/{point}"].values is values
            for point, values in zip(_points(self.bodies[robot]), of_robot, strict=True)
        ):
            return {}
        found = {}
        for human in self._humans_of.get(robot, ()):
            names = [f"position/{point}" for point in _points(self.bodies[human])]
            signals = [self.signals[name] for name in names if name in self.signals]
            if len(signals) == len(names) and all(np.array_equal(s.t, t) for s in signals):
                found[f"{robot}/{human}"] = [s.values for s in signals]
        return found

    def _centre_distance(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        return self._nearest(subject, max_gap_s, 3)

    def _centre_distance_2d(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        return self._nearest(subject, max_gap_s, 2)

    def _separation(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        nearest = self._nearest(subject, max_gap_s, 3)
        if nearest is None:
            return None
        robot, _, human = subject.partition("/")
        t, distance_m = nearest
        return t, np.maximum(distance_m - self.bodies[robot].radius_m - self.bodies[human].radius_m, 0.0)

    def _approach_of_robot(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        return self._approach(subject, max_gap_s, of_human=False)

    def _approach_of_human(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        return self._approach(subject, max_gap_s, of_human=True)

    def _relative_speed(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        """|v_r - v_h| of the closest points."""
        found = self._of_nearest(subject, max_gap_s, lambda _apart, v_r, v_h: _norm(v_r - v_h))
        return None if found is None else (found[0], found[2])

    def _approach(
        self, subject: str, max_gap_s: float, *, of_human: bool
    ) -> tuple[FloatArray, FloatArray] | None:
        """v . u for the robot and -(v . u) for the human, u the unit vector between the closest points."""
        found = self._of_nearest(
            subject, max_gap_s, lambda apart, v_r, v_h: _dot(-v_h if of_human else v_r, apart)
        )
        if found is None:
            return None
        t, nearest, towards = found
        somewhere: BoolArray = nearest > 0  # in one point there is no direction
        return t[somewhere], towards[somewhere] / nearest[somewhere]

    def _of_nearest(
        self, subject: str, max_gap_s: float, measure: _OfPoints
    ) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Times, distance of the nearest two points, and what is measured of these two."""
        positions = self._points_of(subject, max_gap_s, "position")
        velocities = self._points_of(subject, max_gap_s, "velocity")
        if positions is None or velocities is None:
            return None
        # Velocities lack samples at jumps, so the common base is that of the velocities.
        t = velocities[0][np.isin(velocities[0], positions[0])]
        at = np.searchsorted(positions[0], t), np.searchsorted(velocities[0], t)
        nearest, measured = np.full(len(t), np.inf), np.zeros(len(t))
        for i, a in enumerate(positions[1][0]):
            for j, b in enumerate(positions[1][1]):
                apart = (b - a)[at[0]]
                distance = _norm(apart)
                value = measure(apart, velocities[1][0][i][at[1]], velocities[1][1][j][at[1]])
                closer = distance < nearest
                nearest[closer], measured[closer] = distance[closer], value[closer]
        return t, nearest, measured


_Tracks = tuple[list[FloatArray], list[FloatArray]]
_OfPoints = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Of the way from robot to human, the velocity of the robot and that of the human, row by row."""


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
