"""The words of the competition that a stored result is about."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress

from ariac_score.errors import ScoreError
from ariac_score.results.result import Result
from ariac_score.scoring.ledger import Line
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.trial.words import Words, spelled

__all__ = ["capital", "label_of", "priced_check", "which_run", "words_of"]


def words_of(result: Result) -> Words:
    """The words that its competition gave; where it gave none, the names of the levels of its rules."""
    levels: tuple[str, ...] = ()
    with suppress(ScoreError):  # words are no reason to refuse a result whose rules nobody can read any more
        levels = rule_set_from_text(result.rules, file="the rules in the result").sheet.levels
    sketch = result.measured.sketch
    spoken = {named.level: (named.one, named.many) for named in sketch.levels} if sketch else {}
    return Words(spoken, levels)


def capital(words: str) -> str:
    """With a capital letter at the start."""
    return words[:1].upper() + words[1:]


def which_run(number: int, numbers: Sequence[int]) -> str:
    """Which of the runs of a team in a trial one is.

    Args:
        number: Of the run.
        numbers: Of all of them.

    >>> which_run(2, [1, 2, 3]), which_run(7, [2, 7])
    ('run 2 of 3', 'run 7, one of 2')
    """
    counted = sorted(numbers) == list(range(1, len(numbers) + 1))
    return f"run {number} of {len(numbers)}" if counted else f"run {number}, one of {len(numbers)}"


_SUMS = {"earned": "points earned", "taken": "points lost"}


def label_of(line: Line) -> str:
    """The label of a line of a ledger; of its two great sums in words that say what they are sums of."""
    is_sum = line.path.count("/") == 1 and line.path.endswith(f"/{line.label}")
    return _SUMS.get(line.label, line.label) if is_sum else _named(line)


_PRICED = re.compile(r"(?:[\w.]+ \* )?(?:points|holds)\((\w+)\)(?: \* [\w.]+)?")


def priced_check(label: str) -> str:
    """The check that a formula prices, in words, where it says no more than that; else the label as it is.

    >>> priced_check("right_part * points(right_color)"), priced_check("points(pose) - 1")
    ('right colour', 'points(pose) - 1')
    """
    priced = _PRICED.fullmatch(label)
    return spelled(priced[1].replace("_", " ")) if priced else label


def _named(line: Line) -> str:
    # A label that is a name stands in a sentence; any other is a text or a formula, and stays as it is.
    return spelled(line.label) if line.label.isidentifier() else line.label
