"""Which submission counts for a shipment, and what a rule finds when there is none."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Literal

from ariac_score import ORDER_ANNOUNCED, Finding, Trial
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, open_task, submissions_of

NOT_SUBMITTED = "it was never submitted"
EMPTY_KIT = "no product is ordered"

CountsFrom = Literal["update", "announcement"]
"""Since when submissions count: the latest version of the order, or its first one."""

KindOfTask = Literal["kitting", "assembly"]
"""The kind of task a rule judges."""


def kitting_tasks(order: Order, kind: str = "kitting") -> Iterator[tuple[str, Task]]:
    """The tasks of one kind of an order with the subject of findings about each."""
    for task in order.tasks:
        if task.kind == kind:
            yield f"{order.id}/{task.id}", task


def not_kits(order: Order, kind: str = "kitting") -> Iterator[Finding]:
    """A finding, "not applicable", for each task of another kind.

    Without one a formula about that task would have no answer. Whether the score is withheld
    is left to `kitting.only_kitting`.
    """
    what = "a kit" if kind == "kitting" else f"of kind {kind}"
    for task in order.tasks:
        if task.kind != kind:
            yield Finding.not_applicable(f"{order.id}/{task.id}", f"a task of kind {task.kind} is not {what}")


def first_announced_s(trial: Trial, order: Order) -> float | None:
    """When the first version of an order was announced, whatever updates came later."""
    # `announced_s` is that of the latest update; each update has an event of its own.
    events = [event for event in trial.events_of(ORDER_ANNOUNCED) if event.subject == order.id]
    return events[0].t_s if events else order.announced_s


def claimed(
    trial: Trial, order: Order, task: Task, counts_from: CountsFrom = "update"
) -> KitSubmission | None:
    """The first submission of the task's type since the order was announced.

    Later submissions of the same type do not count, nor do those before the
    announcement (with `update`: of the latest version of the order).

    Source:
        ARIAC 2017 and 2018 (`announcement`), 2019 and later (`update`), "claiming" in
        the rulebook's coded section.
    """
    start_s = order.announced_s if counts_from == "update" else first_announced_s(trial, order)
    # One at the very start counts: as coded its time must be at least that of the order.
    for submission in submissions_of(trial):
        if submission.item_id == task.id and (start_s is None or submission.submitted_s >= start_s):
            return submission
    return None


def each_delivered(
    trial: Trial,
    order: Order,
    clause: str,
    judge: Callable[[str, Task, tuple[Product, ...]], Finding],
    *,
    kind: KindOfTask = "kitting",
) -> Iterator[Finding]:
    """One finding for each task of the kind: that of `judge` about its contents, or why there is none."""
    yield from not_kits(order, kind)
    for subject, task in kitting_tasks(order, kind):
        submission = claimed(trial, order, task)
        unknown = undecidable(trial, submission, subject, clause, task)
        if unknown:
            yield unknown
        elif submission is None:
            yield Finding.not_applicable(subject, NOT_SUBMITTED, clause=clause)
        else:
            yield judge(subject, task, submission.contents or ())


def contents_of(trial: Trial, order: Order, task: Task) -> tuple[Product, ...] | None:
    """What was on the tray of a task when it was handed in; `None` where the log does not show it."""
    submission = claimed(trial, order, task)
    if submission is None or undecidable(trial, submission, "", "", task):
        return None
    return submission.contents


def unseen(trial: Trial, submission: KitSubmission | None, task: Task) -> str:
    """Why nothing says whether a task was handed in, in words; empty where the log shows it."""
    if submission is not None:
        return ""
    return (
        "the log does not show submissions"
        if "submissions" not in trial.witnessed
        else open_task(trial, task)
    )


def undecidable(
    trial: Trial,
    submission: KitSubmission | None,
    subject: str,
    clause: str,
    task: Task,
    *,
    order: Order | None = None,
) -> Finding | None:
    """The finding for a task whose delivery the log does not show; `None` when it does.

    Nothing found means nothing submitted only in a log that shows submissions. With
    the order given, a submission from before its update is undecided too: it was
    judged against a version that is no longer known.
    """
    if submission is None and "submissions" not in trial.witnessed:
        return Finding.inconclusive(
            subject,
            "the log does not show submissions, so nothing says whether it was submitted",
            clause=clause,
        )
    if why := unseen(trial, submission, task):
        return Finding.inconclusive(subject, why, clause=clause)
    if submission is not None and submission.contents is None:
        return Finding.inconclusive(
            subject, "it was submitted, but the log does not show what was on the tray", clause=clause
        )
    changed_s = order.announced_s if order is not None else None
    # Happens only where submissions count from the first announcement on (2017, 2018).
    if submission is not None and changed_s is not None and submission.submitted_s < changed_s:
        return Finding.inconclusive(
            subject,
            "it was submitted and judged before the order was changed, and the version it was judged "
            "against is not known",
            clause=clause,
        )
    return None
