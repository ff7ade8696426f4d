"""Containers read in three ways, which must say the same: whole, for some topics only, and by a plain walk.

Where all of a file is sound, a scan for some topics gives the same messages of these, and of the others
the same times; and the walk, which uses no index, finds what the scan finds. The limits from which on
something is left out are so low here that small files have it. Only where the index contradicts what a
scan for some topics does not read is there nothing to compare: what is not read is not verified.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from zlib import crc32

from ariac_score.errors import LogError
from ariac_score.logs.containers import chunk_buffers as slabs
from ariac_score.logs.containers import chunked
from ariac_score.logs.containers.inflating import inflate
from ariac_score.logs.containers.items import Batch, Message
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.ros1 import Ros1Scan
from ariac_score.testing.repacked import records
from fuzz.columns import lowered

__all__ = ["mcap_three_ways", "ros1_three_ways"]

_LOW: list[tuple[ModuleType | type, dict[str, int]]] = [
    (McapScan, {"smallest_left_out_bytes": 1}),
    (chunked, {"LARGE_MESSAGE_BYTES": 64, "USUAL_INDEX_BYTES": 64}),
    (slabs, {"SLAB_BYTES": 1 << 11}),
]
_SOME = ({"/small"}, {"/large"}, set[str]())

_Told = list[tuple[str, int, bytes]]
_Scan = Callable[..., McapScan | Ros1Scan]


def mcap_three_ways(folder: Path, raw: bytes) -> None:
    """Scan an MCAP file in all ways."""
    path = folder / "log.mcap"
    path.write_bytes(raw)
    whole = _compared(McapScan, path, crc32(raw))
    if whole is not None:
        assert whole == list(_walked_mcap(raw))


def ros1_three_ways(folder: Path, raw: bytes) -> None:
    """Scan a ROS 1 bag in all ways."""
    path = folder / "log.bag"
    path.write_bytes(raw)
    whole = _compared(Ros1Scan, path, crc32(raw))
    if whole is not None:
        assert whole == list(_walked_ros1(raw[13:], {}))


def _compared(scan: _Scan, path: Path, number: int) -> _Told | None:
    """What a file holds, if it is sound, once a scan for some topics has said nothing else.

    The number decides for which, and on how many threads.
    """
    topics, jobs = _SOME[number % 3], 1 + (number % 11 == 0)
    with lowered(_LOW):
        everything, chosen = scan(path, jobs=jobs), scan(path, jobs=jobs, topics=topics)
        (whole, is_sound), (some, some_is_sound) = _told(everything), _told(chosen)
    if chosen.index_contradictions < everything.index_contradictions:
        return whole if is_sound else None  # an index that lies about what is not read is believed
    wanted, expected = ([m for m in told if m[0] in topics] for told in (some, whole))
    if not is_sound:
        shorter = min(len(wanted), len(expected))
        assert wanted[:shorter] == expected[:shorter], topics
        return None
    assert some_is_sound, topics
    assert wanted == expected, topics
    assert [(topic, stamp) for topic, stamp, _ in some] == [(t, s) for t, s, _ in whole], topics
    return whole


def _told(scan: McapScan | Ros1Scan) -> tuple[_Told, bool]:
    """Topic, time and payload of each message, and whether the file is sound."""
    found: _Told = []
    try:
        for item in scan:
            if isinstance(item, Batch):
                found += [(m.connection.topic, m.stamp_ns, bytes(m.payload)) for m in item.messages()]
            elif isinstance(item, Message):
                found.append((item.connection.topic, item.stamp_ns, bytes(item.payload)))
    except LogError as error:
        if not str(error):
            raise AssertionError("a refusal without words") from error
        return found, False
    return found, True


def _walked_mcap(raw: bytes) -> Iterator[tuple[str, int, bytes]]:
    topics: dict[int, str] = {}
    for op, body in records(raw):
        if op == 4:
            (length,) = struct.unpack_from("<I", body, 4)
            topics[struct.unpack_from("<H", body)[0]] = body[8 : 8 + length].decode("utf-8", "replace")
        elif op == 5:
            channel, _, stamp = struct.unpack_from("<HIQ", body)
            yield topics[channel], stamp, body[22:]


def _walked_ros1(raw: bytes, topics: dict[bytes, str]) -> Iterator[tuple[str, int, bytes]]:
    at = 0
    while at < len(raw):
        head, at = _sized(raw, at)
        body, at = _sized(raw, at)
        fields, place = dict[bytes, bytes](), 0
        while place < len(head):
            field, place = _sized(head, place)
            name, _, value = field.partition(b"=")
            fields[name] = value
        if fields[b"op"][0] == 7:
            topics.setdefault(fields[b"conn"], fields[b"topic"].decode("utf-8", "replace"))
        elif fields[b"op"][0] == 2:
            seconds, nanoseconds = struct.unpack("<II", fields[b"time"])
            yield topics[fields[b"conn"]], seconds * 10**9 + nanoseconds, body
        elif fields[b"op"][0] == 5:
            named = fields[b"compression"].decode("utf-8", "replace")
            size = int.from_bytes(fields[b"size"], "little")
            packed = body if named == "none" else bytes(inflate(body, named, size=size))
            yield from _walked_ros1(packed, topics)


def _sized(raw: bytes, at: int) -> tuple[bytes, int]:
    end = at + 4 + int.from_bytes(raw[at : at + 4], "little")
    assert end <= len(raw)
    return raw[at + 4 : end], end
