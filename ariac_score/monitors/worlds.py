"""The best and the worst world that a log allows, as a monitor sees them.

A monitor that says how its margin responds to its signals judges the same statement on the least and on
the most of them. Of any other nothing is known where samples lack: in the best world its limit is kept
there, in the worst it is broken all the time, at full depth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from ariac_score.checks.findings import Finding, Verdict, canonical
from ariac_score.checks.open_findings import Cause, Worlds
from ariac_score.errors import MissingSignalError
from ariac_score.monitors.blunt import Judged, blunt_worlds
from ariac_score.monitors.causes import causes_of_cells, causes_of_spans
from ariac_score.monitors.cells import INSTANT_S, TOLERANCE_S, Cells, Stream, cells_of
from ariac_score.monitors.flags import found_or_due
from ariac_score.monitors.limits import JudgedLimit, Statement
from ariac_score.monitors.pauses import joined_where_one, touch, violations_of
from ariac_score.monitors.unseen import Unseen
from ariac_score.monitors.watched import UndecidedError, Watched
from ariac_score.monitors.worsening import Worse, Worsening
from ariac_score.trial.computed import Computed
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import BoolArray, FloatArray, Span, distinct, merged, within_spans
from ariac_score.trial.sums import exact_sum
from ariac_score.trial.velocities import HALF_WINDOW_SAMPLES
from ariac_score.trial.vocabulary import DISTANCES, SPEEDS, quantity_of

__all__ = [
    "Opened",
    "alike",
    "open_worlds",
    "undecided_worlds",
]

Judge: TypeAlias = Callable[[Watched], Iterable[Statement]]

OPTIONAL_WORSE: Mapping[str, Worse] = {"m": "low", "m/s": "high"}
"""Of signals that only help: near and fast is worse."""


RESOLUTION_S = 1e-8
"""Cells of an instant make times differ by less than this."""
SAID_S = 0.0005
"""What is shorter is said as 0 s."""


@dataclass(frozen=True, eq=False)
class Opened:
    """What the intervals without samples leave open about a subject.

    Attributes:
        worlds: The findings of both worlds.
        statements: What was stated in the worst one.
        agree: Whether both worlds have the same findings, margins aside: then nothing is open.
        said: For each gap in which they differ, what can have been in it, in words.
    """

    worlds: Worlds
    statements: tuple[Statement, ...]
    agree: bool
    said: Mapping[Span, str] = field(default_factory=dict)


def open_worlds(watched: Watched, judge: Judge, monitor: Worsening) -> Opened | None:
    """Both worlds of a subject; `None` where no interval is open, or nothing can be judged in them.

    Args:
        watched: The signals as they were seen.
        judge: Everything about them.
        monitor: How it responds.
    """
    trial = watched.trial
    assumed, window = trial.between, trial.window
    if assumed is None or window is None or not watched.names:
        return None
    signals = {template: trial.signals[name] for template, name in watched.names.items()}
    unseen = Unseen(trial, assumed, window, watched.max_gap_s)
    opened = [one for one in unseen.all_streams(signals.values()) if one.open.any() or one.stands_for]
    if not opened and not watched.unknown:
        return None
    if opened and not watched.unknown and monitor.signals.keys() >= signals.keys():
        try:
            changes = _changes(watched, opened, window)
            found = _bounded(watched, judge, monitor, _Grid(unseen, signals, opened, window, changes))
        except UndecidedError:  # of a moment that no sample shows: nothing bounds what was there
            found = None
        if found is not None:
            return found
    spans = [*watched.gaps, *(span for stream in opened for span in stream.spans(window, monitor.beside))]
    for signal in signals.values():
        if isinstance(signal, Computed) and quantity_of(signal.name) in (*SPEEDS, "velocity"):
            # A speed over several intervals follows from places in those beside it.
            spans += [s for one in unseen.streams(signal) for s in one.spans(window, HALF_WINDOW_SAMPLES)]
    lacking = (found_or_due(trial, name) for name in watched.unknown)
    opened += [Stream.never_open(signal) for signal in lacking if signal is not None]
    hidden = merged(spans, within_s=TOLERANCE_S)
    first, *others = signals.values()
    # A speed that follows from places is of several; and a row may be a sample of one signal alone.
    whole = not isinstance(first, Computed) and all(np.array_equal(one.t, first.t) for one in others)
    said = replace(monitor, shows_itself=whole)
    return _blunt(watched, judge, said, opened, hidden, window) if spans else None


def _blunt(
    watched: Watched,
    judge: Judge,
    monitor: Worsening,
    opened: Sequence[Stream],
    spans: Sequence[Span],
    window: Span,
) -> Opened:
    """Kept in the best world, broken at full depth in the worst, in every open span."""
    held = [stream.held_s for stream in opened if stream.open.any()]
    shortest_s = min([watched.max_gap_s, *held, *_apart_s(watched)])
    judged: list[list[Statement]] = []
    # Whether what was before a gap goes on behind it may be for better or worse: a grace that has begun
    # before, or a contact that is none of its own.
    going_on, not_going_on = (replace(watched, gaps=[], max_gap_s=s) for s in (math.inf, shortest_s))
    hiding = [_hiding(going_on, spans, values) for values in monitor.may_hide]
    for read in (going_on, not_going_on, *hiding):
        try:
            judged.append(list(judge(read)) if len(watched) else [])
        except (UndecidedError, MissingSignalError):
            judged.append([])
            spans = [window]
    decided = all(judged) or not len(watched)
    at_worst = monitor.at_worst(going_on, spans) if monitor.at_worst is not None and decided else None
    limits = 1 if monitor.limits is None else monitor.limits(going_on)
    if at_worst is not None and all(one.verdict is Verdict.SATISFIED for one in at_worst):
        kept, shown = tuple(at_worst), tuple(_findings(judged[0]))
        if shown and all(one.verdict is Verdict.NOT_APPLICABLE for one in shown):
            # It may have applied in a gap, and was kept then: that may earn points.
            causes = causes_of_spans(opened, spans)
            return Opened(Worlds(watched.subject.name, kept, shown, causes), shown, agree=False)
        return Opened(Worlds(watched.subject.name, kept, kept), kept, agree=True)
    said = dict.fromkeys(watched.gaps, "a violation was possible in all of it")
    readings = [list(_by_limit(one, monitor)) for one in judged]
    courses = monitor.courses(going_on) if monitor.courses is not None and len(watched) else ()
    worlds = blunt_worlds(
        watched.subject.name,
        monitor,
        readings,
        opened,
        spans,
        courses=courses,
        limits=limits,
        at_worst=at_worst,
    )
    return Opened(worlds, tuple(judged[1]), agree=False, said=said)


def undecided_worlds(watched: Watched, stated: Sequence[Statement], monitor: Worsening) -> Worlds:
    """Both worlds of what a monitor leaves undecided by itself: kept at best, broken throughout at worst."""
    name, window = watched.subject.name, watched.trial.window
    undecided = [one for one in _findings(stated) if one.verdict is Verdict.INCONCLUSIVE]
    spans = merged(span for one in undecided if (span := one.span or window))
    worlds = blunt_worlds(name, monitor, [list(_by_limit(stated, monitor))], [], spans)
    causes = (Cause(one.message, spans=(one.span,) if one.span else ()) for one in undecided)
    return replace(worlds, causes=tuple(causes))


def _apart_s(watched: Watched) -> Iterator[float]:
    """A little less than how far apart samples are between which a flag is not known, s."""
    for span in (span for spans in watched.unknown.values() for span in spans):
        before, behind = watched.t[watched.t <= span.start_s], watched.t[watched.t >= span.end_s]
        if len(before) and len(behind):
            yield float(behind[0] - before[-1]) - 2.0 * TOLERANCE_S


def _hiding(
    watched: Watched, hidden: Sequence[Span], values: Mapping[str, float | tuple[float, ...]]
) -> Watched:
    """The same with some values of signals wherever nothing shows them."""
    if not len(watched):
        return watched
    moments = np.concatenate([watched.t, watched.turns, [event.t_s for event in watched.trial.events]])
    inside = [t for one in hidden for t in moments[(moments >= one.start_s) & (moments < one.end_s)]]
    times = np.unique([*(one.start_s for one in hidden), *inside])
    # A sample shows its own instant.
    times = np.where(np.isin(times, watched.t), times + INSTANT_S, times)
    t = np.unique(np.concatenate([watched.t, times]))
    rows = np.maximum(watched.t.searchsorted(t, side="right") - 1, 0)
    filled = np.isin(t, times)
    columns = {name: column[rows].copy() for name, column in watched.columns.items()}
    flags = {}
    for template, value in values.items():
        if template in watched.names:
            columns[watched.names[template]][filled] = value
        elif (flag := watched.trial.find_signal(f"{template}/{watched.subject.name}")) is not None:
            flags[flag.name] = _set(flag, value, times, watched.unknown.get(flag.name, ()))
    trial = replace(watched.trial, signals={**watched.trial.signals, **flags})
    return replace(watched, t=t, columns=columns, filled=filled, trial=trial)


def _set(flag: Signal, value: float | tuple[float, ...], t: FloatArray, unknown: Sequence[Span]) -> Signal:
    """A flag that has a value at some times where nothing shows it."""
    hidden = t[within_spans(t, unknown)]
    given = distinct(np.concatenate([flag.t, hidden]))
    values = flag.values[np.maximum(flag.t.searchsorted(given, side="right") - 1, 0)]
    return replace(flag, t=given, values=np.where(np.isin(given, hidden), value, values))


def _by_limit(statements: Sequence[Statement], monitor: Worsening) -> Iterator[Judged]:
    """Each limit, when it is broken, and what was found of it, which is stated behind it."""
    rows = [row for row, one in enumerate(statements) if isinstance(one, JudgedLimit)]
    if not rows:
        yield Judged((), _findings(statements), by_course=monitor.by_course)
    for first, behind in pairwise([*rows, len(statements)]):
        limit = statements[first]
        assert isinstance(limit, JudgedLimit)
        own = statements[0 if first == rows[0] else first : behind]
        each = limit.episodes(t_on_s=0.0, t_off_s=0.0) if monitor.graded else []
        depth = [one.profile for one in each]
        yield Judged(_broken_spans(limit), _findings(own), depth, by_course=monitor.by_course)


def _broken_spans(limit: JudgedLimit) -> list[Span]:
    """When a limit is broken, as samples stand."""
    rows = np.flatnonzero(limit.bound.broken)
    ends = limit.watched.t[rows] + limit.watched.durations_s[rows]
    return merged(map(Span, limit.watched.t[rows].tolist(), ends.tolist()), within_s=TOLERANCE_S)


def _changes(watched: Watched, opened: Sequence[Stream], window: Span) -> list[FloatArray]:
    """When what a monitor reads besides may change, each shape (k,), s.

    Its flags and what it needs of what helps it anywhere; events, and what helps to tell who is to blame, in
    open intervals: elsewhere they count where the samples are that it judges.
    """
    times = [one.t for one in watched.optional.values()]
    times.append(np.array([event.t_s for event in watched.trial.events]))
    stretches = merged(span for stream in opened for span in stream.spans(window))
    return [watched.turns, *(t[within_spans(t, stretches)] for t in times)]


# Bounded by how fast bodies move ---------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Grid:
    """What is needed to fill a subject's signals."""

    unseen: Unseen
    signals: Mapping[str, Signal]
    opened: Sequence[Stream]
    window: Span
    changes: Sequence[FloatArray]

    def cells(self) -> Cells:
        rate = max(self.unseen.rate_m_s(signal) for signal in self.signals.values())
        measured = [t for signal in self.signals.values() for t in self.unseen.measured(signal)]
        return cells_of(self.window, [*measured, *self.changes], self.opened, rate, self.unseen.trial.clocks)


