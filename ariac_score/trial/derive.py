"""Signals from signals: speeds from positions, separation and approach from pairs of bodies.

The definitions are those of the monitor catalogue, section 1.1. What a log records itself is never replaced
by something derived; that is kept beside it, as what else shows the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from string import Formatter
from types import MappingProxyType

import numpy as np

from ariac_score.trial.computed import Computed
from ariac_score.trial.model import Body, LogDefect, Trial
from ariac_score.trial.nearest import Closest, Made, Nearest, Points
from ariac_score.trial.signals import Signal, common_times
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vectors import lengths
from ariac_score.trial.velocities import HALF_WINDOW_SAMPLES, TELEPORT_SPEED_M_S, Velocity
from ariac_score.trial.vocabulary import DISTANCES, ENVIRONMENT, QUANTITIES, SPEEDS, Quantity, quantity_of

__all__ = [
    "SOURCES",
    "Derivation",
    "DerivedSignal",
    "derive_signals",
    "source_quantities",
]


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


def derive_signals(
    trial: Trial,
    wanted: Iterable[Derivation],
    *,
    speed_window_s: float = 0.0,
    brought: Mapping[str, DerivedSignal] = NOTHING_BROUGHT,
) -> Trial:
    """The trial with every wanted signal that can be derived from what it records.

    Args:
        trial: As read. What it assumes of the time between samples bounds speeds that late stamps make
            too high.
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
    recorded = {
        name: gaps[quantity]
        for quantity in sorted(gaps.keys() & {*DISTANCES, *SPEEDS})
        for subject in subjects[quantity]
        if (name := f"{quantity}/{subject}") in trial.signals
    }
    others = {name: signal for name, signal in trial.signals.items() if name not in recorded}
    again = _Deriver(replace(trial, signals=others), speed_window_s, shortest, brought, together)
    twins = {name: again.get(name, gap_s) for name, gap_s in recorded.items()}
    return replace(
        trial,
        signals={k: deriver.signals[k] for k in sorted(deriver.signals)},
        twins={name: twin for name, twin in twins.items() if twin is not None},
        log_defects=defects,
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
        self.between = trial.between
        self.speed_window_s = speed_window_s
        self.shortest_gaps_s = shortest_gaps_s
        self.brought = brought
        self._underway: set[str] = set()
        self.defects: set[LogDefect] = set()
        self._nearest_of: dict[tuple[str, float, int], tuple[Nearest, int]] = {}
        self._closest_of: dict[tuple[str, float], Closest | None] = {}
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
        if made is None:
            return None
        t, values = made
        # Kept under its name: velocities are the sources of speeds and approaches alike.
        sources = self._sources(name)
        if not len(t) and not self._is_bounded(quantity, sources):
            return None
        self.signals[name] = Computed.of(name, QUANTITIES[quantity].unit, t, values, sources)
        return self.signals[name]

    def _is_bounded(self, quantity: str, sources: Sequence[Signal]) -> bool:
        """Whether a quantity that no sample shows lies between bounds all the same, by what it follows from.

        Samples too far apart for a speed, or never close enough to those of another body for a distance,
        still say where the bodies can be.
        """
        recorded = [one for one in sources if not isinstance(one, Computed)]
        return self.between is not None and quantity in SOURCES and bool(recorded) and all(map(len, recorded))

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

    def _by_plugin(self, name: str, max_gap_s: float) -> Made | None:
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

    def _velocity(self, point: str, max_gap_s: float) -> Made | None:
        position = self.signals.get(f"position/{point}")
        if position is None:
            return None
        velocity = Velocity(
            position.t,
            position.values,
            HALF_WINDOW_SAMPLES,
            self.speed_window_s,
            TELEPORT_SPEED_M_S,
            max_gap_s if not position.constant else np.inf,
            position.holes,
            fastest_m_s=self._fastest_m_s(point),
            time_error_s=self._time_error_s(position),
        )
        if velocity.jumps:
            message = f"{point} jumped faster than {TELEPORT_SPEED_M_S:g} m/s; its track was split there"
            self.defects.add(LogDefect("teleport", position.name, velocity.jumps, message))
        return velocity.t, velocity.values

    def _fastest_m_s(self, point: str) -> float:
        """How fast a body or one of its links can be; infinite where nobody says."""
        body = self.bodies.get(point.partition("::")[0])
        bound = None if self.between is None or body is None else self.between.of(body.kind)
        return np.inf if bound is None else bound.max_speed_m_s

    def _time_error_s(self, position: Signal) -> float:
        """How far its stamps may lie from the times they are for, as far as bounds are assumed at all."""
        return 0.0 if self.between is None else max(self.between.time_error_s, position.stamp_jitter_s)

    def _speed(self, subject: str, max_gap_s: float) -> Made | None:
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
                np.maximum(speed, lengths(velocity.at(t)), out=speed)
            return speed

        return t, fastest

    def _tcp_speed(self, subject: str, max_gap_s: float) -> Made | None:
        """Speed of the link that is the tool centre point, where one is followed."""
        links = self.bodies[subject].links if subject in self.bodies else ()
        tool = next((link for link in TOOL_LINKS if link in links), None)
        velocity = self.get(f"velocity/{subject}::{tool}", max_gap_s) if tool else None
        if velocity is None:
            return None
        return velocity.t, lambda: lengths(velocity.values)

    def _points_of(self, subject: str, max_gap_s: float, quantity: str) -> Points | None:
        """A quantity of every point of a pair."""
        first, _, second = subject.partition("/")
        if not {first, second} <= self.bodies.keys():
            return None
        names = [[f"{quantity}/{point}" for point in _points(self.bodies[b])] for b in (first, second)]
        found = [self.get(name, max_gap_s) for name in (*names[0], *names[1])]
        present = [signal for signal in found if signal is not None]
        if len(present) < len(found):
            return None  # the missing one may be the nearest
        return Points.of(present[: len(names[0])], present[len(names[0]) :], max_gap_s)

    def _nearest(self, subject: str, max_gap_s: float, components: int) -> tuple[Nearest, int] | None:
        """The smallest distances of the first to each of the other's kind; which of them is the pair's."""
        key = subject, max_gap_s, components
        if key not in self._nearest_of:
            points = self._points_of(subject, max_gap_s, "position")
            if points is None:
                return None
            others = {subject: points.second} | self._seen_together(subject, points)
            nearest = Nearest(points, list(others.values()), slice(components))
            for number, other in enumerate(others):
                self._nearest_of[other, max_gap_s, components] = nearest, number
        return self._nearest_of[key]

    def _seen_together(self, subject: str, points: Points) -> dict[str, Sequence[Signal]]:
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

    def _distance(self, subject: str, max_gap_s: float, components: int) -> Made | None:
        nearest = self._nearest(subject, max_gap_s, components)
        if nearest is None:
            return None
        of_pair, number = nearest
        return of_pair.points.t, lambda: of_pair.distance_m(number)

    def _centre_distance(self, subject: str, max_gap_s: float) -> Made | None:
        return self._distance(subject, max_gap_s, 3)

    def _centre_distance_2d(self, subject: str, max_gap_s: float) -> Made | None:
        return self._distance(subject, max_gap_s, 2)

    def _separation(self, subject: str, max_gap_s: float) -> Made | None:
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

    def _closest(self, subject: str, max_gap_s: float) -> Closest | None:
        """How the nearest two points of a pair move."""
        key = subject, max_gap_s
        if key not in self._closest_of:
            positions = self._points_of(subject, max_gap_s, "position")
            velocities = self._points_of(subject, max_gap_s, "velocity")
            self._closest_of[key] = Closest(positions, velocities) if positions and velocities else None
        return self._closest_of[key]

    def _approach_of_first(self, subject: str, max_gap_s: float) -> Made | None:
        """v . u for the first of a pair, u the unit vector between the closest points."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else closest.towards("first_towards")

    def _approach_of_second(self, subject: str, max_gap_s: float) -> Made | None:
        """-(v . u) for the second."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else closest.towards("second_towards")

    def _relative_speed(self, subject: str, max_gap_s: float) -> Made | None:
        """Speed of the closest points against each other."""
        closest = self._closest(subject, max_gap_s)
        return None if closest is None else (closest.t, lambda: closest.moves.relative)


def _points(body: Body) -> list[str]:
    """The tracks that stand for a body: its links, or its origin where it has none."""
    return [f"{body.id}::{link}" for link in body.links] or [body.id]
