"""The neutral export of a submission: finite numbers under fixed names, always all of them.

Source: notes on Codabench and EvalAI, sections 0 and 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from msgspec import Struct

from ariac_score.errors import BatchError
from ariac_score.results.codec import as_text, encodable

__all__ = ["COLUMNS", "SENTINEL", "STATUS", "Column", "Metrics", "PlatformScores", "Split"]

LARGEST = 1e10
"""Codabench stores numbers with ten digits before the point."""
DECIMALS = 10
"""Codabench stores as many decimals."""

STATUS: Mapping[str, int] = {"scored": 0, "incomplete": 1, "invalid_log": 2, "disqualified": 3}
"""Status codes: everything was scored; something was undecided or missing; no log could be scored."""

SENTINEL = -1e6
"""The final score of a submission without one: a platform would sort a missing score first."""


@dataclass(frozen=True)
class Column:
    """One column of a leaderboard.

    Attributes:
        key: Its name for the platform, which is that of a field of `Metrics`.
        title: For people.
        descending: Whether the largest number comes first.
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
    Column("least", "Least", True, True, None, "the least that the final score can be"),
    Column("most", "Most", True, True, None, "the most that the final score can be"),
)
"""The columns of every leaderboard, in order; the first is the score, visible ones break ties in turn."""


@dataclass(frozen=True)
class Metrics:
    """The numbers of a submission, one for each of `COLUMNS`, which give their meanings."""

    final: float
    violations: int
    penalty: float
    raw: float
    coverage: float
    status_code: int
    least: float = 0.0
    most: float = 0.0

    def by_column(self) -> dict[str, float | int]:
        """The numbers by key, in the order of `COLUMNS`."""
        return asdict(self)

    def rounded(self) -> Metrics:
        """The same as a platform stores them.

        Raises:
            BatchError: One is not finite, or too large.
        """
        for key, value in self.by_column().items():
            if not math.isfinite(value) or abs(value) >= LARGEST:
                raise BatchError(
                    f"column {key!r}: {value!r} cannot be stored by a platform",
                    hint=f"it must be finite and below {LARGEST:g}; look at the formulas of the rule set",
                )
        # `+ 0.0` makes 0.0 of -0.0, which is what rounds to it from below.
        final, penalty, raw, coverage, least, most = (
            round(value, DECIMALS) + 0.0
            for value in (self.final, self.penalty, self.raw, self.coverage, self.least, self.most)
        )
        return Metrics(final, self.violations, penalty, raw, coverage, self.status_code, least, most)


class Split(Struct, frozen=True, forbid_unknown_fields=True):
    """The numbers of one part of the data, as EvalAI divides them; a phase of ours has one.

    Attributes:
        name: Of the phase.
        public: Whether participants see the numbers.
        metrics: The numbers.
    """

    name: str
    public: bool
    metrics: Metrics


class PlatformScores(
    Struct, frozen=True, forbid_unknown_fields=True, tag_field="schema", tag="platform-scores/1"
):
    """The neutral export of one submission.

    Attributes:
        phase: Name of the phase.
        status: One of `STATUS`.
        splits: The numbers; one split.
        message: One line for the participant.
        result_sha256: Hash over the stored results, which stay the record; empty without any.
        report: Name of the page that explains the score.
    """

    phase: str
    status: str
    splits: tuple[Split]
    message: str
    result_sha256: str
    report: str = "detailed_results.html"

    @classmethod
    def of(
        cls, phase: str, status: str, metrics: Metrics, message: str, result_sha256: str = ""
    ) -> PlatformScores:
        """The export of a phase with one split.

        Raises:
            BatchError: A number cannot be stored by a platform.
        """
        # The message quotes file names of strangers, which may have no place in UTF-8.
        return cls(phase, status, (Split(phase, True, metrics.rounded()),), encodable(message), result_sha256)

    @classmethod
    def without_score(
        cls, phase: str, status: str, message: str, *, result_sha256: str = ""
    ) -> PlatformScores:
        """The export of a submission without a score: the sentinel, and zero for everything else."""
        return cls.of(phase, status, Metrics(SENTINEL, 0, 0, 0, 0, STATUS[status]), message, result_sha256)

    @property
    def metrics(self) -> Metrics:
        """The numbers of the submission."""
        return self.splits[0].metrics

    def text(self) -> str:
        """The export as JSON."""
        return as_text(self)
