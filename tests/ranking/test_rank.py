"""Ranking whole competitions, from the command line and as a library."""

from __future__ import annotations

import csv
import io
import json
import shutil
import sqlite3
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from ariac_score import Result, load_log_map, load_rule_set
from ariac_score.cli import main
from ariac_score.documents.schema import schema_errors
from ariac_score.ranking.competition import load_competition
from ariac_score.ranking.evaluation import strict_evaluation
from ariac_score.ranking.outcomes import Cell, Ranking, TeamRank
from ariac_score.ranking.rank import rank_results, remarks_on_team
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import ranking_spec
from ariac_score.report.ranking import ranking_text
from ariac_score.results.cohort_file import COHORT, Cohort
from ariac_score.trial.window import Lasted
from ariac_score_ariac.testing.official_database import write_database_competition
from ariac_score_ariac.testing.official_texts import (
    Outcome,
    PlannedOrder,
    sensor_cost_text,
    trial_log_text,
    write_text_competition,
)

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples" / "competition"
KIT = (PlannedOrder("AAAA0001", "kitting", False, (("pump", "red"),)),)
BOTH = (*KIT, PlannedOrder("BBBB0002", "assembly", True, (("battery", "blue"), ("sensor", "green"))))
TRIAL = """\
orders:
  - {id: AAAA0001, type: kitting, announcement: {time_condition: 0}, priority: false, kitting_task: {
      agv_number: 1, tray_id: 3, destination: warehouse, products: [{type: pump, color: red, quadrant: 1}]}}
"""
HEAD = "id: test\nrules: ariac2024.official\nruns: logs/{team}/{trial}_{run}\n"
SENSORS = {"basic_logical_camera": 2}  # 1000 dollars


def run(
    root: Path,
    team: str,
    number: int | str,
    duration_s: float | None = 50.0,
    *,
    flaw: str = "",
    sensors: Mapping[str, int] = SENSORS,
    text: str | None = None,
    trial: str = "kit",
) -> Path:
    """One run of a trial with one kit of one part: 5 points, 4 with a wrong colour, 1 with a wrong type."""
    folder = root / "logs" / team / f"{trial}_{number}"
    folder.mkdir(parents=True)
    plain = trial_log_text(trial, KIT, [Outcome((flaw,), duration_s)])
    # A flaw also takes the bonus of 1: 4 becomes 3, 1 stays 1.
    (folder / "trial_log.txt").write_text(plain if text is None else text, encoding="utf-8")
    (folder / "sensor_cost.txt").write_text(sensor_cost_text(sensors), encoding="utf-8")
    return folder


def ranking(root: Path, extra: str = "") -> Ranking:
    (root / "competition.yaml").write_text(HEAD + extra, encoding="utf-8")
    competition = load_competition(root)
    rules = load_rule_set(competition.rules)
    spec = ranking_spec(rules, competition.ranking, file="competition.yaml")
    return rank_results(competition, spec, rules, score_runs(competition, rules))


def table(found: Ranking) -> list[tuple[int | None, str, float]]:
    return [(s.rank, s.team, float(s.execution)) for s in found.standings]


def outcomes(found: Ranking) -> dict[tuple[str, int], str]:
    return {(r.team, r.number): r.outcome for r in found.runs if r.outcome != "scored"}


# Scores and ranks ----------------------------------------------------------------------


def test_teams_are_priced_against_each_other(tmp_path: Path) -> None:
    # Mean cost (1000 + 3000) / 2 = 2000, mean time (50 + 100) / 2 = 75.
    # alpha 75/50 * 5 * 2000/1000 = 15; beta 75/100 * 5 * 2000/3000 = 2.5
    run(tmp_path, "alpha", 1)
    run(tmp_path, "beta", 1, 100.0, sensors={"basic_logical_camera": 6})

    assert table(ranking(tmp_path)) == [(1, "alpha", 15.0), (2, "beta", 2.5)]


def test_counts_of_one_are_in_the_singular_and_a_cohort_without_values_is_named(tmp_path: Path) -> None:
    run(tmp_path, "alpha", 1)
    found = ranking(tmp_path)
    lines = ranking_text(found).splitlines()

    assert lines[1] == "1 team, 1 trial, 1 run, 1 of them count"
    assert "  kit: mean sensor_cost 1000 (1 team)" in lines

    assert found.cohort is not None
    lines = ranking_text(replace(found, cohort=Cohort.of(found.cohort.rule_set, {"kit": {}}))).splitlines()

    assert lines[lines.index("Across teams") + 1] == "  nothing: no run counts"


