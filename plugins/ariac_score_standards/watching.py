"""Where every monitor starts: whom it watches, on which signals, and what the log leaves open.

A monitor names the signals it wants as templates (`speed/{robot}`) and hands over a
function that judges one subject. `watch_pairs` asks it about every robot and human,
`watch_bodies` about every body of a kind, `watch_subjects` about any list. Signals
come on one time base, cut to the competition, window by window (`Watching`); what is
missing, and every gap longer than the monitor accepts, is said before the judging starts
and is never satisfied. A judge that needs all samples at once asks for `whole`.
Flags and modes, which stay as they are until they change, come from `state_over`.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from ariac_score import (
    Finding,
    MissingSignalError,
    Sample,
    Signal,
    Span,
    TimeBase,
    Trial,
    gaps_between,
    sample_durations,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

FloatArray: TypeAlias = "NDArray[np.float64]"
BoolArray: TypeAlias = "NDArray[np.bool_]"

ENVIRONMENT = "environment"
"""Stands in a signal's name for everything that is no body."""


@dataclass(frozen=True)
class Watched:
    """Signals of one subject on one time base, cut to the competition: all of it, or a window of time.

    Attributes:
        t: Sample times, shape (n,), s.
        columns: Values by signal name, each shape (n,) or (n, k).
        gaps: Stretches of the competition without samples.
        max_gap_s: A sample stands for no longer than this, s.
        units: Unit by signal name.
        names: Signal name by template.
        extra: Values of the optional signals the log has, by template; NaN where it has none.
        until_s: Time of the sample after the last one of these; `None`: there is none.
        previous: The window before this one; `None`: there is none.
        following: The window after this one; `None`: there is none.
        number: Which of the windows of its subject this is.
    """

    t: FloatArray
    columns: Mapping[str, FloatArray]
    gaps: Sequence[Span]
    max_gap_s: float
    units: Mapping[str, str]
    names: Mapping[str, str] = field(default_factory=dict)
    extra: Mapping[str, FloatArray] = field(default_factory=dict)
    until_s: float | None = None
    previous: Watched | None = None
    following: Watched | None = None
    number: int = 0

    def __getitem__(self, template: str) -> FloatArray:
        return self.columns[self.names[template]]

    @cached_property
    def durations_s(self) -> FloatArray:
        """How long each sample stands for, shape (n,), s."""
        if self.until_s is None:
            return sample_durations(self.t, longest_s=self.max_gap_s)
        return sample_durations(np.append(self.t, self.until_s), longest_s=self.max_gap_s)[:-1]

    def samples(self, row: int) -> tuple[Sample, ...]:
        """What was measured in one row, as evidence."""
        return tuple(
            Sample(name, float(self.t[row]), _plain(column[row]), self.units[name])
            for name, column in self.columns.items()
        )


