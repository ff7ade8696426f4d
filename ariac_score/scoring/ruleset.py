"""Rule sets: loading and checking the YAML that says which checks run and what their findings are worth."""

from __future__ import annotations

import hashlib
import keyword
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml

from ariac_score.checks.local import GivenPlugin
from ariac_score.checks.registry import Plugin, Registry, is_local, parameters_of
from ariac_score.documents.given import path_of
from ariac_score.documents.schema import validate
from ariac_score.documents.yaml import YamlDocument, parse_yaml
from ariac_score.errors import (
    FormulaError,
    LocalPluginError,
    PluginError,
    PluginNotFoundError,
    RuleSetError,
    ScoreError,
    UsageError,
    did_you_mean,
)
from ariac_score.scoring.authority import Authority
from ariac_score.scoring.cohort import CohortTerm
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.extending import (
    COMPETITIONS,
    LAYOUTS,
    competitions_with,
    expanded_document,
    own_document,
    path_of_rule_set,
    rule_set_names,
    unknown_keys,
    written_document,
)
from ariac_score.scoring.forms import Table, in_formulas, place_in, tables_of
from ariac_score.scoring.levels import (
    TRIAL,
    check_levels,
    declared_facts,
    facts_as_written,
    no_such_level,
    other_name,
)
from ariac_score.scoring.named import (
    NamedParameter,
    groups_of,
    named_parameters,
    references,
    with_values,
    without_numbers,
)
from ariac_score.scoring.penalties import with_penalty
from ariac_score.scoring.policy import OPEN
from ariac_score.scoring.printed import PrintedItem, PrintedSum, PrintedText
from ariac_score.scoring.sheet import RESERVED, ScoreSheet
from ariac_score.scoring.variation import given_monitor, set_number

__all__ = [
    "Check",
    "Differences",
    "RuleDifference",
    "RuleSet",
    "differences",
    "draft_rule_set",
    "expanded_yaml",
    "installed_rule_sets",
    "installed_rule_sets_differing_from",
    "load_rule_set",
    "rule_set_from_text",
    "rule_set_names",
]

_SCORE = "score"
_MONITORS = "ariac_score.monitors"


@dataclass(frozen=True)
class Check:
    """One use of a plugin in a rule set: of a rule, a monitor, or the competition.

    Attributes:
        name: Its name in the rule set, which formulas use.
        use: Entry-point name of the plugin.
        group: Entry-point group: rules, monitors or competitions.
        parameters: Its `with:` block.
        on_inconclusive: What an undecided finding means for the score.
        named: Which of its parameters are those of the rule set, by the name of each in both.
        place: Line and path of the check in its file, by parameter name.
    """

    name: str
    use: str
    group: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    on_inconclusive: str = OPEN
    named: Mapping[str, str] = field(default_factory=dict)
    place: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class RuleDifference:
    """One point in which two rule sets of a competition differ.

    Attributes:
        name: Its name in the rule set, such as `wrong_colour`.
        terms: The terms it affects, such as `task.bonus`; also `score` and `task`.
        checks: The checks it affects.
        coded: What the code does, in words, whichever of the two rule sets follows it.
        documented: What the document says, in words.
        source: Where both are found.
    """

    name: str
    terms: tuple[str, ...]
    checks: tuple[str, ...]
    coded: str
    documented: str
    source: str


@dataclass(frozen=True)
class Differences:
    """How, and why, a rule set differs from another one.

    Attributes:
        other: Name of the other rule set.
        because: Each difference, in the order of the file.
    """

    other: str
    because: tuple[RuleDifference, ...]


