"""Canonical JSON against the `json` of the standard library, which does the same more slowly."""

from __future__ import annotations

import enum
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.results.plain_json import canonical_text

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: (
        st.lists(inner)
        | st.tuples(inner, inner)
        | st.dictionaries(st.text(), inner)
        | st.just(())
        | st.just([])
    ),
    max_leaves=30,
)


class Colour(str, enum.Enum):
    """Some words, as a class of its own."""

    RED = "red"


class Level(enum.IntEnum):
    """Some numbers, likewise."""

    HIGH = 3


def told(data: Any) -> str:
    return json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)


@given(VALUES)
def test_the_text_is_that_of_the_standard_library(data: Any) -> None:
    assert canonical_text(data) == told(data)


@pytest.mark.parametrize(
    "data",
    [
        {1: "a", 2: [Level.HIGH]},
        {"a": Colour.RED, Colour.RED: 1},
        {"a": np.float64(1.5)},
        {None: 1},
        [0.0, -0.0, 1e22, 5e-324, 2**70],
        ['\x00\x1f\x7f\u2028\ud800"\\/'],
    ],
)
def test_what_is_unusual_is_left_to_the_standard_library(data: Any) -> None:
    assert canonical_text(data) == told(data)


@pytest.mark.parametrize("number", [math.inf, -math.inf, math.nan])
def test_what_is_no_number_is_refused(number: float) -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        canonical_text({"a": [number]})


@pytest.mark.parametrize("data", [{"a": {1, 2}}, {"a": 1, 2: 3}, [b"bytes"], object()])
def test_what_has_no_word_in_json_is_refused(data: Any) -> None:
    with pytest.raises(TypeError):
        canonical_text(data)
