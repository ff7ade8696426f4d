"""What the BARN Challenge says of itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

__all__ = ["Barn"]


@dataclass(frozen=True)
class Barn:
    """The BARN Challenge: one run through one world.

    Source:
        `run.py` of github.com/Daffan/the-barn-challenge.
    """

    levels: ClassVar[tuple[str, ...]] = ("trial",)
    facts: ClassVar[Mapping[str, Mapping[str, object]]] = {
        "trial": {
            "world": {"type": "number", "meaning": "index of the world in the dataset"},
            "optimal_time_s": {"type": "number", "unit": "s", "meaning": "for its shortest path at 2 m/s"},
        }
    }
    words: ClassVar[Mapping[str, tuple[str, str]]] = {"trial": ("run", "runs")}
