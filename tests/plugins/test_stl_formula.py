"""`stl.formula`: what it finds, worked by hand; limits to the bit; what it cannot decide; what it refuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict, load_rule_set, measure_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LogError, RuleSetError
from ariac_score_stl import StlFormula
from ariac_score_stl.syntax import MAX_DEPTH, MAX_LENGTH, StlError, parse

SATISFIED, VIOLATED = Verdict.SATISFIED, Verdict.VIOLATED
INCONCLUSIVE, NOT_APPLICABLE = Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE

DISTANCE, SPEED = "centre_distance in m", "speed of robot in m/s"
STOP = "always (d < 1 -> eventually[0,0.5] v < 0.1)"
"""A robot that comes too close to a human stops within half a second."""

Times = Sequence[float]


def trial(
    t: Times,
    d: Times | float = 5.0,
    v: Times | float = 0.0,
    *,
    window: Span | None = None,
    events: tuple[Event, ...] = (),
) -> Trial:
    """One robot and one human, their distance and the robot's speed."""
    columns = {"centre_distance/robot/human": ("m", d), "speed/robot": ("m/s", v)}
    signals = {
        name: Signal(name, unit, np.asarray(t, float), np.broadcast_to(np.asarray(values, float), len(t)))
        for name, (unit, values) in columns.items()
    }
    recorded = window or Span(float(t[0]), float(t[-1]))
    bodies = (Body("human", "human"), Body("robot", "robot"))
    return Trial("t", bodies=bodies, signals=signals, events=events, recorded=recorded)


def monitor(formula: str, **more: Any) -> StlFormula:
    names = {"d": DISTANCE, "v": SPEED}
    used = parse(formula, names, constants=more.get("constants")).names
    settings_ = {"max_gap_s": 1.0, **more}
    return StlFormula(formula=formula, signals={n: names[n] for n in names if n in used}, **settings_)


def findings(formula: str, log: Trial, **more: Any) -> list[Finding]:
    return list(monitor(formula, **more).watch(log))


def only(formula: str, log: Trial, **more: Any) -> Finding:
    (finding,) = findings(formula, log, **more)
    return finding


def tenths(n: int) -> list[float]:
    return [k / 10 for k in range(n)]


# Worked by hand ------------------------------------------------------------------------


def test_a_robot_that_stops_in_time_keeps_the_formula() -> None:
    # Too close from 0.3 s on; still at 0.7 s, which is 0.4 s later.
    log = trial(tenths(20), [5.0] * 3 + [0.5] * 17, [0.4] * 7 + [0.0] * 13)

    finding = only(STOP, log)

    # At 0.3 s both v < 0.1 from 0.7 s on (by 0.1) and the rest of the trial keep it; before, d is 4 too large
    # for it to matter. Later samples are as near: at most 0.1 m/s.
    assert finding.verdict is SATISFIED
    assert finding.robustness == pytest.approx(0.1)
    assert finding.unit == "m/s"
    assert finding.subject == "robot/human"


def test_a_robot_that_stops_too_late_is_one_violation_with_its_reason() -> None:
    # Too close from 0.3 s on; still at 1.0 s. From 0.5 s on the stop is within half a second.
    log = trial(tenths(20), [5.0] * 3 + [0.5] * 17, [0.4] * 10 + [0.0] * 10)

    finding = only(STOP, log)

    assert finding.verdict is VIOLATED
    assert finding.span == Span(0.3, 0.5)  # violated at 0.3 and 0.4 s
    assert finding.robustness == pytest.approx(-0.3)  # 0.4 m/s where less than 0.1 was promised
    assert finding.unit == "m/s"
    assert finding.message == (
        "violated for 0.200 s, at worst at 0.300 s: 'eventually[0,0.5] v < 0.1' fails at 0.300 s, "
        "for 'v < 0.1' fails at 0.300 s by 0.3 m/s"
    )
    assert dict(finding.labels) == {"failed": "eventually[0,0.5] v < 0.1", "because_of": "v < 0.1"}
    assert finding.quantities["time_in_violation_s"] == pytest.approx(0.2)
    assert finding.quantities["failed_at_s"] == pytest.approx(0.3)
    assert {(s.signal, s.t_s, s.value) for s in finding.evidence} == {
        ("centre_distance/robot/human", 0.3, 0.5),
        ("speed/robot", 0.3, 0.4),
    }


def test_the_reason_of_a_promise_never_kept_is_where_it_came_nearest() -> None:
    log = trial(tenths(8), 0.5, [0.9, 0.8, 0.2, 0.7, 0.9, 0.9, 0.9, 0.9])

    first = findings("always[0,0] eventually[0,0.5] v < 0.1", log)[0]

    assert first.quantities["failed_at_s"] == pytest.approx(0.2)
    assert first.robustness == pytest.approx(-0.1)
    assert first.message.endswith("for 'v < 0.1' fails at 0.200 s by 0.1 m/s")


def test_what_was_forbidden_is_named_where_it_holds() -> None:
    finding = only("always not (v > 2 and d < 1)", trial(tenths(3), [5, 0.5, 5], [0, 3, 0]))

    assert finding.verdict is VIOLATED
    assert finding.robustness == pytest.approx(-0.5)  # 1 m/s too fast, 0.5 m too near: the lesser of both
    assert finding.message.endswith("'d < 1' holds at 0.100 s by 0.5 m")
    assert finding.unit == "m"


