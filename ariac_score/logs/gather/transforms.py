"""Positions of bodies from tf trees.

Unlike a tf2 buffer, which forgets after ten seconds and interpolates across any pause, this keeps all
samples, settles their order once, and gives no position where a transform was silent too long.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score.errors import LogError
from ariac_score.logs.containers.items import IntArray
from ariac_score.logs.gather.array_growth import GrowthForecast
from ariac_score.logs.gather.chain_times import seen_by_all, throughout
from ariac_score.logs.gather.message_fields import nearest
from ariac_score.trial.build import LARGEST_STEP_BACK_S, TrialBuilder
from ariac_score.trial.channels import OF_FRAMES, BodyMatch
from ariac_score.trial.model import Body
from ariac_score.trial.signals import covered, settle
from ariac_score.trial.spans import FloatArray, Span, distinct

__all__ = ["MAX_GAP_S", "Placed", "TransformTree", "are_units", "row_of", "times_s"]


MAX_GAP_S = 0.5
"""A transform is not interpolated across a longer silence than this, s."""


LARGEST_NORM_ERROR = 0.01
"""How far the norm of a rotation may be from 1. Source: tf2, QUATERNION_NORMALIZATION_TOLERANCE."""


Retimed = Callable[[IntArray], IntArray]
"""Turns stamps, ns, into those of another clock."""


_Row = tuple[float, float, float, float, float, float, float]


_PoseColumns = tuple[FloatArray, FloatArray]
"""Poses of one frame in another: x, y, z in m, shape (3, n), and a quaternion x, y, z, w, shape (4, n)."""


_FEW_CODES = 1 << 16
"""Numbers below this are counted rather than sorted, which is several times as fast."""


_FEW_PLACES = 16
"""For fewer places than this it takes longer to test for even spacing than to copy them one by one."""


_LONGEST_TURN = 1 << 10
"""The longest period that is looked for; a robot has fewer frames."""


_MANY = 1 << 12
"""So many values of one static transform are kept each by itself, in whatever order they were written."""


_FEWEST_SAMPLES = 64
_LARGEST_GUESS = 1 << 22


_BLOCK_ROWS = 1 << 13
"""Transforms composed at a time, so that intermediate results stay in the processor's cache."""


def times_s(stamps_ns: Sequence[int] | IntArray, origin_ns: int) -> FloatArray:
    """Stamps as trial time, s."""
    stamps = np.asarray(stamps_ns, dtype=np.int64)
    if len(stamps) and stamps.min() < 0:
        # The difference may not fit into 64 bits: Python's integers are exact whatever the stamps.
        return np.array([(stamp_ns - origin_ns) / 1e9 for stamp_ns in stamps.tolist()], dtype=np.float64)
    seconds: FloatArray = (stamps - origin_ns) / 1e9  # the difference is exact, its division rounds once
    return seconds


def row_of(transform: Any) -> _Row:
    """x, y, z in m and the quaternion x, y, z, w of a `geometry_msgs/TransformStamped`."""
    at, turn = transform.transform.translation, transform.transform.rotation
    return at.x, at.y, at.z, turn.x, turn.y, turn.z, turn.w


