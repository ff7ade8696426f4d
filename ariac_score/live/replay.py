"""A recording played again as if its cell were running: `replay:FILE?speed=2`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Literal

from ariac_score.errors import LogError, UsageError
from ariac_score.live.source import Announced, Ended, LiveItem, Received
from ariac_score.logs.containers.detect import looks_like_recording, open_scan
from ariac_score.logs.containers.items import Batch, Item, Message

__all__ = ["ReplaySource", "messages_of", "source_items"]

_USAGE = "give replay:FILE, or replay:FILE?speed=2 for twice as fast; speed=0 is as fast as can be"


class ReplaySource:
    """Plays a ROS recording again, at any speed; its messages keep their times of recording.

    Args:
        address: `replay:FILE?speed=X`; X is 1 unless it is given, and 0 for as fast as can be.
        now_s: A clock, s.
        sleep: Waits for so many seconds.

    Raises:
        UsageError: There is no such recording, or the speed is none.
    """

    sees_losses = True
    stamps: Literal["arrival", "recorder"] = "recorder"

    def __init__(
        self,
        address: str,
        *,
        now_s: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.address = address
        name, _, options = address.removeprefix("replay:").partition("?")
        self.path, self.speed = Path(name), _speed(options)
        self._now_s, self._sleep = now_s, sleep
        self._items: Iterator[LiveItem] = iter(())
        self._waiting: LiveItem | None = None
        self._origin: tuple[float, int] | None = None
        self._ended = Ended("the recording is over")
        if not _is_recording(self.path):
            raise UsageError(
                "it is no ROS recording that could be played again",
                file=self.path,
                hint=f"{_USAGE}; other logs are scored by 'ariac-score score'",
            )

    def open(self, topics: frozenset[str] | None) -> None:  # noqa: ARG002
        """Start from the first message, with all topics: the trial lasts from the first message of any."""
        self._items = source_items(open_scan(self.path, jobs=1))

    def next(self, timeout_s: float) -> LiveItem | None:
        """The next item, when its time has come."""
        if self._waiting is None:
            try:
                self._waiting = next(self._items, self._ended)
            except LogError as error:  # what was read up to there is judged, and the fault said
                self._items = iter(())
                self._waiting = self._ended = Ended(str(error))
        wait_s = self._due_in_s(self._waiting)
        if wait_s > timeout_s:
            self._sleep(timeout_s)
            return None
        if wait_s > 0:
            self._sleep(wait_s)
        item, self._waiting = self._waiting, None
        return item

    def close(self) -> None:
        """Read no more."""
        self._items = iter(())

    def _due_in_s(self, item: LiveItem) -> float:
        if not isinstance(item, Received) or not self.speed:
            return 0.0
        stamp_ns = item.message.stamp_ns
        if self._origin is None:
            self._origin = self._now_s(), stamp_ns
        start_s, first_ns = self._origin
        return start_s + (stamp_ns - first_ns) / 1e9 / self.speed - self._now_s()


def source_items(items: Iterable[Item]) -> Iterator[LiveItem]:
    """What a scan yields, as a live source gives it: messages one by one, each with bytes of its own."""
    for item in items:
        if isinstance(item, Batch):
            yield from map(Received, messages_of(item))
        elif isinstance(item, Message):
            yield Received(item._replace(payload=bytes(item.payload)))
        else:
            yield Announced(item)


def messages_of(batch: Batch) -> Iterator[Message]:
    """The messages of a batch with their numbers, each with bytes of its own."""
    sequences = [0] * len(batch) if batch.sequences is None else batch.sequences.tolist()
    for message, sequence in zip(batch.messages(), sequences, strict=True):
        yield message._replace(payload=bytes(message.payload), sequence=sequence)


def _is_recording(path: Path) -> bool:
    try:
        return looks_like_recording(path)
    except OSError:
        return False


def _speed(options: str) -> float:
    name, _, text = options.partition("=")
    try:
        speed = float(text) if options else 1.0
    except ValueError:
        speed = -1.0
    if name not in ("", "speed") or not 0 <= speed < 1e9:
        raise UsageError(f"{options!r} is no speed", hint=_USAGE)
    return speed
