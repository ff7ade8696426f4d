"""Speed and separation monitoring, after ISO/TS 15066:2016, 5.5.4 (ISO 10218-2:2025, Annex L)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ariac_score import (
    Body,
    Course,
    Finding,
    OnlineWatch,
    SignalNeed,
    Span,
    Standing,
    Total,
    Trial,
    Verdict,
    check_parameters,
    parameter,
)
from ariac_score_standards.online import Judge, PairsOnline
from ariac_score_standards.severity import (
    EXPOSURE_DISTANCE_M,
    STANDSTILL_SPEED_M_S,
    TOWARDS_HUMAN,
    TOWARDS_ROBOT,
    Blame,
    Bound,
    Constant,
    Gathered,
    Judged,
    Judging,
    Meeting,
    Moment,
    Rules,
    Said,
    Sampled,
    Seen,
    Several,
    Told,
    Violation,
    broken,
    closing_energy_j,
    exposure_of,
    findings_of,
    kept,
    no_severities,
    travelled_m,
)
from ariac_score_standards.watching import (
    BoolArray,
    FloatArray,
    Watched,
    Watching,
    pairs_of,
    seen,
    watch_pairs,
)

_CLAUSE = "derived from ISO/TS 15066:2016, 5.5.4"

PROFILES: Mapping[str, Mapping[str, float]] = {
    "seed": {"t1_s": 1.0, "t2_s": 1.5, "stopping_distance_m": 0.0, "delta_m": 2.6},
    "ariac2023": {"t1_s": 1.0, "t2_s": 1.5, "stopping_distance_m": 0.0, "delta_m": 1.0},
    "ariac2023_agent": {
        "t1_s": 1.0,
        "t2_s": 1.5,
        "stopping_distance_m": 0.0,
        "delta_m": 1.2,
        "cap_m": 5.0,
    },
    "standard": {"t1_s": 0.1, "t2_s": 0.3, "stopping_distance_m": 0.0, "t_on_s": 0.03},
}
"""seed: Ferrando et al., the values used with their robot. ariac2023: the penalty formula of that release;
ariac2023_agent: what tells its simulated human that it sees the gantry. standard: our defaults."""

STANDARD_MARGINS_M: Mapping[str, float] = {
    "intrusion_m": 0.20,
    "human_uncertainty_m": 0.10,
    "robot_uncertainty_m": 0.05,
}
"""C, Z_d and Z_r where nothing else is given (catalogue, M1; our choice)."""

WALKING_SPEED_M_S = 1.6
"""Speed of a human that is not measured (ISO 13855, as quoted in public sources)."""
NEAR_SPEED_M_S = 2.0
"""The same within `NEAR_DISTANCE_M`, in a reading that brings in ISO 13855 (a paper of SciTePress, 2020)."""
NEAR_DISTANCE_M = 0.5

_DISTANCES = {
    "seed": "centre_distance",
    "ariac2023": "centre_distance_2d",
    "ariac2023_agent": "centre_distance_2d",
    "standard": "separation",
}

_PER_PROFILE = "None takes the profile's value"


# Formulas -------------------------------------------------------------------------------------


def path_m(t_s: FloatArray, speed_m_s: FloatArray) -> float:
    """Way covered at a speed that is a straight line between samples: the integrals S_h, S_r, S_s, m.

    >>> path_m(np.array([0.0, 0.6]), np.array([0.5, 1.5]))
    0.6
    """
    return travelled_m(t_s, speed_m_s, Span(float(t_s[0]), float(t_s[-1])))


@dataclass(frozen=True)
class Approach:
    """Two points moving, at every sample (catalogue, 1.1).

    Attributes:
        distance_m: Between the points, shape (n,), m.
        robot_m_s: Speed of the robot towards the human, v_r . u, m/s.
        human_m_s: Speed of the human towards the robot, -(v_h . u), m/s.
    """

    distance_m: FloatArray
    robot_m_s: FloatArray
    human_m_s: FloatArray

    @property
    def distance_rate_m_s(self) -> FloatArray:
        """How the distance changes, -(v_r_dir + v_h_dir), m/s."""
        return -(self.robot_m_s + self.human_m_s)


def approach_of(
    robot_m: FloatArray, human_m: FloatArray, robot_m_s: FloatArray, human_m_s: FloatArray
) -> Approach:
    """Distance and directed speeds of two points from positions and velocities, each of shape (n, 3)."""
    apart = human_m - robot_m
    distance = np.sqrt(_dot(apart, apart))
    u = np.divide(apart, distance[:, None], out=np.zeros_like(apart), where=distance[:, None] > 0)
    return Approach(distance, _dot(robot_m_s, u), -_dot(human_m_s, u))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    total: FloatArray = a[:, 0] * b[:, 0]
    for column in range(1, a.shape[1]):
        total = total + a[:, column] * b[:, column]
    return total


# Parameters and formulas that the three monitors share ----------------------------------------

_TIME: Any = {"unit": "s", "at_least": 0, "at_most": 60}
_LENGTH: Any = {"unit": "m", "at_least": 0, "at_most": 100}
_SPEED: Any = {"unit": "m/s", "at_least": 0, "at_most": 20}
_OF_PROFILE = "seed: Ferrando et al.; ariac2023: that release; standard: set per system; " + _PER_PROFILE


@dataclass(frozen=True)
class SsmFormula:
    """S_p = S_h + S_r + S_s + C + Z_d + Z_r, and its inverse; the parameters of every SSM monitor."""

    profile: Literal["seed", "ariac2023", "ariac2023_agent", "standard"] = parameter(
        "seed", source="which formula and which defaults; seed: Ferrando et al."
    )
    t1_s: float | None = parameter(None, status="our choice", source=f"T_r; {_OF_PROFILE}", **_TIME)
    t2_s: float | None = parameter(None, status="our choice", source=f"T_s; {_OF_PROFILE}", **_TIME)
    stopping_distance_m: float | None = parameter(
        None, status="our choice", source=f"B, S_s of stop model `fixed`; {_OF_PROFILE}", **_LENGTH
    )
    delta_m: float | None = parameter(
        None, status="our choice", source=f"C + Z_d + Z_r in one; {_OF_PROFILE}", **_LENGTH
    )
    distance: Literal["profile", "centre_distance", "centre_distance_2d", "separation"] = parameter(
        "profile", source="seed and ariac2023 as published; standard: surface to surface"
    )
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="catalogue, 1.4")
    t_on_s: float | None = parameter(None, source="0 s; standard: 0.03 s (catalogue, 1.2)", **_TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **_TIME)
    stop_model: Literal["profile", "fixed", "linear", "deceleration", "constant_speed"] = parameter(
        "profile",
        status="verified",
        source="linear: v_r T_s / 2; deceleration: v_r^2 / 2a; constant_speed, from memory: v_r T_s",
    )
    deceleration_m_s2: float = parameter(
        2.0, unit="m/s2", above=0, at_most=100, source="with stop model `deceleration`; set per system"
    )
    intrusion_m: float | None = parameter(None, source=f"C: 0.20; {_PER_PROFILE}", **_LENGTH)
    human_uncertainty_m: float | None = parameter(None, source=f"Z_d: 0.10; {_PER_PROFILE}", **_LENGTH)
    robot_uncertainty_m: float | None = parameter(None, source=f"Z_r: 0.05; {_PER_PROFILE}", **_LENGTH)
    speeds: Literal["profile", "scalar", "directed"] = parameter(
        "profile", source="standard: directed, never below 0; the others: scalar, as published"
    )
    human_speed: Literal["profile", "measured", "fixed", "by_distance"] = parameter(
        "profile", source="standard: fixed; the others: measured; by_distance: fixed, faster when near"
    )
    human_speed_m_s: float = parameter(
        WALKING_SPEED_M_S,
        status="verified",
        source="of a human who is not measured: ISO 13855 as public sources quote it",
        **_SPEED,
    )
    near_human_speed_m_s: float = parameter(
        NEAR_SPEED_M_S,
        status="verified",
        source="with human_speed `by_distance`, within near_distance_m: a reading that brings in ISO 13855",
        **_SPEED,
    )
    near_distance_m: float = parameter(
        NEAR_DISTANCE_M,
        status="verified",
        source="up to this the near speed counts: a reading that brings in ISO 13855",
        **_LENGTH,
    )
    cap_m: float | None = parameter(
        None,
        unit="m",
        above=0,
        status="verified",
        source="ariac2023_agent: 5.0 (ariac2023 branch); otherwise none",
    )
    robot_must_move: Literal["profile", "yes", "no"] = parameter(
        "profile", source="standard: a robot at rest violates nothing; the others ask for no motion"
    )
    standstill_speed_m_s: float = parameter(
        STANDSTILL_SPEED_M_S, source="catalogue, M7; ARIAC 2023 uses it for AGVs", **_SPEED
    )
    exposure_distance_m: float = parameter(EXPOSURE_DISTANCE_M, source="catalogue, 1.3", **_LENGTH)
    blame: Literal["profile", "yes", "no"] = parameter(
        "profile",
        source="whether exposure and who closed in are told; ssm_separation with profile seed: no",
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        parts = ("intrusion_m", "human_uncertainty_m", "robot_uncertainty_m")
        given = [name for name in parts if getattr(self, name) is not None]
        if given and self.delta_m is not None:
            raise ValueError(f"delta_m is the sum of C, Z_d and Z_r: give it or {given[0]}, not both")
        if self.stopping_distance_m is not None and self._stop_model != "fixed":
            raise ValueError(
                f"stopping_distance_m belongs to stop_model 'fixed', but the model is {self._stop_model!r}"
            )

    def _value(self, name: str) -> float:
        given: float | None = getattr(self, name)
        return PROFILES[self.profile].get(name, 0.0) if given is None else given

    @property
    def _standard(self) -> bool:
        return self.profile == "standard"

    @property
    def _stop_model(self) -> str:
        if self.stop_model != "profile":
            return self.stop_model
        return "linear" if self._standard and self.stopping_distance_m is None else "fixed"

    @property
    def _directed(self) -> bool:
        return self._standard if self.speeds == "profile" else self.speeds == "directed"

    @property
    def _measured_human(self) -> bool:
        return not self._standard if self.human_speed == "profile" else self.human_speed == "measured"

    @property
    def _must_move(self) -> bool:
        return self._standard if self.robot_must_move == "profile" else self.robot_must_move == "yes"

    @property
    def _blames(self) -> bool:
        return self.blame != "no"

    @property
    def _distance(self) -> str:
        return _DISTANCES[self.profile] if self.distance == "profile" else self.distance

    @property
    def _cap_m(self) -> float | None:
        return PROFILES[self.profile].get("cap_m") if self.cap_m is None else self.cap_m

    def resolved(self) -> dict[str, object]:
        """What the profile decides, and which of the values that exclude each other count."""
        used: dict[str, object] = {name: self._value(name) for name in ("t1_s", "t_on_s")}
        if self._stop_model != "deceleration":
            used["t2_s"] = self._value("t2_s")
        if self._stop_model == "fixed":
            used["stopping_distance_m"] = self._value("stopping_distance_m")
        used |= {"delta_m": self.allowance_m} if self._allowance_in_one else self._allowance_parts
        used |= {
            "distance": self._distance,
            "stop_model": self._stop_model,
            "speeds": "directed" if self._directed else "scalar",
            "robot_must_move": "yes" if self._must_move else "no",
            "blame": "yes" if self._blames else "no",
        }
        if self.human_speed == "profile":
            used["human_speed"] = "measured" if self._measured_human else "fixed"
        if self._cap_m is not None:
            used["cap_m"] = self._cap_m
        return used

    @property
    def _allowance_in_one(self) -> bool:
        """Whether C + Z_d + Z_r is one number, delta."""
        parts = [getattr(self, name) for name in STANDARD_MARGINS_M]
        return self.delta_m is not None or (not self._standard and all(part is None for part in parts))

    @property
    def _allowance_parts(self) -> dict[str, float]:
        default = STANDARD_MARGINS_M if self._standard else {}
        parts = {name: getattr(self, name) for name in STANDARD_MARGINS_M}
        return {name: default.get(name, 0.0) if part is None else part for name, part in parts.items()}

    @property
    def allowance_m(self) -> float:
        """C + Z_d + Z_r, m."""
        if self._allowance_in_one:
            return self._value("delta_m")
        c, z_d, z_r = self._allowance_parts.values()
        return float(c + z_d + z_r)

    def assumed_human_speed_m_s(self, distance_m: FloatArray) -> FloatArray:
        """Speed of a human who is not measured, at each distance, shape (n,), m/s."""
        if self.human_speed != "by_distance":
            return np.full_like(distance_m, self.human_speed_m_s)
        near = distance_m <= self.near_distance_m
        return np.where(near, self.near_human_speed_m_s, self.human_speed_m_s)

    def stopping_time_s(self, robot_speed_m_s: FloatArray) -> FloatArray:
        """T_s for each robot speed, shape (n,), s."""
        if self._stop_model == "deceleration":
            return robot_speed_m_s / self.deceleration_m_s2
        return np.full_like(robot_speed_m_s, self._value("t2_s"))

    def human_path_m(self, human_speed_m_s: FloatArray, robot_speed_m_s: FloatArray) -> FloatArray:
        """S_h: the human walks on while the robot reacts and while it stops, m."""
        if self._stop_model == "deceleration":
            return human_speed_m_s * (self._value("t1_s") + self.stopping_time_s(robot_speed_m_s))
        return human_speed_m_s * (self._value("t1_s") + self._value("t2_s"))

    def reaction_path_m(self, robot_speed_m_s: FloatArray) -> FloatArray:
        """S_r: what the robot covers while it reacts, m."""
        return robot_speed_m_s * self._value("t1_s")

    def stopping_path_m(self, robot_speed_m_s: FloatArray) -> FloatArray:
        """S_s (B in the seed's notation): what the robot covers while it stops, m."""
        model, t2_s = self._stop_model, self._value("t2_s")
        if model == "linear":
            return robot_speed_m_s * t2_s / 2.0
        if model == "deceleration":
            return robot_speed_m_s * robot_speed_m_s / (2.0 * self.deceleration_m_s2)
        if model == "constant_speed":
            return robot_speed_m_s * t2_s
        return np.full_like(robot_speed_m_s, self._value("stopping_distance_m"))

    def d_min_m(self, human_speed_m_s: FloatArray, robot_speed_m_s: FloatArray) -> FloatArray:
        """Required distance for each pair of speeds, shape (n,), m.

        The order of operations is the paper's: h * (t1 + t2) + r * t1 + B + delta.
        """
        robot_speed_m_s = np.asarray(robot_speed_m_s, dtype=np.float64)
        human_path_m = self.human_path_m(human_speed_m_s, robot_speed_m_s)
        robot_path_m = self.reaction_path_m(robot_speed_m_s)
        required_m = human_path_m + robot_path_m + self.stopping_path_m(robot_speed_m_s) + self.allowance_m
        return required_m if self._cap_m is None else np.minimum(required_m, self._cap_m)

    def required_m_of(self) -> Callable[[float, float], float]:
        """`d_min_m` for one pair of speeds, of human and robot, with the same order of operations."""
        t1_s, t2_s, allowance_m = self._value("t1_s"), self._value("t2_s"), self.allowance_m
        both_s, model, a = t1_s + t2_s, self._stop_model, self.deceleration_m_s2
        fixed_m = self._value("stopping_distance_m")
        cap_m = math.inf if self._cap_m is None else self._cap_m

        def required_m(human_m_s: float, robot_m_s: float) -> float:
            reaction_m = robot_m_s * t1_s
            if model == "fixed":
                total_m = human_m_s * both_s + reaction_m + fixed_m + allowance_m
            elif model == "deceleration":
                human_m = human_m_s * (t1_s + robot_m_s / a)
                total_m = human_m + reaction_m + robot_m_s * robot_m_s / (2.0 * a) + allowance_m
            else:
                stopping_m = robot_m_s * t2_s / 2.0 if model == "linear" else robot_m_s * t2_s
                total_m = human_m_s * both_s + reaction_m + stopping_m + allowance_m
            return min(total_m, cap_m)

        return required_m

    def speed_cap_m_s(self, distance_m: FloatArray, human_speed_m_s: FloatArray) -> FloatArray:
        """Largest speed at which a distance is enough, shape (n,), m/s.

        It is 0 exactly wherever the distance is at most what a robot at rest needs,
        and infinite where the cap on the required distance is kept.
        """
        distance_m = np.asarray(distance_m, dtype=np.float64)
        human_speed_m_s = np.broadcast_to(np.asarray(human_speed_m_s, dtype=np.float64), distance_m.shape)
        t1_s, t2_s, model = self._value("t1_s"), self._value("t2_s"), self._stop_model
        if model == "deceleration":
            cap = self._decelerating_cap(distance_m - self.allowance_m, human_speed_m_s)
        else:
            fixed_m = self._value("stopping_distance_m") if model == "fixed" else 0.0
            left_m = distance_m - self.allowance_m - fixed_m - human_speed_m_s * (t1_s + t2_s)
            slope_s = {"fixed": t1_s, "linear": t1_s + t2_s / 2.0, "constant_speed": t1_s + t2_s}[model]
            cap = left_m / slope_s if slope_s > 0 else np.full_like(left_m, np.inf)
        at_rest_m = self.d_min_m(human_speed_m_s, np.zeros_like(distance_m))
        if model == "fixed" and t1_s == 0:  # speed costs nothing: any will do where rest does
            cap = np.where(distance_m < at_rest_m, 0.0, np.inf)
        else:
            cap = np.where(distance_m <= at_rest_m, 0.0, np.maximum(cap, 0.0))
        if self._cap_m is not None:
            cap = np.where(distance_m >= self._cap_m, np.inf, cap)
        return cap

    def _decelerating_cap(self, free_m: FloatArray, human_speed_m_s: FloatArray) -> FloatArray:
        """Positive root of v^2 / 2a + v (T_r + v_h / a) + v_h T_r - free = 0, without cancellation."""
        a, t1_s = self.deceleration_m_s2, self._value("t1_s")
        b = a * t1_s + human_speed_m_s
        left = 2.0 * a * (free_m - human_speed_m_s * t1_s)
        root = np.sqrt(np.maximum(b * b + left, 0.0)) + b
        return np.divide(left, root, out=np.zeros_like(root), where=(left > 0) & (root > 0))

    # What the monitors read ---------------------------------------------------------------

    def needs(self) -> Iterator[SignalNeed]:
        """The distance and the speeds the formula speaks of."""
        yield SignalNeed(self._distance, "m", self.max_gap_s)
        yield SignalNeed("speed", "m/s", self.max_gap_s)
        wanted, told = self._wanted, self._optional
        for template in (TOWARDS_HUMAN, TOWARDS_ROBOT):
            if template in wanted or template in told:
                quantity = template.partition("/")[0]
                yield SignalNeed(quantity, "m/s", self.max_gap_s, optional=template not in wanted)

    @property
    def _wanted(self) -> dict[str, str]:
        wanted = {f"{self._distance}/{{robot}}/{{human}}": "m"}
        if self._measured_human:
            wanted[TOWARDS_ROBOT if self._directed else "speed/{human}"] = "m/s"
        wanted["speed/{robot}"] = "m/s"
        if self._directed:
            wanted[TOWARDS_HUMAN] = "m/s"
        return wanted

    @property
    def _optional(self) -> dict[str, str]:
        """What tells who closes in, where the formula itself does not ask for it."""
        if not self._blames:
            return {}
        wanted = self._wanted
        return {name: "m/s" for name in (TOWARDS_HUMAN, TOWARDS_ROBOT) if name not in wanted}

    def _moments(self, watched: Watched) -> _Moments:
        distance_m = watched[f"{self._distance}/{{robot}}/{{human}}"]
        scalar = watched["speed/{robot}"]
        robot = np.maximum(watched[TOWARDS_HUMAN], 0.0) if self._directed else scalar
        if not self._measured_human:
            human = self.assumed_human_speed_m_s(distance_m)
        elif self._directed:
            human = np.maximum(watched[TOWARDS_ROBOT], 0.0)
        else:
            human = watched["speed/{human}"]
        return _Moments(distance_m, human, robot, scalar, self.d_min_m(human, robot))

    def _moment(self) -> Callable[[tuple[float, ...]], tuple[float, float, float, float]]:
        """Distance, speed of human and robot, scalar speed of the robot, of values as `_wanted` has them."""
        at = {template: i for i, template in enumerate(self._wanted)}
        robot = at[TOWARDS_HUMAN if self._directed else "speed/{robot}"]
        scalar, directed, fixed_m_s = at["speed/{robot}"], self._directed, self.human_speed_m_s
        human = at.get(TOWARDS_ROBOT if directed else "speed/{human}") if self._measured_human else None

        def moment(values: tuple[float, ...]) -> tuple[float, float, float, float]:
            human_m_s = fixed_m_s if human is None else values[human]
            if not directed:
                return values[0], human_m_s, values[robot], values[scalar]
            return values[0], max(human_m_s, 0.0), max(values[robot], 0.0), values[scalar]

        return moment

    def _meeting(self, watched: Watched) -> Meeting:
        """Who moves, who closes in, who is exposed."""
        return Meeting.of(
            watched,
            f"{self._distance}/{{robot}}/{{human}}",
            standstill_m_s=self.standstill_speed_m_s,
            within_m=self.exposure_distance_m,
        )

    def _exposure(self, watched: Watching) -> dict[str, float]:
        if not self._blames:
            return {}
        return exposure_of(watched, meeting=self._meeting)

    def _gathered(self) -> Gathered:
        """What is told of an episode besides its severities."""
        return _Labels(self)


class _Labels(Blame):
    """Who is to blame, as far as a monitor tells it."""

    def __init__(self, monitor: SsmFormula) -> None:
        super().__init__(monitor._meeting)
        self._all = monitor._blames

    def told(self) -> Told:
        """The labels."""
        told = super().told()
        return told if self._all else Told(labels={"robot_moving": told.labels["robot_moving"]})


@dataclass(frozen=True)
class _Moments:
    """What the formula is fed with and what it gives, sample by sample."""

    distance_m: FloatArray
    human_m_s: FloatArray
    robot_m_s: FloatArray
    robot_scalar_m_s: FloatArray
    required_m: FloatArray


# Monitors -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SsmSeparation(SsmFormula, Sampled):
    """Robot and human stay at least the protective separation distance apart.

    The required distance is S_p = S_h + S_r + S_s + C + Z_d + Z_r. In the notation of
    the profiles `seed` and `ariac2023` it is d_min = k_H (t1 + t2) + k_R t1 + B + delta,
    with k_H and k_R the scalar speeds of human and robot, t1 the time from sensing to
    the stop signal, t2 the time to standstill, B the distance covered while stopping
    and delta an allowance for intrusion and uncertainty. Equal distance satisfies.

    Measures:
        For every robot and human the margin distance - S_p, in m, at every sample
        of the competition. Stretches longer than `max_gap_s` without a sample are
        inconclusive. Every violation says whether the robot moved (`robot_moving`) and
        who closed in when it began (`closing_by`: robot, human, both, neither, or unknown
        where the log has no poses); every finding of a pair has the pair's `exposure_s`,
        the time that the human was within `exposure_distance_m` of the moving robot.
        Profile `seed` is the published formula and no more: it reads three signals and
        finds what that formula finds as four lines of YAML (`formula.always`) or as RML
        (`rml.spec`), sample for sample, so exposure and `closing_by` are left out there
        unless `blame` is yes.
    Violated when:
        The distance is below S_p (profile `standard`: while the robot moves). One
        approach is one violation (episode): pauses shorter than `t_off_s` are
        bridged, violations shorter than `t_on_s` ignored.
    Source:
        ISO/TS 15066:2016, 5.5.4, in the notation of Ferrando et al.; profile `seed`
        has their values (t1 1.0 s, t2 1.5 s, B 0 m, delta 2.6 m, distance between
        centres), profile `ariac2023` those of the ARIAC 2023 penalty (delta 1.0 m,
        distance in the plane), `ariac2023_agent` those that move its simulated human
        (delta 1.2 m, never more than 5.0 m). Known oddities of these: B = 0 says that
        the robot covers no ground while stopping, and walking away also enlarges
        d_min. Profile `standard`: directed speeds, never below 0, surface distances,
        a human at 1.6 m/s, linear stop; its times and margins are our choice.
    """

    reduced_mass_kg: float | None = parameter(
        None, unit="kg", above=0, source="where given, the energy of closing in is measured too"
    )

    @property
    def _blames(self) -> bool:
        if self.blame == "profile":
            return self._directed or self.profile != "seed"
        return self.blame == "yes"

    def _say(self, trial: Trial) -> Iterator[Said]:
        """Findings for every pair: its violations, or its closest moment."""
        return watch_pairs(
            trial,
            self._wanted,
            max_gap_s=self.max_gap_s,
            clause=_CLAUSE,
            judge=self._judge,
            optional=self._optional,
        )

    def courses(self, trial: Trial) -> Iterator[Course]:
        """Distance and required distance of every pair; without a requirement where none applies."""
        pairs = pairs_of(trial)
        for pair, watched in seen(
            trial, pairs, self._wanted, max_gap_s=self.max_gap_s, optional=self._optional
        ):
            yield Seen(pair.name, watched, lambda: self._bound).course

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that says of every instant whether the distance is enough there."""
        return PairsOnline(
            self._wanted, bodies, max_gap_s=self.max_gap_s, judge=self._stander(), watch=self.watch
        )

    def _stander(self) -> Judge:
        """What holds at one instant, whatever comes: episodes are for the findings."""
        moment, required_of = self._moment(), self.required_m_of()
        must_move, standstill_m_s = self._must_move, self.standstill_speed_m_s

        def stand(subject: str, t_s: float, values: tuple[float, ...]) -> Standing:
            distance_m, human_m_s, robot_m_s, scalar_m_s = moment(values)
            if must_move and not scalar_m_s > standstill_m_s:
                return Standing(subject, t_s, Verdict.NOT_APPLICABLE, "the robot does not move")
            required_m = required_of(human_m_s, robot_m_s)
            margin_m = distance_m - required_m
            if margin_m < 0:
                words = f"{-margin_m:.3f} m nearer than the required {required_m:.3f} m"
                return Standing(subject, t_s, Verdict.VIOLATED, words, margin_m, "m")
            words = f"{margin_m:.3f} m more than the required {required_m:.3f} m"
            return Standing(subject, t_s, Verdict.SATISFIED, words, margin_m, "m")

        return stand

    def _bound(self, watched: Watched) -> Bound:
        now = self._moments(watched)
        words = self._distance.replace("_", " ")
        return Bound(
            words,
            now.distance_m,
            now.required_m,
            "m",
            applies=self._applies(now),
            evidence="required_distance",
        )

    def _judge(self, subject: str, watched: Watching) -> Iterator[Said]:
        seen = Seen(subject, watched, lambda: self._bound)
        yield seen
        rules = Rules(_CLAUSE, self._value("t_on_s"), self.t_off_s)
        exposure = self._exposure(watched)
        judged = Judged(seen, rules, gathered=self._gathered)
        for one in judged.violations():
            yield self._violation(subject, one, exposure)
        if not judged.violated and not watched.gaps:
            yield self._closest(subject, judged.closest, exposure)

    def _gathered(self) -> Gathered:
        return Several(super()._gathered(), _Energy(self))

    def _applies(self, now: _Moments) -> BoolArray:
        if not self._must_move:
            return np.ones(len(now.distance_m), dtype=bool)
        moves: BoolArray = now.robot_scalar_m_s > self.standstill_speed_m_s
        return moves

    def _closest(self, subject: str, closest: Moment | None, exposure: Mapping[str, float]) -> Finding:
        if closest is None:
            return Finding.not_applicable(subject, "the robot never moved", clause=_CLAUSE)
        # Without exposure and energy a clean pair measures nothing, as published.
        more = {**exposure, **_Energy(self).told().quantities}
        return Finding(
            subject,
            Verdict.SATISFIED,
            f"at its closest {closest.margin:.3f} m more than required, at {closest.t_s:.3f} s",
            robustness=closest.margin,
            unit="m",
            quantities={**no_severities("m"), **more} if more else {},
            evidence=closest.evidence,
            clause=_CLAUSE,
        )

    def _violation(self, subject: str, one: Violation, exposure: Mapping[str, float]) -> Finding:
        worst = one.worst
        return Finding(
            subject,
            Verdict.VIOLATED,
            f"too close for {one.quantities['time_in_violation_s']:.2f} s; at worst "
            f"{worst.limit - worst.actual:.3f} m nearer than the required {worst.limit:.3f} m, "
            f"at {worst.t_s:.3f} s",
            span=one.span,
            robustness=worst.margin,
            unit="m",
            quantities={**one.quantities, **exposure, **one.told.quantities},
            labels=one.told.labels,
            evidence=worst.evidence,
            clause=_CLAUSE,
        )


class _Energy(Gathered):
    """The largest energy of closing in, in the rows of a violation; 0 without any."""

    def __init__(self, monitor: SsmSeparation) -> None:
        self._monitor, self._largest_j = monitor, 0.0

    def take(self, watched: Watched, bound: Bound, rows: Any) -> None:
        """Compare with those before."""
        del bound
        if self._monitor.reduced_mass_kg is None:
            return
        now = self._monitor._moments(watched)
        closing = now.human_m_s[rows] + now.robot_m_s[rows]
        energy_j = float(closing_energy_j(self._monitor.reduced_mass_kg, closing).max())
        self._largest_j = max(self._largest_j, energy_j)

    def told(self) -> Told:
        """The largest, where masses are known."""
        if self._monitor.reduced_mass_kg is None:
            return Told()
        return Told({"closing_energy_max_J": self._largest_j})


@dataclass(frozen=True)
class SsmSpeedCap(SsmFormula, Sampled):
    """The robot is no faster than the distance to the human permits.

    The same requirement as `ssm_separation` solved for the robot's speed: easier to
    explain to a team. Price one of the two, never both.

    Measures:
        For every robot and human the permitted speed at the distance at hand, and the
        robot's speed (towards the human, in profile `standard`) against it, in m/s.
    Violated when:
        The speed is above the permitted one.
    Source:
        ISO/TS 15066:2016, 5.5.4, S_p(v) = d solved for v. Times, margins and stop
        model as in `ssm_separation`.
    """

    def _say(self, trial: Trial) -> Iterator[Said]:
        """Findings for every pair: where it was too fast, or its closest moment."""
        return watch_pairs(
            trial,
            self._wanted,
            max_gap_s=self.max_gap_s,
            clause=_CLAUSE,
            judge=self._judge,
            optional=self._optional,
        )

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that says of every instant whether the robot is too fast there."""
        moment, must_move = self._moment(), self._must_move

        def stand(subject: str, t_s: float, values: tuple[float, ...]) -> Standing:
            distance_m, human_m_s, robot_m_s, scalar_m_s = moment(values)
            if must_move and not scalar_m_s > self.standstill_speed_m_s:
                return Standing(subject, t_s, Verdict.NOT_APPLICABLE, "the robot does not move")
            cap_m_s = float(self.speed_cap_m_s(np.array([distance_m]), np.array([human_m_s]))[0])
            if math.isinf(cap_m_s):
                return Standing(subject, t_s, Verdict.NOT_APPLICABLE, "any speed is permitted here")
            margin_m_s = cap_m_s - robot_m_s
            words = f"{robot_m_s:.3f} m/s where {cap_m_s:.3f} m/s are permitted"
            return Standing(subject, t_s, Verdict.of(margin_m_s), words, margin_m_s, "m/s")

        return PairsOnline(self._wanted, bodies, max_gap_s=self.max_gap_s, judge=stand, watch=self.watch)

    def _bound(self, watched: Watched) -> Bound:
        now = self._moments(watched)
        moves = now.robot_scalar_m_s > self.standstill_speed_m_s
        return Bound(
            "robot speed",
            now.robot_m_s,
            self.speed_cap_m_s(now.distance_m, now.human_m_s),
            "m/s",
            at_most=True,
            applies=moves if self._must_move else None,
            evidence="permitted_speed",
        )

    def _judge(self, subject: str, watched: Watching) -> Iterator[Said]:
        rules = Rules(_CLAUSE, self._value("t_on_s"), self.t_off_s, "the robot never moved near the human")
        exposure = Told(self._exposure(watched))
        yield from findings_of(
            subject,
            watched,
            lambda: self._bound,
            rules,
            gathered=lambda: Several(Constant(exposure), self._gathered()),
            idle=lambda: exposure,
        )


@dataclass(frozen=True)
class SsmResponse(SsmFormula, Sampled):
    """After a breach of the separation distance the robot stops as it must.

    A human may always walk in; what counts is what the robot does then. From the
    breach it may go on at its speed for t1, then fall linearly to 0 within t2, and
    stay at rest until the distance is enough again.

    Measures:
        For every robot and human the robot's speed against the speed it is allowed
        since the breach, in m/s; the way beyond what a stop takes, in m.
    Violated when:
        The speed exceeds the allowed one by more than `tolerance_m_s`.
    Source:
        ISO/TS 15066:2016, 5.5.4: the robot is stopped before contact. The envelope
        and the tolerance are our choice (catalogue, M3).
    """

    tolerance_m_s: float = parameter(0.02, source="catalogue, M3", **_SPEED)

    def allowed_speed_m_s(self, since_breach_s: FloatArray, speed_at_breach_m_s: FloatArray) -> FloatArray:
        """Speed allowed at a time since the breach, shape (n,), m/s."""
        t1_s = self._value("t1_s")
        stop_s = np.asarray(self.stopping_time_s(np.asarray(speed_at_breach_m_s, dtype=np.float64)))
        into_stop_s = np.maximum(since_breach_s - t1_s, 0.0)
        left = 1.0 - np.divide(into_stop_s, stop_s, out=np.where(into_stop_s > 0, 1.0, 0.0), where=stop_s > 0)
        allowed: FloatArray = speed_at_breach_m_s * np.clip(left, 0.0, 1.0)
        return allowed

    def _say(self, trial: Trial) -> Iterator[Said]:
        """Findings for every pair: stops that took too long, or the closest moment of the others."""
        return watch_pairs(
            trial,
            self._wanted,
            max_gap_s=self.max_gap_s,
            clause=_CLAUSE,
            judge=self._judge,
            optional=self._optional,
        )

    def _begin(self) -> Judging:
        """Each window by the breach that each sample belongs to, which may have begun in a window before."""
        starts = RunStarts(self.max_gap_s)

        def judge(window: Watched) -> _Stopping:
            now = self._moments(window)
            breach, speed = now.distance_m < now.required_m, now.robot_scalar_m_s
            began_s, speed_then = starts.take(window.t, breach, window.t, speed)
            # To the nanosecond, so that nothing hangs on the last bits of when the clock began.
            since_s = np.round(window.t - began_s, 9)
            allowed = self.allowed_speed_m_s(since_s, speed_then)
            limit = allowed + self.tolerance_m_s
            excess = np.where(breach, np.maximum(speed - allowed, 0.0), 0.0)
            what, evidence = "robot speed after a breach", "allowed_speed"
            return _Stopping(
                what, speed, limit, "m/s", True, breach, evidence, began_s=began_s, excess_m_s=excess
            )

        return judge

    def _judge(self, subject: str, watched: Watching) -> Iterator[Said]:
        seen = Seen(subject, watched, self._begin, apart=False)
        yield seen
        rules = Rules(_CLAUSE, self._value("t_on_s"), self.t_off_s, "the distance was always enough")
        exposure = self._exposure(watched)
        judged = Judged(seen, rules, gathered=lambda: Several(self._gathered(), _Breaches()))
        violations = list(judged.violations())
        stretches = [(one.told.quantities["began_s"], one.told.quantities["last_s"]) for one in violations]
        for one, ways in zip(violations, _ways(seen, stretches), strict=True):
            told = Told({**ways, **exposure}, one.told.labels)
            yield broken(subject, one.worst, rules, one.span, one.quantities, told)
        if not violations and not watched.gaps:
            closest = judged.closest
            told = Told() if closest is None else Told({**_ways(seen, [_breaches(seen)])[0], **exposure})
            yield kept(subject, closest, rules, told)


@dataclass(frozen=True, kw_only=True)
class _Stopping(Bound):
    """The robot's speed since a breach.

    Attributes:
        began_s: When the breach began that each sample belongs to, shape (n,), s.
        excess_m_s: Speed beyond the allowed one, shape (n,), m/s; 0 without a breach.
    """

    began_s: FloatArray
    excess_m_s: FloatArray


class _Breaches(Gathered):
    """From the beginning of which breach until when an episode lasts."""

    def __init__(self) -> None:
        self._began_s, self._last_s = math.inf, -math.inf

    def take(self, watched: Watched, bound: Bound, rows: Any) -> None:
        """The first row tells the one, the last the other."""
        assert isinstance(bound, _Stopping)  # nothing else is judged here
        self._began_s = min(self._began_s, float(bound.began_s[rows[0]]))
        self._last_s = float(watched.t[rows[-1]])

    def told(self) -> Told:
        """Both."""
        return Told({"began_s": self._began_s, "last_s": self._last_s})


def _stopping(seen: Seen) -> Iterator[tuple[Watched, _Stopping]]:
    judge = seen.begin()
    for window in seen.watched:
        bound = judge(window)
        assert isinstance(bound, _Stopping)  # nothing else is judged here
        yield window, bound


def _breaches(seen: Seen) -> tuple[float, float]:
    """When the first breach of a trial began, and the last sample of the last one."""
    first_s, last_s = math.inf, -math.inf
    for window, bound in _stopping(seen):
        times = window.t[bound.applies]
        if len(times):
            first_s, last_s = min(first_s, float(times[0])), float(times[-1])
    return first_s, last_s


def _ways(seen: Seen, stretches: Sequence[tuple[float, float]]) -> list[dict[str, float]]:
    """Ways covered during breaches, each to the end of its last sample.

    Args:
        seen: The judged windows.
        stretches: When the first breach began, and a sample of the last one, in order of time.
    """
    ends = [_Way(began_s, last_s) for began_s, last_s in stretches]
    for window, bound in _stopping(seen) if ends else ():
        for way in ends:
            way.find_end(window, bound)
    for way in ends:
        way.begin()
    before: tuple[Watched, _Stopping] | None = None
    for window, bound in _stopping(seen) if ends else ():
        for way in ends:
            way.take(window, bound, before)
        before = window, bound
    return [way.quantities() for way in ends]


class _Way:
    """The way from the beginning of a breach to the sample after the breach of another."""

    def __init__(self, began_s: float, last_s: float) -> None:
        self._began_s, self._last_s = began_s, last_s
        self._end_s, self._found, self._steps = began_s, False, 0
        self._largest = 0.0

    def find_end(self, window: Watched, bound: _Stopping) -> None:
        """Look for the first sample after the last breach, and count those on the way."""
        t = window.t
        if self._found or t[-1] <= self._began_s:
            return
        assert bound.applies is not None  # breaches are where it applies
        over = (t > self._last_s) & ~(bound.applies & (bound.began_s < t))
        self._found = bool(over.any())
        end = int(np.argmax(over)) if self._found else len(t) - 1
        self._end_s = float(t[end])
        self._steps += end + 1 - int(t.searchsorted(self._began_s, side="right"))

    def begin(self) -> None:
        """Now that it is known how many samples it has."""
        self._travelled, self._extra = Total(self._steps), Total(self._steps)

    def take(self, window: Watched, bound: _Stopping, before: tuple[Watched, _Stopping] | None) -> None:
        """Add the steps that end in a window."""
        t, speed, excess = window.t, bound.actual, bound.excess_m_s
        if t[0] > self._end_s or t[-1] < self._began_s:
            return
        if before is not None:
            earlier, bound_then = before
            t = np.concatenate([earlier.t[-1:], t])
            speed = np.concatenate([bound_then.actual[-1:], speed])
            excess = np.concatenate([bound_then.excess_m_s[-1:], excess])
        part = slice(int(t.searchsorted(self._began_s)), int(t.searchsorted(self._end_s, side="right")))
        t, speed, excess = t[part], speed[part], excess[part]
        lasts_s = np.diff(t)
        self._travelled.take(lasts_s * (speed[1:] + speed[:-1]) / 2.0)
        self._extra.take(lasts_s * (excess[1:] + excess[:-1]) / 2.0)
        within = excess if not self._found else excess[t < self._end_s]
        self._largest = max(self._largest, float(within.max(initial=0.0)))

    def quantities(self) -> dict[str, float]:
        """What was measured of it."""
        return {
            "travel_m": self._travelled.value,
            "extra_travel_m": self._extra.value,
            "excess_max_m_s": self._largest,
        }


def first_of_runs(t: FloatArray, holds: BoolArray, longest_s: float) -> Any:
    """For each row the first row of the run of true rows it belongs to; itself where false.

    A hole in the samples longer than `longest_s` ends a run.

    >>> holds = np.array([False, True, True, False, True])
    >>> first_of_runs(np.arange(5.0), holds, 1.0).tolist()
    [0, 1, 1, 3, 4]
    """
    index = np.arange(len(t))
    goes_on = np.zeros(len(t), dtype=bool)
    goes_on[1:] = holds[1:] & holds[:-1] & (np.diff(t) <= longest_s + 1e-9)
    return np.maximum.accumulate(np.where(goes_on, 0, index))


class RunStarts:
    """`first_of_runs` window by window: what was in the first row of the run that each row belongs to.

    Args:
        longest_s: A hole in the samples longer than this ends a run.

    >>> starts = RunStarts(1.0)
    >>> starts.take(np.array([0.0, 1.0]), np.array([False, True]), np.array([5.0, 6.0]))[0].tolist()
    [5.0, 6.0]
    >>> starts.take(np.array([2.0, 3.0]), np.array([True, False]), np.array([7.0, 8.0]))[0].tolist()
    [6.0, 8.0]
    """

    def __init__(self, longest_s: float) -> None:
        self._longest_s = longest_s
        self._last_s = -math.inf
        self._going: list[Any] | None = None

    def take(self, t: FloatArray, holds: BoolArray, *columns: Any) -> list[Any]:
        """Of each column its values in the first rows of the runs, shape (n,); n is at least 1."""
        first = first_of_runs(t, holds, self._longest_s)
        found = [column[first] for column in columns]
        if self._going is not None and holds[0] and t[0] - self._last_s <= self._longest_s + 1e-9:
            leading = first == 0
            for column, started in zip(found, self._going, strict=True):
                column[leading] = started
        self._last_s = float(t[-1])
        self._going = [column[-1] for column in found] if holds[-1] else None
        return found
