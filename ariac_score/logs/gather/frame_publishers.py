"""Which publishers sent which transforms: many share `/tf`, but one transform is the word of one of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from ariac_score.logs.columnar import Column
from ariac_score.logs.containers.items import Connection, IntArray
from ariac_score.logs.gather.numbering import Contested, contested
from ariac_score.logs.gather.transforms import are_units
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vectors import lengths

__all__ = ["FramePublishers"]

_Ends = tuple[int, int, int]
"""Number of samples, first and last stamp, ns."""

_Told = tuple[_Ends, FloatArray, bool]
"""How often and when it was told, its first value, and whether it was told otherwise, too."""

_AT_ONCE_NS = 10**9
"""Latched messages come when a recorder meets their publishers, so within 1 s their order says nothing."""

_ROUNDED_M, _ROUNDED_TURN = 1e-6, 2e-6
"""Numbers are written with 32 bits or six digits: m, and how far two unit quaternions lie apart."""


class FramePublishers:
    """Takes who sent which transform when."""

    def __init__(self) -> None:
        self._sent: dict[tuple[str, str], dict[Connection, _Ends]] = {}
        self._static: dict[tuple[str, str], dict[str, _Told]] = {}

    def take(self, connection: Connection, parents: Column, children: Column, stamps_ns: IntArray) -> None:
        """Take the transforms of some messages of a connection."""
        for frames, ends, _ in _by_frames(parents, children, stamps_ns):
            self._take(connection, *frames, ends)

    def take_one(self, connection: Connection, parent: str, child: str, stamp_ns: int) -> None:
        """Take a single transform."""
        self._take(connection, parent, child, (1, stamp_ns, stamp_ns))

    def _take(self, connection: Connection, parent: str, child: str, new: _Ends) -> None:
        sent = self._sent.setdefault((parent.lstrip("/"), child.lstrip("/")), {})
        sent[connection] = _joined(sent.get(connection, (0, *new[1:])), new)

    def contested(self) -> Iterator[tuple[str, Contested]]:
        """The frames whose transform two publishers sent at a time, each with the stretch."""
        for (_, child), sent in sorted(self._sent.items()):
            for one in contested((c.publisher, *ends) for c, ends in sent.items()):
                yield child, one

    def take_static(
        self, connection: Connection, parents: Column, children: Column, rows: FloatArray, times_ns: IntArray
    ) -> None:
        """Take the transforms of some messages that say what never moves.

        Args:
            connection: Who sent them.
            parents: Names, of each transform.
            children: Likewise.
            rows: x, y, z in m and the quaternion x, y, z, w, shape (n, 7).
            times_ns: When each was recorded, ns, shape (n,).
        """
        for frames, ends, places in _by_frames(parents, children, times_ns):
            self._take_static(connection, *frames, ends, rows[places])

    def take_one_static(
        self, connection: Connection, parent: str, child: str, row: Sequence[float], time_ns: int
    ) -> None:
        """Take a single one of these."""
        self._take_static(connection, parent, child, (1, time_ns, time_ns), np.array([row]))

    def _take_static(
        self, connection: Connection, parent: str, child: str, new: _Ends, rows: FloatArray
    ) -> None:
        rows = rows[np.isfinite(rows[:, :3]).all(axis=1) & are_units([*rows[:, 3:].T])]
        if not len(rows):  # it places nothing
            return
        told = self._static.setdefault((parent.lstrip("/"), child.lstrip("/")), {})
        ends, value, otherwise = told.get(connection.publisher, ((0, *new[1:]), rows[0], False))
        told[connection.publisher] = _joined(ends, new), value, otherwise or _differs(value, rows)

    def contested_static(self) -> Iterator[tuple[str, Contested]]:
        """The frames that two publishers place for good, not both alike, and nothing says who came later."""
        for (_, child), told in sorted(self._static.items(), key=lambda one: one[0]):
            by_name = sorted(told.items(), key=lambda one: one[0])
            for (one, (ends, value, otherwise)), (other, (others, another, too)) in combinations(by_name, 2):
                at_once = max(ends[1], others[1]) <= min(ends[2], others[2]) + _AT_ONCE_NS
                if at_once and (otherwise or too or _differs(value, another[np.newaxis])):
                    first_ns, last_ns = min(ends[1], others[1]), max(ends[2], others[2])
                    yield child, Contested(first_ns, last_ns, ((one, ends[0]), (other, others[0])))


def _by_frames(
    parents: Column, children: Column, stamps_ns: IntArray
) -> Iterator[tuple[tuple[str, str], _Ends, IntArray]]:
    """For each two frames their names, how often and when, and which transforms are theirs."""
    assert parents.texts is not None
    assert children.texts is not None
    if not len(stamps_ns):
        return
    pairs = parents.values.astype(np.int64) * len(children.texts) + children.values
    order = np.argsort(pairs, kind="stable")
    found, firsts, counts = np.unique(pairs[order], return_index=True, return_counts=True)
    ordered = stamps_ns[order]
    least, most = (reduce.reduceat(ordered, firsts) for reduce in (np.minimum, np.maximum))
    for pair, first, *ends in zip(
        found.tolist(), firsts.tolist(), counts.tolist(), least.tolist(), most.tolist(), strict=True
    ):
        parent, child = divmod(pair, len(children.texts))
        names = parents.texts[parent], children.texts[child]
        yield names, (ends[0], ends[1], ends[2]), order[first : first + ends[0]]


def _joined(known: _Ends, new: _Ends) -> _Ends:
    return known[0] + new[0], min(known[1], new[1]), max(known[2], new[2])


def _differs(value: FloatArray, rows: FloatArray) -> bool:
    """Whether one of some transforms is another one; a rotation has two quaternions."""
    units, unit = (q / lengths(q)[..., np.newaxis] for q in (rows[:, 3:], value[3:]))
    apart_m = np.abs(rows[:, :3] - value[:3]).max()
    turned = np.minimum(lengths(units - unit), lengths(units + unit))
    return bool(apart_m > _ROUNDED_M or turned.max() > _ROUNDED_TURN)
