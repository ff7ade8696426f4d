"""A run before and beside others: what it is worth alone, and with what other teams and runs did."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from decimal import Decimal
from math import isfinite

from ariac_score.checks.findings import Verdict
from ariac_score.engine.price import reprice
from ariac_score.errors import FormulaError, OtherFactError, RunEndedError, ScoreError
from ariac_score.ranking.competition import Competition, RunKey
from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import AS_ZERO, OUTCOMES, WITH_SCORE, RunOutcome
from ariac_score.ranking.spec import Spec
from ariac_score.results.adjustments import counted_as_decided, ends_as_decided
from ariac_score.results.cohort_file import Cohort, contributed, make_cohort
from ariac_score.results.doubt import why_withheld
from ariac_score.results.result import Result
from ariac_score.scoring.cohort import LEAST, MOST, CohortValues
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.left_open import DURATION, OF_RUNS
from ariac_score.scoring.policy import assume
from ariac_score.scoring.pricing import Contributed
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.scoring.scope import lasting
from ariac_score.scoring.steward import with_verdicts

__all__ = [
    "best_runs",
    "cohort_of",
    "merit",
    "others_of",
    "outcome_of",
    "priced_beside",
    "terms_of",
    "values_beside",
    "with_lost",
    "without_others",
]


def outcome_of(
    key: RunKey, result: Result | ScoreError, rule_set: RuleSet, spec: Spec, partial: bool
) -> RunOutcome:
    """How a run ended, before others are looked at.

    Args:
        key: Team, trial and number.
        result: Its result, or why there is none.
        rule_set: The rule set that prices it.
        spec: How runs become a ranking.
        partial: Whether the result of a log that is cut off counts.
    """
    if isinstance(result, RunEndedError):
        return RunOutcome(*key, result.outcome, result.cause, task=Decimal(0), score=Decimal(0))
    if isinstance(result, ScoreError):
        outcome = "no_value" if isinstance(result, FormulaError) else "unreadable"
        return RunOutcome(*key, outcome, _error_text(result))
    unofficial = "; ".join(result.measured.unofficial)
    if unofficial and not partial:
        cause = f"unofficial: {unofficial}; ask for such runs to be ranked: --partial"
        return RunOutcome(*key, "unreadable", cause, result=result, open=_ends(result))
    official = result.measured.official
    ended = official.outcome if official else ""
    if ended in AS_ZERO:
        return RunOutcome(*key, ended, OUTCOMES[ended], task=Decimal(0), score=Decimal(0), result=result)
    if result.status == "incomplete" or (rule_set.sheet.task is not None and result.task is None):
        return RunOutcome(*key, "undecided", why_withheld(result), result=result, open=_ends(result))
    try:
        terms = terms_of(result, spec, rule_set)
    except FormulaError as error:
        return RunOutcome(*key, "no_value", _error_text(error), result=result)
    return RunOutcome(
        *key,
        "unofficial" if unofficial else "aborted" if ended == "aborted" else "scored",
        unofficial if unofficial else OUTCOMES["aborted"] if ended == "aborted" else "",
        task=result.task.amount if result.task else None,
        score=result.score,
        terms=terms,
        result=result,
        open=_ends(result),
    )


def _ends(result: Result) -> Ends | None:
    interval = result.interval
    return None if interval is None else Ends(interval.least, interval.most)


def _error_text(error: ScoreError) -> str:
    # A formula that has no value is no fault of the log that the error names, so its place stands instead.
    of_formula = isinstance(error, FormulaError) and not isinstance(error, OtherFactError)
    what = f"{error.place}: {error.cause}" if of_formula else str(error)
    return f"{what}; {error.hint}" if error.hint else what


def _term(name: str, result: Result, rule_set: RuleSet) -> float:
    """The value of a term of the trial; it may not depend on other teams, for there is no cohort yet."""
    formula = Expression.parse(name, where=f"$.ranking: {name}")
    sheet, measured = rule_set.sheet, result.measured
    # In the world whose score counts: else a team would be ahead, or calm, for what its log does not show.
    decisions = () if result.adjusted is None else result.adjusted.adjustments
    findings = (
        with_verdicts(measured.findings, decisions)
        if sheet.needs_cohort
        else counted_as_decided(result, rule_set).findings
    )
    findings = assume(findings, rule_set.policies, priced=sheet.scored).findings
    trial, lasted = measured.scopes, measured.lasted
    if lasted is not None and DURATION in sheet.facts_in(formula):
        if lasted.most_s is None:
            raise FormulaError(f"nobody knows how long the trial was: {lasted.why}")
        trial = lasting(trial, lasted.least_s if rule_set.counts == "best" else lasted.most_s)
    return float(sheet.evaluate_in(formula, trial, findings)[""].value)


def _term_compared(name: str, result: Result, rule_set: RuleSet, *, highest: bool) -> float:
    """The same, as runs are compared by it.

    What no score depends on is in no world that counts: it counts at the end at which scores do.
    """
    sheet = rule_set.sheet
    formula = Expression.parse(name, where=f"$.ranking: {name}")
    known = frozenset[str]() if sheet.needs_cohort else sheet.scored
    if sheet.checks_in(formula) <= known or not _is_open(result):
        return _term(name, result, rule_set)
    ends = ends_as_decided(name, result, rule_set)
    found = min(ends) if highest is (rule_set.counts != "best") else max(ends)
    if not isfinite(found):
        raise FormulaError(f"nothing bounds {name}, by which runs are compared")
    return found


def best_runs(outcomes: Sequence[RunOutcome], spec: Spec) -> dict[tuple[str, str], tuple[RunOutcome, ...]]:
    """The best runs of each team and trial, best first; equal ones in order of their numbers."""
    groups: dict[tuple[str, str], list[RunOutcome]] = {}
    for run in outcomes:
        if run.task is not None or run.score is not None:
            groups.setdefault((run.team, run.trial), []).append(run)
    return {
        key: tuple(sorted(runs, key=lambda run: merit(run, spec))[: spec.keep])
        for key, runs in groups.items()
    }


def merit(run: RunOutcome, spec: Spec) -> tuple[bool, list[tuple[int, float | Decimal]], int]:
    """The sort key of the runs of a team and trial: best first, runs that only count 0 last."""
    # A crashed run counts 0, which is more than a run with penalties may have: by its score alone it
    # would be kept in place of one that drove.
    own: Mapping[str, float | Decimal | None] = {"task": run.task, "score": run.score, **run.terms}
    return run.outcome in AS_ZERO, [key.sortable(own.get(key.name)) for key in spec.by], run.number


def cohort_of(
    competition: Competition,
    rule_set: RuleSet,
    kept: Mapping[tuple[str, str], tuple[RunOutcome, ...]],
) -> Cohort:
    """The means over the best run of each team that has one, in the order of the teams.

    Args:
        competition: With its teams, of whom disqualified ones are left out where others are there.
        rule_set: What it compares.
        kept: As `best_runs` gives them.
    """
    # With everybody disqualified there would be no mean, and so no score to publish.
    trials: dict[str, list[Contributed]] = {}
    counting = [team for team in competition.teams if not team.disqualified] or competition.teams
    for trial in competition.trials:
        best = [kept.get((team.id, trial.id), ())[:1] for team in counting]
        trials[trial.id] = [_contribution(run, rule_set) for runs in best for run in runs]
    return make_cohort(rule_set, trials)


def _contribution(run: RunOutcome, rule_set: RuleSet) -> Contributed:
    if run.result is None or run.outcome in AS_ZERO:
        return Contributed((), {})
    try:
        return contributed(run.result.measured, rule_set)
    except FormulaError as error:
        return Contributed((), dict.fromkeys(rule_set.sheet.cohort, error.cause))


_OF_ALL = "and the rules count what all runs did"


def others_of(outcomes: Sequence[RunOutcome], rule_set: RuleSet) -> dict[RunKey, CohortValues]:
    """For each run that has others what they did; nothing where the rules do not ask."""
    names = rule_set.sheet.pooled
    groups: dict[tuple[str, str], list[RunOutcome]] = {}
    for run in sorted(outcomes, key=lambda run: run.number) if names else ():
        groups.setdefault((run.team, run.trial), []).append(run)
    found = {}
    for runs in groups.values():
        did = {run.key: _did(run, names, rule_set) for run in runs} if len(runs) > 1 else {}
        for run in runs if did else ():
            found[run.key] = _together([did[other.key] for other in runs if other.key != run.key])
    return found


def _did(run: RunOutcome, names: Sequence[str], rule_set: RuleSet) -> CohortValues:
    """What one run did."""
    if run.outcome == "undecided":
        return CohortValues(withheld=f"run {run.number} is undecided, {_OF_ALL}")
    if run.result is None or not _says_what_it_did(run):
        return CohortValues(lost=f"run {run.number} is {run.outcome}, {_OF_ALL}")
    values, lost = {}, ""
    for name in names:
        try:
            value = _term(name, run.result, rule_set)
            # Also where the score is one number, as behind a gate: others may be worth more or less for it.
            ends = ends_as_decided(name, run.result, rule_set) if _is_open(run.result) else (value, value)
            least, most = ends
        except FormulaError as error:
            return CohortValues(lost=f"run {run.number}: {error.cause}, {_OF_ALL}")
        if not isfinite(most):
            lost, most = f"nothing bounds what run {run.number} did, {_OF_ALL}", value
        least, most = min(least, value), max(most, value)
        values[f"{OF_RUNS}{name}"] = {"": value} | ({LEAST: least, MOST: most} if least < most else {})
    return CohortValues(values=values, lost=lost)


def _is_open(result: Result) -> bool:
    """Whether anything in a log is open, whatever the score is."""
    measured = result.measured
    undecided = (one.verdict is Verdict.INCONCLUSIVE for one in measured.findings.values())
    return bool(measured.open) or measured.lasted is not None or any(undecided)


def _together(others: Sequence[CohortValues]) -> CohortValues:
    """What several runs did: of all that never falls with one more run only the greatest stays as it is when
    a run is repeated.
    """
    values: dict[str, Mapping[str, float]] = {}
    for name in {name: None for one in others for name in one.values}:
        own = [one.values[name] for one in others if name in one.values]
        value, least, most = (max(by.get(end, by[""]) for by in own) for end in ("", LEAST, MOST))
        values[name] = {"": value} | ({LEAST: least, MOST: most} if least < most else {})
    return CohortValues(
        values=values,
        lost=next((one.lost for one in others if one.lost), ""),
        withheld=next((one.withheld for one in others if one.withheld), ""),
    )


def _says_what_it_did(run: RunOutcome) -> bool:
    """Whether what a run did is known, whatever it counts."""
    result = run.result
    ended = run.outcome in AS_ZERO and result is not None and result.status in ("scored", "needs_cohort")
    return run.outcome in WITH_SCORE or ended


def values_beside(trial: str, cohort: Cohort | None, others: CohortValues | None) -> CohortValues | None:
    """With what a run is priced of other teams and runs; `None` where it is priced alone."""
    if cohort is None:
        return others
    values = cohort.of_trial(trial)
    if others is None:
        return values
    return replace(others, sha256=values.sha256, values={**values.values, **others.values})


def priced_beside(
    run: RunOutcome, rule_set: RuleSet, cohort: Cohort | None, others: CohortValues | None
) -> RunOutcome:
    """A run with its score, where the rules compare teams or runs.

    What others of its team did is priced as it counts; where that is open, so is the score.
    """
    values = values_beside(run.trial, cohort, others)
    if values is None:
        return run
    if run.outcome == "undecided" and run.result is not None and cohort is None:
        return _undecided_beside(run, rule_set, values)
    if run.result is None or run.outcome in (*AS_ZERO, "undecided", "no_value"):
        # What other teams make of a score that is withheld is not followed, so its ends are unknown.
        return replace(run, open=None)
    try:
        result = reprice(run.result, rule_set, values)
    except FormulaError as error:
        return replace(run, outcome="no_value", cause=_error_text(error), kept=False)
    ends = _ends(result)
    if result.score is not None:
        return replace(
            run, score=result.score, result=result, cause=with_lost(run.cause, values, ends), open=ends
        )
    # Others that withhold it are no reason to say that the rules have no value for it.
    outcome = "undecided" if ends or values.beyond or _is_open(result) else "no_value"
    cause = why_withheld(result)
    return replace(run, outcome=outcome, cause=cause, score=None, result=result, kept=False, open=ends)


def _undecided_beside(run: RunOutcome, rule_set: RuleSet, others: CohortValues) -> RunOutcome:
    """A run that is undecided by itself, with what other runs of its team leave of it."""
    assert run.result is not None  # who asks knows
    with suppress(FormulaError):
        result = reprice(run.result, rule_set, others)
        if result.score is None:
            return replace(run, result=result, open=_ends(result))
    return replace(run, open=None)


def with_lost(cause: str, values: CohortValues, ends: Ends | None) -> str:
    """What is said of a run, with what a lost log beside it leaves open."""
    if not values.lost or ends is None:
        return cause
    said = f"{values.lost}: scored by those that are known, and possibly from {ends.least:f} to {ends.most:f}"
    return "; ".join(filter(None, (cause, said)))


def without_others(run: RunOutcome, spec: Spec, rule_set: RuleSet) -> RunOutcome:
    """A run of a ranking before other runs and teams were looked at.

    Args:
        run: As ranked.
        spec: As for the ranking.
        rule_set: As for the ranking.
    """
    # What is cut off and not to be ranked has a result as well.
    if run.result is None or run.outcome == "unreadable":
        return run
    return outcome_of(run.key, reprice(run.result, rule_set), rule_set, spec, partial=True)


def terms_of(result: Result, spec: Spec, rule_set: RuleSet) -> dict[str, float]:
    """The terms of the trial that runs are compared by, after the verdicts about it.

    Raises:
        FormulaError: One of them has no value.
    """
    better = {key.name: key.highest for key in (*spec.by, *spec.ties)}
    return {name: _term_compared(name, result, rule_set, highest=better[name]) for name in spec.terms}
