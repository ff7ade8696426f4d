"""A score in two parts, task and safety: who was good, and who was safe."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import pytest

from ariac_score import RuleSet, load_result, load_rule_set, reprice
from ariac_score.results.result import Result
from ariac_score.review.task_and_safety import TaskAndSafety, task_and_safety
from ariac_score.scoring.cohort import CohortValues

EXAMPLE = Path(__file__).parents[2] / "tests/data/as_published/kitting_near_miss.result.json"
TASK = 28
"""What the work of the example is worth by hand (tests/test_same_bytes.py)."""


@pytest.fixture(scope="module")
def near_miss() -> Result:
    return load_result(EXAMPLE)


@pytest.fixture(scope="module")
def rules() -> RuleSet:
    return load_rule_set("paper2020.published")


def split(result: Result, rules: RuleSet, score: str) -> TaskAndSafety:
    """The parts of the example under another formula for the score."""
    found = task_and_safety(reprice(result, rules.with_score(score)))
    assert found is not None
    return found


def test_the_near_miss_cost_eight_of_twenty_eight_points(near_miss: Result) -> None:
    found = task_and_safety(near_miss)

    assert found is not None
    assert found.task == TASK
    assert found.safety == near_miss.score - TASK == Decimal("-8.238323")
    assert found.score == near_miss.score
    assert found.has_safety


def test_what_the_task_brought_does_not_depend_on_how_dear_safety_is(
    near_miss: Result, rules: RuleSet
) -> None:
    dear = split(near_miss, rules, "task / (1 + 100 * demerits)")
    closed = split(near_miss, rules, "task if holds(separation) else 0")

    assert dear.task == closed.task == TASK
    assert closed.safety == -TASK


def test_a_violated_rule_is_no_matter_of_safety(near_miss: Result, rules: RuleSet) -> None:
    found = split(near_miss, rules, "task - 3 * count(none_missing) - 5 * count(separation)")

    # One kit of the example lacks a part: none_missing is violated once, and so is separation.
    assert (found.task, found.safety) == (TASK - 3, -5)


def test_without_a_priced_monitor_nothing_could_cost(near_miss: Result, rules: RuleSet) -> None:
    found = split(near_miss, rules, "sum(order.total)")

    assert (found.task, found.safety, found.has_safety) == (TASK, 0, False)


def test_a_score_without_work_is_what_safety_left_of_it(near_miss: Result, rules: RuleSet) -> None:
    found = split(near_miss, rules, "100 - 10 * count(separation)")

    assert (found.task, found.safety) == (100, -10)


def test_what_monitors_found_in_other_runs_of_the_team_is_safety_too(
    near_miss: Result, rules: RuleSet
) -> None:
    pooled = CohortValues(values={"runs.demerits": {"": 3.0}})
    found = task_and_safety(reprice(near_miss, rules.with_score("task / (1 + runs.demerits)"), pooled))

    assert found is not None
    assert (found.task, found.safety) == (TASK, 28 / Decimal(4) - TASK)


def test_what_rules_found_in_other_runs_of_the_team_stays_with_the_task(
    near_miss: Result, rules: RuleSet
) -> None:
    pooled = CohortValues(values={"runs.task": {"": 50.0}})
    found = task_and_safety(reprice(near_miss, rules.with_score("runs.task - 5 * count(separation)"), pooled))

    assert found is not None
    assert (found.task, found.safety) == (50, -5)


def test_without_a_score_there_is_nothing_to_split(near_miss: Result) -> None:
    withheld = replace(near_miss, status="incomplete", score=None, ledger=None)

    assert task_and_safety(withheld) is None


def test_where_the_rules_have_no_value_without_the_violation_nothing_is_said(
    near_miss: Result, rules: RuleSet
) -> None:
    found = reprice(near_miss, rules.with_score("task / count(separation)"))

    assert found.score == TASK
    assert task_and_safety(found) is None
