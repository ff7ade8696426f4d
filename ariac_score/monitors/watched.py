"""The signals of one subject on one time base, and what the log leaves open about them.

Signals come as whole columns, cut to the competition (`Watched`); what is missing, and every
gap longer than a monitor accepts, is inconclusive before the judging starts. Flags and modes,
which stay as they are until they change, come from `state_over`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ariac_score.checks.findings import Finding
from ariac_score.errors import MissingSignalError
from ariac_score.monitors.cells import USUAL_INTERVALS, longest_held_s, shown_within_s, usual_interval_s
from ariac_score.monitors.flags import (
    State,
    flag_times,
    found_or_due,
    shown_times,
    stands_s,
    state_over,
    unknown_spans,
)
from ariac_score.monitors.subjects import WHOLE_TRIAL, Subject
from ariac_score.trial.computed import DERIVED
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Sample, Signal, align
from ariac_score.trial.spans import (
    BoolArray,
    FloatArray,
    Span,
    distinct,
    merged,
    sample_durations,
    uncovered_spans,
)

__all__ = [
    "ENVIRONMENT",
    "TOLERANCE_S",
    "Signals",
    "UndecidedError",
    "Watched",
    "first_of_runs",
    "watch_subjects",
    "watched_signals",
]

ENVIRONMENT = "environment"
"""Stands in a signal's name for everything that is no body."""

TOLERANCE_S = 1e-9
"""Times are sums of decimals in float64: 0.1 + 0.2 s after 0 s is 0.3 s, whatever the last bit says."""


class UndecidedError(Exception):
    """Raised by a monitor about a subject of whom the log leaves open what it needs; the text says what."""


class Signals(Protocol):
    """The values of signals by template: columns of a whole trial (`Watched`), or numbers of one instant.

    Arithmetic, comparisons and functions of numpy serve both. A component of a vector is
    `signals["position/{robot}"][..., 2]`, with the dots.
    """

    def __getitem__(self, template: str, /) -> Any: ...


