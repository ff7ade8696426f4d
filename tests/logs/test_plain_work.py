"""Work, facts and numbers of any competition, as a JSON-lines log records them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ariac_score import Event, EventNumber, Item, LogError, LogMap, Submission, Trial, Wanted
from ariac_score.logs.jsonl import JsonLinesReader
from ariac_score.testing import made_trial, write_trial_log
from ariac_score.trial.build import merge_trials

FACTS = {"scene": "a", "end_s": None}
HEAD = {
    "record": "trial",
    "format": "ariac-score-trial-log/1",
    "id": "run",
    "facts": {"scene": "a", "end_s": None},
}
BOLT = {"id": "bolt_1", "level": "object", "facts": {"kind": "bolt", "found_s": None}}
TASK = {"record": "item", "t_s": 1.0, "id": "task_1", "level": "task", "items": [BOLT]}
TOUCH = {"record": "event", "t_s": 4.0, "kind": "contact", "numbers": {"force": {"value": 81.5, "unit": "N"}}}
DONE = {"record": "handed_in", "t_s": 9.0, "item_id": "bolt_1"}


def read(folder: Path, *records: dict[str, Any]) -> Trial:
    lines = [HEAD, *records, {"record": "end", "records": len(records) + 2}]
    path = folder / "run.jsonl"
    path.write_text("".join(f"{json.dumps(line)}\n" for line in lines), encoding="utf-8")
    return JsonLinesReader().read(path, Wanted(LogMap("none")))


def test_items_facts_submissions_and_numbers_are_read_as_written(tmp_path: Path) -> None:
    trial = read(tmp_path, TASK, TOUCH, DONE)

    bolt = Item("bolt_1", "object", {"kind": "bolt", "found_s": None})
    assert trial.work == (Item("task_1", "task", {}, (bolt,), 1.0),)
    assert dict(trial.facts) == {"scene": "a", "end_s": None}
    assert trial.submissions == (Submission("bolt_1", 9.0),)
    assert Event(4.0, "contact", numbers=(EventNumber("force", 81.5, "N"),)) in trial.events


def test_a_number_is_given_in_its_unit_alone(tmp_path: Path) -> None:
    (touch,) = read(tmp_path, TOUCH).events

    assert touch.number("force", unit="N") == 81.5
    assert touch.number("torque", unit="N m") is None
    with pytest.raises(LogError, match="'force' of event 'contact' is in 'N', the check asks for 'kN'"):
        touch.number("force", unit="kN")


@pytest.mark.parametrize(
    ("record", "cause"),
    [
        ({**TASK, "colour": "red"}, "unknown key 'colour'"),
        ({**TASK, "level": "Task"}, "does not match"),
        ({**TASK, "items": [BOLT, BOLT]}, "task 'task_1' holds two items named 'bolt_1'"),
        ({**TASK, "facts": {"x": float("nan")}}, "facts of 'task_1' must be finite"),
        ({**TOUCH, "numbers": {"force": {"value": float("inf"), "unit": "N"}}}, "'force' of event 'contact'"),
        ({**TOUCH, "numbers": {"force": {"value": 1.0}}}, "key 'unit' is missing"),
        ({"record": "teapot", "t_s": 1.0}, "record 'teapot' is unknown"),
    ],
)
def test_what_cannot_be_is_refused_with_its_cause(tmp_path: Path, record: dict[str, Any], cause: str) -> None:
    with pytest.raises(LogError, match=cause):
        read(tmp_path, record)


def test_the_made_trial_comes_back_as_it_was_written(tmp_path: Path) -> None:
    made = made_trial()
    back = JsonLinesReader().read(
        write_trial_log(tmp_path / "made.jsonl", made, signals=()), Wanted(LogMap("x"))
    )

    assert (back.work, back.submissions, dict(back.facts)) == (made.work, made.submissions, dict(made.facts))


def test_of_logs_without_a_competition_one_says_what_was_to_be_done() -> None:
    one, same = (Trial(name, work=(Item("task_1", "task"),)) for name in "ab")
    other = Trial("c", work=(Item("task_2", "task"),))

    assert merge_trials("t", [one, same], file="t").work == one.work
    with pytest.raises(
        LogError, match="'a' says there is task 'task_1', 'c' says there is no task of that name"
    ):
        merge_trials("t", [one, other], file="t")


def test_a_submission_of_nothing_that_was_asked_for_is_counted() -> None:
    asked = Trial("a", work=(Item("task_1", "task", items=(Item("bolt_1", "object"),)),))
    brought = Trial("b", submissions=(Submission("bolt_1", 1.0), Submission("nut_1", 2.0)))
    defects = {d.kind: d.count for d in merge_trials("t", [asked, brought], file="t").log_defects}

    assert defects["unknown_item"] == 1
