"""From priced runs to a ranking.

For each team and trial the best runs are kept. Where the rules compare teams, the kept
runs make the cohort and are priced with it. Their mean is the score of the trial, and the
sum over the trials is the execution of the team.

A run that cannot be read or decided is listed with its reason and costs its own team that
run; no other team loses anything by it. What has no score counts 0, or the score of the
worst run kept in that trial where that is below 0: a team never gets ahead of one that
drove by crashing or by not making the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from decimal import ROUND_HALF_EVEN, Decimal
from math import isfinite
from typing import Annotated, Any

from msgspec import Meta

from ariac_score.checks.findings import Verdict
from ariac_score.engine.price import reprice
from ariac_score.errors import FormulaError, OtherFactError, RunEndedError, ScoreError
from ariac_score.ranking.competition import Competition, RunKey, Team
from ariac_score.ranking.open_scores import (
    MONOTONE_TOTALS,
    Ends,
    OpenStanding,
    Slots,
    cell_ends,
    rank_ends,
    worst_ends,
)
from ariac_score.ranking.spec import COUNT_BACK, Key, Spec
from ariac_score.results.adjustments import counted_as_decided, ends_as_decided
from ariac_score.results.codec import leave_out_empty
from ariac_score.results.cohort_file import Cohort, contributed, make_cohort
from ariac_score.results.doubt import why_withheld
from ariac_score.results.result import Pinned, Result
from ariac_score.scoring.cohort import LEAST, MOST, CohortValues
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import Expression, Number, add_up
from ariac_score.scoring.left_open import DURATION, OF_RUNS
from ariac_score.scoring.policy import assume
from ariac_score.scoring.pricing import Contributed
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.scoring.scope import lasting
from ariac_score.scoring.steward import Adjustment, with_verdicts

__all__ = [
    "AS_ZERO",
    "OUTCOMES",
    "WITH_SCORE",
    "Cell",
    "Outcome",
    "Ranking",
    "RunOutcome",
    "Stewarded",
    "TeamRank",
    "cell_digits",
    "final_ranking",
    "is_scored",
    "merit",
    "others_of",
    "priced_beside",
    "rank_again",
    "rank_results",
    "remarks_on_team",
    "terms_of",
    "values_beside",
    "with_lost",
    "without_others",
]

OUTCOMES: Mapping[str, str] = {
    "scored": "it has a score",
    "crashed": "the simulator died and wrote no score: 0",
    "cancelled": "the run was cancelled and has no score: 0",
    "aborted": "the run ended before all work was done; its score stands",
    "unofficial": "its log is cut off; the score of what is there stands, as was asked for: unofficial",
    "disqualified": "the stewards disqualified it: 0",
    "undecided": "something the score depends on is undecided: not counted",
    "unreadable": "the log cannot be read as one trial: not counted",
    "no_value": "the rules have no value for it, such as a division by 0: not counted",
    "refused": "another run has the same number: neither counts",
    "no_run": "there is no run",
}
"""How a run, or a team's trial, can end."""
Outcome = Annotated[str, Meta(pattern=f"^({'|'.join(OUTCOMES)})$")]
# Without "aborted": such a run has a score, and that stands.
AS_ZERO = ("crashed", "cancelled", "disqualified")
WITH_SCORE = ("scored", "aborted", "unofficial")
"""These have a score of their own."""
"""These have no score of their own, and count 0 or the worst of their trial."""


@dataclass(frozen=True)
class RunOutcome:
    """One run: how it ended, its score, whether it counts.

    Attributes:
        team: Team.
        trial: Trial.
        number: Number of the run.
        outcome: One of `OUTCOMES`.
        cause: Why it ended so, in words, where that is out of the ordinary.
        task: Task score, where the rules have one.
        score: Score; `None` when there is none. Where the rules compare teams, only runs kept have one.
        kept: Whether it counts for the trial.
        terms: The terms of the trial that runs are compared by.
        worst: The worst score of the trial, where that counts for this run instead of 0.
        decisions: Ids of the stewards' decisions that changed it.
        result: The result, where there is one.
        open: Between which ends its score lies, where its log leaves that open.
    """

    team: str
    trial: str
    number: int
    outcome: Outcome
    cause: str = ""
    task: Decimal | None = None
    score: Decimal | None = None
    kept: bool = False
    terms: Mapping[str, float] = field(default_factory=dict)
    worst: Decimal | None = None
    decisions: tuple[str, ...] = ()
    result: Result | None = field(default=None, repr=False, compare=False)
    open: Ends | None = None

    @property
    def key(self) -> RunKey:
        """Team, trial, number."""
        return self.team, self.trial, self.number

    @property
    def reason(self) -> str:
        """The cause, and what the run counts where that is not 0."""
        return self.cause if self.worst is None else _counting(self.cause, self.worst)


