"""Hand guiding, after ISO 10218-2 and ISO/TS 15066:2016, 5.5.3."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from ariac_score import FloatArray, parameter
from ariac_score.monitors import (
    STANDSTILL_SPEED_M_S,
    TOLERANCE_S,
    BoolArray,
    Bound,
    LimitMonitor,
    Reach,
    Watched,
    Worse,
    bodies,
    first_of_runs,
)
from ariac_score_standards.parameters import GAP, SPEED, TIME


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

    subjects = bodies("robot")
    wanted: ClassVar[Mapping[str, str]] = {"speed/{robot}": "m/s"}
    worse: ClassVar[Mapping[str, Worse]] = {"speed/{robot}": "high"}
    what, unit = "speed of the guided robot", "m/s"
    clause = "derived from ISO/TS 15066:2016, 5.5.3"
    idle = "the robot was never guided by hand"
    reach = Reach("run")  # the allowed speed depends on when the device was released
    may_hide = ({"enabling_device": 0.0},)

    @property
    def flags(self) -> tuple[str, ...]:
        """The device, and the mode where it counts."""
        return ("enabling_device", *(("manual_mode",) if self.applies == "manual_mode" else ()))

    def allowed_speed_m_s(self, t: FloatArray, pressed: BoolArray, max_gap_s: float = np.inf) -> FloatArray:
        """The limit of each moment, shape (n,), m/s.

        Args:
            t: Sample times, shape (n,), s.
            pressed: Whether the device is held, shape (n,).
            max_gap_s: Behind samples that are further apart it may have been released anew, s.
        """
        released = first_of_runs(t, ~pressed, max_gap_s)
        since_s = np.where(pressed, 0.0, t - t[released])
        # Of a device released at the first sample nobody knows since when: no time to stop is left then.
        never = ~pressed & (released == 0)
        stopping = (since_s < self.stop_within_s - TOLERANCE_S) & ~never
        return np.where(pressed | stopping, self.max_speed_m_s, self.standstill_speed_m_s)

    def margin(self, signals: Watched) -> Bound:
        """Allowed speed - speed, m/s."""
        pressed, *manual = (signals.flag(name, self.max_flag_age_s) for name in self.flags)
        max_gap_s = signals.max_gap_s if signals.unknown else np.inf
        return self.at_most(
            signals["speed/{robot}"],
            self.allowed_speed_m_s(signals.t, pressed, max_gap_s),
            where=manual[0] if manual else None,
            named="allowed_speed",
        )
