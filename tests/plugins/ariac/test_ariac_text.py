"""The reader of `performance.log`, against the real one of 2022, found fragments and hand-written text."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.contracts import Reader, Wanted
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.trial.channels import LogMap
from ariac_score.trial.events import Event
from ariac_score.trial.model import Trial
from ariac_score_ariac.official.ariac_text import PerformanceLogReader

ARIAC = Path(__file__).parents[3].parent / "shared" / "ariac" / "data"
REAL = ARIAC / "nist_team_2022" / "performance.log"
needs_real_log = pytest.mark.skipif(not REAL.is_file(), reason="the official logs are not here")

READER = PerformanceLogReader()
WANTED = Wanted(LogMap("test"))

BANNER = "Gazebo multi-robot simulator, version 9.19.0\n\n"
PACE = "".join(f"({100 + 2 * n} 0) [Dbg] [TaskManagerPlugin.cc:1754] Sim time: {n}\n" for n in range(1, 11))
START = "(107 0) [Dbg] [TaskManagerPlugin.cc:2495] [Service Call] Start Competition\n"
ORDER = (
    "(108 0) [Dbg] [TaskManagerPlugin.cc:3275] \n------------------------\n    Announcing Order\n"
    "-Order ID: order_0\n-Priority: \x1b[1;33mREGULAR\x1b[0m\n-Configuration File: kitting.yaml\n\n"
)
STOP = "(119 500000000) [Dbg] [TaskManagerPlugin.cc:2581] [Service Call] End Competition\n"
HEADER_2022 = (
    "(119 600000000) [Dbg] [TaskManagerPlugin.cc:1907] \n------------------------\n"
    "    \x1b[1;32mFinal Score: 8\x1b[0m\n    Configuration File: kitting.yaml\n------------------------\n"
    "...total process time: [6.25]\n...arms collision?: [0]\n...dropped part penalty: [0]\n"
)
ORDER_2022 = (
    "------------------------\n   Order Score\n------------------------\n   ...order ID [order_0]\n"
    "   ...total order score: [8]\n   ...completion score: [8]\n   ...time taken: [{taken}]\n"
    "   ...priority: [1]\n"
)
KITTING_2022 = (
    "      [kitting score]\n      ...shipment type: [order_0_kitting_shipment_{k}]\n"
    "      ...completion score: [8]\n      ...complete: [true]\n      ...submitted: [{submitted}]\n"
)
STOPPED = "\n\n(121 0) [Msg] Requesting that Gazebo shut down\n"

IDLE = BANNER + PACE + START + ORDER + STOP + HEADER_2022 + ORDER_2022.format(taken=0) + STOPPED


def kitting(*submitted: str, taken: str = "4.5") -> str:
    """A log whose order has one shipment for each word."""
    shipments = "".join(KITTING_2022.format(k=k, submitted=word) for k, word in enumerate(submitted))
    score = HEADER_2022 + ORDER_2022.format(taken=taken) + shipments
    return BANNER + PACE + START + ORDER + STOP + score + STOPPED


def read(folder: Path, text: str) -> Trial:
    path = folder / "performance.log"
    path.write_text(text, encoding="utf-8")
    return READER.read(path, WANTED)


def times_of(trial: Trial, kind: str) -> list[float]:
    return [event.t_s for event in trial.events_of(kind)]


def test_is_a_reader() -> None:
    assert isinstance(READER, Reader)


def test_progress_ends_at_one(tmp_path: Path) -> None:
    shares: list[float] = []
    path = tmp_path / "performance.log"
    path.write_text(IDLE, encoding="utf-8")
    READER.read(path, Wanted(LogMap("test"), progress=shares.append))

    assert shares[-1] == 1.0


# The real logs


@needs_real_log
def test_the_real_trial_lasts_as_long_as_the_official_process_time_says() -> None:
    trial = READER.read(REAL, WANTED)

    assert trial.id == "kitting"
    assert trial.started_s is not None
    assert trial.ended_s is not None
    assert trial.ended_s - trial.started_s == pytest.approx(14.852, abs=0.02)
    # state.log, by its wall times: 10.8607 s.
    assert trial.started_s == pytest.approx(10.8607, abs=0.02)


@needs_real_log
def test_the_real_trial_has_its_official_numbers_and_submitted_nothing() -> None:
    trial = READER.read(REAL, WANTED)

    assert trial.official is not None
    assert (trial.official.total, trial.official.process_time_s) == (0.0, 14.852)
    assert trial.official.orders == {"order_0": 0.0}
    assert trial.witnessed == {"submissions", "arm_collision", "part_dropped"}
    assert [event.subject for event in trial.events_of("order_announced")] == ["order_0"]
    assert (trial.submissions, trial.log_defects) == ((), ())


FOUND = {
    "osrf_docker_2017_score_block.log": ("2017", 27, 75.143, {"order_0": 12}, ["order_0_kit_0"]),
    "osrf_docker_2018_example_team_performance_tail.log": ("2018", 0, 10.433, {"order_0": 0}, []),
    "sandeep_kota_group1_2020_score_block.log": (
        "2019-2020",
        36,
        843.816,
        {"order_0": 12, "order_1": 24},
        ["order_0_shipment_0", "order_1_shipment_0"],
    ),
    "usnist_2021_automated_evaluation_tail.log": (
        "2021",
        4,
        73.644,
        {"order_0": 4},
        ["order_0_kitting_shipment_0"],
    ),
    "usnist_2021_finals_practice1_console.log": (
        "2021",
        16,
        9.607,
        {"order_0": 8, "order_1": 8},
        ["order_0_kitting_shipment_0", "order_1_kitting_shipment_0"],
    ),
    "usnist_2021_finals_practice2_console.log": (
        "2021",
        56,
        12.021,
        {"order_0": 14, "order_1": 42},
        ["order_0_assembly_shipment_0", "order_1_assembly_shipment_0"],
    ),
}


@needs_real_log
@pytest.mark.parametrize("name", FOUND)
def test_found_fragments_give_the_printed_numbers(name: str) -> None:
    layout, total, process_time_s, orders, submitted = FOUND[name]
    path = ARIAC / "found" / name

    trial = READER.read(path, WANTED)

    assert READER.can_read(path)
    assert READER.describe(path).facts["layout"] == layout
    assert trial.official is not None
    assert (trial.official.total, trial.official.process_time_s) == (total, process_time_s)
    assert trial.official.orders == orders
    assert [submission.item_id for submission in trial.submissions] == submitted
    assert all(submission.contents is None for submission in trial.submissions)
    assert "submissions" not in trial.witnessed


@needs_real_log
def test_every_found_log_is_listed_here() -> None:
    assert {path.name for path in (ARIAC / "found").glob("*.log")} == set(FOUND)


@needs_real_log
def test_ros_text_logs_and_other_files_of_the_trial_are_not_claimed() -> None:
    claimed = [path.name for path in sorted(REAL.parent.rglob("*")) if READER.can_read(path)]

    assert claimed == ["performance.log"]


# The clock


def test_times_lie_evenly_between_whole_seconds_and_go_on_beyond_them(tmp_path: Path) -> None:
    trial = read(tmp_path, IDLE.replace("(119 500000000)", "(123 0)"))

    assert trial.started_s == pytest.approx(3.5)
    assert times_of(trial, "order_announced") == pytest.approx([4.0])
    assert trial.ended_s == pytest.approx(11.5)


def test_nanoseconds_are_a_number_not_a_fraction(tmp_path: Path) -> None:
    trial = read(tmp_path, IDLE.replace("(107 0)", "(107 20000000)"))

    assert trial.started_s == pytest.approx(3.51)


def test_without_an_end_call_the_final_score_ends_the_trial(tmp_path: Path) -> None:
    trial = read(tmp_path, IDLE.replace(STOP, ""))

    assert trial.ended_s == pytest.approx(9.8)


def test_events_without_two_known_seconds_are_left_out_and_counted(tmp_path: Path) -> None:
    trial = read(tmp_path, IDLE.replace(PACE, ""))

    assert not trial.events
    assert [(defect.kind, defect.count) for defect in trial.log_defects] == [("untimed_events", 3)]


def test_a_ros_record_brings_its_own_simulated_time(tmp_path: Path) -> None:
    text = "[ INFO] [1622240698.540821194, 18.454000000]: End of trial. Final score: 16\nScore breakdown:\n"

    assert read(tmp_path, text).ended_s == 18.454


def test_orders_of_other_years_and_updates_are_announced(tmp_path: Path) -> None:
    text = (
        BANNER
        + PACE
        + "(104 0) [Dbg] [A.cc:1] Handle start service called\n"
        + "(106 0) [Dbg] [A.cc:2] New order to announce: order_0\n"
        + "(110 0) [Dbg] [A.cc:3] Order to update: order_0_update_0\n"
        + "(120 0) [Dbg] [A.cc:4] Handle end service called\n"
    )

    trial = read(tmp_path, text)

    assert (trial.started_s, trial.ended_s) == (2.0, 10.0)
    assert trial.events_of("order_announced") == (
        Event(3.0, "order_announced", "order_0"),
        Event(5.0, "order_announced", "order_0_update_0"),
    )


def test_two_runs_in_one_file_are_refused(tmp_path: Path) -> None:
    again = "(140 0) [Dbg] [TaskManagerPlugin.cc:1754] Sim time: 1\n"

    with pytest.raises(LogError, match="runs backwards, from 10 s to 1 s"):
        read(tmp_path, IDLE + again)


# What the score says


def test_a_whole_log_without_a_shipment_proves_that_nothing_was_submitted(tmp_path: Path) -> None:
    trial = read(tmp_path, IDLE)

    assert trial.official is not None
    assert trial.official.total == 8.0
    assert "submissions" in trial.witnessed


@pytest.mark.parametrize(
    "text",
    [
        IDLE.replace(STOPPED, "\n"),
        IDLE.replace("...total process time: [6.25]\n", ""),
        IDLE.replace(ORDER_2022.format(taken=0), ""),
        IDLE.replace(STOP, "(112 0) [Dbg] [T.cc:1] [Service Call] Submit Assembly Shipment\n" + STOP),
        kitting("false"),
        BANNER + PACE + START + ORDER + STOP,
    ],
    ids=["nothing follows", "no process time", "no order", "a submit call", "a shipment block", "no score"],
)
def test_anything_less_proves_nothing_about_submissions(tmp_path: Path, text: str) -> None:
    assert "submissions" not in read(tmp_path, text).witnessed


def test_a_submitted_shipment_is_dated_by_the_time_its_order_took(tmp_path: Path) -> None:
    (submission,) = (trial := read(tmp_path, kitting("true"))).submissions

    assert submission.item_id == "order_0_kitting_shipment_0"
    assert submission.submitted_s == pytest.approx(4.0 + 4.5)
    assert submission.contents is None
    assert trial.log_defects == ()


def test_of_several_shipments_only_the_last_is_dated_with_a_remark(tmp_path: Path) -> None:
    trial = read(tmp_path, kitting("true", "true"))

    assert [s.submitted_s for s in trial.submissions] == pytest.approx([8.5, 8.5])
    assert [(d.kind, d.count) for d in trial.log_defects] == [("unknown_submission_time", 2)]


def test_a_shipment_of_an_unfinished_order_gets_the_end_of_the_trial(tmp_path: Path) -> None:
    trial = read(tmp_path, kitting("true", "false", taken="0"))

    (submission,) = trial.submissions
    assert submission.item_id == "order_0_kitting_shipment_0"
    assert submission.submitted_s == pytest.approx(9.75)
    assert [(d.kind, d.count) for d in trial.log_defects] == [("unknown_submission_time", 1)]


def test_a_collision_that_the_score_counts_is_an_event_at_the_end(tmp_path: Path) -> None:
    trial = read(tmp_path, IDLE.replace("collision?: [0]", "collision?: [1]"))

    assert times_of(trial, "arm_collision") == pytest.approx([9.75])
    assert "arm_collision" in trial.witnessed


def test_drops_are_as_many_as_the_score_counts_and_dated_where_a_record_says(tmp_path: Path) -> None:
    dropped = "(114 0) [Dbg] [T.cc:1] Penalty Applied: 1\n"
    text = IDLE.replace(STOP, dropped + STOP).replace("penalty: [0]", "penalty: [2]")

    assert times_of(read(tmp_path, text), "part_dropped") == pytest.approx([7.0, 9.75])


def test_years_without_a_line_for_it_witness_no_drops(tmp_path: Path) -> None:
    trial = read(tmp_path, IDLE.replace("...dropped part penalty: [0]\n", ""))

    assert "part_dropped" not in trial.witnessed
    assert "arm_collision" in trial.witnessed


def test_the_last_score_is_the_final_one(tmp_path: Path) -> None:
    running = "(112 0) [Dbg] [T.cc:1] Game score: ...total process time: [1]\n   ...order ID [order_0]\n"
    text = IDLE.replace(STOP, running + HEADER_2022.replace("Score: 8", "Score: 3") + STOP)

    trial = read(tmp_path, text)

    assert trial.official is not None
    assert trial.official.total == 8.0


def test_the_labels_of_the_last_scorer_of_2022_are_understood(tmp_path: Path) -> None:
    text = (
        "(1 0) [Dbg] [T.cc:1] \nFinal Score: 24\nConfiguration File: qual_a.yaml\n"
        "...total process time: [61.2]\n...arms collision?: [0]\n...dropped part penalty: [0]\n"
        "Order Score\n...order ID: [order_0]\n...total order score = completion score x priority: [24]\n"
        "...completion score: [8]\n...priority: [3]\n...time taken: [55.1]\n"
        "Kitting Score\n...shipment type: [order_0_kitting_shipment_0]\n...submitted?: [true]\n"
        "Assembly Score\n...shipment type: [order_0_assembly_shipment_0]\n...shipped?: [false]\n"
    )

    trial = read(tmp_path, text)

    assert trial.id == "qual_a"
    assert trial.official is not None
    assert (trial.official.total, trial.official.orders) == (24.0, {"order_0": 24.0})
    assert [submission.item_id for submission in trial.submissions] == ["order_0_kitting_shipment_0"]


def test_shipments_without_a_printed_type_are_named_by_their_alphabetical_place(tmp_path: Path) -> None:
    block = "<shipment_score >\n\tSubmitted: [true]\n</shipment_score>\n"
    text = (
        "Score breakdown:\n<game_score>\n\tTotal game score: [0]\n<order_score order_0>\n"
        + block * 11
        + "</order_score>\n</game_score>\n"
    )

    ids = [submission.item_id for submission in read(tmp_path, text).submissions]

    assert ids[:4] == [
        "order_0_shipment_0",
        "order_0_shipment_1",
        "order_0_shipment_10",
        "order_0_shipment_2",
    ]


# Damage


def test_a_log_cut_anywhere_never_crashes_nor_claims_what_it_cannot_know(tmp_path: Path) -> None:
    end_of_score = IDLE.index(STOPPED)
    for cut in range(1, len(IDLE), 23):
        trial = read(tmp_path, IDLE[:cut])
        if cut <= end_of_score:
            assert "submissions" not in trial.witnessed
        assert trial.official is None or trial.official.total == 8.0
        assert trial.ended_s is None or cut > IDLE.index(STOP)


def test_a_log_that_ends_before_the_score_has_no_official_result(tmp_path: Path) -> None:
    trial = read(tmp_path, BANNER + PACE + START + ORDER)

    assert trial.official is None
    assert trial.ended_s is None
    assert trial.started_s == pytest.approx(3.5)
    assert trial.witnessed == frozenset()


def test_a_number_at_the_cut_is_not_taken_for_another(tmp_path: Path) -> None:
    cut = IDLE[: IDLE.index("Final Score: 8")] + "Final Score: 3"

    assert read(tmp_path, cut).official is None


def test_an_empty_log_is_nothing_to_score(tmp_path: Path) -> None:
    path = tmp_path / "performance.log"
    path.write_text("", encoding="utf-8")

    assert READER.can_read(path)
    assert "empty" in READER.describe(path).damage
    with pytest.raises(NothingToScoreError, match="empty"):
        READER.read(path, WANTED)


def test_a_missing_log_is_nothing_to_score(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="no such file"):
        READER.read(tmp_path / "performance.log", WANTED)


def test_bytes_that_are_no_text_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "performance.log"
    path.write_bytes(IDLE.encode().replace(b"\n\n(121", b"\n\xff\xfe \x80\n(121").replace(b"\n", b"\r\n"))

    trial = READER.read(path, WANTED)

    assert trial.official is not None
    assert trial.official.orders == {"order_0": 8.0}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("rosout.log", "1651447462.110454530  Node Startup\n0.0 INFO /gazebo [x] y\n    Final Score: 0\n"),
        ("node.log", "[rospy.client][INFO] 2022-05-01 23:24:44,520: init_node\n"),
        ("notes.md", "Score breakdown:\n"),
        ("empty.log", ""),
        ("blank.log", "\n\n"),
        ("binary.log", "Score breakdown:\n\0"),
        ("state.log", "<?xml version='1.0'?>\n<gazebo_log>\n"),
    ],
)
def test_other_files_are_not_claimed(tmp_path: Path, name: str, text: str) -> None:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")

    assert not READER.can_read(path)
    assert not READER.can_read(tmp_path)
    assert not READER.can_read(tmp_path / "missing.log")


# rulebook 2019, code: "the last update naming an order wins: its shipments and its time become the order's".
# 2 s of wall time are one of simulated time here, and 100 s are 0 s.
@pytest.mark.parametrize(("updates", "announced_s"), [(0, 4.0), (1, 5.0), (2, 6.0)])
def test_the_time_of_an_order_runs_from_the_last_update_of_it(
    tmp_path: Path, updates: int, announced_s: float
) -> None:
    printed = "".join(
        f"({110 + 2 * n} 0) [Dbg] [A.cc:3] Order to update: order_0_update_{n}\n" for n in range(updates)
    )

    trial = read(tmp_path, kitting("true", taken="3.5").replace(ORDER, ORDER + printed))

    assert trial.official is not None
    (order,) = trial.official.summaries
    assert order.announced_s == pytest.approx(announced_s)
    assert order.submitted_s == pytest.approx(announced_s + 3.5)
    assert [s.submitted_s for s in trial.submissions] == pytest.approx([announced_s + 3.5])


def test_an_update_of_another_order_does_not_restart_an_order(tmp_path: Path) -> None:
    other = "(112 0) [Dbg] [A.cc:3] Order to update: order_1_update_0\n"

    (submission,) = read(tmp_path, kitting("true", taken="3.5").replace(ORDER, ORDER + other)).submissions

    assert submission.submitted_s == pytest.approx(4.0 + 3.5)
