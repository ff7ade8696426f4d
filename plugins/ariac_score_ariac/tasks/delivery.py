"""Whether, where and when a kit was handed in."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from ariac_score import Cause, Finding, Limit, Measure, Trial, Verdict, Worlds, parameter
from ariac_score_ariac.tasks.claims import (
    NOT_SUBMITTED,
    CountsFrom,
    KindOfTask,
    claimed,
    first_announced_s,
    kitting_tasks,
    not_kits,
    unseen,
)
from ariac_score_ariac.work import KitSubmission, Order, Task


@dataclass(frozen=True)
class Submitted:
    """Each shipment was handed in.

    Measures:
        Whether a submission of the shipment's type came after its announcement.
    Violated when:
        None did, in a log that shows submissions.
    Source:
        ARIAC 2017-2022, "claiming" in the rulebook's coded section.
    Attributes:
        counts_from: The version of the order since which submissions count.
        kind: Kind of task that it is about.
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("shipment not submitted", "shipments not submitted")

    kind: KindOfTask = "kitting"
    counts_from: CountsFrom = "update"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each task of the kind."""
        yield from not_kits(order, self.kind)
        for subject, task in kitting_tasks(order, self.kind):
            submission = claimed(trial, order, task, self.counts_from)
            if why := unseen(trial, submission, task):
                yield Finding.inconclusive(subject, why)
            elif submission is None:
                yield Finding.violated(subject, NOT_SUBMITTED)
            else:
                yield Finding.satisfied(subject, f"submitted at {submission.submitted_s:.3f} s")


@dataclass(frozen=True)
class Destination:
    """Each shipment left on the ordered AGV, and went where it should.

    Measures:
        AGV, assembly station, or both, of the submission against the ordered ones.
    Violated when:
        They differ. An order for `any` AGV is always right. Where the names the
        simulator knows are given, an order for another one (or for none) is never right.
    Source:
        ARIAC 2019-2022, scoring: a shipment on the wrong AGV is worth nothing. As
        coded: agv1 and agv2 in 2019 and 2020, agv1 to agv4 and as1 to as4 from 2021.
    Attributes:
        compare: What of the destination must be right.
        known_agvs: AGVs that there are.
        known_stations: Stations that there are.
        kind: Kind of task that it is about.
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("wrong destination", "wrong destinations")

    compare: Literal["agv", "station", "agv_and_station"] = "agv"
    known_agvs: tuple[str, ...] = ()
    known_stations: tuple[str, ...] = ()
    kind: KindOfTask = "kitting"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each task of the kind."""
        clause = "ARIAC scoring, destination"
        yield from not_kits(order, self.kind)
        for subject, task in kitting_tasks(order, self.kind):
            submission = claimed(trial, order, task)
            if why := unseen(trial, submission, task):
                yield Finding.inconclusive(subject, why, clause=clause)
            elif submission is None:
                yield Finding.not_applicable(subject, NOT_SUBMITTED, clause=clause)
            else:
                yield self._compared(subject, task, submission, clause)

    def _compared(self, subject: str, task: Task, submission: KitSubmission, clause: str) -> Finding:
        places: list[tuple[str, str, str, tuple[str, ...]]] = []
        if self.compare != "station" and task.agv != "any":
            places.append(("AGV", task.agv, submission.agv, self.known_agvs))
        if self.compare != "agv":
            places.append(("station", task.station, submission.station, self.known_stations))
        # An empty or unknown name matches nothing, whatever AGV the shipment left on.
        never = [f"{what} {wanted or 'none'}" for what, wanted, _, known in places if _unknown(wanted, known)]
        # An order that names no station leaves it open, unless the simulator has a list of names.
        places = [found for found in places if found[3] or found[1] not in ("", "any")]
        wrong = [
            f"{what} {got}, ordered {wanted}" for what, wanted, got, _ in places if got and got != wanted
        ]
        unseen = [what for what, _, got, _ in places if not got]
        if never:
            return Finding.violated(
                subject,
                f"{' and '.join(never)} was ordered, which the simulator does not know, so nothing is right",
                clause=clause,
            )
        if wrong:
            return Finding.violated(subject, "; ".join(wrong), clause=clause)
        if unseen:
            return Finding.inconclusive(
                subject, f"the log does not show the {' and '.join(unseen)}", clause=clause
            )
        went = submission.station if self.compare == "station" else submission.agv
        return Finding.satisfied(subject, f"went out as ordered ({went or 'any AGV'})", clause=clause)


def _unknown(wanted: str, known: tuple[str, ...]) -> bool:
    """Whether the simulator's list of names excludes the ordered one; no list excludes none."""
    return bool(known) and wanted not in known


