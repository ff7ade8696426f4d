"""`rml.spec` while a trial goes on: over signals as they come, and over events as they are recorded."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import inf

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    Alignment,
    Arrivals,
    Event,
    Finding,
    InstantVerdict,
    Sample,
    Trial,
    Verdict,
)
from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.machine import Letter, Machine
from ariac_score_rml.progress import AfterViolation, Progress
from ariac_score_rml.values import Json

__all__ = ["EventsOnline", "SignalsOnline", "Trace", "Wanted"]

Fields = Mapping[str, str]
Wanted = Sequence[tuple[str, Fields]]
"""The topics of one subject: name, and signal by field."""

LATEST_S = 1e12
"""A field `time` beyond this, some 30 000 years, is no time in s."""
PENDING = "the specification still asks for something"


class Trace:
    """A specification over events, one after another.

    Attributes:
        progress: The state it is in.
    """

    def __init__(self, machine: Machine, after: AfterViolation) -> None:
        self._machine, self.progress = machine, Progress(machine, after)

    def take(self, event: Json) -> str:
        """Take an event: why it is rejected; empty when it is accepted.

        Raises:
            RmlRunError: It cannot be judged; everything is as before.
        """
        state = self.progress.state
        if self.progress.take(self._machine.after(state, event)):
            return ""
        # The types it would have had to be of; those with names that wait for a value are left out.
        types = self._machine.event_types(state)
        try:
            others = {t.name for t in types or () if self._machine.solutions(t, event).get(0) is None}
        except RmlRunError:
            others = set()
        return f"is rejected{': it is no ' + ' and no '.join(map(repr, sorted(others))) if others else ''}"


# Events ----------------------------------------------------------------------------------


class EventsOnline:
    """Judges a trace of events as they are; a rejection is final unless the policy differs."""

    def __init__(self, machine: Machine, after: AfterViolation) -> None:
        self._trace = Trace(machine, after)
        self._final: InstantVerdict | None = None

    def take(self, event: Mapping[str, object]) -> InstantVerdict:
        """Judge the trace up to and including an event.

        Raises:
            ValueError: The event cannot be judged.
        """
        if self._final is not None:
            return self._final
        time = event.get("time")
        t_s = float(time) if isinstance(time, int | float) and abs(time) < LATEST_S else 0.0
        trace, progress = self._trace, self._trace.progress
        try:
            reason = trace.take(event)  # type: ignore[arg-type]  # it was read from JSON
        except RmlRunError as error:
            raise ValueError(str(error)) from error
        if reason:
            channel = event.get("topic", event.get("service", "the event"))
            verdict = InstantVerdict(
                "trace", t_s, Verdict.VIOLATED, f"{channel!r} {reason}", final=progress.over
            )
        elif progress.letter == "f":
            verdict = InstantVerdict("trace", t_s, Verdict.VIOLATED, f"the trace may not end here: {PENDING}")
        else:
            final = progress.letter == "T"
            verdict = InstantVerdict("trace", t_s, Verdict.SATISFIED, "the trace may end here", final=final)
        self._final = verdict if verdict.final else None
        return verdict


# Signals ---------------------------------------------------------------------------------


class SignalsOnline:
    """One trial, watched by a specification on every sample of its topics.

    Args:
        machine: Makes a machine in its first state.
        after: What follows a rejection.
        wanted: The topics of every subject.
        max_gap_s: Longest stretch between two samples that is interpolated, s.
        watch: What the monitor finds in a whole trial.
    """

    def __init__(
        self,
        machine: Callable[[], Machine],
        after: AfterViolation,
        wanted: Mapping[str, Wanted],
        *,
        max_gap_s: float,
        watch: Callable[[Trial], Iterable[Finding]],
    ) -> None:
        self._arrivals, self._watch = Arrivals(), watch
        self.undecided = "" if wanted else "whom it is about is not known before the trial"
        self._subjects = [
            _Followed(
                subject,
                lambda: Trace(machine(), after),
                [_Topic(*topic, self._arrivals, max_gap_s) for topic in topics],
            )
            for subject, topics in wanted.items()
        ]

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterator[InstantVerdict]:
        """Take samples, and judge every instant that all topics have reached by now."""
        self._arrivals.take(samples)
        for event in events:
            for followed in self._subjects:
                followed.take_event(event)
        for followed in self._subjects:
            yield from followed.verdicts()

    def end(self, trial: Trial) -> Iterable[Finding]:
        """What the monitor finds in the trial with the samples that were stepped."""
        return self._watch(self._arrivals.complete(trial))


class _Topic:
    """The events of one topic, made of the samples of its signals."""

    def __init__(self, name: str, fields: Fields, arrivals: Arrivals, max_gap_s: float) -> None:
        self.name, self.fields = name, tuple(fields)
        self.alignment: Alignment = arrivals.aligned(list(fields.values()), max_gap_s=max_gap_s)
        self.waiting: deque[tuple[float, dict[str, Json]]] = deque()

    def collect(self) -> None:
        """Queue the events that are complete by now."""
        for t_s, values in self.alignment.rows():
            event: dict[str, Json] = {"time": t_s}
            event.update(zip(self.fields, values, strict=True))  # type: ignore[arg-type]  # they are numbers
            event["topic"] = self.name
            self.waiting.append((t_s, event))


class _Followed:
    """The specification for one robot, human or pair, or for the trial."""

    def __init__(self, subject: str, trace: Callable[[], Trace], topics: Sequence[_Topic]) -> None:
        self.subject, self.topics = subject, topics
        self._new_trace = trace
        self.window = -inf, inf
        self._restart()

    def _restart(self) -> None:
        self.broken: RmlRunError | None = None
        self.trace: Trace | None = None
        self.over = False
        try:
            self.trace = self._new_trace()
        except RmlRunError as error:
            self.broken = error

    def take_event(self, event: Event) -> None:
        """Start again where the competition starts."""
        from_s, to_s = self.window
        if event.kind == COMPETITION_STARTED and from_s == -inf:
            self.window = event.t_s, to_s
            self._restart()
        elif event.kind == COMPETITION_ENDED:
            self.window = from_s, event.t_s

    def verdicts(self) -> Iterator[InstantVerdict]:
        """The verdicts that can be given by now."""
        for topic in self.topics:
            topic.collect()
        while (t_s := self._next_s()) < inf:
            events = [
                topic.waiting.popleft()[1]
                for topic in self.topics
                if topic.waiting and topic.waiting[0][0] == t_s
            ]
            if not self.over and self.window[0] <= t_s <= self.window[1]:
                yield self._judged(t_s, events)

    def _next_s(self) -> float:
        """The next instant with an event, once no other topic can have one before it."""
        t_s = min((topic.waiting[0][0] for topic in self.topics if topic.waiting), default=inf)
        if all(topic.waiting or topic.alignment.reached_s >= t_s for topic in self.topics):
            return t_s
        return inf

    def _judged(self, t_s: float, events: Sequence[dict[str, Json]]) -> InstantVerdict:
        reasons = []
        try:
            if self.trace is None:
                raise self.broken or AssertionError
            for event in events:
                if not self.trace.progress.over and (reason := self.trace.take(event)):
                    reasons.append(f"{event['topic']!r} {reason}")
        except RmlRunError as error:
            self.over = True
            message = f"cannot be judged from here: {error}"
            return InstantVerdict(self.subject, t_s, Verdict.INCONCLUSIVE, message, final=True)
        if reasons:
            self.over = self.trace.progress.over
            return InstantVerdict(self.subject, t_s, Verdict.VIOLATED, " and ".join(reasons), final=self.over)
        return self._accepted(t_s, self.trace.progress.letter)

    def _accepted(self, t_s: float, letter: Letter) -> InstantVerdict:
        if letter == "f":
            return InstantVerdict(self.subject, t_s, Verdict.INCONCLUSIVE, PENDING)
        return InstantVerdict(self.subject, t_s, Verdict.SATISFIED, "is accepted", final=letter == "T")
