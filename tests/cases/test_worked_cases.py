"""Cases worked by hand from the rulebook, for what no official test covers.

A case needs no code: each `worked/*.yaml` names a rule set and holds cases, each with
the sum worked out in `worked`. A product is `type x y yaw`, in m and rad, and after that
`faulty`, `roll=<rad>`, `z=<m>`, `in=<quadrant>` or `quaternion=w,x,y,z`.

A case of a rulebook may name the difference it shows (`differs`) and what the code makes
of the same trial (`coded`); the team's sensors (`sensors`) or their recorded cost
(`cost`); parameters an organiser turned; values across teams (`cohort`: by name and
order, `trial` for the trial).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score import (
    Event,
    Order,
    Pose,
    Product,
    Result,
    RuleSet,
    Submission,
    Task,
    TeamSetup,
    Tray,
    Trial,
    TrialBuilder,
    WantedProduct,
    load_rule_set,
    measure_trial,
)
from ariac_score.engine import price_trial
from ariac_score.expression import Expression
from ariac_score.registry import Registry
from ariac_score.result import Provenance
from ariac_score.scoring.cohort import CohortValues

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
    "unwitnessed",
    "parameters",
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
}


@cache
def rules_of(name: str) -> RuleSet:
    return load_rule_set(name)


def worked_cases() -> Iterator[Any]:
    for file in sorted(FOLDER.glob("*.yaml")):
        told = yaml.safe_load(file.read_text(encoding="utf-8"))
        for case in told["cases"]:
            yield pytest.param({"rules": told["rules"], **case}, id=f"{file.stem}-{case['id']}")


def differing_cases() -> Iterator[Any]:
    """The cases that show a difference between rulebook and code."""
    for parameter in worked_cases():
        if "differs" in parameter.values[0]:
            yield parameter


def product_of(told: str) -> Product:
    kind, x, y, yaw, *more = told.split()
    options = dict(word.split("=") for word in more if "=" in word)
    options.pop("in", None)
    place = (float(x), float(y), float(options.pop("z", 0.0)))
    pose = Pose.from_rpy(place, (float(options.pop("roll", 0.0)), 0.0, float(yaw)))
    if "quaternion" in options:
        w, i, j, k = (float(number) for number in options.pop("quaternion").split(","))
        pose = Pose(pose.position_m, (w, i, j, k))
    assert not options
    return Product(kind, pose, "faulty" in more)


def quadrant_of(told: str) -> int:
    return next((int(word[3:]) for word in told.split() if word.startswith("in=")), 0)


def task_of(told: Mapping[str, Any]) -> Task:
    products = [product_of(text) for text in told.get("products", [])]
    return Task(
        told["id"],
        told.get("kind", "kitting"),
        tuple(
            WantedProduct(f"part_{i}", p.type, p.pose, quadrant_of(text))
            for i, (p, text) in enumerate(zip(products, told.get("products", []), strict=True))
        ),
        told.get("agv", "any"),
        told.get("station", ""),
        Tray(told["tray"]) if "tray" in told else None,
    )


def submission_of(told: Mapping[str, Any]) -> Submission:
    no_tray = told.get("tray") == "none"
    tray = product_of(told["tray"]) if "tray" in told and not no_tray else None
    return Submission(
        told["task"],
        float(told["at"]),
        tuple(product_of(text) for text in told["products"]),
        told.get("agv", "agv1"),
        told.get("station", ""),
        Tray("") if no_tray else Tray(tray.type, tray.pose) if tray else None,
    )


def trial_of(case: Mapping[str, Any]) -> Trial:
    builder = TrialBuilder("case", file="case", clock="simulated time")
    builder.witnessed |= WITNESSED - set(case.get("unwitnessed", []))
    if "sensors" in case or "cost" in case:
        builder.team = TeamSetup("", case.get("sensors"), case.get("cost"))
    for told in case["orders"]:
        tasks = tuple(task_of(task) for task in told["tasks"])
        order = Order(
            told["id"], tasks, float(told["at"]), told.get("priority", 1), updates=told.get("updates", "")
        )
        builder.add(order)
    for told in case.get("submissions", []):
        builder.add(submission_of(told))
    for i, told in enumerate(case.get("events", [])):
        kind, *more = told.split()
        t_s = next((float(word[3:]) for word in more if word.startswith("at=")), 90.0 + i)
        builder.add(Event(t_s, kind, *[word for word in more if not word.startswith("at=")]))
    return builder.build()


def cohort_of(case: Mapping[str, Any]) -> CohortValues:
    values = {
        name: {"" if path == "trial" else path: float(value) for path, value in given.items()}
        for name, given in case.get("cohort", {}).items()
    }
    return CohortValues("cohort of the case" if values else "", values)


def result_of(case: Mapping[str, Any], rules: str) -> Result:
    rule_set = rules_of(rules)
    if rules == case["rules"]:
        parameters = {**rule_set.sheet.parameters, **case.get("parameters", {})}
        rule_set = replace(rule_set, sheet=replace(rule_set.sheet, parameters=parameters))
    measured = measure_trial(trial_of(case), rule_set.build(REGISTRY), registry=REGISTRY, rule_set=rule_set)
    provenance = Provenance((), (), (rule_set.id, ""), ("", ""), ())
    return price_trial(measured, rule_set, provenance, cohort_of(case))


@pytest.mark.parametrize("case", list(worked_cases()))
def test_a_case_worked_by_hand(case: Mapping[str, Any]) -> None:
    assert set(case) <= KEYS
    assert case["worked"]
    compare(case["expected"], result_of(case, case["rules"]), cohort_of(case))


@pytest.mark.parametrize("case", list(differing_cases()))
def test_a_difference_changes_the_number(case: Mapping[str, Any]) -> None:
    differs = rules_of(case["rules"]).differs
    assert differs is not None
    assert case["differs"] in {difference.name for difference in differs.because}

    compare(case["coded"], result_of(case, differs.other), cohort_of(case))

    expected = case["expected"]
    documented = expected["score"] if "score" in expected else expected["task"]
    assert documented != case["coded"].get("score")


def compare(expected: Mapping[str, Any], result: Result, cohort: CohortValues) -> None:
    for key, value in expected.items():
        if key == "score":
            assert result.status == "scored"
            assert amount(result.score) == value
        elif key == "task":
            assert result.task is not None
            assert amount(result.task.amount) == value
        elif key == "status":
            assert (result.status, result.score) == (value, None)
        elif key == "possible":
            assert amount(result.possible) == value
        elif key == "undecided":
            assert (result.status, result.score) == ("incomplete", None)
            withheld = {a.check for a in result.assumptions if a.policy == "withhold"}
            assert sorted(withheld) == sorted(value)
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
    sheet = rules_of(result.provenance.rule_set[0]).sheet
    scopes, findings = result.measured.scopes, result.measured.findings
    for subject, named in expected.items():
        path = "" if subject == "trial" else subject
        level = ("submission", "part")[path.count("/") - 1] if "/" in path else "order" if path else "trial"
        for name, value in named.items():
            formula = Expression.parse(name)
            told = sheet.evaluate_in(formula, scopes, findings, level=level, cohort=cohort)
            assert (subject, name, told[path].value) == (subject, name, pytest.approx(value, rel=1e-9))


def compare_quantities(expected: Mapping[str, Mapping[str, float]], result: Result) -> None:
    for check, named in expected.items():
        (finding,) = result.measured.of(check).values()
        assert {name: finding.quantities[name] for name in named} == named
