"""From the signals of a trial to events: whom a specification is judged for, and what happened to them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from ariac_score import QUANTITIES, Sample, Signal, Span, Trial, align, uncovered_spans
from ariac_score_rml.columns import Topic

__all__ = ["Recorded", "TopicSource", "subjects", "topic_sources"]

_SOURCE = re.compile(r"(?P<signal>[^\s\[]+)(?:\s*\[(?P<unit>[^\]]+)\])?")


@dataclass(frozen=True)
class FieldSource:
    """The signal of a field, with `{robot}` and `{human}` to be filled in."""

    signal: str
    unit: str

    @property
    def quantity(self) -> str:
        """What is measured."""
        return self.signal.partition("/")[0]

    @property
    def pair(self) -> str:
        """Of which two it is, of whatever kinds; empty where it is of one."""
        subject = self.signal.partition("/")[2]
        return subject if "/" in subject else ""


@dataclass(frozen=True)
class TopicSource:
    """The signals of the fields of a topic."""

    name: str
    fields: Mapping[str, FieldSource]

    def signals(self, names: Mapping[str, str]) -> dict[str, str]:
        """The signal of each field, for a subject whose bodies have these names."""
        return {key: source.signal.format(**names) for key, source in self.fields.items()}


def topic_sources(events: Mapping[str, Mapping[str, str]]) -> list[TopicSource]:
    """The topics of the parameter `events`.

    Raises:
        ValueError: A field is no signal of one number in a known unit.
    """
    return [
        TopicSource(name, {key: _source(text) for key, text in fields.items()})
        for name, fields in events.items()
    ]


def _source(text: str) -> FieldSource:
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
    return FieldSource(found["signal"], unit)


def subjects(trial: Trial, topics: Sequence[TopicSource]) -> Iterator[tuple[str, Mapping[str, str]]]:
    """Whom a specification is judged for, and the bodies in the names of their signals."""
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


@dataclass(frozen=True)
class Recorded:
    """The events of one topic in the competition.

    Attributes:
        topic: Times and fields.
        signals: The signal of each field.
        gaps: Stretches of the competition without events.
    """

    topic: Topic
    signals: Mapping[str, Signal]
    gaps: Sequence[Span]

    @classmethod
    def of(cls, trial: Trial, source: TopicSource, names: Mapping[str, str], max_gap_s: float) -> Recorded:
        """The events of a topic: the samples of its signals on one time base.

        Raises:
            MissingSignalError: A field's signal is not in the log.
        """
        signals = {
            key: trial.signal(name, unit=source.fields[key].unit)
            for key, name in source.signals(names).items()
        }
        t, columns = align(list(signals.values()), max_gap_s=max_gap_s)
        gaps: Sequence[Span] = ()
        if (window := trial.window) is not None:
            inside = slice(t.searchsorted(window.start_s), t.searchsorted(window.end_s, "right"))
            t, columns = t[inside], [column[inside] for column in columns]
            holes = [hole for signal in signals.values() for hole in signal.holes]
            gaps = uncovered_spans(t, window, max_gap_s=max_gap_s, holes=holes)
        return cls(Topic(source.name, t, dict(zip(signals, columns, strict=True))), signals, gaps)

    def samples(self, row: int) -> tuple[Sample, ...]:
        """What was measured in one event, as evidence."""
        t_s = float(self.topic.t[row])
        return tuple(
            Sample(signal.name, t_s, float(self.topic.fields[key][row]), signal.unit)
            for key, signal in self.signals.items()
        )

    def unit(self, field: int) -> str:
        """The unit of a field by its number; that of none is empty."""
        return list(self.signals.values())[field].unit if field >= 0 else ""
