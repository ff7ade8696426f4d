"""Messages of many definitions, damaged, decoded together and one by one: both must say the same.

An input is a short program, so that a mutation of it changes a message and not what is a message: it
names a definition and a packing, then makes messages of whole ones, of the one before, and of bytes of
its own. Definitions, plans, and what rosbags generates for them are made once. The limits behind which
decoding takes another way are so low here that a few short messages reach all of them.
"""

from __future__ import annotations

import copy
import random
import struct
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ariac_score.logs.columnar import ColumnDecoder, Columns, Payloads, decode, walk_many
from ariac_score.logs.columnar.plan import PlanError
from ariac_score.logs.columnar.walk_many import Interned

__all__ = ["decode_both_ways", "lowered"]

_NUMBERS = ("bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64")
_CODES = dict(zip((*_NUMBERS, "float32", "float64"), "?bBbBhHiIqQfd", strict=True))
_BY_HAND = (
    {"x": "float64", "y": "uint8", "z": "int16[3]"},
    {"name": "string", "values": "float64[]", "last": "uint8"},
    {"inner": "fuzz/Inner[]", "good": "bool", "few": "int64[<=2]", "names": "string[]"},
    {"stamp": "fuzz/Stamp", "both": "fuzz/Inner[2]", "low": "float32[]", "raw": "byte[]", "c": "char"},
    {"holds": "fuzz/Outer[]", "nothing": "fuzz/Nothing", "last": "int64"},
)
_PARTS = {
    "Inner": {"frame": "string", "at": "float64[3]", "tags": "uint8[]"},
    "Outer": {"key": "uint16", "inner": "fuzz/Inner[]", "low": "fuzz/Stamp[<=3]"},
    "Stamp": {"sec": "int32", "nanosec": "uint32"},
    "Nothing": {},
}
_MADE = 59
_EACH = 8
_MOST_MESSAGES = 7
_LONGEST_BYTES = 1 << 12
_TEXTS = ("", "a", "base_link", "Ger\u00e4t", "w\u00f6rld/\u2603", "xxxxxxx")
_PACKINGS = ("cdr", "big", "ros1", "cdr")

_Fields = dict[str, str]


_LOW = (
    (decode, {"_FEW": 3, "_NEW_LAYOUTS": 2, "_MOST_LAYOUTS": 3, "_BLOCK_BYTES": 1 << 8}),
    (walk_many, {"_LONGEST_LOOP": 6}),
)
"""So that a few short messages take every way; each is a choice of speed, and none of values."""


@cache
def _types() -> dict[str, _Fields]:
    """Fields and their types of each type: some by hand, the rest by dice that always fall alike."""
    dice = random.Random(6)  # noqa: S311  # made to be repeated
    types = dict(_PARTS) | {f"T{number}": fields for number, fields in enumerate(_BY_HAND)}
    for number in range(len(_BY_HAND), len(_BY_HAND) + _MADE):
        parts = [f"fuzz/{name}" for name in types]
        bases = [*_CODES, "string", "string", "string", dice.choice(parts)]
        many = ("", "", "", "[]", "[]", "[<=2]", "[3]", "[1]")
        count = dice.choice((1, 2, 3, 5))
        types[f"T{number}"] = {f"f{i}": dice.choice(bases) + dice.choice(many) for i in range(count)}
    return types


@cache
def _store() -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.max_sequence_length = 1 << 16
    types: dict[str, Any] = {}
    for name, fields in _types().items():
        text = "\n".join(f"{type_} {field}" for field, type_ in fields.items())
        types |= get_types_from_msg(text, f"fuzz/msg/{name}")
    store.register(types)
    return store


@cache
def _whole(name: str, packing: str) -> tuple[bytes, ...]:
    """Some whole messages of a type."""
    dice, store = random.Random(name), _store()  # noqa: S311  # made to be repeated
    messages = [_message(name, dice) for _ in range(_EACH)]
    if packing == "ros1":
        return tuple(bytes(store.serialize_ros1(m, f"fuzz/msg/{name}")) for m in messages)
    little = packing == "cdr"
    return tuple(bytes(store.serialize_cdr(m, f"fuzz/msg/{name}", little_endian=little)) for m in messages)


def _message(name: str, dice: random.Random) -> Any:
    values = []
    for type_ in _types()[name].values():
        base, _, many = type_.partition("[")
        if not many:
            values.append(_value(base, dice))
            continue
        size = many.rstrip("]")
        count = int(size) if size.isdigit() else dice.choice((0, 1, 1, 2))
        items = [_value(base, dice) for _ in range(count)]
        values.append(np.array(items, dtype=np.dtype(_CODES[base])) if base in _CODES else items)
    return _store().types[f"fuzz/msg/{name}"](*(values or [0]))


