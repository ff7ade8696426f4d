"""Messages with wide texts, written in any way and damaged: read as a reader of our own reads them alone.

An input is a short program: it names a definition, an order of bytes and a way of writing, then makes
messages in that way or another, and damages them. The reader here goes through one message in one way,
number by number, and knows nothing of plans and columns. What is left of the three ways when all
messages are seen, and whether these agree, must come out alike.
"""

from __future__ import annotations

import copy
import random
import struct
from collections.abc import Iterator
from functools import cache
from typing import Any, TypeAlias

from ariac_score.logs.columnar import ColumnDecoder, Columns, Payloads
from ariac_score.logs.columnar.types import column_decoder_for
from ariac_score.logs.columnar.walk_many import Interned
from ariac_score.logs.columnar.wide_text import UNITS, WideDecoder
from ariac_score.logs.containers.items import Connection

__all__ = ["decode_wide_texts"]

_Type: TypeAlias = "str | tuple[_Type, int] | dict[str, _Type]"
"""A number, `w` for a wide text; elements and how many (0: as many as are counted); or fields."""

_INNER: dict[str, _Type] = {"w": "w", "v": "h"}
_TYPES: tuple[dict[str, _Type], ...] = (
    {"data": "w"},
    {"first": "B", "name": "w", "x": "d"},
    {"all": ("w", 0), "last": "H"},
    {"two": ("w", 2), "xs": ("d", 0), "z": "b"},
    {"inner": (_INNER, 0), "n": "q", "last": "w"},
    {"one": _INNER, "few": ("I", 3), "more": ("w", 0)},
)
_NAMES = {"B": "uint8", "b": "int8", "H": "uint16", "h": "int16", "I": "uint32", "q": "int64", "d": "float64"}
_TEXTS = ("", "a", "ab", "abc", "Ger\u00e4t \u2603", "\U0001f916", "xy\uffff", "wide text")
_MOST_MESSAGES, _MOST_ELEMENTS = 6, 3


class _NoMessageError(Exception):
    """The bytes are no message in this way."""


class _Reader:
    """Reads one message in one way, from its beginning to its end."""

    def __init__(self, raw: bytes, way: str) -> None:
        self._raw, self._way, self._at = raw[4:], way, 0
        self._order = "<" if raw[1] else ">"

    def message(self, fields: dict[str, _Type]) -> dict[str, Any]:
        found = {name: self._value(type_) for name, type_ in fields.items()}
        if len(self._raw) - self._at > 3:  # what is more is no padding
            raise _NoMessageError
        return found

    def _number(self, code: str) -> Any:
        size = struct.calcsize(code)
        self._at += -self._at % size
        if self._at + size > len(self._raw):
            raise _NoMessageError
        self._at += size
        return struct.unpack_from(self._order + code, self._raw, self._at - size)[0]

    def _value(self, type_: _Type) -> Any:
        if isinstance(type_, dict):
            return {name: self._value(inner) for name, inner in type_.items()}
        if isinstance(type_, tuple):
            count = type_[1] or self._number("I")
            return [self._value(type_[0]) for _ in range(count)]
        return self._text() if type_ == "w" else self._number(type_)

    def _text(self) -> str:
        count = self._number("I")
        if self._way == "uint8":
            if count % 2 or self._at + count > len(self._raw):
                raise _NoMessageError
            self._at += count
            raw = self._raw[self._at - count : self._at]
        else:
            units = [self._number("I" if self._way == "uint32" else "H") for _ in range(count)]
            if any(unit > 0xFFFF for unit in units):
                raise _NoMessageError
            raw = struct.pack(f"{self._order}{count}H", *units)
        if b"\0\0" in (raw[i : i + 2] for i in range(0, len(raw), 2)):
            raise _NoMessageError
        try:
            return raw.decode("utf-16-le" if self._order == "<" else "utf-16-be")
        except UnicodeDecodeError:
            raise _NoMessageError from None


