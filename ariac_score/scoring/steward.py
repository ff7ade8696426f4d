"""What stewards decide on top of an automatic score, which stays as it is.

A decision changes the verdict of a finding, adds points, sets the score, or disqualifies.
Verdicts are priced anew by the rules; every decision is one line that says what it moved.
Verdicts come first, then points, then what settles the score, each in the order of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Annotated, ClassVar

from msgspec import Meta, Struct

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import DataFileError, FormulaError
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import LARGEST_INTEGER
from ariac_score.scoring.ledger import Ledger, Line
from ariac_score.scoring.pricing import Priced

__all__ = [
    "LOST",
    "VERDICTS",
    "Adjusted",
    "Adjustment",
    "FiledAdjustment",
    "adjusted_ledger",
    "as_kept",
    "check_effects",
    "with_verdicts",
]

LOST = "lost"
"""What stands for the measurement of a run whose log is lost, so that nothing was measured."""
VERDICTS = (Verdict.SATISFIED.value, Verdict.VIOLATED.value, Verdict.NOT_APPLICABLE.value)
"""What a steward can decide of a finding; that it stays undecided is no decision."""


class Adjustment(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One decision of a steward, as a result keeps it.

    Attributes:
        id: Its name in the file, such as `protest_3`.
        author: Who decided.
        reason: Why.
        time: When, in UTC.
        measured: SHA-256 of the measurement it was made for; `LOST` where the log of the run is lost.
        trial: Trial it was made for.
        team: Team it was made for; empty when the result names none.
        run: Number of the run, which a ranking needs.
        finding: Id of the finding it is about; empty: the trial.
        verdict: What the finding counts as.
        points: Points added, or taken when negative.
        score: The score instead of any other.
        disqualified: Whether the run is worth 0 and counts as disqualified.
        complaint: Who protested, and against what; empty where the stewards decided by themselves.
        dismissed: Whether that complaint is turned down, so that nothing moves.
    """

    id: str
    author: str
    reason: str
    time: str
    measured: Annotated[str, Meta(pattern="^([0-9a-f]{64}|lost)$")]
    trial: str
    team: str = ""
    run: int | None = None
    finding: str = ""
    verdict: Annotated[str, Meta(pattern="^(satisfied|violated|not_applicable|)$")] = ""
    points: Decimal | None = None
    score: Decimal | None = None
    disqualified: bool = False
    complaint: str = ""
    dismissed: bool = False

    file: ClassVar[str] = "the result"
    place: ClassVar[str] = ""

    @property
    def effect(self) -> str:
        """What it does, in words."""
        if self.dismissed:
            return "the complaint is dismissed"
        if self.verdict:
            return f"{self.finding} counts as {_in_words(self.verdict)}"
        if self.points is not None:
            return f"{_plain(self.points, sign='+')} points"
        return "disqualified" if self.score is None else f"the score is {_plain(self.score)}"

    @property
    def words(self) -> str:
        """Why, after the complaint that it answers."""
        return f"complaint: {self.complaint}; ruling: {self.reason}" if self.complaint else self.reason

    @property
    def settles(self) -> bool:
        """Whether it sets the score, whatever it was."""
        return self.disqualified or self.score is not None

    def refuse(self, cause: str, hint: str) -> DataFileError:
        """An error about this decision."""
        return DataFileError(f"adjustment {self.id!r}: {cause}", file=self.file, place=self.place, hint=hint)


class FiledAdjustment(Adjustment, frozen=True):
    """A decision as it was read from `adjustments.yaml`.

    Attributes:
        file: Where it stands.
        place: Where in that file.
    """

    file: str = ""  # type: ignore[misc]
    place: str = ""  # type: ignore[misc]


@in_own_decimals
def as_kept(adjustment: Adjustment) -> Adjustment:
    """A decision without the place it was read from: what a result keeps of it."""
    return Adjustment(**{name: getattr(adjustment, name) for name in Adjustment.__struct_fields__})


@dataclass(frozen=True)
class Adjusted:
    """An automatic score after the decisions of stewards.

    Attributes:
        score: What counts; `None` while something undecided still withholds it.
        ledger: The automatic score and what each decision moved; `None` without a score.
        adjustments: The decisions, in the order in which they took effect.
        sha256: Of the file they come from.
    """

    score: Decimal | None
    ledger: Ledger | None
    adjustments: Annotated[tuple[Adjustment, ...], Meta(min_length=1)]
    sha256: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]

    @property
    def disqualified(self) -> bool:
        """Whether a decision disqualifies."""
        return any(adjustment.disqualified for adjustment in self.adjustments)


def _in_words(verdict: str) -> str:
    return verdict.replace("_", " ")


def _plain(amount: Decimal, sign: str = "-") -> str:
    """An amount without zeros at its end, however it was written."""
    text = f"{amount:{sign}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


@in_own_decimals
def check_effects(
    adjustments: Sequence[Adjustment], findings: Mapping[str, Finding], priced: frozenset[str], digits: int
) -> None:
    """Refuse decisions about one result that contradict each other or change nothing.

    Args:
        adjustments: All that are about this result.
        findings: Its findings by id.
        priced: The checks its score depends on.
        digits: Decimal digits of its score.

    Raises:
        DataFileError: Naming the decision and what is wrong with it.
    """
    seen: dict[str, Adjustment] = {}
    for adjustment in adjustments:
        if adjustment.dismissed:
            continue
        _check_amount(adjustment, digits)
        if adjustment.finding:
            _check_verdict(adjustment, findings, priced)
        # "$score" cannot be the id of a finding; points have no key, for they may be given many times.
        key = adjustment.finding or ("$score" if adjustment.settles else "")
        if key and key in seen:
            what = f"finding {key!r}" if adjustment.finding else "the score of this trial"
            raise adjustment.refuse(
                f"{what} was decided already, by {seen[key].id!r}", "keep the decision that stands"
            )
        seen[key] = adjustment
    if "$score" in seen and "" in seen:
        raise seen[""].refuse(
            f"points make no difference where {seen['$score'].id!r} says: {seen['$score'].effect}",
            "keep one of the two",
        )


