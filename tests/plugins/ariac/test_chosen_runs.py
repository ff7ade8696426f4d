"""One run out of several, and runs of which only their end is known, from the command line."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from ariac_score.cli import main

TABLES = """
CREATE TABLE Competitor (id INTEGER PRIMARY KEY, name TEXT);
CREATE TABLE Trial (id INTEGER PRIMARY KEY, trial_id TEXT, time_limit REAL, num_kits INTEGER,
    num_modules INTEGER, num_high_priority INTEGER);
CREATE TABLE Run (id INTEGER PRIMARY KEY, trial_id INTEGER, competitor_id INTEGER, completed, aborted,
    sensor_cost REAL, duration REAL, total_cells INTEGER, defective_cells INTEGER, avg_report_time REAL,
    num_reports_submitted INTEGER, num_correct_reports INTEGER, num_correct_report_classifications INTEGER);
CREATE TABLE Penalty (id INTEGER PRIMARY KEY, run_id INTEGER, type INTEGER, description TEXT, time REAL);
CREATE TABLE OrderSubmission (id INTEGER PRIMARY KEY, run_id INTEGER, submission_time REAL,
    announcement_time REAL, order_type INTEGER);
INSERT INTO Competitor VALUES (1, 'team_a');
INSERT INTO Trial VALUES (1, 'T', 1000, 2, 0, 0);
INSERT INTO Run VALUES (3, 1, 1, 0, 1, 0, 500, 20, 0, 0, 0, 0, 0), (4, 1, 1, 0, 1, 0, 500, 20, 0, 0, 0, 0, 0);
INSERT INTO OrderSubmission VALUES (1, 3, 10, 0, 1);
"""


@pytest.fixture
def database(tmp_path: Path) -> Path:
    path = tmp_path / "results.db"
    connection = sqlite3.connect(path)
    connection.executescript(TABLES)
    connection.close()
    return path


def score(capsys: pytest.CaptureFixture[str], path: Path, rules: str) -> tuple[int, str, str]:
    code = main(["score", str(path), "--rules", rules])
    printed = capsys.readouterr()
    return code, printed.out, printed.err


@pytest.mark.parametrize(("run", "points"), [(3, "2500 of"), (4, "0 of")])
def test_a_run_is_chosen_by_its_path(
    database: Path, capsys: pytest.CaptureFixture[str], run: int, points: str
) -> None:
    code, out, _ = score(capsys, Path(f"{database}#run={run}"), "ariac2025.as_coded")

    assert code == 0
    assert out.startswith(points)
    assert f"results.db#run={run}" in out


def test_a_run_is_chosen_by_bundle_yaml(database: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bundle = database.with_name("bundle.yaml")
    bundle.write_text("logs: []\nofficial: results.db\nrun: 3\n", encoding="utf-8")

    assert score(capsys, database.parent, "ariac2025.as_coded")[1].startswith("2500 of")


def test_no_run_is_guessed(database: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, err = score(capsys, database, "ariac2025.as_coded")

    assert code == 6
    assert "holds 2 runs" in err
    assert "results.db#run=3" in err


def test_a_run_that_is_not_there_is_nothing_to_score(
    database: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = score(capsys, Path(f"{database}#run=9"), "ariac2025.as_coded")

    assert (code, "run 9 is not in the database" in err) == (5, True)


def test_a_crash_is_named_where_nothing_says_what_was_ordered(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "trial_log.txt").write_text("Gazebo Crashed score not recorded\n", encoding="utf-8")
    code, out, err = score(capsys, tmp_path, "ariac2024.official")

    assert (code, out) == (5, "")
    assert "the simulator died during this run, and no score was recorded" in err