@dataclass(frozen=True)
class RuleSet:
    """A rule set, checked against its schema and in itself.

    Attributes:
        id: Such as `paper2020`.
        title: One line for people.
        source: Rulebook or paper.
        notes: What a referee should know.
        log_map: Name of the log map it is meant for.
        checks: By name, in the order of the file.
        sheet: What findings are worth.
        digits: Decimal digits of the score.
        file: Where it was loaded from.
        expanded: The whole as plain values, after `extends` and `include`.
        ranking: How runs become a ranking, as in the file; empty when it does not say.
        competition: Whose work it judges, with the parameters of that; `None` when the file does not say.
        printed: What the official text prints, and how it adds up.
        differs: How it differs from another rule set, as in the file; `None` when it does not say.
        ranges: Lowest and highest reasonable value of parameters, as in the file.
        breaks: Why a law of `rules check` is known to be broken, by name of the law.
        parameters: The numbers that it gives a name, with unit and meaning, in the order of the file.
        tables: What is worth points by verdicts of checks, as tables.
        given: The checks that were given in Python, by name.
        bounds: How fast bodies can move, as in the file.
        between_samples: `held`: a sample stands until the next one; `bounded`: every interval is bounded.
        counts: Which score of those that a log allows is the score: `worst`, `best`, or `withhold` for none.
    """

    id: str
    title: str
    source: str
    notes: tuple[str, ...]
    log_map: str
    checks: Mapping[str, Check]
    sheet: ScoreSheet
    digits: int
    file: str
    expanded: Mapping[str, Any] = field(default_factory=dict, repr=False)
    ranking: Mapping[str, Any] = field(default_factory=dict)
    competition: Check | None = None
    printed: PrintedText = field(default_factory=PrintedText)
    differs: Differences | None = None
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    breaks: Mapping[str, str] = field(default_factory=dict)
    parameters: Mapping[str, NamedParameter] = field(default_factory=dict)
    tables: tuple[Table, ...] = ()
    given: Mapping[str, GivenPlugin] = field(default_factory=dict, repr=False)
    bounds: Mapping[str, Any] = field(default_factory=dict)
    between_samples: str = "held"
    counts: str = "worst"

    @cached_property
    def text(self) -> str:
        """The whole as YAML, after `extends` and `include`."""
        return yaml.safe_dump(dict(self.expanded), sort_keys=False, allow_unicode=True, width=100)

    @cached_property
    def sha256(self) -> str:
        """Hash of `text`, so of all it extends, includes and names; a result holds both."""
        return hashlib.sha256(self.text.encode("utf-8")).hexdigest()

    @cached_property
    def authority(self) -> Authority:
        """Who may state what of a trial."""
        return Authority.of(self.expanded)

    @property
    def policies(self) -> dict[str, str]:
        """What undecided findings count as, by check."""
        return {check.name: check.on_inconclusive for check in self.checks.values()}

    @property
    def monitors(self) -> frozenset[str]:
        """The checks that watch motion and events, rather than judge work."""
        return frozenset(check.name for check in self.checks.values() if check.group == _MONITORS)

    @property
    def about_work(self) -> bool:
        """Whether it judges or prices work; rules that only watch bodies need no work item in the log."""
        judged = any(check.group == "ariac_score.rules" for check in self.checks.values())
        return judged or self.sheet.about_work

    @property
    def folder(self) -> Path | None:
        """Folder of its file; `None` for rules that lie in no file of their own, as those in a result."""
        return Path(self.file).parent if self.file.endswith((".yaml", ".yml")) else None

    def plugin(self, name: str, registry: Registry) -> Plugin:
        """The plugin of a check: given in Python, in a file beside the rule set, or installed.

        Raises:
            PluginError: There is none, or it may not be used.
        """
        check = self.checks[name]
        if name in self.given:
            return self.given[name]
        return registry.find(check.group, check.use, beside=self.folder)

    def refuse_local(self, registry: Registry) -> None:
        """Refuse checks in files that are not allowed or are other files, before any trial is read.

        Raises:
            LocalPluginError: Naming the file, and where the rule set names it.
        """
        for check in self.checks.values():
            if is_local(check.use):
                try:
                    self.plugin(check.name, registry)
                except PluginError as error:
                    _locate(error, check, self.file)
                    raise

    def build(self, registry: Registry) -> dict[str, Any]:
        """Every check's plugin, built with its parameters, by check name.

        Raises:
            PluginNotFoundError: A plugin is not installed; the message names the check.
            RuleSetError: A plugin refuses its parameters.
        """
        return {
            name: _built(check, self.file, partial(self._plugin_in_its_units, name, registry))
            for name, check in self.checks.items()
        }

    def _plugin_in_its_units(self, name: str, registry: Registry) -> Plugin:
        """The plugin of a check, once the named parameters that it takes are in the units it declares."""
        plugin, check = self.plugin(name, registry), self.checks[name]
        declared = parameters_of(plugin.load()) if check.named else {}
        for parameter, named in check.named.items():
            wanted = declared[parameter].facts.unit if parameter in declared else ""
            if named in self.parameters and wanted and self.parameters[named].unit != wanted:
                value, unit, _ = self.parameters[named]
                raise RuleSetError(
                    f"{parameter!r} of {check.use} is in {wanted}, the parameter {named!r} in {unit}",
                    place=check.place.get(parameter, parameter),
                    hint=f"write '{value:g} {wanted}'" if unit == "1" else f"write its number in {wanted}",
                )
        return plugin

    def build_competition(self, registry: Registry) -> Any | None:
        """The plugin of the competition it names, built with its parameters; `None` when it names none.

        Raises:
            PluginNotFoundError: It is not installed; the message says where it is named.
            RuleSetError: It refuses its parameters.
        """
        named = self.competition
        return _built(named, self.file, partial(registry.find, named.group, named.use)) if named else None

    def with_parameters(self, values: Mapping[str, Any] = MappingProxyType({}), /, **more: Any) -> RuleSet:
        """The rule set with other numbers, for a sweep.

        Args:
            values: New values by name: a parameter of the formulas, or `check.parameter` of a check, as
                `sensitivity` names them.
            more: Likewise, for names without a point.

        Raises:
            RuleSetError: There is no such name, its value is of another kind, or the plugin of the check,
                where it is installed, refuses it.

        >>> rules = load_rule_set("paper2020").with_parameters({"separation.t1_s": 0.5})
        >>> rules.checks["separation"].parameters["t1_s"]
        0.5
        """
        if not isinstance(values, Mapping):
            raise UsageError(
                f"parameters are given by name, not as a {type(values).__name__}",
                hint="write {'separation.t1_s': 0.5}",
            )
        data = deepcopy(dict(self.expanded))
        for name, value in {**values, **more}.items():
            one = self.given.get(str(name).partition(".")[0])
            if one is not None and one.instance is not None:
                raise RuleSetError(
                    f"{name!r} is a number of an object that was given in Python",
                    file=self.file,
                    hint="give another object with 'with_monitor'",
                )
            set_number(data, str(name), value, file=self.file)
        changed = self._again(data, self.given)
        for name, check in changed.checks.items():  # a named number may stand in the parameters of several
            if check.parameters != self.checks[name].parameters:
                changed._refuse_parameters(name)
        return changed

    def _refuse_parameters(self, name: str) -> None:
        """Refuse parameters that the plugin of a check does not take; not where that is not installed."""
        with suppress(PluginNotFoundError, LocalPluginError):  # as scoring will say
            _built(self.checks[name], self.file, partial(self.plugin, name, _installed()))

    def with_score(self, formula: str) -> RuleSet:
        """The rule set with another formula for the score, such as `task - 2 * count(near_miss)`.

        Raises:
            FormulaError: It cannot be parsed, or names something unknown.
            RuleSetError: It is no text.

        >>> load_rule_set("paper2020").with_score("task").expanded["score"]
        'task'
        """
        plain = formula.item() if isinstance(formula, np.generic) else formula
        return self._again({**deepcopy(dict(self.expanded)), "score": plain}, self.given)

    def with_monitor(self, name: str, monitor: object) -> RuleSet:
        """The rule set with a monitor that is given in Python, in place of the check of that name, if any.

        It keeps the contract of an installed one. A result names its class and the hash of the class's
        text; where Python has no such text, or the object has more than its fields, `unverifiable`.

        Args:
            name: Of the check, as formulas name it.
            monitor: A class, built with its defaults, or an object: `NearMiss(limit_m=0.5)`.

        Raises:
            RuleSetError: The name cannot be that of a check.
            UsageError: It is no monitor.
        """
        plugin, parameters = given_monitor(monitor)
        data = deepcopy(dict(self.expanded))
        data.get("rules", {}).pop(name, None)
        body = {"use": plugin.name, **({"with": parameters} if parameters else {})}
        data["monitors"] = {**data.get("monitors", {}), name: body}
        return self._again(data, {**self.given, name: plugin})

    def _again(self, data: dict[str, Any], given: Mapping[str, GivenPlugin]) -> RuleSet:
        """The rule set that other data make."""
        document = YamlDocument(data, self.file, "", {})
        validate(document, "ruleset", error=RuleSetError)
        return replace(_parsed(document), given=given)


