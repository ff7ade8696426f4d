"""Whether, where and when a kit was handed in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from ariac_score import Finding, Limit, Order, Submission, Task, Trial
from ariac_score_kitting.claims import NOT_SUBMITTED, claimed, kitting_tasks, not_kits


def _unwitnessed(trial: Trial, submission: Submission | None) -> bool:
    return submission is None and "submissions" not in trial.witnessed


@dataclass(frozen=True)
class Submitted:
    """Each shipment was handed in.

    Measures:
        Whether a submission of the shipment's type came after its announcement.
    Violated when:
        None did, in a log that shows submissions.
    Source:
        ARIAC 2019-2022, "claiming" in the rulebook's coded section.
    """

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        yield from not_kits(order)
        for subject, task in kitting_tasks(order):
            submission = claimed(trial, order, task)
            if _unwitnessed(trial, submission):
                yield Finding.inconclusive(subject, "the log does not show submissions")
            elif submission is None:
                yield Finding.violated(subject, NOT_SUBMITTED)
            else:
                yield Finding.satisfied(subject, f"submitted at {submission.submitted_s:.3f} s")


@dataclass(frozen=True)
class Destination:
    """Each shipment left on the ordered AGV, and went where it should.

    Measures:
        AGV (and assembly station) of the submission against the ordered ones.
    Violated when:
        They differ. An order for `any` AGV is always right.
    Source:
        ARIAC 2019-2022, scoring: a shipment on the wrong AGV is worth nothing.
    """

    compare: Literal["agv", "agv_and_station"] = "agv"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        clause = "ARIAC scoring, destination"
        yield from not_kits(order)
        for subject, task in kitting_tasks(order):
            submission = claimed(trial, order, task)
            if _unwitnessed(trial, submission):
                yield Finding.inconclusive(subject, "the log does not show submissions", clause=clause)
            elif submission is None:
                yield Finding.not_applicable(subject, NOT_SUBMITTED, clause=clause)
            else:
                yield self._compared(subject, task, submission, clause)

    def _compared(self, subject: str, task: Task, submission: Submission, clause: str) -> Finding:
        asked = [("AGV", task.agv, submission.agv)]
        if self.compare == "agv_and_station":
            asked.append(("station", task.station, submission.station))
        asked = [(what, wanted, got) for what, wanted, got in asked if wanted not in ("", "any")]
        wrong = [f"{what} {got}, ordered {wanted}" for what, wanted, got in asked if got and got != wanted]
        unknown = [what for what, _, got in asked if not got]
        if wrong:
            return Finding.violated(subject, "; ".join(wrong), clause=clause)
        if unknown:
            return Finding.inconclusive(
                subject, f"the log does not show the {' and '.join(unknown)}", clause=clause
            )
        return Finding.satisfied(
            subject, f"went out as ordered ({submission.agv or 'any AGV'})", clause=clause
        )


@dataclass(frozen=True)
class OrderTime:
    """The order was completed, and how long that took.

    Measures:
        `time_taken_s`: from the announcement to the last counted submission.
    Violated when:
        A shipment of it is missing, or the time exceeds `max_time_s` where that is
        positive.
    Source:
        ARIAC 2019-2022, coded section: "time taken".
    """

    max_time_s: float = 0.0

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for the order."""
        clause = "ARIAC scoring, order time"
        claims = [claimed(trial, order, task) for _, task in kitting_tasks(order)]
        if any(_unwitnessed(trial, submission) for submission in claims):
            yield Finding.inconclusive(order.id, "the log does not show submissions", clause=clause)
            return
        times = [submission.submitted_s for submission in claims if submission is not None]
        if len(times) < len(claims):
            message = f"{len(times)} of {len(claims)} shipments were submitted"
            yield Finding.violated(order.id, message, clause=clause)
        elif not times:
            yield Finding.not_applicable(order.id, "the order asks for no kit", clause=clause)
        elif order.announced_s is None:
            yield Finding.inconclusive(order.id, "the log does not show when it was announced", clause=clause)
        else:
            limit = self.max_time_s if self.max_time_s > 0 else float("inf")
            taken = Limit("time taken", max(times) - order.announced_s, "s", at_most=limit)
            message = f"completed in {taken.value:.3f} s"
            yield Finding(
                order.id,
                Finding.from_limits(order.id, taken).verdict,
                message,
                quantities={"time_taken_s": taken.value},
                clause=clause,
            )