def test_two_approaches_are_two_violations_and_a_short_pause_is_bridged() -> None:
    log = trial(tenths(10), [5, 0.5, 0.5, 5, 0.4, 5, 5, 5, 0.3, 5])

    assert [f.span for f in findings("always d > 1", log)] == [Span(0.1, 0.3), Span(0.4, 0.5), Span(0.8, 0.9)]
    assert [f.span for f in findings("always d > 1", log, t_off_s=0.2)] == [Span(0.1, 0.5), Span(0.8, 0.9)]
    assert [f.robustness for f in findings("always d > 1", log, t_off_s=0.2)] == pytest.approx([-0.6, -0.7])


def test_a_formula_without_always_is_judged_at_the_start() -> None:
    log = trial(tenths(5), [2, 0, 0, 0, 0])

    assert only("d > 1", log).verdict is SATISFIED
    assert only("eventually[0.1,0.2] d > 1", log).verdict is VIOLATED
    assert only("always[0,0] d > 1", log).verdict is SATISFIED


def test_always_with_bounds_is_judged_in_them_and_nowhere_else() -> None:
    log = trial(tenths(6), [0, 0, 2, 2, 0, 0])

    assert only("always[0.2,0.3] d > 1", log).verdict is SATISFIED
    assert only("always[0.2,0.4] d > 1", log).span == Span(0.4, 0.4)  # what comes after does not count


def test_past_and_change() -> None:
    # Moving is allowed only within 0.2 s after the human was far.
    log = trial(tenths(6), [5, 0, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0])

    (violation,) = findings("always (v > 0.5 -> once[0,0.2] d > 1)", log)
    assert violation.span == Span(0.3, 0.4)
    (start,) = findings("always (rise(v > 0.5) -> d > 1)", log, beyond="cut")
    assert start.span == Span(0.2, 0.3)
    (stop,) = findings("always (fall(v > 0.5) -> d > 1)", log, beyond="cut")
    assert stop.span == Span(0.4, 0.5)
    (before, last) = findings("always (next v > 0.5 -> v > 0.5)", log)
    assert before.span == Span(0.1, 0.2)
    assert last.verdict is INCONCLUSIVE  # there is no sample after the last one


def test_until_and_since() -> None:
    log = trial(tenths(6), [2, 2, 2, 0, 0, 0], [0, 0, 0, 1, 1, 1])

    assert only("d > 1 until v > 0.5", log).verdict is SATISFIED
    assert only("d > 1 until[0,0.2] v > 0.5", log).verdict is VIOLATED
    assert only("d > 1 until[0,0.3] v > 0.5", log).verdict is SATISFIED
    assert only("d > 1 until[0.4,0.5] v > 0.5", log).verdict is VIOLATED  # d gives way at 0.3 s
    assert only("always[0.5,0.5] (v > 0.5 since d > 1)", log).verdict is SATISFIED
    assert only("always[0.5,0.5] (v > 0.5 since[0.3,0.3] d > 1)", log).verdict is SATISFIED
    assert only("always[0.5,0.5] (v > 0.5 since[0.4,0.4] d > 1)", log).verdict is VIOLATED


def test_in_dense_time_a_violation_lasts_as_long_as_its_sample_stands() -> None:
    log = trial([0.0, 0.3, 1.0, 2.0], [5, 0.5, 5, 5])

    assert only("always d > 1", log, time="dense").span == Span(0.3, 1.0)
    # The first sample with d < 1 is 0.3 s away from 0.0 s; a window of 0.1 s sees it from 0.2 s on.
    violation = only("always[0,1.5] always[0,0.1] d > 1", log, time="dense")
    assert violation.span is not None
    assert (violation.span.start_s, violation.span.end_s) == pytest.approx((0.2, 1.0))
    # In discrete time there is no sample at 0.2 s.
    assert only("always[0,1.5] always[0,0.1] d > 1", log).span == Span(0.3, 1.0)


def test_the_last_sample_counts_in_both_times() -> None:
    log = trial(tenths(4), [5, 5, 5, 0])

    for time in ("discrete", "dense"):
        assert only("always d > 1", log, time=time).verdict is VIOLATED


# Limits --------------------------------------------------------------------------------


@pytest.mark.parametrize("time", ["discrete", "dense"])
@pytest.mark.parametrize(
    ("formula", "at_the_limit", "below"),
    [
        ("d >= 1", True, False),
        ("d > 1", False, False),
        ("not (d < 1)", True, False),
        ("not (d <= 1)", False, False),
    ],
)
def test_the_limit_to_the_bit(formula: str, at_the_limit: bool, below: bool, time: Any) -> None:
    for d, kept in [(1.0, at_the_limit), (np.nextafter(1.0, 0), below), (np.nextafter(1.0, 2), True)]:
        found = only(f"always ({formula})", trial([0.0, 0.1, 0.2], [5.0, float(d), 5.0]), time=time)
        assert found.verdict is (SATISFIED if kept else VIOLATED)
        assert found.robustness is not None
        assert (found.robustness <= 0) if not kept else (found.robustness >= 0)


