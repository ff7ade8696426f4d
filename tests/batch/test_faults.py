"""Faults of the machine: kills at random, a full disk, a clock that is set back, workers that are lost."""

from __future__ import annotations

import errno
import io
import json
import os
import runpy
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, NoReturn

import pytest

from ariac_score import load_rule_set
from ariac_score.batch import address, local, patience, store
from ariac_score.batch.local import LocalExecutor
from ariac_score.batch.outcomes import summary_of
from ariac_score.batch.patience import Patience
from ariac_score.batch.state import State
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask
from ariac_score.batch.worker import Done, parse_report, report_of
from ariac_score.cli import main
from ariac_score.errors import BatchError, PluginError
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log

# What fresh processes do is named by a module that they can import, too.
sys.path.insert(0, str(Path(__file__).parent))
import batch_hands as hands

from ariac_score_ariac.testing import kitting_trial

pytestmark = pytest.mark.slow  # processes and clusters that die

RULES = "paper2020.published"
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


def season(*arguments: str) -> int:
    code: int = runpy.run_path(str(SEASON))["main"](arguments)
    return code


# Kills ---------------------------------------------------------------------------------

proc = pytest.mark.skipif(
    not Path("/proc/self/stat").is_file(), reason="who began which process is read from /proc"
)
WAYS = ("aborts", "takes more and more memory", "says more than is kept", "crashed", "cut off")


@proc
def test_a_season_of_kills_is_as_if_nothing_had_happened(capsys: pytest.CaptureFixture[str]) -> None:
    few = ("--trials", "10", "--broken-every", "2", "--kills", "5", "--supervisor-kills", "1")

    assert season(*few, "--ways", *WAYS) == 0

    said = capsys.readouterr().out
    assert "10 runs, 5 of them broken in 5 ways" in said
    assert "every run has the outcome and the reason of its kind: yes" in said
    assert "every run is there once: yes" in said
    assert "diff -r: no difference" in said


