"""Chosen fields of the messages of a recording as columns: for readers that need all of a topic."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from os import PathLike

import numpy as np

from ariac_score.documents.given import path_of
from ariac_score.errors import LogError
from ariac_score.logs.columnar import Column, ColumnDecoder
from ariac_score.logs.columnar.message_buffer import Pending, Waiting
from ariac_score.logs.columnar.plan import PlanError
from ariac_score.logs.columnar.types import UnknownTypeError, column_decoder_for
from ariac_score.logs.containers.detect import cannot_be_read, open_scan
from ariac_score.logs.containers.items import Batch, Connection, IntArray, Message, Scan

__all__ = ["MessageColumns", "RecordedColumns", "RefusedMessage", "read_columns"]


@dataclass(frozen=True, eq=False)
class MessageColumns:
    """Some messages of one publisher, as columns.

    Attributes:
        topic: With its leading slash.
        type: `package/msg/Name`.
        numbers: Their places in the recording, counted over all its messages, increasing, shape (n,).
        log_ns: When they were recorded, shape (n,).
        columns: By dotted path of the field. A column has `values`; of a text these are indices into its
            `texts`; within an array or sequence `per_message()` says how many values each message has.
    """

    topic: str
    type: str
    numbers: IntArray
    log_ns: IntArray
    columns: Mapping[str, Column]


@dataclass(frozen=True)
class RefusedMessage:
    """A message that does not fit its definition.

    Attributes:
        topic: With its leading slash.
        number: Its place in the recording.
        log_ns: When it was recorded.
        cause: Why it does not fit.
        payload: Its bytes as recorded.
    """

    topic: str
    number: int
    log_ns: int
    cause: str
    payload: bytes


@dataclass(frozen=True, eq=False)
class RecordedColumns:
    """What `read_columns` finds.

    Attributes:
        parts: The wanted messages, in portions by publisher; `numbers` tell their order.
        refused: Wanted messages that do not fit their definition, in recorded order.
        topics: The type of every topic that the recording declares, wanted or not.
        counts: The number of messages of each.
        recorded_ns: The first and the last time of recording; `None` where there is no message.
        unreadable: Why the messages of a topic cannot be decoded at all, by topic.
    """

    parts: tuple[MessageColumns, ...] = ()
    refused: tuple[RefusedMessage, ...] = ()
    topics: Mapping[str, str] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)
    recorded_ns: tuple[int, int] | None = None
    unreadable: Mapping[str, str] = field(default_factory=dict)

    def of(self, topic: str) -> Iterator[MessageColumns]:
        """The portions of one topic."""
        return (part for part in self.parts if part.topic == topic)


def read_columns(
    path: str | PathLike[str], wanted: Mapping[str, Iterable[str]], *, jobs: int = 0
) -> RecordedColumns:
    """Chosen fields of the messages of a recording, decoded many at a time.

    Args:
        path: A file `.mcap`, `.bag` or `.db3`, or a folder of them.
        wanted: By topic the dotted paths of its fields, or of messages of which everything is wanted. Paths
            that a type does not have are left out. Where none is named, times of
            recording alone come.
        jobs: Threads that read; 0: as many as there are processors.

    Raises:
        NothingToScoreError: It is empty, or no recording.
        LogError: It breaks off, or fails a checksum.

    >>> found = read_columns("examples/kitting_near_miss.mcap", {"/ariac/orders": ["order_id"]})
    >>> [part.columns["order_id"].text() for part in found.of("/ariac/orders")]
    [['order_0', 'order_1']]
    """
    path = path_of(path, "the path of a recording")
    fields = {f"/{topic.lstrip('/')}": tuple(paths) for topic, paths in wanted.items()}
    names = frozenset(name for topic in fields for name in (topic, topic.lstrip("/")))
    scan = open_scan(path, jobs=jobs, topics=names)
    gathering = _Gathering(fields)
    try:
        for item in scan:
            gathering.take(item)
    except LogError as error:
        raise _at_break(error, scan) from error
    except (OSError, MemoryError) as error:
        raise cannot_be_read(error, path) from error
    gathering.flush()
    return gathering.found()


def _at_break(error: LogError, scan: Scan) -> LogError:
    cause = f"{error.cause}; readable up to {scan.readable}"
    return LogError(cause, file=error.file, place=error.place, hint=error.hint)


class _Gathering:
    """Takes the items of a scan and decodes what is wanted of them."""

    def __init__(self, fields: Mapping[str, tuple[str, ...]]) -> None:
        self._fields = fields
        self._pending, self._number = Pending(), 0
        self._decoders: dict[Connection, ColumnDecoder] = {}
        self._undecoded: dict[Connection, list[tuple[IntArray, IntArray]]] = {}
        self._parts: list[MessageColumns] = []
        self._refused: list[RefusedMessage] = []
        self._topics: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._unreadable: dict[str, str] = {}
        self._span_ns: tuple[int, int] | None = None

    def take(self, item: Connection | Message | Batch) -> None:
        if isinstance(item, Connection):
            self._connect(item)
        elif isinstance(item, Batch):
            self._take_many(item)
        else:
            self._number += 1
            self._count(item.connection, 1, item.stamp_ns, item.stamp_ns)
            if item.connection in self._undecoded:
                row = np.array([self._number]), np.array([item.stamp_ns])
                self._undecoded[item.connection].append(row)
            elif item.connection in self._decoders:
                self._pending.add(item, self._number)
                if self._pending.full:
                    self.flush()

    def _take_many(self, batch: Batch) -> None:
        first = self._number + 1
        self._number += len(batch)
        for place, connection in enumerate(batch.connections):
            rows = np.flatnonzero(batch.sources == place)
            stamps_ns = batch.stamps_ns[rows]
            if connection in self._undecoded:
                self._undecoded[connection].append((rows + first, stamps_ns))
            if len(stamps_ns):
                self._count(connection, len(stamps_ns), int(stamps_ns.min()), int(stamps_ns.max()))
        for waiting in self._pending.take(batch, self._decoders, first):
            self._decode(waiting)

    def _count(self, connection: Connection, count: int, first_ns: int, last_ns: int) -> None:
        topic = _named(connection)
        self._counts[topic] = self._counts.get(topic, 0) + count
        known = self._span_ns or (first_ns, last_ns)
        self._span_ns = min(known[0], first_ns), max(known[1], last_ns)

    def _connect(self, connection: Connection) -> None:
        topic = _named(connection)
        self._topics.setdefault(topic, connection.type)
        self._counts.setdefault(topic, 0)
        if topic not in self._fields:
            return
        if not self._fields[topic]:
            self._undecoded[connection] = []
            return
        try:
            self._decoders[connection] = column_decoder_for(connection, self._fields[topic])
        except (PlanError, UnknownTypeError) as error:
            self._unreadable[topic] = f"{connection.type}: {error}"

    def flush(self) -> None:
        self._decode(self._pending.empty())

    def _decode(self, waiting: Mapping[Connection, Waiting]) -> None:
        for connection, messages in waiting.items():
            topic = _named(connection)
            found = self._decoders[connection].decode(messages.payloads)
            self._parts.append(
                MessageColumns(
                    topic,
                    connection.type,
                    messages.numbers[found.rows],
                    messages.stamps_ns[found.rows],
                    found.columns,
                )
            )
            self._refused += [
                RefusedMessage(
                    topic,
                    int(messages.numbers[defect.index]),
                    int(messages.stamps_ns[defect.index]),
                    defect.cause,
                    messages.payloads.one(defect.index),
                )
                for defect in found.defects
            ]

    def found(self) -> RecordedColumns:
        for connection, rows in self._undecoded.items():
            if rows:
                numbers, stamps_ns = (np.concatenate(part) for part in zip(*rows, strict=True))
                bare = MessageColumns(_named(connection), connection.type, numbers, stamps_ns, {})
                self._parts.append(bare)
        refused = tuple(sorted(self._refused, key=lambda message: message.number))
        return RecordedColumns(
            tuple(self._parts), refused, self._topics, self._counts, self._span_ns, self._unreadable
        )


def _named(connection: Connection) -> str:
    return f"/{connection.topic.lstrip('/')}"
