"""What lay on a tray when its kit was handed in: contents for submissions that came without.

Simulators take submissions by service call, which says nothing about contents. Other
records do: messages about trays, and the poses of models. They are joined here by
place and time, once all logs of a trial are together.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ariac_score.trial.model import Kit, LogDefect, Pose, Submission, Task, Trial, orders_of
from ariac_score.trial.spans import FloatArray

__all__ = ["ModelTrack", "RecordedKits", "with_contents"]


@dataclass(frozen=True, eq=False)
class ModelTrack:
    """Where one model or link was.

    Attributes:
        name: Scoped: `model` or `model::link`, with the models it is nested in before it.
        frames: The frames that list it, shape (m,), increasing.
        poses: Its pose in each, in the world frame: x, y, z in m, then roll, pitch, yaw in
            rad, shape (m, 6), or the quaternion w, x, y, z, shape (m, 7).
        deleted: The frames that say it is gone, shape (k,), increasing.
    """

    name: str
    frames: NDArray[np.int64]
    poses: FloatArray
    deleted: NDArray[np.int64]

    @property
    def model(self) -> str:
        """The top-level model."""
        return self.name.partition("::")[0]

    def exists(self, frame: int) -> bool:
        """Whether it was there in a frame: listed by then, and not deleted since."""
        row = int(np.searchsorted(self.frames, frame, side="right")) - 1
        # A model that is listed again after its deletion was put there anew.
        gone = int(np.searchsorted(self.deleted, frame, side="right")) - 1
        return row >= 0 and (gone < 0 or bool(self.deleted[gone] <= self.frames[row]))

    def pose(self, frame: int) -> Pose:
        """Its last known pose in a frame in which it exists.

        Raises:
            ValueError: The log gives none that is usable.
        """
        row = self.poses[int(np.searchsorted(self.frames, frame, side="right")) - 1].tolist()
        at, turn = (row[0], row[1], row[2]), row[3:]
        if len(turn) == 3:
            if not all(map(math.isfinite, turn)):
                raise ValueError("a pose must be finite")
            return Pose.from_rpy(at, (turn[0], turn[1], turn[2]))
        return Pose(at, (turn[0], turn[1], turn[2], turn[3]))


class RecordedKits:
    """The contents that messages show, each valid until the next one or until it is too old."""

    def __init__(self, kits: Iterable[Kit]) -> None:
        self._kits: dict[str, list[Kit]] = {}
        for kit in kits:
            self._kits.setdefault(kit.place, []).append(kit)
        for of_place in self._kits.values():
            of_place.sort(key=lambda kit: kit.t_s)
        self._times = {place: [kit.t_s for kit in kits] for place, kits in self._kits.items()}

    def seen(self, place: str, t_s: float, *, max_age_s: float) -> Kit | None:
        """The last contents recorded at or before a time, unless they are older than allowed."""
        # To the right of equal times: contents of the instant of the submission are those handed in.
        last = bisect_right(self._times.get(place, []), t_s) - 1
        if last < 0 or t_s - self._times[place][last] > max_age_s:
            return None
        return self._kits[place][last]


def with_contents(trial: Trial, *, max_age_s: float) -> Trial:
    """The trial with contents for the submissions that came without, where a log shows them.

    Contents stay unknown where nothing says which of the products are faulty: a
    product that is not known to be faulty is not known to be sound.

    Args:
        trial: With everything its parts say.
        max_age_s: How old contents may be at the submission, s.
    """
    # After all parts are merged: one log may show the tray, another the submission.
    tasks = {task.id: task for order in orders_of(trial) for task in order.tasks}
    joined = [_joined(trial, s, tasks.get(s.task_id), max_age_s) for s in trial.submissions]
    count = sum(1 for old, new in zip(trial.submissions, joined, strict=True) if new is not old)
    unmarked = [
        f"which products of {s.task_id} are faulty: its tray is seen, but no trial configuration tells"
        for s in joined
        if s.contents is None and _sight(trial, s, tasks.get(s.task_id), max_age_s) is not None
    ]
    defects = list(trial.log_defects)
    if count:
        message = (
            "submissions came without contents, which were taken from other records of the trays "
            "(poses of a Gazebo log are rounded, by up to 5 mm beyond 10 m)"
        )
        defects.append(LogDefect("joined_contents", trial.id, count, message))
    return replace(
        trial,
        submissions=tuple(joined),
        unrecorded=tuple(sorted({*trial.unrecorded, *unmarked})),
        log_defects=tuple(sorted(defects)),
    )


def _sight(trial: Trial, submission: Submission, task: Task | None, max_age_s: float) -> Kit | None:
    """What the first record that has any shows of a submitted kit.

    Messages stand first: simulators publish in them what they score, which poses only stand in for.
    """
    at_station = task is not None and task.kind != "kitting"
    place = submission.station if at_station else submission.agv
    for record in trial.kits if place else ():
        kit = record.seen(place, submission.submitted_s, max_age_s=max_age_s)
        if kit is not None:
            return kit
    return None


def _joined(trial: Trial, submission: Submission, task: Task | None, max_age_s: float) -> Submission:
    if submission.contents is not None:
        return submission
    kit = _sight(trial, submission, task, max_age_s)
    if kit is None:
        return submission
    contents = kit.contents if kit.faults is None else kit.faults(kit.contents, trial, task)
    if contents is None:
        return submission
    return replace(submission, contents=contents, tray=submission.tray or kit.tray)
