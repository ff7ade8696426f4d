"""Arithmetic: what operators compute and when comparisons hold; conditions of `if`, arguments of equations.

Numbers are of three kinds, and so data expressions are evaluated in three places: here exactly,
integers as such and no tolerance; in `guards` as floats of which some are unknown; in `columns` as
floats of all events at once. The functions and the comparisons are these.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, overload

from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.syntax import Const, Data, Num, Op, Var
from ariac_score_rml.values import Bound, Json, shown

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["COMPARISONS", "FUNCTIONS", "MAX_BITS", "argument", "condition", "holds"]

Env = Mapping[str, Bound]
Number = int | float

MAX_BITS = 10_000
"""Whole numbers may not grow larger than this many bits."""

COMPARISONS: Mapping[str, Callable[[Number, Number], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
FUNCTIONS: Mapping[str, Callable[..., Number]] = {
    "abs": abs,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "min": min,
    "max": max,
}


@overload
def holds(op: str, difference: float, tolerance: float) -> bool: ...


@overload
def holds(op: str, difference: NDArray[np.float64], tolerance: float) -> NDArray[np.bool_]: ...


def holds(op: str, difference: float | NDArray[np.float64], tolerance: float) -> bool | NDArray[np.bool_]:
    """Whether `left op right` holds, given left - right; differences up to a tolerance count as 0."""
    if op == "<":
        return difference < -tolerance
    if op == "<=":
        return difference <= tolerance
    if op == ">":
        return difference > tolerance
    if op == ">=":
        return difference >= -tolerance
    same = (difference >= -tolerance) & (difference <= tolerance)
    return same == (op == "==")


def condition(data: Data, env: Env) -> bool:
    """Whether the condition of an `if` holds.

    Raises:
        RmlRunError: Something in it is not what it must be, or a name has no value.
    """
    if isinstance(data, Op):
        if data.op == "&&":
            return condition(data.args[0], env) and condition(data.args[1], env)
        if data.op == "||":
            return condition(data.args[0], env) or condition(data.args[1], env)
        if data.op in COMPARISONS:
            return COMPARISONS[data.op](_number(data.args[0], env), _number(data.args[1], env))
        raise RmlRunError(f"a number, of {data.op!r}, stands where a condition is needed", kind="type_error")
    value = _value(data, env)
    if isinstance(value, bool):
        return value
    raise RmlRunError(f"{_named(data)} is {shown(value)} where a condition is needed", kind="type_error")


def argument(data: Data, env: Env) -> Json:
    """The value of an argument of an equation; a name without a value is false, as in the reference.

    Raises:
        RmlRunError: Powers and functions have no value there, nor have lists and records.
    """
    if isinstance(data, Op):
        if data.op in ("&&", "||") or data.op in COMPARISONS:
            return condition(data, env)
        if data.op == "^" or data.op in FUNCTIONS:
            raise RmlRunError(
                f"{data.op!r} is not evaluated in an argument of an equation",
                kind="unsupported",
                hint="compute it in an `if` or a guard",
            )
        return _number(data, env)
    if isinstance(data, Var) and data.name not in env:
        return False
    value = _value(data, env)
    # Given a list, the reference tries to load files that are named by its elements.
    if isinstance(value, dict | list):
        raise RmlRunError(
            f"{_named(data)} is {shown(value)}, which cannot be an argument of an equation", kind="type_error"
        )
    return value


def _named(data: Data) -> str:
    return repr(data.name) if isinstance(data, Var) else "a value"


def _value(data: Data, env: Env) -> Json:
    if isinstance(data, Num | Const):
        return data.value
    assert isinstance(data, Var)
    if data.name not in env:
        raise RmlRunError(f"the name {data.name!r} has no value yet", kind="unbound")
    return env[data.name].value


def _number(data: Data, env: Env) -> Number:
    if isinstance(data, Op):
        return _checked(_computed(data.op, [_number(arg, env) for arg in data.args]))
    value = _value(data, env)
    if isinstance(value, str) and len(value) == 1:
        return ord(value)  # as in the reference: a string of one character counts as its code point
    if isinstance(value, int | float) and not isinstance(value, bool):
        return value
    raise RmlRunError(f"{_named(data)} is {shown(value)} where a number is needed", kind="type_error")


def _checked(value: Number) -> Number:
    if isinstance(value, int) and value.bit_length() > MAX_BITS:
        raise RmlRunError("a number grows too large", kind="evaluation_error")
    if isinstance(value, float) and not math.isfinite(value):
        raise RmlRunError("a number overflows", kind="evaluation_error")
    return value


def _computed(op: str, args: list[Number]) -> Number:
    try:
        if op in FUNCTIONS:
            return FUNCTIONS[op](*args)
        if len(args) == 1 and op == "-":
            return -args[0]
        a, b = args
        if op == "+":
            return a + b
        if op == "-":
            return a - b
        if op == "*":
            return a * b
        if op == "/":
            # As in the reference: integers that divide evenly give an integer, which is not the same float.
            exact = isinstance(a, int) and isinstance(b, int) and b != 0 and a % b == 0
            return a // b if exact else a / b
        if op == "^":
            return _power(a, b)
    except ZeroDivisionError:
        raise RmlRunError("division by zero", kind="evaluation_error") from None
    except (OverflowError, ValueError):
        raise RmlRunError(f"{op!r} has no value for these numbers", kind="evaluation_error") from None
    raise RmlRunError(f"a condition, of {op!r}, stands where a number is needed", kind="type_error")


def _power(a: Number, b: Number) -> Number:
    if isinstance(a, int) and isinstance(b, int) and b > 0 and a.bit_length() * b > MAX_BITS:
        raise OverflowError
    value = a**b
    if isinstance(value, complex):
        raise ValueError("a root of a negative number")
    assert isinstance(value, int | float)
    return value
