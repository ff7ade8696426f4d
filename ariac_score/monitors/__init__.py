"""The toolkit for authors of monitors: state whom, on which signals, and a margin; the rest follows.

>>> from dataclasses import dataclass
>>> import numpy as np
>>> from ariac_score import Body, Signal, Span, Trial, parameter
>>> @dataclass(frozen=True)
... class Calm(MarginMonitor):
...     max_speed_m_s: float = parameter(0.25, unit="m/s", at_least=0, at_most=20)
...     subjects, what, unit = bodies("robot"), "speed", "m/s"
...     wanted = {"speed/{robot}": "m/s"}
...
...     def margin(self, signals: Signals) -> Bound:
...         return self.at_most(signals["speed/{robot}"], self.max_speed_m_s)
>>> t = np.arange(4) * 0.04
>>> speed = Signal("speed/arm", "m/s", t, np.array([0.1, 0.3, 0.5, 0.1]))
>>> trial = Trial(
...     "t", bodies=(Body("arm", "robot"),), signals={speed.name: speed}, recorded=Span(0.0, 0.12)
... )
>>> for finding in Calm().watch(trial):
...     print(finding.message)
speed beyond its limit for 0.08 s; at worst 0.500 m/s (at most 0.250), at 0.080 s
"""

from ariac_score.monitors.between import FilledSignals, worlds_between
from ariac_score.monitors.cells import longest_held_s, shown_within_s
from ariac_score.monitors.encounter import (
    APART,
    EXPOSURE_DISTANCE_M,
    SPEED,
    STANDSTILL_SPEED_M_S,
    TOWARDS_HUMAN,
    TOWARDS_ROBOT,
    Encounter,
    Meeting,
    closing_by,
    exposure,
    robot_moving,
)
from ariac_score.monitors.flags import OFF, ON, State, state_over
from ariac_score.monitors.limits import (
    Bound,
    Episode,
    FindingRules,
    JudgedLimit,
    Rows,
    Statement,
    no_severities,
    rows_of_episodes,
    severity_measures,
    violations_only,
)
from ariac_score.monitors.monitor import LimitMonitor, MarginMonitor, Reach, SubjectMonitor
from ariac_score.monitors.subjects import Subject, Subjects, bodies, nobody, pairs
from ariac_score.monitors.watched import (
    ENVIRONMENT,
    TOLERANCE_S,
    Signals,
    UndecidedError,
    Watched,
    first_of_runs,
    watch_subjects,
    watched_signals,
)
from ariac_score.monitors.worsening import Worse
from ariac_score.trial.spans import BoolArray

__all__ = [
    "APART",
    "ENVIRONMENT",
    "EXPOSURE_DISTANCE_M",
    "OFF",
    "ON",
    "SPEED",
    "STANDSTILL_SPEED_M_S",
    "TOLERANCE_S",
    "TOWARDS_HUMAN",
    "TOWARDS_ROBOT",
    "BoolArray",
    "Bound",
    "Encounter",
    "Episode",
    "FilledSignals",
    "FindingRules",
    "JudgedLimit",
    "LimitMonitor",
    "MarginMonitor",
    "Meeting",
    "Reach",
    "Rows",
    "Signals",
    "State",
    "Statement",
    "Subject",
    "SubjectMonitor",
    "Subjects",
    "UndecidedError",
    "Watched",
    "Worse",
    "bodies",
    "closing_by",
    "exposure",
    "first_of_runs",
    "longest_held_s",
    "no_severities",
    "nobody",
    "pairs",
    "robot_moving",
    "rows_of_episodes",
    "severity_measures",
    "shown_within_s",
    "state_over",
    "violations_only",
    "watch_subjects",
    "watched_signals",
    "worlds_between",
]
