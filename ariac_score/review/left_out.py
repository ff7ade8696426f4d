"""The score with an event that a log does not hold, where nobody attests that none was left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import FormulaError
from ariac_score.results.doubt import counted
from ariac_score.results.result import Result
from ariac_score.scoring.ledger import rounded
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.scoring.scope import Scope
from ariac_score.trial.spans import Span
from ariac_score.trial.statements import NOBODY

__all__ = ["LeftOut", "scores_with_an_event"]

_MONITORS = "ariac_score.monitors"


@dataclass(frozen=True)
class LeftOut:
    """A check that found nothing in a log, and the score had there been one thing more in it.

    Attributes:
        check: The check.
        score: What the trial would then have scored, rounded as scores are.
    """

    check: str
    score: Decimal


def scores_with_an_event(result: Result) -> tuple[LeftOut, ...]:
    """For each monitor that rests on a silent log alone: the score with one event more, lowest first.

    A sample that is left out is a gap, and bounded. An event that is left out leaves nothing behind, so of a
    log that no recorder attests as complete the organiser should know how much hangs on it.

    Args:
        result: The result; nothing comes of one without a score, or whose log is attested.
    """
    said = {one.fact: one.by for one in result.measured.statements}
    if result.score is None or said.get("completeness") != NOBODY:
        return ()
    silent = {key: one for key, one in result.measured.findings.items() if _is_silence(one)}
    if not silent:
        return ()
    rules = rule_set_from_text(result.rules, file="the rules in the result")
    findings, trial = counted(result, rules)
    if _score(result, rules, findings, trial) != result.score:  # a bound, which no single world has
        return ()
    found: dict[str, Decimal] = {}
    for key, finding in silent.items():
        check = rules.checks.get(finding.check)
        if check is None or check.group != _MONITORS or finding.check not in rules.sheet.priced:
            continue
        happened = replace(
            finding,
            verdict=Verdict.VIOLATED,
            span=_end_of(result),
            critical=check.parameters.get("critical") is True,
        )
        score = _score(result, rules, {**findings, key: happened}, trial)
        if score is not None and score < result.score:
            found[finding.check] = score
    each = (LeftOut(check, score) for check, score in found.items())
    return tuple(sorted(each, key=lambda one: (one.score, one.check)))


def _score(result: Result, rules: RuleSet, findings: Mapping[str, Finding], trial: Scope) -> Decimal | None:
    """What findings are worth by the rules of a result; `None` where that has no value."""
    try:
        value = value_of(findings, trial, rules.sheet, rules.policies, cohort=result.cohort)
    except FormulaError:
        return None
    return None if value is None else rounded(value, result.digits)


def _is_silence(finding: Finding) -> bool:
    """Whether a check was kept because nothing was recorded: no margin, no sample, no stretch of time."""
    rests_on = (finding.robustness is not None, finding.evidence, finding.quantities, finding.span)
    return finding.verdict is Verdict.SATISFIED and finding.subject == "trial" and not any(rests_on)


def _end_of(result: Result) -> Span | None:
    window = result.measured.window
    return None if window is None else Span(window.end_s, window.end_s)
