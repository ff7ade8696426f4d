"""Which shipments the kits were that left on AGVs, where the simulator prints the AGV alone.

A way to name the deliveries is possible where it agrees with all that is recorded: announcements, the lines
that orders are complete, the steps of the score, and what the final score prints of each shipment. What all
possible ways have in common is a fact; what they differ in is open.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from ariac_score import LogDefect
from ariac_score_ariac.stock.assemblies import named_assemblies
from ariac_score_ariac.stock.deliveries import Delivery
from ariac_score_ariac.stock.evidence import Evidence
from ariac_score_ariac.stock.stack import AT_ONCE_S, OrderStack
from ariac_score_ariac.stock.ways import Way, Ways
from ariac_score_ariac.work import Kit, KitSubmission, OpenTasks, Order, Task

__all__ = ["Named", "named_submissions"]

_UNFINISHED = "the recording stops before the end of the competition"
_UNNAMED = "kits left, and the simulator does not print as which shipment"
_IN_PLACE = "the console is not recorded, and no course of the score shows that nothing else was handed in"
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


def named_submissions(deliveries: Sequence[Delivery], orders: Sequence[Order], evidence: Evidence) -> Named:
    """What was handed in, with its shipments.

    Args:
        deliveries: The kits that left, in order of time.
        orders: Of the trial.
        evidence: What else is recorded.
    """
    unnamed = [delivery for delivery in deliveries if not delivery.shipment]
    found = _Kits(unnamed, orders, evidence)
    certain = [_submission(d, d.shipment) for d in deliveries if d.shipment]
    known = [*certain, *found.submissions()]
    kits_left = set(evidence.printed or ()) - {s.item_id for s in known}
    known += named_assemblies(orders, evidence, deliveries, kits_left)
    claimed = {s.item_id for s in known}
    why: dict[str, str] = {}
    times_s = [delivery.t_s for delivery in deliveries]
    for task in (task for order in orders for task in order.tasks if task.id not in claimed):
        if task.kind == "assembly":
            if evidence.printed is None or task.id in evidence.printed:
                why[task.id] = _ASSEMBLY
        elif task.id in found.possible():
            why[task.id] = _UNNAMED
        elif evidence.ended_s is None:
            why[task.id] = _UNFINISHED
        elif not evidence.console and not (evidence.steps and evidence.steps.are_all(times_s)):
            why[task.id] = _IN_PLACE
    reasons = sorted(set(why.values()))
    opened = [OpenTasks(frozenset(t for t in why if why[t] == reason), reason) for reason in reasons]
    left_over = len(unnamed) - len(found.submissions())
    message = "kits left, and nothing recorded says as which shipment"
    where = "/rosout" if evidence.console else "states of AGVs"
    defects = (LogDefect("unnamed_submission", where, left_over, message),) if left_over else ()
    return Named(tuple(sorted(known, key=lambda s: s.submitted_s)), tuple(opened), defects)


def _submission(delivery: Delivery, shipment: str) -> KitSubmission:
    return KitSubmission(shipment, delivery.t_s, agv=delivery.agv, station=delivery.station)


class _Kits:
    """The kits that left without a name, and what they can have been."""

    def __init__(self, deliveries: Sequence[Delivery], orders: Sequence[Order], evidence: Evidence) -> None:
        self._deliveries, self._evidence = deliveries, evidence
        self._stack = OrderStack(orders, evidence.completions, evidence.ended_s)
        self._kits = {
            task.id: (order, task) for order in orders for task in order.tasks if task.kind == "kitting"
        }
        # An assembly leaves no line of its own; it may be behind a step as well as the kit that left then.
        self._alone = not any(task.kind == "assembly" for order in orders for task in order.tasks)
        self._first = next((order.id for order in orders), "")
        self._worths = [self._worth(delivery) for delivery in deliveries]
        counted = {i for i, worth in enumerate(self._worths) if worth is not None and worth[0] > 0}
        candidates = {
            name: [i for i in range(len(deliveries)) if self._may_be(i, order, task)]
            for name, (order, task) in self._kits.items()
        }
        sure = {name for name in self._kits if self._was_handed_in(name)}
        self._maybe = {name for name in self._kits if name not in sure and candidates[name]}
        # Only what raised the score must have been one of those that are not known to be handed in.
        tried = {
            name: candidates[name] for name in self._kits if name in sure or counted & {*candidates[name]}
        }
        alike = {name: self._sameness(name) for name in tried}
        self._places = Ways(tried, self._maybe, counted, alike, self._is_complete_in_time).places()

    def submissions(self) -> list[KitSubmission]:
        """What all possible ways have in common."""
        sure = [
            (i, name) for name, places in (self._places or {}).items() for i in places if len(places) == 1
        ]
        return [_submission(self._deliveries[i], name) for i, name in sorted(_seen(sure))]

    def possible(self) -> set[str]:
        """Kits that a delivery without a name may have been."""
        named = {s.item_id for s in self.submissions()}
        # Every delivery is named: what is left was not handed in.
        if self._places is not None and len(named) == len(self._deliveries):
            return set()
        never = {name for name, places in (self._places or {}).items() if places == {None}}
        sure = {name for name in self._kits if self._was_handed_in(name)}
        return (sure | self._maybe) - named - never

    def _was_handed_in(self, name: str) -> bool:
        complete = self._stack.complete.get(self._kits[name][0].id)
        return (complete is not None and "kitting" in complete.kinds) or name in (
            self._evidence.printed or ()
        )

    def _worth(self, delivery: Delivery) -> tuple[float, float] | None:
        if self._evidence.steps is None:
            return None
        others_s = [other.t_s for other in self._deliveries if other is not delivery]
        worth = self._evidence.steps.worth(delivery.t_s, others_s)
        return worth if worth is None or self._alone else (0.0, worth[1])

    def _may_be(self, i: int, order: Order, task: Task) -> bool:
        """Whether a delivery may have been a kit, by itself."""
        delivery, printed = self._deliveries[i], self._evidence.printed
        if order.announced_s is not None and delivery.t_s < order.announced_s:
            return False
        if printed is not None and task.id not in printed:
            return False
        only = [other.kind for other in order.tasks] == ["kitting"]
        only = only and self._evidence.console
        if only and order.id not in self._stack.complete and self._stack.would_print(order, delivery.t_s):
            return False
        kit = self._evidence.seen(delivery.agv, delivery.t_s)
        if printed is not None and not _agrees(delivery, kit, task, printed[task.id]):
            return False
        least, most = self._points(delivery, kit, task)
        said = self._evidence.completion(task.id)
        if said is not None:
            if not least <= said <= most:
                return False
            least = most = said
        worth, factors = self._worths[i], self._factors(order, task)
        return worth is None or (worth[0] <= most * factors[1] and least * factors[0] <= worth[1])

    def _factors(self, order: Order, task: Task) -> tuple[float, float]:
        """Least and most times that an order counts."""
        if task.station:  # from 2021 on orders have a priority, which no message says
            return 1.0, float(max(3, order.priority))
        return (1.0, 1.0) if order.id == self._first else (3.0, 3.0)

    def _points(self, delivery: Delivery, kit: Kit | None, task: Task) -> tuple[float, float]:
        """Least and most points of a delivery, had it been a kit, as the scorers from 2019 on count."""
        if task.agv not in ("any", delivery.agv) or task.station not in ("", delivery.station):
            return 0.0, 0.0
        if kit is None:
            return 0.0, float("inf")
        wanted = Counter(product.type for product in task.products)
        sound = (_types(kit, faulty=False) & wanted).total()
        exact = (_types(kit, faulty=True) & wanted).total()
        typed = (_uncoloured(_types(kit, faulty=True)) & _uncoloured(wanted)).total()
        # A wrong colour in a right place counts up to once for every exact type delivered.
        placed = exact + (typed - exact) * max(exact, 1)
        bonus = len(task.products) if exact == len(task.products) else 0
        return sound, typed + exact + placed + bonus

    def _is_complete_in_time(self, way: Way) -> bool:
        """Whether each order is complete in it when its completion was printed."""
        for order in {self._kits[name][0].id: self._kits[name][0] for name in way}.values():
            ending = self._stack.complete.get(order.id)
            if ending is None or "kitting" not in ending.kinds:
                continue
            places = [way[task.id] for task in order.tasks if task.id in way]
            times = [self._deliveries[i].t_s for i in places if i is not None]
            waits = "assembly" in ending.kinds or self._stack.may_be_late(order)
            most_s = float("inf") if waits else AT_ONCE_S
            if times and not 0 <= ending.t_s - max(times) <= most_s:
                return False
        return True

    def _sameness(self, name: str) -> Hashable:
        """What is the same of kits that no score tells from each other."""
        order, task = self._kits[name]
        products = tuple(sorted(repr(replace(product, slot="")) for product in task.products))
        printed = sorted((self._evidence.printed or {}).get(name, {}).items())
        return (
            order.id,
            task.agv,
            task.station,
            repr(task.tray),
            products,
            tuple(printed),
            name in self._maybe,
        )


def _seen(places: Sequence[tuple[int | None, str]]) -> list[tuple[int, str]]:
    return [(i, name) for i, name in places if i is not None]


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
    return (Counter(product.type for product in task.products) & _types(kit, faulty=False)).total()


def _types(kit: Kit, *, faulty: bool) -> Counter[str]:
    """The types of products, with or without faulty ones."""
    return Counter(p.type.rpartition(":")[2] for p in kit.contents if faulty or not p.faulty)


def _uncoloured(types: Counter[str]) -> Counter[str]:
    found: Counter[str] = Counter()
    for name, count in types.items():
        found[name.rpartition("_")[0]] += count
    return found
