"""Which teams of a ranking are told apart, on trials like these and on exactly these.

Like with like: of two teams that ran a trial differently often, as many first runs of each are compared as
both made. What is open about a score counts against the claim: the low end of the team that is said to be
better, the high end of the other. What cannot be read or decided says nothing about anybody; a run that was
not made counts what it counts in the ranking.

Source: docs/ranking.md, which also shows how often claims are wrong in simulations.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import ROUND_HALF_EVEN, Decimal
from fractions import Fraction
from itertools import permutations

from ariac_score.ranking.exact import Claim, draws_for, holm, run_permutation, sign_flip
from ariac_score.ranking.outcomes import AS_ZERO, WITH_SCORE, Ranking, RunOutcome, TeamRank
from ariac_score.ranking.spec import Spec

__all__ = ["MOST_DEALT", "Told", "ends_of", "told_apart"]

MOST_DEALT = 12
"""Of more teams runs are not dealt anew: the draws that Holm's bound asks for grow with the square."""


@dataclass(frozen=True)
class Told:
    """What exact tests say about every two teams, in both directions.

    Attributes:
        on_like_trials: The one-sided p of each claim, by swapping results within trials.
        on_these_trials: The same by dealing the runs of these trials anew; empty where that was not asked.
        told: The claims about trials like these that hold together.
        told_here: The claims about exactly these trials that hold together.
        differing: The most trials in which two teams differ.
    """

    on_like_trials: Mapping[Claim, Fraction] = field(default_factory=dict)
    on_these_trials: Mapping[Claim, Fraction] = field(default_factory=dict)
    told: frozenset[Claim] = frozenset()
    told_here: frozenset[Claim] = frozenset()
    differing: int = 0


@dataclass(frozen=True)
class _Own:
    """What a team brings to a trial: its runs in their order as least and most, in units, more is better.

    Attributes:
        runs: Empty where it made none.
        instead: What counts where it made none; `None` where that is not known.
    """

    runs: tuple[tuple[int, int], ...] = ()
    instead: int | None = None

    def first(self, count: int) -> tuple[tuple[int, int], ...] | None:
        """So many first runs; `None` where nothing is known."""
        if self.runs:
            return self.runs[:count]
        return None if self.instead is None else ((self.instead, self.instead),) * count


def told_apart(ranking: Ranking, spec: Spec, digits: int) -> Told:
    """Test every two teams of a ranking.

    Args:
        ranking: The ranking.
        spec: How its runs became it; its `level` is that of all claims together.
        digits: Decimal digits of a score.
    """
    standings = [standing for standing in ranking.standings if standing.value is not None]
    by_trial = _by_trial(ranking, standings, spec, digits)
    teams = [standing.team for standing in standings]
    pairs = {
        (one, other): [_alike(own[one], own[other]) for own in by_trial if own[one].runs or own[other].runs]
        for one, other in permutations(teams, 2)
    }
    both = {
        (one, other): [_alike(own[one], own[other]) for own in by_trial if own[one].runs and own[other].runs]
        for one, other in permutations(teams, 2)
    }
    whole = math.lcm(*range(1, spec.keep + 1))
    apart: dict[Claim, Fraction] = {}
    known: dict[tuple[int, ...], Fraction] = {}
    differing = 0
    for claim, trials in pairs.items():
        ahead = tuple(
            (_kept([low for low, _ in one], spec.keep) - _kept([high for _, high in other], spec.keep))
            * (whole // min(spec.keep, len(one)))
            for one, other in trials
            if one and other
        )
        differing = max(differing, sum(difference != 0 for difference in ahead))
        if ahead not in known:
            known[ahead] = sign_flip(ahead, draws=draws_for(len(teams)))
        apart[claim] = known[ahead]
    here = {} if len(teams) > MOST_DEALT else _dealt(both, spec.keep, len(teams))
    level = spec.intervals.level
    return Told(apart, here, holm(apart, level), holm(here, level), differing)


def _dealt(
    pairs: Mapping[Claim, Sequence[tuple[_Runs, _Runs]]], keep: int, teams: int
) -> dict[Claim, Fraction]:
    return {
        claim: run_permutation(
            [([low for low, _ in one], [high for _, high in other]) for one, other in trials],
            keep=keep,
            draws=draws_for(teams),
        )
        for claim, trials in pairs.items()
    }


_Runs = tuple[tuple[int, int], ...]


def _alike(one: _Own, other: _Own) -> tuple[_Runs, _Runs]:
    """As many first runs of both, of whom one ran at least; nothing where one of them is not known."""
    made = min(len(own.runs) for own in (one, other) if own.runs)
    first, second = one.first(made), other.first(made)
    return ((), ()) if first is None or second is None else (first, second)


def _kept(runs: Sequence[int], keep: int) -> int:
    return sum(sorted(runs, reverse=True)[:keep])


def _by_trial(
    ranking: Ranking, standings: Sequence[TeamRank], spec: Spec, digits: int
) -> list[dict[str, _Own]]:
    """For each trial what every team brings to it."""
    groups: dict[tuple[str, str], list[RunOutcome]] = {}
    for run in sorted(ranking.runs, key=lambda run: run.number):
        groups.setdefault((run.team, run.trial), []).append(run)
    sign = 1 if spec.more_is_better else -1
    return [
        {
            standing.team: _own(
                groups.get((standing.team, trial), ()), standing.trials[trial].score, sign, digits
            )
            for standing in standings
        }
        for trial in ranking.trials
    ]


def _own(runs: Sequence[RunOutcome], counts: Decimal, sign: int, digits: int) -> _Own:
    made = [ends for run in runs if (ends := ends_of(run)) is not None]
    if made:
        units = [[sign * _units(end, digits) for end in ends] for ends in made]
        return _Own(tuple((min(both), max(both)) for both in units))
    # A log that cannot be read, or decided, is no statement about how the robot drove.
    return _Own() if runs else _Own(instead=sign * _units(counts, digits))


def ends_of(run: RunOutcome) -> tuple[Decimal, Decimal] | None:
    """Between what its score lies; `None` where nothing is known of it.

    A score that is withheld still lies between its ends. Left out, it would let a team choose which of its
    runs are compared.
    """
    if run.outcome in AS_ZERO or (run.outcome in WITH_SCORE and run.open is None):
        return None if run.score is None else (run.score, run.score)
    counts = run.outcome in (*WITH_SCORE, "undecided") and run.open is not None
    return (run.open.least, run.open.most) if counts and run.open is not None else None


def _units(amount: Decimal, digits: int) -> int:
    return int(amount.scaleb(digits).quantize(Decimal(1), rounding=ROUND_HALF_EVEN))
