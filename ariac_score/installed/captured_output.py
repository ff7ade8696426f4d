"""Keeping what a plugin prints out of the results: standard output belongs to the result alone."""

from __future__ import annotations

import io
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from decimal import localcontext
from typing import IO

from ariac_score.installed.running import running

__all__ = ["quiet"]

_STDOUT = 1
"""The file descriptor of standard output, which libraries in C and other processes write to."""


def _to_stderr(origin: str, fault: str) -> None:
    sys.stderr.write(f"notice: plugin {origin} {fault}\n")


@contextmanager
def quiet(
    origin: str, say: Callable[[str, str], None] = _to_stderr, *, deep: bool = False, of: str = ""
) -> Iterator[None]:
    """Hold back what is printed in the body, say which plugin printed it, and note that it runs.

    Args:
        origin: The plugin that runs in the body, with its distribution and version.
        say: Takes the origin and what was printed; by default a notice goes to standard error.
        deep: Whether output that bypasses `print` is held back too: of libraries in C, of
            other processes. It takes a temporary file, so not for every message of a log.
        of: Name of the check that the plugin runs for.

    >>> notices = []
    >>> with quiet("loud.rule (loud-rules 1.0)", lambda origin, fault: notices.append(fault)):
    ...     print("hello")
    >>> notices
    ["printed 'hello'; plugins speak through findings alone"]
    """
    printed = io.StringIO()
    diverted: list[str] = []
    try:
        check = f"check {of!r}: " if of else ""
        # Decimals in a context of its own: what a plugin sets there may not round the next one's numbers.
        with running(f"{check}plugin {origin}"), redirect_stdout(printed), localcontext():
            if deep:
                with _diverted(diverted):
                    yield
            else:
                yield
    finally:  # also where the plugin raised: what it printed may say why
        lines = [line for line in [*printed.getvalue().splitlines(), *diverted] if line.strip()]
        if lines:
            more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
            first = lines[0].strip()[:80]
            say(origin, f"printed {first!r}{more}; plugins speak through findings alone")


@contextmanager
def _diverted(lines: list[str]) -> Iterator[None]:
    """Collect what reaches the descriptor of standard output, as lines; nothing where it is closed."""
    try:
        kept = os.dup(_STDOUT)
    except OSError:  # closed, as for a daemon
        yield
        return
    with _file_without_name() as below:
        _flush()  # what was printed before belongs to the result, not into the file
        os.dup2(below.fileno(), _STDOUT)
        try:
            yield
        finally:
            _flush()
            os.dup2(kept, _STDOUT)
            os.close(kept)
            below.seek(0)
            lines += below.read().decode("utf-8", "replace").splitlines()


def _file_without_name() -> IO[bytes]:
    if hasattr(os, "memfd_create"):  # on Linux; tempfile takes longer to load than most plugins
        return os.fdopen(os.memfd_create("printed"), "w+b")
    return tempfile.TemporaryFile()


def _flush() -> None:
    """Write out what Python still buffers."""
    if sys.__stdout__ is not None and not sys.__stdout__.closed:
        sys.__stdout__.flush()
