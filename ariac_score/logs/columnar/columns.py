"""The outcome of columnar decoding: columns and defects."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score.logs.containers.items import IntArray

__all__ = ["UNDECODABLE", "Column", "Columns", "Defect", "ranges"]


UNDECODABLE = (
    struct.error,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    MemoryError,
    NameError,
    RecursionError,
    SyntaxError,
    TypeError,
    ValueError,
)
"""Errors that the parsers and the generated code of rosbags raise on false definitions and payloads,
besides its own ones. Found by feeding it such; `Exception` would hide faults of ours."""


@dataclass(frozen=True, eq=False)
class Column:
    """The values of one field in all sound messages, in their order.

    Attributes:
        path: Dotted path of the field.
        values: Numbers as the definition types them; texts as indices into `texts`.
        offsets: One array for each array or sequence on the way to the field, outermost
            first: element i of that level holds elements `offsets[i]` to `offsets[i + 1]`
            of the next. Empty when each message has one value.
        texts: The distinct texts; `None` for numbers.
        levels: The path of the array or sequence that each of `offsets` is about.
    """

    path: str
    values: NDArray[Any]
    offsets: tuple[IntArray, ...] = ()
    texts: tuple[str, ...] | None = None
    levels: tuple[str, ...] = ()

    def per_message(self) -> IntArray:
        """How many values each message has, shape (m,)."""
        if not self.offsets:
            return np.ones(len(self.values), dtype=np.int64)
        # From the outermost level inwards, bounds of messages become bounds of values.
        bounds = self.offsets[0]
        for level in self.offsets[1:]:
            bounds = level[bounds]
        return np.diff(bounds)

    def text(self) -> list[str]:
        """The values of a column of texts, written out."""
        assert self.texts is not None
        return [self.texts[code] for code in self.values]


@dataclass(frozen=True)
class Defect:
    """A message that does not fit its definition: its index among those given, and the cause."""

    index: int
    cause: str


@dataclass(frozen=True, eq=False)
class Columns:
    """The wanted fields of some messages.

    Attributes:
        rows: The sound messages, as indices into those given, increasing.
        columns: By path, of the sound messages only.
        defects: The other messages, by index.
        fallback: Why the messages were decoded one by one; empty when they were not.
    """

    rows: IntArray
    columns: dict[str, Column]
    defects: tuple[Defect, ...] = ()
    fallback: str = ""


def ranges(starts: IntArray, counts: IntArray) -> IntArray:
    """Counting up from each start, one after the other.

    >>> ranges(np.array([5, 0]), np.array([2, 3])).tolist()
    [5, 6, 0, 1, 2]
    """
    # One `arange` over all runs, shifted in each run to its start: no loop over runs.
    before = np.cumsum(counts) - counts
    found: IntArray = np.repeat(starts - before, counts) + np.arange(int(counts.sum()), dtype=np.int64)
    return found
