"""Signals that are computed when they are first looked at."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import ref

import numpy as np

from ariac_score.trial.signals import Signal, sealed
from ariac_score.trial.spans import FloatArray

__all__ = ["Computed"]


class Computed(Signal):
    """A signal that keeps how its values are made, and makes them when they are first looked at.

    Numbers over time stay from then on, for one monitor after the other looks at them. Vectors
    stay only as long as somebody holds them: the velocities of thirty links take more room than
    all else that is derived, and of each little more than its length is ever wanted.
    """

    _make: Callable[[], FloatArray]
    _made: Callable[[], FloatArray | None]

    def __new__(cls, *arguments: Any, **named: Any) -> Any:
        """What is made of its parts, as copies with a change are, is a plain signal."""
        return Signal(*arguments, **named)

    @classmethod
    def of(cls, name: str, unit: str, t: FloatArray, make: Callable[[], FloatArray]) -> Signal:
        """A signal of values yet to be made.

        Args:
            name: `quantity/subject`.
            unit: Of its values.
            t: Its times, shape (n,), s, strictly increasing.
            make: Its values, shape (n,) or (n, k).
        """
        self: Computed = object.__new__(cls)
        state = {"name": name, "unit": unit, "source": "derived", "t": sealed(t)}
        for key, value in {**state, "_make": make, "_made": _nothing}.items():
            object.__setattr__(self, key, value)
        return self

    def __post_init__(self) -> None:
        """Nothing to check: what it is made of was checked."""

    def __reduce__(self) -> Any:
        return Signal, (self.name, self.unit, self.t, self.values, self.source)

    @property
    def identity(self) -> tuple[int, int]:
        """Tells apart times, and values."""
        return id(self.t), id(self)

    @property
    def values(self) -> FloatArray:
        """The values, shape (n,) or (n, k), finite.

        Raises:
            ValueError: A value is not finite.
        """
        found = self._made()
        if found is None:
            found = sealed(self._make())
            if not np.isfinite(found).all():
                raise ValueError(f"signal {self.name!r}: values must be finite")
            object.__setattr__(self, "_made", ref(found) if found.ndim > 1 else _Kept(found))
        return found


def _nothing() -> None:
    """What was made before anything was."""


class _Kept:
    """As a reference to an array, but one that keeps it."""

    def __init__(self, values: FloatArray) -> None:
        self._values = values

    def __call__(self) -> FloatArray:
        return self._values
