"""Which clock the times of a log come from: whether times of two logs can be compared."""

from __future__ import annotations

import re
from dataclasses import dataclass

__all__ = ["LOG_TIME", "SIMULATED_TIME", "WALL_CLOCK_TIME", "Clock"]

LOG_TIME = "log time"
SIMULATED_TIME = "simulated time"
WALL_CLOCK_TIME = "wall-clock time"

_TEXT = re.compile(
    r"(?P<kind>.+?)(?:, origin (?P<origin_ns>0|[1-9][0-9]{0,18}) ns)?(?: \((?P<detail>.+)\))?", re.DOTALL
)


@dataclass(frozen=True)
class Clock:
    """The clock that times of a log come from.

    Attributes:
        kind: What it shows, such as `log time`. Times of two logs can be compared where this is the same.
        origin_ns: Its time at trial time 0, ns; `None` where trial time is its own time, or nobody knows.
        detail: How the times were taken from it, in words; may be empty.

    >>> str(Clock("log time", 1_700_000_000_000_000_000))
    'log time, origin 1700000000000000000 ns'
    """

    kind: str
    origin_ns: int | None = None
    detail: str = ""

    def __str__(self) -> str:
        """In words, as results store it."""
        origin = "" if self.origin_ns is None else f", origin {self.origin_ns} ns"
        return f"{self.kind}{origin}" + (f" ({self.detail})" if self.detail else "")

    @classmethod
    def parse(cls, text: str) -> Clock:
        """The clock that a file names in words; text in no known form names a kind.

        >>> Clock.parse("log time, origin 7 ns"), Clock.parse("simulated time (by hand)").detail
        (Clock(kind='log time', origin_ns=7, detail=''), 'by hand')
        """
        found = _TEXT.fullmatch(text)
        if found is None:  # empty
            return cls(text)
        origin = found["origin_ns"]
        return cls(found["kind"], None if origin is None else int(origin), found["detail"] or "")
