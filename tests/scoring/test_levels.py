"""Levels and facts of any competition: declared in a rule set, priced on made findings."""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Mapping
from pathlib import Path
from random import Random

import numpy as np
import pytest

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import FormulaError, UnknownFactError
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.pricing import price
from ariac_score.scoring.ruleset import RuleSet, draft_rule_set, load_rule_set, rule_set_from_text
from ariac_score.scoring.scope import Scope

S, V = Verdict.SATISFIED, Verdict.VIOLATED
Fact = int | float | str | None


def rules(text: str) -> RuleSet:
    head = "id: cup\ntitle: Cup\nsource: a test\nlog_map: none\n"
    return draft_rule_set(head + text, file="cup.yaml")


def score(rule_set: RuleSet, trial: Scope, *findings: Finding) -> float:
    numbered = {f"{f.check}#{i:03d}": f for i, f in enumerate(findings)}
    priced = price(numbered, trial, rule_set.sheet, rule_set.policies, digits=6)
    assert priced.ledger is not None
    return float(priced.ledger.amount)


def said(check: str, subject: str, verdict: Verdict) -> Finding:
    return Finding(subject, verdict, "made", check=check)


# Three levels, one, five ---------------------------------------------------------------

TABLE = """
levels: [object, task, trial]
facts:
  object: {kind: text, mass_kg: {type: number, unit: kg, meaning: what it weighs}}
  task: {time_limit_s: number, time_s: number}
  trial: {venue: text}
rules:
  placed: {use: made.placed}
terms:
  object:
    worth: (20 if object.kind == "bolt" else 10) * points(placed)
  task:
    in_time: 0 if absent(task.time_s) else task.time_s <= task.time_limit_s
    worth: sum(object.worth) + 5 * in_time
score: sum(task.worth) * (2 if trial.venue != "home" else 1)
"""


def table(**trial: Fact) -> Scope:
    """Two tasks: a bolt and a nut within 30 s of 60; a bolt that was never finished."""
    bolt = {"kind": "bolt", "mass_kg": 0.02}
    first = (
        Scope("object", "task_1/a", bolt),
        Scope("object", "task_1/b", {"kind": "nut", "mass_kg": 0.01}),
    )
    tasks = (
        Scope("task", "task_1", {"time_limit_s": 60, "time_s": 30.0}, first),
        Scope("task", "task_2", {"time_limit_s": 60, "time_s": None}, (Scope("object", "task_2/a", bolt),)),
    )
    return Scope("trial", "", {"duration_s": 100.0, "venue": "home", **trial}, tasks)


PLACED = [said("placed", "task_1/a", S), said("placed", "task_1/b", S), said("placed", "task_2/a", V)]


def test_objects_in_tasks_are_priced_by_their_kind_and_time() -> None:
    # By hand: task_1 20 + 10 and 5 for its time; task_2 nothing, for it was never finished.
    assert score(rules(TABLE), table(), *PLACED) == 35
    assert score(rules(TABLE), table(venue="away"), *PLACED) == 70


def test_a_competition_without_work_has_one_level() -> None:
    drive = rules(
        "monitors: {hit: {use: made.hit}}\nscore: 100 * 0.5 ** count(hit) - trial.duration_s / 10\n"
    )
    trial = Scope("trial", "", {"duration_s": 40.0})

    assert drive.sheet.levels == ("trial",)
    assert score(drive, trial, said("hit", "car/kerb", V), said("hit", "car/wall", V)) == 25 - 4


def test_five_levels_add_up_from_the_inside_out() -> None:
    deep = rules(
        "levels: [screw, plate, module, rack, trial]\nrules: {tight: {use: made.tight}}\n"
        "terms:\n  screw: {ok: points(tight)}\n  plate: {ok: all(screw.ok)}\n"
        "  module: {ok: sum(plate.ok), screws: count(screw)}\n  rack: {ok: max(module.ok)}\n"
        "score: 10 * sum(rack.ok) + sum(screw.ok) + count(plate)\n"
    )
    screws = {
        f"r/m{m}/p{p}": tuple(Scope("screw", f"r/m{m}/p{p}/s{s}") for s in range(2))
        for m in range(2)
        for p in range(2)
    }
    modules = tuple(
        Scope(
            "module",
            f"r/m{m}",
            {},
            tuple(Scope("plate", path, {}, screws[path]) for path in screws if f"m{m}" in path),
        )
        for m in range(2)
    )
    trial = Scope("trial", "", {"duration_s": 1.0}, (Scope("rack", "r", {}, modules),))
    loose = {"r/m0/p1/s0", "r/m1/p0/s0", "r/m1/p1/s1"}
    findings = [
        said("tight", one.path, V if one.path in loose else S) for plate in screws.values() for one in plate
    ]

    # One whole plate in m0, none in m1; five of eight screws; four plates.
    assert score(deep, trial, *findings) == 10 * 1 + 5 + 4


