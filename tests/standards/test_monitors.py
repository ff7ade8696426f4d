"""The monitors derived from standards: limits from both sides, mistakes others made, laws, bad input.

Expected numbers: monitor catalogue, section 2, worked by hand where the comment says so.
"""

from __future__ import annotations

import csv
import dataclasses
import inspect
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Event,
    Finding,
    Signal,
    Span,
    Trial,
    Verdict,
    parameter_facts,
    score_trial,
)
from ariac_score.checks.registry import Registry
from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import prepare
from ariac_score.errors import RuleSetError
from ariac_score.monitors import closing_by
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.testing import SNAPSHOT_SIGNALS, write_bag
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.model import Due, LogDefect
from ariac_score.trial.velocities import centred_velocity
from ariac_score_ariac.safety import CollisionEpisodes, HumanContact, occurrences
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages
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
    PoseAttained,
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
from ariac_score_standards.body_regions import AREAS, REGIONS, body_limits, limits_at
from ariac_score_standards.formula import judge_columns
from ariac_score_standards.iec_60204_1 import stop_category
from ariac_score_standards.iso_9283 import angle_performance, pose_performance
from ariac_score_standards.iso_10218_2 import permitted_speed_m_s, reduced_mass_kg
from ariac_score_standards.iso_13854 import MINIMUM_GAP_M, PART_OF_REGION, clamps
from ariac_score_standards.iso_13855 import minimum_distance
from ariac_score_standards.proxemics import time_to_collision_s, zone_of, zone_shares
from ariac_score_standards.signal_coverage import tracks_of
from ariac_score_standards.ssm_formula import approach_of
from ariac_score_standards.travel import travelled_m

SHARED = Path(__file__).parents[2].parent / "shared"
SATISFIED, VIOLATED = Verdict.SATISFIED, Verdict.VIOLATED
INCONCLUSIVE, NOT_APPLICABLE = Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
MONITORS: Mapping[str, Any] = {
    "iso_ts_15066.ssm_separation": SsmSeparation(profile="standard"),
    "iso_ts_15066.ssm_speed_cap": SsmSpeedCap(profile="standard"),
    "iso_ts_15066.ssm_response": SsmResponse(profile="standard"),
    "iso_10218_2.pfl_contact": PflContact(),
    "iso_10218_2.pfl_speed": PflSpeed(),
    "iso_10218_2.monitored_standstill": MonitoredStandstill(workspace=SQUARE),
    "iso_10218_2.hand_guiding": HandGuiding(),
    "iso_10218_1.reduced_speed": ReducedSpeed(),
    "iso_10218_1.space_limit": SpaceLimit(area=SQUARE),
    "iec_60204_1.stop_performance": StopPerformance(),
    "iso_13850.estop_restart": EstopRestart(),
    "iso_13855.safeguard_distance": SafeguardDistance(line=((-3.0, 0.0), (-3.0, 4.0)), hazard=SQUARE),
    "iso_3691_4.agv_speed_clearance": AgvSpeedClearance(),
    "iso_3691_4.agv_protective_field": AgvProtectiveField(),
    "iso_13854.crush_gap": CrushGap(),
    "iso_9283.pose_performance": PoseAttained(commanded_m=(0.0, 0.0, 0.0)),
    "proxemics.proximity_comfort": ProximityComfort(),
    "ariac.collision_episodes": CollisionEpisodes(),
    "formula.always": Always(holds="v <= 1", signals={"v": "speed/{robot}"}),
    "formula.never": Never(holds="v > 1", signals={"v": "speed/{robot}"}),
    "formula.within": Within(trigger="v > 1", response="v < 1", signals={"v": "speed/{robot}"}),
    "log.signal_coverage": SignalCoverage(),
}


def above(value: float) -> float:
    return float(np.nextafter(value, np.inf))


def below(value: float) -> float:
    return float(np.nextafter(value, -np.inf))


def trial_of(
    columns: Mapping[str, tuple[str, Any]],
    *,
    n: int = 101,
    t: Any = None,
    bodies: Iterable[Body] = (Body("h", "human", 0.0), Body("r", "robot", 0.0)),
    events: Iterable[Event] = (),
    witnessed: Iterable[str] = (),
) -> Trial:
    """A trial at 100 Hz with columns that are numbers or one number for all."""
    times = np.arange(n) / 100 if t is None else np.asarray(t, float)
    signals = {}
    for name, (unit, values) in columns.items():
        column = np.asarray(values, float)
        if column.ndim == 0 or (column.ndim == 1 and name.startswith(("position", "velocity"))):
            column = np.broadcast_to(column, (len(times), *column.shape))
        signals[name] = Signal(name, unit, times, column)
    return Trial(
        "t",
        bodies=tuple(bodies),
        signals=signals,
        events=tuple(events),
        witnessed=frozenset(witnessed),
        recorded=Span(float(times[0]), float(times[-1])),
    )


def verdicts(monitor: Any, trial: Trial) -> list[Verdict]:
    return [finding.verdict for finding in monitor.watch(trial)]


def violated(monitor: Any, trial: Trial) -> bool:
    found = verdicts(monitor, trial)
    assert INCONCLUSIVE not in found, [f.message for f in monitor.watch(trial)]
    return VIOLATED in found


def only(monitor: Any, trial: Trial) -> Finding:
    (finding,) = monitor.watch(trial)
    assert isinstance(finding, Finding)
    return finding


# Limits from both sides -------------------------------------------------------------------------


def separated(distance: float, robot: float = 0.5, human: float = 0.0) -> Trial:
    return trial_of(
        {
            "separation/r/h": ("m", distance),
            "approach_speed_robot/r/h": ("m/s", robot),
            "approach_speed_human/r/h": ("m/s", human),
            "speed/r": ("m/s", abs(robot)),
        }
    )


def required(robot: float) -> float:
    """P1.1: 1.6 (0.1 + 0.3) + v 0.1 + v 0.3 / 2 + 0.35, in the order of the formula."""
    return float(SsmSeparation(profile="standard").d_min_m(np.array([1.6]), np.array([robot]))[0])


def test_the_standard_profile_requires_what_the_published_example_gives() -> None:
    assert required(1.0) == pytest.approx(1.24)
    assert required(0.0) == pytest.approx(0.99)


@pytest.mark.parametrize(("shift", "broken"), [(below, True), (float, False), (above, False)])
def test_the_separation_limit(shift: Callable[[float], float], broken: bool) -> None:
    monitor = SsmSeparation(profile="standard")

    assert violated(monitor, separated(shift(required(0.5)))) is broken


@pytest.mark.parametrize(("distance", "human"), [(below(0.5), 2.0), (0.5, 2.0), (above(0.5), 1.6)])
def test_a_human_who_is_near_may_be_taken_for_faster(distance: float, human: float) -> None:
    # Catalogue, M1: 1.6 m/s beyond 0.5 m, 2.0 m/s up to it. P1.1 with C + Z = 0: v_h 0.4 + 1.0 * 0.25.
    monitor = SsmSeparation(profile="standard", human_speed="by_distance", delta_m=0.0)
    found = only(monitor, separated(distance, robot=1.0))

    assert found.verdict is VIOLATED
    assert found.robustness == pytest.approx(distance - (0.4 * human + 0.25))
    fixed = only(replace(monitor, human_speed="fixed"), separated(distance, robot=1.0))
    assert fixed.robustness == pytest.approx(distance - (0.4 * 1.6 + 0.25))


@pytest.mark.parametrize(("speed", "broken"), [(0.0, False), (0.02, True)])
def test_the_speed_cap_takes_the_near_speed_too(speed: float, broken: bool) -> None:
    # Up to 0.5 m a robot at rest needs 0.4 * 2.0 = 0.8 m, so that it may not move at all.
    given: Any = {"profile": "standard", "delta_m": 0.0, "robot_must_move": "no"}
    trial = separated(0.45, robot=speed)

    assert violated(SsmSpeedCap(human_speed="by_distance", **given), trial) is broken
    assert not violated(SsmSpeedCap(human_speed="fixed", human_speed_m_s=1.0, **given), trial)


def test_the_near_speed_may_be_set_and_is_checked() -> None:
    near = SsmSeparation(
        profile="standard", human_speed="by_distance", near_human_speed_m_s=2.5, near_distance_m=1.0
    )

    assert near.assumed_human_speed_m_s(np.array([0.0, 1.0, 1.1])).tolist() == [2.5, 2.5, 1.6]
    with pytest.raises(ValueError, match="near_human_speed_m_s is 2000 but must be at most 20 m/s"):
        SsmSeparation(near_human_speed_m_s=2000.0)


@pytest.mark.parametrize(("speed", "broken"), [(2.0, False), (above(2.0), True), (below(2.0), False)])
def test_the_speed_cap(speed: float, broken: bool) -> None:
    # 2.6 + 1.0 * 2.5 + v * 1.0 = 7.1 gives v = 2.0 with numbers that are exact in float64 below.
    monitor = SsmSpeedCap(t1_s=1.0, t2_s=1.5, delta_m=2.5)
    columns = {"centre_distance/r/h": ("m", 7.0), "speed/h": ("m/s", 1.0), "speed/r": ("m/s", speed)}

    assert violated(monitor, trial_of(columns)) is broken


@pytest.mark.parametrize(("speed", "broken"), [(0.02, False), (above(0.02), True), (0.0, False)])
def test_the_tolerance_of_the_response(speed: float, broken: bool) -> None:
    # In breach from the first sample, at rest there: from then on only the tolerance is allowed.
    speeds = np.full(101, speed)
    speeds[0] = 0.0
    columns = {"centre_distance/r/h": ("m", 1.0), "speed/h": ("m/s", 0.0), "speed/r": ("m/s", speeds)}

    assert violated(SsmResponse(), trial_of(columns)) is broken


def test_the_limits_of_contact(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, float, float, bool]] = [
        ("hand", 280.0, 0.2, False),
        ("hand", above(280.0), 0.2, True),
        ("hand", 140.0, 2.0, False),
        ("hand", above(140.0), 2.0, True),
        ("lower leg", 130.0, 2.0, False),
        ("lower leg", 131.0, 2.0, True),
        ("pelvis", 180.0, 2.0, False),
        ("pelvis", 181.0, 2.0, True),
    ]
    for region, force, seconds, broken in cases:
        with subtests.test(region=region, force=force, seconds=seconds):
            t = np.arange(401) / 100
            trial = trial_of(
                {"contact_force/r/h": ("N", np.where((t >= 1) & (t < 1 + seconds), force, 0.0))}, t=t
            )

            finding = only(PflContact(region=region), trial)

            assert (finding.verdict, finding.critical) == (VIOLATED if broken else SATISFIED, broken)


@pytest.mark.parametrize(("force", "touched"), [(5.0, False), (above(5.0), True)])
def test_the_threshold_of_contact(force: float, touched: bool) -> None:
    finding = only(PflContact(region="hand"), trial_of({"contact_force/r/h": ("N", force)}))

    assert finding.verdict is SATISFIED
    assert finding.quantities["contacts"] == float(touched)


@pytest.mark.parametrize("region", ["face", "skull_forehead", "temple"])
@pytest.mark.parametrize("force", [5.1, 30.0, 500.0])
def test_contact_with_head_or_face_is_critical_however_light(region: str, force: float) -> None:
    finding = only(PflContact(region=region), trial_of({"contact_force/r/h": ("N", force)}))

    assert (finding.verdict, finding.critical) == (VIOLATED, True)


@pytest.mark.parametrize(("shift", "broken"), [(below, False), (float, False), (above, True)])
@pytest.mark.parametrize("when", ["contact", "near"])
def test_the_permitted_speed_of_contact(when: Any, shift: Callable[[float], float], broken: bool) -> None:
    monitor = PflSpeed(region="chest", load_kg=2.0, contact_area_m2=None, when=when)
    v = shift(monitor.permitted().speed_m_s)
    assert v == pytest.approx(0.4956342737677988)  # W5.1
    columns = {
        "separation/r/h": ("m", 0.0),
        "relative_speed/r/h": ("m/s", v),
        "approach_speed_robot/r/h": ("m/s", v),
        "approach_speed_human/r/h": ("m/s", 0.0),
    }

    assert violated(monitor, trial_of(columns)) is broken


@pytest.mark.parametrize(("speed", "broken"), [(0.25, False), (above(0.25), True), (below(0.25), False)])
@pytest.mark.parametrize("quantity", ["speed", "tcp_speed"])
def test_reduced_speed(quantity: Any, speed: float, broken: bool) -> None:
    assert violated(ReducedSpeed(speed=quantity), trial_of({f"{quantity}/r": ("m/s", speed)})) is broken


@pytest.mark.parametrize(("speed", "broken"), [(0.01, False), (above(0.01), True)])
def test_standstill(speed: float, broken: bool) -> None:
    columns = {"position/h": ("m", [1.0, 1.0, 0.0]), "speed/r": ("m/s", speed)}

    assert violated(MonitoredStandstill(workspace=SQUARE), trial_of(columns)) is broken


@pytest.mark.parametrize(("drift", "broken"), [(0.005, False), (above(0.005), True)])
def test_drift_while_standing_still(drift: float, broken: bool) -> None:
    # In the workspace all the time; at rest after 0.5 s; 9 s later it has crept away.
    t = np.arange(1001) / 100
    where = np.zeros((len(t), 3))
    where[t > 5, 0] = drift
    columns = {
        "position/h": ("m", np.tile([1.0, 1.0, 0.0], (len(t), 1))),
        "position/r": ("m", where),
        "speed/r": ("m/s", 0.0),
    }

    assert violated(MonitoredStandstill(workspace=SQUARE), trial_of(columns, t=t)) is broken


def test_the_edge_of_a_workspace_belongs_to_it(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, bool]] = [(4.0, True), (above(4.0), False), (0.0, True), (-1e-9, False)]
    for x, inside in cases:
        with subtests.test(x=x, inside=inside):
            columns = {"position/h": ("m", [x, 1.0, 0.0]), "speed/r": ("m/s", 1.0)}

            assert violated(MonitoredStandstill(workspace=SQUARE), trial_of(columns)) is inside


def stopping(brake_s: float, *, kind: str = "protective_stop", power: Any = None) -> Trial:
    """At 1 m/s, ordered to stop at 1.0 s, rests at 1.0 s + brake_s."""
    t = np.arange(501) / 100
    speed = np.clip(1.0 - (t - 1.0) / brake_s, 0.0, 1.0)
    columns = {"speed/r": ("m/s", speed)}
    if power is not None:
        columns["drive_enabled/r"] = ("1", (t < power).astype(float))
    return trial_of(columns, t=t, events=[Event(1.0, kind)])


