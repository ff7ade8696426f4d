"""Kits worked out from the poses of models, in hand-written state logs and model states.

Expected poses are worked by hand: the tray of agv1 stands at (2, 3, 0.75), turned by
a quarter turn, so that a part at (2 - y, 3 + x) lies at (x, y) on it.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from pathlib import Path
from types import SimpleNamespace as Fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score import open_trial, score_trial
from ariac_score.checks.contracts import Wanted
from ariac_score.checks.registry import Registry
from ariac_score.logs.gather.model_frames import ModelFrames
from ariac_score.logs.gazebo import GazeboStateReader
from ariac_score.logs.logmap import load_log_map
from ariac_score.testing.bags import Recorded, write_bag
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import Pose
from ariac_score_ariac.fault_marks import by_challenges, by_list
from ariac_score_ariac.kit_from_poses import KitsOfModels, LooseTray, TrayMatch, part_type, product_type
from ariac_score_ariac.testing.recordings import Motion, recorded_messages
from ariac_score_ariac.testing.trials import kitting_trial
from ariac_score_ariac.work import Kit, Product, Tray

QUARTER = "1.5707963267948966"
BOX = (0.25, 0.35, 0.15)
FIXED = KitsOfModels(
    products=("*_part", "*_part_*"),
    trays=(TrayMatch("{place}::kit_tray_{n}::kit_tray_{n}::tray", *BOX),),
)
LOOSE = KitsOfModels(
    products=("assembly_*",),
    trays=(
        TrayMatch(
            "{place}::kit_tray_{n}::kit_tray_{n}::tray",
            *BOX,
            loose=LooseTray("movable_tray_*::link", 0.2, 0.3, 0.15),
        ),
    ),
)
PARTS = KitsOfModels(
    names="part",
    trays=(
        TrayMatch(
            "*::{place}_tray",
            *BOX,
            loose=LooseTray("*kit_tray_*::*kit_tray_link", 0.19, 0.26, 0.15),
        ),
    ),
)


def kits_of(log_map: str) -> KitsOfModels:
    named = load_log_map(log_map).tracks
    assert named is not None
    kits = Registry().find("ariac_score.tracks", named.use).build(named.parameters)
    assert isinstance(kits, KitsOfModels)
    return kits


# A state log by hand


def model(name: str, pose: str, links: str = "", nested: str = "") -> str:
    return f"<model name='{name}'><pose>{pose} </pose>{links}{nested}</model>"


def link(name: str, pose: str) -> str:
    return f"<link name='{name}'><pose>{pose} </pose></link>"


def agv(number: int, pose: str) -> str:
    tray = model(f"kit_tray_{number}", pose, link(f"kit_tray_{number}::tray", pose))
    return model(f"agv{number}", "0 0 0 0 0 0", link("base", "0 0 0 0 0 0"), tray)


def part(name: str, x: float, y: float, z: float = 0.80, turn: str = "0") -> str:
    """A part with a model pose that is rounded and a link pose that is not."""
    rounded = f"{x:.2g} {y:.2g} {z:.2g} 0 0 {turn}"
    return model(name, rounded, link("link", f"{x} {y} {z} 0 0 {turn}"))


def frame(time: str, *contents: str) -> str:
    state = f"<sim_time>{time}</sim_time>{''.join(contents)}"
    return f"<sdf version='1.6'><state world_name='w'>{state}</state></sdf>"


def state_log(folder: Path, *frames: str, end: str = "</gazebo_log>") -> Path:
    packed = base64.b64encode(zlib.compress("".join(frames).encode())).decode()
    path = folder / "state.log"
    path.write_text(
        "<?xml version='1.0'?>\n<gazebo_log>\n<header>\n<gazebo_version>9.0</gazebo_version>\n</header>\n"
        f"<chunk encoding='zlib'>\n<![CDATA[{packed}]]>\n</chunk>\n{end}",
        encoding="utf-8",
    )
    return path


def seen(path: Path, place: str, t_s: float, kits: KitsOfModels = FIXED) -> Kit | None:
    (record,) = GazeboStateReader().read(path, Wanted(LogMap("test"), tracks=kits)).records
    return record.seen(place, t_s, max_age_s=1.0)


def contents(path: Path, place: str, t_s: float, kits: KitsOfModels = FIXED) -> tuple[Product, ...]:
    kit = seen(path, place, t_s, kits)
    assert kit is not None
    return kit.contents


TRAY_1, TRAY_2 = agv(1, f"2 3 0.75 0 0 {QUARTER}"), agv(2, "2 -3 0.75 0 0 0")


def test_a_part_on_a_turned_tray_is_given_in_the_frame_of_the_tray(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("5 0", TRAY_1, part("gear_part_red_7", 1.9, 3.2, turn=QUARTER)))

    (found,) = contents(log, "agv1", 5.0)

    assert (found.type, found.name) == ("gear_part_red", "gear_part_red_7")
    assert found.pose is not None
    assert found.pose.position_m == pytest.approx((0.2, 0.1, 0.05))
    assert found.pose.yaw_rad == pytest.approx(0.0, abs=1e-12)


def test_the_pose_of_the_link_is_taken_for_it_has_more_digits(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("5 0", TRAY_2, part("gear_part_red_7", 2.1234, -3.0)))

    (found,) = contents(log, "agv2", 5.0)

    assert found.pose is not None
    assert found.pose.position_m[0] == pytest.approx(0.1234)  # the model's own pose says 0.1


def test_a_part_whose_link_is_not_recorded_has_the_pose_of_its_model(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("5 0", TRAY_2, model("gear_part_red_7", "2.1 -3 0.8 0 0 0")))

    (found,) = contents(log, "agv2", 5.0)

    assert found.pose is not None
    assert found.pose.position_m == pytest.approx((0.1, 0.0, 0.05))


EDGE_X, EDGE_Y = 0.25, 0.35


@pytest.mark.parametrize(
    ("x", "y", "z", "inside"),
    [
        (EDGE_X, 0.0, 0.0, True),
        (np.nextafter(EDGE_X, 1), 0.0, 0.0, False),
        (-EDGE_X, EDGE_Y, 0.0, True),
        (0.0, np.nextafter(-EDGE_Y, -1), 0.0, False),
        (0.0, 0.0, 0.15, True),
        (0.0, 0.0, np.nextafter(0.15, 1), False),
        (0.0, 0.0, -0.02, True),
        (0.0, 0.0, np.nextafter(-0.02, -1), False),
    ],
)
def test_the_sides_of_the_box_belong_to_it(x: float, y: float, z: float, inside: bool) -> None:
    assert TrayMatch("*", *BOX).holds((float(x), float(y), float(z))) is inside


@pytest.mark.parametrize(("x", "inside"), [(2.3499, True), (2.3501, False), (1.6501, True), (1.6499, False)])
def test_the_box_turns_with_the_tray(tmp_path: Path, x: float, inside: bool) -> None:
    # Along the world's x lies the tray's y, so that 0.35 m is the limit there.
    log = state_log(tmp_path, frame("5 0", TRAY_1, part("gear_part_red_7", x, 3.0)))

    assert bool(contents(log, "agv1", 5.0)) is inside


def test_each_tray_has_its_own_contents(tmp_path: Path) -> None:
    parts = [part("gear_part_red_1", 2.0, 3.0), part("disk_part_blue_2", 2.0, -3.0), part("x_part_3", 2, 0)]
    log = state_log(tmp_path, frame("5 0", TRAY_1, TRAY_2, *parts))

    assert [p.name for p in contents(log, "agv1", 5.0)] == ["gear_part_red_1"]
    assert [p.name for p in contents(log, "agv2", 5.0)] == ["disk_part_blue_2"]


def test_what_is_no_product_is_not_on_the_tray(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("5 0", TRAY_2, part("logical_camera_1", 2.0, -3.0), part("bin1", 2, -3)))

    assert contents(log, "agv2", 5.0) == ()


def test_a_part_that_was_put_elsewhere_is_gone_from_then_on(tmp_path: Path) -> None:
    here, away = part("gear_part_red_1", 2.0, -3.0), part("gear_part_red_1", 0.0, 0.0)
    log = state_log(tmp_path, frame("5 0", TRAY_2, here), frame("6 0", TRAY_2, away))

    assert len(contents(log, "agv2", float(np.nextafter(6.0, 0.0)))) == 1
    assert contents(log, "agv2", 6.0) == ()


def test_a_deleted_part_is_not_on_the_tray(tmp_path: Path) -> None:
    deleted = "<deletions><name>gear_part_red_1</name></deletions>"
    log = state_log(
        tmp_path,
        frame("5 0", TRAY_2, part("gear_part_red_1", 2.0, -3.0)),
        frame("6 0", TRAY_2, deleted),
    )

    assert len(contents(log, "agv2", 5.9)) == 1
    assert contents(log, "agv2", 6.0) == ()


def test_what_a_frame_does_not_list_has_stayed_where_it_was(tmp_path: Path) -> None:
    other = model("box", "9 9 9 0 0 0")
    log = state_log(tmp_path, frame("5 0", TRAY_2, part("gear_part_red_1", 2.0, -3.0)), frame("60 0", other))

    assert len(contents(log, "agv2", 59.0)) == 1  # the log pauses while nothing moves
    assert len(contents(log, "agv2", 99.0)) == 1


def test_before_the_first_frame_nothing_is_known(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("5 0", TRAY_2))

    assert seen(log, "agv2", float(np.nextafter(5.0, 0.0))) is None
    assert contents(log, "agv2", 5.0) == ()


def test_behind_the_cut_of_a_log_nothing_is_known(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("5 0", TRAY_2), end="")

    assert contents(log, "agv2", 5.0) == ()
    assert seen(log, "agv2", float(np.nextafter(5.0, 9.0))) is None


@pytest.mark.parametrize("place", ["agv1", "agv22", "as2", "", "ks2"])
def test_a_place_without_a_tray_in_the_log_is_unknown(tmp_path: Path, place: str) -> None:
    assert seen(state_log(tmp_path, frame("5 0", TRAY_2)), place, 5.0) is None


def test_a_product_without_a_usable_pose_leaves_the_kit_unknown(tmp_path: Path) -> None:
    lost = model("gear_part_red_1", "nan 0 0 0 0 0")

    assert seen(state_log(tmp_path, frame("5 0", TRAY_2, lost)), "agv2", 5.0) is None


def test_two_runs_in_one_log_tell_nothing(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("50 0", TRAY_2), frame("5 0", TRAY_2))

    assert seen(log, "agv2", 60.0) is None


def test_of_frames_at_one_time_the_last_counts(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("5 0", TRAY_2), frame("5 0", TRAY_2, part("gear_part_red_1", 2.0, -3.0)))

    assert len(contents(log, "agv2", 5.0)) == 1


def test_a_log_map_without_trays_asks_for_no_kits(tmp_path: Path) -> None:
    log = state_log(tmp_path, frame("5 0", TRAY_2))

    assert GazeboStateReader().read(log, Wanted(LogMap("test"))).records == ()


# Loose trays


def movable(name: str, pose: str) -> str:
    return model(name, pose, link(f"{name}::link", pose))


def test_parts_are_given_in_the_frame_of_the_movable_tray(tmp_path: Path) -> None:
    tray = movable("movable_tray_dark_wood_1", f"2.05 -3.1 0.77 0 0 {QUARTER}")
    log = state_log(tmp_path, frame("5 0", TRAY_2, tray, part("bin2|assembly_pump_red_3", 1.95, -3.0)))

    kit = seen(log, "agv2", 5.0, LOOSE)

    assert kit is not None
    assert kit.tray is not None
    assert kit.tray.type == "movable_tray_dark_wood"
    assert kit.tray.pose is not None
    assert kit.tray.pose.position_m == pytest.approx((0.05, -0.1, 0.02))
    assert kit.tray.pose.yaw_rad == pytest.approx(math.pi / 2)
    (found,) = kit.contents
    assert found.pose is not None
    assert (found.type, found.name) == ("assembly_pump_red", "bin2|assembly_pump_red_3")
    assert found.pose.position_m == pytest.approx((0.1, 0.1, 0.03))


def test_without_a_movable_tray_there_is_no_kit(tmp_path: Path) -> None:
    elsewhere = movable("movable_tray_dark_wood_1", "5 5 1 0 0 0")
    log = state_log(tmp_path, frame("5 0", TRAY_2, elsewhere, part("assembly_pump_red_3", 2.0, -3.0)))

    assert seen(log, "agv2", 5.0, LOOSE) == Kit("agv2", 5.0, (), Tray(""), by_list)


def test_two_movable_trays_on_one_agv_are_undecided(tmp_path: Path) -> None:
    trays = [movable(f"movable_tray_dark_wood_{i}", f"2 -3 0.8{i} 0 0 0") for i in (1, 2)]

    assert seen(state_log(tmp_path, frame("5 0", TRAY_2, *trays)), "agv2", 5.0, LOOSE) is None


# Parts of 2023 and later

AGV_4 = model("ariac_robots", "0 0 0 0 0 0", link("agv4_tray", "2 -3 0.75 0 0 0"))
KIT_TRAY = model("kit_tray_03", "2 -3 0.76 0 0 0", link("kit_tray_link", "2 -3 0.76 0 0 0"))


def test_a_part_of_2023_has_type_and_color_in_its_name(tmp_path: Path) -> None:
    parts = [part("pump_red_1", 2.1, -2.9), part("sensor_camera", 2.0, -3.0), part("battery_blue", 1.9, -2.9)]
    log = state_log(tmp_path, frame("5 0", AGV_4, KIT_TRAY, *parts))

    kit = seen(log, "agv4", 5.0, PARTS)

    assert kit is not None
    assert kit.tray is not None
    assert kit.tray.type == "kit_tray_03"
    assert [(p.type, p.name) for p in kit.contents] == [
        ("battery_blue", "battery_blue"),
        ("pump_red", "pump_red_1"),
    ]
    assert kit.faults is by_challenges


def test_parts_that_share_a_quadrant_lose_their_poses_for_their_order_is_unknown(tmp_path: Path) -> None:
    parts = [
        part("pump_red_1", 2.1, -2.9),
        part("pump_red_2", 2.05, -2.9),
        part("battery_blue_1", 1.9, -2.9),
    ]
    log = state_log(tmp_path, frame("5 0", AGV_4, KIT_TRAY, *parts))

    found = contents(log, "agv4", 5.0, PARTS)

    assert [(p.name, p.pose is None) for p in found] == [
        ("pump_red_1", True),
        ("pump_red_2", True),
        ("battery_blue_1", False),
    ]


# Names and frames


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("gear_part_7", "gear_part"),
        ("bin1|gear_part_red_12", "gear_part_red"),
        ("a|b|gear_part_1", "gear_part"),
        ("gear_part_clone_3", "gear_part"),
        ("gear_part_clone", "gear_part"),
        ("gear_part_1_clone_2_clone", "gear_part_1_clone_2"),
        ("gear_part", "gear_part"),
        ("gear_part7", "gear_part7"),  # no underscore before the digits
        ("ab_1", "ab"),
        ("a_1", "a_1"),  # the underscore is among the first two characters
        ("_1", "_1"),
        ("12", "12"),
    ],
)
def test_a_type_is_read_from_a_name_as_the_rulebook_says(name: str, kind: str) -> None:
    assert product_type(name) == kind


def test_a_name_with_a_type_or_a_color_alone_is_no_part() -> None:
    assert [part_type(name) for name in ("pump_red", "pump", "red", "")] == ["pump_red", "", "", ""]


NUMBERS = st.floats(-5, 5)
POSES = st.builds(
    Pose.from_rpy, st.tuples(NUMBERS, NUMBERS, NUMBERS), st.tuples(*[st.floats(-math.pi, math.pi)] * 3)
)


@pytest.mark.slow
@given(frame_pose=POSES, thing=POSES)
def test_a_frame_changes_no_distance(frame_pose: Pose, thing: Pose) -> None:
    moved = thing.seen_from(frame_pose)

    apart = math.dist(frame_pose.position_m, thing.position_m)
    assert math.hypot(*moved.position_m) == pytest.approx(apart, abs=1e-9)


@given(pose=POSES)
def test_in_its_own_frame_a_pose_is_the_identity(pose: Pose) -> None:
    own = pose.seen_from(pose)

    assert own.position_m == pytest.approx((0, 0, 0), abs=1e-9)
    assert own.orientation_wxyz == pytest.approx((1, 0, 0, 0), abs=1e-9)


# Model states of a bag


def states(*named: tuple[str, float, float, float]) -> Fields:
    turn = Fields(w=1.0, x=0.0, y=0.0, z=0.0)
    poses = [Fields(position=Fields(x=x, y=y, z=z), orientation=turn) for _, x, y, z in named]
    return Fields(name=[name for name, *_ in named], pose=poses)


BAG_TRAY = ("agv2::kit_tray_2::kit_tray_2::tray", 2.0, -3.0, 0.75)
BAG_PART = ("gear_part_red_1::link", 2.1, -3.0, 0.8)


def test_link_states_of_a_bag_show_kits() -> None:
    frames = ModelFrames(FIXED)
    frames.add(states(BAG_TRAY, BAG_PART), 1_000_000_000)
    frames.add(states(BAG_TRAY), 2_000_000_000)
    record = frames.record(0)

    assert record is not None
    kit = record.seen("agv2", 1.5, max_age_s=1.0)
    assert kit is not None
    assert kit.contents[0].pose is not None
    assert kit.contents[0].pose.position_m == pytest.approx((0.1, 0.0, 0.05))
    gone = record.seen("agv2", 2.0, max_age_s=1.0)
    assert gone is not None
    assert gone.contents == ()  # each message lists all there is


def test_what_a_message_alone_does_not_list_may_have_lain_there() -> None:
    """Gazebo gives no name twice: what is there again was there all the time."""
    frames = ModelFrames(FIXED)
    for second, listed in enumerate(((BAG_PART,), (), (BAG_PART,), (), ()), start=1):
        frames.add(states(BAG_TRAY, *listed), second * 1_000_000_000)
    record = frames.record(0)

    assert record is not None
    seen = [record.seen("agv2", float(second), max_age_s=1.0) for second in (1, 2, 3, 4, 5)]
    assert seen[1] is None
    assert [len(kit.contents) for kit in seen if kit is not None] == [1, 1, 0, 0]


def test_model_states_grow_old_for_a_bag_does_not_pause() -> None:
    frames = ModelFrames(FIXED)
    frames.add(states(BAG_TRAY), 1_000_000_000)
    record = frames.record(0)

    assert record is not None
    assert record.seen("agv2", 2.0, max_age_s=1.0) is not None
    assert record.seen("agv2", float(np.nextafter(2.0, 3.0)), max_age_s=1.0) is None


def test_a_bag_without_model_states_shows_no_kits() -> None:
    assert ModelFrames(FIXED).record(0) is None


@pytest.mark.slow
@pytest.mark.parametrize("names", [("ground_plane",), ("ground_plane", "gantry")])
@pytest.mark.parametrize("motion", ["snapshot", "frames"])
def test_models_beside_snapshots_or_frames_are_no_second_robot(
    tmp_path: Path, names: tuple[str, ...], motion: Motion
) -> None:
    """A robot of another name would be one of whom nobody knows how far from the human it was."""
    trial = kitting_trial()
    at_rest = {"linear": dict.fromkeys("xyz", 0.0), "angular": dict.fromkeys("xyz", 0.0)}
    messages = recorded_messages(trial, motion=motion)
    place = trial.signals["position/robot"]
    states = [
        Recorded(
            "/gazebo/model_states",
            "gazebo_msgs/msg/ModelStates",
            messages[0].t_ns + round((t_s + 6.0) * 1e9),
            {
                "name": list(names),
                "pose": [
                    {"position": dict(zip("xyz", at_m, strict=True)), "orientation": {"w": 1.0}}
                    for at_m in ([0.0, 0.0, 0.0], at.tolist())[: len(names)]
                ],
                "twist": [at_rest] * len(names),
            },
        )
        for t_s, at in list(zip(place.t, place.values, strict=True))[::10]
    ]
    log = write_bag(tmp_path / "a.mcap", sorted([*messages, *states], key=lambda m: m.t_ns), storage="mcap")

    opened = open_trial(log, log_map="ariac2020")
    assert [body.id for body in opened.bodies] == ["human", "robot"]
    alone = write_bag(tmp_path / "b.mcap", messages, storage="mcap")
    assert [body.id for body in open_trial(alone, log_map="ariac2020").bodies] == ["human", "robot"]


# From end to end: submissions of one log, contents of another

PRODUCTS = (("gear_part_red", 2.1, -3.0), ("disk_part_blue", 1.9, -3.0))
CONFIGURATION = """\
faulty_products: [{faulty}]
orders:
  order_0:
    announcement_condition: time
    destinations: [agv2]
    products:
      part_0: {{type: gear_part_red, pose: {{xyz: [0.1, 0, 0]}}}}
      part_1: {{type: disk_part_blue, pose: {{xyz: [-0.1, 0, 0]}}}}
