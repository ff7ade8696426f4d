"""Who was good and who was safe: what runs brought by task, what safety cost them, how near they came.

Of a run all follows from its result; of a team from its runs, weighted as the ranking weights them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import ScoreError
from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.outcomes import WITH_SCORE, Cell, RunOutcome, TeamRank
from ariac_score.ranking.publication import Publication
from ariac_score.ranking.violations import Clause, clause_of
from ariac_score.results.doubt import counted
from ariac_score.results.result import Result
from ariac_score.results.safety import safety_checks
from ariac_score.review.lost_points import gains_by_check
from ariac_score.review.task_and_safety import TaskAndSafety, task_and_safety
from ariac_score.scoring.ledger import taken_by
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text

__all__ = [
    "Approach",
    "Breach",
    "Parts",
    "RunConduct",
    "TeamConduct",
    "Weighing",
    "conduct_of_run",
    "conduct_of_teams",
    "parts_of_team",
]

MOST_BREACHES = 40
"""Violations of one run that are listed; the rest are counted."""

_NINE = Decimal("1e-9")


@dataclass(frozen=True)
class Approach:
    """Where a run came nearest to breaking, or most broke, a least distance.

    Attributes:
        margin_m: What was left of the distance, m; negative where it was broken.
        subject: Who came near whom.
        check: The monitor that demands the distance.
        distance_m: The distance then, m; `None` where the result keeps no curves.
        t_s: When, s; `None` likewise.
    """

    margin_m: float
    subject: str
    check: str
    distance_m: float | None = None
    t_s: float | None = None


@dataclass(frozen=True)
class Breach:
    """One violation.

    Attributes:
        finding: Its id.
        clause: The standard and the place in it.
        watched: Whether a check of safety found it.
        subject: Whom or what it is about.
        message: What happened.
        start_s: When it began, s; `None` where it has no time.
        cost: What the ledger says that it took, in points; `None` where that is nothing.
    """

    finding: str
    clause: Clause
    watched: bool
    subject: str
    message: str
    start_s: float | None
    cost: Decimal | None


@dataclass(frozen=True)
class RunConduct:
    """One run.

    Attributes:
        parts: Its score by task and safety; `None` where it cannot be split.
        approach: Its worst approach; `None` where no monitor demands a distance, or none was seen.
        violated: How many violations of safety were seen, by clause.
        undecided: How many findings of safety could not be decided, by standard.
        breaches: The violations that were seen and those that are counted because the log leaves them
            open, at most `MOST_BREACHES`, those of safety first, dear ones first.
        left_out: How many violations are not listed.
        gains: By how much the score would have been higher had one check found nothing wrong.
        priced: Whether the score depends on a check of safety.
    """

    parts: TaskAndSafety | None
    approach: Approach | None
    violated: Mapping[Clause, int]
    breaches: tuple[Breach, ...]
    left_out: int
    gains: Mapping[str, Decimal]
    undecided: Mapping[str, int] = field(default_factory=dict)
    priced: bool = True


@dataclass(frozen=True)
class TeamConduct:
    """One team over the runs that count.

    Attributes:
        task: What its execution would be with every safety check kept; `None` where a run that counts
            cannot be split, or the rules do not add the trials up.
        safety: What safety made of that.
        decided: What stewards moved.
        trials: The same for each trial.
        approach: Its worst approach, and in which run.
        violated: How many violations of safety all of its runs have, by standard.
        gains: What would have helped most in the runs that count, by check, the largest first.
        undecided: How many findings of safety could not be decided, by standard.
        priced: Whether the score of a run depends on a check of safety.
    """

    task: Decimal | None
    safety: Decimal | None
    decided: Decimal | None
    trials: Mapping[str, TaskAndSafety | None]
    approach: tuple[RunKey, Approach] | None
    violated: Mapping[str, int]
    gains: Mapping[str, Decimal]
    undecided: Mapping[str, int] = field(default_factory=dict)
    priced: bool = True


# A run ---------------------------------------------------------------------------------


def conduct_of_run(result: Result) -> RunConduct:
    """What a result says of task, safety and approaches; after decisions of stewards, where there are any."""
    rules = rule_set_from_text(result.rules, file="the rules in the result")
    monitors = frozenset(safety_checks(rules, result.measured))
    seen = result.measured.findings
    findings = {**seen, **_counted(result, rules)}
    taken = taken_by(result.ledger)
    breaches = [
        Breach(
            key,
            clause_of(finding, str(result.checks[finding.check]["use"])),
            finding.check in monitors,
            finding.subject,
            finding.message,
            finding.span.start_s if finding.span else None,
            taken[key].amount if key in taken else None,
        )
        for key, finding in findings.items()
        if finding.verdict is Verdict.VIOLATED
    ]
    breaches.sort(key=lambda breach: (not breach.watched, breach.cost or Decimal(0)))
    violated: dict[Clause, int] = {}
    for breach in breaches:
        if breach.watched and breach.finding in seen and seen[breach.finding].verdict is Verdict.VIOLATED:
            violated[breach.clause] = violated.get(breach.clause, 0) + 1
    undecided: dict[str, int] = {}
    for finding in result.measured.findings.values():
        if finding.check in monitors and finding.verdict is Verdict.INCONCLUSIVE:
            standard, _ = clause_of(finding, str(result.checks[finding.check]["use"]))
            undecided[standard] = undecided.get(standard, 0) + 1
    return RunConduct(
        _parts(result, rules),
        _approach(result, monitors),
        violated,
        tuple(breaches[:MOST_BREACHES]),
        max(0, len(breaches) - MOST_BREACHES),
        gains_by_check(result, rules),
        undecided,
        not monitors.isdisjoint(rules.sheet.priced),
    )


def _counted(result: Result, rules: RuleSet) -> Mapping[str, Finding]:
    """The findings of the world whose score counts; as they were seen where there is no score."""
    if result.score is not None:
        with suppress(ScoreError):
            return counted(result, rules).findings
    return result.measured.findings


def _parts(result: Result, rules: RuleSet) -> TaskAndSafety | None:
    """The final score in parts."""
    parts = task_and_safety(result, rules)
    if parts is None or result.score is None or result.final is None:
        return None
    return replace(parts, decided=result.final - result.score)


def _approach(result: Result, monitors: frozenset[str]) -> Approach | None:
    """The least margin to a least distance: from the curves, or without any from the findings."""
    found = [
        Approach(actual - limit, curve.subject, curve.check, actual, t_s)
        for curve in (result.measured.sketch.curves if result.measured.sketch else ())
        if curve.check in monitors and curve.unit == "m" and not curve.at_most
        for t_s, actual, limit in zip(curve.t_s, curve.actual, curve.limit, strict=True)
        if limit is not None
    ]
    found = found or [
        Approach(finding.robustness, finding.subject, finding.check)
        for finding in result.measured.findings.values()
        if finding.check in monitors and finding.robustness is not None and _is_of_distance(finding)
    ]
    return min(found, key=lambda one: one.margin_m, default=None)


def _is_of_distance(finding: Finding) -> bool:
    return finding.unit == "m" and finding.verdict in (Verdict.SATISFIED, Verdict.VIOLATED)


# A team --------------------------------------------------------------------------------


def conduct_of_teams(publication: Publication, runs: Mapping[RunKey, RunConduct]) -> dict[str, TeamConduct]:
    """What each team's runs come to.

    Args:
        publication: The ranking.
        runs: What is known of each run that has a result.
    """
    own: dict[str, list[RunOutcome]] = {standing.team: [] for standing in publication.final.standings}
    for run in publication.final.runs:
        own[run.team].append(run)
    return {
        standing.team: _of_team(publication, standing, own[standing.team], runs)
        for standing in publication.final.standings
    }


def _of_team(
    publication: Publication,
    standing: TeamRank,
    own: Sequence[RunOutcome],
    runs: Mapping[RunKey, RunConduct],
) -> TeamConduct:
    known = {run.key: runs[run.key] for run in own if run.key in runs}
    worst = [(key, one.approach) for key, one in known.items() if one.approach]
    violated: dict[str, int] = {}
    for one in known.values():
        for (standard, _), count in one.violated.items():
            violated[standard] = violated.get(standard, 0) + count
    undecided: dict[str, int] = {}
    for one in known.values():
        for standard, count in one.undecided.items():
            undecided[standard] = undecided.get(standard, 0) + count
    how = publication.how
    weighing = Weighing(how.keep, how.missing_run == "zero", how.total)
    parts = {key: one.parts for key, one in known.items()}
    trials, whole = parts_of_team(standing, own, parts, weighing)
    gains: dict[str, Decimal] = {}
    for trial, cell in standing.trials.items():
        kept = _kept(own, trial, cell)
        for run in kept:
            for check, gain in known[run.key].gains.items() if run.key in known else ():
                share = (gain * weighing.share(len(kept))).quantize(_NINE)
                gains[check] = gains.get(check, Decimal(0)) + share
    return TeamConduct(
        whole.task,
        whole.safety,
        whole.decided,
        trials,
        min(worst, key=lambda one: one[1].margin_m, default=None),
        violated,
        dict(sorted(gains.items(), key=lambda one: -one[1])),
        undecided,
        any(one.priced for one in known.values()),
    )


@dataclass(frozen=True)
class Weighing:
    """How the runs of a team weigh in its score.

    Attributes:
        keep: How many runs of a trial count.
        fill: Whether a run that was not made counts as well.
        total: How the scores of the trials become one.
    """

    keep: int
    fill: bool
    total: str

    def share(self, kept: int) -> Decimal:
        """The weight of a run that counts in the score of its trial."""
        return Decimal(1) / (self.keep if self.fill else max(1, kept))


@dataclass(frozen=True)
class Parts:
    """The parts of a team's execution; all `None` where it cannot be split."""

    task: Decimal | None = None
    safety: Decimal | None = None
    decided: Decimal | None = None


