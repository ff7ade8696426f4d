"""Exact tests of two teams: the worked cases, every small case by counting, and the level they promise."""

from __future__ import annotations

import itertools
import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.ranking.exact import (
    betting,
    draws_for,
    expected_best,
    fewest_trials,
    holm,
    rank_sets,
    run_permutation,
    sign_flip,
)

CASES = Path(__file__).parents[3] / "shared" / "methods" / "cases.json"


# Worked cases -----------------------------------------------------------------------------


def test_worked_cases(subtests: pytest.Subtests) -> None:
    if not CASES.is_file():
        pytest.skip("the worked cases are not here")
    cases: dict[str, Any] = {one["id"]: one for one in json.loads(CASES.read_text())["ranks"]["cases"]}
    flips = {
        "R3": [3, 1, 2, 4, 5, 2],
        "R4": [3, 1, 2, 4, 5, -2],
        "R5": [3, 0, 0, 0, 0, 0, 0, 0],
        "R6": [1, 1, 1],
    }
    for name, differences in flips.items():
        with subtests.test(name):
            assert float(sign_flip(differences)) == cases[name]["p"]
    with subtests.test("R1"):
        for trials, chance in cases["R1"]["p"].items():
            assert float(sign_flip([1] * int(trials))) == chance
    with subtests.test("R2"):
        for teams, trials in cases["R2"]["teams"].items():
            assert fewest_trials(int(teams)) == trials
    with subtests.test("R5, all zero"):
        assert sign_flip([0] * 8) == cases["R5"]["eight_zeros"]
    with subtests.test("R7"):
        assert float(run_permutation([([9, 8, 7], [5, 6, 4])], keep=3)) == cases["R7"]["p"]
    with subtests.test("R8"):
        ahead = [([9, 8, 7], [5, 6, 4])] * 3
        assert float(run_permutation(ahead, keep=3)) == cases["R8"]["p"]
    with subtests.test("R9"):
        chance = run_permutation([([9, 7, 6, 5, 4], [8])], keep=1)
        assert float(chance) == pytest.approx(cases["R9"]["p_b_over_a"])
    with subtests.test("R10"):
        for runs in (1, 2, 5):
            assert float(expected_best([9, 7, 6, 5, 4], runs)) == cases["R10"][f"r{runs}"]
    with subtests.test("R11"):
        sets = rank_sets("ABCDE", [("A", "D"), ("A", "E"), ("B", "E")])
        assert {team: list(ends) for team, ends in sets.items()} == cases["R11"]["sets"]
    with subtests.test("R12"):
        chances = {(k[0], k[2]): Fraction(str(p)) for k, p in cases["R12"]["p"].items()}
        claims = holm(chances)
        assert sorted(f"{better}>{worse}" for better, worse in claims) == cases["R12"]["claims"]
        sets = rank_sets("ABC", claims)
        assert {team: list(ends) for team, ends in sets.items()} == cases["R12"]["sets"]
    with subtests.test("R12, of one team only"):
        own = {claim: chance for claim, chance in chances.items() if "B" in claim}
        assert rank_sets("ABC", holm(own))["B"] == tuple(cases["R12"]["marginal_for_B_only_m4"]["set_of_B"])
    with subtests.test("R13"):
        assert float(betting([10] * 10, 10)) == pytest.approx(cases["R13"]["closed"], rel=1e-12)
        assert float(betting([1] * 10, 10)) == pytest.approx(cases["R13"]["tenth"], abs=5e-5)


# By counting ------------------------------------------------------------------------------


@given(st.lists(st.integers(-5, 5), max_size=8))
def test_every_way_of_swapping_is_counted(differences: list[int]) -> None:
    ways = list(itertools.product((1, -1), repeat=len(differences)))
    sums = [sum(sign * d for sign, d in zip(way, differences, strict=True)) for way in ways]

    assert sign_flip(differences) == Fraction(sum(s >= sum(differences) for s in sums), len(ways))


