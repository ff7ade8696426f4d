"""Stopping, and not starting again by itself, after IEC 60204-1 and ISO 13850.

Stops are events: `emergency_stop` and `protective_stop`; `emergency_stop_reset` and
`start` end an emergency stop. Their subject is a machine; without one they concern all.

IEC 60204-1 has three stop categories: 0 cuts the power at once, 1 stops under control and then
cuts it, 2 stops under control and keeps it. ISO 13850 allows 0 and 1 for an emergency stop.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from ariac_score import (
    Event,
    Finding,
    FloatArray,
    Measure,
    Span,
    Verdict,
    episodes_where,
    exact_sum,
    parameter,
)
from ariac_score.monitors import (
    STANDSTILL_SPEED_M_S,
    TOLERANCE_S,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Rows,
    Statement,
    SubjectMonitor,
    Subjects,
    Watched,
    bodies,
    rows_of_episodes,
    state_over,
)
from ariac_score_standards.parameters import GAP, SPEED, TIME
from ariac_score_standards.travel import travelled_m

EMERGENCY_STOP = "emergency_stop"
PROTECTIVE_STOP = "protective_stop"
RESET = "emergency_stop_reset"
START = "start"


# Formulas -------------------------------------------------------------------------------------


def standstill_reached_s(
    t: FloatArray, speed_m_s: FloatArray, request_s: float, *, standstill_m_s: float, hold_s: float
) -> float | None:
    """When the speed came below standstill for at least `hold_s`, s of trial time; `None`: never.

    Between samples the speed is a straight line, so that the time does not depend on
    where samples fall.

    >>> t, v = np.array([0.0, 1.0, 2.0]), np.array([1.0, 0.0, 0.0])
    >>> standstill_reached_s(t, v, 0.0, standstill_m_s=0.25, hold_s=0.5)
    0.75
    """
    first = int(t.searchsorted(request_s - TOLERANCE_S))
    for span in episodes_where(t[first:], speed_m_s[first:] <= standstill_m_s):
        row = int(t.searchsorted(span.start_s))
        reached_s = max(_crossing(t, speed_m_s, row, standstill_m_s), request_s)
        if span.end_s - reached_s >= hold_s - TOLERANCE_S:
            return reached_s
    return None


def _crossing(t: FloatArray, speed: FloatArray, first: int, limit: float) -> float:
    """Time at which the speed falls to the limit before its first row at or below it."""
    # At or below it before as well: the stop was requested at rest, or the samples begin here.
    if first == 0 or speed[first - 1] <= limit:
        return float(t[first])
    share = (speed[first - 1] - limit) / (speed[first - 1] - speed[first])
    return float(t[first - 1] + share * (t[first] - t[first - 1]))


def stop_category(power_off_s: float | None, standstill_s: float) -> Literal[0, 1, 2]:
    """The stop category a record shows: 0 power off before standstill, 1 after, 2 never.

    >>> stop_category(10.3, 10.5), stop_category(10.6, 10.5), stop_category(None, 10.5)
    (0, 1, 2)
    """
    if power_off_s is None:
        return 2
    return 0 if power_off_s < standstill_s else 1


# Stopping -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StopPerformance(SubjectMonitor):
    """A machine that has to stop does, in time and on the way it has.

    Measures:
        For every machine and every stop request (`emergency_stop`, `protective_stop`)
        the time until its speed stays at standstill for `hold_s`, in s; the way covered
        until then, in m; the stop category, where the log has `drive_enabled`.
    Violated when:
        Time or way exceeds its limit, the machine does not stop, or an emergency stop
        is of category 2: the power stays on.
    Source:
        IEC 60204-1 (stop categories), ISO 13850 (emergency stop: 0 or 1), ISO 10218-1
        (stopping time and distance). The limits are data of the machine: 0.5 s is our
        choice, and there is none for the way.
    """

    kind: Literal["robot", "agv"] = parameter("robot", source="which machines")
    max_time_s: float = parameter(0.5, source="data of the machine; catalogue, M8", **TIME)
    max_distance_m: float | None = parameter(
        None, unit="m", at_least=0, at_most=100, source="data of the machine"
    )
    hold_s: float = parameter(0.1, source="catalogue, M8", **TIME)
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7", **SPEED)
    power_wait_s: float = parameter(1.0, source="how long after standstill power may go off", **TIME)
    max_flag_age_s: float = parameter(1.0, unit="s", above=0, at_most=60, source="how long a flag holds")
    max_gap_s: float = parameter(0.05, **GAP)

    clause = "derived from IEC 60204-1 and ISO 13850, stop functions"
    flags = ("drive_enabled",)
    only_after = (EMERGENCY_STOP, PROTECTIVE_STOP)
    may_be_critical: ClassVar[bool] = True
    measures: ClassVar[Mapping[str, Measure]] = {
        "stop_time_s": Measure("s", meaning="from the request to standstill"),
        "stop_distance_m": Measure("m", meaning="way covered until then"),
        "excess_s": Measure("s", best=0.0, meaning="how much longer than it may take"),
    }

    @property
    def subjects(self) -> Subjects:
        """The machines."""
        return bodies(self.kind)

    @property
    def wanted(self) -> dict[str, str]:
        """The speed."""
        return {self._speed: "m/s"}

    @property
    def _speed(self) -> str:
        return f"speed/{{{self.kind}}}"

    def about(self, signals: Watched) -> Iterator[Finding]:
        """Each of its stops, or that none was requested."""
        requests = events_about(signals, self.only_after)
        for request in requests:
            yield self._stop(signals, request)
        if not requests:
            yield nothing_happened(signals, self.only_after, self.clause)

    def at_worst(self, signals: Watched, hidden: Sequence[Span]) -> list[Finding] | None:
        """Each stop that is bad as samples stand, or of whose course a part is hidden."""
        window = signals.trial.window
        found = []
        for request in events_about(signals, self.only_after):
            if not len(signals):
                found.append(self._bad(signals, request, window or Span(request.t_s, request.t_s)))
                continue
            stop = self._stop(signals, request)
            ended_s = request.t_s if stop.span is None else stop.span.end_s
            course = Span(request.t_s, max(ended_s, request.t_s) + max(self.hold_s, self.power_wait_s))
            if stop.verdict is Verdict.INCONCLUSIVE or any(one.overlaps(course) for one in hidden):
                found.append(self._bad(signals, request, window or course))
            else:
                found.append(stop)
        return found or None

    def _bad(self, watched: Watched, request: Event, until: Span) -> Finding:
        name = request.kind.replace("_", " ")
        return Finding(
            watched.subject.name,
            Verdict.VIOLATED,
            f"{name} at {request.t_s:.3f} s: nothing shows that it stopped as it must",
            span=Span(request.t_s, max(request.t_s, until.end_s)),
            clause=self.clause,
            critical=request.kind == EMERGENCY_STOP,
        )

    def _stop(self, watched: Watched, request: Event) -> Finding:
        subject, window = watched.subject.name, watched.trial.window
        name = request.kind.replace("_", " ")
        reached = standstill_reached_s(
            watched.t,
            watched[self._speed],
            request.t_s,
            standstill_m_s=self.standstill_speed_m_s,
            hold_s=self.hold_s,
        )
        last = watched.end_s
        end = last if reached is None else reached + self.hold_s
        unseen = [gap for gap in watched.gaps if gap.start_s < end and gap.end_s > request.t_s]
        if unseen or last < request.t_s or (reached is None and last < request.t_s + self.max_time_s):
            message = f"{name} at {request.t_s:.3f} s: the log does not show the whole stop"
            return Finding.inconclusive(subject, message, span=window, clause=self.clause)
        if reached is None:
            message = f"{name} at {request.t_s:.3f} s: no stop until the log ends at {last:.3f} s"
            return Finding(
                subject,
                Verdict.VIOLATED,
                message,
                span=Span(request.t_s, last),
                robustness=request.t_s + self.max_time_s - last,
                unit="s",
                clause=self.clause,
                critical=request.kind == EMERGENCY_STOP,
            )
        return self._stopped(watched, request, reached)

    def _stopped(self, watched: Watched, request: Event, reached: float) -> Finding:
        time_s = reached - request.t_s
        # Creeping below the standstill speed during `hold_s` still belongs to the way.
        way_m = travelled_m(watched.t, watched[self._speed], Span(request.t_s, reached + self.hold_s))
        category = self._category(watched, request, reached)
        over_time = time_s > self.max_time_s + TOLERANCE_S
        way_left_m = None if self.max_distance_m is None else self.max_distance_m - way_m
        over_way = way_left_m is not None and way_left_m < 0
        is_emergency = request.kind == EMERGENCY_STOP
        powered = category == 2 and is_emergency
        until_s = reached + self.power_wait_s
        hidden = _hidden_within(watched, Span(request.t_s, until_s))
        words = [f"{request.kind.replace('_', ' ')} at {request.t_s:.3f} s: stopped in {time_s:.3f} s"]
        words.append(f"on {way_m:.3f} m")
        if over_time:
            words.append(f"at most {self.max_time_s:g} s")
        if over_way:
            words.append(f"at most {self.max_distance_m:g} m")
        if powered:
            words.append("the drives kept their power (category 2)")
        if hidden and is_emergency and not (over_time or over_way or powered):
            words.append(
                f"whether the drives kept their power, nothing shows from {hidden[0].start_s:.3f} s on"
            )
            span = Span(request.t_s, until_s)
            return Finding.inconclusive(watched.subject.name, ", ".join(words), span=span, clause=self.clause)
        # Of the limit that is broken: a margin above 0 would contradict the verdict. A category has none.
        margin: tuple[float | None, str] = self.max_time_s - time_s, "s"
        if not over_time and (over_way or powered):
            margin = (way_left_m, "m") if over_way else (None, "")
        return Finding(
            watched.subject.name,
            Verdict.VIOLATED if over_time or over_way or powered else Verdict.SATISFIED,
            ", ".join(words),
            span=Span(request.t_s, reached),
            robustness=margin[0],
            unit=margin[1],
            quantities={
                "stop_time_s": time_s,
                "stop_distance_m": way_m,
                "excess_s": max(time_s - self.max_time_s, 0.0),
            },
            labels={"category": "unknown" if category is None else str(category), "request": request.kind},
            clause=self.clause,
        )

    def _category(self, watched: Watched, request: Event, reached: float) -> int | None:
        """The category shown by the drives' power; `None` when the log does not show it."""
        until_s = reached + self.power_wait_s
        # When the power went off show the samples of the flag, whatever those of the speed do.
        flag = watched.trial.find_signal(f"drive_enabled/{watched.subject.name}")
        times = watched.t if flag is None else np.union1d(watched.t, flag.t)
        t = times[(times >= request.t_s) & (times <= min(until_s, watched.end_s))]
        state = state_over(
            watched.trial, "drive_enabled", watched.subject.name, t, max_age_s=self.max_flag_age_s
        )
        if state is None or not len(t) or not state.known.all():
            return None
        if _hidden_within(watched, Span(request.t_s, until_s)):
            return None
        off = np.flatnonzero(~state.on)
        # Category 2 is a power that never goes off: the log has to last long enough to say so.
        if not len(off) and t[-1] < until_s - self.max_gap_s:
            return None
        return stop_category(float(t[off[0]]) if len(off) else None, reached)


