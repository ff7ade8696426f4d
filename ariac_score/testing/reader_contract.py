"""The contract of readers as checks: what no file may cause, and what a log of their kind must give."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from ariac_score.checks.contracts import LogDescription, Reader, Wanted
from ariac_score.checks.guarded import GuardedDecoder, GuardedReader
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.engine.ask import SMALLEST_LOG_SAMPLES, budget_of
from ariac_score.errors import PluginError, ScoreError
from ariac_score.installed.captured_output import quiet
from ariac_score.logs.logmap import load_log_map
from ariac_score.testing.contract_check import (
    HINT,
    ContractCheck,
    ContractError,
    built_by_name,
    snapshot,
    undocumented,
)
from ariac_score.testing.stopwatch import OutOfTime, Stopwatch
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import Trial
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of

__all__ = ["reader_checks"]

_Answer = TypeVar("_Answer")

_FOREIGN = {
    "empty": b"",
    "empty.txt": b"",
    "words.log": b"nothing of interest\n" * 100,
    "noise.bin": bytes(range(256)) * 64,
    "zeros.db3": bytes(4096),
    "odd.yaml": b"a: [1, 2\n\xff",
    "deep.json": b"[" * 5000,
}
"""Files that no reader is made for: empty, text, noise, and broken ones of common formats."""


def reader_checks(
    reader: Reader, origin: Plugin, log: Path, *, budget_s: float, log_map: str = ""
) -> list[ContractCheck]:
    """Everything the contract of a reader requires; see `contract_checks`."""
    return _CheckedReader(reader, origin, log, budget_s, log_map).checks()


class _CheckedReader:
    """A reader under examination, with a log of its kind."""

    def __init__(self, reader: Reader, plugin: Plugin, log: Path, budget_s: float, log_map: str) -> None:
        self.reader, self.plugin, self.log = reader, plugin, log
        self.budget_s, self.log_map = budget_s, log_map
        self.guarded = GuardedReader(plugin, reader)

    def checks(self) -> list[ContractCheck]:
        """In the order in which one failing explains the next."""
        named = [
            ("docstring_sections", "its docstring has the sections of a help page", self.docstring_sections),
            ("built_by_name", "it is built without parameters", self.built_by_name),
            ("time_budget", "it keeps its budget of processor time", self.time_budget),
            ("prints_nothing", "it prints nothing", self.prints_nothing),
            ("knows_its_own", "it knows a log of its kind, and describes it", self.knows_its_own),
            ("strange_files", "a file of another kind is no error", self.strange_files),
            ("same_log_same_trial", "the same log gives the same trial", self.repeats),
            ("log_unchanged", "it leaves the log as it was", self.log_unchanged),
            ("units_declared", "signals of the vocabulary have its units", self.units_declared),
            ("times_inside", "everything lies inside what was recorded", self.times_inside),
            ("cut_off", "a log that was cut off is read or refused in words", self.cut_off),
        ]
        return [ContractCheck(*each) for each in named]

    def broken(self, what: str) -> ContractError:
        """The error that names the plugin."""
        return ContractError(what, origin=self.plugin.origin, hint=HINT)

    def timed(self, question: Callable[[], _Answer]) -> _Answer:
        """An answer, within the time that the shortest log is allowed."""
        watch = Stopwatch(self.budget_s * SMALLEST_LOG_SAMPLES / 1e6)
        try:
            with watch.running():
                return question()
        except OutOfTime:
            raise self.late(watch.limit_s) from None

    def late(self, limit_s: float) -> ContractError:
        """The error for a reader that is too slow."""
        return self.broken(
            f"ran longer than its budget of {limit_s:g} s of processor time "
            f"({self.budget_s:g} s for a million samples)"
        )

    def wanted(self) -> Wanted:
        """Everything a log could hold."""
        if not self.log_map:
            # A reader whose logs name their signals themselves needs no log map.
            return Wanted(LogMap("none"), frozenset(QUANTITIES))
        log_map, registry = load_log_map(self.log_map), Registry()
        names = sorted({channel.decoder for channel in log_map.channels if channel.decoder})
        plugins = [registry.find("ariac_score.decoders", name) for name in names]
        decoders = {plugin.name: GuardedDecoder(plugin, plugin.build({})) for plugin in plugins}
        return Wanted(log_map, frozenset(QUANTITIES), decoders)

    def read(self, path: Path | None = None) -> Trial:
        """The trial of a log."""
        return self.guarded.read(path or self.log, self.wanted())

    # One for each requirement

    def docstring_sections(self) -> None:
        missing = undocumented(self.plugin, type(self.reader))
        if missing:
            raise self.broken(f"has no section {', '.join(map(repr, missing))} in its docstring")

    def built_by_name(self) -> None:
        problem = built_by_name(type(self.reader))
        if problem:
            raise self.broken(problem)
        try:
            type(self.reader)()
        except (Exception, SystemExit) as cause:
            raise self.broken(f"cannot be built: {type(cause).__name__}: {cause}") from cause

    def time_budget(self) -> None:
        # The number of samples, and so the time allowed, is known only once they are read.
        watch = Stopwatch(self.budget_s * 100)
        try:
            with watch.running():
                trial = self.read()
        except OutOfTime:
            raise self.late(watch.limit_s) from None
        limit_s = budget_of(trial, self.budget_s)
        if watch.taken_s > limit_s:
            raise self.late(limit_s)

    def prints_nothing(self) -> None:
        printed: list[str] = []
        with quiet(self.plugin.origin, lambda _origin, fault: printed.append(fault)):
            self.reader.can_read(self.log)
            self.reader.describe(self.log)
            self.reader.read(self.log, self.wanted())
        if printed:
            raise self.broken(printed[0])

    def knows_its_own(self) -> None:
        if not self.timed(lambda: self.guarded.can_read(self.log)):
            raise self.broken(f"does not know {self.log.name}")
        found: Any = self.guarded.describe(self.log)
        if not isinstance(found, LogDescription):
            raise self.broken(f"describes a log by a {type(found).__name__} instead of a LogDescription")
        if not found.format:
            raise self.broken("does not say what format a log is of")

    def strange_files(self) -> None:
        with _folder() as folder:
            for name, content in _FOREIGN.items():
                (folder / name).write_bytes(content)
            for path in (folder, folder / "nothing", *(folder / name for name in _FOREIGN)):
                answer = self.timed(lambda path=path: self._answer(path))  # type: ignore[misc]
                if not isinstance(answer, bool):
                    raise self.broken(f"answers {answer!r} to can_read, and not True or False")

    def _answer(self, path: Path) -> Any:
        """What `can_read` returns, of whatever type; unguarded, for the guard makes a truth of it."""
        try:
            return self.reader.can_read(path)
        except (Exception, SystemExit) as cause:
            raise self.broken(f"raised {type(cause).__name__} on {path.name}: {cause}") from cause

    def repeats(self) -> None:
        if snapshot(_plain(self.read())) != snapshot(_plain(self.read())):
            raise self.broken("brings another trial when it reads a log again")

    def log_unchanged(self) -> None:
        before = _hashes(self.log)
        self.guarded.describe(self.log)
        self.read()
        if _hashes(self.log) != before:
            raise self.broken("changed the log it read")

    def units_declared(self) -> None:
        for signal in self.read().sampled:
            name = signal.name
            known = QUANTITIES.get(quantity_of(name))
            if not signal.unit:
                raise self.broken(f"brings {name!r} without a unit; 1 is one too")
            if known is not None and signal.unit != known.unit:
                raise self.broken(
                    f"brings {name!r} in {signal.unit!r}; a {quantity_of(name)} is in {known.unit!r}"
                )

    def times_inside(self) -> None:
        trial = self.read()
        times = [event.t_s for event in trial.events] + [s.submitted_s for s in trial.submissions]
        for span in (signal.span for signal in trial.sampled):
            times += [span.start_s, span.end_s] if span else []
        # Orders and official results alone need no recording.
        if trial.recorded is None and trial.sampled:
            raise self.broken("brings signals, but not when the recording began and ended")
        for t_s in times if trial.recorded else ():
            if trial.recorded and not trial.recorded.start_s - 1e-9 <= t_s <= trial.recorded.end_s + 1e-9:
                raise self.broken(f"brings something at {t_s:g} s, outside what was recorded")

    def cut_off(self) -> None:
        if self.log.is_dir():
            return  # nothing says which of its files to cut
        content = self.log.read_bytes()
        # Half of the file, all but a byte, one byte, none: before and after every header a format may have.
        with _folder() as folder:
            for length in (len(content) // 2, len(content) - 1, 1, 0):
                path = folder / self.log.name
                path.write_bytes(content[: max(0, length)])
                self._named(path)

    def _named(self, path: Path) -> None:
        """Read a damaged log: a trial, or an error for the user."""
        try:
            if self.timed(lambda: self.guarded.can_read(path)):
                self.guarded.describe(path)
                self.read(path)
        except PluginError:
            raise  # also a `ScoreError`, but the fault of the reader
        except ScoreError as refusal:
            if not str(refusal):
                raise self.broken("refuses a log without saying why") from refusal


def _plain(trial: Trial) -> list[Any]:
    """The values of a trial; records of a competition are left out, for they have methods and no values."""
    values = {name: value for name, value in vars(trial).items() if name != "records"}
    return [sorted(value) if isinstance(value, frozenset) else value for value in values.values()]


def _hashes(log: Path) -> dict[str, str]:
    files = sorted(log.rglob("*")) if log.is_dir() else [log]
    return {str(f): hashlib.sha256(f.read_bytes()).hexdigest() for f in files if f.is_file()}


@contextmanager
def _folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="ariac-score-") as folder:
        yield Path(folder)
