"""Types of formulas: between which numbers a value lies, and which way each input moves it.

A type never says more than is proven. Where nothing is known of how an input moves a value, its sign is
`BOTH`, which means "not proven" and never "broken"; a range that nothing bounds is infinite.

Source: disciplined convex programming (Grant, Boyd and Ye 2006) for the signs, interval arithmetic
(Moore 1966) for the ranges.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import IntFlag
from math import floor, inf, isfinite, isinf, isnan
from typing import Any, Protocol

from ariac_score.errors import FormulaError
from ariac_score.scoring.expression import COMPARISONS, Expression, Number, text_of

__all__ = [
    "Sign",
    "Surroundings",
    "Typed",
    "compared",
    "constant",
    "either",
    "joined",
    "of_function",
    "power",
    "product",
    "quotient",
    "total",
    "truth_of",
    "turned",
    "type_of",
]


class Sign(IntFlag):
    """Which way a value goes when an input grows; `BOTH`: nothing is proven."""

    NONE = 0
    UP = 1
    DOWN = 2
    BOTH = 3

    @property
    def turned(self) -> Sign:
        """That of the value times -1."""
        return Sign((self & 1) << 1 | (self & 2) >> 1)


@dataclass(frozen=True)
class Typed:
    """What is known of a value without knowing its inputs.

    Attributes:
        least: No input makes it less; `-inf` where nothing bounds it.
        most: No input makes it more.
        signs: For each input that it hangs on, which way it goes when that grows. `UP` also says that the
            least value is had at the input's lower end and the greatest at its upper end, the others fixed.
    """

    least: float
    most: float
    signs: Mapping[str, Sign] = field(default_factory=dict)

    @property
    def is_known(self) -> bool:
        """Whether it is one number."""
        return self.least == self.most

    @property
    def is_bounded(self) -> bool:
        """Whether it lies between two numbers."""
        return isfinite(self.least) and isfinite(self.most)

    def within(self, least: float, most: float) -> Typed:
        """The same where it is known to lie between two numbers."""
        low, high = max(self.least, least), min(self.most, most)
        return self if low > high else Typed(low, high, self.signs)


class Surroundings(Protocol):
    """What the names and functions of a formula are, as types."""

    def name(self, dotted: str) -> Typed:
        """The type of a name."""
        ...

    def text_named(self, dotted: str) -> str | None:
        """The text that a name stands for; `None` when it stands for a number."""
        ...

    def call(
        self, function: str, arguments: Sequence[Expression], options: Mapping[str, Number]
    ) -> Typed | None:
        """The type of a function on checks or scopes; `None` when it is neither."""
        ...


def constant(value: float) -> Typed:
    """The type of a number.

    >>> constant(2).is_known
    True
    """
    return Typed(value, value)


def joined(*types: Typed) -> dict[str, Sign]:
    """The signs of what grows with each of several values."""
    signs: dict[str, Sign] = {}
    for one in types:
        for name, sign in one.signs.items():
            signs[name] = signs.get(name, Sign.NONE) | sign
    return signs


def type_of(formula: Expression, around: Surroundings) -> Typed:
    """The type of a formula.

    Raises:
        FormulaError: It has no value, whatever its inputs are.
    """
    return _Visitor(around).visit(formula.root, formula)


def total(types: Iterable[Typed]) -> Typed:
    """The sum."""
    among = list(types)
    least = most = 0.0
    for one in among:  # from left to right, as values are added up
        least, most = least + one.least, most + one.most
    return Typed(least, most, joined(*among))


def truth_of(one: Typed) -> Typed:
    """Whether it is not 0, as 1 or 0."""
    if one.least > 0 or one.most < 0:
        return constant(1)
    if one.least == one.most == 0:
        return constant(0)
    return Typed(0, 1, _by(one.signs, _side(one)))


def _side(one: Typed) -> Sign:
    """Whether it is never below 0 (`UP`), never above (`DOWN`), or nothing is known."""
    return Sign.UP if one.least >= 0 else Sign.DOWN if one.most <= 0 else Sign.BOTH


def _by(signs: Mapping[str, Sign], side: Sign) -> dict[str, Sign]:
    """Signs of a value that is multiplied with one of a side."""
    if side is Sign.UP:
        return dict(signs)
    return {n: s.turned if side is Sign.DOWN else Sign.BOTH for n, s in signs.items() if s}


def turned(one: Typed) -> Typed:
    """The value times -1."""
    return Typed(-one.most, -one.least, _by(one.signs, Sign.DOWN))


def product(one: Typed, other: Typed) -> Typed:
    """One value times another."""
    ends = [_times(a, b) for a in (one.least, one.most) for b in (other.least, other.most)]
    if (one.is_known and one.least == 0) or (other.is_known and other.least == 0):
        return constant(0)
    signs = joined(
        Typed(0, 0, _by(one.signs, _side(other))),
        Typed(0, 0, _by(other.signs, _side(one))),
    )
    return Typed(min(ends), max(ends), signs)


def _times(one: float, other: float) -> float:
    return 0.0 if not one or not other else one * other  # 0 x infinity: the 0 is exact, the other unbounded


def _inverse(one: Typed) -> Typed:
    if one.least <= 0 <= one.most:
        return _unknown(one)
    return Typed(1 / one.most, 1 / one.least, _by(one.signs, Sign.DOWN))


def quotient(one: Typed, other: Typed) -> Typed:
    """One value divided by another."""
    if other.least <= 0 <= other.most:
        return _unknown(one, other)
    ends = [_over(a, b) for a in (one.least, one.most) for b in (other.least, other.most)]
    return Typed(min(ends), max(ends), product(one, _inverse(other)).signs)


def _over(one: float, other: float) -> float:
    return 0.0 if not one or abs(other) == inf else one / other


def _unknown(*types: Typed) -> Typed:
    """Any number, or none at all."""
    return Typed(-inf, inf, dict.fromkeys(joined(*types), Sign.BOTH))


def power(base: Typed, exponent: Typed) -> Typed:
    """One value to the power of another."""
    if base.is_known and exponent.is_known:
        return _corners(base, exponent, {})
    if exponent.is_known:
        return _of_power(base, exponent.least)
    if base.least > 0:
        # Monotone in each while the other is fixed, so the ends lie at corners.
        up = Sign.UP if base.least >= 1 else Sign.DOWN if base.most <= 1 else Sign.BOTH
        rises = Sign.UP if exponent.least >= 0 else Sign.DOWN if exponent.most <= 0 else Sign.BOTH
        signs = joined(Typed(0, 0, _by(exponent.signs, up)), Typed(0, 0, _by(base.signs, rises)))
        return _corners(base, exponent, signs)
    return _unknown(base, exponent)


def _of_power(base: Typed, exponent: float) -> Typed:
    whole, even = exponent == int(exponent), exponent % 2 == 0
    if exponent == 0:
        return constant(1)
    if (exponent < 0 and base.least <= 0 <= base.most) or (not whole and base.least < 0):
        return _unknown(base)
    ends = [_raised(end, exponent) for end in (base.least, base.most)]
    if even and base.least < 0 < base.most:
        return Typed(0, max(ends), _by(base.signs, Sign.BOTH))
    rises = (exponent > 0) is (base.least >= 0 or not even)
    return Typed(min(ends), max(ends), _by(base.signs, Sign.UP if rises else Sign.DOWN))


def _raised(base: float, exponent: float) -> float:
    try:
        power: float | complex = float(base) ** float(exponent)
    except OverflowError:
        return inf
    except ZeroDivisionError:
        raise FormulaError("division by zero") from None
    if isinstance(power, complex):
        raise FormulaError("root of a negative number")
    return power


def _corners(one: Typed, other: Typed, signs: Mapping[str, Sign]) -> Typed:
    ends = [_raised(a, b) for a in (one.least, one.most) for b in (other.least, other.most)]
    return Typed(min(ends), max(ends), signs) if not any(map(isnan, ends)) else _unknown(one, other)


def least_of(types: Sequence[Typed]) -> Typed:
    """The least of several."""
    most = min(one.most for one in types)
    among = [one for one in types if one.least <= most]  # the others never are
    return Typed(min(one.least for one in types), most, joined(*among))


def most_of(types: Sequence[Typed]) -> Typed:
    """The greatest of several."""
    return turned(least_of([turned(one) for one in types]))


def _absolute(one: Typed) -> Typed:
    if one.least >= 0:
        return one
    if one.most <= 0:
        return turned(one)
    return Typed(0, max(-one.least, one.most), _by(one.signs, Sign.BOTH))


def _floor(one: Typed) -> Typed:
    least, most = (value if isinf(value) else floor(value) for value in (one.least, one.most))
    return Typed(least, most, one.signs)


def _ramp(best: Typed, worst: Typed, hi: Typed, lo: Typed, x: Typed) -> Typed:
    ends = Typed(min(best.least, worst.least), max(best.most, worst.most), joined(best, worst))
    if x.least >= hi.most:
        return worst
    if x.most <= lo.least and x.most < hi.least:
        return best
    falls = best.least >= worst.most
    rises = best.most <= worst.least
    along = Sign.DOWN if falls else Sign.UP if rises else Sign.BOTH
    signs = joined(
        ends,
        Typed(0, 0, _by(x.signs, along)),
        Typed(0, 0, _by(hi.signs, Sign.BOTH)),
        Typed(0, 0, _by(lo.signs, Sign.BOTH)),
    )
    if all(one.is_known for one in (best, worst, hi, lo)):
        at = [_on_ramp(best.least, worst.least, hi.least, lo.least, end) for end in (x.least, x.most)]
        return Typed(min(at), max(at), signs)
    return Typed(ends.least, ends.most, signs)


def _on_ramp(best: float, worst: float, hi: float, lo: float, x: float) -> float:
    if x >= hi:
        return worst
    return best if x <= lo else worst + (hi - x) / (hi - lo) * (best - worst)


def compared(op: ast.cmpop, left: Typed, right: Typed) -> Typed:
    """Whether two values are in an order, as 1 or 0."""
    symbol, holds = COMPARISONS[type(op)]
    if left.is_known and right.is_known and isfinite(left.least) and isfinite(right.least):
        return constant(int(holds(left.least, right.least)))
    if symbol in ("==", "!="):
        if left.most < right.least or right.most < left.least:
            return constant(int(symbol == "!="))
        return Typed(0, 1, dict.fromkeys(joined(left, right), Sign.BOTH))
    if symbol in (">", ">="):
        left, right, symbol = right, left, symbol.replace(">", "<")
    strict = symbol == "<"
    if left.most < right.least or (not strict and left.most <= right.least):
        return constant(1)
    if left.least > right.most or (strict and left.least >= right.most):
        return constant(0)
    return Typed(0, 1, joined(right, turned(left)))


def _opposite(one: Typed) -> Typed:
    return Typed(1 - one.most, 1 - one.least, _by(one.signs, Sign.DOWN))


def either(test: Typed, body: Typed | None, other: Typed | None) -> Typed:
    """One of two by a condition that is not known; `None` stands for one that may have no value."""
    if body is None or other is None:
        return _unknown(test, *(one for one in (body, other) if one is not None))
    if body.least >= other.most:
        turns = Sign.UP
    elif body.most <= other.least:
        turns = Sign.DOWN
    else:
        turns = Sign.BOTH
    signs = joined(body, other, Typed(0, 0, _by(test.signs, turns)))
    return Typed(min(body.least, other.least), max(body.most, other.most), signs)


_WHOLE = frozenset({"count", "points", "holds", "violated", "gate", "any", "all"})
"""Functions whose values are whole numbers from 0 on: what is not 0 is at least 1."""

_FUNCTIONS: Mapping[str, Callable[[Sequence[Typed]], Typed]] = {
    "min": least_of,
    "max": most_of,
    "abs": lambda v: _absolute(v[0]),
    "clip": lambda v: least_of([most_of(v[:2]), v[2]]),
    "ramp": lambda v: _ramp(*v),
    "floor": lambda v: _floor(v[0]),
    "sum": total,
    "mean": lambda v: product(total(v), constant(1 / len(v))),
    "any": lambda v: most_of([truth_of(one) for one in v]),
    "all": lambda v: least_of([truth_of(one) for one in v]),
    "count": lambda v: total([truth_of(one) for one in v]),
}
"""The functions of numbers, and the aggregates over scopes."""


def of_function(name: str, values: Sequence[Typed]) -> Typed:
    """The type of a function of numbers, or of an aggregate over what each scope gives.

    Raises:
        FormulaError: There is nothing to take it of.
    """
    if not values and name not in ("sum", "any", "all", "count"):
        raise FormulaError(f"{name} of nothing")
    if not values:
        return constant(int(name == "all"))
    if name == "mean" and all(one.is_known for one in values):
        return constant(total(values).least / len(values))
    return _FUNCTIONS[name](values)


class _Visitor:
    """The type of each node of one formula."""

    def __init__(self, around: Surroundings) -> None:
        self.around = around
        self.known: dict[str, tuple[float, float]] = {}
        """What a condition says of the parts of a branch, by their text."""

    def visit(self, node: ast.expr, of: Expression) -> Typed:
        self.formula = of
        return self._visit(node)

    def _visit(self, node: ast.expr) -> Typed:
        visitor: Callable[[Any], Typed] = getattr(self, f"visit_{type(node).__name__.lower()}")
        found = visitor(node)
        if self.known and (limits := self.known.get(text_of(node))):
            found = found.within(*limits)
        return found

    def visit_constant(self, node: ast.Constant) -> Typed:
        assert isinstance(node.value, int | float)
        return constant(node.value)

    def visit_name(self, node: ast.Name | ast.Attribute) -> Typed:
        return self.around.name(text_of(node))

    visit_attribute = visit_name

    def visit_binop(self, node: ast.BinOp) -> Typed:
        left, right = self._visit(node.left), self._visit(node.right)
        if isinstance(node.op, ast.Add):
            return total([left, right])
        if isinstance(node.op, ast.Sub):
            return total([left, turned(right)])
        if isinstance(node.op, ast.Mult):
            return product(left, right)
        if isinstance(node.op, ast.Pow):
            return power(left, right)
        if right.is_known and right.least == 0:
            raise FormulaError(f"division by zero: {text_of(node)!r}")
        return quotient(left, right)

    def visit_unaryop(self, node: ast.UnaryOp) -> Typed:
        operand = self._visit(node.operand)
        if isinstance(node.op, ast.Not):
            return _opposite(truth_of(operand))
        return turned(operand) if isinstance(node.op, ast.USub) else operand

    def visit_boolop(self, node: ast.BoolOp) -> Typed:
        stop = isinstance(node.op, ast.Or)
        seen: list[Typed] = []
        with self._inside():
            for operand in node.values:
                value = self._tried(operand) if seen else truth_of(self._visit(operand))
                if value is None:  # reached in some worlds, and without a value there
                    return Typed(0, 1, dict.fromkeys(joined(*seen), Sign.BOTH))
                seen.append(truth_of(value))
                if seen[-1].is_known and bool(seen[-1].least) is stop:
                    return constant(int(stop))
                self._suppose(operand, holds=not stop)
        return most_of(seen) if stop else least_of(seen)

    def visit_compare(self, node: ast.Compare) -> Typed:
        sides = (node.left, *node.comparators)
        texts = [self._text(side) for side in sides]
        if all(text is not None for text in texts):
            holds = all(
                COMPARISONS[type(op)][1](a, b) for op, a, b in zip(node.ops, texts, texts[1:], strict=False)
            )
            return constant(int(holds))
        types = [self._visit(side) for side in sides]
        return least_of([compared(op, a, b) for op, a, b in zip(node.ops, types, types[1:], strict=False)])

    def _text(self, node: ast.expr) -> str | None:
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, str) else None
        return self.around.text_named(text_of(node)) if isinstance(node, ast.Name | ast.Attribute) else None

    def visit_ifexp(self, node: ast.IfExp) -> Typed:
        test = truth_of(self._visit(node.test))
        if test.is_known:
            return self._visit(node.body if test.least else node.orelse)
        return either(test, self._branch(node, holds=True), self._branch(node, holds=False))

    def _branch(self, node: ast.IfExp, *, holds: bool) -> Typed | None:
        with self._inside():
            self._suppose(node.test, holds=holds)
            return self._tried(node.body if holds else node.orelse)

    def _tried(self, node: ast.expr) -> Typed | None:
        try:
            return self._visit(node)
        except FormulaError as error:
            if type(error) is not FormulaError:  # what no world knows, as a fact that nothing states
                raise
            return None

    @contextmanager
    def _inside(self) -> Iterator[None]:
        before = dict(self.known)
        try:
            yield
        finally:
            self.known = before

    def _suppose(self, node: ast.expr, *, holds: bool) -> None:
        """Note what follows for the parts of a condition where it holds, or does not."""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            self._suppose(node.operand, holds=not holds)
        elif isinstance(node, ast.BoolOp) and isinstance(node.op, ast.And) is holds:
            for operand in node.values:
                self._suppose(operand, holds=holds)
        elif isinstance(node, ast.Compare) and len(node.ops) == 1:
            self._suppose_order(node.left, node.ops[0], node.comparators[0], holds=holds)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in _WHOLE:
            self._note(node, 1, inf) if holds else self._note(node, 0, 0)
        elif not holds and not isinstance(node, ast.BoolOp | ast.Compare):
            self._note(node, 0, 0)

    def _suppose_order(self, left: ast.expr, op: ast.cmpop, right: ast.expr, *, holds: bool) -> None:
        if isinstance(op, ast.Eq | ast.NotEq):
            return
        below = isinstance(op, ast.Lt | ast.LtE) is holds
        low, high = (left, right) if below else (right, left)
        less, more = self._visit(low), self._visit(high)
        self._note(low, -inf, more.most)
        self._note(high, less.least, inf)

    def _note(self, node: ast.expr, least: float, most: float) -> None:
        before = self.known.get(text_of(node), (-inf, inf))
        self.known[text_of(node)] = (max(least, before[0]), min(most, before[1]))

    def visit_call(self, node: ast.Call) -> Typed:
        assert isinstance(node.func, ast.Name)
        function = node.func.id
        arguments = [self.formula.part(argument) for argument in node.args]
        options = {str(k.arg): self._option(k.value) for k in node.keywords}
        found = self.around.call(function, arguments, options)
        return of_function(function, [self._visit(one) for one in node.args]) if found is None else found

    def _option(self, node: ast.expr) -> Number:
        found = self._visit(node)
        if not found.is_known:
            raise FormulaError(f"{text_of(node)!r} hangs on what is not known")
        return found.least
