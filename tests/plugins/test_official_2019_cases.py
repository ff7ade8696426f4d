"""The organisers' own tests of the 2019 scorer, replayed through our rules and a 2019 rule set.

A folder of cases needs no code: every `unit2019-*.json` and `rostest2019-*.json` in it
is one test. The format is described in the README beside the cases.
"""

from __future__ import annotations

import json
import math
import random
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations, product
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from ariac_score import (
    Event,
    Order,
    Pose,
    Product,
    Submission,
    Task,
    Trial,
    TrialBuilder,
    Verdict,
    WantedProduct,
    load_rule_set,
    measure_trial,
)
from ariac_score.engine import price_trial
from ariac_score.expression import Traced
from ariac_score.registry import Registry
from ariac_score.result import Provenance, canonical
from ariac_score.ruleset import RuleSet
from ariac_score_kitting import NoneMissing, OrderTime

SHARED = Path(__file__).parents[2].parent / "shared"
FOLDER = SHARED / "ariac" / "cases"
UNIT_CASES = sorted(FOLDER.glob("unit2019-*.json"))
SIMULATOR_CASES = sorted(FOLDER.glob("rostest2019-*.json"))

LEFT_OUT: Mapping[str, str] = {}
"""Simulator cases that the replay recipe cannot tell, each with the reason: none so far."""

MAX_ORDERINGS, SAMPLED_ORDERINGS, DRAWS = 5040, 200, 50

RULES_2019 = """
id: test.ariac2019
title: ARIAC 2019 as the simulator coded it
source: rulebooks, section 3, code
log_map: ariac2020
rules:
  presence: {use: kitting.presence, with: {compare: type_and_color}}
  poses:
    use: kitting.pose
    with: {max_distance_m: 0.03, min_quaternion_dot: 0.95, max_heading_error_rad: 0.1}
  none_missing: {use: kitting.none_missing}
  none_unwanted: {use: kitting.none_unwanted}
  none_faulty: {use: kitting.none_faulty}
  right_agv: {use: kitting.destination, with: {compare: agv}}
monitors:
  no_arm_collision: {use: ariac.no_event, with: {kind: arm_collision}}
terms:
  submission:
    present: points(presence)
    pose: points(poses)
    bonus: present if holds(none_missing) and holds(none_unwanted) and holds(none_faulty) else 0
    total: holds(right_agv) * (present + pose + bonus)
  order:
    factor: 1 if order.index == 0 else 3
    completion_score: sum(submission.total)
    total: factor * completion_score
  trial:
    all_orders: sum(order.total)
score: holds(no_arm_collision) * all_orders
round: 0
"""

NO_PROVENANCE = Provenance((), (), ("test.ariac2019", ""), ("ariac2020", ""), ())


@pytest.fixture
def referee(tmp_path: Path) -> Referee:
    file = tmp_path / "ariac2019.yaml"
    file.write_text(RULES_2019, encoding="utf-8")
    return Referee(load_rule_set(str(file)))


# From a case to a trial ----------------------------------------------------------------


def in_s(time: Sequence[int]) -> float:
    return time[0] + time[1] / 1e9


def pose_of(told: Mapping[str, Any]) -> Pose:
    x, y, z = map(float, told["xyz"])
    if "rpy" in told:
        roll, pitch, yaw = map(float, told["rpy"])
        return Pose.from_rpy((x, y, z), (roll, pitch, yaw))
    if "quat_wxyz" in told:
        w, i, j, k = map(float, told["quat_wxyz"])
    else:
        i, j, k, w = map(float, told["quat_xyzw"])
    return Pose((x, y, z), (w, i, j, k))


def ordered_agv(told: str) -> str:
    """Only `any`, `agv1` and `agv2` can ever be right; anything else, even nothing, is wrong."""
    return told if told in ("any", "agv1", "agv2") else "an AGV that does not exist"


def delivered_agv(container: str) -> str:
    for agv in ("agv1", "agv2"):
        if container == f"{agv}::kit_tray_{agv[-1]}::kit_tray_{agv[-1]}::tray":
            return agv
    return "no AGV"


