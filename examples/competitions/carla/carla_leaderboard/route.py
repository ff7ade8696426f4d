"""A route of the leaderboard, as its results file records it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ariac_score import Fact, WorkItem

__all__ = ["KINDS", "Route"]

KINDS = (
    "collisions_layout",
    "collisions_pedestrian",
    "collisions_vehicle",
    "red_light",
    "stop_infraction",
    "outside_route_lanes",
    "min_speed_infractions",
    "yield_emergency_vehicle_infractions",
    "scenario_timeouts",
    "route_dev",
    "vehicle_blocked",
    "route_timeout",
)
"""The infractions that a record lists, by their keys in the results file."""


@dataclass(frozen=True)
class Route:
    """One route that an agent drove: a work item of level `route`.

    Attributes:
        id: Such as `RouteScenario_0_rep0`.
        facts: `length_m`, `duration_s`, and its `status` in words.
        completion_percent: How much of it was driven, 0 to 100.
        infractions: What the simulator said of each infraction, by kind.
    """

    id: str
    facts: Mapping[str, Fact]
    completion_percent: float
    infractions: Mapping[str, tuple[str, ...]]
    level: str = "route"
    items: Sequence[WorkItem] = ()
