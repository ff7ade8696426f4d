"""A submission from its files to the neutral export, whatever is in them."""

from __future__ import annotations

import hashlib
import re
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import yaml

from ariac_score.batch.local import LocalExecutor, usable_cores
from ariac_score.batch.outcomes import UNSETTLED, summary_of
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask
from ariac_score.batch.worker import Done
from ariac_score.checks.findings import Verdict
from ariac_score.checks.registry import Registry
from ariac_score.documents.schema import strict_json
from ariac_score.engine.prepared import prepare
from ariac_score.engine.score import check_configuration
from ariac_score.errors import DataFileError, LogError, PluginError, RunEndedError, ScoreError, UsageError
from ariac_score.logs.logmap import is_log_map_file, stand_alone
from ariac_score.platforms.archives import SMALL, ArchiveLimits, is_archive, unpack
from ariac_score.platforms.neutral import STATUS, Metrics, PlatformScores
from ariac_score.ranking.competition import Competition, Team, TrialPlan
from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import Ranking, RunOutcome
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.spec import ranking_spec
from ariac_score.results.codec import Format, as_text
from ariac_score.results.result import Pinned, Result
from ariac_score.results.result_file import as_json, load_result

__all__ = [
    "EMPTY",
    "HASHES",
    "LOG_MAP",
    "PHASE",
    "RULES",
    "Phase",
    "PhaseDescription",
    "Scored",
    "hashes_text",
    "load_phase",
    "phase_text",
    "rules_and_log_map",
    "score_submission",
]

TEAM = "submission"
PHASE = "phase.json"
RULES = "ruleset.yaml"
LOG_MAP = "log_map.yaml"
HASHES = "hashes.json"
EMPTY = (
    "the submission arrived empty; a zip with metadata.yaml or metadata at its root is taken for a program: "
    "put each recording in a folder of its own, such as first_task_1/metadata.yaml, or pack it with "
    "'ariac-score platform codabench pack'"
)
_RUN = re.compile(r"(?P<trial>.+)_(?P<run>\d{1,6})")
_NESTED = 4
"""Archives inside one another."""
STARTED_WITHIN = 0.9
"""Share of the time of one run in which all runs must start; a bundle grants a submission twice that time."""
_OF_THE_WORKER = ("metadata",)
"""Files that the platform's worker puts among those of a submission."""

OnLine = Callable[[str], None]
"""Called with a line about each run."""


@dataclass(frozen=True)
class PhaseDescription:
    """`phase.json`: what is scored in a phase, and by which rules.

    Attributes:
        phase: Its name.
        rule_set: The rules in `ruleset.yaml`, with the hash of their text; without one where an older version
            wrote it.
        limits: For each run.
        trials: The name of each trial's configuration, relative to the folder; empty without one.
    """

    phase: str
    rule_set: Pinned
    limits: Limits
    trials: Mapping[str, str]


def _from_1(data: dict[str, Any]) -> dict[str, Any]:
    """`phase/1` as `phase/2`: it stated the hash of the files that the rules were written in."""
    return {**data, "rule_set": {**data["rule_set"], "sha256": ""}}


PHASE_FORMAT = Format(
    "phase",
    2,
    PhaseDescription,
    before={1: _from_1},
    made_by="'ariac-score platform codabench bundle'",
    error=DataFileError,
)
"""How the description of a phase is stored."""


@dataclass(frozen=True)
class Phase:
    """A phase, from its reference data.

    Attributes:
        name: Of the phase.
        setting: Rules and limits.
        trials: The trials, each with its configuration where it has one.
        folder: Of the reference data.
        archive_limits: For submissions.
    """

    name: str
    setting: BatchSetting
    trials: tuple[TrialPlan, ...]
    folder: Path
    archive_limits: ArchiveLimits


@dataclass(frozen=True)
class Scored:
    """A scored submission: the export, and what it was made from.

    Attributes:
        export: For the platform.
        ranking: Of this team alone; `None` when nothing could be scored.
        results: Results by trial and number.
    """

    export: PlatformScores
    ranking: Ranking | None
    results: Mapping[tuple[str, int], Result]


def phase_text(name: str, setting: BatchSetting, trials: Mapping[str, str], *, rules: str = "") -> str:
    """The description of a phase, for its reference data; `rules` as packed, where that is another text."""
    packed = replace(setting, rules=rules or setting.rules)
    rule_set = Pinned(setting.rules_id, packed.rules_sha256)
    return PHASE_FORMAT.text(PhaseDescription(name, rule_set, setting.limits, trials))


