"""Building a trial from what readers find, and merging the trials of several logs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from ariac_score.errors import LogError
from ariac_score.trial.clock import Clock
from ariac_score.trial.events import ORDER_ANNOUNCED, TIMED_EVENTS, WATCHING, Event
from ariac_score.trial.kits import RecordedKits
from ariac_score.trial.model import (
    Body,
    Kit,
    KitRecord,
    LogDefect,
    OfficialOrder,
    OfficialResult,
    Order,
    Submission,
    Task,
    TeamSetup,
    Trial,
    WantedProduct,
    orders_of,
)
from ariac_score.trial.shift import shifted
from ariac_score.trial.signals import Signal, settle
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of
from ariac_score.trial.work import Fact, WorkItem, announced_s

__all__ = ["LARGEST_STEP_BACK_S", "TrialBuilder", "merge_trials", "settle_orders"]

LARGEST_STEP_BACK_S = 1.0
"""Stamps further back than this mean two recordings in one file, which sorting would interleave."""


_T = TypeVar("_T")

_SETTLED_DEFECTS = MappingProxyType(
    {
        "disordered_stamps": "stamps ran backwards; samples were sorted by time",
        "repeated_stamps": "stamps were repeated; of samples that agree one was kept",
        "contradicting_stamps": "samples with one stamp contradict each other; they were left out, as gaps",
        "impossible_values": "values that are NaN, infinite or impossible were left out, as gaps",
    }
)
"""What `settle` counts, in the order of its counts."""


class TrialBuilder:
    """Collects what a reader finds and settles it into a `Trial` once.

    Args:
        trial_id: Name of the trial.
        file: The log, for error messages.
        clock: Which clock the times come from; `None` when the log does not say.
    """

    def __init__(self, trial_id: str, *, file: object, clock: Clock | None) -> None:
        self.trial_id, self.file, self.clock = trial_id, file, clock
        self.work: list[WorkItem] = []
        self.submissions: list[Submission] = []
        self.events: list[Event] = []
        self.bodies: dict[str, Body] = {}
        self.signals: dict[str, Signal] = {}
        self.team: TeamSetup | None = None
        self.official: OfficialResult | None = None
        self.witnessed: set[str] = set()
        self.unrecorded: list[str] = []
        self.recorded: Span | None = None
        self.facts: dict[str, Fact] = {}
        self.kits: list[Kit] = []
        self.kit_records: list[KitRecord] = []
        self._defects: dict[tuple[str, str], LogDefect] = {}

    def add(self, item: WorkItem | Submission | Kit | Event) -> None:
        """Take one decoded item; an order with a time also makes its announcement an event."""
        if isinstance(item, Submission):
            self.submissions.append(item)
        elif isinstance(item, Kit):
            self.kits.append(item)
        elif isinstance(item, Event):
            if item.kind == WATCHING:  # nothing happened: the recorder declares what it would have recorded
                self.witnessed.add(item.subject)
            else:
                self.events.append(item)
        else:
            self._add_work(item)

    def _add_work(self, item: WorkItem) -> None:
        if isinstance(item, Order):
            _check_ids(item, self.file)
        self.work.append(item)
        t_s = announced_s(item)
        if t_s is not None:
            self.events.append(Event(t_s, ORDER_ANNOUNCED, item.id))

    def add_body(self, body: Body) -> None:
        """Take a body; links of one that is already known are added to it."""
        known = self.bodies.get(body.id)
        self.bodies[body.id] = _joined(known, body, self.file)

    def defect(self, kind: str, where: str, count: int, message: str) -> None:
        """Count a fault of the log that reading survived; a count of 0 leaves no trace."""
        if count:
            known = self._defects.get((kind, where))
            total = count + (known.count if known else 0)
            self._defects[kind, where] = LogDefect(kind, where, total, message)

    def add_signal(
        self, name: str, unit: str, t: FloatArray, values: FloatArray, *, source: str = ""
    ) -> None:
        """Take the samples of one signal in recorded order and settle them.

        Raises:
            LogError: Time runs back so far that the file must hold two recordings,
                or the signal was there already.
        """
        if name in self.signals:
            raise LogError(
                f"signal {name!r} is recorded twice",
                file=self.file,
                hint="the log map leads two topics to one signal; map one of them, or record one of them",
            )
        known = QUANTITIES.get(quantity_of(name))  # a log may declare quantities of its own
        settled = settle(
            np.asarray(t, dtype=np.float64),
            np.asarray(values, dtype=np.float64),
            at_least=known.at_least if known else -np.inf,
        )
        if settled.largest_step_back_s > LARGEST_STEP_BACK_S:
            raise LogError(
                f"time runs backwards by {settled.largest_step_back_s:.3f} s in signal {name!r}",
                file=self.file,
                hint="the file seems to hold two recordings (or a reset simulation): score them one by one",
            )
        counts = settled.disordered, settled.repeated, settled.contradicting, settled.not_finite
        for (kind, message), count in zip(_SETTLED_DEFECTS.items(), counts, strict=True):
            self.defect(kind, name, count, message)
        if len(settled.t):
            self.signals[name] = Signal(name, unit, settled.t, settled.values, source)

    def build(self) -> Trial:
        """The trial, with updates of orders applied and everything in order of time."""
        return Trial(
            id=self.trial_id,
            work=self._settled(),
            submissions=tuple(sorted(self.submissions, key=lambda s: s.submitted_s)),
            events=tuple(sorted(set(self.events))),
            bodies=tuple(self.bodies[k] for k in sorted(self.bodies)),
            signals={k: self.signals[k] for k in sorted(self.signals)},
            team=self.team,
            official=self.official,
            witnessed=frozenset(self.witnessed),
            unrecorded=tuple(sorted(self.unrecorded)),
            log_defects=tuple(self._defects[k] for k in sorted(self._defects)),
            clocks=() if self.clock is None else (self.clock,),
            recorded=self.recorded or _span_of(self.signals.values(), self.events, self.submissions),
            facts={name: self.facts[name] for name in sorted(self.facts)},
            kits=(*([RecordedKits(self.kits)] if self.kits else []), *self.kit_records),
        )

    def _settled(self) -> tuple[WorkItem, ...]:
        orders = settle_orders([item for item in self.work if isinstance(item, Order)], file=self.file)
        return *orders, *(item for item in self.work if not isinstance(item, Order))


def _check_ids(order: Order, file: object) -> None:
    """Refuse an order in which two things have one name: findings could not distinguish them."""
    for what, names in (
        ("shipments", [task.id for task in order.tasks]),
        *(("slots", [wanted.slot for wanted in task.products]) for task in order.tasks),
    ):
        # Counted once: a stranger's order may have as many products as fit into a line of a log.
        twice = sorted(name for name, count in Counter(names).items() if count > 1)
        if twice:
            raise LogError(
                f"order {order.id!r} has two {what} named {twice[0]!r}",
                file=file,
                hint="give each its own name",
            )


def _span_of(
    signals: Iterable[Signal], events: Iterable[Event], submissions: Iterable[Submission]
) -> Span | None:
    times = [float(t) for s in signals for t in (s.t[0], s.t[-1])]
    times += [e.t_s for e in events] + [s.submitted_s for s in submissions]
    return Span(min(times), max(times)) if times else None


def _joined(known: Body | None, body: Body, file: object) -> Body:
    """A body with its new and its known links."""
    if known is not None and (known.kind, known.radius_m) != (body.kind, body.radius_m):
        raise LogError(f"body {body.id!r} is described twice, differently", file=file)
    return replace(body, links=tuple(sorted({*(known.links if known else ()), *body.links})))


def settle_orders(announced: Sequence[Order], *, file: object = None) -> tuple[Order, ...]:
    """Apply updates to the orders they name.

    An update takes over the products and the start time; the order keeps its id
    and priority; the last update wins. An update whose own id is that of an announced
    order is ignored, and so is one that names no announced order.

    Raises:
        LogError: An order is announced again with other contents.

    Source:
        ARIAC 2019, section "code" of the rulebook: update, priority.
    """
    orders: dict[str, Order] = {}
    first: dict[str, Order] = {}
    for order in announced:
        known = first.setdefault(order.id, order)
        # With the first announcement: an update may have changed the order since.
        if not order.updates and order.tasks != known.tasks:
            raise LogError(
                f"order {order.id!r} is announced twice, with different contents",
                file=file,
                hint="a change of an order is an update of its own id, such as order_0_update_0",
            )
        if order.id in orders:
            continue  # an update with the id of an announced order, or the order once more
        if not order.updates:
            orders[order.id] = order
        elif order.updates in orders:
            old = orders[order.updates]
            orders[old.id] = replace(old, tasks=order.tasks, announced_s=order.announced_s)
    return tuple(orders.values())


def merge_trials(trial_id: str, parts: Sequence[Trial], *, file: object) -> Trial:
    """One trial from the several logs of a bundle.

    Each kind of thing may come from one log only, except events, bodies, defects
    and `witnessed`, which add up. Announced orders take precedence over configured
    ones; configured ones take their time from the event of their announcement, and
    updates are applied. Fields that announced orders lack, such as challenges, are
    taken from the configured ones. Submissions with contents take precedence over those
    of an official text, which has none, and configured sensors over recorded ones.
    Numbers of the trial that two files state must agree. Logs that count from another
    zero of one clock are shifted; logs on another clock than the log that records the
    motion keep what needs no time (see `_without_times`).

    Raises:
        LogError: Two logs contradict each other.
    """
    parts = _on_one_clock(parts)  # first, for everything below compares times
    events = tuple(sorted({e for p in parts for e in p.events}))
    spans = [p.recorded for p in parts if p.recorded]
    merged = Trial(
        id=trial_id,
        work=_orders(parts, events, file),
        submissions=_submissions(parts, file),
        events=events,
        bodies=_bodies(parts, file),
        signals=_signals(parts, file),
        team=_team([p.team for p in parts if p.team], file),
        official=_only("an official result", [p.official for p in parts if p.official], file),
        witnessed=frozenset(w for p in parts for w in p.witnessed),
        unrecorded=tuple(sorted({u for p in parts for u in p.unrecorded})),
        log_defects=tuple(sorted([*(d for p in parts for d in p.log_defects), *_other_sensors(parts)])),
        clocks=_clocks(parts),
        recorded=Span(min(s.start_s for s in spans), max(s.end_s for s in spans)) if spans else None,
        facts=_facts(parts, file),
        kits=_kits(parts),
        faulty_products=_only(
            "a list of faulty products",
            [p.faulty_products for p in parts if p.faulty_products is not None],
            file,
        ),
    )
    return _within_competition(merged, _unannounced(parts, merged))


def _unannounced(parts: Sequence[Trial], merged: Trial) -> int:
    """How many configured orders are not among the orders of the trial."""
    known = {order.id for order in orders_of(merged)}
    return len({o.id for part in parts for o in orders_of(part) if not o.updates} - known)


def _within_competition(trial: Trial, unannounced: int) -> Trial:
    """The trial with the submissions that can count; irregularities are noted as defects.

    No competition accepts a submission before the start or after the end. Submissions that
    are left out, and those that answer no order, are counted, so that none vanishes silently.
    """
    low_s, high_s, no_window = _competition_limits(trial)
    counted = tuple(s for s in trial.submissions if low_s <= s.submitted_s <= high_s)
    noted = {
        "no_window": (bool(no_window), no_window),
        "outside_competition": (
            len(trial.submissions) - len(counted),
            "submissions before the start or after the end were refused",
        ),
        "priority_unknown": (
            sum(not order.priority_said for order in orders_of(trial)),
            "the messages of this edition do not say an order's priority; the trial configuration does",
        ),
        "orders_not_announced": (
            unannounced,
            "orders of the configuration were never announced in the log",
        ),
        **_irregular(counted, orders_of(trial)),
    }
    defects = (LogDefect(kind, trial.id, int(n), message) for kind, (n, message) in noted.items() if n)
    return replace(trial, submissions=counted, log_defects=tuple(sorted([*trial.log_defects, *defects])))


def _competition_limits(trial: Trial) -> tuple[float, float, str]:
    """Between which times submissions count, s, and why there are no limits, where there are none."""
    start_s, end_s = trial.started_s, trial.ended_s
    if start_s is None and end_s is None:
        return -np.inf, np.inf, "start and end of the competition are not in the log; all of it was watched"
    low_s = -np.inf if start_s is None else start_s
    high_s = np.inf if end_s is None else end_s
    if low_s >= high_s:
        times = f"it ends ({high_s:.3f} s) before it starts ({low_s:.3f} s)"
        return -np.inf, np.inf, f"{times}; all of it was watched"
    return low_s, high_s, ""


def _irregular(counted: Sequence[Submission], orders: Sequence[Order]) -> dict[str, tuple[int, str]]:
    """Submissions that answer nothing that was ordered, or the same thing again."""
    ordered = {task.id for order in orders for task in order.tasks}
    known = [s.task_id for s in counted if s.task_id in ordered]
    # An official text that is the only source of orders does not name their tasks.
    unknown = 0 if any(order.outline for order in orders) else len(counted) - len(known)
    return {
        "unknown_shipment": (unknown, "submissions answer no shipment of any order"),
        "repeated_submission": (
            len(known) - len(set(known)),
            "shipments were submitted more than once",
        ),
    }


def _clocks(parts: Sequence[Trial]) -> tuple[Clock, ...]:
    """The clocks of the parts, the one with most detail of each; that of the times stands first."""
    # Times of one kind of clock are taken as comparable even where one log does not give its origin.
    ranked = sorted(parts, key=lambda part: (part.recorded is None, _times_clock(part).origin_ns is None))
    found: dict[tuple[str, int | None], Clock] = {}
    for clock in (clock for part in ranked for clock in part.clocks):
        key = clock.kind, clock.origin_ns
        found[key] = max(found.get(key, clock), clock, key=lambda c: len(c.detail))
    return tuple(found.values())


def _times_clock(part: Trial) -> Clock:
    return part.clocks[0] if part.clocks else Clock("")


def _on_one_clock(parts: Sequence[Trial]) -> list[Trial]:
    """The parts with times on the clock of the part that records the motion, or else the contents."""
    timed = [part for part in parts if part.recorded is not None]
    if not timed:
        return list(parts)
    main = max(timed, key=_timed_contents)
    return [part if part.recorded is None else _on_clock_of(main, part) for part in parts]


def _on_clock_of(main: Trial, part: Trial) -> Trial:
    """A part with its times counted from where those of another begin, or without them."""
    clock, own = _times_clock(main), _times_clock(part)
    if own.kind != clock.kind:
        return _without_times(part, main)
    if own.origin_ns is None or clock.origin_ns is None or own.origin_ns == clock.origin_ns:
        return part
    # Each recording counts from its own first stamp.
    later_ns = own.origin_ns - clock.origin_ns
    return replace(shifted(part, later_ns / 1e9), clocks=(replace(own, origin_ns=clock.origin_ns),))


def _timed_contents(part: Trial) -> tuple[int, int]:
    """How much of a part is worth nothing on another clock: signals first, then contents."""
    return len(part.signals), sum(1 for s in part.submissions if s.contents is not None)


def _without_times(part: Trial, main: Trial) -> Trial:
    """What remains of a log on another clock: what happened, but not when.

    Start, end and announcements mean nothing without their time and are left out.
    """
    assert main.recorded is not None  # chosen for having one
    # Collisions and drops count whenever they happened, so they are put where the recording ends.
    end_s = main.recorded.end_s
    kept = tuple(replace(e, t_s=end_s) for e in part.events if e.kind not in TIMED_EVENTS)
    left_out = len(part.events) - len(kept)
    own, others = _times_clock(part).kind, _times_clock(main).kind
    message = f"its times are {own}, the motion is in {others}; they were not used"
    defect = LogDefect("other_clock", part.id, left_out + len(kept) + len(part.submissions), message)
    return replace(
        part,
        events=kept,
        submissions=tuple(replace(s, submitted_s=end_s) for s in part.submissions),
        work=tuple(replace(order, announced_s=None) for order in orders_of(part)),
        signals={},
        recorded=None,
        kits=(),
        clocks=(),
        log_defects=(*part.log_defects, defect),
    )


def _orders(parts: Sequence[Trial], events: Sequence[Event], file: object) -> tuple[Order, ...]:
    found = [orders_of(part) for part in parts if part.work]
    as_announced = [orders for orders in found if any(order.announced_s is not None for order in orders)]
    orders = _only("orders", as_announced or found, file) or ()
    configured = {o.id: o for group in found if group not in as_announced for o in group}
    orders = tuple(_completed(order, configured.get(order.id)) for order in orders)
    announced: dict[str, float] = {}
    for event in events:
        if event.kind == ORDER_ANNOUNCED:
            announced.setdefault(event.subject, event.t_s)
    dated = [o if o.announced_s is not None else replace(o, announced_s=announced.get(o.id)) for o in orders]
    # An update in a configuration takes effect only if the log shows that it was announced.
    if not dated:
        return _outlined(parts)
    return settle_orders([o for o in dated if not o.updates or o.announced_s is not None], file=file)


def _outlined(parts: Sequence[Trial]) -> tuple[Order, ...]:
    """The orders of the official text, in its order, where no other file names any."""
    summaries = [order for part in parts if part.official for order in part.official.summaries]
    return tuple(
        Order(order.id, announced_s=order.announced_s, priority=_priority(order), outline=True)
        for order in summaries
    )


def _priority(order: OfficialOrder) -> int:
    """As printed: a factor in some texts, yes or no in others, where yes means the factor 3."""
    printed = order.items.get("priority", "")
    return int(printed) if printed.isdigit() else 3 if order.priority else 1


def _completed(order: Order, configured: Order | None) -> Order:
    """An announced order with what its message lacks: challenges and, in some formats, the priority."""
    if configured is None:
        return order
    of_slot = {
        (task.id, wanted.slot, wanted.type, wanted.quadrant): wanted.challenged
        for task in configured.tasks
        for wanted in task.products
    }

    def challenged(task: Task, wanted: WantedProduct) -> WantedProduct:
        if wanted.challenged is not None:
            return wanted
        # All four: a configured order of that id with other contents must not lend its challenges.
        key = task.id, wanted.slot, wanted.type, wanted.quadrant
        return replace(wanted, challenged=of_slot.get(key))

    tasks = tuple(replace(t, products=tuple(challenged(t, w) for w in t.products)) for t in order.tasks)
    if order.priority_said:
        return replace(order, tasks=tasks)
    return replace(order, tasks=tasks, priority=configured.priority, priority_said=configured.priority_said)


def _kits(parts: Sequence[Trial]) -> tuple[KitRecord, ...]:
    """The records of trays; none where submissions have lost their times, for they cannot be joined then."""
    if any(part.submissions and part.recorded is None for part in parts):
        return ()
    return tuple(record for part in parts for record in part.kits)


def _team(setups: Sequence[TeamSetup], file: object) -> TeamSetup | None:
    """One set-up from a configuration, which has sensors, and an official record, which has their cost."""
    if not setups:
        return None
    names = [team.name for team in setups if team.name]
    # Two lists: a record may count other sensors than are configured, which take precedence.
    configured, recorded = _sensors(setups)
    costs = [team.sensor_cost for team in setups if team.sensor_cost is not None]
    sensors = _only("a team set-up", configured or recorded, file)
    return TeamSetup(
        _only("a team set-up", names, file) or "",
        None if sensors is None else MappingProxyType(sensors),
        _only("a sensor cost", costs, file),
    )


def _sensors(setups: Sequence[TeamSetup]) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
    """The sensors as configured, and those of a record that gives their cost."""
    known = [team for team in setups if team.sensors is not None]
    return (
        [dict(team.sensors or {}) for team in known if team.sensor_cost is None],
        [dict(team.sensors or {}) for team in known if team.sensor_cost is not None],
    )


def _other_sensors(parts: Sequence[Trial]) -> Iterator[LogDefect]:
    """Whether a record counts other sensors than are configured; by type, for the names always differ."""
    configured, recorded = _sensors([part.team for part in parts if part.team])
    if configured and recorded and sorted(configured[0].values()) != sorted(recorded[0].values()):
        message = (
            f"the record counts {len(recorded[0])} sensors, the team configuration has {len(configured[0])}, "
            "or of other types; the configured ones were kept"
        )
        yield LogDefect("other_sensors", "team", 1, message)


def _facts(parts: Sequence[Trial], file: object) -> dict[str, Fact]:
    """The facts that the files state of the trial, which must not contradict each other."""
    stated: dict[str, tuple[Fact, str]] = {}
    for part in parts:
        source = part.official.source if part.official else part.id
        for name, value in sorted(part.facts.items()):
            known, first = stated.setdefault(name, (value, source))
            if known != value:
                raise LogError(
                    f"{first!r} says that {name} is {_said(known)}, {source!r} that it is {_said(value)}",
                    file=file,
                    hint="a bundle is one trial: leave out the file that belongs to another",
                )
    return {name: stated[name][0] for name in sorted(stated)}


def _said(value: Fact) -> str:
    return "absent" if value is None else repr(value) if isinstance(value, str) else f"{value:g}"


def _submissions(parts: Sequence[Trial], file: object) -> tuple[Submission, ...]:
    found = [part.submissions for part in parts if part.submissions]
    with_contents = [group for group in found if any(s.contents is not None for s in group)]
    return _only("submissions", with_contents or found, file) or ()


def _bodies(parts: Sequence[Trial], file: object) -> tuple[Body, ...]:
    bodies: dict[str, Body] = {}
    for body in (body for part in parts for body in part.bodies):
        bodies[body.id] = _joined(bodies.get(body.id), body, file)
    return tuple(bodies[name] for name in sorted(bodies))


def _signals(parts: Sequence[Trial], file: object) -> dict[str, Signal]:
    signals: dict[str, Signal] = {}
    for part in parts:
        for name, signal in part.signals.items():
            if name in signals:
                raise LogError(
                    f"two logs record the signal {name!r}", file=file, hint="a bundle is one trial"
                )
            signals[name] = signal
    return {name: signals[name] for name in sorted(signals)}


def _only(what: str, found: Sequence[_T], file: object) -> _T | None:
    # Equal copies are no contradiction: a configuration and a record may state the same.
    if len(found) > 1 and any(item != found[0] for item in found[1:]):
        raise LogError(
            f"{len(found)} logs hold {what}, and they differ",
            file=file,
            hint="a bundle is one trial: keep one, or name the parts in bundle.yaml",
        )
    return found[0] if found else None
