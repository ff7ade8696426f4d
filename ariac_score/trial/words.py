"""What people call the items of each level, in the words of their competition."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ariac_score.trial.frozen import FrozenMap

__all__ = ["HANDED_IN", "Words", "spelled"]

HANDED_IN = "submission"
"""The word for what is handed in; where a competition has neither the level nor a word, nothing is."""

_TRIAL = "trial"
_COLOR = re.compile(r"\b([Cc])olor(s?)\b")


def spelled(words: str) -> str:
    """Words made of names, spelled as our texts are: names say `color`, as the messages of robots do.

    >>> spelled("one wrong color"), spelled("part Colors")
    ('one wrong colour', 'part Colours')
    """
    return _COLOR.sub(r"\1olour\2", words)


@dataclass(frozen=True)
class Words:
    """The words of a competition; where it gives none, the names of levels, or else `item`.

    Attributes:
        spoken: What people call the items of a level, one and many.
        levels: The levels of work there are, from the innermost outwards.

    >>> words = Words({"route": ("route", "routes")}, ("leg", "route", "trial"))
    >>> words.many("route"), words.many("leg"), words.outermost, words.hands_in
    ('routes', 'legs', 'route', False)
    >>> Words().many(Words().outermost)
    'items'
    """

    spoken: Mapping[str, Sequence[str]] = field(default_factory=lambda: FrozenMap({}))
    levels: tuple[str, ...] = ()

    def one(self, level: str) -> str:
        """One item of a level."""
        return self.spoken[level][0] if level in self.spoken else level.replace("_", " ") or "item"

    def many(self, level: str) -> str:
        """Several items of a level."""
        return self.spoken[level][1] if level in self.spoken else f"{self.one(level)}s"

    @property
    def of_work(self) -> tuple[str, ...]:
        """The levels of work inside a trial, from the innermost outwards."""
        return tuple(level for level in self.levels if level != _TRIAL)

    @property
    def outermost(self) -> str:
        """The level of what a trial consists of; empty where none is known."""
        return self.of_work[-1] if self.of_work else ""

    @property
    def hands_in(self) -> bool:
        """Whether anything is handed in, and so announced before."""
        return HANDED_IN in self.spoken or HANDED_IN in self.levels

    @property
    def period(self) -> str:
        """What begins and ends: the competition, or a trial where it is called by another word."""
        word = self.one(_TRIAL)
        return "competition" if word == _TRIAL else word

    def none_announced(self, level: str = "") -> str:
        """That there was nothing of a level, by default of the outermost."""
        word = self.one(level or self.outermost)
        return f"no {word} was announced" if self.hands_in else f"there was no {word}"
