"""The margins of a formula row by row, while the rows come: discrete time.

Every sub-formula is a stage that takes what its parts have given so far and gives what
can be given now: at once where it looks back, and where it looks ahead as soon as the
rows have come that it looks at. What a stage keeps is as long as its window, and a row
costs the same however many came before. The numbers are those of `Discrete`, to the bit.

Rows closer together than `CLOSEST_S` are beyond what stamps can tell apart; their
windows may be told apart otherwise than afterwards.
"""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from collections.abc import Callable, Mapping
from math import inf

from ariac_score_stl.robustness import Beyond
from ariac_score_stl.rows import TOLERANCE_S
from ariac_score_stl.syntax import Node

__all__ = ["CLOSEST_S", "Network", "unbounded_ahead"]

CLOSEST_S = 2 * TOLERANCE_S

_REACHED_S = TOLERANCE_S / 2  # a row this near the end of a window is the last that can be in it
_TRIM_EVERY = 4096


def unbounded_ahead(tree: Node) -> Node | None:
    """The first sub-formula that looks ahead without a bound; `None` where none does."""
    for node in tree.walk():
        if node.operator in ("always", "eventually", "until") and node.bounds is None:
            return node
    return None


class _Rows:
    """The rows that are kept; `first` is the number of the first of them, as in every stage."""

    def __init__(self) -> None:
        self.first = 0
        self.begin: list[float] = []
        self.end: list[float] = []
        self.hole: list[bool] = []
        self.start_s = 0.0

    @property
    def count(self) -> int:
        return self.first + len(self.begin)

    def complete_to(self, t_s: float) -> bool:
        """Whether every row that begins up to a moment has come."""
        return self.begin[-1] >= t_s - _REACHED_S


class _Stage:
    """One sub-formula: the bounds of its margin at every row so far."""

    def __init__(self, rows: _Rows, *parts: _Stage) -> None:
        self.rows, self.parts = rows, parts
        self.lower: list[float] = []
        self.upper: list[float] = []

    @property
    def next(self) -> int:
        """The row it gives next."""
        return self.rows.first + len(self.lower)

    @property
    def needed(self) -> int:
        """The first row it will look at again, of its parts and of its own."""
        return self.next

    def advance(self) -> None:
        """Give what can be given."""
        k, last = self.next, min((part.next for part in self.parts), default=self.rows.count)
        while k < last and self.ready(k):
            lower, upper = self.give(k)
            self.lower.append(lower)
            self.upper.append(upper)
            k += 1

    def ready(self, _k: int) -> bool:
        """Whether all rows that a row looks at have come."""
        return True

    @abstractmethod
    def give(self, k: int) -> tuple[float, float]:
        """The bounds at a row."""

    def at(self, k: int) -> tuple[float, float]:
        """The bounds at a row that was given and is kept."""
        k -= self.rows.first
        return self.lower[k], self.upper[k]


class _Leaf(_Stage):
    """A predicate, fed from outside; or a constant."""

    def __init__(self, rows: _Rows, constant: float | None = None) -> None:
        super().__init__(rows)
        self.constant = constant
        self.value = 0.0

    def give(self, k: int) -> tuple[float, float]:
        if self.constant is not None:
            return self.constant, self.constant
        return (-inf, inf) if self.rows.hole[k - self.rows.first] else (self.value, self.value)


class _Not(_Stage):
    def give(self, k: int) -> tuple[float, float]:
        lower, upper = self.parts[0].at(k)
        return -upper, -lower


class _Join(_Stage):
    """The least or the greatest of its parts."""

    def __init__(self, rows: _Rows, join: Callable[[float, float], float], *parts: _Stage) -> None:
        super().__init__(rows, *parts)
        self.join = join

    def give(self, k: int) -> tuple[float, float]:
        join = self.join
        lower, upper = self.parts[0].at(k)
        for part in self.parts[1:]:
            low, high = part.at(k)
            lower, upper = join(lower, low), join(upper, high)
        return lower, upper


class _Shifted(_Stage):
    """The margin at the row after or before; a hole has neighbours within itself too."""

    def __init__(self, rows: _Rows, part: _Stage, by: int, missing: tuple[float, float]) -> None:
        super().__init__(rows, part)
        self.by, self.missing = by, missing

    @property
    def needed(self) -> int:
        return self.next + min(self.by, 0)

    def ready(self, k: int) -> bool:
        return k + self.by < self.parts[0].next

    def give(self, k: int) -> tuple[float, float]:
        lower, upper = self.missing if k + self.by < 0 else self.parts[0].at(k + self.by)
        if self.rows.hole[k - self.rows.first]:
            low, high = self.parts[0].at(k)
            lower, upper = min(lower, low), max(upper, high)
        return lower, upper