class _Edge:
    """The transform of a frame in its parent: x, y, z (m) and the quaternion x, y, z, w, at its stamps.

    Kept in arrays that grow at their end: a list of parts would be copied once more when it is joined.

    Attributes:
        static: Where it is told as one that never moves: its values, each with the time of recording from
            which it holds, ns, as in tf2; the first one from the beginning, if it was told in time.
    """

    def __init__(self) -> None:
        self.static: list[tuple[int, _Row]] = []
        self._stamps_ns: IntArray = np.empty(0, dtype=np.int64)
        self._columns: FloatArray = np.empty((7, 0))
        self._used, self._foreseen = 0, GrowthForecast(_LARGEST_GUESS)

    @property
    def moves(self) -> bool:
        return self._used > 0

    @property
    def values(self) -> list[tuple[int, _Row]]:
        """The static values in order of time, each where it is another one than that before."""
        found: list[tuple[int, _Row]] = []
        for at_ns, row in sorted(self.static, key=lambda one: one[0]):  # recorders write out of order
            if not found or _turned_alike(found[-1][1]) != _turned_alike(row):
                found.append((at_ns, row))
        return found

    @property
    def stamps_ns(self) -> IntArray:
        """All its stamps in recorded order, shape (n,)."""
        return self._stamps_ns[: self._used]

    @property
    def columns(self) -> FloatArray:
        """Its values at these stamps, shape (7, n)."""
        return self._columns[:, : self._used]

    def retime(self, retimed: Retimed, of_log: Retimed) -> None:
        """Put its stamps, and the times of recording of static values, on another clock."""
        self._stamps_ns[: self._used] = retimed(self.stamps_ns)
        if self.static:
            times_ns = of_log(np.array([at_ns for at_ns, _ in self.static], dtype=np.int64)).tolist()
            self.static = [(at_ns, row) for at_ns, (_, row) in zip(times_ns, self.static, strict=True)]

    def add_static(self, at_ns: int, row: _Row) -> None:
        """Take a value that holds from then on."""
        if len(self.static) > _MANY and self.static[-2][1] == self.static[-1][1] == row:
            # Of very many that are alike the first and the last one.
            (first_ns, _), (last_ns, _) = self.static[-2:]
            self.static[-2:] = [(min(first_ns, at_ns), row), (max(last_ns, at_ns), row)]
        else:
            self.static.append((at_ns, row))

    def standing(self, t: FloatArray, origin_ns: int) -> _Placements:
        """Its static values at some times, s."""
        values = self.values
        columns = np.array([row for _, row in values]).T
        if len(values) == 1:
            return _Placements(columns)
        since_s = times_s([at_ns for at_ns, _ in values], origin_ns)
        return _Placements(columns[:, np.searchsorted(since_s, t, side="right").clip(1) - 1], sampled=True)

    def add(self, stamp_ns: int, row: _Row) -> None:
        """Take one sample."""
        place = self._room(1)
        self._stamps_ns[place] = stamp_ns
        self._columns[:, place] = np.array(row)[:, np.newaxis]

    def add_many(
        self,
        places: NDArray[np.intp] | slice,
        stamps_ns: IntArray,
        columns: Sequence[FloatArray],
        share: float,
    ) -> None:
        """Take the samples at some places of arrays, after which a share of the recording is read."""
        rooms = self.rooms(stamps_ns[places], share)
        for room, column in zip(rooms, columns, strict=True):
            room[:] = column[places]

    def rooms(self, stamps_ns: IntArray, share: float) -> FloatArray:
        """Take the stamps of samples; returns the room for their values, shape (7, n)."""
        room = self._room(len(stamps_ns), share)
        self._stamps_ns[room] = stamps_ns
        return self._columns[:, room]

    def _room(self, count: int, share: float = 0.0) -> slice:
        """The place of the next samples."""
        start, self._used = self._used, self._used + count
        have = len(self._stamps_ns)
        size = max(_FEWEST_SAMPLES, self._foreseen.length(self._used, have, share))
        if size > have:
            stamps_ns, columns = np.empty(size, dtype=np.int64), np.empty((7, size))
            stamps_ns[:start], columns[:, :start] = self._stamps_ns[:start], self._columns[:, :start]
            self._stamps_ns, self._columns = stamps_ns, columns
        return slice(start, self._used)


@dataclass(frozen=True, eq=False)
class _Settled:
    """A moving transform: sample times, shape (n,), s, and its values then, shape (7, n)."""

    t: FloatArray
    columns: FloatArray

    def covers(self, t: FloatArray) -> NDArray[np.bool_]:
        return covered(self.t, t, max_gap_s=MAX_GAP_S)

    def at(self, t: FloatArray) -> _Placements:
        """At other times, by straight lines between neighbours."""
        if np.array_equal(t, self.t):  # most chains: all links of a robot are stamped alike
            return _Placements(self.columns, sampled=True)
        return _Placements(np.stack([np.interp(t, self.t, column) for column in self._continuous]))

    @cached_property
    def _continuous(self) -> FloatArray:
        """Its columns with neighbouring quaternions on one hemisphere.

        q and -q are one rotation, but the straight line between them passes through zero.
        """
        columns = self.columns.copy()
        _make_continuous(columns[3:])
        return columns


