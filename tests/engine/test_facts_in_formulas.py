"""Facts of a trial, from the file that states them to the score, with what is known to be absent."""

from __future__ import annotations

import json
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from ariac_score import score_trial
from ariac_score.errors import LogError, OtherFactError
from ariac_score.results.result import Result
from ariac_score.testing.bags import Recorded, write_bag

RULES = """\
id: insertion
title: Insertion
source: this test
log_map: log_map.yaml
levels: [trial]
facts:
  trial: {time_limit_s: number, taken_s: number, connector: text}
terms:
  trial:
    quick: 0 if absent(trial.taken_s) else 12 * (1 - trial.taken_s / trial.time_limit_s)
    kind: 2 if trial.connector == "sfp" else 1
score: 10 + quick * kind
"""
LOG_MAP = "id: insertion\ntitle: Insertion\nsource: this test\n"


def scored(folder: Path, facts: dict[str, Any], log_map: str = LOG_MAP) -> Result:
    (folder / "rules.yaml").write_text(RULES, encoding="utf-8")
    (folder / "log_map.yaml").write_text(log_map, encoding="utf-8")
    head = {"record": "trial", "format": "ariac-score-trial-log/1", "id": "run", "facts": facts}
    records = [head, {"record": "event", "t_s": 1.0, "kind": "competition_started"}]
    records.append({"record": "end", "records": 3})
    log = folder / "run.jsonl"
    log.write_text("".join(f"{json.dumps(one)}\n" for one in records), encoding="utf-8")
    return score_trial(log, folder / "rules.yaml")


@pytest.mark.parametrize(
    ("taken_s", "connector", "score"),
    [
        # 12 points, less the share of the time limit that was taken; 45 s of 180 s leave 9.
        (45, "sfp", "28"),  # 10 + 9 * 2
        (45, "sc", "19"),  # 10 + 9 * 1
        (180, "sfp", "10"),
        # Known to be absent: the task was never completed, which is worth nothing and is no doubt either.
        (None, "sfp", "10"),
    ],
)
def test_the_facts_of_a_json_lines_log_reach_the_score(
    tmp_path: Path, taken_s: float | None, connector: str, score: str
) -> None:
    result = scored(tmp_path, {"time_limit_s": 180, "taken_s": taken_s, "connector": connector})

    assert result.status == "scored"
    assert result.score == Decimal(score)


def test_a_fact_that_nobody_states_is_no_absent_one(tmp_path: Path) -> None:
    result = scored(tmp_path, {"time_limit_s": 180, "connector": "sfp"})

    assert (result.status, result.score) == ("incomplete", None)
    assert result.missing == "nothing says the taken_s of the trial"


def test_facts_of_the_log_map_reach_the_score_as_those_of_the_log_do(tmp_path: Path) -> None:
    stated = f"{LOG_MAP}facts: {{time_limit_s: 180, taken_s: null}}\n"

    assert scored(tmp_path, {"connector": "sfp"}, stated).score == Decimal(10)
    assert scored(tmp_path, {"connector": "sfp"}, stated.replace("null", "45")).score == Decimal(28)


def test_facts_that_messages_state_reach_the_score(tmp_path: Path) -> None:
    (tmp_path / "rules.yaml").write_text(RULES, encoding="utf-8")
    channels = (
        "channels:\n"
        "  - {topic: /taken, facts: {taken_s: data}}\n"
        "  - {topic: /plug, facts: {connector: data}}\n"
    )
    (tmp_path / "log_map.yaml").write_text(f"{LOG_MAP}facts: {{time_limit_s: 180}}\n{channels}")
    messages = [
        Recorded("/plug", "std_msgs/msg/String", 10**9, {"data": "sfp"}),
        Recorded("/taken", "std_msgs/msg/Float64", 2 * 10**9, {"data": 45.0}),
    ]
    bag = write_bag(tmp_path / "run.mcap", messages, storage="mcap")

    assert score_trial(bag, tmp_path / "rules.yaml").score == Decimal(28)


def test_a_fact_that_is_no_number_is_a_fault_of_the_log_that_states_it(tmp_path: Path) -> None:
    with pytest.raises(OtherFactError) as refused:
        scored(tmp_path, {"time_limit_s": "long", "taken_s": 45, "connector": "sfp"})

    error = refused.value
    assert str(error) == (
        f"{tmp_path / 'run.jsonl'}: trial.time_limit_s of the trial is 'long', but declared as a number"
    )
    assert error.exit_code == 6
    assert "correct the log" in error.hint


def test_work_of_a_level_that_is_not_declared_is_a_fault_of_the_log(tmp_path: Path) -> None:
    scored(tmp_path, {"time_limit_s": 180, "taken_s": 45, "connector": "sfp"})
    rules, log = tmp_path / "rules.yaml", tmp_path / "run.jsonl"
    rules.write_text(RULES.replace("[trial]", "[bin, trial]"), encoding="utf-8")
    head, event, _ = log.read_text(encoding="utf-8").splitlines()
    item = json.dumps({"record": "item", "t_s": 0, "id": "a", "level": "box", "facts": {}, "items": []})
    end = json.dumps({"record": "end", "records": 4})
    log.write_text(f"{head}\n{event}\n{item}\n{end}\n", encoding="utf-8")

    with pytest.raises(LogError) as refused:
        score_trial(log, rules)

    assert str(refused.value) == f"{log}: the trial has 'a' of level 'box', which is not declared"
    assert refused.value.exit_code == 6
    assert f"'levels:' of {rules}" in refused.value.hint
