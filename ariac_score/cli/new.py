"""`ariac-score new monitor|rule|reader|distribution NAME`: start a plugin of your own, and let it grow."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ariac_score.errors import UsageError
from ariac_score.testing.grow import grow
from ariac_score.testing.starter import KINDS, new_files


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "new",
        description="Start a monitor or rule as one file, with a rule set that uses it and a test beside it; "
        "grow such files into a distribution that installs; or start a reader, which is one at once.",
    )
    parser.add_argument("kind", choices=(*KINDS, "distribution"), help="what to write")
    parser.add_argument(
        "name",
        metavar="NAME",
        help="name of the plugin, such as workshop.calm_robot, or of a family: workshop",
    )
    parser.add_argument(
        "--from",
        dest="source",
        type=Path,
        metavar="RULES",
        help="distribution: the rule set that names the files of code, or its folder",
    )
    parser.add_argument(
        "--into",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="where to write; default: the current folder",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the files, and print what to do next."""
    if (arguments.kind == "distribution") != (arguments.source is not None):
        raise UsageError(
            "a distribution grows from a rule set, and nothing else does",
            hint="ariac-score new monitor NAME, then: ariac-score new distribution NAME --from ours.yaml",
        )
    if arguments.source is not None:
        files = grow(arguments.source, arguments.name, arguments.into)
    else:
        files = new_files(arguments.kind, arguments.name, arguments.into)
    for file in files:
        print(file.as_posix())
    print(f"\nnext: {_next(files)}")
    return 0


def _next(files: list[Path]) -> str:
    """What to do with new files."""
    projects = [file.parent for file in files if file.name == "pyproject.toml"]
    if projects:
        tested = any(file.name.startswith("test_") for file in files)
        last = "python -m pytest" if tested else "ariac-score plugins doctor"
        return f"cd {projects[0].as_posix()} && pip install -e . && {last}"
    (rules,) = [file for file in files if file.suffix == ".yaml"]
    return f"ariac-score score LOG --rules {rules.as_posix()} --local-plugins"
