"""Official score texts, priced: every number worked by hand from the rulebook (sections 1 to 9)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score import (
    Finding,
    Monitor,
    OfficialOrder,
    OfficialResult,
    Result,
    Rule,
    Trial,
    Verdict,
    load_rule_set,
    measure_trial,
    reprice,
    score_trial,
)
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.errors import RuleSetError
from ariac_score.results.cohort_file import contributed, make_cohort
from ariac_score.scoring.cohort import CohortValues
from ariac_score_ariac.tasks import OfficialOrderScore, OfficialTrialScore
from ariac_score_ariac.work import Order, SensorBill, Task

SATISFIED, VIOLATED, INCONCLUSIVE = Verdict.SATISFIED, Verdict.VIOLATED, Verdict.INCONCLUSIVE
EDITIONS = [f"ariac{year}.official" for year in range(2017, 2025)]
REGISTRY = Registry()


# Texts made to order -------------------------------------------------------------------


def printed_2017(*orders: tuple[float, float, bool]) -> str:
    """Completion, time and whether handed in, of each order."""
    total = sum(score for score, _, _ in orders)
    text = f"<game_score>\nTotal score: [{total:g}]\nTotal process time: [99]\nPart travel time: [0]\n"
    for k, (score, taken_s, submitted) in enumerate(orders):
        text += (
            f"<order_score order_{k}>\nTotal score: [{score:g}]\nTime taken: [{taken_s:g}]\n"
            f"Complete: [{str(submitted).lower()}]\n<tray_score order_{k}_kit_0>\nTotal score: [{score:g}]\n"
            f"Complete: [true]\nSubmitted: [{str(submitted).lower()}]\n</tray_score>\n\n</order_score>\n\n"
        )
    return f"Score breakdown:\n{text}</game_score>\n"


def printed_2018(*orders: tuple[float, float, bool]) -> str:
    return (
        printed_2017(*orders)
        .replace("Total score", "Total game score", 1)
        .replace("tray_score", "shipment_score")
        .replace("_kit_", "_shipment_")
    )


Scored = tuple[float, float, int, bool]
"""Completion, time, priority and whether handed in, of an order."""


def printed_2020(*orders: Scored, collided: int = 0, label: str = "Arms collision?") -> str:
    total = 0 if collided else sum(score * priority for score, _, priority, _ in orders)
    text = f"<game_score>\n\tTotal game score: [{total:g}]\n\tTotal process time: [99]\n"
    text += f"\t{label}: [{collided}]\n"
    for k, (score, taken_s, priority, submitted) in enumerate(orders):
        text += (
            f"<order_score order_{k}>\n\tTotal order score: [{score * priority:g}]\n"
            f"\tCompletion score: [{score:g}]\n\tTime taken: [{taken_s:g}]\n\tComplete: [true]\n"
            f"\tPriority: [{priority}]\n<shipment_score >\n\tCompletion score: [{score:g}]\n"
            f"\tSubmitted: [{str(submitted).lower()}]\n</shipment_score>\n\n</order_score>\n\n"
        )
    return f"Score breakdown:\n{text}</game_score>\n"


def printed_2021(*orders: Scored, collided: int = 0, dropped: int = 0) -> str:
    total = 0 if collided else sum(score * priority for score, _, priority, _ in orders) - dropped
    text = (
        f"[trial_score]\n...total trial score: [{total:g}]\n...total process time: [99]\n"
        f"...arms collision?: [{collided}]\n...dropped part penalty: [{dropped}]\n"
    )
    for k, (score, taken_s, priority, submitted) in enumerate(orders):
        text += (
            f"   [order score]\n   ...order ID [order_{k}]\n   ...total order score: [{score * priority:g}]\n"
            f"   ...completion score: [{score:g}]\n   ...time taken: [{taken_s:g}]\n"
            f"   ...priority: [{priority}]\n      [kitting score]\n"
            f"      ...shipment type: [order_{k}_kitting_shipment_0]\n"
            f"      ...completion score: [{score:g}]\n"
            f"      ...submitted: [{str(submitted).lower()}]\n\n"
        )
    return f"Score breakdown:\n{text}\n(1 1) [Msg] Requesting that Gazebo shut down\n"


def sensors(*types: str, **switched: bool) -> str:
    lines = [f"  s{i}: {{type: {kind}}}" for i, kind in enumerate(types)]
    return "\n".join(["sensors:", *lines, *(f"{name}: {{enable: true}}" for name in switched)]) + "\n"


Order2024 = tuple[str, bool, int, "str | None"]
"""Id, priority, score and duration as printed (`None`: not handed in)."""


def printed_2024(*orders: Order2024, priority_line: bool = True) -> str:
    row = "=" * 40 + "\n"
    text = f"{row}Trial Summary\n{row}Trial file: kitting.yaml\nTrial time limit: No time limit\n"
    text += f"Time limit reached: no\nCompletion time: 400.000000\nTotal number of orders: {len(orders)}\n"
    text += f"Number of submitted orders: {sum(1 for o in orders if o[3])}\n\n{row}Order Summary\n{row}"
    details = f"\n{row}Order Details\n{row}"
    for name, priority, score, duration in orders:
        yes = "yes" if priority else "no"
        at = "N/A" if duration is None else f"{float(duration) + 1:.6f}"
        text += (
            f"Order ID: {name}\n\tOrder type: kitting\n\tOrder submitted: {'yes' if duration else 'no'}\n"
            f"\tPriority: {yes}\n\tMax task score: 9\n\tActual task score: {score}\n"
            f"\tSubmission time: {at}\n\tSubmission duration: {duration or 'N/A'}\n"
        )
        details += f"Order ID: {name}\n"
        details += (
            f"\tType: kitting\n\tPriority: {yes}\n\tAGV: 2\n\tCorrect tray: yes\n\tCorrect destination: yes\n"
            f"\tMax score: 9\n\tActual score: {score}\n\tBonus: 0\n"
            if duration
            else "\tNot Submitted\n"
        )
    return text + details


def printed_cost(dollars: int) -> str:
    bar = "=" * 30 + "\n"
    return (
        f"{bar}User Sensor Log\n{bar}Number of lidar's used: {dollars // 300}\n\n\n"
        f"Total sensor cost is: ${dollars}\n{'-' * 30}\n"
    )


def put(folder: Path, files: Mapping[str, str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def cohort(cost: float | None = None, **times_s: float) -> CohortValues:
    values: dict[str, Mapping[str, float]] = {"order_time_s": times_s}
    if cost is not None:
        values["sensor_cost"] = {"": cost}
    return CohortValues("", values)


def priced(folder: Path, edition: int, text: str, team: str, across: CohortValues) -> Result:
    """The trial of a printed score and a team, among all teams."""
    put(folder, {"performance.log": text, "team.yaml": team})
    rule_set = load_rule_set(f"ariac{edition}.official")
    return reprice(score_trial(folder, rule_set), rule_set, across)


def amounts(result: Result) -> tuple[float | None, float | None]:
    """Score and task score."""
    task = result.task.amount if result.task else None
    return (
        None if result.score is None else float(result.score),
        None if task is None else float(task),
    )


# The documented score of 2017 to 2022 --------------------------------------------------


def test_2017_two_orders(tmp_path: Path) -> None:
    # SC = 500 + 2 x 100 = 700, AC = 1050: CF = 4 (1.5 - 1) + 1 = 3. EF = 60/40 and 50/50.
    # 3 x (9 + 12)/2 + 1.5 x 9 + 1 x 12 x 3 = 31.5 + 13.5 + 36
    text, team = (
        printed_2017((9, 40, True), (12, 50, True)),
        sensors("logical_camera", "break_beam", "camera"),
    )
    result = priced(tmp_path, 2017, text, team, cohort(1050, order_0=60, order_1=50))

    assert amounts(result) == (81, 21)


def test_2017_one_order_at_the_mean_cost(tmp_path: Path) -> None:
    # CF = 1, EF = 80/40: 9 + 2 x 9
    result = priced(
        tmp_path, 2017, printed_2017((9, 40, True)), sensors("logical_camera"), cohort(500, order_0=80)
    )

    assert amounts(result) == (27, 9)


def test_2018_an_order_that_is_not_complete_has_no_efficiency(tmp_path: Path) -> None:
    # TC = 3 x 500 + 200 = 1700, CF = 1; (6 + 4)/2 + 15/30 x 6 + 0 x 4; 2018 prints a time all the same.
    team = sensors("logical_camera", "logical_camera", "logical_camera", "depth_camera")
    text = printed_2018((6, 30, True), (4, 10.432, False))

    assert amounts(priced(tmp_path, 2018, text, team, cohort(order_0=15, order_1=99))) == (8, 10)


def test_2018_the_second_order_counts_threefold(tmp_path: Path) -> None:
    # TC = 3400, CF = 0.5; 0.5 x 5 + 1 x 6 + 3 x 2 x 4 = 2.5 + 6 + 24
    team = sensors(*["logical_camera"] * 6, *["depth_camera"] * 2)
    text = printed_2018((6, 30, True), (4, 10, True))

    assert amounts(priced(tmp_path, 2018, text, team, cohort(order_0=30, order_1=20))) == (32.5, 10)


TEAM_1700 = sensors(*["logical_camera"] * 3, "depth_camera")


@pytest.mark.parametrize(("collided", "score"), [(0, 14 + 12 + 2 * 16 * 3), (1, 0)])
def test_2019_a_collision_takes_it_all(tmp_path: Path, collided: int, score: float) -> None:
    text = printed_2020(
        (12, 40, 1, True), (16, 20, 3, True), collided=collided, label="Was arm/arm collision?"
    )
    result = priced(tmp_path, 2019, text, TEAM_1700, cohort(order_0=40, order_1=40))

    assert amounts(result) == (score, 0 if collided else 60)


@pytest.mark.parametrize(("collided", "score"), [(0, 160), (1, 0)])
def test_2020_two_orders(tmp_path: Path, collided: int, score: float) -> None:
    # TC = 2 x 500, CF = 10: 10 x 10 + 1 x 12 + 2 x 8 x 3
    text = printed_2020((12, 40, 1, True), (8, 20, 3, True), collided=collided)
    team = sensors("rgbd_camera", "rgbd_camera")

    assert amounts(priced(tmp_path, 2020, text, team, cohort(order_0=40, order_1=40)))[0] == score


@pytest.mark.parametrize(
    ("collided", "dropped", "score", "task"), [(0, 2, 2 * 10 + 12 + 24 - 2, 34), (1, 2, -2, 0)]
)
def test_2021_the_floor_costs_a_point_each_collision_or_not(
    tmp_path: Path, collided: int, dropped: int, score: float, task: float
) -> None:
    # TC = 7 x 500 + 600 for the robot camera = 4100, CF = 2; the first order 1 x 12, the second 1 x 8 x 3
    text = printed_2021((12, 40, 1, True), (8, 20, 3, True), collided=collided, dropped=dropped)
    team = sensors(*["logical_camera"] * 7, robot_camera=True)
    result = priced(tmp_path, 2021, text, team, cohort(order_0=40, order_1=20))

    assert amounts(result) == (score, task)


def test_2022_cameras_of_the_gantry_have_prices_of_their_own(tmp_path: Path) -> None:
    # TC = 300 + 600 + 6 x 500 + 200 = 4100, CF = 2: 2 x 8 + 30/20 x 8
    team = sensors(*["logical_camera"] * 6, "depth_camera", gantry_tray_camera=True, gantry_bin_camera=True)
    text = printed_2021((8, 20, 1, True)).replace("[trial_score]", "Final Score: 8")

    assert amounts(priced(tmp_path, 2022, text, team, cohort(order_0=30))) == (28, 8)


def test_2022_penalties_are_given_back_by_hand_and_no_more_than_were_taken(tmp_path: Path) -> None:
    # TC = 3500 + 200 + 300 + 100 = 4100, CF = 2: 2 x 8 + 8 = 24, less 3 as printed; 0, 2 or 5 given back
    team = sensors(*["logical_camera"] * 7, "depth_camera", "rgbd_camera", "camera")
    text = printed_2021((8, 20, 1, True), dropped=3).replace("[trial_score]", "Final Score: 5")
    rule_set = load_rule_set("ariac2022.official")
    result = priced(tmp_path, 2022, text, team, cohort(order_0=20))

    def given_back(number: int) -> float | None:
        sheet = replace(
            rule_set.sheet, parameters={**rule_set.sheet.parameters, "penalties_given_back": number}
        )
        return amounts(reprice(result, replace(rule_set, sheet=sheet), cohort(order_0=20)))[0]

    assert [given_back(number) for number in (0, 2, 5)] == [21, 23, 24]


def test_2022_nothing_handed_in_is_worth_nothing(tmp_path: Path, shared: Path) -> None:
    trial = shared / "ariac" / "data" / "nist_team_2022"
    team = (trial / "config" / "team_config.yaml").read_text(encoding="utf-8")
    text = (trial / "performance.log").read_text(encoding="utf-8")

    assert amounts(priced(tmp_path, 2022, text, team, cohort(order_0=0))) == (0, 0)


@pytest.mark.parametrize(
    ("edition", "name", "total"),
    [
        (2017, "osrf_docker_2017_score_block", 27),
        (2018, "osrf_docker_2018_example_team_performance_tail", 0),
        (2020, "sandeep_kota_group1_2020_score_block", 36),
        (2021, "usnist_2021_automated_evaluation_tail", 4),
        (2021, "usnist_2021_finals_practice1_console", 16),
        (2021, "usnist_2021_finals_practice2_console", 56),
    ],
)
def test_the_task_score_is_the_total_a_real_run_printed(
    shared: Path, edition: int, name: str, total: int
) -> None:
    path = shared / "ariac" / "data" / "found" / f"{name}.log"
    result = score_trial(path, f"ariac{edition}.official")

    # Nobody knows the team's sensors; whatever they cost, they are a factor of nothing.
    assert amounts(result) == (None if total else 0, total)
    assert result.status == ("incomplete" if total else "scored")


@pytest.mark.parametrize("edition", [2017, 2018, 2019, 2020, 2021, 2022])
def test_what_only_all_teams_can_say_is_required(tmp_path: Path, edition: int) -> None:
    text = printed_2021((8, 20, 1, True))
    put(tmp_path, {"performance.log": text, "team.yaml": sensors("logical_camera")})
    result = score_trial(tmp_path, f"ariac{edition}.official")

    assert (result.status, amounts(result)) == ("needs_cohort", (None, 8))
    assert "cohort." in result.missing


def test_a_team_without_sensors_pays_for_the_cheapest_one(tmp_path: Path) -> None:
    # Counted as 100: CF = 1700/100 = 17; 17 x 6 + 30/30 x 6
    result = priced(tmp_path, 2018, printed_2018((6, 30, True)), "sensors: {}\n", cohort(order_0=30))

    assert amounts(result) == (108, 6)


def test_2017_a_team_without_sensors_counts_as_0_in_the_average(tmp_path: Path) -> None:
    # CF = 4 x (200/100 - 1) + 1 = 5; 5 x 6 + 6
    text = printed_2017((6, 30, True))
    result = priced(tmp_path, 2017, text, "sensors: {}\n", cohort(200, order_0=30))
    rule_set = load_rule_set("ariac2017.official")
    teams = {"a": [contributed(result.measured, rule_set)]}

    assert amounts(result) == (36, 6)
    assert make_cohort(rule_set, teams).of_trial("a").values["sensor_cost"] == {"": 0}


@pytest.mark.parametrize(("edition", "printed"), [(2017, printed_2017), (2018, printed_2018)])
def test_a_third_order_has_no_factor(tmp_path: Path, edition: int, printed: Any) -> None:
    # CF = 1 and EF = 1 each: mean(3, 3, 3) + 3 + 3 x 3 + 3; the documents give the factor to the second.
    text = printed((3, 10, True), (3, 10, True), (3, 10, True))
    across = cohort(1600, order_0=10, order_1=10, order_2=10)  # the camera costs 100 less in 2017

    assert amounts(priced(tmp_path, edition, text, TEAM_1700, across))[0] == 18


# The evaluation of 2023 and 2024 -------------------------------------------------------

A, B, C = "ABCD0001", "ABCD0002", "ABCD0003"


def run_2024(folder: Path, text: str, dollars: int = 1000) -> Result:
    return score_trial(
        put(folder, {"trial_log.txt": text, "sensor_cost.txt": printed_cost(dollars)}), "ariac2024.official"
    )


def across(result: Result, values: CohortValues) -> Result:
    return reprice(result, load_rule_set("ariac2024.official"), values)


def test_2024_with_the_text_and_the_cost_alone(tmp_path: Path) -> None:
    # 1 x 120/98 ... : (1 x (100/50) x 9 + 3 x (30/60) x 4) x (1500/1000) = (18 + 6) x 1.5
    text = printed_2024((A, False, 9, "50.000000"), (B, True, 4, "60.000000"), (C, False, 0, None))
    result = run_2024(tmp_path, text)

    assert (result.status, amounts(result)) == ("needs_cohort", (None, 13))
    assert amounts(across(result, cohort(1500, **{A: 100, B: 30, C: 7}))) == (36, 13)


def test_2024_a_negative_score_counts_and_a_time_of_nothing_does_not(tmp_path: Path) -> None:
    # The order of 0 s is passed over: (1 x (40/20) x -3) x (500/1000)
    text = printed_2024((A, False, -3, "20.000000"), (B, True, 9, "0.000000"))
    result = across(run_2024(tmp_path, text), cohort(500, **{A: 40, B: 10}))

    assert amounts(result) == (-3, 6)


def test_2024_nothing_handed_in(tmp_path: Path) -> None:
    result = run_2024(tmp_path, printed_2024((A, False, 0, None), (B, True, 0, None)))

    assert amounts(across(result, cohort(500, **{A: 40, B: 10}))) == (0, 0)


def test_2024_without_a_cost_there_is_the_task_score_alone(tmp_path: Path) -> None:
    folder = put(tmp_path, {"trial_log.txt": printed_2024((A, False, 9, "50.000000"))})
    result = score_trial(folder, "ariac2024.official")

    assert (result.status, amounts(result)) == ("incomplete", (None, 9))


CONFIGURED = f"""\
orders:
  - {{id: {A}, type: kitting, announcement: {{time_condition: 0}}, priority: true, kitting_task:
      {{agv_number: 2, tray_id: 3, destination: warehouse,
       products: [{{type: pump, color: red, quadrant: 3}}]}}}}
