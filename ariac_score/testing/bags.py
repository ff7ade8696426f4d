"""Writing small recordings for tests, with the same bytes every time."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal
from zlib import crc32

import numpy as np
from rosbags import rosbag1, rosbag2
from rosbags.interfaces import Connection, Nodetype
from rosbags.typesys.store import Typestore

from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.logs.containers.inflating import inflate
from ariac_score.testing.repacked import McapForm, repacked

__all__ = ["Recorded", "Storage", "write_bag"]

_CHUNK = 0x06
"""Opcode of an MCAP chunk."""

Storage = Literal["ros1", "sqlite3", "mcap"]


@dataclass(frozen=True)
class Recorded:
    """One message to be recorded.

    Attributes:
        topic: Name with leading slash.
        type: `package/msg/Name`, one of rosbags' stock types or of `ariac_score/logs/msg`.
        t_ns: Log time, ns.
        fields: Field values; messages are mappings, sequences of them lists. What is
            left out is zero, empty or false.
        publisher: The node that sent it, in ROS 1; its topic has a connection for each.
        sequence: What its publisher numbers it, in MCAP; 0: not numbered.
    """

    topic: str
    type: str
    t_ns: int
    fields: Mapping[str, Any]
    publisher: str = ""
    sequence: int = 0


def write_bag(
    path: Path,
    messages: Sequence[Recorded],
    *,
    storage: Storage,
    compression: str = "",
    chunk_bytes: int = 1 << 20,
) -> Path:
    """Write a recording with its message definitions.

    Args:
        path: A `.bag` file for `ros1`; for the others a folder, or a `.db3` or `.mcap` file.
        messages: In recorded order.
        storage: The format.
        compression: `bz2` or `lz4` for `ros1`, `zstd` for `mcap`, empty for none.
        chunk_bytes: A chunk of `ros1` is closed once it has more bytes.

    Returns:
        The path.

    Raises:
        ValueError: The format does not know the compression, or a field does not exist.
    """
    if compression not in {"ros1": ("", "bz2", "lz4"), "sqlite3": ("",), "mcap": ("", "zstd")}[storage]:
        raise ValueError(f"{storage} does not know compression {compression!r}")
    if storage == "ros1":
        _write_ros1(path, messages, compression, chunk_bytes)
    elif path.suffix in (".db3", ".mcap"):
        # rosbags writes folders alone; the one file in it is what is wanted.
        with TemporaryDirectory() as parent:
            folder = Path(parent, path.stem)
            _write_ros2(folder, messages, storage, compression)
            path.write_bytes(next(folder.glob(f"*{path.suffix}")).read_bytes())
    else:
        _write_ros2(path, messages, storage, compression)
    return path


def _write_ros1(path: Path, messages: Sequence[Recorded], compression: str, chunk_bytes: int) -> None:
    store = bundled_typestore(1)
    writer = rosbag1.Writer(path)
    writer.chunk_threshold = chunk_bytes
    if compression:
        writer.set_compression(rosbag1.Writer.CompressionFormat[compression.upper()])
    with writer:
        connections: dict[tuple[str, str, str], Connection] = {}
        for message in messages:
            key = message.topic, message.type, message.publisher
            if key not in connections:
                connections[key] = writer.add_connection(
                    message.topic, message.type, typestore=store, callerid=message.publisher or None
                )
            built = _built(store, message.type, message.fields)
            writer.write(connections[key], message.t_ns, store.serialize_ros1(built, message.type))


def _write_ros2(
    path: Path, messages: Sequence[Recorded], storage: Literal["sqlite3", "mcap"], compression: str
) -> None:
    store = bundled_typestore(2)
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage.upper()])
    if compression:
        writer.set_compression(rosbag2.CompressionMode.STORAGE, rosbag2.CompressionFormat.ZSTD)
    with writer:
        connections: dict[tuple[str, str], Connection] = {}
        for message in messages:
            key = message.topic, message.type
            if key not in connections:
                connections[key] = writer.add_connection(*key, typestore=store)
            built = _built(store, message.type, message.fields)
            # Little-endian by name, so that the bytes do not depend on the machine.
            payload = store.serialize_cdr(built, message.type, little_endian=True)
            writer.write(connections[key], message.t_ns, payload)
    numbers = tuple(message.sequence for message in messages)
    for file in path.glob("*.mcap"):
        raw = file.read_bytes()
        numbered = repacked(raw, McapForm(compression, sequences=numbers)) if any(numbers) else raw
        file.write_bytes(_with_chunk_crcs(numbered))


def _with_chunk_crcs(mcap: bytes) -> bytes:
    """The same file with chunk checksums, which rosbags leaves out and recorders write."""
    out, at = bytearray(mcap), 8  # the magic is 8 bytes, at both ends
    while at < len(mcap) - 8:
        op, length = struct.unpack_from("<BQ", mcap, at)
        body = at + 9
        if op == _CHUNK:
            size, _, name_length = struct.unpack_from("<QII", mcap, body + 16)
            records = body + 32 + name_length + 8
            compression = mcap[body + 32 : body + 32 + name_length].decode()
            checksum = crc32(inflate(mcap[records : body + length], compression, size=size))
            struct.pack_into("<I", out, body + 24, checksum)
        at = body + length
    return bytes(out)


def _built(store: Typestore, type_: str, given: Mapping[str, Any]) -> Any:
    """A message object with the given fields."""
    fields = dict(store.fielddefs[type_][1])
    # Headers have `seq` in ROS 1 alone; one set of fields serves both.
    unknown = sorted(given.keys() - fields.keys() - {"seq"})
    if unknown:
        raise ValueError(f"{type_} has no field {unknown[0]!r}; it has {', '.join(fields)}")
    values = [_value(store, description, given.get(name)) for name, description in fields.items()]
    return store.types[type_](*values)


def _value(store: Typestore, description: Any, given: Any) -> Any:
    kind, detail = description
    if kind == Nodetype.NAME:
        return _built(store, detail, given or {})
    if kind == Nodetype.BASE:
        return given if given is not None else _ZEROS.get(detail[0], 0)
    element, length = detail
    # A sequence that is not given is empty; an array always has its length.
    count = length if kind == Nodetype.ARRAY and given is None else 0
    elements = [None] * count if given is None else list(given)
    # rosbags takes numbers as arrays of their exact type, and everything else as lists.
    if element[0] == Nodetype.BASE and element[1][0] != "string":
        return np.array(
            [0 if e is None else e for e in elements], dtype=_DTYPES.get(element[1][0], element[1][0])
        )
    return [_value(store, element, e) for e in elements]


_ZEROS: Mapping[str, Any] = {"string": "", "bool": False, "float32": 0.0, "float64": 0.0}
_DTYPES: Mapping[str, str] = {"byte": "uint8", "char": "uint8", "octet": "uint8"}
