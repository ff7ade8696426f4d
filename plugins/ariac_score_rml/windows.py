"""The events of one subject, window by window of time: what is held does not grow with the trial."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np

from ariac_score import Aligned, Sample, Signal, Span, gaps_between
from ariac_score_rml.columns import FloatArray, Stream, Topic

__all__ = ["WINDOW_EVENTS", "Events", "Part", "Recorded"]

WINDOW_EVENTS = 65_536
"""About so many events are judged at once: ten minutes at 100 Hz."""


class Recorded:
    """The events of one topic in the competition.

    Args:
        name: What the topic is called.
        signals: The signal that each field is.
        window: The competition; `None`: all samples count.
        max_gap_s: Longest stretch between two samples that is interpolated, s.

    Attributes:
        name: As given.
        signals: As given.
        gaps: Stretches of the competition without events.
        aligned: The samples that the events are.
    """

    def __init__(
        self, name: str, signals: Mapping[str, Signal], window: Span | None, *, max_gap_s: float
    ) -> None:
        self.name, self.signals = name, signals
        self.aligned = Aligned(signals, window, max_gap_s=max_gap_s)
        self.gaps: Sequence[Span] = []
        if window is not None:
            self.gaps = gaps_between(self.aligned.stretches(), window, max_gap_s=max_gap_s)

    def topic(self, first: int, last: int) -> Topic:
        """The events of the samples from one to before another."""
        return Topic(self.name, self.aligned.times(first, last), self.aligned.columns(first, last))

    def time(self, row: int) -> float | None:
        """When a sample was, s; `None` after the last one."""
        if row >= len(self.aligned):
            return None
        return float(self.aligned.times(row, row + 1)[0])


@dataclass(frozen=True, eq=False)
class Part:
    """The events of one window.

    Attributes:
        number: Which window it is.
        first: How many events there are before it.
        stream: Its events.
        until_s: Of each topic the time of the first event after it; `None` where there is none.
    """

    number: int
    first: int
    stream: Stream
    until_s: tuple[float | None, ...]


class Events:
    """The events of all topics of a subject, cut into windows of time.

    Args:
        recorded: The topics.

    Attributes:
        recorded: As given.
    """

    def __init__(self, recorded: Sequence[Recorded]) -> None:
        self.recorded = tuple(recorded)
        counts = self._before(inf)
        self._rows = [(0,) * len(counts)]
        """Of each topic the first sample of each window; at last the number of samples."""
        if sum(counts) > WINDOW_EVENTS:
            self._cut()
        self._rows.append(counts)

    def _cut(self) -> None:
        """Begin a window where the one before has enough events."""
        cuts_s = np.unique(np.concatenate([one.aligned.cuts for one in self.recorded])).tolist()
        begun, last = 0, self._rows[0]
        for rows in (*(self._before(cut_s) for cut_s in cuts_s), self._before(inf)):
            if sum(rows) - begun > WINDOW_EVENTS and sum(last) > begun:
                self._rows.append(last)
                begun = sum(last)
            last = rows

    def _before(self, t_s: float) -> tuple[int, ...]:
        """How many samples each topic has before a time."""
        return tuple(one.aligned.row(t_s) for one in self.recorded)

    def __len__(self) -> int:
        """The number of events."""
        return sum(self._rows[-1])

    @property
    def windows(self) -> int:
        """The number of windows."""
        return len(self._rows) - 1

    def part(self, number: int) -> Part:
        """The events of a window."""
        first, last = self._rows[number], self._rows[number + 1]
        stream = Stream([one.topic(a, b) for one, a, b in zip(self.recorded, first, last, strict=True)])
        until_s = tuple(one.time(row) for one, row in zip(self.recorded, last, strict=True))
        return Part(number, sum(first), stream, until_s)

    def times(self) -> Iterator[FloatArray]:
        """The different times of the events, window by window, s."""
        for first, last in pairwise(self._rows):
            parts = [one.aligned.times(a, b) for one, a, b in zip(self.recorded, first, last, strict=True)]
            yield np.unique(np.concatenate(parts))

    def time(self, number: int) -> float:
        """When an event was, by its number, s."""
        window = bisect_right([sum(rows) for rows in self._rows], number) - 1
        part = self.part(window)
        return float(part.stream.t[number - part.first])

    def samples(self, topic: int, t_s: float) -> tuple[Sample, ...]:
        """What was measured in the event of a topic at a time, as evidence."""
        recorded = self.recorded[topic]
        row = recorded.aligned.row(t_s)
        values = recorded.aligned.columns(row, row + 1)
        return tuple(
            Sample(signal.name, t_s, float(values[key][0]), signal.unit)
            for key, signal in recorded.signals.items()
        )
