"""A ranking as it is published: every number that entered it, by team, trial and run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

from msgspec import UNSET, Meta, Struct, UnsetType, convert

from ariac_score.checks.registry import Plugin, package_sha256
from ariac_score.errors import DataFileError, PluginError
from ariac_score.ranking.compare import RankingDifference
from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.evaluation import Entry, Evaluation, PlannedItem, Stop
from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import Outcome, Ranking, RunOutcome, Stewarded, TeamRank, final_ranking
from ariac_score.ranking.spec import COUNT_BACK, Intervals, Key, Spec
from ariac_score.ranking.statistics import Statistics
from ariac_score.ranking.totals import SUM, total_named
from ariac_score.results.codec import Format
from ariac_score.results.cohort_file import Cohort
from ariac_score.results.result import Pinned, Sha256
from ariac_score.results.result_file import Decision1, decision_from_1
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import Number
from ariac_score.scoring.steward import Adjustment

__all__ = ["PUBLICATION", "Publication", "StoredResult", "load_publication", "ranking_json"]


class StoredResult(Struct, frozen=True, forbid_unknown_fields=True):
    """Where the result of a run is kept.

    Attributes:
        file: Below the folder of results, with `/` between its parts.
        sha256: Of the file.
    """

    file: Annotated[str, Meta(min_length=1)]
    sha256: Sha256


class Input(Struct, frozen=True, forbid_unknown_fields=True):
    """A file that a run was scored from.

    Attributes:
        role: Such as `log`.
        name: Within the bundle.
        sha256: Of its content.
    """

    role: str
    name: str
    sha256: str


class PublishedRun(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One run: how it ended, its score, whether it counts.

    Attributes:
        team: Team.
        trial: Trial.
        run: Its number.
        outcome: How it ended.
        reason: In words, where it is out of the ordinary.
        task: Task score, where the rules have one.
        score: Score; null when there is none. Where the rules compare teams, only runs kept have one.
        kept: Whether it counts for the trial.
        terms: The terms of the trial that runs are compared by.
        inputs: The files it was scored from.
        result: Its result, below the folder of results; null when it is not given.
        decisions: Ids of the stewards' decisions that changed it.
        open: Between which ends its score lies, where its log leaves that open.
    """

    team: str
    trial: str
    run: int
    outcome: Outcome
    reason: str
    task: Decimal | None
    score: Decimal | None
    kept: bool
    terms: Mapping[str, int | float]
    inputs: tuple[Input, ...]
    result: StoredResult | None
    decisions: tuple[str, ...] = ()
    open: Ends | None = None

    @property
    def key(self) -> RunKey:
        """Team, trial, number."""
        return self.team, self.trial, self.run


