"""How sure a ranking is: small cases by hand, laws, and simulated competitions with known truth.

The tests themselves are in test_exact.py; here is what a ranking makes of them.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from decimal import Decimal
from fractions import Fraction
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import Cell, Ranking, RunOutcome, TeamRank
from ariac_score.ranking.resampling import (
    RandomBits,
    draw,
    kept_weights,
    sampled,
    student_quantile,
    widening,
)
from ariac_score.ranking.spec import COUNT_BACK, Intervals, Key, Spec, places
from ariac_score.ranking.statistics import Pair, Statistics, rank_statistics
from ariac_score.results.result import Result
from ariac_score.scoring.expression import Expression

DIGITS = 3
LAST_DIGITS = 2.1e-3
"""Sums that were widened are rounded to the digits of a score."""
Scores = Mapping[str, Sequence[Sequence[float]]]
"""For each team and trial the scores of its runs."""


def spec(
    *,
    keep: int = 1,
    fill: bool = True,
    value: str = "execution",
    highest: bool = True,
    ties: tuple[Key, ...] = (),
    intervals: Intervals | None = None,
) -> Spec:
    return Spec(
        keep,
        fill=fill,
        value=Expression.parse(value),
        highest=highest,
        ties=ties,
        intervals=intervals or Intervals(),
    )


def ranking(scores: Scores, of: Spec, judges: Mapping[str, float] | None = None) -> Ranking:
    """The ranking of given scores, worked out here and not by the project's ranking."""
    trials = [f"t{j}" for j in range(len(next(iter(scores.values()))))]
    outcomes, standings, totals = [], [], []
    for team, runs in scores.items():
        cells = {}
        for trial, own in zip(trials, runs, strict=True):
            best = sorted((Decimal(f"{x:.3f}") for x in own), reverse=True)
            outcomes += [
                RunOutcome(team, trial, k, "scored", score=x, kept=k <= of.keep)
                for k, x in enumerate(best, start=1)
            ]
            kept = best[: of.keep]
            count = of.keep if of.fill else max(len(kept), 1)
            mean = (sum(kept, Decimal(0)) / count).quantize(Decimal(10) ** -(DIGITS if of.keep == 1 else 9))
            outcome = "scored" if kept else "no_run"
            cells[trial] = Cell(mean, outcome, "", tuple(range(1, len(kept) + 1)), len(own))
        marks = Decimal(str(judges[team])) if judges else None
        execution = sum((cell.score for cell in cells.values()), Decimal(0))
        totals.append({"execution": execution, "judges": marks})
        standings.append((team, cells, execution, marks))
    made = [
        TeamRank(None, team, team, value, execution, marks, {}, cells)
        for (team, cells, execution, marks), value in zip(standings, of.values(totals), strict=True)
    ]
    made.sort(key=lambda s: -(s.value or 0) if of.highest else (s.value or 0))
    ranks = [1 + sum(o.value != s.value for o in made[:i]) for i, s in enumerate(made)]
    assert ranks  # the order is all that the statistics take from it
    return Ranking("made", "", ("r", ""), tuple(trials), tuple(made), tuple(outcomes), None)


def statistics(scores: Scores, judges: Mapping[str, float] | None = None, **of: object) -> Statistics:
    declared = spec(**of)  # type: ignore[arg-type]
    return rank_statistics(ranking(scores, declared, judges), declared, DIGITS)


def pair(found: Statistics, first: str, second: str) -> Pair:
    return next(p for p in found.pairs if (p.first, p.second) == (first, second))


def chances(found: Statistics) -> dict[str, tuple[float, ...]]:
    return {odds.team: odds.chances for odds in found.teams}


@pytest.fixture
def few_describe(monkeypatch: pytest.MonkeyPatch) -> None:
    """Competitions are drawn from any number of trials, so that draws can be worked out by hand."""
    monkeypatch.setattr("ariac_score.ranking.statistics.DESCRIBED_FROM", 1)


# Random numbers ------------------------------------------------------------------------


