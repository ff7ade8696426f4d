"""The score of a rule set as one tree over the quantities of its checks, with the terms it is made of."""

from __future__ import annotations

import ast
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any

from ariac_score.checks.measures import Measure
from ariac_score.review.proofs.quantities import (
    DURATION,
    FACT,
    TEAMS,
    UNKNOWN,
    VIOLATIONS,
    Quantity,
    of_charge,
    of_monitor,
    of_rule,
)
from ariac_score.scoring.expression import COMPARISONS, Expression, known_value, text_of
from ariac_score.scoring.levels import ALWAYS, TEXT, TRIAL, DeclaredFact
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.scoring.sheet import AGAIN_AFTER_S, AGGREGATES, CHECK_FUNCTIONS

__all__ = [
    "Each",
    "Known",
    "Node",
    "Op",
    "Taken",
    "Term",
    "bare",
    "inputs_of",
    "parts_of",
    "text",
    "trees",
]


@dataclass(frozen=True)
class Known:
    """A number."""

    value: float


@dataclass(frozen=True)
class Taken:
    """A quantity of the trial."""

    quantity: Quantity


@dataclass(frozen=True)
class Op:
    """An operation or function of numbers; `if` has condition, value and other value."""

    name: str
    of: tuple[Node, ...]


@dataclass(frozen=True)
class Each:
    """An aggregate over the scopes of a level, of which there are as many as the work has."""

    name: str
    level: str
    of: Node


@dataclass(frozen=True)
class Term:
    """A named term."""

    name: str
    of: Node


Node = Known | Taken | Op | Each | Term


def parts_of(node: Node) -> tuple[Node, ...]:
    """The nodes it is made of."""
    if isinstance(node, Op):
        return node.of
    return (node.of,) if isinstance(node, Each | Term) else ()


def bare(node: Node) -> Node:
    """A tree without the names of terms around it, so that a term and its formula are one."""
    while isinstance(node, Term):
        node = node.of
    return node


def inputs_of(node: Node) -> Iterator[Quantity]:
    """Every quantity in a tree, as often as it is there."""
    if isinstance(node, Taken):
        yield node.quantity
    for part in parts_of(node):
        yield from inputs_of(part)


def text(node: Node) -> str:
    """A tree as a formula, terms by their names."""
    if isinstance(node, Known):
        return f"{node.value:g}"
    if isinstance(node, Taken):
        return node.quantity.name
    if isinstance(node, Term):
        return node.name
    inner = [text(part) for part in parts_of(node)]
    if isinstance(node, Each):
        return f"{node.name}({inner[0]} of each {node.level})"
    if node.name == "if":
        return f"{inner[1]} if {inner[0]} else {inner[2]}"
    if node.name in ("+", "*", "/", "**", "<", "<=", "==", "!=", "and", "or"):
        bare = [
            f"({one})" if isinstance(part, Op) and part.name in _LOOSE else one
            for one, part in zip(inner, node.of, strict=True)
        ]
        return f" {node.name} ".join(bare)
    return f"{node.name}({', '.join(inner)})"


_LOOSE = frozenset({"+", "if", "and", "or", "<", "<=", "==", "!=", "/"})


def trees(
    rule_set: RuleSet,
    terms: Iterable[str],
    *,
    events: frozenset[str],
    bridged: Mapping[str, float],
    measures: Mapping[str, Mapping[str, Measure]],
    safety: Collection[str],
    facts: Mapping[str, Mapping[str, DeclaredFact]],
    range_of: Callable[[Node], tuple[float, float]],
) -> tuple[Term, dict[str, Term]]:
    """The score of a rule set, before it is rounded, and terms of the trial by name.

    Args:
        rule_set: Checked in itself.
        terms: Which terms.
        events: Its monitors that speak of single events.
        bridged: Below which pause each other monitor makes one of two violations, s.
        measures: What checks declare of their quantities, by check and quantity.
        safety: Its monitors whose violations are priced. What another one that watches nothing says, such as
            what an official record shows, is taken as it is.
        facts: What the competition declares of the facts of its work, by level and name.
        range_of: Between what the values of a tree lie, which a mean over teams lies between as well.
    """
    grower = _Grower(rule_set, events, bridged, measures, frozenset(safety), facts, range_of)
    score = Term("score", grower.grow(rule_set.sheet.score, TRIAL))
    return score, {name: grower.term(TRIAL, name) for name in terms}


