"""Each item of work: what was asked for, what was handed in, what was found, and the points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.results.result import Result
from ariac_score.results.sketch import HandedIn
from ariac_score.scoring.ledger import Ledger, Line, taken_by
from ariac_score.scoring.scope import Scope

__all__ = ["InnerShown", "LeafShown", "WorkShown", "Worth", "grouped", "work_of", "worth_of"]

NamedFinding = tuple[str, Finding]


@dataclass(frozen=True)
class Worth:
    """The points of an item: what it and all inside earned, and what violations there took (not positive)."""

    earned: Decimal = Decimal(0)
    taken: Decimal = Decimal(0)

    @property
    def net(self) -> Decimal:
        """What both come to."""
        return self.earned + self.taken


@dataclass(frozen=True)
class LeafShown:
    """The innermost: its path, what was asked for, the findings about it, its points."""

    path: str
    asked: str
    found: tuple[NamedFinding, ...]
    worth: Worth | None


@dataclass(frozen=True)
class InnerShown:
    """An item inside: what was asked for and handed in, what it consists of, the findings about the whole."""

    path: str
    level: str
    asked: str
    brought: tuple[HandedIn, ...]
    leaves: tuple[LeafShown, ...]
    leaf_level: str
    found: tuple[NamedFinding, ...]
    worth: Worth | None


@dataclass(frozen=True)
class WorkShown:
    """An outermost item: when it was announced, its points, the items inside."""

    name: str
    announced_s: float | None
    worth: Worth | None
    inner: tuple[InnerShown, ...]
    found: tuple[NamedFinding, ...]


def work_of(result: Result) -> tuple[WorkShown, ...]:
    """Every outermost item with what is inside, in the order of the trial."""
    measured = result.measured
    worth = worth_of(result)
    asked = {one.path: one.words for one in measured.sketch.asked} if measured.sketch else {}
    brought = measured.sketch.brought if measured.sketch else ()
    found = _by_subject(measured.findings)
    return tuple(
        WorkShown(
            item.path,
            measured.orders.get(item.path),
            worth.get(item.path),
            tuple(_inner(inner, asked, brought, found, worth) for inner in item.inner),
            tuple(found.get(item.path, ())),
        )
        for item in measured.scopes.inner
    )


_SHOWN = (Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.SATISFIED)


def grouped(found: tuple[NamedFinding, ...]) -> list[tuple[Verdict, str, list[NamedFinding]]]:
    """Findings with the same message together, violations first.

    A satisfied finding without a margin needs no message: that it was kept says all.
    """
    groups: dict[tuple[int, str], list[NamedFinding]] = {}
    for key, finding in found:
        silent = finding.verdict is Verdict.SATISFIED and finding.robustness is None
        words = "" if silent else finding.message
        # Kept with a margin comes before kept without one; all of the latter fit into one last line.
        place = _SHOWN.index(finding.verdict) + silent
        groups.setdefault((place, words), []).append((key, finding))
    return [(alike[0][1].verdict, words, alike) for (_, words), alike in sorted(groups.items(), key=_place)]


def _place(group: tuple[tuple[int, str], list[NamedFinding]]) -> int:
    return group[0][0]


def _inner(
    item: Scope,
    asked: Mapping[str, str],
    brought: tuple[HandedIn, ...],
    found: Mapping[str, list[NamedFinding]],
    worth: Mapping[str, Worth],
) -> InnerShown:
    name = item.path.rpartition("/")[2]
    leaves = tuple(_leaves(item))
    return InnerShown(
        item.path,
        item.level,
        asked.get(item.path, ""),
        tuple(one for one in brought if one.item == name),
        tuple(
            LeafShown(
                leaf.path,
                asked.get(leaf.path, ""),
                tuple(found.get(leaf.path, ())),
                worth.get(leaf.path),
            )
            for leaf in leaves
        ),
        leaves[0].level if leaves else "",
        tuple(found.get(item.path, ())),
        worth.get(item.path),
    )


def _leaves(item: Scope) -> Iterator[Scope]:
    """What an item consists of, however deep its levels go."""
    for inner in item.inner:
        yield from _leaves(inner) if inner.inner else iter((inner,))


def _by_subject(findings: Mapping[str, Finding]) -> dict[str, list[NamedFinding]]:
    found: dict[str, list[NamedFinding]] = {}
    for key, finding in findings.items():
        if finding.verdict is not Verdict.NOT_APPLICABLE:
            found.setdefault(finding.subject, []).append((key, finding))
    return found


def worth_of(result: Result) -> dict[str, Worth]:
    """What each item brought to the ledger."""
    ledger = result.ledger or result.task
    if ledger is None:
        return {}
    if result.is_former:
        return {path: Worth(amount) for path, amount in _before_factors(ledger).items()}
    worth: dict[str, Worth] = {}
    for path, amount in _earned(ledger, frozenset()):
        worth[path] = Worth(worth.get(path, Worth()).earned + amount)
    for line in taken_by(ledger).values():
        names = line.subject.split("/")
        for path in ("/".join(names[: i + 1]) for i in range(len(names))):
            before = worth.get(path, Worth())
            worth[path] = replace(before, taken=before.taken + line.amount)
    return worth


def _earned(line: Line, inside: frozenset[str]) -> Iterator[tuple[str, Decimal]]:
    """The amount of each topmost line of a subject; those below it are part of it."""
    if line.kind in ("taken", "neutral"):
        return
    if line.subject and line.subject not in inside:
        yield line.subject, line.amount
    for child in line.children:
        yield from _earned(child, inside | {line.subject})


def _before_factors(ledger: Ledger) -> dict[str, Decimal]:
    """In a ledger of the former method: the topmost sum of a subject, or else its single amounts added up."""
    points: dict[str, Decimal] = {}
    sums: dict[str, Decimal] = {}
    for line in ledger.walk():
        if line.subject and line.kind == "sum":
            sums.setdefault(line.subject, line.amount)
        elif line.subject and not line.children:
            points[line.subject] = points.get(line.subject, Decimal(0)) + line.amount
    return {**points, **sums}
