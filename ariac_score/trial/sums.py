"""Sums that enter a result: exact, then rounded once."""

from __future__ import annotations

import math
from collections.abc import Iterable

from ariac_score.trial.spans import FloatArray

__all__ = ["exact_sum"]


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
    except OverflowError:  # of a partial sum, even where the whole is finite
        return math.fsum(math.ldexp(number, -_HEADROOM) for number in plain) * 2.0**_HEADROOM


_HEADROOM = 64
"""More numbers than 2 ** 64 are never added up."""
