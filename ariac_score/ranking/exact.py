"""Whether two teams can be told apart, by exact tests; which ranks follow from what was told apart.

Two questions, never mixed. *On trials like these*: had the two teams swapped their results within trials,
how often would the difference have been as large (`sign_flip`)? *On exactly these trials, run again*: had
the runs of both been dealt to them at random, trial by trial (`run_permutation`)? Both hold for any
distribution, with ties, zeros and heavy tails, and with any number of trials; with few of them nothing can
be told, and `fewest_trials` says so. What is told of many pairs holds together (`holm`), and so do the ranks
that follow (`rank_sets`).

Scores are whole numbers in units of their last digit, so that sums and ties are exact.

Source: Fisher, The Design of Experiments (1935), section 21 (sign flips); Phipson and Smyth, Permutation
P-values Should Never Be Zero (2010); Holm, A Simple Sequentially Rejective Multiple Test Procedure (1979);
Mogstad, Romano, Shaikh and Wilhelm, Inference for Ranks (2024): ranks from claims about pairs.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from itertools import combinations

import numpy as np

from ariac_score.ranking.resampling import RandomBits
from ariac_score.ranking.spec import IntArray

__all__ = [
    "Claim",
    "betting",
    "draws_for",
    "expected_best",
    "expected_kept",
    "fewest_trials",
    "holm",
    "rank_sets",
    "run_permutation",
    "sign_flip",
]

Claim = tuple[str, str]
"""The better team and the worse one."""

MOST_FLIPPED = 32
"""Of so many trials with a difference all ways of swapping are counted; of more, some are drawn."""
MOST_WAYS = 100_000
"""So many ways of dealing the runs are counted; of more, some are drawn."""


def sign_flip(differences: Sequence[int], *, draws: int = 100_000, seed: int = 1) -> Fraction:
    """How often swapping results within trials gives at least the difference that there was.

    Args:
        differences: For each trial by how much the first team was better, in units.
        draws: Ways drawn where there are too many to count.
        seed: Of the random numbers.

    Returns:
        The one-sided p. Trials without a difference carry nothing: without any other it is 1.

    >>> sign_flip([3, 1, 2, 4, 5, 2]), sign_flip([3, 1, 2, 4, 5, -2]), sign_flip([3, 0, 0, 0])
    (Fraction(1, 64), Fraction(1, 16), Fraction(1, 2))
    """
    told = [difference for difference in differences if difference]
    if not told:
        return Fraction(1)
    observed = sum(told)
    if len(told) > MOST_FLIPPED:
        sizes = np.array([abs(difference) for difference in told], dtype=np.int64)
        signs = RandomBits(seed).below(np.full((draws, len(told)), 2, dtype=np.int64)) * 2 - 1
        return Fraction(1 + int(np.count_nonzero(signs @ sizes >= observed)), draws + 1)
    half = len(told) // 2
    first, second = _flipped(told[:half]), np.sort(_flipped(told[half:]))
    enough = len(second) - np.searchsorted(second, observed - first, side="left")
    return Fraction(int(enough.sum()), 2 ** len(told))


def _flipped(differences: Sequence[int]) -> IntArray:
    """The sums of some numbers with every choice of signs."""
    sums = np.zeros(1, dtype=np.int64)
    for difference in differences:
        sums = np.concatenate([sums + difference, sums - difference])
    return sums


def run_permutation(
    trials: Sequence[tuple[Sequence[int], Sequence[int]]], *, keep: int, draws: int = 100_000, seed: int = 1
) -> Fraction:
    """How often dealing the runs of two teams at random gives at least the difference that there was.

    Args:
        trials: For each trial the scores of the first team's runs, and of the second's, in units, more is
            better.
        keep: How many of the best runs count; their sum is compared.
        draws: Ways drawn where there are too many to count.
        seed: Of the random numbers.

    Returns:
        The one-sided p.

    >>> run_permutation([([9, 8, 7], [5, 6, 4])], keep=3)
    Fraction(1, 20)
    """
    pooled = [(list(one) + list(other), len(one)) for one, other in trials if one and other]
    ways = math.prod(math.comb(len(runs), count) for runs, count in pooled)
    observed = sum(_kept(runs[:count], keep) - _kept(runs[count:], keep) for runs, count in pooled)
    if ways > MOST_WAYS:
        reached = _dealt(pooled, keep, draws, RandomBits(seed)) >= observed
        return Fraction(1 + int(np.count_nonzero(reached)), draws + 1)
    sums = Counter({0: 1})
    for runs, count in pooled:
        own = Counter(
            _kept([runs[k] for k in dealt], keep)
            - _kept([run for k, run in enumerate(runs) if k not in dealt], keep)
            for dealt in combinations(range(len(runs)), count)
        )
        joined: Counter[int] = Counter()
        for before, often in sums.items():
            for difference, times in own.items():
                joined[before + difference] += often * times
        sums = joined
    return Fraction(sum(times for total, times in sums.items() if total >= observed), ways)


def _kept(runs: Sequence[int], keep: int) -> int:
    return sum(sorted(runs, reverse=True)[:keep])


def _dealt(pooled: Sequence[tuple[Sequence[int], int]], keep: int, draws: int, bits: RandomBits) -> IntArray:
    """The differences for runs dealt at random, shape (draws,)."""
    total = np.zeros(draws, dtype=np.int64)
    for runs, count in pooled:
        halves = bits.halves(draws * len(runs)).reshape(draws, len(runs))
        dealt = np.array(runs, dtype=np.int64)[np.argsort(halves, axis=1, kind="stable")]
        one, other = -np.sort(-dealt[:, :count], axis=1), -np.sort(-dealt[:, count:], axis=1)
        total += one[:, :keep].sum(axis=1) - other[:, :keep].sum(axis=1)
    return total


def draws_for(teams: int) -> int:
    """How many ways to draw, so that the smallest p can pass Holm's bound among so many teams.

    Source: Phipson and Smyth (2010): a drawn p is at least 1 / (draws + 1).
    """
    return max(40 * teams * (teams - 1), 1_999)


def holm(chances: Mapping[Claim, Fraction], level: float = 0.95) -> frozenset[Claim]:
    """The claims that hold together: with this probability none of them is false.

    Args:
        chances: One-sided p of every claim that might have been made, both directions of all pairs.
        level: The probability.

    >>> p = {"AB": 0.001, "AC": 0.004, "BC": 0.014, "BA": 0.999, "CA": 0.996, "CB": 0.986}
    >>> sorted(holm({(a, b): Fraction(str(x)) for (a, b), x in p.items()}))
    [('A', 'B'), ('A', 'C')]
    """
    error, left = 1 - Fraction(str(level)), len(chances)
    claimed = []
    for claim, chance in sorted(chances.items(), key=lambda item: (item[1], item[0])):
        if chance * left > error:
            break
        claimed.append(claim)
        left -= 1
    return frozenset(claimed)


def rank_sets(teams: Sequence[str], claims: Collection[Claim]) -> dict[str, tuple[int, int]]:
    """The best and the worst rank of each team that the claims leave; where none is false, all hold.

    >>> rank_sets("ABC", [("A", "B"), ("A", "C")])
    {'A': (1, 1), 'B': (2, 3), 'C': (2, 3)}
    """
    behind = Counter(worse for _, worse in claims)
    ahead = Counter(better for better, _ in claims)
    return {team: (1 + behind[team], len(teams) - ahead[team]) for team in teams}


def fewest_trials(teams: int, level: float = 0.95) -> int:
    """With fewer trials that differ no number of points tells any two of so many teams apart.

    >>> [fewest_trials(teams) for teams in (2, 3, 4, 6, 10, 20)]
    [6, 7, 8, 10, 11, 13]
    """
    error, trials = 1 - Fraction(str(level)), 1
    while teams > 1 and Fraction(1, 2**trials) * teams * (teams - 1) > error:
        trials += 1
    return trials


def expected_best(scores: Sequence[int], runs: int) -> Fraction:
    """The mean of the best of so many runs, over all ways of choosing them from those there are.

    Args:
        scores: At least so many, in units.
        runs: How many are chosen.

    Raises:
        ValueError: More are to be chosen than there are: what was not run is not known.

    >>> [float(expected_best([9, 7, 6, 5, 4], runs)) for runs in (1, 2, 5)]
    [6.2, 7.4, 9.0]
    """
    return expected_kept(sorted(scores, reverse=True), runs, 1)


def expected_kept(scores: Sequence[int | Fraction], runs: int, keep: int) -> Fraction:
    """The mean of the best of so many runs, where several of them count: over all ways of choosing them.

    Args:
        scores: At least so many, those first that count first.
        runs: How many are chosen.
        keep: How many of these count; all where it is more.

    Raises:
        ValueError: More are to be chosen than there are: what was not run is not known.

    >>> [float(expected_kept([9, 7, 6, 5, 4], runs, 2)) for runs in (1, 2, 3, 5)]
    [6.2, 6.2, 7.05, 8.0]
    """
    if not 1 <= runs <= len(scores):
        raise ValueError(f"the best of {runs} cannot be had from {len(scores)} runs")
    kept = min(keep, runs)
    total = Fraction(0)
    for place, score in enumerate(scores):
        after = len(scores) - place - 1
        # It counts in every way of choosing that takes fewer than `kept` of those before it.
        ways = sum(math.comb(place, before) * math.comb(after, runs - 1 - before) for before in range(kept))
        total += Fraction(score) * ways
    return total / (kept * math.comb(len(scores), runs))


def betting(differences: Sequence[int], most: int) -> Fraction:
    """A one-sided p about *expected* scores, which no sign flip is about.

    It needs to know how much a trial can differ, and tells little of few trials.

    Args:
        differences: For each trial by how much the first team was better, in units.
        most: The most by which a trial can differ, in the same units.

    Raises:
        ValueError: A trial differs by more.

    Source: Waudby-Smith and Ramdas, Estimating means of bounded random variables by betting (2024), with
    stakes spread evenly.

    >>> round(float(betting([10] * 10, 10)), 6), round(float(betting([1] * 10, 10)), 4)
    (0.005374, 0.5936)
    """
    if any(abs(difference) > most for difference in differences):
        raise ValueError(f"a trial differs by more than {most}")
    wealth = [Fraction(1)]  # coefficients in the stake
    for difference in differences:
        gain = Fraction(difference, most)
        wealth = [
            same + gain * lower
            for same, lower in zip([*wealth, Fraction(0)], [Fraction(0), *wealth], strict=True)
        ]
    mean = sum((own / (power + 1) for power, own in enumerate(wealth)), Fraction(0))
    return min(Fraction(1), 1 / mean) if mean > 0 else Fraction(1)
