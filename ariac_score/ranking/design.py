"""How many trials and runs would tell teams apart: competitions like this one, simulated larger.

Two teams that differ by some points a trial, and else as any two teams of this competition do, meet on so
many trials, in each of which both make so many runs: trials and runs are drawn from those there are. How many
trials does it take until the sign flip tells them apart in four of five such competitions, all claims
together?
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations

import numpy as np

from ariac_score.errors import UsageError
from ariac_score.ranking.exact import fewest_trials, sign_flip
from ariac_score.ranking.resampling import RandomBits, Sampled
from ariac_score.ranking.spec import IntArray, Spec

__all__ = ["MOST_TRIALS", "POWER", "Design", "designs"]

POWER = 0.8
"""In this share of competitions the difference is to be told."""
COMPETITIONS = 400
"""So many are simulated for each number of trials."""
MOST_TRIALS = 24
"""Nobody holds more; and the ways of swapping double with each."""


@dataclass(frozen=True)
class Design:
    """One size of a competition.

    Attributes:
        runs: Of each team in each trial.
        trials: The fewest that suffice; `None` when 24 do not.
        power: In which share of competitions of that size the difference is told; of 24 trials where they do
            not suffice.
    """

    runs: int
    trials: int | None
    power: float


def designs(runs: Sampled, spec: Spec, points: float) -> tuple[Design, ...]:
    """The fewest trials that would do, for each number of runs up to that which every team made.

    Args:
        runs: Of the competition.
        spec: How its runs become a ranking.
        points: The difference a trial that is to be told, above 0.

    Raises:
        UsageError: The difference is none; there are no two teams; or no trial that all teams ran.
    """
    if not points > 0:
        raise UsageError(
            f"a difference of {points:g} points cannot be told", hint="give how many points are to count"
        )
    whole = np.flatnonzero((runs.counts > 0).all(axis=0))
    if len(runs.teams) < 2 or not len(whole):
        raise UsageError(
            "there are no two teams with a run of the same trial, so nothing tells how much is chance",
            hint="run the competition, or a part of it, first",
        )
    made = int(runs.counts[:, whole].min())
    return tuple(_fewest(_Meeting(runs, whole, spec, each), points) for each in range(1, made + 1))


@dataclass(frozen=True)
class _Meeting:
    """Two teams of a competition that meet again, each with some runs a trial."""

    sampled: Sampled
    whole: IntArray
    spec: Spec
    runs: int

    def differences(self, bits: RandomBits, trials: int) -> Iterator[IntArray]:
        """For each pair of teams how far they are apart, shape (competitions, trials), in units."""
        chosen = self.whole[bits.below(np.full((COMPETITIONS, trials), len(self.whole), dtype=np.int64))]
        cells = [self._cell(bits, team, chosen) for team in range(len(self.sampled.teams))]
        for one, other in combinations(cells, 2):
            apart = one - other
            # What is left of their own difference would count as one that is always there.
            yield apart - int(apart.sum()) // apart.size

    def _cell(self, bits: RandomBits, team: int, chosen: IntArray) -> IntArray:
        """What a team has in each trial drawn: the mean of the best of the runs drawn."""
        counts = self.sampled.counts[team, chosen]
        drawn = np.stack([bits.below(counts) for _ in range(self.runs)], axis=-1)
        scores = np.take_along_axis(self.sampled.scores[team, chosen], drawn, axis=-1)
        best = np.sort(scores if self.spec.more_is_better else -scores, axis=-1)[..., ::-1]
        keep = min(self.spec.keep, self.runs)
        mean: IntArray = best[..., :keep].sum(axis=-1) // keep
        return mean


def _fewest(meeting: _Meeting, points: float) -> Design:
    teams = len(meeting.sampled.teams)
    level = meeting.spec.intervals.level
    low, high = fewest_trials(teams, level), MOST_TRIALS
    most = _power(meeting, points, high)
    if most < POWER:
        return Design(meeting.runs, None, most)
    power = most
    while low < high:  # more trials tell more, so the fewest are found by halving
        middle = (low + high) // 2
        told = _power(meeting, points, middle)
        if told >= POWER:
            high, power = middle, told
        else:
            low = middle + 1
    return Design(meeting.runs, high, power)


def _power(meeting: _Meeting, points: float, trials: int) -> float:
    """In which share of competitions a difference is told: the mean over all pairs of teams."""
    teams = len(meeting.sampled.teams)
    bound = (1 - Fraction(str(meeting.spec.intervals.level))) / (teams * (teams - 1))
    more = round(points * 10**meeting.sampled.digits)
    told = [
        sign_flip((row + more).tolist()) <= bound
        for apart in meeting.differences(RandomBits(meeting.spec.intervals.seed), trials)
        for row in apart[: max(COMPETITIONS // (teams * (teams - 1) // 2), 20)]
    ]
    return sum(told) / len(told)
