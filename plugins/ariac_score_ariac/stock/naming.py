"""Which shipments the kits were that left on AGVs, where the simulator prints the AGV alone."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field

from ariac_score import LogDefect
from ariac_score_ariac.stock.deliveries import Completion, Delivery
from ariac_score_ariac.work import KitSubmission, OpenTasks, Order, Task

__all__ = ["Named", "named_deliveries"]

_AT_ONCE_S = 0.2
"""An order is complete one step after its last kit was handed in; both are printed at once."""
_UNFINISHED = "the recording stops before the end of the competition"
_UNNAMED = "kits left, and the simulator does not print as which shipment"
_ASSEMBLY = "the simulator prints nothing when an assembly is handed in"


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
    submitted: Collection[str] | None,
    ended: bool,
) -> Named:
    """The kits that left, with their shipments.

    Args:
        deliveries: In order of time.
        completions: Of orders, in order of time.
        orders: Of the trial.
        submitted: The shipments that the final score lists as submitted; `None` where none is printed.
        ended: Whether the recording goes on until the end of the competition.
    """
    certain = [_submission(d, d.shipment) for d in deliveries if d.shipment]
    unnamed = [d for d in deliveries if not d.shipment]
    found = _Matching(unnamed, completions, orders, submitted)
    known = sorted([*certain, *found.submissions()], key=lambda s: s.submitted_s)
    claimed = {s.item_id for s in known}
    why: dict[str, str] = {}
    for task in (task for order in orders for task in order.tasks):
        if task.id in claimed:
            continue
        if task.kind == "assembly":
            if submitted is None or task.id in submitted:
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


class _Matching:
    """Deliveries and kits that go together, as far as completions and the final score leave one way only."""

    def __init__(
        self,
        deliveries: Sequence[Delivery],
        completions: Sequence[Completion],
        orders: Sequence[Order],
        submitted: Collection[str] | None,
    ) -> None:
        self._deliveries = deliveries
        kits = {task.id: (order, task) for order in orders for task in order.tasks if task.kind == "kitting"}
        complete = {c.order: c.t_s for c in completions if "kitting" in c.kinds}
        self._sure = {
            name for name, (order, _) in kits.items() if order.id in complete or name in (submitted or ())
        }
        self._candidates = [
            {name for name, of in kits.items() if _possible(d, *of, complete, submitted)} for d in deliveries
        ]
        for order_id, t_s in complete.items():
            self._complete(t_s, {name for name, (order, _) in kits.items() if order.id == order_id})
        self._found: dict[int, str] = {}
        self._settle()

    def _complete(self, t_s: float, kits: set[str]) -> None:
        """The last delivery before an order was complete is one of its kits; later ones do not count."""
        last = [i for i, d in enumerate(self._deliveries) if 0 <= t_s - d.t_s <= _AT_ONCE_S]
        if last:
            self._candidates[last[-1]] &= kits
        if last and len(kits) == 1:
            for i in range(len(self._deliveries)):
                self._candidates[i] -= kits if i != last[-1] else set()
        for i, delivery in enumerate(self._deliveries):
            if delivery.t_s > t_s:
                self._candidates[i] -= kits

    def _settle(self) -> None:
        while fresh := self._forced():
            for i, name in fresh.items():
                self._found[i] = name
                for candidates in self._candidates:
                    candidates.discard(name)
                self._candidates[i] = set()

    def _forced(self) -> dict[int, str]:
        """A kit that was surely handed in, and by one delivery only."""
        for name in sorted(self._sure - set(self._found.values())):
            where = [i for i, candidates in enumerate(self._candidates) if name in candidates]
            if len(where) == 1:
                return {where[0]: name}
        return {}

    def submissions(self) -> list[KitSubmission]:
        return [_submission(self._deliveries[i], name) for i, name in sorted(self._found.items())]

    def possible(self) -> set[str]:
        """Kits that a delivery without a name may have been."""
        return {name for candidates in self._candidates for name in candidates} | (
            self._sure - set(self._found.values())
        )


def _possible(
    delivery: Delivery,
    order: Order,
    task: Task,
    complete: Collection[str],
    submitted: Collection[str] | None,
) -> bool:
    """Whether a delivery may have been a kit: announced by then, and not known to be never handed in."""
    if order.announced_s is not None and delivery.t_s < order.announced_s:
        return False
    if submitted is not None and task.id not in submitted:
        return False
    # Its only kit, and the order was never complete.
    return not (_alone(order.tasks) and order.id not in complete)


def _alone(tasks: Iterable[Task]) -> bool:
    kinds = [task.kind for task in tasks]
    return kinds == ["kitting"]
