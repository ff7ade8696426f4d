"""From rejected events to findings of `rml.spec`: worked by hand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Event, Signal, Span, Trial, Verdict
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score_rml import RmlSpec


def of(columns: dict[str, tuple[Any, Any]]) -> Trial:
    """A robot with signals in m, each of times and values."""
    signals = {
        name: Signal(name, "m", np.asarray(t, float), np.broadcast_to(np.asarray(values, float), len(t)))
        for name, (t, values) in columns.items()
    }
    start_s = min(float(signal.t[0]) for signal in signals.values())
    end_s = max(float(signal.t[-1]) for signal in signals.values())
    events = Event(start_s, COMPETITION_STARTED), Event(end_s, COMPETITION_ENDED)
    return Trial(
        "t",
        bodies=(Body("r", "robot"),),
        signals=signals,
        recorded=Span(start_s, end_s),
        events=events,
    )


def steps_of_100_ms(values: Sequence[float]) -> Trial:
    return of({"a/r": (np.arange(len(values)) / 10, values)})


def spec(text: str, **more: Any) -> RmlSpec:
    return RmlSpec(text, {"s": {"x": "a/{robot} [m]"}}, **{"max_gap_s": 0.15, "t_off_s": 0.0, **more})


AT_LEAST_1 = "ok matches {topic: 's', x: v} with v >= 1; Main = ok*;"


def test_a_violation_is_as_long_and_as_deep_as_its_events() -> None:
    # Rejected from 0.3 s to before 1 s, 0.5 m below the limit of 1 m but once 0.75 m, at 0.8 s.
    values = [2.0] * 3 + [0.5] * 5 + [0.25] + [0.5] + [2.0] * 4
    (found,) = spec(AT_LEAST_1).watch(steps_of_100_ms(values))

    assert (found.verdict, found.robustness, found.unit) == (Verdict.VIOLATED, -0.75, "m")
    assert found.span is not None
    assert (found.span.start_s, found.span.end_s) == pytest.approx((0.3, 1.0))
    assert "7 events are rejected" in found.message
    assert [sample.t_s for sample in found.evidence] == [0.8, 0.8]
    assert found.quantities == pytest.approx(
        {
            "time_in_violation_s": 0.7,
            "depth_max_m": 0.75,
            "depth_integral_m_s": 0.6 * 0.5 + 0.1 * 0.75,
            "relative_depth_max": 0.75,
            "relative_depth_integral_s": 0.6 * 0.5 + 0.1 * 0.75,
        }
    )


def test_a_trial_that_is_kept_has_its_closest_event_as_evidence() -> None:
    (found,) = spec(AT_LEAST_1).watch(steps_of_100_ms([3.0, 2.0, 1.25, 5.0, 1.25, 1.5, 4.0]))

    assert (found.verdict, found.robustness) == (Verdict.SATISFIED, 0.25)
    assert "at 0.200 s" in found.message


@pytest.mark.parametrize(
    ("after", "rejected_s"), [("resume", [0.2, 0.4, 0.6]), ("restart", [0.2, 0.6]), ("once", [0.2])]
)
def test_the_state_after_a_rejection_is_that_of_the_policy(after: Any, rejected_s: list[float]) -> None:
    # First a 1, then any number of 2, at last a 3. Where it goes on waiting for the 3 each further 1 is
    # rejected; where it restarts, the 2 after that as well, and at the end the 3.
    text = """one matches {topic: 's', x: 1.0}; two matches {topic: 's', x: 2.0};
    three matches {topic: 's', x: 3.0}; Main = (one two* three)*;"""
    found = list(spec(text, after_violation=after).watch(steps_of_100_ms([1, 2, 1, 2, 1, 2, 1, 2, 3])))

    assert [f.verdict for f in found] == [Verdict.VIOLATED] * len(rejected_s)
    assert [f.span and f.span.start_s for f in found] == pytest.approx(rejected_s)


def test_an_event_that_cannot_be_judged_is_named_by_its_number() -> None:
    text = "a matches {topic: 's', x: v} with v ^ 0.5 > 0.5; Main = a*;"
    (found,) = spec(text).watch(steps_of_100_ms([1.0] * 6 + [-1.0] + [1.0] * 3))

    assert (found.verdict, found.span) == (Verdict.INCONCLUSIVE, Span(0.6, 0.9))
    assert "event 7, at 0.600 s" in found.message


def test_a_trial_that_ends_too_early_is_a_violation() -> None:
    text = "low matches {topic: 's', x: v} with v < 1; high not matches low; Main = high* low any*;"
    (never,) = spec(text).watch(steps_of_100_ms([2.0] * 8))
    kept = list(spec(text).watch(steps_of_100_ms([2.0] * 4 + [0.5] + [2.0] * 3)))

    assert (never.verdict, never.span) == (Verdict.VIOLATED, Span(0.7, 0.7))
    assert [f.verdict for f in kept] == [Verdict.SATISFIED]


@pytest.mark.parametrize(
    ("kinds", "verdict"),
    [
        ((COMPETITION_STARTED, COMPETITION_ENDED), Verdict.VIOLATED),
        ((COMPETITION_STARTED,), Verdict.INCONCLUSIVE),
        ((COMPETITION_ENDED,), Verdict.INCONCLUSIVE),
        ((), Verdict.INCONCLUSIVE),
    ],
)
def test_what_is_still_asked_for_is_broken_only_where_the_log_shows_the_end(
    kinds: tuple[str, ...], verdict: Verdict
) -> None:
    text = "low matches {topic: 's', x: v} with v < 1; high not matches low; Main = high* low any*;"
    trial = steps_of_100_ms([2.0] * 8)
    trial = replace(trial, events=tuple(event for event in trial.events if event.kind in kinds))

    found = {finding.verdict for finding in spec(text).watch(trial)}

    assert verdict in found
    assert Verdict.SATISFIED not in found


def test_without_the_end_a_specification_that_asks_for_nothing_more_is_kept() -> None:
    (kept,) = spec(AT_LEAST_1).watch(replace(steps_of_100_ms([2.0] * 8), events=()))

    assert kept.verdict is Verdict.SATISFIED


def test_a_margin_that_an_event_has_not_is_missing_there_alone() -> None:
    # A root of -1 has no value; `v >= 0` keeps it from being evaluated, as it does event by event.
    text = "a matches {topic: 's', x: v} with v >= 0 && v ^ 0.5 > 0.9; Main = a*;"
    trial = steps_of_100_ms([1.0, 0.25, 1.0, 1.0, 4.0, 9.0, -1.0, 1.0])
    measured, without = spec(text).watch(trial)
    (chart,) = spec(text).margins(trial)

    assert measured.robustness == pytest.approx(0.5 - 0.9)
    assert without.robustness is None
    assert [f.span and f.span.start_s for f in (measured, without)] == pytest.approx([0.1, 0.6])
    assert np.isnan(chart.limit).tolist() == [False] * 6 + [True, False]


def test_where_one_event_cannot_be_judged_no_event_has_a_margin() -> None:
    text = "a matches {topic: 's', x: v} with v ^ 0.5 > 0.9; Main = a*;"
    trial = steps_of_100_ms([1.0, 0.25, 1.0, 1.0, 4.0, 9.0, -1.0, 1.0])
    rejected, open_ = spec(text).watch(trial)
    charts = list(spec(text).margins(trial))

    assert (rejected.verdict, rejected.robustness) == (Verdict.VIOLATED, None)
    assert (open_.verdict, open_.span) == (Verdict.INCONCLUSIVE, Span(0.6, 0.7))
    assert charts == []


def test_an_event_stands_until_the_next_one_of_its_topic() -> None:
    # Of `s` every 0.1 s, of `t` at 0 s, 0.4 s and 0.9 s: the one at 0.4 s stands for 0.5 s.
    trial = of({"a/r": (np.arange(10) / 10, 5.0), "c/r": ([0.0, 0.4, 0.9], [5.0, 0.5, 5.0])})
    text = "ok matches {x: v} with v >= 1; Main = ok*;"
    sources = {"s": {"x": "a/{robot} [m]"}, "t": {"x": "c/{robot} [m]"}}
    (found,) = RmlSpec(text, sources, max_gap_s=0.6, t_off_s=0.0).watch(trial)

    assert found.span == Span(0.4, 0.9)
    assert found.quantities["time_in_violation_s"] == pytest.approx(0.5)
