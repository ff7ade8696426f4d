"""What a page draws of a trial beyond its findings, small enough to be stored in a result.

Series are reduced for drawing: of each stretch as wide as a pixel the smallest and the
largest value are kept, so that no extreme is lost however much is left out. Stretches are
finer where something was violated or nearly so. Of positions those are kept that a replay
needs to be near the truth. Nothing is decided by a sketch.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from ariac_score.results.codec import leave_out_empty
from ariac_score.results.motion import places_kept
from ariac_score.trial.chart import Chart
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import FloatArray, Span, distinct
from ariac_score.trial.work import WorkItem

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "AskedItem",
    "DrawnChart",
    "DrawnPath",
    "HandedIn",
    "LevelWords",
    "Sketch",
    "extremes",
    "sketch_of",
    "sketch_of_work",
]


DECIMALS = 4
"""Of seconds and of SI units: finer than anything drawn."""

STRETCHES = 2400
"""All curves share the stretches, so that a result stays small however many pairs there are."""
MOST_STRETCHES, FEWEST_STRETCHES = 800, 40

DETAILS, AROUND_S = 8, 2.0
"""So many violations of a curve are drawn finer, with so much time before and after."""
DETAIL_STRETCHES = 2400
"""The finer stretches are shared by all curves as well."""
MOST_DETAIL_STRETCHES, FEWEST_DETAIL_STRETCHES = 100, 10

PLACES = 12_000
"""All routes share the places, so that a result stays small however many bodies there are."""
MOST_PLACES, FEWEST_PLACES = 1000, 40
NEAR_M = 0.01
"""Straight between the places that are kept, a body is drawn so near to where it was, if places suffice."""
_LEAST_NEAR_M, _NEAR_OF_EXTENT = 0.001, 0.01
"""Where all happens within less than a metre, nearer: by this part of the way that is gone at most."""
_RISES_M = 0.05
"""Heights are kept where a body rises or sinks by more; people who walk bob by less."""
MOST_INSTANTS = 40
"""So many of the worst moments of a body keep their places in any case."""
_COARSE_FROM, _COARSE_STRETCHES = 20_000, 4000
"""From so many samples on a route is thinned to its extremes in so many stretches first, in one pass."""
_ROUTE_HOLE_S = 1.0
"""After a longer silence a route is drawn as interrupted."""
MOST_HOLES = 500

DISTANCES = ("separation", "centre_distance", "centre_distance_2d")
"""For a pair without a limit, the first of these that is known is drawn."""


@dataclass(frozen=True)
class DrawnChart:
    """A chart, reduced.

    Attributes:
        check: Name of the check; empty where no check has a limit.
        subject: Whom it is about.
        what: Name of the quantity.
        unit: Its unit.
        at_most: Whether the limit is an upper one.
        samples: Number of samples it was reduced from.
        t_s: Times, s.
        actual: The measured values.
        limit: Their limits; `None` where there is none.
        holes_s: Times of samples after which nothing is known until the next one.
    """

    check: str
    subject: str
    what: str
    unit: str
    at_most: bool
    samples: int
    t_s: tuple[float, ...]
    actual: tuple[float, ...]
    limit: tuple[float | None, ...]
    holes_s: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _refuse_uneven(self.t_s, self.actual, self.limit)


@dataclass(frozen=True)
class DrawnPath:
    """The route of a body, reduced.

    Straight and steady motion between two samples is within a centimetre of what was recorded, nearer where
    all happens within less than a metre, unless the route is so long that its places do not suffice; those
    of the worst moments are exact.

    Attributes:
        body: Its id, or the name of the link that stands for it.
        kind: Such as `robot` or `human`.
        t_s: Times, s.
        x_m: Places, m.
        y_m: Places, m.
        holes_s: Times of samples after which its place is unknown until the next one.
        z_m: Heights, m; empty where no body of the trial rises or sinks.
    """

    body: str
    kind: str
    t_s: tuple[float, ...]
    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    holes_s: tuple[float, ...] = ()
    z_m: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        _refuse_uneven(self.t_s, self.x_m, self.y_m, *([self.z_m] if self.z_m else []))
        leave_out_empty(self, "z_m")


def _refuse_uneven(*columns: Sequence[object]) -> None:
    if len({len(column) for column in columns}) > 1 or not columns[0]:
        raise ValueError("a series of the sketch has columns of different length, or none")


@dataclass(frozen=True)
class LevelWords:
    """What people of the competition call the items of a level.

    Attributes:
        level: Such as `order`.
        one: One of them.
        many: Several.
    """

    level: str
    one: str
    many: str


@dataclass(frozen=True)
class AskedItem:
    """One work item.

    Attributes:
        path: The ids of the items it is inside, and its own.
        level: What it is.
        words: What was asked for, in the competition's words; empty where the id says all.
    """

    path: str
    level: str
    words: str = ""


@dataclass(frozen=True)
class HandedIn:
    """One submission.

    Attributes:
        item: Id of the item it answers.
        submitted_s: When, s.
        words: Where or how, in the competition's words; empty where there is nothing to say.
        contents: What it consisted of; `None` when the log does not show it, or there is nothing to show.
    """

    item: str
    submitted_s: float
    words: str = ""
    contents: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Sketch:
    """What a page draws of a trial beyond its findings.

    Attributes:
        curves: Measured quantities with their limits.
        routes: Routes of bodies.
        asked: Every work item, each before those inside it.
        brought: The submissions.
        levels: What people call the items of each level.
    """

    curves: tuple[DrawnChart, ...] = ()
    routes: tuple[DrawnPath, ...] = ()
    asked: tuple[AskedItem, ...] = ()
    brought: tuple[HandedIn, ...] = ()
    levels: tuple[LevelWords, ...] = ()


def sketch_of(
    trial: Trial,
    charts: Mapping[str, Sequence[Chart]],
    moments: Mapping[tuple[str, str], Sequence[Span]],
    words: Mapping[str, Sequence[str]] = MappingProxyType({}),
    instants_s: Mapping[str, Sequence[float]] = MappingProxyType({}),
) -> Sketch:
    """The sketch of a trial.

    Args:
        trial: With the derived signals.
        charts: The charts of each check, by its name.
        moments: Where each check found something out of the ordinary about a subject, the worst first.
        words: What people call the items of each level, one and many.
        instants_s: By subject, such as `robot/human`, times at which places of its bodies are kept exactly,
            the worst first.
    """
    drawn = {(check, chart.subject): chart for check, found in charts.items() for chart in found}
    limited = {chart.subject for chart in drawn.values()}
    for robot, human in trial.pairs():
        plain = None if f"{robot.id}/{human.id}" in limited else _plain_distance(trial, robot.id, human.id)
        if plain is not None:
            drawn["", plain.subject] = plain
    many = max(len(drawn), 1)
    stretches = _share(STRETCHES // many, FEWEST_STRETCHES, MOST_STRETCHES)
    finer = _share(DETAIL_STRETCHES // (many * DETAILS), FEWEST_DETAIL_STRETCHES, MOST_DETAIL_STRETCHES)
    curves = (
        _curve(check, drawn[check, subject], moments.get((check, subject), ()), stretches, finer)
        for check, subject in sorted(drawn)
    )
    return replace(
        sketch_of_work(trial, words),
        curves=tuple(curve for curve in curves if curve is not None),
        routes=tuple(_routes(trial, instants_s)),
    )


def sketch_of_work(trial: Trial, words: Mapping[str, Sequence[str]] = MappingProxyType({})) -> Sketch:
    """What was asked for and handed in of a trial, without its motion.

    Args:
        trial: The trial.
        words: What people call the items of each level, one and many.
    """
    brought = (
        HandedIn(
            one.item_id,
            _rounded(one.submitted_s),
            getattr(one, "words", ""),
            getattr(one, "shown_contents", None),
        )
        for one in trial.submissions
    )
    return Sketch(
        asked=tuple(_asked(trial.work)),
        brought=tuple(brought),
        levels=tuple(LevelWords(level, one, many) for level, (one, many) in sorted(words.items())),
    )


def _asked(work: Sequence[WorkItem], inside: str = "") -> Iterator[AskedItem]:
    for item in work:
        path = f"{inside}/{item.id}" if inside else item.id
        yield AskedItem(path, item.level, getattr(item, "words", ""))
        yield from _asked(item.items, path)


def _rounded(value: float) -> float:
    return round(value, DECIMALS) + 0.0


def _plain_distance(trial: Trial, robot: str, human: str) -> Chart | None:
    """The distance of a pair for which no check has a limit."""
    for quantity in DISTANCES:
        signal = trial.signals.get(f"{quantity}/{robot}/{human}")
        if signal is not None and len(signal):
            inside, words = _inside(signal.t, trial.window), quantity.replace("_", " ")
            t, values = signal.t[inside], signal.values[inside]
            return Chart(f"{robot}/{human}", words, signal.unit, t, values, np.full(len(t), np.nan))
    return None


def _inside(t: FloatArray, window: Span | None) -> slice:
    """The rows in a window of time."""
    if window is None:
        return slice(0, len(t))
    return slice(int(t.searchsorted(window.start_s)), int(t.searchsorted(window.end_s, side="right")))


def _share(room: int, fewest: int, most: int) -> int:
    return min(max(room, fewest), most)


def _curve(
    check: str, chart: Chart, moments: Sequence[Span], stretches: int, finer: int
) -> DrawnChart | None:
    """A chart, reduced; `None` where it has no sample."""
    t = chart.t
    if not len(t):
        return None
    # Rounded before reducing, so that the extremes are those of the numbers that are stored.
    actual, limit = np.round(chart.actual, DECIMALS) + 0.0, np.round(chart.limit, DECIMALS) + 0.0
    known = np.isfinite(limit)
    columns = [actual, np.where(known, limit, actual), np.where(known, actual - limit, 0.0)]
    kept = [extremes(t, columns, stretches), _edges(known)]
    for moment in moments[:DETAILS]:
        near = _inside(t, Span(moment.start_s - AROUND_S, moment.end_s + AROUND_S))
        kept.append(near.start + extremes(t[near], [column[near] for column in columns], finer))
    holes = _holes(t, chart.max_gap_s)
    rows = distinct(np.concatenate([*kept, holes, holes + 1]))
    return DrawnChart(
        check,
        chart.subject,
        chart.what,
        chart.unit,
        chart.at_most,
        len(t),
        _numbers(t[rows]),
        _numbers(actual[rows]),
        tuple(float(v) if math.isfinite(v) else None for v in limit[rows]),
        _numbers(t[holes]),
    )


def _edges(known: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The samples on both sides of where a limit begins or ends to apply."""
    (changes,) = np.nonzero(np.diff(known))
    return np.concatenate([changes[:MOST_HOLES], changes[:MOST_HOLES] + 1])


