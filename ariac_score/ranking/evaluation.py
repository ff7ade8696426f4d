"""The organisers' own evaluation of a competition, as their program would give it.

Such a program reads the folders of all teams in its own way, quirks included. A plugin reproduces it. Its
numbers are shown with the ranking and never enter it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from ariac_score.checks.contracts import Wanted
from ariac_score.checks.guarded import broken, open_readers
from ariac_score.checks.registry import Registry
from ariac_score.errors import LogError
from ariac_score.ranking.competition import Competition, TrialPlan
from ariac_score.trial.channels import LogMap
from ariac_score.trial.work import number_of_fact

__all__ = [
    "GROUP",
    "Entry",
    "Evaluation",
    "EvaluationProgram",
    "PlannedItem",
    "Stop",
    "evaluation_program",
    "strict_evaluation",
]

GROUP = "ariac_score.evaluations"


@dataclass(frozen=True)
class PlannedItem:
    """An outermost item of work in the trial file.

    Attributes:
        id: As in the file.
        priority: Whether it goes before others.
    """

    id: str
    priority: bool


@dataclass(frozen=True, order=True)
class Stop:
    """Where the program would have stopped with an exception.

    Attributes:
        trial: Trial.
        team: Team.
        run: Folder of the run; empty for the team as a whole.
        exception: Class of the exception.
        cause: In words.
    """

    trial: str
    team: str
    run: str
    exception: str
    cause: str


@dataclass(frozen=True)
class Entry:
    """The numbers that the program gives one team in one trial.

    Attributes:
        run: Folder of the best run; empty when there is none.
        raw: Integer sum of its task scores.
        scores: By item; `None` where it was not submitted.
        durations_s: By item, s.
        cost: What the team paid for its equipment, dollars.
        score: Trial score.
        remarks: Quirks that moved a number.
    """

    run: str
    raw: int
    scores: Mapping[str, int | None]
    durations_s: Mapping[str, float | None]
    cost: int
    score: float = 0
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Evaluation:
    """The whole evaluation.

    Attributes:
        trials: By trial (sorted by name) the entry of each team; teams that stopped the program are missing.
        work: The outermost items of each trial.
        leaderboard: Team and sum, best first; equal ones in the order of the teams.
        stops: Where the program would have stopped.
    """

    trials: Mapping[str, Mapping[str, Entry]]
    work: Mapping[str, Sequence[PlannedItem]]
    leaderboard: tuple[tuple[str, float], ...]
    stops: tuple[Stop, ...]


@runtime_checkable
class EvaluationProgram(Protocol):
    """An evaluation of the organisers, reproduced: entry-point group `ariac_score.evaluations`.

    Rule sets name it in `ranking: {strict: NAME}`.
    """

    def evaluate(self, logs: Path, work: Mapping[str, Sequence[PlannedItem]]) -> Evaluation:
        """Evaluate as the organisers' program does.

        Args:
            logs: The folder with a folder for each team, which holds one for each run.
            work: The outermost items of each trial that has a configuration, in the order of that file.
        """
        ...

    def results_csv(self, evaluation: Evaluation) -> str:
        """The table that the organisers' program writes."""
        ...


def evaluation_program(name: str, registry: Registry | None = None) -> EvaluationProgram:
    """The evaluation program of that name.

    Raises:
        PluginError: None is installed, two are, or what is installed is no evaluation program.
    """
    plugin = (registry or Registry()).find(GROUP, name)
    kind = plugin.load()
    program = kind() if isinstance(kind, type) else kind
    if not isinstance(program, EvaluationProgram):
        raise broken(plugin, "has no evaluate and results_csv")
    return program


def strict_evaluation(
    competition: Competition, name: str, log_map: LogMap, *, registry: Registry | None = None
) -> Evaluation:
    """The evaluation of a competition by the organisers' own program.

    Args:
        competition: Its runs and trial configurations.
        name: Of the program.
        log_map: The log map of the rule set.
        registry: The installed plugins.

    Raises:
        LogError: The runs do not lie as the program expects, or a trial has no configuration.
        PluginError: There is no such program.
    """
    registry = registry or Registry()
    program = evaluation_program(name, registry)
    work = {trial.id: _planned(competition, trial, log_map, registry) for trial in competition.trials}
    if competition.logs is None:
        raise LogError(
            "the organisers' program reads runs from <team>/<trial>_<n>, and these lie otherwise",
            file=competition.file,
            hint="rank with --policy robust",
        )
    return program.evaluate(competition.logs, work)


def _planned(
    competition: Competition, trial: TrialPlan, log_map: LogMap, registry: Registry
) -> list[PlannedItem]:
    """The outermost items of a trial as its configuration states them."""
    if trial.config is None:
        raise LogError(
            f"trial {trial.id!r} has no configuration; the organisers' program takes its work from there",
            file=competition.file,
            hint="add trials/<trial>.yaml, or 'config:' to the trial",
        )
    readers, _ = open_readers(registry)
    # Any reader that knows the file: only a plugin knows how its competition writes its trials.
    reader = next((r for _, r in sorted(readers.items()) if r.can_read(trial.config)), None)
    if reader is None:
        raise LogError("no reader recognises this configuration", file=trial.config, hint="check the file")
    return [
        PlannedItem(item.id, (number_of_fact(item.facts, "priority") or 0) > 1)
        for item in reader.read(trial.config, Wanted(log_map)).work
    ]
