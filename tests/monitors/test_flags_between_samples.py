"""What comes more often than the speed it is read with counts for as long as it was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.spans import FloatArray
from ariac_score_standards import AgvSpeedClearance, HandGuiding, ReducedSpeed

BODIES = (Body("arm", "robot", 0.0), Body("cart", "agv", 0.0))
BOUNDS = {
    "robot": {"max_speed_m_s": 1.0, "source": "the test"},
    "agv": {"max_speed_m_s": 1.7, "source": "the test"},
}
SLOWLY = np.arange(31) / 10
OFTEN = np.arange(301) / 100
EVERY_TENTH = np.arange(301) % 10


def trial(columns: Mapping[str, tuple[str, FloatArray, FloatArray, float]], *, every: bool = False) -> Trial:
    """A competition of 3 s: unit, stamps, values and rate of each signal."""
    signals = {
        name: Signal(name, unit, t, values, f"/{name}", stated_rate_hz=rate_hz)
        for name, (unit, t, values, rate_hz) in columns.items()
    }
    return Trial(
        "t",
        bodies=BODIES,
        signals=signals,
        events=(Event(0.0, COMPETITION_STARTED), Event(3.0, COMPETITION_ENDED)),
        recorded=Span(0.0, 3.0),
        between=between_samples(BOUNDS, {}, every=every),
    )


def without(given: Trial, name: str, lost: Sequence[int]) -> Trial:
    one = given.signals[name]
    kept = np.setdiff1d(np.arange(len(one)), lost)
    return replace(
        given, signals={**given.signals, name: replace(one, t=one.t[kept], values=one.values[kept])}
    )


def in_violation_s(monitor: object, given: Trial) -> tuple[float, float]:
    """For how long the limit was broken at best and at worst, s."""
    everything = list(monitor.watch_worlds(given))  # type: ignore[attr-defined]
    opened = [one for one in everything if isinstance(one, Worlds)]
    seen = [one for one in everything if isinstance(one, Finding)]
    best, worst = (
        sum(f.quantities["time_in_violation_s"] for f in each if f.verdict is Verdict.VIOLATED)
        for each in (
            [f for one in opened for f in one.best] if opened else seen,
            [f for one in opened for f in one.worst] if opened else seen,
        )
    )
    # What stays undecided where no worlds are told may have been all broken.
    undecided = [f.span for f in seen if f.verdict is Verdict.INCONCLUSIVE and f.span and not opened]
    return best, worst + sum(span.duration_s for span in undecided)


# In manual mode for 10 ms of each 100 ms, and too fast for it all the time: 0.3 s of 3 s.
PHASES = range(10)


def in_mode(phase: int) -> Trial:
    speed, mode = np.full(31, 0.28), (phase == EVERY_TENTH).astype(float)
    mode[-1] = 0.0
    return trial({"speed/arm": ("m/s", SLOWLY, speed, 10.0), "manual_mode/arm": ("1", OFTEN, mode, 100.0)})


MODE = ReducedSpeed(applies="manual_mode", t_on_s=0.0, t_off_s=0.02, max_gap_s=0.25)


@pytest.mark.parametrize("phase", PHASES)
def test_a_mode_counts_for_as_long_as_it_is_on_wherever_the_samples_of_the_speed_are(phase: int) -> None:
    assert in_violation_s(MODE, in_mode(phase)) == pytest.approx((0.3, 0.3))


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("lost", [[15], [14, 15], range(5, 25), range(1, 30, 2)], ids=str)
def test_whoever_leaves_out_speeds_gains_nothing_from_a_mode_that_turns(
    phase: int, lost: Sequence[int]
) -> None:
    best, worst = in_violation_s(MODE, without(in_mode(phase), "speed/arm", lost))

    assert best <= 0.3 + 1e-6
    assert worst >= 0.3 - 1e-6


def test_a_mode_that_turns_in_a_gap_that_the_monitor_accepts_is_not_stretched_over_it() -> None:
    """In manual mode for 20 ms twice, at rest in between, and the speed lacks there: too short both times."""
    mode = np.zeros(301)
    mode[258:260] = mode[262:264] = 1.0
    given = trial(
        {"speed/arm": ("m/s", OFTEN, np.full(301, 0.5), 100.0), "manual_mode/arm": ("1", OFTEN, mode, 100.0)}
    )
    monitor = replace(MODE, t_on_s=0.03, t_off_s=0.01)

    assert in_violation_s(monitor, given) == (0.0, 0.0)
    assert in_violation_s(monitor, without(given, "speed/arm", [260, 261])) == (0.0, 0.0)


# Devices -------------------------------------------------------------------------------------


def guided(pressed: FloatArray) -> Trial:
    speed = np.full(301, 0.2)
    return trial(
        {"speed/arm": ("m/s", OFTEN, speed, 100.0), "enabling_device/arm": ("1", OFTEN, pressed, 100.0)}
    )


def test_a_device_may_have_been_let_go_as_soon_as_its_samples_lack() -> None:
    """Let go at 1.1 s, so that it has to rest from 1.4 s on, until it is held again at 2 s."""
    pressed = np.ones(301)
    pressed[110:200] = 0.0
    honest = guided(pressed)
    robbed = without(honest, "enabling_device/arm", range(105, 125))
    monitor = HandGuiding(stop_within_s=0.3)

    assert in_violation_s(monitor, honest) == pytest.approx((0.6, 0.6))
    best, worst = in_violation_s(monitor, robbed)
    # At best let go just before 1.25 s; at worst just behind 1.04 s, and all of the gap counts besides.
    assert best == pytest.approx(2.0 - 1.25 - 0.3)
    assert worst == pytest.approx((2.0 - 1.04 - 0.3) + 0.21)


# Clearances ----------------------------------------------------------------------------------

CART = AgvSpeedClearance(t_on_s=0.0, t_off_s=0.02, max_gap_s=0.25)


def narrow(phase: int) -> Trial:
    """A cart at 0.84 m/s, 0.6 m from anything but for 10 ms of each 100 ms, in which it is 0.4 m."""
    clearance = np.where(phase == EVERY_TENTH, 0.4, 0.6)
    clearance[-1] = 0.6
    return trial(
        {
            "speed/cart": ("m/s", SLOWLY, np.full(31, 0.84), 10.0),
            "clearance/cart": ("m", OFTEN, clearance, 100.0),
        }
    )


@pytest.mark.parametrize("phase", PHASES)
def test_a_clearance_counts_for_as_long_as_it_lacks_wherever_the_samples_of_the_speed_are(phase: int) -> None:
    assert in_violation_s(CART, narrow(phase)) == pytest.approx((0.3, 0.3))


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("lost", [[15], range(5, 25), range(1, 30, 2)], ids=str)
@pytest.mark.parametrize("name", ["speed/cart", "clearance/cart"])
def test_whoever_leaves_out_samples_gains_nothing_from_a_clearance(
    name: str, phase: int, lost: Sequence[int]
) -> None:
    rows = lost if name == "speed/cart" else [row for one in lost for row in range(10 * one, 10 * one + 10)]
    best, worst = in_violation_s(CART, without(narrow(phase), name, rows))

    assert best <= 0.3 + 1e-6
    assert worst >= 0.3 - 1e-6


def test_a_gap_of_the_clearance_between_two_samples_of_the_speed_is_open() -> None:
    """No sample of the speed lies in it."""
    best, worst = in_violation_s(CART, without(narrow(5), "clearance/cart", range(142, 149)))

    assert best == pytest.approx(0.29)
    assert worst == pytest.approx(0.29 + 0.08)


def test_a_flag_that_begins_late_opens_only_what_is_before_it() -> None:
    """It cost all of the competition, however well the rest was known."""
    given = in_mode(5)
    flag = given.signals["manual_mode/arm"]
    late = replace(flag, t=flag.t[4:], values=flag.values[4:])
    best, worst = in_violation_s(MODE, replace(given, signals={**given.signals, flag.name: late}))

    assert best == pytest.approx(0.3)
    assert worst == pytest.approx(0.3 + 0.04)


def test_a_device_that_was_let_go_before_the_first_speed_leaves_time_to_stop_as_its_samples_show() -> None:
    """Let go at 0.1 s; the speed is recorded from 0.2 s on, and has to be none from 0.4 s on."""
    pressed = np.zeros(301)
    pressed[:10] = 1.0
    given = guided(pressed)
    late = without(given, "speed/arm", range(20))
    best, worst = in_violation_s(HandGuiding(stop_within_s=0.3), late)

    assert best == pytest.approx(2.6)
    assert worst == pytest.approx(2.6 + 0.2)
