"""What a trial was about: work items within work items, as deep as a competition has levels.

The core knows no competition. It prices an item, names it and its facts, and looks no further; what a
competition keeps of its own about an item stands in a class of the competition's plugin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Protocol, TypeAlias, cast, runtime_checkable

from ariac_score.trial.frozen import FrozenMap

__all__ = [
    "Fact",
    "Item",
    "Record",
    "Submission",
    "WorkItem",
    "all_items",
    "announced_s",
    "at_times",
    "checked_facts",
    "dated_at",
    "items_at",
    "number_of_fact",
    "paths_at",
]

Fact: TypeAlias = "int | float | str | None"
"""A number, a text, or `None`: known to be absent. What is not known has no entry at all."""

Facts: TypeAlias = Mapping[str, Fact]


@runtime_checkable
class WorkItem(Protocol):
    """One thing that was to be done, such as an order, a task or an object to fetch.

    A class may also have `announced_s`: when the item was announced, s of trial time.
    """

    @property
    def id(self) -> str:
        """Its name among the items beside it; no slash, which separates the items of a path."""
        ...

    @property
    def level(self) -> str:
        """What it is, in the words of the competition, such as `order`; a level of the rule set."""
        ...

    @property
    def facts(self) -> Mapping[str, Fact]:
        """What is known about it, by name; a unit stands in the name, as in `time_limit_s`."""
        ...

    @property
    def items(self) -> Sequence[WorkItem]:
        """The items directly inside, in order."""
        ...


@dataclass(frozen=True)
class Item:
    """A work item that needs no more than the core knows.

    Attributes:
        id: Its name among the items beside it.
        level: What it is, such as `object`.
        facts: Numbers, texts, `None` for what is known to be absent.
        items: The items directly inside.
        announced_s: When it was announced, s of trial time; `None` when no log says.

    Raises:
        ValueError: A fact is not finite, or the id is empty or has a slash.

    >>> hole = Item("hole_1", "object", {"kind": "bolt", "time_s": None})
    >>> [item.id for item in Item("run", "task", items=(hole,)).items]
    ['hole_1']
    """

    id: str
    level: str
    facts: Mapping[str, Fact] = field(default_factory=lambda: FrozenMap({}))
    items: tuple[WorkItem, ...] = ()
    announced_s: float | None = None

    def __post_init__(self) -> None:
        if not self.id or "/" in self.id:
            raise ValueError(f"the id of a work item is {self.id!r}; it must be a name without a slash")
        object.__setattr__(self, "facts", FrozenMap(dict(checked_facts(self.facts, self.id))))
        object.__setattr__(self, "items", tuple(self.items))


@dataclass(frozen=True)
class Submission:
    """Something that was handed in; a competition's own class may say what it was.

    Attributes:
        item_id: Id of the work item it answers.
        submitted_s: When, s of trial time.
    """

    item_id: str
    submitted_s: float

    @property
    def detailed(self) -> bool:
        """Whether its record says more than that it was handed in, at a time that matters."""
        return False


class Record:
    """Something that readers of a competition keep for its own checks; the core never looks inside.

    A base class, so that a decoder that makes something else by mistake is found out. Records are
    immutable. One that means nothing without its times says so in `timed`, and can be shifted.
    """

    timed: ClassVar[bool] = False
    """Whether it is worth nothing where the times of its log are not those of the trial."""

    def shifted(self, by_s: float) -> Record:  # noqa: ARG002  # a record with times needs it
        """The same record with every time later by a number of seconds."""
        if self.timed:
            raise NotImplementedError(f"{type(self).__name__} has times, and must say how they are shifted")
        return self


def checked_facts(facts: Facts, of: str) -> Facts:
    """The facts, when all their numbers are finite.

    Raises:
        ValueError: Naming what they are facts of.
    """
    wrong = [name for name, value in facts.items() if isinstance(value, float) and not math.isfinite(value)]
    if wrong:
        raise ValueError(f"the facts of {of!r} must be finite, but {wrong[0]} is {facts[wrong[0]]}")
    return facts


def announced_s(item: WorkItem) -> float | None:
    """When an item was announced, s of trial time; `None` when the log does not say, or it never was."""
    t_s: float | None = getattr(item, "announced_s", None)
    return t_s


def at_times(work: Sequence[WorkItem], at: Callable[[float], float | None]) -> tuple[WorkItem, ...]:
    """The items with other times of announcement.

    Args:
        work: The outermost items; those inside are announced with them.
        at: What a time becomes; `None` where it means nothing any more.
    """
    times = [announced_s(item) for item in work]
    return tuple(
        item if t_s is None else dated_at(item, at(t_s)) for item, t_s in zip(work, times, strict=True)
    )


def dated_at(item: WorkItem, t_s: float | None) -> WorkItem:
    """The item with another time of announcement; as it is where its class keeps none."""
    if not hasattr(item, "announced_s"):
        return item
    return cast(WorkItem, replace(cast(Any, item), announced_s=t_s))


def all_items(work: Sequence[WorkItem]) -> Iterator[WorkItem]:
    """Every item, each before those inside it.

    >>> [item.id for item in all_items((Item("task_1", "task", items=(Item("bolt_1", "object"),)),))]
    ['task_1', 'bolt_1']
    """
    for item in work:
        yield item
        yield from all_items(item.items)


def number_of_fact(facts: Mapping[str, Fact], name: str) -> float | None:
    """A fact that is a number; `None` where it is unknown, absent or a text."""
    value = facts.get(name)
    return value if isinstance(value, (int, float)) else None


def items_at(work: Sequence[WorkItem], level: str) -> Iterator[WorkItem]:
    """The items of a level, outermost first, in order; of no level, the outermost ones.

    >>> work = (Item("task_1", "task", items=(Item("bolt_1", "object"),)),)
    >>> [item.id for item in items_at(work, "object")], [item.id for item in items_at(work, "")]
    (['bolt_1'], ['task_1'])
    """
    return (item for _, item in paths_at(work, level))


def paths_at(work: Sequence[WorkItem], level: str, inside: str = "") -> Iterator[tuple[str, WorkItem]]:
    """The items of a level with their paths, as `items_at` finds them.

    >>> work = (Item("task_1", "task", items=(Item("bolt_1", "object"),)),)
    >>> [path for path, _ in paths_at(work, "object")]
    ['task_1/bolt_1']
    """
    for item in work:
        path = f"{inside}/{item.id}" if inside else item.id
        if not level or item.level == level:
            yield path, item
        else:
            yield from paths_at(item.items, level, path)
