"""The scopes a score sheet prices: parts within submissions within orders within the trial."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated

from msgspec import Meta

from ariac_score.checks.findings import FrozenMap

__all__ = ["LEVELS", "Level", "Scope", "is_inside"]

LEVELS = ("part", "submission", "order", "trial")
"""From the innermost outwards, which is the order of evaluation."""
Level = Annotated[str, Meta(pattern=f"^({'|'.join(LEVELS)})$")]


def is_inside(subject: str, path: str) -> bool:
    """Whether a subject is what a path names, or lies inside it; everything lies in the empty path.

    >>> is_inside("order_1/task_0", "order_1"), is_inside("order_10", "order_1")
    (True, False)
    """
    return not path or subject == path or subject.startswith(f"{path}/")


@dataclass(frozen=True)
class Scope:
    """One order, one submission of it, one wanted part, or the whole trial.

    There is a submission for every task of an order, handed in or not, so that what was
    never delivered is priced like what was delivered wrong.

    Attributes:
        level: One of `LEVELS`.
        path: `order/task/slot`, cut at the level; empty for the trial.
        facts: Numbers and texts known about it, such as `priority` or `time_s`.
        inner: The scopes directly inside.
    """

    level: Level
    path: str
    facts: Mapping[str, int | float | str | None] = field(default_factory=lambda: FrozenMap({}))
    inner: tuple[Scope, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "facts", FrozenMap(dict(self.facts)))

    def contains(self, subject: str) -> bool:
        """Whether a finding's subject lies in this scope."""
        return is_inside(subject, self.path)

    def each(self, level: str) -> Iterator[Scope]:
        """The scopes of a level inside this one, in order."""
        for scope in self.inner:
            if scope.level == level:
                yield scope
            else:
                yield from scope.each(level)
