"""How late messages that nobody stamped may have come: leaving some out makes none look less late."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.logs.gather.arrival import LONGEST_DELAY_S, arrival_jitter_s, late_in_the_competition
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Disbelieved, Signal
from ariac_score.trial.spans import Span

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


def lateness_s(
    t: np.ndarray,
    *,
    stamped: bool = False,
    holes: tuple[Span, ...] = (),
    disbelieved: tuple[Disbelieved, ...] = (),
) -> float:
    """Of a competition from 0.5 s to 1.5 s, recorded from 0 s to 2 s."""
    signal = Signal(
        "distance/arm/ann",
        "m",
        t,
        np.ones(len(t)),
        holes=holes,
        stamp_jitter_s=0.0 if stamped else 1e-3,
        disbelieved=disbelieved,
    )
    trial = Trial(
        "t",
        signals={signal.name: signal},
        events=(Event(0.5, COMPETITION_STARTED), Event(1.5, COMPETITION_ENDED)),
        recorded=Span(0.0, 2.0),
    )
    return late_in_the_competition(trial).signals[signal.name].stamp_jitter_s


@given(stalls=STALLS, cut=st.tuples(st.integers(0, 99), st.integers(101, 200)))
def test_a_recording_that_is_cut_at_its_ends_makes_no_message_of_the_competition_look_less_late(
    stalls: list[tuple[int, int]], cut: tuple[int, int]
) -> None:
    t = stalled(stalls)

    assert lateness_s(t[slice(*cut)]) >= lateness_s(t) - 1e-9


@pytest.mark.parametrize(
    ("stall", "late_s"),
    [
        ((20, 12), 0.01),  # before the competition
        ((170, 12), 0.01),  # behind it
        ((100, 12), 0.13),  # in it
    ],
)
def test_only_what_came_late_in_the_competition_counts(stall: tuple[int, int], late_s: float) -> None:
    assert lateness_s(stalled([stall])) == pytest.approx(late_s, abs=1e-3)


def test_silence_at_either_end_of_the_competition_is_an_interval() -> None:
    t = PERIOD_S * np.arange(200)

    assert lateness_s(t[t > 0.6]) == pytest.approx(0.11, abs=1e-3)
    assert lateness_s(t[t < 1.4]) == pytest.approx(0.11, abs=1e-3)
    assert lateness_s(t[t < 0.4]) == LONGEST_DELAY_S
    assert lateness_s(t[t > 0.6], stamped=True) == 0.0


@pytest.mark.parametrize(("until_s", "late_s"), [(1.0, 0.2), (1.2, 0.01)])
def test_lost_messages_are_silence_unless_longer_than_any_delay(until_s: float, late_s: float) -> None:
    t = PERIOD_S * np.arange(200)
    lost = Span(0.8, until_s)
    kept = t[(t < lost.start_s + 1e-9) | (t > lost.end_s - 1e-9)]

    assert lateness_s(kept, holes=(lost,)) == pytest.approx(late_s, abs=1e-3)


def test_what_came_and_is_not_believed_is_no_silence() -> None:
    t = PERIOD_S * np.arange(200)
    jump = Span(0.8, 1.0)
    kept = t[(t < jump.start_s + 1e-9) | (t > jump.end_s - 1e-9)]

    assert lateness_s(kept) == pytest.approx(0.2, abs=1e-3)
    assert lateness_s(kept, disbelieved=(Disbelieved(jump, 0.81, 300.0),)) == pytest.approx(0.01, abs=1e-3)


def test_too_few_messages_show_nothing() -> None:
    assert arrival_jitter_s(np.zeros(0)) == arrival_jitter_s(np.array([3.0])) == 0.0
