"""Facts of a trial and its items are held against the schemas that their competition brings."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from ariac_score import FactSchemas, as_json, score_trial
from ariac_score.checks.registry import Plugin, package_sha256
from ariac_score.engine.facts import refuse_facts_below, refuse_other_facts
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LogError, PluginConflictError, PluginError
from ariac_score.scoring.levels import DeclaredFact
from ariac_score.testing import write_trial_log
from ariac_score.trial.work import Item
from ariac_score_ariac.testing import kitting_trial

Install = Callable[..., str]
GROUP = "ariac_score.fact_schemas"
RULES = "ariac2020.as_coded"
BY = Plugin("hunt", GROUP, "hunt:SCHEMAS", "hunt-score", "1.0")

HUNT = FactSchemas(
    {
        "trial": {"type": "object", "properties": {"arena": {"enum": ["north", "south"]}}},
        "object": {
            "type": "object",
            "required": ["kind"],
            "additionalProperties": False,
            "properties": {
                "kind": {"type": "string"},
                "difficulty": {"type": "integer", "minimum": 1, "maximum": 3},
                "time_s": {"type": ["number", "null"]},
            },
        },
    }
)


@pytest.fixture(autouse=True)
def _own_hashes() -> Iterator[None]:
    yield
    package_sha256.cache_clear()


def check(*objects: Item, **facts: object) -> None:
    """A hunt for these objects."""
    hunt = replace(kitting_trial(), work=(Item("run", "task", items=objects),), facts=facts)
    refuse_other_facts(hunt, HUNT, by=BY, file="run.jsonl")


def test_facts_as_the_competition_says_pass_and_so_do_those_of_levels_it_says_nothing_of() -> None:
    check(Item("a", "object", {"kind": "bolt", "difficulty": 3, "time_s": None}), arena="north")
    check(Item("a", "object", {"kind": "bolt", "difficulty": 1, "time_s": 0.5}), anything=1)
    check(Item("a", "thing", {"whatever": "it is"}))


@pytest.mark.parametrize(
    ("facts", "fact", "cause", "hint"),
    [
        ({"kind": "bolt", "difficulty": 0}, ", fact difficulty", "0 is less than the minimum", ""),
        ({"kind": "bolt", "difficulty": 4}, ", fact difficulty", "4 is greater than the maximum", ""),
        (
            {"kind": "bolt", "difficulty": 1.5},
            ", fact difficulty",
            "1.5 is not of type 'integer'",
            "give an integer",
        ),
        ({"kind": 3}, ", fact kind", "3 is not of type 'string'", "give a string"),
        ({"kind": None}, ", fact kind", "it is empty; 'string' is needed", ""),
        ({"kind": "bolt", "dificulty": 1}, ", fact dificulty", "unknown key", "did you mean 'difficulty'?"),
        ({"difficulty": 1}, "", "key 'kind' is missing", "add 'kind'"),
    ],
)
def test_a_fact_that_is_otherwise_is_refused_with_file_item_and_remedy(
    facts: dict[str, int | float | str | None], fact: str, cause: str, hint: str
) -> None:
    with pytest.raises(LogError) as refused:
        check(Item("a", "object", {"kind": "nut"}), Item("b", "object", facts))

    assert (refused.value.file, refused.value.place) == ("run.jsonl", f"object run/b{fact}")
    assert cause in refused.value.cause
    assert "hunt (hunt-score 1.0)" in refused.value.cause
    assert hint in refused.value.hint


def test_a_fact_of_the_trial_itself_is_named_so() -> None:
    with pytest.raises(LogError, match="'west' is not allowed") as refused:
        check(arena="west")
    assert refused.value.place == "trial, fact arena"


@pytest.mark.parametrize(
    ("schema", "cause"),
    [
        ({"type": "text"}, "level 'object': no JSON schema: 'text' is not"),
        ({"properties": 3}, "level 'object': no JSON schema"),
        ({"$ref": "https://example.org/facts.json"}, "stands alone"),
        ({"properties": {"a": {"anyOf": [{"$ref": "other.json#/$defs/a"}]}}}, "stands alone"),
    ],
)
def test_what_is_no_schema_or_looks_elsewhere_is_refused(schema: dict[str, object], cause: str) -> None:
    with pytest.raises(ValueError, match=cause):
        FactSchemas({"object": schema})
    FactSchemas({"object": {"$ref": "#/$defs/o", "$defs": {"o": {"type": "object"}}}})


# Brought by a distribution --------------------------------------------------------------


def schemas(install: Install, schema: str, distribution: str = "strict-score") -> None:
    source = f"from ariac_score import FactSchemas\nS = FactSchemas({schema})\n"
    install(distribution, {"ariac": "S"}, source=source, group=GROUP)


@pytest.mark.slow
def test_a_log_is_held_against_the_schemas_of_the_competition_of_the_rules(
    install: Install, tmp_path: Path
) -> None:
    log = write_trial_log(tmp_path / "trial.jsonl", kitting_trial())
    alone = tmp_path / "alone.yaml"
    alone.write_text(
        "{id: alone, title: A, source: a test, log_map: ariac2020, score: count(near), "
        "monitors: {near: {use: iso_ts_15066.ssm_separation}}}"
    )
    plain = as_json(score_trial(log, str(alone)))
    schemas(install, '{"order": {"properties": {"parts": {"maximum": 0}}}}')

    with pytest.raises(LogError, match=r"strict-score 1\.0") as refused:
        score_trial(log, RULES)
    assert str(refused.value.file) == str(log)
    assert refused.value.place.endswith("fact parts")
    # Rules without that competition are not asked.
    assert as_json(score_trial(log, str(alone))) == plain


def test_who_says_what_facts_there_are_stands_in_the_result(install: Install, tmp_path: Path) -> None:
    log = write_trial_log(tmp_path / "trial.jsonl", kitting_trial())
    schemas(install, '{"order": {"properties": {"parts": {"minimum": 1}}}}')

    code = score_trial(log, RULES).provenance.code
    assert {each.distribution for each in code} == {"ariac-score", "strict-score"}


def test_two_that_say_so_are_refused_and_one_that_is_broken_is_named(install: Install) -> None:
    schemas(install, '{"order": {"type": "texts"}}', "odd-score")
    with pytest.raises(PluginError, match=r"ariac \(odd-score 1\.0\) .*no JSON schema"):
        prepare(RULES)

    schemas(install, "{}")
    with pytest.raises(PluginConflictError, match=r"odd-score 1\.0 and strict-score 1\.0"):
        prepare(RULES)


@pytest.mark.parametrize(("difficulty", "refused"), [(1, False), (0.5, True), (None, False), ("hard", False)])
def test_a_fact_below_what_its_competition_says_is_refused(difficulty: object, refused: bool) -> None:
    item = Item("a", "object", {"difficulty": difficulty})  # type: ignore[dict-item]
    hunt = replace(kitting_trial(), work=(Item("run", "task", items=(item,)),))
    declared = {"object": {"difficulty": DeclaredFact(least=1), "anything": DeclaredFact()}}
    if not refused:
        return refuse_facts_below(hunt, declared, by="hunt", file="run.jsonl")

    with pytest.raises(
        LogError, match=r"difficulty is 0\.5, and hunt says that it is never below 1"
    ) as caught:
        refuse_facts_below(hunt, declared, by="hunt", file="run.jsonl")
    assert caught.value.place == "object run/a"
    return None
