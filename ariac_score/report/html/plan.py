"""The cell seen from above and from the side: the routes of robots and humans, the places of violations."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.html.scale import ticks
from ariac_score.results.sketch import DrawnPath, Sketch

__all__ = ["FloorPlan", "Pin", "Way", "plan_of", "side_of"]

MOST_PINS = 40
_SMALL_M = 2.0
"""Smaller drawings are to a tenth of a millimetre."""
PIN_SPACING = 3.2
"""Least distance of two pins, percent of the box."""
LEAST_M = 0.3
"""A plan is never less than this wide and high."""


@dataclass(frozen=True)
class Way:
    """One route: its path, in m, y downwards, and where it begins and ends, percent of the box.

    `label` is the side of its end where its name hides least: `after`, `before`, `above` or `below`.
    """

    body: str
    kind: str
    path: str
    start: tuple[float, float]
    end: tuple[float, float]
    label: str = "after"


@dataclass(frozen=True)
class Pin:
    """A violation: its number on the plan, its finding, its place in percent, and the other body's.

    Attributes:
        number: On the plan.
        finding: Its id.
        left: Percent from the left.
        top: Percent from the top.
        line: From the one to the other body at that moment, in user units; empty with one body.
    """

    number: int
    finding: str
    left: float
    top: float
    line: str


@dataclass(frozen=True)
class FloorPlan:
    """A drawing of `width` by `height` m, y downwards. Of one from the side, y is the height.

    Attributes:
        left: x of the left edge, m.
        top: y of the upper edge, m.
        width: In m.
        height: In m.
        ways: The routes.
        pins: The violations, in order of time.
        columns: Round numbers of x and percent from the left.
        rows: Round numbers of y and percent from the top.
        unpinned: Number of violations without a pin: their place is not known, or there are too many.
        across: What of a route (`DrawnPath`) is drawn to the right.
        up: What of it is drawn upwards.
    """

    left: float
    top: float
    width: float
    height: float
    ways: tuple[Way, ...]
    pins: tuple[Pin, ...]
    columns: tuple[tuple[float, float], ...]
    rows: tuple[tuple[float, float], ...]
    unpinned: int
    across: str = "x_m"
    up: str = "y_m"


@dataclass(frozen=True)
class _Box:
    left: float
    top: float
    width: float
    height: float

    def units(self, x_m: float, y_m: float) -> str:
        decimals = 3 if self.width > _SMALL_M else 4
        return f"{_short(x_m - self.left, decimals)} {_short(self.top - y_m, decimals)}"

    def percent(self, x_m: float, y_m: float) -> tuple[float, float]:
        return (
            round(100 * (x_m - self.left) / self.width, 3),
            round(100 * (self.top - y_m) / self.height, 3),
        )


def _short(value: float, decimals: int) -> str:
    return f"{value:.{decimals}f}".rstrip("0").rstrip(".") or "0"


def plan_of(sketch: Sketch, findings: Mapping[str, Finding]) -> FloorPlan | None:
    """The plan; `None` where the log records no positions."""
    if not sketch.routes:
        return None
    box = _box(sketch.routes)
    pins, unpinned = _pins(sketch.routes, findings, box)
    right, bottom = box.left + box.width, box.top - box.height
    return FloorPlan(
        round(box.left, 4),
        round(box.top, 4),
        round(box.width, 4),
        round(box.height, 4),
        tuple(_ways(sketch.routes, box)),
        tuple(pins),
        tuple((x, box.percent(x, box.top)[0]) for x in ticks(box.left, right, 8)),
        tuple((y, box.percent(box.left, y)[1]) for y in ticks(bottom, box.top, 6)),
        unpinned,
    )


def side_of(sketch: Sketch, findings: Mapping[str, Finding]) -> FloorPlan | None:
    """The same from the side that shows more of the ways; `None` where no body rises or sinks."""
    if not sketch.routes or not all(route.z_m for route in sketch.routes):
        return None
    extents_m = [
        max(max(places) for places in along) - min(min(places) for places in along)
        for along in ([route.x_m for route in sketch.routes], [route.y_m for route in sketch.routes])
    ]
    across = "y_m" if extents_m[1] > extents_m[0] else "x_m"
    turned = tuple(replace(one, x_m=getattr(one, across), y_m=one.z_m) for one in sketch.routes)
    drawn = plan_of(Sketch(routes=turned), findings)
    return replace(drawn, across=across, up="z_m") if drawn else None


def _box(routes: Sequence[DrawnPath]) -> _Box:
    xs = [x for route in routes for x in route.x_m]
    ys = [y for route in routes for y in route.y_m]
    width, height = max(xs) - min(xs), max(ys) - min(ys)
    # Not flatter than one to four, so that a walk along a wall can still be seen.
    wide = max(width, LEAST_M, height / 2) * 1.1
    high = max(height, LEAST_M, width / 4) * 1.1
    middle_x, middle_y = (max(xs) + min(xs)) / 2, (max(ys) + min(ys)) / 2
    return _Box(middle_x - wide / 2, middle_y + high / 2, wide, high)


_LABEL_WIDTH, _LABEL_HEIGHT = 18.0, 6.0
"""About how much a name takes, percent of the box."""
_SIDES = {"after": (0.0, -0.5), "before": (-1.0, -0.5), "above": (-0.5, -1.5), "below": (-0.5, 0.5)}
"""Where a name begins, in widths and heights of it from the end of its route."""


def _ways(routes: Sequence[DrawnPath], box: _Box) -> Iterator[Way]:
    drawn = [_way(route, box) for route in routes]
    spots = [spot for route in routes for spot in _spots(route, box)]
    for way in drawn:
        hidden = {side: _hidden(way.end, offset, spots) for side, offset in _SIDES.items()}
        yield replace(way, label=min(hidden, key=lambda side: hidden[side]))


def _spots(route: DrawnPath, box: _Box) -> Iterator[tuple[float, float]]:
    """Points along a route, percent of the box, so close together that a name over it is over some."""
    places = [box.percent(x, y) for x, y in zip(route.x_m, route.y_m, strict=True)]
    for (x1, y1), (x2, y2) in pairwise(places):
        steps = min(int(max(abs(x2 - x1), abs(y2 - y1)) / 2) + 1, 50)
        yield from ((x1 + (x2 - x1) * i / steps, y1 + (y2 - y1) * i / steps) for i in range(steps))


def _hidden(
    end: tuple[float, float], offset: tuple[float, float], spots: Sequence[tuple[float, float]]
) -> int:
    """How much of the routes a name would hide; very much where it would not fit into the box."""
    left, top = end[0] + offset[0] * _LABEL_WIDTH, end[1] + offset[1] * _LABEL_HEIGHT
    if left < 0 or left + _LABEL_WIDTH > 100 or top < 0 or top + _LABEL_HEIGHT > 100:
        return len(spots) + 1
    return sum(left < x < left + _LABEL_WIDTH and top < y < top + _LABEL_HEIGHT for x, y in spots)


def _way(route: DrawnPath, box: _Box) -> Way:
    # The line is interrupted where the log has a gap: nobody knows the way in between.
    holes, pieces, drawing = frozenset(route.holes_s), [], False
    for t, x, y in zip(route.t_s, route.x_m, route.y_m, strict=True):
        pieces.append(("L" if drawing else "M") + box.units(x, y))
        drawing = t not in holes
    return Way(
        route.body,
        route.kind,
        "".join(pieces),
        box.percent(route.x_m[0], route.y_m[0]),
        box.percent(route.x_m[-1], route.y_m[-1]),
    )


def _pins(routes: Sequence[DrawnPath], findings: Mapping[str, Finding], box: _Box) -> tuple[list[Pin], int]:
    broken = sorted(
        (
            (finding.span.start_s, key)
            for key, finding in findings.items()
            if finding.verdict is Verdict.VIOLATED and finding.span is not None
        ),
    )
    pins: list[Pin] = []
    for _, key in broken:
        places = list(_places(routes, findings[key]))
        if places and len(pins) < MOST_PINS:
            x = (places[0][0] + places[-1][0]) / 2
            y = (places[0][1] + places[-1][1]) / 2
            line = "M" + "L".join(box.units(*place) for place in places) if len(places) > 1 else ""
            pins.append(_moved_aside(pins, Pin(len(pins) + 1, key, *box.percent(x, y), line)))
    return pins, len(broken) - len(pins)


def _moved_aside(pins: Sequence[Pin], pin: Pin) -> Pin:
    """A pin moved to the side until it hides none of those before it."""
    left = pin.left
    while any(abs(left - one.left) < PIN_SPACING and abs(pin.top - one.top) < PIN_SPACING for one in pins):
        left += PIN_SPACING
    return replace(pin, left=round(left, 3)) if left < 100 else pin


def _places(routes: Sequence[DrawnPath], finding: Finding) -> Iterator[tuple[float, float]]:
    """Where the bodies of a finding were at its worst moment."""
    assert finding.span is not None  # `_pins` takes only violations with a time
    # Monitors give the worst sample as evidence; a finding without evidence is placed where it began.
    at_s = finding.evidence[0].t_s if finding.evidence else finding.span.start_s
    for body in finding.subject.split("/")[:2]:
        for route in routes:
            if route.body.partition("::")[0] == body:  # Gazebo names a link `model::link`
                yield _place(route, at_s)
                break


def _place(route: DrawnPath, at_s: float) -> tuple[float, float]:
    """Where a body was, on the straight line between the two samples around a moment."""
    after = min(max(bisect_left(route.t_s, at_s), 0), len(route.t_s) - 1)
    before = max(after - 1, 0)
    gap_s = route.t_s[after] - route.t_s[before]
    share = min(max((at_s - route.t_s[before]) / gap_s, 0.0), 1.0) if gap_s > 0 else 0.0
    return (
        route.x_m[before] + share * (route.x_m[after] - route.x_m[before]),
        route.y_m[before] + share * (route.y_m[after] - route.y_m[before]),
    )
