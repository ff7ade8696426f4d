"""JSON objects in which every key stands once."""

from __future__ import annotations

from collections import Counter
from typing import Any

__all__ = ["without_repeats"]


def without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of some pairs, for `object_pairs_hook`: Python would silently take the last of equal keys.

    Raises:
        ValueError: A key stands twice.
    """
    found = dict(pairs)
    if len(found) < len(pairs):
        # Counted once: `list.count` for each key would take hours on a hostile line of a million keys.
        counts = Counter(key for key, _ in pairs)
        twice = next(key for key, count in counts.items() if count > 1)
        raise ValueError(f"key {twice[:80]!r} is given twice")
    return found
