"""What is wrong with a specification before it has seen an event."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from difflib import get_close_matches

from ariac_score_rml.faults import RmlError, Warned
from ariac_score_rml.syntax import (
    Anything,
    Arg,
    Chain,
    Data,
    Declaration,
    Equation,
    Event,
    EventType,
    Exp,
    Filter,
    If,
    Let,
    ListPattern,
    Literal_,
    Name,
    Op,
    OrPattern,
    Pattern,
    Place,
    Post,
    RecordPattern,
    Ref,
    Spec,
    Var,
)
from ariac_score_rml.tokens import Dialect

__all__ = ["MAX_ALTERNATIVES", "check", "event_types", "names_in", "references", "repeated_key"]

MAX_ALTERNATIVES = 4096
"""How many patterns one pattern with `|` may stand for."""

MAX_DERIVATIONS = 50
"""How long a chain of derived event types may be."""


def check(spec: Spec, *, dialect: Dialect = "2024", file: object = None) -> list[Warned]:
    """Refuse what cannot be run; return what can but looks wrong.

    Raises:
        RmlError: With the same kinds of refusal as the conformance cases name.
    """
    try:
        equations = _equations(spec)
        reachable = _reachable(equations)
        _contractive({name: equations[name] for name in reachable})
        for equation in spec.equations:
            for kind in event_types(equation.body):
                _check_arguments(kind, dialect)
        for declaration in spec.declarations:
            _check_alternatives(declaration)
        _check_derivations(spec)
    except RmlError as error:
        raise RmlError(
            error.cause, kind=error.kind, line=error.line, column=error.column, file=file, hint=error.hint
        ) from None
    return list(_warnings(spec, equations, reachable))


def _at(place: Place) -> dict[str, int]:
    return {"line": place.line, "column": place.column}


def _refused(kind: str, cause: str, place: Place, hint: str = "") -> RmlError:
    return RmlError(cause, kind=kind, line=place.line, column=place.column, hint=hint)


# Walking ---------------------------------------------------------------------------------


def _children(exp: Exp) -> tuple[Exp, ...]:
    if isinstance(exp, Chain):
        return exp.parts
    if isinstance(exp, Post | Let):
        return (exp.body,)
    if isinstance(exp, If):
        return exp.then, exp.other
    if isinstance(exp, Filter):
        return (exp.inside,) if exp.outside is None else (exp.inside, exp.outside)
    return ()


def _walk(exp: Exp) -> Iterator[Exp]:
    """Every expression in a tree, in source order."""
    todo = [exp]
    while todo:
        node = todo.pop()
        yield node
        todo.extend(reversed(_children(node)))


def references(exp: Exp) -> list[Ref]:
    """The equations an expression names, in source order."""
    return [node for node in _walk(exp) if isinstance(node, Ref)]


def event_types(exp: Exp) -> list[EventType]:
    """The event types an expression names, in source order."""
    return [node.type for node in _walk(exp) if isinstance(node, Event | Filter)]


def names_in(arg: Arg) -> Iterator[str]:
    """The names in a data expression or pattern, in source order."""
    if isinstance(arg, Var | Name):
        yield arg.name
    elif isinstance(arg, Op):
        for operand in arg.args:
            yield from names_in(operand)
    elif isinstance(arg, RecordPattern):
        for _, pattern in arg.fields:
            yield from names_in(pattern)
    elif isinstance(arg, ListPattern | OrPattern):
        for item in arg.items if isinstance(arg, ListPattern) else arg.options:
            yield from names_in(item)


# Refusals --------------------------------------------------------------------------------


def _equations(spec: Spec) -> dict[str, Equation]:
    found: dict[str, Equation] = {}
    for equation in spec.equations:
        if equation.name in found:
            first = found[equation.name].place
            raise _refused(
                "duplicate_equation",
                f"equation {equation.name!r} is defined a second time",
                equation.place,
                f"the first definition is in line {first.line}; nothing can be run with two",
            )
        found[equation.name] = equation
    return found


def _reachable(equations: Mapping[str, Equation]) -> list[str]:
    if "Main" not in equations:
        first = next(iter(equations.values()))
        raise _refused(
            "undefined_identifier", "there is no equation 'Main'", first.place, "monitoring begins there"
        )
    if equations["Main"].params:
        raise _refused(
            "main_is_generic", "'Main' has parameters", equations["Main"].place, "monitoring begins there"
        )
    found, todo = {"Main": None}, ["Main"]
    while todo:
        for ref in references(equations[todo.pop()].body):
            if ref.name not in equations:
                near = get_close_matches(ref.name, sorted(equations), n=1)
                hint = f"did you mean {near[0]!r}?" if near else f"defined: {', '.join(sorted(equations))}"
                raise _refused(
                    "undefined_identifier", f"equation {ref.name!r} is not defined", ref.place, hint
                )
            if ref.name == "Main" and ref.args is not None:
                raise _refused("main_is_generic", "'Main' cannot be given arguments", ref.place)
            if ref.name not in found:
                found[ref.name] = None
                todo.append(ref.name)
    return list(found)


def _contractive(equations: Mapping[str, Equation]) -> None:
    """No cycle of references may be free of a sequence that has taken an event before it."""
    empties = _empties(equations)
    unguarded = {
        name: [ref for ref, guarded in _guards(equation.body, empties) if not guarded]
        for name, equation in equations.items()
    }
    state: dict[str, int] = {}  # 1: on the path, 2: done
    for start in equations:
        path: list[tuple[str, Iterator[Ref]]] = []
        if start not in state:
            state[start] = 1
            path.append((start, iter(unguarded[start])))
        while path:
            name, refs = path[-1]
            ref = next(refs, None)
            if ref is None:
                state[name] = 2
                path.pop()
            elif state.get(ref.name) == 1:
                raise _refused(
                    "not_contractive",
                    f"{ref.name!r} can come back to itself without an event in between",
                    ref.place,
                    "put an event before it, as in `X = a X`",
                )
            elif ref.name not in state:
                state[ref.name] = 1
                path.append((ref.name, iter(unguarded[ref.name])))


def _empties(equations: Mapping[str, Equation]) -> dict[str, bool]:
    """Which equations can be empty: the least solution."""
    empties = dict.fromkeys(equations, False)
    users: dict[str, dict[str, None]] = {name: {} for name in equations}
    for name, equation in equations.items():
        for ref in references(equation.body):
            users[ref.name][name] = None
    todo: dict[str, None] = dict.fromkeys(reversed(list(equations)))
    while todo:
        again: dict[str, None] = {}
        for name in todo:
            if not empties[name] and _can_be_empty(equations[name].body, empties):
                empties[name] = True
                again.update(users[name])
        todo = again
    return empties


def _can_be_empty(exp: Exp, empties: Mapping[str, bool]) -> bool:
    if isinstance(exp, Event):
        return False
    if isinstance(exp, Ref):
        return empties[exp.name]
    if isinstance(exp, Post):
        inner = exp.op == "plus" or (exp.op == "times" and exp.count > 0)
        return _can_be_empty(exp.body, empties) if inner else True
    # A filter without its second branch has one child: the missing one is `all`, which can be empty.
    parts = [_can_be_empty(child, empties) for child in _children(exp)]
    return any(parts) if isinstance(exp, Chain) and exp.op == "or" else all(parts)


def _guards(exp: Exp, empties: Mapping[str, bool]) -> list[tuple[Ref, bool]]:
    """Each reference in source order, and whether an event comes before it for sure."""
    found: list[tuple[Ref, bool]] = []
    todo: list[tuple[Exp, bool]] = [(exp, False)]
    while todo:
        node, guarded = todo.pop()
        if isinstance(node, Ref):
            found.append((node, guarded))
        children: list[tuple[Exp, bool]] = []
        for child in _children(node):
            children.append((child, guarded))
            if isinstance(node, Chain) and node.op == "cat" and not guarded:
                guarded = not _can_be_empty(child, empties)
        todo.extend(reversed(children))
    return found


def _check_arguments(kind: EventType, dialect: Dialect) -> None:
    for arg in kind.args:
        if isinstance(arg, OrPattern) and dialect == "rosmonitoring":
            raise _refused(
                "or_pattern_as_argument", f"an argument of {kind.name!r} is a pattern with '|'", kind.place
            )
        if isinstance(arg, _PATTERNS) and dialect == "2024":
            raise _refused(
                "pattern_argument_in_expression",
                f"an argument of {kind.name!r} is a pattern; in expressions only names and values may be",
                kind.place,
                f"declare `t matches {kind.name}(…);` and use t, or choose the dialect rosmonitoring",
            )


_PATTERNS = (Anything, Literal_, RecordPattern, ListPattern, OrPattern)


def _check_alternatives(declaration: Declaration) -> None:
    if declaration.pattern is not None and _alternatives(declaration.pattern) > MAX_ALTERNATIVES:
        raise _refused(
            "too_many_alternatives",
            f"the pattern of {declaration.type.name!r} stands for more than {MAX_ALTERNATIVES} patterns",
            declaration.type.place,
            "declare event types for its parts",
        )


def _alternatives(pattern: Pattern) -> int:
    if isinstance(pattern, OrPattern):
        total = 0
        for option in pattern.options:
            total += _alternatives(option)
        return total
    product = 1
    if isinstance(pattern, RecordPattern):
        for _, inner in pattern.fields:
            product *= _alternatives(inner)
    elif isinstance(pattern, ListPattern):
        for inner in pattern.items:
            product *= _alternatives(inner)
    return product


def _check_derivations(spec: Spec) -> None:
    """No event type may be derived from itself, nor through too many others."""
    declared: dict[tuple[str, int], list[Declaration]] = {}
    for declaration in spec.declarations:
        declared.setdefault((declaration.type.name, len(declaration.type.args)), []).append(declaration)
    height: dict[tuple[str, int], int] = {}
    for start in declared:
        path = [start]
        while path:
            key = path[-1]
            parents = [(p.name, len(p.args)) for d in declared.get(key, ()) for p in d.parents]
            missing = next((parent for parent in parents if parent not in height), None)
            if missing is None:
                height[key] = 1 + max((height[parent] for parent in parents), default=0)
                path.pop()
            elif missing in path:
                raise _refused(
                    "cyclic_event_type",
                    f"event type {missing[0]!r} is derived from itself",
                    declared[missing][0].type.place,
                )
            else:
                path.append(missing)
        if height[start] > MAX_DERIVATIONS:
            raise _refused(
                "too_deep",
                f"event type {start[0]!r} is derived through more than {MAX_DERIVATIONS} others",
                declared[start][0].type.place,
            )


# Warnings --------------------------------------------------------------------------------


def _warnings(spec: Spec, equations: Mapping[str, Equation], reachable: Iterable[str]) -> Iterator[Warned]:
    declared = {(d.type.name, len(d.type.args)) for d in spec.declarations} | {("any", 0), ("none", 0)}
    for kind in _used_types(spec):
        if (kind.name, len(kind.args)) not in declared:
            yield _warned(
                kind.place,
                f"event type {kind.name!r} with {_count(len(kind.args))} is not declared: it never matches",
            )
    for equation in spec.equations:
        if equation.name not in reachable:
            yield _warned(equation.place, f"equation {equation.name!r} is never used")
        for ref in references(equation.body):
            params = equations[ref.name].params if ref.name in equations else ()
            if ref.name in equations and len(ref.args or ()) != len(params):
                yield _warned(
                    ref.place,
                    f"{ref.name!r} has {_count(len(params))} but is given {len(ref.args or ())}: "
                    "it takes no event",
                )
    yield from _uncovered(equations)
    for declaration in spec.declarations:
        yield from _odd_declaration(declaration)
    for data in _all_data(spec):
        yield from _mixed(data)


def _warned(place: Place, sentence: str) -> Warned:
    return Warned(f"line {place.line}, column {place.column}: {sentence}")


def _count(n: int) -> str:
    return f"{n} parameter{'' if n == 1 else 's'}"


def _used_types(spec: Spec) -> Iterator[EventType]:
    for declaration in spec.declarations:
        yield from declaration.parents
    for equation in spec.equations:
        yield from event_types(equation.body)


def _uncovered(equations: Mapping[str, Equation]) -> Iterator[Warned]:
    """Names that no `let` or parameter gives a scope, found from Main on; scopes are dynamic."""
    warned: set[str] = set()
    seen: set[tuple[str, frozenset[str]]] = set()
    todo: list[tuple[Exp, frozenset[str]]] = [(equations["Main"].body, frozenset())]
    while todo:
        exp, scope = todo.pop()
        if isinstance(exp, Ref):
            equation = equations[exp.name]
            inner = scope | set(equation.params)
            if (exp.name, inner) not in seen:
                seen.add((exp.name, inner))
                todo.append((equation.body, inner))
        if isinstance(exp, Let):
            scope |= set(exp.names)
        if isinstance(exp, Event | Filter):
            for arg in exp.type.args:
                for name in names_in(arg):
                    if name not in scope and name not in warned:
                        warned.add(name)
                        yield _warned(
                            exp.type.place, f"no let declares the name {name!r}: its value is not kept"
                        )
        todo.extend((child, scope) for child in reversed(_children(exp)))


def _odd_declaration(declaration: Declaration) -> Iterator[Warned]:
    name, place = declaration.type.name, declaration.type.place
    pattern = declaration.pattern
    if isinstance(pattern, OrPattern) and any(isinstance(option, Name) for option in pattern.options):
        yield _warned(
            place, f"in the pattern of {name!r} a name next to '|' is a variable that matches everything"
        )
    if declaration.negated and declaration.guard is not None:
        yield _warned(place, f"{name!r} negates its pattern but not its guard")
    if pattern is not None and repeated_key(pattern):
        yield _warned(
            place,
            f"the pattern of {name!r} has the key {repeated_key(pattern)!r} twice: this declaration is lost",
        )


def repeated_key(pattern: Pattern) -> str:
    """A key that stands twice in one record of a pattern; empty when there is none."""
    if isinstance(pattern, RecordPattern):
        keys = [key for key, _ in pattern.fields]
        twice = [key for key in keys if keys.count(key) > 1]
        inner: Iterable[Pattern] = [p for _, p in pattern.fields]
        if twice:
            return twice[0]
    elif isinstance(pattern, ListPattern):
        inner = pattern.items
    else:
        inner = pattern.options if isinstance(pattern, OrPattern) else ()
    return next((key for key in map(repeated_key, inner) if key), "")


def _all_data(spec: Spec) -> Iterator[Data]:
    for declaration in spec.declarations:
        if declaration.guard is not None:
            yield declaration.guard
    for equation in spec.equations:
        for exp in _walk(equation.body):
            if isinstance(exp, If):
                yield exp.condition
            elif isinstance(exp, Ref):
                yield from exp.args or ()
            elif isinstance(exp, Event | Filter):
                yield from (arg for arg in exp.type.args if isinstance(arg, Op))


_MIXED = {"/": "*", "-": "+"}
"""An operator, and the one that binds tighter here although it usually does not."""


def _mixed(data: Data) -> Iterator[Warned]:
    if not isinstance(data, Op):
        return
    for operand in data.args:
        yield from _mixed(operand)
    tighter = _MIXED.get(data.op)
    if tighter is None or len(data.args) < 2:
        return
    right = data.args[1]
    if isinstance(right, Op) and right.op == tighter and not right.grouped:
        yield _warned(
            data.place, f"{tighter!r} binds tighter than {data.op!r}: the right side is taken together first"
        )