def rules_and_log_map(setting: BatchSetting) -> dict[str, bytes]:
    """The rules of a phase, by file name, with the log map that they name where it is a file of its own.

    Raises:
        LogMapError: The log map is not there, or is malformed.
        LocalPluginError: A check is a class in a file, and a host has installed plugins alone.
    """
    rule_set = setting.rule_set()
    rule_set.refuse_local(Registry())
    if not is_log_map_file(rule_set.log_map):
        return {RULES: setting.rules.encode()}
    file = Path(rule_set.file).parent / rule_set.log_map
    # Under a name of ours: theirs may lead out of the folder of the rules, and here there is no such folder.
    rules = yaml.safe_dump(
        {**rule_set.expanded, "log_map": LOG_MAP}, sort_keys=False, allow_unicode=True, width=100
    )
    return {RULES: rules.encode(), LOG_MAP: stand_alone(file)}


def hashes_text(files: Mapping[str, bytes]) -> str:
    """The SHA-256 of each file of the reference data, which `load_phase` checks."""
    return as_text({name: hashlib.sha256(content).hexdigest() for name, content in files.items()})


def _check_hashes(folder: Path) -> None:
    """Refuse reference data of which a file was changed since they were written.

    Raises:
        ValueError: A checksum is wrong.
        OSError: A file is missing.
    """
    if not (folder / HASHES).is_file():
        return  # written by hand
    document = strict_json((folder / HASHES).read_text(encoding="utf-8"))
    for name, stated in msgspec.convert(document, dict[str, str]).items():
        file = folder / name
        if not file.resolve().is_relative_to(folder.resolve()):
            raise ValueError(f"{HASHES} names {name!r}, which is outside the folder")
        found = hashlib.sha256(file.read_bytes()).hexdigest()
        if found != stated:
            raise ValueError(f"{name} has the SHA-256 {found}, and {HASHES} says {stated}")


def load_phase(folder: Path) -> Phase:
    """Read the reference data of a phase.

    Raises:
        ScoreError: A file is missing, malformed, or was changed since it was written, or no trial can be
            scored by these rules here; this is the organisers' fault.
    """
    try:
        _check_hashes(folder)
        rules = (folder / RULES).read_text(encoding="utf-8")
    except (OSError, ValueError, RecursionError) as cause:
        raise UsageError(
            f"these are no reference data of a phase: {cause}",
            file=folder,
            hint="write them with 'ariac-score platform codabench bundle'",
        ) from cause
    description = PHASE_FORMAT.read(folder / PHASE)
    setting = BatchSetting(
        rules,
        description.rule_set.id,
        str(folder / RULES),
        description.limits,
    )
    if description.rule_set.sha256 not in ("", setting.rules_sha256):
        raise UsageError(
            f"the rules have SHA-256 {setting.rules_sha256[:12]}…, and the phase states "
            f"{description.rule_set.sha256[:12]}…",
            file=folder / RULES,
            hint="the rules were edited: write the bundle again with 'ariac-score platform codabench bundle'",
        )
    trials = tuple(
        TrialPlan(trial, folder / name if name else None) for trial, name in description.trials.items()
    )
    # Each run would find the same fault, and it would look like one of the submission.
    prepare(setting.rule_set())
    phase = Phase(description.phase, setting, trials, folder, ArchiveLimits())
    _check_configurations(phase)
    return phase


def _check_configurations(phase: Phase) -> None:
    """Check that the configurations of a phase can be read and fit its rules: they are part of every run.

    Raises:
        ScoreError: One is damaged, is no configuration, or is of another edition.
    """
    rule_set = phase.setting.rule_set()
    for trial in phase.trials:
        if trial.config is not None:
            check_configuration(trial.config, rule_set)


