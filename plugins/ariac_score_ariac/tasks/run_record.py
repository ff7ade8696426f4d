"""Runs of 2025, whose official record consists of numbers: orders handed in, times, cells, reports."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import Finding, Measure, SignalNeed, Trial, Verdict, number_of_fact
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
        summaries = trial.official.summaries if trial.official else ()
        stored = next((summary for summary in summaries if summary.id == order.id), None)
        if stored is None or stored.submitted is None:
            yield Finding.inconclusive(order.id, "there is no record of the run that names it")
            return
        # Type -1 of the database is of no kind: the official sums count types 1 to 3 alone.
        kinds = {kind: float(stored.kind == kind) for kind in _KINDS}
        if not stored.submitted:
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
        numbers are those it began with.
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
            yield Finding.inconclusive(_SUBJECT, f"no record of the run says its {_words(missing[0])}")
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


def _words(name: str) -> str:
    return name.removesuffix("_s").removeprefix("num_").replace("avg", "average").replace("_", " ")
