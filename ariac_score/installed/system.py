"""What operating systems offer to keep processes apart, and what is done where one of them does not.

Linux and macOS have all of it, though macOS does not keep a limit of memory. Windows has no alarms, no
limits and no sessions; `shortfalls` says what that costs. Nothing else in this package asks which system
it runs on, or imports a module that some system lacks.
"""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import IO, Any

__all__ = [
    "KILLS",
    "OPEN_FILES",
    "adopt_orphans",
    "await_session",
    "end_after",
    "end_children",
    "end_session",
    "limit_this_process",
    "lock",
    "own_session",
    "read_at",
    "shortfalls",
    "signal_session",
    "write_first",
]


def _offered(module: str) -> ModuleType | None:
    """A module of the standard library that some systems lack."""
    try:
        return importlib.import_module(module)
    except ImportError:
        return None


_fcntl: Any = _offered("fcntl")
_msvcrt: Any = None if _fcntl else _offered("msvcrt")
_resource: Any = _offered("resource")

KILLS = frozenset(
    number
    for name in ("SIGKILL", "SIGTERM", "SIGINT", "SIGHUP", "SIGALRM")
    if (number := getattr(signal, name, None)) is not None
)
"""Signals by which others end a process: the kernel short of memory, a user, a scheduler, its own alarm."""

OPEN_FILES = 1024
"""Files that the process of a run may have open at a time, as is usual on most systems."""

_SUBREAPER = 36
"""`PR_SET_CHILD_SUBREAPER` of Linux, since 3.4."""

_KILL = getattr(signal, "SIGKILL", signal.SIGTERM)
_ENDED_LATE = 124
"""Exit code of a process that ends itself where there are no alarms, as of the program `timeout`."""


def shortfalls() -> tuple[str, ...]:
    """What this system cannot keep of what `batch` promises, in words.

    >>> all(isinstance(one, str) for one in shortfalls())
    True
    """
    found = []
    if _resource is None:
        found.append("no limit of memory or of output: --memory-mb is not kept")
    elif sys.platform == "darwin":
        found.append("no limit of memory: --memory-mb is not kept")
    if _fcntl is None and _msvcrt is None:
        found.append("no locks: nothing keeps two batches from writing into one folder")
    if sys.platform == "darwin":
        found.append(
            "programs that a plugin starts in a session of their own outlive the process that is ended"
        )
    if not hasattr(os, "killpg"):
        found.append("no sessions: programs that a plugin starts outlive the process that is ended")
    return tuple(found)


def lock(file: IO[Any]) -> bool:
    """Lock a file for this process until it is closed, also by `kill -9`; false: another one has it."""
    try:
        if _fcntl is not None:
            _fcntl.flock(file, _fcntl.LOCK_EX | _fcntl.LOCK_NB)
        elif _msvcrt is not None:
            _msvcrt.locking(file.fileno(), _msvcrt.LK_NBLCK, 1)
    except OSError:
        return False
    return True


def read_at(file: IO[bytes], room: memoryview, offset: int) -> int:
    """Bytes from anywhere in an open file, whichever threads read it too; returns how many came."""
    if hasattr(os, "preadv"):
        return os.preadv(file.fileno(), [room], offset)
    with open(file.name, "rb", buffering=0) as own:  # noqa: PTH123  # its own position
        own.seek(offset)
        return own.readinto(room) or 0


def write_first(file: int, contents: bytes) -> None:
    """Write from the beginning of an open file, in one piece where the system can."""
    if hasattr(os, "pwrite"):
        os.pwrite(file, contents, 0)
        return
    os.lseek(file, 0, os.SEEK_SET)
    os.write(file, contents)


def limit_this_process(memory_bytes: int, file_bytes: int) -> None:
    """Bind this process and what it starts to limits that nothing of it can lift, `OPEN_FILES` as well.

    Args:
        memory_bytes: Most address space, because Linux does not enforce a limit of resident memory; 0: any.
        file_bytes: Longest file that it may write; 0: any.
    """
    if _resource is None:
        return
    # The dumps of a season's crashes would fill the disk.
    bounds = {_resource.RLIMIT_CORE: 0, _resource.RLIMIT_NOFILE: OPEN_FILES}
    if file_bytes:
        bounds[_resource.RLIMIT_FSIZE] = file_bytes
    if memory_bytes:
        bounds[_resource.RLIMIT_AS] = memory_bytes
    for kind, bound in bounds.items():
        _, hard = _resource.getrlimit(kind)
        most = bound if hard == _resource.RLIM_INFINITY else min(bound, hard)
        with suppress(ValueError, OSError):
            _resource.setrlimit(kind, (most, most))


