"""Runs of 2025, priced: every number worked by hand from the rulebook (section 10)."""

from __future__ import annotations

import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Finding,
    LogError,
    Monitor,
    OfficialOrder,
    OfficialResult,
    Rule,
    Trial,
    Verdict,
    load_rule_set,
    measure_trial,
    score_trial,
)
from ariac_score.checks.contracts import Wanted
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.trial.build import merge_trials
from ariac_score.trial.channels import LogMap
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.official.ariac_database import AriacDatabaseReader
from ariac_score_ariac.tasks import RunOrder, RunRecord
from ariac_score_ariac.work import Order

SATISFIED, VIOLATED, INCONCLUSIVE = Verdict.SATISFIED, Verdict.VIOLATED, Verdict.INCONCLUSIVE
LATER, FIRST, DOCUMENTED = "ariac2025.as_coded", "ariac2025.first_weights", "ariac2025.as_documented"
REGISTRY = Registry()
KIT, MODULE, HIGH_PRIORITY, UNKNOWN = 1, 2, 3, -1
TABLES = """
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
"""


@dataclass(frozen=True)
class Run:
    """A run as it is stored; the default is one that the rulebook's formulas leave plain numbers of."""

    time_limit: float = 1000.0
    num_kits: int = 2
    num_modules: int = 1
    num_high_priority: int = 1
    completed: int = 1
    aborted: int = 0
    sensor_cost: float = 0.0
    duration: float = 500.0
    defective_cells: int = 4
    avg_report_time: float = 1.0
    classified: int = 1
    penalties: tuple[int, ...] = ()
    orders: tuple[tuple[int, float, float], ...] = (
        (KIT, 0.0, 100.0),
        (KIT, 0.0, 200.0),
        (MODULE, 0.0, 300.0),
        (HIGH_PRIORITY, 50.0, 125.0),
    )
    """Type, announcement and submission of each accepted order."""


def stored(folder: Path, *runs: Run) -> Path:
    path = folder / "results.db"
    connection = sqlite3.connect(path)
    connection.executescript(TABLES)
    connection.execute("INSERT INTO Competitor VALUES (1, 'team_a')")
    for k, run in enumerate(runs, start=1):
        counts = (run.num_kits, run.num_modules, run.num_high_priority)
        connection.execute(
            "INSERT INTO Trial VALUES (?,?,?,?,?,?,?,?)", (k, "T", "", 1, run.time_limit, *counts)
        )
        numbers = (run.completed, run.aborted, run.sensor_cost, run.duration, 20, run.defective_cells)
        reports = (run.avg_report_time, 9, 8, run.classified)
        connection.execute(f"INSERT INTO Run VALUES ({','.join('?' * 13)})", (k, k, 1, *numbers, *reports))  # noqa: S608
        connection.executemany(
            "INSERT INTO Penalty (run_id, type, description, time) VALUES (?, ?, '', 1)",
            [(k, kind) for kind in run.penalties],
        )
        connection.executemany(
            "INSERT INTO OrderSubmission (run_id, order_type, announcement_time, submission_time) "
            "VALUES (?, ?, ?, ?)",
            [(k, *order) for order in run.orders],
        )
    connection.commit()
    connection.close()
    return path


def score(folder: Path, run: Run, rules: str) -> float | None:
    result = score_trial(stored(folder, run), rules)
    return None if result.score is None else float(result.score)


# By hand. The plain run: all orders in, 500 of 1000 s, reports in 1 of 4 s, 1 of 4 defects
# classified, no sensors, the high-priority order in 75 s.
#   later weights: kits 5000, modules 12000, time 500, reports 375, high priority 600 (1 - 75/150) = 300,
#   sensors 1000, classification 125: 19300
#   first weights: 500 + 800 + 87.5 + 93.75 + 150 (1 - 75/130) + 500 + 25
PLAIN = Run()
HIGH_PRIORITY_FIRST = 150 * 55 / 130
ABORTED = replace(PLAIN, aborted=1, completed=0, orders=PLAIN.orders[:2])