@lru_cache(maxsize=1)
def _installed() -> Registry:
    """What is installed, looked up once: a sweep changes numbers a thousand times."""
    return Registry()


def _built(check: Check, file: str, find: Callable[[], Plugin]) -> Any:
    try:
        return find().build(check.parameters, place=lambda name: check.place.get(name, name))
    except (PluginError, RuleSetError) as error:
        _locate(error, check, file)
        raise


def _locate(error: ScoreError, check: Check, file: str) -> None:
    """Say of an error about a check where the rule set names it."""
    error.file = file
    error.place = error.place or check.place.get("use", check.name)


def installed_rule_sets(registry: Registry | None = None) -> list[RuleSet]:
    """Every installed rule set that can be used; what is wrong with another one stops only what names it."""
    found: list[RuleSet] = []
    registry = registry or Registry()
    for name in rule_set_names(registry):
        with suppress(ScoreError):
            found.append(load_rule_set(name, registry))
    return found


def installed_rule_sets_differing_from(other: str, registry: Registry | None = None) -> list[RuleSet]:
    """The installed rule sets that say how they differ from the one with this id.

    What a rule set differs in is never inherited, so that of all others only the file itself is read.
    """
    found: list[RuleSet] = []
    registry = registry or Registry()
    for name in rule_set_names(registry):
        with suppress(ScoreError):
            stated = own_document(path_of_rule_set(name, Path(), registry)).data.get("differs", {})
            if stated.get("from") == other:
                found.append(load_rule_set(name, registry))
    return found