# Facts ---------------------------------------------------------------------------------


def value(formula: str, trial: Scope, facts: str = "{task: {time_s: number, kind: text}}") -> float:
    return score(rules(f"levels: [task, trial]\nfacts: {facts}\nscore: >-\n  {formula}\n"), trial)


def one_task(**facts: Fact) -> Scope:
    return Scope("trial", "", {"duration_s": 9.0}, (Scope("task", "t1", facts),))


def test_an_absent_fact_is_absent_one_with_a_value_is_not() -> None:
    assert value("sum(absent(task.time_s))", one_task(time_s=None)) == 1
    assert value("sum(absent(task.time_s))", one_task(time_s=0.0)) == 0
    assert value("sum(absent(task.kind))", one_task(kind=None)) == 1
    assert value("sum(absent(task.kind))", one_task(kind="")) == 0
    assert value("sum(7 if absent(task.time_s) else task.time_s)", one_task(time_s=None)) == 7
    assert value("sum(7 if absent(task.time_s) else task.time_s)", one_task(time_s=3.0)) == 3


@pytest.mark.parametrize(
    "formula", ["sum(task.time_s)", 'sum(task.kind == "bolt")', "sum(absent(task.time_s))"]
)
def test_an_unknown_fact_stays_unknown(formula: str) -> None:
    rule_set = rules(
        f"levels: [task, trial]\nfacts: {{task: {{time_s: number, kind: text}}}}\nscore: '{formula}'\n"
    )

    with pytest.raises(UnknownFactError, match=r"nothing says the (time_s|kind) of t1"):
        rule_set.sheet.evaluate(one_task(), {})
    priced = price({}, one_task(), rule_set.sheet, {}, digits=6)
    assert (priced.status, priced.ledger) == ("incomplete", None)


@pytest.mark.parametrize(
    ("formula", "name"), [("sum(task.time_s)", "task.time_s"), ('sum(task.kind != "bolt")', "task.kind")]
)
def test_an_absent_fact_is_no_number_and_no_text(formula: str, name: str) -> None:
    with pytest.raises(FormulaError, match=f"{name} of t1 is known to be absent") as refused:
        value(formula, one_task(time_s=None, kind=None))
    assert refused.value.hint == f"say what counts then: … if not absent({name}) else …"


def test_texts_are_equal_letter_by_letter_spaces_included() -> None:
    spaced = one_task(kind="M8  bolt")
    assert value('sum(task.kind == "M8  bolt")', spaced) == 1
    assert value('sum(task.kind == "M8 bolt")', spaced) == 0
    assert value('sum(task.kind != "m8  bolt")', spaced) == 1
    assert value("sum('M8  bolt' == task.kind)", spaced) == 1


def test_the_trace_says_what_a_text_was() -> None:
    sheet = rules(
        'levels: [task, trial]\nfacts: {task: {kind: text}}\nscore: sum(task.kind == "nut")\n'
    ).sheet
    (each,) = sheet.evaluate(one_task(kind="bolt"), {}).children[0].children

    assert each.children[0].label == "task.kind == 'nut' (task.kind is 'bolt')"
    assert each.value == 0


@pytest.mark.parametrize(
    ("formula", "cause"),
    [
        ("sum(task.kind)", "task.kind is a text, no number"),
        ("sum(task.kind + 1)", "task.kind is a text, no number"),
        ('sum(task.kind < "b")', "is not allowed|a text as a number is not allowed"),
        ("sum(task.kind == 1)", "task.kind is a text, no number"),
        ("sum(task.time_s == task.kind)", "task.kind is a text, no number"),
        ('sum(task.time_s == "late")', "'late' is a text, no number"),
        ('"a" == "a"', "'a' is a text, no number"),
        ('"a"', "a text as a number is not allowed"),
        ("sum(1 if task.kind else 0)", "task.kind is a text, no number"),
        ('max("a", 1)', "a text as a number is not allowed"),
        ("absent(task)", "absent"),
        ("absent(1)", "absent"),
        ("absent(task.time_s, task.kind)", "absent"),
        ("sum(absent(task.tiem_s))", "task.tiem_s"),
        ("absent(task.time_s)", "needs an aggregate"),
    ],
)
def test_texts_and_absence_out_of_place_are_refused(formula: str, cause: str) -> None:
    with pytest.raises(FormulaError, match=cause) as refused:
        value(formula, one_task(time_s=1.0, kind="bolt"))
    assert refused.value.hint
    assert "$.score" in refused.value.place


