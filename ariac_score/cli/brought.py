"""Commands of plugins: the entry points of the group `ariac_score.commands`.

The entry point of a command has the name of the command and leads to a module with a function
`register(commands)`, which adds the parser of that name. Its line in `--help` is the first line of the
module's docstring, read from the source. The module is not imported for that: a stranger's package
may be slow to load, or broken, and the help of the other commands has to work all the same.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ariac_score.checks.registry import Plugin, Registry
from ariac_score.errors import PluginConflictError, PluginError
from ariac_score.installed.captured_output import fault_of

__all__ = ["GROUP", "brought_commands", "register_brought", "summary_of"]

GROUP = "ariac_score.commands"


def brought_commands(own: Collection[str]) -> Mapping[str, Sequence[Plugin]]:
    """The plugins that provide each command, by name.

    Args:
        own: Commands of ariac-score, which no plugin can replace.
    """
    registry = Registry()
    names = [name for name in registry.names(GROUP) if name not in own]
    return {name: registry.providers(GROUP, name) for name in names}


def summary_of(plugins: Sequence[Plugin]) -> str:
    """The line about a command in `--help`; nothing of it is imported."""
    if len(plugins) > 1:
        return f"cannot be used: it is brought by {_all(plugins)}"
    module = plugins[0].target.partition(":")[0].strip()
    try:
        first = (_docstring(module) or "").strip().partition("\n")[0]
    except (OSError, ValueError, SyntaxError, ImportError):
        first = ""
    # The docstring may begin with the command line, as ours do; the summary follows it.
    summary = first.partition("`: ")[2] if first.startswith("`") else first
    return (summary or f"a command of {plugins[0].distribution}").rstrip(".").replace("%", "%%")


def _docstring(module: str) -> str | None:
    top, *rest = module.split(".")
    spec = find_spec(top)
    if spec is None:
        return None
    place = Path(next(iter(spec.submodule_search_locations or ()), spec.origin or ""), *rest)
    files = (place, place.with_name(f"{place.name}.py"), place / "__init__.py")
    file = next((file for file in files if file.is_file()), None)
    return None if file is None else ast.get_docstring(ast.parse(file.read_text(encoding="utf-8")))


def register_brought(name: str, plugins: Sequence[Plugin], commands: Any) -> None:
    """Let a plugin add its command.

    Raises:
        PluginConflictError: Two distributions provide it.
        PluginError: It cannot be imported, or does not add the command.
    """
    if len(plugins) > 1:
        raise PluginConflictError(
            f"the command {name!r} is brought by {_all(plugins)}",
            hint="uninstall one: the order of sys.path must not decide",
        )
    (plugin,) = plugins
    origin = f"the command {name!r} ({plugin.distribution} {plugin.version})"
    try:
        plugin.load().register(commands)
    except (Exception, SystemExit) as cause:  # a stranger's module may raise anything
        true = cause.__cause__ if isinstance(cause, PluginError) and cause.__cause__ else cause
        raise PluginError(
            f"{origin} cannot be used: {fault_of(true)}",
            hint=f"repair or reinstall {plugin.distribution}",
        ) from cause
    if name not in commands.choices:
        raise PluginError(
            f"{origin} does not add a parser of that name",
            hint=f"report this to the authors of {plugin.distribution}",
        )
    commands.choices[name].set_defaults(author=f"{plugin.distribution} {plugin.version}")


def _all(plugins: Sequence[Plugin]) -> str:
    return " and ".join(f"{plugin.distribution} {plugin.version}" for plugin in plugins)
