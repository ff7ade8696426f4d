"""Laws of the ledger, tried on random rule sets of the whole language and random findings."""

from __future__ import annotations

from decimal import Decimal
from fractions import Fraction

from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.errors import FormulaError
from ariac_score.scoring.cohort import CohortTerm, CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.ledger import reconcile
from ariac_score.trial.spans import Span

from .attributed import Case, S, V, order

LAWFUL = settings(max_examples=150, derandomize=True, deadline=None)

MEASURES = {
    "m": {
        "earned": Measure("points", "points"),
        "cost": Measure("points", "penalty"),
        "share": Measure("1", "factor"),
        "time_s": Measure("s", "measure", 2.0),
        "mass_kg": Measure("kg"),
    }
}
_CHECKS = ("p", "v", "w")
_NUMBERS = ("0", "1", "2", "10", "0.5", "0.7")
_OF_TRIAL = (
    *("points(p)", "count(v)", "holds(v)", "violated(w)", "gate(v)", "seconds(v)", "demerits(w, tau_s=5)"),
    *("product(v, p=0.6)", "occurrences(w, every_s=2)", "charged(v=2, w=1, again_after_s=5)"),
    *("measure(m, earned)", "measure(m, cost)", "measure(m, share)", "measure(m, time_s)"),
    *("measure(m, mass_kg)", "k", "trial.duration_s", "count(order)", "cohort.mean", "runs.pooled"),
)
_OF_PART = ("points(p)", "count(v)", "holds(v)", "order.index", "1", "2", "0.5")


def formulas(leaves: tuple[str, ...], depth: int = 3) -> st.SearchStrategy[str]:
    """Formulas of everything that the language has."""
    leaf = st.sampled_from((*leaves, *_NUMBERS))

    def larger(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
        several = st.lists(inner, min_size=2, max_size=4)
        return st.one_of(
            st.tuples(inner, st.sampled_from("+-*"), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
            st.tuples(inner, inner).map(lambda t: f"({t[0]} / (1 + abs({t[1]})))"),
            st.tuples(inner, inner).map(lambda t: f"({t[0]} / {t[1]})"),
            st.tuples(inner, st.sampled_from(("2", "0.5", "3"))).map(lambda t: f"({t[0]}) ** {t[1]}"),
            st.tuples(st.sampled_from(("0.9", "2")), inner).map(lambda t: f"{t[0]} ** ({t[1]})"),
            st.tuples(st.sampled_from(("min", "max", "sum", "mean", "any", "all")), several).map(
                lambda t: f"{t[0]}({', '.join(t[1])})"
            ),
            st.tuples(inner, inner, inner).map(lambda t: f"clip({t[0]}, {t[1]}, {t[2]})"),
            st.tuples(inner, inner, inner).map(lambda t: f"({t[0]} if {t[1]} else {t[2]})"),
            st.tuples(inner, st.sampled_from(("and", "or")), inner).map(lambda t: f"({t[0]} {t[1]} {t[2]})"),
            st.tuples(inner, st.sampled_from(("<", "<=", ">", ">=", "==", "!=")), inner).map(
                lambda t: f"({t[0]} {t[1]} {t[2]})"
            ),
            inner.map(lambda x: f"(not {x})"),
            inner.map(lambda x: f"-{x}"),
        )

    return st.recursive(leaf, larger, max_leaves=2**depth)


@st.composite
def findings(draw: st.DrawFn, parts: list[str]) -> dict[str, Finding]:
    made: dict[str, Finding] = {}
    for check in _CHECKS:
        for path in parts:
            for number in range(draw(st.integers(1, 2))):
                start_s = draw(st.integers(0, 20))
                verdict = draw(st.sampled_from((S, V, Verdict.NOT_APPLICABLE)))
                made[f"{check}#{len(made)}"] = Finding(
                    path,
                    verdict,
                    f"{check} {number}",
                    span=Span(start_s, start_s + draw(st.sampled_from((0.5, 1.0, 6.0)))),
                    check=check,
                    critical=draw(st.booleans()),
                )
    for _ in range(draw(st.integers(1, 2))):
        number = st.sampled_from((0.0, 0.4, 1.0, 2.0, 3.5))
        quantities = {name: draw(number) for name in MEASURES["m"]}
        made[f"m#{len(made)}"] = Finding("trial", S, "measured", check="m", quantities=quantities)
    return made


@st.composite
def cases(draw: st.DrawFn) -> Case:
    scopes = order(*draw(st.lists(st.integers(1, 2), min_size=1, max_size=3)))
    parts = [scope.path for scope in scopes.each("part")]
    aggregate = draw(st.sampled_from(("sum", "mean", "min", "max")))
    score = draw(formulas((*_OF_TRIAL, "total", f"{aggregate}(order.task)", "any(part.right > 1)")))
    try:
        return Case(
            score,
            draw(findings(parts)),
            scopes=scopes,
            measures=MEASURES,
            parameters={"k": 0.4},
            cohort=CohortValues(
                "", {"mean": {"": 4.0}, "runs.pooled": {"": draw(st.sampled_from((3.0, 9.5)))}}
            ),
            cohort_terms={"mean": CohortTerm("mean", "trial", Expression.parse("1"))},
            part={"right": draw(formulas(_OF_PART, 2))},
            order={
                "task": draw(st.sampled_from(("sum(part.right)", "max(part.right)", "count(part.right > 0)")))
            },
            trial={"total": "sum(order.task)", "pooled": "0.5 * count(v) + points(p)"},
        )
    except FormulaError:
        assume(False)
        raise


@given(cases())
@LAWFUL
def test_amounts_add_up_to_the_score_exactly_and_are_its_own(case: Case) -> None:
    nothing, kept, actual = case.tree.exact
    # Decided and computed by numbers of float64, and shared exactly: both are the same score.
    assert abs(float(actual) - case.score) <= 1e-9 * max(1.0, abs(case.score))
    tiny = Fraction(1, 10**30) * (1 + abs(actual) + abs(kept) + abs(nothing))
    assume(tiny < Fraction(1, 10**9))
    assert abs(sum(case.earned.values()) - (kept - nothing)) <= tiny or "runs" in case.sheet.score.source
    assert abs(sum(case.taken.values()) - (actual - kept)) <= tiny


@given(cases())
@LAWFUL
def test_a_printed_ledger_adds_up_in_every_line(case: Case) -> None:
    assume(abs(case.score) < 1e6)
    ledger = case.ledger

    reconcile(ledger, ledger.amount, digits=case.digits)
    assert sum((leaf.amount for leaf in ledger.leaves), Decimal(0)) == ledger.amount
    rounding = sum(abs(line.amount) for line in ledger.walk() if line.kind == "rounding")
    assert rounding <= Decimal("1e-6") * sum(1 for _ in ledger.walk())
    nominal = [line for line in ledger.leaves if line.kind != "rounding"]
    total = sum((line.amount if line.nominal is None else line.nominal for line in nominal), Decimal(0))
    event(f"has caps: {any(line.kind == 'cap' for line in nominal)}")
    assert abs(total - ledger.amount) <= Decimal("1e-6") * (1 + len(nominal))


@given(cases())
@LAWFUL
def test_every_finding_that_a_formula_asked_about_is_told_of(case: Case) -> None:
    assume(abs(case.score) < 1e6)
    told = {key for line in case.ledger.walk() for key in line.findings}
    asked = case.sheet.scored
    used = {key for key, finding in case.findings.items() if finding.check in asked}

    changed = {key for key, amount in (*case.taken.items(), *case.earned.items()) if amount and key in used}
    assert changed <= told
