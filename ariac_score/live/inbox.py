"""What threads that listen hand to the one that judges: bounded, and what it cannot keep is named."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass, field

from ariac_score.live.source import LiveItem, Lost, Received

__all__ = ["Inbox"]

_MOST_MESSAGES = 50_000
_MOST_BYTES = 1 << 29


@dataclass
class _Dropped:
    """Messages that found no room, by topic: how many, and when the first and the last one came."""

    of: dict[str, tuple[int, int, int]] = field(default_factory=dict)

    def add(self, topic: str, stamp_ns: int) -> None:
        count, first_ns, _ = self.of.get(topic, (0, stamp_ns, 0))
        self.of[topic] = count + 1, first_ns, stamp_ns

    def items(self) -> list[LiveItem]:
        cause = "they came faster than they were judged"
        return [
            Lost(topic, since_ns, until_ns, cause, n) for topic, (n, since_ns, until_ns) in self.of.items()
        ]


class Inbox:
    """A bounded queue of items; a message without room is dropped, and given as `Lost` at its place.

    Args:
        most_messages: Room for so many.
        most_bytes: Room for so many bytes of them; one message may be larger where nothing else waits.
    """

    def __init__(self, most_messages: int = _MOST_MESSAGES, most_bytes: int = _MOST_BYTES) -> None:
        self._most_messages, self._most_bytes = most_messages, most_bytes
        self._items: deque[LiveItem | _Dropped] = deque()
        self._messages = self._bytes = 0
        self._changed = threading.Condition()

    def put(self, item: LiveItem) -> None:
        """Add an item; it never waits."""
        with self._changed:
            if isinstance(item, Received) and not self._has_room_for(item):
                if not self._items or not isinstance(self._items[-1], _Dropped):
                    self._items.append(_Dropped())
                dropped = self._items[-1]
                assert isinstance(dropped, _Dropped)
                dropped.add(item.message.connection.topic, item.message.stamp_ns)
                return
            if isinstance(item, Received):
                self._messages += 1
                self._bytes += len(item.message.payload)
            self._items.append(item)
            self._changed.notify()

    def get(self, timeout_s: float) -> LiveItem | None:
        """The next item; `None` where none came in so many seconds."""
        with self._changed:
            if not self._items:
                self._changed.wait(timeout_s)
            if not self._items:
                return None
            item = self._items.popleft()
            if isinstance(item, _Dropped):
                first, *others = item.items()
                self._items.extendleft(reversed(others))
                return first
            if isinstance(item, Received):
                self._messages -= 1
                self._bytes -= len(item.message.payload)
            return item

    def _has_room_for(self, item: Received) -> bool:
        if not self._messages:
            return True
        size = self._bytes + len(item.message.payload)
        return self._messages < self._most_messages and size <= self._most_bytes