def test_a_bound_is_part_of_its_window_and_the_next_sample_is_not() -> None:
    v = [1.0] * 5 + [0.0] * 15
    d = [0.0] + [5.0] * 19

    assert only(STOP, trial(tenths(20), d, v)).verdict is SATISFIED  # still at 0.5 s to the sample
    assert only(STOP, trial(tenths(20), d, [1.0, *v[:-1]])).verdict is VIOLATED  # at 0.6 s


def test_bounds_that_no_float_has_still_include_their_sample() -> None:
    # 0.3 s after 0.1 s is 0.4 s, though 0.1 + 0.3 is 0.4 and 0.7 - 0.4 is less than 0.3.
    t = [0.4, 0.7]
    assert 0.7 - 0.4 < 0.3
    assert only("always[0,0] eventually[0.3,0.3] d > 1", trial(t, [0, 5])).verdict is SATISFIED


@pytest.mark.parametrize(
    ("bounds", "row", "moved_s"), [("[0.10000000105,0.25]", 1, 1e-10), ("[0.05,0.19999999895]", 2, -1e-10)]
)
def test_a_sample_at_the_tolerance_of_a_bound_counts_by_its_own_time(
    bounds: str, row: int, moved_s: float
) -> None:
    # A bound includes what is 1e-9 s outside: samples from 0.10000000005 s on, or to 0.19999999995 s.
    # The samples are so evenly spaced that windows are counted in steps otherwise.
    t, d = tenths(10), [0.0] * 10
    d[row] = 5.0
    outside = only(f"eventually{bounds} d > 1", trial(t, d))
    t[row] += moved_s
    inside = only(f"eventually{bounds} d > 1", trial(t, d))

    assert (outside.verdict, inside.verdict) == (VIOLATED, SATISFIED)


# Without a value -----------------------------------------------------------------------


@pytest.mark.parametrize("time", ["discrete", "dense"])
@pytest.mark.parametrize("outermost", ["always", "always[0,0.1]", ""])
def test_a_predicate_without_value_is_named_with_its_first_row_even_where_nothing_is_judged(
    time: Any, outermost: str
) -> None:
    log = trial(tenths(12), [1.0] * 9 + [0.0] * 3, [1.0] * 2 + [0.0] * 10)

    # The first predicate is without a value in row 9, the second in row 2 already: the first is named.
    finding = only(f"{outermost} (1 / d > 0 and 1 / v > 0)", log, time=time)

    assert finding.verdict is INCONCLUSIVE
    assert "division by zero in row 9: '1 / d'" in finding.message


@pytest.mark.parametrize("time", ["discrete", "dense"])
def test_a_predicate_without_value_late_in_a_long_trial_is_named_with_its_row(time: Any) -> None:
    d = np.ones(70_000)
    d[[66_000, 69_000]] = 0.0

    finding = only("always 1 / d > 0", trial((np.arange(70_000) / 100).tolist(), d.tolist()), time=time)

    assert finding.verdict is INCONCLUSIVE
    assert "row 66000" in finding.message


# What cannot be decided ----------------------------------------------------------------

GAP = [0.0, 0.1, 0.2, 0.3, 1.3, 1.4, 1.5, 1.6]
"""Nothing is known from 0.3 to 1.3 s."""


def test_a_gap_leaves_open_what_its_window_reaches_and_nothing_else() -> None:
    finding = only(
        "always[0,0.5] eventually[0,0.2] d > 1", trial(GAP, [0, 0, 5, 0, 5, 5, 5, 5]), max_gap_s=0.15
    )

    # From 0.0 to 0.2 s the sample at 0.2 s keeps it; from 0.3 to 0.5 s only what is missing could.
    assert finding.verdict is INCONCLUSIVE
    assert finding.span is not None
    assert finding.span.start_s == pytest.approx(0.3)
    assert "no samples for 1.000 s, from 0.300 s" in finding.message


def test_a_gap_that_cannot_change_the_verdict_is_no_matter() -> None:
    log = trial(GAP, [0, 5, 5, 5, 5, 5, 5, 5])

    assert only("eventually d > 1", log, max_gap_s=0.15).verdict is SATISFIED
    assert only("always[0,0.2] d >= 0", log, max_gap_s=0.15).verdict is SATISFIED
    assert only("always[0,0.1] d > 1", log, max_gap_s=0.15).verdict is VIOLATED
    assert only("always[0,0] historically d > 1", log, max_gap_s=0.15).verdict is VIOLATED


@pytest.mark.parametrize("time", ["discrete", "dense"])
def test_a_violation_next_to_a_gap_is_a_violation_and_the_gap_is_reported_too(time: Any) -> None:
    log = trial(GAP, [5, 0, 5, 5, 5, 5, 5, 5])

    found = findings("always d > 1", log, max_gap_s=0.15, time=time)

    assert [f.verdict for f in found] == [VIOLATED, INCONCLUSIVE]
    assert found[1].span is not None
    assert found[1].span.end_s == pytest.approx(1.3)


@pytest.mark.parametrize("beyond", ["weak", "strong", "cut"])
def test_no_policy_about_the_end_decides_a_gap(beyond: Any) -> None:
    log = trial(GAP, 5.0)

    assert only("always d > 1", log, max_gap_s=0.15, beyond=beyond).verdict is INCONCLUSIVE