def wanted_products(told: Sequence[Mapping[str, Any]]) -> tuple[WantedProduct, ...]:
    return tuple(WantedProduct(f"part_{i}", p["type"], pose_of(p)) for i, p in enumerate(told))


def delivered_products(told: Sequence[Mapping[str, Any]]) -> tuple[Product, ...]:
    return tuple(Product(p["type"], pose_of(p), p.get("faulty", False), p.get("name", "")) for p in told)


def order_of(event: Mapping[str, Any]) -> Order:
    tasks = tuple(
        Task(s["type"], products=wanted_products(s["products"]), agv=ordered_agv(s["agv"]))
        for s in event["order"]["shipments"]
    )
    return Order(event["order"]["id"], tasks, in_s(event["time"]), updates=event.get("updates", ""))


def item_of(event: Mapping[str, Any]) -> Order | Submission | Event:
    if event["event"] in ("order_started", "order_updated"):
        return order_of(event)
    if event["event"] == "arm_collision":
        return Event(in_s(event["time"]), "arm_collision")
    assert event["event"] == "shipment_submitted", f"unknown event {event['event']!r}"
    contents = event["contents"]
    return Submission(
        event["shipment_type"],
        in_s(event["time"]),
        delivered_products(contents["products"]),
        delivered_agv(contents["destination_id"]),
    )


def trial_of(items: Sequence[Order | Submission | Event]) -> Trial:
    builder = TrialBuilder("case", file="case", clock="simulated time")
    builder.witnessed |= {"submissions", "arm_collision"}
    for item in items:
        builder.add(item)
    return builder.build()


def orderings(events: Sequence[Mapping[str, Any]], draw: random.Random) -> Iterator[list[dict[str, Any]]]:
    """The events once for every ordering of the products that `permute` asks for, or for a sample."""
    marked = [i for i, event in enumerate(events) if event.get("permute")]
    lists = [events[i]["contents"]["products"] for i in marked]
    if math.prod(math.factorial(len(products)) for products in lists) <= MAX_ORDERINGS:
        choices: Iterator[Sequence[Any]] = product(*(permutations(products) for products in lists))
    else:
        choices = ([draw.sample(ps, len(ps)) for ps in lists] for _ in range(SAMPLED_ORDERINGS))
    for choice in choices:
        varied = [dict(event) for event in events]
        for i, products in zip(marked, choice, strict=True):
            varied[i]["contents"] = {**events[i]["contents"], "products": list(products)}
        yield varied


def shaken(events: Sequence[Mapping[str, Any]], draw: random.Random) -> list[dict[str, Any]]:
    """The events with the independent offsets that `jitter` asks for."""
    varied = [dict(event) for event in events]
    for event in varied:
        if "jitter" in event:
            low, high = event["jitter"]["uniform"]
            axes = event["jitter"]["each_product_axis"]
            products = []
            for told in event["contents"]["products"]:
                xyz = [
                    v + draw.uniform(low, high) * (a in axes) for v, a in zip(told["xyz"], "xyz", strict=True)
                ]
                products.append({**told, "xyz": xyz})
            event["contents"] = {**event["contents"], "products": products}
    return varied


def variants(events: Sequence[Mapping[str, Any]], name: str) -> Iterator[list[dict[str, Any]]]:
    draw = random.Random(name)  # noqa: S311  # the same draws on every run
    ordered = list(orderings(events, draw))
    if not any("jitter" in event for event in events):
        yield from ordered
        return
    for i in range(max(DRAWS, len(ordered))):
        yield shaken(ordered[i % len(ordered)], draw)


# From a trial to points ----------------------------------------------------------------


class Points(NamedTuple):
    total: int
    terms: Mapping[tuple[str, str], float]  # by subject and term, every one that was evaluated


class Referee:
    def __init__(self, rule_set: RuleSet) -> None:
        self.rule_set, self.registry = rule_set, Registry()
        self.checks = rule_set.build(self.registry)

    def score(self, trial: Trial) -> Points:
        # Rules judge orders: before the first one there is nothing to ask them.
        asked = {n: c for n, c in self.checks.items() if trial.orders or not hasattr(c, "judge")}
        measured = measure_trial(trial, asked, registry=self.registry, rule_set=self.rule_set)
        result = price_trial(measured, self.rule_set, NO_PROVENANCE)
        assert result.status == "scored"
        assert result.score is not None
        traced = self.rule_set.sheet.evaluate(measured.scopes, measured.findings)
        assert traced.value == result.score
        return Points(int(result.score), {(t.subject, t.label): t.value for t in terms_in(traced)})