def _bounded(watched: Watched, judge: Judge, monitor: Worsening, grid: _Grid) -> Opened | None:
    cells = grid.cells()
    ends = dict(zip(grid.signals, grid.unseen.bounds([*grid.signals.values()], cells), strict=True))
    known = {template: both for template, both in ends.items() if both is not None}
    if len(known) < len(ends):
        return None
    optional, unbounded = {}, {}
    for template, signal in watched.optional.items():
        (both,) = grid.unseen.bounds([signal], cells)
        worse = OPTIONAL_WORSE.get(signal.unit)
        if worse is None or signal.values.ndim > 1:
            continue
        if both is None:
            unbounded[template] = worse
        else:
            optional[template] = signal, both, worse
    filled = np.any([both[0] != both[1] for both in known.values()], axis=0)

    def world(worst: bool) -> Watched:
        def end(both: tuple[FloatArray, FloatArray], worse: Worse) -> FloatArray:
            return both[(worse == "high") == worst]

        columns = {watched.names[t]: end(both, monitor.signals[t]) for t, both in known.items()}
        helpful = {
            t: Signal(signal.name, signal.unit, cells.t, end(both, worse))
            for t, (signal, both, worse) in optional.items()
        }
        filling = replace(
            watched,
            t=cells.t,
            columns=columns,
            gaps=[],
            optional={**watched.optional, **helpful},
            filled=filled,
        )
        return filling.with_held(
            {t: np.maximum if (worse == "high") == worst else np.minimum for t, worse in unbounded.items()}
        )

    best, worst = _statements(world(False), judge), _statements(world(True), judge)
    if any(one.verdict is Verdict.INCONCLUSIVE for one in _findings(worst)):
        return None  # something else lacks that it reads
    most, least = (_limits(one) for one in (worst, best))
    fewest = joined_where_one(_findings(best), _findings(worst))
    extra = _further(least, most, _findings(worst), monitor)
    said = {gap: words for gap in watched.gaps if (words := _said(gap, least, most))}
    agree = not extra and alike(fewest, _findings(worst))
    tight = _is_path(grid, monitor, known, optional) and not extra and fewest == _findings(best)
    causes = causes_of_cells(grid.opened, grid.window, tuple(grid.unseen.remarks), _differing(least, most))
    worlds = Worlds(watched.subject.name, tuple(fewest), (*_findings(worst), *extra), causes, tight)
    return Opened(worlds, tuple(worst), agree, said)


