"""Who was good and who was safe: runs and teams by task, safety and approach."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import pytest

from ariac_score import Result, load_result, load_rule_set, reprice
from ariac_score.checks.findings import Verdict
from ariac_score.ranking.outcomes import Cell, RunOutcome, TeamRank
from ariac_score.results.adjustments import apply
from ariac_score.results.result_file import measured_sha256
from ariac_score.review.conduct import MOST_BREACHES, Parts, Weighing, conduct_of_run, parts_of_team
from ariac_score.review.task_and_safety import TaskAndSafety
from ariac_score.scoring.steward import Adjustment

EXAMPLE = Path(__file__).parents[2] / "tests/data/as_published/kitting_near_miss.result.json"


@pytest.fixture(scope="module")
def near_miss() -> Result:
    return load_result(EXAMPLE)


def test_the_worst_approach_is_the_distance_where_the_margin_was_least(near_miss: Result) -> None:
    found = conduct_of_run(near_miss).approach

    # By hand: 4.502 m at 20 s, where the formula asks for 5.458 m (docs of the example).
    assert found is not None
    assert (found.check, found.subject, found.t_s) == ("separation", "robot/human", 20.0)
    assert found.distance_m == pytest.approx(4.502, abs=1e-3)
    assert found.margin_m == pytest.approx(-0.956, abs=1e-3)


def test_without_curves_the_margin_is_that_of_the_findings(near_miss: Result) -> None:
    bare = replace(near_miss, measured=replace(near_miss.measured, sketch=None))
    found = conduct_of_run(bare).approach

    assert found is not None
    assert (found.margin_m, found.distance_m) == (-0.956, None)


def test_violations_of_safety_come_first_and_are_counted_by_clause(near_miss: Result) -> None:
    found = conduct_of_run(near_miss)

    assert found.violated == {("ISO/TS 15066:2016", "5.5.4 (derived)"): 1}
    first, *others = found.breaches
    assert (first.finding, first.watched, first.start_s) == ("separation#1", True, 18.81)
    assert others
    assert not any(breach.watched for breach in others)
    assert {breach.finding.partition("#")[0] for breach in others} == {
        "none_missing", "none_unwanted", "part_color", "part_pose",
    }  # fmt: skip


def test_what_nobody_could_decide_is_no_calm(near_miss: Result) -> None:
    findings = dict(near_miss.findings)
    findings["separation#1"] = replace(findings["separation#1"], verdict=Verdict.INCONCLUSIVE)
    found = conduct_of_run(replace(near_miss, measured=replace(near_miss.measured, findings=findings)))

    assert (dict(found.violated), dict(found.undecided)) == ({}, {"ISO/TS 15066:2016": 1})


def test_what_would_have_helped_is_the_score_without_that_check(near_miss: Result) -> None:
    # Without its breach the example is worth its task, 28.
    assert conduct_of_run(near_miss).gains["separation"] == 28 - near_miss.score


def test_of_very_many_violations_some_are_listed_and_the_rest_counted(near_miss: Result) -> None:
    breach = near_miss.findings["separation#1"]
    many = {f"separation#{n}": breach for n in range(1, MOST_BREACHES + 12)}
    rules = load_rule_set("paper2020.published")
    found = {**{k: f for k, f in near_miss.findings.items() if f.check != "separation"}, **many}
    crowded = reprice(replace(near_miss, measured=replace(near_miss.measured, findings=found)), rules)

    conduct = conduct_of_run(crowded)
    violated = sum(1 for f in crowded.findings.values() if f.verdict is Verdict.VIOLATED)
    assert len(conduct.breaches) == MOST_BREACHES
    assert conduct.left_out == violated - MOST_BREACHES


def test_what_stewards_decided_is_a_part_of_its_own(near_miss: Result) -> None:
    decision = Adjustment(
        "d1", "A. Steward", "why", "2024-05-12T14:30:00Z", measured_sha256(near_miss),
        "kitting_near_miss", points=Decimal(-2),
    )  # fmt: skip
    rules = load_rule_set("paper2020.published")
    adjusted = replace(near_miss, adjusted=apply(near_miss, [decision], rules, sha256="0" * 64))
    parts = conduct_of_run(adjusted).parts

    assert parts is not None
    assert (parts.task, parts.decided) == (28, -2)
    assert parts.score == adjusted.final


# Teams ---------------------------------------------------------------------------------


def ran(number: int, score: str, outcome: str = "scored") -> RunOutcome:
    return RunOutcome("owl", "aisle", number, outcome, score=Decimal(score), kept=True)


def split_of(
    *runs: RunOutcome, score: str, parts: dict[int, TaskAndSafety | None], keep: int = 2, total: str = "sum"
) -> Parts:
    """The parts of a team of one trial."""
    cell = Cell(Decimal(score), "scored", "", tuple(run.number for run in runs), len(runs))
    standing = TeamRank(1, "owl", "Owl", 1.0, Decimal(score), None, {}, {"aisle": cell})
    by_key = {("owl", "aisle", number): one for number, one in parts.items()}
    return parts_of_team(standing, runs, by_key, Weighing(keep, True, total))[1]


def test_a_trial_is_the_mean_of_the_runs_that_count_in_parts_too() -> None:
    parts = {1: TaskAndSafety(Decimal(12), Decimal(-2)), 2: TaskAndSafety(Decimal(8), Decimal(-4))}
    found = split_of(ran(1, "10"), ran(2, "4"), score="7", parts=parts)

    assert (found.task, found.safety) == (10, -3)


def test_a_run_that_was_not_made_costs_the_task_and_not_safety() -> None:
    # One run of two: its 10 count half, its safety too, and the run that is missing adds nothing.
    found = split_of(ran(1, "10"), score="5", parts={1: TaskAndSafety(Decimal(12), Decimal(-2))})

    assert (found.task, found.safety) == (6, -1)


def test_a_crash_is_no_matter_of_safety() -> None:
    parts = {1: TaskAndSafety(Decimal(12), Decimal(-2))}
    found = split_of(ran(1, "10"), ran(2, "0", "crashed"), score="5", parts=parts)

    assert (found.task, found.safety) == (6, -1)


def test_a_team_is_not_split_where_a_run_that_counts_cannot_be() -> None:
    assert split_of(ran(1, "10"), score="5", parts={1: None}) == Parts()
    assert split_of(ran(1, "10"), score="5", parts={}) == Parts()


def test_parts_that_do_not_make_the_score_are_not_shown() -> None:
    found = split_of(ran(1, "10"), score="5", parts={1: TaskAndSafety(Decimal(12), Decimal(-1))})

    assert found == Parts()


def test_where_trials_are_not_added_up_there_are_no_parts_of_the_whole() -> None:
    parts = {1: TaskAndSafety(Decimal(12), Decimal(-2))}

    assert split_of(ran(1, "10"), score="5", parts=parts, total="median") == Parts()
    assert split_of(ran(1, "10"), score="5", parts=parts, total="mean").task == 6
