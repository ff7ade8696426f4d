"""How a score is shared among findings: cases worked by hand, and trees against another program.

Each case is one formula with findings and the amounts that follow from it by hand: linear ones at sight,
hyperbolas in proportion to demerits, products by the logarithmic mean (Ang 2004), minima by where two
straight lines cross. Where `../shared/methods` is present its cases are compared too, which scripts of
their own computed in fractions and decimals.
"""

from __future__ import annotations

import importlib.util
import json
import math
import random
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from ariac_score.checks.findings import Finding
from ariac_score.checks.measures import Measure, Role
from ariac_score.errors import FormulaError
from ariac_score.scoring.attribution import (
    Changed,
    Choice,
    Extreme,
    Function,
    Given,
    Leaf,
    Named,
    Node,
    Product,
    Sum,
    flow,
    truth,
)
from ariac_score.scoring.cohort import CohortTerm, CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.ledger import reconcile
from ariac_score.scoring.shares import exactly
from ariac_score.scoring.worlds import EARNED, TAKEN

from .attributed import Case, N, S, U, V, amounts, found, order, times, told

METHODS = Path(__file__).parents[3] / "shared/methods"


def best(value: float | None = None, role: Role = "measure") -> dict[str, Measure]:
    return {"q": Measure("1", role, value)}


def measured(**values: float) -> list[tuple[str, Finding]]:
    return [found(name, S, q=value) for name, value in values.items()]


CLIPPED = "5 / clip(measure(time, q), 10, 40)"
TIME = {"time": best(0.0)}
GATED = "12 * gate(g) / (1 + 0.4 * count(near) + 0.7 * count(limit))"
NEAR = [*times("near", 2), *times("limit", 1)]
_WEIGHTS = {"progress": 5, "ttc": 5, "speed": 4, "comfort": 2}
SOFT = f"({' + '.join(f'{by} * measure({name}, q)' for name, by in _WEIGHTS.items())}) / 16"
_SOFT = {"progress": 0.8, "ttc": 0.0, "speed": 0.9, "comfort": 1.0}

