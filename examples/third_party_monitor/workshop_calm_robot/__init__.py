"""The monitor `workshop.calm_robot`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ariac_score import parameter
from ariac_score.monitors import Bound, MarginMonitor, Signals, pairs

__all__ = ["CalmRobot"]

DISTANCE, SPEED = "centre_distance/{robot}/{human}", "speed/{robot}"


@dataclass(frozen=True)
class CalmRobot(MarginMonitor):
    """A robot near a human is slow.

    Measures:
        The speed of the robot, in m/s, while the distance between the two is below
        `near_m`. Stretches longer than `max_gap_s` without a sample are inconclusive.
    Violated when:
        The speed is above `max_speed_m_s` while they are near, until it was not for `t_off_s`.
    Source:
        A rule of our workshop; both limits are our choice.
    """

    near_m: float = parameter(5.0, unit="m", above=0, at_most=100, source="our workshop")
    max_speed_m_s: float = parameter(0.25, unit="m/s", at_least=0, at_most=20, source="our workshop")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=60, source="our workshop")
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="our workshop")

    subjects = pairs("robot", "human")
    wanted: ClassVar = {DISTANCE: "m", SPEED: "m/s"}
    what, unit, idle = "speed near a human", "m/s", "they were never near"

    def margin(self, signals: Signals) -> Bound:
        """Permitted speed - speed while they are near, m/s."""
        return self.at_most(signals[SPEED], self.max_speed_m_s, where=signals[DISTANCE] < self.near_m)
