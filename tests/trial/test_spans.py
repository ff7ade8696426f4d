"""Stretches of time; expected ones by hand from the monitor catalogue, sections 1.1 and 1.2."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.trial.spans import (
    BoolArray,
    Span,
    episodes_where,
    longest_silence_s,
    sample_durations,
    uncovered_spans,
)

LAWFUL = settings(max_examples=80, derandomize=True, deadline=None)
CONDITIONS = st.lists(st.booleans(), min_size=1, max_size=60)


def conditions(text: str) -> tuple[np.ndarray, BoolArray]:
    """One sample per second: `#` where the condition holds."""
    return np.arange(len(text), dtype=float), np.array([c == "#" for c in text])


def length(spans: list[Span]) -> float:
    return sum(span.duration_s for span in spans)


# Spans ---------------------------------------------------------------------------------


def test_a_span_cannot_end_before_it_starts() -> None:
    assert Span(1.0, 1.0).duration_s == 0.0
    with pytest.raises(ValueError, match="cannot end"):
        Span(1.0, float(np.nextafter(1.0, 0.0)))


@pytest.mark.parametrize(("start", "end"), [(float("nan"), 1.0), (0.0, float("nan"))])
def test_a_span_has_a_start_and_an_end(start: float, end: float) -> None:
    with pytest.raises(ValueError, match="has no end"):
        Span(start, end)


def test_spans_that_share_an_instant_overlap() -> None:
    assert Span(0.0, 1.0).overlaps(Span(1.0, 2.0))
    assert Span(1.0, 2.0).overlaps(Span(0.0, 1.0))
    assert Span(0.0, 9.0).overlaps(Span(1.0, 2.0))
    assert not Span(0.0, 1.0).overlaps(Span(float(np.nextafter(1.0, 2.0)), 2.0))


# Durations -----------------------------------------------------------------------------


def test_each_sample_stands_until_the_next_and_the_last_for_no_time() -> None:
    assert sample_durations(np.array([0.0, 0.5, 3.5])).tolist() == [0.5, 3.0, 0.0]


def test_no_sample_stands_for_longer_than_allowed() -> None:
    assert sample_durations(np.array([0.0, 0.5, 3.5]), longest_s=1.0).tolist() == [0.5, 1.0, 0.0]


@pytest.mark.parametrize("n", [0, 1])
def test_a_sample_without_a_successor_stands_for_no_time(n: int) -> None:
    assert sample_durations(np.zeros(n)).tolist() == [0.0] * n


# Episodes ------------------------------------------------------------------------------


def test_an_episode_lasts_until_the_end_of_its_last_true_sample() -> None:
    # Samples at 1 and 2 stand for [1, 2) and [2, 3): two seconds, not one (their distance).
    assert episodes_where(*conditions(".##..")) == [Span(1.0, 3.0)]


def test_a_single_true_sample_stands_for_its_interval() -> None:
    assert episodes_where(*conditions(".#.")) == [Span(1.0, 2.0)]


def test_an_episode_of_the_last_sample_alone_has_no_length() -> None:
    assert episodes_where(*conditions("..#")) == [Span(2.0, 2.0)]


@pytest.mark.parametrize("text", ["", ".", "...."])
def test_a_condition_that_never_holds_forms_no_episode(text: str) -> None:
    assert episodes_where(*conditions(text)) == []


def test_a_condition_that_always_holds_is_one_episode() -> None:
    assert episodes_where(*conditions("#####")) == [Span(0.0, 4.0)]


def test_a_pause_shorter_than_t_off_is_bridged_and_one_as_long_closes() -> None:
    t, holds = conditions("##..##.")  # false on [2, 4): 2 s

    assert episodes_where(t, holds, t_off_s=2.0) == [Span(0.0, 2.0), Span(4.0, 6.0)]
    assert episodes_where(t, holds, t_off_s=2.0 + 1e-6) == [Span(0.0, 6.0)]


def test_a_pause_of_exactly_t_off_closes_despite_rounding() -> None:
    # 0.3 s between 0.4 and 0.7 is 0.29999999999999993 in float64; by the clock it is 0.3 s.
    t = np.array([k / 10 for k in range(10)])
    holds = np.array([k not in (4, 5, 6) for k in range(10)])

    assert len(episodes_where(t, holds, t_off_s=0.3)) == 2


def test_a_condition_must_hold_for_t_on_to_open_an_episode() -> None:
    t, holds = conditions(".##....")  # holds for 2 s

    assert episodes_where(t, holds, t_on_s=2.0) == [Span(1.0, 3.0)]
    assert episodes_where(t, holds, t_on_s=2.0 + 1e-6) == []


def test_a_flicker_after_an_open_episode_belongs_to_it() -> None:
    t, holds = conditions("###.#.....")

    assert episodes_where(t, holds, t_on_s=2.0, t_off_s=2.0) == [Span(0.0, 5.0)]


def test_a_flicker_before_an_episode_does_not_open_it() -> None:
    t, holds = conditions("#.###..")

    assert episodes_where(t, holds, t_on_s=2.0, t_off_s=2.0) == [Span(2.0, 5.0)]


def test_a_true_sample_before_a_gap_does_not_stand_for_the_gap() -> None:
    t = np.array([0.0, 1.0, 60.0, 61.0])
    holds = np.array([False, True, False, False])

    assert episodes_where(t, holds, longest_s=1.5) == [Span(1.0, 2.5)]


def approach(rate_hz: int) -> tuple[np.ndarray, np.ndarray]:
    """W1.7: from 3.0 m to 1.0 m in 4 s and back in 4 s."""
    t = np.arange(8 * rate_hz + 1) / rate_hz
    return t, 1.0 + np.abs(t - 4.0) / 2


def test_worked_example_w1_7_is_one_episode_with_the_integrals_of_the_catalogue() -> None:
    t, d = approach(100)
    holds = d < 2.0

    (episode,) = episodes_where(t, holds, t_on_s=0.03, t_off_s=1.0)
    seconds = float(sample_durations(t)[holds].sum())
    depth_m_s = float((sample_durations(t) * np.maximum(2.0 - d, 0.0)).sum())

    # The catalogue allows two samples, for the condition is strict at both ends.
    assert episode.start_s == pytest.approx(2.0, abs=0.02)
    assert episode.end_s == pytest.approx(6.0, abs=0.02)
    assert seconds == pytest.approx(4.0, abs=0.02)
    assert depth_m_s == pytest.approx(2.0, abs=0.02)
    assert depth_m_s / 2.0 == pytest.approx(1.0, abs=0.02)


def test_the_episode_of_w1_7_does_not_depend_on_the_log_rate() -> None:
    lengths = [
        length(episodes_where(t, d < 2.0, t_on_s=0.03, t_off_s=1.0))
        for t, d in (approach(rate) for rate in (10, 50, 100, 200))
    ]

    assert lengths == pytest.approx([4.0] * 4, abs=0.1 + 1e-9)  # one sample at the lowest rate


@LAWFUL
@given(st.integers(0, 300), st.integers(1, 300), st.sampled_from([0.01, 0.02, 0.05]))
def test_halving_the_log_rate_moves_each_end_by_at_most_one_old_sample(
    start: int, lasts: int, dt: float
) -> None:
    # Mistake 8: samples are not seconds. A violation [start, start + lasts) in a log of 801 samples.
    k = np.arange(801)
    t, holds = k * dt, (k >= start) & (k < start + lasts)

    full = length(episodes_where(t, holds))
    half = length(episodes_where(t[::2], holds[::2]))

    assert abs(full - half) <= dt + 1e-9


@LAWFUL
@given(CONDITIONS)
def test_without_bridging_episodes_last_as_long_as_the_condition_holds(holds: list[bool]) -> None:
    t = np.cumsum(np.arange(1, len(holds) + 1)) / 8  # uneven steps, exact in float64
    held = np.array(holds)

    found = episodes_where(t, held)

    assert length(found) == sample_durations(t)[held].sum()
    assert len(found) == int(held[0]) + int((held[1:] & ~held[:-1]).sum())


@LAWFUL
@given(CONDITIONS, st.integers(0, 8), st.integers(0, 8))
def test_episodes_are_apart_by_t_off_and_last_at_least_t_on(holds: list[bool], t_on: int, t_off: int) -> None:
    t = np.arange(len(holds), dtype=float)

    found = episodes_where(t, np.array(holds), t_on_s=float(t_on), t_off_s=float(t_off))

    assert all(span.duration_s >= t_on for span in found)
    assert all(b.start_s - a.end_s >= max(t_off, 1) for a, b in pairwise(found))


@LAWFUL
@given(CONDITIONS, st.integers(0, 8))
def test_a_longer_t_off_never_makes_more_episodes(holds: list[bool], t_off: int) -> None:
    t, held = np.arange(len(holds), dtype=float), np.array(holds)

    patient = episodes_where(t, held, t_off_s=t_off + 1.0)
    strict = episodes_where(t, held, t_off_s=float(t_off))

    assert len(patient) <= len(strict)
    assert length(patient) >= length(strict)


@LAWFUL
@given(CONDITIONS, st.integers(-1000, 1000))
def test_shifting_all_stamps_shifts_the_episodes_and_nothing_else(holds: list[bool], shift: int) -> None:
    t, held = np.arange(len(holds)) / 4, np.array(holds)

    moved = episodes_where(t + shift, held, t_off_s=0.5)

    assert moved == [Span(s.start_s + shift, s.end_s + shift) for s in episodes_where(t, held, t_off_s=0.5)]


# Gaps ----------------------------------------------------------------------------------

T = np.array([1.0, 2.0, 5.0])


@pytest.mark.parametrize(
    ("window", "max_gap_s", "gaps"),
    [
        (Span(1.0, 5.0), 3.0, []),
        (Span(1.0, 5.0), 3.0 - 1e-6, [Span(2.0, 5.0)]),
        (Span(0.0, 5.0), 1.0, [Span(2.0, 5.0)]),  # the edge is one second before the first sample
        (Span(-0.5, 5.0), 1.0, [Span(-0.5, 1.0), Span(2.0, 5.0)]),
        (Span(1.0, 8.0), 3.0, []),
        (Span(1.0, 8.5), 3.0, [Span(5.0, 8.5)]),
        (Span(3.0, 4.0), 1.0, [Span(3.0, 4.0)]),  # between two samples too far apart
        (Span(3.0, 4.0), 3.0, []),  # between two samples that cover it
        (Span(6.0, 7.0), 9.0, [Span(6.0, 7.0)]),  # after the last sample
        (Span(0.0, 0.5), 9.0, [Span(0.0, 0.5)]),  # before the first
        (Span(2.0, 2.0), 0.0, []),
    ],
)
def test_a_window_is_uncovered_where_neighbouring_samples_are_too_far_apart(
    window: Span, max_gap_s: float, gaps: list[Span]
) -> None:
    assert uncovered_spans(T, window, max_gap_s=max_gap_s) == gaps


def test_without_samples_the_whole_window_is_uncovered_however_short() -> None:
    assert uncovered_spans(np.zeros(0), Span(0.0, 1e-9), max_gap_s=9.0) == [Span(0.0, 1e-9)]


@LAWFUL
@given(st.lists(st.integers(0, 40), unique=True, max_size=20), st.integers(1, 6))
def test_the_uncovered_stretches_lie_in_the_window_and_hold_no_sample(
    stamps: list[int], max_gap: int
) -> None:
    t = np.array(sorted(stamps), dtype=float)
    window = Span(5.0, 30.0)

    for gap in uncovered_spans(t, window, max_gap_s=float(max_gap)):
        assert window.start_s <= gap.start_s < gap.end_s <= window.end_s
        assert gap.duration_s > max_gap
        assert not ((t > gap.start_s) & (t < gap.end_s)).any()


@LAWFUL
@given(st.lists(st.integers(0, 40), unique=True, max_size=20), st.integers(0, 30), st.integers(0, 30))
def test_the_longest_silence_is_the_longest_stretch_without_a_sample(
    stamps: list[int], start: int, length: int
) -> None:
    window = Span(float(start), float(start + length))
    marks = [start, *sorted(s for s in stamps if start <= s <= start + length), start + length]

    longest_s = longest_silence_s(np.array(sorted(stamps), dtype=float), window)

    assert longest_s == max(b - a for a, b in pairwise(marks))


@pytest.mark.parametrize("samples", [4095, 4096, 4097, 9000])
def test_the_longest_silence_is_found_wherever_it_is(samples: int) -> None:
    for at in (1, samples // 2, samples - 1, 4095, 4096):
        t = np.arange(float(samples)) + np.where(np.arange(samples) >= min(at, samples - 1), 0.5, 0.0)
        window = Span(0.0, float(t[-1]))

        assert longest_silence_s(t, window) == 1.5
        assert [gap.duration_s for gap in uncovered_spans(t, window, max_gap_s=1.2)] == [1.5]
