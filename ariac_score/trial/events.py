"""What happened at one instant: orders announced, collisions, the end of the competition."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "ARM_COLLISION",
    "COMPETITION_ENDED",
    "COMPETITION_STARTED",
    "ORDER_ANNOUNCED",
    "PART_DROPPED",
    "TIMED_EVENTS",
    "WATCHING",
    "Event",
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


@dataclass(frozen=True, order=True)
class Event:
    """Something that happened at one instant.

    Attributes:
        t_s: When, s of trial time.
        kind: What; the kinds every reader uses are the constants of this module.
        subject: To whom or what, such as an order id; empty when it concerns the trial.
        detail: Anything more, as text.
    """

    t_s: float
    kind: str
    subject: str = ""
    detail: str = ""
