"""Judged while it goes on and judged afterwards: the same, from the command line to the bytes."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

websocket = pytest.importorskip(
    "websocket", reason="websocket-client, the monitors' library, is not installed"
)
pytest.importorskip("websockets", reason="the extra `live` is not installed")

from ariac_score.checks.registry import Registry  # noqa: E402
from ariac_score.cli import main  # noqa: E402  # after the libraries are there
from ariac_score.errors import RuleSetError  # noqa: E402
from ariac_score.oracle.conversation import Conversation  # noqa: E402
from ariac_score.oracle.judges import SpecBench  # noqa: E402
from ariac_score.oracle.replay import replay  # noqa: E402
from ariac_score.testing import write_event_log  # noqa: E402
from ariac_score_ariac.testing import kitting_trial  # noqa: E402
from ariac_score_ariac.testing.recordings import recorded_messages  # noqa: E402

pytestmark = pytest.mark.slow  # servers on this machine

ROOT = Path(__file__).parents[2]
FOUR_WAYS = ROOT / "examples/live/four_ways.yaml"
SEPARATION = ROOT / "examples/rml/separation.rml"
TIMEOUT_S = 60.0


@contextmanager
def oracle(*arguments: str, out: Path) -> Iterator[str]:
    """The command, running; interrupted at the end, as a user does."""
    command = [sys.executable, "-m", "ariac_score.cli", "oracle", *arguments, "--port", "0", "-o", str(out)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            yield process.stderr.readline().removeprefix("listening on ").strip()
            os.kill(process.pid, signal.SIGINT)
            _, complaints = process.communicate(timeout=TIMEOUT_S)
        finally:
            process.kill()
        assert process.returncode == 0, complaints


def ask(url: str, events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    client = websocket.create_connection(url, timeout=TIMEOUT_S)
    replies = []
    for event in events:
        client.send(json.dumps(event))
        replies.append(json.loads(client.recv()))
    client.close()
    return replies


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example trial, as a monitor would log it."""
    folder = tmp_path_factory.mktemp("live")
    return write_event_log(folder / "events.jsonl", recorded_messages(kitting_trial()))


class Demonstration(NamedTuple):
    shown: str
    results: Path


@pytest.fixture(scope="module")
def demonstration(recorded: Path, tmp_path_factory: pytest.TempPathFactory) -> Demonstration:
    """What docs/rosmonitoring.md shows, done."""
    out = tmp_path_factory.mktemp("demonstration") / "results"
    with oracle("--rules", str(FOUR_WAYS), out=out) as url:
        command = [sys.executable, str(ROOT / "examples/live/monitor.py"), str(recorded), url]
        shown = subprocess.run(command, capture_output=True, text=True, check=True, timeout=TIMEOUT_S).stdout
    return Demonstration(shown, out)


def test_the_demonstration_gives_equal_results_live_and_afterwards(
    demonstration: Demonstration, recorded: Path, tmp_path: Path
) -> None:
    live = demonstration.results / "connection_001"
    afterwards = tmp_path / "afterwards.json"
    scored = ["score", str(recorded), "--rules", str(FOUR_WAYS), "--output-format", "json"]
    assert main([*scored, "-o", str(afterwards)]) == 0
    result = json.loads(afterwards.read_text(encoding="utf-8"))
    ours = json.loads(live.with_suffix(".result.json").read_text(encoding="utf-8"))
    assert live.with_suffix(".jsonl").read_bytes() == recorded.read_bytes()
    assert ours["score"] == result["score"] == 19.761677
    assert ours["measured"]["findings"] == result["measured"]["findings"]
    assert ours["ledger"] == result["ledger"]
    # All four found the same approach at once, at the instant at which it begins in the findings.
    violation = result["measured"]["findings"]["separation#1"]
    first = re.search(r"snapshot at ([0-9.]+) s: currently_false: (.*)", demonstration.shown)
    assert first is not None
    assert float(first[1]) == violation["span"]["start_s"]
    for name in ("separation", "in_rml", "in_temporal_logic", "as_a_formula"):
        assert f"{name}: robot/human: " in first[2]
        assert result["measured"]["findings"][f"{name}#1"]["span"] == violation["span"]


def test_scoring_the_log_of_the_oracle_writes_its_result_again_to_the_byte(
    demonstration: Demonstration, tmp_path: Path
) -> None:
    log, again = demonstration.results / "connection_001.jsonl", tmp_path / "again.json"

    assert (
        main(["score", str(log), "--rules", str(FOUR_WAYS), "--output-format", "json", "-o", str(again)]) == 0
    )

    assert again.read_bytes() == log.with_suffix(".result.json").read_bytes()


