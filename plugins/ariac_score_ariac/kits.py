"""What lay on a tray when its kit was handed in: contents for submissions that came without.

Simulators take submissions by service call, which says nothing about contents. Other
records do: messages about trays, and the poses of models. They are joined here by
place and time, once all logs of a trial are together.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from ariac_score import LogDefect, Trial
from ariac_score_ariac.work import Kit, KitRecord, KitSubmission, Task, orders_of, submissions_of

__all__ = ["RecordedKits", "with_contents"]


_LONGER_PAUSE = 1.1
"""A pause so many times the usual one is none of the contact sensor that lets a tray be published."""

_SENSOR_S = 1.0
"""That sensor publishes once a second at least (SDF of trays and boxes, 2017 to 2022): where the usual pause
is longer, messages are missing."""


class RecordedKits(KitRecord):
    """The contents that messages show, each valid until the next one or until it is too old."""

    def __init__(self, kits: Iterable[Kit]) -> None:
        self._kits: dict[str, list[Kit]] = {}
        for kit in kits:
            self._kits.setdefault(kit.place, []).append(kit)
        for of_place in self._kits.values():
            of_place.sort(key=lambda kit: kit.t_s)
        self._times = {place: [kit.t_s for kit in kits] for place, kits in self._kits.items()}

    def seen(self, place: str, t_s: float, *, max_age_s: float) -> Kit | None:
        """The last contents recorded at or before a time, unless they are older than allowed and usual."""
        # To the right of equal times: contents of the instant of the submission are those handed in.
        last = bisect_right(self._times.get(place, []), t_s) - 1
        if last < 0 or t_s - self._times[place][last] > max(max_age_s, self._pause_s(place)):
            return None
        return self._kits[place][last]

    def _pause_s(self, place: str) -> float:
        """How long the messages of a tray pause at most, while none is missing, s."""
        pauses = np.diff(self._times[place])
        return _LONGER_PAUSE * min(float(np.median(pauses)), _SENSOR_S) if len(pauses) > 1 else 0.0


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
    submissions, records = submissions_of(trial), _kit_records(trial)
    joined = [_joined(trial, records, s, tasks.get(s.item_id), max_age_s) for s in submissions]
    count = sum(1 for old, new in zip(submissions, joined, strict=True) if new is not old)
    unmarked = [
        f"which products of {s.item_id} are faulty: its tray is seen, but no trial configuration tells"
        for s in joined
        if s.contents is None and _sight(records, s, tasks.get(s.item_id), max_age_s) is not None
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


def _sight(
    records: Sequence[KitRecord], submission: KitSubmission, task: Task | None, max_age_s: float
) -> Kit | None:
    """What the first record that has any shows of a submitted kit.

    Messages stand first: simulators publish in them what they score, which poses only stand in for.
    """
    at_station = task is not None and task.kind != "kitting"
    place = submission.station if at_station else submission.agv
    for record in records if place else ():
        kit = record.seen(place, submission.submitted_s, max_age_s=max_age_s)
        if kit is not None:
            return kit
    return None


def _joined(
    trial: Trial, records: Sequence[KitRecord], submission: KitSubmission, task: Task | None, max_age_s: float
) -> KitSubmission:
    if submission.contents is not None:
        return submission
    kit = _sight(records, submission, task, max_age_s)
    if kit is None:
        return submission
    contents = kit.contents if kit.faults is None else kit.faults(kit.contents, trial, task)
    if contents is None:
        return submission
    return replace(submission, contents=contents, tray=submission.tray or kit.tray)


def _kit_records(trial: Trial) -> list[KitRecord]:
    """What shows the contents of kits, the most reliable first: messages before poses."""
    told = [record for record in trial.records if isinstance(record, Kit)]
    seen = [record for record in trial.records if isinstance(record, KitRecord)]
    return [*([RecordedKits(told)] if told else []), *seen]