@pytest.mark.parametrize("time", ["discrete", "dense"])
@pytest.mark.parametrize(
    ("beyond", "verdict"),
    [("undecided", INCONCLUSIVE), ("weak", SATISFIED), ("strong", VIOLATED), ("cut", VIOLATED)],
)
def test_what_a_promise_open_at_the_end_counts_as(beyond: Any, verdict: Verdict, time: Any) -> None:
    log = trial(tenths(10), [5.0] * 8 + [0.5] * 2, 1.0)  # too close from 0.8 s on, over at 0.9 s

    assert only(STOP, log, beyond=beyond, time=time).verdict is verdict


def test_what_a_window_longer_than_the_trial_counts_as(subtests: pytest.Subtests) -> None:
    cases: list[tuple[Any, Verdict]] = [
        ("undecided", INCONCLUSIVE),
        ("weak", SATISFIED),
        ("strong", VIOLATED),
        ("cut", SATISFIED),
    ]
    for beyond, verdict in cases:
        with subtests.test(beyond=beyond):
            assert only("always[0,60] d > 1", trial(tenths(10)), beyond=beyond).verdict is verdict
            assert only("historically[0,60] d > 1", trial(tenths(10)), beyond=beyond).verdict is verdict


@pytest.mark.parametrize("time", ["discrete", "dense"])
@pytest.mark.parametrize(
    ("beyond", "verdict"),
    [("undecided", INCONCLUSIVE), ("weak", SATISFIED), ("strong", VIOLATED), ("cut", VIOLATED)],
)
def test_what_is_awaited_when_the_trial_ends_counts_as_the_policy_says(
    beyond: Any, verdict: Verdict, time: Any
) -> None:
    kept = trial(tenths(10), 5.0, 0.0)

    assert only("d > 1 until[0,60] v > 0.5", kept, beyond=beyond, time=time).verdict is verdict
    broken = trial(tenths(10), [5.0] * 9 + [0.0], 0.0)  # before the end, so that nothing beyond it helps
    assert only("d > 1 until[0,60] v > 0.5", broken, beyond=beyond, time=time).verdict is VIOLATED


@pytest.mark.parametrize("time", ["discrete", "dense"])
@pytest.mark.parametrize(
    ("beyond", "verdict"),
    [("undecided", INCONCLUSIVE), ("weak", SATISFIED), ("strong", VIOLATED), ("cut", SATISFIED)],
)
def test_what_a_window_after_the_trial_counts_as(beyond: Any, verdict: Verdict, time: Any) -> None:
    assert only("always[5,6] d > 1", trial(tenths(10), 0.0), beyond=beyond, time=time).verdict is verdict


def test_episodes_too_short_to_count_are_mentioned_but_do_not_violate() -> None:
    log = trial(tenths(6), [5, 0, 5, 5, 0, 0])

    finding = only("always[0,0.3] d > 1", log, t_on_s=0.15)

    assert finding.verdict is SATISFIED
    assert finding.message == "never broken for 0.15 s; at its worst at 0.100 s by -1 m"
    assert only("always[0,0.3] d > 1", log, t_on_s=0.1).verdict is VIOLATED
    assert only("not (d > 1)", log, t_on_s=0.15).verdict is VIOLATED  # judged at one moment


def test_a_margin_over_time_is_that_of_the_finding_where_only_truth_decides() -> None:
    # At 0 s `v > 0.5` fails by 0: broken, although what is before the trial leaves the margin open below 0.
    t = [0.0, 0.02, 0.04, 0.06]
    human = Signal("speed/human", "m/s", np.array(t), np.array([2.0, 0.0, 0.0, 0.0]))
    log = trial(t, v=[0.5, 0.0, 0.0, 0.0])
    log = replace(log, signals={**log.signals, human.name: human})
    formula = StlFormula(
        formula="always (v > 0.5 since[0,0.05] w < 1)",
        signals={"v": SPEED, "w": "speed of human in m/s"},
        max_gap_s=0.05,
    )

    (finding,) = formula.watch(log)
    (chart,) = formula.margins(log)

    assert (finding.verdict, finding.robustness) == (VIOLATED, 0.0)
    assert (chart.actual - chart.limit)[0] == 0.0


def test_a_bridged_pause_is_no_time_in_violation() -> None:
    log = trial(tenths(6), [5, 0, 5, 0, 5, 5])

    for time in ("discrete", "dense"):
        finding = only("always d > 1", log, t_off_s=0.2, time=time)
        assert finding.span == Span(0.1, 0.4)
        assert finding.quantities["time_in_violation_s"] == pytest.approx(0.2)


@pytest.mark.parametrize("time", ["discrete", "dense"])
def test_spans_are_reported_without_the_tolerance_of_windows(time: Any) -> None:
    found = findings("always always[0,0.25] d > 1", trial(GAP, 5.0), max_gap_s=0.15, time=time)

    for finding in found:
        assert finding.span is not None
        assert all(round(s, 4) == s for s in (finding.span.start_s, finding.span.end_s))


def test_a_kept_promise_is_kept_to_the_end_of_the_trial() -> None:
    assert only(STOP, trial(tenths(10), 0.5, 0.0)).verdict is SATISFIED


