"""Message definitions that recordings bring: what is understood, and what is refused in words."""

from __future__ import annotations

import pytest

from ariac_score.logs.columnar.plan import PlanError
from ariac_score.logs.columnar.types import UnknownTypeError, column_decoder_for, decoder_for
from ariac_score.logs.containers.items import Connection

TYPE = "test_msgs/msg/Top"
LINE = "=" * 80


def connection(definition: str) -> Connection:
    return Connection("/top", TYPE, "cdr", definition, "ros2msg")


def test_a_definition_is_followed_into_the_types_behind_it() -> None:
    text = f"Header header\nOther[2] others\n{LINE}\nMSG: std_msgs/Header\ntime stamp\nstring frame_id\n"
    text += f"{LINE}\nMSG: test_msgs/Other\nfloat64[] x\n"

    assert column_decoder_for(connection(text)).paths == (
        "header.stamp.sec",
        "header.stamp.nanosec",
        "header.frame_id",
        "others.x",
    )


def test_constants_defaults_comments_and_spaces_are_no_fields() -> None:
    text = " \tint8 a \t # int8 not_this\n  uint8 B_C_1 = 3\t\n   # words  \nint8 with_default 5\n \n"

    assert column_decoder_for(connection(text)).paths == ("a", "with_default")


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("Other other\n", "lacks 'test_msgs/msg/Other'"),
        ("int8 a\nint8 a\n", "conflicting"),
        ("int8 class\nint8 class_\n", "conflicting"),
        ("Top top\n", "recursion"),
        (f"int8 a\n{LINE}\nMSG: builtin_interfaces/Time\nint8 other\n", "already present"),
        ("int8[<=] a\n", "parse"),
    ],
    ids=["unknown type", "twice", "twice in Python", "itself", "other time", "no bound"],
)
def test_a_definition_that_cannot_be_used_is_refused_with_the_cause(text: str, cause: str) -> None:
    for wanted in (column_decoder_for, decoder_for):
        with pytest.raises(UnknownTypeError, match=f"(?i)definition of it cannot be used.*{cause}"):
            wanted(connection(text))


@pytest.mark.parametrize("line", ["int8[-1] x", "int8[<=-1] x", "Other[-3] x"])
def test_an_array_of_fewer_than_no_elements_has_no_layout(line: str) -> None:
    """rosbags takes it, so it decides on every message."""
    text = f"int8 a\n{line}\n{LINE}\nMSG: test_msgs/Other\nfloat64 y\n"

    with pytest.raises(PlanError, match=r"an array of -[13] elements"):
        column_decoder_for(connection(text))


@pytest.mark.parametrize(
    "line",
    [
        "uint8 L" + "J" * 50_000 + "=2-]",
        " " * 50_000 + "!",
        "string A=" + "'" * 50_000,
    ],
    ids=["constant", "spaces", "quotes"],
)
def test_a_line_that_no_recorder_writes_is_refused_at_once(line: str) -> None:
    """A pattern that tries all ways to split it would not return: the first needs 2 to the 50000."""
    with pytest.raises(UnknownTypeError, match="cannot be used"):
        column_decoder_for(connection(f"int8 a\n{line}\n"))


@pytest.mark.parametrize("lines", [10_000, 10_001])
def test_a_definition_has_ten_thousand_lines_at_most(lines: int) -> None:
    """In comments, which count as well, so that the limit itself is quick to try."""
    text = "float64 x\n" + "# nothing\n" * (lines - 1)

    if lines == 10_000:
        assert column_decoder_for(connection(text)).paths == ("x",)
    else:
        with pytest.raises(UnknownTypeError, match="has 10001 lines, 10000 are allowed"):
            column_decoder_for(connection(text))


def test_a_definition_of_a_hundred_thousand_fields_is_refused_at_once() -> None:
    text = "".join(f"float64 x{number}\n" for number in range(100_000))

    with pytest.raises(UnknownTypeError, match="has 100000 lines"):
        column_decoder_for(connection(text))


@pytest.mark.parametrize("of", ["string", "fuzz/B"])
@pytest.mark.parametrize("length", [9_998, 9_999])
def test_arrays_of_texts_and_messages_have_ten_thousand_elements_at_most(of: str, length: int) -> None:
    """Of a fixed length, all types together: for each there is code. Numbers take none, however many."""
    text = f"{of}[{length}] a\nfloat64[100000] c\n{'=' * 80}\nMSG: fuzz/B\nstring[2] b\nint8[9] d\n"

    if length == 9_998:
        assert column_decoder_for(connection(text)).paths
    else:
        with pytest.raises(UnknownTypeError, match="have 10001 elements, 10000 are allowed"):
            column_decoder_for(connection(text))
