"""Margins over time: at every sample by hand, and the least one is what the finding says."""

from __future__ import annotations

import runpy
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Chart,
    Event,
    Finding,
    Margined,
    Sample,
    Signal,
    SignalNeed,
    Span,
    Trial,
    Verdict,
)
from ariac_score.checks.registry import Registry
from ariac_score.testing import contract_checks
from ariac_score.testing.contract_check import ContractError
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score_ariac.safety import HumanContact
from ariac_score_ariac.testing import made_trial
from ariac_score_rml import RmlSpec
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
    SpaceLimit,
    SsmResponse,
    SsmSeparation,
    SsmSpeedCap,
)
from ariac_score_stl import StlFormula

MADE = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "test_monitors.py")))
trial_of = MADE.trial_of

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))
MARGINED: Mapping[str, Any] = {
    "iso_ts_15066.ssm_separation": SsmSeparation(profile="standard"),
    "iso_ts_15066.ssm_speed_cap": SsmSpeedCap(profile="standard"),
    "iso_ts_15066.ssm_response": SsmResponse(profile="standard"),
    "iso_10218_2.pfl_contact": PflContact(region="hand"),
    "iso_10218_2.pfl_speed": PflSpeed(region="chest", when="near", near_m=1.0),
    "iso_10218_2.monitored_standstill": MonitoredStandstill(workspace=SQUARE, grace_s=0.1),
    "iso_10218_2.hand_guiding": HandGuiding(),
    "iso_10218_1.reduced_speed": ReducedSpeed(),
    "iso_10218_1.space_limit": SpaceLimit(area=SQUARE),
    "iso_13850.estop_restart": EstopRestart(stop_within_s=0.1),
    "iso_13855.safeguard_distance": SafeguardDistance(
        line=((0.0, -9.0), (0.0, 9.0)), hazard=((3.0, -1.0), (4.0, -1.0), (4.0, 1.0)), stopping_time_s=0.1
    ),
    "iso_3691_4.agv_speed_clearance": AgvSpeedClearance(),
    "iso_3691_4.agv_protective_field": AgvProtectiveField(),
    "iso_13854.crush_gap": CrushGap(part="hand"),
    "proxemics.proximity_comfort": ProximityComfort(),
    "ariac.human_contact": HumanContact(contact_distance_m=0.3),
    "formula.always": Always(
        holds="v <= 1 and d > 0.2",
        signals={"v": "speed/{robot}", "d": "separation/{robot}/{human}"},
    ),
    "formula.never": Never(holds="v > 1", signals={"v": "speed/{robot}"}, unit="m/s"),
    "stl.formula": StlFormula(
        formula="always (d < 1 -> eventually[0,0.05] d > 1.05)", signals={"d": "separation in m"}
    ),
    "rml.spec": RmlSpec(
        spec="apart matches {topic: 'snapshot', distance: d} with d >= 0.5; Main = apart*;",
        events={"snapshot": {"distance": "separation/{robot}/{human}"}},
    ),
}
each_margined = pytest.mark.parametrize("name", MARGINED)

OF_OTHER_SIGNALS = {"aic.off_limit_contact", "aic.wrist_force"}
"""Monitors with margins whose signals no trial of this file has; tests/plugins/aic tries them."""

WITHOUT = {
    "ariac.collision_episodes": "events",
    "ariac.no_event": "events",
    "formula.within": "the time to a response",
    "iec_60204_1.stop_performance": "the time a stop takes",
    "iso_9283.pose_performance": "poses at some moments",
    "log.signal_coverage": "what is recorded",
    "official.trial": "a record",
    "run.record": "a record",
    "team.positive_sensor_cost": "a configuration",
    "team.sensor_cost": "a configuration",
}
"""The shipped monitors that judge no sample, and what they judge."""


def derived(monitor: Any, trial: Trial) -> Trial:
    return derive_signals(trial, [Derivation(need.quantity, need.max_gap_s) for need in monitor.needs()])


