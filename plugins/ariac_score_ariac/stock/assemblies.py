"""Which assemblies were handed in when, by the steps of the score: nothing is printed of one alone.

A step that no kit explains is an assembly, for nothing else raises the score. It was handed in
between two messages of the score, a tenth of a second apart.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence
from dataclasses import replace
from math import dist

from ariac_score_ariac.stock.deliveries import Delivery
from ariac_score_ariac.stock.evidence import Evidence
from ariac_score_ariac.stock.score_steps import Rise
from ariac_score_ariac.stock.stack import AT_ONCE_S
from ariac_score_ariac.stock.ways import Ways
from ariac_score_ariac.work import Kit, KitSubmission, Order, Task

__all__ = ["named_assemblies"]

_SAME_PLACE_M = 1e-3


def named_assemblies(
    orders: Sequence[Order], evidence: Evidence, deliveries: Sequence[Delivery], left: Collection[str]
) -> list[KitSubmission]:
    """The assemblies that were handed in, where the steps of the score leave one way only.

    Args:
        orders: Of the trial.
        evidence: What is recorded; the steps are of use only where the final score is.
        deliveries: The kits that left.
        left: What was handed in by the final score and is not named yet.
    """
    tasks = {
        t.id: (order, t) for order in orders for t in order.tasks if t.kind == "assembly" and t.id in left
    }
    # A kit that is handed in where it stands leaves no line either, and a step as an assembly does.
    if evidence.steps is None or not tasks or set(left) - tasks.keys():
        return []
    rises = evidence.steps.rises([delivery.t_s for delivery in deliveries])
    candidates = {
        name: [i for i, rise in enumerate(rises) if _may_be(rise, order, task, evidence)]
        for name, (order, task) in tasks.items()
    }
    alike: dict[str, Hashable] = {name: _sameness(*tasks[name]) for name in tasks}
    ways = Ways(candidates, tasks.keys(), range(len(rises)), alike, lambda _: True).places() or {}
    named = [(name, i) for name, places in ways.items() for i in places if len(places) == 1]
    found = (_submission(rises[i], *tasks[name], evidence) for name, i in named if i is not None)
    return [submission for submission in found if submission is not None]


def _may_be(rise: Rise, order: Order, task: Task, evidence: Evidence) -> bool:
    if order.announced_s is not None and rise.end_s < order.announced_s:
        return False
    said, times = evidence.completion(task.id), max(3, order.priority)
    if said is not None and not (rise.least <= said * times and said <= rise.most):
        return False
    shown = evidence.seen(task.station, rise.start_s)
    wanted = {_uncoloured(product.type) for product in task.products}
    return shown is None or any(_uncoloured(product.type) in wanted for product in shown.contents)


def _submission(rise: Rise, order: Order, task: Task, evidence: Evidence) -> KitSubmission | None:
    """The assembly as handed in; `None` where it changed within the tenth of a second in which it was."""
    before, after = (evidence.seen(task.station, t_s) for t_s in (rise.start_s, rise.end_s))
    if before is not None and (after is None or not _same(before, after)):
        return None
    lines = [
        ending.t_s
        for ending in evidence.completions
        if ending.order == order.id and rise.start_s <= ending.t_s <= rise.end_s + AT_ONCE_S
    ]
    t_s = min(lines[0], rise.end_s) if lines else max(rise.start_s, order.announced_s or rise.start_s)
    return KitSubmission(task.id, t_s, station=task.station)  # at another station it is worth nothing


def _same(one: Kit, other: Kit) -> bool:
    if [(p.type, p.faulty) for p in one.contents] != [(p.type, p.faulty) for p in other.contents]:
        return False
    poses = [(p.pose, q.pose) for p, q in zip(one.contents, other.contents, strict=True)]
    return all(a == b or (a and b and dist(a.position_m, b.position_m) < _SAME_PLACE_M) for a, b in poses)


def _sameness(order: Order, task: Task) -> Hashable:
    products = tuple(sorted(repr(replace(product, slot="")) for product in task.products))
    return order.id, task.station, products


def _uncoloured(type_: str) -> str:
    return type_.rpartition(":")[2].rpartition("_")[0]
