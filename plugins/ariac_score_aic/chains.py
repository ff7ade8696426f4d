"""Transforms by columns: which of them matter, the buffer they leave behind, and poses while they arrive.

`replayed` feeds every transform to a `TransformBuffer` and asks after each message, as the scorer does. Where
the columns show that nothing in that depends on the order of arrival, `poses_while_reading` gives the same
poses from whole columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score import FloatArray
from ariac_score_aic.messages import SCORING_STATIC, SCORING_TF, TF, TF_STATIC, IntArray, Transforms
from ariac_score_aic.transforms import (
    IDENTITY,
    NORM_TOLERANCE,
    DynamicFrame,
    StaticFrame,
    TransformBuffer,
)

__all__ = [
    "Feed",
    "Poses",
    "asks_for_latest",
    "at_every_stamp",
    "distinct",
    "final_buffer",
    "first_of_each",
    "lengths_m",
    "poses_while_reading",
    "refused_rows",
    "replayed",
    "stamps_asked",
    "taken",
    "with_link",
]

_LAST_BITS = 1e-15
"""A norm that differs from 1 by less has lost no digit."""


@dataclass(frozen=True)
class Feed:
    """How a scorer takes the tf topics.

    Attributes:
        buffer_ns: How far back its buffer remembers.
        static_part: Child frames with this in their names are taken for static; empty: none.
        topics: The topics that it subscribes to.
    """

    buffer_ns: int
    static_part: str = "task_board"
    topics: tuple[str, ...] = (TF, TF_STATIC, SCORING_TF)


@dataclass(frozen=True, eq=False)
class Poses:
    """Poses in order of appending: stamps, shape (n,), and positions in m, shape (n, 3)."""

    stamp_ns: IntArray
    position_m: FloatArray

    def __len__(self) -> int:
        return len(self.stamp_ns)


def _picked(transforms: Transforms, rows: NDArray[np.bool_]) -> Transforms:
    columns = ("order", "topic", "stamp_ns", "parent", "child", "rows")
    return replace(transforms, **{name: getattr(transforms, name)[rows] for name in columns})


def _heard(transforms: Transforms, feed: Feed) -> NDArray[np.bool_]:
    found: NDArray[np.bool_] = np.array([t in feed.topics for t in transforms.topics] or [False])[
        transforms.topic
    ]
    return found


def refused_rows(transforms: Transforms) -> NDArray[np.bool_]:
    """Which transforms tf2 refuses, whoever hears them."""
    named = np.array([bool(name) for name in transforms.names] or [False])
    norms = (transforms.rows[:, 3:] ** 2).sum(axis=1)
    sound = ~np.isnan(transforms.rows).any(axis=1) & (np.abs(norms - 1.0) < NORM_TOLERANCE)
    apart = transforms.parent != transforms.child
    refused: NDArray[np.bool_] = ~(sound & apart & named[transforms.parent] & named[transforms.child])
    return refused


def taken(transforms: Transforms, feed: Feed) -> Transforms:
    """The transforms that tf2 takes of the topics that the scorer hears, with quaternions of norm 1.

    Source: ros2/geometry2, `buffer_core.cpp`: what is taken has become a matrix and a quaternion again.
    """
    kept = _heard(transforms, feed) & ~refused_rows(transforms)
    norms = (transforms.rows[kept, 3:] ** 2).sum(axis=1)
    picked, lengths = _picked(transforms, kept), np.sqrt(norms)
    off = np.abs(lengths - 1.0) > _LAST_BITS
    if off.any():
        rows = picked.rows.copy()
        rows[off, 3:] /= lengths[off, np.newaxis]
        picked = replace(picked, rows=rows)
    return picked


def relevant(transforms: Transforms, frames: Iterable[str]) -> Transforms:
    """The transforms on which the places of some frames can depend: theirs and all their ancestors'."""
    numbers = {name: i for i, name in enumerate(transforms.names)}
    wanted = np.zeros(max(len(numbers), 1), dtype=bool)
    wanted[[numbers[name] for name in frames if name in numbers]] = True
    edges = _edges(transforms)
    before = -1
    while int(wanted.sum()) != before:
        before = int(wanted.sum())
        wanted[edges[wanted[edges[:, 0]], 1]] = True
    return _picked(transforms, wanted[transforms.child])


