"""Sums that enter a result, held against sums of fractions, which do not round."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import exact_sum

ROOT = Path(__file__).parents[2]
NUMBERS = st.lists(
    st.floats(-1e12, 1e12) | st.floats(allow_nan=False, allow_infinity=False, width=32), max_size=40
)


def nearest(numbers: list[float]) -> float:
    """The float nearest to the sum of the numbers as fractions."""
    return float(sum(map(Fraction, numbers), Fraction(0)))


@given(NUMBERS)
@settings(max_examples=200, derandomize=True, deadline=None)
def test_a_sum_is_the_float_nearest_to_the_exact_sum(numbers: list[float]) -> None:
    assert exact_sum(np.array(numbers, dtype=np.float64)) == nearest(numbers)
    assert exact_sum(number for number in numbers) == nearest(numbers)


def test_a_sum_hangs_neither_on_the_order_nor_on_how_a_column_lies_in_memory() -> None:
    numbers = np.random.default_rng(7).uniform(0.0, 1.0, 5000) * 10.0 ** (np.arange(5000) % 17)
    shuffled = np.random.default_rng(8).permutation(numbers).tolist()
    spread = np.zeros((5000, 3))
    spread[:, 1] = numbers

    assert float(numbers.sum()) != nearest(shuffled)  # else numpy's order would do, and this shows nothing
    assert {exact_sum(numbers), exact_sum(shuffled), exact_sum(numbers[::-1]), exact_sum(spread[:, 1])} == {
        nearest(shuffled)
    }


@pytest.mark.parametrize(
    ("numbers", "expected"),
    [
        ([], 0.0),
        ([1e308, 1e308, -1e308], 1e308),  # too large on the way, not at the end
        ([1e308, 1e308], math.inf),
        ([-1e308, -1e308], -math.inf),
        ([math.inf, 1.0], math.inf),
        ([5e-324, 5e-324], 1e-323),
    ],
)
def test_a_sum_has_a_value_at_the_ends_of_the_numbers(numbers: list[float], expected: float) -> None:
    assert exact_sum(numbers) == expected


def test_what_is_not_a_number_stays_none() -> None:
    assert math.isnan(exact_sum([1.0, math.nan]))


# Nobody adds up in numpy's order ---------------------------------------------------------------

UNORDERED = frozenset(
    (
        "average",
        "convolve",
        "corrcoef",
        "correlate",
        "cov",
        "dot",
        "einsum",
        "fmean",
        "inner",
        "matmul",
        "mean",
        "nanmean",
        "nanstd",
        "nansum",
        "nanvar",
        "norm",
        "polyfit",
        "prod",
        "stdev",
        "std",
        "sum",
        "sumprod",
        "tensordot",
        "trace",
        "trapezoid",
        "trapz",
        "var",
        "variance",
        "vdot",
    )
)
"""What adds up in an order that a library chooses; `cumsum` and `add.accumulate` go from left to right."""

WHOLE_NUMBERS = {
    ("ariac_score/monitors/cells.py", "count.sum()"),
    ("ariac_score/ranking/design.py", "best[..., :keep].sum(axis=-1)"),
    ("ariac_score/ranking/exact.py", "math.prod((math.comb(len(runs), count) for runs, count in pooled))"),
    ("ariac_score/ranking/exact.py", "one[:, :keep].sum(axis=1)"),
    ("ariac_score/ranking/exact.py", "other[:, :keep].sum(axis=1)"),
    ("ariac_score/ranking/resampling.py", "cells.sum(axis=1)"),
}
"""Sums of integers outside of `int(…)`."""

OF_VECTORS = (
    "ariac_score/monitors/gaps.py",
    "ariac_score/monitors/unseen.py",
    "ariac_score/trial/believed.py",
    "ariac_score/trial/denied.py",
    "plugins/ariac_score_aic/chains.py",
    "plugins/ariac_score_aic/checks.py",
    "plugins/ariac_score_aic/signals.py",
    "plugins/ariac_score_aic/strict.py",
)
"""These add up the components of vectors and quaternions: few numbers, which numpy adds in their order."""

AS_ELSEWHERE = ("ariac_score/redteam/", "plugins/ariac_score_aic/jerk.py")
"""Random searches, whose tries are scored like any log; fits that match those of a library to 12 digits."""


def unordered_sums(code: str) -> Iterator[str]:
    """The calls and products of a module that add up in a library's order, but those made `int` at once."""
    tree = ast.parse(code)
    whole = {
        id(inner)
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "int"
        for inner in ast.walk(call)
    }
    for node in ast.walk(tree):
        reduced = (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and (node.func.attr in UNORDERED or ast.unparse(node.func).endswith("add.reduce"))
        )
        product = isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult)
        if (reduced or product) and id(node) not in whole:
            yield ast.unparse(node)


def test_nothing_is_added_up_in_an_order_that_a_library_chooses() -> None:
    found = {
        (file.relative_to(ROOT).as_posix(), text)
        for folder in ("ariac_score", "plugins")
        for file in sorted((ROOT / folder).rglob("*.py"))
        for text in unordered_sums(file.read_text(encoding="utf-8"))
    }

    found = {(file, code) for file, code in found if not (file in OF_VECTORS and "axis=" in code)}
    found = {(file, code) for file, code in found if not file.startswith(AS_ELSEWHERE)}
    # How code is written out, with brackets or without, differs between versions of Python.
    known = {(file, ast.unparse(ast.parse(code, mode="eval"))) for file, code in WHOLE_NUMBERS}
    assert found == known, "use exact_sum, or write sums of two or three numbers out"


@pytest.mark.parametrize(
    "code",
    ["x = float(depth.sum())", "np.mean(a)", "a @ b", "np.linalg.norm(v, axis=1)", "np.add.reduce(a)"],
)
def test_a_sum_in_the_order_of_a_library_is_seen(code: str) -> None:
    assert list(unordered_sums(code))


@pytest.mark.parametrize("code", ["int(mask.sum())", "int(a.sum()) // 2", "np.cumsum(a)", "sum(counts)"])
def test_a_sum_that_cannot_differ_is_let_through(code: str) -> None:
    assert not list(unordered_sums(code))
