"""Costs that a score divides by."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from ariac_score import Finding, Trial
from ariac_score_ariac.tasks.team import SensorCost


@dataclass(frozen=True)
class PositiveSensorCost(SensorCost):
    """What the team's sensors cost, where that is more than nothing.

    Measures:
        As `team.sensor_cost`.
    Violated when:
        Never. It is inconclusive where `team.sensor_cost` is, and where the sensors cost
        nothing: nothing says what the factor is where the divisor is 0.
    Source:
        ARIAC 2023 and 2024, evaluation scripts: the cost factor is the average cost
        divided by the team's own, and the program stops where that is 0.
    Attributes:
        free: Types that are placed without pay.
    """

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding about the team."""
        for finding in super().watch(trial):
            if finding.quantities.get("dollars") == 0:
                why = "the sensors cost nothing, and the official program cannot divide by that"
                yield Finding.inconclusive(finding.subject, why)
            else:
                yield finding
