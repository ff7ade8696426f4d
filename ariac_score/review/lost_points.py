"""What would have earned more: the score again, with one thing at a time as good as it could have been."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import FormulaError
from ariac_score.results.doubt import counted
from ariac_score.results.result import Result
from ariac_score.scoring.expression import Number
from ariac_score.scoring.ledger import rounded, taken_by
from ariac_score.scoring.policy import ideal
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.scoring.scope import Scope

__all__ = ["Recoverable", "gains_by_check", "recoverable_losses", "without_alone"]

MOST = 120
"""More groups than this are not tried: a page shows the largest dozen."""


@dataclass(frozen=True)
class Recoverable:
    """One thing that went wrong, and what the trial would have scored without it.

    Attributes:
        what: The scope or check it is about.
        kind: The level of the scope, or `check`.
        findings: Ids of the findings that would have had to be kept.
        gain: By how much the score would have been higher.
    """

    what: str
    kind: str
    findings: tuple[str, ...]
    gain: Decimal


def recoverable_losses(result: Result, rule_set: RuleSet | None = None) -> tuple[Recoverable, ...]:
    """What would have earned more, largest first; empty without a score.

    Each loss is tried alone, with everything else as it was, by the formulas of the
    result's own rule set. Gains that depend on each other therefore do not add up:
    an order's bonus is in the gain of the order, not in that of its parts.

    Args:
        result: The result.
        rule_set: The rules in the result, where the caller has read them already.
    """
    if result.score is None:
        return ()
    rules = rule_set or rule_set_from_text(result.rules, file="the rules in the result")
    findings, trial = counted(result, rules)
    value = _value(result, rules, trial)
    # A finding that keeps its rule may cost something as well, by what it measured: a time, a distance.
    costly = taken_by(result.ledger)
    wrong = {
        key: finding
        for key, finding in findings.items()
        if finding.check in rules.sheet.priced
        and (key in costly or finding.verdict in (Verdict.VIOLATED, Verdict.INCONCLUSIVE))
    }
    found = [
        Recoverable(what, kind, keys, gain)
        for what, kind, keys in list(_groups(result.measured.scopes, wrong))[:MOST]
        if (gain := _gain(result, findings, keys, value)) > 0
    ]
    # The smallest scope with the same findings names the loss best.
    best: dict[tuple[str, ...], Recoverable] = {}
    for one in found:  # an order with one task is shown once, as the task
        best.setdefault(one.findings, one)
    return tuple(sorted(best.values(), key=lambda one: (-one.gain, one.what)))


def without_alone(result: Result, keys: Sequence[str]) -> dict[str, Decimal]:
    """The score if one finding had been as it should have been and all else as it was, for each of them.

    These do not add up to what was lost: of two gates that are closed, opening one alone brings nothing.

    Args:
        result: The result.
        keys: Ids of findings; those beyond `MOST` are not tried.
    """
    if result.score is None or not keys:
        return {}
    rules = rule_set_from_text(result.rules, file="the rules in the result")
    findings, trial = counted(result, rules)
    value = _value(result, rules, trial)
    return {key: result.score + _gain(result, findings, (key,), value) for key in keys[:MOST]}


def gains_by_check(result: Result, rules: RuleSet) -> dict[str, Decimal]:
    """By how much the score would be higher had one check found nothing wrong, for each that did.

    Args:
        result: The result; without a score nothing would bring more.
        rules: The rules in the result.
    """
    if result.score is None:
        return {}
    findings, trial = counted(result, rules)
    value = _value(result, rules, trial)
    wrong: dict[str, list[str]] = {}
    for key, finding in findings.items():
        bad = finding.verdict in (Verdict.VIOLATED, Verdict.INCONCLUSIVE)
        if bad and finding.check in rules.sheet.priced:
            wrong.setdefault(finding.check, []).append(key)
    gains = {check: _gain(result, findings, tuple(keys), value) for check, keys in wrong.items()}
    return {check: gain for check, gain in gains.items() if gain > 0}


def _value(result: Result, rules: RuleSet, trial: Scope) -> Callable[[Mapping[str, Finding]], Number | None]:
    """What findings are worth by the rules of a result; `None` where that has no value."""

    def value(findings: Mapping[str, Finding]) -> Number | None:
        try:
            return value_of(findings, trial, rules.sheet, rules.policies, cohort=result.cohort)
        except FormulaError:
            return None

    return value


def _gain(
    result: Result,
    findings: Mapping[str, Finding],
    keys: tuple[str, ...],
    value: Callable[[Mapping[str, Finding]], Number | None],
) -> Decimal:
    """How much more the score would be with these findings kept."""
    assert result.score is not None  # called only for scored trials
    kept = ideal({key: findings[key] for key in keys}, result.measured.measures)
    after = value({**findings, **kept})
    return Decimal(0) if after is None else rounded(after, result.digits) - result.score


def _groups(scopes: Scope, wrong: Mapping[str, Finding]) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Findings that belong together: of a piece of work, or a check of the whole trial."""
    scoped: set[str] = set()
    for scope, kind in _below(scopes):
        keys = tuple(key for key, finding in wrong.items() if scope.contains(finding.subject))
        scoped.update(keys)
        if keys:
            yield scope.path, kind, keys
    others: dict[str, list[str]] = {}
    for key, finding in wrong.items():
        if key not in scoped:
            others.setdefault(finding.check, []).append(key)
    for check, keys_of in others.items():
        yield check, "check", tuple(keys_of)


def _below(scope: Scope) -> Iterator[tuple[Scope, str]]:
    """Every piece of work, what is inside one before itself."""
    for inner in scope.inner:
        yield from _below(inner)
        yield inner, inner.level
