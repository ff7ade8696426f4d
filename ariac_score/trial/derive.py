"""Signals from signals: speeds from positions, separation and approach from pairs of bodies.

The definitions are those of the monitor catalogue, section 1.1. What a log records
itself is never replaced by something derived.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
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
    "source_quantities",
]

TELEPORT_SPEED_M_S = 5.0
"""A step faster than this is a jump of the simulation, not a movement (catalogue, M19)."""

HALF_WINDOW_SAMPLES = 2
"""Samples on each side of a centred difference at 100 Hz (catalogue, 1.1)."""

SOURCES: Mapping[str, tuple[str, ...]] = {
    "speed": ("velocity", "position"),
    "velocity": ("position",),
    "centre_distance": ("position",),
    "centre_distance_2d": ("position",),
    "separation": ("position",),
    "approach_speed_robot": ("position", "velocity"),
    "approach_speed_human": ("position", "velocity"),
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
    crosses the split, so a jump is never a speed.

    Args:
        t: Sample times, shape (n,), s, strictly increasing.
        positions_m: Positions, shape (n, 3), m.
        half_window_samples: Samples on each side.
        half_window_s: Where positive, the half window in s instead of samples.
        teleport_speed_m_s: Speed above which a step is a jump, m/s.
        max_gap_s: Longest step that belongs to one track, s.

    Returns:
        Times, shape (m,), s; velocities, shape (m, 3), m/s; number of jumps. Samples
        alone in their track have no velocity and are left out.

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
    moving = high > low
    low, high = low[moving], high[moving]
    velocity = (positions_m[high] - positions_m[low]) / (t[high] - t[low])[:, None]
    return t[moving], velocity, int(jump.sum())


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
    if known.of == "pair":
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
        }.get(quantity)
        derived = derive(subject, max_gap_s) if derive else None
        if derived is None or not len(derived[0]):
            return None
        self.signals[name] = Signal(name, QUANTITIES[quantity].unit, *derived)
        return self.signals[name]

    def _velocity(self, body: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        position = self.signals.get(f"position/{body}")
        if position is None:
            return None
        t, velocity, jumps = centred_velocity(
            position.t, position.values, half_window_s=self.speed_window_s, max_gap_s=max_gap_s
        )
        if jumps:
            message = f"{body} jumped faster than {TELEPORT_SPEED_M_S:g} m/s; its track was split there"
            self.defects.add(LogDefect("teleport", position.name, jumps, message))
        return t, velocity

    def _speed(self, body: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        velocity = self.get(f"velocity/{body}", max_gap_s)
        return None if velocity is None else (velocity.t, _norm(velocity.values))

    def _pair(self, subject: str) -> tuple[Body, Body] | None:
        robot, _, human = subject.partition("/")
        return (self.bodies[robot], self.bodies[human]) if {robot, human} <= self.bodies.keys() else None

    def _between(
        self, subject: str, max_gap_s: float, *quantities: str
    ) -> tuple[FloatArray, list[FloatArray]] | None:
        """Quantities of the robot and the human of a pair on one time base."""
        names = [f"{quantity}/{body}" for quantity in quantities for body in subject.split("/")]
        found = [self.get(name, max_gap_s) for name in names]
        present = [signal for signal in found if signal is not None]
        return align(present, max_gap_s=max_gap_s) if len(present) == len(names) else None

    def _centre_distance(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        both = self._between(subject, max_gap_s, "position")
        return both and (both[0], _norm(both[1][1] - both[1][0]))

    def _centre_distance_2d(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        both = self._between(subject, max_gap_s, "position")
        return both and (both[0], _norm((both[1][1] - both[1][0])[:, :2]))

    def _separation(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        pair = self._pair(subject)
        if pair is None:
            return None
        robot, human = pair
        tracks = [[self.signals.get(f"position/{p}") for p in _points(body)] for body in pair]
        present = [[s for s in track if s is not None] for track in tracks]
        if not all(present):
            return None
        t, values = align([*present[0], *present[1]], max_gap_s=max_gap_s)
        of_robot, of_human = values[: len(present[0])], values[len(present[0]) :]
        nearest = np.full(len(t), np.inf)
        for a in of_robot:
            for b in of_human:
                np.minimum(nearest, _norm(b - a), out=nearest)
        return t, np.maximum(nearest - robot.radius_m - human.radius_m, 0.0)

    def _approach_of_robot(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        return self._approach(subject, max_gap_s, of_human=False)

    def _approach_of_human(self, subject: str, max_gap_s: float) -> tuple[FloatArray, FloatArray] | None:
        return self._approach(subject, max_gap_s, of_human=True)

    def _approach(
        self, subject: str, max_gap_s: float, *, of_human: bool
    ) -> tuple[FloatArray, FloatArray] | None:
        """v . u for the robot and -(v . u) for the human, u the unit vector from robot to human."""
        both = self._between(subject, max_gap_s, "position", "velocity")
        if both is None:
            return None
        t, (p_robot, p_human, v_robot, v_human) = both
        apart = p_human - p_robot
        distance = _norm(apart)
        somewhere: BoolArray = distance > 0  # in one point there is no direction
        unit = apart[somewhere] / distance[somewhere][:, None]
        velocity = -v_human if of_human else v_robot
        return t[somewhere], _dot(velocity[somewhere], unit)


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
