"""Watching while a trial goes on: the verdict of an instant is the same as in the whole log."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Event,
    InstantVerdict,
    OnlineMonitor,
    Sample,
    Signal,
    Span,
    Trial,
    Verdict,
    align,
)
from ariac_score.testing import SNAPSHOT_SIGNALS, contract_checks
from ariac_score_ariac.safety import HumanContact, NoEvent
from ariac_score_ariac.testing import kitting_trial, made_trial
from ariac_score_standards import SsmSeparation, SsmSpeedCap
from ariac_score_standards.formula import Always, Never

MADE = made_trial()

MAX_GAP_S = 0.05
MONITOR = SsmSeparation(max_gap_s=MAX_GAP_S)
DISTANCE, HUMAN, ROBOT = "centre_distance/robot/human", "speed/human", "speed/robot"
UNITS = {DISTANCE: "m", HUMAN: "m/s", ROBOT: "m/s"}

Rows = Sequence[tuple[float, str, float]]


def seed_d_min_m(human: float, robot: float) -> float:
    """The paper's formula with its values, written out."""
    return human * (1.0 + 1.5) + robot * 1.0 + 0.0 + 2.6


def trial_of(rows: Rows) -> Trial:
    signals = {}
    for name, unit in UNITS.items():
        own = [(t, value) for t, n, value in rows if n == name]
        if own:
            signals[name] = Signal(name, unit, np.array([t for t, _ in own]), np.array([v for _, v in own]))
    times = [t for t, _, _ in rows]
    bodies = (Body("human", "human"), Body("robot", "robot"))
    return Trial("online", bodies=bodies, signals=signals, recorded=Span(min(times), max(times)))


def rows_of(trial: Trial) -> list[tuple[float, str, float]]:
    names = [name for name in UNITS if name in trial.signals]
    found = [
        (t, name, value)
        for name in names
        for t, value in zip(trial.signals[name].t.tolist(), trial.signals[name].values.tolist(), strict=True)
    ]
    return sorted(found)


def stepped(monitor: SsmSeparation, rows: Rows) -> tuple[list[InstantVerdict], object]:
    watch = monitor.begin()
    verdicts = [s for t, name, v in rows for s in watch.step([Sample(name, t, v, UNITS[name])])]
    return verdicts, watch


def snapshot(t_s: float, distance_m: float, human: float = 0.0, robot: float = 0.0) -> list[Sample]:
    values = {DISTANCE: distance_m, HUMAN: human, ROBOT: robot}
    return [Sample(name, t_s, values[name], unit) for name, unit in UNITS.items()]


@st.composite
def recordings(draw: st.DrawFn) -> list[tuple[float, str, float]]:
    """Three signals, each at times of its own on a raster of 10 ms, with gaps."""
    rows = []
    for name in UNITS:
        ticks = draw(st.lists(st.integers(0, 40), min_size=1, max_size=25, unique=True))
        high = 6.0 if name == DISTANCE else 2.0
        values = st.floats(0, high, allow_nan=False)
        rows += [(tick / 100, name, draw(values)) for tick in ticks]
    return sorted(rows)


@given(rows=recordings())
@settings(max_examples=80)
def test_every_covered_instant_is_judged_once_and_as_the_whole_log_judges_it(rows: Rows) -> None:
    trial = trial_of(rows)

    verdicts, _ = stepped(MONITOR, rows)

    t, (distance, human, robot) = align([trial.signals[name] for name in UNITS], max_gap_s=MAX_GAP_S)
    margins = [d - seed_d_min_m(h, r) for d, h, r in zip(distance, human, robot, strict=True)]
    assert [s.t_s for s in verdicts] == t.tolist()
    assert [s.robustness for s in verdicts] == margins
    assert [s.verdict is Verdict.VIOLATED for s in verdicts] == [margin < 0 for margin in margins]


@given(rows=recordings(), profile=st.sampled_from(["seed", "ariac2023"]), t_on_s=st.sampled_from([0.0, 0.03]))
@settings(max_examples=60)
def test_the_findings_at_the_end_are_those_of_the_whole_log(rows: Rows, profile: str, t_on_s: float) -> None:
    monitor = SsmSeparation(profile=profile, distance="centre_distance", t_on_s=t_on_s)  # type: ignore[arg-type]
    trial = trial_of(rows)
    watch = monitor.begin()
    for t, name, value in rows:
        list(watch.step([Sample(name, t, value, UNITS[name])]))

    assert list(watch.end(replace(trial, signals={}))) == list(monitor.watch(trial))


