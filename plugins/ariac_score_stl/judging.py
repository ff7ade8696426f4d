"""A formula on the signals of one subject: when it is judged, and what its margin is then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import inf

import numpy as np

from ariac_score import Span, episodes_where, sample_durations, uncovered_spans
from ariac_score_stl.dense import Dense, Steps
from ariac_score_stl.discrete import Discrete
from ariac_score_stl.explain import Cause, causes
from ariac_score_stl.margins import Margin, margins, truths
from ariac_score_stl.rows import TOLERANCE_S, BoolArray, Rows
from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.specification import Specification
from ariac_score_stl.syntax import Node

__all__ = ["JudgedFormula"]


class JudgedFormula:
    """A formula, judged.

    Args:
        specification: The formula and its parameters.
        t: Sample times within the trial, shape (n,), s; at least one.
        columns: Values of the signals at these times, shape (n,), by the names used in the formula.
        span: The trial.
        holes: Stretches between samples of which nothing is known, however short.
        predicates: The margins of predicates, where they are not those of the columns.

    Attributes:
        body: What is judged at every moment of `stretch`: all of the formula, or what follows its `always`.
        gaps: Where nothing is known.
        predicates: The margin of every predicate at every sample, shape (n,).
        stretch: When it is judged.
        ends_beyond: Whether the bounds of the outermost `always` end after the trial.
        begins_beyond: Whether they even begin after it.
        begin: The moments that are judged, shape (m,), s: samples and holes, or steps of dense time.
        lower: The least that the margin of the body can be then, shape (m,).
        upper: The greatest that it can be, shape (m,).
        violated: Where the formula is broken, shape (m,).
        undecided: Where it cannot be decided, shape (m,).

    Raises:
        FormulaError: A predicate has no value at some sample.
    """

    def __init__(
        self,
        specification: Specification,
        t: FloatArray,
        columns: Mapping[str, FloatArray],
        span: Span,
        holes: Sequence[Span] = (),
        predicates: Mapping[Node, FloatArray] | None = None,
    ) -> None:
        self.specification, self.t, self.columns, self.span = specification, t, columns, span
        self.body = specification.body
        self.gaps = uncovered_spans(t, span, max_gap_s=specification.max_gap_s, holes=holes)
        if predicates is None:
            predicates = margins(specification.tree, {**columns, **specification.constants}, len(t))
        self.predicates = predicates
        self.stretch, self.ends_beyond, self.begins_beyond = self._stretch()
        self._by_margin = self._by_truth = self._evaluate(self.predicates)
        self.begin, margin = self._moments(self._by_margin)
        decisive = margin
        # A margin of exactly 0 does not say whether `<` or `<=` stands there; truth values do.
        if not (margin.lower.all() and margin.upper.all()):
            self._by_truth = self._evaluate(truths(self.predicates))
            margin, decisive = self._on_common_moments(margin, *self._moments(self._by_truth))
        self.lower, self.upper = margin.lower, margin.upper
        self.violated: BoolArray = decisive.upper < 0
        self.undecided: BoolArray = (decisive.lower < 0) & ~self.violated

    def _evaluate(self, predicates: Mapping[Node, FloatArray]) -> Dense | Discrete:
        beyond = self.specification.beyond
        if self.specification.time == "dense":
            longest_s = self.specification.max_gap_s
            return Dense(self.body, self.t, self.span, predicates, beyond, longest_s)
        return Discrete.whole(self.body, self._rows, predicates, beyond)

    def _on_common_moments(
        self, margin: Margin, truth_begin: FloatArray, truth: Margin
    ) -> tuple[Margin, Margin]:
        """Margin and truth on the same moments, which become those of this object."""
        if self.specification.time == "dense":
            # Dense time leaves out steps that change nothing: truth may change where a margin stays 0.
            margin_begin = self.begin
            self.begin = np.unique(np.concatenate((margin_begin, truth_begin)))
            margin = Steps(margin_begin, margin).on(self.begin)
            truth = Steps(truth_begin, truth).on(self.begin)
        return margin, truth

    @cached_property
    def _rows(self) -> Rows:
        return Rows.of(self.t, self.span, self.gaps)

    def _stretch(self) -> tuple[Span, bool, bool]:
        tree, start_s, end_s = self.specification.tree, self.span.start_s, self.span.end_s
        if not self.specification.is_rule:
            return Span(start_s, start_s), False, False
        if tree.bounds is None:
            return self.span, False, False
        first_s, last_s = start_s + tree.bounds.start_s, start_s + tree.bounds.end_s
        latest_s = end_s + TOLERANCE_S
        return Span(min(first_s, end_s), min(last_s, end_s)), last_s > latest_s, first_s > latest_s

    def _moments(self, evaluated: Dense | Discrete) -> tuple[FloatArray, Margin]:
        """When the body is judged, and its margin then."""
        if self.specification.is_rule and not self.begins_beyond:
            return evaluated.during(self.body, 1, (self.stretch.start_s, self.stretch.end_s))
        begin, margin = evaluated.during(self.body, 1, (-inf, inf))
        first = slice(0, 0 if self.begins_beyond else 1)
        return begin[first], margin[first]

    @property
    def sampled(self) -> BoolArray | slice:
        """Which moments of discrete time are samples; the others are holes."""
        return slice(None) if self._rows.hole is None else np.isin(self.begin, self.t)

    def episodes(self) -> list[Span]:
        """When the formula is broken, episode by episode."""
        if not self.violated.any():
            return []
        begin, violated, longest_s = self.begin, self.violated, self.specification.max_gap_s
        if self.specification.time == "dense":  # no sample ends the last step, the end of the stretch does
            end_s = max(self.stretch.end_s, float(begin[-1]) + TOLERANCE_S)
            begin, violated, longest_s = np.append(begin, end_s), np.append(violated, False), np.inf
        return episodes_where(
            begin,
            violated,
            t_on_s=self.specification.t_on_s if self.specification.is_rule else 0.0,
            t_off_s=self.specification.t_off_s,
            longest_s=longest_s,
        )

    @cached_property
    def durations_s(self) -> FloatArray:
        """How long the moments that are judged stand for, shape (m,), s."""
        if self.specification.time == "dense":
            return np.diff(self.begin, append=max(self.stretch.end_s, float(self.begin[-1])))
        return sample_durations(self.begin, longest_s=self.specification.max_gap_s)

    def worst(self, first: int, last: int) -> int:
        """Of the moments `first` to before `last`, the one at which the formula is broken most."""
        worst = int(self.upper[first:last].argmin())
        if self.upper[first + worst] >= 0:  # broken by < where <= would have been kept
            worst = int(self.violated[first:last].argmax())
        return first + worst

    def causes(self, t_s: float, margin: float) -> list[Cause]:
        """What breaks the formula at a moment; a margin of 0 names no cause, so truth has to."""
        return causes(self._by_margin if margin < 0 else self._by_truth, self.body, t_s)

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
        # A hole keeps 2 tolerances from its samples, and a window adds at most one at either side.
        return exact if abs(exact - t_s) <= 4 * TOLERANCE_S else round(t_s, 8)
