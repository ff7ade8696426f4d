"""Driverless trucks, after ISO 3691-4: speed for the clearance, stopping before a person."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ariac_score import Finding, SignalNeed, Trial, check_parameters, parameter
from ariac_score_standards.blame import (
    STANDSTILL_SPEED_M_S,
    Meeting,
    exposure,
)
from ariac_score_standards.geometry import check_polygon, depth_inside_m
from ariac_score_standards.parameters import (
    GAP,
    LENGTH,
    SPEED,
    TIME,
    TOLERANCE_S,
)
from ariac_score_standards.severity import (
    Bound,
    Details,
    Episode,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Rules,
    Statement,
    limit_findings,
    violations_only,
)
from ariac_score_standards.ssm_formula import approach_of
from ariac_score_standards.watching import (
    BoolArray,
    FloatArray,
    Subject,
    Watched,
    bodies_of,
    first_of_runs,
    pairs_of,
    state_over,
    watch_subjects,
)

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

    _clause = "derived from ISO 3691-4:2020, Annex A"

    def __post_init__(self) -> None:
        check_parameters(self)
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
    def _wanted(self) -> dict[str, str]:
        wanted = {"speed/{agv}": "m/s"}
        if self.obstacles:
            wanted["position/{agv}"] = "m"
        return wanted

    def needs(self) -> Iterator[SignalNeed]:
        """Speed, clearance or position, and the flag of the detection."""
        yield SignalNeed("speed", "m/s", self.max_gap_s)
        yield SignalNeed("clearance", "m", self.max_gap_s)
        yield SignalNeed("personnel_detection", "1", self.max_flag_age_s)
        if self.obstacles:
            yield SignalNeed("position", "m", self.max_gap_s)

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every AGV where it was too fast, or its closest moment."""
        return watch_subjects(
            trial,
            bodies_of(trial, "agv"),
            self._wanted,
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=lambda subject, watched: self._judge(trial, subject, watched),
            optional={"clearance/{agv}": "m"},
            kinds=("agv",),
        )

    def _clearance(self, trial: Trial, subject: Subject, watched: Watched) -> FloatArray | None:
        recorded = watched.get("clearance/{agv}")
        if recorded is not None:
            return recorded
        if self.obstacles:
            (radius,) = (body.radius_m for body in trial.bodies if body.id == subject.name)
            free = np.full(len(watched), np.inf)
            for obstacle in self.obstacles:
                np.minimum(free, -depth_inside_m(watched["position/{agv}"], obstacle), out=free)
            return np.maximum(free - radius, 0.0)
        if self.assumed_clearance_m is not None or self.confined:
            return np.full(len(watched), self.assumed_clearance_m or 0.0)
        return None

    def _judge(self, trial: Trial, subject: Subject, watched: Watched) -> Iterator[Statement]:
        clearance = self._clearance(trial, subject, watched)
        if clearance is None or not np.isfinite(clearance).all():
            message = "the clearance is not known: no signal, no obstacles, none assumed"
            yield Finding.inconclusive(subject.name, message, span=trial.window, clause=self._clause)
            return
        flag = state_over(
            trial, "personnel_detection", subject.name, watched.t, max_age_s=self.max_flag_age_s
        )
        # A flag that is recorded but not known here counts as muted: the slower limit is the safe reading.
        limit = self.allowed_speed_m_s(clearance, True if flag is None else flag.on)
        bound = Bound("speed", watched["speed/{agv}"], limit, "m/s", True, None, "allowed_speed")
        details = Details(labels={"personnel_detection": "assumed active" if flag is None else "recorded"})
        rules = Rules(self._clause, self.t_on_s, self.t_off_s)
        yield from limit_findings(JudgedLimit(subject.name, watched, bound), rules, lambda _episode: details)


# Stopping before a person ---------------------------------------------------------------------

