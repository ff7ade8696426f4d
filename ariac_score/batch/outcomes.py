"""The outcomes of a run, and the document that states one where there is no result."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import msgspec
from msgspec import Struct

from ariac_score.checks.findings import Verdict
from ariac_score.errors import (
    FormulaError,
    LogError,
    NothingToScoreError,
    PluginError,
    RunEndedError,
    ScoreError,
)
from ariac_score.results.codec import as_text
from ariac_score.results.result_file import RESULT

__all__ = [
    "OUTCOMES",
    "UNSETTLED",
    "CheckCounts",
    "Summary",
    "error_text",
    "is_outcome",
    "outcome_document",
    "outcome_of",
    "summary_of",
]

OUTCOMES: Mapping[str, str] = {
    "scored": "it has a score",
    "unofficial": "its log is cut off; the score of what is there stands, as was asked for",
    "needs_cohort": "it is measured; its score follows when all teams are ranked",
    "undecided": "something the score depends on could not be decided",
    "crashed": "the simulator crashed",
    "cancelled": "the run was cancelled by its user",
    "unreadable": "a file of it is damaged or malformed",
    "unreachable": "its files could not be fetched from where they lie",
    "nothing_to_score": "no reader knows what lies there",
    "no_value": "a formula has no value for it",
    "plugin_failed": "a plugin misbehaved",
    "refused": "it cannot be distinguished from another run",
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


def error_text(error: ScoreError, root: Path) -> str:
    """What went wrong and what to do, with files named relative to a folder: the same on any machine."""
    text = f"{error}; {error.hint}" if error.hint else str(error)
    return text.replace(f"{root}/", "")


class OutcomeDocument(Struct, frozen=True, tag_field="schema", tag="ariac-score/outcome/1"):
    """Why a run has no result.

    Attributes:
        outcome: One of `OUTCOMES`.
        reason: In words.
        team: Of the run.
        trial: Of the run.
    """

    outcome: str
    reason: str
    team: str
    trial: str


def outcome_document(outcome: str, reason: str, *, team: str, trial: str) -> bytes:
    """An outcome as canonical JSON."""
    return as_text(OutcomeDocument(outcome, reason, team, trial)).encode("utf-8")


class CheckCounts(Struct, frozen=True, forbid_unknown_fields=True):
    """What one check found in a run.

    Attributes:
        name: Of the check.
        worst_robustness: The smallest; `None` where no finding has one.
        satisfied: How many findings are.
        violated: How many findings are.
        inconclusive: How many findings are.
        not_applicable: How many findings are.
    """

    name: str
    worst_robustness: float | None
    satisfied: int
    violated: int
    inconclusive: int
    not_applicable: int


@dataclass(frozen=True)
class Summary:
    """What a table of runs shows of one.

    Attributes:
        outcome: One of `OUTCOMES`.
        reason: Why, where it is not simply scored.
        score: Final score as printed; `None` when there is none.
        task: Task score as printed; `None` when there is none.
        checks: What each check found, by name.
        least: The least score that its log allows, where it leaves any open.
        most: The most, likewise.
    """

    outcome: str
    reason: str
    score: float | None
    task: float | None
    checks: tuple[CheckCounts, ...] = ()
    least: float | None = None
    most: float | None = None


# The few parts of a result that a summary needs: a season has thousands of results, and reading
# each in full takes ten times as long. Both versions of the format have them in the same places.


class _Finding(Struct):
    check: str
    subject: str
    verdict: str
    robustness: float | None


class _Official(Struct):
    outcome: str


class _Measured(Struct):
    findings: dict[str, _Finding]
    official: _Official | None
    unofficial: list[str] = []


class _Assumption(Struct):
    finding: str
    policy: str
    message: str


class _Task(Struct):
    amount: float


class _Interval(Struct):
    least: float
    most: float


class _Result(Struct, tag_field="schema", tag=RESULT.tag):
    status: str
    missing: str
    score: float | None
    task: _Task | None
    measured: _Measured
    assumptions: list[_Assumption]
    interval: _Interval | None = None

    @property
    def outcome(self) -> str:
        ended = self.measured.official.outcome if self.measured.official else ""
        outcome = ended if ended in ("crashed", "cancelled") else _STATUS[self.status]
        return "unofficial" if self.measured.unofficial and outcome in ("scored", "needs_cohort") else outcome

    @property
    def reason(self) -> str:
        """The first thing that withholds the score, and whom it is about."""
        unofficial = "; ".join(self.measured.unofficial)
        if unofficial:
            return f"{unofficial}; {self.missing}" if self.missing else unofficial
        if self.outcome not in _STATUS.values():
            return OUTCOMES[self.outcome]
        withheld = next((a for a in self.assumptions if a.policy == "withhold"), None)
        if withheld is None or self.status != "incomplete":
            return self.missing
        return f"{self.measured.findings[withheld.finding].subject}: {withheld.message}"

    def checks(self) -> Iterator[CheckCounts]:
        """What each check found, by name."""
        found: dict[str, list[_Finding]] = {}
        for finding in self.measured.findings.values():
            found.setdefault(finding.check, []).append(finding)
        for name, own in sorted(found.items()):
            counts = Counter(finding.verdict for finding in own)
            margins = [finding.robustness for finding in own if finding.robustness is not None]
            yield CheckCounts(
                name, min(margins, default=None), *(counts[verdict.value] for verdict in Verdict)
            )


class _Result1(_Result, tag="ariac-score/result/1"):
    pass


class _Result2(_Result, tag="ariac-score/result/2"):
    pass


_DECODER = msgspec.json.Decoder(_Result | _Result1 | _Result2 | OutcomeDocument)


def is_outcome(document: bytes) -> bool:
    """Whether a document says why there is no result, and is none.

    Raises:
        ValueError: It is neither.
    """
    return isinstance(_DECODER.decode(document), OutcomeDocument)


def summary_of(document: bytes) -> Summary:
    """The summary of a result or outcome document, as we wrote it.

    Raises:
        ValueError: It is neither.
    """
    found = _DECODER.decode(document)
    if isinstance(found, OutcomeDocument):
        return Summary(found.outcome, found.reason, None, None)
    task = found.task.amount if found.task else None
    ends = (found.interval.least, found.interval.most) if found.interval else (None, None)
    return Summary(found.outcome, found.reason, found.score, task, tuple(found.checks()), *ends)
