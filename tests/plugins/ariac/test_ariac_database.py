"""The reader of the 2025 database; columns: notes on log formats, section 10."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

from ariac_score.checks.contracts import Reader, Wanted
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import Trial
from ariac_score_ariac.official.ariac_database import AriacDatabaseReader, read_run, run_ids
from ariac_score_ariac.work import sensor_cost

READER = AriacDatabaseReader()
WANTED = Wanted(LogMap("test"))

SCHEMA = """
CREATE TABLE Competitor (id INTEGER PRIMARY KEY, name TEXT);
CREATE TABLE Trial (id INTEGER PRIMARY KEY, trial_id TEXT, config_hash TEXT, seed INTEGER, time_limit REAL,
    num_kits INTEGER, num_modules INTEGER, num_high_priority INTEGER);
CREATE TABLE Run (id INTEGER PRIMARY KEY, trial_id INTEGER, competitor_id INTEGER,
    completed BOOLEAN DEFAULT 0, aborted BOOLEAN DEFAULT 0,
    sensor_cost REAL DEFAULT 0, duration REAL DEFAULT 0,
    total_cells INTEGER DEFAULT 0, defective_cells INTEGER DEFAULT 0, avg_report_time REAL DEFAULT 0,
    num_reports_submitted INTEGER DEFAULT 0, num_correct_reports INTEGER DEFAULT 0,
    num_correct_report_classifications INTEGER DEFAULT 0);
CREATE TABLE Penalty (id INTEGER PRIMARY KEY, run_id INTEGER, type INTEGER, description TEXT, time REAL);
CREATE TABLE OrderSubmission (id INTEGER PRIMARY KEY, run_id INTEGER, submission_time REAL,
    announcement_time REAL, time_limit REAL, order_type INTEGER);