class _SoFar(_Stage):
    """The least or the greatest up to each row."""

    def __init__(self, rows: _Rows, part: _Stage, join: Callable[[float, float], float]) -> None:
        super().__init__(rows, part)
        self.join = join
        self.held: tuple[float, float] | None = None

    def give(self, k: int) -> tuple[float, float]:
        lower, upper = self.parts[0].at(k)
        if self.held is not None:
            lower, upper = self.join(self.held[0], lower), self.join(self.held[1], upper)
        self.held = lower, upper
        return self.held


# Windows ---------------------------------------------------------------------------------


class _Sliding:
    """The least of one bound of a part over rows whose ends only ever move on."""

    def __init__(self, values: list[float], rows: _Rows, sign: float) -> None:
        self.values, self.rows, self.sign = values, rows, sign
        self.pushed = 0
        self.queue: deque[tuple[int, float]] = deque()

    def lowest(self, first: int, last: int) -> float:
        """The least from `first` to `last`; +inf where there is none."""
        queue, values, base, sign = self.queue, self.values, self.rows.first, self.sign
        while self.pushed <= last:
            value = sign * values[self.pushed - base]
            while queue and queue[-1][1] >= value:
                queue.pop()
            queue.append((self.pushed, value))
            self.pushed += 1
        while queue and queue[0][0] < first:
            queue.popleft()
        return queue[0][1] if queue else inf


class _Edge:
    """The first row of a window, or the one after its last, moving on with the row it is of."""

    def __init__(self, times: list[float], rows: _Rows) -> None:
        self.times, self.rows, self.row = times, rows, 0

    def up_to(self, t_s: float) -> int:
        """The first row at or after a time."""
        times, base = self.times, self.rows.first
        while self.row - base < len(times) and times[self.row - base] < t_s:
            self.row += 1
        return self.row

    def beyond(self, t_s: float) -> int:
        """The first row after a time."""
        times, base = self.times, self.rows.first
        while self.row - base < len(times) and times[self.row - base] <= t_s:
            self.row += 1
        return self.row


class _Within(_Stage):
    """The least or the greatest margin in the window of each row."""

    def __init__(
        self,
        rows: _Rows,
        part: _Stage,
        window: tuple[float, float],
        *,
        smallest: bool,
        outside: tuple[float, float] | None,
    ) -> None:
        super().__init__(rows, part)
        (self.start_s, self.end_s), self.smallest, self.outside = window, smallest, outside
        sign = 1.0 if smallest else -1.0
        self.sign = sign
        # What bounds the extremum from its weak side must see all that could matter.
        self.wide = _Sliding(part.lower if smallest else part.upper, rows, sign)
        self.sure = _Sliding(part.upper if smallest else part.lower, rows, sign)
        self.first_wide, self.first_sure = _Edge(rows.end, rows), _Edge(rows.end, rows)
        self.last_wide, self.last_sure = _Edge(rows.begin, rows), _Edge(rows.begin, rows)

    @property
    def needed(self) -> int:
        edges = (self.first_wide, self.first_sure, self.last_wide, self.last_sure)
        return min(self.next, self.wide.pushed, self.sure.pushed, *(edge.row for edge in edges))

    def ready(self, k: int) -> bool:
        rows = self.rows
        to_s = rows.end[k - rows.first] + self.end_s
        return rows.complete_to(to_s) and self.last_wide.beyond(to_s + TOLERANCE_S) <= self.parts[0].next

    def give(self, k: int) -> tuple[float, float]:
        rows = self.rows
        begin, end = rows.begin[k - rows.first], rows.end[k - rows.first]
        first = self.first_wide.up_to(begin + self.start_s - TOLERANCE_S)
        last = self.last_wide.beyond(end + self.end_s + TOLERANCE_S) - 1
        weak = self.sign * self.wide.lowest(first, last)
        sure_first = self.first_sure.up_to(end + self.start_s - TOLERANCE_S)
        sure_last = self.last_sure.beyond(begin + self.end_s + TOLERANCE_S) - 1
        strong = self.sign * self.sure.lowest(sure_first, sure_last)
        lower, upper = (weak, strong) if self.smallest else (strong, weak)
        if begin + self.start_s < rows.start_s - TOLERANCE_S:
            if self.outside is None:
                return lower, upper
            join = min if self.smallest else max
            return join(lower, self.outside[0]), join(upper, self.outside[1])
        return (-inf, inf) if first > last else (lower, upper)


