"""A rule set ready to score trials: its checks built, their needs known, its log map loaded."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

from ariac_score.checks.contracts import FactSchemas, SignalNeed
from ariac_score.checks.measures import measures_of
from ariac_score.checks.origins import KEY as RESTS_ON
from ariac_score.checks.origins import is_foreign, origins
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.engine.facts import fact_schemas_of
from ariac_score.engine.signal_needs import Deriver, derivers_of, needs_of
from ariac_score.errors import LogMapError, PluginError, RuleSetError, ScoreError, did_you_mean
from ariac_score.logs.gather.arrival import late_in_the_competition
from ariac_score.logs.logmap import GROUP as LOG_MAPS
from ariac_score.logs.logmap import load_log_map
from ariac_score.monitors.monitor import SubjectMonitor
from ariac_score.scoring.extending import GROUP as RULE_SETS
from ariac_score.scoring.ruleset import RuleSet, load_rule_set
from ariac_score.trial.bounds import DEFAULT_BOUNDS, ERRORS, BetweenSamples, between_samples
from ariac_score.trial.channels import OF_FRAMES, OF_MODELS, LogMap
from ariac_score.trial.derive import Derivation, DerivedSignal, derive_signals, source_quantities
from ariac_score.trial.frozen import FrozenMap
from ariac_score.trial.model import Trial
from ariac_score.trial.vocabulary import GROUP as QUANTITIES_GROUP
from ariac_score.trial.vocabulary import OUR_QUANTITIES, QUANTITIES, Quantity
from ariac_score.trial.words import Words

__all__ = ["Prepared", "PreparedCheck", "Rules", "log_map_of", "prepare", "rule_set_of", "words_of"]


@dataclass(frozen=True)
class PreparedCheck:
    """A check of a rule set, or its competition, built.

    Attributes:
        name: As in the rule set.
        plugin: Where it comes from, to name it when it fails.
        check: The rule, monitor or competition, with its parameters.
        needs: The signals it reads; none but for a monitor.
    """

    name: str
    plugin: Plugin
    check: Any
    needs: tuple[SignalNeed, ...]


@dataclass(frozen=True)
class Prepared:
    """A rule set with everything that measuring takes; made once, by `prepare`.

    Attributes:
        rule_set: As loaded.
        log_map: Its own, or the one to use instead.
        registry: The installed plugins.
        checks: By name, in the order of the rule set.
        derivers: How plugins compute quantities that checks need, by quantity.
        fact_schemas: What facts its competition has, and who says so; `None` where nobody does.
        competition: The competition that the rule set names; `None` when it names none.
    """

    rule_set: RuleSet
    log_map: LogMap
    registry: Registry
    checks: Mapping[str, PreparedCheck]
    competition: PreparedCheck | None = None
    derivers: Mapping[str, Deriver] = field(default_factory=dict)
    fact_schemas: tuple[Plugin, FactSchemas] | None = None

    @property
    def plugins(self) -> tuple[Plugin, ...]:
        """The plugins that take part whatever log is read: of its checks, competition, data and signals."""
        named = [self.competition] if self.competition else []
        declared = [
            plugin
            for quantity in sorted(self.sources - OUR_QUANTITIES.keys())
            for plugin in self.registry.providers(QUANTITIES_GROUP, quantity)
        ]
        used = [each.plugin for each in (*self.checks.values(), *named)]
        used += [deriver.plugin for deriver in self.derivers.values()]
        used += [self.fact_schemas[0]] if self.fact_schemas else []
        return (*used, *declared, *self._data_plugins)

    @property
    def needs(self) -> tuple[SignalNeed, ...]:
        """What all its checks need, in their order."""
        return tuple(need for each in self.checks.values() for need in each.needs)

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantities its checks read."""
        return tuple(need.quantity for need in self.needs)

    @property
    def sources(self) -> frozenset[str]:
        """The quantities a reader should decode: those that checks read, and what they follow from."""
        return source_quantities(self.quantities, self.brought)

    @property
    def brought(self) -> Mapping[str, DerivedSignal]:
        """How plugins compute quantities that checks need, by quantity."""
        return {quantity: deriver.signal for quantity, deriver in self.derivers.items()}

    @property
    def derivations(self) -> tuple[Derivation, ...]:
        """Every signal that is derived where the log does not have it, with the longest gap it may cross."""
        return tuple(Derivation(need.quantity, need.max_gap_s, need.pair) for need in self.needs)

    @property
    def between(self) -> BetweenSamples:
        """What is assumed of the time between samples."""
        rules = self.rule_set
        every = rules.between_samples == "bounded"
        return between_samples(self.log_map.bounds, rules.bounds, every=every)

    @property
    def words(self) -> Words:
        """The words of its competition, for messages."""
        return words_of(self.competition, self.rule_set.sheet.levels)

    @cached_property
    def _data_plugins(self) -> tuple[Plugin, ...]:
        """What other distributions bring of its data: rule set, log map, what these extend and include.

        By name and hash, not by where they were loaded from: a worker of a batch and `verify` are given
        the rules as text.
        """
        loaders: Mapping[str, Callable[..., RuleSet | LogMap]] = {
            RULE_SETS: load_rule_set,
            LOG_MAPS: load_log_map,
        }
        found = []
        for group, used in ((RULE_SETS, self.rule_set), (LOG_MAPS, self.log_map)):
            with suppress(ScoreError):  # nothing of that name is installed, or nothing that can be used
                plugin = self.registry.file(group, used.id).plugin
                if is_foreign(plugin):
                    installed = loaders[group](used.id, registry=self.registry)
                    found += [plugin] if installed.sha256 == used.sha256 else []
        for noted in (self.rule_set.expanded.get(RESTS_ON, {}), self.log_map.rests_on):
            found += origins(noted, self.registry)
        return tuple(found)

    def derived(self, trial: Trial) -> Trial:
        """The trial with the signals that its checks need and that can be derived from what it has."""
        return derive_signals(
            replace(late_in_the_competition(trial), between=self.between_of(trial)),
            self.derivations,
            speed_window_s=self.log_map.speed_window_s,
            brought=self.brought,
        )

    def between_of(self, trial: Trial) -> BetweenSamples:
        """The same, where the log lacks samples that its recorder received."""
        poses = {"frames": OF_FRAMES, "models": OF_MODELS}
        source_of = {c.topic: poses[c.poses] for c in self.log_map.channels if c.poses}
        found: Counter[str] = Counter()
        for _, attested in trial.attestations:
            for one in attested.lacking if attested is not None else ():
                found[source_of.get(one.topic, one.topic)] += one.within
        return replace(self.between, lacking=FrozenMap({source: n for source, n in found.items() if n}))

    def only(self, names: Iterable[str]) -> Prepared:
        """The same with only some of its checks."""
        return replace(self, checks={name: self.checks[name] for name in names})

    def refuse_unmeasured(self) -> None:
        """Refuse formulas that price a quantity which their check does not measure.

        Raises:
            RuleSetError: Naming the check and the quantity.
        """
        for function, name, quantity, formula in self.rule_set.sheet.priced_quantities:
            declared = measures_of(self.checks[name].check) if name in self.checks else {}
            if name in self.checks and quantity not in declared:
                raise RuleSetError(
                    f"{function}() prices the quantity {quantity!r}, which check {name!r} does not measure",
                    file=self.rule_set.file,
                    place=formula.where,
                    hint=f"{did_you_mean(quantity, declared, what='measured')}; a check without depth is "
                    "priced with count(), occurrences() or charged()",
                )

    def refuse_misspelt_bounds(self) -> None:
        """Refuse bounds of a kind of body that nobody has, under nearly the name of one that is known.

        A body of a kind that just this log map lacks is no mistake: rules are written for many of them.

        Raises:
            RuleSetError, LogMapError: Who states them, and the kind.
        """
        matches = (*self.log_map.models, *self.log_map.frames)
        known = {*DEFAULT_BOUNDS, *(body.kind for body in self.log_map.bodies), *(m.kind for m in matches)}
        watched = (each.check for each in self.checks.values() if isinstance(each.check, SubjectMonitor))
        known.update(kind for check in watched for kind in check.subjects.kinds)
        for stated, error in ((self.rule_set, RuleSetError), (self.log_map, LogMapError)):
            for kind in sorted(stated.bounds.keys() - known - {*ERRORS}):
                if near := get_close_matches(kind, sorted(known), 1, 0.75):
                    raise error(
                        f"'bounds:' states how fast a {kind!r} can be, and no body is of that kind",
                        file=stated.file or stated.id,
                        place=f"$.bounds.{kind}",
                        hint=f"did you mean {near[0]!r}?",
                    )

    def refuse_unknown_quantities(self, recorded: Container[str] = ()) -> None:
        """Refuse monitors that need quantities which neither the vocabulary nor the log map knows.

        Args:
            recorded: Quantities that the log has; it may measure what its map does not declare.

        Raises:
            RuleSetError: Naming the check and the quantity.
        """
        for name, each in self.checks.items():
            for need in each.needs:
                if self._measured(need.quantity) is None and need.quantity not in recorded:
                    known = [*QUANTITIES, *self.log_map.quantities]
                    raise RuleSetError(
                        f"check {name!r} asks for the quantity {need.quantity!r}, which is unknown",
                        file=self.rule_set.file,
                        place=self.rule_set.checks[name].place.get("use", name),
                        hint=did_you_mean(need.quantity, known, what="known")
                        + "; declare it under 'quantities:' in the log map",
                    )

    def _measured(self, quantity: str) -> Quantity | None:
        """What a quantity is by the log map or by the vocabulary; `None` where neither has it."""
        try:
            return self.log_map.quantities.get(quantity) or QUANTITIES.get(quantity)
        except PluginError as error:
            error.file = error.file or self.rule_set.file
            raise

    def refuse_other_levels(self) -> None:
        """Refuse a rule about items of a level that the rule set does not have: it would never be asked.

        Raises:
            RuleSetError: Naming the check, its plugin and the level.
        """
        levels = self.rule_set.sheet.levels
        for name, each in self.checks.items():
            level = getattr(each.check, "level", "")
            if level and each.plugin.group == "ariac_score.rules" and level not in levels:
                raise RuleSetError(
                    f"check {name!r}: plugin {each.plugin.origin} judges items of level {level!r}, "
                    "which is not declared",
                    file=self.rule_set.file,
                    place=self.rule_set.checks[name].place.get("use", name),
                    hint=f"{did_you_mean(level, levels, what='declared levels')}; levels are declared by "
                    "'levels:' of the rule set, or by its competition",
                )

    def refuse_other_units(self) -> None:
        """Refuse a monitor that reads a quantity in another unit than it is measured in.

        Raises:
            RuleSetError: Naming the check, its plugin and both units.
            PluginError: What declares the quantity is broken, or two distributions contradict each other.
        """
        for name, each in self.checks.items():
            for need in each.needs:
                measured = self._measured(need.quantity)
                if measured is not None and measured.unit != need.unit:
                    raise RuleSetError(
                        f"check {name!r}: plugin {each.plugin.origin} reads {need.quantity!r} in "
                        f"{need.unit!r}, but it is measured in {measured.unit!r}",
                        file=self.rule_set.file,
                        place=self.rule_set.checks[name].place.get("use", name),
                        hint=f"read it in {measured.unit!r}: in its parameters where they name the unit, "
                        f"else in the code of {each.plugin.distribution}",
                    )


