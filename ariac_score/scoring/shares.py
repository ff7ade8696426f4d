"""How the change of a product, or of the least of several, is shared out among what changed, exactly.

Numbers are exact, `int` or `Fraction`, until a logarithm is needed; that has 50 digits, correctly rounded,
so that amounts are the same everywhere. docs/ledger.md says why these are the shares.
"""

from __future__ import annotations

from collections.abc import Hashable
from decimal import Decimal
from fractions import Fraction
from functools import lru_cache
from typing import Any, TypeVar

from ariac_score.scoring.decimals import context

__all__ = ["Exact", "divided", "exactly", "graded", "raised", "shares_of_least", "turning"]

Key = TypeVar("Key", bound=Hashable)
"""Whoever gets a share."""

Exact = int | Fraction
"""A number without any rounding."""

_NEAR_ONE = Fraction(1, 10**25)
_LOGARITHMS = context(75)
"""25 digits more than wanted, for those that a ratio near 1 loses."""
_MOST_BITS = 1 << 14
"""Powers with more digits than this are taken in float64: exact ones would fill the memory."""


def exactly(value: Any) -> Exact:
    """A number as the decimal a person reads; 0 for what is no number, such as a text or nothing."""
    if isinstance(value, int | Fraction):
        return int(value) if isinstance(value, int) else value
    if not isinstance(value, float):
        return 0
    return int(value) if value.is_integer() else Fraction(repr(value))


def divided(value: Exact, by: Exact) -> Exact:
    """A quotient, exactly."""
    if by == 1 or not value:
        return value
    found = Fraction(value) / by
    return found.numerator if found.denominator == 1 else found


def raised(base: Exact, power: int) -> Exact:
    """A whole power; 0 where it has no value that a score could have."""
    if power == 1:
        return base
    if base == 0:
        return int(power == 0)
    longest = max(base.numerator.bit_length(), base.denominator.bit_length())
    if longest * abs(power) > _MOST_BITS and base not in (1, -1):
        try:
            return exactly(float(base) ** power)
        except ArithmeticError:
            return 0
    return Fraction(base) ** power


def graded(ends: dict[Key, tuple[Exact, Exact]], before: Exact, after: Exact) -> dict[Key, Exact]:
    """The slope in each factor when all change together: in proportion to the logarithms of the ratios."""
    ratios = {node: Fraction(last) / first for node, (first, last) in ends.items()}
    changed = [node for node, ratio in ratios.items() if ratio != 1]
    steady = [node for node, ratio in ratios.items() if ratio == 1]
    if not changed:
        return {node: divided(before, ends[node][0]) for node in steady}
    if len({ratios[node] for node in changed}) == 1 and not steady:
        shares: dict[Key, Exact] = dict.fromkeys(changed, Fraction(1, len(changed)))
        return {n: divided((after - before) * shares[n], ends[n][1] - ends[n][0]) for n in changed}
    mean = _logarithmic_mean(before, after)
    slopes: dict[Key, Exact] = {}
    for node in changed:
        first, last = ends[node]
        amount = after - before if len(changed) == 1 else mean * _logarithm(ratios[node])
        slopes[node] = divided(amount, last - first)
    return slopes | {node: divided(mean, ends[node][0]) for node in steady}


def _logarithmic_mean(one: Exact, other: Exact) -> Exact:
    return one if one == other else (other - one) / _logarithm(Fraction(other) / one)


@lru_cache(maxsize=1024)
def _logarithm(ratio: Fraction) -> Fraction:
    """The natural logarithm, to 50 digits."""
    more = ratio - 1
    if abs(more) < _NEAR_ONE:  # its digits beside the 1 would be cut off; by the series, to twice as many
        return more - more**2 / 2
    value = _LOGARITHMS.divide(Decimal(ratio.numerator), Decimal(ratio.denominator))
    return Fraction(_LOGARITHMS.ln(value))


def turning(ends: dict[Key, tuple[Exact, Exact]], constant: Exact) -> dict[Key, Exact]:
    """The slopes where a factor changes its sign: the mean over all orders of the factors, exactly.

    The slope in one factor is the integral over t from 0 to 1 of the product of all others, each a
    straight line from its first value to its last (Owen 1972).
    """
    slopes: dict[Key, Exact] = {}
    for node in ends:
        polynomial: list[Exact] = [constant]
        for other, (first, last) in ends.items():
            if other is not node:
                by = last - first
                polynomial = [
                    first * (polynomial[i] if i < len(polynomial) else 0)
                    + by * (polynomial[i - 1] if i else 0)
                    for i in range(len(polynomial) + 1)
                ]
        slopes[node] = sum((Fraction(c) / (i + 1) for i, c in enumerate(polynomial)), start=Fraction(0))
    return slopes


def shares_of_least(lines: dict[Key, tuple[Exact, Exact]]) -> dict[Key, Exact]:
    """For each straight line (value at 0, change until 1) for how much of the way it is the least.

    Lines that are the same share their part equally; where two only cross, neither gets anything for it.
    """
    same: dict[tuple[Exact, Exact], list[Key]] = {}
    for node, line in lines.items():
        same.setdefault(line, []).append(node)
    shares: dict[Key, Exact] = {}
    at: Exact = 0
    current = min(same)  # the least value, of these the steepest fall
    while at < 1:
        value, by = current
        meets = [
            (Fraction(other[0] - value) / (by - other[1]), other[1], other)
            for other in same
            if other[1] < by and other[0] - value < (by - other[1])
        ]
        until, _, following = min(meets, default=(Fraction(1), 0, current))
        for node in same[current]:
            shares[node] = Fraction(until - at) / len(same[current])
        at, current = until, following
    return shares