def test_a_seed_gives_the_same_numbers_on_every_machine() -> None:
    # default_rng(1).random(2), as the documentation of numpy prints it: the upper 53 bits of each word.
    words = [int(word) for word in np.random.PCG64(1).random_raw(2)]
    assert [round((word >> 11) / 2**53, 8) for word in words] == [0.51182162, 0.9504637]
    low, high = words[0] & 0xFFFFFFFF, words[0] >> 32

    drawn = RandomBits(1).below(np.array([5, 7]))

    assert drawn.tolist() == [low * 5 >> 32, high * 7 >> 32]


def test_numbers_below_a_bound_are_all_as_likely() -> None:
    drawn = RandomBits(7).below(np.full(60_000, 6))

    counts = np.bincount(drawn, minlength=6)

    # Six standard deviations of a binomial with p = 1/6.
    assert counts.sum() == 60_000
    assert np.abs(counts - 10_000).max() < 6 * (60_000 * 5 / 36) ** 0.5


# Tables of the t-distribution, two-sided; any textbook.
@pytest.mark.parametrize(
    ("degrees", "level", "quantile"),
    [
        (1, 0.95, 12.706),
        (2, 0.95, 4.303),
        (3, 0.95, 3.182),
        (5, 0.95, 2.571),
        (10, 0.95, 2.228),
        (30, 0.95, 2.042),
        (1, 0.99, 63.657),
        (2, 0.99, 9.925),
        (4, 0.90, 2.132),
        (10_000, 0.95, 1.960),
    ],
)
def test_quantiles_of_student_are_those_of_the_tables(degrees: int, level: float, quantile: float) -> None:
    assert student_quantile(degrees, level) == pytest.approx(quantile, abs=6e-4)


def test_deviations_of_few_are_widened_and_those_of_many_hardly() -> None:
    assert widening(2, 1, 0.95) == pytest.approx(2**0.5 * 12.706 / 1.960, rel=1e-3)
    assert 1 < widening(1000, 999, 0.95) < 1.002


# By hand ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "keep"), [(1, 1), (2, 1), (3, 1), (3, 2), (4, 2), (3, 3), (2, 5)])
def test_how_often_a_run_is_kept_is_counted_over_all_ways_of_drawing(count: int, keep: int) -> None:
    times = [0] * count
    for ways in itertools.product(range(count), repeat=count):
        for kept in sorted(ways)[:keep]:
            times[kept] += 1

    assert kept_weights(count, keep) == (tuple(times), count**count)


@pytest.mark.usefixtures("few_describe")
def test_who_missed_a_trial_is_not_put_behind_who_was_better_only_by_widening() -> None:
    # A has 9 and no run, B 1 and 1: drawn (1,1) A is ahead by 16, mixed by 7, and (2,2) it is behind by 2.
    # Only a team without any run is put behind all the others, however far the draws are widened.
    found = statistics({"A": [[9], []], "B": [[1], [1]]}, intervals=Intervals(resample="trials"))

    assert chances(found)["A"][0] == pytest.approx(0.75, abs=0.02)
    assert chances(found)["B"][0] == pytest.approx(0.25, abs=0.02)  # they never share the first rank


@pytest.mark.usefixtures("few_describe")
def test_two_trials_drawn_by_hand() -> None:
    # A has 10 and 0, B 4 and 4. Drawn (1,1): 20 to 8; (1,2) and (2,1): 10 to 8; (2,2): 0 to 8.
    # Widening moves 12 and -8 away from 2 and leaves 2 as it is, so A is ahead in 3 of 4.
    found = statistics({"A": [[10], [0]], "B": [[4], [4]]}, intervals=Intervals(resample="trials"))

    assert chances(found)["A"][0] == pytest.approx(0.75, abs=0.02)
    ahead = pair(found, "A", "B")
    assert ahead.ahead == 2
    by = widening(2, 1, 0.95)
    assert ahead.low == pytest.approx(2 - 10 * by, abs=LAST_DIGITS)
    assert ahead.high == pytest.approx(2 + 10 * by, abs=LAST_DIGITS)
    assert ahead.told == ""


