"""A message definition compiled into a plan: how to walk its bytes, and which of them to keep.

A message is a list of steps. A `Block` is a run of fields of fixed size, whose offsets
depend on nothing but the alignment of its start; a `Text` or a `Repeat` moves the fields
behind it. Kept values go into streams: the values of one field, or the lengths of one
array or sequence, message after message.

CDR aligns a number to its own size, counted from behind the encapsulation, so the offsets
in a block differ with its start modulo 8, the largest alignment. ROS 1 aligns nothing.

Source: OMG CDR (XCDR1, plain), as ROS 2 writes it; ROS wiki, "msg", section "Serialization".
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ariac_score.logs.containers.items import IntArray

__all__ = [
    "Block",
    "DecodePlan",
    "Definitions",
    "Field",
    "PlanError",
    "Repeat",
    "Step",
    "Stream",
    "Text",
    "compile_plan",
]

_NUMBERS = {
    "bool": "u1",
    "byte": "i1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "i2",
    "uint16": "u2",
    "int32": "i4",
    "uint32": "u4",
    "int64": "i8",
    "uint64": "u8",
    "float32": "f4",
    "float64": "f8",
}
"""As rosbags has them: `byte` is signed, `char` is not."""

_BASE, _NAME, _ARRAY = 1, 2, 3
# A definition is hostile input: a few lines of nested arrays can stand for more offsets than fit into memory.
_LARGEST_BLOCK_BYTES = 1 << 22
_DEEPEST = 64
_MOST_STEPS = 4096
_DUMMY = "structure_needs_at_least_one_member"
"""The byte that ROS 2 writes into an empty message, for IDL has no empty structures; ROS 1 writes none."""


class Definitions(Protocol):
    """The part of a type store of rosbags that decoding uses."""

    max_sequence_length: int

    @property
    def fielddefs(self) -> Any:
        """Constants and fields of each type, by name."""

    def deserialize_cdr(self, rawdata: bytes, typename: str) -> object:
        """One CDR message."""

    def deserialize_ros1(self, rawdata: bytes, typename: str) -> object:
        """One message as ROS 1 packs it."""


class PlanError(Exception):
    """A definition that no plan can express; the text says why."""


@dataclass(frozen=True)
class Stream:
    """One sequence of values that is kept.

    Attributes:
        number: Its place among the streams of the plan.
        path: Of the field; of lengths, that of the array or sequence.
        kind: Base type of the field, `string`, or `length`.
        levels: The streams of lengths around it, outermost first.
    """

    number: int
    path: str
    kind: str
    levels: tuple[int, ...]

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of its values in a column."""
        if self.kind in ("string", "length"):
            return np.dtype(np.int32 if self.kind == "string" else np.int64)
        return np.dtype(np.bool_) if self.kind == "bool" else np.dtype(_NUMBERS[self.kind])

    @property
    def size(self) -> int:
        """Bytes of one number in a message."""
        return np.dtype(_NUMBERS[self.kind]).itemsize


@dataclass(frozen=True, eq=False)
class Block:
    """Fields of fixed size.

    Attributes:
        lengths: Bytes from the start of the block to its end, for each start modulo 8, shape (8,).
        kept: Streams, each with the offsets of its values from the start of the block, shape (8, k).
        counts: Streams of the lengths of fixed arrays in it, each with those lengths.
    """

    lengths: IntArray
    kept: tuple[tuple[int, IntArray], ...] = ()
    counts: tuple[tuple[int, IntArray], ...] = ()

    @property
    def least(self) -> int:
        """The fewest bytes it takes."""
        return int(self.lengths.min())


@dataclass(frozen=True)
class Text:
    """A string; kept in a stream unless that is `None`."""

    stream: int | None


@dataclass(frozen=True)
class Repeat:
    """Elements one after the other.

    Attributes:
        count: Their number; `None` for a sequence, whose length stands in the message.
        lengths: The stream of their number; `None` when it is not kept.
        body: The steps of one element.
        least: The fewest bytes an element takes.
    """

    count: int | None
    lengths: int | None
    body: tuple[Step, ...]
    least: int


Step = Block | Text | Repeat


@dataclass(frozen=True)
class Field:
    """One kept field as a tree, for reading it out of a message object.

    Attributes:
        name: Its name.
        streams: The streams of lengths of the array or sequence that it is, if it is one,
            and of its values.
        inner: The kept fields of the messages that it holds.
        repeated: Whether it is an array or a sequence.
    """

    name: str
    lengths: int | None
    values: int | None
    inner: tuple[Field, ...]
    repeated: bool


