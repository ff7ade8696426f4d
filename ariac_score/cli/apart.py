"""A command run in a process of its own, so that a plugin that hangs or kills it can be named."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any

from ariac_score.cli.notes import APART, is_apart
from ariac_score.errors import PluginError, ScoreError
from ariac_score.installed.captured_output import keep_results_apart
from ariac_score.installed.running import listen_for_interrupts, note_in, noted
from ariac_score.installed.system import end_session

__all__ = ["begin", "is_apart", "run_apart"]

_LOOKS_EVERY_S = 0.1
_KILLED_S = 10.0
# Not `python -m`, which would look for modules in the working directory first.
_START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from ariac_score.cli.apart import begin; begin(sys.argv[2], json.loads(sys.argv[3]))"
)


def run_apart(given: Sequence[str], *, limit_s: float) -> int:
    """Run a command in a process of its own; its exit code.

    Args:
        given: The command line.
        limit_s: How long one call of a plugin may last, and what is between two of them, s. Not the
            whole: a machine that is busy is no fault of whichever plugin runs at its end.

    Raises:
        PluginError: It did not end in time, or its process died, in a plugin.
        ScoreError: The same, in none.
    """
    with tempfile.TemporaryDirectory(prefix="ariac-score-") as folder, ExitStack() as stack:
        note, done = Path(folder) / "running", Path(folder) / "done"
        out, err = (stack.enter_context(_passed_on(stream)) for stream in (sys.stdout, sys.stderr))
        process = subprocess.Popen(  # noqa: S603  # this program, with the command line it was given
            [sys.executable, "-c", _START, json.dumps(sys.path), folder, json.dumps(list(given))],
            stdout=out,
            stderr=err,
            env={**os.environ, APART: "1"},
            start_new_session=True,  # so that what a plugin starts ends with it
        )
        try:
            in_time = _waited(process, note, limit_s)
        finally:
            end_session(process, _KILLED_S)
        _, plugin = noted(note)
        if done.is_file():  # whatever it did afterwards
            return int(done.read_text(encoding="ascii"))
        late = f"did not end within {limit_s:g} s"
        raise _failed(plugin, _ending(process.returncode) if in_time else late)


def _waited(process: subprocess.Popen[Any], note: Path, limit_s: float) -> bool:
    """Whether a process ended in time; returns when it did, or did not."""
    changed_s = time.monotonic()
    last = 0
    while True:
        try:
            process.wait(_LOOKS_EVERY_S)
        except subprocess.TimeoutExpired:
            now_s = time.monotonic()
            count, _ = noted(note)
            if count != last:
                last, changed_s = count, now_s
            if now_s - changed_s > limit_s:
                return False
        else:
            return True


def _ending(code: int) -> str:
    """How a process ended that was not done, as a predicate of its plugin."""
    if code >= 0:
        return f"ended the process it ran in, with exit code {code}"
    return f"ended the process it ran in, by signal {-code} ({signal.Signals(-code).name})"


def _failed(plugin: str, how: str) -> ScoreError:
    if plugin:
        return PluginError(
            f"{plugin} {how}",
            hint="no score is given with such a plugin; report it to its authors, or raise the time limit "
            "if it is slow for a reason",
        )
    return ScoreError(f"the command {how}, in no plugin", hint="raise the time limit, or report it")


@contextmanager
def _passed_on(stream: IO[str]) -> Iterator[Any]:
    """What another process can write to in place of a stream; of one without a descriptor, a copy is made."""
    try:
        stream.fileno()
    except (OSError, ValueError):  # somebody has taken its place, as tests do
        with tempfile.TemporaryFile("w+", encoding="utf-8") as copied:
            try:
                yield copied
            finally:
                copied.seek(0)
                shutil.copyfileobj(copied, stream)
    else:
        stream.flush()
        yield stream


def begin(folder: str, given: Sequence[str]) -> None:
    """What the process of its own does: run the command, noting which plugin runs."""
    from ariac_score.cli import main  # noqa: PLC0415  # which imports this module for some commands

    results = keep_results_apart()
    listen_for_interrupts()
    note_in(Path(folder) / "running")
    code = main(given)
    sys.stdout = sys.__stdout__
    if results is not None:
        results.close()
    (Path(folder) / "done").write_text(str(code), encoding="ascii")
    sys.exit(code)
