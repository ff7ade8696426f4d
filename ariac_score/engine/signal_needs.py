"""What a check needs of a log."""

from __future__ import annotations

from typing import Any

from ariac_score.checks.contracts import Monitor, SignalNeed
from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Plugin
from ariac_score.installed.captured_output import quiet

__all__ = ["needs_of"]


def needs_of(plugin: Plugin, name: str, check: Any) -> list[SignalNeed]:
    """The signals a monitor needs; none for a rule.

    Raises:
        PluginError: It raised, or yields something that is no `SignalNeed`.
    """
    if not isinstance(check, Monitor):
        return []
    try:
        with quiet(plugin.origin):
            stated = check.needs()
            if stated is None:
                raise TypeError("None was returned; yield each, or return a list of them")
            needs = list(stated)
    except (Exception, SystemExit) as cause:
        raise broken(
            plugin, f"raised {type(cause).__name__} when it stated its needs: {cause}", of=name
        ) from cause
    for need in needs:
        if not isinstance(need, SignalNeed):
            raise broken(plugin, f"needs a {type(need).__name__} instead of a SignalNeed", of=name)
    return needs
