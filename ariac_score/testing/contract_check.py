"""One check of a contract, and what checks of every kind of plugin share."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.registry import Plugin, Registry, not_by_name
from ariac_score.errors import PluginError

__all__ = ["SECTIONS", "ContractCheck", "ContractError", "origin_of", "snapshot", "undocumented"]

HINT = "the contracts are in the docstrings of ariac_score.checks.contracts"


class ContractError(PluginError):
    """A plugin does not keep its contract."""


@dataclass(frozen=True)
class ContractCheck:
    """One requirement, ready to be tried.

    Attributes:
        name: Such as `time_shift`.
        about: What is required, in one sentence.
        run: Tries it; returns what was not seen although it is kept, in words.
    """

    name: str
    about: str
    run: Callable[[], str | None] = dataclasses.field(repr=False)

    @property
    def __name__(self) -> str:
        """What pytest calls it."""
        return self.name

    def __call__(self) -> None:
        """Try it.

        Raises:
            PluginError: The plugin does otherwise; the message names it.
        """
        self.run()


def origin_of(plugin: Any) -> Plugin:
    """The installed plugin that an object belongs to; where none is installed, one that says so."""
    kind = plugin if isinstance(plugin, type) else type(plugin)
    # The contracts are protocols, so any class with their methods is of the group.
    group = next((name for name, contract in GROUPS.items() if isinstance(plugin, contract)), "")
    package = kind.__module__.partition(".")[0]
    for known in Registry().all(group):
        # The package first: loading a plugin imports it, and most are of other packages.
        if known.package == package and _loads(known, kind):
            return known
    return Plugin(kind.__name__, group, f"{kind.__module__}:{kind.__qualname__}", package, "not installed")


def _loads(known: Plugin, kind: type) -> bool:
    try:
        return known.load() is kind
    except PluginError:
        return False


def undocumented(plugin: Plugin, kind: Any) -> list[str]:
    """The sections that the docstring of a plugin lacks."""
    page = f"\n{inspect.cleandoc(kind.__doc__ or '')}\n"
    return [section for section in SECTIONS[plugin.group] if f"\n{section}:\n" not in page]


def built_by_name(kind: type) -> str:
    """Why a class cannot be built from the `with:` block of a rule set; empty when it can."""
    problem = not_by_name(kind)
    if problem:
        return problem
    try:
        parameters = inspect.signature(kind).parameters.values()
    except (TypeError, ValueError):  # a class in C may have no signature
        return ""
    for parameter in parameters:
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            return f"takes *{parameter.name}, so that a misspelt parameter would pass"
    return ""


def snapshot(value: Any) -> Any:
    """A copy of a value down to its last number, to see later whether anything changed.

    >>> snapshot({"a": (1, [2.5])})
    (('a', (1, (2.5,))),)
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        held = ((f.name, snapshot(getattr(value, f.name))) for f in dataclasses.fields(value))
        return type(value).__name__, *held
    if isinstance(value, Mapping):
        return tuple((key, snapshot(item)) for key, item in value.items())
    if isinstance(value, list | tuple):
        return tuple(snapshot(item) for item in value)
    # Bytes, for NaN is not equal to itself.
    return value.tobytes() if isinstance(value, np.ndarray) else value


SECTIONS: Mapping[str, tuple[str, ...]] = {
    "ariac_score.rules": ("Measures", "Violated when", "Source"),
    "ariac_score.monitors": ("Measures", "Violated when", "Source"),
    "ariac_score.readers": ("Reads", "Refuses", "Source"),
    "ariac_score.decoders": (),
    "ariac_score.tracks": ("Reads", "Source"),
    "ariac_score.record_kinds": (),
    "ariac_score.competitions": ("Source",),
}
"""The sections that the docstring of a plugin has: its help page."""