class How(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """How runs became ranks, as in the `ranking` of a rule set, defaults included.

    Attributes:
        keep: How many runs of a trial count.
        by: What makes a run better, most important first.
        missing_run: Whether a run that was not made counts `zero` or is left out of the mean.
        judges: Whether the judges' marks are added up or averaged.
        value: What teams are ranked by.
        best: Which value comes first.
        ties: What separates teams of equal value, most important first.
        intervals: How the uncertainty of ranks is estimated.
        total: How the scores of a team in its trials became its execution.
        total_by: Distribution, version and SHA-256 of the code of `total`; empty for the sum.
    """

    keep: Annotated[int, Meta(ge=1)]
    by: tuple[Mapping[str, str], ...]
    missing_run: Annotated[str, Meta(pattern="^(zero|leave_out)$")]
    judges: Annotated[str, Meta(pattern="^(sum|mean)$")]
    value: str
    best: Annotated[str, Meta(pattern="^(highest|lowest)$")]
    ties: tuple[Mapping[str, str], ...]
    intervals: Intervals
    total: str = SUM
    total_by: str = ""


class OrganisersRanking(Struct, frozen=True, forbid_unknown_fields=True):
    """What the organisers' own program gives, and where it differs.

    Attributes:
        trials: By trial the entry of each team; teams that stopped the program are missing.
        orders: The outermost items of each trial; null where an older version kept none.
        leaderboard: Team and sum, best first.
        stops: Where the program would have stopped.
        differences: Every trial score, sum and rank in which this ranking differs.
    """

    trials: Mapping[str, Mapping[str, Entry]]
    orders: Mapping[str, tuple[PlannedItem, ...]] | None
    leaderboard: tuple[tuple[str, Number], ...]
    stops: tuple[Stop, ...]
    differences: tuple[RankingDifference, ...]


class PublishedDecisions(Struct, frozen=True, forbid_unknown_fields=True):
    """The ranking after the decisions of stewards.

    Attributes:
        sha256: Of `adjustments.yaml`.
        adjustments: The decisions, in the order of their file.
        standings: Best first.
        runs: Every run.
        worst: By trial what counts where there is no score.
        statistics: How sure this ranking is; null where that was not computed.
    """

    sha256: Sha256
    adjustments: Annotated[tuple[Adjustment, ...], Meta(min_length=1)]
    standings: tuple[TeamRank, ...]
    runs: tuple[PublishedRun, ...]
    worst: Mapping[str, Decimal]
    statistics: Statistics | None


@dataclass(frozen=True)
class Publication:
    """A ranking as it is published.

    Attributes:
        competition: Id.
        title: One line for people.
        rule_set: By which its runs were scored.
        trials: Their ids in order.
        how: How runs became ranks.
        standings: Best first.
        runs: Every run, sorted by team, trial and number.
        worst: By trial what counts where a team has no score: 0, or the score of the worst run kept.
        statistics: How sure the ranking is; null where that was not computed.
        cohort: The values across teams; null when the rules compare none.
        strangers: Files and folders among the runs that belong to no team or trial.
        folder: Where the results are, relative to the file; empty when they are not given.
        strict: The organisers' own evaluation, where it was reproduced, and where it differs.
        adjusted: The ranking after the decisions of stewards; null where there are none.
    """

    competition: str
    title: str
    rule_set: Pinned
    trials: tuple[str, ...]
    how: How
    standings: tuple[TeamRank, ...]
    runs: tuple[PublishedRun, ...]
    worst: Mapping[str, Decimal]
    statistics: Statistics | None
    cohort: Cohort | None
    strangers: tuple[str, ...]
    folder: str
    strict: OrganisersRanking | None
    adjusted: PublishedDecisions | None

    @cached_property
    def ranking(self) -> Ranking:
        """The ranking, automatic and after the decisions of stewards; its runs are without their results."""
        automatic = self._ranking(self.standings, self.runs, self.worst)
        adjusted = self.adjusted
        if adjusted is None:
            return automatic
        after = self._ranking(adjusted.standings, adjusted.runs, adjusted.worst)
        return replace(automatic, stewarded=Stewarded(after, adjusted.adjustments, adjusted.sha256))

    def _ranking(
        self, standings: tuple[TeamRank, ...], runs: tuple[PublishedRun, ...], worst: Mapping[str, Decimal]
    ) -> Ranking:
        return Ranking(
            competition=self.competition,
            title=self.title,
            rule_set=self.rule_set,
            trials=self.trials,
            standings=standings,
            runs=tuple(
                RunOutcome(
                    r.team,
                    r.trial,
                    r.run,
                    r.outcome,
                    r.reason,  # the whole of it: what a run counts stands in the text that was published
                    r.task,
                    r.score,
                    r.kept,
                    r.terms,
                    decisions=r.decisions,
                    open=r.open,
                )
                for r in runs
            ),
            cohort=self.cohort,
            strangers=self.strangers,
            worst=worst,
        )

    @cached_property
    def final(self) -> Ranking:
        """The ranking that counts: the adjusted one, where stewards decided something."""
        return final_ranking(self.ranking)

    @property
    def final_statistics(self) -> Statistics | None:
        """How sure the ranking that counts is."""
        return self.statistics if self.adjusted is None else self.adjusted.statistics

    @cached_property
    def results(self) -> Mapping[RunKey, StoredResult]:
        """For each run its result, where it is given."""
        return {run.key: run.result for run in self.runs if run.result is not None}

    @cached_property
    def inputs(self) -> Mapping[RunKey, tuple[Input, ...]]:
        """For each run the files it was scored from."""
        return {run.key: run.inputs for run in self.runs}


def ranking_json(
    ranking: Ranking,
    spec: Spec,
    statistics: Statistics | None = None,
    adjusted: Statistics | None = None,
    strict: Evaluation | None = None,
    differences: tuple[RankingDifference, ...] = (),
    *,
    folder: str = "",
    results: Mapping[RunKey, StoredResult] | None = None,
) -> str:
    """A ranking as its canonical text, with a newline at its end.

    Args:
        ranking: The ranking.
        spec: How its runs became it.
        statistics: How sure it is.
        adjusted: How sure the ranking is after the decisions of stewards, where there are any.
        strict: The organisers' own evaluation, where it was reproduced.
        differences: Where that differs from this ranking.
        folder: Where the results are, relative to the file this will be.
        results: The result of each run, where they were written.
    """
    stored = results or {}
    after = ranking.stewarded
    return PUBLICATION.text(
        Publication(
            competition=ranking.competition,
            title=ranking.title,
            rule_set=ranking.rule_set,
            trials=ranking.trials,
            how=_how(spec),
            standings=ranking.standings,
            runs=tuple(_run(run, stored.get(run.key)) for run in ranking.runs),
            worst=ranking.worst,
            statistics=statistics,
            cohort=ranking.cohort,
            strangers=ranking.strangers,
            folder=folder,
            strict=None if strict is None else _organisers(strict, differences),
            adjusted=None
            if after is None
            else PublishedDecisions(
                sha256=after.sha256,
                adjustments=after.adjustments,
                standings=after.ranking.standings,
                # Results are automatic and stand with the automatic runs.
                runs=tuple(_run(run, None) for run in after.ranking.runs),
                worst=after.ranking.worst,
                statistics=adjusted,
            ),
        )
    )


def _organisers(strict: Evaluation, differences: tuple[RankingDifference, ...]) -> OrganisersRanking:
    return OrganisersRanking(
        trials=strict.trials,
        orders={trial: tuple(work) for trial, work in strict.work.items()},
        leaderboard=strict.leaderboard,
        stops=strict.stops,
        differences=differences,
    )


def _how(spec: Spec) -> How:
    return How(
        keep=spec.keep,
        by=tuple(_key(key) for key in spec.by),
        missing_run="zero" if spec.fill else "leave_out",
        judges=spec.judges,
        value=spec.value.source,
        best="highest" if spec.highest else "lowest",
        ties=tuple(_key(key) for key in spec.ties),
        intervals=spec.intervals,
        total=spec.total.name,
        total_by=_brought_by(spec.total.plugin),
    )


def _brought_by(plugin: Plugin | None) -> str:
    return (
        "" if plugin is None else f"{plugin.distribution} {plugin.version} {package_sha256(plugin.package)}"
    )


def _key(key: Key) -> dict[str, str]:
    if key.name == COUNT_BACK:
        return {COUNT_BACK: "places"}
    return {"highest" if key.highest else "lowest": key.name}


def _run(run: RunOutcome, stored: StoredResult | None) -> PublishedRun:
    inputs = run.result.provenance.inputs if run.result else ()
    return PublishedRun(
        team=run.team,
        trial=run.trial,
        run=run.number,
        outcome=run.outcome,
        reason=run.reason,
        task=run.task,
        score=run.score,
        kept=run.kept,
        terms=run.terms,
        inputs=tuple(Input(s.role, s.name, s.sha256) for s in inputs),
        result=stored,
        decisions=run.decisions,
        open=run.open,
    )


# The version before ----------------------------------------------------------------------


class _Line2(Struct, frozen=True):
    team: str | UnsetType = UNSET
    score: float | UnsetType = UNSET


class _Strict2(Struct, frozen=True):
    leaderboard: tuple[_Line2, ...] | UnsetType = UNSET


class _Run2(Struct, frozen=True):
    reason: str | UnsetType = UNSET


class _Adjusted2(Struct, frozen=True):
    adjustments: tuple[Decision1, ...] | UnsetType = UNSET
    runs: tuple[_Run2, ...] | UnsetType = UNSET


class _Ranking2(Struct, frozen=True):
    """What `_from_2` relies on; a key that is missing is named by it."""

    results: str | None = None
    cohort: dict[str, Any] | None = None
    strict: _Strict2 | None = None
    adjusted: _Adjusted2 | None = None


def _from_2(data: dict[str, Any]) -> dict[str, Any]:
    """`ranking/2` as `ranking/3`: decisions flat, teams and sums as pairs; `_from_3` drops the statistics."""
    data = {**data, "how": data["ranking"], "folder": data["results"] or ""}
    del data["ranking"], data["results"]
    if data["cohort"] is not None:
        data["cohort"] = {key: value for key, value in data["cohort"].items() if key != "schema"}
    data["strict"] = _strict_from_2(data["strict"])
    adjusted = data.get("adjusted")
    data["adjusted"] = adjusted and _adjusted_from_2(adjusted)
    return data


def _strict_from_2(data: Mapping[str, Any] | None) -> dict[str, Any] | None:
    if data is None:
        return None
    pairs = [[line["team"], line["score"]] for line in data["leaderboard"]]
    return {**data, "leaderboard": pairs, "orders": None}


def _adjusted_from_2(data: Mapping[str, Any]) -> dict[str, Any]:
    decisions = [decision_from_1(decision) for decision in data["adjustments"]]
    return {
        **data,
        "adjustments": decisions,
        "runs": [_decided_from_2(run, decisions) for run in data["runs"]],
    }


def _decided_from_2(run: Mapping[str, Any], decisions: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A run with the ids of the decisions that changed it.

    `ranking/2` wrote the decisions into the reason of the run and nowhere else. Their targets do not
    suffice: they may leave out team and run, and name the run by the SHA-256 of what was measured.
    """
    reason = f"; {run['reason']}; "
    own = [
        decision
        for decision in (convert(one, Adjustment) for one in decisions)
        if decision.trial == run["trial"]
        and decision.team in ("", run["team"])
        and decision.run in (None, run["run"])
        and f"; {decision.author}: {decision.effect}: {decision.reason}; " in reason
    ]
    return {**run, "decisions": [decision.id for decision in own]} if own else dict(run)


def _from_3(data: dict[str, Any]) -> dict[str, Any]:
    """`ranking/3` as `ranking/4`, without its statistics.

    They told equal teams apart where trials were few, and nothing that was stored mends that: rank again.
    """
    adjusted = data.get("adjusted")
    return {**data, "statistics": None, "adjusted": adjusted and {**adjusted, "statistics": None}}


PUBLICATION = Format(
    "ranking",
    4,
    Publication,
    before={2: _from_2, 3: _from_3},
    shapes={2: _Ranking2},
    made_by="'rank -o FILE.json'",
)
"""How a ranking is stored."""


@in_own_decimals
def load_publication(path: Path) -> Publication:
    """Read a published ranking.

    Raises:
        DataFileError: Missing, not a ranking, or one that contradicts itself.
    """
    publication = PUBLICATION.read(path)
    _refuse_contradictions(publication, path)
    return publication


def _refuse_contradictions(found: Publication, path: Path) -> None:
    """Refuse sums that are not those of the trials, and runs of teams or trials that are not listed.

    Raises:
        DataFileError: Naming the place.
    """
    for ranking in (found.ranking, found.final):
        _refuse_wrong_sums(ranking, found.how.total, path)
    hint = "it was edited or damaged: rank again"
    if {run.key for run in found.ranking.runs} != {run.key for run in found.final.runs}:
        raise DataFileError(
            "its adjusted ranking has other runs", file=path, place="$.adjusted.runs", hint=hint
        )
    outside = [stored.file for stored in found.results.values() if not _stays_inside(stored.file)]
    if outside:
        raise DataFileError(
            f"{outside[0]!r} leads out of the folder of results", file=path, place="$.runs", hint=hint
        )
    teams = {standing.team for standing in found.final.standings}
    if (sure := found.final_statistics) is not None and not _about(sure) <= teams:
        raise DataFileError("its statistics are of other teams", file=path, place="$.statistics", hint=hint)


def _about(sure: Statistics) -> set[str]:
    return {odds.team for odds in sure.teams} | {own.team for own in sure.selection}


def _refuse_wrong_sums(ranking: Ranking, total_by: str, path: Path) -> None:
    hint = "it was edited or damaged: rank again"
    teams = {standing.team for standing in ranking.standings}
    if len(teams) < len(ranking.standings) or len(set(ranking.trials)) < len(ranking.trials):
        raise DataFileError("a team or trial stands in it twice", file=path, place="$.standings", hint=hint)
    for number, standing in enumerate(ranking.standings):
        place = f"$.standings[{number}]"
        if set(standing.trials) != set(ranking.trials):
            raise DataFileError("it has other trials than are listed", file=path, place=place, hint=hint)
        total = _total(total_by, [cell.score for cell in standing.trials.values()], standing.execution)
        # Each amount is a float of its own, which keeps 15 digits of what was added up.
        if abs(total - standing.execution) > max(abs(total), Decimal(1)) * Decimal("1e-12"):
            raise DataFileError(
                f"its trials make {total:f}, not {standing.execution:f}"
                if total_by != SUM
                else f"its trials add up to {total:f}, not to {standing.execution:f}",
                file=path,
                place=f"{place}.execution",
                hint=hint,
            )
    strangers = [run for run in ranking.runs if run.team not in teams or run.trial not in ranking.trials]
    if strangers:
        owner = f"{strangers[0].team!r}, {strangers[0].trial!r}"
        raise DataFileError(f"a run of {owner} is of nobody listed", file=path, place="$.runs", hint=hint)


def _total(name: str, scores: Sequence[Decimal], stated: Decimal) -> Decimal:
    """The execution for these scores; the stated one where nothing installed here computes it."""
    try:
        return total_named(name).execution(scores)
    except PluginError:
        return stated


def _stays_inside(name: str) -> bool:
    # Backslash and colon are plain characters here, but lead elsewhere on Windows, where a site may be made.
    parts = name.split("/")
    plain = not set(name) & set("\\:\0") and name.isprintable()
    return plain and all(part not in ("", ".", "..") for part in parts)
