"""A distance or a speed that is recorded and follows from places as well is bounded by both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Event, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.monitors.monitor import SubjectMonitor
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.model import Due
from ariac_score.trial.signals import Disbelieved
from ariac_score_standards import Always

BOUNDS: Mapping[str, Mapping[str, Any]] = {
    "human": {"max_speed_m_s": 2.0, "source": "a test"},
    "robot": {"max_speed_m_s": 0.0, "source": "bolted down"},
}
DISTANCE, SPEED = "separation/arm/ann", "speed/ann"
GAP = Span(1.0, 1.3)
AWAY_M = 1.2


def farther_than(limit_m: float) -> SubjectMonitor:
    return Always(
        holds=f"d >= {limit_m:g}", signals={"d": "separation/{robot}/{human}"}, unit="m", max_gap_s=0.05
    )


def coming(t: np.ndarray) -> np.ndarray:
    """She comes near within 0.5 s, and then stands."""
    return np.maximum(AWAY_M, AWAY_M + 0.5 - t)


def standing(t: np.ndarray) -> np.ndarray:
    return np.full(len(t), AWAY_M)


def places(x_m: Callable[[np.ndarray], np.ndarray] = coming, rate_hz: int = 50) -> dict[str, Signal]:
    """A human and a robot at the origin, seen from 0 s to 3 s."""
    t = np.arange(3 * rate_hz + 1) / rate_hz
    nothing = np.zeros(len(t))
    return {
        "position/ann": Signal("position/ann", "m", t, np.column_stack([x_m(t), nothing, nothing]), "tf"),
        "position/arm": Signal("position/arm", "m", t, np.zeros((len(t), 3)), "tf"),
    }


def recorded(
    value: Callable[[np.ndarray], np.ndarray] = coming, name: str = DISTANCE, late_s: float = 0.0
) -> Signal:
    """100 samples per second, and none in the gap."""
    t = np.arange(301) / 100
    t = t[(t <= GAP.start_s) | (t >= GAP.end_s)]
    unit = "m" if name == DISTANCE else "m/s"
    return Signal(name, unit, t, value(t - late_s), "/scanner")


def accelerating(most_m_s2: float) -> dict[str, dict[str, Any]]:
    """The bounds, and how fast her velocity changes."""
    return {**BOUNDS, "human": {**BOUNDS["human"], "max_acceleration_m_s2": most_m_s2}}


def trial(
    *signals: Signal,
    every: bool = False,
    stand_ins: bool = False,
    stated: Mapping[str, Mapping[str, Any]] = BOUNDS,
) -> Trial:
    ends = (Event(0.0, COMPETITION_STARTED), Event(3.0, COMPETITION_ENDED))
    given = Trial(
        "t",
        bodies=(Body("arm", "robot", 0.0), Body("ann", "human", 0.0)),
        signals={signal.name: signal for signal in signals},
        events=ends,
        recorded=Span(0.0, 3.0),
        between=between_samples({}, stated, every=every),
        stand_ins={DISTANCE: Due("/scanner", 100.0)} if stand_ins else {},
    )
    return derive_signals(given, [Derivation(quantity, 0.05) for quantity in ("separation", "speed")])


def worst_s(monitor: SubjectMonitor, given: Trial) -> float:
    """For how long the limit may have been broken, s."""
    return sum(
        finding.quantities["time_in_violation_s"]
        for one in monitor.watch_worlds(given)
        for finding in (one.worst if isinstance(one, Worlds) else (one,))
        if finding.verdict is Verdict.VIOLATED
    )


@pytest.mark.parametrize("every", [False, True])
def test_what_frames_show_in_the_gap_of_a_distance_is_not_open(every: bool) -> None:
    """At 2 m/s she may have been 0.3 m nearer; between two frames 0.02 m, and 0.01 m for both sources."""
    frames = tuple(places().values())

    assert worst_s(farther_than(1.0), trial(recorded(), every=every)) > 0.0
    assert worst_s(farther_than(1.16), trial(recorded(), *frames, every=every)) == 0.0


def test_what_may_have_been_between_two_frames_stays_open() -> None:
    """Whoever leaves out the samples of a short approach between two frames does not hide it."""
    frames = tuple(places().values())

    assert worst_s(farther_than(1.18), trial(recorded(), *frames)) > 0.0
    assert worst_s(farther_than(1.18), trial(*frames)) == 0.0  # nobody said that there is a distance


def shifted(t: np.ndarray) -> np.ndarray:
    return coming(t) + 0.05


def elsewhere_once(t: np.ndarray) -> np.ndarray:
    return coming(t) + 0.03 * (np.abs(t - 2.0) < 0.015)


@pytest.mark.parametrize(
    ("distance", "frames"),
    [
        (recorded(), shifted),
        (recorded(), elsewhere_once),
        (recorded(late_s=0.06), coming),  # at 1 m/s
        (recorded(standing), standing),
    ],
    ids=["of surfaces", "contradicted once", "always late", "at rest"],
)
def test_what_contradicts_or_never_showed_that_it_agrees_fills_no_gap(
    distance: Signal, frames: Callable[[np.ndarray], np.ndarray]
) -> None:
    given = trial(distance, *places(frames).values())

    assert worst_s(farther_than(1.0), given) == worst_s(farther_than(1.0), trial(distance)) > 0.0


def test_stamps_that_may_be_late_contradict_nothing_within_that_time() -> None:
    late = replace(recorded(late_s=0.06), stamp_jitter_s=0.06)

    assert worst_s(farther_than(1.0), trial(late)) > 0.0
    assert worst_s(farther_than(1.0), trial(late, *places().values())) == 0.0


@pytest.mark.parametrize("late_s", [0.0, 0.09])
def test_late_frames_show_what_was_in_a_gap_though_they_show_it_behind_the_gap(late_s: float) -> None:
    """A dash from 1.23 s to 1.29 s, of which late frames tell when the snapshots are there again."""

    def speed(t: np.ndarray) -> np.ndarray:
        return np.where((t >= 1.23) & (t < 1.29), 1.9, 0.5)

    def way(t: np.ndarray) -> np.ndarray:
        return 0.5 * t + 1.4 * np.clip(t - 1.23, 0.0, 0.06)

    frames = places(lambda t: way(t - late_s)).values()
    late = (replace(one, stamp_jitter_s=late_s) for one in frames)
    given = trial(recorded(speed, SPEED), *late)

    assert worst_s(slower_than(1.5), given) > 0.0


@pytest.mark.parametrize(
    "doubted",
    [
        replace(recorded(), holes=(GAP,)),
        replace(recorded(), disbelieved=(Disbelieved(GAP, 1.1, 0.0, 0.5, 1.2, contested=True),)),
    ],
    ids=["known to be lost", "contested"],
)
def test_what_a_source_is_known_to_lack_or_contests_itself_no_other_settles(doubted: Signal) -> None:
    assert worst_s(farther_than(1.0), trial(doubted, *places().values())) > 0.0


def test_frames_that_stand_for_a_topic_are_bounded_between_their_own_samples() -> None:
    frames = tuple(places().values())
    instead = trial(*frames, stand_ins=True)

    assert worst_s(farther_than(1.16), instead) == 0.0
    assert worst_s(farther_than(1.18), instead) > 1.4  # whenever no sample is near
    (opened,) = (one for one in farther_than(1.18).watch_worlds(instead) if isinstance(one, Worlds))
    assert opened.causes[0].text.endswith("in place of /scanner")
    assert not opened.tight


def slower_than(limit_m_s: float) -> SubjectMonitor:
    return Always(
        holds=f"v <= {limit_m_s:g}", signals={"v": "speed/{human}"}, unit="m/s", max_gap_s=0.05, t_on_s=0.0
    )


@pytest.mark.parametrize(("limit_m_s", "is_open"), [(1.4, True), (1.6, False)])
def test_a_dash_that_a_speed_over_several_frames_smooths_away_stays_open(
    limit_m_s: float, is_open: bool
) -> None:
    """0.5 m/s, and 1.5 m/s from one frame to the next: 0.75 m/s over four of them, at most 0.02 m/s apart."""
    walk = np.concatenate(([0.0], np.cumsum(np.where(np.arange(150) == 57, 0.03, 0.01))))
    frames = places(lambda _: walk)

    given = trial(recorded(lambda t: np.full(len(t), 0.5), SPEED), *frames.values())

    assert given.twins[SPEED].at(np.array([1.15])) == pytest.approx(0.75, abs=0.3)
    assert (worst_s(slower_than(limit_m_s), given) > 0.0) is is_open


@pytest.mark.parametrize(
    ("rate_hz", "stated", "limit_m_s", "is_open"),
    [
        (50, BOUNDS, 1.05, False),  # every second one of the samples that it stands in for
        (25, BOUNDS, 1.95, True),
        (50, accelerating(50.0), 1.45, True),  # up to 1.5 m/s within 20 ms
        (50, accelerating(50.0), 1.55, False),
    ],
)
def test_a_speed_is_believed_of_frames_that_come_half_as_often_or_as_far_as_its_acceleration_is_bounded(
    rate_hz: int, stated: Mapping[str, Mapping[str, Any]], limit_m_s: float, is_open: bool
) -> None:
    """1 m/s from frame to frame, of at most 2 m/s; and 0.02 m/s for both sources."""
    walks = recorded(lambda t: np.full(len(t), 1.0), SPEED)

    given = trial(walks, *places(lambda t: t, rate_hz).values(), stated=stated)

    assert SPEED in given.twins
    assert (worst_s(slower_than(limit_m_s), given) > 0.0) is is_open
    assert worst_s(slower_than(limit_m_s), trial(walks, stated=stated)) > 0.0


def test_a_speed_that_follows_from_places_is_open_as_far_as_it_follows_from_places_in_a_gap() -> None:
    """Over two samples before and behind: in a gap of 60 ms at 50 Hz, and in two intervals on either side."""
    t = np.arange(151) / 50
    t = t[(t < 1.01) | (t > 1.05)]
    walk = Signal("position/ann", "m", t, np.column_stack([t, 0.0 * t, 0.0 * t]), "tf")

    assert worst_s(slower_than(1.5), trial(walk)) == pytest.approx(0.06 + 4 * 0.02, abs=1e-6)


@pytest.mark.parametrize(("way_m", "is_open"), [(0.09, True), (0.11, False)])
def test_a_speed_that_never_shows_anybody_in_motion_stands_for_nothing(way_m: float, is_open: bool) -> None:
    """A base may rest while the arm on it moves; who is seen to walk is the one who walks."""
    frames = places(lambda t: AWAY_M + way_m * np.minimum(t, 1.0))

    instead = trial(*frames.values(), stated=accelerating(10.0))
    instead = replace(instead, stand_ins={SPEED: Due("/scanner", 100.0)})

    assert (worst_s(slower_than(1.0), instead) > 2.9) is is_open
    assert worst_s(slower_than(1.0), trial(*frames.values())) == 0.0


def test_places_that_stand_for_a_speed_leave_the_edges_open_of_what_they_show() -> None:
    """Three times 0.8 m/s for 0.2 s: a speed over four of their intervals shows less of it."""

    def way_m(t: np.ndarray) -> np.ndarray:
        return np.asarray(0.1 * t + 0.7 * np.sum([np.clip(t - k, 0.0, 0.2) for k in (0.5, 1.5, 2.5)], axis=0))

    alone = trial(*places(way_m, 50).values())
    instead = replace(alone, stand_ins={SPEED: Due("/scanner", 100.0)})

    assert worst_s(slower_than(0.5), alone) < 0.6 - 0.01
    assert worst_s(slower_than(0.5), instead) >= 0.6 - 1e-6