def with_link(transforms: Transforms, parent: str, child: str) -> Transforms:
    """The transforms, and after all of them a static one that puts a frame where its parent is."""
    names = dict.fromkeys((*transforms.names, parent, child))
    topics = dict.fromkeys((*transforms.topics, TF_STATIC))
    places = list(names)
    last = int(transforms.order[-1]) + 1 if len(transforms) else 1
    added = {
        "order": last,
        "topic": list(topics).index(TF_STATIC),
        "stamp_ns": 0,
        "parent": places.index(parent),
        "child": places.index(child),
    }
    columns = {
        name: np.append(getattr(transforms, name), np.int64(value)).astype(np.int64)
        for name, value in added.items()
    }
    rows = np.concatenate([transforms.rows, np.array([IDENTITY])])
    return Transforms(**columns, rows=rows, topics=tuple(topics), names=tuple(names))


def _edges(transforms: Transforms) -> IntArray:
    """Every child with each of its parents, shape (k, 2)."""
    count = max(len(transforms.names), 1)
    codes = np.flatnonzero(np.bincount(transforms.child * count + transforms.parent))
    found: IntArray = np.column_stack(np.divmod(codes, count))
    return found


def statics(transforms: Transforms, feed: Feed) -> NDArray[np.bool_]:
    """Which transforms are taken for static ones."""
    by_topic = np.array([t in (TF_STATIC, SCORING_STATIC) for t in transforms.topics] or [False])
    part = feed.static_part
    by_name = np.array([bool(part) and part in name for name in transforms.names] or [False])
    found: NDArray[np.bool_] = by_topic[transforms.topic] | by_name[transforms.child]
    return found


def final_buffer(sound: Transforms, feed: Feed, frames: Iterable[str]) -> TransformBuffer:
    """The buffer after all messages, of which tf2 takes these, as far as some frames depend on it."""
    chosen = relevant(sound, frames)
    static = statics(chosen, feed)
    buffer = TransformBuffer(feed.buffer_ns)
    for child in np.flatnonzero(np.bincount(chosen.child)).tolist():
        rows = np.flatnonzero(chosen.child == child)
        name = chosen.names[child]
        if static[rows].all():
            last = rows[-1]
            buffer.frames[name] = StaticFrame(chosen.names[chosen.parent[last]], chosen.rows[last].tolist())
        elif not static[rows].any() and _increasing(chosen, rows):
            buffer.frames[name] = _increasing_frame(chosen, rows, feed.buffer_ns)
        else:
            for row in rows.tolist():
                _insert(buffer, chosen, row, static=bool(static[row]))
    return buffer


def _insert(buffer: TransformBuffer, transforms: Transforms, row: int, *, static: bool) -> None:
    parent, child = transforms.names[transforms.parent[row]], transforms.names[transforms.child[row]]
    buffer.set(
        parent, child, int(transforms.stamp_ns[row]), tuple(transforms.rows[row].tolist()), static=static
    )


def _increasing(transforms: Transforms, rows: NDArray[np.intp]) -> bool:
    return bool((np.diff(transforms.stamp_ns[rows]) > 0).all())


def _increasing_frame(transforms: Transforms, rows: NDArray[np.intp], buffer_ns: int) -> DynamicFrame:
    """The history of a frame whose stamps increase: the last insertion decided what was dropped."""
    stamps = transforms.stamp_ns[rows]
    if len(stamps) > 1:
        rows = rows[stamps >= stamps[-2] - buffer_ns]
    parents = [transforms.names[code] for code in transforms.parent[rows].tolist()]
    return DynamicFrame(transforms.stamp_ns[rows].tolist(), parents, list(transforms.rows[rows]))


def replayed(transforms: Transforms, feed: Feed, target: str, source: str) -> Poses:
    """The poses that the scorer appends: after each message the latest, where its stamp is new."""
    return _replayed(transforms, taken(transforms, feed), feed, target, source)


