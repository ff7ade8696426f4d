"""When the task of a trial began and ended: nothing of it is in the recording.

A file `task_times.yaml` beside the recordings states it; what the official result says of the duration
can be turned round; otherwise it is unknown. That a task was never completed is a statement of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ariac_score import DataFileError, LogDescription, ReaderFacts, Record, Trial, Wanted, load_yaml
from ariac_score_aic.run_config import text_at_top

__all__ = ["STEP_NS", "TaskTimes", "TaskTimesReader", "TimesOfRun"]

FORMAT = "task times of the AI for Industry Challenge"
STEP_NS = 2_000_000
"""The simulation advances by so much, so that every duration is a multiple of it."""
_KEYS = {"start_ns", "end_ns", "completed"}


@dataclass(frozen=True)
class TaskTimes:
    """What is known of the times of a task.

    Attributes:
        start_ns: When the goal was accepted, in ns of the engine's clock; `None`: see `start_known`.
        end_ns: When it was completed, likewise.
        start_known: Whether it is known when it started, or that it never did.
        end_known: Whether it is known when it ended, or that it was not completed.
        completed: Whether it was completed; `None`: nobody knows.
        duration_s: From start to end where it is known although the two are not.
        exact: Whether the duration is known to the step of the simulation; else to 0.01 s.
        source: Who states it; empty where nobody does.
    """

    start_ns: int | None = None
    end_ns: int | None = None
    start_known: bool = False
    end_known: bool = False
    completed: bool | None = None
    duration_s: float | None = None
    exact: bool = True
    source: str = ""

    @property
    def not_completed(self) -> bool:
        """Whether it is known that the task was not completed."""
        return self.completed is False


@dataclass(frozen=True)
class TimesOfRun(Record):
    """The times of the trials of a run, by trial id, as a file states them."""

    file: str
    trials: tuple[tuple[str, TaskTimes], ...]


class TaskTimesReader:
    """Reads `task_times.yaml`: when the task of each trial began and ended.

    Reads:
        `trials.<id>.start_ns` and `.end_ns`, in ns of the engine's clock; `null` says that there was none: a
        task without an end was not completed. `completed: false` says that alone. A key that is
        absent says nothing.
    Refuses:
        Unknown keys, and times that are no whole numbers of nanoseconds.
    Source:
        This project's own file, for the engine records neither time.
    """

    facts = ReaderFacts(
        role="task_times", a_file="a file of task times", formats="task times of AIC 2026 (YAML)"
    )

    def can_read(self, path: Path) -> bool:
        """Whether it is YAML that begins with `format: aic-task-times/1`."""
        return text_at_top(path).startswith("format: aic-task-times/1")

    def describe(self, path: Path) -> LogDescription:
        """The trials it is about."""
        try:
            times = read_times(path)
        except DataFileError as error:
            return LogDescription(FORMAT, damage=str(error))
        return LogDescription(FORMAT, facts={"trials": len(times.trials)})

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The times of all trials.

        Raises:
            DataFileError: It is malformed.
        """
        times = read_times(path)
        wanted.progress(1.0)
        return Trial(id=path.stem, records=(times,))


def read_times(path: Path) -> TimesOfRun:
    """The times in a file.

    Raises:
        DataFileError: It is malformed.
    """
    document = load_yaml(path)

    def refuse(place: tuple[str | int, ...], cause: str) -> DataFileError:
        hint = (
            "write 'start_ns: 100000000000' and 'end_ns: 120000000000'; 'end_ns: null' if it did not complete"
        )
        return DataFileError(cause, file=document.file, place=document.place(place), hint=hint)

    data = document.data if isinstance(document.data, dict) else {}
    if unknown := sorted(set(data) - {"format", "trials"}):
        raise refuse((unknown[0],), f"{unknown[0]!r} is no key of it")
    trials = data.get("trials")
    if not isinstance(trials, dict) or not trials:
        raise refuse(("trials",), "it names no trial")
    found = []
    for name, stated in trials.items():
        place: tuple[str | int, ...] = ("trials", name)
        if not isinstance(stated, dict) or (set(stated) - _KEYS):
            raise refuse(place, f"trial {name!r} has something else than {', '.join(sorted(_KEYS))}")
        for key in ("start_ns", "end_ns"):
            value = stated.get(key)
            if value is not None and (isinstance(value, bool) or not isinstance(value, int) or value < 0):
                raise refuse((*place, key), f"{key} is {str(value)[:40]!r}, and no time in whole ns")
        if not isinstance(stated.get("completed", False), bool):
            raise refuse((*place, "completed"), "'completed' is neither true nor false")
        found.append((str(name), _times(stated, path.name)))
    return TimesOfRun(path.name, tuple(found))


def _times(stated: dict[str, Any], source: str) -> TaskTimes:
    completed = stated.get("completed")
    if "end_ns" in stated:
        completed = stated["end_ns"] is not None
    start_ns, end_ns = stated.get("start_ns"), stated.get("end_ns")
    return TaskTimes(
        start_ns,
        end_ns,
        "start_ns" in stated,
        "end_ns" in stated or completed is False,
        completed,
        None if start_ns is None or end_ns is None else (end_ns - start_ns) / 1e9,
        True,
        source,
    )
