"""`ariac-score rml`: what it prints where, and the exit codes of verdicts."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.testing.bags import Storage, write_bag
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

ROOT = Path(__file__).parents[2]
SEPARATION = ROOT / "examples/rml/separation.rml"
NEAR_MISS = ROOT / "examples/kitting_near_miss.mcap"
SPEC = "a matches {x:v} with v >= 3;\nb matches {x:2};\n\nMain = a b;\n"


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "spec.rml"
    path.write_text(SPEC, encoding="utf-8")
    return path


def trace(folder: Path, text: str) -> Path:
    path = folder / "trace.jsonl"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("events", "code", "letters", "verdict"),
    [
        ('{"x":3}\n{"x":2}\n', 0, "ft", "accepted"),
        ('{"x":3}', 1, "f", "rejected: the trace ends too early"),
        ('{"x":3}{"x":1}{"x":2}', 1, "fF", "rejected at event 2"),
        ('{"x":"3"}', 6, "E", "cannot be judged"),
        ("", 1, "", "rejected: the trace ends too early"),
        ("7", 1, "F", "rejected at event 1"),
    ],
)
def test_the_exit_code_of_a_run_is_its_verdict(
    spec: Path, capsys: pytest.CaptureFixture[str], events: str, code: int, letters: str, verdict: str
) -> None:
    assert main(["rml", "run", str(spec), str(trace(spec.parent, events))]) == code

    printed = capsys.readouterr()
    assert printed.out == f"initial  f\nletters  {letters}\nverdict  {verdict}\n"
    assert bool(printed.err) is (code == 6)


def test_a_run_can_be_printed_as_json(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = trace(spec.parent, '{"x":3} {"x":"y"} {"x":1}')
    assert main(["rml", "run", str(spec), str(path), "--output-format", "json"]) == 1
    assert json.loads(capsys.readouterr().out) == {
        "initial": "f",
        "letters": "fF",
        "accepted": False,
        "rejected_at": 2,
    }

    path = trace(spec.parent, '{"x":"y"}')
    assert main(["rml", "run", str(spec), str(path), "--output-format", "json"]) == 6
    assert json.loads(capsys.readouterr().out)["error"] == {
        "at": 1,
        "kind": "type_error",
        "cause": "'v' is the string 'y' where a number is needed",
    }


def test_an_error_names_event_and_cause(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["rml", "run", str(spec), str(trace(spec.parent, '{"x":null}'))])

    assert "error: event 1: 'v' is null where a number is needed" in capsys.readouterr().err


def test_a_verdict_that_hangs_on_the_tolerance_is_said(
    spec: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = trace(spec.parent, '{"x":2.99999999999} {"x":2}')

    assert main(["rml", "run", str(spec), str(path)]) == 0
    assert "1 comparisons hang on the tolerance" in capsys.readouterr().err
    assert main(["rml", "run", "--exact", str(spec), str(path)]) == 1


@pytest.mark.parametrize(
    ("name", "storage"), [("x.mcap", "mcap"), ("x.bag", "ros1"), ("x.db3", "sqlite3")], ids=str
)
def test_every_message_of_a_recording_is_an_event(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, storage: Storage
) -> None:
    recording = tmp_path / name
    write_bag(recording, recorded_messages(kitting_trial(), motion="snapshot"), storage=storage)

    assert main(["rml", "run", str(SEPARATION), str(recording)]) == 1

    # The snapshot at 18.81 s is the 1882nd; start, two orders and a submission with its event come before.
    assert capsys.readouterr().out.splitlines()[-1] == "verdict  rejected at event 1887"


def test_a_trace_cut_in_a_line_is_refused_at_its_place(
    spec: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = trace(spec.parent, '{"x":3}\n{"x":')

    assert main(["rml", "run", str(spec), str(path)]) == 6
    assert f"{path}: event 2, line 2, column 6: the trace ends in the middle" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["run", "SPEC", "missing.jsonl"], 6, "missing.jsonl: the trace cannot be read"),
        (["run", "SPEC", "missing.mcap"], 6, "missing.mcap"),
        (["run", "SPEC", "SPEC", "--events", "bag"], 6, "spec.rml"),
        (["run", "missing.rml", "SPEC"], 4, "missing.rml: the specification cannot be read"),
        (["check", "missing.rml"], 4, "missing.rml"),
        (["run", "SPEC", "SPEC", "--events", "csv"], 4, "--events cannot be 'csv'"),
    ],
    ids=range(6),
)
def test_what_cannot_be_read_is_said(
    spec: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, said: str
) -> None:
    words = [str(spec) if word == "SPEC" else word for word in arguments]
    try:
        found = main(["rml", *words])
    except SystemExit as left:
        found = int(left.code or 0)

    assert found == code
    assert said in capsys.readouterr().err


def test_check_says_what_is_sound_and_what_is_odd(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rml", "check", str(spec)]) == 0
    assert capsys.readouterr().out == f"{spec}: sound, 2 event types, 1 equations\n"

    spec.write_text("Main = c;", encoding="utf-8")
    assert main(["rml", "check", str(spec)]) == 0
    assert "warning: " in capsys.readouterr().err

    spec.write_text("Main = a\n", encoding="utf-8")
    assert main(["rml", "check", str(spec)]) == 4
    assert f"{spec}: line 2, column 1: ';' was expected" in capsys.readouterr().err


def test_format_prints_the_one_form_and_can_only_compare(
    spec: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rml", "format", "--check", str(spec)]) == 1
    assert main(["rml", "format", str(spec), "-o", str(spec)]) == 0
    assert spec.read_text() == SPEC.replace("{x:", "{x: ")
    assert main(["rml", "format", "--check", str(spec)]) == 0
    assert main(["rml", "format", "--check", str(SEPARATION)]) == 0
    capsys.readouterr()


def test_the_older_dialect_is_asked_for(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec.write_text("p(x) matches {n:x}; Main = p(_) p('s');", encoding="utf-8")
    path = trace(spec.parent, '{"n":1}{"n":"s"}')

    assert main(["rml", "run", str(spec), str(path)]) == 4
    assert "dialect rosmonitoring" in capsys.readouterr().err
    assert main(["rml", "run", "--dialect", "rosmonitoring", str(spec), str(path)]) == 0


def test_a_text_that_is_not_utf_8_is_refused(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec.write_bytes(b"Main = \xff;")

    assert main(["rml", "check", str(spec)]) == 4
    assert "byte 7: the specification is not UTF-8 text" in capsys.readouterr().err


def test_a_state_that_grows_without_bound_names_its_equation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "grows.rml"
    spec.write_text("a matches {x:1}; Main = a Grows; Grows = a (Grows | a);", encoding="utf-8")
    events = trace(tmp_path, '{"x":1}\n' * 200)

    assert main(["rml", "run", str(spec), str(events), "--max-state", "100"]) == 6

    shown = capsys.readouterr()
    assert "cannot be judged" in shown.out
    assert "beyond 100 parts, most of them of equation 'Grows'" in shown.err


@pytest.mark.parametrize("most", ["0", "-1", "many", "1e3"])
def test_a_limit_that_is_none_is_refused(spec: Path, tmp_path: Path, most: str) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["rml", "run", str(spec), str(trace(tmp_path, "")), f"--max-state={most}"])

    assert refused.value.code == 4
