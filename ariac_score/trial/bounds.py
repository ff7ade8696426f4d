"""How fast bodies can move: what bounds the world between two samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ariac_score.trial.frozen import FrozenMap

__all__ = ["DEFAULT_BOUNDS", "ERRORS", "USUAL_INTERVALS", "BetweenSamples", "MotionBound", "between_samples"]

ERRORS = ("time_error_s", "distance_error_m")
"""What `bounds:` states besides kinds of bodies."""

USUAL_INTERVALS = 1.5
"""An interval longer than this times the usual one of its stream hides samples that were lost."""


@dataclass(frozen=True)
class MotionBound:
    """How fast a body of some kind can move.

    Attributes:
        max_speed_m_s: No point of it is ever faster, m/s.
        max_acceleration_m_s2: Nor does its velocity change faster, m/s2; infinite: nobody says.
        source: Who says so.
        stated: `rule_set` or `log_map`, where an organiser states it; empty: it is a default.
    """

    max_speed_m_s: float
    max_acceleration_m_s2: float = math.inf
    source: str = ""
    stated: str = ""


DEFAULT_BOUNDS: Mapping[str, MotionBound] = FrozenMap(
    {
        # No acceleration: simulated bodies start and stop within a step, and no default may exclude that.
        "human": MotionBound(
            4.0, source="our choice: a run; ISO 13855 has 1.6 m/s for a walk, 2.0 for a hand"
        ),
        "robot": MotionBound(5.0, source="our choice: what tracks are split at as a jump (catalogue, M19)"),
    }
)
"""By kind of body, for competitions whose organiser states none; conservative rather than near."""


@dataclass(frozen=True)
class BetweenSamples:
    """What is assumed of the time between two samples.

    Attributes:
        bounds: By kind of body.
        every: Whether every interval is bounded (`between_samples: bounded`), not only those that are longer
            than a stream usually has; otherwise a sample stands until the next one.
        time_error_s: How far a stamp may lie from the time it is for, s.
        distance_error_m: How far a measured distance may lie from the true one, m.
        lacking: How many samples a recorder received and the log lacks, by the source of a signal.
    """

    bounds: Mapping[str, MotionBound] = field(default_factory=lambda: DEFAULT_BOUNDS)
    every: bool = False
    time_error_s: float = 0.0
    distance_error_m: float = 0.0
    lacking: Mapping[str, int] = field(default_factory=FrozenMap)

    def of(self, kind: str) -> MotionBound | None:
        """The bound of a kind of body; `None` where nobody knows one."""
        return self.bounds.get(kind)


def between_samples(
    log_map: Mapping[str, Any],
    rule_set: Mapping[str, Any],
    *,
    every: bool = False,
) -> BetweenSamples:
    """What is assumed, by what a log map and a rule set state in `bounds:`, of which the latter counts.

    Args:
        log_map: Its `bounds:`, as written.
        rule_set: Likewise.
        every: Whether the rule set bounds every interval.

    >>> stated = {"human": {"max_speed_m_s": 1.6, "source": "walks"}, "time_error_s": 0.002}
    >>> found = between_samples({}, stated)
    >>> found.bounds["human"].max_speed_m_s, found.bounds["robot"].stated, found.time_error_s
    (1.6, '', 0.002)
    """
    bounds, errors = dict(DEFAULT_BOUNDS), dict.fromkeys(ERRORS, 0.0)
    for who, stated in (("log_map", log_map), ("rule_set", rule_set)):
        for kind, body in stated.items():
            if kind in ERRORS:
                errors[kind] = float(body)
                continue
            fastest = body.get("max_acceleration_m_s2", math.inf)
            bounds[kind] = MotionBound(float(body["max_speed_m_s"]), float(fastest), body["source"], who)
    time_error_s, distance_error_m = (errors[name] for name in ERRORS)
    return BetweenSamples(FrozenMap(bounds), every, time_error_s, distance_error_m)
