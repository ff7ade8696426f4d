"""Bags with the competitions' own messages, scored by shipped rule sets, with scores worked by hand."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from ariac_score import NothingToScoreError, Result, score_trial
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.testing import bags
from ariac_score.testing.bags import Recorded, write_bag

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

S = 10**9
START_NS = 1_700_000_000 * S

RED, GREEN, BLUE, PURPLE = 0, 1, 2, 4
BATTERY, PUMP, SENSOR, REGULATOR = 10, 11, 12, 13


def at(t_s: float, topic: str, type_: str, **fields: Any) -> Recorded:
    return Recorded(topic, type_, START_NS + round(t_s * S), fields)


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> dict[str, Any]:
    turn = {"w": math.cos(yaw / 2), "x": 0.0, "y": 0.0, "z": math.sin(yaw / 2)}
    return {"position": {"x": x, "y": y, "z": z}, "orientation": turn}


def product(kind: str, x: float, y: float, z: float = 0.0, *, faulty: bool = False) -> dict[str, Any]:
    return {"type": kind, "name": f"{kind}_1", "is_faulty": faulty, "pose": pose(x, y, z)}


def submission(t_s: float, task_id: str, *products: Mapping[str, Any], **fields: Any) -> Recorded:
    return at(
        t_s,
        "/ariac_score/submissions",
        "ariac_score_msgs/msg/Submission",
        shipment_type=task_id,
        products=list(products),
        **fields,
    )


def watching(kind: str) -> Recorded:
    return happened(0.0, "watching", kind)


def happened(t_s: float, kind: str, subject: str = "") -> Recorded:
    event = {"kind": kind, "subject": subject, "detail": ""}
    return at(t_s, "/ariac_score/events", "ariac_score_msgs/msg/TrialEvent", **event)


def bag(path: Path, *messages: Recorded, storage: bags.Storage = "mcap") -> Path:
    """The messages, with start and end of the competition around them where none of them says."""
    if not any(message.topic.endswith("competition_state") for message in messages):
        last_s = (max(message.t_ns for message in messages) - START_NS) / S
        messages = (*messages, happened(0.0, "competition_started"), happened(last_s, "competition_ended"))
    return write_bag(path, sorted(messages, key=lambda message: message.t_ns), storage=storage)


# 2024


def order(t_s: float, id_: str, kind: int, **fields: Any) -> Recorded:
    return at(t_s, "/ariac/orders", "ariac_msgs/msg/Order", id=id_, type=kind, **fields)


def wanted_in(quadrant: int, kind: int, color: int) -> dict[str, Any]:
    return {"part": {"type": kind, "color": color}, "quadrant": quadrant}


def wanted_at(x: float, kind: int, color: int) -> dict[str, Any]:
    return {"part": {"type": kind, "color": color}, "assembled_pose": {"pose": pose(x)}}


KIT_TASK = {
    "agv_number": 2,
    "tray_id": 3,
    "destination": 3,
    "parts": [wanted_in(3, BATTERY, BLUE), wanted_in(1, PUMP, RED)],
}
ORDERS_2024 = (
    order(1.5, "KIT00001", 0, kitting_task=KIT_TASK),
    order(
        2.0,
        "ASM00001",
        1,
        assembly_task={
            "agv_numbers": [1, 2],
            "station": 1,
            "parts": [wanted_at(0.1, PUMP, RED), wanted_at(-0.1, SENSOR, GREEN)],
        },
    ),
    order(
        3.0,
        "COM00001",
        2,
        priority=True,
        combined_task={"station": 3, "parts": [wanted_at(0.2, REGULATOR, PURPLE)]},
    ),
    order(
        4.0,
        "LATE0001",
        0,
        kitting_task={**KIT_TASK, "agv_number": 4, "parts": [wanted_in(1, PUMP, RED)]},
    ),
)


def states_2024() -> Iterator[Recorded]:
    """Ready, started at 1 s, all announced at 40 s, ended at 60 s: ten times a second, as published."""
    for tenth in range(630):
        state = 1 if tenth < 10 else 2 if tenth < 400 else 3 if tenth < 600 else 4
        yield at(
            tenth / 10,
            "/ariac/competition_state",
            "ariac_msgs/msg/CompetitionState",
            competition_state=state,
        )


SUBMISSIONS_2024 = (
    submission(
        20.0,
        "KIT00001",
        product("battery_blue", -0.1, -0.1),
        product("pump_green", -0.1, 0.1),
        agv="agv2",
        station="warehouse",
        tray="kit_tray_03",
    ),
    submission(
        30.0,
        "ASM00001",
        product("pump_red", 0.1, 0.0, 0.0199),
        product("sensor_blue", -0.1, 0.0),
        station="as1",
        tray="assembly_insert_1",
    ),
    submission(
        50.0,
        "COM00001",
        product("regulator_purple", 0.2, 0.0),
        station="as3",
        tray="assembly_insert_3",
    ),
    submission(
        61.0,
        "LATE0001",
        product("pump_red", -0.1, 0.1),
        agv="agv4",
        station="warehouse",
        tray="kit_tray_03",
    ),
)


def scored_2024(path: Path, *, submissions: tuple[Recorded, ...] = SUBMISSIONS_2024) -> Result:
    return score_trial(
        bag(path / "trial.mcap", *ORDERS_2024, *states_2024(), *submissions), "ariac2024.release_5"
    )


def test_a_bag_of_2024_is_scored_from_its_own_orders(tmp_path: Path) -> None:
    # Rulebook 2024 as coded, by hand.
    # Kit: tray 1, battery 3, pump of the wrong colour 2, no bonus, nothing extra, right place: 6.
    # Assembly: red pump 3, sensor of the wrong colour 2, no bonus: 5.
    # Combined: purple regulator 5 and the bonus of 1 for one part: 6.
    # The last order came after the end (state 4 at 60 s), and is refused: 0.
    result = scored_2024(tmp_path)

    assert (result.status, result.score) == ("scored", 6 + 5 + 6)
    assert result.possible is not None
    assert {d.kind: d.count for d in result.measured.log_defects} == {"outside_competition": 1}


def test_a_state_that_is_published_again_and_again_starts_and_ends_once(tmp_path: Path) -> None:
    window = scored_2024(tmp_path).measured.window

    assert window is not None
    assert (window.start_s, window.end_s) == (1.0, 60.0)


def test_a_kit_without_its_tray_in_the_record_is_undecided(tmp_path: Path) -> None:
    kit, *others = SUBMISSIONS_2024
    unsaid = Recorded(kit.topic, kit.type, kit.t_ns, {**kit.fields, "tray": ""})

    whole = scored_2024(tmp_path)
    result = scored_2024(tmp_path, submissions=(unsaid, *others))

    assert whole.score is not None
    assert result.interval is not None
    assert result.score == result.interval.least < whole.score == result.interval.most


def test_a_kit_whose_contents_the_recorder_did_not_know_is_undecided(tmp_path: Path) -> None:
    kit, *others = SUBMISSIONS_2024
    fields = {**kit.fields, "products": [], "contents_unknown": True}

    result = scored_2024(tmp_path, submissions=(Recorded(kit.topic, kit.type, kit.t_ns, fields), *others))

    assert result.interval is not None
    assert result.score == result.interval.least < result.interval.most


def test_a_number_that_stands_for_no_part_withholds_what_the_topic_would_have_shown(tmp_path: Path) -> None:
    strange = order(
        5.0, "ODD00001", 0, kitting_task={**KIT_TASK, "parts": [{"part": {"type": 9}, "quadrant": 1}]}
    )
    messages = (*ORDERS_2024, strange, *states_2024(), *SUBMISSIONS_2024)

    result = score_trial(bag(tmp_path / "trial.mcap", *messages), "ariac2024.release_5")

    (defect,) = (d for d in result.measured.log_defects if d.kind == "unusable_messages")
    assert (defect.count, "9 is no type" in defect.message) == (1, True)
    assert "order_announced" not in result.measured.witnessed


TRIAL_2024 = """\
orders:
  - {id: KIT00001, type: kitting, announcement: {time_condition: 0}, priority: false, kitting_task:
     {agv_number: 2, tray_id: 3, destination: warehouse, products: [
       {type: battery, color: blue, quadrant: 3}, {type: pump, color: red, quadrant: 1}]}}
