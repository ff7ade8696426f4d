"""A score in two parts: what the work was worth, and what safety changed of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from decimal import Decimal

from ariac_score.checks.findings import Finding
from ariac_score.errors import FormulaError
from ariac_score.results.doubt import counted, left_open
from ariac_score.results.result import Measured, Result
from ariac_score.results.safety import safety_checks
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.ledger import rounded
from ariac_score.scoring.left_open import LeftOpen
from ariac_score.scoring.policy import ideal
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.scoring.scope import Scope

__all__ = ["TaskAndSafety", "task_and_safety", "task_points"]


@dataclass(frozen=True)
class TaskAndSafety:
    """The two parts of a score; together, with what stewards decided, they are the score exactly.

    Attributes:
        task: What the score would be with every safety check kept and all else as it was.
        safety: What safety made of that: the score minus `task`, as a rule not positive.
        has_task: Whether the score depends on any check of the work.
        has_safety: Whether it depends on any check of safety.
        decided: What decisions of stewards moved, where they are counted in; else 0.
    """

    task: Decimal
    safety: Decimal
    has_task: bool = True
    has_safety: bool = True
    decided: Decimal = Decimal(0)

    @property
    def score(self) -> Decimal:
        """The sum of the parts."""
        return self.task + self.safety + self.decided


def task_and_safety(result: Result, rule_set: RuleSet | None = None) -> TaskAndSafety | None:
    """The automatic score in two parts; `None` without a score, or where the first part has no value.

    The ledger shares what mistakes in the work and violations took together; here the work comes
    first, so that the first number is the one that an official scorer without monitors would print.
    Where the log leaves something open, both parts are those of the world whose score counts.

    Args:
        result: The result.
        rule_set: The rules in the result, where the caller has read them already.
    """
    if result.score is None:
        return None
    rules = rule_set or rule_set_from_text(result.rules, file="the rules in the result")
    measured = result.measured
    about = frozenset(safety_checks(rules, measured)) & rules.sheet.priced
    has_task = bool(rules.sheet.priced - about)
    if not about:
        return TaskAndSafety(result.score, Decimal(0), has_task, has_safety=False)
    try:
        findings, trial = counted(result, rules)
    except FormulaError:
        return None
    task = _without(findings, trial, about, measured, rules, result.cohort)
    return None if task is None else TaskAndSafety(task, result.score - task, has_task)


def task_points(measured: Measured, rules: RuleSet, cohort: CohortValues) -> Decimal | None:
    """What a trial would score with every safety check kept; `None` where that has no value.

    Args:
        measured: What was found by these rules.
        rules: What it is worth.
        cohort: The values across teams and runs it is priced with.
    """
    about = frozenset(safety_checks(rules, measured))
    return _without(measured.findings, measured.scopes, about, measured, rules, cohort, is_open=True)


def _without(
    found: Mapping[str, Finding],
    trial: Scope,
    about: frozenset[str],
    measured: Measured,
    rules: RuleSet,
    cohort: CohortValues,
    *,
    is_open: bool = False,
) -> Decimal | None:
    """The score of findings, with those of safety kept."""
    kept = ideal({key: f for key, f in found.items() if f.check in about}, measured.measures)
    findings = {**found, **kept}
    known = left_open(measured, rules)
    known = replace(known, findings=tuple(one for one in known.findings if one.check not in about))
    try:
        worth = value_of(
            findings,
            trial,
            rules.sheet,
            rules.policies,
            cohort=_calm(cohort, rules, about),
            measures=measured.measures,
            left_open=known if is_open else LeftOpen(),
        )
    except FormulaError:
        return None
    return None if worth is None else rounded(worth, rules.digits)


def _calm(cohort: CohortValues, rules: RuleSet, about: frozenset[str]) -> CohortValues:
    """The values across teams and runs, without what safety checks found in other runs of the team."""
    sheet = rules.sheet
    terms = {f"runs.{name}": sheet.terms["trial"][name] for name in sheet.pooled}
    calm = {name for name, term in terms.items() if sheet.checks_in(term) <= about}
    return replace(cohort, values={name: by for name, by in cohort.values.items() if name not in calm})
