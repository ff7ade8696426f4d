"""JSON objects that name a key twice, wherever a stranger's JSON is read."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ariac_score.checks.contracts import Wanted
from ariac_score.documents.schema import strict_json
from ariac_score.errors import LogError
from ariac_score.logs.jsonl import JsonLinesReader
from ariac_score.logs.rosmonitoring import parse_object
from ariac_score.trial.channels import LogMap


@pytest.mark.parametrize("parse", [strict_json, parse_object])
def test_a_key_that_stands_twice_is_refused_by_its_name(parse: object) -> None:
    assert callable(parse)
    with pytest.raises(ValueError, match="key 'b' is given twice"):
        parse('{"a": 1, "b": 2, "b": 2}')


def test_the_first_key_that_stands_twice_is_named() -> None:
    with pytest.raises(ValueError, match="key 'a' is given twice"):
        strict_json('{"a": 1, "b": 2, "b": 2, "a": 1}')


def test_a_key_within_an_inner_object_may_stand_in_an_outer_one() -> None:
    assert strict_json('{"a": {"a": 1}}') == {"a": {"a": 1}}


@pytest.mark.slow
def test_the_last_of_very_many_keys_is_refused_at_once(tmp_path: Path) -> None:
    """Looking for each key among all others would take hours."""
    keys = [f'"{number}":0' for number in range(400_000)]
    text = "{" + ",".join([*keys, '"399999":0']) + "}"

    for parse in (strict_json, parse_object):
        with pytest.raises(ValueError, match="key '399999' is given twice"):
            parse(text)
    log = tmp_path / "log.jsonl"
    head = {"record": "trial", "format": "ariac-score-trial-log/1", "id": "x"}
    log.write_text(f"{json.dumps(head)}\n{text}\n", encoding="utf-8")
    with pytest.raises(LogError, match="key '399999' is given twice"):
        JsonLinesReader().read(log, Wanted(LogMap("m"), frozenset()))
