"""The trial and its parts: poses by hand, what is refused, and which stretch counts."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.errors import LogError, MissingSignalError
from ariac_score.trial.events import ARM_COLLISION, COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Body, Pose, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import Span

LAWFUL = settings(max_examples=80, derandomize=True, deadline=None)
HERE = (0.0, 0.0, 0.0)
HALF = math.sqrt(0.5)
NAN, INF = float("nan"), float("inf")
SPEED = Signal("speed/human", "m/s", np.array([0.0]), np.array([1.0]))


# Poses ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rpy_rad", "wxyz"),
    [
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        ((math.pi / 2, 0.0, 0.0), (HALF, HALF, 0.0, 0.0)),
        ((0.0, math.pi / 2, 0.0), (HALF, 0.0, HALF, 0.0)),
        ((0.0, 0.0, math.pi / 2), (HALF, 0.0, 0.0, HALF)),
        ((math.pi, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)),
        ((0.0, 0.0, -math.pi / 2), (HALF, 0.0, 0.0, -HALF)),
        # qz(90) * qx(90) = (h + h k)(h + h i) = 1/2 (1 + i + j + k), as k i = j
        ((math.pi / 2, 0.0, math.pi / 2), (0.5, 0.5, 0.5, 0.5)),
        # qz(90) * qy(90) = (h + h k)(h + h j) = 1/2 (1 - i + j + k), as k j = -i
        ((0.0, math.pi / 2, math.pi / 2), (0.5, -0.5, 0.5, 0.5)),
    ],
)
def test_roll_pitch_yaw_turn_about_fixed_axes_roll_first(
    rpy_rad: tuple[float, float, float], wxyz: tuple[float, float, float, float]
) -> None:
    assert Pose.from_rpy(HERE, rpy_rad).orientation_wxyz == pytest.approx(wxyz, abs=1e-15)


@pytest.mark.parametrize("degrees", [0, 30, 90, 179, -90, -179])
def test_yaw_comes_back(degrees: float) -> None:
    yaw_rad = math.radians(degrees)

    assert Pose.from_rpy(HERE, (0.0, 0.0, yaw_rad)).yaw_rad == pytest.approx(yaw_rad, abs=1e-15)


def test_half_a_turn_is_half_a_turn_either_way() -> None:
    assert abs(Pose(HERE, (0.0, 0.0, 0.0, 1.0)).yaw_rad) == pytest.approx(math.pi)
    assert abs(Pose(HERE, (0.0, 0.0, 0.0, -1.0)).yaw_rad) == pytest.approx(math.pi)


def test_a_flipped_part_has_the_yaw_it_was_ordered_with() -> None:
    # The rulebooks turn a flipped part by roll = pi and a yaw on top of it.
    assert Pose.from_rpy(HERE, (math.pi, 0.0, 0.5)).yaw_rad == pytest.approx(0.5)


def test_a_quaternion_and_its_opposite_are_one_heading() -> None:
    assert Pose(HERE, (-HALF, 0.0, 0.0, -HALF)).yaw_rad == pytest.approx(math.pi / 2)


@LAWFUL
@given(st.floats(-3.1, 3.1), st.floats(1e-3, 1e3))
def test_the_length_of_a_quaternion_does_not_change_the_heading(yaw_rad: float, scale: float) -> None:
    w, _, _, z = Pose.from_rpy(HERE, (0.0, 0.0, yaw_rad)).orientation_wxyz

    assert Pose(HERE, (w * scale, 0.0, 0.0, z * scale)).yaw_rad == pytest.approx(yaw_rad, abs=1e-9)


@LAWFUL
@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_quaternions_from_angles_have_length_one_and_keep_the_yaw(
    roll: float, pitch: float, yaw: float
) -> None:
    pose = Pose.from_rpy(HERE, (roll, pitch, yaw))

    assert sum(v * v for v in pose.orientation_wxyz) == pytest.approx(1.0)
    assert pose.yaw_rad == pytest.approx(yaw, abs=1e-9)


@pytest.mark.parametrize("bad", [NAN, INF, -INF])
@pytest.mark.parametrize("index", range(7))
def test_a_pose_with_a_number_that_is_none_is_refused(index: int, bad: float) -> None:
    numbers = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    numbers[index] = bad

    with pytest.raises(ValueError, match="finite"):
        Pose((numbers[0], numbers[1], numbers[2]), (numbers[3], numbers[4], numbers[5], numbers[6]))


@pytest.mark.parametrize("bad", [NAN, INF])
def test_angles_that_are_no_numbers_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match=r"finite|domain"):
        Pose.from_rpy(HERE, (0.0, 0.0, bad))


@pytest.mark.parametrize(
    "wxyz", [(0.0, 0.0, 0.0, 0.0), (0.0, -0.0, 0.0, -0.0), (1e-200, 0.0, 0.0, 1e-200), (1e200, 0.0, 0.0, 0.0)]
)
def test_a_quaternion_without_a_usable_norm_is_no_orientation(
    wxyz: tuple[float, float, float, float],
) -> None:
    with pytest.raises(ValueError, match=r"no orientation|near enough"):
        Pose(HERE, wxyz)


# Signals of a trial --------------------------------------------------------------------


def test_a_signal_is_had_by_name_in_its_unit() -> None:
    assert Trial("t", signals={SPEED.name: SPEED}).signal("speed/human", unit="m/s") is SPEED


def test_a_missing_signal_is_an_error_that_suggests_the_nearest_one() -> None:
    with pytest.raises(MissingSignalError, match="'speed/humn' is not in the log") as missing:
        Trial("t", signals={SPEED.name: SPEED}).signal("speed/humn", unit="m/s")

    assert missing.value.hint == "did you mean 'speed/human'?"
    assert (missing.value.name, missing.value.recorded) == ("speed/humn", ["speed/human"])


def test_a_log_without_signals_says_so() -> None:
    with pytest.raises(MissingSignalError) as missing:
        Trial("t").signal("speed/human", unit="m/s")

    assert missing.value.hint == "no signal was recorded"


def test_a_signal_in_another_unit_is_refused() -> None:
    with pytest.raises(LogError, match=r"'speed/human' is in 'm/s', the check asks for 'km/h'"):
        Trial("t", signals={SPEED.name: SPEED}).signal("speed/human", unit="km/h")


def test_signals_of_a_trial_cannot_be_added_or_taken_away() -> None:
    handed_in = {SPEED.name: SPEED}
    trial = Trial("t", signals=handed_in)

    handed_in.clear()
    with pytest.raises(TypeError):
        trial.signals["other"] = SPEED  # type: ignore[index]

    assert list(trial.signals) == ["speed/human"]


def test_pairs_come_in_order_of_their_ids_whatever_the_order_of_the_log() -> None:
    bodies = (Body("h2", "human"), Body("r2", "robot"), Body("h1", "human"), Body("r1", "robot"))

    pairs = [(robot.id, human.id) for robot, human in Trial("t", bodies=bodies).pairs()]

    assert pairs == [("r1", "h1"), ("r1", "h2"), ("r2", "h1"), ("r2", "h2")]


@pytest.mark.parametrize("kind", ["robot", "human"])
def test_there_are_no_pairs_without_robots_or_without_humans(kind: str) -> None:
    assert list(Trial("t", bodies=(Body("b", kind), Body("cart", "agv"))).pairs()) == []


# The window ----------------------------------------------------------------------------

RECORDED = Span(0.0, 100.0)


def window(*events: Event, recorded: Span | None = RECORDED) -> Span | None:
    return Trial("t", events=events, recorded=recorded).window


def started(t_s: float) -> Event:
    return Event(t_s, COMPETITION_STARTED)


def ended(t_s: float) -> Event:
    return Event(t_s, COMPETITION_ENDED)


@pytest.mark.parametrize(
    ("events", "expected"),
    [
        ((started(10.0), ended(90.0)), Span(10.0, 90.0)),
        ((started(10.0),), Span(10.0, 100.0)),
        ((ended(90.0),), Span(0.0, 90.0)),
        ((), RECORDED),
        ((Event(50.0, ARM_COLLISION),), RECORDED),
        ((started(10.0), started(20.0), ended(80.0), ended(90.0)), Span(10.0, 90.0)),
        ((ended(90.0), started(10.0)), Span(10.0, 90.0)),  # events in any order
        ((started(90.0), ended(10.0)), RECORDED),  # a start after the end is no window
        ((started(50.0), ended(50.0)), RECORDED),  # nor is an instant
    ],
)
def test_behaviour_counts_from_start_to_end_or_for_the_whole_recording(
    events: tuple[Event, ...], expected: Span
) -> None:
    assert window(*events) == expected
    assert Trial("t", events=events, recorded=RECORDED).duration_s == expected.duration_s


def test_without_a_recording_there_is_no_window() -> None:
    trial = Trial("t", events=(started(1.0), ended(2.0)))

    assert trial.window is None
    assert trial.duration_s == 0.0


def test_events_of_one_kind_come_in_order_of_time() -> None:
    trial = Trial("t", events=(Event(3.0, "a"), Event(1.0, "b"), Event(2.0, "a")))

    assert [event.t_s for event in trial.events_of("a")] == [2.0, 3.0]
    assert trial.events_of("c") == ()
