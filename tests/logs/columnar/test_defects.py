"""What does not fit its definition: named, left out, and nothing else disturbed, on every route."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ariac_score.logs.columnar import ColumnDecoder, Columns, Payloads
from ariac_score.logs.columnar.plan import PlanError
from ariac_score.logs.columnar.walk_one import MisfitError

TYPE = "test_msgs/msg/Named"


def store_of(text: str, name: str = TYPE) -> Typestore:
    store = get_typestore(Stores.EMPTY)
    store.max_sequence_length = 1 << 24
    store.register(get_types_from_msg(text, name))
    return store


STORE = store_of("string name\nfloat64[] values\nuint8 last")


def cdr(name: bytes, values: list[float], *, length: int | None = None, count: int | None = None) -> bytes:
    """Written by hand: a length with the terminator in it, padding to 4, a count, padding to 8."""
    raw = struct.pack("<I", len(name) + 1 if length is None else length) + name + b"\0"
    raw += b"\0" * (-len(raw) % 4) + struct.pack("<I", len(values) if count is None else count)
    if values:
        raw += b"\0" * (-len(raw) % 8) + struct.pack(f"<{len(values)}d", *values)
    return b"\0\1\0\0" + raw + b"\7"


def sound(number: int) -> bytes:
    return cdr(b"a" * (number % 5), [float(number)] * (number % 3))


def bad_terminator() -> bytes:
    raw = bytearray(cdr(b"abc", [1.0]))
    raw[11] = 0x41
    return bytes(raw)


BAD = {
    "Invalid string length": cdr(b"abc", [1.0], length=0xFFFFFFFF),
    "Invalid string length 0": cdr(b"abc", [1.0], length=0),
    "Missing string terminator": bad_terminator(),
    "invalid start byte": cdr(b"a\xffb", [1.0]),
    "Invalid sequence length 4294967295": cdr(b"abc", [1.0], count=0xFFFFFFFF),
    "Invalid sequence length 2": cdr(b"abc", [1.0], count=2)[:-8],
    "size mismatch": cdr(b"abc", [1.0]) + b"\0\0\0\0",
    "encapsulation": b"\0\2\0\0" + cdr(b"abc", [1.0])[4:],
    "Invalid or unsupported": b"",
    "unpack_from requires": cdr(b"abc", [1.0])[:-1],
}


def decoded(payloads: list[bytes]) -> Columns:
    return ColumnDecoder(STORE, TYPE, cdr=True).decode(Payloads.joined(payloads))


@pytest.mark.parametrize("around", [5, 400], ids=["behind few", "behind many"])
def test_a_message_that_ends_within_a_length_is_named_as_the_last_one_too(around: int) -> None:
    payloads = [sound(i) for i in range(around)]

    columns = decoded([*payloads, cdr(b"abc", [1.0])[:14]])  # encapsulation 4, length 4, text 4, half a count

    (defect,) = columns.defects
    assert (defect.index, columns.rows.tolist()) == (around, [*range(around)])


def test_truth_values_behind_texts_of_any_length_are_as_written() -> None:
    store = store_of("string name\nbool ok")
    raw = [struct.pack("<I", n + 1) + b"a" * n + bytes([0, n % 2]) for n in range(9) for _ in range(3)]

    columns = ColumnDecoder(store, TYPE, cdr=True).decode(Payloads.joined([b"\0\1\0\0" + b for b in raw]))

    assert columns.columns["ok"].values.tolist() == [n % 2 == 1 for n in range(9) for _ in range(3)]


@pytest.mark.parametrize("around", [0, 5, 400], ids=["alone", "among few", "among many"])
@pytest.mark.parametrize("cause", BAD)
def test_a_bad_message_is_named_and_the_others_are_right(cause: str, around: int) -> None:
    payloads = [sound(i) for i in range(around)]
    payloads.insert(around // 2, BAD[cause])

    columns = decoded(payloads)

    (defect,) = columns.defects
    assert defect.index == around // 2
    assert cause in defect.cause
    assert columns.rows.tolist() == [i for i in range(around + 1) if i != around // 2]
    assert columns.columns["name"].text() == ["a" * (i % 5) for i in range(around)]
    assert columns.columns["values"].values.tolist() == [
        float(i) for i in range(around) for _ in range(i % 3)
    ]
    assert columns.columns["last"].values.tolist() == [7] * around


@pytest.mark.parametrize("cause", BAD)
def test_many_bad_messages_of_one_layout(cause: str) -> None:
    columns = decoded([BAD[cause]] * 50 + [sound(1)] * 50)

    assert [defect.index for defect in columns.defects] == list(range(50))
    assert columns.columns["values"].values.tolist() == [1.0] * 50


def test_garbage_in_the_padding_changes_nothing() -> None:
    payloads = []
    for i in range(40):
        raw = bytearray(cdr(b"abcd", [float(i)]))
        assert raw[13:16] == b"\0\0\0"
        raw[13:16] = bytes((i, 255 - i, 1))
        payloads.append(bytes(raw))

    columns = decoded(payloads)

    assert columns.defects == ()
    assert columns.columns["values"].values.tolist() == [float(i) for i in range(40)]


def test_a_type_that_contains_itself_has_no_plan() -> None:
    store = store_of("test_msgs/Named[] inner")

    with pytest.raises(PlanError, match="contains itself"):
        ColumnDecoder(store, TYPE, cdr=True)


def test_wide_strings_have_no_plan_for_their_width_differs_between_middlewares() -> None:
    with pytest.raises(PlanError, match="wstring"):
        ColumnDecoder(store_of("wstring wide"), TYPE, cdr=True)


def test_an_array_too_large_to_lay_out_has_no_plan() -> None:
    with pytest.raises(PlanError, match="too large"):
        ColumnDecoder(store_of("float64[100000000] much"), TYPE, cdr=True)


def test_where_rosbags_reads_what_a_plan_refuses_rosbags_decides_and_it_is_said(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise MisfitError("not today")

    monkeypatch.setattr("ariac_score.logs.columnar.decode.lay_out", refuse)

    columns = decoded([sound(i) for i in range(3)])

    assert "rosbags reads it" in columns.fallback
    assert columns.columns["name"].text() == ["", "a", "aa"]
    assert columns.columns["values"].values.tolist() == [1.0, 2.0, 2.0]
    assert columns.columns["values"].offsets[0].tolist() == [0, 0, 1, 3]


def test_the_numbers_of_a_big_endian_message_are_those_of_this_machine() -> None:
    raw = b"\0\0\0\0" + struct.pack(">I", 1) + b"\0\0\0\0" + struct.pack(">I", 1) + b"\0" * 4
    columns = decoded([raw + struct.pack(">d", 0.1) + b"\7"] * 20)

    assert columns.columns["values"].values.dtype == np.dtype(np.float64)
    assert columns.columns["values"].values.tolist() == [0.1] * 20