def load_rule_set(name: str | os.PathLike[str], registry: Registry | None = None) -> RuleSet:
    """Load an installed rule set by name, or one from a file by its path.

    Args:
        name: Such as `paper2020`, or a path: text ending in `.yaml`, or any `Path`.
        registry: What is installed, where the caller has it already.

    Raises:
        UsageError: There is no rule set of that name, or it is no name at all.
        PluginError: Two distributions bring it, or its entry point leads nowhere.
        RuleSetError: Malformed, breaks the schema, or contradicts itself or the rule
            set it extends.
        FormulaError: A formula cannot be parsed or names something unknown.
    """
    registry = registry or Registry()
    if isinstance(name, str):
        path = path_of_rule_set(name, Path(), registry)
    else:
        path = path_of(name, "the name or path of a rule set")
    document = expanded_document(path, (), registry)
    whole = _declared(with_penalty(document), registry)
    rule_set = _parsed(whole)
    unused = _unused(rule_set)
    _refuse_own(unused, document)
    # What is inherited and no longer used says nothing about these rules; as their own it would be refused.
    left = [name for name in unused if name in named_parameters(document.data.get("parameters", {}))]
    if left:
        stated = without_numbers(whole.data["parameters"], left)
        rule_set = _parsed(replace(whole, data={**whole.data, "parameters": stated}))
    return rule_set


