"""`stl.formula` while a trial goes on: each instant is judged once what it looks at has come.

A formula that looks back is judged at once, one that looks ahead by a bounded time with
that delay. One that looks ahead without a bound is undecided until the end, and so is
dense time, in which margins also change between samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from math import inf, isfinite

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
from ariac_score_stl.specification import Specification
from ariac_score_stl.syntax import unbounded_ahead

__all__ = ["FormulaOnline", "undecided_online"]


def undecided_online(specification: Specification) -> str:
    """Why nothing is decided before the end; empty where something is."""
    if specification.time == "dense":
        return "dense time is judged at the end; 'time: discrete' can be watched"
    node = unbounded_ahead(specification.body)
    if node is None:
        return ""
    return (
        f"{node.text!r} (column {node.column}) looks ahead without a bound: undecided until the end; "
        f"give it bounds, as in '{node.operator}[0,5]'"
    )


class FormulaOnline:
    """One trial, watched by a formula.

    Args:
        specification: The formula and its parameters.
        bodies: The bodies known beforehand; the formula is judged for them.
        watch: Judges the formula on a trial that is over.
    """

    def __init__(
        self,
        specification: Specification,
        bodies: Sequence[Body],
        watch: Callable[[Trial], Iterable[Finding]],
    ) -> None:
        self.undecided = undecided_online(specification)
        self._watch, self._arrivals = watch, Arrivals()
        self._first_s = inf
        known = Trial("", bodies=tuple(bodies))
        judged = [] if self.undecided else subjects(known, specification.sources)
        self._subjects = [_Followed(specification, subject, self._arrivals) for subject in judged]
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
        return self._watch(self._arrivals.complete(trial))


class _Followed:
    """The formula for one robot, human or pair."""

    def __init__(self, specification: Specification, subject: Subject, arrivals: Arrivals) -> None:
        self.specification, self.subject = specification, str(subject)
        self.body = specification.body
        names = [source.signal(subject) for source in specification.sources.values()]
        self.aligned = arrivals.aligned(names, max_gap_s=specification.max_gap_s)
        self.window = -inf, inf
        self._restart()

    def _restart(self) -> None:
        self.rows: Discrete | None = None
        self.start_s = 0.0
        self.over = False
        self.worst = Verdict.SATISFIED

    def take(self, event: Event) -> None:
        """Start anew where the competition starts: until then the trial began with the first sample."""
        from_s, to_s = self.window
        if event.kind == COMPETITION_STARTED and from_s == -inf:
            self.window = event.t_s, to_s
            self._restart()
        elif event.kind == COMPETITION_ENDED:
            self.window = from_s, event.t_s

    def judged(self, first_s: float) -> Iterator[InstantVerdict]:
        """The verdicts that can be given by now."""
        for t_s, values in self.aligned.rows():
            from_s, to_s = self.window
            if self.over or not from_s <= t_s <= to_s:
                continue
            if self.rows is None:
                self.start_s = min(first_s, t_s) if from_s == -inf else from_s
                self.rows = Discrete(self.body, Rows(self.start_s), self.specification.beyond)
            try:
                predicates = decisive(margins(self.body, self._columns(values), 1))
            except FormulaError as error:
                self.over = True
                message = f"the formula has no value: {error.cause}"
                yield self._verdict(t_s, Verdict.INCONCLUSIVE, message, final=True)
                continue
            for begin_s, hole, lower, upper in self.rows.take(t_s, predicates, self.specification.max_gap_s):
                yield from self._row(begin_s, hole, lower, upper)

    def _columns(self, values: Sequence[float | tuple[float, ...]]) -> dict[str, FloatArray | float]:
        """The values of one instant as columns, by name."""
        columns: dict[str, FloatArray | float] = dict(self.specification.constants)
        for name, value in zip(self.specification.sources, values, strict=True):
            if isinstance(value, tuple):
                raise FormulaError(f"signal {name!r} has {len(value)} components; a formula takes one")
            columns[name] = np.array([value])
        return columns

    def _row(self, t_s: float, hole: bool, lower: float, upper: float) -> Iterator[InstantVerdict]:
        tree = self.specification.tree
        if self.over:
            return
        if not self.specification.is_rule:
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
            verdict = _verdict_between(lower, upper)
            if verdict is not Verdict.SATISFIED and self.worst is not Verdict.VIOLATED:
                self.worst = verdict
            if not hole:
                yield self._of_instant(t_s, lower, upper)

    def _whole(self, t_s: float) -> InstantVerdict:
        """The verdict on the whole formula, once the bounds of its `always` have passed."""
        # How long episodes last is counted at the end only; one shorter than t_on_s may still be forgiven.
        may_be_brief = self.worst is Verdict.VIOLATED and self.specification.t_on_s > 0
        text = self.specification.tree.text
        message = {
            Verdict.SATISFIED: f"{text!r} held",
            Verdict.VIOLATED: f"{text!r} failed",
            Verdict.INCONCLUSIVE: f"{text!r} could not be decided throughout",
        }[self.worst]
        return self._verdict(t_s, self.worst, message, final=not may_be_brief)

    def _of_instant(self, t_s: float, lower: float, upper: float, *, final: bool = False) -> InstantVerdict:
        verdict = _verdict_between(lower, upper)
        text = self.body.text
        if verdict is Verdict.INCONCLUSIVE:
            return self._verdict(t_s, verdict, f"{text!r} cannot be decided", final=final)
        margin = upper if verdict is Verdict.VIOLATED else lower
        margin = 0.0 if abs(margin) <= NEXT_TO_ZERO else margin
        unit = self.specification.shared_unit
        known = bool(unit) and isfinite(margin)
        by = f" by {abs(margin):.6g} {unit}" if known else ""
        message = f"{text!r} {'fails' if verdict is Verdict.VIOLATED else 'holds'}{by}"
        return InstantVerdict(
            self.subject,
            t_s,
            verdict,
            message,
            margin if known else None,
            unit if unit and known else "",
            final,
        )

    def _verdict(self, t_s: float, verdict: Verdict, message: str, *, final: bool) -> InstantVerdict:
        return InstantVerdict(self.subject, t_s, verdict, message, final=final)


def _verdict_between(lower: float, upper: float) -> Verdict:
    if upper < 0:
        return Verdict.VIOLATED
    return Verdict.INCONCLUSIVE if lower < 0 else Verdict.SATISFIED
