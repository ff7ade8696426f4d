"""Stored documents: one class each; JSON both ways, schema and closed objects follow from it."""

from __future__ import annotations

import copy
import json
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from decimal import Decimal
from pathlib import Path
from typing import Annotated, Any

import pytest
from ariac_score.schemas.__main__ import FORMATS, schema_text
from msgspec import Meta, structs

from ariac_score import Finding, Result, as_json, load_result, score_trial
from ariac_score.checks.findings import FrozenMap, Verdict
from ariac_score.checks.open_findings import Cause, OpenFindings
from ariac_score.documents.schema import schema_errors
from ariac_score.errors import DataFileError, ResultError
from ariac_score.results.codec import Format, as_text
from ariac_score.results.result_file import RESULT, measured_sha256
from ariac_score.trial.spans import Span

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "tests/data/as_published/kitting_near_miss.result.json"


@dataclass(frozen=True)
class Part:
    """A part.

    Attributes:
        kind: What it is, such as a `pump`, or
            nothing when unknown.
        points: What it brings; `None` when undecided.
    """

    kind: Annotated[str, Meta(pattern="^(pump|gear)$")]
    points: Decimal | None = None


@dataclass(frozen=True)
class Kit:
    """A kit."""

    parts: dict[str, tuple[Part, ...]]
    reach_m: float = 0.0
    note: str = ""


KIT = Format("kit", 2, Kit, made_by="'make a kit'", before={1: lambda data: {"parts": data["all"]}})


def pickled(value: Any) -> Any:
    return pickle.loads(pickle.dumps(value))  # noqa: S301  # of our own making


WHOLE = Kit({"a/1": (Part("gear"), Part("pump", Decimal("1.50")))}, 0.1)


def read(text: str, tmp_path: Path) -> Kit:
    (tmp_path / "kit.json").write_text(text, encoding="utf-8")
    return KIT.read(tmp_path / "kit.json")


@pytest.fixture(scope="module")
def result() -> Result:
    return load_result(EXAMPLE)


# Both ways -----------------------------------------------------------------------------


def test_a_document_is_sorted_and_a_line_holds_what_contains_nothing_else(tmp_path: Path) -> None:
    text = KIT.text(WHOLE)

    assert text == (
        "{\n"
        ' "schema": "ariac-score/kit/2",\n'
        ' "note": "",\n'
        ' "parts": {\n'
        '  "a/1": [\n'
        '   {"kind": "gear", "points": null},\n'
        '   {"kind": "pump", "points": 1.50}\n'
        "  ]\n"
        " },\n"
        ' "reach_m": 0.1\n'
        "}\n"
    )
    assert read(text, tmp_path) == WHOLE


def test_brackets_and_breaks_in_a_text_change_no_line(tmp_path: Path) -> None:
    hostile = replace(
        WHOLE, note='[\n {"a": 1,\n  "b": [2]}\n]', parts={"[\n ]{\n }": (), "x": (Part("gear"),)}
    )

    assert read(KIT.text(hostile), tmp_path) == hostile


def test_amounts_keep_their_digits_and_numbers_are_those_of_json(tmp_path: Path) -> None:
    parts = tuple(Part("gear", Decimal(text)) for text in ("0.000000", "-1E+3", "12.340000000000000001"))
    text = KIT.text(Kit({"a": parts}, 1e-9))

    assert [str(part.points) for part in read(text, tmp_path).parts["a"]] == [str(p.points) for p in parts]
    assert json.loads(text)["parts"]["a"][1]["points"] == -1000
    assert json.loads(text)["reach_m"] == 1e-9


@pytest.mark.parametrize("number", [float("nan"), float("inf"), float("-inf")])
def test_a_number_that_is_none_is_never_written_as_null(number: float) -> None:
    with pytest.raises(ValueError, match="not finite"):
        KIT.text(replace(WHOLE, reach_m=number))
    with pytest.raises(ValueError, match="not finite"):
        as_text({"a": [None, {"b": number}]})


