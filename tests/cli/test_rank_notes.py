"""What `rank` says of the runs before it ranks them."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.cli.rank import _said_beforehand
from ariac_score.ranking.competition import load_competition
from ariac_score.scoring.ruleset import load_rule_set


@pytest.mark.parametrize(
    ("more", "runs", "said"),
    [
        ("", {"a": 3, "b": 1}, ["kit: a made 3 runs and b 1, and nothing declares how many count"]),
        ("ranking: {keep: 1}", {"a": 3, "b": 1}, []),
        ("ranking: {missing_run: zero}", {"a": 3, "b": 1}, []),
        ("", {"a": 2, "b": 2}, []),
    ],
)
def test_unequal_numbers_of_runs_without_a_declared_policy_are_said(
    more: str, runs: dict[str, int], said: list[str], tmp_path: Path
) -> None:
    for team, number in runs.items():
        for run in range(1, number + 1):
            (tmp_path / team / f"kit_{run}").mkdir(parents=True)
    text = f"id: cup\nrules: paper2020\nruns: '{{team}}/{{trial}}_{{run}}'\n{more}\n"
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")

    found = list(_said_beforehand(load_competition(tmp_path), load_rule_set("paper2020")))

    assert [words[: len(begin)] for words, begin in zip(found, said, strict=True)] == said


def test_stored_results_are_said_not_to_be_compared_with_their_logs(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a/kit_1.json").write_text("{}", encoding="utf-8")
    text = "{id: cup, rules: paper2020, runs: '{team}/{trial}_{run}.json'}"
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")

    (words,) = _said_beforehand(load_competition(tmp_path), load_rule_set("paper2020"))

    assert words.startswith("1 of 1 runs are stored results")