challenges:
  - {faulty_part: {order_id: KIT00001, quadrant3: true}}
"""


def test_the_challenges_of_the_configuration_hold_for_orders_of_the_bag(tmp_path: Path) -> None:
    (tmp_path / "trial.yaml").write_text(TRIAL_2024, encoding="utf-8")
    messages = (ORDERS_2024[0], *states_2024(), SUBMISSIONS_2024[0], watching("quality_check"))
    bag(tmp_path / "trial.mcap", *messages)

    result = score_trial(tmp_path, "ariac2024.release_5")

    # Tray 1, the battery in its challenged quadrant was never inspected and so is faulty, pump 2.
    assert (result.status, result.score) == ("scored", 3)


# 2021: the message of the same name as in 2020 has other fields

DEFINITIONS_2021 = {
    "nist_gear/msg/Order": (
        "string order_id\nKittingShipment[] kitting_shipments\nAssemblyShipment[] assembly_shipments\n"
    ),
    "nist_gear/msg/KittingShipment": (
        "string shipment_type\nstring agv_id\nstring station_id\nProduct[] products\n"
    ),
    "nist_gear/msg/AssemblyShipment": "string shipment_type\nstring station_id\nProduct[] products\n",
}


DEFINITIONS_2022 = {
    "nist_gear/msg/TrayContents": (
        "string kit_tray\nPublishedMovableTray movable_tray\nDetectedProduct[] products\n"
    ),
    "nist_gear/msg/PublishedMovableTray": (
        "string movable_tray_name\nstring movable_tray_type\ngeometry_msgs/Pose movable_tray_pose\n"
    ),
}


@pytest.fixture
def messages_of_2021(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bags are written with the definitions of 2021, and bring them along."""
    write_with(DEFINITIONS_2021, monkeypatch)


