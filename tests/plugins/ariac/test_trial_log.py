"""The reader of the score texts of 2023 and 2024; layouts: notes on log formats, sections 5.1 to 5.3."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.contracts import Reader, Wanted
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.logs.bundle import find_parts
from ariac_score.trial.build import merge_trials
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import OfficialResult, Trial
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.config.ariac_config import TrialConfigReader
from ariac_score_ariac.official.ariac_text import PerformanceLogReader
from ariac_score_ariac.official.sensor_cost import SensorCostReader
from ariac_score_ariac.official.trial_log import TrialLogReader
from ariac_score_ariac.work import sensor_cost

READER = TrialLogReader()
WANTED = Wanted(LogMap("test"))

ROW = "=" * 40 + "\n"
SUMMARY_2024 = f"""\
{ROW}Trial Summary
{ROW}Trial file: kitting.yaml
Trial time limit: 500.000000
Time limit reached: no
Completion time: 123.456000
Total number of orders: 3
Number of submitted orders: 2

{ROW}Order Summary
{ROW}Order ID: ABC12345
\tOrder type: kitting
\tOrder submitted: yes
\tPriority: no
\tMax task score: 9
\tActual task score: -2
\tSubmission time: 100.002000
\tSubmission duration: 98.002000
Order ID: ABC12346
\tOrder type: assembly
\tOrder submitted: yes
\tPriority: yes
\tMax task score: 8
\tActual task score: 3
\tSubmission time: 120.500000
\tSubmission duration: 20.250000
Order ID: ABC12347
\tOrder type: combined
\tOrder submitted: no
\tPriority: no
\tMax task score: 12
\tActual task score: 0
\tSubmission time: N/A
\tSubmission duration: N/A

"""
DETAILS_2024 = f"""\
{ROW}Order Details
{ROW}Order ID: ABC12345
\tType: kitting
\tPriority: no
\tAGV: 2
\tCorrect tray: yes
\tCorrect destination: yes
\tMax score: 9
\tActual score: -2
\tBonus: 0
\tQuadrant: 1
\t\tScore: 2
\t\tCorrect part type: yes
\t\tCorrect part color: no
\t\tFaulty part: no
\t\tFlipped part: no
Order ID: ABC12346
\tType: assembly
\tPriority: yes
\tStation: 3
\tMax score: 8
\tActual score: 3
\tBonus: 0
\t-----------------------
\tParts Summary
\t-----------------------
\tPart: red battery
\t\tPart score: 3
\t\tCorrect type: yes
\t\tCorrect color: yes
\t\tCorrect pose: yes
\t\t\tPosition: -0.150000, 0.035000, 0.043000
\t\t\tOrientation: 0.000000, 0.000000, 1.570796
Order ID: ABC12347
\tNot Submitted
"""
LOG_2024 = SUMMARY_2024 + DETAILS_2024

LOG_2023 = f"""\
Order: MMB30H56
Type: Kitting
AGV: 4
Tray score: 3
Correct destination: Yes
Bonus: 0
Score: 8
Quadrant: 1
Quadrant score: 3
------------------------
Correct part type: Yes
Correct part color: Yes
Faulty part: No
Flipped part: No
Quadrant: 3
Quadrant score: 2
------------------------
Correct part type: Yes
Correct part color: No
Faulty: No
Flipped: Yes