CASES: dict[str, tuple[Case, float, dict[str, float]]] = {
    "A1": (Case("10 - 2 * count(x)", times("x", 3)), 4, {"x#0": -2, "x#1": -2, "x#2": -2}),
    "A2": (Case("max(0, 10 - 2 * count(x))", times("x", 7)), 0, {f"x#{i}": -10 / 7 for i in range(7)}),
    "A3b": (
        Case(
            "min(80, 30 * points(place) + 15 * points(precise) - 10 * count(bump))",
            [*times("place", 3, S), *times("precise", 1, S), *times("bump", 1)],
        ),
        80,
        {"bump#0": 0},
    ),
    "A4": (
        Case("100 * product(ped, p=0.5) * product(red, p=0.7)", [*times("ped", 1), *times("red", 2)]),
        24.5,
        # 75.5 in proportion to ln 0.5 and 2 ln 0.7
        {
            "ped#0": -75.5 * math.log(0.5) / math.log(0.245),
            "red#0": -75.5 * math.log(0.7) / math.log(0.245),
            "red#1": -75.5 * math.log(0.7) / math.log(0.245),
        },
    ),
    "A5": (
        Case("100 * product(red, p=0.7) * product(stop, p=0.8)", [*times("red", 1), *times("stop", 1)]),
        56,
        {"red#0": -27.066569386, "stop#0": -16.933430614},
    ),
    "A6": (
        Case(
            "100 * (1 - measure(out, q)) * product(red, p=0.7)",
            [*measured(out=1.0), *times("red", 1)],
            measures={"out": best(0.0)},
        ),
        0,
        {"red#0": -30, "out#0": -70},
    ),
    "A7": (
        Case("100 / (1 + count(ped) + 0.7 * count(veh))", [*times("ped", 1), *times("veh", 2)]),
        100 / 3.4,
        {"ped#0": -240 / 3.4 / 2.4, "veh#0": -168 / 3.4 / 2.4, "veh#1": -168 / 3.4 / 2.4},
    ),
    "A9": (Case(CLIPPED, measured(time=25.0), measures=TIME), 0.2, {"time#0": -0.3}),
    "A10": (Case(CLIPPED, measured(time=60.0), measures=TIME), 0.125, {"time#0": -0.375}),
    "A11": (
        Case(f"holds(bump) * {CLIPPED}", [*measured(time=25.0), *times("bump", 1)], measures=TIME),
        0,
        {"time#0": -0.3, "bump#0": -0.2},
    ),
    "A12": (
        Case(
            f"(0.5 if violated(lane) else 1) * {SOFT}",
            [*measured(**_SOFT), *times("lane", 1)],
            measures={name: best(role="factor") for name in _SOFT},
        ),
        0.3,
        {"progress#0": -0.0625, "ttc#0": -0.3125, "speed#0": -0.025, "lane#0": -0.3},
    ),
    "A13": (
        Case("0.6 * holds(a) * gate(b)", [*times("a", 1), *times("b", 1)]),
        0,
        {"a#0": -0.3, "b#0": -0.3},
    ),
    "A14": (
        Case(GATED, [*times("g", 1), *NEAR]),
        0,
        {"near#0": -1.92, "near#1": -1.92, "limit#0": -3.36, "g#0": -4.8},
    ),
    "A15": (
        Case(GATED, [*times("g", 1, S), *NEAR]),
        4.8,
        {"near#0": -1.92, "near#1": -1.92, "limit#0": -3.36},
    ),
    "A16": (
        Case(f"holds(h) * {GATED}", [*times("g", 1), *times("h", 2), *NEAR]),
        0,
        {"near#0": -1.92, "near#1": -1.92, "limit#0": -3.36, "g#0": -2.4, "h#0": -1.2, "h#1": -1.2},
    ),
    "A17": (
        Case(
            "measure(e, q) * (2 - measure(m, q))",
            measured(e=-3.0, m=0.4),
            measures={"e": best(role="points"), "m": best(role="factor")},
        ),
        -4.8,
        {"m#0": -1.8},
    ),
    "A18": (
        Case(
            "min(measure(a, q), measure(b, q))",
            measured(a=2.0, b=5.0),
            measures={"a": best(10.0), "b": best(6.0)},
        ),
        2,
        {"a#0": -24 / 7, "b#0": -4 / 7},
    ),
    "A19": (
        Case(
            "min(measure(a, q), measure(b, q))",
            measured(a=4.0, b=4.0),
            measures={"a": best(10.0), "b": best(10.0)},
        ),
        4,
        {"a#0": -3, "b#0": -3},
    ),
    "A20": (
        Case("12 - 1.5 * count(x) + (6 if holds(x) else 0)", times("x", 2)),
        9,
        {"x#0": -4.5, "x#1": -4.5},
    ),
    "A21": (
        Case(
            "measure(x, q) if holds(c) else measure(y, q)",
            [*measured(x=8.0, y=3.0), *times("c", 1)],
            measures={"x": best(10.0), "y": best(4.0)},
        ),
        3,
        {"c#0": -6, "y#0": -1, "x#0": 0},
    ),
    "A22": (Case("20 * 0.9 ** count(x)", times("x", 3)), 14.58, {f"x#{i}": -5.42 / 3 for i in range(3)}),
    "A23": (
        Case(
            "mean(measure(a, q), measure(b, q), measure(c, q), measure(d, q))",
            measured(a=9.0, b=6.0, c=0.0, d=9.0),
            measures=dict.fromkeys("abcd", best(9.0)),
        ),
        6,
        {"b#0": -0.75, "c#0": -2.25},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_worked_case_has_the_amounts_that_follow_by_hand(name: str) -> None:
    case, score, wanted = CASES[name]

    assert case.score == pytest.approx(score, abs=1e-12)
    assert {key: float(amount) for key, amount in case.taken.items()} == pytest.approx(wanted, abs=1e-9)


def _given(name: str) -> dict[str, Any]:
    if not METHODS.is_dir():
        pytest.skip("the worked cases are not here: ../shared/methods")
    cases = json.loads((METHODS / "cases.json").read_text(encoding="utf-8"))["attribution"]
    found: dict[str, Any] = next(case["expect"] for case in cases if case["id"] == name)
    return found


def _flat(value: Any) -> dict[str, float]:
    return {k: v for k, v in value.items() if isinstance(v, int | float)}


@pytest.mark.parametrize(
    ("name", "of", "keys"),
    [
        ("A4", "lmdi", {"pedestrian": "ped#0", "red_1": "red#0", "red_2": "red#1"}),
        ("A5", "lmdi", {"red": "red#0", "stop": "stop#0"}),
        ("A6", "recommended_graded_first", {"red": "red#0", "outside_lanes": "out#0"}),
        ("A7", "aumann_shapley", {"pedestrian": "ped#0", "vehicle_1": "veh#0", "vehicle_2": "veh#1"}),
        ("A9", "", {"time": "time#0"}),
        ("A10", "", {}),
        ("A11", "recommended", {"time": "time#0", "success_gate": "bump#0"}),
        ("A12", "soft", {"progress": "progress#0", "ttc": "ttc#0", "speed": "speed#0"}),
        ("A13", "", {"each_gate": "a#0"}),
        ("A14", "graded", {"near_1": "near#0", "near_2": "near#1", "limit": "limit#0"}),
        ("A15", "graded", {"near_1": "near#0", "near_2": "near#1", "limit": "limit#0"}),
        ("A16", "", {"finding_A1": "g#0", "finding_B1": "h#0", "finding_B2": "h#1"}),
        ("A17", "", {"demerits": "m#0"}),
        ("A18", "", {"a": "a#0", "b": "b#0"}),
        ("A19", "", {"a": "a#0", "b": "b#0"}),
        ("A20", "", {"each_of_the_two": "x#0"}),
        ("A21", "recommended", {"switch": "c#0", "y": "y#0", "x": "x#0"}),
        ("A22", "", {"each": "x#2"}),
        ("A23", "", {"order_2": "b#0", "order_3": "c#0"}),
        ("A1", "", {"each": "x#1"}),
        ("A2", "", {"effective_each": "x#6"}),
    ],
)
def test_the_collected_cases_say_the_same(name: str, of: str, keys: dict[str, str]) -> None:
    expect, (case, _, _) = _given(name), CASES[name]
    wanted = _flat(expect[of] if of else expect)
    taken = case.taken

    assert case.score == pytest.approx(expect["score"], abs=1e-8)
    for theirs, ours in keys.items():
        assert float(taken[ours]) == pytest.approx(wanted[theirs], abs=1e-8)


def test_a_floor_is_a_line_of_its_own_by_the_rule_and_amounts_are_in_effect() -> None:
    lines = {line.path: line for line in CASES["A2"][0].ledger.walk()}
    (floor,) = [line for line in lines.values() if line.kind == "cap"]

    # 7 times -2 is -14, and the floor gives 4 back; in effect 10 of 14 count: -10/7 each.
    assert (floor.amount, floor.nominal) == (0, 4)
    each = lines["score/taken/x/x#6"]
    assert (str(each.amount), each.nominal) == ("-1.428571", -2)


def test_a_cap_takes_back_what_lies_above_it_and_hides_a_deduction() -> None:
    # 105 were earned and 95 are left, both above 80: the cap takes 15, and the deduction shows nowhere.
    lines = {line.label: line for line in CASES["A3b"][0].ledger.walk()}
    (cap,) = [line for line in lines.values() if line.kind == "cap"]

    assert (lines["earned"].amount, cap.nominal) == (80, -15)
    (hidden,) = [line for line in lines.values() if line.findings == ("bump#0",)]
    assert (hidden.amount, hidden.nominal, hidden.reason.split(":")[0]) == (
        0,
        -10,
        "hidden by min(80, 30 * points(place) + 15 * points(precise) - 10 * count(bump))",
    )
    earned = CASES["A3b"][0].earned
    assert [float(earned[f"place#{i}"]) for i in range(3)] == pytest.approx([30 * 80 / 105] * 3)


@pytest.mark.parametrize(
    ("formula", "price", "bound"),
    [
        # What is added up and multiplied with fixed numbers has a price, whatever a cap makes of it.
        ("max(0, 10 - 3 * count(x))", -3, 2),
        ("2 + max(0, 10 - 3 * count(x)) / 2", -1.5, 1),
        ("k * max(0, 10 - 3 * count(x))", -1.2, 0.8),
        ("max(0, (10 - 3 * count(x)) * trial.duration_s)", -180, 120),
        ("10 - clip(3 * count(x), 0, 10)", -3, 2),
        ("mean(max(0, 10 - 3 * count(x)), 4)", -1.5, 1),
        ("min(1, max(0, 10 - 3 * count(x)))", -3, None),  # two bounds, a line each
        ("max(0, 10 - 3 * count(x) if k < 1 else 0)", -3, 2),
        ("max(0, 10 - 3 * count(x) * points(w))", -3, 2),  # points are earned first, and then fixed
        ("max(0, 10 - demerits(x, tau_s=0.25))", -3, 2),
        # In what is divided by, raised or decided, and beside another factor, it has none.
        ("10 / max(1, 3 * count(x))", None, 0),
        ("max(0, 10 - 3 * count(x)) * product(y, p=0.5)", None, 0),
        ("max(0, 10 - 3 * count(x)) ** 2", None, 0),
        ("2 ** max(0, 1 - 3 * count(x))", None, 0),
        ("max(6, 10 * product(x, p=0.5))", None, 0),
        ("max(6, 10 / (1 + count(x)))", None, 0),
        ("max(6, 10 - 3 * count(x) * count(y))", None, 0),
        ("max(0, 1 if count(x) < 2 else -3)", None, 0),
        ("1 if max(0, 10 - 3 * count(x)) > 0 else 0", None, 0),
        ("max(0, 10 - points(w) * count(x) * count(y))", None, 0),
        ("max(2, 5 * points(w) / (1 + count(x)))", None, 0),
        ("max(9, 20 * points(w) * (cohort.mean / measure(own, q)) - 3 * count(x))", None, 0),
        ("max(0, 10 - 3 * count(x)) if holds(y) else max(0, 9 - 3 * count(x))", None, 0),
        ("min(10 - 3 * count(x), 9 - 3 * count(x))", None, 0),
    ],
)
def test_a_price_beside_an_amount_is_one_that_the_rule_has(
    formula: str, price: float | None, bound: float | None
) -> None:
    deep = {"time_in_violation_s": 1.0, "relative_depth_integral_s": 0.5}
    case = Case(
        formula,
        [
            *(found("x", V, i, **deep) for i in range(4)),
            *times("y", 1),
            *times("w", 1, S),
            found("own", S, q=2.0),
        ],
        parameters={"k": 0.4},
        measures={"own": best()},
        cohort=CohortValues("", {"mean": {"": 1.0}}),
        cohort_terms={"mean": CohortTerm("mean", "trial", Expression.parse("1"))},
    )
    lines = list(case.ledger.walk())
    taken = [line for line in lines if line.kind == "taken" and line.findings]
    prices = {line.nominal for line in taken if line.findings[0].startswith("x")}
    bounds = [line.nominal for line in lines if line.kind == "cap"]

    assert case.ledger.nominal is None  # both columns add up to the score
    assert prices == {None if price is None else Decimal(str(price))}
    assert bound is None or bounds == ([Decimal(str(bound))] if bound else [])


def test_a_clip_lets_through_the_seconds_within_its_bounds() -> None:
    # A10: from the best 10 s to 60 s, of which those up to 40 s count: 30 of 50.
    case = Case("clip(measure(time, q), 10, 40)", measured(time=60.0), measures={"time": best(10.0)})

    (leaf,) = flow(case.tree, TAKEN).leaves()
    assert leaf[1] == Fraction(30, 50)
    assert case.taken == {"time#0": 30}


def test_in_one_block_a_cap_scales_all_alike() -> None:
    # A3: all five at once, from 0 to 95 under a cap of 80.
    summands = {"place#0": 30, "place#1": 30, "place#2": 30, "precise#0": 15, "bump#0": -10}
    leaves = [Leaf(key, [0, by], [Changed(key, (by,))]) for key, by in summands.items()]
    raw = Sum("raw", [(1, leaf) for leaf in leaves], [0, 95])
    capped = Extreme("capped", [raw, Given("80", 80, 2)], [0, 80], 1)

    amounts = {leaf.label: slope * leaf.change(0) for leaf, slope in flow(capped, 0).leaves()}
    assert amounts == {key: Fraction(80 * by, 95) for key, by in summands.items()}


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        # Two that turn a condition share it, whichever is written first.
        ("6 if holds(a) and holds(b) else 0", {"a#0": -3, "b#0": -3}),
        ("6 if holds(b) and holds(a) else 0", {"a#0": -3, "b#0": -3}),
        # Both sides move the difference, from 0 < 1 to 1 < 0: by 1 each.
        ("0 if violated(a) > holds(b) else 6", {"a#0": -3, "b#0": -3}),
        ("6 if holds(b) >= violated(a) else 0", {"a#0": -3, "b#0": -3}),
        # A factor that comes back to where it was: its slope is that of the square, 2 * 3.
        ("(3 - violated(a) + violated(b)) ** 2", {"a#0": -6, "b#0": 6}),
    ],
)
def test_those_that_turn_a_thing_together_share_it_by_what_they_moved(
    formula: str, expected: dict[str, float]
) -> None:
    case = Case(formula, [*times("a", 1), *times("b", 1)])

    assert {key: float(by) for key, by in case.taken.items()} == expected