def terms_in(traced: Traced) -> Iterator[Traced]:
    if traced.kind == "term":
        yield traced
    for child in traced.children:
        yield from terms_in(child)


def earned(orders: Sequence[Order], points: Points, *, factored: bool = True) -> list[tuple[float, ...]]:
    """Presence, pose and bonus points with the factor, of every shipment that earned any."""
    found = []
    for order in orders:
        for task in order.tasks:
            of = f"{order.id}/{task.id}"
            if points.terms[of, "total"]:
                parts = [points.terms[of, name] for name in ("present", "pose", "bonus")]
                found.append((*parts, points.terms[order.id, "factor"] if factored else 1))
    return sorted(found)


def asked_terms(told: Sequence[Mapping[str, float]]) -> list[tuple[float, ...]]:
    rows = [(t["presence"], t["pose"], t["bonus"], t["factor"]) for t in told]
    return sorted(row for row in rows if any(row[:3]))


def compare(expected: Mapping[str, Any], trial: Trial, points: Points) -> None:
    """Hold every expectation against what we say; an expectation that we do not know fails."""
    by_id = {order.id: order for order in trial.orders}
    for key, value in expected.items():
        if key == "game_total":
            assert points.total == value
        elif key == "game_total_terms":
            assert earned(trial.orders, points) == asked_terms(value)
        elif key == "first_shipment_pose_points":
            order = trial.orders[0]
            first = min(task.id for task in order.tasks)
            assert points.terms[f"{order.id}/{first}", "pose"] == value
        elif key == "orders":
            for order_id, told in value.items():
                compare_order(told, trial, by_id[order_id], points)
        else:
            pytest.fail(f"unknown expectation {key!r}")


def compare_order(expected: Mapping[str, Any], trial: Trial, order: Order, points: Points) -> None:
    (time_taken,) = OrderTime().judge(trial, order)
    missing = {finding.subject: finding for finding in NoneMissing().judge(trial, order)}
    for key, value in expected.items():
        if key in ("total", "completion_score"):
            assert points.terms[order.id, key] == value
        elif key in ("total_terms", "completion_score_terms"):
            assert earned([order], points, factored=key == "total_terms") == asked_terms(value)
        elif key == "complete":
            assert (time_taken.verdict is not Verdict.VIOLATED) == value
        elif key == "first_shipment_complete":
            first = min(task.id for task in order.tasks)
            assert (missing[f"{order.id}/{first}"].verdict is Verdict.SATISFIED) == value
        elif key == "shipment_count":
            assert len(order.tasks) == value
        elif key == "time_taken":
            taken_s = time_taken.quantities.get("time_taken_s", 0.0)  # 0 while the order is not complete
            (s1, ns1), (s0, ns0) = value["end"], value["minus_start"]
            exact_ns = (s1 - s0) * 10**9 + ns1 - ns0
            assert round(taken_s * 1e9) == exact_ns
            assert canonical(taken_s) == canonical(exact_ns / 1e9)
        else:
            pytest.fail(f"unknown expectation {key!r} of {order.id}")


def replay(case: Mapping[str, Any], referee: Referee) -> int:
    """Compare every checkpoint of every variant; returns how many comparisons were made."""
    compared = 0
    for events in variants(case["events"], case["id"]):
        for checkpoint in case["checkpoints"]:
            trial = trial_of([item_of(event) for event in events[: checkpoint["after_events"]]])
            compare(checkpoint["expected"], trial, referee.score(trial))
            compared += 1
    return compared


# Unit tests of the scorer --------------------------------------------------------------


def test_the_folder_of_official_cases_is_not_empty() -> None:
    if not SHARED.is_dir():
        pytest.skip("the folder of official material (../shared) is not here")
    assert UNIT_CASES, f"no unit2019-*.json in {FOLDER}"
    assert SIMULATOR_CASES, f"no rostest2019-*.json in {FOLDER}"


