"""A monitor that misbehaves when the id of a trial asks for it: `t_00013.hangs` hangs.

`season.py` makes a distribution of this file for the time of a season, so that the processes of runs
meet it as they would meet any plugin with a fault in it.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from threading import Event, Thread
from types import MappingProxyType

import numpy as np

from ariac_score import Finding, SignalNeed, Trial

__all__ = ["WAYS", "Trouble"]

_PIECE = 1 << 24
"""Large, so that a limit of memory is met long before one of time, however busy the machine is."""


def _hangs() -> str:
    Event().wait()
    return ""


def _spins() -> str:
    while True:
        pass


def _stops() -> str:
    while True:
        os.kill(os.getpid(), signal.SIGSTOP)


def _gorges() -> str:
    return str(len(bytearray(1 << 50)))


def _nibbles() -> str:
    held = []
    while True:
        held.append(np.empty(_PIECE, np.uint8))  # asked for, and not written to: that takes long


def _prints() -> str:
    while True:
        print("x" * _PIECE)


def _rambles() -> str:
    return "and so on " * (1 << 18)


def _aborts() -> str:
    os.abort()


def _segfaults() -> str:
    return str(ctypes.string_at(0))


def _kills() -> str:
    os.kill(os.getpid(), signal.SIGKILL)
    return ""


def _leaves() -> str:
    os._exit(0)


def _raises() -> str:
    raise RuntimeError("no idea what to do")


def _forks() -> str:
    for _ in range(8):
        if os.fork() == 0:
            return "a copy"
    return "there were copies"


def _begets() -> str:
    """Children that would outlive it: one of its own kind, one in a session of its own, a program."""
    if os.fork() == 0:
        Event().wait()
    if os.fork() == 0:
        os.setsid()
        Event().wait()
    subprocess.Popen([sys.executable, "-c", "import time; time.sleep(100_000)"], start_new_session=True)
    return "children are left"


def _begets_and_hangs() -> str:
    _begets()
    return _hangs()


def _overwrites() -> str:
    """What lies behind a buffer is written over, as by a library with a fault in it."""
    ctypes.memset(ctypes.create_string_buffer(16), 0x41, 1 << 30)
    return "overwritten"


def _opens() -> str:
    held = []
    while True:
        held.append(os.open(os.devnull, os.O_RDONLY))


def _starts_threads() -> str:
    while True:
        Thread(target=Event().wait, daemon=True).start()


def _exits() -> str:
    raise SystemExit(0)


def _interrupts() -> str:
    raise KeyboardInterrupt


def _recurses() -> str:
    return _recurses() + "."


def _closes() -> str:
    os.closerange(0, 1024)
    return "all files are closed"


def _moves() -> str:
    os.chdir("/")
    return "elsewhere"


def _fills() -> str:
    with TemporaryFile() as out:
        while True:
            out.write(bytes(_PIECE))


def _threads() -> str:
    for _ in range(2):
        Thread(target=Event().wait, daemon=True).start()
    return "threads are left"


def _grows() -> str:
    """The log grows while it is scored."""
    return _rewritten(lambda text: text + "\n")


def _shrinks() -> str:
    return _rewritten(lambda text: text[: len(text) // 2], back=True)


def _vanishes() -> str:
    return _rewritten(lambda _text: "", back=True, gone=True)


def _swaps() -> str:
    return _rewritten(lambda text: text.replace("1", "2"), back=True)


def _rewritten(change: Callable[[str], str], *, back: bool = False, gone: bool = False) -> str:
    number = int(_NOW[0].partition(".")[0].removeprefix("t_"))
    log = Path(os.environ["SEASON_RUNS"], f"t_{number:05d}", "log.jsonl")
    text = log.read_text(encoding="utf-8")
    if gone:
        log.unlink()
    log.write_text(change(text), encoding="utf-8")
    if back:  # so that every attempt finds the same
        log.write_text(text, encoding="utf-8")
    return "another file"


_NOW = [""]

WAYS: MappingProxyType[str, Callable[[], str]] = MappingProxyType(
    {
        "hangs": _hangs,
        "spins": _spins,
        "stops": _stops,
        "gorges": _gorges,
        "nibbles": _nibbles,
        "prints": _prints,
        "rambles": _rambles,
        "aborts": _aborts,
        "segfaults": _segfaults,
        "kills": _kills,
        "leaves": _leaves,
        "raises": _raises,
        "forks": _forks,
        "begets": _begets,
        "begets-and-hangs": _begets_and_hangs,
        "overwrites": _overwrites,
        "opens": _opens,
        "starts-threads": _starts_threads,
        "exits": _exits,
        "interrupts": _interrupts,
        "recurses": _recurses,
        "closes": _closes,
        "moves": _moves,
        "fills": _fills,
        "threads": _threads,
        "grows": _grows,
        "shrinks": _shrinks,
        "vanishes": _vanishes,
        "swaps": _swaps,
    }
)


@dataclass(frozen=True)
class Trouble:
    """The trial does not ask for trouble.

    Measures:
        What its id says after the last dot.
    Violated when:
        Never: it has a fault, or none.
    Source:
        A season that goes wrong.
    """

    def needs(self) -> Iterator[SignalNeed]:
        """Nothing that a log could lack."""
        yield from ()

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """The fault that the id names, or nothing of the kind."""
        _NOW[0] = trial.id
        fault = WAYS.get(trial.id.rpartition(".")[2], lambda: "nothing of the kind")
        yield Finding.satisfied("trial", fault())
