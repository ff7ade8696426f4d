"""What one event that nobody would miss in a log is worth, where no recorder attests that it is complete."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import pytest

from ariac_score import Result, score_trial
from ariac_score.report.text import score_text
from ariac_score.review.left_out import LeftOut, scores_with_an_event
from ariac_score.testing import SNAPSHOT_SIGNALS, write_bag, write_trial_log
from ariac_score.trial.statements import RECORDER, Statement
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("log")
    return write_trial_log(folder / "trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)


@pytest.fixture(scope="module")
def of_the_paper(log: Path) -> Result:
    return score_trial(log, "paper2020.published")


def test_an_arm_collision_takes_every_point_of_2020(of_the_paper: Result) -> None:
    # The rulebook of 2020: a collision between the arms makes the score of the trial 0.
    assert scores_with_an_event(of_the_paper) == (LeftOut("no_arm_collision", Decimal(0)),)


def test_the_text_says_so_beside_what_is_not_attested(of_the_paper: Result) -> None:
    assert "were an event left out of the log, the score would have been 0 with one of no_arm_collision" in (
        score_text(of_the_paper)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", True),
        ("between_samples: bounded\n", False),
        ("log_map: ./rated.yaml\n", False),
    ],
)
def test_samples_of_what_nobody_states_the_rate_of_would_show_nowhere(
    tmp_path: Path, more: str, said: bool
) -> None:
    (tmp_path / "rated.yaml").write_text(
        "extends: ariac2020\nid: rated\ntitle: Rated\nsource: its nodes\nframes:\n"
        "- {match: torso_base, kind: robot, body: robot, rate_hz: 100}\n"
        "- {match: human_base, kind: human, body: human, rate_hz: 100}\n",
        encoding="utf-8",
    )
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        f"extends: paper2020.published\nid: ours\ntitle: Ours\nsource: here\n{more}", encoding="utf-8"
    )
    log = write_bag(
        tmp_path / "log.mcap", recorded_messages(kitting_trial(), motion="frames"), storage="mcap"
    )

    text = score_text(score_trial(log, rules))

    assert ("nobody states the rate of tf frames: samples left out evenly would show nowhere" in text) is said


def test_a_price_for_each_event_is_taken_off_once(log: Path, tmp_path: Path) -> None:
    # 28 points of the task less 5 for each collision, of which the log shows none.
    result = score_trial(log, _rules(tmp_path, "sum(order.total) - 5 * count(no_arm_collision)"))

    assert scores_with_an_event(result) == (LeftOut("no_arm_collision", Decimal(23)),)


def test_what_costs_nothing_is_not_told(log: Path, tmp_path: Path) -> None:
    result = score_trial(log, _rules(tmp_path, "sum(order.total) + 0 * count(no_arm_collision)"))

    assert scores_with_an_event(result) == ()


def test_an_attested_log_needs_no_such_word(of_the_paper: Result) -> None:
    others = tuple(one for one in of_the_paper.measured.statements if one.fact != "completeness")
    attested = Statement("completeness", RECORDER, ("trial.jsonl",))
    measured = replace(of_the_paper.measured, statements=(*others, attested))

    assert scores_with_an_event(replace(of_the_paper, measured=measured)) == ()


def test_a_withheld_score_has_nothing_to_compare_with(tmp_path: Path) -> None:
    no_human = write_trial_log(tmp_path / "a.jsonl", kitting_trial(human=False), signals=("speed/robot",))
    rules = tmp_path / "strict.yaml"
    rules.write_text(
        "{id: s, title: s, source: s, extends: paper2020.published, log_map: ariac2020, open: withhold}",
        encoding="utf-8",
    )

    assert scores_with_an_event(score_trial(no_human, rules)) == ()


def _rules(folder: Path, task: str) -> Path:
    file = folder / "ours.yaml"
    file.write_text(
        f"""
id: ours
title: Ours
source: this test
extends: paper2020.published
terms: {{trial: {{task: {task}}}}}
score: task
""",
        encoding="utf-8",
    )
    return file