_PLACES = {"position/{agv}": "m", "velocity/{agv}": "m/s", "position/{human}": "m"}
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

    _clause = "derived from ISO 3691-4, 4.8.2"

    def __post_init__(self) -> None:
        check_parameters(self)

    def stopping_distance_m(self, speed_m_s: FloatArray) -> FloatArray:
        """S_A of each speed, shape (n,), m."""
        braking = braking_distance_m(speed_m_s, self.deceleration_m_s2)
        return stopping_distance_m(speed_m_s, self.reaction_s, braking)

    def needs(self) -> Iterator[SignalNeed]:
        """Where both are, how the truck moves, and how far apart their surfaces are."""
        yield SignalNeed("position", "m", self.max_gap_s)
        yield SignalNeed("velocity", "m/s", self.max_gap_s)
        yield SignalNeed("body_separation", "m", self.max_gap_s, optional=True)

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every AGV and human where it did not brake, or its closest moment."""
        return watch_subjects(
            trial,
            pairs_of(trial, "agv"),
            _PLACES,
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=lambda subject, watched: self._judge(trial, subject, watched),
            optional={_APART: "m", "velocity/{human}": "m/s"},
            kinds=("agv", "human"),
        )

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

    @property
    def reach(self) -> Reach:
        """Braking is due some time after the person came into the way, from the speed then."""
        return Reach("run")

    def _way_left(self, watched: Watched, human_radius_m: float) -> Bound:
        """The way left to a person against what a stop takes."""
        velocity = watched["velocity/{agv}"]
        speed = _plane_speed(velocity)
        places = watched["position/{agv}"], watched["position/{human}"]
        way = self.way_left_m(places[0], velocity, places[1], human_radius_m)
        needed = self.stopping_distance_m(speed)
        entered = (way < needed) & (speed > self.standstill_speed_m_s)
        first = first_of_runs(watched.t, entered, self.max_gap_s)
        braking = speed < speed[first] - self.slowing_m_s
        # A person may step in too near for any truck: what counts is that it brakes after its reaction time.
        ignored = entered & (watched.t - watched.t[first] >= self.reaction_s - TOLERANCE_S) & ~braking
        shown = np.where(np.isfinite(way), way, needed)  # outside the corridor nothing is required
        in_corridor = np.isfinite(way) & (ignored | (way >= needed))
        return Bound("way left to a person", shown, needed, "m", False, in_corridor, "stopping_distance")

    def _touch(self, watched: Watched, apart_m: FloatArray) -> Bound:
        """The distance of surfaces while the truck moves."""
        contact_m = np.nextafter(0.0, 1.0)  # contact is at 0 too, so 0 itself must count as below it
        moving = _plane_speed(watched["velocity/{agv}"]) > self.standstill_speed_m_s
        limit, applies = np.full_like(apart_m, contact_m), np.isfinite(apart_m) & moving
        return Bound("distance of the moving truck", np.nan_to_num(apart_m), limit, "m", False, applies)

    def _judge(self, trial: Trial, subject: Subject, watched: Watched) -> Iterator[Statement]:
        radii = {body.id: body.radius_m for body in trial.bodies}
        human_radius = radii[subject.bodies["human"]]
        meeting = self._meeting(watched, human_radius + radii[subject.bodies["agv"]])

        def details(episode: Episode | None, *, contact: bool = False) -> Details:
            if episode is None:
                return Details({"speed_max_m_s": 0.0, **meeting.exposure})
            fastest_m_s = float(meeting.both.robot_speed_m_s[episode.rows].max())
            labels = meeting.both.labels(episode.rows, before=contact)
            return Details({"speed_max_m_s": fastest_m_s, **meeting.exposure}, labels)

        way_left = JudgedLimit(subject.name, watched, self._way_left(watched, human_radius))
        rules = Rules(self._clause, self.t_on_s, self.t_off_s, "nobody was in the way of the truck")
        moving = _plane_speed(watched["velocity/{agv}"]) > self.standstill_speed_m_s
        hidden = watched.hidden_findings(subject.name, _APART, moving, self._clause)
        of_way = limit_findings(way_left, rules, details)
        yield from violations_only(of_way) if hidden else of_way
        yield from hidden
        separation = watched.get(_APART)
        if separation is not None:
            touch = JudgedLimit(subject.name, watched, self._touch(watched, separation))
            rules = Rules(self._clause, 0.0, self.t_off_s, "the truck never moved", critical=True)
            yield from violations_only(
                limit_findings(touch, rules, lambda episode: details(episode, contact=True))
            )

    def _meeting(self, watched: Watched, radii_m: float) -> _Meeting:
        """Truck and person: both are one point, with their radii around it."""
        velocity, of_human = watched["velocity/{agv}"], watched.get("velocity/{human}")
        if of_human is None:
            of_human = np.full_like(velocity, np.nan)
        approach = approach_of(watched["position/{agv}"], watched["position/{human}"], velocity, of_human)
        speed, apart_m = _plane_speed(velocity), np.maximum(approach.distance_m - radii_m, 0.0)
        both = Meeting(speed, approach.robot_m_s, approach.human_m_s, self.standstill_speed_m_s)
        return _Meeting(both, exposure(watched, apart_m, speed, standstill_m_s=self.standstill_speed_m_s))


@dataclass(frozen=True, eq=False)
class _Meeting:
    """How truck and person move, and for how long the person was exposed."""

    both: Meeting
    exposure: Mapping[str, float]


def _plane_speed(velocity_m_s: FloatArray) -> FloatArray:
    speed: FloatArray = np.sqrt(velocity_m_s[:, 0] ** 2 + velocity_m_s[:, 1] ** 2)
    return speed
