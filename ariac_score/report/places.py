"""Items of work in the words of their competition, instead of the ids on the way to them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cached_property

from ariac_score.report.words import words_of
from ariac_score.results.result import Result
from ariac_score.scoring.scope import Scope
from ariac_score.terminal.style import plain
from ariac_score.trial.words import Words

__all__ = ["Places"]

LONGEST_NAME = 40


class Places:
    """What people call the subjects of a result.

    An id that says nothing but its level and a number, such as `order_0_shipment_0`, becomes
    `shipment 1`, counted from 1 within what it is inside, and `order_0_kitting_shipment_0` becomes
    `kitting shipment 1`; any other id is a name and is kept.
    """

    def __init__(self, result: Result) -> None:
        self._result = result

    @cached_property
    def words(self) -> Words:
        """The words of the competition."""
        return words_of(self._result)

    def knows(self, subject: str) -> bool:
        """Whether a subject is an item of work, or inside one."""
        return any(path in self._items for path in (subject, subject.rpartition("/")[0]))

    def own(self, path: str) -> str:
        """An item without what it is inside, such as `part 2`; any other subject as it is.

        Args:
            path: Of the item.
        """
        return self._items.get(path, (self.of(path),))[-1]

    def of(self, subject: str) -> str:
        """A subject, such as `part 2 of shipment 1, order 1`.

        Args:
            subject: As in a finding: the path of an item, bodies, `trial`, or anything else.
        """
        if subject in ("", "trial"):
            return f"the {self.words.one('trial')}"
        path, rest = subject, ""
        while path and path not in self._items:
            path, _, last = path.rpartition("/")
            rest = f"{last}/{rest}" if rest else last
        if not path:
            return _cut(self._bodies(subject))
        names = [*reversed(self._items[path])]
        names = [_cut(rest), *names] if rest else names
        return names[0] + (f" of {', '.join(names[1:])}" if len(names) > 1 else "")

    def _bodies(self, subject: str) -> str:
        """Two bodies, which a subject names as a pair."""
        first, mark, second = subject.partition("/")
        return f"{first} and {second}" if mark and first and second and "/" not in second else subject

    @cached_property
    def _items(self) -> Mapping[str, tuple[str, ...]]:
        """Each item by its path: its words and those of what it is inside, the outermost first."""
        return dict(self._named(self._result.measured.scopes, ()))

    def _named(self, scope: Scope, inside: tuple[str, ...]) -> Iterator[tuple[str, tuple[str, ...]]]:
        for number, item in enumerate(scope.inner, start=1):
            names = (*inside, self._name(item, scope, number))
            yield item.path, names
            yield from self._named(item, names)

    def _name(self, item: Scope, inside: Scope, number: int) -> str:
        word = self.words.one(item.level)
        name = item.path.rpartition("/")[2]
        own = name.removeprefix(inside.path.rpartition("/")[2]).lstrip("_- ")
        spoken = "|".join(re.escape(one) for one in (item.level, word))
        numbered = rf"(?:([a-z]+)[_\- ])?(?:{spoken})[_\- ]*[0-9]+|(?:{spoken})?[_\- ]*[0-9]*"
        counted = re.fullmatch(numbered, own, re.IGNORECASE)
        if counted is None:
            return f"{word} {_cut(name)}"
        return f"{counted[1]} {word} {number}" if counted[1] else f"{word} {number}"


def _cut(name: str) -> str:
    shown = plain(name)
    return shown if len(shown) <= LONGEST_NAME else f"{shown[: LONGEST_NAME - 1]}\u2026"
