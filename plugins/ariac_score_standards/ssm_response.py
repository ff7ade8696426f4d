"""What the robot does after a breach of the separation distance, after ISO/TS 15066:2016, 5.5.4."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ariac_score import Span, Trial, parameter
from ariac_score_standards.parameters import SPEED
from ariac_score_standards.severity import (
    Bound,
    Details,
    Episode,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Rows,
    Rules,
    Statement,
    limit_findings,
)
from ariac_score_standards.ssm_formula import CLAUSE, SsmFormula
from ariac_score_standards.travel import travelled_m
from ariac_score_standards.watching import BoolArray, FloatArray, Watched, first_of_runs, watch_pairs


@dataclass(frozen=True)
class SsmResponse(SsmFormula, LimitMonitor):
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

    tolerance_m_s: float = parameter(0.02, source="catalogue, M3", **SPEED)

    def allowed_speed_m_s(self, since_breach_s: FloatArray, speed_at_breach_m_s: FloatArray) -> FloatArray:
        """Speed allowed at a time since the breach, shape (n,), m/s."""
        t1_s = self._value("t1_s")
        stop_s = np.asarray(self.stopping_time_s(np.asarray(speed_at_breach_m_s, dtype=np.float64)))
        into_stop_s = np.maximum(since_breach_s - t1_s, 0.0)
        # A stop that takes no time is over at t1: all of it is behind, unless it has not begun.
        left = 1.0 - np.divide(into_stop_s, stop_s, out=np.where(into_stop_s > 0, 1.0, 0.0), where=stop_s > 0)
        allowed: FloatArray = speed_at_breach_m_s * np.clip(left, 0.0, 1.0)
        return allowed

    @property
    def reach(self) -> Reach:
        """The allowed speed depends on when the breach began, and on the speed then."""
        return Reach("run")

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every pair stops that took too long, or the closest moment of the others."""
        return watch_pairs(
            trial,
            self._wanted,
            max_gap_s=self.max_gap_s,
            clause=CLAUSE,
            judge=self._judge,
            optional=self._optional,
        )

    def _since_breach(self, watched: Watched) -> _Stopping:
        now = self.moments(watched)
        # The scalar speed: the standard wants the robot stopped, not turned aside.
        breach, speed = now.distance_m < now.required_m, now.robot_scalar_m_s
        first = first_of_runs(watched.t, breach, self.max_gap_s)
        # To the nanosecond: the last bits of the difference depend on when the clock began.
        since_s = np.round(watched.t - watched.t[first], 9)
        allowed = self.allowed_speed_m_s(since_s, speed[first])
        excess = np.where(breach, np.maximum(speed - allowed, 0.0), 0.0)
        limit = allowed + self.tolerance_m_s
        bound = Bound("robot speed after a breach", speed, limit, "m/s", True, breach, "allowed_speed")
        return _Stopping(bound, breach, first, excess)

    def _judge(self, subject: str, watched: Watched) -> Iterator[Statement]:
        stopping, exposure = self._since_breach(watched), self.exposure(watched)

        def details(episode: Episode | None) -> Details:
            labels = {} if episode is None else self.labels(watched, episode)
            return Details({**stopping.ways(watched.t, episode), **exposure}, labels)

        rules = Rules(CLAUSE, self._value("t_on_s"), self.t_off_s, "the distance was always enough")
        yield from limit_findings(JudgedLimit(subject, watched, stopping.bound), rules, details)


@dataclass(frozen=True, eq=False)
class _Stopping:
    """How the robot stops after breaches.

    Attributes:
        bound: Its speed against the allowed one.
        breach: Where the distance is too small, shape (n,).
        first: The sample at which the breach began that each sample belongs to, shape (n,).
        excess_m_s: Speed beyond the allowed one, shape (n,), m/s; 0 without a breach.
    """

    bound: Bound
    breach: BoolArray
    first: Rows
    excess_m_s: FloatArray

    def ways(self, t: FloatArray, episode: Episode | None) -> dict[str, float]:
        """Ways covered during the breaches of an episode, or during all, to the sample after the last."""
        rows, speed = np.flatnonzero(self.breach), self.bound.actual
        if episode is not None:
            began, last = self.first[episode.rows[0]], self.first[episode.rows[-1]]
            rows = rows[(self.first[rows] >= began) & (self.first[rows] <= last)]
        span = Span(float(t[rows[0]]), float(t[min(int(rows[-1]) + 1, len(t) - 1)]))
        return {
            "travel_m": travelled_m(t, speed, span),
            "extra_travel_m": travelled_m(t, self.excess_m_s, span),
            "excess_max_m_s": float(self.excess_m_s[rows].max()),
        }