@pytest.mark.parametrize(("brake_s", "broken"), [(0.5, False), (0.51, True)])
def test_the_time_of_a_stop(brake_s: float, broken: bool) -> None:
    # Standstill at 0.01 m/s is reached 0.99 of the way: 0.495 s and 0.5049 s after the request.
    monitor = StopPerformance(max_time_s=0.5)

    assert violated(monitor, stopping(brake_s)) is broken


@pytest.mark.parametrize(("limit_m", "broken"), [(0.2501, False), (0.2499, True)])
def test_the_way_of_a_stop(limit_m: float, broken: bool) -> None:
    # 0.5 * 1 m/s * 0.5 s = 0.25 m
    assert violated(StopPerformance(max_distance_m=limit_m), stopping(0.5)) is broken


def test_the_category_of_a_stop(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, str, str, bool]] = [
        (1.2, "emergency_stop", "0", False),
        (2.0, "emergency_stop", "1", False),
        (9.0, "emergency_stop", "2", True),
        (9.0, "protective_stop", "2", False),
    ]
    for power_off_s, kind, category, broken in cases:
        with subtests.test(power_off_s=power_off_s, kind=kind, category=category):
            finding = only(StopPerformance(), stopping(0.4, kind=kind, power=power_off_s))

            assert finding.labels["category"] == category
            assert (finding.verdict is VIOLATED) is broken


def test_a_stop_that_is_violated_by_its_way_or_its_power_has_no_margin_of_time() -> None:
    # From 1 m/s to 0 in 0.5 s: 0.25 m, in time for the default limit of 0.5 s.
    (too_far,) = StopPerformance(max_distance_m=0.2).watch(stopping(0.5))
    (powered,) = StopPerformance().watch(stopping(0.5, kind="emergency_stop", power=9.0))
    (too_late,) = StopPerformance(max_time_s=0.4, max_distance_m=0.2).watch(stopping(0.5))

    assert too_far.verdict is powered.verdict is too_late.verdict is VIOLATED
    assert (too_far.robustness, too_far.unit) == (pytest.approx(0.2 - 0.25, abs=1e-3), "m")
    assert (powered.robustness, powered.unit) == (None, "")
    assert too_late.robustness == pytest.approx(0.4 - 0.5 + 0.005, abs=1e-3)  # 0.01 m/s 0.005 s before rest
    assert too_late.unit == "s"


def test_the_margin_of_a_stop_is_that_of_the_limit_it_breaks() -> None:
    in_time = only(StopPerformance(max_distance_m=0.2), stopping(0.5))  # 0.25 m, as above
    powered = only(StopPerformance(), stopping(0.4, kind="emergency_stop", power=9.0))

    assert (in_time.verdict, in_time.robustness, in_time.unit) == (VIOLATED, pytest.approx(-0.05), "m")
    assert (powered.verdict, powered.robustness, powered.unit) == (VIOLATED, None, "")


@pytest.mark.parametrize(("off", "standstill", "category"), [(below(1.0), 1.0, 0), (1.0, 1.0, 1)])
def test_power_that_goes_off_at_standstill_is_category_1(
    off: float, standstill: float, category: int
) -> None:
    assert stop_category(off, standstill) == category


def test_a_machine_that_never_stops() -> None:
    trial = trial_of({"speed/r": ("m/s", 1.0)}, n=501, events=[Event(1.0, "emergency_stop")])

    finding = only(StopPerformance(), trial)

    assert (finding.verdict, finding.critical) == (VIOLATED, True)
    assert "no stop" in finding.message


def test_a_violation_too_short_to_count_is_not_worded_as_a_limit_that_is_kept() -> None:
    t = np.arange(101) / 100
    trial = trial_of({"position/h": ("m", [1.0, 1.0, 0.0]), "speed/r": ("m/s", np.where(t == 0.8, 9.0, 0.0))})

    brief = only(MonitoredStandstill(workspace=SQUARE, t_on_s=0.03), trial)

    assert (brief.verdict, brief.robustness) == (SATISFIED, pytest.approx(0.01 - 9.0))
    assert brief.message == (
        "speed in the workspace never beyond its limit for 0.03 s; "
        "at worst 9.000 m/s (at most 0.010), at 0.800 s"
    )
    assert only(MonitoredStandstill(workspace=SQUARE, t_on_s=0.0), trial).verdict is VIOLATED


def test_a_brief_approach_is_not_worded_as_distance_to_spare() -> None:
    t = np.arange(101) / 100
    distance = Signal("separation/r/h", "m", t, np.where(t == 0.5, 0.0, 5.0))
    trial = replace(separated(5.0), signals={**separated(5.0).signals, distance.name: distance})

    brief = only(SsmSeparation(profile="standard", t_on_s=0.5), trial)

    assert brief.verdict is SATISFIED
    assert brief.message == (
        f"never too close for 0.5 s; at worst {required(0.5):.3f} m nearer than required, at 0.500 s"
    )


def test_a_brief_breach_of_a_formula_is_not_worded_as_one_that_holds() -> None:
    t = np.arange(101) / 100
    trial = trial_of({"speed/r": ("m/s", np.where(t == 0.5, 3.0, 0.0))})

    brief = only(Always(holds="v < 1", signals={"v": "speed/{robot}"}, unit="m/s", t_on_s=0.5), trial)

    assert brief.verdict is SATISFIED
    assert brief.message == "'v < 1' never broken for 0.5 s; at worst by 2.000 m/s, at 0.500 s"


@pytest.mark.parametrize(("speed", "broken"), [(0.01, False), (above(0.01), True)])
def test_motion_after_an_emergency_stop(speed: float, broken: bool) -> None:
    t = np.arange(501) / 100
    events = [Event(1.0, "emergency_stop"), Event(3.0, "emergency_stop_reset"), Event(4.0, "start")]
    trial = trial_of({"speed/r": ("m/s", np.where(t >= 3.5, speed, 0.0))}, t=t, events=events)

    assert violated(EstopRestart(), trial) is broken


@pytest.mark.parametrize(
    ("stop_s", "rests_s", "verdict"),
    [
        (4.5, 9.0, INCONCLUSIVE),  # rest is due after 1 s, and the log ends after 0.5 s
        (5.0, 9.0, INCONCLUSIVE),
        (7.0, 9.0, INCONCLUSIVE),
        (5.0, 0.0, INCONCLUSIVE),  # at rest is only who rests for 0.1 s
        (4.0, 9.0, VIOLATED),
        (4.5, 4.8, SATISFIED),
    ],
)
def test_a_stop_near_the_end_of_the_log_is_open_unless_coming_to_rest_is_seen(
    stop_s: float, rests_s: float, verdict: Verdict
) -> None:
    t = np.arange(501) / 100
    events = [Event(stop_s, "emergency_stop")]
    recorded = ("emergency_stop", "emergency_stop_reset", "start")
    speed = np.where(t < rests_s, 0.5, 0.0)
    trial = trial_of({"speed/r": ("m/s", speed)}, t=t, events=events, witnessed=recorded)

    assert only(EstopRestart(), trial).verdict is verdict


def test_a_machine_that_starts_again_before_rest_is_due_breaks_nothing() -> None:
    t = np.arange(501) / 100
    events = [Event(4.5, "emergency_stop"), Event(4.6, "emergency_stop_reset"), Event(4.7, "start")]

    assert only(EstopRestart(), trial_of({"speed/r": ("m/s", 0.5)}, t=t, events=events)).verdict is SATISFIED


def test_hand_guiding(subtests: pytest.Subtests) -> None:
    cases: list[tuple[int, float, bool]] = [
        (1, 0.25, False),
        (1, above(0.25), True),
        (0, 0.01, False),
        (0, above(0.01), True),
    ]
    for held, speed, broken in cases:
        with subtests.test(held=held, speed=speed, broken=broken):
            trial = trial_of({"enabling_device/r": ("1", held), "speed/r": ("m/s", speed)})

            assert violated(HandGuiding(), trial) is broken


def test_the_distance_of_a_safeguard(subtests: pytest.Subtests) -> None:
    cases: list[tuple[Any, Any, Any, float]] = [
        ("2010", "orthogonal", {"stopping_time_s": 0.2, "resolution_m": 0.0265}, 500.0),  # 400 + 100
        ("2010", "orthogonal", {"stopping_time_s": 0.25, "resolution_m": 0.0265}, 500.0),  # 400 + 100 again
        ("2010", "orthogonal", {"stopping_time_s": 0.26, "resolution_m": 0.0265}, 516.0),  # 416 + 100
        ("2010", "orthogonal", {"stopping_time_s": 0.05, "resolution_m": 0.014}, 100.0),
        ("2010", "orthogonal", {"stopping_time_s": 0.051, "resolution_m": 0.014}, 102.0),
        ("2010", "orthogonal", {"stopping_time_s": 0.1, "resolution_m": 0.04}, 408.0),  # 200 + 208
        ("2010", "orthogonal", {"stopping_time_s": 0.1, "resolution_m": 0.041}, 1010.0),  # 160 + 850
        ("2024", "orthogonal", {"stopping_time_s": 0.1, "resolution_m": 0.041}, 500.0),  # 420, at least 500
        ("2024", "orthogonal", {"stopping_time_s": 0.2, "resolution_m": 0.055}, 708.0),  # 320 + 388
        ("2024", "orthogonal", {"stopping_time_s": 0.2, "resolution_m": 0.056}, 1170.0),  # 320 + 850
        ("2010", "parallel", {"stopping_time_s": 0.1, "height_m": 0.875}, 1010.0),  # 160 + 850, both agree
        ("2010", "parallel", {"stopping_time_s": 0.1, "height_m": 0.87}, 1012.0),  # 160 + 852
        ("2024", "parallel", {"stopping_time_s": 0.1, "height_m": 0.3, "supplement_m": 0.1}, 1460.0),
        ("2010", "whole_body", {"stopping_time_s": 0.5}, 1650.0),
        ("2010", "two_hand", {"stopping_time_s": 0.5}, 1050.0),
        ("2010", "two_hand", {"stopping_time_s": 0.5, "covered": True}, 800.0),
        ("2024", "two_hand", {"stopping_time_s": 0.5}, 1350.0),
        ("2010", "interlocked_guard", {"stopping_time_s": 0.5, "reach_m": 0.12}, 920.0),
    ]
    for edition, arrangement, numbers, total_mm in cases:
        with subtests.test(total_mm=total_mm):
            assert 1000 * minimum_distance(edition, arrangement, **numbers).total_m == pytest.approx(total_mm)


@pytest.mark.parametrize(("x", "broken"), [(-0.852, False), (-0.851, False), (-0.849, True)])
def test_where_a_sensing_line_stands(x: float, broken: bool) -> None:
    # d = 14 mm, T = 0.53125 s: 1062 > 500, so 1.6 * 0.53125 = 0.85 m
    monitor = SafeguardDistance(
        stopping_time_s=0.53125, resolution_m=0.014, line=((x, 0.0), (x, 4.0)), hazard=SQUARE
    )
    columns = {"position/h": ("m", [-9.0, 0.0, 0.0]), "speed/r": ("m/s", 1.0)}

    found = {f.subject: f.verdict for f in monitor.watch(trial_of(columns))}

    assert found["trial"] is (VIOLATED if broken else SATISFIED)
    assert found["r/h"] is NOT_APPLICABLE


@pytest.mark.parametrize(
    ("x_before", "moves_until_s", "broken"),
    [
        (1.0, 1.5, Span(1.125, 1.5)),  # past the line on both sides of the gap
        (-1.0, 1.5, Span(1.125, 1.5)),  # crossed it unseen, at the end of the gap at the latest
        (-1.0, 1.12, None),  # the robot rests within 0.125 s of that
    ],
)
def test_who_is_past_a_sensing_line_after_a_gap_is_judged_from_its_end_on(
    x_before: float, moves_until_s: float, broken: Span | None
) -> None:
    # The line is at x = 0, the hazard 4 m behind it. The gap is from 0.5 to 1 s.
    t = np.concatenate((np.arange(51) / 100, np.arange(100, 201) / 100))
    columns = {
        "position/h": ("m", [[x_before if at <= 0.5 else 1.0, 0.5, 0.0] for at in t]),
        "speed/r": ("m/s", np.where((t > 0.5) & (t < moves_until_s), 1.0, 0.0)),
    }
    monitor = SafeguardDistance(
        stopping_time_s=0.125,
        line=((0.0, 1.0), (0.0, 0.0)),
        hazard=((4.0, 0.0), (5.0, 0.0), (5.0, 1.0), (4.0, 1.0)),
    )

    found = [f for f in monitor.watch(trial_of(columns, t=t)) if f.subject == "r/h"]

    (gap,) = (f for f in found if f.verdict is INCONCLUSIVE)
    assert gap.span == Span(0.5, 1.0)
    spans = [f.span for f in found if f.verdict is VIOLATED]
    if broken is None:
        assert spans == []
    else:
        ((start_s, end_s),) = ((s.start_s, s.end_s) for s in spans if s)
        assert start_s == pytest.approx(broken.start_s, abs=0.0051)  # the sample at 1.13 s
        assert end_s == pytest.approx(broken.end_s, abs=1e-9)


def test_the_speed_of_a_truck(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, int, float, bool]] = [
        (above(0.5), 1, 1.5, False),
        (above(0.5), 1, above(1.5), True),
        (0.5, 1, 0.3, False),
        (0.5, 1, above(0.3), True),
        (9.0, 0, 0.3, False),
        (9.0, 0, above(0.3), True),
    ]
    for clearance, active, speed, broken in cases:
        with subtests.test(clearance=clearance, active=active, speed=speed):
            columns = {
                "speed/a": ("m/s", speed),
                "clearance/a": ("m", clearance),
                "personnel_detection/a": ("1", active),
            }

            assert violated(AgvSpeedClearance(), trial_of(columns, bodies=[Body("a", "agv", 0.0)])) is broken


def test_detection_that_is_not_recorded_is_taken_for_active_with_a_label() -> None:
    columns = {"speed/a": ("m/s", 1.0), "clearance/a": ("m", 1.0)}

    finding = only(AgvSpeedClearance(), trial_of(columns, bodies=[Body("a", "agv", 0.0)]))

    assert finding.labels == {"personnel_detection": "assumed active"}


