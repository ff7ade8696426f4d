"""Work items of any competition through the engine: levels, facts, and quantities nobody measures."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.errors import LogError, RuleSetError
from ariac_score.scoring.pricing import price
from ariac_score.scoring.ruleset import draft_rule_set
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import Span
from ariac_score.trial.work import Item

HEAD = "id: cup\ntitle: Cup\nsource: a test\nlog_map: ariac2020\n"
LEVELS = """\
levels: [object, task, trial]
facts:
  object: {kind: text, points: number}
  task: {time_s: number, index: number}
  trial: {venue: text, judges: number}
terms:
  object: {worth: object.points * (2 if object.kind == "bolt" else 1)}
  task: {worth: sum(object.worth) + (0 if absent(task.time_s) else 10 / task.time_s) + 100 * task.index}
score: sum(task.worth) + trial.judges * (trial.venue == "home") + count(object)
"""


def prepared(text: str) -> Prepared:
    return prepare(draft_rule_set(HEAD + text, file="cup.yaml"))


def trial(*work: Item, **facts: int | float | str | None) -> Trial:
    return Trial("run", work, events=ENDS, recorded=Span(0.0, 8.0), facts=facts)


ENDS = (Event(0.0, COMPETITION_STARTED), Event(8.0, COMPETITION_ENDED))
BOLT, NUT = (
    Item("a", "object", {"kind": "bolt", "points": 3}),
    Item("b", "object", {"kind": "nut", "points": 5}),
)


def test_tasks_and_objects_of_a_trial_are_priced_by_their_facts() -> None:
    rules = prepared(LEVELS)
    tasks = Item("one", "task", {"time_s": 5.0}, (BOLT, NUT)), Item("two", "task", {"time_s": None}, (BOLT,))

    measured = measure_trial(trial(*tasks, venue="home", judges=7, weather="wet"), rules)
    priced = price(measured.findings, measured.scopes, rules.rule_set.sheet, {}, digits=3)

    assert [scope.path for scope in measured.scopes.each("object")] == ["one/a", "one/b", "two/a"]
    assert measured.scopes.facts["duration_s"] == 8.0
    assert "weather" not in measured.scopes.facts  # no formula may name it
    # one: 6 + 5 + 10 / 5; two: 6, never finished, announced second: 100; judges 7; three objects
    assert priced.ledger is not None
    assert float(priced.ledger.amount) == 13 + 106 + 7 + 3


@pytest.mark.parametrize(
    ("item", "cause"),
    [
        (Item("one", "tsak"), "the trial has 'one' of level 'tsak', which is not declared"),
        (
            Item("one", "task", items=(Item("x", "screw"),)),
            "has 'one/x' of level 'screw', which is not declared",
        ),
        (
            Item("a", "object", items=(Item("one", "task"),)),
            "'a/one' of level 'task' lies inside one of level 'object'",
        ),
        (
            Item("one", "task", items=(Item("two", "task"),)),
            "'one/two' of level 'task' lies inside one of level 'task'",
        ),
        (Item("one", "trial"), "'one' of level 'trial' lies inside one of level 'trial'"),
    ],
)
def test_work_that_no_formula_could_reach_is_refused(item: Item, cause: str) -> None:
    with pytest.raises(LogError) as refused:
        measure_trial(trial(item), prepared(LEVELS))

    assert cause in refused.value.cause
    assert "'levels:' of cup.yaml" in refused.value.hint
    assert "from the inside out, as declared: object, task, trial" in refused.value.hint


def test_rules_about_the_trial_alone_take_any_work() -> None:
    measured = measure_trial(trial(Item("one", "tsak")), prepared("score: trial.duration_s\n"))

    assert measured.scopes.facts["duration_s"] == 8.0


class Odd:
    """A work item of a stranger, which checks nothing."""

    id, level, items = "one", "task", ()

    def __init__(self, **facts: object) -> None:
        self.facts: Any = facts


@pytest.mark.parametrize("value", [math.nan, math.inf, [1], b"bolt"])
def test_a_fact_that_is_no_fact_is_refused_by_its_name(value: object) -> None:
    with pytest.raises(LogError, match=r"fact 'time_s' of 'one' is .*, which is no number, no text"):
        measure_trial(trial(Odd(time_s=value)), prepared(LEVELS))  # type: ignore[arg-type]


def test_true_and_false_are_1_and_0() -> None:
    (scope,) = measure_trial(trial(Odd(time_s=True)), prepared(LEVELS)).scopes.inner  # type: ignore[arg-type]

    assert repr(scope.facts["time_s"]) == "1"


# Quantities ----------------------------------------------------------------------------

MONITORS = """\
monitors:
  separation: {use: iso_ts_15066.ssm_separation}
  collision: {use: ariac.no_event, with: {kind: arm_collision}}
"""


@pytest.mark.parametrize(
    ("score", "cause", "hint"),
    [
        (
            "measure(separation, depht_max_m)",
            "'depht_max_m', which check 'separation' does not",
            "'depth_max_m'?",
        ),
        ("demerits(collision)", "'relative_depth_integral_s', which check 'collision' does not", "count()"),
    ],
)
def test_a_price_for_what_a_check_does_not_measure_is_refused_before_a_log_is_read(
    score: str, cause: str, hint: str
) -> None:
    with pytest.raises(RuleSetError) as refused:
        prepared(f"{MONITORS}score: {score}\n")

    assert cause in refused.value.cause
    assert hint in refused.value.hint
    assert refused.value.place == "$.score"


def test_a_price_for_what_a_check_measures_is_taken() -> None:
    assert prepared(f"{MONITORS}score: demerits(separation) + measure(separation, depth_max_m)\n").checks


def test_a_misspelt_quantity_is_not_one_that_the_log_lacks() -> None:
    slow = '{use: formula.always, with: {holds: v < 1, unit: m/s, signals: {v: "QUANTITY/{robot} [m/s]"}}}'
    text = f"monitors: {{slow: {slow}}}\nscore: holds(slow)\n"

    with pytest.raises(RuleSetError, match="check 'slow' asks for the quantity 'speeed', which is unknown"):
        measure_trial(trial(), prepared(text.replace("QUANTITY", "speeed")))
    (finding,) = measure_trial(trial(), prepared(text.replace("QUANTITY", "speed"))).findings.values()
    assert finding.verdict.value == "inconclusive"