def margins(monitor: Any, trial: Trial, subject: str, what: str = "") -> dict[float, float]:
    """The margin at each time, where a limit applies."""
    (chart,) = [c for c in monitor.margins(trial) if c.subject == subject and c.what.startswith(what)]
    return {t: m for t, m in zip(chart.t.tolist(), chart.margin.tolist(), strict=True) if not np.isnan(m)}


# Who tells -----------------------------------------------------------------------------


def test_every_shipped_monitor_that_judges_samples_has_margins() -> None:
    registry = Registry()
    tell = {
        name
        for name in registry.names("ariac_score.monitors")
        if hasattr(registry.find("ariac_score.monitors", name).load(), "margins")
    }

    assert tell == set(MARGINED) | OF_OTHER_SIGNALS
    assert set(registry.names("ariac_score.monitors")) - tell == set(WITHOUT)


def test_the_page_on_outputs_names_those_without() -> None:
    text = (Path(__file__).parents[2] / "docs/outputs.md").read_text()

    for name in WITHOUT:
        assert f"`{name}`" in text


# Worked by hand ------------------------------------------------------------------------


def test_the_margin_of_a_speed_is_what_is_left_of_the_limit() -> None:
    # ISO 10218-1: 0.25 m/s.
    speed = np.array([0.10, 0.25, 0.40, 0.20])
    found = margins(ReducedSpeed(), trial_of({"speed/r": ("m/s", speed)}, n=4), "r")

    assert list(found) == [0.0, 0.01, 0.02, 0.03]
    assert list(found.values()) == pytest.approx([0.15, 0.0, -0.15, 0.05])


def test_the_margin_of_the_separation_is_the_distance_above_the_required_one() -> None:
    # Profile seed: d_min = h (t1 + t2) + r t1 + B + delta = 0.4 * 2.5 + 0.5 * 1.0 + 0 + 2.6 = 4.1 m.
    distance = np.array([5.0, 4.1, 4.0])
    trial = trial_of(
        {"centre_distance/r/h": ("m", distance), "speed/r": ("m/s", 0.5), "speed/h": ("m/s", 0.4)}, n=3
    )

    assert list(margins(SsmSeparation(), trial, "r/h").values()) == pytest.approx([0.9, 0.0, -0.1])


def test_where_no_limit_applies_there_is_no_margin() -> None:
    # Standing still violates nothing in profile standard: a margin only while the robot moves.
    trial = trial_of(
        {
            "separation/r/h": ("m", [5.0, 5.0, 5.0]),
            "speed/r": ("m/s", [0.0, 0.5, 0.0]),
            "approach_speed_robot/r/h": ("m/s", [0.0, 0.5, 0.0]),
            "approach_speed_human/r/h": ("m/s", 0.0),
        },
        n=3,
    )

    assert list(margins(SsmSeparation(profile="standard"), trial, "r/h")) == [0.01]


def test_the_margin_of_a_contact_is_the_part_of_its_limit_that_is_left() -> None:
    # Hand: 140 N quasi-static, twice that for the first 0.5 s (Table A.2): 70 N is a quarter, 350 N too much.
    force = np.array([0.0, 70.0, 350.0, 0.0])
    found = margins(PflContact(region="hand"), trial_of({"contact_force/r/h": ("N", force)}, n=4), "r/h")

    assert found == pytest.approx({0.01: 1 - 70 / 280, 0.02: 1 - 350 / 280})


def test_without_contact_the_margin_is_of_the_force_that_counts_as_one() -> None:
    force = np.array([0.0, 1.0, 4.5])
    found = margins(PflContact(), trial_of({"contact_force/r/h": ("N", force)}, n=3), "r/h", "contact force")

    assert list(found.values()) == pytest.approx([5.0, 4.0, 0.5])


