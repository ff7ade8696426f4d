"""Trial scores across teams: the averages, the operations to the last bit, and laws that any prices keep.

The reference is the arithmetic of the rulebook notes (section 9), written down plainly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Measured,
    Pinned,
    Pose,
    Provenance,
    Result,
    RuleSet,
    Trial,
    as_json,
    load_result,
    load_rule_set,
    measure_trial,
    price_trial,
)
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.results.cohort_file import Cohort, contributed, make_cohort
from ariac_score_ariac.work import KitSubmission, Order, Product, SensorBill, Task, Tray, WantedProduct

EVALUATION, DOCUMENTED = "ariac2024.evaluation", "ariac2024.as_documented"
PLACE = Pose((-0.1, 0.1, 0.0))
ANNOUNCED_S = 7.5
PRIORITY = (1, 3)


@dataclass(frozen=True)
class Kit:
    """What a team makes of one order: how long it took, and what it is worth as coded.

    A kit of one part is worth 5 (tray, part, bonus), and 1 less for each extra part;
    on the wrong tray and without the part, minus the extra parts.
    """

    duration_s: float
    extra: int = 0
    wrong: bool = False

    @property
    def score(self) -> int:
        return -self.extra if self.wrong else 5 - self.extra


@dataclass(frozen=True)
class Team:
    cost: float | None
    kits: tuple[Kit | None, Kit | None]


def trial_of(team: Team) -> Trial:
    orders, submissions = [], []
    for number, kit in enumerate(team.kits):
        name = f"order_{number}"
        wanted = (WantedProduct("part_0", "battery_red", None, 1),)
        task = Task(name, "kitting", wanted, "agv1", "warehouse", Tray("kit_tray_01"))
        orders.append(Order(name, (task,), ANNOUNCED_S, PRIORITY[number]))
        if kit is not None:
            first = () if kit.wrong else (Product("battery_red", PLACE),)
            more = kit.extra + (1 if kit.wrong else 0)
            extra = tuple(Product("pump_red", Pose((0.1, 0.1, 0.0))) for _ in range(more))
            tray = Tray("kit_tray_02" if kit.wrong else "kit_tray_01")
            at_s = ANNOUNCED_S + kit.duration_s
            submissions.append(KitSubmission(name, at_s, extra + first, "agv1", "warehouse", tray))
    return Trial(
        "t",
        tuple(orders),
        tuple(sorted(submissions, key=lambda s: s.submitted_s)),
        witnessed=frozenset({"submissions", "part_assembled"}),
        records=(SensorBill(team.cost),),
    )


@cache
def rules_of(name: str) -> tuple[RuleSet, Registry]:
    return load_rule_set(name), Registry()


def measured(team: Team, rules: str) -> Measured:
    rule_set, registry = rules_of(rules)
    return measure_trial(trial_of(team), prepare(rule_set, registry=registry))


def cohort_of(teams: Sequence[Team], rules: str) -> Cohort:
    rule_set, _ = rules_of(rules)
    return make_cohort(rule_set, {"t": [contributed(measured(team, rules), rule_set) for team in teams]})


def result_of(team: Team, teams: Sequence[Team], rules: str) -> Result:
    rule_set, _ = rules_of(rules)
    provenance = Provenance((), (), Pinned(rule_set.id, rule_set.sha256), Pinned("none", "0" * 64), ())
    return price_trial(measured(team, rules), rule_set, provenance, cohort_of(teams, rules).of_trial("t"))


def number_of(team: Team, teams: Sequence[Team], rules: str) -> float:
    """The score before it is rounded."""
    rule_set, _ = rules_of(rules)
    told, cohort = measured(team, rules), cohort_of(teams, rules).of_trial("t")
    return float(rule_set.sheet.evaluate(told.scopes, told.findings, cohort).value)


def reference(team: Team, teams: Sequence[Team]) -> float:
    """Rulebook notes, section 9, items 4 and 5."""
    costs = [t.cost for t in teams if sum(kit.score for kit in t.kits if kit)]
    average_cost = total(costs) / len(costs) if costs else 0
    score = 0.0
    for number, kit in enumerate(team.kits):
        if kit is None or kit.duration_s == 0:
            continue
        durations = [t.kits[number].duration_s for t in teams if t.kits[number]]  # type: ignore[union-attr]
        efficiency = 1.0 * ((total(durations) / len(durations)) / kit.duration_s)
        score += (3 if PRIORITY[number] > 1 else 1) * efficiency * kit.score
    assert team.cost
    return score * (1.0 * (average_cost / team.cost))


def total(values: Sequence[float | None]) -> float:
    added = 0.0
    for value in values:
        assert value is not None
        added += value
    return added


SLOW, FAST = Kit(250.125), Kit(100.5)
FIELD = (
    Team(3000.0, (SLOW, FAST)),
    Team(1700.0, (FAST, None)),
    Team(5200.0, (Kit(33.25, extra=2), Kit(471.875, wrong=True, extra=1))),
    Team(900.0, (None, None)),
    Team(400.0, (Kit(64.0, wrong=True), None)),
)


@pytest.mark.parametrize("team", FIELD)
def test_the_evaluation_is_that_of_the_scripts_to_the_last_bit(team: Team) -> None:
    assert number_of(team, FIELD, EVALUATION) == reference(team, FIELD)


kits = st.builds(Kit, st.integers(0, 4000).map(lambda eighths: eighths / 8), st.integers(0, 3), st.booleans())
teams = st.builds(
    Team,
    st.integers(1, 90).map(lambda hundreds: hundreds * 100.0),
    st.tuples(st.none() | kits, st.none() | kits),
)


@pytest.mark.slow
@settings(max_examples=30)
@given(st.lists(teams, min_size=1, max_size=4))
def test_any_field_of_teams_is_evaluated_as_by_the_scripts(field: list[Team]) -> None:
    for team in field:
        assert number_of(team, field, EVALUATION) == reference(team, field)


def test_who_scores_nothing_counts_in_the_documented_average_cost_but_not_in_that_of_the_scripts() -> None:
    scoring, idle = Team(2000.0, (FAST, None)), Team(1000.0, (None, None))

    # 5 * 2000/2000 for the scripts, 5 * 1500/2000 as documented
    assert number_of(scoring, (scoring, idle), EVALUATION) == 5.0
    assert number_of(scoring, (scoring, idle), DOCUMENTED) == 3.75


def test_a_kit_worth_nothing_still_counts_in_the_average_time() -> None:
    team, other = Team(1000.0, (Kit(100.0), None)), Team(1000.0, (Kit(300.0, wrong=True), None))

    # 5 * 200/100, the other having no part in the average cost of 1000
    assert number_of(team, (team, other), EVALUATION) == 10.0


def test_priority_is_that_of_the_order_in_whatever_order_they_come() -> None:
    late, early = Team(1000.0, (Kit(100.0), Kit(200.0))), Team(1000.0, (Kit(200.0), Kit(100.0)))

    for rules in (EVALUATION, DOCUMENTED):
        # Averages 150 and 150: 1.5 * 5 + 0.75 * 5 * 3, and 0.75 * 5 + 1.5 * 5 * 3
        assert number_of(late, (late, early), rules) == 18.75
        assert number_of(early, (late, early), rules) == 26.25


def test_a_negative_kit_is_negative_for_the_scripts_and_nothing_as_documented() -> None:
    team = Team(1000.0, (Kit(100.0, extra=2, wrong=True), None))

    assert number_of(team, (team,), EVALUATION) == -2.0
    assert number_of(team, (team,), DOCUMENTED) == 0.0


def test_a_team_of_unknown_cost_has_no_score_and_no_part_in_the_average_cost() -> None:
    known, unknown = Team(1000.0, (FAST, None)), Team(None, (FAST, None))
    for rules in (EVALUATION, DOCUMENTED):
        assert result_of(unknown, (known, unknown), rules).status == "incomplete"
        assert cohort_of((known, unknown), rules).trials["t"]["sensor_cost"][""].value == 1000.0


def test_a_cost_of_nothing_withholds_the_score_of_the_scripts_only() -> None:
    team = Team(0.0, (FAST, None))

    assert result_of(team, (team,), EVALUATION).status == "incomplete"
    # The average is 0, and 0/100 is what the team gets for it.
    assert result_of(team, (team,), DOCUMENTED).score == Decimal(0)


@pytest.mark.parametrize("rules", [EVALUATION, DOCUMENTED])
def test_without_other_teams_the_task_score_stands(rules: str) -> None:
    rule_set, _ = rules_of(rules)
    provenance = Provenance((), (), Pinned(rule_set.id, rule_set.sha256), Pinned("none", "0" * 64), ())

    result = price_trial(measured(Team(1000.0, (FAST, SLOW)), rules), rule_set, provenance)

    assert (result.status, result.score) == ("needs_cohort", None)
    assert result.task is not None
    assert result.task.amount == Decimal(10)


@pytest.mark.parametrize("rules", [EVALUATION, DOCUMENTED, "ariac2023.evaluation", "ariac2023.as_documented"])
def test_a_score_across_teams_survives_being_stored(rules: str, tmp_path: Path) -> None:
    team = Team(3000.0, (SLOW, FAST))
    result = result_of(team, (team, FIELD[2]), rules)
    (tmp_path / "result.json").write_text(as_json(result), encoding="utf-8")

    stored = load_result(tmp_path / "result.json")

    assert (stored.status, stored.score, stored.task) == ("scored", result.score, result.task)


# Laws ----------------------------------------------------------------------------------

EVERY_DOCUMENTED = [f"ariac{year}.as_documented" for year in (2017, 2018, 2019, 2020, 2022, 2023, 2024)] + [
    f"ariac2021.{state}_as_documented" for state in ("tip", "qualifiers", "finals")
]


@pytest.mark.parametrize("name", EVERY_DOCUMENTED)
def test_every_documented_edition_needs_a_cohort_and_has_a_task_score_without(name: str) -> None:
    sheet = load_rule_set(name).sheet

    assert sheet.needs_cohort
    assert sheet.task is not None
    assert {"order_time", "sensor_cost"} <= sheet.checks_in(sheet.score)
    assert not {"order_time", "sensor_cost"} & sheet.checks_in(sheet.task)


@pytest.mark.slow
@given(st.integers(1, 50), st.integers(1, 50))
@settings(max_examples=30)
def test_being_faster_or_cheaper_never_scores_less_against_the_same_cohort(tenths: int, dollars: int) -> None:
    base = Team(5100.0, (Kit(51.0), Kit(51.0)))
    faster = replace(base, kits=(Kit(51.0 - tenths), base.kits[1]))
    cheaper = replace(base, cost=5100.0 - dollars * 100)
    rule_set, _ = rules_of(DOCUMENTED)
    cohort = cohort_of((base,), DOCUMENTED).of_trial("t")

    def score(team: Team) -> float:
        told = measured(team, DOCUMENTED)
        return float(rule_set.sheet.evaluate(told.scopes, told.findings, cohort).value)

    assert score(faster) > score(base)
    assert score(cheaper) > score(base)