{ROW}END OF TRIAL
{ROW}Trial file: kitting.yaml
Trial time limit: -1
Trial completion time: 88.5
Trial score: 8
ORDERS
Kitting order
Announcement time: 0.5
Submission time: 80.25
Score: 8
"""
INTERIM_2023 = f"""\
{ROW}Trial file: combined.yaml
Trial score: 12
{ROW}Orders Summary
{ROW}-Order ID: MMB30H56
\t-Type: Kitting
\t-Tray score: 3
\t-Score: 12
\t-Max score: 19.000000
\t-Announcement time: 0.500000
\t-Submission time: 80.250000
\t-Completion time: 79.750000
-Order ID: MMB30H57
\t-Type: Assembly
\t-Max score: 14.000000
\t-Announcement time: 10.000000
"""
CRASHED = "Gazebo Crashed score not recorded\n"
CANCELLED = "Process cancelled by user"


def read(folder: Path, text: str, name: str = "trial_log.txt") -> Trial:
    path = folder / name
    path.write_text(text, encoding="utf-8", newline="")
    return READER.read(path, WANTED)


def official(folder: Path, text: str, name: str = "trial_log.txt") -> OfficialResult:
    result = read(folder, text, name).official
    assert result is not None
    return result


def refusal(folder: Path, text: str) -> LogError:
    with pytest.raises(LogError) as caught:
        read(folder, text)
    assert str(folder) in str(caught.value)
    assert caught.value.hint
    described = READER.describe(folder / "trial_log.txt")
    assert described.damage == str(caught.value)
    return caught.value


def test_is_a_reader() -> None:
    assert isinstance(READER, Reader)


# 2024 ----------------------------------------------------------------------------------


def test_the_scores_of_2024_carry_no_priority_and_may_be_negative(tmp_path: Path) -> None:
    result = official(tmp_path, LOG_2024)

    assert dict(result.orders) == {"ABC12345": -2.0, "ABC12346": 3.0, "ABC12347": 0.0}
    assert (result.total, result.process_time_s, result.outcome) == (1.0, 123.456, "")
    assert [(o.kind, o.submitted, o.priority, o.max_score) for o in result.summaries] == [
        ("kitting", True, False, 9.0),
        ("assembly", True, True, 8.0),
        ("combined", False, False, 12.0),
    ]


# 100.002 - 98.002 = 2, 120.5 - 20.25 = 100.25
def test_an_order_was_announced_its_duration_before_its_submission(tmp_path: Path) -> None:
    trial = read(tmp_path, LOG_2024)

    assert {e.subject: e.t_s for e in trial.events_of("order_announced")} == {
        "ABC12345": 2.0,
        "ABC12346": 100.25,
    }
    assert [(s.item_id, s.submitted_s, s.contents, s.agv, s.station) for s in trial.submissions] == [
        ("ABC12345", 100.002, None, "agv2", ""),
        ("ABC12346", 120.5, None, "", "as3"),
    ]
    assert (trial.started_s, trial.ended_s, trial.id) == (0.0, 123.456, "kitting")
    assert trial.witnessed == {"submissions"}
    assert not trial.log_defects


def test_the_details_are_kept_as_printed(tmp_path: Path) -> None:
    kit, assembly, missing = official(tmp_path, LOG_2024).summaries

    assert kit.items["correct_tray"] == "yes"
    assert kit.items["quadrant_1/correct_part_color"] == "no"
    assert assembly.items["part_red_battery/position"] == "-0.150000, 0.035000, 0.043000"
    assert (assembly.items["bonus"], dict(missing.items)) == ("0", {})


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\n", "\r\n"),
        ("Trial Summary", "\x1b[1mTrial Summary\x1b[0m"),
        ("Completion time: 123.456000", "Seed: 7\nCompletion time: 123.456"),
        ("\tMax task score: 9\n", "\tRemark: none\n\tMax task score: 9.0\n"),
        ("\tAGV: 2\n", "\tGripper: vacuum\n\tAGV: 2\n"),
        ("Trial time limit: 500.000000", "No time limit"),
        ("Actual task score: 0", "Actual task score: -0"),
    ],
)
def test_more_labels_and_other_spellings_do_no_harm(tmp_path: Path, old: str, new: str) -> None:
    result = official(tmp_path, LOG_2024.replace(old, new))

    assert (result.total, len(result.summaries)) == (1.0, 3)


def test_a_trial_without_any_submission_has_a_total_of_zero(tmp_path: Path) -> None:
    text = (
        SUMMARY_2024.replace("submitted: yes", "submitted: no")
        .replace("-2\n", "0\n")
        .replace("score: 3\n", "score: 0\n")
    )
    for time in ("100.002000", "98.002000", "120.500000", "20.250000"):
        text = text.replace(time, "N/A")
    details = "".join(f"Order ID: ABC1234{n}\n\tNot Submitted\n" for n in (5, 6, 7))
    trial = read(tmp_path, text + f"{ROW}Order Details\n{ROW}" + details)

    assert trial.official is not None
    assert (trial.official.total, trial.submissions) == (0.0, ())
    assert trial.witnessed == {"submissions"}


LINES = LOG_2024.splitlines(keepends=True)


@pytest.mark.parametrize("kept", list(range(3, len(LINES))))
def test_a_text_cut_between_lines_is_refused_wherever_it_is_cut(tmp_path: Path, kept: int) -> None:
    text = "".join(LINES[:kept])
    if text.rstrip().endswith("Order ID: ABC12347") and "Order Details" in text:
        return  # only 'Not Submitted' is missing, which the summary says as well
    error = refusal(tmp_path, text)

    assert "cut off" in error.cause


@pytest.mark.parametrize("ending", ["\t\tFlipped part: n", "\t\t\tOrientation: 0.000000, 0.0"])
def test_a_text_cut_within_a_value_is_refused(tmp_path: Path, ending: str) -> None:
    label = ending.strip().partition(":")[0]
    cut = LOG_2024[: LOG_2024.index(label)].rstrip("\t") + ending

    assert "cut off" in refusal(tmp_path, cut).cause


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ("Actual task score: -2", "Actual task score: two", "is not a number"),
        ("Actual task score: -2", "Actual task score: nan", "is not a number"),
        ("Order submitted: no", "Order submitted: maybe", "is neither yes nor no"),
        ("Submission time: 100.002000", "Submission time: -1", "is before the start"),
        ("Completion time: 123.456000", "Completion time: -3", "is before the start"),
        ("duration: 98.002000", "duration: 100.500000", "more than from the start to its submission"),
        ("Order ID: ABC12346\n\tOrder", "Order ID: ABC12345\n\tOrder", "is given twice"),
        ("number of orders: 3", "number of orders: 4", "4 orders are announced, 3 are listed"),
        ("number of orders: 3", "number of orders: 2", "2 orders are announced, 3 are listed"),
    ],
)
def test_a_value_that_is_none_is_refused_by_its_label(tmp_path: Path, old: str, new: str, cause: str) -> None:
    assert cause in refusal(tmp_path, LOG_2024.replace(old, new, 1)).cause


@pytest.mark.parametrize(("printed", "score"), [("1.5e-300", 1.5e-300), ("-2e+1", -20.0), ("1e308", 1e308)])
def test_a_number_may_have_an_exponent_of_three_digits(tmp_path: Path, printed: str, score: float) -> None:
    text = LOG_2024.replace("task score: -2", f"task score: {printed}", 1)

    assert official(tmp_path, text).orders["ABC12345"] == score


@pytest.mark.parametrize("printed", ["1e309", "-1e999", "1e1000", "1e", "nan", "inf"])
def test_a_number_beyond_all_numbers_is_none(tmp_path: Path, printed: str) -> None:
    text = LOG_2024.replace("task score: -2", f"task score: {printed}", 1)

    assert "is not a number" in refusal(tmp_path, text).cause


def test_a_wrong_value_is_shown_with_its_line(tmp_path: Path) -> None:
    error = refusal(tmp_path, LOG_2024.replace("Actual task score: -2", "Actual task score: two"))

    assert error.place == "line 19"
    assert error.cause == "'Actual task score' of order ABC12345: 'two' is not a number"


# What the evaluation script writes instead ---------------------------------------------


@pytest.mark.parametrize(("text", "outcome"), [(CRASHED, "crashed"), (CANCELLED, "cancelled")])
def test_a_run_without_a_score_has_a_named_outcome(tmp_path: Path, text: str, outcome: str) -> None:
    trial = read(tmp_path, text)

    assert trial.official is not None
    assert (trial.official.outcome, trial.official.total, dict(trial.official.orders)) == (outcome, None, {})
    assert [defect.kind for defect in trial.log_defects] == [outcome]
    assert (trial.witnessed, trial.submissions, trial.events) == (frozenset(), (), ())
    assert READER.describe(tmp_path / "trial_log.txt").facts["outcome"] == outcome


def test_a_crash_text_within_a_score_is_not_a_crash(tmp_path: Path) -> None:
    assert official(tmp_path, LOG_2024 + CRASHED).outcome == ""


# 2023 ----------------------------------------------------------------------------------


def test_the_layout_of_2023_at_release(tmp_path: Path) -> None:
    trial = read(tmp_path, LOG_2023, "kitting.txt")

    assert trial.official is not None
    assert (trial.official.total, trial.official.process_time_s) == (8.0, 88.5)
    assert dict(trial.official.orders) == {"MMB30H56": 8.0}
    (kit,) = trial.official.summaries
    assert (kit.kind, kit.items["tray_score"], kit.items["quadrant_3/score"]) == ("kitting", "3", "2")
    # quadrant 1 says 'Flipped part', quadrant 3 'Flipped'
    assert (kit.items["quadrant_1/flipped_part"], kit.items["quadrant_3/flipped_part"]) == ("No", "Yes")


def test_the_layout_at_release_proves_no_order_unsubmitted_and_dates_none(tmp_path: Path) -> None:
    trial = read(tmp_path, LOG_2023, "kitting.txt")

    assert trial.witnessed == frozenset()
    assert [(s.item_id, s.submitted_s, s.agv) for s in trial.submissions] == [("MMB30H56", 88.5, "agv4")]
    assert [defect.kind for defect in trial.log_defects] == ["unknown_submission_time"]


def test_the_interim_layout_of_2023_dates_its_orders(tmp_path: Path) -> None:
    trial = read(tmp_path, INTERIM_2023, "combined.txt")

    assert trial.official is not None
    assert trial.official.total == 12.0
    assert [(o.id, o.score, o.max_score, o.announced_s) for o in trial.official.summaries] == [
        ("MMB30H56", 12.0, 19.0, 0.5),
        ("MMB30H57", None, 14.0, 10.0),
    ]
    assert [(s.item_id, s.submitted_s) for s in trial.submissions] == [("MMB30H56", 80.25)]
    assert trial.witnessed == frozenset()


def test_the_completion_times_of_orders_do_not_tell_when_the_trial_ended(tmp_path: Path) -> None:
    # As the simulator computes them: 80.25 s of the submission less 0.5 s of the announcement.
    assert "Completion time: 79.75" in INTERIM_2023
    untold = read(tmp_path, INTERIM_2023)
    told = read(
        tmp_path, INTERIM_2023.replace("Trial score: 12", "Trial completion time: 95.5\nTrial score: 12")
    )

    assert (untold.ended_s, told.ended_s) == (None, 95.5)
    assert untold.official is not None
    assert untold.official.process_time_s is None


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (LOG_2023[: LOG_2023.index("END OF")], "there is no end of the trial"),
        (LOG_2023[: LOG_2023.index("Trial score")], "the end of the trial has no 'trial score'"),
        (INTERIM_2023[:-3], "its last line has no end"),
        (INTERIM_2023[: INTERIM_2023.index("-Order")], "no order is listed"),
        (LOG_2023.replace("Trial score: 8", "Trial score: x"), "is not a number"),
        (LOG_2023.replace("Order: MMB30H56\n", "Order: MMB30H56\n" * 2), "is given twice"),
    ],
)
def test_a_damaged_text_of_2023_is_refused(tmp_path: Path, text: str, cause: str) -> None:
    assert cause in refusal(tmp_path, text).cause


# Recognising ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "text", "ours"),
    [
        ("trial_log.txt", LOG_2024, True),
        ("trial_log.txt", "", True),
        ("renamed.txt", LOG_2024, True),
        ("kitting.txt", LOG_2023, True),
        ("kitting.txt", LOG_2023[:200], True),
        ("combined.txt", INTERIM_2023, True),
        ("run.txt", CRASHED, True),
        ("run.txt", CANCELLED, True),
        ("notes.txt", "the Trial Summary is in another file\n", False),
        ("notes.txt", "Order: more bolts\n", False),
        ("trial.yaml", LOG_2024, False),
        ("binary.txt", "Trial Summary\n\0", False),
        ("performance.log", "Gazebo multi-robot simulator, version 9\n", False),
    ],
)
def test_it_is_known_by_its_content(tmp_path: Path, name: str, text: str, ours: bool) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")

    assert READER.can_read(path) is ours
    assert not (ours and PerformanceLogReader().can_read(path))
    assert not (ours and SensorCostReader().can_read(path))


def test_what_is_not_there_is_not_ours(tmp_path: Path) -> None:
    assert not READER.can_read(tmp_path / "trial_log.txt")
    assert not READER.can_read(tmp_path)
    with pytest.raises(NothingToScoreError, match="no such file"):
        READER.read(tmp_path / "trial_log.txt", WANTED)


@pytest.mark.parametrize(
    ("text", "cause"), [("", "is empty"), (" \n\n", "is empty"), ("hello\n", "no score text")]
)
def test_a_file_of_that_name_with_nothing_in_it_is_refused(tmp_path: Path, text: str, cause: str) -> None:
    assert cause in refusal(tmp_path, text).cause


def test_a_file_beyond_all_size_is_refused(tmp_path: Path) -> None:
    assert "more than 4,000,000 bytes" in refusal(tmp_path, "Trial Summary\n" + "=" * 4_000_000).cause


def test_it_describes_itself(tmp_path: Path) -> None:
    read(tmp_path, LOG_2024)
    described = READER.describe(tmp_path / "trial_log.txt")

    assert dict(described.facts) == {"layout": "2024", "total": 1.0, "orders": 3, "submitted": 2}
    assert (described.duration_s, described.damage) == (123.456, "")


# With its neighbours -------------------------------------------------------------------

TRIAL_2024 = """\
orders:
  - id: 'ABC12345'
    type: 'kitting'
    announcement: {time_condition: 2}
    priority: false
    kitting_task: {agv_number: 2, tray_id: 3, destination: warehouse,
      products: [{type: battery, color: blue, quadrant: 3}]}