# Since, until ----------------------------------------------------------------------------


class _Since(_Stage):
    """What held from the last time of the second part on: the recursion, from the first row."""

    def __init__(self, rows: _Rows, first: _Stage, second: _Stage, outer: tuple[float, float]) -> None:
        super().__init__(rows, first, second)
        self.held = outer

    def give(self, k: int) -> tuple[float, float]:
        (low_a, high_a), (low_b, high_b) = self.parts[0].at(k), self.parts[1].at(k)
        lower, upper = self.held
        self.held = max(low_b, min(low_a, lower)), max(high_b, min(high_a, upper))
        return self.held


class _Earlier(_Stage):
    """`first` held for a while, before it what `free` was at the last row then."""

    def __init__(
        self, rows: _Rows, first: _Stage, free: _Stage, after_s: float, outer: tuple[float, float]
    ) -> None:
        super().__init__(rows, first, free)
        self.after_s, self.outer = after_s, outer
        self.edge = _Edge(rows.begin, rows)
        self.low, self.high = _Sliding(first.lower, rows, 1.0), _Sliding(first.upper, rows, 1.0)

    @property
    def needed(self) -> int:
        return min(self.next, max(self.edge.row - 1, 0), self.low.pushed, self.high.pushed)

    def give(self, k: int) -> tuple[float, float]:
        rows, (first, free) = self.rows, self.parts
        begin, end = rows.begin[k - rows.first], rows.end[k - rows.first]
        at = self.edge.beyond(end - (self.after_s - TOLERANCE_S)) - 1
        lower, upper = self.low.lowest(at + 1, k), self.high.lowest(at + 1, k)
        if rows.hole[k - rows.first]:
            return -inf, inf
        if at < 0:
            before = begin - self.after_s < rows.start_s - TOLERANCE_S
            missing = self.outer if before else (-inf, inf)
            return min(lower, missing[0]), min(upper, missing[1])
        low, high = free.at(at)
        lower, upper = min(lower, low), min(upper, high)
        return (min(lower, first.at(at)[0]) if rows.hole[at - rows.first] else lower), upper


class _Chain:
    """`a until b` over rows whose ends only ever move on, for one bound.

    Each row cuts a number off at both sides, and so does any run of rows: (what it makes
    of -inf, what of +inf). Two stacks of such runs make a queue.
    """

    def __init__(self, first: list[float], second: list[float], rows: _Rows) -> None:
        self.first, self.second, self.rows = first, second, rows
        self.pushed = self.popped = 0
        self.front: list[tuple[float, float]] = []
        self.back = -inf, inf

    def value(self, first: int, last: int) -> float:
        """What holds at `first` if nothing is known to come after `last`."""
        base = self.rows.first
        while self.popped < first:
            self._pop(base)
        while self.pushed <= last:
            b, a = self.second[self.pushed - base], self.first[self.pushed - base]
            low, high = self.back
            self.back = max(low, min(high, b)), max(low, min(high, max(a, b)))
            self.pushed += 1
        if self.popped >= self.pushed:
            return -inf
        low, high = self.front[-1] if self.front else (-inf, inf)
        return max(low, min(high, self.back[0]))

    def _pop(self, base: int) -> None:
        if self.popped >= self.pushed:
            self.popped += 1
            self.pushed = self.popped
            return
        if not self.front:
            low, high = -inf, inf
            for k in range(self.pushed - 1, self.popped - 1, -1):
                b, a = self.second[k - base], self.first[k - base]
                low, high = max(b, min(a, low)), max(b, min(a, high))
                self.front.append((low, high))
            self.back = -inf, inf
        self.front.pop()
        self.popped += 1