@pytest.mark.parametrize(("y", "broken"), [(1.09, False), (1.11, True)])
def test_the_clearance_of_a_truck_comes_from_a_map_too(y: float, broken: bool) -> None:
    # The wall begins at y = 2; radius 0.4 m: 0.51 and 0.49 m are free.
    wall = ((-9.0, 2.0), (9.0, 2.0), (9.0, 3.0), (-9.0, 3.0))
    columns = {"speed/a": ("m/s", 1.0), "position/a": ("m", [0.0, y, 0.0])}
    trial = trial_of(columns, bodies=[Body("a", "agv", 0.4)])

    assert violated(AgvSpeedClearance(obstacles=(wall,)), trial) is broken


@pytest.mark.parametrize(("gap", "touch"), [(0.0, True), (above(0.0), False)])
def test_a_truck_that_touches_somebody(gap: float, touch: bool) -> None:
    columns = {
        "position/a": ("m", [0.0, 0.0, 0.0]),
        "velocity/a": ("m/s", [0.5, 0.0, 0.0]),
        "position/h": ("m", [0.0, 5.0, 0.0]),
        "body_separation/a/h": ("m", gap),
    }
    trial = trial_of(columns, bodies=[Body("a", "agv", 0.0), Body("h", "human", 0.0)])

    found = [f for f in AgvProtectiveField().watch(trial) if f.critical]

    assert bool(found) is touch


@pytest.mark.parametrize(("x", "broken"), [(1.0, False), (above(1.0), True), (-1.0, False)])
def test_the_border_of_a_space(x: float, broken: bool) -> None:
    monitor = SpaceLimit(box_low_m=(-1.0, -1.0, -1.0), box_high_m=(1.0, 1.0, 1.0))

    assert violated(monitor, trial_of({"position/r": ("m", [x, 0.0, 0.0])})) is broken


def test_the_border_of_a_zone_to_keep_out_of(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, bool]] = [(0.0, False), (1e-9, True), (-1e-9, False), (4.0, False)]
    for x, broken in cases:
        with subtests.test(x=x, broken=broken):
            trial = trial_of({"position/r": ("m", [x, 1.0, 0.0])})

            assert violated(SpaceLimit(keep_out=(SQUARE,)), trial) is broken


def test_a_zone_to_keep_out_of_may_have_heights(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, bool]] = [
        (0.5, True),
        (1.0, False),
        (above(1.0), False),
        (0.0, False),
        (below(1.0), True),
    ]
    for z, broken in cases:
        with subtests.test(z=z, broken=broken):
            limit = SpaceLimit(keep_out=(SQUARE,), keep_out_z_m=(0.0, 1.0))
            trial = trial_of({"position/r": ("m", np.tile([2.0, 2.0, z], (101, 1)))})

            assert violated(limit, trial) is broken
            assert violated(SpaceLimit(keep_out=(SQUARE,)), trial)
            if broken:  # the way out is up or down, which is nearer than any side
                assert only(limit, trial).robustness == pytest.approx(-min(z, 1.0 - z))


@pytest.mark.parametrize(("z", "broken"), [(2.0, False), (above(2.0), True), (3.0, False)])
def test_a_zone_to_keep_out_of_may_begin_above_the_floor(z: float, broken: bool) -> None:
    limit = SpaceLimit(keep_out=(SQUARE,), keep_out_z_m=(2.0, 3.0))

    assert violated(limit, trial_of({"position/r": ("m", np.tile([2.0, 2.0, z], (101, 1)))})) is broken


@pytest.mark.parametrize(("angle", "broken"), [(2.0, False), (above(2.0), True), (below(-1.0), True)])
def test_the_limits_of_a_joint(angle: float, broken: bool) -> None:
    monitor = SpaceLimit(joint="j", joint_low_rad=-1.0, joint_high_rad=2.0)

    assert violated(monitor, trial_of({"joint_position/r::j": ("rad", angle)})) is broken


def test_the_gap_that_crushes(subtests: pytest.Subtests) -> None:
    cases = MINIMUM_GAP_M
    for part in cases:
        with subtests.test(part=part):
            least = MINIMUM_GAP_M[part][0]

            assert clamps(part, np.array([below(least), least, above(least)]), True).tolist() == [
                True,
                False,
                False,
            ]
            assert not clamps(part, np.array([below(least)]), False).any()


def test_a_collision_counts_again_after_5_s(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, bool, int]] = [
        (4.99, True, 1),
        (5.0, True, 2),
        (5.0, False, 1),
        (5.01, False, 2),
        (10.0, False, 2),
        (0.0, False, 1),
    ]
    for duration, closed_right, times in cases:
        with subtests.test(duration=duration, closed_right=closed_right, times=times):
            assert occurrences(duration, closed_right=closed_right) == times


@pytest.mark.parametrize(("limit", "verdict"), [(0.02, SATISFIED), (0.0199, VIOLATED)])
def test_a_limit_of_pose_accuracy(limit: float, verdict: Verdict) -> None:
    # W17.1: AP = 0.020, here with the limit a hair above what float64 makes of it.
    points = [[10.1, 0, 0], [9.9, 0, 0], [10, 0.1, 0], [10, -0.1, 0], [10.1, 0, 0]]
    trial = trial_of(
        {"position/r": ("m", np.array(points))},
        t=np.arange(5) / 100,
        events=[Event(k / 100, "pose_attained", "r") for k in range(5)],
    )
    monitor = PoseAttained(commanded_m=(10.0, 0.0, 0.0), max_accuracy_m=limit + 1e-12)

    assert only(monitor, trial).verdict is verdict


def test_the_zones_of_proxemics(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, str]] = [
        (below(0.45), "intimate"),
        (0.45, "personal"),
        (below(1.2), "personal"),
        (1.2, "social"),
        (below(3.6), "social"),
        (3.6, "public"),
    ]
    for distance, zone in cases:
        with subtests.test(distance=distance, zone=zone):
            assert zone_of(distance) == zone
            assert zone_shares(np.array([distance]), np.array([1.0]))[zone] == 1.0


@pytest.mark.parametrize(("seconds", "broken"), [(0.95, False), (0.94, True)])
def test_time_to_collision(seconds: float, broken: bool) -> None:
    columns = {
        "separation/r/h": ("m", 1.0),
        "position/r": ("m", [0.0, 0.0, 0.0]),
        "position/h": ("m", [seconds, 0.0, 0.0]),
        "velocity/r": ("m/s", [1.0, 0.0, 0.0]),
        "velocity/h": ("m/s", [0.0, 0.0, 0.0]),
    }

    found = list(ProximityComfort().watch(trial_of(columns)))

    assert (VIOLATED in [f.verdict for f in found]) is broken
    assert not any(f.critical for f in found)


@pytest.mark.parametrize(("missing", "verdict"), [(0.1, SATISFIED), (0.11, INCONCLUSIVE)])
def test_coverage_below_99_percent_is_inconclusive(missing: float, verdict: Verdict) -> None:
    t = np.array([k / 100 for k in range(1001) if not 1.0 < k / 100 < 1.0 + missing - 1e-9])
    trial = trial_of({"position/r": ("m", [0.0, 0.0, 0.0])}, t=t, bodies=(Body("r", "robot", 0.0),))

    assert only(SignalCoverage(min_coverage=0.9900000001 - 1e-9), trial).verdict is verdict


def test_coverage_misses_what_is_published_though_nothing_else_of_its_kind_is_there() -> None:
    trial = trial_of({"position/r": ("m", [0.0, 0.0, 0.0])}, bodies=(Body("r", "robot", 0.0),))
    published = dataclasses.replace(trial, stand_ins={"position/ann": Due("/ann", 50.0)})

    assert verdicts(SignalCoverage(), trial) == [SATISFIED]
    assert verdicts(SignalCoverage(), published) == [SATISFIED, INCONCLUSIVE]


# Ten mistakes found in public code -----------------------------------------------------------------


def test_mistake_1_the_human_walks_on_while_the_robot_stops() -> None:
    monitor = SsmSeparation(
        profile="standard",
        stop_model="constant_speed",
        intrusion_m=0.12,
        human_uncertainty_m=0.10,
        robot_uncertainty_m=0.05,
    )

    assert monitor.d_min_m(np.array([1.6]), np.array([1.0]))[0] == pytest.approx(1.31)  # not 0.83


def test_mistake_2_stiffness_in_newton_per_metre_and_force_not_squared() -> None:
    hand = REGIONS["hand"]
    mu = reduced_mass_kg(hand.mass_kg, 8.9)

    assert permitted_speed_m_s(hand.force_n, mu, hand.stiffness_n_m) == pytest.approx(0.682, abs=5e-4)
    assert permitted_speed_m_s(hand.force_n, mu, 75.0) > 21.5  # what comes of N/mm


def test_mistake_3_short_contact_may_do_twice_as_much_except_on_the_head(subtests: pytest.Subtests) -> None:
    cases = REGIONS
    for name in cases:
        with subtests.test(name=name):
            monitor, limits = PflContact(region=name), body_limits(name)
            transient, lasting = monitor.limit_n(limits, np.array([True, False]))
            ratio = 1.0 if name in ("skull_forehead", "face") else 2.0

            assert transient / lasting == ratio
            assert np.divide(*monitor.limit_pa(limits, np.array([True, False]))) == ratio
            assert (REGIONS["pelvis"].force_n, REGIONS["lower_leg"].force_n) == (180, 130)


@pytest.mark.parametrize(("name", "force"), [("face", 65.0), ("skull_forehead", 130.0)])
def test_mistake_4_no_transient_factor_on_the_head(name: str, force: float) -> None:
    assert PflSpeed(region=name, contact_area_m2=None).permitted().force_n == force
    assert PflContact(region=name).limit_n(body_limits(name), np.array([True]))[0] == force


def test_mistake_5_reaction_and_stopping_path_are_not_swapped() -> None:
    monitor, v = SsmSeparation(profile="standard", t1_s=0.1, t2_s=0.4), np.array([1.0])

    assert monitor.reaction_path_m(v)[0] == pytest.approx(0.1)
    assert monitor.stopping_path_m(v)[0] == pytest.approx(0.2)


def test_mistake_6_time_differences_have_their_seconds() -> None:
    # 1 m/s across a whole second: with the nanosecond field alone the step would be -0.95 s.
    t = np.array([0.95, 1.0, 1.05])
    velocity = centred_velocity(t, np.stack([t, 0 * t, 0 * t], axis=1))[1]

    assert velocity[:, 0] == pytest.approx(1.0)


def test_mistake_7_a_retreating_person_does_not_approach() -> None:
    retreats = separated(1.0, robot=0.0, human=-2.0)
    monitor = SsmSeparation(profile="standard", human_speed="measured", robot_must_move="no")

    assert only(monitor, retreats).robustness == pytest.approx(1.0 - 0.35)
    seed = SsmSeparation().d_min_m(np.array([2.0]), np.array([0.0]))[0]
    assert seed == pytest.approx(2.0 * 2.5 + 2.6)  # the seed's formula does this on purpose


def test_mistake_8_halving_the_log_rate_moves_a_score_by_one_sample_at_most(
    subtests: pytest.Subtests,
) -> None:
    cases: list[str] = ["separation", "speed", "contact", "space"]
    for name in cases:
        with subtests.test(name=name):
            t = np.arange(1001) / 100
            wave = 0.25 + 0.2 * np.sin(t)
            cases: Mapping[str, tuple[Any, Mapping[str, tuple[str, Any]]]] = {
                "separation": (
                    SsmSeparation(delta_m=0.25),
                    {
                        "centre_distance/r/h": ("m", wave),
                        "speed/h": ("m/s", 0 * t),
                        "speed/r": ("m/s", 0 * t),
                    },
                ),
                "speed": (ReducedSpeed(), {"speed/r": ("m/s", wave)}),
                "contact": (PflContact(region="hand"), {"contact_force/r/h": ("N", 560 * wave)}),
                "space": (
                    SpaceLimit(box_high_m=(0.25, 9.0)),
                    {"position/r": ("m", np.stack([wave, 0 * t, 0 * t], axis=1))},
                ),
            }
            monitor, columns = cases[name]

            seconds = []
            for step in (1, 2):
                thinned = {n: (unit, values[::step]) for n, (unit, values) in columns.items()}
                found = [f for f in monitor.watch(trial_of(thinned, t=t[::step])) if f.verdict is VIOLATED]
                seconds.append(math.fsum(f.quantities["time_in_violation_s"] for f in found))

            assert seconds[0] > 1.0
            assert seconds[1] == pytest.approx(seconds[0], abs=2 * 0.02 + 1e-9)


def test_mistake_9_at_the_stop_boundary_the_speed_is_0_exactly(subtests: pytest.Subtests) -> None:
    cases: list[float] = [0.35, 0.5, 0.51, 0.2, 0.0]
    for distance in cases:
        with subtests.test(distance=distance):
            monitor = SsmSeparation(
                profile="standard", stop_model="deceleration", deceleration_m_s2=2.0, t1_s=0.1, delta_m=0.35
            )

            assert monitor.speed_cap_m_s(np.array([distance]), np.array([1.6]))[0] == 0.0


def test_mistake_10_a_stopping_time_in_milliseconds_is_refused() -> None:
    with pytest.raises(ValueError, match=r"stopping_time_s is 320 but must be at most 20 s \(is it given in"):
        SafeguardDistance(stopping_time_s=320.0)


def test_mistake_10_the_switch_at_500_mm_counts_the_intrusion() -> None:
    # 2000 * 0.24 = 480 alone is below 500; with 128 mm it is 608, so the walking speed counts: 512.
    found = minimum_distance("2010", "orthogonal", 0.24, resolution_m=0.03)

    assert 1000 * found.total_m == pytest.approx(512.0)


# Laws ------------------------------------------------------------------------------------------

speeds = st.floats(0.0, 5.0)
vectors = st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3)


@given(vectors, vectors, vectors, vectors)
def test_a_directed_speed_is_never_above_the_scalar_one(p_r: Any, p_h: Any, v_r: Any, v_h: Any) -> None:
    rows = [np.array([v]) for v in (p_r, p_h, v_r, v_h)]
    assume(np.linalg.norm(rows[1] - rows[0]) > 1e-3)
    found = approach_of(*rows)

    assert found.robot_m_s[0] <= np.linalg.norm(v_r) + 1e-9
    assert found.human_m_s[0] <= np.linalg.norm(v_h) + 1e-9
    step = 1e-6
    later = approach_of(rows[0] + step * rows[2], rows[1] + step * rows[3], rows[2], rows[3])
    rate = (later.distance_m[0] - found.distance_m[0]) / step
    assert rate == pytest.approx(found.distance_rate_m_s[0], abs=0.1)


