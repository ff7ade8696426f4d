"""The official text held against the log and against itself; numbers are its own, or worked by hand."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from ariac_score import Event, Finding, Pose, Trial, TrialBuilder, load_rule_set
from ariac_score.cli import main
from ariac_score.documents.schema import schema_errors
from ariac_score.errors import DataFileError, FormulaError, NothingToScoreError, RuleSetError, UsageError
from ariac_score.report.audit_text import audit_text
from ariac_score.results.result import Measured
from ariac_score.review.audit import AGREE, AUDIT, CANNOT_BE_JUDGED, DIFFER, STATE_LOG_ROUNDING, Audit, audit
from ariac_score.review.certainty import Certain
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.ruleset import installed_rule_sets
from ariac_score.scoring.scope import Scope
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score.trial.clock import Clock
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, Tray, WantedProduct

# The made kitting trial under the rules of 2020, worked by hand. order_0: of three products one has
# the wrong colour, so type 3, colour 2, pose 2, bonus 0: 7. order_1: of two products one lies 31 mm
# off, so type 2, colour 2, pose 1, bonus 2: 7, times 3. In all 28.
TEXT_2020 = (Path(__file__).parents[1] / "data/performance_2020.log").read_text(encoding="utf-8")


def bundle(folder: Path, text: str = TEXT_2020, trial: Trial | None = None) -> Path:
    folder.mkdir(exist_ok=True)
    write_trial_log(folder / "trial.jsonl", trial or kitting_trial(duration_s=40.0), signals=SNAPSHOT_SIGNALS)
    (folder / "performance.log").write_text(text, encoding="utf-8")
    return folder


def changed(old: str, new: str) -> str:
    """The text with the first of these words changed."""
    assert old in TEXT_2020
    return TEXT_2020.replace(old, new, 1)


def named(path: str, label: str) -> str:
    """An item by the last word of its path and its label, to compare with what a test lists."""
    return f"{path.rpartition('/')[2]} {label}".strip()


def told(audited: Audit, verdict: str) -> set[str]:
    return {named(item.path, item.label) for item in audited.items if item.verdict == verdict}


def wrong_sums(audited: Audit) -> set[str]:
    return {named(one.path, one.label) for one in audited.sums if one.verdict == DIFFER}


def listed(names: str) -> set[str]:
    return set(names.split(", ")) if names else set()


@pytest.fixture(autouse=True, scope="module")
def _installed_once() -> Iterator[None]:
    """What is installed does not change while these tests run, and to load all of it takes a second."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("ariac_score.review.audit.installed_rule_sets", cache(installed_rule_sets))
        yield


# Against the log -----------------------------------------------------------------------


@pytest.mark.slow
def test_every_item_of_a_true_text_agrees(tmp_path: Path) -> None:
    audited = audit(bundle(tmp_path / "run"), against="ariac2020.as_coded")

    assert audited.rule_set.id == "ariac2020.as_coded"  # 2019 prints other labels
    assert (audited.count(AGREE), audited.count(DIFFER), audited.count(CANNOT_BE_JUDGED)) == (30, 0, 0)
    assert all(item.independent for item in audited.items)
    assert not wrong_sums(audited)
    assert not audited.differs


# What is printed, what instead, the items that differ then, and the sums that do not hold. A collision
# that the text prints is an event of the trial, so it changes our numbers too.
FALSIFIED = [
    ("Final score: 28", "Final score: 29", "final_score", "final_score"),
    ("Total game score: [28]", "Total game score: [27]", "total_game_score", "final_score, total_game_score"),
    ("Arms collision?: [0]", "Arms collision?: [1]", "final_score, total_game_score", "total_game_score"),
    (
        "Total order score: [7]",
        "Total order score: [8]",
        "order_0 total_order_score",
        "order_0 total_order_score, total_game_score",
    ),
    (
        "Completion score: [7]",
        "Completion score: [6]",
        "order_0 completion_score",
        "order_0 completion_score, order_0 total_order_score",
    ),
    ("Priority: [3]", "Priority: [1]", "order_1 priority", "order_1 total_order_score"),
    (
        "All products bonus: [2]",
        "All products bonus: [3]",
        "order_1_shipment_0 all_products_bonus",
        "order_1_shipment_0 all_products_bonus, order_1_shipment_0 completion_score",
    ),
    (
        "Product pose score: [1]",
        "Product pose score: [2]",
        "order_1_shipment_0 product_pose_score",
        "order_1_shipment_0 completion_score",
    ),
    ("Complete: [false]", "Complete: [true]", "order_0_shipment_0 complete", ""),
]


