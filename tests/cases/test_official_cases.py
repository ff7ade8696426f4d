"""The organisers' own tests and scenarios, replayed through the shipped rule sets.

A folder of cases needs no code: every case in it is one test for each checkpoint. The
format is described in the README beside the cases. `--official-cases DIR` runs those of
another folder; a folder that is given and holds none is a failure.
"""

from __future__ import annotations

import json
import math
import random
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import permutations, product
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from ariac_score import (
    Event,
    Finding,
    Pose,
    Trial,
    TrialBuilder,
    Verdict,
    load_rule_set,
    measure_trial,
    score_trial,
)
from ariac_score.engine.prepared import prepare
from ariac_score.engine.price import price_trial
from ariac_score.results.result import Measured, Pinned, Provenance, canonical
from ariac_score.scoring.expression import Traced
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.build import merge_trials
from ariac_score.trial.clock import Clock
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.tasks import NoneFaulty, NoneMissing, NoneUnwanted, OrderTime
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, WantedProduct

SHARED = Path(__file__).parents[2].parent / "shared"
DEFAULT_FOLDER = SHARED / "ariac" / "cases"

RULE_SETS: Mapping[str, str] = {
    "2017": "ariac2017.as_coded",
    "2018": "ariac2018.as_coded",
    "2019": "ariac2019.as_coded",
    "2020": "ariac2020.as_coded",
    "2021": "ariac2021.finals_as_coded",
    "2022": "ariac2022.as_coded",
}
"""The rule set under which the expectations of a year must hold."""

MAX_ORDERINGS, SAMPLED_ORDERINGS, DRAWS = 5040, 200, 50

NO_PROVENANCE = Provenance((), (), Pinned("", ""), Pinned("", ""), ())


# Which cases ---------------------------------------------------------------------------


def folder_of(config: pytest.Config) -> Path:
    given = config.getoption("--official-cases")
    return Path(given) if given else DEFAULT_FOLDER


def cases_in(folder: Path) -> list[dict[str, Any]]:
    return [case_in(file) for file in sorted(folder.glob("*.json"))]


