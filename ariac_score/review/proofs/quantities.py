"""What a score takes from a trial: the quantities of its checks, and how they go with violations.

One violation is worse than another when at every instant at least as much is violated, at least as deeply.
A function of a check is monotone only where it goes one way with that order: joining two violations makes one
of them, so a number of violations goes neither way, unless they are single events, which never join.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf

from ariac_score.scoring.expression import Number

__all__ = ["DURATION", "FACT", "TASK", "TEAMS", "VIOLATIONS", "Quantity", "of_monitor", "of_rule"]

VIOLATIONS = "violations"
TASK = "task"
FACT = "fact"
DURATION = "duration"
TEAMS = "other teams"

JOINING = "violating in the pause between two makes one of them"
UNKNOWN = "nothing says which way it goes with violations"


@dataclass(frozen=True)
class Quantity:
    """One number that the score takes from a trial.

    Attributes:
        name: As a formula has it, such as `seconds(separation)`.
        of: What it is about: violations, the task, a fact, the duration, other teams.
        least: It is never less.
        most: It is never more.
        checks: The checks it is of.
        grows: Whether it never falls when violations get worse; for the task, when more of it is violated.
        why_not: Why it does not grow, in words.
        always: Whether it grows with every further violation.
        apart: Whether it grows with every further violation that is long after the others.
        deepens: Whether it grows with the depth of a violation that is apart from others.
        depthless: Whether it hangs on when violations are alone, and not on how deep they are.
        smooth: Whether a small change of a violation's length or depth changes it by little.
        bridged: Whether a pause that is shorter than what its monitor bridges leaves it as it is.
        adds: Whether pieces of work with the same violations each give it the same each.
        switch: Whether it is 0 or 1 for the trial: whether there is any.
        same_at_rates: Whether every log rate that sees a violation at all gives it the same.
        earns: Whether it is what work earned as somebody printed it, which is 0 where nothing was done.
    """

    name: str
    of: str
    least: float = 0.0
    most: float = inf
    checks: tuple[str, ...] = ()
    grows: bool = True
    why_not: str = ""
    always: bool = False
    apart: bool = False
    deepens: bool = False
    depthless: bool = False
    smooth: bool = False
    bridged: bool = True
    adds: bool = False
    switch: bool = False
    same_at_rates: bool = False
    earns: bool = False

    def __str__(self) -> str:
        return self.name


def of_monitor(function: str, check: str, *, events: bool, label: str) -> Quantity:
    """A quantity of the violations of a monitor.

    Args:
        function: One of the quantities that functions of checks are made of: `violated`, `critical`, `count`,
            `seconds`, `depth` (the integral), `occurrences`, or `measure` for any other.
        check: The monitor.
        events: Whether it speaks of single events, which have a moment and no length.
        label: How a formula has it.
    """
    if function in ("violated", "critical"):
        depthless = function == "violated"
        return Quantity(
            label, VIOLATIONS, 0, 1, (check,), depthless=depthless, switch=True, same_at_rates=True
        )
    if function in ("count", "occurrences") and events:
        # An event has no length and no depth to be changed by little: each is one more.
        return Quantity(
            label,
            VIOLATIONS,
            checks=(check,),
            always=True,
            apart=True,
            depthless=True,
            smooth=True,
            adds=True,
            same_at_rates=True,
        )
    if function in ("count", "occurrences"):
        return Quantity(
            label,
            VIOLATIONS,
            checks=(check,),
            grows=False,
            why_not=JOINING,
            apart=True,
            depthless=True,
            adds=True,
            same_at_rates=function == "count",
        )
    if function in ("seconds", "depth"):
        return Quantity(
            label,
            VIOLATIONS,
            checks=(check,),
            always=True,
            apart=True,
            deepens=function == "depth",
            depthless=function == "seconds",
            smooth=True,
            bridged=False,
            adds=True,
        )
    return Quantity(label, VIOLATIONS, -inf, inf, (check,), grows=False, why_not=UNKNOWN, bridged=False)


def of_charge(
    weights: Mapping[str, Number],
    *,
    label: str,
    again_after_s: float,
    severity: float,
    longest_pause_s: float,
) -> Quantity:
    """What violations of several checks cost, one event once.

    It is the integral of the most that pressed in the last `again_after_s`, which never falls where nothing
    presses less. It does not grow with every violation: what happens beside something heavier is free. Of one
    rise and fall it is the peak and the integral, so that of a violation alone it grows with depth. It moves
    by at most as much as the depth does anywhere, times the time charged; below the first power the depth
    itself is steep at 0.

    Args:
        weights: By check.
        label: How a formula has it.
        again_after_s: So long after its end a violation is charged.
        severity: Power of the relative depth.
        longest_pause_s: The longest pause that one of the monitors bridges.
    """
    return Quantity(
        label,
        VIOLATIONS,
        checks=tuple(weights),
        apart=True,
        deepens=severity > 0,
        smooth=severity == 0 or severity >= 1,
        bridged=again_after_s >= longest_pause_s,
        adds=True,
    )


def of_rule(function: str, check: str, *, label: str) -> Quantity:
    """A quantity of the verdicts of a rule, whose findings are as many as the work has pieces."""
    if function == "violated":
        return Quantity(label, TASK, 0, 1, (check,), switch=True)
    if function == "points":
        return Quantity(label, TASK, checks=(check,), grows=False, adds=True)
    if function in ("count", "seconds", "depth", "occurrences"):
        return Quantity(label, TASK, checks=(check,), adds=True)
    return Quantity(label, FACT, -inf, inf, (check,), grows=False, why_not="it is a number that was measured")
