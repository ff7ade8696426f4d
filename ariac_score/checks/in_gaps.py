"""What a monitor leaves open where no sample shows what happened."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

__all__ = ["IN_GAPS", "InGaps", "in_gaps_of"]

InGaps: TypeAlias = Literal["tight", "outer", "blunt", "unsampled", "reported"]

IN_GAPS: Mapping[InGaps, str] = {
    "tight": "both ends are worlds that may have been, where the log records the quantity itself",
    "outer": "no world exceeds either end, and none need reach it",
    "blunt": "kept at best, broken in all of the gap at worst",
    "unsampled": "it reads no samples, so a gap hides nothing from it",
    "reported": "gaps are what it reports",
}
"""What a monitor can say of itself, as `in_gaps`."""

assert IN_GAPS.keys() == {*get_args(InGaps)}


def in_gaps_of(monitor: object) -> str | None:
    """What a monitor says; `None` where it says nothing."""
    said = getattr(monitor, "in_gaps", None)
    return None if said is None else str(said)
