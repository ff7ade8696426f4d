"""Signals while they are recorded: sample by sample, aligned as `align` aligns whole signals.

A watch that is stepped keeps its samples here. An instant is given as soon as every
signal has reached it, with the values that `align` gives it in the whole log, to the bit.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Sample, Signal

__all__ = ["Alignment", "Arrivals", "Value"]

Value = float | tuple[float, ...]

_TOLERANCE_S = 1e-9  # as in `Signal.covers`


@dataclass
class _Track:
    """The samples of one signal so far."""

    unit: str = ""
    # Arrays of doubles: a list of floats takes four times the memory.
    t: array[float] = field(default_factory=lambda: array("d"))
    values: Any = field(default_factory=lambda: array("d"))  # of several components: a list of tuples

    def append(self, sample: Sample) -> None:
        """Keep one more."""
        if not self.t and isinstance(sample.value, tuple):
            self.values = []
        self.values.append(sample.value)
        self.t.append(sample.t_s)
        self.unit = sample.unit


class Arrivals:
    """The samples of a trial that have arrived so far.

    >>> arrivals = Arrivals()
    >>> speeds = arrivals.aligned(["speed/human", "speed/robot"], max_gap_s=0.05)
    >>> arrivals.take([Sample("speed/human", 0.0, 1.0, "m/s"), Sample("speed/robot", 0.0, 0.5, "m/s")])
    >>> arrivals.take([Sample("speed/human", 0.02, 1.4, "m/s")])
    >>> list(speeds.rows())
    [(0.0, (1.0, 0.5))]
    >>> arrivals.take([Sample("speed/robot", 0.01, 0.6, "m/s")])
    >>> list(speeds.rows())
    [(0.01, (1.2, 0.6))]
    """

    def __init__(self) -> None:
        self._tracks: dict[str, _Track] = {}

    def take(self, samples: Iterable[Sample]) -> None:
        """Take the samples that have just arrived.

        Raises:
            ValueError: The times of a signal do not increase; the samples before that one are taken.
        """
        tracks = self._tracks
        for sample in samples:
            track = tracks.get(sample.signal)
            if track is None:
                track = tracks[sample.signal] = _Track()
            t = track.t
            if t and not sample.t_s > t[-1]:  # not `<=`: NaN must be refused
                raise ValueError(f"times of {sample.signal} do not increase: {sample.t_s} s after {t[-1]} s")
            track.append(sample)

    def __contains__(self, signal: str) -> bool:
        track = self._tracks.get(signal)
        return track is not None and bool(track.t)

    def aligned(self, signals: Sequence[str], *, max_gap_s: float) -> Alignment:
        """Signals on one time base, whether they have samples already or not.

        Args:
            signals: At least one.
            max_gap_s: Longest stretch between two samples that is interpolated, s.
        """
        return Alignment([self._tracks.setdefault(name, _Track()) for name in signals], max_gap_s)

    def complete(self, trial: Trial) -> Trial:
        """A trial with the signals that have arrived."""
        signals = {
            name: Signal(name, track.unit, np.array(track.t), np.array(track.values))
            for name, track in sorted(self._tracks.items())
            if track.t
        }
        return replace(trial, signals={**trial.signals, **signals})


class Alignment:
    """Some signals on one time base, as far as all of them have arrived.

    Args:
        tracks: Of the signals.
        max_gap_s: Longest stretch between two samples that is interpolated, s.
    """

    def __init__(self, tracks: Sequence[_Track], max_gap_s: float) -> None:
        self._tracks, self._longest_s = tuple(tracks), max_gap_s + _TOLERANCE_S
        self._at = [0] * len(tracks)
        self._together = True

    @property
    def reached_s(self) -> float:
        """The last time that every signal has reached, s; minus infinity while one has no sample."""
        return min((track.t[-1] if track.t else -math.inf) for track in self._tracks)

    def rows(self) -> Iterator[tuple[float, tuple[Value, ...]]]:
        """The instants that all signals have reached since the last call, with their values."""
        # Signals of one message need no interpolation; after a first difference, comparing gains nothing.
        if self._together:
            yield from self._rows_together()
        while (t_s := self._next_s()) is not None:
            values = tuple(self._value(i, t_s) for i in range(len(self._tracks)))
            if None not in values:
                yield t_s, values  # type: ignore[misc]  # none is None

    def _rows_together(self) -> Iterator[tuple[float, tuple[Value, ...]]]:
        """Rows for as long as all signals have had samples at the same times, as those of one message."""
        tracks, first, at = self._tracks, self._tracks[0].t, self._at
        k = at[0]
        while True:
            for track in tracks:
                if len(track.t) <= k:
                    return
            t_s = first[k]
            for track in tracks:
                if track.t[k] != t_s:
                    self._together = False
                    return
            k += 1
            at[:] = [k] * len(tracks)
            yield t_s, tuple([track.values[k - 1] for track in tracks])

    def _next_s(self) -> float | None:
        first_s = math.inf
        for track, at in zip(self._tracks, self._at, strict=True):
            if at == len(track.t):
                return None
            first_s = min(first_s, track.t[at])
        return first_s

    def _value(self, i: int, t_s: float) -> Value | None:
        """The value at an instant that the signal has reached; `None` in a gap."""
        track, at = self._tracks[i], self._at[i]
        t = track.t
        if t[at] == t_s:
            self._at[i] = at + 1
            known: Value = track.values[at]
            return known
        if at == 0 or not t[at] - t[at - 1] <= self._longest_s:
            return None  # before the first sample, or within a gap, nothing is known
        # By `Signal.at`, which interpolates whole logs: another formula would differ in the last bits.
        around = Signal("", "", np.array(t[at - 1 : at + 1]), np.array(track.values[at - 1 : at + 1]))
        value = around.at(np.array([t_s]))[0]
        return float(value) if np.ndim(value) == 0 else tuple(value.tolist())