def score_submission(
    files: Path, phase: Phase, work: Path, *, on_line: OnLine = lambda _line: None, jobs: int = 0
) -> Scored:
    """Score a submission. Whatever is wrong with it is an outcome, never an error.

    Args:
        files: The submission, unpacked by the platform; archives in it are opened here.
        phase: Rules, trials and limits.
        work: Folder for unfinished work.
        on_line: Called with a line about each run.
        jobs: Runs at a time; 0 for the cores.

    Raises:
        UsageError: Something is wrong with the reference data.
        PluginError: The scorer or a plugin failed.
    """
    rule_set = phase.setting.rule_set()
    if rule_set.sheet.needs_cohort:
        raise UsageError(
            f"{rule_set.id} compares teams, and a platform scores one submission at a time",
            hint="let the phase use the task rules (as_coded), and rank with 'ariac-score rank' afterwards",
        )
    spec = ranking_spec(rule_set, {}, file=RULES)
    work.mkdir(parents=True, exist_ok=True)
    try:
        tasks = tuple(_tasks(files, phase, work))
    except LogError as error:
        cause = f"{error.place}: {error.cause}" if error.place else error.cause
        return _nothing(phase, f"{Path(error.file or '').name}: {cause}; {error.hint}")
    if not tasks:
        return _nothing(phase, EMPTY)
    results: dict[tuple[str, str, int], Result | ScoreError] = {}
    late: list[RunTask] = []
    in_time = _in_time(tasks, phase.setting.limits.wall_s * STARTED_WITHIN, late)
    for done in LocalExecutor(jobs or usable_cores(), None, work).run(in_time, phase.setting):
        _refuse_fault_of_ours(done)
        results[done.task.key] = _result_of(done, work)
        on_line(_line(done))
    for task in late:
        results[task.key] = LogError("not scored: the runs before it took all the time of the submission")
        on_line(f"{task.trial}, run {task.number}: not scored: no time left")
    competition = Competition(
        id=phase.name,
        title=phase.name,
        rules=rule_set.id,
        root=files,
        file=files,
        teams=(Team(TEAM, TEAM),),
        trials=phase.trials or tuple(TrialPlan(trial) for trial in sorted({task.trial for task in tasks})),
        runs=(),
    )
    ranking = rank_results(competition, spec, rule_set, results)
    scored = {key[1:]: result for key, result in results.items() if isinstance(result, Result)}
    return Scored(_export(phase, ranking, scored), ranking, scored)


def _in_time(tasks: Iterable[RunTask], within_s: float, late: list[RunTask]) -> Iterator[RunTask]:
    """The tasks that the executor takes in time; the others are noted as late.

    A platform that has to stop a submission keeps no score of any of its runs.
    """
    until = time.monotonic() + within_s
    for task in tasks:
        if time.monotonic() < until:
            yield task
        else:
            late.append(task)


def _nothing(phase: Phase, message: str) -> Scored:
    return Scored(PlatformScores.without_score(phase.name, "invalid_log", message), None, {})


# The files -----------------------------------------------------------------------------


def _tasks(files: Path, phase: Phase, work: Path) -> Iterator[RunTask]:
    """A task for each entry that belongs to a trial of the phase.

    Raises:
        LogError: An archive is refused, or an entry belongs to no trial.
    """
    configs = {trial.id: trial.config for trial in phase.trials}
    taken: set[tuple[str, int]] = set()
    for entry in _entries(files, _Unpacking(files, phase.archive_limits), work):
        trial, number = _named(entry, configs)
        if (trial, number) in taken:
            raise LogError(
                f"two entries are run {number} of {trial!r}", file=entry, hint="name runs <trial>_<n>"
            )
        taken.add((trial, number))
        config = configs.get(trial)
        also = (str(config),) if config else ()
        yield RunTask(TEAM, trial, number, str(entry), str(entry.parent), also)


class _Unpacking:
    """What the archives of one submission may still unpack to, all together.

    With limits for each archive alone, archives in archives would multiply their ratios.
    """

    def __init__(self, files: Path, limits: ArchiveLimits) -> None:
        handed_in = sum(entry.stat().st_size for entry in files.iterdir() if entry.is_file())
        most = max(handed_in * limits.ratio, SMALL)
        self._left = replace(limits, bytes=min(limits.bytes, most))

    def unpack(self, archive: Path, into: Path) -> None:
        """Unpack an archive, and take what came out from what is left.

        Raises:
            LogError: It is refused.
        """
        came_out = unpack(archive, into, self._left)
        self._left = replace(
            self._left,
            bytes=self._left.bytes - sum(file.stat().st_size for file in came_out),
            members=self._left.members - len(came_out),
        )


def _entries(files: Path, unpacking: _Unpacking, work: Path, depth: int = 0) -> Iterator[Path]:
    found = [
        entry
        for entry in sorted(files.iterdir())
        if entry.name not in _OF_THE_WORKER and not entry.name.startswith((".", "__MACOSX"))
    ]
    for entry in found:
        if entry.is_symlink():
            raise LogError("it is a link", file=entry, hint="hand in the file itself")
        if entry.is_file() and entry.suffix in (".zip", ".tar", ".gz", ".tgz") and is_archive(entry):
            if depth >= _NESTED:
                raise LogError(
                    f"more than {_NESTED} archives inside one another",
                    file=entry,
                    hint="pack the trials once",
                )
            # By its whole name: `day.zip` and `day.tar` are two archives.
            folder = work / "unpacked" / entry.name
            shutil.rmtree(folder, ignore_errors=True)
            unpacking.unpack(entry, folder)
            yield from _entries(folder, unpacking, work / entry.name, depth + 1)
        else:
            yield entry