@dataclass(frozen=True)
class Cell:
    """The score of one team in one trial.

    Attributes:
        score: Mean of the runs kept; without any, 0 or the worst score of the trial.
        outcome: `scored`, or why it is 0: one of `OUTCOMES`.
        reason: In words.
        runs: Numbers of the runs that count.
        made: Number of runs, counting or not.
        open: Between which ends the score lies, where logs leave that open.
    """

    score: Decimal
    outcome: Outcome
    reason: str
    runs: tuple[int, ...]
    made: int
    open: Ends | None = None

    def __post_init__(self) -> None:
        leave_out_empty(self, "open")


@dataclass(frozen=True)
class TeamRank:
    """One team in the ranking.

    Attributes:
        rank: 1 for the best; teams that nothing separates share it. `None` when the team
            has no value, as without the judges' marks.
        team: Id.
        name: As shown.
        value: What teams are ranked by.
        execution: Sum over the trials, or what the rules take instead.
        judges: Sum or mean of the judges' marks; `None` when there are none.
        ties: The values that separate teams of equal value, by name.
        trials: Its score in each trial.
        remarks: What a reader of the ranking must know about this team.
        places: In how many trials it came first, second, and so on.
        separated_by: What puts it behind the team before it: `value`, or one of the ties;
            empty for the first team, for a shared rank, and for a team without a rank.
        disqualified: Why it has no rank, where it was disqualified.
        open: Between which ends its execution and its rank lie, where logs of any team leave that open.
    """

    rank: int | None
    team: str
    name: str
    value: Number | None
    execution: Decimal
    judges: Decimal | None
    ties: Mapping[str, int | float | None]
    trials: Mapping[str, Cell]
    remarks: tuple[str, ...] = ()
    places: tuple[int, ...] = ()
    separated_by: str = ""
    disqualified: str = ""
    open: OpenStanding | None = None

    def __post_init__(self) -> None:
        leave_out_empty(self, "open")


@dataclass(frozen=True)
class Ranking:
    """A ranked competition.

    Attributes:
        competition: Id.
        title: One line for people.
        rule_set: By which its runs were scored.
        trials: Their ids in order.
        standings: Best first.
        runs: Every run, sorted by team, trial and number.
        cohort: The values across teams; `None` when the rules compare none.
        strangers: Files and folders among the runs that belong to no team or trial.
        worst: By trial what counts where there is no score: 0, or the score of the worst run kept.
        stewarded: The ranking after the decisions of stewards; all else is the automatic one.
    """

    competition: str
    title: str
    rule_set: Pinned
    trials: tuple[str, ...]
    standings: tuple[TeamRank, ...]
    runs: tuple[RunOutcome, ...]
    cohort: Cohort | None
    strangers: tuple[str, ...] = ()
    worst: Mapping[str, Decimal] = field(default_factory=dict)
    stewarded: Stewarded | None = None


@dataclass(frozen=True)
class Stewarded:
    """A ranking after the decisions of stewards.

    Attributes:
        ranking: The adjusted ranking.
        adjustments: The decisions, in the order of their file.
        sha256: Of the file.
    """

    ranking: Ranking
    adjustments: tuple[Adjustment, ...]
    sha256: str


@in_own_decimals
def rank_results(
    competition: Competition,
    spec: Spec,
    rule_set: RuleSet,
    results: Mapping[RunKey, Result | ScoreError],
    *,
    partial: bool = False,
) -> Ranking:
    """Rank the runs of a competition.

    Args:
        competition: Teams, trials, judges' marks, runs refused.
        spec: How runs become a ranking.
        rule_set: The rule set that prices the results.
        results: For each run its result, or why there is none.
        partial: Whether results of logs that are cut off count, from which nothing official follows.
    """
    # Kept runs make the cohort, and the cohort prices runs: runs are chosen before, by what needs none.
    outcomes = [_outcome(key, result, rule_set, spec, partial) for key, result in sorted(results.items())]
    outcomes += [RunOutcome(*key, "refused", reason) for key, reason in competition.refused.items()]
    kept = _kept(outcomes, spec)
    cohort = _cohort(competition, rule_set, kept) if rule_set.sheet.needs_cohort else None
    others, counting = others_of(outcomes, rule_set), {run.key for best in kept.values() for run in best}
    outcomes = [
        priced_beside(replace(run, kept=run.key in counting), rule_set, cohort, others.get(run.key))
        for run in sorted(outcomes, key=lambda run: run.key)
    ]
    return _ranking(competition, spec, rule_set, outcomes, cohort)