def _hidden_within(watched: Watched, course: Span) -> list[Span]:
    """Where the log has the flag of the drives, and does not show it."""
    return [one for spans in watched.unknown.values() for one in spans if one.overlaps(course)]


def _words(stop: Event) -> str:
    return stop.kind.replace("_", " ")


def events_about(watched: Watched, kinds: Sequence[str]) -> list[Event]:
    """The events of some kinds that concern a machine, in order of time."""
    found = [event for kind in kinds for event in watched.trial.events_of(kind)]
    return sorted(event for event in found if event.subject in ("", watched.subject.name))


def nothing_happened(watched: Watched, kinds: Sequence[str], clause: str) -> Finding:
    """The finding when there was none of some events: not applicable, if the log would have had them."""
    subject, trial = watched.subject.name, watched.trial
    words = " and no ".join(kind.replace("_", " ") for kind in kinds)
    if set(kinds) <= trial.witnessed:
        return Finding.not_applicable(subject, f"the log records no {words}", clause=clause)
    message = f"the log does not show whether there was any {words.replace(' and no ', ' or ')}"
    return Finding.inconclusive(subject, message, span=trial.window, clause=clause)


# Starting again -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Latched:
    """What follows one stop.

    Attributes:
        stop: The event.
        reset_s: When it was reset, s; infinite when never.
        end_s: When the machine may move again, or is stopped again, s; infinite when never.
        rests_s: From when on it has to rest, s.
    """

    stop: Event
    reset_s: float
    end_s: float
    rests_s: float

    def rests(self, t: FloatArray) -> slice:
        """At which of some times the machine has to rest."""
        return slice(int(t.searchsorted(self.rests_s)), int(t.searchsorted(self.end_s)))


