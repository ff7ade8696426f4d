"""How runs become a ranking: the `ranking:` block of a rule set, checked against its score sheet."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score.documents.schema import schema_errors
from ariac_score.errors import DataFileError, FormulaError, PluginError, RuleSetError, did_you_mean
from ariac_score.ranking.totals import SUM, Total, total_named
from ariac_score.scoring.expression import Expression, Number, Traced
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["COUNT_BACK", "Intervals", "Key", "Spec", "places", "ranking_spec"]

TEAM_NAMES = ("execution", "judges")
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
COUNT_BACK = "count_back"
"""The tie-break by places: more trials won, then more second places, and so on."""
_FUNCTIONS = ("rank", "share")


@dataclass(frozen=True)
class Key:
    """One criterion by which runs or teams are compared.

    Attributes:
        name: `score`, `task`, `execution`, `judges`, a term of the trial, or `count_back`.
        highest: Whether more is better.
    """

    name: str
    highest: bool

    def sortable(self, value: float | Decimal | None) -> tuple[int, float | Decimal]:
        """A sort key that puts the better first, and what has no value last."""
        return (1, 0.0) if value is None else (0, -value if self.highest else value)


@dataclass(frozen=True)
class Intervals:
    """How the uncertainty of ranks is estimated.

    Attributes:
        resample: What is drawn: `trials_and_runs`, `trials` (each with its runs), or `runs`.
        draws: Number of competitions drawn.
        seed: Of the random numbers.
        level: Confidence level of intervals and groups.
    """

    resample: str = "trials_and_runs"
    draws: int = 10_000
    seed: int = 1
    level: float = 0.95


@dataclass(frozen=True)
class Spec:
    """How runs become a ranking; by default as where a rule set says nothing of it.

    Attributes:
        keep: How many runs of a trial count.
        by: What makes a run better.
        fill: Whether a run that was not made enters the mean, as 0 or the worst score kept.
        judges: `sum` or `mean` of the judges' marks.
        value: What teams are ranked by.
        highest: Whether the highest value comes first.
        ties: What separates teams of equal value.
        strict: The organisers' own program, whose ranking is shown too; empty for none.
        intervals: How the uncertainty of ranks is estimated.
        total: How the scores of a team in its trials become its execution.
    """

    keep: int = 1
    by: tuple[Key, ...] = (Key("score", highest=True),)
    fill: bool = True
    judges: str = "sum"
    value: Expression = field(default_factory=lambda: Expression.parse("execution"))
    highest: bool = True
    ties: tuple[Key, ...] = ()
    strict: str = ""
    intervals: Intervals = field(default_factory=Intervals)
    total: Total = field(default_factory=Total)

    @property
    def terms(self) -> tuple[str, ...]:
        """The terms of the trial that runs or teams are compared by."""
        names = [key.name for key in (*self.by, *self.ties)]
        return tuple(dict.fromkeys(n for n in names if n not in ("score", "task", COUNT_BACK, *TEAM_NAMES)))

    @property
    def more_is_better(self) -> bool:
        """Whether points are good: of two teams equal otherwise, whether the one with more comes first."""
        # Tried, because `value` is a formula: `lowest` of a sum of ranks still rewards points.
        try:
            one, two = self.values([{"execution": Decimal(n), "judges": Decimal(1)} for n in (1, 2)])
        except FormulaError:  # such as a division by 0 for these two
            return self.highest
        assert one is not None  # both have execution and judges, and there is nothing else to need
        assert two is not None
        return one == two or (two > one) == self.highest

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

    def columns(self, execution: FloatArray, judges: FloatArray | None) -> FloatArray:
        """The value of each team in each of many competitions; `values` computes it for one.

        Args:
            execution: Shape (teams, competitions).
            judges: Shape (teams,), where the value needs it.

        Raises:
            FormulaError: One of them has no value, such as by a division by zero.
        """
        given = {"execution": execution}
        if judges is not None:
            given["judges"] = np.repeat(judges[:, None], execution.shape[1], axis=1)
        names: dict[str, FloatArray] = dict(given)
        root = _CallsAsNames(given, names).visit(ast.parse(self.value.source, mode="eval"))
        formula = Expression.parse(ast.unparse(root), where=self.value.where)
        return formula.columns({name: column.ravel() for name, column in names.items()}).reshape(
            execution.shape
        )


class _CallsAsNames(ast.NodeTransformer):
    """Calls of `rank` and `share` replaced by names of the columns they evaluate to.

    Formulas over columns know only arithmetic; a rank is a comparison with all other teams.
    """

    def __init__(self, given: Mapping[str, FloatArray], names: dict[str, FloatArray]) -> None:
        self.given, self.names = given, names

    def visit_Call(self, node: ast.Call) -> ast.expr:  # the name ast asks for
        """`rank(execution)` becomes the name `rank_of_execution`."""
        self.generic_visit(node)
        if not isinstance(node.func, ast.Name) or node.func.id not in _FUNCTIONS:
            return node
        assert isinstance(node.args[0], ast.Name)  # checked when the spec was read
        function, name = node.func.id, node.args[0].id
        column = self.given[name]
        made = places([column]) if function == "rank" else _shares(column)
        self.names[f"{function}_of_{name}"] = made.astype(np.float64)
        return ast.copy_location(ast.Name(f"{function}_of_{name}", ast.Load()), node)


def places(keys: Sequence[FloatArray]) -> IntArray:
    """The place of each team in each column: 1, and one more for each better team.

    Of two teams the first key on which they differ decides; equal ones share a place.

    Args:
        keys: Most important first, each of shape (teams, competitions), more is better.

    >>> places([np.array([[2.0], [3.0], [2.0]])]).ravel()
    array([2, 1, 2])
    """
    first = keys[0]
    found = np.empty(first.shape, dtype=np.int64)
    for team in range(len(first)):
        better = first > first[team]
        if len(keys) > 1:
            equal = first == first[team]
            for key in keys[1:]:
                if np.count_nonzero(equal) == first.shape[1]:
                    break  # in every column it is equal to itself alone
                better |= equal & (key > key[team])
                equal &= key == key[team]
        found[team] = 1 + np.count_nonzero(better, axis=0)
    return found


def _shares(column: FloatArray) -> FloatArray:
    top = column.max(axis=0)
    # numpy computes both branches, so the divisor must not be 0 in either.
    return np.where(top > 0, column / np.where(top > 0, top, 1.0), 0.0)


class _Team:
    """The environment in which `value` is evaluated for one team."""

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
        assert own is not None  # `values` leaves out teams without it
        if function == "rank":
            return Traced(f"rank({name})", 1 + sum(1 for value in all_values if value > own), "fact")
        top = max(all_values)
        return Traced(f"share({name})", float(own) / float(top) if top > 0 else 0.0, "fact")


def ranking_spec(rule_set: RuleSet, overrides: Mapping[str, Any], *, file: str) -> Spec:
    """The ranking of a rule set, changed as the competition declares.

    Args:
        rule_set: Whose `ranking:` block is the base.
        overrides: The competition's own block.
        file: The competition's file, for messages.

    Raises:
        DataFileError: It names something that does not exist, or a new value without its best end.
    """
    data = {**rule_set.ranking, **overrides}
    faults = schema_errors(data, "ruleset", "ranking")
    if faults:
        place = "$.ranking" + "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in faults[0][0])
        raise DataFileError(faults[0][1], file=file, place=place, hint=faults[0][2])
    if "value" in overrides and "best" not in overrides:
        raise DataFileError(
            "it says by what teams are ranked, but not which end comes first",
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
        intervals=Intervals(**data.get("intervals", {})),
        total=_total(data.get("total", SUM), file),
    )


def _keys(data: Sequence[Mapping[str, str]], known: Sequence[str], place: str, file: str) -> tuple[Key, ...]:
    keys = []
    for number, entry in enumerate(data):
        ((direction, name),) = entry.items()
        if direction == COUNT_BACK:
            keys.append(Key(COUNT_BACK, highest=True))
            continue
        if name not in known:
            raise DataFileError(
                f"{name!r} is nothing that can be compared here",
                file=file,
                place=f"$.ranking.{place}[{number}]",
                hint=did_you_mean(name, known),
            )
        keys.append(Key(name, direction == "highest"))
    return tuple(keys)


def _total(name: str, file: str) -> Total:
    try:
        return total_named(name)
    except PluginError as error:
        error.file, error.place = error.file or file, error.place or "$.ranking.total"
        raise


def _value(text: str | float, file: str) -> Expression:
    try:
        formula = Expression.parse(text, where="$.ranking.value")
        _check_value(formula)
    except FormulaError as error:
        raise RuleSetError(error.cause, file=file, place=error.place, hint=error.hint) from error
    return formula


def _check_value(formula: Expression) -> None:
    calls = [node for node in formula.walk() if isinstance(node, ast.Call)]
    functions = {id(call.func) for call in calls}
    for node in formula.walk():
        if isinstance(node, ast.Name | ast.Attribute) and id(node) not in functions:
            name = ast.unparse(node)
            if name not in TEAM_NAMES:
                raise FormulaError(
                    f"unknown name {name!r}", place=formula.where, hint=did_you_mean(name, TEAM_NAMES)
                )
    for call in calls:
        function = ast.unparse(call.func)
        if function in _FUNCTIONS and not (len(call.args) == 1 and isinstance(call.args[0], ast.Name)):
            raise FormulaError(
                f"{function}() takes one name", place=formula.where, hint=f"{function}(execution)"
            )