def final_ranking(ranking: Ranking) -> Ranking:
    """The ranking that counts: the adjusted one, where stewards decided something."""
    return ranking.stewarded.ranking if ranking.stewarded else ranking


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
    return _outcome(run.key, reprice(run.result, rule_set), rule_set, spec, partial=True)


def terms_of(result: Result, spec: Spec, rule_set: RuleSet) -> dict[str, float]:
    """The terms of the trial that runs are compared by, after the verdicts about it.

    Raises:
        FormulaError: One of them has no value.
    """
    return {name: _term(name, result, rule_set) for name in spec.terms}


@in_own_decimals
def rank_again(
    competition: Competition,
    spec: Spec,
    rule_set: RuleSet,
    ranking: Ranking,
    changed: Mapping[RunKey, RunOutcome],
) -> Ranking:
    """The ranking with other outcomes of some runs.

    The values across teams stay as they are: what stewards decide about one team must not move
    the score of another.

    Args:
        competition: As for `ranking`.
        spec: As for `ranking`.
        rule_set: As for `ranking`.
        ranking: An automatic ranking.
        changed: The outcomes that differ.
    """
    outcomes = [changed.get(run.key) or _at_zero(run) for run in ranking.runs]
    # Scores that come from other teams and runs were not there when runs were first chosen; so they
    # have no say in this choice either.
    scored_later = rule_set.sheet.needs_cohort or bool(rule_set.sheet.pooled)
    comparable = [
        replace(run, score=None) if scored_later and run.task is not None else run for run in outcomes
    ]
    kept = {run.key for best in _kept(comparable, spec).values() for run in best}
    counting = (*WITH_SCORE, *AS_ZERO)
    outcomes = [replace(run, kept=run.key in kept and run.outcome in counting) for run in outcomes]
    return _ranking(competition, spec, rule_set, outcomes, ranking.cohort)


def _ranking(
    competition: Competition,
    spec: Spec,
    rule_set: RuleSet,
    outcomes: Sequence[RunOutcome],
    cohort: Cohort | None,
) -> Ranking:
    worst = _worst(competition, outcomes, spec)
    outcomes = [_at_worst(run, worst[run.trial]) if run.trial in worst else run for run in outcomes]
    groups: dict[tuple[str, str], list[RunOutcome]] = {}
    for run in outcomes:
        groups.setdefault((run.team, run.trial), []).append(run)
    cells = {
        (team.id, trial.id): _cell(
            groups.get((team.id, trial.id), []), spec, rule_set.digits, worst[trial.id]
        )
        for team in competition.teams
        for trial in competition.trials
    }
    return Ranking(
        competition=competition.id,
        title=competition.title,
        rule_set=Pinned(rule_set.id, rule_set.sha256),
        trials=tuple(trial.id for trial in competition.trials),
        standings=_with_ends(
            _standings(competition, spec, cells, outcomes), spec, groups, worst, rule_set.digits
        ),
        runs=tuple(outcomes),
        cohort=cohort,
        strangers=competition.strangers,
        worst=worst,
    )


# Runs ----------------------------------------------------------------------------------


def _outcome(
    key: RunKey, result: Result | ScoreError, rule_set: RuleSet, spec: Spec, partial: bool
) -> RunOutcome:
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


def _kept(outcomes: Sequence[RunOutcome], spec: Spec) -> dict[tuple[str, str], tuple[RunOutcome, ...]]:
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


def _cohort(
    competition: Competition,
    rule_set: RuleSet,
    kept: Mapping[tuple[str, str], tuple[RunOutcome, ...]],
) -> Cohort:
    """The means over the best run of each team that has one, in the order of the teams."""
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
    outcome = "undecided" if ends or values.beyond else "no_value"
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


