"""The organisers' evaluation of 2023/24, worked by hand from the rulebook notes, section 9."""

from __future__ import annotations

import pytest

from ariac_score_ariac.evaluation.nist_text import (
    Evaluation,
    PlannedItem,
    RunTexts,
    Stop,
    evaluate,
    results_csv,
)

ROW = "=" * 40
ORDERS = {"kitting": [PlannedItem("AAAA0001", priority=False), PlannedItem("BBBB0002", priority=True)]}


def trial_log(*orders: tuple[str, int, float | None], completion_s: float = 100.0) -> str:
    """A `trial_log.txt` as in the notes, section 5.1; an order without a duration is not submitted."""
    lines = [ROW, "Trial Summary", ROW, "Trial file: kitting.yaml", "Trial time limit: 500.000000"]
    lines += ["Time limit reached: no", f"Completion time: {completion_s:.6f}"]
    lines += [f"Total number of orders: {len(orders)}", "Number of submitted orders: 1", ""]
    lines += [ROW, "Order Summary", ROW]
    for name, score, duration_s in orders:
        handed_in = "no" if duration_s is None else "yes"
        lines += [f"Order ID: {name}", "\tOrder type: kitting", f"\tOrder submitted: {handed_in}"]
        lines += ["\tPriority: no", "\tMax task score: 9", f"\tActual task score: {score}"]
        lines += [f"\tSubmission time: {'N/A' if duration_s is None else '99.000000'}"]
        lines += [f"\tSubmission duration: {'N/A' if duration_s is None else f'{duration_s:.6f}'}"]
    return "\n".join([*lines, "", ROW, "Order Details", ROW, ""])


def cost(dollars: int | str) -> str:
    row = "=" * 30
    kinds = [f"Number of sensor {i}'s used: 0" for i in range(10)]
    return "\n".join(
        [row, "User Sensor Log", row, *kinds, "", "", f"Total sensor cost is: ${dollars}", "-" * 30]
    )


def run(folder: str, log: str | None, dollars: int | str = 1000) -> RunTexts:
    return RunTexts(folder, log, cost(dollars))


def log(
    a: float | None, b: float | None, scores: tuple[int, int] = (9, 5), completion_s: float = 100.0
) -> str:
    return trial_log(("AAAA0001", scores[0], a), ("BBBB0002", scores[1], b), completion_s=completion_s)


def test_two_teams_are_priced_against_their_means() -> None:
    # Mean cost 1500; mean times (50 + 100) / 2 = 75 and (40 + 60) / 2 = 50.
    # alpha: (75/50 * 9 + 3 * 50/40 * 5) * 1500/1000 = (13.5 + 18.75) * 1.5 = 48.375
    # beta: (75/100 * 9 + 3 * 50/60 * 5) * 1500/2000 = (6.75 + 12.5) * 0.75 = 14.4375
    found = evaluate(
        {"alpha": [run("kitting_1", log(50, 40))], "beta": [run("kitting_1", log(100, 60), 2000)]}, ORDERS
    )

    assert found.leaderboard == (("alpha", 48.375), ("beta", pytest.approx(14.4375, rel=1e-12)))
    assert found.stops == ()


def test_the_best_run_has_the_highest_raw_score_then_the_shortest_time_then_comes_first() -> None:
    runs = [
        run("kitting_1", log(50, 40, (3, 3), 10)),
        run("kitting_2", log(50, 40, (4, 4), 90)),
        run("kitting_3", log(50, 40, (4, 4), 80)),
        run("kitting_4", log(50, 40, (4, 4), 80)),
    ]

    assert evaluate({"alpha": runs}, ORDERS).trials["kitting"]["alpha"].run == "kitting_3"


def test_a_priority_factor_is_no_part_of_what_runs_are_chosen_by() -> None:
    runs = [run("kitting_1", log(50, 40, (6, 0))), run("kitting_2", log(50, 40, (0, 5)))]

    assert evaluate({"alpha": runs}, ORDERS).trials["kitting"]["alpha"].run == "kitting_1"


def test_the_mean_cost_leaves_out_teams_without_points_but_their_times_count() -> None:
    # Mean cost 1000 (beta has no points); mean times 75 and 50 all the same.
    # alpha: (1.5 * 9 + 3 * 1.25 * 5) * 1 = 32.25
    found = evaluate(
        {"alpha": [run("kitting_1", log(50, 40))], "beta": [run("kitting_1", log(100, 60, (0, 0)), 9000)]},
        ORDERS,
    )

    assert dict(found.leaderboard) == {"alpha": 32.25, "beta": 0.0}


def test_an_order_that_was_not_handed_in_brings_nothing_and_no_time() -> None:
    # alpha alone handed B in: its mean is its own time. 75/50 * 9 + 3 * 1 * 5 = 28.5
    found = evaluate(
        {"alpha": [run("kitting_1", log(50, 40))], "beta": [run("kitting_1", log(100, None, (9, 0)))]}, ORDERS
    )

    assert dict(found.leaderboard)["alpha"] == 28.5
    assert found.trials["kitting"]["beta"].scores["BBBB0002"] is None


def test_a_negative_score_is_not_clamped() -> None:
    found = evaluate({"alpha": [run("kitting_1", log(50, 40, (-2, -1)))]}, ORDERS)

    assert dict(found.leaderboard)["alpha"] == -2 + 3 * -1


def test_an_order_handed_in_at_once_is_skipped_instead_of_divided_by() -> None:
    found = evaluate({"alpha": [run("kitting_1", log(0, 40))]}, ORDERS)

    assert dict(found.leaderboard)["alpha"] == 15.0
    assert found.stops == ()


