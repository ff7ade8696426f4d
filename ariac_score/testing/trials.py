"""A trial made to order, with a flaw that can be checked by hand."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.clock import LOG_TIME, Clock
from ariac_score.trial.events import ARM_COLLISION, COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.spans import FloatArray

__all__ = [
    "NEAR_MISS",
    "ORIGIN_NS",
    "SNAPSHOT_SIGNALS",
    "NearMiss",
    "near_miss_trial",
]

ORIGIN_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000


@dataclass(frozen=True)
class NearMiss:
    """The near miss in the example, in numbers that can be checked by hand.

    Human and robot move side by side at `robot_speed_m_s`; around `worst_s` the human
    comes nearer at `closing_m_s` and leaves again, for `lasts_s` within what the
    paper's formula requires.
    """

    worst_s: float = 20.005
    lasts_s: float = 2.4
    closing_m_s: float = 0.8
    robot_speed_m_s: float = 0.5
    approach_lasts_s: float = 8.0

    @property
    def human_speed_m_s(self) -> float:
        """Scalar speed of the human while nearing and leaving, m/s."""
        return math.hypot(self.robot_speed_m_s, self.closing_m_s)

    @property
    def required_m(self) -> float:
        """The distance that the paper's formula requires meanwhile, m."""
        # kH * (t1 + t2) + kR * t1 + B + delta, with the paper's numbers and without the monitor's code.
        return self.human_speed_m_s * (1.0 + 1.5) + self.robot_speed_m_s * 1.0 + 0.0 + 2.6

    @property
    def closest_m(self) -> float:
        """Distance at the turning point, m."""
        return self.required_m - self.closing_m_s * self.lasts_s / 2


NEAR_MISS = NearMiss()

SNAPSHOT_SIGNALS = ("centre_distance/robot/human", "speed/human", "speed/robot")
"""The signals that the paper's snapshot node publishes; enough for its monitor."""


def near_miss_trial(*, duration_s: float = 40.0, human: bool = True) -> Trial:
    """A trial of a robot and a human with one near miss of 2.4 s, and nothing to do.

    Args:
        duration_s: Length of the recording at 100 Hz, s; at least 35.
        human: Whether the human's signals are recorded.
    """
    builder = TrialBuilder("near_miss", file="made", clock=Clock(LOG_TIME, ORIGIN_NS))
    builder.witnessed |= {"submissions", ARM_COLLISION}
    for event in _events(duration_s):
        builder.add(event)
    builder.add_body(Body("robot", "robot"))
    # Counted in ns, as stamps are: adding up 0.01 s would drift from them.
    steps = round(duration_s * 1e9) // STEP_NS + 1
    t = np.array([k * STEP_NS / 1e9 for k in range(steps)])
    signals = _motion(t)
    if human:
        builder.add_body(Body("human", "human"))
    for name in sorted(signals):
        if human or "human" not in name:
            builder.add_signal(name, "m/s" if name.startswith("speed/") else "m", t, signals[name])
    return builder.build()


def _events(duration_s: float) -> Iterator[Event]:
    yield Event(0.5, COMPETITION_STARTED)
    yield Event(duration_s - 2.0, COMPETITION_ENDED)


def _motion(t: FloatArray) -> dict[str, FloatArray]:
    """Positions, and what the paper's snapshot node would publish of them."""
    miss = NEAR_MISS
    turn_s = 12.0
    phase = np.mod(t, 2 * turn_s)
    robot_x = miss.robot_speed_m_s * np.where(phase < turn_s, phase, 2 * turn_s - phase) - 3.0
    away_s = np.minimum(np.abs(t - miss.worst_s), miss.approach_lasts_s / 2)
    distance = miss.closest_m + miss.closing_m_s * away_s
    closing = np.abs(t - miss.worst_s) < miss.approach_lasts_s / 2
    still = np.zeros_like(t)
    return {
        "position/robot": np.stack([robot_x, still, still], axis=1),
        "position/human": np.stack([robot_x, distance, still], axis=1),
        "speed/robot": np.full_like(t, miss.robot_speed_m_s),
        "speed/human": np.where(closing, miss.human_speed_m_s, miss.robot_speed_m_s),
        "centre_distance/robot/human": distance,
    }