def _is_path(
    grid: _Grid, monitor: Worsening, known: Mapping[str, object], optional: Mapping[str, object]
) -> bool:
    """Whether both ends of all signals together are paths that may have been.

    Those of one distance or speed that is recorded are (McShane). Where positions bound it, each instant is
    reached, but not all by one path; several signals need not have their worst together; and of stamps that
    may be wrong the extremes leave the samples.
    """
    (name, *others) = known
    signal, unseen = grid.signals[name], grid.unseen
    recorded = not isinstance(signal, Computed) and quantity_of(signal.name) in (*DISTANCES, *SPEEDS)
    shown_twice = len(unseen.measured(signal)) > 1
    loose = others or optional or unseen.remarks or monitor.flags or unseen.error_s(signal) or shown_twice
    return recorded and not loose


def _statements(watched: Watched, judge: Judge) -> list[Statement]:
    return list(judge(watched))


def _findings(statements: Iterable[Statement]) -> list[Finding]:
    return [one for one in statements if isinstance(one, Finding)]


def _limits(statements: Iterable[Statement]) -> list[JudgedLimit]:
    return [one for one in statements if isinstance(one, JudgedLimit)]


def _broken_s(limits: Sequence[JudgedLimit], within: Span) -> float:
    """How long a limit is broken within a span, the longest of several limits, s."""
    found = [0.0]
    for limit in limits:
        t = limit.watched.t
        rows = slice(int(t.searchsorted(within.start_s)), int(t.searchsorted(within.end_s)))
        found.append(exact_sum(limit.watched.durations_s[rows][limit.bound.broken[rows]]))
    return max(found)


