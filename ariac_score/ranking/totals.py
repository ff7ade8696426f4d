"""How the scores of a team in its trials become one number: the execution.

Each way is a function from the scores, one for each trial, to a number. It is an entry point of the group
`ariac_score.ranking_policies`, ours as those of distributions; rule sets name it: `ranking: {total: NAME}`.
It may not depend on the order of the trials, for draws mix them.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal

from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.installed.captured_output import fault_of, quiet

__all__ = ["GROUP", "SUM", "Total", "highest", "lowest", "mean", "median", "total", "total_named"]

GROUP = "ariac_score.ranking_policies"

SUM = "sum"
"""What counts where a rule set names none."""

_LAST_DIGIT = Decimal("1e-9")
"""As for scores: 9 decimal digits are the most that a rule set may declare."""


def total(scores: Sequence[Decimal]) -> Decimal:
    """The sum over all trials."""
    return sum(scores, Decimal(0))


def mean(scores: Sequence[Decimal]) -> Decimal:
    """The mean over all trials."""
    return total(scores) / len(scores)


def median(scores: Sequence[Decimal]) -> Decimal:
    """The median over all trials; of an even number the mean of the middle two."""
    return statistics.median(scores)


def highest(scores: Sequence[Decimal]) -> Decimal:
    """The highest score of all trials."""
    return max(scores)


def lowest(scores: Sequence[Decimal]) -> Decimal:
    """The lowest score of all trials."""
    return min(scores)


@dataclass(frozen=True)
class Total:
    """A way from the scores of a team to its execution.

    Attributes:
        name: As the rule set names it.
        plugin: Who brings it; `None` for the sum where nobody names one.
        of: The function, as it is brought.
    """

    name: str = SUM
    plugin: Plugin | None = None
    of: Callable[[Sequence[Decimal]], Decimal] = total

    def execution(self, scores: Sequence[Decimal]) -> Decimal:
        """The number for these scores, at most 9 decimal digits; 0 without any trial.

        Raises:
            PluginError: The function failed, or gives no finite decimal.
        """
        if self.plugin is None or not scores:
            return total(scores)
        try:
            with quiet(self.plugin.origin):
                value = self.of(tuple(scores))
        except Exception as cause:  # a stranger's code may raise anything
            raise broken(self.plugin, f"raised {fault_of(cause)}") from cause
        if not isinstance(value, Decimal) or not value.is_finite():
            raise broken(self.plugin, f"gives {value!r} instead of a finite Decimal")
        fine = value == value.quantize(_LAST_DIGIT, rounding=ROUND_HALF_EVEN)
        return value if fine else value.quantize(_LAST_DIGIT, rounding=ROUND_HALF_EVEN)


def total_named(name: str, registry: Registry | None = None) -> Total:
    """The way of that name.

    Raises:
        PluginError: None is installed, two are, or what is installed is no function.
    """
    if name == SUM:
        return Total()
    plugin = (registry or Registry()).find(GROUP, name)
    return Total(name, plugin, plugin.value())
