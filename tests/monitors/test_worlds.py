"""What a log leaves open about a subject: the findings of the best and of the worst world."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.monitors.monitor import SubjectMonitor
from ariac_score.monitors.unseen import broken_bounds
from ariac_score.trial.bounds import BetweenSamples, between_samples
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score_ariac.safety import HumanContact
from ariac_score_standards import Always, PflContact, SpaceLimit, SsmSeparation

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
    signal = Signal("separation/arm/ann", "m", t, np.array([*distance_m.values()]), "/scanner")
    ends = [Event(float(t[-1]), COMPETITION_ENDED)] if ended else []
    return Trial(
        "t",
        bodies=(Body("arm", "robot", 0.0), Body("ann", "human", 0.0)),
        signals={signal.name: signal},
        events=(Event(float(t[0]), COMPETITION_STARTED), *ends),
        recorded=Span(float(t[0]), float(t[-1])),
        between=between_samples({}, stated, every=every, rates_hz={"/scanner": rate_hz} if rate_hz else None),
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


def test_both_worlds_have_the_time_depth_and_integral_of_the_worked_cases(subtests: pytest.Subtests) -> None:
    """G6, G8 and G9, whose samples stand still around the gap; cells make the worst a little worse."""
    for case, before, after, gap_s, time_s, integral in (
        ("G6, safe at both ends", 2.0, 2.0, 3.0, (0.0, 1.0), (0.0, 0.25)),
        ("G8, violated at one", 0.4, 2.0, 3.0, (1.0 + 0.6, 1.0 + 2.0), (0.6 + 0.18, 0.6 + 1.42)),
    ):
        with subtests.test(case):
            _, (worlds,) = found(NEARER_THAN_1_M, trial(sampled(before, after, gap_s)))
            for quantity, (least, most) in {
                "time_in_violation_s": time_s,
                "depth_integral_m_s": integral,
            }.items():
                assert least - 0.03 <= of_gap(worlds.best, quantity) <= least + 1e-6
                assert most - 1e-6 <= of_gap(worlds.worst, quantity) <= most + 0.03
    with subtests.test("G9, known safe: nothing is open, and the worst margin stands for it"):
        findings, opened = found(NEARER_THAN_1_M, trial(sampled(1.2, 1.2, 0.3)))
        assert opened == []
        assert [one.verdict for one in findings] == [Verdict.SATISFIED]
        assert findings[0].robustness == pytest.approx(0.05, abs=0.01)
        assert findings[0].evidence == ()  # no sample shows it


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
        [f"{gaps} gaps of 20 to 20 ms on /scanner, which is published every {1000 / rate_hz:g} ms"]
        if gaps
        else []
    )


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
    assert "'position/ann' jumps at 0.500 s faster than anything moves" in worlds.causes[-1].text


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
