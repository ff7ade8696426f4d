"""The monitor `rml.spec`: a specification over the signals of a trial."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

from ariac_score import (
    Body,
    Chart,
    EventWatch,
    Finding,
    Measure,
    MissingSignalError,
    OnlineWatch,
    Signal,
    SignalNeed,
    Trial,
    Worlds,
    parameter,
)
from ariac_score.monitors import severity_measures, worlds_between
from ariac_score_rml.faults import RmlError, RmlRunError
from ariac_score_rml.guards import TOLERANCE
from ariac_score_rml.judging import Judgement, Settings
from ariac_score_rml.machine import MAX_STATE, Machine
from ariac_score_rml.online import EventsOnline, SignalsOnline, Wanted
from ariac_score_rml.progress import AfterViolation
from ariac_score_rml.recorded import Recorded, TopicSource, subjects, topic_sources
from ariac_score_rml.running import Program, compile_rml
from ariac_score_rml.syntax import Chain, Event, Literal_, OrPattern, Pattern, Post, RecordPattern
from ariac_score_rml.tokens import Dialect

__all__ = ["RmlSpec"]

_NO_EVENTS: Mapping[str, Mapping[str, str]] = MappingProxyType({})


@dataclass(frozen=True)
class RmlSpec:
    """The events of a trial keep a specification in RML, the Runtime Monitoring Language.

    `spec` is the specification, or the path of an `.rml` file, which is relative to
    the rule set that names it and becomes part of it. `events` names, for each topic, the
    signal of each field of its events: `{snapshot: {robot_speed: "speed/{robot}"}}`; with
    `{robot}` or `{human}` every robot, human or pair is judged on its own. Every sample
    is one event: a record of these fields as floats, of `topic`, and of `time` in s of
    trial time. A quantity
    that is not well known is written with its unit: `"force/{robot} [N]"`.

    Measures:
        Whether the specification takes every event of the competition, in order of
        time, and may end when the competition does. Where inequalities over numbers
        decide, by how much (in the unit of the field they limit). Stretches longer
        than `max_gap_s` without a sample are inconclusive, and so is everything from
        the first event on that cannot be judged.
    Violated when:
        An event is rejected; the monitor then passes over it (`resume`), starts again
        (`restart`) or judges no further (`once`). Rejections with pauses shorter than
        `t_off_s` are one violation, those shorter than `t_on_s` none. Or the trial ends
        where the specification may not; a log that does not show the end of the
        competition leaves that open.
    Source:
        The specification; its semantics are those of the RML compiler and monitor of
        2024 (Ancona, Franceschini, Ferrando, Mascardi: RML, Science of Computer
        Programming 205, 2021). What follows a violation is our choice: in the
        reference a rejection is final.
    """

    measures: ClassVar[Mapping[str, Measure]] = {
        **severity_measures("m"),
        "time_in_violation_s": Measure("s", best=0.0, meaning="how long rejected events stand"),
    }
    in_gaps: ClassVar[str] = "blunt"
    example: ClassVar[Mapping[str, Any]] = {
        "spec": "apart matches {topic: 'snapshot', distance: d} with d >= 5.0; Main = apart*;",
        "events": {"snapshot": {"distance": "centre_distance/{robot}/{human}"}},
    }

    spec: str = ""
    events: Mapping[str, Mapping[str, str]] = field(default_factory=lambda: _NO_EVENTS)
    after_violation: AfterViolation = "resume"
    dialect: Dialect = "2024"
    exact: bool = False
    max_gap_s: float = parameter(0.05, unit="s", status="")
    t_on_s: float = parameter(0.0, unit="s", status="")
    t_off_s: float = parameter(1.0, unit="s", status="")
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
            for topic in topic_sources(self.events):
                if not topic.fields:
                    raise ValueError(f"topic {topic.name!r} of events has no field")

    def needs(self) -> Iterator[SignalNeed]:
        """The quantities of the fields of events."""
        fields = [field for topic in topic_sources(self.events) for field in topic.fields.values()]
        needed = {(field.quantity, field.pair): field.unit for field in fields}
        for (quantity, pair), unit in sorted(needed.items()):
            yield SignalNeed(quantity, unit, self.max_gap_s, pair=pair)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings for every subject: its violations, or that there are none."""
        for outcome in self._outcomes(trial):
            yield from (outcome,) if isinstance(outcome, Finding) else outcome.findings(trial)

    def watch_worlds(self, trial: Trial) -> Iterator[Finding | Worlds]:
        """The same, and what any events that a gap may hide leave open.

        Of a specification that remembers what was before, everything from the first gap on is open.
        """
        found: dict[str, list[Finding]] = {}
        signals: dict[str, dict[str, Signal]] = {}
        for outcome in self._outcomes(trial):
            if isinstance(outcome, Finding):
                found.setdefault(outcome.subject, []).append(outcome)
            else:
                found.setdefault(outcome.subject, []).extend(outcome.findings(trial))
                signals[outcome.subject] = outcome.signals
        for subject, own in found.items():
            yield from worlds_between(
                trial,
                subject,
                signals.get(subject, {}),
                own,
                max_gap_s=self.max_gap_s,
                measures=self.measures,
                t_off_s=self.t_off_s,
                t_on_s=self.t_on_s,
                back_s=math.inf if self._remembers else 0.0,
            )

    @property
    def _remembers(self) -> bool:
        """Whether what an event means may hang on those before it; not where Main repeats one alone."""
        program: Program | None = getattr(self, "_program", None)
        equations = () if program is None else program.spec.equations
        if self.after_violation == "once" or len(equations) != 1:
            return True
        body = equations[0].body
        if not (isinstance(body, Post) and body.op == "star"):
            return True
        options = body.body.parts if isinstance(body.body, Chain) and body.body.op == "or" else (body.body,)
        return not all(isinstance(one, Event) for one in options)

    def margins(self, trial: Trial) -> Iterator[Chart]:
        """The margin of every event by inequalities over numbers, where all have one unit."""
        for outcome in self._outcomes(trial):
            chart = None if isinstance(outcome, Finding) else outcome.chart
            if chart is not None:
                yield chart

    def _outcomes(self, trial: Trial) -> Iterator[Finding | Judgement]:
        """What is undecided beforehand, and the judged events of each subject."""
        program: Program | None = getattr(self, "_program", None)
        if program is None or not self.events:
            missing = "specification" if program is None else "mapping of events"
            yield Finding.inconclusive("trial", f"no {missing} is given", span=trial.window)
            return
        topics = topic_sources(self.events)
        found = list(subjects(trial, topics))
        if not found:
            yield _nobody(trial)
        for subject, names in found:
            yield from self._outcomes_of(trial, topics, subject, names)

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that judges every sample as soon as all topics have reached it."""
        topics = topic_sources(self.events)
        program: Program | None = getattr(self, "_program", None)
        known = subjects(Trial("", bodies=tuple(bodies)), topics) if program and topics else ()
        wanted: dict[str, Wanted] = {
            subject: [(topic.name, topic.signals(names)) for topic in topics] for subject, names in known
        }
        return SignalsOnline(
            self._machine, self.after_violation, wanted, max_gap_s=self.max_gap_s, watch=self.watch
        )

    def begin_events(self) -> EventWatch:
        """A watch for events as they are recorded; `events` and the parameters of episodes are not used.

        Raises:
            ValueError: No specification is given, or the empty trace cannot be judged.
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

    def _outcomes_of(
        self, trial: Trial, topics: Sequence[TopicSource], subject: str, names: Mapping[str, str]
    ) -> Iterator[Finding | Judgement]:
        try:
            recorded = [Recorded.of(trial, topic, names, self.max_gap_s) for topic in topics]
        except MissingSignalError as missing:
            yield Finding.inconclusive(subject, str(missing), span=trial.window)
            return
        undecided = list(_undecided(trial, subject, recorded))
        yield from undecided
        if any(len(item.topic.t) for item in recorded):
            yield Judgement(self._machine(), self._settings, subject, recorded, decided=not undecided)

    @property
    def _settings(self) -> Settings:
        spec_sha256 = getattr(self, "_spec_sha256", "")
        return Settings(self.after_violation, self.max_gap_s, self.t_on_s, self.t_off_s, spec_sha256)


