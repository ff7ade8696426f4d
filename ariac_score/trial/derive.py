"""Signals from signals: speeds from positions, separation and approach from pairs of bodies.

The definitions are those of the monitor catalogue, section 1.1. What a log records
itself is never replaced by something derived.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from string import Formatter
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ariac_score.trial.computed import Computed
from ariac_score.trial.model import Body, LogDefect, Trial
from ariac_score.trial.signals import Signal, common_times, sealed
from ariac_score.trial.spans import BoolArray, FloatArray, Span, distinct, within_spans
from ariac_score.trial.vocabulary import ENVIRONMENT, QUANTITIES, Quantity, quantity_of

__all__ = [
    "SOURCES",
    "TELEPORT_SPEED_M_S",
    "Derivation",
    "DerivedSignal",
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


@dataclass(frozen=True)
class DerivedSignal:
    """How a quantity follows from others: entry-point group `ariac_score.derived_signals`.

    The entry point has the name of the quantity, which is one of the vocabulary.

    Attributes:
        needs: The signals it is computed from, by the name of the argument that takes their values, such as
            `{"here": "position/{body}"}`. `{body}` stands for the body of the quantity, `{first}` and
            `{second}` for those of its pair; a name without braces is taken as it is.
        compute: Takes `t`, the times that all of them have, shape (n,), s, and their values there, each of
            shape (n,) or (n, k); gives the values of the quantity, NaN where it has none. It is pure:
            the same numbers, the same answer.

    Raises:
        ValueError: A need is no name of a signal.

    >>> height = DerivedSignal({"p": "position/{body}"}, lambda t, p: p[:, 2])
    >>> height.quantities
    ('position',)
    """

    needs: Mapping[str, str]
    compute: Callable[..., FloatArray]

    def __post_init__(self) -> None:
        for name, template in self.needs.items():
            if not all(template.partition("/")) or self._fields(template) - {"body", "first", "second"}:
                raise ValueError(f"need {name!r} is {template!r}, not such as 'position/{{body}}'")

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities it is computed from."""
        return tuple(dict.fromkeys(quantity_of(template) for template in self.needs.values()))

    @property
    def placeholders(self) -> frozenset[str]:
        """What its needs name in braces."""
        return frozenset(field for template in self.needs.values() for field in self._fields(template))

    @staticmethod
    def _fields(template: str) -> set[str]:
        return {field for _, field, _, _ in Formatter().parse(template) if field is not None}


NOTHING_BROUGHT: Mapping[str, DerivedSignal] = MappingProxyType({})


def source_quantities(
    wanted: Iterable[str], brought: Mapping[str, DerivedSignal] = NOTHING_BROUGHT
) -> frozenset[str]:
    """The quantities a reader should decode so that the wanted ones can be had.

    Args:
        wanted: By name.
        brought: How plugins compute further quantities.
    """
    closure: set[str] = set()
    todo = list(wanted)
    while todo:
        quantity = todo.pop()
        if quantity not in closure:
            closure.add(quantity)
            todo += SOURCES.get(quantity, ())
            todo += brought[quantity].quantities if quantity in brought else ()
    return frozenset(closure)


@dataclass(frozen=True)
class Derivation:
    """What is to be derived, and across what.

    Attributes:
        quantity: Such as `centre_distance`.
        max_gap_s: Nothing is derived across gaps longer than this, s.
        pair: Of a quantity of pairs whose it is: kinds in braces or ids of bodies, such as
            `{vehicle}/{pedestrian}`. Empty: of every robot and human, some quantities of every two bodies.
    """

    quantity: str
    max_gap_s: float
    pair: str = ""


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
    velocity = _Velocity(t, positions_m, half_window_samples, half_window_s, teleport_speed_m_s, max_gap_s)
    return velocity.t, velocity.values(), velocity.jumps


