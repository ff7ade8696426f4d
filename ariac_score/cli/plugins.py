"""`ariac-score plugins list`: what is installed, and who brought it."""

from __future__ import annotations

import argparse
from typing import Any

EXIT_PLUGIN = 3


def register(commands: Any) -> None:
    """Add the command and its actions."""
    parser = commands.add_parser("plugins", help="list installed plugins")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="every plugin, its distribution and version")
    listing.set_defaults(run=run)


def run(_arguments: argparse.Namespace) -> int:
    """Print each plugin; one that cannot be loaded or is provided twice is said to be so."""
    from ariac_score.contracts import GROUPS  # noqa: PLC0415  # keeps --help quick
    from ariac_score.errors import PluginError  # noqa: PLC0415
    from ariac_score.registry import Registry  # noqa: PLC0415

    registry, code = Registry(), 0
    for group in GROUPS:
        for plugin in registry.all(group):
            state = _first_line(plugin)
            try:
                registry.find(group, plugin.name)
            except PluginError as error:
                state, code = f"CANNOT BE USED: {error.cause}", EXIT_PLUGIN
            if state.startswith("BROKEN"):
                code = EXIT_PLUGIN
            kind = group.rpartition(".")[2]
            print(f"{kind:<9} {plugin.name:<30} {plugin.distribution} {plugin.version:<8} {state}")
    return code


def _first_line(plugin: Any) -> str:
    """What the plugin is for, in its own words; or why it cannot be loaded."""
    from ariac_score.errors import PluginError  # noqa: PLC0415  # keeps --help quick

    try:
        kind = plugin.load()
    except PluginError as error:
        return f"BROKEN: {error.cause}"
    return (kind.__doc__ or "").strip().partition("\n")[0]
