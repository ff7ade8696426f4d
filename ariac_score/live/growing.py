"""A recording that is still being written: the path of an MCAP file or a ROS 1 bag, read as it grows."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

from ariac_score.errors import LiveError, LogError, UsageError
from ariac_score.live.replay import source_items
from ariac_score.live.source import Ended, LiveItem
from ariac_score.logs.containers.growing import growing_items
from ariac_score.logs.containers.items import Item

__all__ = ["GrowingSource"]

_POLL_S = 0.02
_SUFFIXES = (".mcap", ".bag", ".active")
_USAGE = "give the path of an .mcap or a .bag (or .bag.active) that is being written, or replay:FILE"


class GrowingSource:
    """Reads a recording while its recorder writes it; it is over when the recorder has closed it.

    Its messages keep their times of recording. A recorder writes in chunks: what it holds back comes late.

    Args:
        address: A path, or `file:PATH`. The file need not be there yet.
        now_s: A clock, s.
        sleep: Waits for so many seconds.

    Raises:
        UsageError: It is no MCAP file and no ROS 1 bag by its name.
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
        self.path = Path(address if Path(address).exists() else address.removeprefix("file:"))
        self._now_s, self._sleep = now_s, sleep
        self._scan: Iterator[Item | None] | None = None
        self._ended: Ended | None = None
        odd = self.path.exists() and not self.path.is_file()  # a folder; a pipe or a device has no end
        if odd or self.path.suffix not in _SUFFIXES:
            raise UsageError("it is no recording that could be read as it grows", file=self.path, hint=_USAGE)

    def open(self, topics: frozenset[str] | None) -> None:  # noqa: ARG002  # a file has all topics
        """Start from the first message."""
        self._scan = None

    def next(self, timeout_s: float) -> LiveItem | None:
        """The next item, when it has been written."""
        if self._ended is not None:
            return self._ended
        until_s = self._now_s() + timeout_s
        while (item := self._poll()) is None:
            left_s = until_s - self._now_s()
            if left_s <= 0:
                return None
            self._sleep(min(_POLL_S, left_s))
        return item

    def _poll(self) -> LiveItem | None:
        try:
            if self._scan is None:
                if not self.path.exists():
                    return None
                if not self.path.is_file():  # it was not there at the start
                    raise LiveError("it is no plain file", file=self.path, hint="name a recording")
                self._scan = growing_items(self.path)
            found = next(self._scan)
        except StopIteration:
            self._ended = Ended("the recorder has closed the recording")
            return self._ended
        except LogError as error:
            self._ended = Ended(str(error))
            return self._ended
        except OSError as error:
            raise LiveError(
                f"cannot be read: {error.strerror}", file=self.path, hint="check the permissions"
            ) from error
        return None if found is None else next(source_items((found,)))

    def close(self) -> None:
        """Read no more."""
        self._ended = self._ended or Ended("it was closed")
        self._scan = None
