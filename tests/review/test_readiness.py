"""Can a log be scored? What a team asks before it submits."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ariac_score import load_rule_set
from ariac_score.cli import main
from ariac_score.review.missing_topics import MissingTopics, grouped
from ariac_score.review.readiness import Readiness, check_log
from ariac_score.testing import SNAPSHOT_SIGNALS, write_bag, write_trial_log
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/kitting_near_miss.mcap"


def ready(path: Path, rules: str = "paper2020.published") -> Readiness:
    return check_log(path, load_rule_set(rules))


@pytest.fixture
def without_humans(tmp_path: Path) -> Path:
    messages = [m for m in recorded_messages(kitting_trial()) if m.topic != "/snapshot"]
    return write_bag(tmp_path / "trial.mcap", messages, storage="mcap")


def test_the_example_can_be_scored() -> None:
    found = ready(EXAMPLE)

    assert found.ready
    assert found.lacks == ()
    assert set(found.decided) == set(load_rule_set("paper2020.published").checks)


def test_what_is_missing_is_named_with_the_topics_it_comes_from(without_humans: Path) -> None:
    found = ready(without_humans)

    assert not found.ready
    assert {lack.what for lack in found.lacks} == {"separation", "human_contact"}
    for lack in found.lacks:
        assert lack.effect == "opens"
    assert "without gaps longer than 0.05 s" in found.lacks[0].remedy
    (missing,) = found.missing  # both need the same, and a topic is named once
    assert missing.words == "one of /snapshot, /gazebo/model_states, /gazebo/link_states, /tf"
    assert missing.checks == ("separation", "human_contact")


def test_a_topic_that_several_checks_lack_is_named_once_and_before_any_cause(tmp_path: Path) -> None:
    left_out = {"/snapshot", "/ariac_score/events"}
    messages = [m for m in recorded_messages(kitting_trial()) if m.topic not in left_out]
    found = ready(write_bag(tmp_path / "trial.mcap", messages, storage="mcap"))

    assert [(one.words.partition(",")[0], one.all_of) for one in found.missing] == [
        ("/ariac_score/events", True),
        ("one of /snapshot", False),
    ]
    topics = [topic for one in found.missing for topic in one.topics]
    assert len(topics) == len(set(topics))


def test_where_submissions_are_missing_the_console_that_prints_them_would_do(tmp_path: Path) -> None:
    """No stock simulator publishes /ariac_score/submissions; it prints what was handed in."""
    messages = [m for m in recorded_messages(kitting_trial()) if m.topic != "/ariac_score/submissions"]

    (missing,) = ready(write_bag(tmp_path / "trial.mcap", messages, storage="mcap")).missing

    assert missing.words == "one of /rosout, /ariac_score/submissions"


def test_of_alternatives_the_fewest_that_help_all_are_named() -> None:
    need = [
        MissingTopics(("/odom", "/tf"), False, ("speed",)),
        MissingTopics(("/tf",), False, ("separation",)),
        MissingTopics(("/orders",), True, ("kit",)),
        MissingTopics(("/orders", "/done"), True, ("time",)),
    ]

    assert [(one.words, one.checks) for one in grouped(need)] == [
        ("all of /orders, /done", ("kit", "time")),
        ("/tf", ("separation", "speed")),
    ]


@pytest.mark.parametrize(
    ("policy", "effect"), [("zero", "costs"), ("worst_case", "costs"), ("exclude", "costs")]
)
def test_what_the_rules_price_is_told_and_does_not_stop(
    policy: str, effect: str, without_humans: Path, tmp_path: Path
) -> None:
    rules = tmp_path / "ours.yaml"
    text = (ROOT / "rules/paper2020/published.yaml").read_text(encoding="utf-8")
    for plugin in ("iso_ts_15066.ssm_separation", "ariac.human_contact"):
        text = text.replace(f"use: {plugin}\n", f"use: {plugin}\n    on_inconclusive: {policy}\n")
    assert text.count(f"on_inconclusive: {policy}") == 2
    rules.write_text(text, encoding="utf-8")
    found = ready(without_humans, str(rules))

    assert found.ready
    assert {lack.effect for lack in found.lacks} == {effect}


def test_rules_that_compare_teams_are_no_obstacle() -> None:
    found = ready(ROOT / "examples/competition/2024/logs/aurora/kitting_1", "ariac2024.official")

    assert found.ready
    assert found.result.status == "needs_cohort"
    assert found.notes[0].startswith("the score needs all teams")


def test_ready_says_what_scoring_does(without_humans: Path) -> None:
    for log in (EXAMPLE, without_humans):
        assert (main(["check", str(log), "--rules", "paper2020.published"]) == 0) == (
            main(["score", str(log), "--rules", "paper2020.published"]) == 0
        )


def test_the_exit_code_and_the_text_say_it(without_humans: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(EXAMPLE), "--rules", "paper2020.published"]) == 0
    assert "can be scored under paper2020.published" in capsys.readouterr().out
    assert main(["check", str(without_humans), "--rules", "paper2020.published"]) == 6
    out = capsys.readouterr().out
    assert "trial.mcap leaves its score open under paper2020.published" in out
    assert "separation: robot/human:" in out
    assert out.index("record   one of /snapshot,") < out.index("robot/human:")

    assert (
        main(["check", str(without_humans), "--rules", "paper2020.published", "--output-format", "json"]) == 6
    )
    data = json.loads(capsys.readouterr().out)
    assert data["ready"] is False
    assert [lack["effect"] for lack in data["lacks"]] == ["opens", "opens"]


@pytest.mark.parametrize(("name", "content"), [("empty.mcap", b""), ("text.txt", b"hello"), ("none", None)])
def test_what_is_no_log_is_refused(
    name: str, content: bytes | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)

    assert main(["check", str(tmp_path / name), "--rules", "paper2020.published"]) == 5
    assert capsys.readouterr().out == ""


def test_a_damaged_log_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cut.mcap").write_bytes(EXAMPLE.read_bytes()[:100_000])

    assert main(["check", str(tmp_path / "cut.mcap"), "--rules", "paper2020.published"]) == 6
    assert "error:" in capsys.readouterr().err


def test_rules_of_another_year_are_a_different_answer(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(EXAMPLE), "--rules", "paper1999"]) == 4
    assert main(["check", str(EXAMPLE), "--rules", "ariac2022.as_coded"]) == 5
    assert "no order was found" in capsys.readouterr().err


def test_text_from_a_log_cannot_steer_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial = kitting_trial()
    log = write_trial_log(
        tmp_path / "t\x1b[31m.jsonl", trial, signals=[n for n in SNAPSHOT_SIGNALS if "human" not in n]
    )

    assert main(["check", str(log), "--rules", "paper2020.published"]) == 6
    assert "\x1b" not in capsys.readouterr().out
