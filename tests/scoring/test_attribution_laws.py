"""Laws of the ledger, tried on random rule sets of the whole language and random findings."""

from __future__ import annotations

import ast
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.errors import FormulaError
from ariac_score.scoring.cohort import CohortTerm, CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.ledger import _nodes, reconcile
from ariac_score.scoring.shares import Exact
from ariac_score.trial.spans import Span

from .attributed import Case, S, V, found, order, times

pytestmark = pytest.mark.slow
LAWFUL = settings(max_examples=40, derandomize=True, deadline=None)

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
    assert abs(sum(case.earned.values()) - (kept - nothing)) <= tiny or "cohort" in case.sheet.score.source
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


# Two ways to say the same --------------------------------------------------------------

_FACTORS = (
    *("product(v, p=0.6)", "gate(w)", "1 / (1 + 0.4 * count(v))"),
    *("(2 - measure(m, share))", "0.5 ** count(w)"),
)
_SUMMANDS = (
    *("points(p)", "3 * measure(m, earned)", "-count(v)", "7"),
    *("measure(m, cost)", "(1 if holds(w) else 0)"),
)


def _nested(data: st.DataObject, parts: list[str], sign: str) -> str:
    """The same parts in another order and other brackets."""
    parts = data.draw(st.permutations(parts))
    while len(parts) > 1:
        at = data.draw(st.integers(0, len(parts) - 2))
        parts[at : at + 2] = [f"({parts[at]} {sign} {parts[at + 1]})"]
    return parts[0]


@given(st.data())
@LAWFUL
def test_brackets_order_and_names_of_terms_change_no_amount(data: st.DataObject) -> None:
    found = data.draw(findings(["o0/p0"]))

    def amounts_of(formula: str, **terms: dict[str, str]) -> list[dict[str, Exact]]:
        case = Case(formula, found, scopes=order(1), measures=MEASURES, **terms)
        return [{k: v for k, v in each.items() if v} for each in (case.earned, case.taken)]

    factors = data.draw(st.lists(st.sampled_from(_FACTORS), min_size=2, max_size=4, unique=True))
    summands = data.draw(st.lists(st.sampled_from(_SUMMANDS), min_size=2, max_size=4, unique=True))
    least = data.draw(st.sampled_from(("min", "max")))
    flat = f"{least}({', '.join(summands)}, 5) + ({' + '.join(summands)}) * {' * '.join(factors)}"

    shuffled = data.draw(st.permutations(summands))
    cut = data.draw(st.integers(1, len(shuffled) - 1))
    inner = f"{least}({', '.join(shuffled[cut:])}, 5)"
    other = f"{least}({', '.join([*shuffled[:cut], inner])})"
    zebra = _nested(data, [*factors, f"({_nested(data, list(summands), '+')})"], "*")
    assert amounts_of(flat) == amounts_of("aardvark + zebra", trial={"zebra": zebra, "aardvark": other})


@given(cases(), st.sampled_from((2, 10, 64)))
@LAWFUL
def test_a_score_in_other_units_has_amounts_in_other_units(case: Case, by: int) -> None:
    larger = Case(
        f"{by} * ({case.sheet.score.source})",
        case.findings,
        scopes=case.scopes,
        measures=case.measures,
        parameters=dict(case.sheet.parameters),
        cohort=case.cohort,
        cohort_terms=dict(case.sheet.cohort),
        **{level: {n: f.source for n, f in each.items()} for level, each in case.sheet.terms.items()},
    )
    assume("cohort" not in case.sheet.score.source)
    for ours, theirs in ((case.earned, larger.earned), (case.taken, larger.taken)):
        assert {k for k, v in ours.items() if v} == {k for k, v in theirs.items() if v}
        for key, amount in ours.items():
            assert abs(by * amount - theirs[key]) <= Fraction(1, 10**25) * (1 + abs(theirs[key]))


