"""Commands that plugins bring: the entry points of the group `ariac_score.commands`.

The entry point of a command is named as the command and leads to a module with a function
`register(commands)`, which adds the parser of that name. What `--help` says of it is the first
line of the module's docstring, which is read from its source: why not import it? A stranger's
package may load much, or be broken, and neither may keep anybody from the help of the others.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ariac_score.errors import PluginConflictError, PluginError
from ariac_score.installed import Point, attribute_of, points_in

__all__ = ["GROUP", "brought_commands", "register_brought", "summary_of"]

GROUP = "ariac_score.commands"


def brought_commands(own: Sequence[str]) -> Mapping[str, Sequence[Point]]:
    """Who brings which command, sorted by name.

    Args:
        own: Commands of ariac-score, which are never looked for elsewhere.
    """
    found: dict[str, list[Point]] = {}
    for point in points_in({GROUP}):
        known = found.setdefault(point.name, [])
        # An editable install beside its own sources shows one distribution twice.
        if point.name not in own and all(
            (p.distribution, p.target) != (point.distribution, point.target) for p in known
        ):
            known.append(point)
    return {name: points for name, points in sorted(found.items()) if points}


def summary_of(points: Sequence[Point]) -> str:
    """What `--help` says of a command; nothing of it is imported."""
    if len(points) > 1:
        return f"cannot be used: it is brought by {_all(points)}"
    module = points[0].target.partition(":")[0].strip()
    try:
        first = (_docstring(module) or "").strip().partition("\n")[0]
    except (OSError, ValueError, SyntaxError, ImportError):
        first = ""
    # A docstring that begins with how the command is called, as ours do, goes on after that.
    words = first.partition("`: ")[2] if first.startswith("`") else first
    return (words or f"a command of {points[0].distribution}").rstrip(".").replace("%", "%%")


def _docstring(module: str) -> str | None:
    top, *rest = module.split(".")
    spec = find_spec(top)
    if spec is None:
        return None
    place = Path(next(iter(spec.submodule_search_locations or ()), spec.origin or ""), *rest)
    files = (place, place.with_name(f"{place.name}.py"), place / "__init__.py")
    file = next((file for file in files if file.is_file()), None)
    return None if file is None else ast.get_docstring(ast.parse(file.read_text(encoding="utf-8")))


def register_brought(name: str, points: Sequence[Point], commands: Any) -> None:
    """Let a plugin add its command.

    Raises:
        PluginConflictError: Two distributions bring it.
        PluginError: It cannot be imported, or does not add the command.
    """
    if len(points) > 1:
        raise PluginConflictError(
            f"the command {name!r} is brought by {_all(points)}",
            hint="uninstall one: the order of sys.path must not choose",
        )
    (point,) = points
    origin = f"the command {name!r} ({point.distribution} {point.version})"
    try:
        attribute_of(point.target).register(commands)
    except (Exception, SystemExit) as cause:  # a stranger's module may raise anything
        raise PluginError(
            f"{origin} cannot be used: {type(cause).__name__}: {cause}",
            hint=f"repair or reinstall {point.distribution}",
        ) from cause
    if name not in commands.choices:
        raise PluginError(
            f"{origin} does not add a parser of that name", hint=f"tell the authors of {point.distribution}"
        )
    commands.choices[name].set_defaults(author=f"{point.distribution} {point.version}")


def _all(points: Sequence[Point]) -> str:
    return " and ".join(f"{point.distribution} {point.version}" for point in points)
