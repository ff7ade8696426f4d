"""Competitions: whose runs of which trials there are, from `competition.yaml` or the official folders.

Official folders: `logs/<team>/<trial>_<n>` with `competitor_configs/<team>.yaml` and
`trials/<trial>.yaml` (the evaluation of 2024), or `logs/<team>/<trial>` with
`team_config/<team>/team_config.yaml` and `trial_config/<trial>.yaml` (2017 to 2022).

Source: ARIAC notes on log formats, section 2.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from ariac_score.checks.guarded import open_readers
from ariac_score.checks.local import LocalFiles
from ariac_score.checks.registry import Registry
from ariac_score.documents.schema import validate
from ariac_score.documents.yaml import YamlDocument, is_there, load_yaml
from ariac_score.errors import DataFileError, LogError, NothingToScoreError, UsageError, did_you_mean
from ariac_score.results.signing import ENDING
from ariac_score.scoring.authority import Authority
from ariac_score.trial.statements import ORGANISER

__all__ = [
    "Competition",
    "Run",
    "RunKey",
    "Team",
    "TrialPlan",
    "load_competition",
    "registry_for",
    "signed_for",
    "signers_of",
    "stored_results",
    "work_by_of",
]

FILE = "competition.yaml"
MAX_RUNS = 100_000
"""More entries than these at one depth are no folder of runs, but perhaps a whole disk."""

RunKey = tuple[str, str, int]
"""Team, trial, number of the run."""

_FIELDS = {"team": r"(?P<team>[^/]+)", "trial": r"(?P<trial>[^/]+)", "run": r"(?P<run>\d{1,9})"}
_TEAM_CONFIGS = ("competitor_configs/{team}.yaml", "team_config/{team}/team_config.yaml")
_TRIAL_CONFIGS = ("trials/{trial}.yaml", "trial_config/{trial}.yaml")


@dataclass(frozen=True)
class Team:
    """A team.

    Attributes:
        id: As in paths.
        name: For people.
        config: Its sensor configuration.
        judges: For each judge the marks given.
        disqualified: Why it has no rank; empty when it has not been disqualified.
    """

    id: str
    name: str
    config: Path | None = None
    judges: tuple[tuple[float, ...], ...] = ()
    disqualified: str = ""


@dataclass(frozen=True)
class TrialPlan:
    """A trial of the competition with its configuration, where there is one."""

    id: str
    config: Path | None = None


@dataclass(frozen=True)
class Run:
    """One run of one trial by one team, and the path of its recording."""

    team: str
    trial: str
    number: int
    path: Path

    @property
    def key(self) -> RunKey:
        """Team, trial, number."""
        return self.team, self.trial, self.number


@dataclass(frozen=True)
class Competition:
    """What a competition consists of.

    Attributes:
        id: Its name.
        title: One line for people.
        rules: Name or path of its rule set; empty when none is named.
        root: Folder its paths are in.
        file: The file (or folder) it was read from.
        teams: In the order in which they are listed.
        trials: In their order.
        runs: Sorted by team, trial and number.
        refused: Runs that share a number with another one, by key, with the reason.
        strangers: Files and folders among the runs that belong to no team or trial, with the reason.
        ranking: Where it departs from the `ranking:` of the rule set.
        sha256: Hash of the file; empty for the official folders.
        logs: Folder of the teams' folders, where runs lie as `<team>/<trial>_<n>`.
        adjustments: What the stewards decided, where the file names it.
        local_plugins: The files of code beside its rule set that may run, with their SHA-256.
        what_if: Other values of numbers of the rules, by name, for its site to show the ranking under.
        work_by: Whose configuration may state the work, `organiser` or `run`; empty where the file does not
            say. Then the rules do, and where they do not either, it is the organiser's.
        signed_by: The public keys of the organiser, as the file gives them; empty where it does not say.
    """

    id: str
    title: str
    rules: str
    root: Path
    file: Path
    teams: tuple[Team, ...]
    trials: tuple[TrialPlan, ...]
    runs: tuple[Run, ...]
    refused: Mapping[RunKey, str] = field(default_factory=dict)
    strangers: tuple[str, ...] = ()
    ranking: Mapping[str, Any] = field(default_factory=dict)
    sha256: str = ""
    logs: Path | None = None
    adjustments: Path | None = None
    local_plugins: Mapping[str, str] = field(default_factory=dict)
    what_if: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    work_by: str = ""
    signed_by: tuple[str, ...] = ()


def signers_of(competition: Competition, rules: Authority) -> tuple[str, ...]:
    """Whose signature what is stored of a competition must have: as it says, else as its rules do."""
    return competition.signed_by or rules.signed_by


def signed_for(competition: Competition) -> str:
    """For which competition what is stored must be signed: for this one, where it names the keys itself."""
    return competition.id if competition.signed_by else ""


def work_by_of(competition: Competition, rules: Authority) -> str:
    """Whose configuration may state the work in a competition: unless it says otherwise, the organiser's."""
    return competition.work_by or rules.work or ORGANISER


