"""Every official configuration of 2017 to 2025: it loads, or what is wrong with it is named.

What must be in a file is counted here from the plain YAML, without the readers.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score.checks.contracts import Wanted
from ariac_score.errors import DataFileError
from ariac_score.trial.channels import LogMap
from ariac_score_ariac.config.ariac_config import TrialConfigReader
from ariac_score_ariac.config.config_forms import form_in, looks_like
from ariac_score_ariac.config.team_config import TeamConfigReader, TeamNameReader

CONFIG = Path(__file__).parents[3].parent / "shared" / "ariac" / "data" / "config"
pytestmark = pytest.mark.skipif(not CONFIG.is_dir(), reason="the official files are not here")

TRIALS, TEAMS, ENTRIES = TrialConfigReader(), TeamConfigReader(), TeamNameReader()
WANTED = Wanted(LogMap("test"))

BELOW_OPTIONS = "'time_limit' stands below 'options'"
MISTAKES = {
    "2020/qual_a_2.yaml": "key 'piston_rod_part_red' is given twice, first in line 98 (line 103,",
    "2020/sample2.yaml": "key 'pulley_part_red' is given twice, first in line 101 (line 111,",
    "2020/sample_order_update.yaml": "key 'pulley_part_red' is given twice, first in line 99 (line 109,",
    "2021/tip/sample_assembly.yaml": BELOW_OPTIONS,
    "2021/tip/sample_faulty_gripper.yaml": BELOW_OPTIONS,
    "2021/tip/sample_faulty_sensor.yaml": BELOW_OPTIONS,
    "2021/tip/sample_insufficient_product.yaml": BELOW_OPTIONS,
    "2021/tip/sample_kitting.yaml": BELOW_OPTIONS,
    "2021/tip/sample_kitting_assembly.yaml": BELOW_OPTIONS,
    "2021/tip/sample_multiple_non_high_priority_orders.yaml": BELOW_OPTIONS,
    "2021/tip/sample_new_order.yaml": BELOW_OPTIONS,
    "2021/tip/sample_part_reorientation.yaml": BELOW_OPTIONS,
    "2021/tip/sample_partially_filled_assembly.yaml": BELOW_OPTIONS,
    "2021/tip/sample_task_changeover.yaml": BELOW_OPTIONS,
    "2023/trials/assembly.yaml": "'p1/2' names 'p1'; only pi is known (line 37,",
    "2023/trials/human_assembly.yaml": "'p1/2' names 'p1'; only pi is known (line 40,",
    "2023/trials/kitting_assembly.yaml": "'p1/2' names 'p1'; only pi is known (line 31,",
    "2023/trials/tutorial.yaml": "'p1/2' names 'p1'; only pi is known (line 31,",
    "2024/trials/assembly.yaml": "'p1/2' names 'p1'; only pi is known (line 43,",
    "2024/trials/tutorial.yaml": "'p1/2' names 'p1'; only pi is known (line 37,",
}
"""Official files with a mistake that changes no order; found by hand."""

EMPTY = "2022/trial_config/agility_challenges/hpo_assembly_kitting.yaml"

OTHERS = {
    "2023/human_params.yaml": "parameters of ROS nodes",
    "2024/object_poses.yaml": "the places of bins and stations",
    "2025/defects_1b86310.yaml": "the list of cell defects",
    "2025/scoring_weights_1b86310.yaml": "the scoring weights",
    "2025/scoring_weights_4a18a81.yaml": "the scoring weights",
}
"""Official files that are neither trial nor team."""
TEST_WORLD = "models put into the simulation for a test of the scorer"


def official_files() -> list[str]:
    return sorted(path.relative_to(CONFIG).as_posix() for path in CONFIG.rglob("*.yaml"))


def plain(name: str) -> Any:
    # As the official scripts load it: of two equal keys the last counts.
    return yaml.safe_load((CONFIG / name).read_text(encoding="utf-8"))


def kind_of(name: str) -> str:
    root = plain(name)
    if name == EMPTY:
        return "empty"
    if name in OTHERS or set(root) <= {"models_to_spawn", "faulty_products", "random_seed"}:
        return "other"
    if "orders" in root or "NUM_KITS" in root:
        return "trial"
    return "entry" if "team_name" in root else "team"


@cache
def kinds() -> dict[str, str]:
    return {name: kind_of(name) for name in official_files()}


def of_kind(kind: str) -> list[str]:
    return [name for name, found in kinds().items() if found == kind]


def shipments(order: Any) -> list[tuple[int, int]]:
    """How often each block of an order is wanted, and how many products it has; counted by hand."""
    if "kitting" in order or "assembly" in order:
        blocks = [order[kind] for kind in ("kitting", "assembly") if kind in order]
        return [(block["shipment_count"], len(block["products"])) for block in blocks]
    if "type" in order:
        return [(1, len(order[f"{order['type']}_task"]["products"]))]
    count = order.get("shipment_count", order.get("kit_count", 1))
    return [(count, len(order.get("products", order.get("parts"))))]


@pytest.mark.slow
def test_every_official_file_is_accounted_for() -> None:
    assert {kind: len(of_kind(kind)) for kind in sorted(set(kinds().values()))} == {
        "empty": 1,
        "entry": 2,
        "other": 27,
        "team": 28,
        "trial": 145,
    }
    assert sorted({name[:4] for name in kinds()}) == [str(year) for year in range(2017, 2026)]


@pytest.mark.slow
def test_every_official_trial_loads_whole(subtests: pytest.Subtests) -> None:
    for name in of_kind("trial"):
        with subtests.test(name):
            assert TRIALS.can_read(CONFIG / name)
            assert not TEAMS.can_read(CONFIG / name)
            assert looks_like(CONFIG / name).startswith("a trial configuration of 20")
            trial, root = TRIALS.read(CONFIG / name, WANTED), plain(name)

            orders = root.get("orders", [])
            wanted = [
                pair
                for order in (orders.values() if isinstance(orders, dict) else orders)
                for pair in shipments(order)
            ]
            tasks = [task for order in trial.work for task in order.tasks]
            assert len(trial.work) == len(orders)
            assert len(tasks) == sum(count for count, _ in wanted)
            assert sum(len(task.products) for task in tasks) == sum(
                count * products for count, products in wanted
            )
            limit_s = root.get("time_limit", root.get("TIME_LIMIT", -1))
            assert trial.facts.get("time_limit_s", -1) == limit_s


def test_the_mistakes_of_official_trials_are_named_and_no_others(subtests: pytest.Subtests) -> None:
    for name in of_kind("trial"):
        with subtests.test(name):
            found = [defect.message for defect in TRIALS.read(CONFIG / name, WANTED).log_defects]

            assert len(found) == (name in MISTAKES)
            assert all(message.startswith(MISTAKES[name]) for message in found)


def test_every_official_team_loads_whole(subtests: pytest.Subtests) -> None:
    for name in of_kind("team"):
        with subtests.test(name):
            assert TEAMS.can_read(CONFIG / name)
            assert not TRIALS.can_read(CONFIG / name)
            assert not ENTRIES.can_read(CONFIG / name)
            trial, root = TEAMS.read(CONFIG / name, WANTED), plain(name)

            switched = [
                root.get(f"{on}_camera", {}).get("enable") for on in ("robot", "gantry_bin", "gantry_tray")
            ]
            active = [camera["active"] for camera in root.get("robot_cameras", {}).values()]
            placed = [root.get(key, {}) for key in ("sensors", "static_sensors", "SENSORS")]
            assert trial.team is not None
            assert trial.team.sensors is not None
            assert len(trial.team.sensors) == sum(map(len, placed)) + switched.count(True) + active.count(
                True
            )
            assert trial.team.name == root.get("COMPETITOR_NAME", "")
            assert trial.log_defects == ()


def test_of_an_entry_for_the_evaluation_only_the_name_is_read(subtests: pytest.Subtests) -> None:
    for name in of_kind("entry"):
        with subtests.test(name):
            path = CONFIG / name
            trial = ENTRIES.read(path, WANTED)
            refusals = []
            for reader in (TRIALS, TEAMS):
                assert not reader.can_read(path)
                with pytest.raises(
                    DataFileError, match="a team's entry for the evaluation of 2023 or 2024"
                ) as caught:
                    reader.read(path, WANTED)
                refusals.append(str(caught.value) + caught.value.hint)

            assert trial.team is not None
            assert (trial.team.name, trial.team.sensors, trial.records) == (
                "nist_competitor",
                None,
                (),
            )
            texts = (*refusals, repr(trial), repr(ENTRIES.describe(path)))
            secrets = [value for key, value in plain(name)["github"].items() if value]
            assert secrets
            assert not any(secret in words for secret in secrets for words in texts)


def test_every_other_official_file_is_called_by_its_name(subtests: pytest.Subtests) -> None:
    for name in of_kind("other"):
        with subtests.test(name):
            path, words = CONFIG / name, OTHERS.get(name, TEST_WORLD)

            assert words in looks_like(path)
            for reader in (TRIALS, TEAMS):
                assert not reader.can_read(path)
                with pytest.raises(DataFileError, match=f"it looks like {words}"):
                    reader.read(path, WANTED)


def test_the_official_trial_that_is_empty_is_called_empty() -> None:
    for reader in (TRIALS, TEAMS):
        assert not reader.can_read(CONFIG / EMPTY)
        with pytest.raises(DataFileError, match="the file is empty"):
            reader.read(CONFIG / EMPTY, WANTED)


@pytest.mark.parametrize(
    ("name", "years"),
    [
        ("2017/comp_configs/qual1a.yaml", "2017"),
        ("2018/quals/qual1a.yaml", "2018 to 2020"),
        ("2019/sample.yaml", "2019 or 2020"),
        ("2020/qual_a_1.yaml", "2019 or 2020"),
        ("2021/docker/qual1.yaml", "2021 or 2022"),
        ("2022/trial_config/qualifiers/qual_a.yaml", "2022"),
        ("2023/trials/kitting.yaml", "2023 or 2024"),
        ("2024/trials/kitting.yaml", "2023 or 2024"),
        ("2025/trial_minimal_ny32.yaml", "2025"),
    ],
)
def test_a_trial_tells_its_years(name: str, years: str) -> None:
    assert looks_like(CONFIG / name) == f"a trial configuration of {years}"


@pytest.mark.parametrize(
    ("name", "years"),
    [
        ("2017/example_team_config.yaml", "2017 to 2022"),
        ("2020/sample_user_config.yaml", "2017 to 2022"),
        ("2021/tip/sample_user_config.yaml", "2021 or 2022"),
        ("2022/user_config/sample_user_config.yaml", "2022"),
        ("2023/sensors.yaml", "2023"),
        ("2024/sensors.yaml", "2024"),
        ("2025/team_config_ny32.yaml", "2025"),
    ],
)
def test_a_team_tells_its_years(name: str, years: str) -> None:
    assert looks_like(CONFIG / name) == f"a team configuration of {years}"


def test_no_trial_tells_years_that_are_not_its_own(subtests: pytest.Subtests) -> None:
    for name in (name for name in of_kind("trial") if not name.startswith("2025")):
        with subtests.test(name):
            assert int(name[:4]) in form_in(CONFIG / name).years


def test_the_official_trial_of_2025_states_its_numbers() -> None:
    trial = TRIALS.read(CONFIG / "2025/trial_minimal_ny32.yaml", WANTED)

    assert dict(trial.facts) == {
        "num_high_priority": 0.0,
        "num_kits": 1.0,
        "num_modules": 0.0,
        "time_limit_s": 100.0,
    }
    assert trial.work == ()


def test_the_kits_of_2017_are_read_exactly() -> None:
    (order,) = TRIALS.read(CONFIG / "2017/comp_configs/qual1a.yaml", WANTED).work
    (kit,) = order.tasks

    assert (kit.id, kit.agv, kit.tray) == ("order_0_kit_0", "any", None)
    assert [product.type for product in kit.products] == ["piston_rod_part"] * 2 + ["gear_part"] * 3
    assert kit.products[0].pose is not None
    assert kit.products[0].pose.position_m == (0.1, -0.2, 0.0)
