"""What RoboCup@Work says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from ariac_score import Event, Item, Trial

__all__ = ["RoboCupWork"]


@dataclass(frozen=True)
class RoboCupWork:
    """RoboCup@Work: the transport tasks of a run, and their objects.

    Source:
        Rulebook 2024, github.com/robocup-at-work/rulebook.
    """

    levels: ClassVar[tuple[str, ...]] = ("object", "task", "trial")
    facts: ClassVar[Mapping[str, Mapping[str, object]]] = {
        "object": {
            "type": {"type": "text", "meaning": "such as M20"},
            "source": {"type": "text", "meaning": "the service area where it lies"},
            "target": {"type": "text", "meaning": "the service area where it is wanted"},
        },
        "task": {
            "source": {"type": "text", "meaning": "the service area where its objects lie"},
            "target": {"type": "text", "meaning": "the service area where they are wanted"},
        },
        "trial": {
            "test": {"type": "text", "meaning": "such as BMT"},
            "objects": {"type": "text", "meaning": "real, or april_tags: cubes with tags in their place"},
            "time_limit_s": {"type": "number", "unit": "s", "meaning": "the time for the run"},
        },
    }
    words: ClassVar[Mapping[str, tuple[str, str]]] = {
        "object": ("object", "objects"),
        "task": ("task", "tasks"),
        "trial": ("run", "runs"),
    }

    def made_trial(self) -> Trial:
        """A run of one task: an object that came to its place, and one that did not. For `plugins check`."""
        from ariac_score.testing import made_trial  # noqa: PLC0415  # no score needs it
        from robocup_work.run import KINDS  # noqa: PLC0415

        places = {"source": "WS01", "target": "WS02"}
        things = Item("M20_1", "object", {"type": "M20", **places}), Item("M30_1", "object", {**places})
        seen = (
            Event(5.0, "reached", "WS01"),
            Event(10.0, "grasped", "M20_1"),
            Event(15.0, "placed", "M20_1", "WS02"),
            Event(20.0, "lost", "M30_1"),
        )
        made = made_trial()
        return replace(
            made,
            work=(Item("task_1", "task", places, things, announced_s=1.0),),
            submissions=(),
            events=tuple(sorted((*made.events, *seen))),
            witnessed=made.witnessed | set(KINDS),
            facts={"test": "BMT", "objects": "real", "time_limit_s": 300.0},
        )