def registry_for(competition: Competition) -> Registry:
    """The installed plugins, and the files of code that the competition itself allows."""
    return Registry(LocalFiles(competition.local_plugins) if competition.local_plugins else None)


def load_competition(path: Path, rules: str = "", *, may_be_empty: bool = False) -> Competition:
    """Read a competition.

    Args:
        path: A `competition.yaml`, a folder with one, or a folder with the official layout.
        rules: Rule set to use instead of the one it names.
        may_be_empty: Whether one without any team, trial or run is fine.

    Raises:
        NothingToScoreError: There is no competition at the path, or it has no team or trial.
        DataFileError: `competition.yaml` is malformed, or leads out of its folder.
        UsageError: No rule set is named.
    """
    file = path / FILE if path.is_dir() and (path / FILE).is_file() else path
    competition = _from_file(file, rules) if file.is_file() else _from_folders(path, rules)
    if not competition.rules:
        raise UsageError(
            "nothing says by which rules",
            file=path,
            hint="name a rule set with --rules, or in competition.yaml",
        )
    whole = competition.teams and competition.trials and (competition.runs or competition.refused)
    if not whole and not may_be_empty:
        missing = "team" if not competition.teams else "trial" if not competition.trials else "run"
        raise NothingToScoreError(
            f"the competition has no {missing}; {_seen(competition)}",
            file=path,
            hint="runs lie at the pattern of 'runs:', such as logs/{team}/{trial}_{run}",
        )
    return competition


def _seen(competition: Competition) -> str:
    return (
        f"passed over: {'; '.join(competition.strangers[:3])}"
        if competition.strangers
        else "no run was found"
    )


# competition.yaml ----------------------------------------------------------------------


def _from_file(file: Path, rules: str) -> Competition:
    document = load_yaml(file)
    if document.data is None:
        raise DataFileError("the file is empty", file=file, hint="it needs at least id, rules and runs")
    validate(document, "competition")
    data, root = document.data, file.parent
    _refuse_twice(document, "teams")
    _refuse_twice(document, "trials")
    found, strangers = _found(document, root)
    teams = [_team(document, root, i, entry) for i, entry in enumerate(data.get("teams", []))]
    # Teams and trials that are not listed are those that have runs; a team without any must be listed.
    teams = teams or [_plain_team(document, root, name) for name in sorted({run.team for run in found})]
    trials = [_trial(document, root, i, entry) for i, entry in enumerate(data.get("trials", []))]
    trials = trials or [_plain_trial(document, root, name) for name in sorted({run.trial for run in found})]
    runs, refused = _by_number(found)
    named = rules or data["rules"]
    if not rules and (named.endswith((".yaml", ".yml")) or "/" in named):
        named = str(_inside(document, root, named, ("rules",)))
    return Competition(
        id=data["id"],
        title=data.get("title", data["id"]),
        rules=named,
        root=root,
        file=file,
        teams=tuple(teams),
        trials=tuple(trials),
        runs=runs,
        refused=refused,
        strangers=strangers,
        ranking=data.get("ranking", {}),
        sha256=document.sha256,
        logs=_logs_folder(root, data["runs"]),
        adjustments=_existing(document, root, data["adjustments"], ("adjustments",))
        if "adjustments" in data
        else None,
        local_plugins=data.get("local_plugins", {}),
        what_if={name: tuple(map(float, values)) for name, values in data.get("what_if", {}).items()},
        work_by=data.get("authority", {}).get("work", ""),
        signed_by=tuple(data.get("authority", {}).get("signed_by", ())),
    )


