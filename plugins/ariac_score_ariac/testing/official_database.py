"""A competition of 2025 made to order: the official database of several teams and runs."""

from __future__ import annotations

import random
import sqlite3
from pathlib import Path

__all__ = ["TABLES_2025", "write_database_competition"]

RUNS = 5
_STYLE = {"aurora": (0.10, 70.0), "borealis": (0.22, 52.0), "cygnus": (0.32, 60.0)}
"""For each team how often something goes wrong, and how long an order takes, s."""

TABLES_2025 = """
CREATE TABLE Competitor (id INTEGER PRIMARY KEY, name TEXT);
CREATE TABLE Trial (id INTEGER PRIMARY KEY, trial_id TEXT, config_hash TEXT, seed INTEGER, time_limit REAL,
    num_kits INTEGER, num_modules INTEGER, num_high_priority INTEGER);
CREATE TABLE Run (id INTEGER PRIMARY KEY, trial_id INTEGER, competitor_id INTEGER, completed BOOLEAN,
    aborted BOOLEAN, sensor_cost REAL, duration REAL, total_cells INTEGER, defective_cells INTEGER,
    avg_report_time REAL, num_reports_submitted INTEGER, num_correct_reports INTEGER,
    num_correct_report_classifications INTEGER);
CREATE TABLE Penalty (id INTEGER PRIMARY KEY, run_id INTEGER, type INTEGER, description TEXT, time REAL);
CREATE TABLE OrderSubmission (id INTEGER PRIMARY KEY, run_id INTEGER, submission_time REAL,
    announcement_time REAL, time_limit REAL, order_type INTEGER);
"""
"""The tables of the official schema without its view; notes on log formats, section 10."""

TEAMS_2025 = {"aurora": 7400.0, "borealis": 9900.0, "cygnus": 5200.0}
"""The sensor cost of each team, dollars."""
TRIALS_2025 = {"KITSONLY": (4, 0, 1), "MODULES1": (0, 3, 0), "MIXEDALL": (2, 2, 2)}
"""Kits, modules and high-priority orders of each trial."""
_KIT, _MODULE, _HIGH_PRIORITY = 1, 2, 3
_TIME_LIMIT_S = 900.0
_PENALTIES = (
    "good cell in inspection bin",
    "cell in conveyor bin",
    "object on an invalid surface",
    "AGV collision",
    "robot collision",
)


def write_database_competition(path: Path, *, seed: int = 2025) -> None:
    """Write a database of 2025: three teams, three trials, five runs each, some of them aborted.

    Args:
        path: Of the database; replaced when there is one.
        seed: For what happens in the runs.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    path.unlink(missing_ok=True)  # SQLite would add to what is there
    chance = random.Random(seed)  # noqa: S311  # an example, not a secret
    database = sqlite3.connect(path)
    try:
        database.executescript(TABLES_2025)
        teams = list(enumerate(TEAMS_2025, start=1))
        database.executemany("INSERT INTO Competitor VALUES (?, ?)", teams)
        for number, (trial, counts) in enumerate(TRIALS_2025.items(), start=1):
            row = (number, trial, f"{number:032x}", 40 + number, _TIME_LIMIT_S, *counts)
            database.execute("INSERT INTO Trial VALUES (?, ?, ?, ?, ?, ?, ?, ?)", row)
        for _ in range(RUNS):
            for place in range(1, len(TRIALS_2025) + 1):
                for team, name in teams:
                    _add_run(database, place, team, name, chance)
        database.commit()
    finally:
        database.close()


def _ms(seconds: float) -> float:
    """A time as a simulator stamps it, in whole milliseconds."""
    return int(seconds * 1000) / 1000


def _add_run(database: sqlite3.Connection, trial: int, team: int, name: str, chance: random.Random) -> None:
    flaw_rate, usual_s = _STYLE[name]
    kits, modules, high_priority = list(TRIALS_2025.values())[trial - 1]
    orders = [(_KIT, 0.0)] * kits + [(_MODULE, 0.0)] * modules
    orders += [(_HIGH_PRIORITY, _ms(100 + 200 * i + 50 * chance.random())) for i in range(high_priority)]
    aborted = chance.random() < flaw_rate / 2
    # An aborted run ended before all orders were in.
    handed_in = orders[: len(orders) // 2] if aborted else orders
    cells, defective = 40, 2 + int(6 * chance.random())
    now_s = 30.0
    times = []
    for kind, announced_s in handed_in:
        now_s = _ms(max(now_s, announced_s) + usual_s * (0.7 + 0.6 * chance.random()))
        times.append((now_s, announced_s, kind))
    found = int(defective * (1 - flaw_rate * chance.random()))
    values = (trial, team, not aborted, aborted, TEAMS_2025[name], _ms(now_s + 5), cells, defective)
    report_s = _ms(1.5 + 4 * chance.random())
    database.execute(
        "INSERT INTO Run (trial_id, competitor_id, completed, aborted, sensor_cost, duration, total_cells,"
        " defective_cells, avg_report_time, num_reports_submitted, num_correct_reports,"
        " num_correct_report_classifications) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        (*values, report_s, cells, cells - defective + found, found),
    )
    (run,) = database.execute("SELECT max(id) FROM Run").fetchone()
    for now_s, announced_s, kind in times:
        database.execute(
            "INSERT INTO OrderSubmission (run_id, submission_time, announcement_time, time_limit, order_type)"
            " VALUES (?, ?, ?, ?, ?)",
            (run, now_s, announced_s, _TIME_LIMIT_S, kind),
        )
    for kind, words in enumerate(_PENALTIES):
        for _ in range(int(chance.random() + flaw_rate)):
            at_s = _ms(10 + now_s * chance.random())
            database.execute(
                "INSERT INTO Penalty (run_id, type, description, time) VALUES (?, ?, ?, ?)",
                (run, kind, words, at_s),
            )
