"""What a platform would reject late or get wrong in silence, and reading the YAML it is found in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Problem", "mapping_in", "mappings_in"]


@dataclass(frozen=True)
class Problem:
    """Something that the platform would not report, or only much later.

    Attributes:
        where: File and place.
        what: What is wrong.
        remedy: What to do.
        severe: Whether the upload cannot work like this.
    """

    where: str
    what: str
    remedy: str
    severe: bool = True


def mappings_in(document: Mapping[str, Any], key: str) -> list[dict[str, Any]]:
    """The mappings of a list; empty where there is no list."""
    value = document.get(key)
    return [entry for entry in value if isinstance(entry, dict)] if isinstance(value, list) else []


def mapping_in(value: Any) -> Mapping[str, Any]:
    """A value that should be a mapping; empty where it is none."""
    return value if isinstance(value, dict) else {}
