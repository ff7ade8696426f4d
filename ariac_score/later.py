"""Modules that take long to load, loaded when something of them is first used.

Checking a rule set crunches no numbers, and numpy takes longer to load than that takes. A module
that computes imports it from here, and for type checkers as usual.

    if TYPE_CHECKING:
        import numpy as np
    else:
        from ariac_score.later import numpy as np
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__all__ = ["numpy", "sqlite3"]


class _Later:
    """A module that is not loaded yet; what was used of it once is found as quickly as in itself."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> Any:
        found = getattr(import_module(self._name), attribute)
        setattr(self, attribute, found)
        return found


numpy: Any = _Later("numpy")
sqlite3: Any = _Later("sqlite3")
