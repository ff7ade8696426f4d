"""What a monitor says of itself so that worlds can be judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from ariac_score.checks.measures import Measure

__all__ = ["Worse", "Worsening"]

Worse: TypeAlias = Literal["low", "high"]
"""Which end of a signal is the worse one."""


@dataclass(frozen=True)
class Worsening:
    """What a monitor says of itself so that worlds can be judged.

    Attributes:
        signals: Which end of each signal that is wanted is the worse one; empty: it does not say.
        measures: The quantities of its findings.
        t_off_s: Pauses shorter than this are bridged, s.
        t_on_s: Shortest violation that counts, s.
        clause: Where the standard asks for it.
        flags: What else it reads, and a sample of which stands for a while.
        critical: Whether a violation is a critical event.
    """

    signals: Mapping[str, Worse]
    measures: Mapping[str, Measure]
    t_off_s: float
    clause: str
    t_on_s: float = 0.0
    flags: Sequence[str] = ()
    critical: bool = False
