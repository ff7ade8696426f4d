"""The ways in which what was handed in can have been what was ordered, and what they have in common."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass

__all__ = ["Way", "Ways"]

Way = Mapping[str, int | None]
"""For each task the hand-in that it was, by its number; `None`: none that is seen."""

_MOST_STEPS = 20_000
"""Of the search; beyond them all is open."""


@dataclass(frozen=True)
class Ways:
    """What a way must agree with.

    Attributes:
        candidates: For each task the hand-ins that it may have been, in the order of the tasks.
        unseen: Tasks that may have been handed in unseen, or not at all.
        counted: Hand-ins that were surely one of the tasks.
        alike: For each task what is the same of tasks between which no score can tell.
        fits: Whether a way agrees with everything else that is recorded.
    """

    candidates: Mapping[str, Sequence[int]]
    unseen: Collection[str]
    counted: Collection[int]
    alike: Mapping[str, Hashable]
    fits: Callable[[Way], bool]

    def places(self) -> dict[str, set[int | None]] | None:
        """For each task what it is in the possible ways; `None` where there are too many to try.

        Of tasks that are alike the one that comes first in its order is taken for the one handed in first.
        """
        found: dict[str, set[int | None]] = {name: set() for name in self.candidates}
        for step, way in enumerate(self._tried()):
            if step > _MOST_STEPS:
                return None
            if way is not None:
                for name, place in self._in_order(way).items():
                    found[name].add(place)
        return found

    def _tried(self) -> Iterator[Way | None]:
        """The possible ways; in between `None` for each step of the search."""
        names = list(self.candidates)
        pending: list[dict[str, int | None]] = [{}]
        while pending:
            way = pending.pop()
            yield None
            if len(way) == len(names):
                if set(self.counted) <= set(way.values()) and self.fits(way):
                    yield way
                continue
            name, taken = names[len(way)], set(way.values())
            pending += [{**way, name: i} for i in self.candidates[name] if i not in taken]
            if name in self.unseen:
                pending.append({**way, name: None})

    def _in_order(self, way: Way) -> Way:
        groups: dict[Hashable, list[str]] = {}
        for name in way:
            groups.setdefault(self.alike[name], []).append(name)
        ordered: dict[str, int | None] = {}
        for names in groups.values():
            places = sorted((way[name] for name in names), key=lambda i: (i is None, i))
            ordered |= dict(zip(names, places, strict=True))
        return ordered
