"""Monitors of a cable insertion: how hard the tool pushes, and whether it touches what is off limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ariac_score import parameter
from ariac_score.monitors import Bound, MarginMonitor, Signals, bodies

__all__ = ["OffLimitContact", "WristForce"]

FORCE, TOUCH = "wrist_force/{robot}", "off_limit_contact/{robot}"


@dataclass(frozen=True)
class WristForce(MarginMonitor):
    """The tool does not push hard.

    Measures:
        The force at the wrist in all three axes, without the offset that the controller states. Stretches
        longer than `max_gap_s` without a sample are inconclusive.
    Violated when:
        It is above `max_force_n`, until it was not for `t_off_s`; shorter than `t_on_s` does not count.
    Attributes:
        max_force_n: The most that the tool may push with.
        max_gap_s: A longer stretch without a sample is not seen.
        t_on_s: The shortest violation that counts.
        t_off_s: Shorter pauses do not part two violations.
    Source:
        The threshold is that of the scorer, `ScoringTier2.cc` of intrinsic-dev/aic; episodes are our choice.
    """

    max_force_n: float = parameter(20.0, unit="N", above=0, at_most=1e4, source="ScoringTier2.cc")
    max_gap_s: float = parameter(0.1, unit="s", above=0, at_most=60, source="our choice")
    t_on_s: float = parameter(0.0, unit="s", at_least=0, at_most=60, source="our choice")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=60, source="our choice")

    subjects = bodies("robot")
    wanted: ClassVar = {FORCE: "N"}
    worse: ClassVar = {FORCE: "high"}
    what, unit, idle = "force at the wrist", "N", "no force was measured"

    def margin(self, signals: Signals) -> Bound:
        """Permitted force - force, N."""
        return self.at_most(signals[FORCE], self.max_force_n)


@dataclass(frozen=True)
class OffLimitContact(MarginMonitor):
    """The robot touches nothing that is off limits.

    Measures:
        Whether the simulator reports a contact with the enclosure or the task board, each time it says so
        or says that there is none. Stretches longer than `max_gap_s` without a report are inconclusive.
    Violated when:
        It reports one, until it did not for `t_off_s`.
    Attributes:
        max_gap_s: A longer stretch without a report is not watched.
        t_off_s: Shorter pauses do not part two contacts.
    Source:
        docs/scoring.md of intrinsic-dev/aic, off-limit contacts; episodes are our choice.
    """

    max_gap_s: float = parameter(1.0, unit="s", above=0, at_most=60, source="our choice: published at 5 Hz")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=60, source="our choice")

    subjects = bodies("robot")
    wanted: ClassVar = {TOUCH: "1"}
    worse: ClassVar = {TOUCH: "high"}
    what, unit, idle = "contact off limits", "1", "no contact was reported"

    def margin(self, signals: Signals) -> Bound:
        """A half - contact."""
        return self.at_most(signals[TOUCH], 0.5)
