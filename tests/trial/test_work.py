from __future__ import annotations

import math

import pytest

from ariac_score import Body, Event, Fact, Finding, Item, Trial, Verdict, WorkItem, number_of_fact
from ariac_score.checks.registry import Plugin
from ariac_score.engine.ask import ask
from ariac_score.trial.shift import shifted
from ariac_score.trial.work import announced_s, items_at
from ariac_score_ariac.work import Order, Task, WantedProduct

HOLES = (
    Item("hole_1", "object", {"kind": "bolt"}),
    Item("hole_2", "object", {"kind": "nut", "time_s": None}),
)
RUN = Item("run_1", "task", {"time_limit_s": 60.0}, HOLES, announced_s=2.0)


def test_a_plain_item_is_a_work_item() -> None:
    assert isinstance(RUN, WorkItem)
    assert not isinstance(Body("robot", "robot"), WorkItem)


@pytest.mark.parametrize("name", ["", "a/b", "/"])
def test_an_item_whose_name_would_break_a_path_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="a name without a slash"):
        Item(name, "task")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_fact_that_is_no_number_is_refused_by_name(value: float) -> None:
    with pytest.raises(ValueError, match="facts of 'run_1' must be finite, but time_s is"):
        Item("run_1", "task", {"time_s": value})
    with pytest.raises(ValueError, match="facts of 't' must be finite, but time_s is"):
        Trial("t", facts={"time_s": value})


def test_facts_cannot_be_changed() -> None:
    facts: dict[str, Fact] = {"kind": "bolt"}
    item = Item("hole", "object", facts)
    facts["kind"] = "nut"
    assert item.facts["kind"] == "bolt"
    with pytest.raises(TypeError):
        item.facts["kind"] = "nut"  # type: ignore[index]


def test_absent_unknown_and_text_are_no_numbers_but_three_different_facts() -> None:
    facts: dict[str, Fact] = {"time_s": None, "kind": "7", "tries": 2}
    assert [number_of_fact(facts, name) for name in ("time_s", "kind", "tries", "unknown")] == [
        None,
        None,
        2,
        None,
    ]
    assert "time_s" in facts
    assert "unknown" not in facts


def test_items_of_a_level_are_found_at_any_depth_in_order() -> None:
    other = Item("run_2", "task", items=(Item("group", "set", items=(Item("hole_9", "object"),)),))
    assert [item.id for item in items_at((RUN, other), "object")] == ["hole_1", "hole_2", "hole_9"]
    assert [item.id for item in items_at((RUN, other), "")] == ["run_1", "run_2"]
    assert not list(items_at((RUN, other), "order"))


def test_on_another_clock_the_times_of_work_move_and_unknown_ones_stay_unknown() -> None:
    trial = Trial("t", work=(RUN, HOLES[0]), events=(Event(3.0, "start"),))
    assert [announced_s(item) for item in shifted(trial, 10.0).work] == [12.0, None]
    assert shifted(trial, 10.0).work[0].items == RUN.items


def test_an_order_shows_its_tasks_and_parts_as_work() -> None:
    order = Order("order_0", (Task("kit_1", products=(WantedProduct("part_0", "gear_red"),)),), priority=3)
    assert isinstance(order, WorkItem)
    assert [(item.level, item.id) for item in items_at((order,), "submission")] == [("submission", "kit_1")]
    assert [(item.level, item.id) for item in items_at((order,), "part")] == [("part", "part_0")]
    assert dict(order.facts) == {"parts": 1, "priority": 3}


def test_a_priority_that_nobody_says_is_no_fact() -> None:
    assert "priority" not in Order("order_0", priority_said=False).facts


class Bolted:
    level = "object"

    def judge(self, _trial: Trial, item: WorkItem) -> list[Finding]:
        return [Finding.satisfied(item.id, f"a {item.facts['kind']}")]


def test_a_rule_is_asked_about_each_item_of_the_level_it_names() -> None:
    plugin = Plugin("guest.bolted", "ariac_score.rules", "guest:Bolted", "guest", "1.0")
    found = ask(plugin, "bolted", Bolted(), Trial("t", work=(RUN,)))
    assert [f.subject for f in found] == ["run_1/hole_1", "run_1/hole_2"]
    (idle,) = ask(plugin, "bolted", Bolted(), Trial("t", work=(Item("alone", "task"),)))
    assert idle.verdict is Verdict.NOT_APPLICABLE


def test_pairs_of_any_declared_kinds_are_given_once_each() -> None:
    bodies = (Body("v2", "vehicle"), Body("v1", "vehicle"), Body("p", "pedestrian"), Body("h", "human"))
    trial = Trial("t", bodies=bodies)
    assert [(a.id, b.id) for a, b in trial.pairs("vehicle", "pedestrian")] == [("v1", "p"), ("v2", "p")]
    assert [(a.id, b.id) for a, b in trial.pairs("vehicle", "vehicle")] == [("v1", "v2")]
    assert not list(trial.pairs())
    assert ("v1", "h") in [(a.id, b.id) for a, b in trial.body_pairs()]
