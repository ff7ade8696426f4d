"""Small trials whose findings were worked by hand, one for what each monitor measures over time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Event, Signal, Span, Trial, Verdict
from ariac_score_ariac.safety import HumanContact
from ariac_score_standards import (
    Always,
    EstopRestart,
    MonitoredStandstill,
    PflContact,
    SignalCoverage,
    SsmResponse,
    StopPerformance,
    Within,
)

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
DISTANCE = {"v": "speed/{robot}", "d": "separation/{robot}/{human}"}


def two(t: Any, distance_m: Any, speed_m_s: Any = 1.0) -> Trial:
    """A robot and a human this far apart, the robot this fast."""
    t = np.array(t, dtype=float)
    signals = {
        "separation/r/h": Signal("separation/r/h", "m", t, np.broadcast_to(distance_m, t.shape)),
        "speed/r": Signal("speed/r", "m/s", t, np.broadcast_to(speed_m_s, t.shape)),
    }
    bodies = Body("r", "robot"), Body("h", "human")
    return Trial("t", bodies=bodies, signals=signals, recorded=Span(float(t[0]), float(t[-1])))


CONTACT = HumanContact(max_gap_s=0.15, t_off_s=0.0)


def test_an_episode_is_one_with_all_its_samples() -> None:
    # Every 0.1 s; 0 m from 0.2 s to before 0.6 s. Contact at 0 m is below the next larger number by it.
    distance_m = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0]

    (contact,) = CONTACT.watch(two(np.arange(8) / 10, distance_m))

    assert (contact.verdict, contact.critical) == (Verdict.VIOLATED, True)
    assert contact.span == Span(0.2, 0.6)
    assert contact.quantities["time_in_violation_s"] == pytest.approx(0.4)
    assert contact.labels == {"robot_moving": "yes"}
    assert contact.quantities["exposure_s"] == pytest.approx(0.7)  # within 5 m of the moving robot


def test_a_gap_is_inconclusive_and_ends_an_episode() -> None:
    t = [0.0, 0.1, 0.2, 0.9, 1.0, 1.1]

    gap, first, second = CONTACT.watch(two(t, 0.0))

    assert (gap.verdict, gap.span) == (Verdict.INCONCLUSIVE, Span(0.2, 0.9))
    assert [first.span, second.span] == [Span(0.0, 0.35), Span(0.9, 1.1)]


def test_a_late_response_is_found_and_one_that_never_comes_is_late() -> None:
    t = np.arange(8) / 10
    asks = Within(
        trigger="d < 0.5", response="v < 0.1", signals=DISTANCE, within_s=0.35, max_gap_s=0.15, t_off_s=0.0
    )
    distance_m = [1, 0, 1, 1, 1, 1, 1, 1]

    (kept,) = asks.watch(two(t, distance_m, [1, 1, 1, 1, 0, 0, 0, 0]))
    (late,) = asks.watch(two(t, distance_m, 1.0))

    assert kept.quantities["response_s"] == pytest.approx(0.3)
    assert (late.verdict, late.span) == (Verdict.VIOLATED, Span(0.1, 0.7))


def test_who_was_exposed_while_a_signal_was_missing() -> None:
    # The robot moves within 1 m of g from 0.25 s on and of h up to 0.5 s, and nothing is known of h
    # from 0.6 s to 0.9 s. The robot's place is not recorded between 0.3 s and 0.7 s.
    t = np.arange(11) / 10
    half_later = np.array([0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95, 1.05])
    signals = {
        "separation/r/g": ("m", half_later, np.where(half_later < 0.2, 9.0, 0.5)),
        "separation/r/h": ("m", np.delete(t, [7, 8]), np.delete(np.where(t < 0.5, 0.5, 9.0), [7, 8])),
        "speed/r": ("m/s", t, np.ones(11)),
        "position/r": ("m", np.delete(t, [4, 5, 6]), np.zeros((8, 3))),
    }
    bodies = Body("r", "robot"), Body("g", "human"), Body("h", "human")
    recorded = {name: Signal(name, *column) for name, column in signals.items()}

    def found(*humans: str) -> Any:
        seen = [body for body in bodies if body.id in ("r", *humans)]
        trial = Trial("t", bodies=tuple(seen), signals=recorded, recorded=Span(0.0, 1.0))
        (finding,) = SignalCoverage(share_of="exposure", max_gap_s=0.15, exposure_distance_m=1.0).watch(trial)
        return finding.quantities["exposure_s"], finding.quantities["missing_s"]

    # Of g nothing is known before its first sample, at 0.05 s; then it is far until that of 0.25 s.
    assert found("g") == pytest.approx((0.05 + 0.75, 0.4))
    assert found("h") == pytest.approx((0.5 + 0.3, 0.2 + 0.1))
    assert found("g", "h") == pytest.approx((1.0, 0.4))


def test_a_formula_without_value_says_of_which_sample() -> None:
    formula = Always(holds="1 / d > 0", signals=DISTANCE, max_gap_s=0.15)
    (finding,) = formula.watch(two(np.arange(8) / 10, [1, 1, 1, 1, 1, 0, 1, 0]))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "5" in finding.message


def test_a_breach_is_timed_from_where_it_began() -> None:
    # Allowed 1 m/s for 0.1 s, then down to 0 within 0.3 s: at rest 0.4 s after the breach at 0.1 s.
    monitor = SsmResponse(profile="standard", max_gap_s=0.15, t_on_s=0.0, speeds="scalar", delta_m=0.1)
    (late,) = monitor.watch(two(np.arange(10) / 10, [9.0] + [0.0] * 9))

    assert late.verdict is Verdict.VIOLATED
    assert late.span is not None
    assert (late.span.start_s, late.span.end_s) == pytest.approx((0.3, 0.9))
    assert late.quantities["travel_m"] == pytest.approx(0.8)  # 1 m/s from 0.1 s to the last sample
    # Allowed are 1, 1, 2/3, 1/3, 0 ... m/s; beyond are 0, 0, 1/3, 2/3, 1, 1, 1, 1, 1 m/s, joined by lines.
    assert late.quantities["extra_travel_m"] == pytest.approx(0.1 * (1 / 3 + 2 / 3 + 4 + 0.5))


def one(columns: dict[str, tuple[str, Any]], *events: Event, every_s: float = 0.1) -> Trial:
    """A robot and a human, sampled every 0.1 s."""
    lengths = {np.shape(values)[0] for _, values in columns.values()}
    t = np.arange(max(lengths)) * every_s
    signals = {name: Signal(name, unit, t, np.array(v, dtype=float)) for name, (unit, v) in columns.items()}
    kinds = frozenset({"emergency_stop", "protective_stop", "emergency_stop_reset", "start", "contact"})
    return Trial(
        "t",
        bodies=(Body("r", "robot"), Body("h", "human")),
        signals=signals,
        events=events,
        recorded=Span(0.0, float(t[-1])),
        witnessed=kinds,
    )


STANDING = MonitoredStandstill(
    workspace=SQUARE, grace_s=0.15, t_on_s=0.0, t_off_s=0.0, max_gap_s=0.15, drift_m=0.01
)
INSIDE, OUTSIDE = [1.0, 1.0, 0.0], [9.0, 9.0, 0.0]


def test_the_way_of_a_movement_goes_on_until_the_person_left() -> None:
    # Inside from 0.1 s to before 0.9 s, at rest from 0.25 s on; it moves at 0.4 s, and creeps on until then.
    human = [OUTSIDE] + [INSIDE] * 8 + [OUTSIDE] * 2
    speed = [0, 0, 0, 0, 1, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01]
    (moved,) = STANDING.watch(one({"position/h": ("m", human), "speed/r": ("m/s", speed)}))

    assert (moved.verdict, moved.labels["resumed"]) == (Verdict.VIOLATED, "yes")
    assert moved.quantities["speed_max_m_s"] == 1.0
    # From 0.4 s to 0.9 s: once from 1 to 0.01 m/s, four steps at 0.01 m/s.
    assert moved.quantities["travel_m"] == pytest.approx(0.1 * (1.01 / 2 + 4 * 0.01))


@pytest.mark.parametrize(
    ("speed", "resumed"),
    [([1, 1, 1, 1, 1, 0], "no"), ([0, 0, 0, 0, 1, 0], "yes")],
    ids=["goes on", "starts again as the person leaves"],
)
def test_only_a_robot_that_had_to_rest_before_starts_again(speed: list[float], resumed: str) -> None:
    # Somebody is inside from 0.1 s to before 0.5 s, so that rest is due from 0.25 s on.
    human = [OUTSIDE] + [INSIDE] * 4 + [OUTSIDE]
    (moved,) = STANDING.watch(one({"position/h": ("m", human), "speed/r": ("m/s", speed)}))

    assert (moved.verdict, moved.labels["resumed"]) == (Verdict.VIOLATED, resumed)


def test_drift_is_measured_from_where_the_robot_came_to_rest() -> None:
    n = 12
    place = np.zeros((n, 3))
    place[:, 0] = np.concatenate([np.full(4, 5.0), 5.0 + 0.002 * np.arange(n - 4)])  # 0.01 m at 0.9 s
    columns = {
        "position/h": ("m", [INSIDE] * n),
        "speed/r": ("m/s", np.zeros(n)),
        "position/r": ("m", place),
    }
    kept, drifted = STANDING.watch(one(columns))

    assert (kept.verdict, drifted.verdict) == (Verdict.SATISFIED, Verdict.VIOLATED)
    assert drifted.span is not None
    assert (drifted.span.start_s, drifted.robustness) == (pytest.approx(1.0), pytest.approx(-0.004))


def test_a_contact_is_held_to_the_limit_of_its_time() -> None:
    # Thigh: 220 N, and 440 N for the first 0.5 s (ISO/TS 15066, Table A.2). 0.1 s to before 1 s at 300 N.
    force = [0.0] + [300.0] * 9 + [0.0]
    contact = PflContact(region="thigh", max_gap_s=0.15, t_off_s=0.0)
    (finding,) = contact.watch(one({"contact_force/r/h": ("N", force)}))

    assert (finding.verdict, finding.critical) == (Verdict.VIOLATED, True)
    assert finding.labels["phase"] == "quasi-static"
    assert finding.quantities["ratio_max"] == pytest.approx(300 / 220)
    assert finding.quantities["contact_s"] == pytest.approx(0.9)
    # Transient until 0.6 s; beyond the other limit are the samples from 0.7 s to 0.9 s.
    assert finding.quantities["time_in_violation_s"] == pytest.approx(0.3)
    assert finding.quantities["impulse_N_s"] == pytest.approx(270.0)
    assert finding.quantities["impulse_above_limit_N_s"] == pytest.approx(90.0)


def test_a_gap_that_closes_clamps_at_both_samples() -> None:
    # A leg is crushed below 0.18 m (ISO 13854); the gap closes between 0.2 s and 0.3 s only.
    force, gap = [0.0, 300.0, 300.0, 300.0, 300.0, 0.0], [0.15, 0.15, 0.15, 0.14, 0.14, 0.14]
    columns = {"contact_force/r/h": ("N", force), "crush_gap/r/h": ("m", gap)}
    contact = PflContact(region="thigh", max_gap_s=0.15, t_off_s=0.0)
    (finding,) = contact.watch(one(columns))

    assert finding.verdict is Verdict.VIOLATED
    assert finding.quantities["time_in_violation_s"] == pytest.approx(0.2)  # at 0.2 s and 0.3 s


def test_a_height_that_is_missing_leaves_the_region_open_or_unknown() -> None:
    """100 N is within what a leg bears and beyond what a face does, which stands for what nobody knows."""
    force = [0.0] + [100.0] * 6 + [0.0]
    columns = {"contact_force/r/h": ("N", force), "contact_height/r/h": ("m", np.full(8, 0.3))}
    contact = PflContact(max_gap_s=0.15, t_off_s=0.0)
    known = one(columns)
    height = known.signals["contact_height/r/h"]
    (with_height,), (with_some,), (with_few,) = (
        contact.watch(replace(known, signals={**known.signals, height.name: cut}))
        for cut in (Signal(height.name, "m", height.t[:n], height.values[:n]) for n in (8, 6, 1))
    )
    (with_none,) = contact.watch(one({"contact_force/r/h": ("N", force)}))

    verdicts = [one.verdict for one in (with_height, with_some, with_few, with_none)]
    assert verdicts == [Verdict.SATISFIED, Verdict.INCONCLUSIVE, Verdict.INCONCLUSIVE, Verdict.VIOLATED]
    assert "is recorded, but not at every moment of it" in with_some.message
    assert with_height.labels["region"] != with_none.labels["region"] == "face"


def test_a_contact_with_no_such_region_is_open() -> None:
    trial = one({"contact_force/r/h": ("N", [0.0, 50.0, 50.0, 0.0])}, Event(0.1, "contact", "r/h", "nose"))
    (finding,) = PflContact(max_gap_s=0.15).watch(trial)

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "'nose' is unknown" in finding.message


def test_a_stop_is_timed_to_where_the_speed_falls_to_standstill() -> None:
    # From 1 m/s at 0.2 s to 0 at 0.3 s: at 0.01 m/s after 0.099 s of it. The request is at 0.05 s.
    trial = one({"speed/r": ("m/s", [1, 1, 1, 0, 0, 0, 0])}, Event(0.05, "protective_stop", "r"))
    (stop,) = StopPerformance(max_gap_s=0.15, hold_s=0.2).watch(trial)

    assert stop.verdict is Verdict.SATISFIED
    assert stop.quantities["stop_time_s"] == pytest.approx(0.249)
    assert stop.quantities["stop_distance_m"] == pytest.approx(0.15 + 0.05)


def test_rest_that_ends_before_it_was_held_is_no_stop() -> None:
    speed = [1, 1, 0, 0, 1, 1, 1, 1, 1]  # at rest from 0.199 s to 0.4 s
    trial = one({"speed/r": ("m/s", speed)}, Event(0.05, "protective_stop", "r"))
    (never,) = StopPerformance(max_gap_s=0.15, hold_s=0.202).watch(trial)
    (held,) = StopPerformance(max_gap_s=0.15, hold_s=0.2).watch(trial)

    assert (never.verdict, held.verdict) == (Verdict.VIOLATED, Verdict.SATISFIED)
    assert "no stop until the log ends" in never.message


def test_a_movement_after_an_emergency_stop_is_one() -> None:
    speed = [1, 0, 0, 0, 0.2, 0.4, 0.2, 0, 0, 1, 1]
    events = (
        Event(0.05, "emergency_stop", ""),
        Event(0.5, "emergency_stop_reset", ""),
        Event(0.85, "start", ""),
    )
    (moved,) = EstopRestart(max_gap_s=0.15).watch(one({"speed/r": ("m/s", speed)}, *events))

    assert (moved.verdict, moved.critical, moved.labels) == (Verdict.VIOLATED, True, {"state": "LATCHED"})
    assert moved.span is not None
    assert (moved.span.start_s, moved.span.end_s) == (pytest.approx(0.4), pytest.approx(0.7))
    assert moved.robustness == pytest.approx(0.01 - 0.4)
    assert moved.quantities["time_in_violation_s"] == pytest.approx(0.3)
    assert moved.quantities["travel_m"] == pytest.approx(0.1 * (0.3 + 0.3 + 0.1))
    assert moved.quantities["before_start_s"] == pytest.approx(0.45)
