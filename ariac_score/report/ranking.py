"""A ranking as text and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence

from ariac_score.ranking.adjusting import decisions_by_run
from ariac_score.ranking.compare import RankingDifference
from ariac_score.ranking.design import MOST_TRIALS, POWER, Design
from ariac_score.ranking.evaluation import Evaluation
from ariac_score.ranking.open_scores import Ends
from ariac_score.ranking.outcomes import OUTCOMES, Ranking, RunOutcome, TeamRank, final_ranking
from ariac_score.ranking.rank import remarks_on_team
from ariac_score.ranking.selection import WHAT_CHOOSING_DOES
from ariac_score.ranking.statistics import Statistics
from ariac_score.report.openness import would_narrow
from ariac_score.report.spreadsheet import text_cell
from ariac_score.report.statements import is_unattested, unattested
from ariac_score.report.text import amount_text
from ariac_score.terminal.style import Style, plain

__all__ = ["changes_text", "design_text", "ranking_csv", "ranking_text", "strict_text"]

_ORDINARY = ("scored",)
_MOST_CAUSES = 3
"""Of the open runs of a team, so many are named with what would narrow them; all have a page and a result."""


def ranking_text(
    ranking: Ranking,
    strict: Evaluation | None = None,
    differences: Sequence[RankingDifference] = (),
    style: Style | None = None,
    statistics: Statistics | None = None,
) -> str:
    """The leaderboard, how sure it is, unusual runs, and the ranking of the organisers' own program."""
    style = style or Style()
    sections = [
        _head(ranking, style),
        _stewarded(ranking, style),
        _leaderboard(ranking, style),
        _open(ranking, style),
        _sure(ranking, statistics, style) if statistics else (),
        _selection(ranking, statistics, style) if statistics else (),
        _unusual(ranking, style),
        _cohort(ranking, style),
        _strict(strict, differences, style) if strict else (),
    ]
    return "\n\n".join("\n".join(lines) for lines in map(list, sections) if lines) + "\n"


def _head(ranking: Ranking, style: Style) -> Iterator[str]:
    yield style(plain(ranking.title), "bold") + f" by {ranking.rule_set.id}"
    counted = (
        _many(len(ranking.standings), "team"),
        _many(len(ranking.trials), "trial"),
        _many(len(ranking.runs), "run"),
    )
    yield style(f"{', '.join(counted)}, {sum(run.kept for run in ranking.runs)} of them count", "dim")
    if said := unattested([is_unattested(run.result) for run in ranking.runs if run.result]):
        yield style(said, "dim")


def _many(number: int, what: str) -> str:
    """A number of things.

    >>> _many(1, "trial"), _many(3, "trial")
    ('1 trial', '3 trials')
    """
    return f"{number} {what}{'' if number == 1 else 's'}"


def _stewarded(ranking: Ranking, style: Style) -> Iterator[str]:
    """The adjusted ranking, the teams that moved, and every decision; the automatic ranking follows."""
    if ranking.stewarded is None:
        return
    after = ranking.stewarded.ranking
    yield style("As adjusted by the stewards", "bold")
    yield from _leaderboard(after, style)
    yield ""
    before = {standing.team: standing for standing in ranking.standings}
    for standing in after.standings:
        then = before[standing.team]
        if (then.rank, then.execution) != (standing.rank, standing.execution):
            sums = " -> ".join(amount_text(s.execution) for s in (then, standing))
            yield f"  {plain(standing.name)}: {sums}, rank {_rank_change(then.rank, standing.rank)}"
    yield style("Decisions", "bold")
    scores = {run.key: run.score for run in ranking.runs}
    for (team, trial, number), adjusted in decisions_by_run(ranking).items():
        change = [
            "none" if s is None else amount_text(s) for s in (scores[team, trial, number], adjusted.score)
        ]
        yield f"  {plain(team)}, {plain(trial)}, run {number}: {' -> '.join(change)}"
        for decision in adjusted.adjustments:
            yield f"    {decision.id}: {plain(decision.effect)}"
            yield f"      {plain(decision.author)}, {decision.time}: {plain(decision.words)}"
    yield style(f"adjustments: sha256 {ranking.stewarded.sha256[:16]}…", "dim")
    yield ""
    yield style("Automatic", "bold")


