"""What is recorded of what was handed in, from 2017 to 2022, beside the lines that something left."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from ariac_score_ariac.stock.deliveries import Completion
from ariac_score_ariac.stock.score_steps import ScoreSteps
from ariac_score_ariac.work import Kit

__all__ = ["Evidence", "Printed"]

Printed = Mapping[str, Mapping[str, str]]
"""What the final score prints of each shipment, by label."""


@dataclass(frozen=True)
class Evidence:
    """What is recorded of hand-ins beside what left on an AGV.

    Attributes:
        completions: Lines that orders are complete or out of time, in order of time.
        printed: What the final score prints of the shipments that were submitted; `None`: it is not recorded.
        seen: What lay at a place at a time; `None` where no message shows it.
        steps: Those of the score, where it is recorded and nothing else can have changed it.
        ended_s: When the competition ended, s of trial time; `None`: the recording stops before.
        console: Whether the lines of the simulator are recorded; otherwise a missing one says nothing.
    """

    completions: Sequence[Completion]
    printed: Printed | None
    seen: Callable[[str, float], Kit | None]
    steps: ScoreSteps | None
    ended_s: float | None
    console: bool = True

    def completion(self, task: str) -> float | None:
        """What the final score prints that a shipment was worth, before any factor; `None`: nothing."""
        text = (self.printed or {}).get(task, {}).get("completion_score", "")
        return float(text) if _NUMBER.fullmatch(text) else None


_NUMBER = re.compile(r"\d{1,9}(?:\.\d{1,9})?")
