"""What a page draws of a trial beyond its findings, small enough to be taken along in a result.

Series are reduced for drawing: of each stretch as wide as a pixel the smallest and the
largest value stay, so that no extreme is lost however much is left out; where something
was violated or nearly so, the stretches are finer. Nothing is decided by a sketch.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ariac_score.trial.course import Course
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray, Span, distinct

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["AskedPart", "AskedTask", "Brought", "Curve", "Route", "Sketch", "extremes", "sketch_of"]


DECIMALS = 4
"""Of seconds and of SI units: finer than anything drawn."""


STRETCHES = 2400


MOST_STRETCHES, FEWEST_STRETCHES = 800, 40


"""All curves share the stretches, so that a result stays small however many pairs there are."""


DETAILS, AROUND_S = 8, 2.0


"""So many violations of a curve are kept finer, with so much time before and after."""


DETAIL_STRETCHES = 2400


MOST_DETAIL_STRETCHES, FEWEST_DETAIL_STRETCHES = 100, 10


"""Those around violations are shared by all curves as well."""


ROUTE_STRETCHES = 300


_ROUTE_HOLE_S = 1.0


MOST_HOLES = 500


PART_SAMPLES = 16_384


DISTANCES = ("separation", "centre_distance", "centre_distance_2d")
"""What is drawn of a pair that no monitor has a limit for: the first of these that is known."""


@dataclass(frozen=True)
class Curve:
    """A course, reduced.

    Attributes:
        check: Name of the check; empty where no check has a limit.
        subject: Whom it is about.
        what: Name of the quantity.
        unit: Its unit.
        at_most: Whether the limit is an upper one.
        samples: Number of samples it was reduced from.
        t_s: Times, s.
        actual: What was.
        limit: What may be; `None` where there is no limit.
        holes_s: Times of samples after which nothing is known until the next.
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


@dataclass(frozen=True)
class Route:
    """Where a body went, seen from above, reduced.

    Attributes:
        body: Its id, or the name of the link that stands for it.
        kind: `robot`, `human` or `agv`.
        t_s: Times, s.
        x_m: Places, m.
        y_m: Places, m.
        holes_s: Times of samples after which it is not known where it went.
    """

    body: str
    kind: str
    t_s: tuple[float, ...]
    x_m: tuple[float, ...]
    y_m: tuple[float, ...]
    holes_s: tuple[float, ...] = ()


@dataclass(frozen=True)
class AskedPart:
    """One part as ordered."""

    slot: str
    type: str
    quadrant: int = 0


@dataclass(frozen=True)
class AskedTask:
    """One task as ordered."""

    order: str
    task: str
    kind: str
    agv: str
    station: str
    parts: tuple[AskedPart, ...]


@dataclass(frozen=True)
class Brought:
    """One submission: when, where, and the types of its parts, `None` when the log does not show them."""

    task: str
    submitted_s: float
    agv: str
    station: str
    parts: tuple[str, ...] | None


@dataclass(frozen=True)
class Sketch:
    """What a page draws of a trial beyond its findings.

    Attributes:
        curves: Quantities beside their limits.
        routes: Where bodies went.
        asked: What was ordered.
        brought: What was handed in.
    """

    curves: tuple[Curve, ...] = ()
    routes: tuple[Route, ...] = ()
    asked: tuple[AskedTask, ...] = ()
    brought: tuple[Brought, ...] = ()


