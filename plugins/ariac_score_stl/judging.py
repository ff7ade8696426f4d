"""A formula at every moment it is judged at: in discrete time window by window, in dense time at once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ariac_score import Span
from ariac_score_stl.dense import Dense
from ariac_score_stl.explain import Evaluated
from ariac_score_stl.robustness import Beyond, margins, truths
from ariac_score_stl.rows import TOLERANCE_S, BoolArray
from ariac_score_stl.sliding import FloatArray, IntArray
from ariac_score_stl.syntax import Node
from ariac_score_stl.windows import Line, Track, Windows

__all__ = ["Asked", "DenseTime", "DiscreteTime", "Judgement", "Piece"]

KEPT_BYTES = 8 << 20
"""So much of what was judged first stays, whatever the length of the trial, to be looked at again."""


@dataclass(frozen=True, eq=False)
class Piece:
    """Moments at which a formula is judged, one after the other.

    Attributes:
        begin: When, shape (n,), s.
        lower: The margin is at least this, shape (n,).
        upper: The margin is at most this, shape (n,).
        violated: Where the formula is broken, shape (n,).
        open: Where it cannot be decided, shape (n,).
        hole: Which moments stand for a hole, shape (n,); `None`: none does.
        until_s: The moment after the last one of these; `None`: there is none.
    """

    begin: FloatArray
    lower: FloatArray
    upper: FloatArray
    violated: BoolArray
    open: BoolArray
    hole: BoolArray | None = None
    until_s: float | None = None

    @classmethod
    def of(
        cls, begin: FloatArray, lower: FloatArray, upper: FloatArray, decided: tuple[FloatArray, FloatArray]
    ) -> Piece:
        """Of the bounds of the margin, and of those that decide where a margin of 0 does not."""
        violated = decided[1] < 0
        return cls(begin, lower, upper, violated, (decided[0] < 0) & ~violated)

    @property
    def size(self) -> int:
        """How many bytes are held by keeping it."""
        parts = {id(part): part for part in (self.lower, self.upper)}.values()
        bases = (part if part.base is None else part.base for part in parts)
        return sum(getattr(base, "nbytes", 0) for base in bases) + 2 * len(self.begin)


@dataclass(frozen=True)
class Asked:
    """What is judged, and when.

    Attributes:
        tree: The formula.
        body: What is judged at every moment.
        constants: Numbers by name.
        beyond: What is beyond the trial.
        span: The trial.
        stretch: When the body is judged.
        late: Whether that is after the trial.
    """

    tree: Node
    body: Node
    constants: Mapping[str, float]
    beyond: Beyond
    span: Span
    stretch: Span
    late: bool

    def leaves(self, track: Track, first: int, last: int) -> dict[Node, FloatArray]:
        """The margins of predicates at some samples.

        Raises:
            FormulaError: One has no value.
        """
        return margins(self.tree, {**track.columns(first, last), **self.constants}, last - first)


class Judgement:
    """A formula, judged.

    Attributes:
        evaluated: The margins of its parts.
        decided: The same as truth.
    """

    evaluated: Evaluated
    decided: Evaluated

    def pieces(self) -> Iterator[Piece]:
        """All moments at which it is judged; one piece has some, unless there are none at all.

        Raises:
            FormulaError: A predicate has no value at some sample.
        """
        raise NotImplementedError

    def predicate(self, node: Node, sample: int) -> float:
        """The margin of a predicate at a sample."""
        raise NotImplementedError

    def anywhere(self, node: Node, size: float) -> bool:
        """Whether the margin of a predicate is of some size at any sample."""
        raise NotImplementedError


class DiscreteTime(Judgement):
    """Of the samples and the holes between them.

    Args:
        asked: What is judged.
        track: The samples.
        line: The rows.
        kept: Whether windows stay for a while, to be looked at again.
    """

    def __init__(self, asked: Asked, track: Track, line: Line, *, kept: bool = True) -> None:
        self._asked, self._line = asked, line
        evaluated = Windows(
            asked.body, line, lambda _, first, last: asked.leaves(track, first, last), asked.beyond, kept=kept
        )

        def leaves(k: int, *_: int) -> Mapping[Node, FloatArray]:
            return truths(evaluated.window(k).evaluated.predicates)

        self.evaluated: Windows = evaluated
        self.decided: Windows = Windows(asked.body, line, leaves, asked.beyond, kept=kept)
        self._room_bytes = KEPT_BYTES if kept else 0
        self._kept: dict[int, Piece] = {}
        self._kept_bytes = 0

    @property
    def _rows(self) -> tuple[int, int]:
        """The rows that are judged."""
        asked = self._asked
        if asked.late:
            return 0, 0
        if asked.tree.operator != "always":
            return 0, 1
        first = self._line.ending(asked.stretch.start_s - TOLERANCE_S)
        return first, self._line.beginning(asked.stretch.end_s + TOLERANCE_S)

    def pieces(self) -> Iterator[Piece]:
        """As of any judgement."""
        first, last = self._rows
        before: Piece | None = None
        for k in range(len(self.evaluated)):
            begin, end = self.evaluated.rows_of(k)
            rows = max(first, begin), min(last, end)
            if rows[0] >= rows[1]:
                self.evaluated.window(k)  # where a predicate has no value all of the trial counts
                continue
            piece = self._kept.get(k) or self._piece(k, *rows)
            if before is not None:
                yield replace(before, until_s=float(piece.begin[0]))
            before = piece
        if before is not None:
            yield before

    def _piece(self, k: int, first: int, last: int) -> Piece:
        body = self._asked.body
        window = self.evaluated.of(k)
        margin = window.evaluated.of(body)
        rows = slice(first - window.at, last - window.at)
        lower = margin.lower[rows]
        upper = lower if margin.known else margin.upper[rows]
        decided = lower, upper
        if not (lower.all() and upper.all()):  # a margin of exactly 0 does not tell < from <=
            truth = self.decided.of(k).evaluated.of(body)
            decided = truth.lower[rows], truth.upper[rows]
        holes = window.evaluated.rows.hole
        piece = Piece.of(window.evaluated.begin[rows], lower, upper, decided)
        piece = replace(piece, hole=None if holes is None else holes[rows])
        if self._kept_bytes + piece.size <= self._room_bytes:
            self._kept[k], self._kept_bytes = piece, self._kept_bytes + piece.size
        return piece

    def predicate(self, node: Node, sample: int) -> float:
        """As of any judgement."""
        window = self.evaluated.window(self.evaluated.number_of(self._line.row_of(sample)))
        first, _ = self._line.samples(window.at, window.stop)
        return float(window.evaluated.predicates[node][sample - first])

    def anywhere(self, node: Node, size: float) -> bool:
        """As of any judgement."""
        found = (self.evaluated.window(k).evaluated.predicates[node] for k in range(len(self.evaluated)))
        return any(bool((np.abs(margin) == size).any()) for margin in found)


class DenseTime(Judgement):
    """Of every moment, all at once."""

    def __init__(self, asked: Asked, track: Track, longest_s: float) -> None:
        self._asked = asked
        self._t = track.times(0, len(track))
        self._longest_s = longest_s
        self._predicates = asked.leaves(track, 0, len(track))
        self.evaluated: Dense = self._evaluate(self._predicates)
        self.decided: Dense = self.evaluated
        self._piece = self._judged()

    def _evaluate(self, predicates: Mapping[Node, FloatArray]) -> Dense:
        return Dense(self._t, self._asked.span, predicates, self._asked.beyond, self._longest_s)

    def _judged(self) -> Piece:
        begin, lower, upper = self._bounds(self.evaluated)
        if lower.all() and upper.all():
            return Piece.of(begin, lower, upper, (lower, upper))
        # Where a margin is exactly 0 it does not tell < from <=.
        self.decided = self._evaluate(truths(self._predicates))
        on, *decided = self._bounds(self.decided)
        if len(on) != len(begin):  # steps are as long as nothing changes
            begin, both = _on_all_steps(begin, on)
            lower, upper = lower[both[0]], upper[both[0]]
            decided = [bound[both[1]] for bound in decided]
        return Piece.of(begin, lower, upper, (decided[0], decided[1]))

    def _bounds(self, evaluated: Dense) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Moments at which the body is judged, and its bounds there."""
        stretch, steps = self._asked.stretch, evaluated.of(self._asked.body)
        begin = steps.begin
        first = max(int(np.searchsorted(begin, stretch.start_s + TOLERANCE_S, side="right")) - 1, 0)
        last = int(np.searchsorted(begin, stretch.end_s + TOLERANCE_S, side="right"))
        if self._asked.tree.operator != "always":
            first, last = 0, 1
        rows = slice(0, 0) if self._asked.late else slice(first, last)
        begin = begin[rows]
        if len(begin) and begin[0] < stretch.start_s:
            begin = np.concatenate(([stretch.start_s], begin[1:]))
        return begin, steps.margin.lower[rows], steps.margin.upper[rows]

    def pieces(self) -> Iterator[Piece]:
        """As of any judgement."""
        if len(self._piece.begin):
            yield self._piece

    def predicate(self, node: Node, sample: int) -> float:
        """As of any judgement."""
        return float(self._predicates[node][sample])

    def anywhere(self, node: Node, size: float) -> bool:
        """As of any judgement."""
        return bool((np.abs(self._predicates[node]) == size).any())


def _on_all_steps(a: FloatArray, b: FloatArray) -> tuple[FloatArray, tuple[IntArray, IntArray]]:
    """Steps that fit both, and the row of each in both."""
    begin = np.unique(np.concatenate((a, b)))
    return begin, (np.searchsorted(a, begin, side="right") - 1, np.searchsorted(b, begin, side="right") - 1)