def test_the_best_run_counts_by_score_and_then_by_time(tmp_path: Path) -> None:
    run(tmp_path, "alpha", 1, 20.0, flaw="color")
    run(tmp_path, "alpha", 2, 60.0)
    run(tmp_path, "alpha", 3, 40.0)
    run(tmp_path, "alpha", 4, 40.0)

    assert [r.number for r in ranking(tmp_path).runs if r.kept] == [3]


def test_of_several_runs_the_mean_of_the_best_counts_and_one_not_made_is_zero(tmp_path: Path) -> None:
    # alpha: 5 and 3 of three runs; beta made one. All at the mean time and cost.
    for number, flaw in enumerate(("type", "", "color"), start=1):
        run(tmp_path, "alpha", number, flaw=flaw)
    run(tmp_path, "beta", 1)

    assert table(ranking(tmp_path, "ranking: {keep: 2}\n")) == [(1, "alpha", 4.0), (2, "beta", 2.5)]
    left_out = ranking(tmp_path, "ranking: {keep: 2, missing_run: leave_out}\n")
    assert table(left_out) == [(1, "beta", 5.0), (2, "alpha", 4.0)]


def test_teams_that_nothing_separates_share_a_rank_and_the_next_counts_them(tmp_path: Path) -> None:
    for team in ("alpha", "beta"):
        run(tmp_path, team, 1)
    run(tmp_path, "gamma", 1, flaw="type")

    assert [(rank, team) for rank, team, _ in table(ranking(tmp_path))] == [
        (1, "alpha"),
        (1, "beta"),
        (3, "gamma"),
    ]


def test_a_declared_tie_break_separates_them(tmp_path: Path) -> None:
    # Dearer but faster: 75/50 * 1500/1500... chosen so that both come to the same score.
    run(tmp_path, "slow", 1, 100.0, sensors={"basic_logical_camera": 2})
    run(tmp_path, "fast", 1, 50.0, sensors={"basic_logical_camera": 4})
    ties = "ranking: {ties: [{lowest: completion_time_s}]}\n"

    assert [rank for rank, _, _ in table(ranking(tmp_path))] == [1, 1]
    assert [(rank, team) for rank, team, _ in table(ranking(tmp_path, ties))] == [(1, "fast"), (2, "slow")]


@pytest.mark.parametrize(
    ("lasted", "expected", "said"),
    [
        (None, [(1, "alpha"), (1, "beta")], {}),
        (Lasted(0.5, 99.5, "its start within 99 s"), [(1, "beta"), (2, "alpha")], {}),
        (
            Lasted(40.0, None, "the log does not show the end of the competition"),
            [(1, "beta"), (2, "alpha")],  # it counts nothing
            {("alpha", 1): "no_value"},
        ),
    ],
    ids=["exact", "at a rate", "no end"],
)
def test_a_tie_break_by_time_takes_the_longest_time_that_a_log_allows(
    tmp_path: Path, lasted: Lasted | None, expected: list[Any], said: dict[Any, str]
) -> None:
    for team in ("alpha", "beta"):
        run(tmp_path, team, 1)
    (tmp_path / "timed.yaml").write_text(
        "extends: ariac2024.official\nid: timed\ntitle: Timed\nsource: here\n"
        "terms: {trial: {lasts_s: trial.duration_s}}\nranking: {ties: [{lowest: lasts_s}]}\n",
        encoding="utf-8",
    )
    head = HEAD.replace("ariac2024.official", "./timed.yaml")
    (tmp_path / "competition.yaml").write_text(head, encoding="utf-8")
    competition = load_competition(tmp_path)
    rules = load_rule_set(competition.rules)
    spec = ranking_spec(rules, competition.ranking, file="competition.yaml")
    results = dict(score_runs(competition, rules))
    (key,) = (key for key in results if key[0] == "alpha")
    of_alpha = results[key]
    assert isinstance(of_alpha, Result)
    results[key] = replace(of_alpha, measured=replace(of_alpha.measured, lasted=lasted))

    found = rank_results(competition, spec, rules, results)

    assert [(one.rank, one.team) for one in found.standings] == expected
    assert outcomes(found) == said