@proc
def test_what_a_run_leaves_behind_ends_with_it_and_holds_nothing_open(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Children in sessions of their own held the fork server, and it the output of the batch, for ever."""
    ways = ("leaves children", "writes over memory", "opens files without end", "starts threads without end")

    with within(240):
        assert (
            season(
                "--trials",
                "4",
                "--broken-every",
                "1",
                "--kills",
                "0",
                "--supervisor-kills",
                "0",
                "--ways",
                *ways,
            )
            == 0
        )

    assert "every run has the outcome and the reason of its kind: yes" in capsys.readouterr().out


def test_other_processes_of_the_supervisor_go_on_when_a_run_ends(trials: Path, tmp_path: Path) -> None:
    """Such as those that price stored measurements meanwhile."""
    setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))
    other = local.started(local.fresh_processes(tmp_path, setting), time.sleep, (600,))
    try:
        found = run_here(hands.worker.perform_into, ["a.jsonl", "b.jsonl"], trials, tmp_path / "out")
        assert sorted(found) == ["a.jsonl", "b.jsonl"]
        assert other.is_alive()
    finally:
        local.stop(other)


def test_a_file_that_changes_between_hash_and_reading_is_changing_and_nothing_is_kept(
    trials: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    task, setting = (
        RunTask("", "a.jsonl", 1, str(trials / "a.jsonl")),
        BatchSetting.of(load_rule_set(RULES), Limits()),
    )
    log = trials / "a.jsonl"
    read = hands.worker.contents_of

    def hashed_and_replaced(one: RunTask) -> str:
        found = read(one)
        status = log.stat()
        log.write_bytes(log.read_bytes().replace(b"7.", b"6.", 1))  # as long as before
        os.utime(log, ns=(status.st_atime_ns, status.st_mtime_ns))
        return found

    monkeypatch.setattr(hands.worker, "contents_of", hashed_and_replaced)
    done = hands.worker.perform(task, setting)

    assert summary_of(done.document or b"").outcome == "changing"
    assert (done.address, done.contents, done.signature) == ("", "", "")


@proc
def test_a_season_of_kills_on_a_cluster_gives_the_bytes_of_one_machine(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    few = ("--trials", "8", "--broken-every", "4", "--kills", "4", "--supervisor-kills", "1")

    assert season(*few, "--ways", "kills its own process", "gone", "--executor", "dask") == 0

    said = capsys.readouterr().out
    assert "every run is there once: yes" in said
    assert "diff -r: no difference" in said


def run_here(target: Callable[..., None], names: list[str], trials: Path, work: Path) -> dict[str, Done]:
    """What comes of some logs when processes do what `target` says."""
    work.mkdir()
    setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))
    tasks = [RunTask("", name, 1, str(trials / name)) for name in names]
    return {done.task.trial: done for done in LocalExecutor(1, None, work, target).run(tasks, setting)}


def test_a_process_that_outlives_its_server_gives_nobody_else_its_result(
    trials: Path, tmp_path: Path
) -> None:
    for name in ("1_bad.jsonl", "2.jsonl"):
        shutil.copyfile(trials / "a.jsonl", trials / name)
    names = ["1_bad.jsonl", "2.jsonl", "b.jsonl"]

    found = run_here(hands.takes_its_server_along, names, trials, tmp_path / "out")

    assert sorted(found) == names
    for name, done in found.items():
        document = json.loads(done.document or b"")
        assert document.get("trial", name) == name
    kinds = [summary_of(found[name].document or b"").outcome for name in names]
    assert kinds == ["scored", "scored", "nothing_to_score"]


def test_a_run_sees_the_environment_of_the_batch_that_asked_and_not_of_the_one_before(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = []
    for number in ("41", "42"):  # the fork server has been started before the second is set
        monkeypatch.setenv("ARIAC_SCORE_TEST_NUMBER", number)
        done = run_here(hands.fails_as_the_environment_says, ["a.jsonl"], trials, tmp_path / number)
        said.append(summary_of(done["a.jsonl"].document or b"").reason)

    assert ["exit code 41" in said[0], "exit code 42" in said[1]] == [True, True], said


def test_a_run_whose_process_is_killed_again_and_again_is_tried_at_last_and_alone(
    trials: Path, tmp_path: Path
) -> None:
    shutil.copyfile(trials / "a.jsonl", trials / "0_bad.jsonl")

    found = run_here(hands.is_killed_often, ["0_bad.jsonl", "a.jsonl", "b.jsonl"], trials, tmp_path / "out")

    assert list(found) == ["a.jsonl", "b.jsonl", "0_bad.jsonl"]
    assert summary_of(found["0_bad.jsonl"].document or b"").outcome == "scored"


def test_the_reason_names_the_death_that_happened_most_often(trials: Path, tmp_path: Path) -> None:
    found = run_here(hands.is_always_killed, ["a.jsonl"], trials, tmp_path / "out")

    reason = summary_of(found["a.jsonl"].document or b"").reason
    assert reason == "the process that scored it ended by signal 9 (SIGKILL), 12 times in 12 times"


def test_a_report_about_another_run_is_none() -> None:
    one, other = RunTask("", "a", 1, "/x/a"), RunTask("", "b", 1, "/x/b")
    report = report_of(Done(one, "ab" * 32, "cd" * 32, "ef", b"document"))

    assert parse_report(one, report).document == b"document"
    for task in (
        other,
        RunTask("", "a", 1, "/y/a"),
        RunTask("", "a", 2, "/x/a"),
        RunTask("team", "a", 1, "/x/a"),
    ):
        with pytest.raises(ValueError, match="it is a report of"):
            parse_report(task, report)


def test_a_process_that_nobody_is_left_to_end_ends_by_itself(trials: Path, tmp_path: Path) -> None:
    found = run_here(hands.tells_its_alarm, ["a.jsonl"], trials, tmp_path / "out")

    reason = summary_of(found["a.jsonl"].document or b"").reason
    assert 120.0 < float(reason.removeprefix("RuntimeError: ")) <= 180.0


def test_time_in_which_the_batch_itself_was_stopped_does_not_count(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As after SIGSTOP and SIGCONT, or when the lid of a laptop was closed."""
    true, slept_s = time.monotonic, [0.0]
    waited = local.wait

    def wait(*arguments: Any, **options: Any) -> Any:
        ready = waited(*arguments, **options)
        if not slept_s[0]:
            slept_s[0] = 100_000.0
            return []  # it had no time to look
        return ready

    monkeypatch.setattr(local, "wait", wait)
    monkeypatch.setattr(local.time, "monotonic", lambda: true() + slept_s[0])

    found = run_here(hands.worker.perform_into, ["a.jsonl"], trials, tmp_path / "out")

    assert slept_s[0]
    assert summary_of(found["a.jsonl"].document or b"").outcome == "scored"


# Clocks --------------------------------------------------------------------------------


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


# Disks ---------------------------------------------------------------------------------


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


@pytest.mark.parametrize("target", [hands.finds_no_room, hands.has_a_plugin_without_room])
def test_a_disk_that_is_too_full_for_a_report_is_no_fault_of_the_run(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, target: Callable[..., None]
) -> None:
    shutil.copyfile(trials / "a.jsonl", trials / "c_bad.jsonl")
    batch(trials, tmp_path / "undisturbed")

    with monkeypatch.context() as patch:
        patch.setattr(
            "ariac_score.batch.executors.LocalExecutor",
            lambda jobs, out, work: LocalExecutor(jobs, out, work, target),
        )
        assert batch(trials, tmp_path / "out") == 7

    assert batch(trials, tmp_path / "out") == 6  # of b.jsonl
    assert contents(tmp_path / "out") == contents(tmp_path / "undisturbed")


@pytest.mark.parametrize("size", ["8k", "16k", "64k", "120k"])
def test_a_small_disk_that_is_really_full(
    trials: Path, tmp_path: Path, size: str, capfd: pytest.CaptureFixture[str]
) -> None:
    out, kept = tmp_path / "out", tmp_path / "kept"
    out.mkdir()
    own_disk = f'mount -t tmpfs -o size={size} tmpfs "{out}"'
    unshare = [shutil.which("unshare") or "unshare", "--user", "--map-root-user", "--mount", "sh", "-c"]
    try:
        subprocess.run([*unshare, own_disk], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this machine gives nobody a small disk of his own")
    batch(trials, tmp_path / "undisturbed")
    command = f'"{sys.executable}" -m ariac_score.cli batch "{trials}" --rules {RULES} -o "{out}" -j 1'
    capfd.readouterr()

    ended = subprocess.run(
        [*unshare, f'{own_disk} && {{ {command}; code=$?; cp -R "{out}" "{kept}"; exit $code; }}'],
        check=False,
    )

    assert ended.returncode == 7
    assert "the disk is full" in capfd.readouterr().err
    assert batch(trials, kept) == 6  # of b.jsonl
    assert contents(kept) == contents(tmp_path / "undisturbed")


def test_a_file_that_may_not_be_read_costs_its_run_alone_and_is_not_passed_over(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copyfile(trials / "a.jsonl", trials / "secret.jsonl")
    (trials / "run").mkdir()
    shutil.copyfile(trials / "a.jsonl", trials / "run/log.jsonl")
    (trials / "run/secret.yaml").write_text("orders: []\n", encoding="utf-8")
    setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))
    opened = {"io.open": io.open, "os.open": os.open}

    def refusing(name: str) -> Callable[..., Any]:
        def opens(file: Any, *arguments: Any, **options: Any) -> Any:
            if "secret" in str(file):
                raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(file))
            return opened[name](file, *arguments, **options)  # type: ignore[operator]

        return opens

    for name in opened:
        monkeypatch.setattr(name, refusing(name))
    monkeypatch.setattr("builtins.open", refusing("io.open"))
    # Python 3.10 bound `io.open` where it defined `Path.open`; later versions look it up again.
    monkeypatch.setattr(Path, "open", refusing("io.open"))
    summaries = {}
    for name in ("a.jsonl", "secret.jsonl", "run"):
        done = hands.worker.perform(RunTask("", name, 1, str(trials / name)), setting)
        summaries[name] = summary_of(done.document or b"")

    assert summaries["a.jsonl"].outcome == "scored"
    for name, file in (("secret.jsonl", "secret.jsonl"), ("run", "run/secret.yaml")):
        assert summaries[name].outcome == "unreadable"
        assert summaries[name].reason.startswith(f"{file}: cannot be read: {os.strerror(errno.EACCES)}")


