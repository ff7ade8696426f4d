"""A formula over a trial whose samples come window by window: what is held does not grow with the trial.

A window of rows is judged with as many rows around it as the bounds of the formula
reach; in discrete time a row is a sample or a hole, in dense time a sample. What looks
back or ahead without bounds enters a window as a number: what it was at the row before,
or is at the row after. These numbers are found by going through the windows once,
forwards for what looks back, backwards for what looks ahead, inner sub-formulas first.
All margins are those of one window as long as the trial, to the bit.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, nextafter
from typing import Generic, Literal, TypeVar

import numpy as np

from ariac_score import Aligned, Span
from ariac_score_stl.robustness import Beyond, Discrete, Entering, Key, Margin, entered
from ariac_score_stl.rows import TOLERANCE_S, Rows
from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.syntax import FUTURE, Node

__all__ = ["Line", "RowWindows", "Windows"]

WINDOW_ROWS = 65_536
"""So many rows are judged at once: ten minutes at 100 Hz."""

ROWS_FOR_ONE_AROUND = 8
"""A window is at least so many times as long as what is looked at around it."""

KEPT_BYTES = 64 << 20
"""The margins of all sub-formulas that were asked for last stay in about so much, or in two windows."""

_SLACK_S = 2 * TOLERANCE_S


class Line:
    """Samples and holes in order of time, of which any rows can be had.

    Attributes:
        track: The samples.
        span: The trial.
    """

    def __init__(self, track: Aligned, span: Span, holes: Sequence[Span]) -> None:
        self.track, self.span, self._holes = track, span, holes
        # As `Rows` lays them out.
        self._starts = np.array([hole.start_s for hole in holes]) + 2 * TOLERANCE_S
        self._ends = np.array([hole.end_s for hole in holes]) - 2 * TOLERANCE_S
        self._before = np.array([track.row(start_s) for start_s in self._starts.tolist()], dtype=np.intp)
        """The sample that each hole is before."""
        self._at = self._before + np.arange(len(holes))

    def __len__(self) -> int:
        return len(self.track) + len(self._holes)

    def samples(self, first: int, last: int) -> tuple[int, int]:
        """The samples among some rows."""
        return first - int(self._at.searchsorted(first)), last - int(self._at.searchsorted(last))

    def rows(self, first: int, last: int) -> Rows:
        """Some rows."""
        holes = self._holes[int(self._at.searchsorted(first)) : int(self._at.searchsorted(last))]
        return Rows.of(self.track.times(*self.samples(first, last)), self.span, holes)

    def row_of(self, sample: int) -> int:
        """The row that a sample is."""
        return sample + int(self._before.searchsorted(sample, side="right"))

    def ending(self, t_s: float) -> int:
        """The first row that ends at or after a time."""
        sample = self.track.row(t_s)
        if not self._holes:
            return sample
        holes = int(self._before.searchsorted(sample, side="right"))
        within = holes > 0 and self._before[holes - 1] == sample and self._ends[holes - 1] >= t_s
        return sample + holes - int(within)

    def beginning(self, t_s: float) -> int:
        """The first row that begins after a time."""
        samples = self.track.row(nextafter(t_s, inf))
        return samples + int(self._starts.searchsorted(t_s, side="right")) if self._holes else samples

    def reach(self, first: int, last: int) -> tuple[float, float]:
        """When some rows begin and end, s; there has to be one."""
        return self._time(first, self._starts), self._time(last - 1, self._ends)

    def _time(self, row: int, of_holes: FloatArray) -> float:
        hole = int(self._at.searchsorted(row))
        if hole < len(self._at) and self._at[hole] == row:
            return float(of_holes[hole])
        return float(self.track.times(row - hole, row - hole + 1)[0])


@dataclass(frozen=True)
class Window:
    """One window of rows, judged.

    Attributes:
        first: The first row that is judged.
        last: The row after the last one.
        at: The first row of those that are looked at.
        stop: The row after these.
        reach: Of each sub-formula the rows in which its margin is right.
        evaluated: The margins of all rows that are looked at.
    """

    first: int
    last: int
    at: int
    stop: int
    reach: Mapping[Node, tuple[int, int]]
    evaluated: Discrete

    @property
    def core(self) -> slice:
        """The rows that are judged, among those that are looked at."""
        return slice(self.first - self.at, self.last - self.at)


W = TypeVar("W")


class Windows(Generic[W]):
    """Margins of a formula and its parts, window by window.

    Args:
        body: The formula.
        beyond: What is beyond the trial.
        rows: How many rows there are.
        span: The trial.
        hangs: Whether a sub-formula enters windows as a number.
    """

    def __init__(
        self,
        body: Node,
        beyond: Beyond,
        rows: int,
        span: Span,
        *,
        hangs: Callable[[Node], bool] = entered,
        kept: bool = True,
    ) -> None:
        self._room_bytes = KEPT_BYTES if kept else 0
        self.body, self._beyond, self._count = body, beyond, rows
        self._rows = _window_rows(body, rows, span.duration_s)
        self._windows: OrderedDict[int, W] = OrderedDict()
        self._entering: dict[tuple[Key, int], tuple[float, float]] = {}
        self._extremes: dict[tuple[Node, int, str, bool, int], tuple[float, float | None]] = {}
        self._passes = _passes(body, 1, beyond in ("weak", "strong"), hangs)
        self._begun, self._gone = False, 0

    def __len__(self) -> int:
        return (self._count + self._rows - 1) // self._rows

    def rows_of(self, k: int) -> tuple[int, int]:
        """The rows that are judged in window k."""
        return k * self._rows, min((k + 1) * self._rows, self._count)

    def number_of(self, row: int) -> int:
        """The window in which a row is judged."""
        return row // self._rows

    def window(self, k: int) -> W:
        """Window k."""
        if k in self._windows:
            self._windows.move_to_end(k)
            return self._windows[k]
        found = self._windows[k] = self._made(k)
        while len(self._windows) > 2 and sum(map(self._size, self._windows.values())) > self._room_bytes:
            self._windows.popitem(last=False)
        return found

    def of(self, k: int) -> W:
        """Window k, once all that enters it is known."""
        self._begin()
        while self._gone < k:
            self._go_on(self._gone, self._passes[-1], 1)
            self._gone += 1
        return self.window(k)

    def _made(self, k: int) -> W:
        raise NotImplementedError

    def _size(self, window: W) -> int:
        """How many bytes a window holds, about, or will."""
        raise NotImplementedError

    # What enters a window ----------------------------------------------------------------

    def _begin(self) -> None:
        if self._begun:
            return
        self._begun = True
        for number, keys in enumerate(self._passes[:-1]):
            ahead = number % 2 == 1
            windows = range(len(self) - 1, 0, -1) if ahead else range(len(self) - 1)
            for k in windows if keys else ():
                self._go_on(k, keys, -1 if ahead else 1)

    def _go_on(self, k: int, keys: Sequence[Key], by: int) -> None:
        """Find what enters the next window, after window k or before it."""
        for key, left in self._left(k, keys, by) if keys else ():
            state = self._entering.get((key, k)) if left is None else left
            if state is not None:
                self._entering[key, k + by] = state

    def _left(self, k: int, keys: Sequence[Key], by: int) -> Iterator[tuple[Key, tuple[float, float] | None]]:
        """What sub-formulas leave window k with; `None`: with what they entered it with."""
        raise NotImplementedError

    # The worst of many moments -----------------------------------------------------------

    def extreme(
        self,
        node: Node,
        sign: int,
        window: tuple[float, float],
        *,
        of: Literal["lower", "upper"],
        least: bool,
    ) -> float | None:
        """When a bound of a sub-formula is first least or greatest within a stretch of time."""
        best, when = inf, None
        for k, some in self._within(window):
            value, begin_s = self._extreme(node, sign, k, some, of, least=least)
            if when is None or value < best:
                best, when = value, begin_s
        return when

    def _within(self, window: tuple[float, float]) -> Iterator[tuple[int, tuple[float, float] | None]]:
        """The windows of a stretch of time, and what of each is in it; `None`: all of it."""
        raise NotImplementedError

    def _margins(
        self, node: Node, sign: int, k: int, some: tuple[float, float] | None
    ) -> tuple[FloatArray, Margin]:
        """When margins of a sub-formula in window k begin, and the margins."""
        raise NotImplementedError

    def _extreme(
        self,
        node: Node,
        sign: int,
        k: int,
        some: tuple[float, float] | None,
        of: Literal["lower", "upper"],
        *,
        least: bool,
    ) -> tuple[float, float | None]:
        """The least value (or the greatest, negated) in window k; and when."""
        key = node, sign, of, least, k
        if some is None and key in self._extremes:
            return self._extremes[key]
        begin, margin = self._margins(node, sign, k, some)
        values: FloatArray = getattr(margin, of)
        found: tuple[float, float | None] = inf, None
        if len(values):
            row = int(values.argmin() if least else values.argmax())
            found = float(values[row] if least else -values[row]), float(begin[row])
        if some is None:
            self._extremes[key] = found
        return found


class RowWindows(Windows[Window]):
    """Margins of a formula in discrete time, window by window.

    Args:
        body: The formula.
        line: The rows.
        leaves: The margin of every predicate at the samples from one to before another, of window k.
        beyond: What is beyond the trial.
        kept: Whether windows stay for a while, to be looked at again.
    """

    def __init__(
        self,
        body: Node,
        line: Line,
        leaves: Callable[[int, int, int], Mapping[Node, FloatArray]],
        beyond: Beyond,
        *,
        kept: bool = True,
    ) -> None:
        super().__init__(body, beyond, len(line), line.span, kept=kept)
        self.line, self._leaves = line, leaves
        self._bytes = self._rows * 16 * sum(1 for _ in body.walk())

    def _made(self, k: int) -> Window:
        first, last = self.rows_of(k)
        reach: dict[Node, tuple[int, int]] = {}
        self._reaching(self.body, first, last, reach)
        at, stop = min(a for a, _ in reach.values()), max(b for _, b in reach.values())
        rows = self.line.rows(at, stop)
        leaves = self._leaves(k, *self.line.samples(at, stop))
        found = Window(first, last, at, stop, reach, Discrete(rows, leaves, self._beyond))
        found.evaluated.entering = self._entered(k, at, reach)
        return found

    def _size(self, _: Window) -> int:
        return self._bytes

    # How far is looked -------------------------------------------------------------------

    def _reaching(self, node: Node, first: int, last: int, found: dict[Node, tuple[int, int]]) -> None:
        """The rows in which each sub-formula must be right for a formula to be so in some rows."""
        found[node] = first, last
        inner = self._looked_at(node, first, last)
        for part in node.parts:
            self._reaching(part, *inner, found)

    def _looked_at(self, node: Node, first: int, last: int) -> tuple[int, int]:
        line, count = self.line, len(self.line)
        if node.operator == "next":
            return first, min(last + 1, count)
        if node.operator in ("rise", "fall"):
            return max(first - 1, 0), last
        if node.bounds is None:
            return first, last
        begin_s, end_s = line.reach(first, last)
        start_s, stop_s = node.bounds.start_s, node.bounds.end_s
        if node.operator in FUTURE:
            last = max(last, line.beginning(end_s + stop_s + _SLACK_S))
            if node.operator == "until":
                last = max(last, min(line.ending(end_s + start_s + _SLACK_S) + 1, count))
        else:
            before = line.ending(begin_s - stop_s - _SLACK_S)
            if node.operator == "since":
                before = min(before, max(line.beginning(begin_s - start_s - _SLACK_S) - 1, 0))
            first = min(first, before)
        return first, last

    # What enters a window ----------------------------------------------------------------

    def _entered(self, k: int, at: int, reach: Mapping[Node, tuple[int, int]]) -> Entering:
        known = self._entering  # nothing here holds the window, so that it goes once it is not needed

        def entering(key: Key) -> tuple[slice, tuple[float, float] | None]:
            first, last = _gone_through(reach, key[0])
            return slice(first - at, last - at), known.get((key, k))

        return entering

    def _left(self, k: int, keys: Sequence[Key], by: int) -> Iterator[tuple[Key, tuple[float, float] | None]]:
        window = self.window(k)
        reach: dict[Node, tuple[int, int]] = {}
        self._reaching(self.body, *self.rows_of(k + by), reach)
        for key in keys:
            node, sign = key
            window.evaluated.of(node, sign)
            begin, end = _gone_through(window.reach, node)
            # The last row that the next window does not go through, on its way to it.
            low, high = _gone_through(reach, node)
            row = low - 1 if by > 0 else high
            if not begin <= row < end:
                yield key, None
                continue
            free = window.evaluated.free[window.evaluated.key(node, sign)]
            at = row - window.at
            yield key, (float(free.lower[at]), float(free.upper[at]))

    # Single moments ----------------------------------------------------------------------

    def at(self, node: Node, sign: int, t_s: float) -> tuple[float, float]:
        """The bounds of a sub-formula at a moment."""
        row = max(self.line.beginning(t_s + TOLERANCE_S) - 1, 0)
        window = self.of(self.number_of(row))
        margin, at = window.evaluated.of(node, sign), row - window.at
        return float(margin.lower[at]), float(margin.upper[at])

    def _within(self, window: tuple[float, float]) -> Iterator[tuple[int, tuple[float, float] | None]]:
        first, last = self.line.ending(window[0] - TOLERANCE_S), self.line.beginning(window[1] + TOLERANCE_S)
        for k in range(self.number_of(first), self.number_of(last - 1) + 1) if first < last else ():
            begin, end = self.rows_of(k)
            whole = first <= begin and end <= last
            yield k, None if whole else (max(first, begin), min(last, end))

    def _margins(
        self, node: Node, sign: int, k: int, some: tuple[float, float] | None
    ) -> tuple[FloatArray, Margin]:
        window = self.of(k)
        first, last = some or self.rows_of(k)
        rows = slice(int(first) - window.at, int(last) - window.at)
        margin = window.evaluated.of(node, sign).apply(lambda values: values[rows])
        return window.evaluated.begin[rows], margin


# Which sub-formulas enter windows ------------------------------------------------------------


def _gone_through(reach: Mapping[Node, tuple[int, int]], node: Node) -> tuple[int, int]:
    """The rows through which an operator without bounds goes, of a window of such a reach."""
    return reach[node.parts[0]]


def _passes(body: Node, sign: int, signed: bool, hangs: Callable[[Node], bool]) -> list[list[Key]]:
    """The sub-formulas that enter windows, by the pass that finds what does: forwards, backwards, forwards …

    The last pass is forwards: it is the one in which the formula is judged.
    """
    found: dict[int, dict[Key, None]] = {}
    _sort(body, sign, signed, hangs, found)
    passes = [list(found.get(number, ())) for number in range(max(found, default=0) + 1)]
    return passes if len(passes) % 2 else [*passes, []]


def _sort(
    node: Node,
    sign: int,
    signed: bool,
    hangs: Callable[[Node], bool],
    found: dict[int, dict[Key, None]],
) -> int:
    """Sort a sub-formula and its parts; the earliest pass in which all that enters it is known."""
    earliest = max((_sort(part, s, signed, hangs, found) for part, s in _parts(node, sign)), default=0)
    if not hangs(node):
        return earliest
    number = earliest + (earliest % 2 != (node.operator in FUTURE))
    found.setdefault(number, {})[node, sign if signed else 1] = None
    return number


def _parts(node: Node, sign: int) -> Iterator[tuple[Node, int]]:
    """The parts of a formula with the signs that they are judged with."""
    for number, part in enumerate(node.parts):
        if node.operator in ("<->", "xor", "rise", "fall"):
            yield part, sign
            yield part, -sign
        else:
            yield part, -sign if node.operator == "not" or (node.operator == "->" and not number) else sign


def _window_rows(body: Node, rows: int, span_s: float) -> int:
    """How many rows a window has: many beside those that are looked at around it."""
    around = 0.0 if span_s <= 0 else min(_bounds_s(body) / span_s, 1.0) * rows
    return max(WINDOW_ROWS, int(ROWS_FOR_ONE_AROUND * around))


def _bounds_s(node: Node) -> float:
    """How far bounds reach, ahead and back together, s."""
    own = node.bounds.end_s if node.bounds is not None else 0.0
    return own + max((_bounds_s(part) for part in node.parts), default=0.0)