Rules = str | PathLike[str] | RuleSet | Prepared
"""A rule set: its name, the path of its file, itself, or prepared already."""


def rule_set_of(rules: Rules, registry: Registry | None = None) -> RuleSet:
    """The rule set that is given in one of these ways.

    Raises:
        ScoreError: It is given in none of them, or cannot be loaded.
    """
    if isinstance(rules, Prepared):
        return rules.rule_set
    return rules if isinstance(rules, RuleSet) else load_rule_set(rules, registry)


def prepare(rules: Rules, *, log_map: str = "", registry: Registry | None = None) -> Prepared:
    """Build the checks of a rule set, collect what they need, and load its log map.

    Args:
        rules: A rule set, its name or its path; one that is prepared already is returned as it is.
        log_map: Log map to use instead of the rule set's own.
        registry: The installed plugins, where the caller has them already.

    Raises:
        ScoreError: The rules, a plugin or the log map cannot be used.
    """
    if isinstance(rules, Prepared):
        return rules
    registry = registry or Registry()
    rule_set = rule_set_of(rules, registry)
    checks = {}
    for name, check in rule_set.build(registry).items():
        plugin = rule_set.plugin(name, registry)
        checks[name] = PreparedCheck(name, plugin, check, tuple(needs_of(plugin, name, check)))
    competition = _competition(rule_set, registry)
    prepared = Prepared(rule_set, log_map_of(rule_set, log_map, registry), registry, checks, competition)
    prepared.refuse_other_levels()
    prepared.refuse_other_units()  # before a log is read, which may take minutes
    prepared.refuse_unmeasured()
    prepared.refuse_misspelt_bounds()
    return replace(
        prepared,
        derivers=derivers_of(prepared.quantities, registry),
        fact_schemas=fact_schemas_of(rule_set.competition.use, registry) if rule_set.competition else None,
    )


