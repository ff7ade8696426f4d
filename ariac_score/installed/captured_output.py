"""The one place where code of plugins is called: what it prints, raises and leaves behind stays there.

Standard output belongs to the result alone. No exception of a plugin passes for one of ours, or for the
wish of a person to stop. The working directory, the standard streams and the precision of decimal
numbers are afterwards what they were. This is a fence against slips, not against hostile code, for
which there is none within one process (docs/security.md).
"""

from __future__ import annotations

import io
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from decimal import localcontext
from typing import IO, Any, NamedTuple, TextIO

from ariac_score.errors import PluginError
from ariac_score.installed.running import EndedError, running, was_interrupted

__all__ = ["EscapedError", "Fault", "fault_of", "keep_results_apart", "quiet"]

_STDOUT, _STDERR = 1, 2
"""The file descriptors of standard output and error, which libraries in C and other processes write to."""

_EXIT_OF_COPY = 3


class EscapedError(Exception):
    """A plugin raised what is no `Exception`, and would have ended the program; its cause is that."""


class Fault(NamedTuple):
    """What a plugin raised: the name of its class, and what it says of itself.

    >>> str(fault_of(KeyError("x")))
    "KeyError: 'x'"
    """

    name: str
    text: str

    def __str__(self) -> str:
        return f"{self.name}: {self.text}"


def fault_of(cause: BaseException) -> Fault:
    """What a plugin raised, in words; the text of an exception is a stranger's code too."""
    if isinstance(cause, EscapedError) and cause.__cause__ is not None:
        cause = cause.__cause__
    name = type(cause).__name__
    try:
        return Fault(name, str(cause))
    except BaseException as raised:
        if _is_of_people(raised):
            raise
        return Fault(name, f"(its text cannot be shown: {type(raised).__name__})")


def _is_of_people(cause: BaseException) -> bool:
    """Whether it is the wish of a person to stop."""
    return isinstance(cause, KeyboardInterrupt) and was_interrupted()


def _to_stderr(origin: str, fault: str) -> None:
    sys.stderr.write(f"notice: plugin {origin} {fault}\n")


