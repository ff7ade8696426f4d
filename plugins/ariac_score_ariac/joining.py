"""What several logs of one trial together say about its orders, submissions and sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from ariac_score import (
    COMPETITION_ENDED,
    ContradictionError,
    LogDefect,
    LogError,
    OfficialOrder,
    OfficialResult,
    Record,
    TeamSetup,
    Trial,
    first_announced,
    only,
)
from ariac_score_ariac.agreement import is_announced, refuse_other_orders
from ariac_score_ariac.service_calls import ServiceCall, calls_without_content, submissions_called
from ariac_score_ariac.stock.agv_states import AGVS, AgvState
from ariac_score_ariac.stock.console import CONSOLE, Said
from ariac_score_ariac.stock.run_status import HighPriority, Run, RunStatus, course_of, run_of
from ariac_score_ariac.stock.score_steps import ScoreSeen
from ariac_score_ariac.stock.settling import Stock, stock_of
from ariac_score_ariac.work import (
    NO_HUMAN,
    FaultyProducts,
    KitSubmission,
    OpenTasks,
    Order,
    SensorBill,
    Task,
    WantedProduct,
    faulty_products,
    orders_of,
    submissions_of,
)

_READ_OFF = (Said, AgvState, ScoreSeen, RunStatus, HighPriority, ServiceCall)
"""Records of which all that matters is joined: neither checks nor results need them."""
_SAME_SUBMISSION_S = 2.0
"""A recorder and the simulator stamp one submission at most so far apart: a call waits, a kit is checked."""

__all__ = ["joined", "settle_orders", "with_irregularities"]


def joined(merged: Trial, parts: Sequence[Trial], file: object) -> Trial:
    """The merged trial with its orders, submissions and sensors.

    Orders that a log announces and a configuration states must be the same: the log gives their times.
    Configured ones without take theirs from the event of their announcement, and updates are applied. What
    announced orders lack, such as challenges, is taken from the configured ones. Submissions with contents
    take precedence over those of an official text, which has none, and configured sensors over recorded ones.

    Raises:
        LogError: Two logs contradict each other.
    """
    run, silent = run_of(parts, file), calls_without_content(parts)
    if any(isinstance(record, RunStatus) for part in parts for record in part.records):
        # Calls of 2025 name no kit and no module: `run` has read them, and a database knows better.
        parts = [part if part.official else _without_calls(part) for part in parts]
    if run is not None:  # of 2025, whose orders have no messages of their own
        merged = _with_run(merged, run, file)
        parts = [*parts, Trial(merged.id, official=run.official)]
    elif merged.started_s is None and merged.ended_s is None:  # beside a database, which has its own clock
        merged = replace(merged, events=tuple(sorted({*merged.events, *course_of(parts)})))
    orders = _orders(parts, first_announced(merged), file)
    bills = [record for part in parts for record in part.records if isinstance(record, SensorBill)]
    only("a sensor cost", [bill.cost for bill in bills], file)
    stock = stock_of(merged, parts, orders, file) if run is None else Stock(run.submissions)
    counted = only("a team set-up", [dict(bill.sensors) for bill in bills if bill.sensors is not None], file)
    only("a list of faulty products", [f for part in parts if (f := faulty_products(part)) is not None], file)
    known = {order.id for order in orders}
    unannounced = len({o.id for part in parts for o in orders_of(part) if not o.updates} - known)
    message = "orders of the configuration were never announced in the log"
    defects = [*merged.log_defects, *_other_sensors(merged.team, counted)]
    defects += [LogDefect("orders_not_announced", merged.id, unannounced, message)] if unannounced else []
    _refuse_other_priorities(parts, stock.official, file)
    _refuse_other_challenges(parts, file)
    orders = tuple(_with_printed_priority(order, stock.official) for order in orders)
    submissions, from_stock = _submissions(parts, stock, file)
    defects += stock.defects if from_stock else []
    defects += silent
    # Of all parts, for submissions that a recording dates can be joined with what it shows of trays.
    records = [record for part in parts for record in part.records] if from_stock else merged.records
    # The printed end is exact, so that what the state said a moment later does not count.
    printed_end = any(event.kind == COMPETITION_ENDED for event in stock.events)
    seen = [e for e in merged.events if not (printed_end and e.kind == COMPETITION_ENDED)]
    cut = merged.cut
    if cut is not None and not any(
        isinstance(record, _READ_OFF) for part in parts for record in part.records
    ):
        cut = replace(cut, official=True)  # nothing of the log prints a verdict, so none was lost
    return replace(
        merged,
        cut=cut,
        work=orders,
        submissions=submissions,
        team=_with_sensors(merged.team, counted),
        official=_official(merged.official, stock.official, file),
        events=tuple(sorted({*seen, *stock.events})),
        witnessed=merged.witnessed - {CONSOLE, *(f"{agv}_state" for agv in AGVS)} | stock.witnessed,
        records=(*_each_once(records), *(_still_open(stock, submissions) if from_stock else ())),
        log_defects=tuple(sorted(defects)),
    )


def with_irregularities(trial: Trial) -> Trial:
    """The trial with defects for submissions that answer no order, or one that is answered already."""
    orders = orders_of(trial)
    ordered = {task.id for order in orders for task in order.tasks}
    known = [s.item_id for s in trial.submissions if s.item_id in ordered]
    # An official text that is the only source of orders does not name their tasks.
    unknown = 0 if any(order.outline for order in orders) else len(trial.submissions) - len(known)
    noted = {
        "priority_unknown": (
            sum(not order.priority_said for order in orders),
            "the messages of this edition do not say an order's priority; the trial configuration does",
        ),
        "unknown_shipment": (unknown, "submissions answer no shipment of any order"),
        "repeated_submission": (len(known) - len(set(known)), "shipments were submitted more than once"),
    }
    defects = (LogDefect(kind, trial.id, n, message) for kind, (n, message) in noted.items() if n)
    return replace(trial, log_defects=tuple(sorted([*trial.log_defects, *defects])))


def settle_orders(announced: Sequence[Order], *, file: object = None) -> tuple[Order, ...]:
    """Apply updates to the orders they name.

    An update takes over the products and the start time; the order keeps its id
    and priority; the last update wins. An update whose own id is that of an announced
    order is ignored, and so is one that names no announced order.

    Raises:
        LogError: An order is announced again with other contents or another priority.

    Source:
        ARIAC 2019, section "code" of the rulebook: update, priority.
    """
    orders: dict[str, Order] = {}
    first: dict[str, Order] = {}
    for order in announced:
        known = first.setdefault(order.id, order)
        # With the first announcement: an update may have changed the order since.
        said = [o.priority for o in (known, order) if o.priority_said]
        for what, differs in (("contents", order.tasks != known.tasks), ("priorities", len({*said}) > 1)):
            if differs and not order.updates:
                raise LogError(
                    f"order {order.id!r} is announced twice, with different {what}",
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


def _orders(parts: Sequence[Trial], announced: Mapping[str, float], file: object) -> tuple[Order, ...]:
    stating = [(part, orders_of(part)) for part in parts if part.work]
    refuse_other_orders(stating, file)
    # A log may announce an order again and again.
    as_announced = [settle_orders(group, file=file) for _, group in stating if is_announced(group)]
    found = [group for _, group in stating if not is_announced(group)]
    # A log on another clock says what was asked for, not when: what it lacks, the configuration may have.
    stated = {o.id: o for group in found for o in group if o.priority_said}
    found = [tuple(_completed(order, stated.get(order.id)) for order in group) for group in found]
    orders = only("orders", as_announced or found, file) or ()
    configured = {o.id: o for group in found for o in group} if as_announced else {}
    orders = tuple(_completed(order, configured.get(order.id)) for order in orders)
    if any(part.cut is not None and not part.cut.ended for part, _ in stating):  # they may have come later
        known = {order.id for order in orders}
        orders += tuple(o for o in configured.values() if o.id not in known and not o.updates)
    dated = [o if o.announced_s is not None else replace(o, announced_s=announced.get(o.id)) for o in orders]
    # An update in a configuration takes effect only if the log shows that it was announced.
    if not dated:
        return _outlined(parts, announced)
    return settle_orders([o for o in dated if not o.updates or o.announced_s is not None], file=file)


def _outlined(parts: Sequence[Trial], announced: Mapping[str, float]) -> tuple[Order, ...]:
    """The orders of the official text, in its order, where no other file names any.

    Its times count from the start of the competition; a recording knows when each was on its own clock.
    """
    summaries = [order for part in parts if part.official for order in part.official.summaries]
    return tuple(
        Order(
            order.id,
            announced_s=announced.get(order.id, order.announced_s),
            priority=_priority(order),
            outline=True,
        )
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


def _refuse_other_priorities(parts: Sequence[Trial], official: OfficialResult | None, file: object) -> None:
    """Refuse a configuration with another priority than the simulator prints, where no message says one.

    Raises:
        ContradictionError: Naming both, and what each says.
    """
    stating = [(part, orders_of(part)) for part in parts if part.work]
    silent = {order.id for _, orders in stating for order in orders if not order.priority_said}
    printed = {one.id: one.items.get("priority", "") for one in official.summaries} if official else {}
    for part, orders in stating:
        for order in orders:
            says = printed.get(order.id, "") if order.id in silent and order.priority_said else ""
            if official is not None and says.isdigit() and int(says) != order.priority:
                what, name = f"priority of order {order.id!r}", str(part.origin or repr(part.id))
                raise ContradictionError(
                    what, (name, str(order.priority)), (repr(official.source), says), file=file
                )


def _refuse_other_challenges(parts: Sequence[Trial], file: object) -> None:
    """Refuse a recording that says that nobody walks about, where the configuration has somebody do so.

    Raises:
        ContradictionError: Naming both, and what each says.
    """
    configured = [part for part in parts if part.origin and part.origin.role == "trial_config"]
    recorded = [part for part in parts if part.origin and part.origin.role == "log"]
    walking = [part for part in configured if NO_HUMAN not in part.witnessed]
    nobody = [part for part in recorded if NO_HUMAN in part.witnessed]
    if walking and nobody:
        (one, *_), (other, *_) = walking, nobody
        raise ContradictionError(
            "whether somebody walks about",
            (str(one.origin), "a human challenge"),
            (str(other.origin), "none"),
            file=file,
        )


def _with_printed_priority(order: Order, official: OfficialResult | None) -> Order:
    """An order with the priority that its simulator prints beside its score, where nothing else says it."""
    if order.priority_said or official is None:
        return order
    printed = next((summary for summary in official.summaries if summary.id == order.id), None)
    said = printed is not None and printed.items.get("priority", "").isdigit()
    return replace(order, priority=_priority(printed), priority_said=True) if printed and said else order


def _submissions(
    parts: Sequence[Trial], stock: Stock, file: object
) -> tuple[tuple[KitSubmission, ...], bool]:
    """What was handed in, and whether it is known from the simulator's own messages alone.

    A recorder's messages count first, then the simulator's, then an official text, which has no contents.

    Raises:
        LogError: Two logs contradict each other, or messages leave out what the simulator shows.
    """
    found = [(submissions_of(part), part.official is None) for part in parts if part.submissions]
    recorded = [group for group, of_recorder in found if of_recorder]
    _refuse_left_out([s for group in recorded for s in group], stock, file)
    called = submissions_called(parts)
    if not recorded and (stock.submissions or stock.witnessed):
        return _with_called(stock.submissions, called), True
    groups = recorded or [group for group, _ in found]
    with_contents = [group for group in groups if any(s.contents is not None for s in group)]
    return only("submissions", with_contents or groups, file) or called, False


def _with_called(
    shown: Sequence[KitSubmission], called: Sequence[KitSubmission]
) -> tuple[KitSubmission, ...]:
    """What the simulator shows, and calls that it accepted of which it shows nothing."""
    names = {s.item_id for s in shown}
    more = [s for s in called if s.item_id not in names]
    return tuple(sorted([*shown, *more], key=lambda s: s.submitted_s))


def _still_open(stock: Stock, submissions: Sequence[KitSubmission]) -> Iterator[OpenTasks]:
    """Tasks that nothing shows to have been handed in."""
    known = {s.item_id for s in submissions}
    for tasks in stock.open:
        if tasks.ids - known:
            yield replace(tasks, ids=tasks.ids - known)


def _refuse_left_out(recorded: Sequence[KitSubmission], stock: Stock, file: object) -> None:
    for shown in stock.submissions if recorded else ():
        times = [s.submitted_s for s in recorded if s.item_id == shown.item_id]
        if not any(abs(t_s - shown.submitted_s) <= _SAME_SUBMISSION_S for t_s in times):
            raise LogError(
                f"the simulator printed that {shown.item_id!r} was handed in at {shown.submitted_s:.3f} s, "
                "and the recorder's messages do not have that",
                file=file,
                hint="they are not all there: score the recording without /ariac_score/submissions",
            )


def _without_calls(part: Trial) -> Trial:
    """A part without what a run of 2025 has read of it: submissions, and calls of its services."""
    records = tuple(record for record in part.records if not isinstance(record, ServiceCall))
    return replace(part, submissions=(), records=records)


def _with_run(merged: Trial, run: Run, file: object) -> Trial:
    """The trial with what the simulator of 2025 counts.

    Raises:
        LogError: The configuration asks for other numbers.
    """
    for name in ("num_kits", "num_modules"):
        if merged.facts.get(name, run.facts[name]) != run.facts[name]:
            raise LogError(
                f"the configuration has {name} {merged.facts[name]}, the simulator {run.facts[name]:g}",
                file=file,
                hint="a bundle is one trial: leave out the configuration of another",
            )
    return replace(
        merged,
        events=tuple(sorted({*merged.events, *run.events})),
        facts={**run.facts, **merged.facts},
        official=run.official,
    )


def _official(
    text: OfficialResult | None, said: OfficialResult | None, file: object
) -> OfficialResult | None:
    """The official result of a file, else that of the console, which must not be another.

    Raises:
        LogError: They differ in a score.
    """
    if text is None or said is None:
        return text or said
    scores = {order_id: score for order_id, score in said.orders.items() if order_id in text.orders}
    other = sorted(order_id for order_id, score in scores.items() if text.orders[order_id] != score)
    if other:
        raise LogError(
            f"{text.source} gives order {other[0]!r} {text.orders[other[0]]:g} points, "
            f"the console {scores[other[0]]:g}",
            file=file,
            hint="a bundle is one trial: leave out the text that belongs to another",
        )
    return text


def _each_once(records: Sequence[Record]) -> tuple[Record, ...]:
    """The records, two files of which may list the same; without what was read off already."""
    listed = [record for record in records if isinstance(record, FaultyProducts)]
    bills = [record for record in records if isinstance(record, SensorBill)]
    once = (FaultyProducts, SensorBill, *_READ_OFF)
    others = (record for record in records if not isinstance(record, once))
    return (*others, *listed[:1], *bills[:1])


def _with_sensors(team: TeamSetup | None, counted: Mapping[str, str] | None) -> TeamSetup | None:
    """The team with the sensors of its configuration, or else those that a record counts."""
    if counted is None or (team is not None and team.sensors is not None):
        return team
    return replace(team or TeamSetup(), sensors=counted)


def _other_sensors(team: TeamSetup | None, counted: Mapping[str, str] | None) -> Iterator[LogDefect]:
    """Whether a record counts other sensors than are configured; by type, for the names always differ."""
    configured = None if team is None else team.sensors
    if configured is None or counted is None or sorted(configured.values()) == sorted(counted.values()):
        return
    message = (
        f"the record counts {len(counted)} sensors, the team configuration has {len(configured)}, "
        "or of other types; the configured ones were kept"
    )
    yield LogDefect("other_sensors", "team", 1, message)
