"""The wanted fields of the wanted topics of a recording, each as one array."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score.logs.columnar import Column, ColumnDecoder
from ariac_score.logs.columnar.message_buffer import Pending, Waiting
from ariac_score.logs.columnar.plan import PlanError
from ariac_score.logs.columnar.types import UnknownTypeError, column_decoder_for
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Batch, Connection, IntArray
from ariac_score.logs.gather.array_growth import GrowthForecast

__all__ = ["Table", "read_tables"]

_LARGEST_GUESS = 1 << 26
"""The most elements that room is made for in advance: 512 MB of float64, if all were written to."""


@dataclass(frozen=True, eq=False)
class Table:
    """The messages of one connection as columns.

    Attributes:
        topic: Its name.
        type: `package/msg/Name`.
        stamps_ns: Log times of its sound messages, shape (n,).
        columns: Its wanted fields by path.
        defects: How many messages do not fit their definition.
        unreadable: Why none of its messages can be decoded; empty when they can.
    """

    topic: str
    type: str
    stamps_ns: IntArray
    columns: Mapping[str, Column] = field(default_factory=dict)
    defects: int = 0
    unreadable: str = ""


class _Grown:
    """An array that grows at its end."""

    def __init__(self, dtype: np.dtype[Any]) -> None:
        self._values = np.empty(0, dtype=dtype)
        self._used, self._foreseen = 0, GrowthForecast(_LARGEST_GUESS)

    def room(self, dtype: np.dtype[Any], count: int, share: float) -> NDArray[Any]:
        """The room for the next values; they count once they are added."""
        needed = self._used + count
        length = self._foreseen.length(needed, len(self._values), share)
        if length > len(self._values):
            larger = np.empty(length, dtype=dtype)
            larger[: self._used] = self._values[: self._used]
            self._values = larger
        return self._values[self._used : needed]

    def add(self, values: NDArray[Any], share: float) -> None:
        """Take some values, which the decoder may have put into that room already."""
        room = self.room(values.dtype, len(values), share)
        if values.base is not self._values:  # otherwise the decoder wrote them in place
            room[:] = values
        self._used += len(values)

    def finished(self) -> NDArray[Any]:
        return self._values[: self._used]


class _Bounds:
    """The bounds of consecutive lists.

    Joint states and poses come in lists of one length throughout, whose bounds need no memory.
    """

    def __init__(self) -> None:
        self._length, self._count = 0, 0
        self._grown: _Grown | None = None

    def add(self, bounds: IntArray, share: float) -> None:
        """Take some lists, given by their starts and the end of the last one."""
        count = len(bounds) - 1
        if not count:
            return
        length = int(bounds[1])
        even = int(bounds[-1]) == length * count and bool((np.diff(bounds) == length).all())
        if self._grown is None and even and (not self._count or length == self._length):
            self._length, self._count = length, self._count + count
            return
        if self._grown is None:
            self._grown = _Grown(np.dtype(np.int64))
            self._grown.add(np.full(self._count, self._length, dtype=np.int64), share)
        self._grown.add(np.diff(bounds), share)

    def finished(self) -> IntArray:
        if self._grown is None:
            if not self._length:
                return np.zeros(self._count + 1, dtype=np.int64)
            return np.arange(0, self._length * self._count + 1, self._length, dtype=np.int64)
        lengths = self._grown.finished()
        bounds = np.zeros(len(lengths) + 1, dtype=np.int64)
        np.cumsum(lengths, out=bounds[1:])
        return bounds


class _Growing:
    """A table while it is read."""

    def __init__(self, decoder: ColumnDecoder | None, unreadable: str = "") -> None:
        self.decoder = decoder
        self._unreadable, self._defects = unreadable, 0
        self._stamps_ns = _Grown(np.dtype(np.int64))
        self._values: dict[str, _Grown] = {}
        self._bounds: dict[str, _Bounds] = {}
        self._last: dict[
            str, Column
        ] = {}  # texts of one decoder only grow, so the last column has the codes of all

    def take(self, waiting: Waiting, share: float) -> None:
        assert self.decoder is not None

        def room(path: str, dtype: np.dtype[Any], count: int) -> NDArray[Any]:
            return self._values.setdefault(path, _Grown(dtype)).room(dtype, count, share)

        found = self.decoder.decode(waiting.payloads, room)
        self._stamps_ns.add(waiting.stamps_ns[found.rows], share)
        self._defects += len(found.defects)
        self._last = found.columns
        offsets: dict[str, IntArray] = {}
        for path, column in found.columns.items():
            self._values.setdefault(path, _Grown(column.values.dtype)).add(column.values, share)
            offsets |= dict(zip(column.levels, column.offsets, strict=True))
        for path, bounds in offsets.items():
            self._bounds.setdefault(path, _Bounds()).add(bounds, share)

    def table(self, connection: Connection) -> Table:
        offsets = {path: bounds.finished() for path, bounds in self._bounds.items()}
        columns = {
            path: Column(
                path,
                self._values[path].finished(),
                tuple(offsets[level] for level in last.levels),
                last.texts,
                last.levels,
            )
            for path, last in self._last.items()
        }
        stamps_ns = self._stamps_ns.finished()
        return Table(connection.topic, connection.type, stamps_ns, columns, self._defects, self._unreadable)


def read_tables(path: Path, wanted: Mapping[str, Iterable[str] | None], *, jobs: int = 0) -> list[Table]:
    """Read some fields of some topics.

    Args:
        path: The recording.
        wanted: Dotted paths by topic; `None` for all fields of a topic.
        jobs: Threads, of which all but one inflate its chunks; 0: as many as there are processors.

    Returns:
        A table for each connection on a wanted topic, in the order they were declared.

    Raises:
        LogError: The recording is damaged.
    """
    pending, growing = Pending(), dict[Connection, _Growing]()
    decoded = set[Connection]()
    scan = open_scan(path, jobs=jobs, topics=wanted.keys())
    for item in scan:
        if isinstance(item, Connection):
            if item.topic in wanted:
                growing[item] = _growing(item, wanted[item.topic])
                if growing[item].decoder is not None:
                    decoded.add(item)
        elif isinstance(item, Batch):
            # Numbers in the recording do not matter: each connection has a table of its own.
            for waiting in pending.take(item, decoded, 0):
                _take(waiting, growing, scan.share)
        elif item.connection in decoded:
            pending.add(item, 0)
            if pending.full:
                _take(pending.empty(), growing, scan.share)
    _take(pending.empty(), growing, 1.0)
    return [found.table(connection) for connection, found in growing.items()]


def _growing(connection: Connection, fields: Iterable[str] | None) -> _Growing:
    try:
        return _Growing(column_decoder_for(connection, fields))
    except (UnknownTypeError, PlanError) as error:
        return _Growing(None, str(error))


def _take(
    waiting: Mapping[Connection, Waiting], growing: Mapping[Connection, _Growing], share: float
) -> None:
    for connection, messages in waiting.items():
        growing[connection].take(messages, share)