def test_a_team_without_runs_of_a_trial_scores_nothing_in_it() -> None:
    orders = {**ORDERS, "assembly": [PlannedItem("CCCC0003", priority=False)]}
    other = run("assembly_1", trial_log(("CCCC0003", 3, 10.0)))
    found = evaluate({"alpha": [run("kitting_1", log(50, 40))], "beta": [other]}, orders)

    assert found.trials["assembly"]["alpha"].scores == {"CCCC0003": None}
    assert dict(found.leaderboard) == {"alpha": 24.0, "beta": 3.0}


def test_a_trial_that_nobody_ran_is_no_trial() -> None:
    orders = {**ORDERS, "assembly": [PlannedItem("CCCC0003", priority=False)]}

    assert list(evaluate({"alpha": [run("kitting_1", log(50, 40))]}, orders).trials) == ["kitting"]


def test_a_folder_without_a_log_is_passed_over() -> None:
    found = evaluate({"alpha": [run("kitting_1", None), run("kitting_2", log(50, 40))]}, ORDERS)

    assert (found.stops, found.trials["kitting"]["alpha"].run) == ((), "kitting_2")


def test_the_run_number_is_what_follows_the_last_underscore() -> None:
    orders = {"kit_easy": ORDERS["kitting"]}
    found = evaluate({"alpha": [run("kit_easy_12", log(50, 40)), run("kit_1", log(1, 1))]}, orders)

    assert found.trials["kit_easy"]["alpha"].run == "kit_easy_12"


def test_an_id_inside_another_id_reads_the_wrong_order_and_says_so() -> None:
    # `first line that contains the id`: B00 is found in AB00 first.
    orders = {"kitting": [PlannedItem("B00", priority=False), PlannedItem("AB00", priority=False)]}
    text = trial_log(("AB00", 7, 10.0), ("B00", 2, 20.0))
    entry = evaluate({"alpha": [run("kitting_1", text)]}, orders).trials["kitting"]["alpha"]

    assert entry.scores == {"B00": 7, "AB00": 7}
    assert entry.remarks == ("order 'B00' is read from the line 'Order ID: AB00'",)


def test_an_order_the_log_does_not_name_gets_the_value_of_the_one_before() -> None:
    entry = evaluate({"alpha": [run("kitting_1", trial_log(("AAAA0001", 9, 50.0)))]}, ORDERS).trials[
        "kitting"
    ]

    assert entry["alpha"].scores == {"AAAA0001": 9, "BBBB0002": 9}
    assert "used again" in entry["alpha"].remarks[0]


def stops_of(*runs: RunTexts) -> Evaluation:
    return evaluate({"alpha": list(runs), "beta": [run("kitting_1", log(50, 40))]}, ORDERS)


@pytest.mark.parametrize(
    ("text", "exception"),
    [
        ("Gazebo Crashed score not recorded\n", "ValueError"),
        ("Process cancelled by user", "ValueError"),
        (log(50, 40).replace("Order Details", "Order"), "ValueError"),
        (log(50, 40).replace("Actual task score: 9", "Actual task score: nine"), "ValueError"),
        (trial_log(("ZZZZ0009", 90, 50.0)), "UnboundLocalError"),
    ],
)
def test_what_ends_the_program_is_named_and_the_others_go_on(text: str | None, exception: str) -> None:
    found = stops_of(run("kitting_1", text), run("kitting_2", log(50, 40)))

    assert [(s.trial, s.team, s.run, s.exception) for s in found.stops] == [
        ("kitting", "alpha", "kitting_1", exception)
    ]
    assert found.leaderboard == (("alpha", 24.0), ("beta", 24.0))


def test_a_cost_of_nothing_is_a_division_by_zero_and_costs_that_team_alone() -> None:
    found = stops_of(run("kitting_1", log(50, 40), 0))

    assert Stop("kitting", "alpha", "kitting_1", "ZeroDivisionError", "the sensor cost is 0") in found.stops
    assert [team for team, _ in found.leaderboard] == ["beta"]


@pytest.mark.parametrize("text", ["", "Total sensor cost is: $3000"])
def test_a_cost_file_cut_short_ends_the_program(text: str) -> None:
    found = stops_of(RunTexts("kitting_1", log(50, 40), text))

    assert ("kitting_1", "IndexError") in {(s.run, s.exception) for s in found.stops}
    assert [team for team, _ in found.leaderboard] == ["beta"]


@pytest.mark.parametrize("text", [None, cost("a lot")])
def test_an_unreadable_cost_leaves_the_team_out_which_then_has_no_sum(text: str | None) -> None:
    found = stops_of(RunTexts("kitting_1", log(50, 40), text))

    assert "alpha" not in found.trials["kitting"]
    assert [(s.team, s.exception) for s in found.stops] == [("alpha", "KeyError")]


def test_the_csv_is_laid_out_as_the_program_writes_it() -> None:
    found = evaluate(
        {"alpha": [run("kitting_1", log(50, 40))], "beta": [run("assembly_1", log(1, 1))]}, ORDERS
    )

    assert results_csv(found) == (
        "Leaderboard:\n\nalpha,24.0\nbeta,0.0\n\n\n\nScore Breakdown:\n\nkitting:\n"
        "Team,Order 0(AAAA0001) Score,Order 0(AAAA0001) Duration,"
        "Order 1(BBBB0002) Score,Order 1(BBBB0002) Duration,trial_score\n"
        "alpha,9,50.0,5,40.0,24.0\nbeta,N/A,N/A,N/A,N/A,0.0\n\n\n"
    )
