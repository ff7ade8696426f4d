"""The monitor `workshop.calm_robot`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ariac_score import (
    Finding,
    MissingSignalError,
    Sample,
    SignalNeed,
    Trial,
    Verdict,
    align,
    check_parameters,
    episodes_where,
    parameter,
    uncovered_spans,
)

__all__ = ["CalmRobot"]


@dataclass(frozen=True)
class CalmRobot:
    """A robot near a human is slow.

    Measures:
        The speed of the robot, in m/s, while the distance between the two is below
        `near_m`. Stretches longer than `max_gap_s` without a sample are inconclusive.
    Violated when:
        The speed is above `max_speed_m_s` while they are near. One stretch is one
        violation.
    Source:
        A rule of our workshop; both limits are our choice.
    """

    near_m: float = parameter(5.0, unit="m", above=0, at_most=100, source="our workshop")
    max_speed_m_s: float = parameter(0.25, unit="m/s", at_least=0, at_most=20, source="our workshop")
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="our workshop")

    def __post_init__(self) -> None:
        check_parameters(self)

    def needs(self) -> Iterator[SignalNeed]:
        """The distance, and the speed of the robot."""
        yield SignalNeed("centre_distance", "m", self.max_gap_s)
        yield SignalNeed("speed", "m/s", self.max_gap_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """For every robot and human its violations, or that there was none; and what is not known."""
        pairs = [(robot.id, human.id) for robot, human in trial.pairs()]
        if not pairs:
            yield Finding.inconclusive("trial", "the log shows no robot and human", span=trial.window)
        for robot, human in pairs:
            try:
                yield from self._watch(trial, robot, human)
            except MissingSignalError as missing:
                yield Finding.inconclusive(f"{robot}/{human}", str(missing), span=trial.window)

    def _watch(self, trial: Trial, robot: str, human: str) -> Iterator[Finding]:
        subject = f"{robot}/{human}"
        distance = trial.signal(f"centre_distance/{robot}/{human}", unit="m")
        speed = trial.signal(f"speed/{robot}", unit="m/s")
        t, (distance_m, speed_m_s) = align([distance, speed], max_gap_s=self.max_gap_s)
        window = trial.window
        if window is None or not len(t):
            yield Finding.inconclusive(subject, "there is no sample of both", span=window)
            return
        gaps = uncovered_spans(t, window, max_gap_s=self.max_gap_s)
        for gap in gaps:
            yield Finding.inconclusive(subject, f"no samples for {gap.duration_s:.3f} s", span=gap)
        inside = (t >= window.start_s) & (t <= window.end_s)
        near = inside & (distance_m < self.near_m)
        fast = near & (speed_m_s > self.max_speed_m_s)
        episodes = episodes_where(t, fast, longest_s=self.max_gap_s)
        for span in episodes:
            rows = np.flatnonzero(fast & (t >= span.start_s) & (t <= span.end_s))
            worst = int(rows[np.argmax(speed_m_s[rows])])
            yield Finding(
                subject,
                Verdict.VIOLATED,
                f"{speed_m_s[worst]:.3f} m/s at a distance of {distance_m[worst]:.3f} m, at {t[worst]:.3f} s",
                span=span,
                robustness=float(self.max_speed_m_s - speed_m_s[worst]),
                unit="m/s",
                quantities={"time_in_violation_s": span.duration_s},
                evidence=(
                    Sample(distance.name, float(t[worst]), float(distance_m[worst]), "m"),
                    Sample(speed.name, float(t[worst]), float(speed_m_s[worst]), "m/s"),
                ),
            )
        if not episodes and not gaps:
            yield Finding.satisfied(subject, "slow whenever they were near")