@pytest.mark.usefixtures("few_describe")
def test_two_runs_drawn_by_hand() -> None:
    # A ran 10 and 6, B 9 alone. The best of two drawn from (10, 6) is 10 in 3 of 4 ways and 6 in one: 9 on
    # average, 1 below what was published. Shifted, A is worth 11 or 7: widened 10 + w or 10 - 3 w, B 9.
    found = statistics({"A": [[10, 6]], "B": [[9]]}, intervals=Intervals(resample="runs"))

    assert chances(found)["A"][0] == pytest.approx(0.75, abs=0.02)
    by = widening(2, 1, 0.95)
    assert pair(found, "A", "B").high == pytest.approx(1 + by, abs=LAST_DIGITS)
    assert pair(found, "A", "B").low == pytest.approx(1 - 3 * by, abs=LAST_DIGITS)


@pytest.mark.usefixtures("few_describe")
def test_every_way_of_drawing_trials_and_runs_is_as_likely() -> None:
    """Chances against all ways there are, counted in fractions."""
    scores = {"A": [[8, 5], [1, 0]], "B": [[7, 2], [3, 1]], "C": [[6, 6], [2, 2]]}
    by = Fraction(str(widening(2, 1, 0.95)))
    first = dict.fromkeys(scores, Fraction(0))
    picks = [(one, other) for one in range(2) for other in range(2)]

    def worth(team: str, trial: int, ways: tuple[int, int]) -> Fraction:
        best, other = scores[team][trial]
        mean = Fraction(3 * best + other, 4)
        return Fraction(max(scores[team][trial][k] for k in ways)) + best - mean

    total = {team: sum(max(own) for own in runs) for team, runs in scores.items()}
    for trials in itertools.product(range(2), repeat=2):
        sums = {
            team: [worth(team, trials[0], a) + worth(team, trials[1], b) for a in picks for b in picks]
            for team in scores
        }
        for combination in itertools.product(*(range(16) for _ in scores)):
            wide = {
                team: total[team] + by * (sums[team][k] - total[team])
                for team, k in zip(scores, combination, strict=True)
            }
            top = max(wide.values())
            for team, value in wide.items():
                first[team] += Fraction(value == top, 4 * 16**3)

    found = chances(statistics(scores))

    # Five standard errors of 10 000 draws.
    for team, chance in first.items():
        assert found[team][0] == pytest.approx(float(chance), abs=5 * (0.25 / 10_000) ** 0.5)


def test_a_team_that_is_always_far_ahead_is_clearly_ahead() -> None:
    scores = {
        "A": [[100 + j, 101 + j] for j in range(10)],
        "B": [[50 + j % 3, 51 + j % 2] for j in range(10)],
        "C": [[50 + j % 2, 52 - j % 3] for j in range(10)],
    }
    found = statistics(scores)

    odds = {o.team: (o.rank_low, o.rank_high) for o in found.teams}
    assert odds["A"] == (1, 1)
    assert odds["B"] == odds["C"] == (2, 3)
    assert [set(group.teams) for group in found.groups] == [{"A"}, {"B", "C"}]
    # Ten wins of ten, and of six claims the first must pass 5 % / 6: 1/1024 does.
    assert (pair(found, "A", "B").p, pair(found, "A", "B").told) == (1 / 1024, "A")


def test_ranks_that_mix_in_marks_are_told_apart_by_points_alone_and_that_is_said() -> None:
    # The ranks of 2025: 0.8 of the execution, 0.2 of the judges. A is always first, so ranks never change.
    scores = {team: [[base + 0.1 * j] for j in range(8)] for team, base in (("A", 30), ("B", 20), ("C", 10))}
    mixed = "0.8 * rank(execution) + 0.2 * rank(judges)"
    found = statistics(scores, {"A": 1, "B": 3, "C": 2}, value=mixed, highest=False, keep=2, fill=False)

    # A 0.8 + 0.6 = 1.4; B 1.6 + 0.2 = 1.8; C 2.4 + 0.4 = 2.8
    assert pair(found, "A", "B").ahead == pytest.approx(0.4)
    assert pair(found, "B", "C").ahead == pytest.approx(1.0)
    assert {p.told for p in found.pairs} == {"A", "B"}
    assert any("about the points alone" in note for note in found.notes)


# Little to go by -------------------------------------------------------------------------


