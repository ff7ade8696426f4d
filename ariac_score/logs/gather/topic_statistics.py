"""Topics, message counts and stamps of a recording, counted while it is scanned."""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from ariac_score.checks.contracts import TopicDescription
from ariac_score.logs.containers.items import Batch, Connection, IntArray, Message

__all__ = ["TopicStatistics"]


@dataclass
class _Topic:
    types: set[str] = field(default_factory=set)
    stamps_ns: array[int] = field(default_factory=lambda: array("q"))


class TopicStatistics:
    """Counts topics, messages and stamps while a recording is scanned.

    Attributes:
        messages: How many.
        began_ns: Stamp of the first message, ns, where it is not among those that are counted.
    """

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}
        self.messages = 0
        self._latest_ns = self._largest_step_back_ns = 0
        self.began_ns: int | None = None

    def declare(self, connection: Connection) -> None:
        """Count a topic, even when no message follows."""
        self._topics.setdefault(connection.topic, _Topic()).types.add(connection.type)

    def count(self, message: Message) -> None:
        """Count a message of a declared connection."""
        self.messages += 1
        self._topics[message.connection.topic].stamps_ns.append(message.stamp_ns)
        self._largest_step_back_ns = max(self._largest_step_back_ns, self._latest_ns - message.stamp_ns)
        self._latest_ns = max(self._latest_ns, message.stamp_ns)

    def count_many(self, batch: Batch) -> None:
        """Count many messages of declared connections."""
        self.messages += len(batch)
        if len(batch):
            latest_ns = np.maximum(np.maximum.accumulate(batch.stamps_ns), self._latest_ns)
            self._largest_step_back_ns = max(
                self._largest_step_back_ns, int((latest_ns - batch.stamps_ns).max())
            )
            self._latest_ns = int(latest_ns[-1])
        for place, connection in enumerate(batch.connections):
            stamps_ns = batch.stamps_ns[batch.sources == place]
            self._topics[connection.topic].stamps_ns.frombytes(stamps_ns.tobytes())

    def has(self, topic: str) -> bool:
        """Whether the recording has a topic of that name."""
        return topic in self._topics

    @property
    def first_ns(self) -> int | None:
        """The earliest stamp of all, ns; `None` without messages."""
        counted = (int(stamps_ns.min()) for stamps_ns in self._stamps_ns())
        return min((*counted, *(() if self.began_ns is None else (self.began_ns,))), default=None)

    @property
    def last_ns(self) -> int | None:
        """The latest stamp of all, ns; `None` without messages."""
        return max((int(s.max()) for s in self._stamps_ns()), default=None)

    def _stamps_ns(self) -> Iterator[IntArray]:
        """The stamps of every topic that has messages."""
        for topic in self._topics.values():
            if topic.stamps_ns:
                yield np.frombuffer(topic.stamps_ns, dtype=np.int64)

    @property
    def duration_s(self) -> float:
        """From the earliest to the latest stamp, s; 0 without messages."""
        return ((self.last_ns or 0) - (self.first_ns or 0)) / 1e9

    def topics(self) -> tuple[TopicDescription, ...]:
        """The topics sorted by name, times relative to the earliest stamp of all."""
        origin_ns = self.first_ns or 0
        return tuple(_described(name, self._topics[name], origin_ns) for name in sorted(self._topics))

    def steps_back(self) -> Iterator[tuple[str, int]]:
        """The topics whose stamps run backwards, each with how often, sorted by topic."""
        for name in sorted(self._topics):
            stamps = np.frombuffer(self._topics[name].stamps_ns, dtype=np.int64)
            steps = int((np.diff(stamps) < 0).sum())
            if steps:
                yield name, steps

    @property
    def largest_step_back_s(self) -> float:
        """The most by which a message was recorded earlier than one before it in the file, s."""
        return self._largest_step_back_ns / 1e9

    @property
    def silent_but_one(self) -> bool:
        """Whether one topic alone has messages, of several that are declared."""
        heard = sum(1 for topic in self._topics.values() if topic.stamps_ns)
        return heard == 1 < len(self._topics)

    def words(self) -> str:
        """Such as `4 topics, 3012 messages, 0.00 s to 30.10 s`."""
        counted = f"{len(self._topics)} topics, {self.messages} messages"
        return f"{counted}, 0.00 s to {self.duration_s:.2f} s" if self.messages else counted


def _described(name: str, topic: _Topic, origin_ns: int) -> TopicDescription:
    type_ = ", ".join(sorted(topic.types))
    if not topic.stamps_ns:
        return TopicDescription(name, type_, 0)
    # Sorted: several publishers of one topic reach the recorder in no particular order.
    stamps = np.sort(np.frombuffer(topic.stamps_ns, dtype=np.int64))
    gap_s = int(np.diff(stamps).max()) / 1e9 if len(stamps) > 1 else None
    first_s, last_s = ((int(stamp) - origin_ns) / 1e9 for stamp in (stamps[0], stamps[-1]))
    return TopicDescription(name, type_, len(stamps), first_s, last_s, gap_s)
