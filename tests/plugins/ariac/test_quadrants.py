"""Kits of 2023 and 2024, by quadrant: every number worked from the rulebook (sections 7 and 8).

Helpers put one part at (+-0.1, +-0.1) in each quadrant: 1 is (-, +), 2 (+, +), 3 (-, -), 4 (+, -).
"""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from ariac_score import (
    Event,
    Finding,
    LogMap,
    Pose,
    Rule,
    RuleSet,
    Trial,
    Verdict,
    Wanted,
    load_rule_set,
    measure_trial,
)
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.engine.price import price_trial
from ariac_score.logs.jsonl import FORMAT, JsonLinesReader
from ariac_score.results.result import Pinned, Provenance, Result
from ariac_score_ariac.tasks import ExtraParts, OrderSubmitted, QuadrantPart, TaskKind, TrayNumber
from ariac_score_ariac.tasks.quadrants import quadrant_of
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, Tray, WantedProduct

SATISFIED, VIOLATED = Verdict.SATISFIED, Verdict.VIOLATED
INCONCLUSIVE, NOT_APPLICABLE = Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE

PLACES = {1: (-0.1, 0.1), 2: (0.1, 0.1), 3: (-0.1, -0.1), 4: (0.1, -0.1)}
AS_2023, RELEASE_3, RELEASE_5 = "ariac2023.as_coded", "ariac2024.release_3", "ariac2024.release_5"
BOTH_YEARS = [AS_2023, RELEASE_5]
TRAY = Tray("kit_tray_03")


def at(x: float, y: float, z: float = 0.0, *, roll: float = 0.0, pitch: float = 0.0) -> Pose:
    return Pose.from_rpy((x, y, z), (roll, pitch, 0.0))


def part(kind: str, quadrant: int, *, roll: float = 0.0, faulty: bool = False, name: str = "") -> Product:
    x, y = PLACES[quadrant]
    return Product(kind, at(x, y, roll=roll), faulty, name)


WANTED = ("battery_blue", "pump_purple", "sensor_green", "regulator_orange")
PERFECT = tuple(part(kind, quadrant) for quadrant, kind in enumerate(WANTED, start=1))


def kit(*wanted: str, quadrants: Iterable[int] = (1, 2, 3, 4), challenged: bool | None = None) -> Order:
    products = tuple(
        WantedProduct(f"part_{i}", kind, None, quadrant, challenged)
        for i, (kind, quadrant) in enumerate(zip(wanted, quadrants, strict=False))
    )
    task = Task("ABCD1234", "kitting", products, "agv2", "warehouse", Tray("kit_tray_03"))
    return Order("ABCD1234", (task,), announced_s=0.0)


def trial(
    contents: Iterable[Product] | None = PERFECT,
    *,
    order: Order | None = None,
    tray: Tray | None = TRAY,
    agv: str = "agv2",
    station: str = "warehouse",
    events: Iterable[Event] = (),
    witnessed: Iterable[str] = ("submissions",),
) -> Trial:
    held = None if contents is None else tuple(contents)
    return Trial(
        "t",
        work=(order or kit(*WANTED),),
        submissions=(KitSubmission("ABCD1234", 100.0, held, agv, station, tray),),
        events=tuple(events),
        witnessed=frozenset(witnessed),
    )


@cache
def rules_of(name: str) -> tuple[RuleSet, Registry]:
    return load_rule_set(name), Registry()


def scored(of: Trial, rules: str) -> Result:
    rule_set, registry = rules_of(rules)
    measured = measure_trial(of, prepare(rule_set, registry=registry))
    return price_trial(measured, rule_set, Provenance((), (), Pinned("", ""), Pinned("", ""), ()))


def score(of: Trial, rules: str) -> int:
    result = scored(of, rules)
    assert result.status == "scored"
    assert result.score is not None
    return int(result.score)


def found(rule: QuadrantPart | TrayNumber | ExtraParts | OrderSubmitted, of: Trial) -> list[Finding]:
    return list(rule.judge(of, of.work[0]))


def verdicts(rule: QuadrantPart | TrayNumber | ExtraParts | OrderSubmitted, of: Trial) -> list[Verdict]:
    return [finding.verdict for finding in found(rule, of)]


# The whole kit -------------------------------------------------------------------------


