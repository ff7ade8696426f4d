"""Arithmetic on the indexes of chunks: entries, records at offsets, gaps between records."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ariac_score.logs.containers.items import Bytes, IntArray

__all__ = ["IndexEntries", "check_not_crossed", "entries_of", "gaps_between", "records_at"]


class IndexEntries(NamedTuple):
    """The index entries of all messages of some chunks.

    Attributes:
        senders: Numbers of their channels or connections, shape (n,).
        stamps_ns: Their log times, ns, shape (n,).
        offsets: Where each record starts among the records of its chunk, shape (n,).
        owners: Index of the chunk that each is in, shape (n,).
    """

    senders: IntArray
    stamps_ns: IntArray
    offsets: IntArray
    owners: IntArray


def entries_of(
    indexes: Sequence[Sequence[bytes]], head: int, words: int
) -> tuple[list[bytes], IntArray, IntArray, IntArray]:
    """The entries of all index records of some chunks.

    Args:
        indexes: The bodies of the index records of each chunk.
        head: Bytes before the entries of an index record.
        words: 32-bit words of an entry.

    Returns:
        The head of each index record and how many entries it has, shape (k,); the entries,
        shape (n, words); of each entry the number of its chunk, shape (n,).

    Raises:
        ValueError: An index record holds something else.
    """
    bodies = [body for index in indexes for body in index]
    sizes = np.array([len(body) - head for body in bodies], dtype=np.int64)
    if (sizes < 0).any() or (sizes % (4 * words)).any():
        raise ValueError("the index is no list of entries")
    counts = sizes // (4 * words)
    entries = np.frombuffer(b"".join(body[head:] for body in bodies), dtype="<u4").reshape(-1, words)
    owners = np.repeat(np.arange(len(indexes)), [len(index) for index in indexes])
    return [body[:head] for body in bodies], counts, entries, np.repeat(owners, counts)


def records_at(buffer: Bytes, places: IntArray, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Records of one form at some places of a buffer.

    Raises:
        ValueError: A place is outside.
    """
    if not len(places):
        return np.zeros(0, dtype=dtype)
    if int(places.min()) < 0 or int(places.max()) + dtype.itemsize > len(buffer):
        raise ValueError("a record lies outside")
    windows = np.ndarray((len(buffer) - dtype.itemsize + 1,), f"V{dtype.itemsize}", buffer.data, strides=(1,))
    return windows[places].view(dtype)


def gaps_between(starts: IntArray, ends: IntArray, size: int) -> Iterator[tuple[int, int, int, int]]:
    """The runs of records that touch, each with the gap before it.

    Args:
        starts: Where the records start, increasing, shape (n,).
        ends: Where they end, shape (n,).
        size: The size of all, bytes.

    Yields:
        Start and end of a gap, then the first record behind it and the one behind the run's last.

    Raises:
        ValueError: Records overlap, or go beyond the end.
    """
    before = np.concatenate(([0], ends))
    after = np.concatenate((starts, [size]))
    if (after < before).any():
        raise ValueError("records overlap")
    breaks = np.flatnonzero(after > before).tolist()
    if not breaks or breaks[0] != 0:
        breaks.insert(0, 0)  # the first run always has a gap before it, if only an empty one
    for at, following in zip(breaks, [*breaks[1:], len(starts)], strict=True):
        yield int(before[at]), int(after[at]), at, following


def check_not_crossed(starts: IntArray, ends: IntArray, bounds: IntArray) -> None:
    """Make sure that no record lies on both sides of a bound.

    Args:
        starts: Where the records start, increasing, shape (n,).
        ends: Where they end, shape (n,).
        bounds: The ends of chunks, which no record may cross, shape (k,).

    Raises:
        ValueError: One does.
    """
    before = np.searchsorted(starts, bounds) - 1
    if (ends[before[before >= 0]] > bounds[before >= 0]).any():
        raise ValueError("a message goes on behind the end of its chunk")
