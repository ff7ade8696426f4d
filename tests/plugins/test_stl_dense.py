"""`stl.formula` in dense time, by hand: a sample stands until the next one, and windows begin anywhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Finding, Signal, Span, Trial, Verdict
from ariac_score_stl import StlFormula

NAMES = {"d": "separation in m", "v": "relative_speed in m/s"}
SECONDS = np.arange(5.0)


def trial(t: Any, d: Any = 5.0, v: Any = 0.0) -> Trial:
    times = np.asarray(t, dtype=float)
    columns = {"separation/r/h": ("m", d), "relative_speed/r/h": ("m/s", v)}
    signals = {
        name: Signal(name, unit, times, np.broadcast_to(np.asarray(values, float), times.shape))
        for name, (unit, values) in columns.items()
    }
    bodies = Body("r", "robot"), Body("h", "human")
    return Trial("t", bodies=bodies, signals=signals, recorded=Span(float(t[0]), float(t[-1])))


def dense(formula: str, log: Trial, **more: Any) -> list[Finding]:
    """What is found of samples that stand for a second at most."""
    used = {name: source for name, source in NAMES.items() if f"{name} " in formula}
    return list(
        StlFormula(formula=formula, signals=used, time="dense", **{"max_gap_s": 1.0, **more}).watch(log)
    )


def test_a_window_may_begin_between_two_samples() -> None:
    log = trial(SECONDS, [5.0, 5.0, 0.5, 5.0, 5.0])

    (ahead,) = dense("always always[0,0.25] d > 1", log, beyond="cut")
    (far,) = dense("always always[1.5,1.75] d > 1", log, beyond="cut")
    (back,) = dense("always historically[0,0.25] d > 1", log, beyond="cut")

    # d is 0.5 m from 2 s to before 3 s.
    assert ahead.span == Span(1.75, 3.0)
    assert far.span == Span(0.25, 1.5)
    assert back.span == Span(2.0, 3.25)
    for broken in (ahead, far, back):
        assert broken.span is not None
        assert broken.quantities["time_in_violation_s"] == broken.span.duration_s
        assert broken.quantities["failed_at_s"] == 2.0
        assert broken.robustness == -0.5


def test_what_is_left_must_have_been_held_to_its_end() -> None:
    came = [5.0, 0.0, 0.0, 0.0, 0.0]

    (kept,) = dense("always (v > 1 since d > 1)", trial(SECONDS, came, [5.0] * 5))
    (broken,) = dense("always (v > 1 since d > 1)", trial(SECONDS, came, [0.0] + [5.0] * 4))
    (late,) = dense("always[1,4] (v > 1 since[1,1] d > 1)", trial(SECONDS, came, [5.0] * 5))

    assert kept.verdict is Verdict.SATISFIED
    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(1.0, 4.0))  # v gave way before 1 s
    assert (late.verdict, late.span) == (Verdict.VIOLATED, Span(2.0, 4.0))  # a second after d did


def test_what_only_rounding_parts_is_one_moment() -> None:
    # What d was from 0.125 s on leaves the window at 0.375 s; what it is then comes a little later.
    t = [0.0, 0.0625, 0.125, 0.359375, float(np.nextafter(0.375, 1)), 0.5]
    log = trial(t, [2, 0, 0.5, 0.5, 5, 5], 4.0)

    (broken,) = dense("always[0.25,0.5] (v > 1 since[0,0.25] d > 1)", log)

    # Within the tolerance it is there already, and v has always been high enough since d was, at 0 s.
    assert broken.span == Span(0.3125, t[4])  # named by the sample next to it
    assert broken.quantities["time_in_violation_s"] == 0.0625


def test_stamps_one_nanosecond_apart_are_two_moments() -> None:
    # In binary the two are less than 1e-9 s apart.
    log = trial([1.0, 1.475, 1.475000001, 2.0], [0.5, 5.0, 0.5, 0.5])

    before, behind = dense("always once[0,0.000000001] d > 1", log, beyond="cut")

    assert before.span == Span(1.0, 1.475)
    assert behind.span is not None
    assert (behind.span.start_s, behind.span.end_s) == pytest.approx((1.475, 2.0), abs=3e-9)


def test_a_hole_is_undecided_from_where_its_sample_no_longer_stands() -> None:
    t = [0.0, 1.0, 2.0, 5.0, 6.0]

    (hole,) = dense("always d > 1", trial(t))
    found = dense("always once[0,0.5] d > 1", trial(t, [0.0, 5.0, 5.0, 5.0, 5.0]), beyond="strong")

    assert (hole.verdict, hole.span) == (Verdict.INCONCLUSIVE, Span(3.0, 5.0))
    assert [(one.verdict, one.span) for one in found] == [
        (Verdict.VIOLATED, Span(0.0, 1.0)),
        (Verdict.INCONCLUSIVE, Span(3.5, 5.0)),
    ]


def test_a_margin_of_0_counts_by_truth() -> None:
    log = trial(SECONDS, [0.5, 2.0, 2.0, 1.0, 2.0])

    first, limit = dense("always d > 1", log)
    (below,) = dense("always d >= 1", log)
    negated = dense("always not d <= 1", log)

    assert [first.span, limit.span, below.span] == [Span(0.0, 1.0), Span(3.0, 4.0), Span(0.0, 1.0)]
    assert [first.robustness, limit.robustness, below.robustness] == [-0.5, 0.0, -0.5]
    assert limit.quantities == {"time_in_violation_s": 1.0, "failed_at_s": 3.0}
    assert [str(finding.robustness) for finding in negated] == ["-0.5", "0.0"]


def test_one_step_may_be_at_a_limit_that_counts_and_the_next_at_one_that_does_not() -> None:
    # At 0 s d is at its limit, which > does not allow; at 1 s v is, which >= does.
    log = trial(SECONDS, [1.0, 6.0, 6.0, 6.0, 6.0], [6.0, 1.0, 4.0, 4.0, 4.0])

    (broken,) = dense("always (d > 1 and v >= 1)", log)

    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(0.0, 1.0))


def test_a_violation_lasts_to_a_step_that_only_rounding_puts_after_the_last_moment() -> None:
    t = [0.0, 0.1, 0.2, 0.1 + 0.2, 0.4]  # 0.30000000000000004
    log = trial(t, [0.5, 0.4, 0.3, 0.2, 5.0])

    (broken,) = dense("always[0,0.3] d > 1", log)

    assert broken.span is not None
    assert (broken.verdict, broken.robustness) == (Verdict.VIOLATED, -0.8)
    assert (broken.span.start_s, broken.span.end_s) == (0.0, t[3])
    assert abs(broken.quantities["time_in_violation_s"] - 0.3) < 1e-12


def test_the_unit_is_that_of_a_predicate_that_is_as_far_at_any_sample() -> None:
    # No sample of d or v is at 0 s what decides there: d at 3 s does, by 0.75 m.
    log = trial(SECONDS, [5.0, 4.0, 3.0, 1.75, 9.0], [7.0] * 5)

    (kept,) = dense("always (d > 0 until[3,3] d > 1) or v < 1", log, beyond="weak")
    (broken,) = dense("eventually[0,1] (d < 0.5 until[3,3] d > 2.5) or v < 1", log, beyond="strong")

    assert (kept.verdict, kept.unit) == (Verdict.SATISFIED, "m")
    assert (broken.verdict, broken.unit) == (Verdict.VIOLATED, "m")


def test_what_came_long_ago_is_remembered_and_what_never_came_is_missed() -> None:
    t = np.arange(20) / 10
    rising = [0.0] * 15 + [1.0] * 5

    (kept,) = dense("always (v > 0.5 -> once d > 1)", trial(t, [2.0] + [0.5] * 19, rising))
    (broken,) = dense("always (v > 0.5 -> once d > 1)", trial(t, 0.5, rising))

    assert kept.verdict is Verdict.SATISFIED
    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(1.5, 1.9))
    assert broken.robustness == -0.5  # v and d are both 0.5 from where they would have kept it


def test_what_comes_much_later_counts_and_what_never_comes_does_not() -> None:
    t = np.arange(20) / 10
    formula, near = "always (d < 1 -> eventually v < 0.25)", [0.5] + [5.0] * 19

    (kept,) = dense(formula, trial(t, near, [1.0] * 19 + [0.0]))
    (broken,) = dense(formula, trial(t, near, [1.0] * 12 + [0.5] + [1.0] * 7))

    assert kept.verdict is Verdict.SATISFIED
    assert (broken.verdict, broken.span) == (Verdict.VIOLATED, Span(0.0, 0.1))
    assert broken.quantities["failed_at_s"] == t[12]  # where it came nearest
    assert broken.robustness == -0.25