@pytest.mark.slow
@pytest.mark.parametrize(("old", "new", "items", "sums"), FALSIFIED, ids=[new for _, new, *_ in FALSIFIED])
def test_a_falsified_item_is_named_and_nothing_else(
    tmp_path: Path, old: str, new: str, items: str, sums: str
) -> None:
    audited = audit(bundle(tmp_path / "run", changed(old, new)))

    assert told(audited, DIFFER) == listed(items)
    assert wrong_sums(audited) == listed(sums)
    assert audited.differs


@pytest.mark.slow
def test_a_wrong_number_made_consistent_still_differs_from_the_log(tmp_path: Path) -> None:
    text = changed("Product pose score: [1]", "Product pose score: [2]")
    text = text.replace("[21]", "[24]").replace("[28]", "[31]").replace("score: 28", "score: 31")
    head, tail = text.split("<order_score order_1>")
    audited = audit(bundle(tmp_path / "run", f"{head}<order_score order_1>{tail.replace('[7]', '[8]')}"))

    assert not wrong_sums(audited)
    assert "order_1_shipment_0 product_pose_score" in told(audited, DIFFER)
    assert "total_game_score" in told(audited, DIFFER)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("taken", "verdict"), [("14", AGREE), ("14.001", DIFFER), ("12", AGREE), ("11.999", DIFFER)]
)
def test_times_agree_within_the_second_that_the_rule_set_states(
    tmp_path: Path, taken: str, verdict: str
) -> None:
    audited = audit(bundle(tmp_path / "run", changed("Time taken: [13]", f"Time taken: [{taken}]")))
    (item,) = (item for item in audited.items if (item.path, item.label) == ("order_0", "time_taken"))

    assert (item.verdict, item.tolerance) == (verdict, 1)
    assert "simulated seconds" in item.because


@pytest.mark.slow
def test_what_the_log_does_not_show_cannot_be_judged(tmp_path: Path) -> None:
    trial = kitting_trial()
    first, second = trial.submissions
    bare = replace(trial, submissions=(replace(first, contents=None), second))
    audited = audit(bundle(tmp_path / "run", trial=bare))
    items = {(item.path, item.label): item for item in audited.items}
    pose = items["order_0/order_0_shipment_0", "product_pose_score"]

    assert audited.count(DIFFER) == 0
    assert (pose.verdict, pose.ours) == (CANNOT_BE_JUDGED, None)
    assert "part_pose: " in pose.reason
    assert items["order_0/order_0_shipment_0", "delivered_to_correct_agv"].verdict == AGREE
    assert items["", "total_game_score"].verdict == CANNOT_BE_JUDGED


@pytest.mark.slow
def test_a_shipment_on_the_wrong_agv_is_worth_0_whatever_it_held(tmp_path: Path) -> None:
    trial = kitting_trial()
    first, second = (replace(submission, agv="agv4") for submission in trial.submissions)
    sent = replace(trial, submissions=(replace(first, contents=None), second))
    audited = audit(bundle(tmp_path / "run", trial=sent))
    items = {(item.path, item.label): item for item in audited.items}

    assert items["", "total_game_score"].verdict == DIFFER
    assert items["", "total_game_score"].ours == 0
    assert items["order_0/order_0_shipment_0", "product_pose_score"].verdict == CANNOT_BE_JUDGED


def test_a_collision_that_only_the_text_tells_of_rests_on_it(tmp_path: Path) -> None:
    trial = kitting_trial()
    audited = audit(bundle(tmp_path / "run", trial=replace(trial, witnessed=frozenset({"submissions"}))))
    (item,) = (item for item in audited.items if item.label == "arms_collision")

    assert (item.verdict, item.independent) == (AGREE, False)
    assert item.reason.startswith("without performance.log: no_arm_collision: ")
    # So do the totals, which a collision would make 0.
    assert audit_text(audited).startswith("agree 30 (3 of them rest on the official file itself) ·")


