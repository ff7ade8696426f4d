"""How sure a ranking is: who is told apart, which ranks each team may have, who cannot be distinguished.

Claims come from exact tests (`claims`). From enough trials on, competitions drawn from the runs of this one
(`resampling`) describe it: intervals, and chances of each rank. The ranking itself is the estimate; nothing
here changes it. docs/ranking.md describes the method and how often claims are wrong in simulations.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import combinations

import numpy as np

from ariac_score.errors import FormulaError
from ariac_score.ranking.claims import MOST_DEALT, Told, told_apart
from ariac_score.ranking.exact import Claim, fewest_trials, rank_sets
from ariac_score.ranking.outcomes import Ranking
from ariac_score.ranking.resampling import Draws, Sampled, draw, sampled, widening
from ariac_score.ranking.selection import Selection, selections
from ariac_score.ranking.spec import FloatArray, IntArray, Intervals, Spec, places
from ariac_score.results.codec import leave_out_empty
from ariac_score.results.result import canonical
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import Number

__all__ = ["Group", "Pair", "Statistics", "TeamOdds", "rank_statistics"]

DESCRIBED_FROM = 15
"""Competitions drawn from fewer trials repeat each other, and may differ by nothing at all."""
METHOD = "sign flip over trials, runs dealt anew within trials, Holm; bootstrap by trial and run; PCG64"


@dataclass(frozen=True)
class TeamOdds:
    """How sure the place of one team is.

    Attributes:
        team: Id.
        rank_low: Best rank it may have on trials like these; those of all teams hold together.
        rank_high: Worst rank it may have.
        here_low: Best rank it may have on exactly these trials, run again.
        here_high: Worst rank it may have there.
        chances: The share of draws in which it has each rank, from the first on; of a shared
            rank the first counts. Empty where too few trials describe anything.
        execution: Interval of its sum over the trials, in points; `None` likewise.
    """

    team: str
    rank_low: int
    rank_high: int
    here_low: int
    here_high: int
    chances: tuple[float, ...] = ()
    execution: tuple[float, float] | None = None


@dataclass(frozen=True)
class Pair:
    """By how much one team is ahead of another in what they are ranked by, and whether that is told.

    Attributes:
        first: The team that is ranked higher, or listed before.
        second: The other.
        ahead: By how much, as published; positive where the first is better.
        p: How often swapping their results within trials gives at least the difference that there was.
        p_back: The same for the second team being better.
        told: The team that is told to be better on trials like these, all claims together at the declared
            level; empty: they cannot be told apart.
        p_here: How often dealing the runs of these trials anew gives at least the difference that there was;
            `None` where that was not asked.
        p_here_back: The same for the second team being better.
        told_here: The team that is told to be better on exactly these trials.
        low: Lower end of the interval for this pair alone; `None` where too few trials describe anything.
        high: Its upper end.
        chance: The share of draws in which the first team comes before the second; draws with a
            shared rank count half.
    """

    first: str
    second: str
    ahead: float
    p: float
    p_back: float
    told: str = ""
    p_here: float | None = None
    p_here_back: float | None = None
    told_here: str = ""
    low: float | None = None
    high: float | None = None
    chance: float | None = None

    @property
    def distinguished(self) -> bool:
        """Whether the difference holds at the declared level, together with all others."""
        return bool(self.told)


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
        method: How teams were told apart, and competitions drawn.
        resample: What was drawn; empty where nothing was, because too few trials describe anything.
        widened_by: The factor on deviations, because few trials or runs were drawn from.
        notes: What a reader must know.
        teams: In the order of the ranking; empty where no run has a score.
        pairs: Each two teams once.
        groups: Best first; neighbouring ones may overlap.
        selection: In the order of the ranking, what choosing the best runs does; empty where all count.
    """

    intervals: Intervals
    method: str = METHOD
    resample: str = ""
    widened_by: float = 1.0
    notes: tuple[str, ...] = ()
    teams: tuple[TeamOdds, ...] = ()
    pairs: tuple[Pair, ...] = ()
    groups: tuple[Group, ...] = ()
    selection: tuple[Selection, ...] = ()

    def __post_init__(self) -> None:
        leave_out_empty(self, "selection")


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
    if not runs.counts.any():
        return Statistics(
            declared, notes=("no run of a ranked team has a score, so there is nothing to tell",)
        )
    told = told_apart(ranking, spec, digits)
    published = {s.team: s.value for s in ranking.standings if s.value is not None}
    pairs = _pairs(runs.teams, published, told, highest=spec.highest)
    described = _described(runs, spec)
    if isinstance(described, _Described):
        pairs = tuple(_with_interval(pair, runs.teams, described, declared.level) for pair in pairs)
    return Statistics(
        intervals=declared,
        resample=described.resample if isinstance(described, _Described) else "",
        widened_by=described.widened_by if isinstance(described, _Described) else 1.0,
        notes=tuple(_notes(ranking, runs, spec, told, described)),
        teams=_odds(runs, told, described if isinstance(described, _Described) else None, declared.level),
        pairs=pairs,
        groups=_groups(runs.teams, pairs),
        selection=selections(ranking, spec, digits),
    )


