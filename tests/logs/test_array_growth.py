"""How long growing arrays get: enough, not much too long, and little is moved."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.logs.gather.array_growth import GrowthForecast


@given(st.lists(st.tuples(st.integers(0, 10_000), st.floats(0, 1)), max_size=60), st.integers(1, 100_000))
def test_there_is_always_room_and_nothing_shrinks(steps: list[tuple[int, float]], most: int) -> None:
    foreseen, have, needed = GrowthForecast(most), 0, 0
    for count, share in steps:
        needed += count
        length = foreseen.length(needed, have, share)
        assert length >= max(needed, have)
        have = length


def test_a_tenth_that_came_foresees_the_rest() -> None:
    assert 10_000 <= GrowthForecast(1 << 26).length(1_000, 0, 0.1) <= 11_001


def test_what_never_came_is_bounded() -> None:
    assert GrowthForecast(1 << 26).length(1_000, 0, 1e-12) <= 71_000
    assert GrowthForecast(5_000).length(1_000, 0, 1e-12) == 5_500


def test_nothing_is_moved_for_a_guess_that_is_a_little_larger() -> None:
    foreseen = GrowthForecast(1 << 26)
    have = foreseen.length(1_000, 0, 0.1)
    assert foreseen.length(8_500, have, 0.8) == have
    assert foreseen.length(have + 1, have, 1.0) > have


def test_a_first_guess_from_little_is_mended_before_much_would_be_moved() -> None:
    foreseen = GrowthForecast(1 << 26)
    have = foreseen.length(10, 0, 1e-9)
    assert have <= 710
    assert foreseen.length(79, have, 1e-3) == have
    assert foreseen.length(81, have, 1e-3) >= 5_000


def test_without_a_share_lengths_double() -> None:
    foreseen = GrowthForecast(1 << 26)
    assert foreseen.length(100, 0, 0.0) == 100
    assert foreseen.length(100, 100, 0.0) == 100
    assert foreseen.length(101, 100, 0.0) == 200


@pytest.mark.parametrize("share", [0.01, 0.3, 1.0])
def test_what_is_long_enough_by_the_guess_is_left_alone(share: float) -> None:
    assert GrowthForecast(1 << 26).length(10, 1_000_000, share) == 1_000_000
