"""Documents that surely keep a schema: never one that jsonschema refuses."""

from __future__ import annotations

import copy
import json
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from ariac_score import as_json, score_trial
from ariac_score.documents.plain_schema import surely_keeps
from ariac_score.documents.schema import schema, shipped_rules

LEAVES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-3, 3),
    st.sampled_from([0.0, 1.0, 2.5, float("nan")]),
    st.text("ab", max_size=3),
)
DATA = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text("abc", max_size=2), inner, max_size=3)
    ),
    max_leaves=6,
)
KEYWORDS = st.one_of(
    st.tuples(
        st.just("type"),
        st.sampled_from(["object", "array", "string", "integer", "number", "boolean", "null"]),
    ),
    st.tuples(st.just("type"), st.just(["string", "integer"])),
    st.tuples(
        st.sampled_from(["minLength", "maxLength", "minItems", "maxItems", "minProperties"]),
        st.integers(0, 3),
    ),
    st.tuples(
        st.sampled_from(["minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"]), st.integers(-2, 2)
    ),
    st.tuples(st.just("enum"), st.lists(LEAVES, min_size=1, max_size=3)),
    st.tuples(st.just("const"), LEAVES),
    st.tuples(st.just("pattern"), st.sampled_from(["^a", "b$", "ab"])),
    st.tuples(st.just("required"), st.lists(st.sampled_from("abc"), max_size=2, unique=True)),
    st.tuples(
        st.just("dependentRequired"),
        st.dictionaries(
            st.sampled_from("abc"), st.lists(st.sampled_from("abc"), max_size=2, unique=True), max_size=2
        ),
    ),
    st.tuples(st.just("uniqueItems"), st.booleans()),
)


def schemas(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    nested = st.one_of(
        st.tuples(
            st.sampled_from(["items", "additionalProperties", "propertyNames", "not", "if", "then", "else"]),
            inner,
        ),
        st.tuples(
            st.sampled_from(["properties", "patternProperties"]),
            st.dictionaries(st.sampled_from("abc"), inner, max_size=2),
        ),
        st.tuples(st.sampled_from(["anyOf", "oneOf", "allOf"]), st.lists(inner, min_size=1, max_size=2)),
        st.just(("$ref", "#/$defs/one")),
    )
    return st.lists(st.one_of(KEYWORDS, nested), max_size=3).map(dict)


SCHEMAS = st.recursive(
    st.one_of(st.booleans(), st.lists(KEYWORDS, max_size=2).map(dict)), schemas, max_leaves=5
)


@given(DATA, SCHEMAS)
@settings(max_examples=400, deadline=None)
def test_what_surely_keeps_a_schema_keeps_it(data: Any, wanted: Any) -> None:
    one = {"type": "string"}
    if surely_keeps(data, wanted, {"one": one}):
        whole = {**wanted, "$defs": {"one": one}} if isinstance(wanted, dict) else wanted
        assert Draft202012Validator(whole).is_valid(data)


FIELDS = st.lists(st.sampled_from("abc"), max_size=2, unique=True)
CONDITIONS = st.recursive(
    st.one_of(FIELDS.map(lambda names: {"required": names}), KEYWORDS.map(lambda pair: dict([pair]))),
    lambda inner: inner.map(lambda condition: {"not": condition}),
    max_leaves=3,
)


@given(DATA, CONDITIONS, SCHEMAS, SCHEMAS)
@settings(max_examples=400, deadline=None)
def test_a_condition_never_lets_the_wrong_branch_count(
    data: Any, condition: Any, then: Any, other: Any
) -> None:
    wanted = {"if": condition, "then": then, "else": other}
    if surely_keeps(data, wanted, {"one": {"type": "string"}}):
        assert Draft202012Validator({**wanted, "$defs": {"one": {"type": "string"}}}).is_valid(data)


def test_of_a_condition_about_fields_only_one_branch_counts() -> None:
    wanted = {"if": {"not": {"required": ["a"]}}, "then": {"required": ["b"]}, "else": {"required": ["c"]}}

    assert surely_keeps({"b": 1}, wanted, {})
    assert surely_keeps({"a": 1, "c": 1}, wanted, {})
    assert not surely_keeps({"c": 1}, wanted, {})
    assert not surely_keeps({"a": 1, "b": 1}, wanted, {})
    assert surely_keeps("a text has no fields that it could lack", wanted, {})


RULES = sorted(shipped_rules().items())


@pytest.mark.parametrize("path", [path for _, path in RULES], ids=lambda path: path.stem)
def test_changed_rule_sets_are_never_taken_for_sound(path: Path) -> None:
    document = json.loads(json.dumps(yaml.safe_load(path.read_text(encoding="utf-8")), default=str))
    dice = random.Random(7)  # noqa: S311  # of faults
    whole = schema("ruleset")
    validator = Draft202012Validator(whole)
    for _ in range(20):
        changed = copy.deepcopy(document)
        spoil(changed, dice)
        if surely_keeps(changed, whole, whole["$defs"]):
            assert validator.is_valid(changed)


def spoil(document: Any, dice: random.Random) -> None:
    while isinstance(document, (dict, list)) and document:
        key = dice.choice(sorted(document) if isinstance(document, dict) else range(len(document)))
        if not isinstance(document[key], (dict, list)) or dice.random() < 0.3:
            document[key] = dice.choice([None, "", "x y", -1, 2.5, [], {}, {"odd": 1}, True])
            return
        document = document[key]


def test_a_sound_rule_set_is_loaded_without_jsonschema() -> None:
    code = (
        "import sys; from ariac_score.cli import main; main(['rules', 'validate', 'ariac2020.official'])\n"
        "print(sorted({'jsonschema', 'rosbags', 'jinja2'} & sys.modules.keys()))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)

    assert done.stdout.splitlines()[-1] == "[]"


def test_a_broken_one_is_refused_as_before() -> None:
    assert not surely_keeps({"rules": 5}, {"properties": {"rules": {"type": "object"}}}, {})
    assert surely_keeps({"rules": {}}, {"properties": {"rules": {"type": "object"}}}, {})


@pytest.mark.parametrize(("data", "wanted"), [(12, 12), ("a", "a"), (True, True), (0, 0)])
def test_what_is_the_same_and_of_one_kind_is_sure(data: Any, wanted: Any) -> None:
    assert surely_keeps(data, {"const": wanted}, {})
    assert surely_keeps(data, {"enum": ["x", wanted]}, {})


@pytest.mark.parametrize(("data", "wanted"), [(12, 13), (1, True), (False, 0), (None, 0), ("1", 1)])
def test_what_is_another_or_of_another_kind_is_not(data: Any, wanted: Any) -> None:
    assert not surely_keeps(data, {"const": wanted}, {})
    assert not surely_keeps(data, {"enum": [wanted]}, {})


def test_results_of_ours_surely_keep_their_schema() -> None:
    example = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"
    told = json.loads(as_json(score_trial(example, "paper2020")))
    whole = schema("result")

    assert surely_keeps(told, whole, whole["$defs"])
    told["rounding"]["measured_significant_digits"] = 13
    assert not surely_keeps(told, whole, whole["$defs"])
