"""Robustness of formulas: against a reference, against rtamt, and its bounds where data is missing."""

from __future__ import annotations

import importlib.util
import json
import os
import random
import subprocess
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Span
from ariac_score_stl.dense import Dense
from ariac_score_stl.discrete import Discrete
from ariac_score_stl.margins import Margin, margins
from ariac_score_stl.rows import Rows
from ariac_score_stl.sliding import chained, lowest_between, lowest_sliding
from ariac_score_stl.syntax import parse

HERE = Path(__file__).parent


def _module(name: str) -> Any:
    """A module beside this one; tests are no package."""
    specification = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    assert specification
    assert specification.loader
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


reference = _module("stl_reference")
LAWS = settings(max_examples=100, derandomize=True, deadline=None)

COMPARISONS = st.sampled_from(["<", "<=", ">", ">=", "==", "!="])
PREDICATES = st.tuples(st.just("p"), st.sampled_from("xy"), COMPARISONS, st.integers(0, 4).map(float))
BOUNDS = st.none() | st.tuples(st.integers(0, 4), st.integers(0, 6)).map(
    lambda pair: (pair[0] / 10, (pair[0] + pair[1]) / 10)
)


def _larger(parts: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    one, two = (
        st.sampled_from(["not", "next", "rise", "fall"]),
        st.sampled_from(["and", "or", "xor", "->", "<->"]),
    )
    windowed = st.sampled_from(["always", "eventually", "once", "historically"])
    return (
        st.tuples(one, parts)
        | st.tuples(two, parts, parts)
        | st.tuples(windowed, parts, BOUNDS)
        | st.tuples(st.sampled_from(["until", "since"]), parts, parts, BOUNDS)
    )


FORMULAS = st.recursive(PREDICATES, _larger, max_leaves=5)
VALUES = st.sampled_from([k / 4 for k in range(-4, 21)])


@st.composite
def traces(draw: st.DrawFn, steps_s: Sequence[float]) -> tuple[list[float], dict[str, list[float]]]:
    n = draw(st.integers(1, 12))
    steps = draw(st.lists(st.sampled_from(steps_s), min_size=n, max_size=n))
    t = [round(sum(steps[1 : k + 1]), 6) for k in range(n)]
    return t, {name: draw(st.lists(VALUES, min_size=n, max_size=n)) for name in "xy"}


def discrete(
    text: str, t: Sequence[float], values: dict[str, list[float]], *, beyond: Any, holes: Sequence[Span] = ()
) -> Margin:
    tree = parse(text, ["x", "y"])
    columns: dict[str, Any] = {name: np.array(column) for name, column in values.items()}
    rows = Rows.of(np.array(t), Span(t[0], t[-1]), holes)
    return Discrete.whole(tree, rows, margins(tree, columns, len(t)), beyond).of(tree)


# Against a reference -------------------------------------------------------------------


@given(FORMULAS, traces([0.1]))
@LAWS
def test_every_formula_has_the_robustness_of_the_reference(
    formula: Any, trace: tuple[list[float], dict[str, list[float]]]
) -> None:
    t, values = trace

    margin = discrete(reference.text_of(formula), t, values, beyond="cut")

    wanted = [reference.robustness(formula, t, values, i) for i in range(len(t))]
    assert margin.lower.tolist() == pytest.approx(wanted, abs=1e-9)
    assert margin.upper.tolist() == pytest.approx(wanted, abs=1e-9)


@given(FORMULAS, traces([0.05, 0.1, 0.2, 0.31]))
@LAWS
def test_at_uneven_steps_the_reference_lies_between_the_bounds(
    formula: Any, trace: tuple[list[float], dict[str, list[float]]]
) -> None:
    t, values = trace

    margin = discrete(reference.text_of(formula), t, values, beyond="cut")

    for i, (lower, upper) in enumerate(zip(margin.lower, margin.upper, strict=True)):
        assert lower - 1e-9 <= reference.robustness(formula, t, values, i) <= upper + 1e-9


@pytest.mark.slow
@given(FORMULAS, traces([0.1]), st.data())
@LAWS
def test_whatever_is_missing_might_have_been_the_bounds_hold(
    formula: Any, trace: tuple[list[float], dict[str, list[float]]], data: st.DataObject
) -> None:
    t, values = trace
    lost = data.draw(st.sets(st.integers(1, max(len(t) - 2, 1)), max_size=4))
    first, last = data.draw(st.integers(0, 2)), data.draw(st.integers(1, 4))
    kept = [k for k in range(len(t)) if first <= k < max(len(t) - last, first + 1) and k not in lost]
    if not kept:
        return
    holes = [Span(t[a], t[b]) for a, b in pairwise(kept) if b - a > 1]
    # Operators without bounds end with the trial, so they must not see what is beyond it.
    formula = _bounded(formula)
    seen = {name: [column[k] for k in kept] for name, column in values.items()}

    margin = discrete(reference.text_of(formula), [t[k] for k in kept], seen, beyond="undecided", holes=holes)

    rows = np.searchsorted(_begins([t[k] for k in kept], holes), [t[k] for k in kept])
    for row, k in zip(rows, kept, strict=True):
        if _sees_all(formula, t, k):
            value = reference.robustness(formula, t, values, k)
            assert margin.lower[row] - 1e-9 <= value <= margin.upper[row] + 1e-9


def _begins(t: list[float], holes: list[Span]) -> np.ndarray[Any, Any]:
    return Rows.of(np.array(t), Span(t[0], t[-1]), holes).begin


def _bounded(formula: Any) -> Any:
    if formula[0] == "p":
        return formula
    return (
        formula[0],
        *(
            (0.0, 0.3) if part is None else _bounded(part) if isinstance(part[0], str) else part
            for part in formula[1:]
        ),
    )


def _sees_all(formula: Any, t: list[float], k: int) -> bool:
    """Whether the reference looks nowhere beyond its own trace, which is longer than what was kept."""
    ahead, back = _reach(formula)
    return t[k] + ahead <= t[-1] + 1e-9 and t[k] - back >= t[0] - 1e-9


def _reach(formula: Any) -> tuple[float, float]:
    if formula[0] == "p":
        return 0.0, 0.0
    inner = [_reach(part) for part in formula[1:] if part is not None and isinstance(part[0], str)]
    ahead, back = max(a for a, _ in inner), max(b for _, b in inner)
    bounds = next((p for p in formula[1:] if p is not None and not isinstance(p[0], str)), (0.0, 0.1))
    if formula[0] in ("always", "eventually", "until", "next"):
        ahead += bounds[1]
    elif formula[0] in ("historically", "once", "since", "rise", "fall"):
        back += bounds[1]
    return ahead, back


@pytest.mark.slow
@given(FORMULAS, traces([0.05, 0.1, 0.2]), st.booleans())
@LAWS
def test_weak_is_never_below_strong_and_both_lie_within_undecided(
    formula: Any, trace: tuple[list[float], dict[str, list[float]]], dense: bool
) -> None:
    t, values = trace
    text = reference.text_of(formula)
    if dense:
        text = text.replace("next", "").replace("rise", "").replace("fall", "not")

    def margin(beyond: Any) -> Margin:
        if not dense:
            return discrete(text, t, values, beyond=beyond)
        return _dense_margin(text, t, values, beyond, np.array(t))

    weak, strong, undecided = margin("weak"), margin("strong"), margin("undecided")

    assert (strong.lower <= weak.lower).all()
    assert (strong.upper <= weak.upper).all()
    for known in (weak, strong):
        assert (undecided.lower <= known.lower).all()
        assert (known.upper <= undecided.upper).all()


# Against rtamt -------------------------------------------------------------------------


def _rtamt_python() -> str:
    """A Python with rtamt: this one, or the one an environment variable names."""
    named = os.environ.get("ARIAC_SCORE_RTAMT_PYTHON")
    if named:
        return named
    if importlib.util.find_spec("rtamt") is not None:
        return sys.executable
    pytest.skip("rtamt is not installed; ARIAC_SCORE_RTAMT_PYTHON names no Python that has it either")


def _random_formula(draw: random.Random, depth: int) -> Any:
    if depth == 0 or draw.random() < 0.15:
        return (
            "p",
            draw.choice("xy"),
            draw.choice(["<", "<=", ">", ">=", "==", "!="]),
            draw.randint(0, 8) / 4,
        )
    operator = draw.choice(
        [
            "not",
            "next",
            "rise",
            "fall",
            "and",
            "or",
            "xor",
            "->",
            "<->",
            "until",
            "since",
            "always",
            "eventually",
            "once",
            "historically",
        ]
    )
    parts = [_random_formula(draw, depth - 1) for _ in range(2)]
    start = draw.randint(0, 4)
    bounds = None if draw.random() < 0.25 else (start / 10, (start + draw.randint(1, 6)) / 10)
    if operator in ("not", "next", "rise", "fall"):
        return (operator, parts[0])
    if operator in ("until", "since"):
        return (operator, *parts, bounds)
    return (
        (operator, *parts) if operator in ("and", "or", "xor", "->", "<->") else (operator, parts[0], bounds)
    )


def test_rtamt_gives_the_same_robustness() -> None:
    """300 formulas; both-or-neither goes there as two implications, for its own is not sound."""
    python = _rtamt_python()
    draw = random.Random(20)  # noqa: S311  # the same formulas every time
    cases = []
    for _ in range(300):
        n = draw.randint(8, 40)
        columns = {name: [draw.uniform(0, 2) for _ in range(n)] for name in "xy"}
        cases.append((_random_formula(draw, draw.randint(1, 4)), columns))
    sent = [
        {"formula": reference.rtamt_of(formula), "period_s": 0.1, "columns": columns}
        for formula, columns in cases
    ]

    done = subprocess.run(
        [python, str(HERE / "stl_rtamt.py")],
        input=json.dumps(sent),
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    for (formula, columns), theirs in zip(cases, json.loads(done.stdout), strict=True):
        t = [k * 0.1 for k in range(len(columns["x"]))]
        margin = discrete(reference.text_of(formula), t, columns, beyond="cut")
        assert margin.lower.tolist() == pytest.approx(theirs, abs=1e-9), formula
        assert margin.upper.tolist() == pytest.approx(theirs, abs=1e-9), formula


# Dense time ----------------------------------------------------------------------------


def _dense_margin(
    text: str, t: Sequence[float], values: dict[str, list[float]], beyond: Any, at: Any
) -> Margin:
    tree = parse(text, ["x", "y"])
    columns: dict[str, Any] = {name: np.array(column) for name, column in values.items()}
    dense = Dense(tree, np.array(t), Span(t[0], t[-1]), margins(tree, columns, len(t)), beyond)
    return dense.of(tree).on(np.asarray(at, float))


def _dense_formulas() -> st.SearchStrategy[Any]:
    def larger(parts: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
        return (
            st.tuples(st.just("not"), parts)
            | st.tuples(st.sampled_from(["and", "or", "xor", "->", "<->"]), parts, parts)
            | st.tuples(st.sampled_from(["always", "eventually", "once", "historically"]), parts, BOUNDS)
            | st.tuples(st.sampled_from(["until", "since"]), parts, parts, BOUNDS)
        )

    return st.recursive(PREDICATES, larger, max_leaves=4)


@pytest.mark.slow
@given(_dense_formulas(), traces([0.1, 0.2, 0.3]))
@LAWS
def test_in_dense_time_a_sample_stands_until_the_next_one(
    formula: Any, trace: tuple[list[float], dict[str, list[float]]]
) -> None:
    t, values = trace
    tenths = [k / 10 for k in range(round(t[-1] * 10) + 1)]
    sample = np.searchsorted(np.array(t), np.array(tenths) + 1e-9, side="right") - 1
    filled = {name: [column[k] for k in sample] for name, column in values.items()}
    tree = parse(reference.text_of(formula), ["x", "y"])
    columns: dict[str, Any] = {name: np.array(column) for name, column in values.items()}
    whole = Span(0.0, t[-1] + 0.1)  # so that the last sample stands for a tenth as well

    steps = Dense(tree, np.array(t), whole, margins(tree, columns, len(t)), "cut").of(tree)

    wanted = [reference.robustness(formula, tenths, filled, i, dense=True) for i in range(len(tenths))]
    for within_s in (1e-8, 0.05, 0.099):  # the same at every moment of a step
        margin = steps.on(np.array(tenths) + within_s)
        assert margin.lower.tolist() == pytest.approx(wanted, abs=1e-9)
        assert margin.upper.tolist() == pytest.approx(wanted, abs=1e-9)


def test_dense_steps_do_not_multiply_however_deep_a_formula_is() -> None:
    n = 400
    values = {"x": np.random.default_rng(3).random(n).tolist(), "y": [0.0] * n}
    text = "x > 0.5"
    for k in range(12):
        text = f"{'always' if k % 2 else 'eventually'}[0.0{k},0.1{k}] ({text})"
    t = [k / 100 for k in range(n)]
    tree = parse(text, ["x", "y"])
    columns: dict[str, Any] = {name: np.array(column) for name, column in values.items()}

    steps = Dense(tree, np.array(t), Span(t[0], t[-1]), margins(tree, columns, n), "cut").of(tree)

    assert len(steps.begin) <= n + 2 * 12 * 2


# Extrema -------------------------------------------------------------------------------

COLUMN = st.lists(VALUES, min_size=1, max_size=80).map(np.array)


@given(COLUMN, st.integers(-90, 90), st.integers(-3, 150))
@LAWS
def test_a_sliding_minimum_is_the_minimum_of_every_window(values: Any, first: int, width: int) -> None:
    last = first + width
    wanted = [
        min((values[k] for k in range(max(i + first, 0), min(i + last + 1, len(values)))), default=np.inf)
        for i in range(len(values))
    ]

    assert lowest_sliding(values, first, last).tolist() == wanted


@given(COLUMN, st.data())
@LAWS
def test_a_minimum_over_uneven_windows_is_the_minimum_of_each(values: Any, data: st.DataObject) -> None:
    n = len(values)
    ends = st.lists(st.integers(-2, n + 1), min_size=n, max_size=n).map(sorted)
    first, last = np.array(data.draw(ends)), np.array(data.draw(ends))
    wanted = [
        min(values[max(a, 0) : max(b + 1, 0)], default=np.inf) for a, b in zip(first, last, strict=True)
    ]

    assert lowest_between(values, first, last).tolist() == wanted


@given(st.lists(st.tuples(VALUES, VALUES), max_size=60), st.sampled_from([-np.inf, 0.5, np.inf]))
@LAWS
def test_the_recursion_of_until_step_by_step(pairs: list[tuple[float, float]], start: float) -> None:
    wanted, x = [], start
    for cap, floor in pairs:
        x = max(floor, min(cap, x))
        wanted.append(x)
    caps, floors = (np.array([p[k] for p in pairs], float) for k in (0, 1))

    assert chained(caps, floors, start).tolist() == wanted


def test_long_and_short_windows_agree_whichever_way_they_are_found(subtests: pytest.Subtests) -> None:
    cases: list[int] = [1, 2, 63, 64, 65, 128, 5_000, 10_000, 20_000]
    for width in cases:
        with subtests.test(width=width):
            values = np.random.default_rng(1).random(10_000)
            rows = np.arange(10_000)

            assert (
                lowest_sliding(values, 0, width - 1) == lowest_between(values, rows, rows + width - 1)
            ).all()
            assert (
                lowest_sliding(values, 1 - width, 0) == lowest_between(values, rows - width + 1, rows)
            ).all()
