"""The latest messages of a trial that goes on, and of those that say more than motion all there were."""

from __future__ import annotations

from collections import deque
from heapq import merge
from pathlib import Path

from ariac_score.checks.contracts import Wanted
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.logs.rosbag import RecordingIntake
from ariac_score.trial.channels import Channel

__all__ = ["Recent", "is_motion"]

_FEW = 32
"""So many of a connection are always kept: transforms that never change, flags that seldom do."""

Numbered = tuple[int, Message]


def is_motion(channel: Channel, wanted: Wanted) -> bool:
    """Whether a channel gives where bodies are and what else is sampled, and nothing that happened."""
    if channel.whole or channel.as_consumed or channel.topic.endswith("tf_static"):
        return False
    return not (channel.poses == "models" and wanted.tracks is not None)


class Recent:
    """Messages in the order in which they came, without those of motion that are over.

    Args:
        wanted: What the log map and the checks need.

    Attributes:
        began_ns: The earliest time of recording of any message that came, ns.
        latest_ns: The latest.
    """

    def __init__(self, wanted: Wanted) -> None:
        self._wanted = wanted
        self._kept: dict[Connection, deque[Numbered]] = {}
        self._motion: set[Connection] = set()
        self._number = 0
        self.began_ns: int | None = None
        self.latest_ns = 0

    def take(self, item: Connection | Message) -> None:
        """Take one item."""
        if isinstance(item, Connection):
            self._kept[item] = deque()
            channels = [c for c in self._wanted.log_map.channels if _names(c, item)]
            if all(is_motion(channel, self._wanted) for channel in channels):
                self._motion.add(item)
            return
        self._number += 1
        self._kept[item.connection].append((self._number, item))
        if self.began_ns is None:
            self.began_ns = self.latest_ns = item.stamp_ns
        self.began_ns, self.latest_ns = min(self.began_ns, item.stamp_ns), max(self.latest_ns, item.stamp_ns)

    def forget(self, before_ns: int) -> None:
        """Let go of motion before a time of recording, but for the latest few messages."""
        for connection in self._motion:
            kept = self._kept[connection]
            while len(kept) > _FEW and kept[0][1].stamp_ns < before_ns:
                kept.popleft()

    @property
    def topics(self) -> frozenset[str]:
        """Of which there are messages, without leading slash."""
        return frozenset(c.topic.lstrip("/") for c, kept in self._kept.items() if kept)

    def intake(self, wanted: Wanted, file: Path) -> RecordingIntake:
        """What is kept, taken in as if it were a recording that began when the first message came."""
        intake = RecordingIntake(wanted, file)
        intake.statistics.began_ns = self.began_ns
        for connection in self._kept:
            intake.take(connection)
        for _, message in merge(*self._kept.values(), key=_number_of):
            intake.take(message)
        return intake


def _number_of(one: Numbered) -> int:
    return one[0]


def _names(channel: Channel, connection: Connection) -> bool:
    return channel.topic.lstrip("/") == connection.topic.lstrip("/")