def test_judges_enter_the_value_and_a_team_without_marks_has_no_place(tmp_path: Path) -> None:
    for team in ("alpha", "beta", "gamma"):
        run(tmp_path, team, 1, flaw="" if team == "alpha" else "color")
    extra = (
        "teams: [{id: alpha, judges: [[1, 1, 1]]}, {id: beta, judges: [[5, 5, 5], [4, 4, 4]]}, {id: gamma}]\n"
        "ranking: {value: 0.4 * rank(execution) + 0.6 * rank(judges), best: lowest}\n"
    )
    found = ranking(tmp_path, extra)

    # alpha 0.4 * 1 + 0.6 * 2 = 1.6; beta 0.4 * 2 + 0.6 * 1 = 1.4
    assert [(s.rank, s.team, s.value) for s in found.standings] == [
        (1, "beta", pytest.approx(1.4)),
        (2, "alpha", pytest.approx(1.6)),
        (None, "gamma", None),
    ]
    assert float(found.standings[0].judges or 0) == 27


# What goes wrong for one team ----------------------------------------------------------


def test_nothing_that_goes_wrong_for_one_team_stops_another(tmp_path: Path) -> None:
    run(tmp_path, "whole", 1)
    cut = (run(tmp_path, "cut", 1) / "trial_log.txt").read_text()[:300]
    (tmp_path / "logs/cut/kit_1/trial_log.txt").write_text(cut)
    run(tmp_path, "crash", 1, text="Gazebo Crashed score not recorded\n")
    run(tmp_path, "cancel", 1, text="Process cancelled by user")
    run(tmp_path, "free", 1, sensors={})
    for number in ("1", "01"):
        run(tmp_path, "twice", number)
    (tmp_path / "logs/nobody").mkdir()
    (run(tmp_path, "costly", 1) / "sensor_cost.txt").unlink()
    found = ranking(tmp_path, "teams: [" + ", ".join(f"{{id: {t}}}" for t in TEAMS) + "]\n")

    assert outcomes(found) == {
        ("cut", 1): "unreadable",
        ("crash", 1): "crashed",
        ("cancel", 1): "cancelled",
        ("free", 1): "undecided",
        ("twice", 1): "refused",
        ("costly", 1): "undecided",
    }
    cells = {s.team: s.trials["kit"] for s in found.standings}
    assert cells["nobody"].outcome == "no_run"
    assert cells["twice"].reason == "2 runs have the number 1: kit_01, kit_1"
    assert {team: float(cell.score) for team, cell in cells.items() if cell.score} == {"whole": 5}
    assert all(cell.reason for team, cell in cells.items() if team != "whole")


TEAMS = ("whole", "cut", "crash", "cancel", "free", "twice", "nobody", "costly")


def test_a_trial_configuration_of_another_kind_costs_that_trial_by_name(tmp_path: Path) -> None:
    run(tmp_path, "alpha", 1)
    run(tmp_path, "alpha", 1, trial="other")
    (tmp_path / "other.yaml").write_text("static_sensors: {front: {type: lidar}}\n", encoding="utf-8")
    (tmp_path / "kit.yaml").write_text(TRIAL, encoding="utf-8")
    extra = "trials: [{id: kit, config: kit.yaml}, {id: other, config: other.yaml}]\n"

    (standing,) = ranking(tmp_path, extra).standings

    assert float(standing.trials["kit"].score) == 5
    assert standing.trials["other"].score != 0  # the text names its orders itself
    assert {s.outcome for s in standing.trials.values()} == {"scored"}


def test_a_malformed_configuration_makes_the_runs_of_that_trial_unreadable(tmp_path: Path) -> None:
    run(tmp_path, "alpha", 1)
    run(tmp_path, "alpha", 1, trial="other")
    (tmp_path / "other.yaml").write_text("orders: [{id: 1}]\n", encoding="utf-8")
    extra = "trials: [{id: kit}, {id: other, config: other.yaml}]\n"

    (standing,) = ranking(tmp_path, extra).standings

    assert (standing.trials["kit"].outcome, standing.trials["other"].outcome) == ("scored", "unreadable")
    assert "other.yaml" in standing.trials["other"].reason