def _unused(rule_set: RuleSet) -> list[str]:
    """The named parameters that no formula and no check names."""
    used = rule_set.sheet.parameters_named(
        item.formula for item in rule_set.printed.items if item.formula is not None
    )
    bodies = [body for key in ("rules", "monitors") for body in rule_set.expanded.get(key, {}).values()]
    used |= {name for body in bodies for name in references(body.get("with", {}))}
    return [name for name in rule_set.parameters if name not in used and name.partition(".")[0] not in used]


def _refuse_own(unused: Iterable[str], document: YamlDocument) -> None:
    """Refuse a parameter that the file itself states, and nothing uses: most often it is misspelt."""
    for name in unused:
        path = ("parameters", *name.split("."))
        if path in document.lines:
            others = [one for one in named_parameters(document.data["parameters"]) if one != name]
            raise RuleSetError(
                f"no formula and no check uses the parameter {name!r}",
                file=document.file,
                place=document.place(path),
                hint=f"{did_you_mean(name, others, what='others')}; otherwise take it out",
            )


def rule_set_from_text(text: str, *, file: str) -> RuleSet:
    """A rule set from its expanded text, as a result holds it.

    Raises:
        RuleSetError: It is not the text of a whole rule set.
        FormulaError: A formula cannot be parsed or names something unknown.
    """
    return _alone(text, file)


@lru_cache(maxsize=8)
def _alone(text: str, file: str) -> RuleSet:
    """Cached, because the results of a competition all hold the same text."""
    document = _of_today(parse_yaml(text.encode("utf-8"), file=file, error=RuleSetError))
    validate(document, "ruleset", error=RuleSetError)
    for key in ("extends", "include", "safety", "audit"):
        if key in document.data:
            raise RuleSetError("the rules of a result stand alone", file=file, place=f"$.{key}")
    return _parsed(document)


_LEVELS_BEFORE = ("part", "submission", "order", TRIAL)
_FACTS_BEFORE = {
    "submission": {"parts": "number"},
    "order": {"index": "number", "priority": "number", "parts": "number"},
    TRIAL: {"orders": "number"},
}
"""What every rule set had before levels and facts were declared; a text without any is of that time."""


def _of_today(document: YamlDocument) -> YamlDocument:
    """Rules as a result held them before they named levels, facts and a competition, as they are now."""
    data = document.data
    if not isinstance(data, Mapping) or "levels" in data:
        return document
    data = {**data, "levels": list(_LEVELS_BEFORE), "facts": _FACTS_BEFORE}
    return _with_competition(replace(document, data=data))


def _with_competition(document: YamlDocument) -> YamlDocument:
    """With the competition named whose parameters stood at the top of the rules."""
    for key, value in unknown_keys(document).items():
        for name in competitions_with(key, Registry()):
            kept = {k: v for k, v in document.data.items() if k != key}
            return replace(document, data={**kept, "competition": {"use": name, "with": {key: value}}})
    return document


def draft_rule_set(text: str, *, file: str) -> RuleSet:
    """A rule set from the text of a file that may include a penalty but extends nothing.

    Raises:
        RuleSetError: It is not the text of a rule set, or its penalty does not fit.
        FormulaError: A formula cannot be parsed or names something unknown.
    """
    document = written_document(text, file=file)
    rule_set = _parsed(_declared(with_penalty(document)))
    _refuse_own(_unused(rule_set), document)
    return rule_set


def expanded_yaml(rule_set: RuleSet) -> str:
    """The rule set as it is after `extends` and `include`, as YAML."""
    return rule_set.text


def _declared(document: YamlDocument, registry: Registry | None = None) -> YamlDocument:
    """The rule set with its levels and facts written out, its own before those of its competition.

    So that a result, which holds this text, is priced again without any plugin.

    Raises:
        PluginError: The competition is not installed, or declares levels or facts that are none.
        RuleSetError: The competition refuses its parameters.
    """
    data = document.data
    named = _competition(document)
    levels, facts = _of_competition(named, document.file, registry or Registry()) if named else ((TRIAL,), {})
    levels = tuple(data.get("levels", levels))
    own = data.get("facts", {})
    both = {
        level: {**facts.get(level, {}), **own.get(level, {})}
        for level in dict.fromkeys([*facts, *own])
        if level in levels or level in own
    }
    return replace(document, data={**data, "levels": list(levels), "facts": both})


