"""Topics that show which clock a recording's nodes were on, whether or not the log map reads them.

Almost every recording has `/joint_states` or `/tf`, whose headers carry the time of their sender. Only the
stamps of a few messages are looked at, at the places where every definition of these types has them.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

import numpy as np

from ariac_score.logs.containers.items import Batch, Bytes, Connection, IntArray, Message

__all__ = ["WITNESSES", "ClockWitnesses"]

WITNESSES = frozenset({"/joint_states", "/tf"})

_STAMP_AT = {
    # ROS 1: the header begins with a number, CDR with four bytes of its own. TFMessage is a list of headers.
    "sensor_msgs/msg/JointState": 4,
    "tf2_msgs/msg/TFMessage": 8,
    "tf/msg/tfMessage": 8,
}

_LOOKED_AT = 32
"""Messages of a batch that are looked at."""


class ClockWitnesses:
    """Finds the stamps of some messages of witnesses."""

    def __init__(self) -> None:
        self._at: dict[Connection, int] = {}

    def connect(self, connection: Connection) -> None:
        """Take note of a connection."""
        name = f"/{connection.topic.lstrip('/')}"
        if name in WITNESSES and connection.type in _STAMP_AT and connection.encoding in ("ros1", "cdr"):
            self._at[connection] = _STAMP_AT[connection.type]

    def of_message(self, message: Message) -> tuple[str, IntArray, IntArray] | None:
        """Topic, header stamps and log times, ns, of a message; `None` of others."""
        if message.connection not in self._at:
            return None
        stamp_ns = self._stamp_ns(message.connection, memoryview(message.payload))
        if stamp_ns is None:
            return None
        return message.connection.topic, np.array([stamp_ns]), np.array([message.stamp_ns])

    def of_batch(self, batch: Batch) -> Iterator[tuple[str, IntArray, IntArray]]:
        """The same of some messages of a batch."""
        raw: Bytes = batch.payloads.buffer
        for place, connection in enumerate(batch.connections):
            if connection not in self._at:
                continue
            rows = np.flatnonzero(batch.sources == place)
            rows = rows[:: max(1, len(rows) // _LOOKED_AT)]
            found = [
                (stamp_ns, int(batch.stamps_ns[row]))
                for row in rows.tolist()
                if (stamp_ns := self._stamp_ns(connection, _part(raw, batch, row))) is not None
            ]
            if found:
                stamps_ns, log_ns = np.array(found, dtype=np.int64).T
                yield connection.topic, stamps_ns, log_ns

    def _stamp_ns(self, connection: Connection, payload: memoryview) -> int | None:
        at = self._at[connection]
        if len(payload) < at + 8:
            return None  # a list without transforms
        big = connection.encoding == "cdr" and payload[1] == 0
        sec, nanosec = struct.unpack_from(">II" if big else "<II", payload, at)
        return int(sec) * 10**9 + int(nanosec)


def _part(raw: Bytes, batch: Batch, row: int) -> memoryview:
    start = int(batch.payloads.starts[row])
    return memoryview(raw[start : min(int(batch.payloads.ends[row]), start + 64)].tobytes())