# 2023: tray 3 + 4 * 3 + bonus 4 = 19; 2024: tray 1 + 4 * 3 + bonus 4 = 17
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 19), (RELEASE_3, 17), (RELEASE_5, 17)])
def test_a_perfect_kit_of_four_is_worth_the_maximum(rules: str, points: int) -> None:
    result = scored(trial(), rules)

    assert [result.score, result.possible] == [points, points]


# n = 1: 3 + 3 + 1 = 7 and 1 + 3 + 1 = 5
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 7), (RELEASE_5, 5)])
def test_a_perfect_kit_of_one(rules: str, points: int) -> None:
    assert score(trial(PERFECT[:1], order=kit("battery_blue")), rules) == points


# One of four, its colour wrong: 3 + (3 + 3 + 3 + 2) + 0 = 14; 1 + 11 = 12
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 14), (RELEASE_5, 12)])
def test_a_wrong_colour_costs_one_point_and_the_bonus(rules: str, points: int) -> None:
    assert score(trial([part("battery_red", 1), *PERFECT[1:]]), rules) == points


# One of four turned over: 2023 2 points for it, 3 + 11 = 14; 2024 none, 1 + 9 = 10
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 14), (RELEASE_5, 10)])
def test_a_flipped_part_costs_one_point_in_2023_and_all_in_2024(rules: str, points: int) -> None:
    assert score(trial([part("battery_blue", 1, roll=math.pi), *PERFECT[1:]]), rules) == points


# Colour wrong and flipped: 2023 3 - 1 - 1 = 1, 3 + 10 = 13; 2024 0, 1 + 9 = 10
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 13), (RELEASE_5, 10)])
def test_a_flipped_part_of_the_wrong_colour(rules: str, points: int) -> None:
    assert score(trial([part("battery_red", 1, roll=math.pi), *PERFECT[1:]]), rules) == points


# Type wrong, or quadrant empty: 3 + 9 = 12; 1 + 9 = 10
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 12), (RELEASE_5, 10)])
@pytest.mark.parametrize("first", [[part("pump_blue", 1)], []])
def test_a_wrong_type_or_an_empty_quadrant_is_worth_nothing(
    first: list[Product], rules: str, points: int
) -> None:
    assert score(trial([*first, *PERFECT[1:]]), rules) == points


# The bonus needs 3n, whatever the tray: 2023 0 + 12 + 4 = 16; 2024 0 + 12 + 4 = 16, and no point less (DIFF)
@pytest.mark.parametrize("rules", BOTH_YEARS)
def test_the_wrong_tray_loses_its_points_and_nothing_else(rules: str) -> None:
    assert score(trial(tray=Tray("kit_tray_04")), rules) == 16


@pytest.mark.parametrize("rules", BOTH_YEARS)
def test_a_kit_at_the_wrong_destination_is_worth_nothing(rules: str) -> None:
    assert score(trial(station="assembly_front"), rules) == 0


@pytest.mark.parametrize("rules", BOTH_YEARS)
def test_a_kit_on_another_agv_is_never_seen(rules: str) -> None:
    assert score(trial(agv="agv1"), rules) == 0


@pytest.mark.parametrize("rules", BOTH_YEARS)
def test_without_a_tray_there_are_no_parts(rules: str) -> None:
    assert score(trial(tray=Tray("")), rules) == 0


@pytest.mark.parametrize("rules", BOTH_YEARS)
def test_a_kit_never_handed_in_or_only_after_the_end_is_worth_nothing(rules: str) -> None:
    late = trial(events=[Event(99.0, "competition_ended")])

    assert score(replace(trial(), submissions=()), rules) == 0
    assert score(late, rules) == 0
    assert score(trial(events=[Event(100.0, "competition_ended")]), rules) > 0


# Extra parts and the floor -------------------------------------------------------------


# 6 parts for 4: 19 - 2 = 17; 17 - 2 = 15. They lie before the good ones, so those still count.
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 17), (RELEASE_5, 15)])
def test_every_extra_part_costs_one_point(rules: str, points: int) -> None:
    extra = [part("battery_blue", 1), part("pump_red", 2)]
    result = scored(trial([*extra, *PERFECT]), rules)

    assert result.score == points
    assert result.possible == points + 2


