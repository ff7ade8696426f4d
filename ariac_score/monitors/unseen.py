"""What signals can have been where no sample shows them: their least and most in every cell of time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ariac_score.monitors.alike import ALIKE, by_intervals, never_moved, say_the_same
from ariac_score.monitors.cells import INSTANT_S, TOLERANCE_S, Cells, Stream, longest_held_s, standing
from ariac_score.monitors.gaps import (
    Drive,
    Place,
    between,
    highest_speed,
    lowest_speed,
    off_the_chord,
    places_apart,
    reach,
)
from ariac_score.trial.bounds import BetweenSamples, MotionBound
from ariac_score.trial.computed import Computed
from ariac_score.trial.model import Body, Due, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import BoolArray, FloatArray, Span, within_spans
from ariac_score.trial.vectors import lengths
from ariac_score.trial.velocities import HALF_WINDOW_SAMPLES
from ariac_score.trial.vocabulary import DISTANCES, SPEEDS, quantity_of, signal_in_words, subject_of

__all__ = ["Unseen"]

FAR_M = 1e6
"""Stands for a distance that nothing bounds."""

TWICE = 2.0
"""What stands in for a source may have every second of its samples: ours has, of frames for snapshots."""

APPROACHES = ("approach_speed_robot", "approach_speed_human")


# Samples around cells --------------------------------------------------------------------------


Places = NDArray[np.intp]
"""Numbers of samples, shape (n,)."""


@dataclass(frozen=True, eq=False)
class _Sides:
    """For each cell the samples of a stream before and after it.

    Attributes:
        before: Number of the sample before, shape (n,); -1: there is none.
        after: Of the one after; the number of samples: there is none.
        since_s: From the sample before to the end of the cell, s; infinite where there is none.
        until_s: From the beginning of the cell to the sample after, likewise.
        gap_s: From the one sample to the other, likewise.
        open: Whether nothing is known in the cell but these two.
        stream: The samples.
    """

    before: Places
    after: Places
    since_s: FloatArray
    until_s: FloatArray
    gap_s: FloatArray
    open: BoolArray
    stream: Stream

    @classmethod
    def of(cls, stream: Stream, cells: Cells, error_s: float, steps_s: FloatArray | float = 0.0) -> _Sides:
        """The sides of some cells.

        Args:
            stream: The samples.
            cells: Of a competition.
            error_s: How far each stamp may lie from the time it is for, s.
            steps_s: How long it takes from each sample to the next at least, shape (n - 1,), s.
        """
        t = stream.t
        edges = np.concatenate(([-np.inf], t, [np.inf]))
        earliest, latest = _taken(t, steps_s, error_s)
        after = np.searchsorted(t, cells.t, side="right")
        at_sample = (edges[after] == cells.t) & (cells.end - cells.t <= 2 * INSTANT_S)
        is_open = stream.open[after] & ~(at_sample & (error_s == 0.0))
        since_s = np.where(np.isinf(edges[after]), np.inf, cells.end - earliest[after])
        until_s = np.where(np.isinf(edges[after + 1]), np.inf, latest[after + 1] - cells.t)
        gap_s = edges[after + 1] - edges[after]
        for one in stream.signal.disbelieved:
            if one.contested:  # who told the samples around it is one of those who contest each other
                there = is_open & (edges[after] <= one.span.end_s) & (edges[after + 1] >= one.span.start_s)
                gap_s[there] = np.inf
            elif stream.signal.values.ndim > 1:  # somewhere else than it can have been: nothing bounds it
                there = is_open & (cells.t >= one.span.start_s) & (cells.t < one.span.end_s)
            else:
                continue
            since_s[there] = until_s[there] = np.inf
        return cls(after - 1, after, since_s, until_s, gap_s, is_open, stream)

    def values(self, column: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The values before and after each cell; NaN where there is no sample."""
        none = np.full((1, *column.shape[1:]), np.nan)
        padded = np.concatenate([none, column, none])
        return padded[self.before + 1], padded[self.after + 1]