def test_after_an_emergency_stop_standing_still_is_the_limit_until_the_start() -> None:
    # At rest within 0.1 s of the stop at 0.2 s, so from 0.3 s to the start at 0.6 s at most 0.01 m/s.
    events = [
        Event(0.2, "emergency_stop", "r"),
        Event(0.5, "emergency_stop_reset", "r"),
        Event(0.6, "start", "r"),
    ]
    speed = np.where((np.arange(101) > 20) & (np.arange(101) < 60), 0.0, 0.5)
    speed[40] = 0.11
    found = margins(
        EstopRestart(stop_within_s=0.1),
        trial_of({"speed/r": ("m/s", speed)}, events=events, witnessed=("emergency_stop",)),
        "r",
    )

    assert (min(found), max(found)) == (pytest.approx(0.2, abs=0.02), pytest.approx(0.59))
    assert found[0.4] == pytest.approx(0.01 - 0.11)
    assert found[0.35] == pytest.approx(0.01)


def test_standing_still_has_a_margin_for_each_of_its_limits() -> None:
    position = np.zeros((51, 3))
    position[30:, 0] = 0.002
    trial = trial_of(
        {
            "position/h": ("m", np.full((51, 3), 1.0)),
            "position/r": ("m", position),
            "speed/r": ("m/s", 0.0),
            "joint_speed/r": ("rad/s", 0.004),
        },
        n=51,
    )
    monitor = MonitoredStandstill(workspace=SQUARE, grace_s=0.1)

    assert set(margins(monitor, trial, "r/h", "speed in").values()) == {0.01}
    joints = margins(monitor, trial, "r/h", "joint speed")
    assert list(joints.values()) == pytest.approx([0.006] * len(joints))
    drift = margins(monitor, trial, "r/h", "drift")
    assert min(drift) == pytest.approx(0.1)
    assert (drift[0.2], drift[0.4]) == (pytest.approx(0.005), pytest.approx(0.003))


def test_the_margin_of_a_temporal_formula_is_its_robustness() -> None:
    # always (v > 0.5 -> eventually[0,0.02] v < 0.2): max(0.5 - v, max over the window of 0.2 - v).
    v = np.array([0.1, 0.6, 0.5, 0.3, 0.1, 0.1, 0.1])
    monitor = StlFormula(
        formula="always (v > 0.5 -> eventually[0,0.02] v < 0.2)",
        signals={"v": "speed of robot in m/s"},
        beyond="cut",
    )
    found = margins(monitor, trial_of({"speed/r": ("m/s", v)}, n=7), "r")

    assert list(found.values()) == pytest.approx([0.4, -0.1, 0.1, 0.2, 0.4, 0.4, 0.4])


def test_dense_time_and_mixed_units_tell_no_margins() -> None:
    trial = trial_of({"speed/r": ("m/s", 0.1), "separation/r/h": ("m", 1.0)}, n=7)
    dense = StlFormula(formula="always v < 1", signals={"v": "speed of robot in m/s"}, time="dense")
    mixed = StlFormula(
        formula="always (v < 1 or d > 2)", signals={"v": "speed of robot in m/s", "d": "separation in m"}
    )

    assert list(dense.margins(trial)) == []
    assert list(mixed.margins(trial)) == []


def test_the_margin_of_a_specification_is_that_of_its_inequality() -> None:
    distance = np.array([2.0, 0.5, 0.4, 0.9])
    found = margins(MARGINED["rml.spec"], trial_of({"separation/r/h": ("m", distance)}, n=4), "r/h")

    assert list(found.values()) == pytest.approx([1.5, 0.0, -0.1, 0.4])


def test_with_the_policy_once_nothing_is_judged_after_the_first_rejection() -> None:
    distance = np.array([2.0, 0.4, 0.9])
    once = replace(MARGINED["rml.spec"], after_violation="once")

    assert list(margins(once, trial_of({"separation/r/h": ("m", distance)}, n=3), "r/h")) == [0.0, 0.01]