# n = 1, 5 parts elsewhere, wrong tray: 0 + 0 + 0 - 4 = -4
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 0), (RELEASE_3, -4), (RELEASE_5, -4)])
def test_2023_never_goes_below_zero_and_2024_does(rules: str, points: int) -> None:
    heap = [part("pump_red", 2)] * 5

    assert score(trial(heap, order=kit("battery_blue"), tray=Tray("kit_tray_01")), rules) == points


def test_a_negative_kit_at_the_wrong_destination_is_zero() -> None:
    heap = trial([part("pump_red", 2)] * 5, order=kit("battery_blue"), station="kitting")

    assert score(heap, RELEASE_5) == 0


def test_what_is_no_part_is_not_seen() -> None:
    clutter = [Product("kit_tray_07", at(0.1, 0.1)), Product("battery_silver", at(-0.1, 0.1))]

    assert score(trial([*PERFECT, *clutter]), AS_2023) == 19


# Quadrants -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "y", "quadrant"),
    [
        (np.nextafter(0, -1), 0.0, 1),
        (0.0, 0.0, 2),
        (-0.0, -0.0, 2),
        (np.nextafter(0, -1), np.nextafter(0, -1), 3),
        (0.0, np.nextafter(0, -1), 4),
    ],
)
def test_the_axes_belong_to_the_positive_side(x: float, y: float, quadrant: int) -> None:
    assert quadrant_of(Pose((float(x), float(y), 0.0))) == quadrant


# The good battery is last, or overwritten by a pump: 3 + 3 + bonus 1 - extra 1 = 6, or 3 + 0 + 0 - 1 = 2
@pytest.mark.parametrize(
    ("kinds", "points"), [(("pump_red", "battery_blue"), 6), (("battery_blue", "pump_red"), 2)]
)
def test_the_last_part_in_a_quadrant_wins(kinds: tuple[str, str], points: int) -> None:
    pile = trial([part(kind, 1) for kind in kinds], order=kit("battery_blue"))

    assert score(pile, AS_2023) == points


# Both ordered in quadrant 1: only the product ordered last counts; 3 + (0 + 3) + 0 = 6 of n = 2
def test_of_two_products_ordered_in_one_quadrant_the_last_counts() -> None:
    twice = trial([part("battery_blue", 1)], order=kit("battery_blue", "battery_blue", quadrants=(1, 1)))

    assert verdicts(QuadrantPart(), twice) == [VIOLATED, SATISFIED]
    assert score(twice, AS_2023) == 6


# The flip test -------------------------------------------------------------------------


def tilted(angle_rad: float) -> Trial:
    return trial([part("battery_blue", 1, roll=angle_rad)], order=kit("battery_blue"))


@pytest.mark.parametrize(
    ("angle_rad", "verdict"), [(0.0, SATISFIED), (0.1999, SATISFIED), (0.2001, VIOLATED), (math.pi, VIOLATED)]
)
def test_a_part_is_flipped_from_an_angle_of_0_2_rad_on(angle_rad: float, verdict: Verdict) -> None:
    assert verdicts(QuadrantPart(compare="upright"), tilted(angle_rad)) == [verdict]


def test_the_angle_itself_is_flipped_already() -> None:
    rule = QuadrantPart(compare="upright", max_tilt_rad=0.3)
    pose = tilted(0.25).submissions[0].contents
    assert pose is not None
    assert pose[0].pose is not None
    angle_rad = rule.tilt_rad(pose[0].pose)

    at_it = replace(rule, max_tilt_rad=angle_rad)
    above = replace(rule, max_tilt_rad=float(np.nextafter(angle_rad, 1.0)))

    assert verdicts(at_it, tilted(0.25)) == [VIOLATED]
    assert verdicts(above, tilted(0.25)) == [SATISFIED]


# An upright part at (x, 0, z): angle atan(x / (1 + z)), flipped from x = tan(0.2) (1 + z) on: 0.2027, 0.2230
@pytest.mark.parametrize(
    ("x", "z", "flipped"),
    [(0.2026, 0.0, False), (0.2028, 0.0, True), (0.2228, 0.1, False), (0.2231, 0.1, True)],
)
def test_with_its_position_an_upright_part_far_out_counts_as_flipped(
    x: float, z: float, flipped: bool
) -> None:
    far = trial([Product("battery_blue", at(x, 0.0, z))], order=kit("battery_blue", quadrants=(2,)))

    with_position = QuadrantPart(compare="upright", flip_vector="axis_and_position")
    assert verdicts(with_position, far) == [VIOLATED if flipped else SATISFIED]
    assert verdicts(QuadrantPart(compare="upright"), far) == [SATISFIED]


