"""Annotations as messages of ROS 2: their bytes, and the MCAP file they are in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from ariac_score.errors import LogError
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.trial.spans import FloatArray

__all__ = ["MONITOR_STATE", "Annotation", "States", "mcap_bytes", "recorded", "serialized", "stamp"]

MONITOR_STATE = "ariac_score_msgs/msg/MonitorState"
_END_S = 2**31
"""ROS counts seconds with 31 bits."""


class Annotation(NamedTuple):
    """One message of the recording.

    Attributes:
        t_ns: Its stamp on the clock of the log, ns.
        topic: Name with leading slash.
        type: `package/msg/Name`.
        payload: Its bytes.
    """

    t_ns: int
    topic: str
    type: str
    payload: bytes


def stamp(t_ns: int) -> dict[str, int]:
    """A time as a message has it.

    Raises:
        LogError: It is before the clock's zero, or later than a message can hold.
    """
    if t_ns < 0:
        raise LogError("times before the zero of the log's clock cannot be recorded", hint="check its stamps")
    if t_ns >= _END_S * 10**9:
        raise LogError("times after the year 2038 cannot be recorded", hint="check the stamps of the log")
    return {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}


class States:
    """The bytes of many `MonitorState` that differ in stamp, state, margin and message.

    Their places in the bytes are found by serializing a message twice: bytes that differ hold the field.
    Many messages are then made at once, by writing columns into a table of bytes.

    Args:
        fields: The values of all other fields, by name.
        frame: The tf frame in their headers.
    """

    def __init__(self, fields: Mapping[str, Any], frame: str) -> None:
        self._fields, self._frame = fields, frame
        self._plain = self._bytes()
        ones = 0x01010101  # a number of which no byte is 0
        self._seconds, self._nanoseconds = self._place(ones * 10**9), self._place(ones)
        self._state = self._place(state=1)
        self._margin = self._place(margin=float(np.full(8, 1, dtype=np.uint8).view("<f8")[0]))

    def _bytes(self, t_ns: int = 0, state: int = 0, margin: float = 0.0) -> NDArray[np.uint8]:
        header = {"stamp": stamp(t_ns), "frame_id": self._frame}
        fields = {**self._fields, "header": header, "state": state, "margin": margin}
        return np.frombuffer(serialized(MONITOR_STATE, fields), dtype=np.uint8)

    def _place(self, t_ns: int = 0, state: int = 0, margin: float = 0.0) -> NDArray[np.intp]:
        return np.flatnonzero(self._plain != self._bytes(t_ns, state, margin))

    def serialized(
        self,
        t_ns: NDArray[np.int64],
        states: NDArray[np.uint8],
        margin: FloatArray,
        messages: Mapping[int, str],
    ) -> list[bytes]:
        """The bytes of some messages.

        Args:
            t_ns: Their stamps, shape (n,).
            states: Shape (n,).
            margin: NaN without one, shape (n,).
            messages: By row, where there is one; rows beyond n are ignored.
        """
        count, size = len(t_ns), len(self._plain)
        table = np.tile(self._plain, (count, 1))
        for place, numbers in (
            (self._seconds, (t_ns // 10**9).astype("<i4")),
            (self._nanoseconds, (t_ns % 10**9).astype("<u4")),
            (self._state, states),
            (self._margin, np.where(np.isnan(margin), nan, margin).astype("<f8")),  # one of the many NaN
        ):
            table[:, place] = numbers.view(np.uint8).reshape(count, len(place))
        whole = table.tobytes()
        found = [whole[first : first + size] for first in range(0, count * size, size)]
        for row, message in messages.items():
            if row < count:
                text = message.encode()
                length = (len(text) + 1).to_bytes(4, "little")
                found[row] = b"".join((found[row][: -len(_NO_TEXT)], length, text, b"\0"))
        return found


_NO_TEXT = b"\1\0\0\0\0"
"""An empty text with its length; the message is the last field, so nothing behind it moves."""


@contextmanager
def recorded(messages: Iterable[Annotation]) -> Iterator[Path]:
    """The recording as an MCAP file with its message definitions, which exists during the body.

    Args:
        messages: In order of time.
    """
    store = bundled_typestore(2)
    with TemporaryDirectory() as parent:
        folder = Path(parent, "annotations")
        writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections: dict[str, Any] = {}
            for t_ns, topic, kind, payload in messages:
                if topic not in connections:
                    connections[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(connections[topic], t_ns, payload)
        (file,) = folder.glob("*.mcap")
        yield file


def mcap_bytes(messages: Iterable[Annotation]) -> bytes:
    """The bytes of this file."""
    with recorded(messages) as file:
        return file.read_bytes()


def serialized(kind: str, fields: Mapping[str, Any]) -> bytes:
    """A message; little-endian by name, so that the bytes do not depend on the machine.

    Args:
        kind: Its type.
        fields: Field values by name; what is left out is zero or empty.
    """
    store = bundled_typestore(2)
    return bytes(store.serialize_cdr(_built(store, kind, fields), kind, little_endian=True))


def _built(store: Any, type_: str, given: Mapping[str, Any]) -> Any:
    """A message object with the given fields, all others zero or empty."""
    fields = store.fielddefs[type_][1]
    return store.types[type_](*(_value(store, kind, given.get(name)) for name, kind in fields))


def _value(store: Any, description: Any, given: Any) -> Any:
    kind, detail = description
    if kind == Nodetype.NAME:
        return _built(store, detail, given or {})
    if kind == Nodetype.BASE:
        if given is not None:
            return given
        return "" if detail[0] == "string" else False if detail[0] == "bool" else 0
    element, _ = detail
    if element[0] == Nodetype.BASE:  # arrays of numbers stay empty
        return (
            [] if element[1][0] == "string" else np.zeros(0, dtype=_DTYPES.get(element[1][0], element[1][0]))
        )
    return [_value(store, element, each) for each in given or ()]


_DTYPES: Mapping[str, str] = {"byte": "uint8", "char": "uint8", "octet": "uint8"}
