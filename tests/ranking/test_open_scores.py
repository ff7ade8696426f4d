"""Open scores in a ranking: ends of trials, teams and ranks, in text, CSV and the published document."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from ariac_score import load_result, load_rule_set
from ariac_score.cli import main
from ariac_score.ranking.competition import load_competition
from ariac_score.ranking.open_scores import Ends, Slots, cell_ends, rank_ends, worst_ends
from ariac_score.ranking.outcomes import Ranking, TeamRank
from ariac_score.ranking.publication import PUBLICATION, ranking_json
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.spec import ranking_spec
from ariac_score.report.ranking import ranking_csv, ranking_text
from ariac_score.scoring.interval import ScoreInterval
from ariac_score.scoring.ledger import Line

EXAMPLE = (
    Path(__file__).parents[2] / "tests/data/as_published/kitting_near_miss.result.json"
)  # 19.761677 points


def ends(least: str, most: str = "") -> Ends:
    return Ends(Decimal(least), Decimal(most or least))


def test_the_ends_of_ranks_are_those_of_every_choice_of_scores() -> None:
    """Against trying: each team takes either end, and the best and the worst rank of all worlds are noted."""
    values = {"a": ends("10", "12"), "b": ends("8", "11"), "c": ends("7"), "d": ends("1", "7.5")}
    seen: dict[str, set[int]] = {team: set() for team in values}
    for world in product(*((own.least, own.most) for own in values.values())):
        for team, own in zip(values, world, strict=True):
            seen[team].add(1 + sum(other > own for other in world))
    published = {"a": 1, "b": 2, "c": 3, "d": 4}

    assert rank_ends(values, published) == {team: (min(ranks), max(ranks)) for team, ranks in seen.items()}


def test_teams_whose_ends_only_touch_keep_the_ranks_that_other_things_give_them() -> None:
    values = {"a": ends("5"), "b": ends("5"), "c": ends("5", "9")}

    assert rank_ends(values, {"a": 1, "b": 2, "c": 3}) == {"a": (1, 2), "b": (1, 2), "c": (1, 3)}


def test_the_ends_of_a_trial_are_those_of_its_best_runs(subtests: pytest.Subtests) -> None:
    runs = [ends("4", "10"), ends("6"), ends("1", "5")]
    for name, slots, zeros, expected in (
        ("best one", Slots(1, False, 6, True, True), 0, ("6", "10")),
        ("mean of two", Slots(2, False, 6, True, True), 0, ("5", "8")),
        ("fills up", Slots(4, True, 6, True, True), 0, ("2.25", "4.75")),  # (11 - 2) / 4, (21 - 2) / 4
        ("a crash counts the worst", Slots(4, False, 6, True, True), 1, ("2.25", "4.75")),
        ("fewest points win", Slots(1, False, 6, False, True), 0, ("1", "5")),
        ("any may count", Slots(1, False, 6, True, False), 0, ("1", "10")),
    ):
        with subtests.test(name):
            assert cell_ends(runs, zeros, ends("-2"), slots) == Ends(*map(Decimal, expected))


def test_what_counts_without_a_score_is_open_where_the_worst_score_is() -> None:
    assert worst_ends(Decimal("-3"), [ends("-3", "4"), ends("2")], more_is_better=True) == ends("-3", "0")
    assert worst_ends(Decimal(0), [ends("1", "4")], more_is_better=True) == ends("0")


def ranked(folder: Path, runs: Mapping[str, tuple[str, str, str]], extra: str = "") -> Ranking:
    """A competition of one trial by example results whose scores lie between ends; `-` has no score."""
    for team in runs:
        (folder / "logs" / team / "cell_1").mkdir(parents=True)
        (folder / "logs" / team / "cell_1" / "log.jsonl").write_text("{}\n", encoding="utf-8")
    (folder / "competition.yaml").write_text(
        f"id: gaps\nrules: paper2020.published\nruns: logs/{{team}}/{{trial}}_{{run}}\n{extra}",
        encoding="utf-8",
    )
    competition = load_competition(folder)
    rules = load_rule_set("paper2020.published")
    spec = ranking_spec(rules, competition.ranking, file="competition.yaml")
    results = {}
    for team, (score, least, most) in runs.items():
        example = load_result(EXAMPLE)
        assert example.ledger is not None
        changed: dict[str, Any] = {"score": None, "ledger": None, "status": "incomplete", "missing": "a gap"}
        if score != "-":
            line = replace_amount(example.ledger, Decimal(score))
            changed = {"score": Decimal(score), "ledger": line}
        interval = ScoreInterval(Decimal(least), Decimal(most), True, "withhold" if score == "-" else "worst")
        results[team, "cell", 1] = replace(example, **changed, interval=None if least == most else interval)
    return rank_results(competition, spec, rules, results)


def replace_amount(ledger: Line, score: Decimal) -> Line:
    return structs.replace(ledger, amount=score, value=float(score), children=())


def of(ranking: Ranking) -> dict[str, tuple[int | None, TeamRank]]:
    return {standing.team: (standing.rank, standing) for standing in ranking.standings}


def test_a_ranking_has_the_ends_of_scores_and_ranks(tmp_path: Path) -> None:
    ranking = ranked(
        tmp_path, {"a": ("10", "10", "10"), "b": ("8", "8", "12"), "c": ("7", "7", "9"), "d": ("5", "5", "5")}
    )

    found = {s.team: (s.rank, s.open) for s in ranking.standings}
    assert {
        team: (rank, own.execution, own.best_rank, own.worst_rank, own.runs)
        for team, (rank, own) in found.items()
        if own is not None
    } == {
        "a": (1, ends("10"), 1, 2, 0),
        "b": (2, ends("8", "12"), 1, 3, 1),
        "c": (3, ends("7", "9"), 2, 3, 1),
        "d": (4, ends("5"), 4, 4, 0),
    }
    text = ranking_text(ranking)
    assert "  b: score 8 to 12, rank 1 to 3 (1 open run)\n" in text
    assert "  d: score 5, rank 4\n" in text
    rows = list(csv.DictReader(io.StringIO(ranking_csv(ranking))))
    assert [(r["team"], r["execution least"], r["execution most"]) for r in rows[:2]] == [
        ("a", "10.000000", "10.000000"),
        ("b", "8.000000", "12.000000"),
    ]
    assert (rows[1]["open rank low"], rows[1]["open rank high"]) == ("1", "3")


def test_a_published_ranking_keeps_what_is_open_and_one_without_has_the_bytes_it_had(tmp_path: Path) -> None:
    spec = ranking_spec(load_rule_set("paper2020.published"), {}, file="competition.yaml")
    ranking = ranked(tmp_path / "one", {"a": ("10", "10", "10"), "b": ("8", "8", "12")})
    text = ranking_json(ranking, spec)
    (tmp_path / "ranking.json").write_text(text, encoding="utf-8")
    again = PUBLICATION.read(tmp_path / "ranking.json").ranking

    assert [s.open for s in again.standings] == [s.open for s in ranking.standings]
    assert [run.open for run in again.runs] == [None, ends("8", "12")]
    closed = ranked(tmp_path / "two", {"a": ("10", "10", "10"), "b": ("8", "8", "8")})
    assert '"open"' not in ranking_json(closed, spec)
    assert "What logs leave open" not in ranking_text(closed)


def test_a_withheld_score_counts_nothing_and_may_be_all_that_its_log_allows(tmp_path: Path) -> None:
    ranking = ranked(tmp_path, {"a": ("10", "10", "10"), "b": ("-", "8", "12")})
    (_, b) = of(ranking)["b"]

    assert b.execution == 0
    assert b.open is not None
    assert (b.open.execution, b.open.best_rank, b.open.worst_rank) == (ends("0", "12"), 1, 2)


def test_the_leaderboard_draws_what_is_open_apart_from_confidence(tmp_path: Path) -> None:
    spec = ranking_spec(load_rule_set("paper2020.published"), {}, file="competition.yaml")
    ranking = ranked(tmp_path / "c", {"a": ("10", "10", "10"), "b": ("8", "8", "12")})
    (tmp_path / "ranking.json").write_text(ranking_json(ranking, spec), encoding="utf-8")

    assert main(["report", str(tmp_path / "ranking.json"), "-o", str(tmp_path / "site")]) == 6
    page = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    # On a scale from 0 to 12 the bar of b lies from 8 to 12, its dot at 8; a has a dot alone.
    assert 'aria-label="open from 8.00 to 12.00"' in page
    assert '<i style="left:66.67%;width:33.33%"></i><b style="left:66.67%"></b>' in page
    assert 'aria-label="nothing open"' in page
    assert page.count('<td class="n">1\u20132</td>') == 2
    rows = list(csv.DictReader((tmp_path / "site/data/leaderboard.csv").read_text("utf-8").splitlines()))
    assert [(r["open_least"], r["open_most"], r["open_rank_best"], r["open_rank_worst"]) for r in rows] == [
        ("10.000000", "10.000000", "1", "2"),
        ("8.000000", "12.000000", "1", "2"),
    ]
