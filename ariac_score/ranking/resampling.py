"""Other competitions that might as well have happened, drawn from the runs of this one.

Trials are drawn with replacement, the same for all teams; in each trial drawn, the runs of
each team with replacement; then the best of them count as the rules say. The spread of the
draws shows how much of the ranking is chance. docs/ranking.md gives the reasons for this method.

Scores are whole multiples of their last digit, so that sums and ties are exact; random
whole numbers are made from the raw bits of PCG64, whose stream numpy promises to keep. So
a seed gives the same draws on every machine and with every version of numpy.

Source: Davison and Hinkley, Bootstrap Methods and their Application (1997), section 3.8;
Efron and Tibshirani, An Introduction to the Bootstrap (1993), section 7.4 (extremes).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from functools import lru_cache
from itertools import pairwise
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from ariac_score.ranking.beside import merit
from ariac_score.ranking.outcomes import WITH_SCORE, Ranking, RunOutcome
from ariac_score.ranking.rank import cell_digits, is_scored
from ariac_score.ranking.spec import COUNT_BACK, FloatArray, IntArray, Spec, places
from ariac_score.ranking.totals import SUM

__all__ = ["Draws", "RandomBits", "Sampled", "draw", "sampled", "student_quantile", "totalled", "widening"]

BLOCK = 1000
"""Competitions drawn at a time. Another number would give other draws for the same seed."""
_LARGEST = 2**53  # a float holds every whole number up to here
_HALF_WORD = np.uint64(32)
_LOW = np.uint64(0xFFFFFFFF)


class RandomBits:
    """Random whole numbers from the raw output of a PCG64.

    >>> RandomBits(1).below(np.array([6, 6, 6, 6]))
    array([2, 3, 4, 5])
    """

    def __init__(self, seed: int) -> None:
        self._source = np.random.PCG64(seed)

    def halves(self, count: int) -> NDArray[np.uint64]:
        """That many numbers of 32 bits: of each word first the low half, then the high one."""
        words = self._source.random_raw((count + 1) // 2)
        out = np.empty(2 * len(words), dtype=np.uint64)
        np.bitwise_and(words, _LOW, out=out[0::2])
        np.right_shift(words, _HALF_WORD, out=out[1::2])
        return out[:count]

    def below(self, bounds: IntArray) -> IntArray:
        """For each bound a number from 0 to below it.

        Their probabilities differ by at most 2^-32. Rejection would make them equal, but take a
        varying amount of random bits.
        """
        numbers = self.halves(bounds.size).reshape(bounds.shape)
        numbers *= bounds.astype(np.uint64)
        numbers >>= _HALF_WORD
        return numbers.astype(np.int64)


@dataclass(frozen=True)
class Sampled:
    """The runs of a competition as columns to draw from.

    Attributes:
        teams: Ids, in the order of the ranking; those without a value are left out.
        scores: By team, trial and place by merit, in units of the last digit; the last
            place holds the score of a run that was not made.
        counts: By team and trial the number of runs that can be drawn.
        cells: By team and trial the published score, in the same units.
        digits: Decimal digits of the units.
        terms: By name, shaped as `scores`: terms that separate teams of equal value.
        judges: Sum or mean of the judges' marks, where every team has them.
    """

    teams: tuple[str, ...]
    scores: IntArray
    counts: IntArray
    cells: IntArray
    digits: int
    terms: Mapping[str, FloatArray]
    judges: FloatArray | None

    def execution(self, spec: Spec) -> IntArray:
        """Sum over the trials, or what the rules take instead, in units, shape (teams,)."""
        return totalled(self.cells[:, :, None], self.digits, spec)[:, 0]

    def amount(self, units: IntArray) -> FloatArray:
        """Units as points."""
        points = units.astype(np.float64)
        return points / 10.0**self.digits if self.digits >= 0 else points * 10.0**-self.digits


def sampled(ranking: Ranking, spec: Spec, digits: int) -> Sampled:
    """The runs of a ranking, ready to be drawn from.

    Args:
        ranking: The ranking.
        spec: How its runs became it.
        digits: Decimal digits of a score.
    """
    standings = [standing for standing in ranking.standings if standing.value is not None]
    teams = [standing.team for standing in standings]
    trials = ranking.trials
    groups = _by_cell(ranking.runs, teams, trials, spec)
    own = [[standing.trials[trial] for trial in ranking.trials] for standing in standings]
    most = max((len(runs) for runs in groups.values()), default=0)
    digits = _affordable(groups, cell_digits(spec, digits), len(trials), spec.keep)
    scores = np.zeros((len(teams), len(trials), most + 1), dtype=np.int64)
    counts = np.zeros((len(teams), len(trials)), dtype=np.int64)
    terms = {name: np.zeros(scores.shape) for name in spec.terms}
    for (team, trial), runs in groups.items():
        if is_scored(own[team][trial]):
            counts[team, trial] = len(runs)
            for place, run in enumerate(runs):
                assert run.score is not None  # only runs with a score are in `groups`
                scores[team, trial, place] = _units(run.score, digits)
                for name, column in terms.items():
                    column[team, trial, place] = run.terms.get(name, 0.0)
    if spec.fill:
        for trial, name in enumerate(ranking.trials):
            scores[:, trial, most] = _units(ranking.worst.get(name, Decimal(0)), digits)
    judges = [standing.judges for standing in standings]
    return Sampled(
        teams=tuple(teams),
        scores=scores,
        counts=counts,
        cells=np.array([[_units(c.score, digits) for c in row] for row in own], dtype=np.int64).reshape(
            counts.shape
        ),
        digits=digits,
        terms=terms,
        judges=np.array([float(mark) for mark in judges if mark is not None]) if None not in judges else None,
    )


def totalled(cells: IntArray, digits: int, spec: Spec) -> IntArray:
    """The execution of teams for their scores in each trial.

    Args:
        cells: Shape (teams, trials, competitions), in units.
        digits: Decimal digits of the units.
        spec: How runs become a ranking.

    Returns:
        Shape (teams, competitions), in units.
    """
    if spec.total.name == SUM:
        added: IntArray = cells.sum(axis=1)
        return added
    teams, trials, count = cells.shape
    rows = np.moveaxis(cells, 1, 2).reshape(teams * count, trials)
    # Draws repeat each other: the function is called once for scores that are the same.
    different, which = np.unique(rows, axis=0, return_inverse=True)
    found = [
        _units(spec.total.execution([Decimal(unit).scaleb(-digits) for unit in row]), digits)
        for row in different.tolist()
    ]
    return np.array(found, dtype=np.int64)[which.reshape(-1)].reshape(teams, count)


def _by_cell(
    runs: Sequence[RunOutcome], teams: Sequence[str], trials: Sequence[str], spec: Spec
) -> dict[tuple[int, int], list[RunOutcome]]:
    """The runs with a score by number of team and trial, the best first."""
    teams_at = {team: number for number, team in enumerate(teams)}
    trials_at = {trial: number for number, trial in enumerate(trials)}
    groups: dict[tuple[int, int], list[RunOutcome]] = {}
    for run in runs:
        team, trial = teams_at.get(run.team), trials_at.get(run.trial)
        known = run.score is not None and (run.task is not None or run.outcome in WITH_SCORE)
        if team is not None and trial is not None and known:
            groups.setdefault((team, trial), []).append(run)
    return {cell: sorted(own, key=lambda run: merit(run, spec)) for cell, own in groups.items()}


def _affordable(
    groups: Mapping[tuple[int, int], Sequence[RunOutcome]], digits: int, trials: int, keep: int
) -> int:
    """Decimal digits that keep every sum within what a float holds exactly."""
    largest = max(
        (abs(run.score or Decimal(0)) for runs in groups.values() for run in runs), default=Decimal(0)
    )
    while largest.scaleb(digits) * (trials * keep + 1) >= _LARGEST:
        digits -= 1
    return digits


def _units(amount: Decimal, digits: int) -> int:
    # Half to even, as scores and means are rounded when they are published.
    return int(amount.scaleb(digits).quantize(Decimal(1), rounding=ROUND_HALF_EVEN))


# How far a draw is from what was published -----------------------------------------------


def widening(count: int, degrees: int, level: float) -> float:
    """The factor on deviations that makes up for the small number of trials or runs drawn from.

    Draws from n deviate too little by the root of (n - 1) / n, and with few of them quantiles are
    those of Student's distribution, not of the normal one.

    Source: Hesterberg, What Teachers Should Know About the Bootstrap, The American
    Statistician 69 (2015), section 4.3; here deviations are widened and not the level,
    for a quantile beyond the outermost draw cannot be read off.
    """
    normal = NormalDist().inv_cdf((1 + level) / 2)
    # Rounded, because the last bits of the C library's functions differ between machines.
    return round(math.sqrt(count / (count - 1)) * student_quantile(degrees, level) / normal, 9)


def student_quantile(degrees: int, level: float) -> float:
    """The bound that a t-distributed number does not exceed, either way, with this probability.

    Source: Abramowitz and Stegun, Handbook of Mathematical Functions, 26.7.3 and 26.7.4.

    >>> round(student_quantile(2, 0.95), 3), round(student_quantile(14, 0.95), 3)
    (4.303, 2.145)
    """
    low, high = 0.0, 1.0
    while _within(high, degrees) < level and high < 1e9:
        high *= 2
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (middle, high) if _within(middle, degrees) < level else (low, middle)
    return high


_NEARLY_NORMAL = 400
"""With more degrees of freedom Student's distribution is taken for the normal one."""


