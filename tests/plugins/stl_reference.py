"""Signal temporal logic word for word: every window searched, sample by sample. Slow and plain."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

Formula = tuple[Any, ...]
"""`("p", name, comparison, limit)`, or an operator with its parts and bounds; see `text_of`."""

EPSILON_S = 1e-9


def text_of(f: Formula) -> str:
    """The formula in the language of the monitor."""
    match f:
        case ("p", name, comparison, limit):
            return f"{name} {comparison} {limit!r}"
        case (("not" | "next" | "rise" | "fall") as op, a):
            return f"{op} ({text_of(a)})"
        case (("and" | "or" | "xor" | "->" | "<->") as op, a, b):
            return f"(({text_of(a)}) {op} ({text_of(b)}))"
        case (("until" | "since") as op, a, b, bounds):
            return f"(({text_of(a)}) {op}{_bounds(bounds, ',')} ({text_of(b)}))"
        case (op, a, bounds):
            return f"{op}{_bounds(bounds, ',')} ({text_of(a)})"
    raise AssertionError(f)


def rtamt_of(f: Formula) -> str:
    """The formula in the language of rtamt; both-or-neither as two implications, see the tests."""
    match f:
        case ("p", name, comparison, limit):
            return f"({name} {'!==' if comparison == '!=' else comparison} {limit!r})"
        case ("not", a):
            return f"(not {rtamt_of(a)})"
        case (("next" | "rise" | "fall") as op, a):
            return f"{op}({rtamt_of(a)})"
        case ("->", a, b):
            return f"({rtamt_of(a)} implies {rtamt_of(b)})"
        case ("<->", a, b):
            return rtamt_of(("and", ("->", a, b), ("->", b, a)))
        case ("xor", a, b):
            return f"(not {rtamt_of(('<->', a, b))})"
        case (("and" | "or") as op, a, b):
            return f"({rtamt_of(a)} {op} {rtamt_of(b)})"
        case (("until" | "since") as op, a, b, bounds):
            return f"({rtamt_of(a)} {op}{_bounds(bounds, ':')} {rtamt_of(b)})"
        case (op, a, bounds):
            return f"({op}{_bounds(bounds, ':')}({rtamt_of(a)}))"
    raise AssertionError(f)


def _bounds(bounds: tuple[float, float] | None, comma: str) -> str:
    return "" if bounds is None else f"[{bounds[0]!r}{comma}{bounds[1]!r}]"


def _predicate(value: float, comparison: str, limit: float) -> float:
    return {
        "<": limit - value,
        "<=": limit - value,
        ">": value - limit,
        ">=": value - limit,
        "==": -abs(value - limit),
        "!=": abs(value - limit),
    }[comparison]


def robustness(  # noqa: PLR0912  # one case for each operator, side by side
    f: Formula, t: Sequence[float], values: dict[str, Sequence[float]], i: int, *, dense: bool = False
) -> float:
    """The robustness at sample i, windows cut to the trace.

    In dense time samples must come at equal steps, of which bounds are multiples. Then it is the same on
    all of a step: from a moment in step i, a and b steps away lie in the steps i + a and i + b. Only
    `until` and `since` differ: before a moment within step k, some of step k has passed, and behind
    it some of step k is still to come.
    """
    n = len(t)

    def at(part: Formula, k: int) -> float:
        return robustness(part, t, values, k, dense=dense)

    def window(bounds: tuple[float, float] | None, *, back: bool) -> list[int]:
        low, high = bounds or (0.0, math.inf)
        away = [(t[i] - t[k]) if back else (t[k] - t[i]) for k in range(n)]
        return [k for k in range(n) if low - EPSILON_S <= away[k] <= high + EPSILON_S]

    match f:
        case ("p", name, comparison, limit):
            return _predicate(values[name][i], comparison, limit)
        case ("not", a):
            return -at(a, i)
        case ("and", a, b):
            return min(at(a, i), at(b, i))
        case ("or", a, b):
            return max(at(a, i), at(b, i))
        case ("->", a, b):
            return max(-at(a, i), at(b, i))
        case ("<->", a, b):
            return min(max(-at(a, i), at(b, i)), max(-at(b, i), at(a, i)))
        case ("xor", a, b):
            return -at(("<->", a, b), i)
        case ("next", a):
            return at(a, i + 1) if i + 1 < n else math.inf
        case ("rise", a):
            return min(-at(a, i - 1) if i else math.inf, at(a, i))
        case ("fall", a):
            return min(at(a, i - 1) if i else math.inf, -at(a, i))
        case ("always", a, bounds):
            return min((at(a, k) for k in window(bounds, back=False)), default=math.inf)
        case ("eventually", a, bounds):
            return max((at(a, k) for k in window(bounds, back=False)), default=-math.inf)
        case ("historically", a, bounds):
            return min((at(a, k) for k in window(bounds, back=True)), default=math.inf)
        case ("once", a, bounds):
            return max((at(a, k) for k in window(bounds, back=True)), default=-math.inf)
        case ("until", a, b, bounds):
            moments = window(bounds, back=False)
            away = bool(dense and bounds and bounds[0] > 0)
            nearest = [k for k in moments if away and t[k] - t[i] <= bounds[0] + EPSILON_S]
            return max(
                (min([at(b, k), *(at(a, j) for j in range(i, k + (k in nearest)))]) for k in moments),
                default=-math.inf,
            )
        case ("since", a, b, bounds):
            return max(
                (
                    min([at(b, k), *(at(a, j) for j in range(k + 1 - (dense and k < i), i + 1))])
                    for k in window(bounds, back=True)
                ),
                default=-math.inf,
            )
    raise AssertionError(f)
