"""What messages of competitions mean."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace as Fields
from typing import Any

import pytest
import yaml

from ariac_score.checks.contracts import Decoder, Wanted
from ariac_score.trial.channels import LogMap
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Pose
from ariac_score_ariac.config.ariac_config import TrialConfigReader
from ariac_score_ariac.config.config_values import arithmetic
from ariac_score_ariac.messages import (
    AriacMsgs2023,
    NistGear2020,
    NistGear2021,
    NistGear2022,
    OsrfGear2018,
)
from ariac_score_ariac.recorder_messages import AriacScoreRecords
from ariac_score_ariac.work import Kit, KitSubmission, Order, Product, Task, Tray, WantedProduct

GEAR, RECORDS, MSGS = NistGear2020(), AriacScoreRecords(), AriacMsgs2023()
GEAR_2018, GEAR_2021, GEAR_2022 = OsrfGear2018(), NistGear2021(), NistGear2022()
STRING = "std_msgs/msg/String"


def pose(x: float = 0.1, w: float = 1.0) -> Fields:
    return Fields(position=Fields(x=x, y=0.2, z=0.3), orientation=Fields(x=0.0, y=0.0, z=0.0, w=w))


def order(name: str, agv: str = "agv1", **of_pose: float) -> Fields:
    products = [
        Fields(type="gear_part_red", pose=pose(**of_pose)),
        Fields(type="gasket_part_blue", pose=pose()),
    ]
    return Fields(
        order_id=name, shipments=[Fields(shipment_type=f"{name}_shipment_0", agv_id=agv, products=products)]
    )


def submission(**of_pose: float) -> Fields:
    product = Fields(type="gear_part_red", name="gear_7", is_faulty=True, pose=pose(**of_pose))
    return Fields(shipment_type="order_0_shipment_0", agv="agv1", station="as2", products=[product])


@pytest.mark.parametrize("decoder", [GEAR, RECORDS, MSGS, GEAR_2018, GEAR_2021, GEAR_2022])
def test_is_a_decoder(decoder: object) -> None:
    assert isinstance(decoder, Decoder)


def test_an_order_becomes_kitting_tasks_with_numbered_slots() -> None:
    wanted = Pose((0.1, 0.2, 0.3), (1.0, 0.0, 0.0, 0.0))
    products = (
        WantedProduct("part_0", "gear_part_red", wanted),
        WantedProduct("part_1", "gasket_part_blue", wanted),
    )

    found = GEAR.decode("nist_gear/msg/Order", order("order_0"), 7.5)

    assert found == Order(
        "order_0", (Task("order_0_shipment_0", "kitting", products, agv="agv1"),), announced_s=7.5
    )


def test_an_update_names_the_order_it_replaces() -> None:
    found = GEAR.decode("nist_gear/msg/Order", order("order_1_update_0"), 0.0)

    assert isinstance(found, Order)
    assert (found.id, found.updates) == ("order_1_update_0", "order_1")


@pytest.mark.parametrize(
    ("state", "event"),
    [
        ("go", Event(3.0, COMPETITION_STARTED)),
        ("end_game", Event(3.0, COMPETITION_ENDED)),
        ("done", Event(3.0, COMPETITION_ENDED)),  # `end_game` before it lasts 1 ms
        ("ready", None),
        ("init", None),
    ],
)
def test_the_competition_starts_with_go_and_ends_with_end_game_or_done(
    state: str, event: Event | None
) -> None:
    assert GEAR.decode(STRING, Fields(data=state), 3.0) == event


@pytest.mark.parametrize("state", ["GO", "", "started"])
def test_a_word_that_is_no_state_is_named_with_those_that_are(state: str) -> None:
    with pytest.raises(ValueError, match=f"'{state}' is no state: init, ready, go, end_game, done"):
        GEAR.decode(STRING, Fields(data=state), 3.0)


def test_messages_of_other_types_mean_nothing() -> None:
    assert GEAR.decode("std_msgs/msg/Bool", Fields(data="go"), 0.0) is None
    assert RECORDS.decode(STRING, Fields(data="go"), 0.0) is None


@pytest.mark.parametrize("broken", [{"x": math.nan}, {"x": math.inf}, {"w": 0.0}])
def test_an_order_with_an_impossible_pose_is_refused(broken: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"finite|orientation"):
        GEAR.decode("nist_gear/msg/Order", order("order_0", **broken), 0.0)


@pytest.mark.parametrize("broken", [{"x": math.nan}, {"x": math.inf}, {"w": 0.0}])
def test_a_submitted_product_with_an_impossible_pose_stays_without_it(broken: dict[str, float]) -> None:
    found = RECORDS.decode("ariac_score_msgs/msg/Submission", submission(**broken), 1.0)

    assert isinstance(found, KitSubmission)
    assert found.contents == (Product("gear_part_red", None, faulty=True, name="gear_7"),)


def test_a_submission_tells_what_came_where_and_when() -> None:
    found = RECORDS.decode("ariac_score_msgs/msg/Submission", submission(), 12.0)

    product = Product("gear_part_red", Pose((0.1, 0.2, 0.3)), faulty=True, name="gear_7")
    assert found == KitSubmission("order_0_shipment_0", 12.0, (product,), agv="agv1", station="as2")


def test_a_trial_event_is_taken_over() -> None:
    message = Fields(kind="arm_collision", subject="gantry", detail="with person_1")

    found = RECORDS.decode("ariac_score_msgs/msg/TrialEvent", message, 4.0)

    assert found == Event(4.0, "arm_collision", "gantry", "with person_1")


def test_a_submission_names_its_tray_or_says_that_there_was_none() -> None:
    def tray(named: str) -> Tray | None:
        message = Fields(**vars(submission()), tray=named, contents_unknown=False)
        found = RECORDS.decode("ariac_score_msgs/msg/Submission", message, 1.0)
        assert isinstance(found, KitSubmission)
        return found.tray

    assert tray("kit_tray_03") == Tray("kit_tray_03")
    assert tray("none") == Tray("")
    assert tray("") is None


def test_a_submission_whose_contents_are_unknown_is_not_one_of_nothing() -> None:
    empty = Fields(shipment_type="s", agv="agv1", station="", products=[], tray="")
    decoded = [
        RECORDS.decode(
            "ariac_score_msgs/msg/Submission", Fields(**vars(empty), contents_unknown=unknown), 1.0
        )
        for unknown in (True, False)
    ]

    assert [item.contents for item in decoded if isinstance(item, KitSubmission)] == [None, ()]


# The AGV of an order


@pytest.mark.parametrize("agv", ["", "any", "agv2", "AGV1"])
def test_the_ordered_agv_is_taken_as_it_is(agv: str) -> None:
    found = GEAR.decode("nist_gear/msg/Order", order("order_0", agv), 0.0)

    assert isinstance(found, Order)
    assert found.tasks[0].agv == agv  # as coded, nothing but `any` leaves it open


def test_a_shipment_of_2018_may_leave_on_any_agv() -> None:
    message = order("order_0")
    del message.shipments[0].agv_id

    found = GEAR_2018.decode("osrf_gear/msg/Order", message, 0.0)

    assert isinstance(found, Order)
    assert found.tasks[0].agv == "any"


def test_the_package_of_2019_has_the_messages_of_2020() -> None:
    assert GEAR.decode("osrf_gear/msg/Order", order("o"), 1.0) == GEAR.decode(
        "nist_gear/msg/Order", order("o"), 1.0
    )


# Orders of messages against orders of the configuration they were made from


def _quaternion(rpy: list[Any]) -> Fields:
    """Turns about z, y and x multiplied out one after the other."""
    q = (1.0, 0.0, 0.0, 0.0)
    for axis in (2, 1, 0):
        half = _number(rpy[axis]) / 2
        turn = [math.cos(half), 0.0, 0.0, 0.0]
        turn[axis + 1] = math.sin(half)
        (a, b, c, d), (e, f, g, h) = q, turn
        q = (
            a * e - b * f - c * g - d * h,
            a * f + b * e + c * h - d * g,
            a * g - b * h + c * e + d * f,
            a * h + b * g - c * f + d * e,
        )
    return Fields(w=q[0], x=q[1], y=q[2], z=q[3])


def _number(value: Any) -> float:
    return arithmetic(value) if isinstance(value, str) else float(value)


def _pose_message(given: dict[str, Any]) -> Fields:
    x, y, z = map(_number, given.get("xyz", [0, 0, 0]))
    return Fields(position=Fields(x=x, y=y, z=z), orientation=_quaternion(given.get("rpy", [0, 0, 0])))


PART_TYPES = {"battery": 10, "pump": 11, "sensor": 12, "regulator": 13}
PART_COLORS = {"red": 0, "green": 1, "blue": 2, "orange": 3, "purple": 4}
PLACES = {"kitting": 0, "assembly_front": 1, "assembly_back": 2, "warehouse": 3}
STATIONS = {"as1": 1, "as2": 2, "as3": 3, "as4": 4}


def _part_message(product: dict[str, Any]) -> Fields:
    return Fields(color=PART_COLORS[product["color"]], type=PART_TYPES[product["type"]])


def _ariac_msgs_order(given: dict[str, Any]) -> Fields:
    """An order of 2023 or 2024 as the trial manager publishes it."""
    nothing = Fields(agv_number=0, tray_id=0, destination=0, parts=[], station=0)
    message = Fields(
        id=given["id"],
        type=["kitting", "assembly", "combined"].index(given["type"]),
        priority=given.get("priority", False),
        kitting_task=nothing,
        assembly_task=nothing,
        combined_task=nothing,
    )
    task = given[f"{given['type']}_task"]
    if given["type"] == "kitting":
        parts = [Fields(part=_part_message(p), quadrant=p["quadrant"]) for p in task["products"]]
        message.kitting_task = Fields(
            agv_number=task["agv_number"],
            tray_id=task["tray_id"],
            destination=PLACES[task["destination"]],
            parts=parts,
        )
    else:
        parts = [
            Fields(part=_part_message(p), assembled_pose=Fields(pose=_pose_message(p["assembled_pose"])))
            for p in task["products"]
        ]
        setattr(message, f"{given['type']}_task", Fields(station=STATIONS[task["station"]], parts=parts))
    return message


def _gear_order(order_id: str, given: dict[str, Any], *, names: dict[str, str]) -> Fields:
    """An order of 2021 or 2022; `names` are the fields of AGV and station in a kitting shipment."""
    kits, assemblies = [], []
    block = given.get("kitting")
    for k in range(block["shipment_count"] if block else 0):
        shipment = Fields(
            shipment_type=f"{order_id}_kitting_shipment_{k}", products=_product_messages(block["products"])
        )
        setattr(shipment, names["agv"], block["agvs"][k])
        setattr(shipment, names["station"], block["destinations"][k])
        if "trays" in block:
            zero = Fields(position=Fields(x=0, y=0, z=0), orientation=Fields(w=0, x=0, y=0, z=0))
            shipment.movable_tray = Fields(movable_tray_type=block["trays"][k], pose=zero)
        kits.append(shipment)
    block = given.get("assembly")
    for k in range(block["shipment_count"] if block else 0):
        assemblies.append(
            Fields(
                shipment_type=f"{order_id}_assembly_shipment_{k}",
                station_id=block["stations"][k],
                products=_product_messages(block["products"]),
            )
        )
    return Fields(order_id=order_id, kitting_shipments=kits, assembly_shipments=assemblies)


def _product_messages(products: dict[str, Any]) -> list[Fields]:
    return [Fields(type=p["type"], pose=_pose_message(p["pose"])) for p in products.values()]


def _comparable(order: Order) -> Order:
    """Without what a message cannot say, and without the last bits of poses."""

    def pose(of: Pose | None) -> Pose | None:
        if of is None:
            return None
        at, turn = ([round(v, 12) + 0.0 for v in values] for values in (of.position_m, of.orientation_wxyz))
        return Pose((at[0], at[1], at[2]), (turn[0], turn[1], turn[2], turn[3]))

    def wanted(i: int, product: WantedProduct) -> WantedProduct:
        # The official files count slots from 0 or from 1; a list in a message has no names.
        return replace(product, slot=f"part_{i}", pose=pose(product.pose), challenged=None)

    tasks = tuple(
        replace(task, products=tuple(wanted(i, p) for i, p in enumerate(task.products)))
        for task in order.tasks
    )
    return replace(order, tasks=tasks, announced_s=None)


def _files(shared: Path, year: str) -> Iterator[tuple[Path, dict[str, Any]]]:
    for path in sorted((shared / "ariac/data/config" / year).rglob("*.yaml")):
        if TrialConfigReader().can_read(path):
            yield path, yaml.safe_load(path.read_text(encoding="utf-8"))


def _from_configuration(path: Path) -> list[Order]:
    return [_comparable(o) for o in TrialConfigReader().read(path, Wanted(LogMap("none"))).work]


@pytest.mark.parametrize("year", ["2023", "2024"])
def test_an_order_of_a_message_is_that_of_the_trial_file_it_was_published_from(
    shared: Path, year: str
) -> None:
    compared = 0
    for path, trial in _files(shared, year):
        decoded = [MSGS.decode("ariac_msgs/msg/Order", _ariac_msgs_order(o), 3.0) for o in trial["orders"]]
        assert [_comparable(o) for o in decoded if isinstance(o, Order)] == _from_configuration(path), path
        compared += len(decoded)
    assert compared > 5


@pytest.mark.parametrize(
    ("year", "decoder", "msgtype", "names"),
    [
        ("2021", GEAR_2021, "nist_gear/msg/Order", {"agv": "agv_id", "station": "station_id"}),
        ("2022", GEAR_2022, "nist_gear/msg/Orders", {"agv": "agv", "station": "assembly_station"}),
    ],
)
def test_an_order_of_2021_and_2022_is_that_of_its_trial_file_but_for_the_priority(
    shared: Path, year: str, decoder: Decoder, msgtype: str, names: dict[str, str]
) -> None:
    compared = 0
    for path, trial in _files(shared, year):
        expected = _from_configuration(path)
        decoded = [
            decoder.decode(msgtype, _gear_order(name, given, names=names), 3.0)
            for name, given in trial["orders"].items()
        ]
        orders = [o for o in decoded if isinstance(o, Order)]
        assert [_comparable(o) for o in orders] == [replace(o, priority=1) for o in expected], path
        assert not any(o.priority_said for o in orders)
        compared += len(decoded)
    assert compared > 20


# ariac_msgs


def kit_order(**changed: Any) -> Fields:
    part = Fields(part=Fields(color=2, type=10), quadrant=3)
    task = Fields(agv_number=2, tray_id=3, destination=3, parts=[part])
    message = Fields(id="ABCD1234", type=0, priority=True, kitting_task=task)
    for path, value in changed.items():
        *owners, name = path.split("__")
        target = message
        for owner in owners:
            target = target.parts[0] if owner == "part" else getattr(target, owner)
        setattr(target, name, value)
    return message


def test_a_kitting_order_of_2023_is_handed_in_under_its_id() -> None:
    # Worked by hand from the constants of ariac_msgs: blue 2, battery 10, warehouse 3.
    wanted = WantedProduct("part_0", "battery_blue", None, 3, challenged=None)
    task = Task("ABCD1234", "kitting", (wanted,), "agv2", "warehouse", Tray("kit_tray_03"))

    assert MSGS.decode("ariac_msgs/msg/Order", kit_order(), 4.0) == Order("ABCD1234", (task,), 4.0, 3)


@pytest.mark.parametrize(
    ("changed", "cause"),
    [
        ({"type": 3}, "3 is no kind of order"),
        ({"kitting_task__agv_number": 0}, "0 is no AGV"),
        ({"kitting_task__agv_number": 5}, "5 is no AGV"),
        ({"kitting_task__destination": 4}, "4 is no destination"),
        ({"kitting_task__tray_id": -1}, "-1 is no tray id"),
        ({"kitting_task__part__quadrant": 0}, "0 is no quadrant"),
        ({"kitting_task__part__part": Fields(color=5, type=10)}, "5 is no colour"),
        ({"kitting_task__part__part": Fields(color=0, type=9)}, "9 is no type"),
        ({"kitting_task": Fields()}, "has not the fields of this edition"),
    ],
)
def test_a_number_that_stands_for_nothing_is_refused(changed: dict[str, Any], cause: str) -> None:
    with pytest.raises(ValueError, match=cause):
        MSGS.decode("ariac_msgs/msg/Order", kit_order(**changed), 0.0)


@pytest.mark.parametrize(
    ("state", "event"),
    [
        (0, None),
        (1, None),
        (2, Event(3.0, COMPETITION_STARTED)),
        (3, Event(3.0, COMPETITION_STARTED)),  # all orders are announced; 2 before it may last 1 ms
        (4, Event(3.0, COMPETITION_ENDED)),
        (5, None),
    ],
)
def test_the_competition_of_2023_starts_with_2_or_3_and_ends_with_4(state: int, event: Event | None) -> None:
    assert MSGS.decode("ariac_msgs/msg/CompetitionState", Fields(competition_state=state), 3.0) == event


@pytest.mark.parametrize(
    ("decoder", "msgtype"),
    [
        (GEAR, "nist_gear/msg/Order"),
        (GEAR_2018, "osrf_gear/msg/Order"),
        (GEAR_2021, "nist_gear/msg/Order"),
        (GEAR_2022, "nist_gear/msg/Orders"),
        (GEAR_2022, "nist_gear/msg/TrayContents"),
        (MSGS, "ariac_msgs/msg/Order"),
    ],
)
def test_a_message_of_another_edition_is_unusable_and_no_fault_of_the_decoder(
    decoder: Decoder, msgtype: str
) -> None:
    with pytest.raises(ValueError, match="has not the fields of this edition"):
        decoder.decode(msgtype, Fields(order_id="o", kit_tray="agv1", type=0, id="o", priority=False), 0.0)


def test_orders_of_other_packages_mean_nothing() -> None:
    assert GEAR.decode("my_msgs/msg/Order", order("o"), 0.0) is None
    assert MSGS.decode("nist_gear/msg/Order", order("o"), 0.0) is None


# Contents of trays

DETECTED = Fields(type="gear_part_red", is_faulty=True, pose=pose())
SEEN = Product("gear_part_red", Pose((0.1, 0.2, 0.3)), faulty=True)


@pytest.mark.parametrize(
    ("tray", "place"),
    [
        ("agv1::kit_tray_1::kit_tray_1::tray", "agv1"),
        ("kit_tray_2", "agv2"),
        ("agv3", "agv3"),
    ],
)
@pytest.mark.parametrize("decoder", [GEAR, GEAR_2021])
def test_a_tray_tells_what_lies_on_the_agv_it_belongs_to(decoder: Decoder, tray: str, place: str) -> None:
    found = decoder.decode("nist_gear/msg/TrayContents", Fields(tray=tray, objects=[DETECTED]), 5.0)

    assert found == Kit(place, 5.0, (SEEN,))


@pytest.mark.parametrize("decode", [GEAR.decode, GEAR_2021.decode])
def test_a_tray_without_a_number_is_nobodys(decode: Callable[..., object]) -> None:
    assert decode("nist_gear/msg/TrayContents", Fields(tray="kit_tray", objects=[]), 5.0) is None


def movable(kit_tray: str) -> Fields:
    tray = Fields(
        movable_tray_name="movable_tray_dark_wood_1",
        movable_tray_type="movable_tray_dark_wood",
        movable_tray_pose=pose(),
    )
    return Fields(kit_tray=kit_tray, movable_tray=tray, products=[DETECTED])


def test_a_movable_tray_tells_of_itself_and_what_lies_on_it() -> None:
    found = GEAR_2022.decode("nist_gear/msg/TrayContents", movable("agv4"), 5.0)

    tray = Tray("movable_tray_dark_wood", Pose((0.1, 0.2, 0.3)))
    assert found == Kit("agv4", 5.0, (SEEN,), tray)


def test_a_movable_tray_on_the_table_is_no_kit() -> None:
    assert GEAR_2022.decode("nist_gear/msg/TrayContents", movable(""), 5.0) is None


@pytest.mark.parametrize("decoder", [GEAR_2021, GEAR_2022])
def test_a_briefcase_tells_what_lies_at_its_station(decoder: Decoder) -> None:
    message = Fields(briefcase_id="station2::briefcase_2::briefcase_2::briefcase", products=[DETECTED])

    assert decoder.decode("nist_gear/msg/DetectedAssemblyShipment", message, 5.0) == Kit("as2", 5.0, (SEEN,))
