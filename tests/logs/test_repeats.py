"""Topics that repeat a state at each step: which of their messages are decoded."""

from __future__ import annotations

import numpy as np
import pytest

from ariac_score.logs.columnar import Payloads
from ariac_score.logs.columnar.message_buffer import Waiting
from ariac_score.logs.gather.repeats import changed


def kept(words: list[bytes], *, every_ns: int = 1_000_000, first_ns: int = 0) -> list[int]:
    numbers = np.arange(len(words))
    return changed(Waiting(numbers, first_ns + numbers * every_ns, Payloads.joined(words))).tolist()


def test_of_a_run_of_equal_messages_the_first_and_the_last_are_kept() -> None:
    assert kept([b"a"] * 4 + [b"b"] * 3 + [b"a"] * 3) == [0, 3, 4, 6, 7, 9]


def test_one_in_each_half_second_shows_that_the_topic_went_on() -> None:
    assert kept([b"a"] * 1201) == [0, 500, 1000, 1200]


@pytest.mark.parametrize("words", [[], [b"a"], [b"a", b"a"], [b"a", b"ab", b"b", b""], [b"x" * 65] * 5])
def test_nothing_is_left_out_that_says_something_of_its_own_or_is_long(words: list[bytes]) -> None:
    assert kept(words) == list(range(len(words)))


def test_a_longer_message_that_begins_with_the_one_before_is_another() -> None:
    assert kept([b"a", b"a", b"a", b"a\0", b"a\0", b"a\0"]) == [0, 2, 3, 5]