@pytest.mark.parametrize(
    ("facts", "cause"),
    [({"time_s": "soon"}, "task.time_s of t1 is 'soon', but declared as a number"),
     ({"kind": 4, "time_s": 1}, "task.kind of t1 is 4, but declared as a text")],
)  # fmt: skip
def test_a_fact_of_another_type_than_declared_is_refused(facts: Mapping[str, Fact], cause: str) -> None:
    formula = 'sum(task.time_s) + sum(task.kind == "bolt")'
    with pytest.raises(FormulaError, match=re.escape(cause)):
        value(formula, one_task(**facts))


def test_a_fact_that_is_not_declared_changes_no_formula() -> None:
    rule_set = rules("levels: [task, trial]\nterms: {task: {worth: '3'}}\nscore: sum(task.worth)\n")

    assert score(rule_set, one_task(worth=99)) == 3


def test_a_fact_is_named_with_its_level() -> None:
    with pytest.raises(FormulaError, match="unknown name 'duration_s'") as refused:
        rules("score: duration_s\n")
    assert refused.value.hint == "it is a fact, which is named with its level: trial.duration_s"


# ARIAC's levels are words --------------------------------------------------------------

RENAMED = {"part": "screw", "submission": "plate", "order": "rack"}


def renamed(text: str) -> str:
    """A rule set with ARIAC's levels under other names."""
    for old, new in RENAMED.items():
        text = re.sub(rf"\b{old}(?=\.|:)", new, text)
        text = re.sub(rf"\bcount\({old}\)", f"count({new})", text)
        text = re.sub(rf"(?m)^- {old}$", f"- {new}", text)
        text = re.sub(rf"\bof: {old}\b", f"of: {new}", text)
    return text


def ordered(random: Random, names: Mapping[str, str]) -> tuple[Scope, list[Finding]]:
    """Random orders with random findings about each part and task."""
    orders, findings = [], []
    for i in range(random.randint(1, 3)):
        tasks = []
        for k in range(random.randint(1, 2)):
            path = f"o{i}/t{k}"
            slots = [f"{path}/p{n}" for n in range(random.randint(1, 3))]
            for check in ("none_missing", "none_unwanted", "none_faulty", "right_agv"):
                findings.append(said(check, path, random.choice((S, V))))
            for check in ("part_type", "part_color", "part_pose"):
                findings += [said(check, slot, random.choice((S, S, V))) for slot in slots]
            parts = tuple(Scope(names.get("part", "part"), slot) for slot in slots)
            tasks.append(Scope(names.get("submission", "submission"), path, {"parts": len(slots)}, parts))
        findings.append(said("only_kitting", f"o{i}", S))
        facts: dict[str, Fact] = {"index": i, "priority": 1, "parts": 2}
        orders.append(Scope(names.get("order", "order"), f"o{i}", facts, tuple(tasks)))
    findings += [
        said("no_arm_collision", "trial", S),
        said("human_contact", "r/h", S),
        said("separation", "r/h", S),
    ]
    return Scope("trial", "", {"duration_s": 60.0, "orders": len(orders)}, tuple(orders)), findings


@pytest.mark.parametrize("seed", range(12))
def test_an_ariac_rule_set_with_renamed_levels_gives_the_same_score(seed: int) -> None:
    ours = load_rule_set("paper2020.published")
    other = rule_set_from_text(renamed(ours.text), file="renamed")
    assert other.sheet.levels == ("screw", "plate", "rack", "trial")
    trial, findings = ordered(Random(seed), {})  # noqa: S311
    same, _ = ordered(Random(seed), RENAMED)  # noqa: S311

    assert score(ours, trial, *findings) == score(other, same, *findings)


# Ramps ---------------------------------------------------------------------------------

RAMPS = [
    # best, worst, hi, lo, x, value: from the rulebook of the AI for Industry Challenge, by hand
    ((12, 0, 60, 5, 5), 12),
    ((12, 0, 60, 5, 4.9), 12),
    ((12, 0, 60, 5, 60), 0),
    ((12, 0, 60, 5, 61), 0),
    ((12, 0, 60, 5, 32.5), 6),
    ((50, 38, 0.04, 0, 0.04), 38),
    ((50, 38, 0.04, 0, -0.01), 50),
    ((50, 38, 0.04, 0, 0.01), 47),
    ((6, 0, 2, 2, 2), 0),  # hi = lo: the worst end is tested first
    ((6, 0, 2, 2, 1.999), 6),
    ((6, 0, 1, 3, 2), 0),  # hi < lo: so is it here
    ((6, 0, 1, 3, 0.5), 6),
]


