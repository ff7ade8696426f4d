"""What happened in a run: what the referee wrote down, as far as it still counts."""

from __future__ import annotations

from ariac_score import COMPETITION_ENDED, COMPETITION_STARTED, Event, Trial

__all__ = ["FINISH", "KINDS", "OF_OBJECTS", "OF_PLACES", "ROBOT", "counting"]

ROBOT = "robot"
"""The only body of a run."""

FINISH = "finish"
"""The place where a run ends."""

OF_OBJECTS = ("grasped", "placed", "deduction", "lost", "incorrect")
"""Kinds of events that are about an object."""

OF_PLACES = ("reached",)
"""Kinds of events that are about a service area, or the finish."""

KINDS = (
    COMPETITION_STARTED,
    COMPETITION_ENDED,
    "restart",
    *OF_PLACES,
    *OF_OBJECTS,
    "minor_collision",
    "major_collision",
    "tape_collision",
    "human_interaction",
    "cheating",
)
"""What a referee writes down."""


def counting(trial: Trial, kind: str) -> list[Event]:
    """The events of a kind that count: those after the last restart, before which all is void.

    Source:
        Rulebook 2024, Restarts: scores achieved before the restart are set to zero.
    """
    since_s = max((event.t_s for event in trial.events if event.kind == "restart"), default=float("-inf"))
    return [event for event in trial.events if event.kind == kind and event.t_s >= since_s]
