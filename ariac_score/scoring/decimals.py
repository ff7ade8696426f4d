"""Decimals of our own: a score may not depend on the context that the caller, or a plugin, left behind."""

from __future__ import annotations

from collections.abc import Callable
from decimal import ROUND_HALF_EVEN, Context, DivisionByZero, InvalidOperation, Overflow, localcontext
from functools import wraps
from typing import ParamSpec, TypeVar

__all__ = ["context", "in_own_decimals"]

_Arguments = ParamSpec("_Arguments")
_Value = TypeVar("_Value")


def context(digits: int = 28) -> Context:
    """A context in which nothing is left to `decimal.DefaultContext`, which anybody may change."""
    return Context(
        prec=digits,
        rounding=ROUND_HALF_EVEN,
        Emin=-999_999,
        Emax=999_999,
        capitals=1,
        clamp=0,
        flags=[],
        traps=[InvalidOperation, DivisionByZero, Overflow],
    )


_OWN = context()


def in_own_decimals(function: Callable[_Arguments, _Value]) -> Callable[_Arguments, _Value]:
    """A function that adds up and rounds decimals the same whatever `decimal.getcontext()` says.

    >>> import decimal
    >>> with decimal.localcontext() as coarse:
    ...     coarse.prec = 1
    ...     in_own_decimals(sum)([decimal.Decimal("1.25"), 2])
    Decimal('3.25')
    """

    @wraps(function)
    def exactly(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> _Value:
        with localcontext(_OWN):
            return function(*args, **kwargs)

    return exactly
