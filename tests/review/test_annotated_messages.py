"""What monitors say over time, and the messages that are made of it."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Finding,
    InstantVerdict,
    Measured,
    Result,
    Sample,
    Signal,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    load_result,
    load_rule_set,
    measure_trial,
)
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import PreparedCheck, prepare
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.review.annotate import messages_of
from ariac_score.review.margins import MarginSeries, Moment, tracks
from ariac_score.scoring.ruleset import Check, RuleSet
from ariac_score.trial.clock import Clock
from ariac_score.trial.derive import Derivation, derive_signals

ROOT = Path(__file__).parents[2]
REGISTRY = Registry()
RULES = load_rule_set(str(ROOT / "examples/all_monitors.yaml"))
SATISFIED, VIOLATED, INCONCLUSIVE = Verdict.SATISFIED, Verdict.VIOLATED, Verdict.INCONCLUSIVE


@cache
def example() -> Result:
    return load_result(ROOT / "tests/data/as_published/kitting_near_miss.result.json")


NOTHING: Measured = replace(example().measured, findings={})


def rules_of(*uses: str, **parameters: Any) -> RuleSet:
    """Some monitors, each by its name."""
    checks = {use: Check(use, use, "ariac_score.monitors", parameters) for use in uses}
    return replace(RULES, checks=checks)


def found_of(trial: Trial, rules: RuleSet) -> tuple[Result, Trial, list[MarginSeries]]:
    """What monitors find, and what they say over time."""
    prepared = prepare(rules, registry=REGISTRY)
    trial = prepared.derived(trial)
    measured = measure_trial(trial, prepared)
    result = replace(example(), measured=measured)
    return result, trial, tracks(result, trial, prepared)


def at_once(number: int) -> Any:
    """So many messages are made before the first is written."""
    return patch.object(sys.modules["ariac_score.review.annotate"], "AT_ONCE", number)


# What is written -----------------------------------------------------------------------


def test_what_is_undecided_stands_where_samples_lack() -> None:
    # Contact at 0.3 m or nearer. Nothing before 0.5 s, between 0.7 s and 1.5 s, and after 1.7 s.
    t = np.array([0.5, 0.6, 0.7, 1.5, 1.6, 1.7])
    signals = {"separation/r/h": Signal("separation/r/h", "m", t, np.array([0.5, 0.25, 0.5, 0.5, 0.5, 0.75]))}
    bodies = Body("r", "robot"), Body("h", "human")
    trial = Trial("t", bodies=bodies, signals=signals, recorded=Span(0.0, 2.0))
    rules = rules_of("ariac.human_contact", max_gap_s=0.15, contact_distance_m=0.3, t_off_s=0.0)

    _, _, (track,) = found_of(trial, rules)
    said = track.moments

    assert [(m.t_s, m.verdict, m.margin) for m in said] == [
        (0.0, INCONCLUSIVE, None),
        (0.5, SATISFIED, pytest.approx(0.2)),
        (0.6, VIOLATED, pytest.approx(-0.05)),
        (0.7, SATISFIED, pytest.approx(0.2)),
        (0.7 + 1e-9, INCONCLUSIVE, None),
        (1.5, SATISFIED, pytest.approx(0.2)),
        (1.6, SATISFIED, pytest.approx(0.2)),
        (1.7, SATISFIED, pytest.approx(0.45)),
        (1.7 + 1e-9, INCONCLUSIVE, None),
    ]
    assert [m.message for m in said if m.margin is not None] == [
        "separation 0.500 m (at least 0.300)",
        "separation 0.250 m (at least 0.300)",
        "separation 0.500 m (at least 0.300)",
        "",
        "",
        "",
    ]
    told = [
        m.message.partition("; a violation was possible in it, for 0 to ") for m in said if m.margin is None
    ]
    assert [lacking for lacking, _, _ in told] == [
        "no samples for 0.500 s, from 0.000 s",
        "no samples for 0.800 s, from 0.700 s",
        "no samples for 0.300 s, from 1.700 s",
    ]
    # Both come nearer by at most 4 + 5 m/s: it takes 0.2/9 s from 0.5 m to 0.3 m, 0.45/9 s from 0.75 m.
    # Nothing is safe before a sample: one that is missing would have stood until then.
    longest_s = [float(possible.removesuffix(" s")) for _, _, possible in told]
    assert longest_s == pytest.approx([0.5, 0.8 - 0.2 / 9, 0.3 - 0.45 / 9], abs=0.005)


class Limited:
    """No faster than 1 m/s, as a monitor that says so of every sample and tells no margins."""

    def needs(self) -> Iterator[SignalNeed]:
        yield SignalNeed("speed", "m/s", 0.15)

    def watch(self, _trial: Trial) -> Iterator[Finding]:
        yield Finding.satisfied("r", "as fast as it is")

    def begin(self, _bodies: Sequence[Body] = ()) -> Limited:
        return self

    def step(self, samples: Sequence[Sample], _events: object = ()) -> Iterator[InstantVerdict]:
        for sample in samples:
            if sample.signal == "speed/r":
                margin = 1.0 - float(np.max(sample.value))
                verdict = SATISFIED if margin >= 0 else VIOLATED
                yield InstantVerdict("r", sample.t_s, verdict, f"{sample.value} m/s", margin, sample.unit)

    def end(self, trial: Trial) -> Iterator[Finding]:
        return self.watch(trial)


def limited(trial: Trial) -> list[MarginSeries]:
    plugin = REGISTRY.find("ariac_score.monitors", "ariac.human_contact")
    limited = PreparedCheck("limited", plugin, Limited(), ())
    rules = replace(prepare("paper2020.published", registry=REGISTRY), checks={"limited": limited})
    derived = derive_signals(trial, [Derivation("speed", 0.15)])
    return tracks(replace(example(), measured=NOTHING), derived, rules)


def test_a_monitor_that_watches_online_is_asked_about_every_instant() -> None:
    t = np.arange(6) / 10
    speed = Signal("speed/r", "m/s", t, np.array([0.5, 1.0, 1.5, 1.25, 0.75, 3.0]))
    other = Signal("speed/h", "m/s", t + 0.05, np.full(6, 9.0))
    trial = Trial("t", signals={"speed/r": speed, "speed/h": other}, recorded=Span(0.1, 0.4))

    (track,) = limited(trial)

    assert (track.check, track.subject, track.unit, track.sampled) == ("limited", "r", "m/s", True)
    assert track.moments == (
        Moment(0.1, SATISFIED, 0.0, "1.0 m/s"),
        Moment(0.2, VIOLATED, -0.5, "1.5 m/s"),
        Moment(0.3, VIOLATED, -0.25),
        Moment(0.4, SATISFIED, 0.25, "0.75 m/s"),
    )


MOMENTS = st.lists(
    st.tuples(
        st.sampled_from([0, 1, 3, 1_000_000_000]),  # ns after the one before
        st.sampled_from([SATISFIED, VIOLATED, INCONCLUSIVE, Verdict.NOT_APPLICABLE, None]),
        st.sampled_from([None, 0.0, -0.0, 1.5, -1e-300, math.inf, -math.inf]),
        st.sampled_from(["", "", "", "too near", "a\nb", "größer", "\ud800", "x" * 2000]),
    ),
    max_size=12,
)


def track_of(number: int, steps: Sequence[tuple[int, Verdict | None, float | None, str]]) -> MarginSeries:
    times_ns = np.cumsum([step for step, *_ in steps]).tolist()
    moments = (Moment(t_ns / 1e9, *said) for t_ns, (_, *said) in zip(times_ns, steps, strict=True))
    return MarginSeries.of(f"c{number}", "r/h", "m" * number, list(moments))


@settings(max_examples=60, derandomize=True, deadline=None)
@given(st.lists(MOMENTS, max_size=4), st.sampled_from([1, 4, 50_000]))
def test_messages_are_in_order_of_time_then_of_topic(made: list[Any], number: int) -> None:
    found = [track_of(k, steps) for k, steps in enumerate(made)]
    nothing = replace(example(), measured=NOTHING)
    trial = Trial("t", clocks=(Clock("log time", 5),))

    with at_once(number):
        messages = list(messages_of(nothing, trial, found, frame="world"))

    expected = [
        (round(moment.t_s * 1e9) + 5, f"/ariac_score/c{k}/r/h", payload(track, moment))
        for k, track in enumerate(found)
        for moment in track.moments
    ]
    states = [(m.t_ns, m.topic, m.payload) for m in messages if m.topic != "/ariac_score/log"]
    assert states == sorted(expected, key=lambda one: one[:2])
    assert [(m.t_ns, m.topic) for m in messages] == sorted((m.t_ns, m.topic) for m in messages)


def payload(track: MarginSeries, moment: Moment) -> bytes:
    """As rosbags serializes one message."""
    store = bundled_typestore(2)
    kinds: Any = store.types
    t_ns = round(moment.t_s * 1e9) + 5
    at = kinds["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
    numbers = {SATISFIED: 0, VIOLATED: 1, INCONCLUSIVE: 2, Verdict.NOT_APPLICABLE: 3, None: 4}
    state = kinds["ariac_score_msgs/msg/MonitorState"](
        header=kinds["std_msgs/msg/Header"](stamp=at, frame_id="world"),
        check=track.check,
        subject=track.subject,
        state=numbers[moment.verdict],
        margin=math.nan if moment.margin is None else moment.margin,
        unit=track.unit,
        message=moment.message.replace("\n", " ").replace("\ud800", " ")[:1000],
    )
    return bytes(store.serialize_cdr(state, "ariac_score_msgs/msg/MonitorState", little_endian=True))


def test_a_margin_that_is_another_nan_is_written_as_any_nan() -> None:
    negative = float(np.copysign(np.nan, -1.0))
    plain, other = (track_of(0, [(0, None, margin, "")]) for margin in (None, negative))

    (one,), (two,) = (
        [m.payload for m in messages_of(example(), Trial("t"), [track], frame="") if m.topic.endswith("r/h")]
        for track in (plain, other)
    )
    assert one == two
