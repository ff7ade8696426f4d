"""Guards: comparisons over real numbers, some of which may still be unknown.

A guard is a conjunction and disjunction of comparisons. What is known is evaluated;
a linear equation determines an unknown wherever it stands; an inequality with one
unknown left must leave it some value; what is not linear waits for its unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from ariac_score_rml.arithmetic import COMPARISONS, FUNCTIONS, holds
from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.syntax import Const, Data, Num, Op, Pattern, Var
from ariac_score_rml.values import Bound, Json, as_float

__all__ = [
    "FLOAT_FUNCTIONS",
    "TOLERANCE",
    "ExprSlot",
    "PatternSlot",
    "Scope",
    "Slot",
    "Solver",
    "Unknown",
    "slot_of_name",
]

TOLERANCE = 1e-10
"""Differences up to this count as equality, as in the reference."""


class Unknown:
    """A name that may get a value."""

    __slots__ = ("name",)

    def __init__(self, name: str) -> None:
        self.name = name


@dataclass(frozen=True, eq=False)
class ExprSlot:
    """An expression given as an argument: a number in guards, never equal to part of an event."""

    data: Data
    scope: Scope


@dataclass(frozen=True, eq=False)
class PatternSlot:
    """A pattern given as an argument."""

    pattern: Pattern
    scope: Scope


Slot: TypeAlias = Bound | Unknown | ExprSlot | PatternSlot
Scope: TypeAlias = "dict[str, Slot]"
Values: TypeAlias = "dict[Unknown, Json]"


def slot_of_name(name: str, scope: Scope) -> Slot:
    """What a name stands for; a new unknown when nothing yet."""
    slot = scope.get(name)
    if slot is None:
        slot = scope[name] = Unknown(name)
    return slot


@dataclass(frozen=True)
class _Linear:
    """constant + Σ factor · unknown."""

    constant: float
    factors: Mapping[Unknown, float]


_Term: TypeAlias = "float | _Linear | None"  # None: not linear in what is unknown


class _NoValueError(Exception):
    """A division by zero: the comparison it stands in fails."""


def _linear(constant: float, factors: Mapping[Unknown, float]) -> float | _Linear:
    kept = {unknown: factor for unknown, factor in factors.items() if factor != 0}
    return _Linear(constant, kept) if kept else constant


def _plus(a: _Term, b: _Term, sign: float) -> _Term:
    if isinstance(a, float) and isinstance(b, float):
        return a + b if sign > 0 else a - b
    if a is None or b is None:
        return None
    ac, af = (a, {}) if isinstance(a, float) else (a.constant, dict(a.factors))
    bc, bf = (b, {}) if isinstance(b, float) else (b.constant, dict(b.factors))
    for unknown, factor in bf.items():
        af[unknown] = af.get(unknown, 0.0) + sign * factor
    return _linear(ac + sign * bc, af)


def _times(a: _Term, b: _Term) -> _Term:
    if isinstance(a, float) and isinstance(b, float):
        return a * b
    if isinstance(a, float) and isinstance(b, _Linear):
        return _linear(a * b.constant, {u: a * f for u, f in b.factors.items()})
    if isinstance(b, float) and isinstance(a, _Linear):
        return _times(b, a)
    return None


def _over(a: _Term, b: _Term) -> _Term:
    if not isinstance(b, float):
        return None
    if b == 0:
        raise _NoValueError
    if isinstance(a, float):
        return a / b
    return None if a is None else _times(1.0 / b, a)


FLOAT_FUNCTIONS: Mapping[str, Callable[..., float]] = {**FUNCTIONS, "^": math.pow}


@dataclass
class _State:
    """What a guard has established so far: values, unknowns expressed by others, inequalities, the rest."""

    values: Values
    expressed: dict[Unknown, _Linear] = field(default_factory=dict)
    bounds: list[tuple[str, _Linear]] = field(default_factory=list)
    waiting: list[tuple[Op, Scope]] = field(default_factory=list)

    def copy(self) -> _State:
        return _State(dict(self.values), dict(self.expressed), list(self.bounds), list(self.waiting))


class Solver:
    """Solves guards.

    Args:
        tolerance: Differences up to this count as equality; 0 compares exactly.

    Attributes:
        close: How many comparisons would have come out differently without the tolerance.
    """

    def __init__(self, tolerance: float = TOLERANCE) -> None:
        self.tolerance = tolerance
        self.close = 0

    def solve(self, guard: Data, scope: Scope, values: Values) -> Iterator[Values]:
        """The values that make a guard hold, one solution after the other.

        Raises:
            RmlRunError: Something in it is no number, or it is beyond this solver.
        """
        for state in self._solved(guard, scope, _State(dict(values))):
            for op, bound in state.bounds:
                if len(bound.factors) > 1 and op != "!=":
                    names = sorted(unknown.name for unknown in bound.factors)
                    raise RmlRunError(
                        f"a guard leaves an inequality between the unknown {' and '.join(names)}",
                        kind="unsupported",
                        hint="give all but one of them a value in the pattern or by an equation",
                    )
            # Terms that still wait for an unknown are dropped, as in the reference: they forbid nothing.
            yield state.values

    def _solved(self, guard: Data, scope: Scope, state: _State) -> Iterator[_State]:
        if isinstance(guard, Op) and guard.op == "&&":
            for first in self._solved(guard.args[0], scope, state):
                yield from self._solved(guard.args[1], scope, first)
        elif isinstance(guard, Op) and guard.op == "||":
            yield from self._solved(guard.args[0], scope, state.copy())
            yield from self._solved(guard.args[1], scope, state.copy())
        elif isinstance(guard, Op) and guard.op in COMPARISONS:
            if self._compared(guard, scope, state):
                yield state
        else:
            raise RmlRunError(f"{_what(guard)} stands where a guard needs a comparison", kind="type_error")

    def _compared(self, guard: Op, scope: Scope, state: _State) -> bool:
        """Add one comparison; whether everything established can still hold."""
        try:
            left = self._term(guard.args[0], scope, state)
            difference = _plus(left, self._term(guard.args[1], scope, state), -1.0)
        except _NoValueError:  # in a condition of `if` it is an error instead, as in the reference
            return False
        if isinstance(difference, float):
            return self._holds(guard.op, difference)
        # Not linear in its unknowns, like the reference's CLP(R): it waits until they have values.
        if difference is None:
            state.waiting.append((guard, scope))
            return True
        if guard.op == "==":
            self._determine(difference, state)
        else:
            state.bounds.append((guard.op, difference))
        return self._consistent(state)

    def _holds(self, op: str, difference: float) -> bool:
        held = holds(op, difference, self.tolerance)
        if held is not holds(op, difference, 0.0):
            self.close += 1
        return held

    def _determine(self, zero: _Linear, state: _State) -> None:
        """Use an equation to express one unknown by the others."""
        # The one with the largest factor: to divide by a small one would enlarge the rounding. Ties by
        # name, so that the order of dictionaries decides nothing.
        unknown = max(zero.factors, key=lambda u: (abs(zero.factors[u]), u.name))
        factor = zero.factors[unknown]
        rest = {u: -f / factor for u, f in zero.factors.items() if u is not unknown}
        meaning = _linear(-zero.constant / factor, rest)
        if isinstance(meaning, float):
            state.values[unknown] = meaning
        else:
            state.expressed[unknown] = meaning

    def _consistent(self, state: _State) -> bool:
        """Substitute what has become known, until that makes nothing else known."""
        while True:
            known = (len(state.values), len(state.expressed))
            for unknown, meaning in list(state.expressed.items()):
                value = self._resolved(meaning, state)
                if isinstance(value, float):
                    state.values[unknown] = value
                    del state.expressed[unknown]
                else:
                    state.expressed[unknown] = value
            bounds, state.bounds = state.bounds, []
            for op, bound in bounds:
                left = self._resolved(bound, state)
                if isinstance(left, _Linear):
                    state.bounds.append((op, left))
                elif not self._holds(op, left):
                    return False
            if not self._room(state):
                return False
            waiting, state.waiting = state.waiting, []
            if not all(self._compared(guard, scope, state) for guard, scope in waiting):
                return False
            if (len(state.values), len(state.expressed)) == known:
                return True

    def _resolved(self, term: _Linear, state: _State) -> float | _Linear:
        total: _Term = term.constant
        for unknown, factor in term.factors.items():
            total = _plus(total, _times(factor, self._of(unknown, state)), 1.0)
        assert total is not None
        return total

    def _of(self, unknown: Unknown, state: _State) -> float | _Linear:
        if unknown in state.values:
            return as_float(state.values[unknown], repr(unknown.name))
        return state.expressed.get(unknown) or _Linear(0.0, {unknown: 1.0})

    def _room(self, state: _State) -> bool:
        """Whether the inequalities with one unknown leave it a value; if only one is left, it gets that."""
        ranges: dict[Unknown, list[float]] = {}
        strict: dict[Unknown, list[bool]] = {}
        for op, bound in state.bounds:
            if len(bound.factors) != 1 or op == "!=":
                continue
            ((unknown, factor),) = bound.factors.items()
            edge, upper = -bound.constant / factor, (op in ("<", "<=")) is (factor > 0)
            limits = ranges.setdefault(unknown, [-math.inf, math.inf])
            open_ = strict.setdefault(unknown, [False, False])
            if (edge < limits[1]) if upper else (edge > limits[0]):
                limits[upper], open_[upper] = edge, op in ("<", ">")
            elif edge == limits[upper]:
                open_[upper] |= op in ("<", ">")
        for unknown, (low, high) in ranges.items():
            if low - high > self.tolerance:
                return False
            if math.isfinite(low) and abs(high - low) <= self.tolerance:
                if any(strict[unknown]):
                    return False
                state.values[unknown] = low
        return True

    def _term(self, data: Data, scope: Scope, state: _State) -> _Term:
        if isinstance(data, Num):
            return float(data.value)
        if isinstance(data, Var):
            return self._named(data.name, scope, state)
        if isinstance(data, Const) or data.op in _CONDITIONS:
            raise RmlRunError(f"{_what(data)} stands where a guard needs a number", kind="type_error")
        terms = [self._term(arg, scope, state) for arg in data.args]
        if data.op == "+":
            return _plus(terms[0], terms[1], 1.0)
        if data.op == "-":
            return _plus(terms[0], terms[1], -1.0) if len(terms) == 2 else _times(-1.0, terms[0])
        if data.op == "*":
            return _times(terms[0], terms[1])
        if data.op == "/":
            return _over(terms[0], terms[1])
        return _applied(data.op, terms)

    def _named(self, name: str, scope: Scope, state: _State) -> _Term:
        slot = slot_of_name(name, scope)
        if isinstance(slot, Bound):
            return as_float(slot.value, repr(name))
        if isinstance(slot, Unknown):
            return self._of(slot, state)
        if isinstance(slot, ExprSlot):
            return self._term(slot.data, slot.scope, state)
        raise RmlRunError(f"{name!r} is a pattern where a number is needed", kind="type_error")


_CONDITIONS = COMPARISONS.keys() | {"&&", "||"}


def _applied(function: str, terms: list[_Term]) -> _Term:
    if any(not isinstance(term, float) for term in terms):
        return None
    try:
        return float(FLOAT_FUNCTIONS[function](*terms))
    except (ValueError, OverflowError):
        if function == "^" and terms[0] == 0:
            raise _NoValueError from None
        raise RmlRunError(f"{function!r} has no value for {terms}", kind="evaluation_error") from None


def _what(data: Data) -> str:
    if isinstance(data, Var):
        return f"the name {data.name!r} alone"
    if isinstance(data, Const):
        return {True: "true", False: "false", None: "null"}[data.value]
    return f"the number {data.value}" if isinstance(data, Num) else f"an expression with {data.op!r}"
