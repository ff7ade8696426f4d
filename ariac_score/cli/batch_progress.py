"""What `ariac-score batch` shows while it works: outcomes, what each running run does, what is waited for."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.text import Text

from ariac_score.batch.state import RunUnderWay, State, Waiting
from ariac_score.batch.tasks import TaskKey
from ariac_score.cli.notes import is_quiet, note
from ariac_score.terminal.style import plain

__all__ = ["outcomes_text", "progress_of"]

_EVERY_S = 60.0
"""Between two lines about one wait, or one run, where there is no terminal."""
_MOST_SHOWN = 4
"""Running runs that a terminal has a line for."""
_LONGEST = 100


@dataclass
class BatchProgress:
    """Shows what a batch does.

    Attributes:
        arguments: Of the command.
        bar: On a terminal.
    """

    arguments: argparse.Namespace
    bar: _Bar | None = None
    _told_s: dict[str, float] = field(default_factory=dict)

    def on_outcome(self, key: TaskKey, outcome: str, reason: str) -> None:
        """Count a run, or write a line about it."""
        if self.bar is not None:
            self.bar.count(outcome)
        else:
            note(self.arguments, f"{_name(key)}: {_words(outcome)}{': ' + reason if reason else ''}")

    def on_state(self, state: State) -> None:
        """Show what is under way and what is waited for: at once on a terminal, else each minute."""
        lines = [waiting_text(state.waiting)] if state.waiting else []
        if self.bar is not None:
            self.bar.show([*lines, *map(run_text, state.running[:_MOST_SHOWN])])
            return
        waiting = state.waiting
        if waiting is None:
            self._told_s = {name: told for name, told in self._told_s.items() if "/" in name}
        elif self._is_due(waiting.name, waiting.waited_s):
            note(self.arguments, lines[0])
        for run in state.running:
            if run.for_s >= _EVERY_S and self._is_due(f"/{run.key}", run.for_s):
                note(self.arguments, run_text(run))

    def _is_due(self, name: str, seconds: float) -> bool:
        told_s = self._told_s.get(name, -_EVERY_S)
        if 0.0 <= seconds - told_s < _EVERY_S:
            return False
        self._told_s[name] = seconds
        return True


class _Bar:
    """A bar with counts of outcomes, and lines below it."""

    def __init__(self, live: Live, total: int) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
        self._live, self._counts = live, Counter[str]()
        self._progress = Progress(*columns)
        self._task = self._progress.add_task("scoring", total=total)
        self.show([])

    def count(self, outcome: str) -> None:
        self._counts[outcome] += 1
        self._progress.update(self._task, advance=1, description=outcomes_text(self._counts))

    def show(self, lines: list[str]) -> None:
        self._live.update(Group(self._progress, *(Text(line, "dim", no_wrap=True) for line in lines)))


@contextmanager
def progress_of(arguments: argparse.Namespace, total: int) -> Iterator[BatchProgress]:
    """A bar on a terminal; else one line for each run, and one a minute for what takes long."""
    if is_quiet(arguments) or not sys.stderr.isatty():
        yield BatchProgress(arguments)
        return
    with Live(console=Console(stderr=True), transient=True) as live:
        yield BatchProgress(arguments, _Bar(live, total))


def waiting_text(waiting: Waiting) -> str:
    """A wait in words.

    >>> waiting_text(Waiting("no_workers", "tcp://here:1", 65.0, 300.0))
    'waiting: no_workers at tcp://here:1 for 65 s; given up after 300 s'
    """
    times = f"for {waiting.waited_s:.0f} s; given up after {waiting.most_s:g} s"
    return f"waiting: {waiting.name} at {plain(waiting.place)} {times}"


def run_text(run: RunUnderWay) -> str:
    """What a run does, in words.

    >>> run_text(RunUnderWay(("aurora", "kitting", 2), 61.2, "hashing"))
    'aurora/kitting_2: for 61 s, hashing'
    """
    return plain(f"{_name(run.key)}: for {run.for_s:.0f} s, {run.doing}")[:_LONGEST]


def _name(key: TaskKey) -> str:
    team, trial, number = key
    return f"{team}/{trial}_{number}" if team else trial


def _words(outcome: str) -> str:
    return outcome.replace("_", " ")


def outcomes_text(counts: Mapping[str, int]) -> str:
    """Counts of outcomes, the largest first."""
    ordered = sorted(counts.items(), key=lambda pair: (-pair[1], pair[0]))
    return ", ".join(f"{number} {_words(outcome)}" for outcome, number in ordered)
