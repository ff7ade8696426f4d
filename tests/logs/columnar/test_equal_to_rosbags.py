"""Columns against messages deserialised one by one: equal to the bit, whatever the definition."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ariac_score.logs.columnar import ColumnDecoder, Columns, Payloads
from ariac_score.logs.columnar.columns import UNDECODABLE

Make = Callable[[], Any]
TYPE = "test_msgs/msg/T0"
NUMBERS = ["bool", "byte", "char", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64"]
NUMBERS += ["float32", "float64"]
CODES = dict(zip(NUMBERS, ["?", "b", "B", "b", "B", "h", "H", "i", "I", "q", "Q", "f", "d"], strict=True))
FAILURES = (SerdeError, *UNDECODABLE)


class Definitions:
    """Random nested definitions: T0 may hold T1 and so on, so that none holds itself."""

    def __init__(self, dice: random.Random) -> None:
        self.dice = dice
        self.count = dice.randint(1, 4)
        self.fields = [self._fields(number) for number in range(self.count)]
        texts = [
            "\n".join(f"{type_} {name}" for name, (type_, *_) in fields.items()) for fields in self.fields
        ]
        self.store = get_typestore(Stores.EMPTY)
        types = {}
        for number, text in enumerate(texts):
            types.update(get_types_from_msg(text, f"test_msgs/msg/T{number}"))
        types.update(get_types_from_msg("int32 sec\nuint32 nanosec", "builtin_interfaces/msg/Time"))
        self.store.register(types)
        self.store.max_sequence_length = 1 << 24

    def _fields(self, number: int) -> dict[str, tuple[str, str, str, int]]:
        return {f"f{i}": self._field(number) for i in range(self.dice.choice([1, 1, 2, 3, 5, 8]))}

    def _field(self, number: int) -> tuple[str, str, str, int]:
        bases = [*NUMBERS, "string", "string"] + [
            f"test_msgs/T{n}" for n in range(number + 1, self.count)
        ] * 4
        base, kind = self.dice.choice(bases), self.dice.choice(["", "", "", "array", "sequence", "bounded"])
        length = self.dice.randint(1, 4)
        suffix = {"": "", "array": f"[{length}]", "sequence": "[]", "bounded": f"[<={length}]"}[kind]
        return base + suffix, base, kind, length

    def message(self, number: int = 0) -> Any:
        values = {}
        for name, (_, base, kind, length) in self.fields[number].items():
            count = {"": 1, "array": length}.get(kind, self.dice.choice([0, 0, 1, 1, 2, length]))
            items = [self._value(base) for _ in range(count)]
            if kind and base in NUMBERS:
                values[name] = np.array(items, dtype=np.dtype(CODES[base]))
            else:
                values[name] = items if kind else items[0]
        return self.store.types[f"test_msgs/msg/T{number}"](**values)

    def _value(self, base: str) -> Any:
        if base == "string":
            return self.dice.choice(
                ["", "a", "base_link", "Gerät", "wörld/ünï☃", "x" * self.dice.randint(0, 9)]
            )
        if base == "bool":
            return self.dice.random() < 0.5
        if base in NUMBERS:
            raw = self.dice.choice(
                [self.dice.randbytes(8), b"\0" * 8, b"\xff" * 8, b"\0\0\xc0\x7f\0\0\xf8\x7f"]
            )
            return struct.unpack_from("<" + CODES[base], raw)[0]
        return self.message(int(base[-1]))

    def expected(self, messages: list[Any]) -> dict[str, tuple[list[Any], list[list[int]], str]]:
        """Of each field its values, the lengths at each level around them, and its type."""
        found: dict[str, tuple[list[Any], list[list[int]], str]] = {}

        def declare(number: int, path: str, depth: int) -> None:
            for name, (_, base, kind, _) in self.fields[number].items():
                inner, deeper = f"{path}{name}", depth + bool(kind)
                if base in NUMBERS or base == "string":
                    found[inner] = ([], [[] for _ in range(deeper)], base)
                else:
                    declare(int(base[-1]), f"{inner}.", deeper)

        def under(prefix: str) -> list[str]:
            return [p for p in found if p == prefix or p.startswith(f"{prefix}.")]

        def take(message: Any, number: int, path: str, depth: int) -> None:
            for name, (_, base, kind, _) in self.fields[number].items():
                inner, value = f"{path}{name}", getattr(message, name)
                items = list(value) if kind else [value]
                if kind:
                    for p in under(inner):
                        found[p][1][depth].append(len(items))
                if base in NUMBERS or base == "string":
                    found[inner][0].extend(items)
                else:
                    for item in items:
                        take(item, int(base[-1]), f"{inner}.", depth + bool(kind))

        declare(0, "", 0)
        for message in messages:
            take(message, 0, "", 0)
        return found


def serialised(definitions: Definitions, message: Any, packing: str) -> bytes:
    if packing == "ros1":
        return bytes(definitions.store.serialize_ros1(message, TYPE))
    return bytes(definitions.store.serialize_cdr(message, TYPE, little_endian=packing == "cdr"))


def deserialised(definitions: Definitions, payload: bytes, packing: str) -> Any:
    """The message, or nothing when rosbags cannot read it."""
    read = definitions.store.deserialize_ros1 if packing == "ros1" else definitions.store.deserialize_cdr
    try:
        return read(payload, TYPE)
    except FAILURES:
        return None


def assert_equal(columns: Columns, definitions: Definitions, messages: list[Any]) -> None:
    for path, (values, lengths, base) in definitions.expected(messages).items():
        column = columns.columns[path]
        assert [np.diff(level).tolist() for level in column.offsets] == lengths, path
        if base == "string":
            assert column.text() == values, path
        elif base == "bool":
            assert column.values.tolist() == [bool(int(np.uint8(v))) for v in values], path
        elif base == "float32":
            # A Python float cannot hold a signalling NaN of 32 bits, so rosbags makes it a quiet one.
            expected = np.array(values, dtype=np.float32)
            there = ~np.isnan(expected)
            assert (np.isnan(column.values) == ~there).all(), path
            assert column.values[there].tobytes() == expected[there].tobytes(), path
        else:
            assert column.values.tobytes() == np.array(values, dtype=CODES[base]).tobytes(), path


def a_folder_of_messages(dice: random.Random, definitions: Definitions) -> list[Any]:
    few = [definitions.message() for _ in range(dice.randint(1, 6))]
    if dice.random() < 0.5:
        return [definitions.message() for _ in range(dice.randint(1, 40))]
    return [dice.choice(few) for _ in range(dice.randint(1, 60))]


@settings(max_examples=25, derandomize=True)
@given(st.integers(0, 2**32), st.sampled_from(["cdr", "big", "ros1"]))
def test_every_field_of_a_few_random_messages(seed: int, packing: str) -> None:
    assert_decoded_like_rosbags(seed, packing)


@pytest.mark.slow  # thousands of random messages
@settings(max_examples=150)
@given(st.integers(0, 2**32), st.sampled_from(["cdr", "big", "ros1"]))
def test_every_field_of_random_messages_of_random_definitions(seed: int, packing: str) -> None:
    assert_decoded_like_rosbags(seed, packing)


def assert_decoded_like_rosbags(seed: int, packing: str) -> None:
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets
    definitions = Definitions(dice)
    payloads = [serialised(definitions, m, packing) for m in a_folder_of_messages(dice, definitions)]

    decoder = ColumnDecoder(definitions.store, TYPE, cdr=packing != "ros1")
    columns = decoder.decode(Payloads.joined(payloads))

    assert (columns.defects, columns.fallback) == ((), "")
    assert columns.rows.tolist() == list(range(len(payloads)))
    assert_equal(columns, definitions, [deserialised(definitions, p, packing) for p in payloads])


def damaged(dice: random.Random, payload: bytes) -> bytes:
    if not payload or dice.random() < 0.4:
        return payload
    at = dice.randrange(len(payload))
    kind = dice.randrange(5)
    if kind == 0:
        return payload[:at]
    if kind == 1:
        return payload + dice.randbytes(dice.randint(1, 5))
    if kind == 2:
        return payload[:at] + bytes([dice.randrange(256)]) + payload[at + 1 :]
    word = dice.choice([0xFFFFFFFF, 0x80000000, 0x7FFFFFFF, 0, 1, 2, 5, 1 << 24]).to_bytes(4, "little")
    return (payload[: at & -4] + word + payload[(at & -4) + 4 :])[: max(len(payload), 4)]


@pytest.mark.slow
@settings(max_examples=150)
@given(st.integers(0, 2**32), st.sampled_from(["cdr", "big", "ros1"]))
def test_damaged_messages_are_named_and_the_others_are_right(seed: int, packing: str) -> None:
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets
    definitions = Definitions(dice)
    whole = [serialised(definitions, m, packing) for m in a_folder_of_messages(dice, definitions)]
    payloads = [damaged(dice, payload) for payload in whole]
    messages = [deserialised(definitions, payload, packing) for payload in payloads]

    decoder = ColumnDecoder(definitions.store, TYPE, cdr=packing != "ros1")
    columns = decoder.decode(Payloads.joined(payloads))

    assert columns.rows.tolist() == [i for i, m in enumerate(messages) if m is not None]
    assert [d.index for d in columns.defects] == [i for i, m in enumerate(messages) if m is None]
    assert all(defect.cause for defect in columns.defects)
    assert columns.fallback == ""
    assert_equal(columns, definitions, [m for m in messages if m is not None])


@pytest.mark.slow
@settings(max_examples=60)
@given(st.integers(0, 2**32), st.sampled_from(["cdr", "big", "ros1"]))
def test_fields_that_are_not_wanted_change_nothing_in_those_that_are(seed: int, packing: str) -> None:
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets
    definitions = Definitions(dice)
    payloads = [serialised(definitions, m, packing) for m in a_folder_of_messages(dice, definitions)]
    everything = ColumnDecoder(definitions.store, TYPE, cdr=packing != "ros1")
    wanted = [path for path in everything.paths if dice.random() < 0.4]
    some = ColumnDecoder(definitions.store, TYPE, cdr=packing != "ros1", wanted=wanted)

    all_columns = everything.decode(Payloads.joined(payloads)).columns
    columns = some.decode(Payloads.joined(payloads)).columns

    assert list(columns) == wanted
    for path in wanted:
        assert columns[path].values.dtype == all_columns[path].values.dtype
        if columns[path].texts is not None:
            assert columns[path].text() == all_columns[path].text()
        else:
            assert columns[path].values.tobytes() == all_columns[path].values.tobytes()
        for level, expected in zip(columns[path].offsets, all_columns[path].offsets, strict=True):
            assert level.tolist() == expected.tolist()


@pytest.mark.slow
@settings(max_examples=60)
@given(st.integers(0, 2**32), st.sampled_from(["cdr", "big", "ros1"]))
def test_slabs_and_gaps_between_messages_change_nothing(seed: int, packing: str) -> None:
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets
    definitions = Definitions(dice)
    payloads = [serialised(definitions, m, packing) for m in a_folder_of_messages(dice, definitions)]
    buffer, starts = b"", []
    for payload in payloads:
        buffer += dice.randbytes(dice.randint(0, 7))
        starts.append(len(buffer))
        buffer += payload
    raw = np.frombuffer(buffer, dtype=np.uint8)
    first = np.array(starts, dtype=np.int64)
    last = first + np.array([len(p) for p in payloads], dtype=np.int64)
    decoder = ColumnDecoder(definitions.store, TYPE, cdr=packing != "ros1")

    at, done = 0, []
    while at < len(payloads):
        to = at + dice.randint(1, 20)
        columns = decoder.decode(Payloads(raw, first[at:to], last[at:to]))
        assert (columns.defects, columns.fallback) == ((), "")
        done.append((columns, payloads[at:to]))
        at = to

    for columns, some in done:
        assert_equal(columns, definitions, [deserialised(definitions, p, packing) for p in some])


@pytest.mark.parametrize("packing", ["cdr", "ros1"])
def test_no_message_at_all(packing: str) -> None:
    definitions = Definitions(random.Random(1))  # noqa: S311  # dice, not secrets
    decoder = ColumnDecoder(definitions.store, TYPE, cdr=packing != "ros1")

    columns = decoder.decode(Payloads.joined([]))

    assert (columns.rows.tolist(), columns.defects) == ([], ())
    assert all(len(column.values) == 0 for column in columns.columns.values())
