"""Where the records of a chunk lie: from its index, where that agrees with the chunk."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ariac_score.logs.columnar.columns import Bytes, IntArray

__all__ = ["gaps_between", "words_at"]


def words_at(buffer: Bytes, places: IntArray, dtype: str) -> IntArray:
    """Little-endian numbers at some places of a buffer, in which they must lie.

    Raises:
        ValueError: A place is outside, or a number is beyond 63 bits.
    """
    size = np.dtype(dtype).itemsize
    if not len(places):
        return np.zeros(0, dtype=np.int64)
    if int(places.min()) < 0 or int(places.max()) + size > len(buffer):
        raise ValueError("a number lies outside")
    windows = np.ndarray((len(buffer) - size + 1,), f"V{size}", buffer.data, strides=(1,))
    found = windows[places].view(f"<{dtype}")
    if dtype == "u8" and int(found.max()) >= 1 << 63:
        raise ValueError("a number is beyond 63 bits")
    return found.astype(np.int64)


def gaps_between(starts: IntArray, ends: IntArray, size: int) -> Iterator[tuple[int, int, int, int]]:
    """The runs of records that touch, each with the gap before it.

    Args:
        starts: Where the records start, increasing, shape (n,).
        ends: Where they end, shape (n,).
        size: Where all ends.

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
        breaks.insert(0, 0)
    for at, following in zip(breaks, [*breaks[1:], len(starts)], strict=True):
        yield int(before[at]), int(after[at]), at, following