def _taken(t: FloatArray, steps_s: FloatArray | float, error_s: float) -> tuple[FloatArray, FloatArray]:
    """The earliest and the latest moment that each sample can be of, with one before and one after all, s.

    Samples are of their order, and from one to the next the body needs its time. With that in the stamps, the
    nearest samples bound all that any further one does, so that leaving out samples never bounds more.
    """
    if error_s == 0.0 or not len(t):
        edges = np.concatenate(([-np.inf], t, [np.inf]))
        return edges, edges
    # What every sample is later than, seen from the first: a running maximum of stamps less the way so far.
    way_s = np.concatenate(([0.0], np.cumsum(np.broadcast_to(steps_s, len(t) - 1))))
    earliest = np.maximum.accumulate(t - error_s - way_s) + way_s
    latest = np.minimum.accumulate((t + error_s - way_s)[::-1])[::-1] + way_s
    # Samples that no order of stamps fits break a bound, which is refused or remarked on elsewhere.
    fits = earliest <= latest + INSTANT_S
    earliest = np.where(fits, earliest, t - error_s)
    latest = np.where(fits, latest, t + error_s)
    return np.concatenate(([-np.inf], earliest, [np.inf])), np.concatenate(([-np.inf], latest, [np.inf]))


Bounds = tuple[FloatArray, FloatArray]
"""The least and the most of a signal in each cell, shape (n,) each."""

# Bounds of signals -----------------------------------------------------------------------------


