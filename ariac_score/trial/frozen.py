"""A dictionary that cannot be changed."""

from __future__ import annotations

from typing import Any, NoReturn, TypeVar

__all__ = ["FrozenMap"]

K = TypeVar("K")
V = TypeVar("V")


class FrozenMap(dict[K, V]):
    """A dictionary that cannot be changed, for the fields of frozen values.

    Why not `types.MappingProxyType`: it can be neither pickled, copied nor written as JSON.

    >>> FrozenMap({"distance_m": 0.02})["distance_m"]
    0.02
    >>> FrozenMap({"distance_m": 0.02}).clear()
    Traceback (most recent call last):
    ...
    TypeError: a FrozenMap cannot be changed
    """

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError("a FrozenMap cannot be changed")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[Any, ...]:
        # By default the items of a dictionary are set one by one, which is refused here.
        return type(self), (dict(self),)