def test_a_function_of_three_that_change_is_shared_over_all_six_orders() -> None:
    # xyz from 1 to 2, 3, 4, without logarithms: x alone first 1, last 12, between 3 and 4 once each.
    changes = {"x": 1, "y": 2, "z": 3}
    leaves = [Leaf(n, [1, 1 + by], [Changed(n, (by,))]) for n, by in changes.items()]
    root = Function("f", leaves, [1, 24], lambda x, y, z: x * y * z)

    amounts = {leaf.label: slope * leaf.change(0) for leaf, slope in flow(root, 0).leaves()}
    assert amounts["x"] == Fraction(2 * 1 + 3 + 4 + 2 * 12, 6)
    assert sum(amounts.values()) == 23


def test_a_cap_that_held_with_nothing_done_takes_back_by_the_rule() -> None:
    # 100 are given and 3 lost, of which nothing shows: by the rule 97, and 17 above the cap.
    lines = {line.label: line for line in Case("min(80, 100 - 3 * count(x))", times("x", 1)).ledger.walk()}

    (cap,) = [line for line in lines.values() if line.kind == "cap"]
    assert (lines["earned"].amount, lines["earned"].nominal, cap.nominal) == (80, 100, -17)


def test_what_is_earned_above_a_cap_has_its_price_by_the_rule() -> None:
    ledger = Case("min(8, 5 * points(x))", times("x", 2, S)).ledger
    prices = {line.findings: (line.amount, line.nominal) for line in ledger.walk() if line.kind == "amount"}

    assert prices == {("x#0",): (4, 5), ("x#1",): (4, 5)}


