"""A specification as it is written: one class for each form of the grammar.

Chains of one operator are kept as one node with all their parts, so that a sequence
of a thousand events is not a thousand levels deep.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

__all__ = [
    "All",
    "Anything",
    "Arg",
    "Chain",
    "Const",
    "Data",
    "Declaration",
    "Empty",
    "Equation",
    "Event",
    "EventType",
    "Exp",
    "Filter",
    "If",
    "Let",
    "ListPattern",
    "Literal_",
    "Name",
    "Num",
    "Op",
    "OrPattern",
    "Pattern",
    "Place",
    "Post",
    "RecordPattern",
    "Ref",
    "Spec",
    "Var",
]


@dataclass(frozen=True, order=True)
class Place:
    """Line and column of a token, from 1."""

    line: int
    column: int


_NOWHERE = Place(0, 0)


# Data expressions ------------------------------------------------------------------------


@dataclass(frozen=True)
class Num:
    """A number; `text` is how it was written."""

    value: int | float
    text: str = field(default="", compare=False)


@dataclass(frozen=True)
class Const:
    """`true`, `false` or `null`."""

    value: bool | None


@dataclass(frozen=True)
class Var:
    """A name that stands for a value."""

    name: str
    place: Place = field(default=_NOWHERE, compare=False)


@dataclass(frozen=True)
class Op:
    """An operator or function with its operands; one operand of `-` is the sign.

    `grouped`: it was written in parentheses.
    """

    op: str
    args: tuple[Data, ...]
    place: Place = field(default=_NOWHERE, compare=False)
    grouped: bool = field(default=False, compare=False)


Data: TypeAlias = Num | Const | Var | Op


# Patterns --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Anything:
    """`_`."""


@dataclass(frozen=True)
class Name:
    """A name in a pattern."""

    name: str


@dataclass(frozen=True)
class Literal_:  # noqa: N801  # `Literal` is a name of typing
    """A string, number or constant in a pattern; `text` is how a number was written."""

    value: str | int | float | bool | None
    text: str = field(default="", compare=False)

    def __eq__(self, other: object) -> bool:
        # 1, 1.0 and true are three different literals.
        return (
            isinstance(other, Literal_)
            and type(other.value) is type(self.value)
            and repr(other.value) == repr(self.value)
        )

    def __hash__(self) -> int:
        return hash(repr(self.value))


@dataclass(frozen=True)
class RecordPattern:
    """`{key: pattern, …}`, in the order written."""

    fields: tuple[tuple[str, Pattern], ...]


@dataclass(frozen=True)
class ListPattern:
    """`[p, …]`; `rest`: `...` ends it."""

    items: tuple[Pattern, ...]
    rest: bool


@dataclass(frozen=True)
class OrPattern:
    """`p | q`."""

    options: tuple[Pattern, ...]


Pattern: TypeAlias = Anything | Name | Literal_ | RecordPattern | ListPattern | OrPattern
Arg: TypeAlias = Data | Pattern


# Trace expressions -----------------------------------------------------------------------


@dataclass(frozen=True)
class EventType:
    """An event type with its arguments."""

    name: str
    args: tuple[Arg, ...] = ()
    place: Place = field(default=_NOWHERE, compare=False)


@dataclass(frozen=True)
class Empty:
    """`empty`."""


@dataclass(frozen=True)
class All:
    """`all`."""


@dataclass(frozen=True)
class Event:
    """One event of a type."""

    type: EventType


@dataclass(frozen=True)
class Ref:
    """An equation by its name; `args` is `None` where none are written."""

    name: str
    args: tuple[Data, ...] | None = None
    place: Place = field(default=_NOWHERE, compare=False)


@dataclass(frozen=True)
class Chain:
    """Two or more parts joined by one operator: `cat`, `and`, `or` or `shuffle`."""

    op: Literal["cat", "and", "or", "shuffle"]
    parts: tuple[Exp, ...]


@dataclass(frozen=True)
class Post:
    """A postfix operator: `star`, `plus`, `opt`, `closure` or `times`."""

    op: Literal["star", "plus", "opt", "closure", "times"]
    body: Exp
    count: int = 0


@dataclass(frozen=True)
class Let:
    """`{let x, …; exp}`."""

    names: tuple[str, ...]
    body: Exp


@dataclass(frozen=True)
class If:
    """`if (condition) then else other`."""

    condition: Data
    then: Exp
    other: Exp


@dataclass(frozen=True)
class Filter:
    """`type >> inside : outside`; `outside` is `None` where none is written."""

    type: EventType
    inside: Exp
    outside: Exp | None


Exp: TypeAlias = Empty | All | Event | Ref | Chain | Post | Let | If | Filter


# Whole texts -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Declaration:
    """`type [not] matches … [with guard];`: either `parents` (derived) or `pattern` (direct)."""

    type: EventType
    negated: bool
    parents: tuple[EventType, ...]
    pattern: Pattern | None
    guard: Data | None
    comments: tuple[str, ...] = field(default=(), compare=False)
    note: str = field(default="", compare=False)


@dataclass(frozen=True)
class Equation:
    """`Name<params> = exp;`."""

    name: str
    params: tuple[str, ...]
    body: Exp
    place: Place = field(default=_NOWHERE, compare=False)
    comments: tuple[str, ...] = field(default=(), compare=False)
    note: str = field(default="", compare=False)


@dataclass(frozen=True)
class Spec:
    """A whole specification; comments stand with the statement they precede, `note` ends its line."""

    declarations: tuple[Declaration, ...]
    equations: tuple[Equation, ...]
    comments_at_end: tuple[str, ...] = field(default=(), compare=False)