class _Velocity:
    """The velocity of one point, computed on demand.

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
    ) -> None:
        self._all_t, self._positions_m = t, positions_m
        self._half_samples, self._half_s = half_window_samples, half_window_s
        steps_s = np.diff(t)
        jumps = np.flatnonzero(_norm(np.diff(positions_m, axis=0)) > teleport_speed_m_s * steps_s)
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
        velocities: FloatArray = way / (t[high] - t[low])[:, None]
        return velocities


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


def derive_signals(
    trial: Trial,
    wanted: Iterable[Derivation],
    *,
    speed_window_s: float = 0.0,
    brought: Mapping[str, DerivedSignal] = NOTHING_BROUGHT,
) -> Trial:
    """The trial with every wanted signal that can be derived from what it records.

    Args:
        trial: As read.
        wanted: What monitors need; a quantity wanted twice takes the shorter gap.
        speed_window_s: Half width of the centred difference, s; 0 means two samples.
        brought: How plugins compute further quantities; ours count where both know one.

    Returns:
        A new trial. A signal that cannot be derived is absent, which makes its monitor
        inconclusive; jumps that split a track are counted in its `log_defects`.
    """
    gaps: dict[str, float] = {}
    subjects: dict[str, dict[str, None]] = {}
    for item in wanted:
        gaps[item.quantity] = min(item.max_gap_s, gaps.get(item.quantity, np.inf))
        subjects.setdefault(item.quantity, {}).update(dict.fromkeys(_subjects(trial, item)))
    shortest: dict[str, float] = {}
    for quantity, gap_s in gaps.items():
        # A source derived across a longer gap than its target allows would fill the target's gaps.
        for source in source_quantities([quantity], brought):
            shortest[source] = min(gap_s, shortest.get(source, np.inf))
    together = {subject for those in subjects.values() for subject in those}
    deriver = _Deriver(trial, speed_window_s, shortest, brought, together)
    for quantity in sorted(gaps):
        for subject in subjects[quantity]:
            deriver.get(f"{quantity}/{subject}", gaps[quantity])
    defects = tuple(sorted({*trial.log_defects, *deriver.defects}))
    return replace(
        trial, signals={k: deriver.signals[k] for k in sorted(deriver.signals)}, log_defects=defects
    )


def _subjects(trial: Trial, wanted: Derivation) -> Iterator[str]:
    known = QUANTITIES.get(wanted.quantity)
    if known is None:
        return
    if known.of == ENVIRONMENT:
        yield ENVIRONMENT
    elif known.of == "pair":
        yield from (f"{first.id}/{second.id}" for first, second in _pairs(trial, wanted.pair, known))
    else:
        yield from sorted(body.id for body in trial.bodies)


def _pairs(trial: Trial, pair: str, quantity: Quantity) -> Iterator[tuple[Body, Body]]:
    """The bodies that a pair names by kind or id, each two of one kind once."""
    if not pair:
        yield from trial.body_pairs() if quantity.any_bodies else trial.pairs()
        return
    one, _, other = pair.partition("/")
    for first in _named(trial, one):
        for second in _named(trial, other):
            if first.id < second.id or (one != other and first != second):
                yield first, second


def _named(trial: Trial, name: str) -> tuple[Body, ...]:
    if name.startswith("{") and name.endswith("}"):
        return trial.bodies_of(name[1:-1])
    return tuple(body for body in trial.bodies if body.id == name)


class _Deriver:
    """Finds or derives one signal after the other; values of derived ones are computed on first access."""

    def __init__(
        self,
        trial: Trial,
        speed_window_s: float,
        shortest_gaps_s: Mapping[str, float],
        brought: Mapping[str, DerivedSignal],
        subjects: Iterable[str],
    ) -> None:
        self.bodies = {body.id: body for body in trial.bodies}
        self.signals: dict[str, Signal] = dict(trial.signals)
        self.as_consumed = trial.as_consumed
        self.speed_window_s = speed_window_s
        self.shortest_gaps_s = shortest_gaps_s
        self.brought = brought
        self._underway: set[str] = set()
        self.defects: set[LogDefect] = set()
        self._nearest_of: dict[tuple[str, float, int], tuple[_Nearest, int]] = {}
        self._closest_of: dict[tuple[str, float], _Closest | None] = {}
        self._partners: dict[str, list[str]] = {}
        for one, _, other in (subject.partition("/") for subject in sorted(subjects)):
            if other:
                self._partners.setdefault(one, []).append(other)

    def get(self, name: str, max_gap_s: float) -> Signal | None:
        """The recorded or derived signal; `None` when it cannot be had."""
        if name in self.signals:
            return self.signals[name]
        if name in self.as_consumed:  # recorded, so nothing replaces it
            return None
        quantity, _, subject = name.partition("/")
        # One signal serves all monitors, so the strictest of their gaps counts.
        max_gap_s = min(max_gap_s, self.shortest_gaps_s.get(quantity, max_gap_s))
        derive = {
            "velocity": self._velocity,
            "speed": self._speed,
            "centre_distance": self._centre_distance,
            "centre_distance_2d": self._centre_distance_2d,
            "separation": self._separation,
            "approach_speed_robot": self._approach_of_first,
            "approach_speed_human": self._approach_of_second,
            "relative_speed": self._relative_speed,
            "body_separation": self._separation,
            "tcp_speed": self._tcp_speed,
        }.get(quantity)
        made = derive(subject, max_gap_s) if derive else self._by_plugin(name, max_gap_s)
        if made is None or not len(made[0]):
            return None
        t, values = made
        # Kept under its name: velocities are the sources of speeds and approaches alike.
        sources = self._sources(name)
        self.signals[name] = Computed.of(name, QUANTITIES[quantity].unit, t, values, sources)
        return self.signals[name]

    def _sources(self, name: str) -> list[Signal]:
        """The recorded signals that a derived one follows from."""
        quantity, _, subject = name.partition("/")
        first, _, second = subject.partition("/")
        if quantity in self.brought:
            needs = self.brought[quantity].needs.values()
            names = [need.format(body=subject, first=first, second=second) for need in needs]
        else:
            points = [
                point
                for one in (first, second)
                for point in dict.fromkeys((one, *(_points(self.bodies[one]) if one in self.bodies else ())))
            ]
            names = [f"{of}/{point}" for of in SOURCES.get(quantity, ()) for point in points]
        return [self.signals[one] for one in names if one in self.signals]

    def _by_plugin(self, name: str, max_gap_s: float) -> _Made | None:
        """A signal as a plugin computes it, without the times at which it has no value."""
        quantity, _, subject = name.partition("/")
        if quantity not in self.brought or name in self._underway:  # two may each follow from the other
            return None
        derived = self.brought[quantity]
        first, _, second = subject.partition("/")
        self._underway.add(name)
        found = {
            argument: self.get(template.format(body=subject, first=first, second=second), max_gap_s)
            for argument, template in derived.needs.items()
        }
        self._underway.remove(name)
        signals = {argument: signal for argument, signal in found.items() if signal is not None}
        if len(signals) < len(found):
            return None
        t = common_times(list(signals.values()), max_gap_s=max_gap_s)
        values = derived.compute(t, **{argument: signal.at(t) for argument, signal in signals.items()})
        known = np.isfinite(values).reshape(len(t), -1).all(axis=1)
        return t[known], lambda: values[known]

    def _velocity(self, point: str, max_gap_s: float) -> _Made | None:
        position = self.signals.get(f"position/{point}")
        if position is None:
            return None
        velocity = _Velocity(
            position.t,
            position.values,
            HALF_WINDOW_SAMPLES,
            self.speed_window_s,
            TELEPORT_SPEED_M_S,
            max_gap_s if not position.constant else np.inf,
            position.holes,
        )
        if velocity.jumps:
            message = f"{point} jumped faster than {TELEPORT_SPEED_M_S:g} m/s; its track was split there"
            self.defects.add(LogDefect("teleport", position.name, velocity.jumps, message))
        return velocity.t, velocity.values

    def _speed(self, subject: str, max_gap_s: float) -> _Made | None:
        """Speed of the origin or, where links are followed, of the fastest of origin and links."""
        body = self.bodies.get(subject)
        points = [subject, *(f"{subject}::{link}" for link in body.links)] if body else [subject]
        velocities = [self.get(f"velocity/{point}", max_gap_s) for point in points]
        present = [signal for signal in velocities if signal is not None]
        # The origin may be missing (many logs follow links only), a link may not: it may be the fastest.
        origin = f"position/{subject}" in self.signals or f"position/{subject}" in self.as_consumed
        if len(present) < len(points) - (not origin) or not present:
            return None
        t = common_times(present, max_gap_s=max_gap_s)

        def fastest() -> FloatArray:
            speed = np.zeros(len(t))
            for velocity in present:  # one after the other: each is a vector, and there may be many
                np.maximum(speed, _norm(velocity.at(t)), out=speed)
            return speed

        return t, fastest

    def _tcp_speed(self, subject: str, max_gap_s: float) -> _Made | None:
        """Speed of the link that is the tool centre point, where one is followed."""
        links = self.bodies[subject].links if subject in self.bodies else ()
        tool = next((link for link in TOOL_LINKS if link in links), None)
        velocity = self.get(f"velocity/{subject}::{tool}", max_gap_s) if tool else None
        if velocity is None:
            return None
        return velocity.t, lambda: _norm(velocity.values)

    def _points_of(self, subject: str, max_gap_s: float, quantity: str) -> _Points | None:
        """A quantity of every point of a pair."""
        first, _, second = subject.partition("/")
        if not {first, second} <= self.bodies.keys():
            return None
        names = [[f"{quantity}/{point}" for point in _points(self.bodies[b])] for b in (first, second)]
        found = [self.get(name, max_gap_s) for name in (*names[0], *names[1])]
        present = [signal for signal in found if signal is not None]
        if len(present) < len(found):
            return None  # the missing one may be the nearest
        return _Points.of(present[: len(names[0])], present[len(names[0]) :], max_gap_s)

    def _nearest(self, subject: str, max_gap_s: float, components: int) -> tuple[_Nearest, int] | None:
        """The smallest distances of the first to each of the other's kind; which of them is the pair's."""
        key = subject, max_gap_s, components
        if key not in self._nearest_of:
            points = self._points_of(subject, max_gap_s, "position")
            if points is None:
                return None
            others = {subject: points.second} | self._seen_together(subject, points)
            nearest = _Nearest(points, list(others.values()), slice(components))
            for number, other in enumerate(others):
                self._nearest_of[other, max_gap_s, components] = nearest, number
        return self._nearest_of[key]

    def _seen_together(self, subject: str, points: _Points) -> dict[str, Sequence[Signal]]:
        """The tracks of the second's kind sampled at the times of a pair, to be measured in one pass."""
        first, _, second = subject.partition("/")
        found: dict[str, Sequence[Signal]] = {}
        for other in self._partners.get(first, ()) if points.together else ():
            body = self.bodies.get(other)
            if body is None or body.kind != self.bodies[second].kind:
                continue
            names = [f"position/{point}" for point in _points(body)]
            signals = [self.signals[name] for name in names if name in self.signals]
            if len(signals) == len(names) and all(np.array_equal(points.t, one.t) for one in signals):
                found[f"{first}/{other}"] = signals
        return found

    def _distance(self, subject: str, max_gap_s: float, components: int) -> _Made | None:
        nearest = self._nearest(subject, max_gap_s, components)
        if nearest is None:
            return None
        of_pair, number = nearest
        return of_pair.points.t, lambda: of_pair.distance_m(number)

    def _centre_distance(self, subject: str, max_gap_s: float) -> _Made | None:
        return self._distance(subject, max_gap_s, 3)

    def _centre_distance_2d(self, subject: str, max_gap_s: float) -> _Made | None:
        return self._distance(subject, max_gap_s, 2)

    def _separation(self, subject: str, max_gap_s: float) -> _Made | None:
        first, _, second = subject.partition("/")
        first_m, second_m = self.bodies[first].radius_m, self.bodies[second].radius_m
        # Without a radius the surface is not known, and the distance of centres is no bound for it.
        nearest = None if first_m is None or second_m is None else self._nearest(subject, max_gap_s, 3)
        if nearest is None or first_m is None or second_m is None:
            return None
        of_pair, number = nearest
        radii_m = first_m, second_m

        def separation() -> FloatArray:
            return np.maximum(of_pair.distance_m(number) - radii_m[0] - radii_m[1], 0.0)

        return of_pair.points.t, separation

    def _closest(self, subject: str, max_gap_s: float) -> _Closest | None:
        """How the nearest two points of a pair move."""
        key = subject, max_gap_s
        if key not in self._closest_of:
            positions = self._points_of(subject, max_gap_s, "position")
            velocities = self._points_of(subject, max_gap_s, "velocity")
            self._closest_of[key] = _Closest(positions, velocities) if positions and velocities else None
        return self._closest_of[key]

    def _approach_of_first(self, subject: str, max_gap_s: float) -> _Made | None:
        """v . u for the first of a pair, u the unit vector between the closest points."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else closest.towards("first_towards")

    def _approach_of_second(self, subject: str, max_gap_s: float) -> _Made | None:
        """-(v . u) for the second."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else closest.towards("second_towards")

    def _relative_speed(self, subject: str, max_gap_s: float) -> _Made | None:
        """Speed of the closest points against each other."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else (closest.t, lambda: closest.moves.relative)


_Made: TypeAlias = "tuple[FloatArray, Callable[[], FloatArray]]"
"""The times of a signal, and a function that computes its values."""


@dataclass(frozen=True, eq=False)
class _Points:
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
    def of(cls, first: Sequence[Signal], second: Sequence[Signal], max_gap_s: float) -> _Points:
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


class _Nearest:
    """The smallest distances between a body and each of some others."""

    def __init__(self, points: _Points, others: Sequence[Sequence[Signal]], components: slice) -> None:
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
class _Moves:
    """How the two nearest points move at each time.

    Speeds towards each other are still multiplied by the distance of the points: where that is 0
    there is no direction to divide by.
    """

    first_towards: FloatArray
    second_towards: FloatArray
    relative: FloatArray


class _Closest:
    """The two nearest points of two bodies, and how they move.

    Attributes:
        t: The times at which positions and velocities are known, shape (n,), s.
        distance_m: The distance of the two points, shape (n,).
    """

    def __init__(self, positions: _Points, velocities: _Points) -> None:
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

    def towards(self, whose: str) -> _Made:
        """The speed of one of them towards the other; left out where they coincide."""
        separate: BoolArray = self.distance_m > 0
        if separate.all():
            return self.t, lambda: getattr(self.moves, whose) / self.distance_m
        t = sealed(self.t[separate])
        return t, lambda: getattr(self.moves, whose)[separate] / self.distance_m[separate]

    @cached_property
    def moves(self) -> _Moves:
        """How the two points move."""
        t, positions, velocities = self.t, self._positions, self._velocities
        found = _Moves(*(np.zeros(len(t)) for _ in range(3)))
        # Values of a `Computed` vector are forgotten when nobody holds them; the second's serve every link.
        held = [one.values for one in velocities.second]
        for one in distinct(self._pair).tolist():
            i, j = divmod(one, len(positions.second))
            rows = np.flatnonzero(self._pair == one)
            v_first = velocities.at(velocities.first[i], t, rows)
            v_second = velocities.at(velocities.second[j], t, rows)
            between = positions.at(positions.second[j], t, rows) - positions.at(positions.first[i], t, rows)
            found.first_towards[rows] = _dot(v_first, between)
            found.second_towards[rows] = _dot(-v_second, between)
            found.relative[rows] = _norm(v_first - v_second)
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
