"""What the robot does after a breach of the separation distance, after ISO/TS 15066:2016, 5.5.4."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ariac_score import FloatArray, Measure, Span, parameter
from ariac_score.monitors import Bound, Episode, JudgedLimit, Reach, Rows, Watched, Worse, first_of_runs
from ariac_score_standards.parameters import SPEED
from ariac_score_standards.ssm_formula import SsmFormula
from ariac_score_standards.travel import travelled_m


@dataclass(frozen=True)
class SsmResponse(SsmFormula):
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

    what, unit = "robot speed after a breach", "m/s"
    idle = "the distance was always enough"
    reach = Reach("run")  # the allowed speed depends on when the breach began, and on the speed then
    # A breach at a higher speed permits more afterwards, so that no end of a speed is the worse one.
    worse: ClassVar[dict[str, Worse]] = {}
    severities: ClassVar[Mapping[str, Measure]] = {
        "travel_m": Measure("m", best=0.0, meaning="way covered during the breaches"),
        "extra_travel_m": Measure("m", best=0.0, meaning="way beyond what a stop takes"),
    }

    @property
    def may_hide(self) -> tuple[dict[str, float]]:
        """The beginning of a breach, from rest."""
        return (dict.fromkeys(self.wanted, 0.0),)

    def allowed_speed_m_s(self, since_breach_s: FloatArray, speed_at_breach_m_s: FloatArray) -> FloatArray:
        """Speed allowed at a time since the breach, shape (n,), m/s."""
        t1_s = self._value("t1_s")
        stop_s = np.asarray(self.stopping_time_s(np.asarray(speed_at_breach_m_s, dtype=np.float64)))
        into_stop_s = np.maximum(since_breach_s - t1_s, 0.0)
        # A stop that takes no time is over at t1: all of it is behind, unless it has not begun.
        left = 1.0 - np.divide(into_stop_s, stop_s, out=np.where(into_stop_s > 0, 1.0, 0.0), where=stop_s > 0)
        allowed: FloatArray = speed_at_breach_m_s * np.clip(left, 0.0, 1.0)
        return allowed

    def margin(self, signals: Watched) -> _Stopping:
        """Allowed speed - speed while the distance is too small, m/s."""
        now = self.moments(signals)
        # The scalar speed: the standard wants the robot stopped, not turned aside.
        breach, speed = now.distance_m < now.required_m, now.robot_scalar_m_s
        first = first_of_runs(signals.t, breach, signals.max_gap_s)
        # To the nanosecond: the last bits of the difference depend on when the clock began.
        since_s = np.round(signals.t - signals.t[first], 9)
        allowed = self.allowed_speed_m_s(since_s, speed[first])
        return _Stopping(
            self.what,
            speed,
            allowed + self.tolerance_m_s,
            self.unit,
            at_most=True,
            applies=breach,
            evidence="allowed_speed",
            first=first,
            excess_m_s=np.where(breach, np.maximum(speed - allowed, 0.0), 0.0),
        )

    def severity(self, limit: JudgedLimit, episode: Episode | None) -> dict[str, float]:
        """The ways covered."""
        assert isinstance(limit.bound, _Stopping)
        return limit.bound.ways(limit.watched.t, episode)


@dataclass(frozen=True, kw_only=True)
class _Stopping(Bound):
    """The speed after breaches against the allowed one.

    Attributes:
        first: The sample at which the breach began that each sample belongs to, shape (n,).
        excess_m_s: Speed beyond the allowed one, shape (n,), m/s; 0 without a breach.
    """

    first: Rows
    excess_m_s: FloatArray

    def ways(self, t: FloatArray, episode: Episode | None) -> dict[str, float]:
        """Ways covered during the breaches of an episode, or during all, to the sample after the last."""
        rows = np.flatnonzero(self.limited)
        if episode is not None:
            began, last = self.first[episode.rows[0]], self.first[episode.rows[-1]]
            rows = rows[(self.first[rows] >= began) & (self.first[rows] <= last)]
        span = Span(float(t[rows[0]]), float(t[min(int(rows[-1]) + 1, len(t) - 1)]))
        return {
            "travel_m": travelled_m(t, self.actual, span),
            "extra_travel_m": travelled_m(t, self.excess_m_s, span),
            "excess_max_m_s": float(self.excess_m_s[rows].max()),
        }
