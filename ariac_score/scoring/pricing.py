"""From findings to a priced trial: what undecided findings count as, the score, its ledger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

from msgspec.structs import replace

from ariac_score.checks.findings import Finding
from ariac_score.checks.measures import Measure
from ariac_score.errors import FormulaError, NeedsCohortError, UnknownFactError
from ariac_score.scoring.cohort import CohortValues, Contribution
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import Expression, Number, Traced
from ariac_score.scoring.interval import ScoreInterval
from ariac_score.scoring.ledger import Ledger, Line, make_ledger, rounded
from ariac_score.scoring.policy import Assumed, Assumption, assume, ideal
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.scoring.worlds import tree_of

__all__ = ["Contributed", "Priced", "contribute", "price", "value_of"]


@dataclass(frozen=True)
class Priced:
    """What findings are worth.

    Attributes:
        status: `scored`; `incomplete` when an undecided finding withholds the score;
            `needs_cohort` when it takes values across teams that are not given.
        ledger: The score taken apart; `None` unless scored.
        task: The task score taken apart; `None` when the sheet has none, or it is withheld.
        possible: What the trial could have earned with every finding satisfied and every quantity at the
            best value that its check declares, if it declares one. Facts stay what they are in this trial:
            nothing says what better ones would be. `None` when that has no value, as when a time to be
            divided by is not known, and when it is below the score: then the formula pays for something
            else than what its checks ask for, and what could have been earned is not known.
        assumptions: What was made of undecided findings.
        missing: In words, what the score needs from all teams or what no record states.
        interval: The scores that the log allows, where it leaves any open.
    """

    status: str
    ledger: Ledger | None
    task: Ledger | None
    possible: Decimal | None
    assumptions: tuple[Assumption, ...]
    missing: str = ""
    interval: ScoreInterval | None = None


@dataclass(frozen=True)
class Contributed:
    """What one trial brings to the values across teams.

    Attributes:
        values: Each contribution, counted or not.
        undecided: For each value that needs something undecided, what that is.
    """

    values: tuple[Contribution, ...]
    undecided: Mapping[str, str]


def contribute(
    findings: Mapping[str, Finding], scopes: Scope, sheet: ScoreSheet, policies: Mapping[str, str]
) -> Contributed:
    """What a trial brings to the values across teams; nothing where a value is undecided.

    Args:
        findings: By id.
        scopes: The scopes, outermost.
        sheet: The formulas.
        policies: What undecided findings count as, by check.

    Raises:
        FormulaError: A formula of the cohort has no value here.
    """
    values: list[Contribution] = []
    undecided: dict[str, str] = {}
    for name, term in sheet.cohort.items():
        used = frozenset[str]().union(*(sheet.checks_in(formula, term.level) for formula in term.formulas))
        assumed = assume(findings, policies, priced=used)
        if assumed.withheld:
            undecided[name] = assumed.withheld[0].message
        else:
            values += sheet.contributions(scopes, assumed.findings, only=name)
    return Contributed(tuple(values), undecided)


@in_own_decimals
def price(
    findings: Mapping[str, Finding],
    scopes: Scope,
    sheet: ScoreSheet,
    policies: Mapping[str, str],
    *,
    digits: int,
    cohort: CohortValues | None = None,
    measures: Mapping[str, Mapping[str, Measure]] | None = None,
) -> Priced:
    """Price findings.

    Args:
        findings: By id.
        scopes: The scopes, outermost.
        sheet: The formulas.
        policies: What undecided findings count as, by check.
        digits: Decimal digits of score and ledger.
        cohort: Values across teams, where there are any.
        measures: What checks declare of their quantities, by check and quantity.

    Raises:
        FormulaError: A formula has no value here, such as a division by zero.
    """
    cohort = cohort or CohortValues()
    assumed = assume(findings, policies, priced=sheet.priced)
    maker = _LedgerMaker(scopes, sheet, assumed, cohort, measures or {}, digits)
    task = _task(scopes, sheet, assumed, maker)
    # Before any score is refused: a withheld result still says what it could have been.
    possible = _possible(ideal(findings, measures), scopes, sheet, cohort, digits)
    if _withheld(assumed, sheet.scored):
        return Priced("incomplete", None, task, possible, assumed.assumptions)
    try:
        score = sheet.evaluate(scopes, assumed.findings, cohort)
    except NeedsCohortError as missing:
        return Priced("needs_cohort", None, task, possible, assumed.assumptions, missing.cause)
    except UnknownFactError as missing:
        return Priced("incomplete", None, task, possible, assumed.assumptions, missing.cause)
    ledger = _zeroed(maker.ledger(sheet.score, score, "score"), assumed, sheet.scored)
    if possible is not None and possible < ledger.amount:
        possible = None
    return Priced("scored", ledger, task, possible, assumed.assumptions)


def value_of(
    findings: Mapping[str, Finding],
    scopes: Scope,
    sheet: ScoreSheet,
    policies: Mapping[str, str],
    *,
    cohort: CohortValues | None = None,
) -> Number | None:
    """The number that `price` rounds to the score; `None` when the score is withheld.

    Raises:
        FormulaError: It has no value here.
    """
    assumed = assume(findings, policies, priced=sheet.scored)
    if assumed.withheld:
        return None
    if assumed.zeroed:
        return 0
    return sheet.evaluate(scopes, assumed.findings, cohort or CohortValues()).value


def _withheld(assumed: Assumed, used: frozenset[str]) -> bool:
    return any(assumption.check in used for assumption in assumed.withheld)


@dataclass(frozen=True)
class _LedgerMaker:
    scopes: Scope
    sheet: ScoreSheet
    assumed: Assumed
    cohort: CohortValues
    measures: Mapping[str, Mapping[str, Measure]]
    digits: int

    def ledger(self, formula: Expression, value: Traced, root: str) -> Ledger:
        tree = tree_of(self.sheet, formula, self.scopes, self.assumed.findings, self.cohort, self.measures)
        undecided = [assumption.finding for assumption in self.assumed.assumptions]
        return make_ledger(
            tree, value, self.assumed.findings, digits=self.digits, root=root, undecided=undecided
        )


def _task(scopes: Scope, sheet: ScoreSheet, assumed: Assumed, maker: _LedgerMaker) -> Ledger | None:
    if sheet.task is None or _withheld(assumed, sheet.priced_by_task):
        return None
    try:
        task = sheet.evaluate_task(scopes, assumed.findings)
    except UnknownFactError:
        return None
    assert task is not None  # the sheet has one
    return _zeroed(maker.ledger(sheet.task, task, "task"), assumed, sheet.priced_by_task)


def _possible(
    best: Mapping[str, Finding], scopes: Scope, sheet: ScoreSheet, cohort: CohortValues, digits: int
) -> Decimal | None:
    """The best score; `None` where better findings would bring numbers that nobody measured."""
    if sheet.needs_cohort:  # a faster run is not among the findings, and would move the means as well
        return None
    try:
        return rounded(sheet.evaluate(scopes, best, cohort).value, digits)
    except FormulaError:
        return None


def _zeroed(ledger: Ledger, assumed: Assumed, used: frozenset[str]) -> Ledger:
    """The ledger, with a line that takes everything where the rule set gives 0 for what is undecided."""
    zeroed = tuple(assumption.finding for assumption in assumed.zeroed if assumption.check in used)
    if not zeroed:
        return ledger
    reasons = ", ".join(zeroed)
    taken = Line(
        f"{ledger.path}/undecided",
        f"undecided, so the rule set gives 0: {reasons}",
        "factor",
        -ledger.amount,
        0,
        findings=zeroed,
    )
    # Not Decimal(0): a difference keeps the declared digits, which the ledger shows.
    zero = ledger.amount - ledger.amount
    before = replace(ledger, path=f"{ledger.path}/before")
    return Line(ledger.path, ledger.label, "sum", zero, 0, children=(before, taken))
