"""What a rulebook consists of, whichever way it is printed. Text between `…` is as it stands in a file."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from ariac_score.trial.words import spelled

__all__ = [
    "Block",
    "Bullets",
    "Curve",
    "Grid",
    "Rulebook",
    "Section",
    "Text",
    "code",
    "figure",
    "in_words",
    "with_unit",
]

Number = int | float


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    items: tuple[str, ...]


@dataclass(frozen=True)
class Grid:
    """A table.

    Attributes:
        caption: What it shows.
        head: The name of each column.
        rows: Of one cell for each column.
        numbers: The columns that hold numbers, by their place.
    """

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numbers: frozenset[int] = frozenset()


@dataclass(frozen=True)
class Curve:
    """A score against how long, or how often, something happens.

    Attributes:
        title: What happens.
        what: What is counted from left to right, such as `seconds`.
        x: How much of it.
        score: The score at each.
        steps: Whether nothing lies between two of them.
    """

    title: str
    what: str
    x: tuple[float, ...]
    score: tuple[float, ...]
    steps: bool = False


Block = Text | Bullets | Grid | Curve


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    title: str
    blocks: tuple[Block, ...] = ()


@dataclass(frozen=True)
class Rulebook:
    """Everything that is printed.

    Attributes:
        id: Of the rule set.
        title: Its title.
        source: Where the rules come from.
        sha256: Of the rule set.
        sections: In their order.
    """

    id: str
    title: str
    source: str
    sha256: str
    sections: tuple[Section, ...] = field(default_factory=tuple)


_UNIT_AT_END = re.compile(r"_(m_s3|m_s2|m_s|s|m|rad|dollars|m2|n|pa|1)$")


def in_words(name: str) -> str:
    """A name of a rule set as words.

    >>> in_words("points.right_type"), in_words("least_cost_dollars"), in_words("time_taken_s")
    ('right type', 'least cost', 'time taken')
    """
    return spelled(_UNIT_AT_END.sub("", name.rpartition(".")[2]).replace("_", " "))


def code(text: object) -> str:
    """Text as it stands in a file."""
    return f"`{str(text).replace('`', chr(39))}`"


def figure(value: Number, digits: int = 6) -> str:
    """A number with so many digits, without zeros at the end.

    >>> figure(12.0), figure(0.40000000001), figure(18995.83, 4)
    ('12', '0.4', '18996')
    """
    # Whole points are shown whole, however few digits are wanted: no exponents.
    text = f"{value:.{digits}g}" if abs(value) < 10 ** (digits - 1) else f"{value:.0f}"
    return text.replace("-", "\N{MINUS SIGN}") if float(text) else "0"


def with_unit(value: Number, unit: str) -> str:
    """A number and its unit; one of something is not several.

    >>> with_unit(1, "points"), with_unit(0.03, "m"), with_unit(3, "1")
    ('1 point', '0.03 m', '3')
    """
    if unit in ("", "1"):
        return figure(value)
    return f"{figure(value)} {unit[:-1] if value == 1 and len(unit) > 3 and unit.endswith('s') else unit}"
