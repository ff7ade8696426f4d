"""What choosing the best of several runs does: against every way of choosing, and in the worked cases."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.ranking.exact import expected_kept
from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import Cell, Ranking, RunOutcome, TeamRank
from ariac_score.ranking.selection import Selection, selections
from ariac_score.ranking.spec import Intervals, Key, Spec
from ariac_score.ranking.statistics import Statistics
from ariac_score.ranking.totals import Total
from ariac_score.report.ranking import ranking_csv, ranking_text
from ariac_score.results.result import Pinned

Run = int | tuple[int, int] | None
"""A score, the ends of an open one, or nothing of a log that was lost."""


def made(scores: Mapping[str, Sequence[Sequence[Run]]], keep: int = 1) -> Ranking:
    """The ranking of given runs; of an open score the low end counts."""
    trials = [f"t{n}" for n in range(len(next(iter(scores.values()))))]
    runs: list[RunOutcome] = []
    standings = []
    for team, of_team in scores.items():
        cells = {}
        for trial, own in zip(trials, of_team, strict=True):
            known = []
            for number, run in enumerate(own, 1):
                if run is None:
                    runs.append(RunOutcome(team, trial, number, "unreadable"))
                    continue
                least, most = run if isinstance(run, tuple) else (run, run)
                ends = None if least == most else Ends(Decimal(least), Decimal(most))
                runs.append(RunOutcome(team, trial, number, "scored", score=Decimal(least), open=ends))
                known.append(Decimal(least))
            best = sorted(known, reverse=True)[:keep]
            cells[trial] = Cell(sum(best, Decimal(0)) / max(len(best), 1), "scored", "", (), len(own))
        total = sum((cell.score for cell in cells.values()), Decimal(0))
        standings.append(TeamRank(None, team, team, float(total), total, None, {}, cells))
    standings.sort(key=lambda standing: -standing.execution)
    return Ranking("made", "", Pinned("r", ""), tuple(trials), tuple(standings), tuple(runs), None)


def found(scores: Mapping[str, Sequence[Sequence[Run]]], **of: object) -> dict[str, Selection]:
    spec = Spec(**of)  # type: ignore[arg-type]
    return {own.team: own for own in selections(made(scores, spec.keep), spec, 3)}


def ends(least: str, most: str = "") -> Ends:
    return Ends(Decimal(least), Decimal(most or least))


def test_the_best_of_five_is_shown_beside_the_best_of_one_of_each() -> None:
    # Worked cases R9 and R10: 9 7 6 5 4 against a single 8. Of one run the five bring 6.2 in the mean.
    teams = found({"five": [[5, 9, 4, 7, 6]], "one": [[8]]})

    five, one = teams["five"], teams["one"]
    assert (five.published, five.alike, five.single) == (9, ends("6.2"), ends("6.2"))
    assert (one.published, one.alike, one.single) == (8, ends("8"), ends("8"))
    assert [(t.alike_rank, t.single_rank) for t in (five, one)] == [(2, 2), (1, 1)]


def test_like_with_like_is_as_many_runs_as_the_fewest_in_that_trial() -> None:
    # R10: the best of two of 9 7 6 5 4 is 7.4 in the mean; in the second trial both made five.
    five = [9, 7, 6, 5, 4]
    teams = found({"a": [five, five], "b": [[8, 8], five]})

    assert teams["a"].alike == ends("16.4")
    assert teams["a"].single == ends("12.4")


def test_equal_means_and_unequal_spreads_differ_by_the_choice_alone() -> None:
    teams = found({"wild": [[0, 10]], "calm": [[5, 5]]})

    assert (teams["wild"].published, teams["calm"].published) == (10, 5)
    assert teams["wild"].single == teams["calm"].single == ends("5")
    assert teams["wild"].single_rank == teams["calm"].single_rank == 1


def test_open_scores_are_carried() -> None:
    assert found({"a": [[(2, 6), 4]], "b": [[1, 1]]})["a"].single == ends("3", "5")
    # Of two runs both ends choose their own best: at least 4, at most 6.
    assert found({"a": [[(2, 6), 4]], "b": [[1, 1]]})["a"].alike == ends("4", "6")


def test_a_log_that_was_lost_is_no_run_and_a_trial_without_any_stays_as_published() -> None:
    teams = found({"a": [[3, None, 5], [None]], "b": [[1, 1, 1], [2]]})

    assert teams["a"].single == ends("4")
    assert teams["b"].single == ends("3")


@given(
    st.lists(st.integers(-9, 9), min_size=1, max_size=6),
    st.integers(1, 6),
    st.integers(1, 3),
)
def test_every_way_of_choosing_is_counted(scores: list[int], runs: int, keep: int) -> None:
    runs = min(runs, len(scores))
    ways = [sorted(way)[::-1][:keep] for way in itertools.combinations(scores, runs)]

    mean = sum(Fraction(sum(way), len(way)) for way in ways) / len(ways)

    assert expected_kept(sorted(scores)[::-1], runs, keep) == mean


def test_where_runs_are_chosen_by_another_key_that_order_counts() -> None:
    spec = Spec(by=(Key("task", highest=True),))
    ranking = made({"a": [[1, 9]], "b": [[2, 2]]})
    tasks = {1: 5, 2: 3}  # the run of score 1 is the one that counts
    runs = tuple(
        RunOutcome(r.team, r.trial, r.number, r.outcome, score=r.score, task=Decimal(tasks[r.number]))
        for r in ranking.runs
    )
    (a, _) = selections(
        Ranking("m", "", Pinned("r", ""), ranking.trials, ranking.standings, runs, None),
        spec,
        3,
    )

    assert a.alike == ends("1")


@pytest.mark.parametrize("keep", [2, 3])
def test_where_all_runs_count_nothing_is_said(keep: int) -> None:
    assert found({"a": [[1, 9]], "b": [[2, 2]]}, keep=keep) == {}


def test_a_total_that_may_fall_with_a_score_has_no_ends_so_nothing_is_said() -> None:
    assert found({"a": [[1, 9]], "b": [[2, 2]]}, total=Total("spread")) == {}


def test_text_and_csv_have_them_side_by_side() -> None:
    ranking = made({"five": [[5, 9, 4, 7, 6]], "one": [[8]]})
    sure = Statistics(Intervals(), selection=selections(ranking, Spec(), 3))

    text = ranking_text(ranking, statistics=sure)
    assert "  five          9               6.2 (rank 2)  6.2 (rank 2)\n" in text
    assert "choosing rewards luck" in text
    assert (
        ranking_csv(ranking, sure)
        .splitlines()[0]
        .endswith("alike least,alike most,single run least,single run most")
    )
    assert "alike least" not in ranking_csv(ranking, Statistics(Intervals()))
