"""Walking one message in Python, to find a layout that other messages may share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ariac_score.logs.columnar.plan import Block, DecodePlan, Repeat, Step, Text
from ariac_score.logs.containers.items import IntArray

__all__ = ["Layout", "MisfitError", "lay_out"]

_MOST_ELEMENTS = 1 << 22
"""Elements of variable size are walked one by one in Python; a hostile message must not have millions."""


class MisfitError(Exception):
    """A message does not fit its definition; the text says where."""


@dataclass
class Layout:
    """The offsets of the values in a message, and the bytes that decide them.

    A message of the same size with the same deciding bytes has the same layout, for walking it
    would take the same steps. Length words decide, and texts: these are checked and kept with the layout.

    Attributes:
        big: Whether its numbers are big-endian.
        deciding: Stretches of deciding bytes, from the start of the message; neighbours are joined.
        offsets: For each stream of numbers, the offsets of its values.
        counts: For each stream of lengths, its values.
        texts: For each stream of texts, its values.
    """

    big: bool
    deciding: list[tuple[int, int]] = field(default_factory=list)
    offsets: dict[int, IntArray] = field(default_factory=dict)
    counts: dict[int, IntArray] = field(default_factory=dict)
    texts: dict[int, list[str]] = field(default_factory=dict)


def lay_out(plan: DecodePlan, message: bytes) -> Layout:
    """Walk a message.

    Raises:
        MisfitError: It does not fit the plan.
    """
    head = 4 if plan.cdr else 0
    big = False
    if plan.cdr:
        if message[:2] not in (b"\0\0", b"\0\1"):
            raise MisfitError("its encapsulation is not plain CDR")
        big = message[1] == 0
    walker = _Walker(plan, message, head, big)
    end = walker.run(plan.steps, 0)
    walker.finish(end)
    return walker.layout


class _Walker:
    def __init__(self, plan: DecodePlan, message: bytes, head: int, big: bool) -> None:
        self._plan, self._message, self._head = plan, message, head
        self._order = "big" if big else "little"
        self._size = len(message) - head
        self._offsets: dict[int, list[IntArray]] = {}
        self._counts: dict[int, list[IntArray]] = {}
        # The encapsulation decides, too: it gives the byte order.
        self._runs: list[tuple[int, int]] = [(0, 2)] if head else []
        self._elements = 0
        self.layout = Layout(big)
        if self._size < 0:
            raise MisfitError("it is shorter than its encapsulation")

    def run(self, steps: Sequence[Step], at: int) -> int:
        for step in steps:
            if isinstance(step, Block):
                at = self._block(step, at)
            elif isinstance(step, Text):
                at = self._text(step, at)
            else:
                at = self._repeat(step, at)
        return at

    def finish(self, end: int) -> None:
        left = self._size - end
        # Some middlewares pad a CDR message to a multiple of 4 bytes.
        if left < 0 or left > (3 if self._plan.cdr else 0):
            raise MisfitError(f"{left} bytes follow its last field")
        layout = self.layout
        for stream in self._plan.streams:
            if stream.kind == "string":
                layout.texts.setdefault(stream.number, [])
            elif stream.kind == "length":
                layout.counts[stream.number] = _flat(self._counts.get(stream.number, []))
            else:
                layout.offsets[stream.number] = _flat(self._offsets.get(stream.number, []))
        for start, stop in self._runs:
            if layout.deciding and layout.deciding[-1][1] == start:
                layout.deciding[-1] = (layout.deciding[-1][0], stop)
            else:
                layout.deciding.append((start, stop))

    def _block(self, block: Block, at: int) -> int:
        phase = at & 7
        end = at + int(block.lengths[phase])
        if end > self._size:
            raise MisfitError(f"it ends before its field at byte {at}")
        for stream, table in block.kept:
            self._offsets.setdefault(stream, []).append(table[phase] + (at + self._head))
        for stream, counts in block.counts:
            self._counts.setdefault(stream, []).append(counts)
        return end

    def _word(self, at: int) -> tuple[int, int]:
        """A length word, and the offset behind it."""
        if self._plan.cdr:
            at = (at + 3) & -4  # rounded up to a multiple of 4
        if at + 4 > self._size:
            raise MisfitError(f"it ends before its length at byte {at}")
        start = at + self._head
        word = int.from_bytes(self._message[start : start + 4], self._order)  # type: ignore[arg-type]
        self._runs.append((start, start + 4))
        return word, at + 4

    def _text(self, text: Text, at: int) -> int:
        length, at = self._word(at)
        end = at + length
        # The length of a CDR text counts its terminator, so it is at least 1; ROS 1 writes none.
        if end > self._size or (self._plan.cdr and not length):
            raise MisfitError(f"its text of {length} bytes at byte {at} cannot be there")
        raw = self._message[at + self._head : end + self._head]
        if self._plan.cdr:
            if raw[-1]:
                raise MisfitError(f"its text at byte {at} has no terminator")
            raw = raw[:-1]
        try:
            found = raw.decode()
        except UnicodeDecodeError as error:
            raise MisfitError(f"its text at byte {at} is not UTF-8") from error
        # Texts are no numbers to be copied: messages share a layout only where their texts are equal.
        if length:
            self._runs.append((at + self._head, end + self._head))
        if text.stream is not None:
            self.layout.texts.setdefault(text.stream, []).append(found)
        return end

    def _repeat(self, repeat: Repeat, at: int) -> int:
        count = repeat.count
        if count is None:
            count, at = self._word(at)
            # Before anything is allocated: the number comes from the message.
            if count > self._plan.longest_sequence or at + count * repeat.least > self._size:
                raise MisfitError(f"its sequence of {count} elements at byte {at} cannot be there")
        elif at + count * repeat.least > self._size:
            raise MisfitError(f"it ends before its array at byte {at}")
        if repeat.lengths is not None:
            self._counts.setdefault(repeat.lengths, []).append(np.array([count], dtype=np.int64))
        if all(isinstance(step, Block) for step in repeat.body):
            block = repeat.body[0] if repeat.body else None
            return self._blocks(block, count, at) if count and isinstance(block, Block) else at
        self._elements += count
        if self._elements > _MOST_ELEMENTS:
            raise MisfitError(f"it has more than {_MOST_ELEMENTS} elements")
        for _ in range(count):
            at = self.run(repeat.body, at)
        return at

    def _blocks(self, block: Block, count: int, at: int) -> int:
        """Elements of fixed size. Only the first may start at another alignment than all others."""
        second = at + int(block.lengths[at & 7])
        stride = int(block.lengths[second & 7])
        end = second + (count - 1) * stride
        if end > self._size:
            raise MisfitError(f"it ends before its {count} elements at byte {at}")
        following = second + stride * np.arange(count - 1, dtype=np.int64)
        for stream, table in block.kept:
            others = (following[:, None] + table[second & 7]).reshape(-1)
            places = np.concatenate((table[at & 7] + at, others)) + self._head
            self._offsets.setdefault(stream, []).append(places)
        for stream, counts in block.counts:
            self._counts.setdefault(stream, []).append(np.tile(counts, count))
        return end


def _flat(parts: list[IntArray]) -> IntArray:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
