"""Speed and separation monitoring, after ISO/TS 15066:2016, 5.5.4."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ariac_score import Finding, Sample, SignalNeed, Trial, Verdict
from ariac_score_standards.severity import STANDSTILL_SPEED_M_S, Episode, episodes_below
from ariac_score_standards.watching import Watched, watch_pairs

FloatArray = NDArray[np.float64]

_CLAUSE = "derived from ISO/TS 15066:2016, 5.5.4"

PROFILES = {
    "seed": {"t1_s": 1.0, "t2_s": 1.5, "stopping_distance_m": 0.0, "delta_m": 2.6},
    "ariac2023": {"t1_s": 1.0, "t2_s": 1.5, "stopping_distance_m": 0.0, "delta_m": 1.0},
}
"""seed: Ferrando et al., the values used with their robot. ariac2023: the penalty formula of that release."""

_DISTANCES = {"seed": "centre_distance", "ariac2023": "centre_distance_2d"}


@dataclass(frozen=True)
class SsmSeparation:
    """Robot and human stay at least the protective separation distance apart.

    The required distance is d_min = k_H (t1 + t2) + k_R t1 + B + delta, with k_H and
    k_R the scalar speeds of human and robot, t1 the time from sensing to the stop
    signal, t2 the time to standstill, B the distance covered while stopping and
    delta an allowance for intrusion and uncertainty. Equal distance satisfies.

    Measures:
        For every robot and human the margin distance - d_min, in m, at every sample
        of the competition. Stretches longer than `max_gap_s` without a sample are
        inconclusive.
    Violated when:
        The distance is below d_min. One approach is one violation (episode): pauses
        shorter than `t_off_s` are bridged, violations shorter than `t_on_s` ignored.
    Source:
        ISO/TS 15066:2016, 5.5.4, in the notation of Ferrando et al.; profile `seed`
        has their values (t1 1.0 s, t2 1.5 s, B 0 m, delta 2.6 m, distance between
        centres), profile `ariac2023` those of the ARIAC 2023 penalty (delta 1.0 m,
        distance in the plane). Known oddities of both: B = 0 says that the robot
        covers no ground while stopping, and walking away also enlarges d_min.
    """

    profile: Literal["seed", "ariac2023"] = "seed"
    t1_s: float | None = None
    t2_s: float | None = None
    stopping_distance_m: float | None = None
    delta_m: float | None = None
    distance: Literal["profile", "centre_distance", "centre_distance_2d", "separation"] = "profile"
    max_gap_s: float = 0.05
    t_on_s: float = 0.0
    t_off_s: float = 1.0

    def __post_init__(self) -> None:
        for name in ("t1_s", "t2_s", "stopping_distance_m", "delta_m", "t_on_s", "t_off_s"):
            value = getattr(self, name)
            if value is not None and not value >= 0:
                raise ValueError(f"{name} is {value:g} but cannot be negative")
        if not self.max_gap_s > 0:
            raise ValueError(f"max_gap_s is {self.max_gap_s:g} but must be positive")

    def _value(self, name: str) -> float:
        given: float | None = getattr(self, name)
        return PROFILES[self.profile][name] if given is None else given

    @property
    def _distance(self) -> str:
        return _DISTANCES[self.profile] if self.distance == "profile" else self.distance

    def d_min_m(self, human_speed_m_s: FloatArray, robot_speed_m_s: FloatArray) -> FloatArray:
        """Required distance for each pair of speeds, shape (n,), m.

        The order of operations is the paper's: h * (t1 + t2) + r * t1 + B + delta.
        """
        t1_s = self._value("t1_s")
        reaction_and_stop_s = t1_s + self._value("t2_s")
        human_path_m = human_speed_m_s * reaction_and_stop_s
        robot_path_m = robot_speed_m_s * t1_s
        return human_path_m + robot_path_m + self._value("stopping_distance_m") + self._value("delta_m")

    def needs(self) -> Iterator[SignalNeed]:
        """Distance and both scalar speeds."""
        yield SignalNeed(self._distance, "m", self.max_gap_s)
        yield SignalNeed("speed", "m/s", self.max_gap_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings for every pair: its violations, or its closest moment."""
        wanted = {
            f"{self._distance}/{{robot}}/{{human}}": "m",
            "speed/{human}": "m/s",
            "speed/{robot}": "m/s",
        }
        return watch_pairs(trial, wanted, max_gap_s=self.max_gap_s, clause=_CLAUSE, judge=self._judge)

    def _judge(self, subject: str, watched: Watched) -> Iterator[Finding]:
        distance_m, human_speed, robot_speed = watched.columns.values()
        required_m = self.d_min_m(human_speed, robot_speed)
        margin_m = distance_m - required_m
        episodes = episodes_below(watched, margin_m, required_m, t_on_s=self.t_on_s, t_off_s=self.t_off_s)
        for episode in episodes:
            yield self._violation(subject, watched, episode, margin_m, required_m)
        if not episodes and not watched.gaps:
            closest = int(np.argmin(margin_m))
            yield Finding(
                subject,
                Verdict.SATISFIED,
                f"at its closest {margin_m[closest]:.3f} m more than required, at {watched.t[closest]:.3f} s",
                robustness=float(margin_m[closest]),
                unit="m",
                evidence=_evidence(subject, watched, closest, required_m),
                clause=_CLAUSE,
            )

    def _violation(
        self, subject: str, watched: Watched, episode: Episode, margin_m: FloatArray, required_m: FloatArray
    ) -> Finding:
        worst = episode.worst
        robot_speed = list(watched.columns.values())[2]
        moving = bool((robot_speed[episode.rows] > STANDSTILL_SPEED_M_S).any())
        return Finding(
            subject,
            Verdict.VIOLATED,
            f"too close for {episode.quantities['time_in_violation_s']:.2f} s; at worst "
            f"{-margin_m[worst]:.3f} m nearer than the required {required_m[worst]:.3f} m, "
            f"at {watched.t[worst]:.3f} s",
            span=episode.span,
            robustness=float(margin_m[worst]),
            unit="m",
            quantities=episode.quantities,
            labels={"robot_moving": "yes" if moving else "no"},
            evidence=_evidence(subject, watched, worst, required_m),
            clause=_CLAUSE,
        )


def _evidence(subject: str, watched: Watched, row: int, required_m: FloatArray) -> tuple[Sample, ...]:
    required = Sample(f"required_distance/{subject}", float(watched.t[row]), float(required_m[row]), "m")
    return (*watched.samples(row), required)
