"""Containers read by us and by the library of others: where both take a file for whole, both read the same.

A file that either refuses is passed over: a refusal is said in words. A message, a time or a byte that
differs where nobody says a word is a finding.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from mcap.records import Channel, Chunk, McapRecord
from mcap.records import Message as PeerMessage
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream
from rosbags.rosbag1 import Reader

from ariac_score.errors import LogError
from ariac_score.logs.containers.items import Batch, Message
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.ros1 import Ros1Scan
from fuzz.structures import mcap_records, ros1_records

__all__ = ["mcap_with_peer", "ros1_with_peer"]

_Told = list[tuple[str, int, bytes]]
_MOST_CLAIMED_BYTES = 1 << 24
"""What a file may claim of one record, so that the library of others does not try to make room for it."""


def mcap_with_peer(folder: Path, raw: bytes) -> None:
    """Compare with the library `mcap`, which reads records as a stream and checks their checksums."""
    path = folder / "log.mcap"
    path.write_bytes(raw)
    ours = _ours(McapScan(path))
    theirs = None if ours is None else _of_mcap(raw)
    assert theirs is None or ours == theirs


def ros1_with_peer(folder: Path, raw: bytes) -> None:
    """Compare with `rosbags`, which follows the indexes."""
    path = folder / "log.bag"
    path.write_bytes(raw)
    scan = Ros1Scan(path)
    ours = _ours(scan)
    if ours is None or scan.index_contradictions:
        return  # it is said that the indexes lie
    theirs = _of_rosbags(path)
    assert theirs is None or sorted(ours) == sorted(theirs)


def _ours(scan: McapScan | Ros1Scan) -> _Told | None:
    """Topic, time and payload of each message; nothing where the file is not sound."""
    found: _Told = []
    try:
        for item in scan:
            if isinstance(item, Batch):
                found += [(m.connection.topic, m.stamp_ns, bytes(m.payload)) for m in item.messages()]
            elif isinstance(item, Message):
                found.append((item.connection.topic, item.stamp_ns, bytes(item.payload)))
    except LogError:
        return None
    return found


def _of_mcap(raw: bytes) -> _Told | None:
    found: _Told = []
    topics: dict[int, str] = {}
    reader = StreamReader(
        io.BytesIO(raw), validate_crcs=True, record_size_limit=_MOST_CLAIMED_BYTES, emit_chunks=True
    )
    try:
        for record in _opened(reader):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, PeerMessage):
                found.append((topics[record.channel_id], record.log_time, record.data))
    except Exception:  # whatever it raises, it has not taken the file for whole
        return None
    return found


def _opened(reader: StreamReader) -> Iterator[McapRecord]:
    """The records, those of chunks as well.

    Raises:
        ValueError: A record in a chunk has bytes behind its last field, which the format allows. The library
            (1.6.0) takes these bytes for the next record, and says nothing.
    """
    for record in reader.records:
        if not isinstance(record, Chunk):
            yield record
            continue
        plain, _ = get_chunk_data_stream(record, validate_crc=True)
        if any(len(body) > _length(op, body) for op, body in mcap_records(plain.read(_MOST_CLAIMED_BYTES))):
            raise ValueError("padded")
        yield from breakup_chunk(record, validate_crc=True)


def _length(op: int, body: bytes) -> int:
    """Bytes of the fields of a schema or a channel; all of any other."""
    texts = {3: (2, 3), 4: (4, 3)}.get(op)
    if texts is None:
        return len(body)
    at, count = texts
    for _ in range(count):
        at += 4 + int.from_bytes(body[at : at + 4], "little")
    return at


def _of_rosbags(path: Path) -> _Told | None:
    indexes = [fields for fields, _ in ros1_records(path.read_bytes()[13:]) if (b"op", b"\4") in fields]
    if len({tuple(name for name, _ in fields) for fields in indexes}) > 1:
        return None  # the library (0.11.9) reads the fields of all where the first has them
    try:
        with Reader(path) as bag:
            return [(connection.topic, stamp, bytes(data)) for connection, stamp, data in bag.messages()]
    except Exception:  # likewise
        return None