def end_after(seconds: float) -> None:
    """End this process after so long, whatever it does then, for nobody else may be there to do it."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)
        return
    # Python code alone cannot keep this thread from running; a library in C that never returns can.
    watch = threading.Timer(seconds, os._exit, (_ENDED_LATE,))
    watch.daemon = True
    watch.start()


def own_session() -> None:
    """Take this process out of the session of whoever started it, so that what it starts can be found."""
    if hasattr(os, "setsid"):
        with suppress(OSError):  # it leads one already
            os.setsid()


def adopt_orphans() -> None:
    """Have this process inherit, on Linux, what processes below it leave behind, also in other sessions."""
    if sys.platform == "linux":
        with suppress(ImportError, OSError, AttributeError):
            importlib.import_module("ctypes").CDLL(None).prctl(_SUBREAPER, 1, 0, 0, 0)


def end_children(adopter: int | None, ended: int | None, keep: Collection[int], patience_s: float) -> None:
    """End what a process has left behind that has ended itself.

    Args:
        adopter: Process that called `adopt_orphans` above it; `None` where there is none.
        ended: Process that has ended, and had a session of its own.
        keep: Children of the adopter that go on.
        patience_s: How long to go on with children that make new ones, s.
    """
    if ended is not None and hasattr(os, "killpg"):
        with suppress(OSError):  # nothing is left of it
            os.killpg(ended, _KILL)
    until = time.monotonic() + patience_s
    while adopter is not None and time.monotonic() < until:
        left = _children(adopter) - set(keep)
        if not left:
            return
        for (
            process
        ) in left:  # children of theirs become children of the adopter, and are met in the next turn
            with suppress(OSError):
                os.kill(process, _KILL)
        time.sleep(0.001)


def _children(parent: int) -> set[int]:
    """The children of a process that have not ended, where the system has a list of processes."""
    try:
        listed = Path(f"/proc/{parent}/task/{parent}/children").read_text(encoding="ascii").split()
    except OSError:
        listed = [status.parent.name for status in Path("/proc").glob("[0-9]*/stat")]
    return {int(one) for one in listed if _is_child(Path("/proc", one, "stat"), parent)}


def _is_child(status: Path, parent: int) -> bool:
    try:
        state, its_parent, *_ = status.read_text(errors="replace").rpartition(")")[2].split()
    except (OSError, ValueError):
        return False
    return its_parent == str(parent) and state not in ("Z", "X")


def signal_session(process: subprocess.Popen[Any], how: int) -> None:
    """Send a signal to a process that has a session of its own, and to what it has started there."""
    with suppress(OSError):  # all have ended
        if hasattr(os, "killpg"):
            os.killpg(process.pid, how)
        elif process.poll() is None:
            process.kill() if how == _KILL else process.send_signal(how)


def await_session(process: subprocess.Popen[Any], patience_s: float) -> bool:
    """Wait until a process and all that it started in its session have ended; whether they have.

    A program that starts another one may end before it: `rosbag record` waits a quarter of a second for
    the program that writes the bag, and that one may need longer to close it.

    Args:
        process: It has a session of its own.
        patience_s: How long to wait, s.
    """
    until = time.monotonic() + patience_s
    while process.poll() is None or _runs_in(process.pid):
        if time.monotonic() > until:
            return False
        time.sleep(0.02)
    return True


def _runs_in(group: int) -> bool:
    """Whether anything runs in a group of processes; what has ended may wait for ever to be collected."""
    try:
        if not hasattr(os, "killpg"):
            return False
        os.killpg(group, 0)
    except OSError:
        return False
    states = [_state_in(status, group) for status in Path("/proc").glob("[0-9]*/stat")]
    return not states or any(state not in ("", "Z", "X") for state in states)


def _state_in(status: Path, group: int) -> str:
    """The state of a process of a group; empty: it is of another one, or gone."""
    try:
        # The name before may hold blanks and brackets.
        state, _, its_group, *_ = status.read_text(errors="replace").rpartition(")")[2].split()
    except (OSError, ValueError):
        return ""
    return state if its_group == str(group) else ""


def end_session(process: subprocess.Popen[Any], patience_s: float) -> None:
    """End a process, and what it has started as far as that stayed in its session.

    Args:
        process: It has a session of its own.
        patience_s: How long to wait until it is gone, s.

    Raises:
        subprocess.TimeoutExpired: It is not gone by then.
    """
    signal_session(process, _KILL)
    if process.poll() is None:
        process.kill()
        process.wait(patience_s)
