"""The executor of a Ray cluster: runs are scored where its workers are."""

from __future__ import annotations

import atexit
import os
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import ray

from ariac_score.batch.isolated import absolute, earlier_document, measure_isolated
from ariac_score.batch.local import AND_AGAIN, KILLED_FROM_OUTSIDE_ATTEMPTS, lost
from ariac_score.batch.patience import LOOK_S, Patience
from ariac_score.batch.state import SCHEDULER_LOST, OnState, RunUnderWay, unwatched
from ariac_score.batch.tasks import BatchSetting, RunTask
from ariac_score.batch.worker import Done
from ariac_score.errors import BatchError, UsageError

__all__ = ["RayExecutor", "ray_executor"]

_AHEAD = 4
"""Tasks that wait for each processor of the cluster."""
_CONNECT_S = 20
_LISTENS_S = 2.0
_MISSED = 3
"""Looks in a row at which nothing listens where the head was, before it counts as lost."""
_HINT = (
    "start one with 'ray start --head', and check address and firewall; "
    "where it wants a token, set RAY_AUTH_MODE=token"
)


@dataclass
class RayExecutor:
    """Runs tasks on a cluster.

    The run of a worker that is lost goes to another one; a run that brings down worker after worker is
    given up.

    Attributes:
        out: Folder of the batch, for what is stored of the runs.
        measure: What a worker does with a task.
        on_state: Called while the cluster gives nothing.
    """

    out: Path | None = None
    measure: Callable[[RunTask, BatchSetting, bytes], Done] = measure_isolated
    on_state: OnState = unwatched

    def run(self, tasks: Iterable[RunTask], setting: BatchSetting) -> Iterator[Done]:
        """Each task's outcome, in the order in which they finish.

        Raises:
            BatchError: No worker can work, or none has been there for minutes.
        """
        # An OSError is a fault of the worker's machine, see `measure_isolated`; another one may do better.
        measure = ray.remote(
            max_retries=KILLED_FROM_OUTSIDE_ATTEMPTS, retry_exceptions=[OSError], num_cpus=1
        )(self.measure)
        shared = ray.put(setting)

        def submitted(task: RunTask) -> Any:
            return measure.remote(absolute(task), shared, earlier_document(task, self.out))

        waiting, suspects = iter(tasks), list[RunTask]()
        under_way: dict[Any, tuple[RunTask, float]] = {}

        def at_work() -> list[RunUnderWay]:
            """The runs that the cluster has, whether they wait there or are scored: it tells no more."""
            now = time.monotonic()
            return [
                RunUnderWay(task.key, now - since_s, "given to the cluster")
                for task, since_s in under_way.values()
            ]

        def submit_next(count: int) -> None:
            for task in islice(waiting, count):
                under_way[submitted(task)] = (task, time.monotonic())

        address = ray.get_runtime_context().gcs_address
        patient = Patience(address, _workers, setting, self.on_state, at_work)
        patience = _Head.watched(address, patient)
        headless = False
        try:
            room = max(1, int(ray.cluster_resources().get("CPU", 1))) * _AHEAD
            submit_next(room)
            while under_way:
                finished, _ = ray.wait(list(under_way), num_returns=1, timeout=LOOK_S)
                if not finished:
                    patience.check()
                    continue
                task, _ = under_way.pop(finished[0])
                done = _result(finished[0], task, patience)
                if done.put_off:
                    suspects.append(task)
                else:
                    yield done
                submit_next(1)
            # Alone at the end: together with others they may have needed too much memory.
            for task in suspects:
                yield _result(submitted(task), task, patience)
        except BatchError as error:
            headless = error.name == SCHEDULER_LOST
            raise
        finally:
            if headless:  # Ray would wait for its head, and then end the whole process without a word
                atexit.unregister(ray.shutdown)
                atexit.register(_leave)
            else:
                ray.shutdown()


