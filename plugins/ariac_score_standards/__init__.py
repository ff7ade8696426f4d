"""Monitors derived from safety standards and from the safety rules of ARIAC."""

from ariac_score_standards.ariac_safety import CollisionEpisodes, HumanContact, NoEvent
from ariac_score_standards.formula import Always, Never, Within
from ariac_score_standards.iec_60204_1 import EstopRestart, StopPerformance
from ariac_score_standards.iso_3691_4 import AgvProtectiveField, AgvSpeedClearance
from ariac_score_standards.iso_9283 import PoseAttained
from ariac_score_standards.iso_10218_1 import ReducedSpeed, SpaceLimit
from ariac_score_standards.iso_10218_2 import HandGuiding, MonitoredStandstill, PflContact, PflSpeed
from ariac_score_standards.iso_13854 import CrushGap
from ariac_score_standards.iso_13855 import SafeguardDistance
from ariac_score_standards.iso_ts_15066 import SsmResponse, SsmSeparation, SsmSpeedCap
from ariac_score_standards.proxemics import ProximityComfort
from ariac_score_standards.signal_coverage import SignalCoverage

__all__ = [
    "AgvProtectiveField",
    "AgvSpeedClearance",
    "Always",
    "CollisionEpisodes",
    "CrushGap",
    "EstopRestart",
    "HandGuiding",
    "HumanContact",
    "MonitoredStandstill",
    "Never",
    "NoEvent",
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
