"""Cases worked by hand from the rulebook, for what no official test covers.

A case needs no code: each `worked/*.yaml` names a rule set and holds cases, each with
the sum worked out in `worked`. A product is `type x y yaw`, in m and rad, and after that
`faulty`, `roll=<rad>` or `quaternion=w,x,y,z`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
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
    Submission,
    Task,
    Tray,
    Trial,
    TrialBuilder,
    WantedProduct,
    load_rule_set,
    measure_trial,
)
from ariac_score.engine import price_trial
from ariac_score.expression import Traced
from ariac_score.registry import Registry
from ariac_score.result import Provenance

FOLDER = Path(__file__).parent / "worked"
REGISTRY = Registry()
KEYS = {"id", "worked", "rules", "orders", "submissions", "events", "expected"}


def worked_cases() -> Iterator[Any]:
    for file in sorted(FOLDER.glob("*.yaml")):
        told = yaml.safe_load(file.read_text(encoding="utf-8"))
        for case in told["cases"]:
            yield pytest.param({"rules": told["rules"], **case}, id=f"{file.stem}-{case['id']}")


def product_of(told: str) -> Product:
    kind, x, y, yaw, *more = told.split()
    options = dict(word.split("=") for word in more if "=" in word)
    pose = Pose.from_rpy((float(x), float(y), 0.0), (float(options.pop("roll", 0.0)), 0.0, float(yaw)))
    if "quaternion" in options:
        w, i, j, k = (float(number) for number in options.pop("quaternion").split(","))
        pose = Pose(pose.position_m, (w, i, j, k))
    assert not options
    return Product(kind, pose, "faulty" in more)


def task_of(told: Mapping[str, Any]) -> Task:
    products = [product_of(text) for text in told.get("products", [])]
    return Task(
        told["id"],
        told.get("kind", "kitting"),
        tuple(WantedProduct(f"part_{i}", p.type, p.pose) for i, p in enumerate(products)),
        told.get("agv", "any"),
        told.get("station", ""),
        Tray(told["tray"]) if "tray" in told else None,
    )


def submission_of(told: Mapping[str, Any]) -> Submission:
    tray = product_of(told["tray"]) if "tray" in told else None
    return Submission(
        told["task"],
        float(told["at"]),
        tuple(product_of(text) for text in told["products"]),
        told.get("agv", "agv1"),
        told.get("station", ""),
        Tray(tray.type, tray.pose) if tray else None,
    )


def trial_of(case: Mapping[str, Any]) -> Trial:
    builder = TrialBuilder("case", file="case", clock="simulated time")
    builder.witnessed |= {"submissions", "arm_collision", "part_dropped", "bodies"}
    for told in case["orders"]:
        tasks = tuple(task_of(task) for task in told["tasks"])
        order = Order(
            told["id"], tasks, float(told["at"]), told.get("priority", 1), updates=told.get("updates", "")
        )
        builder.add(order)
    for told in case.get("submissions", []):
        builder.add(submission_of(told))
    for i, kind in enumerate(case.get("events", [])):
        builder.add(Event(90.0 + i, kind))
    return builder.build()


def terms_in(traced: Traced) -> Iterator[Traced]:
    if traced.kind == "term":
        yield traced
    for child in traced.children:
        yield from terms_in(child)


@pytest.mark.parametrize("case", list(worked_cases()))
def test_a_case_worked_by_hand(case: Mapping[str, Any]) -> None:
    assert set(case) <= KEYS
    assert case["worked"]
    rule_set, trial = load_rule_set(case["rules"]), trial_of(case)
    measured = measure_trial(trial, rule_set.build(REGISTRY), registry=REGISTRY, rule_set=rule_set)
    result = price_trial(measured, rule_set, Provenance((), (), (rule_set.id, ""), ("", ""), ()))

    for key, value in case["expected"].items():
        if key == "score":
            assert (result.status, result.score) == ("scored", value)
        elif key == "possible":
            assert result.possible == value
        elif key == "undecided":
            assert (result.status, result.score) == ("incomplete", None)
            assert sorted({assumption.check for assumption in result.assumptions}) == sorted(value)
        elif key == "terms":
            compare_terms(value, result)
        elif key == "quantities":
            compare_quantities(value, result)
        elif key == "verdicts":
            for check, verdict in value.items():
                found = {f.verdict.value for f in measured.of(check).values()}
                assert (check, found) == (check, {verdict})
        else:
            pytest.fail(f"unknown expectation {key!r}")


def compare_terms(expected: Mapping[str, Mapping[str, float]], result: Result) -> None:
    rule_set = load_rule_set(result.provenance.rule_set[0])
    traced = rule_set.sheet.evaluate(result.measured.scopes, result.measured.findings)
    terms = {(term.subject, term.label): term.value for term in terms_in(traced)}
    for subject, named in expected.items():
        assert {name: terms[subject, name] for name in named} == named


def compare_quantities(expected: Mapping[str, Mapping[str, float]], result: Result) -> None:
    for check, named in expected.items():
        (finding,) = result.measured.of(check).values()
        assert {name: finding.quantities[name] for name in named} == named
