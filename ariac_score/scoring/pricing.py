"""From findings to a priced trial: what undecided findings count as, the score, its ledger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from decimal import Decimal

from ariac_score.findings import Finding
from ariac_score.scoring.ledger import Ledger, Line, make_ledger, rounded
from ariac_score.scoring.policy import Assumed, Assumption, assume, ideal
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet

__all__ = ["Priced", "price"]


@dataclass(frozen=True)
class Priced:
    """What findings are worth.

    Attributes:
        ledger: The score taken apart; `None` when an undecided finding withholds it.
        possible: What the trial could have earned with every finding satisfied.
        assumptions: What was made of undecided findings.
    """

    ledger: Ledger | None
    possible: Decimal
    assumptions: tuple[Assumption, ...]


def price(
    findings: Mapping[str, Finding],
    scopes: Scope,
    sheet: ScoreSheet,
    policies: Mapping[str, str],
    *,
    digits: int,
) -> Priced:
    """Price findings.

    Args:
        findings: By id.
        scopes: The scopes, outermost.
        sheet: The formulas.
        policies: What undecided findings count as, by check.
        digits: Decimal digits of score and ledger.

    Raises:
        FormulaError: A formula has no value here, such as a division by zero.
    """
    assumed = assume(findings, policies, priced=sheet.priced)
    best = sheet.evaluate(scopes, ideal(findings))
    ledger = None
    if not assumed.withheld:
        ledger = _zeroed(make_ledger(sheet.evaluate(scopes, assumed.findings), digits=digits), assumed)
    return Priced(ledger, rounded(best.value, digits), assumed.assumptions)


def _zeroed(ledger: Ledger, assumed: Assumed) -> Ledger:
    """The ledger, with a line that takes everything where the rule set gives 0 for what is undecided."""
    if not assumed.zeroed:
        return ledger
    reasons = ", ".join(assumption.finding for assumption in assumed.zeroed)
    taken = Line(
        "score/undecided",
        f"undecided, so the rule set gives 0: {reasons}",
        "factor",
        -ledger.amount,
        0,
        findings=tuple(assumption.finding for assumption in assumed.zeroed),
    )
    zero = ledger.amount - ledger.amount
    return Line("score", "score", "sum", zero, 0, children=(replace(ledger, path="score/before"), taken))
