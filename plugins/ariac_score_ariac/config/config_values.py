"""Taking values out of configuration files: checked shapes, and numbers written as arithmetic.

Numbers may be written as arithmetic with `pi`, such as `'-pi/2'`, which the official
start-up script passes to `eval`. Here they are parsed and walked: numbers, `pi`, the
four operations and signs, nothing else.

Source: `nist_gear/script/gear.py` of 2017 to 2022; ARIAC notes on log formats, section 7.
"""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import PurePath
from types import MappingProxyType
from typing import Any, NoReturn, TypeVar

from ariac_score import DataFileError, LogDefect, Pose, YamlDocument, did_you_mean

__all__ = ["MAX_COUNT", "ConfigPath", "ConfigValues", "arithmetic", "shown"]

MAX_COUNT = 1000
"""More orders, shipments or sensors than this are a slip of the pen or hostile."""
MAX_EXPRESSION_CHARS = 100
MAX_NAMED_MISTAKES = 20
"""Of one kind; the rest is counted, so that a hostile file cannot fill a result."""
MAX_SHOWN_CHARS = 60
_GLUED = re.compile(r"\d(?![eE][+-]?\d)[A-Za-z_]")
"""A digit run into a word, which Python parses with a warning."""

ConfigPath = tuple["str | int", ...]
_Kind = TypeVar("_Kind")


def shown(value: Any) -> str:
    """A value for a message, cut short: a file may hold anything."""
    words = repr(value)
    return words if len(words) <= MAX_SHOWN_CHARS else f"{words[: MAX_SHOWN_CHARS - 1]}…"


def arithmetic(text: str) -> float:
    """The value of a number written as arithmetic, such as `-pi/2`.

    Raises:
        ValueError: It holds anything but numbers, `pi`, `+ - * /` and brackets, or
            its value is not finite; the message says what.

    >>> round(arithmetic("-pi/2"), 6)
    -1.570796
    """
    # Python's parser recurses on brackets; a short text cannot exhaust it.
    if len(text) > MAX_EXPRESSION_CHARS:
        raise ValueError(f"{text[:20]!r}… is longer than {MAX_EXPRESSION_CHARS} characters")
    try:
        if _GLUED.search(text):
            raise ValueError
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise ValueError(f"{text!r} is not a number nor arithmetic with pi") from None
    try:
        value = _value(tree.body, text)
    except (ZeroDivisionError, OverflowError):
        raise ValueError(f"{text!r} has no finite value") from None
    if not math.isfinite(value):
        raise ValueError(f"{text!r} has no finite value")
    return value


_BINARY: Mapping[type[ast.operator], Callable[[float, float], float]] = MappingProxyType(
    {ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
)


def _value(node: ast.expr, text: str) -> float:
    if isinstance(node, ast.Constant):
        number = node.value
        if isinstance(number, (int, float)) and not isinstance(number, bool):
            return float(number)
    if isinstance(node, ast.Name):
        if node.id == "pi":
            return math.pi
        raise ValueError(f"{text!r} names {node.id!r}; only pi is known")
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.UAdd, ast.USub)):
        operand = _value(node.operand, text)
        return -operand if isinstance(node.op, ast.USub) else operand
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        return _BINARY[type(node.op)](_value(node.left, text), _value(node.right, text))
    raise ValueError(f"{text!r} is not a number nor arithmetic with pi")