def _value(base: str, dice: random.Random) -> Any:
    if base == "string":
        return dice.choice(_TEXTS)
    if base == "bool":
        return dice.random() < 0.5
    if base in _CODES:
        return struct.unpack_from(f"<{_CODES[base]}", dice.choice((dice.randbytes(8), bytes(8))))[0]
    return _message(base.partition("/")[2], dice)


@cache
def _decoder(name: str, cdr: bool, part: int) -> ColumnDecoder | None:
    """A decoder of all fields, or of every other one; nothing where no plan can express the type."""
    try:
        everything = ColumnDecoder(_store(), f"fuzz/msg/{name}", cdr=cdr)
    except PlanError:
        return None
    if part < 2:
        return everything
    return ColumnDecoder(_store(), f"fuzz/msg/{name}", cdr=cdr, wanted=everything.paths[part - 2 :: 2])


def _new(decoder: ColumnDecoder) -> ColumnDecoder:
    """One that has decoded nothing yet, without compiling again."""
    fresh = copy.copy(decoder)
    fresh._interned, fresh._layouts, fresh._remembered = Interned(), {}, 0
    return fresh


def _messages(raw: bytes, at: int, whole: tuple[bytes, ...]) -> Iterator[bytes]:
    """What the program makes."""

    def number(width: int) -> int:
        nonlocal at
        at += width
        return int.from_bytes(raw[at - width : at], "little")

    last = whole[0]
    while at < len(raw):
        match number(1) % 8:
            case 0:
                length = number(2) % _LONGEST_BYTES
                last = raw[at : at + length]
                at += length
            case 1 | 2:
                last = whole[number(1) % len(whole)]
            case 3:
                for _ in range(number(1) % 6):
                    yield last
            case 4 if last:
                place = number(2) % len(last)
                last = last[:place] + bytes([number(1)]) + last[place + 1 :]
            case 5:
                last = last[: number(2) % (len(last) + 1)]
            case 6 if last:
                place = number(2) % len(last)
                last = (last[:place] + raw[at : at + 4] + last[place + 4 :])[: max(len(last), 4)]
                at += 4
            case 7:
                length = number(1) % 16
                last = (last + raw[at : at + length])[:_LONGEST_BYTES]
                at += length
        yield last


def decode_both_ways(raw: bytes) -> None:
    """Run a program and decode what it makes, in one slab or two.

    Raises:
        AssertionError: Both ways differ.
    """
    if len(raw) < 3:
        return
    name, packing = f"T{raw[0] % (len(_BY_HAND) + _MADE)}", _PACKINGS[raw[1] & 3]
    known = _decoder(name, packing != "ros1", raw[1] >> 2 & 3)
    if known is None:
        return
    payloads = []
    for payload in _messages(raw, 2, _whole(name, packing)):
        payloads.append(payload)
        if len(payloads) == _MOST_MESSAGES:
            break
    bound = len(payloads) * max(0, (raw[1] >> 4) - 10) // 6
    ours, theirs = _new(known), _new(known)
    for some in (payloads[:bound], payloads[bound:]) if bound else (payloads,):
        joined = Payloads.joined(some)
        with lowered(_LOW):
            found = ours.decode(joined)
        _check_equal(found, theirs._one_by_one(joined, "as a reference"))
        if found.fallback:
            raise AssertionError(found.fallback)


@contextmanager
def lowered(limits: Iterable[tuple[ModuleType | type, Mapping[str, int]]]) -> Iterator[None]:
    """Constants of modules or classes with other values."""
    usual = [(module, name, getattr(module, name)) for module, values in limits for name in values]
    for module, values in limits:
        for name, value in values.items():
            setattr(module, name, value)
    try:
        yield
    finally:
        for module, name, value in usual:
            setattr(module, name, value)


def _check_equal(found: Columns, alone: Columns) -> None:
    assert found.rows.tolist() == alone.rows.tolist()
    assert [d.index for d in found.defects] == [d.index for d in alone.defects]
    assert found.columns.keys() == alone.columns.keys()
    for path, column in alone.columns.items():
        ours = found.columns[path]
        for level, expected in zip(ours.offsets, column.offsets, strict=True):
            assert level.tolist() == expected.tolist(), path
        if column.texts is not None:
            assert ours.text() == column.text(), path
            continue
        values, expected = ours.values, column.values
        assert values.dtype == expected.dtype, path
        if values.dtype == np.float32:  # a Python float cannot hold a signalling NaN
            values, expected = (np.where(np.isnan(v), np.float32(0), v) for v in (values, expected))
            assert (np.isnan(ours.values) == np.isnan(column.values)).all(), path
        assert values.tobytes() == expected.tobytes(), path
