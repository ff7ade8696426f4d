"""A slow, literal buffer of transforms, written from the behaviour of tf2 and from nothing of the plugin.

One list of samples for each frame, newest first; every lookup walks the tree and multiplies 4 x 4 matrices.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isnan
from typing import Any

import numpy as np

Matrix = np.ndarray[Any, np.dtype[np.float64]]


@dataclass
class Sample:
    stamp: int
    parent: str
    at: tuple[float, ...]
    turn: tuple[float, ...]  # x, y, z, w


@dataclass
class Tf2:
    """What arrived so far."""

    memory_ns: int
    still: dict[str, Sample] = field(default_factory=dict)
    moving: dict[str, list[Sample]] = field(default_factory=dict)

    def insert(self, child: str, sample: Sample, *, static: bool) -> None:
        numbers = (*sample.at, *sample.turn)
        norm = sum(q * q for q in sample.turn)
        if not child or not sample.parent or child == sample.parent:
            return
        if any(map(isnan, numbers)) or not abs(norm - 1) < 0.01:
            return
        # A matrix is made of what is taken, and a quaternion of that, whose norm is 1.
        sample = Sample(sample.stamp, sample.parent, sample.at, tuple(q / norm**0.5 for q in sample.turn))
        if static:
            self.moving.pop(child, None)
            self.still[child] = sample
            return
        self.still.pop(child, None)
        history = self.moving.setdefault(child, [])
        if history:
            oldest = history[0].stamp - self.memory_ns
            while history and history[-1].stamp < oldest:
                history.pop()
            if sample.stamp < oldest:
                return
        place = 0
        while place < len(history) and history[place].stamp > sample.stamp:
            place += 1
        if any(known == sample for known in history[place:] if known.stamp == sample.stamp):
            return
        history.insert(place, sample)

    def of(self, child: str, stamp: int) -> tuple[str, Matrix] | None:
        """The parent of a frame at a time and the matrix that leads there; 0: the newest."""
        if child in self.still:
            return self.still[child].parent, matrix(self.still[child])
        history = self.moving.get(child, [])
        if not history:
            return None
        newest, oldest = history[0], history[-1]
        if stamp in (0, newest.stamp):
            return newest.parent, matrix(newest)
        if len(history) == 1 or stamp > newest.stamp or stamp < oldest.stamp:
            return None
        if stamp == oldest.stamp:
            return oldest.parent, matrix(oldest)
        older = next(i for i, one in enumerate(history) if one.stamp <= stamp)
        one, two = history[older], history[older - 1]
        if one.parent != two.parent:
            return one.parent, matrix(one)
        share = (stamp - one.stamp) / (two.stamp - one.stamp)
        at = tuple((1 - share) * a + share * b for a, b in zip(one.at, two.at, strict=True))
        return one.parent, matrix(Sample(stamp, one.parent, at, slerp(one.turn, two.turn, share)))

    def newest(self, child: str) -> tuple[int, str] | None:
        if child in self.still:
            return 0, self.still[child].parent
        history = self.moving.get(child, [])
        return (history[0].stamp, history[0].parent) if history else None

    def up(self, frame: str, stamp: int) -> list[tuple[str, Matrix]]:
        """A frame and all above it, each with the matrix from the frame to it."""
        found, here = [(frame, np.eye(4))], np.eye(4)
        while (step := self.of(frame, stamp)) is not None and len(found) < 50:
            frame, here = step[0], step[1] @ here
            found.append((frame, here))
        return found

    def common(self, target: str, source: str) -> int | None:
        """The least of the newest stamps on the way between two frames, but for 0; `None`: no way."""

        def climb(frame: str) -> list[tuple[str, int]]:
            found, stamps = [(frame, 0)], 0
            while (step := self.newest(frame)) is not None and len(found) < 50:
                stamp, frame = step
                stamps = min((s for s in (stamps, stamp) if s), default=0)
                found.append((frame, stamps))
            return found

        ups, downs = climb(source), dict(reversed(climb(target)))
        for frame, least in ups:
            if frame in downs:
                return min((s for s in (least, downs[frame]) if s), default=0)
        return None

    def lookup(self, target: str, source: str, stamp: int) -> tuple[int, Matrix] | None:
        """The stamp and the place of one frame in another; `None` where it is not had."""
        if stamp == 0:
            common = self.common(target, source)
            if common is None:
                return None
            stamp = common
        ups = self.up(source, stamp)
        downs = dict(reversed(self.up(target, stamp)))
        for frame, here in ups:
            if frame in downs:
                return stamp, (inverse(downs[frame]) @ here)[:3, 3]
        return None


def matrix(sample: Sample) -> Matrix:
    x, y, z, w = sample.turn
    found = np.eye(4)
    found[:3, :3] = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    found[:3, 3] = sample.at
    return found


def inverse(found: Matrix) -> Matrix:
    back = np.eye(4)
    back[:3, :3] = found[:3, :3].T
    back[:3, 3] = -back[:3, :3] @ found[:3, 3]
    return back


def slerp(a: tuple[float, ...], b: tuple[float, ...], share: float) -> tuple[float, ...]:
    one, two = np.array(a), np.array(b)
    dot = float(one @ two) / float(np.linalg.norm(one) * np.linalg.norm(two))
    if dot < 0:
        two, dot = -two, -dot
    angle = np.arccos(min(dot, 1.0))
    if angle == 0:
        return a
    mixed = (np.sin((1 - share) * angle) * one + np.sin(share * angle) * two) / np.sin(angle)
    return tuple(mixed.tolist())