# Rules and folders of others -----------------------------------------------------------


def test_rules_whose_plugin_is_broken_are_said_once_and_not_for_every_run(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: object) -> None:
        raise PluginError("plugin x (y 1.0) does not keep the contract of a Rule")

    monkeypatch.setattr(RuleSet, "build", broken)

    assert batch(trials, tmp_path / "out") == 3
    assert "does not keep the contract" in capsys.readouterr().err
    assert not (tmp_path / "out/runs.jsonl").exists()


def test_a_worker_without_the_plugin_of_a_rule_set_says_so(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))
    monkeypatch.setattr(hands.worker, "prepared", lambda _setting: hands.broken_by(hands.full))

    done = hands.worker.perform(RunTask("", "a.jsonl", 1, str(trials / "a.jsonl")), setting)

    found = summary_of(done.document or b"")
    assert (found.outcome, done.address) == ("failed", "")
    assert "plugin x (y 1.0)" in found.reason


def test_a_folder_that_a_newer_version_made_is_neither_written_nor_read(
    trials: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    batch(trials, out)
    file = out / "batch.json"
    file.write_text(file.read_text(encoding="utf-8").replace("score/batch/1", "score/batch/2"), "utf-8")
    before = contents(out)
    capsys.readouterr()

    for command in (
        ["batch", str(trials), "--rules", RULES, "-o", str(out)],
        ["merge", str(tmp_path / "whole"), str(out)],
        ["export", str(out), "-o", str(tmp_path / "runs.csv")],
    ):
        assert main(command) == 4
        assert "made as ariac-score/batch/2, and this version reads ariac-score/batch/1" in (
            capsys.readouterr().err
        )
    assert contents(out) == before


def test_a_result_that_a_newer_version_wrote_is_named_as_one_when_joining(
    trials: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    batch(trials, out)
    (line,) = [
        row
        for row in map(json.loads, (out / "runs.jsonl").read_text(encoding="ascii").splitlines())
        if row["outcome"] == "scored"
    ]
    stored = out / line["object"]
    newer = stored.read_bytes().replace(b'"ariac-score/result/3"', b'"ariac-score/result/4"')
    stored.write_bytes(newer)
    table = (out / "runs.jsonl").read_text(encoding="ascii")
    table = table.replace(line["sha256"], sha256(newer).hexdigest())
    (out / "runs.jsonl").write_text(table, encoding="ascii")
    capsys.readouterr()

    assert main(["merge", str(tmp_path / "whole"), str(out)]) == 7

    said = capsys.readouterr().err
    assert "a newer version wrote it, as ariac-score/result/4" in said
    assert "update ariac-score" in said


# Files without end ---------------------------------------------------------------------

ENDLESS_BYTES = 400 * 10**9


@contextmanager
def within(seconds: int) -> Iterator[None]:
    """Fail a test that would otherwise wait for ever."""

    def ring(*_: object) -> NoReturn:
        pytest.fail(f"it did not end within {seconds} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


@pytest.fixture
def endless(trials: Path) -> Path:
    """A run beside the others with a file that is sparse: no room on the disk, and a day to read."""
    run = trials / "endless"
    run.mkdir()
    shutil.copyfile(trials / "a.jsonl", run / "log.jsonl")
    (run / "camera.bin").touch()
    try:
        os.truncate(run / "camera.bin", ENDLESS_BYTES)
    except OSError as cause:
        pytest.skip(f"this file system has no sparse files of 400 GB: {cause.strerror}")
    return run


def rows_of(out: Path) -> dict[str, dict[str, Any]]:
    lines = (out / "runs.jsonl").read_text(encoding="ascii").splitlines()
    return {row["trial"]: row for row in map(json.loads, lines)}


@pytest.mark.usefixtures("endless")
def test_a_file_without_end_costs_its_run_alone_and_is_named_with_size_and_limit(
    trials: Path, tmp_path: Path
) -> None:
    for _ in range(2):  # resumed, it is looked at again, which takes as little
        with within(120):
            assert batch(trials, tmp_path / "out") == 6

    assert outcomes(tmp_path / "out") == {
        "a.jsonl": "scored",
        "b.jsonl": "nothing_to_score",
        "endless": "too_large",
    }
    reason = rows_of(tmp_path / "out")["endless"]["reason"]
    assert reason.startswith(f"endless/camera.bin has {ENDLESS_BYTES} bytes")
    assert f"all files of a run may have {128 << 30}; remove what is no part of the trial" in reason
    assert "raise --input-gb" in reason


@pytest.mark.usefixtures("endless")
def test_a_run_that_cannot_be_hashed_in_its_time_is_late_and_holds_up_nobody(
    trials: Path, tmp_path: Path
) -> None:
    options = ["--input-gb", "500", "--time-limit-s", "5"]
    with within(120):
        code = main(
            ["batch", str(trials), "--rules", RULES, "-o", str(tmp_path / "out"), "-j", "1", *options]
        )

    assert code == 6
    assert outcomes(tmp_path / "out")["a.jsonl"] == "scored"
    assert outcomes(tmp_path / "out")["endless"] == "timed_out"


@pytest.mark.parametrize("spare_bytes", [0, -1])
def test_the_files_of_a_run_may_have_exactly_as_many_bytes_as_the_limit_says(
    trials: Path, spare_bytes: int
) -> None:
    run = trials / "run"
    run.mkdir()
    shutil.copyfile(trials / "a.jsonl", run / "log.jsonl")
    (run / "notes.txt").write_bytes(bytes(1000))
    size = (run / "log.jsonl").stat().st_size
    limits = Limits(120.0, 0, input_bytes=size + 1000 + spare_bytes)

    done = hands.worker.perform(
        RunTask("", "run", 1, str(run)), BatchSetting.of(load_rule_set(RULES), limits)
    )

    found = summary_of(done.document or b"")
    if spare_bytes == 0:
        assert found.outcome == "scored"
    else:
        assert (found.outcome, done.contents, done.address) == ("too_large", "", "")
        assert found.reason.startswith(f"run/log.jsonl has {size} bytes, with the other files of the run")


def pipe(run: Path) -> None:
    os.mkfifo(run / "pipe.jsonl")


def device(run: Path) -> None:
    (run / "zeros.bag").symlink_to("/dev/zero")


def kernel_log(run: Path) -> None:
    (run / "kernel.txt").symlink_to("/proc/kmsg")  # a regular file of no size that is read for ever


def loops(run: Path) -> None:
    (run / "self").symlink_to("self")
    (run / "above").symlink_to(run)
    (run / "there").symlink_to("back")
    (run / "back").symlink_to("there")


def deep(run: Path) -> None:
    """Folders within folders, deeper than Python's stack."""
    here = os.open(run, os.O_RDONLY)
    for _ in range(1100):
        os.mkdir("d", dir_fd=here)
        below = os.open("d", os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = below
    os.close(here)


@pytest.mark.parametrize(
    ("brings", "ends"),
    [
        (pipe, {"scored"}),
        (device, {"scored"}),
        (kernel_log, {"timed_out", "unreadable"}),  # the latter for whoever may not read it
        (loops, {"scored"}),
        (deep, {"scored"}),
    ],
)
def test_what_is_no_plain_file_in_the_folder_of_a_run_holds_up_nobody(
    trials: Path, tmp_path: Path, brings: Callable[[Path], None], ends: set[str]
) -> None:
    run = trials / "odd"
    run.mkdir()
    shutil.copyfile(trials / "a.jsonl", run / "log.jsonl")
    brings(run)

    with within(120):
        options = ["--rules", RULES, "-o", str(tmp_path / "out"), "-j", "1", "--time-limit-s", "5"]
        assert main(["batch", str(trials), *options]) == 6
    if brings is deep:
        subprocess.run(["/bin/rm", "-rf", str(run)], check=True)  # which `shutil.rmtree` cannot

    found = outcomes(tmp_path / "out")
    assert found["a.jsonl"] == "scored"
    assert found["odd"] in ends


def test_more_entries_than_a_run_has_are_not_looked_at(trials: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = trials / "many"
    (run / "below").mkdir(parents=True)
    shutil.copyfile(trials / "a.jsonl", run / "log.jsonl")
    for number in range(8):
        (run / "below" / f"{number}.png").touch()
    task, setting = RunTask("", "many", 1, str(run)), BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))

    monkeypatch.setattr(address, "MOST_ENTRIES", 10)
    assert address.signature_of(task)
    assert summary_of(hands.worker.perform(task, setting).document or b"").outcome == "scored"

    monkeypatch.setattr(address, "MOST_ENTRIES", 9)
    assert address.signature_of(task) == ""
    found = summary_of(hands.worker.perform(task, setting).document or b"")
    assert found.outcome == "too_large"
    assert found.reason.startswith("more than 9 files and folders lie in many; name the folder of one run")


# Clusters ------------------------------------------------------------------------------


@contextmanager
def cluster(workers: int) -> Iterator[Any]:
    """A Dask cluster that gives a run up after one lost worker, so that nothing takes long."""
    distributed = pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    dask = pytest.importorskip("dask")
    with (
        within(300),
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address=":0",
            host="127.0.0.1",
            silence_logs=50,
        ) as made,
    ):
        yield made


def on_a_cluster(scheduler: str, names: list[str], trials: Path, work: Path) -> Iterator[Done]:
    from ariac_score.batch.dask import dask_executor  # noqa: PLC0415  # of an extra

    setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))
    tasks = [RunTask("", name, 1, str(trials / name)) for name in names]
    return dask_executor(jobs=0, scheduler=scheduler, out=work, work=work).run(tasks, setting)