@dataclass
class _Grower:
    rule_set: RuleSet
    events: frozenset[str]
    bridged: Mapping[str, float]
    measures: Mapping[str, Mapping[str, Measure]]
    safety: frozenset[str]
    facts: Mapping[str, Mapping[str, DeclaredFact]]
    range_of: Callable[[Node], tuple[float, float]]
    _terms: dict[tuple[str, str], Term] = field(default_factory=dict)

    def grow(self, formula: Expression, level: str) -> Node:
        """The tree of a formula of one level."""
        return _Growing(self, formula, level).grow(formula.root)

    def term(self, level: str, name: str) -> Term:
        if (level, name) not in self._terms:
            formula = self.rule_set.sheet.terms[level][name]
            label = name if level == TRIAL else f"{level}.{name}"
            self._terms[level, name] = Term(label, self.grow(formula, level))
        return self._terms[level, name]

    def mean_of(self, dotted: str) -> Quantity:
        """A mean over teams, which lies between what each of them can contribute."""
        term = self.rule_set.sheet.cohort[dotted.removeprefix("cohort.")]
        least, most = self.range_of(self.grow(term.value, term.level))
        if term.empty is not None:
            least, most = min(least, term.empty), max(most, term.empty)
        return Quantity(dotted, TEAMS, least, most)

    def least_of(self, level: str, name: str) -> float:
        """What a fact is never less than."""
        declared = self.facts.get(level, {}).get(name)
        return -inf if declared is None or declared.least is None else declared.least

    def number(self, formula: Expression) -> float | None:
        """What a formula is where it names nothing but parameters; else `None`."""
        return known_value(formula, self.rule_set.sheet.parameters)


