"""Message definitions as recorders write them, read without loading rosbags.

Whatever is unusual is left to rosbags, which takes longer to load than most recordings
take to read; what is understood here is understood as rosbags does.

Source: ROS wiki, "msg"; ROS 2 documentation, "About ROS 2 interfaces".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from keyword import iskeyword
from typing import Any

__all__ = ["FieldDefinitions", "parsed_definitions"]

FieldDefinitions = dict[str, tuple[list[Any], list[tuple[str, Any]]]]
"""By type its constants (none are kept) and its fields, in the form rosbags has them."""

_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4
_SEPARATOR = "=" * 80 + "\n"
_NUMBERS = r"bool|byte|char|float32|float64|u?int(?:8|16|32|64)"
_LINE = re.compile(
    rf"""[ \t]*(?:
        (?:(?P<base>{_NUMBERS}|string)|(?P<name>(?:[a-z][a-z0-9]*(?:_[a-z0-9]+)*/)?(?:msg/)?[A-Za-z][A-Za-z0-9]*))
        (?P<many>\[(?P<bound><=)?(?P<length>[0-9]{{0,9}})\])?
        [ \t]+(?P<field>[A-Za-z][A-Za-z0-9_]*)
    )?[ \t]*(?:\#[^\n]*)?""",
    re.VERBOSE,
)
_CONSTANT = re.compile(
    rf"""[ \t]*(?:
        (?:{_NUMBERS})[ \t]+[A-Z](?:_?[A-Z0-9])*[ \t]*=[ \t]*(?:-?[0-9]+(?:\.[0-9]+)?)
        |string[ \t]+[A-Z](?:_?[A-Z0-9])*[ \t]*=[ \t]*(?:"[^"\\\n]*"|'[^'\\\n]*')
    )[ \t]*(?:\#[^\n]*)?""",
    re.VERBOSE,
)
_OF_ALL = {
    "time": "builtin_interfaces/msg/Time",
    "duration": "builtin_interfaces/msg/Duration",
    "Header": "std_msgs/msg/Header",
}
_STAMP = [("sec", (_BASE, ("int32", 0))), ("nanosec", (_BASE, ("uint32", 0)))]
_KNOWN = {"builtin_interfaces/msg/Time": _STAMP, "builtin_interfaces/msg/Duration": _STAMP}
_EMPTY = [("structure_needs_at_least_one_member", (_BASE, ("uint8", 0)))]
"""What an empty message consists of."""

_MOST_TYPES = 1024


class _UnusualError(Exception):
    """Something is left to rosbags."""


def parsed_definitions(text: str, type_: str) -> FieldDefinitions | None:
    """The fields of a type and of all it consists of; `None` where rosbags is to decide.

    Args:
        text: Its definition, those of others behind lines of equals signs.
        type_: `package/msg/Name`.
    """
    found: FieldDefinitions = {}
    sections = f"MSG: {type_}\n{text}".split(_SEPARATOR)
    try:
        if len(sections) > _MOST_TYPES or not all(section.endswith("\n") for section in sections[:-1]):
            raise _UnusualError
        for section in sections:
            head, line_end, body = section.partition("\n")
            name = _named(head)
            if name in found or not line_end:
                raise _UnusualError
            found[name] = [], list(_fields(body, name)) or _EMPTY
            if found[name][1] != _KNOWN.get(name, found[name][1]):
                raise _UnusualError
        found |= {name: ([], fields) for name, fields in _KNOWN.items()}
        for _, fields in list(found.values()):
            for needed in filter(None, map(_needed, fields)):
                if needed not in found:
                    raise _UnusualError
    except _UnusualError:
        return None
    return found


def _named(head: str) -> str:
    parts = re.fullmatch(r"MSG: ([a-zA-Z]\w*)/(?:msg/)?([A-Za-z]\w*)[ \t]*", head, re.ASCII)
    if parts is None:
        raise _UnusualError
    return f"{parts[1]}/msg/{parts[2]}"


def _fields(body: str, type_: str) -> Iterator[tuple[str, Any]]:
    names = set[str]()
    for line in body.split("\n"):
        line = line.strip(" \t")  # noqa: PLW2901  # in the middle of a pattern, many spaces would take long
        if _CONSTANT.fullmatch(line):
            continue
        parts = _LINE.fullmatch(line)
        if parts is None:
            raise _UnusualError
        name = parts["field"]
        if name is None:
            continue
        if name in names or iskeyword(name) or iskeyword(name.lower()):
            raise _UnusualError
        names.add(name)
        yield name, _described(parts, type_)


def _described(parts: re.Match[str], type_: str) -> Any:
    one = (_BASE, (parts["base"], 0)) if parts["base"] else (_NAME, _resolved(parts["name"], type_))
    if not parts["many"]:
        return one
    length = int(parts["length"] or 0)
    if parts["bound"] or not parts["length"]:
        if parts["bound"] and not parts["length"]:
            raise _UnusualError
        return _SEQUENCE, (one, length)
    return _ARRAY, (one, length)


def _resolved(name: str, type_: str) -> str:
    if name in _OF_ALL:
        return _OF_ALL[name]
    parts = name.split("/")
    if len(parts) == 1:
        return f"{type_.rpartition('/')[0]}/{name}"
    if len(parts) == 2 and parts[0] != "msg":
        return f"{parts[0]}/msg/{parts[1]}"
    if len(parts) == 3:
        return name
    raise _UnusualError


def _needed(field: tuple[str, Any]) -> str | None:
    """The type of a field that is a message, or of its elements."""
    kind, what = field[1]
    if kind in (_ARRAY, _SEQUENCE):
        kind, what = what[0]
    return what if kind == _NAME else None
