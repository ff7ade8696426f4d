"""Every error the project raises on purpose.

    ScoreError                      something a user can act on; carries a hint and an exit code
    ├── UsageError                  4  the command line names something that does not exist
    ├── DataFileError               4  a YAML or JSON file we read as data is wrong
    │   ├── RuleSetError            4  a rule set
    │   └── LogMapError             4  a log map
    ├── FormulaError                4  a formula cannot be parsed or evaluated
    │   ├── NeedsCohortError        6  it needs a value across teams, and none is given
    │   ├── UnknownFactError        6  it needs a fact that no record of the trial states
    │   └── OtherFactError          6  the trial states a text where a number is declared, or the reverse
    ├── PluginError                 3  a plugin misbehaves
    │   ├── PluginNotFoundError     4  a name that no installed distribution provides
    │   ├── PluginConflictError     4  two distributions provide one name
    │   └── LocalPluginError        4  a rule set names a file of code that is not allowed, or another one
    ├── LogError                    6  a log cannot be read as a trial
    │   ├── NothingToScoreError     5  the path is missing, empty or not a trial log at all
    │   │   └── RunEndedError       5  the official text says that the run crashed or was cancelled
    │   ├── LiveError               5  a system to be watched cannot be reached, or is something else
    │   ├── CutOffError             6  a log ends before its end, as when its recorder was killed
    │   ├── ContradictionError      6  two files state one fact of a trial differently
    │   ├── OtherUnitError          6  a number of an event is in another unit than a check asks for
    │   └── MissingSignalError      6  a check needs a signal that the log does not contain
    ├── ResultError                 6  a stored result is damaged or does not add up
    │   └── NoResultError           5  there is no such file
    └── BatchError                  7  a batch could not be finished; what it has done is kept

The exit codes are those of the command line (see `ariac_score.cli`).
"""

from __future__ import annotations

import copyreg
from collections.abc import Iterable
from difflib import get_close_matches

__all__ = [
    "BatchError",
    "ContradictionError",
    "CutOffError",
    "DataFileError",
    "FormulaError",
    "LiveError",
    "LocalPluginError",
    "LogError",
    "LogMapError",
    "MissingSignalError",
    "NeedsCohortError",
    "NoResultError",
    "NothingToScoreError",
    "OtherFactError",
    "OtherUnitError",
    "PluginConflictError",
    "PluginError",
    "PluginNotFoundError",
    "ResultError",
    "RuleSetError",
    "RunEndedError",
    "ScoreError",
    "UnknownFactError",
    "UsageError",
    "did_you_mean",
]


def did_you_mean(name: str, known: Iterable[str], *, what: str = "known") -> str:
    """Word a remedy for a misspelt name: the nearest known one, or all of them.

    >>> did_you_mean("wieght", ["weight", "round"])
    "did you mean 'weight'?"
    """
    names = sorted(known)
    near = get_close_matches(str(name), names, n=1, cutoff=0.6)  # in YAML, a name may be a number
    if near:
        return f"did you mean {near[0]!r}?"
    shown = ", ".join(names[:12]) + (", …" if len(names) > 12 else "")
    return f"{what}: {shown}" if names else f"nothing is {what}"


class ScoreError(Exception):
    """Something went wrong that a user can act on.

    Args:
        cause: What is wrong, in one lower-case sentence without a full stop.
        file: The file it is about, as the user named it.
        place: Where in that file: a line, a byte offset, a path such as `$.terms.order`.
        hint: What to do about it.
    """

    exit_code = 3

    def __init__(self, cause: str, *, file: object = None, place: str = "", hint: str = "") -> None:
        self.cause = cause
        self.file = None if file is None else str(file)
        self.place = place
        self.hint = hint
        super().__init__(cause, self.file, place, hint)

    def __reduce__(self) -> tuple[object, ...]:
        # The default would call the constructor with `args`, which subclasses do not share.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]

    def __str__(self) -> str:
        where = ": ".join(part for part in (self.file, self.place) if part)
        return f"{where}: {self.cause}" if where else self.cause


class UsageError(ScoreError):
    """The command line names something that does not exist."""

    exit_code = 4


class DataFileError(ScoreError):
    """A YAML or JSON file is malformed or breaks its schema."""

    exit_code = 4


class RuleSetError(DataFileError):
    """A rule set cannot be used as it stands."""


class LogMapError(DataFileError):
    """A log map cannot be used as it stands."""


class FormulaError(ScoreError):
    """A formula cannot be parsed or evaluated; `place` names the term."""

    exit_code = 4


class NeedsCohortError(FormulaError):
    """A formula needs a value across teams (`cohort.…`), and none is given."""

    exit_code = 6


class UnknownFactError(FormulaError):
    """A formula needs a fact, such as an order's priority, that no record of the trial states."""

    exit_code = 6


