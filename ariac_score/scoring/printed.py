"""What an official text prints: which formula of ours each item is, and how the items must add up."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ariac_score.errors import FormulaError, did_you_mean
from ariac_score.scoring.expression import Expression, Number, Traced, add_up
from ariac_score.scoring.levels import TRIAL

__all__ = [
    "FACTS_OF_TEXT",
    "RELATIONS",
    "PrintedBlock",
    "PrintedItem",
    "PrintedSum",
    "PrintedText",
    "number_of",
]

RELATIONS: Mapping[str, str] = {"equal": "is", "at_most": "is at most", "at_least": "is at least"}
"""How a printed number may relate to what the others make of it."""

FACTS_OF_TEXT = frozenset(
    {
        "final_score",
        "summary_score",
        "summary_max_score",
        "summary_submitted",
        "summary_priority",
        "summary_duration_s",
    }
)
"""Labels of what readers take out of a text's heading and summary, besides the items printed in detail."""

_TRUTH = {"true": 1, "yes": 1, "false": 0, "no": 0}
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_AGGREGATES: Mapping[str, Callable[[list[Number]], Number]] = {
    "sum": add_up,
    "min": min,
    "max": max,
    "any": lambda values: int(any(values)),
    "all": lambda values: int(all(values)),
    "count": lambda values: sum(1 for value in values if value),
}


@dataclass(frozen=True)
class PrintedItem:
    """One item of an official text.

    Attributes:
        name: What formulas over printed numbers call it.
        level: One of the rule set's levels.
        labels: As readers spell it; the first one that is printed counts.
        formula: What it is in our terms; `None` when we have no counterpart.
        kind: The kind of task it holds for; empty for every kind.
        within: Largest difference that still agrees; `None`: half of the last printed digit.
        because: Why that tolerance, or why there is no counterpart.
    """

    name: str
    level: str
    labels: tuple[str, ...]
    formula: Expression | None = None
    kind: str = ""
    within: float | None = None
    because: str = ""


@dataclass(frozen=True)
class PrintedSum:
    """What one printed number must be by the others.

    Attributes:
        name: Of the item.
        level: One of the rule set's levels.
        formula: Over printed items of its level and aggregates of those inside.
        kind: The kind of task it holds for; empty for every kind.
        relation: One of `RELATIONS`.
        because: Which source requires it.
    """

    name: str
    level: str
    formula: Expression
    kind: str = ""
    relation: str = "equal"
    because: str = ""


@dataclass(frozen=True)
class PrintedBlock:
    """One part of an official text: the trial, or a piece of work.

    Attributes:
        level: One of the rule set's levels.
        path: Path of its scope; empty for the trial.
        values: As printed, by label.
        kind: Of its task; empty when not printed.
        inner: The blocks directly inside.
    """

    level: str
    path: str
    values: Mapping[str, str]
    kind: str = ""
    inner: tuple[PrintedBlock, ...] = ()

    def walk(self) -> Iterator[PrintedBlock]:
        """This block and all inside, in the order of the text."""
        yield self
        for block in self.inner:
            yield from block.walk()

    def each(self, level: str) -> Iterator[PrintedBlock]:
        """The blocks of a level inside this one."""
        return (block for block in self.walk() if block is not self and block.level == level)


