"""How long a batch waits for a cluster that gives no result."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from ariac_score.batch.local import AND_AGAIN, KILLED_FROM_OUTSIDE_ATTEMPTS
from ariac_score.batch.state import (
    NO_WORKERS,
    SCHEDULER_LOST,
    WORKERS_SILENT,
    OnState,
    RunUnderWay,
    State,
    Waiting,
    unwatched,
)
from ariac_score.batch.tasks import BatchSetting
from ariac_score.errors import BatchError

__all__ = ["LOOK_S", "Patience"]

LOOK_S = 5.0
"""Between two looks at a cluster while no result comes."""
WITHOUT_WORKERS_S = 300.0
"""How long workers may be away: a cluster that grows on demand needs minutes to bring its first."""


@dataclass
class Patience:
    """Ends the wait for a cluster that does not work any more.

    While there are workers, the longest wait that can still end well is that for one run whose process is
    killed from outside again and again, each time shortly before its time is up.

    Attributes:
        cluster: Its address, for the error message.
        workers: Returns how many workers it has.
        setting: With the time that a run may take.
        on_state: Called while there is something to wait for.
        at_work: Returns the runs that the cluster has, the oldest first, as far as it tells.
    """

    cluster: str
    workers: Callable[[], int]
    setting: BatchSetting
    on_state: OnState = unwatched
    at_work: Callable[[], Iterable[RunUnderWay]] = tuple
    _looked_s: float = field(default_factory=time.monotonic, init=False)
    _silent_s: float = field(default=0.0, init=False)
    _without_s: float = field(default=0.0, init=False)

    def reset(self) -> None:
        """Start over: a result has come."""
        self._looked_s, self._silent_s, self._without_s = time.monotonic(), 0.0, 0.0

    def check(self) -> None:
        """Check whether it makes sense to wait on.

        Raises:
            BatchError: The cluster has had no worker, or has given nothing, for too long.
        """
        now = time.monotonic()
        # At most the time of two looks: a machine that slept, or was stopped, did not wait.
        passed_s, self._looked_s = min(now - self._looked_s, 2 * LOOK_S), now
        self._silent_s += passed_s
        count = self._count()
        self._without_s = 0.0 if count else self._without_s + passed_s
        longest_s = max(WITHOUT_WORKERS_S, self.setting.limits.wall_s * KILLED_FROM_OUTSIDE_ATTEMPTS)
        if count:
            waiting = Waiting(WORKERS_SILENT, self.cluster, self._silent_s, longest_s)
        else:
            name = NO_WORKERS if count == 0 else SCHEDULER_LOST
            waiting = Waiting(name, self.cluster, self._without_s, WITHOUT_WORKERS_S)
        self.on_state(State(tuple(self.at_work()) if count else (), waiting))
        if self._without_s > WITHOUT_WORKERS_S:
            seen = "no worker" if count == 0 else "no scheduler that answers"
            raise BatchError(
                f"the cluster at {self.cluster} has had {seen} for {self._without_s:.0f} s",
                hint=f"start workers, {AND_AGAIN}",
            ).named(waiting.name)
        if self._silent_s > longest_s:
            raise BatchError(
                f"the {count} workers of the cluster at {self.cluster} have given nothing for "
                f"{self._silent_s:.0f} s, and a run may take {self.setting.limits.wall_s:g} s",
                hint=f"see what holds them up, {AND_AGAIN}",
            ).named(waiting.name)

    def _count(self) -> int | None:
        """How many workers there are; `None` when nobody answers."""
        try:
            return self.workers()
        except Exception:  # noqa: BLE001  # every library has errors of its own for a scheduler that is away
            return None
