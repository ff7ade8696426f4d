"""What a team's sensors cost: price lists of the rulebooks, sums worked by hand."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Finding,
    TeamSetup,
    Trial,
    Verdict,
    Wanted,
    as_json,
    load_result,
    load_rule_set,
    score_trial,
)
from ariac_score.checks.contracts import Monitor
from ariac_score.checks.registry import Registry
from ariac_score.errors import RuleSetError
from ariac_score.trial.channels import LogMap
from ariac_score_ariac.config.team_config import TeamConfigReader
from ariac_score_ariac.tasks import SensorCost
from ariac_score_ariac.work import SensorBill

CONFIG = Path(__file__).parents[3].parent / "shared" / "ariac" / "data" / "config"
REAL = CONFIG.parent / "nist_team_2022"
LAWS = settings(max_examples=100, derandomize=True, deadline=None)

OTHER_100 = {"break_beam": 100.0, "proximity_sensor": 100.0, "laser_profiler": 100.0, "camera": 100.0}
PRICES_2017 = {**OTHER_100, "logical_camera": 500.0, "depth_camera": 100.0}
PRICES_2018 = {**PRICES_2017, "depth_camera": 200.0}
PRICES_2020 = {**PRICES_2018, "rgbd_camera": 500.0}
PRICES_2021_TIP = {**PRICES_2020, "robot_camera": 600.0}
PRICES_2021_FINALS = {**PRICES_2021_TIP, "rgbd_camera": 300.0}
PRICES_2022 = {
    **PRICES_2018,
    "rgbd_camera": 300.0,
    "gantry_tray_camera": 300.0,
    "gantry_bin_camera": 600.0,
}
PRICES_2024 = {
    "break_beam": 100.0,
    "proximity": 100.0,
    "laser_profiler": 200.0,
    "lidar": 300.0,
    "rgb_camera": 300.0,
    "rgbd_camera": 500.0,
    "basic_logical_camera": 500.0,
    "robot_rgb_camera": 800.0,
    "robot_rgbd_camera": 1000.0,
}
PRICES_2023 = {**PRICES_2024, "advanced_logical_camera": 2000.0}
PRICES_2025 = {
    "break_beam_30hz": 400.0,
    "break_beam_10hz": 200.0,
    "distance_30hz": 600.0,
    "distance_10hz": 300.0,
    "camera_1080p_30hz": 800.0,
    "camera_720p_30hz": 500.0,
    "lidar_20hz": 1500.0,
    "lidar_10hz_400_samples": 1250.0,
    "lidar_10hz_200_samples": 1000.0,
}
"""Sensor prices: the Doc part of each year's section of the rulebooks."""


def only(monitor: SensorCost, of: Trial | TeamSetup | None) -> Finding:
    (finding,) = monitor.watch(of if isinstance(of, Trial) else Trial("t", team=of))
    assert finding.subject == "team"
    return finding


def team(*types: str, cost: float | None = None) -> Trial:
    setup = TeamSetup(sensors={f"s{n}": kind for n, kind in enumerate(types)})
    return Trial("t", team=setup, records=() if cost is None else (SensorBill(cost),))


def team_without_list(cost: float) -> Trial:
    return Trial("t", records=(SensorBill(cost),))


def test_it_is_a_monitor_that_needs_no_signal() -> None:
    assert isinstance(SensorCost(), Monitor)
    assert list(SensorCost().needs()) == []


