"""A competition under other numbers: every point is what its rules give, and nothing lies between."""

from __future__ import annotations

import runpy
import shutil
from collections.abc import Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ariac_score import Result, RuleSet, load_rule_set
from ariac_score.errors import RuleSetError, ScoreError
from ariac_score.ranking.competition import Competition, RunKey, load_competition, registry_for
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import ranking_spec
from ariac_score.results.result_file import as_json
from ariac_score.review.what_if import WhatIf, explore, flips_of

EXAMPLE = Path(__file__).parents[2] / "examples/competition/motion"
MADE = SimpleNamespace(**runpy.run_path(str(EXAMPLE / "make.py")))

Results = Mapping[RunKey, Result | ScoreError]


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The made cell with two teams and one run of each trial."""
    folder = tmp_path_factory.mktemp("cell")
    MADE.make(folder, teams=("fox", "owl"), runs=(2,))
    shutil.copy(EXAMPLE / "rules.yaml", folder)
    head, _, _ = (EXAMPLE / "competition.yaml").read_text(encoding="utf-8").partition("teams:")
    (folder / "competition.yaml").write_text(f"{head}ranking: {{keep: 1}}\n", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def held(cell: Path) -> tuple[Competition, RuleSet, Results]:
    competition = load_competition(cell)
    rules = load_rule_set(competition.rules)
    return competition, rules, score_runs(competition, rules)


def explored(held: tuple[Competition, RuleSet, Results], grid: Mapping[str, Sequence[float]]) -> WhatIf:
    competition, rules, results = held
    return explore(competition, rules, results, grid, registry=registry_for(competition))


def ranked(held: tuple[Competition, RuleSet, Results], **numbers: float) -> dict[str, tuple[Any, Decimal]]:
    """Rank and score of each team when every run is measured and priced by the changed rules from its log."""
    competition, rules, _ = held
    changed = rules.with_parameters(numbers)
    spec = ranking_spec(changed, competition.ranking, file="test")
    found = rank_results(competition, spec, changed, score_runs(competition, changed))
    return {standing.team: (standing.rank, standing.execution) for standing in found.standings}


@pytest.mark.slow
def test_the_recordings_are_the_same_each_time_they_are_made(cell: Path, tmp_path: Path) -> None:
    MADE.make(tmp_path, teams=("owl",), runs=(2,))

    for file in sorted((tmp_path / "logs").rglob("*.mcap")):
        assert file.read_bytes() == (cell / file.relative_to(tmp_path)).read_bytes()


@pytest.mark.slow
def test_every_point_is_what_scoring_by_its_rules_gives(held: Any) -> None:
    found = explored(held, {"approach": [0, 8], "reaction": [0.3]})

    assert [lever.steps for lever in found.levers] == [(0.0, 4.0, 8.0), (0.1, 0.3)]
    assert len(found.points) == 6
    point = found.points[(2, 1)]
    assert point is not None
    places = {team: (place.rank, place.score) for team, place in point.items()}
    assert places == ranked(held, approach=8, reaction=0.3)


def test_ranks_flip_where_safety_gets_dear(held: Any) -> None:
    found = explored(held, {"approach": [0, 40]})

    # The fox brings more, and comes near more often: it leads while that costs nothing.
    cheap, _, dear = (found.points[(step,)] for step in range(3))
    assert cheap is not None
    assert dear is not None
    assert (cheap["fox"].rank, dear["fox"].rank) == (1, 2)
    moved = [flip.moved for flip in flips_of(found)]
    assert {"fox": (1, 2), "owl": (2, 1)} in moved


def test_what_the_task_brought_does_not_hang_on_the_price_of_safety(held: Any) -> None:
    found = explored(held, {"approach": [0, 8]})

    tasks = [{team: place.task for team, place in (point or {}).items()} for point in found.points.values()]
    assert tasks[0] == tasks[1] == tasks[2]
    assert None not in tasks[0].values()


def test_without_their_logs_prices_vary_and_what_monitors_measure_with_does_not(
    cell: Path, held: Any, tmp_path: Path
) -> None:
    _, rules, results = held
    for (team, trial, number), result in results.items():
        file = tmp_path / "logs" / team / f"{trial}_{number}.json"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(as_json(result), encoding="utf-8")
    shutil.copy(cell / "rules.yaml", tmp_path)
    text = (cell / "competition.yaml").read_text(encoding="utf-8").replace(".mcap", ".json")
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")
    competition = load_competition(tmp_path)
    stored = competition, rules, score_runs(competition, rules)

    found = explored(stored, {"approach": [0], "reaction": [0.3]})

    assert [lever.name for lever in found.levers] == ["approach"]
    assert found.skipped == {"reaction": "needs the log, to measure again"}
    assert found.points == explored(held, {"approach": [0]}).points


def test_a_value_that_a_monitor_refuses_has_no_ranking(held: Any) -> None:
    found = explored(held, {"reaction": [-1.0]})

    assert found.points[(0,)] is None
    assert found.points[(1,)] is not None
    assert list(flips_of(found)) == []


def test_a_number_that_the_rules_do_not_have_is_refused_with_one_they_have(held: Any) -> None:
    with pytest.raises(RuleSetError, match="no number 'aproach' to vary") as refused:
        explored(held, {"aproach": [1]})
    assert "approach" in refused.value.hint


def test_a_grid_of_too_many_points_is_refused(held: Any) -> None:
    with pytest.raises(RuleSetError, match="441 points, each value with each, are more than 400"):
        explored(held, {"approach": range(21), "approach_s": range(21)})
