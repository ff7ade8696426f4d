"""What is the same many times, told once."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from typing import TypeVar

__all__ = ["told_once"]

FEWEST = 3
"""So many rows that differ in their number alone are told as one."""

Row = TypeVar("Row")


def told_once(rows: Iterable[Row], same: Callable[[Row], Hashable]) -> list[list[Row]]:
    """Rows, those that say the same together where there are three of them or more.

    Args:
        rows: In the order in which they are to be told.
        same: What rows that say the same have in common.

    Returns:
        Each row or each group of rows, at the place of its first.

    >>> told_once(["b1", "a1", "b2", "c1", "b3", "c2"], lambda row: row[0])
    [['b1', 'b2', 'b3'], ['a1'], ['c1'], ['c2']]
    """
    alike: dict[Hashable, list[Row]] = {}
    order: list[tuple[Hashable, Row]] = []
    for row in rows:
        key = same(row)
        alike.setdefault(key, []).append(row)
        order.append((key, row))
    found = []
    for key, row in order:
        group = alike[key]
        if len(group) < FEWEST:
            found.append([row])
        elif group[0] is row:
            found.append(group)
    return found
