"""How far a formula is kept, at every sample and for every sub-formula: discrete time.

Each operator is stated once, over the rows that are new since it was last evaluated: all
rows of a trial together, or one row after the other while the trial goes on. What it
carries from step to step is its own margin at the row before; how far it looks back and
ahead is its window. So a trial that is judged afterwards and one that is watched have the
same margins. Only where rows are closer together than `CLOSEST_S`, which stamps cannot be,
one that is still to come may belong to a window that was taken for complete.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np

from ariac_score_stl.margins import Beyond, Bounds, Key, Margin, connected, key_of, outside, with_signs
from ariac_score_stl.rows import CLOSEST_S, TOLERANCE_S, BoolArray, Column, Extent, Rows
from ariac_score_stl.sliding import FloatArray, IntArray, chained, lowest_between
from ariac_score_stl.syntax import FUTURE, Node, reach_s

__all__ = ["Discrete"]

_FORGOTTEN_AT_ONCE = 256
"""Forgetting row by row would cost more than keeping a few."""


class _Margins:
    """The margin of a sub-formula at every row so far."""

    def __init__(self) -> None:
        self._lower = self._upper = Column(np.empty(0))

    def __len__(self) -> int:
        return len(self._lower)

    @property
    def margin(self) -> Margin:
        lower = self._lower.values
        return Margin(lower, lower if self._lower is self._upper else self._upper.values)

    def add(self, margin: Margin) -> None:
        if self._lower is self._upper and not margin.known:  # from the first unknown row on there are two
            self._upper = Column(self._lower.values.copy())
        self._lower.add(margin.lower)
        if self._lower is not self._upper:
            self._upper.add(margin.upper)

    def forget(self, count: int) -> None:
        self._lower.forget(count)
        if self._lower is not self._upper:
            self._upper.forget(count)


class _Operator(ABC):
    """One sub-formula, and its margin so far."""

    def __init__(self, rows: Rows, *parts: _Operator) -> None:
        self.rows, self.parts, self.so_far = rows, parts, _Margins()

    @property
    def margin(self) -> Margin:
        """Its margin at the rows that are kept and known."""
        return self.so_far.margin

    @property
    def known(self) -> int:
        """At how many rows all of its parts are known."""
        return min(len(part.so_far) for part in self.parts)

    @property
    def ready(self) -> int:
        """At how many rows its margin can be known by now."""
        return self.known

    @property
    def before(self) -> Margin | None:
        """Its margin at the row before the new ones; `None`: there is none."""
        return self.margin[slice(-1, None)] if len(self.so_far) else None

    def advance(self) -> None:
        """Evaluate the rows that have become ready."""
        new = slice(len(self.so_far), self.ready)
        if new.start < new.stop:
            self.so_far.add(self.evaluate(new))

    @abstractmethod
    def evaluate(self, new: slice) -> Margin:
        """The margin at rows that are ready."""


class _Predicate(_Operator):
    """Its margins are set from outside; in a hole they may be anything."""

    values: FloatArray

    @property
    def ready(self) -> int:
        return len(self.rows)

    def evaluate(self, new: slice) -> Margin:
        lower = self.rows.spread(self.values, -np.inf, new)
        return Margin(lower, lower if self.rows.hole is None else self.rows.spread(self.values, np.inf, new))


class _Constant(_Operator):
    """True and false, with an infinite margin: no shift of any predicate changes them."""

    def __init__(self, rows: Rows, value: float) -> None:
        super().__init__(rows)
        self.value = value

    @property
    def ready(self) -> int:
        return len(self.rows)

    def evaluate(self, new: slice) -> Margin:
        values = np.full(new.stop - new.start, self.value)
        return Margin(values, values)


class _Connective(_Operator):
    """An operator that looks at no other row."""

    def __init__(self, rows: Rows, operator: str, *parts: _Operator) -> None:
        super().__init__(rows, *parts)
        self.operator = operator

    def evaluate(self, new: slice) -> Margin:
        return connected(self.operator, *(part.margin[new] for part in self.parts))


class _Neighbour(_Operator):
    """The margin at the row after or before; a hole has neighbours within itself too."""

    def __init__(self, rows: Rows, part: _Operator, by: int, missing: Bounds) -> None:
        super().__init__(rows, part)
        self.by, self.missing = by, missing

    @property
    def ready(self) -> int:
        return self.known if self.rows.over else max(self.known - max(self.by, 0), 0)

    def evaluate(self, new: slice) -> Margin:
        margin, hole = self.parts[0].margin, self.rows.hole
        at = np.arange(new.start, new.stop) + self.by
        there = (at >= 0) & (at < len(margin.lower))
        lower = np.where(there, margin.lower.take(at, mode="clip"), self.missing[0])
        upper = np.where(there, margin.upper.take(at, mode="clip"), self.missing[1])
        if hole is not None:
            lower = np.where(hole[new], np.minimum(lower, margin.lower[new]), lower)
            upper = np.where(hole[new], np.maximum(upper, margin.upper[new]), upper)
        return Margin(lower, upper)


class _SoFar(_Operator):
    """The least or the greatest up to each row, or from it on."""

    def __init__(self, rows: Rows, part: _Operator, *, smallest: bool, ahead: bool) -> None:
        super().__init__(rows, part)
        self.join = np.minimum if smallest else np.maximum
        self.ahead = ahead

    @property
    def ready(self) -> int:
        return 0 if self.ahead and not self.rows.over else self.known

    def evaluate(self, new: slice) -> Margin:
        part, join, before = self.parts[0].margin[new], self.join, self.before
        if self.ahead:
            return part.apply(lambda values: join.accumulate(values[::-1])[::-1])
        margin = part.apply(join.accumulate)
        if before is not None:
            margin = margin.join(before, join)
        return margin


class _Within(_Operator):
    """The least or the greatest in the window of each row."""

    def __init__(
        self, rows: Rows, part: _Operator, window: Bounds, beyond: Bounds | None, *, smallest: bool
    ) -> None:
        super().__init__(rows, part)
        self.window, self.beyond, self.smallest = window, beyond, smallest

    @property
    def ready(self) -> int:
        return self.rows.complete(self.window[1], self.known)

    def evaluate(self, new: slice) -> Margin:
        part, window = self.parts[0].margin, self.rows.window(*self.window, new)
        # What bounds the extremum from its weak side must see all that could matter.
        for_lower, for_upper = window.widest, window.surest
        if not self.smallest:
            for_lower, for_upper = for_upper, for_lower
        lower = self._extremum(part.lower, for_lower)
        same = part.known and for_lower is for_upper
        upper = lower if same else self._extremum(part.upper, for_upper)
        return self._edges(Margin(lower, upper), window.widest)

    def _extremum(self, values: FloatArray, extent: Extent) -> FloatArray:
        return extent.lowest(values) if self.smallest else -extent.lowest(-values)

    def _edges(self, margin: Margin, widest: Extent) -> Margin:
        """Account for what lies beyond the trial, and for windows that hold no sample."""
        edges = [edge for edge in (widest.before, widest.after) if edge.start < edge.stop]
        if (not edges or self.beyond is None) and widest.empty is None:
            return margin
        lower, upper = margin.lower.copy(), margin.upper.copy()
        join = np.minimum if self.smallest else np.maximum
        # First what is missing in the trial: a policy about what lies beyond does not fill it in.
        if widest.empty is not None:
            lower[widest.empty], upper[widest.empty] = -np.inf, np.inf
        if self.beyond is not None:
            for edge in edges:
                lower[edge] = join(lower[edge], self.beyond[0])
                upper[edge] = join(upper[edge], self.beyond[1])
        return Margin(lower, upper)


class _Since(_Operator):
    """`a since b` without bounds: b now, or a now and all of it at the row before."""

    def __init__(self, rows: Rows, first: _Operator, second: _Operator, start: Bounds) -> None:
        super().__init__(rows, first, second)
        self.start = start

    def evaluate(self, new: slice) -> Margin:
        first, second = (part.margin[new] for part in self.parts)
        before = self.before
        if before is None:
            return _followed(first, second, self.start)
        return _followed(first, second, (float(before.lower[0]), float(before.upper[0])))


class _Until(_Operator):
    """`a until b` without bounds: b now, or a now and all of it at the row after."""

    def __init__(self, rows: Rows, first: _Operator, second: _Operator, start: Bounds) -> None:
        super().__init__(rows, first, second)
        self.start = start

    @property
    def ready(self) -> int:
        return self.known if self.rows.over else 0

    def evaluate(self, new: slice) -> Margin:
        return self.from_row(new.start)

    def from_row(self, row: int) -> Margin:
        """Its margin from a row on, as if b never came after the rows at which its parts are known."""
        rows = slice(row, self.known)
        first, second = (part.margin[rows].apply(lambda values: values[::-1]) for part in self.parts)
        start = self.start if self.rows.over else (-np.inf, -np.inf)
        return _followed(first, second, start).apply(lambda values: values[::-1])


def _followed(first: Margin, second: Margin, start: Bounds) -> Margin:
    lower = chained(first.lower, second.lower, start[0])
    if first.known and second.known and start[0] == start[1]:
        return Margin(lower, lower)
    return Margin(lower, chained(first.upper, second.upper, start[1]))


class _Bounded(_Operator):
    """`until` or `since` with bounds: b in the window, a up to its nearest moment, and from there on `free`.

    `free` is the same without bounds. It needs no window of its own: where b also comes in the window,
    it does not matter that b comes beyond it as well. So `free` needs no row behind the window.

    Args:
        rows: The rows.
        first: a.
        reached: That b is in the window.
        free: The same without bounds.
        nearest_s: How far away the window begins.
        beyond: The bounds of what is beyond the trial.

    Source:
        Donzé and others 2013.
    """

    def __init__(
        self,
        rows: Rows,
        first: _Operator,
        reached: _Within,
        free: _Until | _Since,
        nearest_s: float,
        beyond: Bounds,
    ) -> None:
        super().__init__(rows, first, reached)
        self.first, self.reached, self.free = first, reached, free
        self.nearest_s, self.beyond = nearest_s, beyond

    @property
    def ready(self) -> int:
        if isinstance(self.free, _Since):
            return min(self.known, len(self.free.so_far))
        return min(self.rows.complete(self.reached.window[1], self.free.known), len(self.reached.so_far))

    def evaluate(self, new: slice) -> Margin:
        # `until` runs backwards from the last row so far, so that each new sample changes all of it.
        free, start = self.free.margin, 0
        if isinstance(self.free, _Until):
            free, start = self.free.from_row(new.start), new.start
        if self.nearest_s > 0:
            free = self._from_there(free, start, new)
        else:
            free = free[new.start - start : new.stop - start]
        return self.reached.margin[new].join(free, np.minimum)

    def _from_there(self, free: Margin, start: int, new: slice) -> Margin:
        """a held up to the nearest moment of the window, and `free`, of rows from `start` on, there."""
        rows, first = self.rows, self.first.margin
        at, between, out = self._nearest(new)
        there = (at >= start) & (at < start + len(free.lower))
        empty = rows.window(*self.reached.window, new).widest.empty
        if empty is not None:
            # The nearest row lies behind the window then. b may have come in the window, between two
            # samples, and nothing behind it says that it did not.
            there &= ~empty
        # Between the last sample and the end of the trial nothing is known, though it is no hole.
        missing = np.where(out, self.beyond[0], -np.inf), np.where(out, self.beyond[1], np.inf)
        lower = np.where(there, free.lower.take(at - start, mode="clip"), missing[0])
        upper = np.where(there, free.upper.take(at - start, mode="clip"), missing[1])
        lower = np.minimum(lowest_between(first.lower, *between), lower)
        upper = np.minimum(lowest_between(first.upper, *between), upper)
        if rows.hole is not None:
            # A hole is many moments: windows begin anywhere in one that is reached, so a has to hold in it
            # up to there; and no single moment of one that is judged can be counted from.
            in_hole = there & rows.hole.take(at, mode="clip")
            lower[in_hole] = np.minimum(lower, first.lower.take(at, mode="clip"))[in_hole]
            lower[rows.hole[new]], upper[rows.hole[new]] = -np.inf, np.inf
        return Margin(lower, upper)

    def _nearest(self, new: slice) -> tuple[IntArray, tuple[IntArray, IntArray], BoolArray]:
        """The row at which windows begin, the first and last row on the way, and whether that is beyond."""
        rows, own, away_s = self.rows, np.arange(new.start, new.stop), self.nearest_s
        begin, end = rows.begin[new], rows.end[new]
        if isinstance(self.free, _Until):
            at = rows.end.searchsorted(begin + (away_s - TOLERANCE_S), side="left")
            return at, (own, at - 1), end + away_s > rows.end_s + TOLERANCE_S
        at = rows.begin.searchsorted(end - (away_s - TOLERANCE_S), side="right") - 1
        return at, (at + 1, own), begin - away_s < rows.start_s - TOLERANCE_S


# The whole formula -----------------------------------------------------------------------


class Discrete:
    """A formula and all of its parts at every row.

    Args:
        tree: The formula.
        rows: All rows of a trial; or none, where the trial goes on.
        beyond: What is beyond the trial.
    """

    def __init__(self, tree: Node, rows: Rows, beyond: Beyond) -> None:
        self.tree, self.rows, self.beyond = tree, rows, beyond
        self._operators: dict[Key, _Operator] = {}
        self._order: list[_Operator] = []
        self._predicates: dict[Node, _Predicate] = {}
        self._top = self._of(tree, 1)
        self._returned = 0
        self._back_s = reach_s(tree, back=True, unbounded_s=0.0)
        self._depth = 1 + sum(1 for _ in tree.walk())

    @classmethod
    def whole(cls, tree: Node, rows: Rows, predicates: Mapping[Node, FloatArray], beyond: Beyond) -> Discrete:
        """Of a trial that is over.

        Args:
            tree: The formula.
            rows: All rows.
            predicates: The margin of every predicate at every sample.
            beyond: What is beyond the trial.
        """
        found = cls(tree, rows, beyond)
        found._advance(predicates)
        return found

    def take(
        self, t_s: float, predicates: Mapping[Node, FloatArray], longest_s: float
    ) -> list[tuple[float, bool, float, float]]:
        """Take one more sample; return every row whose margin has become known.

        Args:
            t_s: Its time.
            predicates: The margin of every predicate there, shape (1,).
            longest_s: A longer stretch without a sample is a hole, s.

        Returns:
            For each row: when it begins, whether it is a hole, and both bounds of the margin.
        """
        rows = self.rows
        rows.take(t_s, longest_s)
        self._advance(predicates)
        new = slice(self._returned, len(self._top.so_far))
        self._returned = new.stop
        margin, count = self._top.margin[new], new.stop - new.start
        holes = [False] * count if rows.hole is None else rows.hole[new].tolist()
        found = list(
            zip(rows.begin[new].tolist(), holes, margin.lower.tolist(), margin.upper.tolist(), strict=True)
        )
        self._forget()
        return found

    def _advance(self, predicates: Mapping[Node, FloatArray]) -> None:
        for node, predicate in self._predicates.items():
            predicate.values = predicates[node]
        for operator in self._order:
            operator.advance()

    def _forget(self) -> None:
        """Drop the rows that no operator looks at any more."""
        rows = self.rows
        if self._returned <= _FORGOTTEN_AT_ONCE:
            return
        # The farthest window back, and one row more for each operator, which carries on from its last one.
        oldest_s = rows.begin[self._returned - 1] - self._back_s - self._depth * CLOSEST_S
        count = int(rows.end.searchsorted(oldest_s)) - self._depth
        count = min(count, self._returned - self._depth)
        if count <= _FORGOTTEN_AT_ONCE:
            return
        rows.forget(count)
        for operator in self._order:
            operator.so_far.forget(count)
        self._returned -= count

    @property
    def kept(self) -> int:
        """How many rows are kept."""
        return len(self.rows)

    # Margins over time --------------------------------------------------------------------

    def of(self, node: Node, sign: int = 1) -> Margin:
        """The margin of a sub-formula at every row.

        Args:
            node: The sub-formula.
            sign: -1 where the whole formula gains when this one loses.
        """
        return self._operators[key_of(self.beyond, node, sign)].margin

    def at(self, node: Node, sign: int, t_s: float) -> Bounds:
        """The bounds of a sub-formula at a moment."""
        margin = self.of(node, sign)
        row = max(int(self.rows.begin.searchsorted(t_s + TOLERANCE_S, side="right")) - 1, 0)
        return float(margin.lower[row]), float(margin.upper[row])

    def during(self, node: Node, sign: int, window: tuple[float, float]) -> tuple[FloatArray, Margin]:
        """When rows begin within a stretch of time, and the margin of a sub-formula there."""
        first = int(self.rows.end.searchsorted(window[0] - TOLERANCE_S, side="left"))
        last = int(self.rows.begin.searchsorted(window[1] + TOLERANCE_S, side="right"))
        rows = slice(first, max(first, last))
        return self.rows.begin[rows], self.of(node, sign)[rows]

    # From sub-formulas to operators ------------------------------------------------------

    def _of(self, node: Node, sign: int) -> _Operator:
        key = key_of(self.beyond, node, sign)
        if key not in self._operators:
            self._operators[key] = self._made(node, sign)
        return self._operators[key]

    def _add(self, operator: _Operator) -> _Operator:
        """An operator, once for all its parts are here: they go on before it does."""
        self._order.append(operator)
        return operator

    def _made(self, node: Node, sign: int) -> _Operator:
        rows, add = self.rows, self._add
        match node.operator:
            case "predicate":
                return self._predicate(node)
            case "true" | "false":
                return add(_Constant(rows, np.inf if node.operator == "true" else -np.inf))
            case "next":
                # With `cut`, `next` holds at the last row: rtamt's choice.
                missing = (np.inf, np.inf) if self.beyond == "cut" else outside(self.beyond, sign)
                return add(_Neighbour(rows, self._of(node.parts[0], sign), 1, missing))
            case "rise" | "fall":
                return self._change(node, sign)
            case "until" | "since":
                return self._until(node, sign)
            case "always" | "eventually" | "historically" | "once":
                smallest = node.operator in ("always", "historically")
                part = self._of(node.parts[0], sign)
                if node.bounds is None:
                    return add(_SoFar(rows, part, smallest=smallest, ahead=node.operator in FUTURE))
                return add(self._within(part, node, sign, smallest=smallest))
        parts = [self._of(part, of) for part, of in with_signs(node, sign)]
        return add(_Connective(rows, node.operator, *parts))

    def _predicate(self, node: Node) -> _Operator:
        """The same for either sign: nothing is beyond the trial."""
        if node not in self._predicates:
            self._predicates[node] = _Predicate(self.rows)
            self._add(self._predicates[node])
        return self._predicates[node]

    def _change(self, node: Node, sign: int) -> _Operator:
        """`rise a`: a, and not a at the row before. `fall a`: not a, and a at the row before."""
        add, rows, rise = self._add, self.rows, node.operator == "rise"
        now = self._of(node.parts[0], sign if rise else -sign)
        then_sign = -sign if rise else sign
        # With `cut`, what holds at the first row has just risen, what does not has fallen: rtamt's choice.
        cut = (-np.inf, -np.inf) if rise else (np.inf, np.inf)
        missing = cut if self.beyond == "cut" else outside(self.beyond, then_sign)
        then = add(_Neighbour(rows, self._of(node.parts[0], then_sign), -1, missing))
        if rise:
            return add(_Connective(rows, "and", now, add(_Connective(rows, "not", then))))
        return add(_Connective(rows, "and", add(_Connective(rows, "not", now)), then))

    def _within(self, part: _Operator, node: Node, sign: int, *, smallest: bool) -> _Within:
        assert node.bounds is not None  # callers have looked
        window = node.bounds.start_s, node.bounds.end_s
        if node.operator not in FUTURE:
            window = -window[1], -window[0]
        beyond = None if self.beyond == "cut" else outside(self.beyond, sign)
        return _Within(self.rows, part, window, beyond, smallest=smallest)

    def _until(self, node: Node, sign: int) -> _Operator:
        rows, bounds = self.rows, node.bounds
        first, second = (self._of(part, sign) for part in node.parts)
        # Without bounds it means the rest of the trial, and b that never comes there breaks it.
        cut = bounds is None or self.beyond == "cut"
        beyond = (-np.inf, -np.inf) if cut else outside(self.beyond, sign)
        ahead = node.operator == "until"
        free = (_Until if ahead else _Since)(rows, first, second, beyond)
        if bounds is None or not ahead:
            self._add(free)
        if bounds is None:
            return free
        reached = self._within(second, node, sign, smallest=False)
        self._add(reached)
        return self._add(_Bounded(rows, first, reached, free, bounds.start_s, beyond))
