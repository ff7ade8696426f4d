"""Specifications watched while events come: the letters of whole traces, the findings of whole trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    Body,
    Event,
    EventMonitor,
    InstantVerdict,
    OnlineMonitor,
    Sample,
    Signal,
    Span,
    Trial,
    Verdict,
    align,
)
from ariac_score.testing import ContractCheck, contract_checks
from ariac_score_ariac.testing import made_trial
from ariac_score_rml import RmlSpec, compile_rml, run_trace
from ariac_score_rml.automaton import watch_by_interpreter
from ariac_score_rml.columns import Stream, Topic

GAP = {"gap": {"d": "centre_distance/{robot}/{human}"}}
BOTH = {**GAP, "arm": {"v": "speed/{robot}"}}
UNITS = {"centre_distance/robot/human": "m", "speed/robot": "m/s"}
BODIES = (Body("human", "human"), Body("robot", "robot"))
AFTER = st.sampled_from(["resume", "restart", "once"])

SPECS = {
    "far": ("ok matches {topic:'gap', d:d} with d >= 2; gap matches {topic:'gap'}; Main = gap >> ok*;", GAP),
    "opened": (
        "open matches {topic:'gap', d:d} with d > 3; touch matches {topic:'gap', d:0.0};"
        "free not matches touch; Main = open free*;",
        GAP,
    ),
    "alternating": (
        "near matches {topic:'gap', d:d} with d < 2; far not matches near; Main = (near far)*;",
        GAP,
    ),
    "bound": ("at(d) matches {topic:'gap', d:d}; Main = {let d; at(d) at(d)* } \\/ any any;", GAP),
    "stops": (
        "near matches {topic:'gap', d:d} with d < 2; gap matches {topic:'gap'}; arm matches {topic:'arm'};"
        "rests matches {topic:'arm', v:v} with v <= 1; Main = (near (gap* rests) | any)*;",
        BOTH,
    ),
    "then all": (
        "far matches {topic:'gap', d:d} with d >= 2; near not matches far; Main = far near all;",
        GAP,
    ),
    "ill typed": ("a matches {topic:t, d:d} with d < 3 || t > 1; Main = a*;", GAP),
}


def trial_of(t: Sequence[float], d: Sequence[float], t_arm: Sequence[float], v: Sequence[float]) -> Trial:
    columns = {"centre_distance/robot/human": (t, d), "speed/robot": (t_arm, v)}
    signals = {n: Signal(n, UNITS[n], np.array(at), np.array(own)) for n, (at, own) in columns.items()}
    span = Span(min(t[0], t_arm[0]), max(t[-1], t_arm[-1]))
    return Trial("t", bodies=BODIES, signals=signals, recorded=span)


def samples(trial: Trial) -> list[Sample]:
    found = [signal.sample(i) for signal in trial.signals.values() for i in range(len(signal))]
    return sorted(found, key=lambda sample: sample.t_s)


@st.composite
def trials(draw: st.DrawFn) -> Trial:
    def times() -> list[float]:
        return sorted(k / 100 for k in draw(st.sets(st.integers(0, 40), min_size=1, max_size=25)))

    t, t_arm = times(), times()
    values = st.sampled_from([0.0, 1.0, 2.0, float(np.nextafter(2.0, 0)), 3.0, 4.0])
    return trial_of(t, [draw(values) for _ in t], t_arm, [draw(values) for _ in t_arm])


def stepped(monitor: RmlSpec, trial: Trial) -> tuple[list[InstantVerdict], list[Any]]:
    watch = monitor.begin(trial.bodies)
    verdicts = [verdict for sample in samples(trial) for verdict in watch.step([sample])]
    return verdicts, list(watch.end(replace(trial, signals={})))


@given(name=st.sampled_from(sorted(SPECS)), trial=trials(), after=AFTER)
@settings(max_examples=80, derandomize=True, deadline=None)
def test_what_is_rejected_in_the_whole_log_is_rejected_when_it_comes(
    name: str, trial: Trial, after: Any
) -> None:
    spec, events = SPECS[name]
    monitor = RmlSpec(spec, events, after_violation=after, max_gap_s=0.05)

    verdicts, found = stepped(monitor, trial)

    assert found == list(monitor.watch(trial))
    topics, reached_s = [], []
    for topic, fields in events.items():
        signals = [trial.signals[text.format(robot="robot", human="human")] for text in fields.values()]
        t, columns = align(signals, max_gap_s=0.05)
        topics.append(Topic(topic, t, dict(zip(fields, columns, strict=True))))
        reached_s.append(min(float(signal.t[-1]) for signal in signals))
    stream = Stream(topics)
    whole = watch_by_interpreter(compile_rml(spec).machine(), stream, after)
    rejected = {
        t
        for t, one, row in zip(stream.t.tolist(), whole.rejected, whole.before, strict=True)
        if one and row >= 0
    }
    known = {t for t in rejected if t <= min(reached_s)}
    assert {s.t_s for s in verdicts if s.verdict is Verdict.VIOLATED} == known
    assert [s.t_s for s in verdicts] == sorted({s.t_s for s in verdicts})
    if whole.error is not None and stream.t[whole.error_at] <= min(reached_s):
        assert (verdicts[-1].verdict, verdicts[-1].final) == (Verdict.INCONCLUSIVE, True)
        assert verdicts[-1].t_s == stream.t[whole.error_at]


def test_an_event_waits_for_the_other_topics_and_no_longer() -> None:
    monitor = RmlSpec(*SPECS["stops"])
    watch = monitor.begin(BODIES)
    gap = [Sample("centre_distance/robot/human", t, 1.0, "m") for t in (0.0, 0.02)]
    arm = [Sample("speed/robot", t, 3.0, "m/s") for t in (0.01, 0.02)]

    assert [s.t_s for s in watch.step([gap[0]])] == []
    assert [s.t_s for s in watch.step([arm[0]])] == [0.0]
    assert [s.t_s for s in watch.step([gap[1]])] == [0.01]
    assert [s.t_s for s in watch.step([arm[1]])] == [0.02]  # both of that time, spoken of once


def test_a_rejection_says_what_the_event_is_not_and_what_is_open_is_unknown() -> None:
    t = [0.0, 0.01, 0.02]
    verdicts, _ = stepped(RmlSpec(*SPECS["alternating"]), trial_of(t, [1.0, 1.0, 3.0], t, t))

    assert [(s.verdict, s.message) for s in verdicts] == [
        (Verdict.INCONCLUSIVE, "the specification still asks for something"),
        (Verdict.VIOLATED, "'gap' is rejected: it is no 'far'"),
        (Verdict.SATISFIED, "is accepted"),
    ]


def test_once_and_everything_are_for_good() -> None:
    t = [0.0, 0.01, 0.02, 0.03]
    once, _ = stepped(RmlSpec(*SPECS["far"], after_violation="once"), trial_of(t, [3, 1, 1, 3], t, t))
    everything, _ = stepped(RmlSpec(*SPECS["then all"]), trial_of(t, [3, 1, 3, 0], t, t))

    assert [(s.t_s, s.verdict, s.final) for s in once] == [
        (0.0, Verdict.SATISFIED, False),
        (0.01, Verdict.VIOLATED, True),
    ]
    assert [s.final for s in everything] == [False, True, True, True]


def test_with_the_start_of_the_competition_the_specification_begins_and_with_its_end_it_ends() -> None:
    t = [k / 100 for k in range(6)]
    events = (Event(0.01, COMPETITION_STARTED), Event(0.04, COMPETITION_ENDED))
    trial = replace(trial_of(t, [1.0, 3.0, 1.0, 3.0, 1.0, 3.0], t, t), events=events)
    monitor = RmlSpec(*SPECS["alternating"], t_off_s=0.0)
    watch = monitor.begin(BODIES)
    came = sorted((*events, *samples(trial)), key=lambda item: item.t_s)

    steps = [([], [item]) if isinstance(item, Event) else ([item], []) for item in came]
    verdicts = [s for own, happened in steps for s in watch.step(own, happened)]

    # Far at 0.01 s is no beginning, near at 0.04 s leaves something open: only of the competition.
    assert [(s.t_s, s.verdict.value) for s in verdicts] == [
        (0.0, "inconclusive"),
        (0.01, "violated"),
        (0.02, "inconclusive"),
        (0.03, "satisfied"),
        (0.04, "inconclusive"),
    ]
    assert [f.span.start_s for f in monitor.watch(trial) if f.span] == [0.01, 0.04]


def test_there_is_no_verdict_without_a_specification_events_or_bodies() -> None:
    sample = Sample("centre_distance/robot/human", 0.0, 1.0, "m")
    for monitor, bodies in (
        (RmlSpec(), BODIES),
        (RmlSpec(SPECS["far"][0]), BODIES),
        (RmlSpec(*SPECS["far"]), ()),
    ):
        assert list(monitor.begin(bodies).step([sample])) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["far", "opened", pytest.param("stops", marks=pytest.mark.slow), "ill typed"]
)
def test_it_keeps_the_contract_online(name: str) -> None:
    monitor = RmlSpec(*SPECS[name])
    assert isinstance(monitor, OnlineMonitor)
    online = ("one_by_one", "instant_by_instant", "standings", "nothing_stepped", "repeated_time")
    checks: list[ContractCheck] = [c for c in contract_checks(monitor, made_trial()) if c.name in online]
    assert len(checks) == len(online)
    for check in checks:
        check()


# Events as they are ----------------------------------------------------------------------

WORDS = {
    "T": (Verdict.SATISFIED, True),
    "t": (Verdict.SATISFIED, False),
    "f": (Verdict.VIOLATED, False),
    "F": (Verdict.VIOLATED, True),
}
ITEMS = st.fixed_dictionaries(
    {
        "topic": st.sampled_from(["gap", "arm"]),
        "time": st.floats(0, 9),
        "d": st.sampled_from([0, 1.0, 2, 3.5]),
    },
    optional={"v": st.sampled_from([0.5, 2, "fast", None])},
)


@given(name=st.sampled_from(sorted(SPECS)), events=st.lists(ITEMS, max_size=12))
@settings(max_examples=80, derandomize=True, deadline=None)
def test_every_event_gets_its_letter(name: str, events: list[Any]) -> None:
    spec = SPECS[name][0]
    whole = run_trace(compile_rml(spec).machine(), events)
    watch = RmlSpec(spec, after_violation="once").begin_events()

    for letter, event in zip(whole.letters, events, strict=False):
        if letter == "E":
            with pytest.raises(ValueError, match=r"is the string|no number"):
                watch.take(event)
            return
        verdict = watch.take(event)
        assert (verdict.verdict, verdict.final) == WORDS[letter]
    if whole.letters.endswith("F"):  # and so it stays
        assert {watch.take(event).final for event in events} == {True}


def test_an_event_that_cannot_be_judged_leaves_the_trace_as_it_was() -> None:
    watch = RmlSpec("a matches {n:n} with n > 1; Main = a a any;", after_violation="once").begin_events()

    assert watch.take({"topic": "x", "n": 2}).verdict is Verdict.VIOLATED  # it may not end here
    for bad in ({"topic": "x", "n": "two"}, {"topic": "x", "n": None}):
        with pytest.raises(ValueError, match="'n'"):
            watch.take(bad)
    assert watch.take({"topic": "x", "n": 3}).final is False
    assert watch.take({"topic": "x", "n": 0}).message == "the trace may end here"
    last = watch.take({"service": "y"})
    assert (last.verdict, last.final, last.message) == (Verdict.VIOLATED, True, "'y' is rejected")


def test_after_a_rejection_the_policy_decides() -> None:
    spec = "a matches {n:1}; b matches {n:2}; Main = (a b)*;"
    events = [{"n": n} for n in (1, 1, 2, 1, 2)]

    def verdicts(after: Any) -> list[str]:
        watch = RmlSpec(spec, after_violation=after).begin_events()
        return [watch.take(event).message.split(":")[0] for event in events]

    rejected = "'the event' is rejected"
    open_, ends = "the trace may not end here", "the trace may end here"
    assert verdicts("resume") == [open_, rejected, ends, open_, ends]
    assert verdicts("restart") == [open_, rejected, rejected, open_, ends]
    assert verdicts("once") == [open_, rejected, rejected, rejected, rejected]


def test_a_state_that_grows_without_bound_is_refused_by_its_equation() -> None:
    spec = "a(x) matches {n:x}; Main = ({let x; a(x) Main} | never)?;"
    watch = RmlSpec(spec, max_state=50).begin_events()
    verdicts = []
    for n in range(100):
        try:
            watch.take({"n": n})
        except ValueError as error:
            verdicts.append(str(error))

    assert verdicts
    assert all("'Main'" in words and "grown beyond" in words for words in verdicts)


def test_without_a_specification_no_event_is_judged() -> None:
    assert isinstance(RmlSpec(), EventMonitor)
    with pytest.raises(ValueError, match="no specification"):
        RmlSpec().begin_events()