@pytest.mark.slow
def test_a_label_nobody_knows_is_listed_and_not_passed_over(tmp_path: Path) -> None:
    text = changed("\tPriority: [1]\n", "\tPriority: [1]\n\tStyle: [9.5]\n")
    audited = audit(bundle(tmp_path / "run", text), "ariac2020.as_coded")
    (item,) = (item for item in audited.items if item.label == "style")

    assert (item.verdict, item.reason) == (CANNOT_BE_JUDGED, "the rule set does not say what this is")


@pytest.mark.slow
def test_an_order_that_the_log_does_not_have_cannot_be_judged(tmp_path: Path) -> None:
    audited = audit(bundle(tmp_path / "run", TEXT_2020.replace("order_1", "order_9")))

    undecided = {item.path.split("/")[0] for item in audited.items if item.verdict == CANNOT_BE_JUDGED}
    assert undecided == {"order_9"}


# Poses that are rounded ----------------------------------------------------------------

AT_LEAST_M = STATE_LOG_ROUNDING["m"]


def pose_points(margin_m: float, rounding: Mapping[str, float]) -> Certain:
    rule_set = load_rule_set("ariac2020.as_coded")
    made = Finding.satisfied("o/t/p", f"distance {0.03 - margin_m:g} m")
    finding = replace(made, robustness=margin_m, unit="m", check="part_pose")
    scopes = Scope("trial", "", {}, (Scope("order", "o", {}, (Scope("submission", "o/t", {}),)),))
    return Certain(rule_set, Measured("made", {"part_pose#1": finding}, scopes), rounding)


@pytest.mark.parametrize(
    ("margin_m", "certain"), [(AT_LEAST_M, True), (0.0099, False), (-0.0099, False), (-AT_LEAST_M, True)]
)
def test_a_margin_below_the_rounding_of_a_state_log_decides_nothing(margin_m: float, certain: bool) -> None:
    pose = Expression.parse("pose")
    value = pose_points(margin_m, STATE_LOG_ROUNDING).value(pose, "submission", "o/t")

    assert (value.traced is not None) is certain
    assert certain or "rounded to three digits" in value.reason
    assert pose_points(margin_m, {}).value(pose, "submission", "o/t").traced is not None


# Real texts ----------------------------------------------------------------------------


@pytest.mark.slow
def test_the_only_public_run_agrees_as_far_as_it_can_be_judged(shared: Path) -> None:
    audited = audit(shared / "ariac/data/nist_team_2022")
    items = {(item.path, item.label): item for item in audited.items}

    assert audited.rule_set.id == "ariac2022.as_coded"
    assert (audited.count(AGREE), audited.count(DIFFER)) == (8, 0)
    assert not wrong_sums(audited)
    assert items["order_0", "priority"].independent
    # Nothing but performance.log tells of submissions, so 0 points rest on it.
    assert "submissions" in items["order_0", "total_order_score"].reason
    assert items["", "total_process_time"].printed == "14.852"


FOUND = {
    "osrf_docker_2017_score_block.log": ("ariac2017.as_coded", 5),
    "osrf_docker_2018_example_team_performance_tail.log": ("ariac2018.as_coded", 5),
    "sandeep_kota_group1_2020_score_block.log": ("ariac2020.as_coded", 13),
    "usnist_2021_automated_evaluation_tail.log": ("ariac2021.finals_as_coded", 7),
    "usnist_2021_finals_practice1_console.log": ("ariac2021.finals_as_coded", 11),
    "usnist_2021_finals_practice2_console.log": ("ariac2021.finals_as_coded", 13),
}
# Its author left out an order: 27 points are printed, and one order of 12 is shown.
ODD = {"osrf_docker_2017_score_block.log": {"total_score"}}


@pytest.mark.parametrize("name", FOUND)
def test_a_published_text_adds_up(shared: Path, name: str) -> None:
    rules, sums = FOUND[name]
    audited = audit(shared / "ariac/data/found" / name, rules)

    assert wrong_sums(audited) == ODD.get(name, set())
    assert len(audited.sums) == sums
    assert audited.count(DIFFER) == 0  # what was delivered is not told, so nothing is claimed
    assert not any(item.reason == "the rule set does not say what this is" for item in audited.items)
    assert not any(item.independent for item in audited.items)