@dataclass(frozen=True, eq=False)
class Watched:
    """Signals of one subject on one time base, cut to the competition.

    Attributes:
        t: Sample times, shape (n,), s.
        columns: Values by signal name, each shape (n,) or (n, k).
        gaps: Stretches of the competition without samples.
        max_gap_s: A sample stands for no longer than this, s.
        units: Unit by signal name.
        names: Signal name by template.
        optional: The optional signals the log has, by template.
        subject: Whose signals they are.
        trial: Where they are from: its bodies and events.
        filled: Which samples stand for what may have been, shape (n,), and were not measured; `None`: none.
        unknown: Where the signal of a flag does not show it, by the name of the signal; no sample lies there.
        optional_gap_s: A sample of an optional signal stands for no longer than this, s.
        turns: When else a verdict may change, in time order, s: at the samples of flags, and of what helps.
    """

    t: FloatArray
    columns: Mapping[str, FloatArray]
    gaps: Sequence[Span]
    max_gap_s: float
    units: Mapping[str, str]
    names: Mapping[str, str] = field(default_factory=dict)
    optional: Mapping[str, Signal] = field(default_factory=dict)
    subject: Subject = WHOLE_TRIAL
    trial: Trial = field(default_factory=lambda: Trial(""))
    filled: BoolArray | None = None
    unknown: Mapping[str, Sequence[Span]] = field(default_factory=dict)
    optional_gap_s: float = math.inf
    turns: FloatArray = field(default_factory=lambda: np.empty(0))
    _computed: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False)

    def __getitem__(self, template: str) -> FloatArray:
        if template not in self.names:
            wanted = ", ".join(map(repr, self.names))
            raise LookupError(f"signal {template!r} is read, but it is not among those wanted: {wanted}")
        return self.columns[self.names[template]]

    def get(self, template: str) -> FloatArray | None:
        """The values of a wanted signal, or of an optional one, NaN in its gaps; `None`: the log has none."""
        if template in self.names:
            return self[template]
        if template not in self.optional:
            return None
        # On first access only: signals that show who is to blame can cost more than the verdict, and
        # most subjects have no violation that would need them.
        if template not in self._computed:
            signal = self.optional[template]
            self._computed[template] = _values_over(signal, self.t, self._shown_within_s(signal))
        return self._computed[template]

    def with_held(self, worse: Mapping[str, np.ufunc]) -> Watched:
        """The same, whose optional signals count in what was not measured as at their last sample, if worse.

        For a sample of what is wanted may lack there, at which they would have counted until the next one.

        Args:
            worse: `numpy.minimum` or `numpy.maximum` by template, of signals of one component.
        """
        for template, choose in worse.items():
            values, signal = self.get(template), self.optional[template]
            if values is not None and self.filled is not None and len(signal):
                last = signal.values[np.maximum(signal.t.searchsorted(self.t, side="right") - 1, 0)]
                self._computed[template] = np.where(self.filled, choose(values, last), values)
        return self

    def known(self, template: str) -> FloatArray:
        """The values of a signal, NaN where the log does not show them; of one it lacks everywhere."""
        values = self.get(template)
        return np.full(len(self), np.nan) if values is None else values

    def measured(self, template: str, t: FloatArray, hidden: Sequence[Span]) -> BoolArray:
        """At which of some times a wanted signal was measured, not between its samples, shape (n,).

        Args:
            template: Of the signal.
            t: The times, shape (n,), s.
            hidden: Where nothing shows it: what follows from other signals is not measured there, whatever
                follows from those on both sides.
        """
        signal = self.trial.signals.get(self.names[template])
        if signal is None:
            return np.zeros(len(t), dtype=bool)
        found = np.isin(t, signal.t)
        if signal.source == DERIVED:
            for span in hidden:
                found &= (t < span.start_s) | (t > span.end_s)
        return found

    def state(self, flag: str, max_age_s: float) -> State | None:
        """A flag of the subject over time; `None` when the log has none. See `state_over`."""
        return state_over(self.trial, flag, self.subject.name, self.t, max_age_s=max_age_s)

    def flag(self, flag: str, max_age_s: float) -> BoolArray:
        """Where a flag of the subject is on, shape (n,).

        Args:
            flag: Quantity and event kind, such as `enabling_device`.
            max_age_s: How long a sample holds at most, s.

        Raises:
            UndecidedError: It is not known at every sample.
        """
        state = self.state(flag, max_age_s)
        if state is None:
            raise UndecidedError(
                f"the log has neither a signal '{flag}/{self.subject.name}' nor {flag!r} events"
            )
        if not state.known.all():
            raise UndecidedError(f"{flag!r} is not known at {self.t[np.argmin(state.known)]:.3f} s")
        return state.on

    def radius_m(self, place: str) -> float:
        """The radius of the subject's body at a placeholder of the templates, m.

        Raises:
            UndecidedError: The log does not say.
        """
        (body,) = (body for body in self.trial.bodies if body.id == self.subject.bodies[place])
        if body.radius_m is None:
            raise UndecidedError(f"the log does not say how large {body.id!r} is (radius_m)")
        return body.radius_m

    def hidden_by_gaps(self, template: str, due: BoolArray, within: Span | None = None) -> list[Span]:
        """The gaps of an optional signal in which a value is due; none where the log has no such signal.

        Args:
            template: Of the signal.
            due: Where a limit applies to it, shape (n,).
            within: The time it has to cover; `None`, or of a signal whose rate is stated: all.
        """
        signal, values = self.optional.get(template), self.get(template)
        if signal is None or values is None or not len(self):
            return []
        unknown = self.t[due & np.isnan(values.reshape(len(self), -1)).any(axis=1)]
        whole, longest_s = self._whole, self._shown_within_s(signal)
        if within and not signal.stated_rate_hz:
            gaps = signal.gaps(within, max_gap_s=longest_s)
        else:
            gaps = merged([*self._holes(signal, whole, longest_s), *self._edges(signal, whole)])
        return [gap for gap in gaps if ((unknown >= gap.start_s) & (unknown <= gap.end_s)).any()]

    @property
    def _whole(self) -> Span:
        """From the first to the last sample of what is wanted, whether a flag is known then or not."""
        window = self.trial.window
        signals = [self.trial.signals.get(name) for name in self.names.values()]
        spans = [one.span for one in signals if one is not None and one.span and not one.constant]
        if window is None or not spans:
            return Span(float(self.t[0]), self.end_s)
        first_s = max([window.start_s, *(one.start_s for one in spans)])
        last_s = min([window.end_s, *(one.end_s for one in spans)])
        return Span(min(first_s, float(self.t[0])), max(last_s, self.end_s))

    def lacks(self, template: str, due: BoolArray) -> BoolArray:
        """At which samples a gap hides an optional signal, shape (n,); see `hidden_by_gaps`."""
        unknown = np.isnan(self.known(template).reshape(len(self), -1)).any(axis=1)
        inside = [
            (self.t >= gap.start_s) & (self.t <= gap.end_s) for gap in self.hidden_by_gaps(template, due)
        ]
        lacking: BoolArray = unknown & np.any([np.zeros(len(self), dtype=bool), *inside], axis=0)
        return lacking

    def _holes(self, signal: Signal, whole: Span, longest_s: float) -> list[Span]:
        """Where it lacks samples within a stretch; an interval that this cuts is as long as it is."""
        if not len(signal):
            return [whole]
        reaching = Span(min(whole.start_s, float(signal.t[0])), max(whole.end_s, float(signal.t[-1])))
        return [
            Span(max(gap.start_s, whole.start_s), min(gap.end_s, whole.end_s))
            for gap in signal.gaps(reaching, max_gap_s=longest_s)
            if gap.overlaps(whole)
        ]

    def _edges(self, signal: Signal, whole: Span) -> list[Span]:
        """Where it begins or ends a whole interval of its own later or earlier: there a sample lacks."""
        if not len(signal) or signal.constant:
            return []
        usual_s = usual_interval_s(signal) - TOLERANCE_S
        begins_s, ends_s = float(signal.t[0]), float(signal.t[-1])
        window = self.trial.window or whole
        found = []
        if whole.start_s < begins_s and begins_s - window.start_s >= usual_s:
            found.append(Span(whole.start_s, begins_s))
        if whole.end_s > ends_s and window.end_s - ends_s >= usual_s:
            found.append(Span(ends_s, whole.end_s))
        return found

    def _shown_within_s(self, signal: Signal) -> float:
        """How far apart its samples may be; what was filled for a world has a value in every cell."""
        if self.filled is not None and np.array_equal(signal.t, self.t):
            return self.max_gap_s
        between = self.trial.between
        every = between is not None and between.every
        return 0.0 if every else shown_within_s(signal, self.optional_gap_s)

    @cached_property
    def usual_s(self) -> float:
        """The usual interval of that of its signals which comes least often, s; infinite of one sample."""
        signals = (self.trial.signals.get(name) for name in self.names.values())
        return max((usual_interval_s(one) for one in signals if one is not None), default=math.inf)

    @property
    def shown_before(self) -> BoolArray:
        """Whether no sample lacks just before each one, shape (n,); where nobody asks for worlds none."""
        shown = np.ones(len(self), dtype=bool)
        if self.trial.between is not None:
            shown[1:] = np.diff(self.t) <= USUAL_INTERVALS * self.usual_s + TOLERANCE_S
        return shown

    def hidden_findings(self, template: str, due: BoolArray, clause: str) -> list[Finding]:
        """What the gaps of an optional signal leave open, as findings."""
        of = f" of {self.optional[template].name!r}" if template in self.optional else ""
        return [self._gap(gap, clause, of) for gap in self.hidden_by_gaps(template, due)]

    def gap_findings(self, clause: str, said: Mapping[Span, str] | None = None) -> list[Finding]:
        """What the gaps leave open, as findings.

        Args:
            clause: Where the standard asks for it.
            said: What can have been in each gap, where that is known; then the others leave nothing open.
        """
        if said is None:
            return [self._gap(gap, clause) for gap in self.gaps]
        return [self._gap(gap, clause, said=said[gap]) for gap in self.gaps if gap in said]

    def _gap(self, gap: Span, clause: str, of: str = "", *, said: str = "") -> Finding:
        what = f"no samples{of}" if of else self._lack
        message = f"{what} for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
        message += f"; {said}" if said else ""
        return Finding.inconclusive(self.subject.name, message, span=gap, clause=clause)

    @property
    def _lack(self) -> str:
        """What its gaps lack: in one of what follows from several signals some of them may have a sample."""
        signals = [self.trial.signals.get(name) for name in self.names.values()]
        follows = any(one is not None and one.source == DERIVED for one in signals)
        return "too few samples" if follows else "no samples"

    def __len__(self) -> int:
        return len(self.t)

    @cached_property
    def durations_s(self) -> FloatArray:
        """How long each sample stands for, shape (n,), s."""
        return sample_durations(self.t, longest_s=self.max_gap_s)

    @property
    def end_s(self) -> float:
        """Time of the last sample; there has to be one."""
        return float(self.t[-1])

    def where_known(self, flags: Iterable[str], max_age_s: float) -> Watched:
        """Without the samples at which the log has a flag, and does not show whether it is on.

        Args:
            flags: Of the subject, by quantity.
            max_age_s: How long a sample of one holds at most, s.
        """
        window, unknown, known = self.trial.window, {}, np.ones(len(self), dtype=bool)
        for flag in flags:
            signal = found_or_due(self.trial, f"{flag}/{self.subject.name}")
            if signal is None or window is None:
                continue
            spans = unknown_spans(signal, window, stands_s(self.trial, signal, max_age_s))
            state = self.state(flag, max_age_s)
            if spans and state is not None:
                unknown[signal.name] = spans
                known &= state.known
        if not unknown:
            return self
        columns = {name: column[known] for name, column in self.columns.items()}
        gaps = merged([*self.gaps, *(span for spans in unknown.values() for span in spans)])
        return replace(self, t=self.t[known], columns=columns, gaps=gaps, unknown=unknown)

    def within(self, trial: Trial) -> Watched:
        """The same signals in the competition of another trial that has them."""
        signals = [trial.signals[name] for name in self.names.values()]
        return watched_signals(
            signals,
            self.max_gap_s,
            trial,
            self.subject,
            names=self.names,
            optional=self.optional,
            turns=self.turns,
        )

    def samples(self, row: int) -> tuple[Sample, ...]:
        """What was measured in one row, as evidence; nothing where it was not."""
        if self.filled is not None and self.filled[row]:
            return ()
        return tuple(
            Sample(name, float(self.t[row]), _plain(column[row]), self.units[name])
            for name, column in self.columns.items()
        )