def _replayed(transforms: Transforms, sound: Transforms, feed: Feed, target: str, source: str) -> Poses:
    chosen = relevant(sound, (target, source))
    static, buffer = statics(chosen, feed), TransformBuffer(feed.buffer_ns)
    asked = _asked(transforms, feed).tolist()
    bounds = np.searchsorted(chosen.order, asked, side="right").tolist()
    stamps: list[int] = []
    places: list[tuple[float, float, float]] = []
    done = 0
    for bound in bounds:
        if bound == done:
            continue  # nothing that matters has arrived since it was asked last
        for row in range(done, bound):
            _insert(buffer, chosen, row, static=bool(static[row]))
        done = bound
        found = buffer.lookup(target, source)
        if found is not None and (not stamps or found.stamp_ns != stamps[-1]):
            stamps.append(found.stamp_ns)
            places.append(found.position_m)
    return Poses(np.array(stamps, dtype=np.int64), np.array(places, dtype=np.float64).reshape(-1, 3))


def poses_while_reading(
    transforms: Transforms, sound: Transforms, feed: Feed, target: str, source: str
) -> Poses:
    """What `replayed` gives, from whole columns where they show that it is the same.

    Args:
        transforms: All of them, after each of which is asked.
        sound: Those that tf2 takes, as `taken` gives them.
        feed: How they are taken.
        target: In which frame.
        source: Where which frame is.
    """
    chosen = relevant(sound, (target, source))
    if target not in chosen.names or source not in chosen.names:
        return _no_poses()
    path = _fixed_path(chosen, target, source)
    if path is None:
        return _replayed(transforms, sound, feed, target, source)
    if not path.linked:
        return _no_poses()
    links = [_Link.of(chosen, statics(chosen, feed), child) for child in (*path.up, *path.down)]
    if not all(link.plain for link in links):
        return _replayed(transforms, sound, feed, target, source)
    orders = _asked(transforms, feed)
    moving = [link for link in links if link.moves]
    begin = max(int(link.order[0]) for link in links)
    orders = orders[orders >= begin]
    if not moving or not len(orders):
        return _replayed(transforms, sound, feed, target, source) if len(orders) else _no_poses()
    newest = [np.searchsorted(link.order, orders, side="right") - 1 for link in moving]
    at_ns = np.min([link.stamp_ns[i] for link, i in zip(moving, newest, strict=True)], axis=0)
    had = np.ones(len(orders), dtype=bool)
    for link, last in zip(moving, newest, strict=True):
        older = np.searchsorted(link.stamp_ns, at_ns, side="right") - 1
        had &= older >= 0
        remembered = link.stamp_ns[np.maximum(last - 1, 0)] - feed.buffer_ns
        if (had & (link.stamp_ns[np.maximum(older, 0)] < remembered)).any():
            return _replayed(transforms, sound, feed, target, source)
    at_ns = at_ns[had]
    kept = np.concatenate(([True], np.diff(at_ns) != 0))[: len(at_ns)]
    return _composed(links, path, at_ns[kept])


def _no_poses() -> Poses:
    return Poses(np.empty(0, dtype=np.int64), np.empty((0, 3)))


def distinct(values: IntArray) -> IntArray:
    """What `np.unique` gives, without sorting what is in order already, as stamps nearly always are."""
    steps = np.diff(values)
    if (steps >= 0).all():
        return values[np.concatenate(([True], steps > 0))[: len(values)]]
    return np.unique(values)


