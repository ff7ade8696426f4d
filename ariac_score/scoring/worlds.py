"""A score as a tree of nodes, each with its value in three worlds.

In the first nothing was done; in the second everything that was earned, with no violation; the third is
what happened. So a ledger first tells what was earned, then what was taken, and within each of them nothing
depends on an order. What a quantity was in the first two is what its check declares as its best (`Measure`).
"""

from __future__ import annotations

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from math import isfinite
from typing import Any

from ariac_score.checks.findings import COUNT, POINTS, Finding, canonical
from ariac_score.checks.measures import Measure
from ariac_score.errors import FormulaError
from ariac_score.scoring.attribution import (
    Changed,
    Choice,
    Compared,
    Every,
    Extreme,
    Function,
    Given,
    Leaf,
    Named,
    Node,
    Product,
    Sum,
    truth,
)
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.expression import APPLIED, COMPARISONS, Expression, Number, Traced, text_of
from ariac_score.scoring.policy import ideal
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.shares import Exact, exactly, raised
from ariac_score.scoring.sheet import (
    AGGREGATES,
    CHECK_FUNCTIONS,
    Pricing,
    ScopeNames,
    ScoreSheet,
    scopes_inside,
)

__all__ = ["EARNED", "KEPT", "NOTHING", "TAKEN", "tree_of"]

NOTHING, KEPT, ACTUAL = range(3)
"""The worlds."""
EARNED, TAKEN = range(2)
"""The steps between them."""

_WORLDS = 3
_GATES = frozenset({"holds", "violated", "gate"})
"""Functions that only turn: what they take of a product comes after what is graded."""
_LARGEST_POWER = 16

Measures = Mapping[str, Mapping[str, Measure]]


def tree_of(
    sheet: ScoreSheet,
    formula: Expression,
    trial: Scope,
    findings: Mapping[str, Finding],
    cohort: CohortValues,
    measures: Measures,
) -> Node:
    """A formula of the whole trial as nodes.

    Args:
        sheet: The formulas.
        formula: Which of them; it has a value here.
        trial: The scopes, outermost.
        findings: By id, undecided ones settled.
        cohort: Values across teams.
        measures: What checks declare of their quantities, by check and quantity.
    """
    actual = Pricing(sheet, trial, findings, cohort)
    best = Pricing(sheet, trial, ideal(findings), cohort)
    return _Maker(actual, best, measures).formula(formula, trial, ())


class _Maker:
    """Makes each term of each scope once, however often it is named."""

    def __init__(self, actual: Pricing, best: Pricing, measures: Measures) -> None:
        self.actual, self.best, self.measures = actual, best, measures
        self._terms: dict[tuple[str, str], Node] = {}

    def formula(self, formula: Expression, scope: Scope, outer: tuple[Scope, ...]) -> Node:
        names = ScopeNames(self.actual, scope, outer)
        return _Visitor(self, formula, names, ScopeNames(self.best, scope, outer)).visit(formula.root)

    def term(self, scope: Scope, name: str, outer: tuple[Scope, ...]) -> Node:
        key = (scope.path, f"{scope.level}.{name}")
        if key not in self._terms:
            inner = self.formula(self.actual.sheet.terms[scope.level][name], scope, outer)
            self._terms[key] = Named(name, inner, scope.path)
        return self._terms[key]


