"""Faults of the machine: kills at random, a clock that is set back, folders that may not be written."""

from __future__ import annotations

import errno
import json
import os
import runpy
import time
from pathlib import Path

import pytest

from ariac_score.batch import store
from ariac_score.cli import main
from ariac_score.testing import SNAPSHOT_SIGNALS, kitting_trial, write_trial_log

RULES = "paper2020"
SEASON = Path(__file__).parents[2] / "benchmarks/season.py"


@pytest.fixture
def trials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "trials"
    folder.mkdir()
    write_trial_log(folder / "a.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    (folder / "b.jsonl").write_text("hello\n")
    return folder


def batch(trials: Path, out: Path) -> int:
    return main(["batch", str(trials), "--rules", RULES, "-o", str(out), "-j", "1"])


def outcomes(out: Path) -> dict[str, str]:
    rows = [json.loads(line) for line in (out / "runs.jsonl").read_text(encoding="ascii").splitlines()]
    return {row["trial"]: row["outcome"] for row in rows}


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.mark.skipif(
    not Path("/proc/self/stat").is_file(), reason="who began which process is read from /proc"
)
def test_a_season_of_kills_is_as_if_nothing_had_happened(capsys: pytest.CaptureFixture[str]) -> None:
    season = runpy.run_path(str(SEASON))["main"]

    assert season(["--trials", "10", "--kills", "3", "--supervisor-kills", "1"]) == 0

    said = capsys.readouterr().out
    assert "every run is there once: yes" in said
    assert "diff -r: no difference" in said
    assert "10 runs, 1 of them broken" in said


def test_a_log_that_changes_while_the_clock_is_set_back_is_scored_again(trials: Path, tmp_path: Path) -> None:
    log, out = trials / "a.jsonl", tmp_path / "out"
    batch(trials, out)
    before, status = contents(out), log.stat()
    assert outcomes(out)["a.jsonl"] == "scored"

    text = log.read_text(encoding="utf-8")
    log.write_text(text.replace('"record"', '"recorb"', 1), encoding="utf-8")  # as long as it was
    os.utime(log, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert (log.stat().st_size, log.stat().st_mtime_ns) == (status.st_size, status.st_mtime_ns)
    batch(trials, out)
    assert outcomes(out)["a.jsonl"] != "scored"

    log.write_text(text, encoding="utf-8")
    os.utime(log, ns=(0, 0))  # long before everything else
    batch(trials, out)
    assert contents(out).items() >= {k: v for k, v in before.items() if k.startswith("objects")}.items()
    assert outcomes(out)["a.jsonl"] == "scored"


def test_a_clock_that_runs_backwards_changes_no_byte(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batch(trials, tmp_path / "out")
    now = iter(range(10**9, 0, -1000))
    monkeypatch.setattr(time, "time", lambda: float(next(now)))
    batch(trials, tmp_path / "back")

    assert contents(tmp_path / "back") == contents(tmp_path / "out")


@pytest.mark.parametrize("fault", [errno.EACCES, errno.EROFS, errno.EIO])
def test_a_folder_that_may_not_be_written_ends_the_batch_and_loses_nothing(
    fault: int,
    trials: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    batch(trials, tmp_path / "undisturbed")
    put, left = store.Store.put, iter(range(1))

    def refused(self: store.Store, place: Path, document: bytes) -> None:
        if next(left, None) is None:
            raise OSError(fault, os.strerror(fault))
        put(self, place, document)

    with monkeypatch.context() as patch:
        patch.setattr(store.Store, "put", refused)
        capsys.readouterr()
        assert batch(trials, tmp_path / "out") in (4, 7)
        assert os.strerror(fault) in capsys.readouterr().err

    batch(trials, tmp_path / "out")

    assert contents(tmp_path / "out") == contents(tmp_path / "undisturbed")