def parts_of_team(
    standing: TeamRank,
    own: Sequence[RunOutcome],
    parts: Mapping[RunKey, TaskAndSafety | None],
    weighing: Weighing,
) -> tuple[dict[str, TaskAndSafety | None], Parts]:
    """The scores of a team by task and safety, in each trial and in all.

    Args:
        standing: The team.
        own: Its runs.
        parts: The score of each run that has a result, split.
        weighing: How runs weigh.
    """
    trials = {
        trial: _cell_parts(cell, _kept(own, trial, cell), parts, weighing)
        for trial, cell in standing.trials.items()
    }
    return trials, _summed(list(trials.values()), weighing.total)


def _kept(own: Sequence[RunOutcome], trial: str, cell: Cell) -> list[RunOutcome]:
    return [run for run in own if run.trial == trial and run.number in cell.runs]


def _cell_parts(
    cell: Cell,
    kept: Sequence[RunOutcome],
    parts: Mapping[RunKey, TaskAndSafety | None],
    weighing: Weighing,
) -> TaskAndSafety | None:
    safety = decided = Decimal(0)
    for run in kept:
        if run.outcome not in WITH_SCORE:  # it counts 0, or the worst of the trial
            continue
        own = parts.get(run.key)
        if own is None or own.score != run.score:
            return None
        safety, decided = safety + own.safety, decided + own.decided
    share = weighing.share(len(kept))
    # Rounded as the score of the trial is; what that moves goes with the task.
    safety, decided = ((part * share).quantize(_NINE) for part in (safety, decided))
    return TaskAndSafety(cell.score - safety - decided, safety, decided=decided)


def _summed(trials: Sequence[TaskAndSafety | None], total: str) -> Parts:
    """The parts of a sum or mean over the trials; other ways have none."""
    count = {"sum": 1, "mean": len(trials)}.get(total)
    known = [parts for parts in trials if parts is not None]
    if not count or len(known) < len(trials):
        return Parts()
    sums = (
        sum((parts.task for parts in known), Decimal(0)),
        sum((parts.safety for parts in known), Decimal(0)),
        sum((parts.decided for parts in known), Decimal(0)),
    )
    return Parts(*(part if count == 1 else (part / count).quantize(_NINE) for part in sums))
