"""The verdicts of an earlier run against ours."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ariac_score import load_rule_set
from ariac_score.checks.registry import Registry
from ariac_score.cli import main
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.oracle.judges import RulesBench
from ariac_score.oracle.replay import replay

PAPER = RulesBench(load_rule_set("paper2020.published"), Registry())


def snapshot(time: float, distance_m: float) -> dict[str, Any]:
    fields = {"human_operator_speed": 0.0, "robot_speed": 0.0, "distance_robot_human_operator": distance_m}
    return {"topic": "snapshot", **fields, "time": time}


def log_of(path: Path, *found: Any) -> Path:
    path.write_text("".join(json.dumps(one) + "\n" for one in found), encoding="utf-8")
    return path


# At rest d_min is 2.6 m, and equal distance satisfies.
@pytest.mark.parametrize(
    ("distance_m", "theirs", "counts"),
    [
        (2.6, "currently_true", (1, 0, 0)),
        (2.5, "currently_false", (1, 0, 0)),
        (2.5, False, (1, 0, 0)),
        (2.6, True, (1, 0, 0)),
        (2.5, "violated", (1, 0, 0)),
        (2.5, "currently_true", (0, 0, 1)),
        (2.6, "False", (0, 0, 1)),
        (2.5, "unknown", (0, 1, 0)),
        (-1.0, "currently_true", (0, 1, 0)),
    ],
)
def test_each_verdict_agrees_differs_or_cannot_be_compared(
    tmp_path: Path, distance_m: float, theirs: object, counts: tuple[int, int, int]
) -> None:
    event = snapshot(1.0, distance_m)
    for number, row in enumerate(
        (
            {**event, "verdict": theirs},
            {"event": event, "verdict": theirs},
            {
                "status": "event",
                "monitor": "m",
                "interface": "/snapshot",
                "event": event,
                "verdict_raw": theirs,
            },
        )
    ):
        found = replay(log_of(tmp_path / f"{number}.jsonl", row), PAPER)
        assert (found.agreeing, found.undecided, len(found.differences)) == counts


def test_the_command_names_what_differs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = log_of(
        tmp_path / "log.jsonl",
        {**snapshot(1.0, 9.0), "verdict": "currently_true"},
        {**snapshot(1.01, 2.5), "verdict": "currently_true"},
        snapshot(1.02, 2.5),
    )

    assert main(["audit", str(log), "--rules", "paper2020.published"]) == 1

    assert capsys.readouterr().out.splitlines() == [
        "1 verdicts agree, 1 differ, 0 cannot be compared, 1 events have none",
        "  line 2, /snapshot: recorded currently_true, ours currently_false "
        "(separation: robot/human: 0.100 m nearer than the required 2.600 m)",
    ]


def test_agreement_is_a_success(tmp_path: Path) -> None:
    log = log_of(tmp_path / "log.jsonl", {**snapshot(1.0, 9.0), "verdict": "currently_true"})

    assert main(["audit", str(log), "--rules", "paper2020.published"]) == 0


@pytest.mark.parametrize("arguments", [[], ["--rules", "paper2020.published", "--output-format", "json"]])
def test_what_it_cannot_do_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str]
) -> None:
    log = log_of(tmp_path / "log.jsonl", {**snapshot(1.0, 9.0), "verdict": "currently_true"})

    assert main(["audit", str(log), *arguments]) == 4
    assert "--rules" in capsys.readouterr().err


def test_a_log_without_verdicts_and_a_damaged_one_are_refused(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="no verdict"):
        replay(log_of(tmp_path / "a.jsonl", snapshot(1.0, 9.0)), PAPER)
    damaged = tmp_path / "b.jsonl"
    damaged.write_text(json.dumps(snapshot(1.0, 9.0))[:-5])
    with pytest.raises(LogError, match="cut off"):
        replay(damaged, PAPER)