@pytest.mark.parametrize(
    ("run", "later"),
    [
        (PLAIN, 19300),
        # 50 + 25 + 25 + 100 + 2 x 100
        (replace(PLAIN, penalties=(0, 1, 2, 3, 4, 4)), 19300 - 400),
        # at the budget and over it: no bonus; then 1000 (12000/9600 - 1) = 250 besides
        (replace(PLAIN, sensor_cost=9600), 18300),
        (replace(PLAIN, sensor_cost=12000), 18300 - 250),
        (replace(PLAIN, sensor_cost=4800), 18300 + 500),
        # nothing reported: a mean of 0 s; then the nominal time and beyond, where the bonus stops at 0
        (replace(PLAIN, avg_report_time=0), 19300 + 125),
        (replace(PLAIN, avg_report_time=4), 19300 - 375),
        (replace(PLAIN, avg_report_time=9), 19300 - 375),
        (replace(PLAIN, defective_cells=0, classified=0), 19300 - 125),
        # beyond the limit, which the code does not clamp: 1000 (1 - 1.25) = -250
        (replace(PLAIN, duration=1000), 19300 - 500),
        (replace(PLAIN, duration=1250), 19300 - 750),
        # high priority in 150 and 300 s; two in 75 and 45 s, mean 60 s
        (replace(PLAIN, orders=(*PLAIN.orders[:3], (HIGH_PRIORITY, 50, 200))), 19300 - 300),
        (replace(PLAIN, orders=(*PLAIN.orders[:3], (HIGH_PRIORITY, 50, 350))), 19300 - 300),
        (
            replace(PLAIN, num_high_priority=2, orders=(*PLAIN.orders, (HIGH_PRIORITY, 0, 45))),
            19300 - 300 + 600 * 0.6,
        ),
        # divisors of 0: no kits asked for (the module remains), no modules
        (replace(PLAIN, num_kits=0, num_high_priority=0, orders=((MODULE, 0, 9),)), 12000 + 2000),
        (replace(PLAIN, num_modules=0, orders=(PLAIN.orders[0], *PLAIN.orders[1:2], PLAIN.orders[3])), 7300),
        # aborted after two of four orders: 5000 x 2/3, no bonus at all
        (ABORTED, 10000 / 3),
        (replace(ABORTED, penalties=(3,), sensor_cost=12000), 10000 / 3 - 100 - 250),
        (replace(ABORTED, orders=()), 0),
        # an order of unknown type counts nowhere
        (replace(PLAIN, orders=(*PLAIN.orders, (UNKNOWN, 0, 9))), 19300),
        # neither completed nor aborted: the code does not look
        (replace(PLAIN, completed=0), 19300),
    ],
)
def test_as_coded_with_the_later_weights(tmp_path: Path, run: Run, later: float) -> None:
    assert score(tmp_path, run, LATER) == pytest.approx(later, abs=1e-6)


@pytest.mark.parametrize(
    ("run", "first"),
    [
        (PLAIN, 500 + 800 + 87.5 + 93.75 + HIGH_PRIORITY_FIRST + 500 + 25),
        # 100 + 50 + 50 + 300 + 2 x 50; 500 (8400/7000 - 1) = 100, and no bonus for sensors
        (
            replace(PLAIN, penalties=(0, 1, 2, 3, 4, 4), sensor_cost=8400),
            500 + 800 + 87.5 + 93.75 + HIGH_PRIORITY_FIRST + 25 - 600 - 100,
        ),
        # aborted: only time and sensors are lost
        (ABORTED, 1000 / 3 + 93.75 + 25),
        (replace(ABORTED, avg_report_time=0, defective_cells=0), 1000 / 3 + 125),
        (replace(ABORTED, orders=PLAIN.orders[3:]), 500 / 3 + 93.75 + HIGH_PRIORITY_FIRST + 25),
    ],
)
def test_as_first_coded_with_the_first_weights(tmp_path: Path, run: Run, first: float) -> None:
    assert score(tmp_path, run, FIRST) == pytest.approx(first, abs=1e-6)


@pytest.mark.parametrize(
    ("run", "documented"),
    [
        (PLAIN, 19300),
        (replace(PLAIN, duration=1250), 19300 - 500),
        (ABORTED, 10000 / 3),
        # not aborted, but a module is missing; three kits do not make up for it
        (replace(PLAIN, orders=(*PLAIN.orders[:2], PLAIN.orders[3])), 5000),
        (replace(PLAIN, orders=(*PLAIN.orders[:2], PLAIN.orders[0], PLAIN.orders[3])), 5000 * 4 / 3),
        (replace(PLAIN, sensor_cost=12000), 18300 - 250),
        (replace(PLAIN, completed=0), None),
    ],
)
def test_as_documented(tmp_path: Path, run: Run, documented: float | None) -> None:
    found = score(tmp_path, run, DOCUMENTED)

    assert found == (None if documented is None else pytest.approx(documented, abs=1e-6))


