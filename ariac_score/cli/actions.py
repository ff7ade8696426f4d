"""Actions of a command, such as `list` of `ariac-score rules`."""

from __future__ import annotations

import argparse
from typing import Any

__all__ = ["add_action"]


def add_action(actions: Any, name: str, summary: str) -> argparse.ArgumentParser:
    """Add the parser of an action.

    Args:
        actions: The actions of the command.
        name: Of the action.
        summary: For the list of actions, and, as a sentence, for the help of this one.
    """
    # argparse shows `help` in the list alone, so without a description the action has none of its own.
    description = f"{summary[:1].upper()}{summary[1:]}."
    parser: argparse.ArgumentParser = actions.add_parser(name, help=summary, description=description)
    return parser
