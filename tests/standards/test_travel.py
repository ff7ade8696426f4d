"""Ways that bodies cover, against areas under a speed that are computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from ariac_score import Span
from ariac_score_standards.travel import travelled_m


@pytest.mark.parametrize(
    ("start_s", "end_s", "way_m"),
    [
        (1.0, 3.0, 1.0 + 0.5),  # 1 m/s for a second, then a triangle
        (1.5, 2.5, 0.5 + 0.375),  # the ends lie between samples
        (0.0, 9.0, 1.0 + 0.5),  # beyond the samples there is no speed
        (4.0, 5.0, 0.0),
        (2.0, 2.0, 0.0),
    ],
)
def test_a_way_is_the_area_under_the_speed(start_s: float, end_s: float, way_m: float) -> None:
    t, speed = np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 0.0])

    assert travelled_m(t, speed, Span(start_s, end_s)) == pytest.approx(way_m)


def test_without_samples_there_is_no_way() -> None:
    assert travelled_m(np.empty(0), np.empty(0), Span(0.0, 1.0)) == 0.0