def test_the_example_is_violated_online_exactly_where_the_log_says() -> None:
    trial = kitting_trial()
    assert set(SNAPSHOT_SIGNALS) == set(UNITS)
    verdicts, _ = stepped(SsmSeparation(), rows_of(trial))

    (violation,) = SsmSeparation().watch(trial)
    negative = [s for s in verdicts if s.verdict is Verdict.VIOLATED]
    assert violation.span is not None
    assert negative[0].t_s == violation.span.start_s
    assert min(s.robustness or 0.0 for s in negative) == violation.robustness
    assert all(violation.span.start_s <= s.t_s <= violation.span.end_s for s in negative)


def test_equal_distance_is_enough_and_the_next_number_below_is_not() -> None:
    required_m = seed_d_min_m(0.4, 0.3)
    watch = MONITOR.begin()

    (kept,) = watch.step(snapshot(1.0, required_m, 0.4, 0.3))
    (broken,) = watch.step(snapshot(1.01, float(np.nextafter(required_m, 0)), 0.4, 0.3))

    assert (kept.verdict, kept.robustness) == (Verdict.SATISFIED, 0.0)
    assert broken.verdict is Verdict.VIOLATED
    assert broken.message.endswith(f"nearer than the required {required_m:.3f} m")


def test_a_human_who_is_near_counts_as_faster_online_too() -> None:
    # Seed: d_min = h (1.0 + 1.5) + r 1.0 + 0 + 2.6; within 0.5 m a human reaches with 2.0 m/s, else walks
    # with 1.6 m/s.
    watch = SsmSeparation(human_speed="by_distance").begin()
    near, far = 2.0 * 2.5 + 0.3 + 2.6, 1.6 * 2.5 + 0.3 + 2.6

    found = [
        s.robustness
        for t_s, distance_m in ((1.0, 0.5), (1.01, float(np.nextafter(0.5, 1.0))))
        for s in watch.step(snapshot(t_s, distance_m, robot=0.3))
    ]

    assert found == [pytest.approx(0.5 - near), pytest.approx(0.5 - far)]


def test_there_is_no_verdict_before_all_signals_are_there() -> None:
    watch = MONITOR.begin()
    distance, human, robot = snapshot(1.0, 1.0)

    assert list(watch.step([distance])) == []
    assert list(watch.step([human])) == []
    assert [s.t_s for s in watch.step([robot])] == [1.0]


def test_there_is_no_verdict_in_a_gap() -> None:
    watch = MONITOR.begin()
    list(watch.step(snapshot(0.0, 9.0)))
    list(watch.step([Sample(DISTANCE, 0.03, 1.0, "m"), Sample(DISTANCE, 0.06, 1.0, "m")]))

    verdicts = list(watch.step([Sample(HUMAN, 0.06, 0.0, "m/s"), Sample(ROBOT, 0.06, 0.0, "m/s")]))

    assert [s.t_s for s in verdicts] == [0.06]  # 0.03 lies in the speeds' gap of 0.06 s


def test_a_time_that_does_not_increase_is_refused() -> None:
    watch = MONITOR.begin()
    list(watch.step(snapshot(1.0, 9.0)))

    for t_s in (1.0, 0.5, float("nan")):
        with pytest.raises(ValueError, match=rf"do not increase: {t_s} s after 1.0 s"):
            list(watch.step(snapshot(t_s, 9.0)))


def test_a_robot_at_rest_violates_nothing_where_the_profile_says_so() -> None:
    monitor = SsmSeparation(robot_must_move="yes")

    (standing,) = monitor.begin().step(snapshot(1.0, 0.1))

    assert (standing.verdict, standing.robustness) == (Verdict.NOT_APPLICABLE, None)


def test_two_watches_of_one_monitor_know_nothing_of_each_other() -> None:
    first, second = MONITOR.begin(), MONITOR.begin()
    list(first.step(snapshot(5.0, 1.0)))

    assert [s.verdict for s in second.step(snapshot(1.0, 9.0))] == [Verdict.SATISFIED]


