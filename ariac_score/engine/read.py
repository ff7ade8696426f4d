"""From a path to the one trial that its logs and configurations show."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from ariac_score.checks.contracts import Competition, Decoder, KitFinder, Likening, Reader, Wanted
from ariac_score.checks.guarded import GuardedDecoder, GuardedReader, broken, open_readers
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.engine.facts import refuse_other_facts
from ariac_score.engine.prepared import Prepared
from ariac_score.errors import (
    DataFileError,
    LogMapError,
    NothingToScoreError,
    PluginError,
    RunEndedError,
)
from ariac_score.logs.bundle import Bundle, find_parts
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.build import merge_trials
from ariac_score.trial.channels import LogMap
from ariac_score.trial.derive import source_quantities
from ariac_score.trial.kits import with_contents
from ariac_score.trial.model import LogDefect, TeamSetup, Trial, orders_of

__all__ = [
    "find_trial",
    "kit_plugin",
    "no_progress",
    "plugins_of_log_map",
    "read_needed",
    "read_trial",
    "refuse_other_years",
    "topics_read",
    "with_names",
    "with_unknown_products",
]


Progress = Callable[[float], None]


ENDED_WITHOUT_SCORE: Mapping[str, str] = {
    "crashed": "the simulator died during this run, and no score was recorded",
    "cancelled": "the run was cancelled by its user, and no score was recorded",
}
"""The outcomes after which an official text holds no score, in words."""


def no_progress(_done: float) -> None:
    """Show nothing."""


def refuse_other_years(bundle: Bundle, readers: Mapping[str, Reader], rule_set: RuleSet) -> None:
    """Refuse a configuration of another edition, in which the same keys mean other things.

    Raises:
        DataFileError: Saying what the configuration looks like.
    """
    for part in bundle.parts if rule_set.edition is not None else ():
        reader = readers[part.reader]
        likeness = reader.likeness(part.path) if isinstance(reader, Likening) else None
        if likeness and likeness.editions and rule_set.edition not in likeness.editions:
            raise DataFileError(
                f"it looks like {likeness.words}, and {rule_set.id} is for {rule_set.edition}",
                file=part.path,
                hint="score under the rules of its year ('rules list'), or give the right configuration",
            )


def with_names(trial: Trial, trial_id: str, team: str) -> Trial:
    """The trial with the names its caller gives to it and its team; empty names leave those of the files."""
    setup = replace(trial.team or TeamSetup(), name=team) if team else trial.team
    return replace(trial, id=trial_id or trial.id, team=setup)


def with_unknown_products(
    trial: Trial, rule_set: RuleSet, registry: Registry
) -> tuple[Trial, tuple[Plugin, ...]]:
    """The trial with unknown product types among its defects, and the competitions that named them.

    Where its reader has named them already, no competition is asked.

    Raises:
        PluginError: A competition is provided twice, or one that the rules come with is broken.
    """
    named = any(defect.kind == "unknown_product_type" for defect in trial.log_defects)
    if named or rule_set.edition is None:
        return trial, ()
    own = {rule_set.plugin(name, registry).distribution for name in rule_set.checks}
    unknown: dict[Plugin, tuple[LogDefect, ...]] = {}
    for name in registry.names("ariac_score.competitions"):
        plugin = registry.find("ariac_score.competitions", name)
        try:
            unknown[plugin] = _unknown_products(plugin, trial, rule_set.edition)
        except PluginError:
            # One that brings no check of these rules is about other editions, of which it would say nothing.
            if plugin.distribution in own:
                raise
    defects = [defect for found in unknown.values() for defect in found]
    takes_part = tuple(plugin for plugin, found in unknown.items() if found)
    return replace(trial, log_defects=(*trial.log_defects, *defects)), takes_part


def _unknown_products(plugin: Plugin, trial: Trial, edition: int) -> tuple[LogDefect, ...]:
    competition: Competition = plugin.build({})
    try:
        return tuple(competition.unknown_products(orders_of(trial), edition))
    except (Exception, SystemExit) as cause:  # a stranger's code may raise anything
        raise broken(plugin, f"raised {type(cause).__name__}: {cause}") from cause


def topics_read(prepared: Prepared) -> frozenset[str]:
    """The topics that a rule set reads from a recording, with and without leading slash."""
    channels = prepared.log_map.channels_for(prepared.sources)
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


def read_trial(
    bundle: Bundle,
    readers: Mapping[str, Reader],
    log_map: LogMap,
    registry: Registry,
    *,
    quantities: Iterable[str],
    progress: Progress = no_progress,
    jobs: int = 0,
    orders: bool = True,
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
        orders: Whether a trial without any order is refused.

    Raises:
        LogError: A part is damaged, or two parts contradict each other.
        NothingToScoreError: There is configuration but no record of a trial, or no order.
    """
    decoders, kits = plugins_of_log_map(log_map, registry)
    _refuse_without_record(bundle)
    sources = source_quantities(quantities)
    trials = []
    for number, part in enumerate(bundle.parts):

        def step(done: float, number: int = number) -> None:
            progress((number + done) / len(bundle.parts))

        wanted = Wanted(log_map, sources, decoders, step, part.run, jobs, kits)
        trials.append(readers[part.reader].read(part.path, wanted))
    trial = merge_trials(trials[0].id if len(trials) == 1 else bundle.id, trials, file=bundle.root)
    # Before the orders are missed: a run that crashed has none, and a ranking counts it as 0.
    if not trial.work and trial.official is not None and trial.official.outcome in ENDED_WITHOUT_SCORE:
        raise RunEndedError(
            ENDED_WITHOUT_SCORE[trial.official.outcome],
            outcome=trial.official.outcome,
            file=bundle.root,
            hint="repeat the run; a ranking counts it as 0, by name",
        )
    # After merging: submissions may come from one log and the poses of what lay on trays from another.
    trial = with_contents(trial, max_age_s=log_map.kits.max_age_s)
    if orders and not trial.work:
        raise NothingToScoreError(
            "no order was found",
            file=bundle.root,
            hint=_no_orders_hint(bundle, trial),
        )
    progress(1.0)
    return trial


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
    orders: bool | None = None,
) -> Trial:
    """The trial of a bundle, with the signals that the checks of a rule set need; nothing is derived yet.

    Args:
        bundle: What to read.
        readers: By name.
        prepared: The rule set.
        progress: Called with the share done.
        jobs: Threads that read a recording; see `read_trial`.
        orders: Whether a trial without any order is refused; by default where the rules are about orders.

    Raises:
        LogError: A part is damaged, or two parts contradict each other.
        NothingToScoreError: There is no record of a trial, or no order where the rules are about orders.
    """
    trial = read_trial(
        bundle,
        readers,
        prepared.log_map,
        prepared.registry,
        quantities=prepared.sources,
        progress=progress,
        jobs=jobs,
        orders=prepared.rule_set.about_work if orders is None else orders,
    )
    if prepared.fact_schemas is not None:
        plugin, schemas = prepared.fact_schemas
        refuse_other_facts(trial, schemas, by=plugin, file=bundle.root)
    return trial