def words_of(competition: PreparedCheck | None, levels: tuple[str, ...] = ()) -> Words:
    """The words of a competition, which messages about its work use; without any those for every one.

    Args:
        competition: Built; `None` where none is known.
        levels: Of the rule set; by default those that the competition declares.
    """
    check = competition.check if competition else None
    return Words(getattr(check, "words", {}), levels or tuple(getattr(check, "levels", ())))


def _competition(rule_set: RuleSet, registry: Registry) -> PreparedCheck | None:
    named = rule_set.competition
    if named is None:
        return None
    competition = rule_set.build_competition(registry)
    return PreparedCheck(named.name, registry.find(named.group, named.use), competition, ())


def log_map_of(rule_set: RuleSet, instead: str = "", registry: Registry | None = None) -> LogMap:
    """The log map of a rule set, named relative to the folder of its file, or another one instead.

    Whoever names another one names it from where they stand, as every other path.

    Raises:
        LogMapError: There is no such log map, or it is malformed.
    """
    if instead:
        return load_log_map(instead, registry=registry)
    try:
        return load_log_map(rule_set.log_map, beside=Path(rule_set.file).parent, registry=registry)
    except LogMapError as error:
        if not error.file:
            error.file, error.place = rule_set.file, "$.log_map"
        raise
