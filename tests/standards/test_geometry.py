"""Zones on the floor: what is refused as no polygon, wherever its corners begin."""

from __future__ import annotations

import pytest

from ariac_score_standards.geometry import check_polygon

FOLDED = ((2.0, 0.0), (2.0, 4.0), (0.0, 0.0), (4.0, 0.0))
"""Its last edge runs back along the one before."""
TOUCHING = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 0.0), (0.0, 4.0))
"""Its fourth corner lies on its first edge."""


@pytest.mark.parametrize("corners", [FOLDED, TOUCHING], ids=["folded back", "touching itself"])
@pytest.mark.parametrize("first", range(4))
def test_a_line_that_touches_itself_is_no_polygon(
    corners: tuple[tuple[float, float], ...], first: int
) -> None:
    turned = corners[first:] + corners[:first]

    for named in (turned, turned[::-1]):
        with pytest.raises(ValueError, match=r"workspace is not a polygon: edges \d and \d cross"):
            check_polygon("workspace", named)


def test_a_notch_that_nearly_touches_is_a_polygon() -> None:
    check_polygon("workspace", ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 1e-9), (0.0, 4.0)))
