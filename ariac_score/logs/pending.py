"""Messages waiting to be decoded together: one buffer for all topics, emptied whenever it is full."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import numpy as np

from ariac_score.logs.columnar import Payloads
from ariac_score.logs.columnar.columns import IntArray
from ariac_score.logs.salvage import Connection, Message

__all__ = ["SLAB_BYTES", "Pending", "Waiting"]

SLAB_BYTES = 16 << 20
"""So much waits at most, beyond one message: it bounds the memory that reading needs."""

_SLAB_MESSAGES = 1 << 17


@dataclass(frozen=True, eq=False)
class Waiting:
    """What waits of one connection.

    Attributes:
        numbers: Of each message its number in the recording, increasing, shape (n,).
        stamps_ns: Their log times, shape (n,).
        payloads: Their bytes.
    """

    numbers: IntArray
    stamps_ns: IntArray
    payloads: Payloads


@dataclass
class _Rows:
    numbers: array[int] = field(default_factory=lambda: array("q"))
    stamps_ns: array[int] = field(default_factory=lambda: array("q"))
    starts: array[int] = field(default_factory=lambda: array("q"))
    ends: array[int] = field(default_factory=lambda: array("q"))


class Pending:
    """Collects messages until there are enough of them to be worth decoding."""

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._rows: dict[Connection, _Rows] = {}
        self._count = 0

    @property
    def full(self) -> bool:
        """Whether it should be emptied."""
        return len(self._buffer) >= SLAB_BYTES or self._count >= _SLAB_MESSAGES

    def add(self, message: Message, number: int) -> None:
        """Take a copy of a message: what it is part of must not be kept from being freed."""
        rows = self._rows.get(message.connection)
        if rows is None:
            rows = self._rows[message.connection] = _Rows()
        buffer = self._buffer
        rows.numbers.append(number)
        rows.stamps_ns.append(message.stamp_ns)
        rows.starts.append(len(buffer))
        buffer += message.payload
        rows.ends.append(len(buffer))
        self._count += 1

    def empty(self) -> dict[Connection, Waiting]:
        """Everything that waits, which then waits no more."""
        buffer = np.frombuffer(self._buffer, dtype=np.uint8)
        waiting = {
            connection: Waiting(
                _int64(rows.numbers),
                _int64(rows.stamps_ns),
                Payloads(buffer, _int64(rows.starts), _int64(rows.ends)),
            )
            for connection, rows in self._rows.items()
        }
        self._buffer, self._rows, self._count = bytearray(), {}, 0
        return waiting


def _int64(numbers: array[int]) -> IntArray:
    return np.frombuffer(numbers, dtype=np.int64)
