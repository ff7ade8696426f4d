"""Speed and separation monitoring, after ISO/TS 15066:2016, 5.5.4 (ISO 10218-2:2025, Annex L)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ariac_score import Body, Chart, Finding, InstantVerdict, OnlineWatch, Trial, Verdict, parameter
from ariac_score_standards.iso_10218_2 import contact_energy_j
from ariac_score_standards.online import PairsOnline
from ariac_score_standards.severity import (
    Bound,
    Details,
    Episode,
    JudgedLimit,
    LimitMonitor,
    Rules,
    Statement,
    limit_findings,
    no_severities,
)
from ariac_score_standards.ssm_formula import CLAUSE, Moments, SsmFormula
from ariac_score_standards.watching import (
    BoolArray,
    Values,
    Watched,
    pairs_of,
    watch_pairs,
    watched_subjects,
)


@dataclass(frozen=True)
class SsmSeparation(SsmFormula, LimitMonitor):
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

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every pair its violations, or its closest moment."""
        return watch_pairs(
            trial,
            self._wanted,
            max_gap_s=self.max_gap_s,
            clause=CLAUSE,
            judge=self._judge,
            optional=self._optional,
        )

    def charts(self, trial: Trial) -> Iterator[Chart]:
        """Distance and required distance of every pair; without a requirement where none applies."""
        for pair, watched in watched_subjects(trial, pairs_of(trial), self._wanted, max_gap_s=self.max_gap_s):
            yield JudgedLimit(pair.name, watched, self._bound(watched)).chart

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that judges at every instant whether the distance is enough."""
        return PairsOnline(
            self._wanted, bodies, max_gap_s=self.max_gap_s, judge=self._verdict_at, watch=self.watch
        )

    def _verdict_at(self, subject: str, t_s: float, now: Values) -> InstantVerdict:
        """The verdict on one instant alone; whether it makes an episode is for the findings."""
        bound = self._bound(now)
        if not bound.limited:
            return InstantVerdict(subject, t_s, Verdict.NOT_APPLICABLE, "the robot does not move")
        margin_m, required_m = float(bound.margin), float(bound.limit)
        if margin_m < 0:
            message = f"{-margin_m:.3f} m nearer than the required {required_m:.3f} m"
            return InstantVerdict(subject, t_s, Verdict.VIOLATED, message, margin_m, "m")
        message = f"{margin_m:.3f} m more than the required {required_m:.3f} m"
        return InstantVerdict(subject, t_s, Verdict.SATISFIED, message, margin_m, "m")

    def _bound(self, watched: Values) -> Bound:
        now = self.moments(watched)
        return Bound(
            self._distance.replace("_", " "),
            now.distance_m,
            now.required_m,
            "m",
            applies=self._applies(now),
            evidence="required_distance",
        )

    def _applies(self, now: Moments) -> BoolArray | None:
        return now.robot_scalar_m_s > self.standstill_speed_m_s if self._must_move else None

    def _judge(self, subject: str, watched: Watched) -> Iterator[Statement]:
        limit = JudgedLimit(subject, watched, self._bound(watched))
        yield limit
        exposure = self.exposure(watched)
        episodes = limit.episodes(t_on_s=self._value("t_on_s"), t_off_s=self.t_off_s)
        for episode in episodes:
            yield self._violation(limit, episode, {**exposure, **self._energy(watched, episode)})
        if not episodes and not watched.gaps:
            yield self._closest(limit, {**exposure, **self._energy(watched, None)})

    def _energy(self, watched: Watched, episode: Episode | None) -> dict[str, float]:
        """The largest closing energy during a violation, where the mass is given; 0 without a violation."""
        if self.reduced_mass_kg is None:
            return {}
        if episode is None:
            return {"closing_energy_max_J": 0.0}
        now = self.moments(watched)
        closing_m_s = now.human_m_s[episode.rows] + now.robot_m_s[episode.rows]
        fastest_m_s = max(float(closing_m_s.max()), 0.0)  # moving away brings no energy into a contact
        return {"closing_energy_max_J": contact_energy_j(self.reduced_mass_kg, fastest_m_s)}

    def _closest(self, limit: JudgedLimit, more: Mapping[str, float]) -> Finding:
        closest = limit.closest
        if closest is None:
            return Finding.not_applicable(limit.subject, "the robot never moved", clause=CLAUSE)
        margin_m = float(limit.bound.margin[closest])
        words = f"at its closest {margin_m:.3f} m more than required"
        if limit.bound.broken[closest]:  # but too briefly to count
            brief_s = self._value("t_on_s")
            words = f"never too close for {brief_s:g} s; at worst {-margin_m:.3f} m nearer than required"
        return Finding(
            limit.subject,
            Verdict.SATISFIED,
            f"{words}, at {limit.watched.t[closest]:.3f} s",
            robustness=margin_m,
            unit="m",
            # Without exposure and energy a clean pair measures nothing, as published.
            quantities={**no_severities("m"), **more} if more else {},
            evidence=limit.evidence(closest),
            clause=CLAUSE,
        )

    def _violation(self, limit: JudgedLimit, episode: Episode, more: Mapping[str, float]) -> Finding:
        worst = episode.worst
        margin_m, required_m = float(limit.bound.margin[worst]), float(limit.bound.limit[worst])
        return Finding(
            limit.subject,
            Verdict.VIOLATED,
            f"too close for {episode.quantities['time_in_violation_s']:.2f} s; at worst "
            f"{-margin_m:.3f} m nearer than the required {required_m:.3f} m, "
            f"at {limit.watched.t[worst]:.3f} s",
            span=episode.span,
            robustness=margin_m,
            unit="m",
            quantities={**episode.quantities, **more},
            labels=self.labels(limit.watched, episode),
            evidence=limit.evidence(worst),
            clause=CLAUSE,
        )


@dataclass(frozen=True)
class SsmSpeedCap(SsmFormula, LimitMonitor):
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

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every pair where it was too fast, or its closest moment."""
        return watch_pairs(
            trial,
            self._wanted,
            max_gap_s=self.max_gap_s,
            clause=CLAUSE,
            judge=self._judge,
            optional=self._optional,
        )

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that judges at every instant whether the robot is too fast."""
        return PairsOnline(
            self._wanted, bodies, max_gap_s=self.max_gap_s, judge=self._verdict_at, watch=self.watch
        )

    def _verdict_at(self, subject: str, t_s: float, now: Values) -> InstantVerdict:
        bound = self._bound(now)
        if bound.applies is not None and not bound.applies:
            return InstantVerdict(subject, t_s, Verdict.NOT_APPLICABLE, "the robot does not move")
        if not bound.limited:
            return InstantVerdict(subject, t_s, Verdict.NOT_APPLICABLE, "any speed is permitted here")
        margin_m_s = float(bound.margin)
        message = f"{bound.actual:.3f} m/s where {bound.limit:.3f} m/s are permitted"
        return InstantVerdict(subject, t_s, Verdict.of(margin_m_s), message, margin_m_s, "m/s")

    def _bound(self, watched: Values) -> Bound:
        now = self.moments(watched)
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

    def _judge(self, subject: str, watched: Watched) -> Iterator[Statement]:
        exposure = self.exposure(watched)

        def details(episode: Episode | None) -> Details:
            return Details(exposure, {} if episode is None else self.labels(watched, episode))

        rules = Rules(CLAUSE, self._value("t_on_s"), self.t_off_s, "the robot never moved near the human")
        yield from limit_findings(JudgedLimit(subject, watched, self._bound(watched)), rules, details)