def _values_over(signal: Signal, t: FloatArray, max_gap_s: float) -> FloatArray:
    """The values of a signal at some times; NaN where it has none."""
    if not len(signal):
        return np.full((len(t), *signal.values.shape[1:]), np.nan)
    values = np.array(signal.at(t), dtype=np.float64)
    values[~signal.covers(t, max_gap_s=max_gap_s)] = np.nan
    return values


def _plain(value: FloatArray) -> float | tuple[float, ...]:
    return float(value) if np.ndim(value) == 0 else tuple(float(v) for v in value)


def watched_signals(
    signals: Sequence[Signal],
    max_gap_s: float,
    trial: Trial,
    subject: Subject = WHOLE_TRIAL,
    *,
    names: Mapping[str, str] | None = None,
    optional: Mapping[str, Signal] | None = None,
    turns: FloatArray | None = None,
) -> Watched:
    """Signals as they are watched.

    Args:
        signals: At least one.
        max_gap_s: A sample stands for no longer than this, s.
        trial: Whose window is the competition; without one all samples count, and there are no gaps.
        subject: Whose signals they are.
        names: Signal name by template.
        optional: Further signals by template.
        optional_gap_s: A sample of an optional signal stands for no longer than this, s.
        turns: When else a verdict may change, in time order, s; where a sample stands it is judged then, too.
    """
    turns = np.empty(0) if turns is None else turns
    t, columns = align(signals, max_gap_s=max_gap_s)
    bounded = trial.between is not None and trial.between.every  # then no sample stands for more than itself
    if len(t) and not bounded and len(between := _between(turns, signals, max_gap_s)):
        t = distinct(np.concatenate([t, between]))
        columns = [signal.at(t) for signal in signals]
    inside, window = slice(None), trial.window
    gaps: list[Span] = []
    if window is not None:
        inside = slice(int(t.searchsorted(window.start_s)), int(t.searchsorted(window.end_s, side="right")))
        # Only samples inside count: one after the end of the competition covers nothing before it.
        if not all(signal.constant for signal in signals):
            holes = [hole for signal in signals for hole in signal.holes]
            gaps = uncovered_spans(t[inside], window, max_gap_s=max_gap_s, holes=holes)
    return Watched(
        t[inside],
        {signal.name: column[inside] for signal, column in zip(signals, columns, strict=True)},
        gaps,
        max_gap_s,
        {signal.name: signal.unit for signal in signals},
        names or {},
        optional or {},
        subject,
        trial,
        optional_gap_s=max_gap_s,
        turns=turns,
    )


