"""The `ranking:` block: what teams are ranked by."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from ariac_score import load_rule_set
from ariac_score.errors import DataFileError
from ariac_score.ranking.spec import Spec, ranking_spec


def spec(**overrides: Any) -> Spec:
    given = {"best": "highest", **overrides} if "value" in overrides else overrides
    return ranking_spec(load_rule_set("paper2020.published"), given, file="competition.yaml")


def teams(*pairs: tuple[float, float | None]) -> list[Mapping[str, Decimal | None]]:
    return [
        {"execution": Decimal(str(e)), "judges": None if j is None else Decimal(str(j))} for e, j in pairs
    ]


def test_by_default_teams_are_ranked_by_the_sum_of_their_trials() -> None:
    assert spec().values(teams((3, None), (4.5, None))) == [3.0, 4.5]
    assert spec().highest


def test_the_ranks_of_2025_are_mixed_eight_to_two() -> None:
    mixed = spec(value="0.8 * rank(execution) + 0.2 * rank(judges)", best="lowest")

    # E ranks 1, 2, 2, 4 (two alike share), H ranks 3, 1, 2, 4
    values = mixed.values(teams((9, 5), (8, 12), (8, 7), (1, 3)))

    assert values == [pytest.approx(v) for v in (0.8 + 0.6, 1.6 + 0.2, 1.6 + 0.4, 3.2 + 0.8)]
    assert not mixed.highest


def test_a_share_is_the_part_of_the_highest() -> None:
    assert spec(value="80 * share(execution) + 20 * share(judges)").values(teams((50, 4), (100, 2))) == [
        60,
        90,
    ]


def test_a_share_of_nothing_is_nothing() -> None:
    assert spec(value="share(execution)").values(teams((0, None), (0, None))) == [0, 0]


def test_a_team_without_the_marks_the_value_needs_has_none() -> None:
    values = spec(value="execution + judges").values(teams((1, 2), (5, None)))

    assert values == [3.0, None]


@pytest.mark.parametrize(
    ("overrides", "cause"),
    [
        ({"value": "executoin"}, "unknown name 'executoin'"),
        ({"value": "trial.score"}, "unknown name 'trial.score'"),
        ({"value": "rank(execution + 1)"}, "rank() takes one name"),
        ({"value": "rank(execution + 1) + rank(execution)"}, "rank() takes one name"),
        ({"value": "rank(execution, judges)"}, "rank() takes one name"),
        ({"value": "rank(rank)"}, "unknown name 'rank'"),
        ({"value": "share + share(execution)"}, "unknown name 'share'"),
        ({"value": "execution +"}, "is not a formula"),
        ({"by": [{"highest": "tsk"}]}, "'tsk' is nothing that can be compared here"),
        ({"by": [{"highest": "execution"}]}, "'execution' is nothing that can be compared here"),
        ({"ties": [{"lowest": "score"}]}, "'score' is nothing that can be compared here"),
        ({"by": [{"highest": "task"}]}, "has no task score"),
        ({"keep": 0}, "0 is less than the minimum"),
        ({"best": "top"}, "'top' is not allowed here"),
        ({"tie": []}, "unknown key 'tie'"),
        ({"by": [{"highest": "score", "lowest": "score"}]}, "too many properties"),
    ],
)
def test_what_cannot_be_ranked_by_is_refused(overrides: dict[str, Any], cause: str) -> None:
    with pytest.raises(DataFileError) as caught:
        spec(**overrides)
    assert cause in caught.value.cause


def test_a_new_value_says_which_end_comes_first() -> None:
    with pytest.raises(DataFileError, match="but not which end comes first"):
        ranking_spec(load_rule_set("ariac2025.as_coded"), {"value": "execution"}, file="competition.yaml")


def test_a_rule_set_may_say_how_it_is_ranked(tmp_path: Path) -> None:
    text = (
        "id: mine\ntitle: Mine\nsource: t\nextends: paper2020.published\nranking: {keep: 2, best: lowest}\n"
    )
    (tmp_path / "mine.yaml").write_text(text)
    found = ranking_spec(load_rule_set(str(tmp_path / "mine.yaml")), {"best": "highest"}, file="x")

    assert (found.keep, found.highest) == (2, True)
