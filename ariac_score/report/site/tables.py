"""The tables of a competition as CSV and JSON: the numbers of the page, for other programs."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from types import MappingProxyType

from ariac_score.ranking.changes import Changes
from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import OUTCOMES, Stewarded, TeamRank
from ariac_score.ranking.publication import Publication
from ariac_score.ranking.selection import Selection
from ariac_score.ranking.violations import Tally
from ariac_score.report.spreadsheet import text_cell
from ariac_score.results.result import canonical
from ariac_score.review.conduct import RunConduct, TeamConduct, conduct_of_teams
from ariac_score.review.sensitivity import RankSensitivity
from ariac_score.review.what_if import WhatIf

__all__ = ["Table", "cell_text", "table_csv", "table_json", "tables_of"]

Value = str | int | float | Decimal | bool | None


MOST_ROWS_IN_JSON = 20_000
"""A longer table is written as CSV alone; all pairs of 200 teams fit."""


@dataclass(frozen=True)
class Table:
    """A table.

    Attributes:
        name: Of its files, without suffix.
        title: One line about it.
        columns: Their names.
        rows: A value for each column.
    """

    name: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]

    @property
    def in_json(self) -> bool:
        """Whether it is written as JSON too, which for very many rows would be tens of megabytes."""
        return len(self.rows) <= MOST_ROWS_IN_JSON


def table_csv(table: Table) -> str:
    """A table as CSV; no spreadsheet takes a text in it for a formula."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([cell_text(column) for column in table.columns])
    writer.writerows([cell_text(value) for value in row] for row in table.rows)
    # The name of a file may hold half a surrogate pair, which has no place in UTF-8.
    return out.getvalue().encode("utf-8", "backslashreplace").decode("utf-8")


def cell_text(value: Value) -> str:
    """A value as it stands in CSV.

    >>> cell_text("=cmd()"), cell_text(-1.5), cell_text(None)
    ("'=cmd()", '-1.5', '')
    """
    if value is None:
        return ""
    if isinstance(value, bool):  # before numbers, for True is an int
        return "yes" if value else "no"
    if isinstance(value, Decimal):
        return f"{value:f}"
    if isinstance(value, str):
        return text_cell(value)
    return repr(value)


def table_json(table: Table) -> str:
    """A table as JSON: a list of objects, one for each row."""
    data = {
        "table": table.name,
        "title": table.title,
        "columns": list(table.columns),
        "rows": [
            {
                column: float(value) if isinstance(value, Decimal) else value
                for column, value in zip(table.columns, row, strict=True)
            }
            for row in table.rows
        ],
    }
    text = json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False)
    return text.encode("utf-8", "backslashreplace").decode("utf-8") + "\n"


def tables_of(
    publication: Publication,
    tallies: Sequence[Tally] | None,
    sensitivity: Sequence[RankSensitivity] | None,
    changes: Changes | None,
    conducts: Mapping[RunKey, RunConduct] = MappingProxyType({}),
    what_if: WhatIf | None = None,
) -> tuple[Table, ...]:
    """Every table of a competition, without those for which nothing was given."""
    tables = [_leaderboard(publication, conducts), _trials(publication), _runs(publication, conducts)]
    if publication.ranking.stewarded is not None:
        tables.append(_decisions(publication.ranking.stewarded))
    if publication.final_statistics is not None:
        tables += [_chances(publication), _pairs(publication), _groups(publication)]
        if publication.final_statistics.selection:
            tables.append(_selection(publication.final_statistics.selection))
    if tallies is not None:
        tables.append(_violations(publication, tallies))
    if sensitivity is not None:
        tables.append(_sensitivity(sensitivity))
    if what_if is not None and what_if.levers:
        tables.append(_what_if(what_if))
    if changes is not None:
        tables += [_team_changes(changes), _run_changes(changes)]
    return tuple(tables)


