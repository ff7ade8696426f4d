"""Stored documents as canonical JSON, and back: everything follows from the class of the document.

Same value, same bytes: keys are sorted, numbers are the shortest that read back as they were, and no
clock goes in. A line holds one value, or one object or array that contains no other.

A field is added in its class alone: give it a default, and older documents still read. A change that
older documents do not survive raises the version of its `Format` and brings one small function that
makes the plain values of the version before into those of the new one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from decimal import Decimal
from functools import cached_property
from inspect import cleandoc
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from ariac_score.documents.plain_file import read_plain
from ariac_score.documents.schema import strict_json
from ariac_score.errors import DataFileError, NoResultError, ResultError

__all__ = ["MAX_BYTES", "Format", "as_text", "encodable", "leave_out_empty", "plain"]

T = TypeVar("T")
U = TypeVar("U")

MAX_BYTES = 64 << 20
"""A larger file is no document of ours; the result of a whole trial has some ten KB."""


def _as_plain(value: Any) -> Any:
    """Values of types that msgspec does not know: numbers of numpy, mappings that are no `dict`."""
    if isinstance(value, float):  # those of numpy
        return float(value)
    if isinstance(value, Mapping):
        return dict(value)
    raise NotImplementedError(f"{type(value).__name__} cannot be stored")


# Amounts are numbers in JSON, not texts; as decimals they keep their trailing zeros.
_ENCODER = msgspec.json.Encoder(order="sorted", decimal_format="number", enc_hook=_as_plain)
_LEAST, _LARGEST = -(1 << 63), (1 << 64) - 1
"""Integers that can be written again: msgspec reads larger ones, but does not write them."""
_NO_NUMBER = re.compile(rb"\xcb[\x7f\xff][\xf0-\xff]")
"""How an infinite float64, or one that is no number, begins in MessagePack."""
# A line break stands between values only, never in a text, so neither can be mistaken for the other.
_INNERMOST = re.compile(r"[\[{]\n[^\[\]{}]*\n *(?=[\]}])")


def as_text(value: Any, tag: str = "") -> str:
    """A value as canonical JSON, with a newline at its end.

    Args:
        value: A document, or a part of one.
        tag: Name and version of its format, which stands first in it.

    Raises:
        ValueError: A number is not finite.

    >>> print(as_text({"b": [1.5, None], "a": {}}, "ariac-score/example/1"), end="")
    {
     "schema": "ariac-score/example/1",
     "a": {},
     "b": [1.5, null]
    }
    """
    try:
        body = _ENCODER.encode(value)
    except UnicodeEncodeError:  # half a surrogate pair, which a log may hold in a name
        value = encodable(plain(value))
        body = _ENCODER.encode(value)
    _refuse_no_number(value)
    if tag:
        body = _ENCODER.encode({"schema": tag})[:-1] + b"," + body[1:]
    text = msgspec.json.format(body, indent=1).decode("utf-8")
    return _INNERMOST.sub(_on_one_line, text) + "\n"


def _refuse_no_number(value: Any) -> None:
    """Refuse NaN and infinity, for which msgspec writes null in JSON, but not in MessagePack."""
    packed = msgspec.msgpack.encode(value, enc_hook=_as_plain)
    if not _NO_NUMBER.search(packed):
        return
    # A text may hold the same bytes; only a comparison shows which it is.
    if msgspec.json.decode(msgspec.json.encode(value, enc_hook=_as_plain)) != msgspec.msgpack.decode(packed):
        raise ValueError("a number is not finite")


def _on_one_line(found: re.Match[str]) -> str:
    bracket, content = found[0][0], found[0][2:].lstrip(" ")
    indent = len(found[0]) - 2 - len(content)
    return bracket + content[:-indent].replace(",\n" + " " * indent, ", ")


def plain(value: Any) -> Any:
    """A value as JSON has it: dictionaries, lists, texts, numbers; amounts stay decimal."""
    return msgspec.to_builtins(value, builtin_types=(Decimal,), enc_hook=_as_plain)


def leave_out_empty(document: Any, *names: str) -> None:
    """Leave fields of a dataclass out of its JSON where they are empty; called in its `__post_init__`.

    So a document of a version that did not know the field has the same bytes when it is written again.
    The value is then that of the class, which is the default: a field that has one as a factory has none.
    """
    for name in names:
        if not getattr(document, name):
            document.__dict__.pop(name, None)


def encodable(value: Any) -> Any:
    """Plain values of which each text has a place in UTF-8, which half a surrogate pair has not."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode("utf-8")
    if isinstance(value, dict):
        return _encodable_keys(value)
    return [encodable(inner) for inner in value] if isinstance(value, list | tuple) else value


