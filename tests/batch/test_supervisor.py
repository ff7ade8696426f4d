"""The supervisor believes nothing that a run, its files or its process leave behind."""

from __future__ import annotations

import argparse
import json
import os
import runpy
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from ariac_score.batch import looking, supervise
from ariac_score.batch.index import read_rows
from ariac_score.batch.local import lost
from ariac_score.batch.looking import signatures
from ariac_score.batch.patience import Patience
from ariac_score.batch.state import RunUnderWay, State, Waiting
from ariac_score.batch.store import Store
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask, plan_batch
from ariac_score.batch.worker import Done, note_file, noted, parse_report, report_of, running_file
from ariac_score.cli import main
from ariac_score.cli.batch_progress import BatchProgress
from ariac_score.installed.running import noted as last_noted
from ariac_score.scoring.ruleset import load_rule_set

TASK = RunTask("", "a.jsonl", 1, "a.jsonl")
SETTING = BatchSetting.of(load_rule_set("paper2020.published"), Limits())


@pytest.fixture
def season(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "season"
    folder.mkdir()
    for name in "ab":
        (folder / f"{name}.jsonl").write_text("hello\n")
    return folder


@dataclass
class Answers:
    """An executor that brings whatever its processes are said to have left."""

    document: bytes
    address: str = "0" * 64

    def run(self, tasks: Iterator[RunTask], setting: BatchSetting) -> Iterator[Done]:
        del setting
        for task in tasks:
            good = lost(task, "unreadable", "as it is")
            yield replace(good, document=self.document, address=self.address) if "a" in task.trial else good


def outcomes(season: Path, out: Path, executor: supervise.Executor) -> dict[str, tuple[str, str]]:
    store, plan, found = Store(out), plan_batch(season, "paper2020.published"), {}

    def on_outcome(key: tuple[str, str, int], outcome: str, reason: str) -> None:
        found[key[1][:1]] = (outcome, reason)

    with store.working() as work:
        supervise.run_batch(
            plan.tasks,
            load_rule_set("paper2020.published"),
            SETTING,
            store,
            work,
            executor,
            name="x",
            on_outcome=on_outcome,
        )
    return found


@pytest.mark.parametrize(
    "left",
    [b"", b"\x00\xff", b"{}", b"[" * 200_000, b'{"schema": "ariac-score/outcome/1", "outcome": 3}'],
    ids=["nothing", "bytes", "no schema", "deep", "other kinds"],
)
def test_what_a_process_left_that_is_no_result_costs_its_run_alone(
    season: Path, tmp_path: Path, left: bytes
) -> None:
    found = outcomes(season, tmp_path / "out", Answers(left))

    assert found == {
        "a": ("failed", "what its process left is no result"),
        "b": ("unreadable", "as it is"),
    }
    assert not list((tmp_path / "out/objects").rglob("*.json"))


@pytest.mark.parametrize("address", ["../../../etc", "/etc", "0" * 63, "0" * 65, "G" * 64])
def test_an_address_that_is_none_is_not_taken_from_a_report(address: str) -> None:
    report = report_of(Done(TASK, "0" * 64, "1" * 64, "", b"{}"))
    assert parse_report(TASK, report).address == "0" * 64

    with pytest.raises(ValueError, match="its address is none"):
        parse_report(TASK, report.replace(b'"' + b"0" * 64, b'"' + address.encode()))


def test_a_head_without_end_is_no_report() -> None:
    with pytest.raises(ValueError, match="nested without end"):
        parse_report(TASK, b"[" * 500_000 + b"\n")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
def test_notes_that_are_pipes_or_have_no_end_are_not_waited_for(tmp_path: Path) -> None:
    report = tmp_path / "1.report"
    os.mkfifo(note_file(report))
    os.mkfifo(running_file(report))
    assert (noted(report), last_noted(running_file(report))) == (("", ""), (0, ""))
    for file in (note_file(report), running_file(report)):
        file.unlink()
        with file.open("wb") as out:
            out.truncate(1 << 40)  # sparse
    assert (noted(report), last_noted(running_file(report))) == (("", ""), (0, ""))


def test_files_of_a_run_nobody_knows_are_not_looked_at_here(monkeypatch: pytest.MonkeyPatch) -> None:
    looked = []
    monkeypatch.setattr(looking, "signature_of", lambda task: looked.append(task.trial) or "s")
    tasks = [replace(TASK, trial=str(number)) for number in range(200)]

    found = list(signatures(tasks, lambda task: task.trial in {"3", "150"}))

    assert looked == ["3", "150"]
    assert [task.trial for task, signature in found if signature] == ["3", "150"]
    assert [task.trial for task, _ in found] == [task.trial for task in tasks]


def test_a_file_system_that_does_not_answer_is_left_and_its_runs_go_to_processes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    answers, tasks = threading.Event(), [replace(TASK, trial=str(number)) for number in range(130)]

    def look(task: RunTask) -> str:
        if task.trial == "5":
            answers.wait()
        return "s"

    monkeypatch.setattr(looking, "signature_of", look)
    monkeypatch.setattr(looking, "ANSWER_S", 0.05)
    found = {task.trial: signature for task, signature in signatures(tasks, lambda _task: True)}
    answers.set()

    assert {int(trial) for trial, signature in found.items() if not signature} == set(range(64))


def test_a_wait_has_a_name_and_an_end_while_it_lasts(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, seen = [0.0], []
    monkeypatch.setattr("ariac_score.batch.patience.time.monotonic", lambda: clock[0])
    patience = Patience("tcp://here:1", lambda: 0, SETTING, seen.append)
    patience.reset()
    for clock[0] in (5.0, 10.0):
        patience.check()

    assert [state.waiting for state in seen] == [
        Waiting("no_workers", "tcp://here:1", waited_s, 300.0) for waited_s in (5.0, 10.0)
    ]


def test_without_a_terminal_a_wait_and_a_long_run_have_a_line_a_minute(
    capsys: pytest.CaptureFixture[str],
) -> None:
    shown = BatchProgress(argparse.Namespace(verbosity=0))
    for second in range(5, 131, 5):
        waiting = Waiting("no_workers", "tcp://here:1", second, 300.0)
        run = RunUnderWay(("aurora", "kitting", 2), second, "check 'separation': plugin x (y 1.0)")
        shown.on_state(State((run,), waiting))

    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if "no_workers" in line] == [
        f"waiting: no_workers at tcp://here:1 for {second} s; given up after 300 s" for second in (5, 65, 125)
    ]
    assert [line for line in lines if "kitting" in line] == [
        f"aurora/kitting_2: for {second} s, check 'separation': plugin x (y 1.0)" for second in (60, 120)
    ]


def test_what_a_run_does_is_bounded_and_cannot_steer_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    shown = BatchProgress(argparse.Namespace(verbosity=0))
    shown.on_state(State((RunUnderWay(("", "\x1b[2J", 1), 90.0, "x" * 10_000),)))

    (line,) = capsys.readouterr().err.splitlines()
    assert "\x1b" not in line
    assert len(line) <= 100


def test_a_report_names_its_run_alone() -> None:
    report = report_of(Done(TASK, "", "", "", b"{}"))

    assert json.loads(report.split(b"\n")[0])["path"] == "a.jsonl"
    with pytest.raises(ValueError, match=r"it is a report of a\.jsonl"):
        parse_report(replace(TASK, path="b.jsonl"), report)


# Between calls: a few of each kind here; `benchmarks/faults.py` injects as many as is asked.

FAULTS = Path(__file__).parents[2] / "benchmarks/faults.py"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
@pytest.mark.parametrize("name", ["runs.jsonl", "index.sqlite", ".rows.jsonl", "batch.json", "rules.yaml"])
def test_a_pipe_in_the_place_of_a_table_is_not_waited_for(season: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / "out"
    good = outcomes(season, out, Answers(lost(TASK, "unreadable", "x").document or b"", ""))
    whole = {file.name: file.read_bytes() for file in out.iterdir() if file.is_file()}
    (out / name).unlink(missing_ok=True)
    os.mkfifo(out / name)

    assert outcomes(season, out, Answers(lost(TASK, "unreadable", "x").document or b"", "")) == good
    assert {file.name: file.read_bytes() for file in out.iterdir() if file.is_file()} == whole


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with names")
@pytest.mark.parametrize("command", [["merge", "{to}", "{out}"], ["export", "{out}", "-o", "{to}.csv"]])
@pytest.mark.parametrize("name", ["runs.jsonl", "index.sqlite"])
def test_a_pipe_in_the_place_of_a_table_is_refused_by_who_reads_it(
    season: Path, tmp_path: Path, name: str, command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    outcomes(season, out, Answers(lost(TASK, "unreadable", "x").document or b"", ""))
    (out / name).unlink()
    os.mkfifo(out / name)

    code = main([word.format(out=out, to=tmp_path / "to") for word in command])

    assert code in {4, 7}
    assert "error: " in capsys.readouterr().err


def test_a_table_without_line_ends_is_no_table(tmp_path: Path) -> None:
    with (tmp_path / "runs.jsonl").open("wb") as out:
        out.truncate(1 << 40)  # sparse

    assert list(read_rows(tmp_path / "runs.jsonl")) == []


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_small_season_of_every_fault_ends_as_if_nothing_had_happened(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("XDG_CACHE_HOME", "TMPDIR"):
        monkeypatch.setenv(name, str(tmp_path))
    faults = runpy.run_path(str(FAULTS))
    mounting = {"a disk of 4 to 236 KiB (tmpfs)", "read-only from the n-th run on"}
    kinds = [name for name in faults["FAULTS"] if os.geteuid() == 0 or name not in mounting]

    assert faults["main"](["--runs", "4", "--times", "1", "--faults", *kinds]) == 0

    said = capsys.readouterr().out
    assert sum(line.endswith("| 0 |") for line in said.splitlines()) == len(kinds)