@pytest.mark.parametrize("file", UNIT_CASES, ids=lambda file: file.stem)
def test_unit_test_of_the_official_scorer(file: Path, referee: Referee) -> None:
    case = json.loads(file.read_text(encoding="utf-8"))
    assert (case["format"], case["kind"]) == ("ariac-case/1", "unit-scorer")

    compared = replay(case, referee)

    assert compared >= len(case["checkpoints"]) > 0
    if any("jitter" in event for event in case["events"]):
        assert compared >= DRAWS


# The replay itself ---------------------------------------------------------------------


def pulley(x: float) -> dict[str, Any]:
    return {"type": "pulley_part", "xyz": [x, 0, 0], "rpy": [0, 0, 0]}


def case_of_three_pulleys(total: int) -> dict[str, Any]:
    """Slots at 0, 20 and 40 mm; the pulley at 20 mm fits all three, the others two and one.

    0 mm fits the slots at 0 and 20 mm; 60 mm only that at 40 mm. A greedy scorer fails in
    some order of delivery; the best assignment places all three: 3 + 3 + bonus 3.
    """
    shipment = {"type": "s", "agv": "any", "products": [pulley(0), pulley(0.02), pulley(0.04)]}
    contents = {"destination_id": "", "products": [pulley(0), pulley(0.02), pulley(0.06)]}
    return {
        "id": "three pulleys",
        "events": [
            {"event": "order_started", "time": [0, 0], "order": {"id": "order_0", "shipments": [shipment]}},
            {
                "event": "shipment_submitted",
                "time": [1, 0],
                "shipment_type": "s",
                "contents": contents,
                "permute": "products",
            },
        ],
        "checkpoints": [{"after_events": 2, "expected": {"game_total": total}}],
    }


def test_permute_plays_every_ordering_and_the_best_assignment_never_depends_on_it(referee: Referee) -> None:
    assert replay(case_of_three_pulleys(9), referee) == 6


def test_a_wrong_expectation_fails_the_replay(referee: Referee) -> None:
    with pytest.raises(AssertionError):
        replay(case_of_three_pulleys(8), referee)


@pytest.mark.parametrize(
    "expected",
    [
        {"game_total_terms": [{"presence": 3, "pose": 2, "bonus": 3, "factor": 1}]},
        {"game_total_terms": []},
        {"first_shipment_pose_points": 2},
        {"orders": {"order_0": {"total": 8}}},
        {"orders": {"order_0": {"completion_score": 8}}},
        {"orders": {"order_0": {"complete": False}}},
        {"orders": {"order_0": {"first_shipment_complete": False}}},
        {"orders": {"order_0": {"shipment_count": 2}}},
        {"orders": {"order_0": {"time_taken": {"end": [1, 1], "minus_start": [0, 0]}}}},
        {"orders": {"order_0": {"total_terms": [{"presence": 3, "pose": 3, "bonus": 0, "factor": 1}]}}},
    ],
    ids=str,
)
def test_every_kind_of_expectation_can_fail(expected: dict[str, Any], referee: Referee) -> None:
    case = case_of_three_pulleys(9)
    case["checkpoints"][0]["expected"] = expected

    with pytest.raises(AssertionError):
        replay(case, referee)


@pytest.mark.parametrize("expected", [{"game_totel": 9}, {"orders": {"order_0": {"totel": 9}}}], ids=str)
def test_an_expectation_that_nobody_compares_fails(expected: dict[str, Any], referee: Referee) -> None:
    case = case_of_three_pulleys(9)
    case["checkpoints"][0]["expected"] = expected

    with pytest.raises(pytest.fail.Exception, match="unknown expectation"):
        replay(case, referee)


def test_an_order_for_no_agv_is_never_right(referee: Referee) -> None:
    case = case_of_three_pulleys(0)  # "Any other ordered value is never right", rulebooks section 3
    case["events"][0]["order"]["shipments"][0]["agv"] = ""

    assert replay(case, referee) == 6


# Tests of the whole simulator ----------------------------------------------------------


class CannotReplayError(Exception):
    """The recipe in the README does not say how."""


