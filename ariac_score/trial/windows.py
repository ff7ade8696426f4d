"""Signals window by window: on a common time base, or computed where they are looked at.

A trial is cut into windows of time in which no signal has more than some thousand samples.
`TimeBase` brings signals onto one time base as `align` does, to the bit, a window at a time;
a `Computed` signal keeps how its values are made instead of the values. What was computed
last stays, up to a fixed number of bytes, whatever the length of the trial.
"""

from __future__ import annotations

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import accumulate, count
from math import inf, nextafter
from typing import Any, TypeAlias
from weakref import ref

import numpy as np

from ariac_score.trial.signals import Signal, covered
from ariac_score.trial.spans import FloatArray, Span, distinct

__all__ = ["LARGEST_WINDOW_SAMPLES", "Aligned", "Computed", "Kept", "TimeBase", "cuts_of", "same_times"]

LARGEST_WINDOW_SAMPLES = 4096
"""No signal has more samples in a window: what is computed of one stays in the processor's cache."""

KEPT_BYTES = 64 << 20
KEPT_VECTOR_BYTES = 12 << 20
"""Of what was computed so much stays: numbers over time, and vectors over time."""

Window: TypeAlias = "tuple[FloatArray, FloatArray]"
"""Times and values of one window."""


def cuts_of(signals: Iterable[Signal]) -> FloatArray:
    """The times at which the windows of some signals begin, without the first.

    No signal has more than `LARGEST_WINDOW_SAMPLES` in a window.
    """
    found, known = [np.zeros(0)], set()
    for signal in signals:
        key = signal.identity[0]
        if key not in known:
            known.add(key)
            found.append(signal.cuts(LARGEST_WINDOW_SAMPLES))
    return distinct(np.concatenate(found))


def same_times(one: Signal, other: Signal) -> bool:
    """Whether two signals are known to have the same sample times."""
    if one.identity[0] == other.identity[0]:
        return True
    a, b = one.fixed_t, other.fixed_t
    if a is None or b is None or len(a) != len(b):
        return False
    step = LARGEST_WINDOW_SAMPLES
    return all(np.array_equal(a[i : i + step], b[i : i + step]) for i in range(0, len(a), step))


class Kept:
    """What was computed last, up to a number of bytes."""

    def __init__(self) -> None:
        self._numbers = count()
        self._rooms = {1: [KEPT_BYTES, 0], 2: [KEPT_VECTOR_BYTES, 0]}
        self._windows: dict[int, OrderedDict[tuple[int, int], Window]] = {
            n: OrderedDict() for n in self._rooms
        }

    def number(self) -> int:
        """What to call a signal that keeps windows here; no other is called so."""
        return next(self._numbers)

    def get(self, key: tuple[int, int], dimensions: int) -> Window | None:
        """A window that is still there."""
        windows = self._windows[dimensions]
        if key not in windows:
            return None
        windows.move_to_end(key)
        return windows[key]

    def put(self, key: tuple[int, int], window: Window) -> None:
        """Keep a window, at the cost of those not asked for the longest."""
        room, windows = self._rooms[window[1].ndim], self._windows[window[1].ndim]
        windows[key] = window
        room[1] += _bytes(window)
        while room[1] > room[0] and windows:
            _, gone = windows.popitem(last=False)
            room[1] -= _bytes(gone)


def _bytes(window: Window) -> int:
    t, values = window
    return values.nbytes + (t.nbytes if t.base is None else 0)


