"""Who is to blame when a robot and a human come too close, and for how long the human was exposed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ariac_score import SignalNeed, exact_sum
from ariac_score_standards.severity import Rows
from ariac_score_standards.watching import FloatArray, Watched

STANDSTILL_SPEED_M_S = 0.01
"""Above this a robot moves (monitor catalogue, M7; ARIAC 2023 uses the same for AGVs)."""

EXPOSURE_DISTANCE_M = 5.0
"""Within this of a moving robot a human is exposed (catalogue, 1.3; our choice)."""

APART = "separation/{robot}/{human}"
SPEED = "speed/{robot}"
TOWARDS_HUMAN = "approach_speed_robot/{robot}/{human}"
TOWARDS_ROBOT = "approach_speed_human/{robot}/{human}"
MEETING: Mapping[str, str] = {APART: "m", SPEED: "m/s", TOWARDS_HUMAN: "m/s", TOWARDS_ROBOT: "m/s"}
"""The signals that show who closed in and who was exposed, where a log has them: unit by template."""


def closing_by(robot_m_s: float, human_m_s: float, *, standstill_m_s: float = STANDSTILL_SPEED_M_S) -> str:
    """Who closes the distance: `robot`, `human`, `both` or `neither`; `unknown` for NaN.

    Args:
        robot_m_s: Speed of the robot towards the human, m/s.
        human_m_s: Speed of the human towards the robot, m/s.
        standstill_m_s: A speed up to this closes nothing, m/s.

    >>> closing_by(0.5, 0.0), closing_by(-0.5, 1.2), closing_by(0.3, 0.3)
    ('robot', 'human', 'both')
    """
    if np.isnan(robot_m_s) or np.isnan(human_m_s):
        return "unknown"
    robot, human = robot_m_s > standstill_m_s, human_m_s > standstill_m_s
    if robot and human:
        return "both"
    return "robot" if robot else "human" if human else "neither"


def robot_moving(speed_m_s: FloatArray, standstill_m_s: float = STANDSTILL_SPEED_M_S) -> str:
    """Whether a robot moved at one of some samples: `yes`, `no`; `unknown` where NaN leaves it open.

    >>> robot_moving(np.array([0.0, 0.02])), robot_moving(np.array([0.01])), robot_moving(np.array([np.nan]))
    ('yes', 'no', 'unknown')
    """
    if (speed_m_s > standstill_m_s).any():
        return "yes"
    return "unknown" if np.isnan(speed_m_s).any() else "no"


def meeting_needs(max_gap_s: float, *needed: str) -> Iterator[SignalNeed]:
    """The quantities of `MEETING` that a monitor does not need anyway, as optional."""
    for template, unit in MEETING.items():
        quantity = template.partition("/")[0]
        if quantity not in needed:
            yield SignalNeed(quantity, unit, max_gap_s, optional=True)


@dataclass(frozen=True, eq=False)
class Meeting:
    """How a robot and a human move over time; NaN where the log does not show it.

    Attributes:
        robot_speed_m_s: Scalar speed of the robot, shape (n,), m/s.
        robot_towards_m_s: Its speed towards the human, m/s.
        human_towards_m_s: Speed of the human towards the robot, m/s.
        standstill_m_s: Above this something moves, m/s.
    """

    robot_speed_m_s: FloatArray
    robot_towards_m_s: FloatArray
    human_towards_m_s: FloatArray
    standstill_m_s: float = STANDSTILL_SPEED_M_S

    @classmethod
    def of(cls, watched: Watched, *, standstill_m_s: float = STANDSTILL_SPEED_M_S) -> Meeting:
        """From the signals of `MEETING` that are watched."""
        speed, robot, human = (_column(watched, name) for name in (SPEED, TOWARDS_HUMAN, TOWARDS_ROBOT))
        return cls(speed, robot, human, standstill_m_s)

    def labels(self, rows: Rows, *, before: bool = False) -> dict[str, str]:
        """Whether the robot moved in the rows of an episode, and who closed in at the first of them.

        Args:
            rows: Of the episode.
            before: Look at the row before the first instead: in contact, nothing approaches any more.
        """
        # At the onset (catalogue, 1.5): later the robot may have stopped as it must.
        onset = max(int(rows[0]) - before, 0)
        robot, human = float(self.robot_towards_m_s[onset]), float(self.human_towards_m_s[onset])
        return {
            "robot_moving": robot_moving(self.robot_speed_m_s[rows], self.standstill_m_s),
            "closing_by": closing_by(robot, human, standstill_m_s=self.standstill_m_s),
        }


def exposure_of(
    watched: Watched,
    distance: str = APART,
    *,
    standstill_m_s: float = STANDSTILL_SPEED_M_S,
    within_m: float = EXPOSURE_DISTANCE_M,
) -> dict[str, float]:
    """`exposure_s` of a watched robot and human; see `exposure`.

    Args:
        watched: Their signals.
        distance: Template of their distance.
        standstill_m_s: Above this the robot moves, m/s.
        within_m: Within this of the moving robot the human is exposed, m.
    """
    distance_m, speed_m_s = _column(watched, distance), _column(watched, SPEED)
    return exposure(watched, distance_m, speed_m_s, standstill_m_s=standstill_m_s, within_m=within_m)


def exposure(
    watched: Watched,
    distance_m: FloatArray,
    robot_speed_m_s: FloatArray,
    *,
    standstill_m_s: float = STANDSTILL_SPEED_M_S,
    within_m: float = EXPOSURE_DISTANCE_M,
) -> dict[str, float]:
    """`exposure_s`: how long a human was near a moving robot; nothing where some sample does not show it."""
    if not (np.isfinite(distance_m).all() and np.isfinite(robot_speed_m_s).all()):
        return {}
    exposed = (distance_m <= within_m) & (robot_speed_m_s > standstill_m_s)
    return {"exposure_s": exact_sum(watched.durations_s[exposed])}


def _column(watched: Watched, template: str) -> FloatArray:
    values = watched.get(template)
    return np.full(len(watched), np.nan) if values is None else values