def _of_competition(
    named: Check, file: str, registry: Registry
) -> tuple[tuple[str, ...], dict[str, dict[str, Any]]]:
    """Levels and facts that a competition declares, as a rule set writes them."""
    competition = _built(named, file, partial(registry.find, named.group, named.use))
    try:
        levels = tuple(getattr(competition, "levels", (TRIAL,)))
        check_levels(levels, {})
        return levels, facts_as_written(declared_facts(getattr(competition, "facts", {})))
    except (FormulaError, ValueError, TypeError, AttributeError) as cause:
        broken = PluginError(
            f"declares levels or facts that are none: {getattr(cause, 'cause', cause)}",
            origin=registry.find(named.group, named.use).origin,
            hint=f"levels are names, the last is {TRIAL!r}; facts are declared by level and name",
        )
        broken.file, broken.place = file, named.place["use"]
        raise broken from cause


def _parsed(written: YamlDocument) -> RuleSet:
    document = in_formulas(written)
    data = document.data
    parameters = _parameters(document)
    checks = _checks(document, parameters)
    _refuse_shadowing(document, parameters, checks)
    try:
        sheet = _sheet(data, checks, parameters)
        printed = _printed_text(data, sheet)
    except FormulaError as error:
        # Formulas are named by their path in the document, which becomes a line here.
        path = place_in(written.data, error.place.removeprefix("$.").split("."), error.cause)
        error.file, error.place = document.files.get(path[0], document.file), document.place(path)
        raise
    return RuleSet(
        id=data["id"],
        title=data["title"],
        source=data["source"],
        notes=tuple(data.get("notes", [])),
        log_map=data["log_map"],
        checks=checks,
        sheet=sheet,
        digits=data.get("round", 6),
        file=document.file,
        expanded=written.data,
        tables=tuple(tables_of(written.data)),
        ranking=data.get("ranking", {}),
        competition=_competition(document),
        differs=_differs(data["differs"]) if "differs" in data else None,
        ranges=_ranges(document, checks, parameters),
        breaks=data.get("breaks", {}),
        parameters=parameters,
        printed=printed,
        bounds=data.get("bounds", {}),
        between_samples=data.get("between_samples", "held"),
        counts=data.get("open", "worst"),
    )


def _parameters(document: YamlDocument) -> dict[str, NamedParameter]:
    stated = document.data.get("parameters", {})
    for name, body in stated.items():
        inner = body if isinstance(body, Mapping) else {}
        for path in ([name], *([name, one] for one in inner)):
            if (body if len(path) == 1 else inner[path[1]]) is None:
                raise RuleSetError(
                    f"there is no parameter {'.'.join(path)!r} to take away",
                    file=document.file,
                    place=document.place(["parameters", *path]),
                    hint="null takes away a parameter of the rule set that this one extends",
                )
    return named_parameters(stated)


def _refuse_shadowing(
    document: YamlDocument, parameters: Mapping[str, NamedParameter], checks: Mapping[str, Check]
) -> None:
    """Refuse a group of parameters whose name means something else before a point."""
    taken = {
        **dict.fromkeys(checks, "check"),
        **dict.fromkeys(("cohort", "runs"), "kind of value across runs"),
    }
    for group in groups_of(parameters):
        if group in taken:
            raise RuleSetError(
                f"the group of parameters {group!r} is also the name of a {taken[group]}",
                file=document.file,
                place=document.place(["parameters", group]),
                hint="each name must be one thing: give the group another one",
            )


