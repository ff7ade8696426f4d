"""The fields of a decoded message, by their dotted paths."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from difflib import get_close_matches
from keyword import iskeyword

import numpy as np

__all__ = ["NUMBER", "fields_of", "nearest", "number_paths", "value_at"]

NUMBER = (bool, int, float, np.number)
"""What counts as a number in a message."""

_DEEPEST = 16
_MOST_SHOWN = 12


def fields_of(message: object) -> list[str]:
    """The names of its fields as they stand in its definition; none of what is no message."""
    if not is_dataclass(message):
        return []
    # rosbags gives defaults to the constants of a type, and appends an underscore to fields named like
    # Python keywords, such as `from`.
    names = [f.name for f in fields(message) if f.name != "__msgtype__" and f.default is MISSING]
    return [name[:-1] if name.endswith("_") and iskeyword(name[:-1]) else name for name in names]


def value_at(message: object, path: str) -> object:
    """The value of a field.

    Raises:
        AttributeError: There is no such field.
    """
    for name in path.split("."):
        message = getattr(message, f"{name}_" if iskeyword(name) else name)
    return message


def number_paths(message: object) -> Iterator[str]:
    """The paths of all fields that are one number, in the order of the definition; none within lists."""
    yield from _numbers(message, "", 0)


def _numbers(message: object, prefix: str, depth: int) -> Iterator[str]:
    for name in fields_of(message) if depth < _DEEPEST else ():
        value = value_at(message, name)
        if isinstance(value, NUMBER):
            yield f"{prefix}{name}"
        else:
            yield from _numbers(value, f"{prefix}{name}.", depth + 1)


def nearest(name: str, known: Iterable[str], *, what: str) -> str:
    """What exists in the place of a name that does not: the nearest one, and a dozen of all.

    >>> nearest("pose.positon.x", ["pose.position.x", "pose.position.y"], what="fields")
    "did you mean 'pose.position.x'? fields: pose.position.x, pose.position.y"
    """
    names = list(known)
    near = get_close_matches(name, names, n=1)
    shown = ", ".join(names[:_MOST_SHOWN]) + (", …" if len(names) > _MOST_SHOWN else "")
    return (f"did you mean {near[0]!r}? " if near else "") + f"{what}: {shown or 'none'}"