class _Until(_Stage):
    """`a until[s,e] b`: b in the window, and a up to there."""

    def __init__(self, rows: _Rows, first: _Stage, second: _Stage, window: tuple[float, float]) -> None:
        super().__init__(rows, first, second)
        self.start_s, self.end_s = window
        self.reached = _Sliding(second.upper, rows, -1.0)
        self.low = _Chain(first.lower, second.lower, rows)
        self.high = _Chain(first.upper, second.upper, rows)
        self.held_low, self.held_high = _Sliding(first.lower, rows, 1.0), _Sliding(first.upper, rows, 1.0)
        self.edge, self.last = _Edge(rows.end, rows), _Edge(rows.begin, rows)
        self.sure = _Edge(rows.begin, rows)

    @property
    def needed(self) -> int:
        return min(
            self.next,
            self.edge.row,
            self.last.row,
            self.sure.row,
            self.reached.pushed,
            self.low.popped,
            self.high.popped,
            self.held_low.pushed,
            self.held_high.pushed,
        )

    def ready(self, k: int) -> bool:
        rows = self.rows
        to_s = rows.end[k - rows.first] + self.end_s
        if not rows.complete_to(to_s):
            return False
        return self.last.beyond(to_s + TOLERANCE_S) <= min(part.next for part in self.parts)

    def give(self, k: int) -> tuple[float, float]:
        rows, first = self.rows, self.parts[0]
        begin, end, hole = (column[k - rows.first] for column in (rows.begin, rows.end, rows.hole))
        last = self.last.beyond(end + self.end_s + TOLERANCE_S) - 1
        sure_last = self.sure.beyond(begin + self.end_s + TOLERANCE_S) - 1
        at = self.edge.up_to(begin + self.start_s - TOLERANCE_S) if self.start_s > 0 else k
        high = self.high.value(at, last)
        if self.start_s == 0:
            return self.low.value(k, sure_last), high
        low = self.low.value(at, sure_last)
        held = self.held_low.lowest(k, min(at - 1, last)), self.held_high.lowest(k, min(at - 1, last))
        if hole:
            return -inf, -self.reached.lowest(at, last) if at <= last else inf
        self.reached.lowest(at, last)
        if at > last:  # no sample is in the window
            return -inf, held[1]
        low, high = min(low, held[0]), min(high, held[1])
        return (min(low, first.at(at)[0]) if rows.hole[at - rows.first] else low), high


# The whole formula -----------------------------------------------------------------------