def _within(t: float, degrees: int) -> float:
    """The probability that a t-distributed number is at most this far from 0."""
    if degrees > _NEARLY_NORMAL:
        return 2 * NormalDist().cdf(t) - 1
    angle = math.atan(t / math.sqrt(degrees))
    sine, square = math.sin(angle), math.cos(angle) ** 2
    odd = degrees % 2
    if degrees == 1:
        return 2 * angle / math.pi
    term = total = math.cos(angle) if odd else 1.0
    for k in range(2 + odd, degrees - 1 + odd, 2):
        term *= square * (k - 1) / k
        total += term if k < degrees else 0.0
    return 2 / math.pi * (angle + sine * total) if odd else sine * total


# Drawing -------------------------------------------------------------------------------


@dataclass(frozen=True)
class Draws:
    """The competitions drawn.

    Attributes:
        execution: Shape (teams, draws), in units, deviations not widened.
        ties: Keys that separate teams of equal value, most important first, each of shape
            (teams, draws), more is better; `None` stands for the execution.
    """

    execution: IntArray
    ties: tuple[FloatArray | None, ...]


def draw(runs: Sampled, spec: Spec, resample: str) -> Draws:
    """Draw competitions.

    Args:
        runs: What to draw from.
        spec: How runs become a ranking, how many draws, and the seed.
        resample: `trials_and_runs`, `trials` or `runs`.
    """
    bits = RandomBits(spec.intervals.seed)
    sampler = _Sampler(runs, spec, bits, resample)
    blocks = [
        sampler.block(min(BLOCK, spec.intervals.draws - start))
        for start in range(0, spec.intervals.draws, BLOCK)
    ]
    execution = np.concatenate([block.execution for block in blocks], axis=1)
    ties = zip(*(block.ties for block in blocks), strict=True) if blocks[0].ties else ()
    return Draws(execution, tuple(_joined(parts) for parts in ties))