def test_several_humans_are_watched_each_with_the_robot() -> None:
    watch = MONITOR.begin()
    samples = [
        Sample(f"centre_distance/robot/{human}", 1.0, d, "m") for human, d in (("h_1", 9.0), ("h_2", 1.0))
    ]
    samples += [Sample(f"speed/{body}", 1.0, 0.0, "m/s") for body in ("h_1", "h_2", "robot")]

    verdicts = {s.subject: s.verdict for s in watch.step(samples)}

    assert verdicts == {"robot/h_1": Verdict.SATISFIED, "robot/h_2": Verdict.VIOLATED}


def test_the_contract_is_kept_by_structure() -> None:
    assert isinstance(MONITOR, OnlineMonitor)
    assert not isinstance(object(), OnlineMonitor)


# The others ------------------------------------------------------------------------------

DIRECTED = {
    "separation/robot/human": "m",
    "speed/robot": "m/s",
    "speed/human": "m/s",
    "approach_speed_robot/robot/human": "m/s",
    "approach_speed_human/robot/human": "m/s",
}
SIGNS = {"approach_speed_robot/robot/human", "approach_speed_human/robot/human"}


@st.composite
def directed(draw: st.DrawFn) -> Trial:
    """Everything the monitors of separation read, sampled together."""
    n = draw(st.integers(1, 12))
    signals = {}
    for name, unit in DIRECTED.items():
        low = -2.0 if name in SIGNS else 0.0
        values = draw(st.lists(st.floats(low, 4.0, allow_nan=False), min_size=n, max_size=n))
        signals[name] = Signal(name, unit, np.arange(n) / 100, np.array(values))
    bodies = (Body("human", "human"), Body("robot", "robot"))
    return Trial("t", bodies=bodies, signals=signals, recorded=Span(0.0, (n - 1) / 100))


MODELS = st.sampled_from(["profile", "fixed", "linear", "deceleration", "constant_speed"])
CHOICES = st.fixed_dictionaries(
    {
        "profile": st.sampled_from(["seed", "ariac2023_agent", "standard"]),
        "stop_model": MODELS,
        "speeds": st.sampled_from(["scalar", "directed"]),
        "human_speed": st.sampled_from(["measured", "fixed"]),
        "robot_must_move": st.sampled_from(["yes", "no"]),
    }
)


def whole(trial: Trial, monitor: SsmSeparation) -> list[InstantVerdict]:
    watch = monitor.begin(trial.bodies)
    every = (signal.sample(i) for signal in trial.signals.values() for i in range(len(signal)))
    return [s for sample in sorted(every, key=lambda one: one.t_s) for s in watch.step([sample])]


@given(trial=directed(), choices=CHOICES)
@settings(max_examples=80, derandomize=True, deadline=None)
def test_whatever_the_formula_every_margin_is_that_of_the_whole_log(trial: Trial, choices: Any) -> None:
    monitor = SsmSeparation(**choices, distance="separation", max_gap_s=MAX_GAP_S)
    column = {name: signal.values for name, signal in trial.signals.items()}
    robot, human = column["speed/robot"], column["speed/human"]
    if choices["speeds"] == "directed":
        robot = np.maximum(column["approach_speed_robot/robot/human"], 0.0)
        human = np.maximum(column["approach_speed_human/robot/human"], 0.0)
    if choices["human_speed"] == "fixed":
        human = np.full_like(robot, monitor.human_speed_m_s)
    margins = column["separation/robot/human"] - monitor.d_min_m(human, robot)
    counts = choices["robot_must_move"] == "no"

    verdicts = whole(trial, monitor)

    wanted = [
        margin if counts or moves > monitor.standstill_speed_m_s else None
        for margin, moves in zip(margins.tolist(), column["speed/robot"].tolist(), strict=True)
    ]
    assert [s.robustness for s in verdicts] == wanted


