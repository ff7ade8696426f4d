"""The values of a rule set's formulas for a trial, where they are certain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import FormulaError
from ariac_score.results.result import Measured
from ariac_score.scoring.doubt import doubts
from ariac_score.scoring.expression import Expression, Traced
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.scoring.scope import Scope, is_inside

__all__ = ["Certain", "Value"]

_DURATION = "trial.duration_s"


@dataclass(frozen=True)
class Value:
    """A number with its trace, or why there is none.

    Attributes:
        traced: The number; `None` when there is none.
        reason: Why not, in words.
    """

    traced: Traced | None = None
    reason: str = ""


@dataclass(frozen=True)
class Certain:
    """Evaluates formulas over the findings, one scope at a time.

    Attributes:
        rule_set: Whose formulas.
        measured: What was found under it.
        rounding: How exact poses are, by unit; a smaller margin is not certain.
        timed: Whether the logs show both when the competition began and when it ended.
    """

    rule_set: RuleSet
    measured: Measured
    rounding: Mapping[str, float] = field(default_factory=dict)
    timed: bool = True

    def value(self, formula: Expression, level: str, path: str) -> Value:
        """A formula in one scope, or why it has no certain value there."""
        # Only the branch of the scope, so that what is undecided elsewhere makes nothing here uncertain.
        trial = branch(self.measured.scopes, path)
        if trial is None:
            return Value(reason="what was asked for there is not recorded")
        if not self.timed and _DURATION in self.rule_set.sheet.facts_in(formula, level):
            return Value(reason="the log does not show when the competition began and ended")
        try:
            traced = self.rule_set.sheet.evaluate_in(formula, trial, self.measured.findings, level=level)[
                path
            ]
        except FormulaError as error:
            return Value(reason=error.cause)
        reason = self._doubt(traced) or self._idle(traced)
        return Value(reason=reason) if reason else Value(traced)

    def _doubt(self, traced: Traced) -> str:
        """Why a value is not certain: what is undecided, or nearer to its limit than poses are exact."""
        open_ = {key: why for key, f in self.measured.findings.items() if (why := self._open(f))}
        return next((open_[key] for key in doubts(traced, self.measured.findings, open_)), "")

    def _open(self, finding: Finding) -> str:
        if finding.verdict is Verdict.INCONCLUSIVE:
            return f"{finding.check}: {finding.message}"
        exact = self.rounding.get(finding.unit, 0.0)
        if finding.robustness is None or abs(finding.robustness) >= exact:
            return ""
        return (
            f"{finding.check}: {finding.message}, and poses in state.log are rounded to three digits: "
            f"{exact:g} {finding.unit} decide nothing"
        )

    def _idle(self, traced: Traced) -> str:
        """Why a yes or no means nothing: every finding behind it is not applicable."""
        if traced.kind != "check" or traced.op not in ("holds", "violated"):
            return ""
        (check,) = traced.checks
        found = [f for f in self.measured.of(check).values() if is_inside(f.subject, traced.subject)]
        if all(finding.verdict is Verdict.NOT_APPLICABLE for finding in found):
            return f"{check}: not applicable: {found[0].message}" if found else ""
        return ""


def branch(scope: Scope, path: str) -> Scope | None:
    """The trial with only the scopes that lead to a path and those inside it; `None` without such a path."""
    if scope.path == path:
        return scope
    for inner in scope.inner:
        if inner.contains(path):
            found = branch(inner, path)
            return replace(scope, inner=(found,)) if found else None
    return None
