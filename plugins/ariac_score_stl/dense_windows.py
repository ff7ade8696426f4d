"""A formula in dense time over a trial whose samples come window by window.

A window of time is judged with as much time around it as the bounds of the formula
reach, and a little more, so that whatever the tolerances join is seen together. Steps of
it that begin in the window are those of the whole trial, to the bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf, nextafter
from typing import Literal

import numpy as np

from ariac_score import Aligned, Span
from ariac_score_stl.dense import Dense, Entering, hangs
from ariac_score_stl.robustness import Beyond, Key, Margin
from ariac_score_stl.rows import TOLERANCE_S
from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.syntax import FUTURE, Node
from ariac_score_stl.windows import Windows

__all__ = ["DenseWindow", "DenseWindows"]

SLACK_S = 1e-6
"""Far more than the tolerance, and than the rounding of times."""


@dataclass(frozen=True)
class DenseWindow:
    """One window of time, judged.

    Attributes:
        at: The first sample of those that are looked at.
        reach: Of each sub-formula from when to when its margin is right, s.
        evaluated: The margins while all of these samples stand.
    """

    at: int
    reach: Mapping[Node, tuple[float, float]]
    evaluated: Dense


class DenseWindows(Windows[DenseWindow]):
    """Margins of a formula in dense time, window by window.

    Args:
        body: The formula.
        track: The samples; there has to be one.
        span: The trial.
        leaves: The margin of every predicate at the samples from one to before another, of window k.
        beyond: What is beyond the trial.
        longest_s: A sample stands for no longer than this, s.
    """

    def __init__(
        self,
        body: Node,
        track: Aligned,
        span: Span,
        leaves: Callable[[int, int, int], Mapping[Node, FloatArray]],
        beyond: Beyond,
        longest_s: float,
    ) -> None:
        super().__init__(body, beyond, len(track), span, hangs=hangs)
        self._track, self._span, self._leaves, self._longest_s = track, span, leaves, longest_s
        firsts = [self.rows_of(k)[0] for k in range(1, len(self))]
        self._cuts = np.array([float(track.times(row, row + 1)[0]) for row in firsts])
        """When windows begin, without the first."""
        self._around: dict[Node, tuple[float, float]] = {}
        """How far before and after a window the margin of each sub-formula must be right, s."""
        self._reaching(body, SLACK_S, SLACK_S)

    def number_at(self, t_s: float) -> int:
        """The window in which a moment is judged."""
        return int(self._cuts.searchsorted(t_s, side="right"))

    def time_of(self, k: int) -> tuple[float, float]:
        """Window k is from the one moment to before the other."""
        begin_s = -inf if k == 0 else float(self._cuts[k - 1])
        return begin_s, inf if k == len(self._cuts) else float(self._cuts[k])

    def _made(self, k: int) -> DenseWindow:
        reach = {node: self._reach(k, node) for node in self._around}
        from_s, to_s = min(a for a, _ in reach.values()), max(b for _, b in reach.values())
        # What holds when it begins is said by the sample before.
        first = max(self._track.row(nextafter(from_s, inf)) - 1, 0)
        last = len(self._track) if to_s == inf else self._track.row(to_s)
        following_s = float(self._track.times(last, last + 1)[0]) if last < len(self._track) else None
        evaluated = Dense(
            self._track.times(first, last),
            self._span,
            self._leaves(k, first, last),
            self._beyond,
            self._longest_s,
            from_start=first == 0,
            following_s=following_s,
        )
        evaluated.entering = self._entered(k, reach)
        return DenseWindow(first, reach, evaluated)

    def _size(self, window: DenseWindow) -> int:
        return 2 * window.evaluated.size  # margins and what is decided by truth share the room

    # How far is looked -------------------------------------------------------------------

    def _reaching(self, node: Node, before_s: float, after_s: float) -> None:
        self._around[node] = before_s, after_s
        if node.bounds is not None:
            ahead = node.operator in FUTURE
            before_s += SLACK_S + (0.0 if ahead else node.bounds.end_s)
            after_s += SLACK_S + (node.bounds.end_s if ahead else 0.0)
        for part in node.parts:
            self._reaching(part, before_s, after_s)

    def _reach(self, k: int, node: Node) -> tuple[float, float]:
        """From when to when the margin of a sub-formula is right in window k; infinite beyond the trial."""
        (begin_s, end_s), (before_s, after_s) = self.time_of(k), self._around[node]
        from_s, to_s = begin_s - before_s, end_s + after_s
        return (
            -inf if from_s <= self._span.start_s else from_s,
            inf if to_s > self._span.end_s else to_s,
        )

    # What enters a window ----------------------------------------------------------------

    def _entered(self, k: int, reach: Mapping[Node, tuple[float, float]]) -> Entering:
        known = self._entering  # nothing here holds the window, so that it goes once it is not needed

        def entering(key: Key) -> tuple[tuple[float, float], tuple[float, float] | None]:
            return reach[key[0].parts[0]], known.get((key, k))

        return entering

    def _left(self, k: int, keys: Sequence[Key], by: int) -> Iterator[tuple[Key, tuple[float, float] | None]]:
        evaluated = self.window(k).evaluated
        for key in keys:
            node, sign = key
            moment_s = self._reach(k + by, node.parts[0])[by < 0]
            yield key, None if abs(moment_s) == inf else evaluated.left(node, sign, moment_s)

    # Single moments ----------------------------------------------------------------------

    def at(self, node: Node, sign: int, t_s: float) -> tuple[float, float]:
        """The bounds of a sub-formula at a moment."""
        moment_s = t_s + TOLERANCE_S
        return self.of(self.number_at(moment_s)).evaluated.of(node, sign).value(moment_s)

    def extreme(
        self,
        node: Node,
        sign: int,
        window: tuple[float, float],
        *,
        of: Literal["lower", "upper"],
        least: bool,
    ) -> float | None:
        """As of any windows."""
        if window[1] < self._span.start_s or window[0] > self._span.end_s:
            return None
        found = super().extreme(node, sign, window, of=of, least=least)
        return None if found is None else max(found, window[0])

    def _within(self, window: tuple[float, float]) -> Iterator[tuple[int, tuple[float, float] | None]]:
        from_s, to_s = window[0] + TOLERANCE_S, window[1] + TOLERANCE_S
        for k in range(self.number_at(from_s), self.number_at(to_s) + 1):
            begin_s, end_s = self.time_of(k)
            # Where the stretch begins in a window, a step that began before it counts too.
            whole = (from_s < begin_s or from_s == -inf) and end_s <= to_s
            yield k, None if whole else (from_s, to_s)

    def _margins(
        self, node: Node, sign: int, k: int, some: tuple[float, float] | None
    ) -> tuple[FloatArray, Margin]:
        steps = self.of(k).evaluated.of(node, sign)
        rows = self.steps_of(k, steps.begin, some)
        return steps.begin[rows], steps.margin.apply(lambda values: values[rows])

    def steps_of(self, k: int, begin: FloatArray, some: tuple[float, float] | None = None) -> slice:
        """The steps that begin in window k, and the one with which a stretch begins in it.

        Args:
            k: The window.
            begin: When all steps begin that are looked at for it, s.
            some: The stretch: from when to when, s, both included; `None`: all of the trial.
        """
        begin_s, end_s = self.time_of(k)
        from_s, to_s = some or (-inf, inf)
        if from_s < begin_s:
            first = int(begin.searchsorted(begin_s))
        else:
            first = max(int(begin.searchsorted(from_s, side="right")) - 1, 0)
        last = begin.searchsorted(end_s) if end_s <= to_s else begin.searchsorted(to_s, side="right")
        return slice(first, int(last))