def _joined(parts: Sequence[FloatArray | None]) -> FloatArray | None:
    whole = [part for part in parts if part is not None]
    return np.concatenate(whole, axis=1) if whole else None


class _Sampler:
    """Draws blocks of competitions."""

    def __init__(self, runs: Sampled, spec: Spec, bits: RandomBits, resample: str) -> None:
        self.runs, self.spec, self.bits = runs, spec, bits
        self.of_trials = resample != "runs"
        self.of_runs = resample != "trials"
        self.teams, self.trials = runs.counts.shape
        self.most = runs.scores.shape[2] - 1
        self.even = bool((runs.counts == self.most).all())
        self.shift = _shifts(runs, spec) if self.of_runs else np.zeros_like(runs.cells)
        self.rows = (np.arange(self.teams) * self.trials)[:, None]

    def block(self, size: int) -> Draws:
        """Draw that many competitions."""
        scores = np.zeros((self.teams, self.trials, size), dtype=np.int64)
        terms = {name: np.zeros((self.teams, size)) for name in self.spec.terms}
        counted = any(key.name == COUNT_BACK for key in self.spec.ties)
        won = np.zeros((self.teams if counted else 0, self.teams, size))
        for number, chosen in enumerate(self._chosen(size)):
            picked = self._picked(chosen)
            cells = self._cells(chosen, picked)
            scores[:, number] = cells
            for name in terms:
                terms[name] += self._term(self.runs.terms[name], chosen, picked)
            if counted:
                self._count(won, cells, chosen)
        execution = totalled(scores, self.runs.digits, self.spec)
        return Draws(execution, tuple(self._ties(terms, won, size)))

    def _chosen(self, size: int) -> IntArray:
        """For each place of a competition the trial drawn for it, shape (trials, size)."""
        # The same trials for all teams: an easy one is easy for everybody and must not part them.
        if self.of_trials:
            return self.bits.below(np.full((self.trials, size), self.trials, dtype=np.int64))
        return np.repeat(np.arange(self.trials)[:, None], size, axis=1)

    def _picked(self, chosen: IntArray) -> list[NDArray[np.uint8 | np.uint16]]:
        """The runs kept, as places by merit, the best first; each of shape (teams, size)."""
        counts = self.runs.counts[:, chosen]
        kind = np.uint8 if self.most < 256 else np.uint16
        if not self.of_runs:
            return []
        best = [np.full(counts.shape, self.most, dtype=kind) for _ in range(min(self.spec.keep, self.most))]
        for run in range(self.most):
            # Runs are numbered by merit, so the best of those drawn are the smallest numbers.
            drawn = self.bits.below(counts).astype(kind)
            if not self.even:
                drawn[counts <= run] = self.most
            for number, kept in enumerate(best):
                best[number] = np.minimum(kept, drawn)
                drawn = np.maximum(kept, drawn)
        return best

    def _cells(self, chosen: IntArray, picked: Sequence[NDArray[np.uint8 | np.uint16]]) -> IntArray:
        """The score of each team in the trial drawn."""
        counts = self.runs.counts[:, chosen]
        if self.of_runs:
            base = (self.rows + chosen) * (self.most + 1)
            total = self.runs.scores[:, chosen, self.most] * (self.spec.keep - len(picked))
            for place in picked:
                total += self.runs.scores.ravel()[base + place]
            cells = _mean(total, self._divisor(counts)) + self.shift[:, chosen]
        else:
            cells = self.runs.cells[:, chosen]
        if self.even:
            return cells
        return self._behind(cells, counts > 0)

    def _divisor(self, counts: IntArray) -> IntArray | int:
        if self.spec.fill or self.spec.keep == 1:
            return self.spec.keep
        return np.clip(counts, 1, self.spec.keep)

    def _behind(self, cells: IntArray, made: NDArray[np.bool_]) -> IntArray:
        """A trial without a run counts 0, or the score of the worst team in this draw."""
        if self.spec.more_is_better:
            worst = np.where(made, cells, 0).min(axis=0)
            return np.where(made, cells, np.minimum(worst, 0))
        worst = np.where(made, cells, 0).max(axis=0)
        return np.where(made, cells, np.maximum(worst, 0))

    def _term(
        self, column: FloatArray, chosen: IntArray, picked: Sequence[NDArray[np.uint8 | np.uint16]]
    ) -> FloatArray:
        if not self.of_runs:
            kept = column[:, :, : self.spec.keep]
            total = np.zeros(kept.shape[:2])
            for number in range(kept.shape[2]):
                total += kept[:, :, number]
            return total[:, chosen]
        base = (self.rows + chosen) * (self.most + 1)
        found = np.zeros(base.shape)
        for place in picked:
            found += column.ravel()[base + place]
        return found

    def _count(self, won: FloatArray, cells: IntArray, chosen: IntArray) -> None:
        """Add the places of one trial; a team without a run gets none."""
        made = self.runs.counts[:, chosen] > 0
        oriented = cells if self.spec.more_is_better else -cells
        known = np.where(made, oriented, np.iinfo(np.int64).min).astype(np.float64)
        place = places([known]) - 1
        team, competition = np.nonzero(made)
        won[place[team, competition], team, competition] += 1

    def _ties(self, terms: Mapping[str, FloatArray], won: FloatArray, size: int) -> list[FloatArray | None]:
        keys: list[FloatArray | None] = []
        for key in self.spec.ties:
            sign = 1.0 if key.highest else -1.0
            if key.name == "execution":
                keys.append(None)
            elif key.name == COUNT_BACK:
                keys.extend(won)
            elif key.name == "judges":
                marks = np.zeros(self.teams) if self.runs.judges is None else self.runs.judges
                keys.append(np.repeat(sign * marks[:, None], size, axis=1))
            else:
                keys.append(sign * terms[key.name])
        return keys


