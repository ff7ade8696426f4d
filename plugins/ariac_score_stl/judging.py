"""A formula on the signals of one subject: when it is judged, and what its margin is then."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from math import inf
from typing import TYPE_CHECKING

import numpy as np

from ariac_score import Span, episodes_where, sample_durations, uncovered_spans
from ariac_score_stl.dense import Dense, Steps
from ariac_score_stl.discrete import Discrete
from ariac_score_stl.explain import Cause, causes
from ariac_score_stl.margins import Margin, margins, truths
from ariac_score_stl.rows import TOLERANCE_S, BoolArray, Rows
from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.syntax import Node

if TYPE_CHECKING:
    from ariac_score_stl.formula import StlFormula

__all__ = ["JudgedFormula"]


class JudgedFormula:
    """A formula, judged.

    Args:
        monitor: The formula.
        t: Sample times within the trial, shape (n,), s; there has to be one.
        columns: Values of the signals at these, shape (n,), by the names that the formula has for them.
        span: The trial.

    Attributes:
        body: What is judged at every moment of `stretch`: all of the formula, or what follows its `always`.
        gaps: Where nothing is known.
        predicates: The margin of every predicate at every sample, shape (n,).
        stretch: When it is judged.
        overrun: Whether that ends after the trial.
        late: Whether that begins after the trial.
        begin: The moments that are judged, shape (m,), s: samples and holes, or steps of dense time.
        lower: The margin of the body is at least this then, shape (m,).
        upper: The margin of the body is at most this then, shape (m,).
        violated: Where the formula is broken, shape (m,).
        open: Where it cannot be decided, shape (m,).

    Raises:
        FormulaError: A predicate has no value at some sample.
    """

    def __init__(
        self, monitor: StlFormula, t: FloatArray, columns: Mapping[str, FloatArray], span: Span
    ) -> None:
        self.monitor, self.t, self.columns, self.span = monitor, t, columns, span
        self.body = monitor.body
        self.gaps = uncovered_spans(t, span, max_gap_s=monitor.max_gap_s)
        self.predicates = margins(monitor.tree, {**columns, **monitor.constants}, len(t))
        self.stretch, self.overrun, self.late = self._stretch()
        self._evaluated = self._decided = self._evaluate(self.predicates)
        self.begin, margin = self._moments(self._evaluated)
        decided = margin
        if not (margin.lower.all() and margin.upper.all()):  # a margin of exactly 0 does not tell < from <=
            self._decided = self._evaluate(truths(self.predicates))
            begin, decided = self._moments(self._decided)
            if monitor.time == "dense":  # where truth changes, a margin of 0 may stay as it is
                margin_begin, truth_begin = self.begin, begin
                self.begin = np.unique(np.concatenate((margin_begin, truth_begin)))
                margin = Steps(margin_begin, margin).on(self.begin)
                decided = Steps(truth_begin, decided).on(self.begin)
        self.lower, self.upper = margin.lower, margin.upper
        self.violated: BoolArray = decided.upper < 0
        self.open: BoolArray = (decided.lower < 0) & ~self.violated

    def _evaluate(self, predicates: Mapping[Node, FloatArray]) -> Dense | Discrete:
        monitor = self.monitor
        if monitor.time == "dense":
            return Dense(self.body, self.t, self.span, predicates, monitor.beyond, monitor.max_gap_s)
        return Discrete.whole(self.body, self._rows, predicates, monitor.beyond)

    @cached_property
    def _rows(self) -> Rows:
        return Rows.of(self.t, self.span, self.gaps)

    def _stretch(self) -> tuple[Span, bool, bool]:
        tree, start_s, end_s = self.monitor.tree, self.span.start_s, self.span.end_s
        if tree.operator != "always":
            return Span(start_s, start_s), False, False
        if tree.bounds is None:
            return self.span, False, False
        first_s, last_s = start_s + tree.bounds.start_s, start_s + tree.bounds.end_s
        latest_s = end_s + TOLERANCE_S
        return Span(min(first_s, end_s), min(last_s, end_s)), last_s > latest_s, first_s > latest_s

    def _moments(self, evaluated: Dense | Discrete) -> tuple[FloatArray, Margin]:
        """When the body is judged, and its margin then."""
        if self.late or self.monitor.tree.operator != "always":
            begin, margin = evaluated.during(self.body, 1, (-inf, inf))
            first = slice(0, 0 if self.late else 1)
            return begin[first], margin[first]
        return evaluated.during(self.body, 1, (self.stretch.start_s, self.stretch.end_s))

    @property
    def sampled(self) -> BoolArray | slice:
        """Which moments of discrete time are samples; the others are holes."""
        return slice(None) if self._rows.hole is None else np.isin(self.begin, self.t)

    def episodes(self) -> list[Span]:
        """When the formula is broken, episode by episode."""
        if not self.violated.any():
            return []
        monitor, begin, violated, longest_s = self.monitor, self.begin, self.violated, self.monitor.max_gap_s
        if monitor.time == "dense":  # the last step lasts as long as it is judged
            end_s = max(self.stretch.end_s, float(begin[-1]) + TOLERANCE_S)
            begin, violated, longest_s = np.append(begin, end_s), np.append(violated, False), np.inf
        t_on_s = monitor.t_on_s if monitor.tree.operator == "always" else 0.0
        return episodes_where(begin, violated, t_on_s=t_on_s, t_off_s=monitor.t_off_s, longest_s=longest_s)

    @cached_property
    def durations_s(self) -> FloatArray:
        """How long the moments that are judged stand for, shape (m,), s."""
        if self.monitor.time == "dense":
            return np.diff(self.begin, append=max(self.stretch.end_s, float(self.begin[-1])))
        return sample_durations(self.begin, longest_s=self.monitor.max_gap_s)

    def worst(self, first: int, last: int) -> int:
        """Of the moments from one to before another that at which the formula is broken most."""
        worst = int(self.upper[first:last].argmin())
        if self.upper[first + worst] >= 0:  # broken by < where <= would have been kept
            worst = int(self.violated[first:last].argmax())
        return first + worst

    def causes(self, t_s: float, margin: float) -> list[Cause]:
        """What the formula is broken by at a moment; where its margin is 0, as truth tells."""
        return causes(self._evaluated if margin < 0 else self._decided, self.body, t_s)

    def sample(self, t_s: float) -> int:
        """The sample that a moment belongs to."""
        return max(int(self.t.searchsorted(t_s + TOLERANCE_S, side="right")) - 1, 0)

    def exactly(self, t_s: float) -> float:
        """A moment without the tolerances that windows are laid out with."""
        row = int(self.t.searchsorted(t_s))
        around = self.t[max(row - 1, 0) : row + 1].tolist()
        if t_s in around:
            return t_s
        near = (*around, self.span.start_s, self.span.end_s)
        exact = min(near, key=lambda one: abs(one - t_s))
        return exact if abs(exact - t_s) <= 4 * TOLERANCE_S else round(t_s, 8)
