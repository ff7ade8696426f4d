"""Safety rules that ARIAC itself has: collisions cost the whole score."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import floor, inf, sqrt
from typing import ClassVar, Literal

import numpy as np

from ariac_score import (
    Arrivals,
    Body,
    Event,
    Finding,
    InstantVerdict,
    Measure,
    OnlineWatch,
    Sample,
    Signal,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    Worlds,
    check_parameters,
    exact_sum,
    parameter,
)
from ariac_score.monitors import (
    ENVIRONMENT,
    OFF,
    ON,
    SPEED,
    STANDSTILL_SPEED_M_S,
    TOWARDS_HUMAN,
    BoolArray,
    Bound,
    Encounter,
    Episode,
    JudgedLimit,
    MarginMonitor,
    Rows,
    Signals,
    Statement,
    Watched,
    Worse,
    first_of_runs,
    pairs,
    rows_of_episodes,
    watched_signals,
    worlds_between,
)


@dataclass(frozen=True)
class HumanContact(MarginMonitor):
    """No robot touches a human.

    Measures:
        For every robot and human the distance less `contact_distance_m`, in m. With
        `separation` (surface to surface) contact is 0 m; where a log has only the
        distance between centres, the two bodies' extent must be allowed for. Where the
        log has the robot's speed the findings say for how long the human was exposed
        (`exposure_s`), and contacts whether the robot moved (`robot_moving`).
    Violated when:
        The distance is at or below `contact_distance_m`. Every such episode is a
        critical event. With `robot_must_move` a touch counts only from the first moment at which the robot
        moved, at that sample or the one before, until they part: a human who walks into a robot at rest
        is none of its doing. What does not show whether it moved, shows that it did.
    Source:
        ARIAC 2020-2022, documented scoring: a collision with a human zeroes the
        trial; the simulator never checked it. The distance that stands for contact
        between centres is our choice.
    Attributes:
        distance: Which distance is compared.
        contact_distance_m: At this distance they touch.
        max_gap_s: Longest time between two samples that shows nothing was missed.
        t_off_s: A pause that is not longer ends no contact.
        robot_must_move: Whether a robot at rest touches nobody; `towards_human`: nor one that moves in any
            other direction.
    """

    distance: Literal["centre_distance", "centre_distance_2d", "separation"] = parameter(
        "separation", source="what a log has; surface to surface is the one that needs no allowance"
    )
    contact_distance_m: float = parameter(
        0.0, unit="m", at_least=0, at_most=100, source="0 between surfaces; between centres set per log"
    )
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="catalogue, 1.4")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=60, source="catalogue, 1.2")
    robot_must_move: Literal["no", "yes", "towards_human"] = parameter(
        "no", source="the rules of ARIAC do not ask who walked into whom; ISO/TS 15066 asks of motion"
    )

    subjects = pairs("robot", "human")
    unit, critical, graded = "m", True, False
    clause = "ARIAC 2022 scoring, robot-human collision"

    @property
    def what(self) -> str:
        """The distance it measures."""
        return self.distance.replace("_", " ")

    @property
    def _template(self) -> str:
        return f"{self.distance}/{{robot}}/{{human}}"

    @property
    def wanted(self) -> dict[str, str]:
        """The distance between the two."""
        return {self._template: "m"}

    @property
    def worse(self) -> dict[str, Worse]:
        """Nearer."""
        return {self._template: "low"}

    @property
    def encounter(self) -> Encounter:
        """Exposure and whether the robot moved; who closed in, the rules of ARIAC do not ask."""
        closing = ("closing_by",) if self.robot_must_move == "towards_human" else ()
        return Encounter(self._template, tells=("robot_moving", *closing))

    @property
    def charges_rest(self) -> bool:
        """Whether a robot that stands still can violate anything."""
        return self.robot_must_move == "no"

    @property
    def in_gaps(self) -> Literal["tight", "outer"]:
        """Where motion is asked for, it need not have its worst together with the distance."""
        return "tight" if self.robot_must_move == "no" else "outer"

    def about(self, signals: Watched) -> Iterator[Statement]:
        """The touches, but for those that a robot at rest has no part in."""
        bound = self.bound(signals)
        spared = bound.broken & ~self._at_fault(signals, bound.broken)
        return self.findings(signals, replace(bound, applies=~spared) if spared.any() else bound)

    def _at_fault(self, signals: Watched, touching: BoolArray) -> BoolArray:
        """Where the robot moved since they touch, shape (n,)."""
        if self.robot_must_move == "no":
            return np.ones(len(signals), dtype=bool)
        of = SPEED if self.robot_must_move == "yes" else TOWARDS_HUMAN
        moved = ~(signals.known(of) <= STANDSTILL_SPEED_M_S)  # NaN: nobody knows
        # It may stop at the very touch, between two samples; over a gap nobody knows.
        moved[1:] |= moved[:-1].copy() | (np.diff(signals.t) > self.max_gap_s)
        row = np.arange(len(moved))
        latest = np.maximum.accumulate(np.where(moved, row, -1))
        since: BoolArray = latest >= first_of_runs(signals.t, touching, self.max_gap_s)
        return since

    def margin(self, signals: Signals) -> Bound:
        """Distance - the distance that is contact, m; at that distance they touch."""
        return self.at_least(signals[self._template], self.contact_distance_m, strict=True)

    def instant(self, bound: Bound) -> str:
        """How far apart they are."""
        return f"contact: {bound.actual:.3f} m" if bound.broken else f"{bound.actual:.3f} m apart"

    def message(self, limit: JudgedLimit, row: int, episode: Episode | None) -> str:
        """How near they came, and when."""
        distance_m, at_s = limit.bound.actual[row], limit.watched.t[row]
        if episode is None:
            spared = limit.bound.applies is not None
            rest = "; a human touched it while it stood still, which is not charged" if spared else ""
            return f"never nearer than {distance_m:.3f} m, at {at_s:.3f} s{rest}"
        return f"contact: {distance_m:.3f} m at {at_s:.3f} s"


_KINDS = {
    "agv_collision",
    "arm_collision",
    "cell_in_conveyor_bin",
    "cell_in_inspection_bin",
    "human_collision",
    "object_on_invalid_surface",
    "obstacle_collision",
    "part_dropped",
    "robot_collision",
    "self_collision",
}
"""What ARIAC's rules ask for. Rules of other competitions about events of their own are not its clauses."""