class Watching:
    """Signals of one subject, watched window by window, as often as they are gone through.

    Args:
        signals: What is watched.
        max_gap_s: A sample stands for no longer than this, s.
        window: The competition; `None`: all samples count.
        names: Signal name by template.
        helpful: Optional signals by template.

    Attributes:
        gaps: Stretches of the competition without samples.
        max_gap_s: As given.
        names: As given.
    """

    def __init__(
        self,
        signals: Sequence[Signal],
        max_gap_s: float,
        window: Span | None,
        names: Mapping[str, str],
        helpful: Mapping[str, Signal],
    ) -> None:
        self.max_gap_s, self.names = max_gap_s, names
        self._base = TimeBase(signals, max_gap_s=max_gap_s)
        self._window, self._helpful = window, helpful
        self._units = {signal.name: signal.unit for signal in signals}
        self._numbers = {signal.name: number for number, signal in enumerate(signals)}
        self._known: list[int] = []
        self._begins_s: list[float] = []
        self._rows, self._end_s = [0], math.nan
        self._near: dict[int, Watched] = {}
        self._last: Watched | None = None
        times = self._counted()
        self.gaps: Sequence[Span] = []
        if window is not None:
            self.gaps = gaps_between(times, window, max_gap_s=max_gap_s)
        for _ in times:  # so that all are counted
            pass

    def _counted(self) -> Iterator[FloatArray]:
        for k in range(len(self._base)):
            t = self._times(k)
            if len(t):
                self._known.append(k)
                self._begins_s.append(float(t[0]))
                self._rows.append(self._rows[-1] + len(t))
                self._end_s = float(t[-1])
            yield t

    def __len__(self) -> int:
        return self._rows[-1]

    def has(self, template: str) -> bool:
        """Whether the log has an optional signal."""
        return template in self._helpful

    @property
    def span(self) -> Span:
        """From the first to the last sample; there has to be one."""
        return Span(self._begins_s[0], self.end_s)

    @property
    def end_s(self) -> float:
        """Time of the last sample; there has to be one."""
        return self._end_s

    def __iter__(self) -> Iterator[Watched]:
        return self._windows(0, len(self._known))

    def between(self, start_s: float, end_s: float = math.inf) -> Iterator[Watched]:
        """The windows from that of the last sample up to a time to that of the last one up to another."""
        first = max(bisect_right(self._begins_s, start_s) - 1, 0)
        return self._windows(first, bisect_right(self._begins_s, end_s))

    def rows_before(self, t_s: float) -> int:
        """How many samples there are before a time."""
        number = bisect_right(self._begins_s, t_s) - 1
        if number < 0:
            return 0
        return self._rows[number] + int(self._watched(number).t.searchsorted(t_s))

    def _windows(self, first: int, last: int) -> Iterator[Watched]:
        """From one window to before another, by their numbers."""
        return (self._linked(number) for number in range(first, last))

    def _linked(self, number: int) -> Watched:
        """A window that knows those beside it; the last one stays, for it is often asked for again."""
        if self._last is None or self._last.number != number:
            previous = self._watched(number - 1) if number else None
            window = self._watched(number)
            following = self._watched(number + 1) if number + 1 < len(self._known) else None
            until_s = None if following is None else float(following.t[0])
            self._last = replace(window, until_s=until_s, previous=previous, following=following)
        return self._last

    def whole(self) -> Watched:
        """All windows in one."""
        leader, window = self._base.leader, self._window
        if leader is not None and not self._helpful:
            first = 0 if window is None else leader.row(window.start_s)
            last = len(leader) if window is None else leader.row(float(np.nextafter(window.end_s, np.inf)))
            columns = {signal.name: signal.stretch(first, last)[1] for signal in self._base.signals}
            t = leader.times(first, last)
            return Watched(t, columns, self.gaps, self.max_gap_s, self._units, self.names)
        windows = list(self)
        if len(windows) == 1:
            return windows[0]

        def joined(of: Callable[[Watched], Mapping[str, FloatArray]], name: str) -> FloatArray:
            return np.concatenate([of(window)[name] for window in windows])

        return Watched(
            np.concatenate([window.t for window in windows]),
            {name: joined(lambda w: w.columns, name) for name in self._numbers},
            self.gaps,
            self.max_gap_s,
            self._units,
            self.names,
            {template: joined(lambda w: w.extra, template) for template in self._helpful},
        )

    def _inside(self, t: FloatArray) -> slice:
        if self._window is None:
            return slice(0, len(t))
        return slice(
            int(t.searchsorted(self._window.start_s)), int(t.searchsorted(self._window.end_s, side="right"))
        )

    def _times(self, k: int) -> FloatArray:
        t = self._base.times(k)
        return t[self._inside(t)]

    def _watched(self, number: int) -> Watched:
        """A window, which stays while it or one beside it is looked at."""
        if number in self._near:
            return self._near[number]
        base, k = self._base, self._known[number]
        inside = self._inside(base.times(k))
        numbers, helpful = self._numbers, self._helpful
        columns = _Columns(numbers, lambda name: base.values(numbers[name], k)[inside])
        extra = _Columns(helpful, lambda template: base.beyond(k, helpful[template])[inside])
        window = Watched(
            base.times(k)[inside],
            columns,
            self.gaps,
            self.max_gap_s,
            self._units,
            self.names,
            extra,
            number=number,
        )
        self._near = {other: near for other, near in self._near.items() if abs(other - number) <= 1}
        self._near[number] = window
        return window


