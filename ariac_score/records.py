"""Dataclasses, of which the frozen ones take a quarter of the time to define.

The standard library compiles six methods for each frozen dataclass, before Python 3.13 one by one.
With a hundred of them that is a third of what a short command takes. Here only `__init__` is
compiled for each, and the other methods are shared; whatever is unusual about a class is left to the
standard library. What such a class does is the same.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from operator import attrgetter
from reprlib import recursive_repr
from typing import TYPE_CHECKING, Any, TypeVar, cast

__all__ = ["dataclass"]

_T = TypeVar("_T", bound="type[Any]")

_OWN = ("__repr__", "__eq__", "__hash__", "__setattr__", "__delattr__")
_UNUSUAL_HINTS = ("InitVar", "KW_ONLY")

if TYPE_CHECKING or sys.version_info >= (3, 13):
    from dataclasses import dataclass
else:

    def dataclass(cls: _T | None = None, /, **options: Any) -> _T | Callable[[_T], _T]:
        """As `dataclasses.dataclass`."""
        if cls is not None:
            return dataclasses.dataclass(cls)
        return lambda found: _defined(found, options)


def _defined(cls: _T, options: dict[str, Any]) -> _T:
    if not _is_usual(cls, options):
        return cast("_T", dataclasses.dataclass(**options)(cls))
    kind: Any = cls
    dataclasses.dataclass(repr=False, eq=False)(kind)
    names = tuple(field.name for field in dataclasses.fields(kind))
    eq = options.get("eq", True)
    known = kind.__dataclass_params__
    known.frozen, known.repr, known.eq = True, True, eq
    kind.__setattr__, kind.__delattr__ = _frozen(cls, frozenset(names))
    kind.__repr__ = _repr_of(names)
    if eq:
        kind.__eq__, kind.__hash__ = _equality(names)
    return cls


def _is_usual(cls: type[Any], options: dict[str, Any]) -> bool:
    if not options.get("frozen") or options.keys() - {"frozen", "eq"}:
        return False
    if any(dataclasses.is_dataclass(base) for base in cls.__mro__[1:]):
        return False
    own = vars(cls)
    if any(name in own for name in (*_OWN, "__slots__")):
        return False
    hints = own.get("__annotations__", {}).values()
    if any(unusual in str(hint) for hint in hints for unusual in _UNUSUAL_HINTS):
        return False
    return not any(isinstance(value, dataclasses.Field) and _is_special(value) for value in own.values())


def _is_special(field: dataclasses.Field[Any]) -> bool:
    usual = field.init and field.repr and field.compare and field.hash is None
    return not usual or field.kw_only is True


def _frozen(
    cls: type[Any], names: frozenset[str]
) -> tuple[Callable[[Any, str, Any], None], Callable[[Any, str], None]]:
    assign = object.__setattr__

    # `__init__` sets each field once.
    def set_once(self: Any, name: str, value: Any) -> None:
        if name in self.__dict__ if name in names else type(self) is cls:
            raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")
        assign(self, name, value)

    def delete(self: Any, name: str) -> None:
        if type(self) is cls or name in names:
            raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")
        object.__delattr__(self, name)

    return set_once, delete


def _repr_of(names: tuple[str, ...]) -> Callable[[Any], str]:
    @recursive_repr()
    def told(self: Any) -> str:
        values = ", ".join(f"{name}={getattr(self, name)!r}" for name in names)
        return f"{type(self).__qualname__}({values})"

    return told


def _equality(names: tuple[str, ...]) -> tuple[Callable[[Any, object], Any], Callable[[Any], int]]:
    values: Callable[[Any], Any]
    values = attrgetter(*names) if len(names) > 1 else lambda self: tuple(getattr(self, n) for n in names)

    def equal(self: Any, other: object) -> Any:
        return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

    def hashed(self: Any) -> int:
        return hash(values(self))

    return equal, hashed
