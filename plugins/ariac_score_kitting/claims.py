"""Which submission counts for a shipment, and what to say when none can be found."""

from __future__ import annotations

from collections.abc import Iterator

from ariac_score import Finding, Order, Submission, Task, Trial

NOT_SUBMITTED = "it was never submitted"
EMPTY_KIT = "no product is ordered"


def kitting_tasks(order: Order) -> Iterator[tuple[str, Task]]:
    """The kitting tasks of an order with the subject of findings about each."""
    for task in order.tasks:
        if task.kind == "kitting":
            yield f"{order.id}/{task.id}", task


def not_kits(order: Order) -> Iterator[Finding]:
    """For each task of another kind that a rule about kits does not judge it.

    Said rather than passed over, so that a formula about the task has an answer and
    `kitting.only_kitting` is what withholds the score.
    """
    for task in order.tasks:
        if task.kind != "kitting":
            yield Finding.not_applicable(f"{order.id}/{task.id}", f"a task of kind {task.kind} is not a kit")


def claimed(trial: Trial, order: Order, task: Task) -> Submission | None:
    """The first submission of the task's type since the order (or its update) was announced.

    Later submissions of the same type, and those before an update, do not count.

    Source:
        ARIAC 2019 and later, "claiming" in the rulebook's coded section.
    """
    start_s = order.announced_s
    for submission in trial.submissions:
        if submission.task_id == task.id and (start_s is None or submission.submitted_s >= start_s):
            return submission
    return None


def undecidable(trial: Trial, submission: Submission | None, subject: str, clause: str) -> Finding | None:
    """The finding for a task whose delivery the log does not show; `None` when it does.

    Nothing found means nothing submitted only in a log that shows submissions.
    """
    if submission is None and "submissions" not in trial.witnessed:
        return Finding.inconclusive(
            subject,
            "the log does not show submissions, so nothing says whether it was submitted",
            clause=clause,
        )
    if submission is not None and submission.contents is None:
        return Finding.inconclusive(
            subject, "it was submitted, but the log does not show what was on the tray", clause=clause
        )
    return None
