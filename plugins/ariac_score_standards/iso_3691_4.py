"""Driverless trucks, after ISO 3691-4: speed for the clearance, stopping before a person."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from ariac_score import Finding, FloatArray, Measure, SignalNeed, parameter
from ariac_score.monitors import (
    STANDSTILL_SPEED_M_S,
    TOLERANCE_S,
    BoolArray,
    Bound,
    Episode,
    FindingRules,
    JudgedLimit,
    LimitMonitor,
    Meeting,
    Reach,
    Rows,
    Statement,
    UndecidedError,
    Watched,
    Worse,
    bodies,
    exposure,
    first_of_runs,
    pairs,
    rows_of_episodes,
    violations_only,
)
from ariac_score_standards.geometry import check_polygon, depth_inside_m
from ariac_score_standards.parameters import GAP, LENGTH, SPEED, TIME
from ariac_score_standards.ssm_formula import approach_of

# Formulas -------------------------------------------------------------------------------------


def braking_distance_m(speed_m_s: FloatArray, deceleration_m_s2: float) -> FloatArray:
    """s_brake = v^2 / 2a where the vehicle's own data are not known, m."""
    return speed_m_s * speed_m_s / (2.0 * deceleration_m_s2)


def stopping_distance_m(speed_m_s: FloatArray, reaction_s: float, braking_m: FloatArray) -> FloatArray:
    """S_A = v (t_sensor + t_control) + s_brake, m."""
    return speed_m_s * reaction_s + braking_m


def protective_field_m(stopping_m: FloatArray, *supplements_m: float) -> FloatArray:
    """PF = S_A + Z_meas + Z_refl + Z_ground + Z_extra, m."""
    field = stopping_m
    for supplement in supplements_m:
        field = field + supplement
    return field


# Speed and clearance --------------------------------------------------------------------------


_CLEARANCE, _DETECTION = "clearance/{agv}", "personnel_detection"