# The law -------------------------------------------------------------------------------


def wild_trial(seed: int, *, hole: bool, step: float) -> Trial:
    """Bodies and signals that wander over their limits, to and fro."""
    rng = np.random.default_rng(seed)
    n = 120
    t = np.arange(n) / 100
    if hole:
        t = t + np.where(np.arange(n) >= 60, 0.3, 0.0)

    def wander(middle: float, spread: float, low: float = -np.inf) -> Any:
        way = np.cumsum(rng.normal(0.0, step, n))
        return np.maximum(middle + spread * np.sin(way), low)

    columns: dict[str, tuple[str, Any]] = {
        "separation/r/h": ("m", wander(0.8, 0.8, 0.0)),
        "centre_distance/r/h": ("m", wander(2.0, 1.5, 0.0)),
        "speed/r": ("m/s", wander(0.3, 0.8, 0.0)),
        "speed/h": ("m/s", wander(0.5, 0.5, 0.0)),
        "speed/a": ("m/s", wander(0.8, 1.0, 0.0)),
        "clearance/a": ("m", wander(0.5, 0.3, 0.0)),
        "approach_speed_robot/r/h": ("m/s", wander(0.0, 1.0)),
        "approach_speed_human/r/h": ("m/s", wander(0.0, 1.0)),
        "relative_speed/r/h": ("m/s", wander(0.5, 0.5, 0.0)),
        "contact_force/r/h": ("N", wander(50.0, 300.0, 0.0)),
        "crush_gap/r/h": ("m", wander(0.2, 0.2, 0.0)),
        "enabling_device/r": ("1", (wander(0.0, 1.0) > 0).astype(float)),
        "joint_speed/r": ("rad/s", wander(0.01, 0.02, 0.0)),
        "body_separation/a/h": ("m", wander(0.3, 0.5, 0.0)),
    }
    for body in ("r", "h", "a"):
        places = np.stack([wander(1.0, 3.0), wander(1.0, 3.0), wander(0.5, 0.1)], axis=1)
        columns[f"position/{body}"] = ("m", places)
        columns[f"velocity/{body}"] = ("m/s", np.stack([wander(0.0, 1.0) for _ in range(3)], axis=1))
    when = sorted(rng.uniform(0.0, 1.0, 3).tolist())
    kinds = ("emergency_stop", "emergency_stop_reset", "start")
    return trial_of(
        columns,
        t=t,
        bodies=(Body("a", "agv", 0.4), Body("h", "human", 0.3), Body("r", "robot", 0.2)),
        events=[Event(t_s, kind, "") for t_s, kind in zip(when, kinds, strict=True)],
        witnessed=kinds,
    )


def law_holds(finding: Finding, charts: Iterable[Chart]) -> bool:
    """The least margin within the finding's span (without one: of all) is its robustness."""
    for chart in charts:
        if (chart.subject, chart.unit) != (finding.subject, finding.unit):
            continue
        span = finding.span or Span(-1e9, 1e9)
        inside = [
            margin
            for t_s, margin in zip(chart.t.tolist(), chart.margin.tolist(), strict=True)
            if span.start_s <= t_s <= span.end_s and not np.isnan(margin)
        ]
        if inside and min(inside) == finding.robustness:
            return True
    return False


@each_margined
@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0.05, 0.3, 1.5]))
def test_the_least_margin_of_a_finding_is_its_robustness(
    name: str, seed: int, hole: bool, step: float
) -> None:
    monitor = MARGINED[name]
    trial = wild_trial(seed, hole=hole, step=step)
    charts = list(monitor.margins(trial))

    for finding in monitor.watch(trial):
        if finding.robustness is not None and (finding.span or finding.evidence):
            assert law_holds(finding, charts), finding