def _worst(competition: Competition, outcomes: Sequence[RunOutcome], spec: Spec) -> dict[str, Decimal]:
    """For each trial what counts where there is no score: 0, or the worst score kept where that is worse.

    The scores of disqualified teams are left out.
    """
    out = {team.id for team in competition.teams if team.disqualified}
    scores: dict[str, list[Decimal]] = {trial.id: [Decimal(0)] for trial in competition.trials}
    for run in outcomes:
        known = run.kept and run.score is not None and run.outcome not in AS_ZERO
        if known and run.trial in scores and run.team not in out:
            assert run.score is not None  # `known` says so
            scores[run.trial].append(run.score)
    return {trial: (min if spec.more_is_better else max)(found) for trial, found in scores.items()}


def _counting(cause: str, worst: Decimal) -> str:
    return f"{cause}; it counts {worst:f}, the worst of the trial"


def _at_worst(run: RunOutcome, worst: Decimal) -> RunOutcome:
    return replace(run, score=worst, worst=worst) if run.outcome in AS_ZERO and worst else run


def _at_zero(run: RunOutcome) -> RunOutcome:
    """The run before the worst of its trial was looked at; stewards can change what that is."""
    return run if run.worst is None else replace(run, score=Decimal(0), worst=None)


def _cell(runs: Sequence[RunOutcome], spec: Spec, digits: int, worst: Decimal) -> Cell:
    kept = [run for run in runs if run.kept and run.score is not None]
    if not kept:
        # The reason shown is that of the first run that went wrong, not of one that merely was not kept.
        why = next((run for run in runs if run.outcome not in WITH_SCORE), None)
        outcome, cause = (why.outcome, why.cause) if why else ("no_run", OUTCOMES["no_run"])
        return Cell(worst, outcome, _counting(cause, worst) if worst else cause, (), len(runs))
    total = sum((run.score for run in kept if run.score is not None), Decimal(0))
    if spec.fill:
        total += worst * (spec.keep - len(kept))
    mean = total / (spec.keep if spec.fill else len(kept))
    score = mean.quantize(Decimal(1).scaleb(-cell_digits(spec, digits)), rounding=ROUND_HALF_EVEN)
    zeros = [run for run in kept if run.outcome in AS_ZERO]
    outcome, reason = (zeros[0].outcome, zeros[0].reason) if len(zeros) == len(kept) else ("scored", "")
    return Cell(score, outcome, reason, tuple(sorted(run.number for run in kept)), len(runs))


def cell_digits(spec: Spec, digits: int) -> int:
    """Decimal digits of the score of a team in a trial: those of a run, or more for a mean."""
    # A mean has more digits than its scores; 9 are the most that a rule set may declare.
    return digits if spec.keep == 1 else max(digits, 9)


# Teams ---------------------------------------------------------------------------------


def _standings(
    competition: Competition,
    spec: Spec,
    cells: Mapping[tuple[str, str], Cell],
    outcomes: Sequence[RunOutcome],
) -> tuple[TeamRank, ...]:
    own = {
        team.id: {trial.id: cells[team.id, trial.id] for trial in competition.trials}
        for team in competition.teams
    }
    totals = [
        {
            "execution": spec.total.execution([cell.score for cell in own[team.id].values()]),
            "judges": _judges(team, spec),
        }
        for team in competition.teams
    ]
    counting = [number for number, team in enumerate(competition.teams) if not team.disqualified]
    values = dict(zip(counting, spec.values([totals[number] for number in counting]), strict=True))
    won = _places([own[competition.teams[number].id] for number in counting], spec)
    ties = [key.name for key in spec.ties if key.name != COUNT_BACK]
    alike = _same_recordings(outcomes)
    found = [
        TeamRank(
            None,
            team.id,
            team.name,
            values.get(number),
            total["execution"] or Decimal(0),
            total["judges"],
            {name: _tie(name, team.id, total, outcomes) for name in ties},
            own[team.id],
            (
                *_remarks(own[team.id], values.get(number), _missing_marks(team, competition.teams), team),
                *alike.get(team.id, ()),
            ),
            won[counting.index(number)] if number in values else (),
            disqualified=team.disqualified,
        )
        for number, (team, total) in enumerate(zip(competition.teams, totals, strict=True))
    ]
    ranked = _ranked(found, spec)
    if any(run.outcome in AS_ZERO or (run.kept and run.score is not None) for run in outcomes):
        return ranked
    # Where no run counts, all teams are equal only in that nothing is known of them: that is no rank.
    return tuple(replace(standing, rank=None) for standing in ranked)


