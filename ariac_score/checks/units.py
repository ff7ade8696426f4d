"""Units that numbers of findings may have: the one table of them, and the products made of them."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

__all__ = ["NEVER_NEGATIVE", "UNITS", "is_unit"]

UNITS: Mapping[str, str] = {
    "1": "a number without a unit",
    "s": "time",
    "m": "length",
    "rad": "angle",
    "kg": "mass",
    "A": "current",
    "K": "temperature",
    "N": "force",
    "Pa": "pressure",
    "J": "energy",
    "W": "power",
    "V": "voltage",
    "Hz": "frequency",
    "count": "a number of things",
    "points": "what a scorer awards or takes",
    "dollars": "cost",
}
"""The units by symbol. Others are known where a quantity of signals is declared in them."""

NEVER_NEGATIVE = frozenset({"s", "count"})
"""Units whose numbers are not below 0, unless their declaration says that they are signed."""

_FACTOR = re.compile(r"([A-Za-z%°µ]+)\^?-?\d*")


def is_unit(unit: str, also: Collection[str] = ()) -> bool:
    """Whether a unit is in the table, is declared elsewhere, or is a product or quotient of such units.

    Args:
        unit: Such as `m`, `m/s`, `m/s2`, `m s`, `1/s`.
        also: Units of declared quantities.

    >>> [is_unit(unit) for unit in ("1", "m/s2", "N s", "1/s", "furlong", "m/", "")]
    [True, True, True, True, False, False, False]
    >>> is_unit("furlong/s", also={"furlong"})
    True
    """
    return unit in also or all(
        factor == "1" or _is_factor(factor, also)
        for part in unit.split("/")
        for factor in re.split(r"[ ·*]", part)
    )


def _is_factor(factor: str, also: Collection[str]) -> bool:
    found = _FACTOR.fullmatch(factor)
    return found is not None and (found[1] in UNITS or found[1] in also)
