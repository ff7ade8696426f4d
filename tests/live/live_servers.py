"""Servers on loopback that send what a recording holds, and waits that end."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ariac_score.live.replay import source_items
from ariac_score.live.source import Announced, Ended, LiveItem, LiveSource, Received
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Connection, Message

EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"
LIMIT_S = 60.0


def recorded(path: Path = EXAMPLE) -> list[Message]:
    """The messages of a recording."""
    items = source_items(open_scan(path, jobs=1))
    return [item.message for item in items if isinstance(item, Received)]


def until(holds: Callable[[], bool], what: str, limit_s: float = LIMIT_S) -> None:
    """Wait until something holds."""
    end_s = time.monotonic() + limit_s
    while not holds():
        assert time.monotonic() < end_s, f"{what}: not within {limit_s:g} s"
        time.sleep(0.01)


def heard(
    source: LiveSource, wanted: Callable[[LiveItem], bool], count: int = 1, limit_s: float = LIMIT_S
) -> list[LiveItem]:
    """The items of a source, up to the last one of so many that are wanted."""
    items, found, end_s = list[LiveItem](), 0, time.monotonic() + limit_s
    while found < count:
        assert time.monotonic() < end_s, f"{found} of {count} within {limit_s:g} s; the last: {items[-3:]}"
        if (item := source.next(0.05)) is not None:
            items.append(item)
            found += wanted(item)
    return items


def is_message(item: LiveItem) -> bool:
    """Whether it is a message."""
    return isinstance(item, Received)


def payloads(items: list[LiveItem], topic: str) -> list[bytes]:
    """What came of a topic."""
    messages = (item.message for item in items if isinstance(item, Received))
    return [bytes(one.payload) for one in messages if one.connection.topic == topic]


def announced(items: list[LiveItem]) -> list[Connection]:
    """The connections that were announced."""
    return [item.connection for item in items if isinstance(item, Announced)]


@contextmanager
def sending(
    subscribed: Callable[[], bool],
    send: Callable[[Message], None],
    messages: Sequence[Message] | None = None,
    pace_s: float = 0.0005,
) -> Iterator[None]:
    """Send messages, by default those of the example, once to each subscriber, from when on it is there."""
    over = threading.Event()

    def run() -> None:
        while not over.wait(0.02):
            if not subscribed():
                continue
            for message in messages or recorded():
                if over.wait(pace_s):
                    return
                send(message)
            while subscribed() and not over.wait(0.02):
                pass

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(LIMIT_S)


class Until:
    """A source that is over when so many messages have come."""

    def __init__(self, source: LiveSource, count: int) -> None:
        self._source, self._left = source, count
        self.address, self.sees_losses, self.stamps = source.address, source.sees_losses, source.stamps
        self.open, self.close = source.open, source.close

    def next(self, timeout_s: float) -> LiveItem | None:
        """The next item."""
        if not self._left:
            return Ended("so many messages have come")
        item = self._source.next(timeout_s)
        self._left -= isinstance(item, Received)
        return item
