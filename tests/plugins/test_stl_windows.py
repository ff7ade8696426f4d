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

from ariac_score import Aligned, Body, Finding, Signal, Span, Trial, Verdict
from ariac_score_stl import StlFormula, judging, windows
from ariac_score_stl.dense import Dense
from ariac_score_stl.dense_windows import SLACK_S, DenseWindows
from ariac_score_stl.robustness import margins
from ariac_score_stl.rows import Rows
from ariac_score_stl.windows import Line

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
DENSE_FORMULAS = (
    *(formula for formula in FORMULAS if "next" not in formula),
    "always (d >= 1 and v > 1 or once[0.3,0.3] v == 1)",
    "always ((d > 1 or v >= 0.5) since[0,0.3] eventually[0.1,0.2] v > 1)",
    "always eventually ((v > 1 since[0.2,0.5] d > 1) until[0.1,0.7] d != 1)",
)
JUDGED = [
    *(("discrete", formula) for formula in FORMULAS),
    *(("dense", formula) for formula in DENSE_FORMULAS),
]
either_time = pytest.mark.parametrize("time", ["discrete", "dense"])


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
    """Regular samples or not, with gaps, on one time base or on two; any values, or some that are limits."""
    rng = np.random.default_rng(seed)

    def times() -> Any:
        n = int(rng.integers(3, 60))
        steps = np.full(n, 0.1) if rng.random() < 0.5 else rng.choice([0.05, 0.1, 0.17], n)
        steps[rng.random(n) < 0.05] += rng.choice([0.3, 1.0])
        return np.cumsum(steps)

    t = times()

    def values(n: int) -> Any:
        return rng.uniform(0.1, 2, n) if rng.random() < 0.7 else rng.choice([0.25, 0.5, 1.0, 1.5], n)

    other = t if rng.random() < 0.6 else times()
    return trial(t, values(len(t)), values(len(other)), t_of_v=other)


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


@pytest.mark.parametrize(("time", "formula"), JUDGED)
@settings(max_examples=8, derandomize=True, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1, 2, 7, 64]),
    st.sampled_from(["undecided", "weak", "strong", "cut"]),
    st.sampled_from([0.0, 0.25]),
)
def test_what_is_said_does_not_depend_on_windows(
    time: Any, formula: str, seed: int, rows: int, beyond: Any, t_off_s: float
) -> None:
    asked, log = monitor(formula, time=time, beyond=beyond, t_off_s=t_off_s), wild(seed)
    whole = said(asked, log)  # which has fewer samples than one window

    with window_rows(rows):
        assert said(asked, log) == whole


@either_time
@pytest.mark.parametrize("rows", [1, 2, 3, 100])
def test_what_came_long_ago_is_remembered_and_what_never_came_is_missed(rows: int, time: Any) -> None:
    t = np.arange(20) / 10
    once_far = trial(t, [2.0] + [0.5] * 19, [0.0] * 15 + [1.0] * 5)
    never_far = trial(t, 0.5, [0.0] * 15 + [1.0] * 5)
    asked = monitor("always (v > 0.5 -> once d > 1)", time=time)

    with window_rows(rows):
        (kept,) = asked.watch(once_far)
        (broken,) = asked.watch(never_far)

    assert kept.verdict is Verdict.SATISFIED
    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(1.5, 1.9))
    assert broken.robustness == -0.5  # v and d are both 0.5 from where they would have kept it


@either_time
@pytest.mark.parametrize("rows", [1, 2, 3, 100])
def test_what_comes_much_later_counts_and_what_never_comes_does_not(rows: int, time: Any) -> None:
    t = np.arange(20) / 10
    asked = monitor("always (d < 1 -> eventually v < 0.25)", time=time)

    with window_rows(rows):
        (kept,) = asked.watch(trial(t, [0.5] + [5.0] * 19, [1.0] * 19 + [0.0]))
        (broken,) = asked.watch(trial(t, [0.5] + [5.0] * 19, [1.0] * 12 + [0.5] + [1.0] * 7))

    assert kept.verdict is Verdict.SATISFIED
    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(0.0, 0.1))
    assert broken.quantities["failed_at_s"] == t[12]  # where it came nearest, many windows on
    assert broken.robustness == -0.25


@either_time
@pytest.mark.parametrize("rows", [1, 2, 5, 100])
def test_a_violation_over_many_windows_is_one_and_adds_up(rows: int, time: Any) -> None:
    t = np.arange(30) / 10
    with window_rows(rows):
        (broken,) = monitor("always d > 1", time=time).watch(trial(t, [2.0] * 3 + [0.5] * 20 + [2.0] * 7))

    assert broken.span is not None
    assert (broken.span.start_s, broken.span.end_s) == pytest.approx((0.3, 2.3))
    assert broken.quantities["time_in_violation_s"] == pytest.approx(2.0)


