"""Rows of the table of messages, taken from the pages of a SQLite file, many at a time.

What every recorder of ROS 2 writes is understood: rows appended one after the other, never changed. Each page
must be filled by its rows to the byte, each row must be what its lengths say, each page belong to one thing.
Whatever is unusual is left to SQLite, which is then asked from that row on.

Source: "Database File Format", sqlite.org/fileformat2.html, sections 1.2 to 1.6 and 2.1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ariac_score.logs.containers.items import Bytes, IntArray, Payloads

__all__ = ["Pages", "Rows", "UnusualError"]

_TABLE_LEAF, _TABLE_INTERIOR, _INDEX_LEAF, _INDEX_INTERIOR = 13, 5, 10, 2
_INTERIOR_HEAD, _LEAF_HEAD, _FILE_HEAD = 12, 8, 100
_BATCH_BYTES = 8 << 20
_MOST_LEVELS = 20
_LONGEST_VARINT = 5
_LOCKED_BYTE = 1 << 30
_SPARE_BYTES = 4 * _LONGEST_VARINT + 20
"""Behind the pages that are decoded: so far the lengths in a row at their very end may lead."""

_INTEGER_BYTES = np.array([0, 1, 2, 3, 4, 6, 8, -1, 0, 0], dtype=np.int64)
"""Of an integer, by its serial type; -1: it is none."""


class UnusualError(Exception):
    """Something that is left to SQLite, or damage, which it can tell in words."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Some rows of the table of messages, in their order.

    Attributes:
        numbers: Their row numbers, increasing, shape (n,).
        topics: Of each the number of its topic, shape (n,).
        stamps_ns: Their log times as they stand there, shape (n,).
        payloads: Their bytes; none for topics that nobody wants.
    """

    numbers: IntArray
    topics: IntArray
    stamps_ns: IntArray
    payloads: Payloads


class Pages:
    """One SQLite file that lies still.

    Args:
        path: The file.

    Raises:
        UnusualError: It has another form than recorders give it.
    """

    def __init__(self, path: Path) -> None:
        self._file = path.open("rb", buffering=0)
        head = self._file.read(_FILE_HEAD)
        size = path.stat().st_size
        self._bytes = int.from_bytes(head[16:18], "big")
        self._count = size // self._bytes if self._bytes >= 512 else 0
        free_pages, vacuum = (int.from_bytes(head[at : at + 4], "big") for at in (36, 52))
        whole = self._bytes >= 512 and self._count * self._bytes == size
        if not whole or self._bytes & (self._bytes - 1) or head[20:24] != b"\0\x40\x20\x20":
            self.close()
            raise UnusualError("its pages have another form")
        if free_pages or vacuum or self._count != int.from_bytes(head[28:32], "big"):
            self.close()
            raise UnusualError("it was changed after recording")
        self._seen = np.zeros(self._count + 1, dtype=bool)
        self._seen[_LOCKED_BYTE // self._bytes + 1 :][:1] = True  # nothing is ever written on that page
        self._passed_over = 0
        # Of a longer payload the rest lies on pages of its own.
        self._most_here = self._bytes - 35
        self._least_here = (self._bytes - 12) * 32 // 255 - 23

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def rows(self, root: int, unwanted: Iterable[int]) -> Iterator[Rows]:
        """The rows of a table of messages, which has the columns id, topic, time and payload.

        Args:
            root: Its first page.
            unwanted: Numbers of topics whose payloads are not fetched.

        Raises:
            UnusualError: Not all rows are as they should be; those before have been given.
        """
        deaf = np.array(sorted(unwanted), dtype=np.int64)
        leaves, bounds = self._leaves(root)
        step = max(1, _BATCH_BYTES // self._bytes)
        buffer = np.zeros(min(step, len(leaves)) * self._bytes + _SPARE_BYTES, dtype=np.uint8)
        last = np.iinfo(np.int64).min
        for first in range(0, len(leaves), step):
            some = leaves[first : first + step]
            self._read(some, buffer)
            cells = _Cells.of(buffer, len(some), self._bytes, self._here)
            numbers, upper = cells.numbers, bounds[first : first + step]
            lower = np.concatenate(([last], upper[:-1]))
            between = (numbers <= upper[cells.pages]) & (numbers > lower[cells.pages])
            if not between.all() or (np.diff(numbers) <= 0).any():
                raise UnusualError("its rows are out of order")
            last = int(upper[-1])
            yield from self._fetched(buffer, cells, deaf)

    def all_accounted(self, roots: Iterable[int]) -> bool:
        """Whether each page belongs to the rows that were read, or to another tree, by its first page.

        Of indexes the inner pages are read, and of their leaves what kind they are.
        """
        try:
            for root in roots:
                self._walk(root, 0)
        except UnusualError:
            return False
        return int(self._seen[1:].sum()) + self._passed_over == self._count

    def _mark(self, pages: IntArray) -> None:
        """Take note that pages belong to something; none may belong to two things."""
        if not len(pages):
            return
        if int(pages.min()) < 1 or int(pages.max()) > self._count:
            raise UnusualError("a page is outside of the file")
        if self._seen[pages].any() or (len(pages) > 1 and len(np.unique(pages)) != len(pages)):
            raise UnusualError("a page belongs to two things")
        self._seen[pages] = True

    def _page(self, number: int) -> Bytes:
        page = np.empty(self._bytes, dtype=np.uint8)
        self._read(np.array([number], dtype=np.int64), page)
        return page

    def _read(self, pages: IntArray, into: Bytes) -> None:
        """Read pages side by side; those that follow each other in the file at once."""
        bounds = [0, *(np.flatnonzero(np.diff(pages) != 1) + 1).tolist(), len(pages)]
        for first, behind in pairwise(bounds):
            self._file.seek((int(pages[first]) - 1) * self._bytes)
            room = into.data[first * self._bytes : behind * self._bytes]
            if self._file.readinto(room) != len(room):
                raise UnusualError("the file ends early")

    def _leaves(self, root: int) -> tuple[IntArray, IntArray]:
        """The leaves of a table in their order, and of each the largest row number it may hold."""
        level, bounds = np.array([root], dtype=np.int64), np.array([np.iinfo(np.int64).max])
        for _ in range(_MOST_LEVELS):
            self._mark(level)
            if self._page(int(level[0]))[0] == _TABLE_LEAF:
                return level, bounds
            below = list(self._below(level, bounds))
            level, bounds = (np.concatenate(parts) for parts in zip(*below, strict=True))
            if (np.diff(bounds) <= 0).any():
                raise UnusualError("its pages are out of order")
        raise UnusualError("its pages are nested too deeply")

    def _below(self, level: IntArray, bounds: IntArray) -> Iterator[tuple[IntArray, IntArray]]:
        left = self._count
        for page, bound in zip(level.tolist(), bounds.tolist(), strict=True):
            children, keys = self._inner(page, bound)
            left -= len(children)
            if left < 0:
                raise UnusualError("a page belongs to two things")
            yield children, keys

    def _inner(self, number: int, bound: int) -> tuple[IntArray, IntArray]:
        """The pages below an inner page of a table, and the largest row number of each."""
        page = self._page(number)
        if page[0] != _TABLE_INTERIOR:
            raise UnusualError("its leaves lie at different depths")
        places, children = self._children(page, 0)
        padded = np.concatenate((page, np.zeros(_SPARE_BYTES, dtype=np.uint8)))
        keys, _ = _varints(padded, places + 4)
        return children, np.append(keys, bound)

    def _children(self, page: Bytes, start: int) -> tuple[IntArray, IntArray]:
        """Where the cells of an inner page are, and the pages below it."""
        count = int.from_bytes(page[start + 3 : start + 5].tobytes(), "big")
        behind = start + _INTERIOR_HEAD + 2 * count
        if behind > self._bytes:
            raise UnusualError("a page holds more than it can")
        places = page[start + _INTERIOR_HEAD : behind].view(">u2").astype(np.int64)
        if count and (int(places.min()) < behind or int(places.max()) > self._bytes - 5):
            raise UnusualError("a page leads out of itself")
        last = page[start + 8 : start + 12].view(">u4").astype(np.int64)
        below = page[places[:, None] + np.arange(4)].view(">u4").astype(np.int64).reshape(-1)
        return places, np.concatenate((below, last))

    def _here(self, sizes: IntArray) -> IntArray:
        """How many bytes of a payload lie beside its row."""
        odd = self._least_here + (sizes - self._least_here) % (self._bytes - 4)
        return np.where(
            sizes <= self._most_here, sizes, np.where(odd <= self._most_here, odd, self._least_here)
        )

    def _fetched(self, buffer: Bytes, cells: _Cells, deaf: IntArray) -> Iterator[Rows]:
        """Rows with their payloads, of which some go on elsewhere."""
        wanted = ~np.isin(cells.topics, deaf)
        starts, ends = cells.starts, np.where(wanted, cells.starts + cells.lengths, cells.starts)
        long = np.flatnonzero(cells.elsewhere > 0)
        if not len(long):
            yield Rows(cells.numbers, cells.topics, cells.stamps_ns, Payloads(buffer, starts, ends))
            return
        self._passed_over += int(_pages_for(cells.elsewhere[long[~wanted[long]]], self._bytes).sum())
        fetched, grown, first = list[Bytes](), 0, 0
        starts, ends = starts.copy(), ends.copy()
        for row in long[wanted[long]].tolist():
            rest = self._elsewhere(int(cells.onwards[row]), int(cells.elsewhere[row]))
            here = buffer[starts[row] : ends[row] - len(rest)]
            starts[row] = len(buffer) + grown
            grown += len(here) + len(rest)
            ends[row] = len(buffer) + grown
            fetched += [here, rest]
            if grown >= _BATCH_BYTES:
                yield _some(cells, first, row + 1, Payloads(np.concatenate((buffer, *fetched)), starts, ends))
                fetched, grown, first = [], 0, row + 1
        payloads = Payloads(np.concatenate((buffer, *fetched)), starts, ends)
        if first < len(starts):
            yield _some(cells, first, len(starts), payloads)

    def _elsewhere(self, page: int, size: int) -> Bytes:
        """The rest of a payload, from a chain of pages."""
        left = int(_pages_for(np.array([size]), self._bytes)[0])
        parts = []
        while left:
            count = min(left, self._count - page + 1, max(1, _BATCH_BYTES // self._bytes))
            if page < 1 or count < 1:
                raise UnusualError("a payload goes on outside of the file")
            run = np.arange(page, page + count)
            block = np.empty(count * self._bytes, dtype=np.uint8)
            self._read(run, block)
            table = block.reshape(count, self._bytes)
            onwards = np.ascontiguousarray(table[:, :4]).view(">u4").astype(np.int64).reshape(-1)
            elsewhere = np.flatnonzero(onwards != run + 1)
            here = int(elsewhere[0]) + 1 if len(elsewhere) else count
            self._mark(run[:here])
            parts.append(table[:here, 4:].reshape(-1))
            left, page = left - here, int(onwards[here - 1])
        if page:
            raise UnusualError("a payload goes on behind its end")
        return np.concatenate(parts)[:size]

    def _walk(self, root: int, level: int) -> None:
        """Take note of the pages of some tree."""
        if level > _MOST_LEVELS:
            raise UnusualError("its pages are nested too deeply")
        self._mark(np.array([root], dtype=np.int64))
        page, start = self._page(root), _FILE_HEAD if root == 1 else 0
        kind = page[start]
        if kind in (_TABLE_INTERIOR, _INDEX_INTERIOR):
            _, children = self._children(page, start)
            for child in children.tolist():
                self._walk(child, level + 1)
        elif kind == _TABLE_LEAF:
            self._walk_leaf(page, start)
        elif kind != _INDEX_LEAF:
            raise UnusualError("a page is of no kind")

    def _walk_leaf(self, page: Bytes, start: int) -> None:
        """Take note of the pages on which the rows of a leaf go on."""
        count = int.from_bytes(page[start + 3 : start + 5].tobytes(), "big")
        behind = start + _LEAF_HEAD + 2 * count
        if behind > self._bytes:
            raise UnusualError("a page holds more than it can")
        places = page[start + _LEAF_HEAD : behind].view(">u2").astype(np.int64)
        padded = np.concatenate((page, np.zeros(_SPARE_BYTES, dtype=np.uint8)))
        if count and int(places.max()) >= self._bytes:
            raise UnusualError("a page leads out of itself")
        sizes, first = _varints(padded, places)
        _, second = _varints(padded, places + first)
        here = self._here(sizes)
        ends = places + first + second + here
        for end, size in zip(ends.tolist(), (sizes - here).tolist(), strict=True):
            if size and end + 4 > self._bytes:
                raise UnusualError("a row is longer than its page")
            if size:
                self._elsewhere(int.from_bytes(page[end : end + 4].tobytes(), "big"), size)


@dataclass(frozen=True, eq=False)
class _Cells:
    """The rows of some leaves that lie side by side.

    Attributes:
        pages: Of each row the leaf it is on.
        numbers, topics, stamps_ns: As of `Rows`.
        starts: Where its payload starts in the buffer.
        lengths: How long it is.
        elsewhere: How much of it lies on other pages.
        onwards: The first of these; 0 without any.
    """

    pages: IntArray
    numbers: IntArray
    topics: IntArray
    stamps_ns: IntArray
    starts: IntArray
    lengths: IntArray
    elsewhere: IntArray
    onwards: IntArray

    @classmethod
    def of(cls, buffer: Bytes, count: int, size: int, here_of: Callable[[IntArray], IntArray]) -> _Cells:
        """Read them.

        Args:
            buffer: The leaves, and some room behind them.
            count: How many leaves.
            size: Bytes of one.
            here_of: How much of so large a row lies on its own page.

        Raises:
            UnusualError: Something is not as it should be.
        """
        pages, places = _places(buffer[: count * size].reshape(count, size))
        sizes, first = _varints(buffer, places)
        numbers, second = _varints(buffer, places + first)
        record = places + first + second
        here = here_of(sizes)
        elsewhere = sizes - here
        _check_filled(pages, places, record + here + np.where(elsewhere > 0, 4, 0), size)
        topic_type, stamp_type = (buffer[record + at].astype(np.int64) for at in (2, 3))
        payload_type, third = _varints(buffer, record + 4)
        lengths = payload_type // 2 - 6
        topics = _integers(buffer, record + 4 + third, topic_type)
        at = record + 4 + third + _INTEGER_BYTES[topic_type]
        stamps_ns = _integers(buffer, at, stamp_type)
        starts = at + _INTEGER_BYTES[stamp_type]
        headed = (buffer[record] == 4 + third) & (buffer[record + 1] == 0)
        filled = starts + lengths == record + sizes
        if not (headed & filled & (payload_type >= 12) & (payload_type % 2 == 0)).all():
            raise UnusualError("a row is no plain message")
        if (starts > record + here).any():
            raise UnusualError("a row is split before its payload")
        onwards = np.zeros(len(places), dtype=np.int64)
        long = np.flatnonzero(elsewhere > 0)
        for byte in range(4):
            onwards[long] = onwards[long] << 8 | buffer[record[long] + here[long] + byte]
        return cls(pages, numbers, topics, stamps_ns, starts, lengths, elsewhere, onwards)


def _places(leaves: Bytes) -> tuple[IntArray, IntArray]:
    """Of each row of some leaves which leaf it is on, and where it starts among them."""
    count, size = leaves.shape
    heads = np.ascontiguousarray(leaves[:, :_LEAF_HEAD])
    rows = heads[:, 3].astype(np.int64) << 8 | heads[:, 4]
    content = heads[:, 5].astype(np.int64) << 8 | heads[:, 6]
    if (heads[:, 0] != _TABLE_LEAF).any() or heads[:, [1, 2, 7]].any():
        raise UnusualError("a page is no leaf, or something was taken out of it")
    if (rows < 1).any() or (_LEAF_HEAD + 2 * rows > size).any():
        raise UnusualError("a page holds nothing, or more than it can")
    pages = np.repeat(np.arange(count, dtype=np.int64), rows)
    first = np.cumsum(rows) - rows
    pointers = pages * size + _LEAF_HEAD + 2 * (np.arange(len(pages)) - first[pages])
    flat = leaves.reshape(-1)
    inside = flat[pointers].astype(np.int64) << 8 | flat[pointers + 1]
    if (inside[first + rows - 1] != content).any() or (inside < (_LEAF_HEAD + 2 * rows)[pages]).any():
        raise UnusualError("the rows of a page are not where its head says")
    if (inside >= size).any():
        raise UnusualError("a page leads out of itself")
    return pages, pages * size + inside


def _check_filled(pages: IntArray, places: IntArray, ends: IntArray, size: int) -> None:
    """Make sure that rows fill their pages from the end on, one before the other."""
    first = np.ones(len(pages), dtype=bool)
    first[1:] = np.diff(pages) != 0
    due = np.empty(len(pages), dtype=np.int64)
    due[1:] = places[:-1]
    due[first] = (pages[first] + 1) * size
    if (ends != due).any():
        raise UnusualError("rows do not fill their page")


def _some(cells: _Cells, first: int, behind: int, payloads: Payloads) -> Rows:
    """Some of the rows of a batch."""
    rows = slice(first, behind)
    chosen = Payloads(payloads.buffer, payloads.starts[rows], payloads.ends[rows])
    return Rows(cells.numbers[rows], cells.topics[rows], cells.stamps_ns[rows], chosen)


def _pages_for(sizes: IntArray, page: int) -> IntArray:
    """How many pages hold the rest of payloads; each begins with the number of the next."""
    return -(-sizes // (page - 4))


def _varints(buffer: Bytes, places: IntArray) -> tuple[IntArray, IntArray]:
    """Numbers of variable length, and how many bytes each takes."""
    values = buffer[places].astype(np.int64)
    lengths = np.ones(len(places), dtype=np.int64)
    going_on = np.flatnonzero(values >= 128)
    values[going_on] &= 127
    for at in range(1, _LONGEST_VARINT):
        if not len(going_on):
            return values, lengths
        byte = buffer[places[going_on] + at]
        values[going_on] = values[going_on] << 7 | (byte & 127)
        lengths[going_on] += 1
        going_on = going_on[byte >= 128]
    if len(going_on):
        raise UnusualError("a number is larger than any that recorders write")
    return values, lengths


def _integers(buffer: Bytes, places: IntArray, types: IntArray) -> IntArray:
    """Integers of any size, by their serial types."""
    largest = len(_INTEGER_BYTES) - 1
    if int(types.max(initial=0)) > largest or not types.all() or (_INTEGER_BYTES[types] < 0).any():
        raise UnusualError("a row holds something else than a number")
    values = np.zeros(len(places), dtype=np.int64)
    for kind in np.flatnonzero(np.bincount(types)).tolist():
        rows = np.flatnonzero(types == kind)
        if kind >= 8:
            values[rows] = kind - 8
            continue
        size = int(_INTEGER_BYTES[kind])
        found = buffer[places[rows]].astype(np.int8).astype(np.int64)  # the first byte has the sign
        for at in range(1, size):
            found = found << 8 | buffer[places[rows] + at]
        values[rows] = found
    return values
