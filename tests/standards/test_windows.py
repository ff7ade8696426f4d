"""Monitors go through a trial window by window: what they hold does not grow, what they say stays."""

from __future__ import annotations

import gc
import runpy
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, Event, Signal, Span, Total, Trial, Verdict
from ariac_score.results import sketch
from ariac_score.results.sketch import sketch_of
from ariac_score.trial import windows
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score_ariac.safety import CollisionEpisodes, HumanContact
from ariac_score_standards import (
    AgvProtectiveField,
    AgvSpeedClearance,
    Always,
    CrushGap,
    EstopRestart,
    HandGuiding,
    MonitoredStandstill,
    Never,
    PflContact,
    PflSpeed,
    ProximityComfort,
    ReducedSpeed,
    SafeguardDistance,
    SignalCoverage,
    SpaceLimit,
    SsmResponse,
    SsmSeparation,
    SsmSpeedCap,
    StopPerformance,
    Within,
)
from ariac_score_standards.iso_ts_15066 import RunStarts, first_of_runs
from ariac_score_standards.severity import travelled_m, ways_m
from ariac_score_standards.watching import Watching
from ariac_score_stl import StlFormula
from ariac_score_stl import judging as stl_judging
from ariac_score_stl import windows as stl_windows

MADE = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "test_margins.py")))
SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
OF_PAIR = {"d": "separation in m", "v": "speed of robot in m/s"}
DISTANCE = {"v": "speed/{robot}", "d": "separation/{robot}/{human}"}

WINDOWED: dict[str, Any] = {
    "ssm_separation, seed": SsmSeparation(),
    "ssm_separation, standard": SsmSeparation(profile="standard", reduced_mass_kg=20.0),
    "ssm_separation, deceleration": SsmSeparation(
        profile="standard", stop_model="deceleration", human_speed="measured", t_on_s=0.0, t_off_s=0.03
    ),
    "ssm_speed_cap": SsmSpeedCap(profile="standard"),
    "ssm_response": SsmResponse(profile="standard"),
    "human_contact": HumanContact(contact_distance_m=0.3),
    "reduced_speed": ReducedSpeed(t_on_s=0.0),
    "reduced_speed, zone": ReducedSpeed(applies="human_in_zone", zone=SQUARE),
    "space_limit": SpaceLimit(area=SQUARE),
    "pfl_speed, near": PflSpeed(region="chest", when="near", near_m=1.0),
    "pfl_speed, contact": PflSpeed(region="chest", when="contact", t_off_s=0.05),
    "pfl_contact": PflContact(region="hand", t_off_s=0.05, transient_window_s=0.05),
    "pfl_contact, unknown": PflContact(t_off_s=0.3),
    "monitored_standstill": MonitoredStandstill(workspace=SQUARE, grace_s=0.1, standstill_speed_m_s=0.1),
    "monitored_standstill, drift": MonitoredStandstill(
        workspace=((-9.0, -9.0), (9.0, -9.0), (9.0, 9.0)), grace_s=0.0, standstill_speed_m_s=0.9, t_off_s=0.05
    ),
    "stop_performance": StopPerformance(standstill_speed_m_s=0.3, max_distance_m=0.05),
    "stop_performance, hold": StopPerformance(standstill_speed_m_s=0.7, hold_s=0.3, power_wait_s=0.1),
    "estop_restart": EstopRestart(stop_within_s=0.1, t_off_s=0.05),
    "estop_restart, hold": EstopRestart(stop_within_s=0.5, hold_s=0.2, standstill_speed_m_s=0.5),
    "hand_guiding": HandGuiding(stop_within_s=0.1),
    "agv_speed_clearance": AgvSpeedClearance(),
    "agv_protective_field": AgvProtectiveField(),
    "safeguard_distance": SafeguardDistance(
        line=((0.0, -9.0), (0.0, 9.0)), hazard=((3.0, -1.0), (4.0, -1.0), (4.0, 1.0)), stopping_time_s=0.1
    ),
    "proximity_comfort": ProximityComfort(),
    "crush_gap": CrushGap(part="hand", t_off_s=0.05),
    "collision_episodes": CollisionEpisodes(),
    "stl.formula, ahead": StlFormula(formula="always (d < 1 -> eventually[0,0.1] v < 0.5)", signals=OF_PAIR),
    "stl.formula, back": StlFormula(formula="always (v > 1 -> once d > 1.2)", signals=OF_PAIR),
    "stl.formula, to the end": StlFormula(
        formula="always (d < 0.5 -> eventually (v < 0.1 and once d > 1))", signals=OF_PAIR
    ),
    "stl.formula, dense": StlFormula(
        formula="always (d < 1 -> eventually[0,0.1] v < 0.5)", signals=OF_PAIR, time="dense"
    ),
    "stl.formula, dense, until and since": StlFormula(
        formula="always ((d > 0.3 until[0.05,0.1] v < 2) or (v < 0.1 since[0.1,0.3] d > 0.2))",
        signals=OF_PAIR,
        time="dense",
    ),
    "stl.formula, dense, to the end": StlFormula(
        formula="always (d < 0.5 -> eventually (v < 0.1 and once d > 1))", signals=OF_PAIR, time="dense"
    ),
    "formula.always": Always(holds="d >= 0.5 * v + 0.3", signals=DISTANCE, unit="m"),
    "formula.never": Never(holds="v > 1", signals={"v": "speed/{robot}"}, unit="m/s"),
    "formula.within": Within(trigger="d < 0.5", response="v < 0.1", signals=DISTANCE, within_s=0.2),
    "signal_coverage": SignalCoverage(quantities=("position", "speed"), max_gap_s=0.2),
    "signal_coverage, exposure": SignalCoverage(
        share_of="exposure", exposure_distance_m=0.8, quantities=("position", "separation")
    ),
}
each_windowed = pytest.mark.parametrize("name", WINDOWED)


