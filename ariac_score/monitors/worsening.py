"""What a monitor says of itself so that worlds can be judged."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

from ariac_score.checks.findings import Finding
from ariac_score.checks.measures import Measure
from ariac_score.trial.spans import Span

if TYPE_CHECKING:
    from ariac_score.monitors.watched import Watched

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
        beside: On how many samples beside each its verdict rests, so that they are open beside a gap, too.
        may_hide: What some signals may have been where nothing shows them, so that what follows is judged
            otherwise, by template; each is tried.
        courses: What it judges each by itself, such as a stop until the next start: each may be violated.
        by_course: Whether its findings are of what takes its course, such as a contact: bad as a whole.
        shows_itself: Whether a sample by itself shows its own instant.
        graded: Whether the depth relative to the limit says how bad a violation is.
        limits: How many limits it judges, given the signals of a subject; `None`: one.
        at_worst: What it finds in the worst world, given where nothing shows it; `None`: its limit may have
            been broken there, all of the time and at full depth.
    """

    signals: Mapping[str, Worse]
    measures: Mapping[str, Measure]
    t_off_s: float
    clause: str
    t_on_s: float = 0.0
    flags: Sequence[str] = ()
    critical: bool = False
    beside: int = 0
    may_hide: Sequence[Mapping[str, float | tuple[float, ...]]] = ()
    courses: Callable[[Watched], Sequence[Span]] | None = None
    by_course: bool = False
    shows_itself: bool = True
    graded: bool = True
    limits: Callable[[Watched], int] | None = None
    at_worst: Callable[[Watched, Sequence[Span]], Sequence[Finding] | None] | None = None
