"""How far a formula is kept, at every sample and for every sub-formula: discrete time.

Where something is not known, the margin lies between two numbers, and both are
carried through: a formula is broken where even the upper one is negative, kept where
even the lower one is not, and undecided between. So a hole in the log, or the end of
the trial, makes undecided exactly what depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ariac_score_stl.rows import TOLERANCE_S, Extent, Rows, Window
from ariac_score_stl.sliding import FloatArray, chained
from ariac_score_stl.syntax import Node

__all__ = [
    "Beyond",
    "Discrete",
    "Entering",
    "Key",
    "Margin",
    "among",
    "entered",
    "margins",
    "to_the_end",
    "truths",
]

Beyond = Literal["undecided", "weak", "strong", "cut"]
"""What is beyond the trial: not known; what keeps the formula; what breaks it; not part of any window."""


@dataclass(frozen=True, eq=False)
class Margin:
    """The margin of a formula at every row, between two bounds.

    Attributes:
        lower: At least this, shape (n,).
        upper: At most this, shape (n,); the very same array where everything is known.
    """

    lower: FloatArray
    upper: FloatArray

    @property
    def known(self) -> bool:
        """Whether both bounds are one array."""
        return self.lower is self.upper

    def apply(self, change: Callable[[FloatArray], FloatArray]) -> Margin:
        """Something done to both bounds that keeps their order."""
        lower = change(self.lower)
        return Margin(lower, lower if self.known else change(self.upper))

    def __neg__(self) -> Margin:
        upper = -self.lower
        return Margin(upper if self.known else -self.upper, upper)

    def join(self, other: Margin, change: Callable[[FloatArray, FloatArray], FloatArray]) -> Margin:
        """Something done to two margins, bound by bound."""
        lower = change(self.lower, other.lower)
        known = self.known and other.known
        return Margin(lower, lower if known else change(self.upper, other.upper))


def margins(
    formula: Node, columns: Mapping[str, FloatArray | float], n: int, *, first: int = 0
) -> dict[Node, FloatArray]:
    """The margin of every predicate at every sample.

    Args:
        formula: The formula.
        columns: Values of signals, shape (n,), and constants, by name.
        n: Number of samples.
        first: Which sample of all the first of them is.

    Raises:
        FormulaError: Division by zero, or a result that is not finite.
    """
    found: dict[Node, FloatArray] = {}
    for node in formula.walk():
        if node.margin is not None:
            names = node.names
            used = {name: column for name, column in columns.items() if name in names}
            difference = np.broadcast_to(node.margin.columns(used, first=first), n)
            if node.comparison in ("==", "!="):
                difference = np.abs(difference) if node.comparison == "!=" else -np.abs(difference)
            found[node] = difference
    return found


def truths(found: Mapping[Node, FloatArray]) -> dict[Node, FloatArray]:
    """The same as truth: 1 where a predicate holds, -1 where not.

    A margin of exactly 0 does not tell `<` from `<=`; this does.
    """
    told: dict[Node, FloatArray] = {}
    for node, margin in found.items():
        strict = node.comparison in ("<", ">", "!=")
        told[node] = np.where(margin > 0 if strict else margin >= 0, 1.0, -1.0)
    return told


Key = tuple[Node, int]
"""A sub-formula, and the sign it is judged with."""

Entering = Callable[[Key], tuple[slice, tuple[float, float] | None]]
"""The rows an operator without bounds goes through, and its bounds where it comes from; `None`: nowhere."""


def entered(node: Node) -> bool:
    """Whether a sub-formula hangs on rows however far away, so that it enters a window of rows as a number.

    `until` and `since` with bounds do where no sample need be in their window.
    """
    if node.bounds is not None:
        return node.operator in ("until", "since") and node.bounds.start_s > 0
    return node.operator in ("always", "eventually", "until", "historically", "once", "since")


class Discrete:
    """Evaluates a formula on rows and keeps the margin of every sub-formula.

    Args:
        rows: The time base.
        predicates: The margin of every predicate at every sample.
        beyond: What is beyond the trial.

    Attributes:
        entering: What enters rows that are a window of a trial.
        free: Of each sub-formula that enters windows what enters the next one.
    """

    def __init__(self, rows: Rows, predicates: Mapping[Node, FloatArray], beyond: Beyond) -> None:
        self.rows, self.predicates, self.beyond = rows, predicates, beyond
        self.margins: dict[Key, Margin] = {}
        self.entering: Entering = lambda _: (slice(0, len(rows)), None)
        self.free: dict[Key, Margin] = {}

    def key(self, node: Node, sign: int) -> Key:
        """Where the sign makes no difference it is 1."""
        return node, sign if self.beyond in ("weak", "strong") else 1

    def of(self, node: Node, sign: int = 1) -> Margin:
        """The margin of a sub-formula.

        Args:
            node: The sub-formula.
            sign: -1 where the whole formula gains when this one loses.
        """
        key = self.key(node, sign)
        if key not in self.margins:
            self.margins[key] = self._visit(node, sign)
        return self.margins[key]

    @property
    def begin(self) -> FloatArray:
        """Start of every row, s."""
        return self.rows.begin

    def at(self, node: Node, sign: int, t_s: float) -> tuple[float, float]:
        """The bounds of a sub-formula at a moment."""
        margin, row = self.of(node, sign), _row(self.rows.begin, t_s)
        return float(margin.lower[row]), float(margin.upper[row])

    def extreme(
        self,
        node: Node,
        sign: int,
        window: tuple[float, float],
        *,
        of: Literal["lower", "upper"],
        least: bool,
    ) -> float | None:
        """When a bound of a sub-formula is least or greatest within a stretch of time."""
        values = getattr(self.of(node, sign), of)
        first = int(self.rows.end.searchsorted(window[0] - TOLERANCE_S, side="left"))
        last = int(self.rows.begin.searchsorted(window[1] + TOLERANCE_S, side="right"))
        if first >= last:
            return None
        found = values[first:last].argmin() if least else values[first:last].argmax()
        return float(self.rows.begin[first + int(found)])

    def outside(self, sign: int) -> tuple[float, float]:
        """The bounds of anything beyond the trial."""
        if self.beyond == "weak":
            return sign * np.inf, sign * np.inf
        if self.beyond == "strong":
            return -sign * np.inf, -sign * np.inf
        return -np.inf, np.inf

    def _visit(self, node: Node, sign: int) -> Margin:
        match node.operator:
            case "predicate":
                return self._leaf(self.predicates[node])
            case "true" | "false":
                value = np.inf if node.operator == "true" else -np.inf
                always = np.full(len(self.rows), value)
                return Margin(always, always)
            case "not":
                return -self.of(node.parts[0], -sign)
            case "and" | "or":
                return self._both(node, sign)
            case "->":
                return (-self.of(node.parts[0], -sign)).join(self.of(node.parts[1], sign), np.maximum)
            case "<->" | "xor":
                return self._same(node, sign)
            case "next" | "rise" | "fall":
                return self._step(node, sign)
            case "until" | "since":
                return self._until(node, sign)
        return self._extremum(node, sign)

    def _leaf(self, values: FloatArray) -> Margin:
        lower = self.rows.spread(values, -np.inf)
        return Margin(lower, lower if self.rows.hole is None else self.rows.spread(values, np.inf))

    def _both(self, node: Node, sign: int) -> Margin:
        least = np.minimum if node.operator == "and" else np.maximum
        margin = self.of(node.parts[0], sign)
        for part in node.parts[1:]:
            margin = margin.join(self.of(part, sign), least)
        return margin

    def _same(self, node: Node, sign: int) -> Margin:
        """Both or neither, as `(a -> b) and (b -> a)`; `xor` is its negation."""
        of = -sign if node.operator == "xor" else sign
        a, b = node.parts
        there = (-self.of(a, -of)).join(self.of(b, of), np.maximum)
        back = (-self.of(b, -of)).join(self.of(a, of), np.maximum)
        both = there.join(back, np.minimum)
        return -both if node.operator == "xor" else both

    # One sample on, one sample back ------------------------------------------------------

    def _step(self, node: Node, sign: int) -> Margin:
        if node.operator == "next":
            missing = (np.inf, np.inf) if self.beyond == "cut" else self.outside(sign)
            return self._shifted(self.of(node.parts[0], sign), -1, missing)
        now = self.of(node.parts[0], sign if node.operator == "rise" else -sign)
        then = self.of(node.parts[0], -sign if node.operator == "rise" else sign)
        if node.operator == "rise":
            missing = (-np.inf, -np.inf) if self.beyond == "cut" else self.outside(-sign)
            return now.join(-self._shifted(then, 1, missing), np.minimum)
        missing = (np.inf, np.inf) if self.beyond == "cut" else self.outside(sign)
        return (-now).join(self._shifted(then, 1, missing), np.minimum)

    def _shifted(self, margin: Margin, by: int, missing: tuple[float, float]) -> Margin:
        """The margin at the neighbouring row; a hole has neighbours within itself too."""
        lower, upper = np.roll(margin.lower, by), np.roll(margin.upper, by)
        edge = 0 if by > 0 else -1
        if len(lower):
            lower[edge], upper[edge] = missing
        hole = self.rows.hole
        if hole is not None:
            lower[hole] = np.minimum(lower, margin.lower)[hole]
            upper[hole] = np.maximum(upper, margin.upper)[hole]
        return Margin(lower, upper)

    # Extrema over windows ----------------------------------------------------------------

    def _extremum(self, node: Node, sign: int) -> Margin:
        part = self.of(node.parts[0], sign)
        smallest = node.operator in ("always", "historically")
        ahead = node.operator in ("always", "eventually")
        if node.bounds is None:
            return self._so_far(part, self.key(node, sign), smallest=smallest, ahead=ahead)
        return self.within(part, node, sign, smallest=smallest, ahead=ahead)

    def _so_far(self, part: Margin, key: Key, *, smallest: bool, ahead: bool) -> Margin:
        """The extremum up to each row, or from it on."""
        rows, outer = self.entering(key)
        free = part.apply(lambda values: to_the_end(values, rows, smallest=smallest, ahead=ahead))
        if outer is not None:
            join = np.minimum if smallest else np.maximum
            lower = join(free.lower, outer[0])
            free = Margin(lower, lower if free.known and outer[0] == outer[1] else join(free.upper, outer[1]))
        self.free[key] = free
        return free

    def within(self, part: Margin, node: Node, sign: int, *, smallest: bool, ahead: bool) -> Margin:
        """The least or the greatest margin in the window of each row."""
        window = self.window(node, ahead=ahead)
        # What bounds the extremum from its weak side must see all that could matter.
        for_lower, for_upper = window.widest, window.surest
        if not smallest:
            for_lower, for_upper = for_upper, for_lower
        extremum = _lowest if smallest else _highest
        lower = extremum(part.lower, for_lower)
        same = part.known and for_lower is for_upper
        upper = lower if same else extremum(part.upper, for_upper)
        return self._edges(Margin(lower, upper), window, sign, smallest=smallest)

    def window(self, node: Node, *, ahead: bool) -> Window:
        """The window of an operator, looking ahead or back."""
        assert node.bounds is not None
        start_s, end_s = node.bounds.start_s, node.bounds.end_s
        return self.rows.window(start_s, end_s) if ahead else self.rows.window(-end_s, -start_s)

    def _edges(self, margin: Margin, window: Window, sign: int, *, smallest: bool) -> Margin:
        """What windows see beyond the trial, or where they see no sample at all."""
        widest = window.widest
        reaching = [part for part in (widest.before, widest.after) if part.start < part.stop]
        reaching = [] if self.beyond == "cut" else reaching
        if not reaching and widest.empty is None:
            return margin
        lower, upper = margin.lower.copy(), margin.upper.copy()
        join = np.minimum if smallest else np.maximum
        outer_lower, outer_upper = self.outside(sign)
        for part in reaching:
            lower[part] = join(lower[part], outer_lower)
            upper[part] = join(upper[part], outer_upper)
        if widest.empty is not None:
            lower[widest.empty], upper[widest.empty] = -np.inf, np.inf
        return Margin(lower, upper)

    # Until, since ------------------------------------------------------------------------

    def _until(self, node: Node, sign: int) -> Margin:
        """Without bounds a recursion; with bounds what Donzé and others, 2013, make of it.

        `a until[s,e] b` is `eventually[s,e] b` and, from s on, `a until b`, with a
        held up to there.
        """
        ahead = node.operator == "until"
        first, second = self.of(node.parts[0], sign), self.of(node.parts[1], sign)
        bounds = node.bounds
        outer = (-np.inf, -np.inf) if bounds is None or self.beyond == "cut" else self.outside(sign)
        key, rows, start = self.key(node, sign), slice(0, len(self.rows)), None
        if entered(node):
            rows, start = self.entering(key)
        start = outer if start is None else start
        free = self.free[key] = Margin(
            _chained(first.lower, second.lower, rows, start[0], ahead=ahead),
            _chained(first.upper, second.upper, rows, start[1], ahead=ahead),
        )
        if bounds is None:
            return free
        reached = self.within(second, node, sign, smallest=False, ahead=ahead)
        if bounds.start_s > 0:
            free = self._later(first, free, bounds.start_s, outer, ahead=ahead)
        return reached.join(free, np.minimum)

    def _later(
        self, first: Margin, free: Margin, after_s: float, outer: tuple[float, float], *, ahead: bool
    ) -> Margin:
        """`first` held for a while, and then what `free` is at the first row after it."""
        rows, n = self.rows, len(self.rows)
        own = np.arange(n)
        if ahead:
            at = np.searchsorted(rows.end, rows.begin + (after_s - TOLERANCE_S), side="left")
            held = Extent(slice(0, 0), slice(0, 0), None, first=own, last=at - 1)
        else:
            at = np.searchsorted(rows.begin, rows.end - (after_s - TOLERANCE_S), side="right") - 1
            held = Extent(slice(0, 0), slice(0, 0), None, first=at + 1, last=own)
        inside = (at >= 0) & (at < n)
        there = np.clip(at, 0, n - 1)
        # Between the last sample and the end of the trial nothing is known, though it is no hole.
        late = rows.end + after_s > rows.span.end_s + TOLERANCE_S
        early = rows.begin - after_s < rows.span.start_s - TOLERANCE_S
        beyond = late if ahead else early
        missing = np.where(beyond, outer[0], -np.inf), np.where(beyond, outer[1], np.inf)
        lower = np.minimum(held.lowest(first.lower), np.where(inside, free.lower[there], missing[0]))
        upper = np.minimum(held.lowest(first.upper), np.where(inside, free.upper[there], missing[1]))
        if rows.hole is not None:
            # A hole has no one moment to count from, and in one that is reached the first part must hold on.
            in_hole = inside & rows.hole[there]
            lower[in_hole] = np.minimum(lower, first.lower[there])[in_hole]
            lower[rows.hole], upper[rows.hole] = -np.inf, np.inf
        return Margin(lower, upper)


def _row(begin: FloatArray, t_s: float) -> int:
    return max(int(begin.searchsorted(t_s + TOLERANCE_S, side="right")) - 1, 0)


def _lowest(values: FloatArray, extent: Extent) -> FloatArray:
    return extent.lowest(values)


def _highest(values: FloatArray, extent: Extent) -> FloatArray:
    return -extent.lowest(-values)


def to_the_end(values: FloatArray, rows: slice, *, smallest: bool, ahead: bool) -> FloatArray:
    """The extremum over some rows, up to each or from it on; other rows as they are."""
    accumulate = np.minimum.accumulate if smallest else np.maximum.accumulate
    some = values[rows]
    found = accumulate(some[::-1])[::-1] if ahead else accumulate(some)
    return among(found, values, rows)


def _chained(first: FloatArray, second: FloatArray, rows: slice, start: float, *, ahead: bool) -> FloatArray:
    if ahead:
        return among(chained(first[rows][::-1], second[rows][::-1], start)[::-1], second, rows)
    return among(chained(first[rows], second[rows], start), second, rows)


def among(found: FloatArray, values: FloatArray, rows: slice) -> FloatArray:
    """What was found of some rows, among what other rows have."""
    if len(found) == len(values):
        return found
    whole = values.copy()
    whole[rows] = found
    return whole
