"""Message definitions read without rosbags: as rosbags reads them, or not at all."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from ariac_score.logs.columnar.definitions import parsed_definitions

TYPE = "test_msgs/msg/Top"
LINE = "=" * 80
BASES = [
    "bool",
    "byte",
    "char",
    "int8",
    "uint16",
    "int64",
    "float32",
    "float64",
    "string",
    "time",
    "duration",
]
NAMES = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,6}", fullmatch=True)
SUFFIXES = st.sampled_from(["", "[]", "[3]", "[<=4]", "[0]", "[<=]", "[-1]", "[ 2]"])
TYPES = st.sampled_from([*BASES, "Header", "Other", "other_msgs/Other", "other_msgs/msg/Other", "wstring"])
FIELDS = st.builds("{}{} {}".format, TYPES, SUFFIXES, NAMES)
ODD = st.sampled_from(
    [
        "",
        "# words",
        "int8 A=1",
        "float32 B = -2.5  # words",
        "string C='x # y'",
        'string D="x"',
        "string E=x y",
        "string F=true or not",
        "int8 G=0x1f",
        "int8 with_default 5",
        "string<=4 bounded",
        "  int8\t spaced  # words",
        "int8 windows\r",
        "@key",
        "int8",
        "int8 class",
        "int8 a = 1",
        "int32 __x",
        LINE,
    ]
)
SECTIONS = st.sampled_from(
    ["MSG: other_msgs/Other", "MSG: test_msgs/msg/Other", "MSG: std_msgs/Header", "MSG: a"]
)


def by_rosbags(text: str, type_: str = TYPE) -> dict[str, Any] | None:
    store = get_typestore(Stores.EMPTY)
    try:
        store.register(get_types_from_msg(text, type_))
        store.get_msgdef(type_)
    except RecursionError:
        pass  # a type that holds itself: no plan can be made of it either
    except (TypesysError, KeyError, SyntaxError, ValueError, AttributeError, TypeError, AssertionError):
        return None
    return {name: fields for name, (_, fields) in store.fielddefs.items()}


def by_ours(text: str, type_: str = TYPE) -> dict[str, Any] | None:
    found = parsed_definitions(text, type_)
    return None if found is None else {name: fields for name, (_, fields) in found.items()}


@pytest.mark.slow
@given(
    st.lists(st.one_of(FIELDS, ODD), max_size=6),
    st.lists(st.tuples(SECTIONS, st.lists(st.one_of(FIELDS, ODD), max_size=4)), max_size=3),
)
@settings(max_examples=300, deadline=None)
def test_what_is_understood_is_what_rosbags_understands(top: list[str], others: list[Any]) -> None:
    text = "\n".join(top) + "".join(f"\n{LINE}\n{head}\n" + "\n".join(body) for head, body in others)
    found = by_ours(text)

    if found is not None:
        assert found == by_rosbags(text)


@pytest.mark.slow
@pytest.mark.parametrize("version", [1, 2])
def test_stock_definitions_are_understood(version: Any) -> None:
    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    names = sorted(n for n in store.fielddefs if n.split("/")[0] in ("nav_msgs", "tf2_msgs", "sensor_msgs"))
    understood = 0
    for name in names:
        text, _ = store.generate_msgdef(name, ros_version=version)
        found = by_ours(text, name)
        understood += found is not None
        assert found is None or found == by_rosbags(text, name)

    assert understood > 0.9 * len(names) > 10


def test_a_nested_definition_is_understood() -> None:
    text = f"Header header\nOther[2] others\n{LINE}\nMSG: std_msgs/Header\ntime stamp\nstring frame_id\n"
    text += f"{LINE}\nMSG: test_msgs/Other\nfloat64[] x\n"

    assert by_ours(text) == by_rosbags(text) != None  # noqa: E711  # a chain


@pytest.mark.parametrize(
    "text",
    [
        "Other other",
        "int8 a\nint8 a",
        "wstring a",
        "int8 a 5",
        "int8 from",
        f"int8 a\n{LINE}\nMSG: builtin_interfaces/Time\nint8 other",
        f"int8 a\n{LINE}\nMSG: test_msgs/Top\nint8 b",
        "",
        f"Other other\n{LINE}\nMSG: test_msgs/Other",
        f"int8 bJ{LINE}\nMSG: test_msgs/Other\nint8 a\n",
        f"Other a\n{LINE}\nMSG: test_msgs/Other\n",
    ],
    ids=[
        "unknown type",
        "twice",
        "wstring",
        "default",
        "keyword",
        "other time",
        "itself twice",
        "empty",
        "cut off",
        "signs behind a name",
        "empty inside",
    ],
)
def test_what_is_unusual_is_left_to_rosbags(text: str) -> None:
    found = by_ours(text)

    assert found is None or found == by_rosbags(text)


@pytest.mark.parametrize(
    "line",
    [
        "uint8 L" + "J" * 50_000 + "=2-]",
        " " * 50_000 + "!",
        "int8 x" + " " * 50_000 + "!",
        "string A=" + "'" * 50_000,
    ],
    ids=["constant", "spaces", "spaces behind", "quotes"],
)
def test_a_line_that_no_recorder_writes_is_given_up_at_once(line: str) -> None:
    """A pattern that tries all ways to split it would not return: the first needs 2 to the 50000."""
    assert by_ours(f"int8 a\n{line}\n") is None


def test_spaces_around_a_line_change_nothing() -> None:
    spaced = " \tint8 a \t # x\n  uint8 B_C_1 = 3\t\n   # words  \n \n"

    assert by_ours(spaced) == by_ours("int8 a") == by_rosbags("int8 a")
