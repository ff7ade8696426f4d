"""Cases worked by hand from the rulebook, for what no official test covers.

A case needs no code: each `worked/*.yaml` names a rule set (or several that give the same
numbers) and holds cases, each with the sum worked out in `worked`. A product is
`type x y yaw`, in m and rad, and after that `faulty`, `roll=<rad>`, `z=<m>`,
`in=<quadrant>`, `quaternion=w,x,y,z`, `name=<model>`, and of an ordered one `challenged`
or `unchallenged`, which says whether a faulty-part challenge is set on its quadrant.

A run of 2025 (`run_2025`) is what its database holds: columns of the tables Trial and Run
by name, penalties by name, and accepted orders as `kind announced submitted`, in s. What
is not given is as the schema has it by default. It names the parts of the score in
`terms` of `trial`. What must be refused says with which words (`refused`).

What is left open names the checks (`undecided`), and the least and the most that the score
can be (`between`), of which the least counts, or the `score` where what is open changes
nothing; without either there is no score.

A case of a rulebook may name the difference it shows (`differs`) and what the code makes
of the same trial (`coded`); the team's sensors (`sensors`) or their recorded cost
(`cost`); parameters an organiser turned; values across teams (`cohort`: by name and
order, `trial` for the trial), or the other teams (`teams`: of each what it has instead,
such as its submissions and cost), of which and of itself the values are then made.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import replace
from decimal import Decimal
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
import yaml

from ariac_score import (
    Event,
    LogError,
    Pose,
    Result,
    RuleSet,
    TeamSetup,
    Trial,
    TrialBuilder,
    load_rule_set,
    measure_trial,
)
from ariac_score.checks.contracts import Wanted
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.price import price_trial
from ariac_score.results.cohort_file import contributed, make_cohort
from ariac_score.results.result import Measured, Pinned, Provenance
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.trial.build import merge_trials
from ariac_score.trial.channels import LogMap
from ariac_score.trial.clock import Clock
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.official.ariac_database import AriacDatabaseReader
from ariac_score_ariac.work import KitSubmission, Order, Product, SensorBill, Task, Tray, WantedProduct

FOLDER = Path(__file__).parent / "worked"
REGISTRY = Registry()
KEYS = {
    "id",
    "worked",
    "rules",
    "orders",
    "submissions",
    "events",
    "expected",
    "differs",
    "coded",
    "sensors",
    "cost",
    "cohort",
    "teams",
    "unwitnessed",
    "parameters",
    "run_2025",
}
WITNESSED = {
    "submissions",
    "bodies",
    "arm_collision",
    "robot_collision",
    "self_collision",
    "human_collision",
    "obstacle_collision",
    "part_dropped",
    "part_assembled",
    "quality_check",
}
CHALLENGED = {"challenged": True, "unchallenged": False}

# Numbers and columns of the database of 2025, from the notes on log formats, section 10.
PENALTIES = {
    "good_cell_in_inspection_bin": 0,
    "cell_in_conveyor_bin": 1,
    "object_on_invalid_surface": 2,
    "agv_collision": 3,
    "robot_collision": 4,
    "unheard_of": 5,
}
ORDER_TYPES = {"kit": 1, "module": 2, "high_priority": 3, "unknown": -1}
TABLES = """
CREATE TABLE Competitor (id INTEGER PRIMARY KEY, name TEXT);
CREATE TABLE Trial (id INTEGER PRIMARY KEY, trial_id TEXT, config_hash TEXT, seed INTEGER, time_limit REAL,
    num_kits INTEGER DEFAULT 0, num_modules INTEGER DEFAULT 0, num_high_priority INTEGER DEFAULT 0);
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


@cache
def rules_of(name: str) -> RuleSet:
    return load_rule_set(name)


@cache
def prepared(name: str) -> Prepared:
    return prepare(rules_of(name), registry=REGISTRY)


TABLES_OF_CASES = sorted(FOLDER.glob("*.yaml"))


