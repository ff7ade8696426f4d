"""`ariac-score new monitor|rule|reader NAME`: start a plugin of your own."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ariac_score.testing.kit import new_distribution


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "new",
        description="Write a distribution that installs with 'pip install -e .' and passes its own tests.",
    )
    parser.add_argument("kind", choices=("monitor", "rule", "reader"), help="kind of plugin")
    parser.add_argument("name", metavar="NAME", help="name of the plugin, such as workshop.calm_robot")
    parser.add_argument(
        "--into",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="where to make its folder; default: the current folder",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Write the files, and print what to do next."""
    files = new_distribution(arguments.kind, arguments.name, arguments.into)
    for file in files:
        print(file.as_posix())
    folder = next(file.parent for file in files if file.name == "pyproject.toml")
    print(f"\nnext: cd {folder.as_posix()} && pip install -e . && python -m pytest")
    return 0