class TimeBase:
    """Signals on one time base, window by window: put together, the windows are what `align` gives.

    Args:
        signals: At least one.
        max_gap_s: Longest stretch between two samples that is interpolated, s.
        cuts: Where windows begin, without the first; by default as the signals ask for.
    """

    def __init__(
        self, signals: Sequence[Signal], *, max_gap_s: float, cuts: FloatArray | None = None
    ) -> None:
        self.signals, self.max_gap_s = tuple(signals), max_gap_s
        self.cuts = cuts_of(signals) if cuts is None else cuts
        first = self.signals[0]
        together = all(same_times(first, signal) for signal in self.signals[1:])
        self.leader: Signal | None = first if together else None
        """A signal whose samples are the time base; `None` where there is none."""
        self._bases = list({signal.identity[0]: signal for signal in self.signals}.values())
        self._rows: list[int] | None = None
        if self.leader is not None and self.leader.fixed_t is not None:
            t = self.leader.fixed_t
            self._rows = [0, *t.searchsorted(self.cuts).tolist(), len(t)]
        self._last: dict[int, FloatArray] = {}

    def __len__(self) -> int:
        return len(self.cuts) + 1

    def reach(self, k: int) -> tuple[float, float]:
        """Window k is from the one time to before the other."""
        low = -np.inf if k == 0 else float(self.cuts[k - 1])
        return low, np.inf if k == len(self.cuts) else float(self.cuts[k])

    def rows(self, k: int) -> tuple[int, int]:
        """The rows of window k, where there is a leader."""
        assert self.leader is not None  # the caller knows
        if self._rows is not None:
            return self._rows[k], self._rows[k + 1]
        low, high = self.reach(k)
        return self.leader.row(low), self.leader.row(high)

    def times(self, k: int) -> FloatArray:
        """The times of window k, shape (m,)."""
        if k not in self._last:
            self._last = {**dict(list(self._last.items())[-1:]), k: self._times(k)}
        return self._last[k]

    def _times(self, k: int) -> FloatArray:
        if self.leader is not None:
            return self.leader.times(*self.rows(k))
        low, high = self.reach(k)
        parts = [_around(signal, low, high) for signal in self._bases]
        t = distinct(np.concatenate([part[0][part[1] : part[2]] for part in parts]))
        known = np.ones(len(t), dtype=bool)
        for part, _, _ in parts:
            known &= covered(part, t, max_gap_s=self.max_gap_s)
        return t[known]

    def values(self, number: int, k: int) -> FloatArray:
        """The values of a signal in window k, shape (m,) or (m, c)."""
        signal = self.signals[number]
        if self.leader is not None:
            return signal.stretch(*self.rows(k))[1]
        return values_at(signal, self.times(k), *self.reach(k))

    def beyond(self, k: int, signal: Signal) -> FloatArray:
        """The values of another signal in window k; NaN where it has none."""
        if self.leader is not None and same_times(self.leader, signal):
            return signal.stretch(*self.rows(k))[1]
        t, reach = self.times(k), self.reach(k)
        values = np.array(values_at(signal, t, *reach), dtype=np.float64)
        values[~covered(_around(signal, *reach)[0], t, max_gap_s=self.max_gap_s)] = np.nan
        return values


