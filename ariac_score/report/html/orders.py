"""What each order asked for, what came, how far off it was, and what that was worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.results.result import Result
from ariac_score.results.sketch import OrderedTask, Submitted
from ariac_score.scoring.ledger import Ledger
from ariac_score.scoring.scope import Scope

__all__ = ["OrderShown", "PartShown", "TaskShown", "grouped", "orders_of"]

NamedFinding = tuple[str, Finding]


@dataclass(frozen=True)
class PartShown:
    """One part: its slot, what was wanted, what the checks found, its points before any factor."""

    slot: str
    wanted: str
    found: tuple[NamedFinding, ...]
    points: Decimal | None


@dataclass(frozen=True)
class TaskShown:
    """One task: as ordered, as brought, its parts, and what the checks found about it as a whole."""

    name: str
    asked: OrderedTask | None
    brought: tuple[Submitted, ...]
    parts: tuple[PartShown, ...]
    found: tuple[NamedFinding, ...]
    points: Decimal | None


@dataclass(frozen=True)
class OrderShown:
    """One order: when it came, what it brought to the score's task points, its tasks."""

    name: str
    announced_s: float | None
    points: Decimal | None
    tasks: tuple[TaskShown, ...]
    found: tuple[NamedFinding, ...]


def orders_of(result: Result) -> tuple[OrderShown, ...]:
    """Every order with its tasks and parts, in the order of the trial."""
    measured = result.measured
    points = _points(result.ledger or result.task)
    asked = {f"{a.order}/{a.task}": a for a in measured.sketch.asked} if measured.sketch else {}
    brought = measured.sketch.brought if measured.sketch else ()
    found = _by_subject(measured.findings)
    return tuple(
        OrderShown(
            order.path,
            measured.orders.get(order.path),
            points.get(order.path),
            tuple(_task(task, asked.get(task.path), brought, found, points) for task in order.inner),
            tuple(found.get(order.path, ())),
        )
        for order in measured.scopes.inner
    )


_SHOWN = (Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.SATISFIED)


def grouped(found: tuple[NamedFinding, ...]) -> list[tuple[Verdict, str, list[NamedFinding]]]:
    """Findings that say the same together, what costs something first.

    A check that was kept and measured nothing needs no words.
    """
    groups: dict[tuple[int, str], list[NamedFinding]] = {}
    for key, finding in found:
        silent = finding.verdict is Verdict.SATISFIED and finding.robustness is None
        words = "" if silent else finding.message
        # What was kept and measured stands before what was kept and can be named in one line.
        place = _SHOWN.index(finding.verdict) + silent
        groups.setdefault((place, words), []).append((key, finding))
    return [(alike[0][1].verdict, words, alike) for (_, words), alike in sorted(groups.items(), key=_place)]


def _place(group: tuple[tuple[int, str], list[NamedFinding]]) -> int:
    return group[0][0]


def _task(
    task: Scope,
    asked: OrderedTask | None,
    brought: tuple[Submitted, ...],
    found: Mapping[str, list[NamedFinding]],
    points: Mapping[str, Decimal],
) -> TaskShown:
    name = task.path.rpartition("/")[2]
    types = {part.slot: part.type for part in asked.parts} if asked else {}
    parts = tuple(
        PartShown(
            slot := part.path.removeprefix(f"{task.path}/"),
            types.get(slot, ""),
            tuple(found.get(part.path, ())),
            points.get(part.path),
        )
        for part in task.inner
    )
    return TaskShown(
        name,
        asked,
        tuple(one for one in brought if one.task == name),
        parts,
        tuple(found.get(task.path, ())),
        points.get(task.path),
    )


def _by_subject(findings: Mapping[str, Finding]) -> dict[str, list[NamedFinding]]:
    found: dict[str, list[NamedFinding]] = {}
    for key, finding in findings.items():
        if finding.verdict is not Verdict.NOT_APPLICABLE:
            found.setdefault(finding.subject, []).append((key, finding))
    return found


def _points(ledger: Ledger | None) -> dict[str, Decimal]:
    """What the ledger gives to each subject: the topmost line about it, or all single amounts about it."""
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