def _found(document: YamlDocument, root: Path) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """The runs that `runs:` names, and what lies among them and is no run of a listed team and trial."""
    data = document.data
    teams = [entry["id"] for entry in data.get("teams", [])]
    trials = [entry["id"] for entry in data.get("trials", [])]
    if isinstance(data["runs"], str):
        return _matching(root, data["runs"], teams, trials, document=document)
    if isinstance(data["runs"], list):
        return _listed(document, root, teams, trials), ()
    return _stored(document, root, teams, trials)


def _logs_folder(root: Path, pattern: object) -> Path | None:
    """The folder above the teams' folders, where the pattern is that of the official evaluation."""
    ending = "{team}/{trial}_{run}"
    if not isinstance(pattern, str) or not PurePosixPath(pattern).as_posix().endswith(ending):
        return None
    above = PurePosixPath(pattern).as_posix().removesuffix(ending)
    return root / above if "{" not in above and is_there(root / above) and (root / above).is_dir() else None


def _refuse_twice(document: YamlDocument, key: str) -> None:
    seen: set[str] = set()
    for i, entry in enumerate(document.data.get(key, [])):
        if entry["id"] in seen:
            raise DataFileError(
                f"{entry['id']!r} is listed twice",
                file=document.file,
                place=document.place([key, i, "id"]),
                hint="keep one of the two",
            )
        seen.add(entry["id"])


def _team(document: YamlDocument, root: Path, number: int, entry: Mapping[str, Any]) -> Team:
    plain = _plain_team(document, root, entry["id"])
    config = plain.config
    if "config" in entry:
        config = _existing(document, root, entry["config"], ("teams", number, "config"))
    marks = tuple(tuple(float(mark) for mark in judge) for judge in entry.get("judges", []))
    return Team(entry["id"], entry.get("name", entry["id"]), config, marks, entry.get("disqualified", ""))


def _plain_team(document: YamlDocument, root: Path, name: str) -> Team:
    pattern = document.data.get("team_configs", "")
    return Team(name, name, _by_pattern(document, root, pattern, "team_configs", team=name))


def _trial(document: YamlDocument, root: Path, number: int, entry: Mapping[str, Any]) -> TrialPlan:
    if "config" in entry:
        return TrialPlan(
            entry["id"], _existing(document, root, entry["config"], ("trials", number, "config"))
        )
    return _plain_trial(document, root, entry["id"])


def _plain_trial(document: YamlDocument, root: Path, name: str) -> TrialPlan:
    pattern = document.data.get("trial_configs", "")
    return TrialPlan(name, _by_pattern(document, root, pattern, "trial_configs", trial=name))


def _by_pattern(document: YamlDocument, root: Path, pattern: str, key: str, **names: str) -> Path | None:
    """The file a pattern names, if it is there."""
    if not pattern:
        return None
    path = _inside(document, root, _filled(pattern, **names), (key,))
    return path if is_there(path) and path.is_file() else None


def _filled(pattern: str, **names: str) -> str:
    for key, name in names.items():
        pattern = pattern.replace(f"{{{key}}}", name)
    return pattern


def _inside(document: YamlDocument, root: Path, name: str, place: Sequence[str | int]) -> Path:
    """A path of the file, which may not lead out of its folder.

    Raises:
        DataFileError: It does.
    """
    # A competition may come from somewhere else, and with it its paths and links.
    plain = PurePosixPath(name)
    path = root / name
    if plain.is_absolute() or ".." in plain.parts or "\0" in name or not _is_below(path, root):
        raise DataFileError(
            f"{name!r} leads out of the competition's folder",
            file=document.file,
            place=document.place(list(place)),
            hint="copy the file into the folder and name it relative to it",
        )
    return path


def _is_below(path: Path, root: Path) -> bool:
    try:
        return path.resolve().is_relative_to(root.resolve())
    except (OSError, RuntimeError):  # a loop of links
        return False


def _existing(document: YamlDocument, root: Path, name: str, place: Sequence[str | int]) -> Path:
    path = _inside(document, root, name, place)
    if not is_there(path):
        raise DataFileError(
            f"{name!r} does not exist",
            file=document.file,
            place=document.place(list(place)),
            hint="check the name, or remove the entry",
        )
    return path


