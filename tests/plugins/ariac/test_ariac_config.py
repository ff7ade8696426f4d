"""The reader of trial configurations with orders, against official files and hand-written ones."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score.checks.contracts import Reader, Wanted
from ariac_score.errors import DataFileError
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import LogDefect, Pose, Trial
from ariac_score_ariac.config.ariac_config import TrialConfigReader
from ariac_score_ariac.config.config_values import arithmetic
from ariac_score_ariac.work import Order, Tray

ARIAC = Path(__file__).parents[3].parent / "shared" / "ariac" / "data"
CONFIG = ARIAC / "config"
needs_official_files = pytest.mark.skipif(not CONFIG.is_dir(), reason="the official files are not here")

TRIALS = TrialConfigReader()
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


def test_is_a_reader() -> None:
    assert isinstance(TRIALS, Reader)


# The official files


@needs_official_files
def test_the_official_trial_of_2022_is_read_exactly() -> None:
    (order,) = TRIALS.read(ARIAC / "nist_team_2022/config/trial_kitting.yaml", WANTED).work
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
def test_a_trial_of_2020_found_in_the_wild_is_read_exactly() -> None:
    orders = TRIALS.read(ARIAC / "found/sandeep_kota_group1_2020_trial.yaml", WANTED).work

    # Its printed score gives order_1 priority 3.
    assert [(order.id, order.priority) for order in orders] == [("order_0", 1), ("order_1", 3)]
    assert [(task.id, task.agv) for task in orders[0].tasks] == [("order_0_shipment_0", "agv2")]
    assert [product.type for product in orders[0].tasks[0].products] == [
        "pulley_part_red",
        "disk_part_blue",
        "disk_part_green",
    ]


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
    kit, combined = read(tmp_path, TRIAL_2024).work
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

    assert right.work == wrong.work
    assert [d.message.partition(" (")[0] for d in wrong.log_defects] == [
        "'p1/2' names 'p1'; only pi is known"
    ]


# Shapes


def test_shipments_of_2020_are_numbered_and_sent_to_their_agv(tmp_path: Path) -> None:
    trial = read(tmp_path, TRIAL_2020)

    first = trial.work[0]
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
    orders = read(tmp_path, TRIAL_2020).work

    assert [(order.id, order.updates) for order in orders] == [
        ("order_0", ""),
        ("order_0_update_0", "order_0"),
        ("order_1", ""),
    ]
    assert orders[1].tasks[0].agv == "any"
    assert orders[1].tasks[0].products[0].type == "piston_rod_part_red"


def test_orders_after_the_first_of_2020_have_high_priority(tmp_path: Path) -> None:
    orders: tuple[Order, ...] = read(tmp_path, TRIAL_2020).work

    assert (orders[0].priority, orders[2].priority) == (1, 3)


def test_tasks_of_2022_have_kind_agv_station_and_tray(tmp_path: Path) -> None:
    (order,) = read(tmp_path, TRIAL_2022).work

    assert order.priority == 3
    assert [(t.id, t.kind, t.agv, t.station, t.tray and t.tray.type) for t in order.tasks] == [
        ("order_0_kitting_shipment_0", "kitting", "agv3", "as4", "movable_tray_dark_wood"),
        ("order_0_assembly_shipment_0", "assembly", "any", "as1", None),
        ("order_0_assembly_shipment_1", "assembly", "any", "as2", None),
    ]


def test_orders_of_2021_without_a_priority_are_regular(tmp_path: Path) -> None:
    block = f"kitting: {{shipment_count: 1, {PRODUCTS}}}"

    orders = read(tmp_path, f"orders:\n  order_0: {{{block}}}\n  order_1: {{{block}}}\n").work

    assert [order.priority for order in orders] == [1, 1]


def test_kits_of_2017_are_tasks(tmp_path: Path) -> None:
    (order,) = read(tmp_path, "orders: {order_0: {kit_count: 2, parts: {part_0: {type: gasket}}}}").work

    assert [task.id for task in order.tasks] == ["order_0_kit_0", "order_0_kit_1"]
    assert order.tasks[0].products[0].pose is None


def test_half_a_pose_is_completed_with_zeros(tmp_path: Path) -> None:
    (order,) = read(
        tmp_path, "orders: {order_0: {products: {part_0: {type: x, pose: {rpy: [0, 'pi', 0]}}}}}"
    ).work

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
    ("text", "cause"),
    [
        ("orders: {}", "no order is given"),
        ("orders: []", "no order is given"),
        ("options: {}\ntime_limit: 500", "a trial configuration without orders: there are no orders in it"),
        ("order: {}\nmodels_over_bins: {}", "a trial configuration without orders"),
        (
            "sensors: {a: {type: break_beam}}",
            "a team configuration of 2017 to 2023: there are no orders in it",
        ),
        ("COMPETITOR_NAME: a\nSENSORS: []", "a team configuration of 2025: there are no orders in it"),
        ("orders: {" + ", ".join(f"order_{n}: {{}}" for n in range(1001)) + "}", "1001 orders cannot be"),
    ],
)
def test_a_file_without_orders_is_called_by_what_it_looks_like(tmp_path: Path, text: str, cause: str) -> None:
    assert cause in refusal(tmp_path, text).cause


# Numbers of the trial


@pytest.mark.parametrize(
    ("line", "facts"),
    [
        ("time_limit: 500", {"time_limit_s": 500.0}),
        ("time_limit: 0", {"time_limit_s": 0.0}),
        ("time_limit: -1", {}),
        ("", {}),
    ],
)
@pytest.mark.parametrize("trial", [TRIAL_2020, TRIAL_2022, TRIAL_2024])
def test_the_time_limit_is_a_fact_unless_there_is_none(
    tmp_path: Path, trial: str, line: str, facts: dict[str, float]
) -> None:
    assert dict(read(tmp_path, f"{line}\n{trial}").facts) == facts


@pytest.mark.parametrize("limit", ["-2", "-0.5", ".nan", ".inf", "soon", "", "true", "[500]", "1e9"])
def test_a_time_limit_that_is_none_is_refused(tmp_path: Path, limit: str) -> None:
    assert "$.time_limit" in refusal(tmp_path, f"time_limit: {limit}\n{TRIAL_2022}").place


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ("value: 0.0", "value: -0.1", "-0.1 s is before the start"),
        ("value: 0.0", "value: .nan", "nan is not a finite number"),
        (
            "condition: time\n    announcement_condition_value: 0.0",
            "condition: wanted_products\n    announcement_condition_value: -1",
            "-1 products cannot be waited for",
        ),
        ("xyz: [0.1, -0.2, 0]", "xyz: [1.0e+200, 0, 0]", "a pose must be finite, and near enough"),
    ],
)
def test_times_and_poses_that_cannot_be_are_refused(tmp_path: Path, old: str, new: str, cause: str) -> None:
    assert old in TRIAL_2020
    assert cause in refusal(tmp_path, TRIAL_2020.replace(old, new, 1)).cause


# Mistakes that leave every order readable


def mistakes(folder: Path, text: str) -> tuple[LogDefect, ...]:
    return read(folder, text).log_defects


def test_an_unknown_product_type_is_named_with_the_nearest_known_one(tmp_path: Path) -> None:
    trial = read(tmp_path, TRIAL_2022.replace("gear_part_red", "gear_prt_red", 1))
    (mistake,) = trial.log_defects

    assert trial.work[0].tasks[0].products[0].type == "gear_prt_red"
    assert (mistake.kind, mistake.where, mistake.count) == ("unknown_product_type", "final_1.yaml", 1)
    assert "'gear_prt_red' is no product type of 2017 to 2022 (line 9, $." in mistake.message
    assert mistake.message.endswith("did you mean 'gear_part_red'?")


def test_a_misspelt_alias_is_named_with_the_alias(tmp_path: Path) -> None:
    (mistake,) = mistakes(tmp_path, TRIAL_2020.replace("type: order_part1", "type: order_prt1"))

    assert mistake.message.endswith("did you mean 'order_part1'?")


def test_an_alias_of_an_unknown_type_is_named(tmp_path: Path) -> None:
    (mistake,) = mistakes(tmp_path, TRIAL_2020.replace("piston_rod_part_red", "piston_red"))

    assert "'piston_red', which 'order_part1' stands for, is no product type" in mistake.message


def test_an_ignored_key_of_a_pose_is_named(tmp_path: Path) -> None:
    trial = read(tmp_path, TRIAL_2022.replace("rpy: [0, 0, 'pi/2']", "rpyy: [0, 0, 'pi/2']", 1))

    assert trial.work[0].tasks[0].products[0].pose == Pose((0.1, -0.2, 0.0))
    assert [d.kind for d in trial.log_defects] == ["ignored_key"]
    assert "did you mean 'rpy'?" in trial.log_defects[0].message


def test_an_unknown_announcement_condition_is_named(tmp_path: Path) -> None:
    (mistake,) = mistakes(tmp_path, TRIAL_2020.replace("condition: time", "condition: timr"))

    assert "'timr' is no announcement condition" in mistake.message
    assert "did you mean 'time'?" in mistake.message


def test_a_time_limit_below_the_options_does_not_count(tmp_path: Path) -> None:
    trial = read(tmp_path, TRIAL_2020.replace("options:", "options:\n  time_limit: 300", 1))

    assert dict(trial.facts) == {}
    assert [d.kind for d in trial.log_defects] == ["ignored_key"]


def test_a_number_that_is_none_is_named_where_no_order_depends_on_it(tmp_path: Path) -> None:
    text = TRIAL_2020 + "belt_models: {gear_part_red: {1.0: {pose: {rpy: [0, 0, 'p1/2']}}}}\n"

    assert ["'p1/2' names 'p1'" in d.message for d in mistakes(tmp_path, text)] == [True]


@pytest.mark.parametrize(
    "text",
    [
        "models_over_bins: {bin1: 1, bin1: 2}",
        "models_over_bins: {}\nmodels_over_bins: {}",
        "belt_models:\n  gear_part_red: {1.0: {}, 1.0: {}}",
    ],
)
def test_a_key_given_twice_in_the_surroundings_is_named(tmp_path: Path, text: str) -> None:
    (mistake,) = mistakes(tmp_path, TRIAL_2020 + text)

    assert mistake.kind == "repeated_key"
    assert "is given twice, first in line" in mistake.message


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("    shipment_count: 2\n", "    shipment_count: 2\n    shipment_count: 3\n"),
        ("type: gear_part_red,", "type: gear_part_red, type: gear_part_red,"),
        ("  order_1:\n", "  order_0:\n"),
        ("orders:\n", "orders: {}\norders:\n"),
        ("{order_part1: piston_rod_part_red}", "{order_part1: gear_part, order_part1: pulley_part}"),
        ("orders:\n", "options: {}\norders:\n"),
        ("orders:\n", "time_limit: 1\ntime_limit: 1\norders:\n"),
    ],
)
def test_a_key_given_twice_in_what_is_scored_is_refused(tmp_path: Path, old: str, new: str) -> None:
    assert old in TRIAL_2020
    assert "is given twice" in refusal(tmp_path, TRIAL_2020.replace(old, new, 1)).cause


def test_of_many_mistakes_the_first_are_named_and_the_rest_counted(tmp_path: Path) -> None:
    products = ", ".join(f"part_{n}: {{type: thing}}" for n in range(50))

    found = mistakes(tmp_path, f"orders: {{order_0: {{products: {{{products}}}}}}}")

    assert sum(d.count for d in found) == 50
    assert len(found) == 21


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("orders: {1: {products: {}}, '1': {products: {}}}", "order '1' is given twice"),
        ("orders: {a: {products: {1: {type: x}, '1': {type: x}}}}", "slot '1' is given twice"),
        (
            "orders: {a: &o {shipment_count: 400, products: {}}, b: *o, c: *o}",
            "1200 shipments cannot be ordered",
        ),
        (
            "orders: {a: {products: {" + ", ".join(f"p{n}: {{type: x}}" for n in range(1001)) + "}}}",
            "1001 products cannot be wanted",
        ),
    ],
)
def test_names_that_become_one_and_absurd_sums_are_refused(tmp_path: Path, text: str, cause: str) -> None:
    assert cause in refusal(tmp_path, text).cause


# Whatever stands where

ODD: tuple[Any, ...] = (
    None,
    True,
    -1,
    3.5,
    float("nan"),
    10**19,
    1e300,
    "",
    "p1/2",
    [],
    {},
    [None],
    {1: 2},
    {"a": []},
)


def places(tree: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of every value below the root."""
    inner = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in inner:
        yield (*path, key)
        yield from places(value, (*path, key))


def replaced(tree: Any, path: tuple[Any, ...], value: Any) -> Any:
    whole = copy.deepcopy(tree)
    inner = whole
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return whole


@pytest.mark.parametrize("text", [TRIAL_2020, TRIAL_2022, TRIAL_2024], ids=["2020", "2022", "2024"])
def test_an_odd_value_anywhere_is_read_or_refused_with_a_hint(tmp_path: Path, text: str) -> None:
    tree = yaml.safe_load(text)
    refused = []
    for number, path in enumerate(places(tree)):
        odd = replaced(tree, path, ODD[number % len(ODD)])
        try:
            assert read(tmp_path, yaml.safe_dump(odd)).work
        except DataFileError as error:
            refused.append(error)

    assert refused
    assert all(error.hint and error.file and error.place for error in refused)
