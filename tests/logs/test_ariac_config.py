"""The readers of trial and sensor configurations, against the official files and hand-written ones."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from ariac_score.contracts import Reader, Wanted
from ariac_score.errors import DataFileError
from ariac_score.logs.ariac_config import TrialConfigReader
from ariac_score.logs.config_values import arithmetic
from ariac_score.logs.team_config import TeamConfigReader
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import Order, Pose, Tray, Trial

ARIAC = Path(__file__).parents[2].parent / "shared" / "ariac" / "data"
CONFIG = ARIAC / "config"
needs_official_files = pytest.mark.skipif(not CONFIG.is_dir(), reason="the official files are not here")

TRIALS, TEAMS = TrialConfigReader(), TeamConfigReader()
WANTED = Wanted(LogMap("test"))

PRODUCTS = "products: {part_0: {type: gear_part_red, pose: {xyz: [0.1, -0.2, 0], rpy: [0, 0, 'pi/2']}}}"

TRIAL_2020 = f"""\
options:
  model_type_aliases: {{order_part1: piston_rod_part_red}}
orders:
  order_0:
    announcement_condition: time
    announcement_condition_value: 0.0
    shipment_count: 2
    destinations: [agv2, any]
    {PRODUCTS}
  order_0_update_0:
    products: {{part_0: {{type: order_part1, pose: {{xyz: [0, 0, 0], rpy: [pi, 0, 0]}}}}}}
  order_1:
    {PRODUCTS}
"""
TRIAL_2022 = f"""\
orders:
  order_0:
    priority: 3
    kitting:
      shipment_count: 1
      trays: [movable_tray_dark_wood]
      agvs: [agv3]
      destinations: [as4]
      {PRODUCTS}
    assembly:
      shipment_count: 2
      stations: [as1, as2]
      {PRODUCTS}
