"""The score that the simulators of 2017 to 2022 publish in development mode, and what each step of it says.

It is the total of the scorer, ten times a second and without a stamp. It rises when something of worth is
handed in, falls when a product drops to the floor (2021 and 2022), and is nothing once arms have touched.

Source: `PublishStatus` and `OnUpdate` of the task managers; ARIAC notes on recording, sections 0 and 1.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, ClassVar

from ariac_score import Record

__all__ = ["CurrentScore", "Rise", "ScoreSeen", "ScoreSteps"]

_SETTLED_S = 0.3
"""What is handed in is counted in the next step, and published within a tenth of a second."""
_LONGEST_GAP_S = 0.5
"""Beyond it messages are missing."""


@dataclass(frozen=True)
class ScoreSeen(Record):
    """The score at one instant.

    Attributes:
        t_s: When it was received, s of trial time.
        points: The total so far.
    """

    timed: ClassVar[bool] = True

    t_s: float
    points: float

    def shifted(self, by_s: float) -> ScoreSeen:
        """The same message on another clock."""
        return replace(self, t_s=self.t_s + by_s)


class CurrentScore:
    """Decodes `/ariac/current_score`."""

    def decode(self, msgtype: str, message: Any, t_s: float) -> ScoreSeen | None:
        """The score; `None` for other types.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: When it was received, s of trial time.
        """
        return ScoreSeen(t_s, float(message.data)) if msgtype == "std_msgs/msg/Float32" else None


@dataclass(frozen=True)
class Rise:
    """The score rose.

    Attributes:
        start_s, end_s: Between these two messages, s of trial time.
        least, most: By how many points what was handed in raised it, with what may have been dropped at once.
    """

    start_s: float
    end_s: float
    least: float
    most: float


class ScoreSteps:
    """How the score changed while nothing else but what was handed in, and what was dropped, could change it.

    Args:
        seen: The messages.
        until_s: When arms touched first, or the competition ended, s of trial time.
        unseen_drops: How many points may have been lost to drops that no step shows; infinite: nobody says.
    """

    def __init__(self, seen: Iterable[ScoreSeen], *, until_s: float, unseen_drops: float) -> None:
        messages = sorted(seen, key=lambda message: message.t_s)
        self._messages = [message for message in messages if message.t_s < until_s]
        falls = sum(max(a.points - b.points, 0.0) for a, b in pairwise(self._messages))
        if falls > unseen_drops:  # nothing lowers it so far: somebody else publishes it as well
            self._messages = []
        self._times = [message.t_s for message in self._messages]
        self._unseen = max(unseen_drops - falls, 0.0)
        self._until_s = until_s

    def worth(self, t_s: float, others_s: Sequence[float]) -> tuple[float, float] | None:
        """Least and most that what was handed in at a time was worth; `None` where that cannot be told.

        Args:
            t_s: When it was handed in, s of trial time.
            others_s: When anything else was.
        """
        first = bisect_right(self._times, t_s) - 1
        last = bisect_left(self._times, t_s + _SETTLED_S)
        if first < 0 or last == len(self._times) or not self._is_whole(first, last):
            return None
        before, after = self._messages[first], self._messages[last]
        if any(before.t_s - _SETTLED_S <= other_s <= after.t_s for other_s in others_s):
            return None
        least = max(after.points - before.points, 0.0)
        return least, least + self._unseen

    def rises(self, apart_from_s: Sequence[float]) -> list[Rise]:
        """Steps upwards that none of what was handed in at these times explains."""
        return [
            Rise(a.t_s, b.t_s, b.points - a.points, b.points - a.points + self._unseen)
            for a, b in pairwise(self._messages)
            if b.points > a.points
            and b.t_s - a.t_s <= _LONGEST_GAP_S
            and not any(a.t_s - _SETTLED_S <= t_s <= b.t_s for t_s in apart_from_s)
        ]

    def are_all(self, apart_from_s: Sequence[float]) -> bool:
        """Whether the score was seen until the end and rose only by what was handed in at these times."""
        return self._reach_the_end and not any(
            b.points > a.points and not any(a.t_s - _SETTLED_S <= t_s <= b.t_s for t_s in apart_from_s)
            for a, b in pairwise(self._messages)
        )

    @property
    def show_no_contact(self) -> bool:
        """Whether arms cannot have touched, for the score is not nothing at the end."""
        return self._reach_the_end and self._messages[-1].points > 0

    @property
    def _reach_the_end(self) -> bool:
        return bool(self._messages) and self._messages[-1].t_s >= self._until_s - _LONGEST_GAP_S

    def _is_whole(self, first: int, last: int) -> bool:
        return all(self._times[i + 1] - self._times[i] <= _LONGEST_GAP_S for i in range(first, last))
