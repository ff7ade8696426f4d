"""`stl.formula` while a trial goes on: each instant is judged once what it looks at has come.

A formula that looks back is judged at once, one that looks ahead by a bounded time with
that delay. One that looks ahead without a bound is undecided until the end, and so is
dense time, in which margins also change between samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import inf, isfinite
from typing import TYPE_CHECKING

import numpy as np

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    Arrivals,
    Body,
    Event,
    Finding,
    FormulaError,
    InstantVerdict,
    Sample,
    Trial,
    Verdict,
)
from ariac_score_stl.discrete import Discrete
from ariac_score_stl.margins import NEXT_TO_ZERO, decisive, margins
from ariac_score_stl.rows import TOLERANCE_S, Rows
from ariac_score_stl.signals import Subject, subjects
from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.syntax import unbounded_ahead

if TYPE_CHECKING:
    from ariac_score_stl.formula import StlFormula

__all__ = ["FormulaOnline", "undecided_online"]


def undecided_online(monitor: StlFormula) -> str:
    """Why nothing can be said of a formula before the end; empty where something can."""
    if monitor.time == "dense":
        return "dense time is judged at the end; 'time: discrete' can be watched"
    node = unbounded_ahead(monitor.body)
    if node is None:
        return ""
    return (
        f"{node.text!r} (column {node.column}) looks ahead without a bound: undecided until the end; "
        f"give it bounds, as in '{node.operator}[0,5]'"
    )


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

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterator[InstantVerdict]:
        """Take samples, and judge every instant of which all is known by now."""
        self._arrivals.take(samples)
        for event in events:
            for followed in self._subjects:
                followed.take(event)
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
        self.body = monitor.body
        names = [source.signal(subject) for source in monitor.sources.values()]
        self.aligned = arrivals.aligned(names, max_gap_s=monitor.max_gap_s)
        self.window = -inf, inf
        self._begin_anew()

    def _begin_anew(self) -> None:
        self.rows: Discrete | None = None
        self.start_s = 0.0
        self.over = False
        self.worst = Verdict.SATISFIED

    def take(self, event: Event) -> None:
        """Where the competition starts, what came before is forgotten; until then the first sample counts."""
        from_s, to_s = self.window
        if event.kind == COMPETITION_STARTED and from_s == -inf:
            self.window = event.t_s, to_s
            self._begin_anew()
        elif event.kind == COMPETITION_ENDED:
            self.window = from_s, event.t_s

    def judged(self, first_s: float) -> Iterator[InstantVerdict]:
        """What can be said by now."""
        for t_s, values in self.aligned.rows():
            from_s, to_s = self.window
            if self.over or not from_s <= t_s <= to_s:
                continue
            if self.rows is None:
                self.start_s = min(first_s, t_s) if from_s == -inf else from_s
                self.rows = Discrete(self.body, Rows(self.start_s), self.monitor.beyond)
            try:
                predicates = decisive(margins(self.body, self._columns(values), 1))
            except FormulaError as error:
                self.over = True
                yield self._standing(
                    t_s, Verdict.INCONCLUSIVE, f"the formula has no value: {error.cause}", True
                )
                continue
            for begin_s, hole, lower, upper in self.rows.take(t_s, predicates, self.monitor.max_gap_s):
                yield from self._row(begin_s, hole, lower, upper)

    def _columns(self, values: Sequence[float | tuple[float, ...]]) -> dict[str, FloatArray | float]:
        """The values of one instant as columns, by name."""
        found: dict[str, FloatArray | float] = dict(self.monitor.constants)
        for name, value in zip(self.monitor.sources, values, strict=True):
            if isinstance(value, tuple):
                raise FormulaError(f"signal {name!r} has {len(value)} components; a formula takes one")
            found[name] = np.array([value])
        return found

    def _row(self, t_s: float, hole: bool, lower: float, upper: float) -> Iterator[InstantVerdict]:
        tree = self.monitor.tree
        if self.over:
            return
        if tree.operator != "always":
            self.over = True
            yield self._of_instant(self.start_s if hole else t_s, lower, upper, final=True)
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
                yield self._of_instant(t_s, lower, upper)

    def _whole(self, t_s: float) -> InstantVerdict:
        """What the formula comes to, once the bounds of its `always` have passed."""
        brief = self.worst is Verdict.VIOLATED and self.monitor.t_on_s > 0
        words = {
            Verdict.SATISFIED: f"{self.monitor.tree.text!r} held",
            Verdict.VIOLATED: f"{self.monitor.tree.text!r} failed",
            Verdict.INCONCLUSIVE: f"{self.monitor.tree.text!r} could not be decided throughout",
        }
        return self._standing(t_s, self.worst, words[self.worst], not brief)

    def _of_instant(self, t_s: float, lower: float, upper: float, *, final: bool = False) -> InstantVerdict:
        verdict = _verdict(lower, upper)
        text = self.body.text
        if verdict is Verdict.INCONCLUSIVE:
            return self._standing(t_s, verdict, f"{text!r} cannot be decided", final)
        margin = upper if verdict is Verdict.VIOLATED else lower
        margin = 0.0 if abs(margin) <= NEXT_TO_ZERO else margin
        unit = self._unit
        known = bool(unit) and isfinite(margin)
        by = f" by {abs(margin):.6g} {unit}" if known else ""
        words = f"{text!r} {'fails' if verdict is Verdict.VIOLATED else 'holds'}{by}"
        return InstantVerdict(
            self.subject, t_s, verdict, words, margin if known else None, unit if known else "", final
        )

    @property
    def _unit(self) -> str:
        """The unit of every margin, where all predicates share it."""
        units = {*self.monitor.margin_units.values()}
        return units.pop() if len(units) == 1 else ""

    def _standing(self, t_s: float, verdict: Verdict, words: str, final: bool) -> InstantVerdict:
        return InstantVerdict(self.subject, t_s, verdict, words, final=final)


def _verdict(lower: float, upper: float) -> Verdict:
    if upper < 0:
        return Verdict.VIOLATED
    return Verdict.INCONCLUSIVE if lower < 0 else Verdict.SATISFIED
