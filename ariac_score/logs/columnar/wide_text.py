"""Wide texts (`wstring`), which middlewares write in three ways, and no recording says in which.

In each way a text looks like a sequence of numbers, so a type with wide texts is decoded as three
types without. A message that does not end where it should, or whose texts are not UTF-16, rules a
way out. Sound messages never rule out the way in which they were written. So the text is certain
where one way remains, or several that give the same text. Otherwise the messages are refused.

Source: rosidl_typesupport_fastrtps, `cdr_serialize` of `u16string`; Fast-CDR 1 and 2, `Cdr::serialize` of
`wchar_t`; rmw_cyclonedds_cpp, serialisation of `U16StringValueType`; ROS 2 design, "Unicode support".
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype

from ariac_score.logs.columnar import Column, ColumnDecoder, Columns, Defect, Payloads
from ariac_score.logs.columnar.decode import Room
from ariac_score.logs.columnar.plan import Definitions
from ariac_score.logs.columnar.walk_many import Interned
from ariac_score.logs.containers.items import IntArray

__all__ = ["UNITS", "WideDecoder", "plain_definition", "widened"]

UNITS = ("uint32", "uint16", "uint8")
"""The numbers in each way: code units of UTF-16 in 32 bits (ROS 2 on Fast DDS, early Cyclone DDS) or in
16 bits (Fast-CDR 2 itself), or the bytes of these (Cyclone DDS). None has a terminator."""

_TYPE, _UNITS = "wide_text/msg/Wide", "units_of_wide_text"
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
_CONSTANT = re.compile(r"^[ \t]*wstring[ \t]+\w+[ \t]*=[^\n]*$", re.MULTILINE | re.ASCII)
_BOUND = re.compile(r"\bwstring<=[0-9]{1,9}\b", re.ASCII)


def plain_definition(definition: str) -> str:
    """A definition without the bounds and constants of wide texts, which rosbags does not parse."""
    return _BOUND.sub("wstring", _CONSTANT.sub("", definition))


def widened(types: Mapping[str, Any], unit: str) -> dict[str, Any]:
    """Types as rosbags has them, with a sequence of numbers in place of each wide text."""

    def described(description: Any) -> Any:
        kind, what = int(description[0]), description[1]
        if kind in (_ARRAY, _SEQUENCE):
            return description[0], (described(what[0]), what[1])
        is_wide = what[0] == "wstring" if kind == _BASE else what not in types and what.endswith("/wstring")
        return (_node(_NAME), _TYPE) if is_wide else description

    found = {
        name: (constants, [(field, described(description)) for field, description in fields])
        for name, (constants, fields) in types.items()
    }
    found[_TYPE] = [], [(_UNITS, (_node(_SEQUENCE), ((_node(_BASE), (unit, 0)), 0)))]
    return found


def _node(kind: int) -> Any:
    return Nodetype(kind)


class WideDecoder(ColumnDecoder):
    """Decodes CDR messages of a type that has wide texts; as `ColumnDecoder` does, but slower.

    Args:
        stores: For each of `UNITS` one that knows the type, `widened`.
        type_: `package/msg/Name`.
        wanted: As of `ColumnDecoder`.
    """

    def __init__(
        self, stores: Mapping[str, Definitions], type_: str, *, wanted: Iterable[str] | None = None
    ) -> None:
        paths = None if wanted is None else tuple(wanted)
        super().__init__(stores[UNITS[0]], type_, cdr=True, wanted=paths)
        everything = ColumnDecoder(stores[UNITS[0]], type_, cdr=True)
        wide = [path for path in everything.paths if path.endswith(f".{_UNITS}")]
        self._ways = {
            # Unwanted wide texts are evidence too: one that is not UTF-16 rules its way out.
            unit: ColumnDecoder(store, type_, cdr=True, wanted=None if paths is None else (*paths, *wide))
            for unit, store in stores.items()
        }
        self._texts = Interned()
        self._wanted_streams = set(super().paths)
        self._left = tuple(stores)

    @property
    def paths(self) -> tuple[str, ...]:
        """The fields it gives, in the order of the definition."""
        return tuple(path.removesuffix(f".{_UNITS}") for path in super().paths)

    def shape(self, path: str) -> tuple[str, tuple[str, ...]] | None:
        """The base type of a field and the arrays and sequences around it; `None` when there is none."""
        wide = super().shape(f"{path}.{_UNITS}")
        return super().shape(path) if wide is None else ("string", wide[1][:-1])

    def decode(self, payloads: Payloads, room: Room | None = None) -> Columns:  # noqa: ARG002
        """The wanted fields of some messages; messages that fit in no way, or in several, are named.

        Args:
            payloads: At most so many that their columns fit into memory.
            room: Not used: the same messages are decoded several times.
        """
        found = {unit: _Way(self._ways[unit], payloads, unit, self._texts) for unit in self._left}
        # A message that fits in no way is damaged, and says nothing about the way of the others.
        fitting = np.logical_or.reduce([way.fits for way in found.values()])
        left = [unit for unit, way in found.items() if way.fits[fitting].all()]
        if not left:
            return self._refused(payloads, found, "no one way to read its wide text fits all messages")
        self._left = tuple(left)  # for later calls as well: one recorder writes all messages of a topic
        first, *others = (found[unit] for unit in left)
        rows = np.flatnonzero(fitting).astype(np.int64)
        if not all(first.agrees(other, rows) for other in others):
            return self._refused(payloads, found, "its wide text can be read in more than one way")
        self.fallback = first.decoder.fallback
        columns = first.columns_of(rows)
        return Columns(
            rows,
            {
                path.removesuffix(f".{_UNITS}"): c
                for path, c in columns.items()
                if path in self._wanted_streams
            },
            tuple(Defect(row, first.cause(row)) for row in np.flatnonzero(~fitting).tolist()),
            self.fallback,
        )

    def _refused(self, payloads: Payloads, found: Mapping[str, _Way], cause: str) -> Columns:
        """No message at all, for a common cause, unless a message has a cause of its own."""
        first = next(iter(found.values()))
        defects = tuple(
            Defect(row, cause if any(way.fits[row] for way in found.values()) else first.cause(row))
            for row in range(len(payloads))
        )
        empty = first.columns_of(np.zeros(0, dtype=np.int64))
        columns = {
            path.removesuffix(f".{_UNITS}"): c for path, c in empty.items() if path in self._wanted_streams
        }
        return Columns(np.zeros(0, dtype=np.int64), columns, defects, self.fallback)


class _Way:
    """Some messages read in one way.

    Attributes:
        decoder: Of the type in this way.
        fits: Whether each message can be read so, shape (n,).
    """

    def __init__(self, decoder: ColumnDecoder, payloads: Payloads, unit: str, texts: Interned) -> None:
        self.decoder = decoder
        self._payloads, self._unit, self._texts = payloads, unit, texts
        found = decoder.decode(payloads)
        self._causes = {defect.index: defect.cause for defect in found.defects}
        self.fits = np.zeros(len(payloads), dtype=bool)
        self.fits[found.rows] = True
        for column in found.columns.values():
            if column.path.endswith(f".{_UNITS}"):
                codes, owners = self._codes(column, found.rows)
                self.fits[owners[codes < 0]] = False

    def cause(self, row: int) -> str:
        """Why a message cannot be read so."""
        return self._causes.get(row, "its wide text is not UTF-16")

    def columns_of(self, rows: IntArray) -> dict[str, Column]:
        """The fields of messages that fit, with wide texts as texts."""
        starts, ends = self._payloads.starts[rows], self._payloads.ends[rows]
        found = self.decoder.decode(Payloads(self._payloads.buffer, starts, ends)).columns
        columns = {}
        for path, column in found.items():
            columns[path] = column
            if path.endswith(f".{_UNITS}"):
                codes, _ = self._codes(column, rows)
                columns[path] = replace(
                    column,
                    path=path.removesuffix(f".{_UNITS}"),
                    values=codes.astype(np.int32),
                    offsets=column.offsets[:-1],
                    texts=tuple(self._texts.texts),
                    levels=column.levels[:-1],
                )
        return columns

    def agrees(self, other: _Way, rows: IntArray) -> bool:
        """Whether two ways give the same values for some messages."""
        ours, theirs = self.columns_of(rows), other.columns_of(rows)
        return all(_same(column, theirs[path]) for path, column in ours.items())

    def _codes(self, column: Column, rows: IntArray) -> tuple[IntArray, IntArray]:
        """The code of each text, negative if invalid, and the message it belongs to."""
        texts = replace(column, values=column.offsets[-1][1:], offsets=column.offsets[:-1])
        owners = np.repeat(rows, texts.per_message())
        big = self._payloads.buffer[self._payloads.starts[owners] + 1] == 0
        bounds = column.offsets[-1].tolist()
        codes = [
            self._code(column.values[first:last], big=is_big)
            for first, last, is_big in zip(bounds, bounds[1:], big.tolist(), strict=False)
        ]
        return np.array(codes, dtype=np.int64), owners

    def _code(self, units: NDArray[Any], *, big: bool) -> int:
        if self._unit == "uint8":
            if len(units) % 2:  # half a code unit
                return -1
            units = np.frombuffer(units.tobytes(), dtype=">u2" if big else "<u2")
        # A NUL would be a terminator, which none of the ways writes; a code unit has 16 bits.
        if (units == 0).any() or (units > 0xFFFF).any():
            return -1
        try:
            text = units.astype("<u2").tobytes().decode("utf-16-le")
        except UnicodeDecodeError:
            return -1
        return self._texts[text.encode()]


def _same(one: Column, other: Column) -> bool:
    if any(a.tolist() != b.tolist() for a, b in zip(one.offsets, other.offsets, strict=True)):
        return False
    if one.texts is not None:
        return one.text() == other.text()
    return one.values.tobytes() == other.values.tobytes()  # to the bit, so that NaN equals NaN
