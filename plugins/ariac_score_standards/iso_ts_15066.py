"""Speed and separation monitoring, after ISO/TS 15066:2016, 5.5.4 (ISO 10218-2:2025, Annex L)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ariac_score import Measure, parameter
from ariac_score.monitors import (
    Bound,
    Episode,
    FindingRules,
    JudgedLimit,
    MarginMonitor,
    Signals,
)
from ariac_score_standards.iso_10218_2 import contact_energy_j
from ariac_score_standards.ssm_formula import SsmFormula


@dataclass(frozen=True)
class SsmSeparation(SsmFormula, MarginMonitor):
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

    example: ClassVar[Mapping[str, Any]] = {"profile": "seed"}

    reduced_mass_kg: float | None = parameter(
        None, unit="kg", above=0, source="where given, the energy of closing in is measured too"
    )

    @property
    def _blames(self) -> bool:
        if self.blame == "profile":
            return self._directed or self.profile != "seed"
        return self.blame == "yes"

    idle, unit = "the robot never moved", "m"

    @property
    def what(self) -> str:
        """The distance it measures."""
        return self._distance.replace("_", " ")

    def margin(self, signals: Signals) -> Bound:
        """Distance - S_p, m."""
        now = self.moments(signals)
        return self.at_least(now.distance_m, now.required_m, where=self.moves(now), named="required_distance")

    @property
    def rules(self) -> FindingRules:
        """Without exposure and energy a clean pair measures nothing, as published."""
        return replace(super().rules, measures_clean=self._blames or self.reduced_mass_kg is not None)

    @property
    def severities(self) -> Mapping[str, Measure]:
        """The energy of closing in, where the mass is given."""
        if self.reduced_mass_kg is None:
            return {}
        return {"closing_energy_max_J": Measure("J", best=0.0, meaning="the largest energy of closing in")}

    def severity(self, limit: JudgedLimit, episode: Episode | None) -> dict[str, float]:
        """The largest closing energy during a violation, where the mass is given; 0 without a violation."""
        if self.reduced_mass_kg is None:
            return {}
        if episode is None:
            return {"closing_energy_max_J": 0.0}
        now = self.moments(limit.watched)
        closing_m_s = now.human_m_s[episode.rows] + now.robot_m_s[episode.rows]
        fastest_m_s = max(float(closing_m_s.max()), 0.0)  # moving away brings no energy into a contact
        return {"closing_energy_max_J": contact_energy_j(self.reduced_mass_kg, fastest_m_s)}

    def instant(self, bound: Bound) -> str:
        """How much more or less than required."""
        return (
            _compared(float(bound.margin), float(bound.limit)) if bound.limited else "the robot does not move"
        )

    def message(self, limit: JudgedLimit, row: int, episode: Episode | None) -> str:
        """How near they came, and when."""
        margin_m, required_m = float(limit.bound.margin[row]), float(limit.bound.limit[row])
        if episode is not None:
            lasted_s = episode.quantities["time_in_violation_s"]
            words = f"too close for {lasted_s:.2f} s; at worst {_compared(margin_m, required_m)}"
        elif limit.bound.broken[row]:  # but too briefly to count
            brief_s = self.rules.t_on_s
            words = f"never too close for {brief_s:g} s; at worst {-margin_m:.3f} m nearer than required"
        else:
            words = f"at its closest {margin_m:.3f} m more than required"
        return f"{words}, at {limit.watched.t[row]:.3f} s"


def _compared(margin_m: float, required_m: float) -> str:
    side = "nearer" if margin_m < 0 else "more"
    return f"{abs(margin_m):.3f} m {side} than the required {required_m:.3f} m"


@dataclass(frozen=True)
class SsmSpeedCap(SsmFormula, MarginMonitor):
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

    what, unit, idle = "robot speed", "m/s", "the robot never moved near the human"

    def margin(self, signals: Signals) -> Bound:
        """Permitted speed - speed, m/s; infinite where any speed is permitted."""
        now = self.moments(signals)
        permitted = self.speed_cap_m_s(now.distance_m, now.human_m_s)
        return self.at_most(now.robot_m_s, permitted, where=self.moves(now), named="permitted_speed")

    def instant(self, bound: Bound) -> str:
        """The speed, and what is permitted."""
        if bound.limited:
            return f"{bound.actual:.3f} m/s where {bound.limit:.3f} m/s are permitted"
        moves = bound.applies is None or bound.applies
        return "any speed is permitted here" if moves else "the robot does not move"