# A kit of one in the layout of May 2022: type 1, colour 1, pose 1. The wrong tray withholds the bonus
# from the sum, though it is printed.
KIT_2022 = """\
------------------------
    Final Score: 3
    Configuration File: kitting.yaml
------------------------
...total process time: [20.5]
...arms collision?: [0]
...dropped part penalty: [0]
------------------------
   Order Score
------------------------
   ...order ID [order_0]
   ...total order score: [3]
   ...completion score: [3]
   ...time taken: [12.5]
   ...priority: [1]
------------------------
      Kitting Score
------------------------
      ...shipment type: [order_0_kitting_shipment_0]
      ...completion score: [3]
      ...complete: [true]
      ...submitted: [true]
      ...used correct agv: [true]
      ...used correct movable tray type: [false]
      ...has correct movable tray pose: [true]
            ...has correct position: [true]
            ...has correct orientation: [true]
      ...sent to correct station: [true]
      ...product type presence score: [1]
      ...product color presence score: [1]
      ...product pose score: [1]
      ...all products bonus: [1]

(1651447514 1) [Msg] Requesting that Gazebo shut down
"""


@pytest.mark.parametrize(
    ("old", "new", "sums"),
    [
        ("", "", ""),
        ("tray type: [false]", "tray type: [true]", "order_0_kitting_shipment_0 completion_score"),
        ("position: [true]", "position: [false]", "order_0_kitting_shipment_0 has_correct_movable_tray_pose"),
        ("bonus: [1]", "bonus: [2]", "order_0_kitting_shipment_0 all_products_bonus"),
        ("penalty: [0]", "penalty: [1]", "final_score"),
    ],
)  # fmt: skip
def test_a_kit_of_2022_adds_up_with_its_tray(tmp_path: Path, old: str, new: str, sums: str) -> None:
    (tmp_path / "performance.log").write_text("Gazebo multi-robot simulator\n" + KIT_2022.replace(old, new))
    audited = audit(tmp_path / "performance.log")

    assert audited.rule_set.id == "ariac2022.as_coded"
    assert wrong_sums(audited) == listed(sums)


# 2024 ----------------------------------------------------------------------------------

ROW = "=" * 40 + "\n"
# A kit of two: right tray 1, a battery of the wrong colour 2, a right pump 3, no bonus: 6 of 1 + 6 + 2.
TEXT_2024 = f"""\
{ROW}Trial Summary
{ROW}Trial file: kitting.yaml
Trial time limit: 500.000000
Time limit reached: no
Completion time: 90.000000
Total number of orders: 1
Number of submitted orders: 1

{ROW}Order Summary
{ROW}Order ID: KIT00001
\tOrder type: kitting
\tOrder submitted: yes
\tPriority: no
\tMax task score: 9
\tActual task score: 6
\tSubmission time: 80.000000
\tSubmission duration: 80.000000

{ROW}Order Details
{ROW}Order ID: KIT00001
\tType: kitting
\tPriority: no
\tAGV: 2
\tCorrect tray: yes
\tCorrect destination: yes
\tMax score: 9
\tActual score: 6
\tBonus: 0
\tQuadrant: 1
\t\tScore: 2
\t\tCorrect part type: yes
\t\tCorrect part color: no
\t\tFaulty part: no
\t\tFlipped part: no
\tQuadrant: 4
\t\tScore: 3
\t\tCorrect part type: yes
\t\tCorrect part color: yes
\t\tFaulty part: no
\t\tFlipped part: no
"""


