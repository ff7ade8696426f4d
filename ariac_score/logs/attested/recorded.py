"""What a recording holds of its recorder, and the digests of all else."""

from __future__ import annotations

import base64
import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, TypeVar

from ariac_score.errors import LogError
from ariac_score.logs.columnar.types import Decode, UnknownTypeError, decoder_for
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Batch, Connection, Message, with_slash
from ariac_score.logs.gather.clocks import CLOCK_TOPIC, CLOCK_TYPE

__all__ = [
    "DIGEST_CHARS",
    "HEARTBEAT",
    "MANIFEST",
    "Beat",
    "Found",
    "Logged",
    "Manifest",
    "UnfitError",
    "digest_of",
    "scanned",
]

HEARTBEAT, MANIFEST = "/ariac_score/heartbeat", "/ariac_score/manifest"
DIGEST_CHARS = 16
_DIGEST_BYTES = 12


class UnfitError(Exception):
    """What the recorder says does not fit together; the text says where."""


class Beat(NamedTuple):
    """A heartbeat as it was recorded."""

    sequence: int
    recording: str
    body: str
    chain: str


class Manifest(NamedTuple):
    """A manifest as it was recorded."""

    closed: bool
    recording: str
    body: str
    signature: str


@dataclass
class Found:
    """What a recording holds: heartbeats and manifests in recorded order, digests of all other messages.

    Attributes:
        unfit: What its recorder published and nobody can read, in words; empty where all can be read.
        encodings: How the messages of the recorder are encoded.
        clock: Log time and time of each message of `/clock`, ns.
        declared: The connections of each topic.
    """

    heartbeats: list[tuple[int, Beat]] = field(default_factory=list)
    manifests: list[Manifest] = field(default_factory=list)
    unfit: str = ""
    encodings: set[str] = field(default_factory=set)
    clock: list[tuple[int, int]] = field(default_factory=list)
    declared: dict[str, dict[Connection, None]] = field(default_factory=lambda: defaultdict(dict))
    digests: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    logged: dict[str, list[Logged]] = field(default_factory=lambda: defaultdict(list))


class Logged(NamedTuple):
    """A message of the log: when, what, through whose connection, and from whom, where the log says it.

    A printed line names its node itself; a connection's name for it can be changed without the bytes.
    """

    t_ns: int
    digest: str
    publisher: str
    node: str


def scanned(path: Path) -> Found:
    """All that a recording holds."""
    found = Found()
    decoders: dict[Connection, Decode] = {}
    for message in _messages(path):
        connection, topic = message.connection, with_slash(message.connection.topic)
        if topic in (HEARTBEAT, MANIFEST):
            decode = decoders.get(connection) or decoders.setdefault(connection, _decoder(connection, path))
            found.encodings.add(connection.encoding)
            try:
                decoded = decode(message.payload)
                if topic == HEARTBEAT:
                    found.heartbeats.append((message.stamp_ns, _told(Beat, decoded)))
                else:
                    found.manifests.append(_told(Manifest, decoded))
            except (UnknownTypeError, UnfitError) as cause:
                what = "heartbeat" if topic == HEARTBEAT else "manifest"
                found.unfit = found.unfit or f"a {what} of its recorder cannot be read: {cause}"
            continue
        found.declared[topic][connection] = None
        if topic == CLOCK_TOPIC and connection.type == CLOCK_TYPE:
            # One that cannot be read is read by nobody else either, and is no reason to refuse the log.
            with suppress(UnknownTypeError, AttributeError, TypeError, ValueError):
                decode = decoders.get(connection) or decoders.setdefault(connection, decoder_for(connection))
                clock = decode(message.payload).clock  # type: ignore[attr-defined]  # rosbags makes the class
                found.clock.append((message.stamp_ns, int(clock.sec) * 10**9 + int(clock.nanosec)))
        digest, node = digest_of(message.payload), connection.publisher
        if node and connection.type == _PRINTED:
            decode = decoders.get(connection) or decoders.setdefault(connection, _decoder(connection, path))
            with suppress(UnknownTypeError):
                node = str(getattr(decode(message.payload), "name", node))
        found.digests[topic][digest] += 1
        found.logged[topic].append(Logged(message.stamp_ns, digest, connection.publisher, node))
    return found


_PRINTED = "rosgraph_msgs/msg/Log"
_Told = TypeVar("_Told", Beat, Manifest)


def _told(kind: type[_Told], message: object) -> _Told:
    """The fields of a message of the recorder.

    Raises:
        UnfitError: One is missing, or of another type.
    """
    fields = {}
    for name, wanted in {"sequence": int, "closed": bool}.items():
        if name in kind._fields:
            fields[name] = getattr(message, name, None)
            if not isinstance(fields[name], wanted):
                raise UnfitError(f"its {name!r} is missing, or is no {wanted.__name__}")
    for name in kind._fields:
        if name not in fields:
            fields[name] = getattr(message, name, None)
            if not isinstance(fields[name], str):
                raise UnfitError(f"its {name!r} is missing, or is no text")
    return kind(**fields)  # type: ignore[arg-type]  # each was looked at


def _messages(path: Path) -> Iterator[Message]:
    for item in open_scan(path, jobs=1):
        if isinstance(item, Message):
            yield item
        elif isinstance(item, Batch):
            yield from item.messages()


def _decoder(connection: Connection, path: Path) -> Decode:
    try:
        return decoder_for(connection)
    except UnknownTypeError as error:
        raise LogError(
            f"a message on {connection.topic!r} cannot be decoded: {error}",
            file=path,
            hint="record it with its message definitions",
        ) from error


def digest_of(payload: bytes | memoryview) -> str:
    """What the recorder lists of a message: 12 bytes of SHA-256, in base64."""
    return base64.b64encode(hashlib.sha256(payload).digest()[:_DIGEST_BYTES]).decode("ascii")