def _leave() -> None:
    """End this process with the exit code of a lost scheduler: Ray's library crashes while it is unloaded."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(BatchError.exit_code)


@dataclass
class _Head:
    """The patience with a cluster, and whether its head still listens.

    Ray itself does not answer when its head is gone, and ends this process a minute later.

    Attributes:
        address: Of the head; empty where it cannot be reached from here, as through a client.
        patience: With the cluster.
    """

    address: str
    patience: Patience
    _missed: int = 0

    @classmethod
    def watched(cls, address: str, patience: Patience) -> _Head:
        """The head at an address, watched where this machine reaches it."""
        return cls(address if _listens(address) else "", patience)

    def reset(self) -> None:
        """Start over: a result has come."""
        self._missed = 0
        self.patience.reset()

    def check(self) -> None:
        """Check whether it makes sense to wait on.

        Raises:
            BatchError: The head is gone, or the cluster gives nothing.
        """
        if not self.address or _listens(self.address):
            self._missed = 0
            self.patience.check()
            return
        self._missed += 1
        if self._missed >= _MISSED:
            raise _head_lost(self.address)


def _head_lost(address: str) -> BatchError:
    return BatchError(
        f"the head of the cluster at {address} is gone", hint=f"start the cluster, {AND_AGAIN}"
    ).named(SCHEDULER_LOST)


def _listens(address: str) -> bool:
    """Whether something does at an address."""
    host, _, port = address.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_LISTENS_S).close()
    except (OSError, ValueError):
        return False
    return True


def _workers() -> int:
    """How many machines of the cluster are there to work."""
    return sum(1 for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU"))


def _fetched(future: Any, patience: _Head) -> Done:
    """The outcome of a task, awaited as long as the cluster can still give one.

    Raises:
        BatchError: It cannot.
        RayError: The task failed.
    """
    while True:
        try:
            done: Done = ray.get(future, timeout=LOOK_S)
        except ray.exceptions.GetTimeoutError:
            patience.check()
        else:
            patience.reset()
            return done


def _result(future: Any, task: RunTask, patience: _Head) -> Done:
    try:
        done = _fetched(future, patience)
    # Ray's own messages name processes and machines, and a reason has to be the same anywhere.
    except ray.exceptions.WorkerCrashedError:
        return lost(task, "killed", "worker after worker that scored it was lost")
    except ray.exceptions.LocalRayletDiedError as error:
        raise _head_lost(patience.patience.cluster) from error
    except ray.exceptions.RayError as error:
        cause = getattr(error, "cause", error)
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
    del work  # workers may be on other machines, which do not see it
    if not scheduler:
        raise UsageError("the Ray executor needs an address", hint="--scheduler ray://HOST:10001, or auto")
    if jobs:
        raise UsageError(
            "the cluster decides how many runs are scored at a time", hint="drop --jobs; add machines"
        )
    try:
        _check_reachable(scheduler)
        ray.init(address=scheduler, log_to_driver=False, logging_level="ERROR")
    except (ConnectionError, OSError, ValueError, RuntimeError) as cause:
        raise UsageError(
            f"the cluster at {scheduler} cannot be reached: {cause}".split("\n", maxsplit=1)[0], hint=_HINT
        ) from cause
    return RayExecutor(out)


def _check_reachable(scheduler: str) -> None:
    """Try to connect to an address: Ray itself takes ten minutes to report that nothing listens there.

    Raises:
        OSError: Nothing does.
        ValueError: It is no address.
    """
    address = _current() if scheduler == "auto" else scheduler
    parts = urlsplit(address if "://" in address else f"//{address}")
    host, port = parts.hostname, parts.port
    if not host or not port:
        return  # Ray reports what is wrong with it
    if not parts.scheme and host in ("localhost", "127.0.0.1", "::1"):
        host = ray.util.get_node_ip_address()  # where Ray would look for it
    socket.create_connection((host, port), timeout=_CONNECT_S).close()


def _current() -> str:
    """The cluster that this machine is part of, as far as that is known."""
    if address := os.environ.get("RAY_ADDRESS"):
        return address
    with suppress(OSError):
        folder = Path(os.environ.get("RAY_TMPDIR") or tempfile.gettempdir())
        return (folder / "ray" / "ray_current_cluster").read_text(encoding="utf-8").strip()
    return ""
