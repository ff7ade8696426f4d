"""What RoboCup@Work says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

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
