"""Which plugin runs now, noted in a file, so that it can be named when it takes its process with it.

And whether somebody wants this process to stop: a plugin can raise `KeyboardInterrupt` as well.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from ariac_score.installed.system import write_first

__all__ = ["EndedError", "listen_for_interrupts", "note_in", "noted", "running", "was_interrupted"]

_LONGEST = 500
"""A note has so many bytes, so that one write replaces the one before; what is longer is cut."""


class EndedError(BaseException):
    """This program ends a call of a plugin; no `except Exception` of the plugin's own can catch it."""


class _Notes:
    """The notes of this process; it makes none until somebody wants to read them."""

    def __init__(self) -> None:
        self.file, self.count, self.words = -1, 0, ""

    def write(self, words: str) -> None:
        self.words = words
        self.count += 1
        note = f"{self.count} {words}".encode("utf-8", "replace")[:_LONGEST].ljust(_LONGEST)
        write_first(self.file, note)


_NOTES = _Notes()


def note_in(file: Path) -> None:
    """Note from now on which plugin runs, in a file of this process alone."""
    _NOTES.file = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)


@contextmanager
def running(words: str) -> Iterator[None]:
    """Note that a plugin runs in the body.

    Args:
        words: Such as `check 'separation': plugin ours.near_miss (ours 1.0)`.
    """
    if _NOTES.file < 0:
        yield
        return
    before = _NOTES.words
    _NOTES.write(words)
    try:
        yield
    finally:
        _NOTES.write(before)


def noted(file: Path) -> tuple[int, str]:
    """How often the note has changed, and the plugin that ran last; empty where none did.

    >>> noted(Path("nowhere"))
    (0, '')
    """
    try:
        count, _, words = _start_of(file).decode("utf-8", "replace").partition(" ")
        return int(count), words.rstrip()
    except (OSError, ValueError):
        return 0, ""


def _start_of(file: Path) -> bytes:
    """As many bytes as a note has; the process of a run may have left anything in its place."""
    handle = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))  # else a pipe would be waited for
    try:
        return os.read(handle, _LONGEST)
    finally:
        os.close(handle)


class _Interrupts:
    """Interrupts of this process; where nobody listens, each is taken for that of a person."""

    def __init__(self) -> None:
        self.heard = True

    def take(self, _number: int, _frame: FrameType | None) -> None:
        self.heard = True
        raise KeyboardInterrupt


_INTERRUPTS = _Interrupts()


def listen_for_interrupts() -> None:
    """Tell from now on the interrupt of a person, which comes as a signal, from one that a plugin raises."""
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.default_int_handler:
        signal.signal(signal.SIGINT, _INTERRUPTS.take)
    elif handler is not signal.SIG_IGN:  # of a program that we are part of: it may raise what it likes
        return
    _INTERRUPTS.heard = False  # nobody interrupts what ignores signals, as in the background of a script


def was_interrupted() -> bool:
    """Whether a person may have interrupted this process."""
    return _INTERRUPTS.heard
