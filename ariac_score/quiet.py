"""Keeping what a plugin prints out of the results: standard output belongs to the result alone."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout

__all__ = ["quiet"]


def _to_stderr(words: str) -> None:
    sys.stderr.write(f"notice: {words}\n")


@contextmanager
def quiet(origin: str, say: Callable[[str], None] = _to_stderr) -> Iterator[None]:
    """Hold back what is printed meanwhile, and say who printed it.

    Args:
        origin: The plugin that has the word, with its distribution and version.
        say: Where the notice goes; by default to standard error.

    >>> said = []
    >>> with quiet("loud.rule (loud-rules 1.0)", said.append):
    ...     print("hello")
    >>> said
    ["plugin loud.rule (loud-rules 1.0) printed 'hello'; plugins speak through findings alone"]
    """
    heard = io.StringIO()
    try:
        with redirect_stdout(heard):
            yield
    finally:
        lines = [line for line in heard.getvalue().splitlines() if line.strip()]
        if lines:
            more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
            first = lines[0].strip()[:80]
            say(f"plugin {origin} printed {first!r}{more}; plugins speak through findings alone")
