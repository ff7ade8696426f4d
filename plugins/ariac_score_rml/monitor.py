"""The monitor `rml.spec`: a specification over the signals of a trial."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np

from ariac_score import (
    QUANTITIES,
    Body,
    Course,
    EventWatch,
    Finding,
    MissingSignalError,
    OnlineWatch,
    Sample,
    Signal,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    align,
    episodes_where,
    uncovered_spans,
)
from ariac_score_rml.automaton import AfterViolation, Watch, margins, watch_stream
from ariac_score_rml.columns import Columns, FloatArray, IntArray, Match, Stream, Topic
from ariac_score_rml.faults import RmlError, RmlRunError
from ariac_score_rml.guards import TOLERANCE
from ariac_score_rml.machine import MAX_STATE, Machine
from ariac_score_rml.online import EventsOnline, SignalsOnline, Wanted
from ariac_score_rml.running import Program, compile_rml
from ariac_score_rml.syntax import Literal_, OrPattern, Pattern, RecordPattern
from ariac_score_rml.tokens import Dialect

__all__ = ["RmlSpec"]

_SOURCE = re.compile(r"(?P<signal>[^\s\[]+)(?:\s*\[(?P<unit>[^\]]+)\])?")
_NO_EVENTS: Mapping[str, Mapping[str, str]] = MappingProxyType({})


@dataclass(frozen=True)
class RmlSpec:
    """The events of a trial keep a specification in RML, the Runtime Monitoring Language.

    `spec` is the specification, or the path of an `.rml` file, which is relative to
    the rule set that names it and becomes part of it. `events` says of each topic which
    signal each field of its events is: `{snapshot: {robot_speed: "speed/{robot}"}}`; with
    `{robot}` or `{human}` every robot, human or pair is judged on its own. Every sample
    is one event: a record of these fields as floats, of `topic`, and of `time` in s of
    trial time. A quantity
    that is not well known is written with its unit: `"force/{robot} [N]"`.

    Measures:
        Whether the specification takes every event of the competition, in order of
        time, and may end when the competition does. Where inequalities over numbers
        decide, by how much (in the unit of the field they limit). Stretches longer
        than `max_gap_s` without a sample are inconclusive, and so is everything from
        an event on that cannot be judged.
    Violated when:
        An event is rejected; afterwards the monitor passes over it (`resume`), begins
        anew (`restart`) or judges no further (`once`). Rejections less than `t_off_s`
        apart are one violation, those shorter than `t_on_s` none. Or the trial ends
        where the specification may not.
    Source:
        The specification; its semantics are those of the RML compiler and monitor of
        2024 (Ancona, Franceschini, Ferrando, Mascardi: RML, Science of Computer
        Programming 205, 2021). What follows a violation is our choice: in the
        reference a rejection is final.
    """

    example: ClassVar[Mapping[str, Any]] = {
        "spec": "apart matches {topic: 'snapshot', distance: d} with d >= 5.0; Main = apart*;",
        "events": {"snapshot": {"distance": "centre_distance/{robot}/{human}"}},
    }

    spec: str = ""
    events: Mapping[str, Mapping[str, str]] = field(default_factory=lambda: _NO_EVENTS)
    after_violation: AfterViolation = "resume"
    dialect: Dialect = "2024"
    exact: bool = False
    max_gap_s: float = 0.05
    t_on_s: float = 0.0
    t_off_s: float = 1.0
    max_state: int = MAX_STATE

    def __post_init__(self) -> None:
        for name in ("t_on_s", "t_off_s"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} is {getattr(self, name):g} but cannot be negative")
        if not self.max_gap_s > 0:
            raise ValueError(f"max_gap_s is {self.max_gap_s:g} but must be positive")
        if self.max_state < 1:
            raise ValueError(f"max_state is {self.max_state} but must be positive")
        text = _text(self.spec)
        object.__setattr__(self, "_spec_sha256", hashlib.sha256(text.encode()).hexdigest())
        program = _compiled(text, self.dialect)
        object.__setattr__(self, "_program", program)
        if program is not None:
            _check_mapping(program, self.events)
            for topic in self._topics():
                if not topic.fields:
                    raise ValueError(f"topic {topic.name!r} of events has no field")

    def _topics(self) -> list[_TopicSource]:
        return [
            _TopicSource(name, {key: _source(text) for key, text in fields.items()})
            for name, fields in self.events.items()
        ]

    def needs(self) -> Iterator[SignalNeed]:
        """Every quantity that a field of an event is."""
        needed = {s.quantity: s.unit for topic in self._topics() for s in topic.fields.values()}
        for quantity, unit in sorted(needed.items()):
            yield SignalNeed(quantity, unit, self.max_gap_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings for every subject: its violations, or that there are none."""
        return (said for said in self._say(trial) if isinstance(said, Finding))

    def margins(self, trial: Trial) -> Iterator[Course]:
        """The margin of every event by inequalities over numbers, where all have one unit."""
        for said in self._say(trial):
            course = None if isinstance(said, Finding) else said.course
            if course is not None:
                yield course

    def _say(self, trial: Trial) -> Iterator[Finding | _Judged]:
        program: Program | None = getattr(self, "_program", None)
        if program is None or not self.events:
            missing = "specification" if program is None else "mapping of events"
            yield Finding.inconclusive("trial", f"no {missing} is given", span=trial.window)
            return
        subjects = list(_subjects(trial, self._topics()))
        if not subjects:
            yield _nobody(trial)
        for subject, names in subjects:
            yield from self._watch_one(trial, subject, names)

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that judges every sample, as soon as all topics have reached it."""
        topics = self._topics()
        program: Program | None = getattr(self, "_program", None)
        known = _subjects(Trial("", bodies=tuple(bodies)), topics) if program and topics else ()
        wanted: dict[str, Wanted] = {
            subject: [
                (topic.name, {key: source.signal.format(**names) for key, source in topic.fields.items()})
                for topic in topics
            ]
            for subject, names in known
        }
        return SignalsOnline(
            self._machine, self.after_violation, wanted, max_gap_s=self.max_gap_s, watch=self.watch
        )

    def begin_events(self) -> EventWatch:
        """A watch for events as they are recorded; `events` and what is about episodes play no part.

        Raises:
            ValueError: No specification is given, or nothing can be said before any event.
        """
        try:
            return EventsOnline(self._machine(), self.after_violation)
        except RmlRunError as error:
            raise ValueError(str(error)) from error

    def _machine(self) -> Machine:
        program: Program | None = getattr(self, "_program", None)
        if program is None:
            raise ValueError("no specification is given")
        return program.machine(tolerance=0.0 if self.exact else TOLERANCE, max_state=self.max_state)

    def _watch_one(self, trial: Trial, subject: str, names: Mapping[str, str]) -> Iterator[Finding | _Judged]:
        try:
            recorded = [_Recorded.of(trial, topic, names, self.max_gap_s) for topic in self._topics()]
        except MissingSignalError as missing:
            yield Finding.inconclusive(subject, str(missing), span=trial.window)
            return
        undecided = list(_undecided(trial, subject, recorded))
        yield from undecided
        stream = Stream([item.topic for item in recorded])
        if not len(stream):
            return
        machine = self._machine()
        columns = Columns(machine.matcher, stream)
        watch = watch_stream(machine, stream, self.after_violation, columns)
        judged = _Judged(self, subject, recorded, stream, watch, margins(machine, stream, watch, columns))
        yield judged
        yield from judged.findings(trial, decided=not undecided)


# Parameters ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Source:
    """Which signal a field is, with `{robot}` and `{human}` to be filled in."""

    signal: str
    unit: str

    @property
    def quantity(self) -> str:
        return self.signal.partition("/")[0]


@dataclass(frozen=True)
class _TopicSource:
    name: str
    fields: Mapping[str, _Source]


def _source(text: str) -> _Source:
    found = _SOURCE.fullmatch(text.strip())
    if found is None or "/" not in found["signal"]:
        raise ValueError(f"{text!r} in events is no signal such as 'speed/{{robot}}'")
    for name in re.findall(r"\{([^}]*)\}", found["signal"]):
        if name not in ("robot", "human"):
            raise ValueError(f"{text!r} in events: only {{robot}} and {{human}} can be filled in")
    known = QUANTITIES.get(found["signal"].partition("/")[0])
    if known is not None and known.components != 1:
        raise ValueError(f"{text!r} in events has {known.components} components, and a field is one number")
    unit = found["unit"] or (known.unit if known else "")
    if not unit:
        raise ValueError(f"{text!r} in events is not well known: write its unit, as in '{text} [N]'")
    return _Source(found["signal"], unit)


def _text(spec: str) -> str:
    if ";" in spec or not spec.strip().endswith(".rml"):
        return spec
    try:
        return Path(spec.strip()).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"the specification {spec.strip()!r} cannot be read: {error}") from error


def _compiled(spec: str, dialect: Dialect) -> Program | None:
    if not spec.strip():
        return None
    try:
        return compile_rml(spec, dialect=dialect)
    except RmlError as error:
        hint = f" ({error.hint})" if error.hint else ""
        raise ValueError(f"the specification is refused: {error}{hint}") from error


def _check_mapping(program: Program, events: Mapping[str, Mapping[str, str]]) -> None:
    """Refuse a specification about topics and fields that no event will have."""
    if not events:
        return
    for declaration in program.spec.declarations:
        for record in _records(declaration.pattern):
            named = [p.value for key, p in record.fields if key == "topic" and isinstance(p, Literal_)]
            for topic in named:
                if topic not in events:
                    raise ValueError(_unmapped("topic", str(topic), events))
            if len(named) == 1:
                known = {*events[str(named[0])], "topic", "time"}
                for key, _ in record.fields:
                    if key not in known:
                        raise ValueError(_unmapped(f"field of {named[0]!r}", key, known))


def _unmapped(what: str, name: str, known: Mapping[str, object] | set[str]) -> str:
    near = get_close_matches(name, sorted(known), n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"mapped: {', '.join(sorted(known))}"
    return f"the specification speaks of the {what} {name!r}, which events do not have; {hint}"


def _records(pattern: Pattern | None) -> Iterator[RecordPattern]:
    """The records a whole event may be."""
    if isinstance(pattern, RecordPattern):
        yield pattern
    elif isinstance(pattern, OrPattern):
        for option in pattern.options:
            yield from _records(option)


# From signals to events ------------------------------------------------------------------


def _subjects(trial: Trial, topics: Sequence[_TopicSource]) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Whom the specification is judged for, and what their signals are called by."""
    texts = [source.signal for topic in topics for source in topic.fields.values()]
    robot, human = (any(f"{{{kind}}}" in text for text in texts) for kind in ("robot", "human"))
    if robot and human:
        for a, b in trial.pairs():
            yield f"{a.id}/{b.id}", {"robot": a.id, "human": b.id}
    elif robot or human:
        kind = "robot" if robot else "human"
        for body in trial.bodies_of(kind):
            yield body.id, {kind: body.id}
    else:
        yield "trial", {}