def kit_of_2024(folder: Path, text: str = TEXT_2024) -> Path:
    builder = TrialBuilder("kitting", file="made", clock=Clock("competition time", detail="made"))
    builder.witnessed |= {"submissions"}
    wanted = (WantedProduct("part_0", "battery_blue", None, 1), WantedProduct("part_1", "pump_red", None, 4))
    task = Task("KIT00001", "kitting", wanted, "agv2", "as1", Tray("kit_tray_03"))
    held = (
        Product("battery_green", Pose((-0.08, 0.12, 0.0)), name="battery_green_1"),
        Product("pump_red", Pose((0.08, -0.12, 0.0)), name="pump_red_1"),
    )
    items = [
        Event(0.0, "competition_started"),
        Event(90.0, "competition_ended"),
        Order("KIT00001", (task,), 0.0),
        KitSubmission("KIT00001", 80.0, held, "agv2", "as1", Tray("kit_tray_03")),
    ]
    for item in items:
        builder.add(item)
    folder.mkdir()
    write_trial_log(folder / "trial.jsonl", builder.build())
    records = [json.loads(line) for line in (folder / "trial.jsonl").read_text().splitlines()]
    for record in records:  # what the record of an older edition leaves out
        if record["record"] == "submission":
            record["tray"] = {"type": "kit_tray_03"}
        for task_record in record.get("tasks", []):
            task_record.update(tray={"type": "kit_tray_03"}, station="as1")
            for product in task_record["products"]:
                product["quadrant"] = wanted[int(product["slot"][-1])].quadrant
    (folder / "trial.jsonl").write_text("".join(json.dumps(record) + "\n" for record in records))
    (folder / "trial_log.txt").write_text(text, encoding="utf-8")
    return folder


def test_a_kit_of_2024_agrees_down_to_its_quadrants(tmp_path: Path) -> None:
    audited = audit(kit_of_2024(tmp_path / "run"), "ariac2024.release_5")
    agreeing = told(audited, AGREE)

    assert audited.count(DIFFER) == 0
    assert not wrong_sums(audited)
    assert {"KIT00001 actual_score", "quadrant_1 correct_part_color", "quadrant_4 score"} <= agreeing
    assert "KIT00001 agv" in told(audited, CANNOT_BE_JUDGED)
    assert {i.scope for i in audited.items if i.path == "KIT00001/quadrant_4"} == {"KIT00001/KIT00001/part_1"}


@pytest.mark.parametrize(
    ("old", "new", "item", "sums"),
    [
        ("\tBonus: 0", "\tBonus: 2", "KIT00001 bonus", "KIT00001 bonus"),
        ("\tActual score: 6", "\tActual score: 7", "KIT00001 actual_score", "KIT00001 actual_score"),
        (
            "task score: 6",
            "task score: 7",
            "KIT00001 summary_score",
            "KIT00001 actual_score, KIT00001 summary_score",
        ),
        ("\t\tScore: 3", "\t\tScore: 2", "quadrant_4 score", "quadrant_4 score, KIT00001 summary_score"),
        ("Flipped part: no", "Flipped part: yes", "quadrant_1 flipped_part", "quadrant_1 score"),
        (
            "submitted orders: 1",
            "submitted orders: 0",
            "number_of_submitted_orders",
            "number_of_submitted_orders",
        ),
        ("Completion time: 90.0", "Completion time: 79.0", "completion_time", "completion_time"),
    ],
)
def test_a_falsified_item_of_2024_is_named(tmp_path: Path, old: str, new: str, item: str, sums: str) -> None:
    audited = audit(kit_of_2024(tmp_path / "run", TEXT_2024.replace(old, new, 1)), "ariac2024.release_5")

    assert told(audited, DIFFER) == {item}
    assert wrong_sums(audited) == listed(sums)


def test_a_sum_is_told_with_the_numbers_it_is_made_of_as_they_stand_in_the_text(tmp_path: Path) -> None:
    falsified = TEXT_2024.replace("task score: 6", "task score: 7").replace("time: 90.0", "time: 79.9")
    told_text = audit_text(audit(kit_of_2024(tmp_path / "run", falsified), "ariac2024.release_5"))

    (sums,) = [part for part in told_text.split("\n\n") if part.startswith("Does not add up")]
    assert "but it is at least max(order.submission_time) = 80; nothing is handed in after" in sums
    assert "      KIT00001: submission_time: 80.000000\n" in sums
    assert "- KIT00001: score in the summary " in sums
    assert "      KIT00001/quadrant_4: score: 3" in sums
    assert "summary_" not in sums.replace("it is summary_score", "")


@pytest.mark.parametrize(("last_s", "sums"), [("75.143", ""), ("75.144", "total_process_time")])
def test_no_order_takes_longer_than_the_competition(tmp_path: Path, last_s: str, sums: str) -> None:
    text = "<game_score>\nTotal score: [12]\nTotal process time: [75.143]\nPart travel time: [1]\n"
    text += f"<order_score order_0>\nTotal score: [12]\nTime taken: [{last_s}]\nComplete: [true]\n"
    text += "<tray_score order_0_kit_0>\nTotal score: [12]\nComplete: [true]\nSubmitted: [true]\n"
    text += "Part presence score: [4]\nAll parts bonus: [4]\nPart pose score: [4]\n</tray_score>\n"
    (tmp_path / "performance.log").write_text(text + "</order_score>\n</game_score>\n", encoding="utf-8")

    assert wrong_sums(audit(tmp_path)) == listed(sums)


