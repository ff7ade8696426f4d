"""What a monitor shows of what it judged: what was, against what may be, over time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ariac_score.trial.spans import FloatArray

__all__ = ["Course"]


@dataclass(frozen=True, eq=False)
class Course:
    """A measured quantity beside its limit over time, as a monitor saw it.

    Attributes:
        subject: As in its findings.
        what: Name of the quantity, such as `distance`.
        unit: Of quantity and limit.
        t: Sample times, shape (n,), s, strictly increasing.
        actual: What was, shape (n,).
        limit: What may be, shape (n,); NaN where there is no limit.
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

    @classmethod
    def late(
        cls,
        subject: str,
        what: str,
        unit: str,
        made: Callable[[], Iterable[Course]],
        *,
        times: Callable[[], Iterable[FloatArray]],
        max_gap_s: float,
        at_most: bool = False,
    ) -> Course:
        """A course that is made part by part whenever it is looked at, and never held as a whole.

        Args:
            subject: As of any course.
            what: Likewise.
            unit: Likewise.
            made: The parts, one after the other.
            times: Their times alone.
            max_gap_s: As of any course.
            at_most: Likewise.
        """
        return _Late(subject, what, unit, made, times, max_gap_s, at_most)

    def parts(self) -> Iterable[Course]:
        """The course in parts, one after the other."""
        return [self]

    def times(self) -> Iterable[FloatArray]:
        """The times of these parts."""
        return [self.t]

    def __post_init__(self) -> None:
        if not self.t.shape == self.actual.shape == self.limit.shape == (len(self.t),):
            raise ValueError(f"the course of {self.what} has columns of different length")
        if not (np.isfinite(self.t).all() and np.isfinite(self.actual).all()):
            raise ValueError(f"the course of {self.what} holds what is no number")
        if (np.diff(self.t) <= 0).any():
            raise ValueError(f"the times of the course of {self.what} do not increase")


class _Late(Course):
    """A course of which only how it is made is kept."""

    _made: Callable[[], Iterable[Course]]
    _times: Callable[[], Iterable[FloatArray]]

    def __init__(
        self,
        subject: str,
        what: str,
        unit: str,
        made: Callable[[], Iterable[Course]],
        times: Callable[[], Iterable[FloatArray]],
        max_gap_s: float,
        at_most: bool,
    ) -> None:
        known = {"subject": subject, "what": what, "unit": unit, "max_gap_s": max_gap_s, "at_most": at_most}
        for name, value in {**known, "_made": made, "_times": times}.items():
            object.__setattr__(self, name, value)

    def parts(self) -> Iterable[Course]:
        """The course in parts, made anew."""
        return self._made()

    def times(self) -> Iterable[FloatArray]:
        """The times of these parts."""
        return self._times()

    @property
    def t(self) -> FloatArray:
        """All times."""
        return np.concatenate(list(self._times()))

    @property
    def actual(self) -> FloatArray:
        """All that was."""
        return np.concatenate([part.actual for part in self._made()])

    @property
    def limit(self) -> FloatArray:
        """All that may be."""
        return np.concatenate([part.limit for part in self._made()])
