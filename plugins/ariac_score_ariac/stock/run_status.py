"""The run of 2025 as the simulator counts it: what was accepted, and when.

Kits and modules are accepted when what remains of them falls by one. Of orders of high priority no topic
says more than that they were announced. The stamps of the topic are wall time; the time since the start is
in the message.

Source: `ariac_interfaces/CompetitionStatus`; ARIAC notes on recording, section 1.9.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    ORDER_ANNOUNCED,
    Event,
    OfficialOrder,
    OfficialResult,
    Record,
    Trial,
)
from ariac_score_ariac.stock.console import SCORE_LOGGER, lines_said, said_by
from ariac_score_ariac.work import KitSubmission

__all__ = ["AriacInterfaces2025", "HighPriority", "Run", "RunStatus", "run_of"]

STARTED, ORDERS_COMPLETE, ENDED = 2, 3, 4
"""States; before them the numbers of orders may be 0."""
_WHERE = "/competition_status"
_BOX = re.compile(r"[|\u2500-\u257f]")
_NUMBER = re.compile(r"-?\d{1,9}(?:\.\d{1,9})?")
_TOTALS = ("total_score", "final_score", "score", "total")


@dataclass(frozen=True)
class RunStatus(Record):
    """One message about the run.

    Attributes:
        t_s: When it was recorded, s of trial time.
        state: Of the competition.
        elapsed_s: Since the start of the competition, s of simulated time.
        limit_s: How long the run may take, s.
        asked: How many kits and modules there are to hand in.
        remaining: How many of them are not accepted yet.
    """

    timed: ClassVar[bool] = True

    t_s: float
    state: int
    elapsed_s: float
    limit_s: float
    asked: tuple[int, int]
    remaining: tuple[int, int]

    def shifted(self, by_s: float) -> RunStatus:
        """The same on another clock."""
        return replace(self, t_s=self.t_s + by_s)


@dataclass(frozen=True)
class HighPriority(Record):
    """The announcement of an order of high priority, which is repeated at each step.

    Attributes:
        t_s: When, s of trial time.
        id: Of the order.
    """

    timed: ClassVar[bool] = True

    t_s: float
    id: str

    def shifted(self, by_s: float) -> HighPriority:
        """The same on another clock."""
        return replace(self, t_s=self.t_s + by_s)


class AriacInterfaces2025:
    """Messages of ARIAC 2025 (`ariac_interfaces`): the course of the run, and orders of high priority."""

    def decode(self, msgtype: str, message: Any, t_s: float) -> RunStatus | HighPriority | None:
        """What the simulator says of the run; `None` for anything else.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: Its stamp, s of trial time.
        """
        if msgtype == "ariac_interfaces/msg/HighPriorityOrder":
            return HighPriority(t_s, message.id)
        if msgtype != "ariac_interfaces/msg/CompetitionStatus":
            return None
        elapsed_s, remaining_s = _seconds(message.time.elapsed), _seconds(message.time.remaining)
        return RunStatus(
            t_s,
            int(message.competition_state),
            elapsed_s,
            elapsed_s + remaining_s,
            (int(message.num_kits), int(message.num_modules)),
            (int(message.num_kits_remaining), int(message.num_modules_remaining)),
        )


def _seconds(duration: Any) -> float:
    return float(duration.sec) + float(duration.nanosec) / 1e9


@dataclass(frozen=True)
class Run:
    """A run of 2025 as recorded without its database.

    Attributes:
        official: Its orders, and the total where the table of the end is printed.
        submissions: Kits and modules that were accepted, in order of time.
        events: Start, end, announcements.
        facts: Numbers of the run as the database names them.
    """

    official: OfficialResult
    submissions: tuple[KitSubmission, ...]
    events: tuple[Event, ...]
    facts: Mapping[str, float]


def run_of(parts: Sequence[Trial]) -> Run | None:
    """The run that recordings show; `None` where none does, or the database is there and says more."""
    statuses = sorted(_of(RunStatus, parts), key=lambda status: status.t_s)
    known = [s for s in statuses if s.state >= STARTED and any(s.asked)]
    if not known or any(part.official for part in parts):
        return None
    started, last = known[0], known[-1]
    ended = next((status for status in known if status.state == ENDED), None)
    orders = [order for which in (0, 1) for order in _counted(which, known, ended)]
    urgent = list(_urgent(parts, started))
    official = OfficialResult(
        _WHERE,
        _printed_total(parts),
        ended.elapsed_s if ended else None,
        outcome="aborted" if ended and any(ended.remaining) else "",
        summaries=(*orders, *urgent),
    )
    facts = {"num_kits": last.asked[0], "num_modules": last.asked[1]}
    limits = [status.limit_s for status in known if status.state == STARTED]
    facts |= {"time_limit_s": limits[0]} if limits else {}
    facts |= {"duration_s": ended.elapsed_s} if ended else {}
    offset_s = started.t_s - started.elapsed_s
    events = [Event(offset_s, COMPETITION_STARTED)]
    events += [Event(ended.t_s, COMPETITION_ENDED)] if ended else []
    events += [Event(offset_s + (o.announced_s or 0.0), ORDER_ANNOUNCED, o.id) for o in (*orders, *urgent)]
    submissions = [
        KitSubmission(o.id, min(offset_s + o.submitted_s, ended.t_s if ended else float("inf")))
        for o in orders
        if o.submitted_s is not None
    ]
    return Run(
        official,
        tuple(sorted(submissions, key=lambda s: s.submitted_s)),
        tuple(sorted(events)),
        {name: float(value) for name, value in facts.items()},
    )


def _of(kind: type, parts: Iterable[Trial]) -> Iterator[Any]:
    return (record for part in parts for record in part.records if isinstance(record, kind))


def _counted(which: int, known: Sequence[RunStatus], ended: RunStatus | None) -> Iterator[OfficialOrder]:
    """The kits or the modules of a run: accepted when their number falls; by the end, or not at all."""
    kind = ("kit", "module")[which]
    accepted: list[float] = []
    for status in known:
        done = status.asked[which] - status.remaining[which]
        accepted += [status.elapsed_s] * max(0, done - len(accepted))
    for number in range(1, known[-1].asked[which] + 1):
        at_s = accepted[number - 1] if number <= len(accepted) else None
        submitted = True if at_s is not None else False if ended else None
        # Kits and modules are there from the start on.
        yield OfficialOrder(
            f"{kind}_{number}", kind, submitted=submitted, priority=False, announced_s=0.0, submitted_s=at_s
        )


def _urgent(parts: Sequence[Trial], started: RunStatus) -> Iterator[OfficialOrder]:
    """The orders of high priority: of none it is known whether it was accepted."""
    first: dict[str, float] = {}
    for record in sorted(_of(HighPriority, parts), key=lambda record: record.t_s):
        first.setdefault(record.id, record.t_s - started.t_s + started.elapsed_s)
    for number, at_s in enumerate(first.values(), start=1):
        name = f"high_priority_{number}"
        yield OfficialOrder(name, "high_priority", priority=True, announced_s=max(at_s, 0.0))


def _printed_total(parts: Sequence[Trial]) -> float | None:
    """The total in the tables that the score logger prints at the end."""
    rows: dict[str, float] = {}
    for _, line in lines_said(said_by(parts, SCORE_LOGGER)):
        cells = [cell.strip() for cell in _BOX.split(line) if cell.strip()]
        label, _, value = (cells[0], "", cells[-1]) if len(cells) > 1 else line.partition(":")
        name = "_".join(re.findall(r"[a-z0-9]+", label.lower()))
        if _NUMBER.fullmatch(value.strip()):
            rows.setdefault(name, float(value))
    return next((rows[name] for name in _TOTALS if name in rows), None)
