"""Signals that are computed when they are looked at: what they are, and what of them stays."""

from __future__ import annotations

import copy
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.trial import nearest
from ariac_score.trial.computed import Computed
from ariac_score.trial.derive import SOURCES, Derivation, derive_signals
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.nearest import nearest_points
from ariac_score.trial.signals import Signal, common_times
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.velocities import centred_velocity

LAWFUL = settings(max_examples=20, derandomize=True, deadline=None)
BODIES = (Body("r", "robot", 0.1, ("elbow", "tcp")), Body("h", "human", 0.3), Body("a", "agv", 0.4))
POINTS = ("r", "r::elbow", "r::tcp", "h", "a")


def wandering(seed: int, n: int = 60) -> Trial:
    """Bodies on several time bases, with gaps and jumps."""
    dice = np.random.default_rng(seed)
    base = np.arange(n) / 100 + np.where(np.arange(n) > n // 2, dice.choice([0.0, 0.04, 0.5]), 0.0)
    signals = {}
    for point in POINTS:
        t = base if dice.random() < 0.6 else np.sort(dice.choice(4 * n, n // 2, replace=False)) / 400
        places = np.cumsum(dice.normal(0.0, 0.01, (len(t), 3)), axis=0)
        places[len(t) // 3 :] += dice.choice([0.0, 0.0, 8.0])
        signals[f"position/{point}"] = Signal(f"position/{point}", "m", t, places)
    return Trial("t", bodies=BODIES, signals=signals)


def all_derived(trial: Trial, max_gap_s: float = 0.05) -> Trial:
    return derive_signals(trial, [Derivation(quantity, max_gap_s) for quantity in SOURCES])


# Signals computed where they are looked at -----------------------------------------------


@LAWFUL
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 7, 64]))
def test_what_is_derived_does_not_depend_on_how_many_rows_are_looked_at_together(
    seed: int, samples: int
) -> None:
    trial = wandering(seed)
    whole = {name: (s.t.tobytes(), s.values.tobytes()) for name, s in all_derived(trial).signals.items()}

    with patch.object(nearest, "_BLOCK_SAMPLES", samples):
        derived = all_derived(trial).signals
        found = {name: (s.t.tobytes(), s.values.tobytes()) for name, s in derived.items()}

    assert found == whole


@LAWFUL
@given(st.integers(0, 2**32 - 1))
def test_a_velocity_is_the_difference_over_two_samples_on_each_side_of_its_track(seed: int) -> None:
    position = wandering(seed).signals["position/r"]
    t, places = position.t, position.values
    jumps = [
        i for i in range(len(t) - 1) if np.linalg.norm(places[i + 1] - places[i]) > 5 * (t[i + 1] - t[i])
    ]
    begins = [0, *(i + 1 for i in range(len(t) - 1) if i in jumps or t[i + 1] - t[i] > 0.05 + 1e-9), len(t)]
    expected = []
    for i in range(len(t)):
        first = max(b for b in begins if b <= i)
        last = min(b for b in begins if b > i) - 1
        low, high = max(i - 2, first), min(i + 2, last)
        if high > low and not {i - 1, i} & set(jumps):
            expected.append((t[i], *((places[high] - places[low]) / (t[high] - t[low]))))

    at, velocity, counted = centred_velocity(t, places, max_gap_s=0.05)

    assert counted == len(jumps)
    assert np.column_stack([at, velocity]).tolist() == [list(row) for row in expected]


def test_of_points_equally_near_the_first_counts() -> None:
    place = np.zeros((3, 3))
    distance, pair = nearest_points([place + 5, place + 1, place - 1], [place + 9, place, place])

    # |(1, 1, 1)| from the second and the third of the robot to the second and the third of the human.
    assert distance.tolist() == [np.sqrt(3.0)] * 3
    assert pair.tolist() == [1 * 3 + 1] * 3


def test_a_derived_signal_that_is_changed_or_copied_is_a_plain_one() -> None:
    signal = all_derived(wandering(1)).signals["speed/h"]

    changed, copied = replace(signal, name="speed/other"), copy.copy(signal)

    assert isinstance(signal, Computed)
    assert type(changed) is type(copied) is Signal
    assert changed.name == "speed/other"
    assert copied.values.tobytes() == changed.values.tobytes() == signal.values.tobytes()


def test_a_derived_signal_cannot_be_written_to() -> None:
    signal = all_derived(wandering(1)).signals["speed/h"]

    with pytest.raises(ValueError, match="read-only"):
        signal.values[0] = 1.0
    with pytest.raises(AttributeError):
        signal.values = np.zeros(3)  # type: ignore[misc]


def test_what_is_no_number_is_refused_by_name_when_it_is_looked_at() -> None:
    huge = np.array([[1e200, 0.0, 0.0]] * 2)
    t = np.array([0.0, 0.01])
    trial = Trial(
        "t",
        bodies=(Body("r", "robot"), Body("h", "human")),
        signals={
            "position/r": Signal("position/r", "m", t, huge),
            "position/h": Signal("position/h", "m", t, -huge),
        },
    )
    signal = derive_signals(trial, [Derivation("centre_distance", 1.0)]).signals["centre_distance/r/h"]

    with np.errstate(over="ignore"), pytest.raises(ValueError, match=r"centre_distance/r/h.*finite"):
        _ = signal.values


# What stays ----------------------------------------------------------------------------


def test_numbers_over_time_are_computed_once_and_vectors_only_stay_while_they_are_held() -> None:
    made = []

    def of(shape: tuple[int, ...]) -> Signal:
        def make() -> FloatArray:
            made.append(shape)
            return np.zeros(shape)

        return Computed.of("speed/r", "m/s", np.arange(3.0), make)

    numbers, vectors = of((3,)), of((3, 2))
    for signal in (numbers, vectors):
        assert len(signal) == 3
        assert made == []  # the times are known without the values
        held = signal.values
        assert signal.values is held
        del held
        assert signal.values.shape[0] == 3
        counted, made[:] = len(made), []
        assert counted == signal.values.ndim


def test_a_trial_is_the_same_after_its_derived_signals_were_looked_at() -> None:
    signal = all_derived(wandering(1)).signals["velocity/h"]
    before = signal.identity

    assert len(signal.values)
    assert signal.identity == before


def test_a_common_base_has_the_samples_that_every_signal_covers() -> None:
    early, late = (Signal(f"speed/{i}", "m/s", np.array([i, i + 0.01]), np.zeros(2)) for i in (0.0, 5.0))
    between = Signal("speed/b", "m/s", np.array([0.005, 0.5]), np.zeros(2))

    assert common_times([early, late], max_gap_s=0.05).tolist() == []
    assert common_times([early, between], max_gap_s=0.05).tolist() == [0.005]  # 0.01 lies in a gap of one
    assert common_times([early, between], max_gap_s=1.0).tolist() == [0.005, 0.01]


@pytest.mark.parametrize("name", ["centre_distance/r/h", "speed/h"])
def test_a_derived_signal_spans_its_first_to_its_last_sample(name: str) -> None:
    t = np.array([0.5, 0.75, 1.0, 1.25])
    still = np.zeros((4, 3))
    trial = Trial(
        "t",
        bodies=(Body("r", "robot"), Body("h", "human")),
        signals={f"position/{body}": Signal(f"position/{body}", "m", t, still) for body in "rh"},
    )
    derived = derive_signals(trial, [Derivation(name.partition("/")[0], 1.0)]).signals[name]

    assert isinstance(derived, Computed)
    assert derived.span == Span(0.5, 1.25)
