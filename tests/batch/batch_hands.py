"""What a process of a batch may do to itself; by name, so that fresh processes can import it."""

from __future__ import annotations

import errno
import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

from ariac_score.batch import worker
from ariac_score.batch.isolated import measure_isolated
from ariac_score.batch.local import lost
from ariac_score.batch.tasks import BatchSetting, RunTask
from ariac_score.batch.worker import Done
from ariac_score.errors import PluginError


def dies_at_first(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """Killed from outside the first three times, half-way through; then it does its work."""
    if _tried(task, report) < 3:
        report.with_suffix(".part").write_bytes(b'{"address": "half of')
        os.kill(os.getpid(), signal.SIGKILL)
    worker.perform_into(task, setting, out, report)


def crashes(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """A fault in a library, for one log only."""
    if "bad" in task.trial:
        _when_asked(lambda: os.kill(os.getpid(), signal.SIGSEGV))
    worker.perform_into(task, setting, out, report)


def leaves(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """Ends without a word, as a plugin might."""
    if "bad" in task.trial:
        _when_asked(lambda: os._exit(0))
    worker.perform_into(task, setting, out, report)


def never_ends(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """Waits for ever on one log."""
    if "bad" in task.trial:
        _when_asked(threading.Event().wait)
    worker.perform_into(task, setting, out, report)


def devours(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """Asks for more memory than there may be, for one log only."""
    if "bad" in task.trial:
        worker.score_trial = lambda *_, **__: bytearray(setting.limits.memory_bytes)  # type: ignore[assignment]
    worker.perform_into(task, setting, out, report)


def raises(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """A fault of the scorer, for one log only."""
    if "bad" in task.trial:
        worker.score_trial = lambda *_, **__: 1 / 0  # type: ignore[assignment]
    worker.perform_into(task, setting, out, report)


def dies_when_asked(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """A fault in a library while one log is scored."""
    if "bad" in task.trial:
        _when_asked(lambda: os.kill(os.getpid(), signal.SIGSEGV))
    worker.perform_into(task, setting, out, report)


def dies_of_both(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """Killed from outside before and between faults of its own, for one log only."""
    if "bad" in task.trial:
        own = _tried(task, report) in (1, 4)
        _when_asked(lambda: os.kill(os.getpid(), signal.SIGSEGV if own else signal.SIGKILL))
    worker.perform_into(task, setting, out, report)


def takes_its_server_along(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """The server it came from is killed, once; the process itself lives on and leaves its report late."""
    if "bad" in task.trial and _tried(task, report) == 0:
        os.kill(os.getppid(), signal.SIGKILL)
    worker.perform_into(task, setting, out, report)


def is_killed_often(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """Killed from outside five times, for one log only."""
    if "bad" in task.trial and _tried(task, report) < 5:
        os.kill(os.getpid(), signal.SIGKILL)
    worker.perform_into(task, setting, out, report)


def is_always_killed(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """Killed whenever it is tried, at the twelfth time with its server."""
    if _tried(task, report) == 11:
        os.kill(os.getppid(), signal.SIGKILL)
    os.kill(os.getpid(), signal.SIGKILL)
    worker.perform_into(task, setting, out, report)


def finds_no_room(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """The disk is full when one log is scored."""
    if "bad" in task.trial:
        worker.report_of = full  # type: ignore[assignment]
    worker.perform_into(task, setting, out, report)


def has_a_plugin_without_room(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """A plugin cannot write what it wants to."""
    if "bad" in task.trial:
        worker.score_trial = lambda *_, **__: broken_by(full)  # type: ignore[assignment]
    worker.perform_into(task, setting, out, report)


def has_a_devouring_plugin(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """A plugin asks for more memory than there may be, for one log only."""
    if "bad" in task.trial:
        held = setting.limits.memory_bytes
        worker.score_trial = lambda *_, **__: broken_by(lambda: bytearray(held))  # type: ignore[assignment]
    worker.perform_into(task, setting, out, report)


def tells_its_alarm(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """Says in how many seconds it will be ended whoever is left to do so."""

    def raises(*_: object, **__: object) -> None:
        raise RuntimeError(f"{signal.getitimer(signal.ITIMER_REAL)[0]:.0f}")

    worker.score_trial = raises  # type: ignore[assignment]
    worker.perform_into(task, setting, out, report)


def takes_its_worker_along(task: RunTask, setting: BatchSetting, earlier: bytes) -> Done:
    """One run kills the worker of the cluster that scores it."""
    if "bad" in task.trial:
        os.kill(os.getpid(), signal.SIGKILL)
    return measure_isolated(task, setting, earlier)


def is_killed_beside_others(task: RunTask, setting: BatchSetting, earlier: bytes) -> Done:
    """The process of one run is killed as often as it is tried, until it is tried once more."""
    mark = Path(task.path).with_suffix(".tried")
    if "bad" in task.trial and not mark.exists():
        mark.touch()
        return replace(lost(task, "killed", "from outside"), put_off=True)
    return measure_isolated(task, setting, earlier)


def goes_on_when_it_was_seen(task: RunTask, setting: BatchSetting, earlier: bytes) -> Done:
    """One run waits, a minute at most, until somebody has noticed it."""
    end_s = time.monotonic() + 60
    while (
        "bad" in task.trial and not Path(task.path).with_suffix(".seen").exists() and time.monotonic() < end_s
    ):
        time.sleep(0.05)
    return measure_isolated(task, setting, earlier)


def cannot_work(_task: RunTask, _setting: BatchSetting, _earlier: bytes) -> Done:
    """A worker whose disk is full."""
    return full()


def _when_asked(does: Callable[[], object]) -> None:
    """Have something else done where the log is scored, its files being hashed already."""
    worker.score_trial = lambda *_, **__: does()  # type: ignore[assignment,return-value]


def _tried(task: RunTask, report: Path) -> int:
    """How often it was tried before."""
    marks = report.parent.parent / f"marks-{task.trial}"
    marks.mkdir(exist_ok=True)
    tried = len(list(marks.iterdir()))
    (marks / str(tried)).touch()
    return tried


def full(*_: object) -> NoReturn:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def broken_by(does: Callable[[], object]) -> None:
    try:
        does()
    except (MemoryError, OSError) as cause:
        raise PluginError("plugin x (y 1.0) raised something") from cause


def fails_as_the_environment_says(
    task: RunTask, setting: BatchSetting, out: Path | None, report: Path
) -> None:
    """Ends with the number that a variable of the environment holds, as if it were the credentials."""
    os._exit(int(os.environ["ARIAC_SCORE_TEST_NUMBER"]))