@dataclass(frozen=True)
class EstopRestart(LimitMonitor):
    """After an emergency stop nothing moves before reset and a separate start.

    Measures:
        For every machine, from the time it has to come to rest after `emergency_stop`
        (or whatever `after` names) until `start` (after `emergency_stop_reset`): its
        speed, and the way it covers.
    Violated when:
        It moves faster than standstill: in LATCHED, before the reset, or in READY,
        after the reset and before a start. Reset alone must not start motion. Every
        violation is a critical event. A log that does not record resets or starts
        leaves it open.
    Source:
        ISO 13850; IEC 60204-1; for trucks ISO 3691-4, 4.1.14. The time for coming to
        rest is our choice.
    """

    may_be_critical: ClassVar[bool] = True

    kind: Literal["robot", "agv"] = parameter("robot", source="which machines")
    after: tuple[str, ...] = parameter(
        (EMERGENCY_STOP,),
        source="events that latch; for trucks ISO 3691-4 adds bumper contact and power interruption",
    )
    stop_within_s: float = parameter(1.0, source="STOPPING: until rest at the latest; our choice", **TIME)
    hold_s: float = parameter(0.1, source="at rest for this long is LATCHED; catalogue, M8", **TIME)
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7", **SPEED)
    max_gap_s: float = parameter(0.05, **GAP)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    what, unit = "speed after a stop", "m/s"
    clause = "derived from ISO 13850, resetting the emergency stop"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.after or not all(self.after):
            raise ValueError("after names no event: give the kinds that latch, such as emergency_stop")

    @property
    def measures(self) -> Mapping[str, Measure]:
        """How it moved although it had to rest."""
        return {
            "time_in_violation_s": Measure("s", best=0.0, meaning="how long it moved"),
            "speed_max_m_s": Measure("m/s", best=0.0, meaning="how fast"),
            "travel_m": Measure("m", best=0.0, meaning="how far"),
            "before_start_s": Measure("s", best=0.0, meaning="how long before it was started"),
        }

    @property
    def subjects(self) -> Subjects:
        """The machines."""
        return bodies(self.kind)

    @property
    def wanted(self) -> dict[str, str]:
        """The speed."""
        return {self._speed: "m/s"}

    @property
    def only_after(self) -> tuple[str, ...]:
        """What latches."""
        return self.after

    def courses(self, signals: Watched) -> list[Span]:
        """Each stop, until the next one or the next start."""
        window = signals.trial.window
        ends_s = signals.end_s if window is None else window.end_s
        stops = events_about(signals, self.after)
        following_s = [*(stop.t_s for stop in stops[1:]), np.inf]
        latches = (self._latched(signals, stop, s) for stop, s in zip(stops, following_s, strict=False))
        return [Span(one.stop.t_s, max(one.stop.t_s, min(one.end_s, ends_s))) for one in latches]

    @property
    def may_hide(self) -> tuple[dict[str, float], ...]:
        """The rest that latches it, or a movement that was before it."""
        return {self._speed: 0.0}, {self._speed: 2.0 * self.standstill_speed_m_s + 1.0}

    @property
    def reach(self) -> Reach:
        """Rest is due from the stop on; whether it is reached shows only after `hold_s`."""
        return Reach("start", ahead_s=self.hold_s)

    @property
    def _speed(self) -> str:
        return f"speed/{{{self.kind}}}"

    def about(self, signals: Watched) -> Iterator[Statement]:
        """Each emergency stop, or that there was none."""
        stops = events_about(signals, self.after)
        if not stops:
            yield nothing_happened(signals, self.after, self.clause)
            return
        latches = []
        for number, stop in enumerate(stops):
            following = stops[number + 1].t_s if number + 1 < len(stops) else np.inf
            latches.append(self._latched(signals, stop, following))

        rests = np.zeros(len(signals), dtype=bool)
        for latch in latches:
            rests[latch.rests(signals.t)] = True
        bound = self.at_most(signals[self._speed], self.standstill_speed_m_s, where=rests)
        yield JudgedLimit(signals, bound)
        for latch in latches:
            yield from self._after(signals, latch)

    def _latched(self, watched: Watched, stop: Event, following_s: float) -> _Latched:
        resets = [e.t_s for e in events_about(watched, (RESET,)) if e.t_s >= stop.t_s]
        reset_s = resets[0] if resets else np.inf
        starts = [e.t_s for e in events_about(watched, (START,)) if e.t_s >= reset_s]
        end_s = min(starts[0] if starts else np.inf, following_s)
        rest = standstill_reached_s(
            watched.t,
            watched[self._speed],
            stop.t_s,
            standstill_m_s=self.standstill_speed_m_s,
            hold_s=self.hold_s,
        )
        latched_s = (
            stop.t_s + self.stop_within_s if rest is None else min(rest, stop.t_s + self.stop_within_s)
        )
        return _Latched(stop, reset_s, end_s, latched_s - TOLERANCE_S)

    def _movements(self, watched: Watched, latch: _Latched) -> list[tuple[Span, Rows]]:
        """Where the machine moves although it has to rest."""
        moving, rests = np.zeros(len(watched), dtype=bool), latch.rests(watched.t)
        moving[rests] = watched[self._speed][rests] > self.standstill_speed_m_s
        return rows_of_episodes(watched, moving, t_off_s=self.t_off_s)

    def _after(self, watched: Watched, latch: _Latched) -> Iterator[Finding]:
        subject, trial = watched.subject.name, watched.trial
        stop, reset_s, end_s = latch.stop, latch.reset_s, latch.end_s
        speed, movements = watched[self._speed], self._movements(watched, latch)
        # Without these events in the log, a start that was given looks like one that was not.
        unrecorded = [
            kind
            for kind in (RESET, START)
            if kind not in trial.witnessed and not events_about(watched, (kind,))
        ]
        if movements and unrecorded:
            first, _ = movements[0]
            message = (
                f"moved at {first.start_s:.3f} s after the {_words(stop)} at {stop.t_s:.3f} s, "
                f"but the log does not show whether there was any {unrecorded[0].replace('_', ' ')}"
            )
            yield Finding.inconclusive(subject, message, span=first, clause=self.clause)
            return
        for span, rows in movements:
            worst = int(rows[np.argmax(speed[rows])])
            phase = "LATCHED" if span.start_s < reset_s else "READY"
            quantities = {
                "time_in_violation_s": exact_sum(watched.durations_s[rows]),
                "speed_max_m_s": float(speed[worst]),
                "travel_m": travelled_m(watched.t, speed, Span(span.start_s, min(span.end_s, end_s))),
            }
            if np.isfinite(end_s):
                quantities["before_start_s"] = float(end_s - span.start_s)
            yield Finding(
                subject,
                Verdict.VIOLATED,
                f"moved at {span.start_s:.3f} s in {phase}, after the {_words(stop)} at {stop.t_s:.3f} s",
                span=span,
                robustness=float(self.standstill_speed_m_s - speed[worst]),
                unit="m/s",
                quantities=quantities,
                labels={"state": phase},
                evidence=watched.samples(worst),
                clause=self.clause,
                critical=True,
            )
        rests = latch.rests(watched.t)
        if rests.start >= rests.stop and end_s > watched.end_s:
            message = f"{_words(stop)} at {stop.t_s:.3f} s: the log does not show whether it came to rest"
            ends_s = watched.end_s if trial.window is None else trial.window.end_s
            span = Span(stop.t_s, max(stop.t_s, ends_s))
            yield Finding.inconclusive(subject, message, span=span, clause=self.clause)
            return
        unseen = [gap for gap in watched.gaps if gap.end_s > stop.t_s and gap.start_s < end_s]
        if not movements and not unseen:
            yield Finding(
                subject,
                Verdict.SATISFIED,
                f"at rest from the {_words(stop)} at {stop.t_s:.3f} s until the next start",
                quantities=dict.fromkeys(
                    ("time_in_violation_s", "speed_max_m_s", "travel_m", "before_start_s"), 0.0
                ),
                clause=self.clause,
            )