def _encodable_keys(value: dict[Any, Any]) -> dict[Any, Any]:
    # A key may already be the text that half a surrogate pair in another becomes: both are kept, the one
    # that changes with as many marks as it needs. Sorted, so that the order of the keys has no say.
    found = {key: encodable(inner) for key, inner in value.items() if encodable(key) == key}
    for key in sorted(key for key in value if encodable(key) != key):
        name = encodable(key)
        while name in found:
            name += "'"
        found[name] = encodable(value[key])
    return found


class Format(Generic[T]):
    """How one kind of document is stored.

    Args:
        name: Of the format, such as `result`.
        version: That is written.
        kind: The class of the document.
        made_by: Which command writes such a file; the remedy in error messages.
        before: For each older version that is read: a function from its plain values to those of the next.
        shapes: For an older version the class that its plain values must fit before that function gets
            them, as far as the function relies on it; the rest is checked in the newest form.
        error: Raised for a file that is not such a document.
    """

    def __init__(
        self,
        name: str,
        version: int,
        kind: type[T],
        *,
        made_by: str,
        before: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]] | None = None,
        shapes: Mapping[int, type] | None = None,
        error: type[DataFileError] | type[ResultError] = DataFileError,
    ) -> None:
        self.name, self.version, self.kind = name, version, kind
        self.made_by, self.before, self.error = made_by, before or {}, error
        self.shapes = shapes or {}

    @property
    def tag(self) -> str:
        """Name and version, as in the field `schema` of a document."""
        return f"ariac-score/{self.name}/{self.version}"

    @cached_property
    def _decoder(self) -> msgspec.json.Decoder[T]:
        return msgspec.json.Decoder(self.kind)

    def schema(self) -> dict[str, Any]:
        """The JSON Schema of a document; descriptions come from the docstrings of its classes."""
        whole = _without_empty_defaults(msgspec.json.schema(self.kind))
        parts = {name: _described(part) for name, part in sorted(whole["$defs"].items())}
        own = parts.pop(whole["$ref"].rpartition("/")[2])
        return {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "$id": f"ariac-score/{self.name}.schema.json",
            **own,
            "properties": {"schema": {"const": self.tag}, **own["properties"]},
            "required": ["schema", *own["required"]],
            "$defs": parts,
        }

    def text(self, value: T) -> str:
        """A document as canonical JSON, with a newline at its end.

        Raises:
            ValueError: A number is not finite.
        """
        return as_text(value, self.tag)

    def read(self, file: Path, *, known: bool = False) -> T:
        """Read a document.

        Args:
            file: Where it is.
            known: Whether its hash is that of a file we wrote, so that it need not be checked.

        Raises:
            ScoreError: Of the kind of this format: missing, or not such a document.
        """
        try:
            # Before reading: anyone may name a file that does not fit into memory.
            if file.stat().st_size > MAX_BYTES:
                raise self._too_large(file)
            document = read_plain(file, MAX_BYTES)
        except FileNotFoundError:
            missing = NoResultError if issubclass(self.error, ResultError) else self.error
            raise missing("no such file", file=file, hint="check the path") from None
        except OSError as cause:
            raise self.error(f"cannot be read: {cause.strerror}", file=file, hint="check the path") from None
        except ValueError as cause:  # a name no file can have, such as one with a null byte
            raise self.error(f"cannot be read: {cause}", file=file, hint="check the path") from None
        return self.decoded(document, file, known=known)

    def decoded(self, document: bytes, file: Path, *, known: bool = False) -> T:
        """The document in the bytes of a file, as `read` reads it."""
        if len(document) > MAX_BYTES:
            raise self._too_large(file)
        try:
            return self._checked(document, file, known=known)
        except ResultError as error:
            error.file = str(file)
            raise
        except (ValueError, RecursionError, ArithmeticError) as cause:
            words = f"not a {self.name}: {_first_line(cause)}"
            raise self.error(words, file=file, hint=f"give the JSON that {self.made_by} wrote") from None

    def _too_large(self, file: Path) -> DataFileError | ResultError:
        words = f"larger than {MAX_BYTES:,} bytes"
        return self.error(words, file=file, hint=f"is this a {self.name}?")

    def _checked(self, document: bytes, file: Path, *, known: bool) -> T:
        # Only the text that we write begins so; a document edited by hand is decoded the long way.
        current = document.startswith(f'{{\n "schema": "{self.tag}"'.encode())
        if known and current:
            return self._decoder.decode(document)
        data = strict_json(document.decode("utf-8"))
        stated = self._stated(data, file)
        if stated != self.version:
            return self._older(data, stated, file)
        try:
            found = self._decoder.decode(document)
        except msgspec.ValidationError as cause:
            raise self._fault(cause, data, file, self.kind) from None
        self._refuse_unknown(data, found, file)
        return found

    def _stated(self, data: Any, file: Path) -> int:
        """The version that a document states, where it is one that can be read."""
        tag = data.get("schema") if isinstance(data, dict) else None
        readable = {f"ariac-score/{self.name}/{version}": version for version in (*self.before, self.version)}
        if isinstance(tag, str) and tag in readable:
            return readable[tag]
        if newer := self.newer(data):
            raise self.error(newer, file=file, place="$.schema", hint="update ariac-score")
        raise self.error(
            f"it states no schema, where {self.tag!r} is due"
            if tag is None
            else f"its schema is {tag!r}, not {self.tag!r}",
            file=file,
            place="$.schema",
            hint=f"give the JSON that {self.made_by} wrote",
        )

    def newer(self, data: Any) -> str:
        """What is wrong with a document that a newer version wrote; empty for any other."""
        stated = data.get("schema") if isinstance(data, dict) else None
        name, _, number = str(stated).rpartition("/")
        if name != f"ariac-score/{self.name}" or not number.isdecimal():
            return ""
        if int(number[:9]) <= self.version:
            return ""
        return f"a newer version wrote it, as {name}/{number[:9]}; this one reads {self.tag}"

    def _older(self, data: dict[str, Any], version: int, file: Path) -> T:
        while version < self.version:
            words = f"it breaks the format ariac-score/{self.name}/{version}"
            if version in self.shapes:
                self._fitting({k: v for k, v in data.items() if k != "schema"}, self.shapes[version], file)
            try:
                data = self.before[version](data)
            # A file that states an older version may hold anything.
            except KeyError as cause:
                raise self.error(f"{words} at {cause}", file=file, place="$", hint=self._hint) from None
            except (TypeError, AttributeError, IndexError, ValueError, ArithmeticError):
                raise self.error(words, file=file, place="$", hint=self._hint) from None
            version += 1
        found = self._fitting(data, self.kind, file)
        self._refuse_unknown(data, found, file)
        return found

    def _fitting(self, data: Any, kind: type[U], file: Path) -> U:
        """Plain values as a value of a class."""
        try:
            return msgspec.convert(data, kind)
        except msgspec.ValidationError as cause:
            raise self._fault(cause, data, file, kind) from None

    def _fault(
        self, cause: msgspec.ValidationError, data: Any, file: Path, kind: Any
    ) -> DataFileError | ResultError:
        # msgspec gives the place of a fault nowhere but in its message.
        words, _, path = str(cause).partition(" - at `")
        place = _exact_place(path.rstrip("`") or "$", data, kind)
        words = words.replace("`", "'")
        words = f"{words[:1].lower()}{words[1:]}".replace("object contains unknown field", "unknown key")
        words = re.sub(r"^object missing required field (.*)$", r"key \1 is missing", words)
        return self.error(words, file=file, place=place, hint=self._hint)

    @property
    def _hint(self) -> str:
        return f"it was edited or damaged: get it again, or make it again with {self.made_by}"

    def _refuse_unknown(self, data: dict[str, Any], found: T, file: Path) -> None:
        """Refuse what msgspec accepts: unknown keys in a dataclass, text for a decimal, endless integers."""
        own = {key: value for key, value in data.items() if key != "schema"}
        for place, words in _strange(own, plain(found), "$"):
            raise self.error(words, file=file, place=place, hint=self._hint)


