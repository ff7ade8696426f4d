"""Which bytes of an indexed recording a scan for some topics reads, so that they are fetched together.

Only the number of requests depends on this forecast: any other bytes that the scan reads are fetched
when it reads them (`ariac_score.logs.containers.ranged`). Why not leave it at that? A request takes
as long as some 100 kB, and there would be one for each chunk and each index.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Container, Iterator, Sequence
from dataclasses import dataclass

from ariac_score.errors import LogError
from ariac_score.logs.containers.chunked import USUAL_INDEX_BYTES, ChunkedScan, ChunkHead, Outline
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.ranged import Range, RangedFile, reading
from ariac_score.logs.containers.ros1 import Ros1Scan
from ariac_score.logs.containers.source import Source

__all__ = ["INDEXED", "foresee"]

INDEXED: dict[str, type[ChunkedScan]] = {".mcap": McapScan, ".bag": Ros1Scan}
"""The formats with an index, by suffix."""

_FIRST_BYTES = 1 << 16
_BEFORE_BYTES = 1 << 11
"""Fetched before each chunk: most of the index of the previous one, where chunks are small."""
_BEHIND_BYTES = USUAL_INDEX_BYTES + (1 << 9)
"""Fetched from its start on: its head, and as far as a scan looks for more of the index before it."""


@dataclass(frozen=True)
class _Body:
    """The records of a chunk: its head, the senders of its messages, and its place in the file."""

    head: ChunkHead
    senders: frozenset[int]
    start: int
    end: int


def foresee(file: RangedFile, topics: Container[str]) -> bool:
    """Fetch what a scan of a recording will read of it.

    Args:
        file: A file with nothing fetched yet; its suffix is one of `INDEXED`.
        topics: The topics whose messages are wanted.

    Returns:
        Whether that pays: the file has an index, and large parts of it are unwanted.

    Raises:
        OSError: The bytes cannot be fetched.
    """
    scan = INDEXED[file.path.suffix](file.path, topics=topics)
    file.have([(0, _FIRST_BYTES), (file.size - _FIRST_BYTES, file.size)])
    with reading([file]), Source(file.path) as source:
        try:
            outline = scan.outline(source)
            if outline is None:
                return False
            unwanted = {sender for sender, topic in outline.topics.items() if topic not in topics}
            heads = [(start - _BEFORE_BYTES, start + _BEHIND_BYTES) for start in outline.chunks]
            if not file.pays(heads):
                return False
            file.have(heads)
            bodies = [_body(scan, source, *chunk) for chunk in sorted(outline.chunks.items())]
            between = list(_between(bodies, file.size))
            whole, mixed = _read(scan, bodies, outline, unwanted)
            if not file.pays(between + whole):
                return False
            file.have(between)
            for body, known in mixed:
                left_out = scan.left_out_of(source, body.head, body.end, known)
                whole += _without(body, left_out)
        except (LogError, struct.error, ValueError):
            return False  # the scan will report the damage
        if not file.pays(whole):
            return False
        file.have(whole)
    return True


def _body(scan: ChunkedScan, source: Source, start: int, senders: Collection[int]) -> _Body:
    source.at(start, _BEHIND_BYTES)  # keeps the source from reading ahead into bytes that are not here
    head = scan.chunk_at(source, start)
    return _Body(head, frozenset(senders), source.offset, source.offset + head.packed)


def _between(bodies: Sequence[_Body], size: int) -> Iterator[Range]:
    """The stretches before, between and behind the chunks, as far as a scan looks for their indexes."""
    at = length = 0
    for body in bodies:
        # As in `ChunkedScan._index_behind`: as far as the previous index went, and an eighth more.
        usual, length = length + length // 8, max(body.start - at, 0)
        yield at, at + max(usual, length) + USUAL_INDEX_BYTES
        at = body.end
    yield at, size


def _read(
    scan: ChunkedScan, bodies: Sequence[_Body], outline: Outline, unwanted: set[int]
) -> tuple[list[Range], list[tuple[_Body, set[int]]]]:
    """The chunks that are read whole, and those without the large messages of some senders.

    A scan learns the topics of senders from the chunks, and reads everything of a sender before that.
    """
    whole, mixed, declared = list[Range](), list[tuple[_Body, set[int]]](), set[int]()
    for body in bodies:
        known = declared & unwanted
        large = body.head.size >= scan.smallest_left_out_bytes
        all_known = outline.declares_all or outline.topics.keys() <= declared
        if large and all_known and body.senders <= known:
            declared |= outline.topics.keys()
            continue
        if large and body.head.plain and body.senders & known:
            mixed.append((body, known))
        else:
            whole.append((body.start, body.end))
        declared |= body.senders
    return whole, mixed


def _without(body: _Body, left_out: Sequence[Range]) -> Iterator[Range]:
    at = body.start
    for first, end in left_out:
        yield at, body.start + first
        at = body.start + end
    yield at, body.end
