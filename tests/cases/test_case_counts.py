"""Every check of every edition has cases on both sides: one where it earns, one where it does not.

A case decides through a check when a value that it expects (score, task score, a term, or
what it says of the check itself) would be another had the verdict been another. Cases of
a rule set that another one extends count for that one too where the check is the same.
"""

from __future__ import annotations

import runpy
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score import Finding, RuleSet, Verdict, load_rule_set, measure_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.errors import FormulaError, NeedsCohortError
from ariac_score.results.result import Measured
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.ruleset import rule_set_names

WORKED: Mapping[str, Any] = runpy.run_path(str(Path(__file__).parent / "test_worked_cases.py"))
pytestmark = pytest.mark.slow  # measures every worked case again

REGISTRY = Registry()

EDITIONS = [
    name
    for name in rule_set_names()
    if name.startswith("ariac") and not name.endswith((".official", ".evaluation"))
]
"""The rule sets that score a log; those that price official texts are tested with such texts."""

NEVER_VIOLATED = {"kitting.only_kitting"}
"""Plugins that are satisfied or undecided; the cases are on those two sides."""

ASKS_THE_KIND = {"kitting.task_kind"}
"""Plugins to which not applicable is an answer: the task is of another kind."""

UNCOUNTED: Mapping[str, str] = {
    "ariac2022.as_coded/separation": "shown beside the score; neither score nor official text asks about it",
    **{
        f"ariac{year}.safe/{check}": "of recordings: tests/plugins/ariac/test_stock.py"
        for year, checks in (
            (2023, ("printed", "order_score", "separation", "human_contact")),
            (2024, ("printed", "order_score", "separation", "human_contact")),
            (2025, ("separation", "human_contact")),
        )
        for check in checks
    },
}
"""Checks, as `rule set/check`, that two cases cannot decide, and why."""

ENOUGH = 2

Sides = dict[str, set[str]]
"""For each side of a check the cases that are on it."""


def told_cases() -> Iterator[tuple[str, str, Mapping[str, Any], Mapping[str, Any]]]:
    """Each case with its name and what it expects under which rule set; a difference tells of two."""
    for name, case in WORKED["worked_cases"]():
        if "refused" in case["expected"]:
            continue
        yield name, case["rules"], case, case["expected"]
        differs = load(case["rules"]).differs
        if "coded" in case and differs is not None:
            yield name, differs.other, case, case["coded"]


@cache
def load(name: str) -> RuleSet:
    return load_rule_set(name)


@cache
def built(name: str) -> Prepared:
    return prepare(load(name), registry=REGISTRY)


@cache
def counted() -> dict[str, dict[str, Sides]]:
    """Of each rule set, of each of its checks: the cases that decide through it, by side."""
    found: dict[str, dict[str, Sides]] = {}
    for name, rules, case, expected in told_cases():
        known = found.setdefault(rules, {})
        for check, side in sides_of(case, rules, expected, known):
            known.setdefault(check, {}).setdefault(side, set()).add(name)
    return found


def sides_of(
    case: Mapping[str, Any], rules: str, expected: Mapping[str, Any], known: Mapping[str, Sides]
) -> Iterator[tuple[str, str]]:
    """The checks a case decides through, and on which side; not looked at where there are cases enough."""
    rule_set = load(rules)
    open_ = [c for c in rule_set.checks.values() if not enough(known.get(c.name, {}), c.use)]
    if not open_:
        return
    if rules == case["rules"] and "parameters" in case:
        parameters = {**rule_set.sheet.parameters, **case["parameters"]}
        rule_set = replace(rule_set, sheet=replace(rule_set.sheet, parameters=parameters))
    trial = WORKED["trial_of"](case)
    measured = measure_trial(trial, replace(built(rules), rule_set=rule_set))
    values = valuing(rule_set, measured, WORKED["cohort_of"](case, rules), expected)
    as_found = values(measured.findings)
    for check in open_:
        decided = set(said_of(check.name, expected))
        for side, otherwise in said_otherwise(measured, check.name, check.use):
            if side not in decided and values(otherwise) != as_found:
                decided.add(side)
        yield from ((check.name, side) for side in sorted(decided))


def enough(found: Sides, use: str) -> bool:
    """Whether two cases show a check earning and not earning, or measuring two numbers of one quantity."""
    pairs = [{"earned", "not earned"}, *([{"earned", "undecided"}] if use in NEVER_VIOLATED else [])]
    measured = [name for side in found for name, _, _ in [side.rpartition(" ")] if name not in ("", "not")]
    two_sided = any(pair <= found.keys() for pair in pairs) or len(measured) > len(set(measured))
    return two_sided and len(set().union(*found.values())) >= ENOUGH