@pytest.mark.parametrize("bounds", ["[0.02,0.08]", "[0.11,0.19]"])
def test_bounds_between_two_samples_are_not_decided(bounds: str) -> None:
    finding = only(f"always[0,0.5] eventually{bounds} d > 1", trial(tenths(10)))

    assert finding.verdict is INCONCLUSIVE
    assert "shorter than the time between two samples" in finding.message


@pytest.mark.parametrize("bounds", ["[0.02,0.08]", "[0.11,0.19]"])
def test_samples_behind_a_window_without_one_decide_no_until_and_no_since(bounds: str) -> None:
    # v > 0.5 at no sample; but at 0.05 s, or at 0.15 s, it may have been, and d > 1 held up to there.
    held = trial(tenths(10), [5.0] * 2 + [0.0] * 8)
    lost = trial(tenths(10), 0.0)

    assert only(f"d > 1 until{bounds} v > 0.5", held).verdict is INCONCLUSIVE
    assert only(f"not (d > 1 until{bounds} v > 0.5)", held).verdict is INCONCLUSIVE
    assert only(f"d > 1 until{bounds} v > 0.5", lost).verdict is VIOLATED  # d fails before the window
    assert only(f"not (d > 1 until{bounds} v > 0.5)", lost).verdict is SATISFIED
    # Backwards from 0.9 s; the window ends at 0.88 s, or at 0.79 s.
    held = trial(tenths(10), [0.0] * 8 + [5.0] * 2)
    assert only(f"always[0.9,0.9] (d > 1 since{bounds} v > 0.5)", held).verdict is INCONCLUSIVE
    assert only(f"always[0.9,0.9] not (d > 1 since{bounds} v > 0.5)", held).verdict is INCONCLUSIVE
    assert only(f"always[0.9,0.9] (d > 1 since{bounds} v > 0.5)", lost).verdict is VIOLATED
    assert only(f"always[0.9,0.9] not (d > 1 since{bounds} v > 0.5)", lost).verdict is SATISFIED


def test_no_policy_decides_the_part_of_a_window_that_lies_in_the_trial_between_samples(
    subtests: pytest.Subtests,
) -> None:
    cases: list[tuple[Any, Verdict, Verdict]] = [
        ("cut", INCONCLUSIVE, INCONCLUSIVE),
        ("weak", SATISFIED, INCONCLUSIVE),  # what lies beyond keeps the promise, whatever is missing before
        ("strong", INCONCLUSIVE, VIOLATED),
        ("undecided", INCONCLUSIVE, INCONCLUSIVE),
    ]
    for beyond, promise, rule in cases:
        with subtests.test(beyond=beyond):
            # Samples from 0 to 0.9 s of a trial from -0.05 to 0.95 s: the windows below hold none of them,
            # and 0.03 s of each lie in the trial.
            log = trial(tenths(10), 0.0, window=Span(-0.05, 0.95))

            for ahead, back in (("eventually", "once"), ("always", "historically")):
                wanted = promise if ahead == "eventually" else rule
                assert (
                    only(f"always[0.95,0.95] {ahead}[0.02,0.1] d > 1", log, beyond=beyond).verdict is wanted
                )
                assert only(f"{back}[0.02,0.1] d > 1", log, beyond=beyond).verdict is wanted


def test_bounds_between_two_samples_are_decided_in_dense_time() -> None:
    finding = only("always[0,0.5] eventually[0.02,0.08] d > 1", trial(tenths(10)), time="dense")

    assert finding.verdict is SATISFIED


def test_a_late_start_of_the_signals_is_not_decided() -> None:
    log = trial(tenths(10), window=Span(-3.0, 0.9))

    assert INCONCLUSIVE in [f.verdict for f in findings("always d > 1", log)]
    assert INCONCLUSIVE in [f.verdict for f in findings("always d > 1", log, time="dense")]


def test_a_division_by_zero_is_not_decided() -> None:
    finding = only("always 1 / d > 0", trial(tenths(3), [1, 0, 1]))

    assert finding.verdict is INCONCLUSIVE
    assert "division by zero" in finding.message


def test_what_lies_outside_the_competition_does_not_count() -> None:
    events = (Event(0.2, "competition_started"), Event(0.6, "competition_ended"))
    log = trial(tenths(10), [0, 0, 5, 5, 5, 5, 5, 0, 0, 0], events=events)

    assert only("always d > 1", log).verdict is SATISFIED
    (half,) = [
        f for f in findings("always d > 1", replace(log, events=events[:1])) if f.verdict is INCONCLUSIVE
    ]
    assert "does not show the end of the competition" in half.message


@given(st.lists(st.sampled_from([0.0, 1.0, 2.0]), min_size=3, max_size=12), st.integers(0, 11))
@settings(max_examples=60, derandomize=True, deadline=None)
def test_less_data_never_turns_a_verdict_round(d: list[float], lost: int) -> None:
    formula = "always (d < 1.5 -> eventually[0,0.2] d > 1.5)"
    t = tenths(len(d))
    whole = {f.verdict for f in findings(formula, trial(t, d), max_gap_s=0.15)}
    kept = [k for k in range(len(d)) if k != lost]

    log = trial([t[k] for k in kept], [d[k] for k in kept], window=Span(t[0], t[-1]))
    found = {f.verdict for f in findings(formula, log, max_gap_s=0.15)}

    if VIOLATED in found:
        assert VIOLATED in whole
    if found == {SATISFIED}:
        assert whole == {SATISFIED}


