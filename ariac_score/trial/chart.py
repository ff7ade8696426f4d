"""A measured quantity and its limit over time, as a monitor judged it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ariac_score.trial.spans import FloatArray

__all__ = ["Chart"]


@dataclass(frozen=True, eq=False)
class Chart:
    """A measured quantity and its limit over time, as a monitor judged them.

    Attributes:
        subject: As in its findings.
        what: Name of the quantity, such as `distance`.
        unit: Of quantity and limit.
        t: Sample times, shape (n,), s, strictly increasing.
        actual: The measured values, shape (n,).
        limit: The limits, shape (n,); NaN where there is none.
        at_most: Whether the limit is an upper one.
        max_gap_s: Nothing is known between samples further apart, s.

    Raises:
        ValueError: Shapes differ, or something measured is not finite.
    """

    subject: str
    what: str
    unit: str
    t: FloatArray
    actual: FloatArray
    limit: FloatArray
    at_most: bool = False
    max_gap_s: float = math.inf

    @property
    def margin(self) -> FloatArray:
        """Signed distance to the limit, shape (n,), negative where it is broken; NaN where there is none."""
        return self.limit - self.actual if self.at_most else self.actual - self.limit

    def __post_init__(self) -> None:
        if not self.t.shape == self.actual.shape == self.limit.shape == (len(self.t),):
            raise ValueError(f"the chart of {self.what} has columns of different length")
        # Limits may be NaN, where there is none; measured values may not.
        if not (np.isfinite(self.t).all() and np.isfinite(self.actual).all()):
            raise ValueError(f"the chart of {self.what} holds a value that is not finite")
        if (np.diff(self.t) <= 0).any():
            raise ValueError(f"the times of the chart of {self.what} do not increase")
