"""Which publishers sent which transforms: many share `/tf`, but one transform is the word of one of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from ariac_score.logs.columnar import Column
from ariac_score.logs.containers.items import Connection, IntArray
from ariac_score.logs.gather.numbering import Contested, contested
from ariac_score.trial.spans import FloatArray

__all__ = ["FramePublishers"]

_Ends = tuple[int, int, int]
"""Number of samples, first and last stamp, ns."""

_AT_ONCE_NS = 10**9
"""Latched messages come when a recorder meets their publishers, so within 1 s their order says nothing."""


_ROUNDED = 1e-6
"""Places and rotations are written as 32-bit numbers, or with six digits."""


class FramePublishers:
    """Takes who sent which transform when."""

    def __init__(self) -> None:
        self._sent: dict[tuple[str, str], dict[Connection, _Ends]] = {}
        self._static: dict[tuple[str, str], dict[str, dict[tuple[float, ...], _Ends]]] = {}

    def take(self, connection: Connection, parents: Column, children: Column, stamps_ns: IntArray) -> None:
        """Take the transforms of some messages of a connection."""
        assert parents.texts is not None
        assert children.texts is not None
        if not len(stamps_ns):
            return
        pairs = parents.values.astype(np.int64) * len(children.texts) + children.values
        order = np.argsort(pairs, kind="stable")
        found, firsts, counts = np.unique(pairs[order], return_index=True, return_counts=True)
        ordered = stamps_ns[order]
        least, most = (reduce.reduceat(ordered, firsts) for reduce in (np.minimum, np.maximum))
        for pair, *ends in zip(found.tolist(), counts.tolist(), least.tolist(), most.tolist(), strict=True):
            parent, child = divmod(pair, len(children.texts))
            self._take(connection, parents.texts[parent], children.texts[child], (ends[0], ends[1], ends[2]))

    def take_one(self, connection: Connection, parent: str, child: str, stamp_ns: int) -> None:
        """Take a single transform."""
        self._take(connection, parent, child, (1, stamp_ns, stamp_ns))

    def _take(self, connection: Connection, parent: str, child: str, new: _Ends) -> None:
        sent = self._sent.setdefault((parent.lstrip("/"), child.lstrip("/")), {})
        count, first_ns, last_ns = sent.get(connection, (0, new[1], new[2]))
        sent[connection] = count + new[0], min(first_ns, new[1]), max(last_ns, new[2])

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
        assert parents.texts is not None
        assert children.texts is not None
        keys = np.column_stack((parents.values, children.values, rows))
        found, where = np.unique(keys, axis=0, return_inverse=True)
        for number, (parent, child, *row) in enumerate(found.tolist()):
            own = times_ns[where.reshape(-1) == number]
            ends = len(own), int(own.min()), int(own.max())
            self.take_one_static(
                connection, parents.texts[int(parent)], children.texts[int(child)], row, ends
            )

    def take_one_static(
        self, connection: Connection, parent: str, child: str, row: Sequence[float], ends: _Ends
    ) -> None:
        """Take one value, told so often between two times."""
        told = self._static.setdefault((parent.lstrip("/"), child.lstrip("/")), {})
        by_value = told.setdefault(connection.publisher, {})
        value = (*row[:3], *_one_way_round(row[3:]))
        count, first_ns, last_ns = by_value.get(value, (0, ends[1], ends[2]))
        by_value[value] = count + ends[0], min(first_ns, ends[1]), max(last_ns, ends[2])

    def contested_static(self) -> Iterator[tuple[str, Contested]]:
        """The frames that two publishers place differently for good, and nothing says who came later."""
        for (_, child), told in sorted(self._static.items()):
            for (one, values), (other, other_values) in combinations(sorted(told.items()), 2):
                for value, (count, first_ns, last_ns) in values.items():
                    for other_value, (other_count, other_first_ns, other_last_ns) in other_values.items():
                        start_ns, end_ns = max(first_ns, other_first_ns), min(last_ns, other_last_ns)
                        if _differ(value, other_value) and start_ns <= end_ns + _AT_ONCE_NS:
                            whole = min(first_ns, other_first_ns), max(last_ns, other_last_ns)
                            yield child, Contested(*whole, ((one, count), (other, other_count)))


def _differ(value: Sequence[float], other: Sequence[float]) -> bool:
    return max(abs(a - b) for a, b in zip(value, other, strict=True)) > _ROUNDED


def _one_way_round(quaternion: Sequence[float]) -> tuple[float, ...]:
    """The one of the two quaternions of a rotation whose last number that is not 0 is positive."""
    turned = tuple(-number + 0.0 for number in quaternion)
    return turned if tuple(reversed(turned)) > (0.0,) * len(turned) else tuple(quaternion)
