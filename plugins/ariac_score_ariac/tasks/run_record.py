"""Runs of 2025, whose official record consists of numbers: orders handed in, times, cells, reports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import ceil
from typing import ClassVar, Literal

from ariac_score import (
    Cause,
    Finding,
    Measure,
    OfficialOrder,
    SignalNeed,
    Trial,
    Verdict,
    Worlds,
    number_of_fact,
)
from ariac_score_ariac.work import Order

_KINDS = ("kit", "module", "high_priority")
_SUBJECT = "run"
_FACTS: Mapping[str, Measure] = {
    "duration_s": Measure("s", meaning="how long the run took"),
    "time_limit_s": Measure("s", meaning="how long it might have taken"),
    "num_kits": Measure("count", meaning="kits that were to be handed in"),
    "num_modules": Measure("count", meaning="modules that were to be handed in"),
    "num_high_priority": Measure("count", meaning="orders of high priority that were to be handed in"),
    "total_cells": Measure("count", meaning="cells that were inspected"),
    "defective_cells": Measure("count", meaning="cells with a defect"),
    "avg_report_time_s": Measure("s", meaning="mean time of a report; 0 when nothing was reported"),
    "num_reports_submitted": Measure("count", meaning="reports handed in"),
    "num_correct_reports": Measure("count", "points", meaning="reports that are right"),
    "num_correct_report_classifications": Measure("count", "points", meaning="defects named rightly"),
    "completed": Measure("count", meaning="1 where it is stored as completed, else 0"),
    "aborted": Measure("count", best=0.0, worst=1.0, meaning="1 where it is stored as aborted, else 0"),
}
"""What the record of a run holds, by the names of the trial's facts."""
_LATE_S = 0.1
"""The simulator looks at its time limit in every step of 1 ms, so a run is no longer than by this."""
_MOST_ORDERS = 1000
"""No configuration and no database with more orders of high priority is read."""
_CELLS_PER_S = 1000
"""One in each step of the simulation: nothing in a recording says how fast they are fed."""
_DATABASE = "the simulator's database says it, beside the recording"
_OF_ORDER: Mapping[str, Measure] = {
    **{kind: Measure("count", meaning=f"1 for an order of the kind {kind}, else 0") for kind in _KINDS},
    "announced_s": Measure("s", meaning="when it was announced, s since the start"),
    "submitted_s": Measure("s", meaning="when it was accepted, s since the start"),
}