def test_one_trial_and_one_run_say_nothing() -> None:
    found = statistics({"A": [[3]], "B": [[2]]})

    assert [(odds.rank_low, odds.rank_high, odds.chances) for odds in found.teams] == [(1, 2, ())] * 2
    assert "no number of points could tell 2 teams apart" in found.notes[0]
    assert "nothing tells how another day would have gone" in found.notes[1]


def test_nothing_is_told_where_nobody_has_a_run() -> None:
    found = statistics({"A": [[], []], "B": [[], []]})

    assert found.teams == ()
    assert "nothing to tell" in found.notes[0]


def test_one_team_is_first_for_sure() -> None:
    found = statistics({"A": [[3, 1], [2, 2]]})

    (odds,) = found.teams
    assert (odds.rank_low, odds.rank_high) == (1, 1)
    assert found.pairs == ()
    assert [group.teams for group in found.groups] == [("A",)]


def test_teams_that_are_all_alike_share_every_rank_and_one_group() -> None:
    found = statistics({team: [[5, 5]] * 20 for team in "ABC"})

    assert [(o.rank_low, o.rank_high) for o in found.teams] == [(1, 3)] * 3
    assert [group.teams for group in found.groups] == [("A", "B", "C")]
    # No draw differs from another, so intervals would have the width 0: what nobody knows is not certain.
    assert {(p.p, p.low, p.chance) for p in found.pairs} == {(1.0, None, None)}
    assert any("no draw differs from another" in note for note in found.notes)


# The fewest trials: 2^-n times the claims of both directions at most 5 %; worked in methods of exact tests.
@pytest.mark.parametrize(("teams", "fewest"), [("AB", 6), ("ABC", 7), ("ABCD", 8)])
def test_below_the_fewest_trials_nobody_is_told_apart_however_far_ahead(teams: str, fewest: int) -> None:
    def found(trials: int) -> Statistics:
        return statistics({team: [[1000 * -rank]] * trials for rank, team in enumerate(teams)})

    assert not any(p.told for p in found(fewest - 1).pairs)
    assert f"that takes {fewest}" in found(fewest - 1).notes[0]
    assert [p.told for p in found(fewest).pairs if p.first == "A"][:1] == ["A"]
    assert not any("no number of points" in note for note in found(fewest).notes)


def test_intervals_and_chances_take_fifteen_trials() -> None:
    def found(trials: int) -> Statistics:
        return statistics({"A": [[k % 4] for k in range(trials)], "B": [[k % 3] for k in range(trials)]})

    assert (pair(found(14), "A", "B").chance, found(14).teams[0].execution) == (None, None)
    assert any("need 15 trials" in note for note in found(14).notes)
    assert pair(found(15), "A", "B").chance is not None


# Like with like ----------------------------------------------------------------------------


def test_who_ran_more_often_is_compared_by_as_many_first_runs() -> None:
    # B is published ahead in every trial by the best of five; the first run of each says the opposite.
    scores = {"A": [[8.0]] * 6, "B": [[5.0, 9.0, 6.0, 7.0, 4.0]] * 6}
    declared = spec()
    made = ranking(scores, declared)
    in_order = {5.0: 1, 9.0: 2, 6.0: 3, 7.0: 4, 4.0: 5, 8.0: 1}  # the helper numbers runs by their scores
    runs = tuple(replace(run, number=in_order[float(run.score or 0)]) for run in made.runs)
    standings = tuple(replace(s, rank=place) for place, s in enumerate(made.standings, start=1))

    found = rank_statistics(replace(made, runs=runs, standings=standings), declared, DIGITS)

    (both,) = found.pairs
    assert (both.first, both.ahead, both.told) == ("B", 6.0, "A")
    assert any("like with like another order is told" in note for note in found.notes)


def test_runs_dealt_anew_tell_apart_on_exactly_these_trials_where_swapped_results_cannot() -> None:
    # Three trials, three runs of each, A always ahead. Swapped results: 1/8. Runs dealt anew: 1 of 20 ways in
    # each trial, so 1/8000.
    found = statistics({"A": [[9, 8, 7]] * 3, "B": [[5, 6, 4]] * 3}, keep=3)

    (both,) = found.pairs
    assert (both.p, both.told) == (1 / 8, "")
    assert (both.p_here, both.told_here) == (1 / 8000, "A")
    assert [(o.rank_low, o.rank_high, o.here_low, o.here_high) for o in found.teams] == [
        (1, 2, 1, 1),
        (1, 2, 2, 2),
    ]