class OtherFactError(FormulaError):
    """The trial states a fact as a text that is declared as a number, or the reverse: a fault of the log."""

    exit_code = 6


class PluginError(ScoreError):
    """A plugin raised or broke its contract; the message names its distribution and version.

    Args:
        fault: What is wrong; with `origin` a predicate, such as `cannot be imported`.
        origin: The plugin with distribution and version; empty where `fault` names it already.
        file: The file it is about.
        hint: What to do about it.
    """

    def __init__(self, fault: str, *, origin: str = "", file: object = None, hint: str = "") -> None:
        self.origin, self.fault = origin, fault
        super().__init__(f"plugin {origin} {fault}" if origin else fault, file=file, hint=hint)


class PluginNotFoundError(PluginError):
    """A rule set names a plugin that no installed distribution provides."""

    exit_code = 4


class PluginConflictError(PluginError):
    """Two distributions provide one plugin name, so neither may be used."""

    exit_code = 4


class LocalPluginError(PluginError):
    """A rule set names a file of code that the caller does not allow, that is not there, or that changed."""

    exit_code = 4


class LogError(ScoreError):
    """A log exists but cannot be read as one whole trial."""

    exit_code = 6


class CutOffError(LogError):
    """A log ends before its end; what is before is readable, and can be scored where that is asked for."""

    def __init__(self, cause: str, *, file: object = None, place: str = "", hint: str = "") -> None:
        asking = "or ask for an unofficial score of what is there: --partial"
        hint = hint if asking in hint else f"{hint}; {asking}" if hint else asking
        super().__init__(cause, file=file, place=place, hint=hint)


class NothingToScoreError(LogError):
    """The path is missing, empty, or no reader recognises it."""

    exit_code = 5


class LiveError(LogError):
    """A system that is to be watched cannot be reached, or what answers there is something else."""

    exit_code = 5


class RunEndedError(NothingToScoreError):
    """The official text says that the run ended without a score; `outcome` is how."""

    def __init__(
        self, cause: str, *, outcome: str = "", file: object = None, place: str = "", hint: str = ""
    ) -> None:
        self.outcome = outcome
        super().__init__(cause, file=file, place=place, hint=hint)


class ContradictionError(LogError):
    """Two files state one fact of a trial differently.

    Args:
        fact: What they contradict each other about.
        first: A file with whose it is, and what it says.
        second: The other one.
        file: The trial.

    >>> str(ContradictionError("colour", ("'trial.yaml'", "red"), ("'run.mcap'", "blue")))
    "colour: 'trial.yaml' says red, 'run.mcap' says blue"
    """

    def __init__(
        self, fact: str, first: tuple[str, str], second: tuple[str, str], *, file: object = None
    ) -> None:
        self.fact, self.first, self.second = fact, first, second
        super().__init__(
            f"{fact}: {first[0]} says {first[1]}, {second[0]} says {second[1]}",
            file=file,
            hint="leave out the file that belongs to another trial; what the organiser states counts",
        )


class OtherUnitError(LogError):
    """A log states a number of an event in another unit than a check asks for."""


class MissingSignalError(LogError):
    """A check needs a signal that the log does not contain, or contains only as consumed.

    Args:
        name: Of the signal.
        recorded: The signals of the log.
        as_consumed: What the log has in the order in which an official program takes it.
    """

    def __init__(self, name: str, recorded: Iterable[str], as_consumed: Iterable[str] = ()) -> None:
        self.name = name
        self.recorded = sorted(recorded)
        series = sorted(as_consumed)
        if name in series:
            super().__init__(
                f"signal {name!r} is there as consumed only: its stamps may repeat and run back, "
                "so it cannot be used over time",
                hint=f"read it by index, trial.series({name!r}, unit=...), or record it as a signal",
            )
            return
        hint = (
            did_you_mean(name, self.recorded, what="recorded") if self.recorded else "no signal was recorded"
        )
        kept = f"; nothing is derived from what is there as consumed: {', '.join(series)}" if series else ""
        super().__init__(f"signal {name!r} is not in the log{kept}", hint=hint)


class ResultError(ScoreError):
    """A stored result is damaged, or its ledger does not add up to its score."""

    exit_code = 6


class NoResultError(ResultError):
    """There is no file where a stored result, or another document of ours, is looked for."""

    exit_code = 5


class BatchError(ScoreError):
    """A batch could not be finished; what it has done is kept, and a second call goes on.

    Attributes:
        name: Of the wait that was given up, such as `no_workers`; empty where nothing was waited for.
    """

    exit_code = 7
    name = ""

    def named(self, name: str) -> BatchError:
        """The same, of a wait that was given up."""
        self.name = name
        return self

    def __str__(self) -> str:
        return f"{self.name}: {super().__str__()}" if self.name else super().__str__()
