"""The values that the page of a competition shows; its template turns them into text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar

from ariac_score.ranking.changes import Changes
from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.outcomes import OUTCOMES, Cell, Ranking, RunOutcome, TeamRank
from ariac_score.ranking.publication import Publication
from ariac_score.ranking.rank import remarks_on_team
from ariac_score.ranking.selection import WHAT_CHOOSING_DOES
from ariac_score.ranking.statistics import Pair, Statistics, TeamOdds
from ariac_score.ranking.violations import Clause, Tally
from ariac_score.report.html.wording import file_name
from ariac_score.report.site.drawings import Bar, Scale, chances_path, progress, scale_of
from ariac_score.report.site.what_if import WhatIfView, what_if_view
from ariac_score.review.conduct import Breach, RunConduct, TeamConduct, conduct_of_teams
from ariac_score.review.sensitivity import RankSensitivity, RankShift
from ariac_score.review.what_if import WhatIf
from ariac_score.scoring.steward import Adjustment

__all__ = ["View", "clause_page", "clause_views", "team_page", "team_view", "view_of"]

MOST_TEAMS_IN_PAIRS = 20
"""Of more teams the page compares neighbours only; the tables have all pairs."""
FOLDED_PAIRS = 45
"""More pairs than these are folded: ten teams have as many."""


@dataclass(frozen=True)
class TeamRow:
    """One line of the leaderboard.

    Attributes:
        standing: The team.
        shares_rank: Whether another team has the same rank.
        odds: How sure its rank is; `None` where there is nothing to estimate it from.
        groups: Labels of the groups it is in.
        made: Number of runs it made.
        counted: Number of those that count.
        automatic: The team without the decisions of stewards, where there are any.
        conduct: What its runs come to by task and safety; `None` when no result was given.
        page: Its page; empty where there is none.
        bar: Its score by task and safety, drawn; `None` where it cannot be split.
        whisker: Both ends of the interval of its score, and its score, percent of the width.
        chances: Width and path of the drawing of its chances.
        opened: Both ends that logs leave open, and its score, percent of the width; `None` where nothing is.
    """

    standing: TeamRank
    shares_rank: bool
    odds: TeamOdds | None
    groups: tuple[str, ...]
    made: int
    counted: int
    automatic: TeamRank | None = None
    conduct: TeamConduct | None = None
    page: str = ""
    bar: Bar | None = None
    whisker: tuple[float, float, float] | None = None
    chances: tuple[int, str] | None = None
    opened: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Decision:
    """One decision of the stewards, and the run it changed; `None` where the ranking does not name it."""

    adjustment: Adjustment
    run: RunLink | None


@dataclass(frozen=True)
class RunLink:
    """One run of a cell, and its page; empty where there is none."""

    run: RunOutcome
    page: str
    conduct: RunConduct | None = None


@dataclass(frozen=True)
class TrialCell:
    """One team in one trial."""

    cell: Cell
    runs: tuple[RunLink, ...]

    @property
    def page(self) -> str:
        """The page of the first run that counts, else of the first there is."""
        for link in self.runs:
            if link.run.kept and link.page:
                return link.page
        return next((link.page for link in self.runs if link.page), "")


@dataclass(frozen=True)
class View:
    """What the page shows."""

    publication: Publication
    ranking: Ranking
    statistics: Statistics | None
    names: Mapping[str, str]
    rows: tuple[TeamRow, ...]
    cells: Mapping[str, Mapping[str, TrialCell]]
    judged: bool
    valued: bool
    started: bool
    pairs: tuple[Pair, ...]
    unusual: tuple[RunLink, ...]
    tallies: tuple[Tally, ...] | None
    looked_at: int
    sensitivity: tuple[RankSensitivity, ...] | None
    changes: Changes | None
    outcomes: Mapping[str, str]
    decisions: tuple[Decision, ...] = ()
    decided_in: str = ""
    standards: tuple[str, ...] = ()
    scale: Scale | None = None
    digits: int = 2
    what_if: WhatIfView | None = None
    unattested: str = ""

    @property
    def remarks(self) -> tuple[tuple[str, str], ...]:
        """What to know of teams, with their names."""
        return tuple((s.name, remark) for s in self.ranking.standings for remark in remarks_on_team(s))

    @property
    def priced(self) -> bool:
        """Whether the score of any run depends on a check of safety."""
        return any(row.conduct.priced for row in self.rows if row.conduct)

    most_in_pairs: ClassVar[int] = MOST_TEAMS_IN_PAIRS
    what_choosing_does: ClassVar[str] = WHAT_CHOOSING_DOES

    @property
    def columns(self) -> tuple[TeamRow, ...]:
        """The teams that have a column of their own beside the standards: of many teams none has."""
        return self.rows if len(self.rows) <= MOST_TEAMS_IN_PAIRS else ()

    @property
    def open(self) -> bool:
        """Whether the logs leave any score open."""
        return any(row.standing.open for row in self.rows)

    @property
    def has_pages(self) -> bool:
        """Whether runs have pages."""
        return any(cell.page for cells in self.cells.values() for cell in cells.values())

    @property
    def shared(self) -> bool:
        """Whether teams share a rank."""
        return any(row.shares_rank for row in self.rows)

    @property
    def folded(self) -> bool:
        """Whether the differences are too many to be shown at once."""
        return len(self.pairs) > FOLDED_PAIRS

    def moved(self, shift: RankShift) -> list[tuple[str, int | None, int | None]]:
        """The teams whose rank a shift changes: name, rank before, rank after."""
        return [
            (self.names.get(team, team), shift.before.get(team), rank)
            for team, rank in shift.after.items()
            if shift.before.get(team) != rank
        ]


def view_of(
    publication: Publication,
    links: Mapping[RunKey, str],
    tallies: Sequence[Tally] | None,
    sensitivity: Sequence[RankSensitivity] | None,
    changes: Changes | None,
    conducts: Mapping[RunKey, RunConduct] = MappingProxyType({}),
    what_if: WhatIf | None = None,
    unattested: str = "",
) -> View:
    """The values that the page shows.

    Args:
        publication: The ranking.
        links: The page of each run that has one.
        tallies: Violations by clause; `None` when no result was given.
        sensitivity: How the ranks depend on each number; `None` when it was not given.
        changes: Since the previous publication; `None` when none was given.
        conducts: Of each run that has a result.
        what_if: The ranking under other numbers; `None` when none was computed.
        unattested: How many runs rest on logs that nobody attests, in words; empty where that is no question.
    """
    ranking, statistics = publication.final, publication.final_statistics
    by_cell: dict[tuple[str, str], list[RunLink]] = {}
    for run in ranking.runs:
        link = RunLink(run, links.get(run.key, ""), conducts.get(run.key))
        by_cell.setdefault((run.team, run.trial), []).append(link)
    teams = conduct_of_teams(publication, conducts) if conducts else {}
    drawn = _drawn(publication, teams)
    return View(
        publication=publication,
        ranking=ranking,
        statistics=statistics,
        names={standing.team: standing.name for standing in ranking.standings},
        rows=tuple(_row(s, publication, teams.get(s.team), drawn) for s in ranking.standings),
        cells={
            standing.team: {
                trial: TrialCell(cell, tuple(by_cell.get((standing.team, trial), ())))
                for trial, cell in standing.trials.items()
            }
            for standing in ranking.standings
        },
        judged=any(standing.judges is not None for standing in ranking.standings),
        valued=publication.how.value != "execution",
        started=bool(ranking.runs),
        pairs=tuple(_shown_pairs(publication)),
        unusual=tuple(
            link
            for found in by_cell.values()
            for link in found
            if link.run.outcome != "scored" or (link.run.reason and not link.run.decisions)
        ),
        tallies=None if tallies is None else tuple(tallies),
        looked_at=len(links),
        sensitivity=None if sensitivity is None else tuple(sensitivity),
        changes=changes,
        outcomes=OUTCOMES,
        decisions=_decisions(publication, by_cell),
        decided_in=publication.ranking.stewarded.sha256 if publication.ranking.stewarded else "",
        standards=_standards(teams.values()),
        scale=drawn.parts,
        digits=_digits(ranking),
        what_if=None if what_if is None else what_if_view(what_if, publication.final),
        unattested=unattested,
    )


@dataclass(frozen=True)
class _Drawn:
    """The scales of the leaderboard: of task and safety, of the intervals, and of what logs leave open."""

    parts: Scale
    spread: Scale
    opened: Scale


def _drawn(publication: Publication, teams: Mapping[str, TeamConduct]) -> _Drawn:
    """Every scale takes in all scores, so that a score lies within whatever it is drawn on."""
    standings, statistics = publication.final.standings, publication.final_statistics
    scores = [standing.execution for standing in standings]
    tasks = [one.task for one in teams.values() if one.task is not None]
    spread = [end for odds in (statistics.teams if statistics else ()) for end in odds.execution or ()]
    opened = [end for s in standings if s.open for end in (s.open.execution.least, s.open.execution.most)]
    return _Drawn(
        scale_of([*scores, *tasks]),
        scale_of([*spread, *scores]),
        scale_of([*opened, *scores] if opened else []),
    )


def _standards(teams: Iterable[TeamConduct]) -> tuple[str, ...]:
    """The standards that checks of safety cite, those most violated first."""
    violated = Counter[str]()
    for one in teams:
        violated.update(one.violated)
        violated.update(dict.fromkeys(one.undecided, 0))
    return tuple(sorted(violated, key=lambda name: (-violated[name], name)))


def _digits(ranking: Ranking) -> int:
    """As many decimals, two at least, as tell all scores apart that differ."""
    scores = {standing.execution for standing in ranking.standings}
    fits = (d for d in range(2, 6) if len({f"{score:.{d}f}" for score in scores}) == len(scores))
    return next(fits, 6)


def _shown_pairs(publication: Publication) -> Sequence[Pair]:
    """All pairs; of many teams only those of neighbours, for their number grows with the square."""
    statistics = publication.final_statistics
    if statistics is None or len(statistics.teams) <= MOST_TEAMS_IN_PAIRS:
        return statistics.pairs if statistics else ()
    order = [standing.team for standing in publication.final.standings]
    neighbours = set(pairwise(order))
    return [pair for pair in statistics.pairs if (pair.first, pair.second) in neighbours]


def _decisions(
    publication: Publication, by_cell: Mapping[tuple[str, str], Sequence[RunLink]]
) -> tuple[Decision, ...]:
    stewarded = publication.ranking.stewarded
    if stewarded is None:
        return ()
    decided = {name: link for links in by_cell.values() for link in links for name in link.run.decisions}
    return tuple(Decision(decision, decided.get(decision.id)) for decision in stewarded.adjustments)


def _row(standing: TeamRank, publication: Publication, conduct: TeamConduct | None, drawn: _Drawn) -> TeamRow:
    ranking, statistics = publication.final, publication.final_statistics
    same = sum(1 for other in ranking.standings if other.rank == standing.rank)
    odds = {each.team: each for each in statistics.teams} if statistics else {}
    groups = statistics.groups if statistics else ()
    stewarded = publication.ranking.stewarded is not None
    automatic = {s.team: s for s in publication.ranking.standings} if stewarded else {}
    return TeamRow(
        standing,
        standing.rank is not None and same > 1 and bool(ranking.runs),
        odds.get(standing.team),
        tuple(group.label for group in groups if standing.team in group.teams),
        sum(cell.made for cell in standing.trials.values()),
        sum(len(cell.runs) for cell in standing.trials.values()),
        automatic.get(standing.team),
        conduct,
        team_page(standing.team) if conduct else "",
        _bar(standing, conduct, drawn.parts),
        _whisker(standing, odds.get(standing.team), drawn.spread),
        chances_path(own.chances) if (own := odds.get(standing.team)) and own.chances else None,
        _opened(standing, drawn.opened),
    )


def _bar(standing: TeamRank, conduct: TeamConduct | None, scale: Scale) -> Bar | None:
    if conduct is None or conduct.task is None:
        return None
    return Bar.of(conduct.task, standing.execution, scale)


def _opened(standing: TeamRank, scale: Scale) -> tuple[float, float, float] | None:
    if standing.open is None:
        return None
    ends = standing.open.execution
    return scale.at(ends.least), scale.at(ends.most), scale.at(standing.execution)


def _whisker(standing: TeamRank, odds: TeamOdds | None, scale: Scale) -> tuple[float, float, float] | None:
    if odds is None or odds.execution is None:
        return None
    low, high = odds.execution
    return scale.at(low), scale.at(high), scale.at(standing.execution)


def team_page(team: str) -> str:
    """The path of the page of a team in the site."""
    return f"teams/{file_name(team)}.html"


def clause_page(clause: Clause) -> str:
    """The path of the page of a standard's clause in the site."""
    return f"violations/{file_name(' '.join(part for part in clause if part))}.html"


