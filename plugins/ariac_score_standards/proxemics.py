"""How near people feel a robot is: zones of proxemics, time to collision. For information."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ariac_score import FloatArray, Measure, exact_sum, parameter
from ariac_score.monitors import (
    APART,
    Bound,
    Encounter,
    LimitMonitor,
    Statement,
    Watched,
    pairs,
)
from ariac_score_standards.parameters import GAP

ZONES_M: Mapping[str, float] = {"intimate": 0.45, "personal": 1.2, "social": 3.6}
"""Upper border of each zone, m (verified: hunav_sim metrics); beyond the last it is public."""


def zone_of(distance_m: float) -> str:
    """The zone a surface distance belongs to; a border belongs to the outer zone.

    >>> zone_of(0.44), zone_of(0.45), zone_of(3.6)
    ('intimate', 'personal', 'public')
    """
    return next((zone for zone, border in ZONES_M.items() if distance_m < border), "public")


def zone_shares(distance_m: FloatArray, weights_s: FloatArray) -> dict[str, float]:
    """Share of time in each zone; all 0 when no time passes."""
    total = exact_sum(weights_s)
    shares, low = {}, -np.inf
    for zone, high in {**ZONES_M, "public": np.inf}.items():
        within = (distance_m >= low) & (distance_m < high)
        shares[zone] = exact_sum(weights_s[within]) / total if total > 0 else 0.0
        low = high
    return shares


def time_to_collision_s(
    offset_m: FloatArray, relative_m_s: FloatArray, contact_m: float | FloatArray
) -> FloatArray:
    """Time until two discs touch at their present velocities, shape (n,), s.

    Args:
        offset_m: From one centre to the other, shape (n, 2), m.
        relative_m_s: Velocity of the other less that of the one, shape (n, 2), m/s.
        contact_m: Sum of the radii, m.

    Returns:
        0 where they touch already, infinite where they will not.

    Source:
        nuplan-devkit, time to collision within bound, with discs for footprints.
    """
    a = _dot(relative_m_s, relative_m_s)
    b = _dot(offset_m, relative_m_s)
    reach2 = np.asarray(contact_m, dtype=np.float64) ** 2
    c = _dot(offset_m, offset_m) - reach2
    # b^2 - a c, written with how far the discs would pass each other: head on, that is exactly 0, while
    # rounding could make b^2 - a c negative and miss the collision.
    aside = offset_m[:, 0] * relative_m_s[:, 1] - offset_m[:, 1] * relative_m_s[:, 0]
    root = a * reach2 - aside * aside
    meets = (c > 0) & (b < 0) & (root >= 0)
    # c / (sqrt - b) is the smaller root, without cancellation.
    denominator = np.sqrt(np.where(meets, root, 0.0)) - b
    time = np.full(len(a), np.inf)
    np.divide(c, denominator, out=time, where=meets)
    return np.where(c <= 0, 0.0, time)


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    """Row by row the inner product of vectors of shape (n, 2)."""
    return first[:, 0] * second[:, 0] + first[:, 1] * second[:, 1]


@dataclass(frozen=True)
class ProximityComfort(LimitMonitor):
    """How near the robot came, and how soon it would have touched. Informational, never a gate.

    Measures:
        For every robot and human the share of time in each zone of proxemics by
        surface distance (intimate below 0.45 m, personal below 1.2, social below 3.6,
        public), and the time to collision of the two discs at their present
        velocities in the plane, in s.
    Violated when:
        The time to collision is below `min_time_to_collision_s`. Never critical.
    Source:
        Zones: hunav_sim metrics. Time to collision: nuPlan, 0.95 s with a horizon of
        3 s. ISO 13482 gives no numbers.
    """

    min_time_to_collision_s: float = parameter(
        0.95, unit="s", at_least=0, at_most=60, status="verified", source="nuplan-devkit"
    )
    horizon_s: float = parameter(
        3.0, unit="s", above=0, at_most=600, status="verified", source="nuplan-devkit; beyond it none is told"
    )
    max_gap_s: float = parameter(0.05, **GAP)
    t_on_s: float = parameter(0.03, unit="s", at_least=0, at_most=60, source="catalogue, 1.2")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=60, source="catalogue, 1.2")

    subjects = pairs("robot", "human")
    wanted: ClassVar[Mapping[str, str]] = {
        APART: "m",
        **dict.fromkeys(("position/{robot}", "position/{human}"), "m"),
        **dict.fromkeys(("velocity/{robot}", "velocity/{human}"), "m/s"),
    }
    what, unit = "time to collision", "s"
    clause = "proxemics and time to collision (hunav_sim, nuPlan)"
    encounter = Encounter()
    severities: ClassVar[Mapping[str, Measure]] = {
        **{f"share_{zone}": Measure("1", meaning="share of time there") for zone in (*ZONES_M, "public")},
        "time_to_collision_min_s": Measure("s", meaning="the least time to collision, up to the horizon"),
        "distance_min_m": Measure("m", meaning="the least distance of surfaces"),
    }

    def margin(self, signals: Watched) -> Bound:
        """Time to collision - the least that is comfortable, s."""
        contact = signals.radius_m("robot") + signals.radius_m("human")
        to_human = (signals["position/{human}"] - signals["position/{robot}"])[:, :2]
        relative = (signals["velocity/{human}"] - signals["velocity/{robot}"])[:, :2]
        time = np.minimum(time_to_collision_s(to_human, relative, contact), self.horizon_s)
        return self.at_least(time, self.min_time_to_collision_s)

    def about(self, signals: Watched) -> Iterator[Statement]:
        """Where they would soon have touched, or the closest moment; all with what is of the whole trial."""
        bound, distance = self.bound(signals), signals[APART]
        of_trial = {
            **{f"share_{zone}": n for zone, n in zone_shares(distance, signals.durations_s).items()},
            "time_to_collision_min_s": float(bound.actual.min()),
            "distance_min_m": float(distance.min()),
        }
        yield from self.findings(signals, bound, severity=lambda _limit, _episode: of_trial)