@dataclass(eq=False)
class Unseen:
    """What the signals of a trial can have been between their samples.

    Attributes:
        trial: With the bounds of its bodies.
        assumed: Of the time between samples.
        window: The competition.
        max_gap_s: Longest stretch without a sample that the monitor accepts, s.
        remarks: What broke a default bound, so that nothing bounds it there.
    """

    trial: Trial
    assumed: BetweenSamples
    window: Span
    max_gap_s: float
    remarks: dict[str, None] = field(default_factory=dict)
    _streams: dict[str, Stream] = field(default_factory=dict)
    _twins: dict[str, Signal | None] = field(default_factory=dict)
    _stand_ins: dict[tuple[bool, float], Unseen] = field(default_factory=dict)

    # Where a signal is from -------------------------------------------------------------------

    def streams(self, signal: Signal) -> list[Stream]:
        """The recorded streams that a signal follows from; itself where it is recorded."""
        due = self._stands_in_for(signal)
        if due is None:
            return self._own_streams(signal)
        own, held_s = self._as_stand_in(signal)._own_streams(signal), self._held_s(signal)
        return [replace(one, stands_for=due.topic, held_s=held_s) for one in own]

    def _own_streams(self, signal: Signal) -> list[Stream]:
        return [self._stream(one) for one in self._recorded(signal)]

    def all_streams(self, signals: Iterable[Signal]) -> list[Stream]:
        """Those of several signals, each once, with every interval that is open for one of them."""
        found: dict[str, Stream] = {}
        for one in (stream for signal in signals for stream in self.streams(signal)):
            known = found.setdefault(one.signal.name, one)
            if np.count_nonzero(one.open) > np.count_nonzero(known.open):
                found[one.signal.name] = one
        return list(found.values())

    def measured(self, signal: Signal) -> list[FloatArray]:
        """When it was measured, and in its open intervals when what else shows the same was, each s."""
        twin = self._twin(signal)
        if twin is None:
            return [signal.t]
        others = [one.t for one in self._as_stand_in(twin)._own_streams(twin)]
        (own,) = self._own_streams(signal)
        opened = np.concatenate(([0], np.cumsum(own.open)))
        # As far beside an open interval as the two may say the same at different times.
        before_s, behind_s = (own.held_s + one for one in reversed(self._apart_s(signal, twin)))
        first, last = (
            [own.t.searchsorted(t + edge_s, side="right") for t in others] for edge_s in (-before_s, behind_s)
        )
        near = [opened[b + 1] > opened[a] for a, b in zip(first, last, strict=True)]
        return [signal.t, *(t[one] for t, one in zip(others, near, strict=True))]

    def _apart_s(self, signal: Signal, twin: Signal) -> tuple[float, float]:
        """By how much later, and earlier, than the twin a signal may say the same, each s."""
        late_s = max(map(self.error_s, self._recorded(twin)))
        return self.error_s(signal), max(late_s, self.assumed.time_error_s)

    # What else shows the same -----------------------------------------------------------------

    def _stands_in_for(self, signal: Signal) -> Due | None:
        """What would have recorded a signal and is not there; `None`: nothing."""
        return self.trial.stand_ins.get(signal.name) if isinstance(signal, Computed) else None

    def _twin(self, signal: Signal) -> Signal | None:
        """The same as it follows from others, where both say the same; `None`: nothing else shows it."""
        if signal.name not in self._twins:
            twin = None if isinstance(signal, Computed) else self.trial.twins.get(signal.name)
            opened = twin is not None and any(one.open.any() for one in self._own_streams(signal))
            late_s = max(map(self.error_s, (signal, *self._recorded(twin)))) if twin is not None else 0.0
            alike = opened and twin is not None and say_the_same(signal, twin, late_s)
            self._twins[signal.name] = twin if alike else None
        return self._twins[signal.name]

    def _held_s(self, signal: Signal) -> float:
        """How long a sample stands at most of what something stands in for, s."""
        due = self._stands_in_for(signal)
        if due is None:
            return self._stream(self.trial.signals[signal.name]).held_s
        return 0.0 if self.assumed.every else longest_held_s(1.0 / due.rate_hz, self.max_gap_s)

    def _as_stand_in(self, signal: Signal) -> Unseen:
        """How to ask what stands in for a source: it may have gone anywhere between its own samples.

        Where nothing bounds how a speed changes, it is believed of samples that come half as often as those
        that it stands in for, or more often.
        """
        motion = self.motion(signal.name) or []
        driven = all(math.isfinite(one.max_acceleration_m_s2) for one in motion)
        every = self.assumed.every or quantity_of(signal.name) in DISTANCES or driven
        max_gap_s = min(self.max_gap_s, TWICE * self._held_s(signal)) if not every else self.max_gap_s
        if (every, max_gap_s) not in self._stand_ins:
            assumed = replace(self.assumed, every=every)
            self._stand_ins[every, max_gap_s] = Unseen(self.trial, assumed, self.window, max_gap_s)
        return self._stand_ins[every, max_gap_s]

    def _standing_in(self, signal: Signal, cells: Cells) -> tuple[FloatArray, FloatArray] | None:
        """The least and the most of what stands in for a source, as far as the two may differ."""
        asked = self._as_stand_in(signal)
        found, apart = asked._own_bounds(signal, cells), ALIKE.get(quantity_of(signal.name))
        if found is None or apart is None:
            return found
        least, most = found
        if self._may_be_another(signal):
            return np.zeros(len(least)), np.full(len(most), self.rate_m_s(signal))
        if quantity_of(signal.name) in SPEEDS and not asked.assumed.every:
            for one in asked._own_streams(signal):
                slowest, fastest = by_intervals(one, cells)
                least, most = np.fmin(least, slowest), np.fmax(most, fastest)
        return np.maximum(least - apart, 0.0), most + apart

    def _may_be_another(self, signal: Signal) -> bool:
        """Whether what stands in may be of a point that rests while others move: the base of an arm."""
        is_speed = quantity_of(signal.name) in SPEEDS
        return is_speed and self._stands_in_for(signal) is not None and never_moved(self._recorded(signal))

    def _stream(self, signal: Signal) -> Stream:
        if signal.name not in self._streams:
            self._streams[signal.name] = Stream.of(
                signal,
                self.window,
                self.max_gap_s,
                self.assumed,
                started=self.trial.started_s is not None,
                ended=self.trial.ended_s is not None,
            )
            for one in signal.disbelieved:
                if one.span.end_s >= self.window.start_s and one.span.start_s <= self.window.end_s:
                    words = f"the {signal_in_words(signal.name)} "
                    words += (
                        f"is told in two ways from {one.at_s:.3f} s on, and nothing says which is right"
                        if one.contested
                        else f"jumps at {one.at_s:.3f} s faster than anything moves, and may be right"
                    )
                    self.remarks[words] = None
                    break
        return self._streams[signal.name]

    def error_s(self, signal: Signal) -> float:
        """By how much the stamps of a recorded signal may be wrong, s: times of arrival jitter."""
        return max(self.assumed.time_error_s, signal.stamp_jitter_s)

    def _recorded(self, signal: Signal) -> list[Signal]:
        if not isinstance(signal, Computed):
            return [signal]
        found = []
        for body in self.bodies(signal.name):
            for point in _points(body, whole=quantity_of(signal.name) in SPEEDS):
                for quantity in ("velocity", "position"):
                    one = self.trial.signals.get(f"{quantity}/{point}")
                    if one is not None and not isinstance(one, Computed):
                        found.append(one)
                        if quantity_of(signal.name) in SPEEDS:
                            break
        return found or [signal]

    def bodies(self, name: str) -> list[Body]:
        """The bodies that a signal is about."""
        known = {body.id: body for body in self.trial.bodies}
        ids = [part.partition("::")[0] for part in subject_of(name).split("/")]
        return [known[one] for one in ids if one in known]

    def motion(self, name: str) -> list[MotionBound] | None:
        """The bounds of the bodies that a signal is about; `None` where one of them has none."""
        bodies = self.bodies(name)
        bounds = [self.assumed.of(body.kind) for body in bodies]
        known = [one for one in bounds if one is not None]
        return known if len(known) == len(subject_of(name).split("/")) else None

    # What it can have been --------------------------------------------------------------------

    def rate_m_s(self, signal: Signal) -> float:
        """How fast the bodies of a signal can move together, m/s; infinite where nobody knows."""
        motion = self.motion(signal.name)
        return math.inf if motion is None else sum(one.max_speed_m_s for one in motion)

    def bounds(self, signals: Sequence[Signal], cells: Cells) -> list[Bounds | None]:
        """The least and the most of some signals in each cell; `None` of one that nothing bounds.

        Where they are measured both are the value at the beginning of the cell, which stands until the next.
        Where one is not, what is missing of it would have stood for a while, and the others until then.
        """
        found, streams = [self._at_instants(one, cells) for one in signals], self.all_streams(signals)
        held_s = max((one.held_s for one in streams), default=0.0)
        if held_s <= 0.0:
            return found
        found = [one and _with_told(one, signal, cells) for signal, one in zip(signals, found, strict=True)]
        late_s, early_s = max(self.error_s(one.signal) for one in streams), self.assumed.time_error_s
        is_open = np.any([one.may_lack(cells) for one in streams], axis=0)
        error_m = self.assumed.distance_error_m
        filled = np.any([one[0] != one[1] for one in found if one is not None], axis=0)
        for k, (signal, one) in enumerate(zip(signals, found, strict=True)):
            if one is not None and error_m and quantity_of(signal.name) in DISTANCES:
                known = filled & (one[0] == one[1])  # of what is open that is said already
                found[k] = one[0] - np.where(known, error_m, 0.0), one[1] + np.where(known, error_m, 0.0)
        return [one and standing(*one, cells, is_open, held_s + late_s, early_s) for one in found]

    def _at_instants(self, signal: Signal, cells: Cells) -> Bounds | None:
        """The same of a signal itself; where it is recorded and open, what else shows it bounds it, too."""
        if self._stands_in_for(signal):
            found = self._standing_in(signal, cells)
            self.remarks.update(self._as_stand_in(signal).remarks)
            return found
        found, twin = self._own_bounds(signal, cells), self._twin(signal)
        if found is None or twin is None:
            return found
        both = self._standing_in(twin, cells)
        if both is None:
            return found
        # What the one says at an instant the other may say as much later, or earlier, as stamps are wrong.
        everywhere = np.ones(len(cells.t), dtype=bool)
        if not self.assumed.every:
            both = standing(*both, cells, everywhere, *self._apart_s(signal, twin))
        least, most = found
        low, high = np.maximum(least, both[0]), np.minimum(most, both[1])
        # Where its own samples are not believed, or known to be lost, another source settles nothing.
        doubted = [*signal.holes, *(one.span for one in signal.disbelieved)]
        agree = (least < most) & (low <= high) & ~within_spans((cells.t + cells.end) / 2.0, doubted)
        return np.where(agree, low, least), np.where(agree, high, most)

    def _own_bounds(self, signal: Signal, cells: Cells) -> tuple[FloatArray, FloatArray] | None:
        quantity, motion = quantity_of(signal.name), self.motion(signal.name)
        if motion is None or not (len(signal) or isinstance(signal, Computed)):
            return None
        sides = [
            _Sides.of(stream, cells, self.error_s(stream.signal)) for stream in self._own_streams(signal)
        ]
        is_open = np.any([one.open for one in sides], axis=0)
        if isinstance(signal, Computed):
            is_open |= self._is_apart(signal, cells)
            if quantity not in DISTANCES:
                # A place is known at its sample; how fast the body was there is not, where it follows from
                # places of which some lie in an open interval.
                for one in sides:
                    if quantity_of(one.stream.signal.name) == "position":
                        is_open |= one.stream.is_open(cells, HALF_WINDOW_SAMPLES)
        total = sum(one.max_speed_m_s for one in motion)
        if quantity in DISTANCES:
            found = self._distance(signal, cells, sides, total)
        elif quantity in SPEEDS:
            found = self._speed(signal, cells, sides, motion[0])
        elif quantity in APPROACHES:
            fastest = motion[quantity == APPROACHES[1]].max_speed_m_s
            found = np.full(len(cells.t), -fastest), np.full(len(cells.t), fastest)
        elif quantity == "relative_speed":
            found = np.zeros(len(cells.t)), np.full(len(cells.t), total)
        else:
            return None
        held = signal.at(cells.t) if len(signal) else np.zeros(len(cells.t))
        least, most = (np.where(is_open, one, held) for one in found)
        return least, most

    def _is_apart(self, signal: Signal, cells: Cells) -> BoolArray:
        """Whether the samples of a signal that follows from others are too far apart around each cell."""
        if signal.constant:
            return np.zeros(len(cells.t), dtype=bool)
        edges = np.concatenate(([self.window.start_s], signal.t, [self.window.end_s]))
        after = np.searchsorted(signal.t, cells.t, side="right")
        at_sample = (after > 0) & (edges[after] == cells.t) & (cells.end - cells.t <= 2 * INSTANT_S)
        lasts_s: FloatArray = edges[after + 1] - edges[after]
        apart: BoolArray = (lasts_s > self.max_gap_s + TOLERANCE_S) & ~at_sample
        return apart

    def _distance(
        self, signal: Signal, cells: Cells, sides: Sequence[_Sides], rate: float
    ) -> tuple[FloatArray, FloatArray]:
        error_m = self.assumed.distance_error_m
        if isinstance(signal, Computed) and (apart := self._of_places(signal, cells)) is not None:
            least, most = apart
        else:
            (only,) = sides[:1]
            low, high = _by_all_samples(signal, rate, self.error_s(signal), error_m)
            (least, _), (_, most) = (
                between(*only.values(one), only.since_s, only.until_s, rate) for one in (low, high)
            )
            self._refuse_no_path(signal.name, cells, least, most, only.open, error_m)
        unbounded = (least > most + 2 * error_m + 1e-9) | ~np.isfinite(most)
        least = np.where(unbounded, 0.0, np.maximum(least - error_m, 0.0))
        most = np.where(unbounded, FAR_M, most + error_m)
        for one in signal.disbelieved:
            there = (cells.t >= one.span.start_s) & (cells.t < one.span.end_s)
            least = np.where(there, np.minimum(least, one.least), least)
            most = np.where(there, np.maximum(most, one.most), most)
        return least, most

    def _refuse_no_path(
        self, name: str, cells: Cells, least: FloatArray, most: FloatArray, where: BoolArray, error_m: float
    ) -> None:
        broken = np.flatnonzero(where & (least > most + 2 * error_m + 1e-9))
        if len(broken):
            speeds = " and ".join(
                f"{one.max_speed_m_s:g} m/s of {body.id!r}"
                for body, one in zip(self.bodies(name), self.motion(name) or (), strict=False)
            )
            self.remarks[f"at {cells.t[broken[0]]:.3f} s faster than the default bound, {speeds}"] = None

    def _of_places(self, signal: Signal, cells: Cells) -> tuple[FloatArray, FloatArray] | None:
        """From where the nearest points of two bodies can be; `None` where a place is not recorded."""
        first, second = self.bodies(signal.name)
        components = 2 if quantity_of(signal.name) == "centre_distance_2d" else 3
        places = [self._places(body, cells, components) for body in (first, second)]
        if places[0] is None or places[1] is None:
            return None
        least, most = np.full(len(cells.t), np.inf), np.full(len(cells.t), np.inf)
        for one in places[0]:
            for other in places[1]:
                low, high = places_apart(one, other)
                least, most = np.minimum(least, low), np.minimum(most, high)
        if quantity_of(signal.name) in ("separation", "body_separation"):
            radii = (first.radius_m or 0.0) + (second.radius_m or 0.0)
            least, most = np.maximum(least - radii, 0.0), np.maximum(most - radii, 0.0)
        return least, most

    def _places(self, body: Body, cells: Cells, components: int) -> list[Place] | None:
        """Where each point of a body can be in each cell."""
        motion = self.assumed.of(body.kind)
        found: list[Place] = []
        for point in _points(body):
            position = self.trial.signals.get(f"position/{point}")
            if position is None or motion is None or not len(position):
                return None
            stream = self._stream(position)
            values = position.values[:, :components]
            sides = _Sides.of(stream, cells, self.error_s(position), self._steps_s(position, motion))
            before, after = sides.values(values)
            held = position.at(cells.t)[:, :components]
            since_m, until_m = (reach(motion.max_speed_m_s, one) for one in (sides.since_s, sides.until_s))
            known = ~sides.open
            before = np.where((known | np.isinf(since_m))[:, None], held, before)
            after = np.where((known | np.isinf(until_m))[:, None], held, after)
            since_m, until_m = np.where(known, 0.0, since_m), np.where(known, 0.0, until_m)
            step = lengths(after - before)
            broken = np.flatnonzero(sides.open & (step > since_m + until_m + 1e-9))
            if len(broken):
                self.remarks[
                    f"{point!r} at {cells.t[broken[0]]:.3f} s faster than the default bound of "
                    f"{motion.max_speed_m_s:g} m/s"
                ] = None
                since_m[broken], until_m[broken] = np.inf, np.inf
            place = Place(before, after, since_m, until_m)
            if 0.0 < motion.max_acceleration_m_s2 < math.inf:
                stamped = _Sides.of(stream, cells, self.error_s(position))
                place = _near_chord(place, stamped, cells, motion, self.error_s(position))
                if self.error_s(position) == 0.0:  # how long it took is known
                    speeds = self._speeds_at(stream.t, point, motion)
                    place = _driven(place, stamped, cells, motion, stamped.values(speeds))
            found.append(place)
        return found

    def _speeds_at(self, t: FloatArray, point: str, motion: MotionBound) -> FloatArray:
        """How fast a point was at some times at most, shape (n,), m/s: as recorded then, or as it can be."""
        found = np.full(len(t), motion.max_speed_m_s)
        for quantity in ("velocity", "speed"):
            signal = self.trial.signals.get(f"{quantity}/{point}")
            if signal is not None and not isinstance(signal, Computed) and len(signal):
                speeds = signal.values if signal.values.ndim == 1 else lengths(signal.values)
                row = np.minimum(signal.t.searchsorted(t), len(signal) - 1)
                found = np.where(signal.t[row] == t, np.minimum(found, speeds[row]), found)
        return found

    def _steps_s(self, position: Signal, motion: MotionBound) -> FloatArray:
        """How long a point takes from each of its places to the next at least, shape (n - 1,), s."""
        way_m = np.maximum(lengths(np.diff(position.values, axis=0)) - 2.0 * self.assumed.distance_error_m, 0)
        if motion.max_speed_m_s <= 0.0:
            return np.zeros(len(way_m))
        return np.asarray(way_m / motion.max_speed_m_s, dtype=np.float64)

    def _speed(
        self, signal: Signal, cells: Cells, sides: Sequence[_Sides], motion: MotionBound
    ) -> tuple[FloatArray, FloatArray]:
        top, change = motion.max_speed_m_s, motion.max_acceleration_m_s2
        least, most = np.zeros(len(sides[0].open)), np.zeros(len(sides[0].open))
        for one, recorded in zip(sides, self._recorded(signal), strict=True):
            if quantity_of(recorded.name) == "position":
                low, high = _speed_of_places(recorded, one, motion, self.error_s(recorded))
            else:
                values = recorded.values
                column = lengths(values) if values.ndim > 1 else values
                before, after = one.values(column)
                high = highest_speed(before, after, one.since_s, one.until_s, speed=top, acceleration=change)
                low = lowest_speed(before, after, one.since_s, one.until_s, acceleration=change)
                # A sample above a default bound: no less than that sample bounds it.
                fastest = np.fmax(np.fmax(before, after), top)
                high = np.where(fastest > top, fastest, high)
                for other in recorded.disbelieved:
                    there = one.open & (cells.t >= other.span.start_s) & (cells.t < other.span.end_s)
                    high = np.where(there & np.isfinite(other.most), np.maximum(high, other.most), high)
                if (one.open & (fastest > top * (1 + 1e-9))).any():
                    whose = signal_in_words(recorded.name)
                    self.remarks[f"the {whose} is above the default bound of {top:g} m/s"] = None
            least, most = np.maximum(least, np.minimum(low, high)), np.maximum(most, high)
        return least, most


