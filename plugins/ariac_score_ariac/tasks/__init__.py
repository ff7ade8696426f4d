"""Rules about kits, and what official records say of orders, runs and the team's cost."""

from __future__ import annotations

from ariac_score_ariac.tasks.assembly import AssemblyCounters, AssemblyPart
from ariac_score_ariac.tasks.contents import NoneFaulty, NoneMissing, NoneUnwanted, Presence, RightNumber
from ariac_score_ariac.tasks.costs import PositiveSensorCost
from ariac_score_ariac.tasks.coverage import OnlyKitting
from ariac_score_ariac.tasks.delivery import Destination, OrderTime, Submitted
from ariac_score_ariac.tasks.inserts import InsertedPart, InsertSeen, PartAssembled
from ariac_score_ariac.tasks.official import OfficialOrderScore, OfficialPrinted, OfficialTrialScore
from ariac_score_ariac.tasks.poses import KitPose, TrayRight
from ariac_score_ariac.tasks.quadrants import (
    ExtraParts,
    OrderSubmitted,
    QuadrantPart,
    TaskKind,
    TrayNumber,
)
from ariac_score_ariac.tasks.run_record import RunOrder, RunRecord
from ariac_score_ariac.tasks.team import SensorCost
from ariac_score_ariac.tasks.wrong_color import WrongColorPose

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
    "OfficialOrderScore",
    "OfficialPrinted",
    "OfficialTrialScore",
    "OnlyKitting",
    "OrderSubmitted",
    "OrderTime",
    "PartAssembled",
    "PositiveSensorCost",
    "Presence",
    "QuadrantPart",
    "RightNumber",
    "RunOrder",
    "RunRecord",
    "SensorCost",
    "Submitted",
    "TaskKind",
    "TrayNumber",
    "TrayRight",
    "WrongColorPose",
]