@dataclass(frozen=True)
class PrintedText:
    """Everything a rule set says about the official text of its competition.

    Attributes:
        layouts: The layouts, as readers name them, that belong to the rule set.
        items: What is printed, in the order of the file.
        sums: What must add up.
        levels: The levels of the rule set.
    """

    layouts: tuple[str, ...] = ()
    items: tuple[PrintedItem, ...] = ()
    sums: tuple[PrintedSum, ...] = ()
    levels: tuple[str, ...] = (TRIAL,)

    def __post_init__(self) -> None:
        for one in self.sums:
            self._validate(one)

    def item(self, block: PrintedBlock, label: str) -> PrintedItem | None:
        """The item a label of a block is; `None` when the rule set does not know it."""
        return next((i for i in self._of(block) if label in i.labels), None)

    def items_of(self, block: PrintedBlock) -> Iterator[tuple[PrintedItem, str]]:
        """The items printed in a block, each with its label, in the order of the text."""
        for label in block.values:
            item = self.item(block, label)
            if item is not None:
                yield item, label

    def printed(self, block: PrintedBlock, name: str) -> tuple[str, str]:
        """Label and value of a named item in a block; empty when it is not printed there."""
        for item in self._of(block):
            for label in item.labels if item.name == name else ():
                if label in block.values:
                    return label, block.values[label]
        return "", ""

    def sums_of(self, block: PrintedBlock) -> Iterator[PrintedSum]:
        """What must add up in a block: for each printed item the first sum whose numbers are there."""
        settled: set[str] = set()
        for one in self.sums:
            fits = one.level == block.level and one.kind in ("", block.kind)
            if fits and one.name not in settled and self._is_printed(block, one):
                settled.add(one.name)
                yield one

    def expected(self, block: PrintedBlock, one: PrintedSum) -> Number:
        """What the other printed numbers make of an item.

        Raises:
            FormulaError: They make nothing of it, such as a division by zero.
        """
        return one.formula.evaluate(_PrintedNumbers(self, block)).value

    def rests_on(self, block: PrintedBlock, one: PrintedSum) -> Iterator[tuple[str, str, str]]:
        """Path, label and text of every printed number that a sum is made of, in the order of the formula."""
        seen = set()
        for dotted in _names(one.formula, self.levels):
            level, _, name = dotted.rpartition(".")
            for inner in block.each(level) if level else [block]:
                line = (inner.path, *self.printed(inner, name))
                if line not in seen:
                    seen.add(line)
                    yield line

    def knows(self, block: PrintedBlock) -> bool:
        """Whether every label of a text is an item here."""
        return not any(self.unknown(inner) for inner in block.walk())

    def unknown(self, block: PrintedBlock) -> tuple[str, ...]:
        """The labels of a block that are no item here."""
        return tuple(
            label for label in block.values if label not in FACTS_OF_TEXT and not self.item(block, label)
        )

    def _of(self, block: PrintedBlock) -> Iterator[PrintedItem]:
        return (i for i in self.items if i.level == block.level and i.kind in ("", block.kind))

    def _is_printed(self, block: PrintedBlock, one: PrintedSum) -> bool:
        here = [(block, one.name)]
        for dotted in _names(one.formula, self.levels):
            level, _, name = dotted.rpartition(".")
            here += [(inner, name) for inner in block.each(level)] if level else [(block, name)]
        return all(number_of(self.printed(at, name)[1]) is not None for at, name in here)

    def _validate(self, one: PrintedSum) -> None:
        depth = self.levels.index
        for dotted in (one.name, *_names(one.formula, self.levels)):
            level, _, name = dotted.rpartition(".")
            known = {i.name for i in self.items if i.level == (level or one.level)}
            inside = not level or (level in self.levels and depth(level) < depth(one.level))
            if not inside or name not in known:
                raise FormulaError(
                    f"{dotted!r} is no printed item of {'a' if inside else 'anything inside a'} {one.level}",
                    place=one.formula.where,
                    hint=did_you_mean(name, known, what="printed items"),
                )


def number_of(text: str) -> Number | None:
    """A printed value as a number, yes and true as 1; `None` for words.

    >>> number_of("12"), number_of("14.852"), number_of("yes"), number_of("N/A")
    (12, 14.852, 1, None)
    """
    word = text.strip().lower()
    if word in _TRUTH:
        return _TRUTH[word]
    if not _NUMBER.fullmatch(word):
        return None
    # 15 digits stay below 2**53; formulas refuse a larger integer.
    return int(word) if re.fullmatch(r"-?\d{1,15}", word) else float(word)


def _names(formula: Expression, levels: Sequence[str]) -> Iterator[str]:
    """The names of a formula over printed numbers; `count(task)` names none."""
    calls = [node for node in formula.walk() if isinstance(node, ast.Call)]
    skipped = {id(call.func) for call in calls}
    skipped |= {
        id(argument)
        for call in calls
        for argument in call.args
        if isinstance(argument, ast.Name) and argument.id in levels
    }
    skipped |= {id(node.value) for node in formula.walk() if isinstance(node, ast.Attribute)}
    for node in formula.walk():
        if isinstance(node, ast.Name | ast.Attribute) and id(node) not in skipped:
            yield ast.unparse(node)


class _PrintedNumbers:
    """What names and aggregates mean within one block of a text."""

    def __init__(self, text: PrintedText, block: PrintedBlock) -> None:
        self.text, self.block = text, block

    def name(self, dotted: str) -> Traced:
        level, _, name = dotted.rpartition(".")
        if level not in ("", self.block.level):
            raise FormulaError(
                f"{dotted!r} speaks of each {level}, so it needs an aggregate",
                hint=f"say sum({dotted}), any({dotted}), …",
            )
        value = number_of(self.text.printed(self.block, name)[1])
        if value is None:
            raise FormulaError(f"{name!r} is not printed as a number")
        return Traced(dotted, value, "fact", subject=self.block.path)

    def call(
        self, function: str, arguments: Sequence[Expression], options: Mapping[str, Number]
    ) -> Traced | None:
        if function not in _AGGREGATES or len(arguments) != 1 or options:
            return None
        (argument,) = arguments
        if function == "count" and argument.as_name in self.text.levels:
            return Traced(f"count({argument.source})", len(list(self.block.each(argument.as_name))), "fact")
        level = next(
            (dotted.rpartition(".")[0] for dotted in _names(argument, self.text.levels) if "." in dotted), ""
        )
        if not level:
            return None
        each = [argument.evaluate(_PrintedNumbers(self.text, b)) for b in self.block.each(level)]
        if function in ("min", "max") and not each:
            raise FormulaError(f"no {level} is printed for {function}({argument.source})")
        value = _AGGREGATES[function]([traced.value for traced in each])
        return Traced(f"{function}({argument.source})", value, "each", function, tuple(each))
