"""Signals: what a recorded column may be, how it is settled, and what lies between its samples."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.trial.signals import Sample, Signal, align, settle
from ariac_score.trial.spans import FloatArray, Span

LAWFUL = settings(max_examples=80, derandomize=True, deadline=None)
NAN, INF = float("nan"), float("inf")


def signal(t: list[float], values: list[float] | list[list[float]], name: str = "speed/human") -> Signal:
    return Signal(name, "m/s", np.array(t, dtype=float), np.array(values, dtype=float))


def test_the_arrays_of_a_signal_cannot_be_written() -> None:
    speed = signal([0.0, 1.0], [5.0, 6.0])

    with pytest.raises(ValueError, match="read-only"):
        speed.values[0] = 9.0
    with pytest.raises(ValueError, match="read-only"):
        speed.t[0] = 9.0


def test_changing_the_arrays_handed_in_does_not_change_the_signal() -> None:
    t, values = np.array([0.0, 1.0]), np.array([5.0, 6.0])
    speed = Signal("speed/human", "m/s", t, values)

    t[0], values[0] = -7.0, -7.0

    assert speed.t.tolist() == [0.0, 1.0]
    assert speed.values.tolist() == [5.0, 6.0]


def test_whole_numbers_become_floats() -> None:
    counted = Signal("speed/human", "m/s", np.array([0, 1]), np.array([5, 6]))

    assert counted.t.dtype == counted.values.dtype == np.float64


@pytest.mark.parametrize(
    ("t", "values", "cause"),
    [
        ([0.0, 0.0], [1.0, 2.0], "strictly increasing"),
        ([1.0, 0.0], [1.0, 2.0], "strictly increasing"),
        ([0.0, NAN], [1.0, 2.0], "strictly increasing"),
        ([0.0, INF], [1.0, 2.0], "strictly increasing"),
        ([0.0, 1.0], [1.0, NAN], "values must be finite"),
        ([0.0, 1.0], [1.0, -INF], "values must be finite"),
        ([0.0, 1.0], [[1.0, 2.0], [1.0, INF]], "values must be finite"),
        ([0.0, 1.0], [1.0], "do not fit"),
        ([0.0], [1.0, 2.0], "do not fit"),
    ],
)
def test_a_column_that_readers_should_have_settled_is_refused(
    t: list[float], values: list[float], cause: str
) -> None:
    with pytest.raises(ValueError, match=cause) as refused:
        signal(t, values)
    assert "'speed/human'" in str(refused.value)


def test_a_column_of_matrices_is_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        Signal("speed/human", "m/s", np.zeros(2), np.zeros((2, 2, 2)))


def test_the_smallest_step_of_time_is_a_step() -> None:
    assert len(signal([1.0, float(np.nextafter(1.0, 2.0))], [0.0, 0.0])) == 2


def test_a_sample_is_evidence_with_its_name_time_and_unit() -> None:
    assert signal([0.5, 1.0], [5.0, 6.0]).sample(1) == Sample("speed/human", 1.0, 6.0, "m/s")
    assert signal([0.5], [[1.0, 2.0, 3.0]]).sample(0) == Sample("speed/human", 0.5, (1.0, 2.0, 3.0), "m/s")


def test_the_span_runs_from_first_to_last_sample() -> None:
    assert signal([0.5, 1.0, 4.0], [0.0, 0.0, 0.0]).span == Span(0.5, 4.0)
    assert signal([], []).span is None


def test_values_between_samples_lie_on_a_straight_line() -> None:
    # A quarter of the way from 2 to 6 is 3; of each column for itself.
    assert signal([0.0, 4.0], [2.0, 6.0]).at(np.array([1.0])).tolist() == [3.0]
    assert signal([0.0, 4.0], [[2.0, 0.0], [6.0, -4.0]]).at(np.array([1.0])).tolist() == [[3.0, -1.0]]


@LAWFUL
@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=30))
def test_at_its_own_times_a_signal_gives_its_recorded_values_to_the_bit(values: list[float]) -> None:
    recorded = signal([0.1 * k for k in range(len(values))], values)

    assert recorded.at(recorded.t).tolist() == values
    assert recorded.at(np.append(recorded.t, 1e6))[:-1].tolist() == values


# Covering ------------------------------------------------------------------------------

SPARSE = signal([1.0, 2.0, 5.0], [0.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("t_s", "covered"),
    [
        (1.0, True),
        (1.5, True),
        (2.0, True),
        (5.0, True),  # a sample covers its own time, whatever lies before it
        (3.5, False),
        (float(np.nextafter(1.0, 0.0)), False),
        (float(np.nextafter(2.0, 3.0)), False),
        (float(np.nextafter(5.0, 6.0)), False),
    ],
)
def test_a_time_is_covered_by_a_sample_or_by_two_near_neighbours(t_s: float, covered: bool) -> None:
    assert SPARSE.covers(np.array([t_s]), max_gap_s=1.0).tolist() == [covered]


def test_a_gap_of_exactly_the_longest_allowed_is_covered_and_a_longer_one_is_not() -> None:
    between = np.array([3.0])

    assert SPARSE.covers(between, max_gap_s=3.0).all()
    assert not SPARSE.covers(between, max_gap_s=3.0 - 1e-6).any()


def test_decimal_stamps_a_tenth_apart_are_a_tenth_apart() -> None:
    # 0.3 - 0.2 is a bit less than 0.1 and 0.8 - 0.7 a bit more: rounding must not make gaps.
    tenths = signal([k / 10 for k in range(20)], [0.0] * 20)

    assert tenths.covers(np.linspace(0.0, 1.9, 39), max_gap_s=0.1).all()
    assert tenths.gaps(Span(0.0, 1.9), max_gap_s=0.1) == []


def test_a_signal_without_samples_covers_nothing() -> None:
    assert not signal([], []).covers(np.array([0.0, 1.0]), max_gap_s=9.0).any()
    assert signal([], []).gaps(Span(0.0, 1.0), max_gap_s=9.0) == [Span(0.0, 1.0)]


def test_the_gaps_of_a_signal_are_the_stretches_it_says_nothing_about() -> None:
    assert SPARSE.gaps(Span(0.0, 8.0), max_gap_s=1.5) == [Span(2.0, 5.0), Span(5.0, 8.0)]


# Aligning ------------------------------------------------------------------------------


def test_signals_sampled_together_keep_their_samples_to_the_bit() -> None:
    a, b = signal([0.0, 0.1, 7.0], [1.0, 2.0, 3.0]), signal([0.0, 0.1, 7.0], [4.0, 5.0, 6.0])

    t, (of_a, of_b) = align([a, b], max_gap_s=0.5)

    assert t.tolist() == [0.0, 0.1, 7.0]
    assert (of_a.tolist(), of_b.tolist()) == ([1.0, 2.0, 3.0], [4.0, 5.0, 6.0])


def test_signals_at_different_times_meet_at_all_their_times() -> None:
    a, b = signal([0.0, 2.0], [0.0, 2.0]), signal([0.0, 1.0, 2.0], [5.0, 6.0, 7.0])

    t, (of_a, of_b) = align([a, b], max_gap_s=2.0)

    assert (t.tolist(), of_a.tolist(), of_b.tolist()) == ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [5.0, 6.0, 7.0])


def test_nothing_is_invented_in_the_gap_of_one_signal() -> None:
    # a is silent from 1 to 4; b is not. Of that stretch nothing may come back.
    a = signal([0.0, 1.0, 4.0, 5.0], [0.0, 1.0, 4.0, 5.0])
    b = signal([0.5 * k for k in range(11)], [0.0] * 11)

    t, _ = align([a, b], max_gap_s=1.0)

    assert t.tolist() == [0.0, 0.5, 1.0, 4.0, 4.5, 5.0]


def test_nothing_is_invented_before_the_first_or_after_the_last_sample() -> None:
    a, b = signal([0.0, 1.0, 2.0, 3.0], [0.0] * 4), signal([1.0, 1.5, 2.0], [0.0] * 3)

    assert align([a, b], max_gap_s=9.0)[0].tolist() == [1.0, 1.5, 2.0]


def test_signals_that_never_overlap_have_no_common_time() -> None:
    t, columns = align([signal([0.0, 1.0], [1.0, 1.0]), signal([2.0, 3.0], [2.0, 2.0])], max_gap_s=9.0)

    assert len(t) == 0
    assert [len(column) for column in columns] == [0, 0]


@LAWFUL
@given(
    st.lists(st.integers(0, 60), min_size=1, max_size=25, unique=True),
    st.lists(st.integers(0, 60), min_size=1, max_size=25, unique=True),
)
def test_aligned_times_are_recorded_times_that_both_signals_cover(a: list[int], b: list[int]) -> None:
    both = [signal([k / 10 for k in sorted(s)], [1.0] * len(s)) for s in (a, b)]

    t, _ = align(both, max_gap_s=0.25)

    recorded = set(both[0].t.tolist()) | set(both[1].t.tolist())
    assert set(t.tolist()) <= recorded
    assert all(s.covers(t, max_gap_s=0.25).all() for s in both)


# Settling ------------------------------------------------------------------------------


def settled(t: list[float], values: list[float]) -> tuple[list[float], list[float]]:
    done = settle(np.array(t), np.array(values))
    return done.t.tolist(), done.values.tolist()


def test_samples_are_sorted_by_time_and_counted() -> None:
    done = settle(np.array([0.0, 2.0, 1.0, 3.0]), np.array([0.0, 20.0, 10.0, 30.0]))

    assert (done.t.tolist(), done.values.tolist()) == ([0.0, 1.0, 2.0, 3.0], [0.0, 10.0, 20.0, 30.0])
    assert (done.disordered, done.repeated, done.not_finite, done.largest_step_back_s) == (1, 0, 0, 1.0)


def test_samples_with_one_stamp_stay_when_they_agree_and_go_when_they_contradict() -> None:
    assert settled([0.0, 1.0, 1.0, 1.0], [0.0, 3.0, 3.0, 3.0]) == ([0.0, 1.0], [0.0, 3.0])
    assert settled([0.0, 1.0, 1.0, 1.0], [0.0, 3.0, 3.0, 2.0]) == ([0.0], [0.0])
    assert settled([1.0, 2.0, 1.0], [1.0, 2.0, 9.0]) == ([2.0], [2.0])
    done = settle(np.array([0.0, 1.0, 1.0, 2.0, 2.0]), np.array([0.0, 1.0, 1.0, 1.0, 2.0]))
    assert (done.repeated, done.contradicting) == (2, 1)


def test_positions_with_one_stamp_contradict_when_any_component_differs() -> None:
    t, p = np.array([0.0, 0.0, 1.0, 1.0]), np.array([[1, 2, 3], [1, 2, 4], [5, 6, 7], [5, 6, 7.0]])

    assert settle(t, p).values.tolist() == [[5, 6, 7]]


def test_samples_that_are_not_finite_leave_a_gap_and_are_counted() -> None:
    done = settle(np.array([0.0, 1.0, 2.0, NAN, 3.0]), np.array([0.0, NAN, 2.0, 3.0, INF]))

    assert (done.t.tolist(), done.values.tolist(), done.not_finite) == ([0.0, 2.0], [0.0, 2.0], 3)


def test_a_broken_sample_does_not_displace_a_sound_one_of_the_same_stamp() -> None:
    assert settled([0.0, 1.0, 1.0], [0.0, 5.0, NAN]) == ([0.0, 1.0], [0.0, 5.0])


def test_one_component_that_is_not_finite_drops_the_whole_sample() -> None:
    done = settle(np.array([0.0, 1.0]), np.array([[1.0, 2.0, 3.0], [1.0, NAN, 3.0]]))

    assert done.values.tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("values", [np.zeros(0), np.zeros((0, 3))])
def test_no_samples_settle_to_no_samples(values: FloatArray) -> None:
    done = settle(np.zeros(0), values)

    assert done.values.shape == values.shape
    assert (len(done.t), done.disordered, done.repeated, done.not_finite) == (0, 0, 0, 0)


@LAWFUL
@given(
    st.lists(
        st.tuples(st.integers(0, 20) | st.just(NAN), st.floats(-9, 9) | st.sampled_from([NAN, INF])),
        max_size=40,
    )
)
def test_settled_samples_make_a_signal_and_every_sample_is_accounted_for(
    samples: list[tuple[float, float]],
) -> None:
    t = np.array([float(t) for t, _ in samples])
    done = settle(t, np.array([v for _, v in samples]))

    kept = signal(done.t.tolist(), done.values.tolist())
    assert len(kept) + done.repeated + done.contradicting + done.not_finite == len(samples)
    by_stamp: dict[float, set[float]] = {}
    for t_s, value in samples:
        if np.isfinite(t_s) and np.isfinite(value):
            by_stamp.setdefault(t_s, set()).add(value)
    agreed = {t_s: values.pop() for t_s, values in by_stamp.items() if len(values) == 1}
    assert dict(zip(kept.t.tolist(), kept.values.tolist(), strict=True)) == agreed


@LAWFUL
@given(st.lists(st.integers(0, 99), unique=True, max_size=30))
def test_settling_settled_samples_changes_nothing(stamps: list[int]) -> None:
    once = settle(np.array(stamps, dtype=float), np.array(stamps, dtype=float))
    twice = settle(once.t, once.values)

    assert twice.t.tolist() == once.t.tolist()
    assert (twice.disordered, twice.repeated, twice.not_finite) == (0, 0, 0)
    assert twice.largest_step_back_s == 0


def test_signals_of_one_time_base_share_it_and_it_stays_shut() -> None:
    first = signal([0.0, 1.0, 2.0], [1.0, 2.0, 3.0])
    second = Signal("speed/human", "m/s", first.t, first.values[:, np.newaxis])

    assert np.shares_memory(first.t, second.t)
    assert np.shares_memory(first.values, second.values)
    for values in (second.t, second.values):
        with pytest.raises(ValueError, match="WRITEABLE"):
            values.flags.writeable = True
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 9.0


@pytest.mark.parametrize("kept", ["array", "view", "turned around"])
def test_what_somebody_could_still_write_to_is_copied(kept: str) -> None:
    own = np.array([[1.0, 2.0], [3.0, 4.0]])
    handed_in = {"array": own, "view": own[:], "turned around": own.T}[kept]
    handed_in.flags.writeable = False

    found = Signal("x", "m", np.array([0.0, 1.0]), handed_in)
    own.flags.writeable = True
    own[:] = 9.0

    assert 9.0 not in found.values
