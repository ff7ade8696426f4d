"""Where two documents differ, place by place, and how that is said."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

__all__ = ["SHOWN", "Place", "differences", "listed"]

SHOWN = 5
"""Differences that are named; one edit changes few places, another log changes many."""

Place = tuple[str | int, ...]
"""Keys and indices from the root of a document."""


def differences(first: Any, second: Any) -> list[tuple[Place, Any, Any]]:
    """Where two documents differ: place, first value, second value; `None` where one has none."""
    return list(_different(first, second, ()))


def _different(first: Any, second: Any, place: Place) -> Iterator[tuple[Place, Any, Any]]:
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        for key in dict.fromkeys([*first, *second]):
            yield from _different(first.get(key), second.get(key), (*place, key))
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        for i, (one, other) in enumerate(zip(first, second, strict=True)):
            yield from _different(one, other, (*place, i))
    elif first != second:
        yield place, first, second


def _place_text(place: Place) -> str:
    return "$" + "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)


def listed(found: Sequence[tuple[Place, Any, Any]], first: str, second: str) -> str:
    """The first of them in words, a line each; `first` and `second` say where the values stand."""
    lines = [
        f"{_place_text(place)}: {_short(one)} {first}, {_short(other)} {second}"
        for place, one, other in found[:SHOWN]
    ]
    return "\n".join([*lines, *([f"and {len(found) - SHOWN} more"] if len(found) > SHOWN else [])])


def _short(value: Any) -> str:
    if value is None:
        return "nothing"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:59]}…"
