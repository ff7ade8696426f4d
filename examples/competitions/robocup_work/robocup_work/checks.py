"""What a referee saw: what was done with each object, where the robot came, what went wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import (
    Event,
    Finding,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    WorkItem,
)
from robocup_work.run import FINISH, ROBOT, counting

__all__ = ["Incidents", "Manipulation", "Mishap", "Reached"]

_SOURCE = "rulebook 2024, chapter Scoring and Ranking"
_NOBODY_SAW = "no referee's sheet says"
_WORDS = {"lost": "loss", "incorrect": "incorrect manipulation"}


@dataclass(frozen=True)
class Manipulation:
    """Each object is grasped, or placed, where the task wants it.

    Measures:
        Whether the referee saw it.
    Violated when:
        The referee did not see it, or saw it at another place.
    Source:
        Rulebook 2024, Scoring: objects grasped, objects placed.
    """

    action: Literal["grasped", "placed"] = "grasped"

    @property
    def mistake(self) -> tuple[str, str]:
        """What people call a violation."""
        return f"object not {self.action}", f"objects not {self.action}"

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about each object of a task."""
        for thing in item.items:
            yield self._judge(trial, f"{item.id}/{thing.id}", thing)

    def _judge(self, trial: Trial, subject: str, thing: WorkItem) -> Finding:
        if self.action not in trial.witnessed:
            return Finding.inconclusive(subject, _NOBODY_SAW, clause=_SOURCE)
        where = thing.facts.get("source" if self.action == "grasped" else "target")
        if where is None:
            return Finding.inconclusive(
                subject, f"no task says where it is to be {self.action}", clause=_SOURCE
            )
        seen = [event for event in counting(trial, self.action) if event.subject == thing.id]
        done = [event for event in seen if event.detail in ("", where)]  # nobody notes where it is grasped
        if done:
            return _at(subject, Verdict.SATISFIED, f"{self.action} at {where}", done[0])
        if seen:
            return _at(subject, Verdict.VIOLATED, f"{self.action} at {seen[0].detail}, not {where}", seen[0])
        return Finding.violated(subject, f"not {self.action}", clause=_SOURCE)


@dataclass(frozen=True)
class Mishap:
    """Nothing goes wrong with an object.

    Measures:
        How often the referee wrote it down.
    Violated when:
        The referee did; each time is one violation.
    Source:
        Rulebook 2024, Penalties: object loss, incorrect object manipulation, manipulation deduction.
    """

    kind: Literal["lost", "incorrect", "deduction"] = "lost"

    @property
    def mistake(self) -> tuple[str, str]:
        """What people call a violation."""
        word = {"lost": "lost", "incorrect": "incorrect", "deduction": "carelessly handled"}[self.kind]
        return f"{word} object", f"{word} objects"

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """A violation for each time, about its object, or that there was none in the task."""
        for thing in item.items:
            subject = f"{item.id}/{thing.id}"
            events = [event for event in counting(trial, self.kind) if event.subject == thing.id]
            yield from _all(trial, self.kind, subject, events)


@dataclass(frozen=True)
class Incidents:
    """Something that must not happen does not.

    Measures:
        How often the referee wrote it down.
    Violated when:
        The referee did; each time is one violation.
    Source:
        Rulebook 2024, Penalties and Collisions.
    """

    also_about: ClassVar[tuple[str, ...]] = (ROBOT,)
    kind: Literal["minor_collision", "major_collision", "tape_collision", "human_interaction", "cheating"] = (
        "minor_collision"
    )

    def needs(self) -> Iterable[SignalNeed]:
        """No signal: the referee is the sensor."""
        return ()

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """A violation for each time, or that there was none."""
        return _all(trial, self.kind, ROBOT, counting(trial, self.kind))


@dataclass(frozen=True)
class Reached:
    """The robot comes to every service area of its tasks, or to the finish.

    Measures:
        Whether the referee saw it there.
    Violated when:
        The referee did not.
    Source:
        Rulebook 2024, Scoring: service areas reached, finish reached.
    """

    part_of: ClassVar[str] = "task"

    mistake: ClassVar[tuple[str, str]] = ("place not reached", "places not reached")

    also_about: ClassVar[tuple[str, ...]] = (ROBOT,)
    what: Literal["service_areas", "finish"] = "service_areas"

    def needs(self) -> Iterable[SignalNeed]:
        """No signal: the referee is the sensor."""
        return ()

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding about each place."""
        places = self._places(trial)
        if not places:
            yield Finding.inconclusive(ROBOT, "no task names a service area", span=trial.window)
        for place in places:
            if "reached" not in trial.witnessed:
                yield Finding.inconclusive(ROBOT, _NOBODY_SAW, span=trial.window, clause=_SOURCE)
                continue
            seen = [event for event in counting(trial, "reached") if event.subject == place]
            if seen:
                yield _at(ROBOT, Verdict.SATISFIED, f"reached {place}", seen[0])
            else:
                yield Finding.violated(ROBOT, f"did not reach {place}", clause=_SOURCE)

    def _places(self, trial: Trial) -> list[str]:
        if self.what == "finish":
            return [FINISH]
        named = {task.facts.get(key) for task in trial.work for key in ("source", "target")}
        return sorted(str(place) for place in named if place is not None)


def _all(trial: Trial, kind: str, subject: str, events: Iterable[Event]) -> Iterator[Finding]:
    """A violation for each event, or that there was none, where the log would have shown it."""
    words = _WORDS.get(kind, kind.replace("_", " "))
    if kind not in trial.witnessed:
        yield Finding.inconclusive(subject, _NOBODY_SAW, span=trial.window, clause=_SOURCE)
        return
    found = [_at(subject, Verdict.VIOLATED, words, event) for event in events]
    yield from found or [Finding.satisfied(subject, f"no {words}", clause=_SOURCE)]


def _at(subject: str, verdict: Verdict, message: str, event: Event) -> Finding:
    return Finding(
        subject,
        verdict,
        f"{message}, at {event.t_s:g} s",
        span=Span(event.t_s, event.t_s),
        clause=_SOURCE,
    )