class Aligned:
    """Signals on one time base, of which any samples can be had: together they are what `align` gives.

    Args:
        signals: At least one, by any names.
        span: Samples within it count; `None`: all do.
        max_gap_s: Longest stretch between two samples that is interpolated, s.
    """

    def __init__(self, signals: Mapping[str, Signal], span: Span | None, *, max_gap_s: float) -> None:
        self._base = base = TimeBase(list(signals.values()), max_gap_s=max_gap_s)
        self._names = list(signals)
        self._reach = (-inf, inf) if span is None else (span.start_s, span.end_s)
        leader = base.leader
        self._t: FloatArray | None = None
        """All times, where they need not be computed."""
        if leader is not None:
            self._first, last = leader.row(self._reach[0]), leader.row(nextafter(self._reach[1], inf))
            counts = [last - self._first]
            if leader.fixed_t is not None:
                self._t = leader.fixed_t[self._first : last]
        else:
            counts = [len(self._window(k)) for k in range(len(base))]
        self._rows = [0, *accumulate(counts)]

    def __len__(self) -> int:
        return self._rows[-1]

    @property
    def cuts(self) -> FloatArray:
        """Times between which no signal has more than some thousand samples, s."""
        return self._base.cuts

    def row(self, t_s: float) -> int:
        """The first sample at or after a time."""
        if self._t is not None:
            return int(self._t.searchsorted(t_s))
        leader = self._base.leader
        if leader is not None:
            return min(max(leader.row(t_s) - self._first, 0), len(self))
        k = int(self._base.cuts.searchsorted(t_s, side="right"))
        return self._rows[k] + int(self._window(k).searchsorted(t_s))

    def times(self, first: int, last: int) -> FloatArray:
        """The times of the samples from one to before another, s."""
        if self._t is not None:
            return self._t[first:last]
        leader = self._base.leader
        if leader is not None:
            return leader.times(self._first + first, self._first + last)
        parts = [self._window(k)[rows] for k, rows in self._parts(first, last)]
        return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0), *parts])

    def columns(self, first: int, last: int) -> dict[str, FloatArray]:
        """The values of the samples from one to before another, by name."""
        signals, leader = self._base.signals, self._base.leader
        if leader is not None:
            here = self._first + first, self._first + last
            return {n: s.stretch(*here)[1] for n, s in zip(self._names, signals, strict=True)}
        found: dict[str, FloatArray] = {}
        for number, name in enumerate(self._names):
            parts = [
                self._base.values(number, k)[self._inside(k)][rows] for k, rows in self._parts(first, last)
            ]
            parts = parts or [self._base.values(number, 0)[:0]]
            found[name] = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return found

    def stretches(self) -> Iterator[FloatArray]:
        """All times, some thousand at a time."""
        return (self.times(first, last) for first, last in self.runs(LARGEST_WINDOW_SAMPLES))

    def runs(self, samples: int) -> Iterator[tuple[int, int]]:
        """All samples, at most so many at a time: from one to before another."""
        for first in range(0, len(self), samples):
            yield first, min(first + samples, len(self))

    def _parts(self, first: int, last: int) -> Iterator[tuple[int, slice]]:
        k = bisect_right(self._rows, first) - 1
        while k < len(self._rows) - 1 and self._rows[k] < last:
            yield k, slice(max(first - self._rows[k], 0), last - self._rows[k])
            k += 1

    def _inside(self, k: int) -> slice:
        t, (start_s, end_s) = self._base.times(k), self._reach
        return slice(int(t.searchsorted(start_s)), int(t.searchsorted(end_s, side="right")))

    def _window(self, k: int) -> FloatArray:
        return self._base.times(k)[self._inside(k)]


def _around(signal: Signal, low: float, high: float) -> tuple[FloatArray, int, int]:
    """The times of a signal from `low` to before `high` with one more on each side; which are inside."""
    first, last = signal.row(low), signal.row(high)
    before, after = max(first - 1, 0), min(last + 1, len(signal))
    return signal.times(before, after), first - before, last - before


def values_at(signal: Signal, t: FloatArray, low: float, high: float) -> FloatArray:
    """Values at times between `low` and `high`, as `Signal.at` gives them."""
    first, last = signal.row(low), signal.row(high)
    own, values = signal.stretch(max(first - 1, 0), min(last + 1, len(signal)))
    if not len(t) or not len(own):
        return np.zeros((len(t), *values.shape[1:]))
    if values.ndim == 1:
        return np.interp(t, own, values)
    return np.stack([np.interp(t, own, column) for column in values.T], axis=1)


