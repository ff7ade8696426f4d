"""What a process of a batch may do to itself; by name, so that fresh processes can import it."""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

from ariac_score.batch import worker
from ariac_score.batch.tasks import Setting, Task


def dies_at_first(task: Task, setting: Setting, out: Path | None, report: Path) -> None:
    """Killed by a strange hand the first three times, half-way through; then it does its work."""
    marks = report.parent.parent / f"marks-{task.trial}"
    marks.mkdir(exist_ok=True)
    tried = len(list(marks.iterdir()))
    if tried < 3:
        (marks / str(tried)).touch()
        report.with_suffix(".part").write_bytes(b'{"address": "half of')
        os.kill(os.getpid(), signal.SIGKILL)
    worker.perform_into(task, setting, out, report)


def crashes(task: Task, setting: Setting, out: Path | None, report: Path) -> None:
    """A fault in a library, for one log only."""
    if "bad" in task.trial:
        os.kill(os.getpid(), signal.SIGSEGV)
    worker.perform_into(task, setting, out, report)


def leaves(task: Task, setting: Setting, out: Path | None, report: Path) -> None:
    """Ends without a word, as a plugin might."""
    if "bad" in task.trial:
        os._exit(0)
    worker.perform_into(task, setting, out, report)


def never_ends(task: Task, setting: Setting, out: Path | None, report: Path) -> None:
    """Waits for ever on one log."""
    if "bad" in task.trial:
        threading.Event().wait()
    worker.perform_into(task, setting, out, report)


def devours(task: Task, setting: Setting, out: Path | None, report: Path) -> None:
    """Asks for more memory than there may be, for one log only."""
    if "bad" in task.trial:
        worker.score_trial = lambda *_, **__: bytearray(setting.limits.memory_bytes)  # type: ignore[assignment]
    worker.perform_into(task, setting, out, report)


def raises(task: Task, setting: Setting, out: Path | None, report: Path) -> None:
    """A fault of the scorer, for one log only."""
    if "bad" in task.trial:
        worker.score_trial = lambda *_, **__: 1 / 0  # type: ignore[assignment]
    worker.perform_into(task, setting, out, report)


def dies_when_asked(task: Task, setting: Setting, out: Path | None, report: Path) -> None:
    """A fault in a library while one log is scored."""
    if "bad" in task.trial:
        worker.score_trial = lambda *_, **__: os.kill(os.getpid(), signal.SIGSEGV)  # type: ignore[assignment,return-value]
    worker.perform_into(task, setting, out, report)
