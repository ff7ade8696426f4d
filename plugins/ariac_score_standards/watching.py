"""Where every monitor starts: whom it watches, on which signals, and what the log leaves open.

A monitor names the signals it wants as templates (`speed/{robot}`) and hands over a
function that judges one subject. `watch_pairs` calls it for every robot and human,
`watch_subjects` for any list of subjects, such as `bodies_of` a kind. Signals come as
whole columns on one time base, cut to the competition (`Watched`); what is missing, and
every gap longer than the monitor accepts, is inconclusive before the judging starts.
Flags and modes, which stay as they are until they change, come from `state_over`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ariac_score import (
    Finding,
    MissingSignalError,
    Sample,
    Signal,
    Span,
    Trial,
    align,
    sample_durations,
    uncovered_spans,
)
from ariac_score_standards.parameters import TOLERANCE_S

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]

ENVIRONMENT = "environment"
"""Stands in a signal's name for everything that is no body."""


class Values(Protocol):
    """The values of signals by template: columns of a whole trial (`Watched`), or numbers of one instant."""

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
    """

    t: FloatArray
    columns: Mapping[str, FloatArray]
    gaps: Sequence[Span]
    max_gap_s: float
    units: Mapping[str, str]
    names: Mapping[str, str] = field(default_factory=dict)
    optional: Mapping[str, Signal] = field(default_factory=dict)
    _computed: dict[str, FloatArray] = field(default_factory=dict, init=False, repr=False)

    def __getitem__(self, template: str) -> FloatArray:
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
            self._computed[template] = _values_over(self.optional[template], self.t, self.max_gap_s)
        return self._computed[template]

    def hidden_by_gaps(self, template: str, due: BoolArray, within: Span | None = None) -> list[Span]:
        """The gaps of an optional signal in which a value is due; none where the log has no such signal.

        Args:
            template: Of the signal.
            due: Where a limit applies to it, shape (n,).
            within: The time it has to cover; `None`: all.
        """
        signal, values = self.optional.get(template), self.get(template)
        if signal is None or values is None or not len(self):
            return []
        unknown = self.t[due & np.isnan(values.reshape(len(self), -1)).any(axis=1)]
        # As for a signal that is needed, both ends count as samples: one that begins a moment later than the
        # others, or ends earlier, has no gap.
        gaps = signal.gaps(within or Span(float(self.t[0]), self.end_s), max_gap_s=self.max_gap_s)
        return [gap for gap in gaps if ((unknown >= gap.start_s) & (unknown <= gap.end_s)).any()]

    def hidden_findings(self, subject: str, template: str, due: BoolArray, clause: str) -> list[Finding]:
        """What the gaps of an optional signal leave open, as findings."""
        return [
            Finding.inconclusive(
                subject,
                f"no samples of {self.optional[template].name!r} for {gap.duration_s:.3f} s, "
                f"from {gap.start_s:.3f} s",
                span=gap,
                clause=clause,
            )
            for gap in self.hidden_by_gaps(template, due)
        ]

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

    def samples(self, row: int) -> tuple[Sample, ...]:
        """What was measured in one row, as evidence."""
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


def watched_signals(
    signals: Sequence[Signal],
    max_gap_s: float,
    window: Span | None,
    names: Mapping[str, str],
    optional: Mapping[str, Signal] | None = None,
) -> Watched:
    """Signals as they are watched.

    Args:
        signals: At least one.
        max_gap_s: A sample stands for no longer than this, s.
        window: The competition; `None`: all samples count, and there are no gaps.
        names: Signal name by template.
        optional: Further signals by template.
    """
    t, columns = align(signals, max_gap_s=max_gap_s)
    inside, gaps = slice(None), []
    if window is not None:
        inside = slice(int(t.searchsorted(window.start_s)), int(t.searchsorted(window.end_s, side="right")))
        # Only samples inside count: one after the end of the competition covers nothing before it.
        gaps = uncovered_spans(t[inside], window, max_gap_s=max_gap_s)
    return Watched(
        t[inside],
        {signal.name: column[inside] for signal, column in zip(signals, columns, strict=True)},
        gaps,
        max_gap_s,
        {signal.name: signal.unit for signal in signals},
        names,
        optional or {},
    )


def _plain(value: FloatArray) -> float | tuple[float, ...]:
    return float(value) if np.ndim(value) == 0 else tuple(float(v) for v in value)


@dataclass(frozen=True)
class Subject:
    """Whom a monitor judges.

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
"""What a judge yields: findings, or what its monitor turns into findings."""