@dataclass(frozen=True)
class RunOrder:
    """The order was handed in and accepted.

    Measures:
        Its kind as `kit`, `module` and `high_priority`, each 1 or 0, and of an order that
        was handed in `announced_s` and `submitted_s`. An order of unknown kind is 0 for
        each, and so counts for nothing.
    Violated when:
        The record does not hold it among those accepted.
    Source:
        ARIAC 2025, database, table OrderSubmission: only accepted orders are in it; how many
        there should be is in the table Trial.
    """

    when_cut: ClassVar[str] = "official"
    reads_official = True
    measures: ClassVar[Mapping[str, Measure]] = _OF_ORDER

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for the order."""
        stored = _stored(trial, order)
        if stored is None:
            yield Finding.inconclusive(order.id, "there is no record of the run that names it")
            return
        kinds = _kinds(stored)
        if stored.submitted is None:
            words = "nothing recorded says whether it was accepted; the simulator's database does"
            if stored.kind == "high_priority":
                words += ", and so do recorded calls of /submit_high_priority_order"
            yield Finding.inconclusive(order.id, words)
        elif not stored.submitted:
            yield Finding(order.id, Verdict.VIOLATED, "not handed in", quantities=kinds)
        elif stored.announced_s is None or stored.submitted_s is None:
            yield Finding.inconclusive(order.id, "the record does not say when it was handed in")
        elif min(stored.announced_s, stored.submitted_s) < 0:
            yield Finding.inconclusive(order.id, "the record gives it a time before the start")
        else:
            times = {"announced_s": stored.announced_s, "submitted_s": stored.submitted_s}
            words = f"announced at {stored.announced_s:.3f} s, accepted at {stored.submitted_s:.3f} s"
            numbers = kinds | times
            yield Finding(order.id, Verdict.SATISFIED, words, quantities=numbers)

    def judge_worlds(self, trial: Trial, order: Order) -> Iterator[Finding | Worlds]:
        """The same, and of one that is undecided: accepted at once, and at the end or not at all."""
        stored, latest_s = _stored(trial, order), _ends_s(trial)[1]
        for finding in self.judge(trial, order):
            yield finding
            if finding.verdict is not Verdict.INCONCLUSIVE or stored is None or latest_s is None:
                continue
            announced_s = stored.announced_s or 0.0  # where that was not recorded, at the start or later
            if min(announced_s, stored.submitted_s or 0.0) < 0:
                continue
            first_s, last_s = (
                (stored.submitted_s, stored.submitted_s)
                if stored.submitted_s is not None
                else (announced_s, max(announced_s, latest_s))
            )
            known = _kinds(stored) | {"announced_s": announced_s}
            at_once = Finding(
                order.id,
                Verdict.SATISFIED,
                f"accepted at {first_s:.3f} s at the soonest",
                quantities=known | {"submitted_s": first_s},
            )
            verdict = Verdict.SATISFIED if stored.submitted else Verdict.VIOLATED
            words = f"accepted by {last_s:.3f} s" if stored.submitted else "not accepted"
            late = Finding(order.id, verdict, words, quantities=known | {"submitted_s": last_s})
            yield Worlds(order.id, (at_once,), (late,), (Cause(finding.message),))


def _stored(trial: Trial, order: Order) -> OfficialOrder | None:
    summaries = trial.official.summaries if trial.official else ()
    return next((summary for summary in summaries if summary.id == order.id), None)


def _kinds(stored: OfficialOrder) -> dict[str, float]:
    # Type -1 of the database is of no kind: the official sums count types 1 to 3 alone.
    return {kind: float(stored.kind == kind) for kind in _KINDS}


def _ends_s(trial: Trial) -> tuple[float, float | None]:
    """Between which times since its start a run ended, s; `None`: nothing says how long it may take."""
    duration_s, limit_s = (number_of_fact(trial.facts, name) for name in ("duration_s", "time_limit_s"))
    if duration_s is not None:
        return duration_s, duration_s
    recorded_s = number_of_fact(trial.facts, "recorded_s") or 0.0
    return recorded_s, None if limit_s is None else max(recorded_s, limit_s + _LATE_S)


@dataclass(frozen=True)
class RunRecord:
    """The run ended with all orders in; the numbers that are recorded of it.

    Measures:
        `duration_s` and `time_limit_s`; `num_kits`, `num_modules` and `num_high_priority`
        that were to be handed in; `total_cells` and `defective_cells`;
        `avg_report_time_s`, 0 when nothing was reported, `num_reports_submitted`,
        `num_correct_reports`, `num_correct_report_classifications`; `completed` and
        `aborted` as stored.
    Violated when:
        It is stored as aborted: it ended before all orders were in. Inconclusive when a
        number is missing, the time limit is not positive, or (unless `unfinished` is
        `as_stored`) the run is stored as neither completed nor aborted, because then its
        numbers are those it began with. Of a recording that says how many orders there were,
        and how long they may take, all numbers have bounds.
    Source:
        ARIAC 2025, database, tables Run and Trial.
    Attributes:
        unfinished: What a run that was neither completed nor aborted gives.
    """

    when_cut: ClassVar[str] = "official"
    part_of: ClassVar[str] = "task"

    in_gaps: ClassVar[str] = "unsampled"
    measures: ClassVar[Mapping[str, Measure]] = _FACTS
    also_about: ClassVar[tuple[str, ...]] = (_SUBJECT,)

    unfinished: Literal["undecided", "as_stored"] = "undecided"

    def needs(self) -> Iterator[SignalNeed]:
        """No signal: it is all in the record."""
        return iter(())

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding about the run."""
        stated = {name: number_of_fact(trial.facts, name) for name in _FACTS}
        missing = [name for name, value in stated.items() if value is None]
        if missing:
            said = ", ".join(map(_words, missing))
            yield Finding.inconclusive(_SUBJECT, f"no record of the run says its {said}: {_DATABASE}")
            return
        numbers = {name: value for name, value in stated.items() if value is not None}
        unfinished = not numbers["completed"] and not numbers["aborted"]
        negative = [name for name, value in numbers.items() if value < 0]
        # The bonus for time divides by it.
        if not numbers["time_limit_s"] > 0:
            yield Finding.inconclusive(_SUBJECT, f"a time limit of {numbers['time_limit_s']:g} s is none")
        elif negative:
            words = f"the record gives a {_words(negative[0])} of {numbers[negative[0]]:g}, which cannot be"
            yield Finding.inconclusive(_SUBJECT, words)
        elif unfinished and self.unfinished == "undecided":
            yield Finding.inconclusive(
                _SUBJECT, "it is stored as neither completed nor aborted, so its numbers may not be final"
            )
        else:
            verdict = Verdict.VIOLATED if numbers["aborted"] else Verdict.SATISFIED
            ended = "aborted" if numbers["aborted"] else "not finished" if unfinished else "completed"
            words = f"{ended} after {numbers['duration_s']:.3f} s of {numbers['time_limit_s']:g} s"
            yield Finding(_SUBJECT, verdict, words, quantities=numbers)

    def watch_worlds(self, trial: Trial) -> Iterator[Finding | Worlds]:
        """The same, and where a recording lacks numbers, both ends of each."""
        for finding in self.watch(trial):
            yield finding
            stated = {name: number_of_fact(trial.facts, name) for name in _FACTS}
            if finding.verdict is Verdict.INCONCLUSIVE and None in stated.values():
                yield from _between(trial, stated, finding.message)


