"""Margins between two bounds, and what connectives make of them: the same in discrete and in dense time.

Where something is not known, the margin lies between two numbers, and both are
carried through: a formula is broken where even the upper one is negative, kept where
even the lower one is not, and undecided between. So a hole in the log, or the end of
the trial, makes undecided exactly what depends on it.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Literal

import numpy as np

from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.syntax import Node

__all__ = [
    "NEXT_TO_ZERO",
    "Beyond",
    "Key",
    "Margin",
    "connected",
    "decisive",
    "key_of",
    "margins",
    "outside",
    "truths",
    "with_signs",
]

Beyond = Literal["undecided", "weak", "strong", "cut"]
"""What is beyond the trial: not known; what keeps the formula; what breaks it; not part of any window."""

Bounds = tuple[float, float]
"""The lower and the upper bound of one margin."""

Key = tuple[Node, int]
"""A sub-formula, and the sign it is judged with: -1 where the whole formula gains when this one loses."""

NEXT_TO_ZERO = sys.float_info.min
"""Stands for a margin of 0 that holds (or, negative, does not).

The smallest normal number: some libraries switch subnormal ones off for the whole process, and
then 5e-324 is 0.
"""


@dataclass(frozen=True, eq=False)
class Margin:
    """The margin of a formula at every row or step, between two bounds.

    Attributes:
        lower: At least this, shape (n,).
        upper: At most this, shape (n,); the very same array where everything is known, which halves the work.
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

    def __getitem__(self, rows: slice) -> Margin:
        return self.apply(lambda values: values[rows])

    def join(self, other: Margin, change: Callable[[FloatArray, FloatArray], FloatArray]) -> Margin:
        """Something done to two margins, bound by bound."""
        lower = change(self.lower, other.lower)
        known = self.known and other.known
        return Margin(lower, lower if known else change(self.upper, other.upper))


# Predicates ------------------------------------------------------------------------------


def margins(formula: Node, columns: Mapping[str, FloatArray | float], n: int) -> dict[Node, FloatArray]:
    """The margin of every predicate at every sample.

    Args:
        formula: The formula.
        columns: Values of signals, shape (n,), and constants, by name.
        n: Number of samples.

    Raises:
        FormulaError: Division by zero, or a result that is not finite.
    """
    found: dict[Node, FloatArray] = {}
    for node in formula.walk():
        if node.margin is not None:
            names = node.names
            used = {name: column for name, column in columns.items() if name in names}
            difference = node.margin.columns(used)
            if difference.shape != (n,):  # of constants alone
                difference = np.broadcast_to(difference, n)
            # An equality holds nowhere but at 0, so its margin is never positive; that of != never negative.
            if node.comparison in ("==", "!="):
                difference = np.abs(difference) if node.comparison == "!=" else -np.abs(difference)
            found[node] = difference
    return found


def truths(found: Mapping[Node, FloatArray]) -> dict[Node, FloatArray]:
    """The same as truth: 1 where a predicate holds, -1 where not.

    Where a margin is exactly 0, `<` and `<=` differ; here they do.
    """
    return {
        node: np.where(margin >= 0 if _holds_at_0(node) else margin > 0, 1.0, -1.0)
        for node, margin in found.items()
    }


def decisive(found: Mapping[Node, FloatArray]) -> dict[Node, FloatArray]:
    """The same as margins that are never 0, so that the sign decides: margin and truth in one.

    Operators only choose among margins and change their sign, so no formula has a margin of 0 then.
    A trial that goes on is judged by these. One that is over is judged by margins, and by truth only if
    one is 0: dense time leaves out steps that change nothing, and what stands for 0 would add some.
    """
    nonzero = dict(found)
    for node, margin in found.items():
        if not margin.all():
            nonzero[node] = np.where(
                margin == 0, NEXT_TO_ZERO if _holds_at_0(node) else -NEXT_TO_ZERO, margin
            )
    return nonzero


def _holds_at_0(node: Node) -> bool:
    return node.comparison not in ("<", ">", "!=")


# Connectives -----------------------------------------------------------------------------


def with_signs(node: Node, sign: int) -> list[Key]:
    """What a connective looks at: its parts, with the signs that they are judged with."""
    match node.operator:
        case "not":
            return [(node.parts[0], -sign)]
        case "->":
            return [(node.parts[0], -sign), (node.parts[1], sign)]
        case "<->" | "xor":
            a, b = node.parts
            of = -sign if node.operator == "xor" else sign
            return [(a, of), (b, of), (a, -of), (b, -of)]
    return [(part, sign) for part in node.parts]


def connected(operator: str, *parts: Margin) -> Margin:
    """The margin of a connective.

    Args:
        operator: Which one.
        parts: The margins of what `with_signs` names, on the same rows.
    """
    match operator:
        case "not":
            return -parts[0]
        case "and":
            return reduce(lambda a, b: a.join(b, np.minimum), parts)
        case "or":
            return reduce(lambda a, b: a.join(b, np.maximum), parts)
        case "->":
            return (-parts[0]).join(parts[1], np.maximum)
    # Both or neither: `(a -> b) and (b -> a)`. Its other reading, `(a and b) or (not a and not b)`,
    # has the same margin only where nothing is missing.
    a, b, a_against, b_against = parts
    there, back = connected("->", a_against, b), connected("->", b_against, a)
    both = there.join(back, np.minimum)
    return -both if operator == "xor" else both


# Beyond the trial ------------------------------------------------------------------------


def outside(beyond: Beyond, sign: int) -> Bounds:
    """The bounds of anything beyond the trial that an operator cannot do without."""
    if beyond == "weak":
        return sign * np.inf, sign * np.inf
    if beyond == "strong":
        return -sign * np.inf, -sign * np.inf
    return -np.inf, np.inf


def key_of(beyond: Beyond, node: Node, sign: int) -> Key:
    """Under which a margin is kept: where the sign makes no difference it is 1."""
    return node, sign if beyond in ("weak", "strong") else 1
