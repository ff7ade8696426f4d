"""Named parameters of a rule set: prices and tolerances with a unit, for formulas and for checks.

    parameters:
      points: {right_type: 2 points, right_color: 1 points}
      tolerance: {value: 0.03, unit: m, meaning: how far a part may lie from its place}
      separation_weight: 0.4

Formulas say `points.right_type`, a check takes one by `max_distance_m: {parameter: tolerance}`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from ariac_score.errors import RuleSetError, did_you_mean

__all__ = [
    "NamedParameter",
    "as_stated",
    "groups_of",
    "merged_parameters",
    "named_parameters",
    "references",
    "with_number",
    "with_values",
    "without_numbers",
]

Number = int | float
_ABOUT = ("value", "unit", "meaning")
_GROUP = {"unit", "meaning"}
_WITH_UNIT = re.compile(r"([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s+(\S.*?)\s*")
_REFERENCE = "parameter"


class NamedParameter(NamedTuple):
    """One number that a rule set gives a name.

    Attributes:
        value: The number.
        unit: As the rule set writes it, such as `points` or `m`; `1` where it says none.
        meaning: In words; empty where the rule set says nothing.
    """

    value: Number
    unit: str = "1"
    meaning: str = ""


def as_stated(stated: Mapping[str, Any]) -> dict[str, Any]:
    """A block of parameters with `2 points` written out as value and unit; plain numbers stay.

    >>> as_stated({"points": {"right_type": "2 points"}, "price": 0.4})
    {'points': {'right_type': {'value': 2, 'unit': 'points'}}, 'price': 0.4}
    """
    return {name: _as_stated(body) for name, body in stated.items()}


def _as_stated(body: Any) -> Any:
    if isinstance(body, str):
        found = _WITH_UNIT.fullmatch(body)
        assert found is not None  # the schema lets no other text through
        return {"value": _number(found[1]), "unit": found[2]}
    if not isinstance(body, Mapping) or "value" in body:
        return body
    return {key: inner if key in _ABOUT else _as_stated(inner) for key, inner in body.items()}


def _number(text: str) -> Number:
    try:
        return int(text)
    except ValueError:
        return float(text)


def merged_parameters(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """The parameters of a base with those that an extension changes, adds, or takes away with `null`.

    A plain number keeps unit and meaning of the one it replaces.
    """
    merged = dict(base)
    for name, body in own.items():
        before = base.get(name)
        if body is None and name in base:
            del merged[name]
        elif isinstance(body, Mapping) and isinstance(before, Mapping):
            both = ("value" in body) == ("value" in before)
            merged[name] = merged_parameters(before, body) if both else body
        elif isinstance(before, Mapping) and "value" in before:
            merged[name] = {**before, "value": body}
        else:
            merged[name] = body
    return merged


def named_parameters(stated: Mapping[str, Any]) -> dict[str, NamedParameter]:
    """Every parameter by the name that formulas use, in the order of the file.

    >>> named_parameters({"points": {"unit": "points", "right_type": 2}, "price": 0.4})["points.right_type"]
    NamedParameter(value=2, unit='points', meaning='')
    """
    found: dict[str, NamedParameter] = {}
    for name, body in stated.items():
        if not isinstance(body, Mapping) or "value" in body:
            found[name] = _named(body, {})
            continue
        for inner, each in body.items():
            if inner not in _ABOUT:
                found[f"{name}.{inner}"] = _named(each, body)
    return found


def _named(body: Any, group: Mapping[str, Any]) -> NamedParameter:
    own: Mapping[str, Any] = body if isinstance(body, Mapping) else {"value": body}
    return NamedParameter(
        own["value"], own.get("unit", group.get("unit", "1")), own.get("meaning", group.get("meaning", ""))
    )


def groups_of(parameters: Mapping[str, NamedParameter]) -> dict[str, dict[str, Number]]:
    """The groups of parameters, each with its numbers by their own name."""
    groups: dict[str, dict[str, Number]] = {}
    for name, one in parameters.items():
        group, dot, inner = name.partition(".")
        if dot:
            groups.setdefault(group, {})[inner] = one.value
    return groups


def with_number(stated: Mapping[str, Any], name: str, value: Any) -> dict[str, Any] | None:
    """A block of parameters with another value of one; `None` where it has none of that name."""
    if name not in named_parameters(stated):
        return None
    group, dot, inner = name.partition(".")
    return merged_parameters(stated, {group: {inner: value}} if dot else {name: value})


def without_numbers(stated: Mapping[str, Any], names: Iterable[str]) -> dict[str, Any]:
    """A block of parameters without some of them, and without groups that have no other."""
    for name in names:
        group, dot, inner = name.partition(".")
        stated = merged_parameters(stated, {group: {inner: None}} if dot else {name: None})
    empty = {name: None for name, body in stated.items() if isinstance(body, Mapping) and set(body) <= _GROUP}
    return merged_parameters(stated, empty)


def references(given: Any) -> Iterator[str]:
    """The name of every `{parameter: name}` in what a check is given."""
    name = _referred(given)
    if name is not None:
        yield name
        return
    inner = given.values() if isinstance(given, Mapping) else given if isinstance(given, list) else ()
    for value in inner:
        yield from references(value)


def _referred(given: Any) -> str | None:
    if isinstance(given, Mapping) and set(given) == {_REFERENCE} and isinstance(given[_REFERENCE], str):
        name: str = given[_REFERENCE]
        return name
    return None


def with_values(given: Any, parameters: Mapping[str, NamedParameter]) -> Any:
    """What a check is given, with the values of the parameters it names; of a group a map of its numbers.

    Raises:
        RuleSetError: There is no parameter of that name.
    """
    groups = groups_of(parameters)

    def value_of(name: str) -> Any:
        if name in parameters:
            return parameters[name].value
        if name in groups:
            return dict(groups[name])
        raise RuleSetError(
            f"there is no parameter {name!r}",
            hint=did_you_mean(name, [*parameters, *groups], what="parameters of this rule set"),
        )

    return _replaced(given, value_of)


def _replaced(given: Any, value_of: Callable[[str], Any]) -> Any:
    name = _referred(given)
    if name is not None:
        return value_of(name)
    if isinstance(given, Mapping):
        return {key: _replaced(value, value_of) for key, value in given.items()}
    return [_replaced(value, value_of) for value in given] if isinstance(given, list) else given