@contextmanager
def window_size(samples: int, kept_bytes: int = 0) -> Iterator[None]:
    """Windows of so few samples, and nothing kept of what was computed for those before."""
    with ExitStack() as stack:
        for module, name, value in (
            (windows, "LARGEST_WINDOW_SAMPLES", samples),
            (windows, "KEPT_BYTES", kept_bytes),
            (windows, "KEPT_VECTOR_BYTES", kept_bytes),
            (sketch, "PART_SAMPLES", samples),
            (stl_windows, "WINDOW_ROWS", samples),
            (stl_windows, "ROWS_FOR_ONE_AROUND", 0),
            (stl_windows, "KEPT_BYTES", kept_bytes),
            (stl_judging, "KEPT_BYTES", kept_bytes),
        ):
            stack.enter_context(patch.object(module, name, value))
        yield


def derived(monitor: Any, trial: Trial) -> Trial:
    return derive_signals(trial, [Derivation(need.quantity, need.max_gap_s) for need in monitor.needs()])


# What is said --------------------------------------------------------------------------


def said(monitor: Any, trial: Trial) -> list[Any]:
    """All findings, and all margins, to the bit."""
    told: list[Any] = [repr(finding) for finding in monitor.watch(trial)]
    for course in monitor.margins(trial) if hasattr(monitor, "margins") else ():
        told.append((course.subject, course.what, course.t.tobytes(), course.actual.tobytes()))
        told.append(course.limit.tobytes())
    return told


@each_windowed
@settings(max_examples=6, derandomize=True, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0.05, 0.3]), st.sampled_from([1, 7, 32]))
def test_findings_and_margins_do_not_depend_on_windows(
    name: str, seed: int, hole: bool, step: float, samples: int
) -> None:
    monitor, trial = WINDOWED[name], MADE.wild_trial(seed, hole=hole, step=step)
    whole = said(monitor, derived(monitor, trial))  # which has fewer samples than one window

    with window_size(samples):
        assert said(monitor, derived(monitor, trial)) == whole


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


@pytest.mark.parametrize("samples", [1, 2, 3, 4, 5, 4096])
def test_an_episode_across_windows_is_one_with_all_its_samples(samples: int) -> None:
    # Every 0.1 s; 0 m from 0.2 s to before 0.6 s. Contact at 0 m is below the next larger number by it.
    distance_m = [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0]

    with window_size(samples):
        (contact,) = CONTACT.watch(two(np.arange(8) / 10, distance_m))

    assert (contact.verdict, contact.critical) == (Verdict.VIOLATED, True)
    assert contact.span == Span(0.2, 0.6)
    assert contact.quantities["time_in_violation_s"] == pytest.approx(0.4)
    assert contact.labels == {"robot_moving": "yes"}
    assert contact.quantities["exposure_s"] == pytest.approx(0.7)  # within 5 m of the moving robot


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_a_gap_between_two_windows_is_said_and_ends_an_episode(samples: int) -> None:
    t = [0.0, 0.1, 0.2, 0.9, 1.0, 1.1]

    with window_size(samples):
        gap, first, second = CONTACT.watch(two(t, 0.0))

    assert (gap.verdict, gap.span) == (Verdict.INCONCLUSIVE, Span(0.2, 0.9))
    assert [first.span, second.span] == [Span(0.0, 0.35), Span(0.9, 1.1)]


