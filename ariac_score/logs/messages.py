"""Every message of a recording, decoded: for commands that look at messages and not at a trial."""

from __future__ import annotations

from collections.abc import Iterator
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

from ariac_score.documents.given import path_of
from ariac_score.errors import LogError
from ariac_score.logs.columnar.types import Decode, UnknownTypeError, decoder_for
from ariac_score.logs.containers.folder import FolderScan
from ariac_score.logs.containers.items import Batch, Connection, Message, Scan
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.ros1 import Ros1Scan
from ariac_score.logs.containers.sqlite import SqliteScan

__all__ = ["RecordedMessage", "RecordingKind", "read_messages"]

RecordingKind: TypeAlias = Literal["bag", "mcap"]


class RecordedMessage(NamedTuple):
    """One message of a recording.

    Attributes:
        topic: As recorded, with its leading slash.
        stamp_ns: When it was recorded.
        fields: Its fields, as values of JSON.
    """

    topic: str
    stamp_ns: int
    fields: dict[str, Any]


def read_messages(
    path: str | PathLike[str], *, kind: RecordingKind | None = None
) -> Iterator[RecordedMessage]:
    """The messages of a recording, in recorded order.

    Args:
        path: A file `.mcap`, `.bag` or `.db3`, or a folder of them.
        kind: `mcap`, or `bag` for all others; by default as its name says.

    Raises:
        LogError: The recording is damaged, or a message cannot be decoded.
    """
    path = path_of(path, "the path of a recording")
    decoders: dict[Connection, Decode] = {}
    connection = None
    try:
        for item in _one_by_one(_scan(path, kind)):
            connection = item.connection
            # By connection: publishers of one topic may use different versions of its type.
            if connection not in decoders:
                decoders[connection] = decoder_for(connection)
            fields = _plain(decoders[connection](item.payload))
            yield RecordedMessage(connection.topic, item.stamp_ns, fields)
    except UnknownTypeError as error:
        topic = connection.topic if connection else ""
        raise LogError(
            f"a message on {topic!r} cannot be decoded: {error}",
            file=path,
            hint="record it with its message definitions",
        ) from error
    except OSError as error:
        raise LogError(f"it cannot be read: {error.strerror}", file=path, hint="check the path") from error


def _one_by_one(scan: Scan) -> Iterator[Message]:
    """The messages of a scan, one at a time."""
    for item in scan:
        if isinstance(item, Message):
            yield item
        elif isinstance(item, Batch):
            yield from item.messages()


def _scan(path: Path, kind: RecordingKind | None) -> Scan:
    if path.is_dir():
        return FolderScan(path)
    if (kind or path.suffix.lstrip(".")) == "mcap":
        return McapScan(path)
    return SqliteScan(path) if path.suffix == ".db3" else Ros1Scan(path)


def _plain(message: Any) -> Any:
    """A decoded message as values of JSON; constants of the type are left out."""
    fields = getattr(message, "__dataclass_fields__", None)
    if fields is not None:
        return {name: _plain(getattr(message, name)) for name in fields if name != "__msgtype__"}
    if hasattr(message, "tolist"):
        return message.tolist()
    if isinstance(message, list | tuple):
        return [_plain(item) for item in message]
    return message
