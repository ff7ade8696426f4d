"""Runs scored on a Ray cluster of this machine, whose workers and whose supervisor die."""

from __future__ import annotations

import filecmp
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from ariac_score import load_rule_set
from ariac_score.batch import patience
from ariac_score.batch.index import Row
from ariac_score.batch.isolated import measure_isolated
from ariac_score.batch.state import OnState, State, unwatched
from ariac_score.batch.store import Store
from ariac_score.batch.supervise import Executor, Report, run_batch
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask, plan_batch
from ariac_score.batch.worker import Done, perform
from ariac_score.cli import main
from ariac_score.errors import BatchError, UsageError
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

ray = pytest.importorskip("ray", reason="the extra 'ray' is not installed")
executors = pytest.importorskip("ariac_score.batch.ray")

pytestmark = [
    pytest.mark.slow,  # a cluster on this machine
    # Ray ends its own processes, and does not wait for them.
    pytest.mark.filterwarnings("ignore:subprocess .* is still running:ResourceWarning"),
]

ray_remote = ray.remote
RULES = "ariac2020.as_coded"
NAMES = ("a", "b", "c", "d_bad", "e", "f")


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def cluster() -> Iterator[str]:
    """The address of a cluster of two processors, on this machine alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("RAY_worker_niceness", "0")  # else its workers wait for every other test
        patch.setenv("RAY_AUTH_MODE", "disabled")  # a token of this machine's user is of other clusters
        patch.delenv("RAY_ADDRESS", raising=False)
        ray.init("local", num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="ERROR")
        yield ray.get_runtime_context().gcs_address
        ray.shutdown()


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Whole trials, one cut off, one that is no log at all."""
    folder = tmp_path_factory.mktemp("made") / "trials"
    folder.mkdir()
    write_trial_log(folder / "a.jsonl", kitting_trial(duration_s=40.0), signals=SNAPSHOT_SIGNALS)
    text = (folder / "a.jsonl").read_text(encoding="utf-8")
    for name in NAMES:
        (folder / f"{name}.jsonl").write_text(text, encoding="utf-8")
    (folder / "cut.jsonl").write_text(text[:2000], encoding="utf-8")
    (folder / "note.txt").write_text("hello\n", encoding="utf-8")
    return folder


class Inline:
    """Scores in this process, one run after the other."""

    def run(self, tasks: Any, setting: BatchSetting) -> Iterator[Done]:
        for task in tasks:
            yield perform(task, setting)


class Staying(executors.RayExecutor):
    """As it is, but the cluster stays for the next test."""

    def run(self, tasks: Any, setting: BatchSetting) -> Iterator[Done]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(ray, "shutdown", lambda: None)
            yield from super().run(tasks, setting)


def score(trials: Path, out: Path, executor: Executor, on_state: OnState = unwatched) -> Report:
    plan, rule_set, store = plan_batch(trials, RULES), load_rule_set(RULES), Store(out)
    setting = BatchSetting.of(rule_set, Limits(wall_s=120.0))
    with store.working() as work:
        return run_batch(
            plan.tasks, rule_set, setting, store, work, executor, name=plan.id, on_state=on_state
        )


def rows(out: Path) -> dict[str, Row]:
    lines = (out / "runs.jsonl").read_text(encoding="ascii").splitlines()
    return {row.key[1]: row for row in map(Row.from_line, lines)}


def same(first: Path, second: Path) -> bool:
    names = [
        sorted(p.relative_to(f).as_posix() for p in f.rglob("*") if p.is_file()) for f in (first, second)
    ]
    assert names[0] == names[1]
    _, differing, errors = filecmp.cmpfiles(first, second, names[0], shallow=False)
    return not differing and not errors


