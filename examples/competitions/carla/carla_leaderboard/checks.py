"""What the leaderboard charges: one rule for each form of penalty, each judging a route."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import Finding, Measure, Trial, Verdict, WorkItem, check_parameters, parameter
from carla_leaderboard.route import Route

__all__ = ["Completion", "Infractions", "OffRoad", "Slow", "SlowFactor"]

_SOURCE = "leaderboard.carla.org, Evaluation criteria"
_PERCENT = re.compile(r"([0-9]+(?:\.[0-9]+)?)%")

Kind = Literal[
    "collisions_layout",
    "collisions_pedestrian",
    "collisions_vehicle",
    "red_light",
    "stop_infraction",
    "yield_emergency_vehicle_infractions",
    "scenario_timeouts",
]


def _not_a_route(item: WorkItem) -> Finding:
    return Finding.inconclusive(item.id, "it is no route of the leaderboard")


@dataclass(frozen=True)
class Completion:
    """The agent drove the whole route.

    Measures:
        The share of the route that was driven, which is the points that it is worth.
    Violated when:
        It is below 100 %.
    Source:
        leaderboard.carla.org, Evaluation criteria: route completion.
    """

    mistake: ClassVar[tuple[str, str]] = ("route not driven to its end", "routes not driven to their end")

    level: ClassVar[str] = "route"
    measures: ClassVar[Mapping[str, Measure]] = {
        "completion": Measure("points", "points", meaning="percent of the route that was driven"),
    }

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the route."""
        if not isinstance(item, Route):
            yield _not_a_route(item)
            return
        driven = item.completion_percent
        yield Finding(
            item.id,
            Verdict.of(driven - 100),
            f"{driven:g} % driven: {item.facts['status']}",
            quantities={"completion": driven},
            clause=_SOURCE,
        )


@dataclass(frozen=True)
class Infractions:
    """The agent keeps a rule of the road.

    Measures:
        How often the simulator saw the rule broken.
    Violated when:
        It was broken; each time is one violation.
    Source:
        leaderboard.carla.org, Evaluation criteria: infraction penalty.
    """

    part_of: ClassVar[str] = "safety"

    kind: Kind = "collisions_vehicle"
    level: ClassVar[str] = "route"

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """A violation for each infraction, or that there was none."""
        if not isinstance(item, Route):
            yield _not_a_route(item)
            return
        messages = item.infractions[self.kind]
        for message in messages:
            yield Finding.violated(item.id, message, clause=_SOURCE)
        if not messages:
            yield Finding.satisfied(item.id, f"no {self.kind}", clause=_SOURCE)


@dataclass(frozen=True)
class OffRoad:
    """The agent stays on its route.

    Measures:
        The share of the route that was driven outside of its lanes, which does not count as driven.
    Violated when:
        There is such a share.
    Source:
        leaderboard.carla.org, Evaluation criteria: off-road driving.
    """

    level: ClassVar[str] = "route"
    measures: ClassVar[Mapping[str, Measure]] = {
        "off_road": Measure("1", "penalty", meaning="share of the route outside of its lanes"),
    }

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """A violation for each stretch, or that there was none."""
        yield from _shares(item, "outside_route_lanes", lambda percent: {"off_road": percent / 100})


@dataclass(frozen=True)
class Slow:
    """The agent keeps up with the traffic around it.

    Measures:
        How much slower than the traffic it was at each check of the speed, as a share.
    Violated when:
        It was slower at a check.
    Source:
        leaderboard.carla.org, Evaluation criteria: failure to maintain speed.
    """

    level: ClassVar[str] = "route"
    measures: ClassVar[Mapping[str, Measure]] = {
        "shortfall": Measure("1", "penalty", meaning="1 - the speed's share of that of the traffic"),
    }

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """A violation for each check of the speed that was not met, or that there was none."""
        yield from _shares(item, "min_speed_infractions", lambda percent: {"shortfall": 1 - percent / 100})


@dataclass(frozen=True)
class SlowFactor:
    """The agent keeps up with the traffic around it, as version 2.0 charges it.

    Measures:
        The product over the checks of the speed of 1 - (1 - `at_standstill`) * (1 - share of the
        speed of the traffic).
    Violated when:
        It was slower at a check.
    Source:
        `PENALTY_PERC_DICT` in `leaderboard/utils/statistics_manager.py` of
        github.com/carla-simulator/leaderboard.
    """

    at_standstill: float = parameter(0.7, unit="1", at_least=0, at_most=1, status="verified", source=_SOURCE)
    level: ClassVar[str] = "route"
    measures: ClassVar[Mapping[str, Measure]] = {
        "slow_factor": Measure("1", "factor", meaning="what being slow leaves of the score"),
    }

    def __post_init__(self) -> None:
        check_parameters(self)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the route, for a product has no share for each check of the speed."""
        if not isinstance(item, Route):
            yield _not_a_route(item)
            return
        messages = item.infractions["min_speed_infractions"]
        percents = [_percent(message) for message in messages]
        if None in percents:
            yield Finding.inconclusive(item.id, "a message names no percentage", clause=_SOURCE)
            return
        factor = math.prod(1 - (1 - self.at_standstill) * (1 - p / 100) for p in percents if p is not None)
        yield Finding(
            item.id,
            Verdict.VIOLATED if messages else Verdict.SATISFIED,
            "; ".join(messages) or "no min_speed_infractions",
            quantities={"slow_factor": factor},
            clause=_SOURCE,
        )


def _shares(
    item: WorkItem, kind: str, quantities: Callable[[float], Mapping[str, float]]
) -> Iterator[Finding]:
    """A violation for each infraction that is a percentage, or that there was none."""
    if not isinstance(item, Route):
        yield _not_a_route(item)
        return
    for message in item.infractions[kind]:
        percent = _percent(message)
        if percent is None:
            yield Finding.inconclusive(item.id, f"no percentage in {message!r}", clause=_SOURCE)
        else:
            yield Finding(item.id, Verdict.VIOLATED, message, quantities=quantities(percent), clause=_SOURCE)
    if not item.infractions[kind]:
        yield Finding.satisfied(item.id, f"no {kind}", clause=_SOURCE)


def _percent(message: str) -> float | None:
    """The percentage that a message of the simulator names, where it is one from 0 to 100."""
    found = _PERCENT.search(message)
    value = float(found[1]) if found else math.nan
    return value if 0 <= value <= 100 else None
