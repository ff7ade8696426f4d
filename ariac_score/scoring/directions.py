"""Which way the margin of a formula goes with each of its names, where that is sure."""

from __future__ import annotations

import ast
from collections.abc import Mapping

from ariac_score.errors import FormulaError
from ariac_score.scoring.expression import Expression

__all__ = ["directions"]


def directions(formula: Expression, numbers: Mapping[str, float]) -> dict[str, int] | None:
    """How the margin of a formula goes with each signal: 1 with it, -1 against it; `None`: neither is sure.

    Args:
        formula: Of comparisons, joined by `and`, `or` and `not`.
        numbers: Its parameters; every other name is a signal.

    >>> directions(Expression.parse("distance >= 2.5 * k + 2.6"), {})
    {'distance': 1, 'k': -1}
    """
    return _directions(formula, formula.root, numbers)


def _directions(formula: Expression, node: ast.expr, numbers: Mapping[str, float]) -> dict[str, int] | None:
    def of(part: ast.expr) -> dict[str, int] | None:
        return _directions(formula, part, numbers)

    if isinstance(node, ast.Constant) or (isinstance(node, ast.Name) and node.id in numbers):
        return {}
    if isinstance(node, ast.Name):
        return {node.id: 1}
    if isinstance(node, ast.BoolOp):
        return _united([of(part) for part in node.values])
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        return _turned(of(node.operand))
    if (
        isinstance(node, ast.Compare)
        and len(node.ops) == 1
        and not isinstance(node.ops[0], ast.Eq | ast.NotEq)
    ):
        left, right = of(node.left), of(node.comparators[0])
        is_lower = isinstance(node.ops[0], ast.Gt | ast.GtE)
        return _united([left, _turned(right)] if is_lower else [_turned(left), right])
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
        right = of(node.right)
        return _united([of(node.left), _turned(right) if isinstance(node.op, ast.Sub) else right])
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div):
        return _scaled(formula, node, of(node.left), of(node.right), numbers)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("min", "max"):
        return _united([of(part) for part in node.args])
    return None


def _scaled(
    formula: Expression,
    node: ast.BinOp,
    left: dict[str, int] | None,
    right: dict[str, int] | None,
    numbers: Mapping[str, float],
) -> dict[str, int] | None:
    """A product with a number, or a quotient by one."""
    if isinstance(node.op, ast.Div) and right:
        return None
    number, goes = (node.right, left) if right == {} else (node.left, right)
    if (right != {} and left != {}) or goes is None:
        return None
    try:
        factor = float(formula.part(number).columns(numbers))
    except FormulaError:
        return None
    return goes if factor >= 0 else _turned(goes)


def _turned(goes: dict[str, int] | None) -> dict[str, int] | None:
    return None if goes is None else {name: -way for name, way in goes.items()}


def _united(parts: list[dict[str, int] | None]) -> dict[str, int] | None:
    """All of them, where none contradicts another."""
    found: dict[str, int] = {}
    for part in parts:
        if part is None or any(found.get(name, way) != way for name, way in part.items()):
            return None
        found |= part
    return found
