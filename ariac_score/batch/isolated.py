"""One run in a process of its own, on a worker of a cluster, which itself is often not allowed to fork.

A keeper, `python -m ariac_score.batch.isolated`, is started once for each worker process. It has
everything imported and gives each run a process out of that; tasks come in as lines of JSON.
"""

from __future__ import annotations

import atexit
import json
import shutil
import signal
import subprocess
import sys
import tempfile
from dataclasses import asdict, replace
from pathlib import Path, PurePosixPath
from threading import Lock
from typing import IO, Any

from ariac_score.batch.local import LocalExecutor, lost
from ariac_score.batch.tasks import Limits, Setting, Task
from ariac_score.batch.worker import Done, parse_report, report_of
from ariac_score.errors import LogError, ScoreError, UsageError

__all__ = ["absolute", "measure_apart"]

_READY = b"ready\n"


def measure_apart(task: Task, setting: Setting) -> Done:
    """Score one run in a fresh process on this machine; a run elsewhere is fetched first.

    Raises:
        OSError: The keeper died, twice; another machine may do better.
    """
    with tempfile.TemporaryDirectory(prefix="ariac-score-") as folder:
        try:
            near = _fetched(task, Path(folder))
        except ScoreError as error:
            return lost(task, "unreadable", f"{error}; {error.hint}" if error.hint else str(error))
        report = Path(folder) / "report"
        wire = {"task": asdict(near), "setting": asdict(setting), "report": str(report)}
        _KEEPER.ask(json.dumps(wire).encode("ascii") + b"\n")
        return replace(parse_report(near, report.read_bytes()), task=task)


def absolute(task: Task) -> Task:
    """The task with paths that mean the same in whatever folder a worker was started."""
    return replace(
        task,
        path=task.path if "://" in task.path else str(Path(task.path).absolute()),
        root=str(Path(task.root).absolute()) if task.root else "",
        also=tuple(str(Path(name).absolute()) for name in task.also),
    )


class _Keeper:
    """The keeper of this worker process, started when it is first asked, and again when it died."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def ask(self, line: bytes) -> None:
        """Have one task done."""
        with self._lock:
            if not self._tried(line):
                self._process = None
                if not self._tried(line):
                    raise OSError("the process that keeps the scorer ready died twice")

    def _tried(self, line: bytes) -> bool:
        if self._process is None:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "ariac_score.batch.isolated"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            atexit.register(_end, self._process)
        to, back = self._process.stdin, self._process.stdout
        assert to is not None
        assert back is not None
        try:
            to.write(line)
            to.flush()
            return back.readline() == _READY
        except OSError:
            return False


def _end(process: subprocess.Popen[bytes]) -> None:
    """Let a keeper go when its worker process ends."""
    process.kill()
    process.communicate()


_KEEPER = _Keeper()


def _fetched(task: Task, folder: Path) -> Task:
    """The task with its files on this machine.

    Raises:
        LogError: The files cannot be had.
    """
    if "://" not in task.path:
        return task
    try:
        import fsspec  # noqa: PLC0415  # an extra
    except ImportError as cause:
        raise UsageError(
            "reading a URI needs fsspec", file=task.path, hint="pip install 'ariac-score[remote]'"
        ) from cause
    name = PurePosixPath(task.path.rstrip("/")).name
    near = folder / "log" / name
    near.parent.mkdir()
    try:
        system, path = fsspec.core.url_to_fs(task.path)
        system.get(path, str(near), recursive=system.isdir(path))
    except Exception as cause:  # every protocol has errors of its own
        shutil.rmtree(near.parent, ignore_errors=True)
        raise LogError(
            f"cannot be fetched: {type(cause).__name__}: {cause}",
            file=task.path,
            hint="check the address, and the credentials of the machine that fetches it",
        ) from cause
    return replace(task, path=str(near))


def _serve(lines: IO[bytes], ready: IO[bytes]) -> None:
    """Do one task after the other until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with tempfile.TemporaryDirectory(prefix="ariac-score-") as work:
        for line in lines:
            wire: dict[str, Any] = json.loads(line)
            task = Task(**{**wire["task"], "also": tuple(wire["task"]["also"])})
            setting = Setting(**{**wire["setting"], "limits": Limits(**wire["setting"]["limits"])})
            (done,) = LocalExecutor(1, None, Path(work)).run([task], setting)
            Path(wire["report"]).write_bytes(report_of(done))
            ready.write(_READY)
            ready.flush()


if __name__ == "__main__":
    _serve(sys.stdin.buffer, sys.stdout.buffer)
