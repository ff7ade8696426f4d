"""`rml.spec` goes through a trial window by window: what it says does not hang on where windows begin."""

from __future__ import annotations

import gc
import tracemalloc
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.trial import windows as core_windows
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score_rml import RmlSpec, compile_rml, judging, windows
from ariac_score_rml.windows import Events, Recorded

SIZES = [1, 2, 3, 5, 4096]
TYPES = """
s matches {topic: 's'};
low matches {topic: 's', x: v} with v <= 1;
high matches {topic: 's', x: v, y: w} with v > 1 && w / v >= 0.5;
odd matches {topic: 's'|'t', x: 0.0};
odd matches {topic: 't', y: v} with abs(v) < 1;
far not matches low | odd;
early matches {time: t} with t < 2;
root matches {topic: 's', x: v} with v >= 0 && v ^ 0.5 > 0.9;
at(z) matches {topic: 's', x: z};
"""
MAINS = (
    "(low \\/ high)*",
    "(low | far)*",
    "s >> (low \\/ odd)*",
    "(t >> odd* : low*)",
    "(low (far \\/ odd)* high)*",
    "((early) (low* \\/ odd*) | far*)",
    "(low \\/ G<3>)*",
    "(odd | low high+ )*",
    "{let z; at(z) (far at(z))*}",
    "(root \\/ odd)*",
    "low* high{2} any*",
    "s >> ((odd | low Main)?)",
)
SOURCES = {
    "s": {"x": "a/{robot} [m]", "y": "b/{robot} [m]"},
    "t": {"y": "c/{robot} [m]"},
}