@pytest.mark.slow
def test_an_unknown_penalty_type_costs_that_run_alone(tmp_path: Path) -> None:
    write_database_competition(tmp_path / "results.db")
    connection = sqlite3.connect(tmp_path / "results.db")
    connection.execute("INSERT INTO Penalty (run_id, type, description, time) VALUES (7, 9, 'what', 1.0)")
    team, trial, trial_id = connection.execute(
        "SELECT Competitor.name, Trial.trial_id, Trial.id FROM Run"
        " JOIN Competitor ON competitor_id = Competitor.id"
        " JOIN Trial ON Run.trial_id = Trial.id WHERE Run.id = 7"
    ).fetchone()
    (number,) = connection.execute(
        "SELECT count(*) FROM Run JOIN Competitor ON competitor_id = Competitor.id"
        " WHERE Run.id <= 7 AND name = ? AND trial_id = ?",
        (team, trial_id),
    ).fetchone()
    owner = team, trial, number
    connection.commit()
    connection.close()
    text = (EXAMPLES / "2025/competition.yaml").read_text(encoding="utf-8")
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")
    competition = load_competition(tmp_path)

    rules = load_rule_set(competition.rules)
    spec = ranking_spec(rules, competition.ranking, file="competition.yaml")
    found = rank_results(competition, spec, rules, score_runs(competition, rules))

    (bad,) = [run for run in found.runs if run.outcome == "unreadable"]
    assert (bad.team, bad.trial, bad.number) == owner
    assert "type 9 is an unknown penalty type" in bad.reason
    assert len(found.runs) == 45  # none is numbered anew
    assert competition.strangers == ()


# The organisers' program ---------------------------------------------------------------