@dataclass(frozen=True)
class NoEvent:
    """Something that a log would have recorded did not happen.

    Measures:
        The events of one kind, such as `arm_collision` or `part_dropped`, from start to end of the
        competition; what happens before or after it is nobody's mistake.
    Violated when:
        The log holds such an event; each is one violation. A log that would not have
        recorded the kind is inconclusive, not clean.
    Source:
        ARIAC 2019-2022, scoring: arm collisions zero the trial; 2021-2022: every
        dropped product costs a point.
    Attributes:
        kind: What must not happen.
    """

    kind: str = parameter("arm_collision", source="which events; ARIAC 2019-2022")
    critical: bool = parameter(False, source="whether each is a critical event")

    in_gaps: ClassVar[str] = "unsampled"
    when_cut: ClassVar[str] = "adds"
    measures: ClassVar[Mapping[str, Measure]] = {}  # it counts, and measures nothing

    def needs(self) -> Iterator[SignalNeed]:
        """No signal: events come with every log."""
        return iter(())

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding for each event, or one that there was none."""
        name = self.kind.replace("_", " ")
        clause = "ARIAC scoring" if self.kind in _KINDS else ""
        window = trial.window
        events = [
            event
            for event in trial.events_of(self.kind)
            if window is None or window.start_s <= event.t_s <= window.end_s
        ]
        for event in events:
            yield Finding(
                event.subject or "trial",
                Verdict.VIOLATED,
                f"{name} at {event.t_s:.3f} s{': ' if event.detail else ''}{event.detail}",
                span=Span(event.t_s, event.t_s),
                critical=self.critical,
                clause=clause,
            )
        if not events and self.kind in trial.witnessed:
            yield Finding.satisfied("trial", f"the log records no {name}", clause=clause)
        elif not events:
            yield Finding.inconclusive(
                "trial", f"the log does not show whether there was any {name}", clause=clause
            )

    def begin(self, _bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that says so when there is such an event, and nothing before."""
        return _EventsOnline(self)


class _EventsOnline:
    """One trial, watched for events of a kind."""

    def __init__(self, monitor: NoEvent) -> None:
        self._monitor, self._arrivals = monitor, Arrivals()
        self._last_s: dict[str, float] = {}

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterator[InstantVerdict]:
        """Say that there was such an event; several of one time are one thing to say."""
        self._arrivals.take(samples)
        for event in events:
            subject = event.subject or "trial"
            # An instant has one verdict for each subject.
            if event.kind == self._monitor.kind and event.t_s > self._last_s.get(subject, -inf):
                self._last_s[subject] = event.t_s
                words = f"{event.kind.replace('_', ' ')} at {event.t_s:.3f} s"
                yield InstantVerdict(subject, event.t_s, Verdict.VIOLATED, words)

    def end(self, trial: Trial) -> Iterator[Finding]:
        """What is found in the trial, whose events are all there."""
        return self._monitor.watch(self._arrivals.complete(trial))


