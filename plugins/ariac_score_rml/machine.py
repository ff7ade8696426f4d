"""Running a specification: each event rewrites the state, each state has a letter.

The rewriting rules are those of the reference, and choices are committed where it commits
them. They are written with continuations: alternatives are tried only when they are needed,
and a state may be nested to any depth without deep recursion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal, TypeAlias

from ariac_score_rml.arithmetic import argument, condition
from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.guards import TOLERANCE, Scope, Slot, Unknown, Values
from ariac_score_rml.matching import Matcher, slot_of
from ariac_score_rml.syntax import Spec, Var
from ariac_score_rml.terms import Given, Term, Terms
from ariac_score_rml.values import Bound, Json, same

__all__ = ["MAX_EVENT_TYPES", "MAX_STATE", "Letter", "Machine", "match_key", "slots_of"]

Letter = Literal["T", "t", "f", "F", "E"]
"""T: everything may follow; t: the trace may end here; f: it may not; F: rejected; E: cannot be judged."""

MAX_STATE = 100_000
"""How many parts a state may have."""

_MAX_ACTIONS = 20_000_000
"""How many rewriting steps one event may take."""

MAX_EVENT_TYPES = 12
"""Beyond this number of event types a state's transitions are not looked up by which of them match."""

_MAX_MEMOISED = 8
"""Beyond this number of event types the interpreter does not remember transitions: few come again."""

_MAX_KNOWN = 100_000

_Solution: TypeAlias = "dict[str, Json | _Valueless]"
_Next: TypeAlias = "tuple[Callable[..., Any], tuple[Any, ...]]"
_Failure: TypeAlias = "Callable[[], _Next | None]"
_Success: TypeAlias = "Callable[[Term, _Solution, _Failure], _Next | None]"


class _Valueless:
    """Stands for the value of a name that took part in a match and got none."""


_VALUELESS = _Valueless()


class _Solutions:
    """The solutions of one match, each found once, when it is first needed."""

    def __init__(self, found: Iterator[_Solution]) -> None:
        self._found, self._kept = found, list[_Solution]()
        self._error: RmlRunError | None = None

    def get(self, index: int) -> _Solution | None:
        while len(self._kept) <= index:
            if self._error is not None:
                raise self._error
            try:
                solution = next(self._found, None)
            except RmlRunError as error:
                self._error = error
                raise
            if solution is None:
                return None
            self._kept.append(solution)
        return self._kept[index]