def _leaderboard(publication: Publication, conducts: Mapping[RunKey, RunConduct]) -> Table:
    teams = conduct_of_teams(publication, conducts) if conducts else {}
    standards = sorted({standard for one in teams.values() for standard in one.violated})
    statistics = publication.final_statistics
    odds = {each.team: each for each in statistics.teams} if statistics else {}
    groups = statistics.groups if statistics else ()
    ties = list(publication.final.standings[0].ties) if publication.final.standings else []
    # Names of columns are what other programs read: they stay, however the page words them.
    columns = ["rank", "rank_low", "rank_high", "groups", "team", "name", "value", "execution"]
    columns += ["execution_low", "execution_high", "judges", "runs_made", "runs_counted", "places"]
    columns += [*(f"tie: {name}" for name in ties), "separated_by", "disqualified", "remarks"]
    columns += ["automatic_rank", "automatic_execution"]
    opened = any(standing.open for standing in publication.final.standings)
    if opened:
        columns += ["open_least", "open_most", "open_rank_best", "open_rank_worst"]
    if teams:
        columns += ["task_points", "safety_points", "steward_points"]
        columns += [
            "worst_approach_margin_m",
            "worst_approach_m",
            "worst_approach_trial",
            "worst_approach_run",
        ]
        columns += [*(f"violations: {standard}" for standard in standards), "undecided"]
    automatic = {standing.team: standing for standing in publication.ranking.standings}
    rows: list[tuple[Value, ...]] = []
    for s in publication.final.standings:
        own = odds.get(s.team)
        rows.append(
            (
                s.rank,
                own.rank_low if own else None,
                own.rank_high if own else None,
                " ".join(group.label for group in groups if s.team in group.teams),
                s.team,
                s.name,
                s.value,
                s.execution,
                *(own.execution if own and own.execution else (None, None)),
                s.judges,
                sum(cell.made for cell in s.trials.values()),
                sum(len(cell.runs) for cell in s.trials.values()),
                " ".join(map(str, s.places)),
                *(s.ties[name] for name in ties),
                s.separated_by,
                s.disqualified,
                "; ".join(s.remarks),
                automatic[s.team].rank,
                automatic[s.team].execution,
                *(_ends(s) if opened else ()),
                *(_conduct(teams[s.team], standards) if teams else ()),
            )
        )
    return Table("leaderboard", "Leaderboard", tuple(columns), tuple(rows))


def _ends(standing: TeamRank) -> tuple[Value, ...]:
    ends = standing.open
    return (
        (None,) * 4
        if ends is None
        else (ends.execution.least, ends.execution.most, ends.best_rank, ends.worst_rank)
    )


def _conduct(of: TeamConduct, standards: Sequence[str]) -> tuple[Value, ...]:
    (_, trial, number), nearest = of.approach or (("", None, None), None)
    return (
        of.task,
        of.safety,
        of.decided,
        canonical(nearest.margin_m) if nearest else None,
        nearest.distance_m if nearest else None,
        trial,
        number,
        *(of.violated.get(standard, 0) for standard in standards),
        sum(of.undecided.values()),
    )


def _what_if(found: WhatIf) -> Table:
    rows: list[tuple[Value, ...]] = []
    for at, point in found.points.items():
        steps = [lever.steps[step] for lever, step in zip(found.levers, at, strict=True)]
        if point is None:
            rows.append((*steps, "", None, None, None, None))
        for team, place in (point or {}).items():
            safety = None if place.task is None else place.score - place.task
            rows.append((*steps, team, place.rank, place.score, place.task, safety))
    columns = (*(lever.name for lever in found.levers), "team", "rank", "execution")
    columns = (*columns, "task_points", "safety_points")
    return Table("what_if", "The ranking under other numbers", columns, tuple(rows))


def _both(ends: Ends | None) -> tuple[Value, ...]:
    return (None, None) if ends is None else (ends.least, ends.most)


def _trials(publication: Publication) -> Table:
    opened = any(cell.open for s in publication.final.standings for cell in s.trials.values())
    rows: list[tuple[Value, ...]] = [
        (
            s.team,
            s.name,
            trial,
            cell.score,
            cell.outcome,
            cell.reason,
            " ".join(map(str, cell.runs)),
            cell.made,
            *(_both(cell.open) if opened else ()),
        )
        for s in publication.final.standings
        for trial, cell in s.trials.items()
    ]
    columns: tuple[str, ...] = (
        "team",
        "name",
        "trial",
        "score",
        "outcome",
        "reason",
        "runs_counted",
        "runs_made",
    )
    if opened:
        columns = (*columns, "open_least", "open_most")
    return Table("trials", "Score of each team in each trial", columns, tuple(rows))


def _runs(publication: Publication, conducts: Mapping[RunKey, RunConduct]) -> Table:
    terms = list(dict.fromkeys(name for run in publication.final.runs for name in run.terms))
    opened = any(run.open for run in publication.final.runs)
    rows: list[tuple[Value, ...]] = []
    for run in publication.final.runs:
        stored = publication.results.get(run.key)
        rows.append(
            (
                run.team,
                run.trial,
                run.number,
                run.task,
                run.score,
                run.kept,
                run.outcome,
                run.reason or OUTCOMES[run.outcome],
                stored.sha256 if stored else "",
                *(run.terms.get(name) for name in terms),
                *(_both(run.open) if opened else ()),
                *(_of_run(conducts.get(run.key)) if conducts else ()),
            )
        )
    columns = (
        "team",
        "trial",
        "run",
        "task",
        "score",
        "counts",
        "outcome",
        "reason",
        "result_sha256",
        *terms,
        *(("open_least", "open_most") if opened else ()),
    )
    if conducts:
        columns = (*columns, "task_points", "safety_points", "violations", "worst_approach_margin_m")
    return Table("runs", "Every run", columns, tuple(rows))


def _of_run(conduct: RunConduct | None) -> tuple[Value, ...]:
    if conduct is None:
        return None, None, None, None
    parts, nearest = conduct.parts, conduct.approach
    return (
        parts.task if parts else None,
        parts.safety if parts else None,
        sum(conduct.violated.values()),
        canonical(nearest.margin_m) if nearest else None,
    )