# Whom it is about ----------------------------------------------------------------------


def _several() -> Trial:
    t = np.array(tenths(3))
    values = {
        "centre_distance/a/p": 5.0,
        "centre_distance/b/p": 0.5,
        "speed/a": 0.0,
        "speed/b": 3.0,
        "speed/p": 1.0,
        "speed/agv1": 0.2,
    }
    units = {"centre_distance": "m", "speed": "m/s"}
    signals = {n: Signal(n, units[n.split("/")[0]], t, np.full(3, v)) for n, v in values.items()}
    bodies = (Body("a", "robot"), Body("b", "robot"), Body("p", "human"), Body("agv1", "agv"))
    return Trial("t", bodies=bodies, signals=signals, recorded=Span(0.0, 0.2))


def test_a_formula_is_judged_for_everyone_it_speaks_of(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, str, Mapping[str, Verdict]]] = [
        ("centre_distance in m", "always x > 1", {"a/p": SATISFIED, "b/p": VIOLATED}),
        ("speed of robot in m/s", "always x < 2", {"a": SATISFIED, "b": VIOLATED}),
        ("speed of human in m/s", "always x < 2", {"p": SATISFIED}),
        ("speed of agv1 in m/s", "always x < 2", {"trial": SATISFIED}),
        ("centre_distance of b/p in m", "always x > 1", {"trial": VIOLATED}),
    ]
    for source, formula, verdicts in cases:
        with subtests.test(source=source, formula=formula):
            found = StlFormula(formula=formula, signals={"x": source}, max_gap_s=0.2).watch(_several())

            assert {f.subject: f.verdict for f in found} == verdicts


def test_it_needs_what_it_reads() -> None:
    needs = [(n.quantity, n.unit, n.max_gap_s) for n in monitor(STOP, max_gap_s=0.2).needs()]

    assert needs == [("centre_distance", "m", 0.2), ("speed", "m/s", 0.2)]


def test_a_missing_signal_is_not_decided() -> None:
    log = replace(_several(), unrecorded=("topic /humans",))
    log = replace(log, signals={n: s for n, s in log.signals.items() if n != "speed/b"})

    found = list(StlFormula(formula="always v < 9", signals={"v": SPEED}, max_gap_s=0.2).watch(log))

    assert [(f.subject, f.verdict) for f in found] == [("a", SATISFIED), ("b", INCONCLUSIVE)]
    assert found[1].message == "signal 'speed/b' is not in the log"


def test_nobody_to_judge_is_not_the_same_as_nobody_recorded() -> None:
    nobody = Trial("t", recorded=Span(0.0, 1.0))

    assert only(STOP, nobody).verdict is INCONCLUSIVE
    assert only(STOP, replace(nobody, witnessed=frozenset({"bodies"}))).verdict is NOT_APPLICABLE


def test_a_vector_is_not_decided() -> None:
    velocity = Signal("velocity/robot", "m/s", np.array([0.0, 0.1]), np.zeros((2, 3)))
    log = Trial(
        "t", bodies=(Body("robot", "robot"),), signals={velocity.name: velocity}, recorded=Span(0.0, 0.1)
    )

    (found,) = StlFormula(formula="always v < 1", signals={"v": "velocity of robot in m/s"}).watch(log)

    assert found.verdict is INCONCLUSIVE
    assert "3 components" in found.message


def test_a_signal_in_another_unit_is_refused() -> None:
    with pytest.raises(LogError, match="'speed/robot' is in 'm/s', the check asks for 'km/h'"):
        list(StlFormula(formula="always v < 1", signals={"v": "speed of robot in km/h"}).watch(trial([0.0])))


# What is refused -----------------------------------------------------------------------