@dataclass(frozen=True)
class AgvSpeedClearance(LimitMonitor):
    """A truck is as slow as the space around it and its detection of persons ask for.

    Measures:
        For every AGV its speed against the largest one: rated speed with clearance all
        round and detection active, else the reduced one. Clearance is the signal
        `clearance`, else the distance to `obstacles` less the vehicle's radius, else
        `assumed_clearance_m`. Where the log has no flag `personnel_detection` it is
        taken for active, and the findings say so.
    Violated when:
        The speed exceeds the limit. Equality keeps it.
    Source:
        ISO 3691-4:2020, Annex A (Table A.1), from public extracts: 0.5 m, 0.3 m/s with
        detection muted. The number for less clearance is not public: 0.3 m/s is our choice.
    """

    rated_speed_m_s: float = parameter(1.5, source="data of the vehicle", **SPEED)
    reduced_speed_m_s: float = parameter(
        0.3, status="verified", source="extract of ISO 3691-4:2020, Table A.1", **SPEED
    )
    clearance_m: float = parameter(
        0.5, status="verified", source="extract of ISO 3691-4:2020, Table A.1", **LENGTH
    )
    confined: bool = parameter(
        False, status="verified", source="fenced and interlocked zone: rated speed; public deep dive"
    )
    obstacles: tuple[tuple[tuple[float, ...], ...], ...] = parameter(
        (), unit="m", source="fixed things, each by its corners [x, y]; set per cell"
    )
    assumed_clearance_m: float | None = parameter(
        None, unit="m", at_least=0, at_most=100, source="where neither log nor map tells"
    )
    max_flag_age_s: float = parameter(1.0, unit="s", above=0, at_most=60, source="how long a flag holds")
    max_gap_s: float = parameter(0.05, **GAP)
    t_on_s: float = parameter(0.03, source="catalogue, 1.2", **TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    subjects = bodies("agv")
    optional: ClassVar[Mapping[str, str]] = {_CLEARANCE: "m"}
    flags = (_DETECTION,)
    what, unit = "speed", "m/s"
    clause = "derived from ISO 3691-4:2020, Annex A"

    def __post_init__(self) -> None:
        super().__post_init__()
        for number, obstacle in enumerate(self.obstacles):
            if not obstacle:
                raise ValueError(f"obstacle {number} is not a polygon: it has no corners")
            check_polygon(f"obstacle {number}", obstacle)

    def allowed_speed_m_s(self, clearance_m: FloatArray, detection: BoolArray | bool = True) -> FloatArray:
        """Largest speed for a clearance and a state of the detection, shape (n,), m/s."""
        # Table A.1 asks for more than 0.5 m: at 0.5 m the speed is reduced.
        free = (np.asarray(clearance_m) > self.clearance_m) & np.asarray(detection, dtype=bool)
        return np.where(free | self.confined, self.rated_speed_m_s, self.reduced_speed_m_s)

    @property
    def wanted(self) -> dict[str, str]:
        """The speed, and where the truck is, where that tells how much space it has."""
        places = {"position/{agv}": "m"} if self.obstacles else {}
        return {"speed/{agv}": "m/s", **places}

    @property
    def worse(self) -> dict[str, Worse]:
        """Faster; how much space a place leaves, no bound of a speed tells."""
        return {} if self.obstacles else {"speed/{agv}": "high"}

    def needs(self) -> Iterator[SignalNeed]:
        """Speed, clearance or position, and the flag of the detection."""
        return (replace(need, optional=False) for need in super().needs())

    def _clearance(self, signals: Watched) -> FloatArray:
        recorded = signals.get(_CLEARANCE)
        if recorded is not None:
            return recorded
        if self.obstacles:
            free = np.full(len(signals), np.inf)
            for obstacle in self.obstacles:
                np.minimum(free, -depth_inside_m(signals["position/{agv}"], obstacle), out=free)
            return np.maximum(free - signals.radius_m("agv"), 0.0)
        known = self.assumed_clearance_m is not None or self.confined
        return np.full(len(signals), (self.assumed_clearance_m or 0.0) if known else np.nan)

    def margin(self, signals: Watched) -> Bound:
        """Allowed speed - speed, m/s."""
        clearance = self._clearance(signals)
        known = np.isfinite(clearance)
        if not known.any():
            raise UndecidedError("the clearance is not known: no signal, no obstacles, none assumed")
        flag = signals.state(_DETECTION, self.max_flag_age_s)
        # A flag that is recorded but not known here counts as muted: the slower limit is the safe reading.
        limit = self.allowed_speed_m_s(clearance, True if flag is None else flag.on)
        return self.at_most(signals["speed/{agv}"], limit, where=known, named="allowed_speed")

    def about(self, signals: Watched) -> Iterator[Statement]:
        """Each time it was too fast, and where the clearance lacks."""
        hidden = signals.hidden_findings(_CLEARANCE, np.ones(len(signals), dtype=bool), self.clause)
        found = super().about(signals)
        yield from violations_only(found) if hidden else found
        yield from hidden

    def labels(self, limit: JudgedLimit, _episode: Episode | None) -> dict[str, str]:
        """Whether the state of the detection is recorded."""
        flag = limit.watched.state(_DETECTION, self.max_flag_age_s)
        return {_DETECTION: "assumed active" if flag is None else "recorded"}


# Stopping before a person ---------------------------------------------------------------------

_APART = "body_separation/{agv}/{human}"


@dataclass(frozen=True)
class AgvProtectiveField(LimitMonitor):
    """A truck brakes for a person in its way, and touches nobody while it moves.

    Measures:
        For every AGV and human in its swept corridor (width, and a margin on both
        sides): the way left to the person against the stopping distance S_A, from
        the reaction time on while the truck has not begun to brake; and, where surface
        distances are known, contact. Violations say whether the truck moved
        (`robot_moving`) and who closed in; every finding for how long the person was
        exposed to it.
    Violated when:
        The way left is below S_A and the truck has not slowed down; or the truck
        touches the person while it moves, which is a critical event.
    Source:
        ISO 3691-4, 4.8.2: the truck stops before it touches a stationary person;
        S_A = v (t_sensor + t_control) + v^2 / 2a. The reaction time is that of a
        public example (Banner AG4 guide); a, corridor and slowing are our choice.
    """

    reaction_s: float = parameter(
        0.26, status="verified", source="t_sensor + t_control; Banner AG4 guide, example 6", **TIME
    )
    deceleration_m_s2: float = parameter(
        2.0, unit="m/s2", above=0, at_most=100, source="or data of the vehicle"
    )
    width_m: float = parameter(0.8, source="data of the vehicle", **LENGTH)
    length_m: float = parameter(1.2, source="data of the vehicle; the origin is its middle", **LENGTH)
    margin_m: float = parameter(0.1, source="on both sides of the corridor", **LENGTH)
    slowing_m_s: float = parameter(0.02, source="less than at entry by this has begun to brake", **SPEED)
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7; ARIAC 2023", **SPEED)
    max_gap_s: float = parameter(0.05, **GAP)
    t_on_s: float = parameter(0.0, source="catalogue, 1.2", **TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    subjects = pairs("agv", "human")
    may_be_critical: ClassVar[bool] = True
    wanted: ClassVar[Mapping[str, str]] = {
        "position/{agv}": "m",
        "velocity/{agv}": "m/s",
        "position/{human}": "m",
    }
    optional: ClassVar[Mapping[str, str]] = {_APART: "m", "velocity/{human}": "m/s"}
    what, unit = "way left to a person", "m"
    clause = "derived from ISO 3691-4, 4.8.2"
    idle = "nobody was in the way of the truck"
    reach = Reach("run")  # braking is due some time after the person came into the way, from the speed then
    severities: ClassVar[Mapping[str, Measure]] = {
        "speed_max_m_s": Measure("m/s", best=0.0, meaning="largest speed of the truck in a violation"),
        "exposure_s": Measure("s", meaning="how long the person was near the moving truck"),
    }

    def limits(self, signals: Watched) -> int:
        """That it brakes, and where the log has their distance, or may have, that it touches nobody."""
        return 1 + (_APART in signals.optional or not len(signals))

    def stopping_distance_m(self, speed_m_s: FloatArray) -> FloatArray:
        """S_A of each speed, shape (n,), m."""
        braking = braking_distance_m(speed_m_s, self.deceleration_m_s2)
        return stopping_distance_m(speed_m_s, self.reaction_s, braking)

    def way_left_m(
        self, agv_m: FloatArray, velocity_m_s: FloatArray, human_m: FloatArray, human_radius_m: float
    ) -> FloatArray:
        """Way from the truck's front to a person in its corridor, shape (n,), m; infinite outside of it."""
        speed = np.sqrt(velocity_m_s[:, 0] ** 2 + velocity_m_s[:, 1] ** 2)
        # A truck at rest has no corridor: where it would go next is not in the log.
        moving = speed > 0
        u = np.zeros((len(speed), 2))
        np.divide(velocity_m_s[:, :2], speed[:, None], out=u, where=moving[:, None])
        to_human = human_m[:, :2] - agv_m[:, :2]
        ahead = to_human[:, 0] * u[:, 0] + to_human[:, 1] * u[:, 1]
        aside = np.abs(to_human[:, 1] * u[:, 0] - to_human[:, 0] * u[:, 1])
        swept = moving & (ahead > 0) & (aside <= self.width_m / 2 + self.margin_m + human_radius_m)
        return np.where(swept, np.maximum(ahead - self.length_m / 2 - human_radius_m, 0.0), np.inf)

    def margin(self, signals: Watched) -> Bound:
        """Way left to a person - what a stop takes, m."""
        way, needed, entry = self._ways(signals)
        # A person may step in too near for any truck: what counts is that it brakes after its reaction time.
        ignored = entry.is_late & ~entry.brakes
        shown = np.where(np.isfinite(way), way, needed)  # outside the corridor nothing is required
        in_corridor = np.isfinite(way) & (ignored | (way >= needed))
        return self.at_least(shown, needed, where=in_corridor, named="stopping_distance")

    def _ways(self, signals: Watched) -> tuple[FloatArray, FloatArray, _Entry]:
        """The way left, and that a stop takes, m, and what the truck does since a person is too near."""
        velocity = signals["velocity/{agv}"]
        speed = _plane_speed(velocity)
        places = signals["position/{agv}"], signals["position/{human}"]
        way = self.way_left_m(places[0], velocity, places[1], signals.radius_m("human"))
        needed = self.stopping_distance_m(speed)
        entered = (way < needed) & (speed > self.standstill_speed_m_s)
        first = first_of_runs(signals.t, entered, signals.max_gap_s)
        is_late = entered & (signals.t - signals.t[first] >= self.reaction_s - TOLERANCE_S)
        return way, needed, _Entry(first, is_late, speed < speed[first] - self.slowing_m_s)

    def _unknown_entries(self, signals: Watched) -> list[Finding]:
        """Where it would have to brake by now, and how fast it was when somebody came in a gap hides."""
        _, _, entry = self._ways(signals)
        unknown = entry.is_late & entry.brakes & ~signals.shown_before[entry.first]
        message = "nothing shows how fast the truck was when somebody came into its way"
        return [
            Finding.inconclusive(signals.subject.name, message, span=span, clause=self.clause)
            for span, _ in rows_of_episodes(signals, unknown, t_off_s=0.0)
        ]

    def _touch(self, apart_m: FloatArray, moving: BoolArray) -> Bound:
        """The distance of surfaces while the truck moves."""
        contact_m = np.nextafter(0.0, 1.0)  # contact is at 0 too, so 0 itself must count as below it
        where = np.isfinite(apart_m) & moving
        return self.at_least(
            np.nan_to_num(apart_m), contact_m, where=where, what="distance of the moving truck"
        )

    def about(self, signals: Watched) -> Iterator[Statement]:
        """Where it did not brake, or its closest moment; and where it touched the person."""
        meeting, exposed = self._meeting(signals)

        def adds(*, contact: bool) -> Any:
            def severity(_limit: JudgedLimit, episode: Episode | None) -> dict[str, float]:
                rows = None if episode is None else episode.rows
                fastest_m_s = 0.0 if rows is None else float(meeting.robot_speed_m_s[rows].max())
                return {"speed_max_m_s": fastest_m_s, **exposed}

            def labels(_limit: JudgedLimit, episode: Episode | None) -> dict[str, str]:
                return {} if episode is None else meeting.labels(episode.rows, before=contact)

            return {"severity": severity, "labels": labels}

        moving = meeting.robot_speed_m_s > self.standstill_speed_m_s
        hidden = signals.hidden_findings(_APART, moving, self.clause) + self._unknown_entries(signals)
        of_way = self.findings(signals, self.margin(signals), **adds(contact=False))
        yield from violations_only(of_way) if hidden else of_way
        yield from hidden
        separation = signals.get(_APART)
        if separation is not None:
            rules = FindingRules(self.clause, 0.0, self.t_off_s, "the truck never moved", critical=True)
            touch = self._touch(separation, moving)
            yield from violations_only(self.findings(signals, touch, rules=rules, **adds(contact=True)))

    def _meeting(self, signals: Watched) -> tuple[Meeting, Mapping[str, float]]:
        """Truck and person, each a point with its radius around it; and how long the person was exposed."""
        velocity, of_human = signals["velocity/{agv}"], signals.get("velocity/{human}")
        if of_human is None:
            of_human = np.full_like(velocity, np.nan)
        approach = approach_of(signals["position/{agv}"], signals["position/{human}"], velocity, of_human)
        radii_m = signals.radius_m("human") + signals.radius_m("agv")
        speed, apart_m = _plane_speed(velocity), np.maximum(approach.distance_m - radii_m, 0.0)
        both = Meeting(speed, approach.robot_m_s, approach.human_m_s, self.standstill_speed_m_s)
        return both, exposure(signals, apart_m, speed, standstill_m_s=self.standstill_speed_m_s)


@dataclass(frozen=True, eq=False)
class _Entry:
    """What a truck does since a person came into its way, sample by sample, each shape (n,).

    Attributes:
        first: The sample at which the person came; itself where nobody is.
        is_late: Whether the reaction time is over since.
        brakes: Whether it is slower than then.
    """

    first: Rows
    is_late: BoolArray
    brakes: BoolArray


def _plane_speed(velocity_m_s: FloatArray) -> FloatArray:
    speed: FloatArray = np.sqrt(velocity_m_s[:, 0] ** 2 + velocity_m_s[:, 1] ** 2)
    return speed
