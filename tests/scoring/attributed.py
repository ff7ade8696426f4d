"""Rule sets of one line, made findings, and how the score is shared among them."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.scoring.attribution import Leaf, Node, flow
from ariac_score.scoring.cohort import CohortTerm, CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.ledger import Line
from ariac_score.scoring.levels import declared_facts
from ariac_score.scoring.pricing import Priced, price
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.shares import Exact
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.scoring.worlds import EARNED, TAKEN, tree_of
from ariac_score.trial.spans import Span

S, V, U, N = Verdict.SATISFIED, Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE
NO_ORDERS = Scope("trial", "", {"duration_s": 60.0})


def order(*parts: int) -> Scope:
    """A trial with an order for each number, of that many parts."""
    orders = tuple(
        Scope("order", f"o{k}", {"index": k}, tuple(Scope("part", f"o{k}/p{i}") for i in range(count)))
        for k, count in enumerate(parts)
    )
    return Scope("trial", "", {"duration_s": 60.0}, orders)


def found(
    check: str, verdict: Verdict, number: int = 0, subject: str = "trial", **quantities: float
) -> tuple[str, Finding]:
    """A finding with its id; every quantity without a unit of its own."""
    finding = Finding(subject, verdict, f"{check} {number}", check=check, quantities=quantities)
    return f"{check}#{number}", finding


def times(check: str, count: int, verdict: Verdict = V) -> list[tuple[str, Finding]]:
    """So many findings of one verdict, each of a time and a subject of its own."""
    return [
        (
            f"{check}#{i}",
            Finding(
                f"{check}/{i}",
                verdict,
                f"{check} {i}",
                span=Span(10.0 * i, 10.0 * i + 1),
                check=check,
                critical=True,
            ),
        )
        for i in range(count)
    ]


class Case:
    """A score sheet with findings.

    Attributes:
        tree: The score in its three worlds.
        score: The number that the formulas give.
    """

    def __init__(
        self,
        score: str,
        findings: Mapping[str, Finding] | list[tuple[str, Finding]],
        *,
        scopes: Scope = NO_ORDERS,
        measures: Mapping[str, Mapping[str, Measure]] | None = None,
        cohort: CohortValues | None = None,
        digits: int = 6,
        policies: Mapping[str, str] | None = None,
        parameters: Mapping[str, float] | None = None,
        cohort_terms: Mapping[str, CohortTerm] | None = None,
        **terms: dict[str, str],
    ) -> None:
        self.findings = dict(findings)
        self.scopes, self.measures, self.digits = scopes, measures or {}, digits
        self.cohort, self.policies = cohort or CohortValues(), policies or {}
        checks = frozenset(finding.check for finding in self.findings.values())
        self.sheet = ScoreSheet(
            {level: {n: Expression.parse(x) for n, x in each.items()} for level, each in terms.items()},
            Expression.parse(score),
            checks,
            parameters or {},
            cohort_terms or {},
            levels=("part", "order", "trial"),
            facts=declared_facts({"order": {"index": "number"}}),
        )
        self.score = self.sheet.evaluate(scopes, self.findings, self.cohort).value
        self.tree: Node = tree_of(
            self.sheet, self.sheet.score, scopes, self.findings, self.cohort, self.measures
        )

    def priced(self) -> Priced:
        return price(
            self.findings,
            self.scopes,
            self.sheet,
            self.policies,
            digits=self.digits,
            cohort=self.cohort,
            measures=self.measures,
        )

    @property
    def ledger(self) -> Line:
        ledger = self.priced().ledger
        assert ledger is not None
        return ledger

    @property
    def earned(self) -> dict[str, Exact]:
        return amounts(self.tree, EARNED)

    @property
    def taken(self) -> dict[str, Exact]:
        return amounts(self.tree, TAKEN)


def amounts(tree: Node, step: int) -> dict[str, Exact]:
    """What each finding brought in a step, exactly; those that nothing changed are not among them."""
    slopes = flow(tree, step).slopes
    found: dict[str, Exact] = {}
    for leaf, slope in slopes.items():
        for part in leaf.parts if isinstance(leaf, Leaf) else ():
            if part.by[step]:
                found[part.key] = found.get(part.key, Fraction(0)) + slope * part.by[step]
    return found


def told(ledger: Line) -> dict[str, str]:
    """The amounts of a ledger by path, without the zeros at their end."""
    return {line.path: f"{line.amount.normalize():f}" for line in ledger.walk()}
