"""`stl.formula` while a trial goes on: each instant is judged once what it looks at has come.

A formula that looks back is judged at once, one that looks ahead by a bounded time with
that delay. One that looks ahead without a bound is undecided until the end, and so is
dense time, in which margins also change between samples.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import inf, isfinite
from typing import TYPE_CHECKING

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    Arrivals,
    Body,
    Event,
    Finding,
    FormulaError,
    Sample,
    Standing,
    Trial,
    Verdict,
)
from ariac_score_stl.rows import TOLERANCE_S
from ariac_score_stl.signals import Subject, subjects
from ariac_score_stl.stages import Network, unbounded_ahead
from ariac_score_stl.syntax import Node

if TYPE_CHECKING:
    from ariac_score_stl.formula import StlFormula

__all__ = ["FormulaOnline", "undecided_online"]

_LEAST = 5e-324
"""Stands for a margin of 0 that holds (or, negative, does not): nothing lies between it and 0."""


def undecided_online(monitor: StlFormula) -> str:
    """Why nothing can be said of a formula before the end; empty where something can."""
    if monitor.time == "dense":
        return "dense time is judged at the end; 'time: discrete' can be watched"
    body = _body(monitor.tree)
    node = unbounded_ahead(body)
    if node is None:
        return ""
    return (
        f"{node.text!r} (column {node.column}) looks ahead without a bound: undecided until the end; "
        f"give it bounds, as in '{node.operator}[0,5]'"
    )


def _body(tree: Node) -> Node:
    """What is judged at every moment; see `formula.Judged`."""
    return tree.parts[0] if tree.operator == "always" else tree


class FormulaOnline:
    """One trial, watched by a formula.

    Args:
        monitor: The formula.
        bodies: Those known beforehand; it is judged for them.
    """

    def __init__(self, monitor: StlFormula, bodies: Sequence[Body]) -> None:
        self.undecided = undecided_online(monitor)
        self._monitor, self._arrivals = monitor, Arrivals()
        self._first_s = inf
        known = Trial("", bodies=tuple(bodies))
        judged = [] if self.undecided else subjects(known, monitor.sources)
        self._subjects = [_Followed(monitor, subject, self._arrivals) for subject in judged]
        if not self._subjects:
            self.undecided = self.undecided or "whom it is about is not known before the trial"

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterator[Standing]:
        """Take samples, and judge every instant of which all is known by now."""
        self._arrivals.take(samples)
        for event in events:
            for followed in self._subjects:
                followed.told(event)
        if self._first_s == inf:
            self._first_s = min((sample.t_s for sample in samples), default=inf)
        for followed in self._subjects:
            yield from followed.judged(self._first_s)

    def end(self, trial: Trial) -> Iterable[Finding]:
        """What the formula finds in the trial with the samples that were stepped."""
        return self._monitor.watch(self._arrivals.complete(trial))


class _Followed:
    """The formula for one robot, human or pair."""

    def __init__(self, monitor: StlFormula, subject: Subject, arrivals: Arrivals) -> None:
        self.monitor, self.subject = monitor, str(subject)
        self.body = _body(monitor.tree)
        names = [source.signal(subject) for source in monitor.sources.values()]
        self.aligned = arrivals.aligned(names, max_gap_s=monitor.max_gap_s)
        self.margins = _Margins(self.body, list(monitor.sources), monitor.constants)
        self.window = -inf, inf
        self._begin_anew()

    def _begin_anew(self) -> None:
        self.network: Network | None = None
        self.start_s = 0.0
        self.over = False
        self.worst = Verdict.SATISFIED

    def told(self, event: Event) -> None:
        """Where the competition starts, what came before is forgotten; until then the first sample counts."""
        from_s, to_s = self.window
        if event.kind == COMPETITION_STARTED and from_s == -inf:
            self.window = event.t_s, to_s
            self._begin_anew()
        elif event.kind == COMPETITION_ENDED:
            self.window = from_s, event.t_s

    def judged(self, first_s: float) -> Iterator[Standing]:
        """What can be said by now."""
        for t_s, values in self.aligned.rows():
            from_s, to_s = self.window
            if self.over or not from_s <= t_s <= to_s:
                continue
            if self.network is None:
                self.start_s = min(first_s, t_s) if from_s == -inf else from_s
                self.network = Network(self.body, self.start_s, self.monitor.beyond, self.monitor.max_gap_s)
            try:
                margins = self.margins.of(values)
            except FormulaError as error:
                self.over = True
                yield self._told(t_s, Verdict.INCONCLUSIVE, f"the formula has no value: {error.cause}", True)
                continue
            for begin_s, hole, lower, upper in self.network.take(t_s, margins):
                yield from self._row(begin_s, hole, lower, upper)

    def _row(self, t_s: float, hole: bool, lower: float, upper: float) -> Iterator[Standing]:
        tree = self.monitor.tree
        if self.over:
            return
        if tree.operator != "always":
            self.over = True
            yield self._standing(self.start_s if hole else t_s, lower, upper, final=True)
            return
        from_s, to_s = -inf, inf
        if tree.bounds is not None:
            from_s, to_s = self.start_s + tree.bounds.start_s, self.start_s + tree.bounds.end_s
        if t_s > to_s + TOLERANCE_S:
            self.over = True
            yield self._whole(t_s)
        elif t_s >= from_s - TOLERANCE_S:
            verdict = _verdict(lower, upper)
            if verdict is not Verdict.SATISFIED and self.worst is not Verdict.VIOLATED:
                self.worst = verdict
            if not hole:
                yield self._standing(t_s, lower, upper)

    def _whole(self, t_s: float) -> Standing:
        """What the formula comes to, once the bounds of its `always` have passed."""
        brief = self.worst is Verdict.VIOLATED and self.monitor.t_on_s > 0
        words = {
            Verdict.SATISFIED: f"{self.monitor.tree.text!r} held",
            Verdict.VIOLATED: f"{self.monitor.tree.text!r} failed",
            Verdict.INCONCLUSIVE: f"{self.monitor.tree.text!r} could not be decided throughout",
        }
        return self._told(t_s, self.worst, words[self.worst], not brief)

    def _standing(self, t_s: float, lower: float, upper: float, *, final: bool = False) -> Standing:
        verdict = _verdict(lower, upper)
        text = self.body.text
        if verdict is Verdict.INCONCLUSIVE:
            return self._told(t_s, verdict, f"{text!r} cannot be decided", final)
        margin = upper if verdict is Verdict.VIOLATED else lower
        margin = 0.0 if abs(margin) <= _LEAST else margin
        unit = self._unit
        known = bool(unit) and isfinite(margin)
        by = f" by {abs(margin):.6g} {unit}" if known else ""
        words = f"{text!r} {'fails' if verdict is Verdict.VIOLATED else 'holds'}{by}"
        return Standing(
            self.subject, t_s, verdict, words, margin if known else None, unit if known else "", final
        )

    @property
    def _unit(self) -> str:
        """The unit of every margin, where all predicates share it."""
        units = {*self.monitor.margin_units.values()}
        return units.pop() if len(units) == 1 else ""

    def _told(self, t_s: float, verdict: Verdict, words: str, final: bool) -> Standing:
        return Standing(self.subject, t_s, verdict, words, final=final)


def _verdict(lower: float, upper: float) -> Verdict:
    if upper < 0:
        return Verdict.VIOLATED
    return Verdict.INCONCLUSIVE if lower < 0 else Verdict.SATISFIED


# Margins of predicates -------------------------------------------------------------------

Values = Mapping[str, float]


class _Margins:
    """The margin of every predicate at one instant, as `robustness.margins` gives it in columns."""

    def __init__(self, tree: Node, names: Sequence[str], constants: Mapping[str, float]) -> None:
        self.names, self.constants = names, constants
        self.predicates = [
            (node, node.margin, _quick(node.margin.root)) for node in tree.walk() if node.margin is not None
        ]

    def of(self, values: Sequence[float | tuple[float, ...]]) -> dict[Node, float]:
        """The margins, given the values of the signals.

        Raises:
            FormulaError: Division by zero, a result that is not finite, or a signal of several components.
        """
        known: dict[str, float] = dict(self.constants)
        for name, value in zip(self.names, values, strict=True):
            if isinstance(value, tuple):
                raise FormulaError(f"signal {name!r} has {len(value)} components; a formula takes one")
            known[name] = value
        found: dict[Node, float] = {}
        for node, expression, quick in self.predicates:
            margin = None if quick is None else quick(known)
            if margin is None or not isfinite(margin):
                margin = float(expression.columns(known))
            if node.comparison in ("==", "!="):
                margin = abs(margin) if node.comparison == "!=" else -abs(margin)
            if margin == 0:
                margin = -_LEAST if node.comparison in ("<", ">", "!=") else _LEAST
            found[node] = margin
        return found


def _quick(node: ast.expr) -> Callable[[Values], float | None] | None:
    """Plain arithmetic as plain Python, which rounds like numpy; `None` for anything else."""
    match node:
        case ast.Constant(value=int() | float() as value):
            number = float(value)
            return lambda _: number
        case ast.Name(id=name):
            return lambda known: known[name]
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            inner = _quick(operand)
            return None if inner is None else lambda known: _negated(inner(known))
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub() | ast.Mult() as op, right=right):
            a, b = _quick(left), _quick(right)
            return None if a is None or b is None else _binary(type(op), a, b)
    return None


def _negated(value: float | None) -> float | None:
    return None if value is None else -value


def _binary(
    op: type[ast.operator], a: Callable[[Values], float | None], b: Callable[[Values], float | None]
) -> Callable[[Values], float | None]:
    def value(known: Values) -> float | None:
        x, y = a(known), b(known)
        if x is None or y is None:
            return None
        return x + y if op is ast.Add else x - y if op is ast.Sub else x * y

    return value
