"""The executor of one machine: a fresh process for each run, a few at a time."""

from __future__ import annotations

import errno
import json
import multiprocessing
import os
import shutil
import signal
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from multiprocessing import forkserver
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from ariac_score.batch.outcomes import outcome_document
from ariac_score.batch.state import OnState, RunUnderWay, State, unwatched
from ariac_score.batch.tasks import BatchSetting, RunTask
from ariac_score.batch.worker import (
    LARGEST_HEAD_BYTES,
    NO_ROOM,
    Done,
    fetched_folder,
    limit_threads,
    note_file,
    noted,
    parse_report,
    perform_into,
    running_file,
)
from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import BatchError
from ariac_score.installed.running import noted as last_noted
from ariac_score.installed.system import KILLS, end_children

__all__ = [
    "AND_AGAIN",
    "KILLED_FROM_OUTSIDE_ATTEMPTS",
    "OWN_FAULT_ATTEMPTS",
    "SAFE_PATH",
    "SETTING_VARIABLE",
    "LocalExecutor",
    "begin_server",
    "died",
    "fresh_processes",
    "lost",
    "started",
    "stop",
    "too_late",
    "usable_cores",
]

OWN_FAULT_ATTEMPTS = 2
"""Attempts at a run whose process died of itself, as of a fault in a library: it dies again."""
KILLED_FROM_OUTSIDE_ATTEMPTS = 12
"""Attempts at a run whose process was killed from outside: it does not deserve to lose its score for that."""
AND_AGAIN = "and call again: what was scored is kept, and only the rest is done"
"""What to do when it is the machines that failed, for a hint."""
_SERVER_LOST = 255
"""`multiprocessing`'s exit code of a process whose fork server died before it could report another."""
_KILLED_AMONG_OTHERS_ATTEMPTS = 3
"""Attempts while other runs go on, before one alone at the end: together they may need too much memory."""
_KILLED_FROM_OUTSIDE = frozenset({_SERVER_LOST, *(-number for number in KILLS)})
"""Exit codes of a process that somebody killed: the kernel short of memory, a user, a scheduler."""
_START_ATTEMPTS = 5
_LONGEST_WAIT_S = 1.0
_CHILDREN_S = 2.0
"""How long the end of what a run has left behind may take."""
_KILLED_S = 10.0
"""How long a process may take to be gone once it is killed."""
SETTING_VARIABLE = "ARIAC_SCORE_BATCH_SETTING"
"""Environment variable that names the file of the setting for which the fork server prepares."""
SAFE_PATH = ("PYTHONSAFEPATH", "of the fork server alone")
"""Environment variable of Python 3.11 and later, and a value that no user gives it."""
_OWN_FOLDER = Path(__file__).resolve().parents[2]
"""The folder from which this process has imported the package."""


@dataclass(frozen=True)
class _Deaths:
    """How the process of a run died, so far.

    Its own faults and kills from outside are counted separately, so that what a machine does to a run
    never changes the reason it gets.

    Attributes:
        own: Exit codes when it died of itself.
        from_outside: Those when somebody killed it, or the server it came from.
    """

    own: tuple[int | None, ...] = ()
    from_outside: tuple[int | None, ...] = ()

    def and_one(self, code: int | None) -> _Deaths:
        if code in _KILLED_FROM_OUTSIDE:
            return replace(self, from_outside=(*self.from_outside, code))
        return replace(self, own=(*self.own, code))

    @property
    def given_up(self) -> bool:
        return len(self.own) >= OWN_FAULT_ATTEMPTS or len(self.from_outside) >= KILLED_FROM_OUTSIDE_ATTEMPTS

    @property
    def put_off(self) -> bool:
        return len(self.from_outside) >= _KILLED_AMONG_OTHERS_ATTEMPTS

    def most_common(self) -> tuple[int | None, int]:
        """The exit code to report, and the number of attempts it stands for."""
        codes = self.own if len(self.own) >= OWN_FAULT_ATTEMPTS else self.from_outside
        # How the process ended is unknown where its server was lost; any other code says more.
        known = [code for code in codes if code != _SERVER_LOST] or list(codes)
        return Counter(known).most_common(1)[0][0], len(codes)


@dataclass
class _Running:
    task: RunTask
    deaths: _Deaths
    process: BaseProcess
    report: Path
    deadline: float
    started_s: float
    pid: int | None

    def state(self, now_s: float) -> RunUnderWay:
        """What it does, as far as its process has noted it."""
        _, plugin = last_noted(running_file(self.report))
        before = "reading" if note_file(self.report).is_file() else "fetching and hashing"
        if not self.task.remote and before != "reading":
            before = "hashing"
        return RunUnderWay(self.task.key, now_s - self.started_s, plugin or before)


