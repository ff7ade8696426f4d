"""Conformance of the RML interpreter: what the reference says of whole folders of cases.

A case is one JSON file beside its specification and its traces. `--rml-cases DIR` runs
those of another folder; a folder that is given and holds none is a failure.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from ariac_score_rml.faults import RmlError
from ariac_score_rml.running import Run, compile_rml, run_trace
from ariac_score_rml.traces import read_events
from ariac_score_rml.tree import tree

DEFAULT_FOLDER = Path(__file__).parents[3] / "shared/rml/cases/own"

REFERENCE_BUG = "quirk_unbound_param_corrupted"
"""There a value leaks into a name that an event type left without one."""


class Case(NamedTuple):
    file: Path
    facts: dict[str, Any]

    @property
    def text(self) -> str:
        return (self.file.parent / self.facts["spec"]).read_text(encoding="utf-8")

    @property
    def refused(self) -> str:
        """Why the text must be refused; empty when it must not."""
        if self.facts["compile"].get("repaired"):
            return "syntax"
        return "" if self.facts["compile"]["ok"] else str(self.facts["compile"]["kind"])

    @property
    def dialect(self) -> Any:
        return "rosmonitoring" if "equivalent" in self.facts else "2024"

    def traces(self) -> Iterator[tuple[dict[str, Any], list[Any], str]]:
        """Each expectation, its events and its letters."""
        for run in self.facts.get("runs", ()):
            text = (self.file.parent / run["trace"]).read_text(encoding="utf-8")
            yield run, list(read_events(text)), letters_of(run["verdicts"])
        for walk in self.facts.get("walks", ()):
            yield walk, [self.facts["alphabet"][i] for i in walk["e"]], letters_of(walk["v"])


def letters_of(verdicts: str | list[tuple[str, int]]) -> str:
    """The letters up to the first error, after which the reference says nothing we follow."""
    whole = verdicts if isinstance(verdicts, str) else "".join(letter * count for letter, count in verdicts)
    return whole.partition("E")[0] + ("E" if "E" in whole else "")


def folder_of(config: pytest.Config) -> Path:
    given = config.getoption("--rml-cases")
    return Path(given) if given else DEFAULT_FOLDER


def cases_in(folder: Path) -> list[Case]:
    """The cases below a folder; JSON of another kind, such as a trace, is none."""
    found = [(file, facts_in(file)) for file in sorted(folder.rglob("*.json"))]
    return [Case(file, facts) for file, facts in found if "spec" in facts]


def facts_in(file: Path) -> dict[str, Any]:
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise pytest.UsageError(f"{file}: no RML case, for it is not JSON: {error}") from error
    return {"name": file.stem, **document} if isinstance(document, dict) else {}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    if "case" in metafunc.fixturenames:
        cases = cases_in(folder_of(metafunc.config))
        metafunc.parametrize("case", cases, ids=[case.facts["name"] for case in cases])


def test_the_folder_of_rml_cases_is_not_empty(request: pytest.FixtureRequest) -> None:
    folder = folder_of(request.config)
    if not folder.is_dir() and not request.config.getoption("--rml-cases"):
        pytest.skip("the folder of RML cases (../shared/rml/cases/own) is not here")
    assert cases_in(folder), f"no case in {folder}"


def test_a_text_is_refused_exactly_when_the_reference_refuses_or_repairs_it(case: Case) -> None:
    if not case.refused:
        compile_rml(case.text)
        return
    with pytest.raises(RmlError) as refused:
        compile_rml(case.text)

    assert refused.value.kind == case.refused
    if case.refused == "syntax":
        assert refused.value.line >= 1


def test_the_text_is_read_as_the_reference_reads_it(case: Case) -> None:
    if "equations" not in case.facts:
        pytest.skip("the case says nothing about it")

    assert tree(compile_rml(case.text).spec) == case.facts["equations"]


def test_every_trace_gets_the_letters_of_the_reference(case: Case) -> None:
    if case.facts["name"] == REFERENCE_BUG:
        pytest.skip("the reference is wrong here, as its description says")
    if case.refused and case.dialect == "2024":
        pytest.skip("it is refused")
    machine = compile_rml(case.text, dialect=case.dialect).machine()
    for expected, events, letters in case.traces():
        run = run_trace(machine, events)
        assert run.initial == expected["initial"]
        if run.initial != "E":
            assert run.letters == letters
        if "accepted" in expected:
            assert_outcome(run, expected)


def assert_outcome(run: Run, expected: dict[str, Any]) -> None:
    assert run.accepted is expected["accepted"]
    assert (run.error is not None) is ("error" in expected)
    assert expected.get("rejected_at", 0) == (len(run.letters) if run.end == "F" else 0)


# The harness itself --------------------------------------------------------------------

SPEC = "one matches {event: 'one'};\nMain = one;\n"


def made(folder: Path, **facts: Any) -> Case:
    """A specification of the one event `one`, with a trace of it, in a folder of its own."""
    below = folder / "basic"
    below.mkdir()
    (below / "one.rml").write_text(SPEC, encoding="utf-8")
    (below / "one.jsonl").write_text('{"event": "one"}\n', encoding="utf-8")
    run = {"trace": "one.jsonl", "initial": "f", "verdicts": "t", "accepted": True}
    document = {"spec": "one.rml", "compile": {"ok": True}, "runs": [run], **facts}
    (below / "one.json").write_text(json.dumps(document), encoding="utf-8")
    (case,) = cases_in(folder)
    return case


def test_a_case_of_a_folder_elsewhere_needs_no_name_and_no_note(tmp_path: Path) -> None:
    (tmp_path / "trace.json").write_text("[1, 2]", encoding="utf-8")
    (tmp_path / "number.json").write_text("7", encoding="utf-8")
    case = made(tmp_path)

    assert case.facts["name"] == "one"
    test_a_text_is_refused_exactly_when_the_reference_refuses_or_repairs_it(case)
    test_every_trace_gets_the_letters_of_the_reference(case)


@pytest.mark.parametrize(
    "wrong", [{"initial": "t"}, {"verdicts": "F"}, {"accepted": False}, {"error": {"at": 1}}], ids=str
)
def test_a_wrong_expectation_fails(wrong: dict[str, Any], tmp_path: Path) -> None:
    run = {"trace": "one.jsonl", "initial": "f", "verdicts": "t", "accepted": True, **wrong}
    with pytest.raises(AssertionError):
        test_every_trace_gets_the_letters_of_the_reference(made(tmp_path, runs=[run]))


def test_a_file_that_is_no_json_is_named(tmp_path: Path) -> None:
    (tmp_path / "broken.json").write_text("{", encoding="utf-8")

    with pytest.raises(pytest.UsageError, match=r"broken\.json: no RML case"):
        cases_in(tmp_path)
