"""How the scores of a team become one number: ours, those of distributions, and what is refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal, localcontext
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score import load_rule_set
from ariac_score.cli import main
from ariac_score.errors import DataFileError, PluginConflictError, PluginError
from ariac_score.ranking.publication import load_publication
from ariac_score.ranking.resampling import totalled
from ariac_score.ranking.spec import Spec, ranking_spec
from ariac_score.ranking.totals import Total, total_named
from ariac_score_ariac.testing.official_texts import Outcome, PlannedOrder, sensor_cost_text, trial_log_text

Install = Callable[..., str]
GROUP = "ariac_score.ranking_policies"
KIT = (PlannedOrder("AAAA0001", "kitting", False, (("pump", "red"),)),)
SCORES = [Decimal("5"), Decimal("1"), Decimal("4.5"), Decimal("0")]


def spec(name: str) -> Spec:
    return ranking_spec(load_rule_set("paper2020.published"), {"total": name}, file="competition.yaml")


def competition(root: Path, total: str) -> Path:
    """Alpha makes 5 and 1, beta 3 and 3, gamma 5 and 3: sums 6, 6, 8."""
    made = {"alpha": ("", "type"), "beta": ("color", "color"), "gamma": ("", "color")}
    for team, flaws in made.items():
        for trial, flaw in zip(("one", "two"), flaws, strict=True):
            folder = root / "logs" / team / f"{trial}_1"
            folder.mkdir(parents=True)
            (folder / "trial_log.txt").write_text(trial_log_text(trial, KIT, [Outcome((flaw,), 50.0)]))
            (folder / "sensor_cost.txt").write_text(sensor_cost_text({"basic_logical_camera": 2}))
    head = "id: test\nrules: ariac2024.official\nruns: logs/{team}/{trial}_{run}\n"
    (root / "competition.yaml").write_text(f"{head}ranking: {{total: {total}, intervals: {{draws: 200}}}}\n")
    return root / "competition.yaml"


def ranked(root: Path, total: str) -> dict[str, float]:
    assert (
        main(["rank", str(competition(root, total)), "--output-format", "json", "-o", str(root / "r.json")])
        == 0
    )
    stored = json.loads((root / "r.json").read_text())
    return {one["team"]: one["execution"] for one in stored["standings"]}


# Ours -----------------------------------------------------------------------------------


def test_a_ranking_is_the_same_whatever_context_decimals_have(tmp_path: Path) -> None:
    with localcontext() as context:
        context.prec = 3  # in which no score of six decimals can be rounded at all
        assert ranked(tmp_path, "sum") == {"alpha": 6, "beta": 6, "gamma": 8}


@pytest.mark.parametrize(
    ("name", "number"),
    [("sum", "10.5"), ("mean", "2.625"), ("median", "2.75"), ("highest", "5"), ("lowest", "0")],
)
def test_each_of_ours_by_hand(name: str, number: str) -> None:
    assert total_named(name).execution(SCORES) == Decimal(number)


def test_a_third_has_nine_digits_and_nothing_is_nothing() -> None:
    assert total_named("mean").execution([Decimal(1), Decimal(0), Decimal(0)]) == Decimal("0.333333333")
    assert total_named("mean").execution([]) == 0


@pytest.mark.slow
@given(
    st.sampled_from(["sum", "mean", "median", "highest", "lowest"]),
    st.lists(st.integers(-(10**6), 10**6), min_size=1, max_size=6),
    st.randoms(use_true_random=False),
)
def test_no_order_of_trials_changes_a_total_and_columns_say_what_numbers_say(
    name: str, units: list[int], random: object
) -> None:
    own = spec(name)
    scores = [Decimal(unit).scaleb(-3) for unit in units]
    mixed = list(scores)
    random.shuffle(mixed)  # type: ignore[attr-defined]
    cells = np.array([[[unit, unit] for unit in units]], dtype=np.int64)

    found = totalled(cells, 3, own)

    assert own.total.execution(scores) == own.total.execution(mixed)
    assert found.shape == (1, 2)
    # Units are thousandths here: a total may differ from its column by half of one.
    assert abs(Decimal(int(found[0, 0])).scaleb(-3) - own.total.execution(scores)) <= Decimal("0.0005")


def test_a_ranking_by_the_highest_score_and_one_by_the_sum(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    by_sum, by_highest = ranked(tmp_path / "a", "sum"), ranked(tmp_path / "b", "highest")

    assert set(by_sum) == {"alpha", "beta", "gamma"}
    assert by_highest["alpha"] == by_highest["gamma"] > by_highest["beta"]
    assert by_sum["gamma"] > by_sum["alpha"] > 0
    how = load_publication(tmp_path / "b/r.json").how
    assert how.total == "highest"
    assert how.total_by.startswith("ariac-score ")
    # Nothing is said about the sum, as ever.
    assert "total" not in json.loads((tmp_path / "a/r.json").read_text())["how"]


def test_a_published_total_that_was_changed_is_refused(tmp_path: Path) -> None:
    ranked(tmp_path, "mean")
    stored = json.loads((tmp_path / "r.json").read_text())
    stored["standings"][0]["execution"] += 1
    (tmp_path / "r.json").write_text(json.dumps(stored))

    with pytest.raises(DataFileError, match="its trials make"):
        load_publication(tmp_path / "r.json")


# Of distributions -----------------------------------------------------------------------

BEST_TWO = "def best_two(scores):\n    return sum(sorted(scores)[-2:])\n"


def test_a_policy_of_a_distribution_ranks(install: Install, tmp_path: Path) -> None:
    install("cup-score", {"best_two": "best_two"}, source=BEST_TWO, group=GROUP)

    assert total_named("best_two").execution(SCORES) == Decimal("9.5")
    executions = ranked(tmp_path, "best_two")
    by_sum = tmp_path / "sum"
    by_sum.mkdir()
    assert executions == ranked(by_sum, "sum")  # of two trials the best two are all
    assert load_publication(tmp_path / "r.json").how.total_by.startswith("cup-score 1.0 ")


def test_a_ranking_by_a_policy_that_is_not_installed_any_more_can_still_be_read(
    tmp_path: Path, install: Install, monkeypatch: pytest.MonkeyPatch
) -> None:
    install("cup-score", {"best_two": "best_two"}, source=BEST_TWO, group=GROUP)
    ranked(tmp_path, "best_two")
    monkeypatch.undo()

    assert load_publication(tmp_path / "r.json").how.total == "best_two"


@pytest.mark.parametrize(
    ("source", "cause"),
    [
        ("def f(scores): return 1 / 0", "raised ZeroDivisionError"),
        ("def f(scores): return 0.5", "gives 0.5 instead of a finite Decimal"),
        ("from decimal import Decimal\ndef f(scores): return Decimal('NaN')", "instead of a finite Decimal"),
        ("f = 3", "is a int, not a Callable"),
    ],
)
def test_a_policy_that_fails_is_named(install: Install, source: str, cause: str) -> None:
    install("odd-score", {"odd": "f"}, source=source, group=GROUP)

    with pytest.raises(PluginError, match=cause) as refused:
        total_named("odd").execution(SCORES)
    assert "odd (odd-score 1.0)" in str(refused.value)


def test_a_policy_that_is_not_there_is_refused_with_the_place_and_the_near_ones(tmp_path: Path) -> None:
    with pytest.raises(PluginError, match="'means'") as refused:
        spec("means")

    assert (refused.value.file, refused.value.place) == ("competition.yaml", "$.ranking.total")
    assert "did you mean 'mean'?" in refused.value.hint


@pytest.mark.parametrize("named", ["total: best_two", "strict: course.jury"])
def test_rules_that_name_what_is_not_installed_are_not_sound(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], named: str
) -> None:
    rules = tmp_path / "own.yaml"
    rules.write_text(
        f"{{id: own, title: O, source: ours, extends: paper2020.published, ranking: {{{named}}}}}"
    )

    assert main(["rules", "validate", str(rules)]) == 4
    assert f"no installed distribution provides {named.split()[1]!r}" in capsys.readouterr().err


def test_two_of_one_name_are_refused(install: Install) -> None:
    install("foul-score", {"mean": "f"}, source="def f(scores): return 0", group=GROUP)

    with pytest.raises(PluginConflictError, match=r"ariac-score .* and foul-score"):
        spec("mean")
    assert spec("sum").total == Total()
    assert replace(spec("sum"), keep=2).total.name == "sum"
