"""Results in formats of other programs: CI systems, code hosts, spreadsheets.

Each is a function from a result to its text, named by an entry point: ours as those of distributions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Registry
from ariac_score.errors import PluginError
from ariac_score.installed.captured_output import fault_of, quiet

if TYPE_CHECKING:
    from ariac_score.results.result import Result

__all__ = ["GROUP", "export_names", "exported"]

GROUP = "ariac_score.exports"


def export_names(registry: Registry | None = None) -> list[str]:
    """The installed formats; none of them is loaded."""
    return (registry or Registry()).names(GROUP)


def exported(result: Result, name: str, registry: Registry | None = None) -> str:
    """A result in one of the installed formats.

    Raises:
        PluginError: The format is not installed, or twice, or fails.
    """
    plugin = (registry or Registry()).find(GROUP, name)
    render = plugin.value()
    try:
        with quiet(plugin.origin, deep=True):
            text = render(result)
    except PluginError:
        raise
    except Exception as cause:  # a stranger's code may raise anything
        raise broken(plugin, f"raised {fault_of(cause)}") from cause
    if not isinstance(text, str):
        raise broken(plugin, f"gives a {type(text).__name__} instead of a text")
    return text