class Network:
    """The stages of a formula, for one subject.

    Args:
        tree: The formula; nothing in it looks ahead without a bound.
        start_s: Where the trial begins, s.
        beyond: What is beyond the trial.
        longest_s: A longer stretch without a sample is a hole, s.
    """

    def __init__(self, tree: Node, start_s: float, beyond: Beyond, longest_s: float) -> None:
        self.rows = _Rows()
        self.rows.start_s = start_s
        self._beyond, self._longest_s = beyond, longest_s
        self._stages: dict[tuple[Node, int], _Stage] = {}
        self._order: list[_Stage] = []
        self._leaves: dict[Node, _Leaf] = {}
        self._top = self._of(tree, 1)
        self._told = 0
        self._latest_s = start_s

    def take(self, t_s: float, margins: Mapping[Node, float]) -> list[tuple[float, bool, float, float]]:
        """Take one sample; give what can be given: begin, whether it is a hole, lower and upper bound.

        Args:
            t_s: Its time.
            margins: Of every predicate.
        """
        rows = self.rows
        if t_s - self._latest_s > self._longest_s + TOLERANCE_S:
            self._row(self._latest_s + CLOSEST_S, t_s - CLOSEST_S, hole=True)
        for node, margin in margins.items():
            self._leaves[node].value = margin
        self._row(t_s, t_s, hole=False)
        self._latest_s = t_s
        top, first = self._top, rows.first
        found = [
            (rows.begin[k - first], rows.hole[k - first], *top.at(k)) for k in range(self._told, top.next)
        ]
        self._told = top.next
        if len(rows.begin) >= 2 * _TRIM_EVERY:
            self._trim()
        return found

    @property
    def kept(self) -> int:
        """How many rows are kept."""
        return len(self.rows.begin)

    def _row(self, begin_s: float, end_s: float, *, hole: bool) -> None:
        rows = self.rows
        rows.begin.append(begin_s)
        rows.end.append(end_s)
        rows.hole.append(hole)
        if hole:
            # A leaf must know that it is one; whoever looks ahead waits for the sample after it.
            for leaf in self._leaves.values():
                leaf.advance()
            return
        for stage in self._order:
            stage.advance()

    def _trim(self) -> None:
        """Forget the rows that nobody looks at any more."""
        count = min(self._told, *(stage.needed for stage in self._order)) - self.rows.first
        if count < _TRIM_EVERY:
            return
        del self.rows.begin[:count], self.rows.end[:count], self.rows.hole[:count]
        for stage in self._order:
            del stage.lower[:count], stage.upper[:count]
        self.rows.first += count

    # From nodes to stages ----------------------------------------------------------------

    def _of(self, node: Node, sign: int) -> _Stage:
        key = node, sign if self._beyond in ("weak", "strong") else 1
        if key not in self._stages:
            self._stages[key] = self._made(node, sign)
        return self._stages[key]

    def _add(self, stage: _Stage) -> _Stage:
        self._order.append(stage)
        return stage

    def _outside(self, sign: int) -> tuple[float, float]:
        if self._beyond == "weak":
            return sign * inf, sign * inf
        if self._beyond == "strong":
            return -sign * inf, -sign * inf
        return -inf, inf

    def _made(self, node: Node, sign: int) -> _Stage:
        rows, add = self.rows, self._add
        match node.operator:
            case "predicate":
                leaf = self._leaves.get(node)
                if leaf is None:
                    leaf = self._leaves[node] = _Leaf(rows)
                    add(leaf)
                return leaf
            case "true" | "false":
                return add(_Leaf(rows, inf if node.operator == "true" else -inf))
            case "not":
                return add(_Not(rows, self._of(node.parts[0], -sign)))
            case "and" | "or":
                join = min if node.operator == "and" else max
                return add(_Join(rows, join, *(self._of(part, sign) for part in node.parts)))
            case "->":
                return self._implied(node.parts[0], node.parts[1], sign)
            case "<->" | "xor":
                of = -sign if node.operator == "xor" else sign
                a, b = node.parts
                both = add(_Join(rows, min, self._implied(a, b, of), self._implied(b, a, of)))
                return add(_Not(rows, both)) if node.operator == "xor" else both
            case "next" | "rise" | "fall":
                return self._step(node, sign)
            case "until" | "since":
                return self._until(node, sign)
        return self._extremum(node, sign)

    def _implied(self, first: Node, second: Node, sign: int) -> _Stage:
        never = self._add(_Not(self.rows, self._of(first, -sign)))
        return self._add(_Join(self.rows, max, never, self._of(second, sign)))

    def _step(self, node: Node, sign: int) -> _Stage:
        rows, add, cut = self.rows, self._add, self._beyond == "cut"
        part = node.parts[0]
        if node.operator == "next":
            return add(_Shifted(rows, self._of(part, sign), 1, (inf, inf)))
        if node.operator == "rise":
            now, then = self._of(part, sign), self._of(part, -sign)
            missing = (-inf, -inf) if cut else self._outside(-sign)
            not_then = add(_Not(rows, add(_Shifted(rows, then, -1, missing))))
            return add(_Join(rows, min, now, not_then))
        now, then = self._of(part, -sign), self._of(part, sign)
        missing = (inf, inf) if cut else self._outside(sign)
        return add(_Join(rows, min, add(_Not(rows, now)), add(_Shifted(rows, then, -1, missing))))

    def _extremum(self, node: Node, sign: int) -> _Stage:
        part = self._of(node.parts[0], sign)
        smallest = node.operator in ("always", "historically")
        if node.bounds is None:
            return self._add(_SoFar(self.rows, part, min if smallest else max))
        ahead = node.operator in ("always", "eventually")
        return self._within(part, node, sign, smallest=smallest, ahead=ahead)

    def _within(self, part: _Stage, node: Node, sign: int, *, smallest: bool, ahead: bool) -> _Stage:
        assert node.bounds is not None
        start_s, end_s = node.bounds.start_s, node.bounds.end_s
        window = (start_s, end_s) if ahead else (-end_s, -start_s)
        outside = None if self._beyond == "cut" else self._outside(sign)
        return self._add(_Within(self.rows, part, window, smallest=smallest, outside=outside))

    def _until(self, node: Node, sign: int) -> _Stage:
        rows, add, bounds = self.rows, self._add, node.bounds
        first, second = (self._of(part, sign) for part in node.parts)
        if node.operator == "until":
            assert bounds is not None  # or it would not be watched online
            return add(_Until(rows, first, second, (bounds.start_s, bounds.end_s)))
        outer = (-inf, -inf) if bounds is None or self._beyond == "cut" else self._outside(sign)
        free = add(_Since(rows, first, second, outer))
        if bounds is None:
            return free
        reached = self._within(second, node, sign, smallest=False, ahead=False)
        if bounds.start_s > 0:
            free = add(_Earlier(rows, first, free, bounds.start_s, outer))
        return add(_Join(rows, min, reached, free))