# Collisions that cost per occurrence -----------------------------------------------------------

_COLLISION_CLAUSE = "ARIAC 2025 rules, collisions"
_SHOWING_TOUCH = ("in_contact", "contact_force", "body_separation")
"""What shows whether two bodies touch, the most telling first."""
_OF_COLLISION = {
    "occurrences": Measure("count", best=0.0, meaning="how often it counts"),
    "length_s": Measure("s", best=0.0, meaning="from the first touch to the last"),
    "time_in_violation_s": Measure("s", best=0.0, meaning="how long they touched"),
    "relative_speed_m_s": Measure("m/s", best=0.0, meaning="speed against each other when they met"),
    "force_max_N": Measure("N", best=0.0, meaning="largest force"),
    "impulse_N_s": Measure("N s", best=0.0, meaning="force, summed over time"),
}
"""What may be measured of a collision; all 0 where there is none."""
_ROUNDING = 1e-9


def occurrences(
    duration_s: float, *, every_s: float = 5.0, closed_right: bool = True, weight: int = 1
) -> int:
    """How often a collision of some length counts: once, and again after every 5 s.

    Args:
        duration_s: Its length, s.
        every_s: Time after which it counts again, s.
        closed_right: Whether exactly 5 s count twice; the rules do not say.
        weight: Each counts so often; 2 for two robots.

    >>> [occurrences(d) for d in (0.5, 4.9, 5.0, 12.3, 25.0)]
    [1, 1, 2, 3, 6]
    """
    # A duration is a difference of stamps. So 5 s may come out as 4.9999999999 s, which may decide nothing.
    times = duration_s / every_s
    again = floor(times + _ROUNDING) if closed_right else max(-floor(-(times - _ROUNDING)) - 1, 0)
    return weight * (1 + again)


@dataclass(frozen=True, eq=False)
class _Touching:
    """Where two bodies touch, and how hard.

    Attributes:
        watched: What shows where they touch.
        touches: Where they do, shape (n,).
        force: The force, where it is known; in N.
    """

    watched: Watched
    touches: BoolArray
    force: Signal | None

    def hardness(self, rows: Rows) -> dict[str, float]:
        """For how long they touched in the rows of a collision, and how hard."""
        weights_s = self.watched.durations_s[rows]
        found = {"time_in_violation_s": exact_sum(weights_s)}
        if self.force is not None:
            force_n = self.force.at(self.watched.t[rows])
            found |= {"force_max_N": float(force_n.max()), "impulse_N_s": exact_sum(force_n * weights_s)}
        return found


