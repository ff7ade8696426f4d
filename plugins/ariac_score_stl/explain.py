"""Which sub-formula failed, and when: from a broken formula down to what broke it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from ariac_score_stl.margins import Margin
from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.syntax import Node

__all__ = ["Cause", "causes"]


@dataclass(frozen=True)
class Cause:
    """A sub-formula at a moment.

    Attributes:
        node: The sub-formula.
        t_s: When, s of trial time.
        holds: Whether it holds there; where the formula forbids it, holding is the failure.
    """

    node: Node
    t_s: float
    holds: bool


class Evaluated(Protocol):
    """Margins of all sub-formulas over time."""

    def at(self, node: Node, sign: int, t_s: float) -> tuple[float, float]:
        """The bounds of a sub-formula at a moment."""
        ...

    def during(self, node: Node, sign: int, window: tuple[float, float]) -> tuple[FloatArray, Margin]:
        """When margins of a sub-formula begin within a stretch of time, and these margins."""
        ...


_FOREVER = float("inf")


def causes(evaluated: Evaluated, node: Node, t_s: float) -> list[Cause]:
    """What a formula that is broken at a moment fails by, outermost first.

    Of several parts that all had to hold, the one farthest from it; of several of which
    one would have done, the one nearest to it; of an implication, what it promised.
    """
    return list(_descend(evaluated, node, t_s, sign=1, holds=False))


def _descend(evaluated: Evaluated, node: Node, t_s: float, *, sign: int, holds: bool) -> Iterator[Cause]:
    if node.operator == "not":
        yield from _descend(evaluated, node.parts[0], t_s, sign=-sign, holds=not holds)
        return
    if node.operator in ("and", "or", "->"):
        part, part_sign, part_holds = _part(evaluated, node, t_s, sign, holds=holds)
        yield from _descend(evaluated, part, t_s, sign=part_sign, holds=part_holds)
        return
    yield Cause(node, t_s, holds)
    if node.operator in ("always", "eventually", "historically", "once"):
        part = node.parts[0]
        # What it fails by is its worst moment; of what never came, the nearest to it.
        least = node.operator in ("always", "historically")
        begin, margin = evaluated.during(part, sign, _window(node, t_s))
        if len(begin):
            values = margin.lower if holds else margin.upper
            moment_s = float(begin[values.argmin() if least else values.argmax()])
            yield from _descend(evaluated, part, moment_s, sign=sign, holds=holds)


def _part(evaluated: Evaluated, node: Node, t_s: float, sign: int, *, holds: bool) -> tuple[Node, int, bool]:
    """The part that decides a connective."""
    if node.operator == "->":
        a, b = node.parts
        if not holds or evaluated.at(b, sign, t_s)[0] >= 0:
            return b, sign, holds
        return a, -sign, not holds
    bound = 0 if holds else 1
    choose = min if node.operator == "and" else max
    part = choose(node.parts, key=lambda one: evaluated.at(one, sign, t_s)[bound])
    return part, sign, holds


def _window(node: Node, t_s: float) -> tuple[float, float]:
    ahead = node.operator in ("always", "eventually")
    if node.bounds is None:
        return (t_s, _FOREVER) if ahead else (-_FOREVER, t_s)
    start_s, end_s = node.bounds.start_s, node.bounds.end_s
    return (t_s + start_s, t_s + end_s) if ahead else (t_s - end_s, t_s - start_s)