def _nobody(trial: Trial) -> Finding:
    if "bodies" in trial.witnessed:
        return Finding.not_applicable(
            "trial", "the log records every body, and whom the events are about is not among them"
        )
    return Finding.inconclusive("trial", "the log shows nobody whom the events are about", span=trial.window)


@dataclass(frozen=True)
class _Recorded:
    """The events of one topic in the competition, and where they are missing.

    Attributes:
        topic: Times and values.
        signals: The signal that each field is.
        gaps: Stretches of the competition without events.
    """

    topic: Topic
    signals: Mapping[str, Signal]
    gaps: Sequence[Span]

    @classmethod
    def of(cls, trial: Trial, source: _TopicSource, names: Mapping[str, str], max_gap_s: float) -> _Recorded:
        """The events of a topic.

        Raises:
            MissingSignalError: A field's signal is not in the log.
        """
        signals = {
            key: trial.signal(field.signal.format(**names), unit=field.unit)
            for key, field in source.fields.items()
        }
        t, columns = align(list(signals.values()), max_gap_s=max_gap_s)
        gaps: list[Span] = []
        if trial.window is not None:
            inside = slice(t.searchsorted(trial.window.start_s), t.searchsorted(trial.window.end_s, "right"))
            t, columns = t[inside], [column[inside] for column in columns]
            gaps = uncovered_spans(t, trial.window, max_gap_s=max_gap_s)
        return cls(Topic(source.name, t, dict(zip(signals, columns, strict=True))), signals, gaps)

    def samples(self, row: int) -> tuple[Sample, ...]:
        """What was measured in one event, as evidence."""
        t_s = float(self.topic.t[row])
        return tuple(
            Sample(signal.name, t_s, float(self.topic.fields[key][row]), signal.unit)
            for key, signal in self.signals.items()
        )


