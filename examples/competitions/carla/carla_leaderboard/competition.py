"""What the CARLA Leaderboard says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

__all__ = ["Leaderboard"]


@dataclass(frozen=True)
class Leaderboard:
    """The CARLA Leaderboard: the routes of an entry.

    Source:
        leaderboard.carla.org, Evaluation criteria.
    """

    levels: ClassVar[tuple[str, ...]] = ("route", "trial")
    facts: ClassVar[Mapping[str, Mapping[str, object]]] = {
        "route": {
            "length_m": {"type": "number", "unit": "m", "meaning": "length of the route"},
            "duration_s": {"type": "number", "unit": "s", "meaning": "simulated time on the route"},
            "status": {"type": "text", "meaning": "how it ended, in the words of the leaderboard"},
        }
    }
    words: ClassVar[Mapping[str, tuple[str, str]]] = {
        "route": ("route", "routes"),
        "trial": ("entry", "entries"),
    }
