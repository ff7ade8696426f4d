"""Signals window by window; what they are put together must be what they are as a whole, to the bit."""

from __future__ import annotations

import copy
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.trial import windows
from ariac_score.trial.derive import SOURCES, Derivation, centred_velocity, derive_signals, nearest_points
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Signal, align
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.windows import Aligned, Computed, Kept, TimeBase, cuts_of

LAWFUL = settings(max_examples=20, derandomize=True, deadline=None)
SIZES = st.sampled_from([1, 2, 7, 64, 4096])
BODIES = (Body("r", "robot", 0.1, ("elbow", "tcp")), Body("h", "human", 0.3), Body("a", "agv", 0.4))
POINTS = ("r", "r::elbow", "r::tcp", "h", "a")


def window_size(samples: int) -> object:
    return patch.object(windows, "LARGEST_WINDOW_SAMPLES", samples)


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


# One time base -------------------------------------------------------------------------


@LAWFUL
@given(st.integers(0, 2**32 - 1), SIZES, st.sampled_from([0.02, 0.05, 1.0]))
def test_windows_put_together_are_what_align_gives(seed: int, samples: int, max_gap_s: float) -> None:
    signals = list(wandering(seed).signals.values())
    t, values = align(signals, max_gap_s=max_gap_s)

    with window_size(samples):
        base = TimeBase(signals, max_gap_s=max_gap_s)
        times = [base.times(k) for k in range(len(base))]
        columns = [[base.values(i, k) for k in range(len(base))] for i in range(len(signals))]

    assert np.concatenate(times).tobytes() == t.tobytes()
    for windowed, whole in zip(columns, values, strict=True):
        assert np.concatenate(windowed).tobytes() == whole.tobytes()


@LAWFUL
@given(st.integers(0, 2**32 - 1), SIZES, st.sampled_from([None, Span(0.0, 0.1), Span(0.2, 0.31)]), st.data())
def test_any_samples_of_aligned_signals_are_those_that_align_gives(
    seed: int, samples: int, span: Span | None, draw: st.DataObject
) -> None:
    signals = list(wandering(seed).signals.values())
    t, values = align(signals, max_gap_s=0.05)
    inside = np.ones(len(t), bool) if span is None else (t >= span.start_s) & (t <= span.end_s)
    t, values = t[inside], [column[inside] for column in values]

    with window_size(samples):
        aligned = Aligned({signal.name: signal for signal in signals}, span, max_gap_s=0.05)
        first = draw.draw(st.integers(0, len(t)))
        last = draw.draw(st.integers(first, len(t)))
        columns = aligned.columns(first, last)

        assert len(aligned) == len(t)
        assert aligned.times(first, last).tobytes() == t[first:last].tobytes()
        assert np.concatenate([np.zeros(0), *aligned.stretches()]).tobytes() == t.tobytes()
        for signal, whole in zip(signals, values, strict=True):
            assert columns[signal.name].tobytes() == whole[first:last].tobytes()
        for at_s in (-np.inf, *t[::7].tolist(), *np.nextafter(t[::11], 9.0).tolist(), np.inf):
            assert aligned.row(at_s) == int(t.searchsorted(at_s))


@LAWFUL
@given(st.integers(0, 2**32 - 1), SIZES)
def test_what_only_helps_has_its_values_where_it_covers_and_none_elsewhere(seed: int, samples: int) -> None:
    one, *_, other = wandering(seed).signals.values()
    expected = np.array(other.at(one.t))
    expected[~other.covers(one.t, max_gap_s=0.05)] = np.nan

    with window_size(samples):
        base = TimeBase([one], max_gap_s=0.05)
        found = np.concatenate([base.beyond(k, other) for k in range(len(base))])

    assert np.array_equal(found, expected, equal_nan=True)


@LAWFUL
@given(st.integers(0, 2**32 - 1), st.integers(1, 50))
def test_no_signal_has_more_samples_in_a_window_than_allowed(seed: int, samples: int) -> None:
    signals = list(wandering(seed).signals.values())

    with window_size(samples):
        cuts = cuts_of(signals)

    for signal in signals:
        assert np.diff([0, *signal.t.searchsorted(cuts), len(signal)]).max() <= samples


def test_signals_that_share_no_time_have_an_empty_base() -> None:
    early, late = (Signal(f"speed/{i}", "m/s", np.array([i, i + 0.01]), np.zeros(2)) for i in (0.0, 5.0))

    base = TimeBase([early, late], max_gap_s=0.05)

    assert [len(base.times(k)) for k in range(len(base))] == [0]
    assert len(base.values(0, 0)) == 0


# Signals computed where they are looked at -----------------------------------------------


@LAWFUL
@given(st.integers(0, 2**32 - 1), st.sampled_from([1, 2, 7, 64]), st.sampled_from([0, 1000, 1 << 25]))
def test_what_is_derived_does_not_depend_on_windows_nor_on_what_stays(
    seed: int, samples: int, stays: int
) -> None:
    trial = wandering(seed)
    whole = {name: (s.t.tobytes(), s.values.tobytes()) for name, s in all_derived(trial).signals.items()}

    with window_size(samples), patch.object(windows, "KEPT_BYTES", stays):
        derived = all_derived(trial).signals
        found = {name: (s.t.tobytes(), s.values.tobytes()) for name, s in derived.items()}

    assert found == whole


@LAWFUL
@given(st.integers(0, 2**32 - 1), SIZES, st.data())
def test_any_rows_of_a_derived_signal_are_those_of_the_whole(
    seed: int, samples: int, data: st.DataObject
) -> None:
    with window_size(samples):
        signals = all_derived(wandering(seed)).signals
        signal = signals[data.draw(st.sampled_from(sorted(signals)))]
        first = data.draw(st.integers(0, len(signal)))
        last = data.draw(st.integers(first, len(signal)))
        at = data.draw(st.sampled_from([-np.inf, np.inf, *signal.t.tolist(), 0.1234]))

        t, values = signal.stretch(first, last)
        row = signal.row(at)

    assert t.tobytes() == signal.times(first, last).tobytes() == signal.t[first:last].tobytes()
    assert values.tobytes() == signal.values[first:last].tobytes()
    assert row == signal.t.searchsorted(at)


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


def test_no_more_stays_than_there_is_room_for() -> None:
    def window(k: int) -> tuple[FloatArray, FloatArray]:
        return np.zeros(1), np.full(10, float(k))

    with patch.object(windows, "KEPT_BYTES", 250):  # 80 bytes of values and 8 of times each
        kept = Kept()
    for k in range(3):
        kept.put((0, k), window(k))

    assert kept.get((0, 0), 1) is None
    assert kept.get((0, 1), 1) is not None
    kept.put((0, 3), window(3))
    assert kept.get((0, 2), 1) is None  # the one not asked for goes first
    assert kept.get((0, 1), 1) is not None


def test_signals_that_keep_windows_in_one_place_do_not_meet() -> None:
    kept = Kept()
    one, other = kept.number(), kept.number()
    kept.put((one, 0), (np.zeros(1), np.ones(1)))

    assert kept.get((other, 0), 1) is None


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
