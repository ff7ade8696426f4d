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
    state_over,
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

    def allowed_speed_m_s(
        self, t: FloatArray, pressed: BoolArray, max_gap_s: float = np.inf, released_s: float = -np.inf
    ) -> FloatArray:
        """The limit of each moment, shape (n,), m/s.

        Args:
            t: Sample times, shape (n,), s.
            pressed: Whether the device is held, shape (n,).
            max_gap_s: Behind samples that are further apart it may have been released anew, s.
            released_s: When it was, if it is not held at the first sample; of one nobody saw held no time
                to stop is left then, s.
        """
        first = first_of_runs(t, ~pressed, max_gap_s)
        since_s = t - np.where(first == 0, released_s, t[first])
        stopping = since_s < self.stop_within_s - TOLERANCE_S
        return np.where(pressed | stopping, self.max_speed_m_s, self.standstill_speed_m_s)

    def _released_s(self, signals: Watched) -> float:
        """When the device was released before the first sample of the speed, s; infinitely early: unknown."""
        before = signals.turns[signals.turns < signals.t[0]]
        state = state_over(
            signals.trial, self.flags[0], signals.subject.name, before, max_age_s=self.max_flag_age_s
        )
        if state is None or not state.on.any():
            return -np.inf
        held = int(np.flatnonzero(state.on)[-1])
        return float([*before, signals.t[0]][held + 1]) if state.known[held:].all() else -np.inf

    def margin(self, signals: Watched) -> Bound:
        """Allowed speed - speed, m/s."""
        pressed, *manual = (signals.flag(name, self.max_flag_age_s) for name in self.flags)
        max_gap_s = signals.max_gap_s if signals.unknown else np.inf
        allowed = self.allowed_speed_m_s(signals.t, pressed, max_gap_s, self._released_s(signals))
        return self.at_most(
            signals["speed/{robot}"],
            allowed,
            where=manual[0] if manual else None,
            named="allowed_speed",
        )
