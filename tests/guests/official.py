"""The public rules of the guests, written down a second time: what the tests compare with.

Exact where a rule is a fraction. Sources: `run.py` of the BARN Challenge, section 3; the evaluation pages of
the CARLA Leaderboard, versions 2.0 and 2.1; the rulebook of RoboCup@Work 2024, chapter "Scoring and Ranking".
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise

COEFFICIENTS_2_0 = {
    "collisions_pedestrian": "0.50",
    "collisions_vehicle": "0.60",
    "collisions_layout": "0.65",
    "red_light": "0.70",
    "stop_infraction": "0.80",
    "scenario_timeouts": "0.70",
    "yield_emergency_vehicle_infractions": "0.70",
}
COEFFICIENTS_2_1 = {
    "collisions_pedestrian": "1.00",
    "collisions_vehicle": "0.70",
    "collisions_layout": "0.60",
    "red_light": "0.40",
    "stop_infraction": "0.25",
    "scenario_timeouts": "0.40",
    "yield_emergency_vehicle_infractions": "0.40",
}

Route = tuple[str, Mapping[str, int], Sequence[str], Sequence[str]]
"""Percent driven, counts by kind, percents of the traffic's speed, percents off road; numbers as printed."""


def driving_score(routes: Sequence[Route], version: str) -> Fraction:
    """The mean over the routes of completion times penalty."""
    return sum((_route_score(route, version) for route in routes), Fraction(0)) / len(routes)


def _route_score(route: Route, version: str) -> Fraction:
    driven, counts, speeds, off_road = route
    penalty = Fraction(1)
    for percent in off_road:
        penalty *= 1 - Fraction(percent) / 100
    slow = [1 - Fraction(percent) / 100 for percent in speeds]
    if version == "2.0":
        for kind, count in counts.items():
            penalty *= Fraction(COEFFICIENTS_2_0[kind]) ** count
        for share in slow:
            penalty *= 1 - Fraction("0.3") * share
    else:
        demerits = sum((Fraction(COEFFICIENTS_2_1[kind]) * n for kind, n in counts.items()), Fraction(0))
        penalty /= 1 + demerits + Fraction("0.4") * sum(slow, Fraction(0))
    return Fraction(driven) * penalty


def nav_metric(success: bool, length_m: float, time_s: float, fastest: int) -> float:
    """1_success * optimal_time / clip(actual_time, fastest * optimal_time, 8 * optimal_time)."""
    optimal_s = length_m / 2
    return success * optimal_s / min(max(time_s, fastest * optimal_s), 8 * optimal_s)


def path_length_m(cells: Sequence[tuple[int, int]]) -> float:
    """From (-2, 3) through the centres of the cells, 0.15 m wide, to (-2, 13)."""
    places = [(-2.0, 3.0), *(((c - 30.5) * 0.15, 5.075 + 0.15 * r) for c, r in cells), (-2.0, 13.0)]
    return math.fsum(math.dist(a, b) for a, b in pairwise(places))


def manipulation_test(
    events: Sequence[tuple[int, str, str]], *, limit_s: int, objects: int, tags: bool = False
) -> Fraction:
    """Points of a Basic Manipulation Test of 2024 with two service areas, from (time, kind, subject)."""
    restarts = [t for t, kind, _ in events if kind == "restart"]
    counted = [event for event in events if event[0] >= max(restarts, default=0)]
    number = Counter(kind for _, kind, _ in counted)
    reached = {subject for _, kind, subject in counted if kind == "reached"}
    actions = number["grasped"] + number["placed"]
    handling = Fraction(100 * actions - 50 * number["deduction"])
    points = 100 * len(reached) + handling * (Fraction(1, 2) if tags else 1)
    faults = ("deduction", "lost", "incorrect", "minor_collision", "major_collision", "tape_collision")
    clean = not any(number[kind] for kind in (*faults, "human_interaction", "cheating"))
    if clean and len(reached) == 3 and actions == 2 * objects:
        points += 10 * actions
    if "finish" in reached:
        points += max(0, limit_s - events[-1][0])
    points -= 100 * number["lost"] + 50 * number["incorrect"]
    points -= 50 * number["minor_collision"] + 100 * number["human_interaction"]
    share = 1 - min(Fraction(5, 100) * number["tape_collision"], Fraction(20, 100))
    if number["major_collision"]:
        share /= 2
    return max(Fraction(0), points) * share * (not number["cheating"])
