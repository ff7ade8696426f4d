"""`watch --serve`, `--cell`, `--publish`: a process of its own watches each cell, and this one shows them."""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ariac_score.cli.notes import note
from ariac_score.errors import UsageError
from ariac_score.report.screen.feed import Feed
from ariac_score.report.screen.publish import Publisher
from ariac_score.report.screen.server import Screen
from ariac_score.serving.guard import Guard, listening, names_beyond, read_token

__all__ = ["add_screen", "cells_of", "shows", "watch_and_show"]

_CELL = re.compile(r"(?P<name>[A-Za-z0-9][A-Za-z0-9 _-]{0,39})=(?P<source>.+)")
_ADDRESS = re.compile(r"(?P<host>\[[0-9A-Fa-f:.]+\]|[^\[\]:/]*):(?P<port>[0-9]{1,5})")
_MOST_CELLS = 32
_LOOKS_EVERY_S = 0.2
_KILLED_S = 60.0
"""What is left of a trial is scored in this time when it is stopped."""

Watching = Callable[[str, Feed | None], int]


def add_screen(parser: argparse.ArgumentParser) -> None:
    """Add the options of the screen."""
    parser.add_argument(
        "--cell",
        action="append",
        default=[],
        metavar="NAME=SOURCE",
        help="several cells at once, instead of SOURCE; repeatable",
    )
    parser.add_argument(
        "--serve",
        type=_address,
        metavar="HOST:PORT",
        help="show a screen to browsers, such as 127.0.0.1:8000, and /metrics to Prometheus, until Ctrl-C",
    )
    parser.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="what viewers have to bring; needed where other machines can reach the screen",
    )
    parser.add_argument(
        "--publish",
        type=_address,
        metavar="HOST:PORT",
        help="publish margins and verdicts as topics of a Foxglove server on this machine (127.0.0.1:8765)",
    )
    parser.add_argument(
        "--linger-s",
        type=float,
        metavar="S",
        help="how long the screen stays when all is over (default: until Ctrl-C)",
    )


