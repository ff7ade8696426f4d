"""From what a simulator printed to submissions, the official result, start and end of the competition."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ariac_score import (
    ARM_COLLISION,
    COMPETITION_ENDED,
    PART_DROPPED,
    Event,
    LogDefect,
    LogError,
    OfficialOrder,
    OfficialResult,
    Trial,
)
from ariac_score_ariac.kits import RecordedKits
from ariac_score_ariac.official.ariac_text import printed_score
from ariac_score_ariac.official.places import place_of
from ariac_score_ariac.service_calls import submissions_called
from ariac_score_ariac.stock.agv_states import AGVS, AgvState, deliveries_shown
from ariac_score_ariac.stock.console import (
    CONSOLE,
    GAZEBO,
    TASK_MANAGER,
    Said,
    said_by,
)
from ariac_score_ariac.stock.deliveries import (
    Delivery,
    arm_contacts_said,
    completions_said,
    deliveries_said,
)
from ariac_score_ariac.stock.evidence import Evidence
from ariac_score_ariac.stock.naming import named_submissions
from ariac_score_ariac.stock.score_steps import ScoreSeen, ScoreSteps
from ariac_score_ariac.stock.verdicts import Verdicts, verdicts_of
from ariac_score_ariac.work import Kit, KitSubmission, OpenTasks, Order, Tray, orders_of

__all__ = ["Stock", "stock_of"]

_WHERE = "/rosout"


@dataclass(frozen=True)
class Stock:
    """What the simulator's own messages say of a trial.

    Attributes:
        submissions: What was handed in, as far as it is known as what.
        official: The official result as printed; `None` where none is.
        witnessed: What would have been printed, had it happened.
        events: What is printed with its time.
        open: Tasks of which nobody knows whether they were handed in, and why.
        defects: What is irregular about it.
    """

    submissions: tuple[KitSubmission, ...] = ()
    official: OfficialResult | None = None
    witnessed: frozenset[str] = frozenset()
    events: tuple[Event, ...] = ()
    open: tuple[OpenTasks, ...] = ()
    defects: tuple[LogDefect, ...] = field(default=())


def stock_of(merged: Trial, parts: Sequence[Trial], orders: Sequence[Order], file: object) -> Stock:
    """What the simulator's own messages say.

    Args:
        merged: With its events.
        parts: What each log shows, on one clock.
        orders: Of the trial.
        file: The bundle, for error messages.

    Raises:
        LogError: What is printed contradicts itself.
    """
    if not any(CONSOLE in part.witnessed for part in parts):
        return _of_agvs(merged, parts, orders)
    said = {node: said_by(parts, node) for node in (TASK_MANAGER, GAZEBO)}
    try:
        verdicts = verdicts_of(said[TASK_MANAGER])
    except LogError as error:
        raise LogError(error.cause, file=file, place=_WHERE, hint=error.hint) from None
    # Silence of a node shows nothing unless the node is heard at all: it prints each announcement.
    if said[TASK_MANAGER]:
        return _of_task_manager(merged, verdicts, orders)
    return _of_gazebo(merged, parts, said[GAZEBO], orders) if said[GAZEBO] else Stock()


# 2023 and 2024 --------------------------------------------------------------------------


def _of_task_manager(merged: Trial, verdicts: Verdicts | None, orders: Sequence[Order]) -> Stock:
    printed = verdicts.orders if verdicts else {}
    ended_s = merged.ended_s
    events: tuple[Event, ...] = ()
    if verdicts is not None and verdicts.ended_s is not None and _dates_the_end(verdicts.ended_s, merged):
        ended_s, events = verdicts.ended_s, (Event(verdicts.ended_s, COMPETITION_ENDED),)
    silent = _silent(verdicts, orders, ended=ended_s is not None)
    missing = [order for order in orders if order.id not in printed and order.id not in silent]
    # Nothing was printed of them, where something would have been.
    refused = {o.id: OfficialOrder(o.id, kind=_kind(o), submitted=False, score=0) for o in missing}
    kept = {order.id: order for order in orders}
    timed = {o.id: _timed(merged, verdicts, o, kept.get(o.id)) for o in printed.values()} if verdicts else {}
    summaries = {**timed, **refused}
    official = None
    if verdicts is not None or refused:
        base = verdicts.result if verdicts else OfficialResult(_WHERE, None, None)
        total = base.total
        if total is None and not silent:
            total = sum((o.score for o in summaries.values() if o.score is not None), 0)
        official = replace(base, total=total, summaries=tuple(summaries.values()))
    submissions = tuple(
        _submission(merged, verdicts, order, kept.get(order.id))
        for order in printed.values()
        if order.submitted and verdicts
    )
    return Stock(
        tuple(sorted(submissions, key=lambda s: s.submitted_s)),
        official,
        frozenset({"submissions"}),
        events,
        tuple(OpenTasks(frozenset({order_id}), why) for order_id, why in silent.items()),
    )


def _silent(verdicts: Verdicts | None, orders: Sequence[Order], *, ended: bool) -> dict[str, str]:
    """Orders without a verdict that may have been handed in all the same, and why."""
    printed = verdicts.orders if verdicts else {}
    if verdicts and verdicts.lists_every_order:
        return {}
    silent = {}
    for order in orders:
        if order.id in printed:
            continue
        if not ended:
            silent[order.id] = "the recording stops before the end of the competition"
        elif _kind(order) == "combined" and (verdicts is None or verdicts.dashed):
            silent[order.id] = (
                "the simulator prints nothing when a combined order is handed in, "
                "and the text of the end is not recorded"
            )
    return silent


def _kind(order: Order) -> str:
    return order.tasks[0].kind if order.tasks else ""


def _submission(
    merged: Trial, verdicts: Verdicts, printed: OfficialOrder, order: Order | None
) -> KitSubmission:
    task = order.tasks[0] if order is not None and order.tasks else None
    number = printed.items.get("agv", ""), printed.items.get("station", "")
    agv, station = (f"{w}{n}" if n.isdigit() else "" for w, n in zip(("agv", "as"), number, strict=True))
    if task is not None and task.kind == "kitting":
        right = printed.items.get("correct_destination", "").lower()
        station = {"yes": task.station, "no": "another destination"}.get(right, "")
    return KitSubmission(
        printed.id,
        _handed_in_s(merged, verdicts, printed, order),
        agv=agv,
        station=station,
        tray=_tray(printed, order),
    )


def _timed(merged: Trial, verdicts: Verdicts, printed: OfficialOrder, order: Order | None) -> OfficialOrder:
    """A verdict of 2023 with its times as recorded: they are printed of the last order alone."""
    if merged.started_s is None or order is None or order.announced_s is None or not printed.submitted:
        return printed
    if printed.announced_s is not None or printed.submitted_s is not None:
        return printed
    handed_in_s = _handed_in_s(merged, verdicts, printed, order)
    return replace(
        printed,
        announced_s=order.announced_s - merged.started_s,
        submitted_s=handed_in_s - merged.started_s,
    )


def _tray(printed: OfficialOrder, order: Order | None) -> Tray | None:
    """The ordered tray, where its points are printed; of another one the number is not."""
    said = printed.items.get("tray_score", printed.items.get("correct_tray", "")).lower()
    right = said == "yes" or (said.isdigit() and int(said) > 0)
    return order.tasks[0].tray if right and order is not None and order.tasks else None


def _handed_in_s(merged: Trial, verdicts: Verdicts, printed: OfficialOrder, order: Order | None) -> float:
    """When an order was handed in, s of trial time; printed times are exact, and count first."""
    announced_s, submitted_s = printed.announced_s, printed.submitted_s
    if order is not None and order.announced_s is not None and None not in (announced_s, submitted_s):
        assert announced_s is not None
        assert submitted_s is not None
        return order.announced_s + float(submitted_s) - float(announced_s)
    if printed.id in verdicts.said_s:
        return verdicts.said_s[printed.id]
    if submitted_s is not None:
        return (merged.started_s or 0.0) + float(submitted_s)
    return verdicts.ended_s or 0.0


# 2017 to 2022 ---------------------------------------------------------------------------


def _of_gazebo(merged: Trial, parts: Sequence[Trial], said: Sequence[Said], orders: Sequence[Order]) -> Stock:
    score = printed_score([(message.t_s, message.text) for message in said], Path(_WHERE))
    official = score.official if score else None
    events = list(_contacts(said))
    if score is not None:
        dated = {event.kind for event in events}
        events += [e for e in score.events if e.kind not in dated and e.kind not in _OF_STATE]
        end_s = next((e.t_s for e in score.events if e.kind == COMPETITION_ENDED), None)
        if end_s is not None and _dates_the_end(end_s, merged):
            events.append(Event(end_s, COMPETITION_ENDED))
    ends = [event.t_s for event in events if event.kind == COMPETITION_ENDED]
    ended_s = min(ends, default=merged.ended_s)
    deliveries = _with_boxes(deliveries_said(said), parts)
    printed = _submitted(official, orders)
    evidence = Evidence(
        completions_said(said),
        printed,
        _seen(parts),
        _steps(
            merged, parts, events, orders, counts_drops=PART_DROPPED in (score.witnessed if score else ())
        ),
        ended_s,
    )
    named = named_submissions(deliveries, orders, evidence)
    witnessed = {"submissions"} | set(score.witnessed if score else ())
    # Printed from 2019 on: there orders may name an AGV, and kits that leave have no name.
    named_agvs = any(task.agv != "any" or task.station for order in orders for task in order.tasks)
    if named_agvs or any(not delivery.shipment for delivery in deliveries):
        witnessed.add(ARM_COLLISION)
    return Stock(named.submissions, official, frozenset(witnessed), tuple(events), named.open, named.defects)


def _of_agvs(merged: Trial, parts: Sequence[Trial], orders: Sequence[Order]) -> Stock:
    """What left where nothing is printed: by the states of all AGVs there are, or nothing."""
    to_stations = any(task.station for order in orders for task in order.tasks)
    names = AGVS if to_stations else AGVS[:2]  # four of them from 2021 on, as are stations
    if not orders or not {f"{agv}_state" for agv in names} <= merged.witnessed:
        return Stock()
    if any(part.submissions for part in parts) or submissions_called(parts):
        return Stock()  # these name what was handed in
    states = [record for part in parts for record in part.records if isinstance(record, AgvState)]
    start_s = min((o.announced_s for o in orders if o.announced_s is not None), default=0.0)
    deliveries = deliveries_shown(states, names, start_s, merged.ended_s)
    if deliveries is None:
        return Stock()
    steps = _steps(merged, parts, merged.events, orders, counts_drops=False)
    evidence = Evidence((), None, _seen(parts), steps, merged.ended_s, console=False)
    named = named_submissions(deliveries, orders, evidence)
    witnessed = {"submissions"} | ({ARM_COLLISION} if steps and steps.show_no_contact else set())
    return Stock(named.submissions, None, frozenset(witnessed), (), named.open, named.defects)


def _seen(parts: Sequence[Trial]) -> Callable[[str, float], Kit | None]:
    kits = RecordedKits(record for part in parts for record in part.records if isinstance(record, Kit))
    return lambda place, t_s: kits.seen(place, t_s, max_age_s=_LATEST_S) if place else None


def _steps(
    merged: Trial,
    parts: Sequence[Trial],
    events: Sequence[Event],
    orders: Sequence[Order],
    *,
    counts_drops: bool,
) -> ScoreSteps | None:
    """The steps of the score; `None` where it is not recorded, or an update of an order may change it."""
    seen = [record for part in parts for record in part.records if isinstance(record, ScoreSeen)]
    if not seen or any(order.updates for part in parts for order in orders_of(part)):
        return None
    contacts = [event.t_s for event in events if event.kind == ARM_COLLISION]
    ends = [merged.ended_s] if merged.ended_s is not None else []
    drops = 0.0
    if any(task.station for order in orders for task in order.tasks):  # from 2021 on what falls costs points
        drops = float(sum(event.kind == PART_DROPPED for event in events)) if counts_drops else float("inf")
    return ScoreSteps(seen, until_s=min([*contacts, *ends], default=float("inf")), unseen_drops=drops)


def _submitted(official: OfficialResult | None, orders: Sequence[Order]) -> dict[str, dict[str, str]] | None:
    """What the final score prints of each submitted shipment; `None` where it leaves out an order."""
    printed = {summary.id: summary for summary in official.summaries} if official else {}
    # As where the recording cuts it off: then it says nothing of the shipments of that order.
    if official is None or any(order.id not in printed for order in orders):
        return None
    found: dict[str, dict[str, str]] = {}
    for order in orders:
        blocks: dict[str, dict[str, str]] = {}
        for path, value in printed[order.id].items.items():
            block, _, label = path.rpartition("/")
            blocks.setdefault(block, {})[label] = value
        for block, values in blocks.items():
            if block and "true" in (values.get("submitted"), values.get("shipped")):
                # 2019 and 2020 print no name of what was submitted, but keep the order of the alphabet.
                place, _ = place_of(order, "submission", values.get("id", ""))
                found[place.rpartition("/")[2]] = values
    return found


def _dates_the_end(printed_s: float, merged: Trial) -> bool:
    """Whether the line of the end is the first that shows it: states are published each tenth of a second."""
    return merged.ended_s is None or 0 < merged.ended_s - printed_s <= _STATE_LATE_S


_STATE_LATE_S = 0.5
"""A topic of ten messages a second says so late at most what had happened, with a loaded machine."""
_LATEST_S = 1.0
"""Contents that are older do not tell one kit from another; trays are seen once a second."""
_ONE_CONTACT_S = 0.5
_OF_STATE = ("competition_started", "competition_ended", "order_announced")


def _contacts(said: Sequence[Said]) -> list[Event]:
    """Contacts between arms; lines that follow each other at once are about one."""
    events: list[Event] = []
    last_s = float("-inf")
    for t_s, names in arm_contacts_said(said):
        if t_s - last_s > _ONE_CONTACT_S:
            events.append(Event(t_s, ARM_COLLISION, "", names))
        last_s = t_s
    return events


def _with_boxes(deliveries: Sequence[Delivery], parts: Sequence[Trial]) -> list[Delivery]:
    """The deliveries of 2018 with their box: the one that vanishes, or the only one that is not empty."""
    kits = [record for part in parts for record in part.records if isinstance(record, Kit)]
    boxes: dict[str, list[Kit]] = {}
    for kit in kits:
        if kit.place.startswith("box"):
            boxes.setdefault(kit.place, []).append(kit)
    taken: set[str] = set()
    found: list[Delivery] = []
    for delivery in deliveries:
        if delivery.agv or not delivery.shipment:
            found.append(delivery)
            continue
        box = _box_taken(boxes, taken, delivery.t_s)
        taken |= {box} if box else set()
        found.append(replace(delivery, agv=box))
    return found


def _box_taken(boxes: dict[str, list[Kit]], taken: set[str], t_s: float) -> str:
    """Which box left at a time; empty where several may have."""
    seen = {
        name: [kit for kit in kits if kit.t_s <= t_s]
        for name, kits in sorted(boxes.items())
        if name not in taken
    }
    seen = {name: kits for name, kits in seen.items() if kits}
    gone = [name for name in seen if boxes[name][-1].t_s <= t_s + _STILL_SEEN_S]
    if len(gone) == 1:
        return gone[0]
    full = [name for name in seen if max(seen[name], key=lambda kit: kit.t_s).contents]
    return full[0] if len(full) == 1 else ""


_STILL_SEEN_S = 15.0
"""The drone takes its box away within this time, and messages about the box end."""
