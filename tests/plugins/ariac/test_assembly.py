"""Briefcases, wrong colours, names and greedy matching: where a log decides nothing, and laws.

What they are worth is worked out case by case in `tests/cases/worked`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import permutations
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Event, Finding, Pose, Rule, Span, Trial, Verdict, Worlds, measure_trial
from ariac_score.engine.prepared import prepare
from ariac_score.results.doubt import left_open
from ariac_score.scoring.pricing import price
from ariac_score_ariac.tasks import (
    AssemblyCounters,
    AssemblyPart,
    Destination,
    KitPose,
    NoneFaulty,
    NoneMissing,
    NoneUnwanted,
    OnlyKitting,
    OrderTime,
    Presence,
    RightNumber,
    Submitted,
    WrongColorPose,
)
from ariac_score_ariac.tasks.poses import best_assignment, greedy_assignment
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, WantedProduct

SATISFIED, VIOLATED = Verdict.SATISFIED, Verdict.VIOLATED
INCONCLUSIVE, NOT_APPLICABLE = Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE
LAWS = settings(max_examples=150, derandomize=True, deadline=None)

PUMP, BLUE = "assembly_pump_red", "assembly_pump_blue"

OF_ASSEMBLIES: list[Rule] = [
    AssemblyPart(),
    AssemblyPart(matching="first_in_place", compare="type_pose_and_color", max_heading_error_rad=None),
    AssemblyCounters(),
    NoneMissing(kind="assembly"),
    NoneUnwanted(kind="assembly"),
    NoneFaulty(kind="assembly"),
    Submitted(kind="assembly"),
    Destination(kind="assembly", compare="station"),
]
OF_KITS: list[Rule] = [WrongColorPose(), RightNumber()]


def at(x: float, yaw: float = 0.0) -> Pose:
    return Pose.from_rpy((x, 0.0, 0.0), (0.0, 0.0, yaw))


def order(kind: str, *wanted: tuple[str, Pose | None], **task: Any) -> Order:
    products = tuple(WantedProduct(f"part_{i}", name, pose) for i, (name, pose) in enumerate(wanted))
    return Order("o", (Task("s", kind, products, **task),), announced_s=10.0)


def handed_in(*contents: Product, at_s: float = 20.0, station: str = "as1") -> KitSubmission:
    return KitSubmission("s", at_s, contents, "agv1", station)


def trial(*submissions: KitSubmission, witnessed: Iterable[str] = ("submissions",)) -> Trial:
    return Trial("t", submissions=submissions, witnessed=frozenset(witnessed))


def verdicts(rule: Rule, of: Trial, wanted: Order) -> list[Verdict]:
    return [finding.verdict for finding in rule.judge(of, wanted)]


def only(rule: Rule, of: Trial, wanted: Order) -> Finding:
    (finding,) = rule.judge(of, wanted)
    return finding


# What a log does not show --------------------------------------------------------------


@pytest.mark.parametrize("rule", OF_ASSEMBLIES, ids=repr)
def test_without_a_record_of_submissions_nothing_about_an_assembly_is_decided(rule: Rule) -> None:
    assert verdicts(rule, trial(witnessed=()), order("assembly", (PUMP, at(0)))) == [INCONCLUSIVE]


@pytest.mark.parametrize("rule", OF_KITS, ids=repr)
def test_without_a_record_of_submissions_nothing_about_a_kit_is_decided(rule: Rule) -> None:
    assert verdicts(rule, trial(witnessed=()), order("kitting", (PUMP, at(0)))) == [INCONCLUSIVE]


@pytest.mark.parametrize("rule", [*OF_ASSEMBLIES[:6], *OF_KITS], ids=repr)
def test_unknown_contents_are_undecided(rule: Rule) -> None:
    unseen = trial(KitSubmission("s", 20.0, contents=None))
    kind = "kitting" if rule in OF_KITS else "assembly"

    assert verdicts(rule, unseen, order(kind, (PUMP, at(0)))) == [INCONCLUSIVE]


@pytest.mark.parametrize("rule", [*OF_ASSEMBLIES, *OF_KITS], ids=repr)
def test_a_task_of_another_kind_is_not_judged_and_not_passed_over(rule: Rule) -> None:
    kind = "assembly" if rule in OF_KITS else "kitting"

    finding = only(rule, trial(handed_in(Product(PUMP, at(0)))), order(kind, (PUMP, at(0))))

    assert (finding.verdict, finding.subject) == (NOT_APPLICABLE, "o/s")


@pytest.mark.parametrize("rule", OF_ASSEMBLIES[:3], ids=repr)
@pytest.mark.parametrize(
    ("wanted", "delivered"), [(None, at(0)), (at(0), None)], ids=["ordered", "delivered"]
)
def test_a_pose_that_is_not_usable_leaves_a_briefcase_undecided(
    rule: Rule, wanted: Pose | None, delivered: Pose | None
) -> None:
    briefcase = trial(handed_in(Product(PUMP, delivered)))

    assert verdicts(rule, briefcase, order("assembly", (PUMP, wanted))) == [INCONCLUSIVE]


@pytest.mark.parametrize("rule", OF_ASSEMBLIES[:3], ids=repr)
def test_the_pose_of_a_faulty_product_is_not_needed(rule: Rule) -> None:
    briefcase = trial(handed_in(Product(PUMP, None, faulty=True), Product(PUMP, at(0))))

    assert verdicts(rule, briefcase, order("assembly", (PUMP, at(0)))) == [SATISFIED]


@pytest.mark.parametrize("rule", OF_ASSEMBLIES[:3], ids=repr)
def test_more_products_than_any_briefcase_holds_are_refused_not_searched(rule: Rule) -> None:
    wanted = order("assembly", *[(PUMP, at(0))] * 10)

    assert set(verdicts(rule, trial(handed_in(Product(PUMP, at(0)))), wanted)) == {INCONCLUSIVE}


@pytest.mark.parametrize("rule", OF_ASSEMBLIES[:2], ids=repr)
def test_an_order_for_an_empty_briefcase_has_nothing_to_judge(rule: Rule) -> None:
    assert only(rule, trial(handed_in()), order("assembly")).verdict is NOT_APPLICABLE


@pytest.mark.parametrize(
    ("rule", "verdict"),
    [
        (AssemblyPart(), VIOLATED),
        (AssemblyCounters(), NOT_APPLICABLE),
        (NoneMissing(kind="assembly"), VIOLATED),
    ],
    ids=repr,
)
def test_a_briefcase_never_submitted_earns_nothing(rule: Rule, verdict: Verdict) -> None:
    assert verdicts(rule, trial(), order("assembly", (PUMP, at(0)))) == [verdict]


def test_what_is_missing_is_listed_by_name() -> None:
    battery = "assembly_battery_blue"
    wanted = order("assembly", (PUMP, at(0)), (battery, at(0.1)), (PUMP, at(0.2)))

    finding = only(NoneMissing(kind="assembly"), trial(handed_in()), wanted)

    assert finding.message == "1 blue assembly battery, 2 red assembly pumps missing"


@pytest.mark.parametrize(
    ("count", "message"), [(1, "1 of 2 products"), (2, "nothing is missing"), (3, "nothing is missing")]
)
def test_where_only_the_number_counts_any_product_stands_for_any_other(count: int, message: str) -> None:
    wanted = order("assembly", (PUMP, at(0)), (PUMP, at(0.1)))
    briefcase = trial(handed_in(*[Product("assembly_battery_blue", at(0))] * count))

    finding = only(NoneMissing(kind="assembly", compare="number"), briefcase, wanted)

    assert finding.verdict is (VIOLATED if count < 2 else SATISFIED)
    assert message in finding.message


# Briefcases ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("compare", "messages"),
    [
        ("type", ["assembly_pump_red is noted for it", "another assembly_pump_red was noted before it"]),
        (
            "type_and_pose",
            ["assembly_pump_red is noted for it", "another assembly_pump_red was noted before it"],
        ),
    ],
)
def test_the_second_of_two_alike_is_reported_to_have_fallen_into_the_first(
    compare: Any, messages: list[str]
) -> None:
    wanted = order("assembly", (PUMP, at(0)), (PUMP, at(0.1)))
    briefcase = trial(handed_in(Product(PUMP, at(0)), Product(PUMP, at(0.1))))

    assert [f.message for f in AssemblyPart(compare=compare).judge(briefcase, wanted)] == messages


@pytest.mark.parametrize(
    ("x", "verdict"), [(0.02, SATISFIED), (0.0200001, VIOLATED)], ids=["at the limit", "beyond"]
)
def test_two_centimetres_are_the_limit_of_an_assembly(x: float, verdict: Verdict) -> None:
    briefcase = trial(handed_in(Product(PUMP, at(x))))

    for matching in ("by_type_then_permutations", "first_in_place"):
        rule = AssemblyPart(matching=matching)
        assert verdicts(rule, briefcase, order("assembly", (PUMP, at(0)))) == [verdict]


@pytest.mark.parametrize(("limit", "verdict"), [(0.1, VIOLATED), (None, SATISFIED)])
def test_without_a_limit_the_yaw_is_not_tested(limit: float | None, verdict: Verdict) -> None:
    briefcase = trial(handed_in(Product(PUMP, at(0, yaw=0.3))))

    assert verdicts(
        AssemblyPart(max_heading_error_rad=limit), briefcase, order("assembly", (PUMP, at(0)))
    ) == [verdict]


@pytest.mark.parametrize("matching", ["by_type_then_permutations", "first_in_place", "best_assignment"])
def test_two_products_in_place_are_counted_once_each(matching: Any) -> None:
    asked = order("assembly", (PUMP, at(0)), ("assembly_gear_red", at(0.1)))
    briefcase = trial(handed_in(Product(PUMP, at(0)), Product("assembly_gear_red", at(0.1))))

    found = only(AssemblyCounters(matching=matching), briefcase, asked).quantities

    assert {name: found[name] for name in ("types_alike", "poses_alike", "records", "delivered")} == {
        "types_alike": 2,
        "poses_alike": 2,
        "records": 2,
        "delivered": 2,
    }


# Wrong colours -------------------------------------------------------------------------


@pytest.mark.parametrize(("counting", "counted"), [("each_delivered_type", 2), ("once", 1)])
def test_a_pair_of_wrong_color_counts_for_each_delivered_type_or_once(counting: Any, counted: int) -> None:
    wanted = order("kitting", (PUMP, at(0)), ("a_red", at(0.1)), ("b_red", at(0.2)))
    tray = trial(handed_in(Product(BLUE, at(0)), Product("a_red", at(0.1)), Product("b_red", at(0.2))))

    finding = only(WrongColorPose(counting=counting), tray, wanted)

    assert (finding.verdict, finding.quantities["counted"]) == (VIOLATED, counted)


def test_a_wrong_color_elsewhere_and_a_faulty_one_in_place_are_no_pair() -> None:
    wanted = order("kitting", (PUMP, at(0)), ("a_red", at(0.1)))
    tray = trial(
        handed_in(Product(BLUE, at(0.5)), Product(BLUE, at(0), faulty=True), Product("a_red", at(0.1)))
    )

    finding = only(WrongColorPose(), tray, wanted)

    assert (finding.verdict, dict(finding.quantities)) == (SATISFIED, {"pairs": 0, "groups": 1, "counted": 0})


def test_an_unknown_pose_of_a_wrong_color_decides_only_where_it_would_count() -> None:
    wanted = order("kitting", (PUMP, at(0)), ("a_red", at(0.1)))
    blue = Product(BLUE, None)

    assert (
        only(WrongColorPose(), trial(handed_in(blue, Product("a_red", at(0.1)))), wanted).verdict
        is INCONCLUSIVE
    )
    assert only(WrongColorPose(), trial(handed_in(blue)), wanted).verdict is SATISFIED


# Names, numbers, places ----------------------------------------------------------------


@pytest.mark.parametrize(("names", "verdict"), [("whole", VIOLATED), ("after_colon", SATISFIED)])
def test_a_prefix_is_cut_off_where_the_rule_set_says_so(names: Any, verdict: Verdict) -> None:
    wanted = order("kitting", (PUMP, at(0)))
    tray = trial(handed_in(Product(f"agv1::tray::{PUMP}", at(0))))
    rules: list[Rule] = [
        Presence(type_names=names),
        Presence(compare="type", type_names=names),
        KitPose(type_names=names),
        NoneMissing(type_names=names),
        NoneUnwanted(type_names=names),
    ]

    assert [verdicts(rule, tray, wanted) for rule in rules] == [[verdict]] * 5


@pytest.mark.parametrize(("count_faulty", "verdict"), [(True, VIOLATED), (False, SATISFIED)])
def test_a_faulty_product_counts_in_the_number_or_not(count_faulty: bool, verdict: Verdict) -> None:
    tray = trial(handed_in(Product(PUMP, at(0)), Product(PUMP, at(0), faulty=True)))

    assert verdicts(RightNumber(count_faulty=count_faulty), tray, order("kitting", (PUMP, at(0)))) == [
        verdict
    ]


@pytest.mark.parametrize(
    ("known", "agv", "verdict"),
    [((), "agv3", VIOLATED), ((), "", SATISFIED), (("agv1",), "", VIOLATED), (("agv1",), "any", SATISFIED)],
)
def test_an_agv_that_is_not_known_is_never_right(known: tuple[str, ...], agv: str, verdict: Verdict) -> None:
    wanted = order("kitting", (PUMP, at(0)), agv=agv)

    assert verdicts(Destination(known_agvs=known), trial(handed_in()), wanted) == [verdict]


def test_of_two_kinds_of_task_the_later_complete_one_gives_the_time() -> None:
    both = Order("o", (Task("k"), Task("a", "assembly")), announced_s=10.0)
    rule = OrderTime(kinds=("kitting", "assembly"))
    kit, briefcase = KitSubmission("k", 30.0, ()), KitSubmission("a", 20.0, ())

    assert only(rule, trial(briefcase, kit), both).quantities["time_taken_s"] == 10.0
    unfinished = only(rule, trial(kit), both)
    assert (unfinished.verdict, unfinished.quantities["time_taken_s"]) == (VIOLATED, 20.0)
    assert only(rule, trial(), both).verdict is VIOLATED


def test_kinds_of_task_the_rule_set_names_are_covered() -> None:
    rule = OnlyKitting(kinds=("kitting", "assembly"))

    assert only(rule, trial(), order("assembly")).verdict is SATISFIED
    assert only(rule, trial(), order("combined")).verdict is INCONCLUSIVE


# Claiming and greedy matching ----------------------------------------------------------


@pytest.mark.parametrize(("submitted_s", "verdict"), [(9.9, VIOLATED), (10.0, SATISFIED)])
def test_submissions_count_from_the_first_announcement(submitted_s: float, verdict: Verdict) -> None:
    announced = Event(10.0, "order_announced", "o")
    of = Trial(
        "t",
        events=(announced,),
        submissions=(handed_in(at_s=submitted_s),),
        witnessed=frozenset({"submissions"}),
    )
    updated = Order("o", (Task("s"),), announced_s=50.0)

    assert verdicts(Submitted(counts_from="announcement"), of, updated) == [verdict]
    assert verdicts(Submitted(counts_from="update"), of, updated) == [VIOLATED]


@pytest.mark.parametrize(("passes", "verdict"), [(False, VIOLATED), (True, SATISFIED)])
def test_a_heading_error_at_the_limit_passes_where_the_rule_set_says_so(
    passes: bool, verdict: Verdict
) -> None:
    turned = at(0, yaw=0.1)
    wanted, tray = order("kitting", (PUMP, at(0))), trial(handed_in(Product(PUMP, turned)))
    rule = KitPose(heading_limit_passes=passes, max_heading_error_rad=abs(turned.yaw_rad))

    assert verdicts(rule, tray, wanted) == [verdict]


@given(passing=st.lists(st.lists(st.integers(0, 4), unique=True), max_size=5))
@LAWS
def test_greedy_fills_as_the_simulator_walks_and_never_more_than_the_best(passing: list[list[int]]) -> None:
    found = greedy_assignment(passing, 5)

    # Rulebook, section 1: each delivered part in turn takes the first free place where it passes.
    free = list(range(len(passing)))
    for part in range(5):
        place = next((slot for slot in free if part in passing[slot]), None)
        assert [slot for slot, taken in enumerate(found) if taken == part] == (
            [] if place is None else [place]
        )
        if place is not None:
            free.remove(place)
    filled = sum(part is not None for part in found)
    assert filled <= sum(part is not None for part in best_assignment(passing))


@pytest.mark.slow
@given(
    names=st.lists(st.sampled_from([PUMP, BLUE, "assembly_battery_red"]), min_size=1, max_size=4),
    places=st.permutations(range(4)),
)
@LAWS
def test_a_briefcase_never_earns_more_than_one_record_for_each_name(
    names: list[str], places: list[int]
) -> None:
    wanted = order("assembly", *((name, at(0.1 * i)) for i, name in enumerate(names)))
    delivered = [Product(names[i], at(0.1 * i)) for i in places if i < len(names)]

    for contents in permutations(delivered):
        found = verdicts(AssemblyPart(), trial(handed_in(*contents)), wanted)
        assert found.count(SATISFIED) == len(set(names))  # all lie right, so each name is noted once


# A briefcase holds five products; beyond nine of a type not all orders of them are tried, 10! of them.
@pytest.mark.parametrize("matching", ["by_type_then_permutations", "best_assignment"])
@pytest.mark.parametrize(("delivered", "verdict"), [(9, SATISFIED), (10, INCONCLUSIVE)])
def test_more_products_than_a_briefcase_can_hold_are_undecided(
    matching: Any, delivered: int, verdict: Verdict
) -> None:
    briefcase = trial(handed_in(*(Product(PUMP, at(0.1 * k)) for k in range(delivered))))

    finding = only(AssemblyPart(matching=matching), briefcase, order("assembly", (PUMP, at(0))))

    assert finding.verdict is verdict
    assert ("more than 9 products" in finding.message) == (verdict is INCONCLUSIVE)


def test_products_of_other_types_are_not_permuted_and_do_not_count() -> None:
    others = [Product(BLUE, at(0.1 * k)) for k in range(1, 11)]
    briefcase = trial(handed_in(Product(PUMP, at(0)), *others))

    assert only(AssemblyPart(), briefcase, order("assembly", (PUMP, at(0)))).verdict is SATISFIED


# What is undecided, between two ends ---------------------------------------------------


def counted(rule: WrongColorPose, of: Trial, wanted: Order) -> tuple[float, float]:
    """How often a wrong colour counts in the worst and in the best world."""
    finding, worlds = rule.judge_worlds(of, wanted)
    assert isinstance(finding, Finding)
    assert finding.verdict is INCONCLUSIVE
    assert isinstance(worlds, Worlds)
    (worst,), (best,) = worlds.worst, worlds.best
    return worst.quantities["counted"], best.quantities["counted"]


def test_a_wrong_color_of_unknown_pose_counts_between_never_and_in_every_place() -> None:
    """Rulebook of 2021, section 5: each pair of ordered and wrong product once for each exact type delivered.

    One exact type is there, so the one place for which the colour is wrong gives 0 or 1. With two exact types
    and one more pair that is seen it is 2 x 1 or 2 x 2.
    """
    wanted = order("kitting", (PUMP, at(0)), ("a_red", at(0.1)))
    unknown = Product(BLUE, None)
    one_type = trial(handed_in(unknown, Product("a_red", at(0.1))))
    assert counted(WrongColorPose(), one_type, wanted) == (0, 1)

    three = order("kitting", (PUMP, at(0)), ("a_red", at(0.1)), ("b_red", at(0.2)))
    seen = (Product(BLUE, at(0)), unknown, Product("a_red", at(0.1)), Product("b_red", at(0.2)))
    assert counted(WrongColorPose(), trial(handed_in(*seen)), three) == (2, 4)
    assert counted(WrongColorPose(counting="once"), trial(handed_in(*seen)), three) == (1, 1)


def test_of_unknown_contents_every_place_may_hold_one_of_the_wrong_color() -> None:
    """At most two places by two exact types; with two in each place, as a referee may assume, twice that."""
    wanted = order("kitting", (PUMP, at(0)), ("a_red", at(0.1)))
    unseen = trial(KitSubmission("s", 20.0, contents=None))

    assert counted(WrongColorPose(), unseen, wanted) == (0, 4)
    assert counted(WrongColorPose(most_in_place=2), unseen, wanted) == (0, 8)
    assert counted(WrongColorPose(counting="once"), unseen, wanted) == (0, 2)


def test_an_order_of_which_nobody_saw_a_delivery_took_from_no_time_to_all_that_was_left() -> None:
    seen = replace(trial(witnessed=()), recorded=Span(0.0, 100.0))
    finding, worlds = OrderTime().judge_worlds(seen, order("kitting", (PUMP, at(0))))

    assert isinstance(finding, Finding)
    assert isinstance(worlds, Worlds)
    times = [world[0].quantities["time_taken_s"] for world in (worlds.best, worlds.worst)]
    assert times == [0.0, 90.0]  # announced at 10 s


def test_a_kit_whose_contents_nobody_saw_has_a_score_between_nothing_and_all_that_the_rules_give() -> None:
    """ARIAC 2021, finals as coded, two products, right AGV: at most 2 for types, 2 for colours, 6 for poses.

    2 of these are right ones, 4 are 2 x 2 of the wrong colour. The bonus wants exactly 2 poses, so it adds
    nothing to these 10; with it instead of the wrong colours it is 2 + 2 + 2 + 2 = 8.
    """
    wanted = order("kitting", (PUMP, at(0)), ("a_red", at(0.1)), agv="agv1", station="as1")
    unseen = Trial(
        "t",
        work=(wanted,),
        submissions=(KitSubmission("s", 20.0, None, "agv1", "as1"),),
        events=(Event(0.0, "competition_started"), Event(100.0, "competition_ended")),
        witnessed=frozenset({"submissions", "arm_collision", "part_dropped", "bodies"}),
        recorded=Span(0.0, 100.0),
    )
    rules = prepare("ariac2021.finals_as_coded")
    measured = measure_trial(unseen, rules)
    rule_set = rules.rule_set
    found = price(
        measured.findings,
        measured.scopes,
        rule_set.sheet,
        rule_set.policies,
        digits=2,
        measures=measured.measures,
        left_open=left_open(measured, rule_set),
    ).interval

    assert found is not None
    assert found.least == 0
    assert 10 <= found.most <= 12  # the bonus of 2, which nothing ties to the poses
    assert not found.tight