def _holes(t: FloatArray, max_gap_s: float) -> NDArray[np.intp]:
    """The last samples before gaps that are too long; of very many the longest."""
    gaps = np.diff(t)
    (holes,) = np.nonzero(gaps > max_gap_s + 1e-9)
    # Stable, so that among equal gaps every machine keeps the same ones.
    longest = np.argsort(-gaps[holes], kind="stable")[:MOST_HOLES]
    return np.sort(holes[longest])


def _numbers(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(v) for v in np.round(values, DECIMALS) + 0.0)


def extremes(t: FloatArray, columns: Iterable[FloatArray], stretches: int) -> NDArray[np.intp]:
    """The rows that a drawing needs: in each stretch of time the least and the largest of every column.

    Args:
        t: Sample times, shape (n,), s, increasing.
        columns: Values, each of shape (n,), finite.
        stretches: Number of stretches of equal length the time is cut into.

    Returns:
        Their indices, increasing; the first and the last row are among them.

    >>> extremes(np.arange(6.0), [np.array([0.0, 9.0, 1.0, 1.0, -5.0, 0.0])], 2).tolist()
    [0, 1, 3, 4, 5]
    """
    if not len(t):
        return np.zeros(0, dtype=np.intp)
    width = (t[-1] - t[0]) / stretches
    stretch = np.zeros(len(t), dtype=np.intp)
    if width > 0:
        stretch = np.minimum(((t - t[0]) / width).astype(np.intp), stretches - 1)
    bounds = np.append(0, np.flatnonzero(np.diff(stretch)) + 1)
    counts = np.diff(np.append(bounds, len(t)))
    kept = [np.array([0, len(t) - 1], dtype=np.intp)]
    for column in columns:
        least = np.flatnonzero(column == np.repeat(np.minimum.reduceat(column, bounds), counts))
        largest = np.flatnonzero(column == np.repeat(np.maximum.reduceat(column, bounds), counts))
        # Of equal samples the first one is the least and the last one the largest.
        kept += [least[np.append(True, np.diff(stretch[least]) > 0)]]
        kept += [largest[np.append(np.diff(stretch[largest]) > 0, True)]]
    return distinct(np.concatenate(kept))