def case_in(file: Path) -> dict[str, Any]:
    """The case of a file; one without an id has the file's name."""
    try:
        document = json.loads(file.read_text(encoding="utf-8"))
    except ValueError as error:
        raise pytest.UsageError(f"{file}: no official case, for it is not JSON: {error}") from error
    if not isinstance(document, dict):
        raise pytest.UsageError(f"{file}: no official case, for it is not a JSON object")
    return {"id": file.stem, **document}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test for each case and checkpoint."""
    for kind, argument in KINDS.items():
        if argument in metafunc.fixturenames:
            cases = [case for case in cases_in(folder_of(metafunc.config)) if case.get("kind") == kind]
            marked = [
                pytest.param((case, checkpoint), id=f"{case['id']}{suffix}")
                for case in cases
                for checkpoint, suffix in checkpoints_of(case)
            ]
            metafunc.parametrize(argument, marked)


def checkpoints_of(case: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], str]]:
    """Each checkpoint of a case with what tells it apart; a case without any is its own."""
    several = len(case.get("checkpoints", ())) > 1
    for checkpoint in case.get("checkpoints", [{}]):
        yield checkpoint, f"-after-{checkpoint['after_events']}-events" if several else ""


KINDS = {
    "unit-scorer": "unit_case",
    "sim-rostest": "simulator_case",
    "demo-scenario": "demo_case",
    "observed": "observed_case",
}
"""The kinds of case and the test argument that takes them."""

Case = tuple[Mapping[str, Any], Mapping[str, Any]]


def test_the_folder_of_official_cases_is_not_empty(request: pytest.FixtureRequest) -> None:
    folder = folder_of(request.config)
    if not folder.is_dir() and not request.config.getoption("--official-cases"):
        pytest.skip("the folder of official cases (../shared/ariac/cases) is not here")
    assert cases_in(folder), f"no case in {folder}"


def test_every_official_case_is_of_a_kind_that_is_run(request: pytest.FixtureRequest) -> None:
    cases = cases_in(folder_of(request.config))
    assert [case.get("id") for case in cases if case.get("kind") not in KINDS] == []


def year_of(case: Mapping[str, Any]) -> str | None:
    """The year whose rules the expectation belongs to; `None` when it is no oracle for any."""
    valid_for = case.get("valid_for") or [case.get("edition", "")]
    found = re.match(r"20\d\d", str(valid_for[0]))
    return found.group() if found else None


def referee_of(case: Mapping[str, Any]) -> Referee:
    year = year_of(case)
    if year not in RULE_SETS:
        pytest.fail(f"{case['id']} is valid for {year}; there are rule sets for {', '.join(RULE_SETS)}")
    return Referee(load_rule_set(RULE_SETS[year]))


@pytest.fixture
def referee() -> Referee:
    return Referee(load_rule_set(RULE_SETS["2019"]))


# From a case to a trial ----------------------------------------------------------------


def in_s(time: Sequence[int]) -> float:
    return time[0] + time[1] / 1e9


def pose_of(document: Mapping[str, Any]) -> Pose:
    x, y, z = map(float, document["xyz"])
    if "rpy" in document:
        roll, pitch, yaw = map(float, document["rpy"])
        return Pose.from_rpy((x, y, z), (roll, pitch, yaw))
    if "quat_wxyz" in document:
        w, i, j, k = map(float, document["quat_wxyz"])
    else:
        i, j, k, w = map(float, document["quat_xyzw"])
    return Pose((x, y, z), (w, i, j, k))


def delivered_agv(container: str) -> str:
    found = re.fullmatch(r"(agv(\d))::kit_tray_\2::kit_tray_\2::tray", container)
    return found.group(1) if found else "no AGV"


def wanted_products(products: Sequence[Mapping[str, Any]]) -> tuple[WantedProduct, ...]:
    return tuple(WantedProduct(f"part_{i}", p["type"], pose_of(p)) for i, p in enumerate(products))


def delivered_products(products: Sequence[Mapping[str, Any]]) -> tuple[Product, ...]:
    return tuple(Product(p["type"], pose_of(p), p.get("faulty", False), p.get("name", "")) for p in products)


def order_of(event: Mapping[str, Any]) -> Order:
    tasks = tuple(
        Task(s["type"], products=wanted_products(s["products"]), agv=s["agv"])
        for s in event["order"]["shipments"]
    )
    return Order(event["order"]["id"], tasks, in_s(event["time"]), updates=event.get("updates", ""))


def item_of(event: Mapping[str, Any]) -> Order | KitSubmission | Event:
    if event["event"] in ("order_started", "order_updated"):
        return order_of(event)
    if event["event"] == "arm_collision":
        return Event(in_s(event["time"]), "arm_collision")
    assert event["event"] == "shipment_submitted", f"unknown event {event['event']!r}"
    contents = event["contents"]
    return KitSubmission(
        event["shipment_type"],
        in_s(event["time"]),
        delivered_products(contents["products"]),
        delivered_agv(contents["destination_id"]),
    )


def trial_of(items: Sequence[Order | KitSubmission | Event]) -> Trial:
    builder = TrialBuilder("case", file="case", clock=Clock("simulated time"))
    builder.witnessed |= {"submissions", "arm_collision", "part_dropped"}
    for item in items:
        builder.add(item)
    return merge_trials("case", [builder.build()], file="case", competition=Ariac())


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
            for part in event["contents"]["products"]:
                xyz = [
                    v + draw.uniform(low, high) * (a in axes) for v, a in zip(part["xyz"], "xyz", strict=True)
                ]
                products.append({**part, "xyz": xyz})
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
    measured: Measured


class Referee:
    def __init__(self, rule_set: RuleSet) -> None:
        self.rule_set, self.prepared = rule_set, prepare(rule_set)

    def score(self, trial: Trial) -> Points:
        measured = measure_trial(trial, self.prepared)
        result = price_trial(measured, self.rule_set, NO_PROVENANCE)
        assert result.status == "scored"
        assert result.score is not None
        traced = self.rule_set.sheet.evaluate(measured.scopes, measured.findings)
        assert traced.value == result.score
        terms = {(t.subject, t.label): t.value for t in terms_in(traced)}
        return Points(int(result.score), terms, measured)


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


def terms_by_order(orders: Sequence[Mapping[str, float]]) -> list[tuple[float, ...]]:
    rows = [(t["presence"], t["pose"], t["bonus"], t["factor"]) for t in orders]
    return sorted(row for row in rows if any(row[:3]))


def compare(expected: Mapping[str, Any], trial: Trial, points: Points) -> None:
    """Hold every expectation against what we say; an expectation that we do not know fails."""
    by_id = {order.id: order for order in trial.work}
    for key, value in expected.items():
        if key == "game_total":
            assert points.total == value
        elif key == "game_total_terms":
            assert earned(trial.work, points) == terms_by_order(value)
        elif key == "first_shipment_pose_points":
            order = trial.work[0]
            first = min(task.id for task in order.tasks)
            assert points.terms[f"{order.id}/{first}", "pose"] == value
        elif key == "orders":
            for order_id, document in value.items():
                compare_order(document, trial, by_id[order_id], points)
        else:
            pytest.fail(f"unknown expectation {key!r}")


def compare_order(expected: Mapping[str, Any], trial: Trial, order: Order, points: Points) -> None:
    (time_taken,) = OrderTime().judge(trial, order)
    missing = {finding.subject: finding for finding in NoneMissing().judge(trial, order)}
    for key, value in expected.items():
        if key == "total":
            assert points.terms[order.id, "total"] == value
        elif key == "completion_score":
            assert points.terms[order.id, "completion"] == value
        elif key in ("total_terms", "completion_score_terms"):
            assert earned([order], points, factored=key == "total_terms") == terms_by_order(value)
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


def replay(case: Mapping[str, Any], checkpoint: Mapping[str, Any], referee: Referee) -> int:
    """Compare a checkpoint of every variant; returns how many comparisons were made."""
    compared = 0
    for events in variants(case["events"], case["id"]):
        trial = trial_of([item_of(event) for event in events[: checkpoint["after_events"]]])
        compare(checkpoint["expected"], trial, referee.score(trial))
        compared += 1
    return compared


# Unit tests of the scorer --------------------------------------------------------------


def test_unit_test_of_the_official_scorer(unit_case: Case) -> None:
    case, checkpoint = unit_case
    assert case["format"] == "ariac-case/1"

    compared = replay(case, checkpoint, referee_of(case))

    assert compared > 0
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


def replayed(case: Mapping[str, Any], referee: Referee) -> int:
    (checkpoint,) = case["checkpoints"]
    return replay(case, checkpoint, referee)


def test_permute_plays_every_ordering_and_the_best_assignment_never_depends_on_it(referee: Referee) -> None:
    assert replayed(case_of_three_pulleys(9), referee) == 6


def test_a_wrong_expectation_fails_the_replay(referee: Referee) -> None:
    with pytest.raises(AssertionError):
        replayed(case_of_three_pulleys(8), referee)


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
        replayed(case, referee)


@pytest.mark.parametrize("expected", [{"game_totel": 9}, {"orders": {"order_0": {"totel": 9}}}], ids=str)
def test_an_expectation_that_nobody_compares_fails(expected: dict[str, Any], referee: Referee) -> None:
    case = case_of_three_pulleys(9)
    case["checkpoints"][0]["expected"] = expected

    with pytest.raises(pytest.fail.Exception, match="unknown expectation"):
        replayed(case, referee)


def test_an_order_for_no_agv_is_never_right(referee: Referee) -> None:
    case = case_of_three_pulleys(0)  # "Any other ordered value is never right", rulebooks section 3
    case["events"][0]["order"]["shipments"][0]["agv"] = ""

    assert replayed(case, referee) == 6


# Tests of the whole simulator ----------------------------------------------------------


class CannotReplayError(Exception):
    """The recipe in the README does not say how."""


class Simulation:
    """The README's recipe: spawn poses are delivered poses, waiting decides nothing.

    A container keeps its parts when it is submitted: the organisers submit one AGV twice,
    for another's shipment and for its own, and expect the full points of the second.
    """

    def __init__(self, case: Mapping[str, Any]) -> None:
        self.containers: Mapping[str, Any] = case.get("spawned_on_containers", {})
        self.waiting = list(case["orders"])
        self.items: list[Order | KitSubmission | Event] = []
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
                agv = command["submit_agv"]
                self.submit(f"{agv}::kit_tray_{agv[-1]}", command["shipment_type"])
            elif "submit_box" in command:
                self.announce(at_start=False)
                self.submit(command["submit_box"], command["shipment_type"])
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

    def started(self, document: Mapping[str, Any]) -> None:
        base, _, update = document["id"].partition("_update")
        destinations = document.get("destinations") or ["any"] * document["shipment_count"]
        products = wanted_products(document["products_per_shipment"])
        tasks = tuple(
            Task(f"{base}_shipment_{k}", products=products, agv=destinations[k])
            for k in range(document["shipment_count"])
        )
        order = Order(document["id"], tasks, self.time_s, updates=base if update else "")
        self.announced.append(order)
        self.items.append(order)

    def submit(self, container: str, shipment_type: str) -> None:
        contents = delivered_products(self.containers.get(container, []))
        agv = delivered_agv(f"{container}::{container.rpartition('::')[2]}::tray")
        self.items.append(KitSubmission(shipment_type, self.time_s, contents, agv))
        self.submitted.add(shipment_type)


def test_simulator_test_of_the_organisers(simulator_case: Case) -> None:
    case, _ = simulator_case
    assert case["format"] == "ariac-case/1"

    trial = Simulation(case).play(case["commands"])

    assert set(case["expected"]) == {"game_total"}
    assert referee_of(case).score(trial).total == case["expected"]["game_total"]


def test_a_simulator_case_with_an_unknown_command_is_refused() -> None:
    case: dict[str, Any] = {"spawned_on_containers": {}, "orders": []}
    with pytest.raises(CannotReplayError, match="unknown command"):
        Simulation(case).play([{"submit_drone": "drone_0", "shipment_type": "order_0_shipment_0"}])


def wrong_agv_case(destinations: Sequence[str]) -> dict[str, Any]:
    """Three pulleys on agv1, handed in for both shipments of an order, as `ariac_scoring_wrong_agv` does."""
    pulleys = [pulley(0), pulley(0.1), pulley(0.2)]
    order = {
        "id": "order_0",
        "announcement_condition": "time",
        "announcement_condition_value": 0.0,
        "shipment_count": 2,
        "destinations": list(destinations),
        "products_per_shipment": pulleys,
    }
    return {
        "format": "ariac-case/1",
        "id": "wrong agv",
        "edition": "2019",
        "kind": "sim-rostest",
        "orders": [order],
        "spawned_on_containers": {"agv1::kit_tray_1": pulleys},
        "commands": [
            {"start_competition": True},
            {"submit_agv": "agv1", "shipment_type": "order_0_shipment_0"},
            {"wait_wall_s": 5.0},
            {"submit_agv": "agv1", "shipment_type": "order_0_shipment_1"},
        ],
    }


# Three products of a shipment: 3 + 3 + bonus 3 = 9; the wrong AGV makes it 0.
@pytest.mark.parametrize(("destinations", "total"), [(["agv2", "agv1"], 9), (["agv1", "any"], 18)])
def test_an_agv_handed_in_twice_counts_where_it_was_ordered(destinations: list[str], total: int) -> None:
    case = {**wrong_agv_case(destinations), "expected": {"game_total": total}}
    test_simulator_test_of_the_organisers((case, {}))

    with pytest.raises(AssertionError):
        test_simulator_test_of_the_organisers(({**case, "expected": {"game_total": total + 1}}, {}))


# Demonstrations ------------------------------------------------------------------------


class Demonstration:
    """Spawn poses are delivered poses; a part spawned where one of its type lies already is that one.

    An order with another condition than a time is announced before the first submission
    of one of its shipments: the printed result shows that it had been by then.
    """

    def __init__(self, case: Mapping[str, Any]) -> None:
        self.waiting = list(case["orders"])
        self.places: dict[str, list[Mapping[str, Any]]] = {}
        self.items: list[Order | KitSubmission | Event] = []
        self.time_s = 0.0
        for agv, info in case.get("agv_infos", {}).items():
            self.places[agv] = list(info.get("products", []))
        for station, products in case.get("preplaced_on_stations", {}).items():
            self.places[station] = list(products)
        self.faulty = set(case.get("faulty_product_names", []))

    def play(self, commands: Sequence[Mapping[str, Any]]) -> Trial:
        for command in commands:
            self.time_s += 1.0
            if "start_competition" in command:
                self.announce(lambda order: order["announcement_condition"] == "time")
            elif "spawn" in command:
                self.spawn(command["spawn"])
            elif "submit_agv" in command:
                self.submit(command, command["submit_agv"], command["submit_agv"], command["station"])
            elif "submit_station" in command:
                self.submit(command, command["submit_station"], "", command["submit_station"])
            elif "wait_wall_s" not in command:
                raise CannotReplayError(f"unknown command {command}")
        return trial_of(self.items)

    def announce(self, due: Callable[[Mapping[str, Any]], bool]) -> None:
        for document in [order for order in self.waiting if due(order)]:
            if "_update" in document["id"]:
                raise CannotReplayError("an update announced at a time that no command tells")
            self.waiting.remove(document)
            self.items.append(demo_order(document, self.time_s))

    def spawn(self, document: Mapping[str, Any]) -> None:
        frame = document["reference_frame"].partition("::")[0]
        place = re.sub(r"^station(\d)$", r"as\1", frame)
        lying = self.places.setdefault(place, [])
        if not any(p["type"] == document["type"] and p["xyz"][:2] == document["xyz"][:2] for p in lying):
            name = document["model_name"]
            lying.append({**document, "name": name, "faulty": name in self.faulty})

    def submit(self, command: Mapping[str, Any], place: str, agv: str, station: str) -> None:
        kind = command["shipment_type"]
        self.announce(lambda order: kind.startswith(f"{order['id']}_"))
        contents = delivered_products(self.places.get(place, []))
        self.items.append(KitSubmission(kind, self.time_s, contents, agv, station))


def demo_order(document: Mapping[str, Any], time_s: float) -> Order:
    tasks = [task for kind in ("kitting", "assembly") for task in demo_tasks(document, kind)]
    return Order(document["id"], tuple(tasks), time_s, document["priority"])


def demo_tasks(document: Mapping[str, Any], kind: str) -> Iterator[Task]:
    block = document.get(kind, {"shipment_count": 0})
    for k in range(block["shipment_count"]):
        yield Task(
            f"{document['id']}_{kind}_shipment_{k}",
            kind,
            wanted_products(block["products_per_shipment"]),
            block["agvs"][k] if "agvs" in block else "any",
            block["destinations" if kind == "kitting" else "stations"][k],
        )


def test_demonstration_of_the_organisers(demo_case: Case) -> None:
    case, _ = demo_case
    assert case["format"] == "ariac-case/1"
    trial = Demonstration(case).play(case["commands"])
    points, expected = referee_of(case).score(trial), case["expected"]

    assert points.total == expected["trial_total"]
    assert violations(points, "no_arm_collision") == expected["arms_collision"]
    assert violations(points, "dropped_parts") == expected["dropped_part_penalty"]
    # Times were measured on the organisers' machine (README): they are not compared.
    for document in expected["orders"]:
        order = next(order for order in trial.work if order.id == document["id"])
        assert (points.terms[order.id, "total"], order.priority) == (document["total"], document["priority"])
        assert points.terms[order.id, "completion"] == document["completion_score"]
        for kit in document.get("kitting", []):
            compare_kit(f"{order.id}/{kit['shipment_type']}", kit, points)
        for briefcase in document.get("assembly", []):
            compare_briefcase(f"{order.id}/{briefcase['shipment_type']}", briefcase, points, trial, order)


def findings_about(points: Points, check: str, subject: str) -> Iterator[Finding]:
    for finding in points.measured.of(check).values():
        if finding.subject == subject or finding.subject.startswith(f"{subject}/"):
            yield finding


def violations(points: Points, check: str, subject: str = "") -> int:
    found = points.measured.of(check).values() if not subject else findings_about(points, check, subject)
    return sum(1 for finding in found if finding.verdict is Verdict.VIOLATED)


def satisfied(points: Points, check: str, subject: str) -> bool:
    return {finding.verdict for finding in findings_about(points, check, subject)} == {Verdict.SATISFIED}


def compare_kit(subject: str, document: Mapping[str, Any], points: Points) -> None:
    place = next(iter(findings_about(points, "right_destination", subject)))
    found = {
        "completion_score": points.terms[subject, "kit"],
        "complete": satisfied(points, "none_missing", subject),
        "submitted": satisfied(points, "submitted", subject),
        "correct_agv": "AGV" not in place.message or place.verdict is Verdict.SATISFIED,
        "correct_station": "station" not in place.message or place.verdict is Verdict.SATISFIED,
        "type_points": points.terms[subject, "type"],
        "color_points": points.terms[subject, "color"],
        "pose_points": points.terms[subject, "pose"],
        "bonus": points.terms[subject, "bonus"],
    }
    assert {key: found[key] for key in document if key != "shipment_type"} == {
        key: value for key, value in document.items() if key != "shipment_type"
    }


def compare_briefcase(
    subject: str, document: Mapping[str, Any], points: Points, trial: Trial, order: Order
) -> None:
    (counted,) = (f.quantities for f in findings_about(points, "assembly_counters", subject))

    def violates(rule: NoneFaulty | NoneMissing | NoneUnwanted) -> bool:
        verdicts = {f.verdict for f in rule.judge(trial, order) if f.subject == subject}
        return verdicts == {Verdict.VIOLATED}

    found = {
        "completion_score": points.terms[subject, "assembly"],
        "two_points_type_and_pose": 2 * points.terms[subject, "in_place"],
        "one_point_color": points.terms[subject, "in_color"],
        "bonus": points.terms[subject, "assembly_bonus"],
        "complete": satisfied(points, "assembly_complete", subject),
        "shipped": satisfied(points, "assembly_submitted", subject),
        "number_shipped": counted["delivered"],
        "faulty": violates(NoneFaulty(kind="assembly")),
        "missing": violates(NoneMissing(kind="assembly")),
        "unwanted": violates(NoneUnwanted(kind="assembly")),
        "correct_type": counted["types_alike"],
        "correct_pose": counted["poses_alike"],
        "correct_color": counted["colors_alike"],
        "correct_station": satisfied(points, "right_station", subject),
    }
    assert {key: found[key] for key in document if key != "shipment_type"} == {
        key: value for key, value in document.items() if key != "shipment_type"
    }


# Observations --------------------------------------------------------------------------


def test_observation_of_a_run(observed_case: Case) -> None:
    """What a report tells, as far as it tells enough: computed, or held against itself."""
    case, _ = observed_case
    assert case["format"] == "ariac-case/1"
    expected = case.get("expected", {})
    if "game_total" in expected:
        compare_sums(expected)  # what was ordered and delivered is not known
        if Path(case.get("source", {}).get("path", "")).match("*/nist_team/*/*"):
            compare_log(expected)
    elif year_of(case) in RULE_SETS and "shipment" in expected and tells_one_shipment(case):
        compare_shipment(case, expected["shipment"])
    else:
        why = " ".join(case.get("notes", [])) or "it tells of a part of a run, or of a bug"
        pytest.skip(f"no oracle: {why}")


def tells_one_shipment(case: Mapping[str, Any]) -> bool:
    """Whether a report says what was ordered and delivered, as far as one shipment goes."""
    shipments = [shipment for order in case.get("orders", ()) for shipment in order.get("shipments", ())]
    if [{"type", "agv", "products"} <= {*shipment} for shipment in shipments] != [
        True
    ] or "delivered" not in case:
        return False
    placed_right = "pose_points" in case["expected"]["shipment"]
    return placed_right or all("xyz" in product for product in case["delivered"])


def compare_shipment(case: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    (order,) = case["orders"]
    (shipment,) = order["shipments"]
    ordered = [placed(p, i) for i, p in enumerate(shipment["products"])]
    delivered = [dict(p) for p in case["delivered"]]
    # A report without poses says how many lay right: as many as it says are put into their places.
    for i, part in enumerate(delivered):
        if "xyz" not in part:
            part.update(xyz=[10.0 + i, 0.0, 0.0], rpy=[0.0, 0.0, 0.0])
    right = expected["pose_points"] if not any("xyz" in p for p in case["delivered"]) else 0
    for slot in ordered:
        match = next((p for p in delivered if p["type"] == slot["type"] and p["xyz"][0] >= 10.0), None)
        if match and right:
            match["xyz"], right = slot["xyz"], right - 1
    task = Task(shipment["type"], products=wanted_products(ordered), agv=shipment["agv"])
    handed_in = KitSubmission(task.id, 1.0, delivered_products(delivered), "agv1")
    points = referee_of(case).score(trial_of([Order(order["id"], (task,), 0.0), handed_in]))

    subject = f"{order['id']}/{task.id}"
    names = {"presence_points": "present", "completion_score": "total", "type_points": "type"}
    names |= {"color_points": "color", "pose_points": "pose", "bonus": "bonus"}
    for key, value in expected.items():
        if key == "complete":
            assert satisfied(points, "none_missing", subject) == value
        elif key in names:
            assert points.terms[subject, names[key]] == value
        else:
            pytest.fail(f"unknown expectation {key!r} of a shipment")


def placed(part: Mapping[str, Any], i: int) -> dict[str, Any]:
    """An ordered product with a pose: the given place, or one of its own."""
    x, y = part.get("xy", [float(i), 0.0])
    return {"xyz": [x, y, 0.0], "rpy": [0.0, 0.0, 0.0], **part}


def compare_sums(expected: Mapping[str, Any]) -> None:
    """The printed numbers must add up among themselves."""
    orders = expected.get("orders", [])
    if orders and all("total" in order for order in orders) and not expected.get("arms_collision"):
        penalty = expected.get("dropped_part_penalty", 0)
        assert add(order["total"] for order in orders) - penalty == expected["game_total"]
    for order in orders:
        shipments = [*order.get("kitting", []), *order.get("assembly", [])]
        if shipments and all("completion_score" in s for s in shipments) and "priority" in order:
            assert order["total"] == order["priority"] * add(s["completion_score"] for s in shipments)
        for shipment in shipments:
            parts = [shipment.get(key) for key in ("two_points_type_and_pose", "one_point_color", "bonus")]
            if None not in parts:
                assert add(parts) == shipment["completion_score"]


def add(numbers: Iterable[float | None]) -> float:
    total = 0.0
    for number in numbers:
        total += number or 0.0
    return total


def compare_log(expected: Mapping[str, Any]) -> None:
    """The stored run itself, scored from its motion log."""
    log = SHARED / "ariac" / "data" / "nist_team_2022"
    if log.is_dir():
        assert score_trial(log, RULE_SETS["2022"]).score == expected["game_total"]


def observed(**facts: Any) -> Case:
    return {"format": "ariac-case/1", "id": "seen", "kind": "observed", **facts}, {}


SEEN = {
    "edition": "2020",
    "orders": [
        {
            "id": "order_0",
            "shipments": [{"type": "s", "agv": "any", "products": [{"type": "gear_part_red"}]}],
        }
    ],
    "delivered": [{"type": "gear_part_red"}],
}


@pytest.mark.parametrize(
    "facts",
    [
        {},
        {"edition": "2023", "valid_for": [], "expected_reported_by_user": 7},
        {
            "edition": "2024",
            **{key: SEEN[key] for key in ("orders", "delivered")},
            "expected": {"shipment": {}},
        },
        {**SEEN, "orders": [], "expected": {"shipment": {"pose_points": 1}}},
        {**SEEN, "expected": {"shipment": {"completion_score": 4}}},
    ],
    ids=["nothing", "a bug", "a year without rules", "no order", "no poses"],
)
def test_an_observation_without_notes_that_is_no_oracle_is_skipped(facts: dict[str, Any]) -> None:
    with pytest.raises(pytest.skip.Exception, match="no oracle: it tells of a part of a run"):
        test_observation_of_a_run(observed(**facts))


def test_an_observation_without_notes_that_tells_enough_is_compared() -> None:
    right = {"type_points": 1, "color_points": 1, "pose_points": 1, "bonus": 1, "completion_score": 4}
    test_observation_of_a_run(observed(**SEEN, expected={"shipment": right}))
    test_observation_of_a_run(observed(expected={"game_total": 5, "orders": [{"total": 2}, {"total": 3}]}))

    with pytest.raises(AssertionError):
        test_observation_of_a_run(observed(**SEEN, expected={"shipment": {**right, "bonus": 0}}))
    with pytest.raises(AssertionError):
        test_observation_of_a_run(
            observed(expected={"game_total": 6, "orders": [{"total": 2}, {"total": 3}]})
        )
    with pytest.raises(pytest.fail.Exception, match="unknown expectation 'bonuses'"):
        test_observation_of_a_run(observed(**SEEN, expected={"shipment": {"pose_points": 1, "bonuses": 1}}))


def test_a_case_of_a_folder_elsewhere_needs_neither_id_nor_notes(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("no case", encoding="utf-8")
    (tmp_path / "of-its-own.json").write_text('{"kind": "observed"}', encoding="utf-8")

    assert cases_in(tmp_path) == [{"id": "of-its-own", "kind": "observed"}]


@pytest.mark.parametrize("text", ["{", "[]", "7"])
def test_a_file_that_is_no_case_is_named(text: str, tmp_path: Path) -> None:
    (tmp_path / "broken.json").write_text(text, encoding="utf-8")

    with pytest.raises(pytest.UsageError, match=r"broken\.json: no official case"):
        cases_in(tmp_path)


def test_a_case_of_a_year_without_a_rule_set_fails_and_says_so() -> None:
    with pytest.raises(pytest.fail.Exception, match="seen is valid for 2031; there are rule sets for 2017"):
        referee_of({"id": "seen", "edition": "2031"})
