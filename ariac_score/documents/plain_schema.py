"""Whether a document surely keeps a schema, without loading jsonschema.

Most documents do, and loading jsonschema takes longer than checking them. Where this is
not sure, or a document breaks the schema, jsonschema is asked: it alone finds faults.

Source: JSON Schema, draft 2020-12, sections "Validation" and "Applicator".
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["surely_keeps"]

_REMARKS = frozenset({"$schema", "$id", "$defs", "title", "description", "default", "examples", "$comment"})


def surely_keeps(data: Any, schema: Any, definitions: Mapping[str, Any]) -> bool:
    """Whether data keep a schema; `False` where they do not, and where only jsonschema can tell.

    Args:
        data: As JSON or YAML gives them.
        schema: The schema, or the part of one that counts here.
        definitions: What `#/$defs/` refers to.

    >>> surely_keeps([1, 2], {"type": "array", "items": {"minimum": 1}}, {})
    True
    """
    if isinstance(schema, bool):
        return schema
    for keyword, wanted in schema.items():
        if keyword in _REMARKS:
            continue
        check = _CHECKS.get(keyword)
        if check is None or not check(data, wanted, schema, definitions):
            return False
    return True


def _type(data: Any, wanted: Any, *_: Any) -> bool:
    names = [wanted] if isinstance(wanted, str) else wanted
    return any(_is(data, name) for name in names)


def _is(data: Any, name: str) -> bool:
    if isinstance(data, bool) or data is None:
        return name == ("null" if data is None else "boolean")
    kinds: Mapping[str, Any] = {
        "object": dict,
        "array": list,
        "string": str,
        "integer": int,
        "number": (int, float),
    }
    return isinstance(data, kinds.get(name, ()))


def _same(data: Any, wanted: Any) -> bool:
    # Whether 1 is 1.0, or true, has rules of its own, so only what is of one kind is sure.
    return type(data) is type(wanted) and isinstance(data, (str, int)) and bool(data == wanted)


def _properties(data: Any, wanted: Mapping[str, Any], _: Any, definitions: Mapping[str, Any]) -> bool:
    return not isinstance(data, dict) or all(
        surely_keeps(data[name], inner, definitions) for name, inner in wanted.items() if name in data
    )


def _additional(data: Any, wanted: Any, schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> bool:
    if not isinstance(data, dict):
        return True
    known, patterns = schema.get("properties", {}), schema.get("patternProperties", {})
    return all(
        isinstance(name, str)
        and (
            name in known
            or any(re.search(pattern, name) for pattern in patterns)
            or surely_keeps(value, wanted, definitions)
        )
        for name, value in data.items()
    )


def _patterns(data: Any, wanted: Mapping[str, Any], _: Any, definitions: Mapping[str, Any]) -> bool:
    return not isinstance(data, dict) or all(
        isinstance(name, str) and (not re.search(pattern, name) or surely_keeps(value, inner, definitions))
        for name, value in data.items()
        for pattern, inner in wanted.items()
    )


def _either(data: Any, condition: Any, schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> bool:
    kept = _decided(data, condition)
    # Where nothing is known of the condition, what keeps both branches keeps the schema.
    branches = ("then", "else") if kept is None else ("then" if kept else "else",)
    return all(surely_keeps(data, schema.get(branch, True), definitions) for branch in branches)


def _decided(data: Any, condition: Any) -> bool | None:
    """Whether data keep a condition about which fields there are; `None` for any other condition."""
    if isinstance(condition, dict) and len(condition) == 1:
        ((keyword, inner),) = condition.items()
        if keyword == "required":
            return _required(data, inner)
        if keyword == "not":
            kept = _decided(data, inner)
            return None if kept is None else not kept
    return None


def _reference(data: Any, wanted: str, _: Any, definitions: Mapping[str, Any]) -> bool:
    inner = definitions.get(wanted.removeprefix("#/$defs/")) if wanted.startswith("#/$defs/") else None
    return inner is not None and surely_keeps(data, inner, definitions)


def _names(data: Any, wanted: Any, _: Any, definitions: Mapping[str, Any]) -> bool:
    return not isinstance(data, dict) or all(
        isinstance(name, str) and surely_keeps(name, wanted, definitions) for name in data
    )


def _items(data: Any, wanted: Any, _: Any, definitions: Mapping[str, Any]) -> bool:
    return not isinstance(data, list) or all(surely_keeps(item, wanted, definitions) for item in data)


def _any(data: Any, wanted: Any, _: Any, definitions: Mapping[str, Any]) -> bool:
    return any(surely_keeps(data, inner, definitions) for inner in wanted)


def _pattern(data: Any, wanted: str, *_: Any) -> bool:
    return not isinstance(data, str) or re.search(wanted, data) is not None


def _number(compare: Callable[[Any, Any], bool]) -> Callable[..., bool]:
    def check(data: Any, wanted: Any, *_: Any) -> bool:
        if isinstance(data, bool) or not isinstance(data, (int, float)):
            return True
        return math.isfinite(data) and compare(data, wanted)

    return check


def _size(kind: Any, compare: Callable[[int, int], bool]) -> Callable[..., bool]:
    def check(data: Any, wanted: int, *_: Any) -> bool:
        return not isinstance(data, kind) or compare(len(data), wanted)

    return check


def _at_least(value: Any, limit: Any) -> bool:
    return bool(value >= limit)


def _at_most(value: Any, limit: Any) -> bool:
    return bool(value <= limit)


def _required(data: Any, wanted: Any, *_: Any) -> bool:
    return not isinstance(data, dict) or all(name in data for name in wanted)


def _dependent(data: Any, wanted: Mapping[str, Any], *_: Any) -> bool:
    return not isinstance(data, dict) or all(
        _required(data, others) for name, others in wanted.items() if name in data
    )


_CHECKS: Mapping[str, Callable[..., bool]] = {
    "$ref": _reference,
    "additionalProperties": _additional,
    "anyOf": _any,
    "const": lambda data, wanted, *_: _same(data, wanted),
    "enum": lambda data, wanted, *_: any(_same(data, value) for value in wanted),
    "dependentRequired": _dependent,
    "else": lambda *_: True,
    "exclusiveMinimum": _number(lambda value, limit: bool(value > limit)),
    "if": _either,
    "items": _items,
    "maxItems": _size(list, _at_most),
    "maxLength": _size(str, _at_most),
    "maxProperties": _size(dict, _at_most),
    "maximum": _number(_at_most),
    "minItems": _size(list, _at_least),
    "minLength": _size(str, _at_least),
    "minProperties": _size(dict, _at_least),
    "minimum": _number(_at_least),
    "pattern": _pattern,
    "patternProperties": _patterns,
    "properties": _properties,
    "propertyNames": _names,
    "required": _required,
    "then": lambda *_: True,
    "type": _type,
}
