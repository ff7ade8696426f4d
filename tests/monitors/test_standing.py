"""What a missing sample would have said counts for as long as a sample stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.monitors.cells import INSTANT_S, Cells, standing

KNOWN_M = 9.0


def cells(lengths_s: list[float]) -> Cells:
    edges = np.concatenate(([0.0], np.cumsum(lengths_s)))
    return Cells(edges[:-1], edges[1:])


@pytest.mark.parametrize(
    ("stands_s", "least"),
    [
        (0.0, [KNOWN_M, 3.0, 1.0, 2.0, 4.0, 5.0, KNOWN_M]),
        (0.5, [KNOWN_M, 3.0, 1.0, 1.0, 2.0, 4.0, KNOWN_M]),
        (1.5, [KNOWN_M, 3.0, 1.0, 1.0, 1.0, 2.0, KNOWN_M]),
        (60.0, [KNOWN_M, 3.0, 1.0, 1.0, 1.0, 1.0, KNOWN_M]),
    ],
)
def test_the_nearest_of_the_time_that_a_sample_stands_counts_until_the_next_sample(
    stands_s: float, least: list[float]
) -> None:
    """In cells of 1 s: one that begins 0.5 s after the end of another is within 0.5 s, not within less."""
    near = np.array([KNOWN_M, 3.0, 1.0, 2.0, 4.0, 5.0, KNOWN_M])
    is_open = near < KNOWN_M

    low, high = standing(near, -near, cells([1.0] * 7), is_open, stands_s)

    assert low.tolist() == least
    assert high.tolist() == [-one for one in least]


def test_the_sample_before_a_gap_stands_in_it_and_the_interval_before_that_does_not() -> None:
    near = np.array([0.5, 2.0, 3.0, 4.0])  # an interval that is held, the instant of a sample, a gap
    is_open = np.array([False, False, True, True])

    low, _ = standing(near, near, cells([1.0, INSTANT_S, 1.0, 1.0]), is_open, 60.0)

    assert low.tolist() == [0.5, 2.0, 2.0, 2.0]


def test_a_sample_that_is_there_ends_what_one_before_it_would_have_said() -> None:
    near = np.array([1.0, 4.0, 3.0])
    is_open = np.array([True, False, True])

    low, _ = standing(near, near, cells([1.0, INSTANT_S, 1.0]), is_open, 60.0)

    assert low.tolist() == [1.0, 4.0, 3.0]


CELLS = st.lists(
    st.tuples(st.integers(0, 8).map(float), st.booleans(), st.sampled_from([INSTANT_S, 0.25, 1.0])),
    min_size=1,
    max_size=30,
)


@given(CELLS, st.sampled_from([0.25, 0.6, 2.0]), st.sampled_from([0.0, 0.3]))
@settings(max_examples=200, derandomize=True, deadline=None)
def test_bounds_only_widen_and_the_more_the_longer_samples_stand(
    made: list[tuple[float, bool, float]], stands_s: float, longer_s: float
) -> None:
    least = np.array([one for one, _, _ in made])
    is_open = np.array([one for _, one, _ in made])
    all_of = cells([one for _, _, one in made])

    low, high = standing(least, least + 1.0, all_of, is_open, stands_s)
    lower, higher = standing(least, least + 1.0, all_of, is_open, stands_s + longer_s)

    assert (lower <= low).all()
    assert (low <= least).all()
    assert (higher >= high).all()
    assert (high >= least + 1.0).all()
    assert (low[~is_open] == least[~is_open]).all()
