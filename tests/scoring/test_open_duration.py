"""A formula that names the duration of a trial is priced in the shortest and in the longest competition."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.open_findings import Cause, OpenFindings
from ariac_score.scoring.cohort import CohortTerm, CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.left_open import LeftOpen
from ariac_score.scoring.pricing import Priced, contribute, counted_world, price, value_of
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.trial.spans import Span
from ariac_score.trial.window import Lasted

STATED_S = 58.0
TRIAL = Scope("trial", "", {"duration_s": STATED_S})
WHY = "the log tells only roughly when the competition was"


def sheet(score: str, **terms: str) -> ScoreSheet:
    formulas = {name: Expression.parse(text, where=name) for name, text in terms.items()}
    return ScoreSheet({"trial": formulas}, Expression.parse(score, where="score"), frozenset({"near"}))


def lasting(least_s: float, most_s: float | None, counts: str = "worst") -> LeftOpen:
    return LeftOpen(counts=counts, lasted=Lasted(least_s, most_s, WHY))


def priced(score: str, left_open: LeftOpen, **terms: str) -> Priced:
    return price({}, TRIAL, sheet(score, **terms), {}, digits=3, left_open=left_open)


def ends(one: Priced) -> tuple[float, float] | None:
    return None if one.interval is None else (float(one.interval.least), float(one.interval.most))


@pytest.mark.parametrize(
    ("score", "least", "most"),
    [
        ("100 - trial.duration_s", 40.0, 50.0),
        ("trial.duration_s / 10", 5.0, 6.0),  # rules that pay for waiting
        ("max(0, 55 - trial.duration_s)", 0.0, 5.0),
        ("300 / trial.duration_s", 5.0, 6.0),
        ("bonus * 2", 80.0, 100.0),
    ],
)
def test_the_score_lies_between_those_of_the_shortest_and_of_the_longest(
    score: str, least: float, most: float
) -> None:
    found = priced(score, lasting(50.0, 60.0), bonus="100 - trial.duration_s")

    assert ends(found) == (least, most)
    assert found.ledger is not None
    assert float(found.ledger.amount) == least
    assert found.interval is not None
    assert found.interval.tight
    (narrows,) = found.interval.narrowing
    assert (narrows.cause, narrows.checks, narrows.findings) == (WHY, (), ())
    assert narrows.at_most == found.interval.most - found.interval.least


def test_terms_of_the_work_inside_may_name_it() -> None:
    inside = ScoreSheet(
        {"task": {"share": Expression.parse("trial.duration_s / 10", where="share")}, "trial": {}},
        Expression.parse("sum(task.share)", where="score"),
        frozenset(),
        levels=("task", "trial"),
    )
    two = replace(TRIAL, inner=(Scope("task", "a"), Scope("task", "b")))

    assert ends(price({}, two, inside, {}, digits=3, left_open=lasting(50.0, 60.0))) == (10.0, 12.0)


def test_the_end_that_counts_is_that_of_the_rules() -> None:
    best = priced("100 - trial.duration_s", lasting(50.0, 60.0, "best"))
    none = priced("100 - trial.duration_s", lasting(50.0, 60.0, "withhold"))

    assert best.ledger is not None
    assert best.ledger.amount == Decimal("50.000")
    assert none.status == "incomplete"
    assert none.ledger is None
    assert ends(none) == ends(best) == (40.0, 50.0)


def test_a_formula_that_does_not_name_it_is_not_open() -> None:
    found = priced("7", lasting(50.0, None))

    assert (found.status, found.interval) == ("scored", None)


def test_what_is_stated_exactly_has_its_value() -> None:
    found = priced("100 - trial.duration_s", LeftOpen())

    assert found.interval is None
    assert found.ledger is not None
    assert found.ledger.amount == Decimal("42.000")


@pytest.mark.parametrize(
    ("score", "least", "most"),
    [
        ("98 / (1 + trial.duration_s)", 0.0, 2.0),
        ("min(trial.duration_s, 80)", 48.0, 80.0),
        ("max(0, 50 - trial.duration_s)", 0.0, 2.0),
    ],
)
def test_without_a_known_end_a_formula_has_the_least_that_it_allows(
    score: str, least: float, most: float
) -> None:
    found = priced(score, lasting(48.0, None))

    assert ends(found) == (least, most)
    assert found.ledger is not None
    assert float(found.ledger.amount) == least


@pytest.mark.parametrize("score", ["100 - trial.duration_s", "trial.duration_s"])
def test_a_formula_without_an_end_is_refused_with_the_reason(score: str) -> None:
    found = priced(score, lasting(48.0, None))

    assert (found.status, found.ledger, found.interval) == ("incomplete", None, None)
    assert found.missing == f"nothing bounds trial.duration_s of the trial: {WHY}"


FORMULAS = (
    "100 - trial.duration_s",
    "abs(trial.duration_s - 55)",
    "(trial.duration_s - 55) * (trial.duration_s - 52)",
    "20 if trial.duration_s < 56 else 3",
    "clip(trial.duration_s / 10, 5.2, 5.9) - trial.duration_s / 20",
)


@given(st.sampled_from(FORMULAS), st.floats(50.0, 60.0))
def test_no_duration_in_between_is_beyond_either_end(score: str, lasts_s: float) -> None:
    exact = sheet(score).evaluate(replace(TRIAL, facts={"duration_s": lasts_s}), {}).value

    found = priced(score, lasting(50.0, 60.0))
    least, most = ends(found) or (float("nan"),) * 2

    assert least - 1e-3 <= exact <= most + 1e-3


def test_gaps_with_the_same_cause_are_decided_together() -> None:
    """10 points for each violation, of which there are 1 to 2, and one for each second."""
    near = [
        Finding("robot", Verdict.VIOLATED, "too near", Span(10.0 * k, 10.0 * k + 1.0), check="near")
        for k in (1, 2)
    ]
    worlds = OpenFindings(
        "near", "robot", {"near#1": near[0]}, {"near#2": near[0], "near#3": near[1]}, (Cause(WHY),), True
    )
    left_open = replace(lasting(50.0, 60.0), findings=(worlds,))
    score = sheet("100 - trial.duration_s - 10 * count(near)")

    found = price({}, TRIAL, score, {}, digits=3, left_open=left_open)

    assert ends(found) == (20.0, 40.0)
    assert found.interval is not None
    assert [(one.cause, one.checks, one.at_most) for one in found.interval.narrowing] == [
        (WHY, ("near",), Decimal("20.000"))
    ]
    world = counted_world({}, TRIAL, score, {}, cohort=CohortValues(), measures={}, left_open=left_open)
    assert sorted(world.findings) == ["near#2", "near#3"]
    assert world.trial.facts["duration_s"] == 60.0
    assert value_of({}, TRIAL, score, {}, left_open=left_open) == 20.0


def test_a_value_across_teams_that_needs_it_is_undecided() -> None:
    of_all = ScoreSheet(
        {"trial": {}},
        Expression.parse("cohort.usual", where="score"),
        frozenset(),
        cohort={"usual": CohortTerm("usual", "trial", Expression.parse("trial.duration_s", where="usual"))},
    )

    assert contribute({}, TRIAL, of_all, {}, left_open=lasting(50.0, 60.0)).undecided == {"usual": WHY}
    assert not contribute({}, TRIAL, of_all, {}).undecided