@pytest.mark.parametrize("samples", [1, 2, 4096])
def test_a_response_in_a_later_window_is_found_and_one_that_never_comes_is_late(samples: int) -> None:
    t = np.arange(8) / 10
    asks = Within(
        trigger="d < 0.5", response="v < 0.1", signals=DISTANCE, within_s=0.35, max_gap_s=0.15, t_off_s=0.0
    )
    distance_m = [1, 0, 1, 1, 1, 1, 1, 1]

    with window_size(samples):
        (kept,) = asks.watch(two(t, distance_m, [1, 1, 1, 1, 0, 0, 0, 0]))
        (late,) = asks.watch(two(t, distance_m, 1.0))

    assert kept.quantities["response_s"] == pytest.approx(0.3)
    assert (late.verdict, late.span) == (Verdict.VIOLATED, Span(0.1, 0.7))


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_who_was_exposed_while_a_signal_was_missing_does_not_depend_on_windows(samples: int) -> None:
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

    with window_size(samples):
        # Of g nothing is known before its first sample, at 0.05 s; then it is far until that of 0.25 s.
        assert found("g") == pytest.approx((0.05 + 0.75, 0.4))
        assert found("h") == pytest.approx((0.5 + 0.3, 0.2 + 0.1))
        assert found("g", "h") == pytest.approx((1.0, 0.4))


@pytest.mark.parametrize("samples", [1, 3, 4096])
def test_a_formula_without_value_says_of_which_sample_of_all(samples: int) -> None:
    formula = Always(holds="1 / d > 0", signals=DISTANCE, max_gap_s=0.15)
    with window_size(samples):
        (finding,) = formula.watch(two(np.arange(8) / 10, [1, 1, 1, 1, 1, 0, 1, 0]))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "5" in finding.message


@pytest.mark.parametrize("samples", [1, 2, 4096])
def test_a_breach_that_goes_on_is_timed_from_the_window_it_began_in(samples: int) -> None:
    # Allowed 1 m/s for 0.1 s, then down to 0 within 0.3 s: at rest 0.4 s after the breach at 0.1 s.
    monitor = SsmResponse(profile="standard", max_gap_s=0.15, t_on_s=0.0, speeds="scalar", delta_m=0.1)
    with window_size(samples):
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


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_the_way_of_a_movement_goes_on_until_the_person_left_in_whichever_window(samples: int) -> None:
    # Inside from 0.1 s to before 0.9 s, at rest from 0.25 s on; it moves at 0.4 s, and creeps on until then.
    human = [OUTSIDE] + [INSIDE] * 8 + [OUTSIDE] * 2
    speed = [0, 0, 0, 0, 1, 0.01, 0.01, 0.01, 0.01, 0.01, 0.01]
    with window_size(samples):
        (moved,) = STANDING.watch(one({"position/h": ("m", human), "speed/r": ("m/s", speed)}))

    assert (moved.verdict, moved.labels["resumed"]) == (Verdict.VIOLATED, "yes")
    assert moved.quantities["speed_max_m_s"] == 1.0
    # From 0.4 s to 0.9 s: once from 1 to 0.01 m/s, four steps at 0.01 m/s.
    assert moved.quantities["travel_m"] == pytest.approx(0.1 * (1.01 / 2 + 4 * 0.01))


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_drift_is_measured_from_where_the_robot_came_to_rest_windows_ago(samples: int) -> None:
    n = 12
    place = np.zeros((n, 3))
    place[:, 0] = np.concatenate([np.full(4, 5.0), 5.0 + 0.002 * np.arange(n - 4)])  # 0.01 m at 0.9 s
    columns = {
        "position/h": ("m", [INSIDE] * n),
        "speed/r": ("m/s", np.zeros(n)),
        "position/r": ("m", place),
    }
    with window_size(samples):
        kept, drifted = STANDING.watch(one(columns))

    assert (kept.verdict, drifted.verdict) == (Verdict.SATISFIED, Verdict.VIOLATED)
    assert drifted.span is not None
    assert (drifted.span.start_s, drifted.robustness) == (pytest.approx(1.0), pytest.approx(-0.004))


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_a_contact_across_windows_is_held_to_the_limit_of_its_time(samples: int) -> None:
    # Thigh: 220 N, and 440 N for the first 0.5 s (ISO/TS 15066, Table A.2). 0.1 s to before 1 s at 300 N.
    force = [0.0] + [300.0] * 9 + [0.0]
    contact = PflContact(region="thigh", max_gap_s=0.15, t_off_s=0.0)
    with window_size(samples):
        (finding,) = contact.watch(one({"contact_force/r/h": ("N", force)}))

    assert (finding.verdict, finding.critical) == (Verdict.VIOLATED, True)
    assert finding.labels["phase"] == "quasi-static"
    assert finding.quantities["ratio_max"] == pytest.approx(300 / 220)
    assert finding.quantities["contact_s"] == pytest.approx(0.9)
    # Transient until 0.6 s; beyond the other limit are the samples from 0.7 s to 0.9 s.
    assert finding.quantities["time_in_violation_s"] == pytest.approx(0.3)
    assert finding.quantities["impulse_N_s"] == pytest.approx(270.0)
    assert finding.quantities["impulse_above_limit_N_s"] == pytest.approx(90.0)


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_a_gap_that_closes_from_one_window_to_the_next_clamps(samples: int) -> None:
    # A leg is crushed below 0.18 m (ISO 13854); the gap closes between 0.2 s and 0.3 s only.
    force, gap = [0.0, 300.0, 300.0, 300.0, 300.0, 0.0], [0.15, 0.15, 0.15, 0.14, 0.14, 0.14]
    columns = {"contact_force/r/h": ("N", force), "crush_gap/r/h": ("m", gap)}
    contact = PflContact(region="thigh", max_gap_s=0.15, t_off_s=0.0)
    with window_size(samples):
        (finding,) = contact.watch(one(columns))

    assert finding.verdict is Verdict.VIOLATED
    assert finding.quantities["time_in_violation_s"] == pytest.approx(0.2)  # at 0.2 s and 0.3 s