def test_a_log_that_was_lost_says_nothing_about_anybody() -> None:
    scores = {"A": [[9.0]] * 7, "B": [[5.0]] * 7}
    declared = spec()
    made = ranking(scores, declared)
    lost = tuple(
        replace(run, outcome="unreadable", score=None)
        if run.team == "B" and run.trial in ("t0", "t1")
        else run
        for run in made.runs
    )

    assert pair(rank_statistics(made, declared, DIGITS), "A", "B").p == 1 / 2**7
    assert pair(rank_statistics(replace(made, runs=lost), declared, DIGITS), "A", "B").p == 1 / 2**5


@pytest.mark.parametrize(("most_of_b", "told"), [("8.9", "A"), ("9.1", "")])
def test_what_is_open_about_a_score_counts_against_the_claim(most_of_b: str, told: str) -> None:
    declared = spec()
    made = ranking({"A": [[9.0]] * 6, "B": [[5.0]] * 6}, declared)
    open_ = Ends(Decimal(5), Decimal(most_of_b))

    def with_first(**changed: Any) -> Ranking:
        first = (("B", "t0"),)
        runs = (replace(run, **changed) if (run.team, run.trial) in first else run for run in made.runs)
        return replace(made, runs=tuple(runs))

    # At 9.1 the first trial may have been lost: of six wins five are left, which is 2/64.
    opened = with_first(open=open_)
    assert pair(rank_statistics(opened, declared, DIGITS), "A", "B").told == told
    # A score that is withheld has the same ends: leaving it out would choose which runs are compared.
    withheld = with_first(open=open_, outcome="undecided", score=None)
    assert pair(rank_statistics(withheld, declared, DIGITS), "A", "B").told == told
    # And stewards who decided it leave nothing open, whatever its automatic result says.
    automatic = cast(Result, SimpleNamespace(interval=SimpleNamespace(least=Decimal(0), most=Decimal(99))))
    assert pair(rank_statistics(with_first(result=automatic), declared, DIGITS), "A", "B").told == "A"


def test_a_team_without_any_run_is_told_from_one_that_ran_but_not_by_runs_dealt_anew() -> None:
    # What was not run counts 0 in the ranking, as a crash does; about its runs nothing is known.
    found = statistics({"A": [[5, 9]] * 6, "none": [[]] * 6})

    (both,) = found.pairs
    assert (both.told, both.p) == ("A", 1 / 64)
    assert (both.told_here, both.p_here) == ("", 1)


# Laws --------------------------------------------------------------------------------------

competitions = st.integers(2, 4).flatmap(
    lambda trials: st.lists(
        st.lists(st.lists(st.integers(-50, 50), min_size=0, max_size=3), min_size=trials, max_size=trials),
        min_size=1,
        max_size=4,
    )
)


@settings(max_examples=40, deadline=None)
@given(scores=competitions, keep=st.integers(1, 3), fill=st.booleans())
def test_what_holds_for_every_competition(scores: list[list[list[int]]], keep: int, fill: bool) -> None:
    teams = {f"team{i}": own for i, own in enumerate(scores)}
    declared = spec(keep=keep, fill=fill, intervals=Intervals(draws=200))
    made = ranking(teams, declared)
    found = rank_statistics(made, declared, DIGITS)

    assert found == rank_statistics(made, declared, DIGITS)  # a seed is a seed
    if not found.teams:
        assert found.notes
        return
    assert [odds.team for odds in found.teams] == [s.team for s in made.standings]
    for odds in found.teams:
        assert 1 <= odds.rank_low <= odds.rank_high <= len(teams)
    together = {team for group in found.groups for team in group.teams}
    assert together == set(teams)
    clear = {frozenset((p.first, p.second)) for p in found.pairs if p.distinguished}
    for group in found.groups:
        assert not any(frozenset(two) in clear for two in itertools.combinations(group.teams, 2))
    for p in found.pairs:
        assert p.p + p.p_back >= 1  # both count the difference there was
        assert (p.told == p.first) <= (p.p < 0.05)