class _Visitor:
    """Makes the nodes of one formula in one scope.

    What has no value in a world, as a fact that nobody states in a branch that was not taken, is 0 there.
    """

    def __init__(self, maker: _Maker, formula: Expression, names: ScopeNames, best: ScopeNames) -> None:
        self.maker, self.formula, self.names, self.best = maker, formula, names, best

    def visit(self, node: ast.expr) -> Node:
        make: Callable[[Any], Node] = getattr(self, f"visit_{type(node).__name__.lower()}")
        try:
            return make(node)
        except FormulaError:
            return Given(text_of(node), 0, _WORLDS)

    def visit_constant(self, node: ast.Constant) -> Node:
        return Given(text_of(node), node.value, _WORLDS)

    def visit_name(self, node: ast.Name | ast.Attribute) -> Node:
        dotted = text_of(node)
        found = self.names.term_of(dotted)
        if found is not None:
            term = self.maker.term(*found)
            return self._of_all_runs(dotted, term) if dotted.startswith("runs.") else term
        text = self.names.text_named(dotted)
        if text is not None:
            return Given(dotted, text, _WORLDS, of_trial=True)
        cohort = dotted.startswith("cohort.")
        value = self.names.name(dotted)
        return Given(
            dotted, value.value, _WORLDS, of_cohort=cohort, of_trial=value.kind == "fact" and not cohort
        )

    visit_attribute = visit_name

    def _of_all_runs(self, dotted: str, own: Node) -> Node:
        """A term over all runs of the team: what this run brings, and the others as one line."""
        pooled = self.names.name(dotted).value
        if canonical(pooled) == canonical(own.numbers[ACTUAL]):
            return own
        others = exactly(pooled) - own.exact[ACTUAL]
        step = EARNED if own.moves[EARNED] and not own.moves[TAKEN] else TAKEN
        values = [0 if world <= step else others for world in range(_WORLDS)]
        changed = Changed("runs", tuple(others if each == step else 0 for each in (EARNED, TAKEN)))
        leaf = Leaf(
            "other runs of the team", [float(v) for v in values], [changed], function="runs", exact=values
        )
        numbers = [pooled if world > step else own.numbers[world] for world in range(_WORLDS)]
        return Sum(dotted, [(1, own), (1, leaf)], numbers)

    def visit_binop(self, node: ast.BinOp) -> Node:
        left, right, label = self.visit(node.left), self.visit(node.right), text_of(node)
        if isinstance(node.op, ast.Add | ast.Sub):
            sign = 1 if isinstance(node.op, ast.Add) else -1
            apply = operator.add if sign > 0 else operator.sub
            return Sum(label, [(1, left), (sign, right)], _numbers(apply, left, right))
        if isinstance(node.op, ast.Mult):
            return Product(label, [(left, 1), (right, 1)], _numbers(operator.mul, left, right))
        if isinstance(node.op, ast.Div):
            return Product(label, [(left, 1), (right, -1)], _numbers(operator.truediv, left, right))
        return self._raised(label, left, right)

    def _raised(self, label: str, base: Node, exponent: Node) -> Node:
        numbers = _numbers(_power, base, exponent)
        power = exponent.exact[ACTUAL]
        if not any(exponent.moves) and isinstance(power, int) and abs(power) <= _LARGEST_POWER:
            return Product(label, [(base, power)], numbers)
        exact = [_exact_power(base.exact[w], exponent.exact[w], numbers[w]) for w in range(_WORLDS)]
        return Function(label, (base, exponent), numbers, _power, exact)

    def visit_unaryop(self, node: ast.UnaryOp) -> Node:
        inner, label = self.visit(node.operand), text_of(node)
        if isinstance(node.op, ast.UAdd):
            return inner
        if isinstance(node.op, ast.USub):
            return Sum(label, [(-1, inner)], _numbers(operator.neg, inner))
        holds = truth(inner)
        return Sum(label, [(-1, holds)], [int(not number) for number in inner.numbers], 1)

    def visit_boolop(self, node: ast.BoolOp) -> Node:
        among = [truth(self.visit(value)) for value in node.values]
        return Every(text_of(node), among, every=isinstance(node.op, ast.And), worlds=_WORLDS)

    def visit_compare(self, node: ast.Compare) -> Node:
        sides = [self.visit(side) for side in (node.left, *node.comparators)]
        pairs = []
        for op, left, right in zip(node.ops, sides, sides[1:], strict=False):
            symbol, holds = COMPARISONS[type(op)]
            label = f"{left.label} {symbol} {right.label}"
            pairs.append(
                Compared(label, left, right, [int(bool(number)) for number in _numbers(holds, left, right)])
            )
        return pairs[0] if len(pairs) == 1 else Every(text_of(node), pairs, every=True, worlds=_WORLDS)

    def visit_ifexp(self, node: ast.IfExp) -> Node:
        condition = truth(self.visit(node.test))
        return Choice(text_of(node), condition, self.visit(node.body), self.visit(node.orelse))

    # Functions -------------------------------------------------------------------------

    def visit_call(self, node: ast.Call) -> Node:
        assert isinstance(node.func, ast.Name)  # the parser let nothing else through
        function, label = node.func.id, text_of(node)
        arguments = [self.formula.part(argument) for argument in node.args]
        first = arguments[0].as_name if arguments else ""
        if function == "charged" or (function in CHECK_FUNCTIONS and first in self.maker.actual.sheet.checks):
            options = {
                str(k.arg): self.formula.part(k.value).evaluate(self.names).value for k in node.keywords
            }
            return self._of_check(function, arguments, options)
        level = self.names.inner_level(arguments) if len(arguments) == 1 else ""
        if function in AGGREGATES and level:
            return self._aggregate(function, arguments[0], level)
        if function not in APPLIED:  # one that only says what is there, such as how many orders
            return Given(label, self.formula.part(node).evaluate(self.names).value, _WORLDS, of_trial=True)
        return _joined(function, label, [self.visit(argument) for argument in node.args])

    def _aggregate(self, function: str, argument: Expression, level: str) -> Node:
        inside = scopes_inside(self.names.scope, level, self.names.outer)
        each: list[Node] = [
            Named(
                scope.path.rpartition("/")[2],
                self.maker.formula(argument, scope, outer),
                scope.path,
                scope=True,
            )
            for scope, outer in inside
        ]
        return _joined(function, f"{function}({argument.source})", each)

    def _of_check(
        self, function: str, arguments: Sequence[Expression], options: Mapping[str, Number]
    ) -> Node:
        actual = self.names.call(function, arguments, options)
        assert actual is not None  # the caller knows that it asks about checks
        if actual.kind != "check":  # a level that has the name of a check: how many scopes there are
            return Given(actual.label, actual.value, _WORLDS, of_trial=True)
        asked = [
            key for check in actual.checks for key in self.maker.actual.of_check(check, self.names.scope)
        ]
        if function == "points":
            return _leaf(actual, asked, earned=True)
        if function == "measure":
            return self._measured(actual, asked, arguments[1].source)
        best = self.best.call(function, arguments, options)
        assert best is not None
        return _leaf(actual, asked, best=best.value, before=_shares(best))

    def _measured(self, actual: Traced, asked: Sequence[str], quantity: str) -> Node:
        """A measured quantity, from its best value; where nobody says that, the same in every world."""
        declared = self.maker.measures.get(actual.checks[0], {}).get(quantity)
        if declared is None:  # units alone, as of results that keep no more
            reference = 0.0 if actual.unit in (POINTS, COUNT) else None
            earned = True
        else:
            reference = declared.reference
            earned = declared.role == "points"
            if reference is None and declared.unit == POINTS:
                reference, earned = 0.0, True
        if reference is None:
            return Leaf(
                actual.label,
                (actual.value,) * _WORLDS,
                (),
                asked=asked,
                checks=actual.checks,
                function="measure",
                of_trial=True,
            )
        before = dict.fromkeys(_shares(actual), exactly(reference))
        return _leaf(actual, asked, best=reference * len(before), before=before, earned=earned)