@pytest.mark.parametrize(
    ("number", "cause"),
    [
        (2**64, r"\$\.measured\.coverage\[0\]\.samples: an integer of more than 64 bits"),
        (2**70, r"\$\.measured\.coverage\[0\]\.samples: an integer of more than 64 bits"),
        (-1, r"\$\.measured\.coverage\[0\]\.samples: expected 'int' >= 0"),
    ],
)
def test_a_count_that_is_none_is_refused_with_its_place(
    result: Result, number: int, cause: str, tmp_path: Path
) -> None:
    stored = json.loads(as_json(result))
    stored["measured"]["coverage"][0]["samples"] = number
    (tmp_path / "r.json").write_text(json.dumps(stored), encoding="utf-8")

    with pytest.raises(ResultError, match=cause):
        load_result(tmp_path / "r.json")


def test_the_largest_count_is_read_and_written_again(result: Result, tmp_path: Path) -> None:
    stored = json.loads(as_json(result))
    stored["measured"]["coverage"][0]["samples"] = 2**64 - 1
    (tmp_path / "r.json").write_text(json.dumps(stored), encoding="utf-8")

    assert f"{2**64 - 1}" in as_json(load_result(tmp_path / "r.json"))


def test_a_defect_counted_below_0_is_refused(result: Result, tmp_path: Path) -> None:
    stored = json.loads(as_json(result))
    stored["measured"]["log_defects"] = [{"kind": "x", "where": "y", "count": -1, "message": "z"}]
    (tmp_path / "r.json").write_text(json.dumps(stored), encoding="utf-8")

    with pytest.raises(ResultError, match=r"log_defects\[0\]: defect 'x' of 'y' has a count of -1"):
        load_result(tmp_path / "r.json")


@pytest.mark.parametrize("names", [("a\\udcff", "a\udcff"), ("a\udcff", "a\\udcff")])
def test_of_two_keys_that_would_be_written_alike_both_are_kept(names: tuple[str, str]) -> None:
    values = {"a\\udcff": 1, "a\udcff": 2}

    text = as_text({name: values[name] for name in names})

    assert json.loads(text) == {"a\\udcff": 1, "a\\udcff'": 2}


def test_what_only_looks_like_a_number_that_is_none_is_written() -> None:
    # In MessagePack this whole number has the bytes with which an infinite number begins: CB 7F F0.
    looks_so = {"a": 0xCB7FF0, "b": 1.7976931348623157e308, "c": [-5e-324]}

    assert json.loads(as_text(looks_so)) == looks_so


def test_half_a_surrogate_pair_is_written_visibly(tmp_path: Path) -> None:
    found = read(KIT.text(Kit({"\udcff": ()}, note="a\ud800")), tmp_path)

    assert found == Kit({"\\udcff": ()}, note="a\\ud800")


def test_a_result_comes_back_equal_and_so_do_its_pickle_and_its_copy(result: Result, tmp_path: Path) -> None:
    scored = score_trial(ROOT / "examples/kitting_near_miss.mcap", "paper2020.published")
    (tmp_path / "r.json").write_text(as_json(scored), encoding="utf-8")

    assert load_result(tmp_path / "r.json") == scored
    for one in (scored, result):
        assert pickled(one) == one
        assert copy.deepcopy(one) == one
        assert as_json(pickled(one)) == as_json(one)


def test_a_copied_finding_is_as_frozen_as_the_finding() -> None:
    finding = Finding("a", Verdict.SATISFIED, "good", quantities={"distance_m": 1.0})

    for one in (finding, pickled(finding), copy.deepcopy(finding)):
        assert isinstance(one.quantities, FrozenMap)
        for change in (
            lambda held: held.update(distance_m=2.0),
            lambda held: held.__setitem__("distance_m", 2.0),
            lambda held: held.__delitem__("distance_m"),
            lambda held: held.pop("distance_m"),
            lambda held: held.popitem(),
            lambda held: held.setdefault("other_m", 2.0),
            lambda held: held.__ior__({"other_m": 2.0}),
            lambda held: held.clear(),
        ):
            with pytest.raises(TypeError, match="cannot be changed"):
                change(one.quantities)
        assert one.quantities == {"distance_m": 1.0}


def test_what_is_measured_has_the_stored_digits_before_it_is_stored(result: Result) -> None:
    third = 1 / 3
    finding = next(iter(result.measured.findings.values()))
    measured = replace(
        result.measured,
        findings={"a#1": replace(finding, robustness=third, quantities={"x_m": third}, units={})},
    )

    assert measured.findings["a#1"].robustness == 0.333333333333
    assert measured.findings["a#1"].quantities == {"x_m": 0.333333333333}


