"""Which publishers sent which transforms: many share `/tf`, but one transform is the word of one of them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ariac_score.logs.columnar import Column
from ariac_score.logs.containers.items import Connection, IntArray
from ariac_score.logs.gather.numbering import Contested, contested

__all__ = ["FramePublishers"]

_Ends = tuple[int, int, int]
"""Number of samples, first and last stamp, ns."""


class FramePublishers:
    """Takes who sent which transform when."""

    def __init__(self) -> None:
        self._sent: dict[tuple[str, str], dict[Connection, _Ends]] = {}

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
