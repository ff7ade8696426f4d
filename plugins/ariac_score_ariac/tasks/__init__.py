"""Rules about kits, and what official records say of orders, runs and the team's cost."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ariac_score_ariac.tasks.assembly import AssemblyCounters, AssemblyPart
    from ariac_score_ariac.tasks.contents import NoneFaulty, NoneMissing, NoneUnwanted, Presence, RightNumber
    from ariac_score_ariac.tasks.costs import PositiveSensorCost
    from ariac_score_ariac.tasks.coverage import OnlyKitting
    from ariac_score_ariac.tasks.delivery import Destination, OrderTime, Submitted
    from ariac_score_ariac.tasks.inserts import InsertedPart, InsertSeen, PartAssembled
    from ariac_score_ariac.tasks.official import OfficialOrderScore, OfficialTrialScore
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

_HOME = {
    "assembly": "AssemblyCounters AssemblyPart",
    "contents": "NoneFaulty NoneMissing NoneUnwanted Presence RightNumber",
    "costs": "PositiveSensorCost",
    "coverage": "OnlyKitting",
    "delivery": "Destination OrderTime Submitted",
    "inserts": "InsertedPart InsertSeen PartAssembled",
    "official": "OfficialOrderScore OfficialTrialScore",
    "poses": "KitPose TrayRight",
    "quadrants": "ExtraParts OrderSubmitted QuadrantPart TaskKind TrayNumber",
    "run_record": "RunOrder RunRecord",
    "team": "SensorCost",
    "wrong_color": "WrongColorPose",
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}

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


def __getattr__(name: str) -> Any:
    """Load a plugin when it is asked for: a rule set uses some of them."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
