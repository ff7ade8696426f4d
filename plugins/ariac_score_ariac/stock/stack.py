"""Which order the simulators of 2017 to 2022 were at: they look at the latest one alone.

An order that is announced interrupts the one before it, and only the latest that is neither complete nor out
of time is looked at. So the line that an interrupted order is complete may come long after its last shipment.

Source: `OnUpdate` of the task managers, `ordersInProgress`.
"""

from __future__ import annotations

from collections.abc import Sequence

from ariac_score_ariac.stock.deliveries import Completion
from ariac_score_ariac.work import Order

__all__ = ["AT_ONCE_S", "OrderStack"]

AT_ONCE_S = 0.2
"""An order is complete one step after its last shipment was handed in; both are printed at once."""


class OrderStack:
    """The orders in progress over time.

    Args:
        orders: Of the trial.
        endings: Lines that say that an order is complete or out of time.
        ended_s: When the competition ended, s of trial time; `None`: nothing says.
    """

    def __init__(self, orders: Sequence[Order], endings: Sequence[Completion], ended_s: float | None) -> None:
        self._orders = list(orders)
        self._ends = {ending.order: ending.t_s for ending in endings}
        self._until_s = float("inf") if ended_s is None else ended_s
        self.complete = {e.order: e for e in endings if e.kinds}

    def may_be_late(self, order: Order) -> bool:
        """Whether its line may come later than its last shipment: another order ended just before."""
        line_s = self.complete[order.id].t_s
        return any(
            0 <= line_s - end_s <= AT_ONCE_S for other, end_s in self._ends.items() if other != order.id
        )

    def would_print(self, order: Order, t_s: float) -> bool:
        """Whether it would be printed that the order is complete, had its last shipment come at a time."""
        ended_s = self._ends.get(order.id)
        if ended_s is not None:
            return ended_s >= t_s
        looks = [t_s, *(end_s for end_s in self._ends.values() if end_s > t_s)]
        return any(look_s + AT_ONCE_S < self._until_s and self._is_latest(order, look_s) for look_s in looks)

    def _is_latest(self, order: Order, t_s: float) -> bool:
        later = self._orders[self._orders.index(order) + 1 :]
        return all(
            (other.announced_s is not None and other.announced_s > t_s)
            or self._ends.get(other.id, float("inf")) <= t_s
            for other in later
        )