def _notes(
    ranking: Ranking, runs: Sampled, spec: Spec, told: Told, described: _Described | str
) -> Iterator[str]:
    teams = len(runs.teams)
    least = fewest_trials(teams, spec.intervals.level)
    if teams > 1 and told.differing < least:
        had = "1 trial" if told.differing == 1 else f"{told.differing} trials"
        yield (
            f"with {had} in which two teams differ no number of points could tell {teams} teams apart on "
            f"trials like these: that takes {least} such trials"
        )
    if teams > 1 and (runs.counts <= 1).all():
        yield "every trial was run once: nothing tells how another day would have gone on these trials"
    elif teams > MOST_DEALT:
        yield f"of more than {MOST_DEALT} teams nothing is told about exactly these trials"
    if spec.value.source.strip() != "execution":
        yield (
            f"teams are ranked by {spec.value.source}; who is told apart, and the ranks that follow, is "
            "about the points alone"
        )
    sets = rank_sets(runs.teams, told.told)
    ranks = {s.team: s.rank for s in ranking.standings}
    if any((own := ranks[team]) is not None and not low <= own <= high for team, (low, high) in sets.items()):
        yield (
            "like with like another order is told than is published: teams ran a trial differently often, or "
            "are ranked by more than their points"
        )
    if isinstance(described, str):
        yield described


# What describes a ranking -----------------------------------------------------------------


@dataclass(frozen=True)
class _Described:
    """Competitions drawn, deviations widened.

    Attributes:
        resample: What was drawn.
        widened_by: The factor on deviations.
        execution: Shape (teams, draws), in units.
        value: What teams are ranked by, more is better, shape (teams, draws).
        ranks: Shape (teams, draws).
    """

    resample: str
    widened_by: float
    execution: IntArray
    value: FloatArray
    ranks: IntArray


def _described(runs: Sampled, spec: Spec) -> _Described | str:
    """Competitions drawn; or why they would describe nothing."""
    declared = spec.intervals
    # A trial that nobody ran varies nothing, so it is none of those that are drawn from.
    trials = int(np.count_nonzero((runs.counts > 0).any(axis=0)))
    if trials < DESCRIBED_FROM:
        return f"intervals of scores and chances of ranks need {DESCRIBED_FROM} trials, so there are none"
    several = runs.counts[runs.counts > 1]
    count, degrees = trials, trials - 1
    if declared.resample == "runs":
        if not len(several):
            return "intervals and chances of ranks are left out: of one run no other can be drawn"
        count, degrees = int(several.min()), int((several - 1).sum()) // max(len(runs.teams), 1) or 1
    widened_by = widening(count, degrees, declared.level)
    drawn = draw(runs, spec, declared.resample)
    execution = _widened(runs, drawn, spec, widened_by)
    try:
        value = spec.columns(runs.amount(execution), runs.judges)
    except FormulaError as error:
        return f"in some draws the value cannot be had: {error.cause}"
    value = value if spec.highest else -value
    alike = (len(np.unique(value[a] - value[b])) == 1 for a, b in combinations(range(len(value)), 2))
    if not drawn.ties and any(alike):
        return "intervals and chances of ranks are left out: between some teams no draw differs from another"
    # As a tie-break the execution has its own direction. It is taken after widening, as the value is:
    # otherwise a team could have more execution in the value and less in the tie-break of one draw.
    sums = next((key.highest for key in spec.ties if key.name == "execution"), True)
    own = runs.amount(execution) if sums else -runs.amount(execution)
    keys = [value, *(own if key is None else key for key in drawn.ties)]
    return _Described(declared.resample, widened_by, execution, value, places(keys))


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


def _ends(values: FloatArray, level: float) -> tuple[float, float]:
    """The interval that leaves out equal shares of the draws below and above."""
    count = len(values)
    # Rounded first, because a product such as 250.00000000000023 must not become 251.
    low = min(max(math.ceil(round((1 - level) / 2 * count, 6)) - 1, 0), count - 1)
    high = min(max(math.ceil(round((1 + level) / 2 * count, 6)) - 1, 0), count - 1)
    ordered = np.partition(values, (low, high))
    return float(ordered[low]), float(ordered[high])


def _with_interval(pair: Pair, teams: Sequence[str], described: _Described, level: float) -> Pair:
    one, other = teams.index(pair.first), teams.index(pair.second)
    difference, ranks = described.value[one] - described.value[other], described.ranks
    low, high = _ends(difference, level)
    before = np.count_nonzero(ranks[one] < ranks[other])
    shared = np.count_nonzero(ranks[one] == ranks[other])
    chance = float((before + shared / 2) / len(difference))
    return replace(pair, low=canonical(low), high=canonical(high), chance=chance)


# What is told -----------------------------------------------------------------------------


def _pairs(
    teams: Sequence[str], published: Mapping[str, Number], told: Told, *, highest: bool
) -> tuple[Pair, ...]:
    def better(claims: Collection[Claim], one: str, other: str) -> str:
        return one if (one, other) in claims else other if (other, one) in claims else ""

    def p(tests: Mapping[Claim, Fraction], claim: Claim) -> float | None:
        return canonical(float(tests[claim])) if claim in tests else None

    sign = 1 if highest else -1
    return tuple(
        Pair(
            one,
            other,
            canonical(sign * (float(published[one]) - float(published[other]))),
            canonical(float(told.on_like_trials[one, other])),
            canonical(float(told.on_like_trials[other, one])),
            better(told.told, one, other),
            p(told.on_these_trials, (one, other)),
            p(told.on_these_trials, (other, one)),
            better(told.told_here, one, other),
        )
        for one, other in combinations(teams, 2)
    )


def _odds(runs: Sampled, told: Told, described: _Described | None, level: float) -> tuple[TeamOdds, ...]:
    like, here = rank_sets(runs.teams, told.told), rank_sets(runs.teams, told.told_here)
    count = len(runs.teams)
    found = []
    for number, team in enumerate(runs.teams):
        odds = TeamOdds(team, *like[team], *here[team])
        if described is not None:
            ranks = described.ranks
            chances = np.bincount(ranks[number] - 1, minlength=count) / ranks.shape[1]
            low, high = _ends(runs.amount(described.execution[number]), level)
            odds = replace(
                odds,
                chances=tuple(float(chance) for chance in chances),
                execution=(canonical(low), canonical(high)),
            )
        found.append(odds)
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