def _shares(traced: Traced) -> dict[str, Exact]:
    return {child.findings[0]: exactly(child.value) for child in traced.children}


def _leaf(
    actual: Traced,
    asked: Sequence[str],
    *,
    best: Number = 0,
    before: Mapping[str, Exact] | None = None,
    earned: bool = False,
) -> Leaf:
    """A function of findings from its best value to what it was, shared among them.

    What is not their sum, as whether any is violated, is shared equally by those that turn it.
    """
    shares, first = _shares(actual), before or {}
    value: Exact = exactly(actual.value)
    start: Exact = exactly(best)
    changes = {
        key: by for key in dict.fromkeys([*shares, *first]) if (by := shares.get(key, 0) - first.get(key, 0))
    }
    total = sum(changes.values(), start=0)
    # Shares are added up as decimals here and in float64 for the score.
    off = total - (value - start)
    if not off or abs(Fraction(off)) * 10**9 <= 1 + abs(Fraction(value)):
        value = start + total
    elif changes:
        changes = {key: Fraction(value - start) / len(changes) for key in changes}
    ends = (start, value, value) if earned else (start, start, value)
    return Leaf(
        actual.label,
        (best, actual.value, actual.value) if earned else (best, best, actual.value),
        [Changed(key, (by, 0) if earned else (0, by)) for key, by in changes.items()],
        asked=asked,
        checks=actual.checks,
        function=actual.op,
        exact=ends,
        gate=actual.op in _GATES,
        of_trial=actual.op == "measure",
    )


def _joined(function: str, label: str, nodes: Sequence[Node]) -> Node:
    """A function of several numbers."""
    count = len(nodes)
    if function == "count":
        holds = [truth(node) for node in nodes]
        return Sum(label, [(1, node) for node in holds], _numbers(lambda *v: sum(v), *holds))
    if function in ("any", "all"):
        return Every(label, [truth(node) for node in nodes], every=function == "all", worlds=_WORLDS)
    apply = APPLIED[function]
    if function in ("sum", "mean"):
        by: Exact = 1 if function == "sum" else Fraction(1, max(1, count))
        return Sum(label, [(by, node) for node in nodes], _numbers(apply, *nodes))
    if function in ("min", "max") and nodes:
        return Extreme(label, nodes, _numbers(apply, *nodes), 1 if function == "min" else -1)
    if function == "clip" and count == 3:
        value, low, high = nodes
        raised = Extreme(label, (value, low), _numbers(max, value, low), -1)
        return Extreme(label, (raised, high), _numbers(apply, *nodes), 1)
    return Function(label, nodes, _numbers(apply, *nodes), apply)


def _numbers(apply: Callable[..., Any], *nodes: Node) -> list[Any]:
    """A function of nodes in every world; 0 where it has no value."""
    found: list[Any] = []
    last: list[Any] | None = None
    for world in range(_WORLDS):
        arguments = [node.numbers[world] for node in nodes]
        if arguments == last:  # most numbers are the same in two worlds
            found.append(found[-1])
            continue
        try:
            value = apply(*arguments)
            if not isfinite(value):
                value = 0
        except (ArithmeticError, TypeError, ValueError):
            value = 0
        found.append(int(value) if isinstance(value, bool) else value)
        last = arguments
    return found


def _power(base: Number, exponent: Number) -> Number:
    power: float | complex = float(base) ** float(exponent)
    if isinstance(power, complex):
        raise ValueError("root of a negative number")
    return power


def _exact_power(base: Exact, exponent: Exact, number: Number) -> Exact:
    if isinstance(exponent, int) and 0 <= exponent <= _LARGEST_POWER:
        return raised(base, exponent)
    return exactly(number)
