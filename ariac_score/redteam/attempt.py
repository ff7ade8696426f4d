"""What an adversary tries: one change of a log, or of what was done, in words and as a copy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import Enum

from ariac_score.redteam.honest import Honest
from ariac_score.testing.copies import Copy

__all__ = ["Aim", "Attempt", "Tactic"]


class Aim(Enum):
    """What is wrong if it works.

    Attributes:
        LIE: The log says something else than what happened: no more points may come of it.
        HARM: Something worse was done: it may neither bring points nor be free.
        LESS: Less was done, or nothing for longer: it may not bring points.
        AGAIN: The same was done again: nothing may change.
        REST: The robot stood still: it may not cost points.
    """

    LIE = "lie"
    HARM = "harm"
    LESS = "less"
    AGAIN = "again"
    REST = "rest"


@dataclass(frozen=True)
class Attempt:
    """One try.

    Attributes:
        says: What is done, in words that begin with what to do.
        logs: What is handed in: one doctored log, or for several runs one for each.
        smaller: The same with less, most promising first: the cheapest that works is what is printed.
    """

    says: str
    logs: Callable[[], tuple[Copy, ...]]
    smaller: Callable[[], Iterable[Attempt]] = tuple

    @classmethod
    def of(
        cls, says: str, change: Callable[[], Copy], smaller: Callable[[], Iterable[Attempt]] = tuple
    ) -> Attempt:
        """One that hands in one doctored log."""
        return cls(says, lambda: (change(),), smaller)


@dataclass(frozen=True)
class Tactic:
    """A way to try, with as many variants as the budget allows.

    Attributes:
        name: In the table of what was tried.
        aim: What is wrong if it works.
        law: The law of penalties that it would break; empty where it is about the log.
        attempts: The variants, simplest first; random ones by the seed, for ever if there are such.
        needs_proof: Whether nothing but a recorder's manifest could show it.
    """

    name: str
    aim: Aim
    attempts: Callable[[Honest, int], Iterator[Attempt]]
    law: str = ""
    needs_proof: bool = False