"""
COST = "User Sensor Log\nNumber of lidar's used: 2\nTotal sensor cost is: $600\n------\n"


def test_the_folder_of_an_evaluation_is_one_trial(tmp_path: Path) -> None:
    (tmp_path / "trial_log.txt").write_text(LOG_2024, encoding="utf-8")
    (tmp_path / "sensor_cost.txt").write_text(COST, encoding="utf-8")
    (tmp_path / "kitting.yaml").write_text(TRIAL_2024, encoding="utf-8")
    readers: dict[str, Reader] = {
        "ariac_config": TrialConfigReader(),
        "gazebo_text": PerformanceLogReader(),
        "sensor_cost": SensorCostReader(),
        "trial_log": READER,
    }
    bundle = find_parts(tmp_path, readers)
    trial = merge_trials(
        "run_1",
        [readers[p.reader].read(p.path, WANTED) for p in bundle.parts],
        file="run_1",
        competition=Ariac(),
    )

    assert [part.role for part in bundle.parts] == ["trial_config", "sensor_cost", "official"]
    (order,) = trial.work
    assert (order.announced_s, trial.submissions[0].submitted_s) == (2.0, 100.002)
    assert trial.team is not None
    assert (sensor_cost(trial), dict(trial.team.sensors or {})) == (
        600.0,
        {"lidar_1": "lidar", "lidar_2": "lidar"},
    )
