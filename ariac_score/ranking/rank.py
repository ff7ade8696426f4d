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
from dataclasses import replace
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any

from ariac_score.errors import ScoreError
from ariac_score.ranking.beside import best_runs, cohort_of, others_of, outcome_of, priced_beside
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
from ariac_score.ranking.outcomes import (
    AS_ZERO,
    OUTCOMES,
    WITH_SCORE,
    Cell,
    Ranking,
    RunOutcome,
    TeamRank,
    counting_worst,
)
from ariac_score.ranking.spec import COUNT_BACK, Key, Spec
from ariac_score.results.cohort_file import Cohort
from ariac_score.results.result import Pinned, Result
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import Number, add_up
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["cell_digits", "is_scored", "rank_again", "rank_results", "remarks_on_team"]


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
    outcomes = [outcome_of(key, result, rule_set, spec, partial) for key, result in sorted(results.items())]
    outcomes += [RunOutcome(*key, "refused", reason) for key, reason in competition.refused.items()]
    kept = best_runs(outcomes, spec)
    cohort = cohort_of(competition, rule_set, kept) if rule_set.sheet.needs_cohort else None
    others, counting = others_of(outcomes, rule_set), {run.key for best in kept.values() for run in best}
    outcomes = [
        priced_beside(replace(run, kept=run.key in counting), rule_set, cohort, others.get(run.key))
        for run in sorted(outcomes, key=lambda run: run.key)
    ]
    return _ranking(competition, spec, rule_set, outcomes, cohort)


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
    kept = {run.key for best in best_runs(comparable, spec).values() for run in best}
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
        return Cell(worst, outcome, counting_worst(cause, worst) if worst else cause, (), len(runs))
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
