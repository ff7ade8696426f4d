"""Numbers as people say them: as many digits as mean something."""

from __future__ import annotations

import math
from decimal import ROUND_HALF_EVEN, Decimal

__all__ = ["amount_text", "count_in_words", "rounded_points", "said"]

_WORDS = (
    *("no", "one", "two", "three", "four", "five", "six"),
    *("seven", "eight", "nine", "ten", "eleven", "twelve"),
)


def amount_text(amount: Decimal, *, sign: bool = False) -> str:
    """An amount without trailing zeros.

    >>> amount_text(Decimal("-3.500000")), amount_text(Decimal("28.000000"), sign=True)
    ('-3.5', '+28')
    """
    text = f"{amount:f}"
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return f"+{text}" if sign and amount > 0 else text


def count_in_words(count: int, one: str = "", many: str = "") -> str:
    """A number of things; up to twelve as a word.

    >>> count_in_words(2, "shipment", "shipments"), count_in_words(1, "part", "parts"), count_in_words(40)
    ('two shipments', 'one part', '40')
    """
    word = _WORDS[count] if 0 <= count < len(_WORDS) else str(count)
    return " ".join(filter(None, (word, one if count == 1 else many)))


def rounded_points(points: Decimal, digits: int, decimals: int = 2) -> Decimal:
    """Points for a headline: with so many decimals, or more where fewer would leave under three digits.

    Args:
        points: Exact.
        digits: Most decimals, as the rule set rounds.
        decimals: Wanted.

    >>> rounded_points(Decimal("19.761677"), 6), rounded_points(Decimal("0.312508"), 6)
    (Decimal('19.76'), Decimal('0.313'))
    """
    magnitude = points.adjusted() if points else 0
    places = min(digits, max(decimals, 2 - magnitude)) if -6 < magnitude < 0 else min(digits, decimals)
    return points.quantize(Decimal(1).scaleb(-places), rounding=ROUND_HALF_EVEN) + Decimal(0)


def said(value: float, digits: int = 2) -> str:
    """A measured number in a sentence: so many significant digits, whole ones all.

    >>> said(0.9558), said(18.81, 3), said(2.4), said(1234.5)
    ('0.96', '18.8', '2.4', '1234')
    """
    if not math.isfinite(value):
        return "an unknown number of"
    whole = len(str(int(abs(value))))
    return f"{value:.0f}" if whole >= digits and abs(value) >= 1 else f"{value:.{digits}g}"