@pytest.fixture
def messages_of_2022(monkeypatch: pytest.MonkeyPatch) -> None:
    """Bags are written with the definitions of 2022, and bring them along."""
    write_with(DEFINITIONS_2022, monkeypatch)


def write_with(definitions: Mapping[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415  # slow

    ours = bundled_typestore(1)
    store: Typestore = get_typestore(Stores.ROS1_NOETIC)
    types: dict[str, Any] = {
        name: fields
        for name, fields in ours.fielddefs.items()
        if name not in store.fielddefs and name not in definitions
    }
    for name, text in definitions.items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    monkeypatch.setattr(bags, "bundled_typestore", lambda _ros: store)


ORDER_2021 = at(
    1.0,
    "/ariac/orders",
    "nist_gear/msg/Order",
    order_id="order_0",
    kitting_shipments=[
        {
            "shipment_type": "order_0_kitting_shipment_0",
            "agv_id": "agv1",
            "station_id": "as1",
            "products": [
                {"type": "assembly_pump_red", "pose": pose(0.1, 0.1)},
                {"type": "assembly_battery_blue", "pose": pose(-0.1, 0.1)},
            ],
        }
    ],
)


def trays_2021(t_s: float, *objects: Mapping[str, Any]) -> Recorded:
    fields = [{k: v for k, v in o.items() if k != "name"} for o in objects]
    tray = "agv1::kit_tray_1::kit_tray_1::tray"
    return at(t_s, "/ariac/trays", "nist_gear/msg/TrayContents", tray=tray, objects=fields)


def states_2021() -> Iterator[Recorded]:
    for tenth in range(300):
        state = "init" if tenth < 5 else "go" if tenth < 250 else "end_game" if tenth < 252 else "done"
        yield at(tenth / 10, "/ariac/competition_state", "std_msgs/msg/String", data=state)


CONFIG = """\
orders:
  order_0:
    announcement_condition: time
    announcement_condition_value: 0.0
    priority: {priority}
    kitting: {{shipment_count: 1, {kit}}}
"""
KIT_2021 = """\
agvs: [agv1], destinations: [as1], products: {
      part_0: {type: assembly_pump_red, pose: {xyz: [0.1, 0.1, 0], rpy: [0, 0, 0]}},
      part_1: {type: assembly_battery_blue, pose: {xyz: [-0.1, 0.1, 0], rpy: [0, 0, 0]}}}"""
KIT_2022 = """\
agvs: [agv4], destinations: [as3], trays: [%s], products: {
      part_0: {type: assembly_sensor_green, pose: {xyz: [0.1, 0, 0], rpy: [0, 0, 0]}}}"""


def configured(folder: Path, priority: int, kit: str) -> Path:
    """A configuration that says the order's priority, which the messages of 2021 and 2022 do not."""
    path = folder / "trial.yaml"
    path.write_text(CONFIG.format(priority=priority, kit=kit), encoding="utf-8")
    return path


def scored_2021(path: Path, *others: Recorded, priority: int | None = 3) -> Result:
    came = submission(20.0, "order_0_kitting_shipment_0", agv="agv1", station="as1", contents_unknown=True)
    watched = (watching("arm_collision"), watching("part_dropped"))
    messages = (ORDER_2021, *states_2021(), came, *watched, *others)
    log = bag(path / "trial.bag", *messages, storage="ros1")
    also = [] if priority is None else [configured(path, priority, KIT_2021)]
    return score_trial(log, "ariac2021.finals_as_coded", also=also, root=path)


PUMP_RED, BATTERY_BLUE = product("assembly_pump_red", 0.1, 0.1), product("assembly_battery_blue", -0.1, 0.1)


@pytest.mark.usefixtures("messages_of_2021")
def test_a_bag_of_2021_says_by_its_trays_what_was_handed_in(tmp_path: Path) -> None:
    # Two types, two colours, two poses, bonus 2: 8; of priority 3: 24.
    result = scored_2021(tmp_path, trays_2021(10.0, PUMP_RED), trays_2021(19.95, PUMP_RED, BATTERY_BLUE))

    assert (result.status, result.score) == ("scored", 24)
    assert "joined_contents" in {defect.kind for defect in result.measured.log_defects}


@pytest.mark.usefixtures("messages_of_2021")
def test_without_a_configuration_nothing_says_the_priority_and_the_score_is_withheld(tmp_path: Path) -> None:
    result = scored_2021(tmp_path, trays_2021(19.95, PUMP_RED, BATTERY_BLUE), priority=None)

    assert (result.status, result.score) == ("incomplete", None)
    assert result.missing == "nothing says the priority of order_0"
    assert "priority_unknown" in {defect.kind for defect in result.measured.log_defects}


@pytest.mark.usefixtures("messages_of_2021")
def test_a_faulty_product_on_the_tray_earns_nothing(tmp_path: Path) -> None:
    # One sound product: 1 type, 1 colour, 1 pose, no bonus; of priority 3.
    faulty = product("assembly_battery_blue", -0.1, 0.1, faulty=True)

    assert scored_2021(tmp_path, trays_2021(19.95, PUMP_RED, faulty)).score == 9


@pytest.mark.usefixtures("messages_of_2021")
def test_contents_that_are_too_old_leave_the_score_open_and_the_worst_end_counts(tmp_path: Path) -> None:
    # At most as above 8 for the right products, and one of a wrong colour in each of two places, each of
    # which the simulator counts for both types: 4; of priority 3: 36. No tray has both, so this end is an
    # outer bound.
    result = scored_2021(tmp_path, trays_2021(18.9, PUMP_RED, BATTERY_BLUE))

    assert (result.status, result.score, result.is_open) == ("scored", 0, True)
    assert result.interval is not None
    assert (result.interval.least, result.interval.most, result.interval.tight) == (0, 36, False)


@pytest.mark.slow
@pytest.mark.usefixtures("messages_of_2021")
def test_a_bag_of_another_edition_is_refused_with_its_reason_and_no_broken_plugin(tmp_path: Path) -> None:
    path = bag(tmp_path / "trial.bag", ORDER_2021, *states_2021(), storage="ros1")

    with pytest.raises(NothingToScoreError, match="no order was found") as refused:
        score_trial(path, "ariac2020.as_coded")
    assert "nist_gear/msg/Order has not the fields of this edition" in refused.value.hint


# 2022


def orders_2022(tray: str) -> Recorded:
    shipment = {
        "shipment_type": "order_0_kitting_shipment_0",
        "agv": "agv4",
        "assembly_station": "as3",
        "movable_tray": {"movable_tray_type": tray, "gripper": "gripper_tray", "pose": pose()},
        "products": [{"type": "assembly_sensor_green", "gripper": "gripper_part", "pose": pose(0.1)}],
    }
    return at(1.0, "/ariac/orders", "nist_gear/msg/Orders", order_id="order_0", kitting_shipments=[shipment])


@pytest.mark.usefixtures("messages_of_2022")
@pytest.mark.parametrize(
    ("ordered", "score"),
    # 1 type, 1 colour, 1 pose and the bonus of 1, which only the right tray earns.
    [("movable_tray_dark_wood", 4), ("movable_tray_metal_shiny", 3)],
)
def test_a_bag_of_2022_says_which_tray_the_kit_was_built_on(tmp_path: Path, ordered: str, score: int) -> None:
    tray = {
        "movable_tray_name": "movable_tray_dark_wood_1",
        "movable_tray_type": "movable_tray_dark_wood",
        "movable_tray_pose": pose(0.05),
    }
    lying = {"type": "assembly_sensor_green", "is_faulty": False, "pose": pose(0.1)}
    contents = at(
        19.9,
        "/ariac/trays",
        "nist_gear/msg/TrayContents",
        kit_tray="agv4",
        movable_tray=tray,
        products=[lying],
    )
    came = submission(20.0, "order_0_kitting_shipment_0", agv="agv4", station="as3", contents_unknown=True)
    watched = (watching("arm_collision"), watching("part_dropped"))
    messages = (orders_2022(ordered), contents, came, *watched)

    log = bag(tmp_path / "trial.bag", *messages, storage="ros1")
    config = configured(tmp_path, 1, KIT_2022 % ordered)
    result = score_trial(log, "ariac2022.as_coded", also=[config], root=tmp_path)

    assert (result.status, result.score) == ("scored", score)


# 2020


@pytest.mark.parametrize(
    ("agv", "score"),
    [("agv1", 4), ("any", 4), ("agv2", 0), ("", 0), ("agv3", 0)],  # 1 type, 1 colour, 1 pose, bonus 1
)
def test_an_order_for_no_agv_is_never_right(tmp_path: Path, agv: str, score: int) -> None:
    # Rulebook 2019 and 2020, code: `any` or the agv it came on, of agv1 and agv2; any other value never.
    shipment = {
        "shipment_type": "order_0_shipment_0",
        "agv_id": agv,
        "products": [{"type": "gear_part_red", "pose": pose(0.1)}],
    }
    messages = (
        at(1.0, "/ariac/orders", "nist_gear/msg/Order", order_id="order_0", shipments=[shipment]),
        submission(9.0, "order_0_shipment_0", product("gear_part_red", 0.1, 0.0), agv="agv1"),
        watching("arm_collision"),
    )

    result = score_trial(bag(tmp_path / "trial.mcap", *messages), "ariac2020.as_coded")

    assert (result.status, result.score) == ("scored", score)
