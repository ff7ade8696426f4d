"""A formula in the best and in the worst world that the gaps of a log allow.

Every operator of temporal logic is monotone in the margins of what it joins, but for the sign of a negation.
So where each predicate goes one way with each of its signals, the margins of the worst world follow from the
worse end of every signal in every cell of time, and those of the best world from the better one. `xor` and
`<->` look at their parts with both signs, and `next`, `rise` and `fall` at single samples: of these nothing
is known in a gap.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ariac_score import FloatArray, directions
from ariac_score.monitors import FilledSignals
from ariac_score_stl.sliding import lowest_between
from ariac_score_stl.specification import Specification
from ariac_score_stl.syntax import FUTURE, PAST, STEPS, Node

__all__ = ["is_monotone", "predicates_of_world"]


def is_monotone(specification: Specification) -> bool:
    """Whether both worlds of a formula can be judged."""
    signs = _signs(specification.tree)
    return signs is not None and all(_ways(node, specification) is not None for node in signs)


def predicates_of_world(
    specification: Specification, filled: FilledSignals, *, worst: bool
) -> dict[Node, FloatArray]:
    """The margin of every predicate in every cell, at its worse or its better end.

    Args:
        specification: A monotone formula.
        filled: The signals by the names in it.
        worst: In which world.

    Raises:
        FormulaError: A predicate has no value in some cell.
    """
    least, most = _around(specification, filled)
    found: dict[Node, FloatArray] = {}
    for node, sign in (_signs(specification.tree) or {}).items():
        ways, columns = _ways(node, specification) or {}, dict[str, FloatArray | float]()
        for name in node.names:
            if name in ways:
                lower = (ways[name] > 0) == ((sign > 0) == worst)
                columns[name] = (least if lower else most)[name]
            else:
                columns[name] = specification.constants[name]
        assert node.margin is not None
        found[node] = np.broadcast_to(node.margin.columns(columns), len(filled.t))
    return found


def _signs(tree: Node, sign: int = 1) -> dict[Node, int] | None:
    """Whether the whole formula gains or loses with each predicate; `None` where it may do either."""
    if tree.operator in ("xor", "<->", *STEPS):
        return None
    if tree.operator == "predicate":
        return {tree: sign}
    found: dict[Node, int] = {}
    for number, part in enumerate(tree.parts):
        turns = tree.operator == "not" or (tree.operator == "->" and number == 0)
        of_part = _signs(part, -sign if turns else sign)
        if of_part is None:
            return None
        found |= of_part
    return found


def _ways(node: Node, specification: Specification) -> dict[str, int] | None:
    """How the margin of a predicate goes with each of its signals."""
    if node.margin is None or node.comparison in ("==", "!="):
        return None
    return directions(node.margin, specification.constants)


def _around(
    specification: Specification, filled: FilledSignals
) -> tuple[Mapping[str, FloatArray], Mapping[str, FloatArray]]:
    """The ends in each cell and, where windows begin and end within cells, in those around it."""
    windows = [node for node in specification.body.walk() if node.operator in (*FUTURE, *PAST)]
    if not windows and specification.tree.bounds is None:
        return filled.least, filled.most
    t, until = filled.t, np.append(filled.t[1:], filled.t[-1:])
    longest_s = float((until - t)[filled.open].max(initial=0.0))
    first = t.searchsorted(t - longest_s)
    last = np.maximum(until.searchsorted(until + longest_s, side="right"), np.arange(len(t)))
    last = np.minimum(last, len(t) - 1)
    opened = np.concatenate(([0], np.cumsum(filled.open)))
    near = opened[last + 1] > opened[first]  # what lies between samples that were seen is as it was seen
    least, most = {}, {}
    for name in filled.least:
        low, high = filled.least[name], filled.most[name]
        least[name] = np.where(near, lowest_between(low, first, last), low)
        most[name] = np.where(near, -lowest_between(-high, first, last), high)
    return least, most
