"""The option `--local-plugins`, for commands that score by a rule set of one's own."""

from __future__ import annotations

import argparse

from ariac_score.checks.local import allowing
from ariac_score.checks.registry import Registry

__all__ = ["add_local_plugins", "registry_of"]


def add_local_plugins(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument(
        "--local-plugins",
        action="store_true",
        help="run classes in files beside the rule set ('use: ./ours.py:NearMiss'); for rules that you trust",
    )


def registry_of(arguments: argparse.Namespace) -> Registry:
    """The installed plugins, and files beside the rule set where the arguments allow them."""
    return Registry(allowing(arguments.local_plugins))