@pytest.mark.skipif(not CONFIG.is_dir(), reason="the official files are not here")
@pytest.mark.parametrize(
    ("name", "prices", "dollars", "sensors"),
    [
        # 3 logical cameras, break beam, proximity, laser profiler
        ("2017/example_team_config.yaml", PRICES_2017, 3 * 500 + 3 * 100, 6),
        # 2 logical cameras, depth camera, break beam, proximity, laser profiler
        ("2018/sample_user_config.yaml", PRICES_2018, 2 * 500 + 200 + 3 * 100, 6),
        ("2019/example_team_config.yaml", PRICES_2018, 2 * 500 + 200 + 3 * 100, 6),
        ("2019/sample_user_config.yaml", PRICES_2018, 4 * 500, 4),
        ("2020/sample_user_config.yaml", PRICES_2020, 2 * 500 + 2 * 200 + 3 * 100, 7),
        # 6 logical and 4 RGBD cameras, 3 others
        ("2020/sample_user_config_obstacles.yaml", PRICES_2020, 6 * 500 + 4 * 500 + 3 * 100, 13),
        ("2021/tip/sample_user_config.yaml", PRICES_2021_TIP, 2 * 500 + 3 * 100, 5),
        # 6 logical cameras and the robot camera, switched on
        ("2021/finals_a97e234/sample_user_config.yaml", PRICES_2021_FINALS, 6 * 500 + 600, 7),
        ("2021/finals_a97e234/sample_user_config_rgbd.yaml", PRICES_2021_FINALS, 6 * 300, 6),
        # 7 logical cameras and both views of the gantry camera
        ("2022/user_config/sample_user_config.yaml", PRICES_2022, 7 * 500 + 600 + 300, 9),
        # RGBD, depth, 3 others, both views
        ("2022/user_config/sample_user_config_misc.yaml", PRICES_2022, 300 + 200 + 3 * 100 + 900, 7),
        ("2022/test_competitor/kitting_sensors.yaml", PRICES_2022, 7 * 500, 7),
        # one of each type
        ("2023/sample.yaml", PRICES_2023, 2000 + 500 + 100 + 200 + 300 + 100 + 300 + 500, 8),
        ("2023/sensors.yaml", PRICES_2023, 4 * 2000, 4),
        ("2024/sensors.yaml", PRICES_2024, 100, 1),
        ("2025/team_config_ny32.yaml", PRICES_2025, 200, 1),
    ],
)
def test_an_official_team_costs_what_the_rulebook_asks(
    name: str, prices: dict[str, float], dollars: float, sensors: int
) -> None:
    trial = TeamConfigReader().read(CONFIG / name, Wanted(LogMap("test")))
    finding = only(SensorCost(prices), trial.team)

    assert finding.verdict is Verdict.SATISFIED
    assert finding.quantities == {"dollars": dollars, "sensors": sensors}


def test_every_grade_of_2025_has_its_price() -> None:
    kinds = [*PRICES_2025, "camera_720p_30hz"]
    finding = only(SensorCost(PRICES_2025), team(*kinds))

    # 400+200 + 600+300 + 800+500 + 1500+1250+1000, and one more camera of 500
    assert finding.quantities == {"dollars": 7050, "sensors": 10}
    assert finding.message.startswith("$7,050: 1 x break_beam_10hz, 1 x break_beam_30hz, 1 x camera_1080p")
    assert "2 x camera_720p_30hz" in finding.message


def test_no_sensors_cost_nothing() -> None:
    finding = only(SensorCost(PRICES_2024), team())

    assert finding.verdict is Verdict.SATISFIED
    assert finding.quantities == {"dollars": 0, "sensors": 0}
    assert finding.message == "$0: no sensors placed"


@pytest.mark.parametrize("take", ["recorded_first", "configured", "recorded"])
@pytest.mark.parametrize("nothing", [None, TeamSetup(), TeamSetup("blue")])
def test_what_nobody_says_is_inconclusive_and_not_free(take: Any, nothing: TeamSetup | None) -> None:
    finding = only(SensorCost(PRICES_2024, take=take), nothing)

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert finding.quantities == {}


def test_a_type_without_a_price_is_named() -> None:
    finding = only(SensorCost(PRICES_2024), team("lidar", "quality_control"))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert finding.message == "sensors of type 'quality_control' have no price in this edition"


def test_a_type_that_is_not_for_teams_is_named() -> None:
    finding = only(SensorCost(PRICES_2020, excluded=("quality_control",)), team("quality_control"))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert finding.message == "sensors of type 'quality_control' are not for teams in this edition"


def test_a_free_type_is_counted_and_costs_nothing() -> None:
    """2024: an advanced logical camera counts in the list and adds no cost."""
    monitor = SensorCost(PRICES_2024, free=("advanced_logical_camera",))
    finding = only(monitor, team("advanced_logical_camera", "lidar"))

    assert finding.quantities == {"dollars": 300, "sensors": 2}
    assert finding.message == "$300: 1 x advanced_logical_camera (free), 1 x lidar"