@dataclass(frozen=True)
class CollisionEpisodes:
    """Machines do not collide: with each other, with themselves, or with what stands around.

    Measures:
        For every two machines (and every machine and the environment, where the log has
        anything about it or `between` asks for it) the contacts:
        from `in_contact`, else `contact_force` above `contact_on_n`, else the distance
        of surfaces, else events `in_contact` with details `on` and `off`. Touches less
        than `t_off_s` apart are one collision. Each counts once, and again for every
        `every_s` it lasts; of two robots `robot_robot_weight` times.
    Violated when:
        There is a collision; `occurrences` says how often it counts.
    Source:
        ARIAC 2025 rules: every 5 s another occurrence, two robots count double, two
        AGVs are an entry of their own. That exactly 5 s count twice is our reading
        (`closed_right`). ARIAC 2020-2022: any collision zeroes the trial (`critical`).
    """

    between: Literal["any", "robot_robot", "robot_agv", "agv_agv", "robot_environment", "agv_environment"] = (
        parameter("any", source="which entry of the rules")
    )
    every_s: float = parameter(
        5.0, unit="s", above=0, at_most=600, status="verified", source="ARIAC 2025 rules"
    )
    closed_right: bool = parameter(True, source="whether exactly every_s counts twice; rules are silent")
    robot_robot_weight: int = parameter(
        2, unit="1", at_least=1, at_most=100, status="verified", source="ARIAC 2025 rules"
    )
    contact_on_n: float = parameter(5.0, unit="N", at_least=0, at_most=1e4, source="catalogue, M4")
    critical: bool = parameter(False, status="verified", source="ARIAC 2020-2022: zeroes the trial")
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="catalogue, 1.4")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=60, source="catalogue, 1.2")

    in_gaps: ClassVar[str] = "blunt"
    when_cut: ClassVar[str] = "adds"
    measures: ClassVar[Mapping[str, Measure]] = _OF_COLLISION

    def __post_init__(self) -> None:
        check_parameters(self)

    def needs(self) -> Iterator[SignalNeed]:
        """Whatever shows contacts; which of them a log has is found out in `watch`."""
        units = {"in_contact": "1", "contact_force": "N", "body_separation": "m", "velocity": "m/s"}
        for quantity, unit in units.items():
            yield SignalNeed(quantity, unit, self.max_gap_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """For every two bodies each collision, or that there was none."""
        pairs = list(self._pairs(trial))
        if not pairs:
            yield self._nobody(trial)
        for first, second in pairs:
            yield from self._judge(trial, first, second)

    def watch_worlds(self, trial: Trial) -> Iterator[Finding | Worlds]:
        """The same, and what may have been where nothing shows whether two bodies touched."""
        pairs = list(self._pairs(trial))
        if not pairs:
            yield self._nobody(trial)
        for first, second in pairs:
            touching = self._touching(trial, first, second)
            lacking = self._lacking(trial, first, second)
            names = () if touching is None or lacking else touching.watched.columns
            yield from worlds_between(
                trial,
                f"{first.id}/{second.id}",
                {name: trial.signals[name] for name in names},
                list(self._judge(trial, first, second)),
                max_gap_s=self.max_gap_s,
                measures=self.measures,
                t_off_s=self.t_off_s,
                clause=_COLLISION_CLAUSE,
                critical=self.critical,
            )

    def _pairs(self, trial: Trial) -> Iterator[tuple[Body, Body]]:
        surroundings = Body(ENVIRONMENT, ENVIRONMENT)
        machines = [*trial.bodies_of("robot"), *trial.bodies_of("agv")]
        # A log map that names the environment has it among its bodies, too.
        others = [pair for pair in trial.body_pairs() if not (_around(pair) and {*pair} & {*machines})]
        for first, second in [*others, *((machine, surroundings) for machine in machines)]:
            kinds = f"{first.kind}_{second.kind}"
            recorded = second.kind != ENVIRONMENT or self._recorded(trial, first, second)
            wanted = kinds == self.between or (self.between == "any" and recorded)
            # Contact with people is `ariac.human_contact`, which has other consequences.
            if wanted and second.kind != "human":
                yield first, second

    def _recorded(self, trial: Trial, first: Body, second: Body) -> bool:
        """Whether the log has anything about two bodies; with the environment not every log has."""
        return self._touching(trial, first, second) is not None or bool(
            self._from_events(trial, first, second) or self._lacking(trial, first, second)
        )

    def _lacking(self, trial: Trial, first: Body, second: Body) -> str:
        """The signal that would show whether two bodies touched, is published, and is not in the log."""
        for quantity in _SHOWING_TOUCH:
            for name in (f"{quantity}/{first.id}/{second.id}", f"{quantity}/{second.id}/{first.id}"):
                if trial.find_signal(name) is not None:
                    return ""
                if name in trial.stand_ins:
                    return name
        return ""

    def _nobody(self, trial: Trial) -> Finding:
        message = "the log shows no two bodies that could collide"
        if "bodies" in trial.witnessed:
            return Finding.not_applicable("trial", message, clause=_COLLISION_CLAUSE)
        return Finding.inconclusive("trial", message, span=trial.window, clause=_COLLISION_CLAUSE)

    def _touching(self, trial: Trial, first: Body, second: Body) -> _Touching | None:
        # A report of contact before a force, and a force before a distance. Either body may be named first.
        for a, b in ((first.id, second.id), (second.id, first.id)):
            flag = trial.find_signal(f"in_contact/{a}/{b}")
            force = trial.find_signal(f"contact_force/{a}/{b}")
            if flag is not None:
                known = force if force is not None and len(force) else None
                watched = self._watched(trial, flag)
                return _Touching(watched, watched.columns[flag.name] >= 0.5, known)
            if force is not None:
                watched = self._watched(trial, force)
                return _Touching(watched, watched.columns[force.name] > self.contact_on_n, force)
        for a, b in ((first.id, second.id), (second.id, first.id)):
            separation = trial.find_signal(f"body_separation/{a}/{b}")
            if separation is not None:
                watched = self._watched(trial, separation)
                return _Touching(watched, watched.columns[separation.name] <= 0, None)
        return None

    def _watched(self, trial: Trial, signal: Signal) -> Watched:
        return watched_signals([signal], self.max_gap_s, trial)

    def _from_events(self, trial: Trial, first: Body, second: Body) -> list[Span]:
        """Contacts between `on` and `off` events; one that never ends lasts as long as the log."""
        names = {f"{first.id}/{second.id}", f"{second.id}/{first.id}"}
        spans, began = [], None
        for event in (e for e in trial.events_of("in_contact") if e.subject in names):
            if event.detail == ON and began is None:
                began = event.t_s
            elif event.detail == OFF and began is not None:
                spans.append(Span(began, event.t_s))
                began = None
        if began is not None:  # still in contact when the recording ended
            spans.append(Span(began, max(began, trial.window.end_s if trial.window else began)))
        return spans

    def _judge(self, trial: Trial, first: Body, second: Body) -> Iterator[Finding]:
        subject = f"{first.id}/{second.id}"
        if lacking := self._lacking(trial, first, second):
            message = f"signal {lacking!r} is published, and is not in the log"
            yield Finding.inconclusive(subject, message, span=trial.window, clause=_COLLISION_CLAUSE)
            return
        touching = self._touching(trial, first, second)
        collisions: list[tuple[Span, Mapping[str, float]]]
        if touching is not None:
            found = rows_of_episodes(touching.watched, touching.touches, t_off_s=self.t_off_s)
            collisions = [(span, touching.hardness(rows)) for span, rows in found]
        else:
            spans = _merged(self._from_events(trial, first, second), self.t_off_s)
            collisions = [(span, {}) for span in spans]
        # No event in a log that would have recorded one means that they never touched.
        if touching is None and not collisions and "in_contact" not in trial.witnessed:
            message = "the log does not show whether they touched"
            yield Finding.inconclusive(subject, message, span=trial.window, clause=_COLLISION_CLAUSE)
            return
        gaps = [] if touching is None else touching.watched.gaps
        for gap in gaps:
            message = f"no samples for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
            yield Finding.inconclusive(subject, message, span=gap, clause=_COLLISION_CLAUSE)
        both = first.kind == second.kind == "robot"
        for span, hardness in collisions:
            # The database of 2025 has a row for each of the two robots.
            weight = self.robot_robot_weight if both else 1
            speed = self._speed_against(trial, first, second, span.start_s)
            yield self._collision(subject, span, weight, speed, hardness)
        if not collisions and not gaps:
            yield Finding(
                subject,
                Verdict.SATISFIED,
                "they never touched",
                quantities=dict.fromkeys(_OF_COLLISION, 0.0),
                clause=_COLLISION_CLAUSE,
            )

    def _speed_against(self, trial: Trial, first: Body, second: Body, t_s: float) -> float | None:
        """Speed of the two against each other when they met; what stands around does not move."""
        at, relative = np.array([t_s]), np.zeros(3)
        for body, sign in ((first, 1.0), (second, -1.0)):
            velocity = trial.find_signal(f"velocity/{body.id}")
            if body.kind == ENVIRONMENT:
                continue
            if velocity is None or not velocity.covers(at, max_gap_s=self.max_gap_s)[0]:
                return None
            relative = relative + sign * velocity.at(at)[0]
        x, y, z = relative.tolist()
        return sqrt(x * x + y * y + z * z)

    def _collision(
        self,
        subject: str,
        span: Span,
        weight: int,
        speed_m_s: float | None,
        hardness: Mapping[str, float],
    ) -> Finding:
        times = occurrences(
            span.duration_s, every_s=self.every_s, closed_right=self.closed_right, weight=weight
        )
        quantities = {"occurrences": float(times), "length_s": span.duration_s}
        if speed_m_s is not None:
            quantities["relative_speed_m_s"] = speed_m_s
        return Finding(
            subject,
            Verdict.VIOLATED,
            f"collision of {span.duration_s:.2f} s, which counts {times} time{'s' if times > 1 else ''}",
            span=span,
            quantities={**quantities, **hardness},
            clause=_COLLISION_CLAUSE,
            critical=self.critical,
            units={"occurrences": "count"},
        )


def _around(pair: tuple[Body, Body]) -> bool:
    return any(body.id == ENVIRONMENT for body in pair)


def _merged(spans: list[Span], t_off_s: float) -> list[Span]:
    merged: list[Span] = []
    for span in spans:
        if merged and span.start_s - merged[-1].end_s < t_off_s - _ROUNDING:
            merged[-1] = Span(merged[-1].start_s, span.end_s)
        else:
            merged.append(span)
    return merged
