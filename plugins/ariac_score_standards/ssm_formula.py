"""The protective separation distance of ISO/TS 15066:2016, 5.5.4, and the parameters of all that use it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from ariac_score import FloatArray, Span, parameter
from ariac_score.monitors import (
    EXPOSURE_DISTANCE_M,
    STANDSTILL_SPEED_M_S,
    TOWARDS_HUMAN,
    TOWARDS_ROBOT,
    BoolArray,
    Encounter,
    FindingRules,
    LimitMonitor,
    Signals,
    Worse,
    pairs,
)
from ariac_score_standards.parameters import LENGTH, SPEED, TIME
from ariac_score_standards.travel import travelled_m

CLAUSE = "derived from ISO/TS 15066:2016, 5.5.4"

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
ariac2023_agent: the other formula in it, which moves its simulated human. standard: our defaults."""

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
    to_human = human_m - robot_m
    distance = np.sqrt(_dot(to_human, to_human))
    # Of two points in one place neither approaches the other: the direction is 0 there, not NaN.
    u = np.divide(to_human, distance[:, None], out=np.zeros_like(to_human), where=distance[:, None] > 0)
    return Approach(distance, _dot(robot_m_s, u), -_dot(human_m_s, u))


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    # Not `@` or `einsum`: the order in which they add, and so the last bit, differs between machines.
    total: FloatArray = a[:, 0] * b[:, 0]
    for column in range(1, a.shape[1]):
        total = total + a[:, column] * b[:, column]
    return total


# Parameters and formulas that the three monitors share ----------------------------------------

_OF_PROFILE = "seed: Ferrando et al.; ariac2023: that release; standard: set per system; " + _PER_PROFILE


