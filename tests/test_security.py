"""What `docs/security.md` promises: each test it names exists, and what had none is tried here."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from ariac_score import load_result, load_rule_set, score_trial
from ariac_score.checks.contracts import Wanted
from ariac_score.documents.schema import strict_json
from ariac_score.errors import DataFileError, LogError, ResultError
from ariac_score.logs import gazebo_models, gazebo_states, jsonl
from ariac_score.logs.gazebo import GazeboStateReader
from ariac_score.results.codec import MAX_BYTES
from ariac_score.results.cohort_file import load_cohort
from ariac_score.results.result_file import as_json
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score.trial.channels import LogMap
from ariac_score_ariac.official.ariac_text import MAX_LINE_CHARS, PerformanceLogReader
from ariac_score_ariac.testing import kitting_trial
from ariac_score_rml.traces import read_events

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs/security.md").read_text(encoding="utf-8")
SHIPPED = [*sorted((ROOT / "ariac_score").rglob("*.py")), *sorted((ROOT / "plugins").rglob("*.py"))]
WANTED = Wanted(LogMap("none"))
LONG = 200_000  # what takes the square of it in steps is not done before the tests are given up


@pytest.fixture(scope="module")
def result_text(tmp_path_factory: pytest.TempPathFactory) -> str:
    log = write_trial_log(
        tmp_path_factory.mktemp("log") / "t.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS
    )
    return as_json(score_trial(log, "paper2020.published"))


# The page ------------------------------------------------------------------------------


def test_every_test_that_the_page_names_is_there() -> None:
    named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", PAGE)
    assert len(named) > 30
    for file, name in named:
        text = (ROOT / file).read_text(encoding="utf-8")
        assert not name or f"def {name}(" in text, (file, name)


TOLD_ONLY = ("## Who sends what, and how far they are trusted", "## What is not defended")
"""What needs no test: whom this is about, and what is no claim."""


def claims() -> Iterator[tuple[str, str]]:
    """Each row of a table and each point of a list that promises something, with its section."""
    for part in re.split(r"\n(?=## )", PAGE)[1:]:
        section, _, text = part.partition("\n")
        if section in TOLD_ONLY:
            continue
        for block in text.split("\n\n"):
            if block.lstrip().startswith("|"):
                yield from ((section, row) for row in block.strip().splitlines()[2:])
            elif block.lstrip().startswith("- "):
                yield from ((section, point) for point in re.split(r"\n(?=- )", block.strip()))


def test_no_claim_of_the_page_is_without_a_test() -> None:
    found = list(claims())
    without = [(section, claim[:80]) for section, claim in found if "`tests/" not in claim]

    assert len(found) > 35
    assert without == []


def test_every_section_that_claims_something_names_a_test() -> None:
    for part in re.split(r"\n(?=## )", PAGE)[1:]:
        assert part.partition("\n")[0] in TOLD_ONLY or "`tests/" in part, part[:80]


# Nothing that strangers send becomes code ---------------------------------------------------

NEVER_IMPORTED = {"pickle", "_pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve", "jsonpickle"}
NEVER_CALLED = {"eval", "exec", "compile", "__import__"}
UNSAFE_OF_YAML = {"load", "load_all", "unsafe_load", "full_load", "Loader", "UnsafeLoader", "FullLoader"}


RUNS_CODE = {"ariac_score/checks/local.py": {"calls compile", "calls exec"}}
"""A file beside a rule set, which whoever scores has allowed by hand or by its hash; no data of strangers."""


@pytest.mark.slow
def test_nothing_unpickles_evaluates_or_loads_unsafely() -> None:
    found = [
        f"{path.relative_to(ROOT)}, line {line}: {what}"
        for path in SHIPPED
        for line, what in unsafe_in(path.read_text(encoding="utf-8"))
        if what not in RUNS_CODE.get(path.relative_to(ROOT).as_posix(), ())
    ]

    assert len(SHIPPED) > 100
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("source", "what"),
    [
        ("import pickle", "imports pickle"),
        ("import json, marshal as m", "imports marshal"),
        ("from shelve import open", "imports shelve"),
        ("eval('1')", "calls eval"),
        ("yaml.unsafe_load(text)", "uses yaml.unsafe_load"),
        ("yaml.load(text, Loader=yaml.SafeLoader)", "uses yaml.load"),
        ("numpy.load(file, allow_pickle=True)", "gives allow_pickle"),
        ("subprocess.run(line, shell=False)", "gives shell"),
    ],
)
def test_what_is_unsafe_is_found_with_its_line(source: str, what: str) -> None:
    assert list(unsafe_in(f"import os\n{source}\n")) == [(2, what)]


def unsafe_in(text: str) -> Iterator[tuple[int, str]]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else [node.module or ""]
            tops = {name.partition(".")[0] for name in names}
            yield from ((node.lineno, f"imports {name}") for name in sorted(tops & NEVER_IMPORTED))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in NEVER_CALLED:
                yield node.lineno, f"calls {node.func.id}"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "yaml":
            if node.attr in UNSAFE_OF_YAML:
                yield node.lineno, f"uses yaml.{node.attr}"
        elif isinstance(node, ast.keyword) and node.arg in ("allow_pickle", "shell"):
            yield node.value.lineno, f"gives {node.arg}"


# JSON ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        '{"a": 1, "a": 1}',
        '{"b": {"a": 1, "c": 2, "a": 3}}',
        "NaN",
        "[Infinity]",
        "-Infinity",
        "{",
        "9" * 5000,
    ],
)
def test_json_with_two_meanings_or_none_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"twice|is not a number|Expecting|Exceeds"):
        strict_json(text)


def test_json_with_one_meaning_is_read() -> None:
    assert strict_json('{"a": {"a": [1, 2.5, null]}}') == {"a": {"a": [1, 2.5, None]}}


def _twice(text: str) -> str:
    return text.replace("{", '{"score": 99, ', 1)


def _nested(_: str) -> str:
    return "[" * 100_000


def _no_number(text: str) -> str:
    return text.replace('"score": 19.761677', '"score": NaN')


@pytest.mark.parametrize("change", [_twice, _nested, _no_number])
def test_a_result_of_two_meanings_is_refused(
    change: Callable[[str], str], result_text: str, tmp_path: Path
) -> None:
    file = tmp_path / "r.json"
    file.write_text(result_text, encoding="utf-8")
    assert load_result(file).score is not None
    file.write_text(change(result_text), encoding="utf-8")

    with pytest.raises(ResultError, match="not a result"):
        load_result(file)


def test_a_result_as_large_as_allowed_is_read_and_a_larger_one_is_not(
    result_text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "r.json"
    file.write_bytes(result_text.encode())
    size = file.stat().st_size
    assert size < MAX_BYTES
    monkeypatch.setattr("ariac_score.results.codec.MAX_BYTES", size)
    assert load_result(file).score is not None
    monkeypatch.setattr("ariac_score.results.codec.MAX_BYTES", size - 1)
    with pytest.raises(ResultError, match="larger than"):
        load_result(file)


def test_a_cohort_of_two_meanings_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "cohort.json"
    file.write_text('{"rules": 1, "rules": 2}')
    with pytest.raises(DataFileError, match="key 'rules' is given twice"):
        load_cohort(file, load_rule_set("ariac2024.official"))


# Lines ---------------------------------------------------------------------------------


def test_a_line_as_long_as_allowed_is_a_record_and_a_longer_one_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "t.jsonl"
    head = {"record": "trial", "format": jsonl.FORMAT, "id": "x", "clock": "simulated time", "witnessed": []}
    lines = [json.dumps(head) + "\n", json.dumps({"record": "end", "records": 2}) + "\n"]
    file.write_text("".join(lines))
    reader = jsonl.JsonLinesReader()
    monkeypatch.setattr(jsonl, "MAX_LINE_BYTES", len(lines[0]))
    assert reader.read(file, WANTED).id == "x"
    monkeypatch.setattr(jsonl, "MAX_LINE_BYTES", len(lines[0]) - 1)
    with pytest.raises(LogError, match="the line is longer than"):
        reader.read(file, WANTED)


def test_a_line_of_a_printed_log_that_never_ends_is_read_in_pieces(tmp_path: Path) -> None:
    file = tmp_path / "performance.log"
    said = (ROOT / "tests/data/performance_2020.log").read_text()
    file.write_text(said + "(10 0) [Dbg] " + "x" * 20 * MAX_LINE_CHARS + "\n")

    official = PerformanceLogReader().read(file, WANTED).official

    assert official is not None
    assert official.total == 28.0


# Regular expressions: what took the square or the cube of a length in steps ---------------------


def test_white_space_without_end_in_a_printed_value_ends(tmp_path: Path) -> None:
    file = tmp_path / "performance.log"
    text = (ROOT / "tests/data/performance_2020.log").read_text()
    file.write_text(text.replace("Total game score:", "Total game score" + " " * 60_000 + "x", 1))
    PerformanceLogReader().describe(file)


@pytest.mark.parametrize(
    "text",
    [
        b"<gazebo_version>" + b" " * LONG + b"<x",
        b"<deletions>" * LONG,
        b"<link name='" * LONG,
        b"<link name='" + b"''" * LONG,
        b"<pose" * LONG,
        b"<sim_time>" * LONG + b"9" * LONG,
        b"<model name='" * 3 + b" " * LONG,
    ],
    ids=lambda text: text[:12].decode(),
)
def test_half_a_tag_repeated_without_end_ends(text: bytes) -> None:
    for pattern in (
        gazebo_states._VERSION,
        gazebo_states._SIM_TIME,
        gazebo_states._DELETIONS,
        gazebo_states._NAME,
        gazebo_models._MODEL,
        gazebo_states._POSE,
    ):
        assert sum(1 for _ in pattern.finditer(text)) <= len(text)


def test_a_simulated_time_of_thousands_of_digits_is_corrupt(tmp_path: Path) -> None:
    file = tmp_path / "state.log"
    frame = f"<sdf><state><sim_time>{'9' * 5000} 0</sim_time></state></sdf>"
    chunks = "".join(f"<chunk encoding='txt'><![CDATA[{text}]]></chunk>" for text in ("<sdf></sdf>", frame))
    file.write_text(f"<gazebo_log>{chunks}</gazebo_log>")
    with pytest.raises(LogError):
        GazeboStateReader().read(file, WANTED)


def test_a_string_of_escapes_that_never_ends_ends() -> None:
    with pytest.raises(LogError):
        list(read_events('{"' + '\\"' * LONG))


def test_the_source_of_a_signal_may_be_as_long_as_it_says_and_no_longer() -> None:
    from ariac_score_standards.formula import MAX_SOURCE_LENGTH, _source  # noqa: PLC0415  # of plugins
    from ariac_score_stl.signals import StlError, parse_source  # noqa: PLC0415

    longest = "speed/" + "x" * (MAX_SOURCE_LENGTH - 6)
    assert _source("v", longest).quantity == "speed"
    with pytest.raises(ValueError, match="not quantity/subject"):
        _source("v", longest + "x")
    with pytest.raises(ValueError, match="not quantity/subject"):
        _source("v", "speed/a" + " " * LONG + "b")
    assert parse_source("v", "speed of " + "x" * 484 + " in m/s").unit == "m/s"
    with pytest.raises(StlError):
        parse_source("v", "speed in m" + " " * LONG + "x")
