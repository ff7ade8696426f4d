"""Which undecided findings a value hangs on; worked by hand from the meaning of the operators."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.scoring.doubt import doubts
from ariac_score.scoring.expression import Expression, Number
from ariac_score.scoring.levels import DeclaredFact
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet

NO_ORDER = Scope("trial", "", {})
CHECKS = frozenset({"yes", "no", "open", "other"})


def found(**verdicts: Verdict) -> dict[str, Finding]:
    return {f"{check}#1": Finding("o", verdict, "made", check=check) for check, verdict in verdicts.items()}


PARTS = {"order": {"parts": DeclaredFact()}}
FINDINGS = found(yes=Verdict.SATISFIED, no=Verdict.VIOLATED, open=Verdict.INCONCLUSIVE)


def hangs_on(formula: str, findings: Mapping[str, Finding] = FINDINGS) -> list[str]:
    sheet = ScoreSheet({}, Expression.parse(0), CHECKS, levels=("order", "trial"), facts=PARTS)
    traced = sheet.evaluate_in(Expression.parse(formula), NO_ORDER, findings)[""]
    return doubts(traced, findings, {k for k, f in findings.items() if f.verdict is Verdict.INCONCLUSIVE})


@pytest.mark.parametrize(
    ("formula", "open_"),
    [
        ("points(yes) + 1", False),
        ("points(open)", True),
        ("points(yes) + points(open)", True),
        ("holds(no) * points(open)", False),  # nothing times anything
        ("holds(yes) * points(open)", True),
        ("points(open) * holds(no)", False),
        ("holds(no) and points(open)", False),
        ("points(open) and holds(no)", True),  # it stopped at the open one
        ("holds(yes) or points(open)", False),
        ("points(open) or holds(yes)", False),
        ("1 if holds(yes) else points(open)", False),
        ("points(open) if holds(yes) else 1", True),
        ("1 if points(open) else 1", True),  # no algebra: what is asked counts
        ("points(open) == 0", True),
        ("-points(open)", True),
        ("max(points(open), 3)", True),
        ("sum(order.parts)", True),  # no order is known, and something open may be one
        ("0 * sum(order.parts)", False),
        ("charged(open=2, yes=1)", True),
        ("charged(yes=2, no=1, again_after_s=3)", False),
        ("demerits(open, tau_s=3)", True),
    ],
)
def test_what_a_formula_hangs_on(formula: str, open_: bool) -> None:
    assert hangs_on(formula) == (["open#1"] if open_ else [])


@pytest.mark.parametrize(("question", "open_"), [("holds", False), ("violated", False), ("count", True)])
def test_one_violation_decides_a_yes_or_no_but_no_number(question: str, open_: bool) -> None:
    both = {
        "other#1": Finding("o/a", Verdict.VIOLATED, "made", check="other"),
        "other#2": Finding("o/b", Verdict.INCONCLUSIVE, "made", check="other"),
    }

    assert hangs_on(f"{question}(other)", both) == (["other#2"] if open_ else [])


FORMULAS = st.recursive(
    st.sampled_from(["holds(yes)", "holds(no)", "holds(open)", "violated(other)", "1", "0", "2"]),
    lambda inner: (
        st.builds(
            lambda a, op, b: f"({a} {op} {b})",
            inner,
            st.sampled_from(["+", "*", "-", "and", "or", "=="]),
            inner,
        )
        | st.builds(lambda c, a, b: f"({a} if {c} else {b})", inner, inner, inner)
    ),
    max_leaves=8,
)


@given(FORMULAS)
def test_a_value_in_no_doubt_is_the_same_however_the_open_ones_turn_out(formula: str) -> None:
    sheet = ScoreSheet(terms={}, score=Expression.parse(0), checks=CHECKS)
    open_ = {"open": Verdict.INCONCLUSIVE, "other": Verdict.INCONCLUSIVE}
    findings = {**FINDINGS, **found(**open_)}

    def value(**turned: Verdict) -> Number:
        decided = {**FINDINGS, **found(**turned)}
        return sheet.evaluate_in(Expression.parse(formula), NO_ORDER, decided)[""].value

    if not hangs_on(formula, findings):
        ways = [Verdict.SATISFIED, Verdict.VIOLATED]
        assert len({value(open=one, other=two) for one in ways for two in ways}) == 1