def test_a_run_that_takes_worker_after_worker_along_is_given_up_and_its_neighbours_are_not(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    monkeypatch.setattr("ariac_score.batch.dask.measure_isolated", hands.takes_its_worker_along)
    names = [f"{number}{'_bad' if number == 2 else ''}.jsonl" for number in range(5)]
    for name in names:
        shutil.copyfile(trials / "a.jsonl", trials / name)

    with cluster(1) as made:
        found = {
            done.task.trial: summary_of(done.document or b"")
            for done in on_a_cluster(made.scheduler_address, names, trials, tmp_path)
        }

    assert sorted(found) == names
    assert {name for name, summary in found.items() if summary.outcome != "scored"} == {"2_bad.jsonl"}
    bad = found["2_bad.jsonl"]
    assert (bad.outcome, bad.reason) == ("killed", "worker after worker that scored it was lost")


def test_a_run_that_is_killed_again_and_again_on_a_cluster_is_tried_at_last(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    monkeypatch.setattr("ariac_score.batch.dask.measure_isolated", hands.is_killed_beside_others)
    shutil.copyfile(trials / "a.jsonl", trials / "0_bad.jsonl")

    with cluster(1) as made:
        found = {
            done.task.trial: summary_of(done.document or b"").outcome
            for done in on_a_cluster(made.scheduler_address, ["0_bad.jsonl", "a.jsonl"], trials, tmp_path)
        }

    assert list(found.items()) == [("a.jsonl", "scored"), ("0_bad.jsonl", "scored")]


def test_while_a_cluster_gives_nothing_the_run_that_it_has_is_named_with_its_worker(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    monkeypatch.setattr("ariac_score.batch.dask.measure_isolated", hands.goes_on_when_it_was_seen)
    monkeypatch.setattr("ariac_score.batch.dask.LOOK_S", 0.1)
    shutil.copyfile(trials / "a.jsonl", trials / "0_bad.jsonl")
    seen = []

    def on_state(state: State) -> None:
        seen.extend(state.running)
        if state.running:
            (trials / "0_bad.seen").touch()

    with cluster(1) as made:
        (worker,) = made.scheduler.workers
        setting = BatchSetting.of(load_rule_set(RULES), Limits(120.0, 0))
        from ariac_score.batch.dask import dask_executor  # noqa: PLC0415  # of an extra

        executor = dask_executor(jobs=0, scheduler=made.scheduler_address, out=tmp_path, work=tmp_path)
        executor.on_state = on_state
        (done,) = executor.run([RunTask("", "0_bad.jsonl", 1, str(trials / "0_bad.jsonl"))], setting)

    assert (seen[0].key, seen[0].doing) == (("", "0_bad.jsonl", 1), f"at {worker}")
    assert summary_of(done.document or b"").outcome == "scored"


def test_workers_that_cannot_work_end_the_batch_and_not_the_runs(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent))
    monkeypatch.setattr("ariac_score.batch.dask.measure_isolated", hands.cannot_work)
    monkeypatch.setattr("ariac_score.batch.dask.KILLED_FROM_OUTSIDE_ATTEMPTS", 1)

    with cluster(1) as made, pytest.raises(BatchError, match="No space left") as caught:
        list(on_a_cluster(made.scheduler_address, ["a.jsonl"], trials, tmp_path))

    assert caught.value.exit_code == 7
    assert "call again" in caught.value.hint


def test_a_scheduler_that_is_lost_in_the_middle_ends_the_batch_and_loses_nothing(
    trials: Path, tmp_path: Path
) -> None:
    pytest.importorskip("distributed", reason="the extra 'dask' is not installed")
    names = [f"{number}.jsonl" for number in range(12)]
    for name in names:
        shutil.copyfile(trials / "a.jsonl", trials / name)

    with cluster(1) as made:
        results = on_a_cluster(made.scheduler_address, names, trials, tmp_path)
        assert summary_of(next(results).document or b"").outcome == "scored"
        made.close()
        with pytest.raises(BatchError, match="the scheduler was lost: tcp://") as caught:
            list(results)

    assert "only the rest is done" in caught.value.hint


class Network:
    """A way to a server that can be cut: then nothing comes through, and nobody is told."""

    def __init__(self, host: str, port: int) -> None:
        self.server = (host, port)
        self.there = threading.Event()
        self.there.set()
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self.listener.getsockname()[1]}"
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):  # the listener was closed
            while True:
                near, _ = self.listener.accept()
                self.there.wait()
                far = socket.create_connection(self.server)
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._carry, args=(one, other), daemon=True).start()

    def _carry(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError), one, other:
            while data := one.recv(1 << 16):
                self.there.wait()
                other.sendall(data)


