"""Units of arithmetic, so that metres are never compared with metres per second."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping

from ariac_score_stl.syntax import Node, StlError

__all__ = ["Unit", "check_units", "parse_unit", "unit_of"]

Unit = Mapping[str, float]
"""Power of each base unit; empty: a plain number."""

_FACTOR = re.compile(r"([A-Za-z%°]+|1)(?:(?:\^|\*\*)?(-?[0-9]+))?")


def parse_unit(text: str) -> Unit:
    """A unit as powers of its factors, so that `m/s` divided by `m` is `1/s`.

    Raises:
        StlError: It is no unit.

    >>> dict(parse_unit("kg m/s^2"))
    {'kg': 1.0, 'm': 1.0, 's': -2.0}
    """
    powers: dict[str, float] = {}
    if text.strip() in ("", "1"):
        return powers
    for number, side in enumerate(text.split("/")):
        for word in side.replace("*", " ").replace("·", " ").split() or [""]:
            match = _FACTOR.fullmatch(word)
            if match is None:
                raise StlError(f"{text!r} is not a unit; write it like m/s^2")
            if match.group(1) != "1":
                power = float(match.group(2) or 1) * (-1 if number else 1)
                powers[match.group(1)] = powers.get(match.group(1), 0.0) + power
    return {name: power for name, power in powers.items() if power}


def check_units(formula: Node, units: Mapping[str, str]) -> None:
    """Refuse sums and comparisons of different units.

    A bare number may have any unit: in `d > 2.6` it is one of m, in `1.6 * v` one of s.

    Raises:
        StlError: Naming both units and the place.
    """
    known = {name: parse_unit(unit) for name, unit in units.items()}
    for node in formula.walk():
        if node.operator == "predicate":
            left, right = (_unit(side.root, known, node) for side in node.sides)
            _agree(left, right, node, node.text)


def unit_of(node: Node, units: Mapping[str, str]) -> str:
    """The unit of a predicate's margin: as declared, where it is one of the declared."""
    known = {name: parse_unit(unit) for name, unit in units.items()}
    found = [unit for side in node.sides if (unit := _unit(side.root, known, node)) is not None]
    for unit in found:
        for name in sorted(units):
            if known[name] == unit:
                return units[name]
    return _shown(found[0]) if found else "1"


def _agree(a: Unit | None, b: Unit | None, node: Node, text: str) -> Unit | None:
    if a is not None and b is not None and a != b:
        raise StlError(f"column {node.column}: {text!r} mixes {_shown(a)} and {_shown(b)}")
    return b if a is None else a


def _shown(unit: Unit) -> str:
    above = [f"{name}^{power:g}" if power != 1 else name for name, power in unit.items() if power > 0]
    below = [f"{name}^{-power:g}" if power != -1 else name for name, power in unit.items() if power < 0]
    return " ".join(above or ["1"]) + ("/" + "/".join(below) if below else "")


def _times(a: Unit | None, b: Unit | None, power: float) -> Unit | None:
    if a is None or b is None:
        return None
    powers = dict(a)
    for name, count in b.items():
        powers[name] = powers.get(name, 0.0) + power * count
    return {name: count for name, count in powers.items() if count}


def _unit(expression: ast.expr, units: Mapping[str, Unit], node: Node) -> Unit | None:
    """The unit of an expression; `None` where a bare number leaves it open."""
    match expression:
        case ast.Name(id=name):
            return units.get(name)
        case ast.UnaryOp(operand=operand):
            return _unit(operand, units, node)
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            base = _unit(left, units, node)
            # With any other exponent than a number, the unit of a power would change with the data.
            if base is not None and isinstance(right, ast.Constant) and isinstance(right.value, int | float):
                return {name: count * right.value for name, count in base.items()}
            return None
        case ast.BinOp(left=left, op=op, right=right):
            a, b = _unit(left, units, node), _unit(right, units, node)
            if isinstance(op, ast.Mult | ast.Div):
                return _times(a, b, 1.0 if isinstance(op, ast.Mult) else -1.0)
            return _agree(a, b, node, ast.unparse(expression))
        case ast.Call(args=arguments):
            unit: Unit | None = None
            for argument in arguments:
                unit = _agree(unit, _unit(argument, units, node), node, ast.unparse(expression))
            return unit
    return None
