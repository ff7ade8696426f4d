"""Signals whose values are computed on first access."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any
from weakref import ref

import numpy as np

from ariac_score.trial.signals import Signal, sealed
from ariac_score.trial.spans import FloatArray

__all__ = ["DERIVED", "Computed"]


DERIVED = "derived"
"""The source of a signal that follows from others."""


class Computed(Signal):
    """A signal that keeps a function for its values and calls it on first access.

    Scalar values are kept from then on, because several monitors read them. Vectors are kept
    only while somebody holds them: the velocities of thirty links take more memory than all
    other derived signals together, and monitors need little more of them than their length.
    """

    _make: Callable[[], FloatArray]
    _made: Callable[[], FloatArray | None]

    def __new__(cls, *arguments: Any, **named: Any) -> Any:
        """A plain signal: `dataclasses.replace` and copies give values, not a function for them."""
        return Signal(*arguments, **named)

    @classmethod
    def of(
        cls,
        name: str,
        unit: str,
        t: FloatArray,
        make: Callable[[], FloatArray],
        sources: Sequence[Signal] = (),
    ) -> Signal:
        """A signal whose values are yet to be computed.

        Args:
            name: `quantity/subject`.
            unit: Of its values.
            t: Its times, shape (n,), s, strictly increasing.
            make: Computes its values, shape (n,) or (n, k).
            sources: What they follow from: where these are not known, it is not.
        """
        self: Computed = object.__new__(cls)
        state: dict[str, Any] = {"name": name, "unit": unit, "source": DERIVED, "t": sealed(t)}
        state["holes"] = tuple(sorted({hole for signal in sources for hole in signal.holes}))
        state["constant"] = bool(sources) and all(signal.constant for signal in sources)
        state["stamp_jitter_s"] = max((signal.stamp_jitter_s for signal in sources), default=0.0)
        for key, value in {**state, "_make": make, "_made": _nothing}.items():
            object.__setattr__(self, key, value)
        return self

    def __post_init__(self) -> None:
        """Nothing to check: its times come from checked signals, its values do not exist yet."""

    def __reduce__(self) -> Any:
        plain = (self.name, self.unit, self.t, self.values, self.source)
        return Signal, (*plain, self.holes, self.constant, self.stamp_jitter_s)

    @property
    def identity(self) -> tuple[int, int]:
        """Changes with the times or the values, without computing the values."""
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
            # `Signal` checks this when it is made; here the values are only known now.
            if not np.isfinite(found).all():
                raise ValueError(f"signal {self.name!r}: values must be finite")
            # Not `cached_property`: a vector is to be forgotten when nobody holds it any more.
            object.__setattr__(self, "_made", ref(found) if found.ndim > 1 else _Kept(found))
        return found


def _nothing() -> None:
    """Stands for a reference while no values were computed."""


class _Kept:
    """Called like a weak reference to an array, but keeps the array."""

    def __init__(self, values: FloatArray) -> None:
        self._values = values

    def __call__(self) -> FloatArray:
        return self._values
