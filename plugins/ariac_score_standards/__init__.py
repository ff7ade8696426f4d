"""Monitors derived from safety standards: a module for each standard, and what they share."""

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
