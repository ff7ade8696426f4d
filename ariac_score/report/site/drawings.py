"""Drawings of a leaderboard, small enough that hundreds stand in one page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal

__all__ = ["Bar", "Scale", "chances_path", "progress", "scale_of"]

MOST_COLUMNS = 60
"""More ranks than these are drawn together, several to a column."""
CHANCES_HEIGHT = 20


@dataclass(frozen=True)
class Scale:
    """A scale of points, the same for all rows of a table.

    Attributes:
        low: Points at its left end.
        high: Points at its right end.
    """

    low: float
    high: float

    def at(self, value: float | Decimal) -> float:
        """The place of a value, percent of the width."""
        return round(100 * (float(value) - self.low) / ((self.high - self.low) or 1.0), 2)


def scale_of(values: Iterable[float | Decimal | None]) -> Scale:
    """The scale that holds all values, and 0."""
    known = [float(value) for value in values if value is not None]
    return Scale(min([0.0, *known]), max([0.0, *known]))


@dataclass(frozen=True)
class Bar:
    """What the task brought and what safety took of it, percent of the width.

    Attributes:
        left: Where what is left begins.
        kept: How wide it is.
        lost_from: Where what safety took begins.
        lost: How wide that is.
        zero: Where 0 is.
    """

    left: float
    kept: float
    lost_from: float
    lost: float
    zero: float

    @classmethod
    def of(cls, task: Decimal, score: Decimal, scale: Scale) -> Bar:
        """The bar of a score."""
        zero, end, whole = scale.at(0), scale.at(score), scale.at(task)
        low, high = sorted((end, whole))
        return cls(min(zero, end), round(abs(end - zero), 2), low, round(high - low, 2), zero)


def chances_path(chances: Sequence[float]) -> tuple[int, str]:
    """How probable each rank is, as columns of one path, from the first rank on.

    Returns:
        The width of the drawing, whose height is `CHANCES_HEIGHT`, and the path.

    >>> chances_path([0.75, 0.25])
    (2, 'M0 20V5h1V15h1V20z')
    """
    together = -(-len(chances) // MOST_COLUMNS) or 1
    sums = [sum(chances[k : k + together]) for k in range(0, len(chances), together)]
    steps = "".join(f"V{CHANCES_HEIGHT * (1 - min(1.0, share)):.4g}h1" for share in sums)
    return len(sums), f"M0 {CHANCES_HEIGHT}{steps}V{CHANCES_HEIGHT}z"


def progress(
    scores: Sequence[tuple[int, Decimal | None]], scale: Scale, width: float, height: float
) -> tuple[str, tuple[tuple[float, float, int], ...]]:
    """The scores of a team's runs of one trial in the order of their numbers, as a line and its points.

    Args:
        scores: Number and score of each run; a run without a score interrupts the line.
        scale: Of the points.
        width: Of the drawing.
        height: Of the drawing.

    Returns:
        The line as a path, and for each point its place and the number of its run.
    """
    step = width / max(1, len(scores))
    line, points, joined = "", [], False
    for k, (number, score) in enumerate(scores):
        if score is None:
            joined = False
            continue
        x, y = round(step * (k + 0.5), 1), round(height * (1 - scale.at(score) / 100), 1)
        line += f"{'L' if joined else 'M'}{x:g} {y:g}"
        points.append((x, y, number))
        joined = True
    return line, tuple(points)