def _between(turns: FloatArray, signals: Sequence[Signal], max_gap_s: float) -> FloatArray:
    """Which of some moments lie where samples stand for the time between them, s.

    Without them what is on for a moment would count as long as its sample happens to stand, or not at all,
    and whoever leaves out samples would choose which.
    """
    for one in signals:
        if len(turns) and not one.constant:
            longest_s = longest_held_s(usual_interval_s(one), max_gap_s)
            turns = turns[one.covers(turns, max_gap_s=longest_s)]
    return turns


Yielded = TypeVar("Yielded")
"""What a judge yields: findings, or what its monitor turns into findings."""


class UnseenJudge(Protocol[Yielded]):
    """What a monitor states of the time without samples."""

    def nothing(self, trial: Trial, subject: Subject, why: str, /) -> Iterator[Yielded]:
        """What is open about a subject of whom a signal is missing."""

    def about(
        self, watched: Watched, judge: Callable[[Watched], Iterable[Yielded]], why: str, /
    ) -> Iterator[Finding | Yielded]:
        """Everything about a subject; `why` says what leaves all of the competition open, if not empty."""


def watch_subjects(
    trial: Trial,
    subjects: Iterable[Subject],
    wanted: Mapping[str, str],
    *,
    max_gap_s: float,
    clause: str,
    judge: Callable[[Watched], Iterable[Yielded]],
    optional: Mapping[str, str] | None = None,
    turning: Iterable[str] = (),
    unseen: UnseenJudge[Yielded] | None = None,
) -> Iterator[Finding | Yielded]:
    """Judge every subject; what cannot be judged is inconclusive.

    Args:
        trial: The trial.
        subjects: Whom to judge.
        wanted: Unit by signal template.
        max_gap_s: Longest stretch without a sample that is accepted, s.
        clause: Clause for the findings about what is missing.
        judge: Findings about one subject.
        optional: Unit by signal template, of signals that help where the log has them.
        turning: The flags, and those of the helpful signals, that a verdict rests on.
        unseen: What it makes of the time without samples; `None`: it is open.
    """
    for subject in subjects:
        try:
            watched = _watched(trial, subject, wanted, optional or {}, max_gap_s, turning)
        except MissingSignalError as missing:
            yield Finding.inconclusive(subject.name, str(missing), span=trial.window, clause=clause)
            yield from () if unseen is None else unseen.nothing(trial, subject, str(missing))
            continue
        why = trial.window_open
        # A trial made by hand with neither event is taken for the competition alone.
        if not why and (trial.started_s is None) != (trial.ended_s is None):
            missing_end = "end" if trial.ended_s is None else "start"
            why = f"the log does not show the {missing_end} of the competition"
        if why:
            why = f"{why}, so part of it may be missing"
            yield Finding.inconclusive(subject.name, why, span=trial.window, clause=clause)
        if unseen is not None:
            yield from unseen.about(watched, judge, why)
        else:
            yield from seen(watched, judge, clause)