class Machine:
    """A specification, ready to run.

    Args:
        spec: Parsed and checked.
        tolerance: Of guards; 0 compares exactly, as the oracle of ROSMonitoring does.
        max_state: How many parts a state may have.
    """

    def __init__(self, spec: Spec, *, tolerance: float = TOLERANCE, max_state: int = MAX_STATE) -> None:
        self.terms = Terms(spec)
        self.matcher = Matcher(spec, tolerance)
        self._max_state = max_state
        self._event: Json = None
        self._matches: dict[object, _Solutions] = {}
        self._found: Term | None = None
        self._steps_known: dict[tuple[Term, tuple[bool, ...]], Term | None] = {}
        self._steps: dict[str, Callable[[Term, _Success, _Failure], _Next | None]] = {
            "empty": self._empty,
            "all": self._all,
            "event": self._event_of,
            "or": self._or,
            "shuffle": self._shuffle,
            "seq": self._seq,
            "and": self._and,
            "let": self._let,
            "filter": self._filter,
            "ref": self._ref,
            "apply": self._ref,
            "if": self._if,
            "star": self._star,
            "plus": self._plus,
            "times": self._times,
            "opt": self._opt,
            "closure": self._closure,
        }

    @property
    def start(self) -> Term:
        """The state before any event."""
        return self.terms.main()

    def letter(self, state: Term) -> Letter:
        """The letter of a trace that has led to this state.

        Raises:
            RmlRunError: There is none, as when an `if` has no value.
        """
        if state is self.terms.all:
            return "T"
        return "t" if self.halts(state) else "f"

    def after_matches(self, state: Term, matches: Mapping[object, bool]) -> Term | None:
        """The state after any event that is of certain types.

        Args:
            state: The state before.
            matches: Whether the event is of each type that the state may test, by `match_key`; no type
                may have open names.
        """
        self._matches = {key: _Solutions(iter(({},) if held else ())) for key, held in matches.items()}
        return self._run(state)

    def after(self, state: Term, event: Json) -> Term | None:
        """The state after an event; `None` when the event is rejected.

        Raises:
            RmlRunError: The event cannot be judged, or a limit is reached.
        """
        self._event, self._matches = event, {}
        types = self.event_types(state)
        if types is None or len(types) > _MAX_MEMOISED:
            return self._run(state)
        try:
            bits = tuple(self._match(term).get(0) is not None for term in types)
        except (RmlRunError, RecursionError):
            return self._run(state)  # the error counts only if a step really tests that type
        if len(self._steps_known) > _MAX_KNOWN:
            self._steps_known.clear()
        if (state, bits) not in self._steps_known:
            self._steps_known[state, bits] = self._run(state)
        return self._steps_known[state, bits]

    def _run(self, state: Term) -> Term | None:
        self._found = None
        action: _Next | None = (self._step, (state, self._succeed, _fail))
        actions = 0
        try:
            while action is not None:
                call, arguments = action
                action = call(*arguments)
                actions += 1
                if actions > _MAX_ACTIONS:
                    raise RmlRunError(
                        f"one event takes more than {_MAX_ACTIONS} steps in equation {state.owner!r}",
                        kind="limit",
                    )
        except RecursionError:
            raise RmlRunError("the event is nested too deeply", kind="limit") from None
        return self._within_limits(self._found)

    def _within_limits(self, state: Term | None) -> Term | None:
        if state is not None:
            self.terms.check_size(state, self._max_state)
        return state

    def _succeed(self, state: Term, _bound: _Solution, _retry: _Failure) -> None:
        self._found = state

    # Matching ------------------------------------------------------------------------

    def solutions(self, term: Term, event: Json) -> _Solutions:
        """How an event is of the type that an event or filter names."""
        return _Solutions(self._solve(term, event))

    def _solve(self, term: Term, event: Json) -> Iterator[_Solution]:
        unknowns: dict[str, Unknown] = {}
        slots = slots_of(term.given, unknowns)
        for values in self.matcher.match(term.name, slots, event, {}):
            yield {name: _value(unknown, values) for name, unknown in unknowns.items()}

    def _match(self, term: Term) -> _Solutions:
        key = match_key(term)
        found = self._matches.get(key)
        if found is None:
            found = self._matches[key] = self.solutions(term, self._event)
        return found

    # Steps: each returns what to do next ---------------------------------------------

    def _step(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        return self._steps[term.kind](term, succeed, fail)

    def _empty(self, _term: Term, _succeed: _Success, fail: _Failure) -> _Next | None:
        return fail, ()

    def _all(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        return succeed, (term, {}, fail)

    def _event_of(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        solutions = self._match(term)

        def attempt(index: int) -> _Next | None:
            bound = solutions.get(index)
            if bound is None:
                return fail, ()
            return succeed, (self.terms.empty, bound, lambda: (attempt, (index + 1,)))

        return attempt(0)

    def _or(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        left, right = term.parts
        # Committed, as in the reference: once the left side takes the event, neither its other solutions
        # nor the right side are tried, even if what follows fails. So `retry` is dropped here.
        return self._step, (
            left,
            lambda state, bound, _: (succeed, (state, bound, fail)),
            lambda: (self._step, (right, succeed, fail)),
        )

    def _shuffle(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        left, right = term.parts
        fork = self.terms.fork
        # Committed as well: an event that both sides would take goes to the left one.
        return self._step, (
            left,
            lambda state, bound, _: (succeed, (fork(state, right), bound, fail)),
            lambda: (
                self._step,
                (right, lambda state, bound, retry: (succeed, (fork(left, state), bound, retry)), fail),
            ),
        )

    def _seq(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        first, then = term.parts

        # The first part keeps every event that it can take: `p* p` never finishes, as in the reference.
        def otherwise() -> _Next | None:
            return (self._step, (then, succeed, fail)) if self.halts(first) else (fail, ())

        return self._step, (
            first,
            lambda state, bound, _: (succeed, (self.terms.seq(state, then), bound, fail)),
            otherwise,
        )

    def _and(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        left, right = term.parts

        # The one place without commitment: pairs of alternatives are tried until their bindings agree.
        def both(state: Term, bound: _Solution, retry: _Failure) -> _Next | None:
            def other(state2: Term, bound2: _Solution, retry2: _Failure) -> _Next | None:
                joined = _joined(bound, bound2)
                if joined is None:
                    return retry2, ()
                return succeed, (self.terms.conj(state, state2), joined, retry2)

            return self._step, (right, other, retry)

        return self._step, (left, both, fail)

    def _let(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        def bind(state: Term, bound: _Solution, _: _Failure) -> _Next | None:
            value = bound.get(term.name, _VALUELESS)
            rest = {name: v for name, v in bound.items() if name != term.name}
            # The first event that gives the name a value fixes it for the whole block. Without a value it
            # goes on waiting; in the reference, later bindings then leak out of the block, which is a bug.
            if isinstance(value, _Valueless):
                return succeed, (self.terms.let(term.name, state, term.owner), rest, fail)
            return succeed, (self.terms.with_values(state, {term.name: Bound(value)}), rest, fail)

        return self._step, (term.parts[0], bind, fail)

    def _filter(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        inside, outside = term.parts
        matched = self._match(term).get(0)  # the first alone: committed, too
        filtered = self.terms.filtered
        if matched is None:
            return self._step, (
                outside,
                lambda state, bound, retry: (succeed, (filtered(term, inside, state), bound, retry)),
                fail,
            )

        def agree(state: Term, bound: _Solution, retry: _Failure) -> _Next | None:
            joined = _joined(matched, bound)
            if joined is None:
                return retry, ()
            return succeed, (filtered(term, state, outside), joined, retry)

        return self._step, (inside, agree, fail)

    def _ref(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        body = self.unfold(term)
        return (fail, ()) if body is None else (self._step, (body, succeed, fail))

    def _if(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        return self._step, (self.branch(term), succeed, fail)

    def _star(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        return self._repeated(term, term, succeed, fail)

    def _plus(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        return self._repeated(term, self.terms.make("star", term.parts, owner=term.owner), succeed, fail)

    def _times(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        if term.count == 0:  # `a{0}` takes no event, though a trace may end there
            return fail, ()
        if term.count == 1:
            return self._opt(term, succeed, fail)
        rest = self.terms.make("times", term.parts, count=term.count - 1, owner=term.owner)
        return self._repeated(term, rest, succeed, fail)

    def _repeated(self, term: Term, rest: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        def then(state: Term, bound: _Solution, retry: _Failure) -> _Next | None:
            return succeed, (self.terms.seq(state, rest), bound, retry)

        return self._step, (term.parts[0], then, fail)

    def _opt(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        return self._step, (term.parts[0], succeed, fail)

    def _closure(self, term: Term, succeed: _Success, fail: _Failure) -> _Next | None:
        def close(state: Term, bound: _Solution, retry: _Failure) -> _Next | None:
            return succeed, (self.terms.closure(state), bound, retry)

        return self._step, (term.parts[0], close, fail)

    # References and conditions -------------------------------------------------------

    def unfold(self, term: Term) -> Term | None:
        """The body of an equation as it is used here; `None` with a wrong number of arguments.

        In the reference no rule applies then, so that such a use takes no event; `check` warns.
        """
        if term.unfolded is None:
            equation = self.terms.equations[term.name]
            if len(term.data) != len(equation.params):
                return None
            env = dict(term.env)
            arguments = {p: Bound(argument(d, env)) for p, d in zip(equation.params, term.data, strict=True)}
            term.unfolded = self.terms.with_values(self.terms.body(term.name), {**env, **arguments})
        return term.unfolded

    def branch(self, term: Term) -> Term:
        """The branch of an `if` that its condition chooses."""
        return term.parts[0] if condition(term.data[0], dict(term.env)) else term.parts[1]

    # Which types a step may test -----------------------------------------------------

    def event_types(self, state: Term) -> tuple[Term, ...] | None:
        """The event types that a step from a state may test, in the order of the state.

        `None` when one of them has a name that an event would give its value: then a step
        depends on more than which of them match. Also when there are more than
        `MAX_EVENT_TYPES`.
        """
        if state.event_types is None:
            self._find_event_types(state)
        return None if not isinstance(state.event_types, tuple) else state.event_types

    def _find_event_types(self, root: Term) -> None:
        """Find those of every part a step may reach, inner parts first, so that each is visited once."""
        todo: list[tuple[Term, list[Term] | None]] = [(root, None)]
        path: set[int] = set()
        while todo:
            term, parts = todo.pop()
            if parts is not None:
                path.discard(id(term))
                term.event_types = self._event_types_of(term, parts)
            elif id(term) in path:
                root.event_types = False  # it comes back to itself through a condition, before any event
                return
            elif term.event_types is None:
                path.add(id(term))
                parts = list(self._next_parts(term))
                todo.append((term, parts))
                todo.extend((part, None) for part in reversed(parts) if part.event_types is None)

    def _event_types_of(self, term: Term, parts: list[Term]) -> tuple[Term, ...] | Literal[False]:
        found: dict[object, Term] = {}
        if term.kind in ("event", "filter"):
            if any(given.names for given in term.given):
                return False
            found[match_key(term)] = term
        for part in parts:
            if not isinstance(part.event_types, tuple):
                return False
            for one in part.event_types:
                found.setdefault(match_key(one), one)
        return tuple(found.values()) if len(found) <= MAX_EVENT_TYPES else False

    def _next_parts(self, term: Term) -> Iterator[Term]:
        """The parts of a state that a step may reach."""
        try:
            if term.kind in ("ref", "apply"):
                body = self.unfold(term)
                if body is not None:
                    yield body
            elif term.kind == "if":
                yield self.branch(term)
            elif term.kind == "seq":
                yield term.parts[0]
                if self.halts(term.parts[0]):
                    yield term.parts[1]
            else:
                yield from term.parts
        except RmlRunError:
            return  # a step that gets there raises it again, before it tests any type beyond

    # Halting -------------------------------------------------------------------------

    def halts(self, root: Term) -> bool:
        """Whether a trace may end in this state.

        Raises:
            RmlRunError: A condition that this hangs on has no value.
        """
        todo = [root]
        while todo:
            term = todo[-1]
            if term.halts is None:
                try:
                    found = self._halting(term)
                except RmlRunError as error:
                    found = error
                if isinstance(found, Term):
                    todo.append(found)
                    continue
                term.halts = found
            todo.pop()
        if isinstance(root.halts, RmlRunError):
            raise root.halts
        return bool(root.halts)

    def _halting(self, term: Term) -> bool | RmlRunError | Term:
        """Whether a state halts; or the part of it that has to be known first."""
        kind = term.kind
        if kind in ("empty", "all", "star", "opt", "closure"):
            return True
        if kind == "event" or (kind == "times" and term.count == 0):
            return kind == "times"
        if kind in ("ref", "apply"):
            body = self.unfold(term) or self.terms.body(term.name)
            return body if body.halts is None else body.halts
        if kind == "if":
            branch = self.branch(term)
            return branch if branch.halts is None else branch.halts
        for part in term.parts:
            if part.halts is None:
                return part
            if isinstance(part.halts, RmlRunError) or part.halts is (kind == "or"):
                return part.halts
        return kind != "or"


def match_key(term: Term) -> object:
    """The identity of an event type with its arguments."""
    return term.name, tuple(g.key for g in term.given)


def _fail() -> None:
    """There is no step."""


def slots_of(given: tuple[Given, ...], unknowns: dict[str, Unknown]) -> list[Slot]:
    """The arguments of an event type as it sees them; their open names join the unknowns."""
    return [_slot(one, unknowns) for one in given]


def _slot(given: Given, unknowns: dict[str, Unknown]) -> Slot:
    """An argument as the event type sees it; its open names are among the unknowns."""
    if isinstance(given.arg, Bound):
        return given.arg
    if isinstance(given.arg, Var):
        return unknowns.setdefault(given.arg.name, Unknown(given.arg.name))
    scope: Scope = dict(given.env)
    for name in sorted(given.names):
        scope[name] = unknowns.setdefault(name, Unknown(name))
    return slot_of(given.arg, scope)


def _value(unknown: Unknown, values: Values) -> Json | _Valueless:
    return values.get(unknown, _VALUELESS) if unknown in values else _VALUELESS


def _joined(a: _Solution, b: _Solution) -> _Solution | None:
    """Both, or `None` when they contradict each other."""
    if not a or not b:
        return a or b
    for name, value in a.items():
        if name in b:
            other = b[name]
            # Without a value on one side only, the two are not consistent, as in the reference.
            if isinstance(value, _Valueless) or isinstance(other, _Valueless):
                if value is not other:
                    return None
            elif not same(value, other):
                return None
    return {**a, **b}
