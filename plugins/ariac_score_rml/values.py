"""Values of events: when two are the same, and what a number is."""

from __future__ import annotations

from typing import TypeAlias

from ariac_score_rml.faults import RmlRunError

__all__ = ["Bound", "Json", "fits", "is_number", "same", "shown"]

Json: TypeAlias = "dict[str, Json] | list[Json] | str | int | float | bool | None"


class Bound:
    """A value that a name stands for; equal when type and contents are.

    1, 1.0 and true are three values, and so are 0.0 and -0.0.
    """

    __slots__ = ("_key", "value")

    def __init__(self, value: Json) -> None:
        self.value = value
        self._key: object = _key(value)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Bound) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def __repr__(self) -> str:
        return f"Bound({self.value!r})"


def _key(value: Json) -> object:
    if isinstance(value, dict):
        return ("record", tuple((k, _key(value[k])) for k in sorted(value)))
    if isinstance(value, list):
        return ("list", tuple(_key(item) for item in value))
    return (type(value).__name__, repr(value) if isinstance(value, float) else value)


def is_number(value: object) -> bool:
    """Whether a value is an int or float; a boolean is neither."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def fits(pattern: Json, value: Json) -> bool:
    """Whether a value, read as a pattern, takes another one.

    A record takes every record that extends it; anything else only an equal value of its type.

    >>> fits({"k": 1}, {"k": 1, "j": 2}), fits(1, 1.0), fits([1], [1, 2])
    (True, False, False)
    """
    if isinstance(pattern, dict):
        return isinstance(value, dict) and all(
            k in value and fits(pattern[k], value[k]) for k in sorted(pattern)
        )
    if isinstance(pattern, list):
        return isinstance(value, list) and len(pattern) == len(value) and all(map(fits, pattern, value))
    # By text, for 0.0 and -0.0 are two values: patterns never convert, only guards compare by size.
    if isinstance(pattern, float):
        return isinstance(value, float) and repr(pattern) == repr(value)
    return type(pattern) is type(value) and pattern == value


def same(a: Json, b: Json) -> bool:
    """Whether two values bound by one event agree; records only when they are one object."""
    if isinstance(a, dict) or isinstance(b, dict):
        return a is b
    if isinstance(a, list):
        return isinstance(b, list) and len(a) == len(b) and all(map(same, a, b))
    return fits(a, b)


def shown(value: Json) -> str:
    """A value in a message: short, and named by its kind when it is no number."""
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    if isinstance(value, dict):
        return "a record"
    if isinstance(value, list):
        return "a list"
    return f"the string {value[:40]!r}" if isinstance(value, str) else repr(value)


def as_float(value: Json, what: str) -> float:
    """A number as a float.

    Raises:
        RmlRunError: It is no number, or too large for a float.
    """
    if not is_number(value):
        raise RmlRunError(f"{what} is {shown(value)} where a number is needed", kind="type_error")
    assert isinstance(value, int | float)
    try:
        return float(value)
    except OverflowError:
        raise RmlRunError(f"{what} is too large a number", kind="evaluation_error") from None