@contextmanager
def window_size(events: int, kept_bytes: int = 0) -> Iterator[None]:
    """Windows of so few events, of which the last one is kept, and so much of what is rejected."""
    with ExitStack() as stack:
        for module, name, value in (
            (windows, "WINDOW_EVENTS", events),
            (judging, "KEPT_WINDOWS", 1),
            (judging, "KEPT_BYTES", kept_bytes),
            (core_windows, "LARGEST_WINDOW_SAMPLES", max(events // 2, 1)),
        ):
            stack.enter_context(patch.object(module, name, value))
        yield


def said(monitor: RmlSpec, trial: Trial) -> list[Any]:
    """All findings, and all margins, to the bit."""
    courses = [
        (course.subject, course.unit, course.t.tobytes(), course.actual.tobytes(), course.limit.tobytes())
        for course in monitor.margins(trial)
    ]
    return [*map(repr, monitor.watch(trial)), *courses]


def of(columns: dict[str, tuple[Any, Any]], *, ended: bool = True) -> Trial:
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
        events=events if ended else events[:1],
    )


def wild(seed: int) -> Trial:
    """Regular samples or not, with gaps, on one time base or on several."""
    dice = np.random.default_rng(seed)

    def times() -> Any:
        n = int(dice.integers(2, 50))
        steps = np.full(n, 0.1) if dice.random() < 0.5 else dice.choice([0.05, 0.1, 0.17], n)
        steps[dice.random(n) < 0.05] += dice.choice([0.3, 1.0])
        return np.cumsum(steps)

    t = times()
    columns = {}
    for name in ("a/r", "b/r", "c/r"):
        own = t if dice.random() < 0.5 else times()
        columns[name] = own, dice.choice([0.0, -0.0, 0.5, 1.0, 1.0 + 1e-11, 1.0 + 1e-9, 2.0, 4.0], len(own))
    return of(columns, ended=bool(dice.random() < 0.8))


@pytest.mark.parametrize("main", MAINS)
@settings(max_examples=8, derandomize=True, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([1, 2, 7, 20]),
    st.sampled_from(["resume", "restart", "once"]),
    st.sampled_from([(0.0, 0.0), (0.0, 0.5), (0.15, 0.1)]),
    st.sampled_from([0, 200, 1 << 20]),
)
def test_what_is_said_does_not_depend_on_windows(
    main: str, seed: int, size: int, after: Any, on_off_s: tuple[float, float], kept_bytes: int
) -> None:
    text = TYPES + f"Main = {main}; G<n> = if (n > 0) low G<n - 1> else high;"
    monitor = RmlSpec(
        text, SOURCES, after_violation=after, max_gap_s=0.25, t_on_s=on_off_s[0], t_off_s=on_off_s[1]
    )
    trial = wild(seed)
    whole = said(monitor, trial)  # which has fewer events than one window

    with window_size(size, kept_bytes):
        assert said(monitor, trial) == whole


# By hand ---------------------------------------------------------------------------------


def steps_of_100_ms(values: Sequence[float]) -> Trial:
    return of({"a/r": (np.arange(len(values)) / 10, values)})


def spec(text: str, **more: Any) -> RmlSpec:
    return RmlSpec(text, {"s": {"x": "a/{robot} [m]"}}, **{"max_gap_s": 0.15, "t_off_s": 0.0, **more})


AT_LEAST_1 = "ok matches {topic: 's', x: v} with v >= 1; Main = ok*;"


@pytest.mark.parametrize("size", SIZES)
def test_a_violation_over_many_windows_is_one_and_adds_up(size: int) -> None:
    # Rejected from 0.3 s to before 1 s, 0.5 m below the limit of 1 m but once 0.75 m, at 0.8 s.
    values = [2.0] * 3 + [0.5] * 5 + [0.25] + [0.5] + [2.0] * 4
    with window_size(size):
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


@pytest.mark.parametrize("size", SIZES)
def test_a_trial_kept_in_all_windows_tells_the_closest_event_of_all(size: int) -> None:
    with window_size(size):
        (found,) = spec(AT_LEAST_1).watch(steps_of_100_ms([3.0, 2.0, 1.25, 5.0, 1.25, 1.5, 4.0]))

    assert (found.verdict, found.robustness) == (Verdict.SATISFIED, 0.25)
    assert "at 0.200 s" in found.message


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(
    ("after", "rejected_s"), [("resume", [0.2, 0.4, 0.6]), ("restart", [0.2, 0.6]), ("once", [0.2])]
)
def test_a_state_goes_from_one_window_to_the_next(size: int, after: Any, rejected_s: list[float]) -> None:
    # First a 1, then any number of 2, at last a 3. Where it goes on waiting for the 3 each further 1 is
    # rejected; where it restarts, the 2 after that as well, and at the end the 3.
    text = """one matches {topic: 's', x: 1.0}; two matches {topic: 's', x: 2.0};
    three matches {topic: 's', x: 3.0}; Main = (one two* three)*;"""
    with window_size(size):
        found = list(spec(text, after_violation=after).watch(steps_of_100_ms([1, 2, 1, 2, 1, 2, 1, 2, 3])))

    assert [f.verdict for f in found] == [Verdict.VIOLATED] * len(rejected_s)
    assert [f.span and f.span.start_s for f in found] == pytest.approx(rejected_s)


@pytest.mark.parametrize("size", SIZES)
def test_an_event_that_cannot_be_judged_is_told_by_its_number_among_all(size: int) -> None:
    text = "a matches {topic: 's', x: v} with v ^ 0.5 > 0.5; Main = a*;"
    with window_size(size):
        (found,) = spec(text).watch(steps_of_100_ms([1.0] * 6 + [-1.0] + [1.0] * 3))

    assert (found.verdict, found.span) == (Verdict.INCONCLUSIVE, Span(0.6, 0.9))
    assert "event 7, at 0.600 s" in found.message


@pytest.mark.parametrize("size", SIZES)
def test_a_trial_that_ends_too_early_does_so_in_any_window(size: int) -> None:
    text = "low matches {topic: 's', x: v} with v < 1; high not matches low; Main = high* low any*;"
    with window_size(size):
        (never,) = spec(text).watch(steps_of_100_ms([2.0] * 8))
        kept = list(spec(text).watch(steps_of_100_ms([2.0] * 4 + [0.5] + [2.0] * 3)))

    assert (never.verdict, never.span) == (Verdict.VIOLATED, Span(0.7, 0.7))
    assert [f.verdict for f in kept] == [Verdict.SATISFIED]


@pytest.mark.parametrize("size", SIZES)
def test_a_margin_that_an_event_has_not_is_missing_there_alone(size: int) -> None:
    # A root of -1 has no value; `v >= 0` keeps it from being asked for, as it does event by event.
    text = "a matches {topic: 's', x: v} with v >= 0 && v ^ 0.5 > 0.9; Main = a*;"
    trial = steps_of_100_ms([1.0, 0.25, 1.0, 1.0, 4.0, 9.0, -1.0, 1.0])
    with window_size(size):
        measured, without = spec(text).watch(trial)
        (course,) = spec(text).margins(trial)

    assert measured.robustness == pytest.approx(0.5 - 0.9)
    assert without.robustness is None
    assert [f.span and f.span.start_s for f in (measured, without)] == pytest.approx([0.1, 0.6])
    assert np.isnan(course.limit).tolist() == [False] * 6 + [True, False]


@pytest.mark.parametrize("kept_bytes", [0, 1 << 20])
@pytest.mark.parametrize("size", SIZES)
def test_margins_that_an_event_would_need_to_be_judged_are_told_nowhere(size: int, kept_bytes: int) -> None:
    text = "a matches {topic: 's', x: v} with v ^ 0.5 > 0.9; Main = a*;"
    trial = steps_of_100_ms([1.0, 0.25, 1.0, 1.0, 4.0, 9.0, -1.0, 1.0])
    with window_size(size, kept_bytes):
        rejected, open_ = spec(text).watch(trial)
        courses = list(spec(text).margins(trial))

    assert (rejected.verdict, rejected.robustness) == (Verdict.VIOLATED, None)
    assert (open_.verdict, open_.span) == (Verdict.INCONCLUSIVE, Span(0.6, 0.7))
    assert courses == []


@pytest.mark.parametrize("size", SIZES)
def test_how_long_an_event_stands_for_is_known_from_the_next_window(size: int) -> None:
    # Of `s` every 0.1 s, of `t` at 0 s, 0.4 s and 0.9 s: the one at 0.4 s stands for 0.5 s.
    trial = of({"a/r": (np.arange(10) / 10, 5.0), "c/r": ([0.0, 0.4, 0.9], [5.0, 0.5, 5.0])})
    text = "ok matches {x: v} with v >= 1; Main = ok*;"
    sources = {"s": {"x": "a/{robot} [m]"}, "t": {"x": "c/{robot} [m]"}}
    with window_size(size):
        (found,) = RmlSpec(text, sources, max_gap_s=0.6, t_off_s=0.0).watch(trial)

    assert found.span == Span(0.4, 0.9)
    assert found.quantities["time_in_violation_s"] == pytest.approx(0.5)


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_windows_hold_every_event_once_and_those_of_one_time_together(size: int) -> None:
    t = np.arange(20) / 10
    trial = of({"a/r": (t, 1.0), "b/r": (t, 1.0), "c/r": (t[::3], 1.0)})
    with window_size(size):
        recorded = [
            Recorded(name, {name: trial.signals[name]}, trial.window, max_gap_s=0.5)
            for name in ("a/r", "b/r", "c/r")
        ]
        events = Events(recorded)
        parts = [events.part(number) for number in range(events.windows)]

    assert events.windows > 1
    assert len(events) == 47 == sum(len(part.stream) for part in parts)
    ends = [(float(part.stream.t[0]), float(part.stream.t[-1])) for part in parts]
    assert all(before[1] < after[0] for before, after in pairwise(ends))
    assert np.concatenate(list(events.times())).tolist() == t.tolist()


# What is held ----------------------------------------------------------------------------


def held_bytes(monitor: RmlSpec, samples: int) -> int:
    """The most that is held beyond a trial, of which 30 % are rejected in one stretch."""
    trial = of(
        {"a/r": (np.arange(samples) / 100, np.where(np.arange(samples) % samples < 0.3 * samples, 0.5, 2))}
    )
    gc.collect()
    tracemalloc.start()
    try:
        found: list[Finding] = list(monitor.watch(trial))
        assert [f.verdict for f in found] == [Verdict.VIOLATED]
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "text",
    [
        AT_LEAST_1,
        "ok matches {topic: 's', x: v} with v >= 1; any2 matches {topic: 's'}; Main = ((any2) ok*);",
    ],
)
def test_what_is_held_does_not_grow_with_the_trial(text: str) -> None:
    with window_size(1000):
        held_bytes(spec(text), 1000)  # what is loaded once is no matter
        short, long = held_bytes(spec(text), 10_000), held_bytes(spec(text), 40_000)

    assert long - short < 30_000  # one byte for each of 30 000 samples


def test_a_specification_that_binds_data_does_not_hold_the_trial_either() -> None:
    text = "at(z) matches {topic: 's', x: z}; Main = {let z; at(z) at(z)*};"
    assert compile_rml(text).machine().asked(compile_rml(text).machine().start) is None
    with window_size(200):
        held_bytes(spec(text), 200)
        short, long = held_bytes(spec(text), 4000), held_bytes(spec(text), 16_000)

    assert long - short < 48_000  # four bytes for each of 12 000 samples
