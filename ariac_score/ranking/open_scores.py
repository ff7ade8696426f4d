"""Scores that logs leave open, carried through to trials, teams and ranks.

What a log leaves open is bounded, not random: these ends say nothing about another day, and are never
added to the intervals of `statistics`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal

from msgspec import Struct

__all__ = ["MONOTONE_TOTALS", "Ends", "OpenStanding", "Slots", "cell_ends", "rank_ends", "worst_ends"]

MONOTONE_TOTALS = frozenset({"sum", "mean", "median", "highest", "lowest"})
"""Totals that a higher score of a trial never makes less, so that ends go to ends."""


class Ends(Struct, frozen=True, forbid_unknown_fields=True):
    """The least and the most that a score can be.

    Attributes:
        least: In points.
        most: In points.
    """

    least: Decimal
    most: Decimal

    def around(self, score: Decimal) -> Ends:
        """These ends, and a score that is published, which may count 0 while it is withheld."""
        return Ends(min(self.least, score), max(self.most, score))


class OpenStanding(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """What open scores mean for a team.

    Attributes:
        execution: Between which ends its execution lies.
        best_rank: The best rank that it can have; null where the ends of what teams are ranked by are not
            known, as with a formula over several teams.
        worst_rank: Likewise the worst.
        runs: How many of its runs are open.
    """

    execution: Ends
    best_rank: int | None = None
    worst_rank: int | None = None
    runs: int = 0


@dataclass(frozen=True)
class Slots:
    """How the runs of a team in a trial become its score there.

    Attributes:
        keep: How many count.
        fill: Whether those that were not made count as well.
        digits: Of the score.
        more_is_better: Whether the runs with the highest scores are kept.
        by_score: Whether runs are chosen by their scores; else any of them may be the one that counts.
    """

    keep: int
    fill: bool
    digits: int
    more_is_better: bool
    by_score: bool


def cell_ends(runs: Sequence[Ends], zeros: int, worst: Ends, slots: Slots) -> Ends:
    """Between which ends the score of a team in a trial lies.

    A higher score of a run never makes the mean of the best ones less, so each end is made of ends.

    Args:
        runs: Of each run that has a score.
        zeros: How many further runs count 0, or the worst of the trial.
        worst: What those count.
        slots: How many count.
    """
    found = []
    for end, of_worst, extreme in (
        ("least", worst.least, False),
        ("most", worst.most, True),
    ):
        # Where runs are not chosen by their scores, the least end is that of the lowest ones.
        from_top = slots.more_is_better if slots.by_score else extreme
        best = sorted((getattr(run, end) for run in runs), reverse=from_top)[: slots.keep]
        best += [of_worst] * min(zeros, slots.keep - len(best))
        best += [of_worst] * (slots.keep - len(best) if slots.fill else 0)
        mean = sum(best, Decimal(0)) / len(best) if best else of_worst
        found.append(mean.quantize(Decimal(1).scaleb(-slots.digits), rounding=ROUND_HALF_EVEN))
    return Ends(*found)


def worst_ends(worst: Decimal, kept: Sequence[Ends], *, more_is_better: bool) -> Ends:
    """Between which ends lies what counts in a trial where there is no score.

    Args:
        worst: What counts as published: 0, or the worst score that was kept.
        kept: The ends of the runs that are kept.
        more_is_better: Whether a high score is a good one.
    """
    of = min if more_is_better else max
    ends = of((Decimal(0), *(run.least for run in kept))), of((Decimal(0), *(run.most for run in kept)))
    return Ends(min(ends), max(ends)).around(worst)


def rank_ends(values: Mapping[str, Ends], published: Mapping[str, int]) -> dict[str, tuple[int, int]]:
    """The best and the worst rank of each team.

    Args:
        values: Between which ends the value of each team lies, more is better.
        published: The rank that each has.

    >>> two, three = Ends(Decimal(2), Decimal(2)), Ends(Decimal(1), Decimal(3))
    >>> rank_ends({"a": two, "b": three}, {"a": 1, "b": 2})
    {'a': (1, 2), 'b': (1, 2)}
    """
    ranks = {}
    for team, own in values.items():
        others = [ends for other, ends in values.items() if other != team]
        best = 1 + sum(one.least > own.most for one in others)
        worst = 1 + sum(one.most > own.least for one in others)
        # Teams of equal value are separated by other things, which these ends do not know.
        ranks[team] = min(best, published[team]), max(worst, published[team])
    return ranks