@given(speeds, speeds, st.sampled_from(["linear", "deceleration", "constant_speed"]))
def test_the_speed_cap_is_the_inverse_of_the_separation(human: float, robot: float, model: Any) -> None:
    assume(robot > 1e-6)
    monitor = SsmSeparation(profile="standard", stop_model=model)
    distance = monitor.d_min_m(np.array([human]), np.array([robot]))

    assert monitor.speed_cap_m_s(distance, np.array([human]))[0] == pytest.approx(robot, abs=1e-6)


@given(speeds, speeds, speeds)
def test_more_speed_never_needs_less_distance(human: float, robot: float, more: float) -> None:
    monitor = SsmSeparation(profile="standard")

    def needed(h: float, r: float) -> float:
        return float(monitor.d_min_m(np.array([h]), np.array([r]))[0])

    assert needed(human + more, robot) >= needed(human, robot)
    assert needed(human, robot + more) >= needed(human, robot)


@given(st.floats(0.01, 1.0))
def test_a_later_reaction_costs_both_speeds(later_s: float) -> None:
    # P1.2: dS / dT_r = v_h + v_r = 2.6 m/s
    def needed(t1_s: float) -> float:
        monitor = SsmSeparation(profile="standard", t1_s=t1_s)
        return float(monitor.d_min_m(np.array([1.6]), np.array([1.0]))[0])

    assert needed(0.1 + later_s) - needed(0.1) == pytest.approx(2.6 * later_s)


@given(st.sampled_from(sorted(REGIONS)), st.floats(0.1, 1000.0), st.floats(0.1, 1000.0))
def test_a_heavier_robot_is_permitted_less(region: str, mass: float, more: float) -> None:
    def permitted(kg: float) -> float:
        return PflSpeed(region=region, robot_mass_kg=kg).permitted().speed_m_s

    assert permitted(mass + more) < permitted(mass)


@given(st.floats(0.0, 100.0), st.floats(0.0, 100.0))
def test_a_longer_collision_never_counts_less(duration: float, more: float) -> None:
    assert occurrences(duration + more) >= occurrences(duration) >= 1
    assert occurrences(duration, weight=2) == 2 * occurrences(duration)
    assert occurrences(duration, closed_right=False) <= occurrences(duration)


@given(st.lists(vectors, min_size=2, max_size=8), vectors)
def test_repeatability_is_the_same_wherever_the_pose_is(points: Any, offset: Any) -> None:
    here = pose_performance(np.array(points), np.zeros(3))
    there = pose_performance(np.array(points) + np.array(offset), np.array(offset))

    assert there.repeatability_m == pytest.approx(here.repeatability_m, abs=1e-9)
    assert there.accuracy_m == pytest.approx(here.accuracy_m, abs=1e-9)
    assert here.repeatability_m >= here.spread_mean_m


@given(st.floats(-3.0, 3.0), st.integers(-2, 2))
def test_a_whole_turn_is_no_error_of_an_angle(yaw: float, turns: int) -> None:
    plain = angle_performance(np.array([yaw, yaw + 0.01]), yaw)
    turned = angle_performance(np.array([yaw + 2 * np.pi * turns, yaw + 0.01]), yaw)

    assert turned == pytest.approx(plain, abs=1e-9)


@given(st.floats(0.0, 10.0), st.floats(0.0, 10.0), st.floats(0.01, 5.0))
def test_time_to_collision_of_discs_on_a_line(gap: float, radius: float, closing: float) -> None:
    apart, relative = np.array([[gap + radius, 0.0]]), np.array([[-closing, 0.0]])

    assert time_to_collision_s(apart, relative, radius)[0] == pytest.approx(gap / closing, abs=1e-6)
    if gap > 1e-6:
        assert time_to_collision_s(apart, -relative, radius)[0] == math.inf


@given(st.lists(st.floats(0.0, 5.0), min_size=2, max_size=20))
def test_ways_add_up(speed: list[float]) -> None:
    t, middle = np.arange(len(speed)) * 0.1, 0.1 * (len(speed) - 1) / 3
    whole = travelled_m(t, np.array(speed), Span(0.0, float(t[-1])))
    parts = [
        travelled_m(t, np.array(speed), span) for span in (Span(0.0, middle), Span(middle, float(t[-1])))
    ]

    assert math.fsum(parts) == pytest.approx(whole, abs=1e-9)


@given(st.floats(-2, 2), st.floats(-2, 2))
def test_who_closes_in_is_the_same_seen_from_both_sides(robot: float, human: float) -> None:
    swapped = {"robot": "human", "human": "robot"}
    by = closing_by(robot, human)

    assert closing_by(human, robot) == swapped.get(by, by)


def test_a_jump_splits_a_track_and_is_never_a_speed() -> None:
    # W19.2: 8 m in one sample of 0.01 s
    t = np.arange(21) / 100
    where = np.zeros((21, 3))
    where[10:, 0] = 8.0

    assert len(tracks_of(t, where, teleport_speed_m_s=5.0)) == 2
    assert np.abs(centred_velocity(t, where)[1]).max() == 0.0


# The table of the body ----------------------------------------------------------------------------


def test_the_table_of_the_body_is_the_one_of_the_sources() -> None:
    file = SHARED / "standards" / "pfl_limits.csv"
    if not file.is_file():
        pytest.skip("the table of body regions (../shared/standards) is not here")
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))

    assert len(rows) == len(AREAS) == 29
    status = {"V": "verified", "P": "from memory", "M": "from memory"}
    for row, area in zip(rows, AREAS.values(), strict=True):
        region = REGIONS[area.region]
        assert area.number == int(row["area_id"])
        assert region.title == row["body_region"]
        assert area.pressure_pa == pytest.approx(1e4 * float(row["p_qs_N_per_cm2"]))
        assert region.stiffness_n_m == pytest.approx(1000 * float(row["K_N_per_mm"]))
        assert (region.mass_kg, region.force_n) == (float(row["m_H_kg"]), float(row["F_qs_N"]))
        assert region.contact_permitted == (row["contact_permitted"] == "yes")
        assert region.energy_a4_j == float(row["E_tableA4_J"])
        assert area.pressure.status == status[row["p_verified"]]
        assert region.force.status == status[row["F_verified"]]
        assert region.energy_a4 == status[row["E_tableA4_verified"][0]]


@pytest.mark.parametrize("name", ["lower leg", "Lower-Leg", " lower_leg "])
def test_a_region_is_found_however_it_is_written(name: str) -> None:
    assert body_limits(name).region.name == "lower_leg"


def test_an_unknown_region_takes_the_weakest_at_its_height(subtests: pytest.Subtests) -> None:
    # Below the floor and above the hand nothing can be met, so that the face counts, the weakest of all.
    cases = [(-0.05, 65.0), (0.1, 130.0), (1.6, 65.0), (2.4, 140.0), (5.0, 65.0)]
    for height, force in cases:
        with subtests.test(height=height, force=force):
            assert limits_at(height).force_n == force
            trial = trial_of({"contact_force/r/h": ("N", 64.0), "contact_height/r/h": ("m", height)})
            finding = only(PflContact(), trial)
            assert (finding.labels["region"], finding.labels["region_known"]) == (
                limits_at(height).name,
                "no",
            )
            assert (finding.verdict, finding.critical) == (
                SATISFIED,
                False,
            )  # nobody knows that it was the face


@pytest.mark.parametrize(("of_the_limit", "verdict"), [(0.5, SATISFIED), (1.0, SATISFIED), (1.1, VIOLATED)])
def test_a_point_that_presses_too_hard_violates_however_small_its_force(
    of_the_limit: float, verdict: Verdict
) -> None:
    monitor = PflContact(region="hand", clamped=True)
    limit_pa = float(monitor.limit_pa(body_limits("hand"), np.array([False]))[0])
    columns = {
        "contact_force/r/h": ("N", 6.0),  # hardly a contact
        "contact_pressure/r/h": ("Pa", of_the_limit * limit_pa),
    }

    finding = only(monitor, trial_of(columns))

    assert finding.verdict is verdict
    assert finding.robustness == pytest.approx(1.0 - of_the_limit)


def test_the_log_names_the_region_of_a_contact() -> None:
    trial = trial_of({"contact_force/r/h": ("N", 150.0)}, events=[Event(0.0, "contact", "r/h", "chest")])

    assert only(PflContact(), trial).labels["region"] == "chest"


def test_an_unknown_region_in_the_log_is_named_and_undecided() -> None:
    trial = trial_of({"contact_force/r/h": ("N", 150.0)}, events=[Event(0.0, "contact", "r/h", "cheest")])

    finding = only(PflContact(), trial)

    assert finding.verdict is INCONCLUSIVE
    assert "'cheest' is unknown; did you mean 'chest'?" in finding.message


def test_of_two_regions_named_for_one_contact_the_weaker_counts() -> None:
    events = [Event(0.1, "contact", "r/h", "back_shoulders"), Event(0.2, "contact", "r/h", "abdomen")]
    trial = trial_of({"contact_force/r/h": ("N", 150.0)}, events=events)

    assert only(PflContact(), trial).labels["region"] == "abdomen"


def test_contact_without_force_is_named_and_undecided() -> None:
    trial = trial_of({"speed/r": ("m/s", 0.0)}, events=[Event(0.5, "contact", "r/h", "hand")])

    finding = only(PflContact(), trial)

    assert finding.verdict is INCONCLUSIVE
    assert "contact at 0.500 s without a force: signal 'contact_force/r/h'" in finding.message


def test_a_clamped_hand_has_the_lower_limit_from_the_beginning() -> None:
    columns = {"contact_force/r/h": ("N", 200.0)}

    assert not violated(PflContact(region="hand"), trial_of(columns, n=20))
    assert violated(PflContact(region="hand", clamped=True), trial_of(columns, n=20))
    assert violated(PflContact(region="hand"), trial_of({**columns, "clamped/r/h": ("1", 1.0)}, n=20))


def test_a_gap_that_closes_on_a_body_part_clamps_it(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, float, bool]] = [
        ("hand", 90.0, True),  # W15.1, W15.2
        ("hand", 110.0, False),
        ("hand", 100.0, False),
        ("chest", 499.0, True),
        ("chest", 500.0, False),
        ("lower_leg", 179.0, True),
        ("neck", 299.0, True),
    ]
    for region, gap_mm, clamped in cases:
        with subtests.test(region=region, gap_mm=gap_mm, clamped=clamped):
            t = np.arange(20) / 100
            force = 1.5 * REGIONS[region].force_n  # below the limit of a short contact, above the other
            columns = {
                "contact_force/r/h": ("N", np.full(20, force)),
                "crush_gap/r/h": ("m", gap_mm / 1000 + 1e-6 * (t[-1] - t)),
            }

            assert violated(PflContact(region=region), trial_of(columns, t=t)) is clamped
            opens = {**columns, "crush_gap/r/h": ("m", gap_mm / 1000 + 1e-6 * t)}
            assert not violated(PflContact(region=region), trial_of(opens, t=t))


def test_every_region_of_the_body_has_a_least_gap() -> None:
    assert set(PART_OF_REGION) == set(REGIONS)
    assert set(PART_OF_REGION.values()) <= set(MINIMUM_GAP_M)


def test_a_contact_says_whether_the_robot_moved_and_who_closed_in(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, float, float, dict[str, str]]] = [
        (0.5, 0.5, 0.0, {"robot_moving": "yes", "closing_by": "robot"}),
        (0.0, 0.0, 1.2, {"robot_moving": "no", "closing_by": "human"}),
        (above(0.01), 0.3, 0.3, {"robot_moving": "yes", "closing_by": "both"}),
        (0.01, 0.0, 0.0, {"robot_moving": "no", "closing_by": "neither"}),
    ]
    for speed, robot, human, labels in cases:
        with subtests.test(speed=speed, robot=robot, human=human):
            columns = {
                "contact_force/r/h": ("N", np.where(np.arange(20) < 5, 0.0, 100.0)),
                "speed/r": ("m/s", speed),
                "approach_speed_robot/r/h": ("m/s", robot),
                "approach_speed_human/r/h": ("m/s", human),
            }
            found = only(PflContact(region="hand"), trial_of(columns, n=20))

            assert {name: found.labels[name] for name in labels} == labels


def test_a_contact_without_speeds_blames_nobody() -> None:
    found = only(PflContact(region="hand"), trial_of({"contact_force/r/h": ("N", 100.0)}, n=20))

    assert (found.labels["robot_moving"], found.labels["closing_by"]) == ("unknown", "unknown")
    assert "exposure_s" not in found.quantities


def busy(seed: int, *, clean: bool) -> Trial:
    """A robot, another one, a truck and a human with every signal there is; far apart and slow if clean."""
    rng, t = np.random.default_rng(seed), np.arange(300) / 100
    still, rows = np.zeros(len(t)), np.arange(len(t))

    def hold(*values: float) -> Any:
        """Values that stay for a while; the first alone in a clean trial."""
        picks = rng.choice(values[:1] if clean else values, len(t))
        return picks[rows - rows % int(rng.integers(5, 60))]

    columns: dict[str, tuple[str, Any]] = {
        f"{distance}/r/h": ("m", hold(50.0, 0.0, 0.05, 0.4, 3.0))
        for distance in ("separation", "centre_distance")
    }
    for body in ("r", "s", "a", "h"):
        columns[f"speed/{body}"] = ("m/s", hold(0.005, 0.2, 2.0))
        columns[f"position/{body}"] = ("m", np.stack([hold(1.0, -4.0, 5.0), still + 1, still], axis=1))
        columns[f"velocity/{body}"] = ("m/s", np.stack([hold(0.02, 0.5, 2.0), still, still], axis=1))
    columns["joint_speed/r"] = ("rad/s", hold(0.0, 0.5))
    columns["approach_speed_robot/r/h"] = columns["approach_speed_human/r/h"] = ("m/s", hold(0.0, -1.0, 2.0))
    columns["relative_speed/r/h"] = ("m/s", hold(0.0, 0.1, 3.0))
    columns["contact_force/r/h"] = columns["contact_force/r/s"] = ("N", hold(0.0, 200.0, 400.0))
    columns["contact_area/r/h"] = ("m2", still + 1e-4)
    columns["crush_gap/r/h"] = ("m", (9.0 if clean else 0.6) - t / 10)
    columns["clearance/a"] = ("m", hold(3.0, 0.3))
    columns["enabling_device/r"] = columns["manual_mode/r"] = ("1", hold(1.0, 0.0))
    events = [Event(0.5, "emergency_stop"), Event(1.5, "emergency_stop_reset"), Event(2.0, "start")]
    bodies = (
        Body("a", "agv", 0.3),
        Body("h", "human", 0.0),
        Body("r", "robot", 0.0),
        Body("s", "robot", 0.0),
    )
    seen = ("emergency_stop", "protective_stop")
    return trial_of(columns, t=t, bodies=bodies, events=events, witnessed=seen)


