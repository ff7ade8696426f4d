"""Sums that enter a result: exact, then rounded once."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ariac_score.trial.spans import FloatArray

__all__ = ["Total", "exact_sum"]


def exact_sum(numbers: FloatArray | Iterable[float]) -> float:
    """The float nearest to the exact sum, whatever the order of the numbers.

    Why not `numpy.sum`: it adds in an order of its own, which differs between its versions
    and with the layout of an array, and so do the last bits.

    Args:
        numbers: Shape (n,), or any floats; 0 where there are none.

    >>> exact_sum([1e16, 1.0, -1e16, 1.0])
    2.0
    """
    plain: Iterable[float] = numbers.tolist() if hasattr(numbers, "tolist") else list(numbers)
    try:
        return math.fsum(plain)
    except OverflowError:  # of a part of the sum, if not of the whole
        return math.fsum(math.ldexp(number, -_HEADROOM) for number in plain) * 2.0**_HEADROOM


_HEADROOM = 64
"""More numbers than 2 ** 64 are never added up."""


class Total:
    """The exact sum of numbers that come in parts, wherever the parts begin.

    >>> total = Total()
    >>> total.take(np.array([1e16, 1.0])), total.take(np.array([-1e16, 1.0])), total.value
    (None, None, 2.0)

    Args:
        _count: How many will come, which the sum does not depend on.
    """

    def __init__(self, _count: int = 0) -> None:
        self._parts: list[float] = []
        """The exact sum as one of few floats, each what rounding left over of those before it."""

    def take(self, numbers: FloatArray) -> None:
        """The next numbers."""
        rest, self._parts = [*self._parts, *numbers.tolist()], []
        while part := exact_sum(rest):
            self._parts.append(part)
            if not math.isfinite(part):
                return
            rest.append(-part)

    @property
    def value(self) -> float:
        """The sum of what has come."""
        return exact_sum(self._parts)
