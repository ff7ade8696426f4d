"""The score as bars over one scale: what the work was worth, what safety took, what is left."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal

from ariac_score.results.result import Result
from ariac_score.review.task_and_safety import TaskAndSafety

__all__ = ["Bar", "Parts", "parts_of"]


@dataclass(frozen=True)
class Bar:
    """One bar.

    Attributes:
        kind: `task`, `safety` or `score`.
        label: In words.
        amount: In points, exact.
        left: Where it begins, percent of the width.
        width: How long it is, percent of the width.
        has_possible: Whether it is what the most that could have been earned is compared with.
        whisker: Between which ends the amount may lie, percent of the width; `None` where it is known.
    """

    kind: str
    label: str
    amount: Decimal
    left: float
    width: float
    has_possible: bool = False
    whisker: tuple[float, float] | None = None


@dataclass(frozen=True)
class Parts:
    """The bars, from above, over one scale.

    Attributes:
        bars: Task and safety as far as the rules have them, then the score.
        zero: Where zero lies, percent of the width.
        possible: Where the most lies that could have been earned, percent; `None` where nobody can say.
        split: The two parts.
    """

    bars: tuple[Bar, ...]
    zero: float
    possible: float | None
    split: TaskAndSafety


def parts_of(result: Result, split: TaskAndSafety) -> Parts:
    """The bars of a scored trial."""
    score = split.task + split.safety
    ends = [Decimal(0), split.task, score, *([] if result.possible is None else [result.possible])]
    interval = result.interval
    ends += [] if interval is None else [interval.least, interval.most]
    low, room = min(ends), (max(ends) - min(ends)) or Decimal(1)

    def at(points: Decimal) -> float:
        return round(float(100 * (points - low) / room), 3)

    def bar(kind: str, label: str, amount: Decimal, start: Decimal, end: Decimal) -> Bar:
        left, right = sorted((at(start), at(end)))
        first = kind == "task" or (kind == "score" and not split.has_safety)
        open_ = None if interval is None or kind != "score" else (at(interval.least), at(interval.most))
        return Bar(kind, label, amount, left, round(right - left, 3), first, open_)

    zero = Decimal(0)
    bars = []
    if split.has_safety:
        bars.append(bar("task", "Task" if split.has_task else "Before safety", split.task, zero, split.task))
        bars.append(bar("safety", "Safety", split.safety, split.task, score))
    bars.append(bar("score", "Score" if split.has_safety else "Task", score, zero, score))
    return Parts(tuple(bars), at(zero), None if result.possible is None else at(result.possible), split)