@pytest.mark.slow
def test_robust_and_strict_agree_where_nothing_is_odd(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_text_competition(tmp_path)
    (tmp_path / "competition.yaml").write_text(HEAD + "trial_configs: trials/{trial}.yaml\n")

    assert main(["rank", str(tmp_path), "--output-format", "json"]) == 0
    data = json.loads(capsys.readouterr().out)

    assert data["strict"]["differences"] == []
    assert [s["exception"] for s in data["strict"]["stops"]] == ["ValueError", "ValueError"]
    theirs = dict(data["strict"]["leaderboard"])
    for standing in data["standings"]:
        assert standing["execution"] == pytest.approx(theirs[standing["team"]], abs=2e-6)


def test_what_the_organisers_program_gets_wrong_is_shown_with_its_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # The trial asks for an order that alpha's log does not name: there the value before is used again.
    run(tmp_path, "alpha", 1)
    run(
        tmp_path, "beta", 1, text=trial_log_text("kit", BOTH, [Outcome(("",), 50.0), Outcome(("", ""), 50.0)])
    )
    second = TRIAL.splitlines()[1:]
    both = TRIAL + "\n".join(second).replace("AAAA0001", "BBBB0002") + "\n"
    (tmp_path / "kit.yaml").write_text(both, encoding="utf-8")
    (tmp_path / "competition.yaml").write_text(HEAD + "trials: [{id: kit, config: kit.yaml}]\n")

    code = main(["rank", str(tmp_path)])
    out = capsys.readouterr().out

    assert code == 6
    assert "alpha, kit, run 1: undecided" in out
    assert "order 'BBBB0002' is not in the log, so the value of the order before is used again" in out


def test_the_organisers_program_reads_every_folder_whoever_takes_part(tmp_path: Path) -> None:
    # It takes any suffix, a second run of one number, and teams that are not listed.
    for team, number in (("alpha", 1), ("alpha", "01"), ("alpha", "final"), ("stranger", 1)):
        run(tmp_path, team, number)
    (tmp_path / "kit.yaml").write_text(TRIAL, encoding="utf-8")
    (tmp_path / "competition.yaml").write_text(
        HEAD + "teams: [{id: alpha}, {id: absent}]\ntrials: [{id: kit, config: kit.yaml}]\n"
    )
    competition = load_competition(tmp_path)
    log_map = load_log_map("ariac2024")

    found = strict_evaluation(competition, "nist_text_evaluation", log_map)

    assert set(found.trials["kit"]) == {"alpha", "stranger"}
    assert found.stops == ()


def test_a_team_folder_that_is_a_link_out_of_the_competition_is_named(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    run(inside, "alpha", 1)
    run(tmp_path / "outside", "beta", 1)
    (inside / "logs/beta").symlink_to(tmp_path / "outside/logs/beta")
    (inside / "logs/alpha/kit_2").symlink_to(tmp_path / "gone")

    found = ranking(inside, "teams: [{id: alpha}, {id: beta}]\n")

    assert len(found.strangers) == 2
    assert all("a link to" in stranger for stranger in found.strangers)
    assert any(stranger.startswith("logs/beta: ") for stranger in found.strangers)


def test_like_outcomes_share_a_line_and_each_says_what_to_do(tmp_path: Path) -> None:
    run(tmp_path, "whole", 1)
    for number in (1, 2, 3):
        cut = run(tmp_path, "cut", number, text="Process cancelled by user") / "trial_log.txt"
        if number == 3:
            cut.write_text("Trial file: kit.yaml\n", encoding="utf-8")
    lines = ranking_text(ranking(tmp_path)).splitlines()

    assert (
        "  cut, kit, runs 1, 2: cancelled: the run was cancelled by its user, and no score was recorded"
        in lines
    )
    (other,) = [line for line in lines if line.startswith("  cut, kit, run 3: unreadable: ")]
    assert other.startswith(
        "  cut, kit, run 3: unreadable: logs/cut/kit_3/trial_log.txt: this is no score text"
    )
    assert other.endswith("; expected are 'Trial Summary' (2024), 'END OF TRIAL' (2023) or a crash text")


def test_a_link_within_a_run_that_leads_out_of_it_is_not_followed(tmp_path: Path) -> None:
    run(tmp_path / "outside", "beta", 1)
    text = run(tmp_path, "alpha", 1) / "trial_log.txt"
    text.unlink()
    text.symlink_to(tmp_path / "outside/logs/beta/kit_1/trial_log.txt")
    run(tmp_path, "beta", 1)

    found = ranking(tmp_path)

    assert outcomes(found) == {("alpha", 1): "unreadable"}
    (reason,) = [r.reason for r in found.runs if r.team == "alpha"]
    assert "link" in reason


def test_a_team_with_fewer_judges_has_a_remark(tmp_path: Path) -> None:
    run(tmp_path, "alpha", 1)
    run(tmp_path, "beta", 1)
    teams = "teams: [{id: alpha, judges: [[1, 1], [2, 2]]}, {id: beta, judges: [[5, 5]]}]\n"
    found = ranking(tmp_path, teams + "ranking: {value: execution + judges, best: highest}\n")

    assert [s.remarks for s in found.standings] == [("marks of 1 judges, 2 in all; others have 2 and 4",), ()]


def test_remarks_on_a_team_are_not_those_on_its_trials_whatever_these_are_called() -> None:
    cells = {
        "no value heat": Cell(Decimal(0), "no_run", "no run was made", (), 0),
        "kit_1": Cell(Decimal(3), "scored", "", (1,), 1),
    }
    remarks = ("no value heat: no_run: no run was made", "disqualified: a second robot")
    team = TeamRank(None, "a", "A", None, Decimal(3), None, {}, cells, remarks)

    assert remarks_on_team(team) == ("disqualified: a second robot",)


def test_a_competition_without_any_run_is_nothing_to_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "logs/alpha").mkdir(parents=True)
    (tmp_path / "competition.yaml").write_text(HEAD + "teams: [{id: alpha}]\ntrials: [{id: kit}]\n")

    assert main(["rank", str(tmp_path)]) == 5
    assert "the competition has no run; no run was found" in capsys.readouterr().err
    run(tmp_path, "beta", 1)
    assert main(["rank", str(tmp_path)]) == 5
    assert "the competition has no run; passed over: logs/beta" in capsys.readouterr().err


def test_the_strict_policy_writes_the_organisers_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(tmp_path, "alpha", 1)
    (tmp_path / "kit.yaml").write_text(TRIAL, encoding="utf-8")
    (tmp_path / "competition.yaml").write_text(HEAD + "trials: [{id: kit, config: kit.yaml}]\n")

    assert main(["rank", str(tmp_path), "--policy", "strict", "--output-format", "csv"]) == 0
    assert capsys.readouterr().out.startswith("Leaderboard:\n\nalpha,5.0\n\n\n\nScore Breakdown:\n\nkit:\n")


def test_rules_without_an_official_program_have_no_strict_policy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(EXAMPLES / "2025", tmp_path / "c")

    assert main(["rank", str(tmp_path / "c"), "--policy", "strict"]) == 4
    assert "names no program of the organisers" in capsys.readouterr().err


# Publishing ----------------------------------------------------------------------------


def test_a_team_prices_its_own_trial_against_the_published_cohort(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(tmp_path, "alpha", 1)
    run(tmp_path, "beta", 1, 100.0, sensors={"basic_logical_camera": 6})
    (tmp_path / "competition.yaml").write_text(HEAD)
    cohort, own = tmp_path / "cohort.json", tmp_path / "logs/beta/kit_1"
    assert main(["rank", str(tmp_path), "--cohort-output", str(cohort), "-o", str(tmp_path / "out.txt")]) == 0
    score = ["score", str(own), "--rules", "ariac2024.official"]

    assert main(score) == 6
    out = capsys.readouterr().out
    assert out.startswith("needs_cohort")
    assert "task score 5, before other teams are looked at" in out
    assert main([*score, "--cohort", str(cohort)]) == 0
    assert capsys.readouterr().out.startswith("2.5\n")
    assert main([*score, "--cohort", str(cohort), "--cohort-trial", "kitt"]) == 4
    assert "did you mean 'kit'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (("2000.0", "2001.0"), "its content does not match its hash"),
        (('"schema"', '"shema"'), "it states no schema"),
        (('"teams": 2', '"teams": -2'), "expected 'int' >= 0"),
        (("{", "["), "not a cohort"),
    ],
)
def test_an_edited_cohort_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: tuple[str, str], cause: str
) -> None:
    run(tmp_path, "alpha", 1)
    run(tmp_path, "beta", 1, 100.0, sensors={"basic_logical_camera": 6})
    (tmp_path / "competition.yaml").write_text(HEAD)
    cohort = tmp_path / "cohort.json"
    main(["rank", str(tmp_path), "--cohort-output", str(cohort)])
    text = cohort.read_text()
    assert change[0] in text
    cohort.write_text(text.replace(*change))
    capsys.readouterr()

    code = main(
        ["score", str(tmp_path / "logs/beta/kit_1"), "--rules", "ariac2024.official", "--cohort", str(cohort)]
    )

    assert code == 4
    assert cause in capsys.readouterr().err