def plugins_of_log_map(log_map: LogMap, registry: Registry) -> tuple[dict[str, Decoder], KitFinder | None]:
    """The decoders that a log map names, by name, and what finds kits for it.

    Raises:
        LogMapError: One of them is not installed, or cannot be built.
    """
    return _decoders(log_map, registry), _kit_finder(log_map, registry)


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


def kit_plugin(log_map: LogMap, registry: Registry) -> Plugin | None:
    """The plugin that finds kits in poses, where the log map says where trays lie.

    A log map need not name it where only one is installed.

    Raises:
        LogMapError: It is named by none, or not installed.
    """
    if not log_map.kits.trays:
        return None
    names = registry.names("ariac_score.kits")
    if not log_map.kits.use and len(names) != 1:
        raise LogMapError(
            f"'kits' does not say which plugin finds them; installed: {', '.join(names) or 'none'}",
            file=log_map.id,
            hint="add 'use:' to the section, with the name of one of group ariac_score.kits",
        )
    try:
        return registry.find("ariac_score.kits", log_map.kits.use or names[0])
    except PluginError as error:
        raise LogMapError(error.cause, file=log_map.id, hint=error.hint) from error


def _kit_finder(log_map: LogMap, registry: Registry) -> KitFinder | None:
    plugin = kit_plugin(log_map, registry)
    try:
        finder: KitFinder | None = plugin.build({}) if plugin else None
    except PluginError as error:
        raise LogMapError(error.cause, file=log_map.id, hint=error.hint) from error
    return finder


def _no_orders_hint(bundle: Bundle, trial: Trial) -> str:
    looked = f"; not in the log: {', '.join(trial.unrecorded)}" if trial.unrecorded else ""
    read = ", ".join(f"{part.path.name} ({part.role})" for part in bundle.parts)
    return f"read: {read}{looked}; add the trial configuration or record the orders topic"