def _checks(document: YamlDocument, parameters: Mapping[str, NamedParameter]) -> dict[str, Check]:
    """Rules and monitors, by name."""
    checks: dict[str, Check] = {}
    for key in ("rules", "monitors"):
        for name, body in document.data.get(key, {}).items():
            if name in checks:
                raise RuleSetError(
                    f"{name!r} is both a rule and a monitor",
                    file=document.file,
                    place=document.place([key, name]),
                    hint="formulas use these names: each must be one thing",
                )
            _refuse_reserved(document, key, name)
            checks[name] = _check(document, key, name, body, parameters)
    return checks


def _refuse_reserved(document: YamlDocument, key: str, name: str) -> None:
    """Refuse a check by whose name a formula, or its reader, would take it for something else."""
    taken = {**RESERVED, "level": document.data["levels"], "word of the language": keyword.kwlist}
    for what, names in taken.items():
        if name in names:
            raise RuleSetError(
                f"check {name!r} is also the name of a {what}",
                file=document.file,
                place=document.place([key, name]),
                hint=other_name({**RESERVED, "level": document.data["levels"]}),
            )


def _competition(document: YamlDocument) -> Check | None:
    body = document.data.get("competition")
    if body is None:
        return None
    parameters = body.get("with", {})
    places = {name: document.place(["competition", "with", name]) for name in parameters}
    places |= {"use": document.place(["competition", "use"]), "": document.place(["competition"])}
    return Check("competition", body["use"], COMPETITIONS, parameters, place=places)


def _sheet(
    data: Mapping[str, Any], checks: Mapping[str, Check], parameters: Mapping[str, NamedParameter]
) -> ScoreSheet:
    """The formulas of a rule set, with the names they may use."""
    return ScoreSheet(
        terms={
            level: {
                name: Expression.parse(text, where=f"$.terms.{level}.{name}", texts=True)
                for name, text in data.get("terms", {}).get(level, {}).items()
            }
            for level in data.get("terms", {})
        },
        score=Expression.parse(data["score"], where="$.score", texts=True),
        checks=frozenset(checks),
        parameters={name: one.value for name, one in parameters.items()},
        cohort={name: _cohort_term(name, body) for name, body in data.get("cohort", {}).items()},
        task=Expression.parse(data["task"], where="$.task", texts=True) if "task" in data else None,
        levels=tuple(data["levels"]),
        facts=declared_facts(data.get("facts", {})),
    )


def _printed_text(data: Mapping[str, Any], sheet: ScoreSheet) -> PrintedText:
    for key in ("printed", "adds_up"):
        for level in data.get(key, {}):
            if level not in (*sheet.levels, LAYOUTS):
                raise no_such_level(level, sheet.levels, place=f"$.{key}.{level}", where=key)
    items = [
        _printed_item(name, level, body, sheet)
        for level, named in data.get("printed", {}).items()
        if level != LAYOUTS
        for name, bodies in named.items()
        for body in _one_or_more(bodies)
    ]
    sums = [
        PrintedSum(
            name,
            level,
            Expression.parse(body["formula"], where=f"$.adds_up.{level}.{name}"),
            body.get("kind", ""),
            body.get("relation", "equal"),
            body.get("because", ""),
        )
        for level, named in data.get("adds_up", {}).items()
        for name, bodies in named.items()
        for body in _one_or_more(bodies)
    ]
    layouts = tuple(data.get("printed", {}).get(LAYOUTS, ()))
    return PrintedText(layouts, tuple(items), tuple(sums), sheet.levels)


def _one_or_more(bodies: Any) -> list[dict[str, Any]]:
    """A formula, one body or several: all as bodies."""
    if isinstance(bodies, list):
        return bodies
    return [bodies if isinstance(bodies, dict) else {"formula": bodies}]


