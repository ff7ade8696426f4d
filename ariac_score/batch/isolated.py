"""One run in a process of its own, on a worker of a cluster, which itself is often not allowed to fork.

A keeper, `python -m ariac_score.batch.isolated`, is started once for each worker process. It has
everything imported and forks a process for each run; jobs come in as lines of JSON.
"""

from __future__ import annotations

import atexit
import json
import signal
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from threading import Lock
from typing import IO

import msgspec

from ariac_score.batch.local import LocalExecutor
from ariac_score.batch.store import Store
from ariac_score.batch.tasks import BatchSetting, RunTask
from ariac_score.batch.worker import Done, parse_report, report_of

__all__ = ["absolute", "earlier_document", "measure_isolated"]

_READY = b"ready\n"
_LARGEST_SENT_BYTES = 4 << 20
"""What is sent along with a task; schedulers are not made for more."""


@dataclass(frozen=True)
class _Job:
    """What a worker process hands to its keeper.

    Attributes:
        task: The run.
        setting: Rules and limits.
        report: File for the outcome.
        out: Folder with the stored document of the run; empty without one.
    """

    task: RunTask
    setting: BatchSetting
    report: str
    out: str

    def as_line(self) -> bytes:
        """The job as a line of JSON."""
        # Not msgspec's encoder, which refuses the half surrogate pairs of names that are no UTF-8.
        return json.dumps(asdict(self)).encode("ascii") + b"\n"

    @classmethod
    def from_line(cls, line: bytes) -> _Job:
        """A job as it was written."""
        return msgspec.convert(json.loads(line), cls)


def measure_isolated(task: RunTask, setting: BatchSetting, earlier: bytes = b"") -> Done:
    """Score one run in a fresh process on this machine.

    Args:
        task: The run.
        setting: Rules and limits.
        earlier: The document that `task.earlier` names: this machine may not see the folder of the batch.

    Raises:
        OSError: The keeper died, twice; another machine may do better.
    """
    with tempfile.TemporaryDirectory(prefix="ariac-score-") as folder:
        report = Path(folder) / "report"
        out = _laid_out(task, earlier, Path(folder) / "out") if earlier else ""
        _KEEPER.perform(_Job(task, setting, str(report), out))
        return parse_report(task, report.read_bytes())


def earlier_document(task: RunTask, out: Path | None) -> bytes:
    """The stored document of a run, to be sent along with its task; empty when there is none of use."""
    if out is None or not task.earlier:
        return b""
    try:
        place = out / task.earlier
        return place.read_bytes() if place.stat().st_size <= _LARGEST_SENT_BYTES else b""
    except OSError:
        return b""


def _laid_out(task: RunTask, earlier: bytes, out: Path) -> str:
    """Make the folder of a batch that holds this one document."""
    place = Path(task.earlier)
    store = Store(out)
    store.put(store.measured(place.parent.name) / place.name, earlier)
    return str(out)


def absolute(task: RunTask) -> RunTask:
    """The task with paths that mean the same in whatever folder a worker was started."""
    return replace(
        task,
        path=_absolute(task.path),
        root=_absolute(task.root) if task.root else "",
        also=tuple(map(_absolute, task.also)),
    )


def _absolute(name: str) -> str:
    return name if "://" in name else str(Path(name).absolute())


# Not `python -m`, which looks for modules in the working directory first: a worker of a cluster may be
# started in a checkout whose package is installed elsewhere.
_START = (
    "import sys; sys.path[:] = sys.argv[1:]; import runpy;"
    " runpy.run_module('ariac_score.batch.isolated', run_name='__main__')"
)


class _Keeper:
    """The keeper of this worker process, started with the first job, and again when it died."""

    def __init__(self) -> None:
        self._lock = Lock()
        self._process: subprocess.Popen[bytes] | None = None

    def perform(self, job: _Job) -> None:
        """Have one job done.

        Raises:
            OSError: The keeper died, twice.
        """
        line = job.as_line()
        with self._lock:  # a worker of a cluster may have several threads
            if not self._succeeds(line):
                self._process = None
                if not self._succeeds(line):
                    raise OSError("the process that keeps the scorer ready died twice")

    def _succeeds(self, line: bytes) -> bool:
        if self._process is None:
            self._process = subprocess.Popen(  # noqa: S603  # the path of this process, nothing of a stranger's
                [sys.executable, "-c", _START, *sys.path],
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
    """End a keeper when its worker process ends."""
    process.kill()
    process.communicate()


_KEEPER = _Keeper()


def _serve(lines: IO[bytes], ready: IO[bytes]) -> None:
    """Do one job after the other until there are no more."""
    # Ctrl-C goes to the whole process group; the worker process decides when its keeper ends.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with tempfile.TemporaryDirectory(prefix="ariac-score-") as work:
        # One executor for all jobs, because it numbers reports: a process that outlived its server could
        # otherwise write its report where that of a later run is looked for.
        executor = LocalExecutor(1, None, Path(work))
        for line in lines:
            job = _Job.from_line(line)
            executor.out = Path(job.out) if job.out else None
            (done,) = executor.run([job.task], job.setting)
            Path(job.report).write_bytes(report_of(done))
            ready.write(_READY)
            ready.flush()


if __name__ == "__main__":
    _serve(sys.stdin.buffer, sys.stdout.buffer)
