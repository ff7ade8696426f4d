"""Who contests whom over a transform that is told once and for all."""

from __future__ import annotations

import math

import pytest

from ariac_score.logs.containers.items import Connection
from ariac_score.logs.gather.frame_publishers import FramePublishers

HALF_M = (0.5, 0.0, 0.0)
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def by(publisher: str) -> Connection:
    return Connection("/tf_static", "tf2_msgs/msg/TFMessage", "ros1", publisher=publisher)


def contested(one: tuple[float, ...], other: tuple[float, ...], later_ns: int = 10) -> bool:
    """Whether two publishers that tell these of one frame contest each other."""
    told = FramePublishers()
    told.take_one_static(by("/one"), "world", "human", one, 0)
    told.take_one_static(by("/two"), "/world", "human", other, later_ns)
    return bool([*told.contested_static()])


@pytest.mark.parametrize(
    ("other", "differs"),
    [
        ((*HALF_M, *UPRIGHT), False),
        ((*HALF_M, 0.0, 0.0, 0.0, -1.0), False),  # the same rotation
        ((*HALF_M, 0.0, 0.0, 0.0, 0.995), False),  # within what tf2 takes for a norm of 1
        ((0.5 + 5e-7, 0.0, 0.0, *UPRIGHT), False),  # as 32 bits round it
        ((0.5 + 2e-6, 0.0, 0.0, *UPRIGHT), True),
        ((*HALF_M, math.sin(5e-7), 0.0, 0.0, math.cos(5e-7)), False),  # turned by a millionth of a rad
        ((*HALF_M, math.sin(5e-6), 0.0, 0.0, math.cos(5e-6)), True),
        ((*HALF_M, 1.0, 0.0, 0.0, 0.0), True),
    ],
)
def test_two_publishers_contest_a_transform_that_they_tell_differently(
    other: tuple[float, ...], differs: bool
) -> None:
    assert contested((*HALF_M, *UPRIGHT), other) is differs


@pytest.mark.parametrize(
    "turn", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.98), (0.0, 0.0, 1e-170, 0.0), (0.0, 0.0, math.nan, 1.0)]
)
def test_what_tf2_refuses_as_no_rotation_places_nothing_and_contests_nothing(turn: tuple[float, ...]) -> None:
    assert not contested((*HALF_M, *UPRIGHT), (4.0, 0.0, 0.0, *turn))
    assert contested((*HALF_M, *UPRIGHT), (4.0, 0.0, 0.0, *UPRIGHT))


@pytest.mark.parametrize(("later_ns", "differs"), [(10**9, True), (10**9 + 1, False)])
def test_who_tells_it_a_second_later_has_the_last_word(later_ns: int, differs: bool) -> None:
    assert contested((*HALF_M, *UPRIGHT), (4.0, 0.0, 0.0, *UPRIGHT), later_ns) is differs