# DIFF, issue 347: upright at 0.25 m, n = 1. 2023: 3 + 2 = 5; 2024.3: 1 + 0 = 1; 2024.5: 1 + 3 + 1 = 5
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 5), (RELEASE_3, 1), (RELEASE_5, 5)])
def test_the_releases_differ_in_the_flip_test_alone(rules: str, points: int) -> None:
    far = trial([Product("battery_blue", at(0.25, 0.0))], order=kit("battery_blue", quadrants=(2,)))

    assert score(far, rules) == points


# Tilted towards the middle: p = (0.1, 0, 0), axis (-sin 0.25, 0, cos 0.25); their sum is nearer the vertical
def test_with_its_position_a_tilted_part_can_count_as_upright() -> None:
    leaning = trial(
        [Product("battery_blue", at(0.1, 0.0, pitch=-0.25))], order=kit("battery_blue", quadrants=(2,))
    )

    assert verdicts(QuadrantPart(compare="upright"), leaning) == [VIOLATED]
    assert verdicts(QuadrantPart(compare="upright", flip_vector="axis_and_position"), leaning) == [SATISFIED]


def test_a_vector_of_length_zero_is_flipped() -> None:
    under = trial(
        [Product("battery_blue", Pose((0.0, 0.0, -1.0)))], order=kit("battery_blue", quadrants=(2,))
    )

    assert verdicts(QuadrantPart(compare="upright", flip_vector="axis_and_position"), under) == [VIOLATED]


def test_turning_about_the_vertical_never_flips() -> None:
    draw = random.Random(2024)  # noqa: S311  # the same draws each time
    for _ in range(100):
        pose = Pose.from_rpy((0.1, 0.1, 0.0), (0.0, 0.0, draw.uniform(-7, 7)))
        turned = trial([Product("battery_blue", pose)], order=kit("battery_blue", quadrants=(2,)))
        assert verdicts(QuadrantPart(compare="upright"), turned) == [SATISFIED]


# Faulty parts --------------------------------------------------------------------------

CHECKED = [Event(50.0, "quality_check", "ABCD1234")]
ALL_SEEN = ("submissions", "quality_check")


# 2023: 3 + 9 = 12; 2024: 1 + 9 = 10
@pytest.mark.parametrize(("rules", "points"), [(AS_2023, 12), (RELEASE_5, 10)])
def test_a_part_recorded_as_faulty_is_worth_nothing(rules: str, points: int) -> None:
    assert score(trial([part("battery_blue", 1, faulty=True), *PERFECT[1:]]), rules) == points


# Right type and colour in a challenged quadrant, never inspected: it becomes faulty; 3 + 0 = 3
def test_without_a_quality_check_the_right_part_in_a_challenged_quadrant_becomes_faulty() -> None:
    order = kit("battery_blue", challenged=True)

    assert score(trial(PERFECT[:1], order=order, witnessed=ALL_SEEN), AS_2023) == 3
    # a wrong colour alone stays sound, 3 + 2 = 5
    assert score(trial([part("battery_red", 1)], order=order, witnessed=ALL_SEEN), AS_2023) == 5


# One flag for each quadrant: the right part makes the red one on top of it faulty; as documented it does not
def test_the_right_part_in_a_challenged_quadrant_makes_the_part_that_counts_faulty() -> None:
    tray = trial(
        [PERFECT[0], part("battery_red", 1)], order=kit("battery_blue", challenged=True), witnessed=ALL_SEEN
    )

    assert verdicts(QuadrantPart(compare="sound"), tray) == [VIOLATED]
    assert verdicts(QuadrantPart(compare="sound", challenge_marks="part"), tray) == [SATISFIED]


def test_a_right_part_of_unknown_place_leaves_a_challenged_quadrant_undecided() -> None:
    lost = Product("battery_blue", None)
    order = kit("battery_blue", challenged=True)
    sound = QuadrantPart(compare="sound")

    assert verdicts(sound, trial([lost, part("battery_red", 1)], order=order, witnessed=ALL_SEEN)) == [
        INCONCLUSIVE
    ]
    # whatever its place, it is not the right part, or the right part is there anyhow
    other = Product("battery_red", None)
    assert verdicts(sound, trial([other, part("battery_red", 1)], order=order, witnessed=ALL_SEEN)) == [
        SATISFIED
    ]
    assert verdicts(sound, trial([lost, PERFECT[0]], order=order, witnessed=ALL_SEEN)) == [VIOLATED]


