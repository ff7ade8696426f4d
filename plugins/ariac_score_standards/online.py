"""Watching robots and humans while a trial goes on: samples as they come, instant by instant.

An instant is judged as soon as every signal has reached it, from the same values that
`ariac_score.align` gives afterwards, to the bit; nothing is judged in a gap. What was
stepped is kept, so that the findings at the end are those of the whole log.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ariac_score import Finding, Sample, Signal, Standing, Trial
from ariac_score_standards.watching import FloatArray, Watched

Value = float | tuple[float, ...]

_TOLERANCE_S = 1e-9  # as in `Signal.covers`


@dataclass
class _Track:
    """The samples of one signal so far."""

    unit: str
    t: list[float] = field(default_factory=list)
    values: list[Value] = field(default_factory=list)


@dataclass
class _Pair:
    """How far the signals of one subject have been judged."""

    subject: str
    names: Mapping[str, str]
    units: Mapping[str, str]
    tracks: list[_Track]
    at: list[int]

    def next_s(self) -> float | None:
        """The first instant that is not judged yet, once every signal has reached it."""
        first_s = math.inf
        for at, track in zip(self.at, self.tracks, strict=True):
            if at == len(track.t):
                return None
            first_s = min(first_s, track.t[at])
        return first_s


class PairsOnline:
    """Watches every robot and human of whom all signals come.

    Args:
        wanted: Unit by signal template; the first names both `{robot}` and `{human}`.
        max_gap_s: Longest stretch between two samples that is bridged, s.
        judge: What holds at one instant, given a subject and its signals there.
        watch: What the monitor finds in a whole trial.
    """

    def __init__(
        self,
        wanted: Mapping[str, str],
        *,
        max_gap_s: float,
        judge: Callable[[str, Watched], Standing],
        watch: Callable[[Trial], Iterable[Finding]],
    ) -> None:
        self._wanted, self._max_gap_s, self._judge, self._watch = wanted, max_gap_s, judge, watch
        first = (
            re.escape(next(iter(wanted))).replace(r"\{robot\}", "([^/]+)").replace(r"\{human\}", "([^/]+)")
        )
        self._of_pair = re.compile(first)
        self._tracks: dict[str, _Track] = {}
        self._pairs: dict[str, _Pair] = {}
        self._by_signal: dict[str, list[_Pair]] = {}

    def step(self, samples: Sequence[Sample]) -> Iterator[Standing]:
        """Take samples, and judge every instant that all signals have reached by now.

        Raises:
            ValueError: The times of a signal do not increase.
        """
        touched: dict[str, _Pair] = {}
        for sample in samples:
            track = self._tracks.get(sample.signal)
            if track is None:
                track = self._begun(sample)
            if track.t and not sample.t_s > track.t[-1]:
                raise ValueError(f"{sample.signal} was at {track.t[-1]} s and is at {sample.t_s} s now")
            track.t.append(sample.t_s)
            track.values.append(sample.value)
            for pair in self._by_signal.get(sample.signal, ()):
                touched[pair.subject] = pair
        for subject in sorted(touched):
            yield from self._judged(touched[subject])

    def end(self, trial: Trial) -> Iterable[Finding]:
        """What the monitor finds in the trial with the samples that were stepped."""
        signals = {
            name: Signal(name, track.unit, np.array(track.t), np.array(track.values))
            for name, track in sorted(self._tracks.items())
            if track.t
        }
        return self._watch(replace(trial, signals={**trial.signals, **signals}))

    def _begun(self, sample: Sample) -> _Track:
        track = self._tracks.setdefault(sample.signal, _Track(sample.unit))
        named = self._of_pair.fullmatch(sample.signal)
        if named is not None:
            self._watch_pair(*named.groups())
        return track

    def _watch_pair(self, robot: str, human: str) -> None:
        names = {template: template.format(robot=robot, human=human) for template in self._wanted}
        units = dict(zip(names.values(), self._wanted.values(), strict=True))
        tracks = [self._tracks.setdefault(name, _Track(unit)) for name, unit in units.items()]
        pair = _Pair(f"{robot}/{human}", names, units, tracks, [0] * len(tracks))
        self._pairs[pair.subject] = pair
        for name in units:
            self._by_signal.setdefault(name, []).append(pair)

    def _judged(self, pair: _Pair) -> Iterator[Standing]:
        while (t_s := pair.next_s()) is not None:
            values = []
            for i, track in enumerate(pair.tracks):
                values.append(self._value(track, pair.at[i], t_s))
                pair.at[i] += track.t[pair.at[i]] == t_s
            columns = {n: v for n, v in zip(pair.units, values, strict=True) if v is not None}
            if len(columns) == len(values):
                now = Watched(np.array([t_s]), columns, [], self._max_gap_s, pair.units, pair.names)
                yield self._judge(pair.subject, now)

    def _value(self, track: _Track, at: int, t_s: float) -> FloatArray | None:
        """The value at an instant that a signal has reached, as one row; `None` in a gap."""
        if track.t[at] == t_s:
            return np.array([track.values[at]])
        if at == 0 or not track.t[at] - track.t[at - 1] <= self._max_gap_s + _TOLERANCE_S:
            return None
        around = slice(at - 1, at + 1)
        return Signal("", "", np.array(track.t[around]), np.array(track.values[around])).at(np.array([t_s]))