@contextmanager
def network_to(made: Any) -> Iterator[Network]:
    host, port = made.scheduler_address.removeprefix("tcp://").split(":")
    network = Network(host, int(port))
    try:
        yield network
    finally:
        network.there.set()
        network.listener.close()


def test_a_network_that_is_cut_for_a_while_costs_no_run_anything(trials: Path, tmp_path: Path) -> None:
    names = [f"{number}.jsonl" for number in range(6)]
    for name in names:
        shutil.copyfile(trials / "a.jsonl", trials / name)
    here = run_here(hands.worker.perform_into, names, trials, tmp_path / "here")

    with cluster(1) as made, network_to(made) as network:
        results = on_a_cluster(network.address, names, trials, tmp_path)
        there = [next(results)]
        network.there.clear()
        threading.Timer(3.0, network.there.set).start()
        there += results

    assert len(there) == len(names)  # each once
    assert {done.task.trial: done.document for done in there} == {
        name: done.document for name, done in here.items()
    }


@pytest.mark.usefixtures("impatient")
def test_a_network_that_stays_cut_ends_the_batch_by_name(trials: Path, tmp_path: Path) -> None:
    names = [f"{number}.jsonl" for number in range(12)]
    for name in names:
        shutil.copyfile(trials / "a.jsonl", trials / name)

    with cluster(1) as made, network_to(made) as network:
        results = on_a_cluster(network.address, names, trials, tmp_path)
        assert summary_of(next(results).document or b"").outcome == "scored"
        network.there.clear()
        with pytest.raises(
            BatchError, match=r"scheduler_lost: .* has had no scheduler that answers"
        ) as caught:
            list(results)

    assert caught.value.exit_code == 7


