"""From a path to a result: measure with plugins, price with the rule set.

Measuring needs the log and knows no points; pricing needs only what was measured.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path

from ariac_score.checks.contracts import Reader
from ariac_score.checks.guarded import open_readers
from ariac_score.checks.local import allowing
from ariac_score.checks.registry import Registry
from ariac_score.documents.given import name_or_path, path_of
from ariac_score.engine.measure import measure_trial, sketch_trial
from ariac_score.engine.prepared import Prepared, Rules, prepare
from ariac_score.engine.price import price_trial
from ariac_score.engine.provenance import hashing_files, provenance_of, refuse_other_contents
from ariac_score.engine.read import (
    Progress,
    competition_in,
    find_run,
    find_trial,
    no_progress,
    read_needed,
    read_trial,
    refuse_unlikely,
    with_defects,
    with_names,
)
from ariac_score.engine.settings import settings_of
from ariac_score.errors import LogError, OtherFactError, UsageError
from ariac_score.logs.bundle import Bundle, with_parts
from ariac_score.logs.logmap import load_log_map
from ariac_score.results.result import Result
from ariac_score.results.sketch import sketch_of_work
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import Trial
from ariac_score.trial.vocabulary import QUANTITIES

__all__ = ["check_configuration", "open_trial", "score_parts", "score_trial"]


def open_trial(
    path: str | PathLike[str],
    rules: Rules | None = None,
    *,
    log_map: str | PathLike[str] = "",
    local_plugins: bool | Mapping[str, str] = False,
) -> Trial:
    """The trial at a path, as checks see it: signals as arrays with units, bodies, events, work, facts.

    Args:
        path: A log, a rosbag2 folder, a bundle folder, or a `bundle.yaml`.
        rules: A rule set, its name or the path of its file. Its log map says which topic is which signal,
            and what its checks need is derived: speeds, distances. Without it nothing is derived.
        log_map: Log map to use instead of the rule set's own, or without one.
        local_plugins: As for `score_trial`.

    Raises:
        UsageError: The log has topics, and neither rules nor a log map say what they mean.
        ScoreError: The log cannot be read.

    >>> trial = open_trial("examples/kitting_near_miss.mcap", "paper2020")
    >>> trial.signals["centre_distance/robot/human"].unit, round(trial.duration_s, 1)
    ('m', 37.5)
    """
    path = path_of(path, "the path of a log")
    registry = Registry(allowing(local_plugins))
    instead = name_or_path(log_map, "the name or path of a log map")
    prepared = None if rules is None else prepare(rules, log_map=instead, registry=registry)
    if prepared is not None:
        mapping = prepared.log_map
    else:
        mapping = load_log_map(instead, registry=registry) if instead else LogMap("none")
    bundle, readers = find_trial(path, registry)
    needed = prepared.sources if prepared else ()
    trial = read_trial(
        bundle,
        readers,
        mapping,
        registry,
        quantities=[*QUANTITIES, *mapping.quantities, *needed],
        work=False,
        competition=None if prepared is None else competition_in(prepared),
    )
    if prepared is None and not instead and not trial.sampled:
        _refuse_topics(bundle, readers)
    return prepared.derived(trial) if prepared else trial


def _refuse_topics(bundle: Bundle, readers: Mapping[str, Reader]) -> None:
    """Refuse to hand out a recording without any signal, because nothing says what its topics mean."""
    for part in bundle.parts:
        topics = [topic.name for topic in readers[part.reader].describe(part.path).topics]
        if topics:
            raise UsageError(
                f"nothing says which of its topics is which signal: {', '.join(topics[:5])}",
                file=part.path,
                hint="give the rules or the log map of its competition: rules=…, log_map=…",
            )


def score_trial(
    path: str | PathLike[str],
    rules: Rules,
    *,
    log_map: str | PathLike[str] = "",
    registry: Registry | None = None,
    local_plugins: bool | Mapping[str, str] = False,
    progress: Progress = no_progress,
    also: Sequence[str | PathLike[str]] = (),
    work_by: str = "",
    root: str | PathLike[str] | None = None,
    trial_id: str = "",
    team: str = "",
    jobs: int = 0,
    known: Result | None = None,
    partial: bool = False,
) -> Result:
    """Score the trial at a path; where its rules compare teams, `reprice` adds the cohort.

    Args:
        path: A log, a rosbag2 folder, a bundle folder, or a `bundle.yaml`.
        rules: A rule set, its name or the path of its file; prepared already (`prepare`) where many trials
            are scored by it.
        log_map: Log map to use instead of the rule set's own.
        registry: The installed plugins, where the caller has them already.
        local_plugins: Whether the rule set may name classes in files beside it, whose code is then run: all
            of them, or those given with their SHA-256. It counts where no `registry` is given.
        progress: Called with the share done, 0 to 1.
        also: Configurations of the trial or team that the caller gives, as an organiser does. They count;
            one of the path that says something else is refused.
        work_by: Who may state the work in a configuration where none of `also` does: `organiser`, so that
            one of the path counts for nothing, or `run`; by default what the rules say, or else `run`.
        root: Folder that file names in the result are relative to; needed with `also`.
        trial_id: Name of the trial, where the caller knows it better than the files.
        team: Name of the team, likewise.
        jobs: Threads that read a recording, one of which decodes; 0: as many as there are processors. The
            result does not depend on it.
        known: A result of the same files by the same code, whose checks ask for the same
            signals (`needs_alike`): their findings are taken from it, and only the others run.
        partial: Whether a log that is cut off is scored as far as it goes, as an interval. Nothing official
            follows from such a result, which says so (`Measured.unofficial`).

    Raises:
        ScoreError: For everything a user can act on; see `ariac_score.errors`.
    """
    path = path_of(path, "the path of a log")
    registry = registry or Registry(allowing(local_plugins))
    prepared = prepare(rules, log_map=name_or_path(log_map), registry=registry)
    registry = prepared.registry
    elsewhere = [path_of(one, "the path of a configuration") for one in also]
    by = work_by or prepared.rule_set.authority.work
    bundle, readers = find_run(path, registry, also=elsewhere, root=path_of(root or path), work_by=by)
    return score_parts(
        path,
        bundle,
        readers,
        prepared,
        progress=progress,
        trial_id=trial_id,
        team=team,
        jobs=jobs,
        known=known,
        partial=partial,
    )


def score_parts(
    path: Path,
    bundle: Bundle,
    readers: Mapping[str, Reader],
    prepared: Prepared,
    *,
    progress: Progress = no_progress,
    trial_id: str = "",
    team: str = "",
    jobs: int = 0,
    known: Result | None = None,
    partial: bool = False,
    growing: bool = False,
) -> Result:
    """Score the parts of a trial that were found at a path.

    Args:
        path: Where they were found.
        bundle: The parts.
        readers: By name.
        prepared: The rule set.
        progress, trial_id, team, jobs, known, partial: As for `score_trial`.
        growing: Whether the files are still being written: then they are not hashed, and no motion is drawn.

    Raises:
        ScoreError: As `score_trial` does.
    """
    refuse_unlikely(bundle, readers, prepared)
    with hashing_files(bundle, threaded=jobs != 1 and not growing) as hashes:
        trial = read_needed(
            bundle,
            readers,
            prepared,
            progress=progress,
            jobs=jobs,
            trial_id=trial_id,
            team=team,
            partial=partial,
        )
        trial = with_names(trial, trial_id, team)
        trial = prepared.derived(with_defects(trial, prepared))
        with _naming(path, trial.id):
            measured = measure_trial(trial, prepared, known=known)
        words = prepared.words.spoken
        sketch = sketch_of_work(trial, words) if growing else sketch_trial(trial, prepared, measured)
        inputs = () if growing else hashes()
    if not growing:
        refuse_other_contents(bundle, inputs)
    # After the checks: neither may influence a finding.
    measured = replace(measured, sketch=sketch, settings=settings_of(prepared, measured))
    with _naming(path, trial.id):
        return price_trial(measured, prepared.rule_set, provenance_of(bundle, inputs, prepared, trial))


@contextmanager
def _naming(path: Path, trial_id: str) -> Iterator[None]:
    """Name the log where a fault of its trial is found that knows the name of the trial at most."""
    try:
        yield
    except (LogError, OtherFactError) as error:
        if error.file in (None, trial_id):
            error.file = str(path)
        raise


def check_configuration(path: Path, rule_set: RuleSet) -> None:
    """Check that a file can be the configuration of trials under a rule set, before there is a log.

    Raises:
        LogError: No reader recognises it, or it is damaged.
        DataFileError: It looks like one of another competition.
    """
    registry = Registry()
    readers, _ = open_readers(registry)
    bundle = with_parts(Bundle(path.stem, path, ()), [path], path, readers)
    refuse_unlikely(bundle, readers, prepare(rule_set, registry=registry))
    (part,) = bundle.parts
    if part.role != "trial_config":
        raise LogError(
            "it is no trial configuration",
            file=path,
            hint="give the configuration that says what was to be done",
        )
    damage = readers[part.reader].describe(path).damage
    if damage:
        raise LogError(damage, file=path, hint="correct the configuration")