def _routes(trial: Trial, instants_s: Mapping[str, Sequence[float]]) -> Iterable[DrawnPath]:
    most = _share(PLACES // max(len(trial.bodies), 1), FEWEST_PLACES, MOST_PLACES)
    found = list(_motions(trial))
    heights = [one.places[:, 2] for one in found if one.places.shape[1] > 2]
    rises = len(heights) == len(found) and any(np.ptp(height) > _RISES_M for height in heights)
    axes = 3 if rises else 2
    extent_m = max((float(np.ptp(one.places[:, :axes], axis=0).max()) for one in found), default=0.0)
    near_m = min(max(extent_m * _NEAR_OF_EXTENT, _LEAST_NEAR_M), NEAR_M)
    for one in found:
        of_body = (
            t for subject, times in instants_s.items() if one.body in subject.split("/") for t in times
        )
        yield _route(one, axes, list(of_body)[:MOST_INSTANTS], most, near_m)


@dataclass(frozen=True)
class _Motion:
    """Where a body was in the time of the trial: the name of what stands for it, times, places (n, 3)."""

    body: str
    kind: str
    name: str
    t: FloatArray
    places: FloatArray


def _motions(trial: Trial) -> Iterator[_Motion]:
    # A body that moves by its links has no position of its own; its first link with samples stands for it.
    for body in sorted(trial.bodies, key=lambda b: (b.kind, b.id)):
        points = [body.id, *(f"{body.id}::{link}" for link in body.links)]
        name = next((p for p in points if len(trial.signals.get(f"position/{p}", ()))), None)
        if name is not None:
            signal = trial.signals[f"position/{name}"]
            inside = _inside(signal.t, trial.window)
            places = np.round(signal.values[inside], DECIMALS) + 0.0
            if len(places):
                yield _Motion(body.id, body.kind, name, signal.t[inside], places)


def _route(motion: _Motion, axes: int, at_s: Sequence[float], most: int, near_m: float) -> DrawnPath:
    """The route of a body, reduced."""
    t = motion.t
    places = [motion.places[:, axis] for axis in range(axes)]
    holes = _holes(t, _ROUTE_HOLE_S)
    after = np.clip(t.searchsorted(np.array(at_s, dtype=np.float64)), 0, len(t) - 1)
    fixed = distinct(np.concatenate([holes, holes + 1, after, np.maximum(after - 1, 0)]))
    coarse = np.arange(len(t))
    if len(t) >= _COARSE_FROM:
        coarse = distinct(np.concatenate([extremes(t, places, _COARSE_STRETCHES), fixed]))
    kept = places_kept(
        t[coarse],
        *(along[coarse] for along in places),
        fixed=(int(row) for row in coarse.searchsorted(fixed)),
        most=most,
        near_m=near_m,
    )
    rows = coarse[kept]
    x_m, y_m, *z_m = (_numbers(along[rows]) for along in places)
    return DrawnPath(
        motion.name, motion.kind, _numbers(t[rows]), x_m, y_m, _numbers(t[holes]), z_m[0] if z_m else ()
    )
