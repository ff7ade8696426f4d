"""How often does a ranking tell equal teams apart? Simulated competitions with known truth.

Four teams, the first two equal and the last two equal, the pairs some way apart. For each kind of
competition: in how many a false claim is made, of teams that are equal or the wrong way round, and how many
of the true differences are found; on trials like these and on exactly these trials. For comparison: paired t
tests with Bonferroni's bound, and intervals of differences from draws (a nested bootstrap, pair by pair).
Where the same teams would do otherwise on other trials, a claim about exactly these trials is none about
others: that column then stands in brackets.

    python benchmarks/coverage.py [--rounds 500] [--only WORD]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from ariac_score.ranking.claims import told_apart
from ariac_score.ranking.exact import Claim
from ariac_score.ranking.outcomes import Cell, Ranking, RunOutcome, TeamRank
from ariac_score.ranking.resampling import student_quantile
from ariac_score.ranking.spec import Spec

TEAMS = ("a", "b", "c", "d")
TRUE = {(one, other) for one in "cd" for other in "ab"}
Chance = np.random.Generator
Scores = list[list[NDArray[np.float64]]]
"""For each team and trial the scores of its runs, in their order."""


@dataclass(frozen=True)
class Kind:
    """One kind of competition.

    Attributes:
        name: In a few words.
        trials: How many.
        runs: Of each team in each trial.
        make: Scores of one competition.
        keep: How many runs count.
        elsewhere: Whether teams would do otherwise on other trials.
    """

    name: str
    trials: int
    runs: tuple[int, int, int, int]
    make: Callable[[Chance, Kind], Scores]
    keep: int = 1
    elsewhere: bool = False


def normal(gap: float = 2.5, spreads: tuple[float, ...] = (1, 1, 1, 1), copes: float = 0.0):  # type: ignore[no-untyped-def]
    """Scores with normal luck; `copes` is how differently teams cope with trials."""

    def make(chance: Chance, kind: Kind) -> Scores:
        hard = chance.normal(0, 3, kind.trials)
        return [
            [
                hard[trial]
                + gap * (team > 1)
                + chance.normal(0, copes)
                + chance.normal(0, spreads[team], kind.runs[team])
                for trial in range(kind.trials)
            ]
            for team in range(4)
        ]

    return make


def ties(chance: Chance, kind: Kind) -> Scores:
    """Whole points of 0 to 3."""
    return [
        [
            chance.binomial(3, 0.7 if team > 1 else 0.3, kind.runs[team]).astype(float)
            for _ in range(kind.trials)
        ]
        for team in range(4)
    ]


def mostly_zero(chance: Chance, kind: Kind) -> Scores:
    """Points in one run of five, or of two."""
    return [
        [
            np.where(chance.random(kind.runs[team]) < (0.5 if team > 1 else 0.15), 10.0, 0.0)
            for _ in range(kind.trials)
        ]
        for team in range(4)
    ]


def heavy(chance: Chance, kind: Kind) -> Scores:
    """Student's distribution with 1.5 degrees of freedom."""
    return [
        [2.5 * (team > 1) + chance.standard_t(1.5, kind.runs[team]) for _ in range(kind.trials)]
        for team in range(4)
    ]


def skewed(chance: Chance, kind: Kind) -> Scores:
    """Equal means: always 1 point, or 10 in one run of ten."""
    return [
        [
            np.full(kind.runs[team], 1.0)
            if team % 2 == 0
            else np.where(chance.random(kind.runs[team]) < 0.1, 10.0, 0.0)
            for _ in range(kind.trials)
        ]
        for team in range(4)
    ]


def _alike(count: int) -> tuple[int, int, int, int]:
    return count, count, count, count


UNLIKE = (1.0, 4.0, 1.0, 4.0)
KINDS = [
    Kind("normal 6 x 3", 6, _alike(3), normal(), 3),
    Kind("interacting 12 x 3", 12, _alike(3), normal(copes=2.0), 3, elsewhere=True),
    Kind("heteroscedastic 8 x 3", 8, _alike(3), normal(spreads=UNLIKE), 3),
    Kind("ties 8 x 1", 8, _alike(1), ties),
    Kind("mostly zero 10 x 3", 10, _alike(3), mostly_zero, 3),
    Kind("heavy tails 10 x 3", 10, _alike(3), heavy, 3),
    Kind("1 x 1", 1, _alike(1), normal()),
    Kind("1 x 5", 1, _alike(5), normal(), 5),
    Kind("1 x 5, heteroscedastic", 1, _alike(5), normal(spreads=UNLIKE), 5),
    Kind("2 x 1", 2, _alike(1), normal()),
    Kind("2 x 1, ties", 2, _alike(1), ties),
    Kind("3 x 1", 3, _alike(1), normal()),
    Kind("3 x 1, ties", 3, _alike(1), ties),
    Kind("3 x 3", 3, _alike(3), normal(), 3),
    Kind("3 x 3, ties", 3, _alike(3), ties, 3),
    Kind("3 x 3, interacting", 3, _alike(3), normal(copes=2.0), 3, elsewhere=True),
    Kind("15 x 5", 15, _alike(5), normal(), 5),
    Kind("15 x 5, interacting", 15, _alike(5), normal(copes=2.0), 5, elsewhere=True),
    Kind("best of 5, 8 x 5", 8, _alike(5), normal()),
    Kind("best of 5, mostly zero", 8, _alike(5), mostly_zero),
    Kind("1 run against 5, best, 8", 8, (1, 5, 1, 5), normal()),
    Kind("1 run against 5, best, 12", 12, (1, 5, 1, 5), normal()),
    Kind("1 run against 5, means, 12", 12, (1, 5, 1, 5), normal(spreads=UNLIKE), 5),
    Kind("equal means, one skewed, 10", 10, _alike(1), skewed),
]


