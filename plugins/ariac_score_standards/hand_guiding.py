"""Hand guiding, after ISO 10218-2 and ISO/TS 15066:2016, 5.5.3."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ariac_score import Finding, SignalNeed, Trial, check_parameters, parameter
from ariac_score_standards.blame import STANDSTILL_SPEED_M_S
from ariac_score_standards.parameters import GAP, SPEED, TIME, TOLERANCE_S
from ariac_score_standards.severity import (
    Bound,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Rules,
    Statement,
    limit_findings,
)
from ariac_score_standards.watching import (
    BoolArray,
    FloatArray,
    Subject,
    Watched,
    bodies_of,
    first_of_runs,
    flag_over,
    watch_subjects,
)


@dataclass(frozen=True)
class HandGuiding(LimitMonitor):
    """The robot moves by hand only while the enabling device is held, and slowly.

    Measures:
        For every robot its speed: against `max_speed_m_s` while the device is held
        and for `stop_within_s` after its release, then against the standstill speed.
        The device is the flag `enabling_device` (signal, or events `on` and `off`).
    Violated when:
        The speed exceeds the limit of the moment.
    Source:
        ISO 10218-2 and ISO/TS 15066:2016, 5.5.3. The speed limit is for the risk
        assessment to set; 0.25 m/s and 0.5 s are our choice.
    """

    max_speed_m_s: float = parameter(0.25, source="for the risk assessment to set", **SPEED)
    stop_within_s: float = parameter(0.5, source="set per system", **TIME)
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7", **SPEED)
    applies: Literal["always", "manual_mode"] = parameter("always", source="while the robot is guided")
    max_flag_age_s: float = parameter(1.0, unit="s", above=0, at_most=60, source="how long a flag holds")
    max_gap_s: float = parameter(0.05, **GAP)
    t_on_s: float = parameter(0.0, source="catalogue, 1.2", **TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    _clause = "derived from ISO/TS 15066:2016, 5.5.3"

    def __post_init__(self) -> None:
        check_parameters(self)

    def needs(self) -> Iterator[SignalNeed]:
        """Speed and flags."""
        yield SignalNeed("speed", "m/s", self.max_gap_s)
        yield SignalNeed("enabling_device", "1", self.max_flag_age_s)
        if self.applies == "manual_mode":
            yield SignalNeed("manual_mode", "1", self.max_flag_age_s)

    def allowed_speed_m_s(self, t: FloatArray, pressed: BoolArray) -> FloatArray:
        """The limit of each moment, shape (n,), m/s."""
        released = first_of_runs(t, ~pressed, np.inf)
        since_s = np.where(pressed, 0.0, t - t[released])
        # Of a device released at the first sample nobody knows since when: no time to stop is left then.
        never = ~pressed & (released == 0)
        stopping = (since_s < self.stop_within_s - TOLERANCE_S) & ~never
        return np.where(pressed | stopping, self.max_speed_m_s, self.standstill_speed_m_s)

    @property
    def reach(self) -> Reach:
        """The allowed speed depends on when the device was released."""
        return Reach("run")

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every robot where it was too fast, or its closest moment."""
        return watch_subjects(
            trial,
            bodies_of(trial, "robot"),
            {"speed/{robot}": "m/s"},
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=lambda subject, watched: self._judge(trial, subject, watched),
        )

    def _judge(self, trial: Trial, subject: Subject, watched: Watched) -> Iterator[Statement]:
        flags: list[BoolArray] = []
        for name in ("enabling_device", *(("manual_mode",) if self.applies == "manual_mode" else ())):
            flag = flag_over(trial, subject, name, self.max_flag_age_s, watched, self._clause)
            if isinstance(flag, Finding):
                yield flag
                return
            flags.append(flag)
        pressed, *manual = flags
        speed, limit = watched["speed/{robot}"], self.allowed_speed_m_s(watched.t, pressed)
        applies = manual[0] if manual else None
        bound = Bound("speed of the guided robot", speed, limit, "m/s", True, applies, "allowed_speed")
        rules = Rules(self._clause, self.t_on_s, self.t_off_s, "the robot was never guided by hand")
        yield from limit_findings(JudgedLimit(subject.name, watched, bound), rules)
