"""A measured quantity and its limit as lines to draw: violations shaded, the closest approach marked."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.html.scale import Scale, ticks
from ariac_score.results.sketch import DrawnChart

__all__ = ["Chart", "Mark", "chart_of"]

Point = tuple[float, float]

HEIGHT = 100_000
"""Height of a drawing in user units; in width a unit is 1 ms."""


@dataclass(frozen=True)
class Mark:
    """A sample worth a mark.

    Attributes:
        kind: `closest` (the least distance) or `worst` (the least margin).
        t_s: When, s.
        value: The number there.
        limit: Its limit there; `None` where there is none.
        margin: How far it is within its limit, negative beyond it; `None` where there is none.
        left: Percent from the left.
        top: Percent from the top.
    """

    kind: str
    t_s: float
    value: float
    limit: float | None
    margin: float | None
    left: float
    top: float


@dataclass(frozen=True)
class Chart:
    """A curve, ready to be drawn into a box of `width` by `HEIGHT` user units, y downwards.

    Attributes:
        curve: The curve it draws.
        x: The scale of time.
        height: Height of the box, in units of the curve.
        peak: The number at its upper edge.
        actual: Path of the measured values.
        limit: Path of the limit; empty where there is none.
        beyond: Path of the areas in which the limit is broken.
        levels: Round numbers of the vertical axis, and percent from the top.
        marks: Closest approach and worst moment.
        findings: Ids of the violations it shows.
    """

    curve: DrawnChart
    x: Scale
    height: float
    peak: float
    actual: str
    limit: str
    beyond: str
    levels: tuple[tuple[float, float], ...]
    marks: tuple[Mark, ...]
    findings: tuple[str, ...]

    @property
    def nearest(self) -> str:
        """What its smallest value is."""
        apart = "distance" in self.curve.what or "separation" in self.curve.what
        return "closest approach" if apart else "smallest value"

    @property
    def width(self) -> int:
        """Width of the box, ms."""
        return max(round((self.x.end - self.x.start) * 1000), 1)


def chart_of(curve: DrawnChart, findings: Mapping[str, Finding], axis: Scale | None = None) -> Chart | None:
    """The drawing of a curve; `None` where it is a single moment.

    Args:
        curve: What to draw.
        findings: By id.
        axis: The times of the page, which all its drawings share; by default those of the curve.
    """
    if len(curve.t_s) < 2:
        return None
    x = axis or Scale(curve.t_s[0], curve.t_s[-1])
    high = max(*curve.actual, *(v for v in curve.limit if v is not None), 0.0) or 1.0
    low = min(*curve.actual, *(v for v in curve.limit if v is not None), 0.0)
    levels = ticks(low, high * 1.08, 5)  # room above the line, so that its top is not cut off
    top = max(levels[-1], high * 1.08)
    bottom = min(low, levels[0])
    broken = [
        key
        for key, finding in findings.items()
        if finding.check == curve.check
        and finding.subject == curve.subject
        and finding.verdict is Verdict.VIOLATED
    ]
    flip = _Flip(x.start, top, bottom)
    return Chart(
        curve,
        x,
        round(top - bottom, 4),
        round(top, 4),
        _path(curve.t_s, curve.actual, curve.holes_s, flip),
        _path(curve.t_s, curve.limit, curve.holes_s, flip),
        _areas(curve, flip),
        tuple((level, flip.percent(level)) for level in levels if bottom <= level <= top),
        tuple(_marks(curve, x, flip)),
        tuple(broken),
    )


@dataclass(frozen=True)
class _Flip:
    """Numbers to whole user units: x from the start in ms, y downwards from the top."""

    start: float
    top: float
    bottom: float

    def x(self, t: float) -> int:
        return round((t - self.start) * 1000)

    def y(self, value: float) -> int:
        return round((self.top - value) / (self.top - self.bottom) * HEIGHT)

    def percent(self, value: float) -> float:
        return round(100 * (self.top - value) / (self.top - self.bottom), 3)


def _path(t_s: Sequence[float], values: Sequence[float | None], holes_s: Sequence[float], flip: _Flip) -> str:
    """A line through the samples, interrupted where nothing is known; whole steps keep a page small."""
    holes, pieces, drawing = frozenset(holes_s), [], False
    at_x = at_y = 0
    for t, value in zip(t_s, values, strict=True):
        if value is not None:
            x, y = flip.x(t), flip.y(value)
            pieces.append(f"l{x - at_x} {y - at_y}" if drawing else f"M{x} {y}")
            at_x, at_y = x, y
        drawing = value is not None and t not in holes
    return "".join(pieces)


def _areas(curve: DrawnChart, flip: _Flip) -> str:
    """Closed shapes between both lines wherever the limit is broken."""
    shapes = []
    for of_actual, of_limit in _broken(curve):
        points = [*of_actual, *reversed(of_limit)]
        t_s, values = [t for t, _ in points], [value for _, value in points]
        shapes.append(_path(t_s, values, (), flip) + "z")
    return "".join(shapes)


def _broken(curve: DrawnChart) -> Iterator[tuple[list[Point], list[Point]]]:
    """The runs of samples beyond their limit, from where the lines cross to where they cross again."""
    for stretch in _known(curve):
        for beyond, run in groupby(_with_crossings(stretch), key=lambda row: row.margin <= 0):
            rows = list(run)
            # A margin of 0 is no violation: of such samples only those next to one belong to its shape.
            below = [i for i, row in enumerate(rows) if row.margin < 0]
            if beyond and below:
                shown = rows[max(below[0] - 1, 0) : below[-1] + 2]
                yield [(row.t_s, row.value) for row in shown], [(row.t_s, row.limit) for row in shown]


@dataclass(frozen=True)
class _Row:
    t_s: float
    value: float
    limit: float
    margin: float


def _known(curve: DrawnChart) -> Iterator[list[_Row]]:
    """The stretches in which a limit applies and no sample is missing."""
    sign, holes = (-1.0 if curve.at_most else 1.0), frozenset(curve.holes_s)
    stretch: list[_Row] = []
    for t, value, limit in zip(curve.t_s, curve.actual, curve.limit, strict=True):
        if limit is not None:
            stretch.append(_Row(t, value, limit, sign * (value - limit)))
        if limit is None or t in holes:
            yield stretch
            stretch = []
    yield stretch


def _with_crossings(rows: Sequence[_Row]) -> Iterator[_Row]:
    """The samples, and between them the points where the lines cross."""
    for before, row in zip([None, *rows], rows, strict=False):
        if before is not None and before.margin * row.margin < 0:
            share = before.margin / (before.margin - row.margin)
            value = before.value + share * (row.value - before.value)
            yield _Row(before.t_s + share * (row.t_s - before.t_s), value, value, 0.0)
        yield row


def _marks(curve: DrawnChart, x: Scale, flip: _Flip) -> Iterator[Mark]:
    rows = range(len(curve.t_s))
    sign = -1.0 if curve.at_most else 1.0
    closest = min(rows, key=lambda i: sign * curve.actual[i])
    limited = [i for i in rows if curve.limit[i] is not None]
    worst = min(limited, key=lambda i: sign * (curve.actual[i] - (curve.limit[i] or 0.0)), default=closest)
    kinds = {closest: "closest"} if worst == closest else {closest: "closest", worst: "worst"}
    for row, kind in kinds.items():
        t, value, limit = curve.t_s[row], curve.actual[row], curve.limit[row]
        margin = None if limit is None else round(sign * (value - limit), 4)
        yield Mark(kind, t, value, limit, margin, x.at(t), flip.percent(value))
