"""What happened at one instant: work announced, collisions, the end of the competition."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from ariac_score.errors import OtherUnitError

__all__ = [
    "ARM_COLLISION",
    "COMPETITION_ENDED",
    "COMPETITION_STARTED",
    "ORDER_ANNOUNCED",
    "PART_DROPPED",
    "TIMED_EVENTS",
    "WATCHING",
    "Event",
    "EventNumber",
]

COMPETITION_STARTED = "competition_started"
COMPETITION_ENDED = "competition_ended"
ORDER_ANNOUNCED = "order_announced"
ARM_COLLISION = "arm_collision"
PART_DROPPED = "part_dropped"
WATCHING = "watching"
"""The recorder declares that it would have recorded events of the kind that `subject` names."""

TIMED_EVENTS = frozenset({COMPETITION_STARTED, COMPETITION_ENDED, ORDER_ANNOUNCED})
"""Kinds of events that mean nothing without their time; a collision or a drop still counts."""


class EventNumber(NamedTuple):
    """A number of an event: its name, its value, its unit (`1` for a number without)."""

    name: str
    value: float
    unit: str


@dataclass(frozen=True, order=True)
class Event:
    """Something that happened at one instant.

    Attributes:
        t_s: When, s of trial time.
        kind: What; the kinds every reader uses are the constants of this module.
        subject: To whom or what, such as the id of an item; empty when it concerns the trial.
        detail: Anything more, as text.
        numbers: What was measured of it, by name; each name once.

    Raises:
        ValueError: A number is not finite, or a name comes twice.

    >>> Event(2.0, "contact", "arm", numbers=(EventNumber("force", 81.0, "N"),)).number("force", unit="N")
    81.0
    """

    t_s: float
    kind: str
    subject: str = ""
    detail: str = ""
    numbers: tuple[EventNumber, ...] = ()

    def __post_init__(self) -> None:
        if not self.numbers:
            return
        names = [number.name for number in self.numbers]
        if len(set(names)) < len(names):
            raise ValueError(f"a number of event {self.kind!r} is given twice: {sorted(names)}")
        wrong = [number.name for number in self.numbers if not math.isfinite(number.value)]
        if wrong:
            raise ValueError(f"the number {wrong[0]!r} of event {self.kind!r} is not finite")
        # Sorted: events are compared, and the order in which a log names numbers says nothing.
        object.__setattr__(self, "numbers", tuple(sorted(self.numbers)))

    def number(self, name: str, *, unit: str) -> float | None:
        """A number of the event; `None` where it has none of that name.

        Raises:
            OtherUnitError: It is there in another unit. A check lets it through: the log is at fault.
        """
        for number in self.numbers:
            if number.name == name:
                if number.unit != unit:
                    raise OtherUnitError(
                        f"the number {name!r} of event {self.kind!r} is in {number.unit!r}, "
                        f"the check asks for {unit!r}",
                        place=f"{self.t_s:g} s",
                        hint=f"record it in {unit!r}, or have the check ask for {number.unit!r}",
                    )
                return number.value
        return None