"""


def read(folder: Path, text: str) -> Trial:
    path = folder / "final_1.yaml"
    path.write_text(text, encoding="utf-8")
    return TRIALS.read(path, WANTED)


def refusal(folder: Path, text: str) -> DataFileError:
    with pytest.raises(DataFileError) as caught:
        read(folder, text)
    assert str(folder) in str(caught.value)
    assert caught.value.hint
    return caught.value


def test_both_are_readers() -> None:
    assert isinstance(TRIALS, Reader)
    assert isinstance(TEAMS, Reader)


# The official files

FAILING = {
    "2020/qual_a_2.yaml": "key 'piston_rod_part_red' is given twice",
    "2020/sample2.yaml": "key 'pulley_part_red' is given twice",
    "2020/sample_order_update.yaml": "key 'pulley_part_red' is given twice",
    "2022/trial_config/agility_challenges/hpo_assembly_kitting.yaml": "the file is empty",
}
"""Official files that are wrong, and what is wrong with them."""


OTHER_FILES = ("human_params.yaml", "nist_competitor.yaml", "object_poses.yaml")
"""Official files of 2023 and 2024 that are neither trials nor sensors."""


def official_files() -> list[str]:
    years = ("2019", "2020", "2021", "2022", "2023", "2024")
    return [
        path.relative_to(CONFIG).as_posix() for y in years for path in sorted((CONFIG / y).rglob("*.yaml"))
    ]


@needs_official_files
@pytest.mark.parametrize("name", official_files())
def test_every_official_file_loads_or_names_its_mistake(name: str) -> None:
    path = CONFIG / name
    if name in FAILING:
        with pytest.raises(DataFileError, match=FAILING[name]):
            TRIALS.read(path, WANTED)
    elif TEAMS.can_read(path):
        team = TEAMS.read(path, WANTED).team
        assert team is not None
        assert all(team.sensors.values())
    elif TRIALS.can_read(path):
        orders = TRIALS.read(path, WANTED).orders
        assert orders
        assert all(task.products for order in orders for task in order.tasks)
    else:
        # The test worlds of the scorer put products into the simulation and order nothing.
        assert "test_scoring" in path.parts or path.name in OTHER_FILES


@needs_official_files
def test_the_official_trial_of_2022_is_read_exactly() -> None:
    (order,) = TRIALS.read(ARIAC / "nist_team_2022/config/trial_kitting.yaml", WANTED).orders
    (task,) = order.tasks
    (product,) = task.products

    assert (order.id, order.priority, order.announced_s, order.updates) == ("order_0", 1, None, "")
    assert (task.id, task.kind) == ("order_0_kitting_shipment_0", "kitting")
    assert (task.agv, task.station) == ("agv1", "as1")
    assert task.tray is not None
    assert task.tray.type == "movable_tray_metal_shiny"
    assert (product.slot, product.type) == ("part_0", "assembly_pump_red")
    assert product.pose == Pose((-0.1, -0.1, 0.0))


@needs_official_files
def test_the_official_team_of_2022_has_seven_logical_cameras() -> None:
    path = ARIAC / "nist_team_2022/config/team_config.yaml"

    assert TEAMS.describe(path).facts == {"sensors": 7, "logical_camera": 7}


@needs_official_files
def test_a_trial_of_2020_found_in_the_wild_is_read_exactly() -> None:
    orders = TRIALS.read(ARIAC / "found/sandeep_kota_group1_2020_trial.yaml", WANTED).orders

    # Its printed score gives order_1 priority 3.
    assert [(order.id, order.priority) for order in orders] == [("order_0", 1), ("order_1", 3)]
    assert [(task.id, task.agv) for task in orders[0].tasks] == [("order_0_shipment_0", "agv2")]
    assert [product.type for product in orders[0].tasks[0].products] == [
        "pulley_part_red",
        "disk_part_blue",
        "disk_part_green",
    ]


@needs_official_files
@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("2023/trials/assembly.yaml", 37),
        ("2023/trials/human_assembly.yaml", 40),
        ("2023/trials/kitting_assembly.yaml", 31),
        ("2023/trials/tutorial.yaml", 31),
        ("2024/trials/assembly.yaml", 43),
        ("2024/trials/tutorial.yaml", 37),
    ],
)
def test_the_official_mistakes_of_2023_and_2024_are_named_and_change_no_order(name: str, line: int) -> None:
    trial = TRIALS.read(CONFIG / name, WANTED)
    (mistake,) = trial.log_defects

    assert trial.orders
    assert mistake.kind == "configuration_mistake"
    assert "'p1/2'" in mistake.message
    assert f"line {line}," in mistake.message


# Trials of 2023 and 2024: log formats, section 7.3

TRIAL_2024 = """\
orders:
  - id: 'MMB30H00'
    type: kitting
    announcement: {time_condition: 0}
    priority: true
    kitting_task:
      agv_number: 4
      tray_id: 3
      destination: warehouse
      products: [{type: pump, color: green, quadrant: 1}, {type: sensor, color: red, quadrant: 4}]
  - id: 'MMB30H58'
    type: combined
    announcement: {submission_condition: {order_id: 'MMB30H00'}}
    priority: false
    combined_task:
      station: as4
      products: [{type: battery, color: blue, assembled_pose: {xyz: [0.1, 0, 0], rpy: [0, 0, 'pi/2']}}]
challenges:
  - faulty_part: {order_id: 'MMB30H00', quadrant1: true}
  - human: {behavior: antagonistic, time_condition: 10.0}