@dataclass(frozen=True)
class SsmFormula(LimitMonitor):
    """S_p = S_h + S_r + S_s + C + Z_d + Z_r, and its inverse; the parameters of every SSM monitor.

    Attributes:
        profile: Which published formula, with its values.
        t1_s: Time from sensing to the signal to stop.
        t2_s: Time from that signal to standstill.
        stopping_distance_m: Way that the robot covers while it stops.
        delta_m: Allowance for intrusion and uncertainty, in one.
        distance: Which distance is compared.
        max_gap_s: Longest time between two samples that shows nothing was missed.
        t_on_s: What is shorter is no violation.
        t_off_s: A pause that is not longer ends no violation.
        stop_model: How the way covered while stopping follows from the speed.
        deceleration_m_s2: How hard the robot brakes.
        intrusion_m: How far a body part reaches before it is sensed.
        human_uncertainty_m: How wrong the place of the human may be.
        robot_uncertainty_m: How wrong the place of the robot may be.
        speeds: Whether speeds count in any direction, or towards each other.
        human_speed: Whether the speed of the human is measured or assumed.
        human_speed_m_s: Assumed speed of the human.
        near_human_speed_m_s: Assumed speed of a human who is near.
        near_distance_m: Up to this distance a human is near.
        cap_m: The required distance is never more.
        robot_must_move: Whether a robot at rest violates nothing; `towards_human`: nor one that moves
            in any other direction, the other reading of the standard.
        standstill_speed_m_s: What is slower stands.
        exposure_distance_m: Up to this distance a human is exposed to the moving robot.
        blame: Whether exposure and who closed in are told.
    """

    profile: Literal["seed", "ariac2023", "ariac2023_agent", "standard"] = parameter(
        "seed", source="which formula and which defaults; seed: Ferrando et al."
    )
    t1_s: float | None = parameter(None, status="our choice", source=f"T_r; {_OF_PROFILE}", **TIME)
    t2_s: float | None = parameter(None, status="our choice", source=f"T_s; {_OF_PROFILE}", **TIME)
    stopping_distance_m: float | None = parameter(
        None, status="our choice", source=f"B, S_s of stop model `fixed`; {_OF_PROFILE}", **LENGTH
    )
    delta_m: float | None = parameter(
        None, status="our choice", source=f"C + Z_d + Z_r in one; {_OF_PROFILE}", **LENGTH
    )
    distance: Literal["profile", "centre_distance", "centre_distance_2d", "separation"] = parameter(
        "profile", source="seed and ariac2023 as published; standard: surface to surface"
    )
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="catalogue, 1.4")
    t_on_s: float | None = parameter(None, source="0 s; standard: 0.03 s (catalogue, 1.2)", **TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)
    stop_model: Literal["profile", "fixed", "linear", "deceleration", "constant_speed"] = parameter(
        "profile",
        status="verified",
        source="linear: v_r T_s / 2; deceleration: v_r^2 / 2a; constant_speed, from memory: v_r T_s",
    )
    deceleration_m_s2: float = parameter(
        2.0, unit="m/s2", above=0, at_most=100, source="with stop model `deceleration`; set per system"
    )
    intrusion_m: float | None = parameter(None, source=f"C: 0.20; {_PER_PROFILE}", **LENGTH)
    human_uncertainty_m: float | None = parameter(None, source=f"Z_d: 0.10; {_PER_PROFILE}", **LENGTH)
    robot_uncertainty_m: float | None = parameter(None, source=f"Z_r: 0.05; {_PER_PROFILE}", **LENGTH)
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
        **SPEED,
    )
    near_human_speed_m_s: float = parameter(
        NEAR_SPEED_M_S,
        status="verified",
        source="with human_speed `by_distance`, within near_distance_m: a reading that brings in ISO 13855",
        **SPEED,
    )
    near_distance_m: float = parameter(
        NEAR_DISTANCE_M,
        status="verified",
        source="up to this the near speed counts: a reading that brings in ISO 13855",
        **LENGTH,
    )
    cap_m: float | None = parameter(
        None,
        unit="m",
        above=0,
        status="verified",
        source="ariac2023_agent: 5.0 (ariac2023 branch); otherwise none",
    )
    robot_must_move: Literal["profile", "yes", "towards_human", "no"] = parameter(
        "profile",
        source="standard: a robot at rest violates nothing; the others ask for no motion; "
        "towards_human: nor one that closes no distance",
    )
    standstill_speed_m_s: float = parameter(
        STANDSTILL_SPEED_M_S, source="catalogue, M7; ARIAC 2023 uses it for AGVs", **SPEED
    )
    exposure_distance_m: float = parameter(EXPOSURE_DISTANCE_M, source="catalogue, 1.3", **LENGTH)
    blame: Literal["profile", "yes", "no"] = parameter(
        "profile",
        source="whether exposure and who closed in are told; ssm_separation with profile seed: no",
    )

    subjects = pairs("robot", "human")
    clause = CLAUSE

    def __post_init__(self) -> None:
        super().__post_init__()
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

    @cached_property
    def _stop_model(self) -> str:
        if self.stop_model != "profile":
            return self.stop_model
        return "linear" if self._standard and self.stopping_distance_m is None else "fixed"

    @cached_property
    def _directed(self) -> bool:
        return self._standard if self.speeds == "profile" else self.speeds == "directed"

    @cached_property
    def _measured_human(self) -> bool:
        return not self._standard if self.human_speed == "profile" else self.human_speed == "measured"

    @cached_property
    def _must_move(self) -> str:
        if self.robot_must_move == "profile":
            return "yes" if self._standard else "no"
        return self.robot_must_move

    @property
    def charges_rest(self) -> bool:
        """Whether a robot that stands still can violate anything."""
        return self._must_move == "no"

    @property
    def _blames(self) -> bool:
        return self.blame != "no"

    @cached_property
    def _distance(self) -> str:
        return _DISTANCES[self.profile] if self.distance == "profile" else self.distance

    @cached_property
    def _cap_m(self) -> float | None:
        return PROFILES[self.profile].get("cap_m") if self.cap_m is None else self.cap_m

    def resolved(self) -> dict[str, object]:
        """The values that the profile decides, and those that count of values that exclude each other."""
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
            "robot_must_move": self._must_move,
            "blame": "yes" if self._blames else "no",
        }
        if self.human_speed == "profile":
            used["human_speed"] = "measured" if self._measured_human else "fixed"
        if self._cap_m is not None:
            used["cap_m"] = self._cap_m
        return used

    @cached_property
    def _allowance_in_one(self) -> bool:
        """Whether C + Z_d + Z_r is one number, delta."""
        parts = [getattr(self, name) for name in STANDARD_MARGINS_M]
        return self.delta_m is not None or (not self._standard and all(part is None for part in parts))

    @property
    def _allowance_parts(self) -> dict[str, float]:
        default = STANDARD_MARGINS_M if self._standard else {}
        parts = {name: getattr(self, name) for name in STANDARD_MARGINS_M}
        return {name: default.get(name, 0.0) if part is None else part for name, part in parts.items()}

    @cached_property
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
        # T_r + T_s, not T_r alone: that mistake is in public code, and leaves out most of S_h.
        if self._stop_model == "deceleration":
            return human_speed_m_s * (self._value("t1_s") + self.stopping_time_s(robot_speed_m_s))
        return human_speed_m_s * (self._value("t1_s") + self._value("t2_s"))

    def reaction_path_m(self, robot_speed_m_s: FloatArray) -> FloatArray:
        """S_r: what the robot covers while it reacts, m."""
        return robot_speed_m_s * self._value("t1_s")

    def stopping_path_m(self, robot_speed_m_s: FloatArray) -> FloatArray | float:
        """S_s (B in the seed's notation): what the robot covers while it stops, m."""
        model, t2_s = self._stop_model, self._value("t2_s")
        if model == "linear":
            return robot_speed_m_s * t2_s / 2.0
        if model == "deceleration":
            return robot_speed_m_s * robot_speed_m_s / (2.0 * self.deceleration_m_s2)
        if model == "constant_speed":
            return robot_speed_m_s * t2_s
        return self._value("stopping_distance_m")

    def d_min_m(self, human_speed_m_s: FloatArray, robot_speed_m_s: FloatArray) -> FloatArray:
        """Required distance for each pair of speeds, shape (n,), m.

        The order of operations is the paper's: h * (t1 + t2) + r * t1 + B + delta.
        """
        robot_speed_m_s = np.asarray(robot_speed_m_s, dtype=np.float64)
        human_path_m = self.human_path_m(human_speed_m_s, robot_speed_m_s)
        robot_path_m = self.reaction_path_m(robot_speed_m_s)
        required_m = human_path_m + robot_path_m + self.stopping_path_m(robot_speed_m_s) + self.allowance_m
        return required_m if self._cap_m is None else np.minimum(required_m, self._cap_m)

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
        """Positive root of v^2 / 2a + v (T_r + v_h / a) + v_h T_r - free = 0."""
        # As left / (sqrt(b^2 + left) + b): sqrt(b^2 + left) - b is the same, but near 0 its digits cancel,
        # and a robot that must stand still may move at 1e-17 m/s.
        a, t1_s = self.deceleration_m_s2, self._value("t1_s")
        b = a * t1_s + human_speed_m_s
        left = 2.0 * a * (free_m - human_speed_m_s * t1_s)
        root = np.sqrt(np.maximum(b * b + left, 0.0)) + b
        return np.divide(left, root, out=np.zeros_like(root), where=(left > 0) & (root > 0))

    # Signals --------------------------------------------------------------------------------

    @cached_property
    def wanted(self) -> dict[str, str]:
        """The distance and the speeds of the formula."""
        wanted = {self.distance_template: "m"}
        if self._measured_human:
            wanted[TOWARDS_ROBOT if self._directed else "speed/{human}"] = "m/s"
        wanted["speed/{robot}"] = "m/s"
        if self._directed or self._must_move == "towards_human":
            wanted[TOWARDS_HUMAN] = "m/s"
        return wanted

    @property
    def worse(self) -> dict[str, Worse]:
        """Nearer, and faster: the requirement grows with either speed."""
        return {template: "low" if unit == "m" else "high" for template, unit in self.wanted.items()}

    @cached_property
    def encounter(self) -> Encounter:
        """Exposure and who closed in, if the monitor reports them; whether the robot moved, in any case."""
        return Encounter(
            self.distance_template,
            standstill_m_s=self.standstill_speed_m_s,
            within_m=self.exposure_distance_m,
            tells=("robot_moving", "closing_by") if self._blames else ("robot_moving",),
            exposes=self._blames,
        )

    @property
    def rules(self) -> FindingRules:
        """As of any monitor, with what the profile decides."""
        return replace(super().rules, t_on_s=self._value("t_on_s"))

    def moments(self, signals: Signals) -> Moments:
        """The inputs of the formula and its result, at every sample or at one instant."""
        distance_m = signals[self.distance_template]
        scalar = signals["speed/{robot}"]
        # Clamped, though 5.5.4 may allow less than 0: a robot that withdraws must not shrink the requirement.
        robot = np.maximum(signals[TOWARDS_HUMAN], 0.0) if self._directed else scalar
        if not self._measured_human:
            human = self.assumed_human_speed_m_s(distance_m)
        elif self._directed:
            human = np.maximum(signals[TOWARDS_ROBOT], 0.0)
        else:
            human = signals["speed/{human}"]
        moving = signals[TOWARDS_HUMAN] if self._must_move == "towards_human" else scalar
        return Moments(distance_m, human, robot, scalar, self.d_min_m(human, robot), moving)

    @cached_property
    def distance_template(self) -> str:
        """The signal of the distance."""
        return f"{self._distance}/{{robot}}/{{human}}"

    def moves(self, now: Moments) -> BoolArray | None:
        """Where the requirement applies, if only to a robot that moves."""
        return None if self._must_move == "no" else now.robot_moving_m_s > self.standstill_speed_m_s


@dataclass(frozen=True, eq=False)
class Moments:
    """The inputs of the formula and its result, sample by sample."""

    distance_m: FloatArray
    human_m_s: FloatArray
    robot_m_s: FloatArray
    robot_scalar_m_s: FloatArray
    required_m: FloatArray
    robot_moving_m_s: FloatArray
    """By which it is told whether the robot moves, m/s."""
