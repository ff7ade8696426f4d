"""How sure a ranking is: rank intervals, chances of each rank, groups of indistinguishable teams.

Computed from competitions drawn from the runs of this one (`resampling`). The ranking
itself is the estimate; nothing here changes it. docs/ranking.md describes the method and
how often the intervals hold in simulations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from ariac_score.errors import FormulaError
from ariac_score.ranking.rank import Ranking
from ariac_score.ranking.resampling import Draws, Sampled, draw, sampled, student_quantile, widening
from ariac_score.ranking.spec import FloatArray, IntArray, Intervals, Spec, places
from ariac_score.results.result import canonical
from ariac_score.scoring.decimals import in_own_decimals

__all__ = ["Group", "Pair", "Statistics", "TeamOdds", "rank_statistics"]

FEW_TRIALS = 8
"""With fewer trials a note warns; docs/ranking.md shows how wide the intervals of 3 and 6 are."""
METHOD = "bootstrap by trial and run, paired between teams; PCG64"


@dataclass(frozen=True)
class TeamOdds:
    """How sure the place of one team is.

    Attributes:
        team: Id.
        rank_low: Best rank it may have.
        rank_high: Worst rank it may have.
        chances: The share of draws in which it has each rank, from the first on; of a shared
            rank the first counts.
        execution: Interval of its sum over the trials, in points.
    """

    team: str
    rank_low: int
    rank_high: int
    chances: tuple[float, ...]
    execution: tuple[float, float]


@dataclass(frozen=True)
class Pair:
    """By how much one team is ahead of another in what they are ranked by.

    Attributes:
        first: The team that is ranked higher, or listed before.
        second: The other.
        ahead: By how much, as published; positive where the first is better.
        low: Lower end of the interval for this pair alone.
        high: Its upper end.
        joint_low: Lower end where all pairs are to hold together.
        joint_high: Its upper end.
        chance: The share of draws in which the first team comes before the second; draws with a
            shared rank count half.
    """

    first: str
    second: str
    ahead: float
    low: float
    high: float
    joint_low: float
    joint_high: float
    chance: float

    @property
    def distinguished(self) -> bool:
        """Whether the difference holds at the declared level, together with all others."""
        return self.joint_low > 0 or self.joint_high < 0


@dataclass(frozen=True)
class Group:
    """Neighbours in the ranking of whom no two can be distinguished.

    Attributes:
        label: `A`, `B`, …
        teams: In the order of the ranking.
    """

    label: str
    teams: tuple[str, ...]


@dataclass(frozen=True)
class Statistics:
    """How sure a ranking is.

    Attributes:
        intervals: As declared.
        method: How competitions were drawn.
        resample: What was drawn; with a single trial only runs can be.
        widened_by: The factor on deviations, because few trials or runs were drawn from.
        notes: What a reader must know.
        teams: In the order of the ranking; empty where there is nothing to draw from.
        pairs: Each two teams once.
        groups: Best first; neighbouring ones may overlap.
    """

    intervals: Intervals
    method: str = METHOD
    resample: str = ""
    widened_by: float = 1.0
    notes: tuple[str, ...] = ()
    teams: tuple[TeamOdds, ...] = ()
    pairs: tuple[Pair, ...] = ()
    groups: tuple[Group, ...] = ()


@in_own_decimals
def rank_statistics(ranking: Ranking, spec: Spec, digits: int) -> Statistics:
    """How sure a ranking is.

    Args:
        ranking: The ranking.
        spec: How its runs became it, and how competitions are drawn.
        digits: Decimal digits of a score.
    """
    declared = spec.intervals
    runs = sampled(ranking, spec, digits)
    plan = _plan(runs, declared)
    if isinstance(plan, str):
        return Statistics(declared, notes=(plan,))
    resample, count, degrees = plan
    widened_by = widening(count, degrees, declared.level)
    drawn = draw(runs, spec, resample)
    execution = _widened(runs, drawn, spec, widened_by)
    published = np.array([s.value for s in ranking.standings if s.value is not None], dtype=np.float64)
    try:
        value = spec.columns(runs.amount(execution), runs.judges)
    except FormulaError as error:
        return Statistics(declared, notes=(f"in some draws the value cannot be had: {error.cause}",))
    sign = 1.0 if spec.highest else -1.0
    value, published = sign * value, sign * published
    # As a tie-break the execution has its own direction. It is taken after widening, as the value is:
    # otherwise a team could have more execution in the value and less in the tie-break of one draw.
    sums = next((key.highest for key in spec.ties if key.name == "execution"), True)
    own = runs.amount(execution) if sums else -runs.amount(execution)
    keys = [value, *(own if key is None else key for key in drawn.ties)]
    ranks = places(keys)
    pairs = _pairs(runs.teams, value, published, ranks, _Level(declared.level, degrees))
    return Statistics(
        intervals=declared,
        resample=resample,
        widened_by=widened_by,
        notes=tuple(_notes(runs, declared, resample, count)),
        teams=_odds(runs, execution, ranks, pairs, declared.level),
        pairs=pairs,
        groups=_groups(runs.teams, pairs),
    )


# What to draw --------------------------------------------------------------------------


def _plan(runs: Sampled, declared: Intervals) -> tuple[str, int, int] | str:
    """What is drawn, from how many, with how many degrees of freedom; or why nothing can be drawn."""
    made = runs.counts[runs.counts > 0]
    if not len(made):
        return "no run of a ranked team has a score, so there is nothing to draw from"
    # A trial that nobody ran varies nothing, so it is none of those that are drawn from.
    trials = int(np.count_nonzero((runs.counts > 0).any(axis=0)))
    if declared.resample != "runs" and trials > 1:
        return declared.resample, trials, trials - 1
    several = made[made > 1]
    if declared.resample == "trials" or not len(several):
        what = "one trial" if trials == 1 else f"{trials} trials"
        each = "" if declared.resample == "trials" else " and one run of each"
        return f"{what}{each}: nothing tells how much of it is chance"
    return "runs", int(several.min()), int((several - 1).sum()) // max(len(runs.teams), 1) or 1


def _notes(runs: Sampled, declared: Intervals, resample: str, count: int) -> list[str]:
    notes = []
    if resample != declared.resample:
        notes.append("there is one trial only, so that runs are drawn: about other trials nothing is said")
    elif resample != "runs" and count < FEW_TRIALS:
        notes.append(
            f"{count} trials are few: what they cannot tell apart may still differ, "
            f"and intervals are {widening(count, count - 1, declared.level):.3g} times as wide as the draws"
        )
    alone = int(np.count_nonzero(runs.counts == 1))
    if resample != "trials" and alone:
        trials = "a trial has" if alone == 1 else f"{alone} trials of teams have"
        notes.append(f"{trials} one run only, of which no other can be drawn")
    return notes


def _widened(runs: Sampled, drawn: Draws, spec: Spec, by: float) -> IntArray:
    """The sums drawn, with deviations widened."""
    published = runs.execution(spec)[:, None]
    wide: IntArray = published + np.rint(by * (drawn.execution - published)).astype(np.int64)
    # A team without any run does not vary, so widening could put it ahead of one that did badly in a draw.
    none = (runs.counts == 0).all(axis=1)
    if none.any() and not none.all():
        if spec.more_is_better:
            wide[none] = np.minimum(wide[none], wide[~none].min(axis=0))
        else:
            wide[none] = np.maximum(wide[none], wide[~none].max(axis=0))
    return wide


# What the draws say --------------------------------------------------------------------


class _Level:
    """A declared level, for one statement and for many together."""

    def __init__(self, level: float, degrees: int) -> None:
        self.level, self.degrees = level, degrees

    def joint(self, largest: FloatArray) -> float:
        """The half width, in standard deviations, with which all intervals hold together.

        The level that a single interval must have for all to hold is read off the draws;
        with few degrees of freedom its width is that of Student's distribution.

        Source: Romano and Wolf, Stepwise Multiple Testing, Econometrica 73 (2005): max-t from draws.

        Args:
            largest: For each draw the largest deviation of all, in standard deviations.
        """
        if not largest.any():
            return 0.0
        drawn = float(_quantile(largest, self.level))
        single = min(max(2 * NormalDist().cdf(drawn) - 1, self.level), 1 - 1e-9)
        wider = student_quantile(self.degrees, single) / NormalDist().inv_cdf((1 + single) / 2)
        own = student_quantile(self.degrees, self.level) / NormalDist().inv_cdf((1 + self.level) / 2)
        return max(drawn, 0.0) * wider / own


def _quantile(values: FloatArray, share: float) -> float:
    """The smallest drawn value that this share of the values does not exceed."""
    # Rounded first, because a product such as 250.00000000000023 must not become 251.
    place = min(max(math.ceil(round(share * len(values), 6)) - 1, 0), len(values) - 1)
    return float(np.partition(values, place)[place])


def _ends(values: FloatArray, level: float) -> tuple[float, float]:
    """The interval that leaves out equal shares of the draws below and above."""
    count = len(values)
    low = min(max(math.ceil(round((1 - level) / 2 * count, 6)) - 1, 0), count - 1)
    high = min(max(math.ceil(round((1 + level) / 2 * count, 6)) - 1, 0), count - 1)
    ordered = np.partition(values, (low, high))
    return float(ordered[low]), float(ordered[high])


def _pairs(
    teams: Sequence[str], value: FloatArray, published: FloatArray, ranks: IntArray, level: _Level
) -> tuple[Pair, ...]:
    largest = np.zeros(value.shape[1])
    found: list[tuple[Pair, float]] = []
    for one in range(len(teams)):
        for other in range(one + 1, len(teams)):
            difference = value[one] - value[other]
            ahead = float(published[one] - published[other])
            deviation = np.abs(difference - ahead)
            # Around the published difference, not the mean of the draws: the interval is centred there.
            spread = math.sqrt(_added(deviation * deviation) / len(deviation))
            if spread > 0:
                np.maximum(largest, deviation / spread, out=largest)
            low, high = _ends(difference, level.level)
            before = np.count_nonzero(ranks[one] < ranks[other])
            shared = np.count_nonzero(ranks[one] == ranks[other])
            chance = float((before + shared / 2) / len(difference))
            pair = Pair(
                teams[one], teams[other], canonical(ahead), canonical(low), canonical(high), 0.0, 0.0, chance
            )
            found.append((pair, spread))
    times = level.joint(largest)
    return tuple(
        replace(
            pair,
            joint_low=canonical(pair.ahead - times * spread),
            joint_high=canonical(pair.ahead + times * spread),
        )
        for pair, spread in found
    )


def _added(values: FloatArray) -> float:
    """The sum, added pairwise: numpy's own order of addition differs between machines and versions."""
    while len(values) > 1:
        if len(values) % 2:
            values = np.append(values, 0.0)
        values = values[0::2] + values[1::2]
    return float(values[0]) if len(values) else 0.0