# What is refused -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "place", "cause"),
    [
        (lambda d: d["parts"]["a/1"][1].update(kind="disk"), "$.parts.a/1[1].kind", "pump"),
        (lambda d: d["parts"]["a/1"][1].pop("kind"), "$.parts.a/1[1]", "key 'kind' is missing"),
        (lambda d: d["parts"]["a/1"][0].update(knid="gear"), "$.parts.a/1[0].knid", "unknown key 'knid'"),
        (lambda d: d.update(more=0), "$.more", "unknown key 'more'"),
        (lambda d: d.update(reach_m="0.1"), "$.reach_m", "expected 'float', got 'str'"),
        (lambda d: d.update(reach_m=True), "$.reach_m", "expected 'float', got 'bool'"),
        (lambda d: d["parts"]["a/1"][1].update(points="1.5"), "$.parts.a/1[1].points", "expected a number"),
        (lambda d: d["parts"]["a/1"][1].update(points="NaN"), "$.parts.a/1[1].points", "expected a number"),
        (lambda d: d.update(schema="ariac-score/kit/3"), "$.schema", "a newer version wrote it"),
        (lambda d: d.update(schema="ariac-score/kit/0"), "$.schema", "its schema is 'ariac-score/kit/0'"),
        (lambda d: d.update(schema=["x"]), "$.schema", "its schema is ['x']"),
        (lambda d: d.pop("schema"), "$.schema", "it states no schema"),
    ],
)
def test_what_is_wrong_is_named_with_its_place(
    change: Callable[[Any], object], place: str, cause: str, tmp_path: Path
) -> None:
    data = json.loads(KIT.text(WHOLE))
    change(data)

    with pytest.raises(DataFileError) as refused:
        read(json.dumps(data), tmp_path)
    assert refused.value.place == place
    assert cause in refused.value.cause
    assert refused.value.file == str(tmp_path / "kit.json")
    assert refused.value.hint


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("", "Expecting value"),
        ("[" * 100_000, "recursion"),
        ('{"schema": "ariac-score/kit/2", "parts": {}, "parts": {}}', "key 'parts' is given twice"),
        ('{"schema": "ariac-score/kit/2", "parts": {}, "reach_m": NaN}', "NaN is not a number"),
        ('{"schema": "ariac-score/kit/2", "parts": {}, "reach_m": 1e999}', "out of range"),
        ("[]", "it states no schema"),
    ],
)
def test_what_is_no_document_is_refused(text: str, cause: str, tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match=cause):
        read(text, tmp_path)


@pytest.mark.parametrize(
    ("name", "cause"), [("nowhere.json", "no such file"), ("a\0b.json", "cannot be read")]
)
def test_a_file_that_cannot_be_read_is_named(name: str, cause: str, tmp_path: Path) -> None:
    with pytest.raises(DataFileError, match=cause):
        KIT.read(tmp_path / name)


# Versions ------------------------------------------------------------------------------


def test_an_older_document_is_read_by_one_small_function(tmp_path: Path) -> None:
    old = {"schema": "ariac-score/kit/1", "all": {"a": [{"kind": "pump", "points": 1.5}]}}

    assert read(json.dumps(old), tmp_path) == Kit({"a": (Part("pump", Decimal("1.5")),)})


@pytest.mark.parametrize(
    ("old", "place"), [({}, "$"), ({"all": {"a": [{}]}}, "$.parts.a[0]"), ({"all": 3}, "$.parts")]
)
def test_an_older_document_that_is_none_is_refused(old: Any, place: str, tmp_path: Path) -> None:
    with pytest.raises(DataFileError) as refused:
        read(json.dumps({"schema": "ariac-score/kit/1", **old}), tmp_path)
    assert refused.value.place == place


def test_a_field_with_a_default_is_all_that_a_new_field_takes(tmp_path: Path) -> None:
    @dataclass(frozen=True)
    class Wider(Kit):
        """A kit.

        Attributes:
            weight: What it counts.
        """

        weight: float = 1.0
        marks: dict[str, int] = field(default_factory=dict)

    wider = Format("kit", 2, Wider, made_by="'make a kit'")
    (tmp_path / "kit.json").write_text(KIT.text(WHOLE), encoding="utf-8")
    found = wider.read(tmp_path / "kit.json")

    assert found == Wider(WHOLE.parts, 0.1)
    assert wider.schema()["properties"]["weight"] == {
        "description": "What it counts.",
        "type": "number",
        "default": 1.0,
    }