BUSY: Mapping[str, Any] = {
    **MONITORS,
    "iso_ts_15066.ssm_separation": SsmSeparation(
        profile="standard", reduced_mass_kg=2.0, robot_must_move="no"
    ),
    "iso_ts_15066.ssm_response": SsmResponse(delta_m=60.0, t1_s=0.0, t2_s=0.0),
    "iso_10218_2.pfl_speed": PflSpeed(when="near", near_m=60.0),
    "iso_13855.safeguard_distance": SafeguardDistance(
        line=((-3.0, 0.0), (-3.0, 4.0)), hazard=SQUARE, stopping_time_s=0.05
    ),
    "iso_3691_4.agv_protective_field": AgvProtectiveField(deceleration_m_s2=0.1),
    "ariac.human_contact": HumanContact(),
}


def test_a_formula_is_about_bodies_of_any_kind() -> None:
    t = np.arange(3) * 0.05
    near = Signal("gap/car/ann", "m", t, np.array([2.0, 0.5, 2.0]))
    cast = (Body("ann", "pedestrian", 0.0), Body("car", "vehicle", 0.0))
    trial = Trial("t", bodies=cast, signals={near.name: near}, recorded=Span(0.0, 0.1))
    apart = Always(holds="gap >= 1", signals={"gap": "gap/{vehicle}/{pedestrian} [m]"}, unit="m")

    (finding,) = apart.watch(trial)
    (nobody,) = apart.watch(replace(trial, bodies=cast[:1]))

    assert (finding.subject, finding.verdict, finding.robustness) == ("car/ann", VIOLATED, -0.5)
    assert (nobody.verdict, nobody.message) == (INCONCLUSIVE, "the log shows no vehicle")


@pytest.mark.slow
def test_what_a_violation_measures_a_clean_trial_measures_too(subtests: pytest.Subtests) -> None:
    """A price on a quantity is one in every trial; the sheet takes a name nobody has for a misspelt one."""
    cases = BUSY
    for name in cases:
        with subtests.test(name=name):
            found: dict[Verdict, set[str]] = {VIOLATED: set(), SATISFIED: set()}
            for seed in range(12):
                for clean in (False, True):
                    for finding in BUSY[name].watch(busy(seed, clean=clean)):
                        found.setdefault(finding.verdict, set()).update(finding.quantities)

            if found[SATISFIED]:
                assert found[VIOLATED] <= found[SATISFIED]
            if name not in ("log.signal_coverage", "iso_9283.pose_performance", "formula.within"):
                assert found[VIOLATED], "the trials show nothing"


def test_whatever_is_measured_is_declared_in_the_unit_that_its_name_says(subtests: pytest.Subtests) -> None:
    """The unit of a name is its end: `stop_time_s`, `travel_m`, `excess_max_m_s`, `impulse_N_s`."""
    for name in BUSY:
        with subtests.test(name=name):
            declared = BUSY[name].measures
            trials = [busy(seed, clean=clean) for seed in range(6) for clean in (False, True)]
            found = {n for trial in trials for one in BUSY[name].watch(trial) for n in one.quantities}

            assert found <= declared.keys()
            for quantity, measure in declared.items():
                if measure.unit not in ("1", "count"):
                    assert quantity.endswith("_" + re.sub("[ /]", "_", measure.unit))
                assert measure.meaning


def test_every_violation_between_two_bodies_says_who_moved_and_who_closed_in(
    subtests: pytest.Subtests,
) -> None:
    """Catalogue, 1.3 and 1.5: exposure, robot_moving, closing_by, whatever is watched of the two."""
    cases = [
        *(name for name in BUSY if name.startswith(("iso_ts_15066", "iso_10218_2.p", "iso_10218_2.m"))),
        *("iso_13855.safeguard_distance", "iso_3691_4.agv_protective_field", "proxemics.proximity_comfort"),
    ]
    for name in cases:
        with subtests.test(name=name):
            found = [
                finding
                for seed in range(12)
                for finding in BUSY[name].watch(busy(seed, clean=False))
                if finding.verdict is VIOLATED and finding.subject in ("r/h", "a/h")
            ]

            assert found
            assert {finding.labels["robot_moving"] for finding in found} <= {"yes", "no"}
            assert {finding.labels["closing_by"] for finding in found} <= {
                "robot",
                "human",
                "both",
                "neither",
            }
            assert all(0 <= finding.quantities["exposure_s"] <= 2.99 + 1e-9 for finding in found)


def test_what_a_monitor_finds_hangs_on_nothing_it_does_not_ask_for(subtests: pytest.Subtests) -> None:
    """Signals that are there because another monitor asks for them change no finding."""
    cases = BUSY
    for name in cases:
        with subtests.test(name=name):
            monitor, trial = BUSY[name], busy(3, clean=False)
            needed = {need.quantity for need in monitor.needs()}
            alone = {n: signal for n, signal in trial.signals.items() if n.partition("/")[0] in needed}

            assert list(monitor.watch(replace(trial, signals=alone))) == list(monitor.watch(trial))


def test_what_is_optional_leaves_a_monitor_decided_when_it_is_missing(subtests: pytest.Subtests) -> None:
    cases = BUSY
    for name in cases:
        with subtests.test(name=name):
            monitor, trial = BUSY[name], busy(3, clean=True)
            optional = {need.quantity for need in monitor.needs() if need.optional}
            kept = {n: signal for n, signal in trial.signals.items() if n.partition("/")[0] not in optional}

            before, after = (
                [f.verdict for f in monitor.watch(t)] for t in (trial, replace(trial, signals=kept))
            )

            assert (INCONCLUSIVE in after) is (INCONCLUSIVE in before)


# Verdicts ------------------------------------------------------------------------------------------


def test_an_empty_log_is_undecided(subtests: pytest.Subtests) -> None:
    for name in MONITORS:
        with subtests.test(name=name):
            found = list(MONITORS[name].watch(Trial("t", recorded=Span(0.0, 1.0))))

            assert found
            assert INCONCLUSIVE in [f.verdict for f in found]
            assert all(f.verdict is not VIOLATED for f in found)


def test_a_log_that_records_every_body_and_has_none_leaves_nothing_to_judge(
    subtests: pytest.Subtests,
) -> None:
    for name in MONITORS:
        with subtests.test(name=name):
            if name == "log.signal_coverage":
                pytest.skip("it asks about signals, not bodies")
            trial = Trial("t", recorded=Span(0.0, 1.0), witnessed=frozenset({"bodies"}))

            found = [f for f in MONITORS[name].watch(trial) if f.clause and "sensing line" not in f.message]

            assert [f.verdict for f in found] == [NOT_APPLICABLE]


def test_bodies_without_signals_are_undecided_and_the_signal_is_named(subtests: pytest.Subtests) -> None:
    for name in MONITORS:
        with subtests.test(name=name):
            bodies = (
                Body("a", "agv", 0.0),
                Body("h", "human", 0.0),
                Body("r", "robot", 0.0),
                Body("s", "robot", 0.0),
            )
            found = list(MONITORS[name].watch(Trial("t", bodies=bodies, recorded=Span(0.0, 1.0))))
            found = [f for f in found if "sensing line" not in f.message]

            assert {f.verdict for f in found} == {INCONCLUSIVE}
            assert all("log" in f.message or "no signal" in f.message for f in found)


def test_findings_say_derived_from_and_never_complies(subtests: pytest.Subtests) -> None:
    for name in MONITORS:
        with subtests.test(name=name):
            kind = type(MONITORS[name])
            text = inspect.getsource(kind)

            assert "compl" not in text.replace("complete", "").lower()
            for finding in MONITORS[name].watch(Trial("t", recorded=Span(0.0, 1.0))):
                standard = name.split(".", maxsplit=1)[0].startswith(("iso", "iec"))
                assert finding.clause.startswith("derived from") or not standard


def test_every_pair_of_several_robots_and_humans_is_judged(subtests: pytest.Subtests) -> None:
    cases = [
        *(name for name in MONITORS if name.startswith("iso_ts_15066")),
        *("iso_10218_2.pfl_contact", "iso_10218_2.monitored_standstill", "proxemics.proximity_comfort"),
    ]
    for name in cases:
        with subtests.test(name=name):
            robots, humans = ("r1", "r2"), ("h1", "h2", "h3")
            columns: dict[str, tuple[str, Any]] = {}
            for body in (*robots, *humans):
                columns[f"position/{body}"] = ("m", [9.0, 9.0, 0.0])
                columns[f"velocity/{body}"] = ("m/s", [0.0, 0.0, 0.0])
                columns[f"speed/{body}"] = ("m/s", 0.0)
            pairs = [f"{r}/{h}" for r in robots for h in humans]
            for pair in pairs:
                columns[f"separation/{pair}"] = ("m", 1.0)
                columns[f"contact_force/{pair}"] = ("N", 0.0)
                columns[f"approach_speed_robot/{pair}"] = ("m/s", 0.0)
                columns[f"approach_speed_human/{pair}"] = ("m/s", 0.0)
            bodies = [*(Body(r, "robot", 0.0) for r in robots), *(Body(h, "human", 0.0) for h in humans)]

            found = list(MONITORS[name].watch(trial_of(columns, bodies=bodies)))

            assert [f.subject for f in found] == pairs
            assert INCONCLUSIVE not in [f.verdict for f in found]


def test_an_episode_says_who_closed_in(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, float, str]] = [
        (0.5, 0.0, "robot"),
        (0.5, 1.0, "both"),
        (-0.5, 1.0, "human"),
        (-0.5, -0.5, "neither"),
    ]
    for robot, human, by in cases:
        with subtests.test(robot=robot, human=human, by=by):
            finding = only(SsmSeparation(profile="standard"), separated(0.2, robot=robot, human=human))

            assert dict(finding.labels) == {"robot_moving": "yes", "closing_by": by}
            assert finding.quantities["exposure_s"] == pytest.approx(1.0)


def test_a_robot_at_rest_violates_no_separation_in_the_standard_profile() -> None:
    assert only(SsmSeparation(profile="standard"), separated(0.2, robot=0.0, human=1.0)).verdict is (
        NOT_APPLICABLE
    )


def test_without_the_humans_speed_a_fixed_one_decides_and_blame_is_unknown() -> None:
    trial = separated(0.2)
    signals = {n: s for n, s in trial.signals.items() if "human" not in n}
    trial = dataclasses.replace(trial, signals=signals)

    assert only(SsmSeparation(profile="standard"), trial).labels["closing_by"] == "unknown"
    measured = SsmSeparation(profile="standard", human_speed="measured")
    assert only(measured, trial).verdict is INCONCLUSIVE


def test_the_agent_of_2023_never_sees_further_than_5_m() -> None:
    monitor = SsmSeparation(profile="ariac2023_agent")

    assert monitor.d_min_m(np.array([1.6]), np.array([1.0]))[0] == 5.0  # W1.4: 6.2, capped
    assert monitor.d_min_m(np.array([0.8]), np.array([1.0]))[0] == pytest.approx(4.2)


def test_a_robot_that_starts_again_while_somebody_is_inside_is_labelled_so() -> None:
    t = np.arange(301) / 100
    columns = {
        "position/h": ("m", np.tile([1.0, 1.0, 0.0], (len(t), 1))),
        "speed/r": ("m/s", np.where((t > 1) & (t < 2), 0.1, 0.0)),
    }

    finding = only(MonitoredStandstill(workspace=SQUARE), trial_of(columns, t=t))

    labels = {"resumed": "yes", "robot_moving": "yes", "closing_by": "unknown"}
    assert dict(finding.labels) == labels


@pytest.mark.parametrize("kind", ["bumper_contact", "power_interruption"])
def test_a_truck_may_not_start_again_after_what_else_latches(kind: str) -> None:
    # W9.2, with another reason: reset at 45.0, start at 46.0, motion at 45.1
    t = 30.0 + np.arange(1701) / 100
    events = [Event(30.0, kind), Event(45.0, "emergency_stop_reset"), Event(46.0, "start")]
    columns = {"speed/a": ("m/s", np.where(t >= 45.1 - 1e-9, 0.3, 0.0))}
    trial = trial_of(columns, t=t, events=events, bodies=(Body("a", "agv", 0.0),))
    found = only(EstopRestart(kind="agv", after=("emergency_stop", kind)), trial)

    assert (found.verdict, found.critical, found.labels["state"]) == (VIOLATED, True, "READY")
    assert f"after the {kind.replace('_', ' ')} at 30.000 s" in found.message
    assert found.quantities["before_start_s"] == pytest.approx(0.9)
    assert verdicts(EstopRestart(kind="agv"), trial) == [INCONCLUSIVE]  # no emergency stop is recorded


@pytest.mark.parametrize(
    ("hidden_s", "kept"),
    [((0.2, 0.5), True), ((2.0, 2.5), False), ((4.2, 4.5), True)],
    ids=["before the stop", "at rest", "after the start"],
)
def test_only_what_is_hidden_between_a_stop_and_the_next_start_leaves_it_open(
    hidden_s: tuple[float, float], kept: bool
) -> None:
    t = np.arange(501) / 100
    t = t[(t <= hidden_s[0]) | (t >= hidden_s[1])]
    events = [Event(1.0, "emergency_stop"), Event(3.0, "emergency_stop_reset"), Event(4.0, "start")]

    found = verdicts(EstopRestart(), trial_of({"speed/r": ("m/s", 0.0)}, t=t, events=events))

    assert (SATISFIED in found) is kept
    assert VIOLATED not in found


@pytest.mark.parametrize("missing", ["emergency_stop_reset", "start"])
def test_motion_after_a_stop_is_undecided_where_resets_or_starts_are_not_recorded(missing: str) -> None:
    t = np.arange(501) / 100
    kinds = {"emergency_stop": 1.0, "emergency_stop_reset": 3.0, "start": 3.2}
    events = [Event(at, kind) for kind, at in kinds.items() if kind != missing]
    columns = {"speed/r": ("m/s", np.where(t >= 3.5, 0.5, 0.0))}

    assert only(EstopRestart(), trial_of(columns, t=t, events=events)).verdict is INCONCLUSIVE
    witnessed = trial_of(columns, t=t, events=events, witnessed=[missing])
    assert only(EstopRestart(), witnessed).verdict is VIOLATED


