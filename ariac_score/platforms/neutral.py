"""What a platform is told of a submission: finite numbers under fixed names, always all of them.

Source: notes on Codabench and EvalAI, sections 0 and 1.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ariac_score.errors import BatchError

__all__ = ["COLUMNS", "SCHEMA", "SENTINEL", "STATUS", "Column", "PlatformScores", "checked_metrics"]

SCHEMA = "platform-scores/1"
LARGEST = 1e10
"""Numbers from here on cannot be stored by Codabench."""
DECIMALS = 10
_NAME = re.compile(r"[a-z][a-z0-9_]{0,35}")

STATUS: Mapping[str, int] = {"scored": 0, "incomplete": 1, "invalid_log": 2, "disqualified": 3}
"""Status codes: everything was scored; something was undecided or missing; no log could be scored."""

SENTINEL = -1e6
"""The final score of a submission without one: a missing score would be sorted first."""


@dataclass(frozen=True)
class Column:
    """One column of a leaderboard.

    Attributes:
        key: Its name for the platform.
        title: For people.
        descending: Whether more comes first.
        hidden: Whether it is left out of the table, and so breaks no tie.
        precision: Digits shown; `None` for those of the rule set.
        meaning: What it is.
    """

    key: str
    title: str
    descending: bool
    hidden: bool
    precision: int | None
    meaning: str


COLUMNS = (
    Column("final", "Final", True, False, None, "the score after penalties"),
    Column(
        "violations", "Violations", False, False, 0, "findings that are violations, in the runs that count"
    ),
    Column("penalty", "Penalty", True, False, None, "final less raw"),
    Column("raw", "Raw", True, True, None, "the task score, before penalties"),
    Column("coverage", "Coverage", True, True, 3, "share of the checks that could be decided"),
    Column("status_code", "Status", False, True, 0, "0 scored, 1 incomplete, 2 invalid log, 3 disqualified"),
)
"""The columns of every leaderboard, in order; the first is the score, visible ones break ties in turn."""


@dataclass(frozen=True)
class PlatformScores:
    """The neutral export of one submission.

    Attributes:
        phase: Name of the phase.
        status: One of `STATUS`.
        metrics: A number for each of `COLUMNS`.
        message: One line for the participant.
        result_sha256: Hash over the stored results, which stay the record.
    """

    phase: str
    status: str
    metrics: Mapping[str, float | int]
    message: str
    result_sha256: str

    @classmethod
    def without_score(cls, phase: str, status: str, message: str) -> PlatformScores:
        """A submission that has no score: the sentinel, and zero for everything else."""
        numbers: dict[str, float | int] = {column.key: 0 for column in COLUMNS}
        numbers |= {"final": SENTINEL, "status_code": STATUS[status]}
        return cls(phase, status, numbers, message, "")

    def as_json(self) -> str:
        """The export as text.

        Raises:
            BatchError: A number cannot be stored.
        """
        told = {
            "schema": SCHEMA,
            "phase": self.phase,
            "result_sha256": self.result_sha256,
            "status": self.status,
            "splits": [{"name": self.phase, "public": True, "metrics": checked_metrics(self.metrics)}],
            "message": self.message,
            "report": "detailed_results.html",
        }
        return json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def checked_metrics(metrics: Mapping[str, Any]) -> dict[str, float | int]:
    """The numbers, one for each column and no other, rounded as they will be stored.

    Raises:
        BatchError: One is missing, unknown, no plain number, not finite, or too large.
    """
    wanted = [column.key for column in COLUMNS]
    if sorted(metrics) != sorted(wanted):
        missing, more = set(wanted) - set(metrics), set(metrics) - set(wanted)
        raise BatchError(
            f"columns without a number: {sorted(missing)}; numbers without a column: {sorted(more)}",
            hint="this is a fault of ariac-score; report it",
        )
    told: dict[str, float | int] = {}
    for key in wanted:
        value = metrics[key]
        plain = type(value) in (int, float) and _NAME.fullmatch(key) is not None
        if not plain or not math.isfinite(value) or abs(value) >= LARGEST:
            raise BatchError(
                f"column {key!r}: {value!r} cannot be stored by a platform",
                hint=f"it must be a finite number below {LARGEST:g}; look at the formulas of the rule set",
            )
        told[key] = value if type(value) is int else round(value, DECIMALS) + 0.0
    return told
