"""How deep a violation is relative to its limit: a share of the limit, and never more than all of it.

Source: monitor catalogue, section 1.3: of an upper limit `actual / limit - 1`, clipped to [0, 1].
"""

from __future__ import annotations

import numpy as np
import pytest

from ariac_score import Body, Finding, Monitor, Signal, Span, Trial
from ariac_score_standards import PflContact, ReducedSpeed

SECONDS = 2.0
LIMIT_M_S = 0.25
LIMIT_N = 140.0
"""Of a hand that is clamped (quasi-static)."""


def steady(name: str, unit: str, value: float) -> Trial:
    t = np.arange(0.0, SECONDS + 0.005, 0.01)
    return Trial(
        "t",
        bodies=(Body("h", "human"), Body("r", "robot")),
        signals={name: Signal(name, unit, t, np.full_like(t, value))},
        recorded=Span(0.0, float(t[-1])),
    )


def the_violation(monitor: Monitor, trial: Trial) -> Finding:
    (finding,) = monitor.watch(trial)
    return finding


def test_a_speed_beyond_twice_the_limit_is_no_deeper_than_twice_the_limit(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, float]] = [
        (0.30, 0.2),
        (0.375, 0.5),
        (0.50, 1.0),
        (0.51, 1.0),
        (0.75, 1.0),
        (25.0, 1.0),
    ]
    for speed_m_s, depth in cases:
        with subtests.test(speed_m_s=speed_m_s, depth=depth):
            monitor = ReducedSpeed(max_speed_m_s=LIMIT_M_S)

            found = the_violation(monitor, steady("speed/r", "m/s", speed_m_s)).quantities

            assert found["relative_depth_max"] == pytest.approx(depth)
            assert found["relative_depth_integral_s"] == pytest.approx(depth * found["time_in_violation_s"])
            assert found["excess_max_m_s"] == pytest.approx(speed_m_s - LIMIT_M_S)  # which nothing clips


def test_a_force_beyond_twice_the_limit_is_no_deeper_than_twice_the_limit(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, float]] = [(140.0, 0.0), (210.0, 0.5), (280.0, 1.0), (281.0, 1.0), (420.0, 1.0)]
    for force_n, depth in cases:
        with subtests.test(force_n=force_n, depth=depth):
            # 2 s of contact: longer than a transient one, so that the quasi-static limit holds at the end.
            # The first half second bears twice as much, so the deepest moment lies after it.
            monitor = PflContact(region="hand")

            found = the_violation(monitor, steady("contact_force/r/h", "N", force_n)).quantities

            assert found["relative_depth_max"] == pytest.approx(depth)
            assert found["ratio_max"] == pytest.approx(force_n / LIMIT_N)