@pytest.mark.parametrize(("witnessed", "verdict"), [((), INCONCLUSIVE), (("bodies",), NOT_APPLICABLE)])
def test_a_slow_zone_nobody_is_seen_in_is_free_only_if_everybody_is_recorded(
    witnessed: Any, verdict: Verdict
) -> None:
    trial = trial_of({"speed/r": ("m/s", 1.0)}, bodies=[Body("r", "robot", 0.0)], witnessed=witnessed)

    assert only(ReducedSpeed(applies="human_in_zone", zone=SQUARE), trial).verdict is verdict


def test_a_slow_zone_with_somebody_in_it() -> None:
    columns = {"speed/r": ("m/s", 1.0), "position/h": ("m", [1.0, 1.0, 0.0])}
    monitor = ReducedSpeed(applies="human_in_zone", zone=SQUARE)

    assert violated(monitor, trial_of(columns))
    assert not violated(monitor, trial_of({**columns, "position/h": ("m", [9.0, 1.0, 0.0])}))


@pytest.mark.parametrize(
    ("monitor", "columns", "names"),
    [
        (ReducedSpeed(), {"speed/r": ("m/s", 0.0)}, ("time_in_violation_s", "excess_integral_m")),
        (CollisionEpisodes(), {"in_contact/r/s": ("1", 0.0)}, ("occurrences", "length_s")),
        (PflContact(), {"contact_force/r/h": ("N", 0.0)}, ("contacts", "ratio_max")),
    ],
    ids=["speed", "collision", "contact"],
)
def test_a_clean_trial_measures_nothing_so_that_prices_may_speak_of_it(
    monitor: Any, columns: Any, names: Any
) -> None:
    bodies = [Body("r", "robot", 0.0), Body("s" if "in_contact/r/s" in columns else "h", "robot", 0.0)]
    if "contact_force/r/h" in columns:
        bodies[1] = Body("h", "human", 0.0)
    if "speed/r" in columns:
        bodies = bodies[:1]

    finding = only(monitor, trial_of(columns, bodies=bodies))

    assert finding.verdict is SATISFIED
    assert [finding.quantities[name] for name in names] == [0.0] * len(names)


def test_where_a_robot_comes_to_rest_again_is_no_drift() -> None:
    # It moves 1 m at 1 m/s while somebody is inside: one violation, of speed, and none of drift.
    t = np.arange(401) / 100
    moving = (t >= 1) & (t < 2)
    where = np.stack([np.clip(t - 1, 0, 1), 0 * t, 0 * t], axis=1)
    columns = {
        "position/h": ("m", np.tile([1.0, 1.0, 0.0], (len(t), 1))),
        "position/r": ("m", where),
        "speed/r": ("m/s", moving.astype(float)),
    }

    finding = only(MonitoredStandstill(workspace=SQUARE), trial_of(columns, t=t))

    assert finding.verdict is VIOLATED
    assert finding.unit == "m/s"


@pytest.mark.parametrize(("speed", "broken"), [(0.01, False), (above(0.01), True)])
def test_a_joint_that_turns_while_the_tool_stands_still(speed: float, broken: bool) -> None:
    columns = {
        "position/h": ("m", [1.0, 1.0, 0.0]),
        "speed/r": ("m/s", 0.0),
        "joint_speed/r": ("rad/s", speed),
    }

    assert violated(MonitoredStandstill(workspace=SQUARE), trial_of(columns)) is broken


# A gap in a signal that a log need not have, but has


def with_gap(trial: Trial, name: str, start_s: float, end_s: float) -> Trial:
    """A trial without the samples of one signal between two times."""
    signal = trial.signals[name]
    kept = (signal.t < start_s) | (signal.t > end_s)
    thinned = Signal(name, signal.unit, signal.t[kept], signal.values[kept])
    return replace(trial, signals={**trial.signals, name: thinned})


def pressed(force_n: float = 50.0, **columns: Any) -> Trial:
    """A contact from 0.40 to 0.60 s; a pressure of 1e8 Pa is beyond any limit."""
    t = np.arange(101) / 100
    force = np.where((t > 0.395) & (t < 0.605), force_n, 0.0)
    pressure = np.where((t > 0.455) & (t < 0.505), 1e8, 0.0)
    given = {"contact_force/r/h": ("N", force), "contact_pressure/r/h": ("Pa", pressure), **columns}
    return trial_of(given, t=t)


def test_a_gap_in_the_pressure_over_its_peak_leaves_a_contact_open() -> None:
    chest = PflContact(region="chest")

    assert verdicts(chest, pressed()) == [VIOLATED]
    finding = only(chest, with_gap(pressed(), "contact_pressure/r/h", 0.45, 0.51))
    assert finding.verdict is INCONCLUSIVE
    assert "the pressure is recorded, but not from 0.440 s on" in finding.message


def test_a_gap_in_the_pressure_leaves_open_no_force_that_is_too_large_and_no_other_time() -> None:
    chest = PflContact(region="chest")

    assert verdicts(chest, with_gap(pressed(1e4), "contact_pressure/r/h", 0.45, 0.51)) == [VIOLATED]
    # What was seen is a violation; how much longer it was is open, where the pressure lacks.
    seen, hidden = chest.watch(with_gap(pressed(), "contact_pressure/r/h", 0.40, 0.44))
    assert (seen.verdict, hidden.verdict) == (VIOLATED, INCONCLUSIVE)
    assert seen.quantities["time_in_violation_s"] == pytest.approx(0.05)
    assert hidden.span is not None
    assert (hidden.span.start_s, hidden.span.end_s) == (pytest.approx(0.40), pytest.approx(0.45))
    silent = replace(pressed(), signals={"contact_force/r/h": pressed().signals["contact_force/r/h"]})
    assert verdicts(chest, silent) == [SATISFIED]


@pytest.mark.parametrize(("begins_s", "verdict"), [(0.41, SATISFIED), (0.42, INCONCLUSIVE)])
def test_the_pressure_may_begin_no_later_in_a_contact_than_a_gap_may_last(
    begins_s: float, verdict: Verdict
) -> None:
    trial = pressed(**{"contact_pressure/r/h": ("Pa", 0.0)})

    found = only(PflContact(region="chest"), with_gap(trial, "contact_pressure/r/h", 0.0, begins_s - 0.005))

    assert found.verdict is verdict


def test_the_area_says_nothing_of_the_peak_where_the_pressure_has_a_gap() -> None:
    """Force over area is the mean, and no pressure is recorded there that could be above it."""
    trial = pressed(**{"contact_area/r/h": ("m2", 0.01)})
    without = replace(trial, signals={n: s for n, s in trial.signals.items() if "pressure" not in n})

    chest = PflContact(region="chest")
    assert verdicts(chest, with_gap(trial, "contact_pressure/r/h", 0.45, 0.51)) == [INCONCLUSIVE]
    assert verdicts(chest, without) == [SATISFIED]


@pytest.mark.parametrize(
    ("name", "column"),
    [
        ("joint_speed/r", ("rad/s", lambda t: np.where((t > 0.6) & (t < 0.8), 1.0, 0.0))),
        (
            "position/r",
            ("m", lambda t: np.stack([np.where((t > 0.6) & (t < 0.8), 1.0, 0), 0 * t, 0 * t], axis=1)),
        ),
    ],
)
def test_a_gap_in_the_joints_or_the_place_of_a_robot_at_rest_leaves_standstill_open(
    name: str, column: Any
) -> None:
    unit, values = column
    columns = {"position/h": ("m", [1.0, 1.0, 0.0]), "speed/r": ("m/s", 0.0)}
    trial = trial_of({**columns, name: (unit, values(np.arange(101) / 100))})
    monitor = MonitoredStandstill(workspace=SQUARE)

    assert VIOLATED in verdicts(monitor, trial)
    finding = only(monitor, with_gap(trial, name, 0.6, 0.8))
    assert finding.verdict is INCONCLUSIVE
    assert finding.message == f"no samples of {name!r} for 0.220 s, from 0.590 s"
    assert VIOLATED in verdicts(monitor, with_gap(trial, name, 0.0, 0.3))  # before rest is due


def test_drift_is_measured_from_the_first_place_that_is_known() -> None:
    t = np.arange(101) / 100
    creeping = np.stack([0.01 * t, 0 * t, 0 * t], axis=1)
    columns = {
        "position/h": ("m", [1.0, 1.0, 0.0]),
        "speed/r": ("m/s", 0.0),
        "position/r": ("m", creeping),
    }
    trial = with_gap(trial_of(columns), "position/r", 0.0, 0.025)

    assert not violated(MonitoredStandstill(workspace=SQUARE, drift_m=0.01), trial)
    # Where it came to rest nothing shows, so that it may have drifted further than from there.
    found = MonitoredStandstill(workspace=SQUARE, grace_s=0.0).watch(trial)
    assert {one.verdict for one in found} == {VIOLATED, INCONCLUSIVE}


def test_a_gap_in_the_distance_of_a_moving_truck_over_contact_is_undecided() -> None:
    t = np.arange(101) / 100
    columns = {
        "position/a": ("m", [0.0, 0.0, 0.0]),
        "velocity/a": ("m/s", [0.5, 0.0, 0.0]),
        "position/h": ("m", [0.0, 5.0, 0.0]),
        "body_separation/a/h": ("m", np.where((t > 0.45) & (t < 0.55), 0.0, 1.0)),
    }
    trial = trial_of(columns, bodies=[Body("a", "agv", 0.0), Body("h", "human", 0.0)])
    resting = trial_of(
        {**columns, "velocity/a": ("m/s", [0.0, 0.0, 0.0])},
        bodies=[Body("a", "agv", 0.0), Body("h", "human", 0.0)],
    )

    assert VIOLATED in verdicts(AgvProtectiveField(), trial)
    assert verdicts(AgvProtectiveField(), with_gap(trial, "body_separation/a/h", 0.45, 0.55)) == [
        INCONCLUSIVE
    ]
    assert INCONCLUSIVE not in verdicts(
        AgvProtectiveField(), with_gap(resting, "body_separation/a/h", 0.45, 0.55)
    )


def test_a_hole_in_the_log_during_a_stop_is_undecided() -> None:
    trial = stopping(0.4)
    speed = trial.signals["speed/r"]
    kept = (speed.t < 1.1) | (speed.t > 1.3)
    holed = Signal("speed/r", "m/s", speed.t[kept], speed.values[kept])

    found = list(StopPerformance().watch(dataclasses.replace(trial, signals={"speed/r": holed})))

    assert {f.verdict for f in found} == {INCONCLUSIVE}


@pytest.mark.parametrize(
    ("witnessed", "verdict"),
    [((), INCONCLUSIVE), (("emergency_stop", "protective_stop"), NOT_APPLICABLE)],
)
@pytest.mark.parametrize("monitor", [StopPerformance(), EstopRestart()], ids=["stop", "restart"])
def test_no_stop_is_an_answer_only_of_a_log_that_records_stops(
    monitor: Any, witnessed: Any, verdict: Verdict
) -> None:
    trial = trial_of({"speed/r": ("m/s", 0.0)}, witnessed=witnessed)

    assert only(monitor, trial).verdict is verdict


def test_a_flag_that_is_not_known_all_the_time_is_undecided() -> None:
    t = np.arange(301) / 100
    trial = trial_of({"speed/r": ("m/s", np.zeros(len(t)))}, t=t)
    early = Signal("manual_mode/r", "1", np.array([0.0, 0.5]), np.array([1.0, 1.0]))
    trial = dataclasses.replace(trial, signals={**trial.signals, early.name: early})

    finding = only(ReducedSpeed(applies="manual_mode"), trial)

    assert finding.verdict is INCONCLUSIVE
    # The last sample stands for 1.5 of the usual interval of 0.5 s.
    assert "'manual_mode' is not known at 1.260 s" in finding.message


@pytest.mark.parametrize(("left_out", "verdict"), [(0, VIOLATED), (1, INCONCLUSIVE), (4, INCONCLUSIVE)])
def test_whoever_leaves_out_samples_of_a_flag_leaves_it_unknown(left_out: int, verdict: Verdict) -> None:
    """At 10 Hz: on from 2.0 s to 2.4 s, at 0.5 m/s."""
    t = np.arange(401) / 100
    trial = trial_of({"speed/r": ("m/s", np.full(len(t), 0.5))}, t=t)
    at = np.arange(41) / 10
    on = ((at > 1.95) & (at < 2.35)).astype(float)
    kept = np.ones(len(at), dtype=bool)
    kept[20 : 20 + left_out] = False
    flag = Signal("manual_mode/r", "1", at[kept], on[kept])
    trial = dataclasses.replace(trial, signals={**trial.signals, flag.name: flag})

    assert only(ReducedSpeed(applies="manual_mode"), trial).verdict is verdict


def test_an_event_that_says_neither_on_nor_off_leaves_a_flag_unknown() -> None:
    events = [Event(0.2, "manual_mode", "r", "on"), Event(0.5, "manual_mode", "r", "of")]
    trial = trial_of({"speed/r": ("m/s", 0.0)}, events=events)

    assert only(ReducedSpeed(applies="manual_mode"), trial).verdict is INCONCLUSIVE


# Derived signals ------------------------------------------------------------------------------------


def moving_trial() -> Trial:
    t = np.arange(101) / 100
    robot = np.stack([t, 0 * t, 0 * t], axis=1)
    human = np.stack([5 - 0.5 * t, 0 * t, 0 * t], axis=1)
    agv = np.stack([0 * t, 3 + 0 * t, 0 * t], axis=1)
    columns = {
        "position/r": robot,
        "position/r::tool0": robot + np.array([0.0, 0.0, 1.0]),
        "position/h": human,
        "position/a": agv,
    }
    bodies = (Body("a", "agv", 0.5), Body("h", "human", 0.25), Body("r", "robot", 0.25, ("tool0",)))
    signals = {name: Signal(name, "m", t, values) for name, values in columns.items()}
    return Trial("t", bodies=bodies, signals=signals, recorded=Span(0.0, 1.0))


def derived(*quantities: str) -> Mapping[str, Signal]:
    return derive_signals(moving_trial(), [Derivation(q, 0.05) for q in quantities]).signals


def test_the_relative_speed_is_that_of_the_nearest_points() -> None:
    assert derived("relative_speed")["relative_speed/r/h"].values == pytest.approx(1.5)


def test_the_speed_of_the_tool_comes_from_its_link() -> None:
    signals = derived("tcp_speed")

    assert signals["tcp_speed/r"].values == pytest.approx(1.0)
    assert "tcp_speed/h" not in signals


