"""Values across teams in score sheets: what a trial contributes, and what it is priced with."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import FormulaError, NeedsCohortError
from ariac_score.scoring.cohort import CohortTerm, CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.levels import declared_facts
from ariac_score.scoring.pricing import contribute, price
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score_ariac.competition import Ariac

CHECKS = frozenset({"time", "cost"})
TRIAL = Scope(
    "trial",
    "",
    {"duration_s": 60.0, "orders": 2},
    (Scope("order", "a", {"index": 0, "priority": 1}), Scope("order", "b", {"index": 1, "priority": 3})),
)
TERMS: Mapping[str, Mapping[str, str | int]] = {
    "order": {
        "done": "holds(time)",
        "time_s": "measure(time, s)",
        "points": 10,
        "efficiency": "cohort.mean_time_s / time_s if done else 0",
        "total": "order.priority * efficiency * points",
    },
    "trial": {"dollars": "measure(cost, dollars)"},
}
SCORE = "cohort.mean_cost / dollars * sum(order.total)"
TASK = "sum(order.points)"


def formula(text: str | int, where: str = "$.test") -> Expression:
    return Expression.parse(text, where=where)


def cohort_term(name: str, level: str, mean: str, where: str = "", empty: int | None = None) -> CohortTerm:
    return CohortTerm(name, level, formula(mean), formula(where) if where else None, empty)


MEAN_TIME = cohort_term("mean_time_s", "order", "time_s", "done", 0)
MEAN_COST = cohort_term("mean_cost", "trial", "dollars")


def sheet(
    score: str = SCORE,
    task: str | None = TASK,
    cohort: tuple[CohortTerm, ...] = (MEAN_TIME, MEAN_COST),
    terms: Mapping[str, Mapping[str, str | int]] = TERMS,
) -> ScoreSheet:
    return ScoreSheet(
        {level: {n: formula(text) for n, text in named.items()} for level, named in terms.items()},
        formula(score),
        CHECKS,
        cohort={term.name: term for term in cohort},
        task=None if task is None else formula(task),
        levels=Ariac.levels,
        facts=declared_facts(Ariac.facts),
    )


def findings(a_s: float = 20.0, b_s: float = 40.0, dollars: float | None = 500.0) -> dict[str, Finding]:
    cost = (
        Finding.inconclusive("team", "nobody says what it costs")
        if dollars is None
        else Finding("team", Verdict.SATISFIED, "", quantities={"dollars": dollars})
    )
    told = [
        Finding("a", Verdict.SATISFIED, "", quantities={"s": a_s}, check="time"),
        Finding("b", Verdict.SATISFIED, "", quantities={"s": b_s}, check="time"),
    ]
    named = {f"time#{i}": f for i, f in enumerate(told, start=1)}
    return {**named, "cost#1": Finding(**{**cost.__dict__, "check": "cost"})}


VALUES = CohortValues("abc", {"mean_time_s": {"a": 30.0, "b": 30.0}, "mean_cost": {"": 1000.0}})


def priced(values: CohortValues | None, told: dict[str, Finding] | None = None, **changes: object):  # type: ignore[no-untyped-def]
    return price(told or findings(), TRIAL, sheet(**changes), {}, digits=6, cohort=values)  # type: ignore[arg-type]


def test_a_score_against_the_cohort_is_priced_with_its_values() -> None:
    # 1000 / 500 * (1 * 30/20 * 10 + 3 * 30/40 * 10) = 2 * (15 + 22.5)
    assert float(priced(VALUES).ledger.amount) == 75.0


def test_without_a_cohort_the_task_score_stands_and_says_so() -> None:
    found = priced(None)

    assert (found.status, found.ledger, found.possible) == ("needs_cohort", None, None)
    assert float(found.task.amount) == 20.0
    assert "cohort.mean_time_s of a" in found.missing or "cohort.mean_cost" in found.missing


def test_a_value_for_one_order_does_not_stand_for_another() -> None:
    only_a = CohortValues("abc", {"mean_time_s": {"a": 30.0}, "mean_cost": {"": 1000.0}})

    assert priced(only_a).status == "needs_cohort"
    assert "of b" in priced(only_a).missing


def test_an_undecided_check_withholds_the_score_but_not_a_task_score_that_does_not_ask_it() -> None:
    found = priced(VALUES, findings(dollars=None))

    assert found.status == "incomplete"
    assert float(found.task.amount) == 20.0


def test_an_undecided_check_that_the_task_asks_about_withholds_it_too() -> None:
    found = priced(VALUES, findings(dollars=None), task="sum(order.points) - dollars")

    assert (found.status, found.task) == ("incomplete", None)


def test_a_check_that_only_an_unused_term_asks_about_withholds_nothing() -> None:
    found = priced(None, findings(dollars=None), score="sum(order.points)")

    assert (found.status, float(found.ledger.amount)) == ("scored", 20.0)


def test_contributions_name_each_order_and_say_which_count() -> None:
    told = findings()
    told["time#2"] = Finding("b", Verdict.VIOLATED, "late", quantities={"s": 99.0}, check="time")

    brought = contribute(told, TRIAL, sheet(), {})

    assert {(c.name, c.path, c.value, c.counted) for c in brought.values} == {
        ("mean_time_s", "a", 20.0, True),
        ("mean_time_s", "b", 99.0, False),
        ("mean_cost", "", 500.0, True),
    }
    assert brought.undecided == {}


def test_what_is_undecided_contributes_nothing_and_is_named() -> None:
    brought = contribute(findings(dollars=None), TRIAL, sheet(), {})

    assert {c.name for c in brought.values} == {"mean_time_s"}
    assert brought.undecided == {"mean_cost": "nobody says what it costs"}


@pytest.mark.parametrize(
    ("score", "cause"),
    [
        ("cohort.mean_cots", "unknown name 'cohort.mean_cots'"),
        ("cohort.mean_time_s", "unknown name 'cohort.mean_time_s'"),  # one for each order, none for the trial
    ],
)
def test_a_misspelt_or_misplaced_value_is_refused_on_loading(score: str, cause: str) -> None:
    with pytest.raises(FormulaError) as caught:
        sheet(score)
    assert caught.value.cause == cause


@pytest.mark.parametrize("mean", ["order.total", "total", "efficiency"])
def test_a_cohort_may_not_be_made_of_itself(mean: str) -> None:
    with pytest.raises(FormulaError, match="rests on a value across teams"):
        sheet(cohort=(MEAN_TIME, MEAN_COST, cohort_term("circle", "order", mean)))


def test_a_task_score_may_not_rest_on_other_teams() -> None:
    with pytest.raises(FormulaError, match="task rests on a value across teams"):
        sheet(task="sum(order.total)")


def test_a_sheet_knows_whether_it_needs_a_cohort() -> None:
    assert sheet().needs_cohort
    assert not sheet(score=TASK).needs_cohort


def test_asking_the_sheet_itself_for_a_missing_value_names_it() -> None:
    with pytest.raises(NeedsCohortError, match="comes from all teams"):
        sheet().evaluate(TRIAL, findings())
