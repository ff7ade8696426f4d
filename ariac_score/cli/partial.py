"""The option that asks for logs that are cut off."""

from __future__ import annotations

import argparse

__all__ = ["add_partial"]


def add_partial(parser: argparse.ArgumentParser, words: str = "") -> None:
    """Add `--partial`.

    Args:
        parser: Of the command.
        words: What it does there; by default, that a log is scored.
    """
    parser.add_argument(
        "--partial",
        action=argparse.BooleanOptionalAction,
        help=words
        or "score a log that is cut off as far as it goes, as an interval; the result is unofficial",
    )