@pytest.mark.parametrize("samples", [1, 2, 4096])
def test_a_height_that_is_missing_in_any_window_leaves_the_region_unknown(samples: int) -> None:
    force = [0.0] + [100.0] * 6 + [0.0]
    columns = {"contact_force/r/h": ("N", force), "contact_height/r/h": ("m", np.full(8, 0.3))}
    contact = PflContact(max_gap_s=0.15, t_off_s=0.0)
    known = one(columns)
    height = known.signals["contact_height/r/h"]
    cut = Signal(height.name, "m", height.t[:6], height.values[:6])
    with window_size(samples):
        (told,) = contact.watch(known)
        (open_,) = contact.watch(replace(known, signals={**known.signals, height.name: cut}))

    assert (told.verdict, open_.verdict) == (Verdict.SATISFIED, Verdict.VIOLATED)
    assert told.labels["region"] != open_.labels["region"] == "face"


@pytest.mark.parametrize("samples", [1, 2, 4096])
def test_a_contact_with_no_such_region_is_open_in_any_window(samples: int) -> None:
    trial = one({"contact_force/r/h": ("N", [0.0, 50.0, 50.0, 0.0])}, Event(0.1, "contact", "r/h", "nose"))
    with window_size(samples):
        (finding,) = PflContact(max_gap_s=0.15).watch(trial)

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "'nose' is unknown" in finding.message


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_a_stop_is_timed_from_the_sample_of_another_window(samples: int) -> None:
    # From 1 m/s at 0.2 s to 0 at 0.3 s: at 0.01 m/s after 0.099 s of it. The request is at 0.05 s.
    trial = one({"speed/r": ("m/s", [1, 1, 1, 0, 0, 0, 0])}, Event(0.05, "protective_stop", "r"))
    with window_size(samples):
        (stop,) = StopPerformance(max_gap_s=0.15, hold_s=0.2).watch(trial)

    assert stop.verdict is Verdict.SATISFIED
    assert stop.quantities["stop_time_s"] == pytest.approx(0.249)
    assert stop.quantities["stop_distance_m"] == pytest.approx(0.15 + 0.05)


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_rest_that_ends_before_it_was_held_is_no_stop_in_any_window(samples: int) -> None:
    speed = [1, 1, 0, 0, 1, 1, 1, 1, 1]  # at rest from 0.199 s to 0.4 s
    trial = one({"speed/r": ("m/s", speed)}, Event(0.05, "protective_stop", "r"))
    with window_size(samples):
        (never,) = StopPerformance(max_gap_s=0.15, hold_s=0.202).watch(trial)
        (held,) = StopPerformance(max_gap_s=0.15, hold_s=0.2).watch(trial)

    assert (never.verdict, held.verdict) == (Verdict.VIOLATED, Verdict.SATISFIED)
    assert "no stop until the log ends" in never.message


