"""From a number to a place on a drawing, and round numbers for its ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["Scale", "ticks"]


def ticks(low: float, high: float, most: int = 8) -> tuple[float, ...]:
    """Round numbers from low to high, at most about `most`, in steps of 1, 2 or 5 times a power of ten.

    >>> ticks(0.5, 38.0, 8)
    (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 35.0)
    """
    if not high > low:
        return (low,)
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next((power * m for m in (1, 2, 5) if power * m >= rough * (1 - 1e-9)), power * 10)
    # The small tolerance keeps a tick at the very end, which rounding may put just beyond it.
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    # Adding 0.0 turns -0.0 into 0.0, which would be labelled "-0".
    return tuple(round(k * step, 10) + 0.0 for k in range(first, last + 1))


@dataclass(frozen=True)
class Scale:
    """A range of numbers laid out over a width of 100 percent."""

    start: float
    end: float

    def at(self, value: float) -> float:
        """Where a number lies, percent, within the drawing.

        >>> Scale(0.0, 40.0).at(10.0)
        25.0
        """
        share = (value - self.start) / (self.end - self.start)
        return round(100 * min(max(share, 0.0), 1.0), 4)

    def stretch(self, first: float, last: float) -> tuple[float, float]:
        """Where a stretch begins and how long it is, percent."""
        left = self.at(first)
        return left, round(self.at(last) - left, 4)

    @property
    def ticks(self) -> tuple[tuple[float, float], ...]:
        """Round numbers and where they lie."""
        return tuple((value, self.at(value)) for value in ticks(self.start, self.end))