@dataclass
class _Growing:
    grower: _Grower
    formula: Expression
    level: str

    def grow(self, node: ast.AST) -> Node:
        grown: Callable[[Any], Node] = getattr(self, f"grow_{type(node).__name__.lower()}")
        return grown(node)

    def grow_constant(self, node: ast.Constant) -> Node:
        assert isinstance(node.value, int | float)
        return Known(float(node.value))

    def grow_name(self, node: ast.Name | ast.Attribute) -> Node:
        dotted = text_of(node)
        sheet = self.grower.rule_set.sheet
        prefix, _, name = dotted.rpartition(".")
        if dotted in sheet.parameters:
            return Known(float(sheet.parameters[dotted]))
        if prefix == "cohort":
            return Taken(self.grower.mean_of(dotted))
        if prefix == "runs":
            return Op("runs", (self.grower.term(TRIAL, name),))
        level = prefix or self.level
        if name in sheet.facts_of(level):
            return Taken(self._fact(level, name))
        return self.grower.term(level, name)

    grow_attribute = grow_name

    def _fact(self, level: str, name: str) -> Quantity:
        if level == TRIAL and name in ALWAYS[TRIAL]:
            return Quantity(f"{TRIAL}.{name}", DURATION)
        least = 0.0 if name == "index" else self.grower.least_of(level, name)
        return Quantity(f"{level}.{name}", FACT, least, inf)

    def grow_binop(self, node: ast.BinOp) -> Node:
        left, right = self.grow(node.left), self.grow(node.right)
        names = {ast.Add: "+", ast.Sub: "+", ast.Mult: "*", ast.Div: "/", ast.Pow: "**"}
        if isinstance(node.op, ast.Sub):
            right = _times(-1, right)
        return Op(names[type(node.op)], (left, right))

    def grow_unaryop(self, node: ast.UnaryOp) -> Node:
        operand = self.grow(node.operand)
        if isinstance(node.op, ast.Not):
            return Op("not", (operand,))
        return _times(-1, operand) if isinstance(node.op, ast.USub) else operand

    def grow_boolop(self, node: ast.BoolOp) -> Node:
        return Op("or" if isinstance(node.op, ast.Or) else "and", tuple(map(self.grow, node.values)))

    def grow_compare(self, node: ast.Compare) -> Node:
        sides: list[ast.expr] = [node.left, *node.comparators]
        if any(self._is_text(side) for side in sides):
            return Taken(Quantity(text_of(node), FACT, 0, 1, switch=True))
        found: list[Node] = []
        for op, left, right in zip(node.ops, sides, sides[1:], strict=False):
            symbol, _ = COMPARISONS[type(op)]
            one, other = self.grow(left), self.grow(right)
            if symbol in (">", ">="):
                one, other, symbol = other, one, symbol.replace(">", "<")
            found.append(Op(symbol, (one, other)))
        return found[0] if len(found) == 1 else Op("and", tuple(found))

    def _is_text(self, node: ast.expr) -> bool:
        if isinstance(node, ast.Constant):
            return isinstance(node.value, str)
        level, _, name = text_of(node).rpartition(".")
        fact = (
            self.grower.rule_set.sheet.facts_of(level).get(name) if isinstance(node, ast.Attribute) else None
        )
        return fact is not None and fact.type == TEXT

    def grow_ifexp(self, node: ast.IfExp) -> Node:
        return Op("if", (self.grow(node.test), self.grow(node.body), self.grow(node.orelse)))

    def grow_call(self, node: ast.Call) -> Node:
        assert isinstance(node.func, ast.Name)
        function, sheet = node.func.id, self.grower.rule_set.sheet
        first = text_of(node.args[0]) if node.args else ""
        if function == "absent":
            return Taken(Quantity(text_of(node), FACT, 0, 1, switch=True))
        if function == "count" and first in sheet.levels:
            return Taken(Quantity(text_of(node), FACT, 0, inf))
        if function == "charged":
            return self._charged(node)
        if function in CHECK_FUNCTIONS and first in sheet.checks:
            return self._of_check(function, first, node)
        inner = sheet.levels[: sheet.levels.index(self.level)]
        named = {
            text_of(n).split(".")[0] for a in node.args for n in ast.walk(a) if isinstance(n, ast.Attribute)
        }
        level = next((one for one in reversed(inner) if one in named), "") if len(node.args) == 1 else ""
        if function in AGGREGATES and level:
            return Each(function, level, _Growing(self.grower, self.formula, level).grow(node.args[0]))
        return Op(function, tuple(map(self.grow, node.args)))

    def _option(self, node: ast.Call, name: str, default: float) -> float | None:
        for keyword in node.keywords:
            if keyword.arg == name:
                return self.grower.number(self.formula.part(keyword.value))
        return default

    def _charged(self, node: ast.Call) -> Node:
        weights = {
            str(k.arg): self.grower.number(self.formula.part(k.value))
            for k in node.keywords
            if k.arg not in ("again_after_s", "severity")
        }
        again_after_s = self._option(node, "again_after_s", AGAIN_AFTER_S)
        severity = self._option(node, "severity", 1.0)
        label = f"charged({', '.join(weights)})"
        known = {check: weight for check, weight in weights.items() if weight is not None}
        if again_after_s is None or severity is None or len(known) < len(weights):
            why = "its weights hang on the trial"
            return Taken(Quantity(label, VIOLATIONS, 0, inf, tuple(weights), grows=False, why_not=why))
        charged = {check: weight for check, weight in known.items() if weight}
        if not charged:
            return Known(0.0)
        pauses = [self.grower.bridged.get(check, 1.0) for check in charged if check not in self.grower.events]
        return Taken(
            of_charge(
                charged,
                label=label,
                again_after_s=again_after_s,
                severity=severity,
                longest_pause_s=max(pauses, default=0.0),
            )
        )

    def _of_check(self, function: str, check: str, node: ast.Call) -> Node:
        grower = self.grower
        is_monitor = check in grower.rule_set.monitors
        is_record = is_monitor and check in grower.events and check not in grower.safety

        def taken(of: str, label: str = "") -> Taken:
            label = self._label(label or f"{of}({check})")
            if is_record:
                switch = of in ("violated", "critical")
                return Taken(Quantity(label, FACT, 0, 1 if switch else inf, (check,), switch=switch))
            if is_monitor:
                return Taken(of_monitor(of, check, events=check in self.grower.events, label=label))
            return Taken(of_rule(of, check, label=label))

        if function == "holds":
            return _opposite(taken("violated"))
        if function == "gate":
            return _opposite(taken("critical", f"critical({check})"))
        if function == "demerits":
            tau_s = self._option(node, "tau_s", AGAIN_AFTER_S)
            depth: Node = taken("depth", f"depth integral of {check}")
            return Op("+", (taken("count"), Op("/", (depth, Known(tau_s or AGAIN_AFTER_S)))))
        if function == "product":
            p = next((self.grow(k.value) for k in node.keywords if k.arg == "p"), Known(0.5))
            return Op("**", (p, taken("count")))
        if function == "occurrences":
            return taken("occurrences", text_of(node))
        if function == "measure":
            return self._measure(check, text_of(node.args[1]), watches=is_monitor and not is_record)
        return taken(function)

    def _label(self, label: str) -> str:
        return label if self.level == TRIAL else f"{label} of {self.level}"

    def _measure(self, check: str, quantity: str, *, watches: bool) -> Node:
        label = self._label(f"measure({check}, {quantity})")
        declared = self.grower.measures.get(check, {}).get(quantity)
        least = 0.0 if declared is not None and declared.is_never_negative else -inf
        if not watches:
            is_rule = check not in self.grower.rule_set.monitors
            earns = is_rule and declared is not None and declared.role == "points"
            return Taken(Quantity(label, FACT, least, inf, (check,), adds=True, earns=earns))
        known = {"time_in_violation_s": "seconds", "relative_depth_integral_s": "depth"}
        if quantity in known:
            return Taken(of_monitor(known[quantity], check, events=False, label=label))
        return Taken(
            Quantity(label, VIOLATIONS, least, inf, (check,), grows=False, why_not=UNKNOWN, bridged=False)
        )


def _times(factor: float, node: Node) -> Node:
    return Known(factor * node.value) if isinstance(node, Known) else Op("*", (Known(factor), node))


def _opposite(node: Node) -> Node:
    return Op("+", (Known(1), _times(-1, node)))