@dataclass(frozen=True, eq=False)
class _Placements:
    """The poses of a frame in the next one of a chain at some times.

    Attributes:
        columns: x, y, z in m, then its quaternion x, y, z, w, shape (7, n), or (7, 1) where it never moves.
        sampled: Whether these are samples as recorded, not interpolated ones.
    """

    columns: FloatArray
    sampled: bool = False

    def stretch(self, some: slice) -> _PoseColumns:
        """Its positions and quaternions of about norm 1, at some of the times."""
        rows = self._rows(some)
        if not self.sampled:
            return rows[:3], rows[3:]
        # `_make_continuous` divides by the norm as well: the last bits of a composed position must not
        # depend on whether another frame of the chain is interpolated.
        return rows[:3], rows[3:] / _norm(rows[3:])

    def origin(self, some: slice) -> FloatArray:
        """Its positions alone."""
        return self._rows(some)[:3]

    def _rows(self, some: slice) -> FloatArray:
        return self.columns[:, some] if self.columns.shape[1] > 1 else self.columns


@dataclass(frozen=True, eq=False)
class Placed:
    """Positions that messages give in a frame.

    Attributes:
        name: Of the signal they are, such as `position/human`.
        frame: The frame.
        stamps_ns: Their stamps, in recorded order, shape (n,).
        positions_m: Shape (n, 3).
    """

    name: str
    frame: str
    stamps_ns: IntArray
    positions_m: FloatArray