@pytest.mark.usefixtures("impatient")
def test_a_cluster_that_is_without_workers_for_a_while_goes_on_with_the_next_ones(
    trials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patience, "WITHOUT_WORKERS_S", 60.0)
    names = [f"{number}.jsonl" for number in range(6)]
    for name in names:
        shutil.copyfile(trials / "a.jsonl", trials / name)

    with cluster(1) as made:
        results = on_a_cluster(made.scheduler_address, names, trials, tmp_path)
        found = [next(results)]
        made.scale(0)
        threading.Timer(3.0, made.scale, [1]).start()
        found += results

    assert sorted(done.task.trial for done in found) == names
    assert {summary_of(done.document or b"").outcome for done in found} == {"scored"}


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patience, "WITHOUT_WORKERS_S", 1.0)
    monkeypatch.setattr(patience, "LOOK_S", 0.2)
    monkeypatch.setattr("ariac_score.batch.dask.LOOK_S", 0.2)


@pytest.mark.usefixtures("impatient")
def test_a_cluster_whose_workers_are_gone_ends_the_batch_by_name_and_keeps_what_was_done(
    trials: Path, tmp_path: Path
) -> None:
    names = [f"{number}.jsonl" for number in range(12)]
    for name in names:
        shutil.copyfile(trials / "a.jsonl", trials / name)

    with cluster(1) as made:
        results = on_a_cluster(made.scheduler_address, names, trials, tmp_path)
        assert summary_of(next(results).document or b"").outcome == "scored"
        made.scale(0)  # what was finished and not fetched is lost with its worker
        with pytest.raises(BatchError) as caught:
            list(results)

    assert f"the cluster at {made.scheduler_address} has had no worker for 1 s" in str(caught.value)
    assert caught.value.exit_code == 7
    assert caught.value.hint.startswith("start workers, and call again: what was scored is kept")