def test_points_of_other_runs_are_earned() -> None:
    case = Case(
        "runs.done",
        times("x", 1, S),
        trial={"done": "points(x)"},
        cohort=CohortValues("", {"runs.done": {"": 4.0}}),
    )

    assert (case.earned, case.taken) == ({"x#0": 1, "runs": 3}, {})


def test_a_bound_in_force_with_nothing_done_is_earned_in_effect_and_not_by_the_rule() -> None:
    # None of the rule's -4 counts with nothing done, and 2 of the 6 points show.
    ledger = Case("max(0, 6 * points(x) - 4)", times("x", 1, S)).ledger
    leaves = [line for line in ledger.walk() if not line.children]

    assert {(line.amount, line.nominal) for line in leaves} == {(2, 6), (0, -4)}
    assert (ledger.amount, ledger.nominal) == (2, None)


def test_a_factor_that_cancels_within_has_the_slope_of_what_stands_beside_it() -> None:
    # (3 - a + b) stays 3, beside 100 that halves twice: 75 less over ln 4, times a third of 3.
    case = Case(
        "100 * (3 - count(a) + count(b)) * product(x, p=0.5)",
        [*times("a", 1), *times("b", 1), *times("x", 2)],
    )

    assert float(case.taken["b#0"]) == pytest.approx(75 / math.log(4))
    assert float(case.taken["a#0"]) == pytest.approx(-75 / math.log(4))


def test_an_episode_told_in_two_pieces_leaves_what_others_pay() -> None:
    whole = [found("a", V, q=0.4), found("b", V, q=0.6)]
    pieces = [found("a", V, 0, q=0.2), found("a", V, 1, q=0.2), found("b", V, q=0.6)]
    measures = {"a": best(role="penalty"), "b": best(role="penalty")}
    formula = "100 / (1 + measure(a, q) + measure(b, q))"
    one, two = (Case(formula, f, measures=measures).taken for f in (whole, pieces))

    # A8: 50 points lost, 4 to 6
    assert (one["a#0"], one["b#0"]) == (-20, -30)
    assert (two["a#0"], two["a#1"], two["b#0"]) == (-10, -10, -30)


def test_three_equals_keep_equal_amounts_and_a_line_says_what_rounding_moved() -> None:
    case = Case("-10 * violated(x)", times("x", 3), digits=2)
    (group,) = [line for line in case.ledger.walk() if line.path == "score/taken"]

    assert [str(line.amount) for line in group.children[0].children] == ["-3.33", "-3.33", "-3.33", "-0.01"]


def test_a_thousand_factors_are_no_burden_and_add_up() -> None:
    # A26: factors 0.990, 0.991, … 0.999 in turn
    factors = [Fraction(990 + i % 10, 1000) for i in range(1000)]
    leaves = [
        Leaf(f"f{i}", (1.0, float(p)), [Changed(f"f{i}", (p - 1,))], exact=(1, p))
        for i, p in enumerate(factors)
    ]
    product = Product("all", [(Given("100", 100, 2), 1), *((leaf, 1) for leaf in leaves)], (100.0, 0.4))
    found = amounts(product, 0)

    assert float(product.exact[1]) == pytest.approx(0.400845, abs=1e-6)
    assert float(min(found.values())) == pytest.approx(-0.181362786, abs=1e-8)
    assert abs(sum(found.values()) - (product.exact[1] - 100)) < Fraction(1, 10**40)


# Against another program ---------------------------------------------------------------


