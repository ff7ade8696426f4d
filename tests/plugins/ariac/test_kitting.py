"""The kitting rules on both sides of their limits, and where a log decides nothing.

Limits and formulas: rulebooks, sections 0.3-0.5 (common), 3 (2019), 4 (2020), 6 (2022).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ariac_score import Finding, Pose, Rule, Trial, Verdict, load_rule_set, measure_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.engine.price import price_trial
from ariac_score.results.result import Pinned, Provenance, Result
from ariac_score_ariac.tasks import (
    Destination,
    KitPose,
    NoneFaulty,
    NoneMissing,
    NoneUnwanted,
    OnlyKitting,
    OrderTime,
    Presence,
    Submitted,
    TrayRight,
)
from ariac_score_ariac.tasks.poses import PoseError, best_assignment
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, Tray, WantedProduct

SATISFIED, VIOLATED = Verdict.SATISFIED, Verdict.VIOLATED
INCONCLUSIVE, NOT_APPLICABLE = Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE

LAWS = settings(max_examples=100, derandomize=True, deadline=None)

ORIGIN = Pose((0.0, 0.0, 0.0))
GEAR = "gear_part_red"
PER_SLOT: list[Rule] = [Presence(compare="type"), Presence(), KitPose()]
PER_TRAY: list[Rule] = [NoneMissing(), NoneUnwanted(), NoneFaulty()]
OF_DELIVERY: list[Rule] = [Submitted(), Destination(), OrderTime()]


def at(x: float = 0.0, y: float = 0.0, yaw: float = 0.0, *, z: float = 0.0, roll: float = 0.0) -> Pose:
    return Pose.from_rpy((x, y, z), (roll, 0.0, yaw))


def kit(*wanted: tuple[str, Pose | None], **task: Any) -> Order:
    products = tuple(WantedProduct(f"part_{i}", kind, pose) for i, (kind, pose) in enumerate(wanted))
    return Order("order_0", (Task("s", products=products, **task),), announced_s=10.0)


def part(kind: str = GEAR, pose: Pose | None = ORIGIN, *, faulty: bool = False, name: str = "") -> Product:
    return Product(kind, pose, faulty, name)


def handed_in(*contents: Product, at_s: float = 20.0, **more: Any) -> KitSubmission:
    return KitSubmission("s", at_s, contents, **more)


def trial(*submissions: KitSubmission, witnessed: Iterable[str] = ("submissions",)) -> Trial:
    return Trial("t", submissions=submissions, witnessed=frozenset(witnessed))


def verdicts(rule: Rule, of: Trial, order: Order) -> list[Verdict]:
    return [finding.verdict for finding in rule.judge(of, order)]


def only(rule: Rule, of: Trial, order: Order) -> Finding:
    (finding,) = rule.judge(of, order)
    return finding


# What is on the tray -------------------------------------------------------------------


def test_a_part_of_the_wrong_colour_has_the_type_but_not_the_colour() -> None:
    order, delivered = kit((GEAR, ORIGIN)), trial(handed_in(part("gear_part_blue")))

    assert verdicts(Presence(compare="type"), delivered, order) == [SATISFIED]
    assert verdicts(Presence(), delivered, order) == [VIOLATED]


def test_a_part_of_the_wrong_colour_earns_no_pose_is_unwanted_and_leaves_one_missing() -> None:
    order, delivered = kit((GEAR, ORIGIN)), trial(handed_in(part("gear_part_blue")))

    assert verdicts(KitPose(), delivered, order) == [VIOLATED]
    assert only(NoneMissing(), delivered, order).message == "1 red gear missing"
    assert only(NoneUnwanted(), delivered, order).message == "1 blue gear unwanted"


@pytest.mark.parametrize(("delivered", "present"), [(0, 0), (1, 1), (2, 2), (3, 2)])
def test_as_many_are_present_as_were_ordered_and_delivered(delivered: int, present: int) -> None:
    order = kit((GEAR, ORIGIN), (GEAR, at(0.1)))

    found = verdicts(Presence(), trial(handed_in(*[part()] * delivered)), order)

    assert found.count(SATISFIED) == present
    assert found.count(VIOLATED) == 2 - present


@given(
    ordered=st.lists(st.sampled_from(["a_red", "a_blue", "b_red"]), min_size=1, max_size=5),
    delivered=st.lists(st.sampled_from(["a_red", "a_blue", "b_red", "b_green"]), max_size=6),
)
@LAWS
def test_presence_counts_the_smaller_of_ordered_and_delivered_for_each_type(
    ordered: list[str], delivered: list[str]
) -> None:
    order = kit(*((kind, None) for kind in ordered))
    tray = trial(handed_in(*(part(kind) for kind in delivered)))

    exact = verdicts(Presence(), tray, order).count(SATISFIED)
    bases = verdicts(Presence(compare="type"), tray, order).count(SATISFIED)

    # rulebooks, section 4: per exact type and per base type min(ordered, delivered), summed
    assert exact == sum(min(ordered.count(k), delivered.count(k)) for k in set(ordered))
    base_ordered, base_delivered = ([k[0] for k in kinds] for kinds in (ordered, delivered))
    assert bases == sum(min(base_ordered.count(k), base_delivered.count(k)) for k in set(base_ordered))


def test_a_faulty_part_is_not_there_and_costs_the_fault_check() -> None:
    order, delivered = kit((GEAR, ORIGIN)), trial(handed_in(part(faulty=True, name="gear_7")))

    for rule in PER_SLOT:
        assert verdicts(rule, delivered, order) == [VIOLATED]
    assert only(NoneMissing(), delivered, order).verdict is VIOLATED
    assert only(NoneFaulty(), delivered, order).message == "faulty: gear_7"


def test_a_faulty_part_too_many_is_faulty_but_not_unwanted() -> None:
    # rulebooks, section 3: "Non-faulty delivered products only are used from here"
    order, delivered = kit((GEAR, ORIGIN)), trial(handed_in(part(), part(faulty=True)))

    assert verdicts(NoneUnwanted(), delivered, order) == [SATISFIED]
    assert verdicts(NoneMissing(), delivered, order) == [SATISFIED]
    assert verdicts(NoneFaulty(), delivered, order) == [VIOLATED]
    assert verdicts(KitPose(), delivered, order) == [SATISFIED]


def test_one_more_than_ordered_is_unwanted() -> None:
    order = kit((GEAR, ORIGIN))

    assert only(NoneUnwanted(), trial(handed_in(part())), order).verdict is SATISFIED
    assert only(NoneUnwanted(), trial(handed_in(part(), part())), order).verdict is VIOLATED


def test_an_empty_tray_has_everything_missing_and_nothing_unwanted_or_faulty() -> None:
    order, empty = kit((GEAR, ORIGIN)), trial(handed_in())

    assert [verdicts(rule, empty, order) for rule in PER_SLOT] == [[VIOLATED]] * 3
    assert [verdicts(rule, empty, order) for rule in PER_TRAY] == [[VIOLATED], [SATISFIED], [SATISFIED]]


def scored(full: Trial, rules: str = "paper2020.published") -> Result:
    rule_set, registry = load_rule_set(rules), Registry()
    measured = measure_trial(full, prepare(rule_set, registry=registry))
    return price_trial(measured, rule_set, Provenance((), (), Pinned("", ""), Pinned("", ""), ()))


def test_an_order_for_an_empty_kit_is_priced_and_earns_nothing() -> None:
    result = scored(replace(kitting_trial(), work=(kit(agv="agv1"),), submissions=(handed_in(agv="agv1"),)))

    assert (result.status, result.score) == ("scored", 0)
    for check in ("part_type", "part_color", "part_pose"):
        (finding,) = result.measured.of(check).values()
        assert (finding.verdict, finding.subject) == (NOT_APPLICABLE, "order_0/s")


# What a log does not show --------------------------------------------------------------


@pytest.mark.parametrize("rule", [*PER_SLOT, *PER_TRAY], ids=lambda rule: type(rule).__name__)
def test_unknown_contents_are_undecided_whatever_was_ordered(rule: Rule) -> None:
    order = kit((GEAR, ORIGIN), ("pulley_part_blue", at(0.1)))
    unseen = trial(KitSubmission("s", 20.0, contents=None))

    assert set(verdicts(rule, unseen, order)) == {INCONCLUSIVE}


@pytest.mark.parametrize("rule", [*PER_SLOT, *PER_TRAY, *OF_DELIVERY], ids=lambda rule: type(rule).__name__)
def test_without_a_record_of_submissions_nothing_is_decided(rule: Rule) -> None:
    assert set(verdicts(rule, trial(witnessed=()), kit((GEAR, ORIGIN), (GEAR, ORIGIN)))) == {INCONCLUSIVE}


@pytest.mark.parametrize(
    ("rule", "verdict"),
    [
        *((rule, VIOLATED) for rule in PER_SLOT),
        (NoneMissing(), VIOLATED),
        (NoneUnwanted(), NOT_APPLICABLE),
        (NoneFaulty(), NOT_APPLICABLE),
        (Submitted(), VIOLATED),
        (Destination(), NOT_APPLICABLE),
        (OrderTime(), VIOLATED),
    ],
    ids=lambda value: value.value if isinstance(value, Verdict) else type(value).__name__,
)
def test_what_was_witnessed_as_never_submitted_is_missing(rule: Rule, verdict: Verdict) -> None:
    assert verdicts(rule, trial(), kit((GEAR, ORIGIN))) == [verdict]


@given(
    wanted=st.lists(st.sampled_from([GEAR, "gear_part_blue"]), min_size=1, max_size=4),
    agv=st.sampled_from(["any", "agv1", ""]),
)
@LAWS
def test_a_log_without_submissions_or_contents_never_satisfies_a_rule_about_them(
    wanted: list[str], agv: str
) -> None:
    order = kit(*((kind, ORIGIN) for kind in wanted), agv=agv)
    unwitnessed, unseen = trial(witnessed=()), trial(KitSubmission("s", 20.0, contents=None, agv="agv1"))

    for rule in [*PER_SLOT, *PER_TRAY, *OF_DELIVERY]:
        assert SATISFIED not in verdicts(rule, unwitnessed, order)
    for rule in [*PER_SLOT, *PER_TRAY]:
        assert SATISFIED not in verdicts(rule, unseen, order)


def test_every_finding_about_an_unsubmitted_kit_lies_within_its_submission() -> None:
    order = kit((GEAR, ORIGIN))
    rules = [*PER_SLOT, *PER_TRAY, Submitted(), Destination()]

    subjects = {only(rule, trial(), order).subject for rule in rules}

    assert subjects == {"order_0/s/part_0", "order_0/s"}


# Which submission counts ---------------------------------------------------------------


@pytest.mark.parametrize(
    ("submitted_s", "verdict"), [(10.0, SATISFIED), (float(np.nextafter(10.0, 0.0)), VIOLATED)]
)
def test_a_submission_before_the_announcement_does_not_count(submitted_s: float, verdict: Verdict) -> None:
    early = trial(handed_in(part(), at_s=submitted_s))

    assert only(Submitted(), early, kit((GEAR, ORIGIN))).verdict is verdict
    assert only(Presence(), early, kit((GEAR, ORIGIN))).verdict is verdict
    assert only(KitPose(), early, kit((GEAR, ORIGIN))).verdict is verdict


def test_the_second_submission_of_a_shipment_is_ignored_better_or_worse() -> None:
    empty, full = handed_in(at_s=20.0), handed_in(part(), at_s=30.0)
    late_empty = handed_in(at_s=40.0)

    assert only(Presence(), trial(empty, full), kit((GEAR, ORIGIN))).verdict is VIOLATED
    assert only(Presence(), trial(full, late_empty), kit((GEAR, ORIGIN))).verdict is SATISFIED
    assert only(OrderTime(), trial(empty, full), kit((GEAR, ORIGIN))).quantities == {"time_taken_s": 10.0}


def test_a_submission_of_another_shipment_does_not_count() -> None:
    other = trial(KitSubmission("order_1234_shipment_0", 20.0, (part(),)))

    assert only(Submitted(), other, kit((GEAR, ORIGIN))).verdict is VIOLATED


# Where the parts lie -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "verdict"), [(0.03, SATISFIED), (float(np.nextafter(0.03, 1.0)), VIOLATED), (-0.03, SATISFIED)]
)
def test_three_centimetres_pass_and_the_next_number_fails(x: float, verdict: Verdict) -> None:
    assert only(KitPose(), trial(handed_in(part(pose=at(x)))), kit((GEAR, ORIGIN))).verdict is verdict


def test_the_distance_is_that_in_the_plane_and_height_does_not_count() -> None:
    # 3-4-5: 0.018 and 0.024 are 0.030 apart; float rounding may move it, so a micrometre inside and outside
    inside, outside = at(0.018, 0.024 - 1e-6, z=5.0), at(0.018, 0.024 + 1e-6)

    assert only(KitPose(), trial(handed_in(part(pose=inside))), kit((GEAR, ORIGIN))).verdict is SATISFIED
    assert only(KitPose(), trial(handed_in(part(pose=outside))), kit((GEAR, ORIGIN))).verdict is VIOLATED


@pytest.mark.parametrize(
    ("w", "verdict"),
    [
        (0.95, SATISFIED),
        (-0.95, SATISFIED),
        (float(np.nextafter(0.95, 0.0)), VIOLATED),
        (float(np.nextafter(-0.95, 0.0)), VIOLATED),
    ],
)
def test_a_quaternion_dot_of_95_percent_passes_and_the_next_number_fails(w: float, verdict: Verdict) -> None:
    # Nothing is normalised: (w, 0, 0, 0) has the dot product w with (1, 0, 0, 0), and no yaw.
    delivered = trial(handed_in(part(pose=Pose((0.0, 0.0, 0.0), (w, 0.0, 0.0, 0.0)))))

    assert only(KitPose(), delivered, kit((GEAR, ORIGIN))).verdict is verdict


@given(*[st.tuples(*[st.floats(-1.0, 1.0)] * 4)] * 2)
@LAWS
def test_the_dot_product_is_added_up_from_left_to_right_on_every_python(
    a: tuple[float, float, float, float], b: tuple[float, float, float, float]
) -> None:
    assume(max(map(abs, a)) > 1e-3 and max(map(abs, b)) > 1e-3)
    error = PoseError.between(Pose((0.0, 0.0, 0.0), a), Pose((0.0, 0.0, 0.0), b))

    assert error.quaternion_dot == abs(((a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]) + a[3] * b[3])


HALF_TURN_ABOUT_Z = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))  # yaw = atan2(0, -1) = pi, exactly
QUARTER_TURN = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1.0))  # w = z: yaw = atan2(1, 0) = pi/2, exactly
QUARTER_TURN_BACK = Pose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, -1.0))  # yaw = -pi/2
QUARTER = math.pi / 2


@pytest.mark.parametrize(
    ("limit", "verdict"), [(QUARTER, VIOLATED), (float(np.nextafter(QUARTER, 4.0)), SATISFIED)]
)
def test_a_heading_error_at_the_limit_fails(limit: float, verdict: Verdict) -> None:
    # From 0 to pi/2, and the dot product of the unnormalised quaternions is 1.
    rule = KitPose(max_heading_error_rad=limit)

    assert only(rule, trial(handed_in(part(pose=QUARTER_TURN))), kit((GEAR, ORIGIN))).verdict is verdict


@pytest.mark.parametrize(
    ("limit", "verdict"), [(QUARTER, SATISFIED), (float(np.nextafter(QUARTER, 0.0)), VIOLATED)]
)
@pytest.mark.parametrize("swapped", [False, True])
def test_a_heading_error_at_the_limit_the_long_way_round_passes(
    limit: float, verdict: Verdict, swapped: bool
) -> None:
    # From -pi/2 to pi: |d| = 3 pi/2, | |d| - 2 pi | = pi/2, and that test is not strict.
    wanted, delivered = (
        (HALF_TURN_ABOUT_Z, QUARTER_TURN_BACK) if swapped else (QUARTER_TURN_BACK, HALF_TURN_ABOUT_Z)
    )
    rule = KitPose(max_heading_error_rad=limit)

    assert only(rule, trial(handed_in(part(pose=delivered))), kit((GEAR, wanted))).verdict is verdict


@pytest.mark.parametrize(
    ("wanted", "delivered", "verdict"),
    [
        (0.0, 0.0999, SATISFIED),
        (0.0, 0.1001, VIOLATED),
        (0.0, -0.0999, SATISFIED),
        (0.0, -0.1001, VIOLATED),
        (3.1, -3.1, SATISFIED),  # 6.2 - 2 pi = -0.083
        (3.09, -3.09, VIOLATED),  # 6.18 - 2 pi = -0.103
        (5.0, 5.0 + 2 * math.pi, SATISFIED),
    ],
)
def test_a_tenth_of_a_radian_is_the_limit_of_the_heading(
    wanted: float, delivered: float, verdict: Verdict
) -> None:
    laid = trial(handed_in(part(pose=at(yaw=delivered))))

    assert only(KitPose(), laid, kit((GEAR, at(yaw=wanted)))).verdict is verdict


@pytest.mark.parametrize(("roll", "verdict"), [(0.635, SATISFIED), (0.636, VIOLATED), (math.pi, VIOLATED)])
def test_a_part_may_lean_but_not_lie_on_its_head(roll: float, verdict: Verdict) -> None:
    # rulebooks, section 0.3: |dot| 0.95 is a rotation of 2 acos(0.95) = 0.6351 rad
    finding = only(KitPose(), trial(handed_in(part(pose=at(roll=roll)))), kit((GEAR, ORIGIN)))

    assert finding.verdict is verdict


def test_the_violation_names_the_limit_that_was_broken_and_by_how_much() -> None:
    finding = only(KitPose(), trial(handed_in(part(pose=at(0.04)))), kit((GEAR, ORIGIN)))

    assert finding.message == "distance 0.04 m (at most 0.03)"
    assert (finding.robustness, finding.unit) == (pytest.approx(-0.01), "m")


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(7))
def test_a_pose_with_a_number_that_is_none_cannot_be_made(number: float, place: int) -> None:
    numbers = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    numbers[place] = number

    with pytest.raises(ValueError, match="finite"):
        Pose((numbers[0], numbers[1], numbers[2]), (numbers[3], numbers[4], numbers[5], numbers[6]))


def test_a_part_without_a_usable_pose_leaves_its_slot_undecided() -> None:
    laid = trial(handed_in(part(pose=None)))

    assert only(KitPose(), laid, kit((GEAR, ORIGIN))).verdict is INCONCLUSIVE
    assert only(Presence(), laid, kit((GEAR, ORIGIN))).verdict is SATISFIED


def test_a_part_without_a_pose_leaves_open_only_slots_that_no_other_part_fills() -> None:
    order = kit((GEAR, ORIGIN), (GEAR, at(1.0)), ("disk_part_red", at(0.5)))
    laid = trial(handed_in(part(pose=None), part(pose=ORIGIN), part("disk_part_red", at(0.9))))

    assert verdicts(KitPose(), laid, order) == [SATISFIED, INCONCLUSIVE, VIOLATED]


def test_a_faulty_part_without_a_pose_leaves_nothing_open() -> None:
    laid = trial(handed_in(part(pose=None, faulty=True)))

    assert only(KitPose(), laid, kit((GEAR, ORIGIN))).verdict is VIOLATED


def test_an_order_without_a_pose_is_undecided() -> None:
    assert only(KitPose(), trial(handed_in(part())), kit((GEAR, None))).verdict is INCONCLUSIVE


def test_one_part_fills_one_of_two_slots_it_would_fit() -> None:
    order = kit((GEAR, ORIGIN), (GEAR, at(0.01)))

    found = verdicts(KitPose(), trial(handed_in(part())), order)

    assert sorted(found) == [SATISFIED, VIOLATED]


def most_that_can_pass(passing: Sequence[Sequence[int]], parts: int) -> int:
    """Rulebooks, section 0.5: every permutation of max(D, A) positions is tried."""
    places = max(len(passing), parts)
    return max(
        sum(slot < len(passing) and p in passing[slot] for slot, p in enumerate(order))
        for order in permutations(range(places))
    )


@given(st.lists(st.lists(st.integers(0, 5), max_size=6, unique=True), max_size=6))
@LAWS
def test_the_best_assignment_is_that_of_the_search_over_all_permutations(passing: list[list[int]]) -> None:
    match = best_assignment(passing)
    used = [p for p in match if p is not None]

    assert len(match) == len(passing)
    assert len(set(used)) == len(used)
    assert all(p is None or p in passing[slot] for slot, p in enumerate(match))
    assert len(used) == most_that_can_pass(passing, 6)


@given(
    slots=st.lists(st.integers(0, 6), min_size=1, max_size=4),
    parts=st.lists(st.integers(0, 6), max_size=5),
    data=st.data(),
)
@LAWS
def test_pose_points_do_not_depend_on_the_order_of_parts(
    slots: list[int], parts: list[int], data: st.DataObject
) -> None:
    # On a line, 2 cm apart: a part passes at its own slot and at the next one on each side.
    order = kit(*((GEAR, at(0.02 * i)) for i in slots))
    passing = [[j for j, p in enumerate(parts) if abs(p - s) <= 1] for s in slots]
    shuffled = data.draw(st.permutations(parts))

    found = verdicts(KitPose(), trial(handed_in(*(part(pose=at(0.02 * i)) for i in shuffled))), order)

    assert found.count(SATISFIED) == most_that_can_pass(passing, len(parts))


# Where the kit went --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ordered", "delivered", "verdict"),
    [
        ("agv1", "agv1", SATISFIED),
        ("agv1", "agv2", VIOLATED),
        ("any", "agv2", SATISFIED),
        ("any", "", SATISFIED),
        ("agv1", "", INCONCLUSIVE),
    ],
)
def test_a_kit_must_leave_on_the_ordered_agv(ordered: str, delivered: str, verdict: Verdict) -> None:
    order = kit((GEAR, ORIGIN), agv=ordered)

    assert only(Destination(), trial(handed_in(agv=delivered)), order).verdict is verdict


@pytest.mark.parametrize(
    ("agv", "station", "with_station", "agv_only"),
    [
        ("agv1", "as1", SATISFIED, SATISFIED),
        ("agv1", "as2", VIOLATED, SATISFIED),
        ("agv2", "as1", VIOLATED, VIOLATED),
        ("agv1", "", INCONCLUSIVE, SATISFIED),
        ("agv2", "", VIOLATED, VIOLATED),  # wrong already, whatever the station
        ("", "as2", VIOLATED, INCONCLUSIVE),
    ],
)
def test_from_2021_the_station_must_be_right_too(
    agv: str, station: str, with_station: Verdict, agv_only: Verdict
) -> None:
    order, sent = kit((GEAR, ORIGIN), agv="agv1", station="as1"), trial(handed_in(agv=agv, station=station))

    assert only(Destination(compare="agv_and_station"), sent, order).verdict is with_station
    assert only(Destination(), sent, order).verdict is agv_only


# How long it took ----------------------------------------------------------------------


def test_the_order_time_runs_from_announcement_to_the_last_counted_submission() -> None:
    tasks = (Task("a"), Task("b"))
    order = Order("order_0", tasks, announced_s=10.0)
    done = trial(KitSubmission("a", 15.0, ()), KitSubmission("b", 32.5, ()), KitSubmission("a", 90.0, ()))

    finding = only(OrderTime(), done, order)

    assert finding.verdict is SATISFIED
    assert finding.quantities == {"time_taken_s": 22.5}


def test_an_order_with_a_shipment_left_over_is_not_complete_and_has_no_time() -> None:
    order = Order("order_0", (Task("a"), Task("b")), announced_s=10.0)

    finding = only(OrderTime(), trial(KitSubmission("a", 15.0, ())), order)

    assert finding.verdict is VIOLATED
    assert finding.message == "1 of 2 shipments were submitted"
    assert finding.quantities == {}


@pytest.mark.parametrize(
    ("submitted_s", "verdict"), [(40.0, SATISFIED), (float(np.nextafter(40.0, 50.0)), VIOLATED)]
)
def test_an_order_may_take_just_as_long_as_allowed(submitted_s: float, verdict: Verdict) -> None:
    done = trial(handed_in(at_s=submitted_s))

    assert only(OrderTime(max_time_s=30.0), done, kit((GEAR, ORIGIN))).verdict is verdict


def test_without_a_limit_no_time_is_too_long() -> None:
    assert only(OrderTime(), trial(handed_in(at_s=1e9)), kit((GEAR, ORIGIN))).verdict is SATISFIED


def test_without_an_announcement_there_is_no_order_time() -> None:
    order = Order("order_0", (Task("s"),), announced_s=None)

    finding = only(OrderTime(), trial(handed_in()), order)

    assert finding.verdict is INCONCLUSIVE
    assert finding.quantities == {}


def test_an_order_without_kits_has_no_kitting_time() -> None:
    assert only(OrderTime(), trial(), Order("order_0", announced_s=1.0)).verdict is NOT_APPLICABLE


# The movable tray of 2022 --------------------------------------------------------------

SHINY, GREEN = "movable_tray_metal_shiny", "movable_tray_dark_wood"
TRAY_RULES = [TrayRight(), TrayRight(compare="pose")]


def on_tray(type_: str, pose: Pose | None = ORIGIN) -> Trial:
    return trial(handed_in(part(), tray=Tray(type_, pose)))


@pytest.mark.parametrize(("got", "verdict"), [(SHINY, SATISFIED), (GREEN, VIOLATED)])
def test_the_tray_must_be_of_the_ordered_type(got: str, verdict: Verdict) -> None:
    assert only(TrayRight(), on_tray(got), kit((GEAR, ORIGIN), tray=Tray(SHINY))).verdict is verdict


@pytest.mark.parametrize("x", [0.10, -0.10])
def test_a_tray_ten_centimetres_from_the_middle_passes_and_the_next_number_fails(x: float) -> None:
    order, rule = kit((GEAR, ORIGIN), tray=Tray(SHINY)), TrayRight(compare="pose")
    beyond = float(np.nextafter(x, 2 * x))

    assert (
        only(rule, on_tray(GREEN, at(x)), order).verdict is SATISFIED
    )  # the type is another rule's business
    assert only(rule, on_tray(SHINY, at(beyond)), order).verdict is VIOLATED


@pytest.mark.parametrize(("w", "verdict"), [(0.95, SATISFIED), (float(np.nextafter(0.95, 0.0)), VIOLATED)])
def test_a_tray_may_be_turned_as_far_as_the_dot_product_allows(w: float, verdict: Verdict) -> None:
    turned = on_tray(SHINY, Pose((0.0, 0.0, 0.0), (w, 0.0, 0.0, 0.0)))

    finding = only(TrayRight(compare="pose"), turned, kit((GEAR, ORIGIN), tray=Tray(SHINY)))

    assert finding.verdict is verdict


def test_the_yaw_of_the_tray_has_no_test_of_its_own() -> None:
    # rulebooks, section 6: the yaw check that follows can only set the flag to true again
    turned = on_tray(SHINY, at(yaw=0.6))  # dot = cos(0.3) = 0.955

    assert only(TrayRight(compare="pose"), turned, kit((GEAR, ORIGIN), tray=Tray(SHINY))).verdict is SATISFIED


@pytest.mark.parametrize("rule", TRAY_RULES, ids=lambda rule: rule.compare)
def test_a_tray_that_the_log_does_not_show_is_undecided(rule: TrayRight) -> None:
    order = kit((GEAR, ORIGIN), tray=Tray(SHINY))

    assert only(rule, trial(handed_in(part())), order).verdict is INCONCLUSIVE
    assert only(rule, trial(witnessed=()), order).verdict is INCONCLUSIVE
    assert only(rule, trial(), order).verdict is NOT_APPLICABLE


def test_a_tray_of_known_type_but_unknown_pose_decides_the_type_only() -> None:
    order = kit((GEAR, ORIGIN), tray=Tray(SHINY))

    assert [only(rule, on_tray(SHINY, None), order).verdict for rule in TRAY_RULES] == [
        SATISFIED,
        INCONCLUSIVE,
    ]


@pytest.mark.parametrize("rule", TRAY_RULES, ids=lambda rule: rule.compare)
def test_before_2022_no_tray_is_needed(rule: TrayRight) -> None:
    assert only(rule, on_tray(GREEN), kit((GEAR, ORIGIN))).verdict is NOT_APPLICABLE


# What is not a kit ---------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["assembly", "combined"])
def test_a_task_of_another_kind_is_undecided_and_never_left_out_in_silence(kind: str) -> None:
    order = Order("order_0", (Task("s"), Task("a", kind=kind)), announced_s=10.0)

    finding = only(OnlyKitting(), trial(), order)

    assert finding.verdict is INCONCLUSIVE
    assert kind in finding.message


def test_an_order_for_kits_only_is_one() -> None:
    assert only(OnlyKitting(), trial(), kit((GEAR, ORIGIN))).verdict is SATISFIED


@pytest.mark.parametrize("rule", [*PER_SLOT, *PER_TRAY, Submitted(), Destination(), *TRAY_RULES], ids=repr)
def test_a_rule_about_kits_says_of_an_assembly_that_it_does_not_judge_it(rule: Rule) -> None:
    task = Task("s", kind="assembly", products=(WantedProduct("p", GEAR, ORIGIN),), tray=Tray(SHINY))

    finding = only(rule, trial(handed_in(part())), Order("order_0", (task,), 10.0))

    assert (finding.verdict, finding.subject) == (NOT_APPLICABLE, "order_0/s")


@pytest.mark.parametrize("kits", [(), (Task("s"),)], ids=["alone", "beside a kit"])
@pytest.mark.parametrize(
    ("rules", "kind"),
    [
        ("paper2020.published", "assembly"),
        ("ariac2020.as_coded", "assembly"),
        ("ariac2022.as_coded", "combined"),
    ],
)
def test_a_task_of_another_kind_withholds_the_score_of_a_rule_set_without_rules_for_it(
    rules: str, kind: str, kits: tuple[Task, ...]
) -> None:
    order = Order("order_0", (Task("a", kind=kind), *kits), announced_s=1.0)
    dropped_witnessed = frozenset({"submissions", "arm_collision", "part_dropped"})

    result = scored(replace(kitting_trial(), work=(order,), witnessed=dropped_witnessed), rules)

    assert (result.status, result.score) == ("incomplete", None)
    assert [assumption.check for assumption in result.assumptions] == ["only_kitting"]


# Names without a colour ------------------------------------------------------------------

# ARIAC 2020 to 2022, code: the simulator cuts the colour off each name it compares, and aborts at one
# without `_`. It takes each ordered product in turn, compares it with the delivered ones that are left up
# to the first that matches, and takes that one away. By hand: which comparison meets the name first?
RED, BLUE, NAMELESS = "pump_red", "pump_blue", "gear"


@pytest.mark.parametrize("without_color", ["aborts", "aborts_unless_exact"])
@pytest.mark.parametrize(
    ("ordered", "delivered", "aborting"),
    [
        ((RED,), (RED, NAMELESS), ""),  # found before the name is met
        ((RED,), (), ""),
        ((RED, RED), (RED, RED, NAMELESS), ""),
        (
            (RED, RED),
            (RED, NAMELESS),
            NAMELESS,
        ),  # the one pump is taken away: the second order meets the name
        ((RED, RED), (RED, RED), ""),
        ((RED, "disk_red"), (RED, NAMELESS), NAMELESS),
        ((NAMELESS,), (RED,), NAMELESS),  # of what was ordered, too
        ((RED,), (NAMELESS,), NAMELESS),
    ],
)
def test_the_simulator_aborts_at_the_first_name_without_a_colour_that_it_compares(
    without_color: Any, ordered: tuple[str, ...], delivered: tuple[str, ...], aborting: str
) -> None:
    rule = Presence(compare="type", without_color=without_color)
    order, tray = kit(*((kind, ORIGIN) for kind in ordered)), trial(handed_in(*map(part, delivered)))

    found = list(rule.judge(tray, order))

    assert [f.verdict is INCONCLUSIVE for f in found] == [bool(aborting)] * len(ordered)
    assert all(repr(aborting) in f.message for f in found if aborting)


@pytest.mark.parametrize(
    ("ordered", "delivered", "aborts", "aborts_unless_exact"),
    [
        ((RED,), (NAMELESS, RED), True, False),
        ((BLUE,), (NAMELESS, RED), True, True),
        ((BLUE, BLUE), (RED, NAMELESS, BLUE), True, False),  # exact: blue, then red is the first left
        ((RED, RED), (NAMELESS, RED), True, True),  # only one is exact
    ],
)
def test_in_2020_the_exact_name_is_looked_for_before_types_are_compared(
    ordered: tuple[str, ...], delivered: tuple[str, ...], aborts: bool, aborts_unless_exact: bool
) -> None:
    order, tray = kit(*((kind, ORIGIN) for kind in ordered)), trial(handed_in(*map(part, delivered)))

    def aborted(without_color: Any) -> bool:
        rule = Presence(compare="type", without_color=without_color)
        return INCONCLUSIVE in verdicts(rule, tray, order)

    assert (aborted("aborts"), aborted("aborts_unless_exact")) == (aborts, aborts_unless_exact)