def valuing(
    rule_set: RuleSet, measured: Measured, cohort: CohortValues, expected: Mapping[str, Any]
) -> Callable[[Mapping[str, Finding]], list[Any]]:
    """What gives the values that a case expects, from findings."""
    sheet, scopes = rule_set.sheet, measured.scopes

    def value(give: Callable[[], Any]) -> Any:
        try:
            return give()
        except (FormulaError, NeedsCohortError) as error:
            return type(error).__name__

    def values(findings: Mapping[str, Finding]) -> list[Any]:
        given = []
        if "score" in expected:
            given.append(value(lambda: sheet.evaluate(scopes, findings, cohort).value))
        if "task" in expected:
            given.append(value(lambda: sheet.evaluate_task(scopes, findings).value))  # type: ignore[union-attr]
        for subject, named in expected.get("terms", {}).items():
            path = "" if subject == "trial" else subject
            level = (
                ("submission", "part")[path.count("/") - 1] if "/" in path else "order" if path else "trial"
            )
            for name in named:
                formula = Expression.parse(name)
                given.append(
                    value(
                        lambda formula=formula, level=level, path=path: (
                            sheet.evaluate_in(formula, scopes, findings, level=level, cohort=cohort)[
                                path
                            ].value
                        )
                    )
                )
        return given

    return values


OPPOSITE = {
    Verdict.SATISFIED: ("earned", Verdict.VIOLATED),
    Verdict.VIOLATED: ("not earned", Verdict.SATISFIED),
}


def answer(finding: Finding, use: str) -> Verdict:
    """What a check says, as far as a formula hears it."""
    other_kind = finding.verdict is Verdict.NOT_APPLICABLE and use in ASKS_THE_KIND
    return Verdict.VIOLATED if other_kind else finding.verdict


def said_otherwise(measured: Measured, check: str, use: str) -> Iterator[tuple[str, dict[str, Finding]]]:
    """The findings as they would be had the verdict been the opposite, or measured another number."""
    own = {key: finding for key, finding in measured.findings.items() if finding.check == check}
    for verdict, (side, opposite) in OPPOSITE.items():
        turned = {key: replace(f, verdict=opposite) for key, f in own.items() if answer(f, use) is verdict}
        for change in [*({key: f} for key, f in turned.items()), turned]:
            if change:
                yield side, {**measured.findings, **change}
    for key, finding in own.items():
        for name, number in finding.quantities.items():
            another = replace(finding, quantities={**finding.quantities, name: 2 * number + 1})
            yield f"{name} {number:g}", {**measured.findings, key: another}


def said_of(check: str, expected: Mapping[str, Any]) -> Iterator[str]:
    """The side a case names a check to be on."""
    if check in expected.get("undecided", ()):
        yield "undecided"
    for name, number in expected.get("quantities", {}).get(check, {}).items():
        yield f"{name} {number:g}"
    verdict = expected.get("verdicts", {}).get(check)
    if verdict is not None:
        yield {"satisfied": "earned", "violated": "not earned"}.get(verdict, verdict)


def taken_over(name: str) -> Iterator[str]:
    """The rule sets a rule set extends, itself first."""
    while name:
        yield name
        name = yaml.safe_load(Path(load(name).file).read_text(encoding="utf-8")).get("extends", "")


def sides(name: str, check: str) -> Sides:
    """The cases that decide through a check, by side, those of rule sets it was taken over from too."""
    own = load(name).checks[check]
    found: Sides = {}
    for base in taken_over(name):
        theirs = load(base).checks.get(check)
        if theirs is None or (theirs.use, theirs.parameters) != (own.use, own.parameters):
            break
        for side, cases in counted().get(base, {}).get(check, {}).items():
            found.setdefault(side, set()).update(cases)
    return found


def wanting(name: str, check: str) -> str:
    """What is wanting of two cases on two sides, in words; empty when nothing is."""
    found = sides(name, check)
    if enough(found, load(name).checks[check].use):
        return ""
    return f"{check}: " + (", ".join(f"{len(found[side])} {side}" for side in sorted(found)) or "no case")


def test_every_check_has_a_case_where_it_earns_and_one_where_it_does_not(subtests: pytest.Subtests) -> None:
    for name in EDITIONS:
        with subtests.test(name):
            checks = [check for check in load(name).checks if f"{name}/{check}" not in UNCOUNTED]
            short = [missing for check in checks if (missing := wanting(name, check))]

            assert not short, "\n".join(short)


def test_no_check_is_left_out_that_has_its_cases() -> None:
    left_out = [key.rpartition("/") for key in UNCOUNTED]

    assert [f"{name}/{check}" for name, _, check in left_out if not wanting(name, check)] == []