def test_violations_and_kept_limits_are_both_met(subtests: pytest.Subtests) -> None:
    """The law above is about something: each monitor violates, with a negative margin, in some trial."""
    for name in MARGINED:
        with subtests.test(name=name):
            monitor = MARGINED[name]
            worst = [
                f.robustness
                for seed in range(12)
                for f in monitor.watch(wild_trial(seed, hole=False, step=0.3))
                if f.verdict is Verdict.VIOLATED and f.robustness is not None
            ]

            assert worst
            assert max(worst) < 0


def test_stamps_are_those_of_samples(subtests: pytest.Subtests) -> None:
    for name in MARGINED:
        with subtests.test(name=name):
            monitor = MARGINED[name]
            trial = wild_trial(7, hole=True, step=0.3)
            times = {t for s in trial.signals.values() for t in s.t.tolist()}

            for chart in monitor.margins(trial):
                assert set(chart.t.tolist()) <= times


@pytest.mark.slow
def test_it_is_margined_and_keeps_the_contract(subtests: pytest.Subtests) -> None:
    for name in MARGINED:
        with subtests.test(name=name):
            monitor = MARGINED[name]
            assert isinstance(monitor, Margined)
            (check,) = [c for c in contract_checks(monitor, made_trial()) if c.name == "margins"]
            check()
            (check,) = [
                c
                for c in contract_checks(monitor, wild_trial(3, hole=False, step=0.3))
                if c.name == "margins"
            ]
            check()


def test_an_empty_log_has_no_margins(subtests: pytest.Subtests) -> None:
    for name in MARGINED:
        with subtests.test(name=name):
            assert list(MARGINED[name].margins(Trial("t", recorded=Span(0.0, 1.0)))) == []


# Monitors that tell something else -------------------------------------------------------


@dataclass(frozen=True)
class Telling:
    """The speed of a robot, at most 1 m/s; what it tells of it can be wrong."""

    off_m_s: float = 0.0
    late_s: float = 0.0
    unit: str = "m/s"
    forgets: bool = False
    calls: Any = ()

    def needs(self) -> Iterable[SignalNeed]:
        return [SignalNeed("speed", "m/s", 0.05)]

    def watch(self, trial: Trial) -> Iterable[Finding]:
        signal: Signal = trial.signal("speed/robot", unit="m/s")
        worst = int(np.argmax(signal.values))
        speed = float(signal.values[worst])
        yield Finding(
            "robot",
            Verdict.of(1.0 - speed),
            "its speed",
            robustness=1.0 - speed,
            unit="m/s",
            evidence=(Sample("speed/robot", float(signal.t[worst]), speed, "m/s"),),
        )

    def margins(self, trial: Trial) -> Iterable[Chart]:
        signal = trial.signal("speed/robot", unit="m/s")
        off = self.off_m_s
        if self.forgets:
            self.calls.append(1)
            off = len(self.calls) * 0.0 if len(self.calls) < 2 else 1.0
        limit = np.full(len(signal.t), 1.0 + off)
        yield Chart("robot", "speed", self.unit, signal.t + self.late_s, signal.values, limit, at_most=True)


def margin_check(monitor: Any) -> Any:
    (check,) = [c for c in contract_checks(monitor, made_trial()) if c.name == "margins"]
    return check


def test_a_monitor_whose_margins_fit_its_findings_keeps_the_contract() -> None:
    margin_check(Telling())()


def test_a_monitor_whose_margins_do_not_fit_is_refused(subtests: pytest.Subtests) -> None:
    cases: list[tuple[Any, str]] = [
        (Telling(off_m_s=0.001), "but the least margin it gives there is"),
        (Telling(off_m_s=-0.001), "but the least margin it gives there is"),
        (Telling(unit="m"), "but the least margin it gives there is None m"),
        (Telling(late_s=0.003), "where there is no sample"),
        (Telling(forgets=True, calls=[]), "gives other margins the second time"),
    ]
    for monitor, words in cases:
        with subtests.test(words=words), pytest.raises(ContractError, match=words):
            margin_check(monitor)()
