"""What a batch is doing, for whoever watches: the runs that are scored now, and what it waits for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ariac_score.batch.tasks import TaskKey

__all__ = [
    "NO_WORKERS",
    "SCHEDULER_LOST",
    "STORAGE_UNREACHABLE",
    "WORKERS_SILENT",
    "OnState",
    "RunUnderWay",
    "State",
    "Waiting",
    "unwatched",
]

NO_WORKERS = "no_workers"
"""A cluster has none."""
SCHEDULER_LOST = "scheduler_lost"
"""Nobody answers at the address of a cluster."""
STORAGE_UNREACHABLE = "storage_unreachable"
"""A storage does not list what lies there."""
WORKERS_SILENT = "workers_silent"
"""A cluster has workers, and they give no result."""


@dataclass(frozen=True)
class Waiting:
    """A wait that nobody here can shorten.

    Attributes:
        name: One of the names of this module; the error has it too when the wait is given up.
        place: Address of what is waited for.
        waited_s: So far, s.
        most_s: After so long it is given up, s.
    """

    name: str
    place: str
    waited_s: float
    most_s: float


@dataclass(frozen=True)
class RunUnderWay:
    """A run that is being scored.

    Attributes:
        key: Team, trial and number.
        for_s: Since so long, s.
        doing: In words, such as the check and the plugin that run.
    """

    key: TaskKey
    for_s: float
    doing: str


@dataclass(frozen=True)
class State:
    """What a batch is doing.

    Attributes:
        running: The runs that are scored on this machine, or that a cluster has, the oldest first.
        waiting: What is waited for; `None` while results come.
    """

    running: tuple[RunUnderWay, ...] = ()
    waiting: Waiting | None = None


OnState = Callable[[State], None]
"""Called about once a second, or whenever a cluster is looked at."""


def unwatched(_state: State) -> None:
    """Nobody watches."""