@pytest.mark.usefixtures("few_describe")
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(easier=st.lists(st.integers(-20, 20), min_size=3, max_size=3), seed=st.integers(0, 99))
def test_an_easier_trial_for_all_changes_no_difference(easier: list[int], seed: int) -> None:
    """Teams are paired: the same trials are drawn for all of them."""
    chance = np.random.default_rng(seed)
    scores = {team: [[int(x) for x in chance.integers(0, 40, 3)] for _ in range(3)] for team in "ABC"}
    moved = {
        t: [[x + d for x in own] for own, d in zip(runs, easier, strict=True)] for t, runs in scores.items()
    }
    few = Intervals(draws=300)

    before, after = statistics(scores, intervals=few), statistics(moved, intervals=few)

    for one, other in zip(before.pairs, after.pairs, strict=True):
        assert other.ahead == pytest.approx(one.ahead, abs=1e-9)
        assert (other.p, other.p_here) == (one.p, one.p_here)
        assert other.low == pytest.approx(one.low, abs=LAST_DIGITS)
        assert other.high == pytest.approx(one.high, abs=LAST_DIGITS)
    assert chances(before) == chances(after)


def test_the_first_key_on_which_two_differ_decides() -> None:
    value = np.array([[5.0], [5.0], [4.0], [5.0]])
    second = np.array([[1.0], [2.0], [9.0], [1.0]])

    assert places([value, second]).ravel().tolist() == [2, 1, 4, 2]


@pytest.mark.usefixtures("few_describe")
def test_count_back_separates_equal_sums_in_every_draw() -> None:
    # Equal in every trial but one, where A is drawn ahead by nothing but the places it won.
    scores = {"A": [[3], [3], [1], [1]], "B": [[2], [2], [2], [2]]}
    plain_chances = chances(statistics(scores))
    counted = chances(statistics(scores, ties=(Key(COUNT_BACK, highest=True),)))

    # Half the draws in which both sums are equal have two wins each: those stay shared.
    assert counted["A"][0] <= plain_chances["A"][0]
    assert counted["B"][0] <= plain_chances["B"][0]


@pytest.mark.usefixtures("few_describe")
@pytest.mark.parametrize(("highest", "first"), [(True, "A"), (False, "B")])
def test_the_marks_of_judges_separate_equal_teams_in_every_draw(highest: bool, first: str) -> None:
    # Drawn (1,1) and (2,2) one is ahead by 2; the mixed draws are equal, and the marks decide.
    scores = {"A": [[4], [2]], "B": [[3], [3]]}
    found = statistics(
        scores,
        {"A": 4.0, "B": 2.0},
        ties=(Key("judges", highest=highest),),
        intervals=Intervals(resample="trials"),
    )

    assert chances(found)[first][0] == pytest.approx(3 / 4, abs=0.02)


# How often claims are wrong ------------------------------------------------------------------


def wrong_claims(seed: int, rounds: int, trials: int, runs: int, spread: tuple[float, float]) -> float:
    """In what part of competitions equal teams are told apart, or the wrong way round, on trials like these.

    Four teams, two and two of equal ability. `spread`: between trials of a team, between its runs.
    """
    chance = np.random.default_rng(seed)
    ability = np.array([0.0, 0.0, 4.0, 4.0])
    wrong = 0
    for _ in range(rounds):
        hard = chance.normal(0, 5, trials)
        own = 100 + ability[:, None] + hard + chance.normal(0, spread[0], (4, trials))
        scores = own[:, :, None] + chance.normal(0, spread[1], (4, trials, runs))
        found = statistics({f"team{i}": s.tolist() for i, s in enumerate(scores)})
        truth = {f"team{i}": a for i, a in enumerate(ability)}
        wrong += any(
            p.told and truth[p.told] <= truth[p.second if p.told == p.first else p.first] for p in found.pairs
        )
    return wrong / rounds


