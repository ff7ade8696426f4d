"""A ranking after the decisions of stewards; the automatic ranking is kept as it is.

A decision about a run changes the score of that run, and with it which runs are kept. Where the rules count
what a team did in all of its runs of a trial, a verdict changes those, too. It changes no other team's score:
the values across teams stay those of the automatic ranking.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from decimal import Decimal

from msgspec import structs

from ariac_score.checks.findings import Finding
from ariac_score.engine.price import reprice
from ariac_score.errors import DataFileError, FormulaError, did_you_mean
from ariac_score.ranking.beside import (
    others_of,
    priced_beside,
    terms_of,
    values_beside,
    with_lost,
    without_others,
)
from ariac_score.ranking.competition import Competition, RunKey
from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import AS_ZERO, WITH_SCORE, Ranking, RunOutcome, Stewarded
from ariac_score.ranking.rank import rank_again
from ariac_score.ranking.spec import Spec
from ariac_score.results.adjustments import (
    Adjustments,
    apply,
    check_targets,
    interval_that_counts,
    priced_with,
)
from ariac_score.results.cohort_file import Cohort
from ariac_score.results.result import Result
from ariac_score.results.result_file import measured_sha256
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.pricing import Priced
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.scoring.steward import (
    LOST,
    Adjusted,
    Adjustment,
    adjusted_ledger,
    as_kept,
    check_effects,
    with_verdicts,
)

__all__ = ["adjusted_ranking", "decisions_by_run"]


@in_own_decimals
def adjusted_ranking(
    competition: Competition, spec: Spec, rule_set: RuleSet, ranking: Ranking, adjustments: Adjustments
) -> Ranking:
    """The automatic ranking, and in its `stewarded` the one after the decisions.

    Raises:
        DataFileError: A decision is about no run, was made for another result, or has no effect.
    """
    decided: dict[RunKey, list[Adjustment]] = {}
    for decision in adjustments.decisions:
        decided.setdefault(_target(decision, ranking.runs).key, []).append(decision)
    context = _Context(spec, rule_set, ranking.cohort, adjustments.sha256)
    of_teams = {(team, trial) for team, trial, _ in decided}
    ranked = [run for run in ranking.runs if (run.team, run.trial) in of_teams]
    alone = {run.key: without_others(run, spec, rule_set) for run in ranked}
    after_verdicts = [
        _changed(run, decided[key], None, context) if key in decided else run for key, run in alone.items()
    ]
    # What they say that a run did, its team did in all of its runs.
    others = others_of(after_verdicts, rule_set)
    changed = {}
    for run in ranked:
        beside = others.get(run.key)
        if run.key in decided:
            changed[run.key] = _changed(alone[run.key], decided[run.key], beside, context)
        elif beside is not None:
            now = priced_beside(alone[run.key], rule_set, ranking.cohort, beside)
            if (now.outcome, now.score, now.open) != (run.outcome, run.score, run.open):
                changed[run.key] = now
    after = rank_again(competition, spec, rule_set, ranking, changed)
    kept = tuple(as_kept(decision) for decision in adjustments.decisions)
    return replace(ranking, stewarded=Stewarded(after, kept, adjustments.sha256))


def _target(decision: Adjustment, runs: Sequence[RunOutcome]) -> RunOutcome:
    """The run a decision is about.

    Raises:
        DataFileError: There is none, or more than one.
    """
    named = [
        run
        for run in runs
        if run.trial == decision.trial
        and decision.team in ("", run.team)
        and decision.run in (None, run.number)
    ]
    if not named:
        raise _no_such_run(decision, runs)
    same = [run for run in named if _measured(run) == decision.measured]
    if not same:
        raise decision.refuse(
            f"it was made for another result: nothing measured of {decision.trial} is "
            f"{decision.measured[:16]}…",
            "the log or the engine has changed since: look at the new result ('rank --results DIR', "
            "'ariac-score adjust RESULT') and decide again",
        )
    if len(same) > 1:
        raise decision.refuse(
            f"{len(same)} runs measure the same", "name 'team:' and 'run:' in the target as well"
        )
    return same[0]


def _no_such_run(decision: Adjustment, runs: Sequence[RunOutcome]) -> DataFileError:
    number = "" if decision.run is None else f"run {decision.run}"
    whom = ", ".join(word for word in (decision.team, decision.trial, number) if word)
    known = {run.team for run in runs} | {run.trial for run in runs}
    wrong = next((name for name in (decision.team, decision.trial) if name and name not in known), "")
    hint = did_you_mean(wrong, known) if wrong else "look at the runs of the ranking"
    return decision.refuse(f"the competition has no run of {whom}", hint)


def _measured(run: RunOutcome) -> str:
    return LOST if run.result is None else measured_sha256(run.result)


def _ruled(run: RunOutcome, own: Sequence[Adjustment], rule_set: RuleSet, sha256: str) -> RunOutcome:
    """A run whose log is lost, as the decisions about it leave it.

    Raises:
        DataFileError: A decision builds on what was measured, which nothing was.
    """
    for decision in own:
        if not (decision.settles or decision.dismissed):
            raise decision.refuse(
                "nothing was measured of this run, so there is nothing to change", "set its score"
            )
    check_effects(own, {}, frozenset(), rule_set.digits)
    adjusted = _of_lost(own, rule_set.digits, sha256)
    if adjusted.score is None:
        return replace(run, decisions=tuple(a.id for a in adjusted.adjustments))
    return replace(
        run,
        outcome="disqualified" if adjusted.disqualified else "scored",
        cause=_because(adjusted),
        task=None if rule_set.sheet.task is None else adjusted.score,
        score=adjusted.score,
        worst=None,
        decisions=tuple(a.id for a in adjusted.adjustments),
        open=None,
    )


def _of_lost(own: Sequence[Adjustment], digits: int, sha256: str) -> Adjusted:
    """What decisions that settle a score make of none."""

    def nothing(_: Mapping[str, Finding]) -> Priced:
        raise AssertionError("no verdict is decided where nothing was found")

    return adjusted_ledger(None, {}, own, nothing, digits=digits, sha256=sha256)


def _because(adjusted: Adjusted) -> str:
    return "; ".join(f"{a.author}: {a.effect}: {a.reason}" for a in adjusted.adjustments)


@dataclass(frozen=True)
class _Context:
    """By what runs are priced again.

    Attributes:
        spec: How runs become a ranking.
        rule_set: That of the ranking.
        cohort: The values across teams of the automatic ranking.
        sha256: Of the file of decisions.
    """

    spec: Spec
    rule_set: RuleSet
    cohort: Cohort | None
    sha256: str


def _changed(
    run: RunOutcome, own: Sequence[Adjustment], others: CohortValues | None, context: _Context
) -> RunOutcome:
    """A run as the decisions about it leave it.

    Args:
        run: Without other teams and runs.
        own: The decisions about it.
        others: What other runs of its team did after all decisions, where the rules ask for it.
        context: By what it is priced.
    """
    result, rule_set = run.result, context.rule_set
    if result is None:
        return _ruled(run, own, rule_set, context.sha256)
    values = values_beside(run.trial, context.cohort, others)
    has_none = "" if any(one.settles for one in own) else _has_no_score(run, own, context)
    if values is not None:
        try:
            result = reprice(result, rule_set, values)
        except FormulaError as error:
            if not any(one.settles for one in own):
                run = replace(run, outcome="no_value", score=None, task=None, kept=False)
                has_none = f"the rules have no value for it: {error.cause}"
    check_targets([structs.replace(decision, team="", trial="") for decision in own], result, rule_set)
    for decision in own if has_none else ():
        if decision.points is not None:
            raise decision.refuse(f"there is no score to add points to: {has_none}", "set its score")
    adjusted = apply(result, own, rule_set, sha256=context.sha256)
    if has_none:
        adjusted = replace(adjusted, score=None, ledger=None)
    decided = replace(result, adjusted=adjusted)
    terms = run.terms
    if not has_none:
        with suppress(FormulaError):
            terms = terms_of(decided, context.spec, rule_set)
    outcome = _outcome(run, adjusted)
    ends = None if outcome in AS_ZERO else _ends(decided, context)
    return replace(
        run,
        outcome=outcome,
        cause=_cause(decided, has_none if outcome in ("undecided", "no_value") else "", ends),
        score=run.score if has_none else adjusted.score,
        worst=None,
        decisions=tuple(a.id for a in adjusted.adjustments),
        task=run.task if has_none else _task(run, result, adjusted, rule_set),
        terms=terms,
        result=decided,
        open=ends,
    )


def _has_no_score(run: RunOutcome, own: Sequence[Adjustment], context: _Context) -> str:
    """Why a run has no score of its own after the decisions about it; empty where it has one.

    Whatever was recorded of one that crashed counts for nothing. An undecided one has a score as soon as all
    that withheld it is decided, whatever other runs of the team did.
    """
    result, rule_set, cohort = run.result, context.rule_set, context.cohort
    if run.outcome in WITH_SCORE or result is None:
        return ""
    if run.outcome != "undecided":
        return f"the run is {run.outcome.replace('_', ' ')}"
    try:
        if cohort is not None:
            result = reprice(result, rule_set, cohort.of_trial(run.trial))
        priced = priced_with(result, with_verdicts(result.measured.findings, own), rule_set)
    except FormulaError:
        return ""  # which is said where it is priced with others
    lacks_task = rule_set.sheet.task is not None and priced.task is None
    # What a team brings to values across teams cannot be open.
    is_open = cohort is not None and priced.interval is not None
    if priced.status != "incomplete" and not lacks_task and not is_open:
        return ""
    narrowing = priced.interval.narrowing if priced.interval else ()
    return priced.missing or (narrowing[0].cause if narrowing else run.cause)


def _ends(decided: Result, context: _Context) -> Ends | None:
    """Between what the score of a run lies after the decisions about it."""
    assert decided.adjusted is not None  # by them
    if decided.adjusted.score is None and context.cohort is not None:
        return None  # what other teams make of a score that is withheld is not followed
    left = interval_that_counts(decided)
    return None if left is None else Ends(left.least, left.most)


def _cause(decided: Result, lacking: str, ends: Ends | None) -> str:
    """What stewards decided, and what is still unknown of the run or of others of the team."""
    assert decided.adjusted is not None  # by them
    cause = _because(decided.adjusted)
    if decided.adjusted.score is None:
        lacking = lacking or decided.missing
        return f"{cause}; {lacking}" if lacking else cause
    return with_lost(cause, decided.cohort, ends)


def _outcome(run: RunOutcome, adjusted: Adjusted) -> str:
    if adjusted.disqualified:
        return "disqualified"
    if adjusted.score is None and run.outcome in WITH_SCORE:  # another run withholds it
        return "undecided"
    # A run without a score of its own that stewards give one counts as any scored run.
    return "scored" if adjusted.score is not None and run.outcome not in WITH_SCORE else run.outcome


def _task(run: RunOutcome, result: Result, adjusted: Adjusted, rule_set: RuleSet) -> Decimal | None:
    """The task score, by which the runs of a team are compared, moved as the score is."""
    if rule_set.sheet.task is None:
        return None
    settled = next((a for a in adjusted.adjustments if a.settles), None)
    if settled is not None:
        return settled.score or Decimal(0)
    findings = with_verdicts(result.measured.findings, adjusted.adjustments)
    try:
        priced = priced_with(result, findings, rule_set)
    except FormulaError:
        return run.task
    points = sum((a.points for a in adjusted.adjustments if a.points is not None), Decimal(0))
    return None if priced.task is None else priced.task.amount + points


def decisions_by_run(ranking: Ranking) -> Mapping[RunKey, Adjusted]:
    """The adjusted score of each run that stewards decided about."""
    if ranking.stewarded is None:
        return {}
    decided = {decision.id: decision for decision in ranking.stewarded.adjustments}
    found = {}
    for run in ranking.stewarded.ranking.runs:
        if run.result is not None and run.result.adjusted is not None:
            found[run.key] = run.result.adjusted
        elif run.result is None and run.decisions and run.decisions[0] in decided:
            own = [decided[name] for name in run.decisions]
            if all(decision.measured == LOST for decision in own):
                digits = 0 if run.score is None else max(0, -int(run.score.as_tuple().exponent))
                found[run.key] = _of_lost(own, digits, ranking.stewarded.sha256)
    return found