# Pages of teams and clauses ------------------------------------------------------------


@dataclass(frozen=True)
class TrialProgress:
    """The runs of a team in one trial, in the order of their numbers.

    Attributes:
        trial: Its id.
        cell: What the trial counts for the team.
        runs: The runs.
        line: Their scores, as a path.
        points: Their places in the drawing.
        zero: Where a score of 0 lies in it.
    """

    trial: str
    cell: Cell
    runs: tuple[RunLink, ...]
    line: str
    points: tuple[tuple[float, float, int], ...]
    zero: float


@dataclass(frozen=True)
class Help:
    """What a check that found nothing wrong would have brought a team.

    Attributes:
        check: Its name in words.
        clause: What it cites.
        page: The page of that clause; empty where there is none.
        gain: Points.
        watched: Whether it is about safety.
    """

    check: str
    clause: str
    page: str
    gain: Decimal
    watched: bool


@dataclass(frozen=True)
class TeamView:
    """What the page of a team shows."""

    view: View
    row: TeamRow
    trials: tuple[TrialProgress, ...]
    helps: tuple[Help, ...]


PROGRESS_WIDTH, PROGRESS_HEIGHT = 300, 90


def team_view(view: View, row: TeamRow, pages: Collection[str]) -> TeamView:
    """The values of the page of a team.

    Args:
        view: The competition.
        row: The team.
        pages: The paths of the pages of clauses.
    """
    assert row.conduct is not None  # only then there is a page
    cells = view.cells[row.standing.team]
    scores = [link.run.score for own in view.cells.values() for one in own.values() for link in one.runs]
    scale = scale_of(scores)
    trials = []
    for trial in view.ranking.trials:
        one = cells[trial]
        own = [(link.run.number, link.run.score) for link in one.runs]
        line, points = progress(own, scale, PROGRESS_WIDTH, PROGRESS_HEIGHT)
        zero = round(PROGRESS_HEIGHT * (1 - scale.at(0) / 100), 1)
        trials.append(TrialProgress(trial, one.cell, one.runs, line, points, zero))
    cited: dict[str, Breach] = {}
    for one in cells.values():
        for link in one.runs:
            for breach in link.conduct.breaches if link.conduct else ():
                cited.setdefault(breach.finding.rpartition("#")[0], breach)
    helps = []
    for check, gain in row.conduct.gains.items():
        found = cited.get(check)
        page = clause_page(found.clause) if found else ""
        clause = ", ".join(part for part in found.clause if part) if found else ""
        watched = found is not None and found.watched
        words = check.replace("_", " ")
        helps.append(Help(words, clause, page if page in pages else "", gain, watched))
    return TeamView(view, row, tuple(trials), tuple(helps))


