"""What the messages of a competition mean: orders, submissions, events."""

from __future__ import annotations

from typing import Any

from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Order, Pose, Product, Submission, Task, WantedProduct

__all__ = ["AriacScoreRecords", "NistGear2020"]

_STATES = {"go": COMPETITION_STARTED, "end_game": COMPETITION_ENDED}
"""`done` is left out: it follows `end_game`, once everything has been scored."""


class NistGear2020:
    """Messages of ARIAC 2020 (`nist_gear`): announced orders and the state of the competition."""

    def decode(self, msgtype: str, message: Any, t_s: float) -> Order | Event | None:
        """An order, the start or the end of the competition; `None` for anything else.

        An order whose id says that it updates another names that one.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: Its stamp, s of trial time.

        Raises:
            ValueError: A pose in an order is not finite or has no orientation.
        """
        if msgtype == "nist_gear/msg/Order":
            return _order(message, t_s)
        if msgtype == "std_msgs/msg/String" and message.data in _STATES:
            return Event(t_s, _STATES[message.data])
        return None


class AriacScoreRecords:
    """Messages of `ariac_score_msgs`: what a recorder node writes for us in any edition."""

    def decode(self, msgtype: str, message: Any, t_s: float) -> Submission | Event | None:
        """A submission or an event; `None` for anything else.

        A product whose pose is not usable keeps its type and loses its pose.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: Its stamp, s of trial time.
        """
        if msgtype == "ariac_score_msgs/msg/TrialEvent":
            return Event(t_s, message.kind, message.subject, message.detail)
        if msgtype == "ariac_score_msgs/msg/Submission":
            return Submission(
                task_id=message.shipment_type,
                submitted_s=t_s,
                contents=tuple(_product(product) for product in message.products),
                agv=message.agv,
                station=message.station,
            )
        return None


def _order(message: Any, t_s: float) -> Order:
    replaced, update, _ = message.order_id.partition("_update_")
    return Order(
        id=message.order_id,
        tasks=tuple(_task(shipment) for shipment in message.shipments),
        announced_s=t_s,
        updates=replaced if update else "",
    )


def _task(shipment: Any) -> Task:
    return Task(
        id=shipment.shipment_type,
        products=tuple(
            WantedProduct(f"part_{i}", product.type, _pose(product.pose))
            for i, product in enumerate(shipment.products)
        ),
        agv=shipment.agv_id or "any",
    )


def _pose(pose: Any) -> Pose:
    at, turn = pose.position, pose.orientation
    return Pose((at.x, at.y, at.z), (turn.w, turn.x, turn.y, turn.z))


def _product(product: Any) -> Product:
    try:
        pose = _pose(product.pose)
    except ValueError:
        pose = None  # not a failure: that the product was handed in is known, where it lay is not
    return Product(product.type, pose, faulty=product.is_faulty, name=product.name)