@pytest.mark.parametrize(
    ("monitor", "below", "limit"),
    [
        (SsmSpeedCap(delta_m=1.0), False, 2.0 - 1.0),
        (Never(holds="v > 0.5", signals={"v": "speed/{robot}"}, unit="m/s", max_gap_s=1.0), False, 0.5),
        (Always(holds="v <= 0.5", signals={"v": "speed/{robot}"}, unit="m/s", max_gap_s=1.0), False, 0.5),
        (Always(holds="v >= 0.5", signals={"v": "speed/{robot}"}, unit="m/s", max_gap_s=1.0), True, 0.5),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_limit_on_the_speed_is_kept_at_the_limit_and_not_beyond(
    monitor: Any, below: bool, limit: float
) -> None:
    """With a human at rest 2 m away; of `ssm_speed_cap` what is left for t1 = 1 s."""
    watch = monitor.begin((Body("human", "human"), Body("robot", "robot")))
    beyond = float(np.nextafter(limit, 0 if below else 9))

    verdicts = [
        standing
        for k, speed in enumerate((limit, beyond))
        for standing in watch.step(snapshot(k / 100, 2.0, 0.0, speed))
    ]

    assert [s.verdict for s in verdicts] == [Verdict.SATISFIED, Verdict.VIOLATED]
    assert verdicts[0].robustness == 0.0


def test_contact_is_reported_when_it_comes_and_the_limit_is_contact_too() -> None:
    watch = HumanContact(distance="centre_distance", contact_distance_m=0.3).begin()
    verdicts = [
        s
        for k, d in enumerate((0.5, 0.3, float(np.nextafter(0.3, 1))))
        for s in watch.step([Sample(DISTANCE, k / 100, d, "m")])
    ]

    assert [s.verdict for s in verdicts] == [Verdict.SATISFIED, Verdict.VIOLATED, Verdict.SATISFIED]


def test_events_of_the_kind_are_reported_and_no_others() -> None:
    watch = NoEvent(kind="part_dropped").begin()
    events = [
        Event(1.0, "arm_collision", "gantry"),
        Event(2.0, "part_dropped", "gantry"),
        Event(2.0, "part_dropped", "gantry"),
        Event(2.0, "part_dropped"),
        Event(3.0, "part_dropped", "gantry"),
    ]

    verdicts = [s for event in events for s in watch.step([], [event])]

    assert [(s.subject, s.t_s) for s in verdicts] == [("gantry", 2.0), ("trial", 2.0), ("gantry", 3.0)]


def test_a_formula_without_value_is_undecided_there_and_only_there() -> None:
    monitor = Always(holds="1 / v > 0.1", signals={"v": "speed/{robot}"}, max_gap_s=1.0)
    watch = monitor.begin((Body("robot", "robot"),))

    verdicts = [
        s for k, v in enumerate((1.0, 0.0, 1.0)) for s in watch.step([Sample(ROBOT, k / 100, v, "m/s")])
    ]

    assert [s.verdict for s in verdicts] == [Verdict.SATISFIED, Verdict.INCONCLUSIVE, Verdict.SATISFIED]
    assert "division by zero" in verdicts[1].message


def test_who_is_known_to_be_no_robot_is_not_watched() -> None:
    watch = MONITOR.begin((Body("robot", "agv"), Body("human", "human")))

    assert list(watch.step(snapshot(1.0, 1.0))) == []


ONLINE = ("one_by_one", "instant_by_instant", "standings", "nothing_stepped", "repeated_time")


@pytest.mark.slow
@pytest.mark.parametrize(
    "monitor",
    [
        pytest.param(SsmSeparation(profile="ariac2023"), marks=pytest.mark.slow),
        pytest.param(SsmSeparation(profile="ariac2023_agent", max_gap_s=0.2), marks=pytest.mark.slow),
        pytest.param(SsmSeparation(blame="yes"), marks=pytest.mark.slow),
        SsmSeparation(),
        SsmSeparation(profile="standard"),
        SsmSpeedCap(),
        HumanContact(),
        NoEvent(kind="part_dropped"),
        Always(holds="v <= 0.5", signals={"v": "speed/{robot}"}, unit="m/s"),
        pytest.param(
            Never(holds="v > 0.5", signals={"v": "speed/{robot}"}, unit="m/s"), marks=pytest.mark.slow
        ),
        Always(),
    ],
    ids=lambda monitor: type(monitor).__name__,
)
def test_every_one_keeps_the_contract_online(monitor: Any) -> None:
    checks = [check for check in contract_checks(monitor, MADE) if check.name in ONLINE]
    assert len(checks) == len(ONLINE)
    for check in checks:
        check()
