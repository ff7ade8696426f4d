"""Monitors derived from safety standards and from the safety rules of ARIAC."""

from ariac_score_standards.ariac_safety import HumanContact, NoEvent
from ariac_score_standards.iso_ts_15066 import SsmSeparation

__all__ = ["HumanContact", "NoEvent", "SsmSeparation"]
