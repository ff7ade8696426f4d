"""A score in two parts: what the task brought, and what safety cost.

Which is which says the rule set, never a name: a check under `monitors:` watches safety, one under `rules:`
judges the task. The task brought what the score would be had no monitor found a violation, so it is the same
however unsafe a robot was; safety cost the rest. The ledger shares what violations took *together*, so its
lines of one kind need not add up to the same (docs/ledger.md, "Without it alone").
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.errors import FormulaError
from ariac_score.results.result import Measured, Result
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.ledger import rounded
from ariac_score.scoring.policy import ideal
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text

__all__ = ["TaskAndSafety", "monitors_of", "task_and_safety", "task_points"]

_MONITORS = "ariac_score.monitors"
_COSTS = ("penalty", "factor")
"""Roles of quantities that cost whatever the verdict; a time or a length is one of performance."""


@dataclass(frozen=True)
class TaskAndSafety:
    """The parts of a score, in points.

    Attributes:
        task: What the score would be had no monitor found a violation.
        safety: What violations of monitors moved: negative where safety cost something.
        decided: What decisions of stewards moved; 0 without any.
        watched: Whether the score depends on a monitor; if not, `safety` is 0 because nothing could cost.
    """

    task: Decimal
    safety: Decimal
    decided: Decimal
    watched: bool

    @property
    def score(self) -> Decimal:
        """The score that counts: the sum of the parts."""
        return self.task + self.safety + self.decided


def task_and_safety(result: Result) -> TaskAndSafety | None:
    """Split the score of a result.

    Returns:
        `None` where there is no score, automatic and final, or where the rules have no value for the
        trial without violations.
    """
    if result.score is None or result.final is None:
        return None
    rules = rule_set_from_text(result.rules, file="the rules in the result")
    task = task_points(result.measured, rules, result.cohort)
    if task is None:
        return None
    watched = not monitors_of(rules).isdisjoint(rules.sheet.scored)
    return TaskAndSafety(task, result.score - task, result.final - result.score, watched)


def task_points(measured: Measured, rules: RuleSet, cohort: CohortValues) -> Decimal | None:
    """What a trial would score had no monitor found a violation; `None` where that has no value.

    Args:
        measured: What was found; the names of checks are those of the rules.
        rules: What it is worth.
        cohort: The values across teams it is priced with.
    """
    monitors = monitors_of(rules)
    kept = {
        key: _kept(finding, measured.measures.get(finding.check, {}))
        if finding.check in monitors
        else finding
        for key, finding in measured.findings.items()
    }
    try:
        value = value_of(
            kept, measured.scopes, rules.sheet, rules.policies, cohort=_calm(cohort, rules, monitors)
        )
    except FormulaError:
        return None
    return None if value is None else rounded(value, rules.digits)


def monitors_of(rules: RuleSet) -> frozenset[str]:
    """The names of the checks that watch safety."""
    return frozenset(check.name for check in rules.checks.values() if check.group == _MONITORS)


def _kept(finding: Finding, declared: Mapping[str, Measure]) -> Finding:
    """A finding of a monitor had nothing been violated."""
    if finding.verdict is Verdict.SATISFIED:  # its times and lengths stay: nobody violated anything with them
        declared = {name: one for name, one in declared.items() if one.role in _COSTS}
    return ideal({"": finding}, {finding.check: declared})[""]


def _calm(cohort: CohortValues, rules: RuleSet, monitors: frozenset[str]) -> CohortValues:
    """The values across teams and runs, without what monitors found in other runs of the team."""
    sheet = rules.sheet
    calm = {
        f"runs.{name}" for name in sheet.pooled if sheet.checks_in(sheet.terms["trial"][name]) <= monitors
    }
    return replace(cohort, values={name: by for name, by in cohort.values.items() if name not in calm})
