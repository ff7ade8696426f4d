"""Which product types the editions have, and what is ordered although none has it.

Source: rulebooks 2017-2024, orders; ARIAC notes on log formats, sections 7.1 to 7.3.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from ariac_score import LogDefect, did_you_mean
from ariac_score_ariac.config import listed_orders, shipment_orders
from ariac_score_ariac.config.config_values import shown
from ariac_score_ariac.work import Order

__all__ = ["unknown_products"]

_TYPES = {
    range(2017, 2023): ("2017 to 2022", shipment_orders.PRODUCT_TYPES),
    range(2023, 2025): ("2023 and 2024", listed_orders.PRODUCT_TYPES),
}
"""Editions, their name, and their product types; orders of 2025 name none."""


def unknown_products(orders: Iterable[Order], edition: int) -> list[LogDefect]:
    """A defect for each product type that an order names and no edition of this form has."""
    known = next((types for editions, types in _TYPES.items() if edition in editions), None)
    if known is None:
        return []
    years, types = known
    ordered = [
        (order.id, wanted.type) for order in orders for task in order.tasks for wanted in task.products
    ]
    return [
        LogDefect(
            "unknown_product_type",
            order_id,
            count,
            f"{shown(kind)} is no product type of {years}; {did_you_mean(kind, types)}",
        )
        for (order_id, kind), count in sorted(Counter(ordered).items())
        if kind not in types
    ]