def test_the_page_shows_what_the_demonstration_prints(demonstration: Demonstration) -> None:
    page = " ".join((ROOT / "docs/rosmonitoring.md").read_text(encoding="utf-8").split())

    for line in demonstration.shown.splitlines():
        assert line in page


@pytest.mark.parametrize("after", ["once", "resume"])
def test_a_specification_is_judged_live_as_the_log_is_afterwards(
    recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], after: str
) -> None:
    events = [json.loads(line) for line in recorded.read_text(encoding="utf-8").splitlines()]
    out = tmp_path / "out"
    with oracle("--spec", str(SEPARATION), "--after-violation", after, out=out) as url:
        replies = ask(url, events)

    log = out / "connection_001.jsonl"
    code = main(["rml", "run", str(SEPARATION), str(log)])
    letters = "".join(re.findall(r"^letters +(\w+)", capsys.readouterr().out, re.MULTILINE))
    words = {"T": "true", "t": "currently_true", "f": "currently_false", "F": "false"}
    verdicts = [reply["verdict"] for reply in replies]
    rejected = letters.index("F")
    assert code == 1
    assert verdicts[:rejected] == [words[letter] for letter in letters[:rejected]]
    if after == "once":  # as the reference: rejected for ever
        assert set(verdicts[rejected:]) == {"false"}
    else:
        assert verdicts[rejected] == "currently_false"
        assert verdicts[-1] == "currently_true"
    assert replies[rejected]["spec"] == "'snapshot' is rejected: it is no 'safe'"
    report = json.loads((out / "oracle.json").read_text(encoding="utf-8"))
    (connection,) = report["connections"]
    assert report["judged_by"] == "separation.rml"
    assert connection["verdicts"] == {verdict: verdicts.count(verdict) for verdict in verdicts}
    assert log.read_bytes() == recorded.read_bytes()


def conversation(spec: str, tmp_path: Path, **parameters: Any) -> Conversation:
    file = tmp_path / "some.rml"
    file.write_text(spec, encoding="utf-8")
    return Conversation(SpecBench(file, Registry(), parameters).judge(), tmp_path / "log.jsonl")


def test_what_a_specification_cannot_judge_is_unknown_counted_and_forgotten(tmp_path: Path) -> None:
    talk = conversation("low matches {topic:'x', n:n} with n < 3; Main = low*;", tmp_path)
    frames = [
        '{"topic": "x", "n": 1}',
        '{"topic": "x", "n": "two"}',  # a string compared with a number
        '{"topic": "x", "n": null}',
        "[1]",
        '{"topic": "x", "n": 2}',
        '{"topic": "x"}',  # a missing field: no event of the type
    ]

    verdicts = [json.loads(talk.answer(frame))["verdict"] for frame in frames]
    talk.close("tested")

    assert verdicts == ["currently_true", "unknown", "unknown", "unknown", "currently_true", "false"]
    assert (talk.unjudged, talk.bad_frames) == (2, 1)
    assert "string 'two'" in talk.first_fault


def test_a_state_that_grows_without_bound_is_answered_and_named(tmp_path: Path) -> None:
    spec = "a(x) matches {topic:'x', n:x}; Main = ({let x; a(x) Main} | never)?;"
    talk = conversation(spec, tmp_path, max_state=60)

    replies = [json.loads(talk.answer(json.dumps({"topic": "x", "n": n}))) for n in range(200)]
    talk.close("tested")

    assert len(replies) == 200
    assert replies[-1]["verdict"] == "unknown"
    assert "'Main'" in talk.first_fault
    assert "grown beyond" in talk.first_fault


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("Main = ;", "line 1, column 8"),
        ("Main = " + "(" * 10_000 + "a" + ")" * 10_000 + ";", "nest"),
        ("Main = Main;", "without an event in between"),
        ("Main = Other;", "Other"),
        ("", "no specification"),
    ],
)
def test_a_specification_that_is_none_is_refused_with_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, words: str
) -> None:
    file = tmp_path / "bad.rml"
    file.write_text(text, encoding="utf-8")

    with pytest.raises(RuleSetError, match=words):
        SpecBench(file, Registry())
    assert main(["oracle", "--spec", str(file), "-o", str(tmp_path / "out")]) == 4
    printed = capsys.readouterr()
    assert printed.out == ""
    assert "bad.rml" in printed.err
    assert words in printed.err


def test_the_older_dialect_is_a_choice(tmp_path: Path) -> None:
    spec = "at(p) matches {topic:'x', p:p}; Main = at('home')*;"
    talk = conversation(spec, tmp_path, dialect="rosmonitoring")

    assert json.loads(talk.answer('{"topic": "x", "p": "home"}'))["verdict"] == "currently_true"
    assert json.loads(talk.answer('{"topic": "x", "p": "away"}'))["verdict"] == "false"
    talk.close("tested")