class ConfigValues:
    """Takes values out of a document: refuses wrong shapes by their place, notes mistakes that do no harm."""

    def __init__(self, document: YamlDocument) -> None:
        self.document = document
        self._mistakes: dict[str, list[str]] = {}
        for repeat in document.repeats:
            cause = f"key {shown(repeat.path[-1])} is given twice, first in line {repeat.first_line}"
            self.note("repeated_key", repeat.path, cause, "the last counts, as in the official software")

    def note(self, kind: str, path: ConfigPath, cause: str, remedy: str) -> None:
        """Remember a mistake that leaves the score as it is, or as the official software has it."""
        message = f"{cause} ({self.document.place(path)}); {remedy}"
        self._mistakes.setdefault(kind, []).append(message)

    def mistakes(self) -> tuple[LogDefect, ...]:
        """What was noted: the first ones each for itself, the rest as a number."""
        where = PurePath(self.document.file).name
        defects: list[LogDefect] = []
        for kind in sorted(self._mistakes):
            messages = self._mistakes[kind]
            named, rest = messages[:MAX_NAMED_MISTAKES], len(messages) - MAX_NAMED_MISTAKES
            defects += [LogDefect(kind, where, 1, message) for message in named]
            if rest > 0:
                defects.append(LogDefect(kind, where, rest, "more mistakes of this kind"))
        return tuple(sorted(defects))

    def note_numbers(self, tree: Any, path: ConfigPath, holds: Callable[[ConfigPath], bool]) -> None:
        """Note every text below a path that should be a number and is none, such as the official `p1/2`.

        Args:
            tree: The value at the path.
            path: Where it stands.
            holds: Whether the value at a path should be a number.
        """
        for place, value in _leaves(tree, path):
            if isinstance(value, str) and holds(place):
                try:
                    arithmetic(value)
                except ValueError as cause:
                    self.note("configuration_mistake", place, str(cause), "no order depends on it")

    def refuse(self, path: ConfigPath, cause: str, hint: str) -> NoReturn:
        """Stop: what is at this path cannot be used."""
        raise DataFileError(
            cause, file=self.document.file, place=self.document.place(path), hint=hint
        ) from None

    def _typed(self, value: Any, kind: type[_Kind], words: str, path: ConfigPath) -> _Kind:
        # True and false are whole numbers to Python.
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            self.refuse(path, f"{shown(value)} is not {words}", f"give {words} here")
        return value

    def mapping(self, value: Any, path: ConfigPath) -> Mapping[Any, Any]:
        """A map, which must not be left empty."""
        if value is None:
            self.refuse(path, "nothing is given here", "give a map, or remove the key")
        return self._typed(value, dict, "a map", path)

    def sequence(self, value: Any, path: ConfigPath) -> Sequence[Any]:
        """A list."""
        return self._typed(value, list, "a list", path)

    def text(self, value: Any, path: ConfigPath) -> str:
        """A text with something in it."""
        text = self._typed(value, str, "text", path)
        return text if text else self.refuse(path, "an empty name is given here", "give the name")

    def whole(self, value: Any, path: ConfigPath, *, at_least: int, at_most: int, what: str) -> int:
        """A whole number within limits; `what` words what lies beyond them."""
        number = self._typed(value, int, "a whole number", path)
        if not at_least <= number <= at_most:
            self.refuse(path, f"{number} {what}", f"give {at_least} to {at_most}")
        return number

    def count(self, value: Any, path: ConfigPath) -> int:
        """A number of shipments."""
        return self.whole(value, path, at_least=0, at_most=MAX_COUNT, what="shipments cannot be ordered")

    def number(self, value: Any, path: ConfigPath) -> float:
        """A finite number, perhaps written as arithmetic."""
        if isinstance(value, str):
            try:
                return arithmetic(value)
            except ValueError as cause:
                self.refuse(path, str(cause), "write a number, or arithmetic with pi such as 'pi/2'")
        if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
            self.refuse(path, f"{shown(value)} is not a finite number", "give a number")
        return float(value)

    def seconds(self, value: Any, path: ConfigPath) -> float:
        """A time since the start, s."""
        time_s = self.number(value, path)
        if time_s < 0:
            self.refuse(path, f"{value!r} s is before the start", "give 0 or more")
        return time_s

    def three(self, value: Any, path: ConfigPath) -> tuple[float, float, float]:
        """Three numbers."""
        numbers = self.sequence(value, path)
        if len(numbers) != 3:
            self.refuse(path, f"{len(numbers)} numbers are given, not 3", "give three numbers")
        x, y, z = (self.number(number, (*path, i)) for i, number in enumerate(numbers))
        return x, y, z

    def pose(self, value: Any, path: ConfigPath) -> Pose:
        """A pose by `xyz` in m and `rpy` in rad."""
        parts = self.mapping(value, path)
        for key in parts:
            if key not in ("xyz", "rpy"):
                self.note(
                    "ignored_key",
                    (*path, str(key)),
                    f"{shown(key)} is no key of a pose",
                    f"it is ignored, as the simulator does; {did_you_mean(str(key), ('xyz', 'rpy'))}",
                )
        # gear.py: each of the two defaults to zeros.
        xyz = self.three(parts.get("xyz", [0, 0, 0]), (*path, "xyz"))
        rpy = self.three(parts.get("rpy", [0, 0, 0]), (*path, "rpy"))
        try:
            return Pose.from_rpy(xyz, rpy)
        except ValueError as cause:
            self.refuse(path, str(cause), "give metres and radians")

    def names(self, parent: Mapping[Any, Any], key: str, count: int, path: ConfigPath) -> list[str] | None:
        """A list with one name for each shipment; `None` when it is left out."""
        if key not in parent:
            return None
        names = self.sequence(parent[key], (*path, key))
        if len(names) != count:
            self.refuse(
                (*path, key),
                f"{len(names)} names are given for {count} shipments",
                "give one for each shipment",
            )
        return [self.text(name, (*path, key, i)) for i, name in enumerate(names)]

    def given(self, parent: Mapping[Any, Any], key: str, path: ConfigPath) -> Any:
        """The value of a key that must be there."""
        if key not in parent:
            near = did_you_mean(key, [str(k) for k in parent], what="given") if parent else ""
            self.refuse(path, f"key {key!r} is missing", f"add {key!r}" + (f"; {near}" if near else ""))
        return parent[key]

    def one_of(self, parent: Mapping[Any, Any], key: str, known: Sequence[_Kind], path: ConfigPath) -> _Kind:
        """The value of a key that must be there and be one of a few."""
        value = self.given(parent, key, path)
        # Not by `in`: True is 1 to Python.
        for choice in known:
            if type(value) is type(choice) and value == choice:
                return choice
        words = [str(choice) for choice in known]
        return self.refuse((*path, key), f"{shown(value)} is no {key}", did_you_mean(str(value), words))

    def truth(self, parent: Mapping[Any, Any], key: str, path: ConfigPath) -> bool:
        """The value of a key that is true or false; false when it is left out."""
        value = parent.get(key, False)
        return self._typed(value, bool, "true or false", (*path, key))


def _leaves(value: Any, path: ConfigPath) -> Iterator[tuple[ConfigPath, Any]]:
    """Every value that is no map or list, with its path."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(inner, (*path, str(key)))
    elif isinstance(value, list):
        for number, inner in enumerate(value):
            yield from _leaves(inner, (*path, number))
    else:
        yield path, value