@dataclass(frozen=True)
class OrderTime:
    """The order was completed, and how long that took.

    Measures:
        `time_taken_s`: from the announcement of the order's latest version (`since:
        announcement`: of its first) to the last counted submission. With
        `until: last_complete_kind` that of one kind of task: of several kinds the last in
        the list that the order asks for and that is complete gives the time. With
        `until: all_complete` that of all tasks of these kinds, once none is missing.
    Violated when:
        A shipment of it is missing, or the time exceeds `max_time_s` where that is
        positive.
    Source:
        ARIAC 2019-2022, coded section: "time taken"; in 2021 as of a931894 and in 2022
        the time of the assemblies replaces that of the kits. As documented: the time
        taken to complete the order, measured from when it was first requested; 2023 and
        2024: its submission duration.
    Attributes:
        max_time_s: Longest time; 0: any.
        until: Whether one kind of task or all of them end the time.
        since: The version of the order whose announcement begins it.
        counts_from: The version of the order since which submissions count.
        kinds: Kinds of task whose time it is.
    """

    when_cut: ClassVar[str] = "witnessed"
    measures: ClassVar[Mapping[str, Measure]] = {
        "time_taken_s": Measure("s", meaning="from the announcement to the last counted submission")
    }

    max_time_s: float = parameter(0.0, unit="s", status="")
    kinds: tuple[str, ...] = ("kitting",)
    until: Literal["last_complete_kind", "all_complete"] = "last_complete_kind"
    since: CountsFrom = "update"
    counts_from: CountsFrom = "update"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for the order."""
        clause = "ARIAC scoring, order time"
        tasks = {kind: [task for _, task in kitting_tasks(order, kind)] for kind in self.kinds}
        claims = {
            kind: [claimed(trial, order, task, self.counts_from) for task in of_kind]
            for kind, of_kind in tasks.items()
        }
        everything = [submission for found in claims.values() for submission in found]
        every_task = [task for of_kind in tasks.values() for task in of_kind]
        for submission, task in zip(everything, every_task, strict=True):
            if why := unseen(trial, submission, task):
                yield Finding.inconclusive(order.id, why, clause=clause)
                return
        # As coded a kind that is complete has its time even where another kind is missing.
        missing = everything.count(None)
        message = f"{len(everything) - missing} of {len(everything)} shipments were submitted"
        together = self.until == "all_complete"
        end_s = _last_complete_s([everything] if together else list(claims.values()))
        start_s = order.announced_s if self.since == "update" else first_announced_s(trial, order)
        if not everything:
            yield Finding.not_applicable(order.id, "the order asks for no kit", clause=clause)
        elif end_s is None:
            yield Finding.violated(order.id, message, clause=clause)
        elif start_s is None:
            yield Finding.inconclusive(order.id, "the log does not show when it was announced", clause=clause)
        else:
            limit = self.max_time_s if self.max_time_s > 0 else float("inf")
            taken = Limit("time taken", end_s - start_s, "s", at_most=limit)
            verdict = Finding.violated(order.id, "") if missing else Finding.from_limits(order.id, taken)
            yield Finding(
                order.id,
                verdict.verdict,
                message if missing else f"completed in {taken.value:.3f} s",
                quantities={"time_taken_s": taken.value},
                clause=clause,
            )

    def judge_worlds(self, trial: Trial, order: Order) -> Iterator[Finding | Worlds]:
        """The same, and of an undecided one that it took from no time to all that was left of the trial."""
        for finding in self.judge(trial, order):
            yield finding
            window, start_s = trial.window, order.announced_s
            if finding.verdict is not Verdict.INCONCLUSIVE or window is None or trial.window_open:
                continue
            longest_s = window.end_s - max(start_s if start_s is not None else window.start_s, window.start_s)
            at_once = replace(
                finding,
                verdict=Verdict.SATISFIED,
                message="nothing shows that it took any time",
                quantities={"time_taken_s": 0.0},
            )
            never = replace(
                finding,
                verdict=Verdict.VIOLATED,
                message="nothing shows that it was completed before the end",
                quantities={"time_taken_s": max(longest_s, 0.0)},
            )
            yield Worlds(order.id, (at_once,), (never,), (Cause(finding.message),))


def _last_complete_s(claims: list[list[KitSubmission | None]]) -> float | None:
    """The latest submission of the last kind of which all were submitted.

    The last kind, not the latest time: as coded the time of the assemblies overwrites that of the kits.
    """
    end_s = None
    for found in claims:
        times = [submission.submitted_s for submission in found if submission is not None]
        if times and len(times) == len(found):
            end_s = max(times)
    return end_s
