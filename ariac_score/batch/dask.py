"""The executor of a Dask cluster: runs are scored where its workers are."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

import distributed

from ariac_score.batch.isolated import absolute, earlier_document, measure_isolated
from ariac_score.batch.local import AND_AGAIN, KILLED_FROM_OUTSIDE_ATTEMPTS, lost
from ariac_score.batch.patience import LOOK_S, Patience
from ariac_score.batch.state import SCHEDULER_LOST, OnState, RunUnderWay, unwatched
from ariac_score.batch.tasks import BatchSetting, RunTask
from ariac_score.batch.worker import Done
from ariac_score.errors import BatchError, UsageError

__all__ = ["DaskExecutor", "dask_executor"]

_AHEAD = 4
"""Tasks that wait at the scheduler for each thread of a worker."""
_ALONE = 2
"""Attempts, with no other run at work, at a run that was there when several workers were lost."""
_CONNECT_S = 20
_ANSWER_S = 10
"""How long the scheduler may take to state its workers."""
_Value = TypeVar("_Value")


@dataclass
class DaskExecutor:
    """Runs tasks on a cluster.

    The run of a worker that is lost goes to another one. A run that was on several lost workers, or whose
    own process was killed again and again, is tried alone at the end: most such runs only shared a worker
    with the one that brought it down. A run that brings down worker after worker even then is given up.

    The setting goes with every task: what is kept on the workers is lost with them.

    Attributes:
        client: Connected to the scheduler.
        out: Folder of the batch, for what is stored of the runs.
        on_state: Called while the cluster gives nothing.
    """

    client: Any
    out: Path | None = None
    on_state: OnState = unwatched

    def run(self, tasks: Iterable[RunTask], setting: BatchSetting) -> Iterator[Done]:
        """Each task's outcome, in the order in which they finish.

        Raises:
            BatchError: The scheduler is lost, no worker can work, or none has been there for minutes.
        """
        waiting, suspects = iter(tasks), list[RunTask]()
        finished: SimpleQueue[Any] = SimpleQueue()
        patience = Patience(self._address(), lambda: len(self._threads()), setting, self.on_state)
        under_way: dict[Any, RunTask] = {}
        seen_s: dict[str, float] = {}

        def at_work() -> list[RunUnderWay]:
            """The runs that workers have, and which ones; a worker does not tell what it does with them."""
            placed, now = self._placed(), time.monotonic()
            for key in seen_s.keys() - placed.keys():
                del seen_s[key]
            return sorted(
                (
                    RunUnderWay(
                        task.key, now - seen_s.setdefault(future.key, now), f"at {placed[future.key]}"
                    )
                    for future, task in under_way.items()
                    if future.key in placed
                ),
                key=lambda run: -run.for_s,
            )

        patience.at_work = at_work

        def submit_next(count: int) -> None:
            for task in islice(waiting, count):
                future = self._submit(task, setting)
                under_way[future] = task
                future.add_done_callback(finished.put)

        with self.client:
            submit_next((sum(self._threads().values()) or 1) * _AHEAD)
            while under_way:
                future = _waited(lambda most_s: finished.get(timeout=most_s), patience)
                task = under_way.pop(future)
                done = self._result(future, task, patience)
                if done is None or done.put_off:
                    suspects.append(task)
                else:
                    yield done
                future.release()
                submit_next(1)
            for task in suspects:
                yield self._alone(task, setting, patience)

    def _address(self) -> str:
        return str(self.client.scheduler.address)

    def _threads(self) -> dict[str, int]:
        """The threads of each worker.

        Raises:
            BatchError: The scheduler does not answer.
        """
        try:
            threads: dict[str, int] = self.client.nthreads(callback_timeout=_ANSWER_S)
        except (OSError, distributed.TimeoutError) as cause:
            raise BatchError(
                f"the scheduler at {self._address()} does not answer",
                hint=f"start it and its workers, {AND_AGAIN}",
            ).named(SCHEDULER_LOST) from cause
        return threads

    def _placed(self) -> dict[str, str]:
        """The worker that has each task; empty where the scheduler does not say."""
        with suppress(OSError, distributed.TimeoutError):
            asked = self.client.sync(
                self.client.scheduler.processing, workers=None, callback_timeout=_ANSWER_S
            )
            return {key: worker for worker, keys in asked.items() for key in keys}
        return {}

    def _alone(self, task: RunTask, setting: BatchSetting, patience: Patience) -> Done:
        done = None
        for _ in range(_ALONE):
            done = self._result(self._submit(task, setting), task, patience)
            if done is not None and not done.put_off:
                break
        return done or lost(task, "killed", "worker after worker that scored it was lost")

    def _submit(self, task: RunTask, setting: BatchSetting) -> Any:
        earlier = earlier_document(task, self.out)
        # Not pure: Dask would give the outcome of the first attempt again.
        return self.client.submit(
            measure_isolated,
            absolute(task),
            setting,
            earlier,
            pure=False,
            retries=KILLED_FROM_OUTSIDE_ATTEMPTS,
        )

    def _result(self, future: Any, task: RunTask, patience: Patience) -> Done | None:
        """The outcome of a task; `None` when all workers that had it were lost.

        A finished task may still have to be done again: its result lies on its worker until it is fetched,
        and is lost with that worker.
        """
        error = _waited(future.exception, patience)
        if future.cancelled():
            raise self._lost()
        if error is None:
            try:
                done: Done = _waited(future.result, patience)
            except distributed.KilledWorker:
                return None
            except CancelledError as cause:
                raise self._lost() from cause
            return replace(done, task=task)
        if isinstance(error, distributed.KilledWorker):
            return None
        what = f"{type(error).__name__}: {error}".split("\n", maxsplit=1)[0]
        if isinstance(error, OSError):
            raise BatchError(f"no worker could do its work: {what}", hint=f"see to the workers, {AND_AGAIN}")
        return lost(task, "killed", f"every worker that scored it failed: {what}")

    def _lost(self) -> BatchError:
        return BatchError(
            f"the scheduler was lost: {self._address()}", hint=f"start it and its workers, {AND_AGAIN}"
        ).named(SCHEDULER_LOST)


def _waited(ask: Callable[[float], _Value], patience: Patience) -> _Value:
    """The answer of a call that takes a time-out, repeated as long as the cluster can still give one.

    Raises:
        BatchError: It cannot.
    """
    while True:
        try:
            value = ask(LOOK_S)
        except (Empty, distributed.TimeoutError):
            patience.check()
        else:
            patience.reset()
            return value


def dask_executor(*, jobs: int, scheduler: str, out: Path, work: Path) -> DaskExecutor:
    """A cluster by the address of its scheduler.

    Raises:
        UsageError: No address is given, or nothing answers there.
    """
    del work  # workers may be on other machines, which do not see it
    if not scheduler:
        raise UsageError("the Dask executor needs a scheduler", hint="--scheduler tcp://HOST:8786")
    if jobs:
        raise UsageError(
            "the workers decide how many runs are scored at a time", hint="drop --jobs; start more workers"
        )
    try:
        return DaskExecutor(distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False), out)
    except (OSError, ValueError, TimeoutError) as cause:
        raise UsageError(
            f"the scheduler at {scheduler} cannot be reached: {cause}",
            hint="start one with 'dask scheduler', and check address and firewall",
        ) from cause