def test_a_cohort_of_other_rules_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(tmp_path, "alpha", 1)
    (tmp_path / "competition.yaml").write_text(HEAD)
    cohort = tmp_path / "cohort.json"
    main(["rank", str(tmp_path), "--cohort-output", str(cohort)])
    mine = tmp_path / "mine.yaml"
    mine.write_text("id: mine\ntitle: Mine\nsource: a test\nextends: ariac2024.official\nround: 3\n")
    capsys.readouterr()

    assert (
        main(["score", str(tmp_path / "logs/alpha/kit_1"), "--rules", str(mine), "--cohort", str(cohort)])
        == 4
    )
    assert "it was made under ariac2024.official" in capsys.readouterr().err


@pytest.mark.slow
def test_stored_results_are_ranked_without_their_logs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = tmp_path / "results"
    rank = ["rank", str(EXAMPLES / "2024"), "--output-format", "csv"]
    assert main([*rank, "--results", str(stored)]) == 0
    from_logs = capsys.readouterr().out
    text = HEAD.replace("logs/{team}/{trial}_{run}", "results/{team}/{trial}_{run}.json")
    (tmp_path / "competition.yaml").write_text(
        text + "teams: [{id: aurora, name: Team Aurora}, {id: borealis, name: Team Borealis},"
        " {id: cygnus, name: Team Cygnus}]\n"
    )

    assert main(["rank", str(tmp_path), "--output-format", "csv"]) == 0
    assert capsys.readouterr().out == from_logs


@pytest.mark.slow
def test_a_result_under_the_name_of_another_run_is_not_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = tmp_path / "results"
    main(["rank", str(EXAMPLES / "2024"), "--results", str(stored), "-o", str(tmp_path / "out.txt")])
    shutil.copy(stored / "borealis/kitting_1.json", stored / "cygnus/kitting_1.json")
    text = HEAD.replace("logs/{team}/{trial}_{run}", "results/{team}/{trial}_{run}.json")
    (tmp_path / "competition.yaml").write_text(text)
    capsys.readouterr()

    assert main(["rank", str(tmp_path)]) == 6
    assert "cygnus, kitting, run 1: unreadable" in capsys.readouterr().out


