"""From a path to the one trial that its logs and configurations show."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ariac_score.checks.contracts import Decoder, Likening, Reader, TrackReader, Wanted
from ariac_score.checks.guarded import GuardedDecoder, GuardedReader, broken, open_readers
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.engine.completeness import with_completeness
from ariac_score.engine.facts import facts_of_competition, refuse_facts_below, refuse_other_facts
from ariac_score.engine.prepared import Prepared, PreparedCheck, words_of
from ariac_score.errors import (
    DataFileError,
    LogMapError,
    NothingToScoreError,
    PluginError,
    RuleSetError,
    RunEndedError,
    ScoreError,
)
from ariac_score.installed.captured_output import fault_of, quiet
from ariac_score.logs.bundle import Bundle, Part, find_parts, name_from, with_parts, without_stating
from ariac_score.scoring.ruleset import Check
from ariac_score.trial.build import merge_trials
from ariac_score.trial.channels import LogMap, PluginUse
from ariac_score.trial.cut_off import known_part, with_cut
from ariac_score.trial.derive import source_quantities
from ariac_score.trial.model import TeamSetup, Trial
from ariac_score.trial.statements import OF_THE_ORGANISER, ORGANISER, FileOrigin
from ariac_score.trial.window import with_window
from ariac_score.trial.words import Words
from ariac_score.trial.work import Fact

__all__ = [
    "MOTION_RULES",
    "built_of",
    "call_hook",
    "competition_in",
    "competition_of",
    "find_run",
    "find_trial",
    "no_progress",
    "no_work_found",
    "plugins_of_log_map",
    "read_needed",
    "read_trial",
    "refuse_unlikely",
    "topics_read",
    "with_defects",
    "with_names",
]


TRACKS, COMPETITIONS = "ariac_score.tracks", "ariac_score.competitions"

Progress = Callable[[float], None]


ENDED_WITHOUT_SCORE: Mapping[str, str] = {
    "crashed": "the simulator died during this run, and no score was recorded",
    "cancelled": "the run was cancelled by its user, and no score was recorded",
}
"""The outcomes after which an official text holds no score, in words."""


MOTION_RULES = "safety"
"""The rule set that is offered for a log in which nothing was to be done."""


def no_progress(_done: float) -> None:
    """Show nothing."""


def refuse_unlikely(bundle: Bundle, readers: Mapping[str, Reader], prepared: Prepared) -> None:
    """Refuse a file that looks like one of another competition's, in which the same keys mean other things.

    Raises:
        DataFileError: Saying what the file looks like.
    """
    named = prepared.competition
    if named is None or not hasattr(named.check, "unlikely"):
        return
    for part in bundle.parts:
        reader = readers[part.reader]
        likeness = reader.likeness(part.path) if isinstance(reader, Likening) else None
        own = call_hook(named.plugin, named.check.unlikely, likeness) if likeness else ""
        if likeness and own:
            raise DataFileError(
                f"it looks like {likeness.words}, and {prepared.rule_set.id} is for {own}",
                file=part.path,
                hint="score under the rules it was made for ('rules list'), or give the right configuration",
            )


def with_names(trial: Trial, trial_id: str, team: str) -> Trial:
    """The trial with the names its caller gives to it and its team; empty names leave those of the files."""
    setup = replace(trial.team or TeamSetup(), name=team) if team else trial.team
    return replace(trial, id=trial_id or trial.id, team=setup)


def with_defects(trial: Trial, prepared: Prepared) -> Trial:
    """The trial with what its competition finds wrong with it, unless its reader has named such defects.

    Raises:
        PluginError: The competition raised.
    """
    named = prepared.competition
    if named is None or not hasattr(named.check, "defects"):
        return trial
    found = tuple(call_hook(named.plugin, named.check.defects, trial))
    known = {defect.kind for defect in trial.log_defects}
    return replace(trial, log_defects=(*trial.log_defects, *(d for d in found if d.kind not in known)))


def call_hook(plugin: Plugin, hook: Callable[..., Any], *args: object) -> Any:
    """What a competition answers.

    Raises:
        PluginError: It raised anything but an error for the user.
    """
    try:
        with quiet(plugin.origin):
            return hook(*args)
    except ScoreError:
        raise
    except Exception as cause:  # a stranger's code may raise anything
        raise broken(plugin, f"raised {fault_of(cause)}") from cause


def topics_read(prepared: Prepared) -> frozenset[str] | None:
    """The topics that a rule set reads from a recording, with and without a slash; `None`: any may be."""
    channels = prepared.log_map.channels_for(prepared.sources)
    if any("{" in channel.topic for channel in channels):  # filled from facts of each trial
        return None
    names = {channel.topic.lstrip("/") for channel in channels}
    return frozenset(name for plain in names for name in (plain, f"/{plain}"))


def find_trial(path: Path, registry: Registry) -> tuple[Bundle, dict[str, GuardedReader]]:
    """The parts of the trial at a path, and the readers that can read them.

    Raises:
        NothingToScoreError: There is nothing, or no reader recognises it; readers that
            could not be loaded are named.
        LogError: The parts contradict each other.
    """
    readers, problems = open_readers(registry)
    try:
        return find_parts(path, readers), readers
    except NothingToScoreError as error:
        if problems:
            words = "; ".join(problem.cause for problem in problems)
            error.hint = f"{error.hint}; these readers could not be loaded: {words}"
        raise


def find_run(
    path: Path, registry: Registry, *, also: Sequence[Path], root: Path, work_by: str = ""
) -> tuple[Bundle, dict[str, GuardedReader]]:
    """The parts of a run with the configurations that the caller gives, and the readers that can read them.

    Args:
        path: Of the run.
        registry: The installed plugins.
        also: Configurations that the caller gives.
        root: Folder that names are relative to, where there are any of those.
        work_by: With `organiser`, a configuration that lies with the run states nothing.

    Raises:
        NothingToScoreError: See `find_trial`.
        LogError: The parts contradict each other, or a configuration is not recognised.
    """
    bundle, readers = find_trial(path, registry)
    bundle = with_parts(bundle, also, root, readers)
    if work_by == ORGANISER:
        bundle = without_stating(bundle, OF_THE_ORGANISER)
    return bundle, readers


def read_trial(
    bundle: Bundle,
    readers: Mapping[str, Reader],
    log_map: LogMap,
    registry: Registry,
    *,
    quantities: Iterable[str],
    progress: Progress = no_progress,
    jobs: int = 0,
    work: bool = True,
    competition: PreparedCheck | None = None,
    partial: bool = False,
) -> Trial:
    """The one trial that the parts of a bundle record.

    Args:
        bundle: What to read.
        readers: By name.
        log_map: Which topic and field is which signal.
        registry: For the decoders that the log map names.
        quantities: The quantities that checks need; what they derive from is read too.
        progress: Called with the share done.
        jobs: Threads that read a recording, one of which decodes; 0: as many as there are processors.
        work: Whether a trial without any work is refused.
        competition: Joins what several logs say; by default the one that the log map names.
        partial: Whether a log that is cut off is read as far as it goes.

    Raises:
        CutOffError: A log is cut off, and not wanted in part.
        LogError: A part is damaged, or two parts contradict each other.
        NothingToScoreError: There is configuration but no record of a trial, or no work.
    """
    decoders, tracks = plugins_of_log_map(log_map, registry)
    competition = competition or competition_of(log_map, registry)
    own = competition.check if competition else None
    if competition and hasattr(own, "join"):
        own = _Guarded(competition)
    _refuse_without_record(bundle)
    wanted = Wanted(
        log_map,
        source_quantities(quantities),
        jobs=jobs,
        partial=partial,
        decoders=decoders,
        tracks=tracks,
    )
    parts = _read_parts(bundle, readers, wanted, progress)
    trial = merge_trials(
        parts[0].id if len(parts) == 1 else bundle.id,
        [*parts, *_stated_by(log_map, parts)],
        file=bundle.root,
        competition=own,
    )
    _refuse_ended_run(trial, bundle)  # before the work is missed: a run that crashed has none
    if competition and hasattr(competition.check, "complete"):
        trial = call_hook(competition.plugin, competition.check.complete, trial)
    if work and not trial.work:
        raise no_work_found(bundle, trial, words_of(competition), log_map)
    progress(1.0)
    return trial


def _read_parts(
    bundle: Bundle, readers: Mapping[str, Reader], wanted: Wanted, progress: Progress
) -> list[Trial]:
    """What each part of a bundle shows, in their order."""
    trials: dict[int, Trial] = {}
    # Recordings last: what the other files state of the trial may stand in names of the log map.
    facts: dict[str, Fact] = dict(wanted.log_map.facts)
    given = {part.role for part in bundle.parts if part.given}
    order = sorted(enumerate(bundle.parts), key=lambda numbered: numbered[1].role == "log")
    for done_before, (number, part) in enumerate(order):

        def step(done: float, before: int = done_before) -> None:
            progress((before + done) / len(bundle.parts))

        own_map = wanted.log_map.filled(facts) if part.role == "log" else wanted.log_map
        own = replace(wanted, log_map=own_map, progress=step, run=part.run)
        named = name_from(bundle.folder, part.path)
        origin = FileOrigin(_folder_of(part) if named == "." else named, part.role, part.given)
        trials[number] = known_part(replace(readers[part.reader].read(part.path, own), origin=origin))
        # Not what lies beside what the caller gave: it counts for nothing.
        facts |= {} if part.role == "log" or (part.role in given and not part.given) else trials[number].facts
    return [trials[number] for number in range(len(trials))]


def _stated_by(log_map: LogMap, parts: Iterable[Trial]) -> Iterator[Trial]:
    """What a log map states of the trial, as a part of it; and whom it names, where no log was read by it."""
    logs = [part for part in parts if part.origin and part.origin.role == "log"]
    published = frozenset() if logs else log_map.published_kinds
    if log_map.facts or published:
        origin = FileOrigin(f"log map {log_map.id}", "log_map", given=True)
        yield Trial(f"log map {log_map.id}", facts=log_map.facts, origin=origin, published_kinds=published)


def _refuse_ended_run(trial: Trial, bundle: Bundle) -> None:
    """Refuse a run that ended without a score and without work, which a ranking counts as 0.

    Raises:
        RunEndedError: Naming how it ended.
    """
    if not trial.work and trial.official is not None and trial.official.outcome in ENDED_WITHOUT_SCORE:
        raise RunEndedError(
            ENDED_WITHOUT_SCORE[trial.official.outcome],
            outcome=trial.official.outcome,
            file=bundle.root,
            hint="repeat the run; a ranking counts it as 0, by name",
        )


def no_work_found(bundle: Bundle, trial: Trial, words: Words, log_map: LogMap) -> NothingToScoreError:
    """The error about a trial in which nothing was to be done, with what to record."""
    return NothingToScoreError(
        f"no {words.one(words.outermost)} was found",
        file=bundle.root,
        hint=_no_work_hint(bundle, trial, words, log_map),
    )


def _folder_of(part: Part) -> str:
    """The name of a recording that is the whole folder of its trial."""
    return part.path.resolve().name


def _refuse_without_record(bundle: Bundle) -> None:
    if not any(part.role in ("log", "official") for part in bundle.parts):
        ignored = f"; not read: {', '.join(bundle.ignored[:5])}" if bundle.ignored else ""
        raise NothingToScoreError(
            f"{bundle.id}: there is a configuration but no log of a trial{ignored}",
            file=bundle.root,
            hint="add the log the trial wrote: a bag, a state.log, a performance.log or a .jsonl",
        )


def read_needed(
    bundle: Bundle,
    readers: Mapping[str, Reader],
    prepared: Prepared,
    *,
    progress: Progress = no_progress,
    jobs: int = 0,
    work: bool | None = None,
    trial_id: str = "",
    team: str = "",
    partial: bool = False,
) -> Trial:
    """The trial of a bundle, with the signals that the checks of a rule set need; nothing is derived yet.

    Args:
        bundle: What to read.
        readers: By name.
        prepared: The rule set.
        progress: Called with the share done.
        jobs: Threads that read a recording; see `read_trial`.
        work: Whether a trial without any work is refused; by default where the rules are about work.
        trial_id, team: Whose trial it is to be, where the caller knows: a manifest that names another attests
            nothing.
        partial: As for `read_trial`.

    Raises:
        LogError: A part is damaged, or two parts contradict each other.
        NothingToScoreError: There is no record of a trial, or no work where the rules are about work.
    """
    trial = read_trial(
        bundle,
        readers,
        prepared.log_map,
        prepared.registry,
        quantities=prepared.sources,
        progress=progress,
        jobs=jobs,
        work=prepared.rule_set.about_work if work is None else work,
        competition=competition_in(prepared),
        partial=partial,
    )
    trial = with_window(trial, prepared.rule_set.authority.window)
    trial = with_cut(trial, about_work=prepared.rule_set.about_work)
    trial = with_completeness(trial, prepared, trial_id=trial_id, team=team)
    if prepared.fact_schemas is not None:
        plugin, schemas = prepared.fact_schemas
        refuse_other_facts(trial, schemas, by=plugin, file=bundle.root)
    named = prepared.rule_set.competition
    if named is not None:
        facts = facts_of_competition(named, prepared.registry)
        refuse_facts_below(trial, facts, by=named.use, file=bundle.root)
    return trial


def competition_in(prepared: Prepared) -> PreparedCheck | None:
    """The competition whose logs are read: as the log map and the rule set together have it."""
    named = prepared.rule_set.competition
    return competition_of(prepared.log_map, prepared.registry, named) or prepared.competition


def plugins_of_log_map(log_map: LogMap, registry: Registry) -> tuple[dict[str, Decoder], TrackReader | None]:
    """The decoders that a log map names, by name, and what reads tracks for it.

    Raises:
        LogMapError: One of them is not installed, or cannot be built.
    """
    tracks = built_of(log_map.tracks, TRACKS, registry)
    return _decoders(log_map, registry), tracks.check if tracks else None


def _decoders(log_map: LogMap, registry: Registry) -> dict[str, Decoder]:
    """The decoders that a log map names, by name."""
    decoders: dict[str, Decoder] = {}
    for name in sorted({channel.decoder for channel in log_map.channels if channel.decoder}):
        try:
            plugin = registry.find("ariac_score.decoders", name)
            decoders[name] = GuardedDecoder(plugin, plugin.build({}))
        except PluginError as error:
            raise LogMapError(error.cause, file=log_map.id, hint=error.hint) from error
    return decoders


def built_of(
    named: PluginUse | None, group: str, registry: Registry, more: Mapping[str, Any] = MappingProxyType({})
) -> PreparedCheck | None:
    """A plugin that a log map names, built; `None` when it names none.

    Args:
        named: The section of the log map.
        group: Entry-point group.
        registry: The installed plugins.
        more: Parameters that a rule set adds.

    Raises:
        LogMapError: It is not installed, or refuses its parameters.
    """
    if named is None:
        return None
    try:
        plugin = registry.find(group, named.use)
        built = plugin.build({**named.parameters, **more}, place=lambda name: named.place.get(name, ""))
    except (PluginError, RuleSetError) as error:
        place = getattr(error, "place", "") or named.place.get("", "")
        raise LogMapError(error.cause, file=named.file, place=place, hint=error.hint) from error
    return PreparedCheck(named.use, plugin, built, ())


def competition_of(log_map: LogMap, registry: Registry, judged: Check | None = None) -> PreparedCheck | None:
    """The competition whose logs a log map reads, with the parameters of the rule set that judges them.

    Args:
        log_map: Whose logs they are.
        registry: The installed plugins.
        judged: The competition that the rule set names.

    Raises:
        LogMapError: It is not installed, or it is another one than that of the rule set.
    """
    named = log_map.competition
    if named and judged and judged.use != named.use:
        raise LogMapError(
            f"its logs are of the competition {named.use!r}, and the rule set is for {judged.use!r}",
            file=named.file,
            place=named.place.get("", ""),
            hint="give a log map of the same competition",
        )
    return built_of(named, COMPETITIONS, registry, judged.parameters if judged else {})


class _Guarded:
    """A competition whose failures name it."""

    def __init__(self, competition: PreparedCheck) -> None:
        self._competition = competition

    def join(self, merged: Trial, parts: Sequence[Trial], file: object) -> Trial:
        """The merged trial with its work and submissions."""
        named = self._competition
        trial = call_hook(named.plugin, named.check.join, merged, parts, file)
        if not isinstance(trial, Trial):
            raise broken(named.plugin, f"joins logs to a {type(trial).__name__} instead of a Trial")
        return trial


def _no_work_hint(bundle: Bundle, trial: Trial, words: Words, log_map: LogMap) -> str:
    """What to record or to add; topics first, each once."""

    def is_about(named: str, topic: str) -> bool:
        return f"{named} ".startswith(f"topic {topic} ")

    decoded = [channel.topic for channel in log_map.channels if channel.decoder and not channel.optional]
    topics = [topic for topic in decoded if any(is_about(named, topic) for named in trial.unrecorded)]
    others = [named for named in trial.unrecorded if not any(is_about(named, topic) for topic in topics)]
    what = " and ".join(topics) or f"what names its {words.many(words.outermost)}"
    same = f"--rules {MOTION_RULES} and the same log map, --log-map {log_map.id} (or its file)"
    alone = f"; what moves in it can be judged alone: {same}" if trial.bodies else ""
    read = ", ".join(f"{part.path.name} ({part.role})" for part in bundle.parts)
    looked = f"; also not in the log: {', '.join(others)}" if others else ""
    return f"record {what}, or give the trial configuration (--trial-config){alone}; read: {read}{looked}"