class _Columns(Mapping[str, FloatArray]):
    """Columns that are had when they are looked at."""

    def __init__(self, names: Iterable[str], column: Callable[[str], FloatArray]) -> None:
        self._names, self._column = dict.fromkeys(names), column
        self._known: dict[str, FloatArray] = {}

    def __getitem__(self, name: str) -> FloatArray:
        if name not in self._names:
            raise KeyError(name)
        if name not in self._known:
            self._known[name] = self._column(name)
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


def _plain(value: FloatArray) -> float | tuple[float, ...]:
    return float(value) if np.ndim(value) == 0 else tuple(float(v) for v in value)


@dataclass(frozen=True)
class Subject:
    """Whom a monitor is asked about.

    Attributes:
        name: Subject of the findings, such as `gantry/person_1`.
        bodies: What to fill into the templates: body id by placeholder.
    """

    name: str
    bodies: Mapping[str, str]

    def fill(self, template: str) -> str:
        """The signal name that a template stands for."""
        return template.format(**self.bodies)


Yielded = TypeVar("Yielded")
"""What a judge yields: findings, and whatever its monitor makes of the rest."""


def watch_pairs(
    trial: Trial,
    wanted: Mapping[str, str],
    *,
    max_gap_s: float,
    clause: str,
    judge: Callable[[str, Watching], Iterator[Yielded]],
    optional: Mapping[str, str] | None = None,
) -> Iterator[Finding | Yielded]:
    """Judge every (robot, human) pair; what cannot be judged is said for each pair.

    Args:
        trial: The trial.
        wanted: Unit by signal name, with `{robot}` and `{human}` to be filled in.
        max_gap_s: Longest stretch without a sample that is accepted, s.
        clause: Clause for the findings about what is missing.
        judge: Findings about one pair, given its subject and its signals.
        optional: Signals that help where the log has them.
    """
    yield from watch_subjects(
        trial,
        pairs_of(trial),
        wanted,
        max_gap_s=max_gap_s,
        clause=clause,
        judge=lambda subject, watched: judge(subject.name, watched),
        optional=optional,
        kinds=("robot", "human"),
    )


def pairs_of(trial: Trial, machine: str = "robot") -> list[Subject]:
    """Every pair of a machine (`robot` or `agv`) and a human."""
    return [
        Subject(f"{a.id}/{h.id}", {machine: a.id, "human": h.id})
        for a in trial.bodies_of(machine)
        for h in trial.bodies_of("human")
    ]


def bodies_of(trial: Trial, kind: str) -> list[Subject]:
    """Every body of a kind."""
    return [Subject(body.id, {kind: body.id}) for body in trial.bodies_of(kind)]


def watch_subjects(
    trial: Trial,
    subjects: Iterable[Subject],
    wanted: Mapping[str, str],
    *,
    max_gap_s: float,
    clause: str,
    judge: Callable[[Subject, Watching], Iterator[Yielded]],
    optional: Mapping[str, str] | None = None,
    kinds: tuple[str, ...] = ("robot",),
) -> Iterator[Finding | Yielded]:
    """Judge every subject; what cannot be judged is said for each.

    Args:
        trial: The trial.
        subjects: Whom to judge.
        wanted: Unit by signal template.
        max_gap_s: Longest stretch without a sample that is accepted, s.
        clause: Clause for the findings about what is missing.
        judge: Findings about one subject.
        optional: Unit by signal template, of signals that help where the log has them.
        kinds: Kinds of bodies that must be there for a subject to exist.
    """
    asked = list(subjects)
    if not asked:
        yield nobody(trial, clause, kinds)
    for subject in asked:
        names = {template: subject.fill(template) for template in wanted}
        try:
            signals = [trial.signal(names[template], unit=unit) for template, unit in wanted.items()]
        except MissingSignalError as missing:
            yield Finding.inconclusive(subject.name, str(missing), span=trial.window, clause=clause)
            continue
        helpful = _present(trial, subject, optional or {})
        watched = Watching(signals, max_gap_s, trial.window, names, helpful)
        if (trial.started_s is None) != (trial.ended_s is None):
            missing_end = "end" if trial.ended_s is None else "start"
            message = (
                f"the log does not show the {missing_end} of the competition, so part of it may be missing"
            )
            yield Finding.inconclusive(subject.name, message, span=trial.window, clause=clause)
        for gap in watched.gaps:
            message = f"no samples for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
            yield Finding.inconclusive(subject.name, message, span=gap, clause=clause)
        if len(watched):
            yield from judge(subject, watched)


