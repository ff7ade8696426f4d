"""The executor of a Dask cluster: runs are scored where its workers are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import distributed

from ariac_score.batch.isolated import absolute, earlier_document, measure_apart
from ariac_score.batch.local import AND_AGAIN, STRANGE_HAND_ATTEMPTS, lost
from ariac_score.batch.tasks import Setting, Task
from ariac_score.batch.worker import Done
from ariac_score.errors import BatchError, UsageError

__all__ = ["DaskExecutor", "dask_executor"]

_AHEAD = 4
"""Tasks that wait at the scheduler for each thread of a worker."""
_ALONE = 2
"""How often a run that was there when worker after worker was lost is tried again, with nothing beside it."""
_CONNECT_S = 20


@dataclass
class DaskExecutor:
    """Runs tasks on a cluster.

    A worker that is lost takes its run to another one. What was with several that were lost, or whose own
    process was killed again and again, is put off to the end and then tried alone, for most of it only
    stood beside the run that took them; one that takes worker after worker with it even then is given
    up, by name.

    The setting goes with every task: what is kept on the workers is lost with them.

    Attributes:
        client: Connected to the scheduler.
        out: Folder of the batch, for what is stored of the runs.
    """

    client: Any
    out: Path | None = None

    def run(self, tasks: Iterable[Task], setting: Setting) -> Iterator[Done]:
        """Each task's outcome, in the order in which they finish.

        Raises:
            BatchError: The scheduler is lost, or no worker can work.
        """
        waiting, suspects = iter(tasks), list[Task]()
        with self.client:
            threads = sum(self.client.nthreads().values()) or 1
            under_way = {self._submit(task, setting): task for task in islice(waiting, threads * _AHEAD)}
            finished = distributed.as_completed(list(under_way), loop=self.client.loop, raise_errors=False)
            for future in finished:
                task = under_way.pop(future)
                done = self._result(future, task)
                if done is None or done.put_off:
                    suspects.append(task)
                else:
                    yield done
                future.release()
                for following in islice(waiting, 1):
                    new = self._submit(following, setting)
                    under_way[new] = following
                    finished.add(new)
            for task in suspects:
                yield self._alone(task, setting)

    def _alone(self, task: Task, setting: Setting) -> Done:
        done = None
        for _ in range(_ALONE):
            done = self._result(self._submit(task, setting), task)
            if done is not None and not done.put_off:
                break
        return done or lost(task, "killed", "worker after worker that scored it was lost")

    def _submit(self, task: Task, setting: Setting) -> Any:
        earlier = earlier_document(task, self.out)
        return self.client.submit(
            measure_apart, absolute(task), setting, earlier, pure=False, retries=STRANGE_HAND_ATTEMPTS
        )

    def _result(self, future: Any, task: Task) -> Done | None:
        """What came of a task; `None` when all workers that had it were lost."""
        error = future.exception()
        if future.cancelled():
            raise BatchError(
                "the scheduler was lost",
                hint=f"start it and its workers, {AND_AGAIN}",
            )
        if error is None:
            done: Done = future.result()
            return replace(done, task=task)
        if isinstance(error, distributed.KilledWorker):
            return None
        what = f"{type(error).__name__}: {error}".split("\n", maxsplit=1)[0]
        if isinstance(error, OSError):
            raise BatchError(f"no worker could do its work: {what}", hint=f"see to the workers, {AND_AGAIN}")
        return lost(task, "killed", f"every worker that scored it failed: {what}")


def dask_executor(*, jobs: int, scheduler: str, out: Path, work: Path) -> DaskExecutor:
    """A cluster by the address of its scheduler.

    Raises:
        UsageError: No address is given, or nothing answers there.
    """
    del work  # workers may be elsewhere, and do not see it
    if not scheduler:
        raise UsageError("the Dask executor needs a scheduler", hint="--scheduler tcp://HOST:8786")
    if jobs:
        raise UsageError(
            "how many runs go on at a time is for the workers to say", hint="drop --jobs; start more workers"
        )
    try:
        return DaskExecutor(distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False), out)
    except (OSError, ValueError, TimeoutError) as cause:
        raise UsageError(
            f"the scheduler at {scheduler} cannot be reached: {cause}",
            hint="start one with 'dask scheduler', and check address and firewall",
        ) from cause