class Computed(Signal):
    """A signal that keeps how its values are made: each window is computed when it is looked at.

    To whoever asks for `t` and `values` it is as any other signal; then, and for as long
    as they are held, it is whole.
    """

    _cuts: FloatArray
    _fixed_t: FloatArray | None
    _rows: list[int]
    _window: Callable[[int], Window]
    _kept: Kept
    _number: int
    _whole: dict[str, Any]

    def __new__(cls, *arguments: Any, **named: Any) -> Any:
        """What is made of its parts, as copies with a change are, is a plain signal."""
        return Signal(*arguments, **named)

    @classmethod
    def made(
        cls,
        name: str,
        unit: str,
        base: TimeBase | None,
        cuts: FloatArray,
        counts: Sequence[int],
        window: Callable[[int], Window],
        kept: Kept,
    ) -> Signal:
        """A signal of computed windows.

        Args:
            name: `quantity/subject`.
            unit: Of its values.
            base: Whose times are its times, all of them; `None` where it leaves some out.
            cuts: Where windows begin, without the first.
            counts: Number of samples in each window.
            window: Times and values of a window.
            kept: Where windows stay for a while.
        """
        self: Computed = object.__new__(cls)
        leader = base.leader if base is not None else None
        state: dict[str, Any] = {
            "name": name,
            "unit": unit,
            "source": "derived",
            "_cuts": cuts,
            "_fixed_t": None if leader is None else leader.fixed_t,
            "_rows": [0, *accumulate(counts)],
            "_window": window,
            "_kept": kept,
            "_number": kept.number(),
            "_whole": {},
        }
        for key, value in state.items():
            object.__setattr__(self, key, value)
        return self

    def __post_init__(self) -> None:
        """Nothing to check: what it is made of was checked."""

    def __len__(self) -> int:
        return self._rows[-1]

    def __reduce__(self) -> Any:
        return Signal, (self.name, self.unit, self.t, self.values, self.source)

    @property
    def identity(self) -> tuple[int, int]:
        """Tells apart times, and values."""
        return id(self if self._fixed_t is None else self._fixed_t), id(self)

    @property
    def fixed_t(self) -> FloatArray | None:
        """The times, where they need not be computed."""
        return self._fixed_t

    def cuts(self, _samples: int) -> FloatArray:
        """Where its windows begin."""
        return self._cuts

    @property
    def t(self) -> FloatArray:
        """All times."""
        return self._fixed_t if self._fixed_t is not None else self._all("t")

    @property
    def values(self) -> FloatArray:
        """All values."""
        return self._all("values")

    def _all(self, which: str) -> FloatArray:
        """Times or values as a whole, shared by all who hold them at a time."""
        held = self._whole.get(which)
        found = None if held is None else held()
        if found is None:
            windows = [self.window(k)[which == "values"] for k in range(len(self._rows) - 1)]
            buffer = np.concatenate(windows)
            found = np.frombuffer(buffer.tobytes(), dtype=np.float64).reshape(buffer.shape)
            self._whole[which] = ref(found)
        return found

    @property
    def span(self) -> Span | None:
        """From the first to the last sample; `None` when there is no sample."""
        if not len(self):
            return None
        return Span(float(self.times(0, 1)[0]), float(self.times(len(self) - 1, len(self))[0]))

    def window(self, k: int) -> Window:
        """Times and values of window k."""
        key = self._number, k
        found = self._kept.get(key, 1) or self._kept.get(key, 2)
        if found is None:
            found = self._window(k)
            if not np.isfinite(found[1]).all():
                raise ValueError(f"signal {self.name!r}: values must be finite")
            self._kept.put(key, found)
        return found

    def row(self, t_s: float) -> int:
        """The first row at or after a time."""
        if self._fixed_t is not None:
            return int(self._fixed_t.searchsorted(t_s))
        k = int(self._cuts.searchsorted(t_s, side="right"))
        if t_s == np.inf:
            return len(self)
        if self._rows[k] == self._rows[k + 1] or t_s == -np.inf or (k and t_s == self._cuts[k - 1]):
            return self._rows[k]
        return self._rows[k] + int(self.window(k)[0].searchsorted(t_s))

    def times(self, first: int, last: int) -> FloatArray:
        """The times of some rows."""
        return self._fixed_t[first:last] if self._fixed_t is not None else self.stretch(first, last)[0]

    def stretch(self, first: int, last: int) -> Window:
        """Times and values of some rows."""
        parts, last_window = [], len(self._rows) - 2
        k = min(bisect_right(self._rows, first) - 1, last_window)
        while True:
            t, values = self.window(k)
            part = slice(max(first - self._rows[k], 0), max(last - self._rows[k], 0))
            parts.append((t[part], values[part]))
            k += 1
            if k > last_window or self._rows[k] >= last:
                break
        if len(parts) == 1:
            return parts[0]
        return np.concatenate([t for t, _ in parts]), np.concatenate([values for _, values in parts])
