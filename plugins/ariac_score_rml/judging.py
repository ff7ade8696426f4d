"""What a specification says of the events of one subject, gone through window by window.

The windows are gone through once, to find what is rejected and what came closest. What is
rejected stays, up to a number of bytes, to be measured; where there was no room for it the
window is judged again.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from typing import NamedTuple

import numpy as np

from ariac_score import Course, Episodes, Finding, Sample, Span, Total, Trial, Verdict, exact_sum
from ariac_score_rml.automaton import MAX_TABLES, AfterViolation, Between, PartByPart, Watch, margins
from ariac_score_rml.columns import BoolArray, Columns, FloatArray, IntArray
from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.machine import Machine
from ariac_score_rml.terms import Term
from ariac_score_rml.windows import Events, Part

__all__ = ["Asked", "Judged"]

KEPT_BYTES = 8 << 20
"""So much of the events that are rejected first stays, whatever the length of the trial."""

KEPT_WINDOWS = 2
"""What was judged last stays in about so many windows, to be looked at again."""


@dataclass(frozen=True)
class Asked:
    """How a trial is judged.

    Attributes:
        machine: Makes a machine in its first state.
        after: What follows a rejection.
        max_gap_s: An event stands for no longer than this, s.
        t_on_s: Shorter violations are none, s.
        t_off_s: Violations less apart are one, s.
        spec_sha256: Which text this is.
    """

    machine: Callable[[], Machine]
    after: AfterViolation
    max_gap_s: float
    t_on_s: float
    t_off_s: float
    spec_sha256: str


@dataclass(frozen=True, eq=False)
class _Window:
    """One window, judged.

    Attributes:
        part: Its events.
        rejected: Whether each was rejected, shape (n,).
        margin: How far each is from coming out otherwise, shape (n,); NaN where no inequality decides.
        bound: What that inequality compares with, shape (n,); NaN likewise.
        field: Which field of its topic it limits, shape (n,); -1: none.
    """

    part: Part
    rejected: BoolArray
    margin: FloatArray
    bound: FloatArray
    field: IntArray


@dataclass(frozen=True, eq=False)
class _Rejected:
    """The events of a window that were rejected, each of shape (m,).

    Attributes:
        t: When each was, s.
        topic: Which topic it is of.
        field: As of a window.
        margin: Likewise.
        bound: Likewise.
        lasts_s: How long it stands for, until the next event of its topic.
    """

    t: FloatArray
    topic: IntArray
    field: IntArray
    margin: FloatArray
    bound: FloatArray
    lasts_s: FloatArray

    @classmethod
    def of(cls, window: _Window, max_gap_s: float) -> _Rejected:
        """Those of a window; none stands for longer than `max_gap_s`."""
        stream, rows = window.part.stream, np.flatnonzero(window.rejected)
        topic, lasts_s = stream.topic[rows], np.zeros(len(rows))
        for index, until_s in enumerate(window.part.until_s):
            t = stream.topics[index].t
            here = topic == index
            row = stream.row[rows[here]]
            last_s = (t[-1] if until_s is None else until_s) if len(row) else 0.0
            following = np.where(row + 1 < len(t), t[np.minimum(row + 1, len(t) - 1)], last_s)
            lasts_s[here] = np.minimum(following - t[row], max_gap_s)
        columns = window.field[rows], window.margin[rows], window.bound[rows]
        return cls(stream.t[rows], topic, *columns, lasts_s)

    def unmeasured(self) -> _Rejected:
        """The same without margins."""
        nothing = np.full(len(self.t), nan)
        return replace(self, margin=nothing, bound=nothing, field=np.full(len(self.t), -1))

    @property
    def size(self) -> int:
        """How many bytes are held by keeping them."""
        return 6 * self.t.nbytes

    def depths(self) -> _Depths:
        """How far they are beyond their limits."""
        depth, bound = np.maximum(-self.margin, 0.0), self.bound
        with np.errstate(over="ignore"):  # it is told only where it is in metres
            share = np.divide(depth, bound, out=np.ones_like(depth), where=bound > 0).clip(0.0, 1.0)
            return _Depths(depth, share, depth * self.lasts_s, share * self.lasts_s)

    def moment(self, row: int) -> _Moment:
        """One of them."""
        columns = self.t, self.topic, self.field, self.margin, self.bound
        t_s, topic, field, margin, bound = (column[row].item() for column in columns)
        return _Moment(t_s, topic, field, margin, bound)


class _Depths(NamedTuple):
    """How far rejected events are beyond their limits, each of shape (m,); NaN where no inequality decides.

    Attributes:
        depth: In the unit of the limit.
        share: As a share of the limit, at most all of it.
        depth_s: By how long each event lasts.
        share_s: Likewise.
    """

    depth: FloatArray
    share: FloatArray
    depth_s: FloatArray
    share_s: FloatArray


class _Windows:
    """The windows of a subject, judged; the first time in order, then any that is asked for.

    Attributes:
        events: What is judged.
        measured: Whether the margins can be said; known once all windows were judged.
        error: Why an event could not be judged.
        error_at: Which event that was; -1: none, or before any event.
        end: What may be said at the end: the last letter.
        fresh: Whether nothing was accepted since the start or the last restart.
    """

    def __init__(self, machine: Machine, events: Events, after: AfterViolation) -> None:
        self.events, self._machine = events, machine
        self._running = PartByPart(machine, after)
        self._kept: OrderedDict[int, _Window] = OrderedDict()
        self._met: set[Term] = set()
        self.measured, self.error, self.error_at = True, None, -1
        self._begins: list[Between | None] = []
        """Where the specification is before each window; `None`: nothing more is judged."""
        try:
            begin = Between.start(machine)
            self._begins.append(begin)
            self.end, self.fresh = begin.letter, True
        except RmlRunError as error:
            self._begins.append(None)
            self.error, self.end, self.fresh = error, "E", True

    def __iter__(self) -> Iterator[_Window]:
        for number in range(self.events.windows):
            yield self[number]
        if not self.measured:  # what came before it turned out has margins
            self._kept.clear()

    def __getitem__(self, number: int) -> _Window:
        if number in self._kept:
            self._kept.move_to_end(number)
            return self._kept[number]
        found = self._kept[number] = self._judge(number)
        while len(self._kept) > KEPT_WINDOWS:
            self._kept.popitem(last=False)
        return found

    def _judge(self, number: int) -> _Window:
        part = self.events.part(number)
        begin = self._begins[number] if number < len(self._begins) else None
        if begin is None:
            return _unmeasured(part, np.broadcast_to(np.bool_(False), len(part.stream)))
        columns = Columns(self._machine.matcher, part.stream)
        watch = self._running.run(number, part.stream, columns, begin)
        if number + 1 == len(self._begins):
            self._go_on(part, watch)
        match = margins(self._machine, part.stream, watch, columns) if self.measured else None
        if match is None:
            self.measured = False
            return _unmeasured(part, watch.rejected)
        finite = np.isfinite(match.margin)
        if finite.all():
            return _Window(part, watch.rejected, match.margin, match.bound, match.field)
        margin, bound = np.where(finite, match.margin, nan), np.where(finite, match.bound, nan)
        return _Window(part, watch.rejected, margin, bound, np.where(finite, match.field, -1))

    def _go_on(self, part: Part, watch: Watch) -> None:
        """Note where the window leads."""
        self._begins.append(watch.then)
        self.end, self.fresh, self.error = watch.end, watch.fresh, watch.error
        if watch.error is not None:
            self.error_at = part.first + watch.error_at
        if self.measured:
            self._met.update(watch.states)
            self.measured = len(self._met) <= MAX_TABLES
        if not self.measured:
            self._met.clear()


def _unmeasured(part: Part, rejected: BoolArray) -> _Window:
    count = len(part.stream)
    nothing = np.broadcast_to(np.float64(nan), count)
    return _Window(part, rejected, nothing, nothing, np.broadcast_to(np.intp(-1), count))


@dataclass(frozen=True)
class _Moment:
    """One event.

    Attributes:
        t_s: When.
        topic: Which topic it is of.
        field: Which field of it an inequality limits; -1: none.
        margin: How far it is from coming out otherwise; NaN where no inequality decides.
        bound: What that inequality compares with; NaN likewise.
    """

    t_s: float
    topic: int
    field: int
    margin: float
    bound: float

    @classmethod
    def of(cls, window: _Window, row: int) -> _Moment:
        """The event of a window."""
        stream = window.part.stream
        return cls(
            float(stream.t[row]),
            int(stream.topic[row]),
            int(window.field[row]),
            float(window.margin[row]),
            float(window.bound[row]),
        )


class Judged:
    """A specification over the events of one subject.

    Args:
        asked: How it is judged.
        subject: Whom the events are about.
        events: The events; there has to be one.
        decided: Whether nothing about it is open already.
    """

    def __init__(self, asked: Asked, subject: str, events: Events, *, decided: bool) -> None:
        self._asked, self._subject, self._events, self._decided = asked, subject, events, decided
        self._labels = {"spec_sha256": asked.spec_sha256}
        self._windows = _Windows(asked.machine(), events, asked.after)
        self._rejecting: dict[int, _Rejected | None] = {}
        """The windows in which something is rejected, and what; `None` where there was no room for it."""
        self._room_bytes = KEPT_BYTES
        self._closest: _Moment | None = None
        self._spans = self._go_through()
        if not self._windows.measured:
            self._closest = None
            kept = {number: one and one.unmeasured() for number, one in self._rejecting.items()}
            self._rejecting = kept

    def _go_through(self) -> list[Span]:
        """Judge all events; returns the episodes of rejected ones: of each topic, then joined."""
        asked = self._asked
        episodes = [
            Episodes(t_on_s=asked.t_on_s, t_off_s=asked.t_off_s, longest_s=asked.max_gap_s)
            for _ in self._events.recorded
        ]
        for window in self._windows:
            stream = window.part.stream
            for index, one in enumerate(episodes):
                one.take(stream.topics[index].t, window.rejected[stream.rows_of(index)])
            if window.rejected.any():
                self._keep(window)
            self._look_at(window)
        joined: list[Span] = []
        for span in sorted(stretch.span for one in episodes for stretch in one.end()):
            if joined and (
                span.overlaps(joined[-1]) or span.start_s - joined[-1].end_s < asked.t_off_s - 1e-9
            ):
                joined[-1] = Span(joined[-1].start_s, max(joined[-1].end_s, span.end_s))
            else:
                joined.append(span)
        return joined

    def _keep(self, window: _Window) -> None:
        """Keep what is rejected, where there is room for it."""
        found = _Rejected.of(window, self._asked.max_gap_s)
        fits = found.size <= self._room_bytes
        self._room_bytes -= found.size if fits else 0
        self._rejecting[window.part.number] = found if fits else None

    def _rejected(self) -> Iterator[_Rejected]:
        """What is rejected, window by window."""
        for number, kept in self._rejecting.items():
            yield _Rejected.of(self._windows[number], self._asked.max_gap_s) if kept is None else kept

    def _look_at(self, window: _Window) -> None:
        """Remember what comes closest."""
        margin = window.margin
        if not np.isfinite(margin).any():
            return
        closest = int(np.nanargmin(margin))
        if self._closest is None or margin[closest] < self._closest.margin:
            self._closest = _Moment.of(window, closest)

    def _judged(self, window: _Window) -> BoolArray:
        """The events that have a margin and could be judged."""
        known: BoolArray = np.isfinite(window.margin)
        at = self._windows.error_at - window.part.first
        if self._windows.error is not None and 0 <= at < len(known):
            known[at] = False
        return known

    # Margins -----------------------------------------------------------------------------

    @property
    def course(self) -> Course | None:
        """The margin over time, of events at one time the least; `None` where there is none of one unit."""
        if self._closest is None:
            return None
        units = {unit for window in self._windows for unit in self._units(window)}
        if len(units) != 1:
            return None
        unit = units.pop()
        if self._events.windows == 1:
            return self._course(self._windows[0], unit)
        asked, subject, events = self._asked, self._subject, self._events

        def made() -> Iterator[Course]:  # which holds nothing that was judged
            judged = Judged(asked, subject, events, decided=True)
            return (judged._course(window, unit) for window in judged._windows)

        return Course.late(subject, _MARGIN, unit, made, times=events.times, max_gap_s=asked.max_gap_s)

    def _units(self, window: _Window) -> set[str]:
        """The units of the margins in a window."""
        known, found = self._judged(window), set()
        for topic in range(len(self._events.recorded)):
            rows = window.part.stream.rows_of(topic)
            fields = np.unique(window.field[rows][known[rows]]).tolist()
            found |= {self._unit(topic, field) for field in fields}
        return found

    def _course(self, window: _Window, unit: str) -> Course:
        # A rejected event is beyond its limit, whatever the last digit says; an accepted one within.
        margin, known = window.margin, self._judged(window)
        margin = np.where(window.rejected, np.minimum(margin, 0.0), np.maximum(margin, 0.0))
        t, first = np.unique(window.part.stream.t, return_index=True)
        least = np.minimum.reduceat(np.where(known, margin, inf), first)
        told = np.isfinite(least)
        return Course(
            self._subject,
            _MARGIN,
            unit,
            t,
            np.where(told, least, 0.0),
            np.where(told, 0.0, nan),
            max_gap_s=self._asked.max_gap_s,
        )

    def _unit(self, topic: int, field: int) -> str:
        """The unit of a margin: that of the field which an inequality limits."""
        signals = list(self._events.recorded[topic].signals.values())
        return signals[field].unit if field >= 0 else ""

    # Findings ----------------------------------------------------------------------------

    def findings(self, trial: Trial) -> Iterator[Finding]:
        """Its violations, or that there are none."""
        yield from self._violations()
        if self._windows.error is not None:
            yield self._not_judged(trial, self._windows.error)
            return
        ends = self._end(trial)
        yield from ends
        if not self._spans and not ends and self._decided:
            yield self._kept()

    def _violations(self) -> Iterator[Finding]:
        if not self._spans:
            return iter(())
        starts_s = np.array([span.start_s for span in self._spans])
        ends_s = np.array([span.end_s for span in self._spans])

        def within(rejected: _Rejected) -> Iterator[tuple[int, int, int]]:
            """The violations that have some of these events, and from which to before which."""
            first, last = rejected.t.searchsorted(starts_s), rejected.t.searchsorted(ends_s, side="right")
            some = np.flatnonzero(first < last)
            return zip(some.tolist(), first[some].tolist(), last[some].tolist(), strict=True)

        counts = [0] * len(self._spans)
        for rejected in self._rejected():
            for span, begin, end in within(rejected):
                counts[span] += end - begin
        return self._measured(within, counts)

    def _measured(
        self, within: Callable[[_Rejected], Iterator[tuple[int, int, int]]], counts: Sequence[int]
    ) -> Iterator[Finding]:
        """The violations, each as soon as all of its events have come."""
        going: dict[int, _Violation] = {}
        for rejected in self._rejected():
            depths = rejected.depths()
            for span, begin, end in within(rejected):
                found = going.pop(span, None) or _Violation(self._spans[span], counts[span])
                if found.take(rejected, depths, slice(begin, end)):
                    yield self._violation(found)
                else:
                    going[span] = found

    def _violation(self, found: _Violation) -> Finding:
        worst = found.worst
        measured = isfinite(worst.margin)
        margin = min(worst.margin, 0.0) if measured else None
        unit = self._unit(worst.topic, worst.field) if measured else ""
        many = "event is" if found.count == 1 else f"{found.count} events are"
        where = f"{self._events.recorded[worst.topic].name!r} at {worst.t_s:.3f} s"
        by = (
            f"; at worst {-margin:.3f} {unit or 'units'} beyond its limit"
            if margin is not None
            else "; first"
        )
        final = " and nothing later is judged" if self._asked.after == "once" else ""
        return Finding(
            self._subject,
            Verdict.VIOLATED,
            f"{many} rejected{final}{by}, {where}",
            span=found.span,
            robustness=margin,
            unit=unit,
            quantities=found.quantities(in_metres=unit == "m"),
            labels=self._labels,
            evidence=self._evidence(worst),
        )

    def _evidence(self, moment: _Moment) -> tuple[Sample, ...]:
        samples = self._events.samples(moment.topic, moment.t_s)
        if not isfinite(moment.bound):
            return samples
        unit = self._unit(moment.topic, moment.field)
        return (*samples, Sample(f"bound/{self._subject}", moment.t_s, moment.bound, unit))

    def _not_judged(self, trial: Trial, error: RmlRunError) -> Finding:
        at, span, where = self._windows.error_at, trial.window, "the beginning"
        if at >= 0:
            t_s = self._events.time(at)
            where = f"event {at + 1}, at {t_s:.3f} s"
            span = span and Span(min(t_s, span.end_s), span.end_s)
        message = f"cannot be judged from {where}: {error}"
        return Finding(self._subject, Verdict.INCONCLUSIVE, message, span=span, labels=self._labels)

    def _end(self, trial: Trial) -> list[Finding]:
        """The violation of a trial that ends where the specification may not."""
        restarted = self._asked.after == "restart" and bool(self._rejecting)
        if self._windows.end != "f" or trial.ended_s is None or (restarted and self._windows.fresh):
            return []
        end_s = self._events.time(len(self._events) - 1)
        message = "the trial ends where the specification still asks for something"
        span = Span(end_s, end_s)
        return [Finding(self._subject, Verdict.VIOLATED, message, span=span, labels=self._labels)]

    def _kept(self) -> Finding:
        closest = self._closest
        if closest is None:
            message = f"all {len(self._events)} events are accepted"
            return Finding(self._subject, Verdict.SATISFIED, message, labels=self._labels)
        margin, unit = max(closest.margin, 0.0), self._unit(closest.topic, closest.field)
        return Finding(
            self._subject,
            Verdict.SATISFIED,
            f"at its closest {margin:.3f}{unit and ' '}{unit} within its limit, at {closest.t_s:.3f} s",
            robustness=margin,
            unit=unit,
            labels=self._labels,
            evidence=self._evidence(closest),
        )


_MARGIN = "margin of the specification"


class _Violation:
    """A violation, as its events come.

    Args:
        span: When.
        count: How many events are rejected in it.

    Attributes:
        worst: The event furthest beyond its limit; the first one where no inequality decides.
    """

    worst: _Moment

    def __init__(self, span: Span, count: int) -> None:
        self.span, self.count = span, count
        self._left, self._measured = count, True
        self._last: tuple[_Rejected, _Depths, slice] | None = None
        """Its events, where they came together."""

    def take(self, rejected: _Rejected, depths: _Depths, rows: slice) -> bool:
        """Take those of its events that are in a window; whether all have come."""
        begun = self._left < self.count
        self._left -= rows.stop - rows.start
        margin = rejected.margin[rows]
        known = np.isfinite(margin)
        if known.all():
            worst = rejected.moment(rows.start + int(margin.argmin()))
        else:
            self._measured = False
            worst = rejected.moment(rows.start + (int(np.nanargmin(margin)) if known.any() else 0))
        if (
            not begun
            or worst.margin < self.worst.margin
            or (isfinite(worst.margin) > isfinite(self.worst.margin))
        ):
            self.worst = worst
        if begun or self._left:
            if not begun:
                self._sums = _Sums(self.count)
            self._sums.take(rejected, depths, rows, measured=self._measured)
        else:
            self._last = rejected, depths, rows
        return not self._left

    def quantities(self, *, in_metres: bool) -> dict[str, float]:
        """What is measured of it, once all of its events have come."""
        measured = in_metres and self._measured
        if self._last is None:
            return self._sums.told(measured=measured)
        rejected, depths, rows = self._last
        found = {"time_in_violation_s": exact_sum(rejected.lasts_s[rows])}
        if measured:
            found["depth_max_m"] = float(depths.depth[rows].max())
            found["depth_integral_m_s"] = exact_sum(depths.depth_s[rows])
            found["relative_depth_max"] = float(depths.share[rows].max())
            found["relative_depth_integral_s"] = exact_sum(depths.share_s[rows])
        return found


class _Sums:
    """What adds up over a violation whose events come in parts.

    Args:
        count: How many there will be.
    """

    def __init__(self, count: int) -> None:
        self._time_s, self._depth_s, self._share_s = Total(count), Total(count), Total(count)
        self._depth_max = self._share_max = -inf

    def take(self, rejected: _Rejected, depths: _Depths, rows: slice, *, measured: bool) -> None:
        """Take some events, with depths where they are measured."""
        self._time_s.take(rejected.lasts_s[rows])
        if measured:
            self._depth_s.take(depths.depth_s[rows])
            self._share_s.take(depths.share_s[rows])
            self._depth_max = max(self._depth_max, float(depths.depth[rows].max()))
            self._share_max = max(self._share_max, float(depths.share[rows].max()))

    def told(self, *, measured: bool) -> dict[str, float]:
        """The quantities of the violation."""
        found = {"time_in_violation_s": self._time_s.value}
        if measured:
            found["depth_max_m"] = self._depth_max
            found["depth_integral_m_s"] = self._depth_s.value
            found["relative_depth_max"] = self._share_max
            found["relative_depth_integral_s"] = self._share_s.value
        return found
