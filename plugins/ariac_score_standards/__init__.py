"""Monitors derived from safety standards and from the safety rules of ARIAC."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ariac_score_standards.formula import Always, Never, Within
    from ariac_score_standards.hand_guiding import HandGuiding
    from ariac_score_standards.iec_60204_1 import EstopRestart, StopPerformance
    from ariac_score_standards.iso_3691_4 import AgvProtectiveField, AgvSpeedClearance
    from ariac_score_standards.iso_9283 import PoseAttained
    from ariac_score_standards.iso_10218_1 import ReducedSpeed, SpaceLimit
    from ariac_score_standards.iso_10218_2 import PflSpeed
    from ariac_score_standards.iso_13854 import CrushGap
    from ariac_score_standards.iso_13855 import SafeguardDistance
    from ariac_score_standards.iso_ts_15066 import SsmSeparation, SsmSpeedCap
    from ariac_score_standards.pfl_contact import PflContact
    from ariac_score_standards.proxemics import ProximityComfort
    from ariac_score_standards.signal_coverage import SignalCoverage
    from ariac_score_standards.ssm_response import SsmResponse
    from ariac_score_standards.standstill import MonitoredStandstill

_HOME = {
    "formula": "Always Never Within",
    "hand_guiding": "HandGuiding",
    "iec_60204_1": "EstopRestart StopPerformance",
    "iso_3691_4": "AgvProtectiveField AgvSpeedClearance",
    "iso_9283": "PoseAttained",
    "iso_10218_1": "ReducedSpeed SpaceLimit",
    "iso_10218_2": "PflSpeed",
    "iso_13854": "CrushGap",
    "iso_13855": "SafeguardDistance",
    "iso_ts_15066": "SsmSeparation SsmSpeedCap",
    "pfl_contact": "PflContact",
    "proxemics": "ProximityComfort",
    "signal_coverage": "SignalCoverage",
    "ssm_response": "SsmResponse",
    "standstill": "MonitoredStandstill",
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}

__all__ = [
    "AgvProtectiveField",
    "AgvSpeedClearance",
    "Always",
    "CrushGap",
    "EstopRestart",
    "HandGuiding",
    "MonitoredStandstill",
    "Never",
    "PflContact",
    "PflSpeed",
    "PoseAttained",
    "ProximityComfort",
    "ReducedSpeed",
    "SafeguardDistance",
    "SignalCoverage",
    "SpaceLimit",
    "SsmResponse",
    "SsmSeparation",
    "SsmSpeedCap",
    "StopPerformance",
    "Within",
]


def __getattr__(name: str) -> Any:
    """Load a plugin when it is asked for: a rule set uses some of them."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
