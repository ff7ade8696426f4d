"""The stored document of a sensitivity: its exact text, read back, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ariac_score.errors import DataFileError
from ariac_score.results.result import Pinned
from ariac_score.review.sensitivity import Knob, RankSensitivity, RankShift, ScoreSensitivity
from ariac_score.review.sensitivity_file import load_rank_sensitivity, sensitivity_json
from ariac_score.scoring.ruleset import draft_rule_set

RULES = draft_rule_set("{id: r, title: T, source: a test, log_map: none, score: 1}", file="rules.yaml")
RULES.__dict__["sha256"] = "5" * 64  # as in the text that was published
PINNED = Pinned("r", RULES.sha256)
KNOB = Knob("near.limit_m", 1.0, 0.5, 2.0, declared=True, check="near")
RANKS = [
    RankSensitivity(KNOB, (RankShift(1.25, {"a": 1, "b": None}, {"a": 2, "b": 1}),)),
    RankSensitivity(Knob("weight", 0.0, 0.0, 1.0, declared=False)),
    RankSensitivity(Knob("idle", 1.0, 0.5, 2.0, declared=False), skipped="the score does not use it"),
]


def stored(folder: Path, text: str) -> Path:
    file = folder / "sensitivity.json"
    file.write_text(text, encoding="utf-8")
    return file


def test_the_text_of_a_score_is_that_of_version_1() -> None:
    # As version 1 has always been written: indented by two, None where there is no value.
    skipped = ScoreSensitivity(replace(KNOB, name="é", check=""), skipped="needs the log")
    found = [ScoreSensitivity(KNOB, low=3.5, base=2, high=None, elasticity=-0.5, changes_above=1e-7), skipped]

    assert sensitivity_json(found, RULES, "trial_1") == (
        '{\n  "format": "ariac-score sensitivity",\n  "version": 1,\n  "of": "trial_1",\n'
        f'  "rule_set": {{\n    "id": "r",\n    "sha256": "{"5" * 64}"\n  }},\n  "numbers": [\n'
        '    {\n      "name": "near.limit_m",\n      "value": 1.0,\n      "low": 0.5,\n      "high": 2.0,\n'
        '      "declared": true,\n      "score": {\n        "low": 3.5,\n        "base": 2,\n'
        '        "high": null\n      },\n      "elasticity": -0.5,\n      "changes_below": null,\n'
        '      "changes_above": 1e-07\n    },\n'
        '    {\n      "name": "é",\n      "value": 1.0,\n      "low": 0.5,\n      "high": 2.0,\n'
        '      "declared": true,\n      "skipped": "needs the log"\n    }\n  ]\n}\n'
    )


def test_the_sensitivity_of_a_ranking_comes_back_as_it_was(tmp_path: Path) -> None:
    file = stored(tmp_path, sensitivity_json(RANKS, RULES, "cup"))

    assert load_rank_sensitivity(file, "cup", PINNED) == RANKS


def _unknown(data: dict[str, Any]) -> None:
    data["numbers"][0]["shift"] = []


def _a_rank_in_words(data: dict[str, Any]) -> None:
    data["numbers"][0]["shifts"][0]["after"]["a"] = "second"


def _no_value(data: dict[str, Any]) -> None:
    del data["numbers"][1]["value"]


@pytest.mark.parametrize(
    ("edit", "cause"),
    [(_unknown, "unknown field `shift`"), (_a_rank_in_words, "got `str`"), (_no_value, "field `value`")],
)
def test_an_edited_document_is_refused_with_the_place(tmp_path: Path, edit: Any, cause: str) -> None:
    data = json.loads(sensitivity_json(RANKS, RULES, "cup"))
    edit(data)

    with pytest.raises(DataFileError, match="not the sensitivity of a ranking") as refused:
        load_rank_sensitivity(stored(tmp_path, json.dumps(data)), "cup", PINNED)
    assert cause in refused.value.cause
    assert "$.numbers[" in refused.value.cause


def test_the_sensitivity_of_a_score_is_not_that_of_a_ranking(tmp_path: Path) -> None:
    file = stored(tmp_path, sensitivity_json([ScoreSensitivity(KNOB, base=1.0)], RULES, "cup"))

    with pytest.raises(DataFileError, match="not the sensitivity of a ranking"):
        load_rank_sensitivity(file, "cup", PINNED)


def test_a_key_given_twice_is_refused(tmp_path: Path) -> None:
    text = sensitivity_json(RANKS, RULES, "cup").replace('"of": "cup",', '"of": "cup", "of": "cup",')

    with pytest.raises(DataFileError, match="'of' is given twice"):
        load_rank_sensitivity(stored(tmp_path, text), "cup", PINNED)