@dataclass(frozen=True)
class DecodePlan:
    """How the messages of one type are decoded.

    Attributes:
        type: Its name.
        cdr: Whether they are CDR; otherwise as ROS 1 packs them.
        steps: What a message consists of.
        streams: The kept values.
        fields: The kept fields as a tree.
        longest_sequence: Sequences with more elements are refused.
    """

    type: str
    cdr: bool
    steps: tuple[Step, ...]
    streams: tuple[Stream, ...]
    fields: tuple[Field, ...]
    longest_sequence: int


def compile_plan(
    store: Definitions, type_: str, *, cdr: bool, wanted: Iterable[str] | None = None
) -> DecodePlan:
    """Compile the definition of a type.

    Args:
        store: Knows the type and what it consists of.
        type_: `package/msg/Name`.
        cdr: Whether messages are CDR; otherwise as ROS 1 packs them.
        wanted: Dotted paths of the fields to keep, or of messages of which all fields
            are kept; `None` keeps everything. Paths that do not exist are ignored.

    Raises:
        PlanError: The definition cannot be expressed, or the store lacks a type.
    """
    compiler = _Compiler(store, cdr=cdr, wanted=None if wanted is None else frozenset(wanted))
    steps, fields = compiler.message(type_, (), (), keep=wanted is None)
    return DecodePlan(type_, cdr, tuple(steps), tuple(compiler.streams), fields, store.max_sequence_length)