@given(cases())
@LAWFUL
def test_findings_that_are_alike_have_amounts_that_are_alike(case: Case) -> None:
    alike: dict[tuple[object, ...], list[str]] = {}
    for key, finding in case.findings.items():
        made = (finding.check, finding.subject, finding.verdict, finding.critical, finding.span)
        alike.setdefault((*made, tuple(finding.quantities.items())), []).append(key)
    # What `charged` charges once, it charges to the first of two that cover the same time.
    assume("charged" not in case.sheet.score.source)
    for keys in alike.values():
        assert len({case.taken.get(key, 0) for key in keys}) == 1
        assert len({case.earned.get(key, 0) for key in keys}) == 1


def _again(case: Case, score: str, findings: dict[str, Finding]) -> Case:
    """The same rules with another score, or about other findings."""
    terms = {level: {n: f.source for n, f in each.items()} for level, each in case.sheet.terms.items()}
    try:
        return Case(
            score,
            findings,
            scopes=case.scopes,
            measures=case.measures,
            parameters=dict(case.sheet.parameters),
            cohort=case.cohort,
            cohort_terms=dict(case.sheet.cohort),
            **terms,
        )
    except FormulaError:
        assume(False)
        raise


def _same(ours: dict[str, Exact], theirs: dict[str, Exact]) -> bool:
    """Whether all amounts are the same, but for the last digits of logarithms."""
    most = max((abs(Fraction(by)) for by in (*ours.values(), *theirs.values())), default=Fraction(0))
    tiny = Fraction(1, 10**25) * (1 + most)
    return all(abs(Fraction(ours.get(k, 0)) - theirs.get(k, 0)) <= tiny for k in ours.keys() | theirs.keys())


@given(cases(), st.data())
@LAWFUL
def test_a_finding_that_changes_no_number_gets_nothing(case: Case, data: st.DataObject) -> None:
    assume("charged" not in case.sheet.score.source)
    check = data.draw(st.sampled_from(("v", "w")))
    of_check = [k for k, f in case.findings.items() if f.check == check]
    violated = [k for k in of_check if case.findings[k].verdict is V]
    spared = {k: replace(case.findings[k], verdict=S) for k in violated[1:]}  # of two each has a share
    alone = _again(case, case.sheet.score.source, case.findings | spared)
    kept = {k: replace(case.findings[k], verdict=S) for k in violated}
    without = _again(case, case.sheet.score.source, case.findings | kept)

    changed = [node.exact for node in _nodes(alone.tree)] != [node.exact for node in _nodes(without.tree)]
    event(f"changes something: {changed}")
    for key in of_check if not changed else of_check[:0]:
        assert not alone.taken.get(key)
        assert not alone.earned.get(key)


@given(cases(), st.data())
@LAWFUL
def test_any_formula_in_other_brackets_and_another_order_has_the_same_amounts(
    case: Case, data: st.DataObject
) -> None:
    root = Expression.parse(case.sheet.score.source).root
    other = _again(case, ast.unparse(_rearranged(root, data)), case.findings)
    assume(abs(other.score - case.score) <= 1e-12 * (1 + abs(case.score)))

    event(f"has amounts: {bool(case.taken or case.earned)}")
    assert _same(case.earned, other.earned)
    assert _same(case.taken, other.taken)