def _listed(
    document: YamlDocument, root: Path, teams: Sequence[str], trials: Sequence[str]
) -> tuple[Run, ...]:
    runs = []
    for i, entry in enumerate(document.data["runs"]):
        for key, known in (("team", teams), ("trial", trials)):
            if known and entry[key] not in known:
                raise DataFileError(
                    f"{key} {entry[key]!r} is not listed",
                    file=document.file,
                    place=document.place(["runs", i, key]),
                    hint=did_you_mean(entry[key], known),
                )
        path = _existing(document, root, entry["path"], ("runs", i, "path"))
        runs.append(Run(entry["team"], entry["trial"], entry["run"], path))
    return tuple(runs)


def _stored(
    document: YamlDocument, root: Path, teams: Sequence[str], trials: Sequence[str]
) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """The runs in databases, numbered for each team and trial in the order in which they began."""
    runs, strangers = [], []
    numbers: Counter[tuple[str, str]] = Counter()
    for i, name in enumerate(document.data["runs"]["databases"]):
        path = _existing(document, root, name, ("runs", "databases", i))
        for run_id, team, trial in _owners(path):
            at = path.with_name(f"{path.name}#run={run_id}")
            unlisted = _unlisted(team, trial, teams, trials)
            if unlisted:
                strangers.append(f"{name}, run {run_id}: {unlisted}")
            else:
                numbers[team, trial] += 1
                runs.append(Run(team, trial, numbers[team, trial], at))
    return tuple(sorted(runs, key=lambda run: run.key)), tuple(strangers)


def _unlisted(team: str, trial: str, teams: Sequence[str], trials: Sequence[str]) -> str:
    """Why a run is nobody's; empty when its team and trial are listed, or any is welcome."""
    for what, name, known in (("team", team, teams), ("trial", trial, trials)):
        if known and name not in known:
            return f"{what} {name!r} is not listed; {did_you_mean(name, known)}"
    return ""


def _owners(path: Path) -> list[tuple[int, str, str]]:
    """Number, team and trial of every run in a database."""
    readers, _ = open_readers(Registry())
    reader = next((r for _, r in sorted(readers.items()) if r.facts.holds_runs and r.can_read(path)), None)
    if reader is None:
        raise LogError(
            "no reader recognises this as a file that holds several runs",
            file=path,
            hint="give a database of runs; 'ariac-score plugins list' shows which readers are installed",
        )
    return reader.runs(path)


def _matching(
    root: Path, pattern: str, teams: Sequence[str], trials: Sequence[str], *, document: YamlDocument
) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """The runs a pattern finds, and what lies among them without being one."""
    _inside(document, root, _filled(pattern, team="team", trial="trial", run="1"), ("runs",))
    for key in ("team", "trial"):
        if pattern.count(f"{{{key}}}") != 1:
            raise DataFileError(
                f"{pattern!r} must name {{{key}}} once",
                file=document.file,
                place=document.place(["runs"]),
                hint="such as logs/{team}/{trial}_{run}",
            )
    return _search(root, pattern, teams, trials)


# The official folders ------------------------------------------------------------------


def _from_folders(path: Path, rules: str) -> Competition:
    if not path.is_dir():
        raise NothingToScoreError(
            "no such file or folder", file=path, hint="check the path; it is relative to the current folder"
        )
    if not (path / "logs").is_dir():
        raise NothingToScoreError(
            f"there is neither a {FILE} nor a folder 'logs' here",
            file=path,
            hint=f"write a {FILE}, or lay the runs out as logs/<team>/<trial>_<n>",
        )
    teams = sorted(entry.name for entry in (path / "logs").iterdir() if entry.is_dir())
    planned = sorted(file.stem for file in path.glob("trials/*.yaml"))
    single = sorted(file.stem for file in path.glob("trial_config/*.yaml"))
    pattern = "logs/{team}/{trial}" if single else "logs/{team}/{trial}_{run}"
    found, strangers = _search(path, pattern, teams, planned or single)
    trials = planned or single or sorted({run.trial for run in found})
    runs, refused = _by_number(found)
    return Competition(
        id=path.resolve().name,
        title=path.resolve().name,
        rules=rules,
        root=path,
        file=path,
        teams=tuple(Team(name, name, _first(path, _TEAM_CONFIGS, team=name)) for name in teams),
        trials=tuple(TrialPlan(name, _first(path, _TRIAL_CONFIGS, trial=name)) for name in trials),
        runs=runs,
        refused=refused,
        strangers=strangers,
        logs=None if single else path / "logs",
    )


