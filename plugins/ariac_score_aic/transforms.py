"""A buffer of transforms that answers as tf2's `BufferCore` does.

Unlike what one would build, it keeps a bounded history, interpolates across any pause, never extrapolates,
and takes the order in which transforms arrive for what it is.

Source: ros2/geometry2, `tf2/src/buffer_core.cpp`, `cache.cpp` and `static_cache.cpp`.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

__all__ = ["IDENTITY", "NORM_TOLERANCE", "DynamicFrame", "Placement", "StaticFrame", "TransformBuffer"]

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Row = Sequence[float]
"""x, y, z in m, then the quaternion x, y, z, w."""

IDENTITY: Row = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
NORM_TOLERANCE = 0.01
"""By so much the squared norm may be off 1. Source: tf2, `QUATERNION_NORMALIZATION_TOLERANCE`."""
MAX_DEPTH = 1000
"""Frames of a chain. Source: tf2, `MAX_GRAPH_DEPTH`."""


class Placement(NamedTuple):
    """Where a frame is in another one: the stamp in ns, the position in m, the quaternion x, y, z, w."""

    stamp_ns: int
    position_m: Vector
    turn_xyzw: Quaternion


@dataclass
class StaticFrame:
    """The transform of a frame that holds at all times."""

    parent: str
    row: Row

    def at(self, _stamp_ns: int) -> tuple[str, Row] | None:
        """Parent and transform, whenever."""
        return self.parent, self.row

    def latest(self) -> tuple[int, str] | None:
        """Stamp 0, which does not count where a common time is looked for, and the parent."""
        return 0, self.parent


@dataclass
class DynamicFrame:
    """The transforms of a frame that moves, oldest first; of equal stamps the later insertion last."""

    stamps_ns: list[int] = field(default_factory=list)
    parents: list[str] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)

    def insert(self, stamp_ns: int, parent: str, row: Row, buffer_ns: int) -> bool:
        """Take a transform; `False` where it is older than the buffer reaches back."""
        stamps = self.stamps_ns
        if stamps:
            oldest_ns = stamps[-1] - buffer_ns
            if stamps[0] < oldest_ns:
                # Before the insertion, by the latest stamp until then: the new one may reach further ahead.
                gone = next(i for i, known_ns in enumerate(stamps) if known_ns >= oldest_ns)
                del stamps[:gone], self.parents[:gone], self.rows[:gone]
            if stamp_ns < oldest_ns:
                return False
        place = bisect_right(stamps, stamp_ns)
        same, numbers = place - 1, tuple(row)
        while same >= 0 and stamps[same] == stamp_ns:  # an exact repetition is not stored again
            if (self.parents[same], tuple(self.rows[same])) == (parent, numbers):
                return True
            same -= 1
        stamps.insert(place, stamp_ns)
        self.parents.insert(place, parent)
        self.rows.insert(place, row)
        return True

    def at(self, stamp_ns: int) -> tuple[str, Row] | None:
        """Parent and transform at a time, 0 for the latest; `None` where nothing is known."""
        stamps = self.stamps_ns
        if not stamps:
            return None
        if stamp_ns == 0 or stamp_ns == stamps[-1]:
            return self.parents[-1], self.rows[-1]
        if len(stamps) == 1 or not stamps[0] <= stamp_ns <= stamps[-1]:
            return None
        if stamp_ns == stamps[0]:
            return self.parents[0], self.rows[0]
        newer = bisect_right(stamps, stamp_ns)
        older = newer - 1
        if self.parents[older] != self.parents[newer]:
            return self.parents[older], self.rows[older]
        share = (stamp_ns - stamps[older]) / (stamps[newer] - stamps[older])
        return self.parents[older], between(self.rows[older], self.rows[newer], share)

    def latest(self) -> tuple[int, str] | None:
        """The newest stamp and its parent; `None` without any."""
        return (self.stamps_ns[-1], self.parents[-1]) if self.stamps_ns else None


class TransformBuffer:
    """Takes transforms in order of arrival and answers where one frame is in another.

    Args:
        buffer_ns: How far back it remembers.
    """

    def __init__(self, buffer_ns: int) -> None:
        self._buffer_ns = buffer_ns
        self.frames: dict[str, StaticFrame | DynamicFrame] = {}

    def set(self, parent: str, child: str, stamp_ns: int, row: Row, *, static: bool) -> bool:
        """Take one transform; `False` where tf2 refuses or ignores it."""
        parent, child = parent.removeprefix("/"), child.removeprefix("/")
        if not parent or not child or parent == child or not is_sound(row):
            return False
        known = self.frames.get(child)
        if static:
            self.frames[child] = StaticFrame(parent, row)
            return True
        if not isinstance(known, DynamicFrame):  # what was static so far loses its history
            known = self.frames[child] = DynamicFrame()
        return known.insert(stamp_ns, parent, row, self._buffer_ns)

    def lookup(self, target: str, source: str, stamp_ns: int = 0) -> Placement | None:
        """Where the frame `source` is in the frame `target` at a time; at 0 at the latest common one.

        `None` where it is not had: no path between the two, or a time outside what one of them knows.
        """
        if target == source:
            return Placement(stamp_ns, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        if not (self._known(target) and self._known(source)):
            return None
        if stamp_ns == 0:
            common_ns = self._latest_common_ns(target, source)
            if common_ns is None:
                return None
            stamp_ns = common_ns
        found = self._composed(target, source, stamp_ns)
        return None if found is None else Placement(stamp_ns, *found)

    def moving(self, frame: str) -> Iterator[DynamicFrame]:
        """What moves of a frame and of all those above it, as they are linked at the latest time."""
        names = [frame, *(parent for _, parent in self._climb(frame))]
        for known in map(self.frames.get, names):
            if isinstance(known, DynamicFrame):
                yield known

    def _known(self, name: str) -> bool:
        return name in self.frames or any(name in parents for parents in map(_parents, self.frames.values()))

    def _latest_common_ns(self, target: str, source: str) -> int | None:
        """The least of the newest stamps on the path, but for those of 0; 0 where there is no other."""
        upwards: list[tuple[int, str]] = []
        for stamp_ns, parent in self._climb(source):
            upwards.append((stamp_ns, parent))
            if parent == target:
                return _least(stamp for stamp, _ in upwards)
        if len(upwards) > MAX_DEPTH:  # frames in a circle lead nowhere
            return None
        passed = {parent for _, parent in upwards}
        seen: list[int] = []
        for stamp_ns, parent in self._climb(target):
            seen.append(stamp_ns)
            if parent == source:
                return _least(seen)
            if parent in passed:
                meeting = next(i for i, (_, name) in enumerate(upwards) if name == parent)
                return _least([*seen, *(stamp for stamp, _ in upwards[: meeting + 1])])
        return None

    def _climb(self, frame: str) -> list[tuple[int, str]]:
        found: list[tuple[int, str]] = []
        while frame in self.frames and len(found) <= MAX_DEPTH:
            latest = self.frames[frame].latest()
            if latest is None:
                break
            found.append(latest)
            frame = latest[1]
        return found

    def _composed(self, target: str, source: str, stamp_ns: int) -> tuple[Vector, Quaternion] | None:
        frame, depth = source, 0
        here: tuple[Vector, Quaternion] = _ORIGIN
        while (step := self._step(frame, stamp_ns)) is not None:
            if frame == target:
                return here
            here = placed(here, step[1])
            frame, depth = step[0], depth + 1
            if depth > MAX_DEPTH:
                return None
        top, frame = frame, target
        there: tuple[Vector, Quaternion] = _ORIGIN
        for _ in range(MAX_DEPTH):
            if frame == top:
                back = conjugate(there[1])
                at = turned(here[0], back)
                away = turned((-there[0][0], -there[0][1], -there[0][2]), back)
                return (at[0] + away[0], at[1] + away[1], at[2] + away[2]), product(back, here[1])
            step = self._step(frame, stamp_ns)
            if step is None:
                return None
            if frame == source:
                back = conjugate(there[1])
                return turned((-there[0][0], -there[0][1], -there[0][2]), back), back
            there = placed(there, step[1])
            frame = step[0]
        return None

    def _step(self, frame: str, stamp_ns: int) -> tuple[str, Row] | None:
        known = self.frames.get(frame)
        return None if known is None else known.at(stamp_ns)


_ORIGIN: tuple[Vector, Quaternion] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def _parents(frame: StaticFrame | DynamicFrame) -> Sequence[str]:
    return (frame.parent,) if isinstance(frame, StaticFrame) else frame.parents


def _least(stamps_ns: object) -> int:
    return min((stamp for stamp in stamps_ns if stamp), default=0)  # type: ignore[attr-defined]


def is_sound(row: Row) -> bool:
    """Whether tf2 takes a transform: finite, with a quaternion of about norm 1."""
    x, y, z, w = row[3:]
    return not any(map(math.isnan, row)) and abs(x * x + y * y + z * z + w * w - 1.0) < NORM_TOLERANCE


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """The quaternion product a b."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by + ay * bw + az * bx - ax * bz,
        aw * bz + az * bw + ax * by - ay * bx,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(q: Quaternion) -> Quaternion:
    """What tf2 calls the inverse: exact for norm 1 alone."""
    return -q[0], -q[1], -q[2], q[3]