@pytest.mark.parametrize(("arguments", "expected"), RAMPS)
def test_a_ramp_gives_what_the_rulebook_says(arguments: tuple[float, ...], expected: float) -> None:
    names = ("best", "worst", "hi", "lo", "x")
    declared = ", ".join(f"{name}: number" for name in names)
    formula = f"ramp({', '.join(f'trial.{name}' for name in names)})"
    facts = {"duration_s": 1.0, **dict(zip(names, map(float, arguments), strict=True))}

    found = score(rules(f"facts: {{trial: {{{declared}}}}}\nscore: {formula}\n"), Scope("trial", "", facts))

    assert found == pytest.approx(expected)


@pytest.mark.parametrize(("value", "expected"), [(19.99, 19), (20.0, 20), (0.0, 0), (-0.5, -1)])
def test_floor_is_the_greatest_whole_number_not_above(value: float, expected: int) -> None:
    text = "facts: {trial: {x: number}}\nscore: floor(trial.x)\n"

    assert score(rules(text), Scope("trial", "", {"duration_s": 1.0, "x": value})) == expected
    assert Expression.parse("floor(x)").columns({"x": np.array([value])}).tolist() == [expected]


def test_a_ramp_over_columns_is_that_of_each_row() -> None:
    names = ("best", "worst", "hi", "lo", "x")
    columns = {name: np.array([float(row[0][i]) for row in RAMPS]) for i, name in enumerate(names)}

    found = Expression.parse("ramp(best, worst, hi, lo, x)").columns(columns)

    assert found == pytest.approx(np.array([float(expected) for _, expected in RAMPS]))


@pytest.mark.parametrize(
    "stated",
    [
        "score: ramp(12, 0, 5, 60, trial.duration_s)\n",
        "score: ramp(12, 0, low, 60, trial.duration_s)\nparameters: {low: 59.999}\n",
        "score: ramp(12, 0, -(2 * low), 0, trial.duration_s)\nparameters: {low: 1}\n",
    ],
)
def test_a_ramp_whose_ends_are_known_to_stand_in_the_wrong_order_is_refused(stated: str) -> None:
    with pytest.raises(FormulaError, match="which is below lo"):
        rules(stated)


def test_a_ramp_may_be_a_step_and_may_have_ends_that_only_a_trial_knows() -> None:
    trial = Scope("trial", "", {"duration_s": 60.0})

    assert score(rules("score: ramp(12, 0, low, 60, trial.duration_s)\nparameters: {low: 60}\n"), trial) == 0
    assert score(rules("score: ramp(12, 0, trial.duration_s, 61, 5)\n"), trial) == 12


def test_a_ramp_takes_five_numbers() -> None:
    with pytest.raises(FormulaError, match="'ramp' takes 5 numbers"):
        rules("score: ramp(1, 0, 2, 1)\n")


AIC = Path(__file__).parents[3] / "shared/aic/cases.json.gz"
DURATION = """
facts: {trial: {started_s: number, ended_s: number, tier_3: number}}
score: >-
  0 if absent(trial.ended_s) or absent(trial.started_s) or trial.tier_3 <= 0
  else ramp(12, 0, 60, 5, trial.ended_s - trial.started_s)
"""


@pytest.mark.slow
@pytest.mark.skipif(not AIC.is_file(), reason="the official cases of AIC are not here")
def test_the_duration_of_aic_is_priced_as_its_own_scorer_does(subtests: pytest.Subtests) -> None:
    with gzip.open(AIC, "rt", encoding="utf-8") as file:
        cases = [case for case in json.load(file)["cases"] if case["profile"] == "main"]
    rule_set, compared = rules(DURATION), 0
    for case in cases:
        official = case["expected"]["tier_2"].get("categories")
        if official is None:
            continue
        task = case["task"]
        facts = {f"{name}ed_s": task.get(f"{name}_ns") for name in ("start", "end")}
        facts = {name: None if ns is None else ns / 1e9 for name, ns in facts.items()}
        trial = Scope(
            "trial", "", {"duration_s": 0.0, **facts, "tier_3": case["expected"]["tier_3"]["score"]}
        )
        with subtests.test(case["id"]):
            ours = rule_set.sheet.evaluate(trial, {}).value
            assert ours == pytest.approx(official["duration"]["score"], abs=1e-9)
        compared += 1
    assert compared > 50
