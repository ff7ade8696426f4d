"""What a page draws of a trial beyond its findings, small enough to be taken along in a result.

Series are reduced for drawing: of each stretch as wide as a pixel the smallest and the
largest value stay, so that no extreme is lost however much is left out; where something
was violated or nearly so, the stretches are finer. Nothing is decided by a sketch.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from ariac_score.records import dataclass
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import FloatArray, Span, distinct

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
else:
    from ariac_score.later import numpy as np

__all__ = [
    "AskedPart",
    "AskedTask",
    "Brought",
    "Course",
    "Curve",
    "Route",
    "Sketch",
    "extremes",
    "sketch_of",
]

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
MOST_HOLES = 500

DISTANCES = ("separation", "centre_distance", "centre_distance_2d")
"""What is drawn of a pair that no monitor has a limit for: the first of these that is known."""


@dataclass(frozen=True, eq=False)
class Course:
    """A measured quantity beside its limit over time, as a monitor saw it.

    Attributes:
        subject: As in its findings.
        what: Name of the quantity, such as `distance`.
        unit: Of quantity and limit.
        t: Sample times, shape (n,), s, strictly increasing.
        actual: What was, shape (n,).
        limit: What may be, shape (n,); NaN where there is no limit.
        at_most: Whether the limit is an upper one.
        max_gap_s: Nothing is known between samples further apart, s.

    Raises:
        ValueError: Shapes differ, or something measured is not finite.
    """

    subject: str
    what: str
    unit: str
    t: FloatArray
    actual: FloatArray
    limit: FloatArray
    at_most: bool = False
    max_gap_s: float = math.inf

    @property
    def margin(self) -> FloatArray:
        """Signed distance to the limit, shape (n,), negative where it is broken; NaN where there is none."""
        return self.limit - self.actual if self.at_most else self.actual - self.limit

    @classmethod
    def late(
        cls, subject: str, what: str, unit: str, made: Callable[[], Course], *, max_gap_s: float
    ) -> Course:
        """A course that is made whenever it is looked at, so that not all of a trial are held at once."""
        return _Late(subject, what, unit, made, max_gap_s)

    def whole(self) -> Course:
        """The course with all its samples."""
        return self

    def __post_init__(self) -> None:
        if not self.t.shape == self.actual.shape == self.limit.shape == (len(self.t),):
            raise ValueError(f"the course of {self.what} has columns of different length")
        if not (np.isfinite(self.t).all() and np.isfinite(self.actual).all()):
            raise ValueError(f"the course of {self.what} holds what is no number")
        if (np.diff(self.t) <= 0).any():
            raise ValueError(f"the times of the course of {self.what} do not increase")


class _Late(Course):
    """A course of which only how it is made is kept."""

    _made: Callable[[], Course]

    def __init__(
        self, subject: str, what: str, unit: str, made: Callable[[], Course], max_gap_s: float
    ) -> None:
        known = {"subject": subject, "what": what, "unit": unit, "_made": made, "max_gap_s": max_gap_s}
        for name, value in known.items():
            object.__setattr__(self, name, value)

    def whole(self) -> Course:
        """The course with all its samples."""
        return self._made()

    @property
    def t(self) -> FloatArray:
        """All times."""
        return self._made().t

    @property
    def actual(self) -> FloatArray:
        """All that was."""
        return self._made().actual

    @property
    def limit(self) -> FloatArray:
        """All that may be."""
        return self._made().limit


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
        _curve(check, told[check, subject].whole(), moments.get((check, subject), ()), stretches, finer)
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
            inside = _inside(signal.t, trial.window)
            nothing = np.full(int(inside.sum()), np.nan)
            words = quantity.replace("_", " ")
            return Course(
                f"{robot}/{human}", words, signal.unit, signal.t[inside], signal.values[inside], nothing
            )
    return None


def _inside(t: FloatArray, window: Span | None) -> NDArray[np.bool_]:
    if window is None:
        return np.ones(len(t), dtype=bool)
    inside: NDArray[np.bool_] = (t >= window.start_s) & (t <= window.end_s)
    return inside


def _share(room: int, fewest: int, most: int) -> int:
    return min(max(room, fewest), most)


def _curve(check: str, course: Course, moments: Sequence[Span], stretches: int, finer: int) -> Curve | None:
    """A course, reduced; `None` where it has no sample."""
    if not len(course.t):
        return None
    actual, limit = np.round(course.actual, DECIMALS) + 0.0, np.round(course.limit, DECIMALS) + 0.0
    known = np.isfinite(limit)
    margin = np.where(known, actual - limit, 0.0)
    columns = [actual, np.where(known, limit, actual), margin]
    kept = [extremes(course.t, columns, stretches), _edges(known)]
    for moment in moments[:DETAILS]:
        (rows,) = np.nonzero((course.t >= moment.start_s - AROUND_S) & (course.t <= moment.end_s + AROUND_S))
        if len(rows):
            near = slice(rows[0], rows[-1] + 1)
            kept.append(rows[0] + extremes(course.t[near], [column[near] for column in columns], finer))
    beside = _beside_holes(course.t, course.max_gap_s)
    rows = distinct(np.concatenate([*kept, beside, beside + 1]))
    return Curve(
        check,
        course.subject,
        course.what,
        course.unit,
        course.at_most,
        len(course.t),
        _numbers(course.t[rows]),
        _numbers(actual[rows]),
        tuple(float(v) if math.isfinite(v) else None for v in limit[rows]),
        _numbers(course.t[beside]),
    )


def _numbers(values: FloatArray) -> tuple[float, ...]:
    return tuple(float(v) for v in np.round(values, DECIMALS) + 0.0)


def _edges(known: NDArray[np.bool_]) -> NDArray[np.intp]:
    """The samples on both sides of where a limit begins or ends to apply."""
    (changes,) = np.nonzero(np.diff(known))
    return np.concatenate([changes[:MOST_HOLES], changes[:MOST_HOLES] + 1])


def _beside_holes(t: FloatArray, max_gap_s: float) -> NDArray[np.intp]:
    """The samples after which too long nothing comes; of very many the longest."""
    gaps = np.diff(t)
    (holes,) = np.nonzero(gaps > max_gap_s + 1e-9)
    longest = np.argsort(-gaps[holes], kind="stable")[:MOST_HOLES]
    return np.sort(holes[longest])


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
    width = (t[-1] - t[0]) / stretches
    stretch = (
        np.minimum(((t - t[0]) / width).astype(np.intp), stretches - 1)
        if width > 0
        else np.zeros(len(t), dtype=np.intp)
    )
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


def _routes(trial: Trial) -> Iterable[Route]:
    for body in sorted(trial.bodies, key=lambda b: (b.kind, b.id)):
        points = [body.id, *(f"{body.id}::{link}" for link in body.links)]
        name = next((p for p in points if len(trial.signals.get(f"position/{p}", ()))), None)
        if name is None:
            continue
        signal = trial.signals[f"position/{name}"]
        inside = _inside(signal.t, trial.window)
        t, places = signal.t[inside], np.round(signal.values[inside], DECIMALS) + 0.0
        if not len(t):
            continue
        beside = _beside_holes(t, 1.0)
        rows = distinct(
            np.concatenate([extremes(t, [places[:, 0], places[:, 1]], ROUTE_STRETCHES), beside, beside + 1])
        )
        yield Route(
            name,
            body.kind,
            _numbers(t[rows]),
            _numbers(places[rows, 0]),
            _numbers(places[rows, 1]),
            _numbers(t[beside]),
        )