@settings(deadline=None)
@given(
    st.lists(
        st.tuples(
            st.lists(st.integers(0, 4), min_size=1, max_size=3),
            st.lists(st.integers(0, 4), min_size=1, max_size=3),
        ),
        min_size=1,
        max_size=2,
    ),
    st.integers(1, 3),
)
def test_every_way_of_dealing_the_runs_is_counted(
    trials: list[tuple[list[int], list[int]]], keep: int
) -> None:
    # All orders of the pooled runs, the first ones dealt to the first team: another way to the same chance.
    def ahead(runs: tuple[int, ...], count: int) -> int:
        best = [sorted(part)[::-1][:keep] for part in (runs[:count], runs[count:])]
        return sum(best[0]) - sum(best[1])

    observed = sum(ahead((*one, *other), len(one)) for one, other in trials)
    each = [
        [ahead(order, len(one)) for order in itertools.permutations((*one, *other))] for one, other in trials
    ]
    sums = [sum(way) for way in itertools.product(*each)]

    chance = run_permutation(trials, keep=keep)

    assert chance == Fraction(sum(s >= observed for s in sums), len(sums))


# What they promise ------------------------------------------------------------------------


@given(st.lists(st.integers(0, 9), min_size=1, max_size=8), st.fractions(Fraction(1, 100), Fraction(1, 2)))
def test_among_equals_a_claim_is_as_rare_as_its_level(sizes: list[int], level: Fraction) -> None:
    # Teams that are equal swap results within trials freely: every choice of signs is as likely.
    ways = list(itertools.product((1, -1), repeat=len(sizes)))
    claims = sum(sign_flip([sign * d for sign, d in zip(way, sizes, strict=True)]) <= level for way in ways)

    assert Fraction(claims, len(ways)) <= level


@given(st.lists(st.integers(-9, 9), max_size=10), st.integers(0, 9))
def test_doing_better_in_a_trial_never_makes_a_claim_weaker(differences: list[int], more: int) -> None:
    # So that the low end of an open score against the high end of another is a sound bound of the claim.
    for place, one in enumerate(differences):
        better = [*differences[:place], one + more, *differences[place + 1 :]]
        assert sign_flip(better) <= sign_flip(differences)


@pytest.mark.slow
@given(st.dictionaries(st.sampled_from(list(itertools.permutations("ABCD", 2))), st.fractions(0, 1)))
def test_holm_claims_no_less_than_bonferroni_and_no_more_than_one_test_alone(
    chances: dict[tuple[str, str], Fraction],
) -> None:
    claims = holm(chances)

    error = Fraction(1, 20)
    assert {c for c, p in chances.items() if p * len(chances) <= error} <= claims
    assert claims <= {c for c, p in chances.items() if p <= error}


# Too many to count ------------------------------------------------------------------------


def test_of_many_ways_some_are_drawn_and_the_chance_is_never_0() -> None:
    # 41 trials all won by one: 2^-41 by counting, which no draw meets. The 32 of 50 are a binomial tail.
    assert sign_flip([1] * 41, draws=9_999) == Fraction(1, 10_000)
    even = [1] * 32 + [-1] * 18  # of 50: P(at least 32 of 50) = 0.0325
    assert float(sign_flip(even, draws=50_000)) == pytest.approx(0.0325, abs=0.004)


def test_drawn_and_counted_ways_of_dealing_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    trials = [([9, 3, 5, 7], [4, 6, 2, 8]), ([1, 9, 9, 2], [3, 3, 1, 2])]
    counted = run_permutation(trials, keep=2)

    monkeypatch.setattr("ariac_score.ranking.exact.MOST_WAYS", 10)

    assert float(run_permutation(trials, keep=2, draws=50_000)) == pytest.approx(float(counted), abs=0.01)


def test_a_drawn_chance_can_pass_the_strictest_bound() -> None:
    for teams in (2, 6, 20, 100):
        assert Fraction(1, draws_for(teams) + 1) * teams * (teams - 1) <= Fraction(1, 20)


# What must fail ---------------------------------------------------------------------------


def test_the_best_of_more_runs_than_were_made_is_refused() -> None:
    with pytest.raises(ValueError, match="best of 3 cannot be had from 2 runs"):
        expected_best([4, 6], 3)


def test_a_trial_beyond_its_bound_is_refused() -> None:
    with pytest.raises(ValueError, match="more than 10"):
        betting([3, -11], 10)


def test_losing_is_no_claim() -> None:
    assert sign_flip([-1] * 10) == 1
    assert run_permutation([([1, 2, 3], [7, 8, 9])], keep=3) == 1
    assert betting([-1] * 10, 1) == 1
    assert not holm({("A", "B"): Fraction(1, 16)})