class TransformTree:
    """Collects transforms and composes them into positions in the root frame.

    Args:
        root: The frame positions are given in.
        file: The recording, for error messages.
    """

    def __init__(self, root: str, *, file: Path | None = None) -> None:
        self._root, self._file = _frame(root), file
        self._edges: dict[str, dict[str, _Edge]] = {}
        self._unusable: dict[str, int] = {}
        self._settled: dict[str, _Settled] = {}
        self.matched: list[BodyMatch] = []
        self.unmatched: list[BodyMatch] = []
        self._restated: set[str] = set()
        self._holes: Sequence[Span] = ()
        self._contested: Mapping[str, Sequence[Span]] = {}

    def add(self, transform: Any, stamp_ns: int, *, static: bool = False) -> None:
        """Take one `geometry_msgs/TransformStamped`.

        Args:
            transform: The message.
            stamp_ns: Its time, ns; of a static one, when it was recorded.
            static: Whether it holds until another one replaces it.
        """
        parent, child = _frame(transform.header.frame_id), _frame(transform.child_frame_id)
        row = row_of(transform)
        if not all(math.isfinite(v) for v in row) or not _is_unit(row[3:]):
            self._unusable[child] = self._unusable.get(child, 0) + 1
            return
        edge = self._edges.setdefault(child, {}).setdefault(parent, _Edge())
        if static:
            edge.add_static(stamp_ns, row)
        else:
            edge.add(stamp_ns, row)

    def add_many(
        self,
        names: Sequence[str],
        parents: IntArray,
        children: IntArray,
        columns: Sequence[FloatArray],
        stamps_ns: IntArray,
        moving: NDArray[np.bool_],
        *,
        share: float = 0.0,
    ) -> None:
        """Take many transforms, in recorded order.

        Args:
            names: Names of frames.
            parents: Of each transform, which name its parent has, shape (n,).
            children: Which name its child has, shape (n,).
            columns: x, y, z in m and the quaternion x, y, z, w, each of shape (n,).
            stamps_ns: Its time, ns, shape (n,); of a static one, when it was recorded.
            moving: Whether it holds at its time only, shape (n,); otherwise until another one replaces it.
            share: The share of the recording that was read, as far as is known, 0 to 1.
        """
        first: dict[str, int] = {}
        table = np.array([first.setdefault(_frame(name), number) for number, name in enumerate(names)])
        if len(first) < len(names):  # both `/base` and `base`, say: one frame, whose samples keep their order
            parents, children = table[parents], table[children]
        pair = parents * len(names) + children  # one number for each edge of the tree
        usable = are_units(columns[3:])
        for column in columns[:3]:
            usable &= np.isfinite(column)
        all_usable, all_move = bool(usable.all()), bool(moving.all())
        turn = _turn(pair) if all_usable and all_move else 0
        if turn:
            self._add_in_turn(names, pair[:turn], stamps_ns, columns, share)
            return
        for key in _keys(pair, len(names) ** 2):
            parent, child = _frame(names[key // len(names)]), _frame(names[key % len(names)])
            found = np.flatnonzero(pair == key)
            if not all_usable:
                some = len(found)
                found = found[usable[found]]
                if some > len(found):
                    self._unusable[child] = self._unusable.get(child, 0) + some - len(found)
            if not len(found):
                continue
            edge = self._edges.setdefault(child, {}).setdefault(parent, _Edge())
            if not all_move:
                still = found[~moving[found]]
                rows = zip(*(column[still].tolist() for column in columns), strict=True)
                for at_ns, (x, y, z, a, b, c, w) in zip(stamps_ns[still].tolist(), rows, strict=True):
                    edge.add_static(at_ns, (x, y, z, a, b, c, w))
                found = found[moving[found]]
            if len(found):
                edge.add_many(_even(found), stamps_ns, columns, share)

    def _add_in_turn(
        self,
        names: Sequence[str],
        pairs: IntArray,
        stamps_ns: IntArray,
        columns: Sequence[FloatArray],
        share: float,
    ) -> None:
        """Take transforms of frames that follow each other in turn, such as the links of a robot.

        Every message of a robot lists the same links, so the values of a link are a strided slice.
        """
        taken = []
        for first in np.argsort(pairs).tolist():
            parent, child = (_frame(names[number]) for number in divmod(int(pairs[first]), len(names)))
            edge = self._edges.setdefault(child, {}).setdefault(parent, _Edge())
            own = slice(first, None, len(pairs))
            taken.append((own, edge.rooms(stamps_ns[own], share)))
        # Column by column: one fits the processor's cache.
        for number, column in enumerate(columns):
            for own, rooms in taken:
                rooms[number] = column[own]

    def retime(self, retimed: Retimed, of_log: Retimed) -> None:
        """Put all stamps on another clock, and times of recording."""
        for edge in (edge for parents in self._edges.values() for edge in parents.values()):
            edge.retime(retimed, of_log)

    def settle(
        self,
        builder: TrialBuilder,
        origin_ns: int,
        matches: Sequence[BodyMatch],
        *,
        holes: Sequence[Span] = (),
        contested: Mapping[str, Sequence[Span]] = MappingProxyType({}),
    ) -> None:
        """Hand the positions of all matching frames to the builder, with their bodies.

        Args:
            builder: Of the trial.
            origin_ns: Trial time 0, ns.
            matches: Which frames are bodies.
            holes: Stretches in which messages are missing, of any moving transform.
            contested: By frame, stretches in which two publishers sent its transform.

        Raises:
            LogError: A wanted frame has a cycle or two parents above it, or its time runs backwards.
        """
        self._holes, self._contested = holes, contested
        for child in sorted(self._unusable):
            message = "transforms that are not finite, or whose rotation is no unit quaternion, were left out"
            builder.defect("unusable_transforms", f"frame {child}", self._unusable[child], message)
        for match in matches:
            found = list(self._matched(match))
            if found:
                self.matched.append(match)
            else:
                self.unmatched.append(match)
                unusable = sorted(one for one in self._unusable if match.body_for(one))
                there = nearest(match.match, sorted(self.names()), what="recorded frames")
                why = f"no recorded frame matches; {there}"
                if unusable:
                    why = (
                        f"none of the {self._unusable[unusable[0]]} transforms of {unusable[0]!r} can be used"
                    )
                builder.unrecorded.append(f"frame {match.match}: {why}")
            for frame, body in found:
                self._settle_frame(builder, origin_ns, frame, body, match.rate_hz)

    def names(self) -> set[str]:
        """All frames, those at the roots as well."""
        return set(self._edges).union(*self._edges.values())

    def places_any(self, matches: Sequence[BodyMatch]) -> bool:
        """Whether a recorded frame is a body."""
        return any(match.body_for(frame) for match in matches for frame in self._edges)

    def _matched(self, match: BodyMatch) -> Iterator[tuple[str, Body]]:
        """The frames that match, each with its body; the frame of a link with a body that names the link."""
        bodies = {frame: body for frame in sorted(self._edges) if (body := match.body_for(frame))}
        yield from bodies.items()
        for frame in sorted(self._edges.keys() - bodies.keys()):
            if match.follows_link(frame):
                owner = next((bodies[f] for f in self._ancestors(frame) if f in bodies), None)
                if owner is None and match.body:
                    owner = match.body_for(match.match) or Body(match.body, match.kind, match.radius_m)
                if owner is not None:
                    yield frame, replace(owner, links=(frame.replace("/", "_"),))

    def _ancestors(self, frame: str) -> Iterator[str]:
        """The frames above one, up to the root or to where the tree ends."""
        seen = {frame}
        while frame != self._root and frame in self._edges:
            # In tf2 each sample may name another parent, so the frame would jump between the two.
            parents = sorted(self._edges[frame])
            if len(parents) > 1:
                raise self._contradiction(
                    f"frame {frame!r} has {len(parents)} parents: {', '.join(map(repr, parents))}"
                )
            frame = parents[0]
            if frame in seen:
                raise self._contradiction(f"frame {frame!r} is its own ancestor")
            seen.add(frame)
            yield frame

    def _contradiction(self, cause: str) -> LogError:
        return LogError(
            cause,
            file=self._file,
            place="tf tree",
            hint="two publishers contradict each other: record again with one of them, or let the "
            "log map follow other frames",
        )

    def _settle_frame(
        self, builder: TrialBuilder, origin_ns: int, frame: str, body: Body, rate_hz: float
    ) -> None:
        builder.add_body(body)
        chain = [frame, *self._ancestors(frame)]
        if chain[-1] != self._root:
            builder.unrecorded.append(
                f"frame {frame}: it is not connected to {self._root!r}, its tree ends at {chain[-1]!r}"
            )
            return
        edges = self._edges_of(chain[:-1])
        moves = any(edge.moves for edge in edges.values())
        lacks = bool(rate_hz) and not moves
        if lacks:
            builder.unrecorded.append(
                f"frame {frame}: it is told never to move, and the log map says that its places are "
                f"published {rate_hz:g} times a second"
            )
        t, positions = self._positions(builder, origin_ns, edges, when_told=lacks)
        once = all(len(edge.values) == 1 for edge in edges.values())
        constant = not (moves or lacks) and once and self._since_s(builder, origin_ns, edges) == -np.inf
        if not len(t):
            empty = [one for one in chain[:-1] if one in self._settled and not len(self._settled[one].t)]
            why = f"the transforms up to {self._root!r} never overlap in time"
            if empty:
                why = f"the transforms of {empty[0]!r} contradict each other at each of their stamps"
            builder.unrecorded.append(f"frame {frame}: {why}")
            return
        for one in [one for one in edges if one not in self._restated]:
            self._restated.add(one)  # once for each frame, however many are below it
            message = (
                "its static transform was told anew with another value; each holds from when it was told"
            )
            builder.defect("restated_transform", f"frame {one}", len(edges[one].values[1:]), message)
            if edges[one].moves:
                message = "its transform is told as one that never moves, too; how it moves counts"
                builder.defect("static_and_moving", f"frame {one}", len(edges[one].static), message)
        contested = [span for one in chain[:-1] for span in self._contested.get(one, ())]
        holes = self._holes if moves else ()
        unknown: dict[str, Any] = {"holes": holes, "contested": contested, "constant": constant}
        unknown["stated_rate_hz"] = rate_hz
        name = "::".join((body.id, *body.links))
        builder.add_signal(f"position/{name}", "m", t, positions, source=OF_FRAMES, **unknown)

    def leads_to_root(self, frame: str) -> bool:
        """Whether a frame is the root, or recorded transforms lead from it there.

        Raises:
            LogError: It has a cycle or two parents above it.
        """
        name = _frame(frame)
        return [name, *self._ancestors(name)][-1] == self._root

    def transformed(
        self,
        builder: TrialBuilder,
        origin_ns: int,
        place: Placed,
    ) -> tuple[FloatArray, FloatArray, list[Span], list[Span]]:
        """Positions given in another frame, in the root.

        They are one more transform at the end of the frame's chain, so they are seen when the slowest
        of all is.

        Args:
            builder: Of the trial.
            origin_ns: Trial time 0, ns.
            place: The positions; transforms lead from their frame to the root.

        Returns:
            Times, s, and positions, m; stretches that are missing or contested of the transforms.
        """
        edge, count = _Edge(), len(place.stamps_ns)
        turns = np.zeros((4, count))
        turns[3] = 1.0
        edge.add_many(slice(0, count), place.stamps_ns, (*place.positions_m.T, *turns), 1.0)
        frame = _frame(place.frame)
        above = self._edges_of([one for one in (frame, *self._ancestors(frame)) if one != self._root])
        t, positions = self._positions(builder, origin_ns, {place.name: edge, **above})
        holes = [*self._holes] if any(one.moves for one in above.values()) else []
        return t, positions, holes, [span for one in above for span in self._contested.get(one, ())]

    def _edges_of(self, chain: Sequence[str]) -> dict[str, _Edge]:
        return {frame: next(iter(self._edges[frame].values())) for frame in chain}

    def _positions(
        self, builder: TrialBuilder, origin_ns: int, chain: Mapping[str, _Edge], *, when_told: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """The positions of the first frame of a chain, at the times that all its transforms cover.

        Of one that never moves those are all times, or those alone at which it was told.
        """
        moving = {
            frame: self._moving(builder, origin_ns, frame, edge)
            for frame, edge in chain.items()
            if edge.moves
        }
        t = (
            seen_by_all([edge.t for edge in moving.values()])
            if moving
            else _told_s(origin_ns, chain)
            if when_told
            else self._all_times(builder, origin_ns)
        )
        # No extrapolation, and none across a silence: every transform must be known at every time.
        for settled in moving.values():
            t = t[settled.covers(t)]
        # What never moves was there before it was told; what was told late may have been another one before.
        t = t[t >= self._since_s(builder, origin_ns, chain)]
        courses = [
            moving[frame].at(t) if frame in moving else edge.standing(t, origin_ns)
            for frame, edge in chain.items()
        ]
        position: FloatArray = np.empty((len(t), 3))
        # Absurd numbers become infinite, which the builder leaves out and counts.
        with np.errstate(over="ignore", invalid="ignore"):
            for first in range(0, len(t), _BLOCK_ROWS):
                some = slice(first, first + _BLOCK_ROWS)
                chain_there = [course.stretch(some) for course in courses[1:]]
                for axis, values in enumerate(_composed(courses[0].origin(some), chain_there)):
                    position[some, axis] = values
        return t, position

    def _since_s(self, builder: TrialBuilder, origin_ns: int, chain: Mapping[str, _Edge]) -> float:
        """From when on all static transforms of a chain hold, s."""
        still = [edge.static for edge in chain.values() if edge.static and not edge.moves]
        firsts_ns = [min(at_ns for at_ns, _ in static) for static in still]
        return max([-np.inf, *map(builder.holds_from_s, times_s(firsts_ns, origin_ns).tolist())])

    def _all_times(self, builder: TrialBuilder, origin_ns: int) -> FloatArray:
        """The times for a frame that never moves: it was there all the time, whatever else was recorded."""
        edges = [edge for parents in self._edges.values() for edge in parents.values() if edge.moves]
        stamps_ns = [edge.stamps_ns for edge in edges] or [np.zeros(0, dtype=np.int64)]
        return throughout(times_s(distinct(np.concatenate(stamps_ns)), origin_ns), builder.recorded)

    def _moving(self, builder: TrialBuilder, origin_ns: int, frame: str, edge: _Edge) -> _Settled:
        """The samples of a moving transform, settled."""
        # Once for each frame: the links of a robot share most of their chains, and defects count once.
        if frame not in self._settled:
            settled = settle(times_s(edge.stamps_ns, origin_ns), edge.columns.T)
            if settled.largest_step_back_s > LARGEST_STEP_BACK_S:
                raise LogError(
                    f"time runs backwards by {settled.largest_step_back_s:.3f} s in frame {frame!r}",
                    file=self._file,
                    hint="the file seems to hold two recordings, or the simulation was reset: "
                    "score them one by one",
                )
            where = f"frame {frame}"
            builder.defect(
                "disordered_stamps", where, settled.disordered, "stamps ran backwards; samples were sorted"
            )
            builder.defect(
                "repeated_stamps",
                where,
                settled.repeated,
                "stamps were repeated; of those that agree one was kept",
            )
            builder.defect(
                "contradicting_stamps",
                where,
                settled.contradicting,
                "transforms of one stamp contradict each other",
            )
            builder.defect(
                "impossible_values", where, settled.not_finite, "places too far away were left out, as gaps"
            )
            self._settled[frame] = _Settled(settled.t, settled.values.T)
        return self._settled[frame]


def _told_s(origin_ns: int, chain: Mapping[str, _Edge]) -> FloatArray:
    """When static transforms of a chain were told, s, in time order."""
    return distinct(times_s([at_ns for edge in chain.values() for at_ns, _ in edge.static], origin_ns))


def _turned_alike(row: _Row) -> _Row:
    """A value with the one of its two quaternions whose last number that is not 0 is positive."""
    x, y, z, a, b, c, w = row
    return (x, y, z, -a, -b, -c, -w) if (w, c, b, a) < (0.0, 0.0, 0.0, 0.0) else row


def _frame(name: str) -> str:
    # tf wrote a leading slash, tf2 does not.
    return name.lstrip("/")


def _is_unit(quaternion: Sequence[float]) -> bool:
    return abs(math.hypot(*quaternion) - 1.0) <= LARGEST_NORM_ERROR


def are_units(quaternion: Sequence[FloatArray]) -> NDArray[np.bool_]:
    """As `_is_unit`, which is asked where rounding could decide, so that both ways to decode agree."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        error = np.abs(_norm(quaternion) - 1.0)
        units: NDArray[np.bool_] = error <= LARGEST_NORM_ERROR
        near = np.flatnonzero(np.abs(error - LARGEST_NORM_ERROR) < 1e-9)
    for i in near.tolist():
        units[i] = _is_unit([float(column[i]) for column in quaternion])
    return units


def _turn(codes: IntArray) -> int:
    """The period with which some numbers repeat to the end, all different within it; 0 without one."""
    if not len(codes):
        return 0
    again = np.flatnonzero(codes[1 : _LONGEST_TURN + 1] == codes[:1])
    turn = int(again[0]) + 1 if len(again) else len(codes)
    if turn > _LONGEST_TURN or len(codes) % turn:
        return 0
    turns = codes.reshape(-1, turn)
    alike = bool((turns == turns[0]).all()) and len(set(turns[0].tolist())) == turn
    return turn if alike else 0


def _keys(codes: IntArray, limit: int) -> list[int]:
    """The distinct numbers, increasing, of some below a limit."""
    if limit > _FEW_CODES:
        return [int(code) for code in distinct(codes)]
    return [int(code) for code in np.flatnonzero(np.bincount(codes))]


def _even(places: NDArray[np.intp]) -> NDArray[np.intp] | slice:
    """Increasing places, as a slice where they are evenly spaced: slices are copied much faster."""
    if len(places) < _FEW_PLACES:
        return places
    step = int(places[1] - places[0])
    if (np.diff(places) != step).any():
        return places
    return slice(int(places[0]), int(places[-1]) + 1, step)


def _norm(quaternion: FloatArray | Sequence[FloatArray]) -> FloatArray:
    """The norms of quaternions given by their four columns."""
    x, y, z, w = quaternion
    norm: FloatArray = np.sqrt(x * x + y * y + z * z + w * w)
    return norm


def _make_continuous(quaternions: FloatArray) -> None:
    """Turn quaternions, shape (4, n), in place into unit ones, each on the hemisphere of the one before."""
    sign, last = 1.0, np.zeros((4, 1))
    for first in range(0, quaternions.shape[1], _BLOCK_ROWS):
        block = quaternions[:, first : first + _BLOCK_ROWS]
        unit = block / _norm(block)
        x, y, z, w = unit * np.concatenate((last, unit[:, :-1]), axis=1)
        last = unit[:, -1:].copy()
        turned = np.cumsum(x + y + z + w < 0) % 2
        np.multiply(unit, np.where(turned, -sign, sign), out=block)
        sign = -sign if turned[-1] else sign


def _composed(origin: FloatArray, chain: Sequence[_PoseColumns]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The position of a point in the last frame of a chain.

    Args:
        origin: Its x, y, z in the first frame, m, shape (3, n), or (3, 1) where it never moves.
        chain: The poses of each frame in the next one: x, y, z in m as above, then a quaternion
            x, y, z, w of any norm, shape (4, n) or (4, 1).

    Returns:
        Its x, y and z in the last one, each of shape (n,) or (1,), in m.
    """
    x, y, z = origin + 0.0  # -0.0 becomes 0.0, as it does in every step below
    for (at_x, at_y, at_z), turn in chain:
        a, b, c, w = turn / _norm(turn)
        # v + 2 (w (q x v) + q x (q x v)): fewer operations than two products of quaternions.
        p, q, r = b * z - c * y, c * x - a * z, a * y - b * x
        x = x + 2 * (w * p + (b * r - c * q)) + at_x
        y = y + 2 * (w * q + (c * p - a * r)) + at_y
        z = z + 2 * (w * r + (a * q - b * p)) + at_z
    return x, y, z
