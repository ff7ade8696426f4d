"""What a sweep may not set is refused at once, and names that formulas use are nobody else's."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score import load_rule_set
from ariac_score.errors import RuleSetError, UsageError
from ariac_score.scoring.ruleset import draft_rule_set

RULES = """\
id: made
title: Made
source: this test
log_map: none
levels: [order, trial]
monitors: {NAME: {use: ariac.no_event, with: {kind: crash}}}
score: 1
"""


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"separation.t1_s": math.nan}, "'separation.t1_s' cannot be 'nan'"),
        ({"separation.t1_s": math.inf}, "'separation.t1_s' cannot be 'inf'"),
        ({"separation.t1_s": np.float64("nan")}, "cannot be 'nan'"),
        ({"separation.t1_s": np.array([1.0, 2.0])}, "no finite number"),
        ({"separation.t1_s": object()}, "no finite number"),
        ({"separation.t1_s": -1.0}, "t1_s is -1 but cannot be negative"),
        ({"separation.t1_s": "soon"}, "'soon' is not a float"),
        ({"separation.reach_m": 1.0}, "has no parameter 'reach_m'"),
        ({"separation_weight": math.nan}, "'separation_weight' cannot be 'nan'"),
        ({"nobody.reach_m": 1.0}, "no parameter 'nobody.reach_m'"),
    ],
)
def test_a_sweep_over_what_cannot_be_is_refused_before_anything_is_scored(
    values: dict[str, Any], message: str
) -> None:
    with pytest.raises(RuleSetError, match=message):
        load_rule_set("paper2020.published").with_parameters(values)


def test_a_sweep_takes_numbers_of_numpy() -> None:
    rules = load_rule_set("paper2020.published").with_parameters({"separation.t1_s": np.float32(0.5)})

    assert rules.checks["separation"].parameters["t1_s"] == 0.5
    assert rules.with_score(np.int64(3)).expanded["score"] == 3


@pytest.mark.parametrize("name", ["count", "ramp", "score", "order", "trial", "runs", "cohort", "if"])
def test_no_check_has_a_name_that_formulas_use_for_something_else(name: str) -> None:
    with pytest.raises(RuleSetError, match=f"check '{name}' is also the name of a") as caught:
        draft_rule_set(RULES.replace("NAME", name), file="made.yaml")

    assert f"$.monitors.{name}" in caught.value.place
    assert "clip, cohort, count" in caught.value.hint


def test_any_other_name_is_a_check_s_own() -> None:
    assert [*draft_rule_set(RULES.replace("NAME", "counted"), file="made.yaml").checks] == ["counted"]


def test_a_rule_set_named_without_the_ending_of_its_file_is_meant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "arena.yaml").write_text(RULES)
    monkeypatch.chdir(tmp_path)

    with pytest.raises(UsageError, match="no rule set 'arena'") as caught:
        load_rule_set("arena")

    assert caught.value.hint == "did you mean the file 'arena.yaml'?"