@pytest.mark.parametrize(("name", "points"), [("battery_blue_faulty", 3), ("battery_blue", 7)])
def test_after_a_quality_check_the_name_says_whether_a_part_is_faulty(name: str, points: int) -> None:
    order = kit("battery_blue", challenged=True)
    checked = trial([part("battery_blue", 1, name=name)], order=order, events=CHECKED, witnessed=ALL_SEEN)

    assert score(checked, AS_2023) == points


def test_a_quality_check_after_the_submission_or_of_another_order_is_none() -> None:
    order = kit("battery_blue", challenged=True)
    for event in (Event(100.5, "quality_check", "ABCD1234"), Event(50.0, "quality_check", "OTHER123")):
        late = trial(PERFECT[:1], order=order, events=[event], witnessed=ALL_SEEN)
        assert verdicts(QuadrantPart(compare="sound"), late) == [VIOLATED]


def test_where_a_quadrant_is_not_challenged_nothing_is_faulty() -> None:
    marked = trial(
        [part("battery_blue", 1, faulty=True, name="battery_blue_faulty")],
        order=kit("battery_blue", challenged=False),
    )

    assert verdicts(QuadrantPart(compare="sound"), marked) == [SATISFIED]


def test_whether_a_challenged_quadrant_was_inspected_must_be_known() -> None:
    order = kit("battery_blue", challenged=True)
    sound = QuadrantPart(compare="sound")

    assert verdicts(sound, trial(PERFECT[:1], order=order)) == [INCONCLUSIVE]
    assert scored(trial(PERFECT[:1], order=order), AS_2023).is_open
    # where both answers agree it need not be
    assert verdicts(sound, trial([part("battery_red", 1)], order=order)) == [SATISFIED]
    assert verdicts(sound, trial([part("battery_blue", 1, faulty=True)], order=order)) == [VIOLATED]


# The tray ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("model", "verdict"),
    [
        ("kit_tray_03", SATISFIED),
        ("kit_tray_03_1", SATISFIED),
        ("kit_tray_3", SATISFIED),
        ("kit_tray_30", VIOLATED),
        ("kit_tray_", INCONCLUSIVE),
        ("movable_tray_dark_wood", INCONCLUSIVE),
    ],
)
def test_the_tray_is_known_by_two_characters_of_its_name(model: str, verdict: Verdict) -> None:
    assert verdicts(TrayNumber(), trial(tray=Tray(model))) == [verdict]


# What is missing -----------------------------------------------------------------------

ASPECTS = [QuadrantPart(compare="type"), QuadrantPart(compare="color")]
ASPECTS += [QuadrantPart(compare="upright"), QuadrantPart(compare="sound")]


@pytest.mark.parametrize("rule", [*ASPECTS, ExtraParts(), TrayNumber(), OrderSubmitted()])
def test_a_log_that_shows_no_submissions_decides_nothing(
    rule: QuadrantPart | ExtraParts | TrayNumber | OrderSubmitted,
) -> None:
    assert set(verdicts(rule, replace(trial(witnessed=()), submissions=()))) == {INCONCLUSIVE}


@pytest.mark.parametrize("rule", [*ASPECTS, ExtraParts()])
@pytest.mark.parametrize("of", [trial(None), trial(agv="")])
def test_contents_or_agv_that_are_not_recorded_decide_nothing(
    of: Trial, rule: QuadrantPart | ExtraParts
) -> None:
    assert set(verdicts(rule, of)) == {INCONCLUSIVE}


@pytest.mark.parametrize("rules", [AS_2023, RELEASE_3, RELEASE_5])
@pytest.mark.parametrize(
    "of",
    [
        trial(None),
        trial(tray=None),
        trial(agv=""),
        trial(station=""),
        trial([Product("battery_blue", None), *PERFECT[1:]]),
        trial(order=kit("gear_part_red")),
        trial(order=kit("battery_blue", quadrants=(0,))),
        trial(order=replace(kit(), tasks=(replace(kit(*WANTED).tasks[0], tray=None),))),
    ],
)
def test_a_missing_datum_leaves_the_score_open_and_brings_no_points(of: Trial, rules: str) -> None:
    result, complete = scored(of, rules), score(trial(), rules)

    assert result.is_open
    assert result.interval is not None
    assert result.score == result.interval.least < result.interval.most <= complete