def _printed_item(name: str, level: str, body: Mapping[str, Any], sheet: ScoreSheet) -> PrintedItem:
    formula = None
    if "formula" in body:
        formula = Expression.parse(body["formula"], where=f"$.printed.{level}.{name}", texts=True)
        # `score` in a text of rules that compare teams is what one team alone can know: the task score.
        if level == "trial" and formula.as_name == _SCORE and _SCORE not in sheet.terms.get(level, {}):
            formula = (sheet.task if sheet.needs_cohort else None) or sheet.score
        sheet.check_formula(formula, level)
    labels = tuple(body.get("labels", (name,)))
    return PrintedItem(
        name, level, labels, formula, body.get("kind", ""), body.get("within"), body.get("because", "")
    )


def _differs(stated: Mapping[str, Any]) -> Differences:
    return Differences(
        stated["from"],
        tuple(
            RuleDifference(
                name=each["name"],
                terms=tuple(each.get("terms", [])),
                checks=tuple(each.get("checks", [])),
                coded=each["coded"],
                documented=each["documented"],
                source=each["source"],
            )
            for each in stated["because"]
        ),
    )


def _ranges(
    document: YamlDocument, checks: Mapping[str, Check], parameters: Mapping[str, NamedParameter]
) -> dict[str, tuple[float, float]]:
    ranges = {}
    for name, ends in document.data.get("ranges", {}).items():
        place = document.place(["ranges", name])
        if ends is None:
            raise RuleSetError(
                f"there is no range of {name!r} to take away",
                file=document.file,
                place=place,
                hint="only a rule set that 'extends' another one with that range can",
            )
        low, high = ends
        check, dot, _ = name.partition(".")  # `check.parameter`, or a parameter of the formulas
        known: Iterable[str] = checks if dot else parameters
        if name not in parameters and (check if dot else name) not in known:
            what = "check" if dot else "parameter"
            raise RuleSetError(
                f"a range is given for {name!r}, but there is no such {what}",
                file=document.file,
                place=place,
                hint=did_you_mean(check, known, what=f"{what}s of this rule set"),
            )
        if not low < high:
            raise RuleSetError(
                f"the range of {name!r} goes from {low:g} to {high:g}",
                file=document.file,
                place=place,
                hint="give the lower value first",
            )
        ranges[name] = (low, high)
    return ranges


def _cohort_term(name: str, body: Mapping[str, Any]) -> CohortTerm:
    return CohortTerm(
        name=name,
        level=body["of"],
        value=Expression.parse(body["mean"], where=f"$.cohort.{name}.mean", texts=True),
        where=Expression.parse(body["where"], where=f"$.cohort.{name}.where", texts=True)
        if "where" in body
        else None,
        empty=body.get("empty"),
    )


def _check(
    document: YamlDocument,
    key: str,
    name: str,
    body: dict[str, Any],
    parameters: Mapping[str, NamedParameter],
) -> Check:
    if "use" not in body:
        raise RuleSetError(
            f"key 'use' is missing, and there is no check {name!r} to change",
            file=document.file,
            place=document.place([key, name]),
            hint="add 'use'; without it a check changes the one of that name in what is extended",
        )
    stated = body.get("with", {})
    given = {}
    for parameter, value in stated.items():
        try:
            given[parameter] = with_values(value, parameters)
        except RuleSetError as error:
            error.file, error.place = document.file, document.place([key, name, "with", parameter])
            raise
    places = {p: document.place([key, name, "with", p]) for p in given}
    return Check(
        name=name,
        use=body["use"],
        group=f"ariac_score.{key}",
        parameters=given,
        on_inconclusive=body.get("on_inconclusive", OPEN),
        named={parameter: named for parameter, value in stated.items() for named in references(value)},
        place={**places, "use": document.place([key, name, "use"]), "": document.place([key, name])},
    )


def differences(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    """What differs between two expanded rule sets: place, before, after; `None` where one has nothing."""
    return _differences("$", first, second)


def _differences(place: str, first: Any, second: Any) -> Iterator[tuple[str, Any, Any]]:
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        for key in dict.fromkeys([*first, *second]):
            yield from _differences(f"{place}.{key}", first.get(key), second.get(key))
    elif first != second:
        yield place, first, second