@pytest.mark.parametrize(("trials", "runs"), [(1, 1), (2, 1), (3, 1), (9, 1)])
def test_equal_teams_are_rarely_told_apart(trials: int, runs: int) -> None:
    # At most 5 %; of 100 competitions 5 % is at most 11 but once in 200 times.
    assert wrong_claims(11, 100, trials, runs, (3.0, 1.0)) <= 0.11


# Which draw an interval ends at -----------------------------------------------------------

LOPSIDED = {"A": [[3.0**k] for k in range(8)], "B": [[0.0]] * 8}
"""Nearly every draw of A is another sum, and most lie on one side of what was published."""


def drawn_totals(declared: Spec) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """What A is worth in each draw, deviations widened."""
    runs = sampled(ranking(LOPSIDED, declared), declared, DIGITS)
    assert runs.teams[0] == "A"
    published = sum(3.0**k for k in range(8))
    totals = runs.amount(draw(runs, declared, "trials").execution[0])
    return np.asarray(published + widening(8, 7, declared.intervals.level) * (totals - published))


# Levels whose halves are binary fractions, so that no draw is a matter of rounding.
@pytest.mark.usefixtures("few_describe")
@pytest.mark.parametrize(("draws", "level"), [(100, 0.5), (64, 0.75), (101, 0.5), (40, 0.75)])
def test_intervals_end_at_the_draw_that_is_the_quantile_and_not_at_its_neighbour(
    draws: int, level: float
) -> None:
    intervals = Intervals(resample="trials", draws=draws, level=level)
    totals = drawn_totals(spec(intervals=intervals))
    ends = np.quantile(totals, [(1 - level) / 2, (1 + level) / 2], method="inverted_cdf")
    around = np.sort(totals)[np.searchsorted(np.sort(totals), ends)[:, None] + [-1, 0, 1]]
    assert (np.diff(around) > 2 * LAST_DIGITS).all()  # the neighbours differ, or nothing would be tried

    found = statistics(LOPSIDED, intervals=intervals)

    ahead = pair(found, "A", "B")
    assert ahead.low == pytest.approx(ends[0], abs=LAST_DIGITS)
    assert ahead.high == pytest.approx(ends[1], abs=LAST_DIGITS)
    assert found.teams[0].execution == pytest.approx(tuple(ends), abs=LAST_DIGITS)


# What separates equal teams, drawn with them -------------------------------------------------

SECONDS = {"A": ((10.0, 30.0), (100.0, 300.0)), "B": ((50.0, 50.0), (70.0, 70.0))}
"""How long the runs of each trial took; every run earns the same."""


def chance_of_the_quicker(resample: str, *, runs_of_b: int = 2, highest: bool = False) -> float:
    """In which part of the draws A comes before B, whom nothing but the time separates."""
    declared = spec(ties=(Key("duration_s", highest=highest),), intervals=Intervals(resample=resample))
    scores = {team: [[5.0] * (runs_of_b if team == "B" else 2)] * 2 for team in SECONDS}
    made = ranking(scores, declared)
    timed = tuple(
        replace(run, terms={"duration_s": SECONDS[run.team][int(run.trial[1:])][run.number - 1]})
        for run in made.runs
    )
    return chances(rank_statistics(replace(made, runs=timed), declared, DIGITS))["A"][0]


@pytest.mark.usefixtures("few_describe")
@pytest.mark.parametrize("runs_of_b", [1, 2])
def test_a_term_that_separates_equal_teams_is_that_of_the_runs_drawn(runs_of_b: int) -> None:
    # The better of two runs drawn is the first in 3 of 4 ways: A takes 10 + 100 s in 9 of 16, else 130 s or
    # more, and B always 120 s.
    assert chance_of_the_quicker("runs", runs_of_b=runs_of_b) == pytest.approx(9 / 16, abs=0.02)


@pytest.mark.usefixtures("few_describe")
def test_a_term_that_separates_equal_teams_is_that_of_the_trials_drawn() -> None:
    # Drawn (1,1): 20 s to 100 s; (1,2) and (2,1): 110 s to 120 s; (2,2): 200 s to 140 s.
    assert chance_of_the_quicker("trials") == pytest.approx(3 / 4, abs=0.02)
    assert chance_of_the_quicker("trials", highest=True) == pytest.approx(1 / 4, abs=0.02)