@either_time
@pytest.mark.parametrize("rows", [1, 2, 100])
@pytest.mark.parametrize("outermost", ["always", "always[0,0.1]", ""])
def test_a_predicate_without_value_is_told_by_its_row_among_all_samples(
    rows: int, time: Any, outermost: str
) -> None:
    t = np.arange(12) / 10
    asked = monitor(f"{outermost} (1 / d > 0 and 1 / v > 0)", time=time)
    with window_rows(rows):
        # The first predicate is without a value in row 9, the second in row 2 already: the first is named.
        (finding,) = asked.watch(trial(t, [1.0] * 9 + [0.0] * 3, [1.0] * 2 + [0.0] * 10))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "row 9" in finding.message


# Dense time ----------------------------------------------------------------------------

SECONDS = np.arange(5.0)
each_rows = pytest.mark.parametrize("rows", [1, 2, 3, 100])


def dense(formula: str, log: Trial, rows: int, **more: Any) -> list[Finding]:
    """What is found of samples that stand for a second at most."""
    with window_rows(rows):
        return list(monitor(formula, **{"time": "dense", "max_gap_s": 1.0, **more}).watch(log))


@each_rows
def test_a_window_of_time_that_begins_between_two_samples_sees_into_the_next_windows(rows: int) -> None:
    log = trial(SECONDS, [5.0, 5.0, 0.5, 5.0, 5.0])

    (ahead,) = dense("always always[0,0.25] d > 1", log, rows, beyond="cut")
    (far,) = dense("always always[1.5,1.75] d > 1", log, rows, beyond="cut")
    (back,) = dense("always historically[0,0.25] d > 1", log, rows, beyond="cut")

    # d is 0.5 m from 2 s to before 3 s.
    assert ahead.span == Span(1.75, 3.0)
    assert far.span == Span(0.25, 1.5)
    assert back.span == Span(2.0, 3.25)
    for broken in (ahead, far, back):
        assert broken.span is not None
        assert broken.quantities["time_in_violation_s"] == broken.span.duration_s
        assert broken.quantities["failed_at_s"] == 2.0
        assert broken.robustness == -0.5


@each_rows
def test_what_is_left_between_two_windows_must_have_been_held_to_its_end(rows: int) -> None:
    came = [5.0, 0.0, 0.0, 0.0, 0.0]

    (kept,) = dense("always (v > 1 since d > 1)", trial(SECONDS, came, [5.0] * 5), rows)
    (broken,) = dense("always (v > 1 since d > 1)", trial(SECONDS, came, [0.0] + [5.0] * 4), rows)
    (late,) = dense("always[1,4] (v > 1 since[1,1] d > 1)", trial(SECONDS, came, [5.0] * 5), rows)

    assert kept.verdict is Verdict.SATISFIED
    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(1.0, 4.0))  # v gave way before 1 s
    assert (late.verdict, late.span) == (Verdict.VIOLATED, Span(2.0, 4.0))  # a second after d did


@each_rows
def test_what_is_left_just_where_a_window_begins_to_look_must_have_been_held_too(rows: int) -> None:
    t = [0.0, 2.0 - SLACK_S, 2.0, 3.0, 4.0]
    log = trial(t, [5.0] + [0.0] * 4, [0.0, 5.0, 5.0, 4.0, 4.0])

    (broken,) = dense("always (v > 1 since d > 1)", log, rows, max_gap_s=2.0)

    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(2.0 - SLACK_S, 4.0))
    assert broken.robustness == -1.0  # both: v was 1 m/s too slow at 0 s, d is 1 m too small since


@each_rows
def test_what_only_rounding_parts_is_the_same_to_the_bit(rows: int) -> None:
    # What d was from 0.125 s on leaves the window at 0.375 s; what it is then comes a little later.
    t = [0.0, 0.0625, 0.125, 0.359375, float(np.nextafter(0.375, 1)), 0.5]
    log = trial(t, [2, 0, 0.5, 0.5, 5, 5], 4.0)

    (broken,) = dense("always[0.25,0.5] (v > 1 since[0,0.25] d > 1)", log, rows)

    # Within the tolerance it is there already, and v has always been high enough since d was, at 0 s.
    assert broken.span == Span(0.3125, t[4])  # said as the sample that it is next to
    assert broken.quantities["time_in_violation_s"] == 0.0625


@each_rows
def test_a_hole_between_two_windows_is_undecided_from_where_its_sample_no_longer_stands(rows: int) -> None:
    t = [0.0, 1.0, 2.0, 5.0, 6.0]

    (hole,) = dense("always d > 1", trial(t), rows)
    (once,) = dense("always once[0,0.5] d > 1", trial(t, [0.0, 5.0, 5.0, 5.0, 5.0]), rows, beyond="strong")[
        1:
    ]

    assert (hole.verdict, hole.span) == (Verdict.INCONCLUSIVE, Span(3.0, 5.0))
    assert (once.verdict, once.span) == (Verdict.INCONCLUSIVE, Span(3.5, 5.0))


