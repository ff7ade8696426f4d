"""Types of trees: ranges and signs, and in which quantities a value is strict, jumps, or how steep it is.

Signs and ranges are those of `scoring.signs`, which prices open logs. A grade never says more than is proven.

Source: disciplined convex programming (Grant, Boyd and Ye 2006), interval arithmetic (Moore 1966).
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import reduce
from math import inf, isfinite, log, nextafter

from ariac_score.errors import FormulaError
from ariac_score.review.proofs.quantities import Quantity
from ariac_score.review.proofs.tree import Each, Known, Node, Op, Taken, Term, bare, text
from ariac_score.scoring.signs import (
    Sign,
    Typed,
    compared,
    constant,
    either,
    joined,
    of_function,
    power,
    product,
    quotient,
    total,
    truth_of,
)

__all__ = ["Grade", "Grades", "Loss"]

_COMPARED: Mapping[str, ast.cmpop] = {"<": ast.Lt(), "<=": ast.LtE(), "==": ast.Eq(), "!=": ast.NotEq()}
_FLAT = frozenset({"floor", "not", "and", "or", "any", "all", "count", *_COMPARED})
"""Operations that stay the same over a stretch, and jump at its ends."""


@dataclass(frozen=True)
class Loss:
    """Where it is no longer known which way a quantity moves the score.

    Attributes:
        term: The term in which.
        formula: The part of it.
    """

    term: str
    formula: str


@dataclass(frozen=True)
class Grade:
    """What is known of a value.

    Attributes:
        typed: Its range, and which way each quantity moves it.
        strict: The quantities that always move it.
        jumps: The quantities of which a small change may move it by much.
        steep: By how much it moves at most for each unit of a quantity; infinite where nothing bounds it.
    """

    typed: Typed
    strict: frozenset[str] = frozenset()
    jumps: frozenset[str] = frozenset()
    steep: Mapping[str, float] = field(default_factory=dict)

    def sign(self, name: str) -> Sign:
        """Which way a quantity moves it."""
        return self.typed.signs.get(name, Sign.NONE)


@dataclass
class Grades:
    """Grades of the nodes of a tree.

    Attributes:
        pins: Quantities that are known to be one number, by name.
        nonzero: Whether the tree is taken where its value is not 0.
        positive: Whether it is taken where its value is above 0.
        losses: Where the sign of each quantity was first lost.
    """

    pins: Mapping[str, float] = field(default_factory=dict)
    nonzero: bool = False
    positive: bool = False
    losses: dict[str, Loss] = field(default_factory=dict)
    _terms: list[str] = field(default_factory=list)
    _known: dict[Node, tuple[float, float]] = field(default_factory=dict)

    def of(self, node: Node) -> Grade:
        """The grade of a tree."""
        return self._of(node, self.nonzero or self.positive, self.positive)

    def _of(self, node: Node, nonzero: bool = False, positive: bool = False) -> Grade:
        if isinstance(node, Known):
            return Grade(constant(node.value))
        if isinstance(node, Taken):
            found = self._taken(node.quantity)
        elif isinstance(node, Term):
            self._terms.append(node.name)
            found = self._of(node.of, nonzero, positive)
            self._terms.pop()
        elif isinstance(node, Each):
            found = _each(node.name, self._of(node.of))
        else:
            found = self._op(node, nonzero, positive)
            self._note_losses(node, found)
        limits = self._known.get(bare(node))
        if limits:
            found = Grade(found.typed.within(*limits), found.strict, found.jumps, found.steep)
        return found

    def _taken(self, quantity: Quantity) -> Grade:
        name = quantity.name
        if name in self.pins:
            return Grade(constant(self.pins[name]))
        own = frozenset({name})
        typed = Typed(quantity.least, quantity.most, {name: Sign.UP})
        return Grade(typed, own, frozenset() if quantity.smooth else own, {name: 1.0})

    def _op(self, node: Op, nonzero: bool, positive: bool) -> Grade:
        if node.name == "if":
            return self._if(node, nonzero, positive)
        if node.name == "runs":
            return self._of(node.of[0], nonzero)  # laws are about a trial that was run once
        # Where a product is not 0, none of its factors is; where a quotient is not, its dividend.
        below = [nonzero and (node.name == "*" or (node.name == "/" and i == 0)) for i in range(len(node.of))]
        parts = [self._of(part, b) for part, b in zip(node.of, below, strict=True)]
        if node.name == "+":
            return _sum(parts)
        if node.name == "*":
            return _product(parts[0], parts[1], below[0])
        if node.name == "/":
            return _product(parts[0], _inverse(parts[1]), below[0], of=_quotient(*(p.typed for p in parts)))
        if node.name == "**":
            return _power(parts[0], parts[1])
        return _function(node.name, parts)

    def _if(self, node: Op, nonzero: bool, positive: bool) -> Grade:
        test = self._of(node.of[0])
        told = truth_of(test.typed)
        if told.is_known:
            return self._of(node.of[1 if told.least else 2], nonzero, positive)
        branches = []
        for holds in (True, False):
            with self._inside():
                self._suppose(node.of[0], holds=holds)
                branches.append(self._tried(node.of[1 if holds else 2], nonzero, positive))
        if positive:  # a branch that is never above 0 is not the one
            above = [branch for branch in branches if branch is None or branch.typed.most > 0]
            if len(above) == 1 and above[0] is not None:
                return above[0]
        body, other = branches
        typed = either(told, *(branch.typed if branch else None for branch in branches))
        if body is None or other is None:
            return Grade(typed, jumps=frozenset(typed.signs))
        among = frozenset(test.typed.signs)
        same = body.strict & other.strict - among
        strict = frozenset(name for name in same if typed.signs.get(name) in (Sign.UP, Sign.DOWN))
        steep = {
            name: max(body.steep.get(name, 0.0), other.steep.get(name, 0.0))
            for name in {**body.steep, **other.steep}
        }
        jumps = body.jumps | other.jumps
        if not self._meets(node):
            jumps |= among
            steep |= dict.fromkeys(among, inf)
        return Grade(typed, strict, jumps, steep)

    def _meets(self, node: Op) -> bool:
        """Whether both branches have one value where the condition turns: where x is 0, for `x >= 0`."""
        test = node.of[0]
        if not (isinstance(test, Op) and test.name in ("<", "<=")):
            return False
        left, right = test.of
        turning, at = (left, right) if isinstance(right, Known) else (right, left)
        if not isinstance(at, Known):
            return False
        values = []
        for branch in node.of[1:]:
            with self._inside():
                self._note(turning, at.value, at.value)
                found = self._tried(branch, False)
                values.append(None if found is None else found.typed)
        return all(v is not None and v.is_known for v in values) and values[0] == values[1]

    def _tried(self, node: Node, nonzero: bool, positive: bool = False) -> Grade | None:
        try:
            return self._of(node, nonzero, positive)
        except (FormulaError, ZeroDivisionError):
            return None

    def _note_losses(self, node: Op, found: Grade) -> None:
        for name, sign in found.typed.signs.items():
            if sign is Sign.BOTH and name not in self.losses:
                self.losses[name] = Loss(self._terms[-1] if self._terms else "score", text(node))

    # What a condition says of the parts of a branch ----------------------------------------

    @contextmanager
    def _inside(self) -> Iterator[None]:
        before = dict(self._known)
        try:
            yield
        finally:
            self._known = before

    def _suppose(self, node: Node, *, holds: bool) -> None:
        node = bare(node)
        if isinstance(node, Taken):
            if node.quantity.switch:
                self._note(node, float(holds), float(holds))
            elif not holds:
                self._note(node, 0, 0)
        elif isinstance(node, Op) and node.name == "not":
            self._suppose(node.of[0], holds=not holds)
        elif isinstance(node, Op) and node.name == ("and" if holds else "or"):
            for part in node.of:
                self._suppose(part, holds=holds)
        elif isinstance(node, Op) and node.name in ("<", "<="):
            low, high = node.of if holds else node.of[::-1]
            less, more = self._of(low).typed, self._of(high).typed
            # `a < b` that holds, and `a <= b` that does not, leave out that both are equal.
            apart = (node.name == "<") is holds
            most = nextafter(more.most, -inf) if apart and isfinite(more.most) else more.most
            least = nextafter(less.least, inf) if apart and isfinite(less.least) else less.least
            self._note(low, -inf, most)
            self._note(high, least, inf)
        elif not holds and not (isinstance(node, Op) and node.name in _FLAT):
            self._note(node, 0, 0)

    def _note(self, node: Node, least: float, most: float) -> None:
        node = bare(node)
        before = self._known.get(node, (-inf, inf))
        self._known[node] = (max(least, before[0]), min(most, before[1]))


def _only_sure(names: Iterable[str], typed: Typed) -> frozenset[str]:
    """Those that the value is known to go one way with: nothing else can be strict."""
    return frozenset(name for name in names if typed.signs.get(name) in (Sign.UP, Sign.DOWN))


def _steeper(*each: Mapping[str, float]) -> dict[str, float]:
    """The sums of how steep several are."""
    return {name: sum(one.get(name, 0.0) for one in each) for name in {n for one in each for n in one}}


def _scaled(steep: Mapping[str, float], factor: float) -> dict[str, float]:
    return {name: 0.0 if not k or not factor else k * factor for name, k in steep.items()}


def _size(typed: Typed) -> float:
    return max(abs(typed.least), abs(typed.most))


def _sum(parts: list[Grade]) -> Grade:
    typed = total([part.typed for part in parts])
    strict = _only_sure(frozenset().union(*(part.strict for part in parts)), typed)
    jumps = frozenset().union(*(part.jumps for part in parts))
    return Grade(typed, strict, jumps, _steeper(*(part.steep for part in parts)))


def _product(one: Grade, other: Grade, nonzero: bool, *, of: Typed | None = None) -> Grade:
    typed = product(one.typed, other.typed) if of is None else of
    strict: set[str] = set()
    for moving, factor in ((one, other), (other, one)):
        if nonzero or factor.typed.least > 0 or factor.typed.most < 0:
            strict |= moving.strict
    if typed.is_known:
        return Grade(typed)
    steep = _steeper(_scaled(one.steep, _size(other.typed)), _scaled(other.steep, _size(one.typed)))
    return Grade(typed, _only_sure(strict, typed), one.jumps | other.jumps, steep)


def _quotient(one: Typed, other: Typed) -> Typed:
    """One value divided by another; there is none where that is 0, so that only its side of 0 counts.

    What moves the divisor may move the quotient either way, also into having no value.
    """
    if not (other.least <= 0 <= other.most) or (other.least < 0 < other.most) or other.is_known:
        return quotient(one, other)
    moved = dict.fromkeys(other.signs, Sign.BOTH)
    side = Typed(0.0, inf, moved) if other.least == 0 else Typed(-inf, 0.0, moved)
    return product(one, side)


def _inverse(one: Grade) -> Grade:
    typed = quotient(constant(1), one.typed)
    if one.typed.least <= 0 <= one.typed.most:
        return Grade(typed, frozenset(), frozenset(one.typed.signs), dict.fromkeys(one.steep, inf))
    least = min(abs(one.typed.least), abs(one.typed.most))
    steep = 1 / least**2 if least**2 else inf  # beyond every number, next to 0
    return Grade(typed, _only_sure(one.strict, typed), one.jumps, _scaled(one.steep, steep))


def _power(base: Grade, exponent: Grade) -> Grade:
    typed = power(base.typed, exponent.typed)
    if typed.is_known:
        return Grade(constant(typed.least))
    among = frozenset(typed.signs)
    if base.typed.is_known and base.typed.least > 0:
        factor = abs(log(base.typed.least)) * max(abs(typed.least), abs(typed.most))
        strict = _only_sure(exponent.strict, typed) if base.typed.least != 1 else frozenset()
        return Grade(typed, strict, exponent.jumps, _scaled(exponent.steep, factor))
    if (
        exponent.typed.is_known
        and exponent.typed.least > 0
        and (base.typed.least >= 0 or not exponent.typed.least % 2)
    ):
        n = exponent.typed.least
        size = _size(base.typed)
        factor = inf if not isfinite(size) or (n < 1 and base.typed.least <= 0) else n * size ** (n - 1)
        return Grade(typed, _only_sure(base.strict, typed), base.jumps, _scaled(base.steep, factor))
    return Grade(typed, frozenset(), among, dict.fromkeys(among, inf))


def _each(name: str, one: Grade) -> Grade:
    """An aggregate over as many scopes as the work has, which no violation changes."""
    least, most = one.typed.least, one.typed.most
    if name == "sum":
        typed = Typed(
            min(0.0, least) * inf if least < 0 else 0.0, most * inf if most > 0 else 0.0, one.typed.signs
        )
        return Grade(typed, one.strict, one.jumps, one.steep)
    if name in ("any", "all", "count"):
        truth = truth_of(one.typed)
        typed = truth if name != "count" else Typed(0, inf, truth.signs)
        return Grade(typed, frozenset(), frozenset(typed.signs), dict.fromkeys(typed.signs, inf))
    # One of several may change alone, and then the least or the greatest of them may stay.
    strict = one.strict if name == "mean" else frozenset()
    return Grade(Typed(least, most, joined(one.typed)), strict, one.jumps, one.steep)


def _function(name: str, parts: list[Grade]) -> Grade:
    types = [part.typed for part in parts]
    jumps = frozenset().union(*(part.jumps for part in parts))
    if name in _COMPARED:
        typed = compared(_COMPARED[name], types[0], types[1])
    elif name in ("and", "or", "not"):
        truths = [truth_of(one) for one in types]
        typed = (
            quotient(total([constant(1), product(constant(-1), truths[0])]), constant(1))
            if name == "not"
            else of_function("min" if name == "and" else "max", truths)
        )
    else:
        typed = of_function(name, types)
    among = frozenset(typed.signs)
    if name in _FLAT:
        # A number that is 0 or 1 for the whole trial turns as a whole: its truth moves with it.
        return Grade(typed, frozenset(), among, dict.fromkeys(among, inf))
    if name in ("sum", "mean"):
        found = _sum(parts)
        share = 1.0 if name == "sum" else 1 / len(parts)
        return Grade(typed, _only_sure(found.strict, typed), jumps, _scaled(found.steep, share))
    if name in ("min", "max"):
        may = _may_be(name, parts)
        strict = reduce(frozenset.__and__, (part.strict for part in may))
        steepest = {n: max(part.steep.get(n, 0.0) for part in may) for part in may for n in part.steep}
        return Grade(typed, _only_sure(strict, typed), jumps, steepest)
    if name in ("abs", "clip"):
        strict = parts[0].strict if name == "abs" else frozenset()
        return Grade(typed, _only_sure(strict, typed), jumps, _steeper(*(part.steep for part in parts)))
    return _ramp(typed, parts, jumps)


def _may_be(name: str, parts: list[Grade]) -> list[Grade]:
    """Those that can be the least, or the greatest, of several."""
    # One that is never beyond another is never needed, also where both can be alike.
    if name == "min":
        last = min(parts, key=lambda part: part.typed.most)
        return [part for part in parts if part is last or part.typed.least < last.typed.most]
    last = max(parts, key=lambda part: part.typed.least)
    return [part for part in parts if part is last or part.typed.most > last.typed.least]


def _ramp(typed: Typed, parts: list[Grade], jumps: frozenset[str]) -> Grade:
    best, worst, hi, lo, x = parts
    among = frozenset(typed.signs)
    ends = (best, worst, hi, lo)
    if not all(one.typed.is_known for one in ends) or hi.typed.least <= lo.typed.least:
        return Grade(typed, frozenset(), among, dict.fromkeys(among, inf))
    slope = abs(best.typed.least - worst.typed.least) / (hi.typed.least - lo.typed.least)
    return Grade(typed, frozenset(), jumps, _scaled(x.steep, slope))