def watch_pairs(
    trial: Trial,
    wanted: Mapping[str, str],
    *,
    max_gap_s: float,
    clause: str,
    judge: Callable[[str, Watched], Iterator[Yielded]],
    optional: Mapping[str, str] | None = None,
) -> Iterator[Finding | Yielded]:
    """Judge every (robot, human) pair; what cannot be judged is inconclusive for each pair.

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
    judge: Callable[[Subject, Watched], Iterator[Yielded]],
    optional: Mapping[str, str] | None = None,
    kinds: tuple[str, ...] = ("robot",),
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
        kinds: Kinds of bodies that must be there for a subject to exist.
    """
    all_subjects = list(subjects)
    if not all_subjects:
        yield nobody(trial, clause, kinds)
    for subject in all_subjects:
        names = {template: subject.fill(template) for template in wanted}
        try:
            signals = [trial.signal(names[template], unit=unit) for template, unit in wanted.items()]
        except MissingSignalError as missing:
            yield Finding.inconclusive(subject.name, str(missing), span=trial.window, clause=clause)
            continue
        helpful = _present(trial, subject, optional or {})
        watched = watched_signals(signals, max_gap_s, trial.window, names, helpful)
        # A log with neither event is taken for a recording of the competition alone.
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


def watched_subjects(
    trial: Trial,
    subjects: Iterable[Subject],
    wanted: Mapping[str, str],
    *,
    max_gap_s: float,
    optional: Mapping[str, str] | None = None,
) -> Iterator[tuple[Subject, Watched]]:
    """Every subject whose signals the log has, with the signals, for a chart."""
    for subject in subjects:
        names = {template: subject.fill(template) for template in wanted}
        if not trial.signals.keys() >= set(names.values()):
            continue
        signals = [trial.signal(names[template], unit=unit) for template, unit in wanted.items()]
        helpful = _present(trial, subject, optional or {})
        watched = watched_signals(signals, max_gap_s, trial.window, names, helpful)
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
    """Whether something is on, at each of some times.

    Attributes:
        on: Whether it is on, shape (n,); off where it is not known.
        known: Whether the log shows it, shape (n,).
    """

    on: BoolArray
    known: BoolArray


ON, OFF = "on", "off"


def state_over(trial: Trial, name: str, body: str, t: FloatArray, *, max_age_s: float) -> State | None:
    """A flag over time: from the signal `name/body`, else from events of that kind.

    A signal's value holds until its next sample, for `max_age_s` at most. An event
    has the detail `on` or `off` and holds until the next; before the first event the
    state was the opposite one. An event with neither detail leaves the state unknown. A
    log that records such events but has none shows a flag that was never on.

    Args:
        trial: The trial.
        name: Quantity and event kind, such as `drive_enabled`.
        body: Id of the body; events without a subject concern every body.
        t: The times, shape (n,), s.
        max_age_s: How long a sample of the signal holds at most, s.

    Returns:
        The state, or `None` when the log has neither.
    """
    signal = trial.signals.get(f"{name}/{body}")
    if signal is not None and len(signal):
        # A flag stamped at the same instant counts, though both stamps may differ in their last bits.
        before = np.searchsorted(signal.t, t + TOLERANCE_S, side="right") - 1
        held = before.clip(0)
        known = (before >= 0) & (t - signal.t[held] <= max_age_s + TOLERANCE_S)
        return State(known & (signal.values[held] >= 0.5), known)
    events = [e for e in trial.events_of(name) if e.subject in ("", body)]
    if not events and name not in trial.witnessed:
        return None
    if not events:
        return State(np.zeros(len(t), dtype=bool), np.ones(len(t), dtype=bool))
    times = np.array([e.t_s for e in events])
    earlier = OFF if events[0].detail == ON else ON if events[0].detail == OFF else ""
    words = np.array([earlier, *(event.detail for event in events)])
    word = words[np.searchsorted(times, t, side="right")]
    return State(word == ON, (word == ON) | (word == OFF))


def flag_over(
    trial: Trial, subject: Subject, flag: str, max_age_s: float, watched: Watched, clause: str
) -> BoolArray | Finding:
    """A flag over time; or an inconclusive finding where it is not known throughout."""
    state = state_over(trial, flag, subject.name, watched.t, max_age_s=max_age_s)
    if state is not None and state.known.all():
        return state.on
    if state is None:
        message = f"the log has neither a signal '{flag}/{subject.name}' nor {flag!r} events"
    else:
        message = f"{flag!r} is not known at {watched.t[np.argmin(state.known)]:.3f} s"
    return Finding.inconclusive(subject.name, message, span=trial.window, clause=clause)


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
