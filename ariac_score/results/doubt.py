"""What the log of a result leaves open, as pricing takes it."""

from __future__ import annotations

from ariac_score.checks.findings import Verdict
from ariac_score.results.result import SEQUENCE, Measured, Result
from ariac_score.scoring.left_open import LeftOpen
from ariac_score.scoring.policy import Assumption
from ariac_score.scoring.pricing import CountedWorld, counted_world
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.statements import NOBODY

__all__ = ["as_scored", "counted", "left_open", "undecided_text", "why_withheld"]

_PAUSE = "t_off_s"
"""How long a pause must be for two violations to be two, as monitors name it."""
_CRITICAL = "critical"
"""Whether violations are critical, likewise."""


def left_open(measured: Measured, rule_set: RuleSet) -> LeftOpen:
    """What a log leaves open, and what that counts as by some rules."""
    pauses, critical = (_stated(measured, rule_set, name) for name in (_PAUSE, _CRITICAL))
    unstated = (one.detail for one in measured.statements if one.fact == "work" and one.by == NOBODY)
    work_open = measured.cut.work_open if measured.cut is not None else ""
    is_cut = measured.cut is not None and measured.cut.open_end
    return LeftOpen(
        findings=measured.open,
        counts=rule_set.counts,
        monitors=rule_set.monitors,
        uncritical=frozenset(name for name, is_critical in critical.items() if is_critical is False),
        pauses_s={name: float(s) for name, s in pauses.items() if isinstance(s, int | float)},
        watched=measured.watched or measured.window,
        # Where a log is cut off, what is undecided up to there has an end.
        endless=not is_cut and any(one.fact == "window" and one.by == NOBODY for one in measured.statements),
        open_end_s=measured.cut.until_s if is_cut and measured.cut is not None else None,
        work_open=work_open or next(unstated, ""),
        lasted=measured.lasted,
    )


def _stated(measured: Measured, rule_set: RuleSet, parameter: str) -> dict[str, object]:
    """The value of a parameter by check: as a result states it, else as the rule set gives it."""
    given = {name: check.parameters.get(parameter) for name, check in rule_set.checks.items()}
    stated = {
        name: setting.value
        for name, settings in (measured.settings or {}).items()
        for setting in settings.parameters
        if setting.name == parameter
    }
    return {**given, **stated}


def as_scored(result: Result, rule_set: RuleSet) -> LeftOpen:
    """The same as the version had it that wrote a result: until `result/2` nothing open had a score."""
    found = left_open(result.measured, rule_set)
    return LeftOpen(counts="withhold") if result.ledger_method == SEQUENCE else found


def counted(result: Result, rule_set: RuleSet) -> CountedWorld:
    """The world whose score counts, which is that of the ledger.

    Raises:
        FormulaError: The score has no value.
    """
    measured = result.measured
    return counted_world(
        measured.findings,
        measured.scopes,
        rule_set.sheet,
        rule_set.policies,
        cohort=result.cohort,
        measures=measured.measures,
        left_open=as_scored(result, rule_set),
    )


def undecided_text(result: Result, assumption: Assumption) -> str:
    """Why something is undecided.

    A check that was decided by its samples, and is not between them, is told as such: what it says of its
    samples alone would read as decided.
    """
    finding = result.measured.findings.get(assumption.finding)
    if finding is None or finding.verdict is Verdict.INCONCLUSIVE:
        return assumption.message
    return f"the log does not show everything; by its samples {assumption.message}"


def why_withheld(result: Result) -> str:
    """Why there is no score, in a line: what would narrow it most, else the first undecided finding."""
    if result.missing:
        return result.missing
    if result.interval is not None and result.interval.narrowing:
        first, *others = (one.cause for one in result.interval.narrowing)
    else:
        findings = result.measured.findings
        first, *others = [
            f"{findings[one.finding].subject}: {undecided_text(result, one)}"
            for one in result.assumptions
            if one.policy == "withhold"
        ] or [result.status]
    return f"{first}, and {len(others)} more" if others else first
