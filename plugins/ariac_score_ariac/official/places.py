"""Which task or part of an order a block of an official text is about."""

from __future__ import annotations

from ariac_score_ariac.work import Order

__all__ = ["place_of"]


def place_of(order: Order, level: str, name: str) -> tuple[str, str]:
    """The path of what a text calls by a name within an order, and why there is none."""
    return _task_place(order, name) if level == "submission" else _part_place(order, name)


def _task_place(order: Order, name: str) -> tuple[str, str]:
    """A shipment by its id; where the layout prints none, by its alphabetical place."""
    ids = [task.id for task in order.tasks]
    if name in ids:
        return f"{order.id}/{name}", ""
    # ARIAC 2019 and 2020 print no ids; blocks come in alphabetical order: shipment_10 before shipment_2.
    stem, _, position = name.rpartition("_")
    numbered = sorted(f"{stem}_{k}" for k in range(len(ids)))
    if position.isdigit() and name in numbered:
        return f"{order.id}/{sorted(ids)[numbered.index(name)]}", ""
    return f"{order.id}/{name}", "the order has no such shipment"


def _part_place(order: Order, name: str) -> tuple[str, str]:
    """A part by its quadrant, where the one ordered last counts; or by the words of its type."""
    words = name.split("_")
    found = [
        f"{order.id}/{task.id}/{product.slot}"
        for task in order.tasks
        for product in task.products
        if (
            words == ["quadrant", str(product.quadrant)]
            if words[0] == "quadrant"
            else set(words[1:]) <= set(product.type.split("_"))
        )
    ]
    if words[0] == "quadrant":
        found = found[-1:]
    if len(found) == 1:
        return found[0], ""
    count = len(found) or "no"
    return f"{order.id}/{name}", f"{count} ordered products are meant"
