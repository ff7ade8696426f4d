"""What callers in Python give: paths as text or `Path`, and errors of ours for anything else."""

from __future__ import annotations

import os
from pathlib import Path

from ariac_score.errors import UsageError

__all__ = ["name_or_path", "path_of", "refuse_other"]


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
    words = "empty text" if given == "" else kind_of(given)
    raise UsageError(f"{what} is wanted, and {words} is given", hint="give the path as text or as a Path")


def name_or_path(given: str | os.PathLike[str], what: str = "a name or path") -> str:
    """A name as text; a path as text that nobody takes for a name.

    Raises:
        UsageError: It is neither.

    >>> name_or_path("ariac2020"), name_or_path(Path("ours"))
    ('ariac2020', './ours')
    """
    if isinstance(given, str):
        return given
    path = path_of(given, what)
    return f"./{path}" if len(path.parts) == 1 else str(path)


def refuse_other(given: object, wanted: type, what: str, hint: str) -> None:
    """Refuse what is not of a type.

    Args:
        given: Whatever a caller gave.
        wanted: The type it should have.
        what: Words for it, such as `a result`.
        hint: How to get one.

    Raises:
        UsageError: It is of another type.

    >>> refuse_other(3, str, "a name", "write it in quotes")
    Traceback (most recent call last):
    ...
    ariac_score.errors.UsageError: a name is wanted, and an int is given
    """
    if not isinstance(given, wanted):
        raise UsageError(f"{what} is wanted, and {kind_of(given)} is given", hint=hint)


def kind_of(given: object) -> str:
    """What a value is, with its article.

    >>> kind_of(3), kind_of("x"), kind_of(None)
    ('an int', 'a str', 'None')
    """
    name = type(given).__name__
    return "None" if given is None else f"{'an' if name[0] in 'aeioAEIO' else 'a'} {name}"
