"""`explain` finds every item of work and tells its facts, whatever it earned."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score import score_trial
from ariac_score.cli import main
from ariac_score.errors import LogError
from ariac_score.results.result_file import as_json
from ariac_score.review.verify import verify_result

LOG = """\
{"record": "trial", "format": "ariac-score-trial-log/1", "id": "run", "facts": {"pace": 3}}
{"record": "item", "t_s": 1.0, "id": "task_1", "level": "task", "items": [{"id": "bolt_1", "level": "object", "facts": {"kind": "bolt", "weight_kg": 0.25, "found_s": null}}]}
{"record": "event", "t_s": 0.5, "kind": "competition_started"}
{"record": "event", "t_s": 1.5, "kind": "crash"}
{"record": "event", "t_s": 2.0, "kind": "competition_ended"}
{"record": "end", "records": 6}
"""  # noqa: E501

RULES = """\
id: bolts
title: Bolts
source: this test
log_map: ./map.yaml
levels: [object, task, trial]
facts:
  trial: {pace: number}
  object: {kind: text, weight_kg: {type: number, unit: kg}, found_s: number}
monitors: {crash: {use: ariac.no_event, with: {kind: crash}}}
score: SCORE
"""


def scored(folder: Path, score: str, log: str = LOG) -> Path:
    (folder / "map.yaml").write_text("{id: none, title: None, source: this test}")
    (folder / "rules.yaml").write_text(RULES.replace("SCORE", score))
    (folder / "run.jsonl").write_text(log)
    result = folder / "result.json"
    result.write_text(as_json(score_trial(folder / "run.jsonl", folder / "rules.yaml")))
    return result


@pytest.mark.parametrize("named", ["bolt_1", "task_1/bolt_1"])
def test_an_item_that_earned_nothing_is_explained_by_its_facts(
    named: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", str(scored(tmp_path, "trial.pace")), named]) == 0

    out = capsys.readouterr().out
    assert out.startswith("object task_1/bolt_1\n")
    for fact in ("kind: bolt", "weight_kg = 0.25", "found_s: known to be absent"):
        assert f"  {fact}\n" in out


def test_an_item_that_is_misspelt_is_named_in_the_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", str(scored(tmp_path, "trial.pace")), "task_1/bolt_2"]) == 4

    assert "did you mean 'task_1/bolt_1'?" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("score", "earned", "possible"),
    [
        ("trial.pace - count(crash)", 2, 3),  # the fact as it is; without the violation one more
        ("trial.pace", 3, 3),
        ("trial.pace + count(crash)", 4, None),  # it pays for what its check forbids: nobody knows the best
    ],
)
def test_what_was_possible_takes_facts_as_they_are_and_is_never_less_than_the_score(
    score: str, earned: int, possible: int | None, tmp_path: Path
) -> None:
    scored(tmp_path, score)
    result = score_trial(tmp_path / "run.jsonl", tmp_path / "rules.yaml")

    assert (result.score, result.possible) == (earned, possible)


def test_without_its_log_a_result_holds_in_itself_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = scored(tmp_path, "trial.pace")
    again = ["--log", str(tmp_path / "run.jsonl"), "--rules", str(tmp_path / "rules.yaml")]

    assert main(["verify", str(stored)]) == 8
    assert "\nconsistent in itself; not compared with a log" in capsys.readouterr().out
    assert main(["verify", str(stored), *again]) == 0
    assert capsys.readouterr().out.endswith("\nit holds\n")
    assert not verify_result(stored).computed_again


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("trial-log/1", "trial-log/2", "line 1: the log is in the format 'ariac-score-trial-log/2'"),
        (
            '"id": "task_1"',
            '"id" "task_1"',
            "line 2: not a JSON record: Expecting ':' delimiter at column 37",
        ),
    ],
)
def test_a_log_of_another_format_or_with_a_slip_is_told_by_its_own_line(
    old: str, new: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(LogError) as caught:
        scored(tmp_path, "trial.pace", LOG.replace(old, new))

    assert message in str(caught.value)
