"""A formula at every moment it is judged at, window by window: in discrete and in dense time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from math import inf

import numpy as np

from ariac_score import Aligned, FormulaError, Span
from ariac_score_stl.dense import Steps
from ariac_score_stl.dense_windows import DenseWindows
from ariac_score_stl.explain import Evaluated
from ariac_score_stl.robustness import Beyond, Margin, margins, truths
from ariac_score_stl.rows import TOLERANCE_S, BoolArray
from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.syntax import Node
from ariac_score_stl.windows import Line, RowWindows

__all__ = ["Asked", "DenseTime", "DiscreteTime", "Judgement", "Piece"]

FAULT_ROWS = 65_536
"""So many samples are looked at together to say which one is at fault."""

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
        anew: Whether this is the first one again, and what came before is to be forgotten.
    """

    begin: FloatArray
    lower: FloatArray
    upper: FloatArray
    violated: BoolArray
    open: BoolArray
    hole: BoolArray | None = None
    until_s: float | None = None
    anew: bool = False

    @classmethod
    def of(
        cls, begin: FloatArray, lower: FloatArray, upper: FloatArray, decided: tuple[FloatArray, FloatArray]
    ) -> Piece:
        """Of the bounds of the margin, and of those that decide where a margin of 0 does not."""
        violated = decided[1] < 0
        return cls(begin, lower, upper, violated, (decided[0] < 0) & ~violated)

    @property
    def size(self) -> int:
        """How many bytes are held by keeping it, beside its beginnings."""
        return _held_bytes(self.lower, self.upper) + 2 * len(self.begin)


def _held_bytes(*columns: FloatArray) -> int:
    """How many bytes are held by keeping some columns, parts of larger ones maybe."""
    bases = [column if column.base is None else column.base for column in columns]
    return sum(getattr(base, "nbytes", 0) for base in {id(base): base for base in bases}.values())


class _Kept:
    """Pieces that were judged first, for as long as there is room."""

    def __init__(self, room_bytes: int) -> None:
        self._pieces: dict[int, Piece] = {}
        self._room_bytes, self._bytes = room_bytes, 0

    def get(self, k: int) -> Piece | None:
        """The piece of window k, if it is here."""
        return self._pieces.get(k)

    def put(self, k: int, piece: Piece, size: int) -> Piece:
        """The piece of window k, which stays here if there is room for so many bytes."""
        if self._bytes + size <= self._room_bytes:
            self._pieces[k], self._bytes = piece, self._bytes + size
        return piece


def _linked(pieces: Iterable[Piece]) -> Iterator[Piece]:
    """Pieces that know when the next one begins; not those without any moment."""
    before: Piece | None = None
    for piece in pieces:
        if not len(piece.begin):
            continue
        if before is not None:
            yield replace(before, until_s=float(piece.begin[0]))
        before = piece
    if before is not None:
        yield before


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

    def leaves(self, track: Aligned, first: int, last: int) -> dict[Node, FloatArray]:
        """The margins of predicates at some samples.

        Raises:
            FormulaError: One has no value.
        """
        return margins(self.tree, {**track.columns(first, last), **self.constants}, last - first)

    def fault(self, track: Aligned) -> FormulaError | None:
        """Why a predicate has no value, of the first one that has none: at its first such sample of all."""
        for node in self.tree.walk():
            for first, last in track.runs(FAULT_ROWS) if node.margin is not None else ():
                try:
                    margins(node, {**track.columns(first, last), **self.constants}, last - first, first=first)
                except FormulaError as error:
                    return error
        return None


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


class DiscreteTime(Judgement):
    """Of the samples and the holes between them.

    Args:
        asked: What is judged.
        track: The samples.
        line: The rows.
        kept: Whether windows stay for a while, to be looked at again.
    """

    def __init__(self, asked: Asked, track: Aligned, line: Line, *, kept: bool = True) -> None:
        self._asked, self._line = asked, line
        evaluated = RowWindows(
            asked.body, line, lambda _, first, last: asked.leaves(track, first, last), asked.beyond, kept=kept
        )

        def leaves(k: int, *_: int) -> Mapping[Node, FloatArray]:
            return truths(evaluated.window(k).evaluated.predicates)

        self.evaluated: RowWindows = evaluated
        self.decided: RowWindows = RowWindows(asked.body, line, leaves, asked.beyond, kept=kept)
        self._kept = _Kept(KEPT_BYTES if kept else 0)

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
        return _linked(self._pieces())

    def _pieces(self) -> Iterator[Piece]:
        first, last = self._rows
        for k in range(len(self.evaluated)):
            begin, end = self.evaluated.rows_of(k)
            rows = max(first, begin), min(last, end)
            if rows[0] >= rows[1]:
                self.evaluated.window(k)  # where a predicate has no value all of the trial counts
                continue
            yield self._kept.get(k) or self._piece(k, *rows)

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
        return self._kept.put(k, piece, piece.size)

    def predicate(self, node: Node, sample: int) -> float:
        """As of any judgement."""
        window = self.evaluated.window(self.evaluated.number_of(self._line.row_of(sample)))
        first, _ = self._line.samples(window.at, window.stop)
        return float(window.evaluated.predicates[node][sample - first])