def _rearranged(node: ast.expr, data: st.DataObject) -> ast.expr:
    """The same sums, products, minima and maxima in another order and other brackets."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Mult):
        parts, kind, stack = [], type(node.op), [node.right, node.left]
        while stack:
            part = stack.pop()
            if isinstance(part, ast.BinOp) and isinstance(part.op, kind):
                stack += [part.right, part.left]
            else:
                parts.append(_rearranged(part, data))
        parts = data.draw(st.permutations(parts))
        while len(parts) > 1:
            at = data.draw(st.integers(0, len(parts) - 2))
            parts[at : at + 2] = [ast.BinOp(parts[at], node.op, parts[at + 1])]
        return parts[0]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("min", "max"):
        if len(node.args) < 2:
            return node
        inside = data.draw(st.permutations([_rearranged(each, data) for each in node.args]))
        cut = data.draw(st.integers(1, len(inside) - 1))
        nested = ast.Call(node.func, inside[cut:], []) if len(inside) - cut > 1 else inside[cut]
        return ast.Call(node.func, [*inside[:cut], nested], [])
    return node


@given(st.data(), st.sampled_from((0.25, 0.5, 0.75)))
@LAWFUL
def test_in_any_formula_an_additive_quantity_told_in_two_pieces_leaves_the_others(
    data: st.DataObject, cut: float
) -> None:
    made = data.draw(findings(["o0/p0"]))
    costs = data.draw(st.lists(st.sampled_from((0.4, 1.0, 2.0)), min_size=1, max_size=2))
    whole = dict(found("z", V, i, cost=cost) for i, cost in enumerate(costs))
    pieces = {k: f for k, f in whole.items() if k != "z#0"} | dict(
        found("z", V, i, cost=cost) for i, cost in ((8, cut * costs[0]), (9, costs[0] - cut * costs[0]))
    )
    leaves = tuple(leaf for leaf in _OF_TRIAL if "cohort" not in leaf and "runs" not in leaf)
    formula = data.draw(formulas((*leaves, "measure(z, cost)", "measure(z, cost)")))
    measures = MEASURES | {"z": {"cost": Measure("1", "penalty")}}
    try:
        one, two = (
            Case(formula, made | each, scopes=order(1), measures=measures, parameters={"k": 0.4})
            for each in (whole, pieces)
        )
    except FormulaError:
        assume(False)
        raise
    event(f"z pays: {bool(one.taken.get('z#0'))}")
    for ours, theirs in ((one.taken, two.taken), (one.earned, two.earned)):
        mine = {k: v for k, v in ours.items() if k != "z#0"}
        assert _same(mine, {k: v for k, v in theirs.items() if k not in ("z#8", "z#9")})


@given(cases(), st.sampled_from(("p", "v", "w")))
@LAWFUL
def test_a_violation_that_no_formula_asks_about_changes_nothing(case: Case, check: str) -> None:
    assume(check not in case.sheet.scored)
    changed = {key for key in (*case.taken, *case.earned) if key in case.findings}
    assert not {key for key in changed if case.findings[key].check == check}


_COSTS = st.floats(0.0, 3.0).map(lambda x: round(x, 3))


@given(st.lists(_COSTS, min_size=2, max_size=5), st.floats(0.05, 0.95))
@LAWFUL
def test_what_is_told_in_two_pieces_costs_others_the_same(costs: list[float], cut: float) -> None:
    share = round(costs[0] * round(cut, 3), 6)
    whole = dict(found("x", V, i, cost=cost) for i, cost in enumerate(costs))
    rest = round(costs[0] - share, 6)
    both = dict([found("x", V, len(costs), cost=share), found("x", V, len(costs) + 1, cost=rest)])
    pieces = {key: finding for key, finding in whole.items() if key != "x#0"} | both
    measures = {"x": {"cost": Measure("1", "penalty")}}
    formulas = ("100 / (1 + {})", "9 * 0.5 ** {}", "max(0, 8 - {}) * 3")
    for formula in (each.format("measure(x, cost)") for each in formulas):
        one, two = (Case(formula, f, measures=measures).taken for f in (whole, pieces))
        for key in (*whole,)[1:]:
            assert abs(one.get(key, 0) - two.get(key, 0)) <= Fraction(1, 10**12)


_GRADED = st.sampled_from((_FACTORS[2], _FACTORS[4]))


@given(st.integers(0, 3), st.integers(0, 3), st.integers(1, 2), _GRADED)
@LAWFUL
def test_closing_a_gate_leaves_what_was_near_as_expensive(
    near: int, far: int, closed: int, factor: str
) -> None:
    def taken(verdict: Verdict) -> dict[str, Exact]:
        made = [*times("v", near), *times("w", far), *times("g", closed, verdict)]
        made += [found("v", S, 9), found("w", S, 9)]
        return {k: v for k, v in Case(f"12 * {factor} * holds(g)", made).taken.items() if k[0] != "g"}

    assert taken(V) == taken(S)
