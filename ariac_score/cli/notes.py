"""What commands say on stderr beside their results: nothing of it with `--quiet`."""

from __future__ import annotations

import argparse
import os
import sys

from ariac_score.terminal.style import plain

__all__ = ["APART", "counted", "is_apart", "is_quiet", "note"]

APART = "ARIAC_SCORE_APART"
"""Environment variable that tells a command that another one runs it in a process of its own."""


def is_apart() -> bool:
    """Whether this process does a command for another one, which has said what there is to say."""
    return bool(os.environ.get(APART))


def is_quiet(arguments: argparse.Namespace) -> bool:
    """Whether results and errors alone are wanted."""
    return getattr(arguments, "verbosity", 0) < 0


def note(arguments: argparse.Namespace, text: str) -> None:
    """Say something that is neither a result nor an error, in one line."""
    if not is_quiet(arguments):
        print(plain(text), file=sys.stderr)


def counted(number: int, what: str) -> str:
    """A number of things.

    >>> counted(1, "check"), counted(2, "check")
    ('1 check', '2 checks')
    """
    return f"{number} {what}{'' if number == 1 else 's'}"
