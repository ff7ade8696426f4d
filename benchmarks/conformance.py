"""Read every file of the MCAP conformance suite, and write the table of docs/conformance.md.

`python benchmarks/conformance.py FOLDER [-o FILE]`: the folder holds those files of the suite that are not
padded, with `expected.json` (of each file its features and messages). The other half is made from these:
the same files, with three bytes behind the last field of each record that may have more, as the suite's own
writer does it; `PADDED` has checksums of such files as the suite publishes them.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import struct
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from zlib import crc32

from mcap.reader import NonSeekingReader

from ariac_score.logs.containers.items import Batch, Message
from ariac_score.logs.containers.mcap import MAGIC, McapScan

PADDED = {
    "OneSchemalessMessage-rch": "bfd38ba01919d87bdade71f29cd4e96f2d40f8ee2e1f8e59ad791a41c6bd3bd9",
    "TenMessages-ch-chx-mx-rch-rsh-st-sum": "54f3c5a0ca350cd4cf6326992926f491178a46aa694686e3781aa19c4255fc88",  # noqa: E501
    "TenMessages-ch-mx-rch-st": "34682307410d6387385c4b32fe550808a8e22a8fc35e9f76f0bcde9bee92be3d",
    "TenMessages-ch-rch-sum": "e90cf59cf9b13f79b827e5c153bcd3a7a0a217b2d84cdc9fea045820cff4b4c1",
    "TenMessages-rch-rsh": "21b8ac7a5c6bc34c1fba877bec4167c63e08f438a8e4e53291d9204fbdcc40fb",
    "TenMessages-st-sum": "45eab0d05db8cfa138c8c7473cc4ee90a46c5d85514b6379f616c45947e91b56",
}
"""SHA-256 of some padded files, from the suite (github.com/foxglove/mcap, tests/conformance/data)."""

_FOOTER, _MESSAGE, _CHUNK, _CHUNK_INDEX, _DATA_END = 2, 5, 6, 8, 15
_INDEXES = {10: 0, 13: 0, 14: 1}
"""Records that name a place and a length, and where in them: of attachments, of metadata, of the summary."""
_NEVER_PADDED = (_FOOTER, _MESSAGE, _CHUNK)
"""Nor is what is in chunks: the suite has no such file."""
_PADDING = b"\x01\xff\xff"

_Told = list[tuple[str, int, str]]


def records(raw: bytes) -> Iterator[tuple[int, bytes]]:
    """Kind and content of each record."""
    at = 0
    while at < len(raw):
        op, length = struct.unpack_from("<BQ", raw, at)
        yield op, raw[at + 9 : at + 9 + length]
        at += 9 + length


def padded(mcap: bytes) -> bytes:
    """A file of the suite with padded records; every offset, length and checksum is that of the new file."""
    out, at = bytearray(MAGIC), len(MAGIC)
    moved = {0: 0, at: at}
    for op, body in records(mcap[at : -len(MAGIC)]):
        at += 9 + len(body)
        now = _corrected(op, body, moved, bytes(out)) + (b"" if op in _NEVER_PADDED else _PADDING)
        out += struct.pack("<BQ", op, len(now)) + now
        moved[at] = len(out)
    return bytes(out + MAGIC)


def _corrected(op: int, body: bytes, moved: dict[int, int], before: bytes) -> bytes:
    """A record that speaks of places as they are now."""
    if op == _CHUNK_INDEX:
        return _moved_chunk_index(body, moved)
    if op in _INDEXES:
        place = _INDEXES[op]
        start, length = struct.unpack_from("<QQ", body, place)
        now = struct.pack("<QQ", moved[start], moved[start + length] - moved[start])
        return body[:place] + now + body[place + 16 :]
    if op == _DATA_END and body != bytes(4):
        return struct.pack("<I", crc32(before))
    return _moved_footer(body, moved, before) if op == _FOOTER else body


def _moved_chunk_index(body: bytes, moved: dict[int, int]) -> bytes:
    first, last, start, length, listed = struct.unpack_from("<QQQQI", body)
    end = 36 + listed
    places = b"".join(struct.pack("<HQ", c, moved[at]) for c, at in struct.iter_unpack("<HQ", body[36:end]))
    (indexes,) = struct.unpack_from("<Q", body, end)
    behind = moved[start + length]
    now = struct.pack("<QQQQI", first, last, moved[start], behind - moved[start], listed) + places
    size = behind - moved[start] - 49  # the head of the record, and what stands before the records of a chunk
    return now + struct.pack("<QIQQ", moved[start + length + indexes] - behind, 0, size, size)


def _moved_footer(body: bytes, moved: dict[int, int], before: bytes) -> bytes:
    summary, offsets, checksum = struct.unpack("<QQI", body)
    now = struct.pack("<QQ", moved[summary], moved[offsets])
    start = moved[summary] or len(before)
    head = struct.pack("<BQ", _FOOTER, 20)
    return now + struct.pack("<I", crc32(before[start:] + head + now) if checksum else 0)


# Reading


def ours(path: Path) -> _Told:
    """Topic, time and payload of each message, as it is read here.

    Raises:
        LogError: The file is refused.
    """
    found: _Told = []
    for item in McapScan(path):
        if isinstance(item, Batch | Message):
            messages = item.messages() if isinstance(item, Batch) else (item,)
            found += [(m.connection.topic, m.stamp_ns, bytes(m.payload).hex()) for m in messages]
    return sorted(found)


def of_mcap(path: Path) -> _Told:
    """The same as the library `mcap` reads it from the start to the end, whatever it raises."""
    with path.open("rb") as file:
        messages = NonSeekingReader(file, validate_crcs=True).iter_messages()
        return sorted(
            (channel.topic, message.log_time, message.data.hex()) for _, channel, message in messages
        )


def verdict(reader: Any, path: Path, expected: _Told) -> str:
    """What a reader makes of a file: `read`, or what differs."""
    try:
        found = reader(path)
    except Exception as error:  # noqa: BLE001  # of a library that is only compared with
        return f"{type(error).__name__}"
    return "read" if found == expected else f"{len(found)} of {len(expected)}"


def rows(folder: Path) -> Iterator[tuple[str, int, str, str, str, str]]:
    """Of each file: its messages, then what we and the library `mcap` make of it, and of it padded.

    Raises:
        ValueError: A padded file is not the one that the suite publishes.
    """
    suite = json.loads((folder / "expected.json").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as work:
        for name, facts in sorted(suite.items()):
            expected = sorted(
                (topic, log_ns, payload)
                for topic, log_ns, _, _, payload in facts["messages_topic_log_publish_seq_hex"]
            )
            made = padded((folder / name).read_bytes())
            stem = name.removesuffix(".mcap")
            if PADDED.get(stem, found := hashlib.sha256(made).hexdigest()) != found:
                raise ValueError(f"{name}, padded, is not the file of the suite")
            other = Path(work, name)
            other.write_bytes(made)
            files = (folder / name, other)
            told = [verdict(reader, file, expected) for file in files for reader in (ours, of_mcap)]
            yield (stem, len(expected), *told)  # type: ignore[misc]


def page(told: list[tuple[str, int, str, str, str, str]]) -> str:
    """The page with the table."""
    counts = [sum(row[place] == "read" for row in told) for place in (2, 3, 4, 5)]
    head = f"""\