"""


@pytest.mark.parametrize("text", ["Gazebo Crashed score not recorded\n", "Process cancelled by user"])
def test_2024_a_run_without_a_score_counts_as_nothing_and_says_so(tmp_path: Path, text: str) -> None:
    files = {"trial_log.txt": text, "sensor_cost.txt": printed_cost(1000), "trial.yaml": CONFIGURED}
    result = across(score_trial(put(tmp_path, files), "ariac2024.official"), cohort(1000, **{A: 40}))

    assert amounts(result) == (0, 0)
    (finding,) = result.measured.of("order_score").values()
    assert finding.message.endswith("no score was recorded; it counts as 0")
    assert finding.labels["outcome"] in ("crashed", "cancelled")


RELEASE_2023 = f"""\
Order: {A}
Type: Kitting
AGV: 4
Tray score: 3
Correct destination: Yes
Bonus: 0
Score: 8
Quadrant: 1
Quadrant score: 3
Correct part type: Yes
Correct part color: Yes
Faulty part: No
Flipped part: No

{"=" * 40}
END OF TRIAL
{"=" * 40}
Trial file: kitting.yaml
Trial time limit: -1
Trial completion time: 88.5
Trial score: 8
ORDERS
"""
INTERIM_2023 = f"""\
{"=" * 40}
Trial file: combined.yaml
Trial score: 12
{"=" * 40}
Orders Summary
-Order ID: {A}
\t-Type: Kitting
\t-Score: 12
\t-Announcement time: 0.500000
\t-Submission time: 80.250000
\t-Completion time: 79.750000
"""


def test_2023_at_release_has_its_printed_total_and_no_times(tmp_path: Path) -> None:
    result = score_trial(put(tmp_path, {"kitting.txt": RELEASE_2023}) / "kitting.txt", "ariac2023.official")

    assert (result.status, amounts(result)) == ("incomplete", (None, 8))
    (finding,) = result.measured.of("order_score").values()
    assert "does not say its duration" in finding.message


def test_2023_in_december_has_times_and_the_priority_of_the_configuration(tmp_path: Path) -> None:
    # 3 x (159.5/79.75) x 12 x (1000/500)
    files = {"combined.txt": INTERIM_2023, "trial.yaml": CONFIGURED, "team.yaml": sensors("rgbd_camera")}
    result = score_trial(put(tmp_path, files), "ariac2023.official")
    rule_set = load_rule_set("ariac2023.official")

    assert amounts(reprice(result, rule_set, cohort(1000, **{A: 159.5}))) == (144, 12)


Teams = Sequence[tuple[int, Mapping[str, tuple[int, "str | None"]]]]
"""Of each team its cost, and of each order score and printed duration."""

IDS = [A, B, C]
PRIORITY = {A: False, B: True, C: False}
DURATIONS = st.none() | st.integers(0, 399_000_000).map(lambda us: f"{us / 1e6:.6f}")
TEAMS = st.lists(
    st.tuples(
        st.integers(1, 9999),
        st.fixed_dictionaries({name: st.tuples(st.integers(-4, 30), DURATIONS) for name in IDS}),
    ),
    min_size=1,
    max_size=4,
)


def transcribed(teams: Teams) -> list[float]:
    """The evaluation as the rulebook tells it in section 9, weights 1, in plain Python."""
    handed_in = [{k: (s, float(d)) for k, (s, d) in orders.items() if d is not None} for _, orders in teams]
    costs = [c for (c, _), orders in zip(teams, handed_in, strict=True) if sum(s for s, _ in orders.values())]
    mean_cost = sum(costs) / len(costs) if costs else 0
    scores = []
    for (own_cost, _), own in zip(teams, handed_in, strict=True):
        score = 0.0
        for name in IDS:
            if name not in own or own[name][1] == 0:
                continue
            total_s = 0.0
            for orders in handed_in:
                total_s += orders[name][1] if name in orders else 0.0
            mean_s = total_s / sum(1 for orders in handed_in if name in orders)
            factor = 3 if PRIORITY[name] else 1
            score += factor * (mean_s / own[name][1]) * own[name][0]
        scores.append(score * (mean_cost / own_cost))
    return scores


def trial_2024(dollars: int, orders: Mapping[str, tuple[int, str | None]]) -> Trial:
    # In the order of the configuration, as the program adds up. Drawn dictionaries come in any order.
    orders = {name: orders[name] for name in IDS}
    summaries = tuple(
        OfficialOrder(
            name,
            "kitting",
            submitted=duration is not None,
            priority=PRIORITY[name],
            score=float(score) if duration is not None else 0.0,
            items={} if duration is None else {"submission_duration": duration},
        )
        for name, (score, duration) in orders.items()
    )
    return Trial(
        "kitting",
        tuple(Order(name, outline=True) for name in orders),
        records=(SensorBill(float(dollars)),),
        official=OfficialResult("trial_log.txt", 0.0, 400.0, summaries=summaries),
    )


@pytest.mark.slow
@given(TEAMS)
def test_2024_is_the_evaluation_to_the_last_bit(teams: Teams) -> None:
    rule_set = load_rule_set("ariac2024.official")
    prepared = prepare(rule_set, registry=REGISTRY)
    measured = [measure_trial(trial_2024(*team), prepared) for team in teams]
    values = make_cohort(rule_set, {"kitting": [contributed(m, rule_set) for m in measured]}).of_trial(
        "kitting"
    )

    scores = [rule_set.sheet.evaluate(m.scopes, m.findings, values).value for m in measured]

    assert scores == transcribed(teams)


# The rule and the monitor --------------------------------------------------------------

TEXT = {"time_taken": "40", "total_order_score": "24", "priority": "3"}


def judged(order: OfficialOrder | None, rule: OfficialOrderScore | None = None, **changes: Any) -> Finding:
    official = OfficialResult("text", 0.0, None, summaries=() if order is None else (order,), **changes)
    trial = Trial("t", official=official)
    (finding,) = (rule or OfficialOrderScore()).judge(trial, Order("order_0", outline=True))
    return finding


def watched(monitor: OfficialTrialScore | None = None, **changes: Any) -> Finding:
    official = OfficialResult(**{"source": "text", "total": 5.0, "process_time_s": 9.0} | changes)
    (finding,) = (monitor or OfficialTrialScore()).watch(Trial("t", official=official))
    return finding


def test_they_keep_their_contracts() -> None:
    assert isinstance(OfficialOrderScore(), Rule)
    assert isinstance(OfficialTrialScore(), Monitor)
    assert not list(OfficialTrialScore().needs())


def test_an_order_of_performance_log_has_the_printed_numbers() -> None:
    finding = judged(OfficialOrder("order_0", submitted=True, score=8.0, items=TEXT))

    assert finding.verdict is SATISFIED
    assert dict(finding.quantities) == {
        "score": 8,
        "total": 24,
        "priority_factor": 3,
        "duration_s": 40,
        "submitted": 1,
    }


def test_an_order_of_trial_log_has_the_factor_of_the_rule() -> None:
    stored = OfficialOrder(
        "order_0", submitted=True, priority=True, score=7.0, max_score=9.0, announced_s=1.0, submitted_s=3.5
    )
    finding = judged(stored, OfficialOrderScore(priority_factor=2.0))

    assert dict(finding.quantities) == {
        "score": 7,
        "total": 14,
        "priority_factor": 2,
        "duration_s": 2.5,
        "max_score": 9,
        "submitted": 1,
    }


def test_the_printed_duration_stands_before_the_difference_of_rounded_times() -> None:
    items = {"submission_duration": "98.002001"}
    stored = OfficialOrder(
        "order_0", submitted=True, score=7.0, announced_s=0.0, submitted_s=98.002, items=items
    )

    assert judged(stored).quantities["duration_s"] == 98.002001


def test_an_order_that_is_not_handed_in_keeps_its_printed_score() -> None:
    partly = OfficialOrder("order_0", submitted=False, score=3.0, items=TEXT | {"time_taken": "0"})

    finding = judged(partly)
    assert (finding.verdict, finding.quantities["score"], finding.quantities["submitted"]) == (VIOLATED, 3, 0)
    assert "duration_s" not in finding.quantities
    assert judged(OfficialOrder("order_0", submitted=False)).quantities["score"] == 0


@pytest.mark.parametrize(
    ("order", "words"),
    [
        (None, "does not name it"),
        (OfficialOrder("order_0", submitted=None, score=3.0), "does not say whether it was handed in"),
        (OfficialOrder("order_0", submitted=True), "does not say its score"),
        (OfficialOrder("order_0", submitted=True, score=3.0), "does not say its priority factor"),
        (
            OfficialOrder("order_0", submitted=True, score=3.0, priority=False, submitted_s=9.0),
            "does not say its duration",
        ),
        (
            OfficialOrder("order_0", submitted=True, score=3.0, items=TEXT | {"time_taken": "0"}),
            "does not say its duration",
        ),
    ],
)
def test_what_the_text_does_not_say_is_undecided(order: OfficialOrder | None, words: str) -> None:
    finding = judged(order, OfficialOrderScore(requires=("score", "priority_factor", "duration_s")))

    assert (finding.verdict, dict(finding.quantities)) == (INCONCLUSIVE, {})
    assert words in finding.message


def test_without_a_text_everything_is_undecided() -> None:
    trial = Trial("t")

    (of_order,) = OfficialOrderScore().judge(trial, Order("order_0"))
    (of_trial,) = OfficialTrialScore().watch(trial)
    assert (of_order.verdict, of_trial.verdict) == (INCONCLUSIVE, INCONCLUSIVE)


@pytest.mark.parametrize("outcome", ["crashed", "cancelled"])
def test_a_run_without_a_score_is_undecided_unless_the_rules_say_otherwise(outcome: str) -> None:
    assert judged(None, outcome=outcome).verdict is INCONCLUSIVE
    assert watched(total=None, outcome=outcome).verdict is INCONCLUSIVE
    zero = judged(None, OfficialOrderScore(on_crash="zero"), outcome=outcome)
    assert (zero.verdict, dict(zero.quantities)) == (VIOLATED, {"score": 0, "submitted": 0})
    run = watched(OfficialTrialScore(on_crash="zero"), total=None, outcome=outcome)
    assert (run.verdict, run.quantities["total"], run.labels["outcome"]) == (VIOLATED, 0, outcome)


def test_the_priority_of_a_configured_order_counts_where_the_text_is_silent() -> None:
    order = OfficialOrder("order_0", submitted=True, score=3.0)
    trial = Trial("t", official=OfficialResult("text", 3.0, None, summaries=(order,)))

    for priority, factor in ((1, 1), (3, 3)):
        configured = Order("order_0", (Task("order_0"),), priority=priority)
        (finding,) = OfficialOrderScore().judge(trial, configured)
        assert finding.quantities["priority_factor"] == factor


def test_the_trial_has_the_printed_numbers() -> None:
    items = {"arms_collision": "0", "dropped_part_penalty": "2"}

    finding = watched(items=items)
    assert (finding.verdict, dict(finding.quantities)) == (
        SATISFIED,
        {"total": 5, "process_time_s": 9, "collisions": 0, "dropped": 2},
    )
    assert watched(items={"was_arm_arm_collision": "1"}).verdict is VIOLATED


@pytest.mark.parametrize("missing", ["total", "process_time_s", "collisions", "dropped"])
def test_a_trial_whose_text_lacks_what_is_required_is_undecided(missing: Any) -> None:
    finding = watched(OfficialTrialScore(requires=(missing,)), total=None, process_time_s=None)

    assert finding.verdict is INCONCLUSIVE
    assert missing.removesuffix("_s").replace("_", " ") in finding.message


def test_an_unknown_requirement_is_refused() -> None:
    plugin = REGISTRY.find("ariac_score.rules", "official.order")

    with pytest.raises(RuleSetError, match="not one of"):
        plugin.build({"requires": ["points"]})


@pytest.mark.parametrize("name", EDITIONS)
def test_every_edition_has_an_official_rule_set_that_builds(name: str) -> None:
    rule_set = load_rule_set(name)

    assert set(rule_set.build(REGISTRY)) == set(rule_set.checks)
    assert rule_set.sheet.needs_cohort
    assert rule_set.sheet.checks_in(rule_set.sheet.task) == {"official_total"}  # type: ignore[arg-type]
