"""What a referee saw: what was done to each object, where the robot came, what went wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import (
    Finding,
    Measure,
    SignalNeed,
    Span,
    Trial,
    WorkItem,
    check_parameters,
    parameter,
)
from robocup_work.run import counting

__all__ = ["Incidents", "Manipulation", "Reached"]

_SOURCE = "rulebook 2024, chapter Scoring and Ranking"


@dataclass(frozen=True)
class Manipulation:
    """An object was grasped, or placed where the task wants it.

    Measures:
        Whether the referee saw it, and how often a deduction was called while it was done.
    Violated when:
        The referee did not see it, or saw it at another place.
    Source:
        Rulebook 2024, Scoring: objects grasped, objects placed; Penalties: manipulation deduction.
    """

    action: Literal["grasped", "placed"] = parameter("grasped", source=_SOURCE)
    level: ClassVar[str] = "object"
    measures: ClassVar[Mapping[str, Measure]] = {
        "deductions": Measure("count", "penalty", meaning="deductions called while it was done"),
    }

    def __post_init__(self) -> None:
        check_parameters(self)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the object."""
        thing = item.id.rpartition("/")[2]
        where = item.facts["source" if self.action == "grasped" else "target"]
        done = [e for e in counting(trial, self.action) if e.subject == thing and e.detail in ("", where)]
        if not done:
            yield Finding.violated(item.id, f"not {self.action}", clause=_SOURCE)
            return
        # Called in the row after the one it belongs to, or between grasping and placing.
        called = [e for e in counting(trial, "deduction") if e.subject == thing and e.detail == self.action]
        yield Finding.satisfied(item.id, f"{self.action} at {where}", clause=_SOURCE)