def _said(gap: Span, best: Sequence[JudgedLimit], worst: Sequence[JudgedLimit]) -> str:
    """What can have been in a gap; empty where both worlds break their limits alike in it."""
    least_s, most_s = _broken_s(best, gap), _broken_s(worst, gap)
    if most_s - least_s <= RESOLUTION_S:
        return ""
    if least_s >= SAID_S:
        return f"a violation was certain in it, for {least_s:.3f} to {most_s:.3f} s"
    return f"a violation was possible in it, for 0 to {most_s:.3f} s"


def _differing(
    best: Sequence[JudgedLimit], worst: Sequence[JudgedLimit]
) -> list[tuple[FloatArray, FloatArray]]:
    """Beginning and end of the cells that only one of the worlds breaks a limit in."""
    found = []
    for one, other in zip(best, worst, strict=False):
        rows = np.flatnonzero(one.bound.broken != other.bound.broken)
        t = one.watched.t
        found.append((t[rows], t[np.minimum(rows + 1, len(t) - 1)]))
    return found


def _further(
    best: Sequence[JudgedLimit], worst: Sequence[JudgedLimit], found: Sequence[Finding], monitor: Worsening
) -> list[Finding]:
    """Violations that one of the worst world may have been instead: how many pauses fit into it.

    Their time and depth are in that one; so a sum over violations has its most, and so has their number.
    """
    further = []
    for one, other in zip(best, worst, strict=False):
        t = other.watched.t
        usual = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
        pause_s = max(monitor.t_off_s, usual)
        if pause_s <= 0.0:
            continue
        safe = ~one.bound.broken
        for violation in violations_of(found):
            if violation.span is None:
                continue
            for span in _runs(t, safe & (t >= violation.span.start_s) & (t < violation.span.end_s)):
                for number in range(math.floor(span.duration_s / pause_s + 1e-9)):
                    at_s = span.start_s + number * pause_s
                    further.append(touch(violation, at_s))
    return further


def _runs(t: FloatArray, holds: BoolArray) -> list[Span]:
    rows = np.flatnonzero(np.diff(np.concatenate(([False], holds, [False])).astype(np.int8)))
    return [
        Span(float(t[first]), float(t[min(after, len(t) - 1)]))
        for first, after in zip(rows[::2], rows[1::2], strict=True)
    ]


def alike(best: Sequence[Finding], worst: Sequence[Finding]) -> bool:
    """Whether both worlds have the same findings; a margin that is kept may be smaller in the one."""
    return len(best) == len(worst) and all(map(_same, best, worst))


def _same(one: Finding, other: Finding) -> bool:
    if (one.verdict, one.critical, one.labels) != (other.verdict, other.critical, other.labels):
        return False
    numbers = [{name: canonical(n) for name, n in f.quantities.items()} for f in (one, other)]
    if numbers[0] != numbers[1]:
        return False
    ends = [f.span and (round(f.span.start_s, 8), round(f.span.end_s, 8)) for f in (one, other)]
    return ends[0] == ends[1] and (one.verdict is not Verdict.VIOLATED or one.robustness == other.robustness)