@dataclass
class _Fixed:
    """A block while it grows: for each start modulo 8 its end and its kept offsets."""

    ends: list[int] = field(default_factory=lambda: list(range(8)))
    kept: dict[int, list[list[int]]] = field(default_factory=dict)
    counts: dict[int, list[int]] = field(default_factory=dict)

    def add(self, size: int, align: int, stream: int | None) -> None:
        for phase in range(8):  # every alignment the block may start at
            at = -(-self.ends[phase] // align) * align  # rounded up
            self.ends[phase] = at + size
            if stream is not None:
                self.kept.setdefault(stream, [[] for _ in range(8)])[phase].append(at - phase)

    def block(self) -> Block:
        lengths = np.array(self.ends, dtype=np.int64) - np.arange(8)
        return Block(
            lengths,
            tuple((stream, np.array(rows, dtype=np.int64)) for stream, rows in self.kept.items()),
            tuple((stream, np.array(counts, dtype=np.int64)) for stream, counts in self.counts.items()),
        )


class _Compiler:
    def __init__(self, store: Definitions, *, cdr: bool, wanted: frozenset[str] | None) -> None:
        self._store, self._cdr, self._wanted = store, cdr, wanted
        self.streams: list[Stream] = []
        self._steps = 0
        self._open: list[str] = []

    def message(
        self, type_: str, path: tuple[str, ...], levels: tuple[int, ...], *, keep: bool
    ) -> tuple[list[Step], tuple[Field, ...]]:
        """The steps of a message, neighbouring fields of fixed size joined, and what is kept of it."""
        if type_ in self._open or len(self._open) > _DEEPEST:
            raise PlanError(f"type {type_!r} contains itself")
        self._open.append(type_)
        steps: list[Step] = []
        kept: list[Field] = []
        for name, description in self._members(type_):
            found, tree = self._field(name, description, (*path, name), levels, keep=keep)
            steps += found
            kept += tree
        self._open.pop()
        return list(_joined(steps)), tuple(kept)

    def _members(self, type_: str) -> list[tuple[str, Any]]:
        if type_ not in self._store.fielddefs:
            raise PlanError(f"type {type_!r} is not known")
        members = self._store.fielddefs[type_][1]
        return [(n, d) for n, d in members if self._cdr or n != _DUMMY]

    def _field(
        self, name: str, description: Any, path: tuple[str, ...], levels: tuple[int, ...], *, keep: bool
    ) -> tuple[list[Step], list[Field]]:
        self._steps += 1
        if self._steps > _MOST_STEPS:
            raise PlanError(f"it has more than {_MOST_STEPS} fields")
        keep = keep or self._wanted is None or ".".join(path) in self._wanted
        kind, what = description
        if kind == _BASE:
            step, stream = self._base(what[0], path, levels, keep=keep)
            tree = [Field(name, None, stream, (), repeated=False)] if stream is not None else []
            return [step], tree
        if kind == _NAME:
            steps, inner = self.message(what, path, levels, keep=keep)
            return steps, [Field(name, None, None, inner, repeated=False)] if inner else []
        return self._repeat(name, what, path, levels, fixed=kind == _ARRAY, keep=keep)

    def _base(
        self, base: str, path: tuple[str, ...], levels: tuple[int, ...], *, keep: bool
    ) -> tuple[Step, int | None]:
        if base != "string" and base not in _NUMBERS:
            raise PlanError(f"type {base!r} is not decoded")
        stream = self._stream(path, base, levels) if keep else None
        if base == "string":
            return Text(stream), stream
        fixed, size = _Fixed(), np.dtype(_NUMBERS[base]).itemsize
        fixed.add(size, size if self._cdr else 1, stream)
        return fixed.block(), stream

    def _stream(self, path: tuple[str, ...], kind: str, levels: tuple[int, ...]) -> int:
        self.streams.append(Stream(len(self.streams), ".".join(path), kind, levels))
        return len(self.streams) - 1

    def _repeat(
        self, name: str, what: Any, path: tuple[str, ...], levels: tuple[int, ...], *, fixed: bool, keep: bool
    ) -> tuple[list[Step], list[Field]]:
        (kind, element), bound = what
        if bound < 0:  # rosbags parses it
            raise PlanError(f"an array of {bound} elements cannot be laid out")
        # Before its values: they refer to it as their innermost level.
        own = self._stream(path, "length", levels)
        inner: tuple[Field, ...] = ()
        values: int | None = None
        if kind == _BASE:
            step, values = self._base(element[0], path, (*levels, own), keep=keep)
            body: list[Step] = [step]
        else:
            body, inner = self.message(element, path, (*levels, own), keep=keep)
        if not keep and not inner:
            # Nothing of it is kept, so its length is not either. Streams are numbered by place: give it back.
            assert self.streams[-1].number == own
            self.streams.pop()
            lengths, tree = None, []
        else:
            lengths, tree = own, [Field(name, own, values, inner, repeated=True)]
        repeat = Repeat(bound if fixed else None, lengths, tuple(body), sum(_least(s) for s in body))
        # Their number would not be bounded by the size of the message, but each would be kept.
        if body and not fixed and not repeat.least and inner:
            raise PlanError("it has a sequence whose elements take no bytes and are not empty")
        return [_unrolled(repeat) or repeat], tree


def _least(step: Step) -> int:
    if isinstance(step, Block):
        return step.least
    if isinstance(step, Text):
        return 4  # its length word
    return 4 if step.count is None else step.count * step.least


def _unrolled(repeat: Repeat) -> Block | None:
    """A fixed array of fixed elements as one block."""
    if repeat.count is None or not all(isinstance(step, Block) for step in repeat.body):
        return None
    if repeat.count * max(repeat.least, 1) > _LARGEST_BLOCK_BYTES:
        raise PlanError(f"an array of {repeat.count} elements is too large to be laid out")
    body = [step for step in repeat.body if isinstance(step, Block)]
    block = body[0] if body else _Fixed().block()
    repeated = _times(block, repeat.count)
    if repeat.lengths is None:
        return repeated
    own = (repeat.lengths, np.array([repeat.count], dtype=np.int64))
    return Block(repeated.lengths, repeated.kept, (own, *repeated.counts))


def _times(block: Block, count: int) -> Block:
    """Several copies of a block, each at the end of the one before."""
    phases = np.arange(8)
    if not count:
        return Block(np.zeros(8, dtype=np.int64))
    second = block.lengths  # from the start of the first to the start of the second
    inner = (phases + second) % 8
    # All numbers have sizes that divide 8, so from the second element on every start has the same alignment.
    stride = block.lengths[inner]
    starts = np.concatenate(
        (np.zeros((8, 1), np.int64), second[:, None] + stride[:, None] * np.arange(count - 1)), axis=1
    )
    phase_of = np.concatenate((phases[:, None], np.repeat(inner[:, None], count - 1, axis=1)), axis=1)
    kept = tuple(
        (stream, (starts[:, :, None] + table[phase_of]).reshape(8, -1)) for stream, table in block.kept
    )
    counts = tuple((stream, np.tile(lengths, count)) for stream, lengths in block.counts)
    return Block(second + stride * (count - 1), kept, counts)


def _joined(steps: Iterable[Step]) -> Iterator[Step]:
    """Neighbouring blocks as one."""
    last: Block | None = None
    for step in steps:
        if isinstance(step, Block):
            last = step if last is None else _after(last, step)
            continue
        if last is not None:
            yield last
            last = None
        yield step
    if last is not None:
        yield last


def _after(first: Block, second: Block) -> Block:
    phase = (np.arange(8) + first.lengths) % 8
    lengths = first.lengths + second.lengths[phase]
    if int(lengths.max()) > _LARGEST_BLOCK_BYTES:
        raise PlanError("its fields of fixed size are too large to be laid out")
    # A stream stands in one place of the definition, so in one of the two.
    moved = tuple((stream, first.lengths[:, None] + table[phase]) for stream, table in second.kept)
    return Block(lengths, (*first.kept, *moved), (*first.counts, *second.counts))
