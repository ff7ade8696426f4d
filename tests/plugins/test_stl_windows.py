"""`stl.formula` goes through a trial window by window: what it says does not hang on where windows begin."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, Signal, Span, Trial, Verdict
from ariac_score_stl import StlFormula, judging, windows
from ariac_score_stl.rows import Rows
from ariac_score_stl.windows import Line, Track

NAMES = {"d": "separation in m", "v": "relative_speed in m/s"}
FORMULAS = (
    "always d > 1",
    "always (d < 1 -> eventually[0,0.3] v < 1)",
    "always (d < 1 -> eventually v < 0.5)",
    "always (v > 1 -> once[0.1,0.5] d > 1.2)",
    "always (v > 1.5 -> once (d > 1.2 and historically[0,0.2] v < 1.4))",
    "always (d > 0.5 until[0,0.4] v < 1)",
    "always (d > 0.2 until[0.1,0.4] v < 1)",
    "always (d > 0.2 until v < 0.4)",
    "always (v < 2 since[0.1,0.6] d > 1)",
    "always (v < 2 since d > 1)",
    "always[0.2,1] eventually (d > 1 and once v > 1)",
    "always (rise (d < 1) -> next (next (v < 2 or fall d < 0.7)))",
    "eventually[0,2] always[0,0.4] (d > 0.8 xor v > 1.1)",
    "not (once[0,0.1] d < 0.5) and eventually (v > 1 <-> d > 1)",
)


@contextmanager
def window_rows(rows: int) -> Iterator[None]:
    """Windows of so few rows, of which nothing is kept."""
    with ExitStack() as stack:
        for module, name, value in (
            (windows, "WINDOW_ROWS", rows),
            (windows, "ROWS_FOR_ONE_AROUND", 0),
            (windows, "KEPT_BYTES", 0),
            (judging, "KEPT_BYTES", 0),
        ):
            stack.enter_context(patch.object(module, name, value))
        yield


def trial(t: Any, d: Any = 5.0, v: Any = 0.0, *, t_of_v: Any = None) -> Trial:
    signals = {}
    for name, unit, at, values in (
        ("separation/r/h", "m", t, d),
        ("relative_speed/r/h", "m/s", t if t_of_v is None else t_of_v, v),
    ):
        times = np.asarray(at, dtype=float)
        signals[name] = Signal(name, unit, times, np.broadcast_to(np.asarray(values, float), times.shape))
    bodies = Body("r", "robot"), Body("h", "human")
    return Trial("t", bodies=bodies, signals=signals, recorded=Span(float(t[0]), float(t[-1])))


def wild(seed: int) -> Trial:
    """Regular samples or not, with gaps, on one time base or on two."""
    rng = np.random.default_rng(seed)

    def times() -> Any:
        n = int(rng.integers(3, 60))
        steps = np.full(n, 0.1) if rng.random() < 0.5 else rng.choice([0.05, 0.1, 0.17], n)
        steps[rng.random(n) < 0.05] += rng.choice([0.3, 1.0])
        return np.cumsum(steps)

    t = times()
    other = t if rng.random() < 0.6 else times()
    return trial(t, rng.uniform(0.1, 2, len(t)), rng.uniform(0.1, 2, len(other)), t_of_v=other)


def monitor(formula: str, **more: Any) -> StlFormula:
    used = {name: source for name, source in NAMES.items() if f"{name} " in formula}
    return StlFormula(formula=formula, signals=used, **{"max_gap_s": 0.25, **more})


def said(asked: StlFormula, log: Trial) -> list[Any]:
    """All findings, and all margins, to the bit."""
    courses = [
        (course.subject, course.t.tobytes(), course.actual.tobytes(), course.limit.tobytes())
        for course in asked.margins(log)
    ]
    return [*map(repr, asked.watch(log)), *courses]


@pytest.mark.parametrize("formula", FORMULAS)
@settings(max_examples=8, derandomize=True, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1, 2, 7, 64]),
    st.sampled_from(["undecided", "weak", "strong", "cut"]),
    st.sampled_from([0.0, 0.25]),
)
def test_what_is_said_does_not_depend_on_windows(
    formula: str, seed: int, rows: int, beyond: Any, t_off_s: float
) -> None:
    asked, log = monitor(formula, beyond=beyond, t_off_s=t_off_s), wild(seed)
    whole = said(asked, log)  # which has fewer samples than one window

    with window_rows(rows):
        assert said(asked, log) == whole


@pytest.mark.parametrize("rows", [1, 2, 3, 100])
def test_what_came_long_ago_is_remembered_and_what_never_came_is_missed(rows: int) -> None:
    t = np.arange(20) / 10
    once_far = trial(t, [2.0] + [0.5] * 19, [0.0] * 15 + [1.0] * 5)
    never_far = trial(t, 0.5, [0.0] * 15 + [1.0] * 5)
    asked = monitor("always (v > 0.5 -> once d > 1)")

    with window_rows(rows):
        (kept,) = asked.watch(once_far)
        (broken,) = asked.watch(never_far)

    assert kept.verdict is Verdict.SATISFIED
    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(1.5, 1.9))
    assert broken.robustness == -0.5  # v and d are both 0.5 from where they would have kept it


@pytest.mark.parametrize("rows", [1, 2, 3, 100])
def test_what_comes_much_later_counts_and_what_never_comes_does_not(rows: int) -> None:
    t = np.arange(20) / 10
    asked = monitor("always (d < 1 -> eventually v < 0.25)")

    with window_rows(rows):
        (kept,) = asked.watch(trial(t, [0.5] + [5.0] * 19, [1.0] * 19 + [0.0]))
        (broken,) = asked.watch(trial(t, [0.5] + [5.0] * 19, [1.0] * 12 + [0.5] + [1.0] * 7))

    assert kept.verdict is Verdict.SATISFIED
    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(0.0, 0.1))
    assert broken.quantities["failed_at_s"] == t[12]  # where it came nearest, many windows on
    assert broken.robustness == -0.25


@pytest.mark.parametrize("rows", [1, 2, 5, 100])
def test_a_violation_over_many_windows_is_one_and_adds_up(rows: int) -> None:
    t = np.arange(30) / 10
    with window_rows(rows):
        (broken,) = monitor("always d > 1").watch(trial(t, [2.0] * 3 + [0.5] * 20 + [2.0] * 7))

    assert broken.span is not None
    assert (broken.span.start_s, broken.span.end_s) == pytest.approx((0.3, 2.3))
    assert broken.quantities["time_in_violation_s"] == pytest.approx(2.0)


@pytest.mark.parametrize("rows", [1, 2, 100])
def test_a_predicate_without_value_is_told_by_its_row_among_all_samples(rows: int) -> None:
    t = np.arange(12) / 10
    asked = monitor("always (1 / d > 0 and 1 / v > 0)")
    with window_rows(rows):
        # The first predicate is without a value in row 9, the second in row 2 already: the first is named.
        (finding,) = asked.watch(trial(t, [1.0] * 9 + [0.0] * 3, [1.0] * 2 + [0.0] * 10))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "row 9" in finding.message


@given(st.integers(0, 2**32 - 1), st.data())
@settings(max_examples=60, derandomize=True, deadline=None)
def test_any_rows_of_a_line_are_those_of_all_its_rows(seed: int, draw: st.DataObject) -> None:
    log = wild(seed)
    span = log.window
    assert span is not None
    track = Track(dict(zip("dv", log.signals.values(), strict=True)), span, max_gap_s=0.25)
    t = track.times(0, len(track))
    holes = Span(span.start_s, span.end_s)
    found = [Span(a, b) for a, b in zip(t[:-1].tolist(), t[1:].tolist(), strict=True) if b - a > 0.25]
    whole, line = Rows.of(t, holes, found), Line(track, holes, found)
    assert len(line) == len(whole)
    first = draw.draw(st.integers(0, len(line)))
    last = draw.draw(st.integers(first, len(line)))

    some = line.rows(first, last)

    assert some.begin.tolist() == whole.begin[first:last].tolist()
    assert some.end.tolist() == whole.end[first:last].tolist()
    for at_s in (*whole.begin.tolist()[first:last], *whole.end.tolist()[first:last], -1.0, 99.0):
        assert line.ending(at_s) == int(whole.end.searchsorted(at_s))
        assert line.beginning(at_s) == int(whole.begin.searchsorted(at_s, side="right"))
