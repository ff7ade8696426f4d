"""Which installed files of other distributions a rule set or log map was made of: its bases and its penalty.

They are noted in the expanded text itself, so that whoever is sent that text, as a worker of a batch, a
platform or `verify`, names the same distributions in a result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from ariac_score.checks.registry import Plugin, Registry
from ariac_score.errors import PluginError
from ariac_score.installed.points import OURS

__all__ = ["KEY", "both_origins", "is_foreign", "note_origin", "origins"]

KEY = "rests_on"
"""Under it an expanded text lists, by the last word of the entry-point group, the names of such files."""


def is_foreign(plugin: Plugin) -> bool:
    """Whether another distribution brings it; ours stands in every result, by the hash of its code."""
    return plugin.distribution != "ariac-score"


def note_origin(data: dict[str, Any], group: str, name: str, registry: Registry) -> None:
    """Note in the expanded text that it was made of an installed file as well.

    Args:
        data: The text as plain values; it is changed.
        group: Entry-point group of the file.
        name: Its name; a path needs no note, for the hash covers that file and nobody else brings it.
        registry: The installed plugins.
    """
    if name.endswith((".yaml", ".yml")) or "/" in name or not is_foreign(registry.file(group, name).plugin):
        return
    data[KEY] = both_origins(data.get(KEY, {}), {group.removeprefix(OURS): [name]})


def both_origins(
    first: Mapping[str, Sequence[str]], second: Mapping[str, Sequence[str]]
) -> dict[str, list[str]]:
    """The notes of two texts that become one.

    >>> both_origins({"rule_sets": ["cup"]}, {"rule_sets": ["cup.finals"], "penalties": ["mild"]})
    {'penalties': ['mild'], 'rule_sets': ['cup', 'cup.finals']}
    """
    return {key: sorted({*first.get(key, ()), *second.get(key, ())}) for key in sorted({*first, *second})}


def origins(noted: Mapping[str, Sequence[str]], registry: Registry) -> list[Plugin]:
    """The entry points of the files that are noted; what is not installed here is missing."""
    found = []
    for key, names in noted.items():
        for name in names:
            with suppress(PluginError):
                found.append(registry.file(OURS + key, name).plugin)
    return found