def _check_verdict(adjustment: Adjustment, findings: Mapping[str, Finding], priced: frozenset[str]) -> None:
    finding = findings[adjustment.finding]
    if finding.verdict.value == adjustment.verdict:
        raise adjustment.refuse(
            f"{adjustment.finding} is {adjustment.verdict} already",
            "drop the adjustment, or its target is wrong",
        )
    if finding.check not in priced:
        raise adjustment.refuse(
            f"the score does not depend on {finding.check!r}, so its verdict changes nothing",
            "decide on points of the trial instead",
        )


def _check_amount(adjustment: Adjustment, digits: int) -> None:
    amount = adjustment.points if adjustment.points is not None else adjustment.score
    if amount is None:
        return
    if not amount.is_finite() or abs(amount) > LARGEST_INTEGER:
        raise adjustment.refuse(f"{amount} is no score", "give a number of points")
    if amount != amount.quantize(Decimal(1).scaleb(-digits)):
        raise adjustment.refuse(f"{amount} has more than {digits} decimals", "scores are rounded to so many")
    if adjustment.points is not None and not amount:
        raise adjustment.refuse("0 points change nothing", "drop the adjustment, or give the points")


def with_verdicts(findings: Mapping[str, Finding], adjustments: Sequence[Adjustment]) -> dict[str, Finding]:
    """The findings with the verdicts that stewards decided."""
    decided = {a.finding: Verdict(a.verdict) for a in adjustments if a.verdict}
    return {
        key: replace(finding, verdict=decided[key]) if key in decided else finding
        for key, finding in findings.items()
    }


@in_own_decimals
def adjusted_ledger(
    automatic: Decimal | None,
    findings: Mapping[str, Finding],
    adjustments: Sequence[Adjustment],
    price: Callable[[Mapping[str, Finding]], Priced],
    *,
    digits: int,
    sha256: str,
    lacking: str = "",
) -> Adjusted:
    """Apply decisions to an automatic score.

    Args:
        automatic: The automatic score; `None` when it is withheld.
        findings: By id, as measured.
        adjustments: The decisions, checked.
        price: What findings are worth.
        digits: Decimal digits of the score.
        sha256: Of the file the decisions come from.
        lacking: What an automatic score lacks that no verdict about it decides; empty where nothing.

    Raises:
        DataFileError: A decision needs a score that there is not, or the rules have no
            value for a verdict.
    """
    # Verdicts first, since they are priced anew; what settles the score last, since nothing can follow.
    ordered = sorted(adjustments, key=lambda a: 0 if a.verdict else 2 if a.settles else 1)
    running, lines = automatic, []
    if automatic is not None:
        lines.append(Line("score/automatic", "automatic score", "amount", automatic, float(automatic)))
    for number, adjustment in enumerate(ordered, start=1):
        # Only when all verdicts are decided it matters that something they open is withheld.
        is_last = not any(later.verdict for later in ordered[number:])
        had_one = is_last and automatic is not None
        after = _after(
            running, adjustment, ordered[:number], findings, price, digits, lacking, had_one=had_one
        )
        # A first score counts as moved from 0; the line says that there was none before.
        moved = (after or Decimal(0)) - (running or Decimal(0))
        lines.append(_line(adjustment, number, moved, nothing_before=running is None))
        running = after
    kept = tuple(as_kept(adjustment) for adjustment in ordered)
    if running is None:
        return Adjusted(None, None, kept, sha256)
    ledger = Line("score", "adjusted score", "sum", running, float(running), children=tuple(lines))
    return Adjusted(running, ledger, kept, sha256)


def _after(
    running: Decimal | None,
    adjustment: Adjustment,
    so_far: Sequence[Adjustment],
    findings: Mapping[str, Finding],
    price: Callable[[Mapping[str, Finding]], Priced],
    digits: int,
    lacking: str,
    *,
    had_one: bool,
) -> Decimal | None:
    unit = Decimal(1).scaleb(-digits)  # decisions are written `-1`, amounts of a ledger `-1.000000`
    if adjustment.dismissed:
        return running
    if adjustment.settles:
        return (adjustment.score or Decimal(0)).quantize(unit)
    if adjustment.points is not None:
        if running is None:
            raise adjustment.refuse(
                f"there is no score to add points to: {lacking or 'something it depends on is undecided'}",
                "decide the undecided findings first, or set the score",
            )
        return (running + adjustment.points).quantize(unit)
    try:
        priced = price(with_verdicts(findings, so_far))
    except FormulaError as error:
        raise adjustment.refuse(
            f"the rules have no value for it: {error.cause}", "decide on points of the trial instead"
        ) from error
    if priced.ledger is None and had_one:
        why = priced.missing or "what it opens is withheld until it is decided"
        raise adjustment.refuse(
            f"with {adjustment.finding} {_in_words(adjustment.verdict)} there is no score: {why}",
            "decide on points of the trial instead, or set the score",
        )
    return None if priced.ledger is None else priced.ledger.amount


def _line(adjustment: Adjustment, number: int, moved: Decimal, *, nothing_before: bool) -> Line:
    before = "; there was no automatic score" if nothing_before else ""
    return Line(
        f"score/adjusted_{number}",
        f"adjusted by {adjustment.author}: {adjustment.effect}: {adjustment.reason}{before}",
        "factor",
        moved,
        float(moved),
        findings=(adjustment.finding,) if adjustment.finding else (),
    )