def test_the_separation_of_any_two_bodies() -> None:
    signals = derived("body_separation")

    assert {n for n in signals if n.startswith("body_separation")} == {
        "body_separation/r/a",
        "body_separation/r/h",
        "body_separation/a/h",
    }
    assert signals["body_separation/a/h"].values[0] == pytest.approx(math.hypot(5, 3) - 0.75)


def test_a_collision_monitor_with_a_hole_in_its_log_is_never_satisfied() -> None:
    t = np.array([k / 100 for k in range(201) if not 50 < k < 150])
    trial = trial_of(
        {"in_contact/r/s": ("1", 0.0)}, t=t, bodies=[Body("r", "robot", 0.0), Body("s", "robot", 0.0)]
    )

    assert verdicts(CollisionEpisodes(), trial) == [INCONCLUSIVE]


def test_collisions_may_be_recorded_as_events() -> None:
    events = [Event(0.1, "in_contact", "s/r", "on"), Event(0.3, "in_contact", "s/r", "off")]
    events += [Event(0.5, "in_contact", "s/r", "on"), Event(0.6, "in_contact", "s/r", "off")]
    trial = trial_of(
        {"speed/r": ("m/s", 0.0)}, bodies=[Body("r", "robot", 0.0), Body("s", "robot", 0.0)], events=events
    )

    finding = only(CollisionEpisodes(), trial)

    assert finding.span == Span(0.1, 0.6)
    assert finding.quantities["occurrences"] == 2.0  # two robots count twice


def test_a_collision_with_fixed_things_has_its_force_and_speed() -> None:
    columns = {"contact_force/r/environment": ("N", 50.0), "velocity/r": ("m/s", [3.0, 4.0, 0.0])}
    trial = trial_of(columns, bodies=[Body("r", "robot", 0.0)])

    finding = only(CollisionEpisodes(critical=True), trial)

    assert (finding.subject, finding.critical) == ("r/environment", True)
    assert finding.quantities["force_max_N"] == 50.0
    assert finding.quantities["relative_speed_m_s"] == pytest.approx(5.0)


def test_a_collision_with_an_environment_that_a_log_map_declares_is_one() -> None:
    bodies = [Body("r", "robot", 0.0), Body("environment", "fixture", 0.0)]
    trial = trial_of({"in_contact/r/environment": ("1", 1.0)}, bodies=bodies)

    assert only(CollisionEpisodes(), trial).subject == "r/environment"


def test_robots_that_move_alike_meet_at_the_difference_of_their_speeds() -> None:
    columns = {
        "in_contact/r/s": ("1", 1.0),
        "velocity/r": ("m/s", [3.0, 1.0, 0.0]),
        "velocity/s": ("m/s", [3.0, -3.0, 3.0]),
    }
    trial = trial_of(columns, bodies=[Body("r", "robot", 0.0), Body("s", "robot", 0.0)])

    assert only(CollisionEpisodes(), trial).quantities["relative_speed_m_s"] == pytest.approx(5.0)


def test_a_collision_is_seen_by_geometry_where_no_contact_is_recorded() -> None:
    trial = moving_trial()
    near = Signal("position/a", "m", trial.signals["position/a"].t, trial.signals["position/r::tool0"].values)
    trial = dataclasses.replace(trial, signals={**trial.signals, "position/a": near})
    trial = derive_signals(trial, [Derivation("body_separation", 0.05)])

    finding = only(CollisionEpisodes(between="robot_agv"), trial)

    assert (finding.subject, finding.verdict, finding.quantities["occurrences"]) == ("r/a", VIOLATED, 1.0)


# Bad input ------------------------------------------------------------------------------------------


def test_a_bad_parameter_is_named(subtests: pytest.Subtests) -> None:
    cases: list[tuple[Callable[[], Any], str]] = [
        (lambda: SsmSeparation(t1_s=-0.1), "t1_s is -0.1 but cannot be negative"),
        (lambda: SsmSeparation(t1_s=1500.0), "t1_s is 1500 but must be at most 60 s .*thousandths"),
        (lambda: SsmSeparation(delta_m=math.nan), "delta_m is nan but must be finite"),
        (lambda: SsmSeparation(delta_m=1.0, intrusion_m=0.2), "delta_m is the sum of C, Z_d and Z_r"),
        (
            lambda: SsmSeparation(profile="standard", stop_model="linear", stopping_distance_m=0.1),
            "stopping_distance_m belongs to stop_model 'fixed', but the model is 'linear'",
        ),
        (lambda: SsmSpeedCap(deceleration_m_s2=0.0), "deceleration_m_s2 is 0 but must be positive"),
        (lambda: PflSpeed(moving_mass_kg=-5.0), "moving_mass_kg is -5 but must be positive"),
        (lambda: PflSpeed(load_kg=-1.0), "load_kg is -1 but cannot be negative"),
        (lambda: PflSpeed(robot_mass_kg=0.0), "robot_mass_kg is 0 but must be positive"),
        (lambda: PflSpeed(region="tail"), "body region 'tail' is unknown; regions: skull"),
        (lambda: PflContact(region="hnad"), "body region 'hnad' is unknown; did you mean 'hand'"),
        (lambda: PflContact(transient_factor=0.5), "transient_factor is 0.5 but must be at least 1"),
        (lambda: MonitoredStandstill(workspace=((0, 0), (1, 1))), "workspace is not a polygon: it has 2"),
        (
            lambda: MonitoredStandstill(workspace=((0, 0), (1, 1), (1, 0), (0, 1))),
            "workspace is not a polygon: edges 0 and 2 cross",
        ),
        (lambda: MonitoredStandstill(workspace=((0, 0), (1, 0), (2, 0))), "workspace is not a polygon"),
        (lambda: MonitoredStandstill(workspace=((0, 0), (1, 0), (1,))), r"corner 2 is \[1\], not \[x, y\]"),
        (lambda: MonitoredStandstill(workspace=((0, 0), (0, 0), (1, 1))), "a corner is given twice in a row"),
        (lambda: ReducedSpeed(applies="human_in_zone"), "'human_in_zone' but no zone is given"),
        (lambda: ReducedSpeed(max_speed_m_s=250.0), "max_speed_m_s is 250 but must be at most 20 m/s"),
        (lambda: SpaceLimit(box_low_m=(1.0, 0.0), box_high_m=(0.0, 1.0)), "the box is empty"),
        (lambda: SpaceLimit(box_low_m=(1.0,)), r"box_low_m is \[1.0\], not \[x, y\]"),
        (lambda: SpaceLimit(joint="j"), "joint 'j' has no limit"),
        (lambda: SpaceLimit(joint_low_rad=1.0), "joint does not say whose"),
        (lambda: SpaceLimit(keep_out=((),)), "keep_out zone 0 is not a polygon: it has no corners"),
        (
            lambda: SpaceLimit(keep_out=(SQUARE,), keep_out_z_m=(1.0, 0.0)),
            r"keep_out_z_m is \[1.0, 0.0\], not",
        ),
        (lambda: SpaceLimit(keep_out_z_m=(0.0, 1.0)), "keep_out_z_m is given, but no keep_out zone"),
        (lambda: EstopRestart(after=()), "after names no event"),
        (lambda: HumanContact(contact_distance_m=500.0), "contact_distance_m is 500 but must be at most 100"),
        (lambda: AgvSpeedClearance(obstacles=(((0.0, 0.0),),)), "obstacle 0 is not a polygon: it has 1"),
        (lambda: SafeguardDistance(line=((0.0, 0.0),)), "line is .* not two different ends"),
        (
            lambda: SafeguardDistance(arrangement="parallel", height_m=1.5),
            "a parallel field lies at most 1 m",
        ),
        (lambda: SafeguardDistance(supplement_m=0.1), r"supplement_m \(Z\) belongs to edition 2024"),
        (
            lambda: SafeguardDistance(arrangement="parallel", height_m=0.2, resolution_m=0.07),
            "height_m is 0.2 but resolution 0.07 m needs 0.3 m",
        ),
        (lambda: CrushGap(part="tail"), "body part 'tail' is unknown; parts: body, head"),
        (lambda: CollisionEpisodes(every_s=0.0), "every_s is 0 but must be positive"),
        (lambda: PoseAttained(commanded_m=(1.0,)), r"commanded_m is \[1.0\], not \[x, y, z\]"),
        (lambda: PoseAttained(max_heading_accuracy_rad=0.1), "but no commanded_heading_rad"),
        (lambda: SignalCoverage(quantities=("positon",)), "quantity 'positon' is unknown"),
        (lambda: SignalCoverage(min_coverage=99.0), "min_coverage is 99 but must be at most 1"),
        (lambda: Always(holds="v > 1"), "signals is empty"),
        (lambda: Always(holds="w > 1", signals={"v": "speed/{robot}"}), "unknown name 'w'"),
        (lambda: Always(holds="sqrt(v) > 1", signals={"v": "speed/{robot}"}), "unknown function 'sqrt'"),
        (lambda: Always(holds="v >", signals={"v": "speed/{robot}"}), "is not a formula"),
        (lambda: Always(holds="v.x()", signals={"v": "speed/{robot}"}), "is not allowed in a formula"),
        (lambda: Always(signals={"v": "speed/{robt}"}), r"names \{robt\}; did you mean robot\?"),
        (lambda: Always(signals={"v": "speed/{0}"}), r"names \{0\}; it may name a kind of body: robot"),
        (lambda: Always(signals={"v": "pressure/{robot}"}), "of no known quantity: .*name its unit"),
        (lambda: Always(signals={"v": "speed/{robot} [km/h]"}), "but it is measured in 'm/s'"),
        (lambda: Always(signals={"v": "position/{robot}"}), "has 3 components"),
        (lambda: Always(signals={"v": "speed/{robot}.x"}), "has no components"),
        (lambda: Always(signals={"v": "speed"}), "not quantity/subject"),
        (lambda: Always(signals={"not": "speed/{robot}"}), "'not' cannot be used as a name"),
        (
            lambda: Always(signals={"v": "speed/{robot}"}, parameters={"v": 1.0}),
            "'v' is both a signal and a parameter",
        ),
        (lambda: Within(within_s=-1.0), "within_s is -1 but cannot be negative"),
    ]
    for make, message in cases:
        with subtests.test(message=message), pytest.raises(ValueError, match=message):
            make()


def test_a_rule_set_with_a_bad_parameter_is_refused(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, Any, str]] = [
        ("iso_ts_15066.ssm_separation", {"profile": "iso"}, "'iso' is not one of seed, ariac2023"),
        ("iso_ts_15066.ssm_separation", {"t1_ms": 100}, "has no parameter 't1_ms'"),
        ("iso_ts_15066.ssm_separation", {"t1_s": "100 ms"}, "'100 ms' is not a float"),
        ("iso_10218_2.monitored_standstill", {"workspace": "square"}, "'square' is not a list"),
        ("iso_10218_2.monitored_standstill", {"workspace": [1, 2, 3]}, "1 is not a list"),
        ("iso_10218_2.pfl_speed", {"moving_mass_kg": -1}, "moving_mass_kg is -1 but must be positive"),
        ("iso_13855.safeguard_distance", {"edition": "2020"}, "'2020' is not one of 2010, 2024, us"),
        ("formula.always", {"signals": ["speed/{robot}"]}, "is not a mapping of names to values"),
        ("formula.always", {"parameters": {"a": "b"}}, "'b' is not a float"),
        ("formula.always", {"holds": "v > 1 +"}, "signals is empty"),
    ]
    for use, parameters, message in cases:
        with subtests.test(use=use, message=message):
            with pytest.raises(RuleSetError) as refused:
                Registry().find("ariac_score.monitors", use).build(parameters)
            assert message in str(refused.value)


def test_every_monitor_refuses_a_number_beyond_the_range_it_declares(subtests: pytest.Subtests) -> None:
    for name in MONITORS:
        plugin = Registry().find("ariac_score.monitors", name).load()
        for field, facts in parameter_facts(plugin).items():
            for value in (facts.at_most + 0.001, facts.above, facts.at_least - 0.001):
                refusal = pytest.raises(ValueError, match=rf"^{field} is \S+ but ")
                if math.isfinite(value):
                    with subtests.test(name=name, field=field, value=value), refusal:
                        plugin(**{field: value})


def test_every_parameter_says_where_it_comes_from_and_every_number_its_unit(
    subtests: pytest.Subtests,
) -> None:
    for name in MONITORS:
        with subtests.test(name=name):
            plugin = Registry().find("ariac_score.monitors", name).load()
            hints = inspect.get_annotations(plugin)

            for field, facts in parameter_facts(plugin).items():
                assert facts.status in ("verified", "from memory", "our choice"), field
                assert facts.source, field
                if str(hints.get(field)) in ("float", "int", "float | None"):
                    assert facts.unit, field


# Formulas -------------------------------------------------------------------------------------------

D_MIN = """
id: seed
title: d_min in four lines
source: Ferrando et al.
log_map: ariac2020
monitors:
  separation: {use: iso_ts_15066.ssm_separation}
  formula:
    use: formula.always
    with:
      holds: distance >= k_H * (t1 + t2) + k_R * t1 + B + delta
      signals: {distance: "centre_distance/{robot}/{human}", k_H: "speed/{human}", k_R: "speed/{robot}"}
      parameters: {t1: 1.0, t2: 1.5, B: 0.0, delta: 2.6}
      unit: m
score: "1"
"""


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_d_min_in_four_lines_of_yaml_finds_what_the_seed_profile_finds(seed: int, holes: bool) -> None:
    rng = np.random.default_rng(seed)
    steps = rng.choice([1, 1, 1, 2, 9] if holes else [1, 2], size=80)
    t = np.concatenate(([0.0], np.cumsum(steps) * 0.01))
    human, robot = rng.choice([0.0, 0.5, 1.3], 81), rng.choice([0.0, 0.7], 81)
    limit = human * 2.5 + robot + 2.6
    columns = {
        "centre_distance/r/h": ("m", np.where(rng.random(81) < 0.3, limit, limit + rng.normal(0, 1, 81))),
        "speed/h": ("m/s", human),
        "speed/r": ("m/s", robot),
    }
    columns["centre_distance/r/h"] = ("m", np.maximum(columns["centre_distance/r/h"][1], 0.0))
    trial = trial_of(columns, t=t)
    formula = Always(
        holds="distance >= k_H * (t1 + t2) + k_R * t1 + B + delta",
        signals={
            "distance": "centre_distance/{robot}/{human}",
            "k_H": "speed/{human}",
            "k_R": "speed/{robot}",
        },
        parameters={"t1": 1.0, "t2": 1.5, "B": 0.0, "delta": 2.6},
        unit="m",
    )

    def what(finding: Finding) -> Any:
        evidence = [(sample.t_s, sample.value, sample.unit) for sample in finding.evidence]
        return (
            finding.subject,
            finding.verdict,
            finding.span,
            finding.robustness,
            finding.unit,
            dict(finding.quantities),
            evidence,
        )

    assert [what(f) for f in formula.watch(trial)] == [what(f) for f in SsmSeparation().watch(trial)]


