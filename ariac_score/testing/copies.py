"""Copies of a recording whose messages can be left out, moved, changed and added to."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags import rosbag1, rosbag2
from rosbags.typesys.store import Typestore

from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.logs.columnar.types import UnknownTypeError, compiled_store_of
from ariac_score.logs.containers.detect import looks_like_recording, open_scan
from ariac_score.logs.containers.items import Batch, Connection, Message

__all__ = ["Copy", "changed", "fields_of"]

_NOT_ONE = "only ROS recordings (.bag, .db3, .mcap, rosbag2 folders) are doctored"


@dataclass(frozen=True)
class Copy:
    """The messages of a recording, in recorded order.

    Attributes:
        messages: All of them, with their bytes.
        suffix: Of the file that it can be written to: `.bag` (ROS 1) or `.mcap`.
    """

    messages: tuple[Message, ...]
    suffix: str

    @classmethod
    def of(cls, path: Path) -> Copy:
        """The messages of a recording.

        Raises:
            LogError: It is damaged.
            NothingToScoreError: It is no ROS recording.
        """
        if not path.exists() or not looks_like_recording(path):
            raise NothingToScoreError(
                _NOT_ONE if path.exists() else "no such file or folder", file=path, hint="give a recording"
            )
        found: list[Message] = []
        for item in open_scan(path):
            if isinstance(item, Batch):
                found.extend(m._replace(payload=bytes(m.payload)) for m in _messages(item))
            elif isinstance(item, Message):
                found.append(item._replace(payload=bytes(item.payload)))
        if not found:
            raise NothingToScoreError("the recording holds no message", file=path)
        ros1 = found[0].connection.encoding == "ros1"
        return cls(tuple(found), ".bag" if ros1 else ".mcap")

    @cached_property
    def topics(self) -> tuple[str, ...]:
        """The names of its topics, sorted."""
        return tuple(sorted({message.connection.topic for message in self.messages}))

    def of_topic(self, topic: str) -> list[Message]:
        """The messages of one topic."""
        return [message for message in self.messages if message.connection.topic == topic]

    def keeping(self, keeps: Callable[[Message], bool]) -> Copy:
        """The copy with some messages only."""
        return replace(self, messages=tuple(message for message in self.messages if keeps(message)))

    def with_changed(self, change: Callable[[Message], Message]) -> Copy:
        """The copy with other messages in their places; in order of time again where times changed."""
        return replace(
            self, messages=tuple(sorted(map(change, self.messages), key=lambda message: message.stamp_ns))
        )

    def with_more(self, more: Iterable[Message]) -> Copy:
        """The copy with further messages, each behind those of its time."""
        return replace(
            self, messages=tuple(sorted((*self.messages, *more), key=lambda message: message.stamp_ns))
        )

    def write(self, stem: Path) -> Path:
        """Write it, with the right suffix.

        Numbers that publishers gave their messages are not kept: who leaves out messages numbers the others
        anew.

        Raises:
            LogError: A type of its messages is not known, or there is no message.
        """
        path = stem.with_name(stem.name + self.suffix)
        if not self.messages:
            raise LogError("no message is left", file=path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            (_write_ros1 if self.suffix == ".bag" else _write_mcap)(path, self.messages)
        return path


def _messages(batch: Batch) -> Iterable[Message]:
    numbers = [0] * len(batch) if batch.sequences is None else batch.sequences.tolist()
    for message, number in zip(batch.messages(), numbers, strict=True):
        yield message._replace(sequence=number)


def fields_of(message: Message) -> Any:
    """A message with its fields as attributes, which may be set."""
    store = _store(message.connection)
    read = store.deserialize_ros1 if message.connection.encoding == "ros1" else store.deserialize_cdr
    return read(bytes(message.payload), message.connection.type)


def changed(message: Message, fields: Any) -> Message:
    """The message with other fields."""
    store, name = _store(message.connection), message.connection.type
    if message.connection.encoding == "ros1":
        return message._replace(payload=bytes(store.serialize_ros1(fields, name)))
    return message._replace(payload=bytes(store.serialize_cdr(fields, name, little_endian=True)))


@lru_cache(maxsize=256)
def _store(connection: Connection) -> Typestore:
    try:
        return compiled_store_of(connection)
    except UnknownTypeError as error:
        raise LogError(f"messages of {connection.topic} cannot be copied: {error}") from error


def _write_ros1(path: Path, messages: Sequence[Message]) -> None:
    path.unlink(missing_ok=True)
    with rosbag1.Writer(path) as writer:
        made: dict[tuple[str, str, str], Any] = {}
        for message in messages:
            source = message.connection
            key = source.topic, source.type, source.publisher
            if key not in made:
                made[key] = writer.add_connection(
                    source.topic, source.type, typestore=_store(source), callerid=source.publisher or None
                )
            writer.write(made[key], message.stamp_ns, message.payload)


def _write_mcap(path: Path, messages: Sequence[Message]) -> None:
    # rosbags writes folders alone; the one file in it is what is wanted.
    with TemporaryDirectory() as parent:
        folder = Path(parent, "copy")
        with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
            made: dict[tuple[str, str], Any] = {}
            for message in messages:
                source = message.connection
                key = source.topic, source.type
                if key not in made:
                    made[key] = writer.add_connection(*key, typestore=_store(source))
                writer.write(made[key], message.stamp_ns, message.payload)
        (file,) = folder.glob("*.mcap")
        path.write_bytes(file.read_bytes())
