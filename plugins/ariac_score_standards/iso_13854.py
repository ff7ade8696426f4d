"""Gaps in which a part of the body is crushed, after ISO 13854."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ariac_score import FloatArray, ParameterFacts, parameter
from ariac_score.monitors import (
    BoolArray,
    Bound,
    Episode,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Watched,
    pairs,
)

_SEEN = ParameterFacts("m", "verified", "sample of ISO 13854 quoted in a public research note")
_MEMORY = ParameterFacts("m", "from memory", "ISO 13854")

MINIMUM_GAP_M: Mapping[str, tuple[float, ParameterFacts]] = {
    "body": (0.5, _SEEN),
    "head": (0.3, _SEEN),
    "leg": (0.18, _SEEN),
    "foot": (0.12, _MEMORY),
    "toes": (0.05, _MEMORY),
    "arm": (0.12, _MEMORY),
    "hand": (0.1, _MEMORY),
    "wrist": (0.1, _MEMORY),
    "fist": (0.1, _MEMORY),
    "finger": (0.025, _MEMORY),
}
"""Least gap that does not crush, with what is known about it, by part of the body."""


_GAP = "crush_gap/{robot}/{human}"


def minimum_gap_m(part: str) -> float:
    """Least gap for a part of the body, m.

    Raises:
        ValueError: The part is unknown.
    """
    if part not in MINIMUM_GAP_M:
        raise ValueError(f"body part {part!r} is unknown; parts: {', '.join(MINIMUM_GAP_M)}")
    return MINIMUM_GAP_M[part][0]


def clamps(part: str, gap_m: FloatArray, closing: BoolArray | bool) -> BoolArray:
    """Whether a gap clamps the part: below its least gap, and getting smaller, shape (n,)."""
    result: BoolArray = (np.asarray(gap_m) < minimum_gap_m(part)) & np.asarray(closing, dtype=bool)
    return result


PART_OF_REGION: Mapping[str, str] = {
    "skull_forehead": "head",
    "face": "head",
    "neck": "head",
    "back_shoulders": "body",
    "chest": "body",
    "abdomen": "body",
    "pelvis": "body",
    "upper_arm": "arm",
    "lower_arm": "arm",
    "hand": "hand",
    "thigh": "leg",
    "lower_leg": "leg",
}
"""The part of the body whose least gap holds for a region of force limits; our choice."""


def closes(gap_m: FloatArray) -> BoolArray:
    """Where a gap gets smaller, or has just got smaller, shape (n,).

    >>> closes(np.array([3.0, 3.0, 2.0, 2.0])).tolist()
    [False, True, True, False]
    """
    closing = np.zeros(len(gap_m), dtype=bool)
    step = np.diff(gap_m) < 0
    # Both ends of a step count: from the first on the gap gets smaller, at the second it is smallest.
    closing[:-1] |= step
    closing[1:] |= step
    return closing


@dataclass(frozen=True)
class CrushGap(LimitMonitor):
    """No part of the body is between robot and fixed things in a gap that closes on it.

    It shows where a contact is clamped, which `pfl_contact` takes from the same signal;
    not to be priced alone.

    Measures:
        For every robot and human the signal `crush_gap` (the gap between the robot and
        a fixed surface with the human's body part in it) while it gets smaller, against
        the least gap for `part`, in m.
    Violated when:
        The gap is smaller. Equality keeps it.
    Source:
        ISO 13854, minimum gaps: body, head, leg seen in a public sample, the others
        from memory.
    """

    part: str = parameter("body", source="body, head, leg, foot, toes, arm, hand, wrist, fist or finger")
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="catalogue, 1.4")
    t_on_s: float = parameter(0.0, unit="s", at_least=0, at_most=60, source="catalogue, 1.2")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=60, source="catalogue, 1.2")

    subjects = pairs("robot", "human")
    wanted: ClassVar[Mapping[str, str]] = {_GAP: "m"}
    what, unit, idle = "closing gap", "m", "no gap ever closed"
    clause = "derived from ISO 13854, minimum gaps"
    reach = Reach("neighbour", ahead=1)  # whether a gap closes shows at the samples before and after

    def __post_init__(self) -> None:
        super().__post_init__()
        minimum_gap_m(self.part)

    def margin(self, signals: Watched) -> Bound:
        """Gap - the least gap for the part while it closes, m."""
        gap = signals[_GAP]
        return self.at_least(gap, minimum_gap_m(self.part), where=closes(gap))

    def labels(self, _limit: JudgedLimit, episode: Episode | None) -> dict[str, str]:
        """That the part was clamped, and which."""
        return {} if episode is None else {"clamped": "yes", "part": self.part}
