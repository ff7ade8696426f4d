"""What is to be scored: the runs of a competition, or the entries of a folder."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from ariac_score.checks.local import LocalFiles
from ariac_score.checks.registry import Registry
from ariac_score.errors import NothingToScoreError, UsageError
from ariac_score.ranking.competition import FILE, Competition, load_competition
from ariac_score.results.codec import encodable
from ariac_score.scoring.ruleset import RuleSet, expanded_yaml, rule_set_from_text

__all__ = ["BatchPlan", "BatchSetting", "Limits", "RunTask", "TaskKey", "of_shard", "plan_batch", "shard"]

TaskKey = tuple[str, str, int]
"""Team, trial, number of the run; for a plain folder no team, the name of the entry, and 1."""

_SHARD = re.compile(r"(\d{1,6})/(\d{1,6})")


@dataclass(frozen=True, slots=True)  # there are as many as runs
class RunTask:
    """One run to be scored.

    Attributes:
        team: Its team; empty in a plain folder.
        trial: Its trial.
        number: Of the run.
        path: Of its log or folder; a URI where it is remote.
        root: Folder that names in the result are relative to; empty for the run's own.
        also: Configurations outside its folder.
        work_by: Who may state the work where none of those does: `organiser` or `run`; empty for whom the
            rules name.
        refused: Why it cannot be distinguished from another run; empty when it can.
        signature: Hash of what a storage stated about its files when they were listed; empty for local
            files, and where the storage stated nothing.
        earlier: Name of its document under other rules, in the folder of the batch; empty without one.
        earlier_sha256: Hash of that document.
    """

    team: str
    trial: str
    number: int
    path: str
    root: str = ""
    also: tuple[str, ...] = ()
    work_by: str = ""
    refused: str = ""
    signature: str = ""
    earlier: str = ""
    earlier_sha256: str = ""

    @property
    def remote(self) -> bool:
        """Whether it is named by a URI."""
        return "://" in self.path

    @property
    def key(self) -> TaskKey:
        """Team, trial, number."""
        return self.team, self.trial, self.number


@dataclass(frozen=True)
class Limits:
    """What one run may use before it is stopped, which costs that run alone.

    Attributes:
        wall_s: Time on the clock, s.
        memory_bytes: Address space; 0 for no limit.
        output_bytes: Size of its result.
        input_bytes: Size of its files, all together.
    """

    wall_s: float = 600.0
    memory_bytes: int = 8 << 30
    output_bytes: int = 64 << 20
    input_bytes: int = 128 << 30


@dataclass(frozen=True)
class BatchSetting:
    """What all runs of a batch have in common, as plain values that any worker can be sent.

    Attributes:
        rules: The whole rule set as YAML.
        rules_id: Its id.
        rules_file: Where it was loaded from; files it names are in the same folder.
        limits: For each run.
        ranges: Whether of a remote recording only the wanted parts are fetched.
        earlier_basis: Basis of the rules that scored in this folder before, if their measurements hold for
            the checks that both have; empty otherwise.
        storages: The schemes of the URIs of runs, separated by commas; workers load their libraries once.
        local_plugins: The files of code beside the rule set that the competition allows, with their SHA-256.
        partial: Whether logs that are cut off are scored as far as they go, unofficially.
    """

    rules: str
    rules_id: str
    rules_file: str
    limits: Limits
    ranges: bool = False
    earlier_basis: str = ""
    storages: str = ""
    local_plugins: tuple[tuple[str, str], ...] = ()
    partial: bool = False

    @classmethod
    def of(cls, rule_set: RuleSet, limits: Limits, *, ranges: bool = False) -> BatchSetting:
        """The setting that scores by a rule set."""
        return cls(expanded_yaml(rule_set), rule_set.id, rule_set.file, limits, ranges)

    def registry(self, installed: Registry) -> Registry:
        """The installed plugins, with the files of code that the competition allows."""
        return Registry(LocalFiles(dict(self.local_plugins))) if self.local_plugins else installed

    def rule_set(self) -> RuleSet:
        """The rule set, as it was loaded where the batch began."""
        return replace(rule_set_from_text(self.rules, file=self.rules_file), file=self.rules_file)

    @cached_property
    def rules_sha256(self) -> str:
        """Hash of the rules, as results state it."""
        return self.rule_set().sha256


@dataclass(frozen=True)
class BatchPlan:
    """What a batch is to score.

    Attributes:
        id: Name of the competition or folder.
        rules: Rule set by name or path.
        tasks: Sorted by key.
        competition: Where the tasks come from; `None` for a plain folder.
        strangers: Entries among the runs that are none.
    """

    id: str
    rules: str
    tasks: tuple[RunTask, ...]
    competition: Competition | None = None
    strangers: tuple[str, ...] = ()


def plan_batch(path: Path, rules: str = "") -> BatchPlan:
    """Find the runs at a path: a competition, or a folder of which every entry is one trial.

    Args:
        path: A `competition.yaml`, a folder with one or with the official layout, or a plain folder.
        rules: Rule set to use instead of the one a competition names.

    Raises:
        NothingToScoreError: There is nothing at the path.
        DataFileError: `competition.yaml` is malformed.
        UsageError: No rule set is given.
    """
    official = path.is_dir() and ((path / FILE).is_file() or (path / "logs").is_dir())
    if path.is_file() or official:
        return _of_competition(load_competition(path, rules))
    if not path.is_dir():
        raise NothingToScoreError(
            "no such file or folder", file=path, hint="check the path; it is relative to the current folder"
        )
    if not rules:
        raise UsageError(
            "no rule set is given",
            file=path,
            hint="name a rule set with --rules; 'ariac-score rules list' shows those that are installed",
        )
    with os.scandir(path) as listed:
        names = sorted(entry.name for entry in listed if not entry.name.startswith("."))
    if not names:
        raise NothingToScoreError("the folder is empty", file=path, hint="every entry in it is one trial")
    tasks = (RunTask("", name, 1, str(path / name)) for name in names)
    return BatchPlan(path.resolve().name, rules, tuple(map(_storable, tasks)))


def _of_competition(competition: Competition) -> BatchPlan:
    configs = {("team", team.id): team.config for team in competition.teams} | {
        ("trial", trial.id): trial.config for trial in competition.trials
    }

    def also(team: str, trial: str) -> tuple[str, ...]:
        found = (configs.get(("trial", trial)), configs.get(("team", team)))
        return tuple(str(config) for config in found if config)

    root = str(competition.root)
    tasks = [
        RunTask(
            run.team,
            run.trial,
            run.number,
            str(run.path),
            root,
            also(run.team, run.trial),
            work_by=competition.work_by,
        )
        for run in competition.runs
    ]
    tasks += [RunTask(*key, "", root, refused=reason) for key, reason in competition.refused.items()]
    return BatchPlan(
        competition.id,
        competition.rules,
        tuple(sorted(map(_storable, tasks), key=lambda task: task.key)),
        competition,
        competition.strangers,
    )


def _storable(task: RunTask) -> RunTask:
    """The task; refused where its name is no UTF-8, for neither documents nor tables can hold that."""
    team, trial = encodable([task.team, task.trial])
    if (team, trial) == (task.team, task.trial):
        return task
    return RunTask(team, trial, task.number, "", task.root, refused="its name is no UTF-8; rename it")


def shard(text: str) -> tuple[int, int]:
    """Number and count of a shard written as `i/n`, with i from 1 to n.

    Raises:
        UsageError: It is no shard.

    >>> shard("2/8")
    (2, 8)
    """
    match = _SHARD.fullmatch(text)
    number, count = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= number <= count:
        raise UsageError(
            f"{text!r} is no shard", hint="write i/n, such as 1/8 for the first of eight; the last is 8/8"
        )
    return number, count


def of_shard(tasks: Sequence[RunTask], number: int, count: int) -> Iterator[RunTask]:
    """Every n-th task: neighbours are of one team and take as long, so they spread over the shards."""
    return (task for place, task in enumerate(tasks) if place % count == number - 1)