def _with_told(bounds: Bounds, signal: Signal, cells: Cells) -> Bounds:
    """The bounds, and at its samples what these say: it stands for a while though their stamps are wrong."""
    rows = np.flatnonzero(cells.instants & np.isin(cells.t, signal.t)) if len(signal) else np.zeros(0, int)
    least, most = (one.copy() for one in bounds)
    told = signal.at(cells.t[rows])
    least[rows], most[rows] = np.minimum(least[rows], told), np.maximum(most[rows], told)
    return least, most


def _by_all_samples(
    distance: Signal, rate: float, error_s: float, error_m: float
) -> tuple[FloatArray, FloatArray]:
    """What each sample and all others say of the least and the most at its time, errors apart.

    With right stamps a sample says more than all others. With wrong ones another may say more, and who left
    out the nearest would otherwise bring that to light. Samples that contradict each other stand for
    themselves.
    """
    t, values = distance.t, distance.values
    if error_s == 0.0 and error_m == 0.0:
        return values, values
    falling, rising = values - rate * t, values + rate * t
    low = np.maximum(
        np.maximum.accumulate(rising) - rate * t, np.maximum.accumulate(falling[::-1])[::-1] + rate * t
    )
    high = np.minimum(
        np.minimum.accumulate(falling) + rate * t, np.minimum.accumulate(rising[::-1])[::-1] - rate * t
    )
    agree = low - high <= 2.0 * (error_m + rate * error_s) + 1e-9
    return np.where(agree, low, values), np.where(agree, high, values)


