"""Signals from signals; expected numbers from the monitor catalogue or by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from ariac_score.trial.bounds import BetweenSamples, MotionBound
from ariac_score.trial.derive import Derivation, derive_signals, source_quantities
from ariac_score.trial.model import Body, LogDefect, Trial
from ariac_score.trial.nearest import nearest_distances
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.velocities import TELEPORT_SPEED_M_S, centred_velocity

LAWFUL = settings(max_examples=60, derandomize=True, deadline=None)
ROBOT, HUMAN = Body("gantry", "robot", 0.0), Body("person_1", "human", 0.0)
PAIR = "gantry/person_1"
TWO = np.array([0.0, 0.01])
FINITE = st.floats(-1e9, 1e9)


def track(name: str, t: FloatArray | list[float], *points: tuple[float, float, float]) -> Signal:
    """Positions, or velocities, at times; one point stands for all of them."""
    t = np.asarray(t, dtype=float)
    rows = points * len(t) if len(points) == 1 else points
    return Signal(name, "m/s" if name.startswith("velocity") else "m", t, np.array(rows, dtype=float))


def trial(*signals: Signal, bodies: tuple[Body, ...] = (ROBOT, HUMAN)) -> Trial:
    return Trial("t", bodies=bodies, signals={s.name: s for s in signals})


def derived(of: Trial, *quantities: str, max_gap_s: float = 1.0) -> Trial:
    return derive_signals(of, [Derivation(quantity, max_gap_s) for quantity in quantities])


def along_x(*x_m: float) -> FloatArray:
    return np.array([[x, 0.0, 0.0] for x in x_m])


# Speeds --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error_s", "bound_m_s", "speed_m_s"),
    [
        (0.0, 1.6, 2.5),  # right stamps: 1 cm in 4 ms is what it was
        (0.005, 1.6, 1.6),  # 14 ms at most: at least 0.71 m/s, and no faster than the bound
        (0.005, 0.5, 0.01 / 0.014),  # even then above the bound: what cannot be explained stays
        (0.005, 4.0, 2.5),
    ],
)
def test_late_stamps_make_no_body_faster_than_its_bound(
    error_s: float, bound_m_s: float, speed_m_s: float
) -> None:
    position = Signal("position/person_1", "m", np.array([0.0, 0.004]), along_x(0, 0.01))
    assumed = BetweenSamples({"human": MotionBound(bound_m_s)}, time_error_s=error_s)
    of = derived(replace(trial(position, bodies=(HUMAN,)), between=assumed), "speed")
    np.testing.assert_allclose(of.signals["speed/person_1"].values, speed_m_s)


def test_what_late_stamps_explain_is_no_jump() -> None:
    """2 cm in 2 ms, stamped on arrival up to 10 ms late: 0.9 m/s at least, and not 10."""
    position = Signal("position/person_1", "m", np.array([0.0, 0.002]), along_x(0, 0.02), stamp_jitter_s=0.01)
    found = derived(replace(trial(position, bodies=(HUMAN,)), between=BetweenSamples()), "speed")
    assert found.signals["speed/person_1"].values.tolist() == [4.0, 4.0]
    assert found.log_defects == ()
    assert "speed/person_1" not in derived(trial(position, bodies=(HUMAN,)), "speed").signals


def test_a_steady_movement_has_one_velocity_everywhere_also_at_the_ends() -> None:
    t = np.arange(7) / 4
    positions = np.stack([2 * t, -t, 0.5 * t], axis=1)

    at, velocity, jumps = centred_velocity(t, positions)

    assert at.tolist() == t.tolist()
    assert velocity.tolist() == [[2.0, -1.0, 0.5]] * 7
    assert jumps == 0


def test_the_difference_is_centred_over_two_samples_on_each_side() -> None:
    # x = t^2 at 0..4: at t = 2 the difference runs over [0, 4]: 16/4 = 4 = 2t, without lag.
    # At t = 0 over [0, 2]: 4/2 = 2; at t = 1 over [0, 3]: 9/3 = 3.
    _, velocity, _ = centred_velocity(np.arange(5.0), along_x(0, 1, 4, 9, 16), teleport_speed_m_s=100.0)

    assert velocity[:3, 0].tolist() == [2.0, 3.0, 4.0]


def test_a_window_in_seconds_does_not_depend_on_the_rate() -> None:
    # x = t^2 over +-1 s is 2t at every rate, away from the ends.
    for rate in (2, 4, 16):
        t = np.arange(4 * rate + 1) / rate
        _, velocity, _ = centred_velocity(t, along_x(*t**2), half_window_s=1.0, teleport_speed_m_s=100.0)
        assert velocity[2 * rate, 0] == pytest.approx(4.0)


def test_a_window_in_seconds_shorter_than_a_step_takes_the_neighbours() -> None:
    _, velocity, _ = centred_velocity(np.arange(3.0), along_x(0, 1, 4), half_window_s=0.1)

    assert velocity[:, 0].tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("n", [0, 1])
def test_fewer_than_two_samples_have_no_velocity(n: int) -> None:
    at, velocity, jumps = centred_velocity(np.zeros(n), np.zeros((n, 3)))

    assert (len(at), velocity.shape, jumps) == (0, (0, 3), 0)


def test_w19_2_a_teleport_of_8_m_splits_the_track_and_is_never_a_speed() -> None:
    # 1 m/s at 100 Hz, with a jump of 8 m in one step of 0.01 s: 800 m/s for a naive difference.
    t = np.arange(200) / 100
    x = t + np.where(np.arange(200) >= 100, 8.0, 0.0)
    signals = derived(trial(track("position/person_1", t, *map(tuple, along_x(*x)))), "speed")

    speed = signals.signals["speed/person_1"]
    assert speed.values == pytest.approx(1.0)
    assert len(speed) == 198  # the samples before and after the jump have none
    (defect,) = signals.log_defects
    assert (defect.kind, defect.where, defect.count) == ("teleport", "position/person_1", 1)


@pytest.mark.parametrize("half_window_s", [0.0, 0.3])
def test_no_window_reaches_across_a_teleport(half_window_s: float) -> None:
    t = np.arange(20) / 10
    x = np.where(np.arange(20) >= 10, 50.0, 0.0)

    _, velocity, jumps = centred_velocity(t, along_x(*x), half_window_s=half_window_s)

    assert jumps == 1
    assert not velocity.any()


def test_a_step_at_the_teleport_speed_is_a_movement_and_a_faster_one_is_a_jump() -> None:
    fast = float(np.nextafter(TELEPORT_SPEED_M_S, 9.0))

    assert centred_velocity(np.array([0.0, 1.0]), along_x(0.0, TELEPORT_SPEED_M_S))[2] == 0
    at, _, jumps = centred_velocity(np.array([0.0, 1.0]), along_x(0.0, fast))
    assert (len(at), jumps) == (0, 1)  # two tracks of one sample each: neither has a velocity


def test_a_sample_alone_between_two_jumps_has_no_velocity() -> None:
    at, _, jumps = centred_velocity(np.arange(5.0), along_x(0, 0, 100, 0, 0))

    assert (at.tolist(), jumps) == ([0.0, 4.0], 2)


def test_a_pose_that_is_updated_in_leaps_has_no_speed_rather_than_none_at_all() -> None:
    # 3 m/s, each pose recorded twice: steps of 6 m/s and standstills between them.
    x = np.repeat(np.arange(50) * 0.06, 2)

    at, _, _ = centred_velocity(np.arange(100) / 100, along_x(*x))

    assert at.tolist() == [0.0, 0.99]  # the ends, beside no jump on one side, are all that is left


def test_no_difference_crosses_a_gap_and_a_gap_is_no_jump() -> None:
    t = np.array([0.0, 0.1, 0.2, 5.0, 5.1, 5.2])
    x = along_x(0.0, 0.1, 0.2, 0.2, 0.1, 0.0)

    at, velocity, jumps = centred_velocity(t, x, max_gap_s=0.1)

    assert len(at) == 6
    assert velocity[:, 0] == pytest.approx([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
    assert jumps == 0


def test_mistake_6_steps_across_a_full_second_count_seconds_and_nanoseconds() -> None:
    # 0.2 m in 0.1 s is 2 m/s. With the ns field alone the step is 50e6 - 950e6 ns: -0.22 m/s.
    stamps_ns = [999_950_000_000 + 100_000_000 * k for k in range(4)]  # a full second after the first
    t = np.array([ns / 1e9 for ns in stamps_ns])

    _, velocity, _ = centred_velocity(t, along_x(0.0, 0.2, 0.4, 0.6))

    assert velocity[:, 0] == pytest.approx(2.0)


@LAWFUL
@given(
    st.lists(st.floats(-3, 3), min_size=2, max_size=30),
    st.integers(-100_000, 100_000),
)
def test_shifting_all_stamps_moves_the_times_of_speeds_and_nothing_else(x: list[float], shift: int) -> None:
    t = np.arange(len(x)) / 4  # exact in float64, also when shifted

    at, velocity, jumps = centred_velocity(t, along_x(*x))
    later, same, as_many = centred_velocity(t + shift, along_x(*x))

    assert later.tolist() == (at + shift).tolist()
    assert (same.tolist(), as_many) == (velocity.tolist(), jumps)


@LAWFUL
@given(st.lists(st.floats(-50, 50), min_size=2, max_size=40), st.integers(1, 4))
def test_no_speed_is_ever_above_the_teleport_speed(x: list[float], half_window: int) -> None:
    t = np.arange(len(x)) / 8

    _, velocity, jumps = centred_velocity(t, along_x(*x), half_window_samples=half_window)

    assert (np.abs(velocity[:, 0]) <= TELEPORT_SPEED_M_S * (1 + 1e-12)).all()
    assert jumps == int((np.abs(np.diff(x)) > TELEPORT_SPEED_M_S / 8).sum())


# Pairs ---------------------------------------------------------------------------------


def test_worked_example_w1_6_gives_distance_and_both_directed_speeds() -> None:
    # d = |(2, 1.5, 0)| = 2.5; u = (0.8, 0.6, 0); 0.6*0.8 + 0.3*0.6 = 0.66; -(-0.8*0.8 + 0.2*0.6) = 0.52.
    found = derived(
        trial(
            track("position/gantry", TWO, (0, 0, 1)),
            track("velocity/gantry", TWO, (0.6, 0.3, 0)),
            track("position/person_1", TWO, (2, 1.5, 1)),
            track("velocity/person_1", TWO, (-0.8, 0.2, 0)),
        ),
        "centre_distance",
        "approach_speed_robot",
        "approach_speed_human",
        "speed",
    ).signals

    assert found[f"centre_distance/{PAIR}"].values == pytest.approx(2.5)
    assert found[f"approach_speed_robot/{PAIR}"].values == pytest.approx(0.66)
    assert found[f"approach_speed_human/{PAIR}"].values == pytest.approx(0.52)
    assert found["speed/gantry"].values == pytest.approx(0.6708203932499369)
    assert found["speed/person_1"].values == pytest.approx(0.8246211251235323)


def test_who_moves_away_has_a_negative_approach_speed() -> None:
    found = derived(
        trial(
            track("position/gantry", TWO, (0, 0, 0)),
            track("velocity/gantry", TWO, (-0.5, 0, 0)),
            track("position/person_1", TWO, (3, 0, 0)),
            track("velocity/person_1", TWO, (1, 0, 0)),
        ),
        "approach_speed_robot",
        "approach_speed_human",
    ).signals

    assert found[f"approach_speed_robot/{PAIR}"].values.tolist() == [-0.5, -0.5]
    assert found[f"approach_speed_human/{PAIR}"].values.tolist() == [-1.0, -1.0]


def test_two_bodies_in_one_point_have_a_distance_of_0_and_no_direction() -> None:
    found = derived(
        trial(
            track("position/gantry", [0.0, 1.0], (0, 0, 0)),
            track("velocity/gantry", [0.0, 1.0], (1, 0, 0)),
            track("position/person_1", [0.0, 1.0], (0, 0, 0), (1, 0, 0)),
            track("velocity/person_1", [0.0, 1.0], (1, 0, 0)),
        ),
        "centre_distance",
        "approach_speed_robot",
    ).signals

    assert found[f"centre_distance/{PAIR}"].values.tolist() == [0.0, 1.0]
    assert found[f"approach_speed_robot/{PAIR}"].t.tolist() == [1.0]


def test_the_distance_in_the_plane_leaves_height_out() -> None:
    found = derived(
        trial(track("position/gantry", TWO, (0, 0, 5)), track("position/person_1", TWO, (3, 4, 0))),
        "centre_distance_2d",
        "centre_distance",
    ).signals

    assert found[f"centre_distance_2d/{PAIR}"].values.tolist() == [5.0, 5.0]
    assert found[f"centre_distance/{PAIR}"].values == pytest.approx(math.sqrt(50))


@pytest.mark.parametrize(("apart_m", "separation_m"), [(3.0, 2.25), (0.75, 0.0), (0.5, 0.0), (0.0, 0.0)])
def test_separation_is_between_surfaces_and_never_below_0(apart_m: float, separation_m: float) -> None:
    bodies = (Body("gantry", "robot", radius_m=0.5), Body("person_1", "human", radius_m=0.25))
    positions = track("position/gantry", TWO, (0, 0, 0)), track("position/person_1", TWO, (apart_m, 0, 0))

    found = derived(trial(*positions, bodies=bodies), "separation").signals

    assert found[f"separation/{PAIR}"].values.tolist() == [separation_m] * 2


def test_separation_is_the_minimum_over_all_links_at_each_time() -> None:
    # The human stands at 0. The torso is at 4 and stays; the hand comes from 9 to 1: minima 4, 1.
    bodies = (Body("gantry", "robot", radius_m=0.5, links=("hand", "torso")), HUMAN)
    found = derived(
        trial(
            track("position/gantry", TWO, (0.1, 0, 0)),  # the origin of a body with links does not count
            track("position/gantry::torso", TWO, (4, 0, 0)),
            track("position/gantry::hand", TWO, (0, 9, 0), (0, 1, 0)),
            track("position/person_1", TWO, (0, 0, 0)),
            bodies=bodies,
        ),
        "separation",
    ).signals

    assert found[f"separation/{PAIR}"].values.tolist() == [3.5, 0.5]


@LAWFUL
@given(
    st.lists(st.tuples(*[st.floats(-5, 5)] * 3), min_size=1, max_size=8),
    st.floats(0, 3),
    st.floats(0, 3),
)
def test_separation_is_never_negative_and_never_above_the_centre_distance(
    places: list[tuple[float, float, float]], r_robot: float, r_human: float
) -> None:
    t = np.arange(len(places), dtype=float)
    bodies = (Body("gantry", "robot", r_robot), Body("person_1", "human", r_human))
    found = derived(
        trial(track("position/gantry", t, *places), track("position/person_1", t, (0, 0, 0)), bodies=bodies),
        "separation",
        "centre_distance",
    ).signals

    separation = found[f"separation/{PAIR}"].values
    assert (separation >= 0).all()
    assert (separation <= found[f"centre_distance/{PAIR}"].values).all()


def test_a_signal_exists_for_each_pair_of_robot_and_human() -> None:
    bodies = (
        Body("r1", "robot", 0.0),
        Body("r2", "robot", 0.0),
        Body("h1", "human", 0.0),
        Body("cart", "agv", 0.0),
    )
    positions = [track(f"position/{b.id}", TWO, (i, 0, 0)) for i, b in enumerate(bodies)]

    found = derived(trial(*positions, bodies=bodies), "centre_distance").signals

    assert sorted(n for n in found if n.startswith("centre")) == [
        "centre_distance/r1/h1",
        "centre_distance/r2/h1",
    ]


TRUCK, ANN, DRONES = Body("truck", "vehicle", 0.5), Body("ann", "pedestrian", 0.25), ("d1", "d2", "d3")


def asked(of: Trial, *wanted: tuple[str, str]) -> dict[str, Signal]:
    """What is derived of pairs, without the velocities it follows from."""
    found = derive_signals(of, [Derivation(quantity, 1.0, pair) for quantity, pair in wanted]).signals
    return {name: signal for name, signal in found.items() if name.count("/") == 2}


def test_a_pair_of_any_kinds_has_its_distances_and_approaches_by_hand() -> None:
    # The truck drives 3 m/s along x towards ann, who comes 1 m/s towards it; 10 m apart at first.
    t = np.arange(3.0)
    tracks = (
        track("position/truck", t, (0, 0, 0), (3, 0, 0), (6, 0, 0)),
        track("position/ann", t, (10, 0, 0), (9, 0, 0), (8, 0, 0)),
    )
    quantities = {
        "separation": [9.25, 5.25, 1.25],
        "centre_distance": [10, 6, 2],
        "centre_distance_2d": [10, 6, 2],
        "approach_speed_robot": [3, 3, 3],
        "approach_speed_human": [1, 1, 1],
        "relative_speed": [4, 4, 4],
        "body_separation": [9.25, 5.25, 1.25],
    }

    wanted = [(quantity, "{vehicle}/{pedestrian}") for quantity in quantities]
    found = asked(trial(*tracks, bodies=(TRUCK, ANN)), *wanted)

    assert {name: list(signal.values) for name, signal in found.items()} == {
        f"{quantity}/truck/ann": values for quantity, values in quantities.items()
    }


def crowd() -> Trial:
    bodies = (ROBOT, HUMAN, TRUCK, ANN, *(Body(one, "drone", 0.0) for one in reversed(DRONES)))
    return trial(*(track(f"position/{b.id}", TWO, (i, 0, 0)) for i, b in enumerate(bodies)), bodies=bodies)


@pytest.mark.parametrize(
    ("pair", "those"),
    [
        ("{vehicle}/{pedestrian}", ["truck/ann"]),
        ("{pedestrian}/{vehicle}", ["ann/truck"]),
        ("{drone}/{drone}", ["d1/d2", "d1/d3", "d2/d3"]),
        ("{drone}/{vehicle}", ["d1/truck", "d2/truck", "d3/truck"]),
        ("truck/{drone}", ["truck/d1", "truck/d2", "truck/d3"]),
        ("d2/{drone}", ["d2/d1", "d2/d3"]),
        ("d3/d1", ["d3/d1"]),
        ("", [PAIR]),
        ("truck/truck", []),
        ("truck", []),
        ("{vehicle}/nobody", []),
        ("{vehicel}/{pedestrian}", []),
    ],
)
def test_only_the_pairs_that_are_asked_for_are_derived(pair: str, those: list[str]) -> None:
    assert list(asked(crowd(), ("separation", pair))) == [f"separation/{one}" for one in those]


def test_pairs_asked_for_one_quantity_are_not_derived_for_another_and_add_up_for_the_same() -> None:
    found = asked(
        crowd(), ("separation", "{vehicle}/{pedestrian}"), ("centre_distance", ""), ("separation", "d1/d2")
    )

    assert list(found) == [f"centre_distance/{PAIR}", "separation/d1/d2", "separation/truck/ann"]


def test_without_kinds_a_distance_of_any_two_bodies_is_of_all_but_two_humans() -> None:
    both = (*crowd().bodies, Body("bob", "human", 0.0))
    here = replace(crowd(), bodies=both, signals={**crowd().signals, **positions_of("bob")})

    found = asked(here, ("body_separation", ""))

    assert len(found) == 8 * 7 // 2 - 1
    assert "body_separation/bob/person_1" not in found


def positions_of(name: str) -> dict[str, Signal]:
    return {f"position/{name}": track(f"position/{name}", TWO, (20, 0, 0))}


def test_nothing_is_computed_of_a_pair_before_it_is_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    computed: list[int] = []

    def counted(one: Any, others: Any, components: slice = slice(None)) -> FloatArray:
        computed.append(len(others))
        return nearest_distances(one, others, components)

    monkeypatch.setattr("ariac_score.trial.nearest.nearest_distances", counted)
    found = asked(crowd(), ("separation", "{vehicle}/{pedestrian}"), ("separation", "{vehicle}/{drone}"))
    assert computed == []

    found["separation/truck/ann"].values  # noqa: B018  # looking at it computes it
    assert computed == [1]  # not of the drones too
    found["separation/truck/d2"].values  # noqa: B018
    found["separation/truck/d3"].values  # noqa: B018
    assert computed == [1, 3]  # all drones in one pass


def test_what_the_log_records_of_a_pair_of_any_kinds_is_not_replaced() -> None:
    recorded = Signal("separation/truck/ann", "m", TWO, np.array([7.0, 7.0]))
    here = replace(crowd(), signals={**crowd().signals, recorded.name: recorded})

    assert asked(here, ("separation", "{vehicle}/{pedestrian}"))[recorded.name] is recorded


# What may not be derived ---------------------------------------------------------------


def test_what_the_log_records_is_never_replaced() -> None:
    speed = Signal("speed/gantry", "m/s", TWO, np.array([7.0, 7.0]))
    distance = Signal(f"centre_distance/{PAIR}", "m", TWO, np.array([9.0, 9.0]))
    recorded = trial(
        speed,
        distance,
        track("position/gantry", TWO, (0, 0, 0)),
        track("position/person_1", TWO, (1, 0, 0)),
    )

    found = derived(recorded, "speed", "centre_distance").signals

    assert found["speed/gantry"] is speed
    assert found[f"centre_distance/{PAIR}"] is distance


def test_a_recorded_velocity_makes_the_speed_although_the_position_says_otherwise() -> None:
    found = derived(
        trial(
            track("velocity/gantry", TWO, (3, 4, 0)), track("position/gantry", TWO, (0, 0, 0), (0.01, 0, 0))
        ),
        "speed",
    ).signals

    assert found["speed/gantry"].values.tolist() == [5.0, 5.0]


def test_the_given_trial_is_not_changed() -> None:
    recorded = trial(track("position/gantry", TWO, (0, 0, 0)))

    derived(recorded, "speed")

    assert list(recorded.signals) == ["position/gantry"]


@pytest.mark.parametrize(
    "quantity", ["speed", "velocity", "centre_distance", "separation", "approach_speed_human"]
)
def test_what_cannot_be_derived_is_absent(quantity: str) -> None:
    robot_alone = trial(track("position/gantry", TWO, (0, 0, 0)))

    assert not [n for n in derived(robot_alone, quantity).signals if "person_1" in n]


@pytest.mark.parametrize("quantity", ["temperature", ""])
def test_an_unknown_quantity_is_not_derived(quantity: str) -> None:
    recorded = trial(track("position/gantry", TWO, (0, 0, 0)))

    assert dict(derived(recorded, quantity).signals) == dict(recorded.signals)


def test_a_distance_has_no_samples_in_the_gap_of_either_body() -> None:
    t = np.arange(11) / 10
    human_t = [0.05, 0.15, 0.95]
    found = derived(
        trial(track("position/gantry", t, (0, 0, 0)), track("position/person_1", human_t, (1, 0, 0))),
        "centre_distance",
        max_gap_s=0.1,
    ).signals

    assert found[f"centre_distance/{PAIR}"].t.tolist() == pytest.approx([0.05, 0.1, 0.15, 0.95])


def test_bodies_seen_at_no_common_time_have_no_distance() -> None:
    apart = trial(
        track("position/gantry", [0.0, 1.0], (0, 0, 0)), track("position/person_1", [2.0, 3.0], (0, 0, 0))
    )

    assert f"centre_distance/{PAIR}" not in derived(apart, "centre_distance").signals


@pytest.mark.parametrize("other", ["approach_speed_robot", "speed", "velocity"])
def test_a_quantity_wanted_twice_is_derived_across_the_shorter_gap_only(other: str) -> None:
    # The robot moves 1 m in a gap of 0.5 s; whoever accepts 0.1 s must not get a speed out of it,
    # although another monitor, served first, would take it.
    recorded = trial(
        track("position/gantry", [0.0, 0.5], (0, 0, 0), (1, 0, 0)),
        track("position/person_1", [0.0, 0.5], (9, 0, 0)),
    )

    found = derive_signals(recorded, [Derivation(other, 1.0), Derivation("velocity", 0.1)]).signals

    assert "velocity/gantry" not in found


def test_jumps_already_counted_are_not_counted_again() -> None:
    jumping = trial(track("position/gantry", TWO, (0, 0, 0), (8, 0, 0)))

    once = derived(jumping, "velocity")
    twice = derived(once, "velocity", "speed")

    assert [d.count for d in once.log_defects] == [1]
    assert twice.log_defects == once.log_defects


def test_defects_of_the_log_are_kept() -> None:
    known = LogDefect("repeated_stamps", "/tf", 3, "as read")
    recorded = Trial("t", bodies=(ROBOT,), log_defects=(known,))

    assert derived(recorded, "speed").log_defects == (known,)


def test_a_reader_is_asked_for_what_quantities_derive_from() -> None:
    assert source_quantities(["speed"]) == {"speed", "velocity", "position"}
    assert source_quantities(["separation"]) == {"separation", "position"}
    assert source_quantities(["temperature"]) == {"temperature"}
    assert source_quantities([]) == frozenset()


# Links ---------------------------------------------------------------------------------

STANDING = track("position/gantry", [0.0, 1.0, 2.0], (0.0, 0.0, 0.0))
ARM = track("position/gantry::arm", [0.0, 1.0, 2.0], (0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (4.0, 0.0, 0.0))
VISITOR = track("position/person_1", [0.0, 1.0, 2.0], (9.0, 0.0, 0.0))
ARTICULATED = Body("gantry", "robot", radius_m=0.5, links=("arm",))


def test_a_robot_whose_origin_stands_still_moves_as_fast_as_its_fastest_link() -> None:
    moved = derived(trial(STANDING, ARM, VISITOR, bodies=(ARTICULATED, HUMAN)), "speed")

    assert moved.signals["speed/gantry"].values.tolist() == [2.0, 2.0, 2.0]


@pytest.mark.parametrize("quantity", ["centre_distance", "centre_distance_2d"])
def test_the_nearest_link_gives_the_distance(quantity: str) -> None:
    moved = derived(trial(STANDING, ARM, VISITOR, bodies=(ARTICULATED, HUMAN)), quantity)

    assert moved.signals[f"{quantity}/{PAIR}"].values.tolist() == [9.0, 7.0, 5.0]


def test_the_nearest_link_gives_the_directed_speed() -> None:
    moved = derived(trial(STANDING, ARM, VISITOR, bodies=(ARTICULATED, HUMAN)), "approach_speed_robot")

    assert moved.signals[f"approach_speed_robot/{PAIR}"].values.tolist() == [2.0, 2.0, 2.0]


def test_a_followed_link_that_is_not_recorded_leaves_distance_and_speed_unknown() -> None:
    blind = derived(trial(STANDING, VISITOR, bodies=(ARTICULATED, HUMAN)), "speed", "centre_distance")

    assert not {"speed/gantry", f"centre_distance/{PAIR}"} & blind.signals.keys()


@given(
    hnp.arrays(np.float64, st.tuples(st.integers(1, 4), st.integers(0, 30), st.just(3)), elements=FINITE),
    st.integers(1, 3),
)
@settings(max_examples=60, deadline=None)
def test_the_nearest_distance_is_the_least_of_all_to_the_bit(tracks: Any, points: int) -> None:
    human = [np.roll(tracks[0], i + 1, axis=0) * 0.75 for i in range(points)]
    expected = np.full(tracks.shape[1], np.inf)
    for a in tracks:
        for b in human:
            dx, dy, dz = (b - a).T
            expected = np.minimum(expected, np.sqrt(dx * dx + dy * dy + dz * dz))

    found = nearest_distances(list(tracks), [human, human[:1], []])
    assert found[0].tobytes() == expected.tobytes()
    assert np.isinf(found[2]).all()


def test_the_nearest_distance_does_not_depend_on_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    dice = np.random.default_rng(3)
    one, other = dice.normal(size=(2, 100, 3)), dice.normal(size=(2, 100, 3))
    whole = nearest_distances(list(one), [list(other)], slice(2))
    monkeypatch.setattr("ariac_score.trial.nearest._BLOCK_SAMPLES", 7)

    assert nearest_distances(list(one), [list(other)], slice(2)).tobytes() == whole.tobytes()


def test_humans_measured_at_once_have_the_distances_they_have_alone() -> None:
    dice, t = np.random.default_rng(4), np.arange(50) / 10
    bodies = [ROBOT, *(Body(f"person_{i}", "human", 0.0) for i in range(4))]
    tracks = {b.id: Signal(f"position/{b.id}", "m", t, dice.normal(size=(50, 3))) for b in bodies}
    tracks["person_3"] = Signal("position/person_3", "m", t[:40], dice.normal(size=(40, 3)))
    together = derived(trial(*tracks.values(), bodies=tuple(bodies)), "centre_distance", "separation")

    for body in bodies[1:]:
        pair = (ROBOT, body)
        alone = derived(trial(*(tracks[b.id] for b in pair), bodies=pair), "centre_distance", "separation")
        for quantity in ("centre_distance", "separation"):
            name = f"{quantity}/{ROBOT.id}/{body.id}"
            assert together.signals[name].t.tobytes() == alone.signals[name].t.tobytes()
            assert together.signals[name].values.tobytes() == alone.signals[name].values.tobytes()