def _decisions(stewarded: Stewarded) -> Table:
    columns = (
        "id",
        "author",
        "time",
        "complaint",
        "reason",
        "effect",
        "team",
        "trial",
        "run",
        "finding",
        "measured_sha256",
    )
    rows: list[tuple[Value, ...]] = [
        (
            d.id,
            d.author,
            d.time,
            d.complaint,
            d.reason,
            d.effect,
            d.team,
            d.trial,
            d.run,
            d.finding,
            d.measured,
        )
        for d in stewarded.adjustments
    ]
    return Table("decisions", "Decisions of the stewards", columns, tuple(rows))


def _chances(publication: Publication) -> Table:
    assert publication.final_statistics is not None  # `tables_of` makes this table only then
    rows: list[tuple[Value, ...]] = [
        (odds.team, rank, chance)
        for odds in publication.final_statistics.teams
        for rank, chance in enumerate(odds.chances, start=1)
    ]
    return Table("rank_chances", "Chances of each rank", ("team", "rank", "chance"), tuple(rows))


def _pairs(publication: Publication) -> Table:
    assert publication.final_statistics is not None  # `tables_of` makes this table only then
    columns = (
        "first",
        "second",
        "ahead",
        "low",
        "high",
        "chance",
        "p",
        "p_back",
        "told",
        "p_here",
        "p_here_back",
        "told_here",
    )
    rows: list[tuple[Value, ...]] = [
        (
            p.first,
            p.second,
            p.ahead,
            p.low,
            p.high,
            p.chance,
            p.p,
            p.p_back,
            p.told,
            p.p_here,
            p.p_here_back,
            p.told_here,
        )
        for p in publication.final_statistics.pairs
    ]
    return Table("pairs", "Differences between teams", columns, tuple(rows))


def _groups(publication: Publication) -> Table:
    assert publication.final_statistics is not None  # `tables_of` makes this table only then
    rows: list[tuple[Value, ...]] = [
        (group.label, team) for group in publication.final_statistics.groups for team in group.teams
    ]
    return Table("groups", "Groups of teams that cannot be told apart", ("group", "team"), tuple(rows))


def _selection(selection: Sequence[Selection]) -> Table:
    columns = (
        "team",
        "published",
        *(f"{what}_{end}" for what in _CHOSEN for end in ("least", "most", "rank")),
    )
    rows: list[tuple[Value, ...]] = [
        (
            own.team,
            own.published,
            own.alike.least,
            own.alike.most,
            own.alike_rank,
            own.single.least,
            own.single.most,
            own.single_rank,
        )
        for own in selection
    ]
    return Table("selection", "What choosing the best runs does", columns, tuple(rows))


_CHOSEN = ("alike", "single")


def _violations(publication: Publication, tallies: Sequence[Tally]) -> Table:
    rows: list[tuple[Value, ...]] = [
        (
            *tally.clause,
            standing.team,
            tally.violated.get(standing.team, 0),
            tally.runs.get(standing.team, 0),
            tally.undecided.get(standing.team, 0),
        )
        for tally in tallies
        for standing in publication.final.standings
    ]
    columns = ("standard", "clause", "team", "violations", "runs_with_violations", "undecided")
    return Table("violations", "Violations by standard and clause", columns, tuple(rows))


def _sensitivity(found: Sequence[RankSensitivity]) -> Table:
    return Table(
        "sensitivity",
        "Values of parameters at which ranks change",
        (
            "parameter",
            "value",
            "low",
            "high",
            "changes_at",
            "team",
            "rank_before",
            "rank_after",
            "not_varied",
        ),
        tuple(row for each in found for row in _sensitivity_rows(each)),
    )


def _sensitivity_rows(each: RankSensitivity) -> Iterator[tuple[Value, ...]]:
    knob = each.knob
    head = (knob.name, knob.base, knob.low, knob.high)
    if not each.shifts:
        yield (*head, None, None, None, None, each.skipped)
    for shift in each.shifts:
        moved = [team for team in shift.after if shift.after[team] != shift.before.get(team)]
        for team in moved:
            yield (*head, shift.value, team, shift.before.get(team), shift.after[team], "")
        if not moved:  # there is no ranking on one side
            yield (*head, shift.value, None, None, None, "")


def _team_changes(changes: Changes) -> Table:
    columns = ("team", "name", "rank_before", "rank", "execution_before", "execution", "note")
    rows: list[tuple[Value, ...]] = [
        (t.team, t.name, t.rank_before, t.rank, t.execution_before, t.execution, t.note)
        for t in changes.teams
    ]
    return Table("team_changes", "Teams since the previous publication", columns, tuple(rows))


def _run_changes(changes: Changes) -> Table:
    rows: list[tuple[Value, ...]] = [
        (*change.key, change.what, change.before, change.now) for change in changes.runs
    ]
    columns = ("team", "trial", "run", "what", "before", "now")
    return Table("run_changes", "Runs since the previous publication", columns, tuple(rows))