"""


def bundle(folder: Path, *, faulty: str | None, submitted_s: float = 9.0) -> Path:
    parts = [part(f"{kind}_{i}", x, y) for i, (kind, x, y) in enumerate(PRODUCTS)]
    state_log(folder, frame("5 0", TRAY_2, *parts))
    records = [
        {"record": "trial", "format": "ariac-score-trial-log/1", "id": "run", "clock": "simulated time"},
        {"record": "event", "t_s": 1.0, "kind": "competition_started"},
        {"record": "event", "t_s": 2.0, "kind": "order_announced", "subject": "order_0"},
        {"record": "submission", "t_s": submitted_s, "task_id": "order_0_shipment_0", "agv": "agv2"},
        {"record": "event", "t_s": 10.0, "kind": "competition_ended"},
    ]
    records[0]["witnessed"] = ["submissions", "arm_collision"]
    if faulty is None:
        task = {"id": "order_0_shipment_0", "agv": "agv2", "products": _slots()}
        records.insert(2, {"record": "order", "t_s": 2.0, "id": "order_0", "tasks": [task]})
        del records[3]
    else:
        (folder / "trial.yaml").write_text(CONFIGURATION.format(faulty=faulty), encoding="utf-8")
    records.append({"record": "end", "records": len(records) + 1})
    lines = "".join(json.dumps(record) + "\n" for record in records)
    (folder / "run.jsonl").write_text(lines, encoding="utf-8")
    return folder


def _slots() -> list[dict[str, object]]:
    return [
        {
            "slot": f"part_{i}",
            "type": kind,
            "pose": {"position_m": [x - 2.0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]},
        }
        for i, (kind, x, _) in enumerate(PRODUCTS)
    ]


@pytest.mark.parametrize(
    ("faulty", "score"),
    [
        # 2020 as coded: 2 types, 2 colours, 2 poses, bonus 2; of one sound product 1 + 1 + 1, no bonus.
        ("", 8),
        ("gear_part_red_5", 8),
        ("gear_part_red_0", 3),
    ],
)
def test_a_state_log_and_a_configuration_say_what_was_handed_in(
    tmp_path: Path, faulty: str, score: int
) -> None:
    result = score_trial(bundle(tmp_path, faulty=faulty), "ariac2020.as_coded")

    assert (result.status, result.score) == ("scored", score)


def test_without_a_configuration_products_may_be_faulty_and_the_score_is_open(tmp_path: Path) -> None:
    result = score_trial(bundle(tmp_path, faulty=None), "ariac2020.as_coded")

    assert result.interval is not None
    assert (result.score, result.interval.least, result.interval.most) == (0, 0, 8)
    assert any("are faulty" in words for words in result.measured.unrecorded)


def test_a_submission_before_the_first_frame_is_undecided(tmp_path: Path) -> None:
    result = score_trial(bundle(tmp_path, faulty="", submitted_s=4.9), "ariac2020.as_coded")

    assert result.interval is not None
    assert (result.score, result.interval.least, result.interval.most) == (0, 0, 8)


def test_shipped_log_maps_find_the_trays_of_their_edition() -> None:
    names = {"ariac2019", "ariac2020", "ariac2021", "ariac2022", "ariac2023", "ariac2024"}

    assert all(kits_of(name).trays for name in names)


def test_the_real_log_of_2022_shows_that_no_movable_tray_was_brought(shared: Path) -> None:
    log = shared / "ariac/data/nist_team_2022/gazebo/state.log"
    kits = kits_of("ariac2022")
    (record,) = GazeboStateReader().read(log, Wanted(LogMap("test"), tracks=kits)).records

    for number in (1, 2, 3, 4):
        kit = record.seen(f"agv{number}", 20.0, max_age_s=1.0)
        assert kit is not None
        assert (kit.contents, kit.tray) == ((), Tray(""))


def test_a_part_that_a_frame_both_deletes_and_lists_is_on_the_tray(tmp_path: Path) -> None:
    deleted = "<deletions><name>gear_part_red_1</name></deletions>"
    here = part("gear_part_red_1", 2.0, -3.0)
    log = state_log(tmp_path, frame("5 0", TRAY_2, here), frame("6 0", TRAY_2, deleted, here))

    assert len(contents(log, "agv2", 6.0)) == 1
    assert len(contents(log, "agv2", 99.0)) == 1
