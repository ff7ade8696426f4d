"""Forms that a rulebook has, as the formulas they stand for: tables, and a block for each kind of task.

A table becomes `worth if holds(a) and violated(b) else …`, a term of several blocks `one if kitting else
other`: formulas like any other, so that pricing and ledger know nothing of either.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise, product
from typing import Any

from ariac_score.documents.yaml import Place, YamlDocument
from ariac_score.errors import RuleSetError, did_you_mean

__all__ = ["OTHERWISE", "Row", "Table", "in_formulas", "is_block", "merged_terms", "place_in", "tables_of"]

OTHERWISE = "otherwise"
_WORTH = "worth"
_QUOTED = re.compile("'([^']*)'")
_MOST_CHECKS = 12
"""Checks in one table: every combination of their verdicts is tried."""

Verdicts = Mapping[str, str]


@dataclass(frozen=True)
class Row:
    """One row of a table.

    Attributes:
        name: In words.
        when: What the checks must say, in one of several ways; empty for the row of everything else.
        worth: A formula for each column.
    """

    name: str
    when: tuple[Verdicts, ...]
    worth: Mapping[str, str]

    def applies(self, verdicts: Verdicts) -> bool:
        """Whether it applies, of the rows that say when."""
        return any(all(verdicts[check] == said for check, said in one.items()) for one in self.when)

    @property
    def condition(self) -> str:
        """When it applies, as a formula."""
        ways = [" and ".join(f"{said}({check})" for check, said in one.items()) for one in self.when]
        return ways[0] if len(ways) == 1 else " or ".join(f"({way})" for way in ways)


@dataclass(frozen=True)
class Table:
    """Rows of which exactly one applies, and what each is worth.

    Attributes:
        level: Of its terms.
        name: As in the file.
        columns: The terms that it gives.
        rows: From top to bottom.
    """

    level: str
    name: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]

    @property
    def checks(self) -> list[str]:
        """The checks whose verdicts decide."""
        return list(dict.fromkeys(check for row in self.rows for one in row.when for check in one))

    def formulas(self) -> dict[str, str]:
        """Each column as the formula it stands for."""
        return {column: self._formula(column) for column in self.columns}

    def _formula(self, column: str) -> str:
        # One row applies, so the last needs no question; that of everything else comes last.
        *first, last = sorted(self.rows, key=lambda row: not row.when)
        formula = f"({last.worth[column]})"
        for row in reversed(first):
            formula = f"({row.worth[column]}) if {row.condition} else {formula}"
        return formula

    def problem(self) -> tuple[str, str]:
        """Why not exactly one row applies, whatever the checks say, and the remedy; empty when one does."""
        if len(self.checks) > _MOST_CHECKS:
            return (
                f"the table looks at {len(self.checks)} checks, more than {_MOST_CHECKS}",
                "make two tables of it",
            )
        rest = sum(not row.when for row in self.rows)
        if rest > 1:
            return f"{rest} rows say 'when: {OTHERWISE}'", "one row takes what no other does"
        for said in product(("holds", "violated"), repeat=len(self.checks)):
            verdicts = dict(zip(self.checks, said, strict=True))
            names = [row.name for row in self.rows if row.applies(verdicts)]
            where = ", ".join(f"{check}: {word}" for check, word in verdicts.items())
            if len(names) > 1:
                return (
                    f"rows {names[0]!r} and {names[1]!r} both apply to {{{where}}}",
                    "say more under 'when:'",
                )
            if not names and not rest:
                return f"no row applies to {{{where}}}", f"add a row, or one with 'when: {OTHERWISE}'"
        return "", ""


def is_block(body: Any) -> bool:
    """Whether what stands under a level is a block of terms for one kind of task."""
    return isinstance(body, Mapping) and "table" not in body


def tables_of(data: Mapping[str, Any]) -> list[Table]:
    """The tables of a rule set, those inside blocks left out."""
    return [
        _table(level, name, body)
        for level, terms in data.get("terms", {}).items()
        for name, body in terms.items()
        if isinstance(body, Mapping) and "table" in body
    ]


def _table(level: str, name: str, body: Mapping[str, Any]) -> Table:
    columns = tuple(body.get("columns", ()))
    return Table(level, name, columns or (name,), tuple(_row(row, name, columns) for row in body["table"]))


def _row(row: Mapping[str, Any], term: str, columns: tuple[str, ...]) -> Row:
    when = row["when"]
    ways = [] if when == OTHERWISE else when if isinstance(when, list) else [when]
    worth = {column: str(row[column]) for column in columns} if columns else {term: str(row[_WORTH])}
    return Row(row["row"], tuple(ways), worth)


def merged_terms(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """The terms of a level with those that an extension changes, or takes away with `null`.

    A block changes term by term.
    """
    changed = {
        name: {**base[name], **body} if is_block(body) and is_block(base.get(name)) else body
        for name, body in own.items()
    }
    gone = {name for name, body in own.items() if body is None and name in base}
    return {name: body for name, body in {**base, **changed}.items() if name not in gone}


def in_formulas(document: YamlDocument) -> YamlDocument:
    """A rule set whose tables and blocks are written as formulas.

    Raises:
        RuleSetError: Rows overlap or leave a case out, or blocks do not fit each other.
    """
    data, lines = document.data, dict(document.lines)
    kinds = data.get("kinds", {})
    _refuse_kinds(document, kinds)
    terms: dict[str, dict[str, Any]] = {}
    for level, stated in data.get("terms", {}).items():
        blocks = {name: body for name, body in stated.items() if is_block(body)}
        if nothing := [name for name, body in stated.items() if body is None]:
            raise RuleSetError(
                f"there is no term {nothing[0]!r} to take away",
                file=document.file,
                place=document.place(["terms", level, nothing[0]]),
                hint="only a rule set that 'extends' another one with that term can",
            )
        terms[level] = {}
        for name, body in stated.items():
            if name not in blocks:
                _add(terms[level], document, lines, (level, name), _formulas(document, (level, name), body))
            elif name == next(iter(blocks)):
                _add(terms[level], document, lines, (level, name), _chosen(document, level, blocks, kinds))
    return replace(document, data={**data, "terms": terms}, lines=lines)


def place_in(data: Mapping[str, Any], path: Sequence[str], cause: str) -> list[str]:
    """Where a formula stands as written: in which block, if one of them has what the cause quotes."""
    quoted = _QUOTED.search(cause)
    if len(path) == 3 and path[0] == "terms" and quoted:
        for kind, block in data.get("terms", {}).get(path[1], {}).items():
            if is_block(block) and quoted[1] in str(block.get(path[2], "")):
                return ["terms", path[1], kind, path[2]]
    return list(path)


def _add(
    terms: dict[str, Any],
    document: YamlDocument,
    lines: dict[Place, int],
    path: tuple[str, ...],
    found: Mapping[str, Any],
) -> None:
    """Add terms that stand at one place of the file, which errors in their formulas then name."""
    for term, formula in found.items():
        if term in terms:
            raise RuleSetError(
                f"term {term!r} is given twice, by itself and by a column or a block",
                file=document.file,
                place=document.place(["terms", *path]),
                hint="each name must be one thing",
            )
        terms[term] = formula
        at = document.lines.get(("terms", *path, term), document.lines.get(("terms", *path)))
        if at is not None:
            lines.setdefault(("terms", path[0], term), at)


def _formulas(document: YamlDocument, path: tuple[str, ...], body: Any) -> dict[str, Any]:
    """A term as it is written, or each column of its table as a formula, by name."""
    if not isinstance(body, Mapping):
        return {path[-1]: body}
    place = ["terms", *path, "table"]
    columns = body.get("columns", [_WORTH])
    for number, row in enumerate(body["table"]):
        odd = sorted((set(row) - {"row", "when"}).symmetric_difference(columns))
        if odd:
            raise RuleSetError(
                f"the row {row['row']!r} has no {odd[0]!r}"
                if odd[0] in columns
                else f"{odd[0]!r} is no column of the table",
                file=document.file,
                place=document.place([*place, number]),
                hint=f"its columns: {', '.join(columns)}",
            )
    table = _table(path[0], path[-1], body)
    cause, hint = table.problem()
    if cause:
        raise RuleSetError(cause, file=document.file, place=document.place(place), hint=hint)
    return table.formulas()


def _refuse_kinds(document: YamlDocument, kinds: Mapping[str, str]) -> None:
    last = [*kinds][-1:]
    if [kind for kind, when in kinds.items() if when == OTHERWISE] != last:
        raise RuleSetError(
            f"the last kind, and no other, takes what is left: {', '.join(kinds)}",
            file=document.file,
            place=document.place(["kinds"]),
            hint=f"write '{last[0]}: {OTHERWISE}'",
        )


def _chosen(
    document: YamlDocument, level: str, blocks: Mapping[str, Any], kinds: Mapping[str, str]
) -> dict[str, str]:
    """Each term of the blocks as one formula that asks for the kind."""
    _refuse_other_kinds(document, level, blocks, kinds)
    inside = {
        kind: {
            term: formula
            for name, body in block.items()
            for term, formula in _formulas(document, (level, kind, name), body).items()
        }
        for kind, block in blocks.items()
    }
    *first, last = kinds
    chosen = {}
    for name in _in_order(document, level, inside):
        formula = f"({inside[last][name]})"
        for kind in reversed(first):
            formula = f"({inside[kind][name]}) if {kinds[kind]} else {formula}"
        chosen[name] = formula
    return chosen


def _refuse_other_kinds(
    document: YamlDocument, level: str, blocks: Mapping[str, Any], kinds: Mapping[str, str]
) -> None:
    for kind in dict.fromkeys([*blocks, *kinds]):
        if kind in kinds and kind in blocks:
            continue
        known = kind in kinds
        raise RuleSetError(
            f"the terms of each {level} have no block for the kind {kind!r}"
            if known
            else f"{kind!r} is no kind of task",
            file=document.file,
            place=document.place(["terms", level] if known else ["terms", level, kind]),
            hint=f"add '{kind}:' with its terms"
            if known
            else did_you_mean(kind, kinds, what="kinds") + "; they are declared under 'kinds:'",
        )


def _in_order(document: YamlDocument, level: str, blocks: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """The terms of all blocks, each after those before it in its blocks."""
    before: dict[str, list[str]] = {name: [] for block in blocks.values() for name in block}
    for kind, block in blocks.items():
        for name in before:
            if name not in block:
                raise RuleSetError(
                    f"the block {kind!r} of each {level} has no term {name!r}",
                    file=document.file,
                    place=document.place(["terms", level, kind]),
                    hint="all blocks have the same terms: add it, 0 where it is worth nothing",
                )
        for first, second in pairwise(block):
            before[second].append(first)
    try:
        return list(TopologicalSorter(before).static_order())
    except CycleError as cause:
        raise RuleSetError(
            f"the blocks of each {level} have their terms in different orders: {', '.join(cause.args[1])}",
            file=document.file,
            place=document.place(["terms", level]),
            hint="write terms of the same name in the same order",
        ) from None