# What is no score, and which rule set --------------------------------------------------


def test_a_crash_is_named_and_nothing_is_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "trial_log.txt").write_text("Gazebo Crashed score not recorded\n")

    assert main(["audit", str(tmp_path)]) == 0
    assert "nothing to compare: the simulator crashed" in capsys.readouterr().out
    assert audit(tmp_path).items == ()


def test_a_log_without_an_official_text_is_refused_with_what_to_add(tmp_path: Path) -> None:
    write_trial_log(tmp_path / "trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)

    with pytest.raises(NothingToScoreError, match="no official score") as refused:
        audit(tmp_path / "trial.jsonl")
    assert "performance.log" in refused.value.hint


def test_a_text_of_more_than_one_edition_asks_which(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="layout '2024'") as refused:
        audit(kit_of_2024(tmp_path / "run"))

    assert refused.value.hint == "choose with --rules: ariac2024.release_3, ariac2024.release_5"


def test_a_rule_set_that_knows_no_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="does not say what an official text prints"):
        audit(bundle(tmp_path / "run"), "paper2020.published")


@pytest.mark.parametrize(
    ("keys", "cause"),
    [
        ("printed: {order: {total_order_score: totl}}", "unknown name 'totl'"),
        ("printed: {order: {total_order_score: points(nothing)}}", "'nothing', which is no check"),
        ("adds_up: {order: {total: completion * prioritty}}", "'prioritty' is no printed item of a order"),
        ("adds_up: {order: {nothing: completion}}", "'nothing' is no printed item"),
        ("adds_up: {submission: {completion: sum(order.total)}}", "anything inside a submission"),
    ],
)
def test_misspelt_names_are_found_when_a_rule_set_is_loaded(tmp_path: Path, keys: str, cause: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(f"id: mine\ntitle: Mine\nsource: a test\nextends: ariac2020.as_coded\n{keys}\n")

    with pytest.raises(FormulaError, match=re.escape(cause)) as refused:
        load_rule_set(str(file))
    assert str(file) in str(refused.value)


@pytest.mark.parametrize(
    "keys",
    ["printed: {order: 7}", "printed: {order: {total: {within: -1}}}", "adds_up: {order: {total: {}}}"],
)
def test_keys_of_another_form_are_refused(tmp_path: Path, keys: str) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(f"id: mine\ntitle: Mine\nsource: a test\nextends: ariac2020.as_coded\n{keys}\n")

    with pytest.raises(RuleSetError):
        load_rule_set(str(file))


def test_a_rule_set_inherits_items_but_not_the_layout(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("id: mine\ntitle: Mine\nsource: a test\nextends: ariac2020.as_coded\n")
    mine, base = load_rule_set(str(file)).printed, load_rule_set("ariac2020.as_coded").printed

    assert (mine.items, mine.sums) == (base.items, base.sums)
    assert (mine.layouts, base.layouts) == ((), ("2019-2020",))


# The command ---------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_says_with_its_exit_code_whether_all_agrees(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = bundle(tmp_path / "good"), bundle(tmp_path / "bad", changed("bonus: [2]", "bonus: [3]"))

    assert main(["audit", str(good)]) == 0
    assert capsys.readouterr().out.startswith("agree 30 · differ 0 · cannot be judged 0\n")
    assert main(["audit", str(bad)]) == 1
    out = capsys.readouterr().out
    assert out.index("Differs from the log") < out.index("Does not add up in the text") < out.index("Agrees")
    assert "printed 3, ours 2" in out
    assert "printed 3, but it is color if bonus else 0 = 2" in out
    assert main(["audit", str(tmp_path / "nowhere")]) == 5
    assert main(["audit", str(good), "--rules", "ariac1999"]) == 4


@pytest.mark.slow
def test_the_json_keeps_its_schema_and_its_bytes(tmp_path: Path) -> None:
    run, file = bundle(tmp_path / "run", changed("bonus: [2]", "bonus: [3]")), tmp_path / "audit.json"

    assert main(["audit", str(run), "--output-format", "json", "-o", str(file)]) == 1
    assert file.read_text(encoding="utf-8") == AUDIT.text(audit(run))
    data = json.loads(file.read_text(encoding="utf-8"))
    assert schema_errors(data, "audit") == []
    assert data["counts"] == {"agree": 29, "differ": 1, "cannot_be_judged": 0}
    assert [one["label"] for one in data["sums"] if one["verdict"] == DIFFER] == [
        "completion_score",
        "all_products_bonus",
    ]


def test_an_audit_is_never_written_over_what_it_is_made_from(tmp_path: Path) -> None:
    run = bundle(tmp_path / "run")

    assert main(["audit", str(run), "-o", str(run / "performance.log")]) == 4
    assert (run / "performance.log").read_text() == TEXT_2020


# Two rule sets -------------------------------------------------------------------------

OTHER = """
id: other
title: Other
source: a test
extends: ariac2020.as_coded
rules:
  part_pose:
    use: kitting.pose
    with: {max_distance_m: 0.05, min_quaternion_dot: 0.95, max_heading_error_rad: 0.1}
terms:
  order:
    factor: 1
differs:
  from: ariac2020.as_coded
  because:
    - {name: farther, checks: [part_pose], coded: 3 cm, documented: 5 cm, source: line 7}
"""


def test_a_comparison_tells_which_points_why_and_what_nobody_explains(tmp_path: Path) -> None:
    (tmp_path / "other.yaml").write_text(OTHER)
    (comparison,) = audit(bundle(tmp_path / "run"), against=str(tmp_path / "other.yaml")).comparisons
    changes = {(change.path, change.term): change for change in comparison.changes}
    kit = "order_1/order_1_shipment_0"

    # Worked by hand: with 5 cm the product 31 mm off counts, 7 + 1; the factor 3 falls away.
    assert {key: (c.before, c.after) for key, c in changes.items()} == {
        (kit, "pose"): (1, 2),
        (kit, "total"): (7, 8),
        ("order_1", "completion"): (7, 8),
        ("order_1", "factor"): (3, 1),
        ("order_1", "total"): (21, 8),
        ("", "task"): (28, 15),
        ("", "score"): (28, 15),
    }
    assert [reason.source for reason in changes[kit, "pose"].reasons] == ["line 7"]
    assert (changes[kit, "pose"].follows, changes[kit, "total"].follows) == (False, True)
    assert changes["order_1", "factor"].unexplained
    assert not comparison.undecided


@pytest.mark.slow
def test_the_documented_rules_are_compared_without_being_asked(tmp_path: Path) -> None:
    audited = audit(bundle(tmp_path / "run"))
    text = audit_text(audited)

    assert [comparison.second for comparison in audited.comparisons] == ["ariac2020.as_documented"]
    assert "The same trial under ariac2020.as_documented" in text
    assert schema_errors(json.loads(AUDIT.text(audited)), "audit") == []


@pytest.mark.slow
def test_a_rule_set_that_is_its_own_comparison_changes_nothing(tmp_path: Path) -> None:
    (comparison,) = audit(bundle(tmp_path / "run"), against="ariac2020.as_coded").comparisons

    assert comparison.changes == ()
    assert "nothing that both decide differs" in audit_text(
        audit(tmp_path / "run", against="ariac2020.as_coded")
    )


def test_a_configuration_of_another_year_is_refused_here_too(tmp_path: Path) -> None:
    run = Path(__file__).parents[2] / "examples/competition/2024/logs/cygnus/mixed_tasks_1"
    (tmp_path / "trial_log.txt").write_bytes((run / "trial_log.txt").read_bytes())
    (tmp_path / "team.yaml").write_text("gantry_tray_camera: {}\nsensors: {}\n", encoding="utf-8")

    with pytest.raises(DataFileError, match="it looks like a team configuration of 2022"):
        audit(tmp_path, "ariac2024.release_5")


def test_a_run_of_a_database_prints_no_score_to_audit() -> None:
    run = Path(__file__).parents[2] / "examples/competition/2025/results.db#run=3"

    with pytest.raises(UsageError, match="this record prints no score"):
        audit(run)
