"""Rules about kits: what was delivered, where it lies, where it went, how long it took; a team's cost."""

from ariac_score_kitting.assembly import AssemblyCounters, AssemblyPart
from ariac_score_kitting.contents import NoneFaulty, NoneMissing, NoneUnwanted, Presence, RightNumber
from ariac_score_kitting.costs import PositiveSensorCost
from ariac_score_kitting.coverage import OnlyKitting
from ariac_score_kitting.delivery import Destination, OrderTime, Submitted
from ariac_score_kitting.inserts import InsertedPart, InsertSeen, PartAssembled
from ariac_score_kitting.poses import KitPose, TrayRight
from ariac_score_kitting.quadrants import ExtraParts, OrderSubmitted, QuadrantPart, TaskKind, TrayNumber
from ariac_score_kitting.team import SensorCost
from ariac_score_kitting.wrong_color import WrongColorPose

__all__ = [
    "AssemblyCounters",
    "AssemblyPart",
    "Destination",
    "ExtraParts",
    "InsertSeen",
    "InsertedPart",
    "KitPose",
    "NoneFaulty",
    "NoneMissing",
    "NoneUnwanted",
    "OnlyKitting",
    "OrderSubmitted",
    "OrderTime",
    "PartAssembled",
    "PositiveSensorCost",
    "Presence",
    "QuadrantPart",
    "RightNumber",
    "SensorCost",
    "Submitted",
    "TaskKind",
    "TrayNumber",
    "TrayRight",
    "WrongColorPose",
]