@dataclass
class LocalExecutor:
    """Runs tasks on this machine.

    Time in which this executor did not run does not count against runs: when a machine sleeps, or the
    batch is stopped, they did not go on either.

    Attributes:
        jobs: Processes at a time.
        out: Folder of the batch, to find what is stored.
        work: Folder for reports.
        target: What each process does; it leaves a report.
        on_state: Called about once a second with what each run does.
    """

    jobs: int
    out: Path | None
    work: Path
    target: Callable[[RunTask, BatchSetting, Path | None, Path], None] = perform_into
    on_state: OnState = unwatched
    _serial: int = field(default=0, init=False)
    _looked_s: float = field(default=0.0, init=False)
    _told_s: float = field(default=0.0, init=False)

    def run(self, tasks: Iterable[RunTask], setting: BatchSetting) -> Iterator[Done]:
        """Each task's outcome, in the order in which they finish.

        Raises:
            OSError: The disk is too full for a report.
        """
        context = fresh_processes(self.work, setting)
        waiting = iter(tasks)
        again: deque[tuple[RunTask, _Deaths]] = deque()
        at_last: deque[tuple[RunTask, _Deaths]] = deque()
        running: list[_Running] = []
        self._looked_s = time.monotonic()
        try:
            while True:
                while len(running) < self.jobs:
                    following = again.popleft() if again else _first(waiting)
                    if following is None:
                        break
                    running.append(self._start(context, *following, setting))
                if not running and at_last:  # one at a time, with all the memory for itself
                    running.append(self._start(context, *at_last.popleft(), setting))
                if not running:
                    return
                self._tell(running)
                for ended in self._ended(running):
                    running.remove(ended)
                    outcome = self._settle(ended, setting)
                    _end_left_behind(context, ended.pid)
                    if isinstance(outcome, Done):
                        yield outcome
                    else:
                        (at_last if outcome.put_off else again).append((ended.task, outcome))
        finally:
            for one in running:
                stop(one.process)
                _end_left_behind(context, one.pid)

    def _start(self, context: Any, task: RunTask, deaths: _Deaths, setting: BatchSetting) -> _Running:
        self._serial += 1
        report = self.work / f"{self._serial}.report"
        process = started(context, self.target, (task, setting, self.out, report))
        now = time.monotonic()
        return _Running(task, deaths, process, report, now + setting.limits.wall_s, now, process.pid)

    def _tell(self, running: list[_Running]) -> None:
        """Tell whoever watches what each run does; files are read for nobody else."""
        now = time.monotonic()
        if self.on_state is not unwatched and now - self._told_s >= _LONGEST_WAIT_S:
            self._told_s = now
            self.on_state(State(tuple(one.state(now) for one in running)))

    def _ended(self, running: list[_Running]) -> list[_Running]:
        """Those that have ended, or must end now; waits for the first of them."""
        patience = min(one.deadline for one in running) - time.monotonic()
        sentinels = [one.process.sentinel for one in running]
        ready = wait(sentinels, timeout=max(0.0, min(patience, _LONGEST_WAIT_S)))
        now = time.monotonic()
        # One wait may last `_LONGEST_WAIT_S`; twice that leaves room for a busy machine.
        unseen_s, self._looked_s = now - self._looked_s - 2 * _LONGEST_WAIT_S, now
        for one in running:
            one.deadline += max(0.0, unseen_s)
        return [one for one in running if one.process.sentinel in ready or one.deadline <= now]

    def _settle(self, ended: _Running, setting: BatchSetting) -> Done | _Deaths:
        """The outcome of a process that has ended or is late; its deaths when it is to be tried again."""
        process, task = ended.process, ended.task
        late = process.is_alive()
        if late:
            stop(process)
        code = process.exitcode
        with suppress(ValueError):  # the kernel still holds it
            process.close()
        (_, plugin), (contents, signature) = last_noted(running_file(ended.report)), _cleared(ended)
        # First of all the report: a process may be killed, or late, after it had left one.
        with suppress(OSError, ValueError):
            # The process may have left anything in its place: a pipe, or more than fits into memory.
            done = parse_report(
                task, read_plain(ended.report, setting.limits.output_bytes + LARGEST_HEAD_BYTES)
            )
            ended.report.unlink()
            return done
        if code == NO_ROOM:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        if late:
            return replace(too_late(task, setting, plugin), contents=contents, signature=signature)
        deaths = ended.deaths.and_one(code)
        if not deaths.given_up:
            return deaths
        done = died(task, *deaths.most_common(), plugin)
        return replace(done, contents=contents, signature=signature, put_off=deaths.put_off)


def _cleared(ended: _Running) -> tuple[str, str]:
    """Remove what the process of a run fetched and noted; hash and signature, where it got so far.

    Hashing the files here instead could hold up the whole batch: the supervisor has no time limit.
    """
    if ended.task.remote:
        shutil.rmtree(fetched_folder(ended.report), ignore_errors=True)
    found = noted(ended.report)
    note_file(ended.report).unlink(missing_ok=True)
    running_file(ended.report).unlink(missing_ok=True)
    return found


def too_late(task: RunTask, setting: BatchSetting, plugin: str = "") -> Done:
    """A run that took longer than it may, and the plugin that ran at the end, where one did."""
    limit = f"{setting.limits.wall_s:g}"
    reason = f"it took longer than {limit} s{_in(plugin)}; raise --time-limit-s if the log is sound"
    return lost(task, "timed_out", reason)


