"""Between which scores a trial lies, where its log leaves something open, and what would narrow that."""

from __future__ import annotations

from decimal import Decimal
from typing import Annotated

from msgspec import UNSET, Meta, Struct, UnsetType

__all__ = ["COUNTS", "Counts", "Narrowing", "ScoreInterval"]

COUNTS = {
    "worst": "the least score that the log allows",
    "best": "the greatest score that the log allows",
    "withhold": "no score until everything is decided",
    "known": "what the logs that are known are worth, where one of another run is lost",
}
"""Which end of the interval is the score, as `open:` of a rule set says; `known` is none of its ends."""
Counts = Annotated[str, Meta(pattern=f"^({'|'.join(COUNTS)})$")]


class Narrowing(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One reason why a score is open, and how much deciding it would help.

    Attributes:
        cause: In words, such as `12 gaps of 51 to 97 ms on /snapshot`.
        checks: The checks that it leaves undecided.
        findings: Ids of the findings that are open for it, as the result lists them.
        at_most: By how much the interval would be shorter without it, in points; `None` where nobody
            can say.
    """

    cause: str
    checks: tuple[str, ...]
    findings: tuple[str, ...] = ()
    at_most: Decimal | None = None


class ScoreInterval(Struct, frozen=True, forbid_unknown_fields=True):
    """The scores that a log allows.

    Attributes:
        least: Of them, with the digits of the score.
        most: Likewise.
        tight: Whether both ends are the scores of worlds that the log allows; else they are bounds
            that no world exceeds.
        counts: Which end is the score: `worst`, `best`, or none (`withhold`, `known`).
        narrowing: What would narrow it, most first.
        unseen: By how much the score is lower for what no sample shows: what the samples of the monitors
            alone would be worth, less the score. It is left out where it is 0, or has no value.
    """

    least: Decimal
    most: Decimal
    tight: bool
    counts: Counts
    narrowing: tuple[Narrowing, ...] = ()
    unseen: Decimal | UnsetType = UNSET
