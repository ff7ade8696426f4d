"""Messages that recorder nodes publish for this engine in ARIAC: what was submitted, and what happened."""

from __future__ import annotations

from typing import Any

from ariac_score import Event, Pose
from ariac_score_ariac.work import KitSubmission, Product, Tray

__all__ = ["NO_TRAY", "AriacScoreRecords"]

NO_TRAY = "none"
"""The tray of a submission that had none; an empty text means unknown."""


class AriacScoreRecords:
    """Decodes the messages of `ariac_score_msgs`, which recorder nodes publish for this engine in ARIAC."""

    def decode(self, msgtype: str, message: Any, t_s: float) -> KitSubmission | Event | None:
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
            # Older recordings: the first version of the message lacked both fields.
            unknown, tray = getattr(message, "contents_unknown", False), getattr(message, "tray", "")
            return KitSubmission(
                item_id=message.shipment_type,
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
        pose = None  # the product was there, but its place is unknown
    return Product(product.type, pose, faulty=product.is_faulty, name=product.name)
