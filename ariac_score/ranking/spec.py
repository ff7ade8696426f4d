"""How runs become a ranking: the `ranking:` block of a rule set, checked against its score sheet."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

from ariac_score.datafiles import schema_errors
from ariac_score.errors import DataFileError, FormulaError, RuleSetError, did_you_mean
from ariac_score.expression import Expression, Number, Traced
from ariac_score.ruleset import RuleSet

__all__ = ["Key", "Spec", "ranking_spec"]

TEAM_NAMES = ("execution", "judges")
_FUNCTIONS = ("rank", "share")


@dataclass(frozen=True)
class Key:
    """One thing runs or teams are compared by.

    Attributes:
        name: `score`, `task`, `execution`, `judges`, or a term of the trial.
        highest: Whether more is better.
    """

    name: str
    highest: bool

    def sortable(self, value: float | Decimal | None) -> tuple[int, float | Decimal]:
        """So that the better comes first; what has no value comes last."""
        return (1, 0.0) if value is None else (0, -value if self.highest else value)


@dataclass(frozen=True)
class Spec:
    """How runs become a ranking.

    Attributes:
        keep: How many runs of a trial count.
        by: What makes a run better.
        fill: Whether a run that was not made counts as 0.
        judges: `sum` or `mean` of the judges' marks.
        value: What teams are ranked by.
        highest: Whether the highest value comes first.
        ties: What separates teams of equal value.
        strict: The organisers' own program that is reproduced beside; empty for none.
    """

    keep: int
    by: tuple[Key, ...]
    fill: bool
    judges: str
    value: Expression
    highest: bool
    ties: tuple[Key, ...]
    strict: str = ""

    @property
    def terms(self) -> tuple[str, ...]:
        """The terms of the trial that runs or teams are compared by."""
        names = [key.name for key in (*self.by, *self.ties)]
        return tuple(dict.fromkeys(n for n in names if n not in ("score", "task", *TEAM_NAMES)))

    def values(self, teams: Sequence[Mapping[str, Decimal | None]]) -> list[Number | None]:
        """The value of each team; `None` where it needs marks that were not given.

        Args:
            teams: For each team its `execution` and `judges`.
        """
        needed = {node.id for node in self.value.walk() if isinstance(node, ast.Name)} & set(TEAM_NAMES)
        values: list[Number | None] = []
        for team in teams:
            if any(team[name] is None for name in needed):
                values.append(None)
            else:
                values.append(self.value.evaluate(_Team(team, teams)).value)
        return values


class _Team:
    """What the names and functions of `value` mean for one team."""

    def __init__(
        self, own: Mapping[str, Decimal | None], everyone: Sequence[Mapping[str, Decimal | None]]
    ) -> None:
        self.own, self.everyone = own, everyone

    def name(self, dotted: str) -> Traced:
        """Execution or the judges' marks."""
        value = self.own.get(dotted)
        if value is None:
            raise FormulaError(f"{dotted!r} has no value for a team")
        return Traced(dotted, float(value), "fact")

    def call(
        self, function: str, arguments: Sequence[Expression], options: Mapping[str, Number]
    ) -> Traced | None:
        """`rank(x)`: 1 for the highest, equal ones share; `share(x)`: part of the highest."""
        if function not in _FUNCTIONS or options or len(arguments) != 1:
            return None
        name = arguments[0].as_name
        known = [team[name] for team in self.everyone]
        all_values = [value for value in known if value is not None]
        own = self.own[name]
        assert own is not None  # `values` asks only for teams that have it
        if function == "rank":
            return Traced(f"rank({name})", 1 + sum(1 for value in all_values if value > own), "fact")
        top = max(all_values)
        return Traced(f"share({name})", float(own) / float(top) if top > 0 else 0.0, "fact")


def ranking_spec(rule_set: RuleSet, overrides: Mapping[str, Any], *, file: str) -> Spec:
    """The ranking of a rule set with what a competition changes.

    Args:
        rule_set: Whose `ranking:` block is the base.
        overrides: The competition's own block.
        file: The competition's file, for messages.

    Raises:
        DataFileError: It names something that does not exist.
    """
    data = {**rule_set.ranking, **overrides}
    faults = schema_errors(data, "ruleset", "ranking")
    if faults:
        place = "$.ranking" + "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in faults[0][0])
        raise DataFileError(faults[0][1], file=file, place=place, hint=faults[0][2])
    if "value" in overrides and "best" not in overrides:
        raise DataFileError(
            "it says by what teams are ranked, and not which end comes first",
            file=file,
            place="$.ranking.value",
            hint="add 'best: highest' or 'best: lowest'",
        )
    whole = "task" if rule_set.sheet.task else "score"
    terms = list(rule_set.sheet.terms.get("trial", {}))
    by = _keys(data.get("by", [{"highest": whole}]), ["score", "task", *terms], "by", file)
    if any(key.name == "task" for key in by) and rule_set.sheet.task is None:
        raise DataFileError(
            f"{rule_set.id} has no task score",
            file=file,
            place="$.ranking.by",
            hint="compare runs by score, or give the rule set a 'task:'",
        )
    return Spec(
        keep=data.get("keep", 1),
        by=by,
        fill=data.get("missing_run", "zero") == "zero",
        judges=data.get("judges", "sum"),
        value=_value(data.get("value", "execution"), file),
        highest=data.get("best", "highest") == "highest",
        ties=_keys(data.get("ties", []), [*TEAM_NAMES, *terms], "ties", file),
        strict=data.get("strict", ""),
    )


def _keys(data: Sequence[Mapping[str, str]], known: Sequence[str], place: str, file: str) -> tuple[Key, ...]:
    keys = []
    for number, entry in enumerate(data):
        ((direction, name),) = entry.items()
        if name not in known:
            raise DataFileError(
                f"{name!r} is nothing that can be compared here",
                file=file,
                place=f"$.ranking.{place}[{number}]",
                hint=did_you_mean(name, known),
            )
        keys.append(Key(name, direction == "highest"))
    return tuple(keys)


def _value(text: str | float, file: str) -> Expression:
    try:
        formula = Expression.parse(text, where="$.ranking.value")
        _check_value(formula)
    except FormulaError as error:
        raise RuleSetError(error.cause, file=file, place=error.place, hint=error.hint) from error
    return formula


def _check_value(formula: Expression) -> None:
    calls = {
        node.func.id: node
        for node in formula.walk()
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    for node in formula.walk():
        if isinstance(node, ast.Attribute) or (
            isinstance(node, ast.Name) and node.id not in (*TEAM_NAMES, *calls)
        ):
            name = ast.unparse(node)
            raise FormulaError(
                f"unknown name {name!r}", place=formula.where, hint=did_you_mean(name, TEAM_NAMES)
            )
    for function in _FUNCTIONS:
        asked = calls.get(function)
        if asked is not None and (len(asked.args) != 1 or not isinstance(asked.args[0], ast.Name)):
            raise FormulaError(
                f"{function}() takes one name", place=formula.where, hint=f"{function}(execution)"
            )