@dataclass(frozen=True)
class ClauseRow:
    """One team and one clause: how often and in how many runs it was violated, what the ledger took."""

    row: TeamRow
    violated: int
    runs: int
    undecided: int
    cost: Decimal


@dataclass(frozen=True)
class ClauseView:
    """What the page of a clause shows.

    Attributes:
        view: The competition.
        tally: The clause, counted.
        rows: The teams, those with most violations first.
        found: The violations, each with its run, dear ones first, at most `MOST_LISTED`.
        left_out: How many are not listed.
        watched: Whether it is about safety.
    """

    view: View
    tally: Tally
    rows: tuple[ClauseRow, ...]
    found: tuple[tuple[RunLink, Breach], ...]
    left_out: int
    watched: bool


MOST_LISTED = 300


def clause_views(view: View) -> Iterator[ClauseView]:
    """The pages of the clauses that were violated."""
    listed: dict[Clause, list[tuple[RunLink, Breach]]] = {}
    for own in view.cells.values():
        for one in own.values():
            for link in one.runs:
                for breach in link.conduct.breaches if link.conduct else ():
                    listed.setdefault(breach.clause, []).append((link, breach))
    for tally in view.tallies or ():
        if not tally.verdicts.get("violated"):
            continue
        found = sorted(listed.get(tally.clause, ()), key=lambda one: one[1].cost or Decimal(0))
        costs: dict[str, Decimal] = {}
        for link, breach in found:
            costs[link.run.team] = costs.get(link.run.team, Decimal(0)) + (breach.cost or Decimal(0))
        rows = [
            ClauseRow(
                row,
                tally.violated.get(team, 0),
                tally.runs.get(team, 0),
                tally.undecided.get(team, 0),
                costs.get(team, Decimal(0)),
            )
            for row in view.rows
            for team in (row.standing.team,)
        ]
        rows.sort(key=lambda one: -one.violated)
        yield ClauseView(
            view,
            tally,
            tuple(rows),
            tuple(found[:MOST_LISTED]),
            tally.verdicts["violated"] - min(len(found), MOST_LISTED),
            any(breach.watched for _, breach in found),
        )
