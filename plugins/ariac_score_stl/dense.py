"""How far a formula is kept at every moment: dense time.

A sample stands for the time up to the next one, so every margin is a step function;
extrema over windows of step functions are step functions again, and stay about as
long as the trace. What holds for a single instant between steps does not count.
Without steps that change nothing a margin is told in one way only, so that steps of a
part of the trial are those of the whole, wherever all that they hang on is in the part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ariac_score import Span
from ariac_score_stl.robustness import Beyond, Key, Margin, among, entered, to_the_end
from ariac_score_stl.rows import TOLERANCE_S
from ariac_score_stl.sliding import FloatArray, chained, lowest_between
from ariac_score_stl.syntax import FUTURE, Node

__all__ = ["Dense", "Entering", "Steps", "hangs"]

Entering = Callable[[Key], tuple[tuple[float, float], tuple[float, float] | None]]
"""From when to when an operator goes through steps, and its bounds where it comes from; `None`: nowhere."""


def hangs(node: Node) -> bool:
    """Whether a sub-formula hangs on moments however far away; see `entered`.

    `since` always does: a step that begins within the tolerance is in its window, while what
    has held so far knows nothing of it yet.
    """
    return entered(node) or node.operator == "since"


@dataclass(frozen=True, eq=False)
class Steps:
    """A margin as a step function over the trial.

    Attributes:
        begin: Start of every step, shape (n,), s; each lasts until the next one, the last to the end.
        margin: Its bounds on every step.
    """

    begin: FloatArray
    margin: Margin

    def on(self, begin: FloatArray, first: int = 0) -> Margin:
        """The margin on other steps, each within one of these, the first one of which may be a later one."""
        if begin is self.begin:
            return self.margin
        at = np.maximum(np.searchsorted(self.begin, begin, side="right") - 1, first)
        return self.margin.apply(lambda values: values[at])

    def value(self, t_s: float, *, before: bool = False) -> tuple[float, float]:
        """The bounds at a moment, or until just before it."""
        at = max(int(self.begin.searchsorted(t_s, side="left" if before else "right")) - 1, 0)
        return float(self.margin.lower[at]), float(self.margin.upper[at])

    def shortened(self) -> Steps:
        """The same function without steps that change nothing."""
        lower, upper = self.margin.lower, self.margin.upper
        changes = np.ones(len(self.begin), dtype=bool)
        changes[1:] = (lower[1:] != lower[:-1]) | (upper[1:] != upper[:-1])
        if changes.all():
            return self
        return Steps(self.begin[changes], self.margin.apply(lambda values: values[changes]))


class Dense:
    """Evaluates a formula at every moment and keeps the margin of every sub-formula.

    Args:
        t: Sample times, shape (n,), s.
        span: The trial.
        predicates: The margin of every predicate at every sample.
        beyond: What is beyond the trial.
        longest_s: A sample stands for no longer than this; what follows is not known.
        from_start: Whether the first sample is the first one of the trial.
        following_s: The sample after these; `None`: there is none.

    Attributes:
        entering: What enters steps that are a part of a trial.
    """

    def __init__(
        self,
        t: FloatArray,
        span: Span,
        predicates: Mapping[Node, FloatArray],
        beyond: Beyond,
        longest_s: float = np.inf,
        *,
        from_start: bool = True,
        following_s: float | None = None,
    ) -> None:
        self.span, self.predicates, self.beyond = span, predicates, beyond
        self.steps: dict[Key, Steps] = {}
        self.entering: Entering = lambda _: ((-np.inf, np.inf), None)
        self._free: dict[Key, Steps] = {}
        """Of `until` and `since` with bounds what they are without."""
        until_s = max(span.end_s, float(t[-1])) if following_s is None else following_s
        self._lay_out(t, until_s, longest_s, from_start=from_start)

    def _lay_out(self, t: FloatArray, until_s: float, longest_s: float, *, from_start: bool) -> None:
        """Steps of the samples, of what is before the first, and of holes."""
        begin = t.copy()
        late = from_start and bool(t[0] - self.span.start_s > longest_s + TOLERANCE_S)
        if from_start and not late:
            begin[0] = self.span.start_s
        gap_s = np.diff(t, append=until_s)
        (before_holes,) = np.nonzero(gap_s > longest_s + TOLERANCE_S)
        holes = t[before_holes] + longest_s
        self.begin = np.insert(begin, before_holes + 1, holes)
        sample = np.insert(np.arange(len(t)), before_holes + 1, -1)
        if late:
            self.begin, sample = np.insert(self.begin, 0, self.span.start_s), np.insert(sample, 0, -1)
        self.sample = sample

    @property
    def size(self) -> int:
        """How many bytes are held by keeping it, about."""
        steps = [*self.steps.values(), *self._free.values()]
        columns = [column for one in steps for column in (one.begin, one.margin.lower, one.margin.upper)]
        columns += [self.begin, *self.predicates.values()]
        return self.sample.nbytes + sum({id(column): column.nbytes for column in columns}.values())

    def key(self, node: Node, sign: int) -> Key:
        """Where the sign makes no difference it is 1."""
        return node, sign if self.beyond in ("weak", "strong") else 1

    def of(self, node: Node, sign: int = 1) -> Steps:
        """The margin of a sub-formula; see `Discrete.of`."""
        key = self.key(node, sign)
        if key not in self.steps:
            self.steps[key] = self._visit(node, sign).shortened()
        return self.steps[key]

    def left(self, node: Node, sign: int, t_s: float) -> tuple[float, float]:
        """What a sub-formula that hangs on what is far away goes on with, beyond a moment on its way."""
        steps, ahead = self.of(node, sign), node.operator in FUTURE
        steps = self._free.get(self.key(node, sign), steps)
        lower, upper = steps.value(t_s, before=not ahead)
        if node.operator == "since":  # a step that is left must itself have been held to its end
            held = self.of(node.parts[0], sign).value(t_s, before=True)
            return min(held[0], lower), min(held[1], upper)
        return lower, upper

    def outside(self, sign: int) -> tuple[float, float]:
        """The bounds of anything beyond the trial."""
        if self.beyond == "weak":
            return sign * np.inf, sign * np.inf
        if self.beyond == "strong":
            return -sign * np.inf, -sign * np.inf
        return -np.inf, np.inf

    def _visit(self, node: Node, sign: int) -> Steps:
        match node.operator:
            case "predicate":
                values = self.predicates[node]
                lower = np.where(self.sample < 0, -np.inf, values[self.sample])
                known = bool((self.sample >= 0).all())
                upper = lower if known else np.where(self.sample < 0, np.inf, values[self.sample])
                return Steps(self.begin, Margin(lower, upper))
            case "true" | "false":
                value = np.array([np.inf if node.operator == "true" else -np.inf])
                return Steps(np.array([self.span.start_s]), Margin(value, value))
            case "not":
                steps = self.of(node.parts[0], -sign)
                return Steps(steps.begin, -steps.margin)
            case "and" | "or":
                least = np.minimum if node.operator == "and" else np.maximum
                begin, margins = _together(*(self.of(part, sign) for part in node.parts))
                margin = margins[0]
                for further in margins[1:]:
                    margin = margin.join(further, least)
                return Steps(begin, margin)
            case "->":
                begin, (a, b) = _together(self.of(node.parts[0], -sign), self.of(node.parts[1], sign))
                return Steps(begin, (-a).join(b, np.maximum))
            case "<->" | "xor":
                return self._same(node, sign)
            case "until" | "since":
                return self._until(node, sign)
        return self._extremum(node, sign)

    def _same(self, node: Node, sign: int) -> Steps:
        of = -sign if node.operator == "xor" else sign
        a, b = node.parts
        begin, (a_for, b_for, a_against, b_against) = _together(
            self.of(a, of), self.of(b, of), self.of(a, -of), self.of(b, -of)
        )
        there, back = (-a_against).join(b_for, np.maximum), (-b_against).join(a_for, np.maximum)
        both = there.join(back, np.minimum)
        return Steps(begin, -both if node.operator == "xor" else both)

    def _extremum(self, node: Node, sign: int) -> Steps:
        steps = self.of(node.parts[0], sign)
        smallest = node.operator in ("always", "historically")
        ahead = node.operator in ("always", "eventually")
        if node.bounds is not None:
            start_s, end_s = node.bounds.start_s, node.bounds.end_s
            if not ahead:
                start_s, end_s = -end_s, -start_s
            return self._within(steps, start_s, end_s, sign, smallest=smallest)
        return self._so_far(steps, self.key(node, sign), smallest=smallest, ahead=ahead)

    def _so_far(self, steps: Steps, key: Key, *, smallest: bool, ahead: bool) -> Steps:
        """The extremum up to each step, or from it on."""
        rows, outer = self._gone_through(key, steps.begin)
        margin = steps.margin.apply(lambda values: to_the_end(values, rows, smallest=smallest, ahead=ahead))
        if outer is not None:
            join = np.minimum if smallest else np.maximum
            lower = join(margin.lower, outer[0])
            known = margin.known and outer[0] == outer[1]
            margin = Margin(lower, lower if known else join(margin.upper, outer[1]))
        return Steps(steps.begin, margin)

    def _gone_through(self, key: Key, begin: FloatArray) -> tuple[slice, tuple[float, float] | None]:
        """The steps an operator goes through, and its bounds where it comes from."""
        (from_s, to_s), outer = self.entering(key)
        first = max(int(begin.searchsorted(from_s, side="right")) - 1, 0)
        return slice(first, int(begin.searchsorted(to_s))), outer

    def _within(self, steps: Steps, start_s: float, end_s: float, sign: int, *, smallest: bool) -> Steps:
        """The extremum over the window from `start_s` to `end_s` away of every moment."""
        ends = np.append(steps.begin[1:], self.span.end_s + 2 * TOLERANCE_S)
        edges = [self.span.start_s, self.span.start_s - start_s, self.span.end_s - end_s + 2 * TOLERANCE_S]
        begin = self._inside(np.concatenate((steps.begin - end_s, ends - start_s, edges)))
        first = np.searchsorted(ends, begin + (start_s + TOLERANCE_S), side="right")
        last = np.searchsorted(steps.begin, begin + (end_s + TOLERANCE_S), side="right") - 1

        def extremum(values: FloatArray) -> FloatArray:
            return lowest_between(values, first, last) if smallest else -lowest_between(-values, first, last)

        margin = steps.margin.apply(extremum)
        if self.beyond == "cut":
            return Steps(begin, margin)
        reaches = (begin + start_s < self.span.start_s - TOLERANCE_S) | (
            begin + end_s > self.span.end_s + TOLERANCE_S
        )
        join = np.minimum if smallest else np.maximum
        lower, upper = self.outside(sign)
        return Steps(
            begin,
            Margin(
                np.where(reaches, join(margin.lower, lower), margin.lower),
                np.where(reaches, join(margin.upper, upper), margin.upper),
            ),
        )

    def _inside(self, begin: FloatArray) -> FloatArray:
        """Sorted starts within the trial, with none so close that only rounding parts them."""
        begin = np.sort(begin, kind="stable")
        begin = begin[(begin >= self.span.start_s) & (begin <= self.span.end_s)]
        kept = np.ones(len(begin), dtype=bool)
        kept[1:] = np.diff(begin) > TOLERANCE_S / 2
        return begin[kept]

    def _until(self, node: Node, sign: int) -> Steps:
        """As in discrete time; see `Discrete`."""
        ahead = node.operator == "until"
        begin, (first, second) = _together(self.of(node.parts[0], sign), self.of(node.parts[1], sign))
        bounds = node.bounds
        outer = (-np.inf, -np.inf) if bounds is None or self.beyond == "cut" else self.outside(sign)
        rows, start = slice(0, len(begin)), None
        if hangs(node):
            rows, start = self._gone_through(self.key(node, sign), begin)
        from_lower, from_upper = outer if start is None else start
        lower = _until(first.lower, second.lower, rows, from_lower, ahead=ahead)
        upper = _until(first.upper, second.upper, rows, from_upper, ahead=ahead)
        free = Steps(begin, Margin(lower, upper))
        if bounds is None:
            return free
        if hangs(node):
            self._free[self.key(node, sign)] = free
        start_s, end_s = (bounds.start_s, bounds.end_s) if ahead else (-bounds.end_s, -bounds.start_s)
        reached = self._within(Steps(begin, second), start_s, end_s, sign, smallest=False)
        if bounds.start_s == 0:
            begin, (a, b) = _together(reached, free)
            return Steps(begin, a.join(b, np.minimum))
        away_s = bounds.start_s if ahead else -bounds.start_s
        held = self._held(Steps(begin, first), away_s)
        begin, (a, b, c) = _together(reached, held, self._moved(free, away_s, outer))
        return Steps(begin, a.join(b, np.minimum).join(c, np.minimum))

    def _held(self, steps: Steps, away_s: float) -> Steps:
        """The least margin from here to `away_s` away, as far as the trial goes."""
        cut = Dense.__new__(Dense)
        cut.span, cut.beyond = self.span, "cut"
        return cut._within(steps, min(away_s, 0.0), max(away_s, 0.0), 1, smallest=True)

    def _moved(self, steps: Steps, away_s: float, outer: tuple[float, float]) -> Steps:
        """What holds `away_s` from here."""
        edges = [self.span.start_s, self.span.start_s - away_s, self.span.end_s - away_s + 2 * TOLERANCE_S]
        begin = self._inside(np.concatenate((steps.begin - away_s, edges)))
        there = begin + away_s
        margin = steps.on(there + TOLERANCE_S)
        outside = (there < self.span.start_s - TOLERANCE_S) | (there > self.span.end_s + TOLERANCE_S)
        return Steps(
            begin,
            Margin(np.where(outside, outer[0], margin.lower), np.where(outside, outer[1], margin.upper)),
        )


def _together(*several: Steps) -> tuple[FloatArray, list[Margin]]:
    """Step functions on steps that fit them all."""
    begin = several[0].begin
    if any(steps.begin is not begin for steps in several[1:]):
        begin = np.unique(np.concatenate([steps.begin for steps in several]))
    return begin, [steps.on(begin) for steps in several]


def _until(first: FloatArray, second: FloatArray, rows: slice, start: float, *, ahead: bool) -> FloatArray:
    """`until` or `since` over some steps; other steps as `second` is."""
    a, b = first[rows], second[rows]
    if ahead:
        return among(chained(a[::-1], b[::-1], start)[::-1], second, rows)
    # Looking back, a step that is left must itself have been held to its end.
    earlier = chained(a, np.minimum(a, b), start)
    earlier = np.concatenate(([start], earlier[:-1]))
    return among(np.maximum(b, np.minimum(a, earlier)), second, rows)
