"""The files of runs, looked at from outside: a storage that does not answer holds up nobody."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from queue import Empty, SimpleQueue
from threading import Thread

from ariac_score.batch.address import signature_of
from ariac_score.batch.tasks import RunTask

__all__ = ["signatures"]

_TOGETHER = 64
"""Runs that are looked at together: handing each over by itself would take as long as the look."""
ANSWER_S = 60.0
"""How long the file system may take for those."""


def signatures(
    tasks: Iterable[RunTask], is_known: Callable[[RunTask], bool]
) -> Iterator[tuple[RunTask, str]]:
    """Each task with the signature of its files.

    Empty where nobody needs it, and where the file system did not answer: such a run goes to a process
    of its own, which has a time limit. A thread that hangs is left behind; as a daemon it keeps no
    process alive.

    Args:
        tasks: All runs.
        is_known: Whether an earlier call may have scored it.
    """
    waiting = iter(tasks)
    looker: _Looker | None = None
    while several := list(islice(waiting, _TOGETHER)):
        known = [task for task in several if not task.refused and is_known(task)]
        found: dict[int, str] = {}
        if known:
            looker = looker or _Looker()
            answer = looker.look(known)
            if answer is None:
                looker = None
            else:
                found = {id(task): signature for task, signature in zip(known, answer, strict=True)}
        for task in several:
            yield task, found.get(id(task), "")


class _Looker:
    """A thread that looks at files."""

    def __init__(self) -> None:
        self._asked: SimpleQueue[list[RunTask]] = SimpleQueue()
        self._answers: SimpleQueue[list[str]] = SimpleQueue()
        Thread(target=self._run, daemon=True).start()

    def look(self, tasks: list[RunTask]) -> list[str] | None:
        """The signature of each; `None` when they do not come in time, and this one is of no more use."""
        self._asked.put(tasks)
        try:
            return self._answers.get(timeout=ANSWER_S)
        except Empty:
            return None

    def _run(self) -> None:
        while tasks := self._asked.get():
            self._answers.put([_signature(task) for task in tasks])


def _signature(task: RunTask) -> str:
    try:
        return signature_of(task)
    except (OSError, ValueError):
        return ""
