"""Which bytes of an indexed recording a scan for some topics reads, so that they are fetched together.

Nothing depends on what is foreseen here but the number of requests: whatever else the scan reads is
fetched when it reads it (`ariac_score.logs.containers.ranged`). Why not leave it at that? A request
takes as long as some 100 kB, and there would be one for each chunk and each index.
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
"""So much is fetched before a chunk: most of the index of the one before it, where chunks are small."""
_BEHIND_BYTES = USUAL_INDEX_BYTES + (1 << 9)
"""And so much from its start on: its head, and as far as a scan looks for more of the index before it."""


@dataclass(frozen=True)
class _Body:
    """The records of a chunk: what its head says, whose messages they hold, and where they are."""

    head: ChunkHead
    senders: frozenset[int]
    start: int
    end: int


def foresee(file: RangedFile, topics: Container[str]) -> bool:
    """Fetch what a scan of a recording will read of it.

    Args:
        file: Of which nothing is here; its suffix is one of `INDEXED`.
        topics: Whose messages are wanted.

    Returns:
        Whether that is less than nearly all: it has an index, and large parts that nobody wants.

    Raises:
        OSError: It cannot be fetched.
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
            return False  # the scan says what is wrong with it
        if not file.pays(whole):
            return False
        file.have(whole)
    return True


def _body(scan: ChunkedScan, source: Source, start: int, senders: Collection[int]) -> _Body:
    source.at(start, _BEHIND_BYTES)  # lest the source read on into what is not here
    head = scan.chunk_at(source, start)
    return _Body(head, frozenset(senders), source.offset, source.offset + head.packed)


def _between(bodies: Sequence[_Body], size: int) -> Iterator[Range]:
    """What lies before, between and behind the chunks, and as far as a scan looks for their indexes."""
    at = length = 0
    for body in bodies:
        # A scan looks as far as the index before went, and an eighth more; and to where the chunk starts.
        usual, length = length + length // 8, max(body.start - at, 0)
        yield at, at + max(usual, length) + USUAL_INDEX_BYTES
        at = body.end
    yield at, size


def _read(
    scan: ChunkedScan, bodies: Sequence[_Body], outline: Outline, unwanted: set[int]
) -> tuple[list[Range], list[tuple[_Body, set[int]]]]:
    """Chunks that are read whole; and those of which large messages of some senders are left out.

    A scan learns who sends what from the chunks: it leaves out nothing of a sender before.
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