def worked_cases(*tables: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Each case of some tables, of all when none is named, and its name."""
    for file in tables or TABLES_OF_CASES:
        document = table(file)
        several = isinstance(document["rules"], list)
        for rules in document["rules"] if several else [document["rules"]]:
            for case in document["cases"]:
                name = f"{file.stem}-{case['id']}" + (f"-{rules}" if several else "")
                yield name, {"rules": rules, **case}


@cache
def table(file: Path) -> Mapping[str, Any]:
    # Tests read these tables several times; LibYAML reads them ten times as fast.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    document: Mapping[str, Any] = yaml.load(file.read_text(encoding="utf-8"), loader)  # noqa: S506  # a safe one
    return document


each_table = pytest.mark.parametrize("file", TABLES_OF_CASES, ids=lambda file: file.stem)


def product_of(text: str) -> Product:
    kind, x, y, yaw, *more = text.split()
    options = dict(word.split("=") for word in more if "=" in word)
    options.pop("in", None)
    name = options.pop("name", "")
    place = (float(x), float(y), float(options.pop("z", 0.0)))
    pose = Pose.from_rpy(place, (float(options.pop("roll", 0.0)), 0.0, float(yaw)))
    if "quaternion" in options:
        w, i, j, k = (float(number) for number in options.pop("quaternion").split(","))
        pose = Pose(pose.position_m, (w, i, j, k))
    assert not options
    return Product(kind, pose, "faulty" in more, name)


def quadrant_of(text: str) -> int:
    return next((int(word[3:]) for word in text.split() if word.startswith("in=")), 0)


def wanted_of(text: str, slot: str) -> WantedProduct:
    product = product_of(text)
    challenged = next((CHALLENGED[word] for word in text.split() if word in CHALLENGED), None)
    return WantedProduct(slot, product.type, product.pose, quadrant_of(text), challenged)


def task_of(document: Mapping[str, Any]) -> Task:
    return Task(
        document["id"],
        document.get("kind", "kitting"),
        tuple(wanted_of(text, f"part_{i}") for i, text in enumerate(document.get("products", []))),
        document.get("agv", "any"),
        document.get("station", ""),
        Tray(document["tray"]) if "tray" in document else None,
    )


def submission_of(document: Mapping[str, Any]) -> KitSubmission:
    no_tray = document.get("tray") == "none"
    tray = product_of(document["tray"]) if "tray" in document and not no_tray else None
    return KitSubmission(
        document["task"],
        float(document["at"]),
        tuple(product_of(text) for text in document["products"]),
        document.get("agv", "agv1"),
        document.get("station", ""),
        Tray("") if no_tray else Tray(tray.type, tray.pose) if tray else None,
    )


def row(database: sqlite3.Connection, table: str, **values: Any) -> None:
    columns, marks = ", ".join(values), ", ".join("?" * len(values))
    database.execute(f"INSERT INTO {table} ({columns}) VALUES ({marks})", tuple(values.values()))  # noqa: S608


def store_run(path: Path, document: Mapping[str, Any]) -> None:
    """Write the database of 2025 with one run."""
    assert set(document) <= {"trial", "run", "penalties", "orders"}
    with closing(sqlite3.connect(path)) as database:
        database.executescript(TABLES)
        row(database, "Competitor", id=1, name="team")
        row(database, "Trial", id=1, trial_id="case", **document["trial"])
        row(database, "Run", id=1, trial_id=1, competitor_id=1, **document["run"])
        for name in document.get("penalties", []):
            row(database, "Penalty", run_id=1, type=PENALTIES[name], description="", time=1.0)
        for text in document.get("orders", []):
            kind, announced, submitted = text.split()
            times = {"announcement_time": float(announced), "submission_time": float(submitted)}
            row(database, "OrderSubmission", run_id=1, order_type=ORDER_TYPES[kind], **times)
        database.commit()


def run_of(document: Mapping[str, Any]) -> Trial:
    """A run of 2025 as its reader gives it."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "results.db"
        store_run(path, document)
        return merge_trials(
            "case", [AriacDatabaseReader().read(path, Wanted(LogMap("case")))], file=path, competition=Ariac()
        )


def trial_of(case: Mapping[str, Any]) -> Trial:
    return run_of(case["run_2025"]) if "run_2025" in case else built_trial(case)


def built_trial(case: Mapping[str, Any]) -> Trial:
    builder = TrialBuilder("case", file="case", clock=Clock("simulated time"))
    builder.witnessed |= WITNESSED - set(case.get("unwitnessed", []))
    if "sensors" in case or "cost" in case:
        builder.team = TeamSetup("", case.get("sensors"))
        if case.get("cost") is not None:
            builder.add(SensorBill(case["cost"]))
    for document in case["orders"]:
        tasks = tuple(task_of(task) for task in document["tasks"])
        order = Order(
            document["id"],
            tasks,
            float(document["at"]),
            document.get("priority", 1),
            updates=document.get("updates", ""),
        )
        builder.add(order)
    for document in case.get("submissions", []):
        builder.add(submission_of(document))
    for i, document in enumerate(case.get("events", [])):
        kind, *more = document.split()
        t_s = next((float(word[3:]) for word in more if word.startswith("at=")), 90.0 + i)
        builder.add(Event(t_s, kind, *[word for word in more if not word.startswith("at=")]))
    return merge_trials("case", [builder.build()], file="case", competition=Ariac())


def cohort_of(case: Mapping[str, Any], rules: str) -> CohortValues:
    if "teams" in case:
        rule_set = rules_of(rules)
        teams = [measured_under(rule_set, {**case, **other}) for other in ({}, *case["teams"])]
        return make_cohort(rule_set, {"case": [contributed(t, rule_set) for t in teams]}).of_trial("case")
    values = {
        name: {"" if path == "trial" else path: float(value) for path, value in given.items()}
        for name, given in case.get("cohort", {}).items()
    }
    return CohortValues("cohort of the case" if values else "", values)


def measured_under(rule_set: RuleSet, case: Mapping[str, Any]) -> Measured:
    return measure_trial(trial_of(case), replace(prepared(rule_set.id), rule_set=rule_set))


def result_of(case: Mapping[str, Any], rules: str) -> Result:
    rule_set = rules_of(rules)
    if rules == case["rules"] and "parameters" in case:  # otherwise the same, whose text is written once
        parameters = {**rule_set.sheet.parameters, **case["parameters"]}
        rule_set = replace(rule_set, sheet=replace(rule_set.sheet, parameters=parameters))
    provenance = Provenance((), (), Pinned(rule_set.id, ""), Pinned("", ""), ())
    return price_trial(measured_under(rule_set, case), rule_set, provenance, cohort_of(case, rules))


@each_table
def test_cases_worked_by_hand(file: Path, subtests: pytest.Subtests) -> None:
    for name, case in worked_cases(file):
        with subtests.test(name):
            assert set(case) <= KEYS
            assert case["worked"]
            if "refused" in case["expected"]:
                with pytest.raises(LogError, match=case["expected"]["refused"]):
                    result_of(case, case["rules"])
            else:
                result = result_of(case, case["rules"])
                compare(case["expected"], result, cohort_of(case, case["rules"]))


@each_table
def test_a_difference_changes_the_number(file: Path, subtests: pytest.Subtests) -> None:
    for name, case in worked_cases(file):
        if "differs" in case:
            with subtests.test(name):
                compare_as_coded(case)


def compare_as_coded(case: Mapping[str, Any]) -> None:
    differs = rules_of(case["rules"]).differs
    assert differs is not None
    assert case["differs"] in {difference.name for difference in differs.because}

    compare(case["coded"], result_of(case, differs.other), cohort_of(case, differs.other))

    expected = case["expected"]
    documented = expected.get("score", expected.get("task"))
    assert documented is not None or expected["undecided"]
    assert documented != case["coded"].get("score")


def test_the_tables_hold_hundreds_of_cases_each_with_a_name_of_its_own() -> None:
    names = [name for name, _ in worked_cases()]
    assert len(set(names)) == len(names) > 800


def compare(expected: Mapping[str, Any], result: Result, cohort: CohortValues) -> None:
    for key, value in expected.items():
        if key == "score":
            assert (result.status, result.is_open) == ("scored", False)
            assert amount(result.score) == value
        elif key == "task":
            assert result.task is not None
            assert amount(result.task.amount) == value
        elif key == "status":
            assert (result.status, result.score) == (value, None)
        elif key == "possible":
            assert amount(result.possible) == value
        elif key == "undecided":
            policy = "worst" if {"between", "score"} & set(expected) else "withhold"
            assert policy == "worst" or (result.status, result.score) == ("incomplete", None)
            assert sorted({a.check for a in result.assumptions if a.policy == policy}) == sorted(value)
        elif key == "between":
            assert result.interval is not None
            assert [amount(result.interval.least), amount(result.interval.most)] == value
            assert (result.is_open, result.status) == (True, "scored")
            assert result.score == result.interval.least
        elif key == "terms":
            compare_terms(value, result, cohort)
        elif key == "quantities":
            compare_quantities(value, result)
        elif key == "verdicts":
            for check, verdict in value.items():
                found = {f.verdict.value for f in result.measured.of(check).values()}
                assert (check, found) == (check, {verdict})
        else:
            pytest.fail(f"unknown expectation {key!r}")


def amount(number: Decimal | None) -> Any:
    """To compare with a number worked by hand: as good as the digits of a result."""
    assert number is not None
    return pytest.approx(float(number), rel=1e-9, abs=5.1e-10)


def compare_terms(expected: Mapping[str, Mapping[str, float]], result: Result, cohort: CohortValues) -> None:
    sheet = rules_of(result.provenance.rule_set.id).sheet
    scopes, findings = result.measured.scopes, result.measured.findings
    for subject, named in expected.items():
        path = "" if subject == "trial" else subject
        level = ("submission", "part")[path.count("/") - 1] if "/" in path else "order" if path else "trial"
        for name, value in named.items():
            formula = Expression.parse(name)
            values = sheet.evaluate_in(formula, scopes, findings, level=level, cohort=cohort)
            assert (subject, name, values[path].value) == (subject, name, pytest.approx(value, rel=1e-9))


def compare_quantities(expected: Mapping[str, Mapping[str, float]], result: Result) -> None:
    for check, named in expected.items():
        (finding,) = result.measured.of(check).values()
        assert {name: finding.quantities[name] for name in named} == named
