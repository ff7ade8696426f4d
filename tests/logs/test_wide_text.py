"""Wide texts: read where one of the three ways to write them is right, refused where it is not clear."""

from __future__ import annotations

import random
import struct
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin, Writer

from ariac_score.logs.columnar import Column, ColumnDecoder, Columns, Payloads
from ariac_score.logs.columnar.types import UnknownTypeError, column_decoder_for, decoder_for
from ariac_score.logs.containers.items import Connection
from ariac_score.logs.gather.wanted_fields import read_tables

WAYS = ("fast_1", "fast_2", "cyclone")
TYPE = "test_msgs/msg/Wide"
LONG = ["guten Tag", "Gerät ☃", "", "x", "\U0001f916 läuft", "ab", "abc", "\uffff\ue000"]


class Cdr:
    """Written by hand: each number at a multiple of its size, counted from behind the encapsulation."""

    def __init__(self, way: str, *, big: bool = False) -> None:
        self.way, self.order, self.raw = way, ">" if big else "<", b""
        self.head = b"\0\0\0\0" if big else b"\0\1\0\0"

    def number(self, code: str, value: float) -> Cdr:
        size = struct.calcsize(code)
        self.raw += b"\0" * (-len(self.raw) % size) + struct.pack(self.order + code, value)
        return self

    def text(self, text: str) -> Cdr:
        units = text.encode(f"utf-16-{'be' if self.order == '>' else 'le'}")
        self.number("I", len(units) if self.way == "cyclone" else len(units) // 2)
        if self.way == "fast_1":
            for unit in struct.unpack(f"{self.order}{len(units) // 2}H", units):
                self.number("I", unit)
        else:
            self.raw += units
        return self

    def texts(self, texts: list[str]) -> Cdr:
        self.number("I", len(texts))
        for text in texts:
            self.text(text)
        return self

    def done(self, *, padded: bool = True) -> bytes:
        return self.head + self.raw + b"\0" * (-len(self.raw) % 4 if padded else 0)


def decoder(definition: str, wanted: list[str] | None = None, how: str = "ros2msg") -> ColumnDecoder:
    return column_decoder_for(Connection("/wide", TYPE, "cdr", definition, how), wanted)


def decoded(definition: str, payloads: list[bytes], wanted: list[str] | None = None) -> Columns:
    return decoder(definition, wanted).decode(Payloads.joined(payloads))


def nested(column: Column) -> list[list[str]]:
    bounds, texts = column.offsets[0].tolist(), column.text()
    return [texts[a:b] for a, b in pairwise(bounds)]


@pytest.mark.parametrize("padded", [True, False], ids=["padded", "as long as needed"])
@pytest.mark.parametrize("big", [False, True], ids=["little", "big"])
@pytest.mark.parametrize("way", WAYS)
def test_texts_are_read_in_whichever_way_they_were_written(way: str, big: bool, padded: bool) -> None:
    payloads = [Cdr(way, big=big).text(text).done(padded=padded) for text in LONG]

    columns = decoded("wstring data", payloads)

    assert columns.defects == ()
    assert columns.columns["data"].text() == LONG
    assert (columns.columns["data"].offsets, columns.columns["data"].levels) == ((), ())


@pytest.mark.parametrize("way", WAYS)
def test_fields_around_them_and_texts_in_arrays_are_right(way: str) -> None:
    definition = (
        'uint8 first\nwstring<=9 name  # with a bound\nfloat64 x\nwstring[] all\nuint16 last\nwstring NONE=""'
    )
    rows = [(i, LONG[i % len(LONG)], i / 7, LONG[: i % 4], i + 300) for i in range(40)]
    payloads = [
        Cdr(way).number("B", a).text(b).number("d", c).texts(d).number("H", e).done()
        for a, b, c, d, e in rows
    ]

    columns = decoded(definition, payloads)

    assert columns.defects == ()
    assert list(columns.columns) == ["first", "name", "x", "all", "last"]
    assert columns.columns["first"].values.tolist() == [row[0] for row in rows]
    assert columns.columns["name"].text() == [row[1] for row in rows]
    assert columns.columns["x"].values.tolist() == [row[2] for row in rows]
    assert nested(columns.columns["all"]) == [row[3] for row in rows]
    assert columns.columns["last"].values.tolist() == [row[4] for row in rows]
    assert columns.columns["all"].levels == ("all",)


@pytest.mark.parametrize("way", WAYS)
def test_other_fields_are_read_where_nobody_wants_the_text(way: str) -> None:
    payloads = [Cdr(way).text(text).number("d", i / 3).done() for i, text in enumerate(LONG)]
    one = decoder("wstring data\nfloat64 x", ["x"])

    columns = one.decode(Payloads.joined(payloads))

    assert (one.paths, one.shape("x"), one.shape("data")) == (("x",), ("float64", ()), None)
    assert list(columns.columns) == ["x"]
    assert columns.columns["x"].values.tolist() == [i / 3 for i in range(len(LONG))]


def test_the_shape_of_a_wide_text_is_that_of_a_text() -> None:
    one = decoder("wstring data\nwstring[3] three")

    assert one.paths == ("data", "three")
    assert one.shape("data") == ("string", ())
    assert one.shape("three") == ("string", ("three",))


def test_definitions_of_the_other_format_are_read_too() -> None:
    idl = "module test_msgs { module msg { struct Wide { wstring<5> data; sequence<wstring> more; }; }; };"
    payloads = [Cdr("fast_2").text(text).texts(["abcd", text]).done() for text in LONG]

    columns = decoder(idl, how="ros2idl").decode(Payloads.joined(payloads)).columns

    assert columns["data"].text() == LONG
    assert nested(columns["more"]) == [["abcd", text] for text in LONG]


@pytest.mark.parametrize("way", WAYS)
def test_where_all_ways_say_the_same_nothing_has_to_be_decided(way: str) -> None:
    empty = decoded("wstring data\nuint8 x", [Cdr(way).text("").number("B", 7).done()] * 3)

    assert empty.columns["data"].text() == [""] * 3
    assert empty.columns["x"].values.tolist() == [7] * 3
    if way != "cyclone":  # one code unit and what looks like padding behind it
        assert decoded("wstring data", [Cdr(way).text("x").done()]).columns["data"].text() == ["x"]


def test_what_can_be_read_in_two_ways_is_refused() -> None:
    either = Cdr("fast_2").text("xy").done()  # or one letter, and a padding that is not zero

    columns = decoded("wstring data", [either] * 3)

    assert columns.columns["data"].text() == []
    assert {defect.cause for defect in columns.defects} == {"its wide text can be read in more than one way"}


def test_one_longer_text_decides_on_those_before_and_behind_and_in_later_slabs() -> None:
    either, clear = (Cdr("fast_2").text(text).done() for text in ("xy", "long"))
    one = decoder("wstring data")

    assert one.decode(Payloads.joined([either])).columns["data"].text() == []
    assert one.decode(Payloads.joined([either, clear, either])).columns["data"].text() == ["xy", "long", "xy"]
    assert one.decode(Payloads.joined([either])).columns["data"].text() == ["xy"]


def test_messages_of_which_no_one_way_fits_all_are_refused() -> None:
    payloads = [Cdr(way).text("long enough").done() for way in ("fast_1", "fast_2")]

    columns = decoded("wstring data", payloads)

    assert columns.rows.tolist() == []
    assert {d.cause for d in columns.defects} == {"no one way to read its wide text fits all messages"}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(
    "damage",
    [
        lambda raw: raw[:-9],
        lambda raw: raw + b"\0\0\0\0",
        lambda raw: raw[:4] + b"\xff\xff\xff\xff" + raw[8:],
        lambda raw: raw[:8] + b"\0\0" + raw[10:],
        lambda raw: raw[:8] + b"\x00\xd8" + raw[10:],
        lambda raw: raw[:0],
    ],
    ids=["cut off", "longer", "a length beyond all", "a NUL", "half a pair", "empty"],
)
def test_a_damaged_text_is_named_and_the_others_are_right(way: str, damage: object) -> None:
    payloads = [Cdr(way).text(text).done() for text in LONG]
    payloads.insert(3, damage(Cdr(way).text("long enough").done()))  # type: ignore[operator]

    columns = decoded("wstring data", payloads)

    assert [defect.index for defect in columns.defects] == [3]
    assert columns.defects[0].cause
    assert columns.columns["data"].text() == LONG


def test_units_beyond_16_bits_are_no_text() -> None:
    wide = Cdr("fast_1").number("I", 3).number("I", 65).number("I", 0x1F916).number("I", 65).done()

    assert decoded("wstring data", [wide]).rows.tolist() == []


def test_a_single_message_says_nothing_of_the_way() -> None:
    with pytest.raises(UnknownTypeError, match="wide text"):
        decoder_for(Connection("/wide", TYPE, "cdr", "wstring data", "ros2msg"))


def test_what_is_only_called_so_is_read_as_ever() -> None:
    definition = "# wstring is not used\nstring wstring"
    payload = Cdr("fast_1").number("I", 3).done() + b"ab\0"

    assert type(decoder(definition)) is ColumnDecoder
    assert decoded(definition, [payload]).columns["wstring"].text() == ["ab"]


TEXTS = st.text(st.characters(codec="utf-16", exclude_characters="\0"), max_size=6)


@pytest.mark.slow
@settings(max_examples=60)
@given(
    st.lists(st.tuples(TEXTS, st.lists(TEXTS, max_size=2)), min_size=1, max_size=5),
    st.sampled_from(WAYS),
    st.booleans(),
)
def test_a_text_that_is_given_is_the_one_that_was_written(
    rows: list[tuple[str, list[str]]], way: str, big: bool
) -> None:
    payloads = [Cdr(way, big=big).text(a).number("H", 5).texts(b).done() for a, b in rows]

    columns = decoded("wstring data\nuint16 x\nwstring[] more", payloads)

    given_rows = columns.rows.tolist()
    assert given_rows in ([], list(range(len(rows))))
    assert columns.columns["data"].text() == [rows[i][0] for i in given_rows]
    assert nested(columns.columns["more"]) == [rows[i][1] for i in given_rows]
    assert columns.columns["x"].values.tolist() == [5] * len(given_rows)


@settings(max_examples=60)
@given(st.integers(0, 2**32), st.sampled_from(WAYS))
def test_garbage_in_the_padding_never_changes_a_text(seed: int, way: str) -> None:
    """Fast-CDR moves on without writing what it leaves out."""
    dice = random.Random(seed)  # noqa: S311  # dice, not secrets
    texts = ["".join(dice.choices("abc\u0101\U0001f916", k=dice.randint(0, 3))) for _ in range(4)]
    payloads = []
    for text in texts:
        whole = Cdr(way).text(text)
        used, raw = len(whole.raw), bytearray(whole.number("d", 1.5).raw)
        if way != "cyclone":  # which writes zeros
            raw[used : len(raw) - 8] = dice.randbytes(len(raw) - 8 - used)
        payloads.append(whole.head + bytes(raw))

    columns = decoded("wstring data\nfloat64 x", payloads)

    assert columns.columns["data"].text() == [texts[i] for i in columns.rows.tolist()]
    assert columns.columns["x"].values.tolist() == [1.5] * len(columns.rows)


@settings(max_examples=60)
@given(st.lists(st.binary(max_size=40).map(lambda raw: b"\0\1\0\0" + raw), max_size=6))
def test_any_bytes_are_a_text_or_a_defect(payloads: list[bytes]) -> None:
    columns = decoded("wstring data\nstring[] names", payloads)

    found = sorted([*columns.rows.tolist(), *(defect.index for defect in columns.defects)])
    assert found == list(range(len(payloads)))
    assert all(len(column.per_message()) == len(columns.rows) for column in columns.columns.values())


def test_a_recording_with_wide_texts_is_read(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/wide", TYPE, msgdef="wstring data\nfloat64 x", rihs01="0" * 64)
        for i, text in enumerate(LONG):
            writer.write(connection, 10**9 + i, Cdr("cyclone").text(text).number("d", i).done())

    (table,) = read_tables(path, {"/wide": None})

    assert (table.defects, table.unreadable) == (0, "")
    assert table.columns["data"].text() == LONG
    assert table.columns["x"].values.tolist() == list(range(len(LONG)))
