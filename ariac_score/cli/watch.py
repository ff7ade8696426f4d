"""`ariac-score watch SOURCE --rules NAME`: judge a running cell, record what is seen, and score it."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import is_quiet, note
from ariac_score.cli.outcome import add_output, exit_code_of, failed_criteria, show
from ariac_score.cli.trial_config import add_trial_config
from ariac_score.cli.watch_screen import add_screen, cells_of, shows, watch_and_show
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.errors import ScoreError
from ariac_score.live.running import Running, status_text
from ariac_score.live.source import LiveSource, source_at
from ariac_score.live.watch import Settings, Watch
from ariac_score.report.screen.feed import Feed
from ariac_score.terminal.output import refuse_inputs
from ariac_score.terminal.style import plain

_LINE_EVERY_S = 10.0
_COLUMNS = 160


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "watch",
        description="Watch a running cell: judge it while it runs, record what is seen, and score it in the "
        "end (Ctrl-C, end of the competition, or the source gone). 'score' says the same of the recording.",
        epilog="Exit codes: those of 'score' (0 scored, 1 a criterion failed, 6 undecided or unusable); "
        "5 nothing answers at the source, or nothing came; 4 a wrong address or rule set.",
    )
    parser.add_argument(
        "source",
        metavar="SOURCE",
        nargs="?",
        default="",
        help="address of the cell (SCHEME://HOST:PORT), a recording that is being written, or "
        "replay:FILE?speed=2; 'plugins list' shows the installed sources",
    )
    parser.add_argument(
        "--rules", required=True, metavar="NAME", help="rule set: a name ('rules list') or a .yaml file"
    )
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    add_trial_config(parser)
    add_local_plugins(parser)
    parser.add_argument(
        "--record",
        type=Path,
        metavar="FILE.mcap",
        help="new file for what is seen, else nothing is kept; with --cell a folder, for a file of each",
    )
    parser.add_argument(
        "--patience-s",
        type=_seconds,
        default=Settings().patience_s,
        metavar="S",
        help="how long the source may be gone before the trial is over (default: %(default)g)",
    )
    add_screen(parser)
    add_output(parser)
    parser.set_defaults(run=run)


def _seconds(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 <= seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds")
    return seconds


def run(arguments: argparse.Namespace) -> int:
    """Watch until the end, then show the result; the exit code is 0 if there is a score."""
    for given in arguments.trial_config:
        refuse_inputs(arguments.output, given)
    cells = cells_of(arguments)
    registry = registry_of(arguments)
    prepared = prepare(arguments.rules, log_map=arguments.log_map, registry=registry)
    sources = {name: source_at(address, registry) for name, address in cells.items()}

    def watch(name: str, feed: Feed | None) -> int:
        return _watch(arguments, name if arguments.cell else "", sources[name], prepared, feed)

    if not shows(arguments):
        (name,) = cells
        return watch(name, None)
    return watch_and_show(arguments, cells, watch)


def _watch(
    arguments: argparse.Namespace, name: str, source: LiveSource, prepared: Prepared, feed: Feed | None
) -> int:
    """Watch one cell; a name where there are several."""
    if not source.sees_losses:
        note(
            arguments,
            "this source cannot see every loss: silence of a topic does not show that nothing was sent",
        )
    with _record_of(arguments, name) as record:
        line = _Line(name, quiet=is_quiet(arguments))

        def told(running: Running) -> None:
            line.show(running)
            if feed is not None:
                feed.show(running)

        settings = Settings(patience_s=arguments.patience_s)
        watch = Watch(source, prepared, record, also=arguments.trial_config, settings=settings, told=told)
        if feed is not None:
            feed.gone = lambda: watch.stop("whoever shows it is gone")
        with stopped_by_signals(watch):
            try:
                result = watch.run()
            except ScoreError as error:
                if not arguments.record:
                    error.file = source.address  # nobody knows the file that is gone afterwards
                elif record.is_file():
                    error.hint = f"{error.hint}; what was seen is in {record}"
                raise
            finally:
                line.end()
                if feed is not None:
                    feed.end()
            of = f"{name}: " if name else ""
            note(arguments, f"{of}ended: {watch.state.ended}")
            if arguments.record:
                note(arguments, f"{of}recorded: {record}")
            if name:
                note(arguments, f"{of}{status_text(watch.state)}")
                return exit_code_of(result, failed_criteria(result, arguments.fail_on))
            return show(result, arguments)


@contextmanager
def _record_of(arguments: argparse.Namespace, name: str) -> Iterator[Path]:
    """Where to record: the file that was asked for, or one that is gone afterwards."""
    if arguments.record:
        if name:
            arguments.record.mkdir(parents=True, exist_ok=True)
        yield arguments.record / f"{name}.mcap" if name else arguments.record
        return
    note(arguments, "what is seen is not kept: give --record FILE.mcap to score or to show it again")
    with TemporaryDirectory() as folder:
        yield Path(folder, "seen.mcap")


@contextmanager
def stopped_by_signals(watch: Watch) -> Iterator[None]:
    """Let Ctrl-C, and what ends a container, end the trial; a second one ends the program.

    The first may come when the trial has ended by itself: then its result is on its way, and still comes.
    """
    asked = False

    def stop(number: int, _frame: object) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True
        watch.stop("it was interrupted" if number == signal.SIGINT else "it was terminated")

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Line:
    """The state on standard error: a line that is rewritten on a terminal, elsewhere one now and then."""

    def __init__(self, name: str, *, quiet: bool) -> None:
        self._of = f"{name}: " if name else ""
        self._quiet, self._rewrites = quiet, sys.stderr.isatty() and not name
        self._notes, self._said_s, self._width = 0, -math.inf, 0

    def show(self, running: Running) -> None:
        """Show a state, and what is new in its notes."""
        if self._quiet:
            return
        for one in running.notes[self._notes :]:
            self._put(f"{one.at_s:.1f} s: {one.text}", stays=True)
        self._notes = len(running.notes)
        now_s = time.monotonic()
        if self._rewrites:
            self._put(status_text(running))
        elif now_s - self._said_s >= _LINE_EVERY_S:
            self._said_s = now_s
            self._put(status_text(running), stays=True)

    def end(self) -> None:
        """Leave the last state standing."""
        if self._rewrites and self._width:
            print(file=sys.stderr)
            self._width = 0

    def _put(self, text: str, *, stays: bool = False) -> None:
        line = plain(f"{self._of}{text}")
        if not self._rewrites:
            print(line, file=sys.stderr, flush=True)
            return
        shown = line if stays or len(line) <= _COLUMNS else f"{line[: _COLUMNS - 1]}…"
        print(f"\r{shown.ljust(self._width)}", end="\n" if stays else "", file=sys.stderr, flush=True)
        self._width = 0 if stays else len(shown)