def _with_ends(
    standings: tuple[TeamRank, ...],
    spec: Spec,
    groups: Mapping[tuple[str, str], Sequence[RunOutcome]],
    worst: Mapping[str, Decimal],
    digits: int,
) -> tuple[TeamRank, ...]:
    """The standings with what open scores mean for them; as they are where none is open.

    Values across teams are taken as published: which of them another score would move is not followed.
    """
    if spec.total.name not in MONOTONE_TOTALS or not any(run.open for own in groups.values() for run in own):
        return standings
    slots = Slots(
        spec.keep, spec.fill, cell_digits(spec, digits), spec.more_is_better, spec.by[0].name == "score"
    )
    worst_of = _worst_of(standings, spec, groups, worst)
    found: dict[str, Ends] = {}
    trials: dict[str, dict[str, Cell]] = {}
    for standing in standings:
        cells = [
            _cell_ends(groups.get((standing.team, trial), ()), cell, worst_of[trial], slots)
            for trial, cell in standing.trials.items()
        ]
        ends = [
            spec.total.execution(list(side)) for side in zip(*((c.least, c.most) for c in cells), strict=True)
        ]
        trials[standing.team] = {
            trial: replace(cell, open=own if own.least != own.most else None)
            for (trial, cell), own in zip(standing.trials.items(), cells, strict=True)
        }
        found[standing.team] = Ends(*ends) if ends else Ends(standing.execution, standing.execution)
    ranks = _rank_ends(standings, spec, found)
    return tuple(
        replace(
            standing,
            trials=trials[standing.team],
            open=OpenStanding(
                found[standing.team],
                *ranks.get(standing.team, (None, None)),
                sum(
                    run.open is not None
                    for trial in standing.trials
                    for run in groups.get((standing.team, trial), ())
                ),
            ),
        )
        for standing in standings
    )


def _worst_of(
    standings: Sequence[TeamRank],
    spec: Spec,
    groups: Mapping[tuple[str, str], Sequence[RunOutcome]],
    worst: Mapping[str, Decimal],
) -> dict[str, Ends]:
    """Between which ends the worst score of each trial lies, which counts for whoever has none."""
    out = {standing.team for standing in standings if standing.disqualified}
    return {
        trial: worst_ends(
            score,
            [
                Ends(run.score, run.score) if run.open is None else run.open
                for (team, of), own in groups.items()
                for run in own
                if of == trial and team not in out and run.kept and run.score is not None
                if run.outcome not in AS_ZERO
            ],
            more_is_better=spec.more_is_better,
        )
        for trial, score in worst.items()
    }


def _rank_ends(
    standings: Sequence[TeamRank], spec: Spec, found: Mapping[str, Ends]
) -> Mapping[str, tuple[int | None, int | None]]:
    """Between which ranks each ranked team is, where executions decide."""
    if spec.value.source != "execution":
        return {}
    ranked = {s.team: s.rank for s in standings if s.rank is not None}
    values = {
        team: ends if spec.highest else Ends(-ends.most, -ends.least)
        for team, ends in found.items()
        if team in ranked
    }
    return rank_ends(values, ranked)


def _cell_ends(runs: Sequence[RunOutcome], cell: Cell, worst: Ends, slots: Slots) -> Ends:
    known = [run for run in runs if run.outcome not in AS_ZERO and (run.score is not None or run.open)]
    if not any(run.open for run in known) and worst.least == worst.most:
        return Ends(cell.score, cell.score)
    ends = [run.open or Ends(run.score or Decimal(0), run.score or Decimal(0)) for run in known]
    zeros = sum(run.outcome in AS_ZERO for run in runs)
    return cell_ends(ends, zeros, worst, slots).around(cell.score)


def _places(teams: Sequence[Mapping[str, Cell]], spec: Spec) -> list[tuple[int, ...]]:
    """For each team in how many trials it came first, second, and so on; equal scores share a place."""
    counts = [[0] * len(teams) for _ in teams]
    for trial in teams[0] if teams else ():
        scored = [cells[trial].score for cells in teams if is_scored(cells[trial])]
        for own, cells in zip(counts, teams, strict=True):
            score = cells[trial].score
            if is_scored(cells[trial]):  # a trial without a run is no place, not even the last
                own[sum(1 for s in scored if (s > score if spec.more_is_better else s < score))] += 1
    return [tuple(own) for own in counts]


def is_scored(cell: Cell) -> bool:
    """Whether a team has a run of its own that counts in this trial."""
    return cell.outcome == "scored"


def _judges(team: Team, spec: Spec) -> Decimal | None:
    if not team.judges:
        return None
    # From its shortest text, for the float 4.1 is a little less than 4.1 and sums of marks decide ties.
    marks = [Decimal(repr(mark)) for judge in team.judges for mark in judge]
    total = sum(marks, Decimal(0))
    return total if spec.judges == "sum" else total / len(team.judges)


