"""What rule sets say of their difference from others: all that the notes mark, nothing unheard of."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pytest
import yaml

from ariac_score import RuleSet, load_rule_set
from ariac_score.errors import RuleSetError
from ariac_score.scoring.ruleset import expanded_yaml, rule_set_from_text, rule_set_names

WORKED = Path(__file__).parents[1] / "cases/worked"

# The differences that the rulebook notes mark, by edition, under the names they have here.
MARKED = {
    "ariac2017.as_documented": {"second_order"},
    "ariac2018.as_documented": {"second_order", "greedy_poses"},
    "ariac2019.as_documented": {"later_orders", "gantry_models"},
    "ariac2020.as_documented": {"pose_of_wrong_color", "later_orders", "shipped_tests", "collisions"},
    "ariac2021.tip_as_documented": {"wrong_color_pose", "assembly_bonus", "penalty_after_collision"},
    "ariac2021.qualifiers_as_documented": {"wrong_color_pose", "penalty_after_collision"},
    "ariac2021.finals_as_documented": {"wrong_color_pose", "penalty_after_collision"},
    "ariac2022.as_documented": {
        "no_tray",
        "wrong_tray_type",
        "tray_distance",
        "tray_turn",
        "assembly_yaw",
        "collisions",
    },
    "ariac2023.as_documented": {"flipped", "challenged_quadrant", "assembled_rotation", "not_inserted"},
    "ariac2024.as_documented": {
        "wrong_tray",
        "never_negative",
        "challenged_quadrant",
        "wrong_pose",
        "priority",
    },
    "ariac2025.as_documented": {"time_bonus", "over_budget"},
    "ariac2023.evaluation": {"cost_average", "time_average", "priority_order", "no_clamp"},
    "ariac2024.evaluation": {"cost_average", "time_average", "priority_order", "no_clamp"},
    "aic2026.qualification_as_documented": {"unseen_path", "unseen_force", "unseen_contacts"},
}
# What no case can show, because both sides give one number: how contacts are recorded, tests that are
# not built, a price per dollar that the document leaves open and so is the code's, and (of the
# evaluation scripts) whose times count and in which order, where the page is silent or has two answers,
# and kits below 0, which cannot be in 2023.
WITHOUT_CASE = {
    "ariac2019.as_documented": {"gantry_models"},
    "ariac2020.as_documented": {"shipped_tests"},
    "ariac2025.as_documented": {"over_budget"},
    "ariac2023.evaluation": {"time_average", "priority_order", "no_clamp"},
    "ariac2024.evaluation": {"time_average", "priority_order"},
    # What a recording lacks is shown with recordings: tests/plugins/aic/test_runs.py.
    "aic2026.qualification_as_documented": {
        "unseen_path",
        "unseen_force",
        "unseen_contacts",
        "unseen_insertion",
        "unseen_velocity",
    },
}


def terms_and_checks(rule_set: RuleSet) -> tuple[set[str], set[str]]:
    terms = {f"{level}.{name}" for level, named in rule_set.sheet.terms.items() for name in named}
    terms |= {f"cohort.{name}" for name in rule_set.sheet.cohort}
    return terms | {"score", "task"}, set(rule_set.checks)


@pytest.mark.slow
def test_every_documented_rule_set_says_in_what_it_differs() -> None:
    saying = {name for name in rule_set_names() if load_rule_set(name).differs}

    assert saying == {name for name in rule_set_names() if name.endswith(("as_documented", ".evaluation"))}
    assert saying == set(MARKED)


@pytest.mark.parametrize("name", MARKED)
def test_every_marked_difference_is_named_once(name: str) -> None:
    differs = load_rule_set(name).differs
    assert differs is not None
    names = [difference.name for difference in differs.because]

    assert MARKED[name] <= set(names)
    assert len(names) == len(set(names))


@pytest.mark.parametrize("name", MARKED)
def test_every_term_and_check_of_a_difference_exists_in_one_of_the_two(name: str) -> None:
    rule_set = load_rule_set(name)
    assert rule_set.differs is not None
    both = [terms_and_checks(which) for which in (rule_set, load_rule_set(rule_set.differs.other))]

    for difference in rule_set.differs.because:
        assert difference.terms or difference.checks
        assert set(difference.terms) <= both[0][0] | both[1][0], difference.name
        assert set(difference.checks) <= both[0][1] | both[1][1], difference.name


@cache
def shown_by_cases() -> frozenset[tuple[str, str]]:
    """The differences that cases show: the rule set and the name of each."""
    return frozenset(
        (case.get("rules", told["rules"]), case["differs"])
        for file in sorted(WORKED.glob("*.yaml"))
        for told in [yaml.safe_load(file.read_text(encoding="utf-8"))]
        for case in told["cases"]
        if "differs" in case
    )


@pytest.mark.parametrize("name", MARKED)
def test_every_difference_has_a_case_worked_by_hand(name: str) -> None:
    differs = load_rule_set(name).differs
    assert differs is not None
    shown = {of for rules, of in shown_by_cases() if rules == name}

    assert {d.name for d in differs.because} - shown == WITHOUT_CASE.get(name, set())


HEAD = """
id: mine
title: Mine
source: a test
extends: ariac2018.as_documented
"""
DIFFERS = """
differs:
  from: ariac2018.as_coded
  because: [{name: one, terms: [order.h], coded: this, documented: that, source: here}]
"""


def test_what_a_base_differs_in_is_not_taken_over(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(HEAD)

    assert load_rule_set(str(tmp_path / "mine.yaml")).differs is None


def test_differences_survive_in_the_expanded_text(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(HEAD + DIFFERS)
    mine = load_rule_set(str(tmp_path / "mine.yaml"))

    assert mine.differs is not None
    assert [(d.name, d.terms, d.checks) for d in mine.differs.because] == [("one", ("order.h",), ())]
    assert rule_set_from_text(expanded_yaml(mine), file="a result").differs == mine.differs


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("  from: ariac2018.as_coded\n", ""),
        ("source: here", "sauce: here"),
        ("coded: this, ", ""),
        ("order.h", "h"),
        ("name: one", "name: One"),
        ("[{name: one, terms: [order.h], coded: this, documented: that, source: here}]", "[]"),
    ],
)
def test_a_difference_that_is_not_told_in_full_is_refused(tmp_path: Path, old: str, new: str) -> None:
    (tmp_path / "mine.yaml").write_text(HEAD + DIFFERS.replace(old, new))

    with pytest.raises(RuleSetError, match=r"mine\.yaml"):
        load_rule_set(str(tmp_path / "mine.yaml"))
