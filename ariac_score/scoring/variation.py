"""A rule set changed in Python: other numbers for a sweep, a monitor from a notebook."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from ariac_score.checks.local import GivenPlugin
from ariac_score.errors import RuleSetError, UsageError, did_you_mean
from ariac_score.scoring.named import named_parameters, with_number

__all__ = ["given_monitor", "set_number"]

_GROUP = "ariac_score.monitors"
_NOT_PLAIN = object()


def set_number(data: dict[str, Any], name: str, value: Any, *, file: str) -> None:
    """Set a parameter in the data of a whole rule set.

    Args:
        data: Changed in place.
        name: A named parameter, such as `points.right_type`, or `check.parameter`.
        value: The new value.
        file: Of the rule set, for errors.

    Raises:
        RuleSetError: There is no parameter or check of that name, or the value is none that YAML holds.
    """
    plain = _plain(value)
    if plain is _NOT_PLAIN:
        raise RuleSetError(
            f"{name!r} cannot be {str(value)[:60]!r}: it is no finite number, no text, nor a list of such",
            file=file,
            hint="give one finite number at a time",
        )
    value = plain
    check, dot, parameter = str(name).partition(".")
    stated = data.get("parameters", {})
    changed = with_number(stated, str(name), value)
    if changed is not None:
        data["parameters"] = changed
        return
    for section in ("rules", "monitors"):
        if dot and check in data.get(section, {}):
            data[section][check].setdefault("with", {})[parameter] = value
            return
    raise RuleSetError(
        f"the rule set has no parameter {name!r}",
        file=file,
        hint=did_you_mean(name, [*named_parameters(stated), *_numbers_of_checks(data)], what="it has"),
    )


def _numbers_of_checks(data: Mapping[str, Any]) -> Iterator[str]:
    for section in ("rules", "monitors"):
        for check, body in data.get(section, {}).items():
            yield from (f"{check}.{parameter}" for parameter in body.get("with", {}))


def given_monitor(monitor: object) -> tuple[GivenPlugin, dict[str, Any]]:
    """The plugin that a class or an object is, and the parameters that make the object again.

    Raises:
        UsageError: It is no monitor.
    """
    kind = monitor if isinstance(monitor, type) else type(monitor)
    if not callable(getattr(kind, "watch", None)):
        raise UsageError(
            f"{kind.__name__!r} is no monitor: it has no method 'watch'",
            hint="give a class with watch(trial), or an object of one: NearMiss(limit_m=0.5)",
        )
    if isinstance(monitor, type):
        return GivenPlugin.of(kind, _GROUP), {}
    if is_dataclass(kind):
        values = {f.name: _plain(getattr(monitor, f.name)) for f in fields(kind) if f.init}
        if all(value is not _NOT_PLAIN for value in values.values()):
            return GivenPlugin.of(kind, _GROUP), values
    return GivenPlugin.of(kind, _GROUP, monitor), {}


def _plain(value: Any) -> Any:
    """A value as YAML holds it, so that it makes the same parameter again; `_NOT_PLAIN` where it cannot."""
    if isinstance(value, np.generic):  # as `np.linspace` gives them
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return _NOT_PLAIN
    if value is None or type(value) in (bool, int, float, str):
        return value
    if not isinstance(value, list | tuple | Mapping):
        return _NOT_PLAIN
    inner = {k: _plain(v) for k, v in (value.items() if isinstance(value, Mapping) else enumerate(value))}
    if any(one is _NOT_PLAIN for one in inner.values()):
        return _NOT_PLAIN
    return inner if isinstance(value, Mapping) else list(inner.values())
