"""How far a formula is kept at every moment: dense time.

A sample stands for the time up to the next one, so every margin is a step function;
extrema over windows of step functions are step functions again, and stay about as
long as the trace, for steps that change nothing are left out. What holds for a single
instant between steps does not count.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ariac_score import Span
from ariac_score_stl.margins import Beyond, Bounds, Key, Margin, connected, key_of, outside, with_signs
from ariac_score_stl.rows import TOLERANCE_S
from ariac_score_stl.sliding import FloatArray, chained, lowest_between
from ariac_score_stl.syntax import FUTURE, Node

__all__ = ["Dense", "Steps"]


@dataclass(frozen=True, eq=False)
class Steps:
    """A margin as a step function over the trial.

    Attributes:
        begin: Start of every step, shape (n,), s; each lasts until the next one, the last to the end.
        margin: Its bounds on every step.
    """

    begin: FloatArray
    margin: Margin

    def on(self, begin: FloatArray) -> Margin:
        """The margin on other steps, each within one of these."""
        if begin is self.begin:
            return self.margin
        at = np.maximum(np.searchsorted(self.begin, begin, side="right") - 1, 0)
        return self.margin.apply(lambda values: values[at])

    def during(self, window: tuple[float, float]) -> slice:
        """The steps of a stretch of time, with the one that it begins in."""
        first = max(int(self.begin.searchsorted(window[0] + TOLERANCE_S, side="right")) - 1, 0)
        return slice(first, int(self.begin.searchsorted(window[1] + TOLERANCE_S, side="right")))

    def shortened(self) -> Steps:
        """The same function without steps that change nothing."""
        lower, upper = self.margin.lower, self.margin.upper
        changes = np.ones(len(self.begin), dtype=bool)
        changes[1:] = (lower[1:] != lower[:-1]) | (upper[1:] != upper[:-1])
        if changes.all():
            return self
        return Steps(self.begin[changes], self.margin.apply(lambda values: values[changes]))


class Dense:
    """A formula and all of its parts at every moment.

    Args:
        tree: The formula.
        t: Sample times, shape (n,), s.
        span: The trial.
        predicates: The margin of every predicate at every sample.
        beyond: What is beyond the trial.
        longest_s: A sample stands for no longer than this, in s; what follows is not known.
    """

    def __init__(
        self,
        tree: Node,
        t: FloatArray,
        span: Span,
        predicates: Mapping[Node, FloatArray],
        beyond: Beyond,
        longest_s: float = np.inf,
    ) -> None:
        self.span, self.predicates, self.beyond = span, predicates, beyond
        self._steps: dict[Key, Steps] = {}
        self._lay_out(t, longest_s)
        self.of(tree)

    def _lay_out(self, t: FloatArray, longest_s: float) -> None:
        """Steps of the samples, of what is before the first, and of holes."""
        begin = t.copy()
        late = bool(t[0] - self.span.start_s > longest_s + TOLERANCE_S)
        if not late:
            begin[0] = self.span.start_s
        gap_s = np.diff(t, append=max(self.span.end_s, float(t[-1])))
        (before_holes,) = np.nonzero(gap_s > longest_s + TOLERANCE_S)
        holes = t[before_holes] + longest_s
        self.begin = np.insert(begin, before_holes + 1, holes)
        self.sample = np.insert(np.arange(len(t)), before_holes + 1, -1)
        if late:
            self.begin = np.insert(self.begin, 0, self.span.start_s)
            self.sample = np.insert(self.sample, 0, -1)

    def of(self, node: Node, sign: int = 1) -> Steps:
        """The margin of a sub-formula; see `Discrete.of`."""
        key = key_of(self.beyond, node, sign)
        if key not in self._steps:
            self._steps[key] = self._visit(node, sign).shortened()
        return self._steps[key]

    def at(self, node: Node, sign: int, t_s: float) -> Bounds:
        """The bounds of a sub-formula at a moment."""
        steps = self.of(node, sign)
        step = steps.during((t_s, t_s)).start
        return float(steps.margin.lower[step]), float(steps.margin.upper[step])

    def during(self, node: Node, sign: int, window: tuple[float, float]) -> tuple[FloatArray, Margin]:
        """When steps begin within a stretch of time, and the margin of a sub-formula there."""
        steps = self.of(node, sign)
        rows = steps.during(window)
        if window[1] < self.span.start_s or window[0] > self.span.end_s:
            rows = slice(0, 0)
        return np.maximum(steps.begin[rows], window[0]), steps.margin[rows]

    def _visit(self, node: Node, sign: int) -> Steps:
        match node.operator:
            case "predicate":
                return self._predicate(self.predicates[node])
            case "true" | "false":
                value = np.array([np.inf if node.operator == "true" else -np.inf])
                return Steps(np.array([self.span.start_s]), Margin(value, value))
            case "until" | "since":
                return self._until(node, sign)
            case "always" | "eventually" | "historically" | "once":
                return self._extremum(node, sign)
        begin, margins = _on_common_steps(*(self.of(part, of) for part, of in with_signs(node, sign)))
        return Steps(begin, connected(node.operator, *margins))

    def _predicate(self, values: FloatArray) -> Steps:
        unknown = self.sample < 0
        lower = np.where(unknown, -np.inf, values[self.sample])
        upper = np.where(unknown, np.inf, values[self.sample]) if unknown.any() else lower
        return Steps(self.begin, Margin(lower, upper))

    def _extremum(self, node: Node, sign: int) -> Steps:
        steps = self.of(node.parts[0], sign)
        smallest, ahead = node.operator in ("always", "historically"), node.operator in FUTURE
        if node.bounds is not None:
            return self._within(steps, self._window(node), self._outside(sign), smallest=smallest)
        join = np.minimum if smallest else np.maximum
        if ahead:
            margin = steps.margin.apply(lambda values: join.accumulate(values[::-1])[::-1])
        else:
            margin = steps.margin.apply(join.accumulate)
        return Steps(steps.begin, margin)

    def _outside(self, sign: int) -> Bounds | None:
        return None if self.beyond == "cut" else outside(self.beyond, sign)

    def _window(self, node: Node) -> tuple[float, float]:
        assert node.bounds is not None  # callers have looked
        start_s, end_s = node.bounds.start_s, node.bounds.end_s
        return (start_s, end_s) if node.operator in FUTURE else (-end_s, -start_s)

    def _within(
        self, steps: Steps, window: tuple[float, float], beyond: Bounds | None, *, smallest: bool
    ) -> Steps:
        """The extremum over the window of every moment; `beyond`: bounds of what it sees beyond the trial."""
        start_s, end_s = window
        ends = np.append(steps.begin[1:], self.span.end_s + 2 * TOLERANCE_S)
        edges = [self.span.start_s, self.span.start_s - start_s, self.span.end_s - end_s + 2 * TOLERANCE_S]
        begin = self._inside(np.concatenate((steps.begin - end_s, ends - start_s, edges)))
        first = np.searchsorted(ends, begin + (start_s + TOLERANCE_S), side="right")
        last = np.searchsorted(steps.begin, begin + (end_s + TOLERANCE_S), side="right") - 1

        def extremum(values: FloatArray) -> FloatArray:
            return lowest_between(values, first, last) if smallest else -lowest_between(-values, first, last)

        margin = steps.margin.apply(extremum)
        if beyond is None:
            return Steps(begin, margin)
        reaches = (begin + start_s < self.span.start_s - TOLERANCE_S) | (
            begin + end_s > self.span.end_s + TOLERANCE_S
        )
        join = np.minimum if smallest else np.maximum
        lower = np.where(reaches, join(margin.lower, beyond[0]), margin.lower)
        return Steps(begin, Margin(lower, np.where(reaches, join(margin.upper, beyond[1]), margin.upper)))

    def _inside(self, begin: FloatArray) -> FloatArray:
        """Sorted starts within the trial; of those that only rounding separates, one."""
        begin = np.sort(begin, kind="stable")
        begin = begin[(begin >= self.span.start_s) & (begin <= self.span.end_s)]
        kept = np.ones(len(begin), dtype=bool)
        kept[1:] = np.diff(begin) > TOLERANCE_S / 2
        return begin[kept]

    def _until(self, node: Node, sign: int) -> Steps:
        """As in discrete time: a recursion, or with bounds the decomposition of Donzé and others (2013)."""
        ahead, bounds = node.operator == "until", node.bounds
        begin, (first, second) = _on_common_steps(self.of(node.parts[0], sign), self.of(node.parts[1], sign))
        cut = bounds is None or self.beyond == "cut"
        outer = (-np.inf, -np.inf) if cut else outside(self.beyond, sign)
        lower = _until(first.lower, second.lower, outer[0], ahead=ahead)
        upper = _until(first.upper, second.upper, outer[1], ahead=ahead)
        free = Steps(begin, Margin(lower, upper))
        if bounds is None:
            return free
        reached = self._within(Steps(begin, second), self._window(node), self._outside(sign), smallest=False)
        if bounds.start_s == 0:
            begin, (a, b) = _on_common_steps(reached, free)
            return Steps(begin, a.join(b, np.minimum))
        away_s = bounds.start_s if ahead else -bounds.start_s
        # What lies beyond the trial counts in `reached` and in `free` already.
        held = self._within(Steps(begin, first), (min(away_s, 0.0), max(away_s, 0.0)), None, smallest=True)
        begin, (a, b, c) = _on_common_steps(reached, held, self._moved(free, away_s, outer))
        return Steps(begin, a.join(b, np.minimum).join(c, np.minimum))

    def _moved(self, steps: Steps, away_s: float, outer: Bounds) -> Steps:
        """At every moment, the margin `away_s` from there."""
        edges = [self.span.start_s, self.span.start_s - away_s, self.span.end_s - away_s + 2 * TOLERANCE_S]
        begin = self._inside(np.concatenate((steps.begin - away_s, edges)))
        there = begin + away_s
        margin = steps.on(there + TOLERANCE_S)  # the step that begins there, in spite of rounding
        out = (there < self.span.start_s - TOLERANCE_S) | (there > self.span.end_s + TOLERANCE_S)
        lower = np.where(out, outer[0], margin.lower)
        return Steps(begin, Margin(lower, np.where(out, outer[1], margin.upper)))


def _on_common_steps(*several: Steps) -> tuple[FloatArray, list[Margin]]:
    """The starts of the steps of all of them, and each on these steps."""
    begin = several[0].begin
    if any(steps.begin is not begin for steps in several[1:]):
        begin = np.unique(np.concatenate([steps.begin for steps in several]))
    return begin, [steps.on(begin) for steps in several]


def _until(first: FloatArray, second: FloatArray, start: float, *, ahead: bool) -> FloatArray:
    """`until` or `since` over all steps."""
    if ahead:
        return chained(first[::-1], second[::-1], start)[::-1]
    # Looking back, a step that is left must itself have been held to its end.
    earlier = chained(first, np.minimum(first, second), start)
    earlier = np.concatenate(([start], earlier[:-1]))
    found: FloatArray = np.maximum(second, np.minimum(first, earlier))
    return found
