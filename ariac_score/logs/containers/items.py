"""The items that a scan of any container yields: connections, messages, and batches of messages."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ariac_score.errors import LogError

__all__ = [
    "METADATA",
    "METADATA_KEY",
    "RE_RECORD",
    "Batch",
    "Bytes",
    "Connection",
    "IntArray",
    "Item",
    "Message",
    "Payloads",
    "Scan",
    "checked_stamp",
    "normalised_type",
    "with_slash",
]


IntArray = NDArray[np.int64]


Bytes = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Payloads:
    """Serialised messages in one buffer.

    Attributes:
        buffer: The bytes; anything may lie between the messages.
        starts: Where each message starts, shape (n,).
        ends: Where it ends, shape (n,); within the buffer.
    """

    buffer: Bytes
    starts: IntArray
    ends: IntArray

    @classmethod
    def joined(cls, payloads: Iterable[bytes | memoryview]) -> Payloads:
        """Separate messages, copied one after the other."""
        parts = list(payloads)
        ends = np.cumsum(np.fromiter(map(len, parts), np.int64, len(parts)))
        starts = np.concatenate(([0], ends[:-1])).astype(np.int64) if parts else ends
        return cls(np.frombuffer(b"".join(parts), dtype=np.uint8), starts, ends)

    def __len__(self) -> int:
        return len(self.starts)

    def one(self, index: int) -> bytes:
        """The bytes of one message."""
        return self.buffer[self.starts[index] : self.ends[index]].tobytes()


_LATEST_NS = 2**63
"""ROS keeps times in signed 64 bits of nanoseconds, which end in the year 2262."""


_TWO_PART_TYPE = re.compile(r"([A-Za-z]\w*)/([A-Za-z]\w*)", re.ASCII)


RE_RECORD = "record the trial again, or take another copy of the file; a score may not rest on part of a log"


@dataclass(frozen=True, eq=False)
class Connection:
    """One publisher's (or channel's) declaration in a recording; compared by identity.

    Attributes:
        topic: With leading slash.
        type: `package/msg/Name`; empty when the container does not give it.
        encoding: `cdr`, `ros1`, or whatever the container names.
        definition: Text of the message definition; empty when the recording has none.
        definition_format: `ros1msg`, `ros2msg` or `ros2idl`; empty without definition.
        publisher: Who sent its messages, such as a node; empty when the container does not say.
        sees_losses: Whether what was lost on its way to the recorder shows. `False` only of a recording made
            through a source that drops messages and says nothing of it.
    """

    topic: str
    type: str
    encoding: str
    definition: str = ""
    definition_format: str = ""
    publisher: str = ""
    sees_losses: bool = True


class Message(NamedTuple):
    """One recorded message: connection, log time in ns, bytes, and number (0: it has none)."""

    connection: Connection
    stamp_ns: int
    payload: bytes | memoryview
    sequence: int = 0


@dataclass(frozen=True, eq=False)
class Batch:
    """Many recorded messages, in recorded order.

    Attributes:
        connections: All that sent one of the messages.
        sources: The index of each message's connection among these, shape (n,).
        stamps_ns: Their log times in ns, each verified to be valid, shape (n,).
        payloads: Their bytes.
        sequences: Numbers by their publishers, shape (n,); `None` where the container has none.
    """

    connections: tuple[Connection, ...]
    sources: IntArray
    stamps_ns: IntArray
    payloads: Payloads
    sequences: IntArray | None = None

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def messages(self) -> Iterator[Message]:
        """One by one."""
        raw = memoryview(self.payloads.buffer)  # type: ignore[arg-type]  # an array is a buffer
        places = zip(self.payloads.starts.tolist(), self.payloads.ends.tolist(), strict=True)
        for source, stamp_ns, (start, end) in zip(
            self.sources.tolist(), self.stamps_ns.tolist(), places, strict=True
        ):
            yield Message(self.connections[source], stamp_ns, raw[start:end])


Item = Connection | Message | Batch


class Scan(Protocol):
    """One recording, read once from start to end.

    Iterating yields every declared connection before its first message, and the
    messages in recorded order, singly or in batches. Their bytes are valid until the next
    item, for their memory is reused. It raises `LogError` where the recording stops being
    readable, and at the end when it turns out not to be whole.

    Attributes:
        format: In words.
    """

    format: str

    @property
    def readable(self) -> str:
        """How far reading got, such as `byte 10344`."""
        ...

    @property
    def share(self) -> float:
        """The share read, 0 to 1."""
        ...

    @property
    def index_contradictions(self) -> int:
        """How often its index contradicted its records, of which the records counted."""
        ...

    def __iter__(self) -> Iterator[Item]:
        """Every declared connection and message."""
        ...


def normalised_type(name: str) -> str:
    """The one spelling of a message type.

    >>> normalised_type("nist_gear/Order")
    'nist_gear/msg/Order'
    """
    parts = _TWO_PART_TYPE.fullmatch(name)
    return f"{parts[1]}/msg/{parts[2]}" if parts else name


def with_slash(topic: str) -> str:
    """The one spelling of a topic: a recorder that spells it otherwise means no other.

    >>> with_slash("tf")
    '/tf'
    """
    return f"/{topic.lstrip('/')}"


def checked_stamp(stamp_ns: object, *, file: Path, place: str) -> int:
    """A log time, after verifying that it is valid.

    Raises:
        LogError: It is negative, beyond the year 2262, or no whole number.
    """
    if not isinstance(stamp_ns, int) or not 0 <= stamp_ns < _LATEST_NS:
        raise LogError(f"{stamp_ns!r} is no log time", file=file, place=place, hint=RE_RECORD)
    return stamp_ns


METADATA = "metadata.yaml"


METADATA_KEY = "rosbag2_bagfile_information"
"""The file that a rosbag2 folder holds besides its storage files, and the key in it."""
