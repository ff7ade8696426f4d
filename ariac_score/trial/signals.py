"""Columnar signals: one named quantity over time, with its unit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ariac_score.errors import MissingSignalError
from ariac_score.trial.frames import frame
from ariac_score.trial.spans import (
    BoolArray,
    FloatArray,
    Span,
    distinct,
    uncovered_spans,
    within_spans,
)

__all__ = [
    "LARGEST_VALUE",
    "Disbelieved",
    "Sample",
    "Series",
    "Signal",
    "align",
    "columns_of",
    "common_times",
    "sealed",
    "settle",
]


@dataclass(frozen=True)
class Sample:
    """One value of one signal at one time: a piece of evidence.

    Attributes:
        signal: Name of the signal.
        t_s: Time, s of trial time.
        value: The value, or its components.
        unit: Its unit.
    """

    signal: str
    t_s: float
    value: float | tuple[float, ...]
    unit: str


@dataclass(frozen=True)
class Disbelieved:
    """Samples that were left out: nothing moves as they say, or two publishers contest each other.

    Attributes:
        span: Between the samples around them that are believed, s of trial time.
        at_s: Time of the first of them, s.
        needed: How fast the value would have had to change to get there, its unit per second.
        least: The least that a scalar was by them; of a position minus infinity.
        most: The most, likewise.
        contested: Whether several publishers tell of it, each another thing.
    """

    span: Span
    at_s: float
    needed: float
    least: float = -math.inf
    most: float = math.inf
    contested: bool = False


# eq=False: arrays have no single truth to compare by.
@dataclass(frozen=True, eq=False)
class _Recorded:
    """What signals and series have in common: times, values, and where they come from."""

    name: str
    unit: str
    t: FloatArray
    values: FloatArray
    source: str = ""

    def __post_init__(self) -> None:
        t, values = _checked_columns(self.name, self.t, self.values)
        self._refuse(t)
        object.__setattr__(self, "t", sealed(t))
        object.__setattr__(self, "values", sealed(values))

    def _refuse(self, t: FloatArray) -> None:
        """Refuse times that cannot be.

        Raises:
            ValueError: Saying of what.
        """
        raise NotImplementedError

    def __len__(self) -> int:
        return len(self.t)

    @property
    def identity(self) -> tuple[int, int]:
        """Differs between those that exist at the same time unless they share times and values."""
        return id(self.t), id(self.values)

    def sample(self, i: int) -> Sample:
        """The i-th sample, as evidence."""
        value = self.values[i]
        plain = float(value) if value.ndim == 0 else tuple(float(v) for v in value)
        return Sample(self.name, float(self.t[i]), plain, self.unit)


@dataclass(frozen=True, eq=False)
class Signal(_Recorded):
    """A named quantity over time.

    Attributes:
        name: `quantity/subject`, see `ariac_score.trial.vocabulary`.
        unit: SI unit of every value.
        t: Sample times, shape (n,), s of trial time, strictly increasing.
        values: Shape (n,) or (n, k), finite.
        source: Where it was recorded, such as the topic, or `derived`; empty when unknown.
        holes: Stretches of which the log itself shows that samples are missing or cannot be believed: nothing
            is known between their ends, however short they are.
        constant: Whether it holds at all times, as a static transform does: it covers everything.
        stamp_jitter_s: By how much its stamps may be late against each other, s: 0 where senders stamped it.
        disbelieved: What was left out because nothing moves so fast, or others say otherwise. What it says
            may be true all the same.
        stated_rate_hz: How often it is published, as its organiser states; 0: nobody says. Who thins out a
            recording evenly makes another interval usual in it.

    Raises:
        ValueError: The times do not increase, or a value is not finite. Readers
            settle both beforehand and count what they had to drop.
    """

    holes: tuple[Span, ...] = ()
    constant: bool = False
    stamp_jitter_s: float = 0.0
    disbelieved: tuple[Disbelieved, ...] = ()
    stated_rate_hz: float = 0.0

    def _refuse(self, t: FloatArray) -> None:
        if not (np.isfinite(t).all() and (np.diff(t) > 0).all()):
            raise ValueError(f"signal {self.name!r}: times must be finite and strictly increasing")

    @property
    def span(self) -> Span | None:
        """From the first to the last sample; `None` when there is no sample."""
        return Span(float(self.t[0]), float(self.t[-1])) if len(self.t) else None

    def at(self, t: FloatArray) -> FloatArray:
        """Values at other times, by straight lines between neighbours.

        At its own sample times the recorded values come back to the bit. Times
        outside the samples take the nearest value; use `covers` to exclude them.
        """
        # Signals of one message have equal times, and interpolating at these would cost most of a monitor.
        if t is self.t or (len(t) == len(self) and np.array_equal(t, self.t)):
            return self.values
        if self.values.ndim == 1:
            return np.interp(t, self.t, self.values)
        return np.stack([np.interp(t, self.t, column) for column in self.values.T], axis=1)

    def covers(self, t: FloatArray, *, max_gap_s: float) -> BoolArray:
        """Whether each time is a sample or lies between two at most `max_gap_s` apart, outside its holes."""
        if self.constant:
            return np.ones(len(t), dtype=bool)
        found = covered(self.t, t, max_gap_s=max_gap_s)
        return found & ~within_spans(t, self.holes) if self.holes else found

    def gaps(self, window: Span, *, max_gap_s: float) -> list[Span]:
        """The stretches of a window this signal says nothing about."""
        if self.constant:
            return []
        return uncovered_spans(self.t, window, max_gap_s=max_gap_s, holes=self.holes)

    def to_frame(self) -> Any:
        """The samples as a `pandas.DataFrame`: times `t_s` as its index, a column for each component.

        The unit is in `attrs["units"]`.

        Raises:
            UsageError: pandas is not installed.
        """
        columns = {"t_s": self.t, **columns_of(self.name, self.values)}
        return frame(columns, index="t_s", units=dict.fromkeys([*columns][1:], self.unit))


# Not a `Signal`: whatever relies on increasing times then never takes one for a signal.
@dataclass(frozen=True, eq=False)
class Series(_Recorded):
    """A named quantity as consumed: in the order in which an official program takes its values.

    Stamps may repeat and run back, and nothing is merged, sorted or left out, for the program counts
    every value. Values go by index; there is no value between two of them.

    Attributes:
        name: `quantity/subject`, see `ariac_score.trial.vocabulary`.
        unit: SI unit of every value.
        t: Stamps in order of consumption, shape (n,), s of trial time.
        values: Shape (n,) or (n, k), finite.
        source: Where it was recorded, such as the topic; empty when unknown.

    Raises:
        ValueError: Shapes do not fit, or a number is not finite.

    >>> force = Series("force/arm", "N", np.array([0.0, 0.1, 0.1]), np.array([3.0, 4.0, 5.0]))
    >>> len(force), float(force.values[2])
    (3, 5.0)
    """

    def _refuse(self, t: FloatArray) -> None:
        if not np.isfinite(t).all():
            raise ValueError(f"series {self.name!r}: times must be finite")

    @property
    def span(self) -> Span | None:
        """From the earliest to the latest stamp; `None` when there is no sample."""
        return Span(float(self.t.min()), float(self.t.max())) if len(self.t) else None

    def to_frame(self) -> Any:
        """The samples as a `pandas.DataFrame`, by their numbers from 0, stamps in the column `t_s`.

        The units are in `attrs["units"]`.

        Raises:
            UsageError: pandas is not installed.
        """
        columns = columns_of(self.name, self.values)
        units = {"t_s": "s", **dict.fromkeys(columns, self.unit)}
        return frame({"t_s": self.t, **columns}, units=units)


def _checked_columns(name: str, t: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Times and values as arrays of float64 that fit each other.

    Raises:
        ValueError: They do not fit, or a value is not finite.
    """
    t, values = np.asarray(t, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if t.ndim != 1 or values.ndim not in (1, 2) or len(values) != len(t):
        raise ValueError(f"signal {name!r}: times {t.shape} and values {values.shape} do not fit")
    if not np.isfinite(values).all():
        raise ValueError(f"signal {name!r}: values must be finite")
    return t, values


def columns_of(name: str, values: FloatArray) -> dict[str, FloatArray]:
    """The values of a signal as columns under its name, numbered where they have components."""
    if values.ndim == 1:
        return {name: values}
    return {f"{name}[{k}]": values[:, k] for k in range(values.shape[1])}


def covered(samples_s: FloatArray, t: FloatArray, *, max_gap_s: float) -> BoolArray:
    """Whether each time is that of a sample or lies between two at most `max_gap_s` apart.

    Args:
        samples_s: Sample times, shape (n,), s, strictly increasing.
        t: The times to be judged, shape (m,), s.
        max_gap_s: Longest stretch between two samples that is covered, s.
    """
    if not len(samples_s):
        return np.zeros(len(t), dtype=bool)
    if len(t) == len(samples_s) and np.array_equal(t, samples_s):
        return np.ones(len(t), dtype=bool)
    place = np.searchsorted(samples_s, t, side="left")
    after = np.minimum(place, len(samples_s) - 1)
    before = np.maximum(place - (samples_s[after] != t), 0)
    inside = (t >= samples_s[0]) & (t <= samples_s[-1])
    # 1 ns more: the difference of two stamps in float64 misses its decimal figure by a little.
    found: BoolArray = inside & (samples_s[after] - samples_s[before] <= max_gap_s + 1e-9)
    return found


def sealed(values: FloatArray) -> FloatArray:
    """The values in memory that nobody can write to.

    A copy, except of an array that is sealed already: signals of one time base share it.
    """
    if not values.size:  # `frombuffer` refuses an empty buffer, and there is nothing to protect
        return np.empty(values.shape)
    owner: Any = values
    while isinstance(owner, np.ndarray):
        owner = owner.base
    # `flags.writeable = False` would not do: it can be set back, and the caller still has a writable view.
    if isinstance(owner, bytes) and values.flags.c_contiguous:
        return values
    return np.frombuffer(values.tobytes(), dtype=np.float64).reshape(values.shape)


def common_times(signals: Sequence[Signal], *, max_gap_s: float) -> FloatArray:
    """The times of a common base: of all samples those that every signal covers, as of `align`.

    Args:
        signals: At least one.
        max_gap_s: Longest stretch between two samples that is interpolated, s.

    Raises:
        MissingSignalError: One is a series as consumed.
    """
    for signal in signals:
        if isinstance(signal, Series):
            raise MissingSignalError(signal.name, (), as_consumed=(signal.name,))
    # What is constant says nothing of when anything was seen.
    moving = [signal for signal in signals if not signal.constant] or signals
    # By identity first: signals of one message share one array of times.
    bases = list({id(signal.t): signal.t for signal in moving}.values())
    holes = [hole for signal in moving for hole in signal.holes]
    times = bases[0]
    if not all(np.array_equal(t, times) for t in bases[1:]):
        times = distinct(np.concatenate(bases))
        known = np.ones(len(times), dtype=bool)
        for t in bases:
            known &= covered(t, times, max_gap_s=max_gap_s)
        times = times[known]
    return times[~within_spans(times, holes)] if holes else times


def align(signals: Sequence[Signal], *, max_gap_s: float) -> tuple[FloatArray, list[FloatArray]]:
    """Bring signals onto one time base without inventing anything in their gaps.

    Signals sampled together keep their samples to the bit. Otherwise the base is
    the union of all sample times, less those that some signal does not cover.

    Args:
        signals: At least one.
        max_gap_s: Longest stretch between two samples that is interpolated, s.

    Returns:
        The times, shape (m,), and for each signal its values there, shape (m,) or (m, k).
    """
    t = common_times(signals, max_gap_s=max_gap_s)
    if not len(t):
        return t, [s.values[:0] for s in signals]
    return t, [s.at(t) for s in signals]


@dataclass(frozen=True)
class Settled:
    """Samples put in order, and what had to be dropped for it."""

    t: FloatArray
    values: FloatArray
    disordered: int
    repeated: int
    contradicting: int
    not_finite: int
    largest_step_back_s: float


def _within(values: FloatArray, least: float) -> bool:
    """Whether all values are numbers from `least` to the largest that counts."""
    if not values.size:
        return True
    with np.errstate(invalid="ignore"):  # NaN is neither
        return bool(values.min() >= least and values.max() <= LARGEST_VALUE)


LARGEST_VALUE = 1e9
"""No quantity of a competition cell, in SI units, is larger; a larger value is a fault of the recorder."""


def settle(t: FloatArray, values: FloatArray, *, at_least: float = -math.inf) -> Settled:
    """The one policy for recorded samples: sorted, unique in time, finite.

    Samples are sorted by time (stably). Of equal samples with one stamp the first is kept;
    where they contradict each other none is, for nothing says which is right. Values that
    are not finite, beyond `LARGEST_VALUE`, or below the least value of the quantity are
    dropped too. Every dropped sample is counted and leaves a gap that monitors see.

    Args:
        t: Times in recorded order, shape (n,), s.
        values: Values, shape (n,) or (n, k).
        at_least: The least value the quantity can have, such as 0 for a speed.
    """
    not_finite = 0
    if not (_within(values, max(-LARGEST_VALUE, at_least)) and np.isfinite(t).all()):
        with np.errstate(invalid="ignore"):  # comparisons with NaN are false, so NaN is not sound
            sound = (np.abs(values) <= LARGEST_VALUE) & (values >= at_least)
        finite = np.isfinite(t) & (sound.all(axis=1) if sound.ndim > 1 else sound)
        not_finite = int(len(t) - finite.sum())
        t, values = t[finite], values[finite]
    # Counted before sorting, on finite samples only: NaN compares as neither earlier nor later.
    steps = np.diff(t)
    disordered = int((steps < 0).sum())
    back = float(-steps.min(initial=0.0))
    if disordered:
        order = np.argsort(t, kind="stable")  # the same result on every machine
        t, values = t[order], values[order]
    elif not len(steps) or steps.min() > 0:
        return Settled(t, values, 0, 0, 0, not_finite, back)
    first_of_stamp = np.append(True, np.diff(t) > 0) if len(t) else np.zeros(0, dtype=bool)
    repeated = int(len(t) - first_of_stamp.sum())
    contradicting = 0
    if repeated:
        # Each sample is compared with the first one of its stamp; a single difference condemns the stamp.
        stamp = np.cumsum(first_of_stamp) - 1
        differs = (values != values[first_of_stamp][stamp]).reshape(len(t), -1).any(axis=1)
        agreed = np.bincount(stamp, weights=differs) == 0
        contradicting = int((~agreed).sum())
        kept = first_of_stamp & agreed[stamp]
        t, values = t[kept], values[kept]
    return Settled(t, values, disordered, repeated, contradicting, not_finite, back)
