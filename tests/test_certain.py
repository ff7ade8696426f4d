"""When a formula has a certain value: worked by hand from what each formula names."""

from __future__ import annotations

import pytest

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.results.result import Measured
from ariac_score.review.certainty import Certain
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.ruleset import draft_rule_set
from ariac_score.scoring.scope import Scope

RULES = """
id: made
title: Made
source: made
log_map: ariac2020
rules:
  kept: {use: kitting.part_pose}
monitors:
  timing: {use: official.order}
parameters: {min_duration_s: 5}
terms:
  trial:
    whole_s: trial.duration_s
    late: 1 if whole_s > 60 else 0
    printed_s: measure(timing, duration_s)
    # So that every number that is named is used.
    used: min_duration_s
score: late
"""
FINDINGS = {
    "timing#1": Finding("", Verdict.SATISFIED, "made", quantities={"duration_s": 40.0}, check="timing"),
    "kept#1": Finding("", Verdict.NOT_APPLICABLE, "no part was ordered", check="kept"),
}


def certain(formula: str, *, timed: bool) -> tuple[float | None, str]:
    measured = Measured("t", FINDINGS, Scope("trial", "", {"duration_s": 70.0}))
    rules = draft_rule_set(RULES, file="made")
    value = Certain(rules, measured, timed=timed).value(Expression.parse(formula), "trial", "")
    return (value.traced.value if value.traced else None), value.reason


@pytest.mark.parametrize("formula", ["trial.duration_s", "trial.duration_s / 2", "whole_s", "late + 1"])
def test_without_both_ends_nothing_that_rests_on_the_duration_is_certain(formula: str) -> None:
    value, reason = certain(formula, timed=False)

    assert (value, reason) == (None, "the log does not show when the competition began and ended")
    assert certain(formula, timed=True)[0] is not None


@pytest.mark.parametrize(
    ("formula", "expected"),
    [("measure(timing, duration_s)", 40), ("printed_s", 40), ("min_duration_s", 5), ("2", 2)],
)
def test_what_only_has_the_word_in_a_name_is_certain_without_them(formula: str, expected: float) -> None:
    assert certain(formula, timed=False) == (expected, "")


def test_a_question_about_what_does_not_apply_has_no_certain_answer() -> None:
    assert certain("holds(kept)", timed=True) == (None, "kept: not applicable: no part was ordered")
    assert certain("holds(timing)", timed=True) == (1, "")