def first_of_each(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """Each value once, in order, with the place of its first."""
    if (np.diff(values) > 0).all():
        return values, np.arange(len(values))
    found, first = np.unique(values, return_index=True)
    return found, first


def _asked(transforms: Transforms, feed: Feed) -> IntArray:
    """The places of the messages after which the scorer asks, whatever they hold."""
    moving = np.array([t not in (TF_STATIC, SCORING_STATIC) for t in transforms.topics] or [False])
    return distinct(transforms.order[moving[transforms.topic] & _heard(transforms, feed)])


@dataclass(frozen=True)
class _Path:
    """The frames from the source up, and from the target up, to where both meet; whether they do."""

    up: tuple[int, ...]
    down: tuple[int, ...]
    linked: bool


def _fixed_path(transforms: Transforms, target: str, source: str) -> _Path | None:
    """The path between two frames where every frame has one parent throughout; `None` where one changes."""
    edges = _edges(transforms)
    parents = dict(edges.tolist())
    if len(parents) != len(edges):
        return None

    def ancestry(name: str) -> list[int]:
        found = [transforms.names.index(name)]
        while found[-1] in parents:
            if parents[found[-1]] in found:
                return []
            found.append(parents[found[-1]])
        return found

    up, down = ancestry(source), ancestry(target)
    if not up or not down:
        return None
    meeting = next((frame for frame in up if frame in down), None)
    if meeting is None:
        return _Path((), (), linked=False)
    return _Path(tuple(up[: up.index(meeting)]), tuple(down[: down.index(meeting)]), linked=True)


@dataclass(frozen=True, eq=False)
class _Link:
    """All transforms of one frame, and whether they arrive so that the order decides nothing."""

    order: IntArray
    stamp_ns: IntArray
    rows: FloatArray
    moves: bool
    plain: bool

    @classmethod
    def of(cls, transforms: Transforms, static: NDArray[np.bool_], child: int) -> _Link:
        own = np.flatnonzero(transforms.child == child)
        order, stamps, rows = transforms.order[own], transforms.stamp_ns[own], transforms.rows[own]
        if static[own].all():
            plain = bool((rows == rows[0]).all())
            return cls(order, stamps, rows, moves=False, plain=plain)
        # An exact repetition directly after its original is not stored again.
        again = np.zeros(len(own), dtype=bool)
        again[1:] = (np.diff(stamps) == 0) & (np.diff(rows, axis=0) == 0).all(axis=1)
        order, stamps, rows = order[~again], stamps[~again], rows[~again]
        increase = bool((np.diff(stamps) > 0).all()) and bool((stamps > 0).all())
        return cls(order, stamps, rows, moves=True, plain=increase and not static[own].any())

    def at(self, at_ns: IntArray) -> FloatArray:
        """Its transforms at times within its own, shape (n, 7)."""
        if not self.moves:
            return np.broadcast_to(self.rows[0], (len(at_ns), 7))
        older = np.searchsorted(self.stamp_ns, at_ns, side="right") - 1
        newer = np.minimum(older + 1, len(self.stamp_ns) - 1)
        exact = self.stamp_ns[older] == at_ns
        if exact.all():
            return self.rows[older]
        step = np.where(exact, 1, self.stamp_ns[newer] - self.stamp_ns[older])
        share = np.where(exact, 0.0, (at_ns - self.stamp_ns[older]) / step)
        return _between(self.rows[older], self.rows[newer], share)


def _between(older: FloatArray, newer: FloatArray, share: FloatArray) -> FloatArray:
    """Between transforms: straight, and turning the shorter way at an even rate."""
    rest = 1.0 - share
    a, b = older[:, 3:], newer[:, 3:]
    dot = (a * b).sum(axis=1)
    b = np.where(dot[:, np.newaxis] < 0, -b, b)
    scale = np.sqrt((a * a).sum(axis=1) * (b * b).sum(axis=1))
    angle = np.arccos(np.minimum(1.0, np.abs(dot) / scale))
    still = angle == 0.0
    sine = np.where(still, 1.0, np.sin(angle))
    first = np.where(still, 1.0, np.sin(rest * angle) / sine)
    second = np.where(still, 0.0, np.sin(share * angle) / sine)
    at = rest[:, np.newaxis] * older[:, :3] + share[:, np.newaxis] * newer[:, :3]
    return np.column_stack([at, first[:, np.newaxis] * a + second[:, np.newaxis] * b])


def _composed(links: Sequence[_Link], path: _Path, at_ns: IntArray) -> Poses:
    """The position of the source in the target."""
    up, down = links[: len(path.up)], links[len(path.up) :]
    here = _upwards(up, at_ns)
    there, back = _upwards(down, at_ns), _turns_back(down, at_ns)
    if not down:
        return Poses(at_ns, here)
    return Poses(at_ns, _turned(here - there, back))


def _upwards(links: Sequence[_Link], at_ns: IntArray) -> FloatArray:
    place: FloatArray = np.zeros((len(at_ns), 3))
    for link in links:
        rows = link.at(at_ns)
        place = _turned(place, rows[:, 3:]) + rows[:, :3]
    return place


def _turns_back(links: Sequence[_Link], at_ns: IntArray) -> FloatArray:
    turn: FloatArray = np.tile([0.0, 0.0, 0.0, 1.0], (len(at_ns), 1))
    for link in links:
        turn = _product(link.at(at_ns)[:, 3:], turn)
    back: FloatArray = turn * [-1.0, -1.0, -1.0, 1.0]
    return back


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    (ax, ay, az, aw), (bx, by, bz, bw) = a.T, b.T
    return np.column_stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by + ay * bw + az * bx - ax * bz,
            aw * bz + az * bw + ax * by - ay * bx,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def _turned(v: FloatArray, q: FloatArray) -> FloatArray:
    wide = np.column_stack([v, np.zeros(len(v))])
    return _product(_product(q, wide), q * [-1.0, -1.0, -1.0, 1.0])[:, :3]


def _at_stamps(
    sound: Transforms,
    buffer: TransformBuffer,
    feed: Feed,
    target: str,
    source: str,
    at_ns: IntArray,
) -> Poses | None:
    """Poses at given times by whole columns; `None` where these do not show that it is the same."""
    chosen = relevant(sound, (target, source))
    path = _fixed_path(chosen, target, source) if {target, source} <= set(chosen.names) else None
    if path is None or not path.linked:
        return None
    frames = [chosen.names[child] for child in (*path.up, *path.down)]
    links = [_Link.of(chosen, statics(chosen, feed), child) for child in (*path.up, *path.down)]
    kept = [buffer.frames.get(name) for name in frames]
    if not all(link.plain for link in links) or any(frame is None for frame in kept):
        return None
    moving = [frame for frame in kept if isinstance(frame, DynamicFrame)]
    if len(moving) != sum(link.moves for link in links) or any(len(one.stamps_ns) < 2 for one in moving):
        return None
    for one in moving:
        at_ns = at_ns[(at_ns >= one.stamps_ns[0]) & (at_ns <= one.stamps_ns[-1])]
    return _composed(links, path, at_ns)


def lengths_m(position_m: FloatArray) -> FloatArray:
    """The distances between neighbouring positions."""
    if len(position_m) < 2:
        return np.empty(0)
    steps: FloatArray = np.sqrt((np.diff(position_m, axis=0) ** 2).sum(axis=1))
    return steps


def stamps_asked(transforms: Transforms, feed: Feed) -> IntArray:
    """The stamps at which the scorer asked until February 23: all of moving topics but 0, each once."""
    asked = distinct(_moving_stamps(transforms, feed))
    found: IntArray = asked[asked != 0]
    return found


def asks_for_latest(transforms: Transforms, feed: Feed) -> bool:
    """Whether a moving topic has a stamp of 0, which a buffer takes for the latest time."""
    return bool((_moving_stamps(transforms, feed) == 0).any())


def _moving_stamps(transforms: Transforms, feed: Feed) -> IntArray:
    heard = np.array(
        [t in feed.topics and t not in (TF_STATIC, SCORING_STATIC) for t in transforms.topics] or [False]
    )
    found: IntArray = transforms.stamp_ns[heard[transforms.topic]]
    return found


def at_every_stamp(
    asked_ns: IntArray, sound: Transforms, buffer: TransformBuffer, feed: Feed, target: str, source: str
) -> Poses:
    """Poses at every stamp of a moving topic, asked after all is read, as until February 23 (PR 334)."""
    by_columns = _at_stamps(sound, buffer, feed, target, source, asked_ns)
    if by_columns is not None:
        return by_columns
    found = [(stamp, buffer.lookup(target, source, stamp)) for stamp in asked_ns.tolist()]
    had = [(stamp, placement.position_m) for stamp, placement in found if placement is not None]
    stamps = np.array([stamp for stamp, _ in had], dtype=np.int64)
    return Poses(stamps, np.array([at for _, at in had], dtype=np.float64).reshape(-1, 3))
