"""The run of 2025 as the simulator counts it: what was accepted, and when.

Kits and modules are accepted when what remains of them falls by one. Of orders of high priority no topic
says more than that they were announced; calls that were recorded say the rest, and so does the state in
which all orders are in. The stamps of the topic are wall time; the time since the start is in the message.

Source: `ariac_interfaces/CompetitionStatus`; ARIAC notes on recording, section 1.9; `orders_complete` and
`update_competition_time` of the simulator's competition_manager_plugin.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    ORDER_ANNOUNCED,
    Event,
    LogError,
    OfficialOrder,
    OfficialResult,
    Record,
    Trial,
)
from ariac_score_ariac.service_calls import submissions_called
from ariac_score_ariac.stock.console import SCORE_LOGGER, lines_said, said_by
from ariac_score_ariac.work import KitSubmission, submissions_of

__all__ = ["AriacInterfaces2025", "HighPriority", "Run", "RunStatus", "course_of", "run_of"]

STARTED, ORDERS_COMPLETE, ENDED = 2, 3, 4
"""States; before them the numbers of orders may be 0."""
HIGH_PRIORITY_ORDERS, SUBMISSIONS = "high_priority_orders", "submissions"
"""What a recording witnesses: that none other was announced, handed in."""
_WHERE = "/competition_status"
_KINDS = ("kit", "module")
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


def run_of(parts: Sequence[Trial], file: object = None) -> Run | None:
    """The run that recordings show; `None` where none does, or the database is there and says more.

    Raises:
        LogError: Recorded submissions are not those that the simulator counted.
    """
    statuses = sorted(_of(RunStatus, parts), key=lambda status: status.t_s)
    known = _known(statuses)
    if not known or any(part.official for part in parts):
        return None
    last, ended = known[-1], _ended(known)
    witnessed = frozenset[str]().union(*(part.witnessed for part in parts))
    handed_in = _handed_in(parts, known)
    if SUBMISSIONS in witnessed and ended:
        _refuse_left_out(handed_in, ended, file)
    orders = [order for which in (0, 1) for order in _counted(which, known, ended, handed_in)]
    urgent = list(_urgent(parts, known, handed_in, closed=SUBMISSIONS in witnessed and ended is not None))
    all_in = any(status.state == ORDERS_COMPLETE for status in known)
    official = OfficialResult(
        _WHERE,
        _printed_total(parts),
        ended.elapsed_s if ended else None,
        outcome="aborted" if ended and any(ended.remaining) else "",
        summaries=(*orders, *urgent),
    )
    facts: dict[str, float] = {
        "num_kits": last.asked[0],
        "num_modules": last.asked[1],
        "recorded_s": last.elapsed_s,
    }
    limits = [status.limit_s for status in known if status.state == STARTED]
    facts |= {"time_limit_s": limits[0]} if limits else {}
    facts |= {"duration_s": ended.elapsed_s, "completed": 1.0} if ended else {}
    if ended and not all_in and any(order.submitted is False for order in (*orders, *urgent)):
        facts["aborted"] = 1.0
    if all_in:
        facts |= {"aborted": 0.0} if ended else {}
        # Nobody can hand in what was not announced, for its name is not known.
        seen = HIGH_PRIORITY_ORDERS in witnessed and statuses[0].state < STARTED
        facts |= {"num_high_priority": len(urgent)} if seen else {}
    events = _course(known)
    events += [
        Event(_recorded_at(known, o.announced_s), ORDER_ANNOUNCED, o.id)
        for o in (*orders, *urgent)
        if o.announced_s is not None
    ]
    submissions = [
        KitSubmission(o.id, _recorded_at(known, o.submitted_s))
        for o in (*orders, *urgent)
        if o.submitted_s is not None
    ]
    return Run(
        official,
        tuple(sorted(submissions, key=lambda s: s.submitted_s)),
        tuple(sorted(events)),
        {name: float(value) for name, value in facts.items()},
    )


def course_of(parts: Sequence[Trial]) -> list[Event]:
    """When the run that recordings show started and ended; the database tells that on a clock of its own."""
    return _course(_known(sorted(_of(RunStatus, parts), key=lambda status: status.t_s)))


def _known(statuses: Sequence[RunStatus]) -> list[RunStatus]:
    """What is said of the run while it goes on, and at its end."""
    counting = [s for s in statuses if s.state >= STARTED and any(s.asked)]
    # While all orders are in, some releases leave the numbers out.
    return [
        replace(s, asked=counting[0].asked, remaining=(0, 0)) if s.state == ORDERS_COMPLETE else s
        for s in statuses
        if counting and (s.state == ORDERS_COMPLETE or s in counting)
    ]


def _ended(known: Sequence[RunStatus]) -> RunStatus | None:
    return next((status for status in known if status.state == ENDED), None)


def _course(known: Sequence[RunStatus]) -> list[Event]:
    ended = _ended(known)
    started = [Event(one.t_s - one.elapsed_s, COMPETITION_STARTED) for one in known[:1]]
    return started + ([Event(ended.t_s, COMPETITION_ENDED)] if ended else [])


def _of(kind: type, parts: Iterable[Trial]) -> Iterator[Any]:
    return (record for part in parts for record in part.records if isinstance(record, kind))


def _elapsed_at(known: Sequence[RunStatus], t_s: float) -> float:
    """The time since the start at which something was recorded, s of simulated time."""
    if t_s < known[0].t_s:
        return max(0.0, known[0].elapsed_s - (known[0].t_s - t_s))
    return float(np.interp(t_s, [s.t_s for s in known], [s.elapsed_s for s in known]))


def _recorded_at(known: Sequence[RunStatus], elapsed_s: float) -> float:
    """The trial time of a time since the start, s."""
    if elapsed_s < known[0].elapsed_s:
        return known[0].t_s - (known[0].elapsed_s - elapsed_s)
    going = [s for k, s in enumerate(known) if not k or s.elapsed_s > known[k - 1].elapsed_s]
    return float(np.interp(elapsed_s, [s.elapsed_s for s in going], [s.t_s for s in going]))


def _handed_in(parts: Sequence[Trial], known: Sequence[RunStatus]) -> dict[str, list[float]]:
    """When what was accepted, by recorded calls: `kit`, `module`, or the id of an order of high priority."""
    recorded = [one for part in parts for one in submissions_of(part)]
    found: dict[str, list[float]] = {}
    for one in recorded or submissions_called(parts):
        found.setdefault(one.item_id, []).append(_elapsed_at(known, one.submitted_s))
    return {name: sorted(times) for name, times in found.items()}


def _refuse_left_out(handed_in: Mapping[str, Sequence[float]], ended: RunStatus, file: object) -> None:
    for kind, asked, remaining in zip(_KINDS, ended.asked, ended.remaining, strict=True):
        recorded = len(handed_in.get(kind, ()))
        if recorded != asked - remaining:
            raise LogError(
                f"the simulator accepted {asked - remaining} orders of the kind {kind}, "
                f"and the recorder's messages have {recorded}",
                file=file,
                hint="they are not all there: score the recording without /ariac_score/submissions",
            )


def _counted(
    which: int, known: Sequence[RunStatus], ended: RunStatus | None, handed_in: Mapping[str, Sequence[float]]
) -> Iterator[OfficialOrder]:
    """The kits or the modules of a run: accepted when their number falls; by the end, or not at all."""
    kind = _KINDS[which]
    accepted: list[float] = []
    for status in known:
        done = status.asked[which] - status.remaining[which]
        accepted += [status.elapsed_s] * max(0, done - len(accepted))
    called = handed_in.get(kind, ())
    if len(called) == len(accepted):  # to the moment; of some of the calls nobody knows which they were
        accepted = list(called)
    for number in range(1, known[-1].asked[which] + 1):
        at_s = accepted[number - 1] if number <= len(accepted) else None
        submitted = True if at_s is not None else False if ended else None
        # Kits and modules are there from the start on.
        yield OfficialOrder(
            f"{kind}_{number}", kind, submitted=submitted, priority=False, announced_s=0.0, submitted_s=at_s
        )


def _urgent(
    parts: Sequence[Trial],
    known: Sequence[RunStatus],
    handed_in: Mapping[str, Sequence[float]],
    *,
    closed: bool,
) -> Iterator[OfficialOrder]:
    """The orders of high priority: what no call shows to be accepted may have been, unless all are recorded.

    Args:
        parts: The recordings.
        known: What is said of the run.
        handed_in: What was accepted, and when.
        closed: Whether everything that was accepted is in the recording.
    """
    first: dict[str, float] = {}
    for record in sorted(_of(HighPriority, parts), key=lambda record: record.t_s):
        first.setdefault(record.id, _elapsed_at(known, record.t_s))
    all_in = any(status.state == ORDERS_COMPLETE for status in known)
    names = [*first, *sorted(handed_in.keys() - first.keys() - {*_KINDS})]
    for number, name in enumerate(names, start=1):
        at_s = next(iter(handed_in.get(name, ())), None)
        yield OfficialOrder(
            f"high_priority_{number}",
            "high_priority",
            submitted=True if all_in or at_s is not None else False if closed else None,
            priority=True,
            announced_s=first.get(name),
            submitted_s=at_s,
        )


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