def dying(marks: Path, which: str, times: int) -> Callable[[RunTask, BatchSetting, bytes], Done]:
    """What a worker does whose machine is lost with some runs, so many times each."""

    def measure(task: RunTask, setting: BatchSetting, earlier: bytes) -> Done:
        tried = len(list(marks.glob(f"{task.trial}-*")))
        if which in task.trial and tried < times:
            (marks / f"{task.trial}-{tried}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return measure_isolated(task, setting, earlier)

    return measure


@pytest.mark.usefixtures("cluster")
def test_workers_that_are_lost_cost_their_runs_nothing(trials: Path, tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    marks.mkdir()
    score(trials, tmp_path / "here", Inline())

    score(trials, tmp_path / "there", Staying(measure=dying(marks, ".jsonl", times=1)))

    assert len(list(marks.iterdir())) == len(NAMES) + 1
    assert same(tmp_path / "here", tmp_path / "there")


@pytest.mark.usefixtures("cluster")
def test_while_a_cluster_gives_nothing_the_runs_that_it_has_are_named(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "LOOK_S", 0.1)
    noticed, seen = tmp_path / "noticed", set[tuple[str, str]]()

    def measure(task: RunTask, setting: BatchSetting, earlier: bytes) -> Done:
        end_s = time.monotonic() + 60
        while "cut" in task.trial and not noticed.exists() and time.monotonic() < end_s:
            time.sleep(0.05)
        return measure_isolated(task, setting, earlier)

    def on_state(state: State) -> None:
        seen.update((run.key[1], run.doing) for run in state.running)
        if ("cut.jsonl", "given to the cluster") in seen:
            noticed.touch()

    score(trials, tmp_path / "out", Staying(measure=measure), on_state)

    assert noticed.exists()
    assert rows(tmp_path / "out")["cut.jsonl"].summary.outcome == "unreadable"


@pytest.mark.usefixtures("cluster")
def test_a_run_that_takes_worker_after_worker_with_it_is_given_up_by_name(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(executors, "KILLED_FROM_OUTSIDE_ATTEMPTS", 2)
    marks = tmp_path / "marks"
    marks.mkdir()

    score(trials, tmp_path / "out", Staying(measure=dying(marks, "bad", times=100)))

    found = {name: row.summary.outcome for name, row in rows(tmp_path / "out").items()}
    assert found.pop("d_bad.jsonl") == "killed"
    reason = rows(tmp_path / "out")["d_bad.jsonl"].summary.reason
    assert reason.startswith("worker after worker that scored it was lost")
    assert found.pop("cut.jsonl") == "unreadable"
    assert found.pop("note.txt") == "nothing_to_score"
    assert set(found.values()) == {"scored"}
    assert len(list(marks.iterdir())) == 3  # not for ever


@pytest.mark.usefixtures("cluster")
def test_a_cluster_without_a_machine_that_works_ends_the_batch_by_name(
    trials: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # No machine has this much room, so that the run waits as it does when all of them are gone.
    monkeypatch.setattr(executors.ray, "remote", lambda **options: ray_remote(**{**options, "num_cpus": 64}))
    monkeypatch.setattr(executors, "_workers", lambda: 0)
    monkeypatch.setattr(executors, "LOOK_S", 0.2)
    monkeypatch.setattr(patience, "LOOK_S", 0.2)
    monkeypatch.setattr(patience, "WITHOUT_WORKERS_S", 1.0)
    setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0))

    with pytest.raises(BatchError, match=r"the cluster at \S+ has had no worker for 1 s") as caught:
        list(Staying().run([RunTask("", "a.jsonl", 1, str(trials / "a.jsonl"))], setting))

    assert caught.value.exit_code == 7


@pytest.mark.timeout(600)
def test_a_supervisor_that_is_killed_goes_on_with_the_same_bytes(
    cluster: str, trials: Path, tmp_path: Path
) -> None:
    score(trials, tmp_path / "here", Inline())
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "ariac_score.cli",
        "batch",
        str(trials),
        "--rules",
        RULES,
        "-o",
        str(out),
    ]
    command += ["--executor", "ray", "--scheduler", cluster]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as first:
        assert first.stderr is not None
        said = [next(line for line in first.stderr if ": scored" in line)]  # one is kept
        first.kill()
    assert first.returncode == -signal.SIGKILL
    assert not (out / "runs.jsonl").exists()

    again = subprocess.run(command, capture_output=True, text=True, check=False)

    assert again.returncode == 6, [*said, again.stderr]  # one is cut off
    assert same(tmp_path / "here", out)


def test_a_head_that_no_longer_listens_is_lost_after_three_looks_and_one_that_does_is_not() -> None:
    patient = patience.Patience("here", lambda: 1, BatchSetting.of(load_rule_set(RULES), Limits(120.0)))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        address = f"127.0.0.1:{listener.getsockname()[1]}"
        head = executors._Head.watched(address, patient)
        head.check()
    head.check()
    head.check()
    with pytest.raises(BatchError, match=f"scheduler_lost: the head of the cluster at {address} is gone"):
        head.check()
    unreachable = executors._Head.watched(address, patient)  # as behind a client: nothing can be said
    for _ in range(5):
        unreachable.check()


@pytest.fixture
def head(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[str, Callable[[], None]]]:
    """The address of a head of its own, and how to kill it with all that it runs."""
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    monkeypatch.setenv("RAY_worker_niceness", "0")
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    with socket.create_server(("", 0)) as free:
        port = free.getsockname()[1]
    folder = tempfile.mkdtemp(prefix="head-")  # the name of a socket may have 107 bytes
    start = ["start", "--head", f"--port={port}", "--num-cpus=1", f"--temp-dir={folder}"]
    start += ["--include-dashboard=false", "--disable-usage-stats"]
    subprocess.run(
        [Path(sys.executable).parent / "ray", *start], check=True, capture_output=True, timeout=120
    )

    def kill() -> None:
        for process in Path("/proc").glob("[0-9]*"):
            with suppress(OSError):
                started = (process / "cmdline").read_bytes()
                if folder.encode() in started and int(process.name) != os.getpid():
                    os.kill(int(process.name), signal.SIGKILL)

    yield f"127.0.0.1:{port}", kill
    kill()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.timeout(400)
@pytest.mark.skipif(not Path("/proc/self/cmdline").is_file(), reason="the head is found by /proc")
def test_a_head_that_is_killed_ends_the_batch_by_name_and_loses_nothing(
    head: tuple[str, Callable[[], None]], trials: Path, tmp_path: Path
) -> None:
    scheduler, kill = head
    out = tmp_path / "out"
    start = [sys.executable, "-m", "ariac_score.cli", "batch", str(trials), "--rules", RULES, "-o", str(out)]
    on_ray = [*start, "--executor", "ray", "--scheduler", scheduler]
    with subprocess.Popen(on_ray, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as batch:
        assert batch.stderr is not None
        first = next(line for line in batch.stderr if ": scored" in line)
        kill()
        said = batch.stderr.read()

    assert batch.returncode == 7, first + said
    assert "error: scheduler_lost: the head of the cluster" in said
    assert (out / ".rows.jsonl").read_text(encoding="ascii").count("\n") >= 1
    assert subprocess.run(start, capture_output=True, check=False).returncode == 6  # one is cut off
    score(trials, tmp_path / "here", Inline())
    assert same(tmp_path / "here", out)


@pytest.mark.parametrize(
    ("scheduler", "cause"),
    [
        ("", "needs an address"),
        ("127.0.0.1:9", "cannot be reached"),
        ("ray://127.0.0.1:9", "cannot be reached"),
        ("ray://127.0.0.1:x", "cannot be reached"),
        ("nonsense", "cannot be reached: Invalid address"),
    ],
)
def test_a_cluster_that_is_not_there_is_named_at_once(tmp_path: Path, scheduler: str, cause: str) -> None:
    with pytest.raises(UsageError, match=cause):
        executors.ray_executor(jobs=0, scheduler=scheduler, out=tmp_path, work=tmp_path)


def test_the_cluster_of_before_the_last_start_of_the_machine_is_named_at_once(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    monkeypatch.setenv("RAY_TMPDIR", str(tmp_path))
    (tmp_path / "ray").mkdir()
    (tmp_path / "ray" / "ray_current_cluster").write_text("127.0.0.1:9", encoding="utf-8")
    command = ["batch", str(trials), "--rules", RULES, "-o", str(tmp_path / "out")]

    assert main([*command, "--executor", "ray", "--scheduler", "auto"]) == 4
    err = capsys.readouterr().err
    assert "the cluster at auto cannot be reached" in err
    assert "ray start --head" in err
    assert main([*command, "--executor", "ray", "--scheduler", "auto", "-j", "2"]) == 4
    assert "the cluster decides how many runs" in capsys.readouterr().err