# Parameters ------------------------------------------------------------------------------


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
    return f"the specification names the {what} {name!r}, which events do not have; {hint}"


def _records(pattern: Pattern | None) -> Iterator[RecordPattern]:
    """The records a whole event may be."""
    if isinstance(pattern, RecordPattern):
        yield pattern
    elif isinstance(pattern, OrPattern):
        for option in pattern.options:
            yield from _records(option)


# What is undecided before anything is judged ------------------------------------------------


def _nobody(trial: Trial) -> Finding:
    if "bodies" in trial.witnessed:
        return Finding.not_applicable(
            "trial", "the log records every body, and whom the events are about is not among them"
        )
    return Finding.inconclusive("trial", "the log shows nobody whom the events are about", span=trial.window)


def _undecided(trial: Trial, subject: str, recorded: Sequence[Recorded]) -> Iterator[Finding]:
    if (trial.started_s is None) != (trial.ended_s is None):
        missing = "end" if trial.ended_s is None else "start"
        message = f"the log does not show the {missing} of the competition, so part of it may be missing"
        yield Finding.inconclusive(subject, message, span=trial.window)
    for item in recorded:
        for gap in item.gaps:
            message = f"no {item.topic.name!r} for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
            yield Finding.inconclusive(subject, message, span=gap)