def _odds(
    runs: Sampled, execution: IntArray, ranks: IntArray, pairs: Sequence[Pair], level: float
) -> tuple[TeamOdds, ...]:
    # Ranks come from the joint intervals of differences. Quantiles of the drawn ranks would be simpler, but
    # the bootstrap of a rank is not consistent where teams are equal (Hall and Miller, docs/ranking.md).
    count = len(runs.teams)
    ahead = dict.fromkeys(runs.teams, 0)
    behind = dict.fromkeys(runs.teams, 0)
    for pair in pairs:
        if pair.distinguished:
            better, worse = (pair.first, pair.second) if pair.joint_low > 0 else (pair.second, pair.first)
            ahead[worse] += 1
            behind[better] += 1
    found = []
    for number, team in enumerate(runs.teams):
        chances = np.bincount(ranks[number] - 1, minlength=count) / ranks.shape[1]
        low, high = _ends(runs.amount(execution[number]), level)
        found.append(
            TeamOdds(
                team,
                1 + ahead[team],
                count - behind[team],
                tuple(float(chance) for chance in chances),
                (canonical(low), canonical(high)),
            )
        )
    return tuple(found)


def _groups(teams: Sequence[str], pairs: Sequence[Pair]) -> tuple[Group, ...]:
    """The longest rows of neighbours of whom no two can be distinguished."""
    distinct = {(pair.first, pair.second) for pair in pairs if pair.distinguished}
    ends: list[int] = []
    for start in range(len(teams)):
        end = start + 1
        while end < len(teams) and not any((team, teams[end]) in distinct for team in teams[start:end]):
            end += 1
        ends.append(end)
    rows = [(start, end) for start, end in enumerate(ends) if start == 0 or end > ends[start - 1]]
    return tuple(Group(_label(number), tuple(teams[a:b])) for number, (a, b) in enumerate(rows))


def _label(number: int) -> str:
    """A, B, …, Z, AA, AB, …

    >>> _label(0), _label(25), _label(26)
    ('A', 'Z', 'AA')
    """
    label = ""
    number += 1
    while number:
        number, rest = divmod(number - 1, 26)
        label = chr(ord("A") + rest) + label
    return label