def _in(plugin: str) -> str:
    return f", at last in {plugin}" if plugin else ""


def died(task: RunTask, code: int | None, attempts: int, plugin: str = "") -> Done:
    """A run whose process ended without a report in each attempt, and the plugin that ran last."""
    number = -code if code is not None and code < 0 else 0
    what = f"by signal {number} ({signal.Signals(number).name})" if number else f"with exit code {code}"
    times = f"{attempts} times"
    return lost(task, "killed", f"the process that scored it ended {what}, {times} in {times}{_in(plugin)}")


def lost(task: RunTask, outcome: str, reason: str) -> Done:
    """An outcome without a measurement."""
    document = outcome_document(outcome, reason, team=task.team, trial=task.trial)
    return Done(task, "", "", "", document)


def _first(tasks: Iterator[RunTask]) -> tuple[RunTask, _Deaths] | None:
    task = next(tasks, None)
    return None if task is None else (task, _Deaths())


def started(context: Any, target: Callable[..., None], arguments: tuple[Any, ...]) -> BaseProcess:
    """A new process. Where the fork server is just being killed, the next attempt starts another one.

    Raises:
        BatchError: None can be started.
    """
    for attempt in range(1, _START_ATTEMPTS + 1):
        # As a daemon it is ended with this process.
        process: BaseProcess = context.Process(
            target=_with_environment, args=(dict(os.environ), target, arguments), daemon=True
        )
        try:
            with _only_code_of_this_process():
                process.start()
        except (OSError, EOFError) as cause:
            if attempt == _START_ATTEMPTS:
                raise BatchError(
                    f"no process can be started that scores a run: {type(cause).__name__}: {cause}",
                    hint="what their server printed stands above; try 'ariac-score plugins doctor'",
                ) from cause
            time.sleep(0.1)
        else:
            return process
    raise AssertionError("unreachable")


def _with_environment(
    environment: dict[str, str], target: Callable[..., None], arguments: tuple[Any, ...]
) -> None:
    """Do the work of a process in the environment of the one that asked for it.

    A fork server keeps the environment in which it was started, and with it the credentials of a storage
    that the caller may have changed since.
    """
    os.environ.clear()
    os.environ.update(environment)
    target(*arguments)


def stop(process: BaseProcess) -> None:
    """Kill a process; one that the kernel holds, such as for a disk that does not answer, is left behind."""
    with suppress(ValueError, OSError):
        process.kill()
        process.join(_KILLED_S)


def _end_left_behind(context: Any, ended: int | None) -> None:
    """End what a run started and left behind: it would hold memory, files and the fork server for ever."""
    server = None
    if context.get_start_method() == "forkserver":
        # No public name: in each supported version of Python it is this one, and without it less is found.
        server = getattr(forkserver._forkserver, "_forkserver_pid", None)
    # Whatever this process has started goes on, such as other runs, and processes that price.
    ours = [process.pid for process in multiprocessing.active_children() if process.pid is not None]
    end_children(server, ended, ours, _CHILDREN_S)


def fresh_processes(work: Path, setting: BatchSetting) -> Any:
    """A context for processes that inherit nothing of this one; their server has imported everything."""
    limit_threads()  # before the server starts, which inherits the environment
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    file, text = work / "setting.json", json.dumps(asdict(setting))
    if not file.is_file() or file.read_text(encoding="ascii") != text:  # the server may be reading it
        file.write_text(text, encoding="ascii")
    os.environ[SETTING_VARIABLE] = str(file.absolute())
    context = multiprocessing.get_context("forkserver")
    # Python 3.10 cannot keep its server from importing what lies in the working directory. There each
    # process imports everything itself, after `multiprocessing` has given it the path of this one.
    shadowed = sys.version_info < (3, 11) and _foreign_folder() and Path("ariac_score").exists()
    context.set_forkserver_preload([] if shadowed else ["ariac_score.batch.preload"])
    return context


def _foreign_folder() -> bool:
    """Whether the working directory is another one than that from which the package was imported."""
    try:
        return Path.cwd() != _OWN_FOLDER
    except OSError:  # it was removed
        return False


@contextmanager
def _only_code_of_this_process() -> Iterator[None]:
    """Keep a fork server that is started here from importing what lies in the working directory.

    It is started with `python -c`, which looks there first: in a checkout it would find sources that are
    not installed, and among the files of strangers whatever is named like a module. `preload` removes the
    variable again, for programs that a plugin starts.
    """
    name, value = SAFE_PATH
    if name in os.environ or not _foreign_folder():
        yield
        return
    os.environ[name] = value
    try:
        yield
    finally:
        del os.environ[name]


def begin_server(context: Any) -> None:
    """Have the fork server, if there is one, import everything while the caller goes on."""
    if context.get_start_method() == "forkserver":
        with _only_code_of_this_process():
            forkserver.ensure_running()


def usable_cores() -> int:
    """The cores this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