def test_a_time_limit_of_nothing_is_undecided_not_an_error(tmp_path: Path) -> None:
    assert score(tmp_path, replace(PLAIN, time_limit=0), LATER) is None


def test_an_unknown_penalty_stops_the_scoring(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="type 5 is an unknown penalty type"):
        score(tmp_path, replace(PLAIN, penalties=(5,)), LATER)


def test_every_deduction_is_in_the_ledger(tmp_path: Path) -> None:
    result = score_trial(stored(tmp_path, replace(PLAIN, penalties=(3,))), LATER)

    assert result.score == 19200
    assert result.possible == 19300


# To the last bit -----------------------------------------------------------------------

WEIGHTS: Mapping[str, tuple[Sequence[int], Sequence[int], int, int, int]] = {
    LATER: ([5000, 12000, 1000, 500, 600, 1000, 500], [50, 25, 25, 100, 100], 9600, 4, 150),
    FIRST: ([500, 800, 175, 125, 150, 500, 100], [100, 50, 50, 300, 50], 7000, 4, 130),
}
"""As the two files have them: weights, deductions, budget, nominal times."""


def transcribed(run: Run, rules: str) -> float:
    """The rulebook's formula in plain Python, added up from left to right."""
    (w1, w2, w3, w4, w5, w6, w7), deductions, budget, inspection_s, high_priority_s = WEIGHTS[rules]
    kinds = [kind for kind, _, _ in run.orders]
    kits: float = 0
    if run.num_kits + run.num_high_priority:
        number = kinds.count(KIT) + kinds.count(HIGH_PRIORITY)
        kits = w1 * number / (run.num_kits + run.num_high_priority)
    modules = w2 * kinds.count(MODULE) / run.num_modules if run.num_modules else 0
    b1 = w3 * (1 - run.duration / run.time_limit)
    b2 = max(0, w4 * (1 - run.avg_report_time / inspection_s))
    times_s = [submitted - announced for kind, announced, submitted in run.orders if kind == HIGH_PRIORITY]
    b3: float = 0
    if times_s:
        total_s = 0.0
        for time_s in times_s:
            total_s += time_s
        b3 = max(0, w5 * (1 - (total_s / len(times_s)) / high_priority_s))
    b4 = max(0, w6 * (1 - run.sensor_cost / budget))
    b5 = w7 * (run.classified / run.defective_cells) if run.defective_cells else 0
    if run.aborted:
        b1, b4 = 0, 0
        if rules == LATER:
            b2, b3, b5 = 0, 0, 0
    penalties = [run.penalties.count(kind) * deductions[kind] for kind in range(5)]
    p6 = max(w6 * (run.sensor_cost / budget - 1), 0)
    deducted = penalties[0] + penalties[1] + penalties[2] + penalties[3] + penalties[4] + p6
    return kits + modules + (b1 + b2 + b3 + b4 + b5) - deducted


def seconds(most_s: int) -> st.SearchStrategy[float]:
    """Times as a simulator stamps them, in ms: 12 significant digits hold them."""
    return st.integers(0, most_s * 1000).map(lambda ms: ms / 1000)


ORDERS = st.lists(st.tuples(st.sampled_from([1, 2, 3, -1]), seconds(900), seconds(900)), max_size=6).map(
    lambda orders: tuple((kind, min(a, b), max(a, b)) for kind, a, b in orders)
)
RUNS = st.builds(
    Run,
    time_limit=st.integers(100_000, 999_999).map(lambda ms: ms / 1000),
    num_kits=st.integers(0, 4),
    num_modules=st.integers(0, 4),
    num_high_priority=st.integers(0, 3),
    completed=st.integers(0, 1),
    aborted=st.integers(0, 1),
    sensor_cost=st.integers(0, 300).map(lambda fifties: 50.0 * fifties),
    duration=seconds(1200),
    defective_cells=st.integers(0, 9),
    avg_report_time=seconds(9),
    classified=st.integers(0, 9),
    penalties=st.lists(st.integers(0, 4), max_size=9).map(tuple),
    orders=ORDERS,
).filter(lambda run: run.orders or run.num_kits + run.num_modules + run.num_high_priority)


def unrounded(folder: Path, run: Run, rules: str) -> float:
    """Our score as it is before it is rounded for the ledger."""
    rule_set = load_rule_set(rules)
    path = stored(folder, run)
    trial = merge_trials(
        "T", [AriacDatabaseReader().read(path, Wanted(LogMap("test")))], file=path, competition=Ariac()
    )
    measured = measure_trial(trial, prepare(rule_set, registry=REGISTRY))
    return rule_set.sheet.evaluate(measured.scopes, measured.findings).value


