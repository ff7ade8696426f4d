"""How a run can end, and the document that says so where there is no result."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ariac_score.errors import (
    FormulaError,
    LogError,
    NothingToScoreError,
    PluginError,
    RunEndedError,
    ScoreError,
)

__all__ = [
    "OUTCOMES",
    "SCHEMA",
    "UNSETTLED",
    "Summary",
    "outcome_document",
    "outcome_of",
    "summary_of",
    "told_within",
]

SCHEMA = "ariac-score/outcome/1"

OUTCOMES: Mapping[str, str] = {
    "scored": "it has a score",
    "needs_cohort": "it is measured; its score follows when all teams are ranked",
    "undecided": "something the score depends on could not be decided",
    "crashed": "the simulator crashed",
    "cancelled": "the run was cancelled by its user",
    "unreadable": "a file of it is damaged or malformed",
    "unreachable": "its files could not be fetched from where they lie",
    "nothing_to_score": "no reader knows what lies there",
    "no_value": "a formula has no value for it",
    "plugin_failed": "a plugin misbehaved",
    "refused": "it cannot be told apart from another run",
    "timed_out": "it took longer than a run may",
    "out_of_memory": "it needed more memory than a run may",
    "too_large": "its files, or its result, are larger than those of one run may be",
    "killed": "the process that scored it died, as often as it was tried",
    "changing": "its files changed while they were read",
    "failed": "the scorer failed; this is a fault of the scorer, not of the run",
}
"""Every outcome of a run, with its meaning."""

UNSETTLED = frozenset(OUTCOMES) - {"scored", "needs_cohort", "crashed", "cancelled"}
"""Outcomes that leave a run without a number for a reason somebody should look at."""

_STATUS = {"scored": "scored", "needs_cohort": "needs_cohort", "incomplete": "undecided"}


def outcome_of(error: ScoreError) -> str:
    """The outcome of a run that could not be scored."""
    if isinstance(error, RunEndedError):
        return error.outcome
    kinds = (
        (NothingToScoreError, "nothing_to_score"),
        (PluginError, "plugin_failed"),
        (FormulaError, "no_value"),
        (LogError, "unreadable"),
    )
    return next((outcome for kind, outcome in kinds if isinstance(error, kind)), "unreadable")


def told_within(error: ScoreError, root: Path) -> str:
    """What went wrong and what to do, with the file named from a folder: the same words anywhere."""
    words = str(error).replace(f"{root}/", "")
    return f"{words}; {error.hint}".replace(f"{root}/", "") if error.hint else words


def outcome_document(outcome: str, reason: str, *, team: str, trial: str) -> bytes:
    """An outcome as canonical JSON."""
    data = {"schema": SCHEMA, "outcome": outcome, "reason": reason, "team": team, "trial": trial}
    text = json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False)
    return text.encode("utf-8", "backslashreplace") + b"\n"


@dataclass(frozen=True)
class Summary:
    """What a table of runs shows of one.

    Attributes:
        outcome: One of `OUTCOMES`.
        reason: Why, where it is not simply scored.
        score: Final score as printed; `None` when there is none.
        task: Task score as printed; `None` when there is none.
        checks: For each check how many findings it has of each verdict, and its worst robustness.
    """

    outcome: str
    reason: str
    score: float | None
    task: float | None
    checks: tuple[tuple[str, Mapping[str, int], float | None], ...] = ()


def summary_of(document: bytes) -> Summary:
    """The summary of a result or outcome document, as we wrote it.

    Raises:
        ValueError: It is neither.
    """
    data = json.loads(document)
    if not isinstance(data, dict) or data.get("schema") not in (SCHEMA, "ariac-score/result/1"):
        raise ValueError("neither a result nor an outcome")
    if data["schema"] == SCHEMA:
        return Summary(data["outcome"], data["reason"], None, None)
    task = data.get("task")
    return Summary(
        _outcome(data),
        _reason(data),
        data["score"],
        task["amount"] if task else None,
        tuple(_checks(data)),
    )


def _outcome(data: Mapping[str, Any]) -> str:
    official = data["measured"].get("official") or {}
    ended = official.get("outcome", "")
    return ended if ended in ("crashed", "cancelled") else _STATUS[data["status"]]


def _reason(data: Mapping[str, Any]) -> str:
    """The first thing that withholds the score, and whom it is about."""
    findings = data["measured"]["findings"]
    withheld = [
        f"{findings[a['finding']]['subject']}: {a['message']}"
        for a in data["assumptions"]
        if a["policy"] == "withhold"
    ]
    ended = _outcome(data)
    if ended in OUTCOMES and ended not in _STATUS.values():
        return OUTCOMES[ended]
    return withheld[0] if withheld and data["status"] == "incomplete" else str(data["missing"])


def _checks(data: Mapping[str, Any]) -> list[tuple[str, Mapping[str, int], float | None]]:
    rows: dict[str, tuple[dict[str, int], list[float]]] = {}
    for finding in data["measured"]["findings"].values():
        counts, margins = rows.setdefault(finding["check"], ({}, []))
        counts[finding["verdict"]] = counts.get(finding["verdict"], 0) + 1
        if finding.get("robustness") is not None:
            margins.append(finding["robustness"])
    return [(check, counts, min(m, default=None)) for check, (counts, m) in sorted(rows.items())]
