"""Rule sets: loading and checking the YAML that says what is looked at and what it is worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ariac_score.datafiles import YamlDocument, load_yaml, shipped_rules, validate
from ariac_score.errors import FormulaError, PluginError, RuleSetError, ScoreError, UsageError, did_you_mean
from ariac_score.expression import Expression
from ariac_score.registry import Registry
from ariac_score.scoring.scope import LEVELS
from ariac_score.scoring.sheet import ScoreSheet

__all__ = ["Check", "RuleSet", "load_rule_set", "rule_set_names"]

_DEFAULT = "ruleset"
_NOT_RULE_SETS = frozenset({"log_map"})


@dataclass(frozen=True)
class Check:
    """One use of a plugin in a rule set.

    Attributes:
        name: Its name in the rule set, which formulas use.
        use: Entry-point name of the plugin.
        group: Entry-point group: rules or monitors.
        parameters: Its `with:` block.
        on_inconclusive: What an undecided finding means for the score.
        place: Line and path of the check in its file, by parameter name.
    """

    name: str
    use: str
    group: str
    parameters: Mapping[str, Any] = field(default_factory=dict)
    on_inconclusive: str = "withhold"
    place: Mapping[str, str] = field(default_factory=dict)


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
        sha256: Hash of the file.
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
    sha256: str

    def build(self, registry: Registry) -> dict[str, Any]:
        """Every check's plugin, built with its parameters, by check name.

        Raises:
            PluginNotFoundError: A plugin is not installed; the message names the check.
            RuleSetError: A plugin refuses its parameters.
        """
        built: dict[str, Any] = {}
        for check in self.checks.values():
            try:
                plugin = registry.find(check.group, check.use)
                built[check.name] = plugin.build(check.parameters, place=lambda p, c=check: c.place.get(p, p))  # type: ignore[misc]
            except (PluginError, RuleSetError) as error:
                raise self._located(error, check) from error
        return built

    def _located(self, error: ScoreError, check: Check) -> ScoreError:
        error.file = self.file
        error.place = error.place or check.place.get("use", check.name)
        return error


def rule_set_names() -> list[str]:
    """The shipped rule sets."""
    return sorted(_shipped())


def _shipped() -> dict[str, Path]:
    shipped = {}
    for name, path in shipped_rules().items():
        edition, _, last = name.rpartition(".")
        if last not in _NOT_RULE_SETS:
            shipped[edition if last == _DEFAULT else name] = path
    return shipped


def load_rule_set(name: str) -> RuleSet:
    """Load a shipped rule set by name, or one from a file by its path.

    Args:
        name: Such as `paper2020`, or a path ending in `.yaml`.

    Raises:
        UsageError: There is no rule set of that name.
        RuleSetError: Malformed, breaks the schema, or contradicts itself.
        FormulaError: A formula cannot be parsed or names something unknown.
    """
    if name.endswith((".yaml", ".yml")) or "/" in name:
        path = Path(name)
    else:
        shipped = _shipped()
        if name not in shipped:
            raise UsageError(
                f"there is no rule set {name!r}",
                hint=did_you_mean(name, shipped, what="shipped rule sets")
                + "; a path to a .yaml file works too",
            )
        path = shipped[name]
    document = load_yaml(path, error=RuleSetError)
    validate(document, "ruleset", error=RuleSetError)
    return _parsed(document)


def _parsed(document: YamlDocument) -> RuleSet:
    data = document.data
    checks: dict[str, Check] = {}
    for key in ("rules", "monitors"):
        for name, body in data.get(key, {}).items():
            if name in checks:
                raise RuleSetError(
                    f"{name!r} is both a rule and a monitor",
                    file=document.file,
                    place=document.place([key, name]),
                    hint="formulas use these names: each must be one thing",
                )
            checks[name] = _check(document, key, name, body)
    try:
        sheet = ScoreSheet(
            terms={
                level: {
                    name: Expression.parse(text, where=f"$.terms.{level}.{name}")
                    for name, text in data.get("terms", {}).get(level, {}).items()
                }
                for level in LEVELS
            },
            score=Expression.parse(data["score"], where="$.score"),
            checks=frozenset(checks),
            parameters=data.get("parameters", {}),
        )
    except FormulaError as error:
        error.file = document.file
        error.place = document.place(error.place.removeprefix("$.").split("."))
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
        sha256=document.sha256,
    )


def _check(document: YamlDocument, key: str, name: str, body: dict[str, Any]) -> Check:
    parameters = body.get("with", {})
    places = {p: document.place([key, name, "with", p]) for p in parameters}
    return Check(
        name=name,
        use=body["use"],
        group=f"ariac_score.{key}",
        parameters=parameters,
        on_inconclusive=body.get("on_inconclusive", "withhold"),
        place={**places, "use": document.place([key, name, "use"]), "": document.place([key, name])},
    )
