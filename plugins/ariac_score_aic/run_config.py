"""Reads the engine's configuration: which plug belongs into which port, trial by trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from ariac_score import (
    DataFileError,
    Likeness,
    LogDescription,
    ReaderFacts,
    Record,
    Trial,
    Wanted,
    YamlDocument,
    load_yaml,
)

__all__ = ["AicConfigReader", "Connection", "PlannedTrial", "RunConfig", "text_at_top"]

FORMAT = "engine configuration of the AI for Industry Challenge"
_TEXTS = ("cable_name", "plug_name", "port_name", "target_module_name")
_REQUIRED = (*_TEXTS, "cable_type", "plug_type", "port_type", "time_limit")
_SNIFFED_BYTES = 1 << 16
_LONGEST_LIMIT_S = 1e6


@dataclass(frozen=True)
class Connection:
    """One plug and the port it belongs into.

    Attributes:
        cable_name: Model of the cable, such as `cable_0`.
        plug_name: Such as `sfp_tip`.
        target_module_name: Such as `nic_card_mount_0`.
        port_name: Such as `sfp_port_0`.
    """

    cable_name: str
    plug_name: str
    target_module_name: str
    port_name: str


@dataclass(frozen=True)
class PlannedTrial:
    """One trial of a configuration.

    Attributes:
        id: Such as `trial_1`.
        task: The name of its first task.
        connections: What is to be connected, task by task; until phase 1 the first alone is scored.
        time_limit_s: The longest of its tasks.
    """

    id: str
    task: str
    connections: tuple[Connection, ...]
    time_limit_s: float


@dataclass(frozen=True)
class RunConfig(Record):
    """The configuration of an engine run.

    Attributes:
        file: Its name.
        trials: By id.
        topics: The topics that its scorer is given; empty where it names none.
    """

    file: str
    trials: tuple[PlannedTrial, ...]
    topics: tuple[str, ...] = ()

    def trial(self, trial_id: str) -> PlannedTrial | None:
        """The trial of that id."""
        return next((trial for trial in self.trials if trial.id == trial_id), None)

    @property
    def longest_limit_s(self) -> float:
        """The longest time limit of its trials, on which the scorer's memory of transforms depends."""
        return max(trial.time_limit_s for trial in self.trials)


class AicConfigReader:
    """Reads configurations of the engine.

    Reads:
        Of each trial the cable, plug, module and port of its first task, and the time limits.
    Refuses:
        YAML that is none, a task without one of its keys, names that are no texts, limits that are no times.
    Source:
        `aic_engine/config/sample_config.yaml` and `aic_engine.cpp` of intrinsic-dev/aic.
    """

    facts = ReaderFacts(
        role="trial_config",
        a_file="a configuration of the engine",
        formats="engine configurations of AIC 2026 (YAML)",
    )

    def can_read(self, path: Path) -> bool:
        """Whether it is YAML with `trials:` at its top that hold `tasks:`."""
        text = text_at_top(path)
        return "\ntrials:" in f"\n{text}" and "\n    tasks:" in text.replace("\t", "    ")

    def likeness(self, path: Path) -> Likeness:
        """What the file looks like."""
        if self.can_read(path):
            return Likeness(f"an {FORMAT}", frozenset({"the AI for Industry Challenge 2026"}))
        return Likeness("")

    def describe(self, path: Path) -> LogDescription:
        """The trials of the configuration."""
        try:
            config = read_config(path)
        except DataFileError as error:
            return LogDescription(FORMAT, damage=str(error))
        facts: dict[str, int | float | str] = {"trials": len(config.trials)}
        for trial in config.trials:
            c = trial.connections[0]
            facts[trial.id] = f"{c.cable_name}/{c.plug_name} to {c.target_module_name}/{c.port_name}"
        return LogDescription(FORMAT, facts=facts)

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The configuration of the whole run; the name of the recording says which trial is meant.

        Raises:
            DataFileError: It is malformed, or a task lacks what a score needs.
        """
        config = read_config(path)
        wanted.progress(1.0)
        return Trial(id=path.stem, records=(config,))


def text_at_top(path: Path) -> str:
    """The beginning of a YAML file; empty of any other file, or of one that cannot be read."""
    if path.suffix not in (".yaml", ".yml") or not path.is_file():
        return ""
    try:
        with path.open("rb") as stream:
            return stream.read(_SNIFFED_BYTES).decode("utf-8", "replace")
    except OSError:
        return ""


def read_config(path: Path) -> RunConfig:
    """The configuration in a file.

    Raises:
        DataFileError: See `AicConfigReader`.
    """
    document = load_yaml(path, may_repeat=lambda place: place[:1] != ("trials",) or "scene" in place)
    data = document.data
    trials = data.get("trials") if isinstance(data, dict) else None
    if not isinstance(trials, dict) or not trials:
        _refuse(document, ("trials",), "it holds no trials")
    planned = tuple(_planned(document, str(name), trial) for name, trial in trials.items())
    return RunConfig(path.name, planned, _topics(data))


def _refuse(document: YamlDocument, place: tuple[str | int, ...], cause: str) -> NoReturn:
    raise DataFileError(
        cause,
        file=document.file,
        place=document.place(place),
        hint="compare with aic_engine/config/sample_config.yaml",
    )


def _planned(document: YamlDocument, name: str, trial: Any) -> PlannedTrial:
    tasks = trial.get("tasks") if isinstance(trial, dict) else None
    if not isinstance(tasks, dict) or not tasks:
        _refuse(document, ("trials", name, "tasks"), f"trial {name!r} has no tasks")
    found = [_task(document, name, str(key), task) for key, task in tasks.items()]
    first = str(next(iter(tasks)))
    return PlannedTrial(name, first, tuple(one for one, _ in found), max(limit for _, limit in found))


def _task(document: YamlDocument, trial: str, name: str, task: Any) -> tuple[Connection, float]:
    """The connection of a task and its time limit in s."""
    place: tuple[str | int, ...] = ("trials", trial, "tasks", name)
    if not isinstance(task, Mapping):
        _refuse(document, place, f"task {name!r} is no map of values")
    if missing := [key for key in _REQUIRED if key not in task]:
        _refuse(document, place, f"task {name!r} of trial {trial!r} has no {missing[0]!r}")
    for key in _TEXTS:
        if not isinstance(task[key], str) or not task[key]:
            _refuse(document, (*place, key), f"{key} is {str(task[key])[:40]!r}, and no name")
    limit = task["time_limit"]
    if isinstance(limit, bool) or not isinstance(limit, int | float) or not 0 < limit <= _LONGEST_LIMIT_S:
        _refuse(document, (*place, "time_limit"), f"time_limit is {str(limit)[:40]!r}, and no time in s")
    return Connection(**{key: task[key] for key in _TEXTS}), float(limit)


def _topics(data: Mapping[str, Any]) -> tuple[str, ...]:
    scoring = data.get("scoring")
    listed = scoring.get("topics") if isinstance(scoring, dict) else None
    named = [entry.get("topic") for entry in listed or [] if isinstance(entry, dict)]
    return tuple(t["name"] for t in named if isinstance(t, dict) and isinstance(t.get("name"), str))
