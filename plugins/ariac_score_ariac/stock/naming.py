"""Which shipments the kits were that left on AGVs, where the simulator prints the AGV alone.

A way to name the deliveries is possible where it agrees with all that is recorded: announcements, the lines
that orders are complete, and what the final score prints of each shipment. What all possible ways have in
common is a fact; what they differ in is open.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from ariac_score import LogDefect
from ariac_score_ariac.stock.deliveries import Completion, Delivery
from ariac_score_ariac.work import Kit, KitSubmission, OpenTasks, Order, Task

__all__ = ["Named", "Printed", "named_deliveries"]

_AT_ONCE_S = 0.2
"""An order is complete one step after its last kit was handed in; both are printed at once."""
_UNFINISHED = "the recording stops before the end of the competition"
_UNNAMED = "kits left, and the simulator does not print as which shipment"
_ASSEMBLY = "the simulator prints nothing when an assembly is handed in"


_MOST_WAYS = 20_000
"""Steps of the search; beyond them all is open."""

Printed = Mapping[str, Mapping[str, str]]
"""What the final score prints of each shipment, by label."""


@dataclass(frozen=True)
class Named:
    """What was handed in, as far as it is known.

    Attributes:
        submissions: With the shipment, in order of time.
        open: Tasks that may have been handed in or not.
        defects: What is irregular.
    """

    submissions: tuple[KitSubmission, ...] = ()
    open: tuple[OpenTasks, ...] = ()
    defects: tuple[LogDefect, ...] = field(default=())


def named_deliveries(
    deliveries: Sequence[Delivery],
    completions: Sequence[Completion],
    orders: Sequence[Order],
    *,
    printed: Printed | None,
    kits: Sequence[Kit | None],
    ended: bool,
) -> Named:
    """The kits that left, with their shipments.

    Args:
        deliveries: In order of time.
        completions: Of orders, in order of time.
        orders: Of the trial.
        printed: Of the shipments that were submitted; `None` where no final score is printed.
        kits: What lay on the AGV of each delivery, where that is recorded.
        ended: Whether the recording goes on until the end of the competition.
    """
    certain = [_submission(d, d.shipment) for d in deliveries if d.shipment]
    unnamed = [(d, kit) for d, kit in zip(deliveries, kits, strict=True) if not d.shipment]
    found = _Ways(unnamed, completions, orders, printed)
    known = sorted([*certain, *found.submissions()], key=lambda s: s.submitted_s)
    claimed = {s.item_id for s in known}
    why: dict[str, str] = {}
    for task in (task for order in orders for task in order.tasks):
        if task.id in claimed:
            continue
        if task.kind == "assembly":
            if printed is None or task.id in printed:
                why[task.id] = _ASSEMBLY
        elif task.id in found.possible():
            why[task.id] = _UNNAMED
        elif not ended:
            why[task.id] = _UNFINISHED
    reasons = sorted(set(why.values()))
    opened = [OpenTasks(frozenset(t for t in why if why[t] == reason), reason) for reason in reasons]
    left_over = len(unnamed) - len(found.submissions())
    message = "kits left, and nothing recorded says as which shipment"
    defects = (LogDefect("unnamed_submission", "/rosout", left_over, message),) if left_over else ()
    return Named(tuple(known), tuple(opened), defects)


def _submission(delivery: Delivery, shipment: str) -> KitSubmission:
    return KitSubmission(shipment, delivery.t_s, agv=delivery.agv, station=delivery.station)


class _Ways:
    """The ways to name deliveries that agree with what is recorded."""

    def __init__(
        self,
        deliveries: Sequence[tuple[Delivery, Kit | None]],
        completions: Sequence[Completion],
        orders: Sequence[Order],
        printed: Printed | None,
    ) -> None:
        self._deliveries = [delivery for delivery, _ in deliveries]
        kits = {task.id: (order, task) for order in orders for task in order.tasks if task.kind == "kitting"}
        complete = {c.order: c.t_s for c in completions if "kitting" in c.kinds}
        sure = {name for name, (order, _) in kits.items() if order.id in complete or name in (printed or ())}
        candidates = {
            name: [
                i
                for i, (delivery, kit) in enumerate(deliveries)
                if _possible(delivery, order, task, complete, printed)
                and (printed is None or _agrees(delivery, kit, task, printed.get(name, {})))
            ]
            for name, (order, task) in kits.items()
        }
        self._last = [
            ({name for name, (order, _) in kits.items() if order.id == order_id}, t_s)
            for order_id, t_s in complete.items()
        ]
        self._places = self._of_all_ways(sorted(sure), candidates)
        self._maybe = {name for name in kits if name not in sure and candidates[name]}

    def _of_all_ways(
        self, sure: Sequence[str], candidates: Mapping[str, Sequence[int]]
    ) -> dict[str, set[int]] | None:
        """For each kit that was surely handed in its possible deliveries; `None`: too many ways."""
        places: dict[str, set[int]] = {name: set() for name in sure}
        steps = 0
        pending: list[dict[str, int]] = [{}]
        while pending:
            way = pending.pop()
            steps += 1
            if steps > _MOST_WAYS:
                return None
            if len(way) == len(sure):
                if self._is_complete_in_time(way):
                    for name, i in way.items():
                        places[name].add(i)
                continue
            name = sure[len(way)]
            pending += [{**way, name: i} for i in candidates[name] if i not in way.values()]
        return places

    def _is_complete_in_time(self, way: Mapping[str, int]) -> bool:
        """Whether each order is complete in it just when its completion was printed."""
        for kits, t_s in self._last:
            times = [self._deliveries[way[name]].t_s for name in kits if name in way]
            if times and not 0 <= t_s - max(times) <= _AT_ONCE_S:
                return False
        return True

    def submissions(self) -> list[KitSubmission]:
        """What all possible ways have in common."""
        sure = [(next(iter(i)), name) for name, i in (self._places or {}).items() if len(i) == 1]
        return [_submission(self._deliveries[i], name) for i, name in sorted(sure)]

    def possible(self) -> set[str]:
        """Kits that a delivery without a name may have been."""
        named = {s.item_id for s in self.submissions()}
        taken = {i for places in (self._places or {}).values() if len(places) == 1 for i in places}
        # Every delivery is named: what is left was not handed in.
        if self._places is not None and len(taken) == len(self._deliveries):
            return set()
        return ({*(self._places or {})} | self._maybe) - named if self._deliveries or self._places else set()


def _agrees(delivery: Delivery, kit: Kit | None, task: Task, printed: Mapping[str, str]) -> bool:
    """Whether a delivery can have been a kit of which the final score prints this."""
    for label, wanted, got in (
        ("delivered_to_correct_agv", task.agv, delivery.agv),
        ("used_correct_agv", task.agv, delivery.agv),
        ("sent_to_correct_station", task.station, delivery.station),
    ):
        if label in printed and (printed[label] == "true") != (wanted in ("any", got)):
            return False
    for label in ("product_presence_score", "product_color_presence_score"):
        if kit is not None and printed.get(label, "").isdigit() and int(printed[label]) != _right(kit, task):
            return False
    return True


def _right(kit: Kit, task: Task) -> int:
    """How many of the ordered products lie there: the scorers of 2019 to 2021 count them by exact type."""
    wanted = Counter(product.type for product in task.products)
    found = Counter(product.type.rpartition(":")[2] for product in kit.contents if not product.faulty)
    return (wanted & found).total()


def _possible(
    delivery: Delivery,
    order: Order,
    task: Task,
    complete: Collection[str],
    printed: Printed | None,
) -> bool:
    """Whether a delivery may have been a kit: announced by then, and not known to be never handed in."""
    if order.announced_s is not None and delivery.t_s < order.announced_s:
        return False
    if printed is not None and task.id not in printed:
        return False
    # Its only kit, and the order was never complete.
    return not (_alone(order.tasks) and order.id not in complete)


def _alone(tasks: Iterable[Task]) -> bool:
    kinds = [task.kind for task in tasks]
    return kinds == ["kitting"]
