"""What callers in Python give: paths as text or `Path`, and errors of ours for anything else."""

from __future__ import annotations

import os
from pathlib import Path

from ariac_score.errors import UsageError

__all__ = ["path_of"]


def path_of(given: str | os.PathLike[str], what: str = "a path") -> Path:
    """A path, however it was given.

    Args:
        given: Text or a path.
        what: What it should name, for the error.

    Raises:
        UsageError: It is neither.

    >>> path_of("runs/7.mcap").name
    '7.mcap'
    """
    if isinstance(given, Path):
        return given
    if (isinstance(given, str) and given) or isinstance(given, os.PathLike):
        return Path(given)
    words = "empty text" if given == "" else f"a {type(given).__name__}"
    raise UsageError(f"{what} is wanted, and {words} is given", hint="give the path as text or as a Path")
