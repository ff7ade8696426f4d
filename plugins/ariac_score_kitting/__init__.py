"""Rules about kits: what was delivered, where it lies, where it went, and how long it took."""

from ariac_score_kitting.contents import NoneFaulty, NoneMissing, NoneUnwanted, Presence
from ariac_score_kitting.coverage import OnlyKitting
from ariac_score_kitting.delivery import Destination, OrderTime, Submitted
from ariac_score_kitting.poses import KitPose, TrayRight

__all__ = [
    "Destination",
    "KitPose",
    "NoneFaulty",
    "NoneMissing",
    "NoneUnwanted",
    "OnlyKitting",
    "OrderTime",
    "Presence",
    "Submitted",
    "TrayRight",
]
