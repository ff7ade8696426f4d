"""S = K T + D_pf + Z as OSHA and makers' guides in the USA have it, in their inches and ours.

Sources: osha.gov, eTool machine guarding, safety distance chart (63 in/s times a stopping time);
Rockwell Automation, safety products catalogue, example of a 14 mm light curtain; the manuals of Banner
SX5 (D_pf of both approaches, Z_SM) and SICK M4000 (D_pf of beams).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ariac_score import Body, Signal, Span, Trial, Verdict
from ariac_score_standards import SafeguardDistance
from ariac_score_standards.iso_13855 import minimum_distance

INCH_M = 0.0254
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))


@pytest.mark.parametrize(
    ("stopping_time_s", "inches"),
    [(0.055, 3.5), (0.063, 4.0), (0.126, 8.0), (0.158, 10.0), (0.317, 20.0), (0.380, 24.0)],
)
def test_a_two_hand_control_stands_where_the_chart_of_osha_says(
    stopping_time_s: float, inches: float
) -> None:
    found = minimum_distance("us", "two_hand", stopping_time_s)

    assert found.total_m / INCH_M == pytest.approx(inches, abs=0.063)  # the chart has whole milliseconds
    assert found.intrusion_m == 0


def test_a_light_curtain_stands_where_the_makers_example_says() -> None:
    # 14 mm, stopping 170 ms, response 130 ms; printed: D_pf 24.2 mm (1 in), 19.9 in (505 mm).
    found = minimum_distance("us", "orthogonal", 0.17 + 0.13, resolution_m=0.014)

    assert round(found.intrusion_m * 1000, 1) == 24.2
    assert found.total_m == pytest.approx(18.9 * INCH_M + 0.0242, abs=1e-4)
    assert found.total_m == pytest.approx(0.505, abs=0.0015)  # they round D_pf up to a whole inch


@pytest.mark.parametrize(
    ("resolution_mm", "depth_mm"),
    [(5.0, 0.0), (6.875, 0.0), (30.0, 3.4 * 23.125), (63.0, 3.4 * 56.125), (64.0, 900.0), (70.0, 900.0)],
)
def test_what_is_reached_through_a_field_grows_with_its_resolution_up_to_an_arm(
    resolution_mm: float, depth_mm: float
) -> None:
    found = minimum_distance("us", "orthogonal", 0.5, resolution_m=resolution_mm / 1000)

    assert found.intrusion_m * 1000 == pytest.approx(depth_mm, abs=1e-9)


def test_a_scanner_that_looks_along_the_floor_adds_its_own_error() -> None:
    # Banner SX5: D_pf = 1200 mm, Z_SM = 100 mm; K T = 63 in/s * 0.5 s = 31.5 in.
    found = minimum_distance("us", "parallel", 0.5, supplement_m=0.1)

    assert found.total_m == pytest.approx(31.5 * INCH_M + 1.2 + 0.1)


def test_beams_can_be_reached_through_and_where_that_is_told_over() -> None:
    # SICK M4000: D_pf = 0.9 m, and 1.2 m where the field can be reached over.
    assert minimum_distance("us", "whole_body", 0.5).intrusion_m == 0.9
    assert minimum_distance("us", "whole_body", 0.5, reach_m=1.2).intrusion_m == 1.2


def test_no_switch_of_speeds_and_no_least_distance_of_the_iso_gets_in() -> None:
    """63 in/s holds at any distance; ISO 13855 has 2 m/s below 500 mm, and 100 mm at the least."""
    near = minimum_distance("us", "orthogonal", 0.03, resolution_m=0.006)
    far = minimum_distance("us", "orthogonal", 0.3, resolution_m=0.006)

    assert near.total_m == pytest.approx(63 * 0.03 * INCH_M)
    assert far.total_m == pytest.approx(63 * 0.3 * INCH_M)


def test_a_line_at_the_distance_is_far_enough_and_one_nearer_is_not() -> None:
    needed_m = SafeguardDistance(edition="us", resolution_m=0.014, stopping_time_s=0.3).minimum().total_m
    far_m, near_m = needed_m + 1e-9, needed_m - 1e-9
    at = SafeguardDistance(
        edition="us",
        resolution_m=0.014,
        stopping_time_s=0.3,
        line=((-far_m, 0.0), (-far_m, 1.0)),
        hazard=SQUARE,
    )
    nearer = replace(at, line=((-near_m, 0.0), (-near_m, 1.0)))
    t = np.arange(3) * 0.01
    still = {
        "position/h": Signal("position/h", "m", t, np.full((3, 3), -9.0)),
        "speed/r": Signal("speed/r", "m/s", t, np.zeros(3)),
    }
    trial = Trial(
        "t", bodies=(Body("r", "robot"), Body("h", "human")), signals=still, recorded=Span(0.0, 0.02)
    )
    verdicts = [next(iter(monitor.watch(trial))).verdict for monitor in (at, nearer)]

    assert verdicts == [Verdict.SATISFIED, Verdict.VIOLATED]
    assert "OSHA" in next(iter(at.watch(trial))).clause
