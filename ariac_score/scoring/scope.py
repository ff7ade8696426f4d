"""The scopes a score sheet prices: the trial, and the work inside it, as deep as a competition has levels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

from msgspec import Meta

from ariac_score.checks.findings import FrozenMap

__all__ = ["Level", "Scope", "is_inside", "lasting"]

Level = Annotated[str, Meta(pattern="^[a-z][a-z0-9_]*$")]
"""The name of a level; a score sheet has them from the innermost outwards, the order of evaluation."""


def is_inside(subject: str, path: str) -> bool:
    """Whether a subject is what a path names, or lies inside it; everything lies in the empty path.

    >>> is_inside("task_1/bolt_0", "task_1"), is_inside("task_10", "task_1")
    (True, False)
    """
    return not path or subject == path or subject.startswith(f"{path}/")


@dataclass(frozen=True)
class Scope:
    """One piece of work, or the whole trial.

    There is a scope for everything that was to be done, done or not, so that what was never
    handed in is priced like what was done wrong.

    Attributes:
        level: Such as `task`; `trial` for the whole.
        path: The ids of the items from the outermost to this one, such as `task_1/bolt_0`; empty
            for the trial.
        facts: Numbers and texts known about it, such as `time_s`; `None`: known to be absent.
        inner: The scopes directly inside.
    """

    level: Level
    path: str
    facts: Mapping[str, int | float | str | None] = field(default_factory=lambda: FrozenMap({}))
    inner: tuple[Scope, ...] = ()

    def __post_init__(self) -> None:
        # As numbers: JSON would keep `true`, which no formula knows.
        facts = {k: int(v) if isinstance(v, bool) else v for k, v in self.facts.items()}
        object.__setattr__(self, "facts", FrozenMap(facts))

    def contains(self, subject: str) -> bool:
        """Whether a finding's subject lies in this scope."""
        return is_inside(subject, self.path)

    def walk(self) -> Iterator[Scope]:
        """This scope and all inside, from the outside in."""
        yield self
        for inner in self.inner:
            yield from inner.walk()

    def each(self, level: str) -> Iterator[Scope]:
        """The scopes of a level inside this one, in order."""
        for scope in self.inner:
            if scope.level == level:
                yield scope
            else:
                yield from scope.each(level)


def lasting(trial: Scope, duration_s: float) -> Scope:
    """The same trial, had its competition lasted so long.

    >>> lasting(Scope("trial", "", {"duration_s": 58.0}), 60.0).facts["duration_s"]
    60.0
    """
    return replace(trial, facts={**trial.facts, "duration_s": duration_s})