GUARD = """
dropped matches {topic: 'chatter', data: 'drop'};
negative matches {service: 'add_two_ints', request: {a: a}} with a < 0;
bad matches dropped | negative;
good not matches bad;
Main = good*;
"""
"""What the oracle of the recorded run asked of the cell, as its verdicts show it."""


@pytest.mark.parametrize("name", ["cell_guard_status.jsonl", "cell_guard_oracle.jsonl"])
def test_a_recorded_run_of_a_generated_node_gets_the_verdicts_it_got(
    shared: Path, tmp_path: Path, name: str
) -> None:
    file = tmp_path / "guard.rml"
    file.write_text(GUARD, encoding="utf-8")
    bench = SpecBench(file, Registry(), {"after_violation": "resume"})

    found = replay(shared / "rosmonitoring/data/generated" / name, bench)

    assert (found.agreeing, found.undecided, found.without, found.differences) == (8, 0, 0, ())


def test_a_recorded_run_that_was_judged_otherwise_is_told_apart(shared: Path, tmp_path: Path) -> None:
    file = tmp_path / "guard.rml"
    file.write_text(GUARD.replace("a < 0", "a < -1"), encoding="utf-8")
    bench = SpecBench(file, Registry(), {"after_violation": "resume"})

    found = replay(shared / "rosmonitoring/data/generated/cell_guard_oracle.jsonl", bench)

    assert [(one.channel, one.theirs) for one in found.differences] == [
        ("/add_two_ints/request", "currently_false")
    ]


def decided(row: dict[str, Any], verdict: str) -> tuple[bool, str]:
    """Whether a generated node blocks, and what it writes: the same for both generations."""
    if row["direction"] == "response":
        return False, "response_logged"
    if row["action"] == "log":
        return False, "logged"
    negative = verdict in ("false", "currently_false")
    return negative, "blocked" if negative else "forwarded"


@pytest.mark.parametrize("name", ["cell_guard", "ordered_cell_log"])
def test_generated_nodes_log_and_filter_with_our_oracle_as_with_theirs(
    shared: Path, tmp_path: Path, name: str
) -> None:
    status = shared / f"rosmonitoring/data/generated/{name}_status.jsonl"
    recorded_rows = [json.loads(line) for line in status.read_text(encoding="utf-8").splitlines()]
    seen = [row for row in recorded_rows if row["status"] == "event"]
    spec = tmp_path / "guard.rml"
    spec.write_text(GUARD, encoding="utf-8")

    with oracle("--spec", str(spec), "--after-violation", "resume", out=tmp_path / "out") as url:
        replies = ask(url, [row["event"] for row in seen])

    assert {row["action"] for row in seen} == ({"log", "filter"} if name == "cell_guard" else {"log"})
    for row, reply in zip(seen, replies, strict=True):
        # Version 3 reads `verdict`; older nodes rebuild the message from all that is left, and read `spec`.
        verdict = str(reply["verdict"])
        assert decided(row, verdict) == (row["blocked"], row["decision"])
        left = {key: value for key, value in reply.items() if key not in ("verdict", "spec")}
        assert left == row["event"]
        assert ("spec" in reply) == (verdict in ("false", "currently_false"))


def test_a_specification_that_ends_at_its_first_violation_warns_of_what_nodes_do(
    tmp_path: Path,
) -> None:
    spec, words = tmp_path / "guard.rml", {}
    spec.write_text(GUARD, encoding="utf-8")
    for after, count in (("once", 3), ("resume", 2)):  # where it listens, what it judges, the warning
        command = [sys.executable, "-m", "ariac_score.cli", "oracle", "--spec", str(spec), "--port", "0"]
        with subprocess.Popen(
            [*command, "--after-violation", after, "-o", str(tmp_path / after)],
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            assert process.stderr is not None
            lines = [process.stderr.readline() for _ in range(count)]
            os.kill(process.pid, signal.SIGINT)
            words[after] = "".join(lines) + process.communicate(timeout=TIMEOUT_S)[1]

    assert "nodes of version 3 that only log end themselves" in words["once"]
    assert "end themselves" not in words["resume"]


def test_the_demonstration_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "websocket.py").write_text("raise ModuleNotFoundError('no websocket')\n", encoding="utf-8")
    command = [sys.executable, str(ROOT / "examples/live/monitor.py"), "events.jsonl", "ws://127.0.0.1:1"]

    done = subprocess.run(
        command,
        env={"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT_S,
    )

    assert done.returncode == 1
    assert "pip install websocket-client" in done.stderr
    assert "Traceback" not in done.stderr