# Schemas -------------------------------------------------------------------------------

_WORDS = re.compile(r"\^\(([\w|]+)\)\$")
_FIELD = re.compile(r"^    (\w+): (.+(?:\n {8,}.+)*)", re.MULTILINE)


def _without_empty_defaults(schema: Any) -> Any:
    """A schema without empty objects as defaults, which msgspec states since 0.23 and did not before."""
    if isinstance(schema, list):
        return [_without_empty_defaults(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    return {key: _without_empty_defaults(one) for key, one in schema.items() if (key, one) != ("default", {})}


def _described(part: dict[str, Any]) -> dict[str, Any]:
    """A class in a schema: closed, each field described by the docstring."""
    summary, _, fields = cleandoc(part.get("description", "")).partition("\n\nAttributes:\n")
    descriptions = {name: " ".join(words.split()) for name, words in _FIELD.findall(fields)}
    made: dict[str, Any] = {"title": part["title"]}
    if summary:
        made["description"] = _for_readers(" ".join(summary.split()))
    properties = {
        name: {"description": _for_readers(descriptions[name]), **_simple(field)}
        if name in descriptions
        else _simple(field)
        for name, field in part.get("properties", {}).items()
    }
    kept = {key: _simple(value) for key, value in part.items() if key not in ("properties", *made)}
    return {**made, **kept, "properties": properties, "additionalProperties": False} if properties else part


def _for_readers(words: str) -> str:
    return words.replace("`None`", "null").replace("`", "'")


def _simple(part: Any) -> Any:
    """A part of a schema in the terms of JSON: amounts are numbers, a choice of words is an enum."""
    if isinstance(part, list):
        return [_simple(inner) for inner in part]
    if not isinstance(part, dict):
        return part
    if part.get("format") == "decimal":
        return {key: value for key, value in part.items() if key != "format"} | {"type": "number"}
    found = _WORDS.fullmatch(str(part.get("pattern", "")))
    if found:
        others = {key: value for key, value in part.items() if key not in ("type", "pattern")}
        return {**others, "enum": [word for word in found[1].split("|") if word or part.get("default") == ""]}
    if part.get("anyOf", [])[:2] == [{"type": "integer"}, {"type": "number"}]:
        rest = part["anyOf"][2:]
        others = {key: value for key, value in part.items() if key != "anyOf"}
        return {**others, "type": "number"} if not rest else {**others, "anyOf": [{"type": "number"}, *rest]}
    return {key: _simple(value) for key, value in part.items()}


def _first_line(cause: BaseException) -> str:
    return (str(cause).splitlines() or [type(cause).__name__])[0]


def _strange(data: Any, known: Any, place: str) -> Iterator[tuple[str, str]]:
    """Where a file holds something that the document read from it does not: place and cause."""
    if isinstance(data, dict) and isinstance(known, dict):
        for key, value in data.items():
            if key in known:
                yield from _strange(value, known[key], f"{place}.{key}")
            else:  # where a field may be left out, a file of ours leaves it out when it says nothing
                or_empty = "" if value else ", or one to be left out when it says nothing"
                yield f"{place}.{key}", f"unknown key {key!r}{or_empty}"
    elif isinstance(data, list) and isinstance(known, list | tuple):
        for number, (value, inner) in enumerate(zip(data, known, strict=False)):
            yield from _strange(value, inner, f"{place}[{number}]")
    elif isinstance(data, str) and isinstance(known, Decimal):
        yield place, f"expected a number, got {data[:80]!r}"
    elif isinstance(data, int) and isinstance(known, int) and not _LEAST <= data <= _LARGEST:
        yield place, "an integer of more than 64 bits"


def _exact_place(path: str, data: Any, kind: Any) -> str:
    """The path of a fault with the names of keys, for which msgspec writes `[...]`.

    Each key of such an object is tried alone: the one with which the fault remains is meant.
    """
    place = "$"
    steps = re.findall(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]", path)
    whole: Any = deepcopy(data)  # `_still_wrong` takes keys out of it
    at: list[str | int] = []
    for name, index in steps:
        inner = _at(whole, at)
        if index == "..." and isinstance(inner, dict):
            key = next((key for key in [*inner] if _still_wrong(whole, at, key, kind, path)), None)
            if key is None:
                return path
            at.append(key)
            place += f".{key}"
        else:
            at.append(name or int(index))
            place += f".{name}" if name else f"[{index}]"
    return place


def _at(whole: Any, steps: list[str | int]) -> Any:
    for step in steps:
        whole = whole[step]
    return whole


def _still_wrong(whole: Any, at: list[str | int], key: str, kind: Any, path: str) -> bool:
    """Whether the fault is still there when an object holds one of its keys alone."""
    inner = _at(whole, at)
    kept = dict(inner)
    inner.clear()
    inner[key] = kept[key]
    try:
        msgspec.convert({k: v for k, v in whole.items() if k != "schema"}, kind)
    except msgspec.ValidationError as cause:
        if path in str(cause):
            return True
    inner.clear()
    inner.update(kept)
    return False
