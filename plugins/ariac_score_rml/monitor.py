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

from ariac_score import (
    QUANTITIES,
    Body,
    Course,
    EventWatch,
    Finding,
    MissingSignalError,
    OnlineWatch,
    SignalNeed,
    Trial,
)
from ariac_score_rml.automaton import AfterViolation
from ariac_score_rml.faults import RmlError, RmlRunError
from ariac_score_rml.guards import TOLERANCE
from ariac_score_rml.judging import Asked, Judged
from ariac_score_rml.machine import MAX_STATE, Machine
from ariac_score_rml.online import EventsOnline, SignalsOnline, Wanted
from ariac_score_rml.running import Program, compile_rml
from ariac_score_rml.syntax import Literal_, OrPattern, Pattern, RecordPattern
from ariac_score_rml.tokens import Dialect
from ariac_score_rml.windows import Events, Recorded

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
        for said in self._say(trial):
            yield from (said,) if isinstance(said, Finding) else said.findings(trial)

    def margins(self, trial: Trial) -> Iterator[Course]:
        """The margin of every event by inequalities over numbers, where all have one unit."""
        for said in self._say(trial):
            course = None if isinstance(said, Finding) else said.course
            if course is not None:
                yield course

    def _say(self, trial: Trial) -> Iterator[Finding | Judged]:
        """What is open or cannot be said, and the events of each subject, judged."""
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

    def _watch_one(self, trial: Trial, subject: str, names: Mapping[str, str]) -> Iterator[Finding | Judged]:
        try:
            recorded = [self._recorded(trial, topic, names) for topic in self._topics()]
        except MissingSignalError as missing:
            yield Finding.inconclusive(subject, str(missing), span=trial.window)
            return
        undecided = list(_undecided(trial, subject, recorded))
        yield from undecided
        events = Events(recorded)
        if len(events):
            yield Judged(self._asked(), subject, events, decided=not undecided)

    def _recorded(self, trial: Trial, topic: _TopicSource, names: Mapping[str, str]) -> Recorded:
        signals = {
            key: trial.signal(field.signal.format(**names), unit=field.unit)
            for key, field in topic.fields.items()
        }
        return Recorded(topic.name, signals, trial.window, max_gap_s=self.max_gap_s)

    def _asked(self) -> Asked:
        return Asked(
            self._machine,
            self.after_violation,
            self.max_gap_s,
            self.t_on_s,
            self.t_off_s,
            getattr(self, "_spec_sha256", ""),
        )


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


def _undecided(trial: Trial, subject: str, recorded: Sequence[Recorded]) -> Iterator[Finding]:
    if (trial.started_s is None) != (trial.ended_s is None):
        missing = "end" if trial.ended_s is None else "start"
        message = f"the log does not show the {missing} of the competition, so part of it may be missing"
        yield Finding.inconclusive(subject, message, span=trial.window)
    for item in recorded:
        for gap in item.gaps:
            message = f"no {item.name!r} for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
            yield Finding.inconclusive(subject, message, span=gap)