class _Writer:
    """Writes one message in one way."""

    def __init__(self, way: str, order: str, dice: random.Random) -> None:
        self._way, self._order, self._dice, self._raw = way, order, dice, bytearray()

    def message(self, fields: dict[str, _Type]) -> bytes:
        for type_ in fields.values():
            self._value(type_)
        padding = -len(self._raw) % 4 if self._dice.random() < 0.5 else 0
        return (b"\0\1\0\0" if self._order == "<" else bytes(4)) + bytes(self._raw) + bytes(padding)

    def _number(self, code: str, value: float) -> None:
        self._raw += bytes(-len(self._raw) % struct.calcsize(code)) + struct.pack(self._order + code, value)

    def _value(self, type_: _Type) -> None:
        if isinstance(type_, dict):
            for inner in type_.values():
                self._value(inner)
        elif isinstance(type_, tuple):
            count = type_[1] or self._dice.randrange(_MOST_ELEMENTS + 1)
            if not type_[1]:
                self._number("I", count)
            for _ in range(count):
                self._value(type_[0])
        elif type_ == "w":
            self._text(self._dice.choice(_TEXTS))
        else:
            self._number(type_, self._dice.randrange(100))

    def _text(self, text: str) -> None:
        raw = text.encode("utf-16-le" if self._order == "<" else "utf-16-be")
        self._number("I", len(raw) if self._way == "uint8" else len(raw) // 2)
        if self._way == "uint32":
            for unit in struct.unpack(f"{self._order}{len(raw) // 2}H", raw):
                self._number("I", unit)
        else:
            self._raw += raw


def _definition(fields: dict[str, _Type]) -> str:
    def line(name: str, type_: _Type) -> str:
        base, many = type_ if isinstance(type_, tuple) else (type_, None)
        shown = "fuzz/Inner" if isinstance(base, dict) else "wstring" if base == "w" else _NAMES[str(base)]
        return f"{shown}{'' if many is None else f'[{many or str()}]'} {name}"

    def text(fields: dict[str, _Type]) -> str:
        return "\n".join(line(name, type_) for name, type_ in fields.items())

    return f"{text(fields)}\n{'=' * 80}\nMSG: fuzz/Inner\n{text(_INNER)}\n"


@cache
def _decoder(number: int) -> WideDecoder:
    found = column_decoder_for(
        Connection("/wide", f"fuzz/msg/T{number}", "cdr", _definition(_TYPES[number]), "ros2msg")
    )
    assert isinstance(found, WideDecoder)
    return found


def _new(known: WideDecoder) -> WideDecoder:
    """One that has decoded nothing yet, without compiling again."""

    def fresh(decoder: ColumnDecoder) -> ColumnDecoder:
        found = copy.copy(decoder)
        found._interned, found._layouts, found._remembered = Interned(), {}, 0
        return found

    found = copy.copy(known)
    found._ways = {unit: fresh(way) for unit, way in known._ways.items()}
    found._texts, found._left = Interned(), tuple(UNITS)
    return found


def _messages(raw: bytes, fields: dict[str, _Type], way: int, order: str) -> Iterator[bytes]:
    """What the program makes."""
    last = b""
    for at in range(0, len(raw) - 3, 4):
        kind, a, b, c = raw[at : at + 4]
        match kind % 8:
            case 0 | 1 | 2:
                last = _Writer(UNITS[way], order, random.Random(a)).message(fields)  # noqa: S311  # made to be repeated
            case 3:
                last = _Writer(UNITS[b % 3], order, random.Random(a)).message(fields)  # noqa: S311  # likewise
            case 4 if len(last) > 4:
                place = 4 + (a | b << 8) % (len(last) - 4)
                last = last[:place] + bytes([c]) + last[place + 1 :]
            case 5:
                last = last[: 4 + a % (len(last) - 3)] if last else last
            case 6 if last:
                last += bytes((b, c)) * (a % 4)
        if last:
            yield last


def decode_wide_texts(raw: bytes) -> None:
    """Run a program and decode what it makes, in one slab or two.

    Raises:
        AssertionError: What is decoded is not what the reader here says.
    """
    if len(raw) < 2:
        return
    number, order = raw[0] % len(_TYPES), "<>"[raw[1] >> 2 & 1]
    payloads = []
    for payload in _messages(raw[2:], _TYPES[number], raw[1] % 3, order):
        payloads.append(payload)
        if len(payloads) == _MOST_MESSAGES:
            break
    bound = len(payloads) * (raw[1] >> 4) // 16
    decoder, left = _new(_decoder(number)), list(UNITS)
    for some in (payloads[:bound], payloads[bound:]):
        if some:
            left = _check(decoder.decode(Payloads.joined(some)), some, _TYPES[number], left)


def _check(found: Columns, payloads: list[bytes], fields: dict[str, _Type], left: list[str]) -> list[str]:
    """Hold what was decoded against each message in each way; returns the ways that are left."""
    read = {way: [_read(payload, fields, way) for payload in payloads] for way in left}
    fitting = [i for i in range(len(payloads)) if any(read[way][i] is not None for way in left)]
    sound = [way for way in left if all(read[way][i] is not None for i in fitting)]
    agreed = sound and all(repr(read[way][i]) == repr(read[sound[0]][i]) for way in sound for i in fitting)
    rows = fitting if agreed else []
    assert found.rows.tolist() == rows
    assert [d.index for d in found.defects] == [i for i in range(len(payloads)) if i not in rows]
    messages = [read[sound[0]][i] for i in rows] if agreed else []
    for path, values in _flat(fields, messages).items():
        column = found.columns[path]
        ours = column.text() if column.texts is not None else column.values.ravel().tolist()
        assert repr(list(ours)) == repr(values), path
    return sound or left


def _read(payload: bytes, fields: dict[str, _Type], way: str) -> dict[str, Any] | None:
    try:
        return _Reader(payload, way).message(fields)
    except _NoMessageError:
        return None


def _flat(fields: dict[str, _Type], messages: list[Any]) -> dict[str, list[Any]]:
    """All values of each field, one after another."""
    found: dict[str, list[Any]] = {}
    for name, type_ in fields.items():
        values = [message[name] for message in messages]
        if isinstance(type_, tuple):
            values = [one for several in values for one in several]
        base = type_[0] if isinstance(type_, tuple) else type_
        if isinstance(base, dict):
            found |= {f"{name}.{path}": inner for path, inner in _flat(base, values).items()}
        else:
            found[name] = values
    return found