def seen(
    watched: Watched,
    judge: Callable[[Watched], Iterable[Yielded]],
    clause: str,
    said: Mapping[Span, str] | None = None,
) -> Iterator[Finding | Yielded]:
    """What is known of a subject: its gaps, and everything about its samples."""
    yield from watched.gap_findings(clause, said)
    if not len(watched):
        return
    try:
        # To the end before anything is stated: half a judgement is none.
        judged = list(judge(watched))
    except (UndecidedError, MissingSignalError) as undecided:
        span = watched.trial.window
        yield Finding.inconclusive(watched.subject.name, str(undecided), span=span, clause=clause)
    else:
        yield from judged


def _watched(
    trial: Trial,
    subject: Subject,
    wanted: Mapping[str, str],
    optional: Mapping[str, str],
    max_gap_s: float,
    turning: Iterable[str],
) -> Watched:
    """The signals of a subject.

    Raises:
        MissingSignalError: The log lacks one that is wanted.
    """
    names = {template: subject.fill(template) for template in wanted}
    signals = [trial.signal(names[template], unit=unit) for template, unit in wanted.items()]
    turning, helpful = [*turning], {}
    for template, unit in optional.items():
        name = subject.fill(template)
        signal = trial.find_signal(name, unit=unit)
        signal = found_or_due(trial, name) if signal is None and template in turning else signal
        if signal is not None:
            helpful[template] = signal
    turns = [
        shown_times(helpful[one], max_gap_s) if one in helpful else flag_times(trial, one, subject.name)
        for one in turning
    ]
    return watched_signals(
        signals,
        max_gap_s,
        trial,
        subject,
        names=names,
        optional=helpful,
        turns=distinct(np.concatenate(turns)) if turns else None,
    )


def first_of_runs(t: FloatArray, holds: BoolArray, longest_s: float) -> NDArray[np.intp]:
    """For each row the first row of the run of true rows it belongs to; itself where false.

    A hole in the samples longer than `longest_s` ends a run.

    >>> holds = np.array([False, True, True, False, True])
    >>> first_of_runs(np.arange(5.0), holds, 1.0).tolist()
    [0, 1, 1, 3, 4]
    """
    index = np.arange(len(t))
    goes_on = np.zeros(len(t), dtype=bool)
    goes_on[1:] = holds[1:] & holds[:-1] & (np.diff(t) <= longest_s + TOLERANCE_S)
    return np.maximum.accumulate(np.where(goes_on, 0, index))