def stored_results(folder: Path) -> Competition:
    """The competition of which a folder holds the results, as `<team>/<trial>_<n>.json`."""
    found, strangers = _search(folder, "{team}/{trial}_{run}.json", (), ())
    runs, refused = _by_number(found)
    return Competition(
        id=folder.resolve().name,
        title=folder.resolve().name,
        rules="",
        root=folder,
        file=folder,
        teams=tuple(Team(name, name) for name in sorted({run.team for run in found})),
        trials=tuple(TrialPlan(name) for name in sorted({run.trial for run in found})),
        runs=runs,
        refused=refused,
        strangers=strangers,
    )


def _first(root: Path, patterns: Sequence[str], **names: str) -> Path | None:
    paths = [root / _filled(pattern, **names) for pattern in patterns]
    return next((path for path in paths if is_there(path) and path.is_file()), None)


# Finding runs --------------------------------------------------------------------------


def _search(
    root: Path, pattern: str, teams: Sequence[str], trials: Sequence[str]
) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    # The trial's name takes all it can, so that in `kit_1_2` the run is what follows the last underscore.
    parts = PurePosixPath(pattern).parts
    expression = re.escape(PurePosixPath(pattern).as_posix())
    for key, group in _FIELDS.items():
        expression = expression.replace(re.escape(f"{{{key}}}"), group)
    runs, strangers = [], []
    for path in _entries(root, parts):
        relative = path.relative_to(root).as_posix()
        if not _is_below(path, root) or not path.exists():
            where = "nothing" if _is_below(path, root) else "somewhere outside the competition's folder"
            strangers.append(f"{relative}: a link to {where}; copy what it means into the folder")
            continue
        match = re.fullmatch(expression, relative)
        if match is None:
            if not path.name.startswith(".") and path.suffix != ENDING:
                strangers.append(f"{relative}: not named as {pattern}")
            continue
        team, trial = match["team"], match["trial"]
        unlisted = _unlisted(team, trial, teams, trials)
        if unlisted:
            strangers.append(f"{relative}: {unlisted}")
        else:
            number = int(match["run"]) if "run" in match.groupdict() else 1
            runs.append(Run(team, trial, number, path))
    return tuple(sorted(runs, key=lambda run: (run.key, run.path.as_posix()))), tuple(sorted(strangers))


def _entries(root: Path, parts: Sequence[str]) -> Iterator[Path]:
    """Everything at the depth of the pattern, below the folders that its plain parts name."""
    level = [root]
    for part in parts:
        deeper: list[Path] = []
        for folder in level:
            if not folder.is_dir() or not _is_below(folder, root):
                yield folder  # a file, or a link out of the folder: the caller says what is wrong with it
            elif "{" in part:
                deeper += sorted(folder.iterdir())
            elif (folder / part).exists():
                deeper.append(folder / part)
            if len(deeper) > MAX_RUNS:
                raise NothingToScoreError(
                    f"more than {MAX_RUNS} entries: this does not look like a folder of runs", file=folder
                )
        level = deeper
    yield from level


def _by_number(found: Sequence[Run]) -> tuple[tuple[Run, ...], dict[RunKey, str]]:
    """The runs that have their number alone, and why all others are refused.

    `kit_1` and `kit_01` are both run 1. Nothing says which of them was meant to count, and taking
    the first would let a file name decide a ranking.
    """
    by_key: dict[RunKey, list[Run]] = {}
    for run in found:
        by_key.setdefault(run.key, []).append(run)
    refused = {
        key: f"{len(same)} runs have the number {key[2]}: {', '.join(run.path.name for run in same)}"
        for key, same in by_key.items()
        if len(same) > 1
    }
    return tuple(run for run in found if run.key not in refused), refused