def _speed_of_places(
    position: Signal, sides: _Sides, motion: MotionBound, error_s: float
) -> tuple[FloatArray, FloatArray]:
    """The least and the most speed in each cell: as far from the mean one of its interval as it can change.

    The interval itself may be longer or shorter by what its stamps are wrong, and the cell beside it.
    """
    before, after = sides.values(position.values)
    top, change = motion.max_speed_m_s, motion.max_acceleration_m_s2
    way_m = lengths(after - before)
    shortest_s, longest_s = np.maximum(sides.gap_s - 2.0 * error_s, 0.0), sides.gap_s + 2.0 * error_s
    with np.errstate(invalid="ignore", divide="ignore"):
        ends = [(way_m / lasts_s, change * (lasts_s / 2.0 + error_s)) for lasts_s in (shortest_s, longest_s)]
        high = np.maximum(*(mean + swing for mean, swing in ends))
        low = ends[1][0] - ends[1][1]
    high = np.where(np.isfinite(high), np.minimum(high, top), top)
    return np.where(np.isfinite(low), np.maximum(low, 0.0), 0.0), high


def _near_chord(place: Place, sides: _Sides, cells: Cells, motion: MotionBound, error_s: float) -> Place:
    """The place, and how far from the straight way between both samples the point can be in each cell."""
    known = sides.open & np.isfinite(place.since_m) & np.isfinite(place.until_m)
    since_s, until_s, gap_s = (
        np.where(known, one, 1.0) for one in (sides.since_s, sides.until_s, sides.gap_s)
    )
    half_s, step = (cells.end - cells.t) / 2.0, place.after - place.before
    # Stamps that are wrong by so much move the chord no further than the body itself moves meanwhile.
    radius_m = off_the_chord(since_s, until_s, motion.max_acceleration_m_s2) + motion.max_speed_m_s * error_s
    radius_m += lengths(step) * half_s / gap_s
    share = (since_s - error_s - half_s) / gap_s
    chord = place.before + step * np.where(known, share, 0.0)[:, None]
    return replace(place, chord=chord, chord_m=np.where(known, radius_m, np.inf))


def _driven(
    place: Place, sides: _Sides, cells: Cells, motion: MotionBound, speeds: tuple[FloatArray, FloatArray]
) -> Place:
    """The place, and how the point can move between both samples."""
    known = sides.open & np.isfinite(place.since_m) & np.isfinite(place.until_m)
    half_s = (cells.end - cells.t) / 2.0
    since_s, until_s = (np.where(known, one - half_s, 1.0) for one in (sides.since_s, sides.until_s))
    before_m_s, after_m_s = (np.where(known, one, motion.max_speed_m_s) for one in speeds)
    drive = Drive(since_s, until_s, motion.max_speed_m_s, motion.max_acceleration_m_s2, before_m_s, after_m_s)
    return replace(place, drive=drive, driven=known, off_m=motion.max_speed_m_s * half_s)


def _points(body: Body, *, whole: bool = False) -> list[str]:
    """The tracks that stand for a body: its links, or its origin; for its speed both."""
    links = [f"{body.id}::{link}" for link in body.links]
    return [body.id, *links] if whole else links or [body.id]
