"""Published schemas and the check of documents against them; strict JSON; where the shipped data are."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator
from jsonschema.exceptions import SchemaError

from ariac_score.documents.json_pairs import without_repeats
from ariac_score.documents.yaml import Place, YamlDocument
from ariac_score.errors import DataFileError, did_you_mean

__all__ = [
    "refuse_no_schema",
    "schema",
    "schema_errors",
    "shipped_data",
    "strict_json",
    "validate",
    "value_errors",
]


def strict_json(text: str, *, parse_float: Callable[[str], Any] = float) -> Any:
    """The value of a JSON text that a stranger may have written.

    Args:
        text: The whole text.
        parse_float: Makes the value of a number with a point or exponent.

    Raises:
        ValueError: Not JSON, a key comes twice in an object, or a number is NaN or infinite.
        RecursionError: It is nested too deeply.

    >>> strict_json('{"a": 1, "a": 2}')
    Traceback (most recent call last):
    ...
    ValueError: key 'a' is given twice
    """
    return json.loads(
        text, object_pairs_hook=without_repeats, parse_constant=_no_number, parse_float=parse_float
    )


def _no_number(word: str) -> Any:
    raise ValueError(f"{word} is not a number")


@cache
def schema(name: str) -> Any:
    """One of the published schemas, such as `ruleset`."""
    return json.loads(_folder("schemas").joinpath(f"{name}.schema.json").read_text(encoding="utf-8"))


def _folder(package: str) -> Path:
    """The folder of a package of data."""
    # Not `importlib.resources`, which takes longer to load than the data to read.
    (folder,) = import_module(f"ariac_score.{package}").__path__
    return Path(folder)


@cache
def _validator(name: str, definition: str) -> Draft202012Validator:
    whole = schema(name)
    # A definition may refer to others, so the part needs all of them.
    part = {"$ref": f"#/$defs/{definition}", "$defs": whole["$defs"]} if definition else whole
    return Draft202012Validator(part)


def schema_errors(data: Any, name: str, definition: str = "") -> list[tuple[Place, str, str]]:
    """The faults of a value by a schema: for each its path, the cause and the remedy."""
    return _faults(_validator(name, definition), data)


def _faults(validator: Draft202012Validator, data: Any) -> list[tuple[Place, str, str]]:
    faults = [_deepest(fault) for fault in validator.iter_errors(data)]
    described = [(fault.validator == "required", _description(fault)) for fault in faults]
    # Missing keys last: most often the key is there, misspelt, and its own fault says so better.
    return [fault for _, fault in sorted(described, key=lambda one: (one[0], [str(p) for p in one[1][0]]))]


def value_errors(data: Any, own: Mapping[str, Any]) -> list[tuple[Place, str, str]]:
    """The faults of a value by a schema that is none of ours, as `schema_errors` gives them.

    >>> value_errors({"kind": 3}, {"properties": {"kind": {"type": "string"}}})
    [(('kind',), "3 is not of type 'string'", 'give a string')]
    """
    return _faults(Draft202012Validator(own), data)


def refuse_no_schema(own: Mapping[str, Any]) -> None:
    """Refuse what is no JSON schema (2020-12), or would look for another one elsewhere.

    Raises:
        ValueError: Saying why.
    """
    try:
        Draft202012Validator.check_schema(own)
    except SchemaError as cause:
        raise ValueError(f"no JSON schema: {cause.message}") from None
    todo: list[Any] = [own]
    while todo:
        part = todo.pop()
        if isinstance(part, Mapping):
            if not str(part.get("$ref", "#")).startswith("#"):
                raise ValueError(f"a schema stands alone, and this one refers to {part['$ref']!r}")
            todo += part.values()
        elif isinstance(part, list | tuple):
            todo += part


def _deepest(fault: Any) -> Any:
    """The fault within an `anyOf` at the deepest place: that alternative is most likely the one meant."""
    while fault.context:
        fault = max(fault.context, key=lambda inner: (len(inner.absolute_path), -len(str(inner.message))))
    return fault


def _known_key(name: str, known: Sequence[str], is_known: Callable[[str], bool]) -> str:
    """A remedy for a key that is none: where any name is one, that of the right letters."""
    spelt = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    if not known and is_known(spelt):
        return f"did you mean {spelt!r}?"
    if not known:
        return "give it a name of small letters, digits and underscores that begins with a letter"
    return did_you_mean(name, known, what="known keys")


_LIMITS = {
    "minimum": "of at least",
    "exclusiveMinimum": "above",
    "maximum": "of at most",
    "exclusiveMaximum": "below",
}


def _description(fault: Any) -> tuple[Place, str, str]:
    """Path, cause and remedy of a fault."""
    path = tuple(fault.absolute_path)
    if fault.validator == "additionalProperties" and isinstance(fault.instance, dict):
        known, patterns = [*fault.schema.get("properties", {})], [*fault.schema.get("patternProperties", {})]

        def is_known(key: str) -> bool:
            return key in known or any(re.search(pattern, key) for pattern in patterns)

        extra = next(key for key in sorted(map(str, fault.instance)) if not is_known(key))
        return (*path, extra), f"unknown key {extra!r}", _known_key(extra, known, is_known)
    if fault.validator == "required":
        missing = [key for key in fault.validator_value if key not in fault.instance]
        return path, f"key {missing[0]!r} is missing", f"add {missing[0]!r}"
    if fault.validator == "enum":
        return (
            path,
            f"{fault.instance!r} is not allowed here",
            did_you_mean(str(fault.instance), [str(v) for v in fault.validator_value], what="allowed"),
        )
    if fault.validator in _LIMITS:
        said = [f"{words} {fault.schema[key]:g}" for key, words in _LIMITS.items() if key in fault.schema]
        meaning = fault.schema.get("description", "")
        remedy = f"give a number {' and '.join(said)}"
        return path, str(fault.message), f"{remedy}: {meaning}" if meaning else remedy
    if fault.validator == "type":
        types = _listed_types(fault.validator_value, repr)
        empty = fault.instance is None
        cause = f"it is empty; {types} is needed" if empty else f"{fault.instance!r} is not of type {types}"
        return path, cause, _of_type(fault)
    hint = (
        fault.schema.get("description", "see the schema")
        if isinstance(fault.schema, dict)
        else "see the schema"
    )
    return path, fault.message, hint


def _of_type(fault: Any) -> str:
    """What to write where a value is of another type, in words of YAML."""
    if fault.validator_value == "object":
        first = next(iter(fault.schema.get("required", ())), "key")
        return f"write keys with their values, such as '{first}: …'"
    if fault.validator_value == "array":
        return "give a list: [one, another]"
    return f"give {_listed_types(fault.validator_value, _with_article)}"


def _listed_types(types: str | list[str], say: Callable[[str], str]) -> str:
    """The types of a schema in words."""
    return " or ".join(map(say, [types] if isinstance(types, str) else types))


def _with_article(kind: str) -> str:
    return kind if kind == "null" else f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


def validate(
    document: YamlDocument, name: str, *, definition: str = "", error: type[DataFileError] = DataFileError
) -> None:
    """Check a document against a published schema, or against one definition in it.

    Raises:
        DataFileError: (or `error`) with file, line, path, cause and remedy of the first fault.
    """
    if document.data is None:  # no text, or only comments
        required = ", ".join(f"{key!r}" for key in schema(name).get("required", ()))
        raise error("the file is empty", file=document.file, hint=f"write its keys: {required}")
    faults = [*_beyond_json(document.data, ())] or schema_errors(document.data, name, definition)
    if faults:
        path, cause, hint = faults[0]
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise error(cause + more, file=document.file, place=document.place(path), hint=hint)


def _beyond_json(value: Any, path: Place) -> Iterator[tuple[Place, str, str]]:
    """What YAML can say and JSON cannot, of which a schema therefore knows nothing."""
    if isinstance(value, float) and not math.isfinite(value):  # NaN passes every `minimum`
        yield path, f"{value} is not a finite number", "give a number, such as 0.5, or leave the key out"
    elif isinstance(value, list):
        for place, inner in enumerate(value):
            yield from _beyond_json(inner, (*path, place))
    elif isinstance(value, dict):
        for key, inner in value.items():
            if not isinstance(key, str):
                comma = "; or write 0.03 where 0,03 is meant" if inner is None else ""
                yield (*path, str(key)), f"key {key!r} is not text", f"quote it: {str(key)!r}{comma}"
            yield from _beyond_json(inner, (*path, str(key)))


def shipped_data(name: str) -> Path:
    """A file of our own below `rules/` that no entry point names, such as `penalty/classes.yaml`."""
    return _folder("rules") / name