def _oracle() -> ModuleType:
    file = METHODS / "s5_tree.py"
    if not file.is_file():
        pytest.skip("the other program is not here: ../shared/methods/s5_tree.py")
    spec = importlib.util.spec_from_file_location("s5_tree", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _node(tree: Any, oracle: ModuleType) -> Node:
    kind = tree[0]
    numbers = [oracle.ev(tree, world) for world in (0, 1)]
    if kind == "leaf":
        return Leaf(tree[1], numbers, [Changed(tree[1], (exactly(tree[3]) - exactly(tree[2]),))])
    if kind == "if":
        condition, first, second = (_node(each, oracle) for each in tree[1:])
        return Choice("if", truth(condition), first, second)
    inner = [_node(each, oracle) for each in tree[1]]
    if kind == "sum":
        return Sum("sum", [(exactly(by), each) for by, each in zip(tree[2], inner, strict=True)], numbers)
    if kind == "prod":
        return Product("product", list(zip(inner, tree[2], strict=True)), numbers)
    return Extreme(kind, inner, numbers, 1 if kind == "min" else -1)


def _tree(rng: random.Random, depth: int, parent: str = "") -> Any:
    """A random tree without nested kinds, which are one here, and without changes of sign."""
    kind = rng.choice(["sum", "prod", "min", "max", "if", "leaf"]) if depth else "leaf"
    if kind in ("leaf", parent):
        before = rng.choice([1.0, 2.0, 0.5])
        after = rng.choice([before, 0.0, 0.25, 0.5, 1.5, 3.0])
        return ("leaf", f"f{rng.randrange(10**12)}", before, after)
    if kind == "if":
        gate = ("leaf", f"g{rng.randrange(10**12)}", 1.0, rng.choice([0.0, 1.0]))
        return ("if", gate, _tree(rng, depth - 1), _tree(rng, depth - 1))
    inner = [_tree(rng, depth - 1, kind) for _ in range(rng.randint(2, 4))]
    by = [rng.choice([1, 0.5, 2]) if kind == "sum" else 1 for _ in inner]
    return (kind, inner) if kind in ("min", "max") else (kind, inner, by)


def test_random_trees_are_shared_as_another_program_shares_them() -> None:
    oracle, rng = _oracle(), random.Random(18)  # noqa: S311
    for _ in range(400):
        tree = _tree(rng, 3)
        node = _node(tree, oracle)
        ours, theirs = amounts(node, 0), oracle.flow(tree)
        assert {k: float(ours.get(k, 0)) for k in theirs} == pytest.approx(theirs, abs=1e-9), tree
        assert abs(sum(ours.values()) - node.change(0)) < Fraction(1, 10**40)


# Single pieces -------------------------------------------------------------------------


def _leaf(name: str, before: float, after: float) -> Leaf:
    return Leaf(name, (before, after), [Changed(name, (exactly(after) - exactly(before),))])


def test_a_factor_that_changes_its_sign_shares_over_all_orders() -> None:
    # x: 2 to -1, y: 3 to 5: the mean of -3 * 3 and -3 * 5, and of 2 * 2 and -1 * 2
    product = Product("x * y", [(_leaf("x", 2, -1), 1), (_leaf("y", 3, 5), 1)], (6, -5))

    assert amounts(product, 0) == {"x": -12, "y": 1}


def test_what_cancels_inside_a_factor_is_told_with_both_signs() -> None:
    inner = Sum("a + b", [(1, _leaf("a", 1, 2)), (1, _leaf("b", 1, 0))], (2, 2))
    product = Product("5 * (a + b)", [(Given("5", 5, 2), 1), (inner, 1)], (10, 10))

    assert amounts(product, 0) == {"a": 5, "b": -5}


def test_a_product_is_the_same_in_whatever_brackets_and_under_whatever_names() -> None:
    def shared(nest: bool) -> dict[str, Any]:
        a, b, c, gate = _leaf("a", 1, 0.5), _leaf("b", 1, 0.7), _leaf("c", 4, 2), _leaf("gate", 1, 0)
        if not nest:
            return amounts(Product("", [(a, 1), (b, 1), (c, -1), (gate, 1)], (0.25, 0)), 0)
        inner = Named("term", Product("", [(gate, 1), (Product("", [(c, 1)], (4, 2)), -1)], (0.25, 0)))
        return amounts(Product("", [(Product("", [(inner, 1), (b, 1)], (0, 0)), 1), (a, 1)], (0.25, 0)), 0)

    assert shared(True) == shared(False)


def test_a_function_of_several_that_change_is_shared_over_all_orders() -> None:
    # x ** y from 2 ** 1 to 3 ** 2: x first 1 then 6 with y; y first 2 then 5
    function = Function("x ** y", (_leaf("x", 2, 3), _leaf("y", 1, 2)), (2, 9), lambda x, y: x**y)

    assert amounts(function, 0) == {"x": 3, "y": 4}


def test_a_step_function_charges_what_made_it_jump() -> None:
    function = Function("ramp(x)", (_leaf("x", 10, 31),), (1.0, 0.0), lambda x: float(x < 30))

    assert amounts(function, 0) == {"x": -1}


def test_shared_terms_cost_no_more_than_once() -> None:
    node: Node = _leaf("x", 1, 2)
    for i in range(200):  # as a tree it would have 2 ** 200 leaves
        node = Named(f"t{i}", Sum("", [(Fraction(1, 2), node), (Fraction(1, 2), node)], node.numbers))

    assert amounts(node, 0) == {"x": 1}
    assert len(flow(node, 0).slopes) < 1000


# What a ledger says --------------------------------------------------------------------


def test_a_floor_that_was_just_reached_and_never_held_stands_nowhere() -> None:
    # 2 at first is the floor as well as the number above it; the number is what there is.
    ledger = Case("max(2, 2 + points(x))", times("x", 3, S)).ledger

    assert told(ledger)["score/earned/2"] == "2"
    assert told(ledger)["score/earned/points_x"] == "3"
    assert all(line.nominal is None and line.kind != "cap" for line in ledger.walk())


def test_a_branch_that_was_left_tells_what_it_held_and_who_left_it() -> None:
    # 5 at first; x turns it to 7 as y was then, and y brings 2 to the new branch.
    case = Case("5 if points(x) < 1 else 7 + points(y)", [*times("x", 1, S), *times("y", 2, S)])
    lines = told(case.ledger)

    assert lines["score/earned"] == "9"
    assert (lines["score/earned/5"], lines["score/earned/0"], lines["score/earned/points_y"]) == (
        "5",
        "2",
        "2",
    )


def test_only_what_moved_pays_for_a_condition_that_was_turned() -> None:
    # k was true all along: b alone turned it, and pays all.
    made = [*times("a", 1, S), *times("b", 2)]
    case = Case("6 if k and holds(a) and holds(b) else 0", made, parameters={"k": 1})

    assert case.taken == {"b#0": -3, "b#1": -3}


def test_what_moves_beside_those_that_turned_a_condition_pays_nothing() -> None:
    # From 0 to 1 and back: of two violations one is made up for, so this part never turned; b did.
    formula = "6 if (violated(x) - violated(y) + 1) and holds(b) else 0"
    case = Case(formula, [*times("x", 1), *times("y", 1), *times("b", 1)])

    assert {key: by for key, by in case.taken.items() if by} == {"b#0": -6}


def test_a_quantity_of_several_findings_starts_at_the_best_of_each() -> None:
    # Two factors that would be 1 at best, so 2 together: of 10 - 4 the one at 3 took its 2.
    case = Case(
        "10 - measure(x, q)", [found("x", S, 0, q=1.0), found("x", S, 1, q=3.0)], measures={"x": best(1.0)}
    )

    assert case.tree.exact == (8, 8, 6)
    assert case.taken == {"x#1": -2}


def test_findings_stand_in_the_order_of_their_numbers() -> None:
    made = sorted([*times("x", 12), *times("y", 12, S)])  # as texts: x#0, x#1, x#10, x#11, x#2 …
    ledger = Case("20 - count(x) - 0 * count(y)", made).ledger
    (taken,) = [line for line in ledger.walk() if line.path == "score/taken/x"]
    (kept,) = [line for line in ledger.walk() if line.path == "score/neutral/y"]

    assert [line.findings[0] for line in taken.children] == [f"x#{i}" for i in range(12)]
    assert list(kept.findings) == [f"y#{i}" for i in range(12)]


def test_what_a_formula_subtracts_for_no_violation_says_less() -> None:
    case = Case("points(x) - 0.1 * trial.duration_s", times("x", 8, S))  # of 60 s
    line = next(line for line in case.ledger.walk() if "duration_s" in line.path)

    assert (line.label, line.amount, line.path) == (
        "less 0.1 * trial.duration_s",
        -6,
        "score/earned/0.1_trial.duration_s",
    )


@pytest.mark.parametrize(
    ("formula", "label"),
    [
        # A gate, or a number that penalties are subtracted from, earned nothing: the whole product did.
        ("holds(x) * trial.duration_s / 12", "holds(x) * trial.duration_s / 12"),
        ("12 * (1 - 0.1 * count(x))", "12 * (1 - 0.1 * count(x))"),
        ("12 * (1 if holds(x) else 0.5)", "12 * (1 if holds(x) else 0.5)"),
        # What is worked out of given numbers is one number.
        ("bonus * holds(x)", "bonus * holds(x)"),
        ("bonus + points(y)", "bonus"),
    ],
)
def test_what_was_given_stands_under_the_name_of_the_whole(formula: str, label: str) -> None:
    made = [*times("x", 1, S), found("y", S)]
    case = Case(formula, made, trial={"bonus": "trial.duration_s - 10"})
    (earned,) = [line for line in case.ledger.walk() if line.path == "score/earned"]

    assert earned.children[0].label == label
    assert not earned.children[0].children


def test_orders_are_told_one_by_one_though_a_gate_stands_before_their_sum() -> None:
    terms = {"value": "3 + order.index"}
    case = Case("gate(x) * sum(order.value)", times("x", 1, S), scopes=order(1, 1), order=terms)

    assert told(case.ledger)["score/earned/o0"] == "3"
    assert told(case.ledger)["score/earned/o1"] == "4"


def test_a_bound_says_whether_it_is_a_cap_or_a_floor() -> None:
    bounds = {
        line.label
        for formula in ("max(0, 1 - count(x))", "min(1, 3 - count(x) / 2)", "clip(9 - 4 * count(x), 0, 5)")
        for line in Case(formula, times("x", 3)).ledger.walk()
        if line.kind == "cap"
    }

    assert bounds == {
        "floor: max(0, 1 - count(x))",
        "cap: min(1, 3 - count(x) / 2)",
        "floor: clip(9 - 4 * count(x), 0, 5)",
    }


def test_a_ledger_shows_every_subtrahend() -> None:
    case = Case("100 - 2 * count(x) - 3 * count(y)", [*times("x", 2), *times("y", 1)])

    assert told(case.ledger) == {
        "score": "93",
        "score/earned": "100",
        "score/earned/100": "100",
        "score/taken": "-7",
        "score/taken/x": "-4",
        "score/taken/x/x#0": "-2",
        "score/taken/x/x#1": "-2",
        "score/taken/y#0": "-3",
    }


@pytest.mark.parametrize(
    ("formula", "findings", "reason"),
    [
        ("5 * holds(x)", times("x", 1, S), "kept"),
        ("points(x) * holds(y)", [*times("x", 1), *times("y", 1)], "there was nothing that it could change"),
        ("7 if holds(y) else 3 - count(x)", [*times("y", 1, S), *times("x", 1)], "not in force: "),
        ("max(0, 1 - 2 * violated(y) - 0 * count(x))", [*times("y", 1), *times("x", 1)], ""),
        ("10 * gate(x)", [found("x", V)], "violated, but not critical"),
        ("10 - count(x)", [found("x", N)], "not applicable"),
        ("5 + (count(x) > 3)", times("x", 2), "it did not turn count(x) > 3"),
        ("10 + measure(x, q) * 0 + 1 / measure(x, q)", [found("x", S, q=2.0)], ""),
    ],
)
def test_a_finding_that_changed_nothing_says_why(
    formula: str, findings: list[tuple[str, Finding]], reason: str
) -> None:
    lines = [line for line in Case(formula, findings).ledger.walk() if line.reason and line.kind != "cap"]
    if reason:
        assert any(line.amount == 0 and line.reason.startswith(reason) for line in lines)


def test_a_covered_violation_says_that_a_heavier_one_covers_it() -> None:
    heavy, light = times("heavy", 1), times("light", 1)
    light = [(key, Finding("heavy/0", V, "light", span=f.span, check="light")) for key, f in light]
    ledger = Case("10 - charged(heavy=3, light=1, again_after_s=5)", [*heavy, *light]).ledger

    (line,) = [line for line in ledger.walk() if line.findings == ("light#0",)]
    assert (line.amount, line.reason) == (0, "a heavier violation covers it")


def test_an_undecided_finding_that_counts_as_violated_says_so() -> None:
    case = Case("10 - 2 * count(x)", times("x", 1))
    case.findings = {"x#0": Finding("a", U, "no samples", check="x")}
    case.policies = {"x": "worst_case"}

    (line,) = [line for line in case.ledger.walk() if line.findings == ("x#0",)]
    assert (line.amount, line.label) == (-2, "no samples (undecided)")


def test_pooled_runs_are_shared_between_this_run_and_the_others() -> None:
    # This run has 1 demerit, the team 4: of 100 / 5 this one pays a quarter of 80.
    case = Case(
        "100 / (1 + runs.demerits)",
        times("x", 1),
        trial={"demerits": "count(x)"},
        cohort=CohortValues("", {"runs.demerits": {"": 4.0}}),
    )

    assert told(case.ledger)["score/taken/x#0"] == "-20"
    assert told(case.ledger)["score/taken/runs"] == "-60"


def test_other_runs_that_only_brought_points_are_shared_where_points_are_earned() -> None:
    # This run has 1 point, the team 9.5. From 0.9 ** 0 = 1 to 0.9 ** 9.5, in proportion 1 to 8.5.
    case = Case(
        "0.9 ** runs.pooled",
        [*times("x", 1, S), found("bump", S)],
        trial={"pooled": "0.5 * count(bump) + points(x)"},
        cohort=CohortValues("", {"runs.pooled": {"": 9.5}}),
    )
    lines, lost = told(case.ledger), 1 - 0.9**9.5

    assert float(lines["score/earned"]) == float(lines["score"]) == pytest.approx(1 - lost, abs=1e-6)
    own, others = "score/earned/runs.pooled/pooled", "score/earned/runs.pooled/other_runs_of_the_team"
    assert float(lines[own]) == pytest.approx(-lost / 9.5, abs=1e-6)
    assert float(lines[others]) == pytest.approx(-lost * 8.5 / 9.5, abs=1e-6)
    reconcile(case.ledger, case.ledger.amount, digits=6)


def test_a_pooled_sum_of_this_run_alone_has_no_other_runs() -> None:
    # The pooled number is a float of many digits, and that of this run the same: nothing is left for others.
    case = Case(
        "1 - runs.demerits",
        [found("x", V, i, q=0.1) for i in range(3)],
        measures={"x": best(role="penalty")},
        trial={"demerits": "measure(x, q)"},
        cohort=CohortValues("", {"runs.demerits": {"": 0.1 + 0.1 + 0.1}}),
    )

    assert "score/taken/runs" not in told(case.ledger)


def test_digits_that_a_difference_lost_are_a_line_of_their_own() -> None:
    # 1 / (1 - 1.0000002) is -5 000 000; in float64 the difference has ten digits only.
    case = Case("1 / (1 - measure(x, q))", [found("x", V, q=1.0000002)], measures={"x": best(role="factor")})
    lines = told(case.ledger)

    assert lines["score/taken/x#0"] == "-5000000"
    assert lines["score"] == "-5000000.002632"
    assert lines["score/lost"] == "-0.002632"
    assert not [line for line in case.ledger.walk() if line.kind == "rounding"]
    reconcile(case.ledger, case.ledger.amount, digits=6)


def test_a_score_without_lost_digits_has_no_line_for_them() -> None:
    # 0.1 + 0.2 is 0.30000000000000004 in float64: far below the digits of a score.
    assert "score/lost" not in told(Case("0.1 + 0.2 + count(x)", times("x", 1), digits=9).ledger)


@pytest.mark.parametrize(
    "formula",
    [
        "100 ** 10 * holds(x)",  # 1e20 with nothing wrong, 0 as it was
        "(100 ** 10 * holds(x)) ** 10",
        "1e15 * 1e15 * holds(x)",
    ],
)
def test_an_amount_too_large_to_be_told_is_refused_with_its_place(formula: str) -> None:
    case = Case(formula, times("x", 1))

    assert case.score == 0
    with pytest.raises(FormulaError, match=r"what '(earned|score)' brought or took is too large to be told"):
        case.priced()


def test_what_has_no_finite_value_in_a_world_is_nothing_there() -> None:
    # With nothing wrong it would be beyond float64; as it was it is 2.
    case = Case("abs(1e15 ** (21 * holds(x)) * 10 ** (9 * holds(x))) + count(x)", times("x", 1))

    assert (case.score, float(case.tree.exact[TAKEN + 1])) == (2, 2)
    assert told(case.ledger)["score"] == "2"


def test_ratios_that_are_nearly_one_are_told_apart_from_one() -> None:
    # x from 3 to 3 + 3e-130 and y from 2 to 5: L(6, 15) = 9 / ln 2.5 for each unit of the logarithms.
    x = Leaf("x", (3.0, 3.0), [Changed("x", (Fraction(3, 10**130),))], exact=(3, 3 + Fraction(3, 10**130)))
    shared = amounts(Product("x * y", [(x, 1), (_leaf("y", 2, 5), 1)], (6, 15)), 0)

    assert float(shared["x"] * 10**130) == pytest.approx(9 / math.log(2.5), rel=1e-12)
    assert float(shared["y"]) == pytest.approx(9)


def test_factors_that_all_but_cancel_have_amounts() -> None:
    # x from 1 to 2 and y from 1 to (1 + 1e-90) / 2: L is 1, so ln 2 and -ln 2.
    half = (1 + Fraction(1, 10**90)) / 2
    y = Leaf("y", (1.0, 0.5), [Changed("y", (half - 1,))], exact=(1, half))
    shared = amounts(Product("x * y", [(_leaf("x", 1, 2), 1), (y, 1)], (1, 1)), 0)

    assert float(shared["x"]) == pytest.approx(math.log(2), rel=1e-15)
    assert float(shared["y"]) == pytest.approx(-math.log(2), rel=1e-15)


def test_comparing_with_other_teams_comes_after_what_was_earned() -> None:
    # 2 given and 3 earned are 5, and half of that: 2.5 of 5, not of what stood before.
    case = Case(
        "(2 + points(x)) * (cohort.cost / measure(own, q))",
        [*times("x", 3, S), found("own", S, q=2.0)],
        measures={"own": best()},
        cohort=CohortValues("", {"cost": {"": 1.0}}),
        cohort_terms={"cost": CohortTerm("cost", "trial", Expression.parse("1"))},
    )
    (line,) = [line for line in case.ledger.walk() if line.kind == "factor"]

    assert (line.amount, line.label) == (Decimal("-2.5"), "times cohort.cost / measure(own, q) = 0.5")
    assert [float(case.earned[f"x#{i}"]) for i in range(3)] == [1, 1, 1]


@pytest.mark.parametrize(
    ("formula", "label"),
    [
        # 60 and 50: a gate and penalties that are at their best are no comparison.
        ("points(x) * gate(g) * (cohort.cost / measure(own, q))", "cohort.cost / measure(own, q) = 1.2"),
        ("points(x) / (1 + count(g)) * cohort.cost / measure(own, q)", "cohort.cost / measure(own, q) = 1.2"),
        ("points(x) / measure(own, q) / cohort.cost", "1 / measure(own, q) / cohort.cost = 0.000333333"),
        ("points(x) * measure(own, q) / cohort.cost", "measure(own, q) / cohort.cost = 0.833333"),
    ],
)
def test_a_comparison_names_what_it_compares_and_no_gate_beside_it(formula: str, label: str) -> None:
    case = Case(
        formula,
        [*times("x", 3, S), *times("g", 2, S), found("own", S, q=50.0)],
        measures={"own": best()},
        cohort=CohortValues("", {"cost": {"": 60.0}}),
        cohort_terms={"cost": CohortTerm("cost", "trial", Expression.parse("1"))},
    )

    assert [line.label for line in case.ledger.walk() if line.kind == "factor"] == [f"times {label}"]


def test_what_compares_with_other_teams_is_a_line_of_its_own() -> None:
    case = Case(
        "points(x) * (cohort.cost / measure(own, q))",
        [*times("x", 3, S), found("own", S, q=50.0)],
        measures={"own": best()},
        cohort=CohortValues("", {"cost": {"": 60.0}}),
        cohort_terms={"cost": CohortTerm("cost", "trial", Expression.parse("1"))},
    )
    (line,) = [line for line in case.ledger.walk() if line.kind == "factor"]

    assert case.score == pytest.approx(3.6)
    assert (line.amount, line.findings) == (Decimal("0.6"), ("own#0",))
    assert [float(case.earned[f"x#{i}"]) for i in range(3)] == [1, 1, 1]


PLACES = {
    "alone": "{x}",
    "summand": "points(x) + {x} - count(bump)",
    "subtrahend": "points(x) - {x}",
    "factor": "points(x) * {x}",
    "factor of what is left": "(points(x) - count(bump)) * {x} / (1 + count(bump))",
    "factor of a named term": "sum(order.work) * {x}",
    "dividend": "{x} / (1 + count(bump)) * points(x)",
    "divisor": "points(x) / (2 + {x})",
    "in a power": "points(x) * (1 + {x}) ** 2",
    "the exponent": "points(x) * 0.9 ** {x}",
    "the base": "(3 + {x}) ** count(bump)",
    "in min": "min({x}, points(x))",
    "in max": "max({x}, points(x) - count(bump))",
    "clipped": "points(x) * clip({x}, 0.5, 1)",
    "the bound of a clip": "clip(points(x) - count(bump), 0, {x})",
    "condition": "points(x) if {x} > 0.75 else count(bump)",
    "branch": "{x} if holds(bump) else points(x) * {x}",
    "in and": "points(x) * ({x} > 0.5 and holds(bump))",
    "negated": "points(x) * (not {x})",
    "opposite": "points(x) * -{x}",
    "in abs": "points(x) + abs({x} - 1)",
    "of itself": "points(x) * {x} * {x} / (3 + {x})",
    "behind a gate": "points(x) * gate(bump) * {x}",
}
ACROSS = {
    "cohort, alone": "cohort.mean",
    "cohort, against a number of the trial": "(cohort.mean / measure(own, q))",
    "cohort, against a term": "factor",
    "runs": "runs.bumps",
}


@pytest.mark.parametrize("across", ACROSS)
@pytest.mark.parametrize("place", PLACES)
def test_what_other_trials_say_may_stand_anywhere_in_a_formula(place: str, across: str) -> None:
    formula = PLACES[place].replace("{x}", ACROSS[across])
    for mean in (-4.0, 0.0, 2.0, 4.0, 4.5, 8.0):  # 4: like the mean, 8: twice the own
        case = Case(
            formula,
            [*times("x", 3, S), *times("bump", 2), found("own", S, q=4.0), found("done", S, 0, "o0")],
            scopes=order(1),
            measures={"own": best()},
            cohort=CohortValues("", {"mean": {"": mean}, "runs.bumps": {"": 2.0 + abs(mean)}}),
            cohort_terms={"mean": CohortTerm("mean", "trial", Expression.parse("1"))},
            trial={"bumps": "count(bump)", "factor": "0.5 * (cohort.mean / measure(own, q) - 1) + 1"},
            order={"work": "points(done)"},
        )

        ledger = case.ledger
        assert float(ledger.amount) == pytest.approx(case.score, abs=1e-6)
        reconcile(ledger, ledger.amount, digits=6)
        moved = sum(abs(line.amount) for line in ledger.walk() if line.kind == "rounding")
        assert moved <= Decimal("0.00001")


@pytest.mark.parametrize(
    ("formula", "against"),
    [
        ("points(x) * {}", "cohort.mean / measure(own, q)"),
        ("points(x) * {}", "(1 + 0.25 * (cohort.mean / measure(own, q) - 1))"),
        ("sum(order.work) * {} / (1 + count(bump))", "cohort.mean / measure(own, q)"),
    ],
)
def test_a_trial_that_is_like_the_mean_earns_as_if_nobody_had_compared(formula: str, against: str) -> None:
    def ledger(score: str) -> dict[str, str]:
        case = Case(
            score,
            [*times("x", 3, S), *times("bump", 1), found("own", S, q=60.0), found("done", S, 0, "o0")],
            scopes=order(1),
            measures={"own": best()},
            cohort=CohortValues("", {"mean": {"": 60.0}}),
            cohort_terms={"mean": CohortTerm("mean", "trial", Expression.parse("1"))},
            order={"work": "points(done)"},
        )
        return {path: by for path, by in told(case.ledger).items() if by != "0"}

    assert ledger(formula.format(against)) == ledger(formula.format("1"))


def test_a_measured_number_is_what_its_check_declares_and_not_what_it_is_called() -> None:
    findings = [found("x", S, points=4.0)]
    kinds = {
        role: Case(
            "10 + measure(x, points)", findings, measures={"x": {"points": Measure("s", role)}}
        ).tree.exact
        for role in ("points", "penalty", "measure")
    }

    assert kinds == {"points": (10, 14, 14), "penalty": (10, 10, 14), "measure": (14, 14, 14)}


def test_scopes_of_a_sum_are_lines_and_a_single_one_too() -> None:
    findings = [found("x", S, i, f"o0/p{i}") for i in range(2)]
    case = Case("sum(order.total)", findings, scopes=order(2), order={"total": "3 * points(x)"})

    assert told(case.ledger)["score/earned/o0"] == "6"
    assert told(case.ledger)["score/earned/o0/p1"] == "3"


def test_steps_that_only_turn_come_after_what_is_graded() -> None:
    case = Case("(0.5 if violated(g) else 1) * product(x, p=0.6)", [*times("g", 1), *times("x", 1)])

    assert {key: float(by) for key, by in amounts(case.tree, TAKEN).items()} == pytest.approx(
        {"x#0": -0.4, "g#0": -0.3}
    )
    assert amounts(case.tree, EARNED) == {}
