"""Data files from strangers: what a YAML file may hold, and how its mistakes are reported."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from ariac_score.checks.registry import Registry
from ariac_score.documents import yaml as datafiles
from ariac_score.documents.schema import schema, schema_errors, validate
from ariac_score.documents.yaml import (
    LARGEST_INTEGER,
    MAX_BYTES,
    MAX_DEPTH,
    MAX_NODES,
    RepeatedKey,
    YamlDocument,
    is_there,
    load_yaml,
    parse_yaml,
)
from ariac_score.errors import DataFileError, RuleSetError
from ariac_score.scoring.ruleset import load_rule_set

LAWFUL = settings(max_examples=80, derandomize=True, deadline=None)
TEXT = st.text(st.characters(max_codepoint=0xD7FF), max_size=7)
"""JSON writes characters beyond as two escapes, which YAML does not join."""
EIGHTHS = st.integers(-800, 800).map(lambda n: n / 8)
"""JSON writes smaller numbers as 1e-09, which YAML 1.1 reads as text for want of a point."""
SCHEMAS = sorted(
    path.name.removesuffix(".schema.json")
    for path in (Path(__file__).parents[2] / "schemas").glob("*.schema.json")
)


def parsed(text: str | bytes) -> YamlDocument:
    return parse_yaml(text if isinstance(text, bytes) else text.encode(), file="x.yaml", error=RuleSetError)


def refusal(text: str | bytes) -> DataFileError:
    with pytest.raises(RuleSetError) as refused:
        parsed(text)
    assert refused.value.file == "x.yaml"
    assert refused.value.hint
    return refused.value


# What is read --------------------------------------------------------------------------


def test_plain_values_lists_and_maps_are_read() -> None:
    text = "a: 1\nb: [2.5, true, null, text]\nc: {d: '7'}\n"

    assert parsed(text).data == {"a": 1, "b": [2.5, True, None, "text"], "c": {"d": "7"}}


def test_the_hash_is_that_of_the_bytes() -> None:
    assert parsed("a: 1\n").sha256 == hashlib.sha256(b"a: 1\n").hexdigest()
    assert parsed("a: 1 \n").sha256 != parsed("a: 1\n").sha256


def test_a_byte_order_mark_is_no_part_of_the_text() -> None:
    assert parsed(b"\xef\xbb\xbfa: 1\n").data == {"a": 1}


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment\n", "---\n"])
def test_an_empty_file_holds_nothing(text: str) -> None:
    assert parsed(text).data is None


def test_a_modest_alias_stands_for_its_value() -> None:
    assert parsed("a: &x {k: 1}\nb: *x\n").data == {"a": {"k": 1}, "b": {"k": 1}}


def test_every_value_knows_its_line_and_path() -> None:
    document = parsed("terms:\n  order:\n    weight: 1\n\nlist:\n  - a\n  - b: 2\n")

    assert document.place(["terms", "order", "weight"]) == "line 3, $.terms.order.weight"
    assert document.place(["list", 1, "b"]) == "line 7, $.list[1].b"
    assert document.place([]) == "line 1, $"


def test_a_path_that_is_not_there_has_the_line_of_what_is_around_it() -> None:
    assert parsed("a:\n  b:\n    c: 1\n").place(["a", "b", "missing", "x"]) == "line 2, $.a.b.missing.x"


@LAWFUL
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers(-(2**60), 2**60) | EIGHTHS | TEXT,
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
        max_leaves=12,
    )
)
def test_what_json_writes_comes_back(data: Any) -> None:
    assert parsed(json.dumps(data)).data == data


# What is refused -----------------------------------------------------------------------


def test_a_key_given_twice_is_refused_with_both_lines() -> None:
    error = refusal("a: 1\nb:\n  c: 1\n  d: 2\n  c: 3\n")

    assert error.cause == "key 'c' is given twice, first in line 3"
    assert error.place == "line 5"


@pytest.mark.parametrize(
    "text", ["1: a\n1.0: b\n", "'a': 1\na: 2\n", "{a: 1, a: 1}", "- {b: 1}\n- {b: 1, b: 1}\n"]
)
def test_keys_that_mean_the_same_are_the_same(text: str) -> None:
    assert "given twice" in refusal(text).cause


def test_a_few_lines_of_aliases_cannot_stand_for_billions_of_values() -> None:
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]  # 9 ** 12 values

    error = refusal("\n".join(lines))

    assert error.cause == f"more than {MAX_NODES:,} values once aliases are expanded"
    assert error.place.startswith("line ")


def test_a_bomb_made_of_keys_and_maps_is_refused_too() -> None:
    lines = ["a0: &a0 {k: v}"]
    lines += [f"a{i}: &a{i} {{{', '.join(f'k{j}: *a{i - 1}' for j in range(9))}}}" for i in range(1, 12)]

    assert "once aliases are expanded" in refusal("\n".join(lines)).cause


def test_as_many_values_as_allowed_are_read_and_one_more_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(datafiles, "MAX_NODES", 100)

    assert parsed(json.dumps([1] * 99)).data == [1] * 99  # the list is a value too
    assert refusal(json.dumps([1] * 100)).cause == "more than 100 values once aliases are expanded"


@pytest.mark.parametrize("text", ["a: &a [*a]\n", "&a [*a]", "a: &a {b: *a}\n", "a: &a [1, [2, {k: *a}]]\n"])
def test_an_alias_within_what_it_names_is_refused(text: str) -> None:
    assert refusal(text).cause == "an alias refers to its own surroundings"


def test_lists_as_deep_as_allowed_are_read_and_one_deeper_is_not() -> None:
    assert parsed("[" * MAX_DEPTH + "1" + "]" * MAX_DEPTH).data
    error = refusal("[" * (MAX_DEPTH + 1) + "1" + "]" * (MAX_DEPTH + 1))
    assert error.cause == f"nested deeper than {MAX_DEPTH} levels"
    assert error.place == "line 1"


@pytest.mark.parametrize("text", ["[" * 100_000, "{a: " * 100_000, "- " * 100_000])
def test_hostile_nesting_is_refused_and_breaks_nothing(text: str) -> None:
    assert "nested deeper" in refusal(text).cause


def test_a_chain_of_aliases_is_as_deep_as_it_would_be_written_out() -> None:
    def chain(lists: int) -> str:  # within one map
        return "\n".join(["a1: &a1 [x]", *(f"a{i}: &a{i} [*a{i - 1}]" for i in range(2, lists + 1))])

    assert parsed(chain(MAX_DEPTH - 1)).data
    for lists in (MAX_DEPTH, 600):
        assert refusal(chain(lists)).cause == f"nested deeper than {MAX_DEPTH} levels"


@pytest.mark.parametrize(
    "text",
    [
        "a: !!python/object/apply:os.system [echo]\n",
        "a: !!python/object:builtins.object {}\n",
        "a: !!python/name:os.system\n",
        "a: !!python/tuple [1, 2]\n",
        "a: !mine 1\n",
        "a: !!set {b}\n",
        "a: !!omap [b: 1]\n",
        "!mine {a: 1}\n",
        "a: !!int [1]\n",
        "a: !!map [1]\n",
        "a: !!int text\n",
        "? !!python/name:os.system\n: 1\n",
    ],
)
def test_tags_that_make_anything_but_plain_values_are_refused(text: str) -> None:
    error = refusal(text)

    assert error.place == "line 1"
    assert "not allowed" in error.cause or "not a plain value" in error.cause


def test_merge_keys_are_refused_because_they_hide_what_is_written() -> None:
    error = refusal("a: &a {x: 1}\nb:\n  <<: *a\n  y: 2\n")

    assert error.cause.startswith("'<<' is not a plain value")
    assert error.place == "line 3"


@pytest.mark.parametrize("text", ["? [1, 2]\n: x\n", "? {a: 1}\n: x\n"])
def test_a_key_that_is_a_list_or_a_map_is_refused(text: str) -> None:
    assert refusal(text).cause == "a key must be a plain value"


def test_bytes_that_are_not_utf_8_are_refused_with_their_place() -> None:
    error = refusal(b"title: caf\xe9\n")

    assert (error.cause, error.place, error.hint) == ("not UTF-8 text", "byte 10", "save it as UTF-8")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32"])
def test_other_unicode_encodings_are_refused(encoding: str) -> None:
    assert refusal("a: é\n".encode(encoding)).cause == "not UTF-8 text"


@pytest.mark.parametrize("character", ["\x00", "\x01", "\x1b", "\x7f"])
def test_control_characters_are_refused(character: str) -> None:
    assert refusal(f"a: 1\nb: x{character}y\n").cause.startswith("malformed YAML")


def test_two_documents_in_one_file_are_refused() -> None:
    error = refusal("a: 1\n---\nb: 2\n")

    assert "single document" in error.cause
    assert error.place.startswith("line 2")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a: 1\nb: [1, 2\nc: 3\n", 3),
        ("a: 1\n  b: 2\n", 2),
        ("a: 'open\n", 2),
        ("a: b: c\n", 1),
        ("a: 1\n\tb: 2\n", 2),
        ("a: *nowhere\n", 1),
        ("a: @x\n", 1),
    ],
)
def test_malformed_yaml_is_refused_with_line_and_column(text: str, line: int) -> None:
    error = refusal(text)

    assert error.cause.startswith("malformed YAML")
    assert error.place.startswith(f"line {line}, column ")


def test_whole_numbers_beyond_any_stamp_are_refused() -> None:
    assert parsed(f"a: {LARGEST_INTEGER}").data == {"a": LARGEST_INTEGER}
    for number in (str(LARGEST_INTEGER + 1), str(-LARGEST_INTEGER - 1), "0x" + "f" * 5000, "9" * 5000):
        error = refusal(f"a: 1\nb: {number}\n")
        assert error.place == "line 2"
        assert "number is not allowed" in error.cause or "not a plain value" in error.cause


@LAWFUL
@given(st.binary(max_size=60) | st.text("[]{}:,-&*!|>'\"#? \n\tab0", max_size=40).map(str.encode))
def test_any_bytes_are_either_read_or_refused_in_words(raw: bytes) -> None:
    try:
        document = parse_yaml(raw, file="x.yaml")
    except DataFileError as error:
        assert error.cause  # noqa: PT017  # either outcome is right; nothing else may escape
    else:
        assert document.sha256 == hashlib.sha256(raw).hexdigest()


# Files ---------------------------------------------------------------------------------


def test_a_missing_file_is_said_to_be_missing(tmp_path: Path) -> None:
    with pytest.raises(RuleSetError, match="no such file") as refused:
        load_yaml(tmp_path / "gone.yaml", error=RuleSetError)
    assert refused.value.file == str(tmp_path / "gone.yaml")


def test_a_directory_is_not_read_as_a_file(tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match="cannot be read"):
        load_yaml(tmp_path)


def test_a_name_no_file_can_have_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match="cannot be read"):
        load_yaml(tmp_path / "a\0b.yaml")


def test_a_file_as_large_as_allowed_is_read_and_one_byte_more_is_not(tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(b"a: 1\n#xx\n")

    assert load_yaml(path, max_bytes=9).data == {"a": 1}
    with pytest.raises(DataFileError, match="the file has 9 bytes, more than the 8 allowed"):
        load_yaml(path, max_bytes=8)


def test_a_file_of_10_mb_is_refused_without_being_read(tmp_path: Path) -> None:
    path = tmp_path / "large.yaml"
    path.write_bytes(b"")
    with path.open("r+b") as stream:
        stream.truncate(10_000_000)

    with pytest.raises(DataFileError, match=f"10,000,000 bytes, more than the {MAX_BYTES:,} allowed"):
        load_yaml(path)


def test_the_error_is_of_the_class_asked_for(tmp_path: Path) -> None:
    (tmp_path / "x.yaml").write_text("a: [", encoding="utf-8")

    with pytest.raises(DataFileError) as plain:
        load_yaml(tmp_path / "x.yaml")
    assert type(plain.value) is DataFileError
    with pytest.raises(RuleSetError):
        load_yaml(tmp_path / "x.yaml", error=RuleSetError)


# Schemas -------------------------------------------------------------------------------

MINIMAL: dict[str, Any] = {"id": "x", "title": "t", "source": "s", "log_map": "m", "score": 1}


def test_a_document_that_keeps_its_schema_has_no_faults() -> None:
    assert schema_errors(MINIMAL, "ruleset") == []


@pytest.mark.parametrize(
    ("change", "path", "cause", "hint"),
    [
        ({"tilte": "t"}, ("tilte",), "unknown key 'tilte'", "did you mean 'title'?"),
        (
            {"bounds": {"human": {"max_speed_m_s": 1, "source": "s"}, "Robot Arm": {}}},
            ("bounds", "Robot Arm"),
            "unknown key 'Robot Arm'",
            "did you mean 'robot_arm'?",
        ),
        (
            {"rules": {"a": {"use": "a.b", "wiht": {}}}},
            ("rules", "a", "wiht"),
            "unknown key 'wiht'",
            "'with'",
        ),
        (
            {"rules": {"a": {"use": "a.b", "on_inconclusive": "zeros"}}},
            ("rules", "a", "on_inconclusive"),
            "'zeros' is not allowed here",
            "did you mean 'zero'?",
        ),
        ({"title": 7}, ("title",), "7 is not of type 'string'", "give a string"),
        ({"round": True}, ("round",), "True is not of type 'integer'", "give an integer"),
        ({"parameters": {"w": "1"}}, ("parameters", "w"), "'1' is not of type 'number'", "give a number"),
        ({"parameters": {"w": True}}, ("parameters", "w"), "True is not of type 'number'", "give a number"),
        ({"round": 13}, ("round",), "13 is greater than the maximum of 12", "Decimal digits"),
        ({"round": -1}, ("round",), "-1 is less than the minimum of 0", "Decimal digits"),
    ],
)
def test_a_fault_has_a_path_a_cause_and_a_remedy(
    change: dict[str, Any], path: tuple[str, ...], cause: str, hint: str
) -> None:
    ((found_path, found_cause, found_hint),) = schema_errors({**MINIMAL, **change}, "ruleset")

    assert (found_path, found_cause) == (path, cause)
    assert hint in found_hint


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        (None, "it is empty; 'object' is needed"),
        ([], "[] is not of type 'object'"),
        ("text", "'text' is not of type 'object'"),
        (7, "7 is not of type 'object'"),
    ],
)
def test_a_document_that_is_no_map_breaks_the_schema(data: object, cause: str) -> None:
    ((path, found, _),) = schema_errors(data, "ruleset")

    assert (path, found) == ((), cause)


def test_validation_names_file_line_and_path_and_counts_the_rest() -> None:
    document = parsed("id: x\ntitle: t\nsource: s\nlog_map: m\nscore: 1\nround: 99\ntask: []\nsafety: 1\n")

    with pytest.raises(RuleSetError) as refused:
        validate(document, "ruleset", error=RuleSetError)
    assert refused.value.file == "x.yaml"
    assert refused.value.place == "line 6, $.round"
    assert "(and 2 more)" in refused.value.cause


@pytest.mark.parametrize(
    ("written", "place", "cause"),
    [
        ("bounds: {time_error_s: .nan}", "line 6, $.bounds.time_error_s", "nan is not a finite number"),
        (
            "bounds: {distance_error_m: .nan}",
            "line 6, $.bounds.distance_error_m",
            "nan is not a finite number",
        ),
        (
            "bounds: {robot: {max_speed_m_s: .nan, source: x}}",
            "line 6, $.bounds.robot.max_speed_m_s",
            "nan is not a finite number",
        ),
        (
            "bounds: {human: {max_speed_m_s: 1, max_acceleration_m_s2: .inf, source: x}}",
            "line 6, $.bounds.human.max_acceleration_m_s2",
            "inf is not a finite number",
        ),
        ("parameters: {w: -.inf}", "line 6, $.parameters.w", "-inf is not a finite number"),
        ("ranges: {w: [.nan, 1]}", "line 6, $.ranges.w[0]", "nan is not a finite number"),
        ("bounds: {3: {max_speed_m_s: 1, source: x}}", "line 6, $.bounds.3", "key 3 is not text"),
    ],
)
def test_what_no_schema_can_judge_is_refused_by_its_place(written: str, place: str, cause: str) -> None:
    document = parsed(f"id: x\ntitle: t\nsource: s\nlog_map: m\nscore: 1\n{written}\n")

    with pytest.raises(RuleSetError) as refused:
        validate(document, "ruleset", error=RuleSetError)
    assert (refused.value.file, refused.value.place, refused.value.cause) == ("x.yaml", place, cause)
    assert refused.value.hint


@pytest.mark.parametrize("rate", [".nan", ".inf"])
def test_a_log_map_with_a_rate_that_is_no_number_is_refused(rate: str) -> None:
    document = parsed(f"id: x\nchannels:\n- topic: /a\n  rate_hz: {rate}\n")

    with pytest.raises(RuleSetError) as refused:
        validate(document, "log_map", error=RuleSetError)
    assert refused.value.place == "line 4, $.channels[0].rate_hz"
    assert refused.value.cause == f"{rate[1:]} is not a finite number"


def test_a_name_without_letters_is_told_what_a_name_is() -> None:
    ((path, cause, hint),) = schema_errors({**MINIMAL, "bounds": {"": {}}}, "ruleset")

    assert (path, cause) == (("bounds", ""), "unknown key ''")
    assert hint == "give it a name of small letters, digits and underscores that begins with a letter"


def objects(node: Any, where: str = "$") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every sub-schema that lists properties."""
    if isinstance(node, dict):
        if isinstance(node.get("properties"), dict):
            yield where, node
        for key, inner in node.items():
            yield from objects(inner, f"{where}.{key}")
    elif isinstance(node, list):
        for i, inner in enumerate(node):
            yield from objects(inner, f"{where}[{i}]")