def _tie(
    name: str, team: str, total: Mapping[str, Decimal | None], outcomes: Sequence[RunOutcome]
) -> float | None:
    """A value that separates teams of equal value: a total, or a term summed over the runs kept."""
    if name in total:
        value = total[name]
        return None if value is None else float(value)
    found = [run.terms[name] for run in outcomes if run.team == team and run.kept and name in run.terms]
    return float(add_up(found)) if found else None


def _missing_marks(team: Team, teams: Sequence[Team]) -> str:
    """The remark on a team with fewer marks than another; empty when it has all."""
    judges = max(len(other.judges) for other in teams)
    marks = max(sum(map(len, other.judges)) for other in teams)
    own = sum(map(len, team.judges))
    if (len(team.judges), own) == (judges, marks):
        return ""
    return f"marks of {len(team.judges)} judges, {own} in all; others have {judges} and {marks}"


def _remarks(
    cells: Mapping[str, Cell], value: Number | None, missing_marks: str, team: Team
) -> tuple[str, ...]:
    remarks = [
        f"{trial}: {cell.outcome}: {cell.reason}" for trial, cell in cells.items() if cell.outcome != "scored"
    ]
    if team.disqualified:
        remarks.append(f"disqualified: {team.disqualified}")
    elif value is None:
        remarks.append("no value: the judges' marks are missing")
    elif missing_marks:
        remarks.append(missing_marks)
    return tuple(remarks)


def _same_recordings(outcomes: Sequence[RunOutcome]) -> dict[str, list[str]]:
    """For each team its runs whose recording is another run's as well, byte for byte.

    Nothing tells who copied it, or whether two robots just stood still, so both teams are told.
    """
    groups: dict[frozenset[str], list[RunOutcome]] = {}
    for run in outcomes:
        if recording := _recording(run):
            groups.setdefault(recording, []).append(run)
    remarks: dict[str, list[str]] = {}
    for runs in groups.values():
        for run in runs if len(runs) > 1 else ():
            others = [f"{o.team}, {o.trial}, run {o.number}" for o in runs if o.key != run.key]
            more = f" and {len(others) - 3} more" if len(others) > 3 else ""
            remarks.setdefault(run.team, []).append(
                f"{run.trial}, run {run.number}: its recording is, byte for byte, also that of "
                f"{'; '.join(others[:3])}{more}"
            )
    return remarks


def _recording(run: RunOutcome) -> frozenset[str]:
    """The hashes of its logs; an organiser's text or database may hold what many runs came to."""
    parts = run.result.provenance.inputs if run.result else ()
    return frozenset(part.sha256 for part in parts if part.role == "log")


def remarks_on_team(standing: TeamRank) -> tuple[str, ...]:
    """The remarks on the team itself, without those on its trials."""
    # `_remarks` puts those on trials first, one for each trial that is not scored.
    return standing.remarks[sum(1 for cell in standing.trials.values() if cell.outcome != "scored") :]


def _ranked(found: Sequence[TeamRank], spec: Spec) -> tuple[TeamRank, ...]:
    """Best first; teams that nothing separates share a rank, and the next rank counts them all."""

    def place(standing: TeamRank) -> list[Any]:
        value = standing.value
        first = (1, 0.0) if value is None else (0, -value if spec.highest else value)
        return [first, *(_tie_key(key, standing) for key in spec.ties)]

    ordered = sorted(found, key=lambda standing: (bool(standing.disqualified), place(standing)))
    names = ["value", *(key.name for key in spec.ties)]
    ranked: list[TeamRank] = []
    for position, standing in enumerate(ordered, start=1):
        pairs = zip(names, place(ranked[-1]), place(standing), strict=True) if ranked else ()
        differ = [name for name, before, own in pairs if before != own]
        if standing.value is None:
            ranked.append(standing)
        elif ranked and not differ:  # the next rank counts those who share: 1, 2, 2, 4
            ranked.append(replace(standing, rank=ranked[-1].rank))
        else:
            ranked.append(replace(standing, rank=position, separated_by=differ[0] if differ else ""))
    return tuple(ranked)


def _tie_key(key: Key, standing: TeamRank) -> Any:
    if key.name == COUNT_BACK:
        return tuple(-count for count in standing.places)
    return key.sortable(standing.ties[key.name])
