"""What the page of a competition shows of its ranking under other numbers; texts only, nothing to compute."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ariac_score.ranking.outcomes import Ranking
from ariac_score.report.html.wording import brief, number, round_to
from ariac_score.review.what_if import Flip, Lever, Place, WhatIf, flips_of

__all__ = ["LeverView", "WhatIfView", "step_text", "what_if_view"]

MOST_PLACES = 60_000
"""Teams times points: beyond this the page would take too long to load, and has the table alone."""


@dataclass(frozen=True)
class LeverView:
    """One slider.

    Attributes:
        lever: The number.
        label: What people call it.
        steps: The values with their unit.
        bare: The values without it.
        flips: Where ranks change along it, with all others as in the rules.
    """

    lever: Lever
    label: str
    steps: tuple[str, ...]
    bare: tuple[str, ...]
    flips: tuple[Flip, ...]


@dataclass(frozen=True)
class WhatIfView:
    """What the page shows.

    Attributes:
        levers: The sliders.
        skipped: Numbers that were not varied, and why.
        points: How many rankings were computed.
        names: Of the teams.
        order: The teams as they are ranked.
        base: Their places as the rules are.
        text: Every point as JSON, for the sliders; empty where that is too much for a page.
        as_published: Whether the ranking as the rules are is the one that is published.
    """

    levers: tuple[LeverView, ...]
    skipped: Mapping[str, str]
    points: int
    names: Mapping[str, str]
    order: tuple[str, ...]
    base: Mapping[str, Place]
    text: str
    as_published: bool


def what_if_view(found: WhatIf, ranking: Ranking) -> WhatIfView:
    """The values of the page.

    Args:
        found: The rankings.
        ranking: The one that is published.
    """
    order = tuple(standing.team for standing in ranking.standings)
    flips = list(flips_of(found))
    levers = tuple(
        LeverView(
            lever,
            brief(lever.meaning or lever.name.replace("_", " ")),
            tuple(step_text(lever, value) for value in lever.steps),
            tuple(_number(value) for value in lever.steps),
            tuple(flip for flip in flips if flip.lever is lever),
        )
        for lever in found.levers
    )
    base = found.points.get(found.base) or {}
    fits = len(found.points) * len(order) <= MOST_PLACES
    published = {standing.team: standing.rank for standing in ranking.standings}
    return WhatIfView(
        levers,
        found.skipped,
        len(found.points),
        {standing.team: standing.name for standing in ranking.standings},
        order,
        base,
        _text(found, order, levers) if fits and base else "",
        {team: place.rank for team, place in base.items()} == published,
    )


def step_text(lever: Lever, value: float) -> str:
    """A value with its unit."""
    unit = "point" if lever.unit == "points" and value == 1 else brief(lever.unit, 20)
    return f"{_number(value)}\u202f{unit}" if unit else _number(value)


def _number(value: float) -> str:
    return number(int(value) if value.is_integer() else value, 6)


def _text(found: WhatIf, order: Sequence[str], levers: Sequence[LeverView]) -> str:
    """All places: by point a list of rank, score, task and safety for each team."""
    points = {
        ",".join(map(str, at)): None if point is None else [_shown(point[team]) for team in order]
        for at, point in found.points.items()
    }
    data = {"steps": [each.steps for each in levers], "points": points}
    return json.dumps(data, separators=(",", ":"), ensure_ascii=True)


def _shown(place: Place) -> list[object]:
    safety = None if place.task is None else place.score - place.task
    return [place.rank, *(round_to(points, 2) for points in (place.score, place.task, safety))]