def test_there_are_schemas_to_check() -> None:
    assert {"ruleset", "log_map", "result", "bundle", "trial_log"} <= set(SCHEMAS)


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_shipped_schema_is_a_valid_schema_of_draft_2020_12(name: str) -> None:
    assert schema(name)["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    Draft202012Validator.check_schema(schema(name))


CLOSED_BY_CODE = {
    "bundle": ["$"],
    "ruleset": ["$.$defs.for_auditors.properties.printed", "$.$defs.table.properties.table.items"],
    "trial_log": ["$.$defs.brought_record"],
}
"""Further keys are columns that a table names, roles that installed readers state, levels that the rule set
declares, and what the schema of a competition's own record says; any other is refused when it is read."""


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_shipped_schema_is_closed(name: str) -> None:
    open_ones = [
        where
        for where, node in objects(schema(name))
        if node.get("additionalProperties") is not False and node.get("unevaluatedProperties") is not False
    ]

    assert open_ones == CLOSED_BY_CODE.get(name, [])


@pytest.mark.parametrize("name", SCHEMAS)
def test_every_key_that_is_required_is_described(name: str) -> None:
    for where, node in objects(schema(name)):
        assert set(node.get("required", [])) <= set(node["properties"]), where


def test_a_key_may_be_given_twice_where_the_caller_lets_it() -> None:
    text = b"a: 1\nb: {c: [1, 2]}\nb:\n  c:\n  - 3\n"
    document = parse_yaml(text, file="f", may_repeat=lambda path: path == ("b",))

    assert document.data == {"a": 1, "b": {"c": [3]}}
    assert document.repeats == (RepeatedKey(("b",), 3, 2),)
    assert document.place(("b", "c", 0)) == "line 5, $.b.c[0]"


def test_elsewhere_a_key_given_twice_is_refused() -> None:
    with pytest.raises(DataFileError, match="key 'c' is given twice, first in line 2"):
        parse_yaml(b"b:\n  c: 1\n  c: 2\n", file="f", may_repeat=lambda path: path == ("b",))


def test_nothing_lies_where_the_system_refuses_the_name(tmp_path: Path) -> None:
    (tmp_path / "log").write_text("")

    assert is_there(tmp_path / "log")
    assert is_there(tmp_path)
    assert not is_there(tmp_path / "other")
    assert not is_there(tmp_path / ("x" * 5000))
    assert not is_there(tmp_path / "a\0b")


def test_a_decimal_comma_is_refused_by_its_place(tmp_path: Path) -> None:
    file = tmp_path / "rules.yaml"
    file.write_text(
        "id: mine\ntitle: t\nsource: s\nextends: paper2020.published\n"
        "rules: {pose: {use: kitting.pose, with: {max_distance_m: 0,03}}}\n"
    )
    with pytest.raises(RuleSetError, match=r"line 5.*key 3 is not text") as refused:
        load_rule_set(str(file)).build(Registry())
    assert refused.value.hint == "quote it: '3'; or write 0.03 where 0,03 is meant"


@pytest.mark.parametrize("text", ["", "# only a comment\n", "~\n"])
def test_a_file_that_says_nothing_is_called_empty(text: str) -> None:
    with pytest.raises(RuleSetError) as refused:
        validate(parsed(text), "ruleset", error=RuleSetError)

    assert refused.value.cause == "the file is empty"
    assert refused.value.hint.startswith("write its keys: 'id', 'title', 'source'")


def test_a_list_where_keys_belong_is_told_what_to_write() -> None:
    (_, cause, hint), *_ = schema_errors([1], "ruleset")

    assert cause == "[1] is not of type 'object'"
    assert hint == "write keys with their values, such as 'id: …'"
