"""Writing the output of a command: complete files or none, and a progress bar on a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from shutil import copyfileobj
from tempfile import NamedTemporaryFile
from typing import IO

from ariac_score.errors import UsageError
from ariac_score.terminal.style import plain

__all__ = [
    "counting_bar",
    "progress_bar",
    "refuse_inputs",
    "write",
    "write_bytes",
    "write_copy",
    "write_output",
]


def write(text: str, file: str | PathLike[str] | None) -> None:
    """Print the text, or write it to a file that is either complete or absent.

    A link keeps pointing where it did; a device or pipe is written to, not replaced. The file `-` is stdout.

    Raises:
        UsageError: The file cannot be written.
    """
    if file is None or str(file) == "-":
        sys.stdout.write(text)
        sys.stdout.flush()
    else:
        try:
            path = Path(file)
        except TypeError:
            words = f"a path is wanted, and a {type(file).__name__} is given"
            raise UsageError(words, hint="give the path as text or as a Path") from None
        write_bytes(text.encode("utf-8"), path)


write_output = write
"""The name by which commands of plugins know it."""


def write_bytes(content: bytes, file: Path) -> None:
    """Write bytes to a file that is either complete or absent; see `write`.

    Raises:
        UsageError: The file cannot be written.
    """
    _put(lambda out: out.write(content), file)


def write_copy(source: Path, file: Path) -> None:
    """Write the content of one file to another that is either complete or absent; see `write`.

    Raises:
        UsageError: The file cannot be written.
    """
    with source.open("rb") as content:
        _put(lambda out: copyfileobj(content, out), file)


def _put(fill: Callable[[IO[bytes]], object], file: Path) -> None:
    try:
        target = file.resolve()
        if target.exists() and not target.is_file():
            with target.open("wb") as out:  # a device or pipe
                fill(out)
        else:
            _replace(target, fill)
    except (OSError, RuntimeError) as cause:
        reason = getattr(cause, "strerror", None) or str(cause)
        raise UsageError(
            f"cannot be written: {reason}", file=file, hint="check that the folder exists and has room"
        ) from cause


def _replace(target: Path, fill: Callable[[IO[bytes]], object]) -> None:
    temporary = ""
    try:
        with NamedTemporaryFile(dir=target.parent, prefix=".part-", delete=False) as out:
            temporary = out.name
            fill(out)
        mask = os.umask(0)  # it can only be read by setting it
        os.umask(mask)
        Path(temporary).chmod(0o666 & ~mask)  # a temporary file is private, a result is not
        Path(temporary).replace(target)
    except OSError:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise


def refuse_inputs(output: Path | None, source: Path) -> None:
    """Refuse to write a result over its own input; a new file in the folder of a bundle is fine.

    Raises:
        UsageError: The output is the input, or a file of the folder that is the input.
    """
    if output is None:
        return
    target, origin = output.resolve(), source.resolve()
    within = target.is_file() and origin in target.parents
    if target == origin or within:
        raise UsageError(
            "the result would overwrite its own input" if not within else "it is in the folder that is read",
            file=output,
            hint="write it to another file" + (", or delete this one first" if within else ""),
        )


LONG_LOG_BYTES = 4_000_000
"""A smaller log is read in less than a second, and needs no bar."""


def _bytes_below(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


@contextmanager
def progress_bar(path: Path, *, quiet: bool = False) -> Iterator[Callable[[float], None]]:
    """A bar on stderr for a long log, on a terminal only, and gone when done."""
    if quiet or not sys.stderr.isatty() or _bytes_below(path) < LONG_LOG_BYTES:
        yield lambda _done: None
        return
    # Imported here: rich takes longer to import than most trials to score.
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import Progress  # noqa: PLC0415

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f"reading {plain(path.name)}", total=1.0)
        yield lambda done: progress.update(task, completed=done)


@contextmanager
def counting_bar(what: str, total: int, *, quiet: bool = False) -> Iterator[Callable[[int, str], None]]:
    """A bar on stderr that counts, on a terminal only, and gone when done."""
    if quiet or not sys.stderr.isatty() or total < 2:
        yield lambda _done, _now: None
        return
    # Imported here: rich takes longer to import than most trials to score.
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import Progress  # noqa: PLC0415

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done, now: progress.update(task, completed=done, description=f"{what} {plain(now)}")