def test_a_formula_that_is_none_is_refused_with_its_place(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, str]] = [
        ("", "the formula is empty"),
        ("   ", "the formula is empty"),
        ("always", "column 7: the formula ends where a predicate"),
        ("d > 1 and", "column 10: the formula ends where"),
        ("d", "column 2: the formula ends where a comparison"),
        ("d > ", "column 5: the formula ends where a predicate"),
        ("(d > 1", "column 1: '(' is never closed"),
        ("d > 1)", "column 6: ')' without '('"),
        ("d > 1 d < 2", "column 5: '1 d' is not a formula"),
        ("d > 1 & v < 2", "column 7: '&' (U+0026) means nothing in a formula; write 'and'"),
        ("d ≥ 1", r"column 3: '\u2265' (U+2265) means nothing in a formula"),
        ("d\u0131st > 1", r"column 2: '\u0131' (U+0131)"),
        ("d > 1\x00", r"column 6: '\x00' (U+0000)"),
        ("d > 1 \ud800", r"column 7: '\ud800' (U+D800)"),
        ("dd > 1", "column 1: unknown signal 'dd'; did you mean 'd'?"),
        ("always (v < 1 -> dist > 2)", "column 18: unknown signal 'dist'"),
        ("G (d > 1)", "column 1: unknown signal 'G'; write 'always'"),
        ("sqrt(d) > 1", "column 1: unknown function 'sqrt'"),
        ("abs(d, 2) > 1", "column 1: 'abs' takes 1 values"),
        ("max(d, key=2) > 1", "column 11: '=' (U+003D) means nothing in a formula; write '=='"),
        ("always[2,1] d > 1", "column 7: bounds [2,1] are reversed"),
        (
            "always[-1,1] d > 1",
            "column 8: bounds cannot be negative; 'once', 'historically' and 'since' look back",
        ),
        (
            "always[0:1] d > 1",
            "column 9: ':' (U+003A) means nothing in a formula; bounds are written [from,to]",
        ),
        ("always[0,inf] d > 1", "column 10: 'inf' is no bound"),
        ("always[0,500ms] d > 1", "column 13: 'ms' stands where ']'"),
        ("always[0,1e9] d > 1", "column 10: a bound of 1e+09 s is not between"),
        ("always[0] d > 1", "column 9: ']' stands where ','"),
        ("not[0,1] d > 1", "column 4: 'not' takes no bounds"),
        ("next[0,1] d > 1", "column 5: 'next' takes no bounds"),
        ("d > 1 until v < 1 until d > 1", "column 19: two of 'until' and 'since' in a row; use brackets"),
        ("d > 1 <-> v < 1 <-> d > 1", "column 17: two '<->' in a row; use brackets"),
        ("(d > 1) + 1 > 2", "column 9: '+' stands where an operator"),
        ("1 + (d > 1) > 2", "column 5: a formula stands inside arithmetic"),
        ("d > 1e400", "so large a number is not allowed"),
        ("d > nan", "column 5: unknown signal 'nan'"),
        ("d.x > 1", "means nothing in a formula"),
        ("d[0] > 1", "column 2: '[' stands where a comparison"),
        ("d > 'a'", "means nothing in a formula"),
        ("__import__(1) > 1", "column 1: a name with a leading underscore"),
        ("d > 2j", "column 6: unknown signal 'j'"),
        ("1 > 2", "the formula uses no signal"),
        ("always true", "the formula uses no signal"),
    ]
    for formula, message in cases:
        with subtests.test(formula=formula, message=message):
            with pytest.raises(StlError) as error:
                StlFormula(
                    formula=formula,
                    signals={"d": DISTANCE, "v": SPEED} if "v" in formula else {"d": DISTANCE},
                )

            assert message in str(error.value)
            str(error.value).encode()  # can be printed, whatever the formula had in it


def test_brackets_without_end_are_refused(subtests: pytest.Subtests) -> None:
    cases: list[int] = [MAX_DEPTH + 1, 1000, 10_000, 1_000_000]
    for n in cases:
        with subtests.test(n=n):
            for formula in (
                "(" * n + "d > 1" + ")" * n,
                "(" * (n + 1000) + "d" + ")" * (n + 1000) + " > 1",  # Python itself stops at 200
                "(" * n,
                "not " * n + "d > 1",
            ):
                with pytest.raises(StlError):
                    parse(formula, ["d"])
            with pytest.raises(StlError, match=r"deep|longer"):
                parse("d > 1 -> " * n + "d > 1", ["d"])


def test_a_formula_may_be_as_deep_as_it_says_and_no_deeper() -> None:
    assert parse("not " * (MAX_DEPTH - 1) + "d > 1", ["d"]).operator == "not"
    with pytest.raises(StlError, match=f"{MAX_DEPTH} deep"):
        parse("not " * MAX_DEPTH + "d > 1", ["d"])


def test_a_formula_may_be_as_long_as_it_says_and_no_longer() -> None:
    assert parse("d > 1".ljust(MAX_LENGTH), ["d"]).operator == "predicate"
    with pytest.raises(StlError, match="longer than"):
        parse("d > 1".ljust(MAX_LENGTH + 1), ["d"])
    with pytest.raises(StlError, match="parts"):
        parse(" and ".join(["d>1"] * 400), ["d"])


def _error_in(text: str) -> StlError | None:
    try:
        parse(text, ["d", "v"])
    except StlError as error:
        return error
    return None


@given(st.text(st.sampled_from("dv01.()[],<>=-+*/ \n") | st.characters(), max_size=30))
@settings(max_examples=100, derandomize=True, deadline=None)
def test_any_text_is_a_formula_or_an_error_that_says_so(text: str) -> None:
    error = _error_in(text)

    assert error is None or str(error).encode()


WORDS = [
    "always",
    "eventually",
    "until",
    "since",
    "not",
    "and",
    "->",
    "(",
    ")",
    "[",
    "]",
    ",",
    "0",
    "1",
    "2.5",
    "d",
    "v",
    ">",
    "<",
    "<=",
    "+",
    "-",
    "rise",
    "[0,1]",
    "[1,0]",
    "true",
]


@given(st.lists(st.sampled_from(WORDS), max_size=14))
@settings(max_examples=100, derandomize=True, deadline=None)
def test_any_words_are_a_formula_or_an_error_that_says_so(words: list[str]) -> None:
    text = " ".join(words)
    error = _error_in(text)

    assert error is None or str(error)
    if error is None:
        node = parse(text, ["d", "v"])
        assert parse(node.text, ["d", "v"]).text == node.text