def test_a_change_of_rules_says_whose_score_and_rank_it_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Priority 30 times as much: alpha alone handed the priority order in, beta made the better kit.
    stored, mine = tmp_path / "results", tmp_path / "mine.yaml"
    text = trial_log_text("kit", BOTH, [Outcome(("type",), 50.0), Outcome(("none", "pose"), 50.0)])
    run(tmp_path, "alpha", 1, text=text.replace("Actual task score: 0", "Actual task score: 1"))
    run(
        tmp_path, "beta", 1, text=trial_log_text("kit", BOTH, [Outcome(("",), 50.0), Outcome(("", ""), None)])
    )
    (tmp_path / "competition.yaml").write_text(HEAD)
    main(["rank", str(tmp_path), "--results", str(stored)])
    mine.write_text(
        "id: mine\ntitle: Mine\nsource: a test\nextends: ariac2024.official\n"
        "terms: {order: {value: (30 if weight == 3 else 1) * completion if time_s else 0}}\n"
    )
    capsys.readouterr()

    assert main(["rules", "diff", "ariac2024.official", str(mine), "--results", str(stored)]) == 0
    out = capsys.readouterr().out.splitlines()

    # alpha 1 + 3 * 1 = 4 against beta's 5; then 1 + 30 = 31.
    assert "alpha, kit, run 1: 4 -> 31" in out
    assert "1 of 2 runs are worth the same" in out
    assert "alpha: 4 -> 31, rank 2 -> 1" in out
    assert "beta: 5 -> 5, rank 1 -> 2" in out


# The examples --------------------------------------------------------------------------


def rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


@pytest.mark.slow
@pytest.mark.parametrize("year", ["2024", "2025"])
def test_the_example_competitions_are_ranked_alike_every_time(
    year: str, capsys: pytest.CaptureFixture[str]
) -> None:
    texts = []
    for _ in range(2):
        assert main(["rank", str(EXAMPLES / year), "--output-format", "json"]) == 0
        texts.append(capsys.readouterr().out)

    data: dict[str, Any] = json.loads(texts[0])
    assert texts[0] == texts[1]
    assert schema_errors(data, "ranking") == []
    if data["cohort"] is not None:
        assert schema_errors({"schema": COHORT.tag, **data["cohort"]}, "cohort") == []
    assert len(data["runs"]) == 45
    assert [s["rank"] for s in data["standings"]] == [1, 2, 3]
    for standing in data["standings"]:
        # What is published adds up, to the last digit.
        cells = [cell["score"] for cell in standing["trials"].values()]
        assert round(sum(cells), 9) == standing["execution"]


@pytest.mark.slow
def test_the_csv_says_the_same_as_the_json(capsys: pytest.CaptureFixture[str]) -> None:
    main(["rank", str(EXAMPLES / "2025"), "--output-format", "csv"])
    table = rows(capsys.readouterr().out)
    main(["rank", str(EXAMPLES / "2025"), "--output-format", "json"])
    standings = json.loads(capsys.readouterr().out)["standings"]

    assert [row["team"] for row in table] == [s["team"] for s in standings]
    assert [float(row["execution"]) for row in table] == [s["execution"] for s in standings]
    assert [float(row["judges"]) for row in table] == [s["judges"] for s in standings]


def test_the_example_of_2024_is_what_its_generator_writes(tmp_path: Path) -> None:
    write_text_competition(tmp_path)

    written = {p.relative_to(tmp_path): p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    committed = {
        p.relative_to(EXAMPLES / "2024"): p.read_bytes()
        for p in (EXAMPLES / "2024").rglob("*")
        if p.is_file()
    }
    committed.pop(Path("competition.yaml"))
    assert written == committed


def test_the_example_of_2025_holds_the_rows_its_generator_writes(tmp_path: Path) -> None:
    write_database_competition(tmp_path / "results.db")
    dumps = []
    for path in (tmp_path / "results.db", EXAMPLES / "2025/results.db"):
        connection = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
        dumps.append(list(connection.iterdump()))
        connection.close()

    assert dumps[0] == dumps[1]