# The MCAP conformance suite

All {2 * len(told)} files of the suite of the format's authors, each read from start to end, here and by
their own library for Python. A file is `read` where topic, time and payload of each message are those that
the suite lists; otherwise there is what was found.

```sh
python benchmarks/conformance.py FOLDER_OF_THE_SUITE -o docs/conformance.md
```

A name says what a file has: `ch` chunks, `chx` their index, `mx` an index of messages, `rch` and `rsh`
channels and schemas repeated in the summary, `st` statistics, `sum` offsets of the summary, `ax` and `mdx` an
index of attachments and metadata. The padded half has three bytes behind the last field of each record that
may have more; it is made from the other half, and the checksums of {len(PADDED)} such files are the suite's.

Where records within chunks are padded, which the suite does not try, the library (1.6.0) takes the padding
for the next record and leaves messages out in silence; here they are read (`fuzz/LOG.md`).

| | files | here | library `mcap` |
|---|---|---|---|
| plain | {len(told)} | {counts[0]} read | {counts[1]} read |
| padded | {len(told)} | {counts[2]} read | {counts[3]} read |

| file | messages | here | `mcap` | padded: here | `mcap` |
|---|---|---|---|---|---|
"""
    return head + "".join(f"| {' | '.join(map(str, row))} |\n" for row in told)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path)
    told = parser.parse_args()
    found = list(rows(told.folder))
    if told.output:
        told.output.write_text(page(found), encoding="utf-8")
    bad = [row[0] for row in found if row[2] != "read" or row[4] != "read"]
    print(f"{2 * len(found)} files, {len(bad)} of them not read as they should be", *bad, sep="\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