def _undecided(trial: Trial, subject: str, recorded: Sequence[_Recorded]) -> Iterator[Finding]:
    if (trial.started_s is None) != (trial.ended_s is None):
        missing = "end" if trial.ended_s is None else "start"
        message = f"the log does not show the {missing} of the competition, so part of it may be missing"
        yield Finding.inconclusive(subject, message, span=trial.window)
    for item in recorded:
        for gap in item.gaps:
            message = f"no {item.topic.name!r} for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
            yield Finding.inconclusive(subject, message, span=gap)


def _firsts(topic: IntArray, field: IntArray, known: Any) -> IntArray:
    """The first known row of every topic and field that occur together."""
    _, first = np.unique(np.stack([topic, field]), axis=1, return_index=True)
    rows: IntArray = np.flatnonzero(known)[first]
    return rows


# From verdicts to findings ---------------------------------------------------------------


class _Judged:
    def __init__(
        self,
        monitor: RmlSpec,
        subject: str,
        recorded: Sequence[_Recorded],
        stream: Stream,
        watch: Watch,
        match: Match | None,
    ) -> None:
        self.monitor, self.subject, self.recorded = monitor, subject, recorded
        self.stream, self.watch = stream, watch
        match = match or Match.alike(True, len(stream))
        finite = np.isfinite(match.margin)
        self.margin = match.margin if finite.all() else np.where(finite, match.margin, np.nan)
        self.bound, self.field = match.bound, match.field
        self.labels = {"spec_sha256": getattr(monitor, "_spec_sha256", "")}
        self.rejected = np.flatnonzero(watch.rejected)
        self.rejected_t = stream.t[self.rejected]

    @property
    def course(self) -> Course | None:
        """The margin over time, of events at one time the least; `None` where there is none of one unit."""
        known = np.isfinite(self.margin) & (np.arange(len(self.margin)) < self._judged_to)
        units = {self._unit(int(row)) for row in _firsts(self.stream.topic[known], self.field[known], known)}
        if len(units) != 1:
            return None
        # A rejected event is beyond its limit, whatever the last digit says; an accepted one within.
        margin = np.where(self.watch.rejected, np.minimum(self.margin, 0.0), np.maximum(self.margin, 0.0))
        t, first = np.unique(self.stream.t, return_index=True)
        least = np.minimum.reduceat(np.where(known, margin, np.inf), first)
        told = np.isfinite(least)
        return Course(
            self.subject,
            "margin of the specification",
            units.pop(),
            t,
            np.where(told, least, 0.0),
            np.where(told, 0.0, np.nan),
            max_gap_s=self.monitor.max_gap_s,
        )

    @property
    def _judged_to(self) -> int:
        """The first event that is not judged any more."""
        if self.watch.error is not None:
            return self.watch.error_at
        if self.monitor.after_violation == "once" and len(self.rejected):
            return int(self.rejected[0]) + 1
        return len(self.stream)

    def findings(self, trial: Trial, *, decided: bool) -> Iterator[Finding]:
        spans = self._episodes()
        for span in spans:
            yield self._violation(span)
        if self.watch.error is not None:
            yield self._not_judged(trial)
            return
        ends = self._end(trial)
        yield from ends
        if not spans and not ends and decided:
            yield self._kept()

    def _episodes(self) -> list[Span]:
        """The episodes of rejected events: of each topic, then joined across topics."""
        monitor, found = self.monitor, list[Span]()
        for index, item in enumerate(self.recorded):
            rejected = self.watch.rejected[self.stream.rows_of(index)]
            found += episodes_where(
                item.topic.t,
                rejected,
                t_on_s=monitor.t_on_s,
                t_off_s=monitor.t_off_s,
                longest_s=monitor.max_gap_s,
            )
        joined: list[Span] = []
        for span in sorted(found):
            if joined and (
                span.overlaps(joined[-1]) or span.start_s - joined[-1].end_s < monitor.t_off_s - 1e-9
            ):
                joined[-1] = Span(joined[-1].start_s, max(joined[-1].end_s, span.end_s))
            else:
                joined.append(span)
        return joined

    def _violation(self, span: Span) -> Finding:
        inside = slice(
            self.rejected_t.searchsorted(span.start_s), self.rejected_t.searchsorted(span.end_s, "right")
        )
        rows = self.rejected[inside]
        measured = rows[np.isfinite(self.margin[rows])]
        worst = int(measured[np.argmin(self.margin[measured])]) if len(measured) else int(rows[0])
        event = self.recorded[int(self.stream.topic[worst])]
        unit = self._unit(worst)
        many = "event is" if len(rows) == 1 else f"{len(rows)} events are"
        where = f"{event.topic.name!r} at {self.stream.t[worst]:.3f} s"
        margin = min(float(self.margin[worst]), 0.0) if len(measured) else None
        by = (
            f"; at worst {-margin:.3f} {unit or 'units'} beyond its limit"
            if margin is not None
            else "; first"
        )
        final = " and nothing later is judged" if self.monitor.after_violation == "once" else ""
        return Finding(
            self.subject,
            Verdict.VIOLATED,
            f"{many} rejected{final}{by}, {where}",
            span=span,
            robustness=margin,
            unit=unit if margin is not None else "",
            quantities=self._quantities(rows, unit if margin is not None else ""),
            labels=self.labels,
            evidence=self._evidence(worst),
        )

    def _quantities(self, rows: IntArray, unit: str) -> dict[str, float]:
        weights_s = self._weights_s(rows)
        found = {"time_in_violation_s": float(weights_s.sum())}
        if unit != "m" or not np.isfinite(self.margin[rows]).all():
            return found
        depth_m, bound_m = np.maximum(-self.margin[rows], 0.0), self.bound[rows]
        relative = np.clip(
            np.divide(depth_m, bound_m, out=np.ones_like(depth_m), where=bound_m > 0), 0.0, 1.0
        )
        return {
            **found,
            "depth_max_m": float(depth_m.max()),
            "depth_integral_m_s": float((depth_m * weights_s).sum()),
            "relative_depth_max": float(relative.max()),
            "relative_depth_integral_s": float((relative * weights_s).sum()),
        }

    def _weights_s(self, rows: IntArray) -> FloatArray:
        """How long events stand for, each until the next one of its topic."""
        weights_s = np.zeros(len(rows))
        for index, item in enumerate(self.recorded):
            here = np.flatnonzero(self.stream.topic[rows] == index)
            row, t = self.stream.row[rows[here]], item.topic.t
            following = np.minimum(row + 1, len(t) - 1)
            weights_s[here] = np.minimum(t[following] - t[row], self.monitor.max_gap_s)
        return weights_s

    def _unit(self, row: int) -> str:
        """The unit of the margin: that of the field which an inequality compares."""
        signals = list(self.recorded[int(self.stream.topic[row])].signals.values())
        return signals[int(self.field[row])].unit if self.field[row] >= 0 else ""

    def _evidence(self, row: int) -> tuple[Sample, ...]:
        item = self.recorded[int(self.stream.topic[row])]
        samples = item.samples(int(self.stream.row[row]))
        if not np.isfinite(self.bound[row]):
            return samples
        bound = Sample(
            f"bound/{self.subject}", float(self.stream.t[row]), float(self.bound[row]), self._unit(row)
        )
        return (*samples, bound)

    def _not_judged(self, trial: Trial) -> Finding:
        error, at = self.watch.error, self.watch.error_at
        where = f"event {at + 1}, at {self.stream.t[at]:.3f} s" if at >= 0 else "the beginning"
        span = trial.window
        if span is not None and at >= 0:
            span = Span(min(float(self.stream.t[at]), span.end_s), span.end_s)
        message = f"cannot be judged from {where}: {error}"
        return Finding(self.subject, Verdict.INCONCLUSIVE, message, span=span, labels=self.labels)

    def _end(self, trial: Trial) -> list[Finding]:
        """The violation of a trial that ends where the specification may not."""
        restarted = self.monitor.after_violation == "restart" and bool(self.watch.rejected.any())
        if self.watch.end != "f" or trial.ended_s is None or (restarted and self.watch.fresh):
            return []
        end_s = float(self.stream.t[-1])
        message = "the trial ends where the specification still asks for something"
        return [Finding(self.subject, Verdict.VIOLATED, message, span=Span(end_s, end_s), labels=self.labels)]

    def _kept(self) -> Finding:
        if not np.isfinite(self.margin).any():
            message = f"all {len(self.stream)} events are accepted"
            return Finding(self.subject, Verdict.SATISFIED, message, labels=self.labels)
        closest = int(np.nanargmin(self.margin))
        margin, unit = max(float(self.margin[closest]), 0.0), self._unit(closest)
        return Finding(
            self.subject,
            Verdict.SATISFIED,
            f"at its closest {margin:.3f}{unit and ' '}{unit} within its limit, "
            f"at {self.stream.t[closest]:.3f} s",
            robustness=margin,
            unit=unit,
            labels=self.labels,
            evidence=self._evidence(closest),
        )
