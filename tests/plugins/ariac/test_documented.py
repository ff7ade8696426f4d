"""What the rulebooks ask for and the simulators did not: limits from both sides, and what must not count."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from itertools import permutations
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score import Event, Finding, Pose, Rule, TeamSetup, Trial, Verdict
from ariac_score_ariac.tasks import (
    AssemblyPart,
    InsertedPart,
    KitPose,
    OrderTime,
    PartAssembled,
    PositiveSensorCost,
    TrayRight,
)
from ariac_score_ariac.tasks.poses import PoseError, best_total
from ariac_score_ariac.work import KitSubmission, Order, Product, SensorBill, Task, Tray, WantedProduct

SATISFIED, VIOLATED = Verdict.SATISFIED, Verdict.VIOLATED
INCONCLUSIVE, NOT_APPLICABLE = Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE
ORIGIN = Pose((0.0, 0.0, 0.0))
RED, BLUE = "assembly_pump_red", "assembly_pump_blue"


def turned(*, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0, x: float = 0.0) -> Pose:
    return Pose.from_rpy((x, 0.0, 0.0), (roll, pitch, yaw))


def order(*wanted: tuple[str, Pose | None], kind: str = "kitting", tray: Tray | None = None) -> Order:
    products = tuple(WantedProduct(f"part_{i}", t, pose) for i, (t, pose) in enumerate(wanted))
    return Order("o", (Task("s", kind, products, station="as2", tray=tray),), 5.0)


def trial(
    of: Order,
    *contents: Product,
    tray: Tray | None = None,
    events: Iterable[Event] = (),
    witnessed: Iterable[str] = ("submissions",),
    station: str = "as2",
) -> Trial:
    submission = KitSubmission("s", 20.0, contents, "agv1", station, tray)
    return Trial("t", (of,), (submission,), tuple(sorted(events)), witnessed=frozenset(witnessed), team=None)


def verdicts(rule: Rule, of: Trial) -> list[Verdict]:
    return [finding.verdict for finding in rule.judge(of, of.work[0])]


# Orientation ---------------------------------------------------------------------------

WITHIN = KitPose(min_quaternion_dot=None, max_heading_error_rad=None, max_rotation_rad=0.1)


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
@pytest.mark.parametrize(
    ("angle_rad", "verdict"), [(0.0999, SATISFIED), (-0.1001, VIOLATED), (3.0, VIOLATED)]
)
def test_the_whole_rotation_counts_whatever_its_axis(axis: str, angle_rad: float, verdict: Verdict) -> None:
    delivered = Product(RED, turned(**{axis: angle_rad}))

    assert verdicts(WITHIN, trial(order((RED, ORIGIN)), delivered)) == [verdict]


@pytest.mark.parametrize("angle_rad", [0.1, 0.2617993877991494, 1.0, 3.0])
def test_a_rotation_of_exactly_the_limit_is_within_and_the_next_number_is_not(angle_rad: float) -> None:
    pose = turned(roll=angle_rad / 2, yaw=angle_rad)
    rotation_rad = ORIGIN.rotation_to(pose)
    of = trial(order((RED, ORIGIN)), Product(RED, pose))

    assert verdicts(replace(WITHIN, max_rotation_rad=rotation_rad), of) == [SATISFIED]
    below = float(np.nextafter(rotation_rad, 0.0))
    assert verdicts(replace(WITHIN, max_rotation_rad=below), of) == [VIOLATED]


def test_a_distance_of_exactly_three_centimetres_is_within_and_the_next_number_is_not() -> None:
    for x, verdict in ((0.03, SATISFIED), (float(np.nextafter(0.03, 1.0)), VIOLATED)):
        assert verdicts(WITHIN, trial(order((RED, ORIGIN)), Product(RED, turned(x=x)))) == [verdict]


@pytest.mark.parametrize("angle_rad", [1e-9, 1e-4, 0.1, 1.5, 3.1])
def test_small_and_large_rotations_keep_their_digits(angle_rad: float) -> None:
    assert ORIGIN.rotation_to(turned(yaw=angle_rad)) == pytest.approx(angle_rad, rel=1e-12)


def test_a_turn_of_more_than_half_a_circle_is_the_short_way_round() -> None:
    assert ORIGIN.rotation_to(turned(yaw=2 * math.pi - 0.05)) == pytest.approx(0.05, rel=1e-9)


quaternions = st.tuples(*[st.floats(-1, 1) for _ in range(4)]).filter(lambda q: sum(v * v for v in q) > 1e-3)


@given(quaternions, quaternions, st.floats(0.1, 10))
def test_the_rotation_is_symmetric_and_knows_no_sign_or_norm(
    first: tuple[float, float, float, float], second: tuple[float, float, float, float], scale: float
) -> None:
    a, b = Pose((0.0, 0.0, 0.0), first), Pose((0.0, 0.0, 0.0), second)
    w, x, y, z = second
    scaled = Pose((0.0, 0.0, 0.0), (-w * scale, -x * scale, -y * scale, -z * scale))

    angle = a.rotation_to(b)

    assert 0 <= angle <= math.pi
    assert b.rotation_to(a) == pytest.approx(angle, abs=1e-9)
    assert a.rotation_to(scaled) == pytest.approx(angle, abs=1e-9)
    assert PoseError.between(a, b).rotation_rad == angle


# Poses whatever the colour -------------------------------------------------------------


def test_by_type_a_wrong_colour_in_its_place_counts_and_a_wrong_type_never() -> None:
    of = order((RED, ORIGIN), ("assembly_battery_red", turned(x=0.2)))
    by_type = replace(WITHIN, compare="type")
    delivered = (Product(BLUE, ORIGIN), Product("assembly_sensor_red", turned(x=0.2)))

    assert verdicts(by_type, trial(of, *delivered)) == [SATISFIED, VIOLATED]
    assert verdicts(WITHIN, trial(of, *delivered)) == [VIOLATED, VIOLATED]


def test_one_part_fills_one_slot_of_its_type_whatever_their_colours() -> None:
    of = order((RED, ORIGIN), (BLUE, turned(x=0.01)))

    found = verdicts(replace(WITHIN, compare="type"), trial(of, Product("assembly_pump_green", ORIGIN)))

    assert sorted(verdict.value for verdict in found) == ["satisfied", "violated"]


def test_a_faulty_part_of_any_colour_never_counts() -> None:
    faulty = Product(BLUE, ORIGIN, faulty=True)

    assert verdicts(replace(WITHIN, compare="type"), trial(order((RED, ORIGIN)), faulty)) == [VIOLATED]


# The best total ------------------------------------------------------------------------

tables = st.integers(1, 4).flatmap(
    lambda parts: st.lists(
        st.lists(st.sampled_from([None, 1, 2, 3]), min_size=parts, max_size=parts), min_size=1, max_size=4
    )
)


@given(tables)
def test_the_best_total_is_that_of_the_search_over_all_assignments(worth: list[list[int | None]]) -> None:
    found = best_total(worth)

    slots, parts = len(worth), len(worth[0])
    padded = [*range(parts), *[-1] * slots]
    most = max(
        sum((worth[i][j] or 0) if j >= 0 else 0 for i, j in enumerate(chosen))
        for chosen in set(permutations(padded, slots))
    )
    taken = [j for j in found if j is not None]
    assert len(taken) == len(set(taken))
    assert all(j is None or worth[i][j] is not None for i, j in enumerate(found))
    assert sum(worth[i][j] or 0 for i, j in enumerate(found) if j is not None) == most


def test_nothing_delivered_is_assigned_nowhere() -> None:
    assert best_total([[], []]) == [None, None]


# Trays of 2022 -------------------------------------------------------------------------

TRAYED = order((RED, ORIGIN), tray=Tray("oak"))
TRAY_POSE = TrayRight("pose", max_distance_m=0.02, min_quaternion_dot=None, max_rotation_rad=0.1)


@pytest.mark.parametrize("rule", [TrayRight("present"), TrayRight("type"), TrayRight("pose"), TRAY_POSE])
def test_no_tray_is_never_the_right_one_and_an_unseen_one_is_undecided(rule: TrayRight) -> None:
    assert verdicts(rule, trial(TRAYED, tray=Tray(""))) == [VIOLATED]
    assert verdicts(rule, trial(TRAYED, tray=None)) == [INCONCLUSIVE]
    assert verdicts(rule, trial(order((RED, ORIGIN)), tray=Tray(""))) == [NOT_APPLICABLE]


def test_any_tray_is_a_tray() -> None:
    assert verdicts(TrayRight("present"), trial(TRAYED, tray=Tray("pine"))) == [SATISFIED]
    assert verdicts(TrayRight("type"), trial(TRAYED, tray=Tray("pine"))) == [VIOLATED]


@pytest.mark.parametrize(
    ("pose", "verdict"),
    [
        (turned(x=0.02), SATISFIED),
        (turned(x=float(np.nextafter(0.02, 1))), VIOLATED),
        (turned(yaw=0.0999), SATISFIED),
        (turned(yaw=0.1001), VIOLATED),
        (None, INCONCLUSIVE),
    ],
)
def test_the_tray_keeps_two_centimetres_and_a_tenth_of_a_radian(pose: Pose | None, verdict: Verdict) -> None:
    assert verdicts(TRAY_POSE, trial(TRAYED, tray=Tray("oak", pose))) == [verdict]


# The time of an order ------------------------------------------------------------------

MIXED = Order("o", (Task("k"), Task("a", "assembly"), Task("c", "combined")), 5.0)
TIME = OrderTime(kinds=("kitting", "assembly", "combined"), until="all_complete")


def at(**times: float) -> Trial:
    handed_in = tuple(KitSubmission(task, t_s, ()) for task, t_s in times.items())
    return Trial("t", (MIXED,), handed_in, witnessed=frozenset({"submissions"}))


def test_the_time_of_an_order_is_that_of_its_last_task_of_any_kind() -> None:
    for times in ({"k": 30.0, "a": 20.0, "c": 10.0}, {"k": 10.0, "a": 20.0, "c": 30.0}):
        (finding,) = TIME.judge(at(**times), MIXED)
        assert (finding.verdict, dict(finding.quantities)) == (SATISFIED, {"time_taken_s": 25.0})


def test_an_order_with_a_task_left_over_has_no_time() -> None:
    (finding,) = TIME.judge(at(k=30.0, a=20.0), MIXED)

    assert (finding.verdict, dict(finding.quantities)) == (VIOLATED, {})


def test_as_coded_the_last_complete_kind_still_gives_the_time() -> None:
    (finding,) = OrderTime(kinds=("kitting", "assembly")).judge(at(k=30.0, a=20.0), MIXED)

    assert dict(finding.quantities) == {"time_taken_s": 15.0}


# Briefcases ----------------------------------------------------------------------------

IN_PLACE = AssemblyPart("best_assignment", 0.02, None, None, max_rotation_rad=0.1, compare="type_and_pose")
IN_COLOR = replace(IN_PLACE, compare="type_pose_and_color")


def test_two_alike_both_count_and_their_order_does_not_matter() -> None:
    of = order((RED, ORIGIN), (RED, turned(x=0.1)), kind="assembly")
    parts = (Product(RED, ORIGIN), Product(RED, turned(x=0.1)))

    for delivered in permutations(parts):
        assert verdicts(IN_COLOR, trial(of, *delivered)) == [SATISFIED, SATISFIED]


def test_of_two_in_one_place_the_right_colour_counts() -> None:
    of = order((RED, ORIGIN), kind="assembly")
    for delivered in permutations((Product(BLUE, ORIGIN), Product(RED, turned(x=0.01)))):
        assert verdicts(IN_COLOR, trial(of, *delivered)) == [SATISFIED]


@pytest.mark.parametrize(
    "delivered",
    [
        Product("assembly_battery_red", ORIGIN),
        Product(RED, ORIGIN, faulty=True),
        Product(RED, turned(x=float(np.nextafter(0.02, 1)))),
        Product(RED, turned(roll=0.11)),
    ],
)
def test_wrong_type_faulty_or_out_of_place_is_no_success(delivered: Product) -> None:
    of = order((RED, ORIGIN), kind="assembly")

    assert verdicts(IN_PLACE, trial(of, delivered)) == [VIOLATED]
    assert verdicts(IN_COLOR, trial(of, delivered)) == [VIOLATED]


def test_the_limits_of_an_assembly_are_within() -> None:
    of = order((RED, ORIGIN), kind="assembly")

    assert verdicts(IN_COLOR, trial(of, Product(RED, turned(x=0.02)))) == [SATISFIED]


def test_an_unknown_pose_in_a_briefcase_is_undecided() -> None:
    of = order((RED, ORIGIN), kind="assembly")

    assert verdicts(IN_PLACE, trial(of, Product(RED, None))) == [INCONCLUSIVE]


# Inserts of 2023 and 2024 --------------------------------------------------------------

BATTERY = order(("battery_red", ORIGIN), kind="assembly")
SLOT = InsertedPart("type", 0.02, None, 0.2617993877991494, "one_per_slot")


def slot(compare: str) -> InsertedPart:
    return replace(SLOT, compare=compare)  # type: ignore[arg-type]


def test_each_slot_has_one_part_the_best_of_its_type() -> None:
    lying, right = Product("battery_blue", turned(x=0.1)), Product("battery_red", ORIGIN)
    for delivered in ((lying, right), (right, lying)):
        for compare in ("type", "color", "pose", "color_and_pose"):
            assert verdicts(slot(compare), trial(BATTERY, *delivered)) == [SATISFIED]
    assert len(verdicts(InsertedPart("type"), trial(BATTERY, lying, right))) == 2


def test_one_part_fills_one_slot_of_two_of_its_type() -> None:
    of = order(("battery_red", ORIGIN), ("battery_red", turned(x=0.1)), kind="combined")

    assert verdicts(slot("type"), trial(of, Product("battery_red", turned(x=0.1)))) == [VIOLATED, SATISFIED]


@pytest.mark.parametrize("axis", ["roll", "yaw"])
def test_fifteen_degrees_are_within_and_a_little_more_is_not(axis: str) -> None:
    for angle_rad, verdict in ((0.26179, SATISFIED), (0.26181, VIOLATED)):
        of = trial(BATTERY, Product("battery_red", turned(**{axis: angle_rad})))
        assert verdicts(slot("pose"), of) == [verdict]


def test_exactly_the_measured_rotation_is_within() -> None:
    pose = turned(roll=0.2, yaw=0.1)
    of = trial(BATTERY, Product("battery_red", pose))
    rotation_rad = ORIGIN.rotation_to(pose)

    assert verdicts(replace(slot("pose"), max_rotation_rad=rotation_rad), of) == [SATISFIED]
    below = float(np.nextafter(rotation_rad, 0))
    assert verdicts(replace(slot("pose"), max_rotation_rad=below), of) == [VIOLATED]


def test_of_several_parts_one_without_a_pose_leaves_the_slot_undecided() -> None:
    known, unknown = Product("battery_red", ORIGIN), Product("battery_blue", None)

    assert verdicts(slot("color"), trial(BATTERY, known, unknown)) == [INCONCLUSIVE]
    assert verdicts(slot("color"), trial(BATTERY, unknown)) == [VIOLATED]
    assert verdicts(slot("pose"), trial(BATTERY, unknown)) == [INCONCLUSIVE]


def test_nothing_of_the_type_is_nothing_for_the_slot() -> None:
    assert verdicts(slot("type"), trial(BATTERY, Product("pump_red", ORIGIN))) == [VIOLATED]


REPORT = Event(10.0, "part_assembled", "as2", "battery")


@pytest.mark.parametrize(
    ("events", "witnessed", "verdict"),
    [
        ([REPORT], True, SATISFIED),
        ([REPORT], False, SATISFIED),
        ([replace(REPORT, t_s=20.0)], True, SATISFIED),
        ([replace(REPORT, t_s=float(np.nextafter(20.0, 21.0)))], True, VIOLATED),
        ([replace(REPORT, subject="as1")], True, VIOLATED),
        ([replace(REPORT, detail="pump")], True, VIOLATED),
        ([], True, VIOLATED),
        ([], False, INCONCLUSIVE),
    ],
)
def test_a_part_is_assembled_when_its_station_reported_it_in_time(
    events: list[Event], witnessed: bool, verdict: Verdict
) -> None:
    shown = ("submissions", "part_assembled") if witnessed else ("submissions",)
    of = trial(BATTERY, Product("battery_red", ORIGIN), events=events, witnessed=shown)

    assert verdicts(PartAssembled(), of) == [verdict]


def test_where_no_such_part_is_seen_nobody_asks_for_a_report() -> None:
    assert verdicts(PartAssembled(), trial(BATTERY, Product("pump_red", ORIGIN))) == [NOT_APPLICABLE]
    assert verdicts(PartAssembled(), trial(BATTERY, station="as3")) == [NOT_APPLICABLE]
    assert verdicts(PartAssembled(), trial(order(("battery_red", ORIGIN)))) == [NOT_APPLICABLE]


def test_unknown_contents_leave_assembly_undecided() -> None:
    of = replace(trial(BATTERY), submissions=(KitSubmission("s", 20.0, None, station="as2"),))

    assert verdicts(PartAssembled(), of) == [INCONCLUSIVE]
    assert verdicts(slot("type"), of) == [INCONCLUSIVE]


# A cost to divide by -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sensors", "recorded", "verdict"),
    [
        ({"a": "lidar"}, None, SATISFIED),
        (None, 300.0, SATISFIED),
        ({}, None, INCONCLUSIVE),
        (None, 0.0, INCONCLUSIVE),
        (None, None, INCONCLUSIVE),
        ({"a": "radar"}, None, INCONCLUSIVE),
    ],
)
def test_a_cost_of_nothing_is_no_divisor(
    sensors: dict[str, str] | None, recorded: float | None, verdict: Verdict
) -> None:
    rule = PositiveSensorCost(MappingProxyType({"lidar": 300.0}))
    bill = () if recorded is None else (SensorBill(recorded),)

    findings: list[Finding] = list(rule.watch(Trial("t", team=TeamSetup("", sensors), records=bill)))

    assert [finding.verdict for finding in findings] == [verdict]
    assert [dict(f.quantities).get("dollars") for f in findings] == [300.0 if verdict is SATISFIED else None]