@pytest.mark.parametrize(
    ("take", "setup", "dollars", "words"),
    [
        ("recorded_first", team("lidar", cost=300.0), 300, "$300 by the official record: 1 x lidar"),
        ("recorded_first", team("lidar"), 300, "$300: 1 x lidar"),
        ("recorded_first", team_without_list(250.5), 250.5, "$250.50 by the official record"),
        (
            "recorded_first",
            team("lidar", cost=900.0),
            900,
            "$900 by the official record; by the configuration $300: 1 x lidar",
        ),
        (
            "recorded_first",
            team("radar", cost=900.0),
            900,
            "$900 by the official record; by the configuration not known: "
            "sensors of type 'radar' have no price in this edition",
        ),
        ("recorded", team("radar", cost=900.0), 900, "$900 by the official record"),
        ("configured", team("lidar", cost=900.0), 300, "$300: 1 x lidar"),
    ],
)
def test_take_says_which_cost_counts(take: Any, setup: Trial, dollars: float, words: str) -> None:
    finding = only(SensorCost(PRICES_2024, take=take), setup)

    assert finding.verdict is Verdict.SATISFIED
    assert (finding.quantities["dollars"], finding.message) == (dollars, words)
    assert ("sensors" in finding.quantities) == (setup.team is not None)


@pytest.mark.parametrize(
    ("take", "setup"),
    [
        ("recorded", team("lidar")),
        ("configured", team_without_list(900.0)),
        ("configured", team("radar", cost=900.0)),
    ],
)
def test_the_cost_that_counts_must_be_known(take: Any, setup: Trial) -> None:
    assert only(SensorCost(PRICES_2024, take=take), setup).verdict is Verdict.INCONCLUSIVE


@LAWS
@given(
    kinds=st.lists(st.sampled_from(sorted(PRICES_2023)), max_size=30),
    more=st.sampled_from(sorted(PRICES_2023)),
)
def test_one_more_sensor_costs_its_price_more_wherever_it_stands(kinds: list[str], more: str) -> None:
    monitor = SensorCost(PRICES_2023)
    before, after = only(monitor, team(*kinds)), only(monitor, team(more, *kinds))

    assert after.quantities["dollars"] - before.quantities["dollars"] == PRICES_2023[more]
    assert only(monitor, team(*kinds, more)) == after


# Parameters of a rule set


def built(parameters: dict[str, Any]) -> Any:
    return Registry().find("ariac_score.monitors", "team.sensor_cost").build(parameters)


def test_a_rule_set_gives_prices_as_a_map() -> None:
    monitor = built({"prices": {"lidar": 300}, "free": ["camera"], "take": "configured"})

    assert only(monitor, team("lidar", "camera")).quantities == {"dollars": 300, "sensors": 2}


@pytest.mark.parametrize(
    ("parameters", "cause"),
    [
        ({"prices": {"lidar": -1}}, "the price of 'lidar' is -1"),
        ({"prices": {"lidar": "300"}}, "'300' is not a float"),
        ({"prices": {"lidar": True}}, "True is not a float"),
        ({"prices": {"lidar": float("nan")}}, "nan is not finite"),
        ({"prices": {3: 100}}, "3 is not a str"),
        ({"prices": [100]}, "is not a mapping of names"),
        ({"prices": {"lidar": 300}, "free": ["lidar"]}, "'lidar' can be only one of"),
        ({"free": ["lidar"], "excluded": ["lidar"]}, "'lidar' can be only one of"),
        ({"take": "cheapest"}, "'cheapest' is not one of"),
        ({"price": {}}, "has no parameter 'price'"),
    ],
)
def test_parameters_that_make_no_sense_are_refused(parameters: dict[str, Any], cause: str) -> None:
    with pytest.raises(RuleSetError) as caught:
        built(parameters)
    assert cause in str(caught.value)


RULE_SET = """\
id: prices_of_2022
title: What the sensors cost
source: rulebook 2022, documented sensor prices
log_map: ariac2020
monitors:
  cost:
    use: team.sensor_cost
    with: {prices: {logical_camera: 500, depth_camera: 200, break_beam: 100}}
terms:
  trial:
    dollars: measure(cost, dollars)
score: dollars
round: 2
"""


@pytest.mark.skipif(not REAL.is_dir(), reason="the real trial of 2022 is not here")
def test_a_rule_set_prices_the_sensors_of_a_real_trial(tmp_path: Path) -> None:
    bundle = tmp_path / "bundle"
    bundle.mkdir()
    for name in ("performance.log", "config/team_config.yaml", "config/trial_kitting.yaml"):
        shutil.copy(REAL / name, bundle)
    rules = tmp_path / "prices.yaml"
    rules.write_text(RULE_SET, encoding="utf-8")

    result = score_trial(bundle, load_rule_set(str(rules)))

    assert result.score == 7 * 500
    # Priced again from its own text, map of prices included.
    stored = tmp_path / "result.json"
    stored.write_text(as_json(result), encoding="utf-8")
    assert load_result(stored).score == result.score