def turned(v: Vector, q: Quaternion) -> Vector:
    """A vector turned by q as tf2 does it: q v conj(q), which also scales where q is not of norm 1."""
    x, y, z, _ = product(product(q, (*v, 0.0)), conjugate(q))
    return x, y, z


def placed(inner: tuple[Vector, Quaternion], row: Row) -> tuple[Vector, Quaternion]:
    """A placement in a frame as one in that frame's parent."""
    q: Quaternion = (float(row[3]), float(row[4]), float(row[5]), float(row[6]))
    x, y, z = turned(inner[0], q)
    return (x + float(row[0]), y + float(row[1]), z + float(row[2])), product(q, inner[1])


def between(older: Row, newer: Row, share: float) -> Row:
    """Between two transforms: straight, and turning the shorter way at an even rate."""
    rest = 1.0 - share
    at = [rest * float(a) + share * float(b) for a, b in zip(older[:3], newer[:3], strict=True)]
    a, b = [float(v) for v in older[3:]], [float(v) for v in newer[3:]]
    dot = sum(p * q for p, q in zip(a, b, strict=True))
    if dot < 0:
        b, dot = [-v for v in b], -dot
    scale = math.sqrt(sum(v * v for v in a) * sum(v * v for v in b))
    angle = math.acos(min(1.0, dot / scale))
    if angle == 0.0:
        return (*at, *a)
    sine = math.sin(angle)
    first, second = math.sin(rest * angle) / sine, math.sin(share * angle) / sine
    return (*at, *(p * first + q * second for p, q in zip(a, b, strict=True)))
