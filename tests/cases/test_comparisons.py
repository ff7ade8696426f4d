"""Every difference between rulebook and code that a worked case shows is explained by the rule set."""

from __future__ import annotations

import runpy
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from ariac_score import load_rule_set, measure_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.review.certainty import Certain
from ariac_score.review.comparison import Comparison, compare_rules

WORKED = runpy.run_path(str(Path(__file__).parent / "test_worked_cases.py"))
REGISTRY = Registry()
CASES = [p for p in WORKED["worked_cases"]() if load_rule_set(p.values[0]["rules"]).differs]


def certain(case: Mapping[str, Any], rules: str) -> Certain:
    rule_set = load_rule_set(rules)
    trial = WORKED["trial_of"](case)
    return Certain(rule_set, measure_trial(trial, prepare(rule_set, registry=REGISTRY)))


def compared(case: Mapping[str, Any]) -> Comparison:
    differs = load_rule_set(case["rules"]).differs
    assert differs is not None
    return compare_rules(certain(case, differs.other), certain(case, case["rules"]))


@pytest.mark.parametrize("case", CASES)
def test_no_difference_is_unexplained(case: Mapping[str, Any]) -> None:
    comparison = compared(case)

    assert [change for change in comparison.changes if change.unexplained] == []


@pytest.mark.parametrize("case", [p for p in CASES if "differs" in p.values[0]])
def test_the_difference_a_case_shows_is_among_the_reasons(case: Mapping[str, Any]) -> None:
    comparison = compared(case)
    named = {reason.name for change in comparison.changes for reason in change.reasons}

    # What only a score shows that compares teams, such as a factor, is not seen before it is known.
    assert case["differs"] in named or (not comparison.changes and comparison.undecided)
