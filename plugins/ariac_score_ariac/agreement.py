"""Whether the orders that a log announces are those of the configuration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ariac_score import ContradictionError, Pose, Trial
from ariac_score_ariac.work import Order, Task, WantedProduct

__all__ = ["is_announced", "refuse_other_orders"]

MOST_M, MOST_RAD = 1e-3, 1e-3
"""How far two statements of a pose may differ: one gives angles, the other a quaternion, rounded."""


def is_announced(orders: Sequence[Order]) -> bool:
    """Whether it is known of any of them when it was announced."""
    return any(order.announced_s is not None for order in orders)


def refuse_other_orders(stating: Sequence[tuple[Trial, Sequence[Order]]], file: object) -> None:
    """Refuse orders that two files of a trial state differently.

    Not every order of a configuration is announced. What a message of an edition lacks, such as
    priority or challenges, contradicts nothing, and neither does a rounded pose.

    Args:
        stating: The parts that have orders, with these.
        file: The trial, for the message.

    Raises:
        ContradictionError: Naming both files and the first thing in which they differ.
    """
    configured = [(part, orders) for part, orders in stating if not is_announced(orders)]
    announced = [(part, orders) for part, orders in stating if is_announced(orders)]
    for part, orders in configured:
        for other, theirs in announced:
            for what, one, said in _differences(orders, theirs):
                raise ContradictionError(what, (_named(part), one), (_named(other), said), file=file)


def _named(part: Trial) -> str:
    return str(part.origin) if part.origin is not None else repr(part.id)


def _differences(configured: Sequence[Order], announced: Sequence[Order]) -> Iterator[tuple[str, str, str]]:
    known = {order.id: order for order in configured}
    for order in announced:
        own = known.get(order.id)
        if own is None:
            yield f"order {order.id!r}", "there is none of that name", "it was announced"
            continue
        if own.priority_said and order.priority_said and own.priority != order.priority:
            yield f"priority of order {order.id!r}", str(own.priority), str(order.priority)
        tasks = {task.id: task for task in own.tasks}
        theirs = {task.id: task for task in order.tasks}
        for name in dict.fromkeys([*tasks, *theirs]):
            if name not in tasks or name not in theirs:
                has = [
                    "it has one" if name in each else "it has none of that name" for each in (tasks, theirs)
                ]
                yield f"shipment {name!r} of order {order.id!r}", has[0], has[1]
            else:
                yield from _of_task(tasks[name], theirs[name])


def _of_task(configured: Task, announced: Task) -> Iterator[tuple[str, str, str]]:
    of = f"of shipment {configured.id!r}"
    for name in ("kind", "agv", "station"):
        one, other = getattr(configured, name), getattr(announced, name)
        if one and other and one != other:
            yield f"{name} {of}", repr(one), repr(other)
    trays = [task.tray.type for task in (configured, announced) if task.tray is not None and task.tray.type]
    if len(set(trays)) > 1:
        yield f"tray {of}", repr(trays[0]), repr(trays[1])
    # In whatever order: mappings of old configurations have none.
    left = list(announced.products)
    lacking = []
    for wanted in configured.products:
        same = next((other for other in left if _agree(wanted, other)), None)
        if same is None:
            lacking.append(wanted)
        else:
            left.remove(same)
    if lacking or left:
        yield f"products {of}", _listed(lacking), _listed(left)


def _agree(one: WantedProduct, other: WantedProduct) -> bool:
    return (
        one.type == other.type
        and (one.quadrant == other.quadrant or 0 in (one.quadrant, other.quadrant))
        and _same_place(one.pose, other.pose)
    )


def _same_place(one: Pose | None, other: Pose | None) -> bool:
    if one is None or other is None:
        return True
    apart = max(abs(a - b) for a, b in zip(one.position_m, other.position_m, strict=True))
    return apart <= MOST_M and one.rotation_to(other) <= MOST_RAD


def _listed(products: Sequence[WantedProduct]) -> str:
    """Those that the other does not have, with what sets them apart."""
    if not products:
        return "nothing more"
    words = []
    for product in products[:3]:
        at = f" in quadrant {product.quadrant}" if product.quadrant else ""
        if product.pose is not None:
            x, y, z = product.pose.position_m
            at += f" at ({x:g}, {y:g}, {z:g}) m, yaw {product.pose.yaw_rad:.3f} rad"
        words.append(f"{product.type}{at}")
    return ", ".join(words) + (f" and {len(products) - 3} more" if len(products) > 3 else "")