# Schemas -------------------------------------------------------------------------------


def test_a_schema_is_closed_and_says_what_the_docstrings_say() -> None:
    schema = KIT.schema()
    part = schema["$defs"]["Part"]

    assert schema["properties"]["schema"] == {"const": "ariac-score/kit/2"}
    assert schema["required"] == ["schema", "parts"]
    assert (schema["additionalProperties"], part["additionalProperties"]) == (False, False)
    assert (part["description"], part["required"]) == ("A part.", ["kind"])
    assert part["properties"]["kind"] == {
        "description": "What it is, such as a 'pump', or nothing when unknown.",
        "enum": ["pump", "gear"],
    }
    assert part["properties"]["points"] == {
        "description": "What it brings; null when undecided.",
        "anyOf": [{"type": "number"}, {"type": "null"}],
        "default": None,
    }


@pytest.mark.parametrize("stored", FORMATS, ids=lambda stored: stored.name)
def test_the_published_schemas_are_those_of_the_classes(stored: Format[Any]) -> None:
    published = (ROOT / f"schemas/{stored.name}.schema.json").read_text(encoding="utf-8")

    assert published == schema_text(stored), "run: python -m ariac_score.schemas"


def test_every_field_of_a_published_schema_says_what_it_is() -> None:
    bare = [
        f"{stored.name}: {name}.{key}"
        for stored in FORMATS
        for name, part in {"": stored.schema(), **stored.schema()["$defs"]}.items()
        for key, value in part.get("properties", {}).items()
        if key != "schema" and "description" not in value
    ]

    assert bare == []


def test_a_result_keeps_the_published_schema_and_an_unknown_key_breaks_it(
    result: Result, tmp_path: Path
) -> None:
    data = json.loads(as_json(result))
    assert schema_errors(data, "result") == []

    data["measured"]["coverage"][0]["colour"] = "red"
    assert schema_errors(data, "result")[0][1] == "unknown key 'colour'"
    (tmp_path / "r.json").write_text(json.dumps(data))
    with pytest.raises(ResultError, match="unknown key 'colour'") as refused:
        load_result(tmp_path / "r.json")
    assert refused.value.place == "$.measured.coverage[0].colour"


def test_a_trace_leaves_out_what_says_nothing(result: Result) -> None:
    assert result.ledger is not None
    bare = structs.replace(result.ledger, children=(), trace=None, findings=(), subject="")

    assert set(json.loads(as_text(bare))) == {"path", "label", "kind", "amount", "value"}


# What a log leaves open --------------------------------------------------------------------


def test_what_is_open_is_stored_with_both_its_worlds_and_read_as_it_was() -> None:
    """Numbers are rounded as those of findings are, and decisions made before it became known do not hold."""
    result = load_result(EXAMPLE)
    clean = Finding("arm/ann", Verdict.SATISFIED, "far away", robustness=1 / 3, unit="m", check="separation")
    broken = replace(clean, verdict=Verdict.VIOLATED, robustness=-1 / 3, span=Span(0.1 + 0.2, 0.4))
    opened = OpenFindings(
        "separation",
        "arm/ann",
        best={"separation#best1": clean},
        worst={"separation#worst1": broken},
        causes=(Cause("a gap of 97 ms on /snapshot", "/snapshot", (Span(0.1 + 0.2, 0.397),)),),
        tight=True,
    )

    measured = replace(result.measured, open=(opened,))
    again = RESULT.decoded(RESULT.text(replace(result, measured=measured)).encode(), EXAMPLE)

    assert again.measured.open == measured.open
    assert '"open": [' not in as_json(result)  # as in documents of versions that did not know it
    assert again.measured.open[0].worst["separation#worst1"].span == Span(0.3, 0.4)
    assert measured_sha256(again) != measured_sha256(result)


def test_an_open_finding_of_another_check_is_refused() -> None:
    other = Finding("arm/ann", Verdict.SATISFIED, "far away", check="contact")

    with pytest.raises(ValueError, match="'contact' about 'arm/ann' stands among the open ones of 'sep"):
        OpenFindings("separation", "arm/ann", best={"separation#best1": other})