def sketch_of(
    trial: Trial, courses: Mapping[str, Sequence[Course]], moments: Mapping[tuple[str, str], Sequence[Span]]
) -> Sketch:
    """The sketch of a trial.

    Args:
        trial: With the derived signals.
        courses: What each check saw, by its name.
        moments: Where each check found something out of the ordinary about a subject, the worst first.
    """
    told = {(check, course.subject): course for check, found in courses.items() for course in found}
    limited = {course.subject for course in told.values()}
    for robot, human in trial.pairs():
        plain = None if f"{robot.id}/{human.id}" in limited else _plain_distance(trial, robot.id, human.id)
        if plain is not None:
            told["", plain.subject] = plain
    many = max(len(told), 1)
    stretches = _share(STRETCHES // many, FEWEST_STRETCHES, MOST_STRETCHES)
    finer = _share(DETAIL_STRETCHES // (many * DETAILS), FEWEST_DETAIL_STRETCHES, MOST_DETAIL_STRETCHES)
    curves = (
        _curve(check, told[check, subject], moments.get((check, subject), ()), stretches, finer)
        for check, subject in sorted(told)
    )
    return Sketch(
        curves=tuple(curve for curve in curves if curve is not None),
        routes=tuple(_routes(trial)),
        asked=tuple(
            AskedTask(
                order.id,
                task.id,
                task.kind,
                task.agv,
                task.station,
                tuple(AskedPart(part.slot, part.type, part.quadrant) for part in task.products),
            )
            for order in trial.orders
            for task in order.tasks
        ),
        brought=tuple(
            Brought(
                one.task_id,
                _rounded(one.submitted_s),
                one.agv,
                one.station,
                None if one.contents is None else tuple(product.type for product in one.contents),
            )
            for one in trial.submissions
        ),
    )


def _rounded(value: float) -> float:
    return round(value, DECIMALS) + 0.0


def _plain_distance(trial: Trial, robot: str, human: str) -> Course | None:
    """The distance of a pair that nobody has a limit for."""
    for quantity in DISTANCES:
        signal = trial.signals.get(f"{quantity}/{robot}/{human}")
        if signal is not None and len(signal):
            words = quantity.replace("_", " ")
            shown = _Plain(signal, words, f"{robot}/{human}", trial.window)
            return Course.late(
                shown.subject, words, signal.unit, shown.parts, times=shown.times, max_gap_s=math.inf
            )
    return None


@dataclass(frozen=True)
class _Plain:
    """A signal as a course without a limit, part by part."""

    signal: Signal
    what: str
    subject: str
    window: Span | None

    def times(self) -> Iterator[FloatArray]:
        return (self.signal.times(*rows) for rows in _rows(self.signal, self.window))

    def parts(self) -> Iterator[Course]:
        for rows in _rows(self.signal, self.window):
            t, values = self.signal.stretch(*rows)
            yield Course(self.subject, self.what, self.signal.unit, t, values, np.full(len(t), np.nan))


def _rows(signal: Signal, window: Span | None) -> Iterator[tuple[int, int]]:
    """The rows of a signal in a window of time, some thousand at a time."""
    first, last = 0, len(signal)
    if window is not None:
        first = signal.row(window.start_s)
        last = signal.row(math.nextafter(window.end_s, math.inf))
    return ((row, min(row + PART_SAMPLES, last)) for row in range(first, last, PART_SAMPLES))


def _share(room: int, fewest: int, most: int) -> int:
    return min(max(room, fewest), most)


def _curve(check: str, course: Course, moments: Sequence[Span], stretches: int, finer: int) -> Curve | None:
    """A course, reduced; `None` where it has no sample.

    It is gone through part by part: first for its times, then for what may be drawn, of which in the
    end that is kept which would be kept of the whole.
    """
    laid_out = _LaidOut([_around(moment) for moment in moments[:DETAILS]], course.max_gap_s)
    for t in course.times():
        laid_out.take(t)
    if not laid_out.count:
        return None
    drawn = _Drawn(laid_out, stretches, finer)
    at_most = False
    for part in _grouped(course.parts()):
        at_most = part.at_most
        drawn.take(part)
    t, actual, limit, rows = drawn.columns()
    columns = _drawn_columns(actual, limit)
    kept = [extremes(t, columns, stretches), rows.searchsorted(drawn.edges)]
    for first, last in laid_out.near:
        near = slice(*rows.searchsorted([first, last + 1]).tolist())
        if near.start < near.stop:
            kept.append(near.start + extremes(t[near], [column[near] for column in columns], finer))
    beside = laid_out.beside
    kept += [rows.searchsorted(beside), rows.searchsorted(beside + 1)]
    shown = distinct(np.concatenate(kept))
    return Curve(
        check,
        course.subject,
        course.what,
        course.unit,
        at_most,
        laid_out.count,
        _numbers(t[shown]),
        _numbers(actual[shown]),
        tuple(float(v) if math.isfinite(v) else None for v in limit[shown]),
        _numbers(t[rows.searchsorted(beside)]),
    )


def _grouped(parts: Iterable[Course]) -> Iterator[Course]:
    """The same in longer parts, which take less time to go through."""
    waiting: list[Course] = []
    for part in parts:
        waiting.append(part)
        if sum(len(one.t) for one in waiting) >= PART_SAMPLES:
            yield _joined(waiting)
            waiting = []
    if waiting:
        yield _joined(waiting)


def _joined(parts: Sequence[Course]) -> Course:
    if len(parts) == 1:
        return parts[0]
    columns = ([getattr(part, name) for part in parts] for name in ("t", "actual", "limit"))
    t, actual, limit = (np.concatenate(column) for column in columns)
    return replace(parts[0], t=t, actual=actual, limit=limit)


def _around(moment: Span) -> tuple[float, float]:
    return moment.start_s - AROUND_S, moment.end_s + AROUND_S


def _drawn_columns(actual: FloatArray, limit: FloatArray) -> list[FloatArray]:
    """The columns whose extremes are drawn."""
    known = np.isfinite(limit)
    return [actual, np.where(known, limit, actual), np.where(known, actual - limit, 0.0)]


class _LaidOut:
    """Where the samples of a course are in time, of times that come in parts.

    Attributes:
        count: How many there are.
        near: The first and the last row around each moment; the last before the first where there is none.
    """

    def __init__(self, around: Sequence[tuple[float, float]], max_gap_s: float) -> None:
        self.count = 0
        self._around, self._max_gap_s = around, max_gap_s
        self.near = [(0, -1) for _ in around]
        self._near_s = [(0.0, 0.0) for _ in around]
        self._ends: list[float] = []
        self._holes, self._gaps = np.zeros(0, dtype=np.intp), np.zeros(0)

    def take(self, t: FloatArray) -> None:
        """Take the times after those before."""
        if not len(t):
            return
        for number, (from_s, to_s) in enumerate(self._around):
            first, last = int(t.searchsorted(from_s)), int(t.searchsorted(to_s, side="right")) - 1
            if first <= last:
                begun = self.near[number][0] <= self.near[number][1]
                row = self.near[number][0] if begun else self.count + first
                begin_s = self._near_s[number][0] if begun else float(t[first])
                self.near[number] = row, self.count + last
                self._near_s[number] = begin_s, float(t[last])
        before = self._ends[1:]
        gaps = np.diff(np.concatenate([before, t]))
        (holes,) = np.nonzero(gaps > self._max_gap_s + 1e-9)
        self._holes = np.concatenate([self._holes, holes + (self.count - len(before))])
        self._gaps = np.concatenate([self._gaps, gaps[holes]])
        longest = np.sort(np.argsort(-self._gaps, kind="stable")[:MOST_HOLES])
        self._holes, self._gaps = self._holes[longest], self._gaps[longest]
        self._ends = [self._ends[0] if self._ends else float(t[0]), float(t[-1])]
        self.count += len(t)

    @property
    def beside(self) -> NDArray[np.intp]:
        """The samples after which too long nothing comes; of very many the longest."""
        return self._holes

    @property
    def stretches(self) -> Iterator[tuple[tuple[int, int], tuple[float, float]]]:
        """Rows and times of the whole, and of what is around each moment."""
        yield (0, self.count - 1), (self._ends[0], self._ends[1])
        yield from zip(self.near, self._near_s, strict=True)


class _Drawn:
    """What may be drawn of a course whose parts come one by one: some samples of each.

    Attributes:
        edges: The samples on both sides of where a limit begins or ends to apply.
    """

    def __init__(self, laid_out: _LaidOut, stretches: int, finer: int) -> None:
        self._laid_out = laid_out
        self._reduced = [
            (rows, times, finer if number else stretches)
            for number, (rows, times) in enumerate(laid_out.stretches)
        ]
        self._count = 0
        self._known: bool | None = None
        self._changes: list[NDArray[np.intp]] = []
        self._found: list[tuple[FloatArray, FloatArray, FloatArray, NDArray[np.intp]]] = []

    def take(self, part: Course) -> None:
        """Take a part, later than those before."""
        n, first = len(part.t), self._count
        if not n:
            return
        actual, limit = np.round(part.actual, DECIMALS) + 0.0, np.round(part.limit, DECIMALS) + 0.0
        columns = _drawn_columns(actual, limit)
        self._edges_of(np.isfinite(limit))
        kept = [np.array([0, n - 1], dtype=np.intp)]
        for (begin, end), (from_s, to_s), stretches in self._reduced:
            here = slice(max(begin - first, 0), min(end - first + 1, n))
            if here.start < here.stop:
                stretch = _stretch_of(part.t[here], from_s, to_s, stretches)
                some = _extremes_of(stretch, [column[here] for column in columns])
                ends = np.array([0, here.stop - here.start - 1], dtype=np.intp)
                kept += [here.start + some, here.start + ends]
        beside = self._laid_out.beside
        for rows in (beside - first, beside + 1 - first):
            kept.append(rows[(rows >= 0) & (rows < n)])
        kept.append(np.concatenate([*self._changes[-1:], np.zeros(0, dtype=np.intp)]) - first)
        own = distinct(np.concatenate([rows[(rows >= 0) & (rows < n)] for rows in kept]))
        self._found.append((part.t[own], actual[own], limit[own], own + first))
        self._count += n

    def _edges_of(self, known: NDArray[np.bool_]) -> None:
        before = [] if self._known is None else [self._known]
        (changes,) = np.nonzero(np.diff(np.concatenate([np.array(before, dtype=bool), known])))
        changes = changes + (self._count - len(before))
        room = MOST_HOLES - sum(len(found) // 2 for found in self._changes)
        self._changes.append(np.concatenate([changes[:room], changes[:room] + 1]))
        self._known = bool(known[-1])

    @property
    def edges(self) -> NDArray[np.intp]:
        """See above."""
        return np.concatenate([*self._changes, np.zeros(0, dtype=np.intp)])

    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.intp]]:
        """Times, what was, what may be, and the rows these samples have."""
        t, actual, limit, rows = (np.concatenate(column) for column in zip(*self._found, strict=True))
        return t, actual, limit, rows


def _numbers(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(v) for v in np.round(values, DECIMALS) + 0.0)


def extremes(t: FloatArray, columns: Iterable[FloatArray], stretches: int) -> NDArray[np.intp]:
    """The rows that a drawing needs: of each stretch of time the least and the largest of every column.

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
    ends = np.array([0, len(t) - 1], dtype=np.intp)
    stretch = _stretch_of(t, t[0], t[-1], stretches)
    return distinct(np.concatenate([ends, _extremes_of(stretch, columns)]))


def _stretch_of(t: FloatArray, start_s: float, end_s: float, stretches: int) -> NDArray[np.intp]:
    """In which of some stretches of equal length, from a start to an end, each time is."""
    width = (end_s - start_s) / stretches
    if not width > 0:
        return np.zeros(len(t), dtype=np.intp)
    return np.minimum(((t - start_s) / width).astype(np.intp), stretches - 1)


def _extremes_of(stretch: NDArray[np.intp], columns: Iterable[FloatArray]) -> NDArray[np.intp]:
    """The rows of the least and of the largest value in each stretch of every column."""
    bounds = np.append(0, np.flatnonzero(np.diff(stretch)) + 1)
    counts = np.diff(np.append(bounds, len(stretch)))
    kept = [np.zeros(0, dtype=np.intp)]
    for column in columns:
        least = np.flatnonzero(column == np.repeat(np.minimum.reduceat(column, bounds), counts))
        largest = np.flatnonzero(column == np.repeat(np.maximum.reduceat(column, bounds), counts))
        # Of equal samples the first one is the least and the last one the largest.
        kept += [least[np.append(True, np.diff(stretch[least]) > 0)]]
        kept += [largest[np.append(np.diff(stretch[largest]) > 0, True)]]
    return np.concatenate(kept)


def _routes(trial: Trial) -> Iterable[Route]:
    for body in sorted(trial.bodies, key=lambda b: (b.kind, b.id)):
        points = [body.id, *(f"{body.id}::{link}" for link in body.links)]
        name = next((p for p in points if len(trial.signals.get(f"position/{p}", ()))), None)
        if name is None:
            continue
        route = _route(name, body.kind, trial.signals[f"position/{name}"], trial.window)
        if route is not None:
            yield route


def _route(name: str, kind: str, signal: Signal, window: Span | None) -> Route | None:
    """Where something went, reduced; `None` where it has no sample. Likewise gone through part by part."""
    laid_out = _LaidOut([], _ROUTE_HOLE_S)
    for rows in _rows(signal, window):
        laid_out.take(signal.times(*rows))
    if not laid_out.count:
        return None
    ((_, (from_s, to_s)),) = laid_out.stretches
    beside, first = laid_out.beside, 0
    found: list[tuple[FloatArray, FloatArray, NDArray[np.intp]]] = []
    for rows in _rows(signal, window):
        t, places = signal.stretch(*rows)
        places, n = np.round(places, DECIMALS) + 0.0, len(t)
        stretch = _stretch_of(t, from_s, to_s, ROUTE_STRETCHES)
        kept = [np.array([0, n - 1]), _extremes_of(stretch, [places[:, 0], places[:, 1]])]
        kept += [near[(near >= 0) & (near < n)] for near in (beside - first, beside + 1 - first)]
        own = distinct(np.concatenate(kept))
        found.append((t[own], places[own], own + first))
        first += n
    t, places, numbers = (np.concatenate(column) for column in zip(*found, strict=True))
    x, y = places[:, 0], places[:, 1]
    around = [numbers.searchsorted(beside), numbers.searchsorted(beside + 1)]
    shown = distinct(np.concatenate([extremes(t, [x, y], ROUTE_STRETCHES), *around]))
    holes = t[numbers.searchsorted(beside)]
    return Route(name, kind, _numbers(t[shown]), _numbers(x[shown]), _numbers(y[shown]), _numbers(holes))
