"""What a log leaves open about a subject: the findings of the best and of the worst world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.monitors.broken_bounds import broken_bounds
from ariac_score.monitors.cells import cells_of
from ariac_score.monitors.monitor import SubjectMonitor
from ariac_score.monitors.unseen import Unseen
from ariac_score.trial.bounds import BetweenSamples, between_samples
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.clock import Clock
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.work import Item
from ariac_score_ariac.safety import HumanContact
from ariac_score_standards import Always, PflContact, SpaceLimit, SsmSeparation
from ariac_score_stl.formula import StlFormula

STATED = {
    "human": {"max_speed_m_s": 0.6, "source": "walks"},
    "robot": {"max_speed_m_s": 0.4, "source": "its rail"},
}
"""Together 1 m/s, as in the worked cases."""


def trial(
    distance_m: Mapping[float, float],
    *,
    stated: Mapping[str, Any] = STATED,
    every: bool = False,
    ended: bool = True,
    rate_hz: float = 0.0,
) -> Trial:
    """A robot and a human whose distance was sampled at some times."""
    t = np.array([*distance_m], dtype=np.float64)
    signal = Signal(
        "separation/arm/ann", "m", t, np.array([*distance_m.values()]), "/scanner", stated_rate_hz=rate_hz
    )
    ends = [Event(float(t[-1]), COMPETITION_ENDED)] if ended else []
    return Trial(
        "t",
        bodies=(Body("arm", "robot", 0.0), Body("ann", "human", 0.0)),
        signals={signal.name: signal},
        events=(Event(float(t[0]), COMPETITION_STARTED), *ends),
        recorded=Span(float(t[0]), float(t[-1])),
        between=between_samples({}, stated, every=every),
    )


def sampled(before_m: float, after_m: float, gap_s: float) -> dict[float, float]:
    """At 100 Hz, still, for a second before and after a gap."""
    first = {round(0.01 * k, 9): before_m for k in range(101)}
    return first | {round(1.0 + gap_s + 0.01 * k, 9): after_m for k in range(101)}


def found(monitor: SubjectMonitor, given: Trial) -> tuple[list[Finding], list[Worlds]]:
    """What a monitor finds, and what it leaves open."""
    everything = list(monitor.watch_worlds(given))
    return (
        [one for one in everything if isinstance(one, Finding)],
        [one for one in everything if isinstance(one, Worlds)],
    )


NEARER_THAN_1_M = Always(
    holds="d >= 1", signals={"d": "separation/{robot}/{human}"}, unit="m", max_gap_s=0.05, t_off_s=0.0
)


def of_gap(findings: tuple[Finding, ...], quantity: str) -> float:
    """The sum of a quantity over violations."""
    return sum(f.quantities[quantity] for f in findings if f.verdict is Verdict.VIOLATED)


# Worked by hand: both samples, the gap, the closing speed and the limit; then what is least and most of
# time, depth and integral. G1 to G9 of the collection, whose numbers random paths never left.
WORKED: Mapping[str, tuple[tuple[float, float, float, float, float], tuple[tuple[float, float], ...]]] = {
    "G1": ((2, 2, 1, 1.6, 1), ((0, 0), (0, 0), (0, 0))),
    "G2": ((3, 2, 2, 2, 1), ((0, 0.5), (0, 0.5), (0, 0.125))),
    "G3": ((1, 1, 2, 1.5, 1), ((0, 2), (0, 1), (0, 4 / 3))),
    "G5, one path": ((4, 1, 1, 3, 2), ((1 / 3,) * 2, (1, 1), (1 / 6,) * 2)),
    "G6": ((2, 2, 3, 1, 1), ((0, 1), (0, 0.5), (0, 0.25))),
    "G7": ((0.5, 0.5, 3, 1, 1), ((1, 3), (0.5, 1), (0.25, 2.75))),
    "G8": ((0.4, 2, 3, 1, 1), ((0.6, 2), (0.6, 1), (0.18, 1.42))),
    "G9, known safe": ((1.2, 1.2, 0.3, 1, 1), ((0, 0), (0, 0), (0, 0))),
}


def near(limit_m: float, **parameters: float) -> SubjectMonitor:
    """Of being nearer than a limit."""
    return replace(NEARER_THAN_1_M, holds=f"d >= {limit_m:g}", **parameters)


def by(closing_m_s: float) -> Mapping[str, Any]:
    """Bounds with that closing speed of both together."""
    return {
        "human": {"max_speed_m_s": closing_m_s, "source": "walks"},
        "robot": {"max_speed_m_s": 0.0, "source": "bolted down"},
    }


@pytest.mark.parametrize("case", WORKED)
def test_both_worlds_have_the_time_depth_and_integral_of_the_worked_cases(case: str) -> None:
    """Around the gap both stand still for a second; cells, and samples that stand, make both ends wider."""
    (before, after, gap_s, closing, limit), (time_s, depth_m, integral) = WORKED[case]
    findings, opened = found(near(limit), trial(sampled(before, after, gap_s), stated=by(closing)))
    best, worst = (opened[0].best, opened[0].worst) if opened else (tuple(findings),) * 2
    around = [max(limit - one, 0.0) for one in (before, after)]

    for quantity, ends, still in (
        ("time_in_violation_s", time_s, sum(one > 0 for one in around)),
        ("depth_integral_m_s", integral, sum(around)),
    ):
        wider = 0.01 + 0.015  # of cells, and of how long a sample at 100 Hz stands at most
        assert ends[0] + still - wider <= of_gap(best, quantity) <= ends[0] + still + 1e-6
        assert ends[1] + still - 1e-6 <= of_gap(worst, quantity) <= ends[1] + still + wider
    for found_in, deepest in ((best, depth_m[0]), (worst, depth_m[1])):
        depths = [f.quantities["depth_max_m"] for f in found_in if f.verdict is Verdict.VIOLATED]
        assert max(depths, default=0.0) == pytest.approx(max(deepest, *around), abs=0.01)
    if case.startswith("G9"):  # the worst margin stands for it, and no sample shows it
        assert (opened, findings[0].evidence) == ([], ())
        assert findings[0].robustness == pytest.approx(0.05, abs=0.01)


@pytest.mark.parametrize(("off_m", "is_open"), [(0.005, True), (0.015, False)])
def test_the_last_sample_before_a_stated_end_hides_none_that_came_after_it(
    off_m: float, is_open: bool
) -> None:
    """12 ms before the end, at 1 m/s: one left out in between may have said less."""
    given = trial({round(0.01 * k, 9): 1.0 + off_m for k in range(101)}, ended=False)
    events = (*given.events, Event(1.012, COMPETITION_ENDED))

    _, opened = found(NEARER_THAN_1_M, replace(given, events=events, recorded=Span(0.0, 1.012)))

    assert [of_gap(one.worst, "time_in_violation_s") > 0.0 for one in opened] == [True] * is_open


def test_g4_samples_that_no_body_so_slow_could_have_made_are_named() -> None:
    """4 m in a second, where 3 m/s are the most."""
    given = trial(sampled(5.0, 1.0, 1.0), stated=by(3.0))
    assert given.between is not None
    broken = broken_bounds(given, given.between)

    assert broken is not None
    assert (broken.needed, broken.bound, broken.t_s) == (pytest.approx(4.0), 3.0, 2.0)


@pytest.mark.parametrize(("pause_s", "most"), [(0.4, 5), (1.0, 2)])
def test_g20_a_gap_holds_as_many_violations_as_pauses_fit_into_it(pause_s: float, most: int) -> None:
    """Both samples 0.1 m beyond the limit, and 2 s: nearer from 0.1 to 1.9 s at most; at best not once."""
    (worlds,) = found(near(1.0, t_off_s=pause_s), trial(sampled(1.1, 1.1, 2.0), stated=by(1.0)))[1]

    assert [f.verdict for f in worlds.best] == [Verdict.SATISFIED]
    assert len([f for f in worlds.worst if f.verdict is Verdict.VIOLATED]) == most


def test_a_hiccup_far_away_leaves_nothing_open_and_one_nearby_says_how_long() -> None:
    contact = HumanContact()
    safe, opened = found(contact, trial(sampled(3.0, 3.0, 0.06)))
    near, (worlds,) = found(contact, trial(sampled(0.02, 0.02, 0.06)))

    assert ([one.verdict for one in safe], opened) == ([Verdict.SATISFIED], [])
    assert [one.verdict for one in near] == [Verdict.INCONCLUSIVE]
    assert "a violation was possible in it, for 0 to 0.0" in near[0].message
    assert worlds.causes[0].text == "a gap of 60 ms on /scanner"
    assert [one.critical for one in worlds.worst] == [True]


def test_three_samples_cut_out_of_100_hz_are_a_gap_though_it_is_shorter_than_the_longest_accepted() -> None:
    """The robot touches for 20 ms; without the samples that show it, the worst world still has it."""
    touching = {t: 0.0 if 0.5 < t < 0.53 else 0.01 for t in (round(0.01 * k, 9) for k in range(101))}
    cut = {t: d for t, d in touching.items() if d > 0.0}

    assert [f.verdict for f in found(HumanContact(), trial(touching))[0]] == [Verdict.VIOLATED]
    _, (worlds,) = found(HumanContact(), trial(cut))
    assert [f.verdict for f in worlds.worst] == [Verdict.VIOLATED]
    assert [f.verdict for f in worlds.best] == [Verdict.SATISFIED]


def test_a_regular_recording_with_jitter_has_no_gaps_at_any_rate(subtests: pytest.Subtests) -> None:
    random = np.random.default_rng(1)
    for rate_hz in (10.0, 30.0, 100.0):
        with subtests.test(f"{rate_hz:g} Hz"):
            times = (np.arange(60) + random.uniform(-0.12, 0.12, size=60)) / rate_hz
            findings, opened = found(HumanContact(max_gap_s=0.15), trial(dict.fromkeys(times.tolist(), 0.02)))
            assert ([one.verdict for one in findings], opened) == ([Verdict.SATISFIED], [])


def test_every_interval_is_bounded_where_the_rules_ask_for_it() -> None:
    still = dict.fromkeys((round(0.01 * k, 9) for k in range(101)), 0.004)

    assert found(HumanContact(), trial(still))[1] == []
    (worlds,) = found(HumanContact(), trial(still, every=True))[1]
    assert [one.verdict for one in worlds.worst] == [Verdict.VIOLATED]


@pytest.mark.parametrize(("rate_hz", "gaps"), [(100.0, 50), (74.0, 0), (76.0, 50), (50.0, 0), (0.0, 0)])
def test_every_second_sample_left_out_is_a_gap_where_a_rate_is_stated(rate_hz: float, gaps: int) -> None:
    """At 20 ms: a gap is longer than 1.5 intervals, so of 13.3 ms at 75 Hz."""
    thinned = {round(0.02 * k, 9): 0.004 for k in range(51)}

    opened = found(HumanContact(), trial(thinned, rate_hz=rate_hz))[1]

    assert [cause.text for one in opened for cause in one.causes] == (
        [f"{gaps} gaps of 20 ms on /scanner, which is published every {1000 / rate_hz:g} ms"] if gaps else []
    )


@pytest.mark.parametrize(("lacking", "gaps"), [(0, 0), (25, 0), (26, 50), (51, 50)])
def test_every_interval_is_a_gap_where_the_log_lacks_half_as_many_samples_as_it_has(
    lacking: int, gaps: int
) -> None:
    """Of 51 samples at 20 ms: those that its recorder received were 13.3 ms apart if 25.5 are missing."""
    kept = trial({round(0.02 * k, 9): 0.004 for k in range(51)})
    of = replace(kept, between=replace(kept.between, lacking={"/scanner": lacking, "/another": 500}))

    opened = found(HumanContact(), of)[1]

    assert [cause.text for one in opened for cause in one.causes] == (
        [f"{gaps} gaps of 20 ms on /scanner"] if gaps else []
    )


@pytest.mark.parametrize("earlier_ns", [398_153, 123_456_789, 5_000_000_001])
def test_where_a_recording_begins_moves_no_bound(earlier_ns: int) -> None:
    """A message that nobody reads came first: all times are later, and the zero of their clock earlier."""
    first_ns = 1_795_333_995_851_545_590
    gap = trial(sampled(2.0, 2.0, 3.0))
    later_s = earlier_ns / 1e9
    (signal,) = gap.signals.values()
    moved = replace(
        gap,
        signals={signal.name: replace(signal, t=signal.t + later_s)},
        events=tuple(replace(one, t_s=one.t_s + later_s) for one in gap.events),
        recorded=Span(later_s, 5.0 + later_s),
    )

    for quantity in ("time_in_violation_s", "depth_integral_m_s"):
        most = [
            of_gap(worlds.worst, quantity)
            for one, zero_ns in ((gap, first_ns), (moved, first_ns - earlier_ns))
            for worlds in found(NEARER_THAN_1_M, replace(one, clocks=(Clock("log time", zero_ns),)))[1]
        ]
        assert most[0] == pytest.approx(most[1], abs=1e-9)
        assert most[0] > 0.0


def test_leaving_samples_out_never_makes_the_worst_world_better() -> None:
    random = np.random.default_rng(3)
    for _ in range(10):
        steps = np.cumsum(random.uniform(-0.01, 0.01, size=300))
        walked = {round(0.01 * k, 9): float(d) for k, d in enumerate(np.abs(1.0 + steps))}
        fewer = {t: d for t, d in walked.items() if t in (0.0, 2.99) or random.random() > 0.3}
        whole, robbed = (found(NEARER_THAN_1_M, trial(one)) for one in (walked, fewer))
        worst = robbed[1][0].worst if robbed[1] else tuple(robbed[0])

        for quantity in ("time_in_violation_s", "depth_integral_m_s"):
            assert of_gap(tuple(whole[0]), quantity) <= of_gap(worst, quantity) + 1e-9
        assert len([f for f in whole[0] if f.verdict is Verdict.VIOLATED]) <= len(worst)


def test_the_worst_world_of_fewer_samples_has_no_less_of_anything_than_that_of_more() -> None:
    """Whatever an adversary leaves out, with every interval bounded: to the last digit, not nearly."""
    random = np.random.default_rng(4)
    for _ in range(4):
        steps = np.cumsum(random.uniform(-0.01, 0.01, size=40))
        times = np.cumsum(random.uniform(0.01, 0.09, size=40))
        more = dict(zip(times.tolist(), np.abs(1.0 + steps).tolist(), strict=True))
        fewer = {t: d for t, d in more.items() if t in (times[0], times[-1]) or random.random() > 0.4}
        both = [found(NEARER_THAN_1_M, trial(one, every=True)) for one in (more, fewer)]
        honest, robbed = (opened[0].worst if opened else tuple(findings) for findings, opened in both)

        for quantity in ("time_in_violation_s", "depth_integral_m_s"):
            assert of_gap(honest, quantity) <= of_gap(robbed, quantity) + 1e-12


def test_violations_that_may_be_one_or_several_are_counted_both_ways() -> None:
    """Nearer than 1 m before and after 3 s without samples, with pauses of a second: 1 to 3 violations."""
    monitor = replace(NEARER_THAN_1_M, t_off_s=1.0)
    _, (worlds,) = found(monitor, trial(sampled(0.9, 0.9, 3.0)))
    counts = [sum(one.verdict is Verdict.VIOLATED for one in world) for world in (worlds.best, worlds.worst)]

    assert counts == [1, 3]
    assert not worlds.tight
    assert of_gap(worlds.best, "time_in_violation_s") == pytest.approx(2.0 + 0.2, abs=0.03)


def test_a_monitor_that_does_not_say_what_is_worse_has_its_limit_broken_in_all_of_a_gap() -> None:
    place = Signal("position/arm", "m", np.array([0.0, 0.01, 0.51, 0.52]), np.zeros((4, 3)), "/arm")
    given = trial({0.0: 1.0, 0.52: 1.0})
    given = replace(given, signals={place.name: place})

    _, (worlds,) = found(SpaceLimit(box_high_m=(1.0, 1.0, 1.0)), given)

    assert [one.verdict for one in worlds.best] == [Verdict.SATISFIED]
    (broken,) = worlds.worst
    assert (broken.span, broken.robustness) == (Span(0.01, 0.51), None)
    assert broken.quantities == {
        "time_in_violation_s": 0.5,
        "relative_depth_max": 1.0,
        "relative_depth_integral_s": 0.5,
    }


@pytest.mark.parametrize(("left_out", "open_s"), [(0, 0.0), (1, 0.02), (4, 0.05)])
def test_what_nothing_bounds_may_have_been_in_every_gap_that_is_longer_than_usual(
    left_out: int, open_s: float
) -> None:
    """The monitor accepts 50 ms; at 100 Hz one message that is missing shows all the same."""
    t = np.arange(201) / 100
    t = np.delete(t, np.arange(100, 100 + left_out))
    place = Signal("position/arm", "m", t, np.zeros((len(t), 3)), "/poses")
    given = replace(trial({0.0: 1.0, 2.0: 1.0}), signals={place.name: place})

    _, opened = found(SpaceLimit(box_high_m=(1.0, 1.0, 1.0), max_gap_s=0.05), given)

    assert sum(of_gap(one.worst, "time_in_violation_s") for one in opened) == pytest.approx(open_s, abs=1e-6)
    assert not any(of_gap(one.best, "time_in_violation_s") for one in opened)


def test_a_gap_of_a_speed_leaves_a_measured_distance_as_uncertain_as_it_is() -> None:
    """Measured 0.77 m, wrong by up to 5 cm; 0.78 m required, by 0.6 m/s for 0.5 s, of a robot at rest."""
    t = np.arange(201) / 100
    still, walks = np.zeros(len(t)), np.full(len(t), 0.6)
    given = trial(dict.fromkeys(t.tolist(), 0.77), stated={**STATED, "distance_error_m": 0.05})
    (distance,) = given.signals.values()
    seen = np.delete(np.arange(len(t)), np.arange(100, 120))
    signals = (
        replace(distance, name="centre_distance/arm/ann"),
        Signal("speed/ann", "m/s", t, walks, "/scanner"),
        Signal("speed/arm", "m/s", t[seen], still[seen], "/arm"),
    )
    given = replace(given, signals={one.name: one for one in signals})

    _, (worlds,) = found(
        SsmSeparation(profile="seed", t1_s=0.2, t2_s=0.3, delta_m=0.48, max_gap_s=0.05), given
    )

    assert of_gap(worlds.best, "time_in_violation_s") == 0.0
    assert of_gap(worlds.worst, "time_in_violation_s") == pytest.approx(0.2, abs=0.03)


def test_a_missing_signal_or_end_leaves_the_whole_competition_open(subtests: pytest.Subtests) -> None:
    for words, given in (
        ("signal", replace(trial({0.0: 3.0, 2.0: 3.0}), signals={})),
        ("end", trial(dict.fromkeys((0.02 * k for k in range(101)), 3.0), ended=False)),
    ):
        with subtests.test(words):
            findings, (worlds,) = found(HumanContact(), given)
            assert Verdict.INCONCLUSIVE in [one.verdict for one in findings]
            assert [one.verdict for one in worlds.best] == [Verdict.SATISFIED]
            assert worlds.worst[0].quantities["time_in_violation_s"] == pytest.approx(2.0)
            assert worlds.worst[0].critical


def test_a_recording_of_one_sample_without_an_end_has_what_it_shows() -> None:
    findings, (worlds,) = found(NEARER_THAN_1_M, trial({1.0: 0.5}, ended=False))

    assert [one.verdict for one in findings] == [Verdict.INCONCLUSIVE, Verdict.VIOLATED]
    assert [one.verdict for one in worlds.worst] == [Verdict.VIOLATED]
    assert of_gap(worlds.worst, "time_in_violation_s") == 0.0


def test_places_bound_a_distance_that_follows_from_them() -> None:
    """G17: a human who walks past in a straight line at her greatest speed was never nearer than 1 m."""
    t = np.array([0.0, 2.0])
    places = {
        "arm": np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0]]),
        "ann": np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]),
    }
    signals = {f"position/{body}": Signal(f"position/{body}", "m", t, at) for body, at in places.items()}
    stated = {
        "human": {"max_speed_m_s": 1.0, "source": "walks"},
        "robot": {"max_speed_m_s": 0.0, "source": "bolted down"},
    }
    given = replace(trial({0.0: 1.0, 2.0: 1.0}, stated=stated), signals=signals)
    given = derive_signals(given, [Derivation("separation", 0.05)])
    findings, opened = found(HumanContact(contact_distance_m=0.9), given)

    assert ([one.verdict for one in findings], opened) == ([Verdict.SATISFIED], [])
    assert [f.verdict for f in found(HumanContact(contact_distance_m=1.1), given)[1][0].best] == [
        Verdict.VIOLATED
    ]


def moved(stated: Mapping[str, Any], tracks: Mapping[str, tuple[Any, Any]]) -> Trial:
    """A robot and a human by their positions, each with its times."""
    signals = {
        f"position/{body}": Signal(f"position/{body}", "m", t, at, f"/{body}")
        for body, (t, at) in tracks.items()
    }
    last_s = float(max(t[-1] for t, _ in tracks.values()))
    given = replace(trial({0.0: 1.0, last_s: 1.0}, stated=stated, every=True), signals=signals)
    return derive_signals(given, [Derivation("separation", 5.0), Derivation("speed", 5.0)])


@pytest.mark.parametrize(
    ("case", "gap_s", "top_m_s", "change_m_s2", "at_rest", "nearest_m"),
    [
        ("G12, an acceleration alone: 2 - 2/8", 1.0, 9.0, 2.0, False, 1.75),
        ("G13, at rest at both ends: 2 - 2/16", 1.0, 9.0, 2.0, True, 1.875),
        ("G14, the same, and a top speed: 2 - 0.5 + 0.25/4", 2.0, 0.5, 4.0, True, 1.5625),
        ("G15, a top speed, and any speed at both ends: 2 - 0.5 + 0.125", 2.0, 0.5, 1.0, False, 1.625),
        ("G15 by its speed alone", 2.0, 0.5, None, False, 1.5),
        ("speed alone allows contact", 1.0, 9.0, None, False, 0.0),
    ],
)
def test_speed_acceleration_and_rest_bound_how_far_a_body_leaves_its_place(
    case: str, gap_s: float, top_m_s: float, change_m_s2: float | None, at_rest: bool, nearest_m: float
) -> None:
    """2 m apart before and after a gap; by hand, as in the collection."""
    t, still = np.array([0.0, gap_s]), np.zeros((2, 3))
    change = {} if change_m_s2 is None else {"max_acceleration_m_s2": change_m_s2}
    stated = {**by(top_m_s), "human": {"max_speed_m_s": top_m_s, "source": "runs", **change}}
    # Not along an axis: no direction is another than any.
    ann = still + 2.0 * np.array([0.6, 0.8, 0.0])
    given = moved(stated, {"arm": (t, still), "ann": (t, ann)})
    if at_rest:
        speed = Signal("speed/ann", "m/s", t, np.zeros(2), "/ann")
        given = replace(given, signals={**given.signals, "speed/ann": speed})

    findings, opened = found(HumanContact(contact_distance_m=0.5), given)

    worst = opened[0].worst if opened else findings
    nearest = 0.5 + min(f.robustness for f in worst if f.robustness is not None)
    assert nearest_m - 0.005 <= nearest <= nearest_m + 1e-6, case


@pytest.mark.parametrize("error_s", [0.0, 0.02])
def test_no_drive_within_its_bounds_is_anywhere_but_where_they_say(error_s: float) -> None:
    """Two bodies with drawn accelerations, sampled now and then with stamps that may be wrong."""
    random = np.random.default_rng(12)
    step_s, fastest, change = 0.001, 1.2, 3.0
    stated: dict[str, Any] = {
        kind: {"max_speed_m_s": fastest, "max_acceleration_m_s2": change, "source": "drawn"}
        for kind in ("human", "robot")
    }
    for _ in range(5):
        steps, t = 2000, np.arange(2000) * step_s
        tracks, ways = {}, {}
        for body in ("arm", "ann"):
            pushes = np.repeat(random.uniform(-1, 1, size=(steps // 100, 2)), 100, axis=0)
            pushes *= change / np.sqrt(2)
            speeds = np.cumsum(pushes * step_s, axis=0)
            speeds /= np.maximum(np.abs(speeds).max() * np.sqrt(2) / fastest, 1.0)
            ways[body] = np.column_stack(
                [np.cumsum(speeds * step_s, axis=0) + random.normal(size=2), np.zeros(steps)]
            )
            rows = np.unique(np.concatenate([[0, steps - 1], random.integers(0, steps, size=6)]))
            late = np.maximum.accumulate(t[rows] + random.uniform(-error_s, error_s, size=len(rows)))
            kept = np.append(np.diff(late) > 0, True)
            tracks[body] = late[kept], ways[body][rows][kept]
        given = moved({**stated, "time_error_s": error_s}, tracks)
        window, between_ = given.window, given.between
        assert window is not None
        assert between_ is not None
        unseen = Unseen(given, between_, window, 0.05)
        driven = {
            f"speed/{body}": np.linalg.norm(np.gradient(way, step_s, axis=0), axis=1)
            for body, way in ways.items()
        }
        driven["separation/arm/ann"] = np.linalg.norm(ways["arm"] - ways["ann"], axis=1)
        for name, true in driven.items():
            signal = given.signals[name]
            cells = cells_of(window, [signal.t], unseen.streams(signal), 2 * fastest)
            (both,) = unseen.bounds([signal], cells)
            assert both is not None
            # At its instant the sample of a place stands for itself; how fast it was there is not known.
            lasting = (cells.end - cells.t > 1e-6) | name.startswith("speed/")
            was = np.interp(cells.t, t, true)
            assert (both[0] <= was + 5e-3)[lasting].all()
            assert (was <= both[1] + 5e-3)[lasting].all()


def test_speeds_between_samples_are_bounded_by_speed_and_acceleration() -> None:
    """The requirement grows with speeds that nobody saw: 2.6 m at rest, and 0.5 s x 0.5 m/s2 x 2.5 s more."""
    t = np.array([0.0, 0.01, 0.02, 0.03, 1.03, 1.04, 1.05])
    columns = {"centre_distance/arm/ann": np.full(7, 4.0), "speed/ann": np.zeros(7), "speed/arm": np.zeros(7)}
    units = ("m", "m/s", "m/s")
    signals = {n: Signal(n, u, t, v) for (n, v), u in zip(columns.items(), units, strict=True)}

    def margin(**acceleration: float) -> float:
        stated = {
            "human": {"max_speed_m_s": 0.6, "source": "walks", **acceleration},
            "robot": {"max_speed_m_s": 0.0, "source": "bolted down"},
        }
        given = replace(trial({0.0: 4.0, 1.05: 4.0}, stated=stated), signals=signals)
        findings, opened = found(SsmSeparation(), given)
        worst = opened[0].worst if opened else findings
        return min(f.robustness for f in worst if f.robustness is not None)

    assert margin() == pytest.approx(4.0 - 0.3 - 0.6 * 2.5 - 2.6, abs=0.02)
    assert margin(max_acceleration_m_s2=0.5) == pytest.approx(4.0 - 0.3 - 0.25 * 2.5 - 2.6, abs=0.03)


def test_a_force_has_no_bound_so_a_contact_may_have_been_in_any_gap() -> None:
    t = np.array([0.0, 0.01, 0.31, 0.32])
    force = Signal("contact_force/arm/ann", "N", t, np.zeros(4))
    given = replace(trial({0.0: 1.0, 0.32: 1.0}), signals={force.name: force})

    _, (worlds,) = found(PflContact(region="chest"), given)

    assert [one.verdict for one in worlds.worst] == [Verdict.VIOLATED]
    assert worlds.worst[0].critical  # as one that was seen, so that a gate closes
    assert "force_max_N" not in worlds.worst[0].quantities


def test_data_that_break_a_stated_bound_are_named_and_a_default_one_leaves_its_gap_unbounded() -> None:
    run = trial({0.0: 3.0, 1.0: 1.0})
    broken = broken_bounds(run, run.between or BetweenSamples())

    assert broken is not None
    assert (broken.bodies, broken.t_s, broken.needed, broken.bound) == ("arm and ann", 1.0, 2.0, 1.0)
    assert broken_bounds(replace(run), between_samples({}, {**STATED, "time_error_s": 0.5})) is None
    leap = trial({0.0: 30.0, 0.01: 30.0, 1.0: 1.0, 1.01: 1.0}, stated={})
    _, (worlds,) = found(HumanContact(), leap)
    assert "faster than the default bound" in worlds.causes[-1].text
    assert [one.verdict for one in worlds.worst] == [Verdict.VIOLATED]


def built(values: Mapping[str, tuple[str, Any]], stated: Mapping[str, Any]) -> Trial:
    """A trial as a reader makes it, at 100 Hz for a second, with its jumps left out."""
    made = TrialBuilder("t", file="t", clock=None)
    for body in (Body("arm", "robot", 0.0), Body("ann", "human", 0.0)):
        made.add_body(body)
    for name, (unit, column) in values.items():
        made.add_signal(name, unit, np.arange(101) / 100, np.asarray(column, dtype=np.float64))
    made.add(Event(0.0, COMPETITION_STARTED))
    made.add(Event(1.0, COMPETITION_ENDED))
    return replace(made.build(), between=between_samples({}, stated))


@pytest.mark.parametrize(
    ("stated", "needed"),
    [
        ({"max_acceleration_m_s2": 1.9}, 1.96),  # 2 m/s2, less what six digits of places are worth at 100 Hz
        ({"max_acceleration_m_s2": 2.1}, None),
        ({"max_acceleration_m_s2": 1.9, "error": {"distance_error_m": 0.001}}, None),
        ({"max_acceleration_m_s2": 1.9, "error": {"time_error_s": 0.001}}, None),
    ],
)
def test_places_that_turn_sharper_than_stated_break_the_bound(
    stated: dict[str, Any], needed: float | None
) -> None:
    """From rest at 2 m/s2: x = t^2."""
    t = np.arange(101) / 100
    places = {"position/ann": ("m", np.stack([t**2, 0 * t, 0 * t], axis=1))}
    errors = stated.pop("error", {})
    bounds = {"human": {"max_speed_m_s": 3.0, **stated, "source": "here"}, **errors}

    broken = broken_bounds(built(places, bounds), between_samples({}, bounds))

    if needed is None:
        assert broken is None
    else:
        assert broken is not None
        assert (broken.bodies, broken.t_s, broken.bound, broken.unit) == ("ann", 0.02, 1.9, "m/s2")
        assert broken.needed == pytest.approx(needed)


def with_glitch(usual: float, glitch: float) -> list[float]:
    return [glitch if k == 50 else usual for k in range(101)]


@pytest.mark.parametrize(
    ("glitch_m", "nearest_m"),
    [
        (0.2, 0.2),  # it may be right, and who is unsafe would else be safe by being impossible
        (60.0, 9.0 - 0.01 * (4.0 + 5.0)),  # by the default speeds, half way between two samples 20 ms apart
    ],
)
def test_the_worst_world_takes_a_distance_that_jumps_at_its_word(glitch_m: float, nearest_m: float) -> None:
    given = built({"separation/arm/ann": ("m", with_glitch(9.0, glitch_m))}, {})

    assert [one.kind for one in given.log_defects] == ["implausible_jump"]
    for limit_m, broken in ((nearest_m - 0.05, False), (nearest_m + 0.05, True)):
        opened = found(replace(NEARER_THAN_1_M, holds=f"d >= {limit_m}"), given)[1]
        assert any(one.verdict is Verdict.VIOLATED for worlds in opened for one in worlds.worst) is broken


def test_a_body_that_jumps_may_have_been_anywhere_meanwhile() -> None:
    still = np.zeros((101, 3))
    ann = still + np.array([9.0, 0.0, 0.0])
    ann[50, 0] = 60.0
    given = built({"position/arm": ("m", still), "position/ann": ("m", ann)}, {})
    derived = derive_signals(given, [Derivation("centre_distance", 0.5)])

    (worlds,) = found(replace(HumanContact(), distance="centre_distance"), derived)[1]

    assert [one.verdict for one in worlds.worst] == [Verdict.VIOLATED]
    assert "the position of ann jumps at 0.500 s faster than anything moves" in worlds.causes[-1].text


def test_a_jump_breaks_a_bound_that_is_stated_and_no_other() -> None:
    glitch = {"separation/arm/ann": ("m", with_glitch(9.0, 60.0))}
    stated = {kind: {"max_speed_m_s": 2.0, "source": "here"} for kind in ("robot", "human")}

    broken = broken_bounds(built(glitch, stated), between_samples({}, stated))

    assert broken is not None
    # 51 m in 10 ms, of two bodies of 2 m/s each.
    assert (broken.bodies, broken.t_s, broken.bound) == ("arm and ann", 0.5, 4.0)
    assert broken.needed == pytest.approx(5100.0)
    assert broken_bounds(built(glitch, {}), between_samples({}, {})) is None
    late = {**stated, "time_error_s": 10.0}
    assert broken_bounds(built(glitch, late), between_samples({}, late)) is None


def test_without_anything_assumed_a_monitor_finds_what_it_always_found() -> None:
    given = replace(trial(sampled(3.0, 3.0, 0.06)), between=None)

    findings, opened = found(HumanContact(), given)

    assert ([one.verdict for one in findings], opened) == ([Verdict.INCONCLUSIVE], [])
    assert findings[0].message == "no samples for 0.060 s, from 1.000 s"


def standing(apart_m: float, *, rate_hz: float, later_s: float) -> Trial:
    """A robot and a human who stand still for 2 s, each seen at a rate, the human a while later."""
    t = np.arange(0.0, 2.0 + 1e-9, 1.0 / rate_hz)
    signals = {}
    for body, x_m, at_s in (("arm", 0.0, t), ("ann", apart_m, t + later_s)):
        places = np.zeros((len(at_s), 3))
        places[:, 0] = x_m
        signals[f"position/{body}"] = Signal(f"position/{body}", "m", at_s, places, f"/{body}")
    events = (Event(0.1, COMPETITION_STARTED), Event(1.9, COMPETITION_ENDED))
    bodies = (Body("arm", "robot", 0.0), Body("ann", "human", 0.0))
    return Trial(
        "t",
        bodies=bodies,
        signals=signals,
        events=events,
        recorded=Span(0.0, 2.1),
        between=between_samples({}, STATED),
    )


@pytest.mark.parametrize("later_s", [0.0, 0.04])
@pytest.mark.parametrize(
    ("apart_m", "is_certain", "is_possible"),
    # Between samples 100 ms apart two bodies of 0.6 and 0.4 m/s come nearer, or further, by 0.034 to 0.05 m.
    [(1.06, False, False), (1.02, False, True), (0.98, False, True), (0.94, True, True)],
)
def test_samples_too_sparse_for_a_distance_say_how_near_bodies_can_be(
    apart_m: float, is_certain: bool, is_possible: bool, later_s: float
) -> None:
    given = standing(apart_m, rate_hz=10.0, later_s=later_s)
    derived = derive_signals(given, [Derivation("separation", 0.05)])
    assert len(derived.signals["separation/arm/ann"]) == (0 if later_s else 21)
    findings, opened = found(NEARER_THAN_1_M, derived)

    best, worst = (opened[0].best, opened[0].worst) if opened else (tuple(findings),) * 2
    least_s, most_s = (of_gap(world, "time_in_violation_s") for world in (best, worst))
    assert (least_s == pytest.approx(1.8, abs=1e-6)) is is_certain
    assert (most_s > 0.0) is is_possible
    assert all("is not in the log" not in one.message for one in findings)


@pytest.mark.parametrize(("apart_m", "most_s"), [(0.94, 0.0), (0.87, 1.8)])
def test_samples_too_sparse_for_a_speed_leave_open_how_fast_bodies_were(
    apart_m: float, most_s: float
) -> None:
    """Required are 0.6 (0.2 + 0.3) + 0.4 * 0.2 + 0.5 = 0.88 m of both at their fastest.

    Nobody sees 0.05 m of their way, and cells make the worst world a little worse.
    """
    monitor = SsmSeparation(profile="seed", t1_s=0.2, t2_s=0.3, delta_m=0.5)
    given = standing(apart_m + 1e-6, rate_hz=10.0, later_s=0.0)
    derived = derive_signals(given, [Derivation(need.quantity, need.max_gap_s) for need in monitor.needs()])
    assert len(derived.signals["speed/arm"]) == 0
    findings, opened = found(monitor, derived)

    worst = opened[0].worst if opened else tuple(findings)
    assert of_gap(worst, "time_in_violation_s") == pytest.approx(most_s, abs=1e-6)


def test_without_bounds_a_speed_that_no_sample_shows_is_missing() -> None:
    given = replace(standing(1.0, rate_hz=10.0, later_s=0.0), between=None)

    assert "speed/arm" not in derive_signals(given, [Derivation("speed", 0.05)]).signals


@pytest.mark.parametrize(
    ("announced_s", "certain_s"), [(None, 0.0), (0.9, 0.0), (2.0, 1.0), (3.5, 2.01), (4.0, 2.01)]
)
def test_of_what_may_have_been_after_an_end_that_nobody_states_only_the_part_before_is_certain(
    announced_s: float | None, certain_s: float
) -> None:
    """Too near from 1 s to 3 s of a recording of 4 s; nobody knows how long the competition went on."""
    near_m = {round(0.01 * k, 9): (0.5 if 100 <= k <= 300 else 3.0) for k in range(401)}
    given = trial(near_m, ended=False)
    work = () if announced_s is None else (Item("kit", "kit", announced_s=announced_s),)
    given = replace(given, work=work, window_open="the log does not show the end")
    _, (worlds,) = found(NEARER_THAN_1_M, given)

    best_s = sum(
        one.quantities["time_in_violation_s"] for one in worlds.best if one.verdict is Verdict.VIOLATED
    )
    assert best_s == pytest.approx(certain_s, abs=1e-9)
    assert any(one.verdict is Verdict.VIOLATED for one in worlds.worst)


@pytest.mark.parametrize(("t_off_s", "most"), [(0.0, 1), (0.45, 3), (0.9, 2), (1.1, 1)])
def test_a_formula_of_temporal_logic_may_have_one_violation_around_a_gap_or_one_more_for_each_pause(
    t_off_s: float, most: int
) -> None:
    """0.5 m apart but for a gap of 2 s, in which they may have been 1 m apart for 1 s."""
    given = trial(sampled(0.5, 0.5, 2.0))
    near_m = StlFormula(
        formula="always d >= 1", signals={"d": "separation in m"}, max_gap_s=0.05, t_off_s=t_off_s
    )

    _, (worlds,) = found(near_m, given)

    counts = [sum(f.verdict is Verdict.VIOLATED for f in world) for world in (worlds.best, worlds.worst)]
    assert counts == [1, most]