@pytest.mark.usefixtures("impatient")
def test_a_cluster_that_never_has_a_worker_is_not_waited_for_without_end(
    trials: Path, tmp_path: Path
) -> None:
    with cluster(0) as made, pytest.raises(BatchError, match="has had no worker for"):
        list(on_a_cluster(made.scheduler_address, ["a.jsonl"], trials, tmp_path))


def looked(
    monkeypatch: pytest.MonkeyPatch, seen: Callable[[], int], times_s: Iterable[float], wall_s: float = 600.0
) -> str:
    """What is said when a cluster is looked at, at some times after the last thing came."""
    clock = [0.0]
    monkeypatch.setattr(patience.time, "monotonic", lambda: clock[0])
    one = Patience("tcp://here:1", seen, BatchSetting.of(load_rule_set(RULES), Limits(wall_s)))
    one.reset()
    try:
        for clock[0] in times_s:
            one.check()
    except BatchError as error:
        return str(error)
    return ""


def away() -> int:
    raise OSError("no route")


@pytest.mark.parametrize(
    ("seen", "end_s", "words"),
    [
        (lambda: 0, 300, ""),
        (lambda: 0, 305, "no_workers: the cluster at tcp://here:1 has had no worker for 305 s"),
        (
            away,
            305,
            "scheduler_lost: the cluster at tcp://here:1 has had no scheduler that answers for 305 s",
        ),
        (lambda: 3, 12 * 600, ""),
        (
            lambda: 3,
            12 * 600 + 5,
            "workers_silent: the 3 workers of the cluster at tcp://here:1 have given nothing for 7205 s, "
            "and a run may take 600 s",
        ),
    ],
)
def test_a_cluster_is_waited_for_as_long_as_a_run_can_honestly_take(
    monkeypatch: pytest.MonkeyPatch, seen: Callable[[], int], end_s: int, words: str
) -> None:
    assert looked(monkeypatch, seen, range(5, end_s + 1, 5)) == words


def test_time_in_which_nobody_looked_is_no_time_without_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    assert looked(monkeypatch, lambda: 0, [5, 10_000, 20_000]) == ""


def test_workers_that_come_back_are_given_their_time_again(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = iter([0] * 60 + [1] + [0] * 60)

    assert looked(monkeypatch, lambda: next(counts), range(5, 606, 5)) == ""
