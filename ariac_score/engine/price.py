"""Pricing what was measured: at once, or again under other rules."""

from __future__ import annotations

from dataclasses import replace

from ariac_score.checks.findings import Finding
from ariac_score.checks.open_findings import OpenFindings
from ariac_score.documents.given import refuse_other
from ariac_score.engine.measure import stored_findings, stored_name
from ariac_score.engine.prepared import Rules, rule_set_of
from ariac_score.engine.provenance import engine_code
from ariac_score.errors import FormulaError, OtherFactError, RuleSetError
from ariac_score.results.doubt import left_open
from ariac_score.results.result import CheckUse, Code, Measured, Pinned, Provenance, Result, Settings
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.pricing import price
from ariac_score.scoring.ruleset import RuleSet, expanded_yaml
from ariac_score.trial.statements import BY_RULES, NOBODY
from ariac_score.trial.window import RECORDING

__all__ = ["check_uses", "price_trial", "reprice"]


def price_trial(
    measured: Measured, rule_set: RuleSet, provenance: Provenance, cohort: CohortValues | None = None
) -> Result:
    """Price what was measured.

    Args:
        measured: The findings.
        rule_set: What they are worth; its checks must be those that measured.
        provenance: Where the findings come from.
        cohort: Values across teams, where there are any.

    Raises:
        FormulaError: A formula has no value here, such as a division by zero.
        OtherFactError: The trial states a fact otherwise than declared; it names the trial.
    """
    cohort = cohort or CohortValues()
    try:
        priced = price(
            measured.findings,
            measured.scopes,
            rule_set.sheet,
            rule_set.policies,
            digits=rule_set.digits,
            cohort=cohort,
            measures=measured.measures,
            left_open=left_open(measured, rule_set),
        )
    except OtherFactError as error:
        # What is wrong lies in the trial, so no line of the rule set is its place.
        error.file, error.place = measured.trial, ""
        raise
    except FormulaError as error:
        error.file = error.file or rule_set.file
        raise
    ledger = priced.ledger
    return Result(
        measured=measured,
        rule_set_title=rule_set.title,
        checks=check_uses(rule_set),
        notes=rule_set.notes,
        rules=expanded_yaml(rule_set),
        status=priced.status,
        score=None if ledger is None else ledger.amount,
        possible=priced.possible,
        ledger=ledger,
        assumptions=priced.assumptions,
        digits=rule_set.digits,
        provenance=provenance,
        task=priced.task,
        cohort=cohort,
        missing=priced.missing,
        interval=priced.interval,
    )


def check_uses(rule_set: RuleSet) -> dict[str, CheckUse]:
    """The checks of a rule set as a result lists them, by name."""
    return {
        check.name: {
            "use": check.use,
            "with": dict(check.parameters),
            "on_inconclusive": check.on_inconclusive,
            "priced": check.name in rule_set.sheet.priced,
        }
        for check in rule_set.checks.values()
    }


_BETWEEN = "between_samples"


def _refuse_other_authority(result: Result, rule_set: RuleSet) -> None:
    """Refuse to price what was measured on a word that the rules do not take.

    Raises:
        RuleSetError: The whole recording was taken for the competition, or its completeness is not
            attested, and the rules have it otherwise.
    """
    stated = {statement.fact: statement for statement in result.measured.statements}
    window, completeness = stated.get("window"), stated.get("completeness")
    if window is not None and window.by == BY_RULES and rule_set.authority.window != RECORDING:
        raise RuleSetError(
            "the result takes the whole recording for the competition, and these rules do not",
            file=rule_set.file,
            hint="score the log under this rule set, or let it say 'window: recording'",
        )
    asked = rule_set.authority.completeness == "attested"
    if asked and (completeness is None or completeness.by == NOBODY):
        why = "" if completeness is None else f": {completeness.detail}"
        raise RuleSetError(
            f"these rules ask for an attested log, and that of the result is not{why}",
            file=rule_set.file,
            place="$.completeness",
            hint="score a log under this rule set that its recorder attests",
        )


def _refuse_other_gaps(result: Result, rule_set: RuleSet) -> None:
    """Refuse to price what was measured with other bounds of the time between samples.

    Raises:
        RuleSetError: Naming what the rules have otherwise.
    """
    stated = {
        one.name: one.value
        for settings in (result.measured.settings or {}).values()
        for one in settings.parameters
        if one.name == _BETWEEN or one.name.startswith("bounds.")
    }
    if not stated:
        return
    asked: dict[str, object] = {_BETWEEN: rule_set.between_samples}
    for kind, own in rule_set.bounds.items():
        numbers = own.items() if isinstance(own, dict) else [("", own)]
        asked |= {f"bounds.{kind}.{name}".rstrip("."): number for name, number in numbers if name != "source"}
    for name, number in asked.items():
        measured = stated.get(name, "held" if name == _BETWEEN else number)
        if measured != number:
            raise RuleSetError(
                f"the result was measured with {name}: {measured}, and these rules have {number}",
                file=rule_set.file,
                hint="score the log under this rule set instead; only prices can change without it",
            )


def reprice(result: Result, rule_set: Rules, cohort: CohortValues | None = None) -> Result:
    """Price a stored result under another rule set, or with a cohort, without its log.

    The checks of the rule set must be among those that were measured: same plugin,
    same parameters, whatever they are called.

    Args:
        result: The stored result.
        rule_set: A rule set, its name or the path of its file.
        cohort: Values across teams, where there are any.

    Raises:
        RuleSetError: A check was not measured; the message names it.
        FormulaError: A formula has no value here.
        UsageError: It is given something else.
    """
    refuse_other(result, Result, "a result", "score_trial and load_result give one")
    rule_set = rule_set_of(rule_set)
    _refuse_other_authority(result, rule_set)
    _refuse_other_gaps(result, rule_set)
    findings: dict[str, Finding] = {}
    known = result.measured.settings  # None in results of versions that kept none
    settings: dict[str, Settings] | None = None if known is None else {}
    measures = {}
    open_: list[OpenFindings] = []
    for check in rule_set.checks.values():
        stored = stored_name(result, check)
        if stored is None:
            raise RuleSetError(
                f"check {check.name!r} ({check.use} with these parameters) was not measured",
                file=rule_set.file,
                place=check.place.get("use", check.name),
                hint="score the log under this rule set instead; only prices can change without it",
            )
        for number, finding in enumerate(stored_findings(result, stored, check), start=1):
            findings[f"{check.name}#{number}"] = finding
        if settings is not None and known is not None and stored in known:
            settings[check.name] = known[stored]
        if stored in result.measured.measures:
            measures[check.name] = result.measured.measures[stored]
        open_ += [one.renamed(check.name) for one in result.measured.open if one.check == stored]
    # The engine that prices may be another version than the one that measured; both are named.
    code = tuple(sorted({Code(*engine_code()), *result.provenance.code}))
    pinned = Pinned(rule_set.id, rule_set.sha256)
    provenance = replace(result.provenance, rule_set=pinned, code=code)
    measured = replace(
        result.measured, findings=findings, settings=settings, measures=measures, open=tuple(open_)
    )
    return price_trial(measured, rule_set, provenance, cohort)