def _mean(total: IntArray, divisor: IntArray | int) -> IntArray:
    """A sum divided, with halves rounded to the even digit as in a published mean."""
    if isinstance(divisor, int) and divisor == 1:
        return total
    whole = total // divisor
    rest = 2 * (total - whole * divisor)
    up: IntArray = whole + ((rest > divisor) | ((rest == divisor) & (whole % 2 == 1)))
    return up


# The best of few -------------------------------------------------------------------------


def _shifts(runs: Sampled, spec: Spec) -> IntArray:
    """By how much a drawn trial is on average worth less than the published one.

    The best of five runs drawn with replacement is at most the best of the five, and on average
    less, while the published score is as likely too high as too low. So draws are shifted by
    the difference, which is known exactly.
    """
    shift = np.zeros_like(runs.cells)
    for team, trial in zip(*np.nonzero(runs.counts), strict=True):
        count = int(runs.counts[team, trial])
        weights, whole = kept_weights(count, spec.keep)
        scores = [int(score) for score in runs.scores[team, trial, :count]]
        missing = int(runs.scores[team, trial, -1]) * max(spec.keep - count, 0) if spec.fill else 0
        divisor = spec.keep if spec.fill or spec.keep == 1 else min(spec.keep, count)
        total = sum(weight * score for weight, score in zip(weights, scores, strict=True)) + missing * whole
        shift[team, trial] = int(runs.cells[team, trial]) - round_half_even(total, divisor * whole)
    return shift


def round_half_even(value: int, divisor: int) -> int:
    """A quotient of whole numbers, rounded; Python's own division would go through a float."""
    whole, rest = divmod(value, divisor)
    return whole + (2 * rest > divisor or (2 * rest == divisor and whole % 2 == 1))


@lru_cache(maxsize=256)
def kept_weights(count: int, keep: int) -> tuple[tuple[int, ...], int]:
    """How often each run is among the best `keep` when as many runs are drawn as there are.

    Returns:
        For each run, the best first, how often it is kept over all ways of drawing; and the
        number of these ways.

    >>> kept_weights(2, 1)  # of two runs, the better one is the best in 3 of 4 ways
    ((3, 1), 4)
    """
    kept = min(keep, count)
    at_most = [0]
    for place in range(1, count + 1):
        # In how many ways are exactly m of the draws among the first `place` runs?
        ways = [math.comb(count, m) * place**m * (count - place) ** (count - m) for m in range(count + 1)]
        at_most.append(sum(min(m, kept) * way for m, way in enumerate(ways)))
    return tuple(b - a for a, b in pairwise(at_most)), count**count
