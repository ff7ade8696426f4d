"""Stopping, and not starting again by itself, after IEC 60204-1 and ISO 13850.

Stops are events: `emergency_stop` and `protective_stop`; `emergency_stop_reset` and
`start` end an emergency stop. Their subject is a machine; without one they concern all.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from ariac_score import (
    Episodes,
    Event,
    Finding,
    Sample,
    SignalNeed,
    Span,
    Total,
    Trial,
    Verdict,
    check_parameters,
    parameter,
)
from ariac_score_standards.severity import (
    STANDSTILL_SPEED_M_S,
    Bound,
    Said,
    Sampled,
    Seen,
    ways_m,
)
from ariac_score_standards.watching import (
    BoolArray,
    FloatArray,
    Subject,
    Watched,
    Watching,
    bodies_of,
    state_over,
    watch_subjects,
)

EMERGENCY_STOP = "emergency_stop"
PROTECTIVE_STOP = "protective_stop"
RESET = "emergency_stop_reset"
START = "start"

_TIME: Any = {"unit": "s", "at_least": 0, "at_most": 60}
_GAP: Any = {"unit": "s", "above": 0, "at_most": 60, "source": "catalogue, 1.4"}
_SPEED: Any = {"unit": "m/s", "at_least": 0, "at_most": 20}
_TOLERANCE_S = 1e-9


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
    rest = _Rest(request_s, standstill_m_s, hold_s)
    rest.take(t, speed_m_s)
    return rest.reached_s


class _Rest:
    """`standstill_reached_s`, of samples that come in parts."""

    def __init__(self, request_s: float, standstill_m_s: float, hold_s: float) -> None:
        self._request_s, self._limit, self._hold_s = request_s, standstill_m_s, hold_s
        self._before = np.zeros(0), np.zeros(0)
        self._since_s: float | None = None
        self._until_s = request_s
        self.reached_s: float | None = None

    def take(self, t: FloatArray, speed_m_s: FloatArray) -> bool:
        """Look at the next samples; whether that is enough."""
        before, speed_before = self._before
        carried = len(before)
        if carried:
            t, speed_m_s = np.concatenate([before, t]), np.concatenate([speed_before, speed_m_s])
        first = max(int(t.searchsorted(self._request_s - _TOLERANCE_S)), carried)
        still = speed_m_s[first:] <= self._limit
        changes = first + 1 + np.flatnonzero(still[1:] != still[:-1])
        for begin, end in pairwise([first, *changes.tolist(), len(t)]):
            if begin == end or self.reached_s is not None:
                break
            if not speed_m_s[begin] <= self._limit:
                self._ended(float(t[begin]))
                continue
            if self._since_s is None:
                self._since_s = max(_crossing(t, speed_m_s, begin, self._limit), self._request_s)
            self._until_s = float(t[end - 1])
            self._held(self._until_s)
        self._before = t[-1:], speed_m_s[-1:]
        return self.reached_s is not None

    def _ended(self, following_s: float) -> None:
        """A stretch at rest is over, for at the sample that follows the machine moves."""
        if self._since_s is not None:
            self._held(self._until_s + (following_s - self._until_s))
        if self.reached_s is None:
            self._since_s = None

    def _held(self, until_s: float) -> None:
        """Whether the machine was at rest for long enough until some time: then it stays so."""
        if self._since_s is not None and until_s - self._since_s >= self._hold_s - _TOLERANCE_S:
            self.reached_s = self._since_s


def _rest(
    watched: Watching, speed: str, request_s: float, standstill_m_s: float, hold_s: float
) -> float | None:
    """`standstill_reached_s`, window by window."""
    rest = _Rest(request_s, standstill_m_s, hold_s)
    for window in watched.between(float(np.nextafter(request_s - _TOLERANCE_S, -np.inf))):
        if rest.take(window.t, window[speed]):
            break
    return rest.reached_s


def _crossing(t: FloatArray, speed: FloatArray, first: int, limit: float) -> float:
    """Time at which the speed falls to the limit before its first row at or below it."""
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
class StopPerformance:
    """A machine that is told to stop does, in time and on the way it has.

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
    max_time_s: float = parameter(0.5, source="data of the machine; catalogue, M8", **_TIME)
    max_distance_m: float | None = parameter(
        None, unit="m", at_least=0, at_most=100, source="data of the machine"
    )
    hold_s: float = parameter(0.1, source="catalogue, M8", **_TIME)
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7", **_SPEED)
    power_wait_s: float = parameter(1.0, source="how long after standstill power may go off", **_TIME)
    max_flag_age_s: float = parameter(1.0, unit="s", above=0, at_most=60, source="how long a flag holds")
    max_gap_s: float = parameter(0.05, **_GAP)

    _clause = "derived from IEC 60204-1 and ISO 13850, stop functions"

    def __post_init__(self) -> None:
        check_parameters(self)

    def needs(self) -> Iterator[SignalNeed]:
        """Speed, and whether the drives have power."""
        yield SignalNeed("speed", "m/s", self.max_gap_s)
        yield SignalNeed("drive_enabled", "1", self.max_flag_age_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """For every machine each of its stops, or that none was asked for."""
        return watch_subjects(
            trial,
            bodies_of(trial, self.kind),
            {f"speed/{{{self.kind}}}": "m/s"},
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=lambda subject, watched: self._judge(trial, subject, watched),
            kinds=(self.kind,),
        )

    @property
    def _speed(self) -> str:
        return f"speed/{{{self.kind}}}"

    def _judge(self, trial: Trial, subject: Subject, watched: Watching) -> Iterator[Finding]:
        requests = events_about(trial, subject.name, (EMERGENCY_STOP, PROTECTIVE_STOP))
        for request in requests:
            yield self._stop(trial, subject, watched, request)
        if not requests:
            yield nothing_happened(trial, subject, (EMERGENCY_STOP, PROTECTIVE_STOP), self._clause)

    def _stop(self, trial: Trial, subject: Subject, watched: Watching, request: Event) -> Finding:
        name = request.kind.replace("_", " ")
        reached = _rest(watched, self._speed, request.t_s, self.standstill_speed_m_s, self.hold_s)
        last = watched.end_s
        end = last if reached is None else reached + self.hold_s
        unseen = [gap for gap in watched.gaps if gap.start_s < end and gap.end_s > request.t_s]
        if unseen or last < request.t_s or (reached is None and last < request.t_s + self.max_time_s):
            message = f"{name} at {request.t_s:.3f} s: the log does not show the whole stop"
            return Finding.inconclusive(subject.name, message, span=trial.window, clause=self._clause)
        if reached is None:
            message = f"{name} at {request.t_s:.3f} s: no stop until the log ends at {last:.3f} s"
            return Finding(
                subject.name,
                Verdict.VIOLATED,
                message,
                span=Span(request.t_s, last),
                robustness=request.t_s + self.max_time_s - last,
                unit="s",
                clause=self._clause,
                critical=request.kind == EMERGENCY_STOP,
            )
        return self._stopped(trial, subject, watched, request, reached)

    def _stopped(
        self, trial: Trial, subject: Subject, watched: Watching, request: Event, reached: float
    ) -> Finding:
        time_s = reached - request.t_s
        # What creeps on below standstill while it is being held belongs to the way.
        (way_m,) = ways_m(watched, self._speed, [Span(request.t_s, reached + self.hold_s)])
        category = self._category(trial, subject, watched, request, reached)
        over_time = time_s > self.max_time_s + _TOLERANCE_S
        over_way = self.max_distance_m is not None and way_m > self.max_distance_m
        powered = category == 2 and request.kind == EMERGENCY_STOP
        told = [f"{request.kind.replace('_', ' ')} at {request.t_s:.3f} s: stopped in {time_s:.3f} s"]
        told.append(f"on {way_m:.3f} m")
        if over_time:
            told.append(f"at most {self.max_time_s:g} s")
        if over_way:
            told.append(f"at most {self.max_distance_m:g} m")
        if powered:
            told.append("the drives kept their power (category 2)")
        return Finding(
            subject.name,
            Verdict.VIOLATED if over_time or over_way or powered else Verdict.SATISFIED,
            ", ".join(told),
            span=Span(request.t_s, reached),
            robustness=self.max_time_s - time_s,
            unit="s",
            quantities={
                "stop_time_s": time_s,
                "stop_distance_m": way_m,
                "excess_s": max(time_s - self.max_time_s, 0.0),
            },
            labels={"category": "unknown" if category is None else str(category), "request": request.kind},
            clause=self._clause,
        )

    def _category(
        self, trial: Trial, subject: Subject, watched: Watching, request: Event, reached: float
    ) -> int | None:
        """The category shown by the drives' power; `None` when the log does not tell."""
        until_s = reached + self.power_wait_s
        off_s: float | None = None
        last_s = -np.inf
        for window in watched.between(request.t_s, until_s):
            t = window.t[(window.t >= request.t_s) & (window.t <= until_s)]
            if not len(t):
                continue
            state = state_over(trial, "drive_enabled", subject.name, t, max_age_s=self.max_flag_age_s)
            if state is None or not state.known.all():
                return None
            off = np.flatnonzero(~state.on)
            if off_s is None and len(off):
                off_s = float(t[off[0]])
            last_s = float(t[-1])
        if last_s == -np.inf or (off_s is None and last_s < until_s - self.max_gap_s):
            return None
        return stop_category(off_s, reached)


def _words(stop: Event) -> str:
    return stop.kind.replace("_", " ")


def events_about(trial: Trial, machine: str, kinds: Sequence[str]) -> list[Event]:
    """The events of some kinds that concern a machine, in order of time."""
    found = [e for kind in kinds for e in trial.events_of(kind) if e.subject in ("", machine)]
    return sorted(found)


def nothing_happened(trial: Trial, subject: Subject, kinds: Sequence[str], clause: str) -> Finding:
    """The finding when there was none of some events: not applicable, if the log would have had them."""
    words = " and no ".join(kind.replace("_", " ") for kind in kinds)
    if set(kinds) <= trial.witnessed:
        return Finding.not_applicable(subject.name, f"the log records no {words}", clause=clause)
    message = f"the log does not show whether there was any {words.replace(' and no ', ' or ')}"
    return Finding.inconclusive(subject.name, message, span=trial.window, clause=clause)


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
class EstopRestart(Sampled):
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

    kind: Literal["robot", "agv"] = parameter("robot", source="which machines")
    after: tuple[str, ...] = parameter(
        (EMERGENCY_STOP,),
        source="events that latch; for trucks ISO 3691-4 adds bumper contact and power interruption",
    )
    stop_within_s: float = parameter(1.0, source="STOPPING: until rest at the latest; our choice", **_TIME)
    hold_s: float = parameter(0.1, source="at rest for this long is LATCHED; catalogue, M8", **_TIME)
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7", **_SPEED)
    max_gap_s: float = parameter(0.05, **_GAP)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **_TIME)

    _clause = "derived from ISO 13850, resetting the emergency stop"

    def __post_init__(self) -> None:
        check_parameters(self)
        if not self.after or not all(self.after):
            raise ValueError("after names no event: give the kinds that latch, such as emergency_stop")

    def needs(self) -> Iterator[SignalNeed]:
        """The speed."""
        yield SignalNeed("speed", "m/s", self.max_gap_s)

    def _say(self, trial: Trial) -> Iterator[Said]:
        """For every machine each emergency stop, or that there was none."""
        return watch_subjects(
            trial,
            bodies_of(trial, self.kind),
            {f"speed/{{{self.kind}}}": "m/s"},
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=lambda subject, watched: self._judge(trial, subject, watched),
            kinds=(self.kind,),
        )

    @property
    def _speed(self) -> str:
        return f"speed/{{{self.kind}}}"

    def _judge(self, trial: Trial, subject: Subject, watched: Watching) -> Iterator[Said]:
        stops = events_about(trial, subject.name, self.after)
        if not stops:
            yield nothing_happened(trial, subject, self.after, self._clause)
            return
        latches = []
        for number, stop in enumerate(stops):
            following = stops[number + 1].t_s if number + 1 < len(stops) else np.inf
            latches.append(self._latched(trial, subject, watched, stop, following))

        def bound(window: Watched) -> Bound:
            speed, rests = window[self._speed], np.zeros(len(window.t), dtype=bool)
            for latch in latches:
                rests[latch.rests(window.t)] = True
            limit = np.full_like(speed, self.standstill_speed_m_s)
            return Bound("speed after a stop", speed, limit, "m/s", True, rests)

        yield Seen(subject.name, watched, lambda: bound)
        for latch in latches:
            yield from self._after(trial, subject, watched, latch)

    def _latched(
        self, trial: Trial, subject: Subject, watched: Watching, stop: Event, following_s: float
    ) -> _Latched:
        resets = [e.t_s for e in events_about(trial, subject.name, (RESET,)) if e.t_s >= stop.t_s]
        reset_s = resets[0] if resets else np.inf
        starts = [e.t_s for e in events_about(trial, subject.name, (START,)) if e.t_s >= reset_s]
        end_s = min(starts[0] if starts else np.inf, following_s)
        rest = _rest(watched, self._speed, stop.t_s, self.standstill_speed_m_s, self.hold_s)
        latched_s = (
            stop.t_s + self.stop_within_s if rest is None else min(rest, stop.t_s + self.stop_within_s)
        )
        return _Latched(stop, reset_s, end_s, latched_s - _TOLERANCE_S)

    def _moving(self, window: Watched, latch: _Latched) -> BoolArray:
        """Where the machine moves although it has to rest."""
        moving, rests = np.zeros(len(window.t), dtype=bool), latch.rests(window.t)
        moving[rests] = window[self._speed][rests] > self.standstill_speed_m_s
        return moving

    def _movements(self, watched: Watching, latch: _Latched) -> list[_Movement]:
        """The movements after a stop."""
        episodes = Episodes(t_off_s=self.t_off_s, longest_s=watched.max_gap_s)
        for window in watched.between(latch.rests_s):
            episodes.take(window.t, self._moving(window, latch))
            if window.t[0] >= latch.end_s:
                break
        found = [_Movement(one.span, Total(one.samples), one.last_s) for one in episodes.end()]
        ways = [Span(one.span.start_s, min(one.span.end_s, latch.end_s)) for one in found]
        for one, way_m in zip(found, ways_m(watched, self._speed, ways), strict=True):
            one.way_m = way_m
            for window in watched.between(one.span.start_s, one.last_s):
                one.take(window, self._speed, self._moving(window, latch))
        return found

    def _after(self, trial: Trial, subject: Subject, watched: Watching, latch: _Latched) -> Iterator[Finding]:
        stop, reset_s, end_s = latch.stop, latch.reset_s, latch.end_s
        movements = self._movements(watched, latch)
        silent = [
            kind
            for kind in (RESET, START)
            if kind not in trial.witnessed and not events_about(trial, subject.name, (kind,))
        ]
        if movements and silent:
            first = movements[0].span
            message = (
                f"moved at {first.start_s:.3f} s after the {_words(stop)} at {stop.t_s:.3f} s, "
                f"but the log does not show whether there was any {silent[0].replace('_', ' ')}"
            )
            yield Finding.inconclusive(subject.name, message, span=first, clause=self._clause)
            return
        for movement in movements:
            span = movement.span
            phase = "LATCHED" if span.start_s < reset_s else "READY"
            quantities = {
                "time_in_violation_s": movement.lasts_s.value,
                "speed_max_m_s": movement.fastest_m_s,
                "travel_m": movement.way_m,
            }
            if np.isfinite(end_s):
                quantities["before_start_s"] = float(end_s - span.start_s)
            yield Finding(
                subject.name,
                Verdict.VIOLATED,
                f"moved at {span.start_s:.3f} s in {phase}, after the {_words(stop)} at {stop.t_s:.3f} s",
                span=span,
                robustness=self.standstill_speed_m_s - movement.fastest_m_s,
                unit="m/s",
                quantities=quantities,
                labels={"state": phase},
                evidence=movement.evidence,
                clause=self._clause,
                critical=True,
            )
        unseen = [gap for gap in watched.gaps if gap.end_s > stop.t_s and gap.start_s < end_s]
        if not movements and not unseen:
            yield Finding(
                subject.name,
                Verdict.SATISFIED,
                f"at rest from the {_words(stop)} at {stop.t_s:.3f} s until the next start",
                quantities=dict.fromkeys(
                    ("time_in_violation_s", "speed_max_m_s", "travel_m", "before_start_s"), 0.0
                ),
                clause=self._clause,
            )


@dataclass(eq=False)
class _Movement:
    """A movement after a stop, as its samples come.

    Attributes:
        span: From its first sample to the end of its last one.
        lasts_s: How long it lasts, s.
        last_s: Time of its last sample, s.
        way_m: The way it covers, m.
        fastest_m_s: Its largest speed, m/s.
        evidence: What was measured then.
    """

    span: Span
    lasts_s: Total
    last_s: float
    way_m: float = 0.0
    fastest_m_s: float = -math.inf
    evidence: tuple[Sample, ...] = ()

    def take(self, window: Watched, speed: str, moving: BoolArray) -> None:
        """The next window of it."""
        first = int(window.t.searchsorted(self.span.start_s))
        end = int(window.t.searchsorted(self.span.end_s, side="right"))
        rows = first + np.flatnonzero(moving[first:end])
        if not len(rows):
            return
        self.lasts_s.take(window.durations_s[rows])
        worst = int(rows[np.argmax(window[speed][rows])])
        if window[speed][worst] > self.fastest_m_s:
            self.fastest_m_s, self.evidence = float(window[speed][worst]), window.samples(worst)