@pytest.mark.parametrize("samples", [1, 2, 3, 4096])
def test_a_movement_after_an_emergency_stop_is_one_across_windows(samples: int) -> None:
    speed = [1, 0, 0, 0, 0.2, 0.4, 0.2, 0, 0, 1, 1]
    events = (
        Event(0.05, "emergency_stop", ""),
        Event(0.5, "emergency_stop_reset", ""),
        Event(0.85, "start", ""),
    )
    with window_size(samples):
        (moved,) = EstopRestart(max_gap_s=0.15).watch(one({"speed/r": ("m/s", speed)}, *events))

    assert (moved.verdict, moved.critical, moved.labels) == (Verdict.VIOLATED, True, {"state": "LATCHED"})
    assert moved.span is not None
    assert (moved.span.start_s, moved.span.end_s) == (pytest.approx(0.4), pytest.approx(0.7))
    assert moved.robustness == pytest.approx(0.01 - 0.4)
    assert moved.quantities["time_in_violation_s"] == pytest.approx(0.3)
    assert moved.quantities["travel_m"] == pytest.approx(0.1 * (0.3 + 0.3 + 0.1))
    assert moved.quantities["before_start_s"] == pytest.approx(0.45)


@given(
    st.lists(st.sampled_from([0.01, 0.1, 0.5]), min_size=1, max_size=40),
    st.integers(0, 2**32 - 1),
    st.lists(st.tuples(st.floats(-1.0, 25.0), st.floats(0.0, 25.0)), max_size=6),
    st.sampled_from([1, 2, 7]),
)
@settings(max_examples=80, derandomize=True, deadline=None)
def test_ways_of_windows_are_those_of_all_samples_to_the_bit(
    steps: list[float], seed: int, places: list[tuple[float, float]], samples: int
) -> None:
    t, speed = np.cumsum(steps), np.random.default_rng(seed).uniform(0.0, 2.0, len(steps))
    places += [(float(t[0]), 0.0), (float(t[-1]), 1.0), (float(t[len(t) // 2]), float(t[-1]))]  # on samples
    spans = sorted(Span(start_s, start_s + lasts_s) for start_s, lasts_s in places)
    with window_size(samples):
        watched = Watching([Signal("speed/r", "m/s", t, speed)], 0.2, None, {"speed": "speed/r"}, {})

        found = ways_m(watched, "speed", spans)

    assert found == [travelled_m(t, speed, span) for span in spans]


@given(
    st.lists(st.tuples(st.sampled_from([0.1, 0.5]), st.booleans()), min_size=1, max_size=30),
    st.lists(st.integers(0, 30), max_size=5),
)
@settings(max_examples=60, derandomize=True, deadline=None)
def test_beginnings_of_runs_do_not_depend_on_windows(rows: list[tuple[float, bool]], cuts: list[int]) -> None:
    t, holds = np.cumsum([step for step, _ in rows]), np.array([held for _, held in rows])
    starts, borders = RunStarts(0.2), sorted({0, *(min(cut, len(t)) for cut in cuts), len(t)})

    found = [starts.take(t[a:b], holds[a:b], t[a:b])[0] for a, b in pairwise(borders)]

    assert np.concatenate(found).tolist() == t[first_of_runs(t, holds, 0.2)].tolist()


@given(st.integers(0, 40_000), st.integers(0, 2**32 - 1), st.lists(st.integers(0, 40_000), max_size=8))
@settings(max_examples=40, derandomize=True, deadline=None)
def test_a_total_of_parts_is_the_sum_of_all_to_the_bit(count: int, seed: int, cuts: list[int]) -> None:
    numbers = np.random.default_rng(seed).uniform(0.0, 1.0, count) * 10.0 ** np.arange(count).clip(0, 9)
    total = Total(count)
    for part in np.split(numbers, sorted(min(cut, count) for cut in cuts)):
        total.take(part)

    assert total.value == float(numbers.sum())


# What is held --------------------------------------------------------------------------


def long_trial(samples: int) -> Trial:
    """As many findings however long it is: everything takes as much longer."""
    t, part = np.arange(samples) / 100, np.linspace(0.0, 1.0, samples)
    turn = np.stack([np.cos(6 * part), np.sin(6 * part), 0 * part], axis=1)
    bodies = (Body("r", "robot", 0.1, ("elbow", "tcp")), Body("h", "human", 0.3), Body("a", "agv", 0.4))
    positions = {"r": 0 * turn, "r::elbow": turn, "r::tcp": 2 * turn, "h": 3 * turn[::-1], "a": 4 * turn}
    signals = {f"position/{n}": Signal(f"position/{n}", "m", t, xyz) for n, xyz in positions.items()}
    shared = signals["position/r"].t
    for name, unit in (
        ("clearance/a", "m"),
        ("enabling_device/r", "1"),
        ("joint_speed/r", "rad/s"),
        ("crush_gap/r/h", "m"),
    ):
        signals[name] = Signal(name, unit, shared, (part < 0.5) * 1.0)
    signals["contact_force/r/h"] = Signal("contact_force/r/h", "N", shared, 400 * part)
    end_s = float(t[-1])
    kinds = {"emergency_stop": 0.2, "emergency_stop_reset": 0.5, "start": 0.8}
    events = tuple(Event(end_s * when, kind, "") for kind, when in kinds.items())
    return Trial(
        "t",
        bodies=bodies,
        signals=signals,
        events=events,
        recorded=Span(0.0, end_s),
        witnessed=frozenset(kinds),
    )


@pytest.fixture
def small_windows() -> Iterator[None]:
    with window_size(1000, kept_bytes=80_000):
        yield


def held_bytes(of: Callable[[Trial], object], samples: int) -> int:
    """The most that is held beyond a trial."""
    trial = long_trial(samples)
    gc.collect()
    tracemalloc.start()
    try:
        of(trial)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


SAMPLES, GROWTH_BYTES = 10_000, 120_000
"""30 000 samples more; half of one column of them is 120 000 bytes."""


@each_windowed
@pytest.mark.usefixtures("small_windows")
def test_what_a_monitor_holds_does_not_grow_with_the_trial(name: str) -> None:
    monitor = WINDOWED[name]

    def watch(trial: Trial) -> object:
        return list(monitor.watch(derived(monitor, trial)))

    watch(long_trial(1000))  # what is loaded once is no matter
    short, long = held_bytes(watch, SAMPLES), held_bytes(watch, 4 * SAMPLES)

    assert long - short < GROWTH_BYTES


@pytest.mark.usefixtures("small_windows")
def test_a_monitor_that_holds_one_column_is_found_out() -> None:
    def watch(trial: Trial) -> object:
        return derived(WINDOWED["reduced_speed"], trial).signals["speed/r"].values

    assert held_bytes(watch, 4 * SAMPLES) - held_bytes(watch, SAMPLES) > GROWTH_BYTES


@pytest.mark.usefixtures("small_windows")
def test_courses_are_held_one_at_a_time() -> None:
    monitor = SsmSeparation()

    def courses(trial: Trial) -> object:
        return list(monitor.courses(derived(monitor, trial)))

    assert held_bytes(courses, 4 * SAMPLES) - held_bytes(courses, SAMPLES) < GROWTH_BYTES
    trial = derived(monitor, long_trial(1000))
    (course,) = monitor.courses(trial)
    (curve,) = sketch_of(trial, {"separation": [course]}, {}).curves
    assert curve.samples == len(course.t) == len(course.actual) == len(course.limit) == 1000


@pytest.mark.usefixtures("small_windows")
def test_what_a_curve_is_made_of_does_not_grow_with_the_trial() -> None:
    monitor = SsmSeparation()

    def curves(trial: Trial) -> object:
        courses = list(monitor.courses(derived(monitor, trial)))
        moments = {("separation", "r/h"): [Span(1.0, 2.0)]}
        return sketch_of(Trial("of the curves alone"), {"separation": courses}, moments)

    curves(long_trial(1000))
    assert held_bytes(curves, 4 * SAMPLES) - held_bytes(curves, SAMPLES) < GROWTH_BYTES


@pytest.mark.usefixtures("small_windows")
def test_what_a_route_is_made_of_does_not_grow_with_the_trial() -> None:
    def routes(trial: Trial) -> object:
        return sketch_of(Trial("t", bodies=trial.bodies_of("human"), signals=trial.signals), {}, {}).routes

    routes(long_trial(1000))
    assert held_bytes(routes, 4 * SAMPLES) - held_bytes(routes, SAMPLES) < GROWTH_BYTES
