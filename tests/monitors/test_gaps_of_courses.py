"""Gaps of what else a monitor reads, of what takes its course, and of what it remembers.

Each row: of the recording as it is, and with samples left out, the fewest and the most violations and for
how long at least and at most. The fewest are no more than there were, the most no fewer.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.spans import FloatArray
from ariac_score_standards import (
    EstopRestart,
    HandGuiding,
    MonitoredStandstill,
    PflContact,
    PoseAttained,
    ReducedSpeed,
    StopPerformance,
    Within,
)
from ariac_score_stl.formula import StlFormula

T = np.arange(501) / 100
BODIES = (Body("arm", "robot", 0.0), Body("ann", "human", 0.0))
WITNESSED = frozenset({"bodies", "emergency_stop", "protective_stop", "contact"})


def during(*spans: tuple[float, float], yes: float = 1.0, no: float = 0.0) -> FloatArray:
    """A column at 100 Hz for 5 s that has one value from each beginning to before each end, else another."""
    inside = [(start - 1e-9 <= T) & (end - 1e-9 > T) for start, end in spans]
    return np.where(np.any([np.zeros(len(T), dtype=bool), *inside], axis=0), yes, no)


def at(x_m: FloatArray, y_m: float = 0.0) -> FloatArray:
    return np.stack([x_m, np.full(len(x_m), y_m), np.zeros(len(x_m))], axis=1)


def recorded(columns: Mapping[str, tuple[str, FloatArray]], *events: Event) -> Trial:
    """Signals at 100 Hz, by name with unit and values, from one publisher."""
    signals = [
        Signal(name, unit, T, values, "/cell", stated_rate_hz=100.0)
        for name, (unit, values) in columns.items()
    ]
    return Trial(
        "t",
        bodies=BODIES,
        signals={one.name: one for one in signals},
        events=(Event(0.0, COMPETITION_STARTED), *events, Event(5.0, COMPETITION_ENDED)),
        witnessed=WITNESSED,
        recorded=Span(0.0, 5.0),
        between=between_samples({}, {}),
    )


def without(given: Trial, lacking: Collection[float], names: Sequence[str] = ()) -> Trial:
    """The trial without the samples at some times, of all its signals, or of those that are named."""
    rows = np.flatnonzero(~np.isin(np.round(T, 9), np.round([*lacking], 9)))
    fewer = {
        name: replace(one, t=one.t[rows], values=one.values[rows])
        for name, one in given.signals.items()
        if not names or name in names
    }
    return replace(given, signals={**given.signals, **fewer})


def from_to(start_s: float, end_s: float) -> list[float]:
    """The times of samples from one to before the other."""
    return [k / 100 for k in range(round(100 * start_s), round(100 * end_s))]


@dataclass(frozen=True)
class Found:
    """How many violations there are, and for how long, in the best and in the worst world."""

    fewest: int
    most: int
    least_s: float
    longest_s: float


def found(monitor: object, given: Trial) -> Found:
    everything = list(monitor.watch_worlds(given))  # type: ignore[attr-defined]
    opened = [one for one in everything if isinstance(one, Worlds)]
    seen = [one for one in everything if isinstance(one, Finding)]
    best = [f for one in opened for f in one.best] if opened else seen
    worst = [f for one in opened for f in one.worst] if opened else seen
    numbers = [[f for f in each if f.verdict is Verdict.VIOLATED] for each in (best, worst)]
    lasts = [sum(f.quantities.get("time_in_violation_s", 0.0) for f in each) for each in numbers]
    # What stays undecided is priced as one at worst.
    open_s = [f.span.duration_s for f in seen if f.verdict is Verdict.INCONCLUSIVE and f.span and not opened]
    most, longest_s = len(numbers[1]) + len(open_s), lasts[1] + sum(open_s)
    return Found(len(numbers[0]), most, round(lasts[0], 6), round(longest_s, 6))


def undecided(monitor: object, given: Trial) -> list[str]:
    watched = monitor.watch_worlds(given)  # type: ignore[attr-defined]
    return [one.message for one in watched if getattr(one, "verdict", None) is Verdict.INCONCLUSIVE]


# Flags -----------------------------------------------------------------------------------------

FAST_FOR_40_MS = during((1.0, 1.04), (3.0, 3.04), yes=0.5, no=0.1)
GUIDED = recorded({"speed/arm": ("m/s", FAST_FOR_40_MS), "enabling_device/arm": ("1", during((0.0, 9.0)))})
MANUAL = recorded({"speed/arm": ("m/s", FAST_FOR_40_MS), "manual_mode/arm": ("1", during((0.0, 9.0)))})


@pytest.mark.parametrize(
    ("monitor", "given"),
    [
        (HandGuiding(t_off_s=0.2), GUIDED),
        (ReducedSpeed(max_speed_m_s=0.25, applies="manual_mode", t_on_s=0.0, t_off_s=0.2), MANUAL),
    ],
)
def test_a_flag_in_the_messages_that_are_left_out_hides_nothing(monitor: object, given: Trial) -> None:
    """Too fast twice for 40 ms; whoever leaves out those messages leaves out the flag as well."""
    assert found(monitor, given) == Found(2, 2, 0.08, 0.08)
    robbed = found(monitor, without(given, from_to(1.0, 1.04) + from_to(3.0, 3.04)))
    assert (robbed.fewest, robbed.most, robbed.least_s) == (0, 2, 0.0)
    assert robbed.longest_s >= 0.08
    # One message elsewhere opens its own gap, and nothing else.
    assert found(monitor, without(given, [2.0])) == Found(2, 3, 0.08, 0.1)


def test_one_message_of_a_flag_alone_opens_its_own_gap() -> None:
    slow = recorded(
        {"speed/arm": ("m/s", during(yes=0.5, no=0.1)), "manual_mode/arm": ("1", during((0.0, 9.0)))}
    )
    monitor = ReducedSpeed(max_speed_m_s=0.25, applies="manual_mode", t_on_s=0.0)

    assert found(monitor, slow) == Found(0, 0, 0.0, 0.0)
    assert found(monitor, without(slow, [2.0], ["manual_mode/arm"])) == Found(0, 1, 0.0, 0.02)


def test_whether_drives_kept_their_power_is_open_where_their_flag_lacks() -> None:
    """Category 2 after an emergency stop is a violation, and the flag alone shows it."""
    given = recorded(
        {
            "speed/arm": ("m/s", during((0.0, 1.1), yes=0.5)),
            "drive_enabled/arm": ("1", during((0.0, 9.0))),
        },
        Event(1.0, "emergency_stop"),
    )
    fewer = without(given, [1.5], ["drive_enabled/arm"])

    assert found(StopPerformance(), given) == Found(1, 1, 0.0, 0.0)
    assert found(StopPerformance(), fewer).most >= 1
    (told,) = [one for one in undecided(StopPerformance(), fewer) if "power" in one]
    assert "whether the drives kept their power, nothing shows from 1.490 s on" in told


@pytest.mark.parametrize(
    ("name", "unit", "column", "left_out"),
    [
        ("clamped/arm/ann", "1", during((1.0, 1.4)), from_to(1.0, 1.4)),
        ("contact_height/arm/ann", "m", during((0.0, 9.0), yes=1.3), from_to(1.0, 1.39)),
    ],
)
def test_what_a_contact_was_like_is_open_where_it_is_recorded_and_lacks(
    name: str, unit: str, column: FloatArray, left_out: list[float]
) -> None:
    """170 N for 0.4 s: beyond what a chest bears clamped, and within what it bears for an instant."""
    given = recorded({"contact_force/arm/ann": ("N", during((1.0, 1.4), yes=170.0)), name: (unit, column)})
    monitor = PflContact(region="chest" if name.startswith("clamped") else "", t_off_s=0.2)
    honest, robbed = found(monitor, given), found(monitor, without(given, left_out, [name]))

    assert robbed.fewest <= honest.fewest
    assert robbed.most >= max(1, honest.most)


# Events ----------------------------------------------------------------------------------------


def test_without_any_stop_a_gap_hides_no_bad_one() -> None:
    given = recorded({"speed/arm": ("m/s", during((0.0, 9.0), yes=0.5))})

    assert found(StopPerformance(), without(given, from_to(2.0, 2.04))) == Found(0, 0, 0.0, 0.0)
    unknown = replace(without(given, from_to(2.0, 2.04)), witnessed=frozenset({"bodies"}))
    assert found(StopPerformance(), unknown).most >= 1


@pytest.mark.parametrize("left_out", [[], *([k / 100 for k in range(n, 105)] for n in (101, 103, 104))])
def test_a_pose_is_where_it_was_measured_and_not_near_it(left_out: list[float]) -> None:
    """Attained at 1.045 s, half a metre off: the sample before is too old as soon as one lacks."""
    given = recorded(
        {"position/arm": ("m", at(during((0.0, 1.04), yes=1.0, no=1.5)))},
        Event(1.045, "pose_attained", "arm"),
    )
    monitor = PoseAttained(commanded_m=(1.0, 0.0, 0.0), max_accuracy_m=0.1)

    said = [one.verdict for one in monitor.watch(without(given, left_out))]
    assert said == [Verdict.INCONCLUSIVE if left_out else Verdict.VIOLATED]


# What is remembered ----------------------------------------------------------------------------

SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
STANDSTILL = MonitoredStandstill(workspace=SQUARE, t_on_s=0.0)
INSIDE = recorded(
    {
        "position/ann": ("m", at(during((1.0, 9.0), yes=0.0, no=3.0))),
        "speed/arm": ("m/s", during((0.0, 9.0), yes=0.5)),
    }
)


def every(period_s: float, lasts: int) -> list[float]:
    """So many samples in a row, again and again."""
    first = np.arange(1.2, 5.0, period_s)
    return [round(float(one) + k / 100, 9) for one in first for k in range(lasts) if one + k / 100 < 5.0]


@pytest.mark.parametrize("how_many", [1, 4, 5])
def test_a_grace_does_not_begin_anew_behind_each_gap(how_many: int) -> None:
    """Somebody inside from 1 s on, and half a second to come to rest: 3.5 s of motion."""
    honest = found(STANDSTILL, INSIDE)
    robbed = found(STANDSTILL, without(INSIDE, every(0.45, how_many)))

    assert honest == Found(1, 1, 3.5, 3.5)
    assert robbed.longest_s >= 3.5
    assert robbed.least_s <= 3.5


def test_who_may_have_stepped_out_in_a_gap_may_have_a_grace_of_their_own() -> None:
    """Out for 30 ms at 2.5 s: moving from 1.5 to 2.5 s, and from 3.03 s on."""
    given = recorded(
        {
            "position/ann": ("m", at(during((1.0, 2.5), (2.53, 9.0), yes=0.0, no=3.0))),
            "speed/arm": ("m/s", during((0.0, 9.0), yes=0.5)),
        }
    )
    true, robbed = found(STANDSTILL, given), found(STANDSTILL, without(given, from_to(2.5, 2.53)))

    assert true.least_s == pytest.approx(1.0 + 1.97)
    assert robbed.least_s <= true.least_s <= true.longest_s <= robbed.longest_s


@pytest.mark.parametrize(
    "formula", ["always not once[0,1] (v > 1)", "always (v <= 1 or eventually[0,1] (v < 0))"]
)
def test_what_a_formula_looks_back_or_ahead_at_opens_as_far_as_it_looks(formula: str) -> None:
    """`!=` has no worse end, so nothing is known of a gap: of the three samples above 1 nothing is left."""
    monitor = StlFormula(
        formula=formula.replace("v > 1", "v != 0").replace("v <= 1", "v == 0"),
        signals={"v": "speed of robot in m/s"},
        t_off_s=0.1,
    )
    given = recorded({"speed/arm": ("m/s", during((2.0, 2.03), yes=2.0))})
    honest, robbed = found(monitor, given), found(monitor, without(given, from_to(2.0, 2.03)))

    assert honest.fewest == 1
    assert robbed.fewest == 0
    assert robbed.longest_s >= honest.longest_s
    assert robbed.most >= 1


# What takes its course -------------------------------------------------------------------------


def test_a_response_that_a_gap_may_hide_is_not_certain_to_lack() -> None:
    given = recorded(
        {
            "speed/arm": ("m/s", during((1.0, 1.02), yes=1.0)),
            "separation/arm/ann": ("m", during((1.5, 1.53), yes=1.0)),
        }
    )
    monitor = Within(
        trigger="a > 0.5",
        response="b > 0.5",
        within_s=1.0,
        signals={"a": "speed/{robot}", "b": "separation/{robot}/{human}"},
        max_gap_s=0.05,
    )

    assert found(monitor, given).most == 0
    robbed = found(monitor, without(given, from_to(1.5, 1.53)))
    assert robbed.fewest == 0 < robbed.most


def test_a_rest_that_a_gap_hides_may_have_been_the_one_after_which_nothing_may_move() -> None:
    """Stopped at 1 s, at rest from 1.1 to 1.25 s, moving again until 1.95 s; the rest is left out."""
    given = recorded(
        {"speed/arm": ("m/s", during((0.0, 1.1), (1.25, 1.95), yes=0.3))}, Event(1.0, "emergency_stop", "arm")
    )
    given = replace(given, witnessed=WITNESSED | {"emergency_stop_reset", "start"})
    monitor = EstopRestart()

    assert found(monitor, given) == Found(1, 1, pytest.approx(0.7), pytest.approx(0.7))
    robbed = found(monitor, without(given, from_to(1.1, 1.25)))
    assert robbed.fewest == 0
    assert robbed.longest_s >= 0.7
    # What is left of the rest, 60 ms, is as short as not to count, whatever had been between.
    assert found(monitor, without(given, [*from_to(1.1, 1.16), *from_to(1.22, 1.25)])).longest_s >= 0.7


def test_a_touch_that_a_gap_hides_may_have_joined_two_contacts() -> None:
    """20 N from 1 s on, 170 N for a while, and a pause of 10 ms, of which the sample behind is left out."""
    force_n = during((1.0, 1.9), (1.91, 3.0), yes=20.0) + during((1.6, 1.8), yes=150.0)
    given = recorded({"contact_force/arm/ann": ("N", force_n)})
    monitor = PflContact(region="chest", t_off_s=0.02)

    (whole,) = (one for one in monitor.watch(given) if one.verdict is Verdict.VIOLATED)
    assert whole.span == Span(1.0, 3.0)
    (opened,) = (one for one in monitor.watch_worlds(without(given, [1.91])) if isinstance(one, Worlds))
    assert max(one.span.duration_s for one in opened.worst if one.span) == pytest.approx(2.0)


def test_each_stop_that_a_gap_hides_may_have_been_bad() -> None:
    """The drives kept their power after each of three emergency stops; it is left out behind the first."""
    stops = [Event(t_s, "emergency_stop", "arm") for t_s in (1.0, 2.0, 3.0)]
    given = recorded({"speed/arm": ("m/s", during()), "drive_enabled/arm": ("1", during((0.0, 9.0)))}, *stops)
    monitor = StopPerformance(max_time_s=0.1, power_wait_s=0.2)

    assert (found(monitor, given).fewest, found(monitor, given).most) == (3, 3)
    robbed = found(monitor, without(given, from_to(1.5, 4.0), ["drive_enabled/arm"]))
    assert robbed.most >= 3 > robbed.fewest


def test_a_pressure_that_lacks_may_have_made_a_bad_contact_worse() -> None:
    """100 N for 1 s, of which 0.2 s have a pressure beyond all limits; half of that is left out."""
    given = recorded(
        {
            "contact_force/arm/ann": ("N", during((1.0, 2.0), yes=100.0)),
            "contact_pressure/arm/ann": ("Pa", during((1.4, 1.6), yes=1e8)),
        }
    )
    monitor = PflContact(region="chest", t_off_s=0.2)

    assert found(monitor, given) == Found(1, 1, pytest.approx(0.2), pytest.approx(0.2))
    robbed = found(monitor, without(given, from_to(1.5, 1.6), ["contact_pressure/arm/ann"]))
    assert robbed.least_s <= 0.2 <= robbed.longest_s


def test_a_contact_in_which_the_worst_is_left_out_may_have_been_bad_as_a_whole() -> None:
    """20 N for 3 s, with 400 N for 0.3 s in between: a violation as long as the contact."""
    given = recorded(
        {"contact_force/arm/ann": ("N", during((1.0, 4.0), yes=20.0) + during((2.0, 2.3), yes=380.0))}
    )
    monitor = PflContact(region="chest")

    (whole,) = (one for one in monitor.watch(given) if one.verdict is Verdict.VIOLATED)
    assert whole.span == Span(1.0, 4.0)
    robbed = without(given, from_to(2.0, 2.3))
    (opened,) = (one for one in monitor.watch_worlds(robbed) if isinstance(one, Worlds))
    (worst,) = (one for one in opened.worst if one.verdict is Verdict.VIOLATED)
    assert worst.span == whole.span
    assert worst.quantities["time_in_violation_s"] >= whole.quantities["time_in_violation_s"]
    assert [one.verdict for one in opened.best if one.span] == [Verdict.SATISFIED]


# Several limits --------------------------------------------------------------------------------


@pytest.mark.parametrize("apart_s", [0.0, 0.01])
@pytest.mark.parametrize("left_out", [[1.6], from_to(2.0, 2.04), from_to(1.59, 1.63)])
def test_limits_that_are_broken_together_are_counted_each(apart_s: float, left_out: list[float]) -> None:
    """A joint turns and the arm drifts though somebody is inside; both begin at once, or a sample apart."""
    given = recorded(
        {
            "position/ann": ("m", at(during((1.0, 9.0), yes=0.0, no=3.0))),
            "speed/arm": ("m/s", during()),
            "joint_speed/arm": ("rad/s", during((1.6, 9.0), yes=0.05)),
            "position/arm": ("m", at(during((1.6 + apart_s, 9.0), yes=0.02))),
        }
    )
    honest, robbed = found(STANDSTILL, given), found(STANDSTILL, without(given, left_out))

    assert honest == Found(2, 2, pytest.approx(6.8 - apart_s), pytest.approx(6.8 - apart_s))
    assert robbed.most >= honest.most
    assert robbed.longest_s >= honest.longest_s
    assert robbed.least_s <= honest.least_s