ROOT = Path(__file__).parents[2]
RECORDED = ROOT / "examples/kitting_near_miss.mcap"


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["recorded", "human_state", "frames"])
def test_d_min_in_four_lines_of_yaml_is_the_seed_profile_on_every_sample_of_the_example(
    motion: Any, tmp_path: Path
) -> None:
    log = RECORDED
    if motion != "recorded":
        log = write_bag(
            tmp_path / "trial.mcap", recorded_messages(kitting_trial(), motion=motion), storage="mcap"
        )
    rules = tmp_path / "seed.yaml"
    rules.write_text(D_MIN.replace("ariac2020", "ariac2023" if motion == "human_state" else "ariac2020"))
    measured = score_trial(log, str(rules)).measured

    def facts_of(check: str) -> list[Any]:
        found = measured.of(check).values()  # in order of their words, which are not the same
        facts = [(f.subject, f.span, f.verdict, f.robustness, dict(f.quantities)) for f in found]
        return sorted(facts, key=lambda each: (each[0], each[1].start_s, each[2].value))

    assert VIOLATED in [verdict for _, _, verdict, *_ in facts_of("formula")]
    assert facts_of("formula") == facts_of("separation")


def test_the_margin_of_d_min_in_yaml_is_that_of_the_seed_profile_bit_for_bit() -> None:
    trial = kitting_trial()
    distance, human, robot = (trial.signals[name].values for name in SNAPSHOT_SIGNALS)
    formula = Expression.parse("distance >= k_H * (t1 + t2) + k_R * t1 + B + delta")
    numbers = {"t1": 1.0, "t2": 1.5, "B": 0.0, "delta": 2.6}
    judged = judge_columns(
        formula, {"distance": distance, "k_H": human, "k_R": robot, **numbers}, len(distance)
    )
    required = SsmSeparation().d_min_m(human, robot)

    assert judged.margin.tobytes() == (distance - required).tobytes()
    assert judged.limit is not None
    assert judged.limit.tobytes() == required.tobytes()
    assert judged.true.tolist() == (distance >= required).tolist()
    assert 0 < (~judged.true).sum() < len(distance)


def test_d_min_in_a_rule_set(tmp_path: Path) -> None:
    (tmp_path / "seed.yaml").write_text(D_MIN, encoding="utf-8")
    rule_set, registry = load_rule_set(str(tmp_path / "seed.yaml")), Registry()
    columns = {"centre_distance/r/h": ("m", 2.0), "speed/h": ("m/s", 0.5), "speed/r": ("m/s", 0.5)}

    measured = measure_trial(trial_of(columns), prepare(rule_set, registry=registry))

    separation, formula = (measured.findings[f"{name}#1"] for name in ("separation", "formula"))
    assert separation.robustness == formula.robustness == pytest.approx(2.0 - (1.25 + 0.5 + 2.6))
    assert separation.quantities == formula.quantities
    assert "does not hold" in formula.message


def test_the_page_about_monitors_names_every_one_and_its_rule_set_is_sound(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "monitors.md").read_text(encoding="utf-8")
    text = page.partition("```yaml\n")[2].partition("```")[0]
    (tmp_path / "page.yaml").write_text(text, encoding="utf-8")

    assert set(load_rule_set(str(tmp_path / "page.yaml")).build(Registry())) == {
        "separation",
        "stops_in_time",
    }
    others = {"formula.never", "formula.within"}
    assert [name for name in MONITORS if f"`{name}`" not in page and name not in others] == []


def test_a_formula_that_always_holds_and_its_opposite(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, float, Verdict]] = [
        ("v < 1", 1.0, VIOLATED),
        ("v <= 1", 1.0, SATISFIED),
        ("v <= 1", above(1.0), VIOLATED),
        ("v < 1", below(1.0), SATISFIED),
        ("v == 1", 1.0, SATISFIED),
        ("v != 1", 1.0, VIOLATED),
        ("not v > 1", 1.0, SATISFIED),
        ("0 < v < 2", 1.0, SATISFIED),
        ("v > 0 and v < 1", 1.0, VIOLATED),
        ("v", 0.0, VIOLATED),
        ("v == 0 or 1 / v < 2", 0.0, SATISFIED),
    ]
    for holds, speed, verdict in cases:
        with subtests.test(holds=holds, speed=speed):
            trial, signals = trial_of({"speed/r": ("m/s", speed)}), {"v": "speed/{robot}"}

            assert only(Always(holds=holds, signals=signals), trial).verdict is verdict
            opposite = SATISFIED if verdict is VIOLATED else VIOLATED
            assert only(Never(holds=holds, signals=signals), trial).verdict is opposite


def test_a_formula_without_a_value_is_undecided_and_says_why() -> None:
    monitor = Always(holds="1 / v < 2", signals={"v": "speed/{robot}"})

    finding = only(monitor, trial_of({"speed/r": ("m/s", 0.0)}))

    assert finding.verdict is INCONCLUSIVE
    assert "division by zero in row 0" in finding.message


def test_a_misspelt_quantity_of_a_formula_is_answered_with_the_near_one() -> None:
    with pytest.raises(ValueError, match=r"name its unit, .*; or did you mean 'speed'\?"):
        Always(holds="v < 1", signals={"v": "sped/{robot}"})
    with pytest.raises(ValueError, match="of no known quantity: name its unit"):
        Always(holds="v < 1", signals={"v": "xyzzy/{robot}"})


def test_a_formula_takes_one_component_of_a_vector() -> None:
    monitor = Always(holds="z >= 0.5", signals={"z": "position/{human}.z"}, unit="m")

    assert violated(monitor, trial_of({"position/h": ("m", [9.0, 9.0, 0.4])}))


@pytest.mark.parametrize(("rests_s", "verdict"), [(1.5, SATISFIED), (1.51, VIOLATED), (9.0, VIOLATED)])
def test_a_formula_that_holds_in_time(rests_s: float, verdict: Verdict) -> None:
    t = np.arange(301) / 100
    columns = {
        "centre_distance/r/h": ("m", np.where(t >= 1.0, 0.5, 3.0)),
        "speed/r": ("m/s", np.where(t >= rests_s, 0.0, 1.0)),
    }
    monitor = Within(
        trigger="d < 1",
        response="v <= 0.01",
        within_s=0.5,
        signals={"d": "centre_distance/{robot}/{human}", "v": "speed/{robot}"},
    )

    found = only(monitor, trial_of(columns, t=t))

    assert found.verdict is verdict
    if verdict is VIOLATED:  # the trigger comes at 1 s and half a second is allowed; the log ends at 3 s
        assert found.robustness == pytest.approx(0.5 - (min(rests_s, 3.0) - 1.0))


def test_a_response_that_the_log_does_not_reach_is_undecided() -> None:
    t = np.arange(121) / 100
    columns = {"speed/r": ("m/s", np.where(t >= 1.0, 1.0, 0.0))}
    monitor = Within(trigger="v > 0.5", response="v < 0.5", within_s=0.5, signals={"v": "speed/{robot}"})

    assert only(monitor, trial_of(columns, t=t)).verdict is INCONCLUSIVE


# Coverage of what was exposed ----------------------------------------------------------------------


def _watched(distance: float, speed: float, *, seen_s: float = 10.0) -> Trial:
    """10 s at 100 Hz; the human's position is missing from 4.0 s to 4.2 s."""
    t = np.arange(1001) / 100
    held = t[(t <= 4.0) | (t >= 4.2)]
    seen = t[t <= seen_s]
    signals = {
        "position/h": Signal("position/h", "m", held, np.zeros((len(held), 3))),
        "position/r": Signal("position/r", "m", t, np.zeros((len(t), 3))),
        "separation/r/h": Signal("separation/r/h", "m", seen, np.full(len(seen), distance)),
        "speed/r": Signal("speed/r", "m/s", seen, np.full(len(seen), speed)),
    }
    return replace(trial_of({}, t=t), signals=signals)


def _of_human(monitor: SignalCoverage, trial: Trial) -> Finding:
    (finding,) = (f for f in monitor.watch(trial) if f.subject == "position/h")
    return finding


@pytest.mark.parametrize(
    ("quantity", "lacking"),
    [
        ("position", ["position/r2"]),  # of the human no place is recorded at all
        ("speed", ["speed/r2"]),
        ("separation", ["separation/r2/h"]),
    ],
)
def test_a_subject_without_a_signal_that_another_has_is_named(quantity: str, lacking: list[str]) -> None:
    names = {"position/r": [0.0, 0.0, 0.0], "speed/r": 0.0, "separation/r/h": 2.0}
    trial = trial_of(
        {name: ("m/s" if name == "speed/r" else "m", value) for name, value in names.items()},
        bodies=(Body("h", "human", 0.0), Body("r", "robot", 0.0), Body("r2", "robot", 0.0)),
    )

    found = list(SignalCoverage(quantities=(quantity,)).watch(trial))

    assert [f.subject for f in found if f.verdict is INCONCLUSIVE] == lacking
    assert len([f for f in found if f.verdict is SATISFIED]) == 1


def test_a_link_places_its_body() -> None:
    trial = trial_of({"position/r::tool": ("m", [0.0, 0.0, 0.0]), "position/h": ("m", [0.0, 0.0, 0.0])})

    assert verdicts(SignalCoverage(), trial) == [SATISFIED, SATISFIED]


@pytest.mark.parametrize("samples", [0, 1])
@pytest.mark.parametrize("recorded", [None, Span(0.0, 0.0)])
def test_a_recording_that_lasts_no_time_covers_nothing(samples: int, recorded: Span | None) -> None:
    t = np.arange(samples, dtype=float)
    signals = {"position/r": Signal("position/r", "m", t, np.zeros((samples, 3)))}
    trial = Trial("t", bodies=(Body("r", "robot", 0.0),), signals=signals, recorded=recorded)

    assert only(SignalCoverage(), trial).verdict is INCONCLUSIVE


def test_the_share_of_exposure_leaves_out_who_is_far_or_robots_at_rest(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, float, float, float]] = [
        (5.0, 0.5, 10.0, 0.98),  # W19.1
        (above(5.0), 0.5, 0.0, 1.0),
        (1.0, 0.01, 0.0, 1.0),
        (1.0, above(0.01), 10.0, 0.98),
    ]
    for distance, speed, exposure_s, coverage in cases:
        with subtests.test(distance=distance, speed=speed, exposure_s=exposure_s):
            found = _of_human(SignalCoverage(share_of="exposure"), _watched(distance, speed))

            assert found.quantities["exposure_s"] == pytest.approx(exposure_s)
            assert found.quantities["coverage"] == pytest.approx(coverage)
            assert found.verdict is (SATISFIED if coverage == 1.0 else INCONCLUSIVE)
            assert _of_human(SignalCoverage(), _watched(distance, speed)).quantities[
                "coverage"
            ] == pytest.approx(0.98)


@pytest.mark.parametrize(("seen_s", "exposure_s"), [(10.0, 0.0), (3.0, 7.0), (-1.0, 10.0)])
def test_who_is_not_seen_may_be_exposed(seen_s: float, exposure_s: float) -> None:
    found = _of_human(SignalCoverage(share_of="exposure"), _watched(9.0, 0.5, seen_s=seen_s))

    assert found.quantities["exposure_s"] == pytest.approx(exposure_s)
    assert found.quantities["missing_s"] == pytest.approx(0.2 if exposure_s else 0.0)


def test_stamps_that_ran_backwards_are_counted_for_their_signal() -> None:
    trial = replace(
        _watched(1.0, 0.5),
        log_defects=(
            LogDefect("disordered_stamps", "position/h", 3, "x"),
            LogDefect("disordered_stamps", "position/r", 5, "x"),
        ),
    )

    assert _of_human(SignalCoverage(), trial).quantities["clock_jumps"] == 3.0


def test_nobody_is_exposed_without_a_robot_or_a_human() -> None:
    alone = replace(_watched(1.0, 0.5), bodies=(Body("h", "human", 0.0),))

    assert verdicts(SignalCoverage(share_of="exposure"), alone) == [INCONCLUSIVE]
    recorded = replace(alone, witnessed=frozenset({"bodies"}))
    assert verdicts(SignalCoverage(share_of="exposure"), recorded) == [NOT_APPLICABLE]


# Attained poses ------------------------------------------------------------------------------------


def _attained(subject: str) -> tuple[Event, ...]:
    return tuple(Event(t_s, "pose_attained", subject) for t_s in (0.2, 0.5))


@pytest.mark.parametrize("subject", ["", "r", "r::tcp"])
def test_a_pose_of_a_link_may_be_attained_by_the_body_or_the_link(subject: str) -> None:
    columns = {"position/r::tcp": ("m", np.tile([1.0, 2.0, 3.0], (101, 1)))}
    trial = trial_of(columns, events=_attained(subject))
    found = only(PoseAttained(link="tcp", commanded_m=(1.1, 2.0, 2.8), max_accuracy_m=1.0), trial)

    assert found.verdict is SATISFIED
    assert [found.quantities[f"accuracy_{axis}_m"] for axis in "xyz"] == pytest.approx([-0.1, 0.0, 0.2])


def test_a_pose_that_another_body_attained_is_not_this_ones() -> None:
    columns = {"position/r::tcp": ("m", np.zeros((101, 3)))}
    found = only(
        PoseAttained(link="tcp", commanded_m=(0.0, 0.0, 0.0)), trial_of(columns, events=_attained("q"))
    )

    assert found.verdict is INCONCLUSIVE


def test_a_machine_without_positions_leaves_the_poses_of_the_others_decided() -> None:
    trial = replace(
        trial_of({"position/r": ("m", np.zeros((101, 3)))}, events=_attained("")),
        bodies=(Body("a", "robot", 0.0), Body("r", "robot", 0.0)),
    )
    monitor = PoseAttained(commanded_m=(0.0, 0.0, 0.0), max_accuracy_m=0.01)

    assert [(f.subject, f.verdict) for f in monitor.watch(trial)] == [("a", INCONCLUSIVE), ("r", SATISFIED)]
