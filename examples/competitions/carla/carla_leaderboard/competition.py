"""What the CARLA Leaderboard says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from ariac_score import Fact, Trial

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

    def made_trial(self) -> Trial:
        """An entry of two routes: one without a fault, and one with each. For `plugins check`."""
        from ariac_score.testing import made_trial  # noqa: PLC0415  # no score needs it
        from carla_leaderboard.route import KINDS, Route  # noqa: PLC0415

        facts: dict[str, Fact] = {"length_m": 1000.0, "duration_s": 60.0, "status": "Completed"}
        faults = {kind: (f"{kind}: 40.0% of the route",) for kind in KINDS}
        routes = (
            Route("route_0", facts, 100.0, dict.fromkeys(KINDS, ())),
            Route("route_1", {**facts, "status": "Failed"}, 60.0, faults),
        )
        return replace(made_trial(), work=routes, submissions=(), facts={})