class DenseTime(Judgement):
    """Of every moment."""

    def __init__(self, asked: Asked, track: Aligned, longest_s: float) -> None:
        self._asked, self._track = asked, track

        def windows(leaves: Callable[[int, int, int], Mapping[Node, FloatArray]]) -> DenseWindows:
            return DenseWindows(asked.body, track, asked.span, leaves, asked.beyond, longest_s)

        def leaves(k: int, *_: int) -> Mapping[Node, FloatArray]:
            return truths(evaluated.window(k).evaluated.predicates)

        evaluated = windows(lambda _, first, last: asked.leaves(track, first, last))
        self.evaluated: DenseWindows = evaluated
        self.decided: DenseWindows = windows(leaves)
        self._kept = _Kept(KEPT_BYTES)
        self._exact = False
        """Whether a margin that is judged is exactly 0, which does not tell < from <=."""

    @property
    def _stretch(self) -> tuple[float, float] | None:
        """From when to when steps are judged, s, both included; `None`: never."""
        asked = self._asked
        if asked.late:
            return None
        if asked.tree.operator != "always":
            return -inf, asked.span.start_s
        return asked.stretch.start_s + TOLERANCE_S, asked.stretch.end_s + TOLERANCE_S

    def pieces(self) -> Iterator[Piece]:
        """As of any judgement."""
        exact = self._exact
        yield from _linked(self._pieces())
        if self._exact is not exact:
            # Where truth decides, every step that it has counts, before that moment too.
            pieces = _linked(self._pieces())
            yield from (replace(piece, anew=True) for piece in islice(pieces, 1))
            yield from pieces

    def _pieces(self) -> Iterator[Piece]:
        stretch = self._stretch
        for k in range(len(self.evaluated)):
            begin_s, end_s = self.evaluated.time_of(k)
            if stretch is None or stretch[1] < begin_s or end_s <= stretch[0]:
                # Where a predicate has no value all of the trial counts.
                self._asked.leaves(self._track, *self.evaluated.rows_of(k))
                continue
            piece = self._kept.get(k) or self._piece(k, stretch)
            if piece is None:
                return
            yield piece

    def _piece(self, k: int, stretch: tuple[float, float]) -> Piece | None:
        """What is judged in window k; `None` where a first margin of 0 turns up."""
        if self._exact:
            begin, (margin, decided) = self._judged(k, stretch, self.evaluated, self.decided)
        else:
            begin, (margin,) = self._judged(k, stretch, self.evaluated)
            decided = margin
            if not (margin.lower.all() and margin.upper.all()):
                self._exact, self._kept = True, _Kept(KEPT_BYTES)
                return None
        piece = Piece.of(begin, margin.lower, margin.upper, (decided.lower, decided.upper))
        return self._kept.put(k, piece, piece.size + _held_bytes(begin))

    def _judged(
        self, k: int, stretch: tuple[float, float], *several: DenseWindows
    ) -> tuple[FloatArray, list[Margin]]:
        """Moments of window k at which the body is judged, and its margins there."""
        found = [windows.of(k).evaluated.of(self._asked.body) for windows in several]
        rows = [self.evaluated.steps_of(k, steps.begin, stretch) for steps in found]
        begins = [self._begin(steps, some) for steps, some in zip(found, rows, strict=True)]
        if len(several) == 1:
            return begins[0], [found[0].margin.apply(lambda values: values[rows[0]])]
        begin = np.unique(np.concatenate(begins))
        within = stretch[0] < self.evaluated.time_of(k)[0]
        firsts = [0 if within else some.start for some in rows]
        return begin, [steps.on(begin, first) for steps, first in zip(found, firsts, strict=True)]

    def _begin(self, steps: Steps, rows: slice) -> FloatArray:
        """When steps that are judged begin; the first one no earlier than that."""
        begin, start_s = steps.begin[rows], self._asked.stretch.start_s
        if len(begin) and begin[0] < start_s:
            return np.concatenate(([start_s], begin[1:]))
        return begin

    def predicate(self, node: Node, sample: int) -> float:
        """As of any judgement."""
        window = self.evaluated.window(self.evaluated.number_of(sample))
        return float(window.evaluated.predicates[node][sample - window.at])
