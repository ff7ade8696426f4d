"""Speeds that the positions of the same body contradict: a body gets no further than its speed takes it."""

from __future__ import annotations

import numpy as np
import pytest

from ariac_score.trial.denied import denied
from ariac_score.trial.signals import Signal

T = np.arange(0.0, 10.0, 0.1)


def position(along_m: np.ndarray, t: np.ndarray = T) -> Signal:
    return Signal("position/robot", "m", t, np.column_stack([along_m, 0 * along_m, 0 * along_m]))


def speed(m_s: np.ndarray, t: np.ndarray = T) -> Signal:
    return Signal("speed/robot", "m/s", t, m_s)


def said_to_rest(from_s: float, until_s: float, m_s: float = 0.5) -> Signal:
    return speed(np.where((from_s <= T) & (until_s >= T), 0.0, m_s))


def test_who_moves_and_says_that_it_rests_is_not_believed_for_so_long() -> None:
    found = denied(said_to_rest(4.0, 6.0), position(0.5 * T))

    assert found[(T > 4.0) & (T < 6.0)].all()
    assert not found[(T < 3.0) | (T > 7.0)].any()  # a window of 1 s reaches so far at most


@pytest.mark.parametrize(
    ("stated", "real", "is_denied"),
    [
        # In 1 s it gets 0.4 m far. Two thirds of what is more than 0.1 m of noise are 0.2 m.
        (0.21, 0.4, False),
        (0.19, 0.4, True),
        (0.0, 0.09, False),  # a creep of less than the noise shows nothing
        (0.0, 0.12, True),
        (2.0, 0.4, False),  # faster than it gets: it goes to and fro
    ],
)
def test_from_which_speed_on_it_shows(stated: float, real: float, is_denied: bool) -> None:
    assert denied(speed(np.full(len(T), stated)), position(real * T)).any() == is_denied


def test_going_to_and_fro_is_no_contradiction() -> None:
    """Positions at both ends of a window are alike, however fast it was between them."""
    assert not denied(speed(np.abs(np.cos(6 * T))), position(np.sin(6 * T) / 6)).any()


def test_what_happened_in_a_gap_contradicts_nothing() -> None:
    """It stands, goes 3 m within a gap of both signals, and stands again."""
    seen = (T < 4.0) | (T > 6.0)
    t = T[seen]

    assert not denied(speed(np.zeros(len(t)), t), position(np.where(t > 5.0, 3.0, 0.0), t)).any()


def test_without_positions_or_of_other_quantities_nothing_is_denied() -> None:
    force = Signal("force/robot", "N", T, np.zeros(len(T)))

    assert not denied(said_to_rest(4.0, 6.0), None).any()
    assert not denied(force, position(0.5 * T)).any()
    assert not denied(speed(np.zeros(1), T[:1]), position(0.5 * T)).any()