def _named(entry: Path, configs: Mapping[str, Any]) -> tuple[str, int]:
    """Trial and number of a run by the name of its entry: `<trial>_<n>`, or `<trial>` for the first run."""
    plain = entry.name.split(".", maxsplit=1)[0] if entry.is_file() else entry.name
    match = _RUN.fullmatch(plain)
    if plain in configs or (match is None and not configs):
        return plain, 1
    if match is not None and (match["trial"] in configs or not configs):
        return match["trial"], int(match["run"])
    raise LogError(
        f"{entry.name!r} belongs to no trial of this phase",
        file=entry,
        hint=f"name it <trial> or <trial>_<n>; the trials are {', '.join(sorted(configs))}",
    )


# The outcome ---------------------------------------------------------------------------


def _refuse_fault_of_ours(done: Done) -> None:
    """Refuse an outcome that is no fault of the submission, for it may never look like a score.

    Raises:
        PluginError: The scorer or a plugin failed.
    """
    assert done.document is not None
    summary = summary_of(done.document)
    if summary.outcome in ("failed", "plugin_failed"):
        raise PluginError(
            _line(done),
            hint="mend the plugin or the scorer, and score the submission again",
        )


def _result_of(done: Done, work: Path) -> Result | ScoreError:
    assert done.document is not None  # without a folder of a batch, nothing is stored already
    summary = summary_of(done.document)
    stored = work / "result.json"
    if b'"schema": "ariac-score/result/' in done.document:
        stored.write_bytes(done.document)
        return load_result(stored)
    if summary.outcome in ("crashed", "cancelled"):
        return RunEndedError(summary.reason, outcome=summary.outcome)
    return LogError(summary.reason)


def _line(done: Done) -> str:
    assert done.document is not None
    summary = summary_of(done.document)
    detail = f"{summary.score:g}" if summary.score is not None else summary.reason
    return f"{done.task.trial}, run {done.task.number}: {summary.outcome.replace('_', ' ')}: {detail}"


def _export(phase: Phase, ranking: Ranking, results: Mapping[tuple[str, int], Result]) -> PlatformScores:
    (standing,) = ranking.standings
    kept = [run for run in ranking.runs if run.kept]
    unsettled = [run for run in ranking.runs if run.outcome in UNSETTLED | {"undecided"}]
    missing = [trial for trial, cell in standing.trials.items() if cell.outcome == "no_run"]
    if not kept:
        reason = next((run.reason for run in ranking.runs), "no run could be scored")
        return PlatformScores.without_score(phase.name, "invalid_log", reason, result_sha256=_hash(results))
    status = "incomplete" if unsettled or missing else "scored"
    counting = [results[run.trial, run.number] for run in kept if (run.trial, run.number) in results]
    findings = [finding for result in counting for finding in result.measured.findings.values()]
    open_ = sum(1 for finding in findings if finding.verdict is Verdict.INCONCLUSIVE)
    final = float(standing.execution)
    raw = _raw(kept, final)
    ends = standing.open.execution if standing.open else Ends(standing.execution, standing.execution)
    metrics = Metrics(
        final=final,
        raw=raw,
        penalty=final - raw,
        violations=sum(1 for finding in findings if finding.verdict is Verdict.VIOLATED),
        coverage=1 - open_ / len(findings) if findings else 0.0,
        status_code=STATUS[status],
        least=float(ends.least),
        most=float(ends.most),
    )
    return PlatformScores.of(phase.name, status, metrics, _message(ranking, missing), _hash(results))


def _raw(kept: list[RunOutcome], final: float) -> float:
    """The task scores of the runs that count, where the rules name a task score."""
    tasks = [run.task for run in kept]
    if any(task is None for task in tasks):
        return final
    return float(sum((task for task in tasks if task is not None), start=type(tasks[0])(0)))  # type: ignore[misc]


def _message(ranking: Ranking, missing: list[str]) -> str:
    (standing,) = ranking.standings
    runs = f"{len(ranking.runs)} run{'' if len(ranking.runs) == 1 else 's'}"
    parts = [f"{runs}, {sum(run.kept for run in ranking.runs)} of them count"]
    if standing.open is not None:
        ends = standing.open.execution
        parts.append(f"logs leave open {ends.least} to {ends.most}")
    parts += [f"no run of {', '.join(missing)}"] if missing else []
    odd = [run for run in ranking.runs if run.outcome not in ("scored", "aborted")]
    parts += [f"{run.trial}, run {run.number}: {run.outcome}: {run.reason}" for run in odd[:3]]
    return f"final {standing.execution}; {'; '.join(parts)}"


def _hash(results: Mapping[tuple[str, int], Result]) -> str:
    """One hash over all results, in order of trial and number."""
    digest = hashlib.sha256()
    for _, result in sorted(results.items()):
        digest.update(hashlib.sha256(as_json(result).encode("utf-8")).digest())
    return digest.hexdigest() if results else ""
