"""Laws that types leave open, as questions to a solver: is there any trial that breaks them?

The score is written over real numbers, one for each quantity that the law changes and one for everything
that it leaves as it is. The solver is asked for numbers that break the law; where there are none, it is
proven. All that is left out (that counts are whole, that formulas share parts) only gives the solver more
freedom: a proof stands, and numbers that it does find need be those of no trial, so they refute nothing.

The solver is z3 (the extra `prove`). Its effort is limited by steps, not by time, so that every machine finds
the same.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from math import inf, isfinite
from typing import Any

from ariac_score.review.proofs.elasticity import adds_up, worth_undone
from ariac_score.review.proofs.grades import Grade, Grades
from ariac_score.review.proofs.quantities import DURATION, VIOLATIONS, Quantity
from ariac_score.review.proofs.subject import Subject
from ariac_score.review.proofs.tree import Known, Node, Op, Taken, Term, bare, inputs_of, text
from ariac_score.scoring.signs import Sign, Typed

__all__ = ["BY_SOLVER", "Answer", "Solver", "find_solver", "score_with", "solver_version"]

_STEPS = 4_000_000
"""Of the solver, for one question; most take some thousand."""


class OutsideError(Exception):
    """What of a formula the solver is not asked about."""


def solver_version() -> str:
    """Name and version of the solver; empty where none is installed."""
    try:
        return f"z3 {version('z3-solver')}"
    except PackageNotFoundError:
        return ""


def find_solver() -> Solver | None:
    """The solver; `None` where it is not installed."""
    try:
        return Solver(import_module("z3"))
    except ImportError:
        return None


@dataclass(frozen=True)
class Answer:
    """What the solver says of a law.

    Attributes:
        proves: Whether there are no numbers that break it.
        words: What it was asked and what it found.
    """

    proves: bool
    words: str


@dataclass(frozen=True)
class Solver:
    """The solver, and what it is asked.

    Attributes:
        z3: The module.
    """

    z3: Any

    def ask(self, breaks: Iterable[Any], name: str) -> Answer:
        """Whether there are numbers that fulfil all of these.

        Args:
            breaks: What holds in a trial that breaks the law.
            name: The law, in words.
        """
        asked = self.z3.SolverFor("QF_NRA")
        asked.set("rlimit", _STEPS)
        asked.add(*breaks)
        found = asked.check()
        if found == self.z3.unsat:
            return Answer(True, f"no numbers break it: {name}")
        if found == self.z3.unknown:
            return Answer(False, "the solver gave up before it found an answer")
        model = asked.model()
        found = {str(one): str(model[one]) for one in model.decls() if one.arity() == 0}
        numbers = ", ".join(f"{one} = {found[one]}" for one in sorted(found) if found[one] != "0")
        return Answer(False, f"the solver breaks it with {numbers}, of which no trial was found")


@dataclass
class _Trial:
    """The score of one trial as a term of the solver.

    Attributes:
        solver: Which has the numbers.
        shared: Those of what is the same in several trials, by their tree.
        changed: The kinds of quantities that the law changes.
        own: What it writes behind the names of its own numbers.
        wanted: What holds of all numbers.
        scaled: How often what pieces of work give counts; `None`: pieces are not counted.
    """

    solver: Solver
    shared: dict[Node, Any]
    changed: frozenset[str]
    own: str
    wanted: list[Any]
    pins: Mapping[str, float] = field(default_factory=dict)
    scaled: Any = None
    numbers: dict[str, Any] = field(default_factory=dict)
    ranges: dict[Node, tuple[Any, Grade]] = field(default_factory=dict)
    works: set[Node] = field(default_factory=set)
    given: dict[Node, Any] = field(default_factory=dict)
    _known: dict[Node, Any] = field(default_factory=dict)

    def of(self, node: Node) -> Any:
        """A tree as a term."""
        node = bare(node)
        if node in self.given:
            return self.given[node]
        if node not in self._known:
            self._known[node] = self._of(node)
        return self._known[node]

    def _of(self, node: Node) -> Any:
        if isinstance(node, Known):
            return self.solver.z3.RealVal(repr(node.value))
        if not any(q.of in self.changed for q in inputs_of(node)):
            return self._same(node)
        if isinstance(node, Taken):
            return self._number(node.quantity)
        if isinstance(node, Op) and (found := self._op(node)) is not None:
            return found
        # What the solver is not asked about may be anything in its range.
        grade = Grades(pins=self.pins).of(node)
        number = self._between(f"{text(node)}{self.own}", grade.typed)
        self.ranges[node] = number, grade
        return number

    def _same(self, node: Node) -> Any:
        """The number of what the law leaves as it is."""
        if self.scaled is not None and adds_up(node) and any(q.adds for q in inputs_of(node)):
            self.works.add(node)
            return self.scaled * self._shared(node, Typed(0, inf))
        grade = Grades(pins=self.pins).of(node).typed
        if self.pins and any(q.name in self.pins for q in inputs_of(node)):
            return self._between(f"{text(node)}{self.own}", grade)
        return self._shared(node, grade)

    def _shared(self, node: Node, typed: Typed) -> Any:
        if node not in self.shared:
            self.shared[node] = self._between(text(node), typed)
        return self.shared[node]

    def _between(self, name: str, typed: Typed) -> Any:
        if typed.is_known:
            return self.solver.z3.RealVal(repr(typed.least))
        number = self.solver.z3.Real(name)
        self.wanted += [number >= repr(typed.least)] if isfinite(typed.least) else []
        self.wanted += [number <= repr(typed.most)] if isfinite(typed.most) else []
        return number

    def _number(self, quantity: Quantity) -> Any:
        if quantity.name in self.pins:
            return self.solver.z3.RealVal(repr(self.pins[quantity.name]))
        if quantity.name not in self.numbers:
            number = self._between(f"{quantity.name}{self.own}", Typed(quantity.least, quantity.most))
            if quantity.switch:
                self.wanted.append(self.solver.z3.Or(number == 0, number == 1))
            self.numbers[quantity.name] = number
        return self.numbers[quantity.name]

    def _op(self, node: Op) -> Any:
        z3 = self.solver.z3
        if node.name in ("<", "<=", "==", "!=", "and", "or", "not"):
            return z3.If(self._truth(node), z3.RealVal(1), z3.RealVal(0))
        if node.name == "if":
            return z3.If(self._truth(bare(node.of[0])), self.of(node.of[1]), self.of(node.of[2]))
        parts = [self.of(part) for part in node.of]
        if node.name == "+":
            return parts[0] + parts[1]
        if node.name == "*":
            return parts[0] * parts[1]
        if node.name == "/":
            self.wanted.append(parts[1] != 0)
            return parts[0] / parts[1]
        if node.name == "**" and isinstance(node.of[1], Known) and node.of[1].value in (1, 2, 3, 4):
            power = parts[0]
            for _ in range(int(node.of[1].value) - 1):
                power = power * parts[0]
            return power
        return self._function(node, parts)

    def _function(self, node: Op, parts: list[Any]) -> Any:
        z3 = self.solver.z3

        def least(one: Any, other: Any) -> Any:
            return z3.If(one <= other, one, other)

        def most(one: Any, other: Any) -> Any:
            return z3.If(one >= other, one, other)

        if node.name in ("min", "max"):
            found = parts[0]
            for part in parts[1:]:
                found = (least if node.name == "min" else most)(found, part)
            return found
        if node.name == "clip":
            return least(most(parts[0], parts[1]), parts[2])
        if node.name == "abs":
            return most(parts[0], -parts[0])
        if node.name in ("sum", "mean"):
            return sum(parts[1:], parts[0]) / (1 if node.name == "sum" else len(parts))
        if node.name == "ramp" and all(isinstance(end, Known) for end in node.of[:4]):
            best, worst, hi, lo, x = parts
            between = worst + (hi - x) / (hi - lo) * (best - worst) if node.of[2] != node.of[3] else worst
            return z3.If(x >= hi, worst, z3.If(x <= lo, best, between))
        if node.name == "runs":  # laws are about a trial that was run once
            return parts[0]
        return None

    def repeat(self, subject: Subject, count: Any) -> None:
        """Give the trial the violations of so many equal pieces: the same with each."""
        for quantity in subject.quantities.values():
            if quantity.of not in (VIOLATIONS, DURATION):
                continue
            each = self._shared(Taken(quantity), Typed(max(quantity.least, 0.0), quantity.most))
            if quantity.switch:
                self.wanted.append(self.solver.z3.Or(each == 0, each == 1))
            if quantity.adds or quantity.of == DURATION:
                first = self._shared(Term("first", Taken(quantity)), Typed(0, inf))
                each = first + count * each
            self.numbers[quantity.name] = each

    def _truth(self, node: Node) -> Any:
        z3, node = self.solver.z3, bare(node)
        if isinstance(node, Op) and node.name in ("<", "<=", "==", "!="):
            one, other = (self.of(part) for part in node.of)
            return {"<": one < other, "<=": one <= other, "==": one == other, "!=": one != other}[node.name]
        if isinstance(node, Op) and node.name in ("and", "or"):
            truths = [self._truth(part) for part in node.of]
            return z3.And(*truths) if node.name == "and" else z3.Or(*truths)
        if isinstance(node, Op) and node.name == "not":
            return z3.Not(self._truth(node.of[0]))
        return self.of(node) != 0


class _Pair:
    """Two trials that differ in the quantities of some kinds alone."""

    def __init__(self, solver: Solver, tree: Term, *changed: str) -> None:
        shared: dict[Node, Any] = {}
        self.wanted: list[Any] = []
        kinds = frozenset(changed)
        self.before = _Trial(solver, shared, kinds, "", self.wanted)
        self.after = _Trial(solver, shared, kinds, "'", self.wanted)
        self.scores = self.before.of(tree), self.after.of(tree)

        for node, (number, grade) in self.before.ranges.items():
            self.wanted += _ordered(number, self.after.ranges[node][0], grade, kinds, node)

    def numbers(self) -> Iterator[tuple[str, Any, Any]]:
        """Each number that may differ, by quantity."""
        for name, number in self.before.numbers.items():
            yield name, number, self.after.numbers[name]


def _ordered(before: Any, after: Any, grade: Grade, changed: frozenset[str], node: Node) -> list[Any]:
    """Which way something goes when all that is changed grows, where its type says so."""
    signs = {grade.sign(q.name) for q in inputs_of(node) if q.of in changed}
    if signs == {Sign.UP}:
        return [after >= before]
    return [after <= before] if signs == {Sign.DOWN} else []


def score_with(
    solver: Solver, subject: Subject, numbers: Mapping[Node, Any], pins: Mapping[str, float]
) -> Any:
    """The score as a term of the solver, where some of its parts are given numbers."""
    trial = _Trial(solver, {}, frozenset({VIOLATIONS}), "", [], pins=pins)
    trial.given = dict(numbers)
    return trial.of(subject.tree)


def more_violations(solver: Solver, subject: Subject) -> Answer:
    """Are there violations, and worse ones that give more?"""
    _refuse_falling(subject.priced_violations)
    pair = _Pair(solver, subject.tree, VIOLATIONS)
    worse = [after >= before for _, before, after in pair.numbers()]
    before, after = pair.scores
    return solver.ask(
        [*pair.wanted, *worse, after > before], "with at least as much violated, never a higher score"
    )


def always_costs(solver: Solver, subject: Subject) -> Answer:
    """Is there one more violation that leaves a score above 0 as it is, or raises it?"""
    _refuse_falling(subject.priced_violations)
    for check in subject.world.safety:
        always = [q.name for q in subject.priced_violations if check in q.checks and q.always]
        if not always:
            raise OutsideError(
                f"nothing that the score takes from {check} grows with every further violation"
            )
        pair = _Pair(solver, subject.tree, VIOLATIONS)
        worse = [
            after > before if name in always else after >= before for name, before, after in pair.numbers()
        ]
        before, after = pair.scores
        answer = solver.ask([*pair.wanted, *worse, before > 0, after >= before], "")
        if not answer.proves:
            return answer
    return Answer(True, "no numbers break it: with more violated, a score above 0 falls")


def nothing_left(solver: Solver, subject: Subject) -> Answer:
    """Can violations take everything that work is worth?"""
    shared: dict[Node, Any] = {}
    wanted: list[Any] = []
    none = {one.name: 0.0 for one in subject.quantities.values() if one.of == VIOLATIONS}
    kinds = frozenset({VIOLATIONS})
    done = _Trial(solver, shared, kinds, "", wanted).of(subject.tree)
    clean = _Trial(solver, shared, kinds, "", wanted, pins=none).of(subject.tree)
    return solver.ask([*wanted, clean > 0, done == 0], "violations never take all that work is worth")


def waiting(solver: Solver, subject: Subject) -> Answer:
    """Is there a trial that has another score when it only ends later?"""
    pair = _Pair(solver, subject.tree, DURATION)
    later = [after > before for _, before, after in pair.numbers()]
    before, after = pair.scores
    return solver.ask([*pair.wanted, *later, before != after], "a later end never gives another score")


def doing_nothing(solver: Solver, subject: Subject) -> Answer:
    """Is there work that is worth something without its violations, and less than none with them?"""
    shared: dict[Node, Any] = {}
    wanted: list[Any] = []
    none = {one.name: 0.0 for one in subject.quantities.values() if one.of == VIOLATIONS}
    kinds = frozenset({VIOLATIONS})
    # What is recorded, and cannot be made up, may be anything in both.
    done = _Trial(solver, shared, kinds, "", wanted).of(subject.tree)
    clean = _Trial(solver, shared, kinds, "", wanted, pins=none).of(subject.tree)
    idle = _Trial(solver, shared, kinds, " of no work", wanted, pins={**none, **subject.idle}).of(
        subject.tree
    )
    return solver.ask([*wanted, clean > idle, done < idle], "work that is worth something stays above none")


def stopping_early(solver: Solver, subject: Subject) -> Answer:
    """Is there a number of equal pieces after which one more, equal to them, lowers the score?"""
    z3 = solver.z3
    shared: dict[Node, Any] = {}
    wanted: list[Any] = []
    pieces = z3.Real("pieces")
    scores = []
    for own, count in (("", pieces), ("'", pieces + 1)):
        trial = _Trial(solver, shared, frozenset({VIOLATIONS, DURATION}), own, wanted, scaled=count)
        trial.repeat(subject, count)
        scores.append(trial.of(subject.tree))
        if len(trial.works) > 1:
            raise OutsideError("work earns in several places, of which one may be below 0")
        if any(worth_undone(work, subject.idle) for work in trial.works):
            raise OutsideError("what is not done may be worth something")
    nothing = {q.name: 0.0 for q in inputs_of(subject.tree) if q.of == VIOLATIONS}
    before, after = scores
    answer = solver.ask([*wanted, pieces >= 1, after < before], "one more equal piece never lowers the score")
    if not answer.proves:
        return answer
    idle = Grades(pins={**nothing, **subject.idle}).of(subject.tree).typed.most
    if not isfinite(idle):
        raise OutsideError("nothing bounds what no work gives")
    words = "one more equal piece never lowers the score, nor does the first"
    return solver.ask([*wanted, pieces == 1, before < repr(idle)], words)


def _refuse_falling(quantities: Iterable[Quantity]) -> None:
    for one in quantities:
        if not one.grows:
            raise OutsideError(f"{one} does not grow with violations: {one.why_not}")


BY_SOLVER: Mapping[str, Callable[[Solver, Subject], Answer]] = {
    "more_violations": more_violations,
    "always_costs": always_costs,
    "nothing_left": nothing_left,
    "waiting": waiting,
    "doing_nothing": doing_nothing,
    "stopping_early": stopping_early,
}
"""The laws that the solver is asked about where types do not prove them."""