def test_different_units_are_not_compared(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, str]] = [
        ("d > v", "'d > v' mixes m and m/s"),
        ("d + v > 1", "'d + v' mixes m and m/s"),
        ("max(d, v) > 1", "mixes m and m/s"),
        ("d * v > d", "mixes m^2/s and m"),
        ("d ** 2 > d", "mixes m^2 and m"),
        ("always (d > 1 and v / d < v)", "column 19: 'v / d < v' mixes 1/s and m/s"),
    ]
    for formula, message in cases:
        with subtests.test(formula=formula, message=message):
            with pytest.raises(StlError) as error:
                monitor(formula)

            assert message in str(error.value)


def test_a_bare_number_may_have_any_unit(subtests: pytest.Subtests) -> None:
    cases: list[str] = [
        "d > 2.6 + 1.5 * v",
        "d / v > 2",
        "d * d > d ** 2",
        "v * v / v < v",
        "abs(-d) > min(d, 1)",
        "0 < d < 2",
    ]
    for formula in cases:
        with subtests.test(formula=formula):
            assert monitor(formula).tree.names


def test_parameters_that_make_no_sense_are_refused(subtests: pytest.Subtests) -> None:
    cases: list[tuple[Mapping[str, Any], str]] = [
        ({"signals": {"d": "centre_distance"}}, "write 'QUANTITY in UNIT'"),
        ({"signals": {"d": "centre_distance in  "}}, "write 'QUANTITY in UNIT'"),
        ({"signals": {"d": "centre_distance in m,s"}}, "'m,s' is not a unit"),
        ({"signals": {"d": DISTANCE, "v": SPEED}}, "does not use signal 'v'"),
        ({"signals": {"d": DISTANCE, "until": SPEED}}, "'until' is a word of the language"),
        ({"signals": {"d": DISTANCE, "max": SPEED}}, "'max' is a word of the language"),
        ({"signals": {"d": DISTANCE, "lambda": SPEED}}, "'lambda' is a word of the language"),
        ({"signals": {"d": DISTANCE, "ö": SPEED}}, r"'\xf6' is not a name"),
        ({"signals": {"d": DISTANCE, "_x": SPEED}}, "'_x' is not a name"),
        ({"constants": {"d": 1.0}}, "'d' is a signal and a constant"),
        ({"constants": {"c": float("nan")}}, "constants must be finite"),
        ({"max_gap_s": 0.0}, "max_gap_s is 0 but must be at least 1e-06"),
        ({"t_off_s": -1.0}, "t_off_s is -1 but cannot be negative"),
        ({"time": "dense", "formula": "always next d > 1"}, "column 8: 'next' is about neighbouring samples"),
        ({"time": "dense", "formula": "rise(d > 1)"}, "'rise' is about neighbouring samples"),
    ]
    for parameters, message in cases:
        with subtests.test(message=message):
            with pytest.raises(ValueError) as error:  # noqa: PT011  # the text is looked at below
                StlFormula(**{"formula": "always d > 1", "signals": {"d": DISTANCE}, **parameters})

            assert message in str(error.value)


def test_constants_stand_in_predicates_and_in_bounds() -> None:
    log = trial(tenths(10), [5, 0, 0, 5, 5, 5, 5, 5, 5, 5])
    constants = {"d_min": 1.0, "patience": 0.2}
    formula = "always (d < d_min -> eventually[0,patience] d > d_min)"

    assert only(formula, log, constants=constants).verdict is SATISFIED
    assert only(formula, log, constants={**constants, "patience": 0.1}).verdict is VIOLATED
    with pytest.raises(StlError, match=r"'patients' is no bound; did you mean 'patience'\?"):
        monitor(formula.replace("patience", "patients"), constants=constants)
    with pytest.raises(StlError, match="a bound of -1 s is not between"):
        monitor(formula, constants={**constants, "patience": -1.0})


# In a rule set -------------------------------------------------------------------------

RULES = """
id: r
title: R
source: a test
log_map: ariac2020
monitors:
  stops:
    use: stl.formula
    with:
      formula: always (d < 1 -> eventually[0,0.5] v < 0.1)
      signals: {{d: centre_distance in m, v: {speed}}}
      max_gap_s: 0.15
      critical: true
score: holds(stops)
"""


def test_a_rule_set_scores_a_formula(tmp_path: Path) -> None:
    (tmp_path / "r.yaml").write_text(RULES.format(speed="speed of robot in m/s"))
    rule_set, registry = load_rule_set(str(tmp_path / "r.yaml")), Registry()
    log = trial(tenths(20), [5.0] * 3 + [0.5] * 17, [0.4] * 10 + [0.0] * 10)

    measured = measure_trial(log, prepare(rule_set, registry=registry))

    assert [(key, f.verdict, f.critical) for key, f in measured.findings.items()] == [
        ("stops#1", VIOLATED, True)
    ]


@pytest.mark.parametrize(
    ("speed", "message"),
    [
        ("robot_speed", "signal 'v' is 'robot_speed'; write 'QUANTITY in UNIT'"),
        ("speed in m^", "'m^' is not a unit"),
    ],
)
def test_a_rule_set_with_a_broken_formula_is_refused(tmp_path: Path, speed: str, message: str) -> None:
    (tmp_path / "r.yaml").write_text(RULES.format(speed=speed))

    with pytest.raises(RuleSetError, match=r"stl\.formula refuses its parameters") as error:
        load_rule_set(str(tmp_path / "r.yaml")).build(Registry())

    assert message in str(error.value)