def test_a_part_without_a_pose_hides_only_the_quadrants_it_may_have_overwritten() -> None:
    lost = Product("pump_red", None)
    before, after = trial([lost, *PERFECT]), trial([*PERFECT[:2], lost, *PERFECT[2:]])

    assert verdicts(QuadrantPart(), before) == [SATISFIED] * 4
    assert verdicts(QuadrantPart(), after) == [INCONCLUSIVE, INCONCLUSIVE, SATISFIED, SATISFIED]


def test_a_task_of_another_kind_is_not_one() -> None:
    other = Order("o", (Task("o", "assembly", (WantedProduct("part_0", "pump_red"),), station="as1"),))
    rules: list[Rule] = [*ASPECTS, ExtraParts(), TrayNumber()]
    for rule in rules:
        (finding,) = rule.judge(trial(), other)
        assert finding.verdict is NOT_APPLICABLE
    assert [f.verdict for f in TaskKind("kitting").judge(trial(), other)] == [NOT_APPLICABLE]
    assert [f.verdict for f in TaskKind("assembly").judge(trial(), other)] == [SATISFIED]


def test_an_order_for_an_empty_kit_earns_its_tray() -> None:
    assert score(trial([], order=kit()), AS_2023) == 3


# What the score leaves out, and how it is logged -----------------------------------------


# DIFF, issues 315 and 337: the task's score has no factor for priority, so none is lost by submitting late
@pytest.mark.parametrize("rules", [AS_2023, RELEASE_3, RELEASE_5])
def test_priority_and_the_order_of_submission_change_no_task_score(rules: str) -> None:
    first = trial()
    (task,) = first.work[0].tasks
    urgent = Order("ABCD1235", (replace(task, id="ABCD1235"),), announced_s=0.0, priority=3)
    for at_s in (50.0, 150.0):
        second = replace(first.submissions[0], item_id="ABCD1235", submitted_s=at_s)
        both = replace(first, work=(*first.work, urgent), submissions=(*first.submissions, second))
        assert score(both, rules) == 2 * score(first, rules)


def test_our_own_trial_log_carries_quadrants_and_challenges(tmp_path: Path) -> None:
    products = [
        {"slot": "part_0", "type": "battery_blue", "quadrant": 3, "challenged": True},
        {"slot": "part_1", "type": "pump_red", "quadrant": 4},
    ]
    task = {"id": "o", "agv": "agv1", "tray": {"type": "kit_tray_03"}, "products": products}
    records = [
        {"record": "trial", "format": FORMAT, "id": "t"},
        {"record": "order", "t_s": 0, "id": "o", "tasks": [task]},
        {"record": "submission", "t_s": 9, "task_id": "o", "tray": {"type": ""}, "contents": []},
        {"record": "end", "records": 4},
    ]
    path = tmp_path / "t.jsonl"
    path.write_text("".join(f"{json.dumps(record)}\n" for record in records), encoding="utf-8")
    read = JsonLinesReader().read(path, Wanted(LogMap("test")))

    assert [(p.quadrant, p.challenged) for p in read.work[0].tasks[0].products] == [(3, True), (4, None)]
    assert read.submissions[0].tray == Tray("")


# A penalty never helps -----------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("rules", [AS_2023, RELEASE_3, RELEASE_5])
def test_one_more_flaw_never_raises_the_score(rules: str) -> None:
    draw = random.Random(23)  # noqa: S311  # the same draws each time
    for _ in range(15):
        parts = [part(draw.choice((*WANTED, "pump_red")), quadrant) for quadrant in PLACES]
        spoilt = draw.randrange(4)
        worse = list(parts)
        worse[spoilt] = replace(worse[spoilt], pose=at(*PLACES[spoilt + 1], roll=math.pi))
        assert score(trial(worse), rules) <= score(trial(parts), rules)
        assert score(trial([part("pump_red", 2), *parts]), rules) <= score(trial(parts), rules)