@each_rows
def test_a_margin_of_0_counts_by_truth_wherever_the_first_one_is(rows: int) -> None:
    log = trial(SECONDS, [0.5, 2.0, 2.0, 1.0, 2.0])

    first, limit = dense("always d > 1", log, rows)
    (below,) = dense("always d >= 1", log, rows)
    negated = dense("always not d <= 1", log, rows)

    assert [first.span, limit.span, below.span] == [Span(0.0, 1.0), Span(3.0, 4.0), Span(0.0, 1.0)]
    assert [first.robustness, limit.robustness, below.robustness] == [-0.5, 0.0, -0.5]
    assert limit.quantities == {"time_in_violation_s": 1.0, "failed_at_s": 3.0}
    assert [str(finding.robustness) for finding in negated] == ["-0.5", "0.0"]


@each_rows
def test_steps_of_truth_and_of_margins_that_are_as_many_are_not_the_same_steps(rows: int) -> None:
    # At 0 s d is at its limit, which > does not allow; at 1 s v is, which >= does.
    log = trial(SECONDS, [1.0, 6.0, 6.0, 6.0, 6.0], [6.0, 1.0, 4.0, 4.0, 4.0])

    (broken,) = dense("always (d > 1 and v >= 1)", log, rows)

    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(0.0, 1.0))


@each_rows
def test_a_violation_lasts_to_a_step_that_only_rounding_puts_after_the_last_moment(rows: int) -> None:
    t = [0.0, 0.1, 0.2, 0.1 + 0.2, 0.4]  # 0.30000000000000004
    log = trial(t, [0.5, 0.4, 0.3, 0.2, 5.0])

    (broken,) = dense("always[0,0.3] d > 1", log, rows)

    assert broken.span is not None
    assert (broken.verdict, broken.robustness) == (Verdict.VIOLATED, -0.8)
    assert (broken.span.start_s, broken.span.end_s) == pytest.approx((0.0, 0.3))
    assert broken.quantities["time_in_violation_s"] == pytest.approx(0.3)


@each_rows
def test_the_unit_is_that_of_a_predicate_that_is_as_far_in_any_window(rows: int) -> None:
    # No sample of d or v is at 0 s what decides there: d at 3 s does, by 0.75 m.
    log = trial(SECONDS, [5.0, 4.0, 3.0, 1.75, 9.0], [7.0] * 5)

    (kept,) = dense("always (d > 0 until[3,3] d > 1) or v < 1", log, rows, beyond="weak")
    (broken,) = dense("eventually[0,1] (d < 0.5 until[3,3] d > 2.5) or v < 1", log, rows, beyond="strong")

    assert (kept.verdict, kept.unit) == (Verdict.SATISFIED, "m")
    assert (broken.verdict, broken.unit) == (Verdict.VIOLATED, "m")


@given(st.integers(0, 2**32 - 1), st.sampled_from(DENSE_FORMULAS), st.sampled_from([1, 2, 5, 64]))
@settings(max_examples=60, derandomize=True, deadline=None)
def test_steps_of_all_windows_are_those_of_the_whole_trial(seed: int, formula: str, rows: int) -> None:
    log, asked = wild(seed), monitor(formula, time="dense")
    span, tree = log.window, asked.tree
    assert span is not None
    found = {name: log.signals[f"{source.quantity}/r/h"] for name, source in asked.sources.items()}
    track = Aligned(found, span, max_gap_s=0.25)

    def leaves(_: int, first: int, last: int) -> Any:
        return margins(tree, track.columns(first, last), last - first)

    samples = len(track)
    whole = Dense(track.times(0, samples), span, leaves(0, 0, samples), "undecided", 0.25)
    with window_rows(rows):
        parts = DenseWindows(tree, track, span, leaves, "undecided", 0.25)

        for node in tree.walk():
            steps = whole.of(node)
            told: list[tuple[float, float, float]] = []
            for k in range(len(parts)):
                some = parts.of(k).evaluated.of(node)
                at = parts.steps_of(k, some.begin)
                columns = some.begin[at], some.margin.lower[at], some.margin.upper[at]
                told += zip(*(column.tolist() for column in columns), strict=True)
            bounds = steps.margin.lower.tolist(), steps.margin.upper.tolist()
            assert told == list(zip(steps.begin.tolist(), *bounds, strict=True))


# Rows ----------------------------------------------------------------------------------


@pytest.mark.parametrize("time", ["discrete", "dense"])
def test_a_predicate_without_value_late_in_a_long_trial_is_told_by_its_row(time: Any) -> None:
    d = np.ones(70_000)
    d[[66_000, 69_000]] = 0.0
    (finding,) = monitor("always 1 / d > 0", time=time).watch(trial(np.arange(70_000) / 100, d))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "row 66000" in finding.message


@given(st.integers(0, 2**32 - 1), st.data())
@settings(max_examples=60, derandomize=True, deadline=None)
def test_any_rows_of_a_line_are_those_of_all_its_rows(seed: int, draw: st.DataObject) -> None:
    log = wild(seed)
    span = log.window
    assert span is not None
    track = Aligned(dict(zip("dv", log.signals.values(), strict=True)), span, max_gap_s=0.25)
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
