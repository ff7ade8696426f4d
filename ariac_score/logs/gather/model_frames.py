"""Poses of models and links, from messages that list all of them, for whom they mean more than motion."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ariac_score.checks.contracts import TrackReader
from ariac_score.logs.containers.items import IntArray
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.tracks import ModelTrack
from ariac_score.trial.work import Record

__all__ = ["ModelFrames"]

KEPT_EVERY_S = 0.05
"""The shortest time between two messages that are kept: simulators publish what lies where at 20 Hz."""


@dataclass
class _Poses:
    """The poses of one model or link so far."""

    frames: array[int] = field(default_factory=lambda: array("q"))
    numbers: array[float] = field(default_factory=lambda: array("d"))

    def track(self, name: str, frame_count: int) -> ModelTrack:
        """Its track; it is gone where the next frame does not list it, for every frame lists all models."""
        frames = np.array(self.frames, dtype=np.int64)
        after = frames + 1
        gone = after[~np.isin(after, frames) & (after < frame_count)]
        return ModelTrack(name, frames, np.array(self.numbers, dtype=np.float64).reshape(-1, 7), gone)


class ModelFrames:
    """Collects `gazebo_msgs/ModelStates` or `LinkStates`: poses of what is followed.

    Args:
        reader: Says which models matter, and what their poses mean.
    """

    def __init__(self, reader: TrackReader) -> None:
        self._reader = reader
        self._stamps_ns: list[int] = []
        self._columns: dict[str, _Poses | None] = {}

    def add(self, message: Any, stamp_ns: int) -> None:
        """Take one message, unless one was kept just before it."""
        if self._stamps_ns and 0 <= stamp_ns - self._stamps_ns[-1] < KEPT_EVERY_S * 1e9:
            return
        for name, pose in zip(message.name, message.pose, strict=True):
            # `None` for names that do not matter: patterns are matched once for each name.
            if name not in self._columns:
                self._columns[name] = _Poses() if self._reader.follows(name) else None
            column = self._columns[name]
            if column is not None:
                at, turn = pose.position, pose.orientation
                column.frames.append(len(self._stamps_ns))
                column.numbers.extend((at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z))
        self._stamps_ns.append(stamp_ns)

    def add_many(
        self, names: Sequence[str], found: IntArray, rows: FloatArray, counts: IntArray, stamps_ns: IntArray
    ) -> None:
        """Take many messages, in recorded order.

        Args:
            names: Names of models or links.
            found: Which name each state has, message after message, shape (n,).
            rows: Its position x, y, z and quaternion w, x, y, z, shape (n, 7).
            counts: How many states each message has, shape (m,).
            stamps_ns: The time of each message, ns, shape (m,).
        """
        kept, first = [], len(self._stamps_ns)
        # A loop: whether a message is kept depends on which one before it was.
        for number, stamp_ns in enumerate(stamps_ns.tolist()):
            if not self._stamps_ns or not 0 <= stamp_ns - self._stamps_ns[-1] < KEPT_EVERY_S * 1e9:
                kept.append(number)
                self._stamps_ns.append(stamp_ns)
        frames = np.full(len(counts), -1, dtype=np.int64)
        frames[kept] = np.arange(first, first + len(kept))
        frame = np.repeat(frames, counts)
        there = frame >= 0
        frame, found, rows = frame[there], found[there], rows[there]
        for code in np.unique(found).tolist():
            name = names[code]
            if name not in self._columns:
                self._columns[name] = _Poses() if self._reader.follows(name) else None
            column = self._columns[name]
            if column is not None:
                own = found == code
                column.frames.frombytes(frame[own].tobytes())
                column.numbers.frombytes(rows[own].tobytes())

    def retime(self, retimed: Callable[[IntArray], IntArray]) -> None:
        """Put all stamps on another clock."""
        self._stamps_ns = retimed(np.array(self._stamps_ns, dtype=np.int64)).tolist()

    def record(self, origin_ns: int) -> Record | None:
        """What the messages show; `None` without messages."""
        if not self._stamps_ns:
            return None
        t_s = np.array([(stamp_ns - origin_ns) / 1e9 for stamp_ns in self._stamps_ns])
        count = len(self._stamps_ns)
        tracks = [c.track(name, count) for name, c in self._columns.items() if c is not None]
        return self._reader.record(t_s, tracks, pauses=False, until_s=math.inf)