def _between(trial: Trial, stated: Mapping[str, float | None], why: str) -> Iterator[Worlds]:
    """Both ends of the numbers of a run; nothing where the recording does not bound them."""
    (earliest_s, latest_s), limit_s = _ends_s(trial), stated["time_limit_s"]
    known = {name: number for name, number in stated.items() if number is not None}
    asked = known.keys() >= {"num_kits", "num_modules"}
    if latest_s is None or limit_s is None or limit_s <= 0 or not asked or min(known.values()) < 0:
        return
    summaries = trial.official.summaries if trial.official else ()
    announced = sum(one.kind == "high_priority" for one in summaries)
    ends: dict[str, tuple[float, float]] = dict.fromkeys(_FACTS, (0.0, float(ceil(latest_s * _CELLS_PER_S))))
    ends |= {
        "duration_s": (earliest_s, latest_s),
        "avg_report_time_s": (0.0, latest_s),
        "num_high_priority": (float(announced), float(max(announced, _MOST_ORDERS))),
        "completed": (0.0, 1.0),
        "aborted": (0.0, 1.0),
    }
    ends |= {name: (number, number) for name, number in known.items()}
    numbers = [{name: end[which] for name, end in ends.items()} for which in (0, 1)]
    best, worst = (
        Finding(_SUBJECT, verdict, f"{word}: {why}", quantities=of)
        for verdict, word, of in (
            (Verdict.VIOLATED if numbers[0]["aborted"] else Verdict.SATISFIED, "at its least", numbers[0]),
            (Verdict.VIOLATED if numbers[1]["aborted"] else Verdict.SATISFIED, "at its most", numbers[1]),
        )
    )
    yield Worlds(_SUBJECT, (best,), (worst,), (Cause(why),))


def _words(name: str) -> str:
    if name == "num_high_priority":
        return "orders of high priority"
    return name.removesuffix("_s").removeprefix("num_").replace("avg", "average").replace("_", " ")
