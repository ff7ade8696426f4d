"""How late messages that nobody stamped may have come: leaving some out makes none look less late."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.logs.gather.arrival import LONGEST_DELAY_S, arrival_jitter_s

PERIOD_S = 0.01


def stalled(stalls: list[tuple[int, int]]) -> np.ndarray:
    """Arrivals of 200 messages at 100 Hz in their order, of which some stretches came only at its end."""
    sent = PERIOD_S * np.arange(200)
    arrived = sent.copy()
    for first, length in stalls:
        ready = sent[min(first + length, 199)]
        arrived[first : first + length] = np.maximum(arrived[first : first + length], ready)
    # No two messages are received at the same time.
    return np.maximum.accumulate(arrived) + 1e-6 * np.arange(200)


STALLS = st.lists(st.tuples(st.integers(1, 190), st.integers(1, 12)), max_size=4)


@given(stalls=STALLS, left_out=st.sets(st.integers(0, 199), max_size=150))
def test_whatever_is_left_out_no_message_looks_less_late(
    stalls: list[tuple[int, int]], left_out: set[int]
) -> None:
    t = stalled(stalls)
    kept = np.delete(t, sorted({index for index in left_out if 0 < index < 199}))

    assert arrival_jitter_s(kept) >= arrival_jitter_s(t) - 1e-9


@given(stalls=STALLS)
def test_no_message_is_later_than_it_may_have_been(stalls: list[tuple[int, int]]) -> None:
    t = stalled(stalls)

    assert (t - PERIOD_S * np.arange(200)).max() <= arrival_jitter_s(t) + 1e-3


@pytest.mark.parametrize(
    ("pause_s", "late_s"), [(0.0, 0.01), (0.1, 0.11), (LONGEST_DELAY_S, 0.25), (30.0, LONGEST_DELAY_S)]
)
def test_after_a_pause_a_message_may_be_as_late_as_it_lasted_up_to_a_quarter_second(
    pause_s: float, late_s: float
) -> None:
    t = PERIOD_S * np.arange(100)
    t[50:] += pause_s

    assert arrival_jitter_s(t) == pytest.approx(late_s)


def test_too_few_messages_show_nothing() -> None:
    assert arrival_jitter_s(np.zeros(0)) == arrival_jitter_s(np.array([3.0])) == 0.0
