"""Scanning MCAP files: every record in order, every checksum verified.

Source: MCAP format specification, version 0 (mcap.dev/spec).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from zlib import crc32

import numpy as np

from ariac_score.errors import LogError
from ariac_score.logs.containers.chunk_buffers import Chunk, Slab, Slabs, entries_of, nothing_to_do, scratch
from ariac_score.logs.containers.inflating import check_announced, inflate_into
from ariac_score.logs.containers.items import (
    Batch,
    Bytes,
    Connection,
    IntArray,
    Message,
    Payloads,
    checked_stamp,
    normalised_type,
)
from ariac_score.logs.containers.record_index import check_not_crossed, gaps_between, records_at
from ariac_score.logs.containers.source import MAX_PEEK_BYTES, FileScan, Source

__all__ = ["MAGIC", "McapScan"]

MAGIC = b"\x89MCAP0\r\n"

_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
_MESSAGE_INDEX, _CHUNK_INDEX, _STATISTICS, _DATA_END = 0x07, 0x08, 0x0B, 0x0F
_READ = frozenset({_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END})

_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_FOOTER_BODY = struct.Struct("<QQI")

_Item = Connection | Message | Batch
_Body = bytes | memoryview

_MESSAGE_WORDS = np.dtype(
    {
        "names": ["op", "size", "channel", "stamp_ns"],
        "formats": ["u1", "<u8", "<u2", "<u8"],
        "offsets": [0, 1, 9, 15],
        "itemsize": _RECORD.size + _MESSAGE_HEAD.size,
    }
)
_LONGEST_COMPRESSION = 64
_WORTH_LEAVING_OUT_BYTES = 1 << 17
_LARGE_MESSAGE_BYTES = 1 << 16
_USUAL_INDEX_BYTES = 1 << 12
_LATEST_NS = 1 << 63


@dataclass(frozen=True, eq=False)
class _Places:
    """The messages of a chunk, and in `runs` what lies between them (see `gaps_between`)."""

    buffer: Bytes
    channels: IntArray
    stamps_ns: IntArray
    starts: IntArray
    ends: IntArray
    runs: Sequence[tuple[int, int, int, int]]

    @classmethod
    def of(cls, buffer: Bytes, offsets: IntArray) -> _Places:
        """Read where the messages at some offsets lie.

        Raises:
            ValueError: There are other things than whole messages, or messages besides them.
        """
        words = records_at(buffer, offsets, _MESSAGE_WORDS)
        if (words["op"] != _MESSAGE).any() or (words["stamp_ns"] >= _LATEST_NS).any():
            raise ValueError("there is no message where one should be")
        sizes = words["size"]
        if (sizes < _MESSAGE_HEAD.size).any() or (sizes > len(buffer)).any():
            raise ValueError("a message has a length that it cannot have")
        starts = offsets + (_RECORD.size + _MESSAGE_HEAD.size)
        ends = starts + (sizes.astype(np.int64) - _MESSAGE_HEAD.size)
        runs = tuple(gaps_between(offsets, ends, len(buffer)))
        if any(op == _MESSAGE for gap, behind, _, _ in runs for op, _ in _ops(buffer.data[gap:behind])):
            raise ValueError("there are other messages")
        channels, stamps_ns = words["channel"].astype(np.int64), words["stamp_ns"].astype(np.int64)
        return cls(buffer, channels, stamps_ns, starts, ends, runs)


class McapScan(FileScan):
    """One MCAP file; see `ariac_score.logs.containers.items.Scan`."""

    format = "ROS 2 bag (MCAP)"

    def __init__(self, path: Path, *, jobs: int = 0, topics: Container[str] | None = None) -> None:
        super().__init__(path)
        self._jobs, self._topics = jobs, topics
        self._summary: _Summary | None = None
        self._all_declared = False
        self._deaf: set[int] = set()
        self._usual_index_bytes = _USUAL_INDEX_BYTES
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, tuple[tuple[int, str], Connection]] = {}
        self._messages = 0
        self._announced: int | None = None
        # The specification leaves open whether the data section starts at the magic or behind the header.
        self._crc_of_file = self._crc_behind_header = self._crc_of_summary = 0
        self._data_crc_wanted, self._in_summary = True, False

    def __iter__(self) -> Iterator[_Item]:
        """Every declared connection and message, in recorded order.

        Raises:
            LogError: The file is not whole; see `readable`.
        """
        with Source(self.path) as source:
            self._source = source
            magic = source.take(min(len(MAGIC), source.size), "magic")
            if magic != MAGIC:
                raise source.damaged("the file does not start as an MCAP file does (wrong magic)", at=0)
            self._data_crc_wanted = _announces_data_crc(source)
            if self._topics is not None:
                self._summary = _summary_of(source)
            self._crc_of_file = crc32(magic)
            yield from self._records(source)
            if source.take(len(MAGIC), "closing magic") != MAGIC:
                raise source.damaged("the file does not end as an MCAP file does (wrong magic)")
            if source.left:
                raise source.damaged(f"{source.left} bytes follow the end of the MCAP file")
            if self._announced is not None and self._announced != self._messages:
                raise source.damaged(
                    f"the statistics announce {self._announced} messages, the file holds {self._messages}"
                )
            self._reached(source.offset)

    def _records(self, source: Source) -> Iterator[_Item]:
        with Slabs(self._jobs) as slabs:
            try:
                yield from self._passed(source, slabs)
            except LogError:
                if not self._is_settling:
                    # What is before the damage counts, and damage in it is told instead.
                    yield from self._settled(source, slabs.rest())
                raise

    def _passed(self, source: Source, slabs: Slabs) -> Iterator[_Item]:
        """Read record by record; chunks are held until their index was read, and inflated meanwhile."""
        expected: int | None = _HEADER
        while True:
            start = source.offset
            head = source.take(_RECORD.size, "record")
            op, length = _RECORD.unpack(head)
            if op == 0 or (expected is not None and op != expected):
                raise source.damaged(f"record type 0x{op:02x} cannot stand here", at=start)
            expected = None
            held = slabs.last
            if op == _CHUNK and length <= source.left:
                self._add_to_crcs(op, head)
                yield from self._hold(source, slabs, length, start)
                continue
            what = f"record 0x{op:02x}"
            if op == _MESSAGE_INDEX and held is not None and held.has_room_for(length):
                body = source.take(length, what)
                self._add_to_crcs(op, head, body)
                held.add_index(body)
                held.end = source.offset
                continue
            yield from self._settled(source, slabs.rest())
            if op == _CHUNK:
                yield from self._cut_chunk(source, start)
            body = source.take(length, what) if op in _READ else b""
            if op == _DATA_END:
                self._check_data_end(source, body, start)
            self._add_to_crcs(op, head, body)
            if op not in _READ:
                for block in source.blocks(length, what):
                    self._add_to_crcs(op, block)
            if op == _FOOTER:
                self._check_footer(source, head + body, start)
                return
            yield from self._outside_chunks(source, op, body, start)

    def _hold(self, source: Source, slabs: Slabs, length: int, start: int) -> Iterator[_Item]:
        """Read a chunk; its records are inflated and verified on the way."""
        end = source.offset + length
        try:
            head = _ChunkHead.read(source, length)
            self._add_to_crcs(_CHUNK, head.raw)
            check_announced(head.size, head.packed)
            index, behind = self._index_behind(source, end)
            named = {int.from_bytes(body[:2], "little") for body in index}
            if self._topics is not None and not named <= self._channels.keys():
                # They are declared in what was read and not looked at yet.
                yield from self._settled(source, slabs.rest())
            large = head.size >= _WORTH_LEAVING_OUT_BYTES
            unread = self._unread(index, head) if large and self._is_unwanted(index, start) else None
            if unread is not None:
                yield from self._settled(source, slabs.rest())
                yield from self._declare_all(start)
                self._messages += len(unread)
                yield unread
                source.skip(behind - source.offset)
                self._reached(source.offset)
                return
            # What is read later is read piece by piece, of which each is bounded by what it inflates to.
            held = self._data_crc_wanted or head.packed > head.size
            packed = head.packed if held and not head.plain else 0
            yield from self._settled(source, slabs.turn(head.size, packed))
            left_out = self._left_out(index, head) if large and head.plain else []
            if left_out:
                chunk = self._hold_parts(source, slabs, head, left_out, start)
            else:
                chunk = slabs.add(head.size, packed, start, lambda room: self._filled(source, head, room))
            chunk.index, chunk.end = index, behind
            source.skip(behind - source.offset)
        except (struct.error, ValueError) as error:
            yield from self._settled(source, slabs.rest())
            raise source.damaged(str(error), what="chunk", at=start) from error

    def _filled(self, source: Source, head: _ChunkHead, room: memoryview) -> Callable[[], None]:
        """Read the records of a chunk; returns the job that completes and verifies them."""
        if not self._data_crc_wanted:
            return partial(head.fill, room, source.later(head.packed, "chunk"))
        if head.plain:
            source.take_into(room, "chunk")
            self._add_to_crcs(_CHUNK, room)
            return partial(head.verify, room)
        packed = source.take(head.packed, "chunk")
        self._add_to_crcs(_CHUNK, packed)
        return partial(head.inflate, room, packed)

    def _hold_parts(
        self, source: Source, slabs: Slabs, head: _ChunkHead, left_out: Sequence[tuple[int, int]], start: int
    ) -> Chunk:
        """Read a chunk but for large messages that nobody wants."""
        records = source.offset

        def filled(room: memoryview) -> Callable[[], None]:
            at = 0
            for first, last in [*left_out, (head.size, head.size)]:
                source.take_into(room[at:first], "chunk")
                source.skip(last - first)
                at = last
            return nothing_to_do

        chunk = slabs.add(head.size, 0, start, filled)
        room = slabs.room_of(chunk)

        def complete() -> None:
            source.read_at(records, room, "chunk")
            head.verify(room)

        chunk.complete = complete
        return chunk

    def _index_behind(self, source: Source, end: int) -> tuple[list[bytes], int]:
        """The index records behind a chunk, and where they end; none where they are to be read one by one."""
        found: list[bytes] = []
        if self._data_crc_wanted:
            return found, end
        at, window = 0, source.at(end, self._usual_index_bytes)
        while True:
            if at + _RECORD.size > len(window):
                # It ends here, or more must be looked at.
                more = source.at(end + len(window), max(len(window), 16 * _USUAL_INDEX_BYTES))
                if not more or len(window) > MAX_PEEK_BYTES:
                    return [], end
                window += more
                continue
            op, length = _RECORD.unpack_from(window, at)
            if op != _MESSAGE_INDEX:
                # The next one may well be as long; what follows it must be seen to know that it ends.
                self._usual_index_bytes = at + at // 8 + _USUAL_INDEX_BYTES
                return found, end + at
            if length > MAX_PEEK_BYTES:
                return [], end
            behind = at + _RECORD.size + length
            if behind > len(window):
                window += source.at(end + len(window), behind - len(window) + _USUAL_INDEX_BYTES)
                if behind > len(window):
                    return [], end
            found.append(window[at + _RECORD.size : behind])
            at = behind

    def _is_unwanted(self, index: Sequence[bytes], start: int) -> bool:
        """Whether a chunk holds no wanted message, by its index and by the summary.

        What it may declare besides, the summary repeats.
        """
        if not index or self._summary is None:
            return False
        named = frozenset(int.from_bytes(body[:2], "little") for body in index)
        return named <= self._deaf and named == self._summary.chunks.get(start)

    def _declare_all(self, start: int) -> Iterator[_Item]:
        """Declare what the summary repeats: a chunk that is left out may be the one that declares it."""
        if self._summary is not None and not self._all_declared:
            self._all_declared = True
            for op, body in self._summary.declarations:
                yield from self._items(op, body, start)

    def _unread(self, index: Sequence[bytes], head: _ChunkHead) -> Batch | None:
        """What the index says of a chunk that is not read: senders and times, in recorded order.

        `None` where it cannot be right: then the records are to tell.
        """
        try:
            heads, counts, pairs, _ = _entries([Chunk(0, 0, 0, 0, nothing_to_do, list(index))])
        except (struct.error, ValueError):
            return None
        times, offsets = pairs.T
        if not len(pairs) or (int(times.min()), int(times.max())) != head.span_ns:
            return None
        if int(offsets.max()) >= head.size or len(np.unique(offsets)) != len(offsets):
            return None
        channels = np.repeat(np.array(heads, dtype=np.int64), counts)
        order = np.argsort(pairs[:, 1], kind="stable")
        nowhere = np.zeros(len(order), dtype=np.int64)
        nothing = np.zeros(0, dtype=np.uint8)
        places = _Places(nothing, channels[order], pairs[order, 0], nowhere, nowhere, ())
        return self._batch_of(places, slice(0, len(order)), np.flatnonzero(np.bincount(channels)))

    def _left_out(self, index: Sequence[bytes], head: _ChunkHead) -> list[tuple[int, int]]:
        """The payloads of large messages that nobody wants, if the index is right: their heads will tell."""
        if not index or not self._deaf:
            return []
        try:
            heads, counts, pairs, _ = _entries([Chunk(0, 0, 0, head.size, nothing_to_do, list(index))])
        except (struct.error, ValueError):
            return []
        bounds = np.sort(np.append(pairs[:, 1], head.size))
        if np.diff(bounds).max() < _LARGE_MESSAGE_BYTES:
            return []
        deaf = np.repeat(np.isin(np.array(heads, dtype=np.int64), list(self._deaf)), counts)
        order = np.argsort(pairs[:, 1], kind="stable")
        offsets = pairs[order, 1]
        ends = np.append(offsets[1:], head.size)
        first = offsets + _MESSAGE_WORDS.itemsize
        chosen = deaf[order] & (ends - first >= _LARGE_MESSAGE_BYTES) & (ends <= head.size)
        return list(zip(first[chosen].tolist(), ends[chosen].tolist(), strict=True))

    def _settled(self, source: Source, slabs: Iterable[Slab]) -> Iterator[_Item]:
        """The records of the chunks that are held."""
        self._is_settling = True  # and stays so where one is damaged: what is behind it does not count
        for slab in slabs:
            chunks, failure = slab.finished()
            batch = self._together(slab, chunks)
            if batch is not None:
                self._hands_over(chunks[-1].end)
                self._messages += len(batch)
                yield batch
            else:
                yield from self._one_by_one(source, slab, chunks)
            if chunks:
                self._reached(chunks[-1].end)
            if failure is not None:
                at = slab.chunks[len(chunks)].start
                slab.empty()
                raise source.damaged(str(failure), what="chunk", at=at) from failure
        self._is_settling = False

    def _together(self, slab: Slab, chunks: Sequence[Chunk]) -> Batch | None:
        """All messages of some chunks; `None` where they hold more, or their index is not as it should be."""
        if not chunks or not all(chunk.index for chunk in chunks):
            return None
        try:
            places = _indexed(slab.buffer, chunks)
        except (struct.error, ValueError):
            return None
        known = np.flatnonzero(np.bincount(places.channels))
        if len(places.runs) != 1 or not all(key in self._channels for key in known.tolist()):
            return None
        return self._batch_of(places, slice(0, len(places.channels)), known)

    def _one_by_one(self, source: Source, slab: Slab, chunks: Sequence[Chunk]) -> Iterator[_Item]:
        for chunk in chunks:
            try:
                if chunk.complete:
                    chunk.complete()
                yield from self._chunk(slab, chunk)
            except (struct.error, ValueError) as error:
                slab.empty()
                raise source.damaged(str(error), what="chunk", at=chunk.start) from error
            self._reached(chunk.end)

    def _outside_chunks(self, source: Source, op: int, body: _Body, start: int) -> Iterator[_Item]:
        try:
            yield from self._items(op, body, start)
        except (struct.error, ValueError) as error:
            what = _WHAT.get(op, f"record 0x{op:02x}")
            raise source.damaged(str(error), what=what, at=start) from error
        self._reached(source.offset)

    def _add_to_crcs(self, op: int, *parts: _Body) -> None:
        if op == _DATA_END:
            self._crc_of_summary, self._in_summary = 0, True
        for part in parts:
            if self._data_crc_wanted:
                self._crc_of_file = crc32(part, self._crc_of_file)
                if op != _HEADER:
                    self._crc_behind_header = crc32(part, self._crc_behind_header)
            if self._in_summary and op not in (_FOOTER, _DATA_END):
                self._crc_of_summary = crc32(part, self._crc_of_summary)

    def _check_data_end(self, source: Source, body: bytes, start: int) -> None:
        if len(body) < 4:
            raise source.damaged("the record is too short", what="data end", at=start)
        announced = int.from_bytes(body[:4], "little")
        if announced and not self._data_crc_wanted:
            raise source.damaged(
                "the end of the data is not where the footer says", what="data end", at=start
            )
        if announced not in (0, self._crc_of_file, self._crc_behind_header):
            raise source.damaged(
                f"the CRC of the data section is {self._crc_of_file:08x}, the file says {announced:08x}",
                what="data end",
                at=start,
            )

    def _check_footer(self, source: Source, record: bytes, start: int) -> None:
        if len(record) != _RECORD.size + _FOOTER_BODY.size:
            raise source.damaged("the record has a wrong length", what="footer", at=start)
        if not self._in_summary:
            raise source.damaged("no record says that the data end", what="footer", at=start)
        announced = int.from_bytes(record[-4:], "little")
        found = crc32(record[:-4], self._crc_of_summary)
        if announced not in (0, found):
            raise source.damaged(
                f"the CRC of the summary is {found:08x}, the file says {announced:08x}",
                what="footer",
                at=start,
            )

    def _items(self, op: int, body: _Body, start: int) -> Iterator[_Item]:
        if op == _MESSAGE:
            yield self._message(body, start)
        elif op == _SCHEMA:
            self._declare_schema(body)
        elif op == _CHANNEL:
            yield from self._declare_channel(body)
        elif op == _STATISTICS:
            (self._announced,) = struct.unpack_from("<Q", body)

    def _message(self, body: _Body, start: int) -> Message:
        channel, _, stamp_ns, _ = _MESSAGE_HEAD.unpack_from(body)
        if channel not in self._channels:
            raise ValueError(f"a message belongs to channel {channel}, which is not declared before it")
        checked_stamp(stamp_ns, file=self.path, place=f"message at byte {start}")
        self._messages += 1
        return Message(self._channels[channel][1], stamp_ns, memoryview(body)[_MESSAGE_HEAD.size :])

    def _declare_schema(self, body: _Body) -> None:
        (key,) = struct.unpack_from("<H", body)
        name, at = _text(body, 2)
        encoding, at = _text(body, at)
        definition, _ = _text(body, at)
        self._schemas.setdefault(key, (normalised_type(name), encoding, definition))

    def _declare_channel(self, body: _Body) -> Iterator[Connection]:
        key, schema = struct.unpack_from("<HH", body)
        topic, at = _text(body, 4)
        encoding, _ = _text(body, at)
        if key in self._channels:
            if self._channels[key][0] != (schema, topic):
                raise ValueError(f"channel {key} is declared twice, differently")
            return
        if schema and schema not in self._schemas:
            raise ValueError(f"channel {key} needs schema {schema}, which is not declared before it")
        type_, format_, definition = self._schemas.get(schema, ("", "", ""))
        connection = Connection(topic, type_, encoding, definition, format_)
        self._channels[key] = (schema, topic), connection
        if self._topics is not None and topic not in self._topics:
            self._deaf.add(key)
        yield connection

    def _chunk(self, slab: Slab, chunk: Chunk) -> Iterator[_Item]:
        """The records of a chunk: by its index, else by walking them, else one by one."""
        records = slab.buffer[chunk.first : chunk.last]
        places = None
        if chunk.index:
            try:
                places = _indexed(records, [replace(chunk, first=0, last=len(records))])
            except (struct.error, ValueError):
                self._contradictions += 1
        if places is None:
            try:
                places = _Places.of(records, _walked(records.data))
            except (struct.error, ValueError):
                yield from self._records_in_chunk(records.data, chunk.start)
                return
        for gap, behind, first, last in places.runs:
            yield from self._records_in_chunk(records.data[gap:behind], chunk.start)
            yield from self._batch(places, first, last)

    def _batch(self, places: _Places, first: int, last: int) -> Iterator[_Item]:
        """Messages that follow each other, up to the first whose channel is not declared."""
        known = np.flatnonzero(np.bincount(places.channels[first:last]))
        missing = [key for key in known.tolist() if key not in self._channels]
        if missing:
            last = first + int(np.argmax(np.isin(places.channels[first:last], missing)))
            known = np.flatnonzero(np.bincount(places.channels[first:last]))
        if last > first:
            self._messages += last - first
            yield self._batch_of(places, slice(first, last), known)
        if missing:
            raise ValueError(
                f"a message belongs to channel {int(places.channels[last])}, which is not declared before it"
            )

    def _batch_of(self, places: _Places, rows: slice, known: IntArray) -> Batch:
        starts, ends = places.starts[rows], places.ends[rows]
        if self._deaf:
            # They may not have been read.
            deaf = np.zeros(1 << 16, dtype=bool)
            deaf[list(self._deaf)] = True
            ends = np.where(deaf[places.channels[rows]], starts, ends)
        payloads = Payloads(places.buffer, starts, ends)
        senders = tuple(self._channels[key][1] for key in known.tolist())
        sources = np.searchsorted(known, places.channels[rows])
        return Batch(senders, sources, places.stamps_ns[rows], payloads)

    def _cut_chunk(self, source: Source, start: int) -> Iterator[_Item]:
        """The whole records of a chunk that the file ends in, where it is not compressed."""
        head = source.peek(source.left)
        try:
            compression, at = _text(head, _CHUNK_HEAD.size)
            if not compression:
                yield from self._records_in_chunk(memoryview(head)[at + 8 :], start)
        except (struct.error, ValueError):
            return  # it ends in the middle of a record: `take` says so
        finally:
            self._readable = f"byte {source.size}"

    def _records_in_chunk(self, records: memoryview, start: int) -> Iterator[_Item]:
        at = 0
        while at < len(records):
            op, length = _RECORD.unpack_from(records, at)
            at += _RECORD.size
            if op in (0, _CHUNK) or length > len(records) - at:
                raise ValueError(f"its record 0x{op:02x} of {length} bytes, {at} bytes in, cannot be there")
            yield from self._items(op, records[at : at + length], start)
            at += length


_WHAT = {
    _CHUNK: "chunk",
    _MESSAGE: "message",
    _SCHEMA: "schema",
    _CHANNEL: "channel",
    _STATISTICS: "statistics",
}


def _announces_data_crc(source: Source) -> bool:
    """Whether the end of the data has a checksum, looked up from the end of the file.

    Recorders leave it out, and computing it takes longer than reading. What is found here is
    held against the end of the data once it is reached.
    """
    tail = source.at(source.size - len(MAGIC) - _FOOTER_BODY.size - _RECORD.size, _RECORD.size + 8)
    if len(tail) != _RECORD.size + 8 or tail[0] != _FOOTER:
        return True
    summary = int.from_bytes(tail[_RECORD.size :], "little")
    behind = summary or source.size - len(MAGIC) - _FOOTER_BODY.size - _RECORD.size
    end = source.at(behind - _RECORD.size - 4, _RECORD.size + 4)
    return end[:1] != bytes((_DATA_END,)) or end[-4:] != b"\0\0\0\0"


@dataclass(frozen=True)
class _Summary:
    """What the end of a file says is in it.

    Attributes:
        declarations: All schemas, then all channels.
        chunks: By the start of each chunk the channels whose messages it holds.
    """

    declarations: Sequence[tuple[int, bytes]]
    chunks: Mapping[int, frozenset[int]]


def _summary_of(source: Source) -> _Summary | None:
    """The summary; `None` where it is not to be relied on."""
    tail = source.at(source.size - len(MAGIC) - _FOOTER_BODY.size, 8)
    start = int.from_bytes(tail, "little")
    end = source.size - len(MAGIC) - _FOOTER_BODY.size - _RECORD.size
    if not 0 < start < end or end - start > MAX_PEEK_BYTES:
        return None
    summary, found = source.at(start, end - start), []
    schemas, needed = {0}, set[int]()
    chunks = dict[int, frozenset[int]]()
    try:
        for op, at in _ops(memoryview(summary)):
            first = at + _RECORD.size
            body = summary[first : first + _RECORD.unpack_from(summary, at)[1]]
            if op in (_SCHEMA, _CHANNEL):
                found.append((op, body))
                (schemas if op == _SCHEMA else needed).add(
                    struct.unpack_from("<H", body, 2 * (op == _CHANNEL))[0]
                )
            elif op == _CHUNK_INDEX:
                chunk, channels = _indexed_chunk(body)
                chunks[chunk] = channels
    except struct.error:
        return None
    return _Summary(sorted(found), chunks) if needed and needed <= schemas else None


def _indexed_chunk(body: bytes) -> tuple[int, frozenset[int]]:
    """Where a chunk starts, and the channels that have an index behind it."""
    _, _, start, _, length = struct.unpack_from("<QQQQI", body)
    entries = body[_CHUNK_INDEX_HEAD_BYTES : _CHUNK_INDEX_HEAD_BYTES + length]
    return start, frozenset(channel for channel, _ in struct.iter_unpack("<HQ", entries))


_CHUNK_INDEX_HEAD_BYTES = 36


@dataclass(frozen=True)
class _ChunkHead:
    """What stands before the records of a chunk.

    Attributes:
        raw: Its bytes.
        span_ns: The earliest and the latest log time in it, as it announces them, ns.
        size: Bytes of its records.
        announced: Their checksum; 0 without one.
        compression: By name; empty without one.
        packed: Bytes of the records as they are in the file.
    """

    raw: bytes
    span_ns: tuple[int, int]
    size: int
    announced: int
    compression: str
    packed: int

    @classmethod
    def read(cls, source: Source, length: int) -> _ChunkHead:
        """Read it from the start of a chunk of this length.

        Raises:
            ValueError: It contradicts itself.
        """
        what = f"record 0x{_CHUNK:02x}"
        head = source.take(min(_CHUNK_HEAD.size + 4, length), what)
        if len(head) < _CHUNK_HEAD.size + 4:
            raise ValueError(f"its head has {len(head)} bytes")
        earliest_ns, latest_ns, size, announced = _CHUNK_HEAD.unpack_from(head)
        named = int.from_bytes(head[_CHUNK_HEAD.size :], "little")
        if named > min(_LONGEST_COMPRESSION, length - len(head)):
            raise ValueError(f"a text of {named} bytes is longer than its record")
        head += source.take(min(named + 8, length - len(head)), what)
        compression, at = _text(head, _CHUNK_HEAD.size)
        (packed,) = struct.unpack_from("<Q", head, at)
        if packed != length - len(head):
            raise ValueError(f"it announces {packed} bytes of records and has {length - len(head)}")
        chunk = cls(head, (earliest_ns, latest_ns), size, announced, compression, packed)
        if chunk.plain and packed != size:
            raise ValueError(
                f"CRC cannot be checked: it holds {packed} bytes instead of the announced {size}"
            )
        return chunk

    @property
    def plain(self) -> bool:
        """Whether its records are not compressed."""
        return not self.compression

    def fill(self, room: memoryview, read: Callable[[memoryview], None]) -> None:
        """Read its records to where there is room for them, inflated, and verify them.

        Raises:
            ValueError: They are damaged.
        """
        if self.plain:
            read(room)
            self.verify(room)
            return
        with scratch(self.packed) as packed:
            read(packed)
            self.inflate(room, packed)

    def inflate(self, room: memoryview, packed: bytes | memoryview) -> None:
        """Inflate its records to where there is room for them, and verify them.

        Raises:
            ValueError: They are damaged.
        """
        try:
            inflate_into(room, packed, self.compression)
        except ValueError as error:
            raise ValueError(f"CRC cannot be checked: {error}") from error
        self.verify(room)

    def verify(self, records: memoryview) -> None:
        """Hold the records against the checksum.

        Raises:
            ValueError: They have another one.
        """
        if self.announced and (found := crc32(records)) != self.announced:
            raise ValueError(f"its CRC is {found:08x}, the file says {self.announced:08x}")


def _ops(records: memoryview) -> Iterator[tuple[int, int]]:
    """Type and offset of each record."""
    at, size, unpack = 0, len(records), _RECORD.unpack_from
    while at < size:
        op, length = unpack(records, at)
        yield op, at
        at += _RECORD.size + length


def _walked(records: memoryview) -> IntArray:
    """Where the messages of a chunk are, by walking it."""
    return np.array([at for op, at in _ops(records) if op == _MESSAGE], dtype=np.int64)


def _entries(chunks: Sequence[Chunk]) -> tuple[list[int], IntArray, IntArray, IntArray]:
    """The channel of each index record and its number of entries; times and offsets, and whose they are.

    Raises:
        ValueError: An index record holds something else.
    """
    heads, counts, entries, owners = entries_of(chunks, head=6, words=4)
    named = [struct.unpack("<HI", head) for head in heads]
    if any(length != 16 * count for (_, length), count in zip(named, counts.tolist(), strict=True)):
        raise ValueError("the index is no list of times and offsets")
    pairs = entries.reshape(-1).view("<u8").reshape(-1, 2)
    if pairs.max(initial=0) >= _LATEST_NS:
        raise ValueError("a number is beyond 63 bits")
    return [channel for channel, _ in named], counts, pairs.astype(np.int64), owners


def _indexed(buffer: Bytes, chunks: Sequence[Chunk]) -> _Places:
    """Where the messages of chunks that lie side by side are, by their indexes.

    Raises:
        ValueError: An index contradicts its chunk.
    """
    named, counts, pairs, owners = _entries(chunks)
    times, offsets = pairs.T
    firsts = np.array([chunk.first for chunk in chunks], dtype=np.int64)
    lasts = np.array([chunk.last for chunk in chunks], dtype=np.int64)
    if (offsets >= (lasts - firsts)[owners]).any():
        raise ValueError("the index leads out of its chunk")
    offsets = offsets + firsts[owners]
    channels = np.repeat(np.array(named, dtype=np.int64), counts)
    order = np.argsort(offsets, kind="stable")
    places = _Places.of(buffer[: chunks[-1].last], offsets[order])
    if (places.channels != channels[order]).any() or (places.stamps_ns != times[order]).any():
        raise ValueError("the index tells other channels or times")
    check_not_crossed(offsets[order], places.ends, lasts)
    return places


def _text(body: _Body, at: int) -> tuple[str, int]:
    """A string with its length before it, and where the next field starts."""
    (length,) = struct.unpack_from("<I", body, at)
    end = at + 4 + length
    if end > len(body):
        raise ValueError(f"a text of {length} bytes is longer than its record")
    return bytes(body[at + 4 : end]).decode("utf-8", errors="replace"), end
