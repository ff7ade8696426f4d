"""States of a monitor: trace expressions with the values bound so far, each kept once.

Equal states are one object, so that what is true of a state (whether it may end, what
an event makes of it) is computed once. Nothing here recurses: a state may be thousands
of levels deep.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Literal, TypeAlias

from ariac_score_rml.checks import names_in
from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.syntax import (
    All,
    Arg,
    Chain,
    Const,
    Data,
    Empty,
    Event,
    EventType,
    Exp,
    Filter,
    If,
    Let,
    Literal_,
    Num,
    Post,
    Ref,
    Spec,
    Var,
)
from ariac_score_rml.values import Bound

__all__ = ["Env", "Given", "Term", "Terms"]

Env: TypeAlias = "tuple[tuple[str, Bound], ...]"
"""Values of names, sorted by name."""

_NONE: frozenset[str] = frozenset()


class Given:
    """An argument of an event type in a state: a value, a name, or something with names in it."""

    __slots__ = ("arg", "env", "key", "names")

    def __init__(self, arg: Arg | Bound, env: Env = ()) -> None:
        if isinstance(arg, Num | Const | Literal_):
            arg = Bound(arg.value)
        if isinstance(arg, Var) and env:
            arg, env = env[0][1], ()
        self.arg, self.env = arg, env
        names = () if isinstance(arg, Bound) else names_in(arg)
        self.names = frozenset(names) - {name for name, _ in env}
        self.key = (type(arg).__name__, arg, env)

    def with_values(self, values: Mapping[str, Bound]) -> Given:
        """The same with values for some of its names."""
        if isinstance(self.arg, Bound) or not self.names & values.keys():
            return self
        return Given(self.arg, _extended(self.env, self.names, values))


def _extended(env: Env, names: Iterable[str], values: Mapping[str, Bound]) -> Env:
    return tuple(sorted((*env, *((n, values[n]) for n in names if n in values)), key=lambda item: item[0]))


class Term:
    """One state, or part of one.

    Attributes:
        kind: `empty all event or seq and shuffle star plus opt closure times filter let if ref apply`.
        parts: The states it is made of.
        name: Of an event type, a let or an equation.
        given: Arguments of an event type.
        count: Of `times`.
        data: The condition of an `if`, or the arguments of an equation.
        env: Values of names in `data` and in the equation.
        open: Names without a value.
        size: Number of parts at all levels.
        owner: The equation it was written in.
        halts: Whether the trace may end here, or why that has no answer; `None`: not computed yet.
        unfolded: The body that a reference stands for, once it is computed.
        event_types: Those that a step may test, once they are computed; see `Machine.event_types`.
    """

    __slots__ = (
        "count",
        "data",
        "env",
        "event_types",
        "given",
        "halts",
        "kind",
        "name",
        "open",
        "owner",
        "parts",
        "size",
        "unfolded",
    )

    def __init__(
        self,
        kind: str,
        parts: tuple[Term, ...],
        name: str,
        given: tuple[Given, ...],
        count: int,
        data: tuple[Data, ...],
        env: Env,
        open_: frozenset[str],
        owner: str,
    ) -> None:
        self.kind, self.parts, self.name, self.given = kind, parts, name, given
        self.count, self.data, self.env, self.open, self.owner = count, data, env, open_, owner
        self.halts: bool | RmlRunError | None = None
        self.unfolded: Term | None = None
        self.event_types: tuple[Term, ...] | Literal[False] | None = None
        size: int = 1
        for part in parts:
            size += part.size
        self.size: int = size


class Terms:
    """Makes states, each once.

    Args:
        spec: Parsed and checked.
        most: How many states are remembered before all are forgotten; this affects nothing but time.
    """

    def __init__(self, spec: Spec, *, most: int = 200_000) -> None:
        self._most = most
        self._known: dict[tuple[object, ...], Term] = {}
        self.equations = {equation.name: equation for equation in spec.equations}
        self._free = self._free_names()
        self.empty = self.make("empty")
        self.all = self.make("all")
        self._bodies: dict[str, Term] = {}

    # Making --------------------------------------------------------------------------

    def make(
        self,
        kind: str,
        parts: tuple[Term, ...] = (),
        *,
        name: str = "",
        given: tuple[Given, ...] = (),
        count: int = 0,
        data: tuple[Data, ...] = (),
        env: Env = (),
        owner: str = "",
    ) -> Term:
        """The state of these parts."""
        key = (kind, *map(id, parts), name, tuple(g.key for g in given), count, tuple(map(id, data)), env)
        term = self._known.get(key)
        if term is None:
            if len(self._known) >= self._most:
                self._known.clear()
            open_ = self._open(kind, parts, name, given, data, env)
            term = self._known[key] = Term(kind, parts, name, given, count, data, env, open_, owner)
        return term

    def _open(
        self,
        kind: str,
        parts: tuple[Term, ...],
        name: str,
        given: tuple[Given, ...],
        data: tuple[Data, ...],
        env: Env,
    ) -> frozenset[str]:
        found = _NONE.union(*(part.open for part in parts), *(g.names for g in given))
        if kind == "let":
            return found - {name}
        if data or kind in ("ref", "apply"):
            names = {n for d in data for n in names_in(d)}
            if kind != "if":
                names |= self._free.get(name, _NONE)
            found |= names - {n for n, _ in env}
        return found

    # The constructors of the rewriting rules, their cases in the order that counts ----

    def seq(self, a: Term, b: Term) -> Term:
        """`a` and then `b`."""
        # `all a` becomes `all`: what follows is no longer required, as in the reference.
        if a is self.all or b is self.empty:
            return a
        if a is self.empty:
            return b
        # Nested to the right: a step then reaches the first part at once, however long the sequence is.
        if a.kind == "seq":
            return self.make(
                "seq", (a.parts[0], self.make("seq", (a.parts[1], b), owner=a.owner)), owner=a.owner
            )
        return self.make("seq", (a, b), owner=a.owner)

    def fork(self, a: Term, b: Term) -> Term:
        """`a` and `b` interleaved."""
        # `all | b` becomes b, so it does not mean "b among anything": that is what filters are for.
        if a is self.all:
            return b
        if b is self.all:
            return a
        if a is self.empty:
            return b
        if b is self.empty:
            return a
        return self._rotated("shuffle", a, b)

    def conj(self, a: Term, b: Term) -> Term:
        """Both `a` and `b`."""
        if a is self.all:
            return b
        if b is self.all:
            return a
        return self._rotated("and", a, b)

    def _rotated(self, kind: str, a: Term, b: Term) -> Term:
        if a.kind == kind:
            return self.make(
                kind, (a.parts[0], self.make(kind, (a.parts[1], b), owner=a.owner)), owner=a.owner
            )
        return self.make(kind, (a, b), owner=a.owner)

    def closure(self, a: Term) -> Term:
        """`a` or any beginning of it."""
        return a if a is self.all else self.make("closure", (a,), owner=a.owner)

    def filtered(self, like: Term, inside: Term, outside: Term) -> Term:
        """The filter of `like` with other branches."""
        if inside is self.all and outside is self.all:
            return inside
        return self.make("filter", (inside, outside), name=like.name, given=like.given, owner=like.owner)

    def let(self, name: str, body: Term, owner: str = "") -> Term:
        """`body` with a name that waits for its value."""
        if body is self.empty or body is self.all:
            return body
        return self.make("let", (body,), name=name, owner=owner)

    # From syntax ---------------------------------------------------------------------

    def main(self) -> Term:
        """The state before any event."""
        return self._reference(Ref("Main"), "Main")

    def _free_names(self) -> dict[str, frozenset[str]]:
        """Names of each equation that its use must give a meaning: scopes are dynamic."""
        free = dict.fromkeys(self.equations, _NONE)
        changed = True
        while changed:
            changed = False
            for name, equation in self.equations.items():
                found = self._names(equation.body, free) - set(equation.params)
                if found != free[name]:
                    free[name], changed = found, True
        return free

    def _names(self, exp: Exp, free: Mapping[str, frozenset[str]]) -> frozenset[str]:
        if isinstance(exp, Event):
            return frozenset(n for arg in exp.type.args for n in names_in(arg))
        if isinstance(exp, Ref):
            return free.get(exp.name, _NONE) | {n for arg in exp.args or () for n in names_in(arg)}
        if isinstance(exp, Chain):
            return _NONE.union(*(self._names(part, free) for part in exp.parts))
        if isinstance(exp, Post):
            return self._names(exp.body, free)
        if isinstance(exp, Let):
            return self._names(exp.body, free) - set(exp.names)
        if isinstance(exp, If):
            return self._names(exp.then, free) | self._names(exp.other, free) | set(names_in(exp.condition))
        if isinstance(exp, Filter):
            outside = _NONE if exp.outside is None else self._names(exp.outside, free)
            here = frozenset(n for arg in exp.type.args for n in names_in(arg))
            return here | self._names(exp.inside, free) | outside
        return _NONE

    def body(self, name: str) -> Term:
        """The body of an equation, with its names still open."""
        if name not in self._bodies:
            self._bodies[name] = self._term(self.equations[name].body, name)
        return self._bodies[name]

    def _term(self, exp: Exp, owner: str) -> Term:
        if isinstance(exp, Empty):
            return self.empty
        if isinstance(exp, All):
            return self.all
        if isinstance(exp, Event):
            return self.make("event", name=exp.type.name, given=_given(exp.type), owner=owner)
        if isinstance(exp, Ref):
            return self._reference(exp, owner)
        if isinstance(exp, Chain):
            return self._chain(exp, owner)
        if isinstance(exp, Post):
            return self.make(exp.op, (self._term(exp.body, owner),), count=exp.count, owner=owner)
        if isinstance(exp, Let):
            body = self._term(exp.body, owner)
            for name in reversed(exp.names):
                body = self.make("let", (body,), name=name, owner=owner)
            return body
        if isinstance(exp, If):
            parts = self._term(exp.then, owner), self._term(exp.other, owner)
            return self.make("if", parts, data=(exp.condition,), owner=owner)
        outside = self.all if exp.outside is None else self._term(exp.outside, owner)
        parts = self._term(exp.inside, owner), outside
        return self.make("filter", parts, name=exp.type.name, given=_given(exp.type), owner=owner)

    def _reference(self, ref: Ref, owner: str) -> Term:
        """The state of a reference. The rewriting rules must see one to `empty` or `all` as such."""
        meant: Exp = ref
        while isinstance(meant, Ref) and meant.args is None and meant.name in self.equations:
            equation = self.equations[meant.name]
            if equation.params:
                break
            meant = equation.body
        if isinstance(meant, Empty | All):
            return self._term(meant, owner)
        return self.make(
            "ref" if ref.args is None else "apply", name=ref.name, data=ref.args or (), owner=owner
        )

    def _chain(self, exp: Chain, owner: str) -> Term:
        kind = "seq" if exp.op == "cat" else exp.op
        parts = [self._term(part, owner) for part in exp.parts]
        if kind == "seq":
            joined = parts.pop()
            while parts:
                joined = self.make(kind, (parts.pop(), joined), owner=owner)
            return joined
        joined = parts[0]
        for part in parts[1:]:
            joined = self.make(kind, (joined, part), owner=owner)
        return joined

    # Values for names ----------------------------------------------------------------

    def with_values(self, root: Term, values: Mapping[str, Bound]) -> Term:
        """A state with values for some of its open names."""
        done: dict[tuple[Term, frozenset[str]], Term] = {}
        todo = [(root, frozenset(values))]
        while todo:
            term, names = todo[-1]
            if (term, names) in done:
                todo.pop()
                continue
            if not term.open & names:
                done[term, names] = term
                continue
            inner = names - {term.name} if term.kind == "let" else names
            missing = [(part, inner) for part in term.parts if (part, inner) not in done]
            if missing:
                todo.extend(missing)
                continue
            parts = tuple(done[part, inner] for part in term.parts)
            here = {name: values[name] for name in inner}
            done[term, names] = self._rebuilt(term, parts, here)
        return done[root, frozenset(values)]

    def _rebuilt(self, term: Term, parts: tuple[Term, ...], values: Mapping[str, Bound]) -> Term:
        env = term.env
        if term.kind in ("if", "ref", "apply"):
            wanted = {n for d in term.data for n in names_in(d)}
            if term.kind != "if":
                wanted |= self._free[term.name]
            bound = {n for n, _ in env}
            env = _extended(env, (n for n in wanted if n not in bound), values)
        return self.make(
            term.kind,
            parts,
            name=term.name,
            given=tuple(g.with_values(values) for g in term.given),
            count=term.count,
            data=term.data,
            env=env,
            owner=term.owner,
        )

    # Limits --------------------------------------------------------------------------

    def check_size(self, term: Term, most: int) -> None:
        """Refuse a state that has grown too large, naming the equation that it is made of.

        Raises:
            RmlRunError: It has more than `most` parts.
        """
        if term.size <= most:
            return
        count: Counter[str] = Counter()
        seen: set[int] = set()
        todo = [term]
        while todo:
            part = todo.pop()
            if id(part) not in seen:
                seen.add(id(part))
                count[part.owner] += 1
                todo.extend(part.parts)
        owner = min(count, key=lambda name: (-count[name], name))
        raise RmlRunError(
            f"the state has grown beyond {most} parts, most of them of equation {owner!r}",
            kind="limit",
            hint="something is opened with nearly every event and never closed; or set a higher limit",
        )


def _given(kind: EventType) -> tuple[Given, ...]:
    return tuple(Given(arg) for arg in kind.args)