"""


def test_orders_of_2024_have_one_task_that_is_handed_in_by_their_id(tmp_path: Path) -> None:
    kit, combined = read(tmp_path, TRIAL_2024).orders
    (task,) = kit.tasks

    assert (kit.id, kit.priority, kit.announced_s, task.id, task.kind) == (
        "MMB30H00",
        3,
        None,
        "MMB30H00",
        "kitting",
    )
    assert (task.agv, task.station, task.tray) == ("agv4", "warehouse", Tray("kit_tray_03"))
    assert [(p.slot, p.type, p.quadrant, p.challenged) for p in task.products] == [
        ("part_0", "pump_green", 1, True),
        ("part_1", "sensor_red", 4, False),
    ]
    (task,) = combined.tasks
    assert (combined.priority, task.kind, task.station, task.agv) == (1, "combined", "as4", "any")
    assert task.products[0].pose == Pose.from_rpy((0.1, 0.0, 0.0), (0.0, 0.0, math.pi / 2))
    assert task.products[0].challenged is None


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ("type: pump", "type: gear", "'gear' is no type"),
        ("color: green", "color: gren", "'gren' is no color"),
        ("quadrant: 4", "quadrant: 5", "5 is no quadrant"),
        ("quadrant: 1}", "quadrant: true}", "True is no quadrant"),
        ("agv_number: 4", "agv_number: [4]", "[4] is no agv_number"),
        ("tray_id: 3", "tray_id: -3", "-3 is no tray id"),
        ("station: as4", "station: as5", "'as5' is no station"),
        ("destination: warehouse", "destination: moon", "'moon' is no destination"),
        ("type: combined", "type: asembly", "'asembly' is no type"),
        ("combined_task:", "assembly_task:", "key 'combined_task' is missing"),
        ("priority: true", "priority: 3", "3 is not true or false"),
        ("id: 'MMB30H58'", "id: 'MMB30H00'", "order 'MMB30H00' is given twice"),
        ("id: 'MMB30H58'", "id: 'MMB 30H58'", "'MMB 30H58' is no order id"),
        ("{time_condition: 0}", "{time_condition: -1}", "-1 s is before the start"),
        ("{time_condition: 0}", "{tme_condition: 0}", "'tme_condition' is no condition"),
        ("order_id: 'MMB30H00', quad", "order_id: 'OTHER', quad", "'OTHER' is no order_id"),
        ("faulty_part:", "faulty_parts:", "'faulty_parts' is no challenge"),
        ("quadrant1: true", "quadrant1: 1", "1 is not true or false"),
        ("'pi/2'", "'p1/2'", "'p1/2' names 'p1'"),
    ],
)
def test_a_mistake_in_a_trial_of_2024_is_refused(tmp_path: Path, old: str, new: str, cause: str) -> None:
    assert old in TRIAL_2024
    assert cause in str(refusal(tmp_path, TRIAL_2024.replace(old, new, 1)))


def test_a_rotation_that_is_none_is_named_and_changes_no_order(tmp_path: Path) -> None:
    parts = "parts: {agvs: {agv1: {parts: [{type: pump, color: red, quadrant: 1, rotation: 'p1/2'}]}}}\n"
    right, wrong = read(tmp_path, TRIAL_2024), read(tmp_path, TRIAL_2024 + parts)

    assert right.orders == wrong.orders
    assert [d.message.partition(" (")[0] for d in wrong.log_defects] == [
        "'p1/2' names 'p1'; only pi is known"
    ]


def test_the_sensors_of_2024_are_static_ones_and_active_robot_cameras(tmp_path: Path) -> None:
    path = tmp_path / "sensors.yaml"
    path.write_text(
        "robot_cameras:\n  floor_robot_camera: {active: true, type: rgb}\n"
        "  ceiling_robot_camera: {active: false, type: rgbd}\nstatic_sensors: {beam: {type: break_beam}}\n",
        encoding="utf-8",
    )
    team = TEAMS.read(path, WANTED).team

    assert TEAMS.can_read(path)
    assert team is not None
    assert dict(team.sensors) == {"beam": "break_beam", "floor_robot_camera": "robot_rgb_camera"}


# Shapes


def test_shipments_of_2020_are_numbered_and_sent_to_their_agv(tmp_path: Path) -> None:
    trial = read(tmp_path, TRIAL_2020)

    first = trial.orders[0]
    assert trial.id == "final_1"
    assert [(task.id, task.agv, task.kind, task.station, task.tray) for task in first.tasks] == [
        ("order_0_shipment_0", "agv2", "kitting", "", None),
        ("order_0_shipment_1", "any", "kitting", "", None),
    ]
    pose = first.tasks[0].products[0].pose
    assert pose is not None
    assert pose.position_m == (0.1, -0.2, 0.0)
    assert pose.yaw_rad == pytest.approx(math.pi / 2)


def test_an_update_stands_beside_its_order_with_its_own_products(tmp_path: Path) -> None:
    orders = read(tmp_path, TRIAL_2020).orders

    assert [(order.id, order.updates) for order in orders] == [
        ("order_0", ""),
        ("order_0_update_0", "order_0"),
        ("order_1", ""),
    ]
    assert orders[1].tasks[0].agv == "any"
    assert orders[1].tasks[0].products[0].type == "piston_rod_part_red"


def test_orders_after_the_first_of_2020_have_high_priority(tmp_path: Path) -> None:
    orders: tuple[Order, ...] = read(tmp_path, TRIAL_2020).orders

    assert (orders[0].priority, orders[2].priority) == (1, 3)


def test_tasks_of_2022_have_kind_agv_station_and_tray(tmp_path: Path) -> None:
    (order,) = read(tmp_path, TRIAL_2022).orders

    assert order.priority == 3
    assert [(t.id, t.kind, t.agv, t.station, t.tray and t.tray.type) for t in order.tasks] == [
        ("order_0_kitting_shipment_0", "kitting", "agv3", "as4", "movable_tray_dark_wood"),
        ("order_0_assembly_shipment_0", "assembly", "any", "as1", None),
        ("order_0_assembly_shipment_1", "assembly", "any", "as2", None),
    ]


def test_orders_of_2021_without_a_priority_are_regular(tmp_path: Path) -> None:
    block = f"kitting: {{shipment_count: 1, {PRODUCTS}}}"

    orders = read(tmp_path, f"orders:\n  order_0: {{{block}}}\n  order_1: {{{block}}}\n").orders

    assert [order.priority for order in orders] == [1, 1]


def test_kits_of_2017_are_tasks(tmp_path: Path) -> None:
    (order,) = read(tmp_path, "orders: {order_0: {kit_count: 2, parts: {part_0: {type: gasket}}}}").orders

    assert [task.id for task in order.tasks] == ["order_0_kit_0", "order_0_kit_1"]
    assert order.tasks[0].products[0].pose is None


def test_half_a_pose_is_completed_with_zeros(tmp_path: Path) -> None:
    (order,) = read(
        tmp_path, "orders: {order_0: {products: {part_0: {type: x, pose: {rpy: [0, 'pi', 0]}}}}}"
    ).orders

    pose = order.tasks[0].products[0].pose
    assert pose is not None
    assert pose.position_m == (0.0, 0.0, 0.0)


# Arithmetic


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("pi", math.pi),
        ("-pi/2", -math.pi / 2),
        (" 3*pi/4 ", 3 * math.pi / 4),
        ("2*(pi - 1) + .5", 2 * (math.pi - 1) + 0.5),
        ("-+-1e-3", 0.001),
        ("1.5", 1.5),
    ],
)
def test_arithmetic_with_pi_has_its_value(text: str, value: float) -> None:
    assert arithmetic(text) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "p1/2",
        "pi/",
        "PI",
        "2pi",
        "1if 2 else 3",
        "pi//2",
        "2**9",
        "1e999",
        "1/0",
        "pi.real",
        "abs(1)",
        "__import__('os')",
        "[1]",
        "True",
        "'1'",
        "1j",
        "nan",
        "1 < 2",
        "lambda: 1",
        "0x10",
        "1+" * 60 + "1",
        "\0",
        "(" * 90,
    ],
)
def test_anything_else_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"is not a number|only pi|no finite value|longer than"):
        arithmetic(text)


def test_the_typing_error_of_an_official_file_is_named_with_its_place(tmp_path: Path) -> None:
    error = refusal(tmp_path, TRIAL_2022.replace("'pi/2'", "'p1/2'"))

    assert "'p1/2' names 'p1'; only pi is known" in error.cause
    assert error.place.startswith("line 9, $.orders.order_0.kitting.products.part_0.pose.rpy[2]")


# Wrong shapes


@pytest.mark.parametrize(
    ("old", "new", "cause", "place"),
    [
        (TRIAL_2022, "orders: 3", "3 is not a map", "$.orders"),
        (TRIAL_2022, "orders:\n", "nothing is given", "$.orders"),
        (TRIAL_2022, "orders: {order_0: [1]}", "[1] is not a map", "$.orders.order_0"),
        (TRIAL_2022, "[orders]", "is not a map", "$"),
        (TRIAL_2022, "", "the file is empty", "$"),
        ("type: gear_part_red, ", "", "key 'type' is missing", "kitting.products.part_0"),
        ("type: gear_part_red", "type: ''", "an empty name", "part_0.type"),
        ("type: gear_part_red", "type: 7", "7 is not text", "part_0.type"),
        ("shipment_count: 1", "shipment_count: -1", "-1 shipments", "kitting.shipment_count"),
        ("shipment_count: 1", "shipment_count: 10000000", "10000000 shipments", "kitting.shipment_count"),
        ("shipment_count: 1", "shipment_count: true", "True is not a whole number", "shipment_count"),
        ("shipment_count: 1", "shipment_count: 1.5", "1.5 is not a whole number", "shipment_count"),
        ("shipment_count: 1\n", "\n", "key 'shipment_count' is missing", "kitting"),
        ("agvs: [agv3]", "agvs: [agv3, agv4]", "2 names are given for 1 shipments", "kitting.agvs"),
        ("stations: [as1, as2]", "stations: [as1]", "1 names are given for 2", "assembly.stations"),
        ("agvs: [agv3]", "agvs: agv3", "'agv3' is not a list", "kitting.agvs"),
        ("xyz: [0.1, -0.2, 0]", "xyz: [0.1, -0.2]", "2 numbers are given, not 3", "pose.xyz"),
        ("xyz: [0.1, -0.2, 0]", "xyz: [0.1, .nan, 0]", "nan is not a finite number", "pose.xyz[1]"),
        ("xyz: [0.1, -0.2, 0]", "xyz: [0.1, null, 0]", "None is not a finite number", "pose.xyz[1]"),
        ("xyz: [0.1, -0.2, 0]", "xyz: far", "'far' is not a list", "pose.xyz"),
        ("priority: 3", "priority: high", "'high' is not a priority", "order_0.priority"),
        ("priority: 3", "priority: 0", "0 is not a priority", "order_0.priority"),
        ("products:", "product:", "key 'products' is missing", "kitting"),
    ],
)
def test_a_wrong_shape_is_refused_with_its_place(
    tmp_path: Path, old: str, new: str, cause: str, place: str
) -> None:
    error = refusal(tmp_path, TRIAL_2022.replace(old, new, 1))

    assert cause in error.cause
    assert place in error.place


def test_an_update_of_no_order_is_refused(tmp_path: Path) -> None:
    error = refusal(tmp_path, f"orders: {{order_7_update_0: {{{PRODUCTS}}}}}")

    assert "it updates 'order_7', which is not ordered" in error.cause


def test_malformed_yaml_is_refused_and_described_as_damage(tmp_path: Path) -> None:
    refusal(tmp_path, "orders: {order_0: [")

    assert "malformed YAML" in TRIALS.describe(tmp_path / "final_1.yaml").damage


@pytest.mark.parametrize(
    ("text", "trial", "team"),
    [
        ("orders: {}\n", True, False),
        ("# note\n'sensors' : {}\n", False, True),
        ("orders: {}\nsensors: {}\n", True, False),
        ("other:\n  orders: {}\n", False, False),
        ("", False, False),
        ("orders: {broken\n", True, False),
    ],
)
def test_files_are_told_apart_by_their_top_level_keys(
    tmp_path: Path, text: str, trial: bool, team: bool
) -> None:
    path = tmp_path / "a.yml"
    path.write_text(text, encoding="utf-8")
    other = tmp_path / "a.txt"
    other.write_text(text, encoding="utf-8")

    assert (TRIALS.can_read(path), TEAMS.can_read(path)) == (trial, team)
    assert not TRIALS.can_read(other)
    assert not TRIALS.can_read(tmp_path)


# Sensors


def team_of(folder: Path, text: str) -> dict[str, str]:
    path = folder / "team.yaml"
    path.write_text(text, encoding="utf-8")
    team = TEAMS.read(path, WANTED).team
    assert team is not None
    return dict(team.sensors)


def test_sensors_are_known_by_name_and_type(tmp_path: Path) -> None:
    text = "sensors: {b: {type: break_beam, pose: {}}, a: {type: logical_camera}}"

    assert team_of(tmp_path, text) == {"a": "logical_camera", "b": "break_beam"}


def test_a_team_may_do_without_sensors(tmp_path: Path) -> None:
    assert team_of(tmp_path, "sensors:\n") == {}


def test_only_a_robot_camera_that_is_switched_on_is_a_sensor(tmp_path: Path) -> None:
    text = "sensors: {}\ngantry_bin_camera: {enable: true}\ngantry_tray_camera: {enable: false}\n"

    assert team_of(tmp_path, text) == {"gantry_bin_camera": "gantry_bin_camera"}


@pytest.mark.parametrize(
    "text", ["sensors: [a]", "sensors: {a: }", "sensors: {a: {pose: {}}}", "sensors: {a: {type: 3}}", "[]"]
)
def test_sensors_of_a_wrong_shape_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(DataFileError) as caught:
        team_of(tmp_path, text)

    assert caught.value.hint