@pytest.mark.slow
@pytest.mark.parametrize("rules", [LATER, FIRST])
@given(run=RUNS)
def test_the_score_before_rounding_is_the_official_one_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, rules: str, run: Run
) -> None:
    assert unrounded(tmp_path_factory.mktemp("run"), run, rules) == transcribed(run, rules)


@pytest.mark.slow
@pytest.mark.parametrize("rules", [LATER, FIRST, DOCUMENTED])
@settings(max_examples=25)
@given(run=RUNS.filter(lambda run: run.completed or run.aborted), kind=st.integers(0, 4))
def test_a_penalty_never_helps(
    tmp_path_factory: pytest.TempPathFactory, rules: str, run: Run, kind: int
) -> None:
    folder = tmp_path_factory.mktemp("run")
    before = unrounded(folder, run, rules)
    (folder / "results.db").unlink()

    assert unrounded(folder, replace(run, penalties=(*run.penalties, kind)), rules) < before


# The rule and the monitor --------------------------------------------------------------

FACTS = {
    "duration_s": 90.0,
    "time_limit_s": 100.0,
    "num_kits": 1.0,
    "num_modules": 0.0,
    "num_high_priority": 0.0,
    "total_cells": 4.0,
    "defective_cells": 1.0,
    "avg_report_time_s": 2.0,
    "num_reports_submitted": 4.0,
    "num_correct_reports": 3.0,
    "num_correct_report_classifications": 1.0,
    "completed": 1.0,
    "aborted": 0.0,
}


def judged(order: OfficialOrder | None) -> Finding:
    official = OfficialResult("results.db", None, None, summaries=() if order is None else (order,))
    (finding,) = RunOrder().judge(Trial("t", official=official), Order("kit_1", outline=True))
    return finding


def watched(monitor: RunRecord | None = None, **changes: Any) -> Finding:
    facts = {name: value for name, value in {**FACTS, **changes}.items() if value is not None}
    (finding,) = (monitor or RunRecord()).watch(Trial("t", facts=facts))
    return finding


def test_they_keep_their_contracts() -> None:
    assert isinstance(RunOrder(), Rule)
    assert isinstance(RunRecord(), Monitor)
    assert not list(RunRecord().needs())


def test_an_accepted_order_has_its_kind_and_times() -> None:
    finding = judged(OfficialOrder("kit_1", "kit", submitted=True, announced_s=1.5, submitted_s=9.0))

    assert finding.verdict is SATISFIED
    assert dict(finding.quantities) == {
        "kit": 1,
        "module": 0,
        "high_priority": 0,
        "announced_s": 1.5,
        "submitted_s": 9,
    }


def test_an_order_that_was_not_accepted_has_its_kind_alone() -> None:
    finding = judged(OfficialOrder("kit_1", "module", submitted=False))

    assert (finding.verdict, dict(finding.quantities)) == (
        VIOLATED,
        {"kit": 0, "module": 1, "high_priority": 0},
    )


@pytest.mark.parametrize(
    "order",
    [None, OfficialOrder("kit_2", "kit", submitted=True), OfficialOrder("kit_1", "kit", submitted=None)],
)
def test_an_order_without_a_record_is_undecided(order: OfficialOrder | None) -> None:
    assert judged(order).verdict is INCONCLUSIVE


def test_an_accepted_order_without_times_is_undecided() -> None:
    assert judged(OfficialOrder("kit_1", "kit", submitted=True)).verdict is INCONCLUSIVE


def test_a_run_has_all_its_numbers_aborted_or_not() -> None:
    assert (watched().verdict, dict(watched().quantities)) == (SATISFIED, FACTS)
    aborted = watched(aborted=1.0, completed=0.0)
    assert (aborted.verdict, aborted.quantities["duration_s"]) == (VIOLATED, 90)


@pytest.mark.parametrize("name", FACTS)
def test_a_run_that_lacks_a_number_is_undecided(name: str) -> None:
    finding = watched(**{name: None})

    assert (finding.verdict, dict(finding.quantities)) == (INCONCLUSIVE, {})


def test_a_run_that_never_ended_is_undecided_unless_taken_as_stored() -> None:
    assert watched(completed=0.0).verdict is INCONCLUSIVE
    assert watched(RunRecord(unfinished="as_stored"), completed=0.0).verdict is SATISFIED
    assert watched(RunRecord(unfinished="as_stored"), completed=0.0, time_limit_s=0.0).verdict is INCONCLUSIVE
