"""Event types: which events they match, and which values that gives to the names in their arguments."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

from ariac_score_rml.checks import repeated_key
from ariac_score_rml.guards import (
    TOLERANCE,
    ExprSlot,
    PatternSlot,
    Scope,
    Slot,
    Solver,
    Unknown,
    Values,
    slot_of_name,
)
from ariac_score_rml.syntax import (
    Anything,
    Arg,
    Const,
    Declaration,
    EventType,
    ListPattern,
    Literal_,
    Name,
    Num,
    Op,
    OrPattern,
    Pattern,
    RecordPattern,
    Spec,
    Var,
)
from ariac_score_rml.values import Bound, Json, fits

__all__ = ["Declared", "Matcher", "alternatives", "scope_of", "slot_of"]


def slot_of(arg: Arg, scope: Scope) -> Slot:
    """An argument of an event type, seen from inside it."""
    if isinstance(arg, Var):
        return slot_of_name(arg.name, scope)
    if isinstance(arg, Num | Const | Literal_):
        return Bound(arg.value)
    if isinstance(arg, Op):
        return ExprSlot(arg, scope)
    if isinstance(arg, Anything):
        return Unknown("_")
    return PatternSlot(arg, scope)


def alternatives(pattern: Pattern) -> Iterator[Pattern]:
    """The patterns without `|` that a pattern stands for; the leftmost part varies slowest."""
    if isinstance(pattern, OrPattern):
        for option in pattern.options:
            yield from alternatives(option)
    elif isinstance(pattern, RecordPattern):
        keys = [key for key, _ in pattern.fields]
        for parts in product(*(tuple(alternatives(inner)) for _, inner in pattern.fields)):
            # Fields match in the order of their keys, whatever the order they are written in.
            yield RecordPattern(tuple(sorted(zip(keys, parts, strict=True), key=lambda field: field[0])))
    elif isinstance(pattern, ListPattern):
        for parts in product(*(tuple(alternatives(inner)) for inner in pattern.items)):
            yield ListPattern(parts, pattern.rest)
    else:
        yield pattern


class Declared:
    """One declaration, its pattern resolved into alternatives."""

    def __init__(self, declaration: Declaration) -> None:
        self.params = [arg.name for arg in declaration.type.args if isinstance(arg, Var)]
        self.negated, self.guard = declaration.negated, declaration.guard
        self.parents = declaration.parents
        self.patterns = () if declaration.pattern is None else tuple(alternatives(declaration.pattern))


class Matcher:
    """The event types of a specification.

    Args:
        spec: Parsed and checked.
        tolerance: Of guards; see `Solver`.
    """

    def __init__(self, spec: Spec, tolerance: float = TOLERANCE) -> None:
        self.solver = Solver(tolerance)
        self._declared: dict[tuple[str, int], list[Declared]] = {}
        for declaration in (*spec.declarations, *_PREDECLARED):
            if declaration.pattern is not None and repeated_key(declaration.pattern):
                continue  # as in the reference, which loses it; `check` warns
            key = (declaration.type.name, len(declaration.type.args))
            self._declared.setdefault(key, []).append(Declared(declaration))

    def declared(self, name: str, count: int) -> Sequence[Declared]:
        """The declarations of a type with so many parameters, in the order of the text."""
        return self._declared.get((name, count), ())

    def match(self, name: str, slots: list[Slot], event: Json, values: Values) -> Iterator[Values]:
        """Every way an event is of a type, in order.

        Args:
            name: The type.
            slots: Its arguments.
            event: The event.
            values: The values of unknowns that have one already.

        Raises:
            RmlRunError: A guard cannot be evaluated.
        """
        for declared in self.declared(name, len(slots)):
            scope, known = scope_of(declared.params, slots, values)
            if known is None:
                continue
            found = self._alternatives(declared, scope, event, known)
            # The pattern alone is negated, the guard is not: as in the reference, and `check` warns.
            if declared.negated:
                if next(found, None) is not None:
                    continue
                found = iter((known,))
            for solution in found:
                if declared.guard is None:
                    yield solution
                else:
                    yield from self.solver.solve(declared.guard, scope, solution)

    def _alternatives(
        self, declared: Declared, scope: Scope, event: Json, values: Values
    ) -> Iterator[Values]:
        for pattern in declared.patterns:
            found = dict(values)
            if _takes(pattern, event, scope, found):
                yield found
        for parent in declared.parents:
            slots = [slot_of(arg, scope) for arg in parent.args]
            yield from self.match(parent.name, slots, event, values)


def scope_of(params: list[str], slots: list[Slot], values: Values) -> tuple[Scope, Values | None]:
    """The meaning of each parameter of a declaration; no values when two of one name disagree."""
    scope: Scope = {}
    for param, slot in zip(params, slots, strict=True):
        first = scope.get(param)
        if first is None:
            scope[param] = slot
        elif isinstance(first, Unknown) and isinstance(slot, Bound):
            values = {**values, first: slot.value}
        elif isinstance(first, Bound) and isinstance(slot, Unknown):
            values = {**values, slot: first.value}
        elif first is not slot and first != slot:
            return scope, None
    return scope, values


def _takes(pattern: Pattern, value: Json, scope: Scope, values: Values) -> bool:
    """Whether a pattern without `|` takes a value; unknowns in it get theirs."""
    if isinstance(pattern, Name):
        return _slot_takes(slot_of_name(pattern.name, scope), value, values)
    if isinstance(pattern, Literal_):
        return fits(pattern.value, value)
    if isinstance(pattern, RecordPattern):
        return isinstance(value, dict) and all(
            key in value and _takes(inner, value[key], scope, values) for key, inner in pattern.fields
        )
    if isinstance(pattern, ListPattern):
        if not isinstance(value, list):
            return False
        # `[...]` alone takes no empty list, in the reference neither.
        count, least = len(pattern.items), max(1, len(pattern.items))
        if not (len(value) >= least if pattern.rest else len(value) == count):
            return False
        return all(
            _takes(inner, part, scope, values) for inner, part in zip(pattern.items, value, strict=False)
        )
    return isinstance(pattern, Anything)


def _slot_takes(slot: Slot, value: Json, values: Values) -> bool:
    if isinstance(slot, Bound):
        return fits(slot.value, value)
    if isinstance(slot, Unknown):
        if slot in values:
            return fits(values[slot], value)
        values[slot] = value
        return True
    if isinstance(slot, PatternSlot):
        return any(_takes(option, value, slot.scope, values) for option in alternatives(slot.pattern))
    return False


_PREDECLARED = (
    Declaration(EventType("any"), negated=False, parents=(), pattern=RecordPattern(()), guard=None),
    Declaration(EventType("none"), negated=True, parents=(EventType("any"),), pattern=None, guard=None),
)
