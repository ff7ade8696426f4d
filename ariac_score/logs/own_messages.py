"""Messages of `ariac_score_msgs`: what a recorder node writes for us, whatever the competition."""

from __future__ import annotations

from typing import Any

from ariac_score.trial.events import Event
from ariac_score.trial.model import Pose, Product, Submission, Tray

__all__ = ["NO_TRAY", "AriacScoreRecords"]

NO_TRAY = "none"
"""What a submission says in place of a tray where there was none; empty means unknown."""


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
            # The first form of the message had neither of the two.
            unknown, tray = getattr(message, "contents_unknown", False), getattr(message, "tray", "")
            return Submission(
                task_id=message.shipment_type,
                submitted_s=t_s,
                contents=None if unknown else tuple(_product(product) for product in message.products),
                agv=message.agv,
                station=message.station,
                tray=Tray("" if tray == NO_TRAY else tray) if tray else None,
            )
        return None


def _product(product: Any) -> Product:
    try:
        at, turn = product.pose.position, product.pose.orientation
        pose = Pose((at.x, at.y, at.z), (turn.w, turn.x, turn.y, turn.z))
    except ValueError:
        pose = None  # that the product was there is known, where it lay is not
    return Product(product.type, pose, faulty=product.is_faulty, name=product.name)
