"""The executor of a Dask cluster: runs are scored where its workers are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import distributed

from ariac_score.batch.isolated import absolute, earlier_document, measure_apart
from ariac_score.batch.local import STRANGE_HAND_ATTEMPTS, lost
from ariac_score.batch.tasks import Setting, Task
from ariac_score.batch.worker import Done
from ariac_score.errors import UsageError

__all__ = ["DaskExecutor", "dask_executor"]

_AHEAD = 4
"""Tasks that wait at the scheduler for each thread of a worker."""
_CONNECT_S = 20


@dataclass
class DaskExecutor:
    """Runs tasks on a cluster.

    A worker that is lost takes its run to another one; a run that takes worker after worker with
    it is given up, by name.

    Attributes:
        client: Connected to the scheduler.
        out: Folder of the batch, for what is stored of the runs.
    """

    client: Any
    out: Path | None = None

    def run(self, tasks: Iterable[Task], setting: Setting) -> Iterator[Done]:
        """Each task's outcome, in the order in which they finish."""
        waiting = iter(tasks)
        with self.client:
            shared = self.client.scatter(setting, broadcast=True, hash=False)
            threads = sum(self.client.nthreads().values()) or 1
            under_way = {self._submit(task, shared): task for task in islice(waiting, threads * _AHEAD)}
            finished = distributed.as_completed(list(under_way), loop=self.client.loop, raise_errors=False)
            for future in finished:
                task = under_way.pop(future)
                yield _result(future, task)
                future.release()
                for following in islice(waiting, 1):
                    new = self._submit(following, shared)
                    under_way[new] = following
                    finished.add(new)

    def _submit(self, task: Task, setting: Any) -> Any:
        earlier = earlier_document(task, self.out)
        return self.client.submit(
            measure_apart, absolute(task), setting, earlier, pure=False, retries=STRANGE_HAND_ATTEMPTS
        )


def _result(future: Any, task: Task) -> Done:
    error = future.exception()
    if error is None:
        done: Done = future.result()
        return replace(done, task=task)
    what = f"{type(error).__name__}: {error}".split("\n", maxsplit=1)[0]
    return lost(task, "killed", f"every worker that scored it was lost: {what}")


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
