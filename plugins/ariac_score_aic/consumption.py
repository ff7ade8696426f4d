"""What the scorer takes of a recording: the series that it makes while reading, and places at given times."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from ariac_score import FloatArray, Record, Trial
from ariac_score_aic.chains import (
    Feed,
    Poses,
    asks_for_latest,
    at_every_stamp,
    distinct,
    final_buffer,
    lengths_m,
    poses_while_reading,
    stamps_asked,
    taken,
    with_link,
)
from ariac_score_aic.jerk import MeanJerk, jerk_of_velocities
from ariac_score_aic.messages import (
    SCORING_STATIC,
    SCORING_TF,
    TF,
    TF_STATIC,
    AicMessages,
    IntArray,
    Transforms,
    Wrenches,
    seconds_of,
)
from ariac_score_aic.run_config import Connection
from ariac_score_aic.task_times import TaskTimes
from ariac_score_aic.time_bounds import Between, TimeBounds, bounds_of, span_ns
from ariac_score_aic.transforms import TransformBuffer

__all__ = ["Consumed", "Consumption", "Plug", "consumed_of"]

_MARGIN_S = 5.0
"""By so much the buffer outlasts the longest time limit. Source: `aic_engine.cpp`, 1318 (PR 218)."""

_DRAWN_NS = 20_000_000
"""Places that no score rests on are looked up so often."""
_MOST_MOMENTS = 200
"""At so many moments it is looked where a plug can have been when the task began or ended."""

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Consumption:
    """How one state of the scorer takes what is recorded; see `Aic` for what each means."""

    gripper_frame: str
    reference_frame: str
    tool_reference_frame: str
    board_is_static: bool
    poses_while_reading: bool
    ends_at_end: bool
    start_distance: str
    lookups_reversed: bool
    wrench_topic: str
    tare: bool
    scoring_static: bool
    both_ends: bool


@dataclass(frozen=True)
class Plug:
    """Where a plug, its port and the port's entrance are, m, in one frame; `None`: not had.

    `turn_rad` is by how much the plug is turned against its port, where that is looked at.
    """

    plug_m: Vector | None
    port_m: Vector | None
    entrance_m: Vector | None
    turn_rad: float = 0.0

    @property
    def distance_m(self) -> float | None:
        """From the plug to the port; `None` where one of the two is not had."""
        return None if self.plug_m is None or self.port_m is None else _distance_m(self.plug_m, self.port_m)


def _distance_m(a: Vector, b: Vector) -> float:
    x, y, z = (p - q for p, q in zip(a, b, strict=True))
    return float(np.sqrt(x * x + y * y + z * z))


@dataclass(frozen=True, eq=False)
class Consumed(Record):
    """A recording as one state of the scorer took it; its series are computed when first asked for.

    Attributes:
        messages: The recording.
        how: The state of the scorer.
        connections: What was to be connected; empty where no configuration says it.
        times: What is known of the times of the task.
        longest_limit_s: The longest time limit of the run, s.
        trial_id: Of the trial.
        later_s: By how much times of the trial are later than those since the recording began, s.
        by_engine: Whether the engine made the recording, by its name.
    """

    timed: ClassVar[bool] = False

    messages: AicMessages
    how: Consumption
    connections: tuple[Connection, ...]
    times: TaskTimes
    longest_limit_s: float
    trial_id: str
    later_s: float = 0.0
    by_engine: bool = True

    def shifted(self, by_s: float) -> Consumed:
        """The same recording in a trial whose times are later."""
        return replace(self, later_s=self.later_s + by_s)

    @cached_property
    def feed(self) -> Feed:
        """How its transforms are taken."""
        part = "task_board" if self.how.board_is_static else ""
        static = (SCORING_STATIC,) if self.how.scoring_static else ()
        fixed = () if self.how.both_ends else (TF_STATIC,)  # phase 1 hears its own topic alone
        buffer_ns = round((self.longest_limit_s + _MARGIN_S) * 1e9)
        return Feed(buffer_ns, part, (TF, *fixed, SCORING_TF, *static))

    @cached_property
    def bounds(self) -> TimeBounds:
        """Between which times the task began and ended, stated or not."""
        return bounds_of(self.messages, self.times, by_engine=self.by_engine)

    @cached_property
    def cable(self) -> str:
        """The cable that counts where both ends do: the first that was activated; empty without any."""
        texts = self.messages.activated.texts
        return texts[0].decode("utf-8", "replace") if texts else ""

    def frames_of(self, connection: Connection) -> tuple[str, str, str]:
        """The names of the frames of plug, port and entrance."""
        cable = self.cable if self.how.both_ends else connection.cable_name
        board = "" if self.how.both_ends else "task_board/"
        port = f"{board}{connection.target_module_name}/{connection.port_name}_link"
        return f"{cable}/{connection.plug_name}_link", port, f"{port}_entrance"

    @cached_property
    def buffer(self) -> TransformBuffer:
        """The transforms after all is read."""
        wanted = [name for connection in self.connections for name in self.frames_of(connection)]
        how = self.how
        names = (*wanted, how.gripper_frame, how.reference_frame, how.tool_reference_frame, "world")
        return final_buffer(self.linked, self.feed, names)

    @cached_property
    def sound(self) -> Transforms:
        """The transforms of the recording that tf2 takes."""
        return taken(self.messages.transforms, self.feed)

    @cached_property
    def linked(self) -> Transforms:
        """The same, with the link of the world that is added when all is read."""
        return self.sound if self.how.both_ends else with_link(self.sound, "world", self.how.reference_frame)

    @cached_property
    def asked_ns(self) -> IntArray:
        """The stamps of the moving tf topics."""
        return stamps_asked(self.messages.transforms, self.feed)

    @cached_property
    def asks_for_latest(self) -> bool:
        """Whether a transform of a moving tf topic is stamped 0."""
        return asks_for_latest(self.messages.transforms, self.feed)

    @cached_property
    def poses(self) -> Poses:
        """The poses of the gripper in the order in which they were appended."""
        target, source = self.how.tool_reference_frame, self.how.gripper_frame
        if self.how.poses_while_reading:
            return poses_while_reading(self.messages.transforms, self.sound, self.feed, target, source)
        if self.how.lookups_reversed:
            target, source = source, target
        found = at_every_stamp(self.asked_ns, self.linked, self.buffer, self.feed, target, source)
        latest = self.buffer.lookup(target, source) if self.asks_for_latest else None
        if latest is None:
            return found
        return Poses(
            np.concatenate([[latest.stamp_ns], found.stamp_ns]),
            np.concatenate([[latest.position_m], found.position_m]),
        )

    @cached_property
    def poses_after(self) -> Poses:
        """The poses of the gripper at every stamp of the tf topics, asked for when all is read."""
        return self._places_of(self.how.gripper_frame, self.asked_ns)

    def places_of(self, frame: str) -> Poses:
        """Where a frame is in the reference frame, 50 times a second: for what is drawn and watched."""
        bins = self.asked_ns // _DRAWN_NS
        return self._places_of(frame, self.asked_ns[np.diff(bins, prepend=-1) > 0])

    def _places_of(self, frame: str, at_ns: IntArray) -> Poses:
        target = self.how.reference_frame
        return at_every_stamp(at_ns, self.linked, self.buffer, self.feed, target, frame)

    @cached_property
    def span_ns(self) -> Between:
        """The first and the last header stamp of what is sent all the time."""
        return span_ns(self.messages)

    def with_task(self, span_ns: Between) -> Between:
        """A stretch of the recording, and all of the task where a file states when that was."""
        begin_ns, end_ns = span_ns
        start_ns, done_ns = self.times.start_ns, self.times.end_ns
        if start_ns is not None and start_ns <= end_ns:  # else it is on another clock
            begin_ns = min(begin_ns, start_ns)
        if done_ns is not None and done_ns >= span_ns[0]:
            end_ns = max(end_ns, done_ns)
        return begin_ns, end_ns

    @cached_property
    def path_length_m(self) -> float:
        """The sum of the distances of neighbouring poses, one after the other."""
        steps = lengths_m(self.poses.position_m)
        return float(np.cumsum(steps)[-1]) if len(steps) else 0.0

    @cached_property
    def velocities(self) -> tuple[FloatArray, FloatArray]:
        """The tool's velocities, those of repeated stamps once: s, shape (n,), and m/s, shape (n, 3)."""
        states = self.messages.controller
        # As the scorer has them: its forces have stamps of another rounding.
        t_s = seconds_of(states.stamp_ns)
        kept = np.concatenate(([True], np.diff(t_s) != 0))[: len(t_s)]
        return t_s[kept], states.velocity_m_s[kept]

    def jerk(self, window: int, gate_m_s: float) -> MeanJerk:
        """The tool's mean jerk by its velocities, worked out once for each window and gate."""
        if (window, gate_m_s) not in self._jerks:
            found = jerk_of_velocities(*self.velocities, window=window, gate_m_s=gate_m_s)
            self._jerks[window, gate_m_s] = found
        return self._jerks[window, gate_m_s]

    @cached_property
    def _jerks(self) -> dict[tuple[int, float], MeanJerk]:
        return {}

    @cached_property
    def forces(self) -> tuple[IntArray, FloatArray]:
        """The forces that count: stamps in ns, shape (n,), and N, shape (n, 3)."""
        raw = self.messages.wrenches.get(self.how.wrench_topic, Wrenches())
        if not self.how.tare:
            return raw.stamp_ns, raw.force_n
        states = self.messages.controller
        before = np.searchsorted(states.order, raw.order, side="right") - 1
        had = before >= 0
        return raw.stamp_ns[had], raw.force_n[had] - states.offset_n[before[had]]

    def plug_at(self, connection: Connection, stamp_ns: int) -> Plug:
        """Where the plug and its port are at a time, 0 for the latest."""
        plug, port, entrance = (self._position(name, stamp_ns) for name in self.frames_of(connection))
        return Plug(plug, port, entrance)

    def _position(self, frame: str, stamp_ns: int) -> Vector | None:
        target, source = self.how.reference_frame, frame
        if self.how.lookups_reversed:  # until PR 234 it took the reference in the frame for the opposite
            target, source = source, target
        found = self.buffer.lookup(target, source, stamp_ns)
        return None if found is None else found.position_m

    def stamps_between(self, between: Between) -> list[int]:
        """The moments of a stretch at which transforms were stamped, with its ends; some of too many."""
        first_ns, last_ns = between
        stamps = distinct(self.messages.transforms.stamp_ns)
        inside = stamps[(stamps > first_ns) & (stamps < last_ns)]
        step = max(len(inside) // _MOST_MOMENTS, 1)
        return sorted({first_ns, *inside[::step].tolist(), last_ns})

    def first_distance_m(self, connection: Connection) -> float | None:
        """The distance from plug to port at the first stamp of a moving tf topic; `None`: not had."""
        if not (self.asks_for_latest or len(self.asked_ns)):
            return None
        first_ns = 0 if self.asks_for_latest else int(self.asked_ns[0])
        return self.plug_at(connection, first_ns).distance_m

    def trial_s(self, stamps_ns: Iterable[int]) -> list[float] | None:
        """Header stamps as times of the trial; `None` where one lies outside what was recorded."""
        recorded, stamps = self.messages.recorded_ns, list(stamps_ns)
        if recorded is None or not stamps or min(stamps) < recorded[0] or max(stamps) > recorded[1]:
            return None
        return [(stamp - recorded[0]) / 1e9 + self.later_s for stamp in stamps]


def consumed_of(trial: Trial) -> Consumed | None:
    """What the scorer took of the recording of a trial; `None` without one."""
    return next((record for record in trial.records if isinstance(record, Consumed)), None)