CREATE VIEW competition_results AS SELECT * FROM Run JOIN Trial ON Run.trial_id = Trial.id;
"""
ROWS = [
    "INSERT INTO Competitor VALUES (3, 'team_a')",
    "INSERT INTO Trial VALUES (1, 'LHAF9835', 'abc', 1, 600, 2, 1, 1)",
    "INSERT INTO Run VALUES (7, 1, 3, 1, 0, 4200, 512.25, 20, 3, 2.5, 18, 17, 2)",
    "INSERT INTO Penalty VALUES (1, 7, 3, 'agv1 hit agv2', 40.5), (2, 7, 0, 'good cell', 12.25)",
    "INSERT INTO OrderSubmission VALUES (1, 7, 100, 0, 600, 1), (2, 7, 300.5, 200, 150, 3)",
    "INSERT INTO OrderSubmission VALUES (3, 7, 400, 0, 600, 1)",
]


def database(folder: Path, *more: str, rows: Iterable[str] = ROWS, schema: str = SCHEMA) -> Path:
    path = folder / "results.db"
    path.unlink(missing_ok=True)
    connection = sqlite3.connect(path)
    connection.executescript(schema)
    for statement in (*rows, *more):
        connection.execute(statement)
    connection.commit()
    connection.close()
    return path


def read(folder: Path, *more: str, **changes: Any) -> Trial:
    return READER.read(database(folder, *more, **changes), WANTED)


def refusal(folder: Path, *more: str, **changes: Any) -> LogError:
    path = database(folder, *more, **changes)
    with pytest.raises(LogError) as caught:
        READER.read(path, WANTED)
    assert str(path) in str(caught.value)
    assert caught.value.hint
    return caught.value


def test_is_a_reader() -> None:
    assert isinstance(READER, Reader)


def test_a_run_is_a_trial_with_its_submissions_and_penalties(tmp_path: Path) -> None:
    trial = read(tmp_path)

    assert (trial.id, trial.started_s, trial.ended_s) == ("LHAF9835", 0.0, 512.25)
    assert [(s.item_id, s.submitted_s, s.contents) for s in trial.submissions] == [
        ("kit_1", 100.0, None),
        ("high_priority_1", 300.5, None),
        ("kit_2", 400.0, None),
    ]
    assert {e.subject: e.t_s for e in trial.events_of("order_announced")} == {
        "kit_1": 0.0,
        "high_priority_1": 200.0,
        "kit_2": 0.0,
    }
    assert [(e.t_s, e.detail) for e in trial.events_of("agv_collision")] == [(40.5, "agv1 hit agv2")]
    assert [e.t_s for e in trial.events_of("cell_in_inspection_bin")] == [12.25]


def test_all_kinds_of_penalties_and_submissions_would_have_been_shown(tmp_path: Path) -> None:
    assert read(tmp_path).witnessed == {
        "submissions",
        "cell_in_inspection_bin",
        "cell_in_conveyor_bin",
        "object_on_invalid_surface",
        "agv_collision",
        "robot_collision",
    }


def test_the_score_is_not_stored_and_the_numbers_for_it_are_kept(tmp_path: Path) -> None:
    trial = read(tmp_path)

    assert trial.official is not None
    assert (trial.official.total, trial.official.process_time_s, trial.official.outcome) == (None, 512.25, "")
    assert trial.official.items["num_correct_report_classifications"] == "2.0"
    assert trial.team is not None
    assert (trial.team.name, sensor_cost(trial)) == ("team_a", 4200.0)


def test_the_numbers_of_the_run_are_facts_of_the_trial(tmp_path: Path) -> None:
    assert dict(read(tmp_path).facts) == {
        "duration_s": 512.25,
        "time_limit_s": 600.0,
        "num_kits": 2.0,
        "num_modules": 1.0,
        "num_high_priority": 1.0,
        "total_cells": 20.0,
        "defective_cells": 3.0,
        "avg_report_time_s": 2.5,
        "num_reports_submitted": 18.0,
        "num_correct_reports": 17.0,
        "num_correct_report_classifications": 2.0,
        "completed": 1.0,
        "aborted": 0.0,
    }


def test_an_aborted_run_is_called_so(tmp_path: Path) -> None:
    trial = read(tmp_path, "UPDATE Run SET aborted = 1, completed = 0")

    assert (trial.facts["aborted"], trial.facts["completed"]) == (1.0, 0.0)

    assert trial.official is not None
    assert trial.official.outcome == "aborted"


def test_two_penalties_of_one_kind_at_one_time_are_two(tmp_path: Path) -> None:
    trial = read(tmp_path, "INSERT INTO Penalty VALUES (3, 7, 3, 'agv1 hit agv2', 40.5)")

    assert len(trial.events_of("agv_collision")) == 2


# Several runs --------------------------------------------------------------------------

SECOND = (
    "INSERT INTO Run VALUES (9, 1, 3, 1, 0, 4200, 480, 20, 3, 2.5, 18, 17, 2)",
    "INSERT INTO Penalty VALUES (5, 9, 7, 'new', 1)",
)


def test_several_runs_are_not_one_trial_but_can_be_read_one_by_one(tmp_path: Path) -> None:
    error = refusal(tmp_path, *SECOND)
    path = tmp_path / "results.db"

    assert error.cause == "the database holds 2 runs, and one trial is one run"
    assert run_ids(path) == (7, 9)
    assert len(read_run(path, 7).submissions) == 3
    with pytest.raises(LogError, match="unknown penalty type"):
        read_run(path, 9)
    with pytest.raises(NothingToScoreError, match="run 8 is not in the database"):
        read_run(path, 8)


def test_a_database_without_a_run_is_nothing_to_score(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="holds no run"):
        READER.read(database(tmp_path, rows=()), WANTED)


# Wrong values --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (
            "UPDATE Penalty SET type = 5 WHERE id = 1",
            "type 5 is an unknown penalty type; known are 0 (cell_in",
        ),
        ("UPDATE Penalty SET type = 'x' WHERE id = 1", "type 'x' is not a whole number"),
        ("UPDATE Penalty SET type = NULL WHERE id = 1", "type None is not a whole number"),
        ("UPDATE Penalty SET time = -1 WHERE id = 1", "time -1.0 is a negative time"),
        ("UPDATE OrderSubmission SET order_type = 4 WHERE id = 1", "order_type 4 is an unknown order type"),
        (
            "UPDATE OrderSubmission SET submission_time = -2 WHERE id = 1",
            "submission_time -2.0 is a negative",
        ),
        (
            "UPDATE OrderSubmission SET submission_time = 1 WHERE id = 2",
            "is before the announcement at 200 s",
        ),
        ("UPDATE Run SET duration = -1", "duration -1.0 is a negative time"),
        ("UPDATE Run SET duration = 9e999", "duration inf is not a finite number"),
        ("UPDATE Run SET sensor_cost = 'free'", "sensor_cost 'free' is not a finite number"),
        ("UPDATE Run SET competitor_id = 4", "run 7 names Competitor 4, of which there are 0"),
        ("UPDATE Run SET trial_id = 9223372036854775807", "of which there are 0"),
        ("UPDATE Competitor SET name = x'00'", "name b'\\x00' is not text"),
    ],
)
def test_a_wrong_value_is_refused_by_its_column(tmp_path: Path, change: str, cause: str) -> None:
    assert cause in refusal(tmp_path, change).cause


def test_a_wrong_value_is_shown_with_its_row(tmp_path: Path) -> None:
    assert refusal(tmp_path, "UPDATE Penalty SET type = 5 WHERE id = 2").place == "table Penalty, id 2"


def test_an_unknown_order_type_of_the_simulator_is_known(tmp_path: Path) -> None:
    trial = read(tmp_path, "UPDATE OrderSubmission SET order_type = -1 WHERE id = 1")

    assert trial.submissions[0].item_id == "unknown_1"


# Hostile and damaged files -------------------------------------------------------------

ENDLESS = "WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) SELECT id"


@pytest.mark.parametrize(
    ("statements", "cause"),
    [
        (("DROP TABLE Penalty",), "there is no table 'Penalty'"),
        (
            ("DROP TABLE Competitor", f"CREATE VIEW Competitor AS {ENDLESS}, 'Competitor' AS name FROM n"),
            "'Competitor' is not a plain table",
        ),
        (("ALTER TABLE Penalty RENAME COLUMN time TO at",), "table 'Penalty' has no column 'time'"),
        (
            (
                "DROP TABLE Competitor",
                "CREATE TABLE Competitor (id INTEGER, name TEXT GENERATED ALWAYS AS (hex(zeroblob(9))))",
            ),
            "column 'name' of table 'Competitor' is computed",
        ),
    ],
)
def test_a_schema_that_computes_is_refused(tmp_path: Path, statements: tuple[str, ...], cause: str) -> None:
    assert cause in refusal(tmp_path, *statements).cause


def test_an_index_that_would_run_a_function_is_not_used(tmp_path: Path) -> None:
    path = database(tmp_path, "CREATE INDEX i ON Run (abs(id))")

    assert run_ids(path) == (7,)


def test_reading_changes_nothing_and_leaves_nothing_behind(tmp_path: Path) -> None:
    path = database(tmp_path)
    before = path.read_bytes()
    path.chmod(0o400)
    READER.read(path, WANTED)
    READER.describe(path)

    assert path.read_bytes() == before
    assert [found.name for found in tmp_path.iterdir()] == ["results.db"]


@pytest.mark.parametrize("ending", ["-wal", "-journal"])
def test_changes_that_wait_beside_the_database_are_refused(tmp_path: Path, ending: str) -> None:
    path = database(tmp_path)
    (tmp_path / f"results.db{ending}").write_bytes(b"more rows")
    with pytest.raises(LogError, match="holds changes that are not in the database yet"):
        READER.read(path, WANTED)


@pytest.mark.parametrize("kept", [0.2, 0.5, 0.9])
def test_a_database_that_is_cut_off_is_refused_and_stays_ours(tmp_path: Path, kept: float) -> None:
    path = database(tmp_path)
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * kept)])

    assert READER.can_read(path)
    assert READER.describe(path).damage
    with pytest.raises(LogError, match="cut off"):
        READER.read(path, WANTED)


def test_an_overwritten_page_is_refused(tmp_path: Path) -> None:
    path = database(tmp_path)
    raw = bytearray(path.read_bytes())
    raw[4096:] = b"\xff" * (len(raw) - 4096)
    path.write_bytes(bytes(raw))
    with pytest.raises(LogError, match=r"cannot be read|is damaged"):
        READER.read(path, WANTED)


# Recognising ---------------------------------------------------------------------------


def test_it_is_known_by_its_tables(tmp_path: Path) -> None:
    path = database(tmp_path)
    other = tmp_path / "other.db"
    connection = sqlite3.connect(other)
    connection.execute("CREATE TABLE topics (id INTEGER, name TEXT)")
    connection.commit()
    connection.close()
    text = tmp_path / "text.db"
    text.write_text("OrderSubmission Competitor")

    assert READER.can_read(path)
    assert not any(READER.can_read(p) for p in (other, text, tmp_path, tmp_path / "missing.db"))


def test_an_empty_or_missing_file_is_nothing_to_score(tmp_path: Path) -> None:
    (tmp_path / "empty.db").touch()
    for name, cause in (("empty.db", "is empty"), ("missing.db", "no such file")):
        with pytest.raises(NothingToScoreError, match=cause):
            READER.read(tmp_path / name, WANTED)


def test_it_describes_itself(tmp_path: Path) -> None:
    described = READER.describe(database(tmp_path))

    assert dict(described.facts) == {
        "runs": 1,
        "trial": "LHAF9835",
        "team": "team_a",
        "penalties": 2,
        "submissions": 3,
        "sensor_cost": 4200.0,
    }
    assert (described.duration_s, described.damage) == (512.25, "")


def test_it_tells_several_runs_apart(tmp_path: Path) -> None:
    aborted = "INSERT INTO Run (id, trial_id, competitor_id, aborted) VALUES (10, 1, 3, 1)"
    path = database(tmp_path, *SECOND, aborted)

    facts = dict(READER.describe(path).facts)
    assert facts.pop("run 9").startswith("cannot be read: type 7 is an unknown penalty type")  # type: ignore[union-attr]
    assert facts == {
        "runs": 3,
        "run 7": "team_a, trial LHAF9835, completed after 512.25 s, 3 submissions, 2 penalties",
        "run 10": "team_a, trial LHAF9835, aborted after 0 s, 0 submissions, 0 penalties",
    }


def test_the_wanted_run_is_read(tmp_path: Path) -> None:
    later = "INSERT INTO Run (id, trial_id, competitor_id, completed, duration) VALUES (10, 1, 3, 1, 99)"
    path = database(tmp_path, *SECOND, later)

    assert READER.read(path, Wanted(LogMap("test"), run=10)).ended_s == 99
    assert READER.read(path, Wanted(LogMap("test"), run=7)).ended_s == 512.25
    with pytest.raises(LogError, match="unknown penalty type"):
        READER.read(path, Wanted(LogMap("test"), run=9))
    with pytest.raises(NothingToScoreError, match="run 8 is not in the database"):
        READER.read(path, Wanted(LogMap("test"), run=8))


def test_a_run_that_is_not_there_is_not_the_only_one(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="run 8 is not in the database"):
        READER.read(database(tmp_path), Wanted(LogMap("test"), run=8))


def test_orders_of_the_trial_that_were_not_handed_in_are_named(tmp_path: Path) -> None:
    official = read(tmp_path, "UPDATE Trial SET num_kits = 3, num_high_priority = 0").official

    assert official is not None
    assert {order.id: order.submitted for order in official.summaries} == {
        "kit_1": True,
        "high_priority_1": True,
        "kit_2": True,
        "kit_3": False,
        "module_1": False,
    }


@pytest.mark.parametrize("number", ["-1", "1.5", "1001", "1e300"])
def test_a_number_of_orders_that_is_none_is_refused(tmp_path: Path, number: str) -> None:
    error = refusal(tmp_path, f"UPDATE Trial SET num_modules = {number}")  # noqa: S608  # numbers of this test

    assert "is no number of orders" in error.cause
