"""Values across teams: what a trial contributes to them, and what it is priced with.

Some competitions measure a team against all others: the mean cost of what it used, the
mean time of a task. Such a value is declared in the rule set with what each team
contributes and which teams count; formulas name it `cohort.<name>`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ariac_score.scoring.expression import Expression, Number

__all__ = ["LEAST", "MOST", "CohortTerm", "CohortValues", "Contribution"]


LEAST, MOST = "least", "most"
"""Of `runs.…`, which is of the trial and has no path but the empty one: its ends, where a run is open."""


@dataclass(frozen=True)
class CohortTerm:
    """One mean across teams, as a rule set declares it.

    Attributes:
        name: Formulas name it `cohort.<name>`.
        level: Of what there is one value each, such as `task`; `trial` for one in all.
        value: What a team contributes.
        where: Whether a team counts; `None`: all that have a run count.
        empty: The value when no team counts; `None`: there is none then.
    """

    name: str
    level: str
    value: Expression
    where: Expression | None = None
    empty: Number | None = None

    @property
    def formulas(self) -> tuple[Expression, ...]:
        """Its formulas, for checks at load time."""
        return (self.value, self.where) if self.where else (self.value,)


@dataclass(frozen=True)
class CohortValues:
    """The values across teams that one trial is priced with, and those of other runs of the team (`runs.…`).

    Attributes:
        sha256: Of the cohort they were taken from; empty for none.
        values: By name and path of the scope (empty for the trial). Of `runs.…` the value that counts, and
            `LEAST` and `MOST` where logs of other runs leave that open.
        lost: Which other run may have done anything, as its log is lost, in words; empty where none. It costs
            nobody: what is known is the score. It opens the score, so no claim rests on its having been calm.
        withheld: Which other run the rules withhold, and with it this one, in words; empty where none.
    """

    sha256: str = ""
    values: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    lost: str = ""
    withheld: str = ""

    @property
    def is_given(self) -> bool:
        """Whether anything of other teams or runs is known, or known to be lost."""
        return bool(self.values or self.beyond)

    @property
    def beyond(self) -> str:
        """Which other run may have done more than is known of it, in words; empty where none."""
        return self.withheld or self.lost

    @property
    def open_runs(self) -> Mapping[str, tuple[float, float]]:
        """Least and most of each `runs.…` that is open."""
        return {name: (by[LEAST], by[MOST]) for name, by in self.values.items() if LEAST in by}

    def at(self, worst: Mapping[str, bool]) -> CohortValues:
        """The same with open `runs.…` at one of their ends; those that are not named count as they do."""
        ends = {
            name: {**self.values[name], "": both[worst[name]]}
            for name, both in self.open_runs.items()
            if name in worst
        }
        return replace(self, values={**self.values, **ends}) if ends else self


@dataclass(frozen=True)
class Contribution:
    """What one team's trial contributes to one value across teams, and whether it counts."""

    name: str
    path: str
    value: Number
    counted: bool