def _address(text: str) -> tuple[str, int]:
    found = _ADDRESS.fullmatch(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no HOST:PORT, such as 127.0.0.1:8000")
    return found["host"].strip("[]"), int(found["port"])


def shows(arguments: argparse.Namespace) -> bool:
    """Whether anything is shown that needs a process of its own."""
    return bool(arguments.cell or arguments.serve or arguments.publish)


def cells_of(arguments: argparse.Namespace) -> dict[str, str]:
    """The addresses of the cells, by name.

    Raises:
        UsageError: None is given, both ways are used, or a name is used twice.
    """
    if bool(arguments.source) == bool(arguments.cell):
        raise UsageError(
            "give either SOURCE or --cell NAME=SOURCE", hint="ariac-score watch replay:FILE --rules NAME"
        )
    if not arguments.cell:
        if arguments.token_file and not arguments.serve:
            raise UsageError("--token-file is for --serve", hint="add --serve HOST:PORT")
        return {"cell": arguments.source}
    if arguments.output:
        raise UsageError(
            "-o holds one result, and --cell watches several",
            hint="record them (--record FOLDER), and score the recordings",
        )
    found: dict[str, str] = {}
    for given in arguments.cell:
        one = _CELL.fullmatch(given)
        if one is None or one["name"] in found:
            raise UsageError(
                f"--cell {given!r} is no NAME=SOURCE with a name of its own",
                hint="names are letters, digits, spaces, - and _, such as --cell north=foxglove://north:8765",
            )
        found[one["name"]] = one["source"]
    if len(found) > _MOST_CELLS:
        raise UsageError(f"{len(found)} cells are more than {_MOST_CELLS}", hint="use several screens")
    return found


def watch_and_show(arguments: argparse.Namespace, cells: Mapping[str, str], watch: Watching) -> int:
    """Watch each cell in a copy of this process, and show them here; in a copy, the exit code of its cell.

    Raises:
        UsageError: The address cannot be served, or this system cannot copy a process.
    """
    if not hasattr(os, "fork"):
        raise UsageError(
            "--serve, --cell and --publish need a system that can copy a process (Linux, macOS)",
            hint="run it in a container, or watch one cell without them",
        )
    listener = token = None
    if arguments.serve:
        token = read_token(arguments.token_file) if arguments.token_file else ""
        host, port = arguments.serve
        listener = listening(host, port, token)
    ends: dict[str, Connection] = {}
    pids: dict[int, str] = {}
    sys.stdout.flush()
    sys.stderr.flush()
    for name, source in cells.items():
        ours, theirs = Pipe(duplex=False)
        pid = os.fork()
        if pid == 0:
            os.setpgid(0, 0)  # Ctrl-C is for the process that shows, which says it to all
            for end in (ours, *ends.values()):
                end.close()
            if listener is not None:
                listener.close()
            return watch(name, Feed(name, source, theirs.send_bytes))
        theirs.close()
        ends[name], pids[pid] = ours, name
    guard = Guard(token or "", names_beyond(listener) if listener else frozenset())
    shown = _Shown(arguments, pids, ends)
    return asyncio.run(shown.run(listener, guard))


class _Shown:
    """What is shown of cells until they are over."""

    def __init__(
        self, arguments: argparse.Namespace, pids: Mapping[int, str], ends: Mapping[str, Connection]
    ) -> None:
        self._arguments, self._pids, self._ends = arguments, dict(pids), ends
        self._codes: list[int] = []
        self._stopped = asyncio.Event()
        self._server: asyncio.Server | None = None
        self._screen: Screen | None = None
        self._publisher: Publisher | None = None

    async def run(self, listener: Any, guard: Guard) -> int:
        """Show until all is over; the exit code."""
        loop, arguments = asyncio.get_running_loop(), self._arguments
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._stop)
        say = partial(note, arguments)
        try:
            if arguments.publish:
                self._publisher = Publisher(*arguments.publish)
                say(f"topics: ws://{arguments.publish[0]}:{self._publisher.port}")
            if listener is not None:
                port = int(listener.getsockname()[1])
                self._screen = Screen(tuple(self._ends), guard, port, note=say)
                self._server = await self._screen.serve(listener)
                host = arguments.serve[0] or "0.0.0.0"  # noqa: S104  # it was asked for
                with_token = "/?token=…" if guard.token else "/"
                say(f"screen: http://{f'[{host}]' if ':' in host else host}:{port}{with_token}")
            for end in self._ends.values():
                loop.add_reader(end.fileno(), self._take, end)
            await self._all_over()
            if self._server is not None and not self._stopped.is_set():
                say("all is over; the screen stays until Ctrl-C")
                with suppress(TimeoutError):
                    await asyncio.wait_for(self._stopped.wait(), arguments.linger_s)
        finally:
            self._tell(signal.SIGTERM)
            self._let_all_go()
        return max(self._codes, default=0)

    def _let_all_go(self) -> None:
        """Show nothing more: what cells still do does not share a processor with those who look on."""
        if self._server is not None:
            self._server.close()
        if self._screen is not None:
            self._screen.close()
        if self._publisher is not None:
            self._publisher.close()
        self._server = self._screen = self._publisher = None

    async def _all_over(self) -> None:
        """Wait for every cell; those that do not end when they are told to are ended."""
        killed_s: float | None = None
        while self._pids:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid:
                if pid in self._pids:
                    del self._pids[pid]
                    code = os.waitstatus_to_exitcode(status)
                    self._codes.append(code if code >= 0 else 128 - code)  # by a signal, as shells say it
                continue
            if self._stopped.is_set():
                killed_s = killed_s or time.monotonic() + _KILLED_S
                if time.monotonic() > killed_s:
                    self._tell(signal.SIGKILL)
            await asyncio.sleep(_LOOKS_EVERY_S)
        await asyncio.sleep(0)  # what they said last is read

    def _take(self, end: Connection) -> None:
        """Take the latest state of a cell."""
        state = b""
        try:
            state = end.recv_bytes()
            while end.poll():
                state = end.recv_bytes() or state
        except (EOFError, OSError):
            asyncio.get_running_loop().remove_reader(end.fileno())
            end.close()
        if state:
            self._show(state)

    def _show(self, state: bytes) -> None:
        if self._screen is not None:
            self._screen.show(state)
        if self._publisher is not None:
            self._publisher.show(json.loads(state))

    def _stop(self) -> None:
        self._tell(signal.SIGKILL if self._stopped.is_set() else signal.SIGINT)
        self._stopped.set()
        self._let_all_go()

    def _tell(self, number: int) -> None:
        for pid in self._pids:
            with suppress(ProcessLookupError):
                os.kill(pid, number)
