"""Each order: what was wanted, what was delivered, the errors against tolerances, and the points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.results.result import Result
from ariac_score.results.sketch import HandedIn
from ariac_score.scoring.ledger import Ledger
from ariac_score.scoring.scope import Scope

__all__ = ["OrderShown", "PartShown", "TaskShown", "grouped", "orders_of", "work_heading"]

NamedFinding = tuple[str, Finding]


@dataclass(frozen=True)
class PartShown:
    """One part: its slot, the wanted type, the findings about it, its points before any factor."""

    slot: str
    wanted: str
    found: tuple[NamedFinding, ...]
    points: Decimal | None


@dataclass(frozen=True)
class TaskShown:
    """One task: as ordered, as delivered, its parts, and the findings about it as a whole."""

    name: str
    ordered: str
    brought: tuple[HandedIn, ...]
    parts: tuple[PartShown, ...]
    found: tuple[NamedFinding, ...]
    points: Decimal | None


@dataclass(frozen=True)
class OrderShown:
    """One order: when it was announced, its points before any factor, its tasks."""

    name: str
    announced_s: float | None
    points: Decimal | None
    tasks: tuple[TaskShown, ...]
    found: tuple[NamedFinding, ...]


def work_heading(result: Result) -> str:
    """What the competition calls its outermost items of work, as a heading."""
    sketch = result.measured.sketch
    outermost = next((item.level for item in sketch.asked), "") if sketch else ""
    words = {named.level: named.many for named in sketch.levels} if sketch else {}
    many = words.get(outermost, "orders")
    return many[:1].upper() + many[1:]


def orders_of(result: Result) -> tuple[OrderShown, ...]:
    """Every order with its tasks and parts, in the order of the trial."""
    measured = result.measured
    points = _points(result.ledger or result.task)
    ordered = {asked.path: asked.words for asked in measured.sketch.asked} if measured.sketch else {}
    brought = measured.sketch.brought if measured.sketch else ()
    found = _by_subject(measured.findings)
    return tuple(
        OrderShown(
            order.path,
            measured.orders.get(order.path),
            points.get(order.path),
            tuple(_task(task, ordered, brought, found, points) for task in order.inner),
            tuple(found.get(order.path, ())),
        )
        for order in measured.scopes.inner
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


def _task(
    task: Scope,
    ordered: Mapping[str, str],
    brought: tuple[HandedIn, ...],
    found: Mapping[str, list[NamedFinding]],
    points: Mapping[str, Decimal],
) -> TaskShown:
    name = task.path.rpartition("/")[2]
    parts = tuple(
        PartShown(
            part.path.removeprefix(f"{task.path}/"),
            ordered.get(part.path, ""),
            tuple(found.get(part.path, ())),
            points.get(part.path),
        )
        for part in _leaves(task)
    )
    return TaskShown(
        name,
        ordered.get(task.path, ""),
        tuple(one for one in brought if one.item == name),
        parts,
        tuple(found.get(task.path, ())),
        points.get(task.path),
    )


def _leaves(task: Scope) -> Iterator[Scope]:
    """What a task consists of, however deep its levels go."""
    for inner in task.inner:
        yield from _leaves(inner) if inner.inner else iter((inner,))


def _by_subject(findings: Mapping[str, Finding]) -> dict[str, list[NamedFinding]]:
    found: dict[str, list[NamedFinding]] = {}
    for key, finding in findings.items():
        if finding.verdict is not Verdict.NOT_APPLICABLE:
            found.setdefault(finding.subject, []).append((key, finding))
    return found


def _points(ledger: Ledger | None) -> dict[str, Decimal]:
    """The points of each subject in the ledger: its topmost sum, or else its single amounts added up."""
    points: dict[str, Decimal] = {}
    if ledger is None:
        return points
    sums: dict[str, Decimal] = {}
    for line in ledger.walk():
        if line.subject and line.kind == "sum":
            sums.setdefault(line.subject, line.amount)
        elif line.subject and not line.children:
            points[line.subject] = points.get(line.subject, Decimal(0)) + line.amount
    return {**points, **sums}