class Simulation:
    """The README's recipe: spawn poses are delivered poses, waiting decides nothing."""

    def __init__(self, case: Mapping[str, Any]) -> None:
        self.containers: Mapping[str, Any] = case["spawned_on_containers"]
        self.waiting = list(case["orders"])
        self.items: list[Order | Submission | Event] = []
        self.announced: list[Order] = []
        self.submitted: set[str] = set()
        self.time_s = 0.0

    def play(self, commands: Sequence[Mapping[str, Any]]) -> Trial:
        for command in commands:
            self.time_s += 1.0
            if "start_competition" in command:
                self.announce(at_start=True)
            elif "submit_agv" in command:
                self.announce(at_start=False)
                self.submit(command["submit_agv"], command["shipment_type"])
            elif "collide_arms" in command:
                self.items.append(Event(self.time_s, "arm_collision"))
            elif "wait_wall_s" not in command:
                raise CannotReplayError(f"unknown command {command}")
        return trial_of(self.items)

    def announce(self, *, at_start: bool) -> None:
        while self.waiting and (at_start or self.announced):
            order = self.waiting[0]
            condition, value = order["announcement_condition"], order["announcement_condition_value"]
            if condition == "time":
                if value != 0.0:
                    raise CannotReplayError("an order announced at a simulated time that no command tells")
                due = at_start
            elif condition in ("wanted_products", "unwanted_products"):
                due = not at_start and (self.most_on_a_container(condition) >= value or self.complete())
            else:
                raise CannotReplayError(f"unknown condition {condition!r}")
            if not due:
                return
            self.waiting.pop(0)
            self.started(order)

    def most_on_a_container(self, condition: str) -> int:
        """Most products on one container that the current order wants, or does not."""
        wanted = Counter(p.type for p in self.announced[-1].tasks[0].products)
        numbers = [0]
        for products in self.containers.values():
            lying = Counter(p["type"] for p in products)
            numbers.append(
                sum(((lying & wanted) if condition == "wanted_products" else lying - wanted).values())
            )
        return max(numbers)

    def complete(self) -> bool:
        return {task.id for task in self.announced[-1].tasks} <= self.submitted

    def started(self, told: Mapping[str, Any]) -> None:
        base, _, update = told["id"].partition("_update")
        destinations = told.get("destinations") or ["any"] * told["shipment_count"]
        products = wanted_products(told["products_per_shipment"])
        tasks = tuple(
            Task(f"{base}_shipment_{k}", products=products, agv=ordered_agv(destinations[k]))
            for k in range(told["shipment_count"])
        )
        order = Order(told["id"], tasks, self.time_s, updates=base if update else "")
        self.announced.append(order)
        self.items.append(order)

    def submit(self, agv: str, shipment_type: str) -> None:
        container = f"{agv}::kit_tray_{agv[-1]}"
        if any(isinstance(item, Submission) and item.agv == agv for item in self.items):
            raise CannotReplayError(f"{agv} is submitted twice, and nobody says what lies on it then")
        contents = delivered_products(self.containers.get(container, []))
        agv_id = delivered_agv(f"{container}::kit_tray_{agv[-1]}::tray")
        self.items.append(Submission(shipment_type, self.time_s, contents, agv_id))
        self.submitted.add(shipment_type)


@pytest.mark.parametrize("file", SIMULATOR_CASES, ids=lambda file: file.stem)
def test_simulator_test_of_the_organisers(file: Path, referee: Referee) -> None:
    if file.stem in LEFT_OUT:
        pytest.skip(LEFT_OUT[file.stem])
    case = json.loads(file.read_text(encoding="utf-8"))
    assert (case["format"], case["kind"]) == ("ariac-case/1", "sim-rostest")

    trial = Simulation(case).play(case["commands"])

    assert set(case["expected"]) == {"game_total"}
    assert referee.score(trial).total == case["expected"]["game_total"]


def test_a_simulator_case_with_an_unknown_command_is_refused() -> None:
    case = {"spawned_on_containers": {}, "orders": []}
    with pytest.raises(CannotReplayError, match="unknown command"):
        Simulation(case).play([{"submit_box": "box_0", "shipment_type": "order_0_shipment_0"}])
