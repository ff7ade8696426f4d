"""How many trials would tell teams apart: against binomial tables, and laws."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ariac_score.cli import main
from ariac_score.errors import UsageError
from ariac_score.ranking.design import COMPETITIONS, designs
from ariac_score.ranking.resampling import Sampled
from ariac_score.ranking.spec import Spec

SPEC = Spec()


def runs(scores: list[list[list[int]]]) -> Sampled:
    """By team, trial and run, as many runs everywhere."""
    made = np.array(scores, dtype=np.int64)
    counts = np.full(made.shape[:2], made.shape[2])
    padded = np.concatenate([made, np.zeros((*made.shape[:2], 1), dtype=np.int64)], axis=2)
    return Sampled(tuple("AB"[: len(scores)]), padded, counts, made.max(axis=2), 0, {}, None)


def test_without_chance_the_fewest_trials_suffice() -> None:
    # Both always do the same, so one is ahead by the points in every trial: six wins of six.
    (size,) = designs(runs([[[5]] * 4, [[7]] * 4]), SPEC, 1.0)

    assert (size.trials, size.power) == (6, 1.0)


def test_a_coin_that_wins_four_of_five_trials_takes_as_many_as_the_binomial_says() -> None:
    # One is 10 ahead or behind, as likely; 8 points more make 18 and -2. Of n trials the sum is told
    # when the share of sign patterns that reach it is at most 1/40.
    def told(n: int, won: int) -> bool:
        reached = sum(
            math.comb(won, plus) * math.comb(n - won, other)
            for plus in range(won + 1)
            for other in range(n - won + 1)
            if 18 * (2 * plus - won) - 2 * (2 * other - (n - won)) >= 18 * won - 2 * (n - won)
        )
        return reached / 2**n <= 1 / 40

    power = {n: sum(math.comb(n, w) for w in range(n + 1) if told(n, w)) / 2**n for n in range(6, 25)}

    (size,) = designs(runs([[[10]] * 10, [[0], [20]] * 5]), SPEC, 8.0)

    assert size.trials is not None
    # Five standard errors of the competitions simulated, on both sides of four of five.
    error = 5 * math.sqrt(0.16 / COMPETITIONS)
    assert power[size.trials] >= 0.8 - error
    assert power[size.trials - 2] <= 0.8 + error


@pytest.mark.slow
def test_more_runs_take_no_more_trials_where_luck_is_of_the_run() -> None:
    chance = np.random.default_rng(3)
    scores = chance.integers(0, 100, (2, 12, 4)).tolist()
    keeping_all = Spec(keep=4)

    sizes = designs(runs(scores), keeping_all, 40.0)

    assert [size.runs for size in sizes] == [1, 2, 3, 4]
    trials = [size.trials or 41 for size in sizes]
    assert trials[-1] < trials[0]


def test_a_difference_far_below_the_luck_takes_more_trials_than_anybody_holds() -> None:
    (size,) = designs(runs([[[0], [100]] * 5, [[100], [0]] * 5]), SPEC, 1.0)

    assert size.trials is None
    assert size.power < 0.2


@pytest.mark.parametrize("points", [0.0, -3.0, float("nan")])
def test_no_difference_is_refused(points: float) -> None:
    with pytest.raises(UsageError, match="cannot be told"):
        designs(runs([[[5]], [[7]]]), SPEC, points)


def test_one_team_alone_is_refused() -> None:
    with pytest.raises(UsageError, match="no two teams"):
        designs(runs([[[5]]]), SPEC, 1.0)


@pytest.mark.slow
def test_the_command_says_how_many_trials(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rank", "examples/competition/2024", "--design", "20"]) == 0

    shown = capsys.readouterr().out.splitlines()
    assert shown[0].startswith("To tell two of 3 teams apart that differ by 20 points a trial")
    assert shown[1].startswith("  1 run of each: ")
