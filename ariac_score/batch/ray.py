"""The executor of a Ray cluster: runs are scored where its workers are."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import ray

from ariac_score.batch.isolated import absolute, measure_apart
from ariac_score.batch.local import AND_AGAIN, STRANGE_HAND_ATTEMPTS, lost
from ariac_score.batch.tasks import Setting, Task
from ariac_score.batch.worker import Done
from ariac_score.errors import BatchError, UsageError

__all__ = ["RayExecutor", "ray_executor"]

_AHEAD = 4
"""Tasks that wait for each processor of the cluster."""


@dataclass
class RayExecutor:
    """Runs tasks on a cluster.

    A worker that is lost takes its run to another one; a run that takes worker after worker with
    it is given up, by name.
    """

    def run(self, tasks: Iterable[Task], setting: Setting) -> Iterator[Done]:
        """Each task's outcome, in the order in which they finish.

        Raises:
            BatchError: No worker can work.
        """
        measure = ray.remote(max_retries=STRANGE_HAND_ATTEMPTS, retry_exceptions=[OSError], num_cpus=1)(
            measure_apart
        )
        shared = ray.put(setting)
        waiting, suspects = iter(tasks), list[Task]()
        try:
            room = max(1, int(ray.cluster_resources().get("CPU", 1))) * _AHEAD
            under_way = {measure.remote(absolute(task), shared): task for task in islice(waiting, room)}
            while under_way:
                (future, *_), _ = ray.wait(list(under_way), num_returns=1)
                task = under_way.pop(future)
                done = _result(future, task)
                if done.put_off:
                    suspects.append(task)
                else:
                    yield done
                for following in islice(waiting, 1):
                    under_way[measure.remote(absolute(following), shared)] = following
            for task in suspects:  # alone
                yield _result(measure.remote(absolute(task), shared), task)
        finally:
            ray.shutdown()


def _result(future: Any, task: Task) -> Done:
    try:
        done: Done = ray.get(future)
    except ray.exceptions.WorkerCrashedError:  # its words name a process and a machine
        return lost(task, "killed", "worker after worker that scored it was lost")
    except ray.exceptions.RayError as error:
        cause = getattr(error, "cause", error)  # what was raised there; the words of Ray name a process
        what = f"{type(cause).__name__}: {cause}".split("\n", maxsplit=1)[0]
        if isinstance(error, OSError):
            raise BatchError(
                f"no worker could do its work: {what}", hint=f"see to the workers, {AND_AGAIN}"
            ) from error
        return lost(task, "killed", f"every worker that scored it failed: {what}")
    return replace(done, task=task)


def ray_executor(*, jobs: int, scheduler: str, out: Path, work: Path) -> RayExecutor:
    """A cluster by its address, such as `ray://HOST:10001`, or `auto` for the one this machine is part of.

    Raises:
        UsageError: No address is given, or nothing answers there.
    """
    del out, work  # workers may be elsewhere, and see neither
    if not scheduler:
        raise UsageError("the Ray executor needs an address", hint="--scheduler ray://HOST:10001, or auto")
    if jobs:
        raise UsageError(
            "how many runs go on at a time is for the cluster to say", hint="drop --jobs; add machines"
        )
    try:
        ray.init(address=scheduler, log_to_driver=False, logging_level="ERROR")
    except (ConnectionError, OSError, ValueError, RuntimeError) as cause:
        raise UsageError(
            f"the cluster at {scheduler} cannot be reached: {cause}".split("\n", maxsplit=1)[0],
            hint="start one with 'ray start --head', and check address and firewall",
        ) from cause
    return RayExecutor()