def ranking(kind: Kind, scores: Scores) -> Ranking:
    """The ranking of one competition."""
    names = [f"t{trial}" for trial in range(kind.trials)]
    outcomes, standings = [], []
    for team, own in zip(TEAMS, scores, strict=True):
        cells = {}
        for name, runs in zip(names, own, strict=True):
            rounded = [Decimal(f"{score:.3f}") for score in runs]
            outcomes += [
                RunOutcome(team, name, k, "scored", score=score, kept=True)
                for k, score in enumerate(rounded, 1)
            ]
            best = sorted(rounded, reverse=True)[: kind.keep]
            cells[name] = Cell(sum(best, Decimal(0)) / len(best), "scored", "", (1,), len(rounded))
        total = sum((cell.score for cell in cells.values()), Decimal(0))
        standings.append(TeamRank(None, team, team, total, total, None, {}, cells))
    return Ranking("made", "", ("", ""), tuple(names), tuple(standings), tuple(outcomes), None)  # type: ignore[arg-type]


def paired_t(found: Ranking) -> set[Claim]:
    """Claims by a paired t test of the published scores of each trial, by Bonferroni's bound."""
    claims = set()
    scores = {s.team: np.array([float(cell.score) for cell in s.trials.values()]) for s in found.standings}
    for one, other in permutations(scores, 2):
        ahead = scores[one] - scores[other]
        count = len(ahead)
        if count > 1 and ahead.mean() > 0:
            spread = float(ahead.std(ddof=1))
            needed = student_quantile(count - 1, 1 - 2 * 0.05 / 12)
            if ahead.mean() * math.sqrt(count) > needed * spread:
                claims.add((one, other))
    return claims


def drawn(kind: Kind, scores: Scores, chance: Chance, draws: int = 1000) -> set[Claim]:
    """Claims where 95 % of competitions drawn from the runs that were made agree, pair by pair."""
    trials = chance.integers(0, kind.trials, (draws, kind.trials))
    sums = {}
    for team, own in zip(TEAMS, scores, strict=True):
        runs = np.array(own)  # of each trial
        picked = chance.integers(0, runs.shape[1], (draws, kind.trials, runs.shape[1]))
        values = np.sort(np.take_along_axis(runs[trials], picked, axis=2), axis=2)[:, :, -kind.keep :]
        sums[team] = values.mean(axis=2).sum(axis=1)
    return {
        (one, other)
        for one, other in permutations(sums, 2)
        if np.quantile(sums[one] - sums[other], 0.025) > 0
    }


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=500)
    parser.add_argument("--only", default="")
    arguments = parser.parse_args()
    print("| competition: trials x runs | like these: false | found | exactly these: false | found |", end="")
    print(" paired t: false | found | draws: false | found |")
    print("|---|---|---|---|---|---|---|---|---|")
    for kind in (kind for kind in KINDS if arguments.only in kind.name):
        true = set() if kind.make is skewed else TRUE
        chance = np.random.default_rng(5)
        spec = Spec(kind.keep, fill=False)
        draws = np.random.default_rng(6)
        counted = np.zeros((4, 2))
        for _ in range(arguments.rounds):
            scores = kind.make(chance, kind)
            made = ranking(kind, scores)
            told = told_apart(made, spec, 3)
            by_draws = drawn(kind, scores, draws)
            for number, claims in enumerate((told.told, told.told_here, paired_t(made), by_draws)):
                counted[number] += bool(set(claims) - true), len(set(claims) & true) / 4
        like, here, by_t, by_draws = (100 * counted / arguments.rounds).tolist()
        shown = f"({here[0]:.1f} %)" if kind.elsewhere else f"{here[0]:.1f} %"
        print(
            f"| {kind.name} | {like[0]:.1f} % | {like[1]:.0f} % | {shown} | {here[1]:.0f} % "
            f"| {by_t[0]:.1f} % | {by_t[1]:.0f} % | {by_draws[0]:.1f} % | {by_draws[1]:.0f} % |",
            flush=True,
        )


if __name__ == "__main__":
    main()