def _leaderboard(ranking: Ranking, style: Style) -> Iterator[str]:
    judged = any(standing.judges is not None for standing in ranking.standings)
    head = ["rank", "team", *(["value", "execution", "judges"] if judged else ["score"]), *ranking.trials]
    rows = [head, *(_row(standing, ranking, judged=judged) for standing in ranking.standings)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    for number, row in enumerate(rows):
        cells = [
            cell.ljust(width) if i == 1 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        line = "  ".join(cells).rstrip()
        yield style(line, "dim") if number == 0 else line
    shared = [s.rank for s in ranking.standings if s.rank is not None]
    if len(set(shared)) < len(shared):
        yield style("= shared rank: nothing in the rules separates these teams", "dim")
    if any(cell.outcome not in _ORDINARY for s in ranking.standings for cell in s.trials.values()):
        yield style("* see below", "dim")


def _row(standing: TeamRank, ranking: Ranking, *, judged: bool) -> list[str]:
    same = sum(1 for other in ranking.standings if other.rank == standing.rank)
    rank = "-" if standing.rank is None else f"{standing.rank}{'=' if same > 1 else ''}"
    value = "-" if standing.value is None else f"{standing.value:.10g}"
    judges = "-" if standing.judges is None else amount_text(standing.judges)
    execution = amount_text(standing.execution)
    cells = [
        amount_text(cell.score) + ("" if cell.outcome in _ORDINARY else "*")
        for cell in (standing.trials[trial] for trial in ranking.trials)
    ]
    return [rank, plain(standing.name), *([value, execution, judges] if judged else [execution]), *cells]


def _open(ranking: Ranking, style: Style) -> Iterator[str]:
    """Between which ends the scores and ranks of teams lie whose logs leave something open."""
    final = final_ranking(ranking)
    standings = [s for s in final.standings if s.open is not None]
    if not standings:
        return
    yield style("What logs leave open" + ("" if final is ranking else ", as adjusted"), "bold")
    yield style(
        "  not how sure the ranks are: what was not recorded; never added to the intervals below", "dim"
    )
    for standing in standings:
        ends = standing.open
        assert ends is not None  # only such are listed
        said = f"{amount_text(ends.execution.least)} to {amount_text(ends.execution.most)}"
        same = ends.execution.least == ends.execution.most
        rank = ""
        if ends.best_rank is not None and ends.worst_rank is not None:
            rank = f", rank {_from_to(ends.best_rank, ends.worst_rank)}"
        runs = f" ({_many(ends.runs, 'open run')})" if ends.runs else ""
        score = amount_text(ends.execution.least) if same else said
        yield f"  {plain(standing.name)}: score {score}{rank}{runs}"
        yield from _causes([run for run in final.runs if run.team == standing.team])


def _causes(runs: Sequence[RunOutcome]) -> Iterator[str]:
    """What would narrow the scores of a team's open runs most."""
    said: dict[str, None] = {}
    for run in runs:
        lines = would_narrow(run.result, plain) if run.open is not None and run.result is not None else []
        if lines:
            more = f", and {len(lines) - 1} more" if len(lines) > 1 else ""
            said[f"    {plain(run.trial)}, run {run.number}: {lines[0]}{more}"] = None
    yield from [*said][:_MOST_CAUSES]
    if len(said) > _MOST_CAUSES:
        yield f"    … and {len(said) - _MOST_CAUSES} more open runs"


def _sure(ranking: Ranking, statistics: Statistics, style: Style) -> Iterator[str]:
    """The ranks each team may have, and the teams that cannot be distinguished."""
    names = {standing.team: standing.name for standing in ranking.standings}
    level = f"{100 * statistics.intervals.level:g} %"
    yield style("How sure" if ranking.stewarded is None else "How sure, as adjusted", "bold")
    if statistics.teams:
        drawn = (
            f"; chances from {statistics.intervals.draws} competitions drawn by "
            f"{DRAWN[statistics.resample]}, seed {statistics.intervals.seed}"
            if statistics.resample
            else ""
        )
        yield style(f"  ranks that all hold together at {level}, on trials like these{drawn}", "dim")
    asked = any(pair.p_here is not None for pair in statistics.pairs)
    for odds in statistics.teams:
        here = f"; on exactly these trials {_from_to(odds.here_low, odds.here_high)}" if asked else ""
        chances = ", ".join(
            f"{rank} in {_percent(chance)}" for rank, chance in enumerate(odds.chances, 1) if chance >= 0.005
        )
        drawn = f"; {chances}" if chances else ""
        yield f"  {plain(names[odds.team])}: rank {_from_to(odds.rank_low, odds.rank_high)}{here}{drawn}"
    for group in statistics.groups:
        if len(group.teams) > 1:
            teams = ", ".join(plain(names[team]) for team in group.teams)
            yield f"  cannot be told apart: {teams}"
    yield from (style(f"  {plain(note)}", "dim") for note in statistics.notes)
    for standing in final_ranking(ranking).standings:
        if standing.separated_by not in ("", "value"):
            key = standing.separated_by
            yield f"  {plain(standing.name)} comes after the team of equal value before it by {key}"


def _selection(ranking: Ranking, statistics: Statistics, style: Style) -> Iterator[str]:
    """What each team would have without the choice of its best runs, beside what it has."""
    if not statistics.selection:
        return
    names = {standing.team: standing.name for standing in ranking.standings}
    yield style("What choosing the best runs does", "bold")
    rows = [["team", "as ranked", "as many runs of each team", "a single run"]]
    rows += [
        [
            plain(names[own.team]),
            amount_text(own.published),
            f"{_ends_text(own.alike)} (rank {own.alike_rank})",
            f"{_ends_text(own.single)} (rank {own.single_rank})",
        ]
        for own in statistics.selection
    ]
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for number, row in enumerate(rows):
        cells = (
            cell.ljust(width) if i == 0 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        line = "  " + "  ".join(cells).rstrip()
        yield style(line, "dim") if number == 0 else line
    yield style(f"  {WHAT_CHOOSING_DOES}", "dim")


def _ends_text(ends: Ends) -> str:
    least, most = amount_text(ends.least), amount_text(ends.most)
    return least if least == most else f"{least} to {most}"


DRAWN = {
    "trials_and_runs": "trial and run",
    "trials": "trial, each with its runs",
    "runs": "run",
}
"""What was drawn, in words."""


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def _from_to(low: int, high: int) -> str:
    return f"{low}" if low == high else f"{low} to {high}"


def _unusual(ranking: Ranking, style: Style) -> Iterator[str]:
    """Every run that did not simply get a score, and every trial without one."""
    # Trials without a run have no run to be listed with, so they come first, from the standings.
    lines = [
        f"  {plain(s.team)}, {plain(trial)}: {OUTCOMES['no_run']}, "
        f"so the trial brings {amount_text(cell.score)}"
        for s in ranking.standings
        for trial, cell in s.trials.items()
        if cell.outcome == "no_run"
    ]
    lines += _run_lines([run for run in ranking.runs if run.outcome not in _ORDINARY or run.cause])
    lines += [f"  passed over: {plain(stranger)}" for stranger in ranking.strangers]
    lines += [
        f"  {plain(s.team)}: {plain(remark)}" for s in ranking.standings for remark in remarks_on_team(s)
    ]
    if lines:
        yield style("Out of the ordinary", "bold")
        yield from lines


def _run_lines(runs: Sequence[RunOutcome]) -> Iterator[str]:
    """A line for each run; runs of a team and trial with the same reason share a line."""
    groups: dict[tuple[str, str, str, str], list[int]] = {}
    for run in runs:
        reason = run.reason or OUTCOMES[run.outcome]
        groups.setdefault((run.team, run.trial, run.outcome, reason), []).append(run.number)
    for (team, trial, outcome, reason), numbers in groups.items():
        which = f"run{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
        yield f"  {plain(team)}, {plain(trial)}, {which}: {outcome}: {plain(reason)}"


def _cohort(ranking: Ranking, style: Style) -> Iterator[str]:
    if ranking.cohort is None:
        return
    yield style("Across teams", "bold")
    if not any(means for values in ranking.cohort.trials.values() for means in values.values()):
        yield "  nothing: no run counts"
    for trial, values in ranking.cohort.trials.items():
        for name, means in values.items():
            for path, mean in means.items():
                where = f"{plain(trial)}{'/' + plain(path) if path else ''}"
                value = "none" if mean.value is None else f"{mean.value:.10g}"
                left_out = f", {mean.left_out} left out" if mean.left_out else ""
                yield f"  {where}: mean {name} {value} ({_many(mean.teams, 'team')}{left_out})"


def _strict(strict: Evaluation, differences: Sequence[RankingDifference], style: Style) -> Iterator[str]:
    yield style("The organisers' own program", "bold")
    if strict.stops:
        yield "  it would have ended without a ranking; without what stopped it:"
        for stop in strict.stops:
            where = ", ".join(plain(part) for part in (stop.team, stop.run or stop.trial))
            yield f"  {where}: {stop.exception}: {plain(stop.cause)}"
    if not differences:
        yield "  gives the same scores and ranks"
    for d in differences:
        theirs, ours = ("none" if v is None else f"{v:.10g}" for v in (d.strict, d.robust))
        yield f"  {plain(d.team)}, {plain(d.what)}: {theirs} there, {ours} here: {plain(d.because)}"


def strict_text(strict: Evaluation, style: Style | None = None) -> str:
    """The organisers' leaderboard, and what would have stopped their program."""
    style = style or Style()
    lines = [style("Leaderboard of the organisers' own program", "bold")]
    lines += [
        f"  {place}. {plain(team)}  {score!r}" for place, (team, score) in enumerate(strict.leaderboard, 1)
    ]
    lines += ["", *_strict_stops(strict)] if strict.stops else []
    return "\n".join(lines) + "\n"


def _strict_stops(strict: Evaluation) -> Iterator[str]:
    yield "It would have ended without a ranking; these figures leave out what stopped it:"
    for stop in strict.stops:
        where = ", ".join(plain(part) for part in (stop.trial, stop.team, stop.run) if part)
        yield f"  {where}: {stop.exception}: {plain(stop.cause)}"


def design_text(sizes: Sequence[Design], points: float, teams: int) -> str:
    """How many trials and runs tell teams apart that differ by some points."""
    lines = [
        f"To tell two of {teams} teams apart that differ by {points:g} points a trial, in {POWER:.0%} of "
        "competitions like this one, takes",
    ]
    for size in sizes:
        runs = "1 run of each" if size.runs == 1 else f"{size.runs} runs of each"
        if size.trials is None:
            lines.append(f"  {runs}: more than {MOST_TRIALS} trials; so many tell it in {size.power:.0%}")
        else:
            lines.append(f"  {runs}: {size.trials} trials, which tell it in {size.power:.0%}")
    return "\n".join(lines) + "\n"


def ranking_csv(ranking: Ranking, statistics: Statistics | None = None) -> str:
    """One line for each team, best first, with the score and outcome of each trial.

    After decisions of stewards it is the adjusted ranking, with columns for automatic rank and value.
    """
    automatic = {standing.team: standing for standing in ranking.standings}
    stewarded = ranking.stewarded
    ranking = ranking if stewarded is None else stewarded.ranking
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    added = [] if stewarded is None else ["automatic rank", "automatic value"]
    columns = [
        text_cell(f"{trial} {what}") for trial in ranking.trials for what in ("score", "outcome", "runs")
    ]
    head = ["rank", "team", "name", "value", "execution", "judges", *columns, "remarks"]
    opened = any(standing.open for standing in ranking.standings)
    of_open = ["execution least", "execution most", "open rank low", "open rank high"] if opened else []
    if opened:
        of_open += [text_cell(f"{trial} {end}") for trial in ranking.trials for end in ("least", "most")]
    chosen = {own.team: own for own in statistics.selection} if statistics else {}
    of_choice = [f"{what} {end}" for what in ("alike", "single run") for end in ("least", "most")]
    of_choice = of_choice if chosen else []
    writer.writerow([*head, "rank low", "rank high", *added, *of_open, *of_choice])
    odds = {each.team: each for each in statistics.teams} if statistics else {}
    for standing in ranking.standings:
        own = odds.get(standing.team)
        row: list[str] = [
            "" if standing.rank is None else str(standing.rank),
            text_cell(standing.team),
            text_cell(standing.name),
            "" if standing.value is None else repr(standing.value),
            f"{standing.execution:f}",
            "" if standing.judges is None else f"{standing.judges:f}",
        ]
        for trial in ranking.trials:
            cell = standing.trials[trial]
            row += [f"{cell.score:f}", cell.outcome, " ".join(map(str, cell.runs))]
        row.append(text_cell("; ".join(standing.remarks)))
        row += ["", ""] if own is None else [str(own.rank_low), str(own.rank_high)]
        if stewarded is not None:
            then = automatic[standing.team]
            row.append("" if then.rank is None else str(then.rank))
            row.append("" if then.value is None else repr(then.value))
        row += _ends_of(standing) if opened else []
        if chosen:
            found = chosen.get(standing.team)
            ends = () if found is None else (found.alike, found.single)
            row += [f"{end:f}" for each in ends for end in (each.least, each.most)] or [""] * len(of_choice)
        writer.writerow(row)
    return out.getvalue()


def _ends_of(standing: TeamRank) -> list[str]:
    ends = standing.open
    assert ends is not None  # where one team has ends, all have
    ranks = ["" if rank is None else str(rank) for rank in (ends.best_rank, ends.worst_rank)]
    cells = [
        f"{end:f}"
        for cell in standing.trials.values()
        for end in ((cell.score, cell.score) if cell.open is None else (cell.open.least, cell.open.most))
    ]
    return [f"{ends.execution.least:f}", f"{ends.execution.most:f}", *ranks, *cells]


def changes_text(before: Ranking, after: Ranking) -> Iterator[str]:
    """The changes by another rule set: the runs whose score moves, then every team's score and rank."""
    runs = {run.key: run for run in after.runs}
    unchanged = 0
    for run in before.runs:
        then = runs[run.key]
        if (run.score, run.outcome) == (then.score, then.outcome):
            unchanged += 1
        else:
            yield f"{plain(run.team)}, {plain(run.trial)}, run {run.number}: {_end(run)} -> {_end(then)}"
    yield f"{unchanged} of {len(before.runs)} runs are worth the same"
    standings = {standing.team: standing for standing in after.standings}
    for standing in before.standings:
        then_standing = standings[standing.team]
        sums = " -> ".join(amount_text(s.execution) for s in (standing, then_standing))
        yield f"{plain(standing.name)}: {sums}, rank {_rank_change(standing.rank, then_standing.rank)}"


def _end(run: RunOutcome) -> str:
    return run.outcome if run.score is None else amount_text(run.score)


def _rank_change(before: int | None, after: int | None) -> str:
    shown = ["none" if rank is None else str(rank) for rank in (before, after)]
    return f"{shown[0]} (unchanged)" if before == after else f"{shown[0]} -> {shown[1]}"