def keep_results_apart() -> TextIO | None:
    """Let `sys.stdout` alone lead to standard output from here on, and its descriptor to standard error.

    For the process of a command: whatever a plugin starts, or leaves to be done at the end, writes to the
    descriptor. Both streams outlive their readers, as with `| head`: the command goes on, for its exit code
    is what it finds, whoever reads it.

    Returns:
        The stream, to be closed at the end; `None` where there is no standard output.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as for a daemon
            nowhere = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115  # until the end
            setattr(sys, name, nowhere)
            setattr(sys, f"__{name}__", nowhere)
    before, errors = sys.stdout, sys.stderr
    try:
        if before.fileno() != _STDOUT:
            return None
        before.flush()
        kept = os.dup(_STDOUT)
        os.dup2(_STDERR, _STDOUT)
    except (OSError, ValueError):
        return None
    sys.stdout = _outliving(kept, before)
    if errors.fileno() == _STDERR:
        sys.stderr = _outliving(_STDERR, errors, closefd=False)
    return sys.stdout


class _Outliving(io.FileIO):
    """What is written to a pipe, and nowhere once its reader has gone."""

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.fileno())
            os.close(nowhere)
            return memoryview(data).nbytes


def _outliving(descriptor: int, like: TextIO, *, closefd: bool = True) -> TextIO:
    to_pipe = io.BufferedWriter(_Outliving(descriptor, "w", closefd=closefd))
    to_person = os.isatty(descriptor) or descriptor == _STDERR
    return io.TextIOWrapper(to_pipe, encoding=like.encoding, errors=like.errors, line_buffering=to_person)


@contextmanager
def quiet(
    origin: str, say: Callable[[str, str], None] = _to_stderr, *, deep: bool = False, of: str = ""
) -> Iterator[None]:
    """Call a plugin in the body: hold back what it prints, name it while it runs, undo what it leaves behind.

    Args:
        origin: The plugin that runs in the body, with its distribution and version.
        say: Takes the origin and what was printed; by default a notice goes to standard error.
        deep: Whether output that bypasses `print` is held back too: of libraries in C, of
            other processes; and whether the state of the process is looked after. It takes a temporary
            file, so not for every message of a log.
        of: Name of the check that the plugin runs for.

    Raises:
        EscapedError: The plugin raised what is no `Exception`.
        PluginError: It changed the working directory, or closed a standard stream; both are mended.

    >>> notices = []
    >>> with quiet("loud.rule (loud-rules 1.0)", lambda origin, fault: notices.append(fault)):
    ...     print("hello")
    >>> notices
    ["printed 'hello'; plugins speak through findings alone"]
    """
    printed, process = _Printed(), os.getpid()
    diverted: list[str] = []
    words = f"{f'check {of!r}: ' if of else ''}plugin {origin}"
    state = _State() if deep else None
    left = ""
    try:
        # Decimals in a context of its own: what a plugin sets there may not round the next one's numbers.
        with running(words), redirect_stdout(printed), localcontext():
            if deep:
                with _diverted(diverted):
                    yield
            else:
                yield
    except (Exception, EndedError):
        raise
    except BaseException as cause:
        if _is_of_people(cause):
            raise
        raise EscapedError from cause
    finally:  # also where the plugin raised: what it printed may say why
        if os.getpid() != process:
            _end_copy(words)
        if state is not None:
            left = state.restored()
        lines = [line for line in [*printed.getvalue().splitlines(), *diverted] if line.strip()]
        if lines:
            more = f" and {len(lines) - 1} more" if len(lines) > 1 else ""
            first = lines[0].strip()[:80]
            say(origin, f"printed {first!r}{more}; plugins speak through findings alone")
    if left:
        raise PluginError(f"{words} {left}", hint="no score is given with a broken plugin")


class _Printed(io.StringIO):
    """What is printed, also by who closes standard output."""

    def close(self) -> None:
        """Stay open, for what was printed before is still to be read."""


def _end_copy(words: str) -> None:
    """End this process, a copy that a plugin made and that would go on as the program does."""
    with suppress(OSError):
        os.write(_STDERR, f"notice: {words} made a copy of the process, which was ended\n".encode())
    os._exit(_EXIT_OF_COPY)


class _State:
    """What of a process every part of it shares, as it was before a plugin was called."""

    def __init__(self) -> None:
        self.folder, self.error = _folder(), sys.stderr
        self.below = _copy_of(_STDERR)

    def restored(self) -> str:
        """Bring it back; what the plugin had done, as a predicate, else empty."""
        done = ""
        if _folder() != self.folder and self.folder:
            with suppress(OSError):
                os.chdir(self.folder)
            done = "changed the working directory"
        if self.below >= 0:
            if _copy_of(_STDERR, keep=False) < 0:
                done = "closed standard error"
            with suppress(OSError):
                os.dup2(self.below, _STDERR)
                os.close(self.below)
        if self.error is not None and (sys.stderr is None or sys.stderr.closed):
            done = "closed standard error"
            sys.stderr = self.error if not self.error.closed else _opened_again()
        return done


def _opened_again() -> TextIO:
    return os.fdopen(_STDERR, "w", errors="backslashreplace", buffering=1, closefd=False)


def _folder() -> str:
    try:
        return os.getcwd()  # noqa: PTH109  # asked at every call, and a Path costs more
    except OSError:  # it is no more
        return ""


def _copy_of(descriptor: int, *, keep: bool = True) -> int:
    """A copy of a descriptor; -1 where it is closed."""
    try:
        copy = os.dup(descriptor)
    except OSError:
        return -1
    if not keep:
        os.close(copy)
    return copy


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
            with suppress(OSError):  # the plugin closed what is not its own
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
