"""Who is to blame when a machine and a person come too close, and for how long the person was exposed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ariac_score.checks.measures import Measure
from ariac_score.monitors.limits import Rows
from ariac_score.monitors.watched import Watched
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.sums import exact_sum

__all__ = [
    "APART",
    "EXPOSURE_DISTANCE_M",
    "SPEED",
    "STANDSTILL_SPEED_M_S",
    "TOWARDS_HUMAN",
    "TOWARDS_ROBOT",
    "Encounter",
    "Meeting",
    "closing_by",
    "exposure",
    "robot_moving",
]

STANDSTILL_SPEED_M_S = 0.01
"""Above this a machine moves (monitor catalogue, M7; a competition of 2023 uses the same for vehicles)."""

EXPOSURE_DISTANCE_M = 5.0
"""Within this of a moving robot a human is exposed (catalogue, 1.3; our choice)."""

APART = "separation/{robot}/{human}"
SPEED = "speed/{robot}"
TOWARDS_HUMAN = "approach_speed_robot/{robot}/{human}"
TOWARDS_ROBOT = "approach_speed_human/{robot}/{human}"


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


def exposure(
    watched: Watched,
    distance_m: FloatArray,
    speed_m_s: FloatArray,
    *,
    standstill_m_s: float = STANDSTILL_SPEED_M_S,
    within_m: float = EXPOSURE_DISTANCE_M,
) -> dict[str, float]:
    """`exposure_s`: how long a person was near a moving machine; nothing where some sample does not show it.

    Args:
        watched: The time base.
        distance_m: Between the two, shape (n,), m.
        speed_m_s: Of the machine, shape (n,), m/s.
        standstill_m_s: Above this the machine moves, m/s.
        within_m: Within this of the moving machine the person is exposed, m.
    """
    if not (np.isfinite(distance_m).all() and np.isfinite(speed_m_s).all()):
        return {}
    exposed = (distance_m <= within_m) & (speed_m_s > standstill_m_s)
    return {"exposure_s": exact_sum(watched.durations_s[exposed])}


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

    def labels(self, rows: Rows, *, before: bool = False) -> dict[str, str]:
        """Whether the robot moved in the rows of an episode, and who closed in at the first of them.

        Args:
            rows: Of the episode.
            before: Look at the row before the first instead: in contact, nothing approaches any more.
        """
        # At the onset: later the robot may have stopped as it must.
        onset = max(int(rows[0]) - before, 0)
        robot, human = float(self.robot_towards_m_s[onset]), float(self.human_towards_m_s[onset])
        return {
            "robot_moving": robot_moving(self.robot_speed_m_s[rows], self.standstill_m_s),
            "closing_by": closing_by(robot, human, standstill_m_s=self.standstill_m_s),
        }


@dataclass(frozen=True)
class Encounter:
    """What a monitor of machines and persons tells besides its own: who closed in, who was exposed how long.

    Every finding gets `exposure_s`, every violation the labels `robot_moving` and `closing_by`
    (`unknown` where the log has no signal that shows it).

    Attributes:
        distance: Template of their distance.
        speed: Template of the machine's speed.
        towards_person: Template of the machine's speed towards the person.
        towards_machine: Template of the person's speed towards the machine.
        standstill_m_s: Above this something moves, m/s.
        within_m: Within this of the moving machine the person is exposed, m.
        before: Whether who closed in is told of the sample before a violation: in contact,
            nothing approaches any more.
        tells: Which of the labels are told.
        exposes: Whether the exposure is told.
    """

    distance: str = APART
    speed: str = SPEED
    towards_person: str = TOWARDS_HUMAN
    towards_machine: str = TOWARDS_ROBOT
    standstill_m_s: float = STANDSTILL_SPEED_M_S
    within_m: float = EXPOSURE_DISTANCE_M
    before: bool = False
    tells: tuple[str, ...] = ("robot_moving", "closing_by")
    exposes: bool = True

    @property
    def measures(self) -> dict[str, Measure]:
        """What it adds to findings."""
        exposed = Measure("s", meaning="how long a person was near the moving machine")
        return {"exposure_s": exposed} if self.exposes else {}

    @property
    def signals(self) -> dict[str, str]:
        """The signals that show it: unit by template."""
        wanted = {self.distance: "m", self.speed: "m/s"}
        if "closing_by" in self.tells:
            wanted |= {self.towards_person: "m/s", self.towards_machine: "m/s"}
        return wanted

    def exposure(self, watched: Watched) -> dict[str, float]:
        """`exposure_s`, where it is told and the log shows it; see `exposure`."""
        if not self.exposes:
            return {}
        distance_m, speed_m_s = watched.known(self.distance), watched.known(self.speed)
        limits: Any = {"standstill_m_s": self.standstill_m_s, "within_m": self.within_m}
        return exposure(watched, distance_m, speed_m_s, **limits)

    def labels(self, watched: Watched, rows: Rows) -> dict[str, str]:
        """Whether the machine moved in some rows, and who closed in at the first of them."""
        names = self.speed, self.towards_person, self.towards_machine
        speed, towards_person, towards_machine = (watched.known(name) for name in names)
        meeting = Meeting(speed, towards_person, towards_machine, self.standstill_m_s)
        labels = meeting.labels(rows, before=self.before)
        return {name: labels[name] for name in self.tells}