def seen(
    trial: Trial,
    subjects: Iterable[Subject],
    wanted: Mapping[str, str],
    *,
    max_gap_s: float,
    optional: Mapping[str, str] | None = None,
) -> Iterator[tuple[Subject, Watching]]:
    """Every subject whose signals the log has, with what can be judged of it, to be drawn."""
    for subject in subjects:
        names = {template: subject.fill(template) for template in wanted}
        if not trial.signals.keys() >= set(names.values()):
            continue
        signals = [trial.signal(names[template], unit=unit) for template, unit in wanted.items()]
        helpful = _present(trial, subject, optional or {})
        watched = Watching(signals, max_gap_s, trial.window, names, helpful)
        if len(watched):
            yield subject, watched


def nobody(trial: Trial, clause: str, kinds: tuple[str, ...] = ("robot", "human")) -> Finding:
    """The finding when there is no subject to watch."""
    missing = " and no ".join(kind for kind in kinds if not trial.bodies_of(kind))
    if "bodies" in trial.witnessed:
        return Finding.not_applicable(
            "trial", f"the log records every body, and there is no {missing} among them", clause=clause
        )
    return Finding.inconclusive("trial", f"the log shows no {missing}", span=trial.window, clause=clause)


def _present(trial: Trial, subject: Subject, optional: Mapping[str, str]) -> dict[str, Signal]:
    found = {}
    for template, unit in optional.items():
        name = subject.fill(template)
        if name in trial.signals:
            found[template] = trial.signal(name, unit=unit)
    return found


# What stays as it is until it changes -------------------------------------------------------


@dataclass(frozen=True)
class State:
    """Something that is on or off at each of a row of times.

    Attributes:
        on: Whether it is on, shape (n,); off where it is not known.
        known: Whether the log says, shape (n,).
    """

    on: BoolArray
    known: BoolArray


ON, OFF = "on", "off"


def state_over(trial: Trial, name: str, body: str, t: FloatArray, *, max_age_s: float) -> State | None:
    """A flag over time: from the signal `name/body`, else from events of that kind.

    A signal's value holds until its next sample, for `max_age_s` at most. An event
    has the detail `on` or `off` and holds until the next; before the first event the
    state was the other one. An event that says neither leaves it unknown. A log that
    would have recorded such events and holds none shows a flag that was never on.

    Args:
        trial: The trial.
        name: Quantity and event kind, such as `drive_enabled`.
        body: Id of the body; events without a subject concern every body.
        t: Times asked for, shape (n,), s.
        max_age_s: How long a sample of the signal is believed, s.

    Returns:
        The state, or `None` when the log has neither.
    """
    signal = trial.signals.get(f"{name}/{body}")
    if signal is not None and len(signal):
        before = np.searchsorted(signal.t, t + 1e-9, side="right") - 1
        held = before.clip(0)
        known = (before >= 0) & (t - signal.t[held] <= max_age_s + 1e-9)
        return State(known & (signal.values[held] >= 0.5), known)
    events = [e for e in trial.events_of(name) if e.subject in ("", body)]
    if not events and name not in trial.witnessed:
        return None
    if not events:
        return State(np.zeros(len(t), dtype=bool), np.ones(len(t), dtype=bool))
    times = np.array([e.t_s for e in events])
    earlier = OFF if events[0].detail == ON else ON if events[0].detail == OFF else ""
    words = np.array([earlier, *(event.detail for event in events)])
    told = words[np.searchsorted(times, t, side="right")]
    return State(told == ON, (told == ON) | (told == OFF))
